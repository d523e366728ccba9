//! Mean and variance, quantiles, and the tests of hypotheses by which Monte Carlo code is judged.
//!
//! Library code uses [`Running`], [`t_quantile`], [`half_interval_95`] and the root mean squares; the rest serves tests
//! all over the crate. Special functions come from `libm`, so results do not depend on the
//! platform.

use std::f64::consts::{PI, SQRT_2};

/// Two-sided 95 % quantile of Student's t with 3 degrees of freedom: the factor from the
/// standard error over four replicates to half of a 95 % interval.
pub const T_QUANTILE_95_3: f64 = 3.182_446_305_284_263;

/// The same with 9 degrees of freedom.
pub const T_QUANTILE_95_9: f64 = 2.262_157_162_798_205;

/// The same with 15 degrees of freedom.
pub const T_QUANTILE_95_15: f64 = 2.131_449_545_559_323;

/// Bands whose variances the stored standard error of an openness pools.
///
/// Bands 0 to 2 have nearly one variance; more would overestimate that of band 0, because the nets of points do
/// less for higher bands (measured over bowl, caffeine_density and purkinje_neuron at 64 to 256 rays: band 1 has 1.01
/// to 1.10 of the variance of band 0, band 2 1.03 to 1.24, band 4 1.14 to 1.67).
pub const POOLED_BANDS: usize = 3;

/// Degrees of freedom of the standard error that a baked texel stores for the chance a_k to escape, when layer k has
/// `bands` bands: 3, 9 or 15 for 1, 2 and more bands.
///
/// Four replicates give each coefficient 3; the 9 coefficients of three bands would have 27 if they were
/// independent, and they are not. 15 is chosen so that Student's t gives the intervals that cover 95 % (measured as
/// above, on volumes other than those on which coverage is judged; example `measure-coverage`). Under a
/// texture made with `gather` this holds of layer 0; its others have 3.
pub const fn stored_degrees(bands: usize) -> u32 {
    match bands {
        0 | 1 => 3,
        2 => 9,
        _ => 15,
    }
}

/// The factor from a stored standard error to half of a 95 % interval, for a layer of `bands` bands: the quantile of
/// Student's t with [`stored_degrees`]. For the radiance of a texel take the bands of layer 0.
///
/// What is promised: the interval estimate ± this · stderr covers 93 to 97 % of the texels of most volumes at 64 and
/// 256 rays, and more where hardly anything is hidden or rays are fewer. It is a statement about the noise of the
/// bake alone, for one texel at a time; interpolation between texels and the cut at the band limit are not in it.
pub const fn half_interval_95(bands: usize) -> f64 {
    match stored_degrees(bands) {
        3 => T_QUANTILE_95_3,
        9 => T_QUANTILE_95_9,
        _ => T_QUANTILE_95_15,
    }
}

/// Mean and variance of numbers that arrive one by one (Welford 1962, "Note on a Method for
/// Calculating Corrected Sums of Squares and Products", Technometrics 4(3)).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Running {
    count: u64,
    mean: f64,
    squares: f64, // Σ (x − mean)²
}

impl Running {
    /// No number yet.
    pub const fn new() -> Self {
        Self { count: 0, mean: 0.0, squares: 0.0 }
    }

    /// Takes one more number.
    pub fn push(&mut self, value: f64) {
        self.count += 1;
        let before = value - self.mean;
        self.mean += before / self.count as f64;
        self.squares += before * (value - self.mean);
    }

    /// How many numbers there were.
    pub const fn count(&self) -> u64 {
        self.count
    }

    /// Their mean; 0 for none.
    pub const fn mean(&self) -> f64 {
        self.mean
    }

    /// Unbiased estimate of the variance of one number; 0 for fewer than two.
    pub fn variance(&self) -> f64 {
        if self.count < 2 { 0.0 } else { self.squares / (self.count - 1) as f64 }
    }

    /// Standard error of the mean; 0 for fewer than two numbers, where it is unknown.
    pub fn standard_error(&self) -> f64 {
        if self.count < 2 { 0.0 } else { (self.variance() / self.count as f64).sqrt() }
    }

    /// Chance that a mean at least this far from `expected` arises if `expected` is right, by
    /// Student's t (two-sided; the z-test where there are many numbers). 1 for fewer than two
    /// numbers; 0 when all numbers are equal and not `expected`.
    pub fn p_of_mean(&self, expected: f64) -> f64 {
        let difference = (self.mean - expected).abs();
        match self.standard_error() {
            _ if self.count < 2 || difference == 0.0 => 1.0,
            error if self.count > 1000 => normal_two_sided(difference / error),
            error => 1.0 - t_within(difference / error, (self.count - 1) as u32),
        }
    }

