//! What one run does: the bake of what is missing, drafts first, and every surface under every light.

use super::{Draft, LitSurface, Relight, Relit};
use crate::bake::{Request, Writing};
use crate::cache::{Cache, Filled, InUse, drafts, lights};
use crate::cli::baking::{details, filler};
use crate::cli::cache::{locate, prepare};
use crate::cli::console::Console;
use crate::cli::isovalue::{Chosen, tell};
use crate::cli::light::by_option;
use crate::cli::{Failure, Outcome, text};
use crate::error::Error;
use crate::export::png::check_size;
use crate::export::target::{Format, Target, make_folder, targets};
use crate::geom::Up;
use crate::level::Pyramid;
use crate::memory;
use crate::probe::Probe;
use crate::scene::geometry::Geometry;
use crate::scene::{EmissionRule, MaterialRule, Member, SceneFile};
use crate::session::{FileOptions, Part, Session, Surface};
use crate::transfer::store::{Holdings, Store};
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
        if command.mesh.transfer && files.iter().flatten().all(|f| f.format != Format::Glb) {
            let expected = "an output that ends in .glb";
            let remedy = "transfer is carried by glTF alone: add -o NAME.glb, or leave out --transfer";
            return Err(Error::argument("--transfer", "without a .glb", expected, remedy).into());
        }
        if files.iter().flatten().any(|f| f.format == Format::Png) {
            check_size(command.picture.seen.size, command.transfer.memory_limit)?;
        }
        tell(console, chosen);
        let pyramid = Pyramid::new(volume);
        let rule = command.albedo_rule(volume.value_range())?;
        let emission = command.emission_rule();
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
        let in_scene = session.members()[0].store().identity().scene.is_some();
        let options = self.file_options(session.up(), in_scene);
        let seconds = || self.start.elapsed().as_secs_f64();
        self.command.output.iter().try_for_each(|output| make_folder(output))?;
        let mut surfaces = Vec::new();
        let mut written = Vec::new();
        let mut files = all_targets(self.command, self.volume, &self.isovalues, &self.environments)?.into_iter();
        for isovalues in isovalues {
            let surface = self.surface(session, isovalues, &mut surfaces)?;
            for (probe, targets) in self.probes.iter().zip(files.by_ref()) {
                for target in targets {
                    let file = session.write_file(&surface, probe, target, &options, &seconds);
                    written.push(file.map_err(|e| self.explained(session, e))?);
                }
            }
        }
        let views = self.command.picture.describe(session.up());
        Ok(Relit { surfaces, files: written, views, read_time: self.read_time, transport_rays, drafts })
    }

    /// How files are lit and written.
    fn file_options(&self, up: Up, in_scene: bool) -> FileOptions<'_> {
        let c = self.command;
        FileOptions {
            light: c.light_options(in_scene),
            albedo: &self.rule,
            emission: &self.emission,
            medium_albedo: c.material.medium_albedo.map(|albedo| albedo.0),
            luminaires: &c.light.luminaires,
            exposure: c.material.exposure,
            mesh: c.mesh.options(),
            picture: c.picture.options(up, c.transfer.rays.unwrap_or(64)),
            turntable: c.picture.turntable(),
            tells_no_sun: c.sun_split().is_some(),
        }
    }

    /// The error for a surface whose texels the store does not have says what to type; others name options.
    fn explained(&self, session: &Session<'_>, error: Error) -> Failure {
        let Error::Unbaked { path, isovalue, unbaked, lookups, holds_all, isovalues, .. } = error else {
            return by_option(error).into();
        };
        let held = Holdings { all: holds_all, isovalues, ..Holdings::default() }.isovalues_text();
        let value = text::number(isovalue, 8);
        let source = session.members()[0].store().provenance()["input"].as_str().unwrap_or("VOLUME");
        Failure::Message(format!(
            "{}: {} of {} lookups at isovalue {value} meet texels that were never baked; \
             the store holds these isovalues: {held}; \
             bake the missing ones into it: isolume bake {source} --isovalues {value} -o {} \
             (with the options of the first bake)",
            self.command.input,
            text::count(unbaked),
            text::count(lookups),
            path.display(),
        ))
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
        memory::check(&what, surface.bytes_of_lighting(), self.command.transfer.memory_limit)?;
        Ok(surface)
    }

    /// Bakes what the isosurfaces of the volume need, coarsely first where the whole takes long, and lights them each time.
    pub(super) fn bake_and_light(&self, member: &Member, seed: u64) -> Outcome<Relit> {
        let bands = self.command.scene.as_ref().map(SceneFile::bands).unwrap_or_default();
        let quality = self.command.transfer.quality(&bands, seed);
        let layers = quality.layout(self.volume, self.geometry)?.layers;
        let albedo = self.rule.largest_albedo(Some(&self.isovalues));
        let options = self.command.light_options(self.geometry.is_some());
        let lights = lights(self.probes, (self.up, &layers), &options, albedo).map_err(by_option)?;
        let request = quality.request(member, Some(self.isovalues.clone()), lights)?;
        let job = Request { writing: Writing::of_cache(), ..request };
        job.check_memory()?;
        job.check()?;
        let cache = locate(self.command.cache.as_deref())?;
        prepare(&cache)?;
        let mut written = Vec::new();
        let drafts = if self.command.no_draft { Vec::new() } else { drafts(&job, &cache.place(&job))? };
        for draft in drafts {
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
            written.push(Draft { rays, texture, written_after });
        }
        let (source, _use) = self.bake(&job, &cache, false)?;
        let done = self.light(&source, written)?;
        cache.tidy(&|text| self.console.note(text));
        Ok(done)
    }

    fn bake(&self, job: &Request<'_>, cache: &Cache, is_draft: bool) -> Outcome<(Source, InUse)> {
        let path = cache.place(job);
        let note = |text: &str| self.console.note(text);
        let filled = cache.fill(job, &path, &filler(self.start, self.console), &note)?;
        if filled.report.chunks_baked == 0 || !is_draft {
            note(&cache.describe(&filled.report, None, &path));
        }
        if !is_draft {
            details(&filled, self.console);
        }
        let Filled { store, report, in_use } = filled;
        Ok((Source { store, transport_rays: report.summary.counts.rays }, in_use))
    }
}

/// For every isovalue and environment the files of all outputs.
fn all_targets(
    command: &Relight,
    volume: &Volume,
    isovalues: &[f64],
    environments: &[String],
) -> Outcome<Vec<Vec<Target>>> {
    let mut all: Vec<Vec<Target>> = vec![Vec::new(); isovalues.len() * environments.len()];
    for output in &command.output {
        for (slot, target) in
            all.iter_mut().zip(targets(&command.picture.pattern(output)?, &volume.name, isovalues, environments)?)
        {
            slot.push(target);
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
