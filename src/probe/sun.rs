//! A sun split off an environment: the dominant lobe of the image as a disk of its own, and the rest.
//!
//! A small bright lobe has energy at all degrees. Cut at a band limit it leaves 13–23 % of error and
//! rings; taken out and relit by visibility rays it leaves none. What comes out of the image goes into
//! the [`Sun`], so that rest + sun carry the flux of the original in every channel, to rounding.
//!
//! # How
//! 1. *Peak*: the pixel of greatest luminance. *Background*: the mean luminance of the ring from one to
//!    two [`SunOptions::max_radius`] around it.
//! 2. *Region*: all pixels connected to the peak whose luminance is above background + `fraction` ·
//!    (peak − background). `fraction` is the least of [`FRACTIONS`] with which the region
//!    stays within the radius; when none does, the light has no compact lobe.
//! 3. *Fill*: each channel of the region falls to the mean of the ring just around it, where it is above.
//! 4. *Sun*: what was taken, as a uniform disk with the same flux and the same first moment ∫ L ω dω. The
//!    first moment gives the direction and the radius (see [`Sun::angular_radius`]), and with both
//!    kept the irradiance of every surface that has the whole lobe above its horizon is kept, too.
//! 5. The split is made only where the lobe's energy above the band limit exceeds a tolerance.

use super::Probe;
use super::latlong::{LUMINANCE, LatLong, luminance};
use super::orientation::Orientation;
use super::project::project;
use super::sky::Exact;
use crate::sh::Coefficients;
use glam::DVec3;
use std::f64::consts::PI;

/// Parts of the peak, above the background, at which a lobe may end.
///
/// Glare reaches down to a few hundredths of the peak, and what stays in the image rings; but the
/// lower the threshold, the sooner the region runs out into a bright sky.
pub const FRACTIONS: [f64; 5] = [0.01, 0.03, 0.1, 0.25, 0.5];

/// A distant disk of uniform radiance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Unit vector to its centre in the probe frame.
    pub direction_in_probe: DVec3,
    /// Radiance times solid angle, red, green, blue: for a small disk the irradiance on a surface that
    /// faces it.
    pub flux: [f64; 3],
    /// Half the angle across, in radians: that of a disk with the lobe's spread,
    /// cos α = 2‖∫ L ω dω‖/∫ L dω − 1. A disk gives its own radius.
    pub angular_radius: f64,
}

impl Sun {
    /// Unit vector to its centre in world axes.
    pub fn direction_in_world(&self, orientation: Orientation) -> DVec3 {
        orientation.world_from_probe() * self.direction_in_probe
    }

    /// Solid angle of the disk in steradians.
    pub fn solid_angle(&self) -> f64 {
        let sine = libm::sin(0.5 * self.angular_radius);
        4.0 * PI * sine * sine
    }

    /// Radiance of the disk.
    pub fn radiance(&self) -> [f64; 3] {
        self.flux.map(|f| f / self.solid_angle())
    }
}

/// When to take a lobe for a sun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunOptions {
    /// Band limit of the direct light: what the lobe carries above it would ring.
    pub bands: usize,
    /// Part of the environment's energy (∫ L² dω of luminance) that may ring before the lobe is split off.
    pub tolerance: f64,
    /// Largest distance of a lobe's pixels from its peak, in radians.
    pub max_radius: f64,
    /// Most suns to split off, brightest first.
    pub most: usize,
}

impl Default for SunOptions {
    /// 5 bands, a tenth of the energy, 10°, one sun.
    fn default() -> Self {
        Self { bands: 5, tolerance: 0.1, max_radius: PI / 18.0, most: 1 }
    }
}

/// A sun with the figures that made it one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplitSun {
    /// The sun.
    pub sun: Sun,
    /// Its part of the environment's flux ∫ L dω, in luminance.
    pub flux_share: f64,
    /// Its part of the environment's energy ∫ L² dω that lies above the band limit, in luminance.
    pub ringing: f64,
    /// Pixels it covered; 0 when it was known by formula.
    pub pixels: usize,
}

/// Why no (further) sun was split off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NoSun {
    /// The environment is black.
    Black,
    /// No pixel is brighter than its surroundings.
    Even,
    /// The brightest region reaches beyond the largest radius (in radians).
    Wide(f64),
    /// The brightest lobe rings less than the tolerance.
    Smooth {
        /// Its part of the energy above the band limit.
        ringing: f64,
        /// The tolerance.
        tolerance: f64,
    },
    /// As many suns as asked for were found.
    Enough,
}

