//! Non-negative by construction and proof: the Gauss-optimal positive kernel of a band limit, and
//! the least of it that a rigorous bound allows.
//!
//! Light cut at a band limit rings below zero, and transfer then makes black, negative spots.
//! Convolution with a kernel K ≥ 0 of the same band limit cures it for any light ≥ 0, at the price
//! of blur. [`certify`] uses only as much of the cure as a proof asks for:
//! * [`gauss_optimal`] is the K of degree L with the least blur, the largest first factor k_1;
//! * [`bounds`] encloses the range of a band-limited function rigorously, from a grid and
//!   Bernstein's inequality;
//! * the factors run from 1 (no window) over K to the constant, and the first on that way for
//!   which the lower bound of every channel is ≥ 0 is taken.

use super::project::{gauss_legendre, legendre};
use super::{Coefficients, MAX_BANDS, basis, index};
use crate::error::{Error, Result};
use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// Factors k_0 = 1, k_1, … of the kernel K(t) = Σ (2l+1)/(4π) k_l P_l(t) that is ≥ 0 on [−1, 1], has
/// `bands` bands, and among all such has the largest k_1.
///
/// Why (Fejér's problem for Legendre weights): K ≥ 0 of degree L integrates exactly under a Gauss
/// rule, so k_1 = ∫tK/∫K is a mean of nodes with weights ≥ 0 and at most the largest node t*; it
/// is reached when K vanishes at all others. For even L = 2n − 2 the nodes are the roots of P_n and
/// K ∝ (P_n(t)/(t − t*))². For odd L = 2n − 1 the rule is Gauss-Radau with the fixed node −1, the
/// nodes are the roots of P_n + P_{n+1}, and K ∝ (1 + t)·Π (t − t_j)² over the other free nodes.
///
/// # Panics
/// When `bands` is not in 1…[`MAX_BANDS`].
pub fn gauss_optimal(bands: usize) -> Vec<f64> {
    assert!((1..=MAX_BANDS).contains(&bands), "{bands} bands; the basis has 1 to {MAX_BANDS}");
    let odd = bands.is_multiple_of(2); // the degree, bands − 1, is odd
    let mut nodes: Vec<f64> = if odd {
        radau_nodes(bands / 2)
    } else {
        gauss_legendre(bands.div_ceil(2)).into_iter().map(|(node, _)| node).collect()
    };
    nodes.pop(); // the largest: where the kernel stands
    let kernel = |t: f64| {
        let squares: f64 = nodes.iter().map(|node| (t - node) * (t - node)).product();
        if odd { (1.0 + t) * squares } else { squares }
    };
    let mut factors = vec![0.0; bands];
    for (t, weight) in gauss_legendre(bands) {
        let p = legendre(bands, t);
        for l in 0..bands {
            factors[l] += weight * kernel(t) * p[l];
        }
    }
    let total = factors[0];
    factors.iter().map(|f| f / total).collect()
}

