use super::super::project::sphere_rule;
use super::super::{basis, index};
use super::*;
use glam::DVec3;
use std::f64::consts::PI;

const N: usize = 121;

/// Rotations about z and y by generic angles, with β = 0 and π, and all kinds between.
fn cases() -> Vec<DMat3> {
    let mut list = Vec::new();
    for beta in [0.0, 1e-9, 0.5, 1.3, 0.5 * PI, 2.9, PI - 1e-9, PI] {
        for (alpha, gamma) in [(0.0, 0.0), (0.7, -2.1), (PI, 3.0)] {
            list.push(DMat3::from_rotation_z(alpha) * DMat3::from_rotation_y(beta) * DMat3::from_rotation_z(gamma));
        }
    }
    list.push(DMat3::from_axis_angle(DVec3::new(1.0, -2.0, 0.5).normalize(), 2.0));
    list
}

fn mixed() -> Coefficients {
    Coefficients::new(MAX_BANDS, (0..N).map(|i| ((i * i + 1) as f64 * 0.7).sin()).collect()).unwrap()
}

/// The slow twin, from the definition: block[m, n] = ∫ Y_m(ω) Y_n(R⁻¹ω) dω.
#[test]
fn blocks_are_the_integrals_that_define_them() {
    for matrix in cases() {
        let rotation = Rotation::new(MAX_BANDS, &matrix).unwrap();
        let mut twin = vec![0.0; N * N];
        let (mut here, mut back) = ([0.0; N], [0.0; N]);
        for (direction, weight) in sphere_rule(20) {
            basis::evaluate(MAX_BANDS, direction.to_array(), &mut here);
            basis::evaluate(MAX_BANDS, (matrix.transpose() * direction).to_array(), &mut back);
            for i in 0..N {
                for j in 0..N {
                    twin[i * N + j] += weight * here[i] * back[j];
                }
            }
        }
        for l in 0..MAX_BANDS {
            for m in 0..2 * l + 1 {
                for n in 0..2 * l + 1 {
                    let ours = rotation.block(l)[m * (2 * l + 1) + n];
                    let exact = twin[(l * l + m) * N + l * l + n];
                    assert!((ours - exact).abs() < 1e-12, "l {l} {m} {n}: {ours} {exact}\n{matrix}");
                }
            }
        }
    }
}

#[test]
fn rotate_then_evaluate_is_evaluate_at_the_rotated_direction() {
    let f = mixed();
    for matrix in cases() {
        let rotated = Rotation::new(MAX_BANDS, &matrix).unwrap().apply(&f);
        for (direction, _) in sphere_rule(6).into_iter().chain([(DVec3::Z, 0.0), (-DVec3::Z, 0.0), (DVec3::X, 0.0)]) {
            let expected = f.evaluate(matrix.transpose() * direction);
            assert!((rotated.evaluate(direction) - expected).abs() < 1e-10 * f.energy().sqrt());
        }
        for l in 0..MAX_BANDS {
            assert!((rotated.band_energy(l) - f.band_energy(l)).abs() < 1e-10);
        }
    }
    // A feature at +x comes to +y under a quarter turn about z.
    let turn = Rotation::new(3, &DMat3::from_rotation_z(0.5 * PI)).unwrap();
    let moved = turn.apply(&Coefficients::delta(3, DVec3::X));
    let expected = Coefficients::delta(3, DVec3::Y);
    for i in 0..9 {
        assert!((moved.values()[i] - expected.values()[i]).abs() < 1e-14);
    }
}

#[test]
fn rotations_form_a_group_of_orthogonal_blocks() {
    let f = mixed();
    let list = cases();
    for (a, b) in list.iter().zip(list.iter().rev()) {
        let both = Rotation::new(MAX_BANDS, &(*a * *b)).unwrap().apply(&f);
        let (ra, rb) = (Rotation::new(MAX_BANDS, a).unwrap(), Rotation::new(MAX_BANDS, b).unwrap());
        let one_by_one = ra.apply(&rb.apply(&f));
        for i in 0..N {
            assert!((both.values()[i] - one_by_one.values()[i]).abs() < 1e-10);
        }
        for l in 0..MAX_BANDS {
            let (width, block) = (2 * l + 1, ra.block(l));
            for i in 0..width {
                for j in 0..width {
                    let dot: f64 = (0..width).map(|k| block[i * width + k] * block[j * width + k]).sum();
                    assert!((dot - if i == j { 1.0 } else { 0.0 }).abs() < 1e-10);
                }
            }
        }
    }
}

#[test]
fn what_is_no_rotation_is_refused_and_single_precision_is_accepted() {
    let mirror = DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0));
    assert!(Rotation::new(5, &mirror).unwrap_err().to_string().contains("mirrored"));
    assert!(Rotation::new(5, &(DMat3::IDENTITY * 2.0)).is_err());
    assert!(Rotation::new(5, &(DMat3::IDENTITY * f64::NAN)).is_err());
    assert!(Rotation::new(0, &DMat3::IDENTITY).is_err());
    assert!(Rotation::new(12, &DMat3::IDENTITY).is_err());
    let rough = DMat3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.0).as_mat3().as_dmat3();
    let rotation = Rotation::new(MAX_BANDS, &rough).unwrap();
    let f = mixed();
    assert!((rotation.apply(&f).energy() / f.energy() - 1.0).abs() < 1e-13);
    assert_eq!(Rotation::new(1, &rough).unwrap().apply(&Coefficients::constant(1, 2.0)).mean(), 2.0);
    assert_eq!(index(10, 10), N - 1);
}
