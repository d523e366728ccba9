//! What suns that were split off an environment bring by reflection on a level set.
//!
//! With D the exitant radiance by their direct light, that by reflection is R = G (D + R), G the mean over a cosine-weighted
//! hemisphere of ρ times what is met there. In two steps (final gathering, Reichert 1992): R of each triangle of the mesh, at the
//! point of the surface near its centre and about the normal that rays meet there, from few rays each, whose hits are kept and the
//! equation solved on them; then one gather of many rays at each place asked for, which averages most of the noise of the first step
//! away. Where rays meet the surface each asks for one of the suns, drawn by what it would bring unshadowed (next event
//! estimation): the first order of reflection is unbiased. Higher ones are those of a triangle: their bias is held against paths in
//! `tests/physics/reflected_suns.rs`. Rays are those of the bake: those lost in the solid are hits of distance 0, where there is R
//! itself. With a share p of them R (1 − ρ p) = ρ (what the others meet + p D).
//!
//! Tried and lost: R at the vertices, about their smoothed normals (up to eight times too bright where such a normal points into the
//! solid; without what is lost in it a third too dark in narrow clefts); D interpolated between vertices (4 % too bright where walls
//! are a few voxels thick), and the same as a control variate with every fourth ray asking (three times the variance there).

use super::lamps::{AIM, places_of_trial, rays_that_are_enough};
use super::sun::{Disk, SunLight, SunVisibility, sun_visibility};
use crate::error::Result;
use crate::geom::{Frame, Normal};
use crate::level::{CellPoint, Counts, LevelField, Outcome, Pyramid, Start};
use crate::relight::{Material, TriangleIndex, check_count};
use crate::sampling::{PathSampler, warp};
use crate::volume::{Sample, Volume, with_samples};
use glam::Vec3;
use rayon::prelude::*;

/// Radiance by reflection at each of some places.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reflected {
    /// Linear exitant radiance.
    pub radiance: Vec<[f32; 3]>,
    /// Variance of the mean of its channels, by two halves of the rays of both steps: one degree of freedom.
    pub variance: Vec<f32>,
    /// The variance of a channel, mean over the three: lamps of several colours leave more noise in the channels than in their mean.
    pub channel_variance: Vec<f32>,
    /// Rays of each place.
    pub rays_each: u32,
    /// Rays: their own count, apart from the rays of the transport and of cameras.
    pub rays: u64,
}

/// An isosurface as a mesh, which has normals.
#[derive(Clone, Copy)]
pub struct Surroundings<'a> {
    /// The volume.
    pub volume: &'a Volume,
    /// Its pyramid.
    pub pyramid: &'a Pyramid,
    /// In the file's values.
    pub isovalue: f64,
    /// The triangles of its mesh.
    pub triangles: &'a TriangleIndex<'a>,
}

/// The light of suns on an isosurface: direct light at its vertices, and what they send out all in all, about.
pub struct SunLit<'a> {
    surface: Surroundings<'a>,
    albedo: [f32; 3],
    /// Of each sun, at the vertices.
    pub seen: Vec<SunVisibility>,
    suns: Vec<Lamp>,
    // Mean of D at the vertices.
    direct: f64,
    // R of the triangles by two halves of the rays; none where nothing is reflected.
    by_reflection: [Vec<[f32; 3]>; 2],
    rays: u64,
}

const SEED: u64 = 0x7265_666c_6563_7421;
const SEED_OF_FIRST: u64 = 0x6669_7273_7421;
/// Independent estimates whose spread is the stated error.
const REPLICATES: u32 = 4;

/// Rays of a triangle in each half of the first step, and most of all triangles.
const FIRST_RAYS: u32 = 96;
const FEWEST_FIRST_RAYS: u32 = 4;
const MOST_FIRST: usize = 5 << 20;
/// Steps along the gradient from the centre of a triangle to the surface: far more than a root takes that is near.
const STEPS: usize = 8;
/// Turns of the solution at most, and what is left of it, over the largest radiance of one reflection, at which it ends.
const TURNS: usize = 1024;
const SETTLED: f32 = 1e-3;

