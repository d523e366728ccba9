//! Contraction of a scene's textures: environment in three channels, one texture a luminaire, and the level set's own light.

use super::contract::{Contracted, NO_BRICK, NO_LEVEL_SET, Noise, UNBAKED};
use super::{Light, Material};
use crate::error::{Error, Result};
use crate::transfer::{BRICK_TEXELS, BrickSource, BrickView, Layers, MAX_LAYERS, validity};
use half::f16;
use rayon::prelude::*;

/// A luminaire's texture and the factor on what it holds: that of its storage (2^exponent) times that on its power.
#[derive(Clone, Copy)]
pub struct LuminaireLight<'a> {
    /// G_k, see [`crate::transfer::Group`].
    pub texture: &'a dyn BrickSource,
    /// For red, green and blue.
    pub factor: [f64; 3],
}

/// What does not change from texel to texel.
struct SceneWeights {
    layers: Layers,
    // ρ^(k+1) of each layer and channel.
    powers: Vec<[f64; 3]>,
    // ρ^(k+1) L_i, laid out as the coefficients of a texel.
    light: Vec<f32>,
    // Squares of the mean over the channels of ρ^(k+1) L_i, summed over the orders of a band; as the errors of a texel.
    light_variance: Vec<f32>,
    material: Material,
}

