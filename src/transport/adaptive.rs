//! Bakes of textures that leave out what can be interpolated: coarse texels first, finer ones where they would not be predicted.
//!
//! Texels of the largest stride ([`crate::transfer::strides`]) are traced everywhere. Then, brick by brick, those of the last stride
//! are compared with the mean of their parents, as a reader would fill them in, and the texels of half the stride are traced
//! where the difference, less what its noise accounts for, says that their own prediction would be off by more than the error
//! asked for: the difference times how it fell from the stride before. Errors are root mean squares over a brick of X_k = 0.7^(k+1) T_k, relative to that over all texels.
//!
//! What a brick gets follows from its own cells alone, so that chunks may be baked in any order, by any number of processes. Texels on the
//! far faces of a chunk belong to the next one and are traced twice.

use super::bake::{Bake, ChunkBricks, Present, Progress, Sink, estimates};
use super::chunks::for_each_chunk;
use super::estimator::{Estimator, brick_of};
use super::path::Settings;
use super::summary::Summary;
use crate::error::Result;
use crate::grid3;
use crate::sampling::hash::key;
use crate::transfer::strides::{COARSEST, ClosedChunk, Mean, Parents, stride_of};
use crate::transfer::{BRICK, BRICK_TEXELS, Brick, Layers};
use rayon::prelude::*;
use std::sync::atomic::Ordering;

/// Least part of the difference between the texels of a stride and their prediction by which those of half the stride are taken to differ
/// from theirs: where transfer is smooth the error of a mean is of second order. Across edges of shadow it is of first, and in
/// noise of none: how the last two strides compare tells, up to 1.
const SMOOTH: f64 = 0.25;

/// Texels that tell how large transfer is, and their paths.
const SCALE_TEXELS: u64 = 1024;
const SCALE_RAYS: u32 = 64;
/// The stream that picks them.
const PICKS: u64 = 0x7363_616c;

/// How exact a texture is to be between texels.
#[derive(Clone, Debug, PartialEq)]
pub struct Tolerance {
    /// Root mean square of X of the texels, one a texture ([`Bake::groups`]), times the error asked for.
    of_groups: Vec<f64>,
}

impl Tolerance {
    /// What an error, relative to the root mean square over the texels, is of the selected texels of a bake: measured at some.
    ///
    /// # Errors
    /// As [`super::bake()`].
    pub fn new(bake: &Bake<'_>, error: f64) -> Result<Self> {
        let lattice = &bake.layout.lattice;
        let m = lattice.texels();
        let count: usize = m.iter().product();
        // Uniform places; of those that are not selected the next ones.
        let mut picked = Vec::new();
        for i in 0..64 * SCALE_TEXELS {
            let at = ((u128::from(key(key(bake.settings.seed, PICKS), i)) * count as u128) >> 64) as usize;
            let texel = grid3::at([m[0], m[1]], at);
            if bake.selection.contains(texel) {
                picked.push((texel, SCALE_RAYS));
            }
            if picked.len() as u64 == SCALE_TEXELS {
                break;
            }
        }
        let settings = Settings { rays: SCALE_RAYS, target: None, ..bake.settings.clone() };
        let found = estimates(&Bake { settings: &settings, ..*bake }, &picked)?;
        let groups: Vec<Layers> =
            bake.groups().iter().map(|group| group.layout(bake.layout).map(|l| l.layers)).collect::<Result<_>>()?;
        let (mut sums, mut texels) = (vec![0.0; groups.len()], 0);
        for texel in found.iter().flatten() {
            texels += 1;
            for ((sum, layers), group) in sums.iter_mut().zip(&groups).zip(texel) {
                let squares = group.transfer.iter().zip(layers.weights_of_coefficients());
                *sum += squares.map(|(t, w)| (f64::from(*t) * w).powi(2)).sum::<f64>();
            }
        }
        let of_groups = sums.iter().map(|sum| error * (sum / f64::from(texels.max(1))).sqrt()).collect();
        Ok(Self { of_groups })
    }
}