/// Bounds of the rays of a place, and most of all together.
const FEWEST_RAYS: u32 = 32;
const MOST_RAYS: u32 = 2048;
const MOST_OF_ALL: u64 = 1 << 26;
/// Places of one task.
const TASK: usize = 64;

/// Rays of a triangle in each half of the first step.
fn first_rays(triangles: usize) -> u32 {
    (MOST_FIRST / triangles.max(1)).clamp(FEWEST_FIRST_RAYS as usize, FIRST_RAYS as usize) as u32
}

/// Bytes that suns take on a surface of so many vertices, about: what each sun brings to each, what is kept of the first step of
/// about twice as many triangles, and the sums of both.
pub fn bytes_of_suns(vertices: usize, suns: usize) -> u64 {
    let triangles = 2 * vertices;
    let hits = u64::from(first_rays(triangles)) * size_of::<u32>() as u64 * 3 / 2;
    triangles as u64 * (hits + 96) + vertices as u64 * (8 * suns as u64 + 32)
}

/// Part of the sine of a sun's radius that its chance has beyond its cosine, so that one half below the horizon is found.
const BELOW_HORIZON: f32 = 0.5;

/// A sun for rays: its disk, what a visible cosine of it brings, and the sum of that over the channels.
struct Lamp {
    disk: Disk,
    factor: [f32; 3],
    strength: f32,
}

impl Lamp {
    fn new(sun: &SunLight, material: &Material) -> Self {
        let factor = material.sun_factor(sun.flux);
        Self { disk: Disk::new(sun), factor, strength: factor.iter().sum::<f32>().max(0.0) }
    }

    /// About what it would bring unshadowed.
    fn weight(&self, normal: Vec3) -> f32 {
        let (cosine, sine) = (self.disk.towards().dot(normal), self.disk.sine());
        if cosine > -sine { self.strength * (cosine.max(0.0) + BELOW_HORIZON * sine) } else { 0.0 }
    }
}

/// What a ray finds that does not escape.
struct Arrived {
    /// Whether it is lost in the solid.
    is_lost: bool,
    /// The triangle there, if it is not lost and one is near.
    met: Option<u32>,
    /// D there by one ray to a sun.
    direct: [f32; 3],
}

/// What the rays of a triangle find in the first step.
#[derive(Clone, Default)]
struct First {
    met: Vec<u32>,
    // Sum of D.
    direct: [f32; 3],
    // What a sum over the rays is multiplied with.
    scale: [f32; 3],
}

impl<'a> SunLit<'a> {
    /// Direct light at the vertices, and where the surface reflects to itself, the solution of the first step.
    /// A grid without cells reflects nothing.
    pub fn new(surface: Surroundings<'a>, lamps: &[SunLight], material: &Material, reflects: bool) -> Self {
        let albedo = material.albedo;
        let Surroundings { volume, pyramid, isovalue, triangles } = surface;
        let mesh = triangles.mesh();
        let count = mesh.positions_in_grid.len().min(mesh.normals.len());
        let (positions, normals) = (&mesh.positions_in_grid[..count], &mesh.normals[..count]);
        let seen: Vec<SunVisibility> =
            lamps.iter().map(|sun| sun_visibility(volume, pyramid, isovalue, positions, normals, sun)).collect();
        let suns: Vec<Lamp> = lamps.iter().map(|sun| Lamp::new(sun, material)).collect();
        let of_sun = |(sun, seen): (&Lamp, &SunVisibility)| {
            f64::from(sun.strength) / 3.0 * seen.lit.iter().map(|&v| f64::from(v)).sum::<f64>() / count.max(1) as f64
        };
        let direct = suns.iter().zip(&seen).map(of_sun).sum();
        let rays = seen.iter().map(|seen| seen.counts.rays).sum();
        let mut lit = Self { surface, albedo, seen, suns, direct, by_reflection: Default::default(), rays };
        let has_cells = volume.dims().iter().all(|&d| d > 1);
        if reflects && has_cells && albedo.iter().any(|&a| a > 0.0) && !lit.suns.is_empty() {
            lit.by_reflection = [0, 1].map(|half| lit.solve(half));
        }
        lit
    }

    /// Rays so far.
    pub fn rays(&self) -> u64 {
        self.rays
    }

