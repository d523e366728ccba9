//! Lamps that are lit apart from an environment, as relight lights them: their direct light is that of visibility rays, what
//! they bring by reflection stays in the bands.
//!
//! Radiance is linear in the light, so that every link of the chain changes by the same: the direct light of the lamps is
//! added, the direct light of their bands taken away.

use super::{BandLimited, LitSurface, Question};
use crate::error::Result;
use crate::relight::Material;
use crate::render::{SunLight, sun_visibility};
use crate::sh::Coefficients;
use crate::transport::{SceneReference, direct};

/// Lamps apart from an environment.
#[derive(Clone, Copy)]
pub struct Apart<'a> {
    /// What the environment has of them in its bands, in world axes: all of it without the rest.
    pub excess: &'a [Coefficients; 3],
    /// The lamps, with the rays that relight gives them.
    pub suns: &'a [SunLight],
}

/// Rays to each lamp where it stands for the truth; eight times as many in the penumbra.
const MANY_RAYS: u32 = 128;

/// Albedo of surfaces that reflect nothing to each other: a millionth of what is direct.
const BARELY: f32 = 1e-6;

impl Apart<'_> {
    /// Direct radiance of the lamps at the points of a surface, by the rays of relight or by many.
    ///
    /// # Errors
    /// An albedo that is none.
    pub(super) fn radiance(&self, surface: &LitSurface<'_>, with_many: bool) -> Result<Vec<[f64; 3]>> {
        let material = Material::new(surface.albedo, [0.0; 3])?;
        let positions: Vec<[f32; 3]> = surface.points.iter().map(|p| p.position_in_grid).collect();
        let normals: Vec<[f32; 3]> = surface.points.iter().map(|p| p.normal).collect();
        let mut sum = vec![[0.0; 3]; positions.len()];
        for sun in self.suns {
            let sun = if with_many { SunLight { rays: MANY_RAYS, ..*sun } } else { *sun };
            let seen = sun_visibility(surface.volume, surface.pyramid, surface.isovalue, &positions, &normals, &sun);
            let factor = material.sun_factor(sun.flux).map(f64::from);
            let each = sum.iter_mut().zip(seen.lit);
            each.for_each(|(sum, lit)| (0..3).for_each(|c| sum[c] += factor[c] * f64::from(lit)));
        }
        Ok(sum)
    }

    /// Direct radiance of the bands of the lamps at the points of a question, by paths.
    ///
    /// # Errors
    /// As [`direct`].
    pub(super) fn bands_by_paths(&self, q: &Question<'_>) -> Result<Vec<[f64; 3]>> {
        let LitSurface { volume, pyramid, isovalue, points, albedo, .. } = q.surface;
        let settings = SceneReference::new(q.paths, [BARELY; 3], q.seed);
        let light = BandLimited(self.excess);
        let (found, _) = direct(volume, pyramid, None, isovalue, points, &[&light], &settings)?;
        let scaled = |mean: [f64; 3]| std::array::from_fn(|c| mean[c] * f64::from(albedo[c]) / f64::from(BARELY));
        Ok(found.iter().flatten().map(|r| scaled(r.mean)).collect())
    }
}

/// Adds what the lamps bring, and takes away what their bands did.
pub(super) fn exchange(radiance: &mut [[f64; 3]], suns: &[[f64; 3]], bands: &[[f64; 3]]) {
    for (radiance, (sun, band)) in radiance.iter_mut().zip(suns.iter().zip(bands)) {
        (0..3).for_each(|c| radiance[c] += sun[c] - band[c]);
    }
}
