//! Contraction: the dot product of every touched texel's transfer with the light.

use super::block::{self, LANES, Lanes, each};
use super::noise::{NoiseWeights, TailRadiance};
use super::tail::Tails;
use super::{Light, Material};
use crate::error::{Error, Result};
use crate::transfer::{BRICK, BRICK_TEXELS, BrickSource, BrickView, Lattice, Layers, MAX_LAYERS, validity};
use glam::Vec4;
use half::f16;
use multiversion::{multiversion, target::match_target};
use rayon::prelude::*;

/// Radiance of the texels of some bricks: the transfer texture with the light multiplied in.
pub struct Contracted {
    pub(super) lattice: Lattice,
    // Brick index (x fastest) to slot, or NO_BRICK.
    pub(super) slots: Vec<u32>,
    // Per slot 512 × (red, green, blue, standard error of their mean); of the last, below 0, are NO_LEVEL_SET and
    // UNBAKED.
    pub(super) radiance: Vec<[f32; 4]>,
    /// Noise of the bake as it shows under this light and material, over the valid texels contracted.
    pub noise: Noise,
    /// Largest S_∞ left out by emission at albedo 1, see [`Tail::emission`](super::Tail::emission); 0 otherwise.
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
    pub(super) albedo: [f32; 3],
    pub(super) emission: [f32; 3],
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

    /// Radiance of the texels of a block from their columns; leaves in `work` what the noise needs of it.
    #[inline(always)]
    fn block(&self, columns: &[Lanes], layers: &Layers, dot: impl Dot, work: &mut BlockWork) -> [Lanes; 3] {
        let mut rgb = [[0.0; LANES]; 3];
        for (layer, &(offset, count)) in work.contracted.iter_mut().zip(&self.spans) {
            *layer = dot(&columns[offset..offset + count], &self.rows[offset..offset + count]);
            for (sum, channel) in rgb.iter_mut().zip(&*layer) {
                *sum = each(|j| sum[j] + channel[j]);
            }
        }
        work.tail = TailRadiance::NONE;
        work.left_out = 0.0;
        if layers.len() < 2 && self.emission == [0.0; 3] {
            return rgb;
        }
        let escape = |k: usize| {
            let column = &columns[layers.offset(k)];
            each(|j| column[j] * (2.0 * std::f32::consts::PI.sqrt()))
        };
        let last = layers.len() - 1;
        let mut escaped = escape(0);
        for k in 1..=last {
            let more = escape(k);
            escaped = each(|j| escaped[j] + more[j]);
        }
        let tail = Tails::new(&escaped, (last > 0).then(|| escape(last - 1)).as_ref(), &escape(last));
        let of_last = &work.contracted[last];
        let [mut beyond, mut slope] = [[[0.0; LANES]; 3]; 2];
        for c in 0..3 {
            let albedo = self.albedo[c];
            beyond[c] = each(|j| of_last[c][j] * tail.at(j).gain(albedo));
            slope[c] = each(|j| of_last[c][j] * tail.at(j).gain_slope(albedo));
            rgb[c] = each(|j| rgb[c][j] + beyond[c][j]);
        }
        let mean = |v: &[Lanes; 3]| each(|j| (v[0][j] + v[1][j] + v[2][j]) * (1.0 / 3.0));
        work.tail.beyond = mean(&beyond);
        work.tail.slope = mean(&slope);
        work.tail.ratio_slopes = tail.ratio_slopes();
        work.tail.survival = tail.survival;
        if self.emission != [0.0; 3] {
            self.emit(columns, layers, &tail, &mut rgb, &mut work.left_out);
        }
        rgb
    }

    /// Adds emission.
    fn emit(&self, columns: &[Lanes], layers: &Layers, tails: &Tails, rgb: &mut [Lanes; 3], left_out: &mut f32) {
        let mut escapes = [0.0f32; MAX_LAYERS];
        for j in 0..LANES {
            for k in 0..layers.len() {
                escapes[k] = columns[layers.offset(k)][j] * (2.0 * std::f32::consts::PI.sqrt());
            }
            for c in 0..3 {
                let (factor, remainder) = tails.at(j).emission(&escapes[..layers.len()], self.albedo[c]);
                rgb[c][j] += self.emission[c] * factor;
                if self.emission[c] > 0.0 {
                    *left_out = left_out.max(remainder);
                }
            }
        }
    }
}

