//! Light that leaves a point or comes in parallel and meets a mirror or glass first: no path finds it, since none meets such a
//! luminaire by chance, and images of it exist in flat mirrors alone. Photons do.
//!
//! Layer k of such a luminaire gains T = (1/π) Σ F κ_eff / (4/3 π r³) over the photons near x that a mirror or glass was the first
//! to meet and k level sets have reflected since. What the luminaire sends straight to a diffuse surface is the paths' share, so that
//! nothing counts twice.
//!
//! The stated error is the noise of the photons around a point; what a search reads over an edge of a caustic is not in it.

use super::estimate::{Kind, PhotonSearch};
use super::isovalues::Isovalues;
use super::map::{Kept, PhotonMap, PhotonScene, PhotonSettings};
use super::packing::Origin;
use super::tree::Nearest;
use crate::error::{Error, Result};
use crate::geom::Normal;
use crate::transport::scene_path::{Arrival, SpecularLight, needs_photons};
use glam::{DVec3, Vec3};

/// Light of the luminaires of a scene that only photons find.
pub struct SpecularPhotons {
    map: PhotonMap,
    layers: usize,
}

/// Samples that isovalues near a surface span across it.
const NEAR_CELLS: f64 = 1.0;

impl SpecularPhotons {
    /// Sends out `photons` photons, of isovalues near one or of all; `None` where paths find all light.
    ///
    /// # Errors
    /// As [`PhotonMap::new`]; an isovalue that is no number.
    pub fn new(
        scene: &PhotonScene<'_>,
        layers: usize,
        isovalue: Option<f64>,
        (photons, seed): (u32, u64),
        memory_limit: u64,
    ) -> Result<Option<Self>> {
        let Some(geometry) = scene.geometry else { return Ok(None) };
        let needed = needs_photons(geometry);
        if needed.is_empty() {
            return Ok(None);
        }
        if isovalue.is_some_and(|c| !c.is_finite()) {
            let remedy = "give one in the file's values, or none for all";
            return Err(Error::argument("isovalue", "no number", "a finite number", remedy));
        }
        let scale = |name: &String| if needed.contains(name) { [1.0; 3] } else { [0.0; 3] };
        let near = isovalue.and_then(|c| Isovalues::near(scene.volume, c, NEAR_CELLS));
        let settings = PhotonSettings {
            photons,
            albedo: [1.0; 3],
            isovalues: near.unwrap_or_default(),
            kept: Kept::BeganSpecular,
            most_bounces: layers.saturating_sub(1) as u32,
            roulette: false,
            scales: geometry.luminaires().iter().map(|l| scale(&l.name)).collect(),
            seed,
            memory_limit,
            ..PhotonSettings::default()
        };
        let map = PhotonMap::new(&PhotonScene { light: None, ..*scene }, &settings)?;
        Ok(Some(Self { map, layers }))
    }

    /// The photons, and where all of them went.
    pub fn map(&self) -> &PhotonMap {
        &self.map
    }
}

impl std::fmt::Debug for SpecularPhotons {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SpecularPhotons").field("hits", &self.map.len()).field("layers", &self.layers).finish()
    }
}

impl SpecularLight for SpecularPhotons {
    fn arriving(
        &self,
        in_grid: DVec3,
        raw_gradient: Vec3,
        raw_isovalue: f64,
        normal: Normal,
        add: &mut dyn FnMut(Arrival),
    ) {
        let query = self.map.query_of(in_grid, raw_gradient, raw_isovalue, normal);
        let mut nearest = Nearest::default();
        for (kind, search) in [(Kind::Caustic, PhotonSearch::of_caustics()), (Kind::Usual, PhotonSearch::default())] {
            if self.map.photons_of(kind).is_empty() {
                continue;
            }
            let Some(found) = self.map.find_near(&query, kind, &search, &mut nearest) else { continue };
            let factor = 1.0 / (std::f64::consts::PI * found.measure);
            self.map.for_counted(&query, kind, &search, &nearest, &mut |photon| {
                let layer = usize::from(photon.bounce);
                if let (Origin::Luminaire(l), true) = (photon.origin(), layer < self.layers) {
                    add(Arrival { luminaire: l as usize, layer, light: photon.flux_of().map(|f| f * factor) });
                }
            });
        }
    }
}
