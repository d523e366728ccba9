//! Small files: `KHR_mesh_quantization` and `EXT_meshopt_compression` (Kapoulkine 2021), by the crate `meshopt`.
//!
//! The binary chunk holds compressed streams and, as it is, what is compressed already. Views point into a second buffer, which is
//! in no file: a reader fills it by decompressing. Both extensions are required: a reader without them refuses the file.

use super::layout::{Layout, View};
use super::{Content, GltfOptions};
use crate::error::Result;
use crate::export::{ExportMesh, Selection};
use ::gltf::json::validation::USize64;
use ::gltf::json::{self, Index, buffer, extensions};
use glam::{DVec3, Vec3};
use serde_json::{Value, json};

const QUANTIZATION: &str = "KHR_mesh_quantization";
const COMPRESSION: &str = "EXT_meshopt_compression";

/// Positions of 16 bits along each axis, in equal steps: a power of two, and from a multiple of it, so that what lies on planes of a
/// grid with round spacing, as two coordinates of most vertices of isosurfaces do, has zeros for its last bits, which
/// compress.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lattice {
    // Relative to the centre of the box.
    corner: DVec3,
    // Positive.
    step: f64,
}

impl Lattice {
    /// Over the box of the file, so that surfaces of one box share it and what they have in common stays so; over the mesh too,
    /// where that leaves the box.
    pub(super) fn new(mesh: &ExportMesh<'_>) -> Self {
        let centre = mesh.centre_in_world();
        let half = 0.5 * mesh.box_in_world.size();
        let (mut low, mut high) = (-half, half);
        for v in 0..mesh.positions.len() {
            let p = mesh.positions.from_centre(v, centre).as_dvec3();
            (low, high) = (low.min(p), high.max(p));
        }
        let side = (high - low).max_element();
        let least = libm::exp2(libm::log2(side / f64::from(u16::MAX)).ceil());
        let mut step = if least.is_normal() { least } else { 1.0 };
        let corner = loop {
            // In world, where the planes of grids are at round places.
            let corner = ((centre + low) / step).floor() * step - centre;
            // No comparison holds of what is no number.
            if ((high - corner) / step).max_element() > f64::from(u16::MAX) && step < f64::MAX / 2.0 {
                step *= 2.0;
            } else {
                break corner.min(low);
            }
        };
        Self { corner, step }
    }

    pub(super) fn corner(&self) -> DVec3 {
        self.corner
    }

    pub(super) fn step(&self) -> f64 {
        self.step
    }

    /// The nearest point of the lattice.
    pub(super) fn snap(&self, from_centre: Vec3) -> [u16; 3] {
        ((from_centre.as_dvec3() - self.corner) / self.step).to_array().map(|x| x.round() as u16)
    }

    /// Half the diagonal of a cell.
    pub(super) fn largest_error(&self) -> f64 {
        0.5 * 3f64.sqrt() * self.step
    }

    /// Smallest and largest positions as stored.
    pub(super) fn range(&self, mesh: &ExportMesh<'_>) -> (Option<Value>, Option<Value>) {
        let centre = mesh.centre_in_world();
        let (mut low, mut high) = ([u16::MAX; 3], [0; 3]);
        for v in 0..mesh.positions.len() {
            let p = self.snap(mesh.positions.from_centre(v, centre));
            (low, high) = ([0, 1, 2].map(|a| low[a].min(p[a])), [0, 1, 2].map(|a| high[a].max(p[a])));
        }
        (Some(json!(low)), Some(json!(high)))
    }
}

/// Where the compressed bytes of a view are.
pub(super) struct Stream {
    offset: u64,
    bytes: u64,
}

/// The binary chunk of a small file.
pub(super) struct Packed {
    pub(super) bytes: Vec<u8>,
    /// For each view of the layout; none for what stands there as it is.
    pub(super) streams: Vec<Option<Stream>>,
    // Where the picture stands; it is the only such view.
    picture: u64,
}

impl Packed {
    /// Where a view stands that is not compressed.
    pub(super) fn plain_offset(&self, _view: &View) -> u64 {
        self.picture
    }
}

/// An order of triangles and vertices in which both compress well.
#[cfg(feature = "meshopt")]
pub(super) fn order(mesh: &ExportMesh<'_>) -> Result<Selection> {
    let count = mesh.positions.len();
    let used = Selection::of_triangles(mesh.triangles, count);
    let indices = meshopt::optimize_vertex_cache_strip(used.triangles.as_flattened(), used.vertices.len());
    // The new place of each vertex.
    let place = meshopt::optimize_vertex_fetch_remap(&indices, used.vertices.len());
    let mut vertices = vec![0; used.vertices.len()];
    place.iter().zip(&used.vertices).for_each(|(&new, &old)| vertices[new as usize] = old);
    let triangles = indices.as_chunks().0.iter().map(|t: &[u32; 3]| t.map(|v| place[v as usize])).collect();
    Ok(Selection { vertices, triangles })
}

#[cfg(not(feature = "meshopt"))]
pub(super) fn order(_: &ExportMesh<'_>) -> Result<Selection> {
    Err(crate::export::without_meshopt("files for the web"))
}

