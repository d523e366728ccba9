//! Numbers that carry derivatives: the formulas of this module are written once, for [`Scalar`], and give the value alone
//! (`f64`), the value with its gradient ([`Dual`]) or with its Hessian too ([`Jet`]).
//!
//! The value of all three has the same bits: derivatives are computed beside it, never instead of it. Where a function
//! has a kink the derivative is that of the winner, and 0 at the tip of a root.

use glam::DVec3;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A point whose coordinates may carry derivatives.
pub type Point<S> = [S; 3];

/// A number of the evaluator.
pub trait Scalar:
    Copy
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// The number with one more order of derivatives.
    type Higher: Scalar;

    /// A constant.
    fn of(value: f64) -> Self;

    /// The value alone.
    fn value(self) -> f64;

    /// A function of this number from its value and its first and second derivative here, made where they are needed.
    fn chain(self, value: f64, derivatives: impl FnOnce() -> [f64; 2]) -> Self;

    /// This number as a point of which the derivatives are not known: as a function of the coordinates `at` it has the value,
    /// gradient and Hessian of `higher`, evaluated at the values of `at`.
    fn composed(higher: Self::Higher, at: Point<Self>) -> Self;

    /// The first derivatives along x, y, z of a number with one order more, as functions of the coordinates `at`.
    fn slopes(higher: Self::Higher, at: Point<Self>) -> Point<Self>;

    /// The coordinates of a point as what derivatives are taken of.
    fn variables(point: DVec3) -> Point<Self>;

    /// Times a constant.
    fn scaled(self, factor: f64) -> Self {
        self * Self::of(factor)
    }

    /// Plus a constant.
    fn plus(self, constant: f64) -> Self {
        self + Self::of(constant)
    }

    /// Its square.
    fn squared(self) -> Self {
        self * self
    }

    /// Its square root; the derivative at 0 is 0.
    fn root(self) -> Self {
        let root = self.value().sqrt();
        self.chain(root, || if root > 0.0 { [0.5 / root, -0.25 / (root * root * root)] } else { [0.0; 2] })
    }

    /// The larger of two numbers, the first where they are equal; NaN where either is.
    fn larger(self, other: Self) -> Self {
        if other.value() > self.value() || other.value().is_nan() { other } else { self }
    }

    /// The smaller of two numbers, the first where they are equal; NaN where either is.
    fn smaller(self, other: Self) -> Self {
        if other.value() < self.value() || other.value().is_nan() { other } else { self }
    }

    /// Its magnitude.
    fn magnitude(self) -> Self {
        if self.value() < 0.0 { -self } else { self }
    }

    /// The number within two limits; outside of them it is constant.
    fn clamped(self, low: f64, high: f64) -> Self {
        if self.value() < low {
            Self::of(low)
        } else if self.value() > high {
            Self::of(high)
        } else {
            self
        }
    }

    /// Its sine.
    fn sine(self) -> Self {
        let x = self.value();
        let sine = libm::sin(x);
        self.chain(sine, || [libm::cos(x), -sine])
    }

    /// Its cosine.
    fn cosine(self) -> Self {
        let x = self.value();
        let cosine = libm::cos(x);
        self.chain(cosine, || [-libm::sin(x), -cosine])
    }

    /// e to this power.
    fn exponential(self) -> Self {
        let power = libm::exp(self.value());
        self.chain(power, || [power, power])
    }

    /// The natural logarithm.
    fn logarithm(self) -> Self {
        let x = self.value();
        self.chain(libm::log(x), || [1.0 / x, -1.0 / (x * x)])
    }

    /// The arc tangent.
    fn arc_tangent(self) -> Self {
        let x = self.value();
        let slope = 1.0 / (1.0 + x * x);
        self.chain(libm::atan(x), || [slope, -2.0 * x * slope * slope])
    }

    /// The error function.
    fn error_function(self) -> Self {
        let x = self.value();
        self.chain(libm::erf(x), || {
            let slope = std::f64::consts::FRAC_2_SQRT_PI * libm::exp(-x * x);
            [slope, -2.0 * x * slope]
        })
    }

    /// The angle of the point (`x`, this number), as `atan2`.
    fn angle(self, x: Self) -> Self {
        let angle = libm::atan2(self.value(), x.value());
        // d angle = (x dy − y dx)/r²: of a quotient that is never of a small number by a smaller one.
        let steep = self.value().abs() > x.value().abs();
        let quotient = if steep { -(x / self) } else { self / x };
        let q = quotient.value();
        let slope = 1.0 / (1.0 + q * q);
        quotient.chain(angle, || [slope, -2.0 * q * slope * slope])
    }

    /// A positive number to a constant power: exact for 1, 2, 4 and their inverses; 0 stays 0.
    fn power(self, exponent: f64) -> Self {
        let x = self.value();
        if exponent == 1.0 {
            return self;
        } else if exponent == 2.0 {
            return self.squared();
        } else if exponent == 4.0 {
            return self.squared().squared();
        } else if exponent == 0.5 {
            return self.root();
        } else if exponent == 0.25 {
            return self.root().root();
        }
        self.chain(libm::pow(x, exponent), || {
            if x == 0.0 {
                return [0.0; 2];
            }
            let slope = exponent * libm::pow(x, exponent - 1.0);
            [slope, (exponent - 1.0) * slope / x]
        })
    }
}

