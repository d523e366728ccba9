//! What one run does: the bake of what is missing, drafts first, and every surface under every light.

use super::{Draft, Host, Job, LitSurface, Relit};
use crate::bake::{Quality, Request, Writing};
use crate::cache::{Cache, Filled, InUse, Note, drafts, lights};
use crate::error::{Error, Result};
use crate::export::png::check_size;
use crate::export::target::{Format, Target, targets};
use crate::geom::Up;
use crate::level::Pyramid;
use crate::memory;
use crate::probe::{MOST_SUNS, SunSplit};
use crate::quantity::{duration, number};
use crate::scene::geometry::Geometry;
use crate::scene::{EmissionRule, MaterialRule, Member, SceneFile};
use crate::session::{FileOptions, Part, PictureOptions, Session, Surface, Turntable};
use crate::transfer::store::Store;
use crate::volume::Volume;
use crate::volume::isovalue::Chosen;
use std::path::PathBuf;
use std::time::Duration;

/// A store to light from, and how it came about.
pub(super) struct Source {
    pub(super) store: Store,
    /// Rays traced to fill it.
    pub(super) transport_rays: u64,
}

/// What does not change from store to store.
pub(super) struct Work<'a> {
    job: &'a Job<'a>,
    volume: &'a Volume,
    isovalues: Vec<f64>,
    environments: Vec<String>,
    pyramid: Pyramid,
    rule: MaterialRule,
    emission: EmissionRule,
    up: Up,
    /// What reading and preparing took.
    read_seconds: f64,
    seconds: &'a dyn Fn() -> f64,
    /// What stands around the volume, where it is known.
    pub(super) geometry: Option<&'a Geometry>,
}

impl<'a> Work<'a> {
    pub(super) fn new(
        job: &'a Job<'a>,
        volume: &'a Volume,
        chosen: &[Chosen],
        note: &Note<'_>,
        seconds: &'a dyn Fn() -> f64,
    ) -> Result<Self> {
        volume.check_cells()?;
        let isovalues: Vec<f64> = chosen.iter().map(|c| c.value).collect();
        let environments: Vec<String> = job.probes.iter().map(|p| p.name.clone()).collect();
        if job.turntable.is_some() {
            job.make_folders()?;
        }
        let files = all_targets(job, volume, &isovalues, &environments)?;
        job.check_meshes(&files.concat())?;
        if files.iter().flatten().any(|f| f.format == Format::Png) {
            check_size((job.picture.width, job.picture.height), job.quality.memory_limit)?;
        }
        job.check_lightmap(&files.concat())?;
        chosen.iter().flat_map(Chosen::notes).for_each(|text| note(&text));
        let pyramid = Pyramid::new(volume);
        let rule = job.material.rule_in(job.scene, volume.value_range())?;
        let emission = job.material.emission_in(job.scene, &job.quality.effects);
        let up = job.how.volume.up_of(volume.up)?;
        let read_seconds = seconds();
        Ok(Self {
            job,
            volume,
            isovalues,
            environments,
            pyramid,
            rule,
            emission,
            up,
            read_seconds,
            seconds,
            geometry: None,
        })
    }

    /// Lights every isosurface of the volume from a store by every environment and writes the files.
    pub(super) fn light(&self, source: &Source, drafts: Vec<Draft>) -> Result<Relit> {
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
    ) -> Result<Relit> {
        let options = self.file_options(session.up(), session.splits_lamps());
        self.job.make_folders()?;
        let mut surfaces = Vec::new();
        let mut written = Vec::new();
        let mut files = all_targets(self.job, self.volume, &self.isovalues, &self.environments)?.into_iter();
        for isovalues in isovalues {
            let surface = self.surface(session, isovalues, &mut surfaces)?;
            for (probe, targets) in self.job.probes.iter().zip(files.by_ref()) {
                written.extend(session.write_files(&surface, probe, targets, &options, self.seconds)?);
            }
        }
        let views = self.job.describe_pictures(session.up());
        Ok(Relit { surfaces, files: written, views, read_seconds: self.read_seconds, transport_rays, drafts })
    }

