//! Walls in pictures. Radiance on flat walls is smooth, so it is path traced on a grid of each rectangle and
//! interpolated; whatever else stands in the scene (spheres, meshes, mirrors, glass) is path traced pixel by pixel.

use super::textures::factor_of;
use super::{Lighting, LuminaireFactor};
use crate::error::Result;
use crate::geom::{Bounds, Direction};
use crate::level::Pyramid;
use crate::relight::{Light, Material};
use crate::render::{Camera, Lamps, RenderOptions};
use crate::sampling::{DirectionSample, DirectionalSource};
use crate::scene::geometry::{Finish, Geometry, WallHit};
use crate::sh;
use crate::transport::{SceneReference, scene_radiance};
use crate::volume::Volume;
use glam::DVec3;
use std::collections::HashMap;

/// Points along each side of a rectangle.
const GRID: usize = 25;
/// Most paths of a point of the grid, and of a pixel; as many as a texel gets, where that is less.
const PATHS: u32 = 256;
const PIXEL_PATHS: u32 = 64;

/// What a picture has to have in view: walls and volumes, unless the walls reach far beyond the volumes. `together` is
/// the box of all volumes where there are several.
pub(super) fn in_view(geometry: Option<&Geometry>, volume: &Volume, together: Option<Bounds>) -> Option<Bounds> {
    const FAR: f64 = 3.0;
    let own = together.unwrap_or_else(|| volume.world_bounds());
    let Some(walls) = geometry.map(Geometry::bounds).filter(|walls| walls.min.is_finite()) else { return together };
    let both = walls.including(own.min).including(own.max);
    if both.size().length() <= FAR * own.size().length() { Some(both) } else { together }
}

/// What the walls of a picture depend on.
pub(super) struct WallQuestion<'a> {
    pub(super) volume: &'a Volume,
    pub(super) pyramid: &'a Pyramid,
    pub(super) isovalue: f64,
    pub(super) material: &'a Material,
    /// Paths of a texel.
    pub(super) rays: u32,
}

/// The walls as a camera sees them.
pub(super) struct Walls<'a> {
    geometry: &'a Geometry,
    // Of each rectangle that was seen; NaN at points inside the solid or under a luminaire.
    grids: HashMap<u32, Vec<[f32; 3]>>,
    // Of each pixel that shows something else.
    pixels: HashMap<usize, [f32; 3]>,
    scales: Vec<[f64; 3]>,
}

/// The band-limited environment that the transfer sees, too; lamps that are lit apart shine beside it ([`Lamps`]).
pub(super) struct Environment<'a>(pub(super) &'a Light);

impl DirectionalSource for Environment<'_> {
    fn sample(&self, _: [f32; 2]) -> Option<DirectionSample> {
        None
    }

    fn density(&self, _: Direction) -> f32 {
        0.0
    }

    fn radiance(&self, direction: Direction) -> [f32; 3] {
        let mut basis = [0.0; sh::MAX_BANDS * sh::MAX_BANDS];
        sh::basis::evaluate(self.0.bands(0), direction.vec().to_array().map(f64::from), &mut basis);
        let mut sum = [0.0; 3];
        for (y, l) in basis.iter().zip(self.0.coefficients(0)) {
            (0..3).for_each(|c| sum[c] += y * l[c]);
        }
        sum.map(|v| v.max(0.0) as f32)
    }
}

fn is_flat(geometry: &Geometry, hit: &WallHit) -> bool {
    matches!(hit.finish, Finish::Diffuse(_)) && geometry.on_rectangle(hit.part, [0.0; 2]).is_some()
}

