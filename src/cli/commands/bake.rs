//! `isolume bake`: fills a transfer store.

use crate::bake::{Estimator, ForLight, Hints, Quality, Share, Writing};
use crate::cache::for_light;
use crate::cli::args::transfer::{BakeArgs, parse_texel, parse_time};
use crate::cli::args::volume::VolumeArgs;
use crate::cli::commands::{pack, replay};
use crate::cli::failure::{Failure, Outcome};
use crate::cli::present::console::Console;
use crate::cli::present::lent::{clock, fill};
use crate::cli::present::{baked, text};
use crate::error::Error;
use crate::file::{file_name, size_on_disk};
use crate::probe::{EnvFrame, Orientation};
use crate::relight::Material;
use crate::scene::{Scene, SceneFile, TextureSize, environment, open_probe};
use crate::study::forecast as forecasts;
use crate::study::forecast::best_within;
use crate::study::model::ENOUGH;
use crate::transfer::Layers;
use crate::transfer::store::{PackError, Replacement, StoreOptions, kind};
use crate::volume::Volume;
use crate::volume::isovalue::Chosen;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Compute the light transfer of a volume, once for every environment
///
/// The result is a store: a directory that any program which reads Zarr opens, with the volume in it. A bake
/// that was stopped goes on with the same command; a bake with other --isovalues or more --rays extends the
/// store.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume bake brain.nii.gz --rays 64 --layers 4 -o brain.isolume
  isolume bake bumpbox:128 --isovalues 30,60 --error 1% -o bumps.isolume
  isolume bake brain.nii.gz --time 90s -o brain.isolume
  isolume bake brain.nii.gz --isovalues 90 --auto 2m -o brain.isolume
  isolume bake brain.nii.gz --chunks 1/2 -o one.isolume    (see merge)
  isolume bake brain.nii.gz --replay-texel 90,120,80")]
pub(in crate::cli) struct Bake {
    /// Volume file, a field such as bumpbox or gyroid:128, an implicit model or a scene (.toml)
    #[arg(value_name = "VOLUME|SCENE")]
    input: String,
    /// The store to make or to go on with, such as brain.isolume
    #[arg(short, long, value_name = "X.isolume", required_unless_present = "replay_texel")]
    output: Option<PathBuf>,
    #[command(flatten)]
    bake: BakeArgs,
    /// Choose the standard error such that the command takes this long, such as 90s or 1h30m
    #[arg(long, value_name = "TIME", value_parser = parse_time, conflicts_with = "chunks")]
    time: Option<Duration>,
    /// Measure --error, --time, --auto and the 2 % that are aimed at without them by the radiance under this environment, over its mean: the image file or name
    /// that relight takes
    #[arg(long, value_name = "PROBE")]
    for_env: Option<String>,
    /// Bake what this environment does, whole and without limit of bands, as a luminaire named environment: three numbers a layer
    /// in the place of spherical harmonics. Relight scales it (--luminaire environment=0.5) and adds any other --env, of which
    /// one band is kept unless --bands says more
    #[arg(long, value_name = "PROBE", conflicts_with_all = ["for_env", "auto"])]
    fixed_env: Option<String>,
    /// Turn that environment counter-clockwise about up, in degrees
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_hyphen_values = true)]
    env_rotate: f64,
    /// Where the centre of that environment lies in glTF: at +X (Blender, three.js), or at +Z (OpenEXR)
    #[arg(long, value_enum, value_name = "FRAME", default_value = "gltf")]
    env_frame: EnvFrame,
    /// Albedo under that environment
    #[arg(long, value_name = "RHO", default_value_t = 0.7, requires = "for_env")]
    albedo: f32,
    /// Choose texture and rays, up to 4096, by a pilot, so that the bake is as exact as this time allows; see plan --time. Of
    /// isovalues that are named without --texture the same as --time
    #[arg(long, value_name = "TIME", value_parser = parse_time,
        conflicts_with_all = ["time", "error", "rays", "texture", "chunks", "replay_texel"])]
    auto: Option<Duration>,
    /// Bake only share i of n: chunks, or octants of them, dealt by their texels, largest first to the share with the least so far; what a
    /// share holds follows from the other options alone. Several processes may fill one store so, or each its own for merge; see also
    /// isolume cluster
    #[arg(long, value_name = "I/N")]
    chunks: Option<Share>,
    #[command(flatten)]
    volume: VolumeArgs,
    /// Make an empty store, instead of an error, of a volume without any surface
    #[arg(long)]
    allow_empty: bool,
    /// Replace a store that is there, once the new one is complete; other files in its folder stay
    #[arg(long)]
    force: bool,
    /// Do not wait until the disk has what is written: faster on slow disks, but a power cut may tear chunks
    #[arg(long)]
    no_sync: bool,
    /// Keep a copy of the volume in the store, or where the samples lie in its file, which must then stay as it is
    #[arg(long, value_name = "HOW", value_parser = ["copy", "reference"], default_value = "copy")]
    store_volume: String,
    /// Write damaged metadata anew even if nothing else in the store proves that it is this command's
    #[arg(long)]
    repair: bool,
    /// Pack the store when it is baked, with an error such as 0.5%, or auto for half of the noise (see pack); none keeps it as it is. What is
    /// packed is not baked into any more [default: none; auto of an adaptive texture, which saves no space before it is packed]
    #[arg(long, value_name = "E", value_parser = parse_compress, conflicts_with_all = ["chunks", "replay_texel"])]
    compress: Option<Compress>,
    /// Trace one texel alone, print its paths, and bake nothing
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_texel)]
    replay_texel: Option<[usize; 3]>,
    #[arg(skip)]
    pub(in crate::cli) scene: Option<SceneFile>,
}

