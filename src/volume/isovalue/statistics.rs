//! Figures of the samples that a choice of an isovalue rests on. They come from at most a million samples, spread
//! evenly, and from all samples of the border.

use super::super::{Solid, Volume};

/// Most samples that are looked at.
const MOST_SAMPLES: usize = 1 << 20;
/// Bins of the histogram for [`otsu`].
const BINS: usize = 256;
/// Share of the samples at either end that it ignores: a few extreme samples (atomic nuclei in an electron
/// density) would otherwise squeeze everything else into one bin.
const TRIMMED: f64 = 0.005;

/// Samples of a volume as values times `scale`, and what is known of their places.
pub(super) struct Statistics {
    /// Ascending; not empty.
    pub(super) sorted: Vec<f64>,
    /// Smallest and largest of all samples.
    pub(super) low: f64,
    pub(super) high: f64,
    pub(super) mean: f64,
    /// Root of the mean square about the mean, and about 0.
    pub(super) deviation: f64,
    pub(super) rms: f64,
    /// Mean and root mean square of the border samples.
    pub(super) border_mean: f64,
    pub(super) border_rms: f64,
    /// Mean square of the difference of neighbours over twice the variance: 0 for smooth fields, 1 for white noise.
    pub(super) roughness: f64,
    /// Share of neighbours that are equal.
    pub(super) equal_neighbours: f64,
    /// A power of two by which values are multiplied, so that their squares are finite; 1 for ordinary ones.
    pub(super) scale: f64,
}

impl Statistics {
    pub(super) fn new(volume: &Volume) -> Self {
        let (low, high) = volume.value_range();
        let (_, exponent) = libm::frexp(low.abs().max(high.abs()));
        let scale = if exponent.abs() > 400 { libm::ldexp(1.0, -exponent.clamp(-1000, 1000)) } else { 1.0 };
        let samples = volume.samples();
        let (slope, inter) = (volume.slope() * scale, volume.inter() * scale);
        let value = |i: usize| slope * f64::from(samples.raw(i)) + inter;
        let stride = samples.len().div_ceil(MOST_SAMPLES);
        // An odd stride does not lock onto an even row length.
        let stride = if stride > 1 { stride | 1 } else { 1 };
        let [nx, ny, nz] = volume.dims();
        let mut sorted = Vec::with_capacity(samples.len() / stride + 1);
        let (mut squares, mut pairs, mut equal) = (0.0, 0u64, 0u64);
        for i in (0..samples.len()).step_by(stride) {
            let here = value(i);
            sorted.push(here);
            let (x, y, z) = (i % nx, i / nx % ny, i / (nx * ny));
            for (inside, step) in [(x + 1 < nx, 1), (y + 1 < ny, nx), (z + 1 < nz, nx * ny)] {
                if inside {
                    let difference = value(i + step) - here;
                    squares += difference * difference;
                    equal += u64::from(difference == 0.0);
                    pairs += 1;
                }
            }
        }
        let count = sorted.len().max(1) as f64;
        let mean = sorted.iter().sum::<f64>() / count;
        let variance = sorted.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / count;
        let rms = (sorted.iter().map(|v| v * v).sum::<f64>() / count).sqrt();
        sorted.sort_unstable_by(f64::total_cmp);
        let (mut sum, mut sum_of_squares, mut border) = (0.0, 0.0, 0u64);
        for_border(volume.dims(), &mut |i| {
            let v = value(i);
            sum += v;
            sum_of_squares += v * v;
            border += 1;
        });
        let (pairs, border) = (pairs.max(1) as f64, border.max(1) as f64);
        Self {
            sorted,
            low: low * scale,
            high: high * scale,
            mean,
            deviation: variance.sqrt(),
            rms,
            border_mean: sum / border,
            border_rms: (sum_of_squares / border).sqrt(),
            roughness: if variance > 0.0 { squares / pairs / (2.0 * variance) } else { 0.0 },
            equal_neighbours: equal as f64 / pairs,
            scale,
        }
    }

    /// The same of the negative volume.
    pub(super) fn negated(&self) -> Self {
        Self {
            sorted: self.sorted.iter().rev().map(|v| -v).collect(),
            low: -self.high,
            high: -self.low,
            mean: -self.mean,
            border_mean: -self.border_mean,
            ..*self
        }
    }

