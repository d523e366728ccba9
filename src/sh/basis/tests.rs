use super::*;

/// Directions that visit octants, axes and near-poles.
fn directions(n: usize) -> Vec<Vec3> {
    let mut list = vec![Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z, Vec3::new(1e-4, 0.0, 1.0)];
    let golden = 2.399_963_2_f32;
    for i in 0..n {
        let z = 1.0 - 2.0 * (i as f32 + 0.5) / n as f32;
        let r = (1.0 - z * z).sqrt();
        list.push(Vec3::new(r * (golden * i as f32).cos(), r * (golden * i as f32).sin(), z).normalize());
    }
    list
}

#[test]
fn first_bands_are_the_stated_polynomials() {
    let (x, y, z) = (0.48, 0.6, 0.64);
    let mut out = [0.0; 9];
    evaluate(3, [x, y, z], &mut out);
    let pi = std::f64::consts::PI;
    let (one, two) = ((3.0 / (4.0 * pi)).sqrt(), (15.0 / (4.0 * pi)).sqrt());
    let expected = [
        (0.25 / pi).sqrt(),
        one * y,
        one * z,
        one * x,
        two * x * y,
        two * y * z,
        (5.0 / (16.0 * pi)).sqrt() * (3.0 * z * z - 1.0),
        two * x * z,
        0.5 * two * (x * x - y * y),
    ];
    for i in 0..9 {
        assert!((out[i] - expected[i]).abs() < 1e-15, "{i}: {} {}", out[i], expected[i]);
    }
}

#[test]
fn agrees_with_an_independent_implementation() {
    use sphrs::{Coordinates, RealSH, SHEval};
    for d in directions(50) {
        let d = d.as_dvec3().normalize();
        let mut out = [0.0; 121];
        evaluate(MAX_BANDS, d.to_array(), &mut out);
        let p = Coordinates::cartesian(d.x, d.y, d.z);
        for l in 0..MAX_BANDS as i64 {
            for m in -l..=l {
                let oracle: f64 = RealSH::Spherical.eval(l, m, &p);
                let ours = out[index(l as usize, m as isize)];
                // sphrs goes through angles: its own error near the poles sets the tolerance.
                assert!((ours - oracle).abs() < 1e-9, "l {l} m {m} {d}: {ours} {oracle}");
            }
        }
    }
}

#[test]
fn single_precision_stays_close_to_double() {
    for d in directions(500) {
        let (mut single, mut double) = ([0.0_f32; 121], [0.0; 121]);
        evaluate_f32(MAX_BANDS, d, &mut single);
        evaluate(MAX_BANDS, d.as_dvec3().normalize().to_array(), &mut double);
        for l in 0..MAX_BANDS {
            for i in l * l..(l + 1) * (l + 1) {
                assert!((f64::from(single[i]) - double[i]).abs() < 2e-6 * (2 * l + 1) as f64, "{i} {d}");
            }
        }
    }
}

#[test]
fn the_batch_is_its_scalar_twin_bit_for_bit() {
    let all = directions(57);
    let weights: Vec<f32> = (0..all.len()).map(|d| (d as f32 * 0.37).sin()).collect();
    for bands in 1..=MAX_BANDS {
        for n in [0, 1, 2, 3, 4, 5, 7, 8, 31, 64] {
            let mut batch = vec![0.25; count(bands)];
            accumulate(bands, &all[..n], &mut batch);
            let mut partial = vec![[0.0_f32; LANES]; count(bands)];
            let mut value = vec![0.0; count(bands)];
            for (d, &direction) in all[..n].iter().enumerate() {
                evaluate_f32(bands, direction, &mut value);
                for i in 0..count(bands) {
                    partial[i][d % LANES] += value[i];
                }
            }
            for i in 0..count(bands) {
                let p = partial[i];
                let twin = 0.25 + ((p[0] + p[2]) + (p[1] + p[3]));
                assert_eq!(batch[i].to_bits(), twin.to_bits(), "bands {bands}, n {n}, i {i}");
            }
            let (mut weighted, mut plain) = (vec![0.0; count(bands)], vec![0.0_f64; count(bands)]);
            accumulate_weighted(bands, &all[..n], &weights[..n], &mut weighted);
            for d in 0..n {
                evaluate_f32(bands, all[d], &mut value);
                for i in 0..count(bands) {
                    plain[i] += f64::from(weights[d] * value[i]);
                }
            }
            for i in 0..count(bands) {
                // n terms, each at most 1.3 (sqrt((2l+1)/4π), l = 10) with a few roundings.
                assert!((f64::from(weighted[i]) - plain[i]).abs() < 1e-5 * (1 + n) as f64);
            }
        }
    }
}
