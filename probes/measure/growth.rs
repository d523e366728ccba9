//! How the cost of a bake grows with the side of the volume and with the rays of a texel.
//!
//!     cargo run --release --example measure-growth [-- PATHS [FIELD…]]     (1048576, bumpbox and gyroid)
//!
//! Each figure is a process of its own, so that the peak of its memory is its own. A run bakes whole bricks that a hash
//! picks, as many as give about PATHS paths, through the same loop as `isolume bake`: so a figure takes a second or two
//! at every size, and texels meet the caches as in a bake. Prints CSV, then fitted exponents: of processor time a
//! path over the side, of the march (nodes and cells) over the side, of time a step of the march, of time a texel
//! over the rays, of memory over the side.

use cpu_time::ProcessTime;
use isolume::level::Pyramid;
use isolume::sampling::hash::uniform;
use isolume::transfer::{BRICK, Lattice, Layers, Layout, Selection};
use isolume::transport::{Bake, Progress, Settings, bake};
use isolume::volume::field;
use std::error::Error;
use std::time::Instant;

const SIDES: [usize; 6] = [64, 96, 128, 192, 256, 384];
const RAYS: [u32; 4] = [16, 64, 256, 1024];
/// Rays of the runs over the side, side of the runs over rays.
const MIDDLE: (u32, usize) = (64, 128);

/// One run; everything is printed in the order of [`COLUMNS`].
struct Row {
    side: f64,
    rays: f64,
    figures: [f64; 9],
}

const COLUMNS: &str = "field,side,rays,texels,paths,traced_rays,wall_s,cpu_s,nodes,cells,solves,peak_mb";

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [flag, field, side, rays, paths] = &arguments[..]
        && flag == "--one"
    {
        return one(field, side.parse()?, rays.parse()?, paths.parse()?);
    }
    let paths = arguments.first().map_or("1048576", String::as_str);
    let fields: Vec<&str> = arguments.iter().skip(1).map(String::as_str).collect();
    let fields = if fields.is_empty() { vec!["bumpbox", "gyroid"] } else { fields };
    println!("{COLUMNS}");
    for field in fields {
        let run = |side: usize, rays: u32| child(field, side, rays, paths);
        let by_side = SIDES.iter().map(|&side| run(side, MIDDLE.0)).collect::<Result<Vec<_>, _>>()?;
        let by_rays = RAYS.iter().map(|&rays| run(MIDDLE.1, rays)).collect::<Result<Vec<_>, _>>()?;
        // Places of the figures, as in COLUMNS after the rays.
        let (texels, paths_traced, traced, cpu, nodes, cells, peak) = (0, 1, 2, 4, 5, 6, 8);
        let over_side = |of: &dyn Fn(&Row) -> f64| slope(by_side.iter().map(|r| (r.side, of(r))));
        println!(
            "# {field}: exponents over the side: CPU a path {:.2}, CPU a ray {:.2}, steps (nodes and cells) a ray {:.2}, \
             CPU a step {:.2}, peak memory {:.2}; over rays: CPU a texel {:.2}",
            over_side(&|r| r.figures[cpu] / r.figures[paths_traced]),
            over_side(&|r| r.figures[cpu] / r.figures[traced]),
            over_side(&|r| (r.figures[nodes] + r.figures[cells]) / r.figures[traced]),
            over_side(&|r| r.figures[cpu] / (r.figures[nodes] + r.figures[cells])),
            over_side(&|r| r.figures[peak]),
            slope(by_rays.iter().map(|r| (r.rays, r.figures[cpu] / r.figures[texels]))),
        );
    }
    Ok(())
}

/// Runs one figure in a process of its own and passes its line on.
fn child(field: &str, side: usize, rays: u32, paths: &str) -> Result<Row, Box<dyn Error>> {
    let arguments = ["--one", field, &side.to_string(), &rays.to_string(), paths];
    let done = std::process::Command::new(std::env::current_exe()?).args(arguments).output()?;
    let line = String::from_utf8(done.stdout)?;
    if !done.status.success() {
        return Err(String::from_utf8_lossy(&done.stderr).into_owned().into());
    }
    print!("{line}");
    let numbers = line.trim().split(',').skip(3).map(str::parse).collect::<Result<Vec<f64>, _>>()?;
    let figures = numbers.try_into().map_err(|_| "a line of other columns")?;
    Ok(Row { side: side as f64, rays: f64::from(rays), figures })
}

fn one(name: &str, side: usize, rays: u32, paths: u64) -> Result<(), Box<dyn Error>> {
    let named = field::by_name(&format!("{name}:{side}"))?.ok_or("no such field")?;
    let volume = named.sample()?;
    let pyramid = Pyramid::new(&volume);
    let layers = Layers::uniform(4, 5)?;
    let settings = Settings { layers: layers.clone(), rays, seed: 1, positive: false, target: None };
    let lattice = Lattice::from_ratio(volume.dims(), 1.0)?;
    let layout = Layout { lattice, layers };
    let selection = some_bricks(lattice, paths / u64::from(rays));
    let job = Bake::new(&volume, &pyramid, &layout, &settings, &selection);
    let (wall, processor) = (Instant::now(), ProcessTime::now());
    let summary = bake(&job, &job.chunks(), &Progress::default(), &|_| Ok(None), &mut |_, _| Ok(()))?;
    let (wall, cpu) = (wall.elapsed().as_secs_f64(), processor.elapsed().as_secs_f64());
    let c = summary.counts;
    println!(
        "{name},{side},{rays},{},{},{},{wall:.3},{cpu:.3},{},{},{},{:.1}",
        summary.valid,
        summary.paths,
        c.rays,
        c.nodes,
        c.cells,
        c.solves,
        peak_megabytes()
    );
    Ok(())
}

/// Whole bricks picked by a hash, about as many as hold the given number of texels, at least one.
fn some_bricks(lattice: Lattice, texels: u64) -> Selection {
    let [nx, ny, nz] = lattice.bricks();
    let [mx, my, mz] = lattice.texels();
    let share = texels as f64 / (mx * my * mz) as f64;
    let mut order: Vec<usize> = (0..nx * ny * nz).collect();
    let wanted = ((share * order.len() as f64).round() as usize).clamp(1, order.len());
    order.sort_by_key(|&b| (uniform(1, b as u64, 0, 0).to_bits(), b));
    let mut selection = Selection::empty(lattice);
    for b in &order[..wanted] {
        let corner = [b % nx, b / nx % ny, b / nx / ny].map(|i| i * BRICK);
        for t in 0..BRICK * BRICK * BRICK {
            let inner = [t % BRICK, t / BRICK % BRICK, t / BRICK / BRICK];
            selection.insert(std::array::from_fn(|a| corner[a] + inner[a]));
        }
    }
    selection
}

/// Peak of the resident memory of this process; not a number where the system does not tell.
fn peak_megabytes() -> f64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = text.lines().find(|l| l.starts_with("VmHWM:"));
    line.and_then(|l| l.split_whitespace().nth(1)?.parse::<f64>().ok()).unwrap_or(f64::NAN) / 1e3
}

/// Slope of a line through the logarithms, by least squares.
fn slope(points: impl Iterator<Item = (f64, f64)>) -> f64 {
    let points: Vec<[f64; 2]> = points.map(|(x, y)| [x.ln(), y.ln()]).collect();
    let n = points.len() as f64;
    let mean = [0, 1].map(|i| points.iter().map(|p| p[i]).sum::<f64>() / n);
    let product = |i: usize| points.iter().map(|p| (p[0] - mean[0]) * (p[i] - mean[i])).sum::<f64>();
    product(1) / product(0)
}
