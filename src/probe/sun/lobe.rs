//! The search for the brightest lobe of an image, and the disk that stands for it.

use super::super::latlong::{LUMINANCE, LatLong, direction_at, luminance};
use super::truncation::truncation_of_lamp;
use super::{FRACTIONS, LampShape, NoSun, PART, SplitSun, Sun, mean};
use glam::DVec3;
use std::f64::consts::PI;

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
    let (latitude, width) = (libm::asin(around.y.clamp(-1.0, 1.0)), image.width());
    // All of the cap and of the columns of a row: an angle each would be most of the work.
    // Rounding must not leave the centre out.
    let most = if near > 0.0 { libm::cos(near.min(PI)) } else { 2.0 };
    let least = libm::cos(far.clamp(0.0, PI));
    let columns: Vec<DVec3> =
        (0..width).map(|x| direction_at(PI * (1.0 - (2 * x + 1) as f64 / width as f64), 1.0, 0.0)).collect();
    for y in 0..image.height() {
        let [top, bottom] = image.row_latitudes(y);
        if bottom - far > latitude || top + far < latitude {
            continue;
        }
        let solid_angle = image.pixel_solid_angle(y);
        let (up, across) = libm::sincos(0.5 * (top + bottom));
        for (x, column) in columns.iter().enumerate() {
            let cosine = across * column.dot(around) + up * around.y;
            if cosine <= most && cosine >= least && takes(y * width + x) {
                mean.add(image.row(y)[x], solid_angle);
            }
        }
    }
    mean
}

/// Finds the brightest lobe of an image, within `radius` of its peak.
pub(super) fn peel(image: &LatLong, radius: f64) -> Result<Lobe, NoSun> {
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
    let radius = radius.max(0.0);
    let background = ring_mean(image, towards, radius, (2.0 * radius).max(radius + 2.0 * pixel_side), |i| i != start)
        .value()
        .map(|mean| luminance(mean.map(|v| v as f32)));
    let Some(background) = background.filter(|b| peak > *b * (1.0 + 1e-6)) else {
        return Err(NoSun::Even);
    };
    let threshold = |fraction: f64| background + fraction * (peak - background);
    let whole = FRACTIONS.iter().find_map(|fraction| grow(image, start, threshold(*fraction), radius));
    let is_part = whole.is_none();
    let region = match whole {
        Some(region) => region,
        None => part(image, start, threshold(PART), radius),
    };
    let mut inside = vec![false; width * height];
    let mut extent = 0.0f64;
    for &i in &region {
        inside[i] = true;
        extent = extent.max(angle(towards, centre(image, i % width, i / width)));
    }
    // Around a part stands the rest of the lamp, which is none of its surroundings.
    let is_beside = |i: usize| !(inside[i] || is_part && luminance(image.pixels()[i]) > threshold(PART));
    let far = if is_part { 2.0 * radius } else { extent + 2.0 * pixel_side };
    let fill = ring_mean(image, towards, 0.0, far, is_beside).value();
    let fill = fill.unwrap_or([background; 3]).map(|v| v as f32);
    let lobe = take(image, &region, fill);
    // A single texel of a coarse image may be as wide.
    if lobe.sun.angular_radius > radius { Err(NoSun::Wide(radius)) } else { Ok(lobe) }
}

/// The pixels, ascending, above `threshold` that are connected to `start`; `None` when they reach beyond `radius`.
/// The image is a sphere: columns join at the seam, and across a pole every pixel of the row touches
/// the one opposite.
fn grow(image: &LatLong, start: usize, threshold: f64, radius: f64) -> Option<Vec<usize>> {
    let (region, reaches_beyond) = region(image, start, threshold, radius);
    (!reaches_beyond).then_some(region)
}

/// Those of them within `radius`.
fn part(image: &LatLong, start: usize, threshold: f64, radius: f64) -> Vec<usize> {
    region(image, start, threshold, radius).0
}

/// Both, and whether there are more.
fn region(image: &LatLong, start: usize, threshold: f64, radius: f64) -> (Vec<usize>, bool) {
    let (width, height) = (image.width(), image.height());
    let towards = centre(image, start % width, start / width);
    let mut seen = std::collections::BTreeSet::from([start]);
    let mut region = vec![start];
    let (mut next, mut reaches_beyond) = (0, false);
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
                    reaches_beyond = true;
                } else {
                    region.push(i);
                }
            }
        }
    }
    region.sort_unstable();
    (region, reaches_beyond)
}

/// A lobe of an image.
pub(super) struct Lobe {
    /// Pixels, ascending, and what is taken from each.
    pixels: Vec<(usize, [f64; 3])>,
    pub(super) sun: Sun,
}

impl Lobe {
    /// The image without it.
    pub(super) fn taken_from(&self, image: &LatLong) -> LatLong {
        let mut taken = self.pixels.iter().peekable();
        LatLong::from_fn(image.width(), image.height(), |x, y| {
            let pixel = image.row(y)[x].map(f64::from);
            match taken.next_if(|(i, _)| *i == y * image.width() + x) {
                Some((_, excess)) => std::array::from_fn(|c| pixel[c] - excess[c]),
                None => pixel,
            }
        })
    }

    /// It alone, in an image of the size of another.
    fn alone(&self, image: &LatLong) -> LatLong {
        let mut taken = self.pixels.iter().peekable();
        LatLong::from_fn(image.width(), image.height(), |x, y| {
            taken.next_if(|(i, _)| *i == y * image.width() + x).map_or([0.0; 3], |(_, excess)| *excess)
        })
    }

    /// It as a sun beside an environment of this flux, cut to some bands; `image`: one of the size of its own.
    pub(super) fn as_sun(&self, image: &LatLong, whole: [f64; 3], bands: usize) -> SplitSun {
        let luminance = |rgb: [f64; 3]| (0..3).map(|c| LUMINANCE[c] * rgb[c]).sum::<f64>();
        let (flux, all) = (luminance(self.sun.flux), luminance(whole));
        SplitSun {
            sun: Sun { shape: LampShape::of(&self.alone(image)), ..self.sun.clone() },
            flux_share: if all > 0.0 { flux / all } else { 0.0 },
            ringing: truncation_of_lamp(mean(self.sun.flux) / mean(whole), bands),
            pixels: self.pixels.len(),
        }
    }
}

/// What lies above `fill` in a region, as a disk.
fn take(image: &LatLong, region: &[usize], fill: [f32; 3]) -> Lobe {
    let width = image.width();
    let mut pixels = Vec::with_capacity(region.len());
    let (mut flux, mut moment) = ([0.0; 3], DVec3::ZERO);
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
        pixels.push((i, excess));
    }
    let total: f64 = (0..3).map(|c| LUMINANCE[c] * flux[c]).sum();
    let length = moment.length();
    let direction_in_probe =
        if length > 0.0 { moment / length } else { centre(image, region[0] % width, region[0] / width) };
    // The mean direction of a disk is (1 + cos α)/2 long: 1 − length/total = sin²(α/2).
    let depth = if total > 0.0 { (1.0 - length / total).clamp(0.0, 1.0) } else { 0.0 };
    let angular_radius = 2.0 * libm::asin(depth.sqrt());
    Lobe { pixels, sun: Sun { direction_in_probe, flux, angular_radius, shape: None } }
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
