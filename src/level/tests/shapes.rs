//! Odd grids, odd affines, odd directions, odd isovalues.

use super::oracle::Twin;
use super::rays::{Verdicts, judge};
use super::*;
use glam::DMat3;

#[test]
fn scaling_by_powers_of_two_changes_no_bit_and_flipping_the_side_neither() {
    let shape = |p: Vec3| (3.0 * p.x).sin() * (2.0 * p.y).cos() + p.z * p.z - 0.3 * p.x;
    // A component of 1e-20 makes subnormal products, which are not exact under scaling.
    let regular: Vec<Vec3> =
        directions().into_iter().filter(|d| d.to_array().iter().all(|v| *v == 0.0 || v.abs() > 1e-10)).collect();
    let reference = cube(20, shape);
    let variants = [
        (cube(20, |p| shape(p) * 2f32.powi(90)), 2f32.powi(90), Solid::Above),
        (cube(20, |p| shape(p) * 2f32.powi(-90)), 2f32.powi(-90), Solid::Above),
        (cube(20, |p| -shape(p)), -1.0, Solid::Below),
    ];
    for (mut volume, factor, solid) in variants {
        volume.solid = solid;
        let (pa, pb) = (Pyramid::new(&reference), Pyramid::new(&volume));
        let a = LevelField::new(&reference, floats(&reference), &pa);
        let b = LevelField::new(&volume, floats(&volume), &pb);
        let (mut ca, mut cb) = (Counts::default(), Counts::default());
        for i in 0..4000usize {
            let at = [i as f64 * 7.0 % 19.0, i as f64 / 3.0 % 19.0, i as f64 / 11.0 % 19.0];
            let (sa, sb) = (a.site(at).unwrap(), b.site(at).unwrap());
            assert_eq!(sa.isovalue * factor, sb.isovalue);
            assert_eq!(sa.normal, sb.normal);
            for d in regular.iter().copied().step_by(7) {
                assert_eq!(a.trace(sa.isovalue, &sa.start, d, &mut ca), b.trace(sb.isovalue, &sb.start, d, &mut cb));
            }
        }
        assert_eq!(ca, cb);
    }
}

/// Traces `rays` rays from any start and judges each by the twin; world directions through the
/// volume's affine.
fn judge_all(name: &str, volume: &Volume, seed: u64, rays: u64, isovalue: impl Fn(u64) -> Option<f32>) {
    let (twin, mut verdicts) = (Twin::new(volume), Verdicts::default());
    let grid_from_world = volume.world_from_grid().inverse();
    with_field!(*volume, field => {
        let (mut counts, all) = (Counts::default(), directions());
        for item in 0..rays {
            let (mut start, mut c) = any_start(&field, seed, item);
            if let Some(given) = isovalue(item) {
                c = given;
                start.on_surface = field.raw_value(&start.at) == c;
            }
            let in_world = if item % 2 == 0 { all[item as usize / 2 % all.len()] } else { on_sphere(seed, item) };
            let d = field.direction_in_grid(in_world);
            let expected = grid_from_world.vector(in_world.as_dvec3()).normalize();
            assert!((d.as_dvec3().normalize() - expected).length() < 1e-6, "{name}: {d} for {expected}");
            let outcome = field.trace(c, &start, d, &mut counts);
            let told = judge(&twin.profile(c, &start, d), start.on_surface, outcome, &mut verdicts);
            assert!(told.is_ok(), "{name} {item}: {told:?}; {start:?}, {c}, {d}, {outcome:?}");
        }
    });
}

#[test]
fn rays_agree_with_the_definition_under_any_affine() {
    let shape = |p: Vec3| (3.0 * p.x).sin() * (2.5 * p.y).cos() + p.z * p.z;
    let maps = [
        DMat3::from_diagonal(DVec3::new(1.0, 1.0, 100.0)),
        DMat3::from_diagonal(DVec3::new(-2.0, 2.0, 2.0)),
        DMat3::from_cols(DVec3::new(0.9, 0.3, 0.0), DVec3::new(0.5, -2.0, 0.4), DVec3::new(0.0, 0.7, 3.0)),
        DMat3::from_diagonal(DVec3::splat(1e-10)),
        DMat3::from_diagonal(DVec3::new(1e9, 1e9, 3e9)),
    ];
    for (i, map) in maps.into_iter().enumerate() {
        let affine = Affine::new(map, DVec3::splat(1e6)).unwrap();
        let samples = lattice([25, 24, 23]).map(shape).collect();
        let volume = Volume::new([25, 24, 23], Samples::F32(samples), affine).unwrap();
        judge_all(&format!("affine {i}"), &volume, 80 + i as u64, 2_000, |_| None);
    }
}

