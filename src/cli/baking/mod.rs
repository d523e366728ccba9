//! Filling a store: what to bake, what is there already, the bake itself.

mod goal;
mod repair;
mod report;
mod scene;
mod todo;

pub(super) use goal::{ForLight, Goal, parse_time, spread};
pub(super) use scene::layout as layout_of_scene;

use super::console::{Console, interrupts};
use super::input::Input;
use super::scene::SceneFile;
use super::{Failure, Outcome, options};
use crate::error::{Error, Result};
use crate::level::Pyramid;
use crate::scene as scenes;
use crate::scene::Effects;
use crate::scene::geometry::Geometry;
use crate::transfer::store::{ChunkExtent, Identity, Store, StoreLock, StoreOptions};
use crate::transfer::texels_of_isosurface;
use crate::transfer::{Brick, Lattice, Layout, Selection};
use crate::transport::{
    Bake, Bias, GatherSettings, PhotonBake, PhotonMap, Progress, SceneSummary, Settings, Summary, Target, bake, gather,
    photon_bake_from, photon_bake_map, pilot,
};
use crate::volume::{Shadowing, Volume};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::Path;
use std::time::{Duration, Instant};
use todo::{Part, Todo, texels_in};

/// Texels and rays of the trial that the plan rests on.
const PILOT_TEXELS: u64 = 2000;
const PILOT_RAYS: u32 = 16;
/// Accepted error of what the plan drops, relative to the brightest light.
const TOLERANCE: f64 = 0.01;

/// How a store is written and what of it is verified.
#[derive(Clone, Copy, Debug)]
pub(super) struct Writing {
    /// Whether writes wait for the disk.
    pub(super) sync: bool,
    /// Whether damaged metadata is written anew without proof of whose store it is.
    pub(super) repair: bool,
    /// Whether every chunk is verified, not only those that are asked for.
    pub(super) verify_all: bool,
}

impl Writing {
    /// Of stores in the cache folder: they can be made again, their name says whose they are, and a command looks only at
    /// what it needs of them.
    pub(super) fn of_cache() -> Self {
        Self { sync: false, repair: true, verify_all: false }
    }
}

impl Default for Writing {
    fn default() -> Self {
        Self { sync: true, repair: false, verify_all: true }
    }
}

/// A bake as asked for.
#[derive(Clone)]
pub(super) struct Job<'a> {
    pub(super) volume: &'a Volume,
    /// Name of the input without directories, for the record.
    pub(super) label: &'a str,
    pub(super) layout: Layout,
    /// Without a target: that follows from the goal.
    pub(super) settings: Settings,
    pub(super) goal: Goal,
    pub(super) estimator: Estimator,
    /// In the file's values; `None` for all.
    pub(super) isovalues: Option<Vec<f64>>,
    pub(super) share: Option<Share>,
    pub(super) memory_limit: Option<u64>,
    /// When the command began.
    pub(super) start: Instant,
    pub(super) effects: &'a Effects,
    pub(super) hints: Hints,
    pub(super) writing: Writing,
    /// Only these chunks, by linear index; all where there is no list.
    pub(super) only: Option<BTreeSet<usize>>,
    /// What stands around the volume; then the layout is coloured.
    pub(super) geometry: Option<&'a Geometry>,
}

/// What is known before relighting of what it will ask for; it decides nothing but the plan.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Hints {
    /// Largest albedo of any channel and isovalue.
    pub(super) albedo: Option<f32>,
    /// Largest emission of any channel and isovalue.
    pub(super) emission: Option<f32>,
    /// Whether the dominant lamp is lit apart.
    pub(super) sun_split: Option<bool>,
    /// Whether the plan is to be shown.
    pub(super) shown: bool,
}

