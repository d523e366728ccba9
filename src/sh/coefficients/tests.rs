use super::*;

fn ramp(bands: usize) -> Coefficients {
    Coefficients::new(bands, (0..bands * bands).map(|i| 0.3 + i as f64).collect()).unwrap()
}

#[test]
fn construction_refuses_what_is_not_a_function() {
    assert!(Coefficients::new(0, vec![]).is_err());
    assert!(Coefficients::new(12, vec![0.0; 144]).is_err());
    let message = Coefficients::new(2, vec![0.0; 9]).unwrap_err().to_string();
    assert!(message.contains("9 values") && message.contains("4 values for 2 bands"), "{message}");
    assert!(Coefficients::new(1, vec![f64::NAN]).unwrap_err().to_string().contains("NaN"));
}

#[test]
fn functions_add_and_scale_pointwise_across_band_counts() {
    let (a, b) = (ramp(3), ramp(5));
    let d = DVec3::new(0.36, -0.48, 0.8);
    let combined = &(&a * 2.0) - &b;
    assert_eq!(combined.bands(), 5);
    assert!((combined.evaluate(d) - (2.0 * a.evaluate(d) - b.evaluate(d))).abs() < 1e-12);
    assert_eq!(a.extended(5).truncated(3), a);
    assert_eq!(b.truncated(3).dot(b.values()), b.dot(&b.values()[..9]));
    assert!((Coefficients::constant(4, 2.5).evaluate(d) - 2.5).abs() < 1e-15);
    assert_eq!(Coefficients::constant(4, 2.5).mean(), 2.5);
}

#[test]
fn energies_split_by_band() {
    let a = ramp(4);
    assert!((a.energy() - a.values().iter().map(|v| v * v).sum::<f64>()).abs() < 1e-9);
    assert!((a.energy() - a.contrast() - 0.09).abs() < 1e-9);
    assert_eq!(a.filtered(&[1.0, 0.0]).values()[1..], [0.0; 15]);
    // Addition theorem: a delta has energy (2l+1)/4π in band l.
    let delta = Coefficients::delta(11, DVec3::new(0.6, 0.0, -0.8));
    for l in 0..11 {
        let expected = (2 * l + 1) as f64 / (4.0 * std::f64::consts::PI);
        assert!((delta.band_energy(l) - expected).abs() < 1e-13);
    }
}

#[test]
fn transfer_in_half_precision_meets_light_in_double() {
    let light = ramp(2);
    let transfer = [1.0, 0.5, -2.0, 0.0].map(half::f16::from_f64);
    assert!((light.dot(&transfer) - (0.3 + 0.65 - 4.6)).abs() < 1e-12);
}
