//! How much a cut at a band limit takes from radiance where a shadow falls.
//!
//! Reflected direct light is ⟨T, L⟩ with T(ω) = V(ω)(n·ω)⁺/π. Over all ways in which a surface may stand to the light, a
//! degree that is cut off brings a mean square of ‖T_l‖² ‖L_l‖² / (2l + 1), and the whole a mean of T_00 L_00. Without a
//! shadow the clamped cosine falls as l^(−5/2) and five bands are enough for any light (Ramamoorthi and Hanrahan 2001); it
//! is edges of visibility that make light above the bands seen. So T is here the cosine with one straight edge through
//! the zenith, the half of the sky beyond it hidden: ‖T_l‖² falls as l^(−2), as it does for every edge. A point beside
//! more edges, or of a narrower view, loses more; an open one, and light that was reflected, less.

use super::super::latlong::LatLong;
use crate::sh::project::gauss_legendre;
use std::f64::consts::PI;
use std::sync::OnceLock;

/// Degrees that are looked at, from 0. Those above hold an eighth of the energy that such an edge has above degree 4.
const DEGREES: usize = 64;
/// Rows of the image that is looked at: two to a wavelength of the highest degree.
const ROWS: usize = 128;

/// Root mean square of what radiance loses when light is cut to `bands` bands, over the mean radiance: channels together,
/// over all orientations of the edge above. 0 for a black image.
pub(super) fn truncation(image: &LatLong, bands: usize) -> f64 {
    let edge = edge();
    let (mut lost, mut mean) = (0.0, 0.0);
    for channel in energies(image) {
        mean += (channel[0] * edge[0]).sqrt();
        lost += (bands..DEGREES).map(|l| edge[l] * channel[l] / (2 * l + 1) as f64).sum::<f64>();
    }
    if mean > 0.0 { (3.0 * lost).sqrt() / mean } else { 0.0 }
}

/// The same of a lamp without extent that has a part `share` of the light: what a narrow one loses at most.
pub(super) fn truncation_of_lamp(share: f64, bands: usize) -> f64 {
    let edge = edge();
    // ‖L_l‖² = (2l + 1)/(4π) Φ² beside L_00² = Φ²/(4π).
    share * (edge[bands.min(DEGREES)..].iter().sum::<f64>() / edge[0]).sqrt()
}

/// Associated Legendre functions by order, then degree, normalised so that with cos mφ and sin mφ (√2 of them for m > 0)
/// they are orthonormal over the sphere. Recurrences in the degree are stable.
fn for_each_legendre(x: f64, mut visit: impl FnMut(usize, usize, f64)) {
    let sine = (1.0 - x * x).max(0.0).sqrt();
    let mut diagonal = (0.25 / PI).sqrt();
    for m in 0..DEGREES {
        if m > 0 {
            diagonal *= sine * ((2 * m + 1) as f64 / (2 * m) as f64).sqrt();
        }
        let (mut before, mut now) = (0.0, diagonal);
        let mm = (m * m) as f64;
        for l in m..DEGREES {
            if l > m {
                let square = |l: usize| (l * l) as f64;
                let a = ((4.0 * square(l) - 1.0) / (square(l) - mm)).sqrt();
                let b = if l == m + 1 { 0.0 } else { ((square(l - 1) - mm) / (4.0 * square(l - 1) - 1.0)).sqrt() };
                (before, now) = (now, a * (x * now - b * before));
            }
            visit(m, l, now);
        }
    }
}

/// ‖T_l‖² of max(z, 0) where x > 0.
fn edge() -> &'static [f64; DEGREES] {
    static EDGE: OnceLock<[f64; DEGREES]> = OnceLock::new();
    EDGE.get_or_init(|| {
        let mut of_height = vec![0.0; DEGREES * DEGREES];
        for (node, weight) in gauss_legendre(2 * DEGREES) {
            let z = 0.5 + 0.5 * node;
            for_each_legendre(z, |m, l, p| of_height[m * DEGREES + l] += 0.5 * weight * z * p);
        }
        std::array::from_fn(|l| {
            let of_order = |m: usize| {
                // ∫ cos mφ over the half circle, squared, and the normalisation.
                let around = match m {
                    0 => PI * PI,
                    m if m % 2 == 0 => 0.0,
                    m => 2.0 * 4.0 / (m * m) as f64,
                };
                around * of_height[m * DEGREES + l].powi(2)
            };
            (0..=l).map(of_order).sum()
        })
    })
}

/// ‖L_l‖² of each channel, of the means over the parts of a coarse grid.
fn energies(image: &LatLong) -> [[f64; DEGREES]; 3] {
    let rows = image.height().min(ROWS);
    let (columns, strips) = (image.width().min(2 * ROWS), ROWS.div_ceil(rows));
    let mut sums = vec![[0.0f64; 6]; DEGREES * DEGREES];
    for row in 0..rows {
        let span = row * image.height() / rows..(row + 1) * image.height() / rows;
        let [top, bottom] = [image.row_latitudes(span.start)[0], image.row_latitudes(span.end - 1)[1]];
        let fourier = fourier(&mean_row(image, span, columns));
        // Two points of Gauss in each strip of the height of a row of the finest image.
        for strip in 0..strips {
            let latitude = |k: usize| libm::sin(bottom + (top - bottom) * k as f64 / strips as f64);
            let (low, high) = (latitude(strip), latitude(strip + 1));
            let half = 0.5 * (high - low);
            for node in [-1.0, 1.0].map(|side| 0.5 * (low + high) + side * half / 3.0f64.sqrt()) {
                for_each_legendre(node, |m, l, p| {
                    let sum = &mut sums[m * DEGREES + l];
                    (0..6).for_each(|i| sum[i] += half * p * fourier[m][i]);
                });
            }
        }
    }
    let mut energies = [[0.0; DEGREES]; 3];
    for m in 0..DEGREES {
        let norm = if m == 0 { 1.0 } else { 2.0 };
        for l in m..DEGREES {
            let sum = &sums[m * DEGREES + l];
            (0..3).for_each(|c| energies[c][l] += norm * (sum[c] * sum[c] + sum[c + 3] * sum[c + 3]));
        }
    }
    energies
}

