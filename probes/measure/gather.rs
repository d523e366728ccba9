//! The estimator `gather` against `path` at equal time: error and bias on four volumes.
//!
//! `cargo run --release --example measure-gather -- OUT.csv [--short] [VOLUME…]`
//!
//! `--short` leaves out what takes longest: four settings instead of seven, `path` to 256 rays only.
//!
//! Errors are those of a fixed random sample of valid texels against `path` with other seeds. Time is CPU
//! time of this process, all threads together, so that other programs disturb it little; `path` is timed
//! on every eighth brick and scaled by the count of valid texels, `gather` needs the whole texture
//! and bakes it. The last columns hold each gather against `path` at the same CPU time.

use isolume::level::Pyramid;
use isolume::transfer::{BRICK, BrickSource, Lattice, Layers, Layout, MemoryTexture, Selection, validity};
use isolume::transport::{Bake, CachePrecision, GatherSettings, Gathered, Progress, Settings, Summary, bake, gather};
use isolume::volume::Volume;
use std::fmt::Write as _;
use std::path::Path;

type Failure = Box<dyn std::error::Error>;

/// Texels whose errors are told.
const SAMPLE: usize = 1024;
/// Paths a texel of each of the two references.
const REFERENCE_RAYS: u32 = 4096;
/// One brick in so many is baked to time `path`.
const STRIDE: usize = 8;
/// Albedo of the ambient figure and of the weights of the layers.
const ALBEDO: f64 = 0.7;
const LAYERS: usize = 4;
const BANDS: usize = 5;

/// CPU seconds of this process so far. /proc counts in ticks of 1/100 s on every Linux.
fn cpu_seconds() -> Result<f64, Failure> {
    let stat = std::fs::read_to_string("/proc/self/stat")?;
    // The name in parentheses may hold blanks; user and system time are fields 14 and 15.
    let rest = stat.rsplit_once(')').ok_or("/proc/self/stat")?.1;
    let ticks: f64 = rest.split_whitespace().skip(11).take(2).filter_map(|s| s.parse::<f64>().ok()).sum();
    Ok(ticks / 100.0)
}

/// A number in [0, 1) for an index.
fn noise(index: u64) -> f64 {
    f64::from(isolume::sampling::hash::uniform(20_261_122, index, 0, 0))
}

struct Scene {
    volume: Volume,
    pyramid: Pyramid,
    layout: Layout,
}

impl Scene {
    fn open(name: &str) -> Result<Self, Failure> {
        let volume = match isolume::volume::field::by_name(name)? {
            Some(field) => field.sample()?,
            None => isolume::volume::open(Path::new(name))?,
        };
        let lattice = Lattice::from_ratio(volume.dims(), 1.0)?;
        let layout = Layout { lattice, layers: Layers::uniform(LAYERS, BANDS)? };
        Ok(Self { pyramid: Pyramid::new(&volume), layout, volume })
    }

    fn settings(&self, rays: u32, seed: u64) -> Settings {
        Settings { layers: self.layout.layers.clone(), rays, seed, positive: false, target: None }
    }

    /// A bake in memory by `path`, its totals and its CPU seconds.
    fn path(&self, selection: &Selection, settings: &Settings) -> Result<(MemoryTexture, Summary, f64), Failure> {
        let mut texture = MemoryTexture::new(self.layout.clone());
        let job = self.job(selection, settings);
        let start = cpu_seconds()?;
        let mut sink =
            |chunk, groups: Vec<Vec<Option<isolume::transfer::Brick>>>| keep(&mut texture, chunk, groups.concat());
        let summary = bake(&job, &job.chunks(), &Progress::default(), &|_| Ok(None), &mut sink)?;
        Ok((texture, summary, cpu_seconds()? - start))
    }

    /// A bake of everything in memory by `gather`; the bias sample is timed with it.
    fn gather(&self, settings: &Settings, how: &GatherSettings) -> Result<(MemoryTexture, Gathered, f64), Failure> {
        let mut texture = MemoryTexture::new(self.layout.clone());
        let selection = Selection::all(self.layout.lattice);
        let job = self.job(&selection, settings);
        let start = cpu_seconds()?;
        let mut sink =
            |chunk, groups: Vec<Vec<Option<isolume::transfer::Brick>>>| keep(&mut texture, chunk, groups.concat());
        let gathered = gather(&job, how, &job.chunks(), &Progress::default(), &|_| Ok(None), &mut sink)?;
        Ok((texture, gathered, cpu_seconds()? - start))
    }

