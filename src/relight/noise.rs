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

use super::block::{LANES, Lanes, each};
use super::{Light, Material};
use crate::sampling::statistics::POOLED_BANDS;
use crate::sh::{Coefficients, project};
use crate::transfer::Layers;
use glam::Vec4;

/// Share of the events that may come from anywhere on the sphere.
///
/// With 0 the intervals of nearly open texels are too short: what they see least of is where their noise is. Measured
/// over bowl, caffeine_density and purkinje_neuron under three skies at 64 and 256 rays, 95 % intervals cover
/// 86 to 98 % of the texels with 0, 92 to 98 % with 0.1, 94 to 99 % with 0.2.
pub(super) const ELSEWHERE: f32 = 0.125;

/// Chances to escape below this tell nothing of where: then all of the events are taken to come from anywhere.
pub(super) const NO_DIRECTIONS: f32 = 1e-3;

pub(super) const ROOT_FOUR_PI: f32 = 3.544_907_7;

/// What the events of one layer bring.
pub(super) struct LayerNoise {
    // Of the layer's coefficients, and of its standard errors.
    offset: usize,
    error_offset: usize,
    bands: usize,
    // Means over the sphere of G_k and of its square.
    pub(super) mean: f32,
    pub(super) mean_square: f32,
}

/// The weights of one contraction for the variance.
pub(super) struct NoiseWeights(pub(super) Vec<LayerNoise>);

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

    /// Variance of the mean of the channels of each texel of a block, from the columns of its transfer, its contracted
    /// layers, and the columns of its standard errors.
    #[inline(always)]
    pub(super) fn variance(
        &self,
        transfer: &[Lanes],
        contracted: &[[Lanes; 4]],
        tail: &TailRadiance,
        stderr: &[Lanes],
    ) -> Lanes {
        let last = self.0.len() - 1;
        let channels = |k: usize| {
            let [red, green, blue, _] = &contracted[k];
            each(|j| (red[j] + green[j] + blue[j]) * (1.0 / 3.0))
        };
        let mut continued = [0.0; LANES];
        for k in 1..=last {
            let more = channels(k);
            continued = each(|j| continued[j] + more[j]);
        }
        let first = &transfer[self.0[0].offset];
        let continuation = each(|j| {
            let blocked = 1.0 - ROOT_FOUR_PI * first[j];
            let ratio = ((continued[j] + tail.beyond[j]) / blocked).max(0.0);
            if blocked > 1e-6 { ratio } else { 0.0 }
        });
        let within_last = channels(last);
        let tail_gain = each(|j| {
            let gain = 1.0 + (tail.beyond[j] / within_last[j]).max(0.0);
            if within_last[j] > 0.0 { gain } else { 1.0 }
        });
        let mut sum = [0.0; LANES];
        for (k, layer) in self.0.iter().enumerate() {
            let gain = if k == last { tail_gain } else { [1.0; LANES] };
            // K − 1 and K; with one layer there is no tail, and the slopes are 0.
            let shift = match (k + 2).checked_sub(last + 1) {
                Some(of) => each(|j| tail.slope[j] * tail.ratio_slopes[of][j]),
                None => [0.0; LANES],
            };
            let variance = layer.event_variance(stderr);
            let (escape, mean, square) = (&transfer[layer.offset], channels(k), &contracted[k][3]);
            let beyond = k == last && k > 0;
            sum = each(|j| {
                let traded = continuation[j] - shift[j];
                let spread = |mean: f32, square: f32| {
                    (square * gain[j] * gain[j] - 2.0 * traded * mean * gain[j] + traded * traded).max(0.0)
                };
                let anywhere = spread(layer.mean, layer.mean_square);
                let a = ROOT_FOUR_PI * escape[j];
                let there = spread(mean[j] / a, square[j] / a);
                let known = variance[j] * (there + ELSEWHERE * (anywhere - there));
                let unknown = variance[j] * anywhere;
                let traded = continuation[j] - tail.slope[j] * tail.ratio_slopes[2][j];
                let survivors = variance[j] * (tail.survival[j] / a) * traded * traded;
                let known = if beyond { (sum[j] + known) + survivors } else { sum[j] + known };
                if a > NO_DIRECTIONS { known } else { sum[j] + unknown }
            });
        }
        sum
    }
}

/// The tails of a block as far as their noise is concerned (means of the channels).
#[derive(Clone, Copy)]
pub(super) struct TailRadiance {
    /// Radiance beyond the last layer.
    pub(super) beyond: Lanes,
    /// Its slope in the ratio of the tail.
    pub(super) slope: Lanes,
    /// Slopes of the ratio in a_{K−1}, a_K and S_{K+1}.
    pub(super) ratio_slopes: [Lanes; 3],
    /// S_{K+1}.
    pub(super) survival: Lanes,
}

impl TailRadiance {
    /// No tail.
    pub(super) const NONE: Self =
        Self { beyond: [0.0; LANES], slope: [0.0; LANES], ratio_slopes: [[0.0; LANES]; 3], survival: [0.0; LANES] };
}

impl LayerNoise {
    /// Variance of a_k from events, out of the bands that share it.
    #[inline(always)]
    fn event_variance(&self, stderr: &[Lanes]) -> Lanes {
        let bands = self.bands.min(POOLED_BANDS);
        let mut sum = [0.0; LANES];
        for (l, s) in stderr[self.error_offset..][..bands].iter().enumerate() {
            sum = each(|j| sum[j] + (2 * l + 1) as f32 * s[j] * s[j]);
        }
        each(|j| ROOT_FOUR_PI * ROOT_FOUR_PI * sum[j] / (bands * bands) as f32)
    }
}