/// p·q of a point and constants.
pub fn dot<S: Scalar>(p: Point<S>, q: DVec3) -> S {
    p[0].scaled(q.x) + p[1].scaled(q.y) + p[2].scaled(q.z)
}

/// p − q with constants q.
pub fn minus<S: Scalar>(p: Point<S>, q: DVec3) -> Point<S> {
    [p[0].plus(-q.x), p[1].plus(-q.y), p[2].plus(-q.z)]
}

/// |p|².
pub fn length_squared<S: Scalar>(p: Point<S>) -> S {
    p[0] * p[0] + p[1] * p[1] + p[2] * p[2]
}

/// The values of the coordinates.
pub fn place<S: Scalar>(p: Point<S>) -> DVec3 {
    DVec3::new(p[0].value(), p[1].value(), p[2].value())
}

/// Constants as a point.
pub fn constant<S: Scalar>(p: DVec3) -> Point<S> {
    [S::of(p.x), S::of(p.y), S::of(p.z)]
}

impl Scalar for f64 {
    type Higher = Dual;

    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn value(self) -> f64 {
        self
    }

    #[inline(always)]
    fn chain(self, value: f64, _: impl FnOnce() -> [f64; 2]) -> Self {
        value
    }

    fn composed(higher: Dual, _: Point<Self>) -> Self {
        higher.value
    }

    fn slopes(higher: Dual, _: Point<Self>) -> Point<Self> {
        higher.gradient.to_array()
    }

    fn variables(point: DVec3) -> Point<Self> {
        point.to_array()
    }
}

/// A value with its gradient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual {
    /// f.
    pub value: f64,
    /// ∇f.
    pub gradient: DVec3,
}

impl Scalar for Dual {
    type Higher = Jet;

    #[inline]
    fn of(value: f64) -> Self {
        Self { value, gradient: DVec3::ZERO }
    }

    #[inline]
    fn value(self) -> f64 {
        self.value
    }

    #[inline]
    fn chain(self, value: f64, derivatives: impl FnOnce() -> [f64; 2]) -> Self {
        Self { value, gradient: derivatives()[0] * self.gradient }
    }

    fn composed(higher: Jet, at: Point<Self>) -> Self {
        let g = higher.gradient;
        let gradient = g.x * at[0].gradient + g.y * at[1].gradient + g.z * at[2].gradient;
        Self { value: higher.value, gradient }
    }

