//! Distances to skeletons.

use super::mesh::MeshDistance;
use super::scalar::{Point, Scalar, constant, dot, length_squared, minus, place};
use crate::geom::Bounds;
use glam::DVec3;
use std::sync::Arc;

/// A skeleton.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A point.
    Point(DVec3),
    /// A segment; the reach is interpolated between its ends with the parameter of the nearest point.
    Segment([DVec3; 2]),
    /// Segments in a row. Invariant: at least two points.
    Polyline(Vec<DVec3>),
    /// The disc in the plane through a centre with a unit normal.
    Disc(Round),
    /// Its rim: a torus.
    Circle(Round),
    /// A flat polygon with the unit normal of its plane.
    Polygon(Vec<DVec3>, DVec3),
    /// A box about a centre, with half its sides.
    Box(DVec3, DVec3),
    /// The half-space behind a plane: a point of it and the unit normal that leads out.
    HalfSpace(DVec3, DVec3),
    /// Triangles.
    Mesh(Arc<MeshDistance>),
}

/// A circle in space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Round {
    /// Its centre.
    pub centre: DVec3,
    /// The unit normal of its plane.
    pub normal: DVec3,
    /// Its radius.
    pub radius: f64,
}

impl Round {
    /// Distance from the plane, and squared distance from the axis and itself.
    fn cylindrical<S: Scalar>(&self, p: Point<S>) -> (S, S) {
        let from = minus(p, self.centre);
        let e = dot(from, self.normal);
        let n = constant::<S>(self.normal);
        let w = length_squared([from[0] - e * n[0], from[1] - e * n[1], from[2] - e * n[2]]);
        (e, w.root())
    }
}

/// The squared distance to a segment and the parameter of its nearest point.
#[inline(always)]
pub fn to_segment<S: Scalar>(p: Point<S>, [a, b]: [DVec3; 2]) -> (S, S) {
    let (along, from) = (b - a, minus(p, a));
    let t = dot(from, along / along.length_squared()).clamped(0.0, 1.0);
    let u = constant::<S>(along);
    (length_squared([from[0] - t * u[0], from[1] - t * u[1], from[2] - t * u[2]]), t)
}

fn nearest_segment<S: Scalar>(p: Point<S>, points: impl Iterator<Item = [DVec3; 2]>) -> S {
    points.map(|ends| to_segment(p, ends).0).fold(S::of(f64::INFINITY), |least, d| least.smaller(d))
}

/// The sides of a polygon.
fn sides(points: &[DVec3]) -> impl Iterator<Item = [DVec3; 2]> {
    (0..points.len()).map(|i| [points[i], points[(i + 1) % points.len()]])
}

/// Whether the foot of a point on the plane of a polygon lies inside of it: by the crossings of a ray in the plane.
fn is_over(points: &[DVec3], normal: DVec3, p: DVec3) -> bool {
    // Along the two axes in which the plane is seen largest.
    let away = normal.abs();
    let (i, j) = if away.x >= away.y && away.x >= away.z {
        (1, 2)
    } else if away.y >= away.z {
        (0, 2)
    } else {
        (0, 1)
    };
    let foot = p - normal * (p - points[0]).dot(normal);
    let crosses = |[a, b]: &[DVec3; 2]| {
        (a[j] > foot[j]) != (b[j] > foot[j]) && foot[i] < a[i] + (foot[j] - a[j]) / (b[j] - a[j]) * (b[i] - a[i])
    };
    sides(points).filter(|side| crosses(side)).count() % 2 == 1
}

impl Shape {
    /// The squared distance; of a box and a half-space 0 inside.
    pub fn distance_squared<S: Scalar>(&self, p: Point<S>) -> S {
        match self {
            Self::Point(centre) => length_squared(minus(p, *centre)),
            Self::Segment(ends) => to_segment(p, *ends).0,
            Self::Polyline(points) => nearest_segment(p, points.windows(2).map(|w| [w[0], w[1]])),
            Self::Disc(disc) => {
                let (e, w) = disc.cylindrical(p);
                e * e + w.plus(-disc.radius).larger(S::of(0.0)).squared()
            }
            Self::Circle(circle) => {
                let (e, w) = circle.cylindrical(p);
                e * e + w.plus(-circle.radius).squared()
            }
            Self::Polygon(points, normal) => match is_over(points, *normal, place(p)) {
                true => dot(minus(p, points[0]), *normal).squared(),
                false => nearest_segment(p, sides(points)),
            },
            Self::Box(centre, half) => {
                let v = beyond(p, *centre, *half);
                length_squared(v.map(|v| v.larger(S::of(0.0))))
            }
            Self::HalfSpace(point, normal) => dot(minus(p, *point), *normal).larger(S::of(0.0)).squared(),
            Self::Mesh(mesh) => mesh.signed(p).larger(S::of(0.0)).squared(),
        }
    }

    /// The distance; negative inside of what has an inside.
    pub fn distance<S: Scalar>(&self, p: Point<S>) -> S {
        match self {
            Self::Box(centre, half) => {
                let v = beyond(p, *centre, *half);
                let outside = length_squared(v.map(|v| v.larger(S::of(0.0)))).root();
                outside + v[0].larger(v[1]).larger(v[2]).smaller(S::of(0.0))
            }
            Self::HalfSpace(point, normal) => dot(minus(p, *point), *normal),
            Self::Mesh(mesh) => mesh.signed(p),
            _ => self.distance_squared(p).root(),
        }
    }

    /// Whether every point within a distance of the skeleton, whatever the distance, makes a convex set.
    pub fn is_convex(&self) -> bool {
        match self {
            Self::Point(_) | Self::Segment(_) | Self::Disc(_) | Self::Box(..) | Self::HalfSpace(..) => true,
            Self::Polygon(points, _) => points.len() == 3,
            Self::Polyline(_) | Self::Circle(_) | Self::Mesh(_) => false,
        }
    }

    /// The box around the skeleton.
    pub fn bounds(&self) -> Bounds {
        let around = |points: &[DVec3]| points.iter().fold(Bounds::EMPTY, |all, p| all.including(*p));
        match self {
            Self::Point(centre) => around(&[*centre]),
            Self::Segment(ends) => around(ends),
            Self::Polyline(points) | Self::Polygon(points, _) => around(points),
            Self::Disc(round) | Self::Circle(round) => {
                let n = round.normal;
                let half = round.radius * (DVec3::ONE - n * n).max(DVec3::ZERO).map(f64::sqrt);
                Bounds { min: round.centre - half, max: round.centre + half }
            }
            Self::Box(centre, half) => Bounds { min: *centre - *half, max: *centre + *half },
            Self::HalfSpace(..) => Bounds { min: DVec3::NEG_INFINITY, max: DVec3::INFINITY },
            Self::Mesh(mesh) => mesh.bounds(),
        }
    }
}

/// |p − c| − b along each axis.
fn beyond<S: Scalar>(p: Point<S>, centre: DVec3, half: DVec3) -> Point<S> {
    let from = minus(p, centre);
    std::array::from_fn(|axis| from[axis].magnitude().plus(-half[axis]))
}
