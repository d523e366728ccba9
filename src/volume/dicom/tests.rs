//! Series made by hand; those of pydicom and highdicom are read in `tests/readers/formats_written.py`.

use super::super::open::open_with;
use super::super::{Choice, ReadHint, Volume};
use crate::error::Result;
use glam::DVec3;
use std::path::Path;

fn element(tag: (u16, u16), kind: &str, value: &[u8]) -> Vec<u8> {
    let mut value = value.to_vec();
    if value.len() % 2 == 1 {
        value.push(if kind == "UI" || kind == "OW" { 0 } else { b' ' });
    }
    let head = [&tag.0.to_le_bytes()[..], &tag.1.to_le_bytes(), kind.as_bytes()].concat();
    let length = match kind {
        "OW" => [&[0; 2][..], &(value.len() as u32).to_le_bytes()].concat(),
        _ => (value.len() as u16).to_le_bytes().to_vec(),
    };
    [head, length, value].concat()
}

/// A slice of 3 × 2 samples of value `base` + index at a height.
fn slice(series: &str, instance: &str, z: f64, base: i16) -> Vec<u8> {
    let short = |v: u16| v.to_le_bytes();
    let pixels: Vec<u8> = (0..6).flat_map(|i| (base + i).to_le_bytes()).collect();
    [
        vec![0; 128],
        b"DICM".to_vec(),
        element((2, 0x10), "UI", b"1.2.840.10008.1.2.1"),
        element((8, 0x18), "UI", instance.as_bytes()),
        element((8, 0x60), "CS", b"CT"),
        element((0x10, 0x10), "PN", b"Doe^Jane"),
        element((0x20, 0x0e), "UI", series.as_bytes()),
        element((0x20, 0x32), "DS", format!("1\\2\\{z}").as_bytes()),
        element((0x20, 0x37), "DS", b"1\\0\\0\\0\\1\\0"),
        element((0x28, 2), "US", &short(1)),
        element((0x28, 4), "CS", b"MONOCHROME2"),
        element((0x28, 0x10), "US", &short(2)),
        element((0x28, 0x11), "US", &short(3)),
        element((0x28, 0x30), "DS", b"0.7\\0.5"),
        element((0x28, 0x100), "US", &short(16)),
        element((0x28, 0x101), "US", &short(16)),
        element((0x28, 0x102), "US", &short(15)),
        element((0x28, 0x103), "US", &short(1)),
        element((0x28, 0x1052), "DS", b"-10"),
        element((0x28, 0x1053), "DS", b"2"),
        element((0x7fe0, 0x10), "OW", &pixels),
    ]
    .concat()
}

fn open(path: &Path, choice: Choice) -> Result<Volume> {
    open_with(path, &ReadHint { choice, ..ReadHint::default() })
}

/// Slices at these heights, in files named against their order.
fn series(folder: &Path, heights: &[f64]) {
    for (i, z) in heights.iter().enumerate() {
        let name = format!("{}.dcm", 99 - i);
        std::fs::write(folder.join(name), slice("1.2", &format!("1.2.{i}"), *z, (100.0 * z) as i16)).unwrap();
    }
}

#[test]
fn slices_are_ordered_by_where_they_lie() {
    let folder = tempfile::tempdir().unwrap();
    series(folder.path(), &[3.0, 1.0, 2.0, 4.0]);
    for path in [folder.path().to_path_buf(), folder.path().join("98.dcm")] {
        let volume = open(&path, Choice::default()).unwrap();
        assert_eq!((volume.dims(), volume.slope(), volume.inter()), ([3, 2, 4], 2.0, -10.0));
        let raw: Vec<f32> = (0..4).map(|z| volume.samples().raw(6 * z + 5)).collect();
        assert_eq!(raw, [105.0, 205.0, 305.0, 405.0]);
        // LPS to RAS+: the first row runs to -x.
        assert_eq!(volume.world_from_grid().point(DVec3::new(2.0, 1.0, 3.0)), DVec3::new(-2.0, -2.7, 4.0));
        assert!(volume.up.is_anatomical() && !format!("{:?}", volume.notes).contains("Doe"));
    }
    // The same instance again, under another name.
    std::fs::copy(folder.path().join("98.dcm"), folder.path().join("copy")).unwrap();
    let volume = open(folder.path(), Choice::default()).unwrap();
    assert!(volume.dims()[2] == 4 && volume.notes.iter().any(|n| n.text.contains("twice")), "{:?}", volume.notes);
}

#[test]
fn gaps_are_named_and_filled_where_allowed() {
    let folder = tempfile::tempdir().unwrap();
    series(folder.path(), &[1.0, 2.0, 4.0]);
    let text = open(folder.path(), Choice::default()).unwrap_err().to_string();
    assert!(text.contains("1 slices missing between slices 1 and 2") && text.contains("--allow-gaps"), "{text}");
    let volume = open(folder.path(), Choice { allow_gaps: true, ..Choice::default() }).unwrap();
    assert_eq!((volume.dims(), volume.samples().raw(12)), ([3, 2, 4], 300.0));
    // A slice far away makes no volume of a million.
    std::fs::write(folder.path().join("far.dcm"), slice("1.2", "9", 1e7, 0)).unwrap();
    assert!(open(folder.path(), Choice { allow_gaps: true, ..Choice::default() }).is_err());
}

#[test]
fn several_series_are_listed_and_one_is_chosen() {
    let folder = tempfile::tempdir().unwrap();
    series(folder.path(), &[1.0, 2.0]);
    for z in 0..3 {
        let other = slice("1.9", &format!("1.9.{z}"), f64::from(z), 0);
        std::fs::write(folder.path().join(format!("other{z}")), other).unwrap();
    }
    let text = open(folder.path(), Choice::default()).unwrap_err().to_string();
    assert!(text.contains("2 series") && text.contains("UID 1.9") && text.contains("--series"), "{text}");
    for (series, count) in [("0", 2), ("1", 3), ("1.9", 3), ("1.2", 2)] {
        let choice = Choice { series: Some(series.into()), ..Choice::default() };
        assert_eq!(open(folder.path(), choice).unwrap().dims()[2], count, "{series}");
    }
    let choice = Choice { series: Some("5".into()), ..Choice::default() };
    assert!(open(folder.path(), choice).unwrap_err().to_string().contains("2 series"));
}

#[test]
fn a_file_cut_anywhere_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    series(folder.path(), &[1.0, 2.0]);
    let path = folder.path().join("98.dcm");
    let whole = std::fs::read(&path).unwrap();
    for length in 0..whole.len() {
        std::fs::write(&path, &whole[..length]).unwrap();
        assert!(open(folder.path(), Choice::default()).is_err(), "{length} of {}", whole.len());
    }
}
