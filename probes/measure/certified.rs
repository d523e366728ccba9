//! Whether certified light is really nowhere negative, over many skies and directions.
//!
//! `cargo run --release --example measure-certified -- [SKIES] [DIRECTIONS]` (10000, 100000)
//!
//! Sky i has 1 + i mod 11 bands and is of kind i mod 5: random texels over 24 EV, one texel of 10⁶, a sun on
//! an axis (±x, ±y, ±z), constant, two opposite suns. For each band count the table gives the least
//! radiance found over the channel's mean, the least proven floor, and what the window kept of the
//! contrast. Ends with an error when the least is below −1e-9 of the mean or any number is not finite.

use glam::DVec3;
use isolume::probe::{LatLong, project};
use isolume::relight::prepare;
use isolume::sampling::hash::uniform;
use isolume::sh::{Coefficients, MAX_BANDS, Window, basis};
use isolume::transfer::Layers;
use rayon::prelude::*;
use std::time::Instant;

fn random(sky: u64, sample: u32, dimension: u32) -> f64 {
    f64::from(uniform(2026, sky, sample, dimension))
}

fn direction(u: f64, v: f64) -> DVec3 {
    let z = 1.0 - 2.0 * u;
    let (sine, cosine) = (2.0 * std::f64::consts::PI * v).sin_cos();
    let r = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(r * cosine, r * sine, z)
}

fn suns(bands: usize, suns: &[(DVec3, [f64; 3])], ambient: f64) -> [Coefficients; 3] {
    std::array::from_fn(|c| {
        let mut sum = Coefficients::constant(bands, ambient);
        for (towards, rgb) in suns {
            sum += &(&Coefficients::delta(bands, *towards) * rgb[c]);
        }
        sum
    })
}

fn image(sky: u64, bands: usize, texel: impl Fn(usize) -> [f64; 3]) -> isolume::Result<[Coefficients; 3]> {
    let width = 1 + (random(sky, 0, 10) * 32.0) as usize;
    let height = 1 + (random(sky, 0, 11) * 16.0) as usize;
    let bright = (random(sky, 0, 12) * (width * height) as f64) as usize;
    // Sky kinds address texels relative to the bright one.
    let pixels = (0..width * height).map(|i| texel(i.abs_diff(bright)).map(|v| v as f32)).collect();
    Ok(project(&LatLong::new(width, height, pixels)?, bands))
}

fn sky(i: u64, bands: usize) -> isolume::Result<[Coefficients; 3]> {
    let ambient = if random(i, 1, 0) < 0.5 { 0.0 } else { random(i, 1, 1) };
    let towards = direction(random(i, 2, 0), random(i, 2, 1));
    Ok(match i % 5 {
        0 => image(i, bands, |t| std::array::from_fn(|c| (24.0 * random(i, 3 + t as u32, c as u32) - 12.0).exp2()))?,
        1 => image(i, bands, |t| if t == 0 { [1e6, 1e3, 0.0] } else { [ambient; 3] })?,
        2 => {
            let axis = [DVec3::X, DVec3::Y, DVec3::Z, -DVec3::X, -DVec3::Y, -DVec3::Z][(i / 5 % 6) as usize];
            suns(bands, &[(axis, [1.0, 0.5, 1e4])], ambient)
        }
        3 => suns(bands, &[], random(i, 1, 2) * 1e3),
        _ => suns(bands, &[(towards, [1.0, 0.3, 2.0]), (-towards, [1.0; 3])], ambient),
    })
}

/// Directions evaluated together.
const BLOCK: usize = 64;

struct Outcome {
    bands: usize,
    least: f64,
    floor: f64,
    contrast: f64,
    finite: bool,
}

