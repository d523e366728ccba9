//! VALIDATION 29, environments: one test for each kind that breaks renderers, and properties of any image at
//! all. What must hold: everything stays finite, what is exact stays exact, and light is neither made nor lost.

use crate::common::{Baked, bake_texels, bowl, pick, settings, voxels};
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, ImageAttributes, Layer, LayerAttributes, WritableImage,
};
use glam::DVec3;
use isolume::geom::Up;
use isolume::probe::{self, LatLong, Layout, Orientation, Probe, ReadOptions};
use isolume::relight::{Light, Material, Textures, contract, prepare};
use isolume::sh::{self, MAX_BANDS, Window};
use proptest::prelude::*;
use std::f64::consts::PI;
use std::sync::OnceLock;

/// Texels of a bowl, seen from inside: half open, with light between its walls.
struct Scene {
    baked: Baked,
    texels: Vec<[usize; 3]>,
}

fn scene(bands: usize) -> Scene {
    let volume = bowl(12);
    let texels = pick(volume.dims(), 40, 5, |t| {
        let p = t.map(|v| v as f64 - 12.0);
        (6.0..11.0).contains(&(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt())
    });
    let baked = bake_texels(&volume, &settings(&[bands; 4], 64, 3), &texels);
    let texels = texels.into_iter().filter(|&t| baked.is_valid(t)).collect();
    Scene { baked, texels }
}

/// The scene with 5 bands, baked once.
fn usual() -> &'static Scene {
    static SCENE: OnceLock<Scene> = OnceLock::new();
    SCENE.get_or_init(|| scene(5))
}

impl Scene {
    /// Radiance at the texels; everything is finite, whatever the light.
    fn relit(&self, light: &Light, albedo: f32) -> Vec<[f32; 3]> {
        let material = Material::new([albedo; 3], [0.0; 3]).expect("a material");
        let contracted =
            contract(&Textures::of_volume(&self.baked.texture).expect("grey"), &self.baked.bricks(), light, &material)
                .expect("contracted");
        let positions: Vec<[f32; 3]> = self.texels.iter().map(|t| t.map(|v| v as f32)).collect();
        let normals = vec![[0.0, 0.0, 1.0]; positions.len()];
        let radiance = contracted.look_up(&positions, &normals, light, &material).radiance;
        assert!(radiance.iter().flatten().all(|v| v.is_finite()), "{radiance:?}");
        radiance
    }
}

fn light(probe: &Probe, bands: usize) -> Light {
    let orientation = Orientation::new(Up::Z, 0.0).expect("an angle");
    Light::from_channels(&probe.coefficients_in_world(bands, orientation)).expect("finite light")
}

fn grey(width: usize, height: usize, value: impl Fn(usize, usize) -> f32) -> Probe {
    let pixels = (0..width * height).map(|i| [value(i % width, i / width); 3]).collect();
    Probe::from_image("test", LatLong::new(width, height, pixels).expect("an image"))
}

/// An OpenEXR file of any pixels.
fn exr_file(width: usize, height: usize, pixels: &[[f32; 3]]) -> Vec<u8> {
    let channel =
        |c: usize| AnyChannel::new(["R", "G", "B"][c], FlatSamples::F32(pixels.iter().map(|p| p[c]).collect()));
    let channels = AnyChannels::sort((0..3).map(channel).collect());
    let layer = Layer::new((width, height), LayerAttributes::default(), Encoding::UNCOMPRESSED, channels);
    let mut bytes = std::io::Cursor::new(Vec::new());
    let image = Image::empty(ImageAttributes::with_size((width, height))).with_layer(layer);
    image.write().to_buffered(&mut bytes).expect("memory");
    bytes.into_inner()
}

