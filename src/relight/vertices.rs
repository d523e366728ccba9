//! Radiance of a surface whose vertices have transfer of their own: at them without interpolation, between them the
//! barycentric mean in the triangle.

use super::contract::{UNBAKED, has_radiance};
use super::lookup::each_position;
use super::{Contracted, Light, LookupReport, Material, VertexRadiance};
use crate::surface::Mesh;
use crate::transfer::BRICK_TEXELS;
use glam::Vec3;
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// The numbers of the triangles of a mesh by the cells of the grid that hold them.
pub struct TriangleOrder {
    // First and number of its triangles in `order`.
    cells: Cells,
    order: Vec<u32>,
}

type Cells = HashMap<[i32; 3], (u32, u32), BuildHasherDefault<OfCell>>;

/// A hash of few multiplications: cells are looked up for every ray that meets a surface, and nobody chooses them to collide.
#[derive(Default)]
struct OfCell(u64);

impl Hasher for OfCell {
    fn write(&mut self, bytes: &[u8]) {
        for part in bytes.chunks(4) {
            let word = part.iter().rev().fold(0u64, |word, &byte| word << 8 | u64::from(byte));
            self.0 = (self.0.rotate_left(23) ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        }
    }

    fn write_usize(&mut self, _: usize) {}

    fn finish(&self) -> u64 {
        // The table takes the upper bits for its tags and the lower for its places.
        self.0 ^ self.0 >> 32
    }
}

/// The triangles of a mesh by the cells of the grid that hold them.
pub struct TriangleIndex<'a> {
    mesh: &'a Mesh,
    sorted: &'a TriangleOrder,
}

impl TriangleOrder {
    /// Sorts the triangles of a mesh: each lies in one cell, that of its centroid. Those of vertices that are not there, or have
    /// no normal, are left out.
    pub fn new(mesh: &Mesh) -> Self {
        let count = mesh.positions_in_grid.len().min(mesh.normals.len());
        let corners = |t: [u32; 3]| t.map(|v| Vec3::from_array(mesh.positions_in_grid[v as usize]));
        let cell = |t: &[u32; 3]| {
            let [a, b, c] = corners(*t);
            ((a + b + c) / 3.0).floor().as_ivec3().to_array()
        };
        let is_whole = |t: &[u32; 3]| t.iter().all(|&v| (v as usize) < count);
        let whole = mesh.triangles.iter().zip(0..).filter(|(t, _)| is_whole(t));
        let mut keyed: Vec<([i32; 3], u32)> = whole.map(|(t, number)| (cell(t), number)).collect();
        keyed.sort_unstable();
        let mut cells = Cells::default();
        for (place, (cell, _)) in keyed.iter().enumerate() {
            cells.entry(*cell).or_insert((place as u32, 0)).1 += 1;
        }
        Self { cells, order: keyed.into_iter().map(|(_, triangle)| triangle).collect() }
    }
}

impl<'a> TriangleIndex<'a> {
    /// The triangles of a mesh, sorted: lookups panic where `sorted` is of another mesh.
    pub fn new(mesh: &'a Mesh, sorted: &'a TriangleOrder) -> Self {
        Self { mesh, sorted }
    }

