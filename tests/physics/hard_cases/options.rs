//! Options at their ends: 1 and 11 bands, albedo 0, 0.99 and 1, bakes and lights that nothing comes of.

use super::solve::{Estimator, Solved, solve_with};
use crate::common::cases::floats;
use isolume::geom::Up;
use isolume::probe::{LatLong, Orientation, Probe};
use isolume::relight::{Light, LookupReport, Material, Textures, contract, prepare};
use isolume::sh::Window;
use isolume::transfer::{BrickSource, Lattice, Layers};
use isolume::volume::Volume;

/// A closed room: solid outside a ball of radius 0.9 of the half side, light inside.
fn room() -> Volume {
    floats([13; 3], |at| at.iter().map(|&v| (v as f64 / 6.0 - 1.0).powi(2)).sum::<f64>().sqrt()).unwrap()
}

/// A ball, lit outside.
fn ball() -> Volume {
    floats([13; 3], |at| -at.iter().map(|&v| (v as f64 / 6.0 - 1.0).powi(2)).sum::<f64>().sqrt()).unwrap()
}

/// Radiance at a lattice point.
fn at(solved: &Solved, texel: [f32; 3], light: &Light, material: &Material) -> ([f32; 3], f32) {
    let contracted =
        contract(&Textures::of_volume(&solved.texture).unwrap(), &solved.selection.bricks(), light, material).unwrap();
    let mut report = LookupReport::default();
    let radiance = contracted.radiance_at(texel, [0.0, 0.0, 1.0], light, material, &mut report);
    assert_eq!((report.unbaked, report.unoccluded), (0, 0));
    (radiance, contracted.emission_remainder)
}

#[test]
fn albedo_1_in_a_closed_room_stops_and_says_what_it_left_out() {
    // Texel (6, 6, 11) lies on the level set of radius 5/6, which is closed: nothing escapes.
    let (volume, light) = (room(), Light::constant([1.0; 3]));
    for layers in [1, 2, 5] {
        for estimator in Estimator::ALL {
            let solved = solve_with(&volume, estimator, Layers::uniform(layers, 2).unwrap(), 16).unwrap();
            let glowing =
                |albedo: f32| at(&solved, [6.0, 6.0, 11.0], &light, &Material::new([albedo; 3], [1.0; 3]).unwrap());
            // Each bounce adds the emission whole: N + 1 terms, and one more of 1 per bounce is left out.
            let (sum, left_out) = glowing(1.0);
            if estimator == Estimator::Gather {
                // Its cache interpolates between level sets, the corners of the room open ones among them: a leak of a thousandth, through
                // which a white room sees at most the whole sky, of radiance 1, in the end. What it glows has an end all the same.
                let most = layers as f32 + 2.0;
                assert!((0.99 * (most - 1.0)..1.01 * most).contains(&sum[0]) && left_out <= 1.0, "{layers}: {sum:?}");
                continue;
            }
            assert_eq!((sum, left_out), ([layers as f32 + 1.0; 3], 1.0), "{layers} layers by {estimator:?}");
            // Just below 1 the series has an end, 1/(1 − ρ).
            let (sum, left_out) = glowing(0.99);
            assert!((sum[0] / 100.0 - 1.0).abs() < 1e-4 && left_out == 0.0, "{layers}: {sum:?} {left_out}");
            assert_eq!(glowing(0.0), ([1.0; 3], 0.0));
        }
    }
}

#[test]
fn albedo_1_of_what_is_open_leaves_nothing_out_of_reflection() {
    // ρ = 1 and constant light: every path escapes or is cut; Σ a_k with its tail is at most 1.
    let solved = solve_with(&ball(), Estimator::Path, Layers::uniform(2, 3).unwrap(), 16).unwrap();
    let white = Material::new([1.0; 3], [0.0; 3]).unwrap();
    let (radiance, left_out) = at(&solved, [6.0, 6.0, 10.0], &Light::constant([1.0; 3]), &white);
    assert!(radiance[0] <= 1.001 && radiance[0] > 0.9 && left_out == 0.0, "{radiance:?} {left_out}");
}

#[test]
fn one_band_and_eleven_bands_are_lit_within_the_light() {
    // The ball is convex, so its top sees the upper half of a sky; T_0 of a convex texel under a constant
    // light is 1 in every band limit.
    for bands in [1, 11] {
        for estimator in Estimator::ALL {
            let solved = solve_with(&ball(), estimator, Layers::uniform(2, bands).unwrap(), 16).unwrap();
            solved.check(&format!("{bands} bands by {estimator:?}"));
            let material = Material::new([0.5; 3], [0.0; 3]).unwrap();
            let (radiance, _) = at(&solved, [6.0, 6.0, 11.0], &Light::constant([1.0; 3]), &material);
            // Facets of a sphere of 5 voxels catch a few rays; f16 rounds by 2⁻¹¹.
            assert!((0.45..=0.501).contains(&radiance[0]), "{bands} by {estimator:?}: {radiance:?}");
        }
    }
    for bands in [0, 12] {
        let error = Layers::uniform(2, bands).unwrap_err().to_string();
        assert!(error.contains("1 to 11 bands"), "{error}");
    }
}

