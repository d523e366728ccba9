//! A surface ready to be lit: mesh, normals, and the bricks that its lookups read.

use super::{options, text};
use crate::error::Result;
use crate::export::{ExportMesh, Positions, StandardError};
use crate::geom::Up;
use crate::level::{LevelField, Pyramid};
use crate::render::{Camera, Projection, View};
use crate::sampling::hash::uniform;
use crate::surface::{Mesh, extract_with_normals};
use crate::transfer::texels_of_isosurface;
use crate::transfer::{BRICK_TEXELS, Lattice};
use crate::transport::SurfacePoint;
use crate::volume::{LengthUnit, Sample, Volume};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;
use std::time::{Duration, Instant};

/// An isosurface and what is needed to light it.
pub(super) struct Surface {
    pub(super) isovalue: f64,
    pub(super) mesh: Mesh,
    /// World positions relative to the centre of the volume's box.
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    /// Bricks that lookups on it read.
    pub(super) bricks: Vec<[usize; 3]>,
    /// Share of the vertices where the surface bends too much within a texel, of a texture coarser than the data.
    pub(super) below_a_texel: f64,
    pub(super) extract_time: Duration,
    pub(super) select_time: Duration,
}

impl Surface {
    /// Extracts the isosurface. Normals are those of the tracer; where they vanish, those of the facets.
    pub(super) fn new(volume: &Volume, pyramid: &Pyramid, lattice: Lattice, isovalue: f64) -> Result<Self> {
        volume.check_cells()?;
        let start = Instant::now();
        let mesh =
            with_samples!(volume.samples(), s => extract(volume, &LevelField::new(volume, s, pyramid), isovalue))?;
        let centre = volume.world_bounds().centre();
        let world_from_grid = volume.world_from_grid();
        let place = |p: &[f32; 3]| (world_from_grid.point(DVec3::from_array(p.map(f64::from))) - centre).as_vec3();
        let positions = mesh.positions_in_grid.par_iter().map(place).collect();
        let normals = mesh.normals.iter().map(|n| Vec3::from_array(*n)).collect();
        let extract_time = start.elapsed();
        let start = Instant::now();
        let bricks = texels_of_isosurface(volume, lattice, isovalue).bricks();
        let below_a_texel = below_a_texel(&mesh, lattice);
        let select_time = start.elapsed();
        Ok(Self { isovalue, mesh, positions, normals, bricks, below_a_texel, extract_time, select_time })
    }

    /// Random vertices, with replacement; none of an empty surface.
    pub(super) fn random_points(&self, count: u32, seed: u64) -> Vec<SurfacePoint> {
        let all = self.mesh.positions_in_grid.len();
        let vertex = |i: u32| {
            let [high, low] = [0, 1].map(|d| f64::from(uniform(seed, 0x636f_6d70, i, d)));
            (((high + low / f64::from(1u32 << 24)) * all as f64) as usize).min(all - 1)
        };
        let mesh = &self.mesh;
        let point = |v: usize| SurfacePoint { position_in_grid: mesh.positions_in_grid[v], normal: mesh.normals[v] };
        if all == 0 { Vec::new() } else { (0..count).map(|i| point(vertex(i))).collect() }
    }

    /// Refuses what would take more memory than allowed: the volume with its pyramid, the contracted bricks, and the
    /// mesh with its colours, once more while it is written.
    pub(super) fn check_memory(&self, volume: &Volume, limit: Option<u64>) -> Result<()> {
        // Radiance, weight and standard error of a texel; two positions, two normals, radiance, colour, error and what
        // is written of a vertex; a triangle, twice.
        const TEXEL: u64 = 20;
        const VERTEX: u64 = 4 * 12 + 12 + 12 + 4 + 12 + 12 + 8 + 16;
        const TRIANGLE: u64 = 24;
        let volume = volume.samples().bytes().len() as u64 / 4 * 5;
        let contracted = self.bricks.len() as u64 * BRICK_TEXELS as u64 * TEXEL;
        let mesh = self.mesh.positions_in_grid.len() as u64 * VERTEX + self.mesh.triangles.len() as u64 * TRIANGLE;
        let what = format!("relighting isovalue {}", text::number(self.isovalue, 8));
        options::check_memory(&what, volume + contracted + mesh, limit)
    }

