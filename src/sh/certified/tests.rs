use super::super::kernel::kept;
use super::super::project::sphere_rule;
use super::*;
use crate::sampling::hash::uniform;
use glam::DVec3;

/// K(t)·4π from its factors.
fn kernel_value(factors: &[f64], t: f64) -> f64 {
    let p = legendre(factors.len(), t);
    factors.iter().enumerate().map(|(l, k)| (2 * l + 1) as f64 * k * p[l]).sum()
}

#[test]
fn the_kernel_is_non_negative_and_optimal() {
    // k_1: largest roots of P_1, P_2, P_3, P_4 (Abramowitz & Stegun, table 25.4) for even
    // degrees; for degree 1 the Radau node 1/3, for degree 3 (1 + √6)/5.
    let known = [0.0, 1.0 / 3.0, 1.0 / 3.0_f64.sqrt(), (1.0 + 6.0_f64.sqrt()) / 5.0, 0.6_f64.sqrt()];
    for (i, expected) in known.into_iter().enumerate().skip(1) {
        let factors = gauss_optimal(i + 1);
        assert!((factors[1] - expected).abs() < 1e-13, "{} bands: {}", i + 1, factors[1]);
    }
    assert_eq!(gauss_optimal(1), [1.0]);
    assert!((gauss_optimal(7)[1] - 0.861_136_311_594_053).abs() < 1e-13);
    for bands in 2..=MAX_BANDS {
        let factors = gauss_optimal(bands);
        for i in 0..=4000 {
            let t = f64::from(i) / 2000.0 - 1.0;
            assert!(kernel_value(&factors, t) > -1e-11, "{bands} bands at {t}: {}", kernel_value(&factors, t));
        }
        assert!(factors.windows(2).all(|w| w[1] < w[0]) && factors[bands - 1] > 0.0, "{factors:?}");
        // No square of a random polynomial of half the degree does better.
        for trial in 0..200 {
            let q = |t: f64| {
                let p = legendre((bands - 1) / 2, t);
                let sum: f64 =
                    p.iter().enumerate().map(|(j, v)| v * f64::from(uniform(1, trial, bands as u32, j as u32))).sum();
                sum * sum
            };
            let rule = gauss_legendre(bands + 1);
            let (mass, first): (f64, f64) =
                rule.iter().fold((0.0, 0.0), |s, (t, w)| (s.0 + w * q(*t), s.1 + w * t * q(*t)));
            assert!(first / mass <= factors[1] + 1e-12, "{bands} bands: {}", first / mass);
        }
    }
}

fn light(bands: usize, lights: &[(DVec3, f64)], ambient: f64) -> Coefficients {
    let mut sum = Coefficients::constant(bands, ambient);
    for (direction, power) in lights {
        sum += &(&Coefficients::delta(bands, *direction) * *power);
    }
    sum
}

fn cases(bands: usize) -> Vec<(&'static str, Coefficients)> {
    let tilted = DVec3::new(0.36, -0.48, 0.8);
    vec![
        ("black", Coefficients::zero(bands)),
        ("constant", Coefficients::constant(bands, 2.0)),
        ("sun at the zenith", light(bands, &[(DVec3::Z, 1.0)], 0.0)),
        ("tilted sun", light(bands, &[(tilted, 1e6)], 0.1)),
        ("two opposite suns", light(bands, &[(tilted, 3.0), (-tilted, 3.0)], 0.0)),
        ("sun and sky", light(bands, &[(DVec3::X, 0.5)], 1.0)),
        ("three lights", light(bands, &[(DVec3::Y, 1.0), (tilted, 0.4), (DVec3::NEG_X, 2.0)], 1e-3)),
    ]
}

#[test]
fn bounds_enclose_the_range_tightly() {
    for bands in [1, 2, 3, 5, 8, 11] {
        for (name, f) in cases(bands) {
            let (low, high) = bounds(&f);
            let values: Vec<f64> = sphere_rule(150)
                .into_iter()
                .map(|(d, _)| d)
                .chain([DVec3::X, DVec3::Y, DVec3::Z, -DVec3::Z, DVec3::new(0.36, -0.48, 0.8)])
                .map(|d| f.evaluate(d))
                .collect();
            let (least, greatest) =
                values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |r, v| (r.0.min(*v), r.1.max(*v)));
            assert!(low <= least && greatest <= high, "{name}, {bands}: {low} {least} {greatest} {high}");
            let excess = (high - low) - (greatest - least);
            assert!(excess <= 0.008 * (greatest - least) + 1e-9 * high.abs(), "{name}, {bands}: excess {excess}");
        }
    }
    // And the grid is evaluated right.
    let f = &cases(6)[6].1;
    let (values, rows) = (on_grid(f), rows(6));
    for (row, column) in [(0, 0), (17, 301), (200, 5), (rows - 1, 2 * rows - 1)] {
        let colatitude = PI * (row as f64 + 0.5) / rows as f64;
        let azimuth = PI * (column as f64 + 0.5) / rows as f64;
        let d = DVec3::new(colatitude.sin() * azimuth.cos(), colatitude.sin() * azimuth.sin(), colatitude.cos());
        assert!((values[row * 2 * rows + column] - f.evaluate(d)).abs() < 1e-12);
    }
}

#[test]
fn certified_light_is_nowhere_negative_and_no_more_blurred_than_needed() {
    for bands in [1, 2, 3, 4, 5, 8, 11] {
        for (name, f) in cases(bands) {
            let window = certify(std::slice::from_ref(&f)).unwrap();
            let windowed = f.filtered(&window.factors);
            let least = sphere_rule(100).into_iter().map(|(d, _)| windowed.evaluate(d)).fold(f64::INFINITY, f64::min);
            assert!(least >= 0.0, "{name}, {bands} bands: minimum {least}");
            assert!(bounds(&windowed).0 >= -1e-12 * f.mean(), "{name}, {bands} bands");
            // Light ≥ 0 needs the kernel and at most the slack of the bound on top.
            assert!(window.blend < 1.06, "{name}, {bands} bands: blend {}", window.blend);
            if bounds(&f).0 >= 0.0 {
                assert_eq!(window.blend, 0.0, "{name}, {bands} bands");
            } else if window.blend < 1.0 {
                let full = kept(&f.filtered(&gauss_optimal(bands)), &f);
                assert!(kept(&windowed, &f).contrast >= full.contrast);
                // A thousandth less of the window would not pass.
                let less = Certified::at(window.blend - 1e-3, &gauss_optimal(bands));
                assert!(bounds(&f.filtered(&less.factors)).0 < 0.0, "{name}, {bands} bands");
            }
        }
    }
}

#[test]
fn channels_share_a_window_and_nonsense_is_refused() {
    let (sky, sun) = (cases(5).swap_remove(5).1, cases(5).swap_remove(2).1);
    let both = certify(&[sky.clone(), sun.clone(), sky.clone()]).unwrap();
    assert_eq!(both, certify(std::slice::from_ref(&sun)).unwrap());
    assert!(bounds(&sky.filtered(&both.factors)).0 >= 0.0);
    assert!(certify(&[]).is_err());
    assert!(certify(&[sky, Coefficients::zero(3)]).is_err());
    assert!(certify(&[&sun * -1.0]).unwrap_err().to_string().contains("negative"));
}
