//! How far the cache has moved the result: a sample of texels traced again by `path`.

use super::super::estimator::{Estimator, estimates_of};
use super::super::path::{Settings, TexelEstimate};
use super::super::summary::Summary;
use super::super::sums::Real;
use super::cache::Cache;
use super::{Stream, stream_seed};
use crate::grid3;
use crate::sampling::hash::uniform;
use crate::sampling::statistics::Running;
use crate::transfer::{BRICK, BRICK_TEXELS, Lattice, Layers};
use rayon::prelude::*;

/// Albedo at which the bias is told, the default of relighting.
pub(super) const ALBEDO: f64 = 0.7;

/// Rays of `path` for each ray of the final gather.
const REFERENCE_RAYS: u32 = 4;

/// The bias of a gather, estimated from a fixed random sample of its valid texels.
///
/// Of A = Σ_k ρ^(k+1) a_k at ρ = 0.7, the radiance under a constant unit environment; in a scene with luminaires of the
/// radiance under these, mean of the channels, without the environment. Each texel of the
/// sample is gathered twice and traced by `path` twice, all with numbers of their own: the two
/// differences d, d' have the same mean, the texel's bias, and independent noise, so that the mean of
/// d·d' is the mean squared bias with no noise in it. What all texels share, the noise of the cache
/// itself, counts as bias here. Standard errors are those of a random sample of texels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bias {
    /// Texels in the sample; 0 when there is nothing to tell (one layer, no valid texel).
    pub texels: u64,
    /// Mean of A by `path` over the sample: what the others are compared with.
    pub ambient: f64,
    /// Mean of gather − path.
    pub mean: f64,
    /// Its standard error.
    pub mean_stderr: f64,
    /// Root mean square of gather − path, the noise of one final gather and of `path` at 4 times its rays
    /// included.
    pub rms_difference: f64,
    /// Its standard error.
    pub rms_difference_stderr: f64,
    /// Mean square of the bias alone; below 0 by chance where there is little of it.
    pub square: f64,
    /// Its standard error.
    pub square_stderr: f64,
}

/// A of one texel: two gathers, two paths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sampled {
    pub gathered: [f64; 2],
    pub traced: [f64; 2],
}

impl Bias {
    /// Statistics of a sample.
    pub(super) fn of(sample: &[Sampled]) -> Self {
        let mut ambient = Running::new();
        let mut difference = Running::new();
        let mut square = Running::new();
        let mut product = Running::new();
        for s in sample {
            let traced = 0.5 * (s.traced[0] + s.traced[1]);
            ambient.push(traced);
            difference.push(0.5 * (s.gathered[0] + s.gathered[1]) - traced);
            square.push((s.gathered[0] - traced).powi(2));
            product.push((s.gathered[0] - s.traced[0]) * (s.gathered[1] - s.traced[1]));
        }
        let rms_difference = square.mean().sqrt();
        Self {
            texels: sample.len() as u64,
            ambient: ambient.mean(),
            mean: difference.mean(),
            mean_stderr: difference.standard_error(),
            rms_difference,
            // d sqrt(q) = dq / (2 sqrt(q)).
            rms_difference_stderr: if rms_difference > 0.0 {
                0.5 * square.standard_error() / rms_difference
            } else {
                0.0
            },
            square: product.mean(),
            square_stderr: product.standard_error(),
        }
    }

    /// Root mean square of the bias alone; 0 when its estimated square is negative.
    pub fn rms(&self) -> f64 {
        self.square.max(0.0).sqrt()
    }

    /// Upper end of the 95 % interval of [`Bias::rms`]: what to print beside it, since an `rms` that noise alone
    /// explains says only that the bias is below this.
    pub fn rms_at_most(&self) -> f64 {
        (self.square.max(0.0) + 1.96 * self.square_stderr).sqrt()
    }

    /// A figure of the bias over the mean radiance; 0 for a black volume.
    pub fn relative(&self, figure: f64) -> f64 {
        if self.ambient > 0.0 { figure / self.ambient } else { 0.0 }
    }
}

/// A = Σ_k ρ^(k+1) a_k of an estimate, mean of its channels.
pub(super) fn ambient<F: Real>(transfer: &[F], layers: &Layers) -> f64 {
    let root_four_pi = 2.0 * std::f64::consts::PI.sqrt();
    let channels = layers.channels();
    let mut power = 1.0;
    let mut sum = 0.0;
    for (k, &bands) in layers.bands().iter().enumerate() {
        power *= ALBEDO;
        let all = (0..channels).map(|c| transfer[layers.offset(k) + c * bands * bands].as_f64());
        sum += power * root_four_pi * (all.sum::<f64>() / channels as f64);
    }
    sum
}

/// Of a texel in a scene: the radiance under its luminaires, whose exponents are given, or where there is none A.
pub(super) fn lit(groups: &[TexelEstimate<f64>], layers: &Layers, exponents: &[i32]) -> f64 {
    if exponents.is_empty() {
        return ambient(&groups[0].transfer, layers);
    }
    let of_luminaire = |(group, &e): (&TexelEstimate<f64>, &i32)| {
        let gains = group.transfer.chunks_exact(3).map(|g| libm::ldexp(g.iter().sum::<f64>() / 3.0, e));
        gains.fold((0.0, ALBEDO), |(sum, power), gain| (sum + power * gain, power * ALBEDO)).0
    };
    groups[2..].iter().zip(exponents).map(of_luminaire).sum()
}

