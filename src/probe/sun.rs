//! A sun split off an environment: the dominant lobe of the image as a disk of its own, and the rest.
//!
//! A small bright lobe has energy at all degrees. Cut at a band limit it leaves 13–23 % of error and
//! rings; taken out and relit by visibility rays it leaves none. What comes out of the image goes into
//! the [`Sun`]s, so that rest + suns carry the flux of the original in every channel, to rounding.
//!
//! # How
//! 1. *Peak*: the pixel of greatest luminance. *Background*: the mean luminance of the ring from one to
//!    two [`SunOptions::max_radius`] around it.
//! 2. *Region*: all pixels connected to the peak whose luminance is above background + `fraction` ·
//!    (peak − background). `fraction` is the least of [`FRACTIONS`] with which the region
//!    stays within the radius. When none does, the lamp is wide: the region is what is above [`PART`] within the radius, and
//!    the next lobe another part of it.
//! 3. *Fill*: each channel of the region falls to the mean of the ring just around it, where it is above.
//! 4. *Sun*: what was taken, with its shape, and as a uniform disk with the same flux and the same first moment ∫ L ω dω. The
//!    first moment gives the direction and the radius (see [`Sun::angular_radius`]), and with both
//!    kept the irradiance of every surface that has the whole lobe above its horizon is kept, too.
//! 5. *Decision*: lobes are found one below the other, and the strongest are taken as long as what is left
//!    loses more than a tolerance by the cut: of radiance under a cosine that an edge shadows
//!    (`truncation`). A lobe that would lose less than [`FAINT`] of the tolerance alone stays, and one without which the rest
//!    loses nearly as much: a piece of a bright sky, of which the edges ring as it did.

mod lobe;
mod shape;
mod truncation;

use super::Probe;
use super::latlong::LatLong;
use super::orientation::Orientation;
use super::sky::Exact;
use super::sun_split::{MOST_SUNS, SUN_TOLERANCE, SunSplit};
use glam::DVec3;
use lobe::{Lobe, peel};
pub use shape::LampShape;
use std::f64::consts::PI;
use truncation::{truncation, truncation_of_lamp};

/// Parts of the peak, above the background, at which a lobe may end.
///
/// Glare reaches down to a few hundredths of the peak, and what stays in the image rings; but the
/// lower the threshold, the sooner the region runs out into a bright sky.
pub const FRACTIONS: [f64; 5] = [0.01, 0.03, 0.1, 0.25, 0.5];

/// Part of the peak, above the background, at which a part of a wide lamp ends.
pub const PART: f64 = 0.5;

/// A distant lamp: a disk of uniform radiance, or the shape that it has in its image.
#[derive(Clone, Debug, PartialEq)]
pub struct Sun {
    /// Unit vector to its centre in the probe frame.
    pub direction_in_probe: DVec3,
    /// Radiance times solid angle, red, green, blue: for a small disk the irradiance on a surface that
    /// faces it.
    pub flux: [f64; 3],
    /// Half the angle across, in radians: that of a disk with the lobe's spread,
    /// cos α = 2‖∫ L ω dω‖/∫ L dω − 1. A disk gives its own radius.
    pub angular_radius: f64,
    /// The lobe as the image has it; none of one that is a disk by formula.
    pub shape: Option<LampShape>,
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

/// Part of the tolerance below which a lobe stays: sixteen of them, wherever they stand, lose together what is tolerated.
pub const FAINT: f64 = 0.25;

/// What the rest may lose at most, of what it lost with a lobe, for the lobe to be worth its rays.
const WORTH: f64 = 0.97;

/// Lobes in a row that are too faint before the search for more ends: bright pixels of little light.
const FAINT_IN_A_ROW: usize = 12;

/// When to take a lobe for a sun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SunOptions {
    /// Band limit of the direct light: what the lobe carries above it would ring.
    pub bands: usize,
    /// Root mean square, over the mean, of what radiance may lose by the cut before lobes are split off.
    pub tolerance: f64,
    /// Largest distance of a lobe's pixels from its peak, in radians.
    pub max_radius: f64,
    /// Most suns to split off, strongest first.
    pub most: usize,
}

impl Default for SunOptions {
    /// 5 bands, 2 %, 10°, eight suns.
    fn default() -> Self {
        Self { bands: 5, tolerance: SUN_TOLERANCE, max_radius: PI / 18.0, most: MOST_SUNS }
    }
}

impl SunOptions {
    /// Those of a choice, for direct light of some bands; `None` for no split. A number of lobes that was asked for has a
    /// tenth of the tolerance: slivers beside a lamp are no lamps.
    pub fn of(split: SunSplit, bands: usize) -> Option<Self> {
        match split {
            SunSplit::Off => None,
            SunSplit::Auto => Some(Self { bands, ..Self::default() }),
            SunSplit::Lobes(most) => {
                Some(Self { bands, most: most.min(MOST_SUNS), tolerance: SUN_TOLERANCE / 10.0, ..Self::default() })
            }
        }
    }
}

