//! VALIDATION 13 and 18, and its targets: the bowl, h = |x| below z = 0, light inside.
//!
//! Form factors inside a sphere are uniform, dF = dA/(4πc²), so whatever leaves a point of the
//! lower half sphere escapes through the opening with chance f = 1/2, from every point and at
//! every bounce: a_k = f(1 − f)^k, on every level set at once.

use crate::common::{Baked, bake_texels, bowl, corners, lower_half_sphere, pick, settings};
use glam::DVec3;
use isolume::level::Pyramid;
use isolume::relight::{Light, Material, Textures, contract};
use isolume::sampling::statistics::{Running, rms};
use isolume::transfer::{Lattice, Layers, Layout, texels_of_isosurface};
use isolume::transport::{Bake, Settings, pilot};
use isolume::volume::Volume;
use isolume::volume::field::by_name;

const OPEN: f64 = 0.5;

fn expected(k: usize) -> f64 {
    OPEN * (1.0 - OPEN).powi(k as i32)
}

/// Grid positions of `count` points on the level set of radius `c` voxels in a bowl of `radius`.
fn surface_points(radius: usize, c: f64, count: usize) -> Vec<DVec3> {
    lower_half_sphere(count).into_iter().map(|p| p * c + DVec3::splat(radius as f64)).collect()
}

/// The texels that lookups at the points read.
fn texels_of(points: &[DVec3], volume: &Volume) -> Vec<[usize; 3]> {
    let mut all: Vec<[usize; 3]> = points.iter().flat_map(|&p| corners(p, volume.dims())).map(|c| c.0).collect();
    all.sort_unstable();
    all.dedup();
    all
}

/// Mean over the points of the interpolated a_k, with its standard error from the spread over
/// the points (which share few texels, so they are nearly independent).
fn surface_mean(baked: &Baked, points: &[DVec3], dims: [usize; 3], k: usize) -> Running {
    points.iter().map(|&p| corners(p, dims).iter().map(|(t, w)| w * baked.escape(*t, k)).sum::<f64>()).collect()
}

#[test]
fn five_level_sets_of_one_bake_let_half_of_the_light_out_at_every_bounce() {
    let volume = bowl(32);
    let surfaces: Vec<(f64, Vec<DVec3>)> =
        [8.0, 12.5, 17.3, 22.0, 28.8].map(|c| (c, surface_points(32, c, 150))).into();
    let all: Vec<DVec3> = surfaces.iter().flat_map(|s| s.1.clone()).collect();
    let baked = bake_texels(&volume, &settings(&[5, 4, 3, 3], 256, 1), &texels_of(&all, &volume));
    println!("{} texels, lost {:.5}", baked.summary.valid, baked.summary.lost_share());
    for (c, points) in &surfaces {
        for k in 0..4 {
            let mean = surface_mean(&baked, points, volume.dims(), k);
            let (ratio, error) = (mean.mean() / expected(k), mean.standard_error() / expected(k));
            println!("c {c:4} layer {k}: a_k/expected {ratio:.4} ± {error:.4}");
            // The target: 1 % for the discretisation, 3 standard errors for the noise.
            assert!((ratio - 1.0).abs() <= 0.01 + 3.0 * error, "c {c} layer {k}: {ratio} ± {error}");
        }
    }
    // Layer 18: every layer is 1 − f of the one before, over all surfaces together.
    for k in 1..4 {
        let ratio = |k| surface_mean(&baked, &all, volume.dims(), k).mean();
        let fall = ratio(k) / ratio(k - 1);
        println!("layer {k} over layer {}: {fall:.4}", k - 1);
        // Noise of either mean is below 1 % of it (750 points, 25 % each, shared texels).
        assert!((fall - (1.0 - OPEN)).abs() < 0.02 * (1.0 - OPEN), "{k}: {fall}");
    }
}

