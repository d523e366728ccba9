//! Rays per second on a level set against Embree on the extracted mesh of the same surface, on the same rays.
//!
//! `cargo run --release --example measure-race -- VOLUME ISOVALUE [--rays N] [--repeat N] [--out DIR]`
//!
//! Rays start at random vertices of the extracted mesh (crossings of grid edges: they lie on the trilinear level set
//! and on the mesh alike), cosine-distributed about the surface normal. Two orders of the same rays: *scattered*, each ray
//! from another vertex anywhere, and *texel*, 64 rays of a vertex one after the other and vertices in blocks of 8³, as a
//! bake has them. One thread; processor time, median of the repetitions. With `--out` mesh, rays and distances
//! are written as raw little-endian numbers, and `race_embree.py DIR` runs Embree on them.

use cpu_time::ThreadTime;
use glam::Vec3;
use isolume::geom::Frame;
use isolume::level::{Counts, LevelField, Outcome, Pyramid, Start, trace_all};
use isolume::sampling::{hash, warp};
use isolume::volume::{Sample, SamplesView, Volume};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Rays from one vertex in the order of a bake.
const RAYS_PER_VERTEX: usize = 64;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [name, isovalue, ..] = args.as_slice() else {
        return Err("usage: measure-race VOLUME ISOVALUE [--rays N] [--repeat N] [--out DIR]".into());
    };
    let option = |flag: &str| args.iter().position(|a| a == flag).and_then(|i| args.get(i + 1));
    let number = |flag: &str, default: usize| option(flag).map_or(Ok(default), |s| s.parse());
    let (count, repeat) = (number("--rays", 1 << 20)?, number("--repeat", 5)?);
    let volume = match isolume::volume::field::by_name(name)? {
        Some(field) => field.sample()?,
        None => isolume::volume::open(Path::new(name))?,
    };
    let isovalue: f64 = isovalue.parse()?;
    let mesh = isolume::surface::extract(&volume, isovalue)?;
    let pyramid = Pyramid::new(&volume);
    let out = option("--out").map(PathBuf::from);
    if let Some(dir) = &out {
        std::fs::create_dir_all(dir)?;
        write(&dir.join("vertices.f32"), mesh.positions_in_grid.as_flattened())?;
        write(&dir.join("triangles.u32"), mesh.triangles.as_flattened())?;
    }
    println!("{name} {:?} at {isovalue}: {} triangles", volume.dims(), mesh.triangles.len());
    println!("order,rays,median_ns_cpu,least_ns_cpu,nodes,cells,solves,hit_share,lost_share");
    for order in ["scattered", "texel"] {
        let race = Race { volume: &volume, pyramid: &pyramid, isovalue, order, count, repeat, out: out.as_deref() };
        match volume.samples().view() {
            SamplesView::U8(s) => race.run(s, &mesh.positions_in_grid)?,
            SamplesView::I8(s) => race.run(s, &mesh.positions_in_grid)?,
            SamplesView::U16(s) => race.run(s, &mesh.positions_in_grid)?,
            SamplesView::I16(s) => race.run(s, &mesh.positions_in_grid)?,
            SamplesView::F32(s) => race.run(s, &mesh.positions_in_grid)?,
        }
    }
    Ok(())
}

/// One ray: start and direction, both in grid space.
struct Ray {
    start: Start,
    origin: Vec3,
    direction: Vec3,
}

struct Race<'a> {
    volume: &'a Volume,
    pyramid: &'a Pyramid,
    isovalue: f64,
    order: &'a str,
    count: usize,
    repeat: usize,
    out: Option<&'a Path>,
}

impl Race<'_> {
    fn run<T: Sample>(&self, samples: &[T], vertices: &[[f32; 3]]) -> std::io::Result<()> {
        let field = LevelField::new(self.volume, samples, self.pyramid);
        let rays = rays(&field, vertices, self.order, self.count);
        time(&field, self.volume.raw_from_value(self.isovalue) as f32, &rays, self)
    }
}