fn judge(i: u64, basis_of: &[Vec<f64>]) -> isolume::Result<Outcome> {
    let bands = 1 + (i % MAX_BANDS as u64) as usize;
    let channels = sky(i, bands)?;
    let prepared = prepare(&channels, &Layers::uniform(1, bands)?, Window::Certified)?;
    let window = &prepared.windows[0];
    let light = prepared.light.coefficients(0);
    let (mut least, mut finite) = (f64::INFINITY, window.factors.iter().all(|f| f.is_finite()));
    let means: [f64; 3] = std::array::from_fn(|c| light[0][c] / (4.0 * std::f64::consts::PI).sqrt());
    for block in basis_of {
        let mut values = [[0.0; BLOCK]; 3];
        for (l, y) in light.iter().zip(block.as_chunks::<BLOCK>().0) {
            for c in 0..3 {
                for d in 0..BLOCK {
                    values[c][d] += l[c] * y[d];
                }
            }
        }
        for c in 0..3 {
            for value in values[c] {
                finite &= value.is_finite();
                // A black channel must be exactly black.
                least =
                    least.min(if means[c] > 0.0 { value / means[c] } else { 1.0 - value.abs() / f64::MIN_POSITIVE });
            }
        }
    }
    Ok(Outcome { bands, least, floor: window.floor, contrast: window.kept.contrast, finite })
}

fn main() -> isolume::Result<()> {
    let args: Vec<usize> = std::env::args().skip(1).filter_map(|s| s.parse().ok()).collect();
    let (skies, directions) = (args.first().copied().unwrap_or(10_000), args.get(1).copied().unwrap_or(100_000));
    let start = Instant::now();
    // The basis once for all skies, in blocks of directions, coefficient by coefficient: fewer bands are a
    // prefix. The axes come first.
    let axes = [DVec3::X, DVec3::Y, DVec3::Z, -DVec3::X, -DVec3::Y, -DVec3::Z];
    let golden = 0.5 * (5.0f64.sqrt() - 1.0);
    let basis_of: Vec<Vec<f64>> = (0..directions.div_ceil(BLOCK))
        .into_par_iter()
        .map(|block| {
            let mut values = vec![0.0; BLOCK * MAX_BANDS * MAX_BANDS];
            let mut y = [0.0; MAX_BANDS * MAX_BANDS];
            for lane in 0..BLOCK {
                let d = block * BLOCK + lane;
                let spiral = direction((d as f64 + 0.5) / directions as f64 % 1.0, d as f64 * golden % 1.0);
                basis::evaluate(MAX_BANDS, axes.get(d).copied().unwrap_or(spiral).to_array(), &mut y);
                for (i, y) in y.iter().enumerate() {
                    values[i * BLOCK + lane] = *y;
                }
            }
            values
        })
        .collect();
    let outcomes: Vec<Outcome> =
        (0..skies as u64).into_par_iter().map(|i| judge(i, &basis_of)).collect::<isolume::Result<_>>()?;
    println!("bands,skies,least_over_mean,least_floor_over_mean,median_contrast_kept,not_finite");
    let mut bad = 0;
    for bands in 1..=MAX_BANDS {
        let of: Vec<&Outcome> = outcomes.iter().filter(|o| o.bands == bands).collect();
        let least = of.iter().fold(f64::INFINITY, |m, o| m.min(o.least));
        let floor = of.iter().fold(f64::INFINITY, |m, o| m.min(o.floor));
        let mut contrast: Vec<f64> = of.iter().map(|o| o.contrast).collect();
        contrast.sort_by(f64::total_cmp);
        let not_finite = of.iter().filter(|o| !o.finite).count();
        bad += not_finite + of.iter().filter(|o| o.least < -1e-9).count();
        let median = contrast.get(contrast.len() / 2).copied().unwrap_or(1.0);
        println!("{bands},{},{least:.3e},{floor:.3e},{median:.4},{not_finite}", of.len());
    }
    eprintln!("{skies} skies, {directions} directions, {:.1} s", start.elapsed().as_secs_f64());
    if bad > 0 {
        eprintln!("{bad} skies are negative or not finite");
        std::process::exit(1);
    }
    Ok(())
}