    /// The mesh.
    pub fn mesh(&self) -> &'a Mesh {
        self.mesh
    }

    /// The triangle nearest to a point of the surface, and the point's barycentric coordinates there, each in [0, 1]: of those
    /// in its cell, else of those in the cells around; `None` where these have none.
    pub fn nearest(&self, position_in_grid: [f32; 3]) -> Option<([u32; 3], [f32; 3])> {
        let (triangle, weights) = self.nearest_number(position_in_grid)?;
        Some((self.mesh.triangles[triangle as usize], weights))
    }

    /// The same, but the number of the triangle.
    pub(crate) fn nearest_number(&self, position_in_grid: [f32; 3]) -> Option<(u32, [f32; 3])> {
        let position = Vec3::from_array(position_in_grid);
        let cell = position.floor().as_ivec3().to_array();
        let around =
            (0..27).filter(|i| *i != 13).map(|i| [cell[0] + i % 3 - 1, cell[1] + i / 3 % 3 - 1, cell[2] + i / 9 - 1]);
        self.nearest_of(position, std::iter::once(cell)).or_else(|| self.nearest_of(position, around))
    }

    /// The barycentric mean of values of the vertices in the nearest triangle; `None` where there is none, or a vertex has no value.
    pub fn between(&self, position_in_grid: [f32; 3], values: &[[f32; 3]]) -> Option<[f32; 3]> {
        let (triangle, weights) = self.nearest(position_in_grid)?;
        let mut sum = [0.0; 3];
        for (&v, w) in triangle.iter().zip(weights) {
            let value = values.get(v as usize)?;
            (0..3).for_each(|c| sum[c] += w * value[c]);
        }
        Some(sum)
    }

    fn nearest_of(&self, position: Vec3, cells: impl Iterator<Item = [i32; 3]>) -> Option<(u32, [f32; 3])> {
        let mut best: Option<(f32, u32, [f32; 3])> = None;
        for (first, count) in cells.filter_map(|cell| self.sorted.cells.get(&cell)) {
            for &t in &self.sorted.order[*first as usize..(*first + *count) as usize] {
                let corners =
                    self.mesh.triangles[t as usize].map(|v| Vec3::from_array(self.mesh.positions_in_grid[v as usize]));
                let weights = barycentric(corners, position);
                let at = corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
                let distance = at.distance_squared(position);
                if best.is_none_or(|(least, ..)| distance < least) {
                    best = Some((distance, t, weights));
                }
            }
        }
        best.map(|(_, triangle, weights)| (triangle, weights))
    }
}

/// Barycentric coordinates of the foot of a point in the plane of a triangle, cut off at its edges and normalised; those of
/// the first corner for a triangle without area.
fn barycentric([a, b, c]: [Vec3; 3], p: Vec3) -> [f32; 3] {
    let (u, v, w) = (b - a, c - a, p - a);
    let (uu, uv, vv, wu, wv) = (u.dot(u), u.dot(v), v.dot(v), w.dot(u), w.dot(v));
    let det = uu * vv - uv * uv;
    if det <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let (s, t) = ((vv * wu - uv * wv) / det, (uu * wv - uv * wu) / det);
    let clamped = [1.0 - s - t, s, t].map(|x| if x > 0.0 { x } else { 0.0 });
    let sum: f32 = clamped.iter().sum();
    if sum > 0.0 { clamped.map(|x| x / sum) } else { [1.0, 0.0, 0.0] }
}

impl Contracted {
    /// Radiance of a vertex and the standard error of the mean of its channels, as [`Contracted::texel`] of texels.
    fn vertex(&self, vertex: usize) -> [f32; 4] {
        match self.slots.get(vertex / BRICK_TEXELS).and_then(|&slot| self.radiance.get(slot as usize)) {
            Some(brick) => brick[vertex % BRICK_TEXELS],
            None => [0.0, 0.0, 0.0, UNBAKED],
        }
    }

    /// Radiance of a vertex; of one that has none that of its normal, unoccluded.
    fn vertex_radiance(
        &self,
        vertex: usize,
        normal: [f32; 3],
        light: &Light,
        material: &Material,
        report: &mut LookupReport,
    ) -> [f32; 3] {
        let [r, g, b, stderr] = self.vertex(vertex);
        report.lookups += 1;
        if has_radiance(stderr) {
            return [r, g, b];
        }
        report.unbaked += u64::from(stderr == UNBAKED);
        report.unoccluded += 1;
        material.unoccluded(light, normal)
    }

    /// Radiance at the vertices of a surface that it was contracted of, which have these normals.
    pub fn at_vertices(&self, normals_in_world: &[[f32; 3]], light: &Light, material: &Material) -> VertexRadiance {
        each_position(normals_in_world.len(), |vertex, report| {
            self.vertex_radiance(vertex, normals_in_world[vertex], light, material, report)
        })
    }

