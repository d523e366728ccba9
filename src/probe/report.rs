//! What a probe holds, as data for `env show`.

use super::Probe;
use super::latlong::{LUMINANCE, angles_from_direction, direction_from_angles, luminance};
use super::project::project;
use super::read::{BadPixels, Note};
use crate::quantity::count;
use crate::sh::{MAX_BANDS, basis};
use glam::DVec3;
use serde::Serialize;
use std::f64::consts::PI;

/// A direction in the probe frame with the luminance from there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Lobe {
    /// Degrees counter-clockwise seen from above, 0 at the centre of the image, in (−180, 180].
    pub azimuth_degrees: f64,
    /// Degrees above the horizon.
    pub elevation_degrees: f64,
    /// Luminance from there.
    pub luminance: f64,
}

/// How much of the light's energy ∫ L² dω (of luminance) one degree carries.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BandEnergy {
    /// The degree l.
    pub degree: usize,
    /// Its part of the energy, in [0, 1].
    pub fraction: f64,
    /// What is lost when the light is cut after this degree, in [0, 1].
    pub lost_above: f64,
}

/// The figures of one probe.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Name of the probe.
    pub name: String,
    /// Where it comes from: a file format or "formula".
    pub format: String,
    /// Layout of the file.
    pub layout: String,
    /// Width and height as stored.
    pub stored_size: [usize; 2],
    /// Width of the lat-long image.
    pub width: usize,
    /// Height of the lat-long image.
    pub height: usize,
    /// Smallest value of each channel.
    pub minimum: [f32; 3],
    /// Largest value of each channel.
    pub maximum: [f32; 3],
    /// Stops between the brightest and the faintest pixel that is not black; 0 for a black probe.
    pub range_ev: f64,
    /// Mean radiance over the sphere by solid angle.
    pub mean: [f64; 3],
    /// Luminance of the mean.
    pub mean_luminance: f64,
    /// The brightest pixel; `None` when all are black.
    pub brightest_pixel: Option<Lobe>,
    /// The maximum of the luminance cut after degree 4: where most of the light comes from;
    /// `None` when the light has no direction.
    pub lobe: Option<Lobe>,
    /// Energy by degree, l = 0…10. Of a sun nearly all lies above.
    pub energy: Vec<BandEnergy>,
    /// Bands of `coefficients`.
    pub bands: usize,
    /// Coefficients of red, green and blue in the probe frame, in the order of [`crate::sh`].
    pub coefficients: [Vec<f64>; 3],
    /// Pixels that no light can have.
    pub bad_pixels: BadPixels,
    /// What the reader noticed.
    pub notes: Vec<Note>,
}

fn lobe(direction: DVec3, luminance: f64) -> Lobe {
    let (longitude, latitude) = angles_from_direction(direction);
    Lobe { azimuth_degrees: longitude.to_degrees(), elevation_degrees: latitude.to_degrees(), luminance }
}

/// Maximum over the sphere of a function by its coefficients: the best of a grid of 5°, then a
/// pattern search down to 0.001°.
fn maximum(coefficients: &[f64], bands: usize) -> (DVec3, f64) {
    let mut values = vec![0.0; basis::count(bands)];
    let mut at = |longitude: f64, latitude: f64| -> f64 {
        basis::evaluate(bands, direction_from_angles(longitude, latitude).to_array(), &mut values);
        values.iter().zip(coefficients).map(|(y, c)| y * c).sum()
    };
    let mut best = (0.0, 0.0, f64::NEG_INFINITY);
    for j in 0..=36 {
        for i in 0..72 {
            let (longitude, latitude) = (PI * i as f64 / 36.0 - PI, PI * (j as f64 / 36.0 - 0.5));
            let value = at(longitude, latitude);
            if value > best.2 {
                best = (longitude, latitude, value);
            }
        }
    }
    let mut step = PI / 72.0;
    while step > 1e-3f64.to_radians() {
        let mut moved = false;
        // Steps of longitude grow towards the poles, where they are short on the sphere.
        let across = step / libm::cos(best.1).max(0.05);
        for (dx, dy) in [(across, 0.0), (-across, 0.0), (0.0, step), (0.0, -step)] {
            let candidate = (best.0 + dx, (best.1 + dy).clamp(-0.5 * PI, 0.5 * PI));
            let value = at(candidate.0, candidate.1);
            if value > best.2 {
                best = (candidate.0, candidate.1, value);
                moved = true;
            }
        }
        if !moved {
            step *= 0.5;
        }
    }
    (direction_from_angles(best.0, best.1), best.2)
}

