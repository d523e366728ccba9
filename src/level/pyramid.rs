//! Minimum and maximum of blocks of cells, for skipping what a ray of a given isovalue cannot hit.

use super::cone::Ahead;
use crate::volume::{Sample, Volume, with_samples};
use rayon::prelude::*;
use std::sync::OnceLock;

/// Cells along the side of a block, as a power of two: 4.
///
/// There are no levels of larger blocks above: what lies beyond the next blocks is known by cones of directions.
/// Below a block, a cell is tested from its eight samples: they are in the cache anyway when the cell is solved, and a
/// stored range per cell would double the memory.
pub const BLOCK_SHIFT: u32 = 2;

/// Blocks along each axis of a grid of samples.
fn blocks_of(dims: [usize; 3]) -> [usize; 3] {
    dims.map(|n| n.saturating_sub(1).div_ceil(1 << BLOCK_SHIFT).max(1))
}

/// Bytes of memory that belong to what rays are traced through: samples where they are not read in their file, ranges of blocks
/// of 4³ cells (two f32), their cones (24 ranks of 16 bits), and the bounds of proofs (20 bytes).
pub(crate) fn bytes_of_field(volume: &Volume) -> u64 {
    let blocks: u64 = blocks_of(volume.dims()).iter().map(|&n| n as u64).product();
    volume.samples().bytes_owned() + blocks * (8 + 48 + 20)
}

/// Range of s·raw over blocks of cells, where s is the sign of the solid side: a block whose
/// maximum is at most the (signed) isovalue holds no solid.
#[derive(Clone, Debug)]
pub struct Pyramid {
    blocks: Level,
    // Made when the first ray is traced: most of the cost, and relighting traces none.
    ahead: OnceLock<Ahead>,
    // That of the other side, for rays inside the solid.
    turned: OnceLock<Box<Pyramid>>,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct Level {
    pub(crate) dims: [usize; 3],
    pub(crate) max: Vec<f32>,
    pub(crate) min: Vec<f32>,
}

impl Level {
    #[inline(always)]
    pub(crate) fn index(&self, block: [usize; 3]) -> usize {
        block[0] + self.dims[0] * (block[1] + self.dims[1] * block[2])
    }
}

impl Pyramid {
    /// Scans the volume once.
    pub fn new(volume: &Volume) -> Self {
        let sign = volume.solid_sign();
        let blocks = with_samples!(volume.samples(), s => Self::scan(s, volume.dims(), sign));
        Self { blocks, ahead: OnceLock::new(), turned: OnceLock::new() }
    }

    fn scan<T: Sample>(samples: &[T], dims: [usize; 3], sign: f32) -> Level {
        let side = 1usize << BLOCK_SHIFT;
        let blocks = blocks_of(dims);
        let count = blocks.iter().product();
        let mut level = Level { dims: blocks, max: vec![f32::NEG_INFINITY; count], min: vec![f32::INFINITY; count] };
        // Rows of samples belong to one or two blocks in y and to one or two slabs of blocks in z: shared faces to both.
        let slab = blocks[0] * blocks[1];
        let slabs = level.max.par_chunks_mut(slab).zip(level.min.par_chunks_mut(slab)).enumerate();
        slabs.for_each(|(bz, (max, min))| {
            let mut row_range = vec![(0.0, 0.0); blocks[0]];
            for z in bz * side..=(bz * side + side).min(dims[2] - 1) {
                for y in 0..dims[1] {
                    let row = &samples[dims[0] * (y + dims[1] * z)..][..dims[0]];
                    for bx in 0..blocks[0] {
                        let span = &row[bx * side..(bx * side + side + 1).min(dims[0])];
                        row_range[bx] = span.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(lo, hi), s| {
                            let v = sign * s.raw();
                            (if v < lo { v } else { lo }, if v > hi { v } else { hi })
                        });
                    }
                    let last = (y / side).min(blocks[1] - 1);
                    let first = if y > 0 && y.is_multiple_of(side) { (y / side - 1).min(blocks[1] - 1) } else { last };
                    for by in first..=last {
                        for bx in 0..blocks[0] {
                            let (at, (lo, hi)) = (bx + blocks[0] * by, row_range[bx]);
                            max[at] = max[at].max(hi);
                            min[at] = min[at].min(lo);
                        }
                    }
                }
            }
        });
        level
    }

    #[inline(always)]
    pub(super) fn blocks(&self) -> &Level {
        &self.blocks
    }

    /// Of the same samples with the other side as the solid; made when first asked for.
    pub(super) fn turned(&self) -> &Self {
        self.turned.get_or_init(|| {
            let negative = |v: &[f32]| v.iter().map(|v| -v).collect();
            let Level { dims, max, min } = &self.blocks;
            let blocks = Level { dims: *dims, max: negative(min), min: negative(max) };
            Box::new(Self { blocks, ahead: OnceLock::new(), turned: OnceLock::new() })
        })
    }

    /// What lies ahead of rays.
    #[inline(always)]
    pub(super) fn ahead(&self) -> &Ahead {
        self.ahead.get_or_init(|| Ahead::new(&self.blocks))
    }

    /// Smallest and largest s·raw of each block, in the order of its index in [`LevelField::each_cell`](super::LevelField::each_cell).
    pub fn block_ranges(&self) -> impl ExactSizeIterator<Item = (f32, f32)> + '_ {
        self.blocks.min.iter().copied().zip(self.blocks.max.iter().copied())
    }
}