    fn job<'a>(&'a self, selection: &'a Selection, settings: &'a Settings) -> Bake<'a> {
        Bake::new(&self.volume, &self.pyramid, &self.layout, settings, selection)
    }
}

fn keep(
    texture: &mut MemoryTexture,
    chunk: [usize; 3],
    bricks: Vec<Option<isolume::transfer::Brick>>,
) -> isolume::Result<()> {
    for (b, brick) in bricks.into_iter().enumerate() {
        if let Some(brick) = brick {
            texture.insert(std::array::from_fn(|a| chunk[a] * 4 + [b % 4, b / 4 % 4, b / 16][a]), brick)?;
        }
    }
    Ok(())
}

/// Coefficients of a texel; `None` where it has none.
fn texel(texture: &MemoryTexture, texel: [usize; 3]) -> Result<Option<Vec<f64>>, Failure> {
    let Some(brick) = texture.brick(texel.map(|t| t / BRICK))? else { return Ok(None) };
    let t = texel[0] % BRICK + BRICK * (texel[1] % BRICK + BRICK * (texel[2] % BRICK));
    let n = texture.layout().layers.coefficients();
    let valid = brick.validity[t] & validity::VALID != 0;
    Ok(valid.then(|| brick.transfer[t * n..][..n].iter().map(|v| f64::from(v.to_f32())).collect()))
}

/// The sample with its reference.
struct Reference {
    texels: Vec<[usize; 3]>,
    transfer: Vec<Vec<f64>>,
    /// Its own noise: RMS of T, ambient.
    noise: Errors,
}

/// Errors over the sample, relative.
#[derive(Clone, Copy)]
struct Errors {
    rms_t: f64,
    ambient: f64,
    /// Mean of the ambient difference and its standard error, over the mean.
    mean: f64,
    mean_stderr: f64,
}

fn errors(found: &[Vec<f64>], reference: &[Vec<f64>]) -> Errors {
    let (mut difference, mut norm) = (0.0, 0.0);
    let (mut squares, mut sum, mut ambient) = (0.0, 0.0, 0.0);
    for (f, r) in found.iter().zip(reference) {
        let (mut a, mut b) = (0.0, 0.0);
        for k in 0..LAYERS {
            let weight = ALBEDO.powi(k as i32 + 1);
            for i in k * BANDS * BANDS..(k + 1) * BANDS * BANDS {
                difference += (weight * (f[i] - r[i])).powi(2);
                norm += (weight * r[i]).powi(2);
            }
            let root_four_pi = 2.0 * std::f64::consts::PI.sqrt();
            a += weight * root_four_pi * f[k * BANDS * BANDS];
            b += weight * root_four_pi * r[k * BANDS * BANDS];
        }
        squares += (a - b).powi(2);
        sum += a - b;
        ambient += b;
    }
    let n = found.len() as f64;
    let mean = sum / n;
    Errors {
        rms_t: (difference / norm).sqrt(),
        ambient: (squares / n).sqrt() / (ambient / n),
        mean: mean / (ambient / n),
        mean_stderr: ((squares / n - mean * mean) / n).sqrt() / (ambient / n),
    }
}

impl Reference {
    /// A random sample of the valid texels of `within`, traced twice.
    fn new(scene: &Scene, within: &Selection) -> Result<Self, Failure> {
        let m = scene.layout.lattice.texels();
        let (valid, ..) = scene.path(within, &scene.settings(4, 1))?;
        let mut keyed = Vec::new();
        for i in 0..m.iter().product() {
            let t = [i % m[0], i / m[0] % m[1], i / m[0] / m[1]];
            if within.contains(t) && texel(&valid, t)?.is_some() {
                keyed.push((noise(i as u64), t));
            }
        }
        keyed.sort_by(|a, b| a.0.total_cmp(&b.0));
        let texels: Vec<_> = keyed.into_iter().take(SAMPLE).map(|(_, t)| t).collect();
        let mut selection = Selection::empty(scene.layout.lattice);
        texels.iter().for_each(|&t| selection.insert(t));
        let mut of = Self { texels, transfer: Vec::new(), noise: errors(&[], &[]) };
        let (a, ..) = scene.path(&selection, &scene.settings(REFERENCE_RAYS, 1001))?;
        let (b, ..) = scene.path(&selection, &scene.settings(REFERENCE_RAYS, 1002))?;
        let (a, b) = (of.read(&a)?, of.read(&b)?);
        of.transfer = a.iter().zip(&b).map(|(a, b)| a.iter().zip(b).map(|(a, b)| 0.5 * (a + b)).collect()).collect();
        // Half the difference of two is the noise of their mean.
        let half = errors(&a, &b);
        of.noise = Errors { rms_t: 0.5 * half.rms_t, ambient: 0.5 * half.ambient, ..half };
        Ok(of)
    }

