use super::*;
use glam::DMat3;

/// A header of which the tests set a few fields; offsets from nifti1.h.
pub(super) struct Header {
    pub(super) order: Order,
    pub(super) bytes: Vec<u8>,
}

impl Header {
    pub(super) fn new(order: Order, dims: &[i16], code: i16) -> Self {
        let mut header = Self { order, bytes: vec![0; 352] };
        header.set(0, order.i32(348));
        header.set(40, order.i16(dims.len() as i16));
        for (i, d) in dims.iter().enumerate() {
            header.set(42 + 2 * i, order.i16(*d));
        }
        header.set(70, order.i16(code));
        for i in 0..8 {
            header.set(76 + 4 * i, order.f32(1.0));
        }
        header.set(108, order.f32(352.0));
        header.set(344, b"n+1\0".to_vec());
        header
    }

    pub(super) fn set(&mut self, at: usize, bytes: Vec<u8>) {
        self.bytes[at..at + bytes.len()].copy_from_slice(&bytes);
    }

    fn floats(&mut self, at: usize, values: &[f32]) {
        for (i, v) in values.iter().enumerate() {
            self.set(at + 4 * i, self.order.f32(*v));
        }
    }

    pub(super) fn with(&self, samples: impl IntoIterator<Item = u8>) -> Vec<u8> {
        self.bytes.iter().copied().chain(samples).collect()
    }
}

fn samples(dims: [usize; 3], encode: impl Fn(f64) -> Vec<u8>) -> Vec<u8> {
    points(dims).flat_map(|(x, y, z)| encode(probe(x, y, z))).collect()
}

#[test]
fn every_type_in_both_byte_orders() {
    let dims = [4, 3, 2];
    for o in ORDERS {
        let cases: [(i16, Vec<u8>, &str); 10] = [
            (2, samples(dims, |v| vec![v as u8]), "uint8"),
            (256, samples(dims, |v| vec![(v as i8) as u8]), "int8"),
            (4, samples(dims, |v| o.i16(v as i16)), "int16"),
            (512, samples(dims, |v| o.u16(v as u16)), "uint16"),
            (8, samples(dims, |v| o.i32(v as i32)), "uint16"),
            (768, samples(dims, |v| o.u32(v as u32)), "uint16"),
            (1024, samples(dims, |v| o.i64(v as i64)), "uint16"),
            (1280, samples(dims, |v| o.u64(v as u64)), "uint16"),
            (16, samples(dims, |v| o.f32(v as f32)), "float32"),
            (64, samples(dims, |v| o.f64(v)), "float32"),
        ];
        for (code, data, name) in cases {
            let bytes = Header::new(o, &[4, 3, 2], code).with(data);
            for file in [bytes.clone(), gzip(&bytes)] {
                let v = load(&file).unwrap();
                assert_eq!((v.dims(), v.samples().type_name()), (dims, name), "datatype {code}");
                assert_probe(&v);
                assert!(v.notes.is_empty());
            }
        }
    }
}

#[test]
fn scaling_is_kept_apart_and_odd_scalings_mean_none() {
    for (slope, inter, expected) in [
        (0.5, -3.0, (0.5, -3.0)),
        (-2.0, 1.0, (-2.0, 1.0)),
        (0.0, 7.0, (1.0, 0.0)),
        (f32::NAN, f32::NAN, (1.0, 0.0)),
        (2.0, f32::NAN, (2.0, 0.0)),
    ] {
        let mut header = Header::new(Order::Little, &[2, 1, 1], 4);
        header.floats(112, &[slope, inter]);
        let v = load(&header.with([1, 0, 2, 0])).unwrap();
        assert_eq!((v.slope(), v.inter()), expected);
        assert_eq!(v.samples(), &Samples::I16(vec![1, 2]));
    }
}

