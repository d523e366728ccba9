//! `isolume study`: what accuracy costs in time on the user's own volume, measured.

mod placements;
mod report;

use super::console::Console;
use super::forecast;
use super::input::VolumeArgs;
use super::isovalue::Isovalue;
use super::light::{open_probe, parse_triple};
use super::options::{check_memory, parse_bytes};
use super::{Outcome, output, text};
use crate::error::Error;
use crate::export::atomic;
use crate::level::Pyramid;
use crate::probe::Orientation;
use crate::sampling::statistics::Running;
use crate::session::Isosurface;
use crate::study::figure::{Caption, Kept, Mark, on_front, svg};
use crate::study::{Measured, References, Setting, Study as Bench};
use crate::transfer::precision::bytes_of_texel;
use crate::transfer::texels_of_isosurface;
use crate::transfer::{BRICK_TEXELS, Lattice, Layers, Layout, MemoryTexture, Precision, Steps};
use crate::transport::{Bake, ChunkBricks, GatherSettings, PhotonBake, Progress, Settings, bake, gather, photon_bake};
use crate::volume::Volume;
use cpu_time::ProcessTime;
use report::{csv, forecast_json, forecasts, iso_json, iso_table, kept_json, kept_table, row_json, table};
use serde_json::json;
use std::io::Write as _;
use std::path::PathBuf;
use std::time::Instant;

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
    /// Volume file or field
    #[arg(value_name = "VOLUME", required = true)]
    input: Option<String>,
    /// Isovalue: a number in the file's values, a percentage of their range, or auto
    #[arg(
        short,
        long,
        visible_alias = "isovalues",
        value_name = "C",
        default_value = "auto",
        allow_hyphen_values = true
    )]
    isovalue: Isovalue,
    /// Environment: an image file or a name, as relight takes it
    #[arg(short, long, value_name = "PROBE", default_value = "courtyard")]
    env: String,
    /// Diffuse reflectance, one number or r,g,b
    #[arg(long, value_name = "RHO|R,G,B", default_value = "0.7", value_parser = parse_triple, allow_hyphen_values = true)]
    albedo: super::light::Triple,
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
    Placements(placements::PlacementsArgs),
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

/// A bake in memory.
struct Baked {
    texture: MemoryTexture,
    settings: Settings,
    wall: f64,
    cpu: f64,
    rays: u64,
    texels: u64,
}

