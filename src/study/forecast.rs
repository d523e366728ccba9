//! What a bake will take and give: a short pilot on the user's own scene, for textures of several resolutions.

use super::model::{Forecast, Pilot};
use super::{Clock, Study};
use crate::bake::{Estimator, Quality, bytes_of_scene_texel, spread};
use crate::compare::{LitSurface, unburied};
use crate::error::{Error, Result};
use crate::level::Pyramid;
use crate::probe::{Orientation, Probe};
use crate::scene::Member;
use crate::session::Isosurface;
use crate::transfer::{Lattice, Layers, Layout, Selection, texels_of_isosurfaces};
use crate::transport::{Settings, needs_photons, trial};
use crate::volume::Isovalue;
use serde_json::{Value, json};

/// Resolutions that a forecast weighs against each other, the finest first.
pub const RATIOS: [f64; 3] = [1.0, 0.5, 0.25];
/// Points of the surface at most.
pub const POINTS: u32 = 400;
/// Points, paths at each, and paths for each exact texel: a few seconds on two cores.
const EFFORT: (usize, u32, u32) = (POINTS as usize, 1024, 1024);
/// The same in a scene, whose paths are several times longer and ask every luminaire at each turn. With four times the
/// paths of the pilot's second bake the noise of the exact texels is a seventh of that bake's, and known well enough to
/// be taken out.
const EFFORT_IN_SCENE: (usize, u32, u32) = (200, 256, 256);
/// The two bakes of a pilot.
const RAYS: [u32; 2] = [16, 64];
/// Bricks that are timed.
const BRICKS: usize = 48;

/// What is asked about.
#[derive(Clone, Copy)]
pub struct Question<'a> {
    /// Where accuracy is looked at, at about [`POINTS`] points; coefficients of the bands of `layers`.
    pub surface: LitSurface<'a>,
    /// Layers of the texture; of three channels in a scene.
    pub layers: &'a Layers,
    /// Seed of the trial bakes.
    pub seed: u64,
}

/// The pilot of one resolution.
#[derive(Clone, Debug, PartialEq)]
pub struct Weighed {
    /// Texels to a sample of the volume along an axis.
    pub ratio: f64,
    /// What was found.
    pub pilot: Pilot,
    /// Stored bytes of the texels.
    pub bytes: u64,
}

impl Weighed {
    /// The same for a scene of several volumes: `texels` more are baked with the same ratio and rays, and take as long
    /// each. So the time is shared out among the volumes by their numbers of texels.
    pub fn add(&mut self, texels: u64) {
        self.bytes += self.bytes / self.pilot.texels.max(1) * texels;
        self.pilot.texels += texels;
    }

    /// A forecast for programs; seconds are those of so many threads.
    pub fn to_json(&self, forecast: &Forecast, threads: usize) -> Value {
        json!({
            "texture": self.ratio, "rays": forecast.rays, "cpu_seconds": forecast.seconds,
            "seconds": forecast.seconds / threads as f64, "error": forecast.error, "bytes": self.bytes,
            "texels": self.pilot.texels, "floor": self.pilot.accuracy.floor.sqrt(),
        })
    }
}

/// Refuses the estimators that are not forecast, for what `option` asks.
///
/// # Errors
/// For another one than `path`.
pub fn check(option: &str, estimator: Estimator) -> Result<()> {
    if estimator == Estimator::Path {
        return Ok(());
    }
    // Their texels depend on all others: a pilot would be the whole bake.
    let (found, expected) =
        (format!("--estimator {}", estimator.name()), "the estimator path, which alone is forecast");
    Err(Error::argument(option, found, expected, "give a number of --rays"))
}

/// A pilot for each of `ratios`; `selected` gives the texels that a bake on a lattice needs.
///
/// # Errors
/// When no light reaches the points, or there are none; as [`Study::references`] and [`trial`].
pub fn pilots(
    question: &Question<'_>,
    ratios: &[f64],
    selected: &dyn Fn(Lattice) -> Selection,
    clock: &Clock<'_>,
) -> Result<Vec<Weighed>> {
    let Question { surface, layers, seed } = *question;
    let lattices =
        ratios.iter().map(|&ratio| Lattice::from_ratio(surface.volume.dims(), ratio)).collect::<Result<Vec<_>>>()?;
    let (points, paths, texel_rays) = if surface.geometry.is_some() { EFFORT_IN_SCENE } else { EFFORT };
    let surface = LitSurface { points: &surface.points[..points.min(surface.points.len())], ..surface };
    let study = Study { surface, paths, texel_rays, layers: layers.len(), seed: seed ^ 0x70 };
    let references = study.references(&[layers.max_bands()], &lattices)?;
    let mut all = Vec::new();
    for (&ratio, &lattice) in ratios.iter().zip(&lattices) {
        let accuracy = study.accuracy(&references, lattice, layers, RAYS)?;
        let selection = selected(lattice);
        let layout = Layout { lattice, layers: layers.clone() };
        let bricks = spread(&selection.bricks(), BRICKS);
        let mut seconds_per_texel = [0.0; 2];
        for (seconds, rays) in seconds_per_texel.iter_mut().zip(RAYS) {
            let settings = Settings { layers: layers.clone(), rays, seed, target: None, positive: false };
            let job = surface.bake(&layout, &settings, &selection);
            let [_, before] = clock();
            let texels = trial(&job, &bricks)?.texels;
            let [_, after] = clock();
            *seconds = (after - before) / texels.max(1) as f64;
        }
        let texels = selection.len();
        let pilot = Pilot { rays: RAYS, seconds_per_texel, accuracy, texels };
        all.push(Weighed { ratio, pilot, bytes: texels * bytes_of_scene_texel(layers, surface.geometry) });
    }
    Ok(all)
}

