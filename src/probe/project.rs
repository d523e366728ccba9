//! Projection of a lat-long image on spherical harmonics, exact for the image as given.
//!
//! The image is constant over each pixel, so L_lm = Σ pixels · ∫_pixel Y_lm dω, and the integral
//! of the basis over a pixel is taken exactly, not at its centre: there is no error of
//! resolution. A constant gives L_00 = sqrt(4π) L and zeros at any size, within rounding.
//!
//! *Method.* About the image's own axis the basis separates into Θ_lm(β) · cos mλ or sin mλ, so
//! a row is reduced once to its 2n−1 Fourier sums and then met with n² latitude integrals
//! (Driscoll & Healy 1994, "Computing Fourier transforms and convolutions on the 2-sphere",
//! section 3, without their fast Legendre step). The integral of cos mλ over a pixel is
//! cos(mλ_centre) · 2 sin(mΔ/2)/m; that of Θ_lm(β) cos β over a row is a trigonometric polynomial
//! of degree at most l+1 ≤ 11, which Gauss-Legendre quadrature of the order used here integrates
//! to rounding. The axis of the image is y and that of [`crate::sh`] is z: the result is rotated
//! by a quarter turn about x.

use super::latlong::LatLong;
use super::orientation::Orientation;
use crate::sh::project::gauss_legendre;
use crate::sh::{self, Coefficients, Rotation};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::f64::consts::PI;

/// Coefficients in the probe frame ([`super::latlong`]) of red, green and blue, `bands` bands.
///
/// Rows are summed in a fixed order: the result does not depend on the number of threads.
///
/// # Panics
/// When `bands` is 0 or above [`sh::MAX_BANDS`].
pub fn project(image: &LatLong, bands: usize) -> [Coefficients; 3] {
    assert!((1..=sh::MAX_BANDS).contains(&bands), "{bands} bands; the basis has 1 to {}", sh::MAX_BANDS);
    let probe_from_about_y = rotation(bands, ABOUT_Y_FROM_PROBE.transpose());
    project_about_y(image, bands).map(|c| probe_from_about_y.apply(&c))
}

/// The same light seen in world axes: rotates coefficients of the probe frame.
pub fn into_world(in_probe: &[Coefficients; 3], orientation: Orientation) -> [Coefficients; 3] {
    let bands = in_probe.iter().map(Coefficients::bands).max().unwrap_or(1);
    let world_from_probe = rotation(bands, orientation.world_from_probe());
    std::array::from_fn(|c| world_from_probe.apply(&in_probe[c]))
}

fn rotation(bands: usize, matrix: DMat3) -> Rotation {
    match Rotation::new(bands, &matrix) {
        Ok(rotation) => rotation,
        Err(e) => unreachable!("orientations are rotations and the bands were checked: {e}"),
    }
}

/// (x, y, z) → (x, −z, y): the pole y becomes z, longitude from +x towards −z becomes the
/// azimuth from x towards y.
const ABOUT_Y_FROM_PROBE: DMat3 = DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y);

/// Sums in eight lanes that are added in a fixed order: fast without any freedom of rounding.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0f64; 8];
    let (a_chunks, a_rest) = a.as_chunks::<8>();
    let (b_chunks, b_rest) = b.as_chunks::<8>();
    for (x, y) in a_chunks.iter().zip(b_chunks) {
        for i in 0..8 {
            lanes[i] += x[i] * y[i];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(x, y)| x * y).sum();
    ((lanes[0] + lanes[4]) + (lanes[1] + lanes[5])) + ((lanes[2] + lanes[6]) + (lanes[3] + lanes[7])) + rest
}

/// cos mλ and sin mλ at the pixel centres times their mean over a pixel's width and the width
/// itself: row 2m−1 the sine, row 2m the cosine of order m.
fn longitude_table(width: usize, bands: usize) -> Vec<Vec<f64>> {
    let step = 2.0 * PI / width as f64;
    let row = |k: usize| -> Vec<f64> {
        let m = k.div_ceil(2);
        // ∫ over the pixel / value at its centre.
        let integral = if m == 0 { step } else { 2.0 * libm::sin(0.5 * m as f64 * step) / m as f64 };
        (0..width)
            .map(|x| {
                let longitude = PI * (1.0 - (2 * x + 1) as f64 / width as f64);
                let angle = m as f64 * longitude;
                integral * if k % 2 == 1 { libm::sin(angle) } else { libm::cos(angle) }
            })
            .collect()
    };
    (0..2 * bands - 1).map(row).collect()
}

/// ∫ Θ_lm(β) cos β dβ over a row for all l, m ≥ 0, at the index of (l, m).
fn latitude_integrals(image: &LatLong, y: usize, bands: usize, quadrature: &[(f64, f64)]) -> Vec<f64> {
    let [top, bottom] = image.row_latitudes(y);
    let mut values = vec![0.0; bands * bands];
    let mut integrals = vec![0.0; bands * bands];
    for (node, weight) in quadrature {
        let latitude = 0.5 * (top + bottom) + 0.5 * (top - bottom) * node;
        let (sin, cos) = (libm::sin(latitude), libm::cos(latitude));
        // At azimuth 0 the cosine functions have their latitude factor and the sines vanish.
        sh::basis::evaluate(bands, [cos, 0.0, sin], &mut values);
        let weight = 0.5 * (top - bottom) * weight * cos;
        for (sum, v) in integrals.iter_mut().zip(&values) {
            *sum += weight * v;
        }
    }
    integrals
}

/// The projection in the frame whose z is the image's up.
fn project_about_y(image: &LatLong, bands: usize) -> [Coefficients; 3] {
    let table = longitude_table(image.width(), bands);
    // A row spans π/H; the phase of degree 11 over half of it is 5.5π/H. a rule resolves it to
    // rounding when that is below about n/2: 32 nodes for one row, 8 from 16 rows on.
    let quadrature = gauss_legendre(if image.height() < 16 { 32 } else { 8 });
    let count = bands * bands;
    let row = |y: usize| -> Vec<f64> {
        let pixels = image.row(y);
        let integrals = latitude_integrals(image, y, bands, &quadrature);
        let mut result = vec![0.0; 3 * count];
        for c in 0..3 {
            let channel: Vec<f64> = pixels.iter().map(|p| f64::from(p[c])).collect();
            for m in 0..bands {
                let cosine = dot(&channel, &table[2 * m]);
                let sine = if m > 0 { dot(&channel, &table[2 * m - 1]) } else { 0.0 };
                for l in m..bands {
                    let factor = integrals[sh::index(l, m as isize)];
                    result[c * count + sh::index(l, m as isize)] = factor * cosine;
                    if m > 0 {
                        result[c * count + sh::index(l, -(m as isize))] = factor * sine;
                    }
                }
            }
        }
        result
    };
    let rows: Vec<Vec<f64>> = (0..image.height()).into_par_iter().map(row).collect();
    let mut sums: [Coefficients; 3] = std::array::from_fn(|_| Coefficients::zero(bands));
    for row in rows {
        for (c, sum) in sums.iter_mut().enumerate() {
            for (sum, v) in sum.values_mut().iter_mut().zip(&row[c * count..]) {
                *sum += v;
            }
        }
    }
    sums
}
