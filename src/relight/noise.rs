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
//! sphere, because events happen at the edge of what is visible and not all over it ([`ELSEWHERE`]).
//!
//! The net of points that paths are drawn from does more for low bands than for high ones: at 1024 paths the variance of a
//! coefficient of band 7 is many times that of band 0. So v_k is the mean of the variances of the bands, times 4π, by what the
//! light has in each: with E_l the energy of G_k + D_k − C in band l, v_k = 4π Σ_l s_kl² E_l / Σ_l E_l. Over the whole sphere
//! that makes σ² = Σ_kl s_kl² E_l, the variance of uncorrelated coefficients. The tail
//! belongs to G and C: the last layer brings 1 + g times its own, and because g is a ratio of chances to escape, an
//! event in them moves the whole tail, D_k = Σ ⟨T_K, G_K⟩ ∂g/∂a_k. Paths that survive all layers are one layer more, with
//! the variance of the last in proportion to their share. (The sum of a_k D_k is 0, so D is not in C.)
//!
//! Left out: the noise of emission, and correlations between the three channels (σ is that of their mean).
//!
//! # Scenes
//! Transfer in three channels obeys the same model in the mean of its channels: a_k and E_k are of the mean T̄_k,
//! G_k remains the mean of ρ^(k+1) L, and C = Σ_{k≥1} Σ_c ⟨T_k,c, G_k,c⟩/3 / (1 − a_0) has its colours. A path that walls
//! made darker counts with its weight, in a_k as in v_k, and what they absorb is among what does not escape. The ratio of
//! the tail is that of the group of emission: another estimate, so that no event moves it, and D is 0. The last layer of
//! that group is the chance to survive all layers, which a volume alone finds as 1 − Σ a_k: what walls absorb has not
//! survived.
//!
//! Each luminaire adds the variance of its own texture, Σ_k (ρ^(k+1) s σ_k)² with the tail in the last layer: its layers
//! are taken as independent of each other, luminaires as independent of the environment and among themselves. Their
//! errors come of shadow rays and cosines of their own at each vertex of a path; what they share is which
//! vertices it has. Also left out: the noise of the ratio of the tail, and that walls of colour trade one channel for
//! another.

use super::block::{LANES, Lanes};
use super::{Light, Material};
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
    // Of the layer's standard errors.
    pub(super) error_offset: usize,
    // Energy of G_k in each band above 0, over 4π.
    pub(super) energies: Vec<f32>,
    // Means over the sphere of G_k and of its square.
    pub(super) mean: f32,
    pub(super) mean_square: f32,
}

