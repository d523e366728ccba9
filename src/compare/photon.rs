//! Photons beside the store and the paths.

use super::{Comparison, Distance, Question, distance, mean_square};
use crate::error::{Error, Result};
use crate::transport::{
    PhotonEnergy, PhotonLightSettings, PhotonMap, PhotonScene, PhotonSettings, Radiance, photon_direct,
};

/// How photons are to answer.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotonQuestion {
    /// The map. Its albedo and what it keeps follow from the question.
    pub map: PhotonSettings,
    /// How radiance is read from it.
    pub reading: PhotonLightSettings,
}

/// What photons say.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PhotonComparison {
    /// The store against photons under the whole light.
    pub store: Distance,
    /// Photons against paths under the whole light.
    pub paths: Distance,
    /// Root mean square of the stated noise of the photons, over the mean of the paths.
    pub noise: f64,
    /// Root mean square of what photons and paths differ by beyond the noise of both, over that mean: the bias of a search
    /// that reaches over edges and curved surfaces.
    pub bias: f64,
    /// Hits kept.
    pub hits: u64,
    /// Of these, of light by way of mirrors and glass alone.
    pub caustics: u64,
    /// Bytes of the map.
    pub bytes: u64,
    /// Where the light of the environment went, then that of each luminaire.
    pub energies: Vec<PhotonEnergy>,
    /// Radiance at each point.
    pub at_points: Vec<[f64; 3]>,
}

impl PhotonQuestion {
    /// Refuses what photons do not know.
    ///
    /// # Errors
    /// Where the surface emits.
    pub fn check(&self, q: &Question<'_>) -> Result<()> {
        if q.surface.emission == [0.0; 3] {
            return Ok(());
        }
        let remedy = "compare with paths: level sets that emit send out no photons";
        Err(Error::argument("photon", "a surface that emits", "light of luminaires and the environment", remedy))
    }

    /// Radiance at the points of a question by photons, and the map that says so.
    ///
    /// # Errors
    /// As [`Self::check`], [`PhotonMap::new`] and [`photon_direct`].
    pub fn answer(&self, q: &Question<'_>) -> Result<(Vec<Radiance>, PhotonMap)> {
        self.check(q)?;
        let q = &q.surface;
        let settings = PhotonSettings {
            albedo: q.albedo,
            kept: self.reading.light.kept(),
            scales: q.scales.to_vec(),
            ..self.map.clone()
        };
        let scene = PhotonScene { volume: q.volume, pyramid: q.pyramid, geometry: q.geometry, light: Some(q.light) };
        let map = PhotonMap::new(&scene, &settings)?;
        let (found, _) = photon_direct(&scene, q.isovalue, q.points, &map, &self.reading)?;
        Ok((found, map))
    }
}

/// Puts photons beside what [`super::compare()`] found for the same question.
///
/// # Errors
/// As [`PhotonQuestion::answer`]; a comparison of other points.
pub fn compare_photons(q: &Question<'_>, found: &Comparison, photons: &PhotonQuestion) -> Result<PhotonComparison> {
    if found.at_points.len() != q.surface.points.len() {
        let n = found.at_points.len();
        return Err(Error::argument(
            "comparison",
            format!("{n} points"),
            "those of the question",
            "compare them first",
        ));
    }
    let (radiance, map) = photons.answer(q)?;
    let by_photons: Vec<[f64; 3]> = radiance.iter().map(|r| r.mean).collect();
    let [stored, paths] = [0, 1].map(|i| found.at_points.iter().map(|p| p[i]).collect::<Vec<_>>());
    let variance = radiance.iter().flat_map(|r| r.stderr).map(|e| e * e).sum::<f64>() / (3 * radiance.len()) as f64;
    let reference = (found.reference_noise * found.mean).powi(2);
    let over = |square: f64| if found.mean > 0.0 { square.max(0.0).sqrt() / found.mean } else { 0.0 };
    Ok(PhotonComparison {
        store: distance(&stored, &by_photons, variance),
        paths: distance(&by_photons, &paths, variance + reference),
        noise: over(variance),
        bias: over(mean_square(&by_photons, &paths) - variance - reference),
        hits: map.len() as u64,
        caustics: map.caustics() as u64,
        bytes: map.bytes(),
        energies: map.energies().to_vec(),
        at_points: by_photons,
    })
}
