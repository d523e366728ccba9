//! How uncertain a texel is in the layers that paths reach after hits.
//!
//! Four replicates of what few paths do are a poor witness. Where none of a texel's paths escaped after its third hit they
//! state no error at all, and where one did by chance they state more than where none did: the error is small just
//! where the estimate is too small. (By them 95 % intervals of a_1, a_2, a_3 cover 74, 68, 65 % of the texels at 16 paths and
//! 82, 78, 76 % at 64.) Their mean is right, so only what chance does to them is taken out.
//!
//! With N paths, of which L_k arrive at their k-th hit and E_k escape from there, a_k is a share of the paths, and its variance
//! at most u(a) = a (1 − a)/N, what independent paths have; strata make it less. So what the replicates see, s²,
//! counts relative to u at the a_k = E_k/N that *these* paths found, and is applied to u at an expected a_k, which owes little to
//! the number that happened to escape:
//!
//! σ² = u(ã_k) (s² + κ/N²)/(u(E_k/N) + κ/N²).
//!
//! κ takes the place of paths where E_k is small or 0, and there σ² is u(ã_k). The expectation follows the paths from hit to hit:
//! ã_k N = (L_1 + λ) t_1 … t_{k−1} p_k, where p_k = (E_k + m p)/(L_k + m) and t_k = (L_{k+1} + m t)/(L_k + m) are the
//! shares of those at hit k that escape and that hit again, drawn towards the shares p and t of all hits of the texel. λ is what
//! no path found: a texel of which N paths hit nothing may still be hit by the next.
//!
//! # What the control variate changes
//! In band 0 nothing, since Y_00 − A_00 = 0. In the others a path at a hit adds (V − p) Y + p A(n) in place of V Y, which has a
//! share r_l = (1 − p + p A_l²)/(1 − p L_k/N) of the variance per coefficient, with A_l the factor of the clamped cosine
//! over π. So the nine coefficients of bands 0 to 2 together estimate σ² (1 + 3 r_1 + 5 r_2)/9.
//!
//! The three constants were chosen on seven volumes for intervals that cover 93 to 97 % of the texels at 16, 64 and
//! 256 paths, and errors whose root mean square is that of the true ones: `probes/record/2026-11-29-xeon-2core-hits`.

use crate::sampling::statistics::POOLED_BANDS;
use crate::sh;
use crate::transfer::MAX_LAYERS;
use std::f64::consts::PI;

/// κ. With 1 and with 3 the covered shares differ by less than 1 %.
const INSTEAD_OF_FEW: f64 = 2.0;
/// λ. With 0.1 intervals of a_1 cover 2 % less at 16 paths; with 0.5 those of the bump box, where next to nothing is
/// hidden, are 1.2 times as wide.
const UNSEEN_PATHS: f64 = 0.3;
/// m. With 16 intervals of a_3 cover more than 99 % at 16 paths on three of eight volumes; with 2 those of a_2 less than
/// 91 % on one.
const PATHS_OF_ALL_HITS: f64 = 3.0;

/// The paths of a texel, over all replicates.
pub(super) struct Paths {
    /// Layers to which a path adds one direction where it ends.
    pub(super) events: usize,
    /// How many there are.
    pub(super) count: f64,
    /// How many were on their way to layer k: a number of paths, or the sum of their weights.
    pub(super) arrived: [f64; MAX_LAYERS],
    /// Whether rays from hits have a control variate.
    pub(super) controlled: bool,
}

impl Paths {
    /// Paths of which each replicate's mean is all that is known.
    pub(super) fn unknown() -> Self {
        Self { events: 0, count: 1.0, arrived: [0.0; MAX_LAYERS], controlled: false }
    }

    /// From the spread of the replicates, summed over the orders of each layer and band, to the variance of one coefficient.
    /// `escaped`: a_k of each layer.
    pub(super) fn variances(
        &self,
        bands: &[usize],
        escaped: &[f64; MAX_LAYERS],
        squares: &mut [[f64; sh::MAX_BANDS]; MAX_LAYERS],
    ) {
        let events = self.events.min(bands.len());
        let hits = Hits::of(self, events, escaped);
        let order = |l: usize| (2 * l + 1) as f64;
        for (k, (&bands, squares)) in bands.iter().zip(squares).enumerate() {
            let all = *squares;
            let sums = |from: usize, to: usize| all[from..to].iter().sum::<f64>();
            let pooled = bands.min(POOLED_BANDS);
            for l in 0..bands {
                squares[l] = all[l] / order(l);
            }
            if k >= events {
                continue;
            }
            if k == 0 {
                squares[0] = sums(0, pooled) / (pooled * pooled) as f64;
                continue;
            }
            let independent = |a: f64| a * (1.0 - a) / (4.0 * PI * self.count);
            let few = INSTEAD_OF_FEW / (4.0 * PI * self.count * self.count);
            let scale = independent(hits.expected[k]) / (independent(escaped[k].clamp(0.0, 1.0)) + few);
            let shares: [f64; sh::MAX_BANDS] = std::array::from_fn(|l| match self.controlled && l > 0 {
                true => {
                    let kept = (sh::CLAMPED_COSINE[l] / PI).powi(2);
                    (1.0 - hits.share + hits.share * kept) / (1.0 - hits.share * self.arrived[k] / self.count)
                }
                false => 1.0,
            });
            for l in 0..bands {
                let range = if l == 0 { 0..pooled } else { l..l + 1 };
                let weight: f64 = range.clone().map(|l| order(l) * shares[l]).sum();
                squares[l] = shares[l] * scale * (sums(range.start, range.end) / weight + few);
            }
        }
    }
}

