use super::super::project::legendre;
use super::*;
use glam::DVec3;

/// Irradiance under a unit sun at +z at the cosine `c`, from the library.
fn sun_irradiance(bands: usize, factors: &[f64], c: f64) -> f64 {
    let sun = Coefficients::delta(bands, DVec3::Z).filtered(factors);
    irradiance(&sun).evaluate(DVec3::new((1.0 - c * c).sqrt(), 0.0, c))
}

fn minimum(bands: usize, factors: &[f64]) -> f64 {
    (0..=20_000).map(|i| sun_irradiance(bands, factors, f64::from(i) / 10_000.0 - 1.0)).fold(f64::INFINITY, f64::min)
}

/// VALIDATION 4: (l ≤, energy %, RMS %, min, E(1), max abs error).
const TABLE: [(usize, f64, f64, f64, f64, f64); 7] = [
    (0, 37.5, 79.06, 0.25, 0.25, 0.75),
    (1, 87.5, 35.36, -0.25, 0.75, 0.25),
    (2, 99.21875, 8.839, -0.039583, 1.0625, 0.09375),
    (4, 99.8047, 4.419, -0.031250, 0.96875, 0.05859),
    (6, 99.9237, 2.762, -0.015525, 1.01953, 0.04272),
    (8, 99.9626, 1.933, -0.013672, 0.98633, 0.03365),
    (10, 99.9790, 1.450, -0.009842, 1.01025, 0.02776),
];

#[test]
fn a_delta_sun_on_a_convex_body_reads_the_table() {
    // ∫ (max(c, 0))² dω = 2π/3 is the energy of the cosine lobe.
    let whole = 2.0 * PI / 3.0;
    for (degree, energy, rms, least, top, largest) in TABLE {
        let bands = degree + 1;
        let factors = vec![1.0; bands];
        let lobe = irradiance(&Coefficients::delta(bands, DVec3::Z));
        let share = lobe.energy() / whole;
        assert!((100.0 * share - energy).abs() < 6e-5, "l {degree}: energy {}", 100.0 * share);
        assert!((100.0 * (1.0 - share).sqrt() - rms).abs() < 6e-3, "l {degree}: rms");
        assert!((minimum(bands, &factors) - least).abs() < 1e-6, "l {degree}: min {}", minimum(bands, &factors));
        assert!((sun_irradiance(bands, &factors, 1.0) - top).abs() < 6e-6, "l {degree}: top");
        let error = (0..=20_000)
            .map(|i| f64::from(i) / 10_000.0 - 1.0)
            .map(|c| (sun_irradiance(bands, &factors, c) - c.max(0.0)).abs())
            .fold(0.0, f64::max);
        assert!((error - largest).abs() < 6e-6, "l {degree}: largest error {error}");
        // And the series of the definition.
        let p = legendre(degree.max(1), 0.3);
        let series: f64 = (0..bands).map(|l| CLAMPED_COSINE[l] * (2 * l + 1) as f64 / (4.0 * PI) * p[l]).sum();
        assert!((sun_irradiance(bands, &factors, 0.3) - series).abs() < 1e-13);
    }
}

#[test]
fn habitual_windows_do_not_dering() {
    // VALIDATION 5, true minima at l ≤ 2, width 3.
    let hann = Window::Hanning.factors(3).unwrap();
    let lanczos = Window::Lanczos.factors(3).unwrap();
    assert!((minimum(3, &hann) + 0.046875).abs() < 1e-6);
    assert!((minimum(3, &lanczos) + 0.034279).abs() < 1e-6);
    assert!(Window::Certified.factors(3).is_none());
    assert_eq!(Window::None.factors(2).unwrap(), [1.0, 1.0]);
}

#[test]
fn kept_shares_are_those_of_the_bands() {
    let f = Coefficients::new(2, vec![3.0, 0.0, 4.0, 0.0]).unwrap();
    let half = kept(&f.filtered(&[1.0, 0.5]), &f);
    assert_eq!(half, Kept { energy: 13.0 / 25.0, contrast: 0.25 });
    assert_eq!(kept(&Coefficients::zero(3), &Coefficients::zero(3)), Kept { energy: 1.0, contrast: 1.0 });
}
