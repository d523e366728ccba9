//! Lamps that are lit apart from an environment, as relight lights them: their direct light by visibility rays, and what
//! the surface reflects of them by gathers. The transfer is multiplied with the rest.
//!
//! Where they stand for the truth they are a source of light as any other, beside the bands of the rest
//! ([`crate::transport::direct`]).

use super::{BandLimited, LitSurface};
use crate::error::Result;
use crate::geom::Direction;
use crate::relight::Material;
use crate::relight::TriangleIndex;
use crate::render::{SunLight, SunLit, Surroundings, sun_visibility};
use crate::sampling::{DirectionSample, DirectionalSource};
use crate::session::LitByPaths;
use crate::sh::Coefficients;

/// Lamps apart from an environment.
#[derive(Clone, Copy)]
pub struct Apart<'a> {
    /// What is left of the environment without them, in world axes, cut to the bands of the store.
    pub rest: &'a [Coefficients; 3],
    /// The lamps, with the rays that relight gives them.
    pub suns: &'a [SunLight],
    /// The lamps as a source of light: what they took from the image.
    pub source: &'a dyn DirectionalSource,
    /// Whether the transfer has reflections.
    pub reflects: bool,
    /// The triangles of the mesh of the surface.
    pub triangles: &'a TriangleIndex<'a>,
}

/// The bands of the rest and the lamps: drawn by these, since what is of few bands is smooth.
pub(super) struct BandsAndSuns<'a> {
    bands: BandLimited<'a>,
    suns: &'a dyn DirectionalSource,
}

impl DirectionalSource for BandsAndSuns<'_> {
    fn sample(&self, u: [f32; 2]) -> Option<DirectionSample> {
        let sample = self.suns.sample(u)?;
        Some(DirectionSample { radiance: self.radiance(sample.direction), ..sample })
    }

    fn density(&self, direction: Direction) -> f32 {
        self.suns.density(direction)
    }

    fn radiance(&self, direction: Direction) -> [f32; 3] {
        let (bands, suns) = (self.bands.radiance(direction), self.suns.radiance(direction));
        std::array::from_fn(|c| bands[c] + suns[c])
    }
}

impl<'a> Apart<'a> {
    /// With the bands of the rest.
    pub(super) fn with_bands(&self) -> BandsAndSuns<'a> {
        BandsAndSuns { bands: BandLimited(self.rest), suns: self.source }
    }

    /// Radiance of the lamps at the points of a surface, as relight finds it; `rest`: the mean radiance of what is not theirs.
    ///
    /// # Errors
    /// An albedo that is none.
    pub(super) fn radiance(&self, surface: &LitSurface<'_>, rest: f64) -> Result<Vec<[f64; 3]>> {
        let LitSurface { volume, pyramid, isovalue, .. } = *surface;
        let material = Material::new(surface.albedo, [0.0; 3])?;
        let positions: Vec<[f32; 3]> = surface.points.iter().map(|p| p.position_in_grid).collect();
        let normals: Vec<[f32; 3]> = surface.points.iter().map(|p| p.normal).collect();
        if let Some(geometry) = surface.geometry {
            let (albedo, reflects) = (surface.albedo, self.reflects);
            let among = LitByPaths { volume, pyramid, geometry, isovalue, albedo, reflects };
            let found = among.lit(self.suns, (&positions, &normals), rest)?;
            return Ok(found.radiance.iter().map(|v| v.map(f64::from)).collect());
        }
        let mut radiance = vec![[0.0; 3]; positions.len()];
        for sun in self.suns {
            let seen = sun_visibility(volume, pyramid, isovalue, &positions, &normals, sun);
            let factor = material.sun_factor(sun.flux).map(f64::from);
            let each = radiance.iter_mut().zip(seen.lit);
            each.for_each(|(sum, lit)| (0..3).for_each(|c| sum[c] += factor[c] * f64::from(lit)));
        }
        if self.reflects {
            let surroundings = Surroundings { volume, pyramid, isovalue, triangles: self.triangles };
            let found = SunLit::new(surroundings, self.suns, &material, true).reflected(&positions, &normals, rest)?;
            let found: Vec<[f64; 3]> = found.radiance.iter().map(|v| v.map(f64::from)).collect();
            add(&mut radiance, &found);
        }
        Ok(radiance)
    }
}

/// Adds at each point.
pub(super) fn add(radiance: &mut [[f64; 3]], more: &[[f64; 3]]) {
    radiance.iter_mut().zip(more).for_each(|(sum, more)| (0..3).for_each(|c| sum[c] += more[c]));
}

/// Of points and channels.
pub(super) fn mean(radiance: &[[f64; 3]]) -> f64 {
    radiance.iter().flatten().sum::<f64>() / (3 * radiance.len().max(1)) as f64
}
