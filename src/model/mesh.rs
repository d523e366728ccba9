//! Signed distance to a closed mesh: the nearest triangle by a hierarchy of boxes; the sign by the angle-weighted normal of
//! the nearest face, edge or vertex (Bærentzen and Aanæs 2005), which the plane of the nearest *triangle* gets wrong beside
//! edges. A mesh that is not closed may have its sign from the generalised winding number (Jacobson et al. 2013) instead.
//!
//! The crate `parry3d` has both, in code that differs with the features of the processor; so this is our own, in `f64`.

use super::scalar::{Point, Scalar, dot, length_squared, minus, place};
use super::shape::to_segment;
use crate::error::{Error, Result};
use crate::geom::Bounds;
use glam::DVec3;
use std::collections::BTreeMap;
use std::ops::Range;

/// Triangles of a leaf of the hierarchy.
const LEAF: usize = 4;

/// What is nearest on a mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Feature {
    Face(u32),
    Edge(u32, u8),
    Vertex(u32),
}

/// A box of the hierarchy.
#[derive(Clone, Debug)]
struct Part {
    bounds: Bounds,
    // A leaf where `right` is 0: its triangles; else the left child follows, the right one stands there.
    triangles: Range<u32>,
    right: u32,
}

/// A mesh and how far points are from it.
#[derive(Clone, Debug)]
pub struct MeshDistance {
    positions: Vec<DVec3>,
    // In the order of the hierarchy.
    triangles: Vec<[u32; 3]>,
    boxes: Vec<Part>,
    normals_of_faces: Vec<DVec3>,
    // Of the edges from corner i to i + 1 of each triangle.
    normals_of_edges: Vec<[DVec3; 3]>,
    normals_of_vertices: Vec<DVec3>,
    uses_winding: bool,
}

impl MeshDistance {
    /// A vertex of it.
    pub(super) fn vertex(&self) -> Option<DVec3> {
        self.positions.first().copied()
    }

    /// Prepares a mesh. `winding` takes the winding number for the sign where the mesh is not closed: each query then looks
    /// at every triangle.
    ///
    /// # Errors
    /// When it is not closed or not oriented (and `winding` is not set), or has no triangle with an area.
    pub fn new(positions: &[DVec3], triangles: &[[u32; 3]], winding: bool) -> Result<Self> {
        // Positions that coincide are one vertex: STL has them apart.
        let mut places = BTreeMap::new();
        let mut merged = Vec::new();
        let key = |p: DVec3| p.to_array().map(|v| (v + 0.0).to_bits());
        let of = |p: &DVec3, merged: &mut Vec<DVec3>, places: &mut BTreeMap<[u64; 3], u32>| {
            *places.entry(key(*p)).or_insert_with(|| {
                merged.push(*p);
                merged.len() as u32 - 1
            })
        };
        let index: Vec<u32> = positions.iter().map(|p| of(p, &mut merged, &mut places)).collect();
        let corners = |t: &[u32; 3]| t.map(|i| merged[i as usize]);
        let has_area = |t: &[u32; 3]| {
            let [a, b, c] = corners(t);
            t[0] != t[1] && t[1] != t[2] && t[2] != t[0] && (b - a).cross(c - a).length() > 0.0
        };
        let mut kept: Vec<[u32; 3]> =
            triangles.iter().map(|t| t.map(|i| index[i as usize])).filter(|t| has_area(t)).collect();
        if kept.is_empty() {
            let expected = "triangles with an area";
            return Err(Error::argument("mesh", "none that has one", expected, "export the mesh again"));
        }
        // Each edge once in each direction.
        let mut edges: BTreeMap<[u32; 2], (u32, u32)> = BTreeMap::new();
        for t in &kept {
            for i in 0..3 {
                let (a, b) = (t[i], t[(i + 1) % 3]);
                let entry = edges.entry([a.min(b), a.max(b)]).or_default();
                if a < b { entry.0 += 1 } else { entry.1 += 1 }
            }
        }
        let open = edges.values().filter(|e| e.0 + e.1 == 1).count();
        let wrong = edges.values().filter(|e| e.0 + e.1 > 1 && e.0 != e.1).count();
        if (open > 0 || wrong > 0) && !winding {
            let given = format!("{open} edges of one triangle, {wrong} with triangles that turn against each other");
            let expected = "a closed mesh, all of whose triangles turn the same way";
            let remedy = "close it, or write sign = \"winding\" to take the winding number for the sign";
            return Err(Error::argument("mesh", given, expected, remedy));
        }
        let mut boxes = Vec::new();
        let count = kept.len() as u32;
        build(&mut kept, &merged, 0..count, &mut boxes);
        let mut mesh = Self {
            normals_of_faces: Vec::new(),
            normals_of_edges: Vec::new(),
            normals_of_vertices: vec![DVec3::ZERO; merged.len()],
            positions: merged,
            triangles: kept,
            boxes,
            uses_winding: open > 0 || wrong > 0,
        };
        mesh.add_normals();
        Ok(mesh)
    }