/// The weights of one contraction for the variance.
pub(super) struct NoiseWeights {
    pub(super) layers: Vec<LayerNoise>,
    // Whether paths that end elsewhere bring what all do in the mean, instead of what later layers do: in media a path whose
    // direction differs comes from another place of the same layer.
    scatters: bool,
}

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
        for (k, &bands) in layers.bands().iter().enumerate() {
            // The whole of what the layer sees of the light, not of the light: bands beyond it add nothing.
            let seen = bands.min(light.used_bands(k));
            let power: [f64; 3] = std::array::from_fn(|c| material.noise_factor(k, c));
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
            let energy = |l: usize| gain.values()[l * l..(l + 1) * (l + 1)].iter().map(|g| g * g).sum::<f64>();
            noise.push(LayerNoise {
                error_offset: layers.error_offset(k),
                energies: (1..seen).map(|l| (energy(l) / (4.0 * std::f64::consts::PI)) as f32).collect(),
                mean: gain.mean() as f32,
                mean_square: (gain.energy() / (4.0 * std::f64::consts::PI)) as f32,
            });
        }
        Self { layers: noise, scatters: material.scatters() }
    }

    /// Variance of the mean of the channels of each texel of a block, from the first coefficients of its layers, their
    /// contraction, and the columns of its standard errors.
    #[inline(always)]
    pub(super) fn variance(
        &self,
        first: &[Lanes],
        contracted: &[[Lanes; 4]],
        tail: &TailRadiance,
        stderr: &[Lanes],
    ) -> Lanes {
        let last = self.layers.len() - 1;
        let mut continued = tail.beyond;
        for [red, green, blue, _] in &contracted[1..] {
            for j in 0..LANES {
                continued[j] += mean(red[j], green[j], blue[j]);
            }
        }
        // Of all layers.
        let mut all = continued;
        let [red, green, blue, _] = &contracted[0];
        for j in 0..LANES {
            all[j] += mean(red[j], green[j], blue[j]);
        }
        let (mut continuation, mut tail_gain) = ([0.0; LANES], [0.0; LANES]);
        let [red, green, blue, _] = &contracted[last];
        for j in 0..LANES {
            let blocked = 1.0 - ROOT_FOUR_PI * first[0][j];
            let ratio = not_below_zero(continued[j] / blocked);
            continuation[j] = if self.scatters {
                all[j]
            } else if blocked > 1e-6 {
                ratio
            } else {
                0.0
            };
            let within = mean(red[j], green[j], blue[j]);
            let gain = 1.0 + not_below_zero(tail.beyond[j] / within);
            tail_gain[j] = if within > 0.0 { gain } else { 1.0 };
        }
        let mut sum = [0.0; LANES];
        for (k, layer) in self.layers.iter().enumerate() {
            let gain = if k == last { &tail_gain } else { &[1.0; LANES] };
            // K − 1 and K; with one layer there is no tail, and the slopes are 0.
            let ratio_slope = match (k + 2).checked_sub(last + 1) {
                Some(of) => &tail.ratio_slopes[of],
                None => &[0.0; LANES],
            };
            // Paths that survive all layers are of the last.
            let survival = if k == last && k > 0 { &tail.survival } else { &[0.0; LANES] };
            let [of_mean, of_rest, rest] = layer.band_variances(stderr);
            let [red, green, blue, square] = &contracted[k];
            for j in 0..LANES {
                let traded = continuation[j] - tail.slope[j] * ratio_slope[j];
                let gain = gain[j];
                let spread = |mean: f32, square: f32| {
                    not_below_zero(square * gain * gain - 2.0 * traded * mean * gain + traded * traded)
                };
                let anywhere = spread(layer.mean, layer.mean_square);
                let a = ROOT_FOUR_PI * first[k][j];
                let per_a = 1.0 / a;
                let there = spread(mean(red[j], green[j], blue[j]) * per_a, square[j] * per_a);
                let of_survivors = continuation[j] - tail.slope[j] * tail.ratio_slopes[2][j];
                let known = there + ELSEWHERE * (anywhere - there) + survival[j] * per_a * of_survivors * of_survivors;
                sum[j] += event_variance([of_mean[j], of_rest[j], rest[j]], layer.mean * gain - traded, gain)
                    * if a > NO_DIRECTIONS { known } else { anywhere };
            }
        }
        sum
    }
}

/// Mean of the channels.
#[inline(always)]
pub(super) fn mean(red: f32, green: f32, blue: f32) -> f32 {
    (red + green + blue) * (1.0 / 3.0)
}

/// x, or 0 if it is less or not a number.
#[inline(always)]
fn not_below_zero(x: f32) -> f32 {
    if x > 0.0 { x } else { 0.0 }
}

/// The tails of a block as far as their noise is concerned (means of the channels).
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

/// v of a layer, from what [`LayerNoise::band_variances`] found, what the light has in band 0, and the gain.
#[inline(always)]
pub(super) fn event_variance([of_mean, of_rest, rest]: [f32; 3], in_mean: f32, gain: f32) -> f32 {
    let (low, high) = (in_mean * in_mean, gain * gain);
    let all = low + high * rest;
    ROOT_FOUR_PI * ROOT_FOUR_PI * if all > 0.0 { (low * of_mean + high * of_rest) / all } else { of_mean }
}

impl LayerNoise {
    /// Variance of a coefficient of band 0, those of the others times the energies there, and the sum of these.
    #[inline(always)]
    fn band_variances(&self, stderr: &[Lanes]) -> [Lanes; 3] {
        let [mut of_mean, mut of_rest, mut rest] = [[0.0; LANES]; 3];
        let errors = &stderr[self.error_offset..];
        for j in 0..LANES {
            of_mean[j] = errors[0][j] * errors[0][j];
        }
        for (s, &energy) in errors[1..].iter().zip(&self.energies) {
            for j in 0..LANES {
                of_rest[j] += energy * s[j] * s[j];
                rest[j] += energy;
            }
        }
        [of_mean, of_rest, rest]
    }
}