#[test]
fn a_probe_of_one_pixel_is_a_constant_and_one_texel_of_a_million_keeps_its_energy() {
    let orientation = Orientation::new(Up::Z, 0.0).unwrap();
    let one = Probe::from_image("one", LatLong::new(1, 1, vec![[0.25, 0.5, 1.0]]).unwrap());
    let point = |x: usize, y: usize| {
        let mut pixels = vec![[0.0; 3]; 64 * 32];
        pixels[64 * y + x] = [1e6; 3];
        Probe::from_image("point", LatLong::new(64, 32, pixels).unwrap())
    };
    let solved = solve_with(&ball(), Estimator::Positive, Layers::uniform(2, 11).unwrap(), 64).unwrap();
    let white = Material::new([1.0; 3], [0.0; 3]).unwrap();
    for bands in [1, 5, 11] {
        let rgb = one.coefficients_in_world(bands, orientation);
        let (radiance, _) = at(&solved, [6.0, 6.0, 11.0], &Light::from_channels(&rgb).unwrap(), &white);
        // Constant over a convex texel; a few rays meet facets and escape at the next bounce.
        for (r, expected) in radiance.into_iter().zip([0.25, 0.5, 1.0]) {
            assert!((r / expected - 1.0).abs() < 0.01, "{bands} bands: {radiance:?}");
        }
    }
    // The texel in the row next to the pole, where it is smallest, and at the equator.
    for (x, y) in [(0, 0), (63, 31), (20, 16)] {
        let probe = point(x, y);
        let rgb = probe.coefficients_in_world(11, orientation);
        let flux = 1e6 * probe.image.pixel_solid_angle(y);
        // Its mean over the sphere is the first coefficient over sqrt(4π), in any orientation.
        let mean = rgb[0].values()[0] / (4.0 * std::f64::consts::PI).sqrt();
        assert!((mean * 4.0 * std::f64::consts::PI / flux - 1.0).abs() < 1e-6, "{x},{y}: {mean} {flux}");
        let prepared = prepare(&rgb, &solved.texture.layout().layers, Window::Certified).unwrap();
        assert!(prepared.windows.iter().all(|w| w.floor >= 0.0), "{x},{y}");
        let (radiance, _) = at(&solved, [6.0, 6.0, 11.0], &prepared.light, &white);
        // Exitant radiance of a texel that sees the whole flux head on is flux/π; a certified kernel of
        // 11 bands never adds to it.
        assert!(radiance[0] >= -1e-3 * flux as f32 && f64::from(radiance[0]) <= 1.01 * flux / std::f64::consts::PI);
    }
}

#[test]
fn textures_beyond_any_memory_are_refused_before_any_is_taken() {
    for (grid, ratio) in [([1 << 22; 3], 1.0), ([usize::MAX / 2, 2, 2], 1.0), ([1 << 20, 1 << 20, 2], 1024.0)] {
        let error = Lattice::from_ratio(grid, ratio).unwrap_err().to_string();
        assert!(error.contains("texels") && error.contains("--texture"), "{error}");
    }
    let error = Lattice::from_texels([2; 3], [usize::MAX, 2, 2]).unwrap_err().to_string();
    assert!(error.contains("texels") && error.contains("--texture"), "{error}");
    // The largest real texture: 1024³ at twice its resolution.
    assert!(Lattice::from_ratio([1024; 3], 2.0).is_ok());
}

#[test]
fn impossible_numbers_are_refused_by_name() {
    for albedo in [-0.1, 1.001, f32::NAN, f32::INFINITY] {
        assert!(Material::new([albedo; 3], [0.0; 3]).unwrap_err().to_string().contains("albedo"));
    }
    for emission in [-1.0, f32::NAN, f32::INFINITY] {
        assert!(Material::new([0.5; 3], [emission; 3]).unwrap_err().to_string().contains("emission"));
    }
    for value in [f64::NAN, f64::INFINITY] {
        assert!(Light::new(vec![[value; 3]]).unwrap_err().to_string().contains("environment"));
    }
    for isovalue in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let error = isolume::surface::extract(&ball(), isovalue).unwrap_err().to_string();
        assert!(error.contains("isovalue") && error.contains("finite"), "{error}");
    }
    for rays in [0, 1, 3, 48] {
        let error =
            solve_with(&ball(), Estimator::Path, Layers::uniform(1, 1).unwrap(), rays).err().unwrap().to_string();
        assert!(error.contains("power of two"), "{error}");
    }
}
