//! Estimates of single texels in f32, before storage. The judges over the public API are in
//! `tests/physics/transport_*.rs`.

use super::path::{Scratch, estimate};
use super::*;
use crate::geom::Affine;
use crate::grid3;
use crate::level::{Counts, LevelField, Pyramid};
use crate::sampling::statistics::{Running, half_interval_95, sidak};
use crate::sh::{self, Coefficients};
use crate::transfer::Layers;
use crate::volume::{Samples, Volume};
use glam::{DVec3, Vec3};
use std::f32::consts::PI;

/// Samples of `field` on a grid of spacing 1 whose point `centre` is the origin.
fn sampled(dims: [usize; 3], centre: Vec3, field: impl Fn(Vec3) -> f32) -> Volume {
    let [nx, ny, nz] = dims;
    let samples = (0..nx * ny * nz)
        .map(|i| field(Vec3::new((i % nx) as f32, (i / nx % ny) as f32, (i / nx / ny) as f32) - centre))
        .collect();
    let affine = Affine::from_spacing(DVec3::ONE, -centre.as_dvec3()).unwrap();
    Volume::new(dims, Samples::F32(samples), affine).unwrap()
}

fn settings(bands: &[usize], rays: u32) -> Settings {
    Settings { layers: Layers::new(bands.to_vec()).unwrap(), rays, seed: 1, positive: false, target: None }
}

/// Calls `judge` with the position and the estimate of every `stride`-th sample at which `wanted` holds.
fn for_each_texel(
    volume: &Volume,
    settings: &Settings,
    stride: usize,
    wanted: impl Fn(Vec3) -> bool,
    mut judge: impl FnMut(Vec3, &TexelEstimate),
) -> Counts {
    let Samples::F32(samples) = volume.samples() else { unreachable!() };
    let pyramid = Pyramid::new(volume);
    let field = LevelField::new(volume, samples, &pyramid);
    let [nx, ny, _] = volume.dims();
    let (mut scratch, mut counts, mut out) = (Scratch::default(), Counts::default(), TexelEstimate::default());
    for i in (0..samples.len()).step_by(stride) {
        let texel = grid3::at([nx, ny], i).map(|v| v as f64);
        let at = volume.world_from_grid().point(DVec3::from_array(texel)).as_vec3();
        if wanted(at) {
            let site = field.site(texel).unwrap();
            estimate(&field, &site, i as u64, settings, &mut scratch, &mut counts, &mut out);
            judge(at, &out);
        }
    }
    counts
}

#[test]
fn the_bowl_lets_half_of_the_light_out_at_every_bounce() {
    // VALIDATION 13: f = 1/2 at every point of every hemisphere, so a_k = 2^-(k+1).
    let volume = sampled([33, 33, 17], Vec3::splat(16.0), Vec3::length);
    let settings = settings(&[1; 4], 64);
    let mut means = [Running::new(); 4];
    let mut ends = (0u64, 0u64);
    let inner = |p: Vec3| (8.0..15.0).contains(&p.length()) && p.z < -0.5;
    let counts = for_each_texel(&volume, &settings, 7, inner, |_, texel| {
        for k in 0..4 {
            means[k].push(f64::from(texel.transfer[k] * 2.0 * PI.sqrt()));
        }
        ends = (ends.0 + u64::from(texel.trapped), ends.1 + u64::from(texel.lost));
    });
    let paths = 64 * means[0].count();
    for (k, mean) in means.iter().enumerate() {
        let expected = 0.5f64.powi(k as i32 + 1);
        // Facets lean by 1/(2c) radian: 1/(4c²) of the cosine, c ≥ 8, once for each bounce.
        let bias = 0.004 * (k + 1) as f64 * expected;
        assert!((mean.mean() - expected).abs() < bias + 3.0 * mean.standard_error(), "{k}: {} {expected}", mean.mean());
    }
    // One ray, and 1/2 + 1/4 + 1/8 more; 1/16 of the paths is still inside after four layers.
    assert!((counts.rays as f64 / paths as f64 - 1.875).abs() < 0.02, "{counts:?}");
    assert!((ends.0 as f64 / paths as f64 - 0.0625).abs() < 0.005, "{ends:?} of {paths}");
    assert!((ends.1 as f64) < 0.01 * paths as f64, "{ends:?} of {paths}");
}