/// The closed chunk of every group.
struct Region<'a> {
    chunk: [usize; 3],
    groups: Vec<ClosedChunk<'a>>,
    layers: &'a [Layers],
    /// The squares of [`Layers::weights`], group by group.
    weights: Vec<Vec<f64>>,
}

/// Which bricks of a chunk, one bit each.
type Bricks = u64;

/// The loop over chunks, for any estimator: as that of whole textures, but a chunk is the work of one thread, which others help.
pub(super) fn fill_adaptively<E: Estimator>(
    estimator: &E,
    bake: &Bake<'_>,
    tolerance: &Tolerance,
    chunks: &[[usize; 3]],
    progress: &Progress,
    present: &Present<'_>,
    sink: &mut Sink<'_>,
) -> Result<Summary> {
    let layers = estimator.layers();
    let work = |(): &mut (), before: &Option<ChunkBricks>, chunk: [usize; 3], _: usize| {
        Some(of_chunk(estimator, bake, tolerance, chunk, before.as_ref(), progress))
    };
    let mut hand_on = |chunk: [usize; 3], outputs: Vec<Option<(ChunkBricks, Summary)>>| {
        let mut summary = Summary::new(layers);
        for (bricks, part) in outputs.into_iter().flatten() {
            sink(chunk, bricks)?;
            summary = part;
        }
        Ok(summary)
    };
    let mut total = Summary::new(layers);
    let mut add = |summary: Summary| total.add(&summary);
    for_each_chunk(1, chunks, progress, present, &work, &mut hand_on, &mut add)?;
    Ok(total)
}

/// The bricks of a chunk, and what they cost.
fn of_chunk<E: Estimator>(
    estimator: &E,
    bake: &Bake<'_>,
    tolerance: &Tolerance,
    chunk: [usize; 3],
    before: Option<&ChunkBricks>,
    progress: &Progress,
) -> (ChunkBricks, Summary) {
    let (lattice, layers) = (&bake.layout.lattice, estimator.layers());
    let mut region = Region::new(bake, layers, chunk);
    let per_chunk: usize = lattice.bricks_of_chunk().iter().product();
    // Texels that are left out are done, too.
    let selected: u64 = bake.selection.texels_by_octant(chunk).iter().sum();
    for slot in 0..per_chunk {
        for (g, group) in region.groups.iter_mut().enumerate() {
            let old = before.and_then(|all| all.get(g)?.get(slot)?.clone());
            group.put(ClosedChunk::slot_in_chunk(slot), old);
        }
    }
    let own = |slot: &usize| bake.selection.touches_brick(lattice.brick_in_chunk(chunk, *slot));
    let own: Bricks = (0..per_chunk).filter(own).fold(0, |all, slot| all | 1 << slot);
    let mut total = Summary::new(layers);
    region.refine(estimator, bake, tolerance, own, progress, &mut total);
    total.left_out = selected - region.groups[0].count_baked(bake.selection);
    let bricks = region.groups.iter_mut().map(|group| {
        (0..per_chunk).map(|slot| group.take(ClosedChunk::slot_in_chunk(slot))).collect::<Vec<Option<Brick>>>()
    });
    progress.texels.fetch_add(selected, Ordering::Relaxed);
    (bricks.collect(), total)
}

