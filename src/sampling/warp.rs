//! Maps from the unit square to directions, each with its density and its inverse:
//! `square_to_x` maps two variates in [0, 1), `x_pdf` is the density of the image (its unit in
//! the doc), `x_to_square` takes a point of the image back.
//!
//! Hemispheres are around +z of a local frame ([`crate::geom::Frame`] takes them to world).
//! Angles of the maps come from [`sin_cos_turns`], polynomials of our own, because the maps sit
//! in the inner loop and their results must not depend on a platform's mathematics library; the
//! inverses are not hot and use the crate `libm`.

use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, FRAC_PI_4, PI};

/// Sine and cosine of (π/4)·t for t in [−1, 1]; absolute error below 1e-7 (8.6e-8 and 7.2e-8
/// measured over a fine grid, of which the polynomials have 2.5e-9 and 5e-11 in exact
/// arithmetic; the test holds them to 1e-7).
///
/// The polynomials are the Chebyshev series of sin(πt/4)/t and cos(πt/4) in t² on [0, 1], cut
/// after degree 3 and 4.
#[inline(always)]
fn sin_cos_eighth_turn(t: f32) -> (f32, f32) {
    let w = t * t;
    let sine = ((-3.595_439_9e-5 * w + 2.490_007e-3) * w - 8.074_543_5e-2) * w + FRAC_PI_4;
    let cosine = (((3.529_804_2e-6 * w - 3.259_386e-4) * w + 1.585_432_5e-2) * w - 0.308_425_13) * w + 1.0;
    (sine * t, cosine)
}

/// Sine and cosine of 2π·`turns` for `turns` in [0, 1]; absolute error below 1e-7. The reduction
/// to an eighth of a turn is exact.
#[inline(always)]
pub fn sin_cos_turns(turns: f32) -> (f32, f32) {
    let quarters = 4.0 * turns;
    let nearest = (quarters + 0.5) as u32;
    let (sine, cosine) = sin_cos_eighth_turn(2.0 * (quarters - nearest as f32));
    // Without branches, which random azimuths would mispredict: odd quarters swap the two, the
    // second bit is the sign.
    let (sine, cosine) = if nearest & 1 == 0 { (sine, cosine) } else { (cosine, sine) };
    let sign = |quarter: u32| (quarter & 2) << 30;
    (f32::from_bits(sine.to_bits() ^ sign(nearest)), f32::from_bits(cosine.to_bits() ^ sign(nearest + 1)))
}

/// The largest f32 below 1: inverses end there, so that they stay in the domain of the maps.
const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

fn into_square(x: f32, y: f32) -> [f32; 2] {
    [x.clamp(0.0, BELOW_ONE), y.clamp(0.0, BELOW_ONE)]
}

/// Azimuth of (x, y) in turns, in [0, 1).
fn turns_of(x: f32, y: f32) -> f32 {
    let turns = libm::atan2f(y, x) * (0.5 * FRAC_1_PI);
    if turns < 0.0 { turns + 1.0 } else { turns }
}

/// Square → unit disk, equal areas, squares go to concentric rings (Shirley & Chiu 1997, "A Low
/// Distortion Map Between Disk and Square", JGT 2(3), in the form with a signed radius).
#[inline(always)]
pub fn square_to_uniform_disk(u: [f32; 2]) -> Vec2 {
    let (a, b) = (2.0 * u[0] - 1.0, 2.0 * u[1] - 1.0);
    let first = a.abs() > b.abs();
    let (radius, other) = if first { (a, b) } else { (b, a) };
    // Only the centre has radius 0.
    let t = if radius == 0.0 { 0.0 } else { other / radius };
    let (sine, cosine) = sin_cos_eighth_turn(t);
    if first { Vec2::new(radius * cosine, radius * sine) } else { Vec2::new(radius * sine, radius * cosine) }
}

/// Density of [`square_to_uniform_disk`] per unit of area: 1/π within the disk.
pub fn uniform_disk_pdf(point: Vec2) -> f32 {
    if point.length_squared() <= 1.0 { FRAC_1_PI } else { 0.0 }
}

