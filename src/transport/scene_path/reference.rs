//! Radiance along rays through a scene and from points of a surface, by path tracing of the whole light transport: the
//! reference of the transfer. A volume alone is a scene with nothing around it.
//!
//! It shares with the bake what a ray meets and nothing else: no layers, no harmonics, no texture. Luminaires are
//! sampled at every diffuse turn and not counted where a path happens on them after it; or, as a slow twin, they are
//! found only so. Distant light is sampled in two ways, by the light's own density and by the cosine, combined by the
//! balance heuristic (Veach and Guibas 1995, eq. 9: multiple importance sampling), so that a small sun and a bright sky
//! both converge. Unbiased for any light and any number of bounces: long paths end by Russian roulette.

use super::super::REPLICATES;
use super::super::direct::Radiance;
use super::glass;
use super::images::Images;
use super::scatter::{InMedia, Scatter};
use super::specular_chain;
use super::world::{Isovalues, Met, Origin, Place, SceneCounts, World};
use crate::error::{Error, Result};
use crate::geom::{Direction, Normal};
use crate::level::{CellPoint, Counts, LevelField, Pyramid, Start};
use crate::sampling::{DirectionalSource, PathSampler};
use crate::scene::geometry::{Finish, Geometry};
use crate::volume::{Sample, Volume, with_samples};
use glam::DVec3;
use rayon::prelude::*;

/// What the reference is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneReference {
    /// Paths per ray: a power of two of at least 4, in four independent replicates.
    pub paths: u32,
    /// Diffuse reflectance of the level set, in [0, 1].
    pub albedo: [f32; 3],
    /// Radiance that the level set emits.
    pub emission: [f32; 3],
    /// Factors on the power of each luminaire, in their order; those not given are 1.
    pub scales: Vec<[f64; 3]>,
    /// Whether luminaires are sampled. Otherwise those without an area have no light.
    pub samples_luminaires: bool,
    /// Whether rays pass through the backs of diffuse walls before they meet anything else, as cameras' rays do that look
    /// into a room from outside.
    pub sees_through_backs: bool,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl SceneReference {
    /// Without emission, with all luminaires at their power, sampled.
    pub fn new(paths: u32, albedo: [f32; 3], seed: u64) -> Self {
        let (emission, scales) = ([0.0; 3], Vec::new());
        Self { paths, albedo, emission, scales, samples_luminaires: true, sees_through_backs: false, seed }
    }

    pub(in super::super) fn check(&self) -> Result<()> {
        if !self.paths.is_power_of_two() || self.paths < REPLICATES as u32 {
            return Err(Error::argument("paths", self.paths, "a power of two, at least 4", "256 is a good reference"));
        }
        if !self.albedo.iter().all(|a| (0.0..=1.0).contains(a)) {
            return Err(Error::argument("albedo", format!("{:?}", self.albedo), "numbers from 0 to 1", "give less"));
        }
        Ok(())
    }
}

/// Refuses what only the estimator of the bake goes through.
///
/// # Errors
/// When the solid of the volume is translucent.
pub(in super::super) fn refuse_body(geometry: Option<&Geometry>) -> Result<()> {
    if geometry.is_none_or(|geometry| geometry.body().is_none()) {
        return Ok(());
    }
    let remedy = "compare bakes of two numbers of rays: their stated errors tell";
    Err(Error::argument("reference", "a translucent solid", "an opaque one", remedy))
}

/// Turns after which roulette begins.
const SURE_TURNS: u32 = 4;
/// A path of albedo 1 in a closed room would never end: after this many turns it is cut.
const MOST_TURNS: u32 = 1024;
/// See-through walls before a ray is given up.
const MOST_BACKS: usize = 64;

