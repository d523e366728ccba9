//! Contraction: the dot product of every touched texel's transfer with the light.

mod coloured;
mod grey;
mod textures;

pub(super) use self::textures::Surroundings;
pub use self::textures::{LuminaireLight, Textures};

use super::noise::NoiseWeights;
use super::{Light, Material};
use crate::error::Result;
use crate::grid3;
use crate::transfer::{BRICK, BRICK_TEXELS, BrickView, Lattice, Layers, validity};
use glam::Vec4;
use rayon::prelude::*;

/// Radiance of the texels of some bricks: the transfer texture with the light multiplied in.
pub struct Contracted {
    pub(super) lattice: Lattice,
    // Brick index (x fastest) to slot, or NO_BRICK.
    pub(super) slots: Vec<u32>,
    // Per slot (red, green, blue, standard error of their mean); of the last, below 0, are NO_LEVEL_SET and UNBAKED.
    pub(super) radiance: Vec<[[f32; 4]; BRICK_TEXELS]>,
    /// Noise of the bake as it shows under this light and material, over the valid texels contracted.
    pub noise: Noise,
    /// Largest S_∞ left out by emission at albedo 1, see [`Tail::emission`](super::Tail::emission); 0 otherwise.
    pub emission_remainder: f32,
}

/// Standard error σ of the contracted radiance (mean of the channels), from the stored standard errors: paths that by
/// chance end elsewhere trade what they bring from one direction for what the others bring in the mean,
/// σ² = Σ_k v_k E_k[(G_k − C)²], derived in `relight/noise.rs`. Half of a 95 % interval of the radiance of a texel is
/// σ times [`half_interval_95`](crate::sampling::statistics::half_interval_95) of the bands of layer 0; in a scene that
/// luminaires light, of one band: what their textures store is the spread of four replicates of a single number.
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

const NO_BRICK: u32 = u32::MAX;

/// In place of the standard error: the texel has no level set.
pub(super) const NO_LEVEL_SET: f32 = -1.0;
/// In place of the standard error: the texel was never baked, or is not contracted.
pub(super) const UNBAKED: f32 = -2.0;

/// Whether a texel with this standard error has radiance. One that is not a number, under light so bright that its
/// square is beyond the type, still has.
#[inline(always)]
pub(super) fn has_radiance(stderr: f32) -> bool {
    stderr != NO_LEVEL_SET && stderr != UNBAKED
}

/// The weights of one contraction.
pub(super) struct Weights {
    // Per coefficient: ρ^(k+1) L_i for the three channels, zero where the light has no such band; and what
    // `noise` puts there.
    pub(super) rows: Vec<Vec4>,
    // Coefficients of each layer that the light reaches, as (offset, count).
    pub(super) spans: Vec<(usize, usize)>,
    pub(super) noise: NoiseWeights,
    // Standard errors of a texel.
    errors: usize,
    pub(super) albedo: [f32; 3],
    pub(super) emission: [f32; 3],
}

impl Weights {
    pub(super) fn new(layers: &Layers, light: &Light, material: &Material) -> Self {
        let mut rows = vec![Vec4::ZERO; layers.coefficients()];
        let mut reached: Vec<usize> = Vec::with_capacity(layers.len());
        for (k, &bands) in layers.bands().iter().enumerate() {
            let power: [f64; 3] = std::array::from_fn(|c| material.factor(k, c));
            reached.push(bands.min(light.used_bands(k)));
            for i in 0..reached[k] * reached[k] {
                let w: [f64; 3] = std::array::from_fn(|c| power[c] * light.coefficients(k)[i][c]);
                rows[layers.offset(k) + i] = Vec4::new(w[0] as f32, w[1] as f32, w[2] as f32, 0.0);
            }
        }
        let noise = NoiseWeights::new(layers, light, material, &mut rows, &mut reached);
        let spans = reached.iter().enumerate().map(|(k, b)| (layers.offset(k), b * b)).collect();
        Self { rows, spans, noise, errors: layers.errors(), albedo: material.albedo, emission: material.emission }
    }
}

/// What one brick gave.
#[derive(Clone, Copy, Default)]
struct BrickTotals {
    variance: f64,
    // Of the three channels.
    radiance: f64,
    texels: u64,
    left_out: f32,
}

/// A brick and its valid texels.
struct Opened<'a> {
    // `None` where nothing is baked.
    view: Option<BrickView<'a>>,
    valid: [u16; BRICK_TEXELS],
    // Of `valid`, the first so many.
    count: usize,
}

impl<'a> Opened<'a> {
    fn new(view: Option<BrickView<'a>>) -> Self {
        let (mut valid, mut count) = ([0; BRICK_TEXELS], 0);
        for (t, flags) in view.iter().flat_map(|view| view.validity).enumerate() {
            // No branch: written in any case, and over if it does not count.
            valid[count] = t as u16;
            count += usize::from(flags & validity::VALID == validity::VALID);
        }
        Self { view, valid, count }
    }

    fn valid(&self) -> &[u16] {
        &self.valid[..self.count]
    }

