//! Transfer from photons: the estimator `photon`.
//!
//! A photon knows where in the environment it came from. Under a light that is 1 from everywhere and at an albedo of 1, a map gives
//! T_k,i(x) = (1/π) Σ F Y_i(ω) / (g V) over the photons near x that were reflected k times. Such a map is made for the purpose,
//! without roulette, cut after the last layer. A texel takes the nearest photons of all layers together, so that layers of little light rest on few.

use super::estimate::{Kind, PhotonSearch};
use super::map::{PhotonMap, PhotonScene, PhotonSettings};
use super::packing::Origin;
use super::tree::Nearest;
use crate::error::{Error, Result};
use crate::geom::Direction;
use crate::level::{Counts, LevelField, Site};
use crate::sampling::{DirectionSample, DirectionalSource, warp};
use crate::sh;
use crate::transport::bake::{Bake, Present, Progress, Sink, fill_alone};
use crate::transport::path::{Scratch, TexelEstimate};
use crate::transport::{PhotonEnergy, Summary};
use crate::volume::{Sample, with_samples};

/// What the estimator is asked for beyond [`super::super::Settings`], whose `rays` are the photons that a texel takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotonBake {
    /// Photons sent out.
    pub photons: u32,
    /// γ, see [`PhotonSettings`].
    pub gamma: f32,
    /// Most bytes that the map may take.
    pub memory_limit: u64,
}

impl PhotonBake {
    /// What suits a texture of so many texels (those without a level set counted too), each of which takes `rays` photons:
    /// a photon for every 16 of those, at least 2¹⁶ and at most 2²⁴; γ = 1; a map of at most 2 GiB.
    pub fn for_texels(texels: u64, rays: u32) -> Self {
        let photons = (texels * u64::from(rays) / 16).clamp(1 << 16, 1 << 24) as u32;
        Self { photons, gamma: 1.0, memory_limit: 2 << 30 }
    }
}

/// Radiance 1 from everywhere.
struct Everywhere;

impl DirectionalSource for Everywhere {
    fn sample(&self, u: [f32; 2]) -> Option<DirectionSample> {
        let direction = Direction::from_unit(warp::square_to_uniform_sphere(u));
        Some(DirectionSample { direction, radiance: [1.0; 3], density: warp::uniform_sphere_pdf() })
    }

    fn density(&self, _: Direction) -> f32 {
        warp::uniform_sphere_pdf()
    }

    fn radiance(&self, _: Direction) -> [f32; 3] {
        [1.0; 3]
    }
}

/// The map that [`photon_bake_from`] reads, whatever chunks are asked of it; `None` when `progress` was cancelled.
///
/// # Errors
/// As [`PhotonMap::new`]; rays that are not a power of two of at least 4; settings with a target.
pub fn photon_bake_map(bake: &Bake<'_>, settings: &PhotonBake, progress: &Progress) -> Result<Option<PhotonMap>> {
    check(bake)?;
    let settings = PhotonSettings {
        photons: settings.photons,
        albedo: [1.0; 3],
        gamma: settings.gamma,
        most_bounces: bake.settings.layers.len() as u32 - 1,
        roulette: false,
        seed: bake.settings.seed,
        memory_limit: settings.memory_limit,
        ..PhotonSettings::default()
    };
    PhotonMap::watched(&PhotonScene::alone(bake.volume, bake.pyramid, &Everywhere), &settings, progress)
}

