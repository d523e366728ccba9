//! Projection by exact quadrature: Gauss-Legendre in z times uniform in azimuth.

use super::{Coefficients, basis};
use glam::DVec3;
use std::f64::consts::PI;

/// P_0(t) … P_degree(t) of Legendre, by (l+1) P_{l+1} = (2l+1) t P_l − l P_{l−1}.
pub fn legendre(degree: usize, t: f64) -> Vec<f64> {
    let mut values = Vec::with_capacity(degree + 1);
    values.push(1.0);
    if degree > 0 {
        values.push(t);
    }
    for l in 1..degree {
        let l_float = l as f64;
        values.push(((2.0 * l_float + 1.0) * t * values[l] - l_float * values[l - 1]) / (l_float + 1.0));
    }
    values
}

/// The `count` nodes and weights of Gauss-Legendre quadrature on [−1, 1], nodes rising: exact
/// for polynomials of degree 2·`count` − 1. Nodes by Newton's iteration on P_n from the
/// estimate cos(π(i + 3/4)/(n + 1/2)); error a few units in the last place for any usual count.
pub fn gauss_legendre(count: usize) -> Vec<(f64, f64)> {
    let n = count as f64;
    let mut rule = vec![(0.0, 0.0); count];
    for i in 0..count.div_ceil(2) {
        let mut node = libm::cos(PI * (i as f64 + 0.75) / (n + 0.5));
        let mut slope = 1.0;
        // Quadratic convergence from within 1/n²: five steps reach the last place.
        for _ in 0..8 {
            let p = legendre(count, node);
            slope = n * (node * p[count] - p[count - 1]) / (node * node - 1.0);
            node -= p[count] / slope;
        }
        if 2 * i + 1 == count {
            node = 0.0;
        }
        let weight = 2.0 / ((1.0 - node * node) * slope * slope);
        rule[i] = (-node, weight);
        rule[count - 1 - i] = (node, weight);
    }
    rule
}

/// Directions and weights (steradians, sum 4π) that integrate every function of spherical
/// degree ≤ `degree` over the sphere exactly: (`degree`/2 + 1)·(`degree` + 1) points.
pub fn sphere_rule(degree: usize) -> Vec<(DVec3, f64)> {
    let columns = degree + 1;
    let mut rule = Vec::with_capacity((degree / 2 + 1) * columns);
    for (z, weight) in gauss_legendre(degree / 2 + 1) {
        let radius = ((1.0 - z) * (1.0 + z)).sqrt();
        for column in 0..columns {
            let azimuth = 2.0 * PI * (column as f64 + 0.5) / columns as f64;
            let direction = DVec3::new(radius * libm::cos(azimuth), radius * libm::sin(azimuth), z);
            rule.push((direction, weight * 2.0 * PI / columns as f64));
        }
    }
    rule
}

/// Projection of `f` on `bands` bands with a rule of degree `degree`: exact when f itself has
/// degree ≤ `degree` − (`bands` − 1).
///
/// # Panics
/// When `bands` is not in 1…[`super::MAX_BANDS`].
pub fn project(bands: usize, degree: usize, f: impl Fn(DVec3) -> f64) -> Coefficients {
    let mut sum = Coefficients::zero(bands);
    let mut values = vec![0.0; basis::count(bands)];
    for (direction, weight) in sphere_rule(degree) {
        basis::evaluate(bands, direction.to_array(), &mut values);
        let weighted = weight * f(direction);
        for (total, value) in sum.values_mut().iter_mut().zip(&values) {
            *total += weighted * value;
        }
    }
    sum
}

/// Solid angle in steradians of the ring between two colatitudes (radians from the pole),
/// 2π (cos a − cos b), without cancellation for thin rings.
pub fn ring_solid_angle(from_colatitude: f64, to_colatitude: f64) -> f64 {
    let (middle, half) = (0.5 * (from_colatitude + to_colatitude), 0.5 * (to_colatitude - from_colatitude));
    4.0 * PI * libm::sin(middle) * libm::sin(half)
}

/// Solid angle of one pixel in each of `rows` rows of a latitude-longitude image with `columns`
/// columns, top to bottom; the pixels of the image sum to 4π within rounding.
pub fn pixel_solid_angles(rows: usize, columns: usize) -> Vec<f64> {
    let edge = |row: usize| PI * row as f64 / rows as f64;
    (0..rows).map(|row| ring_solid_angle(edge(row), edge(row + 1)) / columns as f64).collect()
}

#[cfg(test)]
mod tests;