    /// Marks the texels of the brick, of `errors` standard errors each, that have no radiance.
    #[inline(always)]
    fn mark_others(&self, view: &BrickView<'_>, errors: usize, out: &mut [[f32; 4]; BRICK_TEXELS]) {
        let mut begin = 0;
        for end in self.valid().iter().map(|&t| usize::from(t)).chain([BRICK_TEXELS]) {
            for t in begin..end {
                // Both are NaN where nothing is baked; of the errors fewer lines are to be fetched, and no others than
                // those of valid texels beside it.
                let baked = !view.stderr[t * errors].is_nan();
                out[t] = [0.0, 0.0, 0.0, if baked { NO_LEVEL_SET } else { UNBAKED }];
            }
            begin = end + 1;
        }
    }
}

/// Bricks that one task contracts at most: what a thread has begun no other can take over.
const TASK: usize = 32;

/// Multiplies the transfer of `bricks` (ascending, as [`crate::transfer::Selection::bricks`] gives them) with a light:
/// Σ_k ρ^(k+1) ⟨T_k, L⟩, with the tail and the emission of [`Tail`](super::Tail).
///
/// In a scene each luminaire l adds Σ_k ρ^(k+1) s_l G_k,l, and the emission Le of the level set 1 + Σ_k ρ^(k+1) G_k of its
/// own group. Layers beyond the last one K are taken to fall as the chance to meet the level set again does,
/// r = G_K/G_(K−1) of the group of emission (at most 1): what the last layer brings is repeated ρ r/(1 − ρ r) times. Where
/// ρ r = 1 there is no end and no tail. A single layer has none.
///
/// # Errors
/// Those of the sources.
pub fn contract(
    textures: &Textures<'_>,
    bricks: &[[usize; 3]],
    light: &Light,
    material: &Material,
) -> Result<Contracted> {
    let layers = &textures.layout().layers;
    let weights = Weights::new(&layers.clone().grey(), light, material);
    match &textures.surroundings {
        None => {
            let kernel = grey::Kernel { source: textures.environment, bricks, weights };
            let thread = || grey::Thread::new(layers);
            each_brick(textures, bricks, thread, |thread, slot, out| kernel.contract(thread, slot, out))
        }
        Some(surroundings) => {
            let kernel = coloured::Kernel::new(textures.environment, surroundings, weights, material);
            let room = || coloured::Room::new(layers);
            each_brick(textures, bricks, room, |room, slot, out| kernel.contract(room, bricks[slot], out))
        }
    }
}

/// Runs a kernel on every brick, with what a thread works with, the place of the brick among `bricks`, and where its
/// radiance goes.
fn each_brick<T>(
    textures: &Textures<'_>,
    bricks: &[[usize; 3]],
    thread: impl Fn() -> T + Send + Sync,
    kernel: impl Fn(&mut T, usize, &mut [[f32; 4]; BRICK_TEXELS]) -> Result<BrickTotals> + Send + Sync,
) -> Result<Contracted> {
    let lattice = textures.layout().lattice;
    let [bx, by, bz] = lattice.bricks();
    let mut slots = vec![NO_BRICK; bx * by * bz];
    for (slot, b) in bricks.iter().enumerate() {
        slots[grid3::index([bx, by], *b)] = slot as u32;
    }
    let (mut radiance, mut totals): (Vec<_>, Vec<Result<BrickTotals>>) = (Vec::new(), Vec::new());
    (0..bricks.len())
        .into_par_iter()
        .with_max_len(TASK)
        .map_init(thread, |thread, slot| {
            let mut out = [[0.0; 4]; BRICK_TEXELS];
            let totals = kernel(thread, slot, &mut out);
            (out, totals)
        })
        .unzip_into_vecs(&mut radiance, &mut totals);
    let mut sum = BrickTotals::default();
    for t in totals {
        let t = t?;
        sum.variance += t.variance;
        sum.radiance += t.radiance;
        sum.texels += t.texels;
        sum.left_out = sum.left_out.max(t.left_out);
    }
    let n = sum.texels.max(1) as f64;
    let noise = Noise { rms: (sum.variance / n).sqrt(), mean_radiance: sum.radiance / (3.0 * n), texels: sum.texels };
    Ok(Contracted { lattice, slots, radiance, noise, emission_remainder: sum.left_out })
}

impl Contracted {
    /// Radiance of a texel and the standard error of the mean of its channels; below 0 in its place
    /// [`NO_LEVEL_SET`] or [`UNBAKED`].
    #[inline]
    pub(super) fn texel(&self, texel: [usize; 3]) -> [f32; 4] {
        let [bx, by, _] = self.lattice.bricks();
        let slot = self.slots[texel[0] / BRICK + bx * (texel[1] / BRICK + by * (texel[2] / BRICK))];
        let inner = texel[0] % BRICK + BRICK * (texel[1] % BRICK + BRICK * (texel[2] % BRICK));
        if slot == NO_BRICK { [0.0, 0.0, 0.0, UNBAKED] } else { self.radiance[slot as usize][inner] }
    }

    /// Number of bricks contracted.
    pub fn bricks(&self) -> usize {
        self.radiance.len()
    }
}
