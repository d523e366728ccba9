//! Minimum and maximum of blocks of cells, for skipping what a ray of a given isovalue cannot hit.

use crate::volume::{Sample, Volume, with_samples};

/// Cells along the side of the blocks of each level, as powers of two: 4, 8, 32.
///
/// The lowest level of the march, the cell itself, is tested from its eight samples: they are in
/// the cache anyway when the cell is solved, and a stored range per cell would double the memory.
pub const LEVEL_SHIFTS: [u32; 3] = [2, 3, 5];

/// Range of s·raw over blocks of cells, where s is the sign of the solid side: a block whose
/// maximum is at most the (signed) isovalue holds no solid.
#[derive(Clone, Debug)]
pub struct Pyramid {
    levels: [Level; 3],
    // Per octant of directions (bit a set: falling along axis a) and block of level OCTANT_LEVEL: the maximum
    // over all blocks that a ray from that block can still meet.
    ahead: [Vec<f32>; 8],
}

/// The level on which [`Pyramid::ahead`] is kept: blocks of 8 cells, 1 MB for all octants at 256³.
const OCTANT_LEVEL: usize = 1;

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
        let lowest = with_samples!(volume.samples(), s => Self::scan(s, volume.dims(), sign));
        let middle = coarsen(&lowest, 1 << (LEVEL_SHIFTS[1] - LEVEL_SHIFTS[0]));
        let top = coarsen(&middle, 1 << (LEVEL_SHIFTS[2] - LEVEL_SHIFTS[1]));
        let ahead = std::array::from_fn(|octant| look_ahead(&middle, octant));
        Self { levels: [lowest, middle, top], ahead }
    }

    fn scan<T: Sample>(samples: &[T], dims: [usize; 3], sign: f32) -> Level {
        let side = 1usize << LEVEL_SHIFTS[0];
        let blocks = dims.map(|n| n.saturating_sub(1).div_ceil(side).max(1));
        let count = blocks.iter().product();
        let mut level = Level { dims: blocks, max: vec![f32::NEG_INFINITY; count], min: vec![f32::INFINITY; count] };
        // Rows of samples belong to one or two blocks in y and z (shared faces belong to both).
        let owners = |i: usize, n: usize| {
            let last = (i / side).min(n - 1);
            let first = if i > 0 && i.is_multiple_of(side) { (i / side - 1).min(n - 1) } else { last };
            first..=last
        };
        let mut row_max = vec![0.0f32; blocks[0]];
        let mut row_min = vec![0.0f32; blocks[0]];
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                let row = &samples[dims[0] * (y + dims[1] * z)..][..dims[0]];
                for bx in 0..blocks[0] {
                    let span = &row[bx * side..(bx * side + side + 1).min(dims[0])];
                    let (lo, hi) = span.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(lo, hi), s| {
                        let v = sign * s.raw();
                        (if v < lo { v } else { lo }, if v > hi { v } else { hi })
                    });
                    row_min[bx] = lo;
                    row_max[bx] = hi;
                }
                for bz in owners(z, blocks[2]) {
                    for by in owners(y, blocks[1]) {
                        let at = level.index([0, by, bz]);
                        for bx in 0..blocks[0] {
                            level.max[at + bx] = level.max[at + bx].max(row_max[bx]);
                            level.min[at + bx] = level.min[at + bx].min(row_min[bx]);
                        }
                    }
                }
            }
        }
        level
    }

    #[inline(always)]
    pub(crate) fn level(&self, level: usize) -> &Level {
        &self.levels[level]
    }

    /// The largest s·raw that a ray can meet once it is in the block of 8 cells that holds `cell`, if it goes
    /// towards `octant` (bit a set: falling along axis a). Where that is at most the isovalue, the ray escapes.
    #[inline(always)]
    pub(crate) fn ahead(&self, octant: usize, cell: [usize; 3]) -> f32 {
        let shift = LEVEL_SHIFTS[OCTANT_LEVEL];
        self.ahead[octant][self.levels[OCTANT_LEVEL].index(cell.map(|c| c >> shift))]
    }

    /// Smallest and largest s·raw of the lowest-level block that holds a cell.
    pub fn block_range(&self, cell: [usize; 3]) -> (f32, f32) {
        let level = &self.levels[0];
        let at = level.index(cell.map(|c| c >> LEVEL_SHIFTS[0]));
        (level.min[at], level.max[at])
    }
}

/// Maximum over all blocks ahead of each, itself included, for rays of one octant.
fn look_ahead(level: &Level, octant: usize) -> Vec<f32> {
    let mut ahead = level.max.clone();
    let [bx, by, bz] = level.dims;
    // From the far end towards where rays come from, so that the neighbours ahead are done.
    let order = |axis: usize, n: usize, i: usize| if octant >> axis & 1 == 1 { i } else { n - 1 - i };
    for k in 0..bz {
        for j in 0..by {
            for i in 0..bx {
                let block = [order(0, bx, i), order(1, by, j), order(2, bz, k)];
                let at = level.index(block);
                for (axis, step) in [i, j, k].into_iter().enumerate() {
                    if step > 0 {
                        let mut next = block;
                        next[axis] = if octant >> axis & 1 == 1 { block[axis] - 1 } else { block[axis] + 1 };
                        ahead[at] = ahead[at].max(ahead[level.index(next)]);
                    }
                }
            }
        }
    }
    ahead
}

fn coarsen(fine: &Level, factor: usize) -> Level {
    let dims = fine.dims.map(|n| n.div_ceil(factor));
    let count = dims.iter().product();
    let mut level = Level { dims, max: vec![f32::NEG_INFINITY; count], min: vec![f32::INFINITY; count] };
    for z in 0..fine.dims[2] {
        for y in 0..fine.dims[1] {
            for x in 0..fine.dims[0] {
                let from = fine.index([x, y, z]);
                let to = level.index([x / factor, y / factor, z / factor]);
                level.max[to] = level.max[to].max(fine.max[from]);
                level.min[to] = level.min[to].min(fine.min[from]);
            }
        }
    }
    level
}