    fn read(&self, texture: &MemoryTexture) -> Result<Vec<Vec<f64>>, Failure> {
        let read = |&t: &[usize; 3]| texel(texture, t)?.ok_or_else(|| Failure::from("a texel of the sample is gone"));
        self.texels.iter().map(read).collect()
    }
}

/// A line through the last two or the surrounding two points, in logarithms.
fn interpolate(points: &[(f64, f64)], x: f64) -> f64 {
    let i = points.iter().position(|p| p.0 >= x).unwrap_or(points.len() - 1).clamp(1, points.len() - 1);
    let ((x0, y0), (x1, y1)) = (points[i - 1], points[i]);
    let slope = (y1 / y0).ln() / (x1 / x0).ln();
    y0 * ((x / x0).ln() * slope).exp()
}

fn main() -> Result<(), Failure> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let out = args.first().ok_or("usage: measure-gather OUT.csv [--short] [VOLUME…]")?;
    let short = args.iter().any(|a| a == "--short");
    let mut volumes: Vec<&str> = args[1..].iter().map(String::as_str).filter(|a| !a.starts_with("--")).collect();
    if volumes.is_empty() {
        volumes = vec!["sphere-over-plane:64", "bumpbox:64", "gyroid:64"];
    }
    let mut csv = String::from(
        "volume,estimator,passes,cache_rays,rays,cache,cpu_seconds,rms_t,ambient,mean_error,mean_error_stderr,\
         bias_mean,bias_mean_stderr,bias_rms,bias_square_stderr,renormalised,neighbourhood,continued,memory_mib,\
         path_rms_t_at_this_time,path_ambient_at_this_time,path_seconds_for_this_rms_t,path_seconds_for_this_ambient\n",
    );
    for spec in volumes {
        let scene = Scene::open(spec)?;
        let name = Path::new(spec).file_name().map_or(spec.into(), |s| s.to_string_lossy());
        let mut timed = Selection::empty(scene.layout.lattice);
        let m = scene.layout.lattice.texels();
        let [bx, by, bz] = scene.layout.lattice.bricks();
        // An odd phase for each row of bricks, so that the picked ones form no column.
        for b in (0..bx * by * bz).filter(|b| (b + 3 * (b / bx) + 5 * (b / bx / by)) % STRIDE == 0) {
            for t in 0..BRICK.pow(3) {
                let inner = [t % BRICK, t / BRICK % BRICK, t / BRICK / BRICK];
                let brick = [b % bx, b / bx % by, b / bx / by];
                let t: [usize; 3] = std::array::from_fn(|a| brick[a] * BRICK + inner[a]);
                if (0..3).all(|a| t[a] < m[a]) {
                    timed.insert(t);
                }
            }
        }
        let reference = Reference::new(&scene, &timed)?;
        let r = reference.noise;
        println!(
            "{name}: {} texels, reference {:.3} % of T, {:.4} % ambient",
            reference.texels.len(),
            100.0 * r.rms_t,
            100.0 * r.ambient
        );
        let mut rows = Vec::new();
        // The first four are the short list.
        let hows: [(u32, u32, u32, CachePrecision); 7] = [
            (2, 16, 64, CachePrecision::Half),
            (5, 16, 64, CachePrecision::Half),
            (2, 16, 256, CachePrecision::Half),
            (2, 16, 16, CachePrecision::Half),
            (3, 16, 64, CachePrecision::Half),
            (5, 16, 64, CachePrecision::Single),
            (5, 16, 256, CachePrecision::Half),
        ];
        let mut valid = 0;
        for (passes, cache_rays, rays, precision) in hows.into_iter().take(if short { 4 } else { 7 }) {
            let how = GatherSettings { passes, cache_rays, precision, ..GatherSettings::default() };
            let (texture, gathered, seconds) = scene.gather(&scene.settings(rays, 1), &how)?;
            valid = gathered.summary.valid;
            let e = errors(&reference.read(&texture)?, &reference.transfer);
            println!("  gather {}x{cache_rays} + {rays}: {seconds:.2} s, T {:.3} %", passes - 1, 100.0 * e.rms_t);
            rows.push((how, rays, seconds, e, gathered));
        }
        let mut paths = Vec::new();
        for rays in [16, 32, 64, 128, 256, 512].into_iter().take(if short { 5 } else { 6 }) {
            let (texture, summary, seconds) = scene.path(&timed, &scene.settings(rays, 1))?;
            let seconds = seconds * valid as f64 / summary.valid as f64;
            let e = errors(&reference.read(&texture)?, &reference.transfer);
            println!(
                "  path {rays:3}: {seconds:7.2} s, T {:6.3} %, ambient {:6.4} %",
                100.0 * e.rms_t,
                100.0 * e.ambient
            );
            let (t, a, mean, sd) = (e.rms_t, e.ambient, e.mean, e.mean_stderr);
            writeln!(csv, "{name},path,,,{rays},,{seconds:.3},{t:.6},{a:.6},{mean:.6},{sd:.6},,,,,,,,,,,,")?;
            paths.push((seconds, e));
        }
        let by_time = |pick: fn(&Errors) -> f64| paths.iter().map(|(s, e)| (*s, pick(e))).collect::<Vec<_>>();
        // Errors fall with time: turned round they rise.
        let by_error = |pick: fn(&Errors) -> f64| paths.iter().rev().map(|(s, e)| (pick(e), *s)).collect::<Vec<_>>();
        for (how, rays, seconds, e, gathered) in rows {
            let (b, l) = (gathered.bias, gathered.lookups);
            let at = [interpolate(&by_time(|e| e.rms_t), seconds), interpolate(&by_time(|e| e.ambient), seconds)];
            let needs =
                [interpolate(&by_error(|e| e.rms_t), e.rms_t), interpolate(&by_error(|e| e.ambient), e.ambient)];
            let precision = if how.precision == CachePrecision::Half { "f16" } else { "f32" };
            println!(
                "  gather {}x{} + {rays:3} {precision}: {seconds:7.2} s, T {:6.3} % (path {:6.3}), ambient {:6.4} % (path {:6.4}), \
                 time of path for this: T {:.2}x, ambient {:.2}x; mean {:+.3} ± {:.3} %, told {:+.3} ± {:.3} %, RMS {:.3} (at most {:.3}) %",
                how.passes - 1,
                how.cache_rays,
                100.0 * e.rms_t,
                100.0 * at[0],
                100.0 * e.ambient,
                100.0 * at[1],
                needs[0] / seconds,
                needs[1] / seconds,
                100.0 * e.mean,
                100.0 * e.mean_stderr,
                100.0 * b.mean / b.ambient,
                100.0 * b.mean_stderr / b.ambient,
                100.0 * b.relative(b.rms()),
                100.0 * b.relative(b.rms_at_most())
            );
            let share = |n: u64| n as f64 / l.lookups.max(1) as f64;
            writeln!(
                csv,
                "{name},gather,{},{},{rays},{precision},{seconds:.3},{:.6},{:.6},{:.6},{:.6},{:.6},{:.6},{:.6},{:.3e},{:.5},{:.2e},{:.2e},{:.0},{:.6},{:.6},{:.3},{:.3}",
                how.passes,
                how.cache_rays,
                e.rms_t,
                e.ambient,
                e.mean,
                e.mean_stderr,
                b.mean / b.ambient,
                b.mean_stderr / b.ambient,
                b.relative(b.rms()),
                b.square_stderr / b.ambient.powi(2),
                share(l.renormalised),
                share(l.neighbourhood),
                share(l.continued),
                gathered.memory as f64 / f64::from(1 << 20),
                at[0],
                at[1],
                needs[0],
                needs[1]
            )?;
        }
        std::fs::write(out, &csv)?;
    }
    Ok(())
}
