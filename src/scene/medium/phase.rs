//! Phase functions: how a medium scatters, by the cosine c between the old and the new direction of flight.
//!
//! Normalised to ∫ p dω = 1, in 1/sr. (Qiu et al. 2007 normalise to 4π and print the scattering integral without the 1/(4π)
//! that this takes.) Each has a map from a variate, its density, and the inverse of the map.

use crate::error::{Error, Result};
use std::f64::consts::PI;

/// A phase function.
#[derive(Clone, Debug, PartialEq)]
pub enum Phase {
    /// 1/(4π).
    Isotropic,
    /// That of Henyey and Greenstein 1941 with mean cosine g, |g| < 1.
    HenyeyGreenstein(f64),
    /// (1 − k²) / (4π (1 − kc)²), |k| < 1 (Blasi, Le Saëc and Schlick 1993). k is not the mean cosine: see [`Self::schlick_of`].
    Schlick(f64),
    /// 3(1 + c²)/(16π), of particles far smaller than the wavelength.
    Rayleigh,
    /// By a table over the cosine.
    Table(PhaseTable),
    /// Others by their shares, which sum to 1.
    Mixture(Vec<(f64, Phase)>),
}

/// Values at cosines, straight between, normalised.
#[derive(Clone, Debug, PartialEq)]
pub struct PhaseTable {
    // Invariant: rising from −1 to 1; values ≥ 0, not all 0; cumulative from 0 to 1.
    cosines: Vec<f64>,
    values: Vec<f64>,
    cumulative: Vec<f64>,
}

/// |g| below which the map of Henyey and Greenstein is its series.
const NEARLY_ISOTROPIC: f64 = 1e-3;
/// Most entries of a mixture.
const MOST_PARTS: usize = 16;
/// Most rows of a table.
const MOST_ROWS: usize = 1 << 16;

impl PhaseTable {
    /// From rows of a cosine and a value of any scale.
    ///
    /// # Errors
    /// When the cosines do not rise from −1 to 1, or a value is negative or all are 0.
    pub fn new(rows: &[(f64, f64)]) -> Result<Self> {
        let refuse = |found: String| {
            let expected = "rows [cosine, value], cosines rising from -1 to 1, values not negative and not all 0";
            Err(Error::argument("phase.table", found, expected, "write table = [[-1, 0.2], [1, 3]]"))
        };
        let (Some(first), Some(last)) = (rows.first(), rows.last()) else { return refuse("no row".into()) };
        if rows.len() > MOST_ROWS || first.0 != -1.0 || last.0 != 1.0 || rows.len() < 2 {
            return refuse(format!("{} rows from {} to {}", rows.len(), first.0, last.0));
        }
        if let Some(pair) = rows.windows(2).find(|pair| pair[1].0 <= pair[0].0 || !pair[1].0.is_finite()) {
            return refuse(format!("{} after {}", pair[1].0, pair[0].0));
        }
        if let Some((c, v)) = rows.iter().find(|(_, v)| !(v.is_finite() && *v >= 0.0)) {
            return refuse(format!("{v} at {c}"));
        }
        let mut cumulative = vec![0.0];
        for pair in rows.windows(2) {
            let mass = 0.5 * (pair[0].1 + pair[1].1) * (pair[1].0 - pair[0].0);
            cumulative.push(cumulative[cumulative.len() - 1] + mass);
        }
        let whole = cumulative[cumulative.len() - 1];
        if !(whole > 0.0 && whole.is_finite()) {
            return refuse("values that are all 0".into());
        }
        cumulative.iter_mut().for_each(|m| *m /= whole);
        Ok(Self {
            cosines: rows.iter().map(|r| r.0).collect(),
            values: rows.iter().map(|r| r.1 / (2.0 * PI * whole)).collect(),
            cumulative,
        })
    }

    /// The interval of a cosine.
    fn interval(&self, cosine: f64) -> usize {
        self.cosines.partition_point(|c| *c <= cosine).clamp(1, self.cosines.len() - 1) - 1
    }

    fn slope(&self, j: usize) -> f64 {
        (self.values[j + 1] - self.values[j]) / (self.cosines[j + 1] - self.cosines[j])
    }

    fn value(&self, cosine: f64) -> f64 {
        let j = self.interval(cosine);
        (self.values[j] + self.slope(j) * (cosine - self.cosines[j])).max(0.0)
    }

    fn cosine(&self, u: f64) -> f64 {
        let j = self.cumulative.partition_point(|m| *m <= u).clamp(1, self.cosines.len() - 1) - 1;
        // ∫ v dc up to there, of which 2π is the whole.
        let rest = ((u - self.cumulative[j]) / (2.0 * PI)).max(0.0);
        let v = self.values[j];
        let root = v + (v * v + 2.0 * self.slope(j) * rest).max(0.0).sqrt();
        let step = if root > 0.0 { 2.0 * rest / root } else { 0.0 };
        (self.cosines[j] + step).min(self.cosines[j + 1])
    }

