//! Textures that leave texels out: which others stand for one, and filling them in.
//!
//! The stride of a texel is the largest power of two up to [`COARSEST`] that divides its place along each axis. One of stride
//! s < [`COARSEST`] that is left out is the mean of its *parents*: its neighbours at a distance of s along the axes on which its place
//! is an odd multiple of s, two, four or eight of them, all of a larger stride. Filled from large strides to small ones, every texel has
//! one value, whichever of its neighbours are left out, so that lookups are continuous: there are no seams to mend and no two bricks
//! need to agree on a stride. (Differs from bricks with a stride each and a rule for the faces between them.)

use super::{BRICK, Brick, Lattice, Layers, Selection, validity};
use crate::grid3;
use half::f16;
use half::slice::HalfFloatSliceExt;

/// The largest stride; texels of it are never left out.
pub(crate) const COARSEST: usize = 8;
/// Bricks along the side of a [`ClosedChunk`]: those of a chunk, and those behind its far faces.
const SIDE: usize = super::CHUNK / BRICK + 1;

/// The texels whose mean a texel is: at most eight.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Parents {
    texels: [[usize; 3]; 8],
    count: usize,
}

impl Parents {
    /// The parents at a distance; `None` where one lies beyond the lattice, or none is needed.
    pub fn at(lattice: &Lattice, texel: [usize; 3], distance: usize) -> Option<Self> {
        let mut parents = Self { texels: [texel; 8], count: 1 };
        for a in 0..3 {
            if texel[a].is_multiple_of(2 * distance) {
                continue;
            }
            if texel[a] + distance >= lattice.texels()[a] {
                return None;
            }
            for i in 0..parents.count {
                parents.texels[i + parents.count] = parents.texels[i];
                parents.texels[i][a] -= distance;
                parents.texels[i + parents.count][a] += distance;
            }
            parents.count *= 2;
        }
        (parents.count > 1).then_some(parents)
    }

    /// Those of a texel that may be left out; `None` for one that may not: one of the largest stride, or whose parents would lie
    /// beyond the lattice.
    pub fn of(lattice: &Lattice, texel: [usize; 3]) -> Option<Self> {
        let stride = stride_of(texel);
        if stride < COARSEST { Self::at(lattice, texel, stride) } else { None }
    }

    pub fn texels(&self) -> &[[usize; 3]] {
        &self.texels[..self.count]
    }
}

/// The stride of a texel.
pub(crate) fn stride_of(texel: [usize; 3]) -> usize {
    let powers = texel.map(|i| if i == 0 { u32::MAX } else { i.trailing_zeros() });
    1 << powers.into_iter().min().unwrap_or(0).min(COARSEST.trailing_zeros())
}

/// A mean of texels.
#[derive(Clone, Debug, Default)]
pub(crate) struct Mean {
    pub transfer: Vec<f32>,
    /// Variances, one for each standard error.
    pub variance: Vec<f32>,
    /// How many texels it is of: those with a level set.
    pub texels: usize,
    one: Vec<f32>,
}

/// The bricks of a chunk of a texture, and those behind its far faces, whose first texels close the cells of the chunk.
pub(crate) struct ClosedChunk<'a> {
    lattice: &'a Lattice,
    layers: &'a Layers,
    chunk: [usize; 3],
    // x fastest; none where nothing is baked or the lattice ends.
    bricks: Vec<Option<Brick>>,
}

impl<'a> ClosedChunk<'a> {
    pub fn new(lattice: &'a Lattice, layers: &'a Layers, chunk: [usize; 3]) -> Self {
        Self { lattice, layers, chunk, bricks: vec![None; SIDE * SIDE * SIDE] }
    }

    /// The bricks that the lattice has, by their slots here: x fastest.
    pub fn places(lattice: &Lattice, chunk: [usize; 3]) -> impl Iterator<Item = (usize, [usize; 3])> + use<> {
        let count = lattice.bricks();
        let index = move |slot: usize| {
            let inner = grid3::at([SIDE, SIDE], slot);
            (slot, std::array::from_fn(|a| chunk[a] * (SIDE - 1) + inner[a]))
        };
        (0..SIDE * SIDE * SIDE).map(index).filter(move |(_, brick)| (0..3).all(|a| brick[a] < count[a]))
    }

    pub fn put(&mut self, slot: usize, brick: Option<Brick>) {
        self.bricks[slot] = brick;
    }

    pub fn take(&mut self, slot: usize) -> Option<Brick> {
        self.bricks[slot].take()
    }

    /// The slot of a brick here from its slot in the chunk.
    pub fn slot_in_chunk(slot: usize) -> usize {
        grid3::index([SIDE, SIDE], grid3::at([SIDE - 1, SIDE - 1], slot))
    }

    /// Slot and place of a texel of the closed chunk.
    fn place(&self, texel: [usize; 3]) -> (usize, usize) {
        let (brick, place) = self.lattice.place_of(texel);
        let inner = std::array::from_fn(|a| brick[a] - self.chunk[a] * (SIDE - 1));
        (grid3::index([SIDE, SIDE], inner), place)
    }

