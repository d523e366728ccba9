//! `isolume study`: what accuracy costs in time on the user's own volume, measured.

mod placements;

use super::console::Console;
use super::forecast::{self, Weighed, bytes_of_texel};
use super::input::VolumeArgs;
use super::isovalue::Isovalue;
use super::light::{open_probe, parse_triple};
use super::options::{check_memory, parse_bytes};
use super::surface::Surface;
use super::{Outcome, output, text};
use crate::error::Error;
use crate::export::atomic;
use crate::level::Pyramid;
use crate::probe::Orientation;
use crate::relight::texels_of_isosurface;
use crate::sampling::statistics::Running;
use crate::study::figure::{Caption, Mark, on_front, rungs, seconds_at, svg};
use crate::study::model::Forecast;
use crate::study::{Measured, References, Setting, Study as Bench};
use crate::transfer::{BRICK, BRICK_TEXELS, Brick, Lattice, Layers, Layout, MemoryTexture};

use crate::transport::{Bake, GatherSettings, PhotonBake, Progress, Settings, bake, gather, photon_bake};
use crate::volume::Volume;
use cpu_time::ProcessTime;
use serde_json::{Value, json};
use std::io::Write as _;
use std::path::PathBuf;
use std::time::Instant;

/// Show what accuracy costs in time: bake one surface in many ways and hold each against paths
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
    #[arg(short, long, value_name = "C", default_value = "auto", allow_hyphen_values = true)]
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
        let opened = super::input::open(self.input.as_deref().unwrap_or_default(), &self.volume)?;
        let volume = &opened.volume;
        for note in &volume.notes {
            console.note(&note.text);
        }
        let folder = self.output.clone().unwrap_or_else(|| PathBuf::from(format!("{}-study", volume.name)));
        // Refused before the minutes that a study takes.
        let inside = if folder.is_dir() { folder.join("study.csv") } else { folder.clone() };
        output::check_folder(&inside)?;
        volume.check_cells()?;
        let chosen = self.isovalue.resolve(volume, opened.default_isovalue)?;
        let probe = open_probe(&self.env, false, None)?;
        let orientation = Orientation::new(self.volume.up.unwrap_or(volume.up), 0.0)?;
        let pyramid = Pyramid::new(volume);
        let settings = self.settings()?;
        self.check_memory(volume, chosen.value, &settings)?;
        let (source, most) = (probe.source(orientation), most_bands(&settings));
        let coefficients = probe.coefficients_in_world(most, orientation);
        let surface = Surface::new(volume, &pyramid, Lattice::from_ratio(volume.dims(), 1.0)?, chosen.value)?;
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
        let mut rows = Vec::new();
        for (curve, label, setting) in settings {
            console.note(format!("{curve}, {label}"));
            rows.push(measure(&bench, &references, curve, label, setting, seed)?);
        }
        // Light of other bands is another reference: that sweep, the last one, is not drawn beside the others.
        let marks: Vec<Mark> = rows.iter().filter(|row| row.curve != SAME_BANDS).map(mark).collect();
        let caption = Caption {
            title: format!(
                "{}, isovalue {}, under {}: what accuracy costs",
                volume.name,
                text::number(chosen.value, 6),
                probe.name
            ),
            notes: notes(&bench, &references, rows.first().map_or(0, |r| r.texels), spread),
            truncation: references.truncation(),
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
            "front": on_front(&marks), "seconds_to_error": iso_json(&marks),
        });
        for (name, bytes) in [
            ("study.csv", csv.into_bytes()),
            ("study.json", format!("{whole:#}\n").into_bytes()),
            ("study.svg", svg(&marks, &caption).into_bytes()),
        ] {
            let path = folder.join(name);
            atomic::write(&path, |w| w.write_all(&bytes).map_err(|e| Error::io(&path, "write", e)))?;
        }
        console.print(table(&rows, &on_front(&marks)));
        console.print(format!(
            "\nforecast of the pilot of `isolume plan`, against what was measured\n{}",
            forecasts(&rows, &pilots)
        ));
        console.print(format!("\nseconds of processor time to the same error\n{}", iso_table(&marks)));
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

    /// Curve, label and setting of every bake.
    fn settings(&self) -> Outcome<Vec<(String, String, Setting)>> {
        if self.most_rays < LEAST_RAYS {
            let expected = format!("at least {LEAST_RAYS}, where every sweep begins");
            let remedy = "1024 is the default; --quick makes a study short";
            return Err(Error::argument("--most-rays", self.most_rays, expected, remedy).into());
        }
        let ladder: Vec<u32> = (0..16).map(|k| LEAST_RAYS << k).filter(|&n| n <= self.most_rays).collect();
        let every = |n: usize| -> Vec<u32> { ladder.iter().copied().step_by(n).collect() };
        let setting =
            |estimator, rays, bands: &[usize], ratio| Setting { estimator, rays, bands: bands.to_vec(), ratio };
        let mut all = Vec::new();
        let mut add = |curve: &str, label: String, setting| all.push((curve.to_string(), label, setting));
        for &n in &ladder {
            add("path", format!("{n} rays"), setting("path", n, &BANDS, 1.0));
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
        let middle = ladder[ladder.len() * 2 / 3];
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
    Ok(layers.iter().map(bytes_of_texel).max().unwrap_or(0))
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
    let job = Bake {
        volume: bench.volume,
        pyramid: bench.pyramid,
        layout: &layout,
        settings: &settings,
        selection: &selection,
    };
    let mut texture = MemoryTexture::new(layout.clone());
    let mut keep = |chunk: [usize; 3], bricks: Vec<Option<Brick>>| {
        const PER_SIDE: usize = crate::transfer::CHUNK / BRICK;
        for (i, brick) in bricks.into_iter().enumerate() {
            let place = [i % PER_SIDE, i / PER_SIDE % PER_SIDE, i / PER_SIDE / PER_SIDE];
            if let Some(brick) = brick {
                texture.insert(std::array::from_fn(|a| chunk[a] * PER_SIDE + place[a]), brick)?;
            }
        }
        Ok(())
    };
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

fn measure(
    bench: &Bench<'_>,
    references: &References,
    curve: String,
    label: String,
    setting: Setting,
    seed: u64,
) -> Outcome<Row> {
    let Baked { texture, settings, wall, cpu, rays, texels } = bake_once(bench, &setting, seed)?;
    let is_path = setting.estimator == "path";
    let second = if is_path { None } else { Some(bake_once(bench, &setting, seed ^ 1)?.texture) };
    let baked_by = is_path.then_some(&settings);
    let measured = bench.measure(references, &texture, baked_by, second.as_ref().map(|t| t as _))?;
    let bytes = texels * bytes_of_texel(&settings.layers);
    Ok(Row { setting, curve, label, wall, cpu, rays, texels, bytes, measured })
}

/// Spread of repeated bakes, over their mean: wall-clock time and processor time.
fn clock_noise(bench: &Bench<'_>, seed: u64) -> Outcome<[f64; 2]> {
    let setting = Setting { estimator: "path", rays: 16, bands: BANDS.to_vec(), ratio: 1.0 };
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
    let points = text::count(bench.points.len() as u64);
    vec![
        format!(
            "Error: outgoing light at {points} random vertices, against {} unbiased paths at each under the same light cut to the same bands. \
             Bars: 95 % interval.",
            bench.paths
        ),
        format!(
            "The noise of that reference, {}, is taken out. Dashed: what cutting the light costs besides.",
            text::percent(references.noise())
        ),
        format!(
            "Seconds: of {} threads together, for the {} texels that this surface needs where the texture has the resolution of the volume. \
             Repeated",
            rayon::current_num_threads(),
            text::count(texels),
        ),
        format!(
            "bakes differed by {} of processor and {} of wall-clock time. Bands {BANDS:?} by layer, texture ratio 1, albedo {}, unless a curve says otherwise.",
            text::percent(spread[1]),
            text::percent(spread[0]),
            bench.albedo[0]
        ),
    ]
}

fn mark(row: &Row) -> Mark {
    let (curve, label) = (row.curve.clone(), row.label.clone());
    Mark { curve, label, seconds: row.cpu, measured: row.measured.clone() }
}

const HEAD: &str = "estimator,rays,bands,ratio,wall_seconds,cpu_seconds,transport_rays,texels,bytes,\
rms,rms_half_interval,rms_same_bands,rms_same_bands_without_noise,bias,\
truncation,interpolation,noise_of_reference,layers,noise,bias_mean_square,rounding,cross_terms,total_mean_square";

fn csv(rows: &[Row]) -> String {
    let mut out = format!("{HEAD}\n");
    for r in rows {
        let (s, m) = (&r.setting, &r.measured);
        let bands = s.bands.iter().map(usize::to_string).collect::<Vec<_>>().join(" ");
        let parts: Vec<String> = m.budget.iter().map(|b| format!("{:e}", b.mean_square)).collect();
        let total: f64 = m.budget.iter().map(|b| b.mean_square).sum();
        out += &format!(
            "{},{},{bands},{},{:.4},{:.4},{},{},{},{:.6},{:.6},{:.6},{:.6},{:.6},{},{total:e}\n",
            s.estimator,
            s.rays,
            s.ratio,
            r.wall,
            r.cpu,
            r.rays,
            r.texels,
            r.bytes,
            m.whole.relative_rms.value,
            m.whole.relative_rms.half_interval,
            m.band_limited.relative_rms.value,
            m.band_limited.relative_rms_without_noise,
            m.band_limited.bias.value,
            parts.join(",")
        );
    }
    out
}

fn row_json(r: &Row) -> Value {
    let budget: serde_json::Map<_, _> =
        r.measured.budget.iter().map(|b| (b.name.to_string(), json!(b.mean_square))).collect();
    json!({
        "curve": r.curve, "estimator": r.setting.estimator, "rays": r.setting.rays, "bands": r.setting.bands,
        "ratio": r.setting.ratio, "wall_seconds": r.wall, "cpu_seconds": r.cpu, "transport_rays": r.rays,
        "texels": r.texels, "bytes": r.bytes,
        "rms": r.measured.whole.relative_rms.value,
        "rms_same_bands": r.measured.band_limited.relative_rms_without_noise,
        "budget_mean_square": budget,
    })
}

/// The forecast for a bake by `path` of the default layers.
fn forecast_of(row: &Row, pilots: &[Weighed]) -> Option<Forecast> {
    let fits = row.setting.estimator == "path" && row.setting.bands == BANDS;
    let pilot = pilots.iter().find(|w| fits && w.ratio == row.setting.ratio)?;
    Some(pilot.pilot.forecast(row.setting.rays))
}

fn forecasts(rows: &[Row], pilots: &[Weighed]) -> String {
    let mut lines =
        vec![["setting", "cpu s", "forecast", "ratio", "error", "forecast", "ratio"].map(String::from).to_vec()];
    for row in rows {
        let Some(forecast) = forecast_of(row, pilots) else { continue };
        let error = row.measured.band_limited.relative_rms_without_noise;
        lines.push(vec![
            format!("{}, {}", row.curve, row.label),
            format!("{:.2}", row.cpu),
            format!("{:.2}", forecast.seconds),
            format!("{:.2}", forecast.seconds / row.cpu),
            text::percent(error),
            text::percent(forecast.error),
            format!("{:.2}", forecast.error / error),
        ]);
    }
    text::table(&lines)
}

fn forecast_json(row: &Row, pilots: &[Weighed]) -> Option<Value> {
    let forecast = forecast_of(row, pilots)?;
    Some(json!({
        "curve": row.curve, "rays": row.setting.rays, "cpu_seconds": row.cpu, "forecast_cpu_seconds": forecast.seconds,
        "rms_same_bands": row.measured.band_limited.relative_rms_without_noise, "forecast_error": forecast.error,
    }))
}

fn iso_json(marks: &[Mark]) -> Value {
    let rungs = rungs(marks);
    let curves = seconds_at(marks);
    json!(
        curves
            .iter()
            .map(|(name, list)| json!({
                "curve": name,
                "at": rungs.iter().zip(list).map(|(e, s)| json!({ "error": e, "cpu_seconds": s })).collect::<Vec<_>>(),
            }))
            .collect::<Vec<_>>()
    )
}

fn iso_table(marks: &[Mark]) -> String {
    let head = rungs(marks).into_iter().map(text::percent);
    let mut lines = vec![std::iter::once("curve".to_string()).chain(head).collect::<Vec<_>>()];
    for (name, seconds) in seconds_at(marks) {
        let cells = seconds.into_iter().map(|s| s.map_or("-".into(), |s| format!("{s:.2}")));
        lines.push(std::iter::once(name).chain(cells).collect());
    }
    text::table(&lines)
}

fn table(rows: &[Row], front: &[usize]) -> String {
    let mut lines = vec![
        [
            "setting",
            "cpu s",
            "wall s",
            "rays",
            "bytes",
            "error",
            "±",
            "interpolation",
            "layers",
            "noise",
            "bias",
            "rounding",
            "front",
        ]
        .map(String::from)
        .to_vec(),
    ];
    for (i, r) in rows.iter().enumerate() {
        let rms = |name: &str| {
            let square = r.measured.row(name);
            text::percent(square.abs().sqrt().copysign(square))
        };
        let mut line = vec![
            format!("{}, {}", r.curve, r.label),
            format!("{:.2}", r.cpu),
            format!("{:.2}", r.wall),
            text::metric(r.rays as f64),
            text::bytes(r.bytes as f64),
            text::percent(r.measured.band_limited.relative_rms_without_noise),
            text::percent(r.measured.band_limited.relative_rms.half_interval),
        ];
        line.extend(["interpolation", "layers", "noise", "bias", "rounding"].map(rms));
        line.push(if front.contains(&i) { "*".into() } else { String::new() });
        lines.push(line);
    }
    text::table(&lines)
}