impl<'a> Walls<'a> {
    pub(super) fn new(
        geometry: &'a Geometry,
        question: &WallQuestion<'_>,
        camera: &Camera,
        options: &RenderOptions,
        lighting: &Lighting<'_>,
        factors: &[LuminaireFactor],
    ) -> Result<Self> {
        let scales: Vec<[f64; 3]> = geometry.luminaires().iter().map(|l| factor_of(&l.name, factors)).collect();
        let (mut parts, mut rays_of_pixels, mut numbers) = (Vec::new(), Vec::new(), Vec::new());
        let (width, height) = (options.width as f64, options.height as f64);
        for pixel in 0..options.width * options.height {
            let (x, y) = ((pixel % options.width) as f64 + 0.5, (pixel / options.width) as f64 + 0.5);
            let (origin, direction) = camera.ray(x / width * 2.0 - 1.0, 1.0 - y / height * 2.0, width / height);
            match geometry.first_front(origin, direction.normalize(), f64::INFINITY) {
                Some(hit) if is_flat(geometry, &hit) => parts.push(hit.part),
                Some(_) => {
                    numbers.push(pixel);
                    rays_of_pixels.push((origin, direction));
                }
                None => {}
            }
        }
        parts.sort_unstable();
        parts.dedup();
        let mut rays_of_grids = Vec::new();
        let mut is_covered = Vec::new();
        let step = 1e-5 * geometry.bounds().size().length();
        for &part in &parts {
            for i in 0..GRID * GRID {
                // Not on the edges: there walls meet.
                let along = |i: usize| (i as f64 + 0.5) / GRID as f64;
                let Some((point, normal)) = geometry.on_rectangle(part, [along(i % GRID), along(i / GRID)]) else {
                    continue;
                };
                rays_of_grids.push((point + step * normal, -normal));
                is_covered.push(geometry.first_luminaire(point + step * normal, -normal, 2.0 * step).is_some());
            }
        }
        let bands = Environment(&lighting.light);
        let environment = Lamps::new(&lighting.suns, Some(&bands));
        let trace = |rays: &[(DVec3, DVec3)], paths: u32| {
            let settings = SceneReference {
                paths,
                albedo: question.material.albedo,
                emission: question.material.emission,
                scales: scales.clone(),
                samples_luminaires: true,
                sees_through_backs: true,
                seed: 0,
            };
            let WallQuestion { volume, pyramid, isovalue, .. } = *question;
            scene_radiance(volume, pyramid, geometry, isovalue, rays, Some(&environment), &settings)
        };
        let (of_grids, _) = trace(&rays_of_grids, PATHS.min(question.rays))?;
        let (of_pixels, _) = trace(&rays_of_pixels, PIXEL_PATHS.min(question.rays))?;
        let colour = |mean: [f64; 3]| mean.map(|v| v as f32);
        let points: Vec<[f32; 3]> = of_grids
            .iter()
            .zip(is_covered)
            .map(|(found, covered)| match found {
                Some(found) if !covered && found.mean != [0.0; 3] => colour(found.mean),
                _ => [f32::NAN; 3],
            })
            .collect();
        let grids = parts.iter().copied().zip(points.chunks(GRID * GRID).map(<[_]>::to_vec)).collect();
        let pixels =
            numbers.into_iter().zip(of_pixels).filter_map(|(n, found)| Some((n, colour(found?.mean)))).collect();
        Ok(Self { geometry, grids, pixels, scales })
    }

    /// The radiance of a wall or luminaire on a camera ray, if one is nearer than `limit`.
    pub(super) fn seen(&self, origin: DVec3, direction: DVec3, limit: f64, pixel: usize) -> Option<[f32; 3]> {
        let wall = self.geometry.first_front(origin, direction, limit);
        let before = wall.as_ref().map_or(limit, |hit| hit.distance);
        let light = self.geometry.first_luminaire(origin, direction, before).filter(|l| l.distance < limit);
        // The back of a luminaire is as invisible as that of a wall.
        if let Some(light) = light.filter(|light| light.radiance != [0.0; 3]) {
            let scale = self.scales.get(light.luminaire).copied().unwrap_or([1.0; 3]);
            return Some(std::array::from_fn(|c| (light.radiance[c] * scale[c]) as f32));
        }
        let hit = wall?;
        if !is_flat(self.geometry, &hit) {
            return self.pixels.get(&pixel).copied();
        }
        let grid = self.grids.get(&hit.part)?;
        let place = self.geometry.along_rectangle(hit.part, origin + hit.distance * direction)?;
        Some(interpolated(grid, place))
    }
}

/// Bilinear between the points that have a radiance; black where none of the four has.
fn interpolated(grid: &[[f32; 3]], place: [f64; 2]) -> [f32; 3] {
    let at = place.map(|p| (p * GRID as f64 - 0.5).clamp(0.0, (GRID - 1) as f64));
    let base = at.map(|p| (p as usize).min(GRID - 2));
    let (mut sum, mut weights) = ([0.0f32; 3], 0.0f32);
    for corner in 0..4 {
        let pick = [corner & 1, corner >> 1];
        let weight = |a: usize| {
            let t = at[a] - base[a] as f64;
            if pick[a] == 1 { t } else { 1.0 - t }
        };
        let w = (weight(0) * weight(1)) as f32;
        let value = grid[base[0] + pick[0] + GRID * (base[1] + pick[1])];
        if w > 0.0 && !value[0].is_nan() {
            (0..3).for_each(|c| sum[c] += w * value[c]);
            weights += w;
        }
    }
    if weights > 0.0 { sum.map(|v| v / weights) } else { [0.0; 3] }
}
