//! B-spline gradients against their definition in f64, and how good they are on 8-bit data.

use super::*;
use glam::DMat3;

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

/// The uniform cubic B-spline and its derivative (de Boor 1978), centred at 0.
fn spline(x: f64) -> (f64, f64) {
    let a = x.abs();
    if a < 1.0 {
        (2.0 / 3.0 - a * a + a * a * a / 2.0, x.signum() * (-2.0 * a + 1.5 * a * a))
    } else if a < 2.0 {
        ((2.0 - a).powi(3) / 6.0, -x.signum() * (2.0 - a).powi(2) / 2.0)
    } else {
        (0.0, 0.0)
    }
}

/// The sample at a lattice point that may lie outside, extrapolated linearly axis by axis.
fn extended(volume: &Volume, at: [i64; 3]) -> f64 {
    for a in 0..3 {
        let last = volume.dims()[a] as i64 - 1;
        let with = |v: i64| {
            let mut p = at;
            p[a] = v;
            extended(volume, p)
        };
        if at[a] < 0 {
            return with(0) + (with(0) - with(1)) * -at[a] as f64;
        }
        if at[a] > last {
            return with(last) + (with(last) - with(last - 1)) * (at[a] - last) as f64;
        }
    }
    f64::from(volume.samples().raw(volume.index(at[0] as usize, at[1] as usize, at[2] as usize)))
}

/// Gradient of the spline at a lattice point.
fn at_lattice(volume: &Volume, at: [i64; 3]) -> DVec3 {
    let mut gradient = DVec3::ZERO;
    for k in -2..=2 {
        for j in -2..=2 {
            for i in -2..=2 {
                let h = extended(volume, [at[0] + i, at[1] + j, at[2] + k]);
                let [(x, dx), (y, dy), (z, dz)] = [i, j, k].map(|o: i64| spline(-o as f64));
                gradient += h * DVec3::new(dx * y * z, x * dy * z, x * y * dz);
            }
        }
    }
    gradient
}

#[test]
fn gradients_are_those_of_the_spline() {
    let mut shapes = gallery();
    shapes.push(("tiny", floating([2, 2, 2], |p| p.x * 3.0 + p.y * p.z)));
    shapes.push(("thin", floating([2, 9, 3], |p| (p.x + 2.0 * p.y).sin() - p.z)));
    for (name, volume) in shapes {
        let range = f64::from(volume.raw_range().1 - volume.raw_range().0);
        let largest = f64::from(volume.raw_range().0.abs().max(volume.raw_range().1.abs()));
        with_field!(volume, field => {
            for item in 0..200 {
                let (start, _) = any_start(&field, 60, item);
                let (cell, local) = (start.at.cell, start.at.local.as_dvec3());
                let mut expected = DVec3::ZERO;
                for corner in 0..8 {
                    let o = [corner & 1, corner >> 1 & 1, corner >> 2];
                    let w = (0..3).fold(1.0, |w, a| w * if o[a] == 1 { local[a] } else { 1.0 - local[a] });
                    let at = std::array::from_fn(|a| i64::from(cell[a]) + o[a]);
                    expected += at_lattice(&volume, at) * w;
                }
                let error = (field.raw_gradient(&start.at).as_dvec3() - expected).length();
                // 64 terms of up to the largest sample, a few roundings each.
                assert!(error < 1e-5 * range + 1e-6 * largest, "{name} {item} {:?}: {error}", start.at);
            }
        });
    }
}

