use super::*;
use glam::DMat3;

/// An MRC header; word numbers as in the standard, from 1.
pub(super) struct Map {
    order: Order,
    bytes: Vec<u8>,
}

impl Map {
    pub(super) fn new(order: Order, dims: [i32; 3], mode: i32) -> Self {
        let mut map = Self { order, bytes: vec![0; 1024] };
        map.words(1, &[dims[0], dims[1], dims[2], mode]);
        map.words(8, &dims);
        map.reals(11, &[dims[0] as f32, dims[1] as f32, dims[2] as f32, 90.0, 90.0, 90.0]);
        map.words(17, &[1, 2, 3]);
        map.bytes[208..212].copy_from_slice(b"MAP ");
        map.bytes[212] = if order == Order::Big { 0x11 } else { 0x44 };
        map
    }

    pub(super) fn words(&mut self, number: usize, values: &[i32]) {
        for (i, v) in values.iter().enumerate() {
            let at = 4 * (number - 1 + i);
            self.bytes[at..at + 4].copy_from_slice(&self.order.i32(*v));
        }
    }

    fn reals(&mut self, number: usize, values: &[f32]) {
        let bits: Vec<i32> = values.iter().map(|v| v.to_bits() as i32).collect();
        self.words(number, &bits);
    }

    pub(super) fn with(&self, samples: Vec<u8>) -> Vec<u8> {
        [&self.bytes[..], &samples].concat()
    }
}

#[test]
fn modes_in_both_byte_orders() {
    let dims = [4, 3, 2];
    for o in ORDERS {
        let all = |encode: &dyn Fn(f64) -> Vec<u8>| -> Vec<u8> {
            points(dims).flat_map(|(x, y, z)| encode(probe(x, y, z))).collect()
        };
        let half = |v: f64| o.u16(half::f16::from_f64(v).to_bits());
        for (mode, data, name) in [
            (0, all(&|v| vec![v as u8]), "int8"),
            (1, all(&|v| o.i16(v as i16)), "int16"),
            (2, all(&|v| o.f32(v as f32)), "float32"),
            (6, all(&|v| o.u16(v as u16)), "uint16"),
            (12, all(&half), "float32"),
        ] {
            let mut map = Map::new(o, [4, 3, 2], mode);
            let v = load(&map.with(data.clone())).unwrap();
            assert_eq!((v.dims(), v.samples().type_name()), (dims, name));
            assert_probe_up_to(&v, if mode == 0 { 127.0 } else { f64::MAX });
            assert_eq!(v.unit, LengthUnit::Metres(1e-10));
            // An empty machine stamp: the byte order still follows from the numbers.
            map.bytes[212] = 0;
            let v = load(&map.with(data)).unwrap();
            assert_probe_up_to(&v, if mode == 0 { 127.0 } else { f64::MAX });
        }
    }
}

/// [`assert_probe`] for the values that the type can hold.
fn assert_probe_up_to(volume: &Volume, most: f64) {
    for (x, y, z) in points(volume.dims()).filter(|&(x, y, z)| probe(x, y, z) <= most) {
        assert_eq!(f64::from(volume.samples().raw(volume.index(x, y, z))), probe(x, y, z));
    }
}

#[test]
fn mode_0_is_signed_unless_imod_says_otherwise() {
    let mut map = Map::new(Order::Little, [2, 1, 1], 0);
    let v = load(&map.with(vec![255, 1])).unwrap();
    assert_eq!(v.samples(), &Samples::I8(vec![-1, 1]));
    assert!(v.notes[0].text.contains("signed"), "{:?}", v.notes);
    map.words(39, &[1_146_047_817, 0]);
    assert_eq!(load(&map.with(vec![255, 1])).unwrap().samples(), &Samples::U8(vec![255, 1]));
    map.words(40, &[1]);
    assert_eq!(load(&map.with(vec![255, 1])).unwrap().samples(), &Samples::I8(vec![-1, 1]));
}

#[test]
fn axes_are_put_in_order_for_all_six_permutations() {
    // The map's own dims are x 4, y 3, z 2; the file stores them in the order MAPC, MAPR, MAPS.
    let (dims, intervals, start) = ([4, 3, 2], [8, 6, 10], [5, -7, 11]);
    for order in [[1, 2, 3], [1, 3, 2], [2, 1, 3], [2, 3, 1], [3, 1, 2], [3, 2, 1]] {
        let axis = order.map(|a: i32| a as usize - 1);
        let file_dims = axis.map(|a| dims[a]);
        let mut map = Map::new(Order::Big, file_dims.map(|d| d as i32), 1);
        map.words(5, &axis.map(|a| start[a]));
        map.words(8, &intervals);
        map.reals(11, &[4.0, 6.0, 30.0]);
        map.words(17, &order);
        let mut data = Vec::new();
        for (c, r, s) in points(file_dims) {
            let mut at = [0; 3];
            (0..3).for_each(|f| at[axis[f]] = [c, r, s][f]);
            data.extend(Order::Big.i16(probe(at[0], at[1], at[2]) as i16));
        }
        let v = load(&map.with(data)).unwrap();
        assert_eq!(v.dims(), dims, "{order:?}");
        assert_probe(&v);
        // Spacing 4/8, 6/6, 30/10; the first sample at start·spacing.
        assert_close(v.world_from_grid().spacing(), DVec3::new(0.5, 1.0, 3.0), 1e-12);
        assert_close(v.world_from_grid().offset(), DVec3::new(2.5, -7.0, 33.0), 1e-12);
    }
}

