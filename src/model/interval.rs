//! Ranges that a field may have in a box. They may be wider than the truth, never narrower: what is pruned for them must
//! not be able to matter. Rounding is covered by [`Interval::widened`], whose margin is far above what a formula of a few
//! dozen operations accumulates.

use std::ops::{Add, Mul, Neg, Sub};

/// From `low` to `high`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Nothing is below.
    pub low: f64,
    /// Nothing is above.
    pub high: f64,
}

/// Relative margin for rounding.
const MARGIN: f64 = 1e-11;

impl Interval {
    /// All numbers, and NaN.
    pub const ALL: Self = Self { low: f64::NEG_INFINITY, high: f64::INFINITY };

    /// Between two limits; all numbers where one is NaN.
    pub fn new(low: f64, high: f64) -> Self {
        if low <= high { Self { low, high } } else { Self::ALL }
    }

    /// One number.
    pub fn at(value: f64) -> Self {
        Self::new(value, value)
    }

    /// With a margin for rounding.
    #[must_use]
    pub fn widened(self) -> Self {
        let margin = MARGIN * self.low.abs().max(self.high.abs());
        // Infinite ends: ∞ − ∞ is NaN.
        let low = if self.low.is_finite() { self.low - margin } else { self.low };
        let high = if self.high.is_finite() { self.high + margin } else { self.high };
        Self::new(low, high)
    }

    /// With an absolute margin.
    #[must_use]
    pub fn around(self, margin: f64) -> Self {
        Self::new(self.low - margin, self.high + margin)
    }

    /// The range of squares.
    #[must_use]
    pub fn squared(self) -> Self {
        let (low, high) = (self.low.abs(), self.high.abs());
        let least = if self.low <= 0.0 && self.high >= 0.0 { 0.0 } else { low.min(high) };
        Self::new(least * least, low.max(high) * low.max(high))
    }

    /// The range of magnitudes.
    #[must_use]
    pub fn magnitude(self) -> Self {
        let (low, high) = (self.low.abs(), self.high.abs());
        let least = if self.low <= 0.0 && self.high >= 0.0 { 0.0 } else { low.min(high) };
        Self::new(least, low.max(high))
    }

    /// The range of the larger of two.
    #[must_use]
    pub fn larger(self, other: Self) -> Self {
        Self::new(self.low.max(other.low), self.high.max(other.high))
    }

    /// The range of the smaller of two.
    #[must_use]
    pub fn smaller(self, other: Self) -> Self {
        Self::new(self.low.min(other.low), self.high.min(other.high))
    }

    /// Whether it holds a number.
    pub fn holds(self, value: f64) -> bool {
        self.low <= value && value <= self.high
    }
}

impl Add for Interval {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self::new(self.low + other.low, self.high + other.high)
    }
}

impl Add<f64> for Interval {
    type Output = Self;

    fn add(self, other: f64) -> Self {
        Self::new(self.low + other, self.high + other)
    }
}

impl Sub<f64> for Interval {
    type Output = Self;

    fn sub(self, other: f64) -> Self {
        self + -other
    }
}

impl Sub for Interval {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Neg for Interval {
    type Output = Self;

    fn neg(self) -> Self {
        Self::new(-self.high, -self.low)
    }
}

impl Mul for Interval {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let all = [self.low * other.low, self.low * other.high, self.high * other.low, self.high * other.high];
        if all.iter().any(|v| v.is_nan()) {
            return Self::ALL;
        }
        Self::new(
            all.iter().copied().fold(f64::INFINITY, f64::min),
            all.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        )
    }
}
