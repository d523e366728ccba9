//! Vertex normals: facet normals weighted by area, and what to do where a given normal is none.

use super::fill::Surface;
use crate::geom::{Affine, Direction};
use glam::Vec3;
use rayon::prelude::*;

/// Layers that one task handles; see [`area_vectors`].
const LAYERS_PER_SLAB: usize = 8;

/// A unit normal in world coordinates for each vertex: `normal_at` of its grid position, scaled to
/// length 1, and where that is zero or not finite the mean of the facets around the vertex,
/// weighted by area.
pub(super) fn normals(
    surface: &Surface,
    world_from_grid: &Affine,
    normal_at: Option<&(dyn Fn([f32; 3]) -> [f32; 3] + Sync)>,
) -> Vec<[f32; 3]> {
    let Some(normal_at) = normal_at else {
        return facet_normals(surface, world_from_grid);
    };
    // A run of vertices for each task; NaN marks what has to be replaced.
    let mut normals = vec![[0.0; 3]; surface.positions.len()];
    let runs = normals.par_chunks_mut(1024).zip(surface.positions.par_chunks(1024)).with_max_len(1);
    runs.for_each(|(normals, positions)| {
        for (normal, &position) in normals.iter_mut().zip(positions) {
            let given = Direction::new(Vec3::from(normal_at(position)));
            *normal = given.map_or([f32::NAN; 3], |d| d.vec().to_array());
        }
    });
    if normals.par_iter().any(|n| n[0].is_nan()) {
        let facets = facet_normals(surface, world_from_grid);
        normals.iter_mut().zip(facets).filter(|(n, _)| n[0].is_nan()).for_each(|(n, facet)| *n = facet);
    }
    normals
}

fn facet_normals(surface: &Surface, world_from_grid: &Affine) -> Vec<[f32; 3]> {
    let mut normals = area_vectors(surface);
    // Area vectors are linear in the displacements' cofactors: under the map M the sum becomes
    // det(M)·M^-T times the sum, so one product per vertex is enough. The triangles are already
    // turned where det < 0.
    let mut matrix = world_from_grid.gradient_matrix();
    if world_from_grid.is_left_handed() {
        matrix = -matrix;
    }
    normals.par_iter_mut().enumerate().for_each(|(vertex, normal)| {
        let direction = Direction::new(matrix * Vec3::from(*normal)).or_else(|| {
            // The facets around the vertex cancel: take the first, which has an area.
            let first = surface.triangles.iter().find(|t| t.contains(&(vertex as u32)))?;
            Direction::new(matrix * area_vector(surface, *first))
        });
        *normal = direction.map_or([0.0, 0.0, 1.0], |d| d.vec().to_array());
    });
    normals
}

/// The sum of the area vectors of the triangles around each vertex, in the order of triangles.
///
/// A task owns the vertices of a run of layers. They touch triangles of these layers and of
/// the layer below, whose area vectors it computes once more: no vertex is shared, and the order of
/// every sum is that of the triangles, for any number of threads.
fn area_vectors(surface: &Surface) -> Vec<[f32; 3]> {
    let layers = surface.layers.len() - 1;
    let mut sums = vec![[0.0f32; 3]; surface.positions.len()];
    let mut rest = &mut sums[..];
    let mut slabs = Vec::new();
    for start in (0..layers).step_by(LAYERS_PER_SLAB) {
        let end = (start + LAYERS_PER_SLAB).min(layers);
        let (own, after) = rest.split_at_mut(surface.layers[end][0] - surface.layers[start][0]);
        rest = after;
        slabs.push((start, end, own));
    }
    slabs.into_par_iter().for_each(|(start, end, own)| {
        let first_vertex = surface.layers[start][0];
        let triangles = surface.layers[start.saturating_sub(1)][1]..surface.layers[end][1];
        for &triangle in &surface.triangles[triangles] {
            let area = area_vector(surface, triangle);
            for vertex in triangle {
                if let Some(sum) = (vertex as usize).checked_sub(first_vertex).and_then(|i| own.get_mut(i)) {
                    *sum = (Vec3::from(*sum) + area).to_array();
                }
            }
        }
    });
    sums
}

/// Twice the area of a triangle along its normal, in grid space. The differences are exact: the
/// corners are at most one cell apart. The products are f64, since slivers cancel.
fn area_vector(surface: &Surface, triangle: [u32; 3]) -> Vec3 {
    let [p, q, r] = triangle.map(|v| Vec3::from(surface.positions[v as usize]).as_dvec3());
    (q - p).cross(r - p).as_vec3()
}
