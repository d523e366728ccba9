//! Parts of a chunk that may be baked apart: its octants, 16³ texels each.
//!
//! # Why chunks on the disk stay 32³
//! Shares need units this small (64 tasks on a surface of the brain at 1 mm: the longest is 1.34 times the mean by chunks of
//! 32³, 1.00 by octants). Files this small would be eight times as many to open, to synchronise and to keep checksums of. So a
//! chunk stays one file an array, and processes that have octants of one chunk take turns to add theirs.

use super::Lattice;
use crate::grid3;

/// A set of octants of a chunk, x fastest. A chunk of vertices is not divided: all of it or nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Octants(pub(super) u8);

impl Octants {
    /// How many a chunk has.
    pub const COUNT: usize = 8;
    /// All of them.
    pub const ALL: Self = Self(u8::MAX);
    /// None.
    pub const NONE: Self = Self(0);

    /// One octant.
    pub fn one(index: usize) -> Self {
        Self(1 << (index % Self::COUNT))
    }

    /// Those of either set.
    #[must_use]
    pub fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Those of both sets.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// Those that are not in the set.
    #[must_use]
    pub fn others(self) -> Self {
        Self(!self.0)
    }

    /// Whether every octant of another set is in this one.
    pub fn contain(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Whether there is none.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The first one.
    pub fn first(self) -> Option<usize> {
        (!self.is_empty()).then(|| self.0.trailing_zeros() as usize)
    }

    /// Whether the brick in a slot of a chunk lies in one of them.
    pub fn hold_slot(self, lattice: &Lattice, slot: usize) -> bool {
        let [nx, ny, _] = lattice.bricks_of_chunk();
        if lattice.is_of_vertices() {
            return self == Self::ALL;
        }
        let [x, y, z] = grid3::at([nx, ny], slot).map(|i| i * 2 / nx);
        self.0 >> (x + 2 * y + 4 * z) & 1 == 1
    }

    /// As a number of 8 bits.
    pub fn bits(self) -> u8 {
        self.0
    }

    /// From a number of 8 bits.
    pub fn from_bits(bits: u8) -> Self {
        Self(bits)
    }
}
