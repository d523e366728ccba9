//! `isolume relight`: light on surfaces, from a store, in milliseconds.

use super::baking::{self, Estimator, Goal, Hints, Job};
use super::console::Console;
use super::input::VolumeArgs;
use super::isovalue::{Chosen, Isovalue};
use super::light::{LightArgs, Lighting, MaterialArgs, open_probe};
use super::options::TransferArgs;
use super::output::{Format, Target, clean, make_folder, targets};
use super::picture::{PictureArgs, check_size, develop};
use super::scene::SceneFile;
use super::scene_light::contracted;
use super::scene_walls::{WallQuestion, Walls, in_view};
use super::surface::Surface;
use super::{Failure, Outcome, info, options, text};
use crate::error::Error;
use crate::export::gltf::{ColourFormat, GltfOptions};
use crate::export::{Image, atomic, gltf, ply, png};
use crate::geom::Up;
use crate::level::{Counts, Pyramid};
use crate::probe::Probe;
use crate::relight::{Contracted, Exposure, LookupReport, Material, SurfaceError};
use crate::render::{Camera, RenderOptions, render_among, render_with_suns, sun_visibility};
use crate::scene::geometry::Geometry;
use crate::scene::{Effects, EmissionRule, MaterialRule};
use crate::transfer::store::Store;
use crate::transfer::{Lattice, Layout};
use crate::transport::Settings;
use crate::volume::Volume;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Light isosurfaces by environments and write them as .glb, .ply or .png
///
/// From a store nothing is traced: transfer and light are multiplied. A volume is baked first, for the
/// isovalues asked for, into a store in the user's cache folder; the next run finds it there. Where that takes
/// longer than a moment, a draft of 16 rays a texel is written first, then replaced.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume relight brain.isolume --isovalue 90 --env courtyard -o brain.glb
  isolume relight brain.isolume --isovalue 90,160 --env sunset.exr --env studio -o \"{isovalue}-{env}.png\"
  isolume relight bumpbox:96 --isovalue auto --env sun:45,30 --view 30,40 -o bumps.png
  isolume relight scene.toml --exposure -1")]
pub(super) struct Relight {
    /// Store, or a volume file, field or scene (.toml) that is baked first
    #[arg(value_name = "X.isolume|VOLUME|SCENE")]
    input: String,
    /// Isovalues: numbers in the file's values, percentages of their range, or auto
    #[arg(short, long, value_name = "C[,C…]", value_delimiter = ',', required = true, allow_hyphen_values = true)]
    isovalue: Vec<Isovalue>,
    /// Environment: an image file, courtyard, studio, sunset, or a sky: constant, gradient, overcast, sky, sun:AZ,EL
    #[arg(short, long, value_name = "PROBE", required = true)]
    env: Vec<String>,
    /// File to write, or several; the ending decides the format. For several surfaces: a name with {isovalue} and {env},
    /// or a directory
    #[arg(short, long, value_name = "FILE", required = true)]
    output: Vec<PathBuf>,
    /// Write an empty file, instead of an error, for an isovalue that no surface has
    #[arg(long)]
    allow_empty: bool,
    #[command(flatten, next_help_heading = "Light")]
    light: LightArgs,
    #[command(flatten, next_help_heading = "Material")]
    material: MaterialArgs,
    #[command(flatten, next_help_heading = "Mesh files")]
    mesh: MeshArgs,
    #[command(flatten, next_help_heading = "Pictures")]
    picture: PictureArgs,
    #[command(flatten, next_help_heading = "Volume")]
    volume: VolumeArgs,
    #[command(flatten, next_help_heading = "Bake of a volume")]
    transfer: TransferArgs,
    /// Where stores of volumes are kept [default: the user's cache folder]
    #[arg(long, value_name = "DIR", help_heading = "Bake of a volume")]
    cache: Option<PathBuf>,
    /// Write no draft before the result
    #[arg(long, help_heading = "Bake of a volume")]
    no_draft: bool,
    #[arg(skip)]
    pub(super) scene: Option<SceneFile>,
}

