//! STL: text, or binary (little-endian). Corners are written for each facet anew; those that coincide become one vertex, so
//! that a closed surface is closed again. Normals of facets are not used.

use super::{MOST_TRIANGLES, TriangleMesh, damaged};
use crate::error::Result;
use glam::DVec3;
use std::collections::HashMap;

/// The header and the count of a binary file, and the bytes of a facet.
const HEAD: usize = 84;
const FACET: usize = 50;

/// Whether bytes are STL: binary ones have the length that their count says, whatever their header reads.
pub(super) fn is_stl(bytes: &[u8]) -> bool {
    binary_facets(bytes).is_some() || bytes.trim_ascii_start().starts_with(b"solid")
}

fn binary_facets(bytes: &[u8]) -> Option<usize> {
    let count = bytes.get(80..HEAD)?;
    let count = u32::from_le_bytes([count[0], count[1], count[2], count[3]]) as usize;
    (count.checked_mul(FACET)?.checked_add(HEAD)? == bytes.len()).then_some(count)
}

/// Vertices by their bits.
#[derive(Default)]
struct Welded {
    mesh: TriangleMesh,
    places: HashMap<[u32; 3], u32>,
}

impl Welded {
    fn add(&mut self, corners: [[f32; 3]; 3]) -> Result<()> {
        if self.mesh.triangles.len() >= MOST_TRIANGLES {
            return Err(damaged("more than 2^24 triangles", "at most 2^24 triangles"));
        }
        let triangle = corners.map(|corner| {
            // −0 and 0 are one place.
            let key = corner.map(|v| (v + 0.0).to_bits());
            *self.places.entry(key).or_insert_with(|| {
                self.mesh.positions.push(DVec3::from_array(corner.map(f64::from)));
                self.mesh.positions.len() as u32 - 1
            })
        });
        self.mesh.triangles.push(triangle);
        Ok(())
    }
}

pub(super) fn read(bytes: &[u8]) -> Result<TriangleMesh> {
    let mut welded = Welded::default();
    if binary_facets(bytes).is_some() {
        for facet in bytes[HEAD..].chunks_exact(FACET) {
            let number = |at: usize| f32::from_le_bytes([facet[at], facet[at + 1], facet[at + 2], facet[at + 3]]);
            welded.add([12, 24, 36].map(|at| [number(at), number(at + 4), number(at + 8)]))?;
        }
        return Ok(welded.mesh);
    }
    let text =
        std::str::from_utf8(bytes).map_err(|_| damaged("STL whose length does not fit its count", "a whole file"))?;
    let mut corners: Vec<[f32; 3]> = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("vertex") => {
                let mut next = || words.next().and_then(|w| w.parse::<f32>().ok());
                match (next(), next(), next()) {
                    (Some(x), Some(y), Some(z)) => corners.push([x, y, z]),
                    _ => return Err(damaged(format!("line {}: {}", number + 1, line.trim()), "vertex x y z")),
                }
            }
            Some("endfacet") => match corners[..] {
                [a, b, c] => {
                    welded.add([a, b, c])?;
                    corners.clear();
                }
                _ => {
                    let found = format!("line {}: a facet of {} vertices", number + 1, corners.len());
                    return Err(damaged(found, "three vertices to a facet"));
                }
            },
            _ => {}
        }
        if corners.len() > 3 {
            return Err(damaged(format!("line {}: a fourth vertex", number + 1), "three vertices to a facet"));
        }
    }
    Ok(welded.mesh)
}
