//! Bakes as Python asks for them.

use super::watch;
use crate::bake::{Bake, Estimator, ForLight, Observer, Report, Request, Writing, run};
use crate::cache::{InUse, for_light};
use crate::cli::Failure;
use crate::cli::shared::ready;
use crate::error::{Error, Result};
use crate::memory;
use crate::probe::{EnvFrame, Probe};
use crate::scene::{Scene, TextureSize};
use crate::volume::Isovalue;
use std::path::PathBuf;
use std::sync::Arc;

/// What a bake is asked for, beside the isovalues.
#[derive(Clone)]
pub(super) struct Settings {
    pub(super) error: Option<f32>,
    pub(super) time: Option<f64>,
    pub(super) rays: Option<u32>,
    pub(super) layers: usize,
    pub(super) bands: Option<usize>,
    pub(super) texture: Option<TextureSize>,
    pub(super) positive: bool,
    pub(super) estimator: Estimator,
    pub(super) seed: u64,
    pub(super) memory_limit: Option<u64>,
    pub(super) threads: Option<usize>,
    /// Environments that errors are measured by, with their turns, and the albedo of the surface under them.
    pub(super) lights: Vec<(Arc<Probe>, f64)>,
    pub(super) albedo: f32,
}

/// Where a bake goes.
#[derive(Clone)]
pub(super) enum Place {
    /// Into a store of the user's.
    Store(PathBuf),
    /// Into the cache, in this folder or in that of the system.
    Cache(Option<PathBuf>),
}

/// A store that was filled.
pub(super) struct Filled {
    pub(super) path: PathBuf,
    pub(super) scene: Arc<Scene>,
    /// Keeps a store of the cache there.
    pub(super) in_use: Option<InUse>,
    pub(super) reports: Vec<Report>,
    /// What the user should know.
    pub(super) warnings: Vec<String>,
}

/// An estimator by name.
///
/// # Errors
/// When there is none of that name.
pub(super) fn estimator(name: &str) -> Result<Estimator> {
    let all = [Estimator::Path, Estimator::Gather, Estimator::Photon];
    all.into_iter().find(|e| e.name() == name).ok_or_else(|| {
        let names = all.map(Estimator::name).join(", ");
        Error::argument("estimator", name, format!("one of {names}"), "leave it out for path")
    })
}

impl Settings {
    /// A bake of a scene for some isovalues of its first volume, or for all.
    fn bake<'a>(&self, scene: &'a Scene, isovalues: Option<&[f64]>) -> Result<Bake<'a>> {
        let limit = self.memory_limit.unwrap_or_else(memory::default_limit);
        let mut bake = Bake::of(scene).layers(self.layers).seed(self.seed).positive(self.positive).memory_limit(limit);
        bake = bake.estimator(self.estimator);
        if let Some(list) = isovalues {
            bake = bake.isovalues(list.iter().copied());
        }
        if let Some(bands) = self.bands {
            bake = bake.bands(bands);
        }
        if let Some(size) = self.texture {
            bake = bake.texture(size);
        }
        if let Some(rays) = self.rays {
            bake = bake.rays(rays);
        }
        if let Some(error) = self.error {
            bake = bake.error(error);
        }
        if let Some(seconds) = self.time {
            bake = bake.seconds(seconds);
        }
        for light in self.lights_of(scene)? {
            bake = bake.for_light(light);
        }
        Ok(bake)
    }

    fn lights_of(&self, scene: &Scene) -> Result<Vec<ForLight>> {
        let up = scene.members().first().map(|member| member.volume.up).unwrap_or_default();
        let bands = self.bands.unwrap_or(USUAL_BANDS);
        let one =
            |(probe, turn): &(Arc<Probe>, f64)| for_light(probe, (up, *turn, EnvFrame::default()), bands, self.albedo);
        self.lights.iter().map(one).collect()
    }
}

/// Bands of the layer that has the most, where nothing is asked for.
const USUAL_BANDS: usize = 8;

/// Isovalues as they were given, of the first volume; the side that is matter becomes that of the volumes.
fn settle(scene: &mut Scene, asked: Option<&[Isovalue]>, warnings: &mut Vec<String>) -> Result<Option<Vec<f64>>> {
    let Some(asked) = asked else {
        scene.members().iter().try_for_each(|member| member.check_all())?;
        return Ok(None);
    };
    let mut of_first = Vec::new();
    for (i, member) in scene.members_mut().iter_mut().enumerate() {
        let chosen = if member.is_among_others() {
            let chosen = asked.iter().map(|&c| member.choose(c)).collect::<Result<Vec<_>>>()?;
            member.take_side(&chosen)?;
            chosen
        } else {
            member.settle(asked, &|_, error| error)?
        };
        warnings.extend(chosen.iter().filter_map(|c| c.warning.clone()));
        if i == 0 {
            of_first = chosen.iter().map(|c| c.value).collect();
        }
    }
    Ok(Some(of_first))
}

/// Bakes a scene for some isovalues, or for all.
///
/// # Errors
/// Those of the bake.
pub(super) fn fill(
    scene: &Scene,
    asked: Option<&[Isovalue]>,
    settings: &Settings,
    place: &Place,
    observer: &dyn Observer,
) -> std::result::Result<Filled, Failure> {
    let (mut scene, mut warnings) = (scene.clone(), Vec::new());
    let isovalues = settle(&mut scene, asked, &mut warnings)?;
    let bake = settings.bake(&scene, isovalues.as_deref())?;
    let requests = bake.requests()?;
    requests.iter().try_for_each(|request| request.volume.check_cells())?;
    requests.iter().try_for_each(Request::check)?;
    let mut in_use = None;
    let (path, cache) = match place {
        Place::Store(path) => (path.clone(), None),
        Place::Cache(folder) => {
            let cache = ready(folder.as_deref())?;
            let path = cache.place(&requests[0]);
            in_use = Some(cache.use_of(&path)?);
            (path, Some(cache))
        }
    };
    let mut reports = Vec::new();
    for (i, request) in requests.iter().enumerate() {
        // The first decides the name of the store in the cache, which proves whose it is; the others only join it.
        let writing = if i == 0 && cache.is_some() { Writing::of_cache() } else { Writing::default() };
        let (_, report) = run(&Request { writing, ..request.clone() }, &path, observer)?;
        warnings.extend(report.cut_paths().into_iter().chain(report.missed_goal()));
        reports.push(report);
    }
    if let Some(cache) = &cache {
        cache.tidy(&|_| {});
    }
    drop(requests);
    drop(bake);
    Ok(Filled { path, scene: Arc::new(scene), in_use, reports, warnings })
}

/// Threads of the user's, or one per core.
pub(super) fn pool_of(settings: &Settings) -> Result<Arc<rayon::ThreadPool>> {
    watch::pool(settings.threads)
}
