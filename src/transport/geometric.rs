//! Radiance of the surface that the samples themselves describe: path tracing on the trilinear level set, with nothing of
//! what the transfer and its other reference approximate.
//!
//! [`super::direct()`] starts about smoothed normals, as the texture does. Those are not the normals of the surface that
//! its rays meet: where the two disagree, rays start into the solid, and a rule decides what becomes of them. Here the normal is the gradient of the trilinear field itself, at the start and at each hit; directions are drawn
//! about it, so that each leaves towards the lit side and no such rule is needed. All of it is f64, with an own march and
//! an own root (`trilinear`): nothing demands f32 but speed.
//!
//! Points lie inside cells. On a face between two cells, where vertices of an isosurface lie, the gradient is that of
//! either side, and a half of the hemisphere about one may lie in the solid of the other.

mod trilinear;

use super::REPLICATES;
use super::direct::{Radiance, SurfacePoint};
use super::scene_path::SceneReference;
use crate::error::Result;
use crate::geom::Direction;
use crate::level::{LevelField, Pyramid};
use crate::sampling::hash::uniform;
use crate::sampling::{DirectionalSource, PathSampler, warp};
use crate::surface::Mesh;
use crate::volume::{Volume, with_samples};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::f64::consts::PI;
use trilinear::{Fate, InCell, TrilinearSurface};

/// Turns after which roulette begins.
const SURE_TURNS: u32 = 4;
/// A path of albedo 1 in a closed cavity would never end: after this many turns it is cut.
const MOST_TURNS: u32 = 1024;
/// Draws of a triangle for one point, before it is left out.
const MOST_DRAWS: u32 = 16;

/// Random points of an isosurface inside the cells of the grid.
#[derive(Clone, Debug, Default)]
pub struct CellPoints {
    /// Each with its smoothed normal, as [`super::direct()`] takes them.
    pub smoothed: Vec<SurfacePoint>,
    // One for each of them.
    exact: Vec<InCell>,
    // Of the surface itself, one for each of them.
    normals: Vec<DVec3>,
    /// Draws that found no point: the line from the triangle along the gradient does not meet the surface in its cell,
    /// or the gradient vanishes.
    pub missed: u32,
}

/// What paths on the trilinear surface did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GeometricCounts {
    /// Rays traced.
    pub rays: u64,
    /// Those of them that did not leave the surface where they started, and brought nothing.
    pub lost: u64,
    /// Paths that were cut at the most turns.
    pub cut: u64,
}

/// One of [`CellPoints`], where it lies exactly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExactPoint {
    /// In grid space.
    pub position_in_grid: [f64; 3],
    /// Unit normal of the trilinear surface there, in world axes, towards the lit side.
    pub normal: [f64; 3],
}

impl CellPoints {
    /// Each point with the normal of the surface itself.
    pub fn exact(&self) -> impl Iterator<Item = ExactPoint> {
        self.exact
            .iter()
            .zip(&self.normals)
            .map(|(at, normal)| ExactPoint { position_in_grid: at.in_grid().to_array(), normal: normal.to_array() })
    }
}

impl std::ops::AddAssign for GeometricCounts {
    fn add_assign(&mut self, other: Self) {
        self.rays += other.rays;
        self.lost += other.lost;
        self.cut += other.cut;
    }
}

