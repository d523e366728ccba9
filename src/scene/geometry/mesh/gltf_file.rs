//! glTF and GLB: the triangles of the scene, placed by its nodes.
//!
//! The crate `gltf` (1.4.1) checks the JSON, not what it says of bytes: its readers panic on indices that are no
//! integers, on accessors of another size than they expect and on sparse ones, and it follows whatever children nodes
//! have; its checks themselves panic where the accessor of positions does not exist. So each accessor is checked here before it is read, and each node is entered once.

use super::{MOST_TRIANGLES, TriangleMesh, damaged};
use crate::error::Result;
use glam::{DMat4, DVec3};
use gltf::accessor::{DataType, Dimensions};
use gltf::mesh::Mode;

/// Deepest nesting of nodes, for the stack.
const DEEPEST: usize = 64;
/// Most vertices with those of all copies: as many as that many triangles without shared corners have.
const MOST_VERTICES: usize = 3 * MOST_TRIANGLES;

pub(super) fn read(bytes: &[u8], beside: &mut dyn FnMut(&str, u64) -> Result<Vec<u8>>) -> Result<TriangleMesh> {
    let (file, blob) = document(bytes)?;
    let mut buffers = Vec::new();
    for buffer in file.buffers() {
        let data = match buffer.source() {
            gltf::buffer::Source::Bin => blob.clone(),
            gltf::buffer::Source::Uri(uri) if uri.starts_with("data:") => {
                return Err(damaged("a buffer inside the JSON (data:)", "a GLB, or a .bin beside the file"));
            }
            gltf::buffer::Source::Uri(uri) => beside(uri, buffer.length() as u64)?,
        };
        if data.len() < buffer.length() {
            return Err(damaged(format!("a buffer of {} bytes", data.len()), "as many bytes as the file says"));
        }
        buffers.push(data);
    }
    let scene = file.default_scene().or_else(|| file.scenes().next());
    let scene = scene.ok_or_else(|| damaged("no scene", "a glTF file with a scene"))?;
    let entered = vec![false; file.nodes().count()];
    let mut reading = Reading { buffers, entered, mesh: TriangleMesh::default() };
    for node in scene.nodes() {
        reading.add(&node, DMat4::IDENTITY, 0)?;
    }
    Ok(reading.mesh)
}

/// The JSON of a file and the binary chunk of a GLB, with all that the crate checks and what its checks rely on.
fn document(bytes: &[u8]) -> Result<(gltf::Document, Vec<u8>)> {
    let refused = |e: gltf::Error| damaged(e.to_string(), "glTF 2.0");
    // The length in the header of a GLB; the crate takes 12 from it.
    let length = bytes.get(8..12).filter(|_| bytes.starts_with(b"glTF")).and_then(|four| four.try_into().ok());
    if let Some(short) = length.map(u32::from_le_bytes).filter(|&n| n < 12) {
        return Err(damaged(format!("a GLB of {short} bytes"), "at least its header of 12 bytes"));
    }
    let gltf::Gltf { document, blob } = gltf::Gltf::from_slice_without_validation(bytes).map_err(refused)?;
    let json = document.into_json();
    let accessors = json.accessors.len();
    let attributes = json.meshes.iter().flat_map(|mesh| &mesh.primitives).flat_map(|primitive| &primitive.attributes);
    if let Some(wrong) = attributes.map(|(_, accessor)| accessor.value()).find(|&accessor| accessor >= accessors) {
        return Err(damaged(format!("accessor {wrong} of {accessors}"), "accessors that the file has"));
    }
    Ok((gltf::Document::from_json(json).map_err(refused)?, blob.unwrap_or_default()))
}

/// A file on its way to a mesh.
struct Reading {
    buffers: Vec<Vec<u8>>,
    /// Of each node. glTF 2.0, 3.5.2: nodes form strict trees; where they do not, n of them can have 2ⁿ paths.
    entered: Vec<bool>,
    mesh: TriangleMesh,
}