impl Study {
    pub(super) fn run(&self, seed: u64, console: &Console) -> Outcome {
        if let Some(OtherStudy::Placements(other)) = &self.other {
            return other.run(seed, console);
        }
        let mut opened = super::input::open(self.input.as_deref().unwrap_or_default(), &self.volume)?;
        let chosen = opened.choose(self.isovalue)?;
        opened.take_side(std::slice::from_ref(&chosen))?;
        let volume = &*opened.volume;
        for note in &volume.notes {
            console.note(&note.text);
        }
        let folder = output::result_folder(self.output.as_deref(), format!("{}-study", volume.name), "study.csv")?;
        volume.check_cells()?;
        let probe = open_probe(&self.env, false, None)?;
        let orientation = Orientation::new(volume.up, 0.0)?;
        let pyramid = Pyramid::new(volume);
        let settings = self.settings()?;
        self.check_memory(volume, chosen.value, &settings)?;
        let (source, most) = (probe.source(orientation), most_bands(&settings));
        let coefficients = probe.coefficients_in_world(most, orientation);
        let surface = Isosurface::extract(volume, &pyramid, chosen.value)?;
        let points = surface.random_points(if self.quick { self.points.min(400) } else { self.points }, seed);
        let bench = Bench {
            volume,
            pyramid: &pyramid,
            isovalue: chosen.value,
            points: &points,
            light: &source,
            coefficients: &coefficients,
            albedo: self.albedo.0,
            paths: if self.quick { self.paths.min(1024) } else { self.paths },
            texel_rays: if self.quick { self.texel_rays.min(1024) } else { self.texel_rays },
            layers: MOST_LAYERS,
            seed,
        };
        let clock = (Instant::now(), ProcessTime::now());
        let references = self.references(&bench, &settings)?;
        let reference_seconds = [clock.0.elapsed().as_secs_f64(), clock.1.elapsed().as_secs_f64()];
        let spread = clock_noise(&bench, seed)?;
        let question = forecast::Question {
            volume,
            pyramid: &pyramid,
            isovalue: chosen.value,
            probe: &probe,
            orientation,
            albedo: self.albedo.0,
            layers: &Layers::new(BANDS.to_vec())?,
            seed,
        };
        let selected = |lattice| texels_of_isosurface(volume, lattice, chosen.value);
        let pilots = forecast::pilots(&question, &forecast::RATIOS, &selected)?;
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
            "volume": volume.name, "isovalue": chosen.value, "environment": probe.name, "albedo": self.albedo.0,
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

    /// Curve, label and setting of every bake.
    fn settings(&self) -> Outcome<Vec<(String, String, Setting)>> {
        if self.most_rays < LEAST_RAYS {
            let expected = format!("at least {LEAST_RAYS}, where every sweep begins");
            let remedy = "1024 is the default; --quick makes a study short";
            return Err(Error::argument("--most-rays", self.most_rays, expected, remedy).into());
        }
        let ladder = self.ladder();
        let every = |n: usize| -> Vec<u32> { ladder.iter().copied().step_by(n).collect() };
        let setting = |estimator, rays, bands: &[usize], ratio| Setting {
            estimator,
            rays,
            bands: bands.to_vec(),
            ratio,
            kept_as: Precision::Half,
        };
        let mut all = Vec::new();
        let mut add = |curve: &str, label: String, setting| all.push((curve.to_string(), label, setting));
        for &n in &ladder {
            add("path", format!("{n}"), setting("path", n, &BANDS, 1.0));
        }
        for n in every(2) {
            add("gather", format!("{n}"), setting("gather", n, &BANDS, 1.0));
        }
        for n in every(2) {
            add("path, texture ½", format!("{n}"), setting("path", n, &BANDS, 0.5));
        }
        if self.quick {
            return Ok(all);
        }
        for n in every(2).into_iter().filter(|n| (64..=256).contains(n)) {
            add("photon", format!("{n}"), setting("photon", n, &BANDS, 1.0));
        }
        for n in every(2) {
            add("path, texture ¼", format!("{n}"), setting("path", n, &BANDS, 0.25));
        }
        let middle = self.middle_rays();
        for layers in 1..BANDS.len() {
            add(
                "path, fewer layers",
                format!("{layers} layer{}", if layers == 1 { "" } else { "s" }),
                setting("path", middle, &BANDS[..layers], 1.0),
            );
        }
        for bands in [2, 3, 4, 5, 7] {
            let bands = [bands; BANDS.len()];
            add(SAME_BANDS, format!("{}", bands[0]), setting("path", middle, &bands, 1.0));
        }
        Ok(all)
    }

    fn references(&self, bench: &Bench<'_>, settings: &[(String, String, Setting)]) -> Outcome<References> {
        let mut bands: Vec<usize> = settings.iter().map(|s| s.2.bands[0]).collect();
        bands.sort_unstable();
        bands.dedup();
        let mut lattices: Vec<Lattice> = Vec::new();
        for (_, _, setting) in settings {
            let lattice = Lattice::from_ratio(bench.volume.dims(), setting.ratio)?;
            if lattices.iter().all(|l| l.texels() != lattice.texels()) {
                lattices.push(lattice);
            }
        }
        Ok(bench.references(&bands, &lattices)?)
    }

    fn check_memory(&self, volume: &Volume, isovalue: f64, all: &[(String, String, Setting)]) -> Outcome {
        let lattice = Lattice::from_ratio(volume.dims(), 1.0)?;
        let bricks = texels_of_isosurface(volume, lattice, isovalue).bricks().len() as u64;
        let largest = most_bytes(all)?;
        // Two textures at once, and the cache of `gather`.
        let needed = volume.samples().bytes().len() as u64 / 4 * 5 + 3 * bricks * BRICK_TEXELS as u64 * largest;
        Ok(check_memory("the textures of the study", needed, self.memory_limit)?)
    }
}

/// Most stored bytes that any setting needs for a texel.
fn most_bytes(all: &[(String, String, Setting)]) -> Outcome<u64> {
    let layers = all.iter().map(|(_, _, s)| Layers::new(s.bands.clone())).collect::<Result<Vec<_>, Error>>()?;
    Ok(layers.iter().map(crate::bake::bytes_of_texel).max().unwrap_or(0))
}

/// Most bands that any setting has.
fn most_bands(settings: &[(String, String, Setting)]) -> usize {
    settings.iter().flat_map(|s| &s.2.bands).copied().max().unwrap_or(1)
}

/// Bakes the texels of the surface into memory and times it.
fn bake_once(bench: &Bench<'_>, setting: &Setting, seed: u64) -> Outcome<Baked> {
    let lattice = Lattice::from_ratio(bench.volume.dims(), setting.ratio)?;
    let layers = Layers::new(setting.bands.clone())?;
    let layout = Layout { lattice, layers: layers.clone() };
    let selection = texels_of_isosurface(bench.volume, lattice, bench.isovalue);
    let settings = Settings { layers, rays: setting.rays, seed, target: None, positive: false };
    let job = Bake::new(bench.volume, bench.pyramid, &layout, &settings, &selection);
    let mut texture = MemoryTexture::new(layout.clone());
    let mut keep = |chunk: [usize; 3], mut groups: ChunkBricks| texture.insert_chunk(chunk, groups.swap_remove(0));
    let (chunks, progress) = (job.chunks(), Progress::default());
    let (wall, cpu) = (Instant::now(), ProcessTime::now());
    let summary = match setting.estimator {
        "gather" => {
            let options = GatherSettings { bias_texels: 0, ..GatherSettings::default() };
            gather(&job, &options, &chunks, &progress, &|_| Ok(None), &mut keep)?.summary
        }
        "photon" => {
            let texels: u64 = lattice.texels().iter().map(|&m| m as u64).product();
            let options = PhotonBake::for_texels(texels, setting.rays);
            photon_bake(&job, &options, &chunks, &progress, &|_| Ok(None), &mut keep)?.0
        }
        _ => bake(&job, &chunks, &progress, &|_| Ok(None), &mut keep)?,
    };
    let (wall, cpu) = (wall.elapsed().as_secs_f64(), cpu.elapsed().as_secs_f64());
    Ok(Baked { texture, settings, wall, cpu, rays: summary.counts.rays, texels: summary.valid })
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
    let Baked { texture, settings, wall, cpu, rays, texels } = bake_once(bench, &setting, seed)?;
    let is_path = setting.estimator == "path";
    let second = if is_path { None } else { Some(bake_once(bench, &setting, seed ^ 1)?.texture) };
    let baked_by = is_path.then_some(&settings);
    let measured = bench.measure(references, &texture, baked_by, second.as_ref().map(|t| t as _))?;
    let row = |curve, label, kept_as, measured| {
        let bytes = (texels as f64 * bytes_of_texel(&settings.layers, kept_as)) as u64;
        Row { setting: Setting { kept_as, ..setting.clone() }, curve, label, wall, cpu, rays, texels, bytes, measured }
    };
    let mut kept = Vec::new();
    if keeps {
        let found = bench.measure_kept_as(references, &texture, &settings, &KEPT_AS)?;
        kept.extend(KEPT_AS.into_iter().zip(found).map(|(kind, found)| row(KEPT.into(), kind.name(), kind, found)));
    }
    Ok((row(curve, label, Precision::Half, measured), kept))
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
    let setting = Setting { estimator: "path", rays: 16, bands: BANDS.to_vec(), ratio: 1.0, kept_as: Precision::Half };
    // The first one warms caches.
    bake_once(bench, &setting, seed)?;
    let (mut wall, mut cpu) = (Running::default(), Running::default());
    for _ in 0..REPEATS {
        let baked = bake_once(bench, &setting, seed)?;
        wall.push(baked.wall);
        cpu.push(baked.cpu);
    }
    Ok([wall, cpu].map(|r| r.variance().sqrt() / r.mean().max(f64::MIN_POSITIVE)))
}

/// What a reader of the figure must know.
fn notes(bench: &Bench<'_>, references: &References, texels: u64, spread: [f64; 2]) -> Vec<String> {
    let (points, [r, g, b]) = (text::count(bench.points.len() as u64), bench.albedo);
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
