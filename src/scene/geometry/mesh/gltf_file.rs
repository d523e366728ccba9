//! glTF and GLB: the triangles of the scene, placed by its nodes.

use super::{MOST_TRIANGLES, TriangleMesh, damaged};
use crate::error::Result;
use glam::{DMat4, DVec3};
use gltf::mesh::Mode;

/// Deepest nesting of nodes; cycles are refused by it.
const DEEPEST: usize = 64;

pub(super) fn read(bytes: &[u8], beside: &mut dyn FnMut(&str) -> Result<Vec<u8>>) -> Result<TriangleMesh> {
    let file = gltf::Gltf::from_slice(bytes).map_err(|e| damaged(e.to_string(), "glTF 2.0"))?;
    let mut buffers = Vec::new();
    for buffer in file.buffers() {
        let data = match buffer.source() {
            gltf::buffer::Source::Bin => file.blob.clone().unwrap_or_default(),
            gltf::buffer::Source::Uri(uri) if uri.starts_with("data:") => {
                return Err(damaged("a buffer inside the JSON (data:)", "a GLB, or a .bin beside the file"));
            }
            gltf::buffer::Source::Uri(uri) => beside(uri)?,
        };
        if data.len() < buffer.length() {
            return Err(damaged(format!("a buffer of {} bytes", data.len()), "as many bytes as the file says"));
        }
        buffers.push(data);
    }
    let mut mesh = TriangleMesh::default();
    let scene = file.default_scene().or_else(|| file.scenes().next());
    let scene = scene.ok_or_else(|| damaged("no scene", "a glTF file with a scene"))?;
    for node in scene.nodes() {
        add(&node, DMat4::IDENTITY, &buffers, 0, &mut mesh)?;
    }
    Ok(mesh)
}

fn add(
    node: &gltf::Node<'_>,
    world_from_parent: DMat4,
    buffers: &[Vec<u8>],
    depth: usize,
    out: &mut TriangleMesh,
) -> Result<()> {
    if depth > DEEPEST {
        return Err(damaged(format!("nodes nested more than {DEEPEST} deep"), "a tree of nodes"));
    }
    let matrix = node.transform().matrix().map(|column| column.map(f64::from));
    let world_from_node = world_from_parent * DMat4::from_cols_array_2d(&matrix);
    for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
        if primitive.mode() != Mode::Triangles {
            return Err(damaged(format!("a primitive of {:?}", primitive.mode()), "triangles"));
        }
        // The crate reads by the accessor without looking at lengths.
        for accessor in [primitive.get(&gltf::Semantic::Positions), primitive.indices()].into_iter().flatten() {
            check(&accessor, buffers)?;
        }
        let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(Vec::as_slice));
        let positions = reader.read_positions().ok_or_else(|| damaged("no positions", "positions of vertices"))?;
        let first = out.positions.len() as u32;
        let place = |p: [f32; 3]| world_from_node.transform_point3(DVec3::from_array(p.map(f64::from)));
        out.positions.extend(positions.map(place));
        let count = out.positions.len() as u32 - first;
        let indices: Vec<u32> = match reader.read_indices() {
            Some(indices) => indices.into_u32().collect(),
            None => (0..count).collect(),
        };
        if let Some(i) = indices.iter().find(|i| **i >= count) {
            return Err(damaged(format!("index {i} of {count} vertices"), "indices of vertices"));
        }
        let is_mirrored = world_from_node.determinant() < 0.0;
        out.triangles.extend(indices.as_chunks::<3>().0.iter().map(|&[a, b, c]| {
            if is_mirrored { [first + a, first + c, first + b] } else { [first + a, first + b, first + c] }
        }));
        if out.triangles.len() > MOST_TRIANGLES {
            return Err(damaged("more than 2^24 triangles", "at most 2^24 triangles"));
        }
    }
    node.children().try_for_each(|child| add(&child, world_from_node, buffers, depth + 1, out))
}

/// Whether the bytes of an accessor are there.
fn check(accessor: &gltf::Accessor<'_>, buffers: &[Vec<u8>]) -> Result<()> {
    let Some(view) = accessor.view() else {
        return Err(damaged("a sparse accessor", "plain accessors"));
    };
    let stride = view.stride().unwrap_or(accessor.size());
    let last = accessor.count().checked_sub(1).and_then(|n| n.checked_mul(stride));
    let end = last.and_then(|n| n.checked_add(accessor.size())).and_then(|n| n.checked_add(accessor.offset()));
    let inside = end.is_some_and(|end| end <= view.length());
    let whole = view.offset().checked_add(view.length());
    let there = buffers.get(view.buffer().index()).is_some_and(|b| whole.is_some_and(|whole| whole <= b.len()));
    if inside && there {
        Ok(())
    } else {
        Err(damaged("an accessor beyond its buffer", "accessors inside their buffers"))
    }
}
