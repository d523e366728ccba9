//! Where to take radiance samples for a texture: the thesis's study of placements, for its texture route.
//!
//! Beason (2005) computes radiance at many points of the volume, each on its own level set, and scatters it into a 3D
//! texture ([`crate::transport::scatter`]). How well any isosurface is lit then depends on where the samples lie. Here
//! samples are placed in several ways ([`Placement`]), their radiance is path traced in the whole scene, and the texture is
//! read at points of one isosurface and compared with path tracing at those points.
//!
//! # What the error is of
//! Everything between a point of the isosurface and its colour from the texture: trilinear interpolation between texels,
//! the distance from a texel to the samples that it hears of, and the noise of those (each has few paths). The reference is
//! the same path tracing with other random numbers; it has noise of its own, which is stated beside the figures and is
//! in them. [`Placement::Texels`], a sample on each texel, has no scatter: what it errs by is interpolation and noise
//! alone, the least that a texture of this resolution gives at so many paths.
//!
//! # Where we differ from the thesis
//! Radiance of samples comes from path tracing, not from photons. His D is in texels, "usually 3 or 4": a sample reaches the
//! cube of (2D+1)³ texels around its nearest texel (section 4.4). Ours is the radius of a ball which holds a given number of
//! samples in the mean, so that it shrinks as samples grow in number. The measure is his: vertices of the isosurface
//! (section 4.6, table 4.2). Only samples that matter for the points are traced: the others change no bit of the result.

mod place;
pub mod sweep;

#[cfg(test)]
mod tests;

pub use place::{LEVEL_SETS, PLANES, Placement, THE_NINE, place};

use crate::compare::slow::{between, trilinear};
use crate::compare::{Distance, distance};
use crate::error::{Error, Result};
use crate::level::{LevelField, Pyramid};
use crate::relight::Exposure;
use crate::sampling::DirectionalSource;
use crate::sampling::hash::key;
use crate::scene::geometry::Geometry;
use crate::transfer::Lattice;
use crate::transport::scatter::{Scatter, Shepard};
use crate::transport::{LevelSite, Radiance, SceneReference, site_radiance};
use crate::volume::{Volume, with_samples};
use glam::DVec3;
use std::collections::BTreeMap;

/// What all placements of a study have in common.
pub struct Route<'a> {
    /// The volume.
    pub volume: &'a Volume,
    /// Its pyramid.
    pub pyramid: &'a Pyramid,
    /// What stands around it.
    pub geometry: &'a Geometry,
    /// Distant light, if there is any.
    pub environment: Option<&'a dyn DirectionalSource>,
    /// The isosurface that is looked at, in the file's values.
    pub isovalue: f64,
    /// Points of it, in grid space.
    pub points: &'a [[f32; 3]],
    /// Texels of the texture.
    pub lattice: Lattice,
    /// Albedo and emission of the level set of an isovalue.
    pub material: &'a dyn Fn(f64) -> [[f32; 3]; 2],
    /// Paths of a sample, a power of two of at least 4.
    pub paths: u32,
    /// Samples that a texel hears of in the mean, were they spread evenly: it gives the radius D.
    pub neighbours: f64,
}

/// Radiance at the points, without a texture.
#[derive(Clone, Debug)]
pub struct RouteReference {
    radiance: Vec<Radiance>,
    /// Rays that it took.
    pub rays: u64,
    /// Root mean square of its standard error, over its mean.
    pub noise: f64,
    /// The same in percent of white after its own exposure, as the error of pictures is given.
    pub noise_percent: f64,
}

/// How exact the texture of one placement is.
#[derive(Clone, Debug, PartialEq)]
pub struct RouteError {
    /// How samples were weighted.
    pub weight: Shepard,
    /// From the reference; `rms_percent` is the thesis's figure.
    pub distance: Distance,
}

