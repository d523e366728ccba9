//! What a bake reports of itself: sums over texels, taken in the fixed order of the bricks.

use super::path::TexelEstimate;
use super::scene_path::SceneCounts;
use super::sums::Real;
use crate::level::Counts;
use crate::transfer::Layers;

/// Totals of a bake.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Texels asked for.
    pub texels: u64,
    /// Texels that an adaptive texture leaves out beside them: they are interpolated.
    pub left_out: u64,
    /// Of these, texels with a level set and a normal.
    pub valid: u64,
    /// Valid texels whose isovalue was clamped.
    pub clamped: u64,
    /// Valid texels whose rays provably cannot be blocked (or are declared not to be): in closed form, without rays.
    pub open: u64,
    /// Valid texels whose replicates all gave the same openness.
    pub degenerate: u64,
    /// Paths that the estimates are made of.
    pub paths: u64,
    /// Rays that started into the solid and did not come out; their paths go on from the same place.
    pub lost: u64,
    /// Paths still travelling after the last stored layer.
    pub trapped: u64,
    /// Work of the tracer within level sets.
    pub counts: Counts,
    /// Work among walls, luminaires and other volumes; zeros where there are none.
    pub scene: SceneCounts,
    /// Σ over valid texels of the transfer vector of the environment, the mean of its channels, layer-major.
    pub transfer: Vec<f64>,
    // Where each layer starts in it.
    offsets: Vec<usize>,
    /// Σ over valid texels of G_k of the groups after the environment (emission, then luminaires, as stored), three
    /// channels a layer; empty for a volume alone.
    pub gains: Vec<Vec<f64>>,
    /// Σ over valid texels of the variance of the estimate of Σ_k a_k.
    pub escape_variance: f64,
    /// Valid texels by the standard error of what the target names (Σ_k a_k without a target).
    pub errors: ErrorHistogram,
}

/// Counts of standard errors in bins of 1/32 of an octave, and the largest of them.
#[derive(Clone, Debug, PartialEq)]
pub struct ErrorHistogram {
    // Bin = exponent and top five bits of the mantissa, from 2^-24 up; the first bin holds what is below.
    bins: Vec<u64>,
    largest: f32,
}

/// Bits of the mantissa that tell bins apart.
const MANTISSA: u32 = 5;
/// Exponent and these bits of 2^-24 as they stand in an `f32`.
const LOWEST_BIN: u32 = (127 - 24) << MANTISSA;
const BINS: usize = 28 << MANTISSA;

impl Default for ErrorHistogram {
    fn default() -> Self {
        Self { bins: vec![0; BINS], largest: 0.0 }
    }
}

impl ErrorHistogram {
    /// Counts one error (not negative).
    pub fn add(&mut self, error: f32) {
        self.largest = self.largest.max(error);
        let bin = (error.to_bits() >> (23 - MANTISSA)).saturating_sub(LOWEST_BIN) as usize;
        self.bins[bin.min(BINS - 1)] += 1;
    }

    /// Adds the counts of another.
    pub fn merge(&mut self, other: &Self) {
        self.largest = self.largest.max(other.largest);
        for (a, b) in self.bins.iter_mut().zip(&other.bins) {
            *a += b;
        }
    }

    /// Root mean square of the errors, to 1/64 of an octave; 0 when empty.
    pub fn rms(&self) -> f64 {
        let total: u64 = self.bins.iter().sum();
        // The middle of a bin; the first holds what is below 2^-24.
        let middle = |bin: usize| {
            let edge = |bin: usize| f64::from(f32::from_bits((bin as u32 + LOWEST_BIN) << (23 - MANTISSA)));
            if bin == 0 { 0.0 } else { 0.5 * (edge(bin) + edge(bin + 1)) }
        };
        let sum: f64 = self.bins.iter().enumerate().map(|(bin, &n)| n as f64 * middle(bin).powi(2)).sum();
        (sum / total.max(1) as f64).sqrt()
    }

    /// The error that a share `q` of the counts does not exceed, rounded up by at most 1/32; 0 when empty
    /// or below 2^-24.
    pub fn quantile(&self, q: f64) -> f64 {
        let total: u64 = self.bins.iter().sum();
        let wanted = ((q * total as f64).ceil() as u64).max(1);
        let mut seen = 0;
        for (bin, &n) in self.bins.iter().enumerate() {
            seen += n;
            if seen >= wanted {
                let upper = f32::from_bits((bin as u32 + 1 + LOWEST_BIN) << (23 - MANTISSA));
                return if bin == 0 { 0.0 } else { f64::from(upper.min(self.largest)) };
            }
        }
        0.0
    }
}

impl Summary {
    /// Zeros for the textures of these layers, that of the environment first.
    pub(super) fn new(all: &[Layers]) -> Self {
        let Some((layers, others)) = all.split_first() else { return Self::default() };
        let channels = layers.channels();
        Self {
            transfer: vec![0.0; layers.coefficients() / channels],
            offsets: (0..layers.len()).map(|k| layers.offset(k) / channels).collect(),
            gains: others.iter().map(|layers| vec![0.0; layers.coefficients()]).collect(),
            ..Self::default()
        }
    }