/// The figures of a probe, with its coefficients in `bands` bands.
///
/// # Panics
/// When `bands` is 0 or above [`MAX_BANDS`].
pub fn report(probe: &Probe, bands: usize) -> Report {
    let image = &probe.image;
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    let (mut faintest, mut brightest) = (f64::INFINITY, (0.0, 0, 0));
    let mut energy = 0.0;
    for y in 0..image.height() {
        let mut row_energy = 0.0;
        for (x, pixel) in image.row(y).iter().enumerate() {
            for c in 0..3 {
                low[c] = low[c].min(pixel[c]);
                high[c] = high[c].max(pixel[c]);
            }
            let value = luminance(*pixel);
            row_energy += value * value;
            if value > 0.0 {
                faintest = faintest.min(value);
            }
            if value > brightest.0 {
                brightest = (value, x, y);
            }
        }
        energy += row_energy * image.pixel_solid_angle(y);
    }
    let of_image = project(image, MAX_BANDS);
    let grey: Vec<f64> =
        (0..basis::count(MAX_BANDS)).map(|i| (0..3).map(|c| LUMINANCE[c] * of_image[c].values()[i]).sum()).collect();
    let mut kept = 0.0;
    let bands_energy = (0..MAX_BANDS)
        .map(|l| {
            let part: f64 = grey[l * l..(l + 1) * (l + 1)].iter().map(|v| v * v).sum();
            let fraction = if energy > 0.0 { part / energy } else { 0.0 };
            kept += fraction;
            BandEnergy { degree: l, fraction, lost_above: (1.0 - kept).max(0.0) }
        })
        .map(|b| if energy > 0.0 { b } else { BandEnergy { lost_above: 0.0, ..b } })
        .collect();
    let mean = image.mean();
    let mean_luminance = (0..3).map(|c| LUMINANCE[c] * mean[c]).sum::<f64>();
    let (direction, peak) = maximum(&grey[..25], 5);
    let has_direction = peak - mean_luminance > 1e-6 * mean_luminance.abs();
    Report {
        name: probe.name.clone(),
        format: probe.format.to_string(),
        layout: probe.layout.name().to_string(),
        stored_size: probe.stored_size,
        width: image.width(),
        height: image.height(),
        minimum: low,
        maximum: high,
        range_ev: if brightest.0 > 0.0 { libm::log2(brightest.0 / faintest) } else { 0.0 },
        mean,
        mean_luminance,
        brightest_pixel: (brightest.0 > 0.0)
            .then(|| lobe(image.direction_from_pixel(brightest.1 as f64 + 0.5, brightest.2 as f64 + 0.5), brightest.0)),
        lobe: has_direction.then(|| lobe(direction, peak)),
        energy: bands_energy,
        bands,
        coefficients: probe.coefficients(bands).map(|c| c.values().to_vec()),
        bad_pixels: probe.bad,
        notes: probe.notes.clone(),
    }
}

/// Fewer stops than this between the brightest pixel and the mean is no high dynamic range.
const FEWEST_STOPS: f64 = 1.0;
impl Report {
    /// Why the environment is unusual; empty where it is not.
    #[doc(hidden)]
    pub fn unusual(&self) -> Vec<String> {
        let mut reasons: Vec<String> = self.notes.iter().map(|n| format!("{} ({})", n.text, count(n.count))).collect();
        let bad = &self.bad_pixels;
        let impossible = bad.nan + bad.infinite + bad.negative;
        if impossible > 0 && reasons.is_empty() {
            reasons.push(format!("{} pixels that no light can have", count(impossible)));
        }
        if self.mean_luminance <= 0.0 {
            reasons.push("it is black".into());
        } else if self.format != "formula" {
            let stops = self.brightest_pixel.map_or(0.0, |p| libm::log2(p.luminance / self.mean_luminance));
            if stops < FEWEST_STOPS {
                reasons.push(format!("the brightest pixel is only {stops:.1} stops above the mean: was it clipped?"));
            }
            if self.layout == "latlong" && self.stored_size[0] != 2 * self.stored_size[1] {
                reasons.push(format!("{} × {} is not 2:1", self.stored_size[0], self.stored_size[1]));
            }
        }
        reasons
    }
}