/// Inverse of [`square_to_uniform_disk`].
pub fn uniform_disk_to_square(point: Vec2) -> [f32; 2] {
    let first = point.x.abs() > point.y.abs();
    let (along, across) = if first { (point.x, point.y) } else { (point.y, point.x) };
    let radius = if along < 0.0 { -point.length() } else { point.length() };
    let t = if along == 0.0 { 0.0 } else { libm::atanf(across / along) / FRAC_PI_4 };
    let (a, b) = if first { (radius, radius * t) } else { (radius * t, radius) };
    into_square(0.5 * (a + 1.0), 0.5 * (b + 1.0))
}

/// Square → hemisphere z ≥ 0 with density cosθ/π: the disk, lifted (Malley's method).
#[inline(always)]
pub fn square_to_cosine_hemisphere(u: [f32; 2]) -> Vec3 {
    let disk = square_to_uniform_disk(u);
    // The signed radius of the map, exact up to one rounding of its square; 1 − r² cannot be
    // negative, where 1 − x² − y² could.
    let (a, b) = (2.0 * u[0] - 1.0, 2.0 * u[1] - 1.0);
    let square = (a * a).max(b * b);
    disk.extend((1.0 - square).max(0.0).sqrt())
}

/// Points mapped at a time by [`squares_to_cosine_hemisphere`].
const BLOCK: usize = 8;

/// [`square_to_cosine_hemisphere`] of every point, added to `directions`: the same operations in the same
/// order, in lanes and without the branch that random points mispredict.
#[inline(always)]
pub(crate) fn squares_to_cosine_hemisphere(points: &[[f32; 2]], directions: &mut Vec<Vec3>) {
    let mut blocks = points.chunks_exact(BLOCK);
    for block in &mut blocks {
        let (mut x, mut y, mut z) = ([0.0f32; BLOCK], [0.0f32; BLOCK], [0.0f32; BLOCK]);
        for i in 0..BLOCK {
            x[i] = 2.0 * block[i][0] - 1.0;
            y[i] = 2.0 * block[i][1] - 1.0;
        }
        for i in 0..BLOCK {
            let (a, b) = (x[i], y[i]);
            z[i] = (1.0 - (a * a).max(b * b)).max(0.0).sqrt();
            let first = a.abs() > b.abs();
            let (radius, other) = (if first { a } else { b }, if first { b } else { a });
            let quotient = other / radius;
            let t = if radius == 0.0 { 0.0 } else { quotient };
            let (sine, cosine) = sin_cos_eighth_turn(t);
            let (along, across) = (radius * cosine, radius * sine);
            x[i] = if first { along } else { across };
            y[i] = if first { across } else { along };
        }
        directions.extend((0..BLOCK).map(|i| Vec3::new(x[i], y[i], z[i])));
    }
    directions.extend(blocks.remainder().iter().map(|&point| square_to_cosine_hemisphere(point)));
}

/// Density of [`square_to_cosine_hemisphere`] per steradian: cosθ/π, 0 below the horizon.
#[inline(always)]
pub fn cosine_hemisphere_pdf(direction: Vec3) -> f32 {
    direction.z.max(0.0) * FRAC_1_PI
}

/// Inverse of [`square_to_cosine_hemisphere`].
pub fn cosine_hemisphere_to_square(direction: Vec3) -> [f32; 2] {
    uniform_disk_to_square(direction.truncate())
}

/// Square → unit sphere, equal areas: z = 1 − 2 u_1, azimuth 2π u_0 from x towards y.
#[inline]
pub fn square_to_uniform_sphere(u: [f32; 2]) -> Vec3 {
    polar(u[0], 2.0 * u[1])
}

/// Density of [`square_to_uniform_sphere`] per steradian: 1/(4π).
pub fn uniform_sphere_pdf() -> f32 {
    0.25 * FRAC_1_PI
}

