//! The default estimator: unbiased path tracing within one level set.
//!
//! A path leaves the texel along a cosine-distributed direction and, at each hit, along a new one.
//! Its throughput without albedo is 1 throughout, so a path that escapes along ω after k bounces adds
//! Y(ω) to layer k and nothing to any other: one path serves all layers. Paths that are still
//! inside after the last layer add nothing.
//!
//! The first direction is drawn about the smoothed normal of the texel, later ones about the normal of the surface that
//! was met ([`LevelField::hit_normal`]).
//!
//! A ray that starts into the solid and does not come out ([`Outcome::Lost`]) is one that the
//! smoothed normal allows and the facet forbids: it meets the surface where it starts. So it counts
//! as a hit of distance 0, and the path goes on from the same place. Taking such rays as black
//! instead loses energy at every bounce: on 8-bit and noisy hemispheres the ambient error is then
//! 1.2 times larger and its bias 1.3 to 1.6 times (`tests/physics/transport_quantised.rs`).
//!
//! Every ray has a control variate: the transfer A(n) of an unoccluded place with the normal n is known, so a ray along ω
//! adds V Y(ω) − β (Y(ω) − A(n)) to its layer, V = 1 if it escapes, for any β that is independent of it. Per ray the
//! best β for all coefficients of a band together is, by the addition theorem, the chance E[V] to escape; the
//! replicate r takes it from the *other* replicates, which keeps the estimate unbiased: for the first rays from
//! theirs, for those from hits from all of theirs together ([`super::control`]). The one at hits takes 10 to
//! 48 % of the error of layers 1 to 3 (`probes/record/2026-11-29-xeon-2core-hits`).

use super::REPLICATES;
use super::control::RayCounts;
use super::sums::{combine_paths, scale_to_clamped_cosine};
use crate::error::{Error, Result};
use crate::geom::{Frame, Normal};
use crate::level::{Counts, Crossing, Hit, LevelField, Outcome, Site, Start};
use crate::sampling::{PathSampler, warp};
use crate::sh;
use crate::transfer::{Layers, MAX_LAYERS};
use crate::volume::Sample;
use glam::Vec3;
use multiversion::multiversion;

/// What an estimator is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Layers and bands.
    pub layers: Layers,
    /// Paths per texel, over all replicates; with a target, the most that a texel may get.
    pub rays: u32,
    /// Seed of all random numbers.
    pub seed: u64,
    /// When to stop before `rays`; `None` traces `rays` paths for every texel.
    pub target: Option<Target>,
    /// No control variate: every coefficient vector is then a non-negative combination of Y(ω), so that
    /// a non-negative environment gives a non-negative result for any noise.
    pub positive: bool,
}

/// A standard error to reach in every texel, of each of some numbers Σ w_i T_i.
///
/// With w = sqrt(4π) at the first coefficient of every layer such a number is Σ_k a_k, the chance to escape within
/// the stored layers; with w = ρ^(k+1) L_i over a mean radiance it is the relative error under that light. So
/// transport meets a target for an environment without knowing one.
///
/// The error of such a number is that of paths that by chance end elsewhere: with v_k the variance of a_k that the
/// texel states, g_k and e_k the mean over the sphere of Σ_i w_i Y_i in layer k and of its square, and
/// C = Σ_{k≥1} g_k a_k/(1 − a_0) what a path that met the surface brings in the mean,
/// σ² = Σ_k v_k (e_k − 2 C g_k + C²). Paths that survive all layers bring nothing and are one layer more. The spread of four
/// replicates, with three degrees of freedom, would let texels stop by luck.
///
/// A texel starts with 16 paths and doubles until it meets the error, or `rays` are spent. What is decided by the
/// paths that make the estimate biases it: texels that seem open stop earlier. Stopping waits for 2/N ≤ error to keep that
/// in the noise (measured: example `measure-adaptive`).
#[derive(Clone, Debug, PartialEq)]
pub struct Target {
    /// One list of weights a number, one weight a coefficient of one channel, layer-major.
    pub weights: Vec<Vec<f32>>,
    /// Of each luminaire one weight a layer, on G_k as it is stored, mean of the channels; the error of their sum joins that
    /// of each number. Empty without luminaires.
    pub luminaires: Vec<Vec<f32>>,
    /// The standard error.
    pub error: f32,
}

