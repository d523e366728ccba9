//! Isosurfaces as triangle meshes: marching cubes with the topology of the trilinear interpolant,
//! welded, oriented, closed up to the border of the grid. Knows nothing of light.
//!
//! # What is promised
//! * *Topology.* In each cell the surface is homeomorphic to the level set of the trilinear
//!   function of the eight samples: faces by the asymptotic decider, tunnels by an interior test.
//! * *Closed and manifold.* Every edge has two triangles, in opposite directions; edges with
//!   one triangle lie on the faces of the grid's box, where the surface is open. This holds for
//!   all samples and isovalues, rounding included: what two cells share is decided by the same
//!   operations on the same numbers.
//! * *Solid and lit.* A sample is solid where `solid_sign·(raw − c_raw) > 0`, strictly; one that
//!   equals the isovalue is lit. The front of a triangle, counter-clockwise in **world** space,
//!   looks to the lit side, for left-handed affines too.
//! * *Position.* A vertex on a grid edge is within 1e-4 voxel of where the interpolant has the
//!   isovalue (grids up to 1024 samples along an axis; beyond that, one step of f32). Crossings
//!   keep at least 2⁻¹⁴ voxel from grid points, so no triangle is degenerate. Some contours need
//!   a vertex inside the cell; it is moved onto the level set by Newton steps where that succeeds.
//! * *Order.* The same bytes for any number of threads.
//!
//! # Sources
//! Lorensen & Cline 1987, "Marching cubes"; Nielson & Hamann 1991, "The asymptotic decider";
//! Chernyaev 1995, "Marching Cubes 33", CERN CN/95-17; Lopes & Brodlie 2003, "Improving the
//! robustness and accuracy of the marching cubes algorithm for isosurfacing"; Nielson 2003, "On
//! marching cubes". The tables are generated here from the contours of the faces (`table`); the
//! interior test is one test along one axis for all cases (`decide`).

mod cell;
mod decide;
mod fill;
mod normals;
mod on_model;
mod signs;
mod statistics;
mod table;
mod triangulate;

#[cfg(test)]
mod reference;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod watertight;

pub(crate) use cell::{edge_corners, face_corners};
pub(crate) use fill::triangles_of_cell;
pub(crate) use signs::count_straddling_cells;
pub use signs::{StraddlingCells, straddling_cells};
pub use statistics::{MeshStatistics, mesh_statistics};

use crate::error::{Error, Result};
use crate::level::{LevelField, Pyramid};
use crate::volume::{Volume, with_samples};

/// An indexed triangle mesh on the grid of a volume.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions in grid space; [`Volume::world_from_grid`] takes them to world.
    pub positions_in_grid: Vec<[f32; 3]>,
    /// A unit normal in world axes for each vertex; points to the lit side.
    pub normals: Vec<[f32; 3]>,
    /// Vertex numbers; counter-clockwise in world space as seen from the lit side.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// The same surface with its vertices along a Morton curve through the cells of the grid, and triangles by their first
    /// vertex: vertices that lie together stand together, so that a range of them is a compact part of the surface.
    #[must_use]
    pub fn in_morton_order(self) -> Self {
        let keys: Vec<u64> = self.positions_in_grid.iter().map(|p| morton(p.map(|v| v as u32))).collect();
        let mut order: Vec<u32> = (0..keys.len() as u32).collect();
        order.sort_by_key(|&v| keys[v as usize]);
        let mut place = vec![0u32; order.len()];
        order.iter().enumerate().for_each(|(new, &old)| place[old as usize] = new as u32);
        let sorted = |of: &[[f32; 3]]| order.iter().filter_map(|&v| of.get(v as usize).copied()).collect();
        let mut triangles: Vec<[u32; 3]> = self.triangles.iter().map(|t| t.map(|v| place[v as usize])).collect();
        triangles.sort_by_key(|t| t.iter().copied().min());
        Self { positions_in_grid: sorted(&self.positions_in_grid), normals: sorted(&self.normals), triangles }
    }
}

/// The bits of three numbers in turn, the lowest 21 of each.
fn morton(cell: [u32; 3]) -> u64 {
    let spread = |v: u32| {
        // Each step doubles the gaps between halves of the bits.
        [
            (32, 0x1f_0000_0000_ffff),
            (16, 0x1f_0000_ff00_00ff),
            (8, 0x100f_00f0_0f00_f00f),
            (4, 0x10c3_0c30_c30c_30c3),
            (2, 0x1249_2492_4924_9249),
        ]
        .iter()
        .fold(u64::from(v) & 0x1f_ffff, |bits, &(shift, mask)| (bits | bits << shift) & mask)
    };
    spread(cell[0]) | spread(cell[1]) << 1 | spread(cell[2]) << 2
}

