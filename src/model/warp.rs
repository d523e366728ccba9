//! Deformations, as the **inverse** w of what is seen: a node is f(w(p)), its gradient Jᵀ∇f(w(p)) by the chain rule
//! (Barr 1984; printed formulas that put the forward map there deform the other way round).

use super::scalar::{Point, Scalar, constant, place};
use crate::geom::{Affine, Bounds};
use glam::{DMat3, DVec3};

/// A deformation, in axes of its own: `axes[0]` of the world is its x.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Warp {
    /// Which world axes are x, y, z here.
    pub axes: [usize; 3],
    /// The deformation.
    pub kind: Kind,
}

/// What a deformation does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// The world of the child moved by this map.
    Affine(Affine),
    /// About z by rate·z radians.
    Twist {
        /// Radians per unit.
        rate: f64,
    },
    /// Across y: the body is scaled by 1 up to y₀, from there linearly to the scale s₁ at y₁.
    Taper {
        /// y₀ and y₁, y₀ < y₁.
        range: [f64; 2],
        /// s₁ > 0.
        scale: f64,
    },
    /// In the xy plane, with straight ends.
    Bend {
        /// Radians per unit, not 0; either sign.
        rate: f64,
        /// x₀, where the body stays.
        centre: f64,
        /// x₋ and x₊, between which it is bent.
        range: [f64; 2],
    },
}

/// A box as its middle and half its sides; infinite where nothing is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// The middle.
    pub centre: DVec3,
    /// Half the sides.
    pub half: DVec3,
}

impl Region {
    /// Everywhere.
    pub const ALL: Self = Self { centre: DVec3::ZERO, half: DVec3::INFINITY };

    /// A box.
    pub fn of(bounds: &Bounds) -> Self {
        let centre = bounds.centre();
        if centre.is_finite() { Self { centre, half: 0.5 * bounds.size() } } else { Self::ALL }
    }

    /// The distance of its corners from its middle, with a margin for rounding.
    pub fn radius(&self) -> f64 {
        self.half.length() * (1.0 + 1e-12) + 1e-15 * self.centre.length()
    }

    fn ball(centre: DVec3, radius: f64) -> Self {
        let radius = radius * (1.0 + 1e-12) + 1e-14 * centre.length();
        if centre.is_finite() && radius.is_finite() { Self { centre, half: DVec3::splat(radius) } } else { Self::ALL }
    }
}

/// The angle and the place along the ring of a bend.
struct Bent<S> {
    angle: S,
    radius: S,
}

impl Warp {
    /// A map of the whole world; `world_from_child` is the one that is seen.
    pub fn affine(world_from_child: Affine) -> Self {
        Self { axes: [0, 1, 2], kind: Kind::Affine(world_from_child) }
    }

    /// w(p).
    pub fn inverse<S: Scalar>(&self, p: Point<S>) -> Point<S> {
        let [i, j, k] = self.axes;
        let seen = [p[i], p[j], p[k]];
        let [x, y, z] = match self.kind {
            Kind::Affine(map) => return apply(&map.inverse(), p),
            Kind::Twist { rate } => {
                let [x, y, z] = seen;
                let (sine, cosine) = (z.scaled(rate).sine(), z.scaled(rate).cosine());
                [x * cosine + y * sine, y * cosine - x * sine, z]
            }
            Kind::Taper { range, scale } => {
                let [x, y, z] = seen;
                let s = scale_at(y, range, scale);
                [x / s, y, z / s]
            }
            Kind::Bend { rate, centre, range } => unbend(seen, rate, centre, range),
        };
        let mut out = p;
        (out[i], out[j], out[k]) = (x, y, z);
        out
    }

    /// What is seen: the p with w(p) = q.
    pub fn forward(&self, q: DVec3) -> DVec3 {
        let [i, j, k] = self.axes;
        let (x, y, z) = (q[i], q[j], q[k]);
        let seen = match self.kind {
            Kind::Affine(map) => return map.point(q),
            Kind::Twist { rate } => {
                let (sine, cosine) = libm::sincos(rate * z);
                [x * cosine - y * sine, x * sine + y * cosine, z]
            }
            Kind::Taper { range, scale } => {
                let s = scale_at(y, range, scale);
                [x * s, y, z * s]
            }
            Kind::Bend { rate, centre, range } => {
                let bent = x.clamp(range[0], range[1]);
                let angle = rate * (bent - centre);
                let (sine, cosine) = libm::sincos(angle);
                let radius = 1.0 / rate - y;
                [centre + radius * sine + (x - bent) * cosine, 1.0 / rate - radius * cosine + (x - bent) * sine, z]
            }
        };
        let mut out = q;
        (out[i], out[j], out[k]) = (seen[0], seen[1], seen[2]);
        out
    }

