//! The lat-long image and its geometry, stated once.
//!
//! # Geometry (the one statement; everything else goes through these functions)
//! An image lights a surface from the same side as in Blender and three.js. The probe frame is
//! that of glTF: right-handed with y up. With longitude λ and latitude β,
//!
//! direction = (cos λ cos β, sin β, −sin λ cos β),
//!
//! longitude falls from +π at the left edge over 0 at the centre (= +x) to −π at the right edge,
//! so +z (λ = −π/2) lies three quarters of the width from the left; latitude falls from +π/2 at
//! the top to −π/2 at the bottom. In coordinates of the image, u = atan2(z, x)/2π + ½ (`equirectUv`
//! of three.js; Blender's equirectangular projection has its centre at +X, too). Seen from the
//! inside the picture is not mirrored.
//!
//! *Where OpenEXR differs:* its latlong environment ("Technical Introduction to OpenEXR",
//! environment maps) has +z at the centre and +x a quarter of the width from the left, a quarter
//! turn away: [`EnvFrame::OpenExr`](super::EnvFrame::OpenExr) reads images so. Its library also
//! puts the centres of the first and last pixels exactly at longitude ±π and latitude ±π/2. Here
//! pixel i covers [i, i+1] of the width and its centre is at (i+½)/W, as every renderer writes
//! such images; the difference is half a pixel.
//!
//! A longitude is also an azimuth: 0 at the centre of the image, growing counter-clockwise seen
//! from above (from +x towards −z).

use super::Orientation;
use crate::error::{Error, Result};
use crate::geom::Up;
use crate::sh::project::ring_solid_angle;
use glam::DVec3;
use std::f64::consts::PI;

/// Luminance weights of linear Rec.709 radiance.
pub const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Rec.709 luminance of a linear pixel.
pub fn luminance(pixel: [f32; 3]) -> f64 {
    LUMINANCE[0] * f64::from(pixel[0]) + LUMINANCE[1] * f64::from(pixel[1]) + LUMINANCE[2] * f64::from(pixel[2])
}

/// The direction in the probe frame at longitude and latitude, both in radians.
pub fn direction_from_angles(longitude: f64, latitude: f64) -> DVec3 {
    direction_at(longitude, libm::cos(latitude), libm::sin(latitude))
}

/// The same at a longitude, a distance from the axis and a height: cos β and sin β of a unit vector.
pub(super) fn direction_at(longitude: f64, across: f64, height: f64) -> DVec3 {
    DVec3::new(libm::cos(longitude) * across, height, -libm::sin(longitude) * across)
}

/// (longitude, latitude) of a direction of any length, in radians; longitude in [−π, π], 0 on
/// the y axis.
pub fn angles_from_direction(direction_in_probe: DVec3) -> (f64, f64) {
    let d = direction_in_probe;
    let across = (d.x * d.x + d.z * d.z).sqrt();
    (libm::atan2(-d.z, d.x), libm::atan2(d.y, across))
}

/// Linear RGB radiance of a distant environment, one value per pixel of a lat-long image.
/// As a function on the sphere it is constant over each pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct LatLong {
    // Invariants: width, height > 0; pixels.len() == width * height; every value finite.
    width: usize,
    height: usize,
    pixels: Vec<[f32; 3]>,
}

impl LatLong {
    /// The same turned counter-clockwise about up by so many degrees; each pixel takes the value at its centre.
    ///
    /// # Errors
    /// When the angle is not finite.
    #[doc(hidden)]
    pub fn turned(&self, degrees: f64) -> Result<Self> {
        let probe_from_turned = Orientation::new(Up::Y, degrees)?.probe_from_world();
        let (width, height) = (self.width(), self.height());
        let pixel = |i: usize| {
            let (x, y) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            self.radiance(probe_from_turned * self.direction_from_pixel(x, y))
        };
        Self::new(width, height, (0..width * height).map(pixel).collect())
    }

    /// An image from its pixels, row by row from the top, left to right.
    ///
    /// # Errors
    /// When a side is 0, the number of pixels is not width × height, or a value is not finite.
    pub fn new(width: usize, height: usize, pixels: Vec<[f32; 3]>) -> Result<Self> {
        let given = format!("{width}x{height} with {} pixels", pixels.len());
        if width == 0 || height == 0 || width.checked_mul(height) != Some(pixels.len()) {
            return Err(Error::argument(
                "lat-long image",
                given,
                "at least one pixel and width x height pixels",
                "pass the dimensions of the pixel buffer",
            ));
        }
        if !pixels.iter().flatten().all(|v| v.is_finite()) {
            return Err(Error::argument(
                "lat-long image",
                "a NaN or an infinity among the pixels",
                "finite radiance",
                "replace such pixels first, as probe::read does",
            ));
        }
        Ok(Self { width, height, pixels })
    }