/// Means over the parts of a row of a coarse grid, by solid angle.
fn mean_row(image: &LatLong, span: std::ops::Range<usize>, columns: usize) -> Vec<[f64; 3]> {
    let mut line = vec![[0.0; 3]; columns];
    let all: f64 = span.clone().map(|y| image.pixel_solid_angle(y)).sum();
    for y in span {
        let weight = image.pixel_solid_angle(y) / all;
        for (x, mean) in line.iter_mut().enumerate() {
            let part = x * image.width() / columns..(x + 1) * image.width() / columns;
            let each = weight / part.len() as f64;
            for pixel in &image.row(y)[part] {
                (0..3).for_each(|c| mean[c] += each * f64::from(pixel[c]));
            }
        }
    }
    line
}

/// ∫ L cos mφ and ∫ L sin mφ around a row that is constant over each of its parts: cosines of the channels, then sines.
fn fourier(line: &[[f64; 3]]) -> Vec<[f64; 6]> {
    let step = 2.0 * PI / line.len() as f64;
    let circle: Vec<(f64, f64)> = (0..line.len()).map(|i| libm::sincos((i as f64 + 0.5) * step)).collect();
    let turn: Vec<(f64, f64)> = (0..line.len()).map(|i| libm::sincos(i as f64 * step)).collect();
    let of_order = |m: usize| {
        let width = if m == 0 { step } else { 2.0 * libm::sin(0.5 * m as f64 * step) / m as f64 };
        let mut sums = [0.0; 6];
        for (i, rgb) in line.iter().enumerate() {
            // m (i + ½) = m i + ½ m: half steps are whole where m is even.
            let place = m * i + m / 2;
            let (sine, cosine) =
                if m.is_multiple_of(2) { turn[place % line.len()] } else { circle[place % line.len()] };
            for c in 0..3 {
                sums[c] += rgb[c] * cosine;
                sums[c + 3] += rgb[c] * sine;
            }
        }
        sums.map(|sum| sum * width)
    };
    (0..DEGREES).map(of_order).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::probe::{LatLong, by_name};

    #[test]
    fn the_edge_has_the_energy_and_the_mean_of_its_function() {
        // ∫ z² over a quarter of the sphere is π/3, ∫ z is π/2; what is above degree 63 is an eighth of what is above 4.
        let edge = edge();
        assert!((edge[0] - PI / 16.0).abs() < 1e-12, "{}", edge[0]);
        let [all, low] = [DEGREES, 5].map(|l| edge[..l].iter().sum::<f64>());
        let [above, above_four] = [PI / 3.0 - all, PI / 3.0 - low];
        assert!(above > 0.0 && above < above_four / 7.0, "{above} of {above_four}");
        // ‖T_l‖² falls as l^(−2), even and odd degrees together.
        let pair = |l: usize| edge[l] + edge[l + 1];
        assert!((pair(12) / pair(48) / 16.0 - 1.0).abs() < 0.15, "{}", pair(12) / pair(48));
        // 3/(4π) [(∫ z²)² + (∫ z x)²]; the root at the zenith costs Gauss some digits.
        assert!((edge[1] - 0.75 / PI * ((PI / 3.0).powi(2) + (2.0f64 / 3.0).powi(2))).abs() < 1e-6, "{}", edge[1]);
    }

    #[test]
    fn energies_are_those_of_the_projection() {
        for name in ["sunset", "studio", "sky:30,20", "constant:2"] {
            let probe = by_name(name).unwrap().unwrap();
            let (found, expected) = (energies(&probe.image), super::super::super::project::project(&probe.image, 8));
            for c in 0..3 {
                let total: f64 = expected[c].values()[0].powi(2);
                for l in 0..8 {
                    let energy: f64 = expected[c].values()[l * l..(l + 1) * (l + 1)].iter().map(|v| v * v).sum();
                    // Means over parts of 1.4°.
                    let error = (found[c][l] - energy).abs();
                    assert!(error <= 0.01 * energy + 1e-5 * total, "{name} {c} {l}: {} for {energy}", found[c][l]);
                }
            }
        }
    }

    #[test]
    fn a_lamp_of_one_pixel_is_a_lamp_without_extent_and_smooth_light_loses_little() {
        let image = LatLong::from_fn(256, 128, |x, y| if (x, y) == (200, 50) { [1.0; 3] } else { [0.0; 3] });
        for bands in [1, 3, 5, 8] {
            let [lamp, point] = [truncation(&image, bands), truncation_of_lamp(1.0, bands)];
            // The pixel of 1.4° has lost some of its highest degrees.
            assert!(lamp <= point * 1.01 && lamp > 0.9 * point, "{bands}: {lamp} {point}");
        }
        for (sky, most) in [("constant", 1e-4), ("gradient", 0.01), ("overcast", 0.01)] {
            let lost = truncation(&by_name(sky).unwrap().unwrap().image, 5);
            assert!(lost < most, "{sky}: {lost}");
        }
    }
}
