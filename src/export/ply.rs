//! PLY, binary little-endian (Turk 1994, "The PLY Polygon File Format"): positions in world,
//! normals, colours as **8-bit sRGB** (`red`, `green`, `blue`, what mesh viewers expect), and on
//! request the linear radiance as floats.
//!
//! Positions are `float` where that keeps them within 1e-6 of the longest side, else `double`
//! (a surface far from the origin).

use super::{ExportMesh, StandardError, write_error, write_records};
use crate::error::{Error, Result};
use crate::srgb;
use serde_json::Value;
use std::io::Write;

/// How to write a PLY.
#[derive(Clone, Debug)]
pub struct PlyOptions {
    /// What made the file, for a comment.
    pub generator: String,
    /// How the file was made, a JSON comment on one line; left out when null.
    pub provenance: Value,
}

impl Default for PlyOptions {
    fn default() -> Self {
        Self { generator: concat!("isolume ", env!("CARGO_PKG_VERSION")).into(), provenance: Value::Null }
    }
}

/// Writes a mesh as PLY. Radiance and standard error follow the colours as `radiance_r`, … and
/// `stderr` or `stderr_r`, … where the mesh has them. An empty mesh has 0 vertices and 0 faces.
///
/// # Errors
/// What [`ExportMesh::check`] refuses; [`Error::Limit`] above 2³¹ vertices (indices are `int`,
/// which every reader knows); [`Error::Io`] (path empty) from the stream.
pub fn write(w: &mut (impl Write + ?Sized), mesh: &ExportMesh<'_>, options: &PlyOptions) -> Result<()> {
    mesh.check()?;
    if mesh.positions.len() > i32::MAX as usize {
        return Err(Error::Limit {
            what: "the PLY file".into(),
            needed: format!("{} vertices", mesh.positions.len()),
            limit: format!("{} vertices", i32::MAX),
            remedy: "write a .glb, or extract a part of the surface".into(),
        });
    }
    let double = needs_double(mesh);
    w.write_all(header(mesh, options, double).as_bytes()).map_err(write_error)?;
    write_vertices(w, mesh, double)?;
    write_records(w, mesh.triangles.len(), |t| {
        let [a, b, c] = mesh.triangles[t].map(u32::to_le_bytes);
        [3, a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3], c[0], c[1], c[2], c[3]]
    })
}

/// Whether rounding a coordinate of the box to f32 (error up to 2⁻²⁴ of it) costs more than 1e-6
/// of the longest side.
fn needs_double(mesh: &ExportMesh<'_>) -> bool {
    let bounds = mesh.box_in_world;
    let largest = bounds.min.abs().max(bounds.max.abs()).max_element();
    largest / f64::from(1 << 24) > 1e-6 * bounds.size().max_element()
}

fn header(mesh: &ExportMesh<'_>, options: &PlyOptions, double: bool) -> String {
    let mut text = String::from("ply\nformat binary_little_endian 1.0\n");
    let mut comment = |line: &str| {
        // One line of ASCII each: readers split at line ends, and some refuse other bytes.
        let clean: String = line.chars().map(|c| if c.is_ascii() && !c.is_control() { c } else { '?' }).collect();
        text.push_str(&format!("comment {clean}\n"));
    };
    comment(&options.generator);
    comment("x y z in world units; red green blue are 8-bit sRGB; radiance and stderr are linear Rec.709");
    if !options.provenance.is_null() {
        comment(&format!("provenance {}", ascii_json(&options.provenance)));
    }
    text.push_str(&format!("element vertex {}\n", mesh.positions.len()));
    let mut properties = |kind: &str, names: &[&str]| {
        for name in names {
            text.push_str(&format!("property {kind} {name}\n"));
        }
    };
    properties(if double { "double" } else { "float" }, &["x", "y", "z"]);
    properties("float", &["nx", "ny", "nz"]);
    properties("uchar", &["red", "green", "blue"]);
    if mesh.radiance.is_some() {
        properties("float", &["radiance_r", "radiance_g", "radiance_b"]);
    }
    match mesh.standard_error {
        Some(StandardError::Grey(_)) => properties("float", &["stderr"]),
        Some(StandardError::Rgb(_)) => properties("float", &["stderr_r", "stderr_g", "stderr_b"]),
        None => {}
    }
    text.push_str(&format!(
        "element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.triangles.len()
    ));
    text
}

/// Compact JSON with everything beyond ASCII escaped.
fn ascii_json(value: &Value) -> String {
    let mut text = String::new();
    for c in value.to_string().chars() {
        if c.is_ascii() {
            text.push(c);
        } else {
            let mut units = [0; 2];
            for unit in c.encode_utf16(&mut units) {
                text.push_str(&format!("\\u{unit:04x}"));
            }
        }
    }
    text
}

fn write_vertices(w: &mut (impl Write + ?Sized), mesh: &ExportMesh<'_>, double: bool) -> Result<()> {
    const AT_ONCE: usize = 2048;
    let centre = mesh.centre_in_world();
    let mut buffer: Vec<u8> = Vec::new();
    for start in (0..mesh.positions.len()).step_by(AT_ONCE) {
        buffer.clear();
        for v in start..mesh.positions.len().min(start + AT_ONCE) {
            let position = mesh.positions.in_world(v, centre);
            if double {
                push(&mut buffer, position.to_array().map(f64::to_le_bytes));
            } else {
                push(&mut buffer, position.as_vec3().to_array().map(f32::to_le_bytes));
            }
            push(&mut buffer, mesh.unit_normal(v).to_array().map(f32::to_le_bytes));
            buffer.extend(mesh.colours[v].map(srgb::byte_from_linear));
            if let Some(radiance) = mesh.radiance {
                push(&mut buffer, radiance[v].map(f32::to_le_bytes));
            }
            match mesh.standard_error {
                Some(StandardError::Grey(e)) => push(&mut buffer, [e[v].to_le_bytes()]),
                Some(StandardError::Rgb(e)) => push(&mut buffer, e[v].map(f32::to_le_bytes)),
                None => {}
            }
        }
        w.write_all(&buffer).map_err(write_error)?;
    }
    Ok(())
}

fn push<const BYTES: usize, const N: usize>(buffer: &mut Vec<u8>, values: [[u8; BYTES]; N]) {
    buffer.extend_from_slice(values.as_flattened());
}