    /// A box that holds w(p) for every p of a box.
    pub fn inverse_region(&self, region: &Region) -> Region {
        if !region.half.is_finite() {
            return Region::ALL;
        }
        if let Kind::Affine(map) = self.kind {
            let inverse = map.inverse();
            let columns = inverse.linear().to_cols_array_2d().map(|column| DVec3::from_array(column).abs());
            let half = DMat3::from_cols(columns[0], columns[1], columns[2]) * region.half;
            let centre = inverse.point(region.centre);
            let margin = 1e-12 * (half.length() + centre.length() + inverse.offset().length());
            return Region { centre, half: half + margin };
        }
        let [i, j, k] = self.axes;
        let (low, high) = (region.centre - region.half, region.centre + region.half);
        let farthest = |axis: usize, from: f64| (low[axis] - from).abs().max((high[axis] - from).abs());
        let nearest = |axis: usize, from: f64| {
            if low[axis] <= from && from <= high[axis] {
                0.0
            } else {
                (low[axis] - from).abs().min((high[axis] - from).abs())
            }
        };
        // w moves points apart by at most this factor: the norm of J.
        let stretch = match self.kind {
            Kind::Affine(_) => return Region::ALL,
            Kind::Twist { rate } => 1.0 + rate.abs() * farthest(i, 0.0).hypot_of(farthest(j, 0.0)),
            Kind::Taper { range, scale } => {
                let least = scale.min(1.0);
                let slope = ((scale - 1.0) / (range[1] - range[0])).abs();
                let across = farthest(i, 0.0).hypot_of(farthest(k, 0.0));
                // With the kinks at y₀ and y₁ the norm of either side counts.
                (1.0 / least).max(1.0) + slope * across / (least * least)
            }
            Kind::Bend { rate, centre, range } => {
                let middle = 1.0 / rate;
                let radius = nearest(i, centre).hypot_of(nearest(j, middle));
                let box_in_plane = [[low[i] - centre, high[i] - centre], [middle - high[j], middle - low[j]]];
                if radius == 0.0 || meets_cut(rate, range.map(|end| rate * (end - centre)), box_in_plane) {
                    return Region { half: bent_half(region, self.axes), ..*region };
                }
                (1.0 / (rate.abs() * radius)).max(1.0)
            }
        };
        let centre = place(self.inverse(constant::<f64>(region.centre)));
        let radius = region.half.length() * stretch;
        let mut out = Region::ball(centre, radius);
        if let Kind::Twist { .. } | Kind::Bend { .. } = self.kind {
            out.centre[k] = region.centre[k];
            out.half[k] = region.half[k];
        } else {
            out.centre[j] = region.centre[j];
            out.half[j] = region.half[j];
        }
        out
    }

    /// Whether what this does is a rigid motion, perhaps with a uniform scale: distances stay distances.
    pub fn is_convexity_kept(&self) -> bool {
        matches!(self.kind, Kind::Affine(_))
    }
}

/// Where w is known in z alone.
fn bent_half(region: &Region, axes: [usize; 3]) -> DVec3 {
    let mut half = DVec3::INFINITY;
    half[axes[2]] = region.half[axes[2]];
    half
}

/// Whether a box meets the half-line from the axis of a bend on which its two straight ends meet, and w jumps. The box is
/// that of (x − x₀, 1/k − y).
fn meets_cut(rate: f64, ends: [f64; 2], [along, below]: [[f64; 2]; 2]) -> bool {
    let (sine, cosine) = libm::sincos(0.5 * (ends[0] + ends[1]) + std::f64::consts::PI);
    let direction = [rate.signum() * sine, rate.signum() * cosine];
    let (mut first, mut last) = (0.0, f64::INFINITY);
    for (d, [low, high]) in direction.into_iter().zip([along, below]) {
        let margin = 1e-9 * (low.abs() + high.abs());
        let (low, high) = (low - margin, high + margin);
        if d.abs() < 1e-12 {
            // Nearly parallel: it counts as meeting where the box is as wide as rounding.
            if low > 1e-9 * last.min(high.abs() + 1.0) || high < -1e-9 * (low.abs() + 1.0) {
                return false;
            }
            continue;
        }
        let (near, far) = if d > 0.0 { (low / d, high / d) } else { (high / d, low / d) };
        first = f64::max(first, near);
        last = f64::min(last, far);
    }
    first <= last
}

trait Hypot {
    fn hypot_of(self, other: f64) -> f64;
}

impl Hypot for f64 {
    fn hypot_of(self, other: f64) -> f64 {
        (self * self + other * other).sqrt()
    }
}

fn apply<S: Scalar>(map: &Affine, p: Point<S>) -> Point<S> {
    let (m, offset) = (map.linear(), map.offset());
    std::array::from_fn(|row| {
        let along = m.row(row);
        (p[0].scaled(along.x) + p[1].scaled(along.y) + p[2].scaled(along.z)).plus(offset[row])
    })
}

fn scale_at<S: Scalar>(y: S, range: [f64; 2], scale: f64) -> S {
    let part = y.plus(-range[0]).scaled(1.0 / (range[1] - range[0])).clamped(0.0, 1.0);
    part.scaled(scale - 1.0).plus(1.0)
}

fn unbend<S: Scalar>([x, y, z]: Point<S>, rate: f64, centre: f64, range: [f64; 2]) -> Point<S> {
    let sign = rate.signum();
    let from = x.plus(-centre);
    let below = S::of(1.0 / rate) - y;
    let Bent { angle, radius } =
        Bent { angle: from.scaled(sign).angle(below.scaled(sign)), radius: (from * from + below * below).root() };
    let ends = range.map(|end| rate * (end - centre));
    let (low, high) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
    // Unwrapped about the middle of the range.
    let middle = 0.5 * (low + high);
    let turns = ((angle.value() - middle) / std::f64::consts::TAU).round();
    let angle = angle.plus(-turns * std::f64::consts::TAU);
    let theta = angle.value();
    if (low..=high).contains(&theta) {
        return [angle.scaled(1.0 / rate).plus(centre), S::of(1.0 / rate) - radius.scaled(sign), z];
    }
    // Beyond the bent range the body goes on straight.
    let end = if theta < low { low } else { high };
    let (sine, cosine) = libm::sincos(end);
    let along = centre + end / rate;
    let x = (from.scaled(cosine) - below.scaled(sine)).plus(along);
    let y = S::of(1.0 / rate) - from.scaled(sine) - below.scaled(cosine);
    [x, y, z]
}