/// The share of the selected texels of some bricks that a bake would trace.
pub(super) fn share_of<E: Estimator>(
    estimator: &E,
    bake: &Bake<'_>,
    tolerance: &Tolerance,
    bricks: &[[usize; 3]],
) -> f64 {
    let lattice = &bake.layout.lattice;
    let per_side = lattice.bricks_of_chunk();
    let of_brick = |&brick: &[usize; 3]| {
        let chunk: [usize; 3] = std::array::from_fn(|a| brick[a] / per_side[a]);
        let inner = std::array::from_fn(|a| brick[a] % per_side[a]);
        let slot = grid3::index([per_side[0], per_side[1]], inner);
        let mut region = Region::new(bake, estimator.layers(), chunk);
        let mut summary = Summary::new(estimator.layers());
        region.refine(estimator, bake, tolerance, 1 << slot, &Progress::default(), &mut summary);
        let texels = (0..BRICK_TEXELS).map(|t| lattice.texel_in_brick(brick, t));
        let selected: Vec<[usize; 3]> = texels.filter(|&texel| bake.selection.contains(texel)).collect();
        let traced = selected.iter().filter(|&&texel| region.groups[0].state(texel).0).count();
        [traced, selected.len()]
    };
    let counts: Vec<[usize; 2]> = bricks.par_iter().with_max_len(1).map(of_brick).collect();
    let sum = |i: usize| counts.iter().map(|c| c[i]).sum::<usize>();
    if sum(1) == 0 { 1.0 } else { sum(0) as f64 / sum(1) as f64 }
}

impl<'a> Region<'a> {
    fn new(bake: &'a Bake<'_>, layers: &'a [Layers], chunk: [usize; 3]) -> Self {
        let groups = layers.iter().map(|layers| ClosedChunk::new(&bake.layout.lattice, layers, chunk)).collect();
        let weights = layers.iter().map(|layers| layers.weights().iter().map(|w| w * w).collect()).collect();
        Self { chunk, groups, layers, weights }
    }

    /// Traces some bricks of the chunk, stride after stride, as far as each needs it.
    fn refine<E: Estimator>(
        &mut self,
        estimator: &E,
        bake: &Bake<'_>,
        tolerance: &Tolerance,
        bricks: Bricks,
        progress: &Progress,
        total: &mut Summary,
    ) {
        let lattice = &bake.layout.lattice;
        let (mut refined, mut stride) = (bricks, COARSEST);
        // The differences of the stride before, one a group.
        let mut before = vec![vec![0.0; self.groups.len()]; Bricks::BITS as usize];
        while refined != 0 {
            self.trace(estimator, bake, stride, refined, progress, total);
            if stride == 1 || progress.cancel.load(Ordering::Relaxed) {
                break;
            }
            let slots: Vec<usize> = (0..Bricks::BITS as usize).filter(|slot| refined >> slot & 1 == 1).collect();
            let needs = |&slot: &usize| {
                let brick = lattice.brick_in_chunk(self.chunk, slot);
                self.needs(bake, brick, stride, &before[slot], tolerance)
            };
            let found: Vec<(bool, Vec<f64>)> = slots.par_iter().map(needs).collect();
            refined = 0;
            for (slot, (is_needed, differences)) in slots.into_iter().zip(found) {
                refined |= Bricks::from(is_needed) << slot;
                before[slot] = differences;
            }
            stride /= 2;
        }
    }

