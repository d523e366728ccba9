use super::*;
use crate::grid3;
use crate::transfer::{BRICK, BRICK_TEXELS, Brick, Lattice, Layers, Layout, MemoryTexture, validity};
use half::f16;

const CASES: [&[f32]; 8] = [
    &[0.5, 0.25, 0.125, 0.0625],
    &[0.9, 0.05, 0.01],
    // Layers that do not fall.
    &[0.6, 0.1, 0.1, 0.1],
    &[0.7, 0.0, 0.1],
    // No tail: nothing that falls.
    &[0.7, 0.1, 0.0],
    &[0.4],
    &[1.0, 0.0],
    &[0.0, 0.0, 0.0],
];

/// a_0, a_1, … far beyond the stored layers, as the tail continues them.
fn continued(escapes: &[f32], ratio: f64) -> Vec<f64> {
    let mut all: Vec<f64> = escapes.iter().map(|&a| f64::from(a)).collect();
    for _ in 0..20_000 {
        all.push(all[all.len() - 1] * ratio);
    }
    all
}

#[test]
fn the_tail_is_the_sum_of_the_layers_that_it_stands_for() {
    for escapes in CASES {
        let tail = Tail::new(escapes);
        let ratio = f64::from(tail.ratio);
        let all = continued(escapes, ratio);
        let total: f64 = all.iter().sum();
        // All escape where some do after the last layer.
        let expected = if tail.ratio > 0.0 { 1.0 } else { escapes.iter().map(|&a| f64::from(a)).sum() };
        assert!((total - expected).abs() < 1e-6, "{escapes:?}: {total} escapes of {expected}");
        for albedo in [0.0f32, 0.2, 0.7, 0.95, 1.0] {
            let (rho, last) = (f64::from(albedo), f64::from(*escapes.last().unwrap()));
            let direct: f64 = all[escapes.len()..].iter().enumerate().map(|(j, a)| rho.powi(j as i32 + 1) * a).sum();
            let found = f64::from(tail.gain(albedo)) * last;
            assert!((found - direct).abs() < 1e-6, "{escapes:?} albedo {albedo}: {found} {direct}");
        }
    }
    assert_eq!(Tail::new(&[0.5, 0.25, 0.125]).ratio, 0.5);
    for no_tail in [&[0.7, 0.1, 0.0][..], &[0.4], &[1.0, 0.0], &[0.0, 0.0, 0.0]] {
        assert_eq!(Tail::new(no_tail).ratio, 0.0, "{no_tail:?}");
    }
}

/// Two series at once, a fast and a slow one: the tail lies above the truth, and the measured ratio further below it.
#[test]
fn of_mixtures_the_tail_is_the_brightest() {
    for (share, fast, slow) in [(0.5, 0.1, 0.9), (0.9, 0.3, 0.8), (0.2, 0.5, 0.7), (0.99, 0.2, 0.97)] {
        let of = |k: i32| share * (1.0 - fast) * f64::powi(fast, k) + (1.0 - share) * (1.0 - slow) * f64::powi(slow, k);
        let escapes: Vec<f32> = (0..4).map(|k| of(k) as f32).collect();
        for albedo in [0.3f64, 0.7, 0.95] {
            let truth: f64 = (4..4000).map(|k| albedo.powi(k - 3) * of(k)).sum();
            let found = f64::from(Tail::new(&escapes).gain(albedo as f32)) * of(3);
            let x = albedo * of(3) / of(2);
            let darker = of(3) * x / (1.0 - x);
            assert!(
                darker <= truth && truth <= found * (1.0 + 1e-5),
                "{share} {fast} {slow} {albedo}: {darker} {truth} {found}"
            );
        }
    }
}

