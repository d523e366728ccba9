//! The answer of the store against direct results on the same surface, and why they differ.
//!
//! # The chain
//! From the truth to what a user sees, one approximation at a time, all at the same points:
//!
//! 1. paths under the whole light ([`crate::transport::direct`]: no texture, no spherical harmonics);
//! 2. the same paths under the light cut to the bands of the store: the difference is *truncation*;
//! 3. texels baked with many rays, interpolated: *texture*, which holds the interpolation between texels, the layers' own
//!    band limits, and the tail beyond the last layer;
//! 4. texels baked as the store's were, before rounding: *noise* of the bake (for `gather` its bias, too);
//! 5. the store itself, through contraction and lookup: *rounding*.
//!
//! Ahead of them stands the surface itself, where it is asked for ([`compare_geometry`]): paths about the normals of the
//! trilinear field instead of smoothed ones; the difference is *normals*.
//!
//! Mean squares of the differences do not add up to that of the whole, since neighbours in the chain may be correlated;
//! what is missing is a row of its own, so that the rows sum to the total.

mod apart;
mod geometry;
mod lamps;
mod photon;
pub mod picture;
mod rows;
pub(crate) mod slow;
mod subject;
mod surface;

#[cfg(test)]
mod tests;

pub use apart::Apart;
pub use geometry::{GeometryComparison, check_geometry, compare_geometry};
pub use photon::{PhotonComparison, PhotonQuestion, compare_photons};
pub use rows::{Against, Asked, Compared};
pub use subject::{Subject, subjects};
pub(crate) use surface::Texels;
pub use surface::{LitSurface, Vertices, unburied};

use crate::error::Result;
use crate::geom::Direction;
use crate::relight::{LookupReport, TotalError};
use crate::render::Lamps;
use crate::sampling::{DirectionSample, DirectionalSource};
use crate::sh::{self, Coefficients};
use crate::transfer::BrickSource;
use crate::transport::{Radiance, Settings};
use apart::{add, mean};
use serde::Serialize;

/// What is compared.
#[derive(Clone, Copy)]
pub struct Question<'a> {
    /// The surface, where it is looked at, and its light.
    pub surface: LitSurface<'a>,
    /// The baked textures, one a group in the order of [`crate::transport::Bake::groups`]: for a volume alone one.
    pub textures: &'a [&'a dyn BrickSource],
    /// How they were baked: seed, positive, layers; `None` if not by `path`, so that texels cannot be made again.
    pub baked_by: Option<&'a Settings>,
    /// Lamps that are lit apart; else the whole light is cut to the bands.
    pub apart: Option<Apart<'a>>,
    /// Paths at each point.
    pub paths: u32,
    /// Paths for each texel of the third link of the chain.
    pub texel_rays: u32,
    /// Seed of the references.
    pub seed: u64,
}

/// One number with half of its 95 % interval, from the spread over the points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Figure {
    /// The estimate.
    pub value: f64,
    /// Half of the interval.
    #[serde(rename = "half_interval_95")]
    pub half_interval: f64,
}

impl Figure {
    /// The standard error, over many points.
    pub fn standard_error(&self) -> f64 {
        self.half_interval / 1.96
    }
}

/// How far the store is from the reference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Distance {
    /// Root mean square of the difference of linear radiance, channels together, over the mean of the reference.
    pub relative_rms: Figure,
    /// The same without the noise of the reference.
    pub relative_rms_without_noise: f64,
    /// Mean of the difference over the mean of the reference.
    pub bias: Figure,
    /// 95th percentile and maximum of the largest difference of any channel, over the mean of the reference.
    pub percentile_95: f64,
    /// See `percentile_95`.
    pub maximum: f64,
    /// Root mean square in percent of white after the reference's exposure, both clamped to [0, 1] (the measure of
    /// Beason 2005).
    pub rms_percent: f64,
}

/// The row of what the others miss.
const CROSS_TERMS: &str = "cross terms";

/// One approximation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BudgetRow {
    /// normals (of [`compare_geometry`]), truncation, texture, noise, rounding, cross terms.
    pub name: &'static str,
    /// Mean square over the points and channels, over the squared mean of the reference; negative only for the cross
    /// terms.
    pub mean_square: f64,
}

/// The answer.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Comparison {
    /// Mean radiance of the reference.
    pub mean: f64,
    /// The store against paths under the whole light.
    pub whole: Distance,
    /// The store against paths under the light cut to its bands.
    pub band_limited: Distance,
    /// The rows; they sum to the mean square of the whole difference.
    pub budget: Vec<BudgetRow>,
    /// Root mean square of the standard error of the reference, over its mean; it is in the first rows.
    pub reference_noise: f64,
    /// How the lookups went.
    pub lookups: LookupReport,
    /// Rays of the references.
    pub rays: u64,
    /// Radiance at each point by the store and by paths under the whole light.
    pub at_points: Vec<[[f64; 3]; 2]>,
    /// Standard errors of the latter.
    pub reference_errors: Vec<[f64; 3]>,
}

