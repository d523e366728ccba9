//! What a relight states of its error against what paths find, under many random environments.
//!
//! `cargo run --release --example measure-environments -- [ENVIRONMENTS] [LAMPS_EVERY] [RAYS] [VOLUME ISOVALUE]…`
//! (10000, 100, 64, `bumpbox:32 47 gyroid:24 0`)
//!
//! An environment is a sum of one to six of 48 images: wide and narrow lobes, horizons, ramps and noise, of random colours, places and
//! strengths over four decades. Radiance is linear in it, so that paths under each of the images, in two halves, tell the truth under
//! every sum: the mean square of the error is that of the products of the differences to both halves. Lamps stay in the light but for
//! each LAMPS_EVERY-th environment, which is lit as by default. Prints CSV: quantiles of stated over measured root mean square, how
//! many were below a third, and how many were not finite.

use isolume::bake::Bake;
use isolume::probe::{EnvironmentSource, LatLong, Orientation, Probe, SunSplit};
use isolume::relight::Material;
use isolume::sampling::DirectionalSource;
use isolume::sampling::hash::uniform;
use isolume::scene::Scene;
use isolume::session::{LightOptions, LitOptions, Session};
use isolume::transport::{Radiance, SceneReference, SurfacePoint, direct};
use isolume::{Result, Silent};

const IMAGES: usize = 48;
const POINTS: usize = 160;
const PATHS: u32 = 2048;
const ALBEDO: f32 = 0.7;
const SIZE: [usize; 2] = [64, 32];

/// A number of an item in [0, 1).
fn number(item: usize, which: u32) -> f64 {
    f64::from(uniform(2026, item as u64, which, 0))
}

fn from_fn(radiance: impl Fn(usize, usize) -> [f64; 3]) -> Result<LatLong> {
    let [width, height] = SIZE;
    let pixels = (0..width * height).map(|i| radiance(i % width, i / width).map(|v| v as f32)).collect();
    LatLong::new(width, height, pixels)
}

/// One of the images: radiance of a mean of about 1.
fn image(i: usize) -> Result<LatLong> {
    let colour = [0, 1, 2].map(|c| 0.2 + number(i, c));
    let z = 2.0 * number(i, 3) - 1.0;
    let azimuth = std::f64::consts::TAU * number(i, 4);
    let axis = [(1.0 - z * z).sqrt() * azimuth.cos(), (1.0 - z * z).sqrt() * azimuth.sin(), z];
    let concentration = 10f64.powf(3.0 * number(i, 5));
    from_fn(|x, y| {
        let theta = std::f64::consts::PI * (y as f64 + 0.5) / SIZE[1] as f64;
        let phi = std::f64::consts::TAU * (x as f64 + 0.5) / SIZE[0] as f64;
        let direction = [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()];
        let cosine: f64 = axis.iter().zip(direction).map(|(a, d)| a * d).sum();
        let strength = match i % 6 {
            0 | 1 => concentration.max(1.0) * (concentration * (cosine - 1.0)).exp(),
            2 => f64::from(u8::from(cosine > number(i, 6) - 0.5)),
            3 => (1.0 + cosine).max(0.0),
            4 => 2.0 * number(IMAGES + i, (x / 4 + 16 * (y / 4)) as u32),
            _ => 200.0 * (400.0 * (cosine - 1.0)).exp(),
        };
        colour.map(|c| c * strength)
    })
}

/// What is added up: images with their strengths.
fn parts(environment: usize) -> Vec<(usize, f64)> {
    let item = 1000 + environment;
    let count = 1 + (6.0 * number(item, 0)) as usize;
    let part =
        |k: u32| ((IMAGES as f64 * number(item, 1 + 2 * k)) as usize, 10f64.powf(4.0 * number(item, 2 + 2 * k) - 2.0));
    (0..count as u32).map(part).collect()
}

struct Row {
    ratios: Vec<f64>,
    not_finite: usize,
}

impl Row {
    fn print(mut self, name: &str, lamps: &str) {
        self.ratios.sort_by(f64::total_cmp);
        let n = self.ratios.len();
        let at = |q: f64| self.ratios[((n - 1) as f64 * q) as usize];
        let below = self.ratios.iter().filter(|r| **r < 1.0 / 3.0).count();
        let quantiles: Vec<String> = [0.0, 0.01, 0.05, 0.5, 0.95, 0.99, 1.0].map(|q| format!("{:.3}", at(q))).to_vec();
        println!("{name},{lamps},{n},{},{below},{}", quantiles.join(","), self.not_finite);
    }
}