/// A sun with the figures that made it one.
#[derive(Clone, Debug, PartialEq)]
pub struct SplitSun {
    /// The sun.
    pub sun: Sun,
    /// Its part of the environment's flux ∫ L dω, in luminance.
    pub flux_share: f64,
    /// What radiance loses by the cut of this lobe, if it had no extent: root mean square over the mean.
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
    /// What is left loses less than the tolerance by the cut.
    Smooth {
        /// Root mean square of what radiance loses, over its mean.
        ringing: f64,
        /// The tolerance.
        tolerance: f64,
    },
    /// No compact lobe that is left has enough of the light.
    Faint {
        /// What all that is left loses by the cut.
        ringing: f64,
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
                "the bands lose {:.2} % of the radiance beside a shadow, within the tolerance of {:.2} %",
                100.0 * ringing,
                100.0 * tolerance
            ),
            Self::Faint { ringing } => write!(
                f,
                "the bands lose {:.2} % of the radiance beside a shadow, but no compact lamp has much of that light",
                100.0 * ringing
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
    /// What radiance beside a shadow loses when the environment is cut to the bands: root mean square over the mean.
    pub truncation: f64,
    /// The same of the rest, over the mean under all of the light.
    pub truncation_of_rest: f64,
}

/// Splits the lobes off an environment that it cannot be cut to some bands with.
///
/// # Panics
/// When `options.bands` is 0 or above [`crate::sh::MAX_BANDS`].
pub fn split_sun(probe: &Probe, options: &SunOptions) -> Split {
    assert!((1..=crate::sh::MAX_BANDS).contains(&options.bands), "{} bands", options.bands);
    let lost = truncation(&probe.image, options.bands);
    let mut split = Split {
        rest: probe.clone(),
        suns: Vec::new(),
        stopped: NoSun::Smooth { ringing: lost, tolerance: options.tolerance },
        truncation: lost,
        truncation_of_rest: lost,
    };
    if probe.image.pixels().iter().flatten().all(|&v| v <= 0.0) {
        split.stopped = NoSun::Black;
    } else if lost > options.tolerance {
        match probe.exact {
            Some(Exact::Disk { centre, half_angle, radiance }) => {
                split_disk(&mut split, centre, half_angle, radiance, options)
            }
            _ => split_lobes(&mut split, options),
        }
    }
    split
}

/// The strongest lobes of an image, until what is left is smooth.
fn split_lobes(split: &mut Split, options: &SunOptions) {
    let whole = flux(&split.rest.image);
    let (mut lobes, stopped) = lobes(&split.rest.image, whole, options);
    lobes.sort_by(|a, b| mean(b.sun.flux).total_cmp(&mean(a.sun.flux)));
    split.stopped = stopped;
    for lobe in lobes {
        if split.suns.len() == options.most {
            split.stopped = NoSun::Enough;
            return;
        }
        let rest = lobe.taken_from(&split.rest.image);
        let lost = truncation(&rest, options.bands) * mean(flux(&rest)) / mean(whole);
        if lost > WORTH * split.truncation_of_rest {
            continue;
        }
        (split.rest.image, split.rest.exact, split.truncation_of_rest) = (rest, None, lost);
        split.suns.push(lobe.as_sun(&split.rest.image, whole, options.bands));
        if split.truncation_of_rest <= options.tolerance {
            split.stopped = NoSun::Smooth { ringing: split.truncation_of_rest, tolerance: options.tolerance };
            return;
        }
    }
}

/// The lobes of an image that have enough of its light, as they are found below each other, and why there are no more.
fn lobes(image: &LatLong, whole: [f64; 3], options: &SunOptions) -> (Vec<Lobe>, NoSun) {
    let (mut left, mut lobes, mut faint) = (image.clone(), Vec::new(), 0);
    // Twice as many as are taken: those found first are the brightest, not the strongest.
    while lobes.len() < 2 * MOST_SUNS && faint < FAINT_IN_A_ROW {
        let lobe = match peel(&left, options.max_radius) {
            Ok(lobe) => lobe,
            Err(reason) => return (lobes, reason),
        };
        left = lobe.taken_from(&left);
        let lost = truncation_of_lamp(mean(lobe.sun.flux) / mean(whole), options.bands);
        if lost > FAINT * options.tolerance {
            (faint, _) = (0, lobes.push(lobe));
        } else {
            faint += 1;
        }
    }
    (lobes, NoSun::Faint { ringing: truncation(image, options.bands) })
}

/// ∫ L dω of each channel.
fn flux(image: &LatLong) -> [f64; 3] {
    image.mean().map(|v| 4.0 * PI * v)
}

fn mean(rgb: [f64; 3]) -> f64 {
    (rgb[0] + rgb[1] + rgb[2]) / 3.0
}

/// The sun alone, by formula: no need to look for it in its picture.
fn split_disk(split: &mut Split, centre: DVec3, half_angle: f64, radiance: f64, options: &SunOptions) {
    if half_angle > options.max_radius {
        split.stopped = NoSun::Wide(options.max_radius);
        return;
    }
    let sun = Sun { direction_in_probe: centre, flux: [0.0; 3], angular_radius: half_angle, shape: None };
    let sun = Sun { flux: [radiance * sun.solid_angle(); 3], ..sun };
    let image = &split.rest.image;
    split.rest.image = LatLong::from_fn(image.width(), image.height(), |_, _| [0.0; 3]);
    split.rest.exact = Some(Exact::Constant(0.0));
    let ringing = truncation_of_lamp(1.0, options.bands);
    split.suns.push(SplitSun { sun, flux_share: 1.0, ringing, pixels: 0 });
    (split.truncation_of_rest, split.stopped) = (0.0, NoSun::Enough);
}

#[cfg(test)]
mod tests;