    fn add_normals(&mut self) {
        let mut of_edges: BTreeMap<[u32; 2], DVec3> = BTreeMap::new();
        for t in &self.triangles {
            let [a, b, c] = t.map(|i| self.positions[i as usize]);
            let normal = (b - a).cross(c - a).normalize_or_zero();
            self.normals_of_faces.push(normal);
            for i in 0..3 {
                let [here, next, before] = [t[i], t[(i + 1) % 3], t[(i + 2) % 3]];
                *of_edges.entry([here.min(next), here.max(next)]).or_default() += normal;
                let at = |i: u32| self.positions[i as usize];
                let (u, v) = ((at(next) - at(here)).normalize_or_zero(), (at(before) - at(here)).normalize_or_zero());
                let angle = libm::atan2(u.cross(v).length(), u.dot(v));
                self.normals_of_vertices[here as usize] += angle * normal;
            }
        }
        let edge = |t: &[u32; 3], i: usize| {
            let (a, b) = (t[i], t[(i + 1) % 3]);
            of_edges.get(&[a.min(b), a.max(b)]).copied().unwrap_or(DVec3::ZERO)
        };
        self.normals_of_edges = self.triangles.iter().map(|t| [edge(t, 0), edge(t, 1), edge(t, 2)]).collect();
    }

    /// How many triangles have an area.
    pub fn count(&self) -> usize {
        self.triangles.len()
    }

