//! Samples of the volume as a texture of the page, the ranges that let rays skip, and the spread of values.

use super::texels::taps;
use crate::volume::{SamplesView, Volume};
use half::f16;

/// Cells along the side of a block whose smallest and largest sample are kept.
pub(super) const BLOCK: usize = 8;

/// Samples as texture numbers t, raw sample = scale·t + offset.
pub(super) struct SampleTexture {
    pub(super) dims: [usize; 3],
    pub(super) scale: f64,
    pub(super) offset: f64,
    pub(super) numbers: Numbers,
}

/// 8-bit numbers stand for t = number/255.
pub(super) enum Numbers {
    Byte(Vec<u8>),
    Half(Vec<f16>),
}

impl Numbers {
    pub(super) fn little_endian(&self) -> &[u8] {
        match self {
            Self::Byte(v) => v,
            Self::Half(v) => bytemuck::cast_slice(v),
        }
    }

    pub(super) fn coding_name(&self) -> &'static str {
        match self {
            Self::Byte(_) => "byte",
            Self::Half(_) => "half",
        }
    }
}

/// The samples on a grid of `dims`, which is that of the volume or coarser (mean under a tent). 8-bit volumes stay
/// 8-bit; others become 16-bit floats relative to the largest magnitude.
pub(super) fn volume_texture(volume: &Volume, dims: [usize; 3]) -> SampleTexture {
    let samples = volume.samples();
    let (low, high) = volume.raw_range();
    match samples.view() {
        SamplesView::U8(_) => {
            let numbers = resample(volume, dims, |raw| (raw + 0.5) as u8);
            SampleTexture { dims, scale: 255.0, offset: 0.0, numbers: Numbers::Byte(numbers) }
        }
        SamplesView::I8(_) => {
            let numbers = resample(volume, dims, |raw| (raw + 128.5) as u8);
            SampleTexture { dims, scale: 255.0, offset: -128.0, numbers: Numbers::Byte(numbers) }
        }
        _ => {
            let largest = low.abs().max(high.abs());
            let scale = if largest > 0.0 { largest } else { 1.0 };
            let numbers = resample(volume, dims, |raw| f16::from_f32(raw / scale));
            SampleTexture { dims, scale: f64::from(scale), offset: 0.0, numbers: Numbers::Half(numbers) }
        }
    }
}

fn resample<T>(volume: &Volume, dims: [usize; 3], number: impl Fn(f32) -> T) -> Vec<T> {
    let samples = volume.samples();
    if dims == volume.dims() {
        return (0..samples.len()).map(|i| number(samples.raw(i))).collect();
    }
    let axes: [_; 3] = std::array::from_fn(|a| taps(volume.dims()[a], dims[a]));
    let mut out = Vec::with_capacity(dims.iter().product());
    for in_z in &axes[2] {
        for in_y in &axes[1] {
            for in_x in &axes[0] {
                let (mut sum, mut weights) = (0.0f32, 0.0f32);
                for &(k, wz) in in_z {
                    for &(j, wy) in in_y {
                        let row = volume.index(0, j, k);
                        for &(i, wx) in in_x {
                            sum += wx * wy * wz * samples.raw(row + i);
                            weights += wx * wy * wz;
                        }
                    }
                }
                out.push(number(sum / weights));
            }
        }
    }
    out
}

/// Blocks along each axis.
pub(super) fn block_counts(dims: [usize; 3]) -> [usize; 3] {
    dims.map(|n| (n - 1).div_ceil(BLOCK).max(1))
}

/// Smallest and largest number over each block of 8³ cells and its far faces, side by side, x fastest.
pub(super) fn ranges(texture: &SampleTexture) -> Numbers {
    match &texture.numbers {
        Numbers::Byte(v) => Numbers::Byte(block_ranges(texture.dims, v)),
        Numbers::Half(v) => Numbers::Half(block_ranges(texture.dims, v)),
    }
}

fn block_ranges<T: Copy + PartialOrd>(dims: [usize; 3], numbers: &[T]) -> Vec<T> {
    let count = block_counts(dims);
    let mut out = Vec::with_capacity(2 * count.iter().product::<usize>());
    for b in 0..count.iter().product::<usize>() {
        let block = [b % count[0], b / count[0] % count[1], b / count[0] / count[1]];
        let span = |a: usize| block[a] * BLOCK..(block[a] * BLOCK + BLOCK + 1).min(dims[a]);
        let first = numbers[span(0).start + dims[0] * (span(1).start + dims[1] * span(2).start)];
        let (mut low, mut high) = (first, first);
        for z in span(2) {
            for y in span(1) {
                let row = dims[0] * (y + dims[1] * z);
                for &v in &numbers[row + span(0).start..row + span(0).end] {
                    low = if v < low { v } else { low };
                    high = if v > high { v } else { high };
                }
            }
        }
        out.extend([low, high]);
    }
    out
}

/// Most samples that [`value_quantiles`] looks at.
const MOST_SAMPLES: usize = 1 << 20;

/// `count` + 1 quantiles of the values, evenly spread from the smallest to the largest.
pub(super) fn value_quantiles(volume: &Volume, count: usize) -> Vec<f64> {
    let samples = volume.samples();
    let stride = samples.len().div_ceil(MOST_SAMPLES).max(1);
    // An odd stride does not lock onto an even row length.
    let stride = if stride > 1 { stride | 1 } else { 1 };
    let values = (0..samples.len()).step_by(stride).map(|i| volume.value_from_raw(f64::from(samples.raw(i))));
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    let last = values.len() - 1;
    let mut out: Vec<f64> = (0..=count).map(|i| values[last * i / count]).collect();
    let (low, high) = volume.value_range();
    (out[0], out[count]) = (low, high);
    out
}
