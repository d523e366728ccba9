//! Analytic skies: environments by formula, for scenes without a photograph.
//!
//! | spec | light |
//! |---|---|
//! | `constant[:L]` | radiance L (1) from everywhere |
//! | `gradient[:L]` | L (1 + sin θ)/2: L (1) at the zenith, 0 at the nadir, θ the elevation |
//! | `overcast` | CIE standard overcast sky over grey ground |
//! | `sky[:AZ,EL]` | CIE standard clear sky without the sun itself, over grey ground; the sun's place is AZ 45°, EL 45° |
//! | `sun:AZ,EL[,DEG]` | the sun alone: a uniform disk DEG degrees across (0.53) |
//!
//! *Azimuth* is counted in degrees counter-clockwise seen from above, from the centre of the
//! lat-long image (probe +x, which is world +x for up = z, so that 90° is world +y): a longitude of [`super::latlong`].
//! *Elevation* is counted in degrees up from the horizon.
//!
//! *Scale.* Radiance is in units in which a white diffuse surface that gets all of the light
//! square on has radiance 1: `sun` gives the irradiance π on a surface that faces it, `overcast`
//! and `sky` give the irradiance π from above on horizontal ground.

use super::latlong::{LUMINANCE, LatLong, direction_from_angles};
use crate::error::{Error, Result};
use crate::sh::project::{gauss_legendre, legendre};
use crate::sh::{Coefficients, MAX_BANDS};
use glam::DVec3;
use std::f64::consts::PI;

/// Irradiance in the scale of this module: on a surface that faces the sun, on horizontal ground
/// under a sky.
pub const IRRADIANCE: f64 = PI;
/// Apparent diameter of the sun in degrees.
pub const SUN_DEGREES: f64 = 0.53;
/// Reflectance of the ground below `overcast` and `sky`; its radiance is
/// [`GROUND_ALBEDO`] · [`IRRADIANCE`] / π.
pub const GROUND_ALBEDO: f64 = 0.2;

/// A light that is known better than its image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Exact {
    /// This grey radiance from everywhere.
    Constant(f64),
    /// Grey, L (1 + y)/2.
    Gradient(f64),
    /// A uniform grey disk.
    Disk {
        /// Its centre, a unit vector in the probe frame.
        centre: DVec3,
        /// Half its apparent diameter in radians.
        half_angle: f64,
        /// Its radiance.
        radiance: f64,
    },
}

impl Exact {
    /// Coefficients of each channel in the probe frame, in closed form.
    pub(crate) fn coefficients(self, bands: usize) -> Coefficients {
        match self {
            Self::Constant(radiance) => Coefficients::constant(bands, radiance),
            Self::Gradient(radiance) => {
                let mut linear = Coefficients::constant(bands, 0.5 * radiance);
                if bands > 1 {
                    linear.values_mut()[1] = 0.5 * radiance * (4.0 * PI / 3.0).sqrt(); // Y_1,-1 ∝ y
                }
                linear
            }
            Self::Disk { centre, half_angle, radiance } => {
                let factors = disk_moments(half_angle).map(|moment| radiance * moment);
                Coefficients::delta(bands, centre).filtered(&factors[..bands])
            }
        }
    }
}

/// 2π ∫ P_l(t) dt from cos α to 1 for l = 0…10: by the Funk-Hecke theorem the coefficient of a
/// disk of radiance 1 about d is this times Y_lm(d). Quadrature in 1 − t keeps all digits of a
/// small disk, where the closed form P_{l−1} − P_{l+1} cancels.
fn disk_moments(half_angle: f64) -> [f64; MAX_BANDS] {
    let s = libm::sin(0.5 * half_angle);
    let depth = 2.0 * s * s; // 1 − cos α
    let mut moments = [0.0; MAX_BANDS];
    for (node, weight) in gauss_legendre(MAX_BANDS / 2 + 1) {
        let polynomials = legendre(MAX_BANDS - 1, 1.0 - depth * 0.5 * (1.0 + node));
        for (moment, p) in moments.iter_mut().zip(polynomials) {
            *moment += PI * depth * weight * p;
        }
    }
    moments
}