/// Radiance that arrives along rays (origin and direction in world), with its standard error; `isovalue` in the file's
/// values. `None` for a ray that meets nothing.
///
/// # Errors
/// When the number of paths or an albedo is not as [`SceneReference`] says, or the volume has no cells.
pub fn scene_radiance(
    volume: &Volume,
    pyramid: &Pyramid,
    geometry: &Geometry,
    isovalue: f64,
    rays: &[(DVec3, DVec3)],
    environment: Option<&dyn DirectionalSource>,
    settings: &SceneReference,
) -> Result<(Vec<Option<Radiance>>, SceneCounts)> {
    settings.check()?;
    volume.check_cells()?;
    if !rays.is_empty() {
        refuse_body(Some(geometry))?;
    }
    let raw = volume.raw_from_value(isovalue) as f32;
    let each: Vec<(Option<Radiance>, SceneCounts)> = with_samples!(volume.samples(), s => {
        let field = LevelField::new(volume, s, pyramid);
        let world = &World::new(volume, &field, geometry);
        let isovalues = world.isovalues(raw);
        let tracer = Tracer { world, isovalues, environments: environment.as_slice(), settings };
        rays.par_iter()
            .enumerate()
            .map(|(i, &(origin, direction))| {
                let mut counts = SceneCounts::default();
                (tracer.along(origin, direction.normalize_or(DVec3::Z), i as u64, &mut counts), counts)
            })
            .collect()
    });
    let mut counts = SceneCounts::default();
    each.iter().for_each(|(_, c)| counts += *c);
    Ok((each.into_iter().map(|(radiance, _)| radiance).collect(), counts))
}

pub(in super::super) struct Tracer<'a, T> {
    pub(in super::super) world: &'a World<'a, T>,
    pub(in super::super) isovalues: Isovalues,
    /// Radiance is found under each of them; all share the paths.
    pub(in super::super) environments: &'a [&'a dyn DirectionalSource],
    pub(in super::super) settings: &'a SceneReference,
}

/// Where a path turns: its place, and how it goes on from there.
type Turn = (Origin, Scatter);

/// How paths begin.
#[derive(Clone, Copy)]
enum Begins {
    /// Along the ray.
    Anywhere,
    /// As if this were the first thing met.
    At(Turn),
    /// Along the ray, and they count where a medium is the first thing met.
    InMedium,
}

/// Sums of what paths bring.
#[derive(Clone)]
struct Brought {
    /// From luminaires, and from level sets that emit.
    near: [f64; 3],
    /// From each environment.
    distant: Vec<[f64; 3]>,
}

fn add(sum: &mut [f64; 3], weight: &[f64; 3], light: [f64; 3], factor: f64) {
    (0..3).for_each(|c| sum[c] += weight[c] * light[c] * factor);
}

