//! The ray as a march through integer cells and blocks.
//!
//! The parameter at a grid plane is computed from the plane and the start each time, never
//! accumulated, and planes are passed in the order of (parameter, axis). So a ray visits a connected
//! chain of cells, whatever rounding does, values at the shared faces agree in sign up to the sign
//! carry, and a block that holds nothing is left into the very cell that a march through all its
//! cells would come to: the pyramid changes no bit of a hit.

use super::CellPoint;
use glam::{IVec3, Vec3};

/// A component of a direction below this part of the largest is 0. Over any grid it amounts to
/// nothing, and its inverse times the size of any grid is still a number.
const PARALLEL: f32 = 1.0 / (1u128 << 100) as f32;

/// A ray in grid space and the cell it is in. Parameters are measured from the start cell, so that
/// their precision does not fall with the size of the grid.
pub(super) struct March {
    origin: Vec3,
    direction: Vec3,
    start: [i32; 3],
    pub(super) cell: [i32; 3],
    // The parameter of a plane p is (p − plane_origin)·inverse; for an axis whose planes are never
    // met these are −∞ and 1.
    plane_origin: [f32; 3],
    inverse: [f32; 3],
    // ±1; 1 where the far plane of a cell is its upper one, else 0.
    pub(super) step: [i32; 3],
    pub(super) upper: [i32; 3],
    // Parameters of the far planes of the cell.
    pub(super) far: [f32; 3],
    // Where it entered the cell, and through which axis; 3 at the start.
    pub(super) entered_at: f32,
    entered_axis: usize,
}

impl March {
    #[inline(always)]
    pub(super) fn new(start: &CellPoint, direction: Vec3) -> Self {
        // The largest component comes to [1, 2), by a power of two: exact, and no parameter overflows.
        let exponent = (direction.abs().max_element().to_bits() >> 23) as i32 - 127;
        let direction = direction * f32::from_bits(((127 - exponent.clamp(-126, 126)) as u32) << 23);
        let parallel = direction.abs().cmplt(Vec3::splat(PARALLEL));
        let direction = Vec3::select(parallel, Vec3::ZERO, direction);
        let backward = [direction.x < 0.0, direction.y < 0.0, direction.z < 0.0];
        let mut march = Self {
            origin: start.local,
            direction,
            start: start.cell.to_array(),
            cell: start.cell.to_array(),
            plane_origin: Vec3::select(parallel, Vec3::NEG_INFINITY, start.local).to_array(),
            inverse: Vec3::select(parallel, Vec3::ONE, direction.recip()).to_array(),
            step: backward.map(|b| if b { -1 } else { 1 }),
            upper: backward.map(|b| i32::from(!b)),
            far: [0.0; 3],
            entered_at: 0.0,
            entered_axis: 3,
        };
        march.face_cell();
        march
    }

    /// Parameter at which the ray meets the plane `plane` of `axis`.
    #[inline(always)]
    fn at_plane(&self, axis: usize, plane: i32) -> f32 {
        ((plane - self.start[axis]) as f32 - self.plane_origin[axis]) * self.inverse[axis]
    }

    /// Sets the parameters of the far planes of the cell.
    #[inline(always)]
    pub(super) fn face_cell(&mut self) {
        for a in 0..3 {
            self.far[a] = self.at_plane(a, self.cell[a] + self.upper[a]);
        }
    }

    /// The axis of the plane that comes first; in a tie x before y before z.
    #[inline(always)]
    pub(super) fn first(far: &[f32; 3]) -> usize {
        let (least, axis) = if far[1] < far[0] { (far[1], 1) } else { (far[0], 0) };
        if far[2] < least { 2 } else { axis }
    }

    /// Where in its cell the ray is at `t`, when it passes a plane of `axis` there; `face` is 1 on
    /// the upper plane.
    #[inline(always)]
    pub(super) fn local(&self, t: f32, axis: usize, face: i32) -> Vec3 {
        let cell = IVec3::from_array(self.cell) - IVec3::from_array(self.start);
        let mut local = (self.origin + self.direction * t - cell.as_vec3()).clamp(Vec3::ZERO, Vec3::ONE);
        local[axis] = face as f32;
        local
    }

    /// Where it entered the cell.
    #[inline(always)]
    pub(super) fn entry(&self) -> Vec3 {
        if self.entered_axis == 3 {
            return self.origin;
        }
        self.local(self.entered_at, self.entered_axis, 1 - self.upper[self.entered_axis])
    }

    /// Steps into the next cell through `axis`.
    #[inline(always)]
    pub(super) fn cross(&mut self, axis: usize) {
        self.entered_at = self.far[axis];
        self.entered_axis = axis;
        self.cell[axis] += self.step[axis];
        self.far[axis] = self.at_plane(axis, self.cell[axis] + self.upper[axis]);
    }

    /// Steps out of the block of side 2^`shift` that holds the cell, clipped to the box, and says
    /// through which axis. Leaves `far` behind; see [`Self::face_cell`].
    ///
    /// The cell behind it is the one that a march through every cell would be in: along the other
    /// axes just those planes lie behind that come before (t, axis) in the order of [`Self::first`].
    #[inline(always)]
    pub(super) fn cross_block(&mut self, shift: u32, last: &[i32; 3]) -> usize {
        let mut planes = [0; 3];
        let mut leave = [0.0; 3];
        for a in 0..3 {
            let base = self.cell[a] >> shift << shift;
            planes[a] = if self.upper[a] == 1 { (base + (1 << shift)).min(last[a] + 1) } else { base };
            leave[a] = self.at_plane(a, planes[a]);
        }
        let axis = Self::first(&leave);
        let t = leave[axis];
        for a in 0..3 {
            let (near, far) = (self.cell[a], planes[a] - self.upper[a]);
            if a == axis {
                self.cell[a] = far + self.step[a];
            } else if self.direction[a] != 0.0 {
                // An estimate by position, then made right; it is right but for rounding. The
                // position is not below 0, so that truncation is the floor.
                let position = self.origin[a] + self.direction[a] * t;
                let guess = (position + (self.start[a] - near.min(far)) as f32) as i32 + near.min(far);
                let before = |plane: f32| plane < t || (plane == t && a < axis);
                let mut cell = guess.clamp(near.min(far), near.max(far));
                while cell != near && !before(self.at_plane(a, cell + 1 - self.upper[a])) {
                    cell -= self.step[a];
                }
                while cell != far && before(self.at_plane(a, cell + self.upper[a])) {
                    cell += self.step[a];
                }
                self.cell[a] = cell;
            }
        }
        self.entered_at = t;
        self.entered_axis = axis;
        axis
    }
}
