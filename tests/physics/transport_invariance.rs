//! VALIDATION 6, 20 and its targets (same bytes): what must not change the result, does not.

use crate::common::{Baked, bake_texels, bowl, item, pick, random, settings, voxels, with_field};
use glam::{DMat3, DVec3};
use isolume::level::Pyramid;
use isolume::sampling::statistics::{Running, sidak};
use isolume::sh::{self, Coefficients, Rotation};
use isolume::transfer::{Lattice, Layout, Selection};
use isolume::transport::{Bake, PathEnd, Settings, Target, bake_brick, estimates, replay};
use isolume::volume::field::{BumpBox, Gyroid, sample};
use isolume::volume::{Samples, Volume};

fn with_values(volume: &Volume, change: impl Fn(usize, f32) -> f32) -> Volume {
    let Samples::F32(samples) = volume.samples() else { unreachable!() };
    let changed = Samples::F32(samples.iter().enumerate().map(|(i, &v)| change(i, v)).collect());
    let mut out = Volume::new(volume.dims(), changed, *volume.world_from_grid()).unwrap();
    out.solid = volume.solid;
    out
}

/// The estimate of one texel from its replayed paths, in f64 and without control variate:
/// Σ Y(ω) over the paths that escaped after k bounces, over their number.
fn from_replay(volume: &Volume, texel: [usize; 3], settings: &Settings) -> Vec<f64> {
    let layers = &settings.layers;
    let lattice = Lattice::from_ratio(volume.dims(), 1.0).unwrap();
    let mut sums = vec![0.0; layers.coefficients()];
    with_field(volume, |field| {
        let site = field.site(lattice.grid_from_texel(texel)).expect("a texel with a level set");
        let paths = replay(field, &site, item(&lattice, texel), settings);
        assert_eq!(paths.len(), settings.rays as usize);
        for path in paths.iter().filter(|p| p.ended == PathEnd::Escaped) {
            let k = path.vertices_in_grid.len() - 1;
            let bands = layers.bands()[k];
            let mut values = vec![0.0; bands * bands];
            sh::basis::evaluate(bands, path.last_direction_in_world.map(f64::from), &mut values);
            for (s, v) in sums[layers.offset(k)..].iter_mut().zip(&values) {
                *s += v / settings.rays as f64;
            }
        }
    });
    sums
}

#[test]
fn a_texel_replayed_alone_is_the_texel_of_the_bake() {
    let volume = sample(&Gyroid::default(), [33; 3]).unwrap();
    let texels = pick([33; 3], 60, 21, |_| true);
    let mut settings = settings(&[5, 4, 3, 3], 64, 3);
    settings.positive = true;
    let baked = bake_texels(&volume, &settings, &texels);
    // The symmetry of the gyroid gives some samples no gradient.
    let texels: Vec<[usize; 3]> = texels.into_iter().filter(|&t| baked.is_valid(t)).collect();
    assert!(texels.len() > 40);
    for &t in &texels {
        let again = from_replay(&volume, t, &settings);
        for (i, (a, b)) in baked.transfer(t).iter().zip(&again).enumerate() {
            // f16: half an ulp, 2⁻¹¹ relative; f32 sums of up to 64 terms |Y| ≤ 2.4 in the basis'
            // own rounding: 2⁻²⁴·64·2.4/64 and the cancellation within the sum: 3e-6 absolute.
            assert!((a - b).abs() <= 4.9e-4 * b.abs() + 3e-6, "{t:?} {i}: {a} {b}");
        }
    }
    // The control variate does not change a_k but by rounding, here to f16 by an ulp; elsewhere it does
    // something unless nothing was visible.
    let mut plain = settings.clone();
    plain.positive = false;
    let with = bake_texels(&volume, &plain, &texels);
    let mut changed = 0;
    for &t in &texels {
        let (a, b) = (with.transfer(t), baked.transfer(t));
        for first in [0, 25, 41, 50] {
            assert!((a[first] - b[first]).abs() <= 9.8e-4 * b[first] + 1e-6, "{} {}", a[first], b[first]);
        }
        changed += usize::from(a[1..25] != b[1..25] && a[26..41] != b[26..41] && a[51..59] != b[51..59]);
    }
    assert!(changed * 2 > texels.len(), "{changed}");
}

