//! What a bake reports of itself: sums over texels, taken in the fixed order of the bricks.

use crate::level::Counts;

/// Totals of a bake.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Summary {
    /// Texels asked for.
    pub texels: u64,
    /// Of these, texels with a level set and a normal.
    pub valid: u64,
    /// Valid texels whose isovalue was clamped.
    pub clamped: u64,
    /// Valid texels whose replicates all gave the same openness.
    pub degenerate: u64,
    /// Paths that the estimates are made of.
    pub paths: u64,
    /// Paths of the pilots of texels with a target, traced beside these.
    pub pilot_paths: u64,
    /// Rays that started into the solid and did not come out; their paths go on from the same place.
    pub lost: u64,
    /// Paths still travelling after the last stored layer.
    pub trapped: u64,
    /// Work of the tracer.
    pub counts: Counts,
    /// Σ over valid texels of a_k = sqrt(4π) T_k,00, the chance to escape after exactly k bounces.
    pub escapes: Vec<f64>,
    /// Σ over valid texels of the variance of the estimate of Σ_k a_k.
    pub escape_variance: f64,
    /// Valid texels by the standard error of what the target names (Σ_k a_k without a target).
    pub errors: ErrorHistogram,
}

/// Counts of standard errors in bins of an eighth of an octave.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ErrorHistogram {
    // Bin = exponent and top three bits of the mantissa, from 2^-24 up; the first bin holds what is below.
    bins: Vec<u64>,
}

/// Exponent and three bits of mantissa of 2^-24 as they stand in an `f32`.
const LOWEST_BIN: u32 = (127 - 24) << 3;
const BINS: usize = 8 * 28;

impl Default for ErrorHistogram {
    fn default() -> Self {
        Self { bins: vec![0; BINS] }
    }
}

impl ErrorHistogram {
    /// Counts one error (not negative).
    pub fn add(&mut self, error: f32) {
        let bin = (error.to_bits() >> 20).saturating_sub(LOWEST_BIN) as usize;
        self.bins[bin.min(BINS - 1)] += 1;
    }

    /// Adds the counts of another.
    pub fn merge(&mut self, other: &Self) {
        for (a, b) in self.bins.iter_mut().zip(&other.bins) {
            *a += b;
        }
    }

    /// The error that a share `q` of the counts does not exceed, rounded up by at most an eighth; 0 when empty
    /// or below 2^-24.
    pub fn quantile(&self, q: f64) -> f64 {
        let total: u64 = self.bins.iter().sum();
        let wanted = ((q * total as f64).ceil() as u64).max(1);
        let mut seen = 0;
        for (bin, &n) in self.bins.iter().enumerate() {
            seen += n;
            if seen >= wanted {
                let upper = f32::from_bits((bin as u32 + 1 + LOWEST_BIN) << 20);
                return if bin == 0 { 0.0 } else { f64::from(upper) };
            }
        }
        0.0
    }
}

impl Summary {
    pub(super) fn new(layers: usize) -> Self {
        Self { escapes: vec![0.0; layers], ..Self::default() }
    }

    /// Adds the totals of another part.
    pub fn add(&mut self, other: &Self) {
        self.texels += other.texels;
        self.valid += other.valid;
        self.clamped += other.clamped;
        self.degenerate += other.degenerate;
        self.paths += other.paths;
        self.pilot_paths += other.pilot_paths;
        self.lost += other.lost;
        self.trapped += other.trapped;
        self.counts += other.counts;
        self.escape_variance += other.escape_variance;
        self.escapes.resize(self.escapes.len().max(other.escapes.len()), 0.0);
        for (a, b) in self.escapes.iter_mut().zip(&other.escapes) {
            *a += b;
        }
        self.errors.merge(&other.errors);
    }

    /// Mean over the valid texels of the chance to escape after exactly k bounces.
    pub fn mean_escapes(&self) -> Vec<f64> {
        self.escapes.iter().map(|a| a / (self.valid.max(1)) as f64).collect()
    }

    /// Rays lost in the solid, per path.
    pub fn lost_share(&self) -> f64 {
        self.lost as f64 / self.paths.max(1) as f64
    }

    /// Mean over the valid texels of the chance to survive `k` hits: 1 − Σ_{j<k} a_j.
    pub fn mean_survival(&self, k: usize) -> f64 {
        1.0 - self.mean_escapes().iter().take(k).sum::<f64>()
    }

    /// Root mean square over the valid texels of the standard error of Σ_k a_k.
    pub fn escape_stderr_rms(&self) -> f64 {
        (self.escape_variance / self.valid.max(1) as f64).sqrt()
    }
}