/// What relight says of its error, and whether it holds at the points.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Stated {
    /// [`TotalError::rms`], over the mean radiance.
    pub rms: f64,
    /// [`TotalError::percentile_95`], over the mean radiance.
    pub percentile_95: f64,
    /// Share of the channels of the points that are off by no more than `percentile_95`, and what 95 % of the noise of the reference
    /// add to it in quadrature: 95 % if what is said is right.
    pub covered: f64,
}

impl Comparison {
    /// How what relight says of its error holds; `mean`: the mean radiance of the surface.
    pub fn stated(&self, error: &TotalError, mean: f64) -> Stated {
        let most = error.percentile_95 * mean;
        let each = self.at_points.iter().zip(&self.reference_errors);
        let is_within = |([stored, truth], s): (&[[f64; 3]; 2], &[f64; 3]), c: usize| {
            (stored[c] - truth[c]).abs() <= (most * most + (1.96 * s[c]).powi(2)).sqrt()
        };
        let within = each.map(|point| (0..3).filter(|&c| is_within(point, c)).count()).sum::<usize>();
        let covered = within as f64 / (3 * self.at_points.len()).max(1) as f64;
        Stated { rms: error.rms, percentile_95: error.percentile_95, covered }
    }
}

/// Light of a band limit: what its coefficients say, negative lobes included. Not sampled: it is smooth.
pub struct BandLimited<'a>(pub &'a [Coefficients; 3]);

impl DirectionalSource for BandLimited<'_> {
    fn sample(&self, _: [f32; 2]) -> Option<DirectionSample> {
        None
    }

    fn density(&self, _: Direction) -> f32 {
        0.0
    }

    fn radiance(&self, direction: Direction) -> [f32; 3] {
        let mut basis = [0.0f32; sh::MAX_BANDS * sh::MAX_BANDS];
        sh::basis::evaluate_f32(self.0[0].bands(), direction.vec(), &mut basis);
        std::array::from_fn(|c| self.0[c].values().iter().zip(&basis).map(|(&l, &y)| l as f32 * y).sum())
    }
}

/// Compares.
///
/// # Errors
/// When there are no points, a texel that a lookup needs was not baked, or as [`crate::transport::direct`] and the
/// textures.
pub fn compare(question: &Question<'_>) -> Result<Comparison> {
    let (q, surface) = (question, &question.surface);
    surface.check()?;
    let limited = BandLimited(surface.coefficients);
    let darkness = Lamps::new(&[], None);
    let with_suns = q.apart.as_ref().map(|apart| (apart.with_bands(), apart.source));
    let lights: Vec<&dyn DirectionalSource> = match &with_suns {
        // The last is what luminaires and the surface's own emission bring.
        Some((bands_and_suns, suns)) => vec![surface.light, bands_and_suns, *suns, &darkness],
        None => vec![surface.light, &limited],
    };
    let (references, rays) = surface.by_paths(&lights, q.paths, q.seed)?;
    let mean_of = |l: usize| references[l].iter().map(|r| r.mean).collect::<Vec<_>>();
    let (whole, cut) = (mean_of(0), mean_of(1));
    let (mut stored, lookups) = in_bands(q)?;
    let [mut fine, mut again] = slow::interpolated(q, &stored)?;
    if let Some(apart) = &q.apart {
        // Of relight the noise of rays and paths is in the row of noise.
        let of_suns =
            mean_of(2).into_iter().zip(mean_of(3)).map(|(suns, others)| [0, 1, 2].map(|c| suns[c] - others[c]));
        add(&mut fine, &of_suns.collect::<Vec<_>>());
        let as_relight = apart.radiance(surface, mean(&stored))?;
        add(&mut again, &as_relight);
        add(&mut stored, &as_relight);
    }
    let links = [&whole, &cut, &fine, &again, &stored];
    let mean = mean(&whole);
    let noise = |references: &[Radiance]| {
        references.iter().flat_map(|r| r.stderr).map(|e| e * e).sum::<f64>() / (3 * references.len()) as f64
    };
    Ok(Comparison {
        mean,
        whole: distance(&stored, &whole, noise(&references[0])),
        band_limited: distance(&stored, &cut, noise(&references[1])),
        budget: budget(&links, mean, q.baked_by.is_some()),
        reference_noise: if mean > 0.0 { noise(&references[0]).sqrt() / mean } else { 0.0 },
        lookups,
        rays,
        at_points: stored.iter().zip(&whole).map(|(s, w)| [*s, *w]).collect(),
        reference_errors: references[0].iter().map(|r| r.stderr).collect(),
    })
}

