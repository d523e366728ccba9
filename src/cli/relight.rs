//! `isolume relight`: light on surfaces, from a store, in milliseconds.

use super::baking::{self, Job};
use super::console::Console;
use super::input::VolumeArgs;
use super::isovalue::{Chosen, Isovalue};
use super::light::{LightArgs, Lighting, MaterialArgs, open_probe};
use super::options::TransferArgs;
use super::output::{Format, Target, clean, make_folder, targets};
use super::picture::{PictureArgs, check_size, develop};
use super::surface::Surface;
use super::{Failure, Outcome, info, input, text};
use crate::error::Error;
use crate::export::gltf::{ColourFormat, GltfOptions};
use crate::export::{Image, atomic, gltf, ply, png};
use crate::geom::Up;
use crate::level::{Counts, Pyramid};
use crate::probe::Probe;
use crate::relight::{Contracted, Exposure, LookupReport, Material, SurfaceError, contract};
use crate::render::{RenderOptions, render_with_suns, sun_visibility};
use crate::scene::MaterialRule;
use crate::transfer::store::{Isovalues, Store};
use crate::volume::Volume;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Light isosurfaces by environments and write them as .glb, .ply or .png
///
/// From a store nothing is traced: transfer and light are multiplied. A volume is baked first, for the
/// isovalues asked for, into a store in the user's cache folder; the next run finds it there.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume relight brain.isolume --isovalue 90 --env courtyard -o brain.glb
  isolume relight brain.isolume --isovalue 90,160 --env sunset.exr --env studio -o \"{isovalue}-{env}.png\"
  isolume relight bumpbox:96 --isovalue auto --env sun:45,30 --view 30,40 -o bumps.png")]
pub(super) struct Relight {
    /// Store, or a volume file or field that is baked first
    #[arg(value_name = "X.isolume|VOLUME")]
    input: String,
    /// Isovalues: numbers in the file's values, percentages of their range, or auto
    #[arg(short, long, value_name = "C[,C…]", value_delimiter = ',', required = true, allow_hyphen_values = true)]
    isovalue: Vec<Isovalue>,
    /// Environment: an image file, courtyard, studio, sunset, or a sky: constant, gradient, overcast, sky, sun:AZ,EL
    #[arg(short, long, value_name = "PROBE", required = true)]
    env: Vec<String>,
    /// File to write; its ending decides the format. For several: a name with {isovalue} and {env}, or a directory
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
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

/// JSON has no infinity: it becomes null.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// What does not change from file to file.
struct Context<'a> {
    command: &'a Relight,
    store: &'a Store,
    volume: &'a Volume,
    pyramid: &'a Pyramid,
    rule: MaterialRule,
    up: Up,
    /// What to type to bake an isovalue that is missing.
    bake_hint: String,
}

impl Relight {
    pub(super) fn run(&self, seed: u64, console: &Console) -> Outcome {
        let done = self.execute(seed, console)?;
        done.print(console);
        Ok(())
    }

    /// Lights and writes; prints no result.
    pub(super) fn execute(&self, seed: u64, console: &Console) -> Outcome<Relit> {
        if let Some(scale) = self.mesh.scale
            && !(scale.is_finite() && scale > 0.0)
        {
            return Err(Error::argument("--scale", scale, "a positive number", "give metres to a world unit").into());
        }
        // Whatever can be wrong is refused before the bake, which may take minutes.
        self.material.rule((0.0, 1.0))?;
        let probes = self.open_probes(console)?;
        let environments: Vec<String> = probes.iter().map(|p| p.name.clone()).collect();
        let (store, transport_rays, volume, chosen, read_time) = if info::is_store(&self.input) {
            self.open_store()?
        } else {
            self.bake_volume(&environments, seed, console)?
        };
        let isovalues: Vec<f64> = chosen.iter().map(|c| c.value).collect();
        let files = targets(&self.output, &volume.name, &isovalues, &environments)?;
        if files.iter().any(|f| f.format == Format::Png) {
            check_size(self.picture.size, self.transfer.memory_limit)?;
        }
        for c in &chosen {
            if let Some(reason) = &c.reason {
                console.note(format!("isovalue {}: {reason}", text::number(c.value, 6)));
            }
        }
        let start = Instant::now();
        let pyramid = Pyramid::new(&volume);
        let read_time = read_time + start.elapsed();
        let context = Context {
            command: self,
            store: &store,
            volume: &volume,
            pyramid: &pyramid,
            rule: self.material.rule(volume.value_range())?,
            up: self.volume.up.unwrap_or(volume.up),
            bake_hint: self.input.clone(),
        };
        make_folder(&self.output)?;
        let mut surfaces = Vec::new();
        let mut written = Vec::new();
        let mut files = files.into_iter();
        for &isovalue in &isovalues {
            let surface = Surface::new(&volume, &pyramid, store.layout().lattice, isovalue)?;
            for (probe, target) in probes.iter().zip(files.by_ref()) {
                written.push(context.light(&surface, probe, target)?);
            }
            surfaces.push(surface);
        }
        Ok(Relit { surfaces, files: written, read_time, transport_rays })
    }

    fn open_probes(&self, console: &Console) -> Outcome<Vec<Probe>> {
        let mut probes = Vec::new();
        for argument in &self.env {
            let probe = open_probe(argument, self.light.keep_negative, self.light.layout)?;
            for note in &probe.notes {
                console.note(format!("{}: {} ({})", probe.name, note.text, text::count(note.count)));
            }
            probes.push(probe);
        }
        Ok(probes)
    }

