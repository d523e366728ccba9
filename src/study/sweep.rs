//! What accuracy costs in time on one isosurface: every setting of the sweeps baked, timed and measured, with the pilot's
//! forecasts and the noise of the clock beside them.

use super::figure::{Caption, Kept, Mark, on_front, rungs, seconds_at, svg};
use super::forecast::{self, POINTS, RATIOS, Weighed, pilots};
use super::model::Forecast;
use super::{Clock, Measured, References, Setting, Study};
use crate::bake::{Estimator, bytes_of_scene_texel};
use crate::compare::{LitSurface, Vertices, unburied};
use crate::error::{Error, Result};
use crate::export::atomic;
use crate::level::Pyramid;
use crate::memory;
use crate::probe::{Orientation, Probe};
use crate::quantity::{count, number, percent};
use crate::sampling::statistics::Running;
use crate::scene::{Member, SceneFile};
use crate::session::Isosurface;
use crate::transfer::precision::bytes_of_texel;
use crate::transfer::texels_of_isosurface;
use crate::transfer::{BRICK_TEXELS, Lattice, Layers, Precision, Steps};
use crate::transport::{Summary, needs_photons};
use serde_json::{Value, json};
use std::path::Path;

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

/// What is studied, and how hard.
#[derive(Clone, Copy)]
pub struct Sweep<'a> {
    /// The volume and what stands around it.
    pub member: &'a Member,
    /// The isosurface, in the file's values.
    pub isovalue: f64,
    /// The scene that it comes from: its albedo and emission count where `albedo` is none.
    pub file: Option<&'a SceneFile>,
    /// The light.
    pub probe: &'a Probe,
    /// How it stands around the volume.
    pub orientation: Orientation,
    /// Albedo of the surface.
    pub albedo: Option<[f32; 3]>,
    /// Random vertices at which light is compared.
    pub points: u32,
    /// Paths of the reference at each of them.
    pub paths: u32,
    /// Paths for each exact texel.
    pub texel_rays: u32,
    /// Most rays a texel that are tried.
    pub most_rays: u32,
    /// Whether a coarser reference and fewer bakes will do.
    pub quick: bool,
    /// Most bytes to use; by what the system allows, if none.
    pub memory_limit: Option<u64>,
    /// Threads that bakes run on, for the record.
    pub threads: usize,
    /// Seed of all random numbers.
    pub seed: u64,
}

/// A bake of a sweep: the curve that it belongs to, what it is on it, and its setting.
struct Asked {
    curve: &'static str,
    label: String,
    setting: Setting,
}

/// One bake and what was found.
#[derive(Clone, Debug)]
pub struct SweepRow {
    /// How it was baked.
    pub setting: Setting,
    /// The curve that it belongs to.
    pub curve: String,
    /// What it is on its curve.
    pub label: String,
    /// Seconds, wall clock.
    pub wall: f64,
    /// Seconds of all processors.
    pub cpu: f64,
    /// Rays.
    pub rays: u64,
    /// Texels with a level set.
    pub texels: u64,
    /// Stored bytes of them.
    pub bytes: u64,
    /// How exact it is.
    pub measured: Measured,
}

/// What a study found.
pub struct Swept {
    /// The bakes; those of the sweep of storage last.
    pub rows: Vec<SweepRow>,
    /// Which of `rows` no other beats.
    pub front: Vec<usize>,
    /// The bakes of the figure.
    pub marks: Vec<Mark>,
    /// The same bake kept in more and fewer bits.
    pub kept: Vec<Kept>,
    /// Rays a texel of that bake.
    pub rays_of_kept: u32,
    /// Rays of the reference.
    pub reference_rays: u64,
    /// Noise of the reference over its mean.
    pub reference_noise: f64,
    /// Seconds that the reference took: wall clock and processors.
    pub reference_seconds: [f64; 2],
    pilots: Vec<Weighed>,
    figure: String,
    record: Value,
}

