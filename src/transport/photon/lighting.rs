//! Radiance at the points of one surface from a photon map: `photon-direct`, beside [`super::super::direct()`].

use super::estimate::PhotonSearch;
use super::map::PhotonMap;
use super::tree::Nearest;
use crate::error::{Error, Result};
use crate::geom::{Direction, Frame, Normal};
use crate::level::{CellPoint, Counts, LevelField, Outcome, Pyramid, Start};
use crate::sampling::hash::key;
use crate::sampling::{DirectionalSource, PathSampler, warp};
use crate::transport::{REPLICATES, Radiance, SurfacePoint};
use crate::volume::{Sample, Volume, with_samples};
use glam::Vec3;
use rayon::prelude::*;

/// What is taken from the map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PhotonLight {
    /// All light. The map must hold all.
    All,
    /// Indirect light; direct light comes from rays to the whole environment. The map must hold indirect light alone.
    #[default]
    Indirect,
    /// Rays gather: what escapes brings direct light, what hits brings what the map says there. The map must hold all.
    FinalGather,
}

/// How radiance is read from a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotonLightSettings {
    /// What is taken from the map.
    pub light: PhotonLight,
    /// Rays for direct light and gathering: a power of two of at least 4, in four independent replicates.
    pub rays: u32,
    /// How photons are searched.
    pub search: PhotonSearch,
    /// Seed of the rays.
    pub seed: u64,
}

/// Exitant radiance at points of the isosurface `isovalue` (in the file's values) from a map, under the light and with the
/// albedo that the map was made with.
///
/// Standard errors are those of the rays and of the photons around each point. Photons are shared between points, and
/// between the rays of a final gather: that part of their noise is not in it.
///
/// # Errors
/// When the number of rays or neighbours is not as the settings say, or the map does not hold the light asked for.
pub fn photon_direct(
    volume: &Volume,
    pyramid: &Pyramid,
    isovalue: f64,
    points: &[SurfacePoint],
    light: &dyn DirectionalSource,
    map: &PhotonMap,
    settings: &PhotonLightSettings,
) -> Result<(Vec<Radiance>, Counts)> {
    if !settings.rays.is_power_of_two() || settings.rays < REPLICATES as u32 {
        return Err(Error::argument("rays", settings.rays, "a power of two, at least 4", "256 is a good reference"));
    }
    if settings.search.neighbours < 2 {
        return Err(Error::argument("neighbours", settings.search.neighbours, "at least 2", "128 is the default"));
    }
    let first = map.settings().first_bounce;
    if first != u32::from(settings.light == PhotonLight::Indirect) {
        let found = format!("one that holds light from {first} reflections on for {:?}", settings.light);
        return Err(Error::argument("photon map", found, "all light, or for Indirect from 1 on", "make another map"));
    }
    let found: Vec<(Radiance, Counts)> = with_samples!(volume.samples(), s => {
        let field = LevelField::new(volume, s, pyramid);
        let raw = volume.raw_from_value(isovalue);
        let reader = Reader { field: &field, raw, light, map, settings };
        points
            .par_iter()
            .enumerate()
            .map_init(Nearest::default, |nearest, (i, point)| {
                let mut counts = Counts::default();
                (reader.at_point(point, i as u64, nearest, &mut counts), counts)
            })
            .collect()
    });
    let mut counts = Counts::default();
    found.iter().for_each(|(_, c)| counts += *c);
    Ok((found.into_iter().map(|(radiance, _)| radiance).collect(), counts))
}

struct Reader<'a, 'v, T> {
    field: &'a LevelField<'v, T>,
    raw: f64,
    light: &'a dyn DirectionalSource,
    map: &'a PhotonMap,
    settings: &'a PhotonLightSettings,
}

