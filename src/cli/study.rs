//! `isolume study`: what accuracy costs in time on the user's own volume, measured.

mod placements;
mod report;
mod thesis;

use super::console::Console;
use super::forecast;
use super::input::VolumeArgs;
use super::isovalue::Isovalue;
use super::light::parse_triple;
use super::options::{check_memory, parse_bytes};
use super::{Outcome, output, scene, text};
use crate::bake::{Estimator, bytes_of_scene_texel};
use crate::compare::{LitSurface, Vertices, unburied};
use crate::error::Error;
use crate::export::atomic;
use crate::level::Pyramid;
use crate::probe::Orientation;
use crate::sampling::statistics::Running;
use crate::scene::geometry::Geometry;
use crate::scene::{Effects, Member, Scene, SceneFile};
use crate::session::Isosurface;
use crate::study::figure::{Caption, Kept, Mark, on_front, svg};
use crate::study::forecast::{POINTS, Question, RATIOS, pilots};
use crate::study::{Measured, References, Setting, Study as Bench};
use crate::transfer::precision::bytes_of_texel;
use crate::transfer::texels_of_isosurface;
use crate::transfer::{BRICK_TEXELS, Lattice, Layers, Precision, Steps};
use crate::transport::{Summary, needs_photons};
use crate::volume::Volume;
use report::{csv, forecast_json, forecasts, iso_json, iso_table, kept_json, kept_table, row_json, table};
use serde_json::json;
use std::io::Write as _;
use std::path::PathBuf;

/// Show what accuracy costs in time: bake one surface in many ways and compare each with
/// path tracing
///
/// The texels of one isosurface are baked with more and more rays, with fewer bands and layers, on coarser textures and
/// with other estimators. Each is timed and compared, at random vertices, with unbiased paths under the same
/// environment. Writes study.csv, study.json and the figure study.svg.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume study brain.nii.gz --isovalue 90 --env courtyard -o brain-study
  isolume study bumpbox:64 --quick
  isolume study placements examples/scenes/box.toml --isovalue 47")]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(super) struct Study {
    #[command(subcommand)]
    other: Option<OtherStudy>,
    /// Volume file, field or scene (.toml)
    #[arg(value_name = "VOLUME|SCENE", required = true)]
    input: Option<String>,
    /// Isovalue: a number in the file's values, a percentage of their range, or auto; of a scene of several volumes
    /// that of the first
    #[arg(
        short,
        long,
        visible_alias = "isovalues",
        value_name = "C",
        default_value = "auto",
        allow_hyphen_values = true
    )]
    isovalue: Isovalue,
    /// Environment: an image file or a name, as relight takes it [default: the scene's, else courtyard]
    #[arg(short, long, value_name = "PROBE")]
    env: Option<String>,
    /// Diffuse reflectance, one number or r,g,b [default: the scene's, else 0.7]
    #[arg(long, value_name = "RHO|R,G,B", value_parser = parse_triple, allow_hyphen_values = true)]
    albedo: Option<super::light::Triple>,
    /// The volume to study, of a scene of several [default: the first]
    #[arg(long = "volume", value_name = "NAME")]
    of_volume: Option<String>,
    /// Random vertices at which light is compared
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    points: u32,
    /// Paths of the reference at each of them, a power of two
    #[arg(long, value_name = "N", default_value = "4096", value_parser = super::options::parse_rays)]
    paths: u32,
    /// Paths for each exact texel of the budget, a power of two
    #[arg(long, value_name = "N", default_value = "4096", value_parser = super::options::parse_rays)]
    texel_rays: u32,
    /// Most rays a texel that are tried
    #[arg(long, value_name = "N", default_value = "1024", value_parser = super::options::parse_rays)]
    most_rays: u32,
    /// A coarser reference and fewer bakes: a picture in a fraction of the time
    #[arg(long)]
    quick: bool,
    /// Refuse to use more memory than this
    #[arg(long, value_name = "SIZE", value_parser = parse_bytes)]
    memory_limit: Option<u64>,
    /// Folder for study.csv, study.json and study.svg [default: NAME-study]
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten, next_help_heading = "Volume")]
    volume: VolumeArgs,
}

