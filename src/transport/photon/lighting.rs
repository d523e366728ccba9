//! Radiance at the points of one surface from a photon map: `photon-direct`, beside [`super::super::direct()`].
//!
//! Rays bring direct light, from luminaires and the environment, each sampled by itself and by the cosine (balance heuristic:
//! Veach and Guibas 1995, eq. 9); the map brings what was reflected before, and what came by way of mirrors and glass alone. With
//! a final gather rays go on through walls, until they meet a level set whose photons say how bright it is.

use super::estimate::{Irradiance, Kind, PhotonSearch};
use super::map::{Kept, PhotonMap, PhotonScene};
use super::tree::Nearest;
use crate::error::{Error, Result};
use crate::geom::{Direction, Frame, Normal};
use crate::level::{CellPoint, Counts, LevelField, Start};
use crate::sampling::hash::key;
use crate::sampling::{DirectionalSource, PathSampler, warp};
use crate::scene::geometry::{Finish, Geometry};
use crate::transport::scene_path::{Isovalues, Met, Origin, Place, SceneCounts, World, glass, specular_chain};
use crate::transport::{REPLICATES, Radiance, SurfacePoint};
use crate::volume::{Sample, with_samples};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::f64::consts::PI;

/// What is taken from the map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PhotonLight {
    /// All light. The map must hold all.
    All,
    /// Indirect light; direct light comes from rays to luminaires and the whole environment. The map must hold indirect light
    /// alone.
    #[default]
    Indirect,
    /// Rays gather: what escapes brings direct light, what hits brings what the map says there. The map must hold all.
    FinalGather,
}

impl PhotonLight {
    /// What the map must hold.
    pub fn kept(self) -> Kept {
        match self {
            Self::Indirect => Kept::Indirect,
            Self::All | Self::FinalGather => Kept::All,
        }
    }
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
    /// How photons of light by way of mirrors and glass alone are searched.
    pub caustics: PhotonSearch,
    /// Seed of the rays.
    pub seed: u64,
}

/// Refuses places and isovalues that are no numbers: a ray from there would never end.
fn check_places(isovalue: f64, points: &[SurfacePoint]) -> Result<()> {
    if !isovalue.is_finite() {
        return Err(Error::argument("isovalue", isovalue, "a finite number", "give one in the file's values"));
    }
    match points.iter().position(|p| !p.position_in_grid.iter().all(|v| v.is_finite())) {
        None => Ok(()),
        Some(i) => {
            let found = format!("{:?} for point {i}", points[i].position_in_grid);
            Err(Error::argument("points", found, "finite coordinates in grid space", "leave such points out"))
        }
    }
}

impl PhotonLightSettings {
    fn check(&self, map: &PhotonMap) -> Result<()> {
        if !self.rays.is_power_of_two() || self.rays < REPLICATES as u32 {
            return Err(Error::argument("rays", self.rays, "a power of two, at least 4", "256 is a good reference"));
        }
        for search in [&self.search, &self.caustics] {
            if search.neighbours < 2 {
                return Err(Error::argument("neighbours", search.neighbours, "at least 2", "128 is the default"));
            }
            if !(search.most_radius.is_finite() && search.most_radius > 0.0) {
                let (found, expected) = (search.most_radius, "a positive number of diagonals");
                return Err(Error::argument("most_radius", found, expected, "0.1 is the default"));
            }
        }
        let kept = map.settings().kept;
        if kept != self.light.kept() {
            let found = format!("{kept:?} for {:?}", self.light);
            return Err(Error::argument("photon map", found, format!("{:?}", self.light.kept()), "make another map"));
        }
        Ok(())
    }
}

