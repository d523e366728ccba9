//! Which isovalues photons carry.

use crate::error::{Error, Result};
use crate::grid3;
use crate::volume::{Sample, Volume, with_samples};
use rayon::prelude::*;

/// How isovalues are distributed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum IsovalueChoice {
    /// In proportion to the number of cells that the isosurface crosses, so that photons lie about as densely on small
    /// isosurfaces as on large ones (importance by cell extent: Beason 2005).
    #[default]
    Extents,
    /// All alike, for study.
    Uniform,
}

/// The isovalues of a photon map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Isovalues {
    /// How they are distributed.
    pub choice: IsovalueChoice,
    /// Between which values of the file; `None` for all. A map for one isosurface needs those near it only.
    pub range: Option<[f64; 2]>,
}

impl Isovalues {
    /// Those near one isosurface: within half of `cells` times the median extent of the cells that it crosses, so that
    /// they lie within about `cells`/2 samples of it. `None` where it crosses no cell, or `cells` is not above 0.
    pub fn near(volume: &Volume, isovalue: f64, cells: f64) -> Option<Self> {
        if !(cells.is_finite() && cells > 0.0) {
            return None;
        }
        let c = volume.raw_from_value(isovalue) as f32;
        let mut extents: Vec<f32> = with_samples!(volume.samples(), s => {
            let mut all = Vec::new();
            for_cells(s, volume.dims(), 0..volume.dims()[2].saturating_sub(1), &mut |low, high| {
                // A level set may run through samples.
                if low <= c && c <= high && low < high {
                    all.push(high - low);
                }
            });
            all
        });
        let middle = extents.len() / 2;
        let median = (!extents.is_empty()).then(|| *extents.select_nth_unstable_by(middle, f32::total_cmp).1)?;
        let half = 0.5 * cells * f64::from(median) * volume.slope().abs();
        let (low, high) = volume.value_range();
        Some(Self {
            choice: IsovalueChoice::Extents,
            range: Some([(isovalue - half).max(low), (isovalue + half).min(high)]),
        })
    }
}

/// Pieces of constant density. A narrow range has them all to itself.
const BINS: usize = 1024;

/// A density of isovalues in ranges of the samples: 0 the lowest sample, 1 the highest.
#[derive(Clone, Debug)]
pub(super) struct IsovalueDensity {
    low: f64,
    high: f64,
    // Invariant: never falls, from 0 to 1.
    cumulative: Vec<f64>,
}

impl IsovalueDensity {
    pub(super) fn new(volume: &Volume, isovalues: &Isovalues) -> Result<Self> {
        let (least, most) = volume.raw_range();
        let (least, most) = (f64::from(least), f64::from(most));
        let refuse = |found: String| {
            let (low, high) = volume.value_range();
            Err(Error::argument("isovalues of photons", found, format!("a range within {low} to {high}"), "widen it"))
        };
        if most <= least {
            return refuse("a volume of one value".into());
        }
        let (mut low, mut high) = (0.0, 1.0);
        if let Some(range) = isovalues.range {
            let place = |value: f64| (volume.raw_from_value(value) - least) / (most - least);
            let (a, b) = (place(range[0]), place(range[1]));
            (low, high) = (a.min(b).max(0.0), a.max(b).min(1.0));
            if high <= low || low.is_nan() {
                return refuse(format!("{} to {}", range[0], range[1]));
            }
        }
        let weights = match isovalues.choice {
            IsovalueChoice::Uniform => vec![1.0; BINS],
            IsovalueChoice::Extents => with_samples!(volume.samples(), s => {
                let place = |raw: f32| ((f64::from(raw) - least) / (most - least) - low) / (high - low) * BINS as f64;
                extents(s, volume.dims(), &place)
            }),
        };
        let mut cumulative = Vec::with_capacity(BINS + 1);
        let mut sum = 0.0;
        cumulative.push(0.0);
        for w in weights {
            sum += w;
            cumulative.push(sum);
        }
        if sum <= 0.0 {
            return refuse("no isosurface in it".into());
        }
        cumulative.iter_mut().for_each(|v| *v /= sum);
        Ok(Self { low, high, cumulative })
    }

    /// The range that is drawn from.
    pub(super) fn drawn(&self) -> [f64; 2] {
        [self.low, self.high]
    }

    /// The isovalue of a variate in [0, 1) and its density.
    pub(super) fn sample(&self, u: f32) -> (f64, f64) {
        let u = f64::from(u);
        let bin = self.cumulative.partition_point(|c| *c <= u).clamp(1, BINS) - 1;
        let share = self.cumulative[bin + 1] - self.cumulative[bin];
        let within = if share > 0.0 { ((u - self.cumulative[bin]) / share).clamp(0.0, 1.0) } else { 0.5 };
        let width = (self.high - self.low) / BINS as f64;
        (self.low + (bin as f64 + within) * width, share / width)
    }
}

/// How many cells cross the isovalues of each bin, `place` giving where a sample is in bins.
fn extents<T: Sample>(samples: &[T], dims: [usize; 3], place: &(dyn Fn(f32) -> f64 + Sync)) -> Vec<f64> {
    const SLABS: usize = 8;
    let slabs: Vec<usize> = (0..dims[2].saturating_sub(1)).step_by(SLABS).collect();
    let parts: Vec<Vec<f64>> = slabs
        .par_iter()
        .map(|&z| {
            // Cells that cross a whole bin, as differences from bin to bin; and what they cross of their first and last.
            let (mut whole, mut partly) = (vec![0.0; BINS + 1], vec![0.0; BINS]);
            for_cells(samples, dims, z..(z + SLABS).min(dims[2] - 1), &mut |low, high| {
                let (low, high) = (place(low).max(0.0), place(high).min(BINS as f64));
                if high <= low {
                    return;
                }
                let (first, last) = (low as usize, (high as usize).min(BINS - 1));
                if first == last {
                    partly[first] += high - low;
                    return;
                }
                partly[first] += (first + 1) as f64 - low;
                partly[last] += high - last as f64;
                whole[first + 1] += 1.0;
                whole[last] -= 1.0;
            });
            let mut crossing = 0.0;
            for (bin, value) in partly.iter_mut().enumerate() {
                crossing += whole[bin];
                *value += crossing;
            }
            partly
        })
        .collect();
    let mut sum = vec![0.0; BINS];
    for part in parts {
        sum.iter_mut().zip(part).for_each(|(a, b)| *a += b);
    }
    sum
}

/// The range of the samples at the corners of every cell of some slabs.
fn for_cells<T: Sample>(
    samples: &[T],
    dims: [usize; 3],
    slabs: std::ops::Range<usize>,
    visit: &mut dyn FnMut(f32, f32),
) {
    let [nx, ny, _] = dims;
    // Of the four samples of a cell across x.
    let column = |x: usize, y: usize, z: usize| {
        let at = grid3::index([nx, ny], [x, y, z]);
        let four =
            [samples[at].raw(), samples[at + nx].raw(), samples[at + nx * ny].raw(), samples[at + nx * ny + nx].raw()];
        let low = four[0].min(four[1]).min(four[2].min(four[3]));
        (low, four[0].max(four[1]).max(four[2].max(four[3])))
    };
    for z in slabs {
        for y in 0..ny.saturating_sub(1) {
            let mut before = column(0, y, z);
            for x in 1..nx {
                let here = column(x, y, z);
                visit(before.0.min(here.0), before.1.max(here.1));
                before = here;
            }
        }
    }
}