#[test]
fn a_texel_that_stops_early_is_the_texel_of_a_bake_with_as_many_rays() {
    let volume = sample(&Gyroid::default(), [33; 3]).unwrap();
    let texels = pick([33; 3], 120, 22, |_| true);
    let mut with_target = settings(&[3, 3, 2, 2, 2], 1024, 3);
    with_target.target = Some(Target::escape(&with_target.layers, 0.02));
    let found = bake_texels(&volume, &with_target, &texels);
    let stopped: Vec<([usize; 3], u32)> = texels
        .iter()
        .filter(|&&t| found.is_valid(t) && (17..1024).contains(&found.rays(t)))
        .map(|&t| (t, found.rays(t)))
        .collect();
    let compared = stopped.len();
    let pyramid = Pyramid::new(&volume);
    let layout =
        Layout { lattice: Lattice::from_ratio(volume.dims(), 1.0).unwrap(), layers: with_target.layers.clone() };
    let selection = Selection::empty(layout.lattice);
    let plain = Settings { target: None, ..with_target.clone() };
    let job = Bake::new(&volume, &pyramid, &layout, &plain, &selection);
    for ((t, rays), one) in stopped.iter().zip(estimates(&job, &stopped).unwrap()) {
        // The same paths in steps: only the order of the f32 sums differs, and what is stored is rounded to f16, by
        // half a unit, 2⁻¹¹.
        for (a, b) in found.transfer(*t).iter().zip(&one.unwrap()[0].transfer) {
            let b = f64::from(*b);
            assert!((a - b).abs() <= 2f64.powi(-11) * b.abs() + 3e-6, "{t:?} {rays} rays: {a} {b}");
        }
    }
    println!("{compared} of {} texels compared", texels.len());
    assert!(compared > 30, "{compared}");
}

#[test]
fn threads_and_partition_change_no_bit() {
    let volume = sample(&BumpBox, [41, 37, 35]).unwrap();
    let texels = pick([41, 37, 35], 600, 8, |_| true);
    let settings = settings(&[5, 3, 2], 16, 42);
    let with_threads = |n: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap();
        pool.install(|| bake_texels(&volume, &settings, &texels))
    };
    let one = with_threads(1);
    assert!(one.same_bits(&with_threads(2)));
    assert!(one.same_bits(&with_threads(5)));
    // Every brick alone is the brick of the whole.
    let pyramid = Pyramid::new(&volume);
    let lattice = Lattice::from_ratio(volume.dims(), 1.0).unwrap();
    let layout = Layout { lattice, layers: settings.layers.clone() };
    let mut selection = Selection::empty(lattice);
    texels.iter().for_each(|&t| selection.insert(t));
    let job = Bake::new(&volume, &pyramid, &layout, &settings, &selection);
    let mut alone =
        Baked { texture: isolume::transfer::MemoryTexture::new(layout.clone()), summary: one.summary.clone() };
    for b in selection.bricks() {
        alone.texture.insert(b, bake_brick(&job, b).unwrap().bricks.swap_remove(0)).unwrap();
    }
    assert!(one.same_bits(&alone));
    // Texels baked in two halves: a texel does not know its neighbours.
    let (first, second) = texels.split_at(300);
    let halves = [bake_texels(&volume, &settings, first), bake_texels(&volume, &settings, second)];
    for (half, list) in halves.iter().zip([first, second]) {
        assert!(list.iter().all(|&t| half.transfer(t) == one.transfer(t) && half.stderr(t) == one.stderr(t)));
    }
}

