//! Contraction: the dot product of every touched texel's transfer with the light.

use super::noise::{NoiseWeights, TailRadiance};
use super::{Light, Material, Tail};
use crate::error::{Error, Result};
use crate::transfer::{BRICK, BRICK_TEXELS, BrickSource, BrickView, Lattice, Layers, MAX_LAYERS, validity};
use glam::{Vec3, Vec4};
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;

/// Radiance of the texels of some bricks: the transfer texture with the light multiplied in.
pub struct Contracted {
    pub(super) lattice: Lattice,
    // Brick index (x fastest) to slot, or NO_BRICK.
    pub(super) slots: Vec<u32>,
    // Per slot 512 × (red, green, blue, weight); weight 1 for valid texels, 0 for others, −1 for texels
    // that were never baked.
    pub(super) radiance: Vec<[f32; 4]>,
    // Beside each the standard error of the mean of its channels.
    pub(super) stderr: Vec<f32>,
    /// Noise of the bake as it shows under this light and material, over the valid texels contracted.
    pub noise: Noise,
    /// Largest S_∞ left out by emission at albedo 1, see [`Tail::emission`]; 0 otherwise.
    pub emission_remainder: f32,
}

/// Standard error σ of the contracted radiance (mean of the channels), from the stored standard errors: paths that by
/// chance end elsewhere trade what they bring from one direction for what the others bring in the mean,
/// σ² = Σ_k v_k E_k[(G_k − C)²], derived in `relight/noise.rs`. Half of a 95 % interval of the radiance of a texel is
/// σ times [`half_interval_95`](crate::sampling::statistics::half_interval_95) of the bands of layer 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Noise {
    /// Root mean square of σ over the texels.
    pub rms: f64,
    /// Mean radiance over the texels.
    pub mean_radiance: f64,
    /// Texels counted.
    pub texels: u64,
}

impl Noise {
    /// σ over the mean radiance; 0 for a black result.
    pub fn relative(&self) -> f64 {
        if self.mean_radiance > 0.0 { self.rms / self.mean_radiance } else { 0.0 }
    }
}

pub(super) const NO_BRICK: u32 = u32::MAX;

/// The weights of one contraction.
pub(super) struct Weights {
    // Per coefficient: ρ^(k+1) L_i for the three channels, zero where the light has no such band; and what
    // `noise` puts there.
    rows: Vec<Vec4>,
    // Coefficients of each layer that the light reaches, as (offset, count).
    spans: Vec<(usize, usize)>,
    noise: NoiseWeights,
    albedo: [f32; 3],
    emission: [f32; 3],
}

impl Weights {
    pub(super) fn new(layers: &Layers, light: &Light, material: &Material) -> Self {
        let mut rows = vec![Vec4::ZERO; layers.coefficients()];
        let mut reached: Vec<usize> = Vec::with_capacity(layers.len());
        let mut power = material.albedo.map(f64::from);
        for (k, &bands) in layers.bands().iter().enumerate() {
            reached.push(bands.min(light.used_bands(k)));
            for i in 0..reached[k] * reached[k] {
                let w: [f64; 3] = std::array::from_fn(|c| power[c] * light.coefficients(k)[i][c]);
                rows[layers.offset(k) + i] = Vec4::new(w[0] as f32, w[1] as f32, w[2] as f32, 0.0);
            }
            for c in 0..3 {
                power[c] *= f64::from(material.albedo[c]);
            }
        }
        let noise = NoiseWeights::new(layers, light, material, &mut rows, &mut reached);
        let spans = reached.iter().enumerate().map(|(k, b)| (layers.offset(k), b * b)).collect();
        Self { rows, spans, noise, albedo: material.albedo, emission: material.emission }
    }

    /// Radiance of one texel.
    #[inline]
    pub(super) fn texel(&self, transfer: &[f32], layers: &Layers) -> TexelRadiance {
        let mut sum = Vec4::ZERO;
        let mut contracted = [Vec4::ZERO; MAX_LAYERS];
        for (layer, &(offset, count)) in contracted.iter_mut().zip(&self.spans) {
            for (t, w) in transfer[offset..offset + count].iter().zip(&self.rows[offset..offset + count]) {
                *layer += *w * *t;
            }
            sum += *layer;
        }
        let mut out = TexelRadiance { rgb: sum.truncate(), contracted, tail: TailRadiance::default(), left_out: 0.0 };
        if layers.len() < 2 && self.emission == [0.0; 3] {
            return out;
        }
        let mut escapes = [0.0f32; MAX_LAYERS];
        for k in 0..layers.len() {
            escapes[k] = transfer[layers.offset(k)] * (2.0 * std::f32::consts::PI.sqrt());
        }
        let escapes = &escapes[..layers.len()];
        let tail = Tail::new(escapes);
        let last = contracted[layers.len() - 1].truncate();
        let beyond = last * Vec3::from_array(self.albedo.map(|albedo| tail.gain(albedo)));
        out.rgb += beyond;
        let slope = last * Vec3::from_array(self.albedo.map(|albedo| tail.gain_slope(albedo)));
        out.tail = TailRadiance {
            beyond: beyond.element_sum() * (1.0 / 3.0),
            slope: slope.element_sum() * (1.0 / 3.0),
            ratio_slopes: tail.ratio_slopes(),
            survival: tail.survival(),
        };
        if self.emission != [0.0; 3] {
            for c in 0..3 {
                let (factor, remainder) = tail.emission(escapes, self.albedo[c]);
                out.rgb[c] += self.emission[c] * factor;
                if self.emission[c] > 0.0 {
                    out.left_out = out.left_out.max(remainder);
                }
            }
        }
        out
    }
}