/// What a user gets: radiance at the points of the question from its textures, through contraction and lookup.
///
/// # Errors
/// As the textures; an albedo that is none; a texel that was never baked.
pub fn by_store(q: &Question<'_>) -> Result<(Vec<[f64; 3]>, LookupReport)> {
    let (mut stored, lookups) = in_bands(q)?;
    if let Some(apart) = &q.apart {
        let suns = apart.radiance(&q.surface, mean(&stored))?;
        add(&mut stored, &suns);
    }
    Ok((stored, lookups))
}

/// The same without lamps that are lit apart.
fn in_bands(q: &Question<'_>) -> Result<(Vec<[f64; 3]>, LookupReport)> {
    q.surface.by_textures(q.textures, q.bands())
}

impl Question<'_> {
    /// The light that the transfer is multiplied with.
    fn bands(&self) -> &[Coefficients; 3] {
        self.apart.map_or(self.surface.coefficients, |apart| apart.rest)
    }
}

/// Mean square of the difference over points and channels.
pub(crate) fn mean_square(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    let squares = a.iter().zip(b).flat_map(|(a, b)| (0..3).map(|c| (a[c] - b[c]).powi(2)));
    squares.sum::<f64>() / (3 * a.len()) as f64
}

fn budget(links: &[&Vec<[f64; 3]>; 5], mean: f64, is_path: bool) -> Vec<BudgetRow> {
    let names = ["truncation", "texture", "noise", "rounding"];
    let over = |value: f64| if mean != 0.0 { value / (mean * mean) } else { 0.0 };
    let mut rows: Vec<BudgetRow> =
        (0..4).map(|i| BudgetRow { name: names[i], mean_square: over(mean_square(links[i + 1], links[i])) }).collect();
    if !is_path {
        // Its texels could not be made again: the last two links are one.
        rows[2] =
            BudgetRow { name: "noise, bias and rounding", mean_square: rows[2].mean_square + rows[3].mean_square };
        rows.pop();
    }
    let sum: f64 = rows.iter().map(|r| r.mean_square).sum();
    rows.push(BudgetRow { name: CROSS_TERMS, mean_square: over(mean_square(links[4], links[0])) - sum });
    rows
}

/// How far `found` is from a reference with this mean square of its own standard error.
pub(crate) fn distance(found: &[[f64; 3]], reference: &[[f64; 3]], noise: f64) -> Distance {
    let n = found.len() as f64;
    let mean = reference.iter().flatten().sum::<f64>() / (3.0 * n);
    if mean <= 0.0 {
        return Distance::default();
    }
    let spread = |values: &[f64]| {
        let mean = values.iter().sum::<f64>() / n;
        let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
        // Many points: the normal quantile.
        (mean, 1.96 * (square / (n * (n - 1.0).max(1.0))).sqrt())
    };
    let differences = || found.iter().zip(reference).map(|(a, b)| -> [f64; 3] { std::array::from_fn(|c| a[c] - b[c]) });
    let squares: Vec<f64> = differences().map(|d| d.iter().map(|v| v * v).sum::<f64>() / 3.0).collect();
    let (square, square_half) = spread(&squares);
    let rms = square.sqrt();
    let (bias, bias_half) = spread(&differences().map(|d| d.iter().sum::<f64>() / 3.0).collect::<Vec<_>>());
    let mut largest: Vec<f64> = differences().map(|d| d.iter().fold(0.0f64, |m, v| m.max(v.abs()))).collect();
    largest.sort_by(f64::total_cmp);
    let mut brightest: Vec<f64> = reference.iter().map(|v| v.iter().copied().fold(0.0, f64::max)).collect();
    brightest.sort_by(f64::total_cmp);
    let rank = |q: f64| ((n - 1.0) * q).round() as usize;
    let white = brightest[rank(0.99)].max(f64::MIN_POSITIVE);
    let shown = |v: f64| (v / white).clamp(0.0, 1.0);
    let clamped = found.iter().zip(reference).flat_map(|(a, b)| (0..3).map(|c| (shown(a[c]) - shown(b[c])).powi(2)));
    Distance {
        relative_rms: Figure {
            value: rms / mean,
            // d sqrt(q) = dq / (2 sqrt(q)).
            half_interval: if rms > 0.0 { square_half / (2.0 * rms * mean) } else { 0.0 },
        },
        relative_rms_without_noise: (square - noise).max(0.0).sqrt() / mean,
        bias: Figure { value: bias / mean, half_interval: bias_half / mean },
        percentile_95: largest[rank(0.95)] / mean,
        maximum: largest[rank(1.0)] / mean,
        rms_percent: 100.0 * (clamped.sum::<f64>() / (3.0 * n)).sqrt(),
    }
}