impl Hints {
    /// What a scene says, of some isovalues or of all.
    pub(super) fn of_scene(scene: Option<&SceneFile>, range: (f64, f64), isovalues: Option<&[f64]>) -> Self {
        let Some(file) = scene else { return Self::default() };
        let scene = &file.scene;
        Self {
            albedo: scene.albedo.as_ref().map(|albedo| albedo.rule(range).largest_albedo(isovalues)),
            emission: Some(scene.emission.as_ref().map_or(0.0, |emission| emission.largest(isovalues))),
            sun_split: scene.probe.as_ref().map(|probe| probe.sun_split == Some(true)),
            shown: false,
        }
    }
}

/// An estimator of the transfer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Estimator {
    /// Path tracing within each level set: unbiased
    #[default]
    Path,
    /// The texture as radiance cache: less noise in less time where light bounces often, with a bias that is printed
    Gather,
    /// Flattened photon mapping, for study: light spread over the nearest photons, with a bias that no error bar holds
    Photon,
}

/// One of several parts into which the chunks of a store are dealt out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Share {
    /// From 1.
    pub(super) index: usize,
    pub(super) of: usize,
}

impl Share {
    /// Whether it holds the chunk with a linear index.
    fn holds(self, chunk: usize) -> bool {
        chunk % self.of == self.index - 1
    }

    pub(super) fn parse(text: &str) -> std::result::Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match numbers {
            Some((index, of)) if 1 <= index && index <= of && of <= 4096 => Ok(Self { index, of }),
            _ => Err("give i/n with i from 1 to n, such as 1/3, and n at most 4096".into()),
        }
    }
}

/// What a bake did and how long it took.
#[derive(Default)]
pub(super) struct Report {
    pub(super) summary: Summary,
    pub(super) chunks_baked: usize,
    pub(super) chunks_kept: usize,
    /// Chunks that were damaged and baked again.
    pub(super) damaged: usize,
    /// Files of metadata and samples that were written anew.
    pub(super) mended: usize,
    /// Rays per texel that were asked for; the most of any texel where they stop at an error.
    pub(super) rays: u32,
    /// What the standard errors of the summary are of.
    pub(super) error_of: String,
    /// The standard error that texels had to reach.
    pub(super) error: Option<f64>,
    pub(super) goal: Value,
    /// Largest albedo that is known before relighting.
    pub(super) albedo: Option<f32>,
    /// The plan, where it was asked for.
    pub(super) plan: Option<scenes::Plan>,
    /// Of the estimator `gather`.
    pub(super) bias: Option<Bias>,
    /// Of the estimator `photon`.
    pub(super) photons: Option<report::Photons>,
    /// Of a scene with walls or luminaires.
    pub(super) scene: Option<SceneSummary>,
    pub(super) prepare: Duration,
    pub(super) trace: Duration,
    pub(super) write: Duration,
}

/// The texels that some isosurfaces need; without a list those of all.
pub(super) fn selection(volume: &Volume, lattice: Lattice, isovalues: Option<&[f64]>) -> Selection {
    let Some(list) = isovalues else { return Selection::of_all_isosurfaces(lattice, volume) };
    let mut selection = Selection::empty(lattice);
    for &c in list {
        selection.insert_all(&texels_of_isosurface(volume, lattice, c));
    }
    selection
}

impl<'a> Job<'a> {
    /// A bake by `path` of all isosurfaces, without a goal.
    pub(super) fn new(
        volume: &'a Volume,
        label: &'a str,
        layout: Layout,
        settings: Settings,
        effects: &'a Effects,
    ) -> Self {
        Self {
            volume,
            label,
            layout,
            settings,
            goal: Goal::default(),
            estimator: Estimator::Path,
            isovalues: None,
            share: None,
            memory_limit: None,
            start: Instant::now(),
            effects,
            hints: Hints::default(),
            writing: Writing::default(),
            only: None,
            geometry: None,
        }
    }

    /// What the options of `bake` and `plan` ask for.
    pub(super) fn of_options(
        opened: &'a Input,
        scene: Option<&SceneFile>,
        options: &options::BakeArgs,
        isovalues: Option<Vec<f64>>,
        layout: Layout,
        settings: Settings,
        effects: &'a Effects,
    ) -> Self {
        let volume = &opened.volume;
        Self {
            goal: Goal { error: options.transfer.error, ..Goal::default() },
            estimator: options.estimator,
            hints: Hints::of_scene(scene, volume.value_range(), isovalues.as_deref()),
            isovalues,
            memory_limit: options.transfer.memory_limit,
            geometry: opened.geometry.as_ref(),
            ..Self::new(volume, &opened.label, layout, settings, effects)
        }
    }
}

