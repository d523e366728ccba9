//! How the noise of a bake shows in the radiance of a texel.
//!
//! A store holds one standard error for each layer and band, no correlations; and correlations are what matters. A
//! path that ends in one layer does not end in another, so a texel that by chance sees too much of the sky in layer 0
//! sees too little of it in those that follow; and an error of T_0 adds light from one direction to all bands at once.
//! Taking the coefficients as uncorrelated overstates the variance of radiance under a sky: see the column of that
//! name of `measure-coverage`.
//!
//! Instead the noise is taken for what it is: paths that by chance end elsewhere. Let v_k be the variance of a_k from
//! such events, G_k(ω) what a path that leaves in layer k along ω brings (ρ^(k+1) L, mean over the channels), and
//! C = Σ_{k≥1} ⟨T_k, G_k⟩/(1 − a_0) what a path that met the surface brings in the mean. An event trades the one for
//! the other:
//!
//! σ² = Σ_k v_k · E_k[(G_k + D_k − C)²].
//!
//! The mean over directions E_k is that over the escaping ones, E_k[f] = ⟨T_k, f⟩/a_k, defended by the mean over the
//! sphere, because events happen at the edge of what is visible and not all over it ([`ELSEWHERE`]). The tail
//! belongs to G and C: the last layer brings 1 + g times its own, and because g is a ratio of chances to escape, an
//! event in them moves the whole tail, D_k = Σ ⟨T_K, G_K⟩ ∂g/∂a_k. Paths that survive all layers are one layer more, with
//! the variance of the last in proportion to their share. (The sum of a_k D_k is 0, so D is not in C.)
//!
//! Left out: the noise of emission, and correlations between the three channels (σ is that of their mean).

use super::{Light, Material};
use crate::sampling::statistics::POOLED_BANDS;
use crate::sh::{Coefficients, project};
use crate::transfer::Layers;
use glam::Vec4;
use half::f16;

/// Share of the events that may come from anywhere on the sphere.
///
/// With 0 the intervals of nearly open texels are too short: what they see least of is where their noise is. Measured
/// over bowl, caffeine_density and purkinje_neuron under three skies at 64 and 256 rays, 95 % intervals cover
/// 86 to 98 % of the texels with 0, 92 to 98 % with 0.1, 94 to 99 % with 0.2.
const ELSEWHERE: f32 = 0.125;

/// Chances to escape below this tell nothing of where: then all of the events are taken to come from anywhere.
const NO_DIRECTIONS: f32 = 1e-3;

const ROOT_FOUR_PI: f32 = 3.544_907_7;

/// What the events of one layer bring.
struct LayerNoise {
    // Of the layer's coefficients, and of its standard errors.
    offset: usize,
    error_offset: usize,
    bands: usize,
    // Means over the sphere of G_k and of its square.
    mean: f32,
    mean_square: f32,
}

/// The weights of one contraction for the variance.
pub(super) struct NoiseWeights(Vec<LayerNoise>);

impl NoiseWeights {
    /// Also writes the coefficients of G_k² into the fourth lane of `rows`, whose others hold ρ^(k+1) L, and the
    /// bands that they reach into `reached`.
    pub(super) fn new(
        layers: &Layers,
        light: &Light,
        material: &Material,
        rows: &mut [Vec4],
        reached: &mut [usize],
    ) -> Self {
        let mut noise = Vec::with_capacity(layers.len());
        let mut power = material.albedo.map(f64::from);
        for (k, &bands) in layers.bands().iter().enumerate() {
            // The whole of what the layer sees of the light, not of the light: bands beyond it add nothing.
            let seen = bands.min(light.used_bands(k));
            let mut gain = Coefficients::zero(seen);
            for (to, from) in gain.values_mut().iter_mut().zip(light.coefficients(k)) {
                *to = (0..3).map(|c| power[c] * from[c]).sum::<f64>() / 3.0;
            }
            let degree = 2 * (seen - 1);
            let square_bands = bands.min(degree + 1);
            let square =
                project::project(square_bands, degree + square_bands, |direction| gain.evaluate(direction).powi(2));
            for (row, &value) in rows[layers.offset(k)..].iter_mut().zip(square.values()) {
                row.w = value as f32;
            }
            reached[k] = reached[k].max(square_bands);
            noise.push(LayerNoise {
                offset: layers.offset(k),
                error_offset: layers.error_offset(k),
                bands,
                mean: gain.mean() as f32,
                mean_square: (gain.energy() / (4.0 * std::f64::consts::PI)) as f32,
            });
            for c in 0..3 {
                power[c] *= f64::from(material.albedo[c]);
            }
        }
        Self(noise)
    }

    /// Variance of the mean of the channels of a texel, from its contracted layers.
    pub(super) fn variance(&self, transfer: &[f32], contracted: &[Vec4], tail: &TailRadiance, stderr: &[f16]) -> f32 {
        let channels = |k: usize| (contracted[k].x + contracted[k].y + contracted[k].z) * (1.0 / 3.0);
        let escape = |k: usize| ROOT_FOUR_PI * transfer[self.0[k].offset];
        let last = self.0.len() - 1;
        let blocked = 1.0 - escape(0);
        let continued = (1..=last).map(channels).sum::<f32>() + tail.beyond;
        let continuation = if blocked > 1e-6 { (continued / blocked).max(0.0) } else { 0.0 };
        let within_last = channels(last);
        let tail_gain = if within_last > 0.0 { 1.0 + (tail.beyond / within_last).max(0.0) } else { 1.0 };
        let mut sum = 0.0;
        for (k, layer) in self.0.iter().enumerate() {
            let gain = if k == last { tail_gain } else { 1.0 };
            // K − 1 and K; with one layer there is no tail, and the slopes are 0.
            let shift = if k + 2 > last { tail.slope * tail.ratio_slopes[k + 1 - last] } else { 0.0 };
            let traded = continuation - shift;
            let spread =
                |mean: f32, square: f32| (square * gain * gain - 2.0 * traded * mean * gain + traded * traded).max(0.0);
            let anywhere = spread(layer.mean, layer.mean_square);
            let a = escape(k);
            let variance = layer.event_variance(stderr);
            if a > NO_DIRECTIONS {
                let there = spread(channels(k) / a, contracted[k].w / a);
                sum += variance * (there + ELSEWHERE * (anywhere - there));
                if k == last && k > 0 {
                    let traded = continuation - tail.slope * tail.ratio_slopes[2];
                    sum += variance * (tail.survival / a) * traded * traded;
                }
            } else {
                sum += variance * anywhere;
            }
        }
        sum
    }
}

/// The tail of a texel as far as its noise is concerned (means of the channels).
#[derive(Clone, Copy, Default)]
pub(super) struct TailRadiance {
    /// Radiance beyond the last layer.
    pub(super) beyond: f32,
    /// Its slope in the ratio of the tail.
    pub(super) slope: f32,
    /// Slopes of the ratio in a_{K−1}, a_K and S_{K+1}.
    pub(super) ratio_slopes: [f32; 3],
    /// S_{K+1}.
    pub(super) survival: f32,
}

impl LayerNoise {
    /// Variance of a_k from events, out of the bands that share it.
    fn event_variance(&self, stderr: &[f16]) -> f32 {
        let bands = self.bands.min(POOLED_BANDS);
        let mut sum = 0.0;
        for (l, s) in stderr[self.error_offset..][..bands].iter().enumerate() {
            let s = s.to_f32();
            sum += (2 * l + 1) as f32 * s * s;
        }
        ROOT_FOUR_PI * ROOT_FOUR_PI * sum / (bands * bands) as f32
    }
}
