//! Paths through a translucent solid: the medium is {h > c}, its boundary a smooth one.
//!
//! A path that comes to the boundary is reflected with Fresnel's probability, or refracted into the solid, where it flies and
//! scatters until it leaves, there or elsewhere. It carries no square of the ratio of the indices: of paths that begin and end
//! outside these cancel. Exitance over π of a texel is the mean of what such paths find, if they begin by the cosine outside:
//! the light that leaves is averaged over the directions in which it does. (A matched half-space is not Lambertian: at an albedo of
//! 0.9 it is 13 % darker than the mean straight on, 6 % brighter at 60°.)
//!
//! Where the border of the box cuts the solid it is open: rays cross it without a turn.

use super::estimate::{Found, Path};
use super::glass::fresnel;
use super::media::{Collision, Media};
use super::scatter::Scatter;
use super::world::{Origin, Place, SceneCounts};
use crate::geom::Normal;
use crate::level::{Counts, LevelField, Outcome, Start};
use crate::scene::geometry::Geometry;
use crate::scene::medium::Body;
use crate::transport::replay::{On, PathEnd};
use crate::volume::{Sample, Volume};
use glam::DVec3;

/// Steps within a solid at which a path is cut, and counted as trapped.
const MOST_STEPS: u32 = 1 << 16;
/// Pairs of random numbers within solids start here, behind those of flights outside.
const FIRST_PAIR: u32 = 1 << 30;
/// How far beyond the border of the box rays go on that leave it inside the solid, over its size.
const BEYOND: f64 = 1e-6;

/// The inside of a translucent solid.
pub(super) struct Inside<'a, T> {
    field: LevelField<'a, T>,
    body: &'a Body,
    pub(super) media: Media<'a>,
    size: f64,
}

/// A path at the boundary, from outside.
pub(super) struct Arrival {
    pub(super) start: Start,
    /// Outward.
    pub(super) normal: DVec3,
    pub(super) direction: DVec3,
}

impl<'a, T: Sample> Inside<'a, T> {
    pub(super) fn new(body: &'a Body, volume: &'a Volume, field: &LevelField<'a, T>, geometry: &'a Geometry) -> Self {
        let medium = std::slice::from_ref(&body.medium);
        Self {
            field: field.turned(),
            body,
            media: Media::new(medium, volume, field.pyramid(), geometry),
            size: volume.world_bounds().size().length(),
        }
    }

    /// Albedos of the layers; none where that of the medium is fixed.
    pub(super) fn nodes(&self) -> &'a [f64] {
        &self.body.nodes
    }
}

impl<T: Sample> Path<'_, '_, T> {
    /// A pair of random numbers of a step within the solid.
    fn pair_within(&self, step: u32, which: u32) -> [f32; 2] {
        self.sampler.pair(self.index, FIRST_PAIR + 2 * step + which)
    }

    /// Reflects a path at the boundary or takes it through the solid; where it goes on outside, `None` where it ended.
    pub(super) fn at_body(
        &mut self,
        arrival: Arrival,
        found: &mut Found,
        level: &mut Counts,
        counts: &mut SceneCounts,
    ) -> Option<(Origin, DVec3)> {
        let Arrival { start, normal, direction } = arrival;
        let body = self.world.body.as_ref()?;
        let cosine = -direction.dot(normal);
        let origin = self.world.on_level(0, start);
        let ratio = 1.0 / body.body.index;
        let u = f64::from(self.pair_within(self.steps, 1)[1]);
        self.steps += 1;
        let inward = match fresnel(cosine, ratio) {
            Some((reflectance, beyond)) if cosine > 0.0 && u >= reflectance => {
                ratio * direction + (ratio * cosine - beyond) * normal
            }
            _ => return Some((origin, (direction + 2.0 * cosine.max(0.0) * normal).normalize_or(normal))),
        };
        let inward = inward.normalize_or(-normal);
        // The smoothed normal that a path begins about and its facet may disagree: it begins on the inner side of both.
        let facet = self.world.normal(0, &start.at).map_or(normal, |n| n.vec().as_dvec3());
        let outward = inward.dot(facet).max(0.0);
        let inward = (inward - 2.0 * outward * facet).normalize_or(-facet);
        self.within_body(origin.in_world, Some(start), inward, found, level, counts)
    }