    /// The value below which a share of the samples lies.
    pub(super) fn quantile(&self, share: f64) -> f64 {
        let last = self.sorted.len().saturating_sub(1);
        let place = (last as f64 * share.clamp(0.0, 1.0)).round() as usize;
        self.sorted.get(place).copied().unwrap_or(0.0)
    }

    /// Share of the samples above a value.
    pub(super) fn share_above(&self, value: f64) -> f64 {
        let below = self.sorted.partition_point(|v| *v <= value);
        (self.sorted.len() - below) as f64 / self.sorted.len().max(1) as f64
    }

    /// The deviation of the bulk of the samples from their median: of a normal distribution that is its σ, whatever
    /// a few per cent of others are.
    pub(super) fn noise(&self) -> f64 {
        let median = self.quantile(0.5);
        let mut distances: Vec<f64> = self.sorted.iter().map(|v| (v - median).abs()).collect();
        distances.sort_unstable_by(f64::total_cmp);
        // The median distance of a normal distribution is 0.6745 σ.
        distances.get(distances.len() / 2).map_or(0.0, |d| d / 0.6745)
    }

    /// The magnitude above which a share of the sum of squares lies.
    pub(super) fn magnitude_enclosing(&self, share: f64) -> f64 {
        let mut magnitudes: Vec<f64> = self.sorted.iter().map(|v| v.abs()).collect();
        magnitudes.sort_unstable_by(f64::total_cmp);
        let wanted = share * magnitudes.iter().map(|v| v * v).sum::<f64>();
        let mut sum = 0.0;
        let found = magnitudes.iter().rev().find(|v| {
            sum += *v * *v;
            sum >= wanted
        });
        found.copied().unwrap_or(0.0)
    }

    /// Otsu's threshold (1979, "A threshold selection method from gray-level histograms"): the value that splits
    /// the samples into two classes with the largest variance between them. We take the histogram between the
    /// 0.5 and 99.5 percentile, of the whole range where these are equal.
    pub(super) fn otsu(&self) -> f64 {
        let (from, to) = (self.quantile(TRIMMED), self.quantile(1.0 - TRIMMED));
        let (from, to) = if from < to { (from, to) } else { (self.low, self.high) };
        let bins = histogram(&self.sorted, from, to, BINS);
        from + (to - from) * otsu(&bins) / BINS as f64
    }
}

/// Visits the index of each sample on the six faces of a grid once.
pub(in super::super) fn for_border([nx, ny, nz]: [usize; 3], each: &mut dyn FnMut(usize)) {
    for z in 0..nz {
        for y in 0..ny {
            let row = nx * (y + ny * z);
            if z == 0 || y == 0 || z + 1 == nz || y + 1 == ny {
                (0..nx).for_each(|x| each(row + x));
            } else {
                each(row);
                if nx > 1 {
                    each(row + nx - 1);
                }
            }
        }
    }
}

/// How many samples on the six faces of the grid are solid at an isovalue, and how many there are.
pub(in super::super) fn solid_of_border(volume: &Volume, isovalue: f64, solid: Solid) -> (u64, u64) {
    let c_raw = volume.raw_from_value(isovalue);
    let above = (solid == Solid::Above) == (volume.slope() > 0.0);
    let sign = if above { 1.0 } else { -1.0 };
    let (mut inside, mut border) = (0, 0);
    for_border(volume.dims(), &mut |i| {
        border += 1;
        inside += u64::from(sign * (f64::from(volume.samples().raw(i)) - c_raw) > 0.0);
    });
    (inside, border)
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
#[doc(hidden)]
pub fn overview(volume: &Volume, count: usize) -> Vec<u64> {
    let statistics = Statistics::new(volume);
    histogram(&statistics.sorted, statistics.low, statistics.high, count)
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
    fn each_sample_of_the_border_is_visited_once() {
        for dims in [[1, 1, 1], [2, 2, 2], [1, 5, 4], [5, 4, 3], [4, 1, 4]] {
            let mut seen = Vec::new();
            for_border(dims, &mut |i| seen.push(i));
            let [nx, ny, nz] = dims;
            let on = |i: usize| {
                let at = crate::grid3::at([nx, ny], i);
                (0..3).any(|a| at[a] == 0 || at[a] + 1 == dims[a])
            };
            let expected: Vec<usize> = (0..nx * ny * nz).filter(|&i| on(i)).collect();
            seen.sort_unstable();
            assert_eq!(seen, expected, "{dims:?}");
        }
    }
}
