//! Check points of a bake: drawn by its seed off its texels and vertices, and given exact transfer.

use super::Request;
use crate::error::Result;
use crate::level::{LevelField, Pyramid};
use crate::sampling::hash::{key, uniform};
use crate::surface::Mesh;
use crate::transfer::checks::{CheckPoints, NO_ESCAPE, escape};
use crate::transfer::{Lattice, Layout, Selection};
use crate::transport::{Bake, PathEnd, Settings, SurfacePoints, estimates, replay_texel};
use crate::volume::{Sample, Volume, with_samples};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Check points of an isosurface: one for so many vertices, within bounds.
const VERTICES_A_POINT: usize = 8;
const FEWEST: usize = 64;
const MOST: usize = 512;
/// Check points of all isovalues together.
const OF_ALL: usize = 1024;
/// Paths of a check point, half of them for each half of its transfer.
const PATHS: u32 = 1024;
/// The streams of random numbers of places and of paths.
const PLACES: u64 = 0x706c_6163;
const OF_PATHS: u64 = 0x6368_6563;

/// Number of check points of a surface of so many vertices.
pub(super) fn count_of(vertices: usize) -> usize {
    (vertices / VERTICES_A_POINT).clamp(FEWEST, MOST)
}

/// `count` points of an isosurface, uniform over its area, each in a triangle of the mesh and then moved onto the level set
/// along its gradient; fewer where the field has no gradient.
pub(super) fn draw_on(
    (volume, pyramid): (&Volume, &Pyramid),
    mesh: &Mesh,
    isovalue: f64,
    count: usize,
    seed: u64,
) -> SurfacePoints {
    let world_from_grid = volume.world_from_grid();
    let corner = |v: u32| DVec3::from_array(mesh.positions_in_grid[v as usize].map(f64::from));
    let mut areas = Vec::with_capacity(mesh.triangles.len());
    let mut total = 0.0;
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|v| world_from_grid.point(corner(v)));
        total += (b - a).cross(c - a).length();
        areas.push(total);
    }
    let mut points = SurfacePoints { isovalue, ..SurfacePoints::default() };
    if total.is_nan() || total <= 0.0 {
        return points;
    }
    let raw = volume.raw_from_value(isovalue) as f32;
    with_samples!(volume.samples(), s => {
        let field = LevelField::new(volume, s, pyramid);
        for i in 0..count as u32 {
            let [pick, low, s, t] = [0, 1, 2, 3].map(|d| f64::from(uniform(seed, PLACES, i, d)));
            // Stratified by area; 24 bits are not enough for millions of triangles.
            let place = (f64::from(i) + pick + low / f64::from(1u32 << 24)) / count as f64 * total;
            let triangle = areas.partition_point(|&a| a <= place).min(areas.len() - 1);
            let (s, t) = if s + t > 1.0 { (1.0 - s, 1.0 - t) } else { (s, t) };
            let [a, b, c] = mesh.triangles[triangle].map(corner);
            let flat = a + (b - a) * s + (c - a) * t;
            if let Some((position, normal)) = onto(&field, flat.as_vec3(), raw) {
                points.positions_in_grid.push(position);
                points.normals.push(normal);
            }
        }
    });
    points
}

/// The place of the level set of `isovalue` near a position, by Newton's steps along the gradient of the smoothed field, and the
/// normal there.
fn onto<T: Sample>(field: &LevelField<'_, T>, position: Vec3, isovalue: f32) -> Option<([f32; 3], [f32; 3])> {
    const STEPS: usize = 4;
    const FARTHEST: f32 = 0.5;
    let mut place = position;
    for _ in 0..STEPS {
        let at = field.locate(place.to_array().map(f64::from));
        let gradient = field.raw_gradient(&at);
        let square = gradient.length_squared();
        if square.is_nan() || square <= 0.0 {
            break;
        }
        let step = gradient * ((isovalue - field.raw_value(&at)) / square);
        // Where it does not lead back the triangle is near enough.
        if step.length() > FARTHEST || (place + step - position).length() > FARTHEST {
            break;
        }
        place += step;
    }
    let at = field.locate(place.to_array().map(f64::from));
    Some((at.in_grid().to_array(), field.normal(&at)?.vec().to_array()))
}

