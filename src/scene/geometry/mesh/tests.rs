//! Meshes that would make a careless reader panic, loop or ask for all memory: each is refused by name.

use super::*;
use serde_json::{Value, json};

/// A triangle under one node, and its bytes: three positions, three indices of 16 bits, four spare ones.
fn triangle() -> (Value, Vec<u8>) {
    let mut bytes: Vec<u8> = [0f32, 0., 0., 1., 0., 0., 0., 1., 0.].iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend([0u16, 1, 2, 0, 0].iter().flat_map(|v| v.to_le_bytes()));
    let file = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1 }] }],
        "buffers": [{ "uri": "a.bin", "byteLength": 46 }],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 36 },
            { "buffer": 0, "byteOffset": 36, "byteLength": 10 },
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] },
            { "bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR" },
        ],
    });
    (file, bytes)
}

fn read(file: &Value, bytes: &[u8]) -> Result<TriangleMesh> {
    read_mesh(file.to_string().as_bytes(), &mut |_, _| Ok(bytes.to_vec()))
}

/// One change of the sound file, and words of the refusal.
#[test]
fn what_accessors_may_not_be() {
    let (sound, bytes) = triangle();
    assert_eq!(read(&sound, &bytes).expect("a triangle").triangles, [[0, 1, 2]]);
    let sparse = json!({
        "count": 1,
        "indices": { "bufferView": 1, "componentType": 5123 },
        "values": { "bufferView": 0 },
    });
    let cases: [(&str, Value, &[&str]); 16] = [
        // The crate's own checks read this accessor before they know that it exists.
        ("/meshes/0/primitives/0/attributes/POSITION", json!(2), &["accessor 2 of 2"]),
        // The crate's reader of indices has no answer to these.
        ("/accessors/1/componentType", json!(5126), &["indices in accessor 1", "F32", "UNSIGNED_BYTE"]),
        ("/accessors/1/componentType", json!(5122), &["indices in accessor 1", "I16"]),
        ("/accessors/1/componentType", json!(5120), &["indices in accessor 1", "I8"]),
        ("/accessors/1/type", json!("VEC2"), &["indices in accessor 1", "Vec2"]),
        ("/accessors/0/componentType", json!(5121), &["positions in accessor 0", "U8", "VEC3 of FLOAT"]),
        ("/accessors/0/type", json!("VEC2"), &["positions in accessor 0", "Vec2"]),
        ("/accessors/0/type", json!("MAT4"), &["positions in accessor 0", "Mat4"]),
        ("/accessors/0/sparse", sparse.clone(), &["positions in accessor 0", "sparse"]),
        ("/accessors/1/sparse", sparse, &["indices in accessor 1", "sparse"]),
        ("/accessors/0/count", json!(0), &["positions in accessor 0", "a count of 0"]),
        ("/accessors/1/count", json!(0), &["indices in accessor 1", "a count of 0"]),
        ("/accessors/1/count", json!(4), &["4 corners", "three corners"]),
        ("/accessors/0/count", json!(u64::MAX), &["positions in accessor 0", "more bytes"]),
        ("/accessors/0/byteOffset", json!(u64::MAX), &["positions in accessor 0", "more bytes"]),
        ("/bufferViews/0/byteStride", json!(4), &["positions in accessor 0", "a stride of 4"]),
    ];
    for (place, value, words) in cases {
        let mut file = sound.clone();
        let (parent, key) = place.rsplit_once('/').expect("a place");
        file.pointer_mut(parent).expect("its parent")[key] = value;
        let message = read(&file, &bytes).expect_err(place).to_string();
        assert!(words.iter().all(|word| message.contains(word)), "{place}: {message}");
    }
}