/// A placement and what came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct RouteFound {
    /// Samples placed where a level set passes.
    pub samples: u64,
    /// Samples placed where none does: they count for nothing.
    pub without_level_set: u64,
    /// Samples that texels of the isosurface hear of, which were traced.
    pub traced: u64,
    /// D, in the mean distance of texels.
    pub radius_in_texels: f64,
    /// Texels around the points.
    pub texels: u64,
    /// Those that have no sample within D, and take the nearest.
    pub empty: u64,
    /// Root mean square of the standard error of a traced sample, over the mean of the reference.
    pub sample_noise: f64,
    /// Rays of the samples.
    pub rays: u64,
    /// One for each weight.
    pub errors: Vec<RouteError>,
}

impl Route<'_> {
    /// Path traces the points.
    ///
    /// # Errors
    /// When there are no points, nothing shines, or as [`site_radiance`].
    pub fn reference(&self, paths: u32, seed: u64) -> Result<RouteReference> {
        if self.points.is_empty() {
            return Err(Error::argument("points", 0, "at least one point of a surface", "give another isovalue"));
        }
        if self.environment.is_none() && self.geometry.luminaires().is_empty() {
            let remedy = "give an environment, or a scene with luminaires";
            return Err(Error::argument("light", "none", "a luminaire or an environment", remedy));
        }
        let [albedo, emission] = (self.material)(self.isovalue);
        let site = |p: &[f32; 3]| LevelSite {
            position_in_grid: p.map(f64::from),
            isovalue: Some(self.isovalue),
            albedo,
            emission,
        };
        let sites: Vec<LevelSite> = self.points.iter().map(site).collect();
        let (found, rays) = self.trace(&sites, paths, key(seed, 0x7265_6665))?;
        let radiance: Vec<Radiance> = found.into_iter().map(Option::unwrap_or_default).collect();
        let n = (3 * radiance.len()) as f64;
        let mean = radiance.iter().flat_map(|r| r.mean).sum::<f64>() / n;
        let square = mean_variance(&radiance);
        let shown: Vec<[f32; 3]> = radiance.iter().map(|r| r.mean.map(|v| v as f32)).collect();
        let exposure = f64::from(Exposure::Percentile.factor(&shown));
        Ok(RouteReference {
            rays,
            noise: if mean > 0.0 { square.sqrt() / mean } else { 0.0 },
            noise_percent: 100.0 * square.sqrt() * exposure,
            radiance,
        })
    }

    /// Places about so many samples, traces those that matter, and reads the texture at the points.
    ///
    /// # Errors
    /// When the number of samples or neighbours is 0, or as [`site_radiance`].
    pub fn measure(
        &self,
        reference: &RouteReference,
        placement: Placement,
        samples: u32,
        seed: u64,
    ) -> Result<RouteFound> {
        if samples == 0 {
            return Err(Error::argument("samples", 0, "at least 1", "10^6 are those of the thesis"));
        }
        if !(self.neighbours.is_finite() && self.neighbours > 0.0) {
            return Err(Error::argument("neighbours", self.neighbours, "a positive number", "32 is the default"));
        }
        let placed = place(self.volume, self.lattice, placement, samples, seed)?;
        let asked = placed.len();
        let sites = self.on_level_sets(placed);
        let samples = sites.len();
        if samples == 0 {
            let found = format!("{}, of which no sample lies on a level set", placement.name());
            return Err(Error::argument("placement", found, "samples on level sets of the volume", "choose another"));
        }
        let world = |p: [f64; 3]| self.volume.world_from_grid().point(DVec3::from_array(p));
        let corners: Vec<_> = self.points.iter().map(|p| trilinear(self.lattice, *p)).collect();
        let around: BTreeMap<[usize; 3], ()> = corners.iter().flatten().map(|(texel, _)| (*texel, ())).collect();
        let texels: Vec<[usize; 3]> = around.into_keys().collect();
        let texels_in_world: Vec<DVec3> = texels.iter().map(|t| world(self.lattice.grid_from_texel(*t))).collect();
        let positions: Vec<DVec3> = sites.iter().map(|site| world(site.position_in_grid)).collect();
        let radius = self.radius(samples.max(1));
        let scatter = Scatter::new(&positions, radius);
        let needed = scatter.needed(&texels_in_world);
        let traced: Vec<LevelSite> = sites.iter().zip(&needed).filter(|(_, n)| **n).map(|(site, _)| *site).collect();
        let (found, rays) = self.trace(&traced, self.paths, key(seed, 0x7361_6d70))?;
        let found: Vec<Radiance> = found.into_iter().map(Option::unwrap_or_default).collect();
        let mut next = found.iter();
        let radiance: Vec<[f64; 3]> =
            needed.iter().map(|n| if *n { next.next().map_or([0.0; 3], |r| r.mean) } else { [0.0; 3] }).collect();
        let mut empty = 0;
        let expected: Vec<[f64; 3]> = reference.radiance.iter().map(|r| r.mean).collect();
        let errors = Shepard::ALL.map(|weight| {
            let filled = scatter.fill(&texels_in_world, &radiance, weight);
            empty = filled.empty;
            let lit: BTreeMap<[usize; 3], [f64; 3]> = texels.iter().copied().zip(filled.radiance).collect();
            let read: Vec<[f64; 3]> = corners.iter().map(|c| between(c, &lit).unwrap_or_default()).collect();
            RouteError { weight, distance: distance(&read, &expected, mean_variance(&reference.radiance)) }
        });
        let mean = expected.iter().flatten().sum::<f64>() / (3 * expected.len()) as f64;
        Ok(RouteFound {
            samples: samples as u64,
            without_level_set: (asked - samples) as u64,
            traced: traced.len() as u64,
            radius_in_texels: radius / self.texel_distance(),
            texels: texels.len() as u64,
            empty,
            sample_noise: if mean > 0.0 { mean_variance(&found).sqrt() / mean } else { 0.0 },
            rays,
            errors: errors.into(),
        })
    }

    fn trace(&self, sites: &[LevelSite], paths: u32, seed: u64) -> Result<(Vec<Option<Radiance>>, u64)> {
        let settings = SceneReference {
            paths,
            albedo: [0.0; 3],
            emission: [0.0; 3],
            scales: Vec::new(),
            samples_luminaires: true,
            sees_through_backs: false,
            seed,
        };
        let (found, counts) =
            site_radiance(self.volume, self.pyramid, self.geometry, sites, self.environment, &settings)?;
        Ok((found, counts.path_rays + counts.light_rays))
    }

    /// The samples that lie on a level set, with its material.
    fn on_level_sets(&self, positions_in_grid: Vec<[f64; 3]>) -> Vec<LevelSite> {
        with_samples!(self.volume.samples(), s => {
            let field = LevelField::new(self.volume, s, self.pyramid);
            let site = |position_in_grid| {
                let at = field.locate(position_in_grid);
                field.normal(&at)?;
                let isovalue = self.volume.value_from_raw(f64::from(field.raw_value(&at)));
                let [albedo, emission] = (self.material)(isovalue);
                Some(LevelSite { position_in_grid, isovalue: None, albedo, emission })
            };
            positions_in_grid.into_iter().filter_map(site).collect()
        })
    }

    /// Of a ball that holds `neighbours` of so many samples spread evenly over the box, in world.
    fn radius(&self, samples: usize) -> f64 {
        libm::cbrt(3.0 * self.neighbours * self.box_volume() / (4.0 * std::f64::consts::PI * samples as f64))
    }

    fn texel_distance(&self) -> f64 {
        let cells: f64 = self.lattice.texels().iter().map(|&m| m.saturating_sub(1).max(1) as f64).product();
        libm::cbrt(self.box_volume() / cells)
    }

    fn box_volume(&self) -> f64 {
        let cells: f64 = self.volume.dims().iter().map(|&n| (n - 1) as f64).product();
        self.volume.world_from_grid().linear().determinant().abs() * cells
    }
}

/// Mean over points and channels of the squared standard error.
fn mean_variance(radiance: &[Radiance]) -> f64 {
    radiance.iter().flat_map(|r| r.stderr).map(|e| e * e).sum::<f64>() / (3 * radiance.len()).max(1) as f64
}
