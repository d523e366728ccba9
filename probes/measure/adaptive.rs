//! What stopping each texel at an error of its own saves against the same number of rays for all.
//!
//! `cargo run --release --example measure-adaptive -- [TEXELS] [REFERENCE] [VOLUME…]` (20000, 16384, two volumes)
//!
//! A fixed random sample of the valid texels of all isosurfaces is baked with 16, 32 … 8192 paths for every texel, and
//! with error targets of 0.06 … 0.007, and with the targets and caps at which uniform sampling has its 95th percentile; truth is a bake of REFERENCE paths from other random numbers. Prints CSV, one line a
//! bake: transport rays a texel (all of them, hits included), 95th percentiles of the stated standard error (the larger of
//! those of Σ a_k and a_0) and of the true error of each, root mean squares, and the bias. Then, for each target, its rays
//! over those with which uniform sampling, every texel traced, (log-log interpolated) has the same percentile or root mean square; and the
//! least that share of rays could be for the root mean square if errors fell as N^−1/2 and σ were known,
//! (E σ)²/(E σ²).

use isolume::level::Pyramid;
use isolume::sampling::hash::uniform;
use isolume::transfer::{BRICK, Lattice, Layers, Layout, Selection, validity};
use isolume::transport::{Bake, Progress, Settings, Target, bake};
use isolume::volume::{Shadowing, Volume};
use std::collections::BTreeMap;
use std::path::Path;

const TARGETS: [f32; 9] = [0.06, 0.05, 0.04, 0.03, 0.025, 0.02, 0.015, 0.01, 0.007];
const ROOT_FOUR_PI: f64 = 3.544_907_701_811_032;

/// Σ a_k and a_0 of a texel, with their stated standard errors.
#[derive(Clone, Copy)]
struct Texel {
    values: [f64; 2],
    stderr: [f64; 2],
}

/// A bake of the sample.
struct Found {
    label: String,
    rays: f64,
    texels: Vec<Texel>,
}

struct Scene {
    volume: Volume,
    // The same, but texels that are proven to be open are traced like all others.
    traced: Volume,
    pyramid: Pyramid,
    layout: Layout,
    selection: Selection,
    // Where each texel of the sample goes in a list.
    order: BTreeMap<[usize; 3], usize>,
}

impl Scene {
    fn new(volume: Volume, count: usize) -> isolume::Result<Self> {
        let pyramid = Pyramid::new(&volume);
        let lattice = Lattice::from_ratio(volume.dims(), 1.0)?;
        let surface = Selection::of_all_isosurfaces(lattice, &volume);
        let (mut selection, mut order) = (Selection::empty(lattice), BTreeMap::new());
        let m = lattice.texels();
        for i in 0..20 * m.iter().product::<usize>() as u64 {
            let random = |a: usize| uniform(2028, i, 0, a as u32);
            let texel: [usize; 3] = std::array::from_fn(|a| ((random(a) * m[a] as f32) as usize).min(m[a] - 1));
            if surface.contains(texel) && !order.contains_key(&texel) {
                selection.insert(texel);
                order.insert(texel, order.len());
                if order.len() == count {
                    break;
                }
            }
        }
        let layout = Layout { lattice, layers: Layers::uniform(4, 3)? };
        let mut traced = volume.clone();
        traced.shadowing = Shadowing::Traced;
        Ok(Self { volume, traced, pyramid, layout, selection, order })
    }

