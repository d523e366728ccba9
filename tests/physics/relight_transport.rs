//! VALIDATION 7, 14, 15, 17, 19: what relight makes of transfer.

use crate::common::{self, Baked, bake_texels, bowl, grey, pick, random, settings, voxels};
use glam::DVec3;
use isolume::relight::{Contracted, Light, Material, Textures, contract};
use isolume::sh::{self, Coefficients};
use isolume::transfer::Lattice;
use isolume::transport::{PathEnd, Settings, replay};
use isolume::volume::Volume;
use isolume::volume::field::{BumpBox, Gyroid, sample};

/// Radiance at the texels themselves.
fn relight(baked: &Baked, texels: &[[usize; 3]], light: &Light, material: &Material) -> Vec<[f32; 3]> {
    let contracted: Contracted =
        contract(&Textures::of_volume(&baked.texture).unwrap(), &baked.bricks(), light, material).unwrap();
    let positions: Vec<[f32; 3]> = texels.iter().map(|t| t.map(|v| v as f32)).collect();
    let normals = vec![[0.0, 0.0, 1.0]; texels.len()];
    let found = contracted.look_up(&positions, &normals, light, material);
    assert_eq!(found.report.lookups, texels.len() as u64);
    assert_eq!(found.report.unbaked, 0);
    found.radiance
}

fn random_light(bands: usize, stream: u64) -> Light {
    let rgb = (0..bands * bands).map(|i| std::array::from_fn(|c| 2.0 * random(stream, 3 * i + c) - 1.0));
    Light::new(rgb.collect()).unwrap()
}

/// Valid texels of a scene with all kinds of openness, and its bake.
fn gyroid(settings: &Settings, count: usize) -> (Volume, Vec<[usize; 3]>, Baked) {
    let volume = sample(&Gyroid::default(), [33; 3]).unwrap();
    let texels = pick([33; 3], count, 2, |_| true);
    let baked = bake_texels(&volume, settings, &texels);
    let texels = texels.into_iter().filter(|&t| baked.is_valid(t)).collect();
    (volume, texels, baked)
}

#[test]
fn relight_is_linear_in_the_light_and_black_without_it() {
    let (_, texels, baked) = gyroid(&settings(&[5, 4, 3, 3], 64, 1), 200);
    let (first, second) = (random_light(5, 1), random_light(4, 2));
    let (a, b) = (1.7, -0.6);
    let mixed = (0..25).map(|i| {
        std::array::from_fn(|c| {
            let of_second = second.coefficients(0).get(i).map_or(0.0, |v| v[c]);
            a * first.coefficients(0)[i][c] + b * of_second
        })
    });
    let mixed = Light::new(mixed.collect()).unwrap();
    for albedo in [0.0, 0.3, 0.95, 1.0] {
        let material = Material::new([albedo, 0.7 * albedo, 0.2], [0.0; 3]).unwrap();
        let [one, two, both] = [&first, &second, &mixed].map(|l| relight(&baked, &texels, l, &material));
        for i in 0..texels.len() {
            for c in 0..3 {
                let sum = a as f32 * one[i][c] + b as f32 * two[i][c];
                // Terms of size ≤ 1 whose sum stays below 10: f32 rounding of 60 terms, 1e-6.
                assert!((both[i][c] - sum).abs() <= 1e-6 * (1.0 + a as f32 * one[i][c].abs() + two[i][c].abs()));
            }
        }
        let black = Light::new(vec![[0.0; 3]; 25]).unwrap();
        assert!(relight(&baked, &texels, &black, &material).iter().all(|c| *c == [0.0; 3]));
    }
    // A light of more bands than the transfer, or of fewer, is met where both have bands.
    let wide = random_light(11, 3);
    let cut = Light::new(wide.coefficients(0)[..25].to_vec()).unwrap();
    assert_eq!(relight(&baked, &texels, &wide, &grey(0.5, 0.0)), relight(&baked, &texels, &cut, &grey(0.5, 0.0)));
}

