//! Properties of rotations and of certificates of spherical harmonics, on random input at every band limit and
//! scale (VALIDATION 6 and 19).

use glam::{DMat3, DQuat, DVec3};
use isolume::sh::certified::{bounds, certify};
use isolume::sh::{Coefficients, MAX_BANDS, Rotation};
use proptest::prelude::*;

fn a_rotation() -> impl Strategy<Value = DMat3> {
    let axis = prop::array::uniform3(-1.0..1.0f64);
    let angle = prop_oneof![0.0..std::f64::consts::TAU, Just(0.0), Just(std::f64::consts::PI), Just(1e-9)];
    (axis, angle, prop::bool::ANY).prop_filter_map("an axis", |(axis, angle, straight)| {
        // Half of them about an axis of the frame, where the poles meet themselves or each other.
        let axis = if straight { [axis[0].round(), axis[1].round(), axis[2].round()] } else { axis };
        let axis = DVec3::from_array(axis).try_normalize()?;
        Some(DMat3::from_quat(DQuat::from_axis_angle(axis, angle)))
    })
}

/// Coefficients of 1 to 11 bands with a mean of about 1, times a scale.
fn a_function() -> impl Strategy<Value = Coefficients> {
    let values = prop::collection::vec(-1.0..1.0f64, MAX_BANDS * MAX_BANDS);
    (1..=MAX_BANDS, values, prop_oneof![Just(0.0), -30.0..30.0f64]).prop_map(|(bands, mut values, exponent)| {
        values.truncate(bands * bands);
        values[0] = values[0].abs() + 1.0;
        let scale = 10f64.powf(exponent);
        Coefficients::new(bands, values.iter().map(|v| v * scale).collect()).unwrap()
    })
}

fn a_direction() -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-1.0..1.0f64).prop_filter_map("a direction", |v| DVec3::from_array(v).try_normalize())
}

/// Largest difference of two functions, over the largest coefficient of the first.
fn difference(a: &Coefficients, b: &Coefficients) -> f64 {
    let largest = a.values().iter().fold(f64::MIN_POSITIVE, |m, v| m.max(v.abs()));
    a.values().iter().zip(b.values()).fold(0.0f64, |m, (x, y)| m.max((x - y).abs())) / largest
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn rotations_compose_invert_keep_norms_and_move_values(
        function in a_function(), first in a_rotation(), second in a_rotation(), direction in a_direction(),
    ) {
        let bands = function.bands();
        let of = |m: &DMat3| Rotation::new(bands, m).unwrap();
        let turned = of(&first).apply(&function);
        // 1e-10 to degree 10 (VALIDATION 6).
        prop_assert!(difference(&of(&second).apply(&turned), &of(&(second * first)).apply(&function)) < 1e-10);
        prop_assert!(difference(&of(&first.transpose()).apply(&turned), &function) < 1e-10);
        for l in 0..bands {
            let (before, after) = (function.band_energy(l), turned.band_energy(l));
            prop_assert!((before - after).abs() <= 1e-10 * function.energy(), "band {l}: {before} {after}");
        }
        let (there, here) = (turned.evaluate(first * direction), function.evaluate(direction));
        // A sum of n² terms of at most n/sqrt(4π) of the norm together.
        prop_assert!((there - here).abs() <= 1e-9 * function.energy().sqrt() * bands as f64, "{there} {here}");
    }

}

proptest! {
    // A bound of 11 bands takes milliseconds.
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn bounds_hold_at_every_direction_and_do_not_depend_on_the_frame(
        function in a_function(), rotation in a_rotation(), directions in prop::collection::vec(a_direction(), 40),
    ) {
        let (low, high) = bounds(&function);
        prop_assert!(low <= high && low.is_finite() && high.is_finite());
        let rounding = 1e-9 * function.energy().sqrt() * function.bands() as f64;
        for direction in directions {
            let value = function.evaluate(direction);
            prop_assert!((low - rounding..=high + rounding).contains(&value), "{low} {value} {high}");
        }
        // Values of the turned function are values of the function: each bound holds for both.
        let (turned_low, turned_high) = bounds(&Rotation::new(function.bands(), &rotation).unwrap().apply(&function));
        prop_assert!(turned_low <= high + rounding && low <= turned_high + rounding);
        let mean = function.mean();
        prop_assert!(low <= mean + rounding && mean <= high + rounding);
    }

    #[test]
    fn certified_functions_are_nowhere_negative_at_any_scale_and_keep_their_mean(
        function in a_function(), directions in prop::collection::vec(a_direction(), 40),
    ) {
        let certified = certify(std::slice::from_ref(&function)).unwrap();
        prop_assert!(certified.factors.iter().all(|f| (0.0..=1.0 + 1e-12).contains(f)), "{:?}", certified.factors);
        let filtered = function.filtered(&certified.factors);
        prop_assert!((filtered.mean() / function.mean() - 1.0).abs() < 1e-12);
        let rounding = 1e-12 * function.energy().sqrt() * function.bands() as f64;
        prop_assert!(bounds(&filtered).0 >= -rounding, "{}", bounds(&filtered).0);
        for direction in directions {
            prop_assert!(filtered.evaluate(direction) >= -rounding, "{}", filtered.evaluate(direction));
        }
    }
}

#[test]
fn black_and_constant_functions_pass_through_the_certificate() {
    for bands in 1..=MAX_BANDS {
        assert_eq!(bounds(&Coefficients::zero(bands)), (0.0, 0.0));
        for value in [0.0, 1e-30, 1.0, 1e30] {
            let constant = Coefficients::constant(bands, value);
            let certified = certify(std::slice::from_ref(&constant)).unwrap();
            assert_eq!(constant.filtered(&certified.factors).values(), constant.values(), "{bands} {value}");
        }
    }
}
