//! How much coarse samples cost: the bowl and the sphere with 8-bit samples and few levels to a
//! voxel, where the level sets are plateaus and steps and the closed form is still known.
//!
//! What is known is the smooth shape. The surface that the samples describe is stairs or rough, and darker by itself: paths
//! on it ([`geometric`]) say by how much, and so much the texels may be darker, too.
//!
//! Real 8-bit data looks like this: at 2 mm, mni152 has 44 % of its valid texels clamped, which is
//! the share at half a level a voxel.

use crate::common::{Baked, bake_texels, bowl, pick, quantised, random, settings, voxels};
use glam::DVec3;
use isolume::level::Pyramid;
use isolume::probe::{self, Orientation};
use isolume::sampling::statistics::{Running, rms};
use isolume::surface::extract;
use isolume::transport::{SceneReference, geometric, points_in_cells};
use isolume::volume::Volume;

const RHO: f64 = 0.7;

fn radius(t: [usize; 3]) -> f64 {
    (DVec3::new(t[0] as f64, t[1] as f64, t[2] as f64) - 32.0).length()
}

struct Measured {
    clamped: f64,
    bias: f64,
    error: f64,
}

/// Ambient light, Σ ρ^(k+1) a_k over four layers, against its closed form.
fn measure(name: &str, volume: &Volume, texels: &[[usize; 3]], exact: fn(usize) -> f64) -> Measured {
    let baked: Baked = bake_texels(volume, &settings(&[1; 4], 256, 1), texels);
    let valid: Vec<[usize; 3]> = texels.iter().copied().filter(|&t| baked.is_valid(t)).collect();
    let ambient = |a: &dyn Fn(usize) -> f64| (0..4).map(|k| RHO.powi(k as i32 + 1) * a(k)).sum::<f64>();
    let truth = ambient(&exact);
    let off: Vec<f64> = valid.iter().map(|&t| ambient(&|k| baked.escape(t, k)) / truth - 1.0).collect();
    let measured = Measured {
        clamped: valid.iter().filter(|&&t| baked.is_clamped(t)).count() as f64 / valid.len() as f64,
        bias: off.iter().copied().collect::<Running>().mean(),
        error: rms(off),
    };
    println!(
        "{name}: valid {}/{}, clamped {:.0} %, lost {:.2} %, ambient bias {:+.2} %, RMS {:.2} %",
        valid.len(),
        texels.len(),
        100.0 * measured.clamped,
        100.0 * baked.summary.lost_share(),
        100.0 * measured.bias,
        100.0 * measured.error
    );
    measured
}

/// How much brighter than the smooth shape, relatively, the quantised surface is by itself under ambient light: the least of
/// two, at a value of samples (a stair) and between two of them. Texels have isovalues of both kinds.
fn itself(volume: &Volume, value: f64, levels: f64, smooth: f64) -> f64 {
    let pyramid = Pyramid::new(volume);
    let sky = probe::by_name("constant").unwrap().unwrap();
    let source = sky.source(Orientation::new(volume.up, 0.0).unwrap());
    let stair = (value * levels).round();
    let at = |raw: f64| {
        let isovalue = raw / levels;
        let points = points_in_cells(volume, &pyramid, &extract(volume, isovalue).unwrap(), isovalue, 600, 2);
        let settings = SceneReference::new(64, [RHO as f32; 3], 3);
        let (found, _) = geometric(volume, isovalue, &points, &[&source], &settings).unwrap();
        found[0].iter().map(|r| r.mean[0]).collect::<Running>().mean() / smooth - 1.0
    };
    let least = at(stair).min(at(stair + 0.5)).min(0.0);
    println!("the surface itself: {:+.2} %", 100.0 * least);
    least
}

fn half(k: usize) -> f64 {
    0.5f64.powi(k as i32 + 1)
}

fn open(k: usize) -> f64 {
    if k == 0 { 1.0 } else { 0.0 }
}

/// Levels to a voxel, and the largest ambient RMS allowed: the noise of 256 paths, 1.3 % (bowl,
/// float), and what normals that are off by 2, 4, 8, 10 and 15 degrees cost. A normal off by δ
/// changes the openness of a bowl by up to sin(δ)/2, of an average direction by 0.3 of that:
/// 0.5, 1.1, 2.2, 2.8 and 4.1 % of the light; the steps themselves are of the same size.
const LADDER: [(f64, f64); 5] = [(4.0, 0.018), (2.0, 0.024), (1.0, 0.035), (0.5, 0.041), (0.25, 0.058)];

#[test]
fn the_bowl_survives_coarse_levels() {
    let smooth = bowl(32);
    let texels = pick(smooth.dims(), 300, 3, |t| (10.0..29.0).contains(&radius(t)) && t[2] < 30);
    let exact = measure("bowl, float", &smooth, &texels, half);
    assert!(exact.bias.abs() < 0.004 && exact.error < 0.015 && exact.clamped == 0.0);
    for (levels, limit) in LADDER {
        let volume = quantised(&smooth, levels, 0.0);
        let found = measure(&format!("bowl, {levels} levels a voxel"), &volume, &texels, half);
        // Σ ρ^(k+1) 2^−(k+1).
        let darker = itself(&volume, 20.0, levels, 0.5 * RHO / (1.0 - 0.5 * RHO));
        assert!(found.error < limit - darker, "{levels}: {}", found.error);
        assert!((darker - 0.5 * limit..0.5 * limit).contains(&found.bias), "{levels}: {}", found.bias);
        assert_eq!(levels < 0.8, found.clamped > 0.0);
    }
}

#[test]
fn the_convex_sphere_survives_coarse_levels() {
    let smooth = voxels([65; 3], [-32.0; 3], |p| 56.0 - p.length());
    let texels = pick(smooth.dims(), 300, 3, |t| (10.0..29.0).contains(&radius(t)));
    for (levels, limit) in LADDER {
        let volume = quantised(&smooth, levels, 0.0);
        let found = measure(&format!("sphere, {levels} levels a voxel"), &volume, &texels, open);
        // What is hidden comes back after a bounce, so less than in the bowl.
        let darker = itself(&volume, 36.0, levels, RHO);
        assert!(found.error < 0.6 * limit - darker, "{levels}: {}", found.error);
        assert!((darker - 0.4 * limit..=1e-3).contains(&found.bias), "{levels}: {}", found.bias);
    }
}

#[test]
fn noise_darkens_but_does_not_destroy() {
    // Noise of 0.6 voxel (the sum of four uniform numbers) on the radius, two levels a voxel.
    let noisy = voxels([65, 65, 33], [-32.0; 3], |p| {
        let i = (p.x + 32.0 + 65.0 * (p.y + 32.0 + 65.0 * (p.z + 32.0))).round() as usize;
        let noise: f64 = (1..5).map(|stream| random(stream, i)).sum::<f64>() - 2.0;
        (p.length() + noise + 3.0).max(0.0)
    });
    let volume = quantised(&noisy, 2.0, 0.0);
    let texels = pick(volume.dims(), 300, 3, |t| (10.0..29.0).contains(&radius(t)) && t[2] < 30);
    let found = measure("bowl, noise 0.6 voxel", &volume, &texels, half);
    // A rough surface is darker than a smooth one, and smoothed normals are off by 18 degrees (5 %).
    let darker = itself(&volume, 23.0, 2.0, 0.5 * RHO / (1.0 - 0.5 * RHO));
    assert!(found.error < 0.11 - darker, "{}", found.error);
    assert!((darker - 0.05..0.05).contains(&found.bias), "{}", found.bias);
}