/// What contraction makes of one texel.
pub(super) struct TexelRadiance {
    pub(super) rgb: Vec3,
    // ⟨T_k, L⟩ of each layer with its albedo; in the fourth lane ⟨T_k, G_k²⟩, see `noise`.
    contracted: [Vec4; MAX_LAYERS],
    tail: TailRadiance,
    // Emission that the sum leaves out.
    left_out: f32,
}

/// What one brick gave.
#[derive(Clone, Copy, Default)]
struct BrickTotals {
    variance: f64,
    radiance: f64,
    texels: u64,
    left_out: f32,
}

/// Multiplies the transfer of `bricks` (ascending, as [`crate::transfer::Selection::bricks`] gives them) with a light.
///
/// # Errors
/// Those of the source; a texture in three channels, which belongs to a scene ([`super::contract_scene`]).
pub fn contract(
    source: &dyn BrickSource,
    bricks: &[[usize; 3]],
    light: &Light,
    material: &Material,
) -> Result<Contracted> {
    let layout = source.layout();
    if layout.layers.channels() != 1 {
        let expected = "the grey transfer of a volume alone";
        let remedy = "use isolume relight, which knows walls and luminaires";
        return Err(Error::argument("texture", "the coloured transfer of a scene", expected, remedy));
    }
    let weights = Weights::new(&layout.layers, light, material);
    let [bx, by, bz] = layout.lattice.bricks();
    let mut slots = vec![NO_BRICK; bx * by * bz];
    for (slot, b) in bricks.iter().enumerate() {
        slots[b[0] + bx * (b[1] + by * b[2])] = slot as u32;
    }
    let mut radiance = vec![[0.0, 0.0, 0.0, -1.0]; bricks.len() * BRICK_TEXELS];
    let mut stderr = vec![0.0f32; radiance.len()];
    let totals = radiance
        .par_chunks_mut(BRICK_TEXELS)
        .zip(stderr.par_chunks_mut(BRICK_TEXELS))
        .zip(bricks)
        .map_init(Vec::new, |buffer, ((out, errors), &index)| {
            Ok(match source.brick(index)? {
                Some(view) => contract_brick(&view, &layout.layers, &weights, out, errors, buffer),
                None => BrickTotals::default(),
            })
        })
        .collect::<Result<Vec<BrickTotals>>>()?;
    let mut sum = BrickTotals::default();
    for t in totals {
        sum.variance += t.variance;
        sum.radiance += t.radiance;
        sum.texels += t.texels;
        sum.left_out = sum.left_out.max(t.left_out);
    }
    let n = sum.texels.max(1) as f64;
    let noise = Noise { rms: (sum.variance / n).sqrt(), mean_radiance: sum.radiance / n, texels: sum.texels };
    Ok(Contracted { lattice: layout.lattice, slots, radiance, stderr, noise, emission_remainder: sum.left_out })
}

fn contract_brick(
    view: &BrickView<'_>,
    layers: &Layers,
    weights: &Weights,
    out: &mut [[f32; 4]],
    out_errors: &mut [f32],
    buffer: &mut Vec<f32>,
) -> BrickTotals {
    let (coefficients, errors) = (layers.coefficients(), layers.errors());
    buffer.resize(coefficients, 0.0);
    let mut totals = BrickTotals::default();
    for (t, out) in out.iter_mut().enumerate() {
        let stored = &view.transfer[t * coefficients..(t + 1) * coefficients];
        if view.validity[t] & validity::VALID == 0 {
            let baked = !stored[0].is_nan();
            *out = [0.0, 0.0, 0.0, if baked { 0.0 } else { -1.0 }];
            continue;
        }
        stored.convert_to_f32_slice(buffer);
        let texel = weights.texel(buffer, layers);
        let rgb = texel.rgb;
        *out = [rgb.x, rgb.y, rgb.z, 1.0];
        let stderr = &view.stderr[t * errors..(t + 1) * errors];
        let variance = weights.noise.variance(buffer, &texel.contracted, &texel.tail, stderr);
        out_errors[t] = variance.sqrt();
        totals.variance += f64::from(variance);
        totals.radiance += f64::from(rgb.x + rgb.y + rgb.z) / 3.0;
        totals.texels += 1;
        totals.left_out = totals.left_out.max(texel.left_out);
    }
    totals
}

impl Contracted {
    /// Radiance and weight of a texel: 1 valid, 0 without a level set, −1 never baked or not contracted.
    #[inline]
    pub(super) fn texel(&self, texel: [usize; 3]) -> [f32; 4] {
        self.slot(texel).map_or([0.0, 0.0, 0.0, -1.0], |i| self.radiance[i])
    }

    /// Standard error of the mean of the channels of a texel; 0 where [`Self::texel`] has weight 0 or −1.
    #[inline]
    pub(super) fn texel_stderr(&self, texel: [usize; 3]) -> f32 {
        self.slot(texel).map_or(0.0, |i| self.stderr[i])
    }

    #[inline]
    fn slot(&self, texel: [usize; 3]) -> Option<usize> {
        let [bx, by, _] = self.lattice.bricks();
        let slot = self.slots[texel[0] / BRICK + bx * (texel[1] / BRICK + by * (texel[2] / BRICK))];
        let inner = texel[0] % BRICK + BRICK * (texel[1] % BRICK + BRICK * (texel[2] % BRICK));
        (slot != NO_BRICK).then_some(slot as usize * BRICK_TEXELS + inner)
    }

    /// Number of bricks contracted.
    pub fn bricks(&self) -> usize {
        self.radiance.len() / BRICK_TEXELS
    }
}
