//! What the samples are like, wherever they lie.

#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

use super::super::{Sample, Samples, SamplesView, Volume, with_samples};
use crate::finding::Finding;
use std::collections::HashMap;

/// More values than this are not told apart: enough for 16-bit samples, and the table stays small
/// for floating-point ones.
const MOST_VALUES: usize = 1 << 16;
/// A volume with at most so many values is a mask or a label map rather than a measurement.
const FEW_VALUES: usize = 16;
/// Bins that the range is cut into to see whether samples are heaped at its ends.
const BINS: usize = 256;
/// How many times fuller than each of its neighbouring bins an end must be to count as a heap.
const HEAPED: u64 = 4;
/// A heap has at least so many samples: fewer are what any data may have at its extreme.
const LEAST_HEAP: u64 = 16;
/// Bins, of [`BINS`], that hold nearly all samples where the range has a long tail: 5 %.
const NARROW_BINS: usize = 12;
/// Fewer steps of f32 in the range than this, and interpolation shows them: 2¹², finer than 12-bit data.
const FEWEST_STEPS: f64 = 4096.0;

pub(super) fn findings(volume: &Volume) -> Vec<Finding> {
    let count = volume.samples().len() as u64;
    let (low, high) = volume.value_range();
    if low == high {
        let handled = "no isosurface exists at any isovalue; commands that need one refuse";
        let text = format!("every sample is {low}");
        return vec![Finding::new("constant", (count, count, "samples"), text, handled)];
    }
    let mut found = Vec::new();
    found.extend(with_samples!(volume.samples(), s => plateaus(volume, s)));
    let histogram = with_samples!(volume.samples(), s => Histogram::new(volume, s));
    found.extend(heaps(volume, &histogram));
    found.extend(long_tail(volume, &histogram));
    found.extend(with_samples!(volume.samples(), s => few_levels(s)));
    found.extend(narrow_range(volume));
    found
}

/// How often each raw value occurs, for the first [`MOST_VALUES`] values met.
#[derive(Default)]
struct Tally(HashMap<u32, u64>);

impl Tally {
    fn add(&mut self, raw: f32) {
        // +0 and −0 are one value.
        let key = if raw == 0.0 { 0 } else { raw.to_bits() };
        if self.0.len() < MOST_VALUES || self.0.contains_key(&key) {
            *self.0.entry(key).or_insert(0) += 1;
        }
    }

    /// The value that occurs most often, the smallest of several; `None` for nothing.
    fn most_frequent(&self) -> Option<(f32, u64)> {
        let pairs = self.0.iter().map(|(&bits, &n)| (f32::from_bits(bits), n));
        pairs.max_by(|a, b| a.1.cmp(&b.1).then(b.0.total_cmp(&a.0)))
    }
}

fn plateaus<T: Sample>(volume: &Volume, samples: &[T]) -> Option<Finding> {
    let [nx, ny, nz] = volume.dims();
    let cells = [nx, ny, nz].iter().map(|&n| n as u64 - 1).product::<u64>();
    let rows = [0, nx, nx * ny, nx * ny + nx];
    let (mut flat, mut tally) = (0u64, Tally::default());
    for z in 0..nz - 1 {
        for y in 0..ny - 1 {
            let base = nx * (y + ny * z);
            // Whether the four samples of a face across x are the same, carried from cell to cell.
            let face = |x: usize| {
                let v = samples.get(base + x)?.raw();
                rows.iter().all(|o| samples.get(base + x + o).is_some_and(|s| s.raw() == v)).then_some(v)
            };
            let mut before = face(0);
            for x in 1..nx {
                let after = face(x);
                if let Some(v) = before.filter(|_| before == after) {
                    flat += 1;
                    tally.add(v);
                }
                before = after;
            }
        }
    }
    let (value, most) = tally.most_frequent()?;
    let value = volume.value_from_raw(f64::from(value));
    let (low, high) = volume.value_range();
    let place = if value == low {
        ", the smallest value"
    } else if value == high {
        ", the largest value"
    } else {
        ""
    };
    let share = 100.0 * most as f64 / flat as f64;
    Some(Finding::new(
        "plateaus",
        (flat, cells, "cells"),
        format!("8 equal corners; {share:.1} % of these at {value}{place}"),
        "no surface runs through a flat cell and nothing is baked there. At an isovalue of exactly that value the \
         plateau counts as lit, so the surface runs around it; texels inside have no normal and stay invalid",
    ))
}

/// The ends of a type that stands for a measurement's limits; none for floating point.
fn type_ends(samples: &Samples) -> Option<(f32, f32)> {
    match samples.view() {
        SamplesView::U8(_) => Some((0.0, 255.0)),
        SamplesView::I8(_) => Some((-128.0, 127.0)),
        SamplesView::U16(_) => Some((0.0, 65535.0)),
        SamplesView::I16(_) => Some((-32768.0, 32767.0)),
        SamplesView::F32(_) => None,
    }
}

/// How often the samples fall into equal parts of their range, the two ends apart.
struct Histogram {
    at_low: u64,
    between: [u64; BINS],
    at_high: u64,
}

impl Histogram {
    fn new<T: Sample>(volume: &Volume, samples: &[T]) -> Self {
        let (low, high) = volume.raw_range();
        let (from, width) = (f64::from(low), f64::from(high) - f64::from(low));
        let mut histogram = Self { at_low: 0, between: [0; BINS], at_high: 0 };
        for s in samples {
            let raw = s.raw();
            if raw == low {
                histogram.at_low += 1;
            } else if raw == high {
                histogram.at_high += 1;
            } else {
                let bin = ((f64::from(raw) - from) / width * BINS as f64) as usize;
                if let Some(n) = histogram.between.get_mut(bin.min(BINS - 1)) {
                    *n += 1;
                }
            }
        }
        histogram
    }
}

