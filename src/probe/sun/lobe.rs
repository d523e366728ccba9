//! The search for the brightest lobe of an image, and the disk that stands for it.

use super::super::latlong::{LUMINANCE, LatLong, direction_at, luminance};
use super::super::project::project;
use super::{FRACTIONS, NoSun, SplitSun, Sun, SunOptions};
use crate::sh::Coefficients;
use glam::DVec3;
use std::f64::consts::PI;

/// Flux and energy of an image, in luminance.
#[derive(Clone, Copy)]
pub(super) struct Totals {
    flux: f64,
    energy: f64,
}

pub(super) fn totals(image: &LatLong) -> Totals {
    let mut sum = Totals { flux: 0.0, energy: 0.0 };
    for y in 0..image.height() {
        let (mut flux, mut energy) = (0.0, 0.0);
        for pixel in image.row(y) {
            let value = luminance(*pixel);
            flux += value;
            energy += value * value;
        }
        let solid_angle = image.pixel_solid_angle(y);
        sum.flux += flux * solid_angle;
        sum.energy += energy * solid_angle;
    }
    sum
}

/// A weighted mean of pixels.
#[derive(Clone, Copy, Default)]
struct Mean {
    sum: [f64; 3],
    weight: f64,
}

impl Mean {
    fn add(&mut self, pixel: [f32; 3], weight: f64) {
        for c in 0..3 {
            self.sum[c] += weight * f64::from(pixel[c]);
        }
        self.weight += weight;
    }

    fn value(&self) -> Option<[f64; 3]> {
        (self.weight > 0.0).then(|| self.sum.map(|v| v / self.weight))
    }
}

/// Centre of a pixel.
fn centre(image: &LatLong, x: usize, y: usize) -> DVec3 {
    image.direction_from_pixel(x as f64 + 0.5, y as f64 + 0.5)
}

/// Angle between unit vectors, accurate for small ones.
pub(super) fn angle(a: DVec3, b: DVec3) -> f64 {
    libm::atan2(a.cross(b).length(), a.dot(b))
}

/// Mean of the pixels with centres from `near` to `far` of a direction that `takes` accepts.
fn ring_mean(image: &LatLong, around: DVec3, near: f64, far: f64, takes: impl Fn(usize) -> bool) -> Mean {
    let mut mean = Mean::default();
    let latitude = libm::asin(around.y.clamp(-1.0, 1.0));
    for y in 0..image.height() {
        let [top, bottom] = image.row_latitudes(y);
        if bottom - far > latitude || top + far < latitude {
            continue;
        }
        let solid_angle = image.pixel_solid_angle(y);
        for x in 0..image.width() {
            let distance = angle(around, centre(image, x, y));
            if distance >= near && distance <= far && takes(y * image.width() + x) {
                mean.add(image.row(y)[x], solid_angle);
            }
        }
    }
    mean
}

/// Takes the brightest lobe out of an image; `whole` are the totals of the environment it is judged by.
pub(super) fn peel(image: &LatLong, whole: Totals, options: &SunOptions) -> Result<(LatLong, SplitSun), NoSun> {
    let (width, height) = (image.width(), image.height());
    let mut peak = (0.0, 0);
    for (i, pixel) in image.pixels().iter().enumerate() {
        let value = luminance(*pixel);
        if value > peak.0 {
            peak = (value, i);
        }
    }
    if peak.0 <= 0.0 {
        return Err(NoSun::Black);
    }
    let (peak, start) = peak;
    let towards = centre(image, start % width, start / width);
    let pixel_side = PI / height.min(width.div_ceil(2)) as f64;
    // At least the neighbours, however coarse the image.
    let radius = options.max_radius.max(0.0);
    let background = ring_mean(image, towards, radius, (2.0 * radius).max(radius + 2.0 * pixel_side), |i| i != start)
        .value()
        .map(|mean| luminance(mean.map(|v| v as f32)));
    let Some(background) = background.filter(|b| peak > *b * (1.0 + 1e-6)) else {
        return Err(NoSun::Even);
    };
    let grown =
        FRACTIONS.iter().find_map(|fraction| grow(image, start, background + fraction * (peak - background), radius));
    let Some(region) = grown else {
        return Err(NoSun::Wide(radius));
    };
    let mut inside = vec![false; width * height];
    let mut extent = 0.0f64;
    for &i in &region {
        inside[i] = true;
        extent = extent.max(angle(towards, centre(image, i % width, i / width)));
    }
    let fill = ring_mean(image, towards, 0.0, extent + 2.0 * pixel_side, |i| !inside[i]).value();
    let fill = fill.unwrap_or([background; 3]).map(|v| v as f32);
    let taken = take(image, &region, fill);
    let sun = taken.sun;
    // A single texel of a coarse image may be as wide.
    if sun.angular_radius > radius {
        return Err(NoSun::Wide(radius));
    }
    let energy_above = taken.energy - taken.kept_in(options.bands, width, height);
    let ringing = if whole.energy > 0.0 { (energy_above / whole.energy).max(0.0) } else { 0.0 };
    if ringing.is_nan() || ringing <= options.tolerance {
        return Err(NoSun::Smooth { ringing, tolerance: options.tolerance });
    }
    let flux: f64 = (0..3).map(|c| LUMINANCE[c] * sun.flux[c]).sum();
    let flux_share = if whole.flux > 0.0 { flux / whole.flux } else { 0.0 };
    let mut taken = region.iter().peekable();
    let rest = LatLong::from_fn(width, height, |x, y| {
        let pixel = image.row(y)[x];
        let inside = taken.next_if(|i| **i == y * width + x).is_some();
        std::array::from_fn(|c| f64::from(if inside { pixel[c].min(fill[c]) } else { pixel[c] }))
    });
    Ok((rest, SplitSun { sun, flux_share, ringing, pixels: region.len() }))
}

