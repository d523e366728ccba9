//! Media in pictures: they dim what is seen and scatter light into the rays of the camera.

use super::Lighting;
use super::walls::Environment;
use crate::error::Result;
use crate::level::Pyramid;
use crate::relight::Material;
use crate::render::{Camera, Lamps, Picture};
use crate::scene::geometry::Geometry;
use crate::transport::{Airlight, SceneReference, airlight};
use crate::volume::Volume;
use glam::DVec3;

/// Scattered light is found at every so many pixels along each side: it is smooth but where depth is not.
const STEP: usize = 4;
/// Paths of a ray.
const PATHS: u32 = 64;
/// Rays to each side that are averaged, by a Gaussian as wide as the distance between two.
const REACH: i64 = 2;

/// What haze depends on.
pub(super) struct Haze<'a> {
    pub(super) volume: &'a Volume,
    pub(super) pyramid: &'a Pyramid,
    pub(super) geometry: &'a Geometry,
    pub(super) isovalue: f64,
    pub(super) material: &'a Material,
    pub(super) lighting: &'a Lighting<'a>,
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
        let bands = Environment(&self.lighting.light);
        let environment = Lamps::new(&self.lighting.suns, Some(&bands));
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
        for (i, (pixel, own)) in picture.pixels.iter_mut().zip(&sharp).enumerate() {
            let (x, y) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            let scattered = between(&coarse, columns, [x / STEP as f64, y / STEP as f64], own.transmittance);
            let mean = own.transmittance.iter().sum::<f32>() / 3.0;
            for c in 0..3 {
                pixel[c] = pixel[c] * own.transmittance[c] + scattered[c];
            }
            pixel[3] = 1.0 - (1.0 - pixel[3]) * mean;
        }
        Ok(())
    }
}

/// Light scattered into a ray of this transmittance. What is interpolated is the light over the share of the ray that a medium
/// takes, 1 − e^(−τ): it changes slowly where depth does not.
fn between(coarse: &[Airlight], columns: usize, place: [f64; 2], transmittance: [f32; 3]) -> [f32; 3] {
    let nearest = place.map(|p| p.round() as i64);
    let (mut light, mut taken) = ([0.0f64; 3], [0.0f64; 3]);
    for (y, x) in (-REACH..=REACH).flat_map(|y| (-REACH..=REACH).map(move |x| (y, x))) {
        let [column, row] = [nearest[0] + x, nearest[1] + y];
        if column < 0 || row < 0 || column >= columns as i64 {
            continue;
        }
        let Some(found) = coarse.get(column as usize + columns * row as usize) else { continue };
        let apart = (column as f64 - place[0]).powi(2) + (row as f64 - place[1]).powi(2);
        let weight = libm::exp(-0.5 * apart);
        for c in 0..3 {
            light[c] += weight * f64::from(found.scattered[c]);
            taken[c] += weight * f64::from(1.0 - found.transmittance[c]);
        }
    }
    std::array::from_fn(|c| {
        let share = f64::from(1.0 - transmittance[c]);
        if taken[c] > 0.0 { (share * light[c] / taken[c]) as f32 } else { 0.0 }
    })
}
