//! What a bake will take and give, for `plan` and `bake --auto`: the pilot of the library on the user's own scene.

use super::isovalue::Isovalue;
use super::{Failure, Outcome, text};
use crate::compare::{LitSurface, unburied};
use crate::level::Pyramid;
use crate::probe::{Orientation, Probe};
use crate::scene::Member;
use crate::session::Isosurface;
use crate::study::forecast::{POINTS, Question, RATIOS, Weighed, pilots};
use crate::study::model::Forecast;
use crate::transfer::{Lattice, Layers, texels_of_isosurfaces};
use crate::transport::needs_photons;
use cpu_time::ProcessTime;
use serde_json::{Value, json};
use std::time::Instant;

/// What is forecast.
pub(super) struct Asked<'a> {
    /// The volumes of the scene.
    pub(super) members: &'a [Member],
    /// Those asked for, of each; `None` for all.
    pub(super) isovalues: &'a [Option<Vec<f64>>],
    /// Layers of the texture of the first.
    pub(super) layers: &'a Layers,
    pub(super) probe: &'a Probe,
    pub(super) orientation: Orientation,
    pub(super) albedo: f32,
    /// Whether caustics are baked.
    pub(super) caustics: bool,
    pub(super) seed: u64,
}

/// The clock of pilots and studies: wall-clock and processor seconds from now on.
pub(super) fn clock() -> impl Fn() -> [f64; 2] {
    let (wall, cpu) = (Instant::now(), ProcessTime::now());
    move || [wall.elapsed().as_secs_f64(), cpu.elapsed().as_secs_f64()]
}

/// The pilots of a bake, and the isovalue of the first volume at which accuracy is looked at: the first asked for. Of
/// several volumes the first is tried; the others get the same ratio and rays, and so a share of the time by their
/// numbers of texels.
pub(super) fn weigh(asked: &Asked<'_>) -> Outcome<(f64, Vec<Weighed>)> {
    let Some((first, others)) = asked.members.split_first() else {
        return Err(Failure::Message("a scene without volumes".into()));
    };
    let (volume, geometry) = (&*first.volume, first.geometry.as_ref());
    let of = |member: usize| asked.isovalues.get(member).and_then(Option::as_deref);
    let isovalue = match of(0) {
        Some([first, ..]) => *first,
        _ => first.choose(Isovalue::Auto)?.value,
    };
    let pyramid = Pyramid::new(volume);
    let surface = Isosurface::extract(volume, &pyramid, isovalue)?;
    let points = surface.random_points(POINTS, asked.seed ^ 0x70);
    let points = unburied(volume, &pyramid, geometry, isovalue, points);
    let question = Question {
        surface: LitSurface {
            volume,
            pyramid: &pyramid,
            geometry,
            caustics: asked.caustics && geometry.is_none_or(|geometry| needs_photons(geometry).is_empty()),
            specular: None,
            isovalue,
            points: &points,
            light: &asked.probe.source(asked.orientation),
            coefficients: &asked.probe.coefficients_in_world(asked.layers.max_bands(), asked.orientation),
            albedo: [asked.albedo; 3],
            emission: [0.0; 3],
            scales: &[],
            vertices: None,
        },
        layers: asked.layers,
        seed: asked.seed,
    };
    let selected = |lattice| texels_of_isosurfaces(volume, lattice, of(0));
    let mut all = pilots(&question, &RATIOS, &selected, &clock())?;
    for weighed in &mut all {
        for (i, other) in others.iter().enumerate() {
            let lattice = Lattice::from_ratio(other.volume.dims(), weighed.ratio)?;
            weighed.add(texels_of_isosurfaces(&other.volume, lattice, of(1 + i)).len());
        }
    }
    Ok((isovalue, all))
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