/// One less than 2³²: the largest 32-bit index restarts primitives in graphics interfaces.
const MOST_VERTICES: u64 = u32::MAX as u64;

/// The level set of `isovalue` (in the file's values), with facet normals weighted by area.
/// An isovalue outside the data's range, or a grid with one sample along an axis, gives an empty
/// mesh.
///
/// # Errors
/// When the isovalue is not finite, the mesh would have 2³² vertices or more, or an axis has more
/// than 2²² samples.
pub fn extract(volume: &Volume, isovalue: f64) -> Result<Mesh> {
    extract_inner(volume, isovalue, None)
}

/// The isosurface as it is lit: normals are those of the tracer ([`LevelField::normal`], a smoothed gradient), where they
/// vanish those of the facets; vertices in the order of [`Mesh::in_morton_order`]. Of a volume whose vertices are to be exact
/// they lie on its model, and normals are those of the model.
///
/// # Errors
/// As [`extract`]; when the volume has no cells.
pub fn isosurface(volume: &Volume, pyramid: &Pyramid, isovalue: f64) -> Result<Mesh> {
    Ok(isosurface_and_count(volume, pyramid, isovalue)?.0)
}

/// The same, and how often its model was evaluated for it.
pub(crate) fn isosurface_and_count(volume: &Volume, pyramid: &Pyramid, isovalue: f64) -> Result<(Mesh, u64)> {
    volume.check_cells()?;
    let mesh = with_samples!(volume.samples(), s => {
        let field = LevelField::new(volume, s, pyramid);
        extract_with_normals(volume, isovalue, &|position| {
            field.normal(&field.locate(position.map(f64::from))).map_or([0.0; 3], |n| n.vec().to_array())
        })
    });
    let (mut mesh, mut evaluations) = (mesh?, 0);
    if let Some(model) = &volume.exact {
        let longest = volume.dims().into_iter().max().unwrap_or(0);
        evaluations = on_model::onto_model(&mut mesh, volume, model, isovalue, fill::least_parameter(longest));
    }
    Ok((mesh.in_morton_order(), evaluations))
}

/// As [`extract`], without normals: [`Mesh::normals`] is empty. For counting, measuring, and normals made elsewhere.
///
/// # Errors
/// As [`extract`].
pub fn extract_without_normals(volume: &Volume, isovalue: f64) -> Result<Mesh> {
    let surface = level_set(volume, isovalue)?;
    Ok(Mesh { positions_in_grid: surface.positions, normals: Vec::new(), triangles: surface.triangles })
}

/// As [`extract`], with normals from `normal_at`: the normal in world axes at a position in grid
/// space, pointing to the lit side, of any length. Where it is zero or not finite (a vanishing
/// gradient), the facets around the vertex give the normal.
///
/// `normal_at` is called from several threads, once for each vertex.
///
/// # Errors
/// As [`extract`].
pub fn extract_with_normals(
    volume: &Volume,
    isovalue: f64,
    normal_at: &(dyn Fn([f32; 3]) -> [f32; 3] + Sync),
) -> Result<Mesh> {
    extract_inner(volume, isovalue, Some(normal_at))
}

fn extract_inner(
    volume: &Volume,
    isovalue: f64,
    normal_at: Option<&(dyn Fn([f32; 3]) -> [f32; 3] + Sync)>,
) -> Result<Mesh> {
    let surface = level_set(volume, isovalue)?;
    let normals = normals::normals(&surface, volume.world_from_grid(), normal_at);
    Ok(Mesh { positions_in_grid: surface.positions, normals, triangles: surface.triangles })
}

fn level_set(volume: &Volume, isovalue: f64) -> Result<fill::Surface> {
    if !isovalue.is_finite() {
        let (low, high) = volume.value_range();
        return Err(Error::argument(
            "isovalue",
            isovalue,
            "a finite number",
            format!("choose one between {low} and {high}"),
        ));
    }
    let (c_raw, solid_sign) = (volume.raw_from_value(isovalue), volume.solid_sign());
    let flip = volume.world_from_grid().is_left_handed();
    with_samples!(volume.samples(), s => {
        fill::level_set(volume.dims(), s, c_raw, solid_sign, flip, MOST_VERTICES)
    })
}