impl Target {
    /// A standard error of Σ_k a_k and of a_0, where 1 is an unoccluded texel.
    ///
    /// Not of the sum alone: where all blocked light escapes after one bounce the sum is known to be 1 while its
    /// parts, which an albedo weighs differently, are not known at all.
    pub fn escape(layers: &Layers, error: f32) -> Self {
        let root_four_pi = 2.0 * std::f32::consts::PI.sqrt();
        let (coefficients, channels) = (layers.coefficients() / layers.channels(), layers.channels());
        let mut openness = vec![0.0; coefficients];
        openness[0] = root_four_pi;
        let mut all = vec![0.0; coefficients];
        for k in 0..layers.len() {
            all[layers.offset(k) / channels] = root_four_pi;
        }
        Self { weights: vec![all, openness], luminaires: Vec::new(), error }
    }

    /// A standard error of the radiance under the stored layers, relative to `mean`, of each of some lights: lists
    /// of coefficients in world axes, such as the colour channels of an environment. `mean` has the unit of the
    /// lights; shorter lists end in zeros.
    pub fn radiance(layers: &Layers, lights: &[Vec<f32>], albedo: f32, mean: f32, error: f32) -> Self {
        let weights = lights.iter().map(|light| radiance_weights(layers, light, albedo, mean)).collect();
        Self { weights, luminaires: Vec::new(), error }
    }
}

/// Weights w with Σ w_i T_i = Σ_k ρ^(k+1) ⟨T_k, L⟩ / mean, layer-major, for one channel; the light L in world axes.
pub fn radiance_weights(layers: &Layers, light: &[f32], albedo: f32, mean: f32) -> Vec<f32> {
    let channels = layers.channels();
    let mut weights = vec![0.0; layers.coefficients() / channels];
    let mut factor = albedo / mean;
    for (k, &bands) in layers.bands().iter().enumerate() {
        for (w, l) in weights[layers.offset(k) / channels..].iter_mut().zip(&light[..light.len().min(bands * bands)]) {
            *w = factor * l;
        }
        factor *= albedo;
    }
    weights
}

impl Settings {
    /// Refuses a number of rays that no bake has.
    ///
    /// # Errors
    /// When it is not a power of two of at least 4.
    pub fn check(&self) -> Result<()> {
        if self.rays.is_power_of_two() && self.rays >= REPLICATES as u32 {
            return Ok(());
        }
        let remedy = "16 is a preview, 64 a draft, 256 final, 4096 a reference";
        Err(Error::argument("rays", self.rays, "a power of two, at least 4", remedy))
    }

    /// Paths per replicate.
    pub(super) fn points(&self) -> usize {
        (self.rays as usize / REPLICATES).max(1)
    }
}

/// The estimate for one texel of one texture, before it is rounded for storage.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TexelEstimate<F = f32> {
    /// Coefficients in the order of [`Layers`]: layer-major, then channels.
    pub transfer: Vec<F>,
    /// Standard error of the mean of the channels, of each layer and band, root mean square over the orders; that of band 0 is pooled with those of
    /// the next two. Half of a 95 % interval of a_k is sqrt(4π) times it times
    /// [`half_interval_95`](crate::sampling::statistics::half_interval_95).
    pub stderr: Vec<F>,
    /// Standard error of Σ_k a_k, the chance to escape within the stored layers.
    pub escape_stderr: f32,
    /// Whether all replicates gave the same a_0; then half of its 95 % interval is at least 1.5/N.
    pub degenerate: bool,
    /// Rays that started into the solid and did not come out, and hits without a normal where a path goes on.
    pub lost: u32,
    /// Paths that did not escape within the stored layers.
    pub trapped: u32,
    /// Paths that the estimate is made of.
    pub rays: u32,
    /// Largest standard error of what the target names, that of Σ_k a_k without a target; from all errors of `stderr`
    /// (see [`Target`]), so that it scatters less than `escape_stderr`.
    pub target_stderr: f32,
}

/// Rays that are marched before the places of their hits are computed together, so that what is remembered of them
/// stays in the cache.
const BLOCK: usize = 64;

