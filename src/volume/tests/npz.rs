use super::phantom::{self, ORIGIN, SPACING, assert_phantom};
use super::*;
use flate2::write::DeflateEncoder;
use glam::DMat3;

fn npy(descr: &str, fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
    let order = if fortran { "True" } else { "False" };
    let text = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': ({shape}), }}\n");
    [&b"\x93NUMPY\x01\0"[..], &(text.len() as u16).to_le_bytes(), text.as_bytes(), data].concat()
}

/// Names that numpy gives to the fields of a zip entry: APPNOTE.TXT 4.3.7 and 4.3.12.
pub(super) fn zip(entries: &[(&str, Vec<u8>)], deflate: bool) -> Vec<u8> {
    let (mut out, mut directory) = (Vec::new(), Vec::new());
    for (name, bytes) in entries {
        let mut crc = flate2::Crc::new();
        crc.update(bytes);
        let packed = if deflate {
            let mut encoder = DeflateEncoder::new(Vec::new(), Compression::fast());
            encoder.write_all(bytes).unwrap();
            encoder.finish().unwrap()
        } else {
            bytes.clone()
        };
        let name = format!("{name}.npy");
        let mut fields = vec![20, 0, 0, 0, if deflate { 8 } else { 0 }, 0, 0, 0, 0x21, 0];
        fields.extend(crc.sum().to_le_bytes());
        fields.extend((packed.len() as u32).to_le_bytes());
        fields.extend((bytes.len() as u32).to_le_bytes());
        fields.extend((name.len() as u16).to_le_bytes());
        fields.extend([0, 0]);
        let offset = (out.len() as u32).to_le_bytes();
        out.extend([b"PK\x03\x04", &fields[..], name.as_bytes(), &packed].concat());
        directory.extend([b"PK\x01\x02\x14\0", &fields[..], &[0; 10], &offset, name.as_bytes()].concat());
    }
    let (start, length, count) = (out.len() as u32, directory.len() as u32, (entries.len() as u16).to_le_bytes());
    let end = [&[0; 4], &count[..], &count, &length.to_le_bytes(), &start.to_le_bytes(), &[0; 2]].concat();
    [&out[..], &directory, b"PK\x05\x06", &end].concat()
}

