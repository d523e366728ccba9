//! What comes after the last stored layer, and emission: closed forms in the chances to escape.
//!
//! With a_k = sqrt(4π) T_k,00 the chance to escape after exactly k bounces, S_k = 1 − Σ_{j<k} a_j the
//! chance to survive k hits, and K the last stored layer, the layers beyond are taken to
//! fall geometrically, a_{K+j} = a_K r^j, with r = min(a_K/a_{K−1}, S_{K+1}/(S_{K+1}+a_K)). The second
//! term keeps Σ a ≤ 1.

/// The tail of one texel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tail {
    /// Ratio of successive layers beyond the last; 0 = no tail.
    pub ratio: f32,
    /// a_{K−1}.
    before: f32,
    /// a_K.
    last: f32,
    /// S_{K+1}, the chance to survive all stored layers.
    pub(super) survival: f32,
    // 1/a_{K−1} and 1/(S_{K+1} + a_K).
    per_before: f32,
    per_all: f32,
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
    pub(super) fn beyond(escaped: f32, before: f32, last: f32) -> Self {
        let rest = 1.0 - escaped;
        let survival = if rest > 0.0 { rest } else { 0.0 };
        let (per_before, per_all) = (1.0 / before, 1.0 / (survival + last));
        let (measured, cap) = (last * per_before, survival * per_all);
        let ratio = if measured < cap { measured } else { cap };
        let ratio = if (before > 0.0) & (last > 0.0) { ratio } else { 0.0 };
        Self { ratio, before, last, survival, per_before, per_all }
    }

    /// Factor g of the tail: beyond the last layer's ρ^(K+1)⟨T_K, L⟩ comes g times it, g = ρ r/(1 − ρ r).
    #[inline(always)]
    pub fn gain(&self, albedo: f32) -> f32 {
        self.gain_and_slope(albedo)[0]
    }

    /// The gain and its slope ∂g/∂r.
    #[inline(always)]
    pub(super) fn gain_and_slope(&self, albedo: f32) -> [f32; 2] {
        let x = albedo * self.ratio;
        let per_rest = 1.0 / (1.0 - x);
        [x * per_rest, albedo * per_rest * per_rest]
    }

    /// ∂r/∂a_{K−1}, ∂r/∂a_K and ∂r/∂S_{K+1}, each of the others held; zeros where there is no tail.
    #[inline(always)]
    pub(super) fn ratio_slopes(&self) -> [f32; 3] {
        let Self { ratio, before, last, survival, per_before, per_all } = *self;
        let is_measured = last * (survival + last) <= survival * before;
        // r/a_K of the measured ratio is 1/a_{K−1}.
        let measured = [-ratio * per_before, per_before, 0.0];
        let capped = [0.0, -survival * per_all * per_all, last * per_all * per_all];
        let mut slopes = [0.0; 3];
        for i in 0..3 {
            let slope = if is_measured { measured[i] } else { capped[i] };
            slopes[i] = if ratio > 0.0 { slope } else { 0.0 };
        }
        slopes
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
