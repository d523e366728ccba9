//! Filling a store: what to bake, what is there already, the bake itself.

use super::console::{Console, interrupts};
use super::{Failure, Outcome, options, text};
use crate::error::Result;
use crate::level::Pyramid;
use crate::relight::texels_of_isosurface;
use crate::scene;
use crate::transfer::store::{ChunkExtent, Identity, Isovalues, Store};
use crate::transfer::{Brick, Layout, Selection};
use crate::transport::{Bake, Progress, Settings, Summary, Target, bake, pilot};
use crate::volume::Volume;
use serde_json::{Value, json};
use std::path::Path;
use std::time::{Duration, Instant};

/// Name of the estimator in stores.
const ESTIMATOR: &str = "path";
/// Chunks between two looks at whether the user wants to stop. The library bakes this many together.
const GROUP: usize = 8;
/// Texels and rays of the trial that the plan rests on.
const PILOT_TEXELS: u64 = 2000;
const PILOT_RAYS: u32 = 16;
/// Accepted error of what the plan drops, relative to the brightest light.
const TOLERANCE: f64 = 0.01;

/// A bake as asked for.
pub(super) struct Job<'a> {
    pub(super) volume: &'a Volume,
    /// Name of the input without directories, for the record.
    pub(super) label: &'a str,
    pub(super) layout: Layout,
    pub(super) settings: Settings,
    /// In the file's values; `None` for all.
    pub(super) isovalues: Option<Vec<f64>>,
    pub(super) memory_limit: Option<u64>,
}

/// What a bake did and how long it took.
#[derive(Default)]
pub(super) struct Report {
    pub(super) summary: Summary,
    pub(super) chunks_baked: usize,
    pub(super) chunks_kept: usize,
    /// Rays per texel that were used; more than asked where the store has better texels already.
    pub(super) rays: u32,
    /// Whether texels stopped at a standard error.
    pub(super) has_target: bool,
    pub(super) prepare: Duration,
    pub(super) trace: Duration,
    pub(super) write: Duration,
}

impl Job<'_> {
    /// What decides the store's numbers.
    pub(super) fn identity(&self) -> Identity {
        Identity::new(self.volume, &self.layout, ESTIMATOR, self.settings.positive, self.settings.seed)
    }

    /// The texels that a list of isovalues (or all) needs.
    pub(super) fn selection(&self, isovalues: &Isovalues) -> Selection {
        let lattice = self.layout.lattice;
        match isovalues {
            Isovalues::All => Selection::of_all_isosurfaces(lattice, self.volume),
            Isovalues::List(list) => {
                let mut selection = Selection::empty(lattice);
                for &c in list {
                    selection.insert_all(&texels_of_isosurface(self.volume, lattice, c));
                }
                selection
            }
        }
    }

    /// The isovalues asked for, in the store's words.
    pub(super) fn asked(&self) -> Isovalues {
        self.isovalues.clone().map_or(Isovalues::All, Isovalues::List)
    }

    /// Refuses what does not fit into the memory allowed.
    pub(super) fn check_memory(&self) -> Result<()> {
        let needed = options::bake_bytes(self.volume, &self.layout);
        options::check_memory(&format!("the bake of {}", self.label), needed, self.memory_limit)
    }

    /// The plan of effects, from a trial of a few texels.
    pub(super) fn plan(&self, pyramid: &Pyramid, selection: &Selection, albedo: Option<f32>) -> Result<scene::Plan> {
        let settings = Settings { rays: PILOT_RAYS, target: None, ..self.settings.clone() };
        let (volume, layout) = (self.volume, &self.layout);
        let trial = pilot(&Bake { volume, pyramid, layout, settings: &settings, selection }, PILOT_TEXELS)?;
        let pilot = scene::Pilot {
            texels: trial.texels,
            valid: trial.valid,
            paths: trial.paths,
            rays: trial.counts.rays,
            escapes: trial.mean_escapes(),
            lost_share: trial.lost_share(),
        };
        Ok(scene::plan(&scene::PlanInput {
            texels: layout.lattice.texels().iter().map(|&m| m as u64).product(),
            selected: selection.len(),
            isovalues: self.isovalues.as_deref(),
            rays: self.settings.rays,
            bands: layout.layers.bands(),
            albedo,
            emits: false,
            tolerance: TOLERANCE,
            bytes_per_texel: options::texel_bytes(&layout.layers),
            pilot: &pilot,
        }))
    }

    /// How the store was made: nothing in it depends on the machine, the threads or the clock.
    fn provenance(&self, plan: &scene::Plan) -> Value {
        let isovalues = self.isovalues.as_ref().map_or(json!("all"), |list| json!(list));
        json!({
            "program": concat!("isolume ", env!("CARGO_PKG_VERSION")),
            "input": self.label,
            "options": {
                "rays": self.settings.rays,
                "error": self.settings.target.as_ref().map(|t| t.error),
                "layers": self.layout.layers.len(),
                "bands": self.layout.layers.bands(),
                "texture": self.layout.lattice.texels(),
                "positive": self.settings.positive,
                "isovalues": isovalues,
                "seed": self.settings.seed,
            },
            "plan": plan.effects,
        })
    }
}