/// Studies of other questions.
#[derive(clap::Subcommand)]
enum OtherStudy {
    Placements(Box<placements::PlacementsArgs>),
    Thesis(thesis::ThesisArgs),
}

/// Bands of the layers that every sweep but that of bands has.
const BANDS: [usize; 4] = [5, 4, 3, 3];
/// The sweep of bands.
const SAME_BANDS: &str = "path, same bands in all";
/// The sweep of storage.
const KEPT: &str = "path, kept as";
/// Ways of keeping coefficients that are tried.
const KEPT_AS: [Precision; 4] =
    [Precision::Single, Precision::Half, Precision::Steps(Steps::TWELVE), Precision::Steps(Steps::BYTE)];
/// Fewest rays that are tried.
const LEAST_RAYS: u32 = 16;
/// Layers of the exact texels.
const MOST_LAYERS: usize = 6;
/// Bakes of the same setting, by which the noise of the clock is told.
const REPEATS: usize = 3;

/// One bake and what was found.
struct Row {
    setting: Setting,
    curve: String,
    label: String,
    wall: f64,
    cpu: f64,
    rays: u64,
    texels: u64,
    bytes: u64,
    measured: Measured,
}

impl Study {
    pub(super) fn run(&self, seed: u64, console: &Console) -> Outcome {
        match &self.other {
            Some(OtherStudy::Placements(other)) => return other.run(seed, console),
            Some(OtherStudy::Thesis(other)) => return other.run(seed, console),
            None => {}
        }
        let mut scene = self.open()?;
        let file = scene.description().cloned();
        let member = self.member(scene.members())?;
        let opened = &mut scene.members_mut()[member];
        let chosen = opened.choose(self.isovalue(file.as_ref())?)?;
        opened.take_side(std::slice::from_ref(&chosen))?;
        let (volume, geometry) = (&*opened.volume, opened.geometry.as_ref());
        for note in &volume.notes {
            console.note(&note.text);
        }
        let folder = output::result_folder(self.output.as_deref(), format!("{}-study", volume.name), "study.csv")?;
        volume.check_cells()?;
        let (probe, turned) = forecast::environment(self.env.as_deref(), file.as_ref())?;
        let orientation = Orientation::new(volume.up, turned)?;
        let pyramid = Pyramid::new(volume);
        let settings = self.settings(geometry.is_some())?;
        self.check_memory(volume, geometry, chosen.value, &settings)?;
        let (source, most) = (probe.source(orientation), most_bands(&settings));
        let coefficients = probe.coefficients_in_world(most, orientation);
        let surface = Isosurface::extract(volume, &pyramid, chosen.value)?;
        let points = surface.random_points(if self.quick { self.points.min(400) } else { self.points }, seed);
        let points = unburied(volume, &pyramid, geometry, chosen.value, points);
        let rule = file.as_ref().and_then(|f| f.description.albedo.as_ref()).map(|a| a.rule(volume.value_range()));
        let of_scene = rule.map_or([0.7; 3], |rule| rule.albedo(chosen.value));
        let emission = file.as_ref().and_then(|f| f.description.emission.as_ref());
        let vertices = Vertices::new(chosen.value, surface.mesh().clone());
        let lit = LitSurface {
            volume,
            pyramid: &pyramid,
            geometry,
            caustics: geometry.is_none_or(|geometry| needs_photons(geometry).is_empty()),
            specular: None,
            isovalue: chosen.value,
            points: &points,
            light: &source,
            coefficients: &coefficients,
            albedo: self.albedo.map_or(of_scene, |albedo| albedo.0),
            emission: emission.map_or([0.0; 3], |rule| rule.at(chosen.value)),
            scales: &[],
            vertices: Some(&vertices),
        };
        let bench = Bench {
            surface: lit,
            paths: if self.quick { self.paths.min(1024) } else { self.paths },
            texel_rays: if self.quick { self.texel_rays.min(1024) } else { self.texel_rays },
            layers: MOST_LAYERS,
            seed,
        };
        let clock = forecast::clock();
        let references = self.references(&bench, &settings)?;
        let reference_seconds = clock();
        let spread = clock_noise(&bench, seed)?;
        let bands = Layers::new(BANDS.to_vec())?;
        let layers = if geometry.is_some() { bands.coloured() } else { bands };
        let of_pilot = probe.coefficients_in_world(layers.max_bands(), orientation);
        let few = &points[..points.len().min(POINTS as usize)];
        let question =
            Question { surface: LitSurface { points: few, coefficients: &of_pilot, ..lit }, layers: &layers, seed };
        let selected = |lattice| texels_of_isosurface(volume, lattice, chosen.value);
        let pilots = pilots(&question, &RATIOS, &selected, &clock)?;
        let kept_of = self.middle_rays();
        let (mut rows, mut kept_rows) = (Vec::new(), Vec::new());
        for (curve, label, setting) in settings {
            console.note(format!("{curve}, {label}"));
            let keeps = curve == "path" && setting.rays == kept_of;
            let (row, kept) = measure(&bench, &references, curve, label, setting, seed, keeps)?;
            rows.push(row);
            kept_rows.extend(kept);
        }
        // Light of other bands is another reference: that sweep, the last one, is not drawn beside the others.
        let marks: Vec<Mark> = rows.iter().filter(|row| row.curve != SAME_BANDS).map(mark).collect();
        let kept: Vec<Kept> = kept_rows.iter().map(kept).collect();
        let front = on_front(&marks);
        rows.extend(kept_rows);
        let caption = Caption {
            title: format!(
                "{}, isovalue {}, under {}: what accuracy costs",
                volume.name,
                text::number(chosen.value, 6),
                probe.name
            ),
            notes: notes(&bench, &references, rows.first().map_or(0, |r| r.texels), spread),
            truncation: references.truncation(),
            kept,
        };
        let csv = csv(&rows);
        std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, "make the folder", e))?;
        let whole = json!({
            "volume": volume.name, "isovalue": chosen.value, "environment": probe.name, "albedo": lit.albedo,
            "points": points.len(), "paths": bench.paths, "texel_rays": bench.texel_rays, "seed": seed,
            "threads": rayon::current_num_threads(),
            "reference": { "rays": references.rays, "noise": references.noise(), "wall_seconds": reference_seconds[0],
                "cpu_seconds": reference_seconds[1],
                "truncation": references.truncation().iter().map(|(b, e)| json!({ "bands": b, "rms": e })).collect::<Vec<_>>() },
            "clock_noise": { "wall": spread[0], "cpu": spread[1], "bakes": REPEATS },
            "rows": rows.iter().map(row_json).collect::<Vec<_>>(),
            "forecasts": rows.iter().filter_map(|r| forecast_json(r, &pilots)).collect::<Vec<_>>(),
            "front": front, "kept": kept_json(&caption.kept), "seconds_to_error": iso_json(&marks),
        });
        for (name, bytes) in [
            ("study.csv", csv.into_bytes()),
            ("study.json", format!("{whole:#}\n").into_bytes()),
            ("study.svg", svg(&marks, &caption).into_bytes()),
        ] {
            let path = folder.join(name);
            atomic::write(&path, |w| w.write_all(&bytes).map_err(|e| Error::io(&path, "write", e)))?;
        }
        console.print(table(&rows, &front));
        console.print(format!(
            "\nforecast of the pilot of `isolume plan`, against what was measured\n{}",
            forecasts(&rows, &pilots)
        ));
        console.print(format!("\nseconds of processor time to the same error\n{}", iso_table(&marks)));
        console.print(format!("\nfewer bits, of the bake with {kept_of} rays\n{}", kept_table(&caption.kept)));
        console.print(format!(
            "\nwritten to {}: study.csv, study.json, study.svg; reference: {} rays, noise {}, {:.1} s",
            folder.display(),
            text::metric(references.rays as f64),
            text::percent(references.noise()),
            reference_seconds[0]
        ));
        console.print_json(&whole);
        Ok(())
    }

    /// Every number of rays that is tried.
    fn ladder(&self) -> Vec<u32> {
        (0..16).map(|k| LEAST_RAYS << k).filter(|&n| n <= self.most_rays).collect()
    }

    /// The number of rays at which layers, bands and storage are varied.
    fn middle_rays(&self) -> u32 {
        let ladder = self.ladder();
        ladder.get(ladder.len() * 2 / 3).copied().unwrap_or(LEAST_RAYS)
    }

    /// Opens what is studied; what a scene says of its volume counts where no option does.
    fn open(&self) -> Outcome<Scene> {
        let input = self.input.as_deref().unwrap_or_default();
        let mut options = self.volume.options();
        if !input.to_ascii_lowercase().ends_with(".toml") {
            return Ok(Scene::open_with(input, &options, &Effects::default())?);
        }
        let file = SceneFile::read(input)?;
        options.solid = options.solid.or(file.description.solid);
        options.up = options.up.or(file.description.up);
        Ok(file.open(&options, &Effects::default())?)
    }

    /// The isovalue asked for, else the first of the scene.
    fn isovalue(&self, file: Option<&SceneFile>) -> Result<Isovalue, Error> {
        let of_scene = file.filter(|_| self.isovalue == Isovalue::Auto).and_then(scene::listed_isovalues);
        let first = of_scene.as_deref().and_then(|list| list.split(',').next());
        first.map_or(Ok(self.isovalue), str::parse)
    }

    /// The number of the volume that is meant.
    fn member(&self, members: &[Member]) -> Result<usize, Error> {
        let Some(name) = &self.of_volume else { return Ok(0) };
        let names: Vec<&str> = members.iter().map(|m| m.volume.name.as_str()).collect();
        names.iter().position(|n| n == name).ok_or_else(|| {
            let remedy = text::nearest(name, names.iter().copied())
                .map_or("see the [[volumes]] of the scene".into(), |near| format!("did you mean {near}?"));
            Error::argument("--volume", name, format!("one of {}", names.join(", ")), remedy)
        })
    }

    /// Curve, label and setting of every bake; in a scene by `path` alone.
    fn settings(&self, is_scene: bool) -> Outcome<Vec<(String, String, Setting)>> {
        if self.most_rays < LEAST_RAYS {
            let expected = format!("at least {LEAST_RAYS}, where every sweep begins");
            let remedy = "1024 is the default; --quick makes a study short";
            return Err(Error::argument("--most-rays", self.most_rays, expected, remedy).into());
        }
        let ladder = self.ladder();
        let every = |n: usize| -> Vec<u32> { ladder.iter().copied().step_by(n).collect() };
        use Estimator::{Gather, Path, Photon};
        let setting = |estimator, rays, bands: &[usize], ratio| Setting {
            estimator,
            rays,
            bands: bands.to_vec(),
            ratio: Some(ratio),
            kept_as: Precision::Half,
        };
        let mut all = Vec::new();
        let mut add = |curve: &str, label: String, setting| all.push((curve.to_string(), label, setting));
        for &n in &ladder {
            add("path, at vertices", format!("{n}"), Setting { ratio: None, ..setting(Path, n, &BANDS, 1.0) });
        }
        for &n in &ladder {
            add("path", format!("{n}"), setting(Path, n, &BANDS, 1.0));
        }
        for n in every(2).into_iter().filter(|_| !is_scene) {
            add("gather", format!("{n}"), setting(Gather, n, &BANDS, 1.0));
        }
        for n in every(2) {
            add("path, texture ½", format!("{n}"), setting(Path, n, &BANDS, 0.5));
        }
        if self.quick {
            return Ok(all);
        }
        for n in every(2).into_iter().filter(|n| !is_scene && (64..=256).contains(n)) {
            add("photon", format!("{n}"), setting(Photon, n, &BANDS, 1.0));
        }
        for n in every(2) {
            add("path, texture 2", format!("{n}"), setting(Path, n, &BANDS, 2.0));
        }
        for n in every(2) {
            add("path, texture ¼", format!("{n}"), setting(Path, n, &BANDS, 0.25));
        }
        let middle = self.middle_rays();
        for layers in 1..BANDS.len() {
            add(
                "path, fewer layers",
                format!("{layers} layer{}", if layers == 1 { "" } else { "s" }),
                setting(Path, middle, &BANDS[..layers], 1.0),
            );
        }
        for bands in [2, 3, 4, 5, 7] {
            let bands = [bands; BANDS.len()];
            add(SAME_BANDS, format!("{}", bands[0]), setting(Path, middle, &bands, 1.0));
        }
        Ok(all)
    }

    fn references(&self, bench: &Bench<'_>, settings: &[(String, String, Setting)]) -> Outcome<References> {
        let mut bands: Vec<usize> = settings.iter().map(|s| s.2.bands[0]).collect();
        bands.sort_unstable();
        bands.dedup();
        let mut lattices: Vec<Lattice> = Vec::new();
        for (_, _, setting) in settings {
            let lattice = setting.lattice(&bench.surface)?;
            if lattices.iter().all(|l| l.texels() != lattice.texels()) {
                lattices.push(lattice);
            }
        }
        Ok(bench.references(&bands, &lattices)?)
    }

    /// The textures of the largest setting must fit.
    fn check_memory(
        &self,
        volume: &Volume,
        geometry: Option<&Geometry>,
        isovalue: f64,
        all: &[(String, String, Setting)],
    ) -> Outcome {
        let largest_ratio = all.iter().filter_map(|(_, _, setting)| setting.ratio).fold(1.0, f64::max);
        let lattice = Lattice::from_ratio(volume.dims(), largest_ratio)?;
        let bricks = texels_of_isosurface(volume, lattice, isovalue).bricks().len() as u64;
        let largest = most_bytes(all, geometry)?;
        // Two textures at once, and the cache of `gather`.
        let needed = volume.samples().bytes().len() as u64 / 4 * 5 + 3 * bricks * BRICK_TEXELS as u64 * largest;
        Ok(check_memory("the textures of the study", needed, self.memory_limit)?)
    }
}

