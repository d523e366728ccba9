//! Bandwidth: contraction against a plain read and a copy, extraction, and a relight from end to end.
//!
//!     cargo run --release --example measure-bandwidth -- contract STORE.isolume ISOVALUE [REPETITIONS]
//!     cargo run --release --example measure-bandwidth -- extract [REPETITIONS [FILE…]]
//!     cargo run --release --example measure-bandwidth -- volumes DIRECTORY [FILE…]
//!     cargo run --release --example measure-bandwidth -- relight PROGRAM STORE.isolume ISOVALUE [REPETITIONS]
//!
//! Prints CSV. The variants of a table take turns in every repetition, so that other work on the machine meets all of
//! them; figures are medians of wall and of processor time. On a busy machine the wall says little: `of_read_by_cpu`
//! is the same ratio in processor time. `volumes` writes what `flying_edges.py` reads.

use cpu_time::ProcessTime;
use isolume::relight::{Light, Material, Textures, contract};
use isolume::surface::{extract, extract_without_normals};
use isolume::transfer::store::Store;
use isolume::transfer::texels_of_isosurface;
use isolume::transfer::{BRICK_TEXELS, BrickSource, MemoryTexture, validity};
use isolume::volume::{Volume, field};
use rayon::prelude::*;
use std::error::Error;
use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

/// Threads tried.
const THREADS: [usize; 2] = [1, 2];

type Failure = Box<dyn Error + Send + Sync>;
type Outcome = Result<(), Failure>;

fn main() -> Outcome {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["contract", store, isovalue] => contraction(Path::new(store), isovalue.parse()?, 9),
        ["contract", store, isovalue, n] => contraction(Path::new(store), isovalue.parse()?, n.parse()?),
        ["extract"] => extraction(9, &[]),
        ["extract", n, ref files @ ..] => extraction(n.parse()?, files),
        ["volumes", directory, ref files @ ..] => write_volumes(Path::new(directory), files),
        ["relight", program, store, isovalue] => relight(program, store, isovalue, 9),
        ["relight", program, store, isovalue, n] => relight(program, store, isovalue, n.parse()?),
        _ => Err("contract, extract, volumes or relight: see the head of probes/measure/bandwidth.rs".into()),
    }
}

/// Wall and processor seconds of every repetition of one variant.
#[derive(Default)]
struct Times(Vec<[f64; 2]>);

impl Times {
    fn of<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let (wall, processor) = (Instant::now(), ProcessTime::now());
        let result = black_box(work());
        self.0.push([wall.elapsed().as_secs_f64(), processor.elapsed().as_secs_f64()]);
        result
    }

    /// Median, of wall (0) or processor (1).
    fn median(&self, which: usize) -> f64 {
        let mut all: Vec<f64> = self.0.iter().map(|t| t[which]).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied().unwrap_or(f64::NAN)
    }

    fn least(&self) -> f64 {
        self.0.iter().map(|t| t[0]).fold(f64::INFINITY, f64::min)
    }
}

fn pools() -> Result<Vec<rayon::ThreadPool>, Failure> {
    let pool = |&n: &usize| rayon::ThreadPoolBuilder::new().num_threads(n).build().map_err(Into::into);
    THREADS.iter().map(pool).collect()
}

/// Words that one task reads or copies: 1 MiB.
const TASK: usize = 1 << 17;