/// A fixed random sample of `count` valid texels (fewer where some are drawn twice), in the order
/// of the cache.
pub(super) fn pick(cache: &Cache, lattice: &Lattice, seed: u64, count: usize) -> Vec<[usize; 3]> {
    let valid = cache.valid().iter().filter(|&&v| v).count() as u64;
    if valid == 0 {
        return Vec::new();
    }
    let item = stream_seed(seed, Stream::Pick);
    // 48 bits: enough to reach every texel.
    let mut ranks: Vec<u64> = (0..count as u32)
        .map(|i| {
            let (high, low) = (f64::from(uniform(seed, item, i, 0)), f64::from(uniform(seed, item, i, 1)));
            (((high + low / f64::from(1 << 24)) * valid as f64) as u64).min(valid - 1)
        })
        .collect();
    ranks.sort_unstable();
    ranks.dedup();
    let mut wanted = ranks.into_iter().peekable();
    let mut picked = Vec::new();
    for (rank, (at, _)) in cache.valid().iter().enumerate().filter(|&(_, &v)| v).enumerate() {
        if wanted.next_if_eq(&(rank as u64)).is_some() {
            let (brick, t) = (cache.bricks()[at / BRICK_TEXELS], at % BRICK_TEXELS);
            let inner = grid3::at([BRICK, BRICK], t);
            picked.push(std::array::from_fn(|a| brick[a] * BRICK + inner[a]));
        }
    }
    debug_assert!(picked.iter().all(|p: &[usize; 3]| (0..3).all(|a| p[a] < lattice.texels()[a])));
    picked
}

/// What is told of a texel, from its estimates.
pub(super) type Figure<'a, F> = dyn Fn(&[TexelEstimate<F>]) -> f64 + Sync + 'a;

/// Settings of the two gathers and of the two path tracers, from those of the final gather.
pub(super) fn settings(settings: &Settings) -> [Settings; 4] {
    let with_seed = |stream, rays| Settings { seed: stream_seed(settings.seed, stream), rays, ..settings.clone() };
    // Together 4 times the rays of the final gather.
    let rays = settings.rays * (REFERENCE_RAYS / 2);
    // The first gather is the one that is stored.
    let second = with_seed(Stream::SecondGather, settings.rays);
    [settings.clone(), second, with_seed(Stream::Reference(0), rays), with_seed(Stream::Reference(1), rays)]
}

/// Gathers and traces the sample by estimators of [`settings`]; with the work that it took.
pub(super) fn sample<E: Estimator>(
    estimators: &[E; 4],
    lattice: &Lattice,
    texels: &[[usize; 3]],
    figure: &Figure<'_, E::Real>,
) -> (Vec<Sampled>, Summary) {
    let [mx, my, _] = lattice.texels();
    let results: Vec<(Option<Sampled>, Summary)> = texels
        .par_iter()
        .map_init(E::Scratch::default, |scratch, &texel| {
            let (mut summary, mut out) = (Summary::default(), estimates_of(&estimators[0]));
            let Some(site) = estimators[0].site(lattice.grid_from_texel(texel)) else { return (None, summary) };
            let item = (grid3::index([mx, my], texel)) as u64;
            let mut told = |i: usize| {
                estimators[i].estimate(&site, item, scratch, &mut summary, &mut out);
                figure(&out)
            };
            let (g0, p0, g1, p1) = (told(0), told(2), told(1), told(3));
            (Some(Sampled { gathered: [g0, g1], traced: [p0, p1] }), summary)
        })
        .collect();
    let (sample, summaries): (Vec<_>, Vec<_>) = results.into_iter().unzip();
    (sample.into_iter().flatten().collect(), work_of(&summaries))
}

/// The work of some texels, without what became of them.
pub(super) fn work_of(summaries: &[Summary]) -> Summary {
    let mut work = Summary::default();
    for summary in summaries {
        work.counts += summary.counts;
        work.scene += summary.scene;
    }
    work.scene.buried = 0;
    work
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_bias_is_told_apart_from_noise() {
        // Bias of texel i is 0.02 ± 0.01 in turn, so its square is 5e-4 in the mean; noise of the
        // gathers is uniform with RMS 0.05, of the paths 0.025.
        let n = 4096;
        let noise = |i: u32, d: u32, rms: f64| (f64::from(uniform(3, 0, i, d)) - 0.5) * 12.0f64.sqrt() * rms;
        let sample: Vec<Sampled> = (0..n)
            .map(|i| {
                let truth = 0.5 + 0.1 * f64::from(uniform(3, 1, i, 0));
                let bias = if i % 2 == 0 { 0.03 } else { 0.01 };
                Sampled {
                    gathered: [0, 1].map(|d| truth + bias + noise(i, d, 0.05)),
                    traced: [2, 3].map(|d| truth + noise(i, d, 0.025)),
                }
            })
            .collect();
        let bias = Bias::of(&sample);
        let within = |found: f64, expected: f64, error: f64| {
            assert!((found - expected).abs() < 4.0 * error, "{found} {expected} ± {error}");
        };
        within(bias.mean, 0.02, bias.mean_stderr);
        within(bias.square, 5e-4, bias.square_stderr);
        assert!(bias.rms() < bias.rms_at_most());
        assert_eq!(bias.relative(bias.ambient), 1.0);
        // Noise in d: one gather, the mean of two paths.
        let expected = (5e-4f64 + 0.05f64.powi(2) + 0.5 * 0.025f64.powi(2)).sqrt();
        within(bias.rms_difference, expected, bias.rms_difference_stderr);
        // And the errors are what the noise says: sd of the mean difference by its parts.
        let sd = (0.5 * 0.05f64.powi(2) + 0.5 * 0.025f64.powi(2) + 1e-4f64).sqrt();
        assert!((bias.mean_stderr * f64::from(n).sqrt() / sd - 1.0).abs() < 0.1);
        assert_eq!(Bias::of(&[]), Bias::default());
    }
}