#[test]
fn one_texel_of_1e6() {
    // Relighting is linear: a lamp of 10⁶ is 10⁶ lamps of 1, to the rounding of the last f32.
    let lamp = |value: f32| grey(64, 32, move |x, y| if (x, y) == (20, 9) { value } else { 0.0 });
    let (one, million) = (usual().relit(&light(&lamp(1.0), 5), 0.8), usual().relit(&light(&lamp(1e6), 5), 0.8));
    for (a, b) in one.iter().zip(&million) {
        assert!((1e6 * a[0] - b[0]).abs() <= 1e-5 * b[0].abs() + 1e-3, "{a:?} {b:?}");
    }
    // All of its power is in the mean.
    let (image, power) = (lamp(1e6).image, 1e6 * lamp(1.0).image.pixel_solid_angle(9));
    assert!((image.mean()[0] * 4.0 * PI - power).abs() <= 1e-12 * power);
}

#[test]
fn a_sun_exactly_on_the_poles() {
    for (spec, y) in [("sun:0,90", 1.0), ("sun:0,-90", -1.0), ("sun:77,90", 1.0)] {
        let sun = probe::by_name(spec).expect("a sky").expect("a sky");
        let [red, ..] = sun.coefficients(MAX_BANDS);
        // Symmetric about y: the first band points along y alone, Y_1,-1 = 0.488603 y.
        let c = red.values();
        assert!(c[1] * y > 0.0 && c[2].abs() < 1e-6 * c[1].abs() && c[3].abs() < 1e-6 * c[1].abs(), "{spec} {c:?}");
        // And as every pixel of the image it comes from the same place: rotating about up changes nothing.
        let turned = |degrees| Orientation::new(Up::Y, degrees).expect("an angle");
        let a = sun.coefficients_in_world(5, turned(0.0));
        let b = sun.coefficients_in_world(5, turned(33.0));
        for (a, b) in a[0].values().iter().zip(b[0].values()) {
            assert!((a - b).abs() < 1e-6 * c[0], "{spec}: {a} {b}");
        }
        usual().relit(&light(&sun, 5), 0.5);
    }
}

#[test]
fn all_zero() {
    let black = light(&grey(16, 8, |_, _| 0.0), 5);
    assert!(usual().relit(&black, 1.0).iter().flatten().all(|v| *v == 0.0));
}