#[test]
fn emission_is_the_sum_over_all_bounces_of_what_survives() {
    for escapes in CASES {
        let tail = Tail::new(escapes);
        let all = continued(escapes, f64::from(tail.ratio));
        for albedo in [0.0f32, 0.2, 0.7, 0.95] {
            // Σ ρ^k S_k with S_k = 1 − Σ_{j<k} a_j; 20,000 terms of 0.95^k leave nothing.
            let (mut direct, mut survive, mut power) = (0.0, 1.0f64, 1.0);
            for a in &all {
                direct += power * survive.max(0.0);
                survive -= a;
                power *= f64::from(albedo);
            }
            let (found, remainder) = tail.emission(escapes, albedo);
            // f32, amplified by 1/(1 − ρ).
            let tolerance = 1e-6 / (1.0 - f64::from(albedo));
            assert!((f64::from(found) - direct).abs() < tolerance, "{escapes:?} {albedo}: {found} {direct}");
            assert_eq!(remainder, 0.0);
        }
        // ρ = 1 and survivors: the rest has no end and is reported.
        let (found, remainder) = tail.emission(escapes, 1.0);
        let forever = 1.0 - all.iter().sum::<f64>();
        assert!((f64::from(remainder) - forever.max(0.0)).abs() < 2e-6, "{escapes:?}: {remainder} {forever}");
        assert!(found.is_finite());
    }
}

#[test]
fn the_exposure_maps_the_99th_percentile_to_one() {
    // 101 grey levels 0, 0.1, … 10: the 99th percentile is 9.9. Channels count by their maximum.
    let radiance: Vec<[f32; 3]> = (0..101).rev().map(|i| [0.0, i as f32 / 10.0, 0.0]).collect();
    let factor = Exposure::Percentile.factor(&radiance);
    assert!((factor * 9.9 - 1.0).abs() < 1e-6, "{factor}");
    let shown = Exposure::apply(factor, &radiance);
    assert_eq!((shown[0], shown[100]), ([0.0, 1.0, 0.0], [0.0; 3]));
    // What is not finite is not looked at; nothing and black stay as they are.
    let mut broken = radiance.clone();
    broken.extend([[f32::NAN; 3], [f32::INFINITY; 3]]);
    assert_eq!(Exposure::Percentile.factor(&broken), factor);
    assert_eq!(Exposure::Percentile.factor(&[]), 1.0);
    assert_eq!(Exposure::Percentile.factor(&[[0.0; 3]; 5]), 1.0);
    assert_eq!(Exposure::Stops(-2.0).factor(&radiance), 0.25);
}

const SIDE: usize = 12;

/// A texture of 12³ texels, one a sample, filled by `texel`: coefficients (or none: not baked) and
/// whether it is valid.
fn texture(bands: &[usize], texel: impl Fn([usize; 3]) -> Option<(Vec<f32>, bool)>) -> MemoryTexture {
    let layers = Layers::new(bands.to_vec()).unwrap();
    let lattice = Lattice::from_ratio([SIDE; 3], 1.0).unwrap();
    let mut texture = MemoryTexture::new(Layout { lattice, layers: layers.clone() });
    let (n, e) = (layers.coefficients(), layers.errors());
    for b in 0..8 {
        let index = [b & 1, b >> 1 & 1, b >> 2];
        let mut brick = Brick::unbaked(&layers);
        for t in 0..BRICK_TEXELS {
            let inner = grid3::at([BRICK, BRICK], t);
            if let Some((values, valid)) = texel(std::array::from_fn(|a| index[a] * BRICK + inner[a])) {
                for (to, from) in brick.transfer[t * n..(t + 1) * n].iter_mut().zip(values) {
                    *to = f16::from_f32(from);
                }
                brick.stderr[t * e..(t + 1) * e].fill(f16::ZERO);
                brick.validity[t] = if valid { validity::VALID } else { 0 };
            }
        }
        texture.insert(index, brick).unwrap();
    }
    texture
}

fn all_bricks() -> Vec<[usize; 3]> {
    (0..8).map(|b| [b & 1, b >> 1 & 1, b >> 2]).collect()
}