    /// Whether a texel was baked, and whether it has a level set; one that was filled counts as baked.
    pub fn state(&self, texel: [usize; 3]) -> (bool, bool) {
        let (slot, place) = self.place(texel);
        let Some(brick) = &self.bricks[slot] else { return (false, false) };
        let is_there = !brick.transfer[place * self.layers.coefficients()].is_nan();
        (is_there, is_there && brick.validity[place] & validity::VALID != 0)
    }

    /// How many of some texels were baked, in the chunk without what closes it.
    pub fn count_baked(&self, texels: &Selection) -> u64 {
        let shape = self.lattice.chunk_shape();
        let all = grid3::all(shape).map(|inner| std::array::from_fn(|a| self.chunk[a] * shape[a] + inner[a]));
        all.filter(|&texel| texels.contains(texel) && self.state(texel).0).count() as u64
    }

    /// Adds a texel with a level set; others are left out.
    pub fn add(&self, texel: [usize; 3], mean: &mut Mean) {
        if !self.state(texel).1 {
            return;
        }
        let (slot, place) = self.place(texel);
        let Some(brick) = &self.bricks[slot] else { return };
        let mut sum = |stored: &[f16], n: usize, into: &mut Vec<f32>, squared: bool| {
            into.resize(n, 0.0);
            mean.one.resize(n, 0.0);
            stored[place * n..(place + 1) * n].convert_to_f32_slice(&mut mean.one);
            for (sum, value) in into.iter_mut().zip(&mean.one) {
                *sum += if squared { value * value } else { *value };
            }
        };
        sum(&brick.transfer, self.layers.coefficients(), &mut mean.transfer, false);
        sum(&brick.stderr, self.layers.errors(), &mut mean.variance, true);
        mean.texels += 1;
    }

    /// The mean of some texels with a level set.
    pub fn mean(&self, texels: &[[usize; 3]], mean: &mut Mean) {
        (mean.texels, mean.transfer, mean.variance) = (0, cleared(&mut mean.transfer), cleared(&mut mean.variance));
        texels.iter().for_each(|&texel| self.add(texel, mean));
        let n = mean.texels.max(1) as f32;
        mean.transfer.iter_mut().for_each(|v| *v /= n);
        mean.variance.iter_mut().for_each(|v| *v /= n * n);
    }

    /// Texels of one stride in the closed chunk, as far as the lattice has them.
    fn of_stride(&self, stride: usize) -> impl Iterator<Item = [usize; 3]> + use<> {
        let (m, chunk) = (self.lattice.texels(), self.chunk);
        let span =
            move |a: usize| (chunk[a] * super::CHUNK..m[a].min((chunk[a] + 1) * super::CHUNK + 1)).step_by(stride);
        let all = span(2).flat_map(move |z| span(1).flat_map(move |y| span(0).map(move |x| [x, y, z])));
        all.filter(move |&texel| stride_of(texel) == stride)
    }

    /// Fills in the texels that were left out, as far as their parents have level sets; the bricks of the chunk in which some were, x
    /// fastest, `None` for the others.
    pub fn filled(mut self) -> Vec<Option<Brick>> {
        let mut changed = [false; SIDE * SIDE * SIDE];
        let mut mean = Mean::default();
        let mut stride = COARSEST / 2;
        while stride > 0 {
            for texel in self.of_stride(stride) {
                let Some(parents) = Parents::of(self.lattice, texel).filter(|_| !self.state(texel).0) else { continue };
                self.mean(parents.texels(), &mut mean);
                if mean.texels == 0 {
                    continue;
                }
                let (slot, place) = self.place(texel);
                changed[slot] = true;
                let brick = self.bricks[slot].get_or_insert_with(|| Brick::unbaked(self.layers));
                let (n, e) = (self.layers.coefficients(), self.layers.errors());
                brick.transfer[place * n..(place + 1) * n].convert_from_f32_slice(&mean.transfer);
                let errors = brick.stderr[place * e..(place + 1) * e].iter_mut();
                errors.zip(&mean.variance).for_each(|(error, variance)| *error = f16::from_f32(variance.sqrt()));
                brick.validity[place] = validity::VALID | validity::FILLED;
                brick.rays[place] = 0;
            }
            stride /= 2;
        }
        let slots = (0..(SIDE - 1) * (SIDE - 1) * (SIDE - 1)).map(Self::slot_in_chunk);
        slots.map(|slot| self.bricks[slot].take().filter(|_| changed[slot])).collect()
    }
}

/// The buffer without its content.
fn cleared(buffer: &mut Vec<f32>) -> Vec<f32> {
    let mut buffer = std::mem::take(buffer);
    buffer.clear();
    buffer
}

#[cfg(test)]
mod tests {
    use super::super::BRICK_TEXELS;
    use super::*;

    fn lattice(side: usize) -> Lattice {
        Lattice::from_ratio([side; 3], 1.0).unwrap()
    }