fn doubles(numbers: &[f64]) -> Vec<u8> {
    numbers.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn phantom_array() -> Vec<u8> {
    npy("<u2", false, "9, 7, 5", &phantom::samples(|v| v.to_le_bytes().to_vec()))
}

#[test]
fn the_phantom_comes_back_with_our_own_entries_or_without() {
    let [x, y, z] = phantom::DIMS;
    let fortran: Vec<u8> = points([z, y, x]).flat_map(|(z, y, x)| phantom::value(x, y, z).to_be_bytes()).collect();
    for axes in phantom::directions() {
        let steps = axes * DMat3::from_diagonal(DVec3::from_array(SPACING));
        let rows: Vec<f64> =
            (0..3).flat_map(|r| [steps.x_axis[r], steps.y_axis[r], steps.z_axis[r], ORIGIN[r]]).collect();
        let mut four = rows.clone();
        four.extend([0.0, 0.0, 0.0, 1.0]);
        let unit = npy("<U2", false, "", b"m\0\0\0m\0\0\0");
        for (array, map) in [
            (phantom_array(), npy("<f8", false, "3, 4", &doubles(&rows))),
            (npy(">u2", true, "9, 7, 5", &fortran), npy("<f8", false, "4, 4", &doubles(&four))),
        ] {
            for deflate in [false, true] {
                let entries = [
                    ("h", array.clone()),
                    ("t", npy("<f8", false, "", &doubles(&[1.5]))),
                    ("affine", map.clone()),
                    ("unit", unit.clone()),
                ];
                let bytes = zip(&entries, deflate);
                let volume = load(&bytes).unwrap();
                assert_phantom(&volume, axes, ORIGIN);
                assert_eq!(volume.unit, LengthUnit::Metres(1e-3));
                let folder = tempfile::tempdir().unwrap();
                std::fs::write(folder.path().join("a.npz"), &bytes).unwrap();
                assert_phantom(&open(folder.path().join("a.npz")).unwrap(), axes, ORIGIN);
                assert_phantom(&load(&gzip(&bytes)).unwrap(), axes, ORIGIN);
            }
        }
    }
    let spaced = zip(&[("h", phantom_array()), ("spacing", npy("<f8", false, "3,", &doubles(&SPACING)))], true);
    assert_phantom(&load(&spaced).unwrap(), DMat3::IDENTITY, DVec3::ZERO);
    assert_eq!(*load(&zip(&[("h", phantom_array())], false)).unwrap().world_from_grid(), Affine::IDENTITY);
}

#[test]
fn of_several_arrays_one_is_chosen() {
    let small = npy("|u1", false, "1, 1, 2", &[7, 8]);
    let bytes = zip(&[("h", phantom_array()), ("g", small), ("flat", npy("|u1", false, "2,", &[1, 2]))], false);
    let of = |name: Option<&str>| {
        let choice = Choice { array: name.map(String::from), ..Choice::default() };
        read(&bytes[..], &ReadHint { choice, ..ReadHint::default() }).map_err(|e| e.to_string())
    };
    assert!(of(None).unwrap_err().contains("2 arrays: h, g"));
    assert_eq!(of(Some("g")).unwrap().samples(), &Samples::U8(vec![7, 8]));
    assert!(of(Some("flat")).unwrap_err().contains("[2]"));
    assert!(of(Some("f")).unwrap_err().contains("one of h, g"));
    let none = refusal(&zip(&[("flat", npy("|u1", false, "2,", &[1, 2]))], false));
    assert!(none.contains("among flat"), "{none}");
    let channel = Choice { channel: Some(Channel::Index(1)), ..Choice::default() };
    assert!(read(&bytes[..], &ReadHint { choice: channel, ..ReadHint::default() }).is_err());
}

#[test]
fn damage_is_named() {
    let good = zip(&[("h", phantom_array())], false);
    for (from, to, word) in [
        (&b"PK\x05\x06"[..], &b"PK\x05\x07"[..], "directory"),
        (b"'<u2'", b"'<c8'", "complex"),
        (b"9, 7, 5", b"9, 7, 6", "samples"),
        (b"9, 7, 5", b"9, 7,-5", "header"),
    ] {
        let at = good.windows(from.len()).position(|w| w == from).unwrap();
        let mut bytes = good.clone();
        bytes[at..at + to.len()].copy_from_slice(to);
        assert!(refusal(&bytes).contains(word), "{}", refusal(&bytes));
    }
    let mut flipped = good.clone();
    let at = good.len() / 2;
    flipped[at] ^= 1;
    assert!(refusal(&flipped).contains("checksum"), "{}", refusal(&flipped));
    // An entry that claims more than deflate can hold; the size in the directory counts.
    let mut bomb = zip(&[("h", phantom_array())], true);
    let at = bomb.windows(4).rposition(|w| w == b"PK\x01\x02").unwrap() + 24;
    bomb[at..at + 4].copy_from_slice(&0xf000_0000u32.to_le_bytes());
    assert!(refusal(&bomb).contains("claims to hold"), "{}", refusal(&bomb));
    let place = |name: &str, numbers: &[f64], shape: &str| {
        refusal(&zip(&[("h", phantom_array()), (name, npy("<f8", false, shape, &doubles(numbers)))], false))
    };
    assert!(place("spacing", &[1.0, f64::NAN, 1.0], "3,").contains("finite"));
    assert!(place("spacing", &[1.0], "").contains("1 numbers"));
    assert!(place("affine", &[0.0; 12], "3, 4").contains("independent"));
    assert!(place("affine", &[1.0; 11], "11,").contains("fewer than 12"));
    assert!(place("affine", &[1.0; 16], "4, 4").contains("last row"));
    assert!(place("unit", &[1.0], "").contains("no text"));
    let unit = npy("<U1", false, "", b"x\0\0\0");
    assert!(refusal(&zip(&[("h", phantom_array()), ("unit", unit)], false)).contains("\"x\""));
}