    #[allow(clippy::type_complexity)]
    fn open_store(&self) -> Outcome<(Store, u64, Volume, Vec<Chosen>, Duration)> {
        let start = Instant::now();
        let store = Store::open(&self.input)?;
        let volume = store.volume()?;
        if let Some(side) = self.volume.solid
            && crate::volume::Solid::from(side) != volume.solid
        {
            let expected = format!("the side the store was baked for, {}", store.identity().solid);
            let given = format!("{side:?}").to_lowercase();
            return Err(Error::argument("--solid", given, expected, "bake the volume again with this --solid").into());
        }
        let held = info::holdings(&store)?.1;
        let only = match &held {
            Some(Isovalues::List(list)) if self.isovalue.contains(&Isovalue::Auto) => one_of(list),
            _ => None,
        };
        let resolve = |i: &Isovalue| match (i, only) {
            (Isovalue::Auto, Some(value)) => Ok(Chosen { value, reason: Some("the store holds it".into()) }),
            _ => self.resolve(i, &volume, None),
        };
        let chosen = self.isovalue.iter().map(resolve).collect::<Result<Vec<_>, Error>>()?;
        let time = start.elapsed();
        Ok((store, 0, volume, chosen, time))
    }

    #[allow(clippy::type_complexity)]
    fn bake_volume(
        &self,
        environments: &[String],
        seed: u64,
        console: &Console,
    ) -> Outcome<(Store, u64, Volume, Vec<Chosen>, Duration)> {
        let start = Instant::now();
        let opened = input::open(&self.input, &self.volume)?;
        for note in &opened.volume.notes {
            console.note(&note.text);
        }
        let resolve = |i: &Isovalue| self.resolve(i, &opened.volume, opened.default_isovalue);
        let chosen = self.isovalue.iter().map(resolve).collect::<Result<Vec<_>, Error>>()?;
        let isovalues: Vec<f64> = chosen.iter().map(|c| c.value).collect();
        targets(&self.output, &opened.volume.name, &isovalues, environments)?;
        let layout = self.transfer.layout(&opened.volume, &[5])?;
        let settings = self.transfer.settings(&layout, seed);
        let memory_limit = self.transfer.memory_limit;
        let volume = &opened.volume;
        let job = Job { volume, label: &opened.label, layout, settings, isovalues: Some(isovalues), memory_limit };
        job.check_memory()?;
        let folder = self.cache_folder()?;
        std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, "make the cache folder", e))?;
        let path = folder.join(format!("{}-{}.isolume", clean(&volume.name), &job.identity().hash()[..16]));
        let read_time = start.elapsed();
        let (store, report) = baking::fill(&job, &path, console)?;
        if report.chunks_baked > 0 {
            console.note(format!("baked into {}", path.display()));
            console.print(report.lines(baking::size_on_disk(&path)));
        } else {
            console.note(format!("found in {}", path.display()));
        }
        let rays = report.summary.counts.rays;
        Ok((store, rays, opened.volume, chosen, read_time))
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

impl Context<'_> {
    fn light(&self, surface: &Surface, probe: &Probe, target: Target) -> Outcome<Written> {
        let c = self.command;
        let isovalue = surface.isovalue;
        let lighting = c.light.prepare(probe, self.up, &self.store.layout().layers)?;
        let light = &lighting.light;
        let material = Material::new(self.rule.albedo(isovalue), c.material.emission.0)?;
        let mut times = Times::default();
        let start = Instant::now();
        let mut contracted = contract(self.store, &surface.bricks, light, &material)?;
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
        let camera = surface.camera(self.volume, self.up, args.view, args.projection(), width as f64 / height as f64);
        let options = RenderOptions { width, height, supersampling: SUPERSAMPLING };
        let (isovalue, light, suns) = (surface.isovalue, &lighting.light, &lighting.suns);
        let picture =
            render_with_suns(self.volume, self.pyramid, isovalue, contracted, light, material, &camera, &options, suns);
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
        let held = info::holdings(self.store).map_or("unknown".into(), |h| info::isovalues_text(h.1.as_ref()));
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

/// The lowest of the isovalues that a store holds.
fn one_of(list: &[f64]) -> Option<f64> {
    list.iter().copied().reduce(f64::min)
}

/// Rays along each side of a pixel.
const SUPERSAMPLING: usize = 2;

impl Relit {
    fn print(&self, console: &Console) {
        report(console, &self.surfaces, &self.files, self.read_time, self.transport_rays);
    }
}

fn report(console: &Console, surfaces: &[Surface], written: &[Written], read: Duration, transport_rays: u64) {
    let camera_rays: u64 = written.iter().map(|w| w.camera.rays).sum();
    let mut rows = vec![
        ["file", "isovalue", "environment", "contract", "look up", "render", "write", "EV", "error", "size"]
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
        "error: standard error of the radiance, RMS over the vertices, over its mean\nread {}; transport rays {}, camera rays {}, sun rays {}",
        text::duration(read),
        text::count(transport_rays),
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
        "seconds": { "read": read.as_secs_f64() },
        "transport_rays": transport_rays,
        "camera_rays": camera_rays,
    }));
}

fn file_json(w: &Written) -> Value {
    json!({
        "path": w.target.path.display().to_string(),
        "isovalue": w.isovalue,
        "environment": w.env,
        "bytes": w.bytes,
        "exposure_ev": f64::from(w.exposure).log2(),
        "error": { "rms_over_mean": w.rms_over_mean, "median_relative": finite(w.error.median) },
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
