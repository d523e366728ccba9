//! The march of a ray to its first hit on its own level set.
//!
//! Integer cells and blocks: the ray's parameter at a grid plane is computed from the plane and
//! the start each time, never accumulated, and on leaving a block the coordinates that did not
//! change block are clamped to it. So a ray visits a connected chain of cells, whatever rounding
//! does, and values at the shared faces agree in sign up to the sign carry.

use super::cell::{self, Cubic};
use super::{CellPoint, LEVEL_SHIFTS, LevelField};
use crate::volume::Sample;
use glam::{IVec3, Vec3, Vec4};

/// A ray that starts inside the solid may leave it within this many cell exits, else it is lost.
///
/// Smoothed normals and trilinear facets disagree by a few degrees, so such starts are shallow.
/// Fewer exits darken, more let light leak through thin walls.
pub const MAX_BURIED_CELLS: u32 = 4;

/// Where a ray starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Start {
    /// The point.
    pub at: CellPoint,
    /// Whether the point is on the ray's own level set; then f = 0 there by definition.
    pub on_surface: bool,
}

impl Start {
    /// A start on the ray's own level set.
    pub fn on(at: CellPoint) -> Self {
        Self { at, on_surface: true }
    }

    /// A start whose value of f is whatever the field says: below 0 the ray is out, above in.
    pub fn beside(at: CellPoint) -> Self {
        Self { at, on_surface: false }
    }
}

/// A hit of the level set from the lit side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Where.
    pub at: CellPoint,
}

/// What became of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    /// It reached the border of the box on the lit side.
    Escaped,
    /// It met its level set from the lit side.
    Hit(Hit),
    /// It started inside the solid and did not get out, within [`MAX_BURIED_CELLS`] or before the border.
    Lost,
}

/// Work done, for records and for proofs that something was not done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Rays traced.
    pub rays: u64,
    /// Blocks looked at.
    pub nodes: u64,
    /// Cells whose samples were read.
    pub cells: u64,
    /// Cells whose cubic was formed.
    pub solves: u64,
}

impl std::ops::AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        self.rays += other.rays;
        self.nodes += other.nodes;
        self.cells += other.cells;
        self.solves += other.solves;
    }
}

/// The carried sign.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Side {
    /// On the surface, not moved yet: f is 0 here whatever the samples say.
    Start,
    /// As `Start`, but the field decides the side.
    Unknown,
    /// Lit side.
    Out,
    /// In the solid.
    In,
}

/// What one cell did to a ray.
enum Passed {
    On(Side),
    Hit(f32),
}

/// A ray in grid space, relative to its start cell.
struct March {
    origin: Vec3,
    inverse: Vec3,
    step: IVec3,
}

impl March {
    /// Parameter at which the ray meets the plane `plane` (relative to the start cell) of `axis`.
    #[inline(always)]
    fn at_plane(&self, axis: usize, plane: i32) -> f32 {
        (plane as f32 - self.origin[axis]) * self.inverse[axis]
    }
}

