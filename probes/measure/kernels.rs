//! How fast the small parts are: points, warps, basis, certificates, extraction, the store.
//!
//! `cargo run --release --example measure-kernels [-- DIRECTORY]`; with a directory it also writes and reads a store of
//! 2.6 GB there (256³ texels of bands 5, 4, 3, 3), and removes it.

use glam::Vec3;
use half::f16;
use isolume::sampling::{PathSampler, warp};
use isolume::sh::{Coefficients, basis, certified};
use isolume::surface::extract;
use isolume::transfer::store::{ChunkExtent, Identity, Store};
use isolume::transfer::{Brick, BrickSource, Lattice, Layers, Layout};
use isolume::volume::field;
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

/// Best of `runs` times of `work`, in seconds.
fn best(runs: usize, mut work: impl FnMut()) -> f64 {
    let time = |_| {
        let start = Instant::now();
        work();
        start.elapsed().as_secs_f64()
    };
    (0..runs).map(time).fold(f64::INFINITY, f64::min)
}

fn main() -> isolume::Result<()> {
    points_and_warps();
    basis_and_certificates()?;
    extraction()?;
    if let Some(directory) = std::env::args().nth(1) {
        store(Path::new(&directory))?;
    }
    Ok(())
}

fn points_and_warps() {
    let n = 1u32 << 14;
    let sampler = PathSampler::new(black_box(1), 2, 3);
    let single = best(9, || {
        for i in 0..n / 4 {
            for pair in 0..4 {
                black_box(sampler.pair(i, pair));
            }
        }
    });
    let mut points = [[0.0; 2]; 64];
    let batch = best(9, || {
        for first in (0..n).step_by(64) {
            sampler.fill_pairs(first & 3, first, &mut points);
            black_box(&mut points);
        }
    });
    let hemisphere = best(9, || {
        for i in 0..n {
            black_box(warp::square_to_cosine_hemisphere(black_box(points[i as usize % 64])));
        }
    });
    let ns = 1e9 / f64::from(n);
    println!(
        "pair {:.1} ns, in batches of 64 {:.1} ns, cosine hemisphere {:.1} ns",
        single * ns,
        batch * ns,
        hemisphere * ns
    );
}

fn basis_and_certificates() -> isolume::Result<()> {
    let mut points = [[0.0; 2]; 1024];
    PathSampler::new(1, 2, 3).fill_pairs(0, 0, &mut points);
    let directions: Vec<Vec3> = points.map(warp::square_to_uniform_sphere).to_vec();
    for bands in [3, 5, 11] {
        let mut sums = vec![0.0; basis::count(bands)];
        let times = [16, 64, 1024].map(|batch| {
            let seconds = best(9, || {
                for _ in 0..20 {
                    for part in black_box(&directions).chunks(batch) {
                        basis::accumulate(bands, part, &mut sums);
                    }
                }
            });
            format!("{:.2}", 1e9 * seconds / (20.0 * directions.len() as f64))
        });
        println!("basis, {bands} bands: {} ns a direction in batches of 16, 64, 1024", times.join(", "));
        let sun = Coefficients::delta(bands, glam::DVec3::new(0.6, 0.0, 0.8));
        let mut result = Ok(());
        let seconds = best(3, || result = certified::certify(std::slice::from_ref(&sun)).map(|_| ()));
        result?;
        println!("certificate, {bands} bands, one channel: {:.1} ms", 1e3 * seconds);
    }
    Ok(())
}

fn extraction() -> isolume::Result<()> {
    let Some(named) = field::by_name("gyroid:256")? else { return Ok(()) };
    let volume = named.sample()?;
    let cells: f64 = volume.dims().iter().map(|d| (d - 1) as f64).product();
    let mut vertices = 0;
    let mut result = Ok(());
    let seconds = best(5, || result = extract(&volume, 0.0).map(|mesh| vertices = mesh.positions_in_grid.len()));
    result?;
    println!(
        "extraction, gyroid 256³: {vertices} vertices in {:.1} ms, {:.0} Mcells/s",
        1e3 * seconds,
        1e-6 * cells / seconds
    );
    Ok(())
}

fn store(directory: &Path) -> isolume::Result<()> {
    let path = directory.join("measure-kernels.isolume");
    let Some(named) = field::by_name("gyroid:256")? else { return Ok(()) };
    let volume = named.sample()?;
    let layers = Layers::new(vec![5, 4, 3, 3])?;
    let layout = Layout { lattice: Lattice::from_ratio(volume.dims(), 1.0)?, layers: layers.clone() };
    let identity = Identity::new(&volume, &layout, "path", false, 0);
    let store = Store::create(&path, &volume, &identity, serde_json::Value::Null)?;
    let mut brick = Brick::unbaked(&layers);
    for (i, v) in brick.transfer.iter_mut().enumerate() {
        *v = f16::from_bits((i as u16).wrapping_mul(40_503));
    }
    let extent = ChunkExtent::new(None, 64, None);
    let megabytes = (1 << 24) as f64 * (2 * layers.coefficients() + 2 * layers.errors() + 5) as f64 / 1e6;
    let mut seconds = 0.0;
    for index in (0..512).map(|i| [i % 8, i / 8 % 8, i / 64]) {
        let bricks = vec![Some(brick.clone()); 64];
        let start = Instant::now();
        store.write_chunk(index, bricks, &extent)?;
        seconds += start.elapsed().as_secs_f64();
    }
    println!("store, write: {megabytes:.0} MB, {:.0} MB/s", megabytes / seconds);
    let store = Store::open(&path)?;
    for what in ["first touch, checksums verified", "again"] {
        let start = Instant::now();
        for index in (0..32_768).map(|i| [i % 32, i / 32 % 32, i / 1024]) {
            black_box(store.brick(index)?.map(|view| view.transfer.iter().fold(0u16, |sum, v| sum ^ v.to_bits())));
        }
        println!("store, read, {what}: {:.0} MB/s of all it holds", megabytes / start.elapsed().as_secs_f64());
    }
    drop(store);
    std::fs::remove_dir_all(&path).map_err(|e| isolume::Error::io(&path, "remove the store", e))
}