/// Buffers reused from texel to texel.
#[derive(Default)]
pub(super) struct Scratch {
    // The paths that are left, replicate after replicate, and how many of each.
    alive: Vec<Alive>,
    living: [usize; REPLICATES],
    // Points of the square and directions about the normal, for the paths of one bounce.
    points: Vec<[f32; 2]>,
    locals: Vec<Vec3>,
    // Crossings of a block of rays, of which path and replicate, and where they are.
    crossings: Vec<Crossing>,
    crossed: Vec<(usize, usize)>,
    hits: Vec<Hit>,
    pub(super) escaped: [Vec<Vec3>; REPLICATES],
    pub(super) blocked: [Vec<Vec3>; REPLICATES],
    // Normals at the starts of its rays; at bounce 0, where all are that of the texel, one for all.
    pub(super) normals: [Vec<Vec3>; REPLICATES],
    // Σ Y over the paths of a replicate, [replicate][coefficient].
    pub(super) sums: Vec<f32>,
    // Σ Y over the rays that were blocked, less what Σ Y over all rays is in the mean, [replicate][coefficient].
    pub(super) controls: Vec<f32>,
    // How many rays there were, and how many escaped.
    pub(super) rays: RayCounts,
    // How many points of each four-dimensional sequence the paths before have taken.
    taken: [PointsTaken; REPLICATES],
    // Photons near a texel.
    pub(super) nearest: super::photon::Nearest,
}

impl Scratch {
    /// Sets the sums to zero.
    pub(super) fn zero_sums(&mut self, settings: &Settings) {
        let coefficients = settings.layers.coefficients();
        for sums in [&mut self.sums, &mut self.controls] {
            sums.clear();
            sums.resize(REPLICATES * coefficients, 0.0);
        }
        (self.rays, self.taken) = Default::default();
    }

    /// Draws directions about the normal for the living paths at bounce `k`.
    #[inline(always)]
    fn aim(&mut self, k: usize, samplers: &[PathSampler; REPLICATES]) {
        self.points.resize(self.alive.len(), [0.0; 2]);
        let mut start = 0;
        for (replicate, sampler) in samplers.iter().enumerate() {
            let sequence = sampler.sequence(k as u32);
            let range = start..start + self.living[replicate];
            let (alive, points) = (&mut self.alive[range.clone()], &mut self.points[range.clone()]);
            self.normals[replicate].clear();
            let starts = if k == 0 { alive.len().min(1) } else { alive.len() };
            self.normals[replicate].extend(alive[..starts].iter().map(|path| path.normal.vec()));
            if k.is_multiple_of(2) {
                let first = self.taken[replicate].first_of(k, alive.len());
                for (alive, point) in alive.iter_mut().zip(first..) {
                    alive.point = point;
                }
            }
            sequence.fill_from(|i| alive[i].point, points);
            start = range.end;
        }
        self.locals.clear();
        warp::squares_to_cosine_hemisphere(&self.points, &mut self.locals);
    }

    /// Adds the rays of bounce `k` to the sums: the directions that escaped, and for the control variate all others and
    /// what their starts lead one to expect.
    pub(super) fn add_rays(&mut self, k: usize, settings: &Settings) {
        let layers = &settings.layers;
        let (coefficients, bands) = (layers.coefficients(), layers.bands()[k]);
        for replicate in 0..REPLICATES {
            let (escaped, blocked) = (&self.escaped[replicate], &self.blocked[replicate]);
            let rays = escaped.len() + blocked.len();
            self.rays.add(k, replicate, rays, escaped.len());
            if rays == 0 {
                continue;
            }
            let first = replicate * coefficients + layers.offset(k);
            sh::basis::accumulate(bands, escaped, &mut self.sums[first..]);
            if settings.positive {
                continue;
            }
            let controls = &mut self.controls[first..first + bands * bands];
            sh::basis::accumulate(bands, blocked, controls);
            let mut expected = [0.0f32; sh::MAX_BANDS * sh::MAX_BANDS];
            sh::basis::accumulate(bands, &self.normals[replicate], &mut expected);
            let starts_each = if k == 0 { rays as f32 } else { 1.0 };
            scale_to_clamped_cosine(bands, starts_each, &mut expected);
            for (control, expected) in controls.iter_mut().zip(&expected) {
                *control -= expected;
            }
        }
    }
}