    fn slopes(higher: Jet, at: Point<Self>) -> Point<Self> {
        std::array::from_fn(|axis| {
            let row = higher.hessian[axis];
            let gradient = row.x * at[0].gradient + row.y * at[1].gradient + row.z * at[2].gradient;
            Self { value: higher.gradient[axis], gradient }
        })
    }

    fn variables(point: DVec3) -> Point<Self> {
        std::array::from_fn(|axis| Self { value: point[axis], gradient: DVec3::AXES[axis] })
    }
}

impl Add for Dual {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { value: self.value + other.value, gradient: self.gradient + other.gradient }
    }
}

impl Sub for Dual {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self { value: self.value - other.value, gradient: self.gradient - other.gradient }
    }
}

impl Mul for Dual {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let gradient = self.gradient * other.value + other.gradient * self.value;
        Self { value: self.value * other.value, gradient }
    }
}

impl Div for Dual {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        Self { value, gradient: (self.gradient - other.gradient * value) / other.value }
    }
}

impl Neg for Dual {
    type Output = Self;

    fn neg(self) -> Self {
        Self { value: -self.value, gradient: -self.gradient }
    }
}

/// A value with its gradient and the rows of its Hessian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jet {
    /// f.
    pub value: f64,
    /// ∇f.
    pub gradient: DVec3,
    /// Its rows; symmetric.
    pub hessian: [DVec3; 3],
}

fn outer(a: DVec3, b: DVec3) -> [DVec3; 3] {
    [a.x * b, a.y * b, a.z * b]
}

fn rows(f: impl Fn(usize) -> DVec3) -> [DVec3; 3] {
    std::array::from_fn(f)
}

impl Scalar for Jet {
    // No third order: what takes derivatives of its parts is refused below another that does.
    type Higher = Self;

    fn of(value: f64) -> Self {
        Self { value, gradient: DVec3::ZERO, hessian: [DVec3::ZERO; 3] }
    }

    fn value(self) -> f64 {
        self.value
    }

    fn chain(self, value: f64, derivatives: impl FnOnce() -> [f64; 2]) -> Self {
        let [first, second] = derivatives();
        let square = outer(self.gradient, self.gradient);
        let hessian = rows(|i| first * self.hessian[i] + second * square[i]);
        Self { value, gradient: first * self.gradient, hessian }
    }

    fn composed(higher: Self, _: Point<Self>) -> Self {
        higher
    }

    fn slopes(higher: Self, _: Point<Self>) -> Point<Self> {
        std::array::from_fn(|axis| Self::of(higher.gradient[axis]))
    }

    fn variables(point: DVec3) -> Point<Self> {
        std::array::from_fn(|axis| Self { gradient: DVec3::AXES[axis], ..Self::of(point[axis]) })
    }
}

impl Add for Jet {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        let hessian = rows(|i| self.hessian[i] + other.hessian[i]);
        Self { value: self.value + other.value, gradient: self.gradient + other.gradient, hessian }
    }
}

impl Sub for Jet {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Jet {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let (ab, ba) = (outer(self.gradient, other.gradient), outer(other.gradient, self.gradient));
        let hessian = rows(|i| self.hessian[i] * other.value + other.hessian[i] * self.value + ab[i] + ba[i]);
        let gradient = self.gradient * other.value + other.gradient * self.value;
        Self { value: self.value * other.value, gradient, hessian }
    }
}

impl Div for Jet {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        // The value is the quotient itself, as without derivatives.
        let one = 1.0 / other.value;
        let inverse = other.chain(one, || [-one * one, 2.0 * one * one * one]);
        Self { value: self.value / other.value, ..self * inverse }
    }
}

impl Neg for Jet {
    type Output = Self;

    fn neg(self) -> Self {
        Self { value: -self.value, gradient: -self.gradient, hessian: self.hessian.map(|row| -row) }
    }
}