#[test]
fn world_normals_are_covectors_under_any_affine() {
    let shape = |p: Vec3| (2.0 * p.x).sin() + p.y * p.z - 0.7 * p.z;
    let maps = [
        DMat3::from_diagonal(DVec3::new(1.0, 1.0, 100.0)),
        DMat3::from_diagonal(DVec3::new(-1e-3, 2e-3, 5e-3)),
        DMat3::from_cols(DVec3::new(1.0, 0.3, 0.0), DVec3::new(0.5, -2.0, 0.4), DVec3::new(0.0, 0.7, 30.0)),
        DMat3::from_diagonal(DVec3::new(1e-12, 3e-12, 2e-12)),
    ];
    for map in maps {
        for solid in [Solid::Above, Solid::Below] {
            let samples = lattice([14; 3]).map(shape).collect();
            let affine = Affine::new(map, DVec3::splat(1e6)).unwrap();
            let mut volume = Volume::new([14; 3], Samples::F32(samples), affine).unwrap();
            volume.solid = solid;
            let sign = f64::from(volume.solid_sign());
            with_field!(volume, field => {
                for item in 0..300 {
                    let (start, _) = any_start(&field, 61, item);
                    let gradient = field.raw_gradient(&start.at).as_dvec3();
                    let expected = -sign * (map.inverse().transpose() * gradient).normalize();
                    let normal = field.normal(&start.at).unwrap().vec().as_dvec3();
                    assert!((normal - expected).length() < 2e-6, "{map} {item}: {normal} for {expected}");
                }
            });
        }
    }
}

#[test]
fn normals_of_an_8_bit_sphere_beat_central_differences() {
    // Rounding to steps has the deviation 1/√12. A component of the gradient gathers it with the
    // root of the sum of its squared weights: √(1/2) by central differences; the spline averages
    // over two axes with 1/6, 4/6, 1/6, whose squares sum to 1/2 each, so half of that. Two
    // components are across the normal: the median of their length is √(2 ln 2) = 1.1774
    // deviations, over the slope in steps a voxel. At 3.6 steps (8 bits over a sphere of 70 voxels)
    // these are 1.9° and 3.8°. Neighbouring roundings are alike where steps are few, which takes
    // up to a half away.
    for step in [1.15, 3.6] {
        let (spline, central) = medians(step);
        let predicted = (1.1774 / 12f64.sqrt() * 0.5f64.sqrt() / step).to_degrees();
        assert!((0.5..1.1).contains(&(central / predicted)), "{step}: {central} for {predicted}");
        assert!((0.5..1.1).contains(&(spline / (0.5 * predicted))), "{step}: {spline} for {}", 0.5 * predicted);
        assert!(spline < 0.55 * central, "{step}: {spline} {central}");
    }
}

/// Median errors in degrees of the spline's and of central differences' normals at samples of a
/// sphere, with `step` steps a voxel.
fn medians(step: f64) -> (f64, f64) {
    // A block whose distances from the centre are 60 … 130 voxels.
    let offset = DVec3::new(31.3, 38.7, 35.1);
    let n = 40usize;
    let position = |i: usize| DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64) + offset;
    let samples = (0..n * n * n).map(|i| (position(i).length() * step).round() as i16).collect();
    let volume = on_grid([n; 3], Samples::I16(samples));
    let degrees = |v: DVec3, r: DVec3| v.normalize().dot(r.normalize()).clamp(-1.0, 1.0).acos().to_degrees();
    let (mut spline, mut central) = (vec![], vec![]);
    with_field!(volume, field => {
        for item in 0..20_000 {
            let at: [usize; 3] = std::array::from_fn(|a| 2 + (uniform(62, item, a as u64) * (n - 4) as f64) as usize);
            let r = position(volume.index(at[0], at[1], at[2]));
            let normal = field.normal(&field.locate(at.map(|v| v as f64))).unwrap();
            spline.push(degrees(-normal.vec().as_dvec3(), r));
            let raw = |a: usize, up: bool| {
                let mut p = at;
                p[a] = if up { p[a] + 1 } else { p[a] - 1 };
                f64::from(volume.samples().raw(volume.index(p[0], p[1], p[2])))
            };
            let difference = DVec3::from_array(std::array::from_fn(|a| raw(a, true) - raw(a, false)));
            central.push(degrees(difference, r));
        }
    });
    let median = |v: &mut Vec<f64>| {
        v.sort_by(f64::total_cmp);
        v[v.len() / 2]
    };
    let medians = (median(&mut spline), median(&mut central));
    eprintln!("{step} steps a voxel: spline {:.2}°, central {:.2}°", medians.0, medians.1);
    medians
}
