//! Hierarchies made by hand; those of zarr-python are read in `tests/readers/formats_written.py`.

use super::super::open::open_with;
use super::super::{Choice, ReadHint, Volume};
use crate::error::Result;
use glam::DVec3;
use serde_json::{Value, json};
use std::path::Path;

const SHAPE: [usize; 3] = [3, 4, 5]; // z, y, x

/// value = 100x + 10y + z.
fn sample(x: usize, y: usize, z: usize) -> u16 {
    (100 * x + 10 * y + z) as u16
}

/// An array of version 3 in chunks of 2 × 2 × 2, big-endian, without those that `skip` names.
fn array(folder: &Path, skip: &[&str]) {
    let meta = json!({
        "zarr_format": 3, "node_type": "array", "shape": SHAPE, "data_type": "uint16", "fill_value": 7,
        "chunk_grid": { "name": "regular", "configuration": { "chunk_shape": [2, 2, 2] } },
        "chunk_key_encoding": { "name": "default", "configuration": { "separator": "/" } },
        "codecs": [{ "name": "bytes", "configuration": { "endian": "big" } }], "attributes": {},
    });
    std::fs::create_dir_all(folder).unwrap();
    std::fs::write(folder.join("zarr.json"), meta.to_string()).unwrap();
    for (k, j, i) in (0..2).flat_map(|k| (0..2).flat_map(move |j| (0..3).map(move |i| (k, j, i)))) {
        let key = format!("c/{k}/{j}/{i}");
        if skip.contains(&key.as_str()) {
            continue;
        }
        let mut bytes = Vec::new();
        for (z, y, x) in (0..2).flat_map(|z| (0..2).flat_map(move |y| (0..2).map(move |x| (z, y, x)))) {
            bytes.extend(sample(2 * i + x, 2 * j + y, 2 * k + z).to_be_bytes());
        }
        let path = folder.join(key);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }
}

fn image(folder: &Path, attributes: Value) {
    let meta = json!({ "zarr_format": 3, "node_type": "group", "attributes": attributes });
    std::fs::create_dir_all(folder).unwrap();
    std::fs::write(folder.join("zarr.json"), meta.to_string()).unwrap();
}

fn open(folder: &Path, choice: Choice) -> Result<Volume> {
    open_with(folder, &ReadHint { choice, ..ReadHint::default() })
}

#[test]
fn a_region_reads_the_chunks_that_it_touches() {
    let folder = tempfile::tempdir().unwrap();
    array(folder.path(), &["c/0/1/2"]);
    let whole = open(folder.path(), Choice::default()).unwrap();
    assert_eq!(whole.dims(), [5, 4, 3]);
    for (x, y, z) in [(0, 0, 0), (4, 1, 1), (3, 3, 2)] {
        assert_eq!(whole.samples().raw(x + 5 * (y + 4 * z)), f32::from(sample(x, y, z)));
    }
    // The chunk from (4, 2, 0) on is not stored.
    assert_eq!(whole.samples().raw(4 + 5 * (2 + 4)), 7.0);
    assert!(whole.notes.iter().any(|n| n.text.contains("1 of 12 chunks")), "{:?}", whole.notes);
    // A damaged chunk stops those that touch it, and no others.
    std::fs::write(folder.path().join("c/1/1/1"), [0; 15]).unwrap();
    let text = open(folder.path(), Choice::default()).unwrap_err().to_string();
    assert!(text.contains("c/1/1/1") && text.contains("15 bytes of samples instead of 16"), "{text}");
    let choice = Choice { region: Some("1:4,1:3,0:2".parse().unwrap()), ..Choice::default() };
    let part = open(folder.path(), choice).unwrap();
    assert_eq!((part.dims(), part.world_from_grid().offset()), ([3, 2, 2], DVec3::new(1.0, 1.0, 0.0)));
    assert_eq!(part.samples().raw(2 + 3 * (1 + 2)), f32::from(sample(3, 2, 1)));
}

#[test]
fn an_image_is_placed_by_its_level_and_then_by_itself() {
    let folder = tempfile::tempdir().unwrap();
    let axes = ["z", "y", "x"].map(|name| json!({ "name": name, "type": "space", "unit": "micrometer" }));
    let scale = |s: [f64; 3]| json!({ "type": "scale", "scale": s });
    let moved = json!({ "type": "translation", "translation": [3.0, 2.0, 1.0] });
    image(
        folder.path(),
        json!({ "ome": { "version": "0.5", "multiscales": [{ "axes": axes, "datasets": [
        { "path": "0", "coordinateTransformations": [scale([3.0, 2.0, 1.0]), moved] },
        { "path": "s1", "coordinateTransformations": [scale([6.0, 4.0, 2.0])] },
    ], "coordinateTransformations": [scale([10.0, 10.0, 10.0])] }] } }),
    );
    array(&folder.path().join("0"), &[]);
    array(&folder.path().join("s1"), &[]);
    let place = |level: usize| {
        let choice = Choice { level: Some(super::super::Level::Index(level)), ..Choice::default() };
        let volume = open(folder.path(), choice).unwrap();
        (volume.world_from_grid().spacing(), volume.world_from_grid().offset(), volume.notes.len())
    };
    assert_eq!(place(0), (DVec3::new(10.0, 20.0, 30.0), DVec3::new(10.0, 20.0, 30.0), 1));
    // Without a translation of its own: a note.
    assert_eq!(place(1), (DVec3::new(20.0, 40.0, 60.0), DVec3::ZERO, 2));
    std::fs::remove_dir_all(folder.path().join("s1")).unwrap();
    assert!(open(folder.path(), Choice::default()).unwrap_err().to_string().contains("no array s1"));
}

#[test]
fn what_is_no_image_says_where_one_is() {
    for (attributes, said) in [
        (json!({ "ome": { "plate": { "wells": [{ "path": "A/1" }, { "path": "B/2" }] } } }), "FOLDER/A/1/0"),
        (json!({ "ome": { "well": { "images": [{ "path": "0" }] } } }), "a well"),
        (json!({ "ome": { "labels": ["cells"] } }), "FOLDER/cells"),
        (json!({ "multiscales": [] }), "without an image"),
        (json!({ "multiscales": [{ "datasets": [{ "path": "../0" }] }] }), "--allow-outside"),
        (
            json!({ "multiscales": [{ "datasets": [{ "path": "0", "coordinateTransformations": [{ "type": "affine" }] }] }] }),
            "affine",
        ),
        (json!({}), "without image"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        image(folder.path(), attributes);
        let text = open(folder.path(), Choice::default()).unwrap_err().to_string();
        assert!(text.contains(said), "{text}");
    }
    // Arrays in a group: one is chosen by its name.
    let folder = tempfile::tempdir().unwrap();
    image(folder.path(), json!({}));
    for name in ["density", "mask"] {
        array(&folder.path().join(name), &[]);
    }
    assert!(open(folder.path(), Choice::default()).unwrap_err().to_string().contains("density, mask"));
    let choice = Choice { array: Some("mask".into()), ..Choice::default() };
    assert_eq!(open(folder.path(), choice).unwrap().series.array, 1);
    let text = open_with(folder.path().join("zarr.json"), &ReadHint::default()).unwrap_err().to_string();
    assert!(text.contains("isolume info FOLDER"), "{text}");
}