    /// Counts the estimate of a texel, one entry a texture.
    pub(super) fn count<F: Real>(&mut self, out: &[TexelEstimate<F>], all: &[Layers], clamped: bool, open: bool) {
        let ([texel, others @ ..], [layers, ..]) = (out, all) else { return };
        self.valid += 1;
        self.open += u64::from(open);
        self.clamped += u64::from(clamped);
        self.degenerate += u64::from(texel.degenerate);
        self.paths += u64::from(texel.rays);
        self.lost += u64::from(texel.lost);
        self.trapped += u64::from(texel.trapped);
        self.escape_variance += f64::from(texel.escape_stderr).powi(2);
        self.errors.add(texel.target_stderr);
        let channels = layers.channels();
        for (k, &bands) in layers.bands().iter().enumerate() {
            let (square, first) = (bands * bands, layers.offset(k));
            for i in 0..square {
                let all = (0..channels).map(|c| texel.transfer[first + c * square + i].as_f64());
                self.transfer[self.offsets[k] + i] += all.sum::<f64>() / channels as f64;
            }
        }
        for (sums, other) in self.gains.iter_mut().zip(others) {
            sums.iter_mut().zip(&other.transfer).for_each(|(sum, value)| *sum += value.as_f64());
        }
    }

    /// Adds the work of another part, whose texels are counted elsewhere.
    pub(super) fn add_work(&mut self, other: &Self) {
        self.counts += other.counts;
        self.scene += other.scene;
    }

    /// Adds the totals of another part.
    pub fn add(&mut self, other: &Self) {
        self.texels += other.texels;
        self.left_out += other.left_out;
        self.valid += other.valid;
        self.clamped += other.clamped;
        self.open += other.open;
        self.degenerate += other.degenerate;
        self.paths += other.paths;
        self.lost += other.lost;
        self.trapped += other.trapped;
        self.add_work(other);
        self.escape_variance += other.escape_variance;
        if self.transfer.is_empty() {
            (self.transfer, self.offsets) = (other.transfer.clone(), other.offsets.clone());
            self.gains = other.gains.clone();
        } else {
            let (ours, theirs) = (self.gains.iter_mut().flatten(), other.gains.iter().flatten());
            let pairs = self.transfer.iter_mut().chain(ours).zip(other.transfer.iter().chain(theirs));
            pairs.for_each(|(a, b)| *a += b);
        }
        self.errors.merge(&other.errors);
    }

    /// Mean over the valid texels of a_k = sqrt(4π) T_k,00, the chance to escape after exactly k bounces.
    pub fn mean_escapes(&self) -> Vec<f64> {
        let factor = 2.0 * std::f64::consts::PI.sqrt() / self.valid.max(1) as f64;
        self.offsets.iter().map(|&offset| self.transfer[offset] * factor).collect()
    }

    /// Mean over the valid texels of Σ_i w_i T_i, for weights in the order of the transfer vector.
    pub fn mean_of(&self, weights: &[f32]) -> f64 {
        let sum: f64 = self.transfer.iter().zip(weights).map(|(t, &w)| t * f64::from(w)).sum();
        sum / self.valid.max(1) as f64
    }

    /// Rays lost in the solid, per path.
    pub fn lost_share(&self) -> f64 {
        self.lost as f64 / self.paths.max(1) as f64
    }

    /// Mean over the valid texels of the chance to be blocked `k` times: 1 − Σ_{j<k} a_j. Among walls and other volumes, where
    /// paths also end elsewhere, the mean weight with which the level set is met k times, largest channel.
    pub fn mean_survival(&self, k: usize) -> f64 {
        let Some(emission) = self.gains.first() else {
            return 1.0 - self.mean_escapes().iter().take(k).sum::<f64>();
        };
        let Some(before) = k.checked_sub(1) else { return 1.0 };
        let valid = self.valid.max(1) as f64;
        emission.iter().skip(3 * before).take(3).fold(0.0f64, |most, &sum| most.max(sum / valid))
    }

    /// Mean over the valid texels of what luminaire `l` brings at albedo ρ, mean of its channels, as stored.
    pub fn mean_of_luminaire(&self, l: usize, albedo: f64) -> f64 {
        let Some(gains) = self.gains.get(1 + l) else { return 0.0 };
        let of_layer = gains.chunks_exact(3).map(|layer| layer.iter().sum::<f64>() / 3.0);
        let (sum, _) = of_layer.fold((0.0, albedo), |(sum, power), gain| (sum + power * gain, power * albedo));
        sum / self.valid.max(1) as f64
    }

    /// The most that layers beyond the stored ones can add to the radiance, over the brightest light, in the mean over the
    /// valid texels: ρ^(K+2) S_(K+1), K the last stored layer. It becomes an equality as ρ → 1 where all light gets out in
    /// the end. Its standard error is that of the mean of Σ_k a_k, as texels are independent; among walls there is none.
    pub fn bound(&self, albedo: f64) -> (f64, Option<f64>) {
        let layers = self.offsets.len();
        let power = (0..layers + 1).fold(1.0, |power, _| power * albedo);
        let error = self.escape_variance.sqrt() / self.valid.max(1) as f64;
        let stated = self.gains.is_empty().then_some(power * error);
        (if layers == 0 { 0.0 } else { power * self.mean_survival(layers).max(0.0) }, stated)
    }

    /// Root mean square over the valid texels of the standard error of Σ_k a_k.
    pub fn escape_stderr_rms(&self) -> f64 {
        (self.escape_variance / self.valid.max(1) as f64).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_root_mean_square_of_a_histogram_is_that_of_its_errors() {
        let mut errors = ErrorHistogram::default();
        assert_eq!(errors.rms(), 0.0);
        [0.01, 0.01, 0.01, 0.03, 0.0].into_iter().for_each(|e| errors.add(e));
        // Bins are 1/32 of an octave wide: their middles are off by at most 1.1 %.
        let expected = ((3.0 * 0.01f64.powi(2) + 0.03f64.powi(2)) / 5.0).sqrt();
        assert!((errors.rms() / expected - 1.0).abs() < 0.011, "{} {expected}", errors.rms());
    }
}
