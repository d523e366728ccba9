//! Zonal kernels: one factor a band, applied by [`Coefficients::filtered`].

use super::{CLAMPED_COSINE, Coefficients, MAX_BANDS};
use std::f64::consts::PI;

/// A window that tames the ringing of a cut series.
///
/// Windowing is not deringing: the habitual windows bound nothing (a delta sun at degree 2 has a
/// deeper minimum under Hann than under no window). Only [`Window::Certified`] promises a
/// function that is nowhere negative; its factors depend on the light and come from
/// [`super::certified::certify`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Window {
    /// No window.
    #[default]
    None,
    /// Lanczos: sinc(π l / width).
    Lanczos,
    /// Hann (raised cosine): (1 + cos(π l / width))/2.
    Hanning,
    /// Non-negative by construction and proof.
    Certified,
}

impl Window {
    /// The name used on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Lanczos => "lanczos",
            Self::Hanning => "hanning",
            Self::Certified => "certified",
        }
    }

    /// The factors of `bands` bands, window width = `bands` (so that the first band that is cut
    /// has factor 0); `None` for [`Window::Certified`], which needs the light.
    pub fn factors(self, bands: usize) -> Option<Vec<f64>> {
        let angle = |l: usize| PI * l as f64 / bands as f64;
        match self {
            Self::None => Some(vec![1.0; bands]),
            Self::Lanczos => {
                Some((0..bands).map(|l| if l == 0 { 1.0 } else { libm::sin(angle(l)) / angle(l) }).collect())
            }
            Self::Hanning => Some((0..bands).map(|l| 0.5 + 0.5 * libm::cos(angle(l))).collect()),
            Self::Certified => None,
        }
    }
}

/// What a window kept of a function.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kept {
    /// Share of the energy of all bands, 0…1 for a window with factors in [−1, 1].
    pub energy: f64,
    /// Share of the energy of the bands above the constant: how much of the light's
    /// unevenness is left. 1 if there was none.
    pub contrast: f64,
}

/// Compares a filtered function with the original; shares of nothing count as 1.
pub fn kept(filtered: &Coefficients, original: &Coefficients) -> Kept {
    let share = |part: f64, whole: f64| if whole > 0.0 { part / whole } else { 1.0 };
    Kept {
        energy: share(filtered.energy(), original.energy()),
        contrast: share(filtered.contrast(), original.contrast()),
    }
}

/// Irradiance on an unoccluded surface as a function of its normal, E(n) = ∫ L (n·ω)⁺ dω:
/// the light convolved with the clamped cosine.
#[must_use]
pub fn irradiance(light: &Coefficients) -> Coefficients {
    light.filtered(&CLAMPED_COSINE[..light.bands().min(MAX_BANDS)])
}

#[cfg(test)]
mod tests;