    fn bake(&self, rays: u32, target: Option<f32>, seed: u64) -> isolume::Result<Found> {
        let layers = self.layout.layers.clone();
        let target_of = |error| Target::escape(&layers, error);
        let settings = Settings { layers: layers.clone(), rays, seed, positive: false, target: target.map(target_of) };
        let volume = if target.is_some() { &self.volume } else { &self.traced };
        let (pyramid, layout, selection) = (&self.pyramid, &self.layout, &self.selection);
        let job = Bake::new(volume, pyramid, layout, &settings, selection);
        let mut texels = vec![None; self.order.len()];
        let (n, e) = (layers.coefficients(), layers.errors());
        let summary = bake(&job, &job.chunks(), &Progress::default(), &|_| Ok(None), &mut |chunk, groups| {
            let first = chunk.map(|c| 4 * BRICK * c);
            for (texel, &at) in self.order.range(first..) {
                if (0..3).any(|a| texel[a] < first[a] || texel[a] >= first[a] + 4 * BRICK) {
                    if texel[0] >= first[0] + 4 * BRICK {
                        break;
                    }
                    continue;
                }
                let inner: [usize; 3] = std::array::from_fn(|a| texel[a] - first[a]);
                let [x, y, z] = inner.map(|i| i / BRICK);
                let t = inner.map(|i| i % BRICK);
                let t = t[0] + BRICK * (t[1] + BRICK * t[2]);
                if let Some(brick) = &groups[0][x + 4 * (y + 4 * z)]
                    && brick.validity[t] & validity::VALID != 0
                {
                    let numbers = |v: &[half::f16]| v.iter().map(|x| x.to_f64()).collect::<Vec<_>>();
                    let transfer = numbers(&brick.transfer[t * n..(t + 1) * n]);
                    texels[at] = Some(texel_of(&layers, &transfer, &numbers(&brick.stderr[t * e..(t + 1) * e])));
                }
            }
            Ok(())
        })?;
        let label = target.map_or(format!("uniform,{rays}"), |error| format!("target,{error:.4} of at most {rays}"));
        let texels: Vec<Texel> = texels.into_iter().flatten().collect();
        Ok(Found { label, rays: summary.counts.rays as f64 / texels.len() as f64, texels })
    }
}

/// Σ a_k, a_0 and their standard errors: that of the sum as `Target` states it.
fn texel_of(layers: &Layers, transfer: &[f64], stderr: &[f64]) -> Texel {
    let a: Vec<f64> = (0..layers.len()).map(|k| ROOT_FOUR_PI * transfer[layers.offset(k)]).collect();
    let error: Vec<f64> = (0..layers.len()).map(|k| ROOT_FOUR_PI * stderr[layers.error_offset(k)]).collect();
    let sum: f64 = a.iter().sum();
    let blocked = 1.0 - a[0];
    let continuation = if blocked > 1e-6 { (sum - a[0]) / blocked } else { 0.0 };
    let events: f64 = error.iter().map(|e| e * e).sum();
    let last = layers.len() - 1;
    let survivors = if a[last] > 1e-3 { error[last].powi(2) / a[last] * (1.0 - sum).max(0.0) } else { 0.0 };
    let variance = events * (1.0 - continuation).powi(2) + survivors * continuation.powi(2);
    Texel { values: [sum, a[0]], stderr: [variance.sqrt(), error[0]] }
}

/// Columns of one bake: 95th percentiles of the stated error and of the errors of Σ a_k and a_0, RMS of both.
fn columns(found: &Found, truth: &Found) -> [f64; 5] {
    let percentile = |mut v: Vec<f64>| {
        v.sort_by(f64::total_cmp);
        v[(0.95 * (v.len() - 1) as f64).round() as usize]
    };
    let errors = |which: usize| -> Vec<f64> {
        found.texels.iter().zip(&truth.texels).map(|(f, t)| (f.values[which] - t.values[which]).abs()).collect()
    };
    let rms = |v: &[f64]| (v.iter().map(|e| e * e).sum::<f64>() / v.len() as f64).sqrt();
    let (sum, openness) = (errors(0), errors(1));
    let (rms_sum, rms_openness) = (rms(&sum), rms(&openness));
    let stated = found.texels.iter().map(|t| t.stderr[0].max(t.stderr[1])).collect();
    [percentile(stated), percentile(sum), percentile(openness), rms_sum, rms_openness]
}

/// Mean of the error of a number, and the standard error of that mean.
fn bias(found: &Found, truth: &Found, which: usize) -> (f64, f64) {
    let all = found.texels.iter().zip(&truth.texels).map(|(f, t)| f.values[which] - t.values[which]);
    let running: isolume::sampling::statistics::Running = all.collect();
    (running.mean(), running.standard_error())
}