    /// R = G D + G R of the triangles, G of few rays each.
    fn solve(&mut self, half: u32) -> Vec<[f32; 3]> {
        let triangles = &self.surface.triangles.mesh().triangles;
        let each = first_rays(triangles.len());
        let mut all: Vec<First> = vec![First::default(); triangles.len()];
        let parts: Vec<u64> = with_samples!(self.surface.volume.samples(), s => {
            let field = &LevelField::new(self.surface.volume, s, self.surface.pyramid);
            all.par_chunks_mut(TASK)
                .enumerate()
                .map(|(task, all)| {
                    let mut counts = Counts::default();
                    for (i, first) in all.iter_mut().enumerate() {
                        let t = task * TASK + i;
                        let Some(place) = self.place_of(field, triangles[t]) else { continue };
                        let sampler = PathSampler::new(SEED_OF_FIRST, t as u64, half);
                        let mut lost = 0;
                        self.each_met(field, place, (&sampler, each), &mut counts, &mut |arrived| {
                            lost += u32::from(arrived.is_lost);
                            first.met.extend(arrived.met);
                            (0..3).for_each(|c| first.direct[c] += arrived.direct[c]);
                        });
                        first.scale = self.scale(each, lost).map(|v| v as f32);
                    }
                    counts.rays
                })
                .collect()
        });
        self.rays += parts.iter().sum::<u64>();
        let once = |first: &First| std::array::from_fn(|c| first.scale[c] * first.direct[c]);
        let mut solution: Vec<[f32; 3]> = all.iter().map(once).collect();
        let largest = solution.iter().flatten().copied().fold(0.0, f32::max);
        let mut before = 0.0;
        for _ in 0..TURNS {
            let turn = |first: &First| -> [f32; 3] {
                let mut sum = first.direct;
                for &t in &first.met {
                    (0..3).for_each(|c| sum[c] += solution[t as usize][c]);
                }
                std::array::from_fn(|c| first.scale[c] * sum[c])
            };
            let next: Vec<[f32; 3]> = all.par_iter().map(turn).collect();
            let both = next.iter().flatten().zip(solution.iter().flatten());
            let change = both.fold(0.0f32, |most, (a, b)| most.max((a - b).abs()));
            solution = next;
            // What is left is change · r/(1 − r), r the ratio of changes.
            let ratio = if before > 0.0 { change / before } else { 0.0 };
            if change <= 0.0 || ratio < 1.0 && before > 0.0 && change * ratio <= SETTLED * largest * (1.0 - ratio) {
                break;
            }
            before = change;
        }
        solution
    }

    /// What a sum over so many rays of a place is multiplied with, of which some are lost: as often as a path is followed at most, where
    /// all are and nothing is absorbed.
    fn scale(&self, rays: u32, lost: u32) -> [f64; 3] {
        let (rays, lost) = (f64::from(rays.max(1)), f64::from(lost));
        self.albedo.map(f64::from).map(|albedo| albedo / (rays - albedo * lost).max(rays / TURNS as f64))
    }

    /// The point of the surface near the centre of a triangle, and the normal that rays meet there; none where the field has no
    /// gradient.
    fn place_of<T: Sample>(&self, field: &LevelField<'_, T>, triangle: [u32; 3]) -> Option<(CellPoint, Normal)> {
        let positions = &self.surface.triangles.mesh().positions_in_grid;
        let [a, b, c] = triangle.map(|v| positions.get(v as usize).map(|p| Vec3::from_array(*p)));
        let mut at = field.locate(((a? + b? + c?) / 3.0).as_dvec3().to_array());
        let raw = self.raw_isovalue();
        for _ in 0..STEPS {
            let gradient = field.trilinear_gradient(&at);
            let step = (raw - field.raw_value(&at)) / gradient.length_squared() * gradient;
            if !step.is_finite() || step == Vec3::ZERO {
                break;
            }
            at = field.locate((at.in_grid() + step.clamp_length_max(0.5)).as_dvec3().to_array());
        }
        Some((at, field.hit_normal(&at)?))
    }

    fn raw_isovalue(&self) -> f32 {
        self.surface.volume.raw_from_value(self.surface.isovalue) as f32
    }

