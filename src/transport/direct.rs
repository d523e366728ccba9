//! The reference without a texture: path tracing at each point of one surface under a given light.
//!
//! Exitant radiance of the Lambertian level set, L_o = ρ/π ∫ (V L + (1−V) L_o') (n·ω)⁺ dω, by paths that see only that
//! level set. Distant light is sampled in two ways, by the light's own density and by the cosine, combined by the
//! balance heuristic (Veach and Guibas 1995, eq. 9: multiple importance sampling), so that a small sun and a
//! bright sky both converge. Unbiased for any light and any number of bounces: long paths end by Russian roulette.
//!
//! It shares with the bake what both are defined by (level set, normals, the rule for rays lost in the solid) and
//! nothing else: no spherical harmonics, no layers, no lookup.

use super::REPLICATES;
use super::path::{Alive, continuation};
use crate::error::{Error, Result};
use crate::geom::{Frame, Normal};
use crate::level::{Counts, LevelField, Outcome, Pyramid, Start};
use crate::sampling::{DirectionalSource, PathSampler, warp};
use crate::volume::{Sample, Volume, with_samples};
use glam::Vec3;
use rayon::prelude::*;

/// A point of a surface at which radiance is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Where, in grid space; on the level set up to rounding.
    pub position_in_grid: [f32; 3],
    /// Unit normal in world axes, towards the lit side.
    pub normal: [f32; 3],
}

/// What the reference is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct DirectSettings {
    /// Paths per point and light: a power of two of at least 4, in four independent replicates.
    pub paths: u32,
    /// Diffuse reflectance of each channel, in [0, 1].
    pub albedo: [f32; 3],
    /// Seed of all random numbers.
    pub seed: u64,
}

/// Exitant radiance at a point, with its standard error, per channel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Radiance {
    /// Mean over the replicates.
    pub mean: [f64; 3],
    /// Standard error of the mean, three degrees of freedom.
    pub stderr: [f64; 3],
}

/// Bounces after which roulette begins: paths of up to so many hits are as long as they are.
const SURE_BOUNCES: u32 = 4;
/// A path of albedo 1 in a closed room would never end: after this many bounces it is cut.
const MOST_BOUNCES: u32 = 1024;
/// Pairs of random numbers of one bounce: the light, the cosine, the roulette.
const PAIRS: u32 = 3;

/// Radiance at `points` of the isosurface `isovalue` (in the file's values) under each of `lights`: one list a light, in
/// the order of the points. All lights share the paths, so that differences between two of them have little noise.
///
/// # Errors
/// When the number of paths or an albedo is not as [`DirectSettings`] says, or the volume has no cells.
pub fn direct(
    volume: &Volume,
    pyramid: &Pyramid,
    isovalue: f64,
    points: &[SurfacePoint],
    lights: &[&dyn DirectionalSource],
    settings: &DirectSettings,
) -> Result<(Vec<Vec<Radiance>>, Counts)> {
    if !settings.paths.is_power_of_two() || settings.paths < REPLICATES as u32 {
        return Err(Error::argument("paths", settings.paths, "a power of two, at least 4", "256 is a good reference"));
    }
    if !settings.albedo.iter().all(|a| (0.0..=1.0).contains(a)) {
        return Err(Error::argument("albedo", format!("{:?}", settings.albedo), "numbers from 0 to 1", "give less"));
    }
    volume.check_cells()?;
    let raw = volume.raw_from_value(isovalue) as f32;
    let per_point: Vec<(Vec<Radiance>, Counts)> = with_samples!(volume.samples(), s => {
        let field = LevelField::new(volume, s, pyramid);
        points
            .par_iter()
            .enumerate()
            .map(|(i, point)| {
                let mut counts = Counts::default();
                (at_point(&field, raw, point, i as u64, lights, settings, &mut counts), counts)
            })
            .collect()
    });
    let mut counts = Counts::default();
    per_point.iter().for_each(|(_, c)| counts += *c);
    let of_light = |l: usize| per_point.iter().map(|(found, _)| found[l]).collect();
    Ok(((0..lights.len()).map(of_light).collect(), counts))
}