impl<T: Sample> Tracer<'_, T> {
    fn along(&self, origin: DVec3, direction: DVec3, item: u64, counts: &mut SceneCounts) -> Option<Radiance> {
        let origin = self.first_origin(origin, direction, counts)?;
        self.mean(origin, direction, Begins::Anywhere, item, counts).first().copied()
    }

    /// Radiance that leaves a point of the level set, towards anywhere: it is diffuse. One entry an environment, one
    /// where there is none.
    pub(in super::super) fn leaving(
        &self,
        at: CellPoint,
        normal: Normal,
        item: u64,
        counts: &mut SceneCounts,
    ) -> Vec<Radiance> {
        let origin = self.world.on_level(0, Start::on(at));
        self.mean(origin, DVec3::Z, Begins::At((origin, Scatter::Surface(normal))), item, counts)
    }

    /// Radiance that media scatter and send into a ray before it meets anything else.
    pub(super) fn scattered(&self, origin: Origin, direction: DVec3, item: u64, counts: &mut SceneCounts) -> Radiance {
        let begins = Begins::InMedium;
        self.mean(origin, direction, begins, item, counts).first().copied().unwrap_or_default()
    }

    /// Over the paths of all replicates, under each environment.
    fn mean(
        &self,
        origin: Origin,
        direction: DVec3,
        begins: Begins,
        item: u64,
        counts: &mut SceneCounts,
    ) -> Vec<Radiance> {
        let each = self.settings.paths / REPLICATES as u32;
        let blank = Brought { near: [0.0; 3], distant: vec![[0.0; 3]; self.environments.len()] };
        let mut sums: [Brought; REPLICATES] = std::array::from_fn(|_| blank.clone());
        for (replicate, sum) in sums.iter_mut().enumerate() {
            let sampler = PathSampler::new(self.settings.seed, item, replicate as u32);
            (0..each).for_each(|path| self.path(origin, direction, begins, &sampler, path, sum, counts));
        }
        let under = |environment: usize| {
            let of = |sum: &Brought| -> [f64; 3] {
                std::array::from_fn(|c| sum.near[c] + sum.distant.get(environment).map_or(0.0, |d| d[c]))
            };
            Radiance::of_replicates(&sums.each_ref().map(of), each)
        };
        (0..self.environments.len().max(1)).map(under).collect()
    }

    /// Albedo of a level set.
    fn albedo(&self, set: usize) -> [f32; 3] {
        let tint = self.world.tint(set);
        std::array::from_fn(|c| self.settings.albedo[c] * tint[c])
    }

    /// Where the ray starts once it has passed the backs that it sees through; `None` if it meets nothing.
    fn first_origin(&self, origin: DVec3, direction: DVec3, counts: &mut SceneCounts) -> Option<Origin> {
        let mut from = Origin { place: Place::Free, in_world: origin };
        for _ in 0..MOST_BACKS {
            match self.world.meet(&self.isovalues, &from, direction, &mut Counts::default(), counts) {
                Met::Nothing => return None,
                Met::Wall(hit)
                    if self.settings.sees_through_backs
                        && !hit.finish.is_specular()
                        && direction.dot(hit.normal) > 0.0 =>
                {
                    let in_world = from.in_world + hit.distance * direction;
                    from = Origin { place: Place::Wall(hit.part), in_world };
                }
                _ => return Some(from),
            }
        }
        None
    }

    /// Adds what one path brings.
    fn path(
        &self,
        mut origin: Origin,
        mut direction: DVec3,
        begins: Begins,
        sampler: &PathSampler,
        path: u32,
        found: &mut Brought,
        counts: &mut SceneCounts,
    ) {
        let geometry = self.world.geometry;
        let (luminaires, level) = (geometry.luminaires().len(), &mut Counts::default());
        let scaled = |l: usize, light: [f64; 3]| self.scaled(l, light);
        // The cosine, each luminaire, the environments, the roulette.
        let pairs = 3 + luminaires as u32;
        let mut weight = [1.0f64; 3];
        // Whether luminaires on the way count: before the first diffuse turn, after specular ones, or where they are not sampled.
        let mut counts_light = true;
        // Density of the direction, where environments were sampled too.
        let mut by_cosine: Option<f64> = None;
        let (mut turn, mut specular) = (0, 0);
        let chance = |turn, specular| f64::from(sampler.pair(path, specular_chain::pair(turn, specular))[0]);
        let mut at = None;
        let mut first = if let Begins::At(turn) = begins { Some(turn) } else { None };
        let media = &self.world.media;
        let mut in_media = InMedia::new(media, sampler, path);
        let carried = |weight: &[f64; 3], in_media: &InMedia| in_media.carried(*weight);
        while turn < MOST_TURNS && specular < specular_chain::MOST {
            let met = match first.take() {
                Some((place, scatter)) => Err((place, scatter, self.albedo(0))),
                None => {
                    let met = self.world.meet(&self.isovalues, &origin, direction, level, counts);
                    let collision = if media.is_empty() {
                        None
                    } else {
                        let ray = (origin.in_world, direction, self.world.distance_to(&met, &origin, direction));
                        in_media.fly(media, ray, (sampler, path), (turn, specular), counts)
                    };
                    match collision {
                        None if turn == 0 && matches!(begins, Begins::InMedium) => return,
                        None => Ok(met),
                        Some(collision) => {
                            let weight = carried(&weight, &in_media);
                            if let Some((l, radiance)) = media.glow(collision.medium) {
                                let out = std::array::from_fn(|c| radiance[c] * (1.0 - collision.albedo[c]));
                                add(&mut found.near, &weight, scaled(l, out), 1.0);
                            }
                            let in_world = origin.in_world + collision.distance * direction;
                            let place = Origin { place: Place::Medium, in_world };
                            let scatter = Scatter::Medium { onward: direction, medium: collision.medium };
                            Err((place, scatter, collision.albedo.map(|v| v as f32)))
                        }
                    }
                }
            };
            let now = carried(&weight, &in_media);
            let (place, scatter, albedo) = match met {
                Err(first) => first,
                Ok(Met::Nothing) => {
                    if counts_light {
                        geometry.each_distant(direction, &mut |l, radiance, _| {
                            add(&mut found.near, &now, scaled(l, radiance), 1.0);
                        });
                    }
                    return self.escape(direction, by_cosine, &now, found);
                }
                Ok(Met::Cut(_)) => return,
                Ok(Met::Luminaire(hit)) => {
                    if counts_light {
                        add(&mut found.near, &now, scaled(hit.luminaire, hit.radiance), 1.0);
                    }
                    return;
                }
                Ok(Met::Lost) => match at {
                    Some((place, scatter, set)) => (place, scatter, self.albedo(set)),
                    None => return,
                },
                Ok(Met::Level(set, cell)) => {
                    // What is looked at is shaded as in pictures.
                    let looked_at = turn == 0;
                    let normal =
                        if looked_at { self.world.smoothed_normal(set, &cell) } else { self.world.normal(set, &cell) };
                    let Some(normal) = normal else { return };
                    (self.world.on_level(set, Start::on(cell)), Scatter::Surface(normal), self.albedo(set))
                }
                Ok(Met::Wall(hit)) => {
                    let in_world = origin.in_world + hit.distance * direction;
                    let place = Origin { place: Place::Wall(hit.part), in_world };
                    let towards = if direction.dot(hit.normal) < 0.0 { hit.normal } else { -hit.normal };
                    if let Some(l) = hit.luminaire.filter(|_| counts_light && direction.dot(hit.normal) < 0.0) {
                        add(&mut found.near, &now, scaled(l, geometry.wall_radiance(l)), 1.0);
                    }
                    match hit.finish {
                        Finish::Diffuse(albedo) => match Normal::down_gradient(-towards.as_vec3()) {
                            Some(normal) => (place, Scatter::Surface(normal), albedo),
                            None => return,
                        },
                        Finish::Mirror(share) => {
                            let survival = specular_chain::survival(specular, share);
                            if survival < 1.0 && chance(turn, specular) >= survival {
                                return;
                            }
                            (0..3).for_each(|c| weight[c] *= f64::from(share[c]) / survival);
                            direction -= 2.0 * direction.dot(hit.normal) * hit.normal;
                            (origin, counts_light, by_cosine, specular) = (place, true, None, specular + 1);
                            continue;
                        }
                        Finish::Glass(index) => {
                            let (next, factor) = glass::turn(direction, hit.normal, index, chance(turn, specular));
                            weight = weight.map(|w| w * factor);
                            (origin, direction, counts_light) = (place, next, true);
                            (by_cosine, specular) = (None, specular + 1);
                            continue;
                        }
                    }
                }
            };
            if matches!(place.place, Place::Level(..)) {
                add(&mut found.near, &now, self.settings.emission.map(f64::from), 1.0);
            }
            (0..3).for_each(|c| weight[c] *= f64::from(albedo[c]));
            let largest = carried(&weight, &in_media).into_iter().fold(0.0, f64::max);
            if largest <= 0.0 {
                return;
            }
            if turn >= SURE_TURNS {
                let survive = largest.min(0.95);
                if f64::from(sampler.pair(path, pairs * turn + pairs - 1)[0]) >= survive {
                    return;
                }
                weight = weight.map(|w| w / survive);
            }
            let variates = |which: u32| sampler.pair(path, pairs * turn + which);
            let (now, at_turn) = (carried(&weight, &in_media), (place, scatter));
            if self.settings.samples_luminaires {
                for l in (0..luminaires).filter(|&l| self.settings.scales.get(l) != Some(&[0.0; 3])) {
                    self.sample_luminaire(l, &at_turn, variates(1 + l as u32), &now, found, level, counts);
                }
            }
            self.sample_environments(&at_turn, variates(1 + luminaires as u32), &now, found, level, counts);
            let (next, density) = scatter.sample(media, variates(0));
            (direction, by_cosine) = (next, Some(density));
            counts_light = !self.settings.samples_luminaires;
            at = if let Place::Level(set, _) = place.place { Some((place, scatter, set)) } else { None };
            (origin, turn, specular) = (place, turn + 1, 0);
        }
        counts.lost_specular += u64::from(specular == specular_chain::MOST);
        counts.lost_turns += u64::from(turn == MOST_TURNS);
    }

    /// Light of a luminaire with the factor on its power.
    fn scaled(&self, l: usize, light: [f64; 3]) -> [f64; 3] {
        match self.settings.scales.get(l) {
            Some(scale) => std::array::from_fn(|c| light[c] * scale[c]),
            None => light,
        }
    }

    /// Adds what a ray that meets nothing sees, where its direction had a density also by what the environments' own
    /// would have found.
    fn escape(&self, direction: DVec3, by_cosine: Option<f64>, weight: &[f64; 3], found: &mut Brought) {
        let Some(to) = Direction::new(direction.as_vec3()) else { return };
        for (light, sum) in self.environments.iter().zip(&mut found.distant) {
            let share = match by_cosine {
                None => 1.0,
                Some(by_cosine) if by_cosine > 0.0 => by_cosine / (by_cosine + f64::from(light.density(to))),
                Some(_) => continue,
            };
            add(sum, weight, light.radiance(to).map(f64::from), share);
        }
    }

    fn sample_luminaire(
        &self,
        l: usize,
        (place, scatter): &Turn,
        u: [f32; 2],
        weight: &[f64; 3],
        found: &mut Brought,
        level: &mut Counts,
        counts: &mut SceneCounts,
    ) {
        let media = &self.world.media;
        let images = Images { world: self.world, isovalues: &self.isovalues, from: *place, luminaire: l };
        images.each(level, counts, &mut |direction, value| {
            let density = scatter.density(media, direction);
            if density > 0.0 {
                add(&mut found.near, weight, self.scaled(l, value), density);
            }
        });
        let Some(light) = self.world.geometry.arriving(l, place.in_world, u) else { return };
        let density = scatter.density(media, light.direction);
        if density > 0.0
            && self.world.sees(&self.isovalues, place, Some(l), light.direction, light.distance, level, counts)
        {
            let through = self.world.media.transmittance(place.in_world, light.direction, light.distance, counts);
            let value = std::array::from_fn(|c| light.value[c] * through[c]);
            add(&mut found.near, weight, self.scaled(l, value), density);
        }
    }

    fn sample_environments(
        &self,
        (place, scatter): &Turn,
        u: [f32; 2],
        weight: &[f64; 3],
        found: &mut Brought,
        level: &mut Counts,
        counts: &mut SceneCounts,
    ) {
        for (light, sum) in self.environments.iter().zip(&mut found.distant) {
            let Some(sample) = light.sample(u) else { continue };
            let direction = sample.direction.vec().as_dvec3().normalize_or(DVec3::Z);
            let by_turn = scatter.density(&self.world.media, direction);
            if by_turn <= 0.0 {
                continue;
            }
            if self.world.sees(&self.isovalues, place, None, direction, f64::INFINITY, level, counts) {
                // p_turn · L / p_light, weighted by p_light / (p_light + p_turn).
                let factor = by_turn / (f64::from(sample.density) + by_turn);
                let through = self.world.media.transmittance(place.in_world, direction, f64::INFINITY, counts);
                add(sum, weight, std::array::from_fn(|c| f64::from(sample.radiance[c]) * through[c]), factor);
            }
        }
    }
}
