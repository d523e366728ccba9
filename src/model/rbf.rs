//! Functions through points: f(p) = iso + Σ w_j φ(|p − p_j|) + c₀ + c·p (Savchenko et al. 1995, Carr et al. 2001).

use super::scalar::{Point, Scalar, dot, length_squared, minus};
use crate::error::{Error, Result};
use glam::DVec3;
use nalgebra::{DMatrix, DVector};

/// φ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Radial {
    /// r³, which minimises the third-order energy in space: the default.
    Cubic,
    /// −r: continuous at its centres alone.
    Linear,
    /// r² ln r: the thin plate of the *plane*, which minimises no energy in space.
    ThinPlate,
    /// (1 − r/R)⁴(4r/R + 1) (Wendland 1995): adds sheets at the rim of its support.
    Wendland(f64),
}

/// Most centres: the system is solved densely.
pub const MOST_CENTRES: usize = 3000;

impl Radial {
    fn of<S: Scalar>(self, square: S) -> S {
        match self {
            Self::Cubic => square * square.root(),
            Self::Linear => -square.root(),
            Self::ThinPlate => {
                if square.value() > 0.0 {
                    square * square.logarithm().scaled(0.5)
                } else {
                    S::of(0.0)
                }
            }
            Self::Wendland(reach) => {
                let r = square.root().scaled(1.0 / reach);
                if r.value() < 1.0 {
                    (S::of(1.0) - r).squared().squared() * r.scaled(4.0).plus(1.0)
                } else {
                    S::of(0.0)
                }
            }
        }
    }
}

/// A function through points.
#[derive(Clone, Debug)]
pub struct Rbf {
    centres: Vec<DVec3>,
    weights: Vec<f64>,
    constant: f64,
    slope: DVec3,
    radial: Radial,
    /// An estimate of the condition number of the system in the 1-norm.
    pub condition: f64,
}

impl Rbf {
    /// The function that has given values at points, up to `smoothing` (0: exactly).
    ///
    /// # Errors
    /// When there are too few or too many points, or the system cannot be solved: points that coincide or lie in a plane.
    pub fn through(points: &[(DVec3, f64)], radial: Radial, smoothing: f64) -> Result<Self> {
        let n = points.len();
        if !(4..=MOST_CENTRES).contains(&n) {
            let given = format!("{n} centres");
            let expected = format!("4 to {MOST_CENTRES}");
            return Err(Error::argument("rbf", given, expected, "thin the points out; normals double their number"));
        }
        let phi = |i: usize, j: usize| radial.of((points[i].0 - points[j].0).length_squared());
        // All of these are conditionally positive, −r with its sign: what is added to the diagonal smooths.
        let matrix = DMatrix::from_fn(n + 4, n + 4, |i, j| match (i < n, j < n) {
            (true, true) => phi(i, j) + if i == j { smoothing } else { 0.0 },
            (true, false) => polynomial(points[i].0, j - n),
            (false, true) => polynomial(points[j].0, i - n),
            (false, false) => 0.0,
        });
        let right = DVector::from_fn(n + 4, |i, _| if i < n { points[i].1 } else { 0.0 });
        let norm = matrix.column_iter().map(|c| c.iter().map(|v| v.abs()).sum()).fold(0.0, f64::max);
        let lu = matrix.lu();
        let degenerate = || {
            let expected = "points of which no two coincide and not all lie in a plane";
            Error::argument(
                "rbf",
                format!("{n} centres that give a singular system"),
                expected,
                "move or leave out some",
            )
        };
        let solution = lu.solve(&right).filter(|s| s.iter().all(|v| v.is_finite())).ok_or_else(degenerate)?;
        // Hager 1984: the system is symmetric, so one solver serves both directions.
        let mut x = DVector::from_element(n + 4, 1.0 / (n + 4) as f64);
        let mut inverse = 0.0f64;
        for _ in 0..5 {
            let y = lu.solve(&x).ok_or_else(degenerate)?;
            inverse = inverse.max(y.iter().map(|v| v.abs()).sum());
            let z = lu.solve(&y.map(f64::signum)).ok_or_else(degenerate)?;
            let mut largest = 0;
            for i in 0..z.len() {
                if z[i].abs() > z[largest].abs() {
                    largest = i;
                }
            }
            x = DVector::from_fn(n + 4, |i, _| if i == largest { 1.0 } else { 0.0 });
        }
        let condition = norm * inverse;
        if condition.is_nan() || condition > 1e18 {
            return Err(degenerate());
        }
        Ok(Self {
            centres: points.iter().map(|p| p.0).collect(),
            weights: solution.iter().take(n).copied().collect(),
            constant: solution[n],
            slope: DVec3::new(solution[n + 1], solution[n + 2], solution[n + 3]),
            radial,
            condition,
        })
    }

    /// The value at a point.
    pub fn value<S: Scalar>(&self, p: Point<S>) -> S {
        let mut sum = dot(p, self.slope).plus(self.constant);
        for (centre, weight) in self.centres.iter().zip(&self.weights) {
            sum = sum + self.radial.of(length_squared(minus(p, *centre))).scaled(*weight);
        }
        sum
    }
}

fn polynomial(p: DVec3, term: usize) -> f64 {
    if term == 0 { 1.0 } else { p[term - 1] }
}