/// Bakes the selected texels from the map of [`photon_bake_map`], and hands out the chunks asked for as
/// [`super::super::bake()`] does; `present` likewise. The rays of the map are not in the summary.
///
/// # Errors
/// Those of [`super::super::bake()`]; settings with a target.
pub fn photon_bake_from(
    bake: &Bake<'_>,
    map: &PhotonMap,
    chunks: &[[usize; 3]],
    progress: &Progress,
    present: &Present<'_>,
    sink: &mut Sink<'_>,
) -> Result<Summary> {
    check(bake)?;
    let search = PhotonSearch { neighbours: bake.settings.rays + 1, ..PhotonSearch::default() };
    with_samples!(bake.volume.samples(), s => {
        let field = LevelField::new(bake.volume, s, bake.pyramid);
        let estimator = |site: &Site, _: u64, scratch: &mut Scratch, _: &mut Counts, out: &mut TexelEstimate| {
            from_photons(&field, bake, map, &search, site, &mut scratch.nearest, out);
        };
        fill_alone(&field, bake, &estimator, chunks, progress, present, sink)
    })
}

/// Makes the map and bakes from it; its rays are in the summary. Where `progress` is cancelled, it ends with what it has.
///
/// # Errors
/// Those of [`photon_bake_map`] and [`photon_bake_from`].
pub fn photon_bake(
    bake: &Bake<'_>,
    settings: &PhotonBake,
    chunks: &[[usize; 3]],
    progress: &Progress,
    present: &Present<'_>,
    sink: &mut Sink<'_>,
) -> Result<(Summary, PhotonEnergy)> {
    check(bake)?;
    let nothing = || (Summary::new(std::slice::from_ref(&bake.settings.layers)), PhotonEnergy::default());
    if chunks.is_empty() {
        // A volume without a surface has nothing to bake, and no isovalue to draw.
        return Ok(nothing());
    }
    let Some(map) = photon_bake_map(bake, settings, progress)? else { return Ok(nothing()) };
    let mut summary = photon_bake_from(bake, &map, chunks, progress, present, sink)?;
    summary.counts += map.counts();
    Ok((summary, map.energy()))
}

fn check(bake: &Bake<'_>) -> Result<()> {
    bake.check()?;
    if bake.settings.target.is_some() {
        let remedy = "leave it out, or use the estimator path";
        return Err(Error::argument("target", "with the estimator photon", "none: its error has a bias", remedy));
    }
    Ok(())
}

/// The transfer of one texel.
fn from_photons<T: Sample>(
    field: &LevelField<'_, T>,
    bake: &Bake<'_>,
    map: &PhotonMap,
    search: &PhotonSearch,
    site: &Site,
    nearest: &mut Nearest,
    out: &mut TexelEstimate,
) {
    let layers = &bake.settings.layers;
    let query = map.query(field, &site.start.at, f64::from(site.isovalue), site.normal);
    let mut transfer = vec![0.0f64; layers.coefficients()];
    let mut squares = vec![0.0f64; layers.len()];
    let mut basis = [0.0f32; sh::MAX_BANDS * sh::MAX_BANDS];
    if let Some(found) = map.find_near(&query, Kind::Usual, search, nearest) {
        let factor = 1.0 / (std::f64::consts::PI * found.measure);
        map.for_counted(&query, Kind::Usual, search, nearest, &mut |photon| {
            let k = usize::from(photon.bounce);
            if let (true, Origin::Environment(source)) = (k < layers.len(), photon.origin()) {
                let bands = layers.bands()[k];
                let weight = f64::from(photon.flux) * factor;
                sh::basis::evaluate_f32(bands, source, &mut basis);
                for i in 0..bands * bands {
                    transfer[layers.offset(k) + i] += weight * f64::from(basis[i]);
                }
                squares[k] += weight * weight;
            }
        });
    }
    *out = TexelEstimate { rays: bake.settings.rays, ..TexelEstimate::default() };
    out.transfer.extend(transfer.iter().map(|&v| v as f32));
    // The mean over m of Y_lm² is 1/4π in every band, by the addition theorem.
    let per_coefficient = 1.0 / (4.0 * std::f64::consts::PI);
    for (k, &bands) in layers.bands().iter().enumerate() {
        out.stderr.extend(std::iter::repeat_n((squares[k] * per_coefficient).sqrt() as f32, bands));
    }
    out.escape_stderr = squares.iter().sum::<f64>().sqrt() as f32;
    out.target_stderr = out.escape_stderr;
}
