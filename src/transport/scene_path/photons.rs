//! Photons of a luminaire, followed until they are gone: the bookkeeping of its power.

use super::super::REPLICATES;
use super::glass;
use super::world::{Met, Origin, Place, SceneCounts, World};
use crate::error::{Error, Result};
use crate::geom::{Frame, Normal};
use crate::level::{Counts, LevelField, Pyramid, Start};
use crate::sampling::{PathSampler, warp};
use crate::scene::geometry::{Finish, Geometry};
use crate::volume::{Sample, Volume, with_samples};
use glam::DVec3;
use rayon::prelude::*;

/// Where the power of a luminaire went, as shares of it (mean of the channels).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PowerBalance {
    /// Left the scene.
    pub escaped: f64,
    /// Stayed in walls.
    pub in_walls: f64,
    /// Stayed in the level set.
    pub in_level_set: f64,
    /// Met the black body of a luminaire, or its back.
    pub in_luminaires: f64,
    /// Met a cut through the solid, or started inside it.
    pub discarded: f64,
    /// Still on its way when photons were given up, or at a place without a normal.
    pub left: f64,
}

impl PowerBalance {
    /// The sum, which is 1.
    pub fn sum(&self) -> f64 {
        self.escaped + self.in_walls + self.in_level_set + self.in_luminaires + self.discarded + self.left
    }

    fn add(&mut self, other: &Self) {
        self.escaped += other.escaped;
        self.in_walls += other.in_walls;
        self.in_level_set += other.in_level_set;
        self.in_luminaires += other.in_luminaires;
        self.discarded += other.discarded;
        self.left += other.left;
    }
}

/// Turns after which what remains of a photon is given up.
const MOST_TURNS: u32 = 256;

/// Follows `photons` photons of luminaire `l` through the walls and the isosurface `isovalue` of albedo `albedo`.
///
/// # Errors
/// When the luminaire sends parallel light, which has no power, or its number is too large.
pub fn trace_photons(
    volume: &Volume,
    pyramid: &Pyramid,
    geometry: &Geometry,
    isovalue: f64,
    albedo: [f32; 3],
    l: usize,
    photons: u32,
    seed: u64,
) -> Result<PowerBalance> {
    volume.check_cells()?;
    let first = PathSampler::new(seed, 0, 0);
    let has_place = l < geometry.luminaires().len() && geometry.photon(l, first.pair(0, 0), DVec3::Z).is_some();
    if !has_place {
        let remedy = "choose a luminaire with a place";
        return Err(Error::argument("luminaire", l, "a rectangle, sphere, point or shining wall", remedy));
    }
    let raw = volume.raw_from_value(isovalue) as f32;
    let each = (photons / REPLICATES as u32).max(1);
    let parts: Vec<PowerBalance> = with_samples!(volume.samples(), s => {
        let field = LevelField::new(volume, s, pyramid);
        let world = World::new(volume, &field, geometry);
        let isovalues = world.isovalues(raw);
        (0..REPLICATES as u32)
            .into_par_iter()
            .map(|replicate| {
                let sampler = PathSampler::new(seed, l as u64, replicate);
                let mut sum = PowerBalance::default();
                (0..each).for_each(|i| one(&world, &isovalues, albedo, l, &sampler, i, &mut sum));
                sum
            })
            .collect()
    });
    let mut total = PowerBalance::default();
    parts.iter().for_each(|part| total.add(part));
    let share = 1.0 / (f64::from(each) * REPLICATES as f64);
    let PowerBalance { escaped, in_walls, in_level_set, in_luminaires, discarded, left } = total;
    Ok(PowerBalance {
        escaped: escaped * share,
        in_walls: in_walls * share,
        in_level_set: in_level_set * share,
        in_luminaires: in_luminaires * share,
        discarded: discarded * share,
        left: left * share,
    })
}

fn one<T: Sample>(
    world: &World<'_, T>,
    isovalues: &[f32],
    albedo: [f32; 3],
    l: usize,
    sampler: &PathSampler,
    index: u32,
    sum: &mut PowerBalance,
) {
    let local = warp::square_to_cosine_hemisphere(sampler.pair(index, 1)).as_dvec3();
    let Some((in_world, mut direction)) = world.geometry.photon(l, sampler.pair(index, 0), local) else { return };
    direction = direction.normalize_or(DVec3::Z);
    let mut origin = Origin { place: Place::Free, in_world };
    let mut power = [1.0f64; 3];
    let mean = |p: &[f64; 3]| (p[0] + p[1] + p[2]) / 3.0;
    let mut at = None;
    let tinted = |set: usize| -> [f32; 3] {
        let tint = world.tint(set);
        std::array::from_fn(|c| albedo[c] * tint[c])
    };
    let (level, counts) = (&mut Counts::default(), &mut SceneCounts::default());
    for turn in 0..MOST_TURNS {
        let keep = |power: &mut [f64; 3], share: [f32; 3]| {
            let before = mean(power);
            (0..3).for_each(|c| power[c] *= f64::from(share[c]));
            before - mean(power)
        };
        let (place, normal) = match world.meet(isovalues, &origin, direction, level, counts) {
            Met::Nothing => return sum.escaped += mean(&power),
            Met::Cut => return sum.discarded += mean(&power),
            Met::Luminaire(_) => return sum.in_luminaires += mean(&power),
            Met::Lost => match at {
                Some((place, normal, set)) => {
                    sum.in_level_set += keep(&mut power, tinted(set));
                    (place, normal)
                }
                None => return sum.discarded += mean(&power),
            },
            Met::Level(set, cell) => {
                sum.in_level_set += keep(&mut power, tinted(set));
                match world.normal(set, &cell) {
                    Some(normal) => (world.on_level(set, Start::on(cell)), normal),
                    None => return sum.left += mean(&power),
                }
            }
            Met::Wall(hit) => {
                let place =
                    Origin { place: Place::Wall(hit.part), in_world: origin.in_world + hit.distance * direction };
                let towards = if direction.dot(hit.normal) < 0.0 { hit.normal } else { -hit.normal };
                match hit.finish {
                    Finish::Diffuse(share) => {
                        sum.in_walls += keep(&mut power, share);
                        match Normal::down_gradient(-towards.as_vec3()) {
                            Some(normal) => (place, normal),
                            None => return sum.left += mean(&power),
                        }
                    }
                    Finish::Mirror(share) => {
                        sum.in_walls += keep(&mut power, share);
                        direction -= 2.0 * direction.dot(hit.normal) * hit.normal;
                        (origin, at) = (place, None);
                        continue;
                    }
                    Finish::Glass(index_of_glass) => {
                        let u = f64::from(sampler.pair(index, (1 << 24) + turn)[0]);
                        // Power is neither gained nor lost at glass; the factor is that of radiance.
                        direction = glass::turn(direction, hit.normal, index_of_glass, u).0;
                        (origin, at) = (place, None);
                        continue;
                    }
                }
            }
        };
        if mean(&power) <= 0.0 {
            return;
        }
        let local = warp::square_to_cosine_hemisphere(sampler.pair(index, 2 + turn));
        direction = Frame::around(normal).from_local(local).as_dvec3().normalize_or(DVec3::Z);
        at = if let Place::Level(set, _) = place.place { Some((place, normal, set)) } else { None };
        origin = place;
    }
    sum.left += mean(&power);
}
