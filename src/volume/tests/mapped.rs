//! Samples that are read where they lie in their file are those that decoding gives.

use super::arrays::npy;
use super::maps::Map;
use super::nifti::Header;
use super::*;
use crate::error::Error;
use std::path::{Path, PathBuf};

/// No two axes alike, and more bytes than what is read at once.
const DIMS: [usize; 3] = [48, 40, 36];

fn encoded(encode: impl Fn(i32) -> Vec<u8>) -> Vec<u8> {
    (0..DIMS.iter().product::<usize>()).flat_map(|i| encode((i * i % 1009) as i32 - 300)).collect()
}

/// A file of that name; with `.gz` and the like not unpacked.
fn put(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    std::fs::write(folder.join(name), bytes).unwrap();
    folder.join(name)
}

fn opened(path: &Path, map: bool, region: Option<&str>) -> Result<Volume> {
    let choice = Choice { map, region: region.map(|r| r.parse().unwrap()), ..Choice::default() };
    open_with(path, &ReadHint { choice, ..ReadHint::default() })
}

/// Opens a file in both ways; the volumes must be alike. Whether it was mapped.
fn alike(path: &Path) -> bool {
    let (mapped, read) = (opened(path, true, None).unwrap(), opened(path, false, None).unwrap());
    assert_eq!(mapped.samples().bytes(), read.samples().bytes(), "{path:?}");
    assert_eq!((mapped.content_hash(), mapped.raw_range()), (read.content_hash(), read.raw_range()), "{path:?}");
    assert_eq!((&mapped.notes, &mapped.name, mapped.slope()), (&read.notes, &read.name, read.slope()), "{path:?}");
    assert_eq!(read.samples().bytes_owned(), read.samples().bytes().len() as u64);
    let part = |map| opened(path, map, Some("3:40,:,5:20")).unwrap();
    assert_eq!(part(true).samples(), part(false).samples(), "{path:?}");
    assert_eq!(opened(path, true, Some(":,:,:")).unwrap().samples(), read.samples(), "{path:?}");
    mapped.samples().bytes_owned() == 0
}

