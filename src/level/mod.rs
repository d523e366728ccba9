//! Level sets of a trilinear field: rays that carry an isovalue for life, the pyramid they march,
//! the root in a cell, B-spline normals, and where a texel's level set starts. Knows nothing of
//! light, of SH and of random numbers.
//!
//! # The ray/level-set rule (sign carry, no epsilon)
//! Along a ray the tracer follows f = s·(raw − c), positive in the solid, with a state: *start*
//! (on the surface, not yet moved), *out* (lit side) or *in* (solid). Only a change from out to
//! in is a hit; an entry value above 0 while *out* is a hit at that cell face. A ray that starts on
//! its own level set has f(start) = 0 by definition, and that root is divided out of the cubic
//! ([`cell::deflate`]), so the ray can neither hit its start nor miss what lies right behind it.
//! Rays whose start points into the solid (smoothed normal against trilinear facet) may leave it
//! within [`trace::MAX_BURIED_CELLS`] cell exits; otherwise they are *lost*. Only the first ray of a path can: from a
//! hit it goes on about the normal of the trilinear facet ([`LevelField::hit_normal`]).
//!
//! # Numbers
//! All arithmetic is `f32` on raw samples, homogeneous in f: scaling the field by a power of two
//! changes no bit of a hit (as long as nothing is subnormal). Positions are a cell and a local
//! coordinate in [0, 1]³, so that precision does not fall with the size of the grid.

pub mod cell;
mod cone;
pub mod diagnose;
mod gradient;
mod horizon;
mod march;
mod pyramid;
mod root;
mod segments;
mod texel;
pub mod trace;

#[cfg(test)]
mod tests;

pub use horizon::{Horizon, MOST_BLOCKS, SLOPE};
pub(crate) use pyramid::bytes_of_field;
pub use pyramid::{BLOCK_SHIFT, Pyramid};
pub use root::Bracket;
pub use texel::Site;
pub use trace::{Counts, Crossing, Hit, LevelSet, Outcome, Start, trace_all};

use crate::geom::Normal;
use crate::volume::{Sample, Volume};
use glam::{IVec3, Mat3, Vec3, Vec4};

/// A point of the grid as a cell and a position inside it.
///
/// The cell is the index of its lowest corner, 0 ≤ cell ≤ N−2; the local position is in [0, 1]³.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellPoint {
    /// Lowest corner of the cell.
    pub cell: IVec3,
    /// Position inside the cell, 0 at the lowest corner, 1 at the highest.
    pub local: Vec3,
}

impl CellPoint {
    /// Grid position.
    pub fn in_grid(&self) -> Vec3 {
        self.cell.as_vec3() + self.local
    }
}

/// The field of a volume, ready for rays: samples in their native type, pyramid, and the linear
/// maps between grid and world.
pub struct LevelField<'v, T> {
    samples: &'v [T],
    dims: [usize; 3],
    // Offsets of the four rows of a cell: (y, z) = (0,0), (1,0), (0,1), (1,1).
    rows: [usize; 4],
    sign: f32,
    pyramid: &'v Pyramid,
    grid_from_world: Mat3,
    gradient_in_world: Mat3,
}

/// The samples of a field four times over: seen from the first corner of a cell, its four rows in x.
#[derive(Clone, Copy)]
struct Rows<'v, T>([&'v [T]; 4]);

impl<T: Sample> Rows<'_, T> {
    /// Raw samples at the eight corners of the cell whose first sample has this index: x = 0 face
    /// first, in the order of the rows.
    #[inline(always)]
    fn corners(&self, first: usize) -> (Vec4, Vec4) {
        // Written out: `array::map` is a call here, and this is the innermost loop.
        let [a, b, c, d] = self.0;
        let pair = |row: &[T]| [row[first], row[first + 1]];
        T::turned([pair(a), pair(b), pair(c), pair(d)])
    }
}

impl<'v, T: Sample> LevelField<'v, T> {
    /// Binds the samples of `volume` (which must be `samples`, the typed slice) and its pyramid.
    ///
    /// # Panics
    /// When `samples` does not have the volume's length, or the grid has fewer than two samples
    /// along an axis (such a grid has no cells; callers refuse it by name).
    pub fn new(volume: &Volume, samples: &'v [T], pyramid: &'v Pyramid) -> Self {
        let dims = volume.dims();
        assert_eq!(samples.len(), dims.iter().product::<usize>());
        assert!(dims.iter().all(|&d| d >= 2), "a grid without cells");
        let (nx, nxy) = (dims[0], dims[0] * dims[1]);
        // Only directions go through this map: its scale is free, so it is chosen to keep
        // ray parameters near 1 in any unit of length.
        let inverse = volume.world_from_grid().inverse().linear();
        let scale = inverse.x_axis.length().max(inverse.y_axis.length()).max(inverse.z_axis.length());
        let sign = volume.solid_sign();
        let gradient = volume.world_from_grid().inverse().linear().transpose() * (1.0 / scale);
        Self {
            samples,
            dims,
            rows: [0, nx, nxy, nx + nxy],
            sign,
            pyramid,
            grid_from_world: (inverse * (1.0 / scale)).as_mat3(),
            gradient_in_world: gradient.as_mat3() * sign,
        }
    }

