//! Meshes for tests.

use super::{ExportMesh, Positions};
use crate::geom::{Bounds, Up};
use glam::{DVec3, Vec3};
use std::f64::consts::TAU;

/// A mesh of its own, without radiance.
pub(super) struct TestMesh {
    pub(super) positions: Vec<DVec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) colours: Vec<[f32; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl TestMesh {
    /// A sheet over [0, 1]² of n × n squares, open at its border.
    pub(super) fn sheet(n: u32, height: impl Fn(f64, f64) -> f64, colour: impl Fn(f64, f64) -> [f32; 3]) -> Self {
        let mut mesh = Self { positions: vec![], normals: vec![], colours: vec![], triangles: vec![] };
        for j in 0..=n {
            for i in 0..=n {
                let (x, y) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
                mesh.positions.push(DVec3::new(x, y, height(x, y)));
                mesh.normals.push(Vec3::Z);
                mesh.colours.push(colour(x, y));
                if i < n && j < n {
                    let at = j * (n + 1) + i;
                    mesh.triangles.extend([[at, at + 1, at + n + 2], [at, at + n + 2, at + n + 1]]);
                }
            }
        }
        mesh
    }

    /// A closed torus of radii 2 and 0.8 with n × 3n squares, its colours smooth.
    pub(super) fn torus(n: u32) -> Self {
        let mut mesh = Self { positions: vec![], normals: vec![], colours: vec![], triangles: vec![] };
        for j in 0..3 * n {
            for i in 0..n {
                let (u, v) = (TAU * f64::from(j) / f64::from(3 * n), TAU * f64::from(i) / f64::from(n));
                let out = DVec3::new(u.cos() * v.cos(), u.sin() * v.cos(), v.sin());
                mesh.positions.push(DVec3::new(2.0 * u.cos(), 2.0 * u.sin(), 0.0) + 0.8 * out);
                mesh.normals.push(out.as_vec3());
                mesh.colours.push((0.5 * out + 0.5).as_vec3().clamp(Vec3::ZERO, Vec3::ONE).to_array());
                let at = |j: u32, i: u32| (j % (3 * n)) * n + i % n;
                let (a, b, c, d) = (at(j, i), at(j + 1, i), at(j, i + 1), at(j + 1, i + 1));
                mesh.triangles.extend([[a, b, d], [a, d, c]]);
            }
        }
        mesh
    }

    pub(super) fn mesh(&self) -> ExportMesh<'_> {
        mesh_of(&self.positions, &self.normals, &self.triangles, &self.colours)
    }
}

/// A mesh to export in the box around it, without a unit.
pub(super) fn mesh_of<'a>(
    positions: &'a [DVec3],
    normals_in_world: &'a [Vec3],
    triangles: &'a [[u32; 3]],
    colours: &'a [[f32; 3]],
) -> ExportMesh<'a> {
    ExportMesh {
        name: "test",
        positions: Positions::World(positions),
        normals_in_world,
        triangles,
        colours,
        radiance: None,
        standard_error: None,
        box_in_world: positions.iter().fold(Bounds::EMPTY, |b, &p| b.including(p)),
        up: Up::Z,
        metres_per_unit: None,
    }
}