    /// An image of `width` × `height` whose pixels are `radiance(x, y)`.
    pub(crate) fn from_fn(width: usize, height: usize, mut radiance: impl FnMut(usize, usize) -> [f64; 3]) -> Self {
        debug_assert!(width > 0 && height > 0);
        let pixels = (0..width * height).map(|i| radiance(i % width, i / width).map(|v| v as f32)).collect();
        Self { width, height, pixels }
    }

    /// Pixels along the equator.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Pixels from the zenith to the nadir.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All pixels, row by row from the top.
    pub fn pixels(&self) -> &[[f32; 3]] {
        &self.pixels
    }

    /// One row, left to right.
    ///
    /// # Panics
    /// When `y` is not below the height.
    #[doc(hidden)]
    pub fn row(&self, y: usize) -> &[[f32; 3]] {
        &self.pixels[y * self.width..(y + 1) * self.width]
    }

    /// The unit direction in the probe frame of a position in the image. Positions are
    /// continuous: pixel (i, j) covers [i, i+1] × [j, j+1] and its centre is (i+½, j+½).
    #[doc(hidden)]
    pub fn direction_from_pixel(&self, x: f64, y: f64) -> DVec3 {
        direction_from_angles(PI * (1.0 - 2.0 * x / self.width as f64), PI * (0.5 - y / self.height as f64))
    }

    /// The position in the image of a direction of any length in the probe frame; the inverse of
    /// [`LatLong::direction_from_pixel`]. The result lies in [0, width] × [0, height]. The zero
    /// vector lands on the centre.
    #[doc(hidden)]
    pub fn pixel_from_direction(&self, direction_in_probe: DVec3) -> [f64; 2] {
        let (longitude, latitude) = angles_from_direction(direction_in_probe);
        [
            (0.5 - longitude / (2.0 * PI)).clamp(0.0, 1.0) * self.width as f64,
            (0.5 - latitude / PI).clamp(0.0, 1.0) * self.height as f64,
        ]
    }

    /// The pixel that holds a direction in the probe frame.
    #[doc(hidden)]
    pub fn pixel_at(&self, direction_in_probe: DVec3) -> (usize, usize) {
        let [x, y] = self.pixel_from_direction(direction_in_probe);
        ((x as usize).min(self.width - 1), (y as usize).min(self.height - 1))
    }

    /// Radiance from a direction in the probe frame, constant over each pixel.
    pub fn radiance(&self, direction_in_probe: DVec3) -> [f32; 3] {
        let (x, y) = self.pixel_at(direction_in_probe);
        self.pixels[y * self.width + x]
    }

    /// The same light with at most `width` pixels across: means over blocks of pixels, by solid angle.
    #[must_use]
    #[doc(hidden)]
    pub fn reduced(&self, width: usize) -> Self {
        let side = self.width.div_ceil(width.max(1));
        let (columns, rows) = (self.width.div_ceil(side), self.height.div_ceil(side));
        let mut pixels = Vec::with_capacity(columns * rows);
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
            let (mut sum, mut weights) = ([0.0f64; 3], 0.0);
            for y in row * side..((row + 1) * side).min(self.height) {
                let weight = self.pixel_solid_angle(y);
                for pixel in &self.row(y)[column * side..((column + 1) * side).min(self.width)] {
                    (0..3).for_each(|c| sum[c] += weight * f64::from(pixel[c]));
                    weights += weight;
                }
            }
            pixels.push(sum.map(|v| (v / weights) as f32));
        }
        Self { width: columns, height: rows, pixels }
    }

    /// Latitudes of the upper and lower edge of a row, in radians.
    #[doc(hidden)]
    pub fn row_latitudes(&self, y: usize) -> [f64; 2] {
        let edge = |k: usize| PI * (0.5 - k as f64 / self.height as f64);
        [edge(y), edge(y + 1)]
    }

    /// Solid angle in steradians of each pixel in row `y`; the sum over all pixels is 4π within
    /// rounding.
    #[doc(hidden)]
    pub fn pixel_solid_angle(&self, y: usize) -> f64 {
        let edge = |k: usize| PI * k as f64 / self.height as f64;
        ring_solid_angle(edge(y), edge(y + 1)) / self.width as f64
    }

    /// Mean radiance over the sphere, weighted by solid angle.
    pub fn mean(&self) -> [f64; 3] {
        let mut total = [0.0; 3];
        for y in 0..self.height {
            let mut sum = [0.0; 3];
            for pixel in self.row(y) {
                for c in 0..3 {
                    sum[c] += f64::from(pixel[c]);
                }
            }
            let weight = self.pixel_solid_angle(y) / (4.0 * PI);
            for c in 0..3 {
                total[c] += weight * sum[c];
            }
        }
        total
    }
}

#[cfg(test)]
mod tests;