impl Job<'_> {
    /// What decides the store's numbers.
    pub(super) fn identity(&self) -> Identity {
        let (positive, seed) = (self.settings.positive, self.settings.seed);
        let identity = Identity::new(self.volume, &self.layout, self.estimator_name(), positive, seed);
        Identity { scene: self.geometry.map(|geometry| self.scene_identity(geometry)), ..identity }
    }

    /// The estimator as it stands in stores. The texels of `gather` depend on their neighbours, so which isosurfaces
    /// are baked together is part of its name.
    fn estimator_name(&self) -> String {
        if self.geometry.is_some() {
            let off = self.effects.switched("caustics") == Some(false);
            let alone = self.geometry.is_some_and(|g| g.parts() == 0 && g.luminaires().is_empty());
            let what = if alone { "path among volumes" } else { "path among walls" };
            return format!("{what}{}", if off { "; caustics left out" } else { "" });
        }
        let shadows = match self.volume.shadowing {
            Shadowing::Ignored => "; shadowing ignored",
            Shadowing::Traced => "; every texel traced",
            Shadowing::Found if self.volume.is_convex() => "; solids declared convex",
            Shadowing::Found => "",
        };
        match self.estimator {
            Estimator::Path => format!("path{shadows}"),
            Estimator::Photon => {
                format!("photon: {} sent out, {} to a texel{shadows}", self.photons().photons, self.settings.rays)
            }
            Estimator::Gather => {
                let how = self.gather_settings();
                let list = |l: &Vec<f64>| l.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
                let isovalues = self.isovalues.as_ref().map_or("all".into(), list);
                let rays = self.settings.rays;
                format!(
                    "gather: {} passes of {}, then {rays} rays; isovalues {isovalues}{shadows}",
                    how.passes - 1,
                    how.cache_rays
                )
            }
        }
    }

    /// A photon for every 16th ray that `path` would trace: they take memory, and many serve several texels.
    fn photons(&self) -> PhotonBake {
        let texels: u64 = self.layout.lattice.texels().iter().map(|&m| m as u64).product();
        let memory_limit = self.memory_limit.unwrap_or_else(options::default_memory_limit);
        PhotonBake { memory_limit, ..PhotonBake::for_texels(texels, self.settings.rays) }
    }

    fn gather_settings(&self) -> GatherSettings {
        let memory_limit = self.memory_limit.unwrap_or_else(options::default_memory_limit);
        GatherSettings { memory_limit, ..GatherSettings::default() }
    }

    /// The texels that the isovalues asked for need.
    pub(super) fn selection(&self) -> Selection {
        self.selection_on(self.layout.lattice)
    }

    /// The texels that a texture of another lattice would need.
    pub(super) fn selection_on(&self, lattice: Lattice) -> Selection {
        selection(self.volume, lattice, self.isovalues.as_deref())
    }

    /// Texels that a bake into the store at `path` would have to trace; all that are needed if there is none.
    pub(super) fn texels_missing(&self, path: &Path) -> Result<u64> {
        if path.symlink_metadata().is_err() {
            return Ok(self.selection().len());
        }
        let target = self.goal.error.map(goal::escape);
        let store = match Store::open(path) {
            Ok(store) => store,
            // The bake mends it first.
            Err(Error::Format { .. }) if path.is_dir() => return Ok(self.selection().len()),
            Err(other) => return Err(other),
        };
        let among = self.geometry.and_then(Geometry::among);
        if among.is_some() && !store.volumes()?.contains(&self.volume.name) {
            return Ok(self.selection().len());
        }
        let store = if among.is_some() { store.of_volume(&self.volume.name)? } else { store };
        let mut todo = Todo::new(self, &store, self.claims(&target))?;
        let mut texels = 0;
        for i in 0..todo.len() {
            let part = todo.part(i);
            texels += texels_in(&part.selection, &part.chunks);
        }
        Ok(texels)
    }

    /// Refuses what does not fit into the memory allowed.
    pub(super) fn check_memory(&self) -> Result<()> {
        let needed = options::bake_bytes(self.volume, &self.layout, self.isovalues.as_ref().map_or(1, Vec::len));
        let groups = self.geometry.map_or(0, |geometry| scene::bytes_of_groups(&self.layout.layers, geometry));
        // Partners with their pyramids, as the volume itself.
        let partners = self.geometry.map_or(&[][..], Geometry::partners).iter();
        let partners: u64 = partners.map(|p| p.volume.samples().bytes().len() as u64 / 4 * 5).sum();
        // 16 chunks of 32³ texels are held.
        let needed = needed + partners + groups * (16 << 15);
        options::check_memory(&format!("the bake of {}", self.label), needed, self.memory_limit)?;
        if let Some(geometry) = self.geometry {
            self.check_scene(geometry)?;
        }
        if self.estimator != Estimator::Path && (self.goal.error.is_some() || self.goal.time.is_some()) {
            let remedy = "leave out --error and --time, or use the estimator path";
            let name = if self.estimator == Estimator::Gather { "gather" } else { "photon" };
            return Err(Error::argument(
                format!("--estimator {name}"),
                "a target as well",
                "a number of --rays",
                remedy,
            ));
        }
        Ok(())
    }

    /// The plan of effects, from a trial of a few texels.
    pub(super) fn plan(&self, pyramid: &Pyramid) -> Result<scenes::Plan> {
        self.plan_of(pyramid, &self.selection(), self.isovalues.as_deref(), self.settings.rays, self.hints)
    }

    fn plan_of(
        &self,
        pyramid: &Pyramid,
        selection: &Selection,
        isovalues: Option<&[f64]>,
        rays: u32,
        hints: Hints,
    ) -> Result<scenes::Plan> {
        let (volume, layout) = (self.volume, &self.layout);
        let (pilot, surroundings) = match self.geometry {
            Some(geometry) => {
                let (pilot, surrounded) = self.plan_of_scene(geometry, pyramid, selection)?;
                (pilot, Some(surrounded))
            }
            None => (self.pilot_of_volume(pyramid, selection)?, None),
        };
        let groups = self.geometry.map_or(0, |geometry| scene::bytes_of_groups(&layout.layers, geometry));
        Ok(scenes::plan(&scenes::PlanInput {
            texels: layout.lattice.texels().iter().map(|&m| m as u64).product(),
            selected: selection.len(),
            isovalues,
            rays,
            bands: layout.layers.bands(),
            albedo: hints.albedo,
            emission: hints.emission,
            convex: volume.is_convex() && self.geometry.is_none(),
            effects: self.effects,
            sun_split: hints.sun_split,
            tolerance: TOLERANCE,
            bytes_per_texel: options::texel_bytes(&layout.layers) + groups,
            pilot: &pilot,
            surroundings: surroundings.as_ref(),
        }))
    }

    fn pilot_of_volume(&self, pyramid: &Pyramid, selection: &Selection) -> Result<scenes::Pilot> {
        let settings = Settings { rays: PILOT_RAYS, target: None, ..self.settings.clone() };
        let (volume, layout) = (self.volume, &self.layout);
        let trial = pilot(&Bake { volume, pyramid, layout, settings: &settings, selection }, PILOT_TEXELS)?;
        Ok(scenes::Pilot {
            texels: trial.texels,
            valid: trial.valid,
            paths: trial.paths,
            rays: trial.counts.rays,
            escapes: trial.mean_escapes(),
            lost_share: trial.lost_share(),
            open: trial.open,
        })
    }

    /// How the store was made. Nothing in it depends on the machine, the threads or the clock, nor on what may grow
    /// later: isovalues, rays and errors stand with the chunks. So the plan is that of all isosurfaces at 64 rays.
    fn provenance(&self, pyramid: &Pyramid) -> Result<Value> {
        let selection = Selection::of_all_isosurfaces(self.layout.lattice, self.volume);
        let plan = self.plan_of(pyramid, &selection, None, 64, Hints::default())?;
        Ok(json!({
            "program": concat!("isolume ", env!("CARGO_PKG_VERSION")),
            "input": self.label,
            "plan": plan.effects,
        }))
    }
}

