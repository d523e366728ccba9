//! Coefficient vectors: a band-limited function on the sphere.

use super::{MAX_BANDS, basis};
use crate::error::{Error, Result};
use glam::DVec3;
use std::ops::{Add, AddAssign, Mul, Sub};

/// A real function on the sphere with `bands` bands, f(ω) = Σ_i `values[i]` Y_i(ω), in the basis
/// and order of [`crate::sh`].
#[derive(Clone, Debug, PartialEq)]
pub struct Coefficients {
    // Invariant: 1 ≤ bands ≤ MAX_BANDS, values.len() = bands², all finite when made by `new`.
    bands: usize,
    values: Vec<f64>,
}

impl Coefficients {
    /// Coefficients as given, index l(l+1)+m.
    ///
    /// # Errors
    /// When `bands` is not in 1…[`MAX_BANDS`], the count is not `bands²`, or a value is not finite.
    pub fn new(bands: usize, values: Vec<f64>) -> Result<Self> {
        if !(1..=MAX_BANDS).contains(&bands) {
            return Err(Error::argument(
                "bands",
                bands,
                format!("1 to {MAX_BANDS}"),
                "5 bands (degree 4) serve most uses",
            ));
        }
        if values.len() != basis::count(bands) {
            return Err(Error::argument(
                "coefficients",
                format!("{} values", values.len()),
                format!("{} values for {bands} bands", basis::count(bands)),
                "give the square of the number of bands",
            ));
        }
        if let Some(at) = values.iter().position(|v| !v.is_finite()) {
            return Err(Error::argument(
                format!("coefficient {at}"),
                values[at],
                "a finite number",
                "remove non-finite values before the projection",
            ));
        }
        Ok(Self { bands, values })
    }

    /// The function 0.
    ///
    /// # Panics
    /// When `bands` is not in 1…[`MAX_BANDS`].
    pub fn zero(bands: usize) -> Self {
        assert!((1..=MAX_BANDS).contains(&bands), "{bands} bands; the basis has 1 to {MAX_BANDS}");
        Self { bands, values: vec![0.0; basis::count(bands)] }
    }

    /// The constant function `value`: one coefficient, value·sqrt(4π).
    ///
    /// # Panics
    /// As [`Coefficients::zero`].
    pub fn constant(bands: usize, value: f64) -> Self {
        let mut constant = Self::zero(bands);
        constant.values[0] = value * (4.0 * std::f64::consts::PI).sqrt();
        constant
    }

    /// What a point light of unit flux at `direction` (a unit vector) projects to: Y_i(direction).
    ///
    /// # Panics
    /// As [`Coefficients::zero`].
    pub fn delta(bands: usize, direction: DVec3) -> Self {
        let mut delta = Self::zero(bands);
        basis::evaluate(bands, direction.to_array(), &mut delta.values);
        delta
    }

    /// Number of bands, l_max + 1.
    pub fn bands(&self) -> usize {
        self.bands
    }

    /// All values, index l(l+1)+m.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// All values, to change; the caller keeps them finite.
    pub fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// The 2l+1 values of degree `l`, order −l first.
    ///
    /// # Panics
    /// When `l` is not below the number of bands.
    pub fn band(&self, l: usize) -> &[f64] {
        &self.values[l * l..(l + 1) * (l + 1)]
    }

    /// The values in single precision.
    pub fn to_f32(&self) -> Vec<f32> {
        self.values.iter().map(|&v| v as f32).collect()
    }

    /// f(ω) at a unit vector.
    pub fn evaluate(&self, direction: DVec3) -> f64 {
        let mut values = [0.0; MAX_BANDS * MAX_BANDS];
        basis::evaluate(self.bands, direction.to_array(), &mut values);
        self.dot(&values[..self.values.len()])
    }

    /// Σ_i `values[i]`·`transfer[i]` over the coefficients that both have, so that a transfer of
    /// fewer (or more) bands meets the light cut to its own band limit. Summed in order of i.
    pub fn dot<T: Copy + Into<f64>>(&self, transfer: &[T]) -> f64 {
        self.values.iter().zip(transfer).map(|(&value, &t)| value * t.into()).sum()
    }

    /// The function without the bands from `bands` on; unchanged when it has no more than that.
    ///
    /// # Panics
    /// When `bands` is 0.
    #[must_use]
    pub fn truncated(&self, bands: usize) -> Self {
        assert!(bands > 0, "no band left");
        let bands = bands.min(self.bands);
        Self { bands, values: self.values[..basis::count(bands)].to_vec() }
    }

    /// The function with at least `bands` bands, the new ones 0.
    ///
    /// # Panics
    /// When `bands` is above [`MAX_BANDS`].
    #[must_use]
    pub fn extended(&self, bands: usize) -> Self {
        let mut wide = Self::zero(bands.max(self.bands));
        wide.values[..self.values.len()].copy_from_slice(&self.values);
        wide
    }

    /// Band l times `factors[l]`: convolution with a zonal kernel. Bands without a factor become 0.
    #[must_use]
    pub fn filtered(&self, factors: &[f64]) -> Self {
        let mut filtered = self.clone();
        for l in 0..self.bands {
            let factor = factors.get(l).copied().unwrap_or(0.0);
            for value in &mut filtered.values[l * l..(l + 1) * (l + 1)] {
                *value *= factor;
            }
        }
        filtered
    }

    /// Energy of degree `l`, Σ_m values²; does not change under rotation.
    ///
    /// # Panics
    /// As [`Coefficients::band`].
    pub fn band_energy(&self, l: usize) -> f64 {
        self.band(l).iter().map(|v| v * v).sum()
    }

    /// ∫ f² dω, the energy of all bands (Parseval).
    pub fn energy(&self) -> f64 {
        (0..self.bands).map(|l| self.band_energy(l)).sum()
    }

    /// Energy of all bands but the constant one.
    pub fn contrast(&self) -> f64 {
        (1..self.bands).map(|l| self.band_energy(l)).sum()
    }

    /// Mean of the function over the sphere.
    pub fn mean(&self) -> f64 {
        self.values[0] / (4.0 * std::f64::consts::PI).sqrt()
    }
}

impl AddAssign<&Coefficients> for Coefficients {
    /// Sum of functions; the result has the bands of the wider one.
    fn add_assign(&mut self, other: &Coefficients) {
        if other.bands > self.bands {
            *self = self.extended(other.bands);
        }
        for (value, more) in self.values.iter_mut().zip(&other.values) {
            *value += more;
        }
    }
}

impl Add for &Coefficients {
    type Output = Coefficients;

    fn add(self, other: Self) -> Coefficients {
        let mut sum = self.clone();
        sum += other;
        sum
    }
}

impl Sub for &Coefficients {
    type Output = Coefficients;

    fn sub(self, other: Self) -> Coefficients {
        self + &(other * -1.0)
    }
}

impl Mul<f64> for &Coefficients {
    type Output = Coefficients;

    fn mul(self, factor: f64) -> Coefficients {
        Coefficients { bands: self.bands, values: self.values.iter().map(|v| v * factor).collect() }
    }
}

#[cfg(test)]
mod tests;