/// Whether a chunk as it is has what is asked.
fn covers(extent: &ChunkExtent, asked: &ChunkExtent) -> bool {
    let values = match (&extent.isovalues, &asked.isovalues) {
        (Isovalues::All, _) => true,
        (Isovalues::List(_), Isovalues::All) => false,
        (Isovalues::List(have), Isovalues::List(want)) => want.iter().all(|c| have.contains(c)),
    };
    let error = match (extent.error_target, asked.error_target) {
        (None, _) => true,
        (Some(_), None) => false,
        (Some(have), Some(want)) => have <= want,
    };
    values && error && extent.rays >= asked.rays
}

/// An extent that covers both.
fn joined(a: ChunkExtent, b: &ChunkExtent) -> ChunkExtent {
    let error_target = a.error_target.zip(b.error_target).map(|(a, b)| a.min(b));
    ChunkExtent { isovalues: union(a.isovalues, &b.isovalues), rays: a.rays.max(b.rays), error_target }
}

/// Both sets of isovalues together, ascending.
fn union(a: Isovalues, b: &Isovalues) -> Isovalues {
    match (a, b) {
        (Isovalues::List(mut list), Isovalues::List(more)) => {
            list.extend(more);
            list.sort_by(f64::total_cmp);
            list.dedup();
            Isovalues::List(list)
        }
        _ => Isovalues::All,
    }
}

/// What remains to be baked.
struct Todo {
    selection: Selection,
    extent: ChunkExtent,
    chunks: Vec<[usize; 3]>,
    kept: usize,
}

/// Chunks that are not what is asked. When such a chunk holds other isovalues or better texels, the bake takes
/// these over, so that a chunk never gets worse and its record stays true of all its texels.
fn todo(job: &Job<'_>, store: &Store) -> Result<Todo> {
    let error_target = job.settings.target.as_ref().map(|t| f64::from(t.error));
    let mut extent = ChunkExtent { isovalues: job.asked(), rays: job.settings.rays, error_target };
    loop {
        let selection = job.selection(&extent.isovalues);
        let mut next = extent.clone();
        let mut chunks = Vec::new();
        let mut kept = 0;
        for chunk in chunks_of(&selection) {
            match store.chunk_extent(chunk)? {
                Some(have) if covers(&have, &extent) => kept += 1,
                Some(have) => {
                    next = joined(next, &have);
                    chunks.push(chunk);
                }
                None => chunks.push(chunk),
            }
        }
        if next == extent {
            return Ok(Todo { selection, extent, chunks, kept });
        }
        extent = next;
    }
}