impl<T: Sample> Reader<'_, '_, T> {
    fn at_point(&self, point: &SurfacePoint, item: u64, nearest: &mut Nearest, counts: &mut Counts) -> Radiance {
        let mut found = Radiance::default();
        let Some(normal) = Normal::down_gradient(-Vec3::from_array(point.normal)) else { return found };
        let at = self.field.locate(point.position_in_grid.map(f64::from));
        let how = self.settings.light;
        if how != PhotonLight::All {
            found = self.by_rays(&at, normal, item, nearest, counts);
        }
        if how != PhotonLight::FinalGather {
            let by_map = self.map.irradiance(self.field, &at, self.raw, normal, &self.settings.search, nearest);
            for c in 0..3 {
                let factor = self.reflected(c);
                found.mean[c] += factor * by_map.mean[c];
                let variance = found.stderr[c] * found.stderr[c] + factor * factor * by_map.variance[c];
                found.stderr[c] = variance.sqrt();
            }
        }
        found
    }

    /// ρ/π.
    fn reflected(&self, channel: usize) -> f64 {
        f64::from(self.map.settings().albedo[channel]) / std::f64::consts::PI
    }

    /// Direct light, and gathered light if it is asked for.
    fn by_rays(
        &self,
        at: &CellPoint,
        normal: Normal,
        item: u64,
        nearest: &mut Nearest,
        counts: &mut Counts,
    ) -> Radiance {
        let each = self.settings.rays / REPLICATES as u32;
        let mut means = [[0.0f64; 3]; REPLICATES];
        for (replicate, mean) in means.iter_mut().enumerate() {
            // Not the numbers of the reference by paths: the noise of the two must not hide their difference.
            let sampler = PathSampler::new(key(self.settings.seed, 0x7068_6f74), item, replicate as u32);
            for ray in 0..each {
                self.one_ray(at, normal, &sampler, ray, nearest, counts, mean);
            }
            for c in 0..3 {
                // Σ over rays of ρ/π · π · what a cosine-distributed ray brings.
                mean[c] *= f64::from(self.map.settings().albedo[c]) / f64::from(each);
            }
        }
        let n = REPLICATES as f64;
        let mut found = Radiance::default();
        for c in 0..3 {
            let mean = means.iter().map(|v| v[c]).sum::<f64>() / n;
            let square: f64 = means.iter().map(|v| (v[c] - mean).powi(2)).sum();
            (found.mean[c], found.stderr[c]) = (mean, (square / (n * (n - 1.0))).sqrt());
        }
        found
    }

    fn one_ray(
        &self,
        at: &CellPoint,
        normal: Normal,
        sampler: &PathSampler,
        ray: u32,
        nearest: &mut Nearest,
        counts: &mut Counts,
        sum: &mut [f64; 3],
    ) {
        let (isovalue, start) = (self.raw as f32, Start::on(*at));
        let mut add = |radiance: [f64; 3], factor: f64| (0..3).for_each(|c| sum[c] += radiance[c] * factor);
        let by_cosine = |towards: Vec3| f64::from(towards.dot(normal.vec()).max(0.0)) / std::f64::consts::PI;
        if let Some(sample) = self.light.sample(sampler.pair(ray, 0)) {
            let density = by_cosine(sample.direction.vec());
            let along = self.field.direction_in_grid(sample.direction.vec());
            if density > 0.0 && self.field.trace(isovalue, &start, along, counts) == Outcome::Escaped {
                // Balance heuristic, as in the reference by paths.
                add(sample.radiance.map(f64::from), density / (f64::from(sample.density) + density));
            }
        }
        let towards = Frame::around(normal).from_local(warp::square_to_cosine_hemisphere(sampler.pair(ray, 1)));
        let (there, normal_there) =
            match self.field.trace(isovalue, &start, self.field.direction_in_grid(towards), counts) {
                Outcome::Escaped => {
                    let density = by_cosine(towards);
                    if let (true, Some(direction)) = (density > 0.0, Direction::new(towards)) {
                        let radiance = self.light.radiance(direction).map(f64::from);
                        add(radiance, density / (density + f64::from(self.light.density(direction))));
                    }
                    return;
                }
                Outcome::Hit(hit) => (hit.at, self.field.normal(&hit.at)),
                Outcome::Lost => (*at, Some(normal)),
            };
        if self.settings.light != PhotonLight::FinalGather {
            return;
        }
        let Some(normal_there) = normal_there else { return };
        let found = self.map.irradiance(self.field, &there, self.raw, normal_there, &self.settings.search, nearest);
        add(std::array::from_fn(|c| self.reflected(c) * found.mean[c]), 1.0);
    }
}