/// Exitant radiance at points of the isosurface `isovalue` (in the file's values) from a map of the scene, with the albedo and the
/// power of luminaires that the map was made with; and the work of the rays.
///
/// Standard errors are those of the rays and of the photons around each point. Photons are shared between points, and
/// between the rays of a final gather: that part of their noise is not in it.
///
/// # Errors
/// When the number of rays or neighbours is not as the settings say, the map does not hold the light asked for or is of another
/// scene, or a point or the isovalue is no number.
pub fn photon_direct(
    scene: &PhotonScene<'_>,
    isovalue: f64,
    points: &[SurfacePoint],
    map: &PhotonMap,
    settings: &PhotonLightSettings,
) -> Result<(Vec<Radiance>, SceneCounts)> {
    settings.check(map)?;
    check_places(isovalue, points)?;
    if !map.is_of(scene) {
        let remedy = "send photons out in the scene that they are read in";
        return Err(Error::argument(
            "photon map",
            "that of another scene",
            "one of this volume and these walls",
            remedy,
        ));
    }
    let nothing = Geometry::new(Vec::new(), Vec::new(), 1.0)?;
    let volume = scene.volume;
    let found: Vec<(Radiance, SceneCounts)> = with_samples!(volume.samples(), s => {
        let field = LevelField::new(volume, s, scene.pyramid);
        let world = World::new(volume, &field, scene.geometry.unwrap_or(&nothing));
        let raw = volume.raw_from_value(isovalue);
        let isovalues = world.isovalues(raw as f32);
        let reader = Reader { world, isovalues, raw, light: scene.light, map, settings };
        points
            .par_iter()
            .enumerate()
            .map_init(Nearest::default, |nearest, (i, point)| {
                let mut counts = SceneCounts::default();
                (reader.at_point(point, i as u64, nearest, &mut counts), counts)
            })
            .collect()
    });
    let mut counts = SceneCounts::default();
    found.iter().for_each(|(_, c)| counts += *c);
    Ok((found.into_iter().map(|(radiance, _)| radiance).collect(), counts))
}

struct Reader<'a, T> {
    world: World<'a, T>,
    isovalues: Isovalues,
    raw: f64,
    light: Option<&'a dyn DirectionalSource>,
    map: &'a PhotonMap,
    settings: &'a PhotonLightSettings,
}

/// Turns of a gathering ray at walls and other volumes after which it is given up.
const MOST_TURNS: u32 = 512;
/// Turns after which roulette begins.
const SURE_TURNS: u32 = 3;

/// What a gathering ray carries.
struct Gathering<'s> {
    sampler: &'s PathSampler,
    ray: u32,
    weight: [f64; 3],
    sum: [f64; 3],
    counts: SceneCounts,
}

impl Gathering<'_> {
    fn add(&mut self, light: [f64; 3], factor: f64) {
        (0..3).for_each(|c| self.sum[c] += self.weight[c] * light[c] * factor);
    }
}

/// A place where a gathering ray turns.
type Turn = (Origin, Normal);

