//! From decoded samples to a [`Volume`]: axis order, non-finite samples, narrowing to the types
//! that a volume holds, and exact rescaling of extreme ranges, each with a [`Note`].

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]

use super::decode::Data;
use super::diagnose::REPLACED;
use super::read::ReadHint;
use super::{LengthUnit, Note, Samples, Solid, Volume};
use crate::error::{Error, Result};
use crate::geom::Affine;

/// Magnitudes that f32 arithmetic on samples (differences, squares of gradients) survives:
/// a largest magnitude outside 2^±100 is rescaled.
const SAFE_EXPONENT: i32 = 100;

/// What a format reader hands over.
pub(crate) struct Parts {
    pub(crate) format: &'static str,
    pub(crate) dims: [usize; 3],
    /// Samples, x fastest.
    pub(crate) data: Data,
    pub(crate) slope: f64,
    pub(crate) inter: f64,
    pub(crate) world_from_grid: Affine,
    pub(crate) unit: LengthUnit,
    pub(crate) notes: Vec<Note>,
}

/// A note.
pub(crate) fn note(text: impl Into<String>, count: usize) -> Note {
    Note { text: text.into(), count: count as u64 }
}

/// Makes the volume.
///
/// # Errors
/// When no sample is finite or the scaling is not usable.
pub(crate) fn assemble(parts: Parts, hint: &ReadHint) -> Result<Volume> {
    let Parts { format, dims, data, mut slope, inter, world_from_grid, unit, mut notes } = parts;
    if !(slope.is_finite() && inter.is_finite() && slope != 0.0) {
        return Err(Error::format(
            format,
            format!("the scaling slope {slope}, intercept {inter}"),
            "finite numbers and a slope that is not 0",
            "correct the header",
        ));
    }
    // Light lives at small values when matter is above; with a negative slope these are the
    // largest raw samples.
    let replace_by_smallest = (hint.solid == Solid::Above) == (slope > 0.0);
    let samples = match data {
        Data::U8(v) => Samples::U8(v),
        Data::I8(v) => Samples::I8(v),
        Data::U16(v) => Samples::U16(v),
        Data::I16(v) => Samples::I16(v),
        Data::U32(v) => narrow_integers(&v, "uint32", &mut notes),
        Data::I32(v) => narrow_integers(&v, "int32", &mut notes),
        Data::U64(v) => narrow_integers(&v, "uint64", &mut notes),
        Data::I64(v) => narrow_integers(&v, "int64", &mut notes),
        Data::F32(mut v) => {
            let largest = replace_non_finite(&mut v, format, replace_by_smallest, &mut notes)?;
            if let Some(exponent) = rescaling(largest) {
                let factor = power_of_two(-exponent);
                v.iter_mut().for_each(|s| *s = (f64::from(*s) * factor) as f32);
                slope *= power_of_two(exponent);
                notes.push(rescaled(exponent, v.len()));
            }
            Samples::F32(v)
        }
        Data::F64(mut v) => {
            let largest = replace_non_finite(&mut v, format, replace_by_smallest, &mut notes)?;
            let exponent = rescaling(largest);
            let factor = power_of_two(-exponent.unwrap_or(0));
            let mut rounded = 0;
            let narrow = |s: &f64| {
                let exact = s * factor;
                let sample = exact as f32;
                rounded += usize::from(f64::from(sample) != exact);
                sample
            };
            let samples = v.iter().map(narrow).collect();
            if let Some(exponent) = exponent {
                slope *= power_of_two(exponent);
                notes.push(rescaled(exponent, v.len()));
            }
            if rounded > 0 {
                notes.push(note("float64 samples were rounded to float32", rounded));
            }
            Samples::F32(samples)
        }
    };
    let mut volume = Volume::new(dims, samples, world_from_grid)?.with_scaling(slope, inter)?;
    volume.name = hint.name.clone();
    volume.unit = unit;
    volume.solid = hint.solid;
    volume.notes = notes;
    Ok(volume)
}

/// Integers wider than a volume holds: 16 bits where they fit exactly, else f32.
fn narrow_integers<T: Copy + Into<Wide>>(values: &[T], name: &str, notes: &mut Vec<Note>) -> Samples {
    let (low, high) = values.iter().fold((i128::MAX, i128::MIN), |(low, high), v| {
        let v = (*v).into().0;
        (low.min(v), high.max(v))
    });
    let wide = |v: &T| (*v).into().0;
    if low >= 0 && high <= i128::from(u16::MAX) {
        return Samples::U16(values.iter().map(|v| wide(v) as u16).collect());
    }
    if low >= i128::from(i16::MIN) && high <= i128::from(i16::MAX) {
        return Samples::I16(values.iter().map(|v| wide(v) as i16).collect());
    }
    let samples: Vec<f32> = values.iter().map(|v| wide(v) as f32).collect();
    let rounded = values.iter().zip(&samples).filter(|(v, s)| **s as i128 != wide(v)).count();
    let how = if rounded == 0 { "exactly".into() } else { format!("{rounded} of them rounded") };
    notes.push(note(format!("{name} samples from {low} to {high} were stored as float32, {how}"), values.len()));
    Samples::F32(samples)
}

/// An integer of any of the four wide types.
struct Wide(i128);
macro_rules! wide {
    ($($t:ty),*) => {$(impl From<$t> for Wide {
        fn from(v: $t) -> Self { Self(i128::from(v)) }
    })*};
}
wide!(u32, i32, u64, i64);