fn at_point<T: Sample>(
    field: &LevelField<'_, T>,
    isovalue: f32,
    point: &SurfacePoint,
    item: u64,
    lights: &[&dyn DirectionalSource],
    settings: &DirectSettings,
    counts: &mut Counts,
) -> Vec<Radiance> {
    let Some(normal) = Normal::down_gradient(-Vec3::from_array(point.normal)) else {
        return vec![Radiance::default(); lights.len()];
    };
    let start = Start::on(field.locate(point.position_in_grid.map(f64::from)));
    let each = settings.paths / REPLICATES as u32;
    let mut means = vec![[[0.0f64; 3]; REPLICATES]; lights.len()];
    for replicate in 0..REPLICATES {
        let sampler = PathSampler::new(settings.seed, item, replicate as u32);
        let mut sums = vec![[0.0f64; 3]; lights.len()];
        for path in 0..each {
            let alive = Alive { point: path, start, normal };
            one_path(field, isovalue, alive, &sampler, lights, settings, counts, &mut sums);
        }
        for (mean, sum) in means.iter_mut().zip(&sums) {
            mean[replicate] = sum.map(|v| v / f64::from(each));
        }
    }
    means.iter().map(over_replicates).collect()
}

fn over_replicates(values: &[[f64; 3]; REPLICATES]) -> Radiance {
    let n = REPLICATES as f64;
    let mut found = Radiance::default();
    for c in 0..3 {
        let mean = values.iter().map(|v| v[c]).sum::<f64>() / n;
        let square: f64 = values.iter().map(|v| (v[c] - mean).powi(2)).sum();
        (found.mean[c], found.stderr[c]) = (mean, (square / (n * (n - 1.0))).sqrt());
    }
    found
}

/// Adds what one path brings from each light.
fn one_path<T: Sample>(
    field: &LevelField<'_, T>,
    isovalue: f32,
    mut alive: Alive,
    sampler: &PathSampler,
    lights: &[&dyn DirectionalSource],
    settings: &DirectSettings,
    counts: &mut Counts,
    sums: &mut [[f64; 3]],
) {
    let path = alive.point;
    let mut power = [1.0f64; 3];
    for bounce in 0..MOST_BOUNCES {
        for c in 0..3 {
            power[c] *= f64::from(settings.albedo[c]);
        }
        let at_light = sampler.pair(path, PAIRS * bounce);
        for (light, sum) in lights.iter().zip(sums.iter_mut()) {
            let Some(sample) = light.sample(at_light) else { continue };
            let cosine = sample.direction.vec().dot(alive.normal.vec());
            if cosine <= 0.0 {
                continue;
            }
            let along = field.direction_in_grid(sample.direction.vec());
            if field.trace(isovalue, &alive.start, along, counts) == Outcome::Escaped {
                let by_cosine = f64::from(cosine) / std::f64::consts::PI;
                // cosine/π · L / p_light, weighted by p_light / (p_light + p_cosine).
                let factor = by_cosine / (f64::from(sample.density) + by_cosine);
                add(sum, &power, sample.radiance, factor);
            }
        }
        let local = warp::square_to_cosine_hemisphere(sampler.pair(path, PAIRS * bounce + 1));
        let towards = Frame::around(alive.normal).from_local(local);
        let outcome = field.trace(isovalue, &alive.start, field.direction_in_grid(towards), counts);
        if outcome == Outcome::Escaped {
            let Some(direction) = crate::geom::Direction::new(towards) else { return };
            let by_cosine = f64::from(towards.dot(alive.normal.vec()).max(0.0)) / std::f64::consts::PI;
            for (light, sum) in lights.iter().zip(sums.iter_mut()) {
                let by_light = f64::from(light.density(direction));
                if by_cosine > 0.0 {
                    add(sum, &power, light.radiance(direction), by_cosine / (by_cosine + by_light));
                }
            }
            return;
        }
        let Some(next) = continuation(field, &alive, outcome) else { return };
        alive = next;
        if bounce >= SURE_BOUNCES {
            let survive = f64::from(settings.albedo.iter().copied().fold(0.0, f32::max)).min(0.95);
            if f64::from(sampler.pair(path, PAIRS * bounce + 2)[0]) >= survive {
                return;
            }
            power = power.map(|p| p / survive);
        }
    }
}

fn add(sum: &mut [f64; 3], power: &[f64; 3], radiance: [f32; 3], factor: f64) {
    for c in 0..3 {
        sum[c] += power[c] * f64::from(radiance[c]) * factor;
    }
}
