//! The point of a triangle mesh nearest to another point: a hierarchy of boxes (crate `obvhs`), searched nearest box first.
//!
//! Built by one thread: the same tree every time. Vectors cross as arrays, as in `scene::geometry`.

use glam::Vec3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

/// Where the point of a mesh nearest to another one lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Foot {
    /// The number of its triangle.
    pub(super) triangle: usize,
    /// Its barycentric coordinates there, each in [0, 1].
    pub(super) weights: [f32; 3],
    /// Of the distance.
    pub(super) squared: f32,
}

/// A triangle mesh, ready for [`Nearest::foot`].
pub(super) struct Nearest<'a> {
    positions: &'a [Vec3],
    triangles: &'a [[u32; 3]],
    tree: Bvh2,
}

impl<'a> Nearest<'a> {
    /// Builds the hierarchy; the indices are those of the positions.
    pub(super) fn new(positions: &'a [Vec3], triangles: &'a [[u32; 3]]) -> Self {
        let boxed = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| positions[v as usize]);
            Aabb { min: a.min(b).min(c).to_array().into(), max: a.max(b).max(c).to_array().into() }
        };
        let boxes: Vec<Aabb> = triangles.iter().map(boxed).collect();
        let indices = (0..boxes.len() as u32).collect();
        let search = PlocSearchDistance::Medium;
        let tree = PlocBuilder::with_capacity(boxes.len()).build(search, &boxes, indices, SortPrecision::U64, 0);
        Self { positions, triangles, tree }
    }

    /// The nearest point on triangles that `counts` says count; `None` where there are none.
    pub(super) fn foot_where(&self, point: Vec3, counts: impl Fn(usize) -> bool) -> Option<Foot> {
        let mut best: Option<Foot> = None;
        if self.triangles.is_empty() {
            return None;
        }
        let least = |best: &Option<Foot>| best.map_or(f32::INFINITY, |foot| foot.squared);
        let mut open: Vec<(f32, u32)> = vec![(0.0, 0)];
        while let Some((squared, node)) = open.pop() {
            if squared >= least(&best) {
                continue;
            }
            let node = &self.tree.nodes[node as usize];
            if node.prim_count == 0 {
                let [near, far] = [node.first_index, node.first_index + 1].map(|i| (self.to_box(i, point), i));
                let (near, far) = if far.0 < near.0 { (far, near) } else { (near, far) };
                open.extend([far, near]);
                continue;
            }
            let slots = node.first_index as usize..(node.first_index + node.prim_count) as usize;
            for &triangle in &self.tree.primitive_indices[slots] {
                let triangle = triangle as usize;
                if !counts(triangle) {
                    continue;
                }
                let corners = self.triangles[triangle].map(|v| self.positions[v as usize]);
                let weights = nearest_in_triangle(corners, point);
                let squared = place(corners, weights).distance_squared(point);
                if squared < least(&best) {
                    best = Some(Foot { triangle, weights, squared });
                }
            }
        }
        best
    }

    /// The nearest point.
    pub(super) fn foot(&self, point: Vec3) -> Option<Foot> {
        self.foot_where(point, |_| true)
    }

    /// Square of the distance to the box of a node.
    fn to_box(&self, node: u32, point: Vec3) -> f32 {
        let bounds = self.tree.nodes[node as usize].aabb();
        let [low, high] = [bounds.min, bounds.max].map(|v| Vec3::from_array([v.x, v.y, v.z]));
        point.clamp(low, high).distance_squared(point)
    }
}

/// The point of a triangle that barycentric coordinates name.
pub(super) fn place([a, b, c]: [Vec3; 3], weights: [f32; 3]) -> Vec3 {
    a * weights[0] + b * weights[1] + c * weights[2]
}

