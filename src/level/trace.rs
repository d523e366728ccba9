//! The march of a ray to its first hit on its own level set.

use super::cell::{self, Cubic};
use super::cone::{Ahead, Cone};
use super::march::{self, Axis, March, Steps};
use super::pyramid::Level;
use super::root::{self, Bracket};
use super::{BLOCK_SHIFT, CellPoint, LevelField, Rows};
use crate::volume::Sample;
use glam::{IVec3, Vec3, Vec4};
use multiversion::multiversion;

/// A ray that starts inside the solid may leave it within this many cell exits, else it is lost.
///
/// Smoothed normals and trilinear facets disagree by a few degrees, so such starts are shallow. More exits let light
/// leak through thin walls, none darkens where walls are a cell thick. Compared with paths on the trilinear surface
/// itself (`probes/record/2026-11-29-xeon-2core-geometry`), 4, 1 and 0 are off by 3.8, 3.1 and 1.8 % in the mean under
/// white light on purkinje_neuron, by −0.1, −1.1 and −2.9 % under the courtyard, and by 0.4, 0.2 and −0.4 % on rna_1jzv.
pub const MAX_BURIED_CELLS: u32 = 1;

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

/// A hit whose place within one cell is still to be computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    cell: IVec3,
    // Where the ray enters and leaves the cell, in its local coordinates.
    entry: Vec3,
    exit: Vec3,
    // The bracket is a part of the segment from here to its end.
    offset: f32,
    bracket: Bracket,
}

impl Crossing {
    /// The hit.
    pub fn hit(&self) -> Hit {
        self.at(self.bracket.root())
    }

    /// The [`Self::hit`] of each crossing, appended to `found`: the same bits in less time.
    #[inline(always)]
    pub fn hits(crossings: &[Self], found: &mut Vec<Hit>) {
        for some in crossings.chunks(root::LANES) {
            // A block that is not full repeats its first one.
            let mut brackets = [some[0].bracket; root::LANES];
            for (bracket, crossing) in brackets.iter_mut().zip(some) {
                *bracket = crossing.bracket;
            }
            found.extend(some.iter().zip(root::roots(&brackets)).map(|(crossing, root)| crossing.at(root)));
        }
    }

    #[inline(always)]
    fn at(&self, root: f32) -> Hit {
        let t = self.offset + (1.0 - self.offset) * root;
        let local = (self.entry + (self.exit - self.entry) * t).clamp(Vec3::ZERO, Vec3::ONE);
        Hit { at: CellPoint { cell: self.cell, local } }
    }
}

/// What became of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome<H = Hit> {
    /// It reached the border of the box on the lit side.
    Escaped,
    /// It met its level set from the lit side.
    Hit(H),
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
    Hit(Crossing),
}

/// What one cubic did to a ray.
enum Crossed {
    No(Side),
    // In the part of the segment from the number on.
    Rise(f32, Bracket),
}

/// The level set of one isovalue, with what all its rays look up.
pub struct LevelSet<'f, T> {
    field: &'f LevelField<'f, T>,
    isovalue: f32,
    // s·isovalue.
    signed: f32,
    rows: Rows<'f, T>,
    blocks: &'f Level,
    ahead: &'f Ahead,
    rank: f32,
}

impl<T: Sample> LevelField<'_, T> {
    /// The level set of a raw isovalue.
    #[inline(always)]
    pub fn level_set(&self, isovalue: f32) -> LevelSet<'_, T> {
        let (signed, ahead) = (self.sign * isovalue, self.pyramid.ahead());
        LevelSet {
            field: self,
            isovalue,
            signed,
            rows: self.shifted_rows(),
            blocks: self.pyramid.blocks(),
            ahead,
            rank: ahead.rank(signed),
        }
    }

    /// Follows a ray from `start` along `direction` (grid space, any length, not zero) through the
    /// level set of the raw isovalue `isovalue` to its first hit.
    ///
    /// The start must lie in the box. The result does not depend on the length of `direction`
    /// beyond rounding; components below 2⁻¹⁰⁰ of the largest count as 0.
    #[inline]
    pub fn trace(&self, isovalue: f32, start: &Start, direction: Vec3, counts: &mut Counts) -> Outcome {
        match self.level_set(isovalue).first_crossing(start, direction, counts) {
            Outcome::Escaped => Outcome::Escaped,
            Outcome::Hit(crossing) => Outcome::Hit(crossing.hit()),
            Outcome::Lost => Outcome::Lost,
        }
    }
}