/// Rays with which the ladder (rays, value) reaches `value`; `None` beyond its ends and where it does not fall, as
/// where all that is left is the rounding of the store.
fn rays_at(ladder: &[(f64, f64)], value: f64) -> Option<f64> {
    let between = ladder.windows(2).find(|p| (p[1].1..=p[0].1).contains(&value) && p[1].1 < 0.9 * p[0].1)?;
    let ((n0, v0), (n1, v1)) = (between[0], between[1]);
    Some((n0.ln() + (n1 / n0).ln() * (value / v0).ln() / (v1 / v0).ln()).exp())
}

fn main() -> isolume::Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize, default: usize| args.get(i).and_then(|s| s.parse().ok()).unwrap_or(default);
    let (count, reference) = (number(0, 20_000), number(1, 16_384) as u32);
    let data = std::env::var("ISOLUME_DATA").unwrap_or_else(|_| "../shared/data".into());
    let real = ["mni152_t1.nii.gz", "caffeine_density.nrrd"].map(|name| format!("{data}/volumes/{name}"));
    let names: Vec<String> = if args.len() > 2 { args[2..].to_vec() } else { real.to_vec() };
    const NAMES: &str = "p95_stated,p95_sum,p95_a0,rms_sum,rms_a0";
    println!("volume,bake,setting,rays,{NAMES},bias_sum,bias_sum_stderr,bias_a0,bias_a0_stderr");
    let mut shares = Vec::new();
    for path in &names {
        let volume = match isolume::volume::field::by_name(path)? {
            Some(field) => field.sample()?,
            None => isolume::volume::open(Path::new(path))?,
        };
        let scene = Scene::new(volume, count)?;
        let name = path.rsplit('/').next().unwrap_or(path);
        let truth = scene.bake(reference, None, 1_000_001)?;
        let report = |found: &Found| {
            let c = columns(found, &truth);
            let (sum, openness) = (bias(found, &truth, 0), bias(found, &truth, 1));
            let list: Vec<String> = c.iter().map(|v| format!("{v:.5}")).collect();
            println!(
                "{name},{},{:.1},{},{:.5},{:.5},{:.5},{:.5}",
                found.label,
                found.rays,
                list.join(","),
                sum.0,
                sum.1,
                openness.0,
                openness.1
            );
            (found.rays, c)
        };
        let mut ladder = Vec::new();
        let mut sigma = Vec::new();
        for rays in (4..=13).map(|k| 1 << k) {
            let found = scene.bake(rays, None, 1)?;
            ladder.push(report(&found));
            sigma = found.texels.iter().map(|t| t.stderr).collect();
        }
        // Each target with a generous cap, and with the cap at which uniform sampling has its 95th percentile there: the
        // hardest texels, which no percentile asks for, then get no more than they would.
        let capped = (5..=12).map(|k| (ladder[k - 4].1[0] as f32, 1u32 << k));
        for (target, most) in TARGETS.map(|target| (target, 4096)).into_iter().chain(capped) {
            let (rays, c) = report(&scene.bake(most, Some(target), 1)?);
            let share: Vec<String> = (0..5)
                .map(|i| {
                    let column: Vec<(f64, f64)> = ladder.iter().map(|(n, c)| (*n, c[i])).collect();
                    rays_at(&column, c[i]).map_or("-".into(), |uniform| format!("{:.2}", rays / uniform))
                })
                .collect();
            shares.push(format!("{name},{target:.4},{most},{rays:.1},{}", share.join(",")));
        }
        for (which, number) in ["sum", "a0"].into_iter().enumerate() {
            let n = sigma.len() as f64;
            let mean = sigma.iter().map(|s| s[which]).sum::<f64>() / n;
            let square = sigma.iter().map(|s| s[which].powi(2)).sum::<f64>() / n;
            shares.push(format!("{name},limit rms_{number},,,{:.2}", mean * mean / square));
        }
    }
    println!("\nvolume,target,most paths,rays,share of uniform rays at equal {NAMES}");
    shares.iter().for_each(|line| println!("{line}"));
    Ok(())
}
