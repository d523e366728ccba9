//! What lies ahead of a ray, by cones of directions: whether one that has come as far as a block can
//! still meet anything solid.
//!
//! The directions of an octant are split by their largest component: 24 cones in all. For each cone and
//! block the table holds the maximum of s·raw over all that a ray of the cone can meet from the block
//! on. Rays of an isovalue that is not below it escape.
//!
//! A ray of a cone goes from slab to slab across the largest component, and shifts by at most one block along
//! each of the others meanwhile. So what it can meet from a block on lies in the four blocks of its slab
//! that it can still come to, and behind the four of the next.

use super::pyramid::Level;
use glam::Vec3;

/// Cones, in octants (bit a set: falling along axis a) and by largest component. Finer ones cost more in the
/// cache than they save.
const CONES: usize = 24;

/// Directions nearer than this to the side of a cone (as a part of the largest component) belong to none and go
/// without the table. It exceeds what rounding may move a ray over any grid, by the width of a block.
const MARGIN: f32 = 1.0 / 1024.0;

/// The cone of a direction, or none.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cone(usize);

/// Of a direction without a cone.
const NONE: usize = usize::MAX;

impl Cone {
    /// The cone of a direction with components of these sizes in an octant.
    #[inline(always)]
    pub(super) fn of(octant: usize, slope: Vec3) -> Self {
        let Vec3 { x, y, z } = slope;
        // Without branches, which random directions mispredict.
        let major = if y > x.max(z) { 1 } else { 0 } + if z > x.max(y) { 2 } else { 0 };
        let largest = x.max(y).max(z);
        let second = x.max(y).min(x.max(z)).min(y.max(z));
        if second < largest * (1.0 - MARGIN) { Self(3 * octant + major) } else { Self(NONE) }
    }
}

/// The table.
#[derive(Clone, Debug)]
pub(super) struct Ahead {
    // By block and cone, [block][cone].
    ranks: Vec<u16>,
    // The rank of a value is (value − lowest)·scale, in the table rounded up: half the bytes of a number.
    lowest: f32,
    scale: f32,
}

impl Ahead {
    pub(super) fn new(level: &Level) -> Self {
        let (lowest, highest) =
            level.max.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), &v| (l.min(v), h.max(v)));
        // One less than the type holds, so that rounding up does not come out above it.
        let scale = f32::from(u16::MAX - 1) / (highest - lowest);
        let scale = if scale.is_finite() { scale } else { 0.0 };
        let mut ahead = Self { ranks: Vec::new(), lowest, scale };
        let own: Vec<u16> = level.max.iter().map(|&v| ahead.rank(v).ceil() as u16).collect();
        ahead.ranks = vec![0; own.len() * CONES];
        for cone in 0..CONES {
            fill(&own, level.dims, cone, &mut ahead.ranks);
        }
        ahead
    }

    /// The rank of a value; it never falls as the value rises.
    #[inline(always)]
    pub(super) fn rank(&self, signed: f32) -> f32 {
        (signed - self.lowest) * self.scale
    }

    /// Whether a ray of the cone meets nothing above an isovalue of this rank from the block on.
    #[inline(always)]
    pub(super) fn nothing(&self, block: usize, cone: Cone, rank: f32) -> bool {
        // A lower rank proves a lower value; an equal one does not.
        cone.0 != NONE && f32::from(self.ranks[block * CONES + cone.0]) < rank
    }
}

/// Writes the ranks of one cone, given those of the blocks themselves.
fn fill(own: &[u16], dims: [usize; 3], cone: usize, ranks: &mut [u16]) {
    let (octant, major) = (cone / 3, cone % 3);
    let axes = [major, (major + 1) % 3, (major + 2) % 3];
    let size = axes.map(|a| dims[a]);
    // Turned so that the ray rises along all axes, the major one first.
    let stride = [1, dims[0], dims[0] * dims[1]];
    let along = |k: usize, at: usize| {
        let a = axes[k];
        stride[a] * if octant >> a & 1 == 1 { dims[a] - 1 - at } else { at }
    };
    // The largest rank from the slab behind on, by block; nothing behind the last, and beyond the sides.
    let width = size[1] + 1;
    let mut ahead = vec![0u16; width * (size[2] + 1)];
    for s in (0..size[0]).rev() {
        for v in 0..size[2] {
            for u in 0..size[1] {
                let at = u + width * v;
                ahead[at] = ahead[at].max(own[along(0, s) + along(1, u) + along(2, v)]);
            }
        }
        // In place: each block looks only at those that come after it.
        for v in 0..size[2] {
            for u in 0..size[1] {
                let at = u + width * v;
                ahead[at] = ahead[at].max(ahead[at + 1]).max(ahead[at + width]).max(ahead[at + width + 1]);
                ranks[CONES * (along(0, s) + along(1, u) + along(2, v)) + cone] = ahead[at];
            }
        }
    }
}
