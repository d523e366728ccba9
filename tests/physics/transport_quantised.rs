//! How much coarse samples cost: the bowl and the sphere with 8-bit samples and few levels to a
//! voxel, where the level sets are plateaus and steps and the closed form is still known.
//!
//! Real 8-bit data looks like this: at 2 mm, mni152 has 44 % of its valid texels clamped, which is
//! the share at half a level a voxel.

use crate::common::{Baked, bake_texels, bowl, pick, quantised, random, settings, voxels};
use glam::DVec3;
use isolume::sampling::statistics::{Running, rms};
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
        assert!(found.error < limit, "{levels}: {}", found.error);
        assert!(found.bias.abs() < 0.5 * limit, "{levels}: {}", found.bias);
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
        assert!(found.error < 0.6 * limit, "{levels}: {}", found.error);
        assert!(found.bias <= 1e-3 && found.bias > -0.4 * limit, "{levels}: {}", found.bias);
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
    // A rough surface is darker than a smooth one, and normals are off by 18 degrees (5 %).
    assert!(found.error < 0.11 && found.bias.abs() < 0.065, "{} {}", found.error, found.bias);
}