#[test]
fn contraction_is_a_dot_product() {
    let bands = [4, 3, 1];
    let value = |i: usize| ((i * 37 % 101) as f32 / 101.0 - 0.4) * 0.3;
    let texture = texture(&bands, |t| {
        let first = grid3::index([SIDE, SIDE], t);
        // Chances to escape that fall, so that the tail is not empty.
        let mut v: Vec<f32> = (0..26).map(|i| value(first + i)).collect();
        (v[0], v[16], v[25]) = (0.15, 0.06, 0.02);
        Some((v, true))
    });
    let light: Vec<[f64; 3]> = (0..16).map(|i| std::array::from_fn(|c| ((i * 7 + c * 3) % 11) as f64 - 5.0)).collect();
    let light = Light::new(light).unwrap();
    let material = Material::new([0.9, 0.5, 0.0], [0.0; 3]).unwrap();
    let contracted = contract(&Textures::of_volume(&texture).unwrap(), &all_bricks(), &light, &material).unwrap();
    let mut report = LookupReport::default();
    for t in [[0, 0, 0], [3, 7, 8], [11, 11, 11], [8, 0, 5]] {
        let found = contracted.radiance_at(t.map(|v| v as f32), [0.0, 0.0, 1.0], &light, &material, &mut report);
        let stored: Vec<f64> = {
            let first = grid3::index([SIDE, SIDE], t);
            let mut v: Vec<f32> = (0..26).map(|i| value(first + i)).collect();
            (v[0], v[16], v[25]) = (0.15, 0.06, 0.02);
            v.iter().map(|&x| f16::from_f32(x).to_f64()).collect()
        };
        let escapes: Vec<f32> =
            [stored[0], stored[16], stored[25]].map(|v| (v * (4.0 * std::f64::consts::PI).sqrt()) as f32).into();
        for c in 0..3 {
            let rho = f64::from(material.albedo[c]);
            let dot = |offset: usize, n: usize| -> f64 {
                (0..n * n).map(|i| stored[offset + i] * light.coefficients(0)[i][c]).sum()
            };
            let tail = f64::from(Tail::new(&escapes).gain(material.albedo[c]));
            let exact = rho * dot(0, 4) + rho * rho * dot(16, 3) + rho.powi(3) * dot(25, 1) * (1.0 + tail);
            // 26 products of up to 5·0.2 in f32.
            assert!((f64::from(found[c]) - exact).abs() < 2e-6, "{t:?} {c}: {} {exact}", found[c]);
        }
    }
    assert_eq!((report.lookups, report.renormalised, report.unbaked), (4, 0, 0));
}

#[test]
fn every_fallback_of_the_lookup_does_what_it_says_and_is_counted() {
    // Radiance of a texel = x + 1, under white light: a_0 = (x + 1)/16.
    let root = (4.0 * std::f32::consts::PI).sqrt();
    let light = Light::constant([16.0; 3]);
    let material = Material::new([1.0; 3], [0.25, 0.0, 0.0]).unwrap();
    let plain = Material::new([1.0; 3], [0.0; 3]).unwrap();
    let value = |x: usize| vec![(x as f32 + 1.0) / 16.0 / root];
    let textured = texture(&[1], |t| match t {
        // Texels from x = 8 on have no level set but for one; from y = 8 on nothing is baked.
        [_, (8..), _] => None,
        [8, 2, 2] => Some((value(8), true)),
        [(8..), _, _] => Some((vec![0.0], false)),
        [x, _, _] => Some((value(x), true)),
    });
    let contracted = contract(&Textures::of_volume(&textured).unwrap(), &all_bricks(), &light, &plain).unwrap();
    let look = |p: [f32; 3], material: &Material| {
        let mut report = LookupReport::default();
        let found = contracted.radiance_at(p, [0.0, 0.0, 1.0], &light, material, &mut report);
        (found[0], report)
    };
    let near = |a: f32, b: f32| (a - b).abs() < 4e-3 * b; // f16
    let counts = |r: LookupReport| (r.renormalised, r.neighbourhood, r.unoccluded, r.unbaked);
    // All eight: trilinear.
    let (found, report) = look([2.25, 3.5, 1.75], &plain);
    assert!(near(found, 3.25) && counts(report) == (0, 0, 0, 0), "{found} {report:?}");
    // Between x = 7 (valid) and 8 (not): the weights of 7 are renormalised.
    let (found, report) = look([7.75, 5.5, 5.5], &plain);
    assert!(near(found, 8.0) && counts(report) == (1, 0, 0, 0), "{found} {report:?}");
    // On a texel without level set; within 4³ there are the texels of x = 7, and (8, 2, 2).
    let (found, report) = look([8.0, 5.5, 5.5], &plain);
    assert!(near(found, 8.0) && counts(report) == (0, 1, 0, 0), "{found} {report:?}");
    let (found, report) = look([9.5, 1.5, 1.5], &plain);
    assert!(near(found, 9.0) && counts(report) == (0, 1, 0, 0), "{found} {report:?}");
    // Nothing within reach: the unoccluded normal, with the material's emission.
    let (found, report) = look([10.5, 5.5, 5.5], &material);
    assert!(near(found, 16.25) && counts(report) == (0, 0, 1, 0), "{found} {report:?}");
    // Half of the corners were never baked, all of them, and none contracted.
    let (found, report) = look([3.0, 7.5, 3.0], &plain);
    assert!(near(found, 4.0) && counts(report) == (1, 0, 0, 1), "{found} {report:?}");
    let (_, report) = look([3.0, 10.5, 3.0], &plain);
    assert_eq!(counts(report), (0, 0, 1, 1));
    let nothing = contract(&Textures::of_volume(&textured).unwrap(), &[], &light, &plain).unwrap();
    let mut report = LookupReport::default();
    nothing.radiance_at([1.0; 3], [0.0, 0.0, 1.0], &light, &plain, &mut report);
    assert_eq!(counts(report), (0, 0, 1, 1));
    // A position outside is taken to the nearest face.
    assert!(near(look([-5.0, 3.0, 3.0], &plain).0, 1.0));
}

