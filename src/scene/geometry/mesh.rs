//! Triangle meshes from files: Wavefront OBJ, PLY and STL (text and binary), glTF and GLB (crate `gltf`).
//!
//! OBJ, PLY and STL are read here: of all only positions and faces matter, a page of code each, with every count and
//! index checked. The format is decided by content. Normals, colours and materials of the file are not used: the
//! scene says what a mesh is made of.

mod gltf_file;
mod obj;
mod ply;
mod stl;

#[cfg(test)]
mod tests;

use crate::error::{Error, Result};
use glam::DVec3;

/// Most triangles of a mesh.
pub(super) const MOST_TRIANGLES: usize = 1 << 24;

/// A mesh as its corners.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// Positions in the file's own coordinates.
    pub positions: Vec<DVec3>,
    /// Indices of positions, counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
}

impl TriangleMesh {
    /// The corners of its triangles.
    #[doc(hidden)]
    pub fn corners(&self) -> impl Iterator<Item = [DVec3; 3]> {
        self.triangles.iter().map(|t| t.map(|i| self.positions[i as usize]))
    }
}

/// Reads a mesh; `beside` reads a file that it names, from the folder of the mesh: the first so many bytes.
///
/// # Errors
/// When the content is none of the formats, is damaged, or has no triangle.
#[doc(hidden)]
pub fn read_mesh(bytes: &[u8], beside: &mut dyn FnMut(&str, u64) -> Result<Vec<u8>>) -> Result<TriangleMesh> {
    let first = bytes.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(0);
    let mesh = if bytes.starts_with(b"ply") {
        ply::read(bytes)?
    } else if bytes.starts_with(b"glTF") || bytes.get(first) == Some(&b'{') {
        gltf_file::read(bytes, beside)?
    } else if stl::is_stl(bytes) {
        stl::read(bytes)?
    } else {
        obj::read(bytes)?
    };
    if mesh.triangles.is_empty() {
        return Err(damaged("no triangle", "a mesh with at least one face"));
    }
    if let Some(i) = mesh.triangles.iter().flatten().find(|i| **i as usize >= mesh.positions.len()) {
        return Err(damaged(format!("index {i} of {} vertices", mesh.positions.len()), "indices of vertices"));
    }
    if mesh.positions.iter().any(|p| !p.is_finite()) {
        return Err(damaged("a position that is not finite", "finite positions"));
    }
    Ok(mesh)
}

pub(super) fn damaged(found: impl Into<String>, expected: &str) -> Error {
    Error::format("triangle mesh", found, expected, "export the mesh again as OBJ, PLY, STL or glTF with triangles")
}

/// Splits a polygon into a fan and refuses what is too much.
fn fan(polygon: &[u32], out: &mut Vec<[u32; 3]>) -> Result<()> {
    for pair in polygon.windows(2).skip(1) {
        out.push([polygon[0], pair[0], pair[1]]);
    }
    if out.len() > MOST_TRIANGLES {
        return Err(damaged("more than 2^24 triangles", "at most 2^24 triangles"));
    }
    Ok(())
}