    /// Sends rays from a place about its normal, and tells what each finds that does not escape.
    fn each_met<T: Sample>(
        &self,
        field: &LevelField<'_, T>,
        (at, normal): (CellPoint, Normal),
        (sampler, rays): (&PathSampler, u32),
        counts: &mut Counts,
        with: &mut impl FnMut(Arrived),
    ) {
        let raw = self.raw_isovalue();
        let frame = Frame::around(normal);
        let [directions, choices, places] = [0, 1, 2].map(|pair| sampler.sequence(pair));
        for ray in 0..rays {
            let direction = frame.from_local(warp::square_to_cosine_hemisphere(directions.point(ray)));
            let (is_lost, met, normal) =
                match field.trace(raw, &Start::on(at), field.direction_in_grid(direction), counts) {
                    Outcome::Escaped => continue,
                    Outcome::Lost => (true, at, normal),
                    Outcome::Hit(hit) => match field.hit_normal(&hit.at) {
                        Some(normal) => (false, hit.at, normal),
                        None => continue,
                    },
                };
            let direct = self.ask(field, raw, (met, normal.vec()), [choices.point(ray), places.point(ray)], counts);
            let nearest = if is_lost { None } else { self.surface.triangles.nearest_number(met.in_grid().to_array()) };
            with(Arrived { is_lost, met: nearest.map(|(triangle, _)| triangle), direct });
        }
    }

    /// D at a point of the level set by one ray to one of the suns, over its chance.
    fn ask<T: Sample>(
        &self,
        field: &LevelField<'_, T>,
        raw: f32,
        (at, normal): (CellPoint, Vec3),
        [choice, place]: [[f32; 2]; 2],
        counts: &mut Counts,
    ) -> [f32; 3] {
        let total: f32 = self.suns.iter().map(|sun| sun.weight(normal)).sum();
        if total.is_nan() || total <= 0.0 {
            return [0.0; 3];
        }
        let (mut left, mut drawn) = (choice[0] * total, None);
        for sun in &self.suns {
            let own = sun.weight(normal);
            if own > 0.0 {
                drawn = Some((sun, own));
                if left < own {
                    break;
                }
            }
            left -= own;
        }
        let Some((sun, own)) = drawn else { return [0.0; 3] };
        let direction = sun.disk.direction(place);
        let cosine = direction.dot(normal);
        let sees = |counts: &mut Counts| {
            field.trace(raw, &Start::on(at), field.direction_in_grid(direction), counts) == Outcome::Escaped
        };
        if cosine <= 0.0 || !sees(counts) {
            return [0.0; 3];
        }
        let factor = cosine * total / own;
        sun.factor.map(|f| f * factor)
    }

    /// One gather at some places, which are numbered as `which` says, and the mean of the part of the variance that its rays bring.
    fn gather(&self, which: &[usize], positions: &[[f32; 3]], normals: &[[f32; 3]], rays: u32) -> (Reflected, f64) {
        let each = rays / REPLICATES;
        let mut found = vec![Gathered::default(); which.len()];
        let parts: Vec<u64> = with_samples!(self.surface.volume.samples(), s => {
            let field = &LevelField::new(self.surface.volume, s, self.surface.pyramid);
            found
                .par_chunks_mut(TASK)
                .zip(which.par_chunks(TASK))
                .map(|(found, which)| {
                    let mut counts = Counts::default();
                    for (found, &i) in found.iter_mut().zip(which) {
                        let Some(normal) = Normal::down_gradient(-Vec3::from_array(normals[i])) else { continue };
                        let place = (field.locate(positions[i].map(f64::from)), normal);
                        let mut means = [[0.0f64; 3]; REPLICATES as usize];
                        for (mean, replicate) in means.iter_mut().zip(0..) {
                            let sampler = PathSampler::new(SEED, i as u64, replicate);
                            let solution = &self.by_reflection[replicate as usize % 2];
                            let mut lost = 0;
                            self.each_met(field, place, (&sampler, each), &mut counts, &mut |arrived| {
                                lost += u32::from(arrived.is_lost);
                                let more = arrived.met.map_or([0.0; 3], |t| solution[t as usize]);
                                (0..3).for_each(|c| mean[c] += f64::from(arrived.direct[c] + more[c]));
                            });
                            let scale = self.scale(each, lost);
                            (0..3).for_each(|c| mean[c] *= scale[c]);
                        }
                        *found = Gathered::of(&means);
                    }
                    counts.rays
                })
                .collect()
        });
        let count = found.len().max(1) as f64;
        let of_rays = found.iter().map(|one| one.of_rays).sum::<f64>() / count;
        let reflected = Reflected {
            radiance: found.iter().map(|one| one.radiance).collect(),
            variance: found.iter().map(|one| one.variance).collect(),
            channel_variance: found.iter().map(|one| one.channel_variance).collect(),
            rays_each: rays,
            rays: parts.iter().sum(),
        };
        (reflected, of_rays)
    }

