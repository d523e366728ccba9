//! A mesh made of chosen vertices of another one: simplified, in another order, or cut along seams.

use super::gltf::Scalars;
use super::{ExportMesh, Positions, StandardError};
use glam::Vec3;

/// Vertices of a mesh, in their new order, and the triangles between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Selection {
    /// Numbers of the vertices in the mesh that they come from; one may come several times.
    pub vertices: Vec<u32>,
    /// Three of the new vertices each.
    pub triangles: Vec<[u32; 3]>,
}

impl Selection {
    /// What triangles of a mesh of `count` vertices use of it: its vertices in their order, without those that none has.
    pub(crate) fn of_triangles(triangles: &[[u32; 3]], count: usize) -> Self {
        const UNUSED: u32 = u32::MAX;
        let mut place = vec![UNUSED; count];
        triangles.iter().flatten().for_each(|&v| place[v as usize] = 0);
        let vertices: Vec<u32> = (0..count as u32).filter(|&v| place[v as usize] != UNUSED).collect();
        vertices.iter().zip(0..).for_each(|(&v, new)| place[v as usize] = new);
        Self { vertices, triangles: triangles.iter().map(|t| t.map(|v| place[v as usize])).collect() }
    }

    /// What the chosen vertices have of an attribute.
    pub(crate) fn of<T: Copy>(&self, all: &[T]) -> Vec<T> {
        self.vertices.iter().map(|&v| all[v as usize]).collect()
    }

    /// The same of attributes of a file.
    pub(crate) fn of_scalars(&self, all: &[Scalars]) -> Vec<Scalars> {
        all.iter().map(|s| Scalars { name: s.name.clone(), values: self.of(&s.values) }).collect()
    }

    /// The attributes of the chosen vertices of a mesh.
    pub(crate) fn attributes(&self, mesh: &ExportMesh<'_>) -> Attributes {
        let centre = mesh.centre_in_world();
        Attributes {
            positions: self.vertices.iter().map(|&v| mesh.positions.from_centre(v as usize, centre)).collect(),
            normals: self.of(mesh.normals_in_world),
            colours: self.of(mesh.colours),
            radiance: mesh.radiance.map(|all| self.of(all)),
            grey_error: if let Some(StandardError::Grey(all)) = mesh.standard_error {
                Some(self.of(all))
            } else {
                None
            },
            rgb_error: if let Some(StandardError::Rgb(all)) = mesh.standard_error { Some(self.of(all)) } else { None },
            triangles: self.triangles.clone(),
        }
    }
}

/// The attributes of a mesh of its own.
#[derive(Clone, Debug)]
pub struct Attributes {
    // World − centre of the box.
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    colours: Vec<[f32; 3]>,
    radiance: Option<Vec<[f32; 3]>>,
    grey_error: Option<Vec<f32>>,
    rgb_error: Option<Vec<[f32; 3]>>,
    triangles: Vec<[u32; 3]>,
}

impl Attributes {
    /// The mesh as the writers take it; name, box, axis and unit are those of the mesh that it comes from.
    pub(crate) fn mesh<'a>(&'a self, of: &ExportMesh<'a>) -> ExportMesh<'a> {
        let grey = self.grey_error.as_deref().map(StandardError::Grey);
        ExportMesh {
            positions: Positions::FromCentre(&self.positions),
            normals_in_world: &self.normals,
            triangles: &self.triangles,
            colours: &self.colours,
            radiance: self.radiance.as_deref(),
            standard_error: grey.or(self.rgb_error.as_deref().map(StandardError::Rgb)),
            ..*of
        }
    }
}