/// What contraction leaves of a block beside its radiance.
struct BlockWork {
    // ⟨T_k, L⟩ of each layer with its albedo; fourth ⟨T_k, G_k²⟩, see `noise`. One entry a layer.
    contracted: Vec<[Lanes; 4]>,
    tail: TailRadiance,
    // Emission that the sum leaves out, the most of any lane.
    left_out: f32,
}

/// Room for the blocks of one task.
struct Room {
    columns: Vec<Lanes>,
    errors: Vec<Lanes>,
    work: BlockWork,
}

impl Room {
    fn new(layers: &Layers) -> Self {
        Self {
            columns: vec![[0.0; LANES]; layers.coefficients()],
            errors: vec![[0.0; LANES]; layers.errors()],
            work: BlockWork {
                contracted: vec![[[0.0; LANES]; 4]; layers.len()],
                tail: TailRadiance::NONE,
                left_out: 0.0,
            },
        }
    }
}

/// Bricks that one task contracts at most: what a thread has begun no other can take over.
const TASK: usize = 32;

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
    let (layers, weights) = (&layout.layers, Weights::new(&layout.layers, light, material));
    let [bx, by, bz] = layout.lattice.bricks();
    let mut slots = vec![NO_BRICK; bx * by * bz];
    for (slot, b) in bricks.iter().enumerate() {
        slots[b[0] + bx * (b[1] + by * b[2])] = slot as u32;
    }
    // Zeroed memory, so that the threads that fill the pages are the first to touch them.
    let mut radiance = vec![[0.0; 4]; bricks.len() * BRICK_TEXELS];
    let totals = radiance
        .par_chunks_mut(BRICK_TEXELS)
        .zip(bricks)
        .with_max_len(TASK)
        .map_init(
            || Room::new(layers),
            |room, (out, &index)| {
                Ok(match source.brick(index)? {
                    Some(view) => contract_brick(BrickJob { view, layers, weights: &weights, out, room }),
                    None => {
                        out.fill([0.0, 0.0, 0.0, UNBAKED]);
                        BrickTotals::default()
                    }
                })
            },
        )
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
    Ok(Contracted { lattice: layout.lattice, slots, radiance, noise, emission_remainder: sum.left_out })
}

/// A brick to contract, and where to.
struct BrickJob<'a> {
    view: BrickView<'a>,
    layers: &'a Layers,
    weights: &'a Weights,
    out: &'a mut [[f32; 4]],
    room: &'a mut Room,
}

/// [`block::columns`] in one of its forms.
trait Columns: Fn(&[f16], usize, &[usize; LANES], &mut [Lanes]) {}
impl<F: Fn(&[f16], usize, &[usize; LANES], &mut [Lanes])> Columns for F {}

/// [`block::wide::fetch`], or nothing.
trait Fetch: Fn(&[f16], usize, &[usize]) {}
impl<F: Fn(&[f16], usize, &[usize])> Fetch for F {}

/// [`block::dot`] in one of its forms.
trait Dot: Fn(&[Lanes], &[Vec4]) -> [Lanes; 4] {}
impl<F: Fn(&[Lanes], &[Vec4]) -> [Lanes; 4]> Dot for F {}

/// Contracts a brick with what this processor has. No variant uses fused multiply-add: all give the same bits.
#[multiversion(targets("x86_64+avx+avx2+f16c"))]
fn contract_brick(job: BrickJob<'_>) -> BrickTotals {
    match_target! {
        "x86_64+avx+avx2+f16c" => job.run(
            |stored, n, texels| block::wide::fetch(stored, n, texels),
            |stored, n, texels, out| block::wide::columns(stored, n, texels, out),
            |columns, weights| block::wide::dot(columns, weights),
        ),
        _ => job.run(|_, _, _| (), block::columns, block::dot),
    }
}