impl<T: Sample> LevelSet<'_, T> {
    /// As [`LevelField::trace`], but leaves the place of the hit to [`Crossing::hits`], which finds those of several rays
    /// together.
    #[inline(always)]
    pub fn first_crossing(&self, start: &Start, direction: Vec3, counts: &mut Counts) -> Outcome<Crossing> {
        counts.rays += 1;
        let (field, signed, blocks) = (self.field, self.signed, self.blocks);
        let mut march = March::new(&start.at, direction, field.dims);
        let octant = march.octant();
        let first_sample = field.sample_index(&start.at.cell.to_array());
        let sample_steps = Steps::new([1, field.rows[1], field.rows[2]], octant);
        let block_steps = Steps::new([1, blocks.dims[0], blocks.dims[0] * blocks.dims[1]], octant);
        let cone = Cone::of(octant, march.slope());
        let mut sample = first_sample;
        let mut block = blocks.index(start.at.cell.to_array().map(|c| (c >> BLOCK_SHIFT) as usize));
        let mut side = if start.on_surface { Side::Start } else { Side::Unknown };
        let mut buried = 0u32;
        loop {
            // Cell by cell until it comes into a block that holds nothing solid. Most rays leave a block after a number of
            // cells that no branch predictor foresees, so that is no branch.
            loop {
                let axis = march::first(march.far);
                let t = march.far.min_element();
                if side == Side::Out {
                    counts.cells += 1;
                    if self.may_hold_solid(sample)
                        && let Passed::Hit(crossing) = self.pass_cell(&march, sample, t, axis, side, counts)
                    {
                        return Outcome::Hit(crossing);
                    }
                } else {
                    let moved = t > march.entered_at;
                    // On the surface and not moved yet: nothing is decided in a cell of no length.
                    if moved || side != Side::Start {
                        counts.cells += 1;
                        match self.pass_cell(&march, sample, t, axis, side, counts) {
                            Passed::Hit(crossing) => return Outcome::Hit(crossing),
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
                }
                sample = sample.wrapping_add(sample_steps.along(axis));
                let left = march.cross(t, axis);
                if !march.next_block(left) {
                    // The border is open to light, not to the solid: photons that would enter here are discarded.
                    return if side == Side::In { Outcome::Lost } else { Outcome::Escaped };
                }
                block = block.wrapping_add(block_steps.along(left));
                if side == Side::Out {
                    counts.nodes += u64::from(left.bitmask().count_ones());
                    if blocks.max[block] <= signed {
                        break;
                    }
                }
            }
            // Block by block while they hold nothing solid.
            loop {
                if self.ahead.nothing(block, cone, self.rank) {
                    return Outcome::Escaped;
                }
                let axis = march.cross_block();
                if !march.next_block(axis) {
                    return Outcome::Escaped;
                }
                block = block.wrapping_add(block_steps.along(axis));
                counts.nodes += 1;
                if blocks.max[block] > signed {
                    break;
                }
            }
            march.enter();
            sample = first_sample.wrapping_add(sample_steps.times(march.passed()));
        }
    }

    /// Whether a sample of the cell with this first sample is above the isovalue.
    #[inline(always)]
    fn may_hold_solid(&self, sample: usize) -> bool {
        let (low, high) = self.rows.corners(sample);
        // raw − c > 0 is raw > c in every case, and so with both signs turned.
        let (low, high) = (low * self.field.sign, high * self.field.sign);
        low.max(high).cmpgt(Vec4::splat(self.signed)).any()
    }

    /// Carries the side through the cell that the march is in, with its first sample at index
    /// `sample`, and leaves through `axis` at `t`.
    #[inline(always)]
    fn pass_cell(&self, march: &March, sample: usize, t: f32, axis: Axis, side: Side, counts: &mut Counts) -> Passed {
        let (low, high) = self.rows.corners(sample);
        let c = Vec4::splat(self.isovalue);
        let (low, high) = ((low - c) * self.field.sign, (high - c) * self.field.sign);
        counts.solves += 1;
        let entry = march.entry();
        let exit = march.exit_at(t, axis);
        let cubic = cell::along_segment(low, high, entry, exit);
        let crossed = if side == Side::Out { rise_after(cubic, 0.0) } else { pass_near_start(cubic, side) };
        match crossed {
            Crossed::Rise(offset, bracket) => {
                Passed::Hit(Crossing { cell: march.cell(), entry, exit, offset, bracket })
            }
            Crossed::No(side) => Passed::On(side),
        }
    }
}

/// Rays of [`trace_all`] that are marched before the places of their hits are computed together.
const BLOCK: usize = 64;

/// The [`LevelField::trace`] of each ray, a start and a direction, appended to `outcomes`: the same bits in less time.
///
/// Compiled for what processors have. No variant uses fused multiply-add: all give the same bits.
#[multiversion(targets(
    "x86_64+avx+avx2+bmi1+bmi2+lzcnt+popcnt+avx512f+avx512vl+avx512dq+avx512bw",
    "x86_64+avx+avx2+bmi1+bmi2+lzcnt+popcnt"
))]
pub fn trace_all<T: Sample>(
    field: &LevelField<'_, T>,
    isovalue: f32,
    rays: &[(Start, Vec3)],
    counts: &mut Counts,
    outcomes: &mut Vec<Outcome>,
) {
    let level_set = field.level_set(isovalue);
    let (mut crossings, mut hits) = (Vec::with_capacity(BLOCK), Vec::with_capacity(BLOCK));
    for block in rays.chunks(BLOCK) {
        crossings.clear();
        hits.clear();
        let first = outcomes.len();
        for (start, direction) in block {
            outcomes.push(match level_set.first_crossing(start, *direction, counts) {
                Outcome::Escaped => Outcome::Escaped,
                Outcome::Lost => Outcome::Lost,
                Outcome::Hit(crossing) => {
                    crossings.push(crossing);
                    // Its place is set below.
                    Outcome::Hit(Hit { at: start.at })
                }
            });
        }
        Crossing::hits(&crossings, &mut hits);
        let mut hits = hits.iter();
        for outcome in &mut outcomes[first..] {
            if let Outcome::Hit(hit) = outcome
                && let Some(found) = hits.next()
            {
                *hit = *found;
            }
        }
    }
}

