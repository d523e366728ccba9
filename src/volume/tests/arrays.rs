use super::*;
use ::tiff::encoder::{Rational, TiffEncoder, colortype};
use ::tiff::tags::Tag;
use std::io::Cursor;

pub(super) fn npy(version: u8, descr: &str, fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
    let order = if fortran { "True" } else { "False" };
    let text = format!("{{'descr': {descr}, 'fortran_order': {order}, 'shape': ({shape}), }}\n");
    let mut bytes = vec![0x93, b'N', b'U', b'M', b'P', b'Y', version, 0];
    match version {
        1 => bytes.extend((text.len() as u16).to_le_bytes()),
        _ => bytes.extend((text.len() as u32).to_le_bytes()),
    }
    [&bytes, text.as_bytes(), data].concat()
}

#[test]
fn npy_arrays_are_indexed_z_y_x_in_either_memory_order() {
    let dims = [4, 3, 2];
    for (o, sign) in [(Order::Little, '<'), (Order::Big, '>')] {
        let c: Vec<u8> = points(dims).flat_map(|(x, y, z)| o.i16(probe(x, y, z) as i16)).collect();
        // Fortran order: the first index, z, runs fastest.
        let fortran: Vec<u8> = points([2, 3, 4]).flat_map(|(z, y, x)| o.i16(probe(x, y, z) as i16)).collect();
        for version in [1, 2, 3] {
            for bytes in [
                npy(version, &format!("'{sign}i2'"), false, "2, 3, 4", &c),
                npy(version, &format!("'{sign}i2'"), true, "2, 3, 4", &fortran),
                gzip(&npy(version, &format!("'{sign}i2'"), false, "1, 2, 3, 4", &c)),
            ] {
                let v = load(&bytes).unwrap();
                assert_eq!((v.dims(), v.samples().type_name()), (dims, "int16"));
                assert_probe(&v);
            }
        }
        let doubles: Vec<u8> = points(dims).flat_map(|(x, y, z)| o.f64(probe(x, y, z))).collect();
        assert_probe(&load(&npy(1, &format!("'{sign}f8'"), false, "2, 3, 4", &doubles)).unwrap());
    }
    let v = load(&npy(1, "'|u1'", false, "1, 1, 2", &[7, 255])).unwrap();
    assert_eq!(v.samples(), &Samples::U8(vec![7, 255]));
    let v = load(&npy(1, "'|i1'", false, "1, 1, 2", &[7, 255])).unwrap();
    assert_eq!(v.samples(), &Samples::I8(vec![7, -1]));
    let v = load(&npy(1, "'<f2'", false, "1, 1, 1", &[0x00, 0xc0])).unwrap();
    assert_eq!(v.samples(), &Samples::F32(vec![-2.0]));
}