/// Draws points of the isosurface of `isovalue` (in the file's values) from its triangles, uniform by area in world, and
/// moves each within its cell onto the trilinear surface, along its gradient. Stratified by area in the order of the
/// triangles. Fewer than `count` where a triangle has no such point in many draws.
pub fn points_in_cells(
    volume: &Volume,
    pyramid: &Pyramid,
    mesh: &Mesh,
    isovalue: f64,
    count: u32,
    seed: u64,
) -> CellPoints {
    let mut out = CellPoints::default();
    let world_from_grid = volume.world_from_grid().linear();
    let corners = |t: &[u32; 3]| t.map(|v| DVec3::from_array(mesh.positions_in_grid[v as usize].map(f64::from)));
    let mut areas = Vec::with_capacity(mesh.triangles.len());
    let mut sum = 0.0;
    for triangle in &mesh.triangles {
        let [a, b, c] = corners(triangle);
        sum += (world_from_grid * (b - a)).cross(world_from_grid * (c - a)).length();
        areas.push(sum);
    }
    if sum <= 0.0 {
        return out;
    }
    let raw = volume.raw_from_value(isovalue) as f32;
    let surface = TrilinearSurface::new(volume, f64::from(raw));
    let normals = Normals::new(volume);
    for i in 0..u64::from(count) {
        for draw in 0..MOST_DRAWS {
            let [u, v, w, low] = [0, 1, 2, 3].map(|d| f64::from(uniform(seed, i, draw, d)));
            // More digits than 24 bits have, for many triangles.
            let share = (i as f64 + u + low / f64::from(1u32 << 24)) / f64::from(count);
            let triangle = areas.partition_point(|area| *area < share * sum).min(areas.len() - 1);
            let [a, b, c] = corners(&mesh.triangles[triangle]);
            let root = v.sqrt();
            let at = a * (1.0 - root) + b * (root * (1.0 - w)) + c * (root * w);
            let place = moved_onto(&surface, at, (a + b + c) / 3.0);
            if let Some((place, normal)) = place.and_then(|place| Some((place, normals.at(&surface, &place)?))) {
                out.exact.push(place);
                out.normals.push(normal);
                break;
            }
            out.missed += 1;
        }
    }
    out.smoothed = with_samples!(volume.samples(), s => {
        let field = LevelField::new(volume, s, pyramid);
        let smoothed = |(place, own): (&InCell, &DVec3)| {
            let position = place.in_grid();
            let normal = field.normal(&field.locate(position.to_array())).map_or(own.as_vec3(), |n| n.vec()).to_array();
            SurfacePoint { position_in_grid: position.as_vec3().to_array(), normal }
        };
        out.exact.iter().zip(&out.normals).map(smoothed).collect()
    });
    out
}

/// A point of a triangle moved onto the surface within the cell of the triangle.
fn moved_onto(surface: &TrilinearSurface<'_>, at: DVec3, centre: DVec3) -> Option<InCell> {
    let cell = surface.cell_at(centre);
    let field = surface.field(cell);
    let local = (at - cell.as_dvec3()).clamp(DVec3::ZERO, DVec3::ONE);
    let local = field.zero_near(local, field.gradient(local).try_normalize()?)?;
    let inside = local.cmpgt(DVec3::ZERO).all() && local.cmplt(DVec3::ONE).all();
    inside.then_some(InCell { cell, local })
}

/// The normals of the trilinear field.
struct Normals {
    // s·g in world, up to a factor: f has the sign in it already.
    gradient_in_world: DMat3,
}

impl Normals {
    fn new(volume: &Volume) -> Self {
        Self { gradient_in_world: volume.world_from_grid().inverse().linear().transpose() }
    }

    /// Towards the lit side.
    fn at(&self, surface: &TrilinearSurface<'_>, place: &InCell) -> Option<DVec3> {
        // Samples are f32: squares of their differences do not vanish in f64.
        (-(self.gradient_in_world * surface.field(place.cell).gradient(place.local))).try_normalize()
    }
}

/// Radiance at the points of an isosurface under each of `environments`, as [`super::direct()`] gives it for smoothed
/// normals: one list an environment, in the order of the points. What stands around the volume is not met.
///
/// # Errors
/// When the number of paths or an albedo is not as [`SceneReference`] says, or the volume has no cells.
pub fn geometric(
    volume: &Volume,
    isovalue: f64,
    points: &CellPoints,
    environments: &[&dyn DirectionalSource],
    settings: &SceneReference,
) -> Result<(Vec<Vec<Radiance>>, GeometricCounts)> {
    settings.check()?;
    volume.check_cells()?;
    // The store's isovalues are f32.
    let surface = TrilinearSurface::new(volume, f64::from(volume.raw_from_value(isovalue) as f32));
    let grid_from_world = volume.world_from_grid().inverse().linear();
    let tracer = Tracer { surface, normals: Normals::new(volume), grid_from_world, environments, settings };
    let each: Vec<(Vec<Radiance>, GeometricCounts)> =
        points.exact.par_iter().enumerate().map(|(i, at)| tracer.leaving(at, i as u64)).collect();
    let mut counts = GeometricCounts::default();
    each.iter().for_each(|(_, c)| counts += *c);
    let under = |e: usize| each.iter().map(|(found, _)| found[e]).collect();
    Ok(((0..environments.len()).map(under).collect(), counts))
}

struct Tracer<'a> {
    surface: TrilinearSurface<'a>,
    normals: Normals,
    grid_from_world: DMat3,
    environments: &'a [&'a dyn DirectionalSource],
    settings: &'a SceneReference,
}

/// Radiance of each channel under each environment.
type Brought = Vec<[f64; 3]>;