/// The n roots of (P_n + P_{n+1})/(1 + t), rising: one between each two neighbouring roots of
/// P_{n+1} (the polynomials interlace), found by bisection.
fn radau_nodes(n: usize) -> Vec<f64> {
    let value = |t: f64| {
        let p = legendre(n + 1, t);
        p[n] + p[n + 1]
    };
    let brackets = gauss_legendre(n + 1);
    brackets
        .windows(2)
        .map(|pair| {
            let (mut low, mut high) = (pair[0].0, pair[1].0);
            let rising = value(low) < 0.0;
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if (value(middle) < 0.0) == rising {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            0.5 * (low + high)
        })
        .collect()
}

/// Rows of the grid for each band; doubling it quarters the slack of the bound.
const ROWS_PER_BAND: usize = 48;

fn rows(bands: usize) -> usize {
    ROWS_PER_BAND * bands
}

/// L²h²/4 for degree L and covering radius h of the grid: the share of its range by which a
/// function can reach beyond the values on the grid, on either side; see [`bounds`].
fn slack(bands: usize) -> f64 {
    let degree = (bands - 1) as f64;
    let covering = PI / rows(bands) as f64 * FRAC_1_SQRT_2;
    0.25 * (degree * covering).powi(2)
}

/// Values on the grid: rows at colatitudes π(i+½)/rows, 2·rows columns.
fn on_grid(function: &Coefficients) -> Vec<f64> {
    let (bands, rows) = (function.bands(), rows(function.bands()));
    let columns = 2 * rows;
    let mut values = Vec::with_capacity(rows * columns);
    let waves: Vec<(f64, f64)> = (0..columns)
        .map(|i| 2.0 * PI * (i as f64 + 0.5) / columns as f64)
        .map(|azimuth| (libm::cos(azimuth), libm::sin(azimuth)))
        .collect();
    let mut meridian = vec![0.0; basis::count(bands)];
    for row in 0..rows {
        let colatitude = PI * (row as f64 + 0.5) / rows as f64;
        // At azimuth 0, Y_lm for m ≥ 0 is the latitude part of both Y_lm and Y_l,−m.
        basis::evaluate(bands, [libm::sin(colatitude), 0.0, libm::cos(colatitude)], &mut meridian);
        let (mut even, mut odd) = ([0.0; MAX_BANDS], [0.0; MAX_BANDS]);
        for l in 0..bands {
            for m in 0..=l {
                let latitude = meridian[index(l, m as isize)];
                even[m] += function.values()[index(l, m as isize)] * latitude;
                odd[m] += function.values()[index(l, -(m as isize))] * latitude;
            }
        }
        for &(cosine, sine) in &waves {
            // Horner in e^(iφ): Σ_m Re((even − i odd)_m e^(imφ)).
            let (mut real, mut imaginary) = (0.0, 0.0);
            for m in (1..bands).rev() {
                let (a, b) = (real + even[m], imaginary - odd[m]);
                (real, imaginary) = (a * cosine - b * sine, a * sine + b * cosine);
            }
            values.push(real + even[0]);
        }
    }
    values
}

/// Encloses the range of a function whose least and greatest values on the grid are given.
fn enclose(least: f64, greatest: f64, bands: usize) -> (f64, f64) {
    let slack = slack(bands);
    // The last term covers rounding of sums of some hundred terms of the size of the function.
    let reach = slack * (greatest - least) / (1.0 - 2.0 * slack) + 1e-13 * greatest.abs().max(least.abs());
    (least - reach, greatest + reach)
}

/// Lower and upper bound of the function over the whole sphere, rigorous, at most 0.4 % of its range
/// beyond the true ones.
///
/// On a great circle a function of degree L is a trigonometric polynomial of degree L in the arc, so
/// |f''| ≤ L²·R/2, where R is its range (Bernstein's inequality for f minus the middle of the range).
/// At the global minimum m the gradient vanishes; the nearest grid point, at most h away, therefore
/// has at most m + L²h²R/4, and likewise at the maximum, so that R ≤ (grid range)/(1 − L²h²/2). On
/// the grid h ≤ (row height)/√2.
pub fn bounds(function: &Coefficients) -> (f64, f64) {
    let values = on_grid(function);
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let greatest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    enclose(least, greatest, function.bands())
}

/// A window under which light is proven to be non-negative.
#[derive(Clone, Debug, PartialEq)]
pub struct Certified {
    /// One factor a band, for [`Coefficients::filtered`]; the first is 1.
    pub factors: Vec<f64>,
    /// How far the window goes: 0 none, 1 the whole Gauss-optimal kernel, 2 only the constant
    /// is left. Light that is itself ≥ 0 stays within a few hundredths of 1.
    pub blend: f64,
}

impl Certified {
    fn at(blend: f64, kernel: &[f64]) -> Self {
        let factor = |(l, &k): (usize, &f64)| match l {
            0 => 1.0,
            _ if blend <= 1.0 => (1.0 - blend) + blend * k,
            _ => (2.0 - blend) * k,
        };
        Self { factors: kernel.iter().enumerate().map(factor).collect(), blend }
    }
}

/// The weakest window on the way none → Gauss-optimal kernel → constant that is proven to make every
/// channel ≥ 0 over the whole sphere. One window for all channels, so that hues stay; each band
/// limit at which the light is used needs its own (truncate first).
///
/// # Errors
/// When there is no channel, the channels differ in bands, or one has a negative mean.
pub fn certify(channels: &[Coefficients]) -> Result<Certified> {
    let refuse = |given: String, expected: &str| {
        Err(Error::argument(
            "window certified",
            given,
            expected,
            "use light without negative radiance, or another window",
        ))
    };
    let Some(first) = channels.first() else {
        return refuse("no channel".into(), "at least one channel of light");
    };
    let bands = first.bands();
    let kernel = gauss_optimal(bands);
    let mut blend = 0.0_f64;
    for channel in channels {
        if channel.bands() != bands {
            return refuse(format!("{} and {} bands", bands, channel.bands()), "channels with the same bands");
        }
        let mean = channel.mean();
        if mean < 0.0 {
            return refuse(format!("a channel with mean radiance {mean}"), "light that is nowhere negative");
        }
        // Per channel the windows that pass are all from some blend to 2: the proven floor is
        // concave on [0, 1] and on [1, 2], and ≥ 0 at 2. So the largest first blend serves all.
        blend = blend.max(first_blend(channel, &kernel));
    }
    Ok(Certified::at(blend, &kernel))
}

/// The least blend with a proven floor ≥ 0 for one channel, from above, to 1e-6.
fn first_blend(channel: &Coefficients, kernel: &[f64]) -> f64 {
    let bands = channel.bands();
    let plain = on_grid(channel);
    let blurred = on_grid(&channel.filtered(kernel));
    let mean = channel.mean();
    let passes = |blend: f64| {
        let (mut least, mut greatest) = (f64::INFINITY, f64::NEG_INFINITY);
        for (&p, &b) in plain.iter().zip(&blurred) {
            let value = if blend <= 1.0 { p + blend * (b - p) } else { b + (blend - 1.0) * (mean - b) };
            least = least.min(value);
            greatest = greatest.max(value);
        }
        // At blend 2 exactly, the constant remains, whatever rounding says.
        blend >= 2.0 || enclose(least, greatest, bands).0 >= 0.0
    };
    if passes(0.0) {
        return 0.0;
    }
    let (mut fails, mut holds) = if passes(1.0) { (0.0, 1.0) } else { (1.0, 2.0) };
    while holds - fails > 1e-6 {
        let middle = 0.5 * (fails + holds);
        if passes(middle) {
            holds = middle;
        } else {
            fails = middle;
        }
    }
    holds
}

#[cfg(test)]
mod tests;