    /// How files are lit and written.
    fn file_options(&self, up: Up, splits: bool) -> FileOptions<'_> {
        let job = self.job;
        FileOptions {
            light: job.light_options(splits),
            albedo: &self.rule,
            emission: &self.emission,
            medium_albedo: job.material.medium_albedo,
            luminaires: job.luminaires,
            exposure: job.material.exposure,
            mesh: job.mesh.clone(),
            picture: PictureOptions { view: job.view.view(up), ..job.picture.clone() },
            turntable: job.turntable,
            tells_no_sun: job.asked_split().is_some(),
        }
    }

    /// Extracts the isosurface of every volume and finds its texels; what is told of it goes into `told`.
    fn surface<'s>(
        &self,
        session: &'s Session<'s>,
        isovalues: &[f64],
        told: &mut Vec<LitSurface>,
    ) -> Result<Surface<'s>> {
        let mut parts: Vec<Part> = Vec::new();
        for (member, &isovalue) in session.members().iter().zip(isovalues) {
            let start = (self.seconds)();
            let isosurface = member.extract(isovalue)?;
            let extract_seconds = (self.seconds)() - start;
            let start = (self.seconds)();
            let part = member.select(isosurface);
            told.push(LitSurface::new(&part, extract_seconds, (self.seconds)() - start));
            parts.push(part);
        }
        let surface = session.surface_of(parts)?;
        let what = format!("relighting isovalue {}", number(isovalues[0], 8));
        let splits = session.splits_lamps();
        let lamps = if splits && self.job.light_options(splits).split_sun != SunSplit::Off { MOST_SUNS } else { 0 };
        memory::check(&what, surface.bytes_of_lighting(lamps), self.job.quality.memory_limit)?;
        Ok(surface)
    }

    /// Bakes what the isosurfaces of the volume need, coarsely first where the whole takes long, and lights them each time.
    pub(super) fn bake_and_light<E: From<Error>>(
        &self,
        member: &Member,
        host: &Host<'_, E>,
    ) -> std::result::Result<Relit, E> {
        let bands = self.job.scene.map(SceneFile::bands).unwrap_or_default().into_iter().map(usize::from).collect();
        let quality = Quality { bands, ..self.job.quality.clone() };
        let layers = quality.layout(self.volume, self.geometry)?.layers;
        let albedo = self.rule.largest_albedo(Some(&self.isovalues));
        let options = self.job.light_options(Geometry::splits_lamps(self.geometry));
        let lights = lights(self.job.probes, (self.up, &layers), &options, albedo)?;
        let request = quality.request(member, Some(self.isovalues.clone()), lights)?;
        let request = Request { writing: Writing::of_cache(), ..request };
        request.check_memory()?;
        request.check()?;
        let cache = (host.cache)()?;
        let mut written = Vec::new();
        let drafts = if self.job.drafts { drafts(&request, &cache.place(&request))? } else { Vec::new() };
        for draft in drafts {
            let (source, _use) = self.bake(&draft, &cache, true, host)?;
            let (rays, texture) = (draft.settings.rays, draft.layout.lattice.texels());
            drop(self.light(&source, Vec::new())?);
            let written_after_seconds = (self.seconds)();
            let what = match draft.surfaces {
                true => "vertex".into(),
                false => format!("texel, {} × {} × {} texels,", texture[0], texture[1], texture[2]),
            };
            let after = duration(Duration::from_secs_f64(written_after_seconds));
            (host.note)(&format!("a draft of {rays} rays a {what} is written after {after}; going on"));
            written.push(Draft { rays, texture, written_after_seconds });
        }
        let (source, _use) = self.bake(&request, &cache, false, host)?;
        let done = self.light(&source, written)?;
        cache.tidy(host.note);
        Ok(done)
    }

    fn bake<E>(
        &self,
        request: &Request<'_>,
        cache: &Cache,
        is_draft: bool,
        host: &Host<'_, E>,
    ) -> Result<(Source, InUse)> {
        let path = cache.place(request);
        let filled = cache.fill(request, &path, host.fill, host.note)?;
        if filled.report.chunks_baked == 0 || !is_draft {
            (host.note)(&cache.describe(&filled.report, None, &path));
        }
        if !is_draft {
            (host.filled)(&filled);
        }
        let Filled { store, report, in_use } = filled;
        Ok((Source { store, transport_rays: report.summary.counts.rays }, in_use))
    }
}

impl Job<'_> {
    /// What pictures are, in words.
    fn describe_pictures(&self, up: Up) -> String {
        let frames = self.turntable.map(|table| format!("{} frames of ", table.frames)).unwrap_or_default();
        format!("{frames}{} × {}, {}", self.picture.width, self.picture.height, self.view.describe(up))
    }
}

/// For every isovalue and environment the files of all outputs.
fn all_targets(job: &Job<'_>, volume: &Volume, isovalues: &[f64], environments: &[String]) -> Result<Vec<Vec<Target>>> {
    let mut all: Vec<Vec<Target>> = vec![Vec::new(); isovalues.len() * environments.len()];
    for output in job.outputs {
        for (lod, output) in job.levels(output)? {
            let pattern = job.turntable.map_or_else(|| Ok(output.clone()), |_| Turntable::pattern(&output))?;
            for (slot, target) in all.iter_mut().zip(targets(&pattern, &volume.name, isovalues, environments)?) {
                slot.push(Target { lod, ..target });
            }
        }
    }
    let paths: Vec<&PathBuf> = all.iter().flatten().map(|t| &t.path).collect();
    paths.iter().try_for_each(|path| job.inputs.refuse(path))?;
    if let Some(twice) = (1..paths.len()).find(|&i| paths[..i].contains(&paths[i])) {
        let expected = "different names";
        return Err(Error::argument("output", paths[twice].display(), expected, "two outputs are the same file"));
    }
    Ok(all)
}
