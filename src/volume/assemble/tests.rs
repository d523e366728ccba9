use super::*;
use crate::grid3;

fn parts(data: Data, count: usize) -> Parts {
    Parts {
        format: "t",
        dims: [count, 1, 1],
        data,
        slope: 1.0,
        inter: 0.0,
        world_from_grid: Affine::IDENTITY,
        unit: LengthUnit::Unknown,
        series: Series::default(),
        notes: Vec::new(),
    }
}

fn make(data: Data, count: usize) -> Volume {
    assemble(parts(data, count), &ReadHint::default()).unwrap()
}

#[test]
fn wide_integers_take_sixteen_bits_where_they_fit() {
    assert_eq!(make(Data::I32(vec![0, 65535]), 2).samples(), &Samples::U16(vec![0, 65535]));
    assert_eq!(make(Data::I64(vec![-32768, 32767]), 2).samples(), &Samples::I16(vec![-32768, 32767]));
    let v = make(Data::U64(vec![0, 1 << 40]), 2);
    assert_eq!(v.samples(), &Samples::F32(vec![0.0, (1u64 << 40) as f32]));
    assert!(v.notes[0].text.contains("exactly"), "{:?}", v.notes);
    let v = make(Data::I32(vec![-1, 16_777_217]), 2);
    assert!(v.notes[0].text.contains("1 of them rounded"), "{:?}", v.notes);
    let v = make(Data::U64(vec![u64::MAX, 5]), 2);
    assert_eq!(v.samples().raw(0), 18_446_744_073_709_551_615u64 as f32);
}

#[test]
fn non_finite_samples_go_to_the_lit_side() {
    let bad = vec![f32::NAN, 3.0, f32::INFINITY, -1.0, f32::NEG_INFINITY];
    let mut case = parts(Data::F32(bad.clone()), 5);
    let above = assemble(case, &ReadHint::default()).unwrap();
    assert_eq!(above.samples(), &Samples::F32(vec![-1.0, 3.0, -1.0, -1.0, -1.0]));
    assert_eq!(above.notes[0].count, 3);
    let below = ReadHint { solid: Solid::Below, ..ReadHint::default() };
    case = parts(Data::F32(bad.clone()), 5);
    assert_eq!(assemble(case, &below).unwrap().samples(), &Samples::F32(vec![3.0, 3.0, 3.0, -1.0, 3.0]));
    // A negative slope turns the sides round.
    case = Parts { slope: -2.0, ..parts(Data::F32(bad), 5) };
    assert_eq!(assemble(case, &ReadHint::default()).unwrap().samples(), &Samples::F32(vec![3.0, 3.0, 3.0, -1.0, 3.0]));
    let error = assemble(parts(Data::F64(vec![f64::NAN; 2]), 2), &ReadHint::default()).unwrap_err();
    assert!(error.to_string().contains("2 samples, all NaN"), "{error}");
}

#[test]
fn extreme_ranges_are_rescaled_by_an_exact_power_of_two() {
    // f32: subnormal, tiny, huge. Every value survives bit for bit through slope·raw.
    for values in [[1e-45f32, 3e-45, -7e-45], [1e-31, -2e-32, 7e-31], [1e31, -3e38, 2.5e30]] {
        let v = make(Data::F32(values.to_vec()), 3);
        assert_eq!(v.notes.len(), 1, "{values:?}");
        let largest = v.raw_range().0.abs().max(v.raw_range().1.abs());
        assert!((1.0..2.0).contains(&largest), "{largest}");
        for i in 0..3 {
            assert_eq!(v.value_from_raw(f64::from(v.samples().raw(i))), f64::from(values[i]));
        }
    }
    // f64 beyond f32, down to its subnormals: the error is that of f32 rounding.
    for scale in [1e300, 1e-300, 5e-324, f64::MAX / 4.0] {
        let values = [scale, 3.0 * scale, -2.0 * scale];
        let v = make(Data::F64(values.to_vec()), 3);
        for i in 0..3 {
            let value = v.value_from_raw(f64::from(v.samples().raw(i)));
            assert!((value - values[i]).abs() <= values[i].abs() * 2f64.powi(-24), "{value} {}", values[i]);
            assert!((v.raw_from_value(values[i]) - f64::from(v.samples().raw(i))).abs() < 1e-6);
        }
    }
    // Within the range: left alone.
    let v = make(Data::F32(vec![1e30, -1e-30, 0.0]), 3);
    assert!(v.notes.is_empty() && v.slope() == 1.0);
    assert!(make(Data::F32(vec![0.0; 3]), 3).notes.is_empty());
    // 2^100 itself is inside, the next number is not; likewise 2^-100.
    assert_eq!(rescaling(power_of_two(100)), None);
    assert_eq!(rescaling(power_of_two(100) * 1.0000001), Some(100));
    assert_eq!(rescaling(power_of_two(-100)), None);
    assert_eq!(rescaling(power_of_two(-100) * 0.9999999), Some(-101));
}

#[test]
fn rounding_of_float64_is_counted() {
    let v = make(Data::F64(vec![0.5, 0.1, 0.25]), 3);
    assert_eq!(v.notes, [note("float64 samples were rounded to float32", 1)]);
}

#[test]
fn permutations_put_each_sample_where_its_axes_say() {
    // The value of a sample encodes its file indices; dimensions straddle a block.
    let file = [35, 3, 40];
    let values: Vec<u32> = (0..35 * 3 * 40).map(|i| (i % 35 + 100 * (i / 35 % 3) + 1000 * (i / 105)) as u32).collect();
    for axis in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
        let (Data::U32(out), dims) = permute(Data::U32(values.clone()), file, axis) else { panic!("type") };
        for f in 0..3 {
            assert_eq!(dims[axis[f]], file[f]);
        }
        for file_index in [[0, 0, 0], [34, 2, 39], [7, 1, 33], [33, 0, 5]] {
            let mut at = [0; 3];
            (0..3).for_each(|f| at[axis[f]] = file_index[f]);
            let expected = (file_index[0] + 100 * file_index[1] + 1000 * file_index[2]) as u32;
            assert_eq!(out[grid3::index([dims[0], dims[1]], at)], expected, "{axis:?}");
        }
    }
}
