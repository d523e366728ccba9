//! Fall-offs: how the field of a skeleton falls with the distance r, in units of its reach.
//!
//! | name | g(r) for r < 1, 0 beyond | r where g = ½ |
//! |---|---|---|
//! | soft | 1 − (22/9)r² + (17/9)r⁴ − (4/9)r⁶ (Wyvill, McPheeters and Wyvill 1986) | ½ |
//! | metaball | 1 − 3r² up to ⅓, then (3/2)(1 − r)² (Nishimura et al. 1985) | 1 − 1/√3 |
//! | wyvill | (1 − r²)³ | 0.4542020 |
//! | gaussian | e^(−a r²), cut where it is 10⁻⁹ (Blinn 1982) | √(ln 2/a) |
//!
//! All are flat at 0, so that the kink of the distance at the skeleton does not show.

use super::scalar::Scalar;

/// How a field falls with the distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Falloff {
    /// The polynomial of soft objects.
    Soft,
    /// Two parabolas.
    Metaball,
    /// (1 − r²)³.
    Wyvill,
    /// e^(−a r²).
    Gaussian(f64),
}

/// −ln 10⁻⁹, rounded down: a Gaussian is cut where it has fallen so far.
pub const GAUSSIAN_CUT: f64 = 20.7;

impl Falloff {
    /// g from r².
    #[inline(always)]
    pub fn of_square<S: Scalar>(self, square: S) -> S {
        let r = square.value();
        match self {
            Self::Soft => {
                let g =
                    S::of(1.0) + square * (S::of(-22.0 / 9.0) + square * (square.scaled(-4.0 / 9.0).plus(17.0 / 9.0)));
                if r < 1.0 { g } else { S::of(0.0) }
            }
            Self::Metaball => {
                if r <= 1.0 / 9.0 {
                    square.scaled(-3.0).plus(1.0)
                } else if r < 1.0 {
                    (S::of(1.0) - square.root()).squared().scaled(1.5)
                } else {
                    S::of(0.0)
                }
            }
            Self::Wyvill => {
                let one = S::of(1.0) - square;
                let g = one * one * one;
                if r < 1.0 { g } else { S::of(0.0) }
            }
            Self::Gaussian(a) => {
                let exponent = square.scaled(-a);
                if exponent.value() > -GAUSSIAN_CUT { exponent.exponential() } else { S::of(0.0) }
            }
        }
    }

    /// r² from which on g is 0.
    pub fn support_squared(self) -> f64 {
        match self {
            Self::Gaussian(a) => GAUSSIAN_CUT / a,
            _ => 1.0,
        }
    }

    /// The r at which g has a value in (0, 1), by bisection to the last bit; `None` outside of that range, and where a
    /// Gaussian is cut before.
    pub fn radius_at(self, value: f64) -> Option<f64> {
        let reach = self.support_squared().sqrt();
        let lowest = self.of_square(self.support_squared() * (1.0 - 1e-15));
        if !(value > lowest.max(0.0) && value < 1.0) {
            return None;
        }
        let (mut low, mut high) = (0.0, reach);
        // g falls: value(low) > value ≥ value(high).
        for _ in 0..200 {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                break;
            }
            if self.of_square(middle * middle) > value { low = middle } else { high = middle }
        }
        Some(0.5 * (low + high))
    }
}