    fn variate(&self, cosine: f64) -> f64 {
        let j = self.interval(cosine);
        let step = cosine - self.cosines[j];
        self.cumulative[j] + 2.0 * PI * step * (self.values[j] + 0.5 * self.slope(j) * step)
    }
}

impl Phase {
    /// The phase function of Schlick whose mean cosine is g, by Newton's method on g₁(k) = 1/k − (1 − k²)/(2k²) ln((1+k)/(1−k)).
    /// (The common k = 1.55 g − 0.55 g³ misses it by up to 14 % and leaves the range beyond g = 0.9381.)
    ///
    /// # Errors
    /// When |g| is not below 1.
    pub fn schlick_of(mean_cosine: f64) -> Result<Self> {
        Self::HenyeyGreenstein(mean_cosine).check()?;
        let (mut low, mut high) = (-1.0, 1.0);
        let mut k = mean_cosine;
        // The slope lies between 2/3 and ∞: a bracket keeps the steps inside.
        for _ in 0..200 {
            let excess = schlick_mean(k) - mean_cosine;
            if excess > 0.0 {
                high = k
            } else {
                low = k
            }
            let d = 1e-6 * (1.0 - k.abs());
            let slope = (schlick_mean(k + d) - schlick_mean(k - d)) / (2.0 * d);
            let next = k - excess / slope;
            let next = if next > low && next < high { next } else { 0.5 * (low + high) };
            if (next - k).abs() < 1e-15 {
                break;
            }
            k = next;
        }
        Ok(Self::Schlick(k))
    }

    /// Whether it is a phase function.
    ///
    /// # Errors
    /// When |g| or |k| is not below 1, or shares are negative or do not sum to 1.
    #[doc(hidden)]
    pub fn check(&self) -> Result<()> {
        match self {
            Self::Isotropic | Self::Rayleigh | Self::Table(_) => Ok(()),
            Self::HenyeyGreenstein(g) if g.abs() < 1.0 => Ok(()),
            Self::Schlick(k) if k.abs() < 1.0 => Ok(()),
            Self::HenyeyGreenstein(v) | Self::Schlick(v) => {
                let remedy = "0 scatters alike in all directions, 0.8 mostly forward";
                Err(Error::argument("phase", v, "a number between -1 and 1, both left out", remedy))
            }
            Self::Mixture(parts) => {
                let sum: f64 = parts.iter().map(|(share, _)| *share).sum();
                let legal =
                    !parts.is_empty() && parts.len() <= MOST_PARTS && parts.iter().all(|(share, _)| *share >= 0.0);
                if !(legal && (sum - 1.0).abs() <= 1e-6) {
                    let expected = format!("up to {MOST_PARTS} shares that are not negative and sum to 1");
                    let found = format!("{} shares that sum to {sum}", parts.len());
                    return Err(Error::argument(
                        "phase.mix",
                        found,
                        expected,
                        "write mix = [[0.7, { hg = 0.8 }], [0.3, { hg = -0.2 }]]",
                    ));
                }
                if parts.iter().any(|(_, part)| matches!(part, Self::Mixture(_))) {
                    let remedy = "write the parts of the inner one in the outer one";
                    return Err(Error::argument("phase.mix", "a mixture in a mixture", "phase functions", remedy));
                }
                parts.iter().try_for_each(|(_, part)| part.check())
            }
        }
    }

    /// Density per steradian of a turn by a cosine.
    #[doc(hidden)]
    pub fn density(&self, cosine: f64) -> f64 {
        match self {
            Self::Isotropic => 1.0 / (4.0 * PI),
            Self::HenyeyGreenstein(g) => {
                let square = (1.0 + g * g - 2.0 * g * cosine).max(f64::MIN_POSITIVE);
                (1.0 - g * g) / (4.0 * PI * square * square.sqrt())
            }
            Self::Schlick(k) => {
                let d = 1.0 - k * cosine;
                (1.0 - k * k) / (4.0 * PI * d * d)
            }
            Self::Rayleigh => 3.0 * (1.0 + cosine * cosine) / (16.0 * PI),
            Self::Table(table) => table.value(cosine),
            Self::Mixture(parts) => parts.iter().map(|(share, part)| share * part.density(cosine)).sum(),
        }
    }