/// Most stored bytes that any setting needs for a texel.
fn most_bytes(all: &[(String, String, Setting)], geometry: Option<&Geometry>) -> Outcome<u64> {
    let channels = |layers: Layers| if geometry.is_some() { layers.coloured() } else { layers };
    let layers = all.iter().map(|(_, _, s)| Ok(channels(Layers::new(s.bands.clone())?)));
    let layers = layers.collect::<Result<Vec<_>, Error>>()?;
    Ok(layers.iter().map(|layers| bytes_of_scene_texel(layers, geometry)).max().unwrap_or(0))
}

/// Most bands that any setting has.
fn most_bands(settings: &[(String, String, Setting)]) -> usize {
    settings.iter().flat_map(|s| &s.2.bands).copied().max().unwrap_or(1)
}

/// Bakes and measures; with `keeps` also what keeping the same coefficients in more or fewer bits does.
fn measure(
    bench: &Bench<'_>,
    references: &References,
    curve: String,
    label: String,
    setting: Setting,
    seed: u64,
    keeps: bool,
) -> Outcome<(Row, Vec<Row>)> {
    let clock = forecast::clock();
    let baked = bench.bake(&setting, seed, &clock)?;
    let (textures, settings) = (baked.textures.sources(), &baked.settings);
    let (rays, texels) = (rays_of(&baked.summary), baked.summary.valid);
    let [wall, cpu] = baked.seconds;
    let is_path = setting.estimator == Estimator::Path;
    let second = if is_path { None } else { Some(bench.bake(&setting, seed ^ 1, &clock)?) };
    let second = second.as_ref().map(|second| second.textures.sources());
    let measured = bench.measure(references, &textures, is_path.then_some(settings), second.as_deref())?;
    let row = |curve, label, kept_as, measured| {
        let bytes = (texels as f64 * bytes_of_texel(&settings.layers, kept_as)) as u64;
        Row { setting: Setting { kept_as, ..setting.clone() }, curve, label, wall, cpu, rays, texels, bytes, measured }
    };
    let mut kept = Vec::new();
    if keeps {
        let found = bench.measure_kept_as(references, &textures, settings, &KEPT_AS)?;
        kept.extend(KEPT_AS.into_iter().zip(found).map(|(kind, found)| row(KEPT.into(), kind.name(), kind, found)));
    }
    Ok((row(curve, label, Precision::Half, measured), kept))
}

