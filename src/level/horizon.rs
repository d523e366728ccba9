//! Proof that nothing of its level set stands above a texel's horizon, so that no ray from it can be blocked.
//!
//! # The certificate
//! In a cell f = s·(raw − c) is trilinear, and so is F = f + λd for the height d(p) = m·(p − x) over the tangent plane at
//! x and any λ > 0. A trilinear function is largest at a corner. So where F ≤ 0 at all eight corners, every solid
//! point of the cell (f > 0) lies below the plane (d < 0), and no ray that leaves x upward meets it: not in the cell of
//! the start, where facet and smoothed normal disagree, either. λ = ‖∇f(x)‖ makes F vanish to first order at x. The
//! samples of a block of cells are looked at together.
//!
//! Blocks are left out whole where the pyramid knows of no solid in them or where they lie below the plane
//! (interval bounds of the field over blocks, as in Snyder 1992, "Interval analysis for computer graphics"; the
//! certificate is ours), then where a linear upper bound of the field does the same for F; the samples of the others are
//! looked at.
//!
//! # What is promised
//! Rounding is allowed for: [`SLOPE`] is the sine of the elevation, in grid space, below which a solid point may still
//! stand. All of the hemisphere below that elevation carries SLOPE² < 10⁻⁶ of the clamped cosine, far below the
//! rounding of a stored number (5·10⁻⁴).
//!
//! A texel for which nothing is proven is not proven shaded. Inside a cell a surface that is not a plane bends upward
//! in some direction, so proofs succeed at starts on samples (textures of ratio 1) alone.

mod ceiling;

use super::pyramid::Level;
use super::{BLOCK_SHIFT, LevelField, Site};
use crate::grid3;
use crate::volume::Sample;
use ceiling::{Ceiling, Ceilings};
use glam::{DVec3, Vec3};

/// Room for rounding in the heights, in cells at a distance of one cell: samples and normals are `f32`, and differences
/// over a grid of some hundred samples keep about four digits.
const ROOM: f32 = 1.0 / 4096.0;

/// Sine of the elevation below which rounding may hide something solid: F vanishes at the start and is at most `ROOM` = 1/4096
/// at the other corners of its cells, so it grows by at most √3 times that.
pub const SLOPE: f32 = 1.733 * ROOM;

/// Blocks whose samples one proof may look at, a fraction of a microsecond each; where more are needed, it fails. A
/// choice of time, not of truth: on smooth fields 256 blocks prove no more texels (example `measure-open`).
pub const MOST_BLOCKS: u32 = 64;

/// Cells along the side of the blocks of each level, as powers of two: the pyramid's own, then larger ones.
const LEVEL_SHIFTS: [u32; 3] = [BLOCK_SHIFT, 3, 5];

/// Nodes of the levels that one proof may look at, a few nanoseconds each.
const MOST_NODES: u32 = 2048;

/// The largest values over blocks of 2^shift blocks along each axis.
fn maxima(blocks: &Level, shift: u32) -> Level {
    let dims = blocks.dims.map(|n| ((n - 1) >> shift) + 1);
    let mut larger = Level { dims, max: vec![f32::NEG_INFINITY; dims.iter().product()], min: Vec::new() };
    let [bx, by, bz] = blocks.dims;
    for (i, &max) in blocks.max.iter().enumerate().take(bx * by * bz) {
        let at = larger.index(grid3::at([bx, by], i).map(|b| b >> shift));
        larger.max[at] = larger.max[at].max(max);
    }
    larger
}

/// The tangent plane of a site in grid space.
struct Tangent {
    at: Vec3,
    /// Of length 1.
    normal: Vec3,
    /// λ.
    slope: f32,
    isovalue: f32,
    /// Room at the start, in cells.
    room: f32,
    blocks_left: u32,
    nodes_left: u32,
}

impl Tangent {
    /// Height of the highest point of a box.
    fn top(&self, low: Vec3, high: Vec3) -> f32 {
        self.normal.dot(Vec3::select(self.normal.cmpgt(Vec3::ZERO), high, low) - self.at)
    }