    #[test]
    fn parents_are_of_larger_strides_and_around_their_texel() {
        let lattice = lattice(37);
        for texel in grid3::all([37, 37, 37]) {
            let stride = stride_of(texel);
            assert!(texel.iter().all(|i| i.is_multiple_of(stride)));
            let Some(parents) = Parents::of(&lattice, texel) else {
                // Of 36 = 4 · 9 the parent would be 40, of 34 it is 36.
                let beyond = texel.iter().any(|&i| i + stride >= 37 && !i.is_multiple_of(2 * stride));
                assert!(stride == COARSEST || beyond, "{texel:?}");
                continue;
            };
            let count = texel.iter().filter(|i| !i.is_multiple_of(2 * stride)).count();
            assert_eq!(parents.texels().len(), 1 << count);
            for a in 0..3 {
                let sum: usize = parents.texels().iter().map(|p| p[a]).sum();
                assert_eq!(sum, texel[a] * parents.texels().len());
            }
            assert!(parents.texels().iter().all(|&p| stride_of(p) > stride && p.iter().all(|&i| i < 37)));
        }
    }

    /// A function that is linear in each axis is filled in exactly from its coarsest texels, across the faces of chunks, too.
    #[test]
    fn what_is_linear_is_filled_exactly_and_what_is_baked_stays() {
        let layers = Layers::new(vec![1]).unwrap();
        let lattice = lattice(49);
        let value = |t: [usize; 3]| f16::from_f64(1.0 + (t[0] as f64 + 2.0 * t[1] as f64 - t[2] as f64) / 64.0);
        let chunk = [0, 0, 0];
        let mut closed = ClosedChunk::new(&lattice, &layers, chunk);
        for (slot, brick) in ClosedChunk::places(&lattice, chunk) {
            let mut baked = Brick::unbaked(&layers);
            let mut any = false;
            for place in 0..BRICK_TEXELS {
                let texel = lattice.texel_in_brick(brick, place);
                if texel.iter().all(|&i| i < 49) && (Parents::of(&lattice, texel).is_none() || texel == [9, 9, 9]) {
                    baked.transfer[place] = if texel == [9, 9, 9] { f16::ONE } else { value(texel) };
                    baked.stderr[place] = f16::from_f64(0.5);
                    (baked.validity[place], baked.rays[place], any) = (validity::VALID, 64, true);
                }
            }
            closed.put(slot, any.then_some(baked));
        }
        let filled = closed.filled();
        assert_eq!(filled.len(), 64);
        for (slot, brick) in filled.iter().enumerate() {
            let brick = brick.as_ref().unwrap();
            for place in 0..BRICK_TEXELS {
                let texel = lattice.texel_in_brick(lattice.brick_in_chunk(chunk, slot), place);
                if texel == [9, 9, 9] {
                    assert_eq!((brick.transfer[place], brick.rays[place]), (f16::ONE, 64));
                    continue;
                }
                assert_eq!(brick.transfer[place], value(texel), "{texel:?}");
                let is_filled = brick.validity[place] & validity::FILLED != 0;
                assert_eq!(is_filled, Parents::of(&lattice, texel).is_some());
                // A mean of independent texels: of 2, 4 or 8 parents of stride 8.
                if is_filled && stride_of(texel) == 4 {
                    let n = Parents::of(&lattice, texel).unwrap().texels().len() as f64;
                    assert!((brick.stderr[place].to_f64() - 0.5 / n.sqrt()).abs() < 1e-3);
                }
            }
        }
    }

    #[test]
    fn parents_without_a_level_set_do_not_count_and_none_leaves_the_texel_out() {
        let layers = Layers::new(vec![1]).unwrap();
        let lattice = lattice(9);
        let mut closed = ClosedChunk::new(&lattice, &layers, [0, 0, 0]);
        let mut brick = Brick::unbaked(&layers);
        (brick.transfer[0], brick.stderr[0], brick.validity[0], brick.rays[0]) =
            (f16::from_f64(0.5), f16::ZERO, validity::VALID, 4);
        closed.put(0, Some(brick));
        // The other corner of the cell was baked and has no level set.
        let mut brick = Brick::unbaked(&layers);
        brick.transfer[0] = f16::ZERO;
        let slot = grid3::index([SIDE, SIDE], [1, 0, 0]);
        closed.put(slot, Some(brick));
        let filled = closed.filled();
        let brick = filled[0].as_ref().unwrap();
        let (_, four) = lattice.place_of([4, 0, 0]);
        let (_, other) = lattice.place_of([0, 4, 0]);
        assert_eq!((brick.transfer[four], brick.transfer[other]), (f16::from_f64(0.5), f16::from_f64(0.5)));
        assert!(filled[slot_of_chunk([1, 1, 1])].is_none());
    }

    fn slot_of_chunk(inner: [usize; 3]) -> usize {
        grid3::index([SIDE - 1, SIDE - 1], inner)
    }
}