/// Rays of a bake: within the level set of a volume alone, or through all that a scene has.
fn rays_of(summary: &Summary) -> u64 {
    let in_scene = summary.scene.path_rays + summary.scene.light_rays;
    if in_scene > 0 { in_scene } else { summary.counts.rays }
}

/// A row of the sweep of storage for the figure.
fn kept(row: &Row) -> Kept {
    Kept {
        name: row.label.clone(),
        bytes_of_texel: row.bytes as f64 / row.texels.max(1) as f64,
        rounding: row.measured.row("rounding").max(0.0).sqrt(),
        error: row.measured.band_limited.relative_rms_without_noise,
    }
}

/// Spread of repeated bakes, over their mean: wall-clock time and processor time.
fn clock_noise(bench: &Bench<'_>, seed: u64) -> Outcome<[f64; 2]> {
    let setting = Setting {
        estimator: Estimator::Path,
        rays: 16,
        bands: BANDS.to_vec(),
        ratio: Some(1.0),
        kept_as: Precision::Half,
    };
    // The first one warms caches.
    let clock = forecast::clock();
    bench.bake(&setting, seed, &clock)?;
    let (mut wall, mut cpu) = (Running::default(), Running::default());
    for _ in 0..REPEATS {
        let seconds = bench.bake(&setting, seed, &clock)?.seconds;
        wall.push(seconds[0]);
        cpu.push(seconds[1]);
    }
    Ok([wall, cpu].map(|r| r.variance().sqrt() / r.mean().max(f64::MIN_POSITIVE)))
}

