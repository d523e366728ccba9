//! What a bake will cost and how exact it will be, from a short pilot on the same surface.
//!
//! Time grows with the paths of a texel, t₀ + t₁N. The mean square of the error is that of noise, which falls as a power
//! of N, and a floor that no path lowers: interpolation between texels, and what the layers leave out. The pilot gives
//! two points of each law; the rest is extrapolated.

use super::{References, Study};
use crate::compare::mean_square;
use crate::error::Result;
use crate::sampling::hash::key;
use crate::transfer::{Lattice, Layers, Layout};
use crate::transport::Settings;

/// Exponents of the variance's fall with N that are believed: random points have 1, Owen-scrambled ones on smooth
/// integrands approach 3; measured on the cases of the tests, 1.4 to 1.5.
const EXPONENT: std::ops::RangeInclusive<f64> = 1.0..=2.0;

/// Paths for each texel beyond which no time is spent: the noise of a reference, below what interpolation leaves.
pub const ENOUGH: u32 = 4096;

/// What a pilot found for one texture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pilot {
    /// Paths for each texel in the two bakes of the pilot, the fewer first.
    pub rays: [u32; 2],
    /// Processor seconds that a texel took in each.
    pub seconds_per_texel: [f64; 2],
    /// Accuracy in each.
    pub accuracy: Accuracy,
    /// Texels that the whole needs.
    pub texels: u64,
}

/// The part of a pilot that needs no clock: mean squares of the relit radiance over its squared mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accuracy {
    /// Of the noise, at each number of paths.
    pub noise: [f64; 2],
    /// Of what paths do not lower.
    pub floor: f64,
}

/// What a bake will take and give.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Forecast {
    /// Paths for each texel.
    pub rays: u32,
    /// Processor seconds, of all threads together.
    pub seconds: f64,
    /// RMS of the relit radiance over its mean, under light of the texture's bands.
    pub error: f64,
}

impl Pilot {
    /// The forecast for a number of paths.
    pub fn forecast(&self, rays: u32) -> Forecast {
        let [n0, n1] = self.rays.map(f64::from);
        let [t0, t1] = self.seconds_per_texel;
        let slope = ((t1 - t0) / (n1 - n0)).max(0.0);
        let start = (t0 - slope * n0).max(0.0);
        let n = f64::from(rays);
        let seconds = self.texels as f64 * (start + slope * n);
        Forecast { rays, seconds, error: (self.accuracy.floor + self.noise(n)).sqrt() }
    }

    fn noise(&self, n: f64) -> f64 {
        let [v0, v1] = self.accuracy.noise;
        let [n0, n1] = self.rays.map(f64::from);
        if v1 <= 0.0 {
            return 0.0;
        }
        let exponent = libm::log(v0 / v1) / libm::log(n1 / n0);
        let exponent = exponent.clamp(*EXPONENT.start(), *EXPONENT.end());
        v1 * libm::pow(n1 / n, exponent)
    }

    /// The most paths, as a power of two up to [`ENOUGH`], that take no more than so many processor seconds; `None` if
    /// not even 4 do.
    pub fn most_within(&self, seconds: f64) -> Option<Forecast> {
        (2..=ENOUGH.ilog2()).rev().map(|k| self.forecast(1 << k)).find(|f| f.seconds <= seconds)
    }

    /// The fewest paths, as a power of two, with no more than this error; `None` if none do.
    pub fn least_within(&self, error: f64) -> Option<Forecast> {
        (2..=20).map(|k| self.forecast(1 << k)).find(|f| f.error <= error)
    }
}

impl Study<'_> {
    /// Noise at two numbers of paths, and the floor, of a texture on `lattice` with `layers`.
    ///
    /// # Errors
    /// When the references lack the lattice or the bands; as [`crate::transport::estimates`].
    pub fn accuracy(
        &self,
        references: &References,
        lattice: Lattice,
        layers: &Layers,
        rays: [u32; 2],
    ) -> Result<Accuracy> {
        let layout = Layout { lattice, layers: layers.clone() };
        let basis = self.basis(references, &layout)?;
        let cut = basis.cut();
        let kept = basis.kept(&cut);
        let mut squares = [0.0; 2];
        for (square, n) in squares.iter_mut().zip(rays) {
            let seed = key(self.seed, 0x7069_6c6f_7400 + u64::from(n));
            let settings = Settings { layers: layers.clone(), rays: n, seed, target: None, positive: false };
            let texels = self.texels(&layout, &settings)?;
            *square = mean_square(&basis.radiance(&texels, &cut), &kept);
        }
        // The exact texels have noise of their own, which falls by the same law from the pilot's second bake.
        let [n0, n1] = rays.map(f64::from);
        let law = (libm::log(squares[0] / squares[1]) / libm::log(n1 / n0)).clamp(*EXPONENT.start(), *EXPONENT.end());
        let own = squares[1] * libm::pow(n1 / f64::from(self.texel_rays), law);
        let mean = cut.iter().flatten().sum::<f64>() / (3 * cut.len()) as f64;
        let over = |value: f64| (value / (mean * mean)).max(0.0);
        let floor = mean_square(&kept, &cut) - super::noise(basis.limited) - own;
        Ok(Accuracy { noise: squares.map(|s| over(s - own)), floor: over(floor) })
    }
}
