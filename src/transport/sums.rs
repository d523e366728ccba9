//! From the sums of the replicates to means and standard errors, for every estimator.

use super::REPLICATES;
use super::path::{Scratch, Settings, Target, TexelEstimate};
use crate::geom::Normal;
use crate::sampling::statistics::{POOLED_BANDS, half_interval_95};
use crate::sh;
use crate::transfer::Layers;
use half::f16;
use half::slice::HalfFloatSliceExt;
use std::iter::Sum;
use std::ops::{Add, Div, Mul, Sub};

const ROOT_FOUR_PI: f32 = 3.544_907_7;

/// The numbers in which sums are taken: `f32` where every path adds the same, `f64` where paths carry weights.
pub(super) trait Real:
    Copy
    + Default
    + PartialOrd
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Sum
    + From<u8>
{
    fn sqrt(self) -> Self;
    fn as_f32(self) -> f32;
    fn as_f64(self) -> f64;
    /// As 16 bits, for storage.
    fn store(values: &[Self], out: &mut [f16]);
}

impl Real for f32 {
    fn sqrt(self) -> Self {
        self.sqrt()
    }

    fn as_f32(self) -> f32 {
        self
    }

    fn as_f64(self) -> f64 {
        f64::from(self)
    }

    fn store(values: &[Self], out: &mut [f16]) {
        out.convert_from_f32_slice(values);
    }
}

impl Real for f64 {
    fn sqrt(self) -> Self {
        self.sqrt()
    }

    fn as_f32(self) -> f32 {
        self as f32
    }

    fn as_f64(self) -> f64 {
        self
    }

    /// Cut at the largest number that 16 bits hold.
    fn store(values: &[Self], out: &mut [f16]) {
        for (out, value) in out.iter_mut().zip(values) {
            *out = f16::from_f64(value.clamp(f64::from(f16::MIN), f64::from(f16::MAX)));
        }
    }
}

/// Means and standard errors of one texture's coefficients from its replicates: `value(r, i)` is what replicate r estimates
/// of coefficient i (layer-major, then channels). Errors are those of the mean of the channels.
///
/// # The standard error of band 0
/// Four replicates of an openness give a variance with three degrees of freedom, on a lattice of few values, often 0.
/// But most of what a layer's noise is made of is that a path more or less ended in it, in some direction ω; such an
/// event changes T_lm by Y_lm(ω), and by the addition theorem the mean over m of Y_lm(ω)² is 1/4π in every band. So bands
/// 0, 1 and 2 estimate one variance from nine coefficients, and band 0 takes their mean: a variance moderated by
/// others of the same size (as Smyth 2004 does with a prior over genes), whose degrees of freedom are
/// [`crate::sampling::statistics::stored_degrees`]. Higher bands see more: what a net does to smooth
/// functions helps them less. The first `events` layers are treated so; where a path adds more than one
/// direction (the lookups of [`super::gather()`]) a band keeps its own.
pub(super) fn combine<F: Real>(
    layers: &Layers,
    events: usize,
    value: impl Fn(usize, usize) -> F,
    out: &mut TexelEstimate<F>,
) {
    out.transfer.clear();
    out.transfer.resize(layers.coefficients(), F::default());
    out.stderr.clear();
    out.stderr.resize(layers.errors(), F::default());
    let channels = layers.channels();
    // Σ_k T_k,00 of each replicate.
    let mut escapes = [F::default(); REPLICATES];
    for k in 0..layers.len() {
        let bands = layers.bands()[k];
        let mut pool = F::default();
        for l in 0..bands {
            let mut squares = F::default();
            for in_layer in l * l..(l + 1) * (l + 1) {
                let mut values = [F::default(); REPLICATES];
                for c in 0..channels {
                    let i = layers.offset(k) + c * bands * bands + in_layer;
                    let of_channel: [F; REPLICATES] = std::array::from_fn(|r| value(r, i));
                    out.transfer[i] = mean(&of_channel);
                    if channels == 1 {
                        values = of_channel;
                    } else {
                        (0..REPLICATES).for_each(|r| values[r] = values[r] + of_channel[r] / F::from(channels as u8));
                    }
                }
                if in_layer == 0 {
                    (0..REPLICATES).for_each(|r| escapes[r] = escapes[r] + values[r]);
                }
                squares = squares + variance_of_mean(&values);
            }
            out.stderr[layers.error_offset(k) + l] = (squares / F::from((2 * l + 1) as u8)).sqrt();
            if l < POOLED_BANDS {
                pool = pool + squares;
            }
        }
        if k < events {
            let pooled = bands.min(POOLED_BANDS);
            out.stderr[layers.error_offset(k)] = (pool / F::from((pooled * pooled) as u8)).sqrt();
        }
    }
    out.escape_stderr = ROOT_FOUR_PI * variance_of_mean(&escapes).sqrt().as_f32();
    out.degenerate = false;
}

/// Replicates that agree may know nothing of the error. Had a share 3/N of the directions another fate, N paths would miss it
/// with chance e⁻³ (the rule of three): so half of the interval reaches that far.
pub(super) fn defend_degenerate<F: Real + From<f32>>(layers: &Layers, paths: usize, out: &mut TexelEstimate<F>) {
    let bands = layers.bands()[0];
    let floor = F::from(3.0 / paths as f32 / half_interval_95(bands) as f32 / ROOT_FOUR_PI);
    out.degenerate = true;
    for error in &mut out.stderr[..bands.min(POOLED_BANDS)] {
        *error = if *error < floor { floor } else { *error };
    }
}

