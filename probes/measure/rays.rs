//! How fast rays find their own level set, in bake order: texels in bricks of 8³, all rays of a
//! texel together, directions cosine-distributed about the texel's normal, one thread.
//!
//! `cargo run --release --example measure-rays -- [side] [rays per texel]` (256, 16). A row of
//! bricks in sixteen is traced, so that the figures come in seconds. The checksum is the sum of
//! the bits of all hits: two versions with the same checksum, nodes, cells and solves found the
//! same hits.

use glam::{DVec3, Vec3};
use isolume::geom::{Affine, Frame};
use isolume::level::{Counts, LevelField, Outcome, Pyramid, cell};
use isolume::volume::{Sample, Samples, SamplesView, Volume};
use std::f32::consts::TAU;
use std::time::Instant;

/// A table of cosine-distributed directions about z: the R2 sequence on the disk, lifted.
const TABLE: usize = 4096;
/// One row of bricks in this many is traced.
const STRIDE: usize = 16;

fn main() {
    let mut arguments = std::env::args().skip(1).map(|a| a.parse::<usize>());
    let side = arguments.next().and_then(Result::ok).unwrap_or(256);
    let rays = arguments.next().and_then(Result::ok).unwrap_or(16);
    solves();
    println!("rays in bake order, {side}³, {rays} rays a texel, one thread");
    println!(
        "{:<22}{:>10}{:>8}{:>8}{:>9}{:>7}{:>7}{:>8}{:>6}{:>7}{:>6}  checksum",
        "volume", "rays", "cpu s", "wall s", "Mrays/s", "nodes", "cells", "solves", "hit%", "esc%", "lost%"
    );
    let bumps = |p: Vec3| 0.2 * (7.0 * p.x).sin() * (7.0 * p.y).sin() * (7.0 * p.z).sin() - p.z;
    let gyroid = |p: Vec3| {
        let q = p * 9.0;
        q.x.sin() * q.y.cos() + q.y.sin() * q.z.cos() + q.z.sin() * q.x.cos()
    };
    let byte = |h: f32| (128.0 + 90.0 * h).round().clamp(0.0, 255.0) as u8;
    let floats = |h: &dyn Fn(Vec3) -> f32| Samples::F32(lattice(side).map(h).collect());
    report("bump box f32", side, rays, floats(&bumps));
    report("bump box u8", side, rays, Samples::U8(lattice(side).map(bumps).map(byte).collect()));
    report("closed sphere f32", side, rays, floats(&|p| p.length()));
    report("gyroid f32", side, rays, floats(&gyroid));
    let noisy = lattice(side).enumerate().map(|(i, p)| byte(0.5 * gyroid(p)) ^ (hash(i as u32) & 7) as u8);
    report("noisy gyroid u8", side, rays, Samples::U8(noisy.collect()));
}

/// The points of a lattice of `side`³ over [−1, 1]³, x fastest.
fn lattice(side: usize) -> impl Iterator<Item = Vec3> {
    let at = move |i: usize| 2.0 * i as f32 / (side - 1) as f32 - 1.0;
    (0..side * side * side).map(move |i| Vec3::new(at(i % side), at(i / side % side), at(i / side / side)))
}

fn hash(mut x: u32) -> u32 {
    x = (x ^ (x >> 16)).wrapping_mul(0x21f0_aaad);
    x = (x ^ (x >> 15)).wrapping_mul(0xd35a_2d97);
    x ^ (x >> 15)
}

/// Processor time of this process so far, in seconds; 0 where the system does not tell.
fn processor_seconds() -> f64 {
    let Ok(text) = std::fs::read_to_string("/proc/self/stat") else { return 0.0 };
    // Fields 14 and 15, counted after the command's closing bracket; in ticks of 1/100 s.
    let tail = text.rsplit(')').next().unwrap_or("");
    let ticks: f64 = tail.split_whitespace().skip(11).take(2).filter_map(|t| t.parse::<f64>().ok()).sum();
    ticks / 100.0
}

fn report(name: &str, side: usize, rays: usize, samples: Samples) {
    let affine = Affine::from_spacing(DVec3::splat(2.0 / (side - 1) as f64), DVec3::splat(-1.0)).expect("invertible");
    let volume = Volume::new([side; 3], samples, affine).expect("finite samples");
    let pyramid = Pyramid::new(&volume);
    let (cpu, wall) = (processor_seconds(), Instant::now());
    let (counts, outcomes, checksum) = match volume.samples().view() {
        SamplesView::U8(s) => bake(&LevelField::new(&volume, s, &pyramid), side, rays),
        SamplesView::F32(s) => bake(&LevelField::new(&volume, s, &pyramid), side, rays),
        _ => unreachable!("only these two are made here"),
    };
    let (cpu, wall) = (processor_seconds() - cpu, wall.elapsed().as_secs_f64());
    let per_ray = |n: u64| n as f64 / counts.rays as f64;
    println!(
        "{name:<22}{:>10}{cpu:>8.2}{wall:>8.2}{:>9.2}{:>7.2}{:>7.2}{:>8.2}{:>6.1}{:>7.1}{:>6.1}  {checksum:016x}",
        counts.rays,
        counts.rays as f64 * 1e-6 / wall,
        per_ray(counts.nodes),
        per_ray(counts.cells),
        per_ray(counts.solves),
        100.0 * per_ray(outcomes[0]),
        100.0 * per_ray(outcomes[1]),
        100.0 * per_ray(outcomes[2]),
    );
}

