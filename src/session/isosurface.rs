//! An isosurface of one volume: mesh, normals, places in world, and what of it a camera sees.

use crate::error::Result;
use crate::export::{ExportMesh, Positions, StandardError};
use crate::geom::Up;
use crate::level::Pyramid;
use crate::render::{Camera, Projection, View};
use crate::sampling::hash::uniform;
use crate::surface::{Mesh, isosurface};
use crate::transfer::store::Store;
use crate::transport::SurfacePoint;
use crate::volume::Volume;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// An isosurface as it stands in world.
pub struct Isosurface {
    isovalue: f64,
    mesh: Mesh,
    // Invariant: one a vertex. World positions relative to the centre of the volume's box.
    positions: Vec<Vec3>,
    // Invariant: one a vertex.
    normals: Vec<Vec3>,
    // Where its vertices have transfer of their own.
    transfer: Option<Box<Store>>,
}

impl Isosurface {
    /// Extracts the isosurface of an isovalue in the file's values. Normals are those of the tracer; where they vanish,
    /// those of the facets.
    ///
    /// # Errors
    /// When the volume has no cells, or the surface has too many vertices.
    pub fn extract(volume: &Volume, pyramid: &Pyramid, isovalue: f64) -> Result<Self> {
        Ok(Self::of_mesh(volume, isovalue, isosurface(volume, pyramid, isovalue)?))
    }

    /// An isosurface of which the mesh is there.
    pub(super) fn of_mesh(volume: &Volume, isovalue: f64, mesh: Mesh) -> Self {
        let centre = volume.world_bounds().centre();
        let world_from_grid = volume.world_from_grid();
        let place = |p: &[f32; 3]| (world_from_grid.point(DVec3::from_array(p.map(f64::from))) - centre).as_vec3();
        let positions = mesh.positions_in_grid.par_iter().map(place).collect();
        let normals = mesh.normals.iter().map(|n| Vec3::from_array(*n)).collect();
        Self { isovalue, mesh, positions, normals, transfer: None }
    }

    /// The isosurface whose vertices have transfer of their own; `None` where `transfer` is no surface of a store.
    ///
    /// # Errors
    /// When its mesh is damaged.
    pub(super) fn of_store(volume: &Volume, transfer: Store) -> Result<Option<Self>> {
        let (Some(isovalue), Some(mesh)) = (transfer.isovalue(), transfer.mesh()?) else { return Ok(None) };
        Ok(Some(Self { transfer: Some(Box::new(transfer)), ..Self::of_mesh(volume, isovalue, mesh) }))
    }

    /// The transfer of its vertices, where they have one of their own: else it comes from the texture.
    pub fn transfer(&self) -> Option<&Store> {
        self.transfer.as_deref()
    }

    /// In the file's values.
    pub fn isovalue(&self) -> f64 {
        self.isovalue
    }

    /// The mesh in grid space, with normals in world.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// World positions relative to the centre of the volume's box.
    pub fn positions(&self) -> &[Vec3] {
        &self.positions
    }

    /// Normals in world.
    pub fn normals(&self) -> &[Vec3] {
        &self.normals
    }

    /// `count` random vertices, with replacement, by `seed`; none of an empty surface.
    #[doc(hidden)]
    pub fn random_points(&self, count: u32, seed: u64) -> Vec<SurfacePoint> {
        let all = self.mesh.positions_in_grid.len();
        let vertex = |i: u32| {
            let [high, low] = [0, 1].map(|d| f64::from(uniform(seed, 0x636f_6d70, i, d)));
            (((high + low / f64::from(1u32 << 24)) * all as f64) as usize).min(all - 1)
        };
        let mesh = &self.mesh;
        let point = |v: usize| SurfacePoint { position_in_grid: mesh.positions_in_grid[v], normal: mesh.normals[v] };
        if all == 0 { Vec::new() } else { (0..count).map(|i| point(vertex(i))).collect() }
    }

    /// The mesh as the writers take it; `radiance` comes with its standard errors.
    #[doc(hidden)]
    pub fn export<'a>(
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
            metres_per_unit: volume.unit.metres(),
        }
    }

    /// A camera that has all of the surface in view; the whole box of the volume when there is no vertex.
    #[doc(hidden)]
    pub fn camera(&self, volume: &Volume, up: Up, view: View, projection: Projection, aspect: f64) -> Camera {
        let all = volume.world_bounds();
        if self.positions.is_empty() {
            return Camera::framing(&all, up, view, projection, aspect);
        }
        Camera::framing_points(self.seen(volume), up, view, projection, aspect)
    }

    /// Points around which all lies that a picture shows of it, in world. Cut faces show in pictures: corners of the
    /// box that are solid belong to what is seen.
    #[doc(hidden)]
    pub fn seen(&self, volume: &Volume) -> impl Iterator<Item = DVec3> {
        let centre = volume.world_bounds().centre();
        self.positions.iter().map(move |p| p.as_dvec3() + centre).chain(self.solid_corners(volume))
    }

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