/// Inverse of [`square_to_uniform_sphere`].
pub fn uniform_sphere_to_square(direction: Vec3) -> [f32; 2] {
    into_square(turns_of(direction.x, direction.y), 0.5 * depth_below_pole(direction))
}

/// Square → hemisphere z > 0, equal areas.
#[inline]
pub fn square_to_uniform_hemisphere(u: [f32; 2]) -> Vec3 {
    polar(u[0], u[1])
}

/// Density of [`square_to_uniform_hemisphere`] per steradian: 1/(2π) above the horizon.
pub fn uniform_hemisphere_pdf(direction: Vec3) -> f32 {
    if direction.z >= 0.0 { 0.5 * FRAC_1_PI } else { 0.0 }
}

/// Inverse of [`square_to_uniform_hemisphere`].
pub fn uniform_hemisphere_to_square(direction: Vec3) -> [f32; 2] {
    into_square(turns_of(direction.x, direction.y), depth_below_pole(direction))
}

/// Height 1 − cos α of the cap of half-angle `half_angle` (radians, 0…π) on the unit sphere,
/// without the cancellation that would spoil small cones such as the sun's.
pub fn cap_height(half_angle: f64) -> f32 {
    let sine = libm::sin(0.5 * half_angle);
    (2.0 * sine * sine) as f32
}

/// Square → cone around +z, equal areas: the cap of height `height` = 1 − cos α in (0, 2]; see
/// [`cap_height`].
#[inline]
pub fn square_to_uniform_cone(u: [f32; 2], height: f32) -> Vec3 {
    polar(u[0], u[1] * height)
}

/// Density of [`square_to_uniform_cone`] per steradian: 1/(2π·height) within the cone.
pub fn uniform_cone_pdf(direction: Vec3, height: f32) -> f32 {
    if depth_below_pole(direction) <= height { 0.5 * FRAC_1_PI / height } else { 0.0 }
}

/// Inverse of [`square_to_uniform_cone`].
pub fn uniform_cone_to_square(direction: Vec3, height: f32) -> [f32; 2] {
    into_square(turns_of(direction.x, direction.y), depth_below_pole(direction) / height)
}

/// The direction at azimuth `turns` and 1 − z = `depth`.
#[inline(always)]
fn polar(turns: f32, depth: f32) -> Vec3 {
    let (sine, cosine) = sin_cos_turns(turns);
    let radius = (depth * (2.0 - depth)).max(0.0).sqrt();
    Vec3::new(radius * cosine, radius * sine, 1.0 - depth)
}

/// 1 − z of a unit vector, in the upper half from x² + y² = (1 − z)(1 + z), so that directions
/// near the pole keep their digits.
fn depth_below_pole(direction: Vec3) -> f32 {
    if direction.z > 0.0 { direction.truncate().length_squared() / (1.0 + direction.z) } else { 1.0 - direction.z }
}

/// Unit interval → angle from the normal of a line in the plane, radians in [−π/2, π/2], density
/// cosθ/2: θ = asin(2ξ − 1). (A published form, acos(sqrt(2ξ − 1)), is not the inverse transform:
/// it is undefined for half of all ξ.)
pub fn unit_to_cosine_hemicircle(u: f32) -> f32 {
    libm::asinf((2.0 * u - 1.0).clamp(-1.0, 1.0))
}

/// Density of [`unit_to_cosine_hemicircle`] per radian: cosθ/2, 0 outside ±π/2.
pub fn cosine_hemicircle_pdf(angle: f32) -> f32 {
    if angle.abs() <= 0.5 * PI { (0.5 * libm::cosf(angle)).max(0.0) } else { 0.0 }
}

/// Inverse of [`unit_to_cosine_hemicircle`].
pub fn cosine_hemicircle_to_unit(angle: f32) -> f32 {
    (0.5 * (libm::sinf(angle) + 1.0)).clamp(0.0, BELOW_ONE)
}

#[cfg(test)]
mod tests;