#[test]
fn one_texel_is_as_noisy_as_promised() {
    let volume = bowl(32);
    // Without the border: there the normal is extrapolated, see the bias below.
    let within = |t: [usize; 3]| {
        let r = (DVec3::new(t[0] as f64, t[1] as f64, t[2] as f64) - 32.0).length();
        (8.0..31.0).contains(&r) && t[2] < 31
    };
    // The target asks for 2 % of layer 0 at 256 rays. A half plane through a (0, 2)-net of 64 points
    // leaves 1.3 of them to chance (10 cells on its edge, p(1 − p) = 1/6 each), over four
    // replicates 1.3/64/2 of 1/2: 2.0 %, and 2.2 % for the curved edge of a tilted horizon. One net
    // of 256 points would give 1.5 %; four are the price of the error bars. Limit 2.3 %.
    for (rays, count, target) in [(256, 800, [0.023, 0.07, 0.15, 0.25]), (4096, 150, [0.003, 0.015, 0.035, 0.06])] {
        let texels = pick(volume.dims(), count, 11, within);
        let baked = bake_texels(&volume, &settings(&[5, 4, 3, 3], rays, 2), &texels);
        for k in 0..4 {
            let error = rms(texels.iter().map(|&t| baked.escape(t, k) / expected(k) - 1.0));
            println!("{rays} rays, layer {k}: {:.2} % of {:.1} %", 100.0 * error, 100.0 * target[k]);
            assert!(error <= target[k], "{rays} rays, layer {k}: {error}");
        }
    }
}

/// Apart from noise: the bias of the trilinear surface and of the smoothed normals.
#[test]
fn the_discretisation_bias_falls_with_the_square_of_the_radius() {
    let volume = bowl(40);
    for (border, constant) in [(false, 0.4), (true, 0.0)] {
        for c in [8.0, 16.0, 32.0] {
            let near = |t: [usize; 3]| {
                let radius = (DVec3::new(t[0] as f64, t[1] as f64, t[2] as f64) - 40.0).length();
                (radius - c).abs() < 0.5 && (t[2] == 40) == border
            };
            let texels = pick(volume.dims(), if border { 40 } else { 100 }, 7, near);
            let baked = bake_texels(&volume, &settings(&[1, 1, 1, 1], 4096, 3), &texels);
            let bias: Vec<Running> =
                (0..4).map(|k| texels.iter().map(|&t| baked.escape(t, k) / expected(k) - 1.0).collect()).collect();
            let shown: Vec<String> =
                bias.iter().map(|b| format!("{:+.3}±{:.3}", 100.0 * b.mean(), 100.0 * b.standard_error())).collect();
            println!(
                "c {c:2} voxels, at the border {border}: bias % of layers 0..3 {}  lost {:.5}",
                shown.join("  "),
                baked.summary.lost_share()
            );
            for (k, b) in bias.iter().enumerate() {
                let limit = if border {
                    // The samples beyond z = 0 are extrapolated linearly, so the normal of the
                    // rim leans up by 1/(2c) radian and sees that much more: (1 + 1/(2c))/2.
                    0.6 / c
                } else {
                    // The trilinear surface lies up to 1/(4c) voxel off, its facets lean by about
                    // 1/(2c) radian, and hide or lose directions within that of the horizon, a
                    // share 1/(4c²) of the cosine; each bounce adds its own.
                    constant * (k + 1) as f64 / (c * c)
                };
                assert!(b.mean().abs() <= limit + 3.0 * b.standard_error(), "c {c} layer {k}: {} {limit}", b.mean());
            }
        }
    }
}