#[derive(clap::Args, Clone, Debug)]
struct MeshArgs {
    /// Add the true linear radiance as attribute _RADIANCE, and its standard error as _STDERR
    #[arg(long)]
    radiance: bool,
    /// Store COLOR_0 as 32-bit floats
    #[arg(long)]
    float_color: bool,
    /// glTF units (metres) to a world unit [default: as the file says, or the longest side becomes 1]
    #[arg(long, value_name = "S")]
    scale: Option<f64>,
}

/// What one file took.
#[derive(Clone, Copy, Default)]
pub(super) struct Times {
    contract: Duration,
    look_up: Duration,
    render: Duration,
    write: Duration,
}

impl Times {
    /// From the light to the file.
    pub(super) fn total(&self) -> Duration {
        self.contract + self.look_up + self.render + self.write
    }
}

/// What a run of the command did.
pub(super) struct Relit {
    pub(super) surfaces: Vec<Surface>,
    pub(super) files: Vec<Written>,
    pub(super) read_time: Duration,
    pub(super) transport_rays: u64,
    drafts: Vec<Draft>,
}

/// A first version of the files, written before the bake was done.
struct Draft {
    rays: u32,
    texture: [usize; 3],
    /// From the start of the command until all files were written.
    written_after: Duration,
}

/// A store to light from, and how it came about.
struct Source {
    store: Store,
    /// Rays traced to fill it.
    transport_rays: u64,
}

/// One file and how it came about.
pub(super) struct Written {
    pub(super) target: Target,
    pub(super) isovalue: f64,
    pub(super) env: String,
    pub(super) times: Times,
    /// The picture, where the file is one.
    pub(super) image: Option<Image>,
    report: LookupReport,
    /// Standard error of the radiance at the vertices.
    error: SurfaceError,
    /// Its root mean square over the mean radiance.
    pub(super) rms_over_mean: f64,
    exposure: f32,
    negative: u64,
    /// Visibility rays of suns that were split off.
    sun_rays: u64,
    /// What was done to the light.
    notes: Vec<String>,
    remainder: f32,
    camera: Counts,
    bytes: u64,
}

/// Root mean square of the standard errors of the vertices over their mean radiance (mean of the channels); 0
/// for a black surface.
fn rms_over_mean(radiance: &[[f32; 3]], errors: &[f32]) -> f64 {
    let count = radiance.len().max(1) as f64;
    let mean = radiance.iter().flatten().map(|&v| f64::from(v)).sum::<f64>() / (3.0 * count);
    let square = errors.iter().map(|&e| f64::from(e).powi(2)).sum::<f64>() / count;
    if mean > 0.0 { square.sqrt() / mean } else { 0.0 }
}

/// A relative error; black vertices have none.
fn relative(error: f64) -> String {
    if error.is_finite() { text::percent(error) } else { "-".into() }
}

/// JSON has no infinity: it becomes null.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// What does not change from store to store.
struct Work<'a> {
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
    geometry: Option<&'a Geometry>,
}

/// What does not change from file to file.
struct Context<'a> {
    command: &'a Relight,
    store: &'a Store,
    volume: &'a Volume,
    pyramid: &'a Pyramid,
    rule: &'a MaterialRule,
    emission: &'a EmissionRule,
    up: Up,
    /// What to type to bake an isovalue that is missing.
    bake_hint: String,
    /// What stands around the volume, where it is known.
    geometry: Option<&'a Geometry>,
}

impl Relight {
    pub(super) fn run(&self, seed: u64, console: &Console) -> Outcome {
        let done = self.execute(seed, console)?;
        done.print(console);
        Ok(())
    }

    /// Lights and writes; prints no result.
    pub(super) fn execute(&self, seed: u64, console: &Console) -> Outcome<Relit> {
        let start = Instant::now();
        if let Some(scale) = self.mesh.scale
            && !(scale.is_finite() && scale > 0.0)
        {
            return Err(Error::argument("--scale", scale, "a positive number", "give metres to a world unit").into());
        }
        // Whatever can be wrong is refused before the bake, which may take minutes.
        self.material.rule((0.0, 1.0))?;
        let probes = self.open_probes(console)?;
        if info::is_store(&self.input) {
            self.refuse_effects_of_bakes()?;
            let store = Store::open(&self.input)?;
            let volume = store.volume()?;
            let chosen = self.isovalues_of_store(&store, &volume)?;
            let work = Work::new(self, &volume, &chosen, &probes, start, console)?;
            let source = Source { store, transport_rays: 0 };
            return work.light(&source, Vec::new());
        }
        let mut opened = super::scene::open(&self.input, &self.volume, self.scene.as_ref(), &self.transfer.effects())?;
        self.transfer.switch_shadows(&mut opened.volume);
        for note in &opened.volume.notes {
            console.note(&note.text);
        }
        let of_field = opened.default_isovalue;
        let resolve = |i: &Isovalue| {
            let resolved = self.resolve(i, &opened.volume, of_field);
            resolved.map_err(|e| options::in_scene(e, self.scene.as_ref(), i))
        };
        let chosen = self.isovalue.iter().map(resolve).collect::<Result<Vec<_>, Error>>()?;
        let work = Work::new(self, &opened.volume, &chosen, &probes, start, console)?;
        Work { geometry: opened.geometry.as_ref(), ..work }.bake_and_light(&opened.label, seed)
    }

