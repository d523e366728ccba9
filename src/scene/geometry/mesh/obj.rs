//! Wavefront OBJ: lines `v` and `f`; all others are passed over.

use super::{TriangleMesh, damaged, fan};
use crate::error::Result;
use glam::DVec3;

pub(super) fn read(bytes: &[u8]) -> Result<TriangleMesh> {
    let text = std::str::from_utf8(bytes).map_err(|_| damaged("bytes that are no text", "OBJ, PLY, glTF or GLB"))?;
    let mut mesh = TriangleMesh::default();
    for (number, line) in text.lines().enumerate() {
        let refuse = |expected: &str| damaged(format!("line {}: {}", number + 1, line.trim()), expected);
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let mut next = || words.next().and_then(|w| w.parse::<f64>().ok()).ok_or_else(|| refuse("v x y z"));
                mesh.positions.push(DVec3::new(next()?, next()?, next()?));
            }
            Some("f") => {
                let count = mesh.positions.len() as i64;
                let corner = |word: &str| -> Result<u32> {
                    // v, v/vt, v//vn or v/vt/vn; from 1, or from the end if negative.
                    let index = word.split('/').next().and_then(|w| w.parse::<i64>().ok());
                    let from_zero = index.map(|i| if i < 0 { count + i } else { i - 1 });
                    let legal = from_zero.filter(|i| (0..count).contains(i) && *i < i64::from(u32::MAX));
                    legal.map(|i| i as u32).ok_or_else(|| refuse("f and numbers of vertices before it"))
                };
                let polygon = words.map(corner).collect::<Result<Vec<_>>>()?;
                if polygon.len() < 3 {
                    return Err(refuse("a face of at least three vertices"));
                }
                fan(&polygon, &mut mesh.triangles)?;
            }
            _ => {}
        }
    }
    Ok(mesh)
}