    /// What they bring by reflection at some places (grid space, unit normals in world), by as many rays as bring the standard
    /// error to 1.2 % of the mean radiance, root mean square over the places: trials tell, within bounds. `rest`: the mean
    /// radiance that comes from elsewhere.
    ///
    /// The numbers are a function of the places and their order: the same for any number of threads.
    ///
    /// # Errors
    /// When there are not as many normals as positions.
    pub fn reflected(
        &self,
        positions_in_grid: &[[f32; 3]],
        normals_in_world: &[[f32; 3]],
        rest: f64,
    ) -> Result<Reflected> {
        let count = positions_in_grid.len();
        check_count("normals", normals_in_world.len(), count)?;
        if self.by_reflection[0].is_empty() || count == 0 {
            let (radiance, nothing) = (vec![[0.0; 3]; count], vec![0.0; count]);
            let (variance, channel_variance) = (nothing.clone(), nothing);
            return Ok(Reflected { radiance, variance, channel_variance, ..Reflected::default() });
        }
        let all: Vec<usize> = (0..count).collect();
        let some: Vec<usize> = places_of_trial(count).collect();
        let mean_of = |values: &[[f32; 3]]| {
            values.iter().flatten().map(|&v| f64::from(v)).sum::<f64>() / (3 * values.len().max(1)) as f64
        };
        let wanted = AIM * (rest.max(0.0) + self.direct + mean_of(&self.by_reflection[0]));
        let allowed = (MOST_OF_ALL / count as u64).clamp(FEWEST_RAYS.into(), MOST_RAYS.into()) as u32;
        let mut tried = 0;
        let rays = rays_that_are_enough(FEWEST_RAYS, allowed, |rays| {
            let (trial, variance) = self.gather(&some, positions_in_grid, normals_in_world, rays);
            tried += trial.rays;
            Ok(variance.sqrt() <= wanted)
        })?;
        let (found, _) = self.gather(&all, positions_in_grid, normals_in_world, rays);
        Ok(Reflected { rays: found.rays + tried, ..found })
    }
}

/// What is gathered at a place.
#[derive(Clone, Copy, Default)]
struct Gathered {
    radiance: [f32; 3],
    variance: f32,
    channel_variance: f32,
    // The part of that which the rays of the gather bring.
    of_rays: f64,
}

impl Gathered {
    /// Of four estimates of which 0 and 2, and 1 and 3 share the first step.
    fn of(means: &[[f64; 3]; REPLICATES as usize]) -> Self {
        let mean: [f64; 3] = std::array::from_fn(|c| means.iter().map(|m| m[c]).sum::<f64>() / f64::from(REPLICATES));
        // Each of variance v of its own and a pair t in common: the mean has v/4 + t/2, as (A − B)²/4 of the pairs' means.
        let between = |[a, b, c, d]: [f64; 4]| (0.5 * (a + c) - 0.5 * (b + d)).powi(2) / 4.0;
        let within = |[a, b, c, d]: [f64; 4]| ((a - c).powi(2) + (b - d).powi(2)) / 16.0;
        let over_channels = |of: &dyn Fn([f64; 4]) -> f64| (0..3).map(|c| of(means.map(|m| m[c]))).sum::<f64>() / 3.0;
        Self {
            radiance: mean.map(|v| v as f32),
            variance: between(means.map(|m| (m[0] + m[1] + m[2]) / 3.0)) as f32,
            channel_variance: over_channels(&between) as f32,
            of_rays: over_channels(&within),
        }
    }
}
