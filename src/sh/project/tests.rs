use super::super::{CLAMPED_COSINE, MAX_BANDS, index};
use super::*;

#[test]
fn quadrature_is_exact_up_to_its_degree_and_not_beyond() {
    for count in 1..=24 {
        let rule = gauss_legendre(count);
        assert!(rule.windows(2).all(|w| w[0].0 < w[1].0));
        let moment = |power: i32| rule.iter().map(|(x, w)| w * x.powi(power)).sum::<f64>();
        for power in 0..2 * count as i32 {
            let exact = if power % 2 == 0 { 2.0 / f64::from(power + 1) } else { 0.0 };
            assert!((moment(power) - exact).abs() < 1e-14, "{count} nodes, power {power}: {}", moment(power));
        }
        // Its error on the monic polynomial of degree 2n is ∫ (monic P_n)² = known, positive.
        assert!(count > 10 || 2.0 / (2 * count + 1) as f64 - moment(2 * count as i32) > 1e-8, "{count}");
    }
}

#[test]
fn the_basis_is_orthonormal() {
    // VALIDATION 1: max error < 1e-12 to l = 10.
    let n = basis::count(MAX_BANDS);
    let mut gram = vec![0.0; n * n];
    let mut y = vec![0.0; n];
    for (direction, weight) in sphere_rule(20) {
        basis::evaluate(MAX_BANDS, direction.to_array(), &mut y);
        for i in 0..n {
            for j in 0..n {
                gram[i * n + j] += weight * y[i] * y[j];
            }
        }
    }
    for i in 0..n {
        for j in 0..n {
            let identity = if i == j { 1.0 } else { 0.0 };
            assert!((gram[i * n + j] - identity).abs() < 1e-12, "{i} {j}: {}", gram[i * n + j]);
        }
    }
}

#[test]
fn the_addition_theorem_holds() {
    let directions: Vec<DVec3> =
        sphere_rule(8).into_iter().map(|(d, _)| d).chain([DVec3::Z, -DVec3::Z, DVec3::X]).collect();
    let (mut a, mut b) = ([0.0; 121], [0.0; 121]);
    for first in &directions {
        basis::evaluate(MAX_BANDS, first.to_array(), &mut a);
        for second in &directions {
            basis::evaluate(MAX_BANDS, second.to_array(), &mut b);
            let p = legendre(MAX_BANDS - 1, first.dot(*second));
            for l in 0..MAX_BANDS {
                let sum: f64 = (l * l..(l + 1) * (l + 1)).map(|i| a[i] * b[i]).sum();
                let exact = (2 * l + 1) as f64 / (4.0 * PI) * p[l];
                assert!((sum - exact).abs() < 1e-12, "l {l}: {sum} {exact}");
            }
        }
    }
}

#[test]
fn known_functions_project_to_known_coefficients() {
    let constant = project(5, 8, |_| 3.0);
    assert!((constant.values()[0] - 3.0 * 3.544_907_701_811_032).abs() < 1e-12);
    assert!(constant.values()[1..].iter().all(|v| v.abs() < 1e-13));
    let cosine = project(5, 8, |d| d.z);
    assert!((cosine.values()[2] - 2.046_653_415_892_977).abs() < 1e-12);
    for i in 0..121 {
        let unit = project(MAX_BANDS, 20, |d| {
            let mut y = [0.0; 121];
            basis::evaluate(MAX_BANDS, d.to_array(), &mut y);
            y[i]
        });
        for j in 0..121 {
            assert!((unit.values()[j] - if i == j { 1.0 } else { 0.0 }).abs() < 1e-12);
        }
    }
}

/// VALIDATION 3 by its definition: A_l = 2π ∫_0^1 t P_l(t) dt, Gauss-Legendre on [0, 1].
#[test]
fn the_clamped_cosine_table_is_its_integral() {
    for l in 0..MAX_BANDS {
        let integral: f64 = gauss_legendre(8)
            .into_iter()
            .map(|(x, w)| (0.5 * (x + 1.0), 0.5 * w))
            .map(|(t, w)| w * t * legendre(l.max(1), t)[l])
            .sum();
        assert!((2.0 * PI * integral - CLAMPED_COSINE[l]).abs() < 1e-14, "l {l}");
    }
}

#[test]
fn rings_add_up_and_stay_accurate_when_thin() {
    for rows in [1, 2, 3, 64, 513] {
        let total: f64 = pixel_solid_angles(rows, 7).iter().sum::<f64>() * 7.0;
        assert!((total - 4.0 * PI).abs() < 1e-12, "{rows}: {total}");
    }
    // A cap of 1e-9 rad has π·1e-18 sr, where 1 − cos would be 0.
    assert!((ring_solid_angle(0.0, 1e-9) / (PI * 1e-18) - 1.0).abs() < 1e-12);
}

/// VALIDATION 2 on the side of functions: midpoint sums over a latitude-longitude grid with
/// exact row solid angles converge as the square of the row height.
#[test]
fn the_midpoint_rule_on_rows_is_of_second_order() {
    let error = |rows: usize| {
        let angles = pixel_solid_angles(rows, 2 * rows);
        let mut worst = 0.0_f64;
        for l in 1..MAX_BANDS {
            let mut sum = 0.0;
            for (row, angle) in angles.iter().enumerate() {
                let z = libm::cos(PI * (row as f64 + 0.5) / rows as f64);
                let mut y = [0.0; 121];
                basis::evaluate(MAX_BANDS, [(1.0 - z * z).sqrt(), 0.0, z], &mut y);
                sum += angle * (2 * rows) as f64 * y[index(l, 0)];
            }
            worst = worst.max(sum.abs());
        }
        worst
    };
    assert!(error(64) < 2e-3, "{}", error(64));
    for rows in [32, 64, 128] {
        let ratio = error(rows) / error(2 * rows);
        assert!((3.8..4.3).contains(&ratio), "{rows}: {ratio}");
    }
}