#[test]
fn sform_goes_before_qform_and_qform_before_pixdim() {
    for o in ORDERS {
        let mut header = Header::new(o, &[2, 2, 2], 2);
        header.floats(76, &[-1.0, 2.0, 3.0, 4.0]); // pixdim with qfac −1
        let data = [0u8; 8];
        let plain = load(&header.with(data)).unwrap();
        assert_eq!(plain.world_from_grid().linear(), DMat3::from_diagonal(DVec3::new(2.0, 3.0, 4.0)));
        assert_eq!(plain.unit, LengthUnit::Unknown);

        // A quarter turn about z: a = b' = sqrt(1/2). x → y, y → −x; z mirrored by qfac.
        header.set(252, o.i16(1));
        header.floats(256, &[0.0, 0.0, std::f32::consts::FRAC_1_SQRT_2, 10.0, 20.0, 30.0]);
        header.set(123, vec![2]);
        let turned = load(&header.with(data)).unwrap();
        let p = turned.world_from_grid().point(DVec3::ONE);
        assert_close(p, DVec3::new(10.0 - 3.0, 20.0 + 2.0, 30.0 - 4.0), 2e-6);
        assert_eq!(turned.unit, LengthUnit::Metres(1e-3));

        header.set(254, o.i16(2));
        header.floats(280, &[-1.0, 0.0, 0.5, 90.0, 0.0, 2.0, 0.0, -126.0, 0.0, 0.0, 3.0, -72.0]);
        header.set(123, vec![3 | 8]); // micrometres and seconds
        let stated = load(&header.with(data)).unwrap();
        assert_eq!(stated.world_from_grid().point(DVec3::new(1.0, 2.0, 3.0)), DVec3::new(90.5, -122.0, -63.0));
        assert!(stated.world_from_grid().is_left_handed());
        assert_eq!(stated.unit, LengthUnit::Metres(1e-6));

        // A singular sform is ignored and said so.
        header.floats(280, &[0.0; 12]);
        let ignored = load(&header.with(data)).unwrap();
        assert_close(ignored.world_from_grid().point(DVec3::ONE), p, 0.0);
        assert!(ignored.notes[0].text.contains("sform"), "{:?}", ignored.notes);
    }
}

#[test]
fn a_generic_quaternion_gives_the_rotation_of_nibabel() {
    // nibabel 5: quat2mat of b, c, d = 0.1, −0.2, 0.3 (a = sqrt(0.86)), pixdim 1, 2, 3.
    let mut header = Header::new(Order::Little, &[1, 1, 1], 2);
    header.floats(76, &[1.0, 1.0, 2.0, 3.0]);
    header.set(252, Order::Little.i16(1));
    header.floats(256, &[0.1, -0.2, 0.3, 0.0, 0.0, 0.0]);
    let v = load(&header.with([0])).unwrap();
    let a = 0.86f64.sqrt();
    // Columns by Rodrigues' rule, v + 2a(q × v) + 2q × (q × v), an independent form.
    let q = DVec3::new(0.1, -0.2, 0.3);
    for (axis, spacing) in [(DVec3::X, 1.0), (DVec3::Y, 2.0), (DVec3::Z, 3.0)] {
        let turned = axis + 2.0 * a * q.cross(axis) + 2.0 * q.cross(q.cross(axis));
        assert_close(v.world_from_grid().vector(axis), spacing * turned, 1e-6);
    }
}

#[test]
fn further_dimensions_of_one_are_fine_and_a_series_gives_its_first_volume() {
    let v = load(&Header::new(Order::Big, &[2, 2, 1, 1, 1], 2).with([1, 2, 3, 4])).unwrap();
    assert_eq!((v.dims(), v.notes.len()), ([2, 2, 1], 0));
    let v = load(&Header::new(Order::Big, &[2, 1, 1, 3], 2).with([1, 2, 3, 4, 5, 6])).unwrap();
    assert_eq!(v.samples(), &Samples::U8(vec![1, 2]));
    assert!(v.notes[0].text.contains("time point 0 of 3"), "{:?}", v.notes);
    // Extensions between header and samples are skipped.
    let mut header = Header::new(Order::Little, &[2, 1, 1], 2);
    header.floats(108, &[368.0]);
    let v = load(&header.with([9; 16].into_iter().chain([5, 6]))).unwrap();
    assert_eq!(v.samples(), &Samples::U8(vec![5, 6]));
}