fn chunks_of(selection: &Selection) -> Vec<[usize; 3]> {
    let [cx, cy, cz] = selection.lattice().chunks();
    let all = (0..cx * cy * cz).map(|i| [i % cx, i / cx % cy, i / cx / cy]);
    all.filter(|&c| selection.touches_chunk(c)).collect()
}

/// Bakes what is missing into the store at `path`, which is made if there is none.
pub(super) fn fill(job: &Job<'_>, path: &Path, console: &Console) -> Outcome<(Store, Report)> {
    job.check_memory()?;
    let start = Instant::now();
    let pyramid = Pyramid::new(job.volume);
    let mut store = if path.symlink_metadata().is_ok() {
        Store::open_or_create(path, job.volume, &job.identity(), Value::Null)?
    } else {
        let plan = job.plan(&pyramid, &job.selection(&job.asked()), None)?;
        Store::open_or_create(path, job.volume, &job.identity(), job.provenance(&plan))?
    };
    let mut report = Report::default();
    {
        let _lock = store.lock()?;
        let todo = todo(job, &store)?;
        if todo.extent.rays > job.settings.rays {
            console.note(format!("the store holds texels with {} rays; the new ones get as many", todo.extent.rays));
        }
        if todo.kept > 0 {
            console.note(format!("{} of {} chunks are there already", todo.kept, todo.kept + todo.chunks.len()));
        }
        report.prepare = start.elapsed();
        (report.chunks_kept, report.rays) = (todo.kept, todo.extent.rays);
        report.has_target = todo.extent.error_target.is_some();
        let _guard = console.guard();
        run(job, &pyramid, &store, &todo, console, &mut report)?;
    }
    store.refresh();
    Ok((store, report))
}

fn run(
    job: &Job<'_>,
    pyramid: &Pyramid,
    store: &Store,
    todo: &Todo,
    console: &Console,
    report: &mut Report,
) -> Outcome {
    let error = todo.extent.error_target.map(|error| error as f32);
    let target = error.map(|error| Target::escape(&job.settings.layers, error));
    let settings = Settings { rays: todo.extent.rays, target, ..job.settings.clone() };
    let request =
        Bake { volume: job.volume, pyramid, layout: &job.layout, settings: &settings, selection: &todo.selection };
    let present = |chunk: [usize; 3]| Ok(store.read_chunk(chunk)?.map(|(bricks, _)| bricks));
    let progress = Progress::default();
    let start = Instant::now();
    let mut write = Duration::ZERO;
    let mut sink = |chunk: [usize; 3], bricks: Vec<Option<Brick>>| {
        let before = Instant::now();
        store.write_chunk(chunk, bricks, &todo.extent)?;
        write += before.elapsed();
        report.chunks_baked += 1;
        Ok(())
    };
    let texels = if todo.kept == 0 { todo.selection.len() } else { texels_in(&todo.selection, &todo.chunks) };
    let summary = console.watch("bake", texels, &progress, || -> Result<Summary> {
        let mut summary = Summary::default();
        for group in todo.chunks.chunks(GROUP) {
            if interrupts() > 0 {
                break;
            }
            summary.add(&bake(&request, group, &progress, &present, &mut sink)?);
        }
        Ok(summary)
    })?;
    report.summary.add(&summary);
    report.write = write;
    report.trace = start.elapsed().saturating_sub(write);
    if report.chunks_baked < todo.chunks.len() {
        let (done, all) = (report.chunks_baked + todo.kept, todo.chunks.len() + todo.kept);
        return Err(Failure::Message(format!("stopped after {done} of {all} chunks; resume with the same command")));
    }
    Ok(())
}

fn texels_in(selection: &Selection, chunks: &[[usize; 3]]) -> u64 {
    const SIDE: usize = crate::transfer::CHUNK;
    let texels = |chunk: &[usize; 3]| {
        let span = |a: usize| chunk[a] * SIDE..(chunk[a] + 1) * SIDE;
        let inside = |z, y| span(0).filter(|&x| selection.contains([x, y, z])).count() as u64;
        span(2).flat_map(|z| span(1).map(move |y| (z, y))).map(|(z, y)| inside(z, y)).sum::<u64>()
    };
    chunks.iter().map(texels).sum()
}