/// VALIDATION 13: B = ρ f L/(1 − ρ(1 − f)), and the partial sums of the stored layers.
#[test]
fn relight_sums_all_bounces() {
    let volume = bowl(32);
    let points = surface_points(32, 20.0, 200);
    let texels = texels_of(&points, &volume);
    let positions: Vec<[f32; 3]> = points.iter().map(|p| p.as_vec3().to_array()).collect();
    let normals = vec![[0.0, 0.0, 1.0]; positions.len()];
    let light = Light::constant([1.0; 3]);
    for (layers, rays) in [(2, 256), (3, 256), (4, 256), (4, 1024)] {
        let baked = bake_texels(&volume, &settings(&vec![1; layers], rays, 5), &texels);
        let mut line = format!("{rays} rays, {layers} layers:");
        for rho in [0.2f32, 0.5, 0.8, 0.9, 0.95] {
            let material = Material::new([rho; 3], [0.0; 3]).unwrap();
            let textures = Textures::of_volume(&baked.texture).unwrap();
            let contracted = contract(&textures, &baked.bricks(), &light, &material).unwrap();
            let found = contracted.look_up(&positions, &normals, &light, &material);
            let mean: Running = found.radiance.iter().map(|c| f64::from(c[0])).collect();
            let r = f64::from(rho);
            let exact = r * OPEN / (1.0 - r * (1.0 - OPEN));
            let (off, error) = (mean.mean() / exact - 1.0, mean.standard_error() / exact);
            line += &format!("  ρ {rho}: {:+.2} ±{:.2} %", 100.0 * off, 100.0 * error);
            // All that survives escapes in the tail, however noisy a_K: what its relative error e does to the sum is of second order,
            // e² of the tail, (ρ/2)^N of the sum. e at 256 rays is 8, 14 and 24 % for K = 1, 2, 3, and falls as 1/sqrt(rays).
            let e = [0.08, 0.14, 0.24][layers - 2] * (256.0 / f64::from(rays)).sqrt();
            let tail = (r / 2.0).powi(layers as i32);
            let most = tail * e * e / (1.0 - r / 2.0) + 0.005 + 3.0 * error;
            assert!(off.abs() <= most, "{layers} layers, ρ {rho}: {off}, at most {most}");
        }
        println!("{line}");
    }
}

/// The bound of the plan: what layers beyond K bring is ρ^(K+2) f (1−f)^(K+1)/(1 − ρ(1−f)), the bound
/// ρ^(K+2) (1−f)^(K+1); their ratio f/(1 − ρ(1−f)) goes to 1 with ρ.
#[test]
fn the_bound_becomes_an_equality_on_the_bowl() {
    let volume = by_name("bowl:33").expect("a field").expect("a field").sample().expect("a volume");
    let pyramid = Pyramid::new(&volume);
    let of_layers = |count: usize| {
        let layers = Layers::uniform(count, 1).expect("layers");
        let layout =
            Layout { lattice: Lattice::from_ratio(volume.dims(), 1.0).expect("a lattice"), layers: layers.clone() };
        let settings = Settings { layers, rays: 64, seed: 3, target: None, positive: true };
        let selection = texels_of_isosurface(&volume, layout.lattice, 0.7);
        let bake = Bake::new(&volume, &pyramid, &layout, &settings, &selection);
        pilot(&bake, 500).expect("a pilot")
    };
    let (few, many) = (of_layers(2), of_layers(16));
    let escapes = many.mean_escapes();
    let mut before = 0.0;
    for rho in [0.3, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0f64] {
        let (bound, error) = few.bound(rho);
        let left_out: f64 = (2..16).map(|k| rho.powi(k as i32 + 1) * escapes[k]).sum();
        let ratio = left_out / bound;
        assert!(left_out <= bound + 3.0 * error.unwrap_or(0.0), "ρ = {rho}: {left_out} > {bound}");
        assert!(ratio > before, "ρ = {rho}: {ratio} after {before}");
        let expected = 0.5 / (1.0 - 0.5 * rho);
        assert!((ratio - expected).abs() < 0.05, "ρ = {rho}: {ratio} for {expected}");
        before = ratio;
    }
    // Paths that survive sixteen layers are 2⁻¹⁶ of all.
    assert!((before - 1.0).abs() < 0.01, "{before}");
}
