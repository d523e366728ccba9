//! What a bake will take and give: a short pilot on the user's own volume, for textures of several resolutions.

use super::{Outcome, text};
use crate::bake::{Estimator, bytes_of_texel, spread};
use crate::error::Error;
use crate::level::Pyramid;
use crate::probe::{Orientation, Probe};
use crate::session::Isosurface;
use crate::study::Study;
use crate::study::model::{Forecast, Pilot};
use crate::transfer::{Lattice, Layers, Layout, Selection};
use crate::transport::{Bake, Settings, trial};
use crate::volume::Volume;
use cpu_time::ProcessTime;
use serde_json::{Value, json};

/// Resolutions that a forecast weighs against each other, the finest first.
pub(super) const RATIOS: [f64; 3] = [1.0, 0.5, 0.25];
/// Points, paths at each, and paths for each exact texel: a few seconds on two cores.
const POINTS: u32 = 400;
const PATHS: u32 = 1024;
const TEXEL_RAYS: u32 = 1024;
/// The two bakes of a pilot.
const RAYS: [u32; 2] = [16, 64];
/// Bricks that are timed.
const BRICKS: usize = 48;

/// What is asked about.
pub(super) struct Question<'a> {
    pub(super) volume: &'a Volume,
    pub(super) pyramid: &'a Pyramid,
    /// Where accuracy is looked at.
    pub(super) isovalue: f64,
    pub(super) probe: &'a Probe,
    pub(super) orientation: Orientation,
    pub(super) albedo: [f32; 3],
    pub(super) layers: &'a Layers,
    pub(super) seed: u64,
}

/// The pilot of one resolution.
pub(super) struct Weighed {
    pub(super) ratio: f64,
    pub(super) pilot: Pilot,
    /// Stored bytes of the texels.
    pub(super) bytes: u64,
}

/// Refuses what the pilot knows nothing of: `option` asks, of a scene or of a volume alone.
pub(super) fn check(option: &str, is_scene: bool, estimator: Estimator) -> Result<(), Error> {
    let refuse = |found: &str, expected| Err(Error::argument(option, found, expected, "give a number of --rays"));
    match estimator {
        _ if is_scene => refuse("a scene with walls or luminaires", "a volume without them"),
        Estimator::Path => Ok(()),
        // Their texels depend on all others: a pilot would be the whole bake.
        Estimator::Gather => refuse("--estimator gather", "the estimator path, which alone is forecast"),
        Estimator::Photon => refuse("--estimator photon", "the estimator path, which alone is forecast"),
    }
}

/// A pilot for each of `ratios`; `selected` gives the texels that a bake on a lattice needs.
pub(super) fn pilots(
    question: &Question<'_>,
    ratios: &[f64],
    selected: &dyn Fn(Lattice) -> Selection,
) -> Outcome<Vec<Weighed>> {
    let q = question;
    let lattices =
        ratios.iter().map(|&ratio| Lattice::from_ratio(q.volume.dims(), ratio)).collect::<Result<Vec<_>, Error>>()?;
    let surface = Isosurface::extract(q.volume, q.pyramid, q.isovalue)?;
    let points = surface.random_points(POINTS, q.seed ^ 0x70);
    let source = q.probe.source(q.orientation);
    let bands = q.layers.max_bands();
    let coefficients = q.probe.coefficients_in_world(bands, q.orientation);
    let study = Study {
        volume: q.volume,
        pyramid: q.pyramid,
        isovalue: q.isovalue,
        points: &points,
        light: &source,
        coefficients: &coefficients,
        albedo: q.albedo,
        paths: PATHS,
        texel_rays: TEXEL_RAYS,
        layers: q.layers.len(),
        seed: q.seed ^ 0x70,
    };
    let references = study.references(&[bands], &lattices)?;
    let mut all = Vec::new();
    for (&ratio, &lattice) in ratios.iter().zip(&lattices) {
        let accuracy = study.accuracy(&references, lattice, q.layers, RAYS)?;
        let selection = selected(lattice);
        let layout = Layout { lattice, layers: q.layers.clone() };
        let bricks = spread(&selection.bricks(), BRICKS);
        let mut seconds_per_texel = [0.0; 2];
        for (seconds, rays) in seconds_per_texel.iter_mut().zip(RAYS) {
            let settings = Settings { layers: q.layers.clone(), rays, seed: q.seed, target: None, positive: false };
            let (volume, pyramid) = (q.volume, q.pyramid);
            let job = Bake::new(volume, pyramid, &layout, &settings, &selection);
            let clock = ProcessTime::now();
            let texels = trial(&job, &bricks)?.texels;
            *seconds = clock.elapsed().as_secs_f64() / texels.max(1) as f64;
        }
        let texels = selection.len();
        let pilot = Pilot { rays: RAYS, seconds_per_texel, accuracy, texels };
        all.push(Weighed { ratio, pilot, bytes: texels * bytes_of_texel(q.layers) });
    }
    Ok(all)
}

/// The most exact forecast that takes no more than so many processor seconds; `None` if nothing does.
pub(super) fn best_within(all: &[Weighed], seconds: f64) -> Option<(&Weighed, Forecast)> {
    let each = all.iter().filter_map(|w| Some((w, w.pilot.most_within(seconds)?)));
    each.min_by(|a, b| a.1.error.total_cmp(&b.1.error))
}

/// The cheapest forecast of at most this error; `None` if none has it.
pub(super) fn cheapest_within(all: &[Weighed], error: f64) -> Option<(&Weighed, Forecast)> {
    let each = all.iter().filter_map(|w| Some((w, w.pilot.least_within(error)?)));
    each.min_by(|a, b| a.1.seconds.total_cmp(&b.1.seconds))
}

/// All forecasts from 16 to 4096 rays, the chosen one marked.
pub(super) fn table(all: &[Weighed], chosen: Option<(f64, u32)>, threads: usize) -> String {
    let mut lines =
        vec![["texture", "rays", "time", "error", "of it floor", "texels", "size", ""].map(String::from).to_vec()];
    for weighed in all {
        for rays in (4..=12).step_by(2).map(|k| 1u32 << k) {
            let forecast = weighed.pilot.forecast(rays);
            lines.push(line(weighed, &forecast, threads, chosen == Some((weighed.ratio, rays))));
        }
        if let Some((ratio, rays)) = chosen
            && ratio == weighed.ratio
            && (rays.trailing_zeros() % 2 == 1 || !(16..=4096).contains(&rays))
        {
            lines.push(line(weighed, &weighed.pilot.forecast(rays), threads, true));
        }
    }
    text::table(&lines)
}

fn line(weighed: &Weighed, forecast: &Forecast, threads: usize, is_chosen: bool) -> Vec<String> {
    vec![
        weighed.ratio.to_string(),
        forecast.rays.to_string(),
        text::duration(std::time::Duration::from_secs_f64(forecast.seconds / threads as f64)),
        text::percent(forecast.error),
        text::percent(weighed.pilot.accuracy.floor.sqrt()),
        text::count(weighed.pilot.texels),
        text::bytes(weighed.bytes as f64),
        if is_chosen { "chosen".into() } else { String::new() },
    ]
}

/// For programs.
pub(super) fn to_json(weighed: &Weighed, forecast: &Forecast, threads: usize) -> Value {
    json!({
        "texture": weighed.ratio, "rays": forecast.rays, "cpu_seconds": forecast.seconds,
        "seconds": forecast.seconds / threads as f64, "error": forecast.error, "bytes": weighed.bytes,
        "texels": weighed.pilot.texels, "floor": weighed.pilot.accuracy.floor.sqrt(),
    })
}