impl<T: Sample> LevelField<'_, T> {
    /// Follows a ray from `start` along `direction` (grid space, any length, not zero) through the
    /// level set of the raw isovalue `isovalue` to its first hit.
    ///
    /// The start must lie in the box. The result does not depend on the length of `direction`
    /// beyond rounding; components below 2⁻¹²⁴ count as 0, so one must be larger.
    #[inline]
    pub fn trace(&self, isovalue: f32, start: &Start, direction: Vec3, counts: &mut Counts) -> Outcome {
        counts.rays += 1;
        let signed = self.sign * isovalue;
        let cell0 = start.at.cell;
        let mut march = March { origin: start.at.local, inverse: direction.recip(), step: IVec3::ONE };
        // First and last cell of the box, relative to the start cell.
        let lowest = -cell0;
        let highest = IVec3::new(self.dims[0] as i32 - 2, self.dims[1] as i32 - 2, self.dims[2] as i32 - 2) - cell0;
        for a in 0..3 {
            if direction[a] < 0.0 {
                march.step[a] = -1;
            }
        }
        // Never meets a plane of such an axis.
        let parallel = direction.abs().cmplt(Vec3::splat(f32::MIN_POSITIVE * 4.0));
        let mut side = if start.on_surface { Side::Start } else { Side::Unknown };
        let mut buried = 0u32;
        let mut cell = IVec3::ZERO;
        let mut entry = start.at.local;
        let mut entered_at = 0.0f32;
        // The coarsest level whose block has not been looked at since it was entered, plus one.
        let mut untested = LEVEL_SHIFTS.len();
        loop {
            // Which block may be skipped?
            let mut shift = 0;
            if side == Side::Out || side == Side::Start {
                let absolute = cell + cell0;
                while untested > 0 {
                    let level = self.pyramid.level(untested - 1);
                    let s = LEVEL_SHIFTS[untested - 1];
                    counts.nodes += 1;
                    let at = level.index([
                        (absolute.x >> s) as usize,
                        (absolute.y >> s) as usize,
                        (absolute.z >> s) as usize,
                    ]);
                    if level.max[at] <= signed {
                        shift = s;
                        break;
                    }
                    untested -= 1;
                }
            } else {
                untested = 0;
            }
            // Where does the ray leave the block or cell?
            let base = if shift == 0 { cell } else { (((cell + cell0) >> shift) << shift) - cell0 };
            let far = base + IVec3::splat(1 << shift);
            let planes = IVec3::new(
                if march.step.x > 0 { far.x } else { base.x },
                if march.step.y > 0 { far.y } else { base.y },
                if march.step.z > 0 { far.z } else { base.z },
            );
            let mut leave =
                Vec3::new(march.at_plane(0, planes.x), march.at_plane(1, planes.y), march.at_plane(2, planes.z));
            leave = Vec3::select(parallel, Vec3::INFINITY, leave);
            let axis = if leave.x <= leave.y {
                if leave.x <= leave.z { 0 } else { 2 }
            } else if leave.y <= leave.z {
                1
            } else {
                2
            };
            let left_at = leave[axis].max(entered_at);
            let plane = planes[axis];
            let at_exit = march.origin + direction * left_at;

            if shift == 0 {
                counts.cells += 1;
                let mut exit = (at_exit - cell.as_vec3()).clamp(Vec3::ZERO, Vec3::ONE);
                exit[axis] = if march.step[axis] > 0 { 1.0 } else { 0.0 };
                match self.pass_cell(cell + cell0, isovalue, entry, exit, side, left_at > entered_at, counts) {
                    Passed::Hit(t) => {
                        let local = (entry + (exit - entry) * t).clamp(Vec3::ZERO, Vec3::ONE);
                        return Outcome::Hit(Hit { at: CellPoint { cell: cell + cell0, local } });
                    }
                    Passed::On(next) => side = next,
                }
                // Cells of no length do not count: how many there are depends on the name of a corner.
                if side == Side::In && left_at > entered_at {
                    buried += 1;
                    if buried > MAX_BURIED_CELLS {
                        return Outcome::Lost;
                    }
                }
            }

            // Step over the plane.
            let next = if march.step[axis] > 0 { plane } else { plane - 1 };
            if next < lowest[axis] || next > highest[axis] {
                // The border is open to light, not to the solid: photons that would enter here are discarded.
                return if side == Side::In { Outcome::Lost } else { Outcome::Escaped };
            }
            if shift == 0 {
                cell[axis] = next;
            } else {
                // Truncation is the floor for what lies in the block; the clamp mends the rest.
                if left_at > entered_at {
                    side = Side::Out;
                }
                let inside = (at_exit - base.as_vec3()).as_ivec3() + base;
                cell = inside.clamp(base, (far - IVec3::ONE).min(highest));
                cell[axis] = next;
            }
            entered_at = left_at;
            entry = (at_exit - cell.as_vec3()).clamp(Vec3::ZERO, Vec3::ONE);
            entry[axis] = if march.step[axis] > 0 { 0.0 } else { 1.0 };
            // The plane just crossed tells which blocks are new.
            let alignment = (plane + cell0[axis]).trailing_zeros();
            untested = untested.max(LEVEL_SHIFTS.iter().filter(|&&s| alignment >= s).count());
        }
    }

    /// Carries the side through one cell, from `entry` to `exit` (local).
    #[inline(always)]
    fn pass_cell(
        &self,
        cell: IVec3,
        isovalue: f32,
        entry: Vec3,
        exit: Vec3,
        side: Side,
        moved: bool,
        counts: &mut Counts,
    ) -> Passed {
        let (low, high) = self.corners(cell);
        let c = Vec4::splat(isovalue);
        let low = (Vec4::from_array(low) - c) * self.sign;
        let high = (Vec4::from_array(high) - c) * self.sign;
        if side == Side::Out && low.max(high).max_element() <= 0.0 {
            return Passed::On(Side::Out);
        }
        counts.solves += 1;
        let cubic = cell::along_segment(low, high, entry, exit);
        if side == Side::Out {
            return match cell::first_rise(&cubic) {
                Some(t) => Passed::Hit(t),
                None => Passed::On(Side::Out),
            };
        }
        Self::pass_near_start(cubic, side, moved)
    }

    /// The rare part of [`Self::pass_cell`]: the start cell, and rays inside the solid.
    #[cold]
    fn pass_near_start(cubic: Cubic, side: Side, moved: bool) -> Passed {
        match side {
            // A path of no length through a corner or edge: nothing is decided yet.
            Side::Start if !moved => Passed::On(Side::Start),
            Side::Start => {
                let quotient = cell::deflate(cubic);
                let leading = quotient.into_iter().find(|&q| q != 0.0);
                match leading {
                    Some(q) if q > 0.0 => leave_solid(quotient, 0.0),
                    _ => rise_after(quotient, 0.0),
                }
            }
            Side::Unknown if cubic[0] > 0.0 => leave_solid(cubic, 0.0),
            Side::Unknown | Side::Out => rise_after(cubic, 0.0),
            Side::In => leave_solid(cubic, 0.0),
        }
    }
}

/// From inside: the first fall to the lit side on [offset, 1], then perhaps a hit behind it.
fn leave_solid(cubic: Cubic, offset: f32) -> Passed {
    let Some(t) = cell::first_rise(&cubic.map(|b| -b)) else {
        return Passed::On(Side::In);
    };
    // What lies behind the crossing starts on the surface.
    let rest = cell::deflate(cell::right_part(cubic, t));
    rise_after(rest, offset + (1.0 - offset) * t)
}

/// From the lit side: the first rise of the part that starts at `offset` of the segment.
fn rise_after(cubic: Cubic, offset: f32) -> Passed {
    match cell::first_rise(&cubic) {
        Some(t) => Passed::Hit(offset + (1.0 - offset) * t),
        None => Passed::On(Side::Out),
    }
}