    /// Half of the 95 % interval of the mean, by Student's t; infinite for fewer than two numbers.
    pub fn half_interval_95(&self) -> f64 {
        if self.count < 2 { f64::INFINITY } else { t_quantile(0.95, (self.count - 1) as u32) * self.standard_error() }
    }
}

impl FromIterator<f64> for Running {
    fn from_iter<I: IntoIterator<Item = f64>>(values: I) -> Self {
        let mut running = Self::new();
        for value in values {
            running.push(value);
        }
        running
    }
}

/// Chance that Student's t with `degrees` degrees of freedom lies within ±`t`
/// (Abramowitz & Stegun 1964, 26.7.3 and 26.7.4: finite series for whole degrees).
pub fn t_within(t: f64, degrees: u32) -> f64 {
    let t = t.abs();
    if t.is_infinite() {
        return 1.0;
    }
    let angle = libm::atan(t / f64::from(degrees).sqrt());
    let (sine, cosine) = (libm::sin(angle), libm::cos(angle));
    let square = cosine * cosine;
    let odd = degrees % 2 == 1;
    // Terms cos^j times the running product of (j−1)/j.
    let (mut term, mut sum) = (if odd { cosine } else { 1.0 }, 0.0);
    let mut power = if odd { 1 } else { 0 };
    while power + 2 <= degrees {
        sum += term;
        term *= square * f64::from(power + 1) / f64::from(power + 2);
        power += 2;
    }
    if odd { 2.0 / PI * (angle + sine * sum) } else { sine * sum }
}

/// The t with [`t_within`]`(t, degrees)` = `confidence`, to 1e-12 relative, by bisection: about 50
/// series of `degrees`/2 terms, so keep the result. 0.95 and 3 give [`T_QUANTILE_95_3`].
///
/// # Panics
/// When `degrees` is 0 or `confidence` is not in (0, 1).
pub fn t_quantile(confidence: f64, degrees: u32) -> f64 {
    assert!(degrees > 0 && confidence > 0.0 && confidence < 1.0, "t quantile of {confidence}, {degrees}");
    let (mut low, mut high) = (0.0, 1.0);
    while t_within(high, degrees) < confidence && high < 1e15 {
        (low, high) = (high, 2.0 * high);
    }
    while high - low > 1e-12 * high {
        let middle = 0.5 * (low + high);
        if t_within(middle, degrees) < confidence {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Chance that a standard normal number lies outside ±`z`.
pub fn normal_two_sided(z: f64) -> f64 {
    libm::erfc(z.abs() / SQRT_2)
}

/// Significance of each of `tests` independent tests so that all together reject a true
/// hypothesis with chance `significance` (Šidák 1967): 1 − (1 − α)^(1/n).
pub fn sidak(significance: f64, tests: usize) -> f64 {
    -libm::expm1(libm::log1p(-significance) / tests.max(1) as f64)
}

/// Chance that chi-square with `degrees` degrees of freedom exceeds `statistic`: the regularised
/// incomplete gamma function Q(degrees/2, statistic/2), relative error below 1e-10 for up to a
/// million degrees (series below the mean, Lentz's continued fraction above; Press et al. 2007,
/// "Numerical Recipes", 3rd ed., section 6.2).
pub fn chi_square_survival(statistic: f64, degrees: usize) -> f64 {
    let (a, x) = (0.5 * degrees as f64, 0.5 * statistic);
    if x <= 0.0 || degrees == 0 {
        return 1.0;
    }
    let scale = libm::exp(a * libm::log(x) - x - libm::lgamma(a));
    // Both expansions need a few times sqrt(a) terms near x = a.
    let limit = 1000 + 20 * libm::sqrt(a) as usize;
    if x < a + 1.0 {
        let (mut term, mut sum, mut n) = (1.0 / a, 1.0 / a, a);
        for _ in 0..limit {
            n += 1.0;
            term *= x / n;
            sum += term;
            if term < 1e-16 * sum {
                break;
            }
        }
        1.0 - scale * sum
    } else {
        let tiny = f64::MIN_POSITIVE;
        let mut b = x + 1.0 - a;
        let mut c = 1.0 / tiny;
        let mut d = 1.0 / b;
        let mut fraction = d;
        for i in 1..limit {
            let i = i as f64;
            let numerator = -i * (i - a);
            b += 2.0;
            d = 1.0 / nonzero(numerator * d + b, tiny);
            c = nonzero(b + numerator / c, tiny);
            fraction *= d * c;
            if (d * c - 1.0).abs() < 1e-16 {
                break;
            }
        }
        scale * fraction
    }
}

fn nonzero(value: f64, tiny: f64) -> f64 {
    if value.abs() < tiny { tiny } else { value }
}

/// What [`chi_square_test`] finds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChiSquare {
    /// Σ (observed − expected)²/expected after pooling.
    pub statistic: f64,
    /// Cells after pooling, less one.
    pub degrees: usize,
    /// Chance of a larger statistic if the expectation is right; 0 if something was observed in
    /// cells that expect nothing.
    pub p: f64,
}

/// Pearson's test of counts against their expectation. Cells that expect fewer than 5 are pooled
/// in order until the pool expects 5, since the statistic follows chi-square only then.
///
/// # Panics
/// When the slices differ in length.
pub fn chi_square_test(observed: &[f64], expected: &[f64]) -> ChiSquare {
    assert_eq!(observed.len(), expected.len(), "one expectation a cell");
    let (mut statistic, mut cells) = (0.0, 0_usize);
    let (mut pool_observed, mut pool_expected) = (0.0, 0.0);
    for (&o, &e) in observed.iter().zip(expected) {
        if e <= 0.0 && o > 0.0 {
            return ChiSquare { statistic: f64::INFINITY, degrees: cells, p: 0.0 };
        }
        pool_observed += o;
        pool_expected += e;
        if pool_expected >= 5.0 {
            statistic += (pool_observed - pool_expected).powi(2) / pool_expected;
            cells += 1;
            (pool_observed, pool_expected) = (0.0, 0.0);
        }
    }
    if pool_expected > 0.0 {
        statistic += (pool_observed - pool_expected).powi(2) / pool_expected;
        cells += 1;
    }
    let degrees = cells.saturating_sub(1);
    ChiSquare { statistic, degrees, p: chi_square_survival(statistic, degrees) }
}

/// Root mean square; 0 for no numbers.
pub fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0_u64);
    for value in values {
        sum += value * value;
        count += 1;
    }
    if count == 0 { 0.0 } else { (sum / count as f64).sqrt() }
}