/// The most exact forecast that takes no more than so many processor seconds; `None` if nothing does.
pub fn best_within(all: &[Weighed], seconds: f64) -> Option<(&Weighed, Forecast)> {
    let each = all.iter().filter_map(|w| Some((w, w.pilot.most_within(seconds)?)));
    each.min_by(|a, b| a.1.error.total_cmp(&b.1.error))
}

/// The cheapest forecast of at most this error; `None` if none has it.
pub fn cheapest_within(all: &[Weighed], error: f64) -> Option<(&Weighed, Forecast)> {
    let each = all.iter().filter_map(|w| Some((w, w.pilot.least_within(error)?)));
    each.min_by(|a, b| a.1.seconds.total_cmp(&b.1.seconds))
}

/// What is forecast.
#[derive(Clone, Copy)]
pub struct Asked<'a> {
    /// The volumes of the scene.
    pub members: &'a [Member],
    /// Those asked for, of each; `None` for all.
    pub isovalues: &'a [Option<Vec<f64>>],
    /// How the bake is asked for: its layers, effects and seed.
    pub quality: &'a Quality,
    /// The light.
    pub probe: &'a Probe,
    /// How it stands around the first volume.
    pub orientation: Orientation,
    /// Of the surface.
    pub albedo: f32,
}

/// The pilots of a bake, and the isovalue of the first volume at which accuracy is looked at: the first asked for. Of
/// several volumes the first is tried; the others get the same ratio and rays, and so a share of the time by their
/// numbers of texels.
///
/// # Errors
/// When a volume has no surface; as [`pilots`].
pub fn weigh(asked: &Asked<'_>, clock: &Clock<'_>) -> Result<(f64, Vec<Weighed>)> {
    let Some((first, others)) = asked.members.split_first() else {
        return Err(Error::argument("scene", "no volume", "at least one", "give a volume"));
    };
    let (volume, geometry) = (&*first.volume, first.geometry.as_ref());
    let of = |member: usize| asked.isovalues.get(member).and_then(Option::as_deref);
    let isovalue = match of(0) {
        Some([first, ..]) => *first,
        _ => first.choose(Isovalue::Auto)?.value,
    };
    let layers = asked.quality.layout(volume, geometry)?.layers;
    let pyramid = Pyramid::new(volume);
    let surface = Isosurface::extract(volume, &pyramid, isovalue)?;
    let points = surface.random_points(POINTS, asked.quality.seed ^ 0x70);
    let points = unburied(volume, &pyramid, geometry, isovalue, points);
    let question = Question {
        surface: LitSurface {
            volume,
            pyramid: &pyramid,
            geometry,
            caustics: asked.quality.effects.switched("caustics") != Some(false)
                && geometry.is_none_or(|geometry| needs_photons(geometry).is_empty()),
            specular: None,
            isovalue,
            points: &points,
            light: &asked.probe.source(asked.orientation),
            coefficients: &asked.probe.coefficients_in_world(layers.max_bands(), asked.orientation),
            albedo: [asked.albedo; 3],
            emission: [0.0; 3],
            scales: &[],
            vertices: None,
        },
        layers: &layers,
        seed: asked.quality.seed,
    };
    let selected = |lattice| texels_of_isosurfaces(volume, lattice, of(0));
    let mut all = pilots(&question, &RATIOS, &selected, clock)?;
    for weighed in &mut all {
        for (i, other) in others.iter().enumerate() {
            let lattice = Lattice::from_ratio(other.volume.dims(), weighed.ratio)?;
            weighed.add(texels_of_isosurfaces(&other.volume, lattice, of(1 + i)).len());
        }
    }
    Ok((isovalue, all))
}
