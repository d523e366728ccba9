use super::*;
use crate::sampling::hash::uniform;
use crate::sampling::statistics::{chi_square_test, sidak};
use std::path::Path;

#[test]
fn a_batch_of_points_gives_the_bits_of_each() {
    // Two whole blocks and a rest; ties of the branch and the centre among them.
    let mut points: Vec<[f32; 2]> = (0..15).map(|i| [uniform(9, 0, i, 0), uniform(9, 0, i, 1)]).collect();
    points.extend([[0.5, 0.5], [0.0, 0.0], [0.25, 0.25], [0.75, 0.25], [0.5, 0.0]]);
    for shift in 0..points.len() {
        points.rotate_left(shift);
        let mut batch = Vec::new();
        squares_to_cosine_hemisphere(&points, &mut batch);
        for (one, point) in batch.iter().zip(&points) {
            let bits = |v: Vec3| v.to_array().map(f32::to_bits);
            assert_eq!(bits(*one), bits(square_to_cosine_hemisphere(*point)), "{point:?}");
        }
    }
}

#[test]
fn sine_and_cosine_keep_their_promise() {
    for i in 0..=1_000_000 {
        let turns = i as f32 / 1e6;
        let (sine, cosine) = sin_cos_turns(turns);
        let angle = 2.0 * std::f64::consts::PI * f64::from(turns);
        assert!((f64::from(sine) - libm::sin(angle)).abs() < 1e-7, "sin of {turns} turns: {sine}");
        assert!((f64::from(cosine) - libm::cos(angle)).abs() < 1e-7, "cos of {turns} turns: {cosine}");
    }
    assert_eq!(sin_cos_turns(0.25), (1.0, 0.0));
    assert_eq!(sin_cos_turns(1.0), (0.0, 1.0));
}

/// A map of the square to directions with its density and its inverse.
struct Case {
    name: &'static str,
    map: fn([f32; 2]) -> Vec3,
    pdf: fn(Vec3) -> f32,
    inverse: fn(Vec3) -> [f32; 2],
    /// Range of z that the map reaches; cells of the test divide it.
    z: [f64; 2],
}

const WIDE: f32 = 0.7;
const SUN: f32 = 1.1e-5;

const CASES: [Case; 5] = [
    Case {
        name: "cosine_hemisphere",
        map: square_to_cosine_hemisphere,
        pdf: cosine_hemisphere_pdf,
        inverse: cosine_hemisphere_to_square,
        z: [0.0, 1.0],
    },
    Case {
        name: "uniform_sphere",
        map: square_to_uniform_sphere,
        pdf: |_| uniform_sphere_pdf(),
        inverse: uniform_sphere_to_square,
        z: [-1.0, 1.0],
    },
    Case {
        name: "uniform_hemisphere",
        map: square_to_uniform_hemisphere,
        pdf: uniform_hemisphere_pdf,
        inverse: uniform_hemisphere_to_square,
        z: [0.0, 1.0],
    },
    Case {
        name: "uniform_cone",
        map: |u| square_to_uniform_cone(u, WIDE),
        pdf: |d| uniform_cone_pdf(d, WIDE),
        inverse: |d| uniform_cone_to_square(d, WIDE),
        z: [1.0 - WIDE as f64, 1.0],
    },
    Case {
        name: "uniform_cone_sun",
        map: |u| square_to_uniform_cone(u, SUN),
        pdf: |d| uniform_cone_pdf(d, SUN),
        inverse: |d| uniform_cone_to_square(d, SUN),
        z: [1.0 - SUN as f64, 1.0],
    },
];

fn write_evidence(name: &str, observed: &[f64], expected: &[f64]) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/evidence");
    let rows: String = observed.iter().zip(expected).map(|(o, e)| format!("{o},{e}\n")).collect();
    let _ = std::fs::create_dir_all(&folder);
    let _ = std::fs::write(folder.join(format!("{name}.csv")), format!("observed,expected\n{rows}"));
}

/// Chi-square over 16 × 32 cells of (z, azimuth) against the density integrated over each
/// cell; 1 % for the family of all cases together, fixed numbers.
#[test]
fn maps_have_their_density() {
    let (rows, columns, n) = (16, 32, 1_u32 << 18);
    for (id, case) in CASES.iter().enumerate() {
        // Rows by 1 − z, because z itself cannot resolve the cone of the sun in f32.
        let row_of = |d: Vec3| {
            let depth = f64::from(depth_below_pole(d));
            let deepest = 1.0 - case.z[0];
            ((deepest - depth) / (case.z[1] - case.z[0]) * rows as f64).clamp(0.0, rows as f64 - 0.5) as usize
        };
        let mut observed = vec![0.0; rows * columns];
        for i in 0..n {
            let d = (case.map)([uniform(1, id as u64, i, 0), uniform(1, id as u64, i, 1)]);
            assert!((d.length() - 1.0).abs() < 3e-7, "{}: length {}", case.name, d.length());
            let column = ((f64::from(turns_of(d.x, d.y)) * columns as f64) as usize).min(columns - 1);
            observed[row_of(d) * columns + column] += 1.0;
        }
        let mut expected = vec![0.0; rows * columns];
        let steps = 8;
        let cell = (case.z[1] - case.z[0]) / (rows * steps) as f64;
        for row in 0..rows * steps {
            let depth = (1.0 - case.z[0]) - (row as f64 + 0.5) * cell;
            for column in 0..columns * steps {
                let azimuth = (column as f64 + 0.5) / (columns * steps) as f64;
                let direction = polar(azimuth as f32, depth as f32);
                let solid_angle = cell * 2.0 * std::f64::consts::PI / (columns * steps) as f64;
                expected[row / steps * columns + column / steps] +=
                    f64::from(n) * f64::from((case.pdf)(direction)) * solid_angle;
            }
        }
        let total: f64 = expected.iter().sum();
        assert!(
            (total / f64::from(n) - 1.0).abs() < 1e-5,
            "{}: density integrates to {}",
            case.name,
            total / f64::from(n)
        );
        let p = chi_square_test(&observed, &expected).p;
        if p <= sidak(0.01, CASES.len() + 2) {
            write_evidence(case.name, &observed, &expected);
            panic!("{}: p = {p:e}; cells in target/evidence/{}.csv", case.name, case.name);
        }
    }
}