    fn open_probes(&self, console: &Console) -> Outcome<Vec<Probe>> {
        let mut probes = Vec::new();
        for argument in &self.env {
            let probe = open_probe(argument, self.light.keep_negative, self.light.layout)
                .map_err(|error| self.in_scene(error, argument))?;
            for note in &probe.notes {
                console.note(format!("{}: {} ({})", probe.name, note.text, text::count(note.count)));
            }
            probes.push(probe);
        }
        Ok(probes)
    }

    /// Names the line of the scene that an environment stands in.
    fn in_scene(&self, error: Error, environment: &str) -> Error {
        match &self.scene {
            Some(file) if file.environment().as_deref() == Some(environment) => {
                let line = file.scene.probe.as_ref().map_or(1, |probe| probe.name.line);
                file.scene.at_line(line, error)
            }
            _ => error,
        }
    }

    /// What a store holds cannot be switched any more.
    fn refuse_effects_of_bakes(&self) -> Outcome {
        let effects = self.transfer.effects();
        let Some(name) = ["shadowing", "interreflection"].into_iter().find(|n| effects.switched(n).is_some()) else {
            return Ok(());
        };
        let given = format!("{name} with a store");
        let expected = "an effect that is not in the store already";
        let remedy = "switch it at the bake, or relight the volume itself";
        Err(Error::argument("--effects", given, expected, remedy).into())
    }

    /// Albedo over the isovalue: as options say, else the scene.
    fn albedo_rule(&self, range: (f64, f64)) -> Outcome<MaterialRule> {
        match self.scene.as_ref().and_then(|file| file.scene.albedo.as_ref()) {
            Some(albedo) if !self.material.says_albedo() => Ok(albedo.rule(range)),
            _ => self.material.rule(range),
        }
    }

    /// Emission over the isovalue: as options say, else the scene; none where it is switched off.
    fn emission_rule(&self) -> EmissionRule {
        if self.transfer.effects().switched("emission") == Some(false) {
            return EmissionRule::Constant([0.0; 3]);
        }
        let of_scene = self.scene.as_ref().and_then(|file| file.scene.emission.clone());
        match self.material.emission {
            Some(emission) => EmissionRule::Constant(emission.0),
            None => of_scene.unwrap_or(EmissionRule::Constant([0.0; 3])),
        }
    }

    /// Whether dominant lamps are lit apart.
    fn splits_sun(&self) -> bool {
        self.transfer.effects().switched("sun-split").unwrap_or(self.light.sun_split)
    }

    /// The isovalues asked for; `auto` is the one that the store holds, if it holds only some.
    fn isovalues_of_store(&self, store: &Store, volume: &Volume) -> Outcome<Vec<Chosen>> {
        if let Some(side) = self.volume.solid
            && crate::volume::Solid::from(side) != volume.solid
        {
            let expected = format!("the side the store was baked for, {}", store.identity().solid);
            let given = format!("{side:?}").to_lowercase();
            return Err(Error::argument("--solid", given, expected, "bake the volume again with this --solid").into());
        }
        let held = store.holdings()?;
        let only = held.isovalues.first().copied().filter(|_| !held.all && self.isovalue.contains(&Isovalue::Auto));
        let resolve = |i: &Isovalue| match (i, only) {
            (Isovalue::Auto, Some(value)) => Ok(Chosen { value, reason: Some("the store holds it".into()) }),
            _ => self.resolve(i, volume, None),
        };
        Ok(self.isovalue.iter().map(resolve).collect::<Result<Vec<_>, Error>>()?)
    }

