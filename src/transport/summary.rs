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
    /// Paths traced.
    pub paths: u64,
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
    /// Count of valid texels by standard error of Σ_k a_k: bin b holds [b, b+1)/1000, the last the rest.
    pub escape_stderr_histogram: Vec<u64>,
}

/// Bins of [`Summary::escape_stderr_histogram`].
pub(super) const ERROR_BINS: usize = 501;

impl Summary {
    pub(super) fn new(layers: usize) -> Self {
        Self { escapes: vec![0.0; layers], escape_stderr_histogram: vec![0; ERROR_BINS], ..Self::default() }
    }

    /// Adds the totals of another part.
    pub fn add(&mut self, other: &Self) {
        self.texels += other.texels;
        self.valid += other.valid;
        self.clamped += other.clamped;
        self.degenerate += other.degenerate;
        self.paths += other.paths;
        self.lost += other.lost;
        self.trapped += other.trapped;
        self.counts += other.counts;
        self.escape_variance += other.escape_variance;
        self.escapes.resize(self.escapes.len().max(other.escapes.len()), 0.0);
        for (a, b) in self.escapes.iter_mut().zip(&other.escapes) {
            *a += b;
        }
        self.escape_stderr_histogram.resize(ERROR_BINS, 0);
        for (a, b) in self.escape_stderr_histogram.iter_mut().zip(&other.escape_stderr_histogram) {
            *a += b;
        }
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

    /// The standard error of Σ_k a_k below which a share `q` of the valid texels lies, to 0.001 upward.
    pub fn escape_stderr_quantile(&self, q: f64) -> f64 {
        let wanted = (q * self.valid as f64).ceil() as u64;
        let mut seen = 0;
        for (bin, &n) in self.escape_stderr_histogram.iter().enumerate() {
            seen += n;
            if seen >= wanted {
                return (bin + 1) as f64 / 1000.0;
            }
        }
        f64::INFINITY
    }
}