impl Tracer<'_> {
    fn leaving(&self, at: &InCell, item: u64) -> (Vec<Radiance>, GeometricCounts) {
        let mut counts = GeometricCounts::default();
        let each = self.settings.paths / REPLICATES as u32;
        let replicates: [Brought; REPLICATES] = std::array::from_fn(|replicate| {
            let mut sum = vec![[0.0; 3]; self.environments.len()];
            let sampler = PathSampler::new(self.settings.seed, item, replicate as u32);
            (0..each).for_each(|path| self.path(*at, &sampler, path, &mut sum, &mut counts));
            sum
        });
        let under = |e: usize| Radiance::of_replicates(&replicates.each_ref().map(|sum| sum[e]), each);
        ((0..self.environments.len()).map(under).collect(), counts)
    }

    /// Adds what one path brings: environments by their own densities and by the cosine, weighed by the balance heuristic
    /// (Veach and Guibas 1995, eq. 9).
    fn path(&self, mut at: InCell, sampler: &PathSampler, path: u32, sum: &mut Brought, counts: &mut GeometricCounts) {
        let albedo = self.settings.albedo.map(f64::from);
        let mut weight = [1.0; 3];
        for turn in 0..MOST_TURNS {
            let Some(normal) = self.normals.at(&self.surface, &at) else { return };
            add(sum, &weight, |_| self.settings.emission.map(f64::from));
            (0..3).for_each(|c| weight[c] *= albedo[c]);
            let largest = weight.into_iter().fold(0.0, f64::max);
            if largest <= 0.0 {
                return;
            }
            // The light, the cosine, the roulette.
            let variates = |which: u32| sampler.pair(path, 3 * turn + which);
            if turn >= SURE_TURNS {
                let survive = largest.min(0.95);
                if f64::from(variates(2)[0]) >= survive {
                    return;
                }
                weight = weight.map(|w| w / survive);
            }
            self.add_sampled(&at, normal, variates(1), &weight, sum, counts);
            let local = warp::square_to_cosine_hemisphere(variates(0)).as_dvec3().normalize_or(DVec3::Z);
            let (tangent, bitangent) = tangents(normal);
            let direction = local.x * tangent + local.y * bitangent + local.z * normal;
            counts.rays += 1;
            match self.surface.trace(&at, self.grid_from_world * direction) {
                Fate::Lost => {
                    counts.lost += 1;
                    return;
                }
                Fate::Hit(next) => at = next,
                Fate::Escaped => {
                    let Some(to) = Direction::new(direction.as_vec3()) else { return };
                    let by_cosine = local.z / PI;
                    return add(sum, &weight, |e| {
                        let light = self.environments[e];
                        let share = by_cosine / (by_cosine + f64::from(light.density(to)));
                        light.radiance(to).map(|v| f64::from(v) * share)
                    });
                }
            }
        }
        counts.cut += 1;
    }

    /// Adds a direction of each environment, drawn by its own density.
    fn add_sampled(
        &self,
        at: &InCell,
        normal: DVec3,
        u: [f32; 2],
        weight: &[f64; 3],
        sum: &mut Brought,
        counts: &mut GeometricCounts,
    ) {
        add(sum, weight, |e| {
            let Some(sample) = self.environments[e].sample(u) else { return [0.0; 3] };
            let direction = sample.direction.vec().as_dvec3().normalize_or(DVec3::Z);
            let by_cosine = direction.dot(normal) / PI;
            if by_cosine <= 0.0 {
                return [0.0; 3];
            }
            counts.rays += 1;
            match self.surface.trace(at, self.grid_from_world * direction) {
                Fate::Hit(_) => [0.0; 3],
                Fate::Lost => {
                    counts.lost += 1;
                    [0.0; 3]
                }
                // cosine/π · L / p_light, weighed by p_light / (p_light + p_cosine).
                Fate::Escaped => {
                    let factor = by_cosine / (f64::from(sample.density) + by_cosine);
                    sample.radiance.map(|v| f64::from(v) * factor)
                }
            }
        });
    }
}

fn add(sum: &mut Brought, weight: &[f64; 3], mut light: impl FnMut(usize) -> [f64; 3]) {
    for (e, sum) in sum.iter_mut().enumerate() {
        let light = light(e);
        (0..3).for_each(|c| sum[c] += weight[c] * light[c]);
    }
}

/// As [`crate::geom::Frame::around`], in f64.
fn tangents(n: DVec3) -> (DVec3, DVec3) {
    let sign = if n.z < 0.0 { -1.0 } else { 1.0 };
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (DVec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), DVec3::new(b, sign + n.y * n.y * a, -n.y))
}

#[cfg(test)]
mod tests;