    /// Takes a path through the solid, from a point of its boundary or of the border of the box.
    pub(super) fn within_body(
        &mut self,
        in_world: DVec3,
        on: Option<Start>,
        direction: DVec3,
        found: &mut Found,
        level: &mut Counts,
        counts: &mut SceneCounts,
    ) -> Option<(Origin, DVec3)> {
        let (world, isovalue) = (self.world, self.isovalues[0]);
        let Inside { field, body, media, size } = world.body.as_ref()?;
        let (mut point, mut direction) = (in_world, direction);
        let mut start = match on {
            Some(start) => start,
            None => Start::beside(field.locate(world.placement.in_grid(point, direction).0.to_array())),
        };
        counts.entries += 1;
        for _ in 0..MOST_STEPS {
            let step = self.steps;
            self.steps += 1;
            let outcome = field.trace(isovalue, &start, field.direction_in_grid(direction.as_vec3()), level);
            let border = world.placement.span(point, direction).map_or(0.0, |(_, leave)| leave.max(0.0));
            let end = match &outcome {
                Outcome::Hit(hit) => (world.placement.in_world(&hit.at) - point).dot(direction).max(0.0),
                Outcome::Escaped => border,
                Outcome::Lost => 0.0,
            };
            let [u, v] = self.pair_within(step, 0);
            let flight = (point, direction, end);
            let collision = self.in_body.fly_by(media, flight, &|_| f64::from(u), counts);
            if let Some(Collision { distance, albedo, medium, .. }) = collision {
                point += distance * direction;
                if body.nodes.is_empty() {
                    (0..3).for_each(|c| self.weight[c] *= albedo[c]);
                } else {
                    self.orders += 1;
                }
                let largest = self.carried().into_iter().fold(0.0, f64::max);
                found.turned(On::Medium(0), point);
                let outcome = self.in_body.collided(largest, v);
                self.go_on(outcome, found)?;
                let scatter = Scatter::Medium { onward: direction, medium };
                direction = scatter.sample(media, self.pair_within(step, 1)).0;
                start = Start::beside(field.locate(world.placement.in_grid(point, direction).0.to_array()));
                continue;
            }
            match outcome {
                Outcome::Escaped => {
                    let in_world = point + (border + BEYOND * size) * direction;
                    return Some((Origin { place: Place::Free, in_world }, direction));
                }
                Outcome::Lost => {
                    found.lost += 1;
                    found.ended(PathEnd::Lost);
                    return None;
                }
                Outcome::Hit(hit) => {
                    let Some(normal) = world.normal(0, &hit.at) else {
                        found.lost += 1;
                        found.ended(PathEnd::Lost);
                        return None;
                    };
                    let normal: DVec3 = Normal::vec(normal).as_dvec3();
                    let cosine = direction.dot(normal).max(0.0);
                    start = Start::on(hit.at);
                    let origin = world.on_level(0, start);
                    point = origin.in_world;
                    found.turned(On::LevelSet(0), point);
                    match fresnel(cosine, body.index) {
                        Some((reflectance, beyond)) if f64::from(v) >= reflectance => {
                            let out = body.index * direction + (beyond - body.index * cosine) * normal;
                            return Some((origin, out.normalize_or(normal)));
                        }
                        _ => direction = (direction - 2.0 * cosine * normal).normalize_or(-normal),
                    }
                }
            }
        }
        found.trapped += 1;
        found.ended(PathEnd::Trapped);
        None
    }
}
