//! What one run does: the bake of what is missing, drafts first, and every surface under every light.

use super::file::Context;
use super::{Draft, LitSurface, Relight, Relit};
use crate::bake::{ForLight, Goal, Request, layout_of_scene};
use crate::cli::bake_report::Told;
use crate::cli::baking;
use crate::cli::cache::{Cache, Filled, InUse};
use crate::cli::console::Console;
use crate::cli::isovalue::{Chosen, tell};
use crate::cli::light::by_option;
use crate::cli::output::{Format, Target, make_folder, targets};
use crate::cli::picture::check_size;
use crate::cli::scene;
use crate::cli::{Outcome, options, text};
use crate::error::Error;
use crate::geom::Up;
use crate::level::Pyramid;
use crate::probe::Probe;
use crate::scene::geometry::Geometry;
use crate::scene::{Effects, EmissionRule, MaterialRule};
use crate::session::{Lighting, Part, Session, Surface};
use crate::sh::Coefficients;
use crate::transfer::store::Store;
use crate::transfer::{Lattice, Layers, Layout};
use crate::transport::Settings;
use crate::volume::Volume;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// A store to light from, and how it came about.
pub(super) struct Source {
    pub(super) store: Store,
    /// Rays traced to fill it.
    pub(super) transport_rays: u64,
}

/// What does not change from store to store.
pub(super) struct Work<'a> {
    command: &'a Relight,
    volume: &'a Volume,
    isovalues: Vec<f64>,
    probes: &'a [Probe],
    environments: Vec<String>,
    pyramid: Pyramid,
    rule: MaterialRule,
    emission: EmissionRule,
    effects: Effects,
    up: Up,
    start: Instant,
    /// What reading and preparing took.
    read_time: Duration,
    console: &'a Console,
    /// What stands around the volume, where it is known.
    pub(super) geometry: Option<&'a Geometry>,
}

impl<'a> Work<'a> {
    pub(super) fn new(
        command: &'a Relight,
        volume: &'a Volume,
        chosen: &[Chosen],
        probes: &'a [Probe],
        start: Instant,
        console: &'a Console,
    ) -> Outcome<Self> {
        volume.check_cells()?;
        let isovalues: Vec<f64> = chosen.iter().map(|c| c.value).collect();
        let environments: Vec<String> = probes.iter().map(|p| p.name.clone()).collect();
        if command.picture.turntable.is_some() {
            command.output.iter().try_for_each(|output| make_folder(output))?;
        }
        let files = all_targets(command, volume, &isovalues, &environments)?;
        command.mesh.check(&files.concat())?;
        if files.iter().flatten().any(|f| f.format == Format::Png) {
            check_size(command.picture.seen.size, command.transfer.memory_limit)?;
        }
        tell(console, chosen);
        let pyramid = Pyramid::new(volume);
        let rule = command.albedo_rule(volume.value_range())?;
        let (emission, effects) = (command.emission_rule(), command.transfer.effects());
        let up = command.volume.options().up_of(volume.up)?;
        let read_time = start.elapsed();
        Ok(Self {
            command,
            volume,
            isovalues,
            probes,
            environments,
            pyramid,
            rule,
            emission,
            effects,
            up,
            start,
            read_time,
            console,
            geometry: None,
        })
    }

    /// Lights every isosurface of the volume from a store by every environment and writes the files.
    pub(super) fn light(&self, source: &Source, drafts: Vec<Draft>) -> Outcome<Relit> {
        let session = Session::alone(&source.store, self.volume, &self.pyramid);
        let session = session.with_up(self.up).with_geometry(self.geometry);
        let isovalues: Vec<Vec<f64>> = self.isovalues.iter().map(|&c| vec![c]).collect();
        self.light_in(&session, &isovalues, source.transport_rays, drafts)
    }