/// Which points the paths of a replicate take.
///
/// Two bounces share one four-dimensional sequence, so the second takes the point of the first. The
/// next sequence is independent of what happened so far, and whichever of its points a path takes
/// is uniform: so the paths that are left take the first ones, in their order, which are stratified,
/// where points by the paths' old numbers would be a random subset.
#[derive(Clone, Copy, Default)]
pub(super) struct PointsTaken([u32; MAX_LAYERS.div_ceil(2)]);

impl PointsTaken {
    /// The first of `count` points in a row at bounce `k`, which starts a sequence, for the paths in their order.
    #[inline(always)]
    fn first_of(&mut self, k: usize, count: usize) -> u32 {
        debug_assert!(k.is_multiple_of(2));
        let first = self.0[k / 2];
        self.0[k / 2] += count as u32;
        first
    }

    /// The point of the next path in line at bounce `k`, which took `before` at the last one.
    #[inline(always)]
    pub(super) fn point_for(&mut self, k: usize, before: u32) -> u32 {
        if k % 2 == 1 {
            return before;
        }
        self.0[k / 2] += 1;
        self.0[k / 2] - 1
    }
}

/// A path that is still travelling.
#[derive(Clone, Copy)]
pub(super) struct Alive {
    /// The point it took last.
    pub(super) point: u32,
    pub(super) start: Start,
    pub(super) normal: Normal,
}

/// Estimates the transfer of one texel; `item` is its linear index in the lattice.
pub(super) fn estimate<T: Sample>(
    field: &LevelField<'_, T>,
    site: &Site,
    item: u64,
    settings: &Settings,
    scratch: &mut Scratch,
    counts: &mut Counts,
    out: &mut TexelEstimate,
) {
    scratch.zero_sums(settings);
    let mut tally = Tally::default();
    let mut done = 0;
    let mut points = match settings.target {
        Some(_) => FIRST_POINTS.min(settings.points()),
        None => settings.points(),
    };
    loop {
        extend(field, site, item, done, points, settings, scratch, counts, &mut tally);
        combine_paths(settings, scratch, points, settings.layers.len(), out);
        (out.lost, out.trapped, out.rays) = (tally.lost, tally.trapped, (points * REPLICATES) as u32);
        match &settings.target {
            Some(target) if expected_error(out) > target.error && points < settings.points() => {
                (done, points) = (points, next_points(points, expected_error(out) / target.error, settings.points()));
            }
            _ => return,
        }
    }
}

/// Points per replicate that a texel with a target starts with: 16 paths.
pub(super) const FIRST_POINTS: usize = 4;

/// Points per replicate to go on to from `points`, at which the error is `excess` times too large.
///
/// The number at which an error that falls as N^−0.75 meets the target, so that few paths are traced beyond what was
/// needed (sizes that double trace 1.4 times as many on the average); from an eighth more, so that a
/// texel is not looked at too often, to twice as many.
pub(super) fn next_points(points: usize, excess: f32, most: usize) -> usize {
    // excess^(4/3).
    let wanted = points as f32 * excess * libm::cbrtf(excess);
    (wanted as usize + 1).clamp(points + points.div_ceil(8), 2 * points).min(most)
}

/// The error that the decision to stop goes by: at least 1/N.
///
/// A texel of which the first paths saw nothing hidden claims no error, and would stop too early; and every texel that
/// stops because its paths happened to miss something leaves a bias, since those that happened to hit it go on. With
/// 1/N the openness came out too large by 1/40 to 1/20 of the target on mni152 and caffeine_density; with 2/N by half of
/// that, at up to 1.5 times the rays.
pub(super) fn expected_error<F>(texel: &TexelEstimate<F>) -> f32 {
    texel.target_stderr.max(1.0 / texel.rays as f32)
}

/// What became of some paths of all replicates, besides escapes.
#[derive(Clone, Copy, Default)]
struct Tally {
    lost: u32,
    trapped: u32,
}

