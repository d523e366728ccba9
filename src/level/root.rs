//! The root of a cubic in a bracket that holds exactly one: Newton, safeguarded by bisection (Press et al. 2007,
//! Numerical Recipes, section 9.4).
//!
//! One root is a chain of operations that each wait for the last. So the rays of a bounce are marched first, and the
//! roots at their hits found together: [`roots`] does the operations of [`Bracket::root`] on several cubics side by
//! side, bit for bit.

use super::cell::Cubic;
use glam::{BVec4A, Mat4, Vec4};

/// A piece of [0, 1] where a cubic goes from ≤ 0 to > 0 and has one root.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bracket {
    /// The cubic.
    pub cubic: Cubic,
    /// Where the cubic is ≤ 0.
    pub low: f32,
    /// Where it is above 0; equal to `low` where the root is known.
    pub high: f32,
}

// The bracket is narrow enough, of the segment.
const TOLERANCE: f32 = 1.0 / 4_194_304.0;
// A Newton step of this length leaves its square behind, or at a nearly double root its own length.
const LAST_STEP: f32 = 1.0 / 16_384.0;
// At worst 24 bisections and as many Newton steps.
const MOST_STEPS: usize = 48;

/// Value and derivative at t.
#[inline(always)]
pub(super) fn evaluate(b: &Cubic, t: f32) -> (f32, f32) {
    let mix = |x: f32, y: f32| x + (y - x) * t;
    let (b01, b12, b23) = (mix(b[0], b[1]), mix(b[1], b[2]), mix(b[2], b[3]));
    let (b012, b123) = (mix(b01, b12), mix(b12, b23));
    (mix(b012, b123), 3.0 * (b123 - b012))
}

impl Bracket {
    /// The root: the bracket shrinks below 2⁻²² of the segment, or Newton's last step is shorter than 2⁻¹⁴ of it, which
    /// leaves its square behind. An empty bracket gives its place.
    pub fn root(&self) -> f32 {
        let Self { cubic: b, mut low, mut high } = *self;
        // Most brackets hold a nearly straight piece: begin where the chord crosses 0, but clear of the ends, where
        // rounding may show the wrong sign.
        let (at_low, at_high) = (if low == 0.0 { b[0] } else { evaluate(&b, low).0 }, evaluate(&b, high).0);
        let chord = at_low / (at_low - at_high);
        let mut t = low + (high - low) * if chord.is_finite() { chord.clamp(0.1, 0.9) } else { 0.5 };
        let mut last_width = high - low;
        for _ in 0..MOST_STEPS {
            let (f, slope) = evaluate(&b, t);
            if f > 0.0 {
                high = t;
            } else {
                low = t;
            }
            if high - low <= TOLERANCE {
                break;
            }
            let newton = t - f / slope;
            let width = (newton - t).abs();
            // NaN or a step out of the bracket, or too slow: bisect, after which Newton may be fast again. The ends belong
            // to the bracket: once t is the root, the step is 0 and ends at the end that has just been set.
            if newton >= low && newton <= high && width < 0.5 * last_width {
                if width <= LAST_STEP {
                    return newton;
                }
                t = newton;
                last_width = width;
            } else {
                last_width = 0.5 * (high - low);
                t = low + last_width;
            }
        }
        t
    }
}

/// Brackets that [`roots`] works on together: two vectors of four, so that one is worked on while the other waits.
pub(super) const LANES: usize = 8;

/// The [`Bracket::root`] of each bracket.
#[inline(always)]
pub(super) fn roots(brackets: &[Bracket; LANES]) -> [f32; LANES] {
    let (front, back) = brackets.split_at(4);
    let mut groups = [Lanes::new(front), Lanes::new(back)];
    for _ in 0..MOST_STEPS {
        let mut all_done = true;
        for group in &mut groups {
            group.step();
            all_done &= group.done.all();
        }
        if all_done {
            break;
        }
    }
    bytemuck::cast([groups[0].t, groups[1].t])
}

/// Four brackets on their way to their roots.
struct Lanes {
    b: [Vec4; 4],
    low: Vec4,
    high: Vec4,
    t: Vec4,
    last_width: Vec4,
    done: BVec4A,
}

impl Lanes {
    #[inline(always)]
    fn new(brackets: &[Bracket]) -> Self {
        let cubic = |i: usize| Vec4::from_array(brackets[i].cubic);
        let turned = Mat4::from_cols(cubic(0), cubic(1), cubic(2), cubic(3)).transpose();
        let b = [turned.x_axis, turned.y_axis, turned.z_axis, turned.w_axis];
        let low = Vec4::new(brackets[0].low, brackets[1].low, brackets[2].low, brackets[3].low);
        let high = Vec4::new(brackets[0].high, brackets[1].high, brackets[2].high, brackets[3].high);
        let at_low = Vec4::select(low.cmpeq(Vec4::ZERO), b[0], evaluate_lanes(&b, low).0);
        let at_high = evaluate_lanes(&b, high).0;
        let chord = at_low / (at_low - at_high);
        let clear = chord.min(Vec4::splat(0.9)).max(Vec4::splat(0.1));
        let part = Vec4::select(chord.is_finite_mask(), clear, Vec4::splat(0.5));
        Self { b, low, high, t: low + (high - low) * part, last_width: high - low, done: BVec4A::default() }
    }

    /// One step of [`Bracket::root`] in every lane that is not done.
    #[inline(always)]
    fn step(&mut self) {
        let t = self.t;
        let (f, slope) = evaluate_lanes(&self.b, t);
        let above = f.cmpgt(Vec4::ZERO);
        self.high = Vec4::select(above, t, self.high);
        self.low = Vec4::select(above, self.low, t);
        let closed = (self.high - self.low).cmple(Vec4::splat(TOLERANCE));
        let newton = t - f / slope;
        let width = (newton - t).abs();
        let good = newton.cmpge(self.low) & newton.cmple(self.high) & width.cmplt(Vec4::splat(0.5) * self.last_width);
        let half = Vec4::splat(0.5) * (self.high - self.low);
        let next = Vec4::select(good, newton, self.low + half);
        self.last_width = Vec4::select(good, width, half);
        let stays = self.done | closed;
        self.t = Vec4::select(stays, t, next);
        self.done = stays | (good & width.cmple(Vec4::splat(LAST_STEP)));
    }
}

/// [`evaluate`] in four lanes.
#[inline(always)]
fn evaluate_lanes(b: &[Vec4; 4], t: Vec4) -> (Vec4, Vec4) {
    let mix = |x: Vec4, y: Vec4| x + (y - x) * t;
    let (b01, b12, b23) = (mix(b[0], b[1]), mix(b[1], b[2]), mix(b[2], b[3]));
    let (b012, b123) = (mix(b01, b12), mix(b12, b23));
    (mix(b012, b123), 3.0 * (b123 - b012))
}
