//! From the sums of the replicates to means and standard errors, for every estimator.

use super::REPLICATES;
use super::errors::Paths;
use super::path::{Scratch, Settings, Target, TexelEstimate};
use crate::geom::Normal;
use crate::sampling::statistics::{POOLED_BANDS, half_interval_95};
use crate::sh;
use crate::transfer::{Layers, MAX_LAYERS};
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

/// Means and standard errors of one texture's coefficients from its replicates: `value(k, r, i)` is what replicate r
/// estimates of coefficient i (layer-major, then channels), which is of layer k. Errors are those of the mean of the channels.
///
/// # The standard error of band 0
/// Four replicates of an openness give a variance with three degrees of freedom, on a lattice of few values, often 0.
/// But most of what a layer's noise is made of is that a path more or less ended in it, in some direction ω; such an
/// event changes T_lm by Y_lm(ω), and by the addition theorem the mean over m of Y_lm(ω)² is 1/4π in every band. So bands
/// 0, 1 and 2 estimate one variance from nine coefficients, and band 0 takes their mean: a variance moderated by
/// others of the same size (as Smyth 2004 does with a prior over genes), whose degrees of freedom are
/// [`crate::sampling::statistics::stored_degrees`]. Higher bands see more: what a net does to smooth
/// functions helps them less. Layer 0 is treated so, and with what [`Paths`] adds those above it up to the last of
/// `paths.events`; where a path adds more than one direction (the lookups of [`super::gather()`]) a band keeps its own.
pub(super) fn combine<F: Real + From<f32>>(
    layers: &Layers,
    paths: &Paths,
    value: impl Fn(usize, usize, usize) -> F,
    out: &mut TexelEstimate<F>,
) {
    out.transfer.clear();
    out.transfer.resize(layers.coefficients(), F::default());
    out.stderr.clear();
    out.stderr.resize(layers.errors(), F::default());
    let channels = layers.channels();
    // a_k of each replicate, over sqrt(4π), in the mean and summed over k; variances of the means, summed over the orders.
    let mut escaped = [0.0; MAX_LAYERS];
    let mut escapes = [F::default(); REPLICATES];
    let mut squares = [[0.0; sh::MAX_BANDS]; MAX_LAYERS];
    for k in 0..layers.len() {
        let bands = layers.bands()[k];
        for l in 0..bands {
            for in_layer in l * l..(l + 1) * (l + 1) {
                let mut values = [F::default(); REPLICATES];
                for c in 0..channels {
                    let i = layers.offset(k) + c * bands * bands + in_layer;
                    let of_channel: [F; REPLICATES] = std::array::from_fn(|r| value(k, r, i));
                    out.transfer[i] = mean(&of_channel);
                    if channels == 1 {
                        values = of_channel;
                    } else {
                        (0..REPLICATES).for_each(|r| values[r] = values[r] + of_channel[r] / F::from(channels as u8));
                    }
                }
                if in_layer == 0 {
                    (0..REPLICATES).for_each(|r| escapes[r] = escapes[r] + values[r]);
                    escaped[k] = f64::from(ROOT_FOUR_PI) * mean(&values).as_f64();
                }
                squares[k][l] += variance_of_mean(&values).as_f64();
            }
        }
    }
    paths.variances(layers.bands(), &escaped, &mut squares);
    for (k, &bands) in layers.bands().iter().enumerate() {
        for l in 0..bands {
            out.stderr[layers.error_offset(k) + l] = F::from(squares[k][l].sqrt() as f32);
        }
    }
    out.escape_stderr = ROOT_FOUR_PI * variance_of_mean(&escapes).sqrt().as_f32();
    out.degenerate = false;
}

/// Replicates that agree may know nothing of the error: so half of the interval is at least 1.5/N.
///
/// Had a share 3/N of the directions another fate, N paths would miss it with chance e⁻³ (the rule of three); but few texels
/// of which N paths are of one mind have so much. With 3/N intervals of a_0 covered 97 to 99.5 % of the texels at 16 paths, with
/// 1.5/N 94 to 99 %, and the mean square of the errors that texels state came down from up to 3.6 to up to 1.9 times that of
/// the true ones (without the bump box, where little is hidden: from 25 to 7).
pub(super) fn defend_degenerate<F: Real + From<f32>>(layers: &Layers, paths: usize, out: &mut TexelEstimate<F>) {
    let bands = layers.bands()[0];
    let floor = F::from(1.5 / paths as f32 / half_interval_95(bands) as f32 / ROOT_FOUR_PI);
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
    settings: &Settings,
    scratch: &Scratch,
    points: usize,
    events: usize,
    out: &mut TexelEstimate,
) {
    let layers = &settings.layers;
    let coefficients = layers.coefficients();
    let inverse = 1.0 / points as f32;
    let mut betas = [[0.0f32; 2]; REPLICATES];
    if !settings.positive {
        betas = std::array::from_fn(|r| scratch.rays.shares_of_others(r));
    }
    let value = |k: usize, r: usize, i: usize| {
        let (sum, control) = (scratch.sums[r * coefficients + i], scratch.controls[r * coefficients + i]);
        // What hits add that did not come of rays has no control.
        let beta = if k < events { betas[r][k.min(1)] } else { 0.0 };
        ((1.0 - beta) * sum - beta * control) * inverse
    };
    let paths = Paths {
        events,
        count: (points * REPLICATES) as f64,
        arrived: std::array::from_fn(|k| scratch.rays.all(k).into()),
        controlled: !settings.positive,
    };
    combine(layers, &paths, value, out);
    let visible = scratch.rays.escaped(0);
    if visible.iter().all(|&v| v == visible[0]) {
        defend_degenerate(layers, points * REPLICATES, out);
    }
    out.target_stderr = target_stderr(layers, settings.target.as_ref(), out);
}

/// Variance of Σ w_i T_i from the stated errors, as [`Target`] describes it; T is the mean of the channels.
pub(super) fn stated_variance<F: Real>(layers: &Layers, weights: &[f32], texel: &TexelEstimate<F>) -> f32 {
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
    scale_to_clamped_cosine(bands, 1.0, out);
}

/// From Σ Y(n) over normals to Σ A(n), times a factor.
pub(super) fn scale_to_clamped_cosine(bands: usize, factor: f32, out: &mut [f32]) {
    for l in 0..bands {
        let factor = factor * (sh::CLAMPED_COSINE[l] / std::f64::consts::PI) as f32;
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
