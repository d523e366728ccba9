use super::super::contract::Weights;
use super::super::twin;
use super::super::{Material, Textures, contract};
use super::*;
use crate::probe::{LatLong, project};
use crate::sampling::hash::uniform;
use crate::sh;
use crate::transfer::{BRICK_TEXELS, Brick, Lattice, Layout, MemoryTexture, validity};
use glam::{DVec3, Vec3};
use half::f16;

/// A direction from two numbers, uniform on the sphere.
fn direction(item: u64, sample: u32) -> DVec3 {
    let (u, v) = (f64::from(uniform(11, item, sample, 0)), f64::from(uniform(11, item, sample, 1)));
    let z = 1.0 - 2.0 * u;
    let r = (1.0 - z * z).max(0.0).sqrt();
    let turn = 2.0 * std::f64::consts::PI * v;
    DVec3::new(r * libm::cos(turn), r * libm::sin(turn), z)
}

fn delta(bands: usize, towards: DVec3, rgb: [f64; 3], ambient: f64) -> [Coefficients; 3] {
    std::array::from_fn(|c| &(&Coefficients::delta(bands, towards) * rgb[c]) + &Coefficients::constant(bands, ambient))
}

/// The skies of the full measurement (`probes/measure/certified.rs`), a few of each.
fn skies(bands: usize) -> Vec<(String, [Coefficients; 3])> {
    let item = bands as u64;
    let mut list = vec![
        ("black".to_string(), std::array::from_fn(|_| Coefficients::zero(bands))),
        ("constant".to_string(), [1.0, 1e-30, 1e30].map(|v| Coefficients::constant(bands, v))),
    ];
    for axis in [DVec3::X, DVec3::Y, DVec3::NEG_Y, DVec3::NEG_Z] {
        list.push((format!("sun at {axis}"), delta(bands, axis, [1.0, 0.9, 0.0], 0.0)));
    }
    let towards = direction(item, 7);
    let mut opposite = delta(bands, towards, [3.0; 3], 0.0);
    for c in &mut opposite {
        *c += &(&Coefficients::delta(bands, -towards) * 3.0);
    }
    list.push(("two opposite suns".into(), opposite));
    let (w, h) = (9, 5);
    let texel = |x: usize, y: usize| if (x, y) == (3, 1) { [1e6, 1e6, 0.0] } else { [0.1, 0.0, 0.0] };
    let random = |x: usize, y: usize| {
        std::array::from_fn(|c| libm::exp2(12.0 * f64::from(uniform(3, item, (y * w + x) as u32, c as u32)) - 6.0))
    };
    list.push(("one texel".into(), project(&LatLong::from_fn(w, h, texel), bands)));
    list.push(("random".into(), project(&LatLong::from_fn(w, h, random), bands)));
    list
}

/// The direction of least radiance among a few thousand.
fn darkest(light: &Coefficients) -> DVec3 {
    let mut least = (f64::INFINITY, DVec3::Z);
    for d in (0..2000).map(|i| direction(99, i)).chain([DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_Y, DVec3::NEG_Z]) {
        let value = light.evaluate(d);
        if value < least.0 {
            least = (value, d);
        }
    }
    least.1
}

#[test]
fn certified_light_is_nowhere_negative_in_any_layer() {
    for bands in 1..=sh::MAX_BANDS {
        let layers = Layers::new(vec![bands, bands.div_ceil(2)]).unwrap();
        for (name, sky) in skies(bands) {
            let prepared = prepare(&sky, &layers, Window::Certified).unwrap();
            for (k, &limit) in layers.bands().iter().enumerate() {
                let window = &prepared.windows[k];
                assert_eq!((window.bands, prepared.light.bands(k)), (limit, limit));
                assert!(window.floor >= 0.0, "{name}, {limit} bands: floor {}", window.floor);
                assert!((0.0..=1.0).contains(&window.kept.energy) && (0.0..=1.0).contains(&window.kept.contrast));
                for c in 0..3 {
                    let values = prepared.light.coefficients(k).iter().map(|v| v[c]).collect();
                    let light = Coefficients::new(limit, values).unwrap(); // refuses NaN
                    assert_eq!(light.mean(), sky[c].mean());
                    let least = light.evaluate(darkest(&light));
                    assert!(least >= 0.0 && least.is_finite(), "{name}, {limit} bands: {least}");
                }
            }
        }
    }
}

#[test]
fn a_layer_of_fewer_bands_needs_a_window_of_its_own() {
    let sun = delta(5, DVec3::Y, [1.0; 3], 0.0);
    let layers = Layers::new(vec![5, 4, 3, 3]).unwrap();
    let prepared = prepare(&sun, &layers, Window::Certified).unwrap();
    let five = Coefficients::new(5, prepared.light.coefficients(0).iter().map(|v| v[0]).collect()).unwrap();
    assert!(bounds(&five).0 >= 0.0 && bounds(&five.truncated(3)).0 < 0.0);
    assert_eq!(prepared.windows[2], prepared.windows[3]);
    assert_eq!(prepared.light.coefficients(3).len(), 9);
    assert_eq!(prepared.light.coefficients(7).len(), 9, "layers beyond see the last light");
    assert!(prepared.windows.iter().all(|w| w.blend.unwrap() > 0.9 && w.kept.contrast < 0.3));
    assert!(prepared.windows.iter().all(|w| w.kept.contrast >= prepared.least_kept().kept.contrast));
    // No window: nothing changes, and the floor tells how deep it rings.
    let plain = prepare(&sun, &layers, Window::None).unwrap();
    assert_eq!(plain.windows[0].kept, Kept { energy: 1.0, contrast: 1.0 });
    assert!(plain.windows[0].floor < -1.0 && plain.windows[0].blend.is_none());
    // Equal limits share a window.
    let even = prepare(&sun, &Layers::uniform(3, 5).unwrap(), Window::Lanczos).unwrap();
    assert_eq!(even.light.coefficients(1), even.light.coefficients(2));
}