/// Whether a bake is packed.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Compress(Option<PackError>);

fn parse_compress(word: &str) -> Result<Compress, String> {
    if word == "none" { Ok(Compress(None)) } else { word.parse().map(|e| Compress(Some(e))) }
}

impl Bake {
    pub(in crate::cli) fn run(&self, seed: u64, console: &Console) -> Outcome {
        let start = Instant::now();
        if let (Some(path), None) = (&self.output, self.replay_texel) {
            kind::check_output(path)?;
        }
        let mut scene = self.open()?;
        let members = scene.members().len();
        let mut quality = self.quality(seed);
        if let (Some(time), None, false) = (self.auto, self.replay_texel, self.bakes_surfaces())
            && let Some((texture, rays)) = self.choose_texture(&mut scene, time, start, seed, console)?
        {
            (quality.texture, quality.rays) = (Some(texture), Some(rays));
        }
        let replacement = match &self.output {
            Some(path) if self.force && self.replay_texel.is_none() && path.symlink_metadata().is_ok() => {
                kind::check_replaceable(path)?;
                Some(Replacement::begin(path)?)
            }
            _ => None,
        };
        let target = replacement.as_ref().map(Replacement::path).or_else(|| self.output.clone());
        let mut reports = Vec::new();
        for member in 0..members {
            match self.run_member(&mut scene, member, &quality, target.as_deref(), start, console) {
                Ok(report) => reports.extend(report),
                Err(failure) if replacement.is_some() => {
                    let text = format!("{failure}\nthe old store is as it was: --force replaces it by a complete one");
                    return Err(Failure::Message(text));
                }
                Err(failure) => return Err(failure),
            }
        }
        if let Some(replacement) = replacement {
            replacement.commit()?;
        }
        if let (Compress(Some(error)), Some(path)) = (self.compress(), &self.output)
            && let Some((packed, sizes)) = StoreOptions::default().sync(!self.no_sync).pack_in_place(path, error)?
        {
            console.summary(text::file_line(path, &pack::summary(&packed, sizes)));
            let about = packed.to_json(&file_name(&path.display().to_string()), sizes);
            reports.iter_mut().for_each(|report| report["packed"] = about.clone());
        }
        if let (1, Some(json)) = (members, reports.first()) {
            console.print_json(json);
        } else if !reports.is_empty() {
            console.print_json(&json!({ "store": reports[0]["store"], "volumes": reports }));
        }
        Ok(())
    }

    /// Whether it is surfaces that are baked.
    fn bakes_surfaces(&self) -> bool {
        let is_path = self.bake.estimator == Estimator::Path;
        !self.bake.isovalues.is_empty() && self.bake.transfer.texture.is_none() && is_path
    }

