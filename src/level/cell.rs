//! The crossing of a ray segment with the level set inside one cell.
//!
//! On a segment from p to q inside a cell, the trilinear function is a cubic in the parameter
//! t ∈ [0, 1]. Its Bernstein coefficients are the blossom of the trilinear function: with
//! T(u, v, w) the function at mixed coordinates of p and q,
//! b0 = T(p,p,p), b1 = (T(q,p,p) + T(p,q,p) + T(p,p,q))/3, b2 = (T(p,q,q) + T(q,p,q) + T(q,q,p))/3,
//! b3 = T(q,q,q). Coefficients that all lie on one side prove that there is no crossing (convex
//! hull property), which holds under rounding as well because each is a convex combination of
//! corner values. Compare Marmitt et al. 2004, "Fast and accurate ray-voxel intersection
//! techniques for iso-surface ray tracing", who split at the same extrema but in the power
//! basis about the ray origin, which loses the root to cancellation in f32.

use super::root::{Bracket, evaluate};
use glam::{Vec3, Vec4};

/// Bernstein coefficients of a cubic on [0, 1].
pub type Cubic = [f32; 4];

/// Trilinear interpolation; corners as x = 0 face and x = 1 face, each (y,z) = 00, 10, 01, 11.
#[inline(always)]
pub fn trilinear(low: &[f32; 4], high: &[f32; 4], at: Vec3) -> f32 {
    let row = |r: usize| low[r] + (high[r] - low[r]) * at.x;
    let front = row(0) + (row(1) - row(0)) * at.y;
    let back = row(2) + (row(3) - row(2)) * at.y;
    front + (back - front) * at.z
}

/// The cubic of a trilinear function along the segment from `p` to `q` (cell-local).
#[inline(always)]
pub fn along_segment(low: Vec4, high: Vec4, p: Vec3, q: Vec3) -> Cubic {
    // x: rows (y,z) = 00, 10, 01, 11 at p.x and at q.x.
    let slope = high - low;
    let at_p = low + slope * p.x;
    let at_q = low + slope * q.x;
    // y: lanes (x,z) = p0, p1, q0, q1.
    let near = Vec4::new(at_p.x, at_p.z, at_q.x, at_q.z);
    let far = Vec4::new(at_p.y, at_p.w, at_q.y, at_q.w);
    let slope = far - near;
    let at_p = near + slope * p.y;
    let at_q = near + slope * q.y;
    // z: lanes (x,y) = pp, qp, pq, qq.
    let near = Vec4::new(at_p.x, at_p.z, at_q.x, at_q.z);
    let far = Vec4::new(at_p.y, at_p.w, at_q.y, at_q.w);
    let slope = far - near;
    let at_p = near + slope * p.z;
    let at_q = near + slope * q.z;
    const THIRD: f32 = 1.0 / 3.0;
    [at_p.x, (at_p.y + at_p.z + at_q.x) * THIRD, (at_p.w + at_q.y + at_q.z) * THIRD, at_q.w]
}

/// Divides out the root at t = 0 of a cubic with b0 = 0 (whatever b0 is, it is taken as 0), and
/// returns the quadratic quotient raised back to a cubic: same sign as f on (0, 1].
#[inline]
pub fn deflate(b: Cubic) -> Cubic {
    // f = t·q with q = (3 b1, 3/2 b2, b3) in degree 2; a common factor is free.
    let (q0, q1, q2) = (3.0 * b[1], 1.5 * b[2], b[3]);
    [q0, (q0 + 2.0 * q1) * (1.0 / 3.0), (2.0 * q1 + q2) * (1.0 / 3.0), q2]
}

/// The part of a cubic on [t, 1], by de Casteljau's subdivision.
#[inline]
pub fn right_part(b: Cubic, t: f32) -> Cubic {
    let mix = |x: f32, y: f32| x + (y - x) * t;
    let (b01, b12, b23) = (mix(b[0], b[1]), mix(b[1], b[2]), mix(b[2], b[3]));
    let (b012, b123) = (mix(b01, b12), mix(b12, b23));
    [mix(b012, b123), b123, b23, b[3]]
}

/// Scales by a power of two so that the largest coefficient is near 1: products of coefficients
/// then neither overflow nor vanish, and the result does not depend on the scale of the field.
#[inline]
fn normalised(b: &Cubic) -> Cubic {
    let largest = b[0].abs().max(b[1].abs()).max(b[2].abs()).max(b[3].abs());
    if largest > 1e-6 && largest < 1e6 {
        return *b;
    }
    // 2^-e for largest in [2^e, 2^(e+1)), in two factors so that neither overflows.
    let exponent = ((largest.to_bits() >> 23) as i32 - 127).clamp(-126, 126);
    let half = exponent / 2;
    let power = |e: i32| f32::from_bits(((127 - e) as u32) << 23);
    let (a, c) = (power(half), power(exponent - half));
    b.map(|v| v * a * c)
}

/// Where the cubic changes from ≤ 0 to > 0 for the first time on [0, 1], given that it starts at ≤ 0: a
/// bracket that holds this crossing and no other. A start above 0 gives an empty bracket at 0.
///
/// Guarantee: if the polynomial with these coefficients is > 0 anywhere on [0, 1] by more than
/// rounding (about 4 ulp of its largest coefficient), a crossing is found, and it is the first.
#[inline(always)]
pub fn first_rise(b: &Cubic) -> Option<Bracket> {
    if b[0] > 0.0 {
        return Some(Bracket { cubic: *b, low: 0.0, high: 0.0 });
    }
    if b[1] <= 0.0 && b[2] <= 0.0 && b[3] <= 0.0 {
        return None;
    }
    rise_within(normalised(b))
}

/// [`first_rise`] of a cubic that starts at ≤ 0 and has a coefficient above 0.
fn rise_within(b: Cubic) -> Option<Bracket> {
    // One sign change, up at the end: exactly one root (Descartes in the Bernstein basis).
    let single = b[3] > 0.0 && (b[1] <= 0.0 || b[2] > 0.0);
    if single {
        return Some(Bracket { cubic: b, low: 0.0, high: 1.0 });
    }
    let mut low = 0.0;
    for t in stationary_points(&b) {
        if t > low && t < 1.0 {
            if evaluate(&b, t).0 > 0.0 {
                return Some(Bracket { cubic: b, low, high: t });
            }
            low = t;
        }
    }
    (b[3] > 0.0).then_some(Bracket { cubic: b, low, high: 1.0 })
}

/// Roots of the derivative, ascending; entries outside (0, 1) are meaningless.
fn stationary_points(b: &Cubic) -> [f32; 2] {
    // Derivative in Bernstein form (up to the factor 3), then in powers: a t² + 2 h t + d0.
    let (d0, d1, d2) = (b[1] - b[0], b[2] - b[1], b[3] - b[2]);
    let a = d0 - 2.0 * d1 + d2;
    let h = d1 - d0;
    let discriminant = h * h - a * d0;
    if discriminant <= 0.0 {
        return [-1.0, -1.0];
    }
    // The stable pair: q never cancels; one root is q/a, the other d0/q.
    let q = -(h + if h < 0.0 { -discriminant.sqrt() } else { discriminant.sqrt() });
    let (r, s) = (if a != 0.0 { q / a } else { -1.0 }, if q != 0.0 { d0 / q } else { -1.0 });
    if r < s { [r, s] } else { [s, r] }
}
