//! A probe as a source of light directions: importance sampling in proportion to luminance.

use super::latlong::{LUMINANCE, LatLong, direction_at};
use super::orientation::Orientation;
use crate::geom::Direction;
use crate::sampling::{DirectionSample, DirectionalSource};
use glam::DMat3;
use std::borrow::Cow;
use std::f64::consts::PI;

/// A probe in world orientation, for estimators that sample the light.
///
/// The environment is constant over each pixel; a pixel is drawn with probability in proportion
/// to luminance times solid angle, a direction within it uniformly in solid angle, so that the
/// density is exact and radiance over density is the same for all grey pixels. A binary search
/// in the rows, then in the columns (Pharr, Jakob & Humphreys, "Physically Based Rendering",
/// 4th ed., section 12.5; there the radiance is interpolated and the density is not in
/// proportion to it, here both are constant over a pixel).
///
/// Directions are `f32`: within about 1e-7 of a pixel's edge, [`DirectionalSource::density`] of a
/// sampled direction may already name the neighbour. The sample itself carries its own pixel's
/// radiance and density.
#[derive(Clone, Debug)]
pub struct EnvironmentSource<'a> {
    image: Cow<'a, LatLong>,
    probe_from_world: DMat3,
    world_from_probe: DMat3,
    // Invariants: `rows` has height + 1 entries, each block of `columns` width + 1; all start at
    // 0, never fall and end at 1, or are all 0 where there is no light.
    rows: Vec<f64>,
    columns: Vec<f64>,
    /// Sine of the latitude of each row's edge, height + 1 entries from 1 down to −1.
    sines: Vec<f64>,
    /// Σ |luminance| × solid angle over the sphere.
    power: f64,
}

/// |luminance|: positive wherever any channel is not 0, negatives (`keep_negative`) included.
fn weight(pixel: [f32; 3]) -> f64 {
    (0..3).map(|c| LUMINANCE[c] * f64::from(pixel[c].abs())).sum()
}

/// Running sums of `weights` into `cumulative`, which gets one entry more, divided by the total;
/// returns the total.
fn accumulate(weights: impl Iterator<Item = f64>, cumulative: &mut [f64]) -> f64 {
    let mut total = 0.0;
    cumulative[0] = 0.0;
    let mut last_used = 0;
    for (i, w) in weights.enumerate() {
        total += w;
        cumulative[i + 1] = total;
        if w > 0.0 {
            last_used = i;
        }
    }
    if total > 0.0 {
        for v in cumulative.iter_mut() {
            *v /= total;
        }
        // Exactly 1 from the last entry that has weight on: u < 1 never lands beyond it.
        cumulative[last_used + 1..].fill(1.0);
    }
    total
}

/// The interval of `cumulative` that holds u, never one of width 0, and the place in it in [0, 1).
fn find(cumulative: &[f64], u: f64) -> (usize, f64) {
    let u = u.min(1.0 - f64::EPSILON);
    let i = cumulative.partition_point(|c| *c <= u).clamp(1, cumulative.len() - 1) - 1;
    let width = cumulative[i + 1] - cumulative[i];
    (i, if width > 0.0 { ((u - cumulative[i]) / width).clamp(0.0, 1.0) } else { 0.5 })
}

impl<'a> EnvironmentSource<'a> {
    /// Prepares an image for sampling: 8 bytes a pixel, one pass.
    pub fn new(image: &'a LatLong, orientation: Orientation) -> Self {
        let (width, height) = (image.width(), image.height());
        let mut columns = vec![0.0; height * (width + 1)];
        let row_weights: Vec<f64> = (0..height)
            .map(|y| {
                let row = image.row(y).iter().map(|p| weight(*p));
                accumulate(row, &mut columns[y * (width + 1)..(y + 1) * (width + 1)]) * image.pixel_solid_angle(y)
            })
            .collect();
        let mut rows = vec![0.0; height + 1];
        let power = accumulate(row_weights.into_iter(), &mut rows);
        let sines = (0..=height).map(|k| libm::cos(PI * k as f64 / height as f64)).collect();
        let probe_from_world = orientation.probe_from_world();
        let image = Cow::Borrowed(image);
        Self { image, probe_from_world, world_from_probe: probe_from_world.transpose(), rows, columns, sines, power }
    }

    /// The same with an image of its own.
    pub fn into_owned(self) -> EnvironmentSource<'static> {
        let Self { image, probe_from_world, world_from_probe, rows, columns, sines, power } = self;
        let image = Cow::Owned(image.into_owned());
        EnvironmentSource { image, probe_from_world, world_from_probe, rows, columns, sines, power }
    }

    /// Density per steradian over a pixel; 0 only where it is black.
    fn pixel_density(&self, x: usize, y: usize) -> f32 {
        let weight = weight(self.image.row(y)[x]);
        // A pixel 10³⁸ times fainter than the rest must not round to a density of 0.
        if weight > 0.0 { ((weight / self.power) as f32).max(f32::MIN_POSITIVE) } else { 0.0 }
    }

    fn pixel_at(&self, direction_in_world: Direction) -> (usize, usize) {
        self.image.pixel_at(self.probe_from_world * direction_in_world.vec().as_dvec3())
    }

    /// The variates that [`DirectionalSource::sample`] maps to a direction; `None` where the
    /// density is 0. The third of the three functions of a sampler: map, density, inverse.
    pub fn inverse(&self, direction: Direction) -> Option<[f64; 2]> {
        let in_probe = self.probe_from_world * direction.vec().as_dvec3();
        let (x, y) = self.image.pixel_at(in_probe);
        if self.pixel_density(x, y) <= 0.0 {
            return None;
        }
        let [px, _] = self.image.pixel_from_direction(in_probe);
        let height = in_probe.y / in_probe.length();
        let down = ((height - self.sines[y]) / (self.sines[y + 1] - self.sines[y])).clamp(0.0, 1.0);
        let across = (px - x as f64).clamp(0.0, 1.0);
        let column = &self.columns[y * (self.image.width() + 1)..];
        let between = |a: f64, b: f64, t: f64| a + (b - a) * t;
        Some([between(column[x], column[x + 1], across), between(self.rows[y], self.rows[y + 1], down)])
    }
}

impl DirectionalSource for EnvironmentSource<'_> {
    fn sample(&self, u: [f32; 2]) -> Option<DirectionSample> {
        if self.power <= 0.0 {
            return None;
        }
        let width = self.image.width();
        let (y, down) = find(&self.rows, f64::from(u[1]));
        let (x, across) = find(&self.columns[y * (width + 1)..(y + 1) * (width + 1)], f64::from(u[0]));
        let height = self.sines[y] + (self.sines[y + 1] - self.sines[y]) * down;
        let across_axis = (1.0 - height * height).max(0.0).sqrt();
        let longitude = PI * (1.0 - 2.0 * (x as f64 + across) / width as f64);
        let in_world = self.world_from_probe * direction_at(longitude, across_axis, height);
        Some(DirectionSample {
            direction: Direction::new(in_world.as_vec3())?,
            radiance: self.image.row(y)[x],
            density: self.pixel_density(x, y),
        })
    }

    fn density(&self, direction: Direction) -> f32 {
        let (x, y) = self.pixel_at(direction);
        self.pixel_density(x, y)
    }

    fn radiance(&self, direction: Direction) -> [f32; 3] {
        let (x, y) = self.pixel_at(direction);
        self.image.row(y)[x]
    }
}
