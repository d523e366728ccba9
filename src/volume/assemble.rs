//! From decoded samples to a [`Volume`]: axis order, non-finite samples, narrowing to the types
//! that a volume holds, and exact rescaling of extreme ranges, each with a [`Note`].

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]

use super::decode::Data;
use super::diagnose::REPLACED;
use super::mapped::Stored;
use super::read::ReadHint;
use super::{Choice, LengthUnit, Note, Samples, SamplesView, Series, Solid, Volume};
use crate::error::{Error, Result};
use crate::geom::Affine;
use glam::DVec3;
use std::sync::Arc;

/// Magnitudes that f32 arithmetic on samples (differences, squares of gradients) survives:
/// a largest magnitude outside 2^±100 is rescaled.
const SAFE_EXPONENT: i32 = 100;

/// What a format reader hands over.
pub(crate) struct Parts<D = Data> {
    pub(crate) format: &'static str,
    pub(crate) dims: [usize; 3],
    /// Samples, x fastest.
    pub(crate) data: D,
    pub(crate) slope: f64,
    pub(crate) inter: f64,
    pub(crate) world_from_grid: Affine,
    pub(crate) unit: LengthUnit,
    pub(crate) series: Series,
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
pub(crate) fn assemble(parts: Parts<impl Into<Stored>>, hint: &ReadHint) -> Result<Volume> {
    let Parts { format, mut dims, data, mut slope, inter, world_from_grid, unit, series, mut notes } = parts;
    let (mut data, mut first) = (data.into(), [0; 3]);
    if let Some(region) = &hint.choice.region {
        let (start, count) = region.within(dims.map(|n| n as u64))?;
        let [x, y, z] = start.map(|n| n as usize);
        let count = count.map(|n| n as usize);
        if count != dims {
            data = data.pick(x + dims[0] * (y + dims[1] * z), [1, dims[0], dims[0] * dims[1]], count);
        }
        (first, dims) = (start, count);
    }
    let (world_from_grid, unit) = place(world_from_grid, unit, first, &hint.choice)?;
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
        Stored::Mapped(mapped) if mapped.is_usable(|most| rescaling(most).is_none()) => {
            Samples::Shared(Arc::new(mapped))
        }
        data => match data.decoded(format)? {
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
        },
    };
    let mut volume = Volume::new(dims, samples, world_from_grid)?.with_scaling(slope, inter)?;
    volume.name = hint.name.clone();
    volume.unit = unit;
    volume.solid = hint.solid;
    volume.series = series;
    volume.notes = notes;
    Ok(volume)
}

/// The map and unit of a grid that begins at sample `first` of a file's, with the spacing that was asked for.
///
/// # Errors
/// When that spacing is not usable.
pub(crate) fn place(
    world_from_grid: Affine,
    unit: LengthUnit,
    first: [u64; 3],
    choice: &Choice,
) -> Result<(Affine, LengthUnit)> {
    let (mut made, mut unit) = (world_from_grid, unit);
    if let Some(spacing) = &choice.spacing {
        let refuse = || Error::argument("--spacing", format!("{spacing:?}"), "spacings of ordinary size", "correct it");
        let (spaced, in_unit) = spacing.apply(made, unit);
        (made, unit) = (spaced.ok_or_else(refuse)?, in_unit);
    }
    if first != [0; 3] {
        let offset = made.offset() + made.linear() * DVec3::from_array(first.map(|n| n as f64));
        let far = || Error::argument("--region", format!("{first:?}"), "a place of ordinary size", "correct it");
        made = Affine::new(made.linear(), offset).ok_or_else(far)?;
    }
    Ok((made, unit))
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

/// Some of the samples, as a grid of their own: `first` and the strides of x, y, z say where they are.
pub(crate) fn pick(data: Data, first: usize, stride: [usize; 3], dims: [usize; 3]) -> Data {
    macro_rules! each {
        ($($variant:ident),*) => {
            match data {
                $(Data::$variant(v) => Data::$variant(gather(v.get(first..).unwrap_or_default(), dims, stride)),)*
            }
        };
    }
    each!(U8, I8, U16, I16, U32, I32, U64, I64, F32, F64)
}

/// [`pick`] of samples that are not owned.
pub(crate) fn pick_of(samples: SamplesView, first: usize, stride: [usize; 3], dims: [usize; 3]) -> Data {
    macro_rules! each {
        ($($variant:ident),*) => {
            match samples {
                $(SamplesView::$variant(s) => Data::$variant(gather(s.get(first..).unwrap_or_default(), dims, stride)),)*
            }
        };
    }
    each!(U8, I8, U16, I16, F32)
}

/// a·first + b·second, rounded to the type of the samples; those of 64 bits are the first.
pub(crate) fn mix(first: &Data, second: &Data, a: f64, b: f64) -> Data {
    macro_rules! each {
        ($($variant:ident $t:ty),*) => {
            match (first, second) {
                $((Data::$variant(x), Data::$variant(y)) => {
                    Data::$variant(x.iter().zip(y).map(|(x, y)| libm::round(a * f64::from(*x) + b * f64::from(*y)) as $t).collect())
                })*
                (Data::F32(x), Data::F32(y)) => {
                    Data::F32(x.iter().zip(y).map(|(x, y)| (a * f64::from(*x) + b * f64::from(*y)) as f32).collect())
                }
                _ => first.clone(),
            }
        };
    }
    each!(U8 u8, I8 i8, U16 u16, I16 i16, U32 u32, I32 i32)
}

/// out[x, y, z] = samples[x·stride_x + y·stride_y + z·stride_z], in blocks that stay in cache
/// whichever axis the input runs along fastest.
fn gather<T: Copy + Default>(samples: &[T], dims: [usize; 3], stride: [usize; 3]) -> Vec<T> {
    const BLOCK: usize = 32;
    let mut out = vec![T::default(); dims.iter().product()];
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
mod tests;