#[test]
fn grids_of_a_cell_or_a_slab_of_cells() {
    for (i, dims) in [[2, 2, 2], [2, 17, 9], [40, 2, 3], [5, 6, 2], [3, 3, 66]].into_iter().enumerate() {
        for salt in 0..6u64 {
            let seed = 100 + i as u64 * 10 + salt;
            let count = (dims[0] * dims[1] * dims[2]) as u64;
            let value = |k: u64| uniform(seed, k, 7);
            let volume = if salt % 2 == 0 {
                on_grid(dims, Samples::F32((0..count).map(|k| value(k) as f32 - 0.5).collect()))
            } else {
                on_grid(dims, Samples::I16((0..count).map(|k| (value(k) * 9.0) as i16 - 4).collect()))
            };
            judge_all(&format!("{dims:?}"), &volume, seed, 1_000, |_| None);
        }
    }
}

#[test]
fn isovalues_equal_to_samples_to_the_minimum_and_to_the_maximum() {
    for (name, volume) in gallery() {
        let (low, high) = volume.raw_range();
        let count = volume.samples().len() as u64;
        judge_all(name, &volume, 140, 1_500, |item| {
            Some(match item % 3 {
                0 => low,
                1 => high,
                _ => volume.samples().raw((item * 7919 % count) as usize),
            })
        });
        // Nothing is solid above the maximum: every start on the lit side escapes.
        if volume.solid == Solid::Above {
            with_field!(volume, field => {
                for item in 0..500 {
                    let (start, _) = any_start(&field, 141, item);
                    let outcome = field.trace(high, &Start::beside(start.at), on_sphere(141, item), &mut Counts::default());
                    assert_eq!(outcome, Outcome::Escaped, "{name} {item}");
                }
            });
        }
    }
}

#[test]
fn a_constant_volume_hits_nothing() {
    let volume = bytes([9, 8, 7], |_| 100.0);
    with_field!(volume, field => {
        for item in 0..2_000 {
            let (start, _) = any_start(&field, 142, item);
            for (c, on, expected) in [(100.0, true, Outcome::Escaped), (100.5, false, Outcome::Escaped)] {
                let start = Start { on_surface: on, ..start };
                assert_eq!(field.trace(c, &start, on_sphere(142, item), &mut Counts::default()), expected);
            }
        }
    });
}

#[test]
fn the_length_of_a_direction_changes_no_bit_by_powers_of_two() {
    for (name, volume) in gallery() {
        with_field!(volume, field => {
            let mut counts = Counts::default();
            for item in 0..1_000 {
                let (start, c) = any_start(&field, 143, item);
                let d = on_sphere(143, item);
                let reference = field.trace(c, &start, d, &mut counts);
                for exponent in [-100, -3, 1, 80, 126] {
                    let scaled = field.trace(c, &start, d * 2f32.powi(exponent), &mut counts);
                    assert_eq!(scaled, reference, "{name} {item} 2^{exponent}");
                }
                // Directions that are hardly numbers still come to an end.
                for length in [1e-37, 1e-40, 1e-45, 0.0, f32::MAX, f32::INFINITY, f32::NAN] {
                    field.trace(c, &start, d * length, &mut counts);
                }
            }
        });
    }
}

#[test]
fn buried_starts_do_not_depend_on_the_name_of_their_corner() {
    // A corner belongs to eight cells; a ray from it may first pass cells without length.
    for (name, volume) in gallery() {
        with_field!(volume, field => {
            for item in 0..2_000 {
                let (start, c) = any_start(&field, 144, item);
                let mut other = start.at;
                for a in 0..3 {
                    if other.local[a] == 0.0 && other.cell[a] > 0 {
                        (other.local[a], other.cell[a]) = (1.0, other.cell[a] - 1);
                    } else if other.local[a] == 1.0 && (other.cell[a] as usize) < volume.dims()[a] - 2 {
                        (other.local[a], other.cell[a]) = (0.0, other.cell[a] + 1);
                    }
                }
                // The value beside the surface is rounded differently in each cell.
                let (low, high) = field.corners(start.at.cell);
                if low.into_iter().chain(high).any(|v| (v - c).abs() < 1e-4 * c.abs()) {
                    continue;
                }
                let d = on_sphere(144, item);
                let [a, b] = [start.at, other]
                    .map(|at| field.trace(c, &Start { at, ..start }, d, &mut Counts::default()));
                match (a, b) {
                    (Outcome::Hit(a), Outcome::Hit(b)) => {
                        assert!((a.at.in_grid() - b.at.in_grid()).length() < 1e-3, "{name} {item}: {a:?} {b:?}");
                    }
                    _ => assert_eq!(a, b, "{name} {item}: {start:?} {other:?} {c} {d}"),
                }
            }
        });
    }
}
