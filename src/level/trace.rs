//! The march of a ray to its first hit on its own level set.

use super::cell::{self, Cubic};
use super::march::March;
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
    Hit(CellPoint),
}

/// What the pyramid knows of a ray that has just entered a block.
enum Ahead {
    /// Nothing solid in any direction that the ray may still take: it escapes.
    Nothing,
    /// Nothing solid in the block of this power of two, the largest of those just entered.
    Empty(u32),
    /// The block has to be marched.
    Something,
}

/// What one cubic did to a ray.
enum Crossed {
    No(Side),
    Rise(f32),
}

impl<T: Sample> LevelField<'_, T> {
    /// Follows a ray from `start` along `direction` (grid space, any length, not zero) through the
    /// level set of the raw isovalue `isovalue` to its first hit.
    ///
    /// The start must lie in the box. The result does not depend on the length of `direction`
    /// beyond rounding; components below 2⁻¹⁰⁰ of the largest count as 0.
    #[inline]
    pub fn trace(&self, isovalue: f32, start: &Start, direction: Vec3, counts: &mut Counts) -> Outcome {
        counts.rays += 1;
        let signed = self.sign * isovalue;
        let last = self.dims.map(|n| n as i32 - 2);
        // Samples from a cell to the next along each axis.
        let mut march = March::new(&start.at, direction);
        let stride = [0, 1, 2].map(|a| if march.upper[a] == 1 { 1 } else { 1usize.wrapping_neg() });
        let stride = [stride[0], stride[1].wrapping_mul(self.rows[1]), stride[2].wrapping_mul(self.rows[2])];
        let octant = (0..3).fold(0, |octant, a| octant | usize::from(march.upper[a] == 0) << a);
        let mut side = if start.on_surface { Side::Start } else { Side::Unknown };
        let mut buried = 0u32;
        let mut sample = self.sample_index(&march.cell);
        loop {
            // Cell by cell to the border of the smallest block.
            let mut axis;
            loop {
                axis = March::first(&march.far);
                let moved = march.far[axis] > march.entered_at;
                // On the surface and not moved yet: nothing is decided in a cell of no length.
                if moved || side != Side::Start {
                    counts.cells += 1;
                    match self.pass_cell(&march, sample, axis, isovalue, side, counts) {
                        Passed::Hit(at) => return Outcome::Hit(Hit { at }),
                        Passed::On(next) => side = next,
                    }
                    // Cells of no length do not count: how many there are depends on the name of a corner.
                    if side == Side::In && moved {
                        buried += 1;
                        if buried > MAX_BURIED_CELLS {
                            return Outcome::Lost;
                        }
                    }
                }
                march.cross(axis);
                let cell = march.cell[axis];
                if cell as u32 > last[axis] as u32 {
                    // The border is open to light, not to the solid: photons that would enter here are discarded.
                    return if side == Side::In { Outcome::Lost } else { Outcome::Escaped };
                }
                sample = sample.wrapping_add(stride[axis]);
                // The first cell behind a plane between blocks.
                if (cell + 1 - march.upper[axis]) & ((1 << LEVEL_SHIFTS[0]) - 1) == 0 && side == Side::Out {
                    break;
                }
            }
            // Block by block while they hold nothing solid. The plane just crossed tells which
            // blocks are new; the others have been looked at.
            let mut skipped = false;
            loop {
                let shift = match self.ahead(&march, axis, octant, signed, counts) {
                    Ahead::Nothing => return Outcome::Escaped,
                    Ahead::Empty(shift) => shift,
                    Ahead::Something => break,
                };
                axis = march.cross_block(shift, &last);
                if march.cell[axis] as u32 > last[axis] as u32 {
                    return Outcome::Escaped;
                }
                skipped = true;
            }
            if skipped {
                march.face_cell();
                sample = self.sample_index(&march.cell);
            }
        }
    }

    /// What lies behind the plane of `axis` that was just crossed, as far as the pyramid knows.
    #[inline(always)]
    fn ahead(&self, march: &March, axis: usize, octant: usize, signed: f32, counts: &mut Counts) -> Ahead {
        let plane = march.cell[axis] + 1 - march.upper[axis];
        let alignment = plane.trailing_zeros();
        let [x, y, z] = march.cell.map(|c| c as usize);
        if alignment >= LEVEL_SHIFTS[1] {
            counts.nodes += 1;
            if self.pyramid.ahead(octant, [x, y, z]) <= signed {
                return Ahead::Nothing;
            }
        }
        for (i, shift) in LEVEL_SHIFTS.into_iter().enumerate().rev() {
            if shift > alignment {
                continue;
            }
            counts.nodes += 1;
            let level = self.pyramid.level(i);
            if level.max[level.index([x >> shift, y >> shift, z >> shift])] <= signed {
                return Ahead::Empty(shift);
            }
        }
        Ahead::Something
    }

    /// Carries the side through the cell that the march is in, with its first sample at index
    /// `sample`, and leaves through `axis`.
    #[inline(always)]
    fn pass_cell(
        &self,
        march: &March,
        sample: usize,
        axis: usize,
        isovalue: f32,
        side: Side,
        counts: &mut Counts,
    ) -> Passed {
        let (low, high) = self.corners_at(sample);
        let c = Vec4::splat(isovalue);
        let low = (Vec4::from_array(low) - c) * self.sign;
        let high = (Vec4::from_array(high) - c) * self.sign;
        if side == Side::Out && !low.max(high).cmpgt(Vec4::ZERO).any() {
            return Passed::On(Side::Out);
        }
        counts.solves += 1;
        let entry = march.entry();
        let exit = march.local(march.far[axis], axis, march.upper[axis]);
        let cubic = cell::along_segment(low, high, entry, exit);
        let crossed = if side == Side::Out { rise_after(cubic, 0.0) } else { pass_near_start(cubic, side) };
        match crossed {
            Crossed::Rise(t) => {
                let local = (entry + (exit - entry) * t).clamp(Vec3::ZERO, Vec3::ONE);
                Passed::Hit(CellPoint { cell: IVec3::from_array(march.cell), local })
            }
            Crossed::No(side) => Passed::On(side),
        }
    }
}

/// The start cell, and rays inside the solid.
#[cold]
fn pass_near_start(cubic: Cubic, side: Side) -> Crossed {
    match side {
        Side::Start => {
            let quotient = cell::deflate(cubic);
            let leading = quotient.into_iter().find(|&q| q != 0.0);
            match leading {
                Some(q) if q > 0.0 => leave_solid(quotient),
                _ => rise_after(quotient, 0.0),
            }
        }
        Side::Unknown if cubic[0] > 0.0 => leave_solid(cubic),
        Side::Unknown | Side::Out => rise_after(cubic, 0.0),
        Side::In => leave_solid(cubic),
    }
}

/// From inside: the first fall to the lit side, then perhaps a hit behind it.
fn leave_solid(cubic: Cubic) -> Crossed {
    let Some(t) = cell::first_rise(&cubic.map(|b| -b)) else {
        return Crossed::No(Side::In);
    };
    // What lies behind the crossing starts on the surface.
    rise_after(cell::deflate(cell::right_part(cubic, t)), t)
}

/// From the lit side: the first rise of the part that starts at `offset` of the segment.
#[inline(always)]
fn rise_after(cubic: Cubic, offset: f32) -> Crossed {
    match cell::first_rise(&cubic) {
        Some(t) => Crossed::Rise(offset + (1.0 - offset) * t),
        None => Crossed::No(Side::Out),
    }
}