/// Multiplies the textures of a scene with its lights: Σ_k ρ^(k+1) (⟨T_k, L⟩ + Σ_l s_l G_k,l), and the emission Le of the
/// level set as 1 + Σ_k ρ^(k+1) G_k of its own group.
///
/// Layers beyond the last one K are taken to fall as the chance to meet the level set again does,
/// r = G_K/G_(K−1) of the group of emission (at most 1): what the last layer brings is repeated ρ r/(1 − ρ r) times. Where
/// ρ r = 1 there is no end and no tail. A single layer has none.
///
/// Standard errors are put together as if those of layers, bands and luminaires were independent.
///
/// # Errors
/// Those of the sources; textures that are not those of one scene.
pub fn contract_scene(
    environment: &dyn BrickSource,
    emission: &dyn BrickSource,
    luminaires: &[LuminaireLight<'_>],
    bricks: &[[usize; 3]],
    light: &Light,
    material: &Material,
) -> Result<Contracted> {
    let layout = environment.layout();
    let of_group = |source: &dyn BrickSource| {
        let other = source.layout();
        let same = other.lattice == layout.lattice && other.layers.len() == layout.layers.len();
        same && other.layers.channels() == 3 && other.layers.max_bands() == 1
    };
    let all_fit = layout.layers.channels() == 3 && of_group(emission) && luminaires.iter().all(|l| of_group(l.texture));
    if !all_fit {
        let remedy = "take all of them from one store of a scene";
        return Err(Error::argument("textures", "different layouts", "the textures of one scene", remedy));
    }
    let weights = SceneWeights::new(&layout.layers, light, material);
    let [bx, by, bz] = layout.lattice.bricks();
    let mut slots = vec![NO_BRICK; bx * by * bz];
    for (slot, b) in bricks.iter().enumerate() {
        slots[b[0] + bx * (b[1] + by * b[2])] = slot as u32;
    }
    let mut radiance = vec![[[0.0, 0.0, 0.0, UNBAKED]; BRICK_TEXELS]; bricks.len()];
    let totals = radiance
        .par_iter_mut()
        .zip(bricks)
        .map(|(out, &index)| {
            let (Some(of_environment), Some(of_emission)) = (environment.brick(index)?, emission.brick(index)?) else {
                return Ok([0.0; 4]);
            };
            let mut of_luminaires = Vec::with_capacity(luminaires.len());
            for l in luminaires {
                let Some(view) = l.texture.brick(index)? else { return Ok([0.0; 4]) };
                of_luminaires.push((view, l.factor));
            }
            Ok(weights.brick(&of_environment, &of_emission, &of_luminaires, out))
        })
        .collect::<Result<Vec<[f64; 4]>>>()?;
    let mut sum = [0.0f64; 4];
    for t in totals {
        (0..3).for_each(|i| sum[i] += t[i]);
        sum[3] = sum[3].max(t[3]);
    }
    let n = sum[2].max(1.0);
    let noise = Noise { rms: (sum[0] / n).sqrt(), mean_radiance: sum[1] / n, texels: sum[2] as u64 };
    Ok(Contracted { lattice: layout.lattice, slots, radiance, noise, emission_remainder: sum[3] as f32 })
}

impl SceneWeights {
    fn new(layers: &Layers, light: &Light, material: &Material) -> Self {
        let mut powers = Vec::with_capacity(layers.len());
        let mut power = material.albedo.map(f64::from);
        let mut weights = vec![0.0; layers.coefficients()];
        let mut light_variance = vec![0.0; layers.errors()];
        for (k, &bands) in layers.bands().iter().enumerate() {
            let reached = bands.min(light.used_bands(k));
            for i in 0..reached * reached {
                let of_light = light.coefficients(k)[i];
                let mut mean = 0.0;
                for c in 0..3 {
                    let w = power[c] * of_light[c];
                    weights[layers.offset(k) + c * bands * bands + i] = w as f32;
                    mean += w / 3.0;
                }
                light_variance[layers.error_offset(k) + i.isqrt()] += (mean * mean) as f32;
            }
            powers.push(power);
            (0..3).for_each(|c| power[c] *= f64::from(material.albedo[c]));
        }
        Self { layers: layers.clone(), powers, light: weights, light_variance, material: *material }
    }

    /// Fills the texels of a brick; sums of variance, radiance and number of texels, and the largest remainder.
    fn brick(
        &self,
        environment: &BrickView<'_>,
        emission: &BrickView<'_>,
        luminaires: &[(BrickView<'_>, [f64; 3])],
        out: &mut [[f32; 4]],
    ) -> [f64; 4] {
        let layers = &self.layers;
        let (count, coefficients, bands) = (layers.len(), layers.coefficients(), layers.errors());
        let mut totals = [0.0; 4];
        for (t, out) in out.iter_mut().enumerate() {
            let transfer = &environment.transfer[t * coefficients..(t + 1) * coefficients];
            if environment.validity[t] & validity::VALID == 0 {
                *out = [0.0, 0.0, 0.0, if transfer[0].is_nan() { UNBAKED } else { NO_LEVEL_SET }];
                continue;
            }
            // What each layer brings, with its albedo.
            let mut brought = [[0.0f64; 3]; MAX_LAYERS];
            let mut variance = 0.0f64;
            for (k, layer) in brought.iter_mut().enumerate().take(count) {
                let square = layers.bands()[k] * layers.bands()[k];
                for (c, channel) in layer.iter_mut().enumerate() {
                    let first = layers.offset(k) + c * square;
                    let pairs = transfer[first..first + square].iter().zip(&self.light[first..first + square]);
                    *channel = pairs.map(|(t, w)| f64::from(t.to_f32()) * f64::from(*w)).sum();
                }
            }
            for (stderr, weight) in environment.stderr[t * bands..(t + 1) * bands].iter().zip(&self.light_variance) {
                variance += f64::from(stderr.to_f32()).powi(2) * f64::from(*weight);
            }
            let at =
                |view: &BrickView<'_>, k: usize, c: usize| f64::from(view.transfer[(t * count + k) * 3 + c].to_f32());
            for (view, factor) in luminaires {
                for k in 0..count {
                    let mut mean = 0.0;
                    for c in 0..3 {
                        let weight = self.powers[k][c] * factor[c];
                        brought[k][c] += weight * at(view, k, c);
                        mean += weight / 3.0;
                    }
                    variance += (mean * f64::from(f16::to_f32(view.stderr[t * count + k]))).powi(2);
                }
            }
            let mut rgb = [0.0f64; 3];
            for c in 0..3 {
                let emitted = f64::from(self.material.emission[c]);
                for k in 0..count {
                    brought[k][c] += emitted * self.powers[k][c] * at(emission, k, c);
                    rgb[c] += brought[k][c];
                }
                rgb[c] += emitted;
                if count > 1 {
                    let (before, last) = (at(emission, count - 2, c), at(emission, count - 1, c));
                    let ratio = if before > 0.0 { (last / before).min(1.0) } else { 0.0 };
                    let again = f64::from(self.material.albedo[c]) * ratio;
                    if again < 1.0 {
                        rgb[c] += brought[count - 1][c] * again / (1.0 - again);
                    } else if emitted > 0.0 {
                        totals[3] = f64::max(totals[3], brought[count - 1][c] / emitted);
                    }
                }
            }
            *out = [rgb[0] as f32, rgb[1] as f32, rgb[2] as f32, variance.sqrt() as f32];
            totals[0] += variance;
            totals[1] += (rgb[0] + rgb[1] + rgb[2]) / 3.0;
            totals[2] += 1.0;
        }
        totals
    }
}