    /// The box around it.
    pub fn bounds(&self) -> Bounds {
        self.boxes[0].bounds
    }

    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|i| self.positions[i as usize])
    }

    /// The distance, negative inside.
    pub fn signed<S: Scalar>(&self, p: Point<S>) -> S {
        let at = place(p);
        let feature = self.nearest(at);
        let (distance, normal, foot) = match feature {
            Feature::Face(t) => {
                let (a, normal) = (self.corners(t)[0], self.normals_of_faces[t as usize]);
                let signed = dot(minus(p, a), normal);
                if !self.uses_winding {
                    return signed;
                }
                (signed.magnitude(), normal, a)
            }
            Feature::Edge(t, i) => {
                let corners = self.corners(t);
                let ends = [corners[i as usize], corners[(i as usize + 1) % 3]];
                (to_segment(p, ends).0.root(), self.normals_of_edges[t as usize][i as usize], ends[0])
            }
            Feature::Vertex(v) => {
                let vertex = self.positions[v as usize];
                (length_squared(minus(p, vertex)).root(), self.normals_of_vertices[v as usize], vertex)
            }
        };
        let is_inside = if self.uses_winding { self.winding(at) > 0.5 } else { (at - foot).dot(normal) < 0.0 };
        if is_inside { -distance } else { distance }
    }

    /// The generalised winding number.
    pub fn winding(&self, p: DVec3) -> f64 {
        let solid_angle = |t: u32| {
            let [a, b, c] = self.corners(t).map(|v| v - p);
            let (x, y, z) = (a.length(), b.length(), c.length());
            let below = x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y;
            2.0 * libm::atan2(a.dot(b.cross(c)), below)
        };
        (0..self.triangles.len() as u32).map(solid_angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
    }

    fn nearest(&self, p: DVec3) -> Feature {
        let mut best = (f64::INFINITY, Feature::Face(0));
        let mut stack = vec![(self.distance_to_box(0, p), 0u32)];
        while let Some((distance, at)) = stack.pop() {
            if distance >= best.0 {
                continue;
            }
            let here = &self.boxes[at as usize];
            if here.right == 0 {
                for t in here.triangles.clone() {
                    let (square, feature) = self.to_triangle(t, p);
                    if square < best.0 {
                        best = (square, feature);
                    }
                }
                continue;
            }
            let children = [at + 1, here.right].map(|child| (self.distance_to_box(child, p), child));
            // The nearer one first.
            let nearer = usize::from(children[1].0 < children[0].0);
            stack.push(children[1 - nearer]);
            stack.push(children[nearer]);
        }
        best.1
    }

    fn distance_to_box(&self, at: u32, p: DVec3) -> f64 {
        let bounds = &self.boxes[at as usize].bounds;
        (bounds.min - p).max(p - bounds.max).max(DVec3::ZERO).length_squared()
    }

    /// The squared distance to a triangle and what of it is nearest (Ericson 2004, 5.1.5).
    fn to_triangle(&self, t: u32, p: DVec3) -> (f64, Feature) {
        let [a, b, c] = self.corners(t);
        let [va, vb, vc] = self.triangles[t as usize];
        let (ab, ac) = (b - a, c - a);
        let (d1, d2) = (ab.dot(p - a), ac.dot(p - a));
        let (d3, d4) = (ab.dot(p - b), ac.dot(p - b));
        let (d5, d6) = (ab.dot(p - c), ac.dot(p - c));
        let vertex = |at: DVec3, v: u32| ((p - at).length_squared(), Feature::Vertex(v));
        let edge = |ends: [DVec3; 2], i: u8| (to_segment(p.to_array(), ends).0, Feature::Edge(t, i));
        if d1 <= 0.0 && d2 <= 0.0 {
            return vertex(a, va);
        }
        if d3 >= 0.0 && d4 <= d3 {
            return vertex(b, vb);
        }
        if d6 >= 0.0 && d5 <= d6 {
            return vertex(c, vc);
        }
        if d1 * d4 - d3 * d2 <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
            return edge([a, b], 0);
        }
        if d5 * d2 - d1 * d6 <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
            return edge([c, a], 2);
        }
        if d3 * d6 - d5 * d4 <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
            return edge([b, c], 1);
        }
        let e = (p - a).dot(self_normal(ab, ac));
        (e * e, Feature::Face(t))
    }
}

fn self_normal(ab: DVec3, ac: DVec3) -> DVec3 {
    ab.cross(ac).normalize_or_zero()
}

/// Halves a range of triangles by the middle of their boxes along the longest side, until few are left.
fn build(triangles: &mut [[u32; 3]], positions: &[DVec3], range: Range<u32>, boxes: &mut Vec<Part>) {
    let part = &mut triangles[range.start as usize..range.end as usize];
    let bounds = part.iter().flatten().fold(Bounds::EMPTY, |all, i| all.including(positions[*i as usize]));
    let at = boxes.len();
    boxes.push(Part { bounds, triangles: range.clone(), right: 0 });
    if part.len() <= LEAF {
        return;
    }
    let centre = |t: &[u32; 3]| t.iter().map(|i| positions[*i as usize]).sum::<DVec3>();
    let spread = part.iter().fold(Bounds::EMPTY, |all, t| all.including(centre(t))).size();
    let axis = (0..3).fold(0, |best, a| if spread[a] > spread[best] { a } else { best });
    let half = part.len() / 2;
    // Ties by the indices: the same order always.
    part.select_nth_unstable_by(half, |s, t| centre(s)[axis].total_cmp(&centre(t)[axis]).then(s.cmp(t)));
    let middle = range.start + half as u32;
    build(triangles, positions, range.start..middle, boxes);
    boxes[at].right = boxes.len() as u32;
    build(triangles, positions, middle..range.end, boxes);
}
