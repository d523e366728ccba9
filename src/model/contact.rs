//! Precise contact of two bodies (Gascuel 1993): where they would pass through each other both give way, up to a common
//! surface, and bulge around it.
//!
//! Where both fields exceed c: F₁ = f₁ + c − f₂ and F₂ = f₂ + c − f₁, both c where f₁ = f₂. Beside that, where f₂ ≤ c and
//! the distance ϱ to {f₂ = c} is below the width w: F₁ = f₁ + ω h(ϱ), with the slope k = |∇f₂| *of the other body* at the
//! foot, so that the gradient is continuous there. ω fades the bulge where the foot is far from the contact (ours).

use super::interval::Interval;
use super::scalar::{Dual, Point, Scalar, length_squared, place};
use super::tree::Tree;
use crate::geom::Bounds;
use crate::grid3;
use glam::DVec3;

/// Which of the bodies is the field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Show {
    /// The first.
    First,
    /// The second.
    Second,
    /// Both, with a slit of this width in the field: the contact surface itself has no thickness, and no grid holds it.
    Both(f64),
}

/// Two bodies in contact.
#[derive(Clone, Debug)]
pub struct Contact {
    /// c.
    pub iso: f64,
    /// w, the width of the bulge.
    pub width: f64,
    /// Which is shown.
    pub show: Show,
    /// The height M of the bulge of each body: α times the largest f − c of the other in the interpenetration.
    pub height: [f64; 2],
}

/// Share of c over which the bulge fades.
const FADE: f64 = 0.1;
/// Newton steps to the surface of the other body.
const STEPS: usize = 8;
/// Samples along each side of the box in which the depth of the interpenetration is looked for.
const LOOKED_AT: usize = 48;

impl Contact {
    /// A contact; the interpenetration is looked for in a box. `attenuation` is α.
    pub fn new(iso: f64, width: f64, attenuation: f64, show: Show, bodies: [&Tree; 2], bounds: &Bounds) -> Self {
        let mut most = [0.0f64; 2];
        let mut best = [bounds.centre(); 2];
        let mut look = |p: DVec3, best: &mut [DVec3; 2]| {
            let f = bodies.map(|body| body.value(p));
            if f[0] > iso && f[1] > iso {
                for of in 0..2 {
                    if f[of] - iso > most[of] {
                        (most[of], best[of]) = (f[of] - iso, p);
                    }
                }
            }
        };
        let step = bounds.size() / (LOOKED_AT - 1) as f64;
        for at in grid3::all([LOOKED_AT; 3]) {
            look(bounds.min + step * DVec3::from_array(at.map(|i| i as f64)), &mut best);
        }
        // Uphill from the best, by halving steps.
        let mut size = 0.5 * step;
        for _ in 0..24 {
            for centre in best {
                for axis in DVec3::AXES {
                    look(centre + axis * size, &mut best);
                    look(centre - axis * size, &mut best);
                }
            }
            size *= 0.6;
        }
        Self { iso, width, show, height: [attenuation * most[1], attenuation * most[0]] }
    }

    /// Whether the bodies meet.
    pub fn is_touching(&self) -> bool {
        self.height.iter().any(|h| *h > 0.0)
    }

    /// h(ϱ) for ϱ ≥ 0.
    pub fn bulge<S: Scalar>(distance: S, width: S, height: f64, slope: S) -> S {
        let (rho, w, k, m) = (distance, width, slope, S::of(height));
        if rho.value() >= w.value() {
            S::of(0.0)
        } else if rho.value() <= 0.5 * w.value() {
            let (w2, w3) = (w * w, w * w * w);
            let cubic = ((w * k - m.scaled(4.0)) / w3).scaled(4.0);
            let square = ((m.scaled(3.0) - w * k) / w2).scaled(4.0);
            rho * (k + rho * (square + rho * cubic))
        } else {
            (m.scaled(4.0) / (w * w * w)) * (rho - w).squared() * (rho.scaled(4.0) - w)
        }
    }

