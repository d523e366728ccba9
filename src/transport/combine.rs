//! From the sums of the replicates to means and standard errors.

use super::REPLICATES;
use super::path::{Scratch, Settings, Target, TexelEstimate};
use crate::geom::Normal;
use crate::sampling::statistics::{POOLED_BANDS, half_interval_95};
use crate::sh;
use crate::transfer::Layers;

/// Means and standard errors from the sums of the replicates.
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
pub(super) fn combine(
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
    out.transfer.clear();
    out.transfer.resize(coefficients, 0.0);
    out.stderr.clear();
    out.stderr.resize(layers.errors(), 0.0);

    let mut cosine = [0.0f32; sh::MAX_BANDS * sh::MAX_BANDS];
    let mut betas = [0.0f32; REPLICATES];
    if !settings.positive {
        clamped_cosine(layers.bands()[0], normal, &mut cosine);
        let all: u32 = visible.iter().sum();
        for r in 0..REPLICATES {
            betas[r] = (all - visible[r]) as f32 * inverse / (REPLICATES - 1) as f32;
        }
    }
    // Σ_k T_k,00 of each replicate.
    let mut escapes = [0.0f32; REPLICATES];
    for k in 0..layers.len() {
        let bands = layers.bands()[k];
        let mut pool = 0.0;
        for l in 0..bands {
            let mut squares = 0.0;
            for m in 0..2 * l + 1 {
                let in_layer = l * l + m;
                let i = layers.offset(k) + in_layer;
                let mut values = [0.0f32; REPLICATES];
                for r in 0..REPLICATES {
                    let sum = scratch.sums[r * coefficients + i];
                    values[r] = sum * inverse;
                    if k == 0 && !settings.positive {
                        let all = (sum + scratch.blocked_sums[r * direct + in_layer]) * inverse;
                        values[r] -= betas[r] * (all - cosine[in_layer]);
                    }
                    if in_layer == 0 {
                        escapes[r] += values[r];
                    }
                }
                let (mean, variance_of_mean) = mean_and_variance_of_mean(&values);
                out.transfer[i] = mean;
                squares += variance_of_mean;
            }
            out.stderr[layers.error_offset(k) + l] = (squares / (2 * l + 1) as f32).sqrt();
            if l < POOLED_BANDS {
                pool += squares;
            }
        }
        if k < events {
            let pooled = bands.min(POOLED_BANDS);
            out.stderr[layers.error_offset(k)] = (pool / (pooled * pooled) as f32).sqrt();
        }
    }
    let root_four_pi = std::f32::consts::PI.sqrt() * 2.0;
    out.escape_stderr = root_four_pi * mean_and_variance_of_mean(&escapes).1.sqrt();
    out.degenerate = visible.iter().all(|&v| v == visible[0]);
    if out.degenerate {
        // Replicates that agree may know nothing of the error. Had a share 3/N of the directions another fate, N
        // paths would miss it with chance e⁻³ (the rule of three): so half of the interval reaches that far.
        let bands = layers.bands()[0];
        let floor = 3.0 / (points * REPLICATES) as f32 / half_interval_95(bands) as f32 / root_four_pi;
        for error in &mut out.stderr[..bands.min(POOLED_BANDS)] {
            *error = error.max(floor);
        }
    }
    out.target_stderr = match &settings.target {
        Some(target) => target.weights.iter().map(|w| stated_variance(layers, w, out)).fold(0.0, f32::max).sqrt(),
        None => stated_variance(layers, &Target::escape(layers, 0.0).weights[0], out).sqrt(),
    };
}

/// Variance of Σ w_i T_i from the stated errors, as [`Target`] describes it.
fn stated_variance(layers: &Layers, weights: &[f32], texel: &TexelEstimate) -> f32 {
    let root_four_pi = std::f32::consts::PI.sqrt() * 2.0;
    let escape = |k: usize| root_four_pi * texel.transfer[layers.offset(k)];
    let mean = |k: usize| weights[layers.offset(k)] / root_four_pi;
    let blocked = 1.0 - escape(0);
    let continued: f32 = (1..layers.len()).map(|k| mean(k) * escape(k)).sum();
    let continuation = if blocked > 1e-6 { continued / blocked } else { 0.0 };
    let (mut sum, mut survival, mut last) = (0.0, 1.0, 0.0);
    for k in 0..layers.len() {
        let first = layers.offset(k);
        let energy: f32 = weights[first..first + layers.bands()[k].pow(2)].iter().map(|w| w * w).sum();
        let squared = energy / (root_four_pi * root_four_pi);
        let variance = (root_four_pi * texel.stderr[layers.error_offset(k)]).powi(2);
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

/// Mean of independent replicates and the variance of that mean, in fixed order.
fn mean_and_variance_of_mean(values: &[f32; REPLICATES]) -> (f32, f32) {
    let mean = values.iter().sum::<f32>() / REPLICATES as f32;
    let squares: f32 = values.iter().map(|v| (v - mean) * (v - mean)).sum();
    (mean, squares / (REPLICATES * (REPLICATES - 1)) as f32)
}