impl<T: Sample> Reader<'_, T> {
    fn at_point(&self, point: &SurfacePoint, item: u64, nearest: &mut Nearest, counts: &mut SceneCounts) -> Radiance {
        let mut found = Radiance::default();
        let Some(normal) = Normal::down_gradient(-Vec3::from_array(point.normal)) else { return found };
        let at = self.world.field.locate(point.position_in_grid.map(f64::from));
        let how = self.settings.light;
        if how != PhotonLight::All {
            found = self.by_rays(&at, normal, item, nearest, counts);
        }
        let kinds = if how == PhotonLight::FinalGather { &[Kind::Caustic][..] } else { &[Kind::Caustic, Kind::Usual] };
        for &kind in kinds {
            let by_map = self.irradiance(&at, normal, kind, nearest);
            for c in 0..3 {
                let factor = self.reflected(c);
                found.mean[c] += factor * by_map.mean[c];
                let variance = found.stderr[c] * found.stderr[c] + factor * factor * by_map.variance[c];
                found.stderr[c] = variance.sqrt();
            }
        }
        found
    }

    fn irradiance(&self, at: &CellPoint, normal: Normal, kind: Kind, nearest: &mut Nearest) -> Irradiance {
        let search = match kind {
            Kind::Usual => &self.settings.search,
            Kind::Caustic => &self.settings.caustics,
        };
        self.map.irradiance(self.world.field, at, self.raw, normal, kind, search, nearest)
    }

    /// Albedo of a level set.
    fn albedo(&self, set: usize) -> [f64; 3] {
        let tint = self.world.tint(set);
        std::array::from_fn(|c| f64::from(self.map.settings().albedo[c] * tint[c]))
    }

    /// ρ/π of the volume's level set.
    fn reflected(&self, channel: usize) -> f64 {
        self.albedo(0)[channel] / PI
    }

    /// Direct light, and gathered light if it is asked for.
    fn by_rays(
        &self,
        at: &CellPoint,
        normal: Normal,
        item: u64,
        nearest: &mut Nearest,
        counts: &mut SceneCounts,
    ) -> Radiance {
        let each = self.settings.rays / REPLICATES as u32;
        let first = (self.world.on_level(0, Start::on(*at)), normal);
        let of_replicate = |replicate: usize| {
            // Not the numbers of the reference by paths: the noise of the two must not hide their difference.
            let sampler = &PathSampler::new(key(self.settings.seed, 0x7068_6f74), item, replicate as u32);
            let (weight, sum) = (self.albedo(0), [0.0; 3]);
            let mut ray = Gathering { sampler, ray: 0, weight, sum, counts: SceneCounts::default() };
            for index in 0..each {
                (ray.ray, ray.weight) = (index, weight);
                self.gather(first, &mut ray, nearest);
            }
            *counts += ray.counts;
            ray.sum
        };
        Radiance::of_replicates(&std::array::from_fn(of_replicate), each)
    }

    /// Adds what one ray from a point of the level set brings, and what was sampled where it turned.
    fn gather(&self, first: Turn, ray: &mut Gathering<'_>, nearest: &mut Nearest) {
        let gathers = self.settings.light == PhotonLight::FinalGather;
        let pairs = 3 + self.world.geometry.luminaires().len() as u32;
        let mut here = first;
        for turn in 0..MOST_TURNS {
            let variates = |which: u32| ray.sampler.pair(ray.ray, pairs * turn + which);
            let (local, of_environment, roulette) = (variates(0), variates(1), variates(2)[0]);
            for l in 0..self.world.geometry.luminaires().len() {
                let u = ray.sampler.pair(ray.ray, pairs * turn + 3 + l as u32);
                self.sample_luminaire(l, &here, u, ray);
            }
            self.sample_environment(&here, of_environment, ray);
            let towards = Frame::around(here.1).from_local(warp::square_to_cosine_hemisphere(local));
            let Some((place, normal, albedo)) = self.next(turn, &here, towards, gathers, ray, nearest) else { return };
            (0..3).for_each(|c| ray.weight[c] *= albedo[c]);
            let largest = ray.weight.into_iter().fold(0.0, f64::max);
            if turn >= SURE_TURNS {
                let survive = largest.min(0.95);
                if f64::from(roulette) >= survive {
                    return;
                }
                ray.weight = ray.weight.map(|w| w / survive);
            }
            if largest <= 0.0 {
                return;
            }
            here = (place, normal);
        }
        ray.counts.lost_turns += 1;
    }

    /// Follows a ray to the next place from which it goes on diffusely; none where it ends, with what it saw there.
    fn next(
        &self,
        turn: u32,
        here: &Turn,
        towards: Vec3,
        gathers: bool,
        ray: &mut Gathering<'_>,
        nearest: &mut Nearest,
    ) -> Option<(Origin, Normal, [f64; 3])> {
        let level = &mut Counts::default();
        let mut direction = towards.as_dvec3().normalize_or(DVec3::Z);
        let by_cosine = direction.dot(here.1.vec().as_dvec3()).max(0.0) / PI;
        // Share of light that the ray itself finds, beside what is sampled at `here`; after mirrors and glass it alone finds it,
        // but that of the first place is in the map of caustics.
        let mut sampled = Some(by_cosine);
        let mut origin = here.0;
        let share = |sampled: Option<f64>, density: f64| match sampled {
            Some(by_cosine) if by_cosine > 0.0 => by_cosine / (by_cosine + density),
            Some(_) => 0.0,
            None => f64::from(u8::from(turn > 0)),
        };
        for in_a_row in 0..specular_chain::MOST {
            match self.world.meet(&self.isovalues, &origin, direction, level, &mut ray.counts) {
                Met::Nothing => {
                    self.world.geometry.each_distant(direction, &mut |l, radiance, density| {
                        ray.add(self.scaled(l, radiance), share(sampled, density));
                    });
                    if let (Some(light), Some(to)) = (self.light, Direction::new(direction.as_vec3())) {
                        let share = share(sampled, f64::from(light.density(to)));
                        ray.add(light.radiance(to).map(f64::from), share);
                    }
                    return None;
                }
                Met::Cut(_) => return None,
                Met::Luminaire(hit) => {
                    let point = origin.in_world + hit.distance * direction;
                    let cosine = self.world.geometry.light_cosine(hit.luminaire, point, direction);
                    let density =
                        self.world.geometry.light_density(hit.luminaire, origin.in_world, hit.distance, cosine);
                    ray.add(self.scaled(hit.luminaire, hit.radiance), share(sampled, density));
                    return None;
                }
                Met::Lost => {
                    // It meets the level set where it starts.
                    if let (true, Place::Level(0, start)) = (gathers, origin.place) {
                        let normal = self.world.field.normal(&start.at)?;
                        self.read(&start.at, normal, ray, nearest);
                    }
                    return None;
                }
                Met::Level(set, cell) => {
                    let normal = self.world.normal(set, &cell)?;
                    if !gathers {
                        return None;
                    }
                    if set == 0 {
                        self.read(&cell, self.world.smoothed_normal(0, &cell).unwrap_or(normal), ray, nearest);
                        return None;
                    }
                    return Some((self.world.on_level(set, Start::on(cell)), normal, self.albedo(set)));
                }
                Met::Wall(hit) => {
                    let point = origin.in_world + hit.distance * direction;
                    let cosine = -direction.dot(hit.normal);
                    if let Some(l) = hit.luminaire.filter(|_| cosine > 0.0) {
                        let density = self.world.geometry.light_density(l, origin.in_world, hit.distance, cosine);
                        ray.add(self.scaled(l, self.world.geometry.wall_radiance(l)), share(sampled, density));
                    }
                    let place = Origin { place: Place::Wall(hit.part), in_world: point };
                    if !gathers {
                        return None;
                    }
                    let pair = specular_chain::pair(turn, in_a_row);
                    let u = f64::from(ray.sampler.pair(ray.ray, pair)[0]);
                    match hit.finish {
                        Finish::Diffuse(albedo) => {
                            let towards = if cosine > 0.0 { hit.normal } else { -hit.normal };
                            let normal = Normal::down_gradient(-towards.as_vec3())?;
                            return Some((place, normal, albedo.map(f64::from)));
                        }
                        Finish::Mirror(reflected) => {
                            let survival = specular_chain::survival(in_a_row, reflected);
                            if u >= survival {
                                return None;
                            }
                            direction -= 2.0 * direction.dot(hit.normal) * hit.normal;
                            (0..3).for_each(|c| ray.weight[c] *= f64::from(reflected[c]) / survival);
                        }
                        Finish::Glass(index) => {
                            let (next, factor) = glass::turn(direction, hit.normal, index, u);
                            direction = next;
                            ray.weight = ray.weight.map(|w| w * factor);
                        }
                    }
                    (origin, sampled) = (place, None);
                }
            }
        }
        ray.counts.lost_specular += 1;
        None
    }

    /// Adds what leaves a place of the level set.
    fn read(&self, at: &CellPoint, normal: Normal, ray: &mut Gathering<'_>, nearest: &mut Nearest) {
        for kind in [Kind::Usual, Kind::Caustic] {
            let found = self.irradiance(at, normal, kind, nearest);
            ray.add(std::array::from_fn(|c| self.reflected(c) * found.mean[c]), 1.0);
        }
    }

    /// Light of a luminaire with the factor on its power.
    fn scaled(&self, l: usize, light: [f64; 3]) -> [f64; 3] {
        let scale = self.map.settings().scale(l);
        std::array::from_fn(|c| light[c] * scale[c])
    }

    fn sample_luminaire(&self, l: usize, (place, normal): &Turn, u: [f32; 2], ray: &mut Gathering<'_>) {
        let Some(light) = self.world.geometry.arriving(l, place.in_world, u) else { return };
        let cosine = light.direction.dot(normal.vec().as_dvec3());
        let level = &mut Counts::default();
        if cosine <= 0.0
            || !self.world.sees(
                &self.isovalues,
                place,
                Some(l),
                light.direction,
                light.distance,
                level,
                &mut ray.counts,
            )
        {
            return;
        }
        let by_cosine = cosine / PI;
        let share = light.density.map_or(1.0, |density| density / (density + by_cosine));
        ray.add(self.scaled(l, light.value), by_cosine * share);
    }

    fn sample_environment(&self, (place, normal): &Turn, u: [f32; 2], ray: &mut Gathering<'_>) {
        let Some(sample) = self.light.and_then(|light| light.sample(u)) else { return };
        let cosine = f64::from(sample.direction.vec().dot(normal.vec()));
        if cosine <= 0.0 {
            return;
        }
        let direction = sample.direction.vec().as_dvec3().normalize_or(DVec3::Z);
        let level = &mut Counts::default();
        if self.world.sees(&self.isovalues, place, None, direction, f64::INFINITY, level, &mut ray.counts) {
            let by_cosine = cosine / PI;
            ray.add(sample.radiance.map(f64::from), by_cosine / (f64::from(sample.density) + by_cosine));
        }
    }
}
