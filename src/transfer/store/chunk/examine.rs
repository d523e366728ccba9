//! Looking at every byte of a chunk, where reading stops at the first that is wrong.

use super::super::Store;
use super::Found;
use crate::error::{Error, Result};
use crate::transfer::{BRICK_TEXELS, BrickView, Selection, validity};
use std::path::PathBuf;

/// What stands at the place of a chunk.
pub(in super::super) enum ChunkState {
    /// No `transfer` shard: not baked.
    Absent,
    /// Files of two writings; one that disagrees.
    Torn(PathBuf),
    /// What was wrong: with the chunk as a whole, or with each of its bricks.
    Damaged(Vec<Error>),
    /// Every checksum is right.
    Whole(Texels),
}

/// What the bricks of sound chunks hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in super::super) struct Texels {
    /// Bricks.
    pub bricks: u64,
    /// Bricks that hold selected texels and are not there.
    pub bricks_absent: u64,
    /// Selected texels that are there.
    pub selected: u64,
    /// Of these, without a level set.
    pub invalid: u64,
    /// Of these, with a clamped isovalue.
    pub clamped: u64,
    /// Valid texels with transfer that is not finite.
    pub not_finite: u64,
}

impl Texels {
    /// Adds the counts of another chunk.
    pub fn add(&mut self, other: &Self) {
        self.bricks += other.bricks;
        self.bricks_absent += other.bricks_absent;
        self.selected += other.selected;
        self.invalid += other.invalid;
        self.clamped += other.clamped;
        self.not_finite += other.not_finite;
    }

    /// `leaves_out`: texels that were not baked are interpolated.
    fn count(&mut self, view: &BrickView<'_>, brick: [usize; 3], selection: &Selection, leaves_out: bool) {
        self.bricks += 1;
        let coefficients = view.transfer.len() / BRICK_TEXELS;
        for (t, (&flags, transfer)) in view.validity.iter().zip(view.transfer.chunks_exact(coefficients)).enumerate() {
            let valid = flags & validity::VALID != 0;
            self.not_finite += u64::from(valid && transfer.iter().any(|v| !v.is_finite()));
            let is_left_out = leaves_out && transfer[0].is_nan();
            if !is_left_out && selection.contains(selection.lattice().texel_in_brick(brick, t)) {
                self.selected += 1;
                self.invalid += u64::from(!valid);
                self.clamped += u64::from(flags & validity::CLAMPED != 0);
            }
        }
    }
}

impl Store {
    /// Reads a chunk from disk as it is now, every brick of it. `selection`: the texels that should
    /// be baked.
    ///
    /// # Errors
    /// When the index is outside the lattice or the system refuses to read; damage is no error here.
    pub(in super::super) fn examine_chunk(&self, index: [usize; 3], selection: &Selection) -> Result<ChunkState> {
        let chunk = match self.find_chunk(index) {
            Ok(Found::Nothing) => return Ok(ChunkState::Absent),
            Ok(Found::Torn(name)) => return Ok(ChunkState::Torn(name)),
            Ok(Found::Whole(chunk)) => chunk,
            Err(error @ (Error::Format { .. } | Error::Limit { .. })) => return Ok(ChunkState::Damaged(vec![error])),
            Err(other) => return Err(other),
        };
        let count = self.layout.lattice.bricks();
        let (mut texels, mut damage) = (Texels::default(), Vec::new());
        for slot in 0..self.slots() {
            let brick = self.layout.lattice.brick_in_chunk(index, slot);
            if (0..3).any(|a| brick[a] >= count[a]) {
                continue;
            }
            match self.view(&chunk, slot) {
                Ok(Some(view)) => texels.count(&view, brick, selection, self.leaves_out()),
                Ok(None) if self.leaves_out() => {}
                Ok(None) => texels.bricks_absent += u64::from(selection.touches_brick(brick)),
                Err(error) => damage.push(error),
            }
        }
        Ok(if damage.is_empty() { ChunkState::Whole(texels) } else { ChunkState::Damaged(damage) })
    }
}