#[test]
fn lights_and_materials_that_make_no_sense_are_refused() {
    assert!(Light::new(vec![[0.0; 3]; 5]).is_err());
    assert!(Light::new(vec![[f64::NAN; 3]; 4]).is_err());
    assert!(Material::new([1.1, 0.0, 0.0], [0.0; 3]).is_err());
    assert!(Material::new([0.5; 3], [0.0, -1.0, 0.0]).is_err());
    // A light that ends in zeros needs fewer bands.
    let mut rgb = vec![[0.0; 3]; 25];
    rgb[3] = [0.0, 1.0, 0.0];
    assert_eq!(Light::new(rgb).unwrap().used_bands(0), 2);
}

/// Light whose square is beyond the type leaves the standard error of an open texel without a value, not the texel
/// without radiance.
#[test]
fn texels_keep_their_radiance_under_light_of_any_brightness() {
    let lattice = Lattice::from_texels([8, 8, 8], [8, 8, 8]).unwrap();
    let layers = Layers::uniform(1, 1).unwrap();
    let mut texture = MemoryTexture::new(Layout { lattice, layers: layers.clone() });
    let mut brick = Brick::unbaked(&layers);
    brick.transfer.fill(f16::from_f32(0.25));
    brick.stderr.fill(f16::ZERO);
    brick.validity.fill(validity::VALID);
    texture.insert([0; 3], brick).unwrap();
    let material = Material::new([1.0; 3], [0.0; 3]).unwrap();
    for brightness in [1.0f32, 1e18, 1e25, 1e30] {
        let light = Light::new(vec![[f64::from(brightness); 3]]).unwrap();
        let contracted = contract(&Textures::of_volume(&texture).unwrap(), &[[0; 3]], &light, &material).unwrap();
        let unknown = contracted.texel([3; 3])[3].is_nan();
        assert_eq!(unknown, brightness > 1e19, "the case is what it is meant to be");
        let found = contracted.look_up(&[[3.5; 3]], &[[0.0, 0.0, 1.0]], &light, &material);
        assert_eq!((found.report.neighbourhood, found.report.unoccluded), (0, 0), "{brightness}");
        // Eight weights, their products and sums: 24 roundings at most.
        let error = found.radiance[0].map(|r| (r / (0.25 * brightness) - 1.0).abs());
        assert!(error.iter().all(|e| *e <= 24.0 * f32::EPSILON), "{brightness}: {:?}", found.radiance);
    }
}