    /// The mesh as the writers take it; `radiance` comes with its standard errors.
    pub(super) fn export<'a>(
        &'a self,
        name: &'a str,
        volume: &Volume,
        up: Up,
        colours: &'a [[f32; 3]],
        radiance: Option<(&'a [[f32; 3]], &'a [f32])>,
    ) -> ExportMesh<'a> {
        ExportMesh {
            name,
            positions: Positions::FromCentre(&self.positions),
            normals_in_world: &self.normals,
            triangles: &self.mesh.triangles,
            colours,
            radiance: radiance.map(|(radiance, _)| radiance),
            standard_error: radiance.map(|(_, errors)| StandardError::Grey(errors)),
            box_in_world: volume.world_bounds(),
            up,
            metres_per_unit: match volume.unit {
                LengthUnit::Unknown => None,
                LengthUnit::Metres(metres) => Some(metres),
            },
        }
    }

    /// World positions relative to the centre of the volume's box.
    pub(super) fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// Normals in world.
    pub(super) fn normals(&self) -> &[Vec3] {
        &self.normals
    }

    /// A camera that has all of the surface in view; the whole box of the volume when there is no vertex.
    pub(super) fn camera(&self, volume: &Volume, up: Up, view: View, projection: Projection, aspect: f64) -> Camera {
        let all = volume.world_bounds();
        if self.positions.is_empty() {
            return Camera::framing(&all, up, view, projection, aspect);
        }
        Camera::framing_points(self.seen(volume), up, view, projection, aspect)
    }

    /// Points around which all lies that a picture shows of it, in world. Cut faces show in pictures: corners of the box
    /// that are solid belong to what is seen.
    pub(super) fn seen(&self, volume: &Volume) -> impl Iterator<Item = DVec3> {
        let centre = volume.world_bounds().centre();
        self.positions.iter().map(move |p| p.as_dvec3() + centre).chain(self.solid_corners(volume))
    }
}

/// Share of the vertices in cells of a coarse texture within which normals differ so much that their mean is shorter than
/// 0.8: what they cover is then a cap of more than 53° about its middle, or two sides of a thin shell. 0 for a texture that is
/// as fine as the data.
fn below_a_texel(mesh: &Mesh, lattice: Lattice) -> f64 {
    const SHORTEST_MEAN: f32 = 0.8;
    let steps = [0, 1, 2].map(|axis| lattice.step(axis));
    if steps.iter().all(|&step| step <= 1.0) || mesh.normals.is_empty() {
        return 0.0;
    }
    let mut cells: HashMap<[u32; 3], (Vec3, u32)> = HashMap::new();
    for (position, normal) in mesh.positions_in_grid.iter().zip(&mesh.normals) {
        let cell = std::array::from_fn(|a| (f64::from(position[a]) / steps[a].max(1.0)) as u32);
        let (sum, count) = cells.entry(cell).or_default();
        (*sum, *count) = (*sum + Vec3::from_array(*normal), *count + 1);
    }
    let bent = cells.values().filter(|(sum, count)| sum.length() < SHORTEST_MEAN * *count as f32);
    bent.map(|(_, count)| f64::from(*count)).sum::<f64>() / mesh.normals.len() as f64
}

impl Surface {
    /// Corners of the box inside the solid, in world.
    fn solid_corners(&self, volume: &Volume) -> Vec<DVec3> {
        let last = volume.dims().map(|d| d - 1);
        let corners = (0..8).map(|i| [0, 1, 2].map(|a| if i >> a & 1 == 0 { 0 } else { last[a] }));
        let raw = volume.raw_from_value(self.isovalue);
        let solid = |&[x, y, z]: &[usize; 3]| {
            let sample = f64::from(volume.samples().raw(volume.index(x, y, z)));
            f64::from(volume.solid_sign()) * (sample - raw) > 0.0
        };
        let place = |c: [usize; 3]| volume.world_from_grid().point(DVec3::from_array(c.map(|v| v as f64)));
        corners.filter(solid).map(place).collect()
    }
}

fn extract<T: Sample>(volume: &Volume, field: &LevelField<'_, T>, isovalue: f64) -> Result<Mesh> {
    extract_with_normals(volume, isovalue, &|position| {
        field.normal(&field.locate(position.map(f64::from))).map_or([0.0; 3], |n| n.vec().to_array())
    })
}