    /// The cosine of a variate in [0, 1).
    #[doc(hidden)]
    pub fn cosine(&self, u: f64) -> f64 {
        let cosine = match self {
            Self::Isotropic => 2.0 * u - 1.0,
            Self::HenyeyGreenstein(g) if g.abs() < NEARLY_ISOTROPIC => {
                let s = 2.0 * u - 1.0;
                s + 1.5 * g * (1.0 - s * s)
            }
            Self::HenyeyGreenstein(g) => {
                let q = (1.0 - g * g) / (1.0 - g + 2.0 * g * u);
                (1.0 + g * g - q * q) / (2.0 * g)
            }
            Self::Schlick(k) => {
                let s = 2.0 * u - 1.0;
                (s + k) / (1.0 + k * s)
            }
            Self::Rayleigh => {
                let q = 4.0 * u - 2.0;
                let a = libm::cbrt(q + (q * q + 1.0).sqrt());
                a - 1.0 / a
            }
            Self::Table(table) => table.cosine(u),
            Self::Mixture(parts) => {
                let mut rest = u;
                for (i, (share, part)) in parts.iter().enumerate() {
                    if rest < *share || i + 1 == parts.len() {
                        return part.cosine(if *share > 0.0 {
                            (rest / share).clamp(0.0, 1.0 - f64::EPSILON)
                        } else {
                            0.5
                        });
                    }
                    rest -= share;
                }
                0.0
            }
        };
        cosine.clamp(-1.0, 1.0)
    }

    /// The variate of a cosine: the inverse of [`Self::cosine`]. `None` for mixtures, which have none.
    #[doc(hidden)]
    pub fn variate(&self, cosine: f64) -> Option<f64> {
        Some(match self {
            Self::Isotropic => 0.5 * (cosine + 1.0),
            Self::HenyeyGreenstein(g) if g.abs() < NEARLY_ISOTROPIC => {
                // s + 1.5 g (1 − s²) = c, solved to the first order as the map is.
                let s = cosine - 1.5 * g * (1.0 - cosine * cosine);
                0.5 * (s + 1.0)
            }
            Self::HenyeyGreenstein(g) => {
                let q = (1.0 + g * g - 2.0 * g * cosine).max(0.0).sqrt();
                ((1.0 - g * g) / q - (1.0 - g)) / (2.0 * g)
            }
            Self::Schlick(k) => 0.5 * (1.0 + (cosine - k) / (1.0 - k * cosine)),
            Self::Rayleigh => (cosine * cosine * cosine + 3.0 * cosine + 4.0) / 8.0,
            Self::Table(table) => table.variate(cosine),
            Self::Mixture(_) => return None,
        })
    }

    /// Mean cosine: the moment g₁.
    pub fn mean_cosine(&self) -> f64 {
        match self {
            Self::Isotropic | Self::Rayleigh => 0.0,
            Self::HenyeyGreenstein(g) => *g,
            Self::Schlick(k) => schlick_mean(*k),
            Self::Table(table) => {
                let part = |j: usize| {
                    let (a, b) = (table.cosines[j], table.cosines[j + 1]);
                    let (v, m) = (table.values[j] - table.slope(j) * a, table.slope(j));
                    0.5 * v * (b * b - a * a) + m * (b * b * b - a * a * a) / 3.0
                };
                2.0 * PI * (0..table.cosines.len() - 1).map(part).sum::<f64>()
            }
            Self::Mixture(parts) => parts.iter().map(|(share, part)| share * part.mean_cosine()).sum(),
        }
    }
}