    /// Whether and how the store is packed.
    fn compress(&self) -> Compress {
        let is_adaptive = matches!(self.bake.transfer.texture, Some(TextureSize::Adaptive { .. }));
        let usual = if is_adaptive && self.chunks.is_none() { Some(PackError::HalfOfNoise) } else { None };
        self.compress.unwrap_or(Compress(usual))
    }

    /// The time that vertices or texels stop by; there is no texture to choose for surfaces.
    fn time(&self) -> Option<Duration> {
        self.time.or(self.auto.filter(|_| self.bakes_surfaces()))
    }

    /// Opens what is to be baked.
    fn open(&self) -> Outcome<Scene> {
        let mut options = self.bake.transfer.scene(&self.volume);
        options.volume.by_reference = self.store_volume == "reference";
        let mut scene = options.open(&self.input, self.scene.as_ref())?;
        match &self.fixed_env {
            Some(name) => {
                let probe = open_probe(name, false, None)?;
                scene.fix_environment(&probe, self.env_rotate, self.env_frame)?;
            }
            None if self.env_rotate != 0.0 && self.for_env.is_none() => {
                let (given, expected) = (self.env_rotate, "an environment to turn");
                return Err(Error::argument("--env-rotate", given, expected, "add --for-env or --fixed-env").into());
            }
            None => {}
        }
        Ok(scene)
    }

    /// How well transfer is baked; of one band where the environment is fixed and nobody says more.
    fn quality(&self, seed: u64) -> Quality {
        let mut quality = self.bake.quality(seed);
        if self.fixed_env.is_some() && quality.bands.is_empty() {
            quality.bands = vec![1];
        }
        quality.seconds = self.time().map(|t| t.as_secs_f64());
        quality
    }

    /// Bakes one volume of a scene; what is to be told of it, if it was baked.
    fn run_member(
        &self,
        scene: &mut Scene,
        member: usize,
        quality: &Quality,
        target: Option<&Path>,
        start: Instant,
        console: &Console,
    ) -> Outcome<Option<Value>> {
        let opened = &mut scene.members_mut()[member];
        let scene = self.scene.as_ref();
        let is_empty = !opened.volume.check_surface(self.allow_empty)?;
        // Before anything else: they decide the side that is matter.
        let chosen = if is_empty { None } else { opened.settle_in(&self.bake.isovalues, scene)? };
        let volume = &*opened.volume;
        volume.notes.iter().for_each(|note| console.note(&note.text));
        let layers = quality.layout(volume, opened.geometry.as_ref())?.layers;
        let lights: Vec<ForLight> = self.light(volume, &layers)?.into_iter().collect();
        if let Some(texel) = self.replay_texel {
            return replay::run(&quality.request(opened, None, lights)?, texel, console).map(|()| None);
        }
        if is_empty {
            console.note("every sample is the same: no surface, the store is empty");
        }
        chosen.iter().flatten().flat_map(Chosen::notes).for_each(|text| console.note(text));
        let isovalues: Option<Vec<f64>> = chosen.map(|list| list.iter().map(|c| c.value).collect());
        let mut job = quality.request(opened, isovalues, lights)?;
        job.hints = Hints::of_scene(scene, volume.value_range(), job.isovalues.as_deref());
        job.hints.shown = console.is_verbose();
        job.share = self.chunks;
        job.writing = Writing { sync: !self.no_sync, repair: self.repair, ..Writing::default() };
        let (Some(path), Some(target)) = (&self.output, target) else {
            return Err(Failure::Message("the output is missing: give -o X.isolume".into()));
        };
        let (store, report) = fill(&job, target, start, console)?;
        let bytes = size_on_disk(target);
        console.summary(text::file_line(path, &baked::summary_line(&report, bytes)));
        console.detail(baked::lines(&report, bytes));
        Ok(Some(json!({
            "store": file_name(&path.display().to_string()),
            "identity": store.identity(),
            "bake": report.to_json(bytes),
        })))
    }
}