impl std::fmt::Display for NoSun {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Black => write!(f, "the environment is black"),
            Self::Even => write!(f, "nothing is brighter than its surroundings"),
            Self::Wide(radius) => {
                write!(f, "the brightest region reaches farther than {:.3}° from its peak", radius.to_degrees())
            }
            Self::Smooth { ringing, tolerance } => write!(
                f,
                "the brightest lobe has {:.2} % of the energy above the band limit, within the tolerance of {:.2} %",
                100.0 * ringing,
                100.0 * tolerance
            ),
            Self::Enough => write!(f, "as many suns as asked for were split off"),
        }
    }
}

/// An environment without its suns.
#[derive(Clone, Debug)]
pub struct Split {
    /// The rest; the environment itself where no sun was found.
    pub rest: Probe,
    /// The suns, in the order found; may be none.
    pub suns: Vec<SplitSun>,
    /// Why there are no more.
    pub stopped: NoSun,
}

/// Splits the dominant lobes off an environment.
pub fn split_sun(probe: &Probe, options: &SunOptions) -> Split {
    let mut split = Split { rest: probe.clone(), suns: Vec::new(), stopped: NoSun::Enough };
    if let Some(Exact::Disk { centre, half_angle, radiance }) = probe.exact {
        split_disk(&mut split, centre, half_angle, radiance, options);
        return split;
    }
    let whole = totals(&probe.image);
    while split.suns.len() < options.most {
        match peel(&split.rest.image, whole, options) {
            Ok((rest, sun)) => {
                split.rest.image = rest;
                split.rest.exact = None;
                split.suns.push(sun);
            }
            Err(reason) => {
                split.stopped = reason;
                break;
            }
        }
    }
    split
}

/// The sun alone, by formula: no need to look for it in its picture.
fn split_disk(split: &mut Split, centre: DVec3, half_angle: f64, radiance: f64, options: &SunOptions) {
    let sun = Sun { direction_in_probe: centre, flux: [0.0; 3], angular_radius: half_angle };
    let energy = radiance * radiance * sun.solid_angle();
    let kept = split.rest.coefficients(options.bands)[0].energy();
    let ringing = if energy > 0.0 { (1.0 - kept / energy).max(0.0) } else { 0.0 };
    split.stopped = if energy <= 0.0 {
        NoSun::Black
    } else if half_angle > options.max_radius {
        NoSun::Wide(options.max_radius)
    } else if ringing <= options.tolerance {
        NoSun::Smooth { ringing, tolerance: options.tolerance }
    } else {
        NoSun::Enough
    };
    if split.stopped != NoSun::Enough || options.most == 0 {
        return;
    }
    let sun = Sun { flux: [radiance * sun.solid_angle(); 3], ..sun };
    let image = &split.rest.image;
    split.rest.image = LatLong::from_fn(image.width(), image.height(), |_, _| [0.0; 3]);
    split.rest.exact = Some(Exact::Constant(0.0));
    split.suns.push(SplitSun { sun, flux_share: 1.0, ringing, pixels: 0 });
}

/// Flux and energy of an image, in luminance.
#[derive(Clone, Copy)]
struct Totals {
    flux: f64,
    energy: f64,
}

fn totals(image: &LatLong) -> Totals {
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
fn angle(a: DVec3, b: DVec3) -> f64 {
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

fn peel(image: &LatLong, whole: Totals, options: &SunOptions) -> Result<(LatLong, SplitSun), NoSun> {
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
    let mut pixels = image.pixels().to_vec();
    for &(i, _) in &taken.pixels {
        pixels[i] = std::array::from_fn(|c| pixels[i][c].min(fill[c]));
    }
    let rest = LatLong::from_fn(width, height, |x, y| pixels[y * width + x].map(f64::from));
    Ok((rest, SplitSun { sun, flux_share, ringing, pixels: region.len() }))
}

/// The pixels above `threshold` that are connected to `start`; `None` when they reach beyond `radius`.
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
    /// Pixels and what was taken from each.
    pixels: Vec<(usize, [f32; 3])>,
    sun: Sun,
    /// ∫ L² dω in luminance.
    energy: f64,
}

impl Taken {
    /// Energy in luminance below the band limit.
    fn kept_in(&self, bands: usize, width: usize, height: usize) -> f64 {
        let mut pixels = vec![[0.0f32; 3]; width * height];
        for &(i, value) in &self.pixels {
            pixels[i] = value;
        }
        let lobe = LatLong::from_fn(width, height, |x, y| pixels[y * width + x].map(f64::from));
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
        pixels.push((i, excess.map(|v| v as f32)));
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
    DVec3::new(across * chord * libm::sin(longitude), up * 2.0 * half_width, across * chord * libm::cos(longitude))
}

#[cfg(test)]
mod tests;