#[test]
fn time_points_and_components_are_chosen() {
    // 2 × 1 × 1 samples, three times, two components: time runs faster.
    let header = Header::new(Order::Little, &[2, 1, 1, 3, 2], 2);
    let bytes = header.with(0..12);
    assert!(refusal(&bytes).contains("2 channels: 0, 1"));
    for (channel, timepoint) in [(0, 0), (0, 2), (1, 0), (1, 2)] {
        let choice = Choice { channel: Some(Channel::Index(channel)), timepoint: Some(timepoint), ..Choice::default() };
        let volume = read(&bytes[..], &ReadHint { choice, ..ReadHint::default() }).unwrap();
        let first = (2 * (timepoint + 3 * channel)) as u8;
        assert_eq!(volume.samples(), &Samples::U8(vec![first, first + 1]));
    }
    let deep = Header::new(Order::Little, &[2, 1, 1, 1, 1, 2], 2);
    assert!(refusal(&deep.with(0..4)).contains("seven dimensions"));
}

#[test]
fn relatives_and_nonsense_are_refused_by_name() {
    let little = Order::Little;
    let mut two = vec![0; 540];
    two[..4].copy_from_slice(&540i32.to_le_bytes());
    two[4..12].copy_from_slice(b"n+2\0\n\x1a\n\n");
    assert!(refusal(&two).contains("copied as text"));
    let mut analyze = Header::new(little, &[2, 1, 1], 2);
    analyze.set(344, vec![0; 4]);
    assert!(refusal(&analyze.with([1, 2])).contains("ANALYZE"));
    for (code, name) in [(128, "RGB"), (32, "complex"), (1, "binary"), (1536, "128-bit"), (77, "unknown")] {
        assert!(refusal(&Header::new(little, &[1, 1, 1], code).with([0; 64])).contains(name));
    }
    for dims in [&[0, 1, 1][..], &[-5, 1, 1], &[1; 0]] {
        assert!(!refusal(&Header::new(little, dims, 2).with([0; 64])).is_empty(), "{dims:?}");
    }
    for offset in [0.0, -1.0, f32::NAN, f32::INFINITY, 1e30] {
        let mut header = Header::new(little, &[1, 1, 1], 2);
        header.floats(108, &[offset]);
        assert!(refusal(&header.with([0; 8])).contains("vox_offset"), "{offset}");
    }
    let mut pair = Header::new(little, &[1, 1, 1], 2);
    pair.set(344, b"ni1\0".to_vec());
    assert!(refusal(&pair.bytes).contains("second file"));
}

#[test]
fn pairs_are_opened_by_the_path_of_the_header() {
    let folder = tempfile::tempdir().unwrap();
    let mut header = Header::new(Order::Little, &[2, 1, 1], 2);
    header.set(344, b"ni1\0".to_vec());
    header.floats(108, &[0.0]);
    let path = folder.path().join("head.hdr");
    std::fs::write(&path, &header.bytes).unwrap();
    let error = open(&path).unwrap_err().to_string();
    assert!(error.contains("head.img"), "{error}");
    std::fs::write(folder.path().join("head.img.gz"), gzip(&[7, 8])).unwrap();
    let v = open(&path).unwrap();
    assert_eq!((v.samples(), v.name.as_str()), (&Samples::U8(vec![7, 8]), "head"));
}

/// Codes of the transforms: 0 of both says nothing of a patient.
#[test]
fn a_transform_code_makes_the_frame_anatomical() {
    let ball = |qform: i16, sform: i16| {
        let mut header = Header::new(Order::Little, &[2, 2, 2], 2);
        header.set(252, Order::Little.i16(qform));
        header.set(254, Order::Little.i16(sform));
        for (row, at) in [280, 296, 312].into_iter().enumerate() {
            let mut values = [0.0; 4];
            values[row] = 2.0;
            header.floats(at, &values);
        }
        load(&header.with(0..8)).unwrap().up
    };
    use crate::geom::Up;
    assert_eq!(ball(0, 0), Up::Z);
    for code in 1..=5 {
        assert_eq!([ball(code, 0), ball(0, code)], [Up::Anatomical; 2], "{code}");
    }
}

/// A header of NIfTI-2; offsets from nifti2.h.
pub(super) fn second(o: Order, dims: &[i64], code: i16) -> Header {
    let mut header = Header { order: o, bytes: vec![0; 544] };
    header.set(0, o.i32(540));
    header.set(4, b"n+2\0\r\n\x1a\n".to_vec());
    header.set(12, o.i16(code));
    header.set(16, o.i64(dims.len() as i64));
    for (i, d) in dims.iter().enumerate() {
        header.set(24 + 8 * i, o.i64(*d));
    }
    header.doubles(104, &[1.0; 8]);
    header.set(168, o.i64(544));
    header
}