/// Compresses every view that the extension has a mode for.
pub(super) fn pack(mesh: &ExportMesh<'_>, options: &GltfOptions, layout: &Layout) -> Result<Packed> {
    let mut packed = Packed { bytes: Vec::new(), streams: Vec::new(), picture: 0 };
    for view in &layout.views {
        let mut plain = Vec::with_capacity(view.bytes as usize);
        super::write_view(&mut plain, mesh, options, layout.lattice.as_ref(), view)?;
        plain.truncate(view.bytes as usize);
        let offset = packed.bytes.len() as u64;
        if view.content == Content::Picture {
            packed.picture = offset;
            packed.bytes.extend(plain);
            packed.streams.push(None);
        } else {
            let stream = compress(mesh, view, &plain)?;
            packed.streams.push(Some(Stream { offset, bytes: stream.len() as u64 }));
            packed.bytes.extend(stream);
        }
        packed.bytes.resize(packed.bytes.len().next_multiple_of(4), 0);
    }
    Ok(packed)
}

/// The stream of a view, in the versions of the format that the extension names: 1 of indices, 0 of attributes.
#[cfg(feature = "meshopt")]
fn compress(mesh: &ExportMesh<'_>, view: &View, plain: &[u8]) -> Result<Vec<u8>> {
    const LEVEL: i32 = 2;
    let stream = if view.content.is_indices() {
        meshopt::encode_index_buffer(mesh.triangles.as_flattened(), mesh.positions.len())
    } else {
        let version = Some(0);
        match view.content.format().2 {
            4 => meshopt::encode_vertex_buffer_level::<[u8; 4]>(plain.as_chunks().0, LEVEL, version),
            8 => meshopt::encode_vertex_buffer_level::<[u8; 8]>(plain.as_chunks().0, LEVEL, version),
            _ => meshopt::encode_vertex_buffer_level::<[u8; 12]>(plain.as_chunks().0, LEVEL, version),
        }
    };
    stream.map_err(|e| {
        crate::error::Error::argument("mesh", e, "a mesh that meshoptimizer takes", "report this: it should not happen")
    })
}

#[cfg(not(feature = "meshopt"))]
fn compress(_: &ExportMesh<'_>, _: &View, _: &[u8]) -> Result<Vec<u8>> {
    Err(crate::export::without_meshopt("files for the web"))
}

/// Names the extensions, and adds the buffer that is in no file.
pub(super) fn push_unpacked(root: &mut json::Root, bytes: u64) -> Index<json::Buffer> {
    for name in [QUANTIZATION, COMPRESSION] {
        root.extensions_used.push(name.into());
        root.extensions_required.push(name.into());
    }
    let mut extension = extensions::buffer::Buffer::default();
    extension.others.insert(COMPRESSION.into(), json!({ "fallback": true }));
    root.push(json::Buffer {
        byte_length: USize64(bytes),
        name: None,
        uri: None,
        extensions: Some(extension),
        extras: None,
    })
}

/// A view that is decompressed by its reader.
pub(super) fn view(
    view: &View,
    stream: &Stream,
    unpacked: Index<json::Buffer>,
    buffer: Index<json::Buffer>,
) -> buffer::View {
    let stride = view.content.format().2;
    let mode = if view.content.is_indices() { "TRIANGLES" } else { "ATTRIBUTES" };
    let mut extension = extensions::buffer::View::default();
    extension.others.insert(
        COMPRESSION.into(),
        json!({
            "buffer": buffer.value(),
            "byteOffset": stream.offset,
            "byteLength": stream.bytes,
            "byteStride": stride,
            "count": view.count,
            "mode": mode,
        }),
    );
    let plain = super::plain_view(view, view.offset, unpacked);
    buffer::View { extensions: Some(extension), ..plain }
}

#[cfg(test)]
#[cfg(feature = "meshopt")]
mod tests {
    use super::*;
    use crate::export::gltf::{self, Scalars};
    use crate::export::test_mesh::TestMesh;
    use std::collections::BTreeMap;

    /// The JSON of a file and its binary chunk.
    fn chunks(glb: &[u8]) -> (Value, &[u8]) {
        let length = |at: usize| u32::from_le_bytes([0, 1, 2, 3].map(|i| glb[at + i])) as usize;
        let text = &glb[20..20 + length(12)];
        (serde_json::from_slice(text).expect("JSON"), &glb[28 + length(12)..])
    }