/// sqrt(Σ (a − b)² / Σ b²) over pairs (a, b): the error of `a` relative to the reference `b`.
/// 0 when both sums are 0, infinite when only the reference vanishes.
pub fn relative_rms(pairs: impl IntoIterator<Item = (f64, f64)>) -> f64 {
    let (mut difference, mut reference) = (0.0, 0.0);
    for (a, b) in pairs {
        difference += (a - b) * (a - b);
        reference += b * b;
    }
    if difference == 0.0 { 0.0 } else { (difference / reference).sqrt() }
}

/// RMS of a − b over the mean of b, for pairs (a, b): the relative RMS of `tests/VALIDATION.md`.
/// 0 when a = b everywhere, infinite when only the mean of b vanishes.
pub fn rms_over_mean(pairs: impl IntoIterator<Item = (f64, f64)>) -> f64 {
    let (mut difference, mut reference, mut count) = (0.0, 0.0, 0_u64);
    for (a, b) in pairs {
        difference += (a - b) * (a - b);
        reference += b;
        count += 1;
    }
    if difference == 0.0 { 0.0 } else { (difference * count as f64).sqrt() / reference.abs() }
}

/// Slope of the least-squares line through (ln n, ln error): the order of convergence. Points
/// with an error of 0 are left out; NaN with fewer than two points.
pub fn log_log_slope(points: &[(f64, f64)]) -> f64 {
    let logs: Vec<(f64, f64)> =
        points.iter().filter(|p| p.0 > 0.0 && p.1 > 0.0).map(|p| (libm::log(p.0), libm::log(p.1))).collect();
    let count = logs.len() as f64;
    let mean = logs.iter().fold((0.0, 0.0), |m, p| (m.0 + p.0 / count, m.1 + p.1 / count));
    let covariance: f64 = logs.iter().map(|p| (p.0 - mean.0) * (p.1 - mean.1)).sum();
    let variance: f64 = logs.iter().map(|p| (p.0 - mean.0).powi(2)).sum();
    covariance / variance
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn welford_agrees_with_the_definition_far_from_zero() {
        // Deviations are whole numbers of sum 0: mean 1e9, variance 30/4.
        let deviations: [f64; 5] = [-3.0, 1.0, 4.0, -2.0, 0.0];
        let running: Running = deviations.iter().map(|d| 1e9 + d).collect();
        assert_eq!(running.count(), 5);
        assert_eq!(running.mean(), 1e9);
        assert!((running.variance() - 30.0 / 4.0).abs() < 1e-6);
        // t² = 1/(7.5/5) = 2/3 with 4 degrees; there p = 1 − s (3 − s²)/2 with s² = t²/(4 + t²).
        let s = (1.0_f64 / 7.0).sqrt();
        assert!((running.p_of_mean(1e9 + 1.0) - (1.0 - s * (3.0 - s * s) / 2.0)).abs() < 1e-7);
        assert_eq!(running.p_of_mean(1e9), 1.0);
        assert_eq!([1.0, 1.0].into_iter().collect::<Running>().p_of_mean(2.0), 0.0);
        assert_eq!(Running::new().half_interval_95(), f64::INFINITY);
        assert_eq!(Running::new().mean(), 0.0);
    }

    #[test]
    fn t_quantiles_are_the_tabulated_ones() {
        // Two-sided 95 %, Abramowitz & Stegun table 26.10, three decimals.
        let table =
            [(1, 12.706), (2, 4.303), (3, 3.182), (4, 2.776), (5, 2.571), (10, 2.228), (30, 2.042), (120, 1.980)];
        for (degrees, t) in table {
            assert!((t_quantile(0.95, degrees) - t).abs() < 6e-4, "{degrees}: {}", t_quantile(0.95, degrees));
        }
        for bands in 1..6 {
            let exact = t_quantile(0.95, stored_degrees(bands));
            assert!((exact - half_interval_95(bands)).abs() < 1e-10, "{bands} bands: {exact}");
        }
        // One degree of freedom is Cauchy: t = tan(π/2 · confidence).
        assert!((t_quantile(0.5, 1) - 1.0).abs() < 1e-11);
    }

    #[test]
    fn chi_square_survival_meets_closed_forms() {
        for x in [0.01, 0.5, 1.0, 3.0, 10.0, 40.0, 200.0] {
            let close =
                |ours: f64, exact: f64| assert!((ours - exact).abs() < 1e-11 + 1e-10 * exact, "{x}: {ours} {exact}");
            close(chi_square_survival(x, 2), (-0.5 * x).exp());
            close(chi_square_survival(x, 4), (-0.5 * x).exp() * (1.0 + 0.5 * x));
            close(chi_square_survival(x, 1), libm::erfc((0.5 * x).sqrt()));
        }
        // Wilson-Hilferty at many degrees of freedom, good to about 1e-4 there.
        for x in [9_700.0, 10_000.0, 10_300.0] {
            let k = 10_000.0_f64;
            let z = ((x / k).powf(1.0 / 3.0) - (1.0 - 2.0 / (9.0 * k))) / (2.0 / (9.0 * k)).sqrt();
            assert!((chi_square_survival(x, 10_000) - 0.5 * libm::erfc(z / SQRT_2)).abs() < 1e-4);
        }
    }

    #[test]
    fn the_test_accepts_its_hypothesis_and_rejects_a_tilt() {
        let n = 100_000;
        let counts = |tilt: f64| {
            let mut cells = vec![0.0; 20];
            for i in 0..n {
                let u = f64::from(crate::sampling::hash::uniform(5, 0, i, 0));
                cells[((u + tilt * u * (1.0 - u)) * 20.0) as usize] += 1.0;
            }
            cells
        };
        let expected = vec![f64::from(n) / 20.0; 20];
        assert!(chi_square_test(&counts(0.0), &expected).p > 0.01);
        assert!(chi_square_test(&counts(0.05), &expected).p < 1e-4);
        assert_eq!(chi_square_test(&[5.0, 1.0], &[6.0, 0.0]).p, 0.0);
        let pooled = chi_square_test(&[1.0, 1.0, 3.0, 2.0, 2.0], &[1.0, 1.0, 3.0, 2.5, 2.5]);
        assert_eq!((pooled.degrees, pooled.statistic), (1, 0.2));
    }

    #[test]
    fn corrections_and_norms() {
        assert!((sidak(0.01, 1) - 0.01).abs() < 1e-16);
        assert!(((1.0 - sidak(0.01, 50)).powi(50) - 0.99).abs() < 1e-12);
        assert!((normal_two_sided(-1.959_963_984_540_054) - 0.05).abs() < 1e-14);
        assert_eq!(rms([3.0, -4.0, 0.0, 0.0]), 2.5);
        assert_eq!(relative_rms([(4.0, 3.0), (4.0, 4.0)]), 0.2);
        assert_eq!(rms_over_mean([(3.0, 2.0), (1.0, 2.0)]), 0.5);
        let ladder: Vec<_> = (1..6).map(|n| (f64::from(n), 7.0 * f64::from(n).powf(-1.5))).collect();
        assert!((log_log_slope(&ladder) + 1.5).abs() < 1e-12);
    }
}