/// Largest standard error of what the target names, as [`Target`] describes it; that of Σ_k a_k without a target.
pub(super) fn target_stderr<F: Real>(layers: &Layers, target: Option<&Target>, out: &TexelEstimate<F>) -> f32 {
    match target {
        Some(target) => target.weights.iter().map(|w| stated_variance(layers, w, out)).fold(0.0, f32::max).sqrt(),
        None => stated_variance(layers, &Target::escape(layers, 0.0).weights[0], out).sqrt(),
    }
}

/// From the sums of a texel's paths to its estimate, where every path adds Y(ω) to the layer in which it escapes.
pub(super) fn combine_paths(
    normal: Normal,
    settings: &Settings,
    scratch: &Scratch,
    visible: &[u32; REPLICATES],
    points: usize,
    events: usize,
    out: &mut TexelEstimate,
) {
    let layers = &settings.layers;
    let coefficients = layers.coefficients();
    let direct = layers.bands()[0] * layers.bands()[0];
    let inverse = 1.0 / points as f32;
    let mut cosine = [0.0f32; sh::MAX_BANDS * sh::MAX_BANDS];
    let mut betas = [0.0f32; REPLICATES];
    if !settings.positive {
        clamped_cosine(layers.bands()[0], normal, &mut cosine);
        let all: u32 = visible.iter().sum();
        for r in 0..REPLICATES {
            betas[r] = (all - visible[r]) as f32 * inverse / (REPLICATES - 1) as f32;
        }
    }
    let value = |r: usize, i: usize| {
        let sum = scratch.sums[r * coefficients + i];
        let value = sum * inverse;
        if i < direct && !settings.positive {
            let all = (sum + scratch.blocked_sums[r * direct + i]) * inverse;
            value - betas[r] * (all - cosine[i])
        } else {
            value
        }
    };
    combine(layers, events, value, out);
    if visible.iter().all(|&v| v == visible[0]) {
        defend_degenerate(layers, points * REPLICATES, out);
    }
    out.target_stderr = target_stderr(layers, settings.target.as_ref(), out);
}

/// Variance of Σ w_i T_i from the stated errors, as [`Target`] describes it; T is the mean of the channels.
fn stated_variance<F: Real>(layers: &Layers, weights: &[f32], texel: &TexelEstimate<F>) -> f32 {
    let root_four_pi = std::f32::consts::PI.sqrt() * 2.0;
    let channels = layers.channels();
    // Of each layer: the first of its weights, which are those of one channel.
    let first = |k: usize| layers.offset(k) / channels;
    let escape = |k: usize| {
        let square = layers.bands()[k] * layers.bands()[k];
        let sum = (0..channels).map(|c| texel.transfer[layers.offset(k) + c * square].as_f32()).sum::<f32>();
        root_four_pi * if channels == 1 { sum } else { sum / channels as f32 }
    };
    let mean = |k: usize| weights[first(k)] / root_four_pi;
    let blocked = 1.0 - escape(0);
    let continued: f32 = (1..layers.len()).map(|k| mean(k) * escape(k)).sum();
    let continuation = if blocked > 1e-6 { continued / blocked } else { 0.0 };
    let (mut sum, mut survival, mut last) = (0.0, 1.0, 0.0);
    for k in 0..layers.len() {
        let energy: f32 = weights[first(k)..first(k) + layers.bands()[k].pow(2)].iter().map(|w| w * w).sum();
        let squared = energy / (root_four_pi * root_four_pi);
        let variance = (root_four_pi * texel.stderr[layers.error_offset(k)].as_f32()).powi(2);
        sum += variance * (squared - 2.0 * continuation * mean(k) + continuation * continuation).max(0.0);
        survival -= escape(k);
        last = if escape(k) > 1e-3 { variance / escape(k) } else { 0.0 };
    }
    sum + last * survival.max(0.0) * continuation * continuation
}

/// T of a convex body: A_l/π Y_lm(n).
pub(super) fn clamped_cosine(bands: usize, normal: Normal, out: &mut [f32]) {
    sh::basis::evaluate_f32(bands, normal.vec(), out);
    for l in 0..bands {
        let factor = (sh::CLAMPED_COSINE[l] / std::f64::consts::PI) as f32;
        for i in l * l..(l + 1) * (l + 1) {
            out[i] *= factor;
        }
    }
}

/// Mean of independent replicates, in fixed order.
fn mean<F: Real>(values: &[F; REPLICATES]) -> F {
    values.iter().copied().sum::<F>() / F::from(REPLICATES as u8)
}

/// Variance of the mean of independent replicates, in fixed order.
pub(super) fn variance_of_mean<F: Real>(values: &[F; REPLICATES]) -> F {
    let mean = mean(values);
    let squares: F = values.iter().map(|&v| (v - mean) * (v - mean)).sum();
    squares / F::from((REPLICATES * (REPLICATES - 1)) as u8)
}
