//! Leaves: what has a value without other nodes.

use super::convolution::Convolution;
use super::falloff::Falloff;
use super::formula::Formula;
use super::grid::Grid;
use super::interval::Interval;
use super::rbf::Rbf;
use super::sample::Points;
use super::scalar::{Point, Scalar, constant, length_squared, minus};
use super::shape::{Shape, to_segment};
use super::warp::Region;
use crate::geom::Bounds;
use glam::DVec3;
use std::sync::Arc;

/// A primitive or another leaf.
#[derive(Clone, Debug)]
pub enum Leaf {
    /// A fall-off of the distance to a skeleton.
    Skeletal(Skeletal),
    /// radius − distance: solid is what is nearer than the radius, at isovalue 0.
    Distance(Shape, f64),
    /// ½ − e/(2 R) of the signed distance e, clamped to \[0, 1\]: half-spaces, and meshes as densities.
    Ramp(Shape, f64),
    /// A convolution surface.
    Convolution(Convolution),
    /// A function through points.
    Rbf(Arc<Rbf>),
    /// A formula.
    Formula(Arc<Formula>),
    /// Samples of a grid.
    Grid(Arc<Grid>),
}

/// A fall-off of the distance to a skeleton.
#[derive(Clone, Debug)]
pub struct Skeletal {
    /// The skeleton.
    pub shape: Shape,
    /// The distance at which r is 1: at the first and at the last end of a segment, equal for all else.
    pub reach: [f64; 2],
    /// How it falls.
    pub falloff: Falloff,
    /// What it is multiplied by; negative to carve.
    pub weight: f64,
}

impl Skeletal {
    /// r².
    #[inline(always)]
    fn square<S: Scalar>(&self, p: Point<S>) -> S {
        let [first, last] = self.reach;
        match &self.shape {
            Shape::Segment(ends) if first != last => {
                let (square, t) = to_segment(p, *ends);
                square / t.scaled(last - first).plus(first).squared()
            }
            shape => shape.distance_squared(p).scaled(1.0 / (first * first)),
        }
    }

    fn value<S: Scalar>(&self, p: Point<S>) -> S {
        self.falloff.of_square(self.square(p)).scaled(self.weight)
    }

    /// The values at many points: the same operations in loops that the compiler turns into vectors.
    fn fill(&self, points: &Points, out: &mut [f64]) {
        let scale = 1.0 / (self.reach[0] * self.reach[0]);
        match &self.shape {
            Shape::Point(centre) => {
                let centre = *centre;
                points.map(out, |p| length_squared(minus(p, centre)) * scale);
            }
            Shape::Segment(ends) if self.reach[0] == self.reach[1] => {
                let ends = *ends;
                points.map(out, |p| to_segment(p, ends).0 * scale);
            }
            _ => points.map(out, |p| self.square(p)),
        }
        let weight = self.weight;
        let of_square = |out: &mut [f64], falloff: Falloff| {
            for value in out {
                *value = falloff.of_square(*value) * weight;
            }
        };
        match self.falloff {
            Falloff::Soft => of_square(out, Falloff::Soft),
            Falloff::Wyvill => of_square(out, Falloff::Wyvill),
            other => of_square(out, other),
        }
    }

    fn bounds(&self, region: &Region) -> Interval {
        let distance = distance_in(&self.shape, region, false);
        let reach = self.reach[0].max(self.reach[1]);
        let least = self.reach[0].min(self.reach[1]);
        let square = |d: f64, reach: f64, margin: f64| d * d / (reach * reach) * margin;
        let near = self.falloff.of_square(square(distance.low, reach, 1.0 - 1e-9));
        let far = self.falloff.of_square(square(distance.high, least, 1.0 + 1e-9));
        let values =
            if near == 0.0 { Interval::at(0.0) } else { Interval::new(far * (1.0 - 1e-9), near * (1.0 + 1e-9)) };
        // Zero stays exactly zero.
        if self.weight >= 0.0 {
            Interval::new(values.low * self.weight, values.high * self.weight)
        } else {
            Interval::new(values.high * self.weight, values.low * self.weight)
        }
    }
}

/// The range of the distance in a box: it changes by no more than one moves.
fn distance_in(shape: &Shape, region: &Region, signed: bool) -> Interval {
    let radius = region.radius();
    if !radius.is_finite() {
        return Interval::new(if signed { f64::NEG_INFINITY } else { 0.0 }, f64::INFINITY);
    }
    let p = constant::<f64>(region.centre);
    let d = if signed { shape.distance(p) } else { shape.distance_squared(p).sqrt() };
    let range = Interval::new(d - radius, d + radius);
    let margin = 1e-11 * (d.abs() + radius + region.centre.length());
    let range = Interval::new(range.low - margin, range.high + margin);
    if signed { range } else { Interval::new(range.low.max(0.0), range.high) }
}