    /// The isovalue for a volume; with `--allow-empty` one that no surface has, too.
    fn resolve(&self, isovalue: &Isovalue, volume: &Volume, of_field: Option<f64>) -> Result<Chosen, Error> {
        match isovalue.resolve(volume, of_field) {
            Err(_) if self.allow_empty => {
                let value = if let Isovalue::Value(value) = isovalue { *value } else { volume.value_range().1 };
                Ok(Chosen { value, reason: Some("no surface has it; what is written is empty".into()) })
            }
            resolved => resolved,
        }
    }

    fn cache_folder(&self) -> Outcome<PathBuf> {
        if let Some(folder) = &self.cache {
            return Ok(folder.clone());
        }
        let folders = directories::ProjectDirs::from("", "", "isolume");
        folders.map(|f| f.cache_dir().to_path_buf()).ok_or_else(|| {
            Failure::Message("this system has no cache folder for the user: name one with --cache DIR".into())
        })
    }
}

impl<'a> Work<'a> {
    fn new(
        command: &'a Relight,
        volume: &'a Volume,
        chosen: &[Chosen],
        probes: &'a [Probe],
        start: Instant,
        console: &'a Console,
    ) -> Outcome<Self> {
        let isovalues: Vec<f64> = chosen.iter().map(|c| c.value).collect();
        let environments: Vec<String> = probes.iter().map(|p| p.name.clone()).collect();
        let files = all_targets(command, volume, &isovalues, &environments)?;
        if files.iter().flatten().any(|f| f.format == Format::Png) {
            check_size(command.picture.size, command.transfer.memory_limit)?;
        }
        for c in chosen {
            if let Some(reason) = &c.reason {
                console.note(format!("isovalue {}: {reason}", text::number(c.value, 6)));
            }
        }
        let pyramid = Pyramid::new(volume);
        let rule = command.albedo_rule(volume.value_range())?;
        let (emission, effects) = (command.emission_rule(), command.transfer.effects());
        let up = command.volume.up.unwrap_or(volume.up);
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

    /// Lights every isosurface from a store by every environment and writes the files.
    fn light(&self, source: &Source, drafts: Vec<Draft>) -> Outcome<Relit> {
        let context = Context {
            command: self.command,
            store: &source.store,
            volume: self.volume,
            pyramid: &self.pyramid,
            rule: &self.rule,
            emission: &self.emission,
            up: self.up,
            bake_hint: self.command.input.clone(),
            geometry: self.geometry,
        };
        self.command.output.iter().try_for_each(|output| make_folder(output))?;
        let mut surfaces = Vec::new();
        let mut written = Vec::new();
        let mut files = all_targets(self.command, self.volume, &self.isovalues, &self.environments)?.into_iter();
        for &isovalue in &self.isovalues {
            let surface = Surface::new(self.volume, &self.pyramid, source.store.layout().lattice, isovalue)?;
            surface.check_memory(self.volume, self.command.transfer.memory_limit)?;
            for (probe, targets) in self.probes.iter().zip(files.by_ref()) {
                for target in targets {
                    written.push(context.light(&surface, probe, target)?);
                }
            }
            surfaces.push(surface);
        }
        let (read_time, transport_rays) = (self.read_time, source.transport_rays);
        Ok(Relit { surfaces, files: written, read_time, transport_rays, drafts })
    }

    /// Bakes what the isosurfaces need, coarsely first where the whole takes long, and lights them each time.
    fn bake_and_light(&self, label: &str, seed: u64) -> Outcome<Relit> {
        let transfer = &self.command.transfer;
        let bands = self.command.scene.as_ref().and_then(SceneFile::bands).unwrap_or(vec![5]);
        let layout = baking::layout_of_scene(transfer.layout(self.volume, &bands)?, self.geometry);
        let settings = transfer.settings(&layout, seed, false);
        let job = Job {
            volume: self.volume,
            label,
            layout,
            settings,
            goal: Goal { error: transfer.error, ..Goal::default() },
            estimator: Estimator::Path,
            isovalues: Some(self.isovalues.clone()),
            share: None,
            memory_limit: transfer.memory_limit,
            start: self.start,
            effects: &self.effects,
            hints: Hints::default(),
            geometry: self.geometry,
        };
        job.check_memory()?;
        let folder = self.command.cache_folder()?;
        std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, "make the cache folder", e))?;
        let mut drafts = Vec::new();
        for draft in self.drafts(&job, &folder)? {
            let source = self.bake(&draft, &folder, true)?;
            let (rays, texture) = (draft.settings.rays, draft.layout.lattice.texels());
            drop(self.light(&source, Vec::new())?);
            let written_after = self.start.elapsed();
            self.console.note(format!(
                "a draft of {rays} rays a texel, {} × {} × {} texels, is written after {}; going on",
                texture[0],
                texture[1],
                texture[2],
                text::duration(written_after)
            ));
            drafts.push(Draft { rays, texture, written_after });
        }
        let source = self.bake(&job, &folder, false)?;
        self.light(&source, drafts)
    }

    /// The drafts that come before a bake: one of few rays where the bake would take more than a moment, and before
    /// it one of a coarser texture where the isosurfaces need many texels.
    fn drafts<'j>(&self, job: &Job<'j>, folder: &Path) -> Outcome<Vec<Job<'j>>> {
        let lattice = job.layout.lattice;
        let missing = job.texels_missing(&self.store_path(job, folder))?;
        let paths = missing * u64::from(job.settings.rays);
        if self.command.no_draft || job.settings.rays <= DRAFT_RAYS || paths < DRAFT_FROM_PATHS {
            return Ok(Vec::new());
        }
        let few_rays = |layout: Layout| Job {
            settings: Settings { rays: DRAFT_RAYS, ..job.settings.clone() },
            goal: Goal::default(),
            layout,
            isovalues: job.isovalues.clone(),
            ..*job
        };
        let mut drafts = Vec::new();
        let all: u64 = lattice.texels().iter().map(|&m| m as u64).product();
        if missing as f64 > DRAFT_SHARE * all as f64 {
            let halved = std::array::from_fn(|a| lattice.texels()[a].div_ceil(2).max(lattice.grid()[a].min(2)));
            let lattice = Lattice::from_texels(lattice.grid(), halved)?;
            drafts.push(few_rays(Layout { lattice, layers: job.layout.layers.clone() }));
        }
        drafts.push(few_rays(job.layout.clone()));
        Ok(drafts)
    }

    fn store_path(&self, job: &Job<'_>, folder: &Path) -> PathBuf {
        folder.join(format!("{}-{}.isolume", clean(&self.volume.name), &job.identity().hash()[..16]))
    }

    fn bake(&self, job: &Job<'_>, folder: &Path, is_draft: bool) -> Outcome<Source> {
        let path = self.store_path(job, folder);
        let (store, report) = baking::fill(job, &path, self.console)?;
        if report.chunks_baked == 0 {
            self.console.note(format!("found in {}", path.display()));
        } else if !is_draft {
            self.console.note(format!("baked into {}", path.display()));
            self.console.print(report.lines(baking::size_on_disk(&path)));
        }
        Ok(Source { store, transport_rays: report.summary.counts.rays })
    }
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
        for (slot, target) in all.iter_mut().zip(targets(output, &volume.name, isovalues, environments)?) {
            slot.push(target);
        }
    }
    let paths: Vec<&PathBuf> = all.iter().flatten().map(|t| &t.path).collect();
    if let Some(twice) = (1..paths.len()).find(|&i| paths[..i].contains(&paths[i])) {
        let expected = "different names";
        return Err(Error::argument("output", paths[twice].display(), expected, "two outputs are the same file").into());
    }
    Ok(all)
}

