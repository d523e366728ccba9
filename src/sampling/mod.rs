//! Numbers that are pure functions of their index, maps from the unit square in threes, and the
//! statistics that judge them. Knows nothing of volumes, spherical harmonics, threads, the clock.
//!
//! * [`hash`]: counter-based random numbers, a function of (seed, item, sample, dimension).
//! * [`sobol`]: Owen-scrambled Sobol points in padded pairs, for the paths of a texel.
//! * [`warp`]: square → disk, hemisphere, sphere, cone, hemicircle; each map with its density
//!   and its inverse. Numerical code takes variates, never a generator.
//! * [`statistics`]: mean and variance, quantiles, the tests of hypotheses used by tests.
//! * [`DirectionalSource`]: how distant light reaches the solvers.

pub mod hash;
pub mod sobol;
pub mod statistics;
pub mod warp;

pub use sobol::PathSampler;

use crate::geom::Direction;

/// A direction drawn from a [`DirectionalSource`], with what an estimator needs to weigh it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DirectionSample {
    /// Where the light comes from, in world axes: a unit vector that points *to* the light.
    pub direction: Direction,
    /// Radiance from there, linear Rec.709, in the units of the source.
    pub radiance: [f32; 3],
    /// Density of the drawing at `direction`, per steradian; positive and finite.
    pub density: f32,
}

/// Distant light, as the solvers see it: they know directions, radiance and densities, never
/// images or coefficients.
///
/// The three methods describe one density: [`sample`](Self::sample) draws from it and
/// [`density`](Self::density) tells its value anywhere, so that a solver can weigh draws of
/// several techniques against each other (Veach 1997, ch. 9). Wherever
/// [`radiance`](Self::radiance) is not black the density must be positive, else estimates that
/// only draw from the source are biased.
pub trait DirectionalSource: Sync {
    /// Draws a direction from two variates in [0, 1); `None` when the source is black.
    fn sample(&self, u: [f32; 2]) -> Option<DirectionSample>;

    /// Density per steradian with which [`sample`](Self::sample) draws `direction` (in world axes).
    fn density(&self, direction: Direction) -> f32;

    /// Radiance that arrives from `direction` (in world axes, pointing to the light).
    fn radiance(&self, direction: Direction) -> [f32; 3];
}
