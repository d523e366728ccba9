//! Where a model has its isovalue on a segment, such as an edge of a grid: what isosurfaces of models are moved onto, and what
//! polygonizers are compared by.

use super::tree::Tree;
use glam::DVec3;

/// How the root on a segment is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RootFinder {
    /// Linear between the ends: one step.
    Linear,
    /// Regula falsi by the Illinois rule: the value at an end that stays twice in a row is halved, else that end would stay
    /// for ever where the field is curved.
    RegulaFalsi,
    /// Newton's steps with the model's gradient, halves of the bracket where they leave it or shorten it too little.
    Newton,
}

impl RootFinder {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Linear, Self::RegulaFalsi, Self::Newton];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::RegulaFalsi => "regula falsi",
            Self::Newton => "newton",
        }
    }
}

/// Part of a segment below which a bracket is a point. Positions in single precision are 2⁻²⁴ of their size apart.
const NARROW: f64 = 1e-12;
/// Evaluations after which brackets are halved and nothing else.
const FAST: u32 = 40;
/// Most evaluations: halving alone needs 40 for [`NARROW`].
const MOST: u32 = FAST + 40;

/// A point of a segment at which a model has a value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Root {
    /// Where: 0 at the start, 1 at the end; `None` where the values at these are not of different signs, or one between is no
    /// number.
    pub along: Option<f64>,
    /// Evaluations of the model, those at the ends not counted.
    pub evaluations: u32,
}

/// The root of f − iso from `start` to `end`, where it has the `values`, or a place at which it jumps past 0: but for
/// [`RootFinder::Linear`] within 10⁻¹² of the segment.
pub fn root_on_segment(tree: &Tree, iso: f64, [start, end]: [DVec3; 2], values: [f64; 2], finder: RootFinder) -> Root {
    let [low, high] = values.map(|v| v - iso);
    // One that is exactly 0 counts as outside, as samples do.
    if !(low.is_finite() && high.is_finite()) || (low > 0.0) == (high > 0.0) {
        return Root { along: None, evaluations: 0 };
    }
    let at = |t: f64| start + (end - start) * t;
    let secant = |[a, b]: [f64; 2], [fa, fb]: [f64; 2]| a + (b - a) * (fa / (fa - fb));
    let (mut ends, mut signed) = ([0.0, 1.0], [low, high]);
    let mut t = secant(ends, signed).clamp(0.0, 1.0);
    let mut evaluations = 0;
    if finder == RootFinder::Linear {
        return Root { along: Some(t), evaluations };
    }
    // Which end stayed last.
    let mut stayed = None;
    let mut before = 1.0;
    loop {
        evaluations += 1;
        let (value, slope) = match finder {
            RootFinder::Newton => {
                let (value, gradient) = tree.value_and_gradient(at(t));
                (value - iso, gradient.dot(end - start))
            }
            _ => (tree.value(at(t)) - iso, 0.0),
        };
        if !value.is_finite() {
            return Root { along: None, evaluations };
        }
        // One that is exactly 0 counts as outside here, too: it may touch the isovalue beside the root.
        let moved = usize::from((value > 0.0) == (signed[1] > 0.0));
        (ends[moved], signed[moved]) = (t, value);
        let other = 1 - moved;
        if finder == RootFinder::RegulaFalsi && stayed == Some(other) {
            signed[other] *= 0.5;
        }
        stayed = Some(other);
        let width = ends[1] - ends[0];
        let middle = 0.5 * (ends[0] + ends[1]);
        let next = match finder {
            RootFinder::Newton => t - value / slope,
            _ => secant(ends, signed),
        };
        // A slope of 0 gives no number.
        let is_inside = next >= ends[0] && next <= ends[1];
        if width <= NARROW || evaluations >= MOST {
            // Rounding may put it a little beside.
            t = if next.is_finite() { next.clamp(ends[0], ends[1]) } else { middle };
            break;
        }
        // A short step alone says nothing of the root: the field may be flat here, or steep. It is made long enough to pass the
        // root where that is as near as the step, which ends the bracket; where it is not, halving goes on.
        let step = (next - t).abs().max(0.5 * NARROW);
        let is_good = is_inside && step < 0.5 * before && evaluations < FAST;
        before = if is_good { step } else { width };
        t = if is_good { t + step.copysign(ends[other] - t) } else { middle };
    }
    Root { along: Some(t), evaluations }
}