/// The start cell, and rays inside the solid.
#[inline(always)]
fn pass_near_start(cubic: Cubic, side: Side) -> Crossed {
    let (cubic, starts_inside) = match side {
        Side::Start => {
            let q = cell::deflate(cubic);
            // By the first coefficient that is not 0.
            let first = |a: f32, b: f32| if a != 0.0 { a } else { b };
            (q, first(first(q[0], q[1]), first(q[2], q[3])) > 0.0)
        }
        Side::Unknown => (cubic, cubic[0] > 0.0),
        Side::Out => (cubic, false),
        Side::In => (cubic, true),
    };
    if starts_inside { leave_solid(cubic) } else { rise_after(cubic, 0.0) }
}

/// From inside: the first fall to the lit side, then perhaps a hit behind it.
#[cold]
fn leave_solid(cubic: Cubic) -> Crossed {
    let Some(fall) = cell::first_rise(&cubic.map(|b| -b)) else {
        return Crossed::No(Side::In);
    };
    let t = fall.root();
    // What lies behind the crossing starts on the surface.
    rise_after(cell::deflate(cell::right_part(cubic, t)), t)
}

/// From the lit side: the first rise of the part that starts at `offset` of the segment.
#[inline(always)]
fn rise_after(cubic: Cubic, offset: f32) -> Crossed {
    match cell::first_rise(&cubic) {
        Some(bracket) => Crossed::Rise(offset, bracket),
        None => Crossed::No(Side::Out),
    }
}