#[test]
fn disk_and_hemicircle_have_their_density() {
    let (cells, n) = (16, 1_u32 << 18);
    let mut disk = vec![0.0; cells * cells];
    let mut circle = vec![0.0; 64];
    for i in 0..n {
        let u = [uniform(2, 0, i, 0), uniform(2, 0, i, 1)];
        let p = square_to_uniform_disk(u);
        assert!(p.length() <= 1.0 + 2e-7);
        let ring = ((f64::from(p.length_squared()) * cells as f64) as usize).min(cells - 1);
        disk[ring * cells + ((turns_of(p.x, p.y) * cells as f32) as usize).min(cells - 1)] += 1.0;
        let angle = f64::from(unit_to_cosine_hemicircle(u[0]));
        circle[((angle / std::f64::consts::PI + 0.5) * 64.0).clamp(0.0, 63.0) as usize] += 1.0;
    }
    let p = chi_square_test(&disk, &vec![f64::from(n) / disk.len() as f64; disk.len()]).p;
    assert!(p > sidak(0.01, CASES.len() + 2), "disk: p = {p:e}");
    let edge = |i: usize| libm::sin((i as f64 / 64.0 - 0.5) * std::f64::consts::PI);
    let expected: Vec<f64> = (0..64).map(|i| f64::from(n) * 0.5 * (edge(i + 1) - edge(i))).collect();
    let p = chi_square_test(&circle, &expected).p;
    assert!(p > sidak(0.01, CASES.len() + 2), "hemicircle: p = {p:e}");
    // ∫ cosθ over the hemicircle is 2 (VALIDATION 23): the density is cosθ/2.
    let sum: f64 = (0..1000).map(|i| f64::from(cosine_hemicircle_pdf((i as f32 + 0.5) * PI / 1000.0 - 0.5 * PI))).sum();
    assert!((sum * std::f64::consts::PI / 1000.0 - 1.0).abs() < 1e-6);
    assert_eq!(cosine_hemicircle_pdf(2.0), 0.0);
    assert_eq!(uniform_disk_pdf(Vec2::new(0.8, 0.7)), 0.0);
}

#[test]
fn inverses_undo_the_maps() {
    for case in &CASES {
        for i in 0..20_000 {
            let u = [uniform(3, 0, i, 0), uniform(3, 0, i, 1)];
            let d = (case.map)(u);
            let back = (case.inverse)(d);
            // The azimuth's digits are lost where the radius is small and the height's at the
            // rim: compare the disk coordinates, relative to the width of the image, and z².
            let again = (case.map)(back);
            let width = (case.map)([0.0, 0.999]).truncate().length();
            let apart = (again - d).truncate().length();
            assert!(apart < 2e-6 * width.max(d.truncate().length()), "{}: {u:?} {d} {again}", case.name);
            assert!((again.z * again.z - d.z * d.z).abs() < 4e-6, "{}: {u:?} {d} {again}", case.name);
            let away = |a: f32, b: f32| (a - b).abs().min(1.0 - (a - b).abs());
            // d is rounded to 6e-8 of 1; u follows with the derivative, unbounded only at
            // the rim of the disk and at the pole.
            if u[1] > 0.01 && u[1] < 0.99 && u[0] > 0.01 && u[0] < 0.99 {
                assert!(away(back[0], u[0]) < 4e-6 && away(back[1], u[1]) < 4e-6, "{}: {u:?} {back:?}", case.name);
            }
        }
    }
    for i in 0..1000 {
        let u = i as f32 / 1000.0;
        assert!((cosine_hemicircle_to_unit(unit_to_cosine_hemicircle(u)) - u).abs() < 1e-6);
    }
}

#[test]
fn corners_of_the_square_stay_finite() {
    for u in [[0.0, 0.0], [0.0, BELOW_ONE], [BELOW_ONE, 0.0], [BELOW_ONE, BELOW_ONE], [0.5, 0.5], [0.5, 0.0]] {
        for case in &CASES {
            let d = (case.map)(u);
            assert!(d.is_finite() && (d.length() - 1.0).abs() < 3e-7, "{} {u:?}: {d}", case.name);
            assert!((case.inverse)(d).iter().all(|v| (0.0..1.0).contains(v)), "{} {u:?}", case.name);
        }
    }
    assert_eq!(square_to_cosine_hemisphere([0.5, 0.5]), Vec3::Z);
}