impl Reading {
    fn add(&mut self, node: &gltf::Node<'_>, world_from_parent: DMat4, depth: usize) -> Result<()> {
        if depth > DEEPEST {
            return Err(damaged(format!("nodes nested more than {DEEPEST} deep"), "a flatter tree of nodes"));
        }
        match self.entered.get_mut(node.index()) {
            Some(entered) if !*entered => *entered = true,
            _ => {
                let found = format!("node {} with two parents, or below itself", node.index());
                return Err(damaged(found, "nodes that form trees, as glTF 2.0 says"));
            }
        }
        let matrix = node.transform().matrix().map(|column| column.map(f64::from));
        let world_from_node = world_from_parent * DMat4::from_cols_array_2d(&matrix);
        for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
            self.add_primitive(&primitive, world_from_node)?;
        }
        node.children().try_for_each(|child| self.add(&child, world_from_node, depth + 1))
    }

    fn add_primitive(&mut self, primitive: &gltf::Primitive<'_>, world_from_node: DMat4) -> Result<()> {
        if primitive.mode() != Mode::Triangles {
            return Err(damaged(format!("a primitive of {:?}", primitive.mode()), "triangles"));
        }
        let no_positions = || damaged("no positions", "positions of vertices");
        let of_positions = primitive.get(&gltf::Semantic::Positions).ok_or_else(no_positions)?;
        check(&of_positions, &self.buffers, "positions", Dimensions::Vec3, &[DataType::F32])?;
        let numbers = [DataType::U8, DataType::U16, DataType::U32];
        if let Some(of_indices) = primitive.indices() {
            check(&of_indices, &self.buffers, "indices", Dimensions::Scalar, &numbers)?;
        }
        let TriangleMesh { positions, triangles } = &mut self.mesh;
        if positions.len() + of_positions.count() > MOST_VERTICES {
            return Err(damaged(format!("more than {MOST_VERTICES} vertices"), "fewer vertices"));
        }
        let reader = primitive.reader(|buffer| self.buffers.get(buffer.index()).map(Vec::as_slice));
        let first = positions.len() as u32;
        let place = |p: [f32; 3]| world_from_node.transform_point3(DVec3::from_array(p.map(f64::from)));
        positions.extend(reader.read_positions().ok_or_else(no_positions)?.map(place));
        if let Some(wrong) = positions[first as usize..].iter().position(|p| !p.is_finite()) {
            let found = format!("vertex {wrong} of a primitive at a position that is not finite");
            return Err(damaged(found, "finite positions, and nodes that leave them finite"));
        }
        let count = positions.len() as u32 - first;
        let indices: Vec<u32> = match reader.read_indices() {
            Some(indices) => indices.into_u32().collect(),
            None => (0..count).collect(),
        };
        if !indices.len().is_multiple_of(3) {
            return Err(damaged(format!("{} corners of triangles", indices.len()), "three corners for each triangle"));
        }
        if let Some(i) = indices.iter().find(|i| **i >= count) {
            return Err(damaged(format!("index {i} of {count} vertices"), "indices of vertices"));
        }
        let is_mirrored = world_from_node.determinant() < 0.0;
        triangles.extend(indices.as_chunks::<3>().0.iter().map(|&[a, b, c]| {
            if is_mirrored { [first + a, first + c, first + b] } else { [first + a, first + b, first + c] }
        }));
        if triangles.len() > MOST_TRIANGLES {
            return Err(damaged("more than 2^24 triangles", "at most 2^24 triangles"));
        }
        Ok(())
    }
}

/// Whether an accessor is what its reader takes it for, and its bytes are there.
fn check(
    accessor: &gltf::Accessor<'_>,
    buffers: &[Vec<u8>],
    what: &str,
    dimensions: Dimensions,
    types: &[DataType],
) -> Result<()> {
    let refuse = |found: String, expected: &str| -> Result<()> {
        Err(damaged(format!("{what} in accessor {}: {found}", accessor.index()), expected))
    };
    let (found, kind) = (accessor.dimensions(), accessor.data_type());
    if found != dimensions || !types.contains(&kind) {
        let expected = if types.len() == 1 { "VEC3 of FLOAT" } else { "SCALAR of UNSIGNED_BYTE, _SHORT or _INT" };
        return refuse(format!("{found:?} of {kind:?}"), expected);
    }
    if accessor.sparse().is_some() {
        return refuse("a sparse accessor".into(), "plain accessors: export without sparse data");
    }
    if accessor.count() == 0 {
        return refuse("a count of 0".into(), "at least one element");
    }
    let Some(view) = accessor.view() else {
        return refuse("no buffer view".into(), "plain accessors, not compressed");
    };
    let (size, stride) = (accessor.size(), view.stride().unwrap_or(accessor.size()));
    if stride < size {
        return refuse(format!("a stride of {stride} bytes"), "a stride of at least the size of an element");
    }
    let end = (accessor.count() - 1).checked_mul(stride).and_then(|n| n.checked_add(size));
    let end = end.and_then(|n| n.checked_add(accessor.offset()));
    let whole = view.offset().checked_add(view.length());
    let there = buffers.get(view.buffer().index()).is_some_and(|b| whole.is_some_and(|whole| whole <= b.len()));
    if !there || end.is_none_or(|end| end > view.length()) {
        return refuse("more bytes than its buffer has".into(), "accessors inside their buffers");
    }
    Ok(())
}