impl Bake {
    /// About the bytes that it needs on so many threads, of the volume that needs the most.
    ///
    /// # Errors
    /// When the volume or scene cannot be opened, or what is asked of it makes no sense.
    pub(in crate::cli) fn bytes_needed(&self, seed: u64, threads: usize) -> Outcome<u64> {
        let (mut scene, quality) = (self.open()?, self.quality(seed));
        let mut most = 0;
        for opened in scene.members_mut() {
            let is_empty = !opened.volume.check_surface(self.allow_empty)?;
            let chosen = if is_empty { None } else { opened.settle_in(&self.bake.isovalues, self.scene.as_ref())? };
            let isovalues = chosen.map(|list| list.iter().map(|c| c.value).collect());
            let job = quality.request(opened, isovalues, Vec::new())?;
            job.check()?;
            most = most.max(job.bytes_needed_by(threads));
        }
        Ok(most)
    }

    /// The texture and the rays that a time allows, the same for all volumes of a scene; `None` where there is no
    /// surface.
    fn choose_texture(
        &self,
        scene: &mut Scene,
        time: Duration,
        start: Instant,
        seed: u64,
        console: &Console,
    ) -> Outcome<Option<(TextureSize, u32)>> {
        forecasts::check("--auto", self.bake.estimator)?;
        let file = self.scene.as_ref();
        let mut isovalues = Vec::new();
        for member in scene.members_mut() {
            if !member.volume.check_surface(self.allow_empty)? {
                return Ok(None);
            }
            let chosen = member.settle_in(&self.bake.isovalues, file)?;
            isovalues.push(chosen.map(|list| list.iter().map(|c| c.value).collect::<Vec<f64>>()));
        }
        let Some(first) = scene.members().first() else { return Ok(None) };
        let (probe, turned) = environment(self.for_env.as_deref(), file)?;
        let turned = if self.for_env.is_some() { self.env_rotate } else { turned };
        let orientation = Orientation::new(first.volume.up, turned)?.in_frame(self.env_frame);
        let (isovalue, all) = forecasts::weigh(
            &forecasts::Asked {
                members: scene.members(),
                isovalues: &isovalues,
                quality: &self.quality(seed),
                probe: &probe,
                orientation,
                albedo: self.albedo,
            },
            &clock(),
        )?;
        let threads = rayon::current_num_threads() as f64;
        let left = (RESERVED * time.as_secs_f64() - start.elapsed().as_secs_f64()).max(0.0);
        let Some((weighed, found)) = best_within(&all, left * threads) else {
            let message = format!(
                "not enough time for the least that makes sense: the pilot alone took {} of {}; give more --auto, or \
                 choose --isovalues",
                text::duration(start.elapsed()),
                text::duration(time)
            );
            return Err(Failure::Message(message));
        };
        console.note(format!(
            "--texture {} --rays {}{}: about {}, error {} of the radiance of isovalue {} under {} (in the bands of the texture)",
            weighed.ratio,
            found.rays,
            if found.rays == ENOUGH { " (a reference; more only by --rays)" } else { "" },
            text::duration(Duration::from_secs_f64(found.seconds / threads)),
            text::percent(found.error),
            text::number(isovalue, 6),
            probe.name
        ));
        Ok(Some((TextureSize::Ratio(weighed.ratio), found.rays)))
    }

    /// The environment that errors are measured by.
    fn light(&self, volume: &Volume, layers: &Layers) -> Outcome<Option<ForLight>> {
        let Some(name) = &self.for_env else { return Ok(None) };
        if self.auto.is_some() && !self.bakes_surfaces() {
            return Ok(None);
        }
        if self.bake.transfer.rays.is_some() && self.bake.transfer.error.is_none() && self.time().is_none() {
            return Err(Error::argument(
                "--for-env",
                format!("{name} beside --rays and without a target"),
                "--error, --time or --auto beside it, or no --rays",
                "add --error 2%: the standard error of the radiance under this environment, over its mean",
            )
            .into());
        }
        Material::new([self.albedo; 3], [0.0; 3])?;
        let probe = open_probe(name, false, None)?;
        let bands = layers.max_bands();
        Ok(Some(for_light(&probe, (volume.up, self.env_rotate, self.env_frame), bands, self.albedo)?))
    }
}

/// Part of the time of `--auto` that the bake itself may take; the rest is for writing.
const RESERVED: f64 = 0.9;