impl Sweep<'_> {
    /// Bakes and measures every setting. `note` hears of each; `clock` is asked around each.
    ///
    /// # Errors
    /// When too few rays are asked for, the textures do not fit into memory, no light reaches the surface; as
    /// [`Study::references`].
    pub fn run(&self, clock: &Clock<'_>, note: &dyn Fn(&str)) -> Result<Swept> {
        let (volume, geometry, isovalue) = (&*self.member.volume, self.member.geometry.as_ref(), self.isovalue);
        let (probe, orientation, file) = (self.probe, self.orientation, self.file);
        let pyramid = Pyramid::new(volume);
        let settings = self.settings()?;
        self.check_memory(&settings)?;
        let most = settings.iter().flat_map(|s| &s.setting.bands).copied().max().unwrap_or(1);
        let (source, coefficients) = (probe.source(orientation), probe.coefficients_in_world(most, orientation));
        let surface = Isosurface::extract(volume, &pyramid, isovalue)?;
        let points = surface.random_points(if self.quick { self.points.min(400) } else { self.points }, self.seed);
        let points = unburied(volume, &pyramid, geometry, isovalue, points);
        let rule = file.and_then(|f| f.description.albedo.as_ref()).map(|a| a.rule(volume.value_range()));
        let of_scene = rule.map_or([0.7; 3], |rule| rule.albedo(isovalue));
        let emission = file.and_then(|f| f.description.emission.as_ref());
        let vertices = Vertices::new(isovalue, surface.mesh().clone());
        let lit = LitSurface {
            volume,
            pyramid: &pyramid,
            geometry,
            caustics: geometry.is_none_or(|geometry| needs_photons(geometry).is_empty()),
            specular: None,
            isovalue,
            points: &points,
            light: &source,
            coefficients: &coefficients,
            albedo: self.albedo.unwrap_or(of_scene),
            emission: emission.map_or([0.0; 3], |rule| rule.at(isovalue)),
            scales: &[],
            vertices: Some(&vertices),
        };
        let bench = Study {
            surface: lit,
            paths: if self.quick { self.paths.min(1024) } else { self.paths },
            texel_rays: if self.quick { self.texel_rays.min(1024) } else { self.texel_rays },
            layers: MOST_LAYERS,
            seed: self.seed,
        };
        let start = clock();
        let references = references(&bench, &settings)?;
        let end = clock();
        let reference_seconds = [end[0] - start[0], end[1] - start[1]];
        let spread = clock_noise(&bench, clock)?;
        let bands = Layers::new(BANDS.to_vec())?;
        let layers = if geometry.is_some() { bands.coloured() } else { bands };
        let of_pilot = probe.coefficients_in_world(layers.max_bands(), orientation);
        let few = &points[..points.len().min(POINTS as usize)];
        let surface = LitSurface { points: few, coefficients: &of_pilot, ..lit };
        let question = forecast::Question { surface, layers: &layers, seed: self.seed };
        let selected = |lattice| texels_of_isosurface(volume, lattice, isovalue);
        let pilots = pilots(&question, &RATIOS, &selected, clock)?;
        let rays_of_kept = self.middle_rays();
        let (mut rows, mut kept_rows) = (Vec::new(), Vec::new());
        for asked in settings {
            note(&format!("{}, {}", asked.curve, asked.label));
            let keeps = asked.curve == "path" && asked.setting.rays == rays_of_kept;
            let (row, kept) = measure(&bench, &references, asked, keeps, clock)?;
            rows.push(row);
            kept_rows.extend(kept);
        }
        // Light of other bands is another reference: that sweep, the last one, is not drawn beside the others.
        let marks: Vec<Mark> = rows.iter().filter(|row| row.curve != SAME_BANDS).map(mark).collect();
        let kept: Vec<Kept> = kept_rows.iter().map(kept_of).collect();
        let front = on_front(&marks);
        let texels = rows.first().map_or(0, |r| r.texels);
        rows.extend(kept_rows);
        let title =
            format!("{}, isovalue {}, under {}: what accuracy costs", volume.name, number(isovalue, 6), probe.name);
        let notes = notes(&bench, &references, texels, spread, self.threads);
        let caption = Caption { title, notes, truncation: references.truncation(), kept: kept.clone() };
        let record = json!({
            "volume": volume.name, "isovalue": isovalue, "environment": probe.name, "albedo": lit.albedo,
            "points": points.len(), "paths": bench.paths, "texel_rays": bench.texel_rays, "seed": self.seed,
            "threads": self.threads,
            "reference": { "rays": references.rays, "noise": references.noise(), "wall_seconds": reference_seconds[0],
                "cpu_seconds": reference_seconds[1],
                "truncation": references.truncation().iter().map(|(b, e)| json!({ "bands": b, "rms": e })).collect::<Vec<_>>() },
            "clock_noise": { "wall": spread[0], "cpu": spread[1], "bakes": REPEATS },
        });
        let figure = svg(&marks, &caption);
        let (reference_rays, reference_noise) = (references.rays, references.noise());
        Ok(Swept {
            rows,
            front,
            marks,
            kept,
            rays_of_kept,
            reference_rays,
            reference_noise,
            reference_seconds,
            pilots,
            figure,
            record,
        })
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

    /// Every bake; in a scene none by `photon`, and of a translucent solid all by `path`.
    fn settings(&self) -> Result<Vec<Asked>> {
        let is_scene = self.member.geometry.is_some();
        let is_translucent = self.member.geometry.as_ref().is_some_and(|geometry| geometry.body().is_some());
        if self.most_rays < LEAST_RAYS {
            let expected = format!("at least {LEAST_RAYS}, where every sweep begins");
            let remedy = "1024 is the default; --quick makes a study short";
            return Err(Error::argument("--most-rays", self.most_rays, expected, remedy));
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
        let mut add = |curve, label, setting| all.push(Asked { curve, label, setting });
        for &n in &ladder {
            add("path, at vertices", format!("{n}"), Setting { ratio: None, ..setting(Path, n, &BANDS, 1.0) });
        }
        for &n in &ladder {
            add("path", format!("{n}"), setting(Path, n, &BANDS, 1.0));
        }
        for n in every(2).into_iter().filter(|_| !is_translucent) {
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

    /// The textures of the largest setting must fit.
    fn check_memory(&self, all: &[Asked]) -> Result<()> {
        let (volume, geometry) = (&*self.member.volume, self.member.geometry.as_ref());
        let largest_ratio = all.iter().filter_map(|asked| asked.setting.ratio).fold(1.0, f64::max);
        let lattice = Lattice::from_ratio(volume.dims(), largest_ratio)?;
        let bricks = texels_of_isosurface(volume, lattice, self.isovalue).bricks().len() as u64;
        let channels = |layers: Layers| if geometry.is_some() { layers.coloured() } else { layers };
        let layers = all.iter().map(|asked| Ok(channels(Layers::new(asked.setting.bands.clone())?)));
        let layers = layers.collect::<Result<Vec<_>>>()?;
        let largest = layers.iter().map(|layers| bytes_of_scene_texel(layers, geometry)).max().unwrap_or(0);
        // Two textures at once, and the cache of `gather`.
        let needed = volume.samples().bytes().len() as u64 / 4 * 5 + 3 * bricks * BRICK_TEXELS as u64 * largest;
        memory::check("the textures of the study", needed, self.memory_limit)
    }
}

impl Swept {
    /// What the pilot of a forecast says of a bake; `None` where none was made of such.
    pub fn forecast_of(&self, row: &SweepRow) -> Option<Forecast> {
        let fits = row.setting.estimator == Estimator::Path && row.setting.bands == BANDS && row.curve != KEPT;
        let pilot = self.pilots.iter().find(|w| fits && Some(w.ratio) == row.setting.ratio)?;
        Some(pilot.pilot.forecast(row.setting.rays))
    }

    /// All that was found, for programs.
    pub fn to_json(&self) -> Value {
        let mut whole = self.record.clone();
        whole["rows"] = self.rows.iter().map(row_json).collect();
        whole["forecasts"] = self.rows.iter().filter_map(|row| self.forecast_json(row)).collect();
        whole["front"] = json!(self.front);
        whole["kept"] = self.kept.iter().map(kept_json).collect();
        let rungs = rungs(&self.marks);
        let at = |list: &[Option<f64>]| -> Value {
            rungs.iter().zip(list).map(|(e, s)| json!({ "error": e, "cpu_seconds": s })).collect()
        };
        let curves = seconds_at(&self.marks);
        whole["seconds_to_error"] =
            curves.iter().map(|(name, list)| json!({ "curve": name, "at": at(list) })).collect();
        whole
    }

    fn forecast_json(&self, row: &SweepRow) -> Option<Value> {
        let forecast = self.forecast_of(row)?;
        Some(json!({
            "curve": row.curve, "rays": row.setting.rays, "cpu_seconds": row.cpu, "forecast_cpu_seconds": forecast.seconds,
            "rms_same_bands": row.measured.band_limited.relative_rms_without_noise, "forecast_error": forecast.error,
        }))
    }

    /// A line for each bake.
    pub fn to_csv(&self) -> String {
        let mut out = format!("{HEAD}\n");
        for r in &self.rows {
            let (s, m) = (&r.setting, &r.measured);
            let bands = s.bands.iter().map(usize::to_string).collect::<Vec<_>>().join(" ");
            let parts: Vec<String> = m.budget.iter().map(|b| format!("{:e}", b.mean_square)).collect();
            let total: f64 = m.budget.iter().map(|b| b.mean_square).sum();
            out += &format!(
                "{},{},{bands},{},{},{:.4},{:.4},{},{},{},{:.6},{:.6},{:.6},{:.6},{:.6},{},{total:e}\n",
                s.estimator.name(),
                s.rays,
                s.ratio.map_or("vertices".into(), |ratio| ratio.to_string()),
                s.kept_as.name(),
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

    /// Writes study.csv, study.json and study.svg into a folder, which is made if it is not there.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        atomic::make_folder(folder)?;
        atomic::write_bytes(folder.join("study.csv"), self.to_csv().as_bytes())?;
        atomic::write_bytes(folder.join("study.json"), format!("{:#}\n", self.to_json()).as_bytes())?;
        atomic::write_bytes(folder.join("study.svg"), self.figure.as_bytes())
    }
}

const HEAD: &str = "estimator,rays,bands,ratio,kept_as,wall_seconds,cpu_seconds,transport_rays,texels,bytes,\
rms,rms_half_interval,rms_same_bands,rms_same_bands_without_noise,bias,\
truncation,interpolation,noise_of_reference,layers,noise,bias_mean_square,rounding,cross_terms,total_mean_square";

fn row_json(r: &SweepRow) -> Value {
    let budget: serde_json::Map<_, _> =
        r.measured.budget.iter().map(|b| (b.name.to_string(), json!(b.mean_square))).collect();
    json!({
        "curve": r.curve, "estimator": r.setting.estimator.name(), "rays": r.setting.rays, "bands": r.setting.bands,
        "ratio": r.setting.ratio, "kept_as": r.setting.kept_as.name(), "wall_seconds": r.wall, "cpu_seconds": r.cpu, "transport_rays": r.rays,
        "texels": r.texels, "bytes": r.bytes,
        "rms": r.measured.whole.relative_rms.value,
        "rms_same_bands": r.measured.band_limited.relative_rms_without_noise,
        "budget_mean_square": budget,
    })
}

fn kept_json(k: &Kept) -> Value {
    json!({ "kept_as": k.name, "bytes_of_texel": k.bytes_of_texel, "rms_of_rounding": k.rounding, "rms_same_bands": k.error })
}

fn references(bench: &Study<'_>, settings: &[Asked]) -> Result<References> {
    let mut bands: Vec<usize> = settings.iter().map(|s| s.setting.bands[0]).collect();
    bands.sort_unstable();
    bands.dedup();
    let mut lattices: Vec<Lattice> = Vec::new();
    for asked in settings {
        let lattice = asked.setting.lattice(&bench.surface)?;
        if lattices.iter().all(|l| l.texels() != lattice.texels()) {
            lattices.push(lattice);
        }
    }
    bench.references(&bands, &lattices)
}

/// Bakes and measures; with `keeps` also what keeping the same coefficients in more or fewer bits does.
fn measure(
    bench: &Study<'_>,
    references: &References,
    Asked { curve, label, setting }: Asked,
    keeps: bool,
    clock: &Clock<'_>,
) -> Result<(SweepRow, Vec<SweepRow>)> {
    let seed = bench.seed;
    let baked = bench.bake(&setting, seed, clock)?;
    let (textures, settings) = (baked.textures.sources(), &baked.settings);
    let (rays, texels) = (rays_of(&baked.summary), baked.summary.valid);
    let [wall, cpu] = baked.seconds;
    let is_path = setting.estimator == Estimator::Path;
    let second = if is_path { None } else { Some(bench.bake(&setting, seed ^ 1, clock)?) };
    let second = second.as_ref().map(|second| second.textures.sources());
    let measured = bench.measure(references, &textures, is_path.then_some(settings), second.as_deref())?;
    let row = |curve: &str, label, kept_as, measured| {
        let (setting, curve) = (Setting { kept_as, ..setting.clone() }, curve.to_string());
        let bytes = (texels as f64 * bytes_of_texel(&settings.layers, kept_as)) as u64;
        SweepRow { setting, curve, label, wall, cpu, rays, texels, bytes, measured }
    };
    let mut kept = Vec::new();
    if keeps {
        let found = bench.measure_kept_as(references, &textures, settings, &KEPT_AS)?;
        kept.extend(KEPT_AS.into_iter().zip(found).map(|(kind, found)| row(KEPT, kind.name(), kind, found)));
    }
    Ok((row(curve, label, Precision::Half, measured), kept))
}

/// Rays of a bake: within the level set of a volume alone, or through all that a scene has.
fn rays_of(summary: &Summary) -> u64 {
    let in_scene = summary.scene.path_rays + summary.scene.light_rays;
    if in_scene > 0 { in_scene } else { summary.counts.rays }
}

/// A row of the sweep of storage for the figure.
fn kept_of(row: &SweepRow) -> Kept {
    Kept {
        name: row.label.clone(),
        bytes_of_texel: row.bytes as f64 / row.texels.max(1) as f64,
        rounding: row.measured.row("rounding").max(0.0).sqrt(),
        error: row.measured.band_limited.relative_rms_without_noise,
    }
}

fn mark(row: &SweepRow) -> Mark {
    let (curve, label) = (row.curve.clone(), row.label.clone());
    Mark { curve, label, seconds: row.cpu, measured: row.measured.clone() }
}

/// Spread of repeated bakes, over their mean: wall-clock time and processor time.
fn clock_noise(bench: &Study<'_>, clock: &Clock<'_>) -> Result<[f64; 2]> {
    let setting = Setting {
        estimator: Estimator::Path,
        rays: 16,
        bands: BANDS.to_vec(),
        ratio: Some(1.0),
        kept_as: Precision::Half,
    };
    // The first one warms caches.
    bench.bake(&setting, bench.seed, clock)?;
    let (mut wall, mut cpu) = (Running::default(), Running::default());
    for _ in 0..REPEATS {
        let seconds = bench.bake(&setting, bench.seed, clock)?.seconds;
        wall.push(seconds[0]);
        cpu.push(seconds[1]);
    }
    Ok([wall, cpu].map(|r| r.variance().sqrt() / r.mean().max(f64::MIN_POSITIVE)))
}

/// What a reader of the figure must know.
fn notes(bench: &Study<'_>, references: &References, texels: u64, spread: [f64; 2], threads: usize) -> Vec<String> {
    let (points, [r, g, b]) = (count(bench.surface.points.len() as u64), bench.surface.albedo);
    let albedo = if r == g && g == b { r.to_string() } else { format!("{r}, {g}, {b}") };
    vec![
        format!(
            "Reference: unbiased path tracing at {points} random vertices, {} paths each, under the same light cut to the same bands;",
            bench.paths
        ),
        format!(
            "its own noise, {}, is taken out. Vertical bars: 95 % intervals. Dashed: what cutting the light to bands costs besides.",
            percent(references.noise())
        ),
        "path: path tracing within the level set. gather: the texture as a cache of light. photon: photon mapping.".into(),
        "Numbers at the dots: rays a texel, or layers (one: direct light alone; each more: one bounce). Grey: what no other dot beats."
            .into(),
        "texture ½, ¼: so many texels to a sample of the volume along each axis, else 1.".into(),
        format!("Layers of {} bands, albedo {albedo}, unless a curve says otherwise.", BANDS.map(|b| b.to_string()).join(", ")),
        format!(
            "Processor seconds: {threads} threads together, for {} texels at texture 1. Repeated bakes differed by {}",
            count(texels),
            percent(spread[1]),
        ),
        format!(
            "(wall clock: {}). Bits: f16 is what stores hold, 8 bits with a scale to each coefficient the page in one file.",
            percent(spread[0])
        ),
    ]
}