fn bake<T: Sample>(field: &LevelField<'_, T>, side: usize, rays: usize) -> (Counts, [u64; 3], u64) {
    let directions: Vec<Vec3> = (0..TABLE)
        .map(|i| {
            let (u, v) = ((i as f64 * 0.754_877_666) % 1.0, (i as f64 * 0.569_840_291) % 1.0);
            let (radius, angle) = ((u as f32).sqrt(), TAU * v as f32);
            Vec3::new(radius * angle.cos(), radius * angle.sin(), (1.0 - u as f32).sqrt())
        })
        .collect();
    let bricks = side.div_ceil(8);
    let (mut counts, mut outcomes, mut checksum) = (Counts::default(), [0u64; 3], 0u64);
    for row in (0..bricks * bricks).step_by(STRIDE) {
        // Odd stride in y, so that the rows are spread over the slice.
        let (by, bz) = ((row + row / bricks * 5) % bricks, row / bricks);
        for texel in 0..bricks * 512 {
            let (bx, i) = (texel / 512, texel % 512);
            let at = [bx * 8 + i % 8, by * 8 + i / 8 % 8, bz * 8 + i / 64];
            if at.iter().any(|&c| c >= side) {
                continue;
            }
            let Some(site) = field.site(at.map(|c| c as f64)) else { continue };
            let frame = Frame::around(site.normal);
            let first = hash((at[0] + side * (at[1] + side * at[2])) as u32) as usize;
            for ray in 0..rays {
                let direction = field.direction_in_grid(frame.from_local(directions[(first + ray) % TABLE]));
                match field.trace(site.isovalue, &site.start, direction, &mut counts) {
                    Outcome::Hit(hit) => {
                        outcomes[0] += 1;
                        let bits = hit.at.local.to_array().map(|v| u64::from(v.to_bits()));
                        let cell = hit.at.cell.to_array().map(|v| v as u64);
                        let mixed = bits[0] ^ bits[1] << 16 ^ bits[2] << 32 ^ cell[0] ^ cell[1] << 10 ^ cell[2] << 20;
                        checksum = checksum.wrapping_add(mixed);
                    }
                    Outcome::Escaped => outcomes[1] += 1,
                    Outcome::Lost => outcomes[2] += 1,
                }
            }
        }
    }
    (counts, outcomes, checksum)
}

/// Nanoseconds per cell solve, by the share of segments that hold a crossing.
fn solves() {
    const SEGMENTS: usize = 1 << 16;
    let number = |i: usize, k: usize| hash((i * 31 + k) as u32) as f32 / u32::MAX as f32;
    println!("{:<34}{:>10}{:>8}{:>12}", "one cell, uniform corners", "segments", "rise%", "ns a solve");
    for (name, bias) in [("values −1…1", 0.5), ("mostly below", 0.8), ("all below", 1.0)] {
        let cells: Vec<_> = (0..SEGMENTS)
            .map(|i| {
                let value = |k: usize| 2.0 * (number(i, k) - bias);
                let point = |k: usize| Vec3::new(number(i, k), number(i, k + 1), number(i, k + 2));
                let face = |k: usize| glam::Vec4::new(value(k), value(k + 1), value(k + 2), value(k + 3));
                let (low, high) = (face(0), face(4));
                let (mut p, mut q) = (point(8), point(11));
                p[i % 3] = 0.0;
                q[i / 3 % 3] = 1.0;
                (low, high, p, q)
            })
            .filter(|c| cell::along_segment(c.0, c.1, c.2, c.3)[0] <= 0.0)
            .collect();
        let clock = Instant::now();
        let mut rises = 0u64;
        const ROUNDS: u32 = 40;
        for _ in 0..ROUNDS {
            for (low, high, p, q) in &cells {
                let cubic = cell::along_segment(*low, *high, *p, *q);
                rises += u64::from(std::hint::black_box(cell::first_rise(&cubic)).is_some());
            }
        }
        let total = f64::from(ROUNDS) * cells.len() as f64;
        let nanoseconds = clock.elapsed().as_secs_f64() * 1e9 / total;
        println!("{name:<34}{:>10}{:>8.1}{nanoseconds:>12.1}", cells.len(), 100.0 * rises as f64 / total);
    }
}
