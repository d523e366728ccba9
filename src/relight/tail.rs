//! What comes after the last stored layer, and emission: closed forms in the chances to escape.
//!
//! With a_k = sqrt(4π) T_k,00 the chance to escape after exactly k bounces, S_k = 1 − Σ_{j<k} a_j the
//! chance to survive k hits, and K the last stored layer, the layers beyond are taken to
//! fall geometrically, a_{K+j} = a_K r^j, with r = min(a_K/a_{K−1}, S_{K+1}/(S_{K+1}+a_K)). The second
//! term keeps Σ a ≤ 1.

use super::block::{Lanes, each};

/// The tail of one texel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tail {
    /// Ratio of successive layers beyond the last; 0 = no tail.
    pub ratio: f32,
    /// a_{K−1}.
    before: f32,
    /// a_K.
    last: f32,
    /// S_{K+1}.
    survival: f32,
}

impl Tail {
    /// From the chances to escape a_0…a_K; one layer alone has no tail.
    pub fn new(escapes: &[f32]) -> Self {
        let escaped = escapes.iter().sum::<f32>();
        match escapes {
            [.., before, last] => Self::beyond(escaped, *before, *last),
            // Nothing came before it: no ratio.
            _ => Self::beyond(escaped, 0.0, escapes.first().copied().unwrap_or(0.0)),
        }
    }

    /// From Σ a_k, a_{K−1} and a_K.
    #[inline(always)]
    fn beyond(escaped: f32, before: f32, last: f32) -> Self {
        let survival = (1.0 - escaped).max(0.0);
        let ratio = (last / before).min(survival / (survival + last));
        let ratio = if (before > 0.0) & (last > 0.0) { ratio } else { 0.0 };
        Self { ratio, before, last, survival }
    }

    /// Factor g of the tail: beyond the last layer's ρ^(K+1)⟨T_K, L⟩ comes g times it, g = ρ r/(1 − ρ r).
    #[inline(always)]
    pub fn gain(&self, albedo: f32) -> f32 {
        let x = albedo * self.ratio;
        x / (1.0 - x)
    }

    /// ∂g/∂r of the gain.
    #[inline(always)]
    pub(super) fn gain_slope(&self, albedo: f32) -> f32 {
        let rest = 1.0 - albedo * self.ratio;
        albedo / (rest * rest)
    }

    /// Exitant radiance per emitted radiance,
    /// Σ_{k=0}^{K+1} ρ^k S_k + ρ^(K+2) (S_∞/(1−ρ) + a_K r²/((1−r)(1−ρ r))),
    /// S_∞ = max(0, S_{K+1} − a_K r/(1−r)); and what was left out: for ρ = 1 the sum over S_∞ has no end
    /// and stops at K+1, with S_∞ as the remainder per further bounce.
    pub fn emission(&self, escapes: &[f32], albedo: f32) -> (f32, f32) {
        let mut sum = 0.0;
        let mut power = 1.0;
        let mut survive = 1.0f32;
        for a in escapes {
            sum += power * survive.max(0.0);
            survive -= a;
            power *= albedo;
        }
        sum += power * self.survival;
        power *= albedo;
        let r = self.ratio;
        let escaped = self.last * r / (1.0 - r);
        let forever = (self.survival - escaped).max(0.0);
        let decaying = self.last * r * r / ((1.0 - r) * (1.0 - albedo * r));
        if albedo < 1.0 {
            (sum + power * (forever / (1.0 - albedo) + decaying), 0.0)
        } else {
            (sum + power * decaying, forever)
        }
    }
}

/// The tails of a block of texels.
pub(super) struct Tails {
    ratio: Lanes,
    before: Lanes,
    last: Lanes,
    /// S_{K+1}, the chance to survive all stored layers.
    pub(super) survival: Lanes,
}

impl Tails {
    /// From Σ a_k, a_{K−1} if there is one, and a_K.
    #[inline(always)]
    pub(super) fn new(escaped: &Lanes, before: Option<&Lanes>, last: &Lanes) -> Self {
        let before = *before.unwrap_or(&[0.0; super::block::LANES]);
        let (ratio, survival) = (
            each(|j| Tail::beyond(escaped[j], before[j], last[j]).ratio),
            each(|j| Tail::beyond(escaped[j], before[j], last[j]).survival),
        );
        Self { ratio, before, last: *last, survival }
    }

    /// The tail of one texel.
    #[inline(always)]
    pub(super) fn at(&self, lane: usize) -> Tail {
        let (ratio, survival) = (self.ratio[lane], self.survival[lane]);
        Tail { ratio, before: self.before[lane], last: self.last[lane], survival }
    }

    /// ∂r/∂a_{K−1}, ∂r/∂a_K and ∂r/∂S_{K+1}, each of the others held; zeros where there is no tail.
    #[inline(always)]
    pub(super) fn ratio_slopes(&self) -> [Lanes; 3] {
        let Self { ratio, before, last, survival } = self;
        let all = each(|j| survival[j] + last[j]);
        // Quotients first, choices after: so they are made for all lanes at once.
        let measured = [each(|j| -ratio[j] / before[j]), each(|j| ratio[j] / last[j])];
        let capped = [each(|j| -survival[j] / (all[j] * all[j])), each(|j| last[j] / (all[j] * all[j]))];
        let is_measured = |j: usize| last[j] * all[j] <= survival[j] * before[j];
        let chosen = [
            each(|j| if is_measured(j) { measured[0][j] } else { 0.0 }),
            each(|j| if is_measured(j) { measured[1][j] } else { capped[0][j] }),
            each(|j| if is_measured(j) { 0.0 } else { capped[1][j] }),
        ];
        let some = |slope: &Lanes| each(|j| if ratio[j] <= 0.0 { 0.0 } else { slope[j] });
        [some(&chosen[0]), some(&chosen[1]), some(&chosen[2])]
    }
}