#[test]
fn a_glowing_closed_sphere_sums_all_its_bounces() {
    let volume = voxels([33; 3], [-16.0; 3], |p| p.length());
    let radius = |t: [usize; 3]| (DVec3::new(t[0] as f64, t[1] as f64, t[2] as f64) - 16.0).length();
    let texels = pick([33; 3], 60, 13, |t| (4.0..15.5).contains(&radius(t)));
    let black = Light::constant([0.0; 3]);
    let bright = random_light(5, 4);
    for layers in [1, 2, 4] {
        let baked = bake_texels(&volume, &settings(&vec![3; layers], 64, 2), &texels);
        for albedo in [0.0f32, 0.2, 0.5, 0.9, 0.99] {
            let exact = 1.5 / (1.0 - f64::from(albedo));
            // The outer light is shut out to the last bit; K+2 additions and a division in f32.
            for light in [&black, &bright] {
                for c in relight(&baked, &texels, light, &grey(albedo, 1.5)) {
                    assert!(
                        (f64::from(c[0]) / exact - 1.0).abs() < 2e-6,
                        "{layers} layers, {albedo}: {} {exact}",
                        c[0]
                    );
                }
            }
        }
        // ρ = 1 has no end: the sum stops at the bounce after the last layer and says so.
        let contracted =
            contract(&Textures::of_volume(&baked.texture).unwrap(), &baked.bricks(), &black, &grey(1.0, 1.0)).unwrap();
        assert_eq!(contracted.emission_remainder, 1.0);
        let found = relight(&baked, &texels, &black, &grey(1.0, 1.0));
        assert!(found.iter().all(|c| c[0] == layers as f32 + 1.0), "{layers}: {}", found[0][0]);
    }
}

#[test]
fn in_a_furnace_everything_is_as_bright_as_the_sky() {
    // Le = (1 − ρ) L: each bounce either escapes to L or meets a surface of radiance L.
    for layers in [1, 2, 4] {
        let (_, texels, baked) = gyroid(&settings(&vec![2; layers], 16, 3), 300);
        for albedo in [0.0f32, 0.3, 0.7, 0.9, 0.99] {
            let found = relight(&baked, &texels, &Light::constant([2.0; 3]), &grey(albedo, 2.0 * (1.0 - albedo)));
            for (c, t) in found.iter().zip(&texels) {
                // The sums telescope whatever the noise: Σ ρ^(k+1) a_k + (1−ρ) Σ ρ^k S_k = 1 when
                // a_k = S_k − S_(k+1). Rounding to f16 may make Σ a_k > 1 by 2⁻¹¹, which the
                // formula clamps.
                assert!((c[0] / 2.0 - 1.0).abs() < 6e-4, "{t:?} {layers} layers, albedo {albedo}: {}", c[0]);
            }
        }
    }
    // Without emission the deficit after the last layer is what is still travelling, ρ^(N+1) at
    // most with N stored layers and no tail (a_K = 0) or less.
    let (_, texels, baked) = gyroid(&settings(&[1, 1, 1, 1], 64, 3), 300);
    for &t in &texels {
        let survive = 1.0 - (0..4).map(|k| baked.escape(t, k)).sum::<f64>();
        assert!((-5e-4..=1.0).contains(&survive), "{t:?}: {survive}");
    }
}

#[test]
fn no_surface_outshines_the_sky() {
    // VALIDATION 17 for path results: each path brings at most one radiance of the sky. Constant
    // light through relight, tail included; the rays are few so that the noise is large.
    for (rays, positive) in [(4, true), (4, false), (16, false)] {
        let mut settings = settings(&[4, 3, 2, 2], rays, 9);
        settings.positive = positive;
        let (volume, texels, baked) = gyroid(&settings, 300);
        for albedo in [0.3, 0.9, 1.0] {
            for c in relight(&baked, &texels, &Light::constant([3.0; 3]), &grey(albedo, 0.0)) {
                // Rounding of four a_k to f16, 2⁻¹¹ relative each, and so of their sum.
                assert!((0.0..=3.0 * albedo * (1.0 + 4.9e-4)).contains(&c[0]), "albedo {albedo}: {}", c[0]);
            }
        }
        // A sky of two radiances, 0 and 5, evaluated path by path: no SH at all.
        let lattice = Lattice::from_ratio(volume.dims(), 1.0).unwrap();
        common::with_field(&volume, |field| {
            for &t in texels.iter().take(40) {
                let site = field.site(lattice.grid_from_texel(t)).unwrap();
                let mut sum = 0.0;
                for path in replay(field, &site, common::item(&lattice, t), &settings) {
                    let [x, y, z] = path.last_direction_in_world;
                    assert!(((x * x + y * y + z * z) - 1.0).abs() < 1e-5);
                    if path.ended == PathEnd::Escaped && x + 2.0 * y - z > 0.3 {
                        sum += 5.0 / f64::from(rays);
                    }
                }
                assert!((0.0..=5.0).contains(&sum));
            }
        });
    }
}

/// A non-negative light with `bands` bands: the square of a function with half of them.
fn non_negative(bands: usize, stream: u64) -> Coefficients {
    let half = bands.div_ceil(2);
    let root = Coefficients::new(half, (0..half * half).map(|i| random(stream, i) - 0.5).collect()).unwrap();
    sh::project::project(bands, 2 * bands, |d| root.evaluate(d).powi(2))
}