fn rays<T: Sample>(field: &LevelField<'_, T>, vertices: &[[f32; 3]], order: &str, count: usize) -> Vec<Ray> {
    let uniform = |i: usize, k: u32| hash::uniform(1, i as u64, 0, k);
    let per_vertex = if order == "texel" { RAYS_PER_VERTEX } else { 1 };
    let last = vertices.len() - 1;
    let mut picked: Vec<usize> =
        (0..count / per_vertex).map(|i| ((uniform(i, 2) * vertices.len() as f32) as usize).min(last)).collect();
    if order == "texel" {
        picked.sort_by_key(|&v| {
            let [x, y, z] = vertices[v].map(|p| p as u32);
            [z / 8, y / 8, x / 8, z, y, x]
        });
    }
    let mut rays = Vec::with_capacity(count);
    for (i, &v) in picked.iter().enumerate() {
        let origin = Vec3::from_array(vertices[v]);
        let at = field.locate(vertices[v].map(f64::from));
        let Some(normal) = field.normal(&at) else { continue };
        let frame = Frame::around(normal);
        for r in i * per_vertex..(i + 1) * per_vertex {
            let local = warp::square_to_cosine_hemisphere([uniform(r, 0), uniform(r, 1)]);
            let direction = field.direction_in_grid(frame.from_local(local)).normalize();
            rays.push(Ray { start: Start::on(at), origin, direction });
        }
    }
    rays
}

fn time<T: Sample>(field: &LevelField<'_, T>, raw: f32, rays: &[Ray], race: &Race<'_>) -> std::io::Result<()> {
    let order = race.order;
    let mut distances = vec![f32::INFINITY; rays.len()];
    let (ours, mut outcomes): (Vec<_>, _) = (rays.iter().map(|r| (r.start, r.direction)).collect(), Vec::new());
    let mut times = Vec::new();
    let mut counts = Counts::default();
    let mut lost = 0u64;
    for _ in 0..race.repeat.max(1) {
        (counts, lost) = (Counts::default(), 0);
        outcomes.clear();
        let clock = ThreadTime::now();
        trace_all(field, raw, &ours, &mut counts, &mut outcomes);
        for ((ray, outcome), distance) in rays.iter().zip(&outcomes).zip(&mut distances) {
            *distance = match outcome {
                Outcome::Hit(hit) => (hit.at.in_grid() - ray.origin).length(),
                Outcome::Escaped => f32::INFINITY,
                Outcome::Lost => {
                    lost += 1;
                    f32::NAN
                }
            };
        }
        times.push(clock.elapsed().as_nanos() as f64 / rays.len() as f64);
    }
    times.sort_by(f64::total_cmp);
    let share = |n: f64| n / rays.len() as f64;
    println!(
        "{order},{},{:.1},{:.1},{:.2},{:.2},{:.2},{:.3},{:.4}",
        rays.len(),
        times[times.len() / 2],
        times[0],
        share(counts.nodes as f64),
        share(counts.cells as f64),
        share(counts.solves as f64),
        share(distances.iter().filter(|d| d.is_finite()).count() as f64),
        share(lost as f64)
    );
    if let Some(dir) = race.out {
        let origins: Vec<f32> = rays.iter().flat_map(|r| r.origin.to_array()).collect();
        let directions: Vec<f32> = rays.iter().flat_map(|r| r.direction.to_array()).collect();
        write(&dir.join(format!("{order}.origins.f32")), &origins)?;
        write(&dir.join(format!("{order}.directions.f32")), &directions)?;
        write(&dir.join(format!("{order}.distances.f32")), &distances)?;
    }
    Ok(())
}

fn write<T: bytemuck::NoUninit>(path: &Path, numbers: &[T]) -> std::io::Result<()> {
    std::fs::File::create(path)?.write_all(bytemuck::cast_slice(numbers))
}
