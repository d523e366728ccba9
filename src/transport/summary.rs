//! What a bake reports of itself: sums over texels, taken in the fixed order of the bricks.

use crate::level::Counts;
use crate::transfer::Layers;

/// Totals of a bake.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Texels asked for.
    pub texels: u64,
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
    /// Work of the tracer.
    pub counts: Counts,
    /// Σ over valid texels of the transfer vector, layer-major.
    pub transfer: Vec<f64>,
    // Where each layer starts in it.
    offsets: Vec<usize>,
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
    pub(super) fn new(layers: &Layers) -> Self {
        let offsets = (0..layers.len()).map(|k| layers.offset(k)).collect();
        Self { transfer: vec![0.0; layers.coefficients()], offsets, ..Self::default() }
    }

    /// Adds the totals of another part.
    pub fn add(&mut self, other: &Self) {
        self.texels += other.texels;
        self.valid += other.valid;
        self.clamped += other.clamped;
        self.open += other.open;
        self.degenerate += other.degenerate;
        self.paths += other.paths;
        self.lost += other.lost;
        self.trapped += other.trapped;
        self.counts += other.counts;
        self.escape_variance += other.escape_variance;
        if self.transfer.is_empty() {
            (self.transfer, self.offsets) = (other.transfer.clone(), other.offsets.clone());
        } else {
            self.transfer.iter_mut().zip(&other.transfer).for_each(|(a, b)| *a += b);
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

    /// Mean over the valid texels of the chance to survive `k` hits: 1 − Σ_{j<k} a_j.
    pub fn mean_survival(&self, k: usize) -> f64 {
        1.0 - self.mean_escapes().iter().take(k).sum::<f64>()
    }

    /// The most that layers beyond the stored ones can add to the radiance, over the brightest light, in the mean over the
    /// valid texels: ρ^(K+2) S_(K+1), K the last stored layer. It becomes an equality as ρ → 1 where all light gets out in
    /// the end. Its standard error is that of the mean of Σ_k a_k, as texels are independent.
    pub fn bound(&self, albedo: f64) -> (f64, f64) {
        let layers = self.offsets.len();
        let power = (0..layers + 1).fold(1.0, |power, _| power * albedo);
        let error = self.escape_variance.sqrt() / self.valid.max(1) as f64;
        (power * self.mean_survival(layers).max(0.0), power * error)
    }

    /// Root mean square over the valid texels of the standard error of Σ_k a_k.
    pub fn escape_stderr_rms(&self) -> f64 {
        (self.escape_variance / self.valid.max(1) as f64).sqrt()
    }
}
