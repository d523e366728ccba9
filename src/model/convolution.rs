//! Convolution surfaces of segments in closed form (Sherstyuk 1999): F(p) = N ∫ kernel(|p − s|) ds. A skeleton that is cut
//! in pieces has the same field: no bulges where they meet.

use super::interval::Interval;
use super::scalar::{Point, Scalar, constant, dot, length_squared, minus};
use super::shape::to_segment;
use super::warp::Region;
use crate::geom::Bounds;
use glam::DVec3;
use std::f64::consts::PI;

/// How a point of the skeleton acts on its surroundings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kernel {
    /// (1 − r²/R²)³ for r < R.
    Wyvill,
    /// e^(−a r²/R²).
    Gaussian(f64),
    /// (1 + k² r²/R²)⁻².
    Cauchy(f64),
}

/// The field of a segment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Convolution {
    /// Where it begins and ends; not the same point.
    pub ends: [DVec3; 2],
    /// The kernel.
    pub kernel: Kernel,
    /// R.
    pub reach: f64,
    /// N.
    pub norm: f64,
}

impl Kernel {
    /// The N with which an infinite straight line has the field 1 on itself.
    pub fn norm_of_line(self, reach: f64) -> f64 {
        match self {
            Self::Wyvill => 35.0 / (32.0 * reach),
            Self::Gaussian(a) => (a / PI).sqrt() / reach,
            Self::Cauchy(k) => 2.0 * k / (PI * reach),
        }
    }

    /// The same of an infinite plane.
    pub fn norm_of_plane(self, reach: f64) -> f64 {
        match self {
            Self::Wyvill => 4.0 / (PI * reach * reach),
            Self::Gaussian(a) => a / (PI * reach * reach),
            Self::Cauchy(k) => k * k / (PI * reach * reach),
        }
    }
}

impl Convolution {
    /// The field at a point.
    pub fn value<S: Scalar>(&self, p: Point<S>) -> S {
        let [a, b] = self.ends;
        let length = (b - a).length();
        let direction = (b - a) / length;
        let from = minus(p, a);
        let t = dot(from, direction);
        let u = constant::<S>(direction);
        let square = length_squared([from[0] - t * u[0], from[1] - t * u[1], from[2] - t * u[2]]);
        let (start, end) = (-t, S::of(length) - t);
        match self.kernel {
            Kernel::Wyvill => self.wyvill(square, start, end),
            Kernel::Gaussian(a) => {
                let a = a / (self.reach * self.reach);
                let along = end.scaled(a.sqrt()).error_function() - start.scaled(a.sqrt()).error_function();
                square.scaled(-a).exponential() * along.scaled(0.5 * self.norm * (PI / a).sqrt())
            }
            Kernel::Cauchy(k) => {
                let k = k / self.reach;
                let q_square = square.scaled(k * k).plus(1.0);
                let q = q_square.root();
                let at = |s: S| {
                    let rational = s / (q_square * (q_square + (s * s).scaled(k * k))).scaled(2.0);
                    rational + (s.scaled(k) / q).arc_tangent() / (q * q_square).scaled(2.0 * k)
                };
                (at(end) - at(start)).scaled(self.norm)
            }
        }
    }

    fn wyvill<S: Scalar>(&self, square: S, start: S, end: S) -> S {
        let reach = self.reach;
        let t2 = S::of(reach * reach) - square;
        if t2.value() <= 0.0 {
            return S::of(0.0);
        }
        let t = t2.root();
        let (start, end) = (start.larger(-t), end.smaller(t));
        if end.value() <= start.value() {
            return S::of(0.0);
        }
        let at = |s: S| {
            let s2 = s * s;
            // Horner in s² of T⁶s − T⁴s³ + (3/5)T²s⁵ − s⁷/7.
            s * (t2 * t2 * t2 + s2 * (s2 * (t2.scaled(0.6) - s2.scaled(1.0 / 7.0)) - t2 * t2))
        };
        let r3 = reach * reach * reach;
        (at(end) - at(start)).scaled(self.norm / (r3 * r3))
    }

    /// The range in a box: no more than an infinite line has at the least distance.
    pub fn bounds(&self, region: &Region) -> Interval {
        let radius = region.radius();
        if !radius.is_finite() {
            return Interval::new(0.0, self.most(0.0));
        }
        let distance = to_segment(constant::<f64>(region.centre), self.ends).0.sqrt();
        let least = (distance - radius) * (1.0 - 1e-9) - 1e-12 * region.centre.length();
        if matches!(self.kernel, Kernel::Wyvill) && least >= self.reach * (1.0 + 1e-9) {
            return Interval::at(0.0);
        }
        // Just above 0 where it is not cut off: never exactly 0 by chance.
        Interval::new(-1e-12 * self.most(0.0), self.most(least.max(0.0)) * (1.0 + 1e-9))
    }

    /// The field of an infinite line.
    fn most(&self, distance: f64) -> f64 {
        let r = distance / self.reach;
        let shape = match self.kernel {
            Kernel::Wyvill => libm::pow((1.0 - r * r).max(0.0), 3.5),
            Kernel::Gaussian(a) => libm::exp(-a * r * r),
            Kernel::Cauchy(k) => libm::pow(1.0 + k * k * r * r, -1.5),
        };
        self.norm / self.kernel.norm_of_line(self.reach) * shape + 1e-12 * self.norm * self.reach
    }

    /// The box outside of which it is 0.
    pub fn support(&self) -> Bounds {
        match self.kernel {
            Kernel::Wyvill => {
                let [a, b] = self.ends;
                Bounds { min: a.min(b) - self.reach, max: a.max(b) + self.reach }
            }
            _ => Bounds { min: DVec3::NEG_INFINITY, max: DVec3::INFINITY },
        }
    }
}

/// Nodes and weights of Gauss and Legendre on \[0, 1\] with 16 or 8 points, by Newton's method.
pub fn gauss(count: usize) -> Vec<[f64; 2]> {
    let n = count as f64;
    let legendre = |x: f64| {
        let (mut before, mut here) = (1.0, x);
        for k in 2..=count {
            let k = k as f64;
            (before, here) = (here, ((2.0 * k - 1.0) * x * here - (k - 1.0) * before) / k);
        }
        (here, n * (x * here - before) / (x * x - 1.0))
    };
    (0..count)
        .map(|i| {
            let mut x = -libm::cos(PI * (i as f64 + 0.75) / (n + 0.5));
            for _ in 0..20 {
                let (value, slope) = legendre(x);
                x -= value / slope;
            }
            let (_, slope) = legendre(x);
            [0.5 * (1.0 + x), 1.0 / ((1.0 - x * x) * slope * slope)]
        })
        .collect()
}

/// The segments of a triangle, with weights for N: `count`-point Gauss across, segments along.
pub fn lines_of_triangle([a, b, c]: [DVec3; 3], count: usize) -> Vec<([DVec3; 2], f64)> {
    // Along the longest side, whose direction is that of the segments.
    let sides = [[a, b, c], [b, c, a], [c, a, b]];
    let length = |s: &[DVec3; 3]| (s[1] - s[0]).length_squared();
    let longest = sides.into_iter().fold(sides[0], |best, s| if length(&s) > length(&best) { s } else { best });
    let [a, b, c] = longest;
    let along = (b - a).normalize_or_zero();
    let height = ((c - a) - along * (c - a).dot(along)).length();
    gauss(count).into_iter().map(|[t, weight]| ([a.lerp(c, t), b.lerp(c, t)], weight * height)).collect()
}