impl Context<'_> {
    fn light(&self, surface: &Surface, probe: &Probe, target: Target) -> Outcome<Written> {
        let c = self.command;
        let isovalue = surface.isovalue;
        let lighting = c.light.prepare(probe, self.up, &self.store.layout().layers, c.splits_sun())?;
        let light = &lighting.light;
        let material = Material::new(self.rule.albedo(isovalue), self.emission.at(isovalue))?;
        let mut times = Times::default();
        let start = Instant::now();
        let mut contracted = contracted(self.store, &surface.bricks, &lighting, &material, &c.light.luminaires)?;
        let mut notes = lighting.notes.clone();
        if lighting.certified {
            let clamped = contracted.clamp_negative();
            notes.push(format!(
                "{}: {} of {} texels were below 0 by noise or rounding and are 0 now, {} of the energy",
                probe.name,
                text::count(clamped.texels),
                text::count(clamped.of_texels),
                text::percent(clamped.energy)
            ));
        }
        times.contract = start.elapsed();
        let start = Instant::now();
        let mut lit = contracted.look_up(&surface.mesh.positions_in_grid, &surface.mesh.normals, light, &material);
        let mut sun_rays = 0;
        for sun in &lighting.suns {
            let (positions, normals) = (&surface.mesh.positions_in_grid, &surface.mesh.normals);
            let seen = sun_visibility(self.volume, self.pyramid, isovalue, positions, normals, sun);
            lit.add_sun(&seen.lit, sun.flux, &material);
            sun_rays += seen.counts.rays;
        }
        let errors = contracted.look_up_errors(&surface.mesh.positions_in_grid);
        times.look_up = start.elapsed();
        if lit.report.unbaked > 0 {
            return Err(self.unbaked(isovalue, &lit.report));
        }
        let exposure = c.material.exposure.factor(&lit.radiance);
        let mut written = Written {
            target,
            isovalue,
            env: probe.name.clone(),
            times,
            image: None,
            report: lit.report,
            error: SurfaceError::new(&lit.radiance, &errors),
            rms_over_mean: rms_over_mean(&lit.radiance, &errors),
            exposure,
            negative: lit.radiance.iter().filter(|v| v.iter().any(|&x| x < 0.0)).count() as u64,
            remainder: contracted.emission_remainder,
            camera: Counts::default(),
            sun_rays,
            notes,
            bytes: 0,
        };
        let record = self.record(probe, &material, &written);
        match written.target.format {
            Format::Png => self.write_picture(surface, &contracted, &lighting, &material, record, &mut written)?,
            _ => self.write_mesh(surface, &lit.radiance, &errors, record, &mut written)?,
        }
        written.bytes = std::fs::metadata(&written.target.path).map_or(0, |m| m.len());
        Ok(written)
    }

    /// What a picture shows of the walls of the scene.
    fn walls(
        &self,
        isovalue: f64,
        camera: &Camera,
        options: &RenderOptions,
        lighting: &Lighting,
        material: &Material,
    ) -> Outcome<Option<Walls<'_>>> {
        let Some(geometry) = self.geometry else { return Ok(None) };
        let rays = self.command.transfer.rays.unwrap_or(64);
        let question = WallQuestion { volume: self.volume, pyramid: self.pyramid, isovalue, material, rays };
        Ok(Some(Walls::new(geometry, &question, camera, options, lighting, &self.command.light.luminaires)?))
    }

    fn write_mesh(
        &self,
        surface: &Surface,
        radiance: &[[f32; 3]],
        errors: &[f32],
        record: Value,
        written: &mut Written,
    ) -> Outcome {
        let args = &self.command.mesh;
        let start = Instant::now();
        let colours = Exposure::apply(written.exposure, radiance);
        let name = format!("{} {}", self.volume.name, text::number(surface.isovalue, 8));
        let mesh = surface.export(&name, self.volume, self.up, &colours, args.radiance.then_some((radiance, errors)));
        let path = &written.target.path;
        if written.target.format == Format::Ply {
            let options = ply::PlyOptions { provenance: record, ..Default::default() };
            atomic::write(path, |w| ply::write(w, &mesh, &options))?;
        } else {
            let colour_format = if args.float_color { ColourFormat::F32 } else { ColourFormat::U16 };
            let options = GltfOptions { colour_format, scale: args.scale, provenance: record, ..Default::default() };
            atomic::write(path, |w| gltf::write(w, &mesh, &options))?;
        }
        written.times.write = start.elapsed();
        Ok(())
    }

    fn write_picture(
        &self,
        surface: &Surface,
        contracted: &Contracted,
        lighting: &Lighting,
        material: &Material,
        record: Value,
        written: &mut Written,
    ) -> Outcome {
        let args = &self.command.picture;
        let start = Instant::now();
        let (width, height) = args.size;
        let (aspect, projection) = (width as f64 / height as f64, args.projection());
        let camera = match in_view(self.geometry, self.volume) {
            Some(bounds) => Camera::framing(&bounds, self.up, args.view, projection, aspect),
            None => surface.camera(self.volume, self.up, args.view, projection, aspect),
        };
        let options = RenderOptions { width, height, supersampling: SUPERSAMPLING };
        let (isovalue, light, suns) = (surface.isovalue, &lighting.light, &lighting.suns);
        if self.geometry.is_none() && self.store.identity().scene.is_some() {
            written
                .notes
                .push("the store does not hold the walls: relight the scene file to see them in pictures".into());
        }
        let picture = match self.walls(isovalue, &camera, &options, lighting, material)? {
            Some(walls) => {
                let backdrop = |origin, direction, limit, pixel| walls.seen(origin, direction, limit, pixel);
                let (volume, pyramid) = (self.volume, self.pyramid);
                render_among(volume, pyramid, isovalue, contracted, light, material, &camera, &options, &backdrop)
            }
            None => render_with_suns(
                self.volume,
                self.pyramid,
                isovalue,
                contracted,
                light,
                material,
                &camera,
                &options,
                suns,
            ),
        };
        if picture.report.unbaked > 0 {
            return Err(self.unbaked(surface.isovalue, &picture.report));
        }
        written.report += picture.report;
        written.camera = picture.counts;
        written.times.render = start.elapsed();
        let start = Instant::now();
        let image = develop(&picture, written.exposure, args.background)?;
        let options = png::PngOptions {
            alpha: args.background[3] < 1.0,
            software: Some(concat!("isolume ", env!("CARGO_PKG_VERSION")).into()),
            description: Some(record.to_string()),
        };
        atomic::write(&written.target.path, |w| png::write(w, &image, &options))?;
        written.image = Some(image);
        written.times.write = start.elapsed();
        Ok(())
    }

    /// The error for a surface whose texels the store does not have.
    fn unbaked(&self, isovalue: f64, report: &LookupReport) -> Failure {
        let held = self.store.holdings().map_or("unknown".into(), |h| info::isovalues_text(&h));
        let value = text::number(isovalue, 8);
        let source = self.store.provenance()["input"].as_str().unwrap_or("VOLUME").to_string();
        Failure::Message(format!(
            "{}: {} of {} lookups at isovalue {value} meet texels that were never baked; \
             the store holds these isovalues: {held}; \
             bake the missing ones into it: isolume bake {source} --isovalues {value} -o {} \
             (with the options of the first bake)",
            self.bake_hint,
            text::count(report.unbaked),
            text::count(report.lookups),
            self.store.path().display(),
        ))
    }

    /// How the file was made; nothing in it depends on the machine, the threads or the clock.
    fn record(&self, probe: &Probe, material: &Material, written: &Written) -> Value {
        let c = self.command;
        json!({
            "program": concat!("isolume ", env!("CARGO_PKG_VERSION")),
            "volume": self.volume.name,
            "store": self.store.identity().hash(),
            "isovalue": written.isovalue,
            "solid": self.store.identity().solid,
            "environment": probe.name,
            "env_rotate_degrees": c.light.env_rotate,
            "bands": c.light.bands.map_or(self.store.layout().layers.max_bands(), usize::from),
            "window": c.light.window_name(),
            "albedo": material.albedo,
            "emission": material.emission,
            "exposure_ev": f64::from(written.exposure).log2(),
            "error": { "rms_over_mean": written.rms_over_mean, "median_relative": finite(written.error.median) },
        })
    }
}