    /// What may stand above the plane in a box.
    fn room_in(&self, low: Vec3, high: Vec3) -> f32 {
        let distance = (low - self.at).max(self.at - high).max(Vec3::ZERO).length();
        (ROOM * distance).max(self.room)
    }
}

/// Proofs on one field. What they share, linear bounds of its blocks, is made on the way.
pub struct Horizon<'f, 'v, T> {
    field: &'f LevelField<'v, T>,
    // One for each of LEVEL_SHIFTS but the first, which the pyramid has; their minima are not used.
    larger: Vec<Level>,
    ceilings: Ceilings,
}

impl<'f, 'v, T: Sample> Horizon<'f, 'v, T> {
    /// Proofs on `field`.
    pub fn new(field: &'f LevelField<'v, T>) -> Self {
        let blocks = field.pyramid.blocks();
        let larger = LEVEL_SHIFTS[1..].iter().map(|shift| maxima(blocks, shift - BLOCK_SHIFT)).collect();
        Self { field, larger, ceilings: Ceilings::new(blocks.dims) }
    }

    fn level(&self, level: usize) -> &Level {
        if level == 0 { self.field.pyramid.blocks() } else { &self.larger[level - 1] }
    }

    /// Whether it is proven that no ray from a site into the hemisphere of its normal meets the site's level set
    /// (to within [`SLOPE`]). A pure function of the volume and the site.
    pub fn proves_open(&self, site: &Site) -> bool {
        self.proves_open_within(site, MOST_BLOCKS)
    }

    /// As [`Self::proves_open`], looking at the samples of at most `blocks` blocks.
    pub fn proves_open_within(&self, site: &Site, blocks: u32) -> bool {
        let at = &site.start.at;
        if !site.start.on_surface && self.field.sign * (self.field.raw_value(at) - site.isovalue) > 0.0 {
            return false;
        }
        // The covector of the height: Aᵀn for the map A from grid to world, of any scale.
        let normal = (self.field.grid_from_world.inverse().transpose() * site.normal.vec()).normalize_or_zero();
        let slope = self.field.raw_gradient(at).length();
        if !(normal.is_finite() && normal != Vec3::ZERO && slope > 0.0 && slope.is_finite()) {
            return false;
        }
        let position = at.in_grid();
        // At a sample F is 0 at a corner of the start's cells; elsewhere room there would be a slope of any size.
        let room = if at.local.fract() == Vec3::ZERO { ROOM } else { 0.0 };
        let (blocks_left, nodes_left) = (blocks, MOST_NODES);
        let mut tangent =
            Tangent { at: position, normal, slope, isovalue: site.isovalue, room, blocks_left, nodes_left };
        // What is near blocks most often: the neighbours, then up the pyramid from the start, then everything.
        let last = |a: usize| self.field.dims[a] - 1;
        let nearest = position.round().to_array().map(|v| v as usize);
        let around = nearest.map(|n| n.saturating_sub(1));
        let beyond = std::array::from_fn(|a| (nearest[a] + 1).min(last(a)));
        if !self.field.samples_lie_below(around, beyond, &tangent) {
            return false;
        }
        let cell = at.cell.to_array().map(|c| c as usize);
        let top = LEVEL_SHIFTS.len() - 1;
        let upward =
            (0..=top).all(|level| self.block_lies_below(level, cell.map(|c| c >> LEVEL_SHIFTS[level]), &mut tangent));
        let [bx, by, bz] = self.level(top).dims;
        let mut all = grid3::all([bx, by, bz]);
        upward && all.all(|block| self.block_lies_below(top, block, &mut tangent))
    }