impl BrickJob<'_> {
    /// Inlined, with all that it calls, where the wide registers are.
    #[inline(always)]
    fn run(mut self, fetch: impl Fetch, turn: impl Columns, dot: impl Dot) -> BrickTotals {
        let errors = self.layers.errors();
        let mut totals = BrickTotals::default();
        let (mut valid, mut count) = ([0; BRICK_TEXELS], 0);
        for t in 0..BRICK_TEXELS {
            if self.view.validity[t] & validity::VALID == 0 {
                // Both are NaN where nothing is baked; of the errors fewer lines are to be fetched, and no others than
                // those of valid texels beside it.
                let baked = !self.view.stderr[t * errors].is_nan();
                self.out[t] = [0.0, 0.0, 0.0, if baked { NO_LEVEL_SET } else { UNBAKED }];
                continue;
            }
            valid[count] = t;
            count += 1;
        }
        let valid = &valid[..count];
        for first in (0..count).step_by(LANES) {
            let (some, behind) = valid[first..].split_at(LANES.min(count - first));
            // A block that is not full repeats its first texel.
            let mut texels = [some[0]; LANES];
            texels[..some.len()].copy_from_slice(some);
            self.block(&texels, some.len(), &behind[..LANES.min(behind.len())], &fetch, &turn, &dot, &mut totals);
        }
        totals
    }

    /// Contracts the first `count` of some texels, all of which are valid. Those `behind` come from memory meanwhile.
    #[inline(always)]
    fn block(
        &mut self,
        texels: &[usize; LANES],
        count: usize,
        behind: &[usize],
        fetch: &impl Fetch,
        turn: &impl Columns,
        dot: &impl Dot,
        totals: &mut BrickTotals,
    ) {
        let Self { view, layers, weights, out, room } = self;
        // In two parts: there is room for so many lines on their way.
        let (soon, later) = behind.split_at(behind.len() / 2);
        fetch(view.transfer, layers.coefficients(), soon);
        turn(view.transfer, layers.coefficients(), texels, &mut room.columns);
        fetch(view.transfer, layers.coefficients(), later);
        turn(view.stderr, layers.errors(), texels, &mut room.errors);
        fetch(view.stderr, layers.errors(), behind);
        let [red, green, blue] = weights.block(&room.columns, layers, dot, &mut room.work);
        let BlockWork { contracted, tail, left_out } = &room.work;
        let variance = weights.noise.variance(&room.columns, contracted, tail, &room.errors);
        let stderr = each(|j| variance[j].sqrt());
        for (j, &t) in texels[..count].iter().enumerate() {
            out[t] = [red[j], green[j], blue[j], stderr[j]];
            totals.variance += f64::from(variance[j]);
            totals.radiance += f64::from(red[j] + green[j] + blue[j]) / 3.0;
        }
        totals.texels += count as u64;
        totals.left_out = totals.left_out.max(*left_out);
    }
}

impl Contracted {
    /// Radiance of a texel and the standard error of the mean of its channels; below 0 in its place
    /// [`NO_LEVEL_SET`] or [`UNBAKED`].
    #[inline]
    pub(super) fn texel(&self, texel: [usize; 3]) -> [f32; 4] {
        let [bx, by, _] = self.lattice.bricks();
        let slot = self.slots[texel[0] / BRICK + bx * (texel[1] / BRICK + by * (texel[2] / BRICK))];
        let inner = texel[0] % BRICK + BRICK * (texel[1] % BRICK + BRICK * (texel[2] % BRICK));
        if slot == NO_BRICK { [0.0, 0.0, 0.0, UNBAKED] } else { self.radiance[slot as usize * BRICK_TEXELS + inner] }
    }

    /// Number of bricks contracted.
    pub fn bricks(&self) -> usize {
        self.radiance.len() / BRICK_TEXELS
    }
}