#[test]
fn scaling_by_powers_of_two_changes_no_bit_and_other_scalings_almost_nothing() {
    let volume = sample(&BumpBox, [40; 3]).unwrap();
    let texels = pick([40; 3], 150, 4, |_| true);
    let mut settings = settings(&[5, 3], 64, 6);
    let reference = bake_texels(&volume, &settings, &texels);
    for exponent in [-40, -3, 5, 60] {
        let factor = 2f32.powi(exponent);
        let scaled = bake_texels(&with_values(&volume, |_, v| v * factor), &settings, &texels);
        assert!(reference.same_bits(&scaled), "2^{exponent}");
    }
    // a·h + b rounds the samples anew, by 2⁻²⁴ of the largest value, and moves hits by that over
    // the gradient, some 1e-6 voxel. A path changes its fate when it passes an edge within that
    // distance: of the 10⁴ paths here with a few edges each, hardly ever one. All others agree to
    // rounding.
    settings.positive = true;
    for (a, b) in [(0.37f32, 0.0f32), (3.3, -100.0)] {
        let other = with_values(&volume, |_, v| a * v + b);
        let (mut far, mut difference, mut norm, mut count) = (0, 0.0, 0.0, 0);
        for &t in texels.iter().filter(|&&t| reference.is_valid(t)) {
            let (x, y) = (from_replay(&volume, t, &settings), from_replay(&other, t, &settings));
            let d: f64 = x.iter().zip(&y).map(|(x, y)| (x - y).powi(2)).sum();
            let n: f64 = x.iter().map(|x| x * x).sum();
            far += usize::from(d.sqrt() > 1e-5 * n.sqrt());
            (difference, norm, count) = (difference + d, norm + n, count + 1);
        }
        println!(
            "{a}·h + {b}: {far} of {count} texels differ by more than 1e-5, RMS {:.2e}",
            (difference / norm).sqrt()
        );
        assert!(far <= 2, "{far} texels");
    }
}

#[test]
fn what_a_level_set_cannot_see_does_not_change_it() {
    // The bowl of radius 20 voxels in a box of 32; texels with level sets of 19 to 21 voxels.
    let volume = bowl(32);
    let radius = |i: usize| {
        let [nx, ny, _] = volume.dims();
        (DVec3::new((i % nx) as f64, (i / nx % ny) as f64, (i / nx / ny) as f64) - 32.0).length()
    };
    let near = |t: [usize; 3]| (19.0..21.0).contains(&radius(volume.index(t[0], t[1], t[2])));
    let texels = pick(volume.dims(), 300, 17, near);
    let settings = settings(&[5, 3, 3], 64, 1);
    let reference = bake_texels(&volume, &settings, &texels);
    // In the lit space, 3 cells and more inside the smallest: anything from −3c to 0.5c.
    let dips =
        with_values(&volume, |i, v| if radius(i) < 15.0 { (20.0 * (3.5 * random(1, i) - 3.0)) as f32 } else { v });
    assert!(reference.same_bits_but_counts(&bake_texels(&dips, &settings, &texels)));
    // In the solid, beyond the largest: anything above.
    let bumps = with_values(&volume, |i, v| if radius(i) > 25.0 { (22.0 + 200.0 * random(2, i)) as f32 } else { v });
    assert!(reference.same_bits_but_counts(&bake_texels(&bumps, &settings, &texels)));
    // And what it can see does: the same dips raised above c.
    let seen = with_values(&volume, |i, v| if radius(i) < 6.0 { 60.0 } else { v });
    assert!(!reference.same_bits_but_counts(&bake_texels(&seen, &settings, &texels)));
}

/// The 24 rotations of the cube as matrices of 0 and ±1.
fn cube_rotations() -> Vec<DMat3> {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z];
    let mut all = Vec::new();
    for x in axes {
        for y in axes {
            if x.dot(y) == 0.0 {
                all.push(DMat3::from_cols(x, y, x.cross(y)));
            }
        }
    }
    assert_eq!(all.len(), 24);
    all
}