    /// Whether all that is solid in a block lies below the plane; `false` too where it takes too long to tell.
    fn block_lies_below(&self, level: usize, block: [usize; 3], tangent: &mut Tangent) -> bool {
        let node = self.level(level);
        if node.max[node.index(block)] <= self.field.sign * tangent.isovalue {
            return true;
        }
        if tangent.nodes_left == 0 {
            return false;
        }
        tangent.nodes_left -= 1;
        let shift = LEVEL_SHIFTS[level];
        let first = block.map(|b| b << shift);
        // The last sample of the block.
        let end: [usize; 3] = std::array::from_fn(|a| ((block[a] + 1) << shift).min(self.field.dims[a] - 1));
        let (low, high) = (corner(first), corner(end));
        if tangent.top(low, high) <= tangent.room_in(low, high) {
            return true;
        }
        if level == 0 {
            let ceiling = self.ceilings.of(self.field, block);
            if ceiling_lies_below(&ceiling, low, high, self.field.sign * tangent.isovalue, tangent) {
                return true;
            }
            if tangent.blocks_left == 0 {
                return false;
            }
            tangent.blocks_left -= 1;
            return self.field.samples_lie_below(first, end, tangent);
        }
        let finer = LEVEL_SHIFTS[level - 1];
        let (from, to) = (first.map(|c| c >> finer), end.map(|c| c.div_ceil(1 << finer)));
        (from[2]..to[2]).all(|z| {
            (from[1]..to[1]).all(|y| (from[0]..to[0]).all(|x| self.block_lies_below(level - 1, [x, y, z], tangent)))
        })
    }
}

impl<T: Sample> LevelField<'_, T> {
    /// Whether the samples are those of a linear function, up to rounding: then every solid is a half-space and
    /// shades nothing. One pass over the samples, which ends at the first that is not.
    pub fn is_linear(&self) -> bool {
        let raw =
            |x: usize, y: usize, z: usize| f64::from(self.samples[x + self.dims[0] * (y + self.dims[1] * z)].raw());
        let last = self.dims.map(|n| n - 1);
        let origin = raw(0, 0, 0);
        let slope = DVec3::new(
            (raw(last[0], 0, 0) - origin) / last[0] as f64,
            (raw(0, last[1], 0) - origin) / last[1] as f64,
            (raw(0, 0, last[2]) - origin) / last[2] as f64,
        );
        let allowed = 0.25 * f64::from(ROOM) * slope.length();
        if !(allowed > 0.0 && allowed.is_finite()) {
            return false;
        }
        for z in 0..self.dims[2] {
            for y in 0..self.dims[1] {
                let row = origin + slope.y * y as f64 + slope.z * z as f64;
                if (0..self.dims[0]).any(|x| (raw(x, y, z) - row - slope.x * x as f64).abs() > allowed) {
                    return false;
                }
            }
        }
        true
    }

    /// Whether F leaves no more than the room at the samples of a box, both ends included. Samples all of whose cells lie
    /// below the plane do not count.
    fn samples_lie_below(&self, first: [usize; 3], end: [usize; 3], tangent: &Tangent) -> bool {
        let room = tangent.slope * tangent.room_in(corner(first), corner(end));
        let step = tangent.slope * tangent.normal;
        let start = step.dot(corner(first) - tangent.at) - room;
        // The highest point of the cells of a sample is this much higher; a little more for rounding.
        let deep = -room - 1.001 * step.abs().element_sum();
        for z in first[2]..=end[2] {
            for y in first[1]..=end[1] {
                let row = start + step.y * (y - first[1]) as f32 + step.z * (z - first[2]) as f32;
                let from = first[0] + self.dims[0] * (y + self.dims[1] * z);
                let samples = &self.samples[from..=from + end[0] - first[0]];
                let mut above = false;
                for (x, sample) in samples.iter().enumerate() {
                    let height = row + step.x * x as f32;
                    above |= (self.sign * (sample.raw() - tangent.isovalue) + height > 0.0) & (height > deep);
                }
                if above {
                    return false;
                }
            }
        }
        true
    }
}

fn corner(sample: [usize; 3]) -> Vec3 {
    Vec3::from_array(sample.map(|v| v as f32))
}

/// Whether F leaves no more than the room under a linear bound of the field over a box.
fn ceiling_lies_below(ceiling: &Ceiling, low: Vec3, high: Vec3, signed: f32, tangent: &Tangent) -> bool {
    let step = tangent.slope * tangent.normal;
    let most = (ceiling.gradient + step).max(Vec3::ZERO).dot(high - low);
    ceiling.value - signed + step.dot(low - tangent.at) + most <= tangent.slope * tangent.room_in(low, high)
}