    /// Lights isosurfaces, of which each has an isovalue for every volume of a session.
    pub(super) fn light_in(
        &self,
        session: &Session<'_>,
        isovalues: &[Vec<f64>],
        transport_rays: u64,
        drafts: Vec<Draft>,
    ) -> Outcome<Relit> {
        let context = Context { command: self.command, session, rule: &self.rule, emission: &self.emission };
        self.command.output.iter().try_for_each(|output| make_folder(output))?;
        let mut surfaces = Vec::new();
        let mut written = Vec::new();
        let mut files = all_targets(self.command, self.volume, &self.isovalues, &self.environments)?.into_iter();
        for isovalues in isovalues {
            let surface = self.surface(session, isovalues, &mut surfaces)?;
            for (probe, targets) in self.probes.iter().zip(files.by_ref()) {
                for target in targets {
                    written.push(context.light(&surface, probe, target)?);
                }
            }
        }
        Ok(Relit { surfaces, files: written, read_time: self.read_time, transport_rays, drafts })
    }

    /// Extracts the isosurface of every volume and finds its texels; what is told of it goes into `told`.
    fn surface<'s>(
        &self,
        session: &'s Session<'s>,
        isovalues: &[f64],
        told: &mut Vec<LitSurface>,
    ) -> Outcome<Surface<'s>> {
        let mut parts: Vec<Part> = Vec::new();
        for (member, &isovalue) in session.members().iter().zip(isovalues) {
            let start = Instant::now();
            let isosurface = member.extract(isovalue)?;
            let extract_time = start.elapsed();
            let start = Instant::now();
            let part = member.select(isosurface);
            told.push(LitSurface::new(&part, extract_time, start.elapsed()));
            parts.push(part);
        }
        let surface = session.surface_of(parts)?;
        let what = format!("relighting isovalue {}", text::number(isovalues[0], 8));
        options::check_memory(&what, surface.bytes_of_lighting(), self.command.transfer.memory_limit)?;
        Ok(surface)
    }

    /// Bakes what the isosurfaces need, coarsely first where the whole takes long, and lights them each time.
    pub(super) fn bake_and_light(&self, label: &str, seed: u64) -> Outcome<Relit> {
        let bands = self.command.scene.as_ref().map(scene::bands).unwrap_or_default();
        let (of_volume, isovalues) = ((self.volume, label, self.geometry), Some(self.isovalues.clone()));
        let transfer = &self.command.transfer;
        let layers = layout_of_scene(transfer.layout(self.volume, &bands)?, self.geometry).layers;
        let albedo = self.rule.largest_albedo(Some(&self.isovalues));
        let lights = lights(self.command, self.probes, (self.up, &layers, self.geometry.is_some()), albedo)?;
        let job = baking::request_of_cache(of_volume, transfer, &bands, isovalues, (seed, lights), &self.effects)?;
        baking::check(&job)?;
        let cache = Cache::locate(self.command.cache.as_deref())?;
        cache.prepare()?;
        let mut drafts = Vec::new();
        for draft in self.drafts(&job, &cache)? {
            let (source, _use) = self.bake(&draft, &cache, true)?;
            let (rays, texture) = (draft.settings.rays, draft.layout.lattice.texels());
            drop(self.light(&source, Vec::new())?);
            let written_after = self.start.elapsed();
            let what = match draft.surfaces {
                true => "vertex".into(),
                false => format!("texel, {} × {} × {} texels,", texture[0], texture[1], texture[2]),
            };
            let after = text::duration(written_after);
            self.console.note(format!("a draft of {rays} rays a {what} is written after {after}; going on"));
            drafts.push(Draft { rays, texture, written_after });
        }
        let (source, _use) = self.bake(&job, &cache, false)?;
        let done = self.light(&source, drafts)?;
        cache.tidy(self.console);
        Ok(done)
    }

    /// The drafts that come before a bake: one of few rays where the bake would take more than a moment, and before
    /// it one of a coarser texture where the isosurfaces need many texels.
    fn drafts<'j>(&self, job: &Request<'j>, cache: &Cache) -> Outcome<Vec<Request<'j>>> {
        let lattice = job.layout.lattice;
        let missing = job.texels_missing(&cache.place(job))?;
        let paths = missing * u64::from(job.settings.rays);
        if self.command.no_draft || job.settings.rays <= DRAFT_RAYS || paths < DRAFT_FROM_PATHS {
            return Ok(Vec::new());
        }
        let few_rays = |layout: Layout| Request {
            settings: Settings { rays: DRAFT_RAYS, ..job.settings.clone() },
            goal: Goal::default(),
            layout,
            ..job.clone()
        };
        let mut drafts = Vec::new();
        let all: u64 = lattice.texels().iter().map(|&m| m as u64).product();
        if !job.surfaces && missing as f64 > DRAFT_SHARE * all as f64 {
            let halved = std::array::from_fn(|a| lattice.texels()[a].div_ceil(2).max(lattice.grid()[a].min(2)));
            let lattice = Lattice::from_texels(lattice.grid(), halved)?;
            drafts.push(few_rays(Layout { lattice, layers: job.layout.layers.clone() }));
        }
        drafts.push(few_rays(job.layout.clone()));
        Ok(drafts)
    }

    fn bake(&self, job: &Request<'_>, cache: &Cache, is_draft: bool) -> Outcome<(Source, InUse)> {
        let path = cache.place(job);
        let Filled { store, report, in_use } = cache.fill(job, &path, self.start, self.console)?;
        if report.chunks_baked == 0 || !is_draft {
            cache.tell(&report, None, &path, self.console);
        }
        if report.chunks_baked > 0 && !is_draft {
            self.console.detail(report.lines(crate::file::size_on_disk(&path)));
        }
        Ok((Source { store, transport_rays: report.summary.counts.rays }, in_use))
    }
}

