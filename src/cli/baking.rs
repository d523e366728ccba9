//! A bake from the command line: the library's request from options, and a console that watches it.

use super::bake_report::Told;
use super::console::{Console, interrupts};
use super::options::{BakeArgs, TransferArgs};
use super::{Outcome, plan_table, signals};
use crate::bake::{self, Estimator, ForLight, Goal, Hints, Observer, Report, Request, Task, Writing, layout_of_scene};
use crate::error::Result;
use crate::memory;
use crate::scene::geometry::Geometry;
use crate::scene::{Effects, Member, Plan, SceneFile};
use crate::transfer::Layout;
use crate::transfer::store::Store;
use crate::transport::{Progress, Settings};
use crate::volume::Volume;
use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;

/// What the options of `bake` and `plan` ask for.
pub(super) fn request<'a>(
    opened: &'a Member,
    scene: Option<&SceneFile>,
    options: &BakeArgs,
    isovalues: Option<Vec<f64>>,
    layout: Layout,
    (settings, goal): (Settings, Goal),
    effects: &'a Effects,
) -> Request<'a> {
    let volume = &opened.volume;
    let estimator: Estimator = options.estimator.into();
    Request {
        goal,
        estimator,
        surfaces: isovalues.is_some() && options.transfer.bakes_surfaces() && estimator == Estimator::Path,
        hints: hints(scene, volume.value_range(), isovalues.as_deref()),
        isovalues,
        memory_limit: options.transfer.memory_limit,
        geometry: opened.geometry.as_ref(),
        ..Request::new(volume, &opened.label, layout, settings, effects)
    }
}

/// What a store of the cache is baked for: the volume of `relight` and `view`, for these isovalues or for all. `bands` are those
/// of the layers of the texture.
pub(super) fn request_of_cache<'a>(
    (volume, label, geometry): (&'a Volume, &'a str, Option<&'a Geometry>),
    transfer: &TransferArgs,
    bands: &[u8],
    isovalues: Option<Vec<f64>>,
    (seed, lights): (u64, Vec<ForLight>),
    effects: &'a Effects,
) -> Result<Request<'a>> {
    let layout = layout_of_scene(transfer.layout(volume, bands)?, geometry);
    let (settings, goal) = transfer.settings(&layout, seed, (lights, None), true);
    Ok(Request {
        goal,
        surfaces: isovalues.is_some() && transfer.bakes_surfaces(),
        isovalues,
        memory_limit: transfer.memory_limit,
        writing: Writing::of_cache(),
        geometry,
        ..Request::new(volume, label, layout, settings, effects)
    })
}

/// What a scene says of the light to come, of some isovalues or of all.
fn hints(scene: Option<&SceneFile>, range: (f64, f64), isovalues: Option<&[f64]>) -> Hints {
    let Some(file) = scene else { return Hints::default() };
    let scene = &file.description;
    Hints {
        albedo: scene.albedo.as_ref().map(|albedo| albedo.rule(range).largest_albedo(isovalues)),
        emission: Some(scene.emission.as_ref().map_or(0.0, |emission| emission.largest(isovalues))),
        sun_split: scene.probe.as_ref().and_then(|probe| probe.sun_split).unwrap_or_default(),
        shown: false,
    }
}

/// Refuses what does not fit into the memory that the user or the system allows, and what cannot be done.
pub(super) fn check(request: &Request<'_>) -> Result<()> {
    let what = format!("the bake of {}", request.label);
    memory::check(&what, request.bytes_needed(), request.memory_limit)?;
    request.check()
}

/// Bakes what is missing or damaged into the store at `path`, while the console shows how far it is. `start`: when the
/// command began.
pub(super) fn fill(request: &Request<'_>, path: &Path, start: Instant, console: &Console) -> Outcome<(Store, Report)> {
    check(request)?;
    let limit = request.memory_limit.unwrap_or_else(memory::default_limit);
    let request = Request { memory_limit: Some(limit), ..request.clone() };
    let (store, report) = bake::run(&request, path, &Watcher { console, start, guard: Mutex::new(None) })?;
    report.cut_paths().iter().chain(&report.missed_goal()).for_each(|warning| console.note(warning));
    Ok((store, report))
}

/// The console as the observer of a bake.
struct Watcher<'a> {
    console: &'a Console,
    start: Instant,
    guard: Mutex<Option<signals::Guard>>,
}

impl Observer for Watcher<'_> {
    fn note(&self, text: &str) {
        self.console.note(text);
    }

    fn plan(&self, plan: &Plan) {
        self.console.print(plan_table::table(plan));
    }

    fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    fn begin(&self) {
        if let Ok(mut guard) = self.guard.lock() {
            *guard = Some(self.console.guard());
        }
    }

    fn wants_stop(&self) -> bool {
        interrupts() > 0
    }

    fn watch(&self, task: Task, items: u64, progress: &Progress, work: &mut dyn FnMut()) {
        match task {
            // A request to stop loses nothing of photons but the time they took: the first one ends them.
            Task::Photons => self.console.watch_first("photons", items, progress, work),
            _ => self.console.watch("bake", items, progress, work),
        }
    }
}