/// Bakes what is missing or damaged into the store at `path`, which is made if there is none.
pub(super) fn fill(job: &Job<'_>, path: &Path, console: &Console) -> Outcome<(Store, Report)> {
    job.check_memory()?;
    let pyramid = Pyramid::new(job.volume);
    let is_joint = job.geometry.is_some_and(|geometry| geometry.among().is_some());
    let provenance = match StoreOptions::knows(path, job.volume) {
        true => Value::Null,
        false => job.provenance(&pyramid)?,
    };
    let mut report = Report { albedo: job.hints.albedo, ..Report::default() };
    if job.hints.shown {
        let plan = job.plan(&pyramid)?;
        console.print(super::plan::table(&plan));
        report.plan = Some(plan);
    }
    let share = job.share.map(|share| (share.index, share.of));
    // Before the first look at what is there: nobody else mends or replaces it meanwhile.
    let early = if path.is_dir() { Some(StoreLock::take(path, share)?) } else { None };
    let options = StoreOptions::default().sync(job.writing.sync).repair(job.writing.repair);
    let mut store = match is_joint {
        true => options.open_or_add(path, job.volume, &job.identity(), provenance)?,
        false => options.open_or_create(path, job.volume, &job.identity(), provenance)?,
    };
    {
        let _lock = match early {
            Some(lock) => lock,
            None => StoreLock::take(path, share)?,
        };
        store.mended().iter().for_each(|what| console.note(what));
        report.mended = store.mended().len();
        let damaged = repair::set_damage_aside(job, &store, console)?;
        let quality = job.quality(&pyramid, &store, || job.selection(), job.start, console)?;
        let claims = job.claims(&quality.name);
        let asked = store.asked()?;
        store.ask(&claims.iter().fold(asked.clone(), |mut all, claim| {
            all.add(claim.clone());
            all
        }))?;
        let mut todo = Todo::new(job, &store, claims)?;
        if let Some(share) = job.share {
            let chunks = todo.kept + todo.missing;
            console.note(format!("share {} of {}: {chunks} chunks", share.index, share.of));
        }
        if todo.kept > 0 {
            console.note(format!("{} of {} chunks are there already", todo.kept, todo.kept + todo.missing));
        }
        report.prepare = job.start.elapsed();
        (report.chunks_kept, report.rays) = (todo.kept, job.settings.rays);
        report.error_of = goal::of_text(quality.name.as_ref());
        report.error = quality.name.as_ref().map(|t| t.error);
        report.goal = goal::goal_json(&job.goal);
        report.damaged = damaged.len();
        let _guard = console.guard();
        run(job, &pyramid, &store, &mut todo, quality.target, console, &mut report)?;
        repair::complete(job, &pyramid, &store, &asked, &damaged, quality.name.as_ref(), console, &mut report)?;
        report.warning().iter().for_each(|warning| console.note(warning));
    }
    store.refresh();
    Ok((store, report))
}