/// Traces the paths `first..last` of every replicate, and adds them to the sums.
///
/// Bounce by bounce, the paths of all replicates in a row: first all rays are marched, then the places of their hits
/// computed together, then the normals there.
fn extend<T: Sample>(
    field: &LevelField<'_, T>,
    site: &Site,
    item: u64,
    first: usize,
    last: usize,
    settings: &Settings,
    scratch: &mut Scratch,
    counts: &mut Counts,
    tally: &mut Tally,
) {
    let layers = &settings.layers;
    let samplers: [PathSampler; REPLICATES] =
        std::array::from_fn(|replicate| PathSampler::new(settings.seed, item, replicate as u32));
    scratch.alive.clear();
    scratch.alive.resize(REPLICATES * (last - first), Alive { point: 0, start: site.start, normal: site.normal });
    scratch.living = [last - first; REPLICATES];
    for k in 0..layers.len() {
        bounce(field, site, k, k + 1 == layers.len(), &samplers, scratch, counts, tally);
        scratch.add_rays(k, settings);
        if scratch.alive.is_empty() {
            break;
        }
    }
    tally.trapped += scratch.alive.len() as u32;
}

/// Follows one ray of every living path, sorts out those that escape, and takes the others to where they hit; after
/// the last layer that no longer matters, and they stay where they were.
///
/// Compiled for what processors have, with all that it calls. No variant uses fused multiply-add: all give the same
/// bits.
#[multiversion(targets(
    "x86_64+avx+avx2+bmi1+bmi2+lzcnt+popcnt+avx512f+avx512vl+avx512dq+avx512bw",
    "x86_64+avx+avx2+bmi1+bmi2+lzcnt+popcnt"
))]
fn bounce<T: Sample>(
    field: &LevelField<'_, T>,
    site: &Site,
    k: usize,
    is_last: bool,
    samplers: &[PathSampler; REPLICATES],
    scratch: &mut Scratch,
    counts: &mut Counts,
    tally: &mut Tally,
) {
    scratch.aim(k, samplers);
    let Scratch { alive, living, locals, escaped, blocked, crossings, crossed, hits, .. } = scratch;
    escaped.iter_mut().for_each(Vec::clear);
    blocked.iter_mut().for_each(Vec::clear);
    let (level_set, frame_at_texel) = (field.level_set(site.isovalue), Frame::around(site.normal));
    let (mut replicate, mut end, mut kept) = (0, living[0], 0);
    let mut survivors = [0; REPLICATES];
    for block in (0..alive.len()).step_by(BLOCK) {
        crossings.clear();
        crossed.clear();
        let arriving = kept;
        for i in block..(block + BLOCK).min(alive.len()) {
            while i == end {
                replicate += 1;
                end += living[replicate];
            }
            let path = alive[i];
            let frame = if k == 0 { frame_at_texel } else { Frame::around(path.normal) };
            let direction = frame.from_local(locals[i]);
            let in_grid = field.direction_in_grid(direction);
            match level_set.first_crossing(&path.start, in_grid, counts) {
                Outcome::Escaped => {
                    escaped[replicate].push(direction);
                    continue;
                }
                Outcome::Hit(_) if is_last => {}
                Outcome::Hit(crossing) => {
                    crossings.push(crossing);
                    crossed.push((kept, replicate));
                }
                Outcome::Lost => tally.lost += 1,
            }
            blocked[replicate].push(direction);
            alive[kept] = path;
            survivors[replicate] += 1;
            kept += 1;
        }
        if is_last {
            continue;
        }
        hits.clear();
        Crossing::hits(crossings, hits);
        let mut arrived = arriving;
        let mut hits = crossed.iter().zip(&*hits).peekable();
        for slot in arriving..kept {
            let mut path = alive[slot];
            if let Some((&(_, replicate), &hit)) = hits.next_if(|((crossed, _), _)| *crossed == slot) {
                let Some(normal) = field.hit_normal(&hit.at) else {
                    tally.lost += 1;
                    survivors[replicate] -= 1;
                    continue;
                };
                path = Alive { start: Start::on(hit.at), normal, ..path };
            }
            alive[arrived] = path;
            arrived += 1;
        }
        kept = arrived;
    }
    alive.truncate(kept);
    *living = survivors;
}

/// Where a path goes on after a ray that did not escape; `None` where the surface has no normal.
pub(super) fn continuation<T: Sample>(field: &LevelField<'_, T>, before: &Alive, outcome: Outcome) -> Option<Alive> {
    match outcome {
        Outcome::Hit(hit) => {
            field.hit_normal(&hit.at).map(|normal| Alive { point: before.point, start: Start::on(hit.at), normal })
        }
        Outcome::Lost => Some(*before),
        Outcome::Escaped => None,
    }
}
