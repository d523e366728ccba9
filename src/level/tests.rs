use super::*;
use crate::geom::Affine;
use crate::volume::{Samples, Solid};

/// A volume of `n`³ samples of `field` over [−1, 1]³.
fn cube(n: usize, field: impl Fn(Vec3) -> f32) -> Volume {
    let at = |i: usize| 2.0 * i as f32 / (n - 1) as f32 - 1.0;
    let samples = (0..n * n * n).map(|i| field(Vec3::new(at(i % n), at(i / n % n), at(i / n / n)))).collect();
    let spacing = 2.0 / (n - 1) as f64;
    let affine = Affine::from_spacing(glam::DVec3::splat(spacing), glam::DVec3::splat(-1.0)).unwrap();
    Volume::new([n; 3], Samples::F32(samples), affine).unwrap()
}

fn floats(volume: &Volume) -> &[f32] {
    match volume.samples() {
        Samples::F32(s) => s,
        _ => unreachable!(),
    }
}

/// Directions that tend to break marches: axes, diagonals, and a spread of others.
fn directions() -> Vec<Vec3> {
    let mut all = Vec::new();
    for x in -1..=1 {
        for y in -1..=1 {
            for z in -1..=1 {
                if (x, y, z) != (0, 0, 0) {
                    all.push(Vec3::new(x as f32, y as f32, z as f32));
                }
            }
        }
    }
    for i in 0..200 {
        let t = i as f32 * 2.399_963;
        let z = 1.0 - (i as f32 + 0.5) / 100.0;
        let r = (1.0 - z * z).max(0.0).sqrt();
        all.push(Vec3::new(r * t.cos(), r * t.sin(), z));
    }
    all
}

#[test]
fn no_ray_leaves_a_closed_sphere_from_its_inner_side() {
    // Solid outside: h = |x| with solid above. Every texel near the surface, every direction.
    let volume = cube(33, |p| p.length());
    let pyramid = Pyramid::new(&volume);
    let field = LevelField::new(&volume, floats(&volume), &pyramid);
    let mut counts = Counts::default();
    let mut lost = 0;
    for z in 6..27 {
        for y in 6..27 {
            for x in 6..27 {
                let radius = (Vec3::new(x as f32, y as f32, z as f32) - 16.0).length();
                if !(5.0..15.0).contains(&radius) {
                    continue;
                }
                let site = field.site([x as f64, y as f64, z as f64]).unwrap();
                for d in directions() {
                    match field.trace(site.isovalue, &site.start, d, &mut counts) {
                        Outcome::Escaped => panic!("leak at {x},{y},{z} along {d}"),
                        Outcome::Lost => lost += 1,
                        Outcome::Hit(hit) => {
                            let at = (hit.at.in_grid() - 16.0) / 16.0;
                            let c = site.isovalue;
                            assert!((at.length() - c).abs() < 0.02, "{x},{y},{z} {d}: {} for {c}", at.length());
                        }
                    }
                }
            }
        }
    }
    // Directions into the solid are lost, about half of them.
    let share = lost as f64 / counts.rays as f64;
    assert!((0.4..0.6).contains(&share), "{share}");
}

#[test]
fn every_outward_ray_of_a_convex_sphere_escapes() {
    let volume = cube(33, |p| -p.length());
    let pyramid = Pyramid::new(&volume);
    let field = LevelField::new(&volume, floats(&volume), &pyramid);
    let mut counts = Counts::default();
    for z in 4..29 {
        for y in 4..29 {
            for x in 4..29 {
                let radius = (Vec3::new(x as f32, y as f32, z as f32) - 16.0).length();
                if !(5.0..16.0).contains(&radius) {
                    continue;
                }
                let site = field.site([x as f64, y as f64, z as f64]).unwrap();
                for d in directions() {
                    // Clear of the facets of the trilinear sphere.
                    if d.normalize().dot(site.normal.vec()) > 0.15 {
                        let outcome = field.trace(site.isovalue, &site.start, d, &mut counts);
                        assert_eq!(outcome, Outcome::Escaped, "{x},{y},{z} along {d}");
                    }
                }
            }
        }
    }
}

#[test]
fn scaling_by_powers_of_two_changes_no_bit_and_flipping_the_side_neither() {
    let shape = |p: Vec3| (3.0 * p.x).sin() * (2.0 * p.y).cos() + p.z * p.z - 0.3 * p.x;
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
            for d in directions().into_iter().step_by(7) {
                assert_eq!(a.trace(sa.isovalue, &sa.start, d, &mut ca), b.trace(sb.isovalue, &sb.start, d, &mut cb));
            }
        }
        assert_eq!(ca, cb);
    }
}

#[test]
fn normals_of_a_linear_field_are_exact_everywhere_and_point_to_the_lit_side() {
    let volume = cube(9, |p| p.x + 2.0 * p.y - 3.0 * p.z);
    let pyramid = Pyramid::new(&volume);
    let field = LevelField::new(&volume, floats(&volume), &pyramid);
    let expected = -Vec3::new(1.0, 2.0, -3.0).normalize();
    for i in 0..500 {
        let at = [i as f64 * 0.37 % 8.0, i as f64 * 0.11 % 8.0, i as f64 * 0.53 % 8.0];
        let normal = field.normal(&field.locate(at)).unwrap();
        assert!((normal.vec() - expected).length() < 1e-5, "{at:?}: {normal:?}");
    }
}