/// Mean cosine of Schlick's phase function.
fn schlick_mean(k: f64) -> f64 {
    if k.abs() < 0.02 {
        // The next terms are 2k⁵/35 and less.
        return k * (2.0 / 3.0 + k * k * (2.0 / 15.0 + k * k * 2.0 / 35.0));
    }
    1.0 / k - (1.0 - k * k) / (2.0 * k * k) * libm::log((1.0 + k) / (1.0 - k))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::PathSampler;
    use crate::sampling::statistics::chi_square_test;

    fn all() -> Vec<Phase> {
        let table = PhaseTable::new(&[(-1.0, 0.2), (-0.3, 0.0), (0.4, 1.0), (1.0, 3.0)]).expect("a table");
        vec![
            Phase::Isotropic,
            Phase::HenyeyGreenstein(0.6),
            Phase::HenyeyGreenstein(-0.35),
            Phase::HenyeyGreenstein(5e-4),
            Phase::Schlick(0.5),
            Phase::Schlick(-0.9),
            Phase::Rayleigh,
            Phase::Table(table.clone()),
            Phase::Mixture(vec![(0.7, Phase::HenyeyGreenstein(0.8)), (0.3, Phase::Table(table))]),
        ]
    }

    /// By Simpson's rule in the variate's own intervals: 2π ∫ p f dc.
    fn integral(phase: &Phase, f: impl Fn(f64) -> f64) -> f64 {
        let n = 20_000;
        let at = |i: usize| -1.0 + 2.0 * i as f64 / n as f64;
        let value = |i: usize| phase.density(at(i)) * f(at(i));
        let sum: f64 = (0..=n)
            .map(|i| {
                value(i)
                    * if i == 0 || i == n {
                        1.0
                    } else if i % 2 == 1 {
                        4.0
                    } else {
                        2.0
                    }
            })
            .sum();
        2.0 * PI * sum * (2.0 / n as f64) / 3.0
    }

    #[test]
    fn densities_are_normalised_and_have_their_mean_cosines() {
        for phase in all() {
            phase.check().expect("a phase function");
            // Kinks of the table are where Simpson's rule is of first order: h² times the jump of the slope.
            assert!((integral(&phase, |_| 1.0) - 1.0).abs() < 1e-7, "{phase:?}");
            assert!((integral(&phase, |c| c) - phase.mean_cosine()).abs() < 1e-7, "{phase:?}");
        }
        let rayleigh = integral(&Phase::Rayleigh, |c| 0.5 * (3.0 * c * c - 1.0));
        assert!((rayleigh - 0.1).abs() < 1e-12, "{rayleigh}");
        let hg = integral(&Phase::HenyeyGreenstein(0.6), |c| 0.5 * (3.0 * c * c - 1.0));
        assert!((hg - 0.36).abs() < 1e-7, "{hg}");
    }

    #[test]
    fn schlick_is_not_henyey_and_greenstein() {
        for (k, g) in [(0.2, 0.134419), (0.5, 0.352082), (0.8, 0.632031), (0.9, 0.765776)] {
            assert!((Phase::Schlick(k).mean_cosine() - g).abs() < 5e-7);
        }
        for (g, k) in
            [(0.2, 0.294682), (0.5, 0.672971), (0.8, 0.920820), (0.9, 0.970201), (0.99, f64::NAN), (-0.5, -0.672971)]
        {
            let Ok(Phase::Schlick(found)) = Phase::schlick_of(g) else { panic!("no k of {g}") };
            assert!((schlick_mean(found) - g).abs() < 1e-12, "{g} {found}");
            assert!(k.is_nan() || (found - k).abs() < 5e-7, "{g} {found}");
        }
        for wrong in [1.0, -1.0, 1.5, f64::NAN] {
            assert!(Phase::Schlick(wrong).check().is_err() && Phase::schlick_of(wrong).is_err());
        }
    }

    #[test]
    fn cosines_follow_their_densities() {
        const BINS: usize = 40;
        const COUNT: u32 = 1 << 16;
        for phase in all() {
            let sampler = PathSampler::new(7, 3, 0);
            let mut observed = vec![0.0; BINS];
            for i in 0..COUNT {
                // Half of each pair, of pairs far apart: independent up to scrambling.
                let u = f64::from(sampler.pair(0, 2 * i)[0]);
                let c = phase.cosine(u);
                observed[(((c + 1.0) * 0.5 * BINS as f64) as usize).min(BINS - 1)] += 1.0;
                if let Some(back) = phase.variate(c) {
                    assert!((back - u).abs() < 2e-6, "{phase:?}: {u} gives {c}, and that {back}");
                }
            }
            let mass = |bin: usize| {
                let n = 200;
                let at = |i: usize| -1.0 + 2.0 * (bin as f64 + i as f64 / n as f64) / BINS as f64;
                let value = |i: usize| phase.density(at(i)) * if i == 0 || i == n { 0.5 } else { 1.0 };
                2.0 * PI * (0..=n).map(value).sum::<f64>() * 2.0 / (BINS * n) as f64
            };
            let expected: Vec<f64> = (0..BINS).map(|bin| f64::from(COUNT) * mass(bin)).collect();
            let test = chi_square_test(&observed, &expected);
            // One of nine tests.
            assert!(test.p > 0.001 / 9.0, "{phase:?}: {test:?}");
        }
    }

    #[test]
    fn what_is_no_phase_function_is_refused() {
        for rows in [
            &[][..],
            &[(-1.0, 1.0)],
            &[(-1.0, 1.0), (0.5, 1.0)],
            &[(-1.0, 0.0), (1.0, 0.0)],
            &[(-1.0, 1.0), (1.0, -1.0)],
        ] {
            assert!(PhaseTable::new(rows).is_err(), "{rows:?}");
        }
        let hg = Phase::HenyeyGreenstein(0.5);
        let nested = Phase::Mixture(vec![(1.0, hg.clone())]);
        for mixture in
            [vec![], vec![(0.5, hg.clone())], vec![(1.5, hg.clone()), (-0.5, hg.clone())], vec![(1.0, nested)]]
        {
            assert!(Phase::Mixture(mixture).check().is_err());
        }
    }
}