    /// The same field with the other side as its solid: for rays inside the solid, which meet the level set from within.
    /// Its normals point inward.
    pub fn turned(&self) -> Self {
        Self { sign: -self.sign, pyramid: self.pyramid.turned(), gradient_in_world: -self.gradient_in_world, ..*self }
    }

    /// A ray's direction in grid space, of any length.
    #[inline(always)]
    pub fn direction_in_grid(&self, direction_in_world: Vec3) -> Vec3 {
        self.grid_from_world * direction_in_world
    }

    /// Grid points along each axis.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// The pyramid that it was bound with.
    pub fn pyramid(&self) -> &'v Pyramid {
        self.pyramid
    }

    /// +1 where larger raw samples are solid, −1 where smaller ones are.
    pub fn sign(&self) -> f32 {
        self.sign
    }

    /// The unit normal at a point, from the B-spline gradient, towards the lit side; `None` where
    /// the gradient vanishes. Surfaces are shaded, and texels and points looked at start, about it.
    #[inline(always)]
    pub fn normal(&self, at: &CellPoint) -> Option<Normal> {
        Normal::down_gradient(self.gradient_in_world * self.raw_gradient(at))
    }

    /// The unit normal of the surface that rays meet, at a point of it: that of the trilinear field in its cell, towards the
    /// lit side; `None` where the gradient vanishes.
    ///
    /// Paths go on about it. About the smoothed normal a part of the rays starts into the solid, and what comes out of
    /// it again brightens: with smoothed normals at hits the mean radiance under white light is further off that of the
    /// surface itself by 0.5 % (emd_3197), 0.3 (rna_1jzv), 1.5 (purkinje_neuron) and 2.1 (noisy bowl)
    /// (`probes/record/2026-11-29-xeon-2core-geometry`). Noise of single hits averages out over paths, so
    /// there is nothing to smooth; and 8 samples are read instead of 64.
    #[inline(always)]
    pub fn hit_normal(&self, at: &CellPoint) -> Option<Normal> {
        Normal::down_gradient(self.gradient_in_world * self.trilinear_gradient(at))
    }

    /// The cell point of a grid position, clamped to the box.
    pub fn locate(&self, position_in_grid: [f64; 3]) -> CellPoint {
        let mut cell = IVec3::ZERO;
        let mut local = Vec3::ZERO;
        for a in 0..3 {
            let last = self.dims[a] - 1;
            let p = position_in_grid[a].clamp(0.0, last as f64);
            let c = (p as usize).min(last - 1);
            cell[a] = c as i32;
            local[a] = (p - c as f64) as f32;
        }
        CellPoint { cell, local }
    }

    /// Index of the first sample of a cell.
    #[inline(always)]
    fn sample_index(&self, cell: &[i32; 3]) -> usize {
        cell[0] as usize + self.dims[0] * (cell[1] as usize + self.dims[1] * cell[2] as usize)
    }

    /// The samples, shifted by each of the offsets of `rows`.
    #[inline(always)]
    fn shifted_rows(&self) -> Rows<'v, T> {
        // One number for the lengths of all four: the compiler then checks an index once for all of them.
        let count = self.samples.len() - self.rows[3];
        let shifted = |r: usize| &self.samples[self.rows[r]..][..count];
        Rows([shifted(0), shifted(1), shifted(2), shifted(3)])
    }

    /// Raw samples at the eight corners of a cell.
    #[inline(always)]
    fn corners(&self, cell: IVec3) -> ([f32; 4], [f32; 4]) {
        let (low, high) = self.shifted_rows().corners(self.sample_index(&cell.to_array()));
        (low.to_array(), high.to_array())
    }

    /// Trilinear raw value at a point.
    pub fn raw_value(&self, at: &CellPoint) -> f32 {
        let (low, high) = self.corners(at.cell);
        cell::trilinear(&low, &high, at.local)
    }
}