#[test]
fn other_npy_arrays_are_refused_by_name() {
    let data = [0; 64];
    for (descr, shape, word) in [
        ("'|b1'", "2, 2, 2", "bool"),
        ("'<c8'", "2, 2, 2", "complex"),
        ("'<U4'", "1, 1, 1", "U4"),
        ("'|O'", "1, 1, 1", "O"),
        ("[('a', '<f4')]", "1, 1, 1", "structured"),
        ("'<f4'", "2, 2", "[2, 2]"),
        ("'<f4'", "2, 2, 2, 2", "[2, 2, 2, 2]"),
        ("'<f4'", "0, 2, 2", "0×2×2"),
        ("'<f4'", "99999999999, 99999999999, 2", "limit"),
        ("'<f4'", "99999999999999999999999, 1, 1", "cannot be read"),
        ("(((((", "1", "cannot be read"),
    ] {
        let error = refusal(&npy(1, descr, false, shape, &data));
        assert!(error.contains(word), "{descr} {shape}: {error}");
    }
    assert!(refusal(&npy(1, &"[".repeat(20_000), false, "1", &data)).contains("nested"));
    let mut long = npy(2, "'<f4'", false, "1, 1, 1", &data);
    long[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(refusal(&long).contains("4294967295 bytes"));
    assert!(refusal(&npy(9, "'<f4'", false, "1, 1, 1", &data)).contains("version 9"));
}

/// A stack of three pages of 4×2, perhaps with ImageJ's description.
fn tiff<C: colortype::ColorType>(description: Option<&str>, encode: impl Fn(f64) -> C::Inner) -> Vec<u8>
where
    [C::Inner]: ::tiff::encoder::TiffValue,
{
    let mut file = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut file).unwrap();
    for z in 0..3 {
        let page: Vec<C::Inner> = points([4, 2, 1]).map(|(x, y, _)| encode(probe(x, y, z))).collect();
        let mut image = encoder.new_image::<C>(4, 2).unwrap();
        if let Some(text) = description {
            image.encoder().write_tag(Tag::ImageDescription, text).unwrap();
            image.encoder().write_tag(Tag::XResolution, Rational { n: 2, d: 1 }).unwrap();
            image.encoder().write_tag(Tag::YResolution, Rational { n: 4, d: 1 }).unwrap();
        }
        image.write_data(&page).unwrap();
    }
    file.into_inner()
}

#[test]
fn tiff_stacks_keep_their_type_and_take_the_spacing_of_imagej() {
    let description = "ImageJ=1.53t\nimages=3\nslices=3\nunit=micron\nspacing=1.5\nloop=false\n";
    for bytes in [
        tiff::<colortype::Gray8>(Some(description), |v| v as u8),
        tiff::<colortype::Gray16>(Some(description), |v| v as u16),
        tiff::<colortype::GrayI16>(Some(description), |v| v as i16),
        tiff::<colortype::Gray32Float>(Some(description), |v| v as f32),
        tiff::<colortype::Gray32>(Some(description), |v| v as u32),
        gzip(&tiff::<colortype::Gray64Float>(Some(description), |v| v)),
    ] {
        let v = load(&bytes).unwrap();
        assert_eq!(v.dims(), [4, 2, 3]);
        assert_probe(&v);
        assert_eq!(v.world_from_grid().spacing(), DVec3::new(0.5, 0.25, 1.5));
        assert_eq!(v.unit, LengthUnit::Metres(1e-6));
        assert!(v.notes.is_empty());
    }
    // From a file, which is not first taken into memory.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("stack.of.pages.tif");
    std::fs::write(&path, tiff::<colortype::GrayI8>(None, |v| v as i8 as f64 as i8)).unwrap();
    let v = open(&path).unwrap();
    assert_eq!((v.samples().type_name(), v.name.as_str()), ("int8", "stack.of.pages"));
    assert_eq!((v.world_from_grid().spacing(), v.unit), (DVec3::ONE, LengthUnit::Unknown));
}

/// Pages of one sample each with these values; the first has a description, those marked are of reduced resolution.
fn pages(description: &str, values: &[u8], reduced: &[u8]) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut file).unwrap();
    for (i, value) in values.iter().enumerate() {
        let mut image = encoder.new_image::<colortype::Gray8>(1, 1).unwrap();
        if i == 0 {
            image.encoder().write_tag(Tag::ImageDescription, description).unwrap();
        }
        if reduced.contains(value) {
            image.encoder().write_tag(Tag::NewSubfileType, 1u32).unwrap();
        }
        image.write_data(&[*value]).unwrap();
    }
    file.into_inner()
}

fn chosen(bytes: &[u8], channel: usize, timepoint: usize) -> Result<Volume> {
    let choice = Choice { channel: Some(Channel::Index(channel)), timepoint: Some(timepoint), ..Choice::default() };
    read(bytes, &ReadHint { choice, ..ReadHint::default() })
}

