//! STL, binary: the triangles in world with their normals, and nothing of light: for printers and for programs that read
//! no other. Positions are `float`; a surface far from the origin loses digits, which PLY keeps.

use super::{ExportMesh, write_error, write_records};
use crate::error::Result;
use glam::DVec3;
use std::io::Write;

/// Writes a mesh as STL. An empty mesh has 0 facets.
///
/// # Errors
/// What [`ExportMesh::check`] refuses; [`crate::Error::Io`] (path empty) from the stream.
pub fn write(w: &mut (impl Write + ?Sized), mesh: &ExportMesh<'_>) -> Result<()> {
    mesh.check()?;
    let mut head = [0u8; 84];
    // Not "solid": that begins a text.
    let name = concat!("binary STL by isolume ", env!("CARGO_PKG_VERSION")).as_bytes();
    head[..name.len()].copy_from_slice(name);
    head[80..].copy_from_slice(&(mesh.triangles.len() as u32).to_le_bytes());
    w.write_all(&head).map_err(write_error)?;
    let centre = mesh.box_in_world.centre();
    write_records(w, mesh.triangles.len(), |t| {
        let corners: [DVec3; 3] = mesh.triangles[t].map(|v| mesh.positions.in_world(v as usize, centre));
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
        let mut record = [0u8; 50];
        for (i, v) in [normal, corners[0], corners[1], corners[2]].into_iter().enumerate() {
            for (j, value) in v.as_vec3().to_array().into_iter().enumerate() {
                record[12 * i + 4 * j..12 * i + 4 * j + 4].copy_from_slice(&value.to_le_bytes());
            }
        }
        record
    })
}