/// Rays along each side of a pixel.
const SUPERSAMPLING: usize = 2;

impl Relit {
    fn print(&self, console: &Console) {
        report(console, self);
    }
}

fn report(console: &Console, relit: &Relit) {
    let Relit { surfaces, files: written, read_time, transport_rays, drafts } = relit;
    let camera_rays: u64 = written.iter().map(|w| w.camera.rays).sum();
    let mut rows = vec![
        [
            "file",
            "isovalue",
            "environment",
            "contract",
            "look up",
            "render",
            "write",
            "EV",
            "error",
            "median",
            "95 %",
            "size",
        ]
        .map(String::from)
        .to_vec(),
    ];
    for w in written {
        rows.push(vec![
            w.target.path.display().to_string(),
            text::number(w.isovalue, 6),
            w.env.clone(),
            text::duration(w.times.contract),
            text::duration(w.times.look_up),
            if w.target.format == Format::Png { text::duration(w.times.render) } else { "-".into() },
            text::duration(w.times.write),
            format!("{:+.2}", w.exposure.log2()),
            text::percent(w.rms_over_mean),
            relative(w.error.median),
            relative(w.error.percentile_95),
            text::bytes(w.bytes as f64),
        ]);
    }
    for s in surfaces {
        console.print(format!(
            "isovalue {}: {} vertices, {} triangles, {} bricks; extract {}, select {}",
            text::number(s.isovalue, 6),
            text::count(s.mesh.positions_in_grid.len() as u64),
            text::count(s.mesh.triangles.len() as u64),
            text::count(s.bricks.len() as u64),
            text::duration(s.extract_time),
            text::duration(s.select_time),
        ));
    }
    console.print(text::table(&rows));
    let mut total = LookupReport::default();
    written.iter().for_each(|w| total += w.report);
    console.print(format!(
        "lookups {}: {} renormalised, {} from the neighbourhood, {} unoccluded, {} unbaked",
        text::count(total.lookups),
        text::count(total.renormalised),
        text::count(total.neighbourhood),
        text::count(total.unoccluded),
        text::count(total.unbaked),
    ));
    console.print(format!(
        "error: standard error of the radiance, RMS over the vertices, over its mean; median and 95 %: of the vertices' own\n\
         relative errors\nread {}; transport rays {}, camera rays {}, sun rays {}",
        text::duration(*read_time),
        text::count(*transport_rays),
        text::count(camera_rays),
        text::count(written.iter().map(|w| w.sun_rays).sum())
    ));
    for w in written {
        for note in &w.notes {
            console.note(note);
        }
        if w.negative > 0 {
            console.note(format!(
                "{}: {} vertices have a negative channel (ringing of the band-limited light), shown as 0; --window softens it",
                w.target.path.display(),
                text::count(w.negative)
            ));
        }
        if w.remainder > 0.0 {
            console.note(format!(
                "{}: albedo 1 with emission has no end; up to {:.3} of the emission per further bounce is left out",
                w.target.path.display(),
                w.remainder
            ));
        }
    }
    console.print_json(&json!({
        "surfaces": surfaces.iter().map(|s| json!({
            "isovalue": s.isovalue,
            "vertices": s.mesh.positions_in_grid.len(),
            "triangles": s.mesh.triangles.len(),
            "bricks": s.bricks.len(),
            "seconds": { "extract": s.extract_time.as_secs_f64(), "select": s.select_time.as_secs_f64() },
        })).collect::<Vec<_>>(),
        "files": written.iter().map(file_json).collect::<Vec<_>>(),
        "seconds": { "read": read_time.as_secs_f64() },
        "drafts": drafts.iter().map(|d| json!({
            "rays_per_texel": d.rays, "texels": d.texture, "written_after_seconds": d.written_after.as_secs_f64(),
        })).collect::<Vec<_>>(),
        "transport_rays": transport_rays,
        "camera_rays": camera_rays,
        "sun_rays": written.iter().map(|w| w.sun_rays).sum::<u64>(),
    }));
}

fn file_json(w: &Written) -> Value {
    json!({
        "path": w.target.path.display().to_string(),
        "isovalue": w.isovalue,
        "environment": w.env,
        "bytes": w.bytes,
        "exposure_ev": f64::from(w.exposure).log2(),
        "error": {
            "rms_over_mean": w.rms_over_mean,
            "median_relative": finite(w.error.median),
            "percentile_95_relative": finite(w.error.percentile_95),
        },
        "negative_vertices": w.negative, "sun_rays": w.sun_rays, "light_notes": w.notes,
        "emission_remainder": w.remainder,
        "lookups": {
            "all": w.report.lookups, "renormalised": w.report.renormalised,
            "neighbourhood": w.report.neighbourhood, "unoccluded": w.report.unoccluded,
            "unbaked": w.report.unbaked,
        },
        "seconds": {
            "contract": w.times.contract.as_secs_f64(), "look_up": w.times.look_up.as_secs_f64(),
            "render": w.times.render.as_secs_f64(), "write": w.times.write.as_secs_f64(),
        },
    })
}