impl Header {
    fn doubles(&mut self, at: usize, values: &[f64]) {
        for (i, v) in values.iter().enumerate() {
            self.set(at + 8 * i, self.order.f64(*v));
        }
    }
}

#[test]
fn the_phantom_comes_back_from_both_versions() {
    use super::phantom::{self, ORIGIN, SPACING, assert_phantom};
    for axes in phantom::directions() {
        let rows = (axes * DMat3::from_diagonal(DVec3::from_array(SPACING))).transpose();
        let rows: Vec<f64> = (0..3).flat_map(|r| [rows.col(r).x, rows.col(r).y, rows.col(r).z, ORIGIN[r]]).collect();
        for o in ORDERS {
            let data = phantom::samples(|v| o.u16(v));
            let mut one = Header::new(o, &[5, 7, 9], 512);
            one.set(254, o.i16(1));
            one.floats(280, &rows.iter().map(|v| *v as f32).collect::<Vec<_>>());
            let mut two = second(o, &[5, 7, 9], 512);
            two.set(348, o.i32(1));
            two.doubles(400, &rows);
            two.set(500, o.i32(2));
            for bytes in [one.with(data.clone()), two.with(data.clone()), gzip(&two.with(data))] {
                assert_phantom(&load(&bytes).unwrap(), axes, ORIGIN);
            }
        }
    }
}

#[test]
fn the_second_version_has_the_same_rules() {
    for o in ORDERS {
        // The quarter turn of the first version, exactly half of which is stored.
        let mut header = second(o, &[2, 2, 2], 2);
        header.doubles(104, &[-1.0, 2.0, 3.0, 4.0]);
        header.set(344, o.i32(1));
        header.doubles(352, &[0.0, 0.0, std::f64::consts::FRAC_1_SQRT_2, 10.0, 20.0, 30.0]);
        header.doubles(176, &[0.5, -3.0]);
        header.set(500, o.i32(3 | 8));
        let volume = load(&header.with([0; 8])).unwrap();
        assert_close(volume.world_from_grid().point(DVec3::ONE), DVec3::new(7.0, 22.0, 26.0), 1e-14);
        assert_eq!((volume.slope(), volume.inter(), volume.unit), (0.5, -3.0, LengthUnit::Metres(1e-6)));
        assert_eq!(volume.up, Up::Anatomical);
        let series = second(o, &[2, 1, 1, 3], 2).with(0..6);
        let choice = Choice { timepoint: Some(2), ..Choice::default() };
        let last = read(&series[..], &ReadHint { choice, ..ReadHint::default() }).unwrap();
        assert_eq!(last.samples(), &Samples::U8(vec![4, 5]));
    }
    let little = |dims: &[i64]| refusal(&second(Order::Little, dims, 2).with([0; 64]));
    assert!(little(&[-5, 1, 1]).contains("size -5"));
    assert!(little(&[10_000, 10_000, 10_000]).contains("1000000000000 bytes"));
    assert!(little(&[i64::MAX, i64::MAX, 2]).contains("2^64"));
    assert!(little(&[1, 1, 1, i64::MAX, 2]).contains("channels"));
    assert!(little(&[1, 1, 1, 1, i64::MAX]).contains("seven dimensions"));
    let mut cut = second(Order::Little, &[2, 2, 2], 2);
    cut.set(168, Order::Little.i64(300));
    assert!(refusal(&cut.with([0; 8])).contains("vox_offset 300"));
    assert!(refusal(&cut.bytes[..539]).contains("header"));
    let folder = tempfile::tempdir().unwrap();
    let mut pair = second(Order::Big, &[2, 1, 1], 2);
    pair.set(4, b"ni2\0".to_vec());
    pair.set(168, vec![0; 8]);
    std::fs::write(folder.path().join("head.hdr"), &pair.bytes[..540]).unwrap();
    std::fs::write(folder.path().join("head.img"), [7, 8]).unwrap();
    assert_eq!(open(folder.path().join("head.hdr")).unwrap().samples(), &Samples::U8(vec![7, 8]));
}
