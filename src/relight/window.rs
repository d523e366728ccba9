//! Light made ready for the layers of a transfer: cut at each layer's band limit, and windowed for it.
//!
//! A window belongs to a band limit. Light that is certified non-negative with five bands may be
//! negative again once it is cut to three, so each layer gets the window of its own limit; then every
//! layer is ≥ 0 wherever its transfer is a combination of Y(ω) with weights ≥ 0.

use super::Light;
use crate::error::{Error, Result};
use crate::sh::Coefficients;
use crate::sh::certified::{bounds, certify};
use crate::sh::kernel::{Kept, Window};
use crate::transfer::Layers;

/// What the window did to the light of one layer.
#[derive(Clone, Debug, PartialEq)]
pub struct LayerWindow {
    /// Bands of the light that the layer sees.
    pub bands: usize,
    /// One factor a band.
    pub factors: Vec<f64>,
    /// How far a certified window goes, see [`crate::sh::certified::Certified::blend`]; `None` for others.
    pub blend: Option<f64>,
    /// Energy and contrast kept, of all channels together, against the light cut at the same limit.
    pub kept: Kept,
    /// Smallest radiance of any channel over the sphere, from below by a proven bound, in units of that
    /// channel's mean (0 for a black one).
    pub floor: f64,
}

/// A light ready to be contracted, with what was done to it.
#[derive(Clone, Debug, PartialEq)]
pub struct Prepared {
    /// The light, one set of coefficients a layer.
    pub light: Light,
    /// One entry a layer.
    pub windows: Vec<LayerWindow>,
}

impl Prepared {
    /// The layer whose window took most of the contrast.
    pub fn least_kept(&self) -> &LayerWindow {
        let mut least = &self.windows[0];
        for window in &self.windows {
            if window.kept.contrast < least.kept.contrast {
                least = window;
            }
        }
        least
    }
}

/// Cuts light in world axes to the band limit of each layer and windows it there.
///
/// With [`Window::Certified`] every layer's light is proven ≥ 0 over the whole sphere, by a margin that
/// also covers single precision: T·L stays ≥ 0 when T = Σ w_j Y(ω_j), w_j ≥ 0, and the product are
/// computed in f32 (`single_precision_margin`).
///
/// # Errors
/// A coefficient that is not finite; with [`Window::Certified`] a channel with a negative mean.
pub fn prepare(light: &[Coefficients; 3], layers: &Layers, window: Window) -> Result<Prepared> {
    let mut sets: Vec<[Coefficients; 3]> = Vec::with_capacity(layers.len());
    let mut windows: Vec<LayerWindow> = Vec::with_capacity(layers.len());
    for (k, &bands) in layers.bands().iter().enumerate() {
        if let Some(done) = (0..k).find(|&j| layers.bands()[j] == bands) {
            sets.push(sets[done].clone());
            windows.push(windows[done].clone());
            continue;
        }
        let (set, report) = prepare_layer(light, bands, window)?;
        sets.push(set);
        windows.push(report);
    }
    Ok(Prepared { light: Light::per_layer(&sets)?, windows })
}

fn prepare_layer(
    channels: &[Coefficients; 3],
    bands: usize,
    window: Window,
) -> Result<([Coefficients; 3], LayerWindow)> {
    if channels.iter().any(|c| c.values().iter().any(|v| !v.is_finite())) {
        return Err(Error::argument(
            "environment",
            "a coefficient that is not finite",
            "finite coefficients",
            "project the probe again",
        ));
    }
    let bands = channels.iter().map(Coefficients::bands).max().unwrap_or(1).min(bands);
    let cut: [Coefficients; 3] = std::array::from_fn(|c| channels[c].truncated(bands).extended(bands));
    let (factors, blend) = match window.factors(bands) {
        Some(factors) => (factors, None),
        None => {
            let certified = certify(&cut)?;
            let margin = cut.iter().map(|c| single_precision_margin(&c.filtered(&certified.factors)));
            let keep = 1.0 - margin.fold(0.0, f64::max);
            let keep = |(l, f): (usize, &f64)| if l == 0 { *f } else { f * keep };
            (certified.factors.iter().enumerate().map(keep).collect(), Some(certified.blend))
        }
    };
    let set: [Coefficients; 3] = std::array::from_fn(|c| cut[c].filtered(&factors));
    let floor = set.iter().map(|c| if c.mean() > 0.0 { bounds(c).0 / c.mean() } else { 0.0 });
    let floor = floor.fold(f64::INFINITY, f64::min);
    let kept = kept_together(&set, &cut);
    Ok((set, LayerWindow { bands, factors, blend, kept, floor }))
}

/// δ such that light blended by δ with its mean gives T·L ≥ 0 in f32.
///
/// For T = Σ w_j Y(ω_j) with Σ w_j = a, exact arithmetic gives T·L ≥ a min L, and rounding takes at most
/// ε Σ|T_i L_i| ≤ ε ‖T‖ ‖L‖ ≤ ε a (n/sqrt(4π)) ‖L‖ (addition theorem: ‖Y(ω)‖ = n/sqrt(4π)). Blending
/// makes min L ≥ δ·mean, so δ = ε (n/sqrt(4π)) ‖L‖/mean suffices. ε counts roundings of 2⁻²⁴: n² of the
/// product and its running sum, and 32 for the basis and the direction's own rounding (degree ≤ 10).
/// For light ≥ 0, ‖L‖ ≤ sqrt(4π) n·mean, so δ ≤ ε n²: 9e-5 for 5 bands, 1e-3 for 11.
fn single_precision_margin(light: &Coefficients) -> f64 {
    let mean = light.mean();
    let n = light.bands() as f64;
    if mean <= 0.0 || light.contrast() == 0.0 {
        return 0.0;
    }
    let epsilon = (n * n + 32.0) / f64::from(1u32 << 24);
    (epsilon * n / (4.0 * std::f64::consts::PI).sqrt() * light.energy().sqrt() / mean).min(1.0)
}

/// As [`crate::sh::kernel::kept`], of three channels as one light.
fn kept_together(filtered: &[Coefficients; 3], original: &[Coefficients; 3]) -> Kept {
    let sum = |set: &[Coefficients; 3], part: fn(&Coefficients) -> f64| set.iter().map(part).sum::<f64>();
    let share = |part: fn(&Coefficients) -> f64| {
        let whole = sum(original, part);
        if whole > 0.0 { sum(filtered, part) / whole } else { 1.0 }
    };
    Kept { energy: share(Coefficients::energy), contrast: share(Coefficients::contrast) }
}

#[cfg(test)]
mod tests;