    /// Standard errors of the mean of the channels at `count` vertices; where one has no radiance, the root mean square over
    /// the contraction.
    pub fn vertex_errors(&self, count: usize) -> Vec<f32> {
        let error = |vertex| Some(self.vertex(vertex)[3]).filter(|&e| has_radiance(e)).unwrap_or(self.noise.rms as f32);
        (0..count).map(error).collect()
    }

    /// Radiance at a point of the surface between its vertices: the barycentric mean in the nearest triangle.
    pub fn between_vertices(
        &self,
        index: &TriangleIndex<'_>,
        position_in_grid: [f32; 3],
        normal_in_world: [f32; 3],
        light: &Light,
        material: &Material,
        report: &mut LookupReport,
    ) -> [f32; 3] {
        report.lookups += 1;
        let mut corners = LookupReport::default();
        let Some((triangle, weights)) = index.nearest(position_in_grid) else {
            report.unoccluded += 1;
            return material.unoccluded(light, normal_in_world);
        };
        let mut sum = [0.0; 3];
        for (v, w) in triangle.map(|v| v as usize).into_iter().zip(weights) {
            let radiance = self.vertex_radiance(v, index.mesh.normals[v], light, material, &mut corners);
            (0..3).for_each(|c| sum[c] += w * radiance[c]);
        }
        report.unbaked += u64::from(corners.unbaked > 0);
        report.renormalised += u64::from(corners.unoccluded > 0);
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_a_triangle_have_their_barycentric_coordinates_and_others_those_of_its_edge() {
        let corners = [Vec3::new(0.1, 0.2, 0.3), Vec3::new(0.9, 0.2, 0.4), Vec3::new(0.2, 0.8, 0.1)];
        for weights in [[1.0, 0.0, 0.0], [0.2, 0.3, 0.5], [0.0, 0.5, 0.5]] {
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            let inside = corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
            for p in [inside, inside + 0.3 * normal] {
                let found = barycentric(corners, p);
                assert!(found.iter().zip(weights).all(|(a, b)| (a - b).abs() < 1e-5), "{found:?} for {weights:?}");
            }
        }
        let outside = barycentric(corners, corners[0] * 2.0 - corners[1]);
        assert!(outside.iter().all(|w| (0.0..=1.0).contains(w)) && (outside.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        assert_eq!(barycentric([Vec3::ONE; 3], Vec3::ZERO), [1.0, 0.0, 0.0]);
    }

    #[test]
    fn the_triangle_that_holds_a_point_is_found_whichever_cell_it_is_in() {
        // A flat sheet of two triangles a cell at height 0.5.
        let n = 5;
        let positions_in_grid: Vec<[f32; 3]> = (0..n * n).map(|i| [(i % n) as f32, (i / n) as f32, 0.5]).collect();
        let mut triangles = Vec::new();
        for i in (0..n * (n - 1)).filter(|i| i % n + 1 < n) {
            let [a, b, c, d] = [i, i + 1, i + n, i + n + 1].map(|v| v as u32);
            triangles.extend([[a, b, d], [a, d, c]]);
        }
        let normals = vec![[0.0, 0.0, 1.0]; n * n];
        let mesh = Mesh { positions_in_grid, normals, triangles };
        let sorted = TriangleOrder::new(&mesh);
        let index = TriangleIndex::new(&mesh, &sorted);
        for p in [[0.25, 0.5, 0.52], [3.999, 3.001, 0.48], [2.0, 2.0, 0.5], [1.5, 2.75, 1.01]] {
            let (triangle, weights) = index.nearest(p).unwrap();
            let place = |a: usize| -> f32 {
                triangle.iter().zip(weights).map(|(&v, w)| w * mesh.positions_in_grid[v as usize][a]).sum()
            };
            assert!(
                (place(0) - p[0]).abs() < 1e-5 && (place(1) - p[1]).abs() < 1e-5,
                "{p:?}: {triangle:?} {weights:?}"
            );
        }
        assert_eq!(index.nearest([2.0, 2.0, 9.0]), None);
    }
}
