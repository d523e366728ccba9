//! Media in pictures: they dim what is seen and scatter light into the rays of the camera.

use super::walls::Environment;
use crate::error::Result;
use crate::level::Pyramid;
use crate::relight::{Light, Material};
use crate::render::{Camera, Picture};
use crate::scene::geometry::Geometry;
use crate::transport::{Airlight, SceneReference, airlight};
use crate::volume::Volume;
use glam::DVec3;

/// Scattered light is found at every so many pixels along each side: it is smooth but where depth is not.
const STEP: usize = 4;
/// Paths of a ray.
const PATHS: u32 = 64;
/// Difference of depth, over the size of the scene, at which a neighbour counts half.
const SAME_DEPTH: f64 = 0.01;

/// What haze depends on.
pub(super) struct Haze<'a> {
    pub(super) volume: &'a Volume,
    pub(super) pyramid: &'a Pyramid,
    pub(super) geometry: &'a Geometry,
    pub(super) isovalue: f64,
    pub(super) material: &'a Material,
    pub(super) light: &'a Light,
    pub(super) scales: Vec<[f64; 3]>,
}

impl Haze<'_> {
    /// Lays the media of the scene over a picture. What is behind it is dimmed by the mean of the channels.
    ///
    /// # Errors
    /// As [`airlight`].
    pub(super) fn lay_over(&self, picture: &mut Picture, camera: &Camera) -> Result<()> {
        let (width, height) = (picture.width, picture.height);
        let ray = |x: f64, y: f64| {
            let (w, h) = (width as f64, height as f64);
            camera.ray(x / w * 2.0 - 1.0, 1.0 - y / h * 2.0, w / h)
        };
        let Self { volume, pyramid, geometry, isovalue, material, .. } = *self;
        let environment = Environment(self.light);
        let found = |rays: &[(DVec3, DVec3)], settings: Option<&SceneReference>| {
            airlight(volume, pyramid, geometry, isovalue, rays, Some(&environment), settings)
        };
        let pixels: Vec<(DVec3, DVec3)> =
            (0..width * height).map(|i| ray((i % width) as f64 + 0.5, (i / width) as f64 + 0.5)).collect();
        let sharp = found(&pixels, None)?;
        let (columns, rows) = (width.div_ceil(STEP) + 1, height.div_ceil(STEP) + 1);
        let coarse: Vec<(DVec3, DVec3)> =
            (0..columns * rows).map(|i| ray((i % columns * STEP) as f64, (i / columns * STEP) as f64)).collect();
        let settings = SceneReference {
            emission: material.emission,
            scales: self.scales.clone(),
            ..SceneReference::new(PATHS, material.albedo, 0)
        };
        let coarse = if geometry.body().is_none() { found(&coarse, Some(&settings))? } else { found(&coarse, None)? };
        let size = volume.world_bounds().size().length();
        for (i, (pixel, own)) in picture.pixels.iter_mut().zip(&sharp).enumerate() {
            let (x, y) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let scattered = between(&coarse, columns, [x / STEP as f64, y / STEP as f64], own.distance, size);
            let mean = own.transmittance.iter().sum::<f32>() / 3.0;
            for c in 0..3 {
                pixel[c] = pixel[c] * own.transmittance[c] + scattered[c];
            }
            pixel[3] = 1.0 - (1.0 - pixel[3]) * mean;
        }
        Ok(())
    }
}

/// Scattered light between four rays, of which those count that go as far.
fn between(coarse: &[Airlight], columns: usize, place: [f64; 2], distance: f64, size: f64) -> [f32; 3] {
    let base = place.map(|p| p as usize);
    let (mut sum, mut weights) = ([0.0f64; 3], 0.0);
    for corner in 0..4 {
        let pick = [corner & 1, corner >> 1];
        let bilinear = |a: usize| {
            let t = place[a] - base[a] as f64;
            if pick[a] == 1 { t } else { 1.0 - t }
        };
        let Some(found) = coarse.get(base[0] + pick[0] + columns * (base[1] + pick[1])) else { continue };
        let apart = match (found.distance.is_finite(), distance.is_finite()) {
            (true, true) => (found.distance - distance).abs() / (SAME_DEPTH * size),
            (false, false) => 0.0,
            _ => 1.0 / SAME_DEPTH,
        };
        let weight = (bilinear(0) * bilinear(1)).max(1e-6) / (1.0 + apart * apart);
        (0..3).for_each(|c| sum[c] += weight * f64::from(found.scattered[c]));
        weights += weight;
    }
    sum.map(|v| (v / weights) as f32)
}