    /// Traces what some bricks lack of a stride, in their closed cells; of the largest stride also texels that have no parents.
    fn trace<E: Estimator>(
        &mut self,
        estimator: &E,
        bake: &Bake<'_>,
        stride: usize,
        refined: Bricks,
        progress: &Progress,
        total: &mut Summary,
    ) {
        let (lattice, chunk) = (&bake.layout.lattice, self.chunk);
        let per_side = lattice.bricks_of_chunk();
        let asks = |brick: [usize; 3]| {
            let inner: Option<Vec<usize>> =
                (0..3).map(|a| brick[a].checked_sub(chunk[a] * per_side[a]).filter(|&i| i < per_side[a])).collect();
            let slot = inner.map(|inner| grid3::index([per_side[0], per_side[1]], [inner[0], inner[1], inner[2]]));
            slot.is_some_and(|slot| refined >> slot & 1 == 1)
        };
        // A texel is in the closed cells of its brick, and of those before it where it lies on their faces.
        let is_asked = |texel: [usize; 3]| {
            let brick: [usize; 3] = texel.map(|i| i / BRICK);
            (0..8usize).any(|corner| {
                let before: [usize; 3] = std::array::from_fn(|a| corner >> a & 1);
                let touches = (0..3).all(|a| before[a] == 0 || (texel[a].is_multiple_of(BRICK) && brick[a] > 0));
                touches && asks(std::array::from_fn(|a| brick[a].saturating_sub(before[a])))
            })
        };
        let wanted = |texel: [usize; 3]| {
            let of_stride = stride_of(texel) == stride;
            let alone = stride == COARSEST && !of_stride && Parents::of(lattice, texel).is_none();
            (of_stride || alone) && bake.selection.contains(texel) && is_asked(texel)
        };
        let places: Vec<(usize, [usize; 3])> = ClosedChunk::places(lattice, chunk)
            .filter(|(_, brick)| {
                (0..8usize).any(|corner| asks(std::array::from_fn(|a| brick[a].wrapping_sub(corner >> a & 1))))
            })
            .collect();
        let olds: Vec<Option<Vec<Brick>>> =
            places.iter().map(|&(slot, _)| self.groups.iter_mut().map(|group| group.take(slot)).collect()).collect();
        let outputs: Vec<_> = places
            .par_iter()
            .zip(olds)
            .with_max_len(1)
            .map_init(E::Scratch::default, |scratch, (&(_, brick), old)| {
                brick_of(estimator, bake, &wanted, brick, old, scratch, Some(&progress.cancel))
            })
            .collect();
        for ((slot, brick), output) in places.into_iter().zip(outputs) {
            let is_own = (0..3).all(|a| brick[a] < (chunk[a] + 1) * per_side[a]);
            match is_own {
                true => total.add(&output.summary),
                // The chunk that has them counts them as its own.
                false => total.add_work(&output.summary),
            }
            progress.rays.fetch_add(output.summary.counts.rays, Ordering::Relaxed);
            for ((group, layers), brick) in self.groups.iter_mut().zip(self.layers).zip(output.bricks) {
                let n = layers.coefficients();
                let is_empty = brick.transfer.iter().step_by(n).all(|first| first.is_nan());
                group.put(slot, if is_empty { None } else { Some(brick) });
            }
        }
    }

    /// Whether the texels of half a stride are needed in a brick, whose texels down to this stride were traced; with the differences of
    /// this stride, one a group, where those `before` are of the last.
    fn needs(
        &self,
        bake: &Bake<'_>,
        brick: [usize; 3],
        stride: usize,
        before: &[f64],
        tolerance: &Tolerance,
    ) -> (bool, Vec<f64>) {
        let lattice = &bake.layout.lattice;
        let m = lattice.texels();
        let closed = |step: usize| {
            let span = |a: usize| (brick[a] * BRICK..m[a].min((brick[a] + 1) * BRICK + 1)).step_by(step);
            let (sx, sy, sz) = (span(0), span(1), span(2));
            sz.flat_map(move |z| {
                let sx = sx.clone();
                sy.clone().flat_map(move |y| sx.clone().map(move |x| [x, y, z]))
            })
        };
        let mut compared = Compared::new(self.groups.len());
        let mut buffers = (Mean::default(), Mean::default());
        for texel in closed(stride) {
            // Parents at the distance of the stride: of the largest one those that are of twice the stride.
            let Some(parents) = Parents::at(lattice, texel, stride) else { continue };
            if self.groups[0].state(texel).1 {
                self.compare(texel, &parents, &mut buffers, &mut compared);
            }
        }
        let differences: Vec<f64> = (0..self.groups.len()).map(|g| compared.difference(g)).collect();
        let exceeds = |g: usize| {
            let fell = if before[g] > 0.0 { (differences[g] / before[g]).clamp(SMOOTH, 1.0) } else { 1.0 };
            differences[g] * fell > tolerance.of_groups[g]
        };
        // Where nothing can be compared, something finer can; and what lies behind the last texel of a stride, where the lattice
        // ends, is compared with nothing.
        let is_cut = (0..3).any(|a| (brick[a] + 1) * BRICK >= m[a] && brick[a] * BRICK + 1 < m[a]);
        let is_blind = compared.texels == 0 || is_cut || self.has_holes(bake, brick, stride);
        let is_needed = is_blind || (0..self.groups.len()).any(exceeds);
        (is_needed, differences)
    }

