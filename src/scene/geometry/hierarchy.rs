//! The hierarchy of boxes around the parts of walls: crate `obvhs` (PLOC, Meister and Bittner 2018).
//!
//! It works in `f32`; so its boxes are relative to the middle of the scene and widened by more than rounding, and the
//! parts themselves are tried in `f64`. Built by one thread: the same tree every time.
//!
//! Vectors cross as arrays: `obvhs` takes a range of versions of glam, and without our lock file it gets another one than
//! we do, whose types are not ours.

use super::primitive::Primitive;
use glam::DVec3;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use obvhs::ray::{Ray, RayHit};

#[derive(Clone)]
pub(super) struct Hierarchy {
    tree: Bvh2,
    middle: DVec3,
}

impl std::fmt::Debug for Hierarchy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Hierarchy").field("nodes", &self.tree.nodes.len()).finish()
    }
}

/// Share of the whole by which every box is widened: f32 has 2⁻²⁴, and a slab test takes a few roundings.
const WIDER: f64 = 1.0 / (1 << 20) as f64;

impl Hierarchy {
    pub(super) fn new(primitives: &[Primitive]) -> Self {
        let whole = primitives
            .iter()
            .map(Primitive::bounds)
            .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |w, b| [w[0].min(b[0]), w[1].max(b[1])]);
        let middle = 0.5 * (whole[0] + whole[1]);
        let margin = WIDER * (whole[1] - whole[0]).length();
        let boxed = |p: &Primitive| {
            let [low, high] = p.bounds();
            let near = |v: DVec3| (v - middle).as_vec3().to_array();
            Aabb { min: near(low - margin).into(), max: near(high + margin).into() }
        };
        let boxes: Vec<Aabb> = primitives.iter().map(boxed).collect();
        let indices = (0..boxes.len() as u32).collect();
        let search = PlocSearchDistance::Medium;
        let tree = PlocBuilder::with_capacity(boxes.len()).build(search, &boxes, indices, SortPrecision::U64, 0);
        Self { tree, middle }
    }

    fn ray(&self, origin: DVec3, direction: DVec3, limit: f64) -> Ray {
        let near = (origin - self.middle).as_vec3().to_array();
        // Rounded up: a hit just before the limit must not be lost.
        let limit = (limit * (1.0 + WIDER)) as f32;
        Ray::new(near.into(), direction.as_vec3().to_array().into(), 0.0, limit)
    }

    /// Hands over the parts whose boxes a ray meets before the nearest hit so far; `try_one` returns the distance of a hit.
    pub(super) fn nearest(
        &self,
        origin: DVec3,
        direction: DVec3,
        limit: f64,
        try_one: &mut dyn FnMut(u32, f64) -> Option<f64>,
    ) {
        let mut hit = RayHit::none();
        self.tree.ray_traverse(self.ray(origin, direction, limit), &mut hit, |_, slot| {
            let part = self.tree.primitive_indices[slot];
            try_one(part, limit).map_or(f32::INFINITY, |t| (t * (1.0 + WIDER)) as f32)
        });
    }

    /// Whether a part whose box a ray meets is one that `blocks`.
    pub(super) fn any_blocks(&self, origin: DVec3, direction: DVec3, limit: f64, blocks: &dyn Fn(u32) -> bool) -> bool {
        let missed = self.tree.ray_traverse_miss(self.ray(origin, direction, limit), |_, slot| {
            if blocks(self.tree.primitive_indices[slot]) { 0.0 } else { f32::INFINITY }
        });
        !missed
    }
}