#[test]
fn mapped_samples_are_those_that_decoding_gives_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let [x, y, z] = DIMS;
    let o = Order::Little;
    let types: [(&str, usize, Vec<u8>); 5] = [
        ("uint8", 1, encoded(|v| vec![v as u8])),
        ("int8", 1, encoded(|v| vec![v as u8])),
        ("uint16", 2, encoded(|v| o.u16((v + 300) as u16 * 60))),
        ("int16", 2, encoded(|v| o.i16(v as i16))),
        ("float32", 4, encoded(|v| o.f32(v as f32 * 0.1))),
    ];
    for (name, size, data) in &types {
        // Raw samples behind a header of some length: aligned or not.
        for offset in [0, 16, 3] {
            let head = vec![9; offset];
            put(folder, "x.raw", &[&head, &data[..]].concat());
            let text = format!(
                r#"{{"dims": [{x},{y},{z}], "type": "{name}", "offset": {offset}, "data": "x.raw", "slope": -2, "inter": 1}}"#
            );
            let is_mapped = alike(&put(folder, "x.json", text.as_bytes()));
            assert_eq!(is_mapped, offset % size == 0, "{name} {offset}");
        }
        let descr = ["'|u1'", "'|i1'", "'<u2'", "'<i2'", "'<f4'"][types.iter().position(|t| t.0 == *name).unwrap()];
        let array = npy(1, descr, false, &format!("{z}, {y}, {x}"), data);
        let start = array.len() - data.len();
        assert_eq!(alike(&put(folder, "x.npy", &array)), start.is_multiple_of(*size), "{name}");
        let fortran = npy(1, descr, true, &format!("{z}, {y}, {x}"), data);
        assert!(!alike(&put(folder, "f.npy", &fortran)));
        // A comment fills the header up to a multiple of 4.
        for filled in [true, false] {
            let kind =
                ["uchar", "signed char", "ushort", "short", "float"][types.iter().position(|t| t.0 == *name).unwrap()];
            let header = |more: &str| {
                format!(
                    "NRRD0004\n#{more}\ntype: {kind}\ndimension: 3\nsizes: {x} {y} {z}\nendian: little\nencoding: raw\n\n"
                )
            };
            let fill = (8 - header("").len() % 4) % 4 + usize::from(!filled);
            let bytes = [header(&"-".repeat(fill)).as_bytes(), data].concat();
            assert_eq!(alike(&put(folder, "x.nrrd", &bytes)), filled || *size == 1, "{name}");
        }
        put(folder, "d.raw", data);
        let kind = ["UCHAR", "CHAR", "USHORT", "SHORT", "FLOAT"][types.iter().position(|t| t.0 == *name).unwrap()];
        let header = format!(
            "ObjectType = Image\nNDims = 3\nDimSize = {x} {y} {z}\nBinaryDataByteOrderMSB = False\nElementType = MET_{kind}\nElementDataFile = d.raw\n"
        );
        assert!(alike(&put(folder, "x.mhd", header.as_bytes())), "{name}");
        let code = [2, 256, 512, 4, 16][types.iter().position(|t| t.0 == *name).unwrap()];
        let header = Header::new(o, &DIMS.map(|n| n as i16), code);
        assert!(alike(&put(folder, "x.nii", &header.with(data.iter().copied()))), "{name}");
        assert!(!alike(&put(folder, "x.nii.gz", &gzip(&header.with(data.iter().copied())))));
        if let Some(mode) = [None, Some(0), Some(6), Some(1), Some(2)][types.iter().position(|t| t.0 == *name).unwrap()]
        {
            let mut map = Map::new(o, DIMS.map(|n| n as i32), mode);
            assert!(alike(&put(folder, "x.mrc", &map.with(data.clone()))), "{name}");
            map.words(17, &[2, 1, 3]);
            assert!(!alike(&put(folder, "turned.mrc", &map.with(data.clone()))), "{name}");
        }
    }
    // The second time point of two.
    let header = Header::new(o, &[DIMS[0] as i16, DIMS[1] as i16, DIMS[2] as i16, 2], 4);
    let [(.., first), (.., second)] = [&types[2], &types[3]];
    let path = put(folder, "t.nii", &header.with(first.iter().chain(second).copied()));
    let at = |map| {
        let choice = Choice { map, timepoint: Some(1), ..Choice::default() };
        open_with(&path, &ReadHint { choice, ..ReadHint::default() }).unwrap()
    };
    assert_eq!((at(true).samples(), at(true).samples().bytes_owned()), (at(false).samples(), 0));
    // What has to be changed is decoded: another byte order, NaN, and numbers that f32 cannot calculate with.
    let big = Header::new(Order::Big, &DIMS.map(|n| n as i16), 4);
    assert!(!alike(&put(folder, "big.nii", &big.with(encoded(|v| Order::Big.i16(v as i16))))));
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e38] {
        let data = encoded(|v| o.f32(if v == 17 { bad } else { v as f32 }));
        let header = Header::new(o, &DIMS.map(|n| n as i16), 16);
        assert!(!alike(&put(folder, "bad.nii", &header.with(data))), "{bad}");
    }
}

#[test]
fn files_that_are_cut_or_changed_are_errors_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let header = Header::new(Order::Little, &DIMS.map(|n| n as i16), 4);
    let whole = header.with(encoded(|v| Order::Little.i16(v as i16)));
    let path = put(folder.path(), "x.nii", &whole[..whole.len() - 1]);
    for map in [true, false] {
        let text = opened(&path, map, None).unwrap_err().to_string();
        assert!(text.contains("x.nii") && text.contains("incomplete"), "{text}");
    }
    // Nothing is mapped unless that is asked for.
    put(folder.path(), "x.nii", &whole);
    assert!(open(&path).unwrap().samples().bytes_owned() > 0);
    let (mapped, read) = (opened(&path, true, None).unwrap(), opened(&path, false, None).unwrap());
    assert!(mapped.samples().check().is_ok());
    // A new file under the name leaves the old one to who has it; a change in place is noticed.
    std::fs::rename(put(folder.path(), "new.nii", &vec![0; whole.len()]), &path).unwrap();
    assert_eq!(mapped.samples(), read.samples());
    drop(mapped);
    put(folder.path(), "x.nii", &whole);
    let mapped = opened(&path, true, None).unwrap();
    put(folder.path(), "x.nii", &[&whole[..], &[0]].concat());
    let refused = mapped.samples().check();
    assert!(matches!(refused, Err(Error::Io { .. })), "{refused:?}");
    let text = refused.unwrap_err().to_string();
    assert!(text.contains("x.nii") && text.contains("--no-map"), "{text}");
}