/// The lights of the command, as errors are measured by them.
pub(super) fn lights(
    command: &Relight,
    probes: &[Probe],
    (up, layers, in_scene): (Up, &Layers, bool),
    albedo: f32,
) -> Outcome<Vec<ForLight>> {
    let options = command.light_options(in_scene);
    let each = probes.iter().map(|probe| {
        let lighting = Lighting::new(probe, up, layers, &options).map_err(by_option)?;
        let of_layer = |k: usize| -> [Coefficients; 3] {
            let rgb = lighting.light().coefficients(k);
            let bands = lighting.light().bands(k);
            let mut channels = [(); 3].map(|()| Coefficients::zero(bands));
            for (c, channel) in channels.iter_mut().enumerate() {
                channel.values_mut().iter_mut().zip(rgb).for_each(|(to, from)| *to = from[c]);
            }
            channels
        };
        let turned = if options.rotation_degrees == 0.0 {
            String::new()
        } else {
            format!(" turned {}°", options.rotation_degrees)
        };
        let name_in_store = format!("{}{turned}", probe.name);
        Ok(ForLight { name: probe.name.clone(), name_in_store, light: of_layer(1), direct: Some(of_layer(0)), albedo })
    });
    each.collect()
}

/// Rays a texel of a draft.
const DRAFT_RAYS: u32 = 16;
/// Paths from which on a bake gets a draft: a few seconds on two cores.
const DRAFT_FROM_PATHS: u64 = 1 << 23;
/// Share of the texels of a texture from which on a draft of half the resolution comes first.
const DRAFT_SHARE: f64 = 0.05;

/// For every isovalue and environment the files of all outputs.
fn all_targets(
    command: &Relight,
    volume: &Volume,
    isovalues: &[f64],
    environments: &[String],
) -> Outcome<Vec<Vec<Target>>> {
    let mut all: Vec<Vec<Target>> = vec![Vec::new(); isovalues.len() * environments.len()];
    for output in &command.output {
        for (lod, output) in command.mesh.levels(output)? {
            let pattern = command.picture.pattern(&output)?;
            for (slot, target) in all.iter_mut().zip(targets(&pattern, &volume.name, isovalues, environments)?) {
                slot.push(Target { lod, ..target });
            }
        }
    }
    let paths: Vec<&PathBuf> = all.iter().flatten().map(|t| &t.path).collect();
    let inputs = command.inputs();
    paths.iter().try_for_each(|path| inputs.refuse(path))?;
    if let Some(twice) = (1..paths.len()).find(|&i| paths[..i].contains(&paths[i])) {
        let expected = "different names";
        return Err(Error::argument("output", paths[twice].display(), expected, "two outputs are the same file").into());
    }
    Ok(all)
}