/// Replaces NaN and infinities by the smallest or largest finite sample; returns the largest
/// finite magnitude.
fn replace_non_finite<T: Copy + Into<f64>>(
    samples: &mut [T],
    format: &'static str,
    by_smallest: bool,
    notes: &mut Vec<Note>,
) -> Result<f64> {
    let mut extremes: Option<(T, T)> = None;
    let mut bad = 0;
    for &s in samples.iter() {
        let v: f64 = s.into();
        if !v.is_finite() {
            bad += 1;
            continue;
        }
        let (low, high) = extremes.get_or_insert((s, s));
        if v < (*low).into() {
            *low = s;
        }
        if v > (*high).into() {
            *high = s;
        }
    }
    let Some((low, high)) = extremes else {
        return Err(Error::format(
            format,
            format!("{bad} samples, all NaN or infinite"),
            "finite samples",
            "the volume holds no data; check how it was written",
        ));
    };
    if bad > 0 {
        let (value, which) = if by_smallest { (low, "smallest") } else { (high, "largest") };
        for s in samples.iter_mut() {
            let v: f64 = (*s).into();
            if !v.is_finite() {
                *s = value;
            }
        }
        let value: f64 = value.into();
        notes.push(note(format!("{REPLACED} by the {which} finite one ({value:e}), the lit side"), bad));
    }
    Ok(Into::<f64>::into(low).abs().max(Into::<f64>::into(high).abs()))
}

/// The exponent e by which samples must be divided (2^e) so that the largest magnitude comes to
/// lie in [1, 2); `None` where it is 0 or within 2^±100. |e| ≤ 1000, so that 2^e and its inverse
/// are both normal numbers; a largest magnitude below 2^-1000 then ends at 2^-74 or more.
fn rescaling(largest: f64) -> Option<i32> {
    if largest == 0.0 {
        return None;
    }
    let (_, exponent) = libm::frexp(largest); // largest = m·2^exponent, m in [1/2, 1)
    let exponent = exponent - 1;
    let outside = exponent < -SAFE_EXPONENT || largest > power_of_two(SAFE_EXPONENT);
    outside.then(|| exponent.clamp(-1000, 1000))
}

fn power_of_two(exponent: i32) -> f64 {
    libm::ldexp(1.0, exponent)
}

fn rescaled(exponent: i32, count: usize) -> Note {
    note(format!("samples were divided by 2^{exponent} and the slope multiplied by it; values are unchanged"), count)
}

/// Reorders samples: `axis[f]` is the axis (0 x, 1 y, 2 z) along which file axis f runs, f = 0
/// fastest. Returns the samples x fastest and the dimensions in x, y, z. `axis` is a permutation.
pub(crate) fn permute(data: Data, file_dims: [usize; 3], axis: [usize; 3]) -> (Data, [usize; 3]) {
    let mut dims = [0; 3];
    (0..3).for_each(|f| dims[axis[f]] = file_dims[f]);
    if axis == [0, 1, 2] {
        return (data, dims);
    }
    let strides = [1, file_dims[0], file_dims[0] * file_dims[1]];
    let mut stride_of = [0; 3];
    (0..3).for_each(|f| stride_of[axis[f]] = strides[f]);
    macro_rules! each {
        ($($variant:ident),*) => {
            match data { $(Data::$variant(v) => Data::$variant(gather(&v, dims, stride_of)),)* }
        };
    }
    (each!(U8, I8, U16, I16, U32, I32, U64, I64, F32, F64), dims)
}

/// out[x, y, z] = samples[x·stride_x + y·stride_y + z·stride_z], in blocks that stay in cache
/// whichever axis the input runs along fastest.
fn gather<T: Copy + Default>(samples: &[T], dims: [usize; 3], stride: [usize; 3]) -> Vec<T> {
    const BLOCK: usize = 32;
    let mut out = vec![T::default(); samples.len()];
    let blocks = |n: usize| (0..n).step_by(BLOCK).map(move |start| (start, n.min(start + BLOCK)));
    for (z0, z1) in blocks(dims[2]) {
        for (y0, y1) in blocks(dims[1]) {
            for (x0, x1) in blocks(dims[0]) {
                for z in z0..z1 {
                    for y in y0..y1 {
                        let row = dims[0] * (y + dims[1] * z);
                        let base = y * stride[1] + z * stride[2];
                        for x in x0..x1 {
                            out[row + x] = samples[base + x * stride[0]];
                        }
                    }
                }
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parts(data: Data, count: usize) -> Parts {
        Parts {
            format: "t",
            dims: [count, 1, 1],
            data,
            slope: 1.0,
            inter: 0.0,
            world_from_grid: Affine::IDENTITY,
            unit: LengthUnit::Unknown,
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
        assert_eq!(
            assemble(case, &ReadHint::default()).unwrap().samples(),
            &Samples::F32(vec![3.0, 3.0, 3.0, -1.0, 3.0])
        );
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
        let values: Vec<u32> =
            (0..35 * 3 * 40).map(|i| (i % 35 + 100 * (i / 35 % 3) + 1000 * (i / 105)) as u32).collect();
        for axis in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            let (Data::U32(out), dims) = permute(Data::U32(values.clone()), file, axis) else { panic!("type") };
            for f in 0..3 {
                assert_eq!(dims[axis[f]], file[f]);
            }
            for file_index in [[0, 0, 0], [34, 2, 39], [7, 1, 33], [33, 0, 5]] {
                let mut at = [0; 3];
                (0..3).for_each(|f| at[axis[f]] = file_index[f]);
                let expected = (file_index[0] + 100 * file_index[1] + 1000 * file_index[2]) as u32;
                assert_eq!(out[at[0] + dims[0] * (at[1] + dims[1] * at[2])], expected, "{axis:?}");
            }
        }
    }
}