    /// Whether some selected texel of a brick, left out, would have no value.
    fn has_holes(&self, bake: &Bake<'_>, brick: [usize; 3], stride: usize) -> bool {
        let lattice = &bake.layout.lattice;
        let side = BRICK + 1;
        let at = |texel: [usize; 3]| grid3::index([side, side], std::array::from_fn(|a| texel[a] - brick[a] * BRICK));
        let inside = |texel: &[usize; 3]| (0..3).all(|a| texel[a] < lattice.texels()[a]);
        let place = |i: usize| -> [usize; 3] {
            let inner = grid3::at([side, side], i);
            std::array::from_fn(|a| brick[a] * BRICK + inner[a])
        };
        // Whether each texel of the closed cells has a value.
        let mut has = vec![false; side * side * side];
        let mut step = COARSEST;
        while step > 0 {
            for i in 0..has.len() {
                let texel = place(i);
                if !inside(&texel) || stride_of(texel) != step {
                    continue;
                }
                let (is_there, is_valid) = self.groups[0].state(texel);
                let parents = if is_there { None } else { Parents::of(lattice, texel) };
                has[i] = is_valid || parents.is_some_and(|p| p.texels().iter().any(|&p| has[at(p)]));
                let is_own = (0..3).all(|a| texel[a] < (brick[a] + 1) * BRICK);
                if !has[i] && !is_there && is_own && step < stride && bake.selection.contains(texel) {
                    return true;
                }
            }
            step /= 2;
        }
        false
    }

    /// Adds how a texel differs from the mean of its parents.
    fn compare(
        &self,
        texel: [usize; 3],
        parents: &Parents,
        (of_parents, own): &mut (Mean, Mean),
        compared: &mut Compared,
    ) {
        for (g, (group, layers)) in self.groups.iter().zip(self.layers).enumerate() {
            group.mean(parents.texels(), of_parents);
            if of_parents.texels == 0 {
                return;
            }
            group.mean(&[texel], own);
            for (k, &bands) in layers.bands().iter().enumerate() {
                let weight = self.weights[g][k];
                let span = layers.offset(k)..layers.offset(k) + layers.channels() * bands * bands;
                let pairs = own.transfer[span.clone()].iter().zip(&of_parents.transfer[span]);
                compared.squares[g] += weight * pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
                for l in 0..bands {
                    let at = layers.error_offset(k) + l;
                    let variance = f64::from(own.variance[at] + of_parents.variance[at]);
                    compared.noise[g] += weight * (layers.channels() * (2 * l + 1)) as f64 * variance;
                }
            }
            compared.entries[g] += layers.errors();
        }
        compared.texels += 1;
    }
}

/// Sums over the texels of a brick, one a group.
struct Compared {
    texels: usize,
    /// Of the squared differences of X.
    squares: Vec<f64>,
    /// Of what noise makes of them in the mean.
    noise: Vec<f64>,
    /// Of numbers that can differ on their own, at least: one a layer and band.
    entries: Vec<usize>,
}

impl Compared {
    fn new(groups: usize) -> Self {
        Self { texels: 0, squares: vec![0.0; groups], noise: vec![0.0; groups], entries: vec![0; groups] }
    }

    /// The root mean square of a difference without its noise; 0 where noise makes as much of it in 2 of 100 bricks: the mean of n squares has
    /// a relative deviation of √(2/n).
    fn difference(&self, group: usize) -> f64 {
        let (squares, noise) = (self.squares[group], self.noise[group]);
        let certain = 1.0 + 2.0 * (2.0 / self.entries[group].max(1) as f64).sqrt();
        if squares > certain * noise { ((squares - noise) / self.texels as f64).sqrt() } else { 0.0 }
    }
}