    /// The bytes of the view of an accessor, decompressed.
    fn view(json: &Value, binary: &[u8], accessor: &Value) -> Vec<u8> {
        let accessor = &json["accessors"][accessor.as_u64().expect("a number") as usize];
        let view = &json["bufferViews"][accessor["bufferView"].as_u64().expect("a number") as usize];
        let stream = &view["extensions"][COMPRESSION];
        let number = |name: &str| stream[name].as_u64().expect("a number") as usize;
        let bytes = &binary[number("byteOffset")..number("byteOffset") + number("byteLength")];
        let count = number("count");
        assert_eq!((number("buffer"), view["buffer"].as_u64()), (0, Some(1)));
        assert_eq!(accessor["count"].as_u64(), Some(count as u64));
        assert_eq!(view["byteLength"].as_u64(), Some((count * number("byteStride")) as u64));
        match (number("byteStride"), stream["mode"].as_str()) {
            (2, Some("TRIANGLES")) => {
                let indices = meshopt::decode_index_buffer::<u16>(bytes, count).expect("indices");
                indices.iter().flat_map(|i| i.to_le_bytes()).collect()
            }
            (4, Some("ATTRIBUTES")) => {
                meshopt::decode_vertex_buffer::<[u8; 4]>(bytes, count).expect("vertices").into_flattened()
            }
            (8, Some("ATTRIBUTES")) => {
                meshopt::decode_vertex_buffer::<[u8; 8]>(bytes, count).expect("vertices").into_flattened()
            }
            (12, Some("ATTRIBUTES")) => {
                meshopt::decode_vertex_buffer::<[u8; 12]>(bytes, count).expect("vertices").into_flattened()
            }
            other => panic!("{other:?}"),
        }
    }

    fn numbers(bytes: &[u8]) -> Vec<u16> {
        bytes.as_chunks().0.iter().map(|&b| u16::from_le_bytes(b)).collect()
    }

    #[test]
    fn decompressed_it_is_the_mesh_to_the_rounding_it_states() {
        let torus = TestMesh::torus(20);
        let values: Vec<f32> = (0..torus.positions.len()).map(|v| (v as f32).sqrt()).collect();
        let scalars = vec![Scalars { name: "NUMBER".into(), values: values.clone() }];
        let options = GltfOptions { for_web: true, scalars, ..Default::default() };
        let mut file = Vec::new();
        gltf::write(&mut file, &torus.mesh(), &options).expect("a sound mesh");
        let mut plain = Vec::new();
        gltf::write(&mut plain, &torus.mesh(), &GltfOptions { for_web: false, ..options }).expect("a sound mesh");
        assert!(2 * file.len() < plain.len(), "{} of {} bytes", file.len(), plain.len());

        let (json, binary) = chunks(&file);
        assert_eq!(json["extensionsRequired"], json!([QUANTIZATION, COMPRESSION]));
        let primitive = &json["meshes"][0]["primitives"][0];
        let attribute = |name: &str| view(&json, binary, &primitive["attributes"][name]);
        let found: Vec<f32> = attribute("_NUMBER").as_chunks().0.iter().map(|&b| f32::from_le_bytes(b)).collect();
        // Numbers tell the vertices.
        let origin: Vec<usize> = found.iter().map(|n| (n * n).round() as usize).collect();
        let lattice = &json["nodes"][0]["extras"]["positions"];
        let (step, stated) =
            (lattice["step"].as_f64().expect("step"), lattice["largest_error"].as_f64().expect("error"));
        let corner: [f64; 3] = serde_json::from_value(lattice["corner_in_world"].clone()).expect("a corner");
        assert_eq!(stated, gltf::position_error(&torus.mesh()));
        let places = numbers(&attribute("POSITION"));
        let colours = numbers(&attribute("COLOR_0"));
        let normals = numbers(&attribute("NORMAL"));
        for (v, &own) in origin.iter().enumerate() {
            assert_eq!(found[v], values[own]);
            let place = DVec3::from_array([0, 1, 2].map(|a| corner[a] + step * f64::from(places[4 * v + a])));
            assert!(place.distance(torus.positions[own]) <= stated * (1.0 + 1e-6), "vertex {own}");
            let colour = torus.colours[own].map(|c| (c * 65_535.0 + 0.5) as u16);
            assert_eq!(colours[4 * v..4 * v + 4], [colour[0], colour[1], colour[2], 65_535]);
            let normal = Vec3::from_array([0, 1, 2].map(|a| f32::from(normals[4 * v + a] as i16) / 32_767.0));
            assert!(normal.distance(torus.normals[own]) < 1e-4);
        }
        let mut triangles: BTreeMap<[usize; 3], u32> = BTreeMap::new();
        let turned = |t: [usize; 3]| (0..3).map(|i| [t[i], t[(i + 1) % 3], t[(i + 2) % 3]]).min().unwrap_or(t);
        for t in numbers(&view(&json, binary, &primitive["indices"])).as_chunks::<3>().0 {
            *triangles.entry(turned(t.map(|v| origin[usize::from(v)]))).or_default() += 1;
        }
        let expected: BTreeMap<[usize; 3], u32> =
            torus.triangles.iter().map(|t| (turned(t.map(|v| v as usize)), 1)).collect();
        assert_eq!(triangles, expected);
    }

    #[test]
    fn an_empty_mesh_is_a_file_without_a_mesh() {
        let torus = TestMesh::torus(6);
        let mesh = ExportMesh { triangles: &[], ..torus.mesh() };
        let mut file = Vec::new();
        gltf::write(&mut file, &mesh, &GltfOptions { for_web: true, ..Default::default() }).expect("a sound mesh");
        let text: Value = serde_json::from_slice(&file[20..]).expect("JSON");
        assert!(text.get("meshes").is_none() && text.get("extensionsRequired").is_none());
    }
}