#[test]
fn constant() {
    // Inside the bowl form factors are uniform and f = 1/2 everywhere: B = ρ f L / (1 − ρ(1 − f)) = 1/3 at
    // ρ = 1/2, L = 1 (VALIDATION 13). The mean of the texels has their combined standard error.
    let scene = usual();
    let radiance = scene.relit(&light(&grey(16, 8, |_, _| 1.0), 5), 0.5);
    let n = radiance.len() as f64;
    let mean = radiance.iter().map(|r| f64::from(r[0])).sum::<f64>() / n;
    let spread = radiance.iter().map(|r| (f64::from(r[0]) - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let bound = 4.0 * (spread / n).sqrt() + 0.01; // 0.01: the wall of the bowl is cut by voxels of radius/12.
    assert!((mean - 1.0 / 3.0).abs() < bound, "{mean} ± {bound}");
}

#[test]
fn two_opposite_suns() {
    let at = |longitude: f64| -> DVec3 { DVec3::new(longitude.sin(), 0.0, longitude.cos()) };
    let image = grey(64, 32, |_, _| 0.0).image;
    let (first, second) = (image.pixel_at(at(0.4) + 0.01 * DVec3::Y), image.pixel_at(-at(0.4) - 0.01 * DVec3::Y));
    let suns = grey(64, 32, |x, y| if (x, y) == first || (x, y) == second { 1000.0 } else { 0.0 });
    let [red, ..] = suns.coefficients(5);
    let c = red.values();
    // No direction at all in band 1: windows and lobes may not divide by it.
    assert!((1..4).all(|i| c[i].abs() < 1e-12 * c[0]), "{c:?}");
    let layers = isolume::transfer::Layers::uniform(4, 5).expect("layers");
    let whole = suns.coefficients_in_world(5, Orientation::new(Up::Z, 0.0).expect("an angle"));
    for window in [Window::None, Window::Lanczos, Window::Hanning, Window::Certified] {
        let prepared = prepare(&whole, &layers, window).expect("prepared");
        usual().relit(&prepared.light, 0.9);
    }
    assert!(probe::report(&suns, 5).lobe.is_some_and(|l| l.luminance.is_finite()));
}

#[test]
fn negative_and_nan_texels() {
    let mut pixels = vec![[0.5; 3]; 32];
    pixels[3] = [f32::NAN, 0.5, -1.0];
    pixels[4] = [f32::INFINITY, f32::NEG_INFINITY, -f32::MAX];
    let file = exr_file(8, 4, &pixels);
    let read = Probe::from_bytes("bad", &file, &ReadOptions::default()).expect("read");
    assert_eq!((read.bad.nan, read.bad.infinite, read.bad.negative), (1, 1, 2));
    assert_eq!(read.image.pixels()[3..5], [[0.0, 0.5, 0.0], [0.0; 3]]);
    usual().relit(&light(&read, 5), 1.0);
    // Kept, negative light subtracts: linear, and still finite.
    pixels[4] = [-2.0; 3];
    let keep = ReadOptions { keep_negative: true, ..ReadOptions::default() };
    let kept = Probe::from_bytes("bad", &exr_file(8, 4, &pixels), &keep).expect("read");
    assert_eq!(kept.image.pixels()[4], [-2.0; 3]);
    usual().relit(&light(&kept, 5), 1.0);
}

#[test]
fn a_single_pixel() {
    let pixel = Probe::from_bytes("one", &exr_file(1, 1, &[[2.0, 3.0, 4.0]]), &ReadOptions::default()).expect("read");
    assert_eq!((pixel.image.width(), pixel.image.height()), (1, 1));
    for (channel, value) in pixel.coefficients(MAX_BANDS).iter().zip([2.0, 3.0, 4.0]) {
        // A constant: L·sqrt(4π) and nothing else.
        let c = channel.values();
        assert!((c[0] - value * (4.0 * PI).sqrt()).abs() < 1e-12 * value, "{}", c[0]);
        assert!(c[1..].iter().all(|v| v.abs() < 1e-11), "{c:?}");
    }
}

#[test]
fn odd_sizes() {
    for (width, height) in [(1, 2), (2, 1), (3, 1), (7, 5), (5, 5), (13, 64), (1, 6), (1000, 1), (1, 1000)] {
        let pixels: Vec<[f32; 3]> = (0..width * height).map(|i| [1.0 + (i % 5) as f32; 3]).collect();
        let read = Probe::from_bytes("odd", &exr_file(width, height, &pixels), &ReadOptions::default()).expect("read");
        assert_eq!(read.stored_size, [width, height]);
        let mean = read.image.mean()[0];
        assert!((1.0..=5.0).contains(&mean), "{width}×{height}: {mean}");
        let c = read.coefficients(MAX_BANDS)[0].values()[0];
        assert!((c / (4.0 * PI).sqrt() - mean).abs() < 1e-12 * mean, "{width}×{height}: {c} {mean}");
        usual().relit(&light(&read, 5), 0.7);
    }
}

#[test]
fn a_range_of_21_stops() {
    // 2⁻¹⁰ … 2¹¹ from pixel to pixel; f32 keeps each to 2⁻²⁴ of itself, and so must the reader.
    let value = |i: usize| 2f32.powi((i * 9 % 22) as i32 - 10) * (1.0 + 2f32.powi(-20));
    let pixels: Vec<[f32; 3]> = (0..512).map(|i| [value(i); 3]).collect();
    let read = Probe::from_bytes("range", &exr_file(32, 16, &pixels), &ReadOptions::default()).expect("read");
    assert_eq!(read.image.pixels(), pixels);
    assert!((probe::report(&read, 5).range_ev - 21.0).abs() < 1e-9);
    usual().relit(&light(&read, 5), 0.7);
}

#[test]
fn bands_1_and_11() {
    let sky = probe::by_name("sunset").expect("embedded").expect("embedded");
    for bands in [1, MAX_BANDS] {
        let scene = scene(bands);
        let radiance = scene.relit(&light(&sky, bands), 0.8);
        assert!(radiance.iter().any(|r| r[0] > 0.0), "{bands} bands");
        // Under a constant light the number of bands does not matter: only band 0 answers.
        let constant = scene.relit(&Light::constant([1.0; 3]), 0.8);
        let cut = scene.relit(&light(&grey(16, 8, |_, _| 1.0), bands), 0.8);
        for (a, b) in constant.iter().zip(&cut) {
            assert!((a[0] - b[0]).abs() < 1e-5, "{bands} bands: {a:?} {b:?}");
        }
    }
}

#[test]
fn albedos_0_and_nearly_1_and_1() {
    let scene = usual();
    let under = |albedo: f32| scene.relit(&Light::constant([1.0; 3]), albedo);
    assert!(under(0.0).iter().flatten().all(|v| *v == 0.0));
    let (grey, nearly, white) = (under(0.5), under(0.99), under(1.0));
    for ((a, b), c) in grey.iter().zip(&nearly).zip(&white) {
        // More albedo, more light; and never more than there is, up to the estimate's own noise: a texel has 64
        // paths, of which the tail beyond the last layer is extrapolated.
        assert!(a[0] < b[0] && b[0] <= c[0], "{a:?} {b:?} {c:?}");
        assert!(c[0] <= 1.0 + 1e-3, "{c:?}");
    }
}

#[test]
fn light_is_as_the_library_says_at_every_albedo_it_accepts() {
    for wrong in [-0.1, 1.1, f32::NAN, f32::INFINITY] {
        assert!(Material::new([wrong; 3], [0.0; 3]).is_err(), "{wrong}");
    }
}

/// Any f32 at all: NaN, infinities, negative, subnormal and the largest among them.
fn any_pixel() -> impl Strategy<Value = [f32; 3]> + Clone {
    let value = prop_oneof![
        any::<u32>().prop_map(f32::from_bits),
        prop::sample::select(vec![0.0, -0.0, 1e38, -1e38, 1e-40, f32::MAX, f32::MIN_POSITIVE, f32::NAN, -1.0, 1.0]),
    ];
    [value.clone(), value.clone(), value]
}

fn any_image(pixel: impl Strategy<Value = [f32; 3]> + Clone) -> impl Strategy<Value = (usize, usize, Vec<[f32; 3]>)> {
    (1usize..12, 1usize..9).prop_flat_map(move |(w, h)| (Just(w), Just(h), prop::collection::vec(pixel.clone(), w * h)))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever the pixels, what is read is finite and has finite coefficients, and the counts are true.
    #[test]
    fn any_pixels_become_a_finite_probe((width, height, pixels) in any_image(any_pixel()), keep_negative: bool) {
        let options = ReadOptions { keep_negative, layout: Some(Layout::LatLong), ..ReadOptions::default() };
        let read = Probe::from_bytes("any", &exr_file(width, height, &pixels), &options).unwrap();
        let count = |bad: &dyn Fn(&f32) -> bool| pixels.iter().filter(|p| p.iter().any(bad)).count() as u64;
        prop_assert_eq!(read.bad.nan, count(&|v| v.is_nan()));
        prop_assert_eq!(read.bad.infinite, count(&|v| v.is_infinite()));
        prop_assert_eq!(read.bad.negative, count(&|v| *v < 0.0 && v.is_finite()));
        for (found, stored) in read.image.pixels().iter().flatten().zip(pixels.iter().flatten()) {
            let expected = if stored.is_finite() && (keep_negative || *stored > 0.0) { *stored } else { 0.0 };
            prop_assert_eq!(*found, expected);
        }
        for channel in read.coefficients(MAX_BANDS) {
            prop_assert!(channel.values().iter().all(|v| v.is_finite()));
        }
        let _ = probe::diagnose(&read);
    }

    /// Projection keeps the mean exactly and never makes energy: L_00 = sqrt(4π) · mean, Σ L² ≤ ∫ L² dω.
    #[test]
    fn projection_keeps_the_mean_and_adds_no_energy(
        (width, height, pixels) in any_image([-1e3f32..1e3, 0f32..1e-3, -1e30f32..1e30]),
    ) {
        let image = LatLong::new(width, height, pixels).unwrap();
        let mean = image.mean();
        let coefficients = probe::project(&image, MAX_BANDS);
        for c in 0..3 {
            let (mut energy, mut size) = (0.0, 0.0);
            for y in 0..height {
                for p in image.row(y) {
                    energy += f64::from(p[c]).powi(2) * image.pixel_solid_angle(y);
                    size += f64::from(p[c]).abs() * image.pixel_solid_angle(y);
                }
            }
            let found = coefficients[c].values();
            prop_assert!((found[0] - mean[c] * (4.0 * PI).sqrt()).abs() <= 1e-12 * size);
            let kept: f64 = found.iter().map(|v| v * v).sum();
            prop_assert!(kept <= energy * (1.0 + 1e-11), "{} of {}", kept, energy);
        }
        prop_assert_eq!(coefficients[0].values().len(), sh::basis::count(MAX_BANDS));
    }

    /// From cube faces to lat-long: the light of any non-negative picture is kept to what the samples of one
    /// pixel resolve (3 %, stated at the conversion), and no value leaves the range of the picture.
    #[test]
    fn resampling_keeps_light_and_range(pixels in prop::collection::vec([0f32..1.0, 0f32..100.0, 0.5f32..0.6], 6 * 64)) {
        let n = 8;
        let options = ReadOptions { layout: Some(Layout::CubeStrip), ..ReadOptions::default() };
        let read = Probe::from_bytes("cube", &exr_file(n, 6 * n, &pixels), &options).unwrap();
        // Solid angle of [0, a] × [0, b] on the plane at distance 1: atan(ab / sqrt(1+a²+b²)).
        let corner = |a: f64, b: f64| (a * b / (1.0 + a * a + b * b).sqrt()).atan();
        let edge = |k: usize| 2.0 * k as f64 / n as f64 - 1.0;
        let mean = read.image.mean();
        for c in 0..3 {
            let mut light = 0.0;
            let (mut low, mut high) = (f32::MAX, 0f32);
            for (i, p) in pixels.iter().enumerate() {
                let (x, y) = (i % n, i / n % n);
                let (a, b, d, e) = (edge(x), edge(x + 1), edge(y), edge(y + 1));
                light += f64::from(p[c]) * (corner(b, e) - corner(a, e) - corner(b, d) + corner(a, d));
                (low, high) = (low.min(p[c]), high.max(p[c]));
            }
            let expected = light / (4.0 * PI);
            prop_assert!((mean[c] - expected).abs() <= 0.03 * expected, "{} {}", mean[c], expected);
            for p in read.image.pixels() {
                prop_assert!((low * (1.0 - 1e-6)..=high * (1.0 + 1e-6)).contains(&p[c]));
            }
        }
    }
}

/// A scene that is not a bowl, so that the claims do not rest on its symmetry.
#[test]
fn a_slab_under_each_of_the_named_skies_is_finite() {
    let volume = voxels([9, 9, 9], [0.0; 3], |p| 4.2 - p.z + 0.3 * (p.x * 1.3).sin());
    let texels = pick([9; 3], 20, 8, |_| true);
    let baked = bake_texels(&volume, &settings(&[5, 4], 16, 1), &texels);
    let texels = texels.into_iter().filter(|&t| baked.is_valid(t)).collect();
    let scene = Scene { baked, texels };
    for name in ["constant", "gradient", "overcast", "sky", "sun:0,90", "sun:12,-90", "courtyard", "studio", "sunset"] {
        let probe = probe::by_name(name).expect("a sky").expect("a sky");
        for albedo in [0.0, 0.99, 1.0] {
            scene.relit(&light(&probe, 5), albedo);
        }
    }
}