/// Samples heaped at the smallest and the largest value.
fn heaps(volume: &Volume, histogram: &Histogram) -> Vec<Finding> {
    let (low, high) = volume.raw_range();
    let Histogram { at_low, between: bins, at_high } = histogram;
    // The fullest of the bins next to an end: the end itself, on its own, stands beside them.
    let near = |bins: &[u64]| bins.iter().copied().max().unwrap_or(0);
    let is_heap = |n: u64, beside: u64| n >= LEAST_HEAP && n > HEAPED * beside;
    let ends = type_ends(volume.samples());
    let total = volume.samples().len() as u64;
    let mut found = Vec::new();
    let mut report = |raw: f32, n: u64, beside: u64, largest: bool| {
        if !is_heap(n, beside) {
            return;
        }
        let value = volume.value_from_raw(f64::from(raw));
        let at_type_end = ends.is_some_and(|(low, high)| raw == if largest { high } else { low });
        let topic = if at_type_end && largest { "saturation" } else { "clipped range" };
        let which = if largest == (volume.slope() > 0.0) { "largest" } else { "smallest" };
        let what = match (at_type_end, largest) {
            (true, true) => format!("at {value}, the end of {}", volume.samples().type_name()),
            _ => format!("heaped at the {which} value, {value}"),
        };
        let why = if largest {
            "the samples stay as they are. Whatever rose above was lost when the file was written: choose isovalues \
             away from there, near it the surface has flat tops and terraces"
        } else {
            "the samples stay as they are. This is a background, or what lay below was cut off: choose isovalues \
             away from there, near it the surface follows the edge of the cut"
        };
        found.push(Finding::new(topic, (n, total, "samples"), what, why));
    };
    report(low, *at_low, near(&bins[..4]), false);
    report(high, *at_high, near(&bins[BINS - 4..]), true);
    found
}

/// Nearly all samples in a small part of the range, the rest far away.
fn long_tail(volume: &Volume, histogram: &Histogram) -> Option<Finding> {
    let total = volume.samples().len() as u64;
    let mut bins = histogram.between;
    let [first, .., last] = &mut bins;
    *first += histogram.at_low;
    *last += histogram.at_high;
    // The bins that hold the middle 99 %: half a per cent is left out at either end.
    let cut = total / 200;
    let end = |counts: &mut dyn Iterator<Item = &u64>| {
        let mut seen = 0;
        counts
            .take_while(|n| {
                seen += **n;
                seen <= cut
            })
            .count()
    };
    let (below, above) = (end(&mut bins.iter()), end(&mut bins.iter().rev()));
    let part = (BINS - below.min(BINS - 1)).saturating_sub(above).max(1);
    let inside: u64 = bins.iter().skip(below).take(part).sum();
    let (low, high) = volume.raw_range();
    let edge = |bin: usize| {
        let raw = f64::from(low) + (f64::from(high) - f64::from(low)) * bin as f64 / BINS as f64;
        volume.value_from_raw(raw)
    };
    let (from, to) = (edge(below), edge(below + part));
    (part <= NARROW_BINS).then(|| {
        Finding::new(
            "long tail",
            (total - inside, total, "samples"),
            format!(
                "{:.1} % of the samples lie in {:.1} % of the range, from {:.4} to {:.4}; these do not",
                100.0 * inside as f64 / total as f64,
                100.0 * part as f64 / BINS as f64,
                from.min(to),
                from.max(to)
            ),
            "nothing is cut off. Isovalues in percent of the range miss the data, so give values; --isovalue auto \
             leaves the extremes out; --colormap NAME:LOW..HIGH spends its colours where the data is",
        )
    })
}

fn few_levels<T: Sample>(samples: &[T]) -> Option<Finding> {
    let mut values: Vec<f32> = Vec::with_capacity(FEW_VALUES + 1);
    for s in samples {
        let raw = s.raw();
        if !values.contains(&raw) {
            if values.len() == FEW_VALUES {
                return None;
            }
            values.push(raw);
        }
    }
    let text = match values.len() {
        2 => "only two values occur: a mask".to_string(),
        n => format!("only {n} values occur: labels, or coarsely quantised"),
    };
    let n = values.len() as u64;
    Some(Finding::new(
        "few levels",
        (n, 0, "values"),
        text,
        "surfaces show the voxels as steps and terraces: they follow the samples, nothing is smoothed. Blur the mask \
         before, or keep the grey values it was made from",
    ))
}

fn narrow_range(volume: &Volume) -> Option<Finding> {
    let SamplesView::F32(_) = volume.samples().view() else { return None };
    let (low, high) = volume.raw_range();
    // One f32 step at the largest magnitude: 2⁻²³ of the power of two below it.
    let largest = f64::from(low.abs().max(high.abs()));
    let (_, exponent) = libm::frexp(largest);
    let step = libm::ldexp(1.0, (exponent - 24).max(-149));
    let steps = (f64::from(high) - f64::from(low)) / step;
    (steps < FEWEST_STEPS).then(|| {
        Finding::new(
            "narrow range",
            (steps as u64, 0, "steps"),
            format!("the range is small beside its distance from 0: f32 has {steps:.0} steps in it"),
            "samples are kept in f32, so these steps show as terraces. Subtract the offset before the file is \
             written as float32, or store integers with a slope and intercept",
        )
    })
}