fn run(
    job: &Job<'_>,
    pyramid: &Pyramid,
    store: &Store,
    todo: &mut Todo<'_>,
    target: Option<Target>,
    console: &Console,
    report: &mut Report,
) -> Outcome {
    let settings = Settings { target, ..job.settings.clone() };
    let start = Instant::now();
    let map = if todo.len() > 0 { photon_map(job, pyramid, &settings, console, report)? } else { None };
    for i in 0..todo.len() {
        if job.estimator == Estimator::Photon && map.is_none() {
            break;
        }
        let mut part = todo.part(i);
        let texels = texels_in(&part.selection, &part.chunks);
        if job.estimator == Estimator::Gather {
            part.selection = todo.everything();
        }
        let progress = Progress::default();
        let map = map.as_ref();
        console.watch("bake", texels, &progress, || {
            bake_part(job, pyramid, store, &settings, &part, map, &progress, report)
        })?;
        if interrupts() > 0 {
            break;
        }
    }
    report.trace = start.elapsed().saturating_sub(report.write);
    if report.chunks_baked < todo.missing {
        let (done, all) = (report.chunks_baked + todo.kept, todo.missing + todo.kept);
        return Err(Failure::Message(format!("stopped after {done} of {all} chunks; resume with the same command")));
    }
    Ok(())
}