#[test]
fn oblique_cells_keep_their_lengths_and_angles() {
    let mut map = Map::new(Order::Little, [2, 2, 2], 2);
    map.words(8, &[10, 10, 10]);
    map.reals(11, &[50.0, 60.0, 70.0, 80.0, 95.0, 110.0]);
    map.words(5, &[0, 0, 0]);
    let data: Vec<u8> = (0..8).flat_map(|i| Order::Little.f32(i as f32)).collect();
    let v = load(&map.with(data.clone())).unwrap();
    let m: DMat3 = v.world_from_grid().linear();
    let (a, b, c) = (m.x_axis, m.y_axis, m.z_axis);
    assert_close(DVec3::new(a.length(), b.length(), c.length()), DVec3::new(5.0, 6.0, 7.0), 1e-12);
    let angle = |p: DVec3, q: DVec3| p.angle_between(q).to_degrees();
    assert_close(DVec3::new(angle(b, c), angle(a, c), angle(a, b)), DVec3::new(80.0, 95.0, 110.0), 1e-9);
    assert!(a.y == 0.0 && a.z == 0.0 && b.z == 0.0 && !v.world_from_grid().is_left_handed());
    // Hexagonal: b is at exactly 120°, c stays along z.
    map.reals(14, &[90.0, 90.0, 120.0]);
    let m = load(&map.with(data.clone())).unwrap().world_from_grid().linear();
    assert_eq!((m.z_axis.x, m.z_axis.y), (0.0, 0.0));
    assert_close(m.y_axis, DVec3::new(-3.0, 27f64.sqrt(), 0.0), 1e-12);
    // Three angles that no three vectors make.
    map.reals(14, &[10.0, 10.0, 100.0]);
    assert!(refusal(&map.with(data.clone())).contains("angles"));
    map.reals(14, &[0.0, 0.0, 0.0]);
    let v = load(&map.with(data)).unwrap();
    assert!(v.notes[0].text.contains("angles") && v.world_from_grid().spacing().x == 5.0);
}

#[test]
fn origin_words_go_before_start_indices() {
    let data: Vec<u8> = vec![0; 4];
    let mut map = Map::new(Order::Little, [1, 1, 1], 2);
    map.words(5, &[3, 4, 5]);
    assert_eq!(load(&map.with(data.clone())).unwrap().world_from_grid().offset(), DVec3::new(3.0, 4.0, 5.0));
    map.reals(50, &[-1.0, 0.0, 2.0]);
    let v = load(&map.with(data.clone())).unwrap();
    assert_eq!(v.world_from_grid().offset(), DVec3::new(-1.0, 0.0, 2.0));
    assert!(v.notes[0].text.contains("disagree"));
    map.reals(50, &[3.0, 4.0, 5.0]);
    assert!(load(&map.with(data.clone())).unwrap().notes.is_empty());
    // No cell at all: unit spacing, unit unknown. An extended header is skipped.
    map.reals(11, &[0.0, 0.0, 0.0]);
    map.words(24, &[8]);
    let v = load(&map.with([vec![9; 8], 2.5f32.to_le_bytes().to_vec()].concat())).unwrap();
    assert_eq!((v.unit, v.samples()), (LengthUnit::Unknown, &Samples::F32(vec![2.5])));
}

#[test]
fn stacks_give_their_first_volume_and_odd_headers_are_named() {
    let mut stack = Map::new(Order::Little, [2, 1, 4], 1);
    stack.words(23, &[401]);
    stack.words(10, &[2]);
    let data: Vec<u8> = (0..8).flat_map(|i| Order::Little.i16(i)).collect();
    let v = load(&stack.with(data)).unwrap();
    assert_eq!((v.dims(), v.samples()), ([2, 1, 2], &Samples::I16(vec![0, 1, 2, 3])));
    assert!(v.notes[0].text.contains("2 volumes"));
    for (mode, name) in [(3, "complex"), (4, "complex"), (16, "RGB"), (101, "4-bit"), (50, "unknown")] {
        assert!(refusal(&Map::new(Order::Big, [1, 1, 1], mode).with(vec![0; 16])).contains(name), "{mode}");
    }
    let mut map = Map::new(Order::Little, [-1, 1, 1], 2);
    assert!(refusal(&map.with(vec![0; 4])).contains("no sense"));
    map = Map::new(Order::Little, [1, 1, 1], 2);
    map.words(24, &[-1]);
    assert!(refusal(&map.with(vec![0; 4])).contains("extended header"));
    map.words(24, &[0]);
    map.words(17, &[1, 1, 3]);
    assert!(load(&map.with(vec![0; 4])).unwrap().notes[0].text.contains("axis order"));
    // An old map without the word MAP is known by its axis order.
    let mut old = Map::new(Order::Big, [2, 1, 1], 1);
    old.bytes[208..216].fill(0);
    assert_eq!(load(&old.with(vec![0, 1, 0, 2])).unwrap().samples(), &Samples::I16(vec![1, 2]));
}