#[test]
fn a_convex_sphere_has_the_transfer_of_the_clamped_cosine() {
    let volume = sampled([25, 25, 25], Vec3::splat(12.0), |p| -p.length());
    let (mut sum, mut norm) = (0.0f64, 0.0f64);
    for_each_texel(
        &volume,
        &settings(&[5], 16),
        11,
        |p| (5.0..12.0).contains(&p.length()),
        |p, texel| {
            let mut y = [0.0f32; 25];
            sh::basis::evaluate_f32(5, p.normalize(), &mut y);
            for l in 0..5 {
                for i in l * l..(l + 1) * (l + 1) {
                    let exact = y[i] * (sh::CLAMPED_COSINE[l] as f32) / PI;
                    sum += f64::from((texel.transfer[i] - exact).powi(2));
                    norm += f64::from(exact.powi(2));
                }
            }
            // Nothing is hidden, so the control variate takes all noise away and the floor speaks.
            assert!(texel.degenerate && texel.lost == 0 && texel.trapped == 0);
            let half_interval = half_interval_95(5) as f32 * texel.stderr[0] * 2.0 * PI.sqrt();
            assert!((half_interval - 1.5 / 16.0).abs() < 1e-6);
        },
    );
    // The B-spline keeps a radial field radial up to terms of the order R⁻⁴ = 5⁻⁴.
    assert!((sum / norm).sqrt() < 1.6e-3, "{}", (sum / norm).sqrt());
}

#[test]
fn positive_estimates_are_non_negative_in_single_precision() {
    // L = (ω·d + 0.2)², non-negative with three bands.
    let d = DVec3::new(0.6, -0.3, 0.7).normalize();
    let light: Coefficients = sh::project::project(3, 6, |w| (w.dot(d) + 0.2).powi(2));
    let volume = sampled([21, 21, 21], Vec3::splat(10.0), |p| (0.5 * p.x).sin() + (0.4 * p.y).cos() - 0.1 * p.z);
    let mut settings = settings(&[3, 3, 3], 4);
    let mut lowest = [0.0f64; 2];
    for (case, positive) in [(0, true), (1, false)] {
        settings.positive = positive;
        for_each_texel(
            &volume,
            &settings,
            5,
            |_| true,
            |_, texel| {
                for k in 0..3 {
                    lowest[case] = lowest[case].min(light.dot(&texel.transfer[9 * k..9 * (k + 1)]));
                }
            },
        );
    }
    // Nine products of up to 0.5 in f32; with the control variate the noise of four rays.
    assert!(lowest[0] > -1e-6 && lowest[1] < -0.01, "{lowest:?}");
}

/// A ray along ω from a hit adds β (A(n) − Y(ω)), which is 0 in the mean: with and without it the estimates have one mean.
#[test]
fn the_control_variate_at_hits_moves_no_mean_and_takes_error_away() {
    let volume = sampled([21, 21, 21], Vec3::splat(10.0), |p| (0.5 * p.x).sin() + (0.4 * p.y).cos() - 0.1 * p.z);
    let (mut differences, mut spreads) = (vec![Running::new(); 3 * 9], [[Running::new(); 2]; 27]);
    let wanted = |p: Vec3| p.length() < 7.0;
    for seed in 0..48 {
        let mut all: [Vec<Vec<f32>>; 2] = Default::default();
        for (all, positive) in all.iter_mut().zip([true, false]) {
            let settings = Settings { seed, positive, ..settings(&[3; 3], 16) };
            for_each_texel(&volume, &settings, 61, wanted, |_, texel| all.push(texel.transfer.clone()));
        }
        let [without, with] = all;
        // The mean over all texels is one number a seed; of the first texels the spread over the seeds is looked at.
        for i in 0..27 {
            let mean = |of: &[Vec<f32>]| of.iter().map(|t| f64::from(t[i])).sum::<f64>() / of.len() as f64;
            differences[i].push(mean(&with) - mean(&without));
            spreads[i][0].push(without[0][i].into());
            spreads[i][1].push(with[0][i].into());
        }
    }
    // a_k is not changed but by rounding, since Y_00 is constant.
    let judged: Vec<usize> = (0..27).filter(|i| i % 9 > 0).collect();
    let limit = sidak(0.01, judged.len());
    for &i in &judged {
        assert!(differences[i].p_of_mean(0.0) > limit, "coefficient {i}: {:?}", differences[i]);
    }
    let variance =
        |which: usize| judged.iter().filter(|&&i| i >= 9).map(|&i| spreads[i][which].variance()).sum::<f64>();
    assert!(variance(1) < variance(0), "{} {}", variance(1), variance(0));
    for i in [9, 18] {
        assert!(differences[i].mean().abs() < 1e-6, "a_{}: {:?}", i / 9, differences[i]);
    }
}