fn measure(spec: &str, isovalue: f64, environments: usize, lamps_every: usize, rays: u32) -> Result<()> {
    let folder = tempfile::tempdir()
        .map_err(|e| isolume::Error::argument("folder", e, "a folder to write in", "free some space"))?;
    let scene = Scene::open(spec)?;
    let (store, _) = Bake::of(&scene).isovalues([isovalue]).rays(rays).run(folder.path().join("x.isolume"), &Silent)?;
    let session = Session::open(&store)?;
    let surface = session.surface(isovalue)?;
    let (member, mesh) = (&session.members()[0], surface.parts()[0].isosurface().mesh());
    let picked: Vec<usize> = (0..mesh.normals.len()).step_by((mesh.normals.len() / POINTS).max(1)).collect();
    let point = |&v: &usize| SurfacePoint { position_in_grid: mesh.positions_in_grid[v], normal: mesh.normals[v] };
    let points: Vec<SurfacePoint> = picked.iter().map(point).collect();
    let orientation = Orientation::new(session.up(), 0.0)?;
    let images: Vec<LatLong> = (0..IMAGES).map(image).collect::<Result<_>>()?;
    let sources: Vec<EnvironmentSource<'_>> = images.iter().map(|i| EnvironmentSource::new(i, orientation)).collect();
    let sources: Vec<&dyn DirectionalSource> = sources.iter().map(|s| s as _).collect();
    let truth = |seed: u64| -> Result<Vec<Vec<Radiance>>> {
        let settings = SceneReference::new(PATHS, [ALBEDO; 3], seed);
        Ok(direct(member.volume(), member.pyramid(), None, isovalue, &points, &sources, &settings)?.0)
    };
    let halves = [truth(1)?, truth(2)?];
    let material = Material::new([ALBEDO; 3], [0.0; 3])?;
    let mut rows = [false, true].map(|_| Row { ratios: Vec::new(), not_finite: 0 });
    for environment in 0..environments {
        let parts = parts(environment);
        let sum = from_fn(|x, y| {
            let of = |c: usize| parts.iter().map(|&(i, w)| w * f64::from(images[i].row(y)[x][c])).sum();
            [of(0), of(1), of(2)]
        })?;
        let probe = Probe::from_image(format!("{environment}"), sum);
        let apart = lamps_every > 0 && environment % lamps_every == 0;
        for with_lamps in [false, true].into_iter().take(1 + usize::from(apart)) {
            let mut options = LightOptions::default();
            options.split_sun = if with_lamps { SunSplit::Auto } else { SunSplit::Off };
            let light = session.light(&probe, &options)?;
            if with_lamps && light.suns().is_empty() {
                continue;
            }
            let lit = surface.lit(&light, &material, &LitOptions::default())?;
            let (mut square, mut mean) = (0.0, 0.0);
            for (k, &v) in picked.iter().enumerate() {
                for c in 0..3 {
                    let under = |half: usize| parts.iter().map(|&(i, w)| w * halves[half][i][k].mean[c]).sum::<f64>();
                    let (found, a, b) = (f64::from(lit.radiance()[v][c]), under(0), under(1));
                    square += (found - a) * (found - b);
                    mean += 0.5 * (a + b);
                }
            }
            let count = (3 * picked.len()) as f64;
            let measured = (square.max(0.0) / count).sqrt() / (mean / count);
            let row = &mut rows[usize::from(with_lamps)];
            match lit.total_error() {
                // Paths that cannot tell it from none say nothing of it.
                Some(total) if total.rms.is_finite() => {
                    row.ratios.extend((measured > 0.0).then(|| total.rms / measured))
                }
                _ => row.not_finite += 1,
            }
        }
    }
    let [without, with] = rows;
    without.print(spec, "in the light");
    if !with.ratios.is_empty() {
        with.print(spec, "apart");
    }
    Ok(())
}

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize, default: usize| args.get(i).and_then(|s| s.parse().ok()).unwrap_or(default);
    let (environments, lamps_every, rays) = (number(0, 10_000), number(1, 100), number(2, 64) as u32);
    let named: Vec<&str> = args.iter().skip(3).map(String::as_str).collect();
    let named = if named.is_empty() { vec!["bumpbox:32", "47", "gyroid:24", "0"] } else { named };
    println!("volume,lamps,environments,lowest,1 %,5 %,median,95 %,99 %,highest,below a third,not finite");
    for pair in named.chunks_exact(2) {
        measure(pair[0], pair[1].parse().unwrap_or(0.0), environments, lamps_every, rays)?;
    }
    Ok(())
}