/// Barycentric coordinates of the point of a triangle nearest to `p`: in the plane if its foot is inside, else the nearest of
/// the points of the three edges. A triangle without area is its edges. In f64: simplified meshes have long thin triangles.
pub(super) fn nearest_in_triangle(corners: [Vec3; 3], p: Vec3) -> [f32; 3] {
    let (corners, p) = (corners.map(Vec3::as_dvec3), p.as_dvec3());
    let [a, b, c] = corners;
    let (u, v, w) = (b - a, c - a, p - a);
    let (uu, uv, vv, wu, wv) = (u.dot(u), u.dot(v), v.dot(v), w.dot(u), w.dot(v));
    let det = uu * vv - uv * uv;
    if det > f64::EPSILON * uu * vv {
        let (s, t) = ((vv * wu - uv * wv) / det, (uu * wv - uv * wu) / det);
        if s >= 0.0 && t >= 0.0 && s + t <= 1.0 {
            return [1.0 - s - t, s, t].map(|x| x as f32);
        }
    }
    let on_edge = |i: usize| {
        let (from, to) = (corners[i], corners[(i + 1) % 3]);
        let along = to - from;
        let length = along.dot(along);
        let t = if length > 0.0 { ((p - from).dot(along) / length).clamp(0.0, 1.0) } else { 0.0 };
        let mut weights = [0.0; 3];
        (weights[i], weights[(i + 1) % 3]) = ((1.0 - t) as f32, t as f32);
        ((from + t * along).distance_squared(p), weights)
    };
    let (first, second, third) = (on_edge(0), on_edge(1), on_edge(2));
    let nearer = if second.0 < first.0 { second } else { first };
    if third.0 < nearer.0 { third.1 } else { nearer.1 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::hash::uniform;

    fn random(i: u32, salt: u32) -> Vec3 {
        Vec3::from_array([0, 1, 2].map(|d| uniform(7, u64::from(salt), i, d)))
    }

    #[test]
    fn the_foot_is_the_nearest_of_all_triangles() {
        let positions: Vec<Vec3> = (0..60).map(|i| random(i, 1)).collect();
        let triangles: Vec<[u32; 3]> = (0..40).map(|i| [i, i + 7, i + 20]).collect();
        let nearest = Nearest::new(&positions, &triangles);
        for i in 0..200 {
            let p = 2.0 * random(i, 2) - 0.5;
            let all = triangles.iter().map(|t| {
                let corners = t.map(|v| positions[v as usize]);
                place(corners, nearest_in_triangle(corners, p)).distance_squared(p)
            });
            let least = all.fold(f32::INFINITY, f32::min);
            let found = nearest.foot(p).map_or(f32::INFINITY, |foot| foot.squared);
            assert!((found - least).abs() <= 1e-5 * least, "point {p}: {found}, not {least}");
        }
    }

    #[test]
    fn no_point_of_a_triangle_is_nearer_than_the_foot() {
        for i in 0..100 {
            let corners = [0, 1, 2].map(|k| random(i, 10 + k));
            let p = 3.0 * random(i, 20) - 1.0;
            let weights = nearest_in_triangle(corners, p);
            assert!(
                weights.iter().all(|w| (0.0..=1.0).contains(w)) && (weights.iter().sum::<f32>() - 1.0).abs() < 1e-5
            );
            let found = place(corners, weights).distance(p);
            for j in 0..=20 {
                for k in 0..=20 - j {
                    let [s, t] = [j, k].map(|x| x as f32 / 20.0);
                    assert!(place(corners, [1.0 - s - t, s, t]).distance(p) > found - 1e-5);
                }
            }
        }
    }

    #[test]
    fn triangles_without_area_are_their_edges() {
        let [a, b] = [Vec3::ZERO, Vec3::X];
        assert_eq!(
            place([a, b, b], nearest_in_triangle([a, b, b], Vec3::new(0.25, 1.0, 0.0))),
            Vec3::new(0.25, 0.0, 0.0)
        );
        assert_eq!(nearest_in_triangle([a; 3], Vec3::ONE), [1.0, 0.0, 0.0]);
        assert_eq!(Nearest::new(&[], &[]).foot(Vec3::ZERO), None);
    }
}