#[test]
fn a_positive_bake_never_gives_negative_light() {
    let volume = sample(&BumpBox, [33; 3]).unwrap();
    let texels = pick([33; 3], 300, 6, |_| true);
    let mut settings = settings(&[5, 5, 5, 3], 4, 3);
    settings.positive = true;
    let baked = bake_texels(&volume, &settings, &texels);
    let layers = settings.layers.clone();
    let mut lowest = f64::MAX;
    for stream in 0..40 {
        for k in 0..layers.len() {
            let bands = layers.bands()[k];
            let light = non_negative(bands, stream);
            for &t in texels.iter().filter(|&&t| baked.is_valid(t)) {
                let stored = &baked.transfer(t)[layers.offset(k)..][..bands * bands];
                let (mut sum, mut size) = (0.0, 0.0);
                for (a, b) in stored.iter().zip(light.values()) {
                    sum += a * b;
                    size += (a * b).abs();
                }
                // T = Σ w Y(ω), w ≥ 0, so ⟨T, L⟩ = Σ w L(ω) ≥ 0; rounding to f16 moves each
                // coefficient by 2⁻¹¹ of itself at most.
                assert!(sum >= -size * 2f64.powi(-11) - 1e-6, "layer {k} texel {t:?}: {sum} of {size}");
                lowest = lowest.min(sum / size.max(1e-30));
            }
        }
    }
    println!("lowest ⟨T, L⟩ over Σ|T L|: {lowest:.2e}");
    // Before it is stored: the same from the paths, in f32 as the program sums.
    let lattice = Lattice::from_ratio(volume.dims(), 1.0).unwrap();
    common::with_field(&volume, |field| {
        for &t in texels.iter().filter(|&&t| baked.is_valid(t)).take(100) {
            let site = field.site(lattice.grid_from_texel(t)).unwrap();
            let mut sums = [0.0f32; 25];
            let paths = replay(field, &site, common::item(&lattice, t), &settings);
            for path in paths.iter().filter(|p| p.ended == PathEnd::Escaped && p.vertices_in_grid.len() == 1) {
                sh::basis::accumulate(5, &[path.last_direction_in_world.into()], &mut sums);
            }
            for stream in 0..40 {
                let light = non_negative(5, stream);
                let sum: f64 = light.values().iter().zip(&sums).map(|(a, &b)| a * f64::from(b)).sum();
                // Four terms of Y·L with |Y| ≤ 2.4 in f32: 25·4·2.4·2⁻²⁴ of the light's size.
                assert!(sum >= -2e-5 * light.energy().sqrt(), "{t:?}: {sum}");
            }
        }
    });
    // With the control variate it does not hold: that is the price, and the switch does something.
    settings.positive = false;
    let plain = bake_texels(&volume, &settings, &texels);
    let negative = texels.iter().filter(|&&t| plain.is_valid(t)).any(|&t| {
        (0..40).any(|s| non_negative(5, s).dot(&plain.transfer(t)[..25]) < -1e-2 * non_negative(5, s).values()[0])
    });
    assert!(negative);
}

#[test]
fn a_convex_combination_of_positive_texels_stays_positive() {
    let volume = bowl(16);
    let points: Vec<DVec3> =
        common::lower_half_sphere(400).into_iter().map(|p| p * 10.0 + DVec3::splat(16.0)).collect();
    let texels: Vec<[usize; 3]> = points.iter().flat_map(|&p| common::corners(p, volume.dims())).map(|c| c.0).collect();
    let mut settings = settings(&[3, 3, 3], 4, 3);
    settings.positive = true;
    let baked = bake_texels(&volume, &settings, &texels);
    let light = non_negative(3, 5);
    let rgb = light.values().iter().map(|&v| [v; 3]).collect();
    let light = Light::new(rgb).unwrap();
    let contracted =
        contract(&Textures::of_volume(&baked.texture).unwrap(), &baked.bricks(), &light, &grey(0.9, 0.0)).unwrap();
    let positions: Vec<[f32; 3]> = points.iter().map(|p| p.as_vec3().to_array()).collect();
    let found = contracted.look_up(&positions, &vec![[0.0, 0.0, 1.0]; 400], &light, &grey(0.9, 0.0));
    assert_eq!((found.report.renormalised, found.report.unbaked), (0, 0));
    // f16: 2⁻¹¹·Σ|T L| ≤ 5e-4·2.5 here.
    assert!(
        found.radiance.iter().all(|c| c[0] >= -1.3e-3),
        "{:?}",
        found.radiance.iter().map(|c| c[0]).reduce(f32::min)
    );
}