#[test]
fn a_rotated_volume_under_a_rotated_sky_looks_the_same() {
    const N: usize = 25;
    // No symmetry: two solid blobs and a tilted ramp.
    let shape = |p: DVec3| {
        let blob = |c: DVec3, r: f64| r - (p - c).length();
        blob(DVec3::new(3.0, -2.0, 1.0), 5.0).max(blob(DVec3::new(-4.0, 3.0, -4.0), 4.0)) - 0.1 * p.x + 0.05 * p.z
    };
    let centre = DVec3::splat(12.0);
    let at = |t: [usize; 3]| DVec3::new(t[0] as f64, t[1] as f64, t[2] as f64) - centre;
    let volume = voxels([N; 3], [-12.0; 3], shape);
    let texels = pick([N; 3], 150, 33, |t| at(t).abs().max_element() < 9.0);
    let settings = settings(&[5, 4, 3], 256, 10);
    let layers = settings.layers.clone();
    let baked = bake_texels(&volume, &settings, &texels);
    let light = Coefficients::new(5, (0..25).map(|i| random(9, i) - 0.5).collect()).unwrap();
    const RHO: f64 = 0.7;
    // Exitant radiance and its variance, from coefficients and errors; f32 as in the program.
    let relight = |transfer: &[f64], light: &Coefficients| -> f64 {
        let mut sum = 0.0f32;
        for k in 0..layers.len() {
            let n = layers.bands()[k] * layers.bands()[k];
            let power = RHO.powi(k as i32 + 1);
            for i in 0..n {
                sum += (power * light.values()[i]) as f32 * transfer[layers.offset(k) + i] as f32;
            }
        }
        f64::from(sum)
    };
    let mut rejected = Vec::new();
    for (r, rotation) in cube_rotations().iter().enumerate() {
        let inverse = rotation.transpose();
        let harmonics = Rotation::new(5, rotation).unwrap();
        let turned_light = harmonics.apply(&light);
        let turned = voxels([N; 3], [-12.0; 3], |p| shape(inverse * p));
        let to = |t: [usize; 3]| ((*rotation * at(t)) + centre).to_array().map(|v| v.round() as usize);
        let again = bake_texels(&turned, &settings, &texels.iter().map(|&t| to(t)).collect::<Vec<_>>());
        let mut difference = Running::new();
        let (mut squares, mut claimed) = (0.0, 0.0);
        for &t in &texels {
            let transfer = baked.transfer(t);
            let mut rotated = transfer.clone();
            for k in 0..layers.len() {
                let (o, n) = (layers.offset(k), layers.bands()[k] * layers.bands()[k]);
                harmonics.apply_slice(&transfer[o..o + n], &mut rotated[o..o + n]);
            }
            // 50 products of size ≤ 0.5·0.3: rounding 50·2⁻²⁴·0.15, at most 5e-7.
            let (a, b) = (relight(&transfer, &light), relight(&rotated, &turned_light));
            assert!((a - b).abs() < 1e-6, "rotation {r} texel {t:?}: {a} {b}");
            let c = relight(&again.transfer(to(t)), &turned_light);
            difference.push(c - a);
            squares += (c - a).powi(2);
            let variance = |baked: &Baked, t: [usize; 3], light: &Coefficients| -> f64 {
                let errors = baked.stderr(t);
                (0..layers.len())
                    .flat_map(|k| (0..layers.bands()[k]).map(move |l| (k, l)))
                    .map(|(k, l)| {
                        let e = RHO.powi(k as i32 + 1) * errors[layers.error_offset(k) + l];
                        e * e * light.band_energy(l)
                    })
                    .sum()
            };
            claimed += variance(&baked, t, &light) + variance(&again, to(t), &turned_light);
        }
        let p = if r == 0 { 1.0 } else { difference.p_of_mean(0.0) };
        let spread = (squares / claimed).sqrt();
        if p < sidak(0.01, 23) || spread > 1.4 {
            rejected.push((r, p, spread));
        }
        if r % 6 == 1 {
            println!("rotation {r}: p {p:.3}, RMS difference over combined standard error {spread:.3}");
        }
    }
    assert!(rejected.is_empty(), "{rejected:?}");
}