/// The pixels, ascending, above `threshold` that are connected to `start`; `None` when they reach beyond `radius`.
/// The image is a sphere: columns join at the seam, and across a pole every pixel of the row touches
/// the one opposite.
fn grow(image: &LatLong, start: usize, threshold: f64, radius: f64) -> Option<Vec<usize>> {
    let (width, height) = (image.width(), image.height());
    let towards = centre(image, start % width, start / width);
    let mut seen = std::collections::BTreeSet::from([start]);
    let mut region = vec![start];
    let mut next = 0;
    while next < region.len() {
        let (x, y) = (region[next] % width, region[next] / width);
        next += 1;
        let opposite = (x + width / 2) % width;
        let columns = [(x + width - 1) % width, x, (x + 1) % width];
        let mut near: Vec<usize> = Vec::with_capacity(9);
        for row in [y.checked_sub(1), Some(y), Some(y + 1)] {
            match row.filter(|row| *row < height) {
                Some(row) => near.extend(columns.map(|column| row * width + column)),
                None => near.push(y * width + opposite),
            }
        }
        for i in near {
            if luminance(image.pixels()[i]) > threshold && seen.insert(i) {
                if angle(towards, centre(image, i % width, i / width)) > radius {
                    return None;
                }
                region.push(i);
            }
        }
    }
    region.sort_unstable();
    Some(region)
}

/// What was taken out of an image.
struct Taken {
    /// Pixels, ascending, and what was taken from each.
    pixels: Vec<(usize, [f64; 3])>,
    sun: Sun,
    /// ∫ L² dω in luminance.
    energy: f64,
}

impl Taken {
    /// Energy in luminance below the band limit.
    fn kept_in(&self, bands: usize, width: usize, height: usize) -> f64 {
        let mut taken = self.pixels.iter().peekable();
        let lobe = LatLong::from_fn(width, height, |x, y| {
            taken.next_if(|(i, _)| *i == y * width + x).map_or([0.0; 3], |(_, value)| *value)
        });
        let channels = project(&lobe, bands);
        let mut grey = Coefficients::zero(bands);
        for c in 0..3 {
            grey += &(&channels[c] * LUMINANCE[c]);
        }
        grey.energy()
    }
}

/// What lies above `fill` in a region, as a disk.
fn take(image: &LatLong, region: &[usize], fill: [f32; 3]) -> Taken {
    let width = image.width();
    let mut pixels = Vec::with_capacity(region.len());
    let (mut flux, mut moment, mut energy) = ([0.0; 3], DVec3::ZERO, 0.0);
    for &i in region {
        let (x, y) = (i % width, i / width);
        // In f64: exactly what the pixel loses when it is set to the fill.
        let excess: [f64; 3] =
            std::array::from_fn(|c| f64::from(image.pixels()[i][c]) - f64::from(image.pixels()[i][c].min(fill[c])));
        let solid_angle = image.pixel_solid_angle(y);
        let value: f64 = (0..3).map(|c| LUMINANCE[c] * excess[c]).sum();
        for c in 0..3 {
            flux[c] += solid_angle * excess[c];
        }
        moment += value * pixel_moment(image, x, y);
        energy += value * value * solid_angle;
        pixels.push((i, excess));
    }
    let total: f64 = (0..3).map(|c| LUMINANCE[c] * flux[c]).sum();
    let length = moment.length();
    let direction_in_probe =
        if length > 0.0 { moment / length } else { centre(image, region[0] % width, region[0] / width) };
    // The mean direction of a disk is (1 + cos α)/2 long: 1 − length/total = sin²(α/2).
    let depth = if total > 0.0 { (1.0 - length / total).clamp(0.0, 1.0) } else { 0.0 };
    let angular_radius = 2.0 * libm::asin(depth.sqrt());
    Taken { pixels, sun: Sun { direction_in_probe, flux, angular_radius }, energy }
}

/// ∫ ω dω over a pixel, exact: the flux-weighted mean direction needs more than pixel centres where
/// a sun covers only a few.
fn pixel_moment(image: &LatLong, x: usize, y: usize) -> DVec3 {
    let [top, bottom] = image.row_latitudes(y);
    let half_width = PI / image.width() as f64;
    let longitude = PI * (1.0 - (2 * x + 1) as f64 / image.width() as f64);
    // ∫ cos² β dβ and ∫ sin β cos β dβ over the row; ∫ sin λ dλ = sin λ_centre · 2 sin(Δ/2).
    let (sum, difference) = (top + bottom, top - bottom);
    let across = 0.5 * difference + 0.5 * libm::sin(difference) * libm::cos(sum);
    let up = 0.5 * libm::sin(difference) * libm::sin(sum);
    let chord = 2.0 * libm::sin(half_width);
    direction_at(longitude, across * chord, up * 2.0 * half_width)
}