#[test]
fn pages_belong_to_the_plane_that_the_metadata_says() {
    // Channels run fastest, then sections, then frames: value = 100 t + 10 z + c.
    let values: Vec<u8> = (0..12).map(|i| (100 * (i / 6) + 10 * (i / 2 % 3) + i % 2) as u8).collect();
    let imagej = pages("ImageJ=1.53t\nimages=12\nchannels=2\nslices=3\nframes=2\nhyperstack=true\n", &values, &[]);
    let ome = |order: &str| {
        format!(
            "<?xml version=\"1.0\"?><OME><Image><Pixels DimensionOrder=\"{order}\" SizeZ=\"3\" SizeC=\"2\" SizeT=\"2\" \
             PhysicalSizeX=\"0.5\" PhysicalSizeY=\"0.5\" PhysicalSizeZ=\"2\"><Channel Name=\"DAPI\"/><Channel \
             Name=\"GFP\"/></Pixels></Image></OME>"
        )
    };
    for bytes in [imagej, pages(&ome("XYCZT"), &values, &[])] {
        assert!(refusal(&bytes).contains("2 channels"));
        for (c, t) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let volume = chosen(&bytes, c, t).unwrap();
            let expected = (0..3).map(|z| (100 * t + 10 * z + c) as u8).collect();
            assert_eq!((volume.dims(), volume.samples()), ([1, 1, 3], &Samples::U8(expected)));
        }
        assert!(chosen(&bytes, 2, 0).unwrap_err().to_string().contains("0 to 1"));
    }
    let volume = chosen(&pages(&ome("XYZCT"), &values, &[]), 1, 0).unwrap();
    assert_eq!(volume.samples(), &Samples::U8(values[3..6].to_vec()));
    assert_eq!(
        (volume.world_from_grid().spacing(), volume.unit),
        (DVec3::new(0.5, 0.5, 2.0), LengthUnit::Metres(1e-6))
    );
    assert!(refusal(&pages(&ome("XYZCT"), &values, &[])).contains("0 DAPI, 1 GFP"));
    // Fewer pages than the metadata has.
    let error = chosen(&pages(&ome("XYZCT"), &values[..11], &[]), 1, 1).unwrap_err().to_string();
    assert!(error.contains("no page 11") && error.contains("incomplete"), "{error}");
}

#[test]
fn pages_of_reduced_resolution_are_no_sections() {
    let volume = load(&pages("", &[1, 2, 3, 4], &[2, 4])).unwrap();
    assert_eq!((volume.dims(), volume.samples()), ([1, 1, 2], &Samples::U8(vec![1, 3])));
    assert!(volume.notes[0].text.contains("2 pages of reduced resolution"));
}

#[test]
fn other_tiff_files_are_refused_by_name() {
    assert!(
        refusal(&tiff::<colortype::Gray8>(Some("ImageJ=1.5\nchannels=3\nimages=3\n"), |_| 0)).contains("3 channels")
    );
    let v = load(&tiff::<colortype::Gray8>(Some("ImageJ=1.5\nimages=5\n"), |_| 0)).unwrap();
    assert!(v.notes[0].text.contains("5 sections, 3 pages"));
    let mut file = Cursor::new(Vec::new());
    TiffEncoder::new(&mut file).unwrap().write_image::<colortype::RGB8>(1, 1, &[1, 2, 3]).unwrap();
    assert!(refusal(&file.into_inner()).contains("RGB"));
    let mut file = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut file).unwrap();
    encoder.write_image::<colortype::Gray8>(2, 1, &[1, 2]).unwrap();
    encoder.write_image::<colortype::Gray8>(1, 2, &[1, 2]).unwrap();
    assert!(refusal(&file.into_inner()).contains("one size"));
    let mut file = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut file).unwrap();
    encoder.write_image::<colortype::Gray8>(2, 1, &[1, 2]).unwrap();
    encoder.write_image::<colortype::Gray16>(2, 1, &[1, 2]).unwrap();
    assert!(refusal(&file.into_inner()).contains("different types"));
}

