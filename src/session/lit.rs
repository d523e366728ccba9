//! Lit surfaces: radiance of texels, then of vertices.

use super::{LightNote, Lighting, LuminaireFactor, Surface};
use crate::error::{Error, Result};
use crate::relight::{ClampReport, Contracted, Exposure, LookupReport, Material, SurfaceError, TotalError};
use crate::render::{Reflected, SunLight, SunVisibility};
use crate::transfer::store::{Holdings, Store};

/// How a surface is lit.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct LitOptions {
    /// From radiance to colour; the brightest 1 % of the vertices white, if not said otherwise.
    pub exposure: Exposure,
    /// Factors on the power of the luminaires of a scene; 1 for those that are not named.
    pub luminaires: Vec<LuminaireFactor>,
}

impl Default for LitOptions {
    fn default() -> Self {
        Self { exposure: Exposure::Percentile, luminaires: Vec::new() }
    }
}

/// What lamps that are lit apart bring to the vertices of a surface.
pub(super) struct OfSuns {
    /// Of each lamp, direct; none among walls or other volumes, where paths bring all of it.
    pub(super) seen: Vec<SunVisibility>,
    /// Of all together, by reflection; there direct light, too.
    pub(super) reflected: Reflected,
    /// Rays of both.
    pub(super) rays: u64,
}

impl OfSuns {
    /// Root mean square of their noise over vertices and channels.
    pub(super) fn noise(&self, suns: &[SunLight], material: &Material) -> f64 {
        let factors: Vec<[f64; 3]> = suns.iter().map(|sun| material.sun_factor(sun.flux).map(f64::from)).collect();
        let vertices = self.reflected.radiance.len();
        ((0..vertices).map(|v| self.variance_at(v, &factors)).sum::<f64>() / vertices.max(1) as f64).sqrt()
    }

    /// Mean of the variances of the channels at a vertex; of each lamp what its visible cosine brings.
    pub(super) fn variance_at(&self, vertex: usize, factors: &[[f64; 3]]) -> f64 {
        let square = |factor: &[f64; 3]| factor.iter().map(|f| f * f).sum::<f64>() / 3.0;
        let each = factors.iter().zip(&self.seen);
        let direct = each.map(|(factor, seen)| square(factor) * f64::from(seen.variance[vertex])).sum::<f64>();
        direct + f64::from(self.reflected.channel_variance[vertex])
    }
}

/// The texels around a surface under a light.
pub struct LitTexels<'t> {
    pub(super) surface: &'t Surface<'t>,
    pub(super) lighting: &'t Lighting<'t>,
    pub(super) material: Material,
    pub(super) luminaires: Vec<LuminaireFactor>,
    // Invariant of both: one for each member.
    pub(super) members: Vec<Contracted>,
    pub(super) clamped: Vec<Option<ClampReport>>,
    // What lamps that are lit apart bring to the vertices, where there are any.
    pub(super) suns: Vec<Option<OfSuns>>,
}

impl<'t> LitTexels<'t> {
    /// The light that it is under.
    pub fn lighting(&self) -> &Lighting<'t> {
        self.lighting
    }

    /// What the surface is made of.
    pub fn material(&self) -> &Material {
        &self.material
    }

    /// Looks the vertices up and exposes them; suns that were split off are added.
    ///
    /// # Errors
    /// [`Error::Unbaked`] when the store does not have the texels of the surface; an exposure that is no number.
    pub fn look_up(self, exposure: Exposure) -> Result<Lit<'t>> {
        exposure.check()?;
        let (surface, lighting, material) = (self.surface, self.lighting, &self.material);
        let (mut radiance, mut errors) = (Vec::new(), Vec::new());
        let (mut report, mut sun_rays) = (LookupReport::default(), 0);
        let parts = surface.parts.iter().zip(surface.session.members());
        for (((part, member), texels), suns) in parts.zip(&self.members).zip(&self.suns) {
            let mesh = part.isosurface.mesh();
            let is_of_vertices = part.isosurface.transfer().is_some();
            let mut lit = match is_of_vertices {
                true => texels.at_vertices(&mesh.normals, &lighting.light, material),
                false => texels.look_up(&mesh.positions_in_grid, &mesh.normals, &lighting.light, material),
            };
            let first = errors.len();
            errors.extend(match is_of_vertices {
                true => texels.vertex_errors(mesh.normals.len()),
                false => texels.look_up_errors(&mesh.positions_in_grid),
            });
            if let Some(suns) = suns {
                for (sun, seen) in lighting.suns.iter().zip(&suns.seen) {
                    lit.add_sun(&seen.lit, sun.flux, material);
                    add_noise(&mut errors[first..], &seen.variance, material.sun_factor(sun.flux));
                }
                lit.add(&suns.reflected.radiance)?;
                add_noise(&mut errors[first..], &suns.reflected.variance, [1.0; 3]);
                sun_rays += suns.rays;
            }
            check_baked(member.store(), part.isosurface.isovalue(), &lit.report)?;
            report += lit.report;
            radiance.extend(lit.radiance);
        }
        let exposure = exposure.factor(&radiance);
        let negative = || radiance.iter().filter(|v| v.iter().any(|&x| x < 0.0)).count() as u64;
        let (error, (rms_over_mean, negative)) =
            rayon::join(|| SurfaceError::new(&radiance, &errors), || (rms_over_mean(&radiance, &errors), negative()));
        let total = None;
        Ok(Lit { texels: self, radiance, errors, report, exposure, error, rms_over_mean, negative, sun_rays, total })
    }
}

