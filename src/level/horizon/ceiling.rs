//! Linear upper bounds of the field over blocks of cells.

use super::super::{BLOCK_SHIFT, LevelField};
use crate::volume::Sample;
use glam::Vec3;
use std::sync::OnceLock;

/// s·raw ≤ value + gradient·(p − first) at all samples p of a block, and so in all its cells.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ceiling {
    pub(super) value: f32,
    pub(super) gradient: Vec3,
}

/// The ceilings of the lowest blocks of the pyramid, each made when it is first asked for: a pure function of the samples,
/// whoever asks.
pub(super) struct Ceilings {
    dims: [usize; 3],
    blocks: Vec<OnceLock<Ceiling>>,
}

impl Ceilings {
    pub(super) fn new(dims: [usize; 3]) -> Self {
        let count = dims.iter().product();
        Self { dims, blocks: (0..count).map(|_| OnceLock::new()).collect() }
    }

    pub(super) fn of<T: Sample>(&self, field: &LevelField<'_, T>, block: [usize; 3]) -> Ceiling {
        let index = block[0] + self.dims[0] * (block[1] + self.dims[1] * block[2]);
        *self.blocks[index].get_or_init(|| field.ceiling_of(block))
    }
}

impl<T: Sample> LevelField<'_, T> {
    /// The plane through the block whose slope along each axis is the mean difference of the two opposite faces, raised
    /// above all samples.
    fn ceiling_of(&self, block: [usize; 3]) -> Ceiling {
        let shift = BLOCK_SHIFT;
        let first = block.map(|b| b << shift);
        let end: [usize; 3] = std::array::from_fn(|a| ((block[a] + 1) << shift).min(self.dims[a] - 1));
        let at =
            |x: usize, y: usize, z: usize| self.samples[x + self.dims[0] * (y + self.dims[1] * z)].raw() * self.sign;
        let mut rise = Vec3::ZERO;
        for z in first[2]..=end[2] {
            for y in first[1]..=end[1] {
                rise.x += at(end[0], y, z) - at(first[0], y, z);
            }
            for x in first[0]..=end[0] {
                rise.y += at(x, end[1], z) - at(x, first[1], z);
            }
        }
        for y in first[1]..=end[1] {
            for x in first[0]..=end[0] {
                rise.z += at(x, y, end[2]) - at(x, y, first[2]);
            }
        }
        let cells = Vec3::from_array(std::array::from_fn(|a| (end[a] - first[a]) as f32));
        let lines = cells + Vec3::ONE;
        let gradient = rise / (cells * Vec3::new(lines.y * lines.z, lines.x * lines.z, lines.x * lines.y));
        let mut value = f32::NEG_INFINITY;
        for z in first[2]..=end[2] {
            for y in first[1]..=end[1] {
                let row = gradient.y * (y - first[1]) as f32 + gradient.z * (z - first[2]) as f32;
                for x in first[0]..=end[0] {
                    value = value.max(at(x, y, z) - (row + gradient.x * (x - first[0]) as f32));
                }
            }
        }
        Ceiling { value, gradient }
    }
}