impl Report {
    /// The report as lines for people.
    pub(super) fn lines(&self, store_bytes: u64) -> String {
        let s = &self.summary;
        if self.chunks_baked == 0 {
            return format!("nothing to bake: all {} chunks are there", self.chunks_kept);
        }
        let escapes: Vec<String> = s.mean_escapes().iter().map(|a| format!("{a:.4}")).collect();
        let valid = s.valid as f64 / s.texels.max(1) as f64;
        let clamped = s.clamped as f64 / s.valid.max(1) as f64;
        let rows = [
            (
                "texels",
                format!(
                    "{} asked, {} valid ({}), {} clamped ({})",
                    text::count(s.texels),
                    text::count(s.valid),
                    text::percent(valid),
                    text::count(s.clamped),
                    text::percent(clamped)
                ),
            ),
            (
                "rays",
                format!(
                    "{} in {}, {}; {} paths a texel",
                    text::metric(s.counts.rays as f64).trim_end(),
                    text::duration(self.trace),
                    text::rate(s.counts.rays as f64, self.trace),
                    text::number(s.paths as f64 / s.valid.max(1) as f64, 4)
                ),
            ),
            (
                "paths",
                format!(
                    "{}: {} lost in the solid, {} still travelling after the last layer",
                    text::metric(s.paths as f64).trim_end(),
                    text::percent(s.lost_share()),
                    text::percent(s.trapped as f64 / s.paths.max(1) as f64)
                ),
            ),
            ("mean a_k", format!("{}  (chance to escape after exactly k bounces)", escapes.join("  "))),
            (
                "error",
                format!(
                    "standard error of {}: median ≤ {:.4}, 95 % of texels ≤ {:.4}; RMS of Σ a_k {:.4}",
                    if self.has_target { "Σ a_k and a_0" } else { "Σ a_k" },
                    s.errors.quantile(0.5),
                    s.errors.quantile(0.95),
                    s.escape_stderr_rms()
                ),
            ),
            (
                "time",
                format!(
                    "prepare {}, trace {}, write {}",
                    text::duration(self.prepare),
                    text::duration(self.trace),
                    text::duration(self.write)
                ),
            ),
            (
                "store",
                format!(
                    "{} chunks written, {} kept, {}",
                    self.chunks_baked,
                    self.chunks_kept,
                    text::bytes(store_bytes as f64)
                ),
            ),
        ];
        text::table(&rows.map(|(name, value)| vec![name.to_string(), value]))
    }

    /// The report for machines.
    pub(super) fn json(&self, store_bytes: u64) -> Value {
        let s = &self.summary;
        json!({
            "texels": { "asked": s.texels, "valid": s.valid, "clamped": s.clamped, "degenerate": s.degenerate },
            "rays": s.counts.rays,
            "rays_per_texel": self.rays,
            "counts": { "nodes": s.counts.nodes, "cells": s.counts.cells, "solves": s.counts.solves },
            "paths": s.paths,
            "pilot_paths": s.pilot_paths,
            "lost_share": s.lost_share(),
            "trapped_share": s.trapped as f64 / s.paths.max(1) as f64,
            "mean_escapes": s.mean_escapes(),
            "escape_stderr": {
                "p50": s.errors.quantile(0.5),
                "p95": s.errors.quantile(0.95),
                "rms": s.escape_stderr_rms(),
            },
            "seconds": {
                "prepare": self.prepare.as_secs_f64(),
                "trace": self.trace.as_secs_f64(),
                "write": self.write.as_secs_f64(),
            },
            "mrays_per_second": s.counts.rays as f64 / self.trace.as_secs_f64().max(1e-9) / 1e6,
            "chunks": { "baked": self.chunks_baked, "kept": self.chunks_kept },
            "store_bytes": store_bytes,
        })
    }
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
