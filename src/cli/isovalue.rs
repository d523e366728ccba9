//! Isovalues on the command line: numbers in the file's values, percentages of their range, or `auto`.

use super::text;
use crate::error::{Error, Result};
use crate::volume::{Solid, Volume};
use std::str::FromStr;

/// An isovalue as written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Isovalue {
    /// A value of the file.
    Value(f64),
    /// A part of the range of values, 0 to 100.
    Percent(f64),
    /// The program's choice.
    Auto,
}

impl FromStr for Isovalue {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let wrong = || format!("`{text}` is no isovalue: give a number, a percentage such as 40%, or auto");
        let finite = |s: &str| s.trim().parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(wrong);
        match text.trim() {
            "auto" => Ok(Self::Auto),
            number => match number.strip_suffix('%') {
                Some(part) => finite(part).map(Self::Percent),
                None => finite(number).map(Self::Value),
            },
        }
    }
}

/// An isovalue, perhaps of one of several volumes: `NAME=C`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct NamedIsovalue {
    /// The volume, where it is named.
    pub(super) volume: Option<String>,
    pub(super) isovalue: Isovalue,
}

impl FromStr for NamedIsovalue {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text.split_once('=') {
            Some((name, _)) if name.trim().is_empty() => Err(format!("`{text}`: give NAME=C, such as inner=0.5")),
            Some((name, isovalue)) => Ok(Self { volume: Some(name.trim().into()), isovalue: isovalue.parse()? }),
            None => Ok(Self { volume: None, isovalue: text.parse()? }),
        }
    }
}

/// An isovalue in the file's values, and why it was chosen if the program chose it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Chosen {
    pub(super) value: f64,
    pub(super) reason: Option<String>,
}

impl Isovalue {
    /// The isovalue for a volume.
    ///
    /// # Errors
    /// When no surface can have it: it lies outside the range of values.
    pub(super) fn resolve(self, volume: &Volume, of_field: Option<f64>) -> Result<Chosen> {
        let (low, high) = volume.value_range();
        let (value, reason) = match self {
            Self::Value(value) => (value, None),
            Self::Percent(part) => (low + part / 100.0 * (high - low), None),
            Self::Auto => match of_field {
                Some(value) => (value, Some("the isovalue that belongs to this field".into())),
                None => {
                    let (value, reason) = automatic(volume);
                    (value, Some(reason))
                }
            },
        };
        // A sample that equals the isovalue is lit.
        let crossed = match volume.solid {
            Solid::Above => low <= value && value < high,
            Solid::Below => low < value && value <= high,
        };
        if !crossed {
            return Err(Error::argument(
                "isovalue",
                text::number(value, 8),
                format!(
                    "a value in the range of {}, {} to {}",
                    volume.name,
                    text::number(low, 8),
                    text::number(high, 8)
                ),
                if low == high { "this volume is constant and has no surface" } else { "use `isolume info` to see it" },
            ));
        }
        Ok(Chosen { value, reason })
    }
}

/// Most samples that the automatic choice looks at, evenly spread.
const MOST_SAMPLES: usize = 1 << 20;
/// Bins of its histogram.
const BINS: usize = 256;
/// Share of the samples at either end that it ignores: a few extreme samples (atomic nuclei in an electron
/// density) would otherwise squeeze everything else into one bin.
const TRIMMED: f64 = 0.005;

/// Samples spread evenly through the volume, in the file's values, sorted.
fn spread_samples(volume: &Volume) -> Vec<f64> {
    let samples = volume.samples();
    let stride = samples.len().div_ceil(MOST_SAMPLES);
    // An odd stride does not lock onto an even row length.
    let stride = if stride > 1 { stride | 1 } else { 1 };
    let mut values: Vec<f64> =
        (0..samples.len()).step_by(stride).map(|i| volume.value_from_raw(f64::from(samples.raw(i)))).collect();
    values.sort_unstable_by(f64::total_cmp);
    values
}

/// Otsu's threshold (1979, "A threshold selection method from gray-level histograms"): the value that splits
/// the samples into two classes with the largest variance between them. We take the histogram between the
/// 0.5 and 99.5 percentile, and of the whole range where that is empty.
fn automatic(volume: &Volume) -> (f64, String) {
    let values = spread_samples(volume);
    let (low, high) = volume.value_range();
    let quantile = |q: f64| values[((values.len() - 1) as f64 * q).round() as usize];
    let (from, to) = (quantile(TRIMMED), quantile(1.0 - TRIMMED));
    let (from, to, part) = if from < to { (from, to, "0.5 to 99.5 percentile") } else { (low, high, "whole range") };
    let bins = histogram(&values, from, to, BINS);
    let threshold = from + (to - from) * otsu(&bins) / BINS as f64;
    (threshold, format!("Otsu's threshold of the samples, {part}"))
}

fn histogram(sorted: &[f64], from: f64, to: f64, count: usize) -> Vec<u64> {
    let mut bins = vec![0; count];
    for &v in sorted {
        if (from..=to).contains(&v) && to > from {
            bins[(((v - from) / (to - from) * count as f64) as usize).min(count - 1)] += 1;
        }
    }
    bins
}

/// The border between two bins that separates best; the middle of the best ones where several do.
fn otsu(bins: &[u64]) -> f64 {
    let total: u64 = bins.iter().sum();
    let sum: f64 = bins.iter().enumerate().map(|(i, &n)| i as f64 * n as f64).sum();
    let (mut below, mut sum_below) = (0u64, 0.0);
    let (mut best, mut first, mut last) = (-1.0, 0, 0);
    for (i, &n) in bins.iter().enumerate().take(bins.len() - 1) {
        below += n;
        sum_below += i as f64 * n as f64;
        let above = total - below;
        if below == 0 || above == 0 {
            continue;
        }
        let difference = sum_below / below as f64 - (sum - sum_below) / above as f64;
        let between = below as f64 * above as f64 * difference * difference;
        if between > best {
            (best, first, last) = (between, i, i);
        } else if between == best {
            last = i;
        }
    }
    0.5 * (first + last) as f64 + 1.0
}

/// Counts of the samples in `count` bins over the whole range, for a picture of the distribution.
pub(super) fn overview(volume: &Volume, count: usize) -> Vec<u64> {
    let (low, high) = volume.value_range();
    histogram(&spread_samples(volume), low, high, count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn otsu_lies_between_two_clusters() {
        let mut bins = vec![0; 100];
        (bins[10], bins[11], bins[80], bins[81]) = (50, 50, 30, 30);
        // Every border from 12 to 80 separates equally well: the middle.
        assert_eq!(otsu(&bins), 46.0);
    }

    #[test]
    fn isovalues_are_read_as_written() {
        assert_eq!("40%".parse(), Ok(Isovalue::Percent(40.0)));
        assert_eq!("-0.6".parse(), Ok(Isovalue::Value(-0.6)));
        assert_eq!("auto".parse(), Ok(Isovalue::Auto));
        for wrong in ["", "x", "nan", "inf", "%", "4O%"] {
            assert!(wrong.parse::<Isovalue>().is_err(), "{wrong}");
        }
    }
}