/// The image of a sky and, where there is one, its exact form; `None` when the first word of
/// `spec` names no sky.
///
/// # Errors
/// When the name is known but its numbers are not what it takes.
pub(crate) fn by_name(spec: &str) -> Result<Option<(LatLong, Option<Exact>)>> {
    let (name, arguments) = spec.split_once(':').map_or((spec, None), |(n, a)| (n, Some(a)));
    let form = match name {
        "constant" => "constant[:L] with a radiance L ≥ 0",
        "gradient" => "gradient[:L] with a zenith radiance L ≥ 0",
        "overcast" => "overcast without numbers",
        "sky" => "sky[:AZ,EL] with an elevation in 0…90",
        "sun" => "sun:AZ,EL[,DEG] with an elevation in −90…90 and a diameter in 0.01…90",
        _ => return Ok(None),
    };
    let refuse = || Error::argument("environment", spec, form, "for example constant:2, sky:45,30 or sun:45,30,0.53");
    let numbers: Vec<f64> = match arguments {
        None => vec![],
        Some(list) => list.split(',').map(|w| w.trim().parse().map_err(|_| refuse())).collect::<Result<_>>()?,
    };
    if !numbers.iter().all(|v: &f64| v.is_finite()) {
        return Err(refuse());
    }
    let radiance_ok = |l: f64| (0.0..=1e30).contains(&l);
    Ok(Some(match (name, numbers[..].as_ref()) {
        ("constant", []) => constant(1.0),
        ("constant", &[l]) if radiance_ok(l) => constant(l),
        ("gradient", []) => gradient(1.0),
        ("gradient", &[l]) if radiance_ok(l) => gradient(l),
        ("overcast", []) => (dome(cie_overcast), None),
        ("sky", []) => (clear(45.0, 45.0), None),
        ("sky", &[azimuth, elevation]) if (0.0..=90.0).contains(&elevation) => (clear(azimuth, elevation), None),
        ("sun", &[azimuth, elevation]) if elevation.abs() <= 90.0 => sun(azimuth, elevation, SUN_DEGREES),
        ("sun", &[azimuth, elevation, degrees]) if elevation.abs() <= 90.0 && (0.01..=90.0).contains(&degrees) => {
            sun(azimuth, elevation, degrees)
        }
        _ => return Err(refuse()),
    }))
}

fn constant(radiance: f64) -> (LatLong, Option<Exact>) {
    (LatLong::from_fn(64, 32, |_, _| [radiance; 3]), Some(Exact::Constant(radiance)))
}

fn gradient(radiance: f64) -> (LatLong, Option<Exact>) {
    let height = 256;
    // The mean of sin β over a row, weighted by solid angle, is the mean of its two edges.
    let edge = |k: usize| libm::cos(PI * k as f64 / height as f64);
    let row = |y: usize| radiance * 0.5 * (1.0 + 0.5 * (edge(y) + edge(y + 1)));
    (LatLong::from_fn(2 * height, height, |_, y| [row(y); 3]), Some(Exact::Gradient(radiance)))
}

/// CIE standard overcast sky, L/L_zenith = (1 + 2 sin θ)/3 (Moon & Spencer 1942; ISO 15469:2004).
fn cie_overcast(up: DVec3) -> [f64; 3] {
    [(1.0 + 2.0 * up.y) / 3.0; 3]
}

/// CIE standard clear sky of low turbidity (ISO 15469:2004 / CIE S 011, type 12): luminance
/// f(χ) φ(Z) with φ(Z) = 1 + a e^(b/cos Z), f(χ) = 1 + c (e^(dχ) − e^(dπ/2)) + e cos²χ, Z the
/// zenith angle, χ the angle to the sun; a = −1, b = −0.32, c = 10, d = −3, e = 0.45.
///
/// The standard gives no colour. Ours: a fixed blue (0.60, 0.95, 1.75) scaled to luminance 1,
/// which fades to white with weight 1 − sqrt(cos Z) towards the horizon and e^(−2χ) around the
/// sun. The luminance stays the standard's.
fn cie_clear(direction: DVec3, sun: DVec3) -> [f64; 3] {
    const BLUE: [f64; 3] = [0.60, 0.95, 1.75];
    let zenith_cosine = direction.y.max(1e-6);
    let angle = libm::atan2(direction.cross(sun).length(), direction.dot(sun));
    let gradation = 1.0 - libm::exp(-0.32 / zenith_cosine);
    let cosine = libm::cos(angle);
    let indicatrix = 1.0 + 10.0 * (libm::exp(-3.0 * angle) - libm::exp(-1.5 * PI)) + 0.45 * cosine * cosine;
    let white = 1.0 - (1.0 - libm::exp(-2.0 * angle)) * zenith_cosine.sqrt();
    let blue_luminance: f64 = (0..3).map(|c| LUMINANCE[c] * BLUE[c]).sum();
    std::array::from_fn(|c| gradation * indicatrix * (white + (1.0 - white) * BLUE[c] / blue_luminance))
}

fn clear(azimuth: f64, elevation: f64) -> LatLong {
    let sun = direction_from_angles(azimuth.to_radians(), elevation.to_radians());
    dome(|d| cie_clear(d, sun))
}