fn ramp<S: Scalar>(distance: S, width: f64) -> S {
    distance.scaled(-0.5 / width).plus(0.5).clamped(0.0, 1.0)
}

impl Leaf {
    /// The value at a point.
    pub fn value<S: Scalar>(&self, p: Point<S>) -> S {
        match self {
            Self::Skeletal(skeletal) => skeletal.value(p),
            Self::Distance(shape, radius) => S::of(*radius) - shape.distance(p),
            Self::Ramp(shape, width) => ramp(shape.distance(p), *width),
            Self::Convolution(convolution) => convolution.value(p),
            Self::Rbf(rbf) => rbf.value(p),
            Self::Formula(formula) => formula.value(p),
            Self::Grid(grid) => grid.value(p),
        }
    }

    /// The values at many points.
    pub fn fill(&self, points: &Points, out: &mut [f64]) {
        match self {
            Self::Skeletal(skeletal) => skeletal.fill(points, out),
            Self::Distance(shape, radius) => points.map(out, |p| radius - shape.distance(p)),
            Self::Ramp(shape, width) => points.map(out, |p| ramp(shape.distance(p), *width)),
            Self::Convolution(convolution) => points.map(out, |p| convolution.value(p)),
            Self::Rbf(rbf) => points.map(out, |p| rbf.value(p)),
            Self::Formula(formula) => formula.fill(points, out),
            Self::Grid(grid) => points.map(out, |p| grid.value(p)),
        }
    }

    /// Where the values in a box lie. A range of one number means that all of them have its bits.
    pub fn bounds(&self, region: &Region) -> Interval {
        match self {
            Self::Skeletal(skeletal) => skeletal.bounds(region),
            Self::Distance(shape, radius) => {
                let d = distance_in(shape, region, true);
                Interval::new(radius - d.high, radius - d.low).widened()
            }
            Self::Ramp(shape, width) => {
                let d = distance_in(shape, region, true);
                let at = |d: f64| 0.5 - 0.5 * d / width;
                let (low, high) = (at(d.high), at(d.low));
                if low > 1.0 + 1e-9 {
                    Interval::at(1.0)
                } else if high < -1e-9 {
                    Interval::at(0.0)
                } else {
                    Interval::new((low - 1e-9).max(0.0), (high + 1e-9).min(1.0))
                }
            }
            Self::Convolution(convolution) => convolution.bounds(region),
            Self::Rbf(_) => Interval::ALL,
            Self::Formula(formula) => formula.bounds(region),
            Self::Grid(grid) => grid.range_in(region),
        }
    }

    /// The box outside of which the value is 0 (of a distance: that of the body at radius); infinite where there is none. With
    /// `of_body` that outside of which nothing is solid: the value may be another than 0 there.
    pub fn support(&self, of_body: bool) -> Bounds {
        let all = Bounds { min: DVec3::NEG_INFINITY, max: DVec3::INFINITY };
        let grown = |bounds: Bounds, by: f64| Bounds { min: bounds.min - by, max: bounds.max + by };
        match self {
            Self::Skeletal(skeletal) => {
                let reach = skeletal.reach[0].max(skeletal.reach[1]) * skeletal.falloff.support_squared().sqrt();
                grown(skeletal.shape.bounds(), reach)
            }
            Self::Distance(shape, radius) => grown(shape.bounds(), radius.max(0.0)),
            Self::Ramp(shape, width) => grown(shape.bounds(), *width),
            Self::Convolution(convolution) => convolution.support(),
            Self::Grid(grid) if of_body || grid.is_zero_beyond() => grid.bounds(),
            Self::Grid(_) | Self::Rbf(_) | Self::Formula(_) => all,
        }
    }

    /// Whether {value > c} is convex for every c.
    pub fn is_convex(&self) -> bool {
        match self {
            // A segment with two reaches is re-entrant at its small end.
            Self::Skeletal(s) => s.shape.is_convex() && s.reach[0] == s.reach[1] && s.weight > 0.0,
            Self::Distance(shape, _) | Self::Ramp(shape, _) => shape.is_convex(),
            _ => false,
        }
    }

    /// Whether it is a half-space at every isovalue.
    pub fn is_half_space(&self) -> bool {
        matches!(self, Self::Distance(Shape::HalfSpace(..), _) | Self::Ramp(Shape::HalfSpace(..), _))
    }
}