fn contraction(path: &Path, isovalue: f64, repetitions: usize) -> Outcome {
    let store = Store::open(path)?;
    let volume = store.volume()?;
    let layout = store.layout().clone();
    let bricks = texels_of_isosurface(&volume, layout.lattice, isovalue).bricks();
    let probe = isolume::probe::by_name("courtyard")?.ok_or("no such probe")?;
    let orientation = isolume::probe::Orientation::new(volume.up, 0.0)?;
    let light = Light::from_channels(&probe.coefficients_in_world(layout.layers.max_bands(), orientation))?;
    let material = Material::new([0.7; 3], [0.0; 3])?;
    let mut texture = MemoryTexture::new(layout.clone());
    let mut valid = 0;
    for &index in &bricks {
        if let Some(view) = store.brick(index)? {
            valid += view.validity.iter().filter(|&&v| v & validity::VALID != 0).count();
            texture.insert(index, view.to_brick())?;
        }
    }
    // What contraction reads: the vectors and errors of valid texels, and one flag of every texel. As one piece ("read") a
    // processor fetches it ahead; in place it has gaps.
    let (n, e) = (layout.layers.coefficients(), layout.layers.errors());
    let bytes = valid * 2 * (n + e) + bricks.len() * BRICK_TEXELS;
    let written = bricks.len() * BRICK_TEXELS * size_of::<[f32; 4]>();
    eprintln!("{} bricks, {valid} valid texels, {bytes} bytes read, {written} written", bricks.len());
    let words: Vec<u64> = (0..bytes as u64 / 8).collect();
    let mut copy = vec![1u64; words.len()];
    println!("threads,what,gigabytes,wall_ms,cpu_ms,least_wall_ms,gigabytes_a_second,of_read,of_read_by_cpu");
    for (pool, threads) in pools()?.iter().zip(THREADS) {
        let mut times: [Times; 5] = Default::default();
        for _ in 0..repetitions {
            pool.install(|| -> Outcome {
                times[0].of(|| words.par_chunks(TASK).map(sum).reduce(|| 0, u64::wrapping_add));
                times[1].of(|| {
                    copy.par_chunks_mut(TASK).zip(words.par_chunks(TASK)).for_each(|(a, b)| a.copy_from_slice(b))
                });
                times[2].of(|| read_in_place(&texture, &bricks, [n, e]))?;
                times[3].of(|| contract(&Textures::of_volume(&texture)?, &bricks, &light, &material).map(drop))?;
                times[4].of(|| contract(&Textures::of_volume(&store)?, &bricks, &light, &material).map(drop))?;
                Ok(())
            })?;
        }
        let read = words.len() as f64 * 8.0 / times[0].median(0);
        let read_cpu = times[0].median(1);
        let names =
            ["read", "copy (read and written)", "read in place", "contraction (in memory)", "contraction (store)"];
        for ((name, times), factor) in names.iter().zip(&times).zip([1.0, 2.0, 1.0, 1.0, 1.0]) {
            let rate = factor * bytes as f64 / times.median(0);
            println!(
                "{threads},{name},{:.3},{:.2},{:.2},{:.2},{:.2},{:.3},{:.3}",
                factor * bytes as f64 * 1e-9,
                1e3 * times.median(0),
                1e3 * times.median(1),
                1e3 * times.least(),
                1e-9 * rate,
                rate / read,
                factor * read_cpu / times.median(1)
            );
        }
    }
    Ok(())
}

/// Sum of what contraction reads of the bricks, where it lies: runs of valid texels, with gaps between them.
fn read_in_place(texture: &MemoryTexture, bricks: &[[usize; 3]], [n, e]: [usize; 2]) -> Result<u64, Failure> {
    let of_brick = |&index: &[usize; 3]| {
        let Some(view) = texture.brick(index)? else { return Ok(0) };
        let (mut total, mut begin) = (0u64, 0);
        for run in view.validity.chunk_by(|a, b| a & validity::VALID == b & validity::VALID) {
            let end = begin + run.len();
            if run[0] & validity::VALID != 0 {
                for row in [&view.transfer[begin * n..end * n], &view.stderr[begin * e..end * e]] {
                    // A texel's numbers may begin or end within a word: those few bytes are left out.
                    total = total.wrapping_add(sum(bytemuck::pod_align_to(row).1));
                }
            }
            begin = end;
        }
        Ok(total)
    };
    bricks.par_iter().map(of_brick).try_reduce(|| 0, |a, b| Ok(a.wrapping_add(b)))
}

/// Sum of words, in eight sums so that additions do not wait for each other.
fn sum(words: &[u64]) -> u64 {
    let (eights, rest) = words.as_chunks::<8>();
    let mut sums = [0u64; 8];
    for eight in eights {
        for (sum, word) in sums.iter_mut().zip(eight) {
            *sum = sum.wrapping_add(*word);
        }
    }
    sums.iter().chain(rest).fold(0, |a, b| a.wrapping_add(*b))
}

/// Name, volume and isovalue.
fn volumes(files: &[&str]) -> Result<Vec<(String, Volume, f64)>, Failure> {
    let mut all = Vec::new();
    for name in ["bumpbox:256", "gyroid:256"] {
        let named = field::by_name(name)?.ok_or("no such field")?;
        all.push((name.replace(':', "-"), named.sample()?, named.field.default_isovalue()));
    }
    for file in files {
        // FILE or FILE@ISOVALUE.
        let (file, isovalue) = file.split_once('@').unwrap_or((file, "90"));
        let volume = isolume::volume::open(file)?;
        all.push((volume.name.clone(), volume, isovalue.parse()?));
    }
    Ok(all)
}