/// An upper hemisphere by formula over grey ground, 512 × 256, scaled so that horizontal ground
/// gets [`IRRADIANCE`] in luminance from the pixels above the horizon.
fn dome(radiance: impl Fn(DVec3) -> [f64; 3]) -> LatLong {
    let (width, height) = (512, 256);
    let blank = LatLong::from_fn(width, height, |_, _| [0.0; 3]);
    const SIDE: usize = 3; // samples per pixel side
    let upper: Vec<[f64; 3]> = (0..width * height / 2)
        .map(|i| {
            let mut sum = [0.0; 3];
            for j in 0..SIDE * SIDE {
                let place = |k: usize| (k as f64 + 0.5) / SIDE as f64;
                let (x, y) = ((i % width) as f64 + place(j % SIDE), (i / width) as f64 + place(j / SIDE));
                let value = radiance(blank.direction_from_pixel(x, y));
                for c in 0..3 {
                    sum[c] += value[c] / (SIDE * SIDE) as f64;
                }
            }
            sum
        })
        .collect();
    let mut irradiance = 0.0;
    for (i, value) in upper.iter().enumerate() {
        let luminance: f64 = (0..3).map(|c| LUMINANCE[c] * value[c]).sum();
        irradiance += luminance * cosine_solid_angle(&blank, i / width);
    }
    let scale = IRRADIANCE / irradiance;
    let ground = [GROUND_ALBEDO * IRRADIANCE / PI; 3];
    LatLong::from_fn(width, height, |x, y| upper.get(y * width + x).map_or(ground, |v| v.map(|v| v * scale)))
}

/// ∫ sin β dω over one pixel of row `y`: half the difference of sin² β times the width.
fn cosine_solid_angle(image: &LatLong, y: usize) -> f64 {
    let [top, bottom] = image.row_latitudes(y).map(libm::sin);
    PI / image.width() as f64 * (top * top - bottom * bottom)
}

/// The sun as an image of 1024 × 512 and as a disk. A pixel gets the share of its solid angle
/// that the disk covers: along the row exactly, across it by 64 lines; the whole is then scaled
/// to the exact solid angle of the disk, so that the energy is right for any size and place.
fn sun(azimuth: f64, elevation: f64, degrees: f64) -> (LatLong, Option<Exact>) {
    let half_angle = 0.5 * degrees.to_radians();
    let (longitude, latitude) = (azimuth.rem_euclid(360.0).to_radians(), elevation.to_radians());
    // Irradiance of a uniform disk on a surface that faces it: π L sin² α.
    let sine = libm::sin(half_angle);
    let radiance = IRRADIANCE / (PI * sine * sine);
    let (width, height) = (1024, 512);
    let blank = LatLong::from_fn(width, height, |_, _| [0.0; 3]);
    let mut cover = vec![0.0f64; width * height];
    let (sin_centre, cos_centre) = (libm::sin(latitude), libm::cos(latitude).max(0.0));
    let mut covered = 0.0;
    for y in 0..height {
        let [top, bottom] = blank.row_latitudes(y);
        if bottom > latitude + half_angle || top < latitude - half_angle {
            continue;
        }
        let (top, bottom) = (libm::sin(top), libm::sin(bottom));
        const LINES: usize = 64;
        for j in 0..LINES {
            let sin = top + (bottom - top) * (j as f64 + 0.5) / LINES as f64;
            let cos = (1.0 - sin * sin).max(0.0).sqrt();
            // |λ − λ_sun| ≤ w, from cos α ≤ sin β sin β_sun + cos β cos β_sun cos(λ − λ_sun).
            let needed = libm::cos(half_angle) - sin * sin_centre;
            let reach = cos * cos_centre;
            let half_width = if needed <= -reach {
                PI
            } else if needed >= reach {
                continue;
            } else {
                libm::acos(needed / reach)
            };
            // In columns, from the left edge at longitude π; a full circle stays within one turn.
            let left = (PI - longitude - half_width) / (2.0 * PI) * width as f64;
            let right = (left + half_width / PI * width as f64).min(left + width as f64);
            for column in left.floor() as i64..right.ceil() as i64 {
                let share = (right.min((column + 1) as f64) - left.max(column as f64)).max(0.0) / LINES as f64;
                cover[y * width + column.rem_euclid(width as i64) as usize] += share;
            }
        }
        covered += cover[y * width..(y + 1) * width].iter().sum::<f64>() * blank.pixel_solid_angle(y);
    }
    let exact_solid_angle = 4.0 * PI * libm::pow(libm::sin(0.5 * half_angle), 2.0);
    let scale = if covered > 0.0 { radiance * exact_solid_angle / covered } else { 0.0 };
    let image = LatLong::from_fn(width, height, |x, y| [cover[y * width + x] * scale; 3]);
    let centre = direction_from_angles(longitude, latitude);
    (image, Some(Exact::Disk { centre, half_angle, radiance }))
}