/// What a reader of the figure must know.
fn notes(bench: &Bench<'_>, references: &References, texels: u64, spread: [f64; 2]) -> Vec<String> {
    let (points, [r, g, b]) = (text::count(bench.surface.points.len() as u64), bench.surface.albedo);
    let albedo = if r == g && g == b { r.to_string() } else { format!("{r}, {g}, {b}") };
    vec![
        format!(
            "Reference: unbiased path tracing at {points} random vertices, {} paths each, under the same light cut to the same bands;",
            bench.paths
        ),
        format!(
            "its own noise, {}, is taken out. Vertical bars: 95 % intervals. Dashed: what cutting the light to bands costs besides.",
            text::percent(references.noise())
        ),
        "path: path tracing within the level set. gather: the texture as a cache of light. photon: photon mapping.".into(),
        "Numbers at the dots: rays a texel, or layers (one: direct light alone; each more: one bounce). Grey: what no other dot beats."
            .into(),
        "texture ½, ¼: so many texels to a sample of the volume along each axis, else 1.".into(),
        format!("Layers of {} bands, albedo {albedo}, unless a curve says otherwise.", BANDS.map(|b| b.to_string()).join(", ")),
        format!(
            "Processor seconds: {} threads together, for {} texels at texture 1. Repeated bakes differed by {}",
            rayon::current_num_threads(),
            text::count(texels),
            text::percent(spread[1]),
        ),
        format!(
            "(wall clock: {}). Bits: f16 is what stores hold, 8 bits with a scale to each coefficient the page in one file.",
            text::percent(spread[0])
        ),
    ]
}

fn mark(row: &Row) -> Mark {
    let (curve, label) = (row.curve.clone(), row.label.clone());
    Mark { curve, label, seconds: row.cpu, measured: row.measured.clone() }
}