fn extraction(repetitions: usize, files: &[&str]) -> Outcome {
    println!(
        "volume,threads,normals,vertices,triangles,wall_ms,cpu_ms,least_wall_ms,mcells_a_second,mtriangles_a_second"
    );
    for (name, volume, isovalue) in volumes(files)? {
        let cells: f64 = volume.dims().iter().map(|d| (d - 1) as f64).product();
        let pools = pools()?;
        let mut times: [[Times; 2]; 2] = Default::default();
        let mut size = [0; 2];
        for _ in 0..repetitions {
            for (pool, [without, with]) in pools.iter().zip(&mut times) {
                pool.install(|| -> Outcome {
                    let mesh = without.of(|| extract_without_normals(&volume, isovalue))?;
                    size = [mesh.positions_in_grid.len(), mesh.triangles.len()];
                    drop(mesh);
                    with.of(|| extract(&volume, isovalue)).map(drop)?;
                    Ok(())
                })?;
            }
        }
        for (threads, times) in THREADS.iter().zip(&times) {
            for (normals, times) in ["none", "facets"].iter().zip(times) {
                println!(
                    "{name},{threads},{normals},{},{},{:.2},{:.2},{:.2},{:.0},{:.1}",
                    size[0],
                    size[1],
                    1e3 * times.median(0),
                    1e3 * times.median(1),
                    1e3 * times.least(),
                    1e-6 * cells / times.median(0),
                    1e-6 * size[1] as f64 / times.median(0)
                );
            }
        }
    }
    Ok(())
}

/// Writes NAME.raw and NAME.json for each volume.
fn write_volumes(directory: &Path, files: &[&str]) -> Outcome {
    std::fs::create_dir_all(directory)?;
    for (name, volume, isovalue) in volumes(files)? {
        let dtype = match volume.samples().type_name() {
            "uint8" => "u1",
            "int8" => "i1",
            "int16" => "i2",
            "uint16" => "u2",
            _ => "f4",
        };
        let about = serde_json::json!({
            "dims": volume.dims(), "dtype": dtype, "isovalue": volume.raw_from_value(isovalue),
        });
        std::fs::write(directory.join(format!("{name}.raw")), volume.samples().bytes())?;
        std::fs::write(directory.join(format!("{name}.json")), about.to_string())?;
    }
    Ok(())
}

/// Runs the program as a user would, with a warm cache; the split is what it says itself.
fn relight(program: &str, store: &str, isovalue: &str, repetitions: usize) -> Outcome {
    let folder = tempfile::tempdir()?;
    let out = folder.path().join("out.glb");
    let names = ["read", "extract", "select", "contract", "look_up", "write", "whole"];
    let mut all: Vec<Vec<f64>> = vec![Vec::new(); names.len()];
    let mut size = [0, 0, 0];
    for repetition in 0..=repetitions {
        let environment = if repetition % 2 == 0 { "courtyard" } else { "sunset" };
        let start = Instant::now();
        let done = std::process::Command::new(program)
            .args(["--json", "relight", store, "--isovalue", isovalue, "--env", environment, "-o"])
            .arg(&out)
            .output()?;
        let whole = start.elapsed().as_secs_f64();
        if !done.status.success() {
            return Err(String::from_utf8_lossy(&done.stderr).into_owned().into());
        }
        let said: serde_json::Value = serde_json::from_slice(&done.stdout)?;
        let (surface, file) = (&said["surfaces"][0], &said["files"][0]);
        size = [&surface["vertices"], &surface["triangles"], &file["bytes"]].map(|v| v.as_u64().unwrap_or(0));
        // The first run warms the cache of files.
        if repetition > 0 {
            let of_file = |what: &str| file["seconds"][what].as_f64().unwrap_or(f64::NAN);
            let of_surface = |what: &str| surface["seconds"][what].as_f64().unwrap_or(f64::NAN);
            let read = said["seconds"]["read"].as_f64().unwrap_or(f64::NAN);
            let (extract, select) = (of_surface("extract"), of_surface("select"));
            let seconds = [read, extract, select, of_file("contract"), of_file("look_up"), of_file("write"), whole];
            all.iter_mut().zip(seconds).for_each(|(times, s)| times.push(s));
        }
    }
    println!("isovalue,vertices,triangles,bytes,step,median_ms,least_ms");
    for (name, times) in names.iter().zip(&mut all) {
        times.sort_by(f64::total_cmp);
        let [vertices, triangles, bytes] = size;
        let (median, least) = (1e3 * times[times.len() / 2], 1e3 * times[0]);
        println!("{isovalue},{vertices},{triangles},{bytes},{name},{median:.1},{least:.1}");
    }
    Ok(())
}
