//! How fast the transport fills a texture, without storing it.
//!
//! `cargo run --release --example measure-bake -- VOLUME [RAYS] [LAYERS] [RATIO] [ERROR]`

use isolume::level::Pyramid;
use isolume::transfer::{Lattice, Layers, Layout, Selection};
use isolume::transport::{Bake, Progress, Settings, Target, bake};
use std::path::Path;
use std::time::Instant;

fn main() -> isolume::Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize, default: f64| args.get(i).and_then(|s| s.parse().ok()).unwrap_or(default);
    let name = args.first().map_or("bumpbox:64", String::as_str);
    let start = Instant::now();
    let volume = match isolume::volume::field::by_name(name)? {
        Some(field) => field.sample()?,
        None => isolume::volume::open(Path::new(name))?,
    };
    let read = start.elapsed().as_secs_f64();
    let pyramid = Pyramid::new(&volume);
    let settings = Settings {
        layers: Layers::uniform(number(2, 4.0) as usize, 5)?,
        rays: number(1, 64.0) as u32,
        seed: 1,
        positive: false,
        target: None,
    };
    let target = number(4, 0.0) as f32;
    let settings = match target {
        0.0 => settings,
        error => Settings { target: Some(Target::escape(&settings.layers, error)), ..settings },
    };
    let lattice = Lattice::from_ratio(volume.dims(), number(3, 1.0))?;
    let layout = Layout { lattice, layers: settings.layers.clone() };
    let selection = Selection::all(lattice);
    let job = Bake::new(&volume, &pyramid, &layout, &settings, &selection);
    let start = Instant::now();
    let mut bytes = 0usize;
    let summary = bake(&job, &job.chunks(), &Progress::default(), &|_| Ok(None), &mut |_, bricks| {
        bytes += bricks.iter().flatten().flatten().map(|b| 2 * (b.transfer.len() + b.stderr.len())).sum::<usize>();
        Ok(())
    })?;
    let seconds = start.elapsed().as_secs_f64();
    let c = summary.counts;
    let per_ray = |n: u64| n as f64 / c.rays.max(1) as f64;
    println!("volume {name} {:?}, read {read:.2} s, threads {}", volume.dims(), rayon::current_num_threads());
    println!("texels {} valid {} clamped {}", summary.texels, summary.valid, summary.clamped);
    println!(
        "{seconds:.2} s, {} rays, {:.3} Mrays/s, {:.2} us/texel, {:.1} MB",
        c.rays,
        c.rays as f64 / seconds / 1e6,
        seconds * 1e6 / summary.valid.max(1) as f64,
        bytes as f64 / 1e6
    );
    println!("per ray: {:.2} nodes, {:.2} cells, {:.2} solves", per_ray(c.nodes), per_ray(c.cells), per_ray(c.solves));
    println!("a_k {:?}, lost {:.5}", summary.mean_escapes(), summary.lost_share());
    println!(
        "paths a texel {:.1}; standard error of sum a_k: median {:.4}, 95th percentile {:.4}, largest {:.4}, RMS {:.5}",
        summary.paths as f64 / summary.valid.max(1) as f64,
        summary.errors.quantile(0.5),
        summary.errors.quantile(0.95),
        summary.errors.quantile(1.0),
        summary.escape_stderr_rms()
    );
    Ok(())
}