#[test]
fn raw_samples_follow_their_sidecar() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("volume.json");
    let write = |json: &str| std::fs::write(&path, json).unwrap();
    let data: Vec<u8> = points([4, 3, 2]).flat_map(|(x, y, z)| Order::Big.u16(probe(x, y, z) as u16 + 3)).collect();
    let data = [&b"head"[..], &data].concat();
    std::fs::write(folder.path().join("a.raw"), &data).unwrap();
    std::fs::write(folder.path().join("a.raw.gz"), gzip(&data)).unwrap();
    for name in ["a.raw", "a.raw.gz"] {
        write(&format!(
            r#"{{"dims": [4, 3, 2], "type": "uint16", "endian": "big", "offset": 4, "spacing": [1, 2, 3],
                "origin": [-1, 0, 1], "slope": 2, "inter": -6, "data": "{name}"}}"#
        ));
        let v = open(&path).unwrap();
        assert_eq!((v.dims(), v.samples().type_name(), v.name.as_str()), ([4, 3, 2], "uint16", "volume"));
        assert_eq!(v.world_from_grid().point(DVec3::ONE), DVec3::new(0.0, 2.0, 4.0));
        for (x, y, z) in points([4, 3, 2]) {
            let value = v.value_from_raw(f64::from(v.samples().raw(v.index(x, y, z))));
            assert_eq!(value, 2.0 * probe(x, y, z));
        }
        assert_eq!(v.notes.len(), 1);
        assert!(v.notes[0].text.starts_with("samples were read from "), "{:?}", v.notes);
    }
    // Samples that look like gzip but have exactly the right length are samples.
    std::fs::write(folder.path().join("b.raw"), [0x1f, 0x8b, 8, 0]).unwrap();
    write(r#"{"dims": [4, 1, 1], "type": "uint8", "data": "b.raw"}"#);
    assert_eq!(open(&path).unwrap().samples(), &Samples::U8(vec![0x1f, 0x8b, 8, 0]));
    // A file that goes on is worth a note, one that ends early an error.
    write(r#"{"dims": [4, 3, 2], "type": "uint8", "data": "a.raw"}"#);
    assert!(open(&path).unwrap().notes[0].text.contains("goes on"));
    for (json, word) in [
        (r#"{"dims": [4, 3, 3], "type": "uint16", "data": "a.raw"}"#, "72 bytes"),
        (r#"{"dims": [4, 3, 2], "type": "uint8", "offset": 999, "data": "a.raw"}"#, "offset"),
        (r#"{"dims": [4, 3, 2], "type": "uint8", "colour": 1, "data": "a.raw"}"#, "colour"),
        (r#"{"dims": [4, 3], "type": "uint8", "data": "a.raw"}"#, "length"),
        (r#"{"dims": [4, 3, 2], "type": "bool", "data": "a.raw"}"#, "bool"),
        (r#"{"dims": [4, 3, 2], "type": "uint8"}"#, "data"),
        (r#"{"dims": [4, 3, 2], "type": "uint8", "slope": 0, "data": "a.raw"}"#, "slope"),
        (r#"{"dims": [4, 3, 2], "type": "uint8", "spacing": [1, 0, 1], "data": "a.raw"}"#, "axes"),
        (r#"{"dims": [4, 3, 2], "type": "uint8", "data": "gone.raw"}"#, "gone.raw"),
        (r#"{"dims": [-4, 3, 2], "type": "uint8", "data": "a.raw"}"#, "-4"),
        (r#"{"dims": [4294967296, 4294967296, 2], "type": "uint8", "data": "a.raw"}"#, "limit"),
        ("{", "EOF"),
    ] {
        write(json);
        let error = open(&path).unwrap_err().to_string();
        assert!(error.contains(word), "{json}: {error}");
    }
    assert!(refusal(br#"{"dims": [4, 3, 2], "type": "uint8", "data": "a.raw"}"#).contains("second file"));
}