/// Adds the variance of the rays to a sun, of this radiance per visible cosine, to standard errors of the mean of the channels.
fn add_noise(errors: &mut [f32], variance: &[f32], factor: [f32; 3]) {
    let mean = (factor[0] + factor[1] + factor[2]) / 3.0;
    for (error, variance) in errors.iter_mut().zip(variance).filter(|(_, variance)| **variance > 0.0) {
        *error = (*error * *error + mean * mean * variance).sqrt();
    }
}

/// Refuses lookups that met texels which were never baked.
pub(super) fn check_baked(store: &Store, isovalue: f64, report: &LookupReport) -> Result<()> {
    if report.unbaked == 0 {
        return Ok(());
    }
    let held = store.holdings().ok();
    let list = |held: &Holdings| held.isovalues.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
    let told = match &held {
        None => "it cannot say what it holds".into(),
        Some(held) if held.all => "it holds all isovalues where it was baked".into(),
        Some(held) => format!("it holds isovalues {}", list(held)),
    };
    Err(Error::Unbaked {
        path: store.path().to_path_buf(),
        isovalue,
        unbaked: report.unbaked,
        lookups: report.lookups,
        holds_all: held.as_ref().is_some_and(|held| held.all),
        isovalues: held.map_or_else(Vec::new, |held| held.isovalues),
        remedy: format!("{told}; bake this one into it"),
    })
}

/// Root mean square of the standard errors of the vertices over their mean radiance (mean of the channels); 0
/// for a black surface.
fn rms_over_mean(radiance: &[[f32; 3]], errors: &[f32]) -> f64 {
    let count = radiance.len().max(1) as f64;
    let mean = radiance.iter().flatten().map(|&v| f64::from(v)).sum::<f64>() / (3.0 * count);
    let square = errors.iter().map(|&e| f64::from(e).powi(2)).sum::<f64>() / count;
    if mean > 0.0 { square.sqrt() / mean } else { 0.0 }
}

/// A surface under a light, at its vertices: those of the parts of the surface one after the other.
pub struct Lit<'t> {
    pub(super) texels: LitTexels<'t>,
    pub(super) radiance: Vec<[f32; 3]>,
    pub(super) errors: Vec<f32>,
    report: LookupReport,
    pub(super) exposure: f32,
    error: SurfaceError,
    rms_over_mean: f64,
    negative: u64,
    sun_rays: u64,
    pub(super) total: Option<TotalError>,
}

impl<'t> Lit<'t> {
    /// The texels that were looked up.
    #[doc(hidden)]
    pub fn texels(&self) -> &LitTexels<'t> {
        &self.texels
    }

    /// Linear exitant radiance of each vertex, in the unit of the environment.
    pub fn radiance(&self) -> &[[f32; 3]] {
        &self.radiance
    }

    /// Its standard error, one number for the three channels. Lamps that are lit apart bring by reflection an estimate of one degree
    /// of freedom for each vertex: it is right in the mean square over many.
    pub fn standard_errors(&self) -> &[f32] {
        &self.errors
    }

    /// How the lookups went.
    #[doc(hidden)]
    pub fn report(&self) -> &LookupReport {
        &self.report
    }

    /// The factor from radiance to colour.
    pub fn exposure(&self) -> f32 {
        self.exposure
    }

    /// The exposure in stops.
    pub fn exposure_in_stops(&self) -> f64 {
        libm::log2(f64::from(self.exposure))
    }

    /// Quantiles of the standard errors over the radiance of their vertices.
    #[doc(hidden)]
    pub fn relative_error(&self) -> SurfaceError {
        self.error
    }

    /// Root mean square of the standard errors over the mean radiance; 0 for a black surface.
    pub fn rms_over_mean(&self) -> f64 {
        self.rms_over_mean
    }

    /// How far the colours are from exact light transport on the surface, if [`Self::with_total_error`] found it.
    pub fn total_error(&self) -> Option<TotalError> {
        self.total
    }

    /// Vertices with a negative channel, which [`crate::relight::without_negative`] shows: ringing of the band-limited light.
    #[doc(hidden)]
    pub fn negative_vertices(&self) -> u64 {
        self.negative
    }

    /// Rays of suns that were split off: of visibility, and those that find what the surface reflects of them.
    pub fn sun_rays(&self) -> u64 {
        self.sun_rays
    }

    /// Most of the emission that is left out per further bounce: of albedo 1 with emission, which has no end.
    #[doc(hidden)]
    pub fn emission_remainder(&self) -> f32 {
        self.texels.members.first().map_or(0.0, |contracted| contracted.emission_remainder)
    }

    /// What was done to the light.
    pub fn notes(&self) -> Vec<LightNote> {
        let clamped = self.texels.clamped.first().copied().flatten().map(LightNote::Clamped);
        self.texels.lighting.notes.iter().cloned().chain(clamped).collect()
    }

    /// Linear colours in [0, 1].
    pub fn colours(&self) -> Vec<[f32; 3]> {
        Exposure::apply(self.exposure, &self.radiance)
    }
}