/// The map of the estimator `photon`, which all parts read; `None` for others, and when the user does not want to wait for it.
fn photon_map(
    job: &Job<'_>,
    pyramid: &Pyramid,
    settings: &Settings,
    console: &Console,
    report: &mut Report,
) -> Outcome<Option<PhotonMap>> {
    if job.estimator != Estimator::Photon || job.geometry.is_some() {
        return Ok(None);
    }
    let (asked, start, progress) = (job.photons(), Instant::now(), Progress::default());
    let selection = Selection::empty(job.layout.lattice);
    let request = Bake { volume: job.volume, pyramid, layout: &job.layout, settings, selection: &selection };
    let sent = u64::from(asked.photons);
    let made = console.watch_first("photons", sent, &progress, || photon_bake_map(&request, &asked, &progress))?;
    if let Some(map) = &made {
        report.summary.counts += map.counts();
        report.photons = Some(report::Photons::new(map, start.elapsed()));
    }
    Ok(made)
}

fn bake_part(
    job: &Job<'_>,
    pyramid: &Pyramid,
    store: &Store,
    settings: &Settings,
    part: &Part,
    map: Option<&PhotonMap>,
    progress: &Progress,
    report: &mut Report,
) -> Result<()> {
    if let Some(geometry) = job.geometry {
        return scene::bake_part(job, geometry, pyramid, store, settings, part, progress, report);
    }
    let request = Bake { volume: job.volume, pyramid, layout: &job.layout, settings, selection: &part.selection };
    let present = |chunk: [usize; 3]| Ok(store.read_chunk(chunk)?.map(|(bricks, _)| bricks));
    let (mut write, mut baked) = (Duration::ZERO, 0);
    let mut sink = |chunk: [usize; 3], bricks: Vec<Option<Brick>>| {
        let before = Instant::now();
        let mut extent: ChunkExtent = store.chunk_extent(chunk)?.unwrap_or_default();
        part.claims.iter().for_each(|claim| extent.add(claim.clone()));
        store.write_chunk(chunk, bricks, &extent)?;
        write += before.elapsed();
        baked += 1;
        Ok(())
    };
    let mut summary = Summary::default();
    match job.estimator {
        Estimator::Path | Estimator::Photon => {
            summary.add(&match map {
                Some(map) => photon_bake_from(&request, map, &part.chunks, progress, &present, &mut sink)?,
                None => bake(&request, &part.chunks, progress, &present, &mut sink)?,
            });
        }
        Estimator::Gather => {
            let gathered = gather(&request, &job.gather_settings(), &part.chunks, progress, &present, &mut sink)?;
            summary.add(&gathered.summary);
            report.bias = Some(gathered.bias);
        }
    }
    report.summary.add(&summary);
    report.write += write;
    report.chunks_baked += baked;
    Ok(())
}

/// Bytes of all files under a path.
pub(super) fn size_on_disk(path: &Path) -> u64 {
    let Ok(metadata) = path.symlink_metadata() else { return 0 };
    if !metadata.is_dir() {
        return metadata.len();
    }
    let entries = std::fs::read_dir(path).map(|e| e.flatten().collect::<Vec<_>>()).unwrap_or_default();
    entries.iter().map(|e| size_on_disk(&e.path())).sum()
}
