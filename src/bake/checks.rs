//! Check points of a bake: drawn by its seed off its texels and vertices, and given exact transfer.

use super::Request;
use crate::error::Result;
use crate::level::{LevelField, Pyramid};
use crate::sampling::hash::{key, uniform};
use crate::surface::Mesh;
use crate::transfer::checks::{CheckPoints, NO_ESCAPE, escape};
use crate::transfer::{Lattice, Layout, Selection};
use crate::transport::{
    Bake, PathEnd, ReplayedPath, Settings, SurfacePoints, estimates, points_in_cells, replay_paths,
};
use crate::volume::{Volume, with_samples};
use glam::Vec3;
use rayon::prelude::*;

/// Check points of an isosurface: one for so many vertices, within bounds.
const VERTICES_A_POINT: usize = 8;
const FEWEST: usize = 64;
const MOST: usize = 256;
/// Check points of all isovalues together.
pub(super) const OF_ALL: usize = 512;
/// Paths of a check point, half of them for each half of its transfer. More paths rather than more points: what is beyond the bands is
/// the mean of a product of two halves, whose noise falls as the paths and as the root of the points.
pub(super) const PATHS: u32 = 2048;
/// The streams of random numbers of places and of paths.
const PLACES: u64 = 0x706c_6163;
const OF_PATHS: u64 = 0x6368_6563;

/// Number of check points of a surface of so many vertices.
pub(super) fn count_of(vertices: usize) -> usize {
    (vertices / VERTICES_A_POINT).clamp(FEWEST, MOST)
}

/// `count` points of an isosurface, uniform over its area, inside cells and off the vertices; fewer where triangles have no such
/// point.
pub(super) fn draw_on(
    (volume, pyramid): (&Volume, &Pyramid),
    mesh: &Mesh,
    isovalue: f64,
    count: usize,
    seed: u64,
) -> SurfacePoints {
    let drawn = points_in_cells(volume, pyramid, mesh, isovalue, count as u32, key(seed, PLACES)).smoothed;
    let (positions_in_grid, normals) = drawn.into_iter().map(|p| (p.position_in_grid, p.normal)).unzip();
    SurfacePoints { isovalue, positions_in_grid, normals, own: Vec::new() }
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
            let (caustics, specular) = (self.has_caustics(), self.specular.map(|s| s as _));
            let bake = Bake { caustics, specular, points: Some(points), ..bake.among(self.geometry) };
            let found = estimates(&bake, &all)?;
            Ok(found.into_iter().map(|groups| Some(groups?.into_iter().flat_map(|g| g.transfer).collect())).collect())
        };
        let [first, second] = [of_half(0)?, of_half(1)?];
        let kept: Vec<usize> = (0..count).filter(|&i| first[i].is_some() && second[i].is_some()).collect();
        let (settings, is_alone) = (half(seed + 2, PATHS), self.geometry.is_none());
        let bake = Bake::new(self.volume, pyramid, &layout, &settings, &selection);
        let bake = Bake { points: Some(points), ..bake };
        let escapes_of = |&i: &usize| -> Result<Vec<u32>> {
            let Some((_, paths)) = replay_paths(&bake, [i, 0, 0])? else { return Ok(vec![NO_ESCAPE; PATHS as usize]) };
            let code = |path: &ReplayedPath| match path.ended {
                PathEnd::Escaped => {
                    escape(Vec3::from_array(path.last_direction_in_world), path.vertices_in_grid.len() - 1)
                }
                _ => NO_ESCAPE,
            };
            Ok(paths.iter().map(code).collect())
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
