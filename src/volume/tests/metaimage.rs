use super::phantom::{self, ORIGIN, SPACING, assert_phantom, words};
use super::*;
use glam::DMat3;

const RAS_FROM_LPS: DMat3 = DMat3::from_cols(DVec3::NEG_X, DVec3::NEG_Y, DVec3::Z);

fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A header whose axes, as rows, are the columns of `axes`.
fn header(axes: DMat3, more: &str) -> String {
    format!(
        "ObjectType = Image\nNDims = 3\nDimSize = 5 7 9\nTransformMatrix = {}\nOffset = {}\nElementSpacing = {}\n{more}\n",
        words(&axes.to_cols_array()),
        words(&ORIGIN.to_array()),
        words(&SPACING)
    )
}

fn local(header: &str, data: &[u8]) -> Vec<u8> {
    [header.as_bytes(), b"ElementDataFile = LOCAL\n", data].concat()
}

#[test]
fn the_phantom_comes_back_from_every_encoding_turned_to_ras() {
    for axes in phantom::directions() {
        for o in ORDERS {
            let msb = if o == Order::Big { "True" } else { "False" };
            let more = |packed: &str, kind: &str| {
                format!("BinaryDataByteOrderMSB = {msb}\nCompressedData = {packed}\nElementType = MET_{kind}")
            };
            let shorts = phantom::samples(|v| o.u16(v));
            let doubles = phantom::samples(|v| o.f64(f64::from(v)));
            for bytes in [
                local(&header(axes, &more("False", "USHORT")), &shorts),
                local(&header(axes, &more("True", "USHORT")), &zlib(&shorts)),
                local(&header(axes, &more("True", "USHORT")), &gzip(&shorts)),
                local(&header(axes, &more("True", "DOUBLE")), &zlib(&doubles)),
                gzip(&local(&header(axes, &more("False", "USHORT")), &shorts)),
            ] {
                let volume = load(&bytes).unwrap();
                assert_phantom(&volume, RAS_FROM_LPS * axes, RAS_FROM_LPS * ORIGIN);
                assert_eq!((volume.unit, volume.up), (LengthUnit::Metres(1e-3), Up::Z));
            }
        }
        let text: String = points(phantom::DIMS).map(|(x, y, z)| format!("{} ", phantom::value(x, y, z))).collect();
        let bytes = local(&header(axes, "BinaryData = False\nElementType = MET_SHORT"), text.as_bytes());
        assert_phantom(&load(&bytes).unwrap(), RAS_FROM_LPS * axes, RAS_FROM_LPS * ORIGIN);
        // Other names of the same fields, keys in any case, mixed line ends, a mark of UTF-8, a patient's frame.
        let other = header(axes, "ElementByteOrderMSB = 0\nAnatomicalOrientation = RAI\nElementType = MET_USHORT")
            .replace("TransformMatrix", "orientation")
            .replace("Offset", "POSITION")
            .replace("ElementSpacing", "ElementSize")
            .replace("\nNDims", "\r\nNDims");
        let bytes = [b"\xef\xbb\xbf", &local(&other, &phantom::samples(|v| v.to_le_bytes().to_vec()))[..]].concat();
        let volume = load(&bytes).unwrap();
        assert_phantom(&volume, RAS_FROM_LPS * axes, RAS_FROM_LPS * ORIGIN);
        assert!(volume.up.is_anatomical());
    }
}

#[test]
fn channels_run_fastest_and_time_last() {
    // value = x + 2 z + 100 channel + 50 time.
    let value = |x: u8, z: u8, c: u8, t: u8| x + 2 * z + 100 * c + 50 * t;
    let all = (0..16u8).map(|i| value(i / 2 % 2, i / 4 % 2, i % 2, i / 8));
    let head = "NDims = 4\nDimSize = 2 1 2 2\nElementNumberOfChannels = 2\nElementType = MET_UCHAR\nElementSpacing = 1 2 3 4\n\
                Offset = 5 6 7 8\nTransformMatrix = 0 1 0 0 1 0 0 0 0 0 1 0 0 0 0 1";
    let file = local(&(head.to_string() + "\n"), &all.collect::<Vec<u8>>());
    assert!(refusal(&file).contains("2 channels"));
    for (c, t) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        let choice = Choice { channel: Some(Channel::Index(c)), timepoint: Some(t), ..Choice::default() };
        let volume = read(&file[..], &ReadHint { choice, ..ReadHint::default() }).unwrap();
        let expected = points([2, 1, 2]).map(|(x, _, z)| value(x as u8, z as u8, c as u8, t as u8)).collect();
        assert_eq!(volume.samples(), &Samples::U8(expected), "{c} {t}");
        assert_eq!(volume.world_from_grid().point(DVec3::ONE), DVec3::new(-7.0, -7.0, 10.0));
    }
    let sheared = head.replace("0 0 1 0 0 0 0 1", "0 0 1 0.5 0 0 0 1").replace("Channels = 2", "Channels = 1");
    assert!(refusal(&local(&(sheared + "\n"), &[0; 16])).contains("time"));
}