/// Points of all isosurfaces together: uniform over the volume of the cells whose corners differ, each with the isovalue
/// that the field has there.
pub(super) fn draw_everywhere(volume: &Volume, pyramid: &Pyramid, seed: u64) -> SurfacePoints {
    const TRIES: u32 = 64;
    let dims = volume.dims();
    let mut points = SurfacePoints::default();
    with_samples!(volume.samples(), s => {
        let field = LevelField::new(volume, s, pyramid);
        for i in 0..OF_ALL as u32 * TRIES {
            if points.positions_in_grid.len() == OF_ALL {
                break;
            }
            let position: [f64; 3] = std::array::from_fn(|a| {
                f64::from(uniform(seed, PLACES, i, a as u32)) * (dims[a] - 1) as f64
            });
            let Some(site) = field.site(position).filter(|site| !site.clamped) else { continue };
            points.positions_in_grid.push(position.map(|v| v as f32));
            points.normals.push(site.normal.vec().to_array());
            points.own.push(volume.value_from_raw(f64::from(site.isovalue)));
        }
    });
    points
}

impl Request<'_> {
    /// Gives points exact transfer, and for a volume alone the directions of their paths.
    pub(super) fn checks_at(&self, pyramid: &Pyramid, points: &SurfacePoints) -> Result<CheckPoints> {
        let count = points.positions_in_grid.len();
        let lattice = Lattice::of_vertices(count);
        let layout = Layout { lattice, layers: self.layout.layers.clone() };
        let (selection, seed) = (Selection::empty(lattice), key(self.settings.seed, OF_PATHS));
        let half = |seed: u64, rays: u32| Settings { rays, seed, target: None, ..self.settings.clone() };
        let of_half = |h: u64| -> Result<Vec<Option<Vec<f32>>>> {
            let settings = half(seed + h, PATHS / 2);
            let bake = Bake::new(self.volume, pyramid, &layout, &settings, &selection);
            let all: Vec<([usize; 3], u32)> = (0..count).map(|i| ([i, 0, 0], PATHS / 2)).collect();
            let bake = Bake { caustics: self.has_caustics(), points: Some(points), ..bake.among(self.geometry) };
            let found = estimates(&bake, &all)?;
            Ok(found.into_iter().map(|groups| Some(groups?.into_iter().flat_map(|g| g.transfer).collect())).collect())
        };
        let [first, second] = [of_half(0)?, of_half(1)?];
        let kept: Vec<usize> = (0..count).filter(|&i| first[i].is_some() && second[i].is_some()).collect();
        let (settings, is_alone) = (half(seed + 2, PATHS), self.geometry.is_none());
        let bake = Bake::new(self.volume, pyramid, &layout, &settings, &selection);
        let bake = Bake { points: Some(points), ..bake };
        let escapes_of = |&i: &usize| -> Result<Vec<u32>> {
            let Some(found) = replay_texel(&bake, [i, 0, 0])? else { return Ok(vec![NO_ESCAPE; PATHS as usize]) };
            let code = |path: &crate::transport::ReplayedPath| match path.ended {
                PathEnd::Escaped => {
                    escape(Vec3::from_array(path.last_direction_in_world), path.vertices_in_grid.len() - 1)
                }
                _ => NO_ESCAPE,
            };
            Ok(found.paths.iter().map(code).collect())
        };
        let escapes: Vec<Vec<u32>> = match is_alone {
            true => kept.par_iter().map(escapes_of).collect::<Vec<_>>().into_iter().collect::<Result<_>>()?,
            false => Vec::new(),
        };
        let flat = |half: &[Option<Vec<f32>>]| kept.iter().filter_map(|&i| half[i].clone()).flatten().collect();
        Ok(CheckPoints {
            positions_in_grid: kept.iter().map(|&i| points.positions_in_grid[i]).collect(),
            normals: kept.iter().map(|&i| points.normals[i]).collect(),
            isovalues: kept.iter().map(|&i| points.own.get(i).copied().unwrap_or(points.isovalue)).collect(),
            halves: [flat(&first), flat(&second)],
            paths: if is_alone { PATHS } else { 0 },
            escapes: escapes.into_iter().flatten().collect(),
        })
    }
}