#[test]
fn light_that_is_not_a_light_is_refused() {
    let layers = Layers::uniform(2, 4).unwrap();
    let negative = delta(4, DVec3::X, [-1.0; 3], 0.0);
    assert!(prepare(&negative, &layers, Window::Certified).is_err());
    assert!(prepare(&negative, &layers, Window::None).is_ok());
    let mut broken = delta(4, DVec3::X, [1.0; 3], 0.0);
    broken[1].values_mut()[3] = f64::NAN;
    assert!(prepare(&broken, &layers, Window::None).is_err());
}

/// T of a texel with four rays in f32, as an estimator without control variate makes it: layer k is the
/// sum of Y over the rays that escape after k bounces, over 4. Every third texel looks right
/// into the darkest direction.
fn transfer(layers: &Layers, texel: u32, darkest: Vec3) -> Vec<f32> {
    let mut transfer = vec![0.0f32; layers.coefficients()];
    for ray in 0..4u32 {
        let layer = (uniform(5, u64::from(texel), ray, 2) * 3.0) as usize;
        if layer >= layers.len() {
            continue; // lost or trapped
        }
        let d = if texel.is_multiple_of(3) { darkest } else { direction(u64::from(texel), ray).as_vec3().normalize() };
        let mut y = [0.0f32; sh::MAX_BANDS * sh::MAX_BANDS];
        sh::basis::evaluate_f32(layers.bands()[layer], d, &mut y);
        let count = layers.bands()[layer].pow(2);
        for (t, y) in transfer[layers.offset(layer)..][..count].iter_mut().zip(y) {
            *t += 0.25 * y;
        }
    }
    transfer
}

#[test]
fn relit_texels_of_four_rays_are_non_negative_in_single_precision() {
    let material = Material::new([0.7, 1.0, 0.3], [0.0; 3]).unwrap();
    let mut touched = 0;
    for bands in [1, 2, 3, 5, 8, 11] {
        let layers = Layers::new(vec![bands, bands.div_ceil(2)]).unwrap();
        for (name, sky) in skies(bands) {
            let prepared = prepare(&sky, &layers, Window::Certified).unwrap();
            let weights = Weights::new(&layers, &prepared.light, &material);
            let first =
                Coefficients::new(bands, prepared.light.coefficients(0).iter().map(|v| v[0]).collect()).unwrap();
            let dark = darkest(&first).as_vec3().normalize();
            let stderr = vec![f16::ZERO; layers.errors()];
            for texel in 0..300 {
                let rgb = twin::texel(&weights, &transfer(&layers, texel, dark), &stderr, &layers).rgb;
                assert!(rgb.min_element() >= 0.0 && rgb.is_finite(), "{name}, {bands} bands: {rgb}");
                let mean = (first.mean() * 0.7) as f32;
                touched += u32::from(rgb.x > 0.0 && rgb.x < 0.01 * mean);
            }
        }
    }
    assert!(touched > 100, "the test must come near to zero: {touched}");
}

#[test]
fn clamping_takes_out_what_is_negative_and_reports_it() {
    let lattice = Lattice::from_texels([8, 8, 8], [8, 8, 8]).unwrap();
    let layers = Layers::uniform(1, 1).unwrap();
    let mut texture = MemoryTexture::new(Layout { lattice, layers: layers.clone() });
    let mut brick = Brick::unbaked(&layers);
    for t in 0..BRICK_TEXELS {
        brick.transfer[t] = f16::from_f32(if t < 128 { -0.125 } else { 0.25 });
        brick.stderr[t] = f16::ZERO;
        brick.validity[t] = if t == 0 { 0 } else { validity::VALID };
    }
    texture.insert([0; 3], brick).unwrap();
    let material = Material::new([1.0; 3], [0.0; 3]).unwrap();
    let light = Light::new(vec![[2.0, 2.0, 0.0]]).unwrap();
    let mut contracted = contract(&Textures::of_volume(&texture).unwrap(), &[[0; 3]], &light, &material).unwrap();
    let report = contracted.clamp_negative();
    assert_eq!((report.texels, report.of_texels, report.deepest), (127, 511, -0.25));
    // Two channels: 127 × 0.25 taken, 384 × 0.5 left, each.
    assert!((report.energy - 127.0 * 0.25 / (384.0 * 0.5)).abs() < 1e-12);
    assert!((contracted.noise.mean_radiance - 2.0 * 384.0 * 0.5 / (3.0 * 511.0)).abs() < 1e-12);
    assert_eq!(contracted.texel([1, 0, 0])[..3], [0.0; 3]);
    assert_eq!(contracted.texel([7, 7, 7])[..3], [0.5, 0.5, 0.0]);
    assert_eq!(contracted.clamp_negative().energy, 0.0);
}