    /// The field at a point, from the two nodes of a tree.
    pub(super) fn value<S: Scalar>(&self, tree: &Tree, of: [u32; 2], p: Point<S>) -> S {
        match self.show {
            Show::First => self.body(tree, of, 0, p),
            Show::Second => self.body(tree, of, 1, p),
            Show::Both(gap) => {
                let both = self.body(tree, of, 0, p).larger(self.body(tree, of, 1, p));
                let apart = (tree.eval(of[0], p) - tree.eval(of[1], p)).magnitude();
                both.smaller(apart.plus(self.iso - gap))
            }
        }
    }

    fn body<S: Scalar>(&self, tree: &Tree, of: [u32; 2], which: usize, p: Point<S>) -> S {
        let (own, other) = (of[which], of[1 - which]);
        let (f, g) = (tree.eval(own, p), tree.eval(other, p));
        let c = self.iso;
        if g.value() > c {
            return if f.value() > c { f.plus(c) - g } else { f };
        }
        match self.deformation(tree, own, other, self.height[which], p) {
            Some(bulge) => f + bulge,
            None => f,
        }
    }

    /// ω h(ϱ), where the surface of the other body is near.
    fn deformation<S: Scalar>(&self, tree: &Tree, own: u32, other: u32, height: f64, p: Point<S>) -> Option<S> {
        let c = self.iso;
        if height <= 0.0 {
            return None;
        }
        let at = place(p);
        let up = tree.eval::<Dual>(other, Dual::variables(at)).gradient;
        let direction = up.try_normalize()?;
        // Along the gradient to the surface.
        let (mut s, mut slope) = (0.0, 0.0);
        let mut is_there = false;
        for _ in 0..STEPS {
            let here = tree.eval::<Dual>(other, Dual::variables(at + s * direction));
            slope = here.gradient.dot(direction);
            let off = here.value - c;
            if off.abs() <= 1e-14 * c.abs().max(1e-300) {
                is_there = true;
                break;
            }
            let step = off / slope;
            if !step.is_finite() || (s - step).abs() > 4.0 * self.width {
                return None;
            }
            s -= step;
            is_there = off.abs() <= 1e-9 * c.abs();
        }
        if !is_there || s < 0.0 || s >= self.width {
            return None;
        }
        // The same with derivatives: the direction from one order more, the distance by two steps.
        let higher = tree.eval::<S::Higher>(other, S::Higher::variables(at));
        let gradient = S::slopes(higher, p);
        let length = length_squared(gradient).root();
        let n: Point<S> = std::array::from_fn(|axis| gradient[axis] / length);
        let foot_at = |s: S| -> Point<S> { std::array::from_fn(|axis| p[axis] + s * n[axis]) };
        let mut distance = S::of(s);
        for _ in 0..2 {
            let off = tree.eval(other, foot_at(distance)).plus(-c);
            distance = distance - off.scaled(1.0 / slope);
        }
        let foot = foot_at(distance);
        let k = length_squared(S::slopes(tree.eval(other, S::Higher::variables(place(foot))), foot)).root();
        // A wider bulge would rise above its height.
        let mut width = S::of(self.width);
        if self.width * k.value() > 6.0 * height {
            width = S::of(6.0 * height) / k;
        }
        let near = tree.eval(own, foot);
        let part = near.plus(FADE * c - c).scaled(1.0 / (FADE * c)).clamped(0.0, 1.0);
        let fade = part * part * (S::of(3.0) - part.scaled(2.0));
        Some(fade * Self::bulge(distance.larger(S::of(0.0)), width, height, k))
    }

    pub(super) fn bounds(&self, first: Interval, second: Interval) -> Interval {
        let zero = Interval::at(0.0);
        if first == zero && second == zero {
            // Nothing is near: both fields are flat there.
            return match self.show {
                Show::Both(gap) if gap > self.iso => Interval::new(self.iso - gap - 1e-9, 0.0),
                _ => zero,
            };
        }
        let body = |f: Interval, g: Interval, height: f64| {
            let low = f.low.min(f.low + self.iso - g.high);
            Interval::new(low, f.high + 1.05 * height).widened().around(1e-9 * self.iso)
        };
        let (one, two) = (body(first, second, self.height[0]), body(second, first, self.height[1]));
        match self.show {
            Show::First => one,
            Show::Second => two,
            Show::Both(gap) => {
                let both = one.larger(two);
                Interval::new(both.low.min(self.iso - gap - 1e-9), both.high)
            }
        }
    }
}