/// What all hits of a texel's paths tell of each.
struct Hits {
    /// p.
    share: f64,
    /// ã_k.
    expected: [f64; MAX_LAYERS],
}

impl Hits {
    fn of(paths: &Paths, layers: usize, escaped: &[f64; MAX_LAYERS]) -> Self {
        let arrived = &paths.arrived[..layers];
        let from = |k: usize| escaped[k] * paths.count;
        // As often as not where there are no hits.
        let share_of = |some: f64, all: f64| (some + 1.0) / (all + 2.0);
        let sum = |first: usize, end: usize| arrived.get(first..end).map_or(0.0, |part| part.iter().sum::<f64>());
        let share = share_of((1..layers).map(from).sum(), sum(1, layers));
        let again = share_of(sum(2, layers), sum(1, layers.saturating_sub(1)));
        let mut expected = [0.0; MAX_LAYERS];
        let mut reach = arrived.get(1).map_or(0.0, |hit| hit + UNSEEN_PATHS);
        for k in 1..layers {
            let all = arrived[k] + PATHS_OF_ALL_HITS;
            expected[k] = (reach * (from(k) + PATHS_OF_ALL_HITS * share) / (all * paths.count)).clamp(0.0, 1.0);
            if let Some(next) = arrived.get(k + 1) {
                reach *= (next + PATHS_OF_ALL_HITS * again) / all;
            }
        }
        Self { share, expected }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paths(count: f64, arrived: &[f64], controlled: bool) -> Paths {
        let mut all = [0.0; MAX_LAYERS];
        all[..arrived.len()].copy_from_slice(arrived);
        Paths { events: arrived.len(), count, arrived: all, controlled }
    }

    fn moderated(paths: &Paths, escaped: &[f64], squares: &[f64]) -> Vec<f64> {
        let mut a = [0.0; MAX_LAYERS];
        a[..escaped.len()].copy_from_slice(escaped);
        let mut all = [[0.0; sh::MAX_BANDS]; MAX_LAYERS];
        for (all, &square) in all.iter_mut().zip(squares) {
            // The same variance in each of the coefficients.
            (0..3).for_each(|l| all[l] = square * (2 * l + 1) as f64);
        }
        paths.variances(&vec![3; escaped.len()], &a, &mut all);
        all.iter().take(escaped.len()).map(|squares| squares[0]).collect()
    }

    /// Nothing was hit: λ paths are expected, of which one half escapes from each hit, with p = t = 1/2.
    #[test]
    fn what_no_path_found_is_not_known() {
        let found = moderated(&paths(16.0, &[16.0, 0.0, 0.0], false), &[1.0, 0.0, 0.0], &[0.0; 3]);
        for (k, expected) in [(1, 0.15 / 16.0), (2, 0.075 / 16.0)] {
            let variance = expected * (1.0 - expected) / 16.0 / (4.0 * PI);
            assert!((found[k] - variance).abs() < 1e-12, "{k}: {} {variance}", found[k]);
        }
        assert_eq!(found[0], 0.0);
    }

    /// Of N paths half are at their first hit and half of those escape from it; then constants and expectation matter as 1/N.
    #[test]
    fn what_many_paths_saw_counts_as_it_is() {
        for (count, tolerance) in [(1e3, 0.02), (1e5, 0.0002)] {
            let arrived = [count, 0.5 * count, 0.25 * count];
            let squares = [1.0, 0.3, 0.2].map(|share| share / count);
            let found = moderated(&paths(count, &arrived, false), &[0.5, 0.25, 0.125], &squares);
            for k in 0..3 {
                assert!(
                    (found[k] / squares[k] - 1.0).abs() < tolerance,
                    "{count}, layer {k}: {}",
                    found[k] / squares[k]
                );
            }
        }
    }

    /// p = 1/2 and q = 1/2: r_1 = (1/2 + 2/9)/(3/4) = 26/27 and r_2 = (1/2 + 1/32)/(3/4) = 17/24.
    #[test]
    fn the_control_variate_makes_higher_bands_speak_for_less() {
        let count = 1e7;
        let arrived = [count, 0.5 * count];
        let [without, with] = [false, true]
            .map(|controlled| moderated(&paths(count, &arrived, controlled), &[0.5, 0.25], &[0.0, 1.0 / count])[1]);
        let expected = 9.0 / (1.0 + 3.0 * 26.0 / 27.0 + 5.0 * 17.0 / 24.0);
        assert!((with / without - expected).abs() < 1e-4, "{} {expected}", with / without);
    }
}