#[test]
fn detached_data_are_found_beside_the_header() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    let shorts = phantom::samples(|v| v.to_le_bytes().to_vec());
    let axes = phantom::directions()[1];
    let opened = |more: &str, name: &str| {
        let head = header(axes, &format!("BinaryDataByteOrderMSB = False\nElementType = MET_USHORT\n{more}"));
        write("a.mhd", format!("{head}ElementDataFile = {name}\n").as_bytes());
        open(folder.path().join("a.mhd")).map_err(|e| e.to_string())
    };
    let is_phantom = |volume: Volume| assert_phantom(&volume, RAS_FROM_LPS * axes, RAS_FROM_LPS * ORIGIN);
    write("a.raw", &shorts);
    write("a.zraw", &zlib(&shorts));
    write("tail.raw", &[b"something else", &shorts[..]].concat());
    is_phantom(opened("", "a.raw").unwrap());
    is_phantom(opened("CompressedData = True\nCompressedDataSize = 400", "a.zraw").unwrap());
    is_phantom(opened("HeaderSize = 14", "tail.raw").unwrap());
    is_phantom(opened("HeaderSize = -1", "tail.raw").unwrap());
    write("short.raw", &shorts[1..]);
    assert!(opened("", "short.raw").unwrap_err().contains("629 bytes"));
    assert!(opened("HeaderSize = -1", "short.raw").unwrap_err().contains("too short"));
    assert!(opened("HeaderSize = -2", "a.raw").unwrap_err().contains("HeaderSize"));
    write("long.raw", &[&shorts[..], b"x"].concat());
    assert!(opened("", "long.raw").unwrap().notes.iter().any(|n| n.text.contains("goes on")));
    std::fs::write(folder.path().parent().unwrap().join("isolume-outside.raw"), &shorts).unwrap();
    assert!(opened("", "../isolume-outside.raw").unwrap_err().contains("--allow-outside"));
    std::fs::remove_file(folder.path().parent().unwrap().join("isolume-outside.raw")).unwrap();
    assert!(opened("", "gone.raw").unwrap_err().contains("gone.raw"));
    for several in ["LIST", "slice%03d.raw 1 9 1"] {
        assert!(opened("", several).unwrap_err().contains("several files"));
    }
    assert!(
        refusal(b"NDims = 3\nDimSize = 1 1 1\nElementType = MET_CHAR\nElementDataFile = x.raw\n").contains("x.raw")
    );
}

#[test]
fn damage_is_named() {
    let good = header(DMat3::IDENTITY, "BinaryDataByteOrderMSB = False\nElementType = MET_USHORT");
    let shorts = phantom::samples(|v| v.to_le_bytes().to_vec());
    for (from, to, word) in [
        ("MET_USHORT", "MET_FLOAT_ARRAY", "MET_FLOAT_ARRAY"),
        ("MET_USHORT", "MET_STRING", "MET_STRING"),
        ("ElementType", "Element", "ElementType"),
        ("NDims = 3", "NDims = 2", "NDims = 2"),
        ("NDims = 3", "NDims = 4", "DimSize"),
        ("5 7 9", "5 7 -9", "DimSize"),
        ("5 7 9", "5 7 0", "5×7×0"),
        ("5 7 9", "10000 10000 10000", "2000000000000 bytes"),
        ("5 7 9", "18446744073709551615 2 2", "2^64"),
        ("0.5 0.7 1.1", "0.5 nan 1.1", "ElementSpacing"),
        ("0.5 0.7 1.1", "0.5 -0.7 1.1", "ElementSpacing"),
        ("0.5 0.7 1.1", "0.5 0.7", "ElementSpacing"),
        ("1 0 0 0 1 0 0 0 1", "1 0 0 1 0 0 0 0 1", "independent"),
        ("1 0 0 0 1 0 0 0 1", "1 0 0 1", "TransformMatrix"),
        ("10 -20 30", "10 inf 30", "finite"),
        ("MSB = False", "MSB = maybe", "maybe"),
        ("ObjectType = Image", "ObjectType = Mesh", "Mesh"),
        ("NDims", "no equals sign\nNDims", "no equals sign"),
        ("ElementType", "CompressedData = True\nElementType", "damaged"),
        ("ElementType", "ElementNumberOfChannels = 0\nElementType", "ElementNumberOfChannels"),
        ("ElementType", "ElementNumberOfChannels = 99999999\nElementType", "ElementNumberOfChannels"),
    ] {
        assert!(good.contains(from), "{from}");
        let text = refusal(&local(&good.replace(from, to), &shorts));
        assert!(text.contains(word), "{to}: {text}");
    }
    assert!(
        load(&local(&good, &[&shorts[..], b"x"].concat())).unwrap().notes.iter().any(|n| n.text.contains("goes on"))
    );
    assert!(
        refusal(&local(&good, &shorts[1..])).contains("before the end")
            || refusal(&local(&good, &shorts[1..])).contains("629")
    );
    // A bomb: of 64 MiB of zeros only the samples are unpacked.
    let bomb = local(&good.replace("ElementType", "CompressedData = True\nElementType"), &zlib(&vec![0; 1 << 26]));
    assert_eq!(load(&bomb).unwrap().dims(), phantom::DIMS);
}