/// 60 nodes, each with the next one twice as its child: 2⁶⁰ paths through them.
#[test]
fn nodes_are_a_tree() {
    let (sound, bytes) = triangle();
    let twice = |n: usize| json!({ "children": [n + 1, n + 1], "mesh": 0 });
    let diamond = |n: usize| match n % 3 {
        0 => json!({ "children": [n + 1, n + 2] }),
        1 => json!({ "children": [n + 2] }),
        _ => json!({ "children": [n + 1] }),
    };
    let cases: [(Vec<Value>, &str); 5] = [
        ((0..60).map(twice).chain([json!({ "mesh": 0 })]).collect(), "node 60 with two parents"),
        ((0..60).map(diamond).chain([json!({ "mesh": 0 })]).collect(), "with two parents"),
        (vec![json!({ "children": [0] })], "node 0 with two parents, or below itself"),
        (vec![json!({ "children": [1] }), json!({ "children": [0] })], "node 0"),
        (
            (0..70).map(|n| json!({ "children": [n + 1] })).chain([json!({ "mesh": 0 })]).collect(),
            "nested more than 64",
        ),
    ];
    for (nodes, words) in cases {
        let mut file = sound.clone();
        file["nodes"] = Value::Array(nodes);
        let message = read(&file, &bytes).expect_err(words).to_string();
        assert!(message.contains(words), "{words}: {message}");
    }
    let mut file = sound.clone();
    file["scenes"][0]["nodes"] = json!([0, 0]);
    assert!(read(&file, &bytes).is_err(), "a root that stands twice");
    // The same mesh under several nodes is what nodes are for.
    file = sound;
    file["nodes"] = json!([{ "children": [1, 2] }, { "mesh": 0 }, { "mesh": 0, "scale": [-1, 1, 1] }]);
    assert_eq!(read(&file, &bytes).expect("two triangles").triangles, [[0, 1, 2], [3, 5, 4]]);
}

/// The header of a GLB says less than itself.
#[test]
fn a_glb_is_as_long_as_its_header() {
    for length in 0..12u32 {
        let bytes = [&b"glTF\x02\0\0\0"[..], &length.to_le_bytes(), &[0; 40]].concat();
        let message = read_mesh(&bytes, &mut |_, _| Ok(Vec::new())).expect_err("too short").to_string();
        assert!(message.contains(&format!("a GLB of {length} bytes")), "{message}");
    }
}

#[test]
fn positions_are_finite() {
    let (sound, bytes) = triangle();
    for wrong in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut bytes = bytes.clone();
        bytes[16..20].copy_from_slice(&wrong.to_le_bytes());
        let message = read(&sound, &bytes).expect_err("not finite").to_string();
        assert!(message.contains("vertex 1") && message.contains("not finite"), "{message}");
    }
    // Nodes that multiply to infinity: 10³⁸ of 10³⁸, nine times.
    let mut file = sound;
    let huge = |n: usize| json!({ "children": [n + 1], "scale": [1e38, 1e38, 1e38] });
    file["nodes"] = (0..9).map(huge).chain([json!({ "mesh": 0 })]).collect();
    let message = read(&file, &bytes).expect_err("not finite").to_string();
    assert!(message.contains("not finite"), "{message}");
    for text in ["v 0 0 inf\nv 0 0 0\nv 1 0 0\nf 1 2 3", "v 0 0 1e999\nv 0 0 0\nv 1 0 0\nf 1 2 3"] {
        assert!(read_mesh(text.as_bytes(), &mut |_, _| Ok(Vec::new())).is_err(), "{text}");
    }
}

#[test]
fn stl_is_read_as_text_and_binary_and_welded() {
    let facets = [[[0f32, 0., 0.], [1., 0., 0.], [0., 1., 0.]], [[1., 0., 0.], [1., 1., 0.], [0., 1., 0.]]];
    let mut binary = vec![b' '; 80];
    binary[..5].copy_from_slice(b"solid"); // As some programs write it.
    binary.extend(2u32.to_le_bytes());
    let mut text = "solid square\n".to_string();
    for facet in facets {
        binary.extend([0; 12]);
        facet.iter().flatten().for_each(|v| binary.extend(v.to_le_bytes()));
        binary.extend([0; 2]);
        text += "facet normal 0 0 1\n outer loop\n";
        facet.iter().for_each(|[x, y, z]| text += &format!("  vertex {x} {y} {z}\n"));
        text += " endloop\nendfacet\n";
    }
    text += "endsolid\n";
    let none = &mut |_: &str, _: u64| Ok(Vec::new());
    let mesh = read_mesh(&binary, none).unwrap();
    assert_eq!((mesh.positions.len(), &mesh.triangles[..]), (4, &[[0, 1, 2], [1, 3, 2]][..]));
    assert_eq!(read_mesh(text.as_bytes(), none).unwrap(), mesh);
    for wrong in ["solid\nfacet\nvertex 0 0\n", "solid\nvertex 0 0 0\nvertex 0 0 0\nendfacet\n", "solid\n"] {
        assert!(read_mesh(wrong.as_bytes(), none).is_err(), "{wrong}");
    }
    assert!(read_mesh(&binary[..binary.len() - 1], none).is_err());
}
