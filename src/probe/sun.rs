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

mod lobe;

use super::Probe;
use super::latlong::LatLong;
use super::orientation::Orientation;
use super::sky::Exact;
use glam::DVec3;
use lobe::{peel, totals};
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
///
/// # Panics
/// When `options.bands` is 0 or above [`crate::sh::MAX_BANDS`].
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

#[cfg(test)]
mod tests;
