//! The estimator `gather`: the transfer texture is its own radiance cache.
//!
//! T_{k+1}(x) is the cosine-weighted mean of T_k at what x sees. `path` estimates that T_k by going
//! on; here it is looked up in the texture itself, as earlier passes left it, for all layers at
//! once and one ray per path (final gathering from cached irradiance: Ward, Rubinstein, Clear 1988;
//! Jensen 2001, ch. 7; a regular lattice instead of a sparse set of records, and transfer vectors
//! instead of irradiance, are ours).
//!
//! * **First pass**: `cache_rays` paths a texel by the estimator `path`. We do not start with T_0 alone:
//!   then layer k would exist from pass k+1 on, the layers' means would run over different passes, and
//!   their sum could exceed 1. With whole vectors every state of the cache is a mean of vectors
//!   with Σ_k a_k ≤ 1, any number of layers works with any number of passes, and the cost is at most a few
//!   rays more for each path of one pass.
//! * **Middle passes** (none by default): `cache_rays` new rays a texel. One that escapes along ω adds Y(ω) to layer 0; one
//!   that hits x' adds the trilinear T_k(x') to layer k+1 for every k. The cache is the mean of the
//!   passes so far, all of equal weight: they have equally many rays of their own, independent of each
//!   other, and the noise that a pass inherits from the cache is averaged over its hits. A pass reads
//!   one copy and writes another, so the result does not depend on the order of texels.
//! * **Final gather**: `Settings::rays` rays a texel, the same numbers as `path` would use, against the
//!   finished cache. Layer 0 is that of `path`, bit by bit, and free of bias.
//!
//! # What the error bars say
//! Standard errors come from the four replicates of the final gather. They hold the noise of its rays. They
//! do not hold what all its rays share: the noise left in the cache and the bias of interpolating it
//! across edges of shadow and between level sets. [`Bias`] estimates that from a sample of texels.
//!
//! # What it needs
//! All selected texels at once, in memory; see [`gather_memory`]. Results are the same bytes for any
//! number of threads and any choice of chunks to write, but *not* for another selection: texels read
//! their neighbours. Hits near which nothing is selected go on as paths.

mod bias;
mod cache;
mod estimate;

#[cfg(test)]
mod tests;

pub use bias::Bias;
pub use cache::{CachePrecision, Lookups};

use super::bake::{Bake, Present, Progress, Sink, fill_alone};
use super::chunks::most_in_work;
use super::path::{Scratch, Settings, TexelEstimate, estimate as estimate_path};
use super::summary::Summary;
use crate::error::{Error, Result};
use crate::grid3;
use crate::level::{Counts, LevelField, Site};
use crate::sampling::hash::key;
use crate::transfer::{BRICK, BRICK_TEXELS, Layers};
use crate::volume::{Sample, with_samples};
use cache::{Cache, EMPTY_ROW, Values, cached_layers};
use estimate::Pass;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// What `gather` is asked for beyond [`Settings`], whose `rays` are those of the final gather.
#[derive(Clone, Debug, PartialEq)]
pub struct GatherSettings {
    /// Passes, the final gather included: at least 2.
    pub passes: u32,
    /// Rays a texel of each pass but the last: a power of two of at least 4.
    pub cache_rays: u32,
    /// Most bytes that cache and output in flight may take.
    pub memory_limit: u64,
    /// How the cache holds its numbers.
    pub precision: CachePrecision,
    /// Texels in the sample that [`Bias`] is estimated from; 0 for none.
    pub bias_texels: u32,
}

impl Default for GatherSettings {
    /// 2 passes, 16 rays, 2 GiB, f16, 512 texels: more passes cost time and save little
    /// (`probes/record/2026-11-22-xeon-2core-gather`).
    fn default() -> Self {
        Self { passes: 2, cache_rays: 16, memory_limit: 2 << 30, precision: CachePrecision::Half, bias_texels: 512 }
    }
}

impl GatherSettings {
    fn check(&self) -> Result<()> {
        if self.passes < 2 {
            return Err(Error::argument(
                "passes",
                self.passes,
                "at least 2: one that fills the cache and the final gather",
                "2 is the default; without a cache use the estimator path",
            ));
        }
        if !self.cache_rays.is_power_of_two() || self.cache_rays < super::REPLICATES as u32 {
            return Err(Error::argument(
                "cache rays",
                self.cache_rays,
                "a power of two, at least 4",
                "16 is the default",
            ));
        }
        Ok(())
    }
}

/// What a gather reports.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gathered {
    /// Totals of the final gather; its `counts` hold the work of all passes and of the bias sample.
    /// `lost` are first rays lost in the solid, `trapped` paths without cache that outlived the layers.
    pub summary: Summary,
    /// Estimate of the bias.
    pub bias: Bias,
    /// What the lookups of the middle passes and of the final gather found.
    pub lookups: Lookups,
    /// Bytes of cache and output in flight, as [`gather_memory`].
    pub memory: u64,
}

/// Streams of random numbers besides that of the final gather, which is the seed itself.
#[derive(Clone, Copy)]
enum Stream {
    Pass(u32),
    Pick,
    SecondGather,
    Reference(u32),
}

/// The seed of a stream.
fn stream_seed(seed: u64, stream: Stream) -> u64 {
    let (kind, index) = match stream {
        Stream::Pass(p) => (1, p),
        Stream::Pick => (2, 0),
        Stream::SecondGather => (3, 0),
        Stream::Reference(r) => (4, r),
    };
    key(seed, kind << 32 | u64::from(index))
}

/// Bytes that [`gather()`] takes for cache and output in flight, the volume and its pyramid not counted.
pub fn gather_memory(bake: &Bake<'_>, settings: &GatherSettings) -> u64 {
    let lattice = &bake.layout.lattice;
    let layers = &bake.settings.layers;
    let bricks = bake.selection.bricks().len() as u64;
    // Later passes read one copy and write another.
    let copies = if settings.passes > 2 { 2 } else { 1 };
    let cache =
        cached_layers(layers).map_or(0, |cached| cache::bytes(lattice, &cached, bricks, settings.precision, copies));
    // The chunks in work, as they were and as they become.
    let texel = 2 * layers.coefficients() as u64 + 2 * layers.errors() as u64 + 5;
    let of_chunk: usize = lattice.bricks_of_chunk().iter().product();
    let in_work = bricks.min((most_in_work(None) * of_chunk) as u64) * BRICK_TEXELS as u64;
    cache + 2 * in_work * texel
}

/// Bakes the selected texels with the texture as radiance cache, and hands out the chunks asked for
/// as [`super::bake()`] does; `present` likewise.
///
/// The cache covers the whole selection whatever `chunks` are asked for, so that parts of a texture
/// can be written one by one, each at the price of the passes.
///
/// # Errors
/// [`Error::Limit`] when cache and output would take more than `memory_limit`; those of [`super::bake()`];
/// passes or rays that make no sense.
pub fn gather(
    bake: &Bake<'_>,
    settings: &GatherSettings,
    chunks: &[[usize; 3]],
    progress: &Progress,
    present: &Present<'_>,
    sink: &mut Sink<'_>,
) -> Result<Gathered> {
    bake.check()?;
    settings.check()?;
    let memory = gather_memory(bake, settings);
    if memory > settings.memory_limit {
        return Err(Error::Limit {
            what: format!("the radiance cache of {} texels", bake.selection.len()),
            needed: format!("{} MiB", memory.div_ceil(1 << 20)),
            limit: format!("{} MiB", settings.memory_limit >> 20),
            remedy: "raise the limit, lower the texture's resolution, its layers or bands, select fewer isovalues, \
                     or use the estimator path, which needs no cache"
                .into(),
        });
    }
    with_samples!(bake.volume.samples(), s => {
        let field = LevelField::new(bake.volume, s, bake.pyramid);
        let mut gathered = all_passes(&field, bake, settings, chunks, progress, present, sink)?;
        gathered.memory = memory;
        Ok(gathered)
    })
}

fn all_passes<T: Sample>(
    field: &LevelField<'_, T>,
    bake: &Bake<'_>,
    settings: &GatherSettings,
    chunks: &[[usize; 3]],
    progress: &Progress,
    present: &Present<'_>,
    sink: &mut Sink<'_>,
) -> Result<Gathered> {
    let mut gathered = Gathered::default();
    let Some(cached) = cached_layers(&bake.settings.layers) else {
        // Direct light alone reads no cache.
        gathered.summary = super::bake(bake, chunks, progress, present, sink)?;
        return Ok(gathered);
    };
    let (cache, counts, lookups) = fill(field, bake, settings, cached, progress);
    (gathered.summary.counts, gathered.lookups) = (counts, lookups);
    if progress.cancel.load(Ordering::Relaxed) {
        return Ok(gathered);
    }
    let pass = Pass::new(&cache, bake.settings.clone());
    let tally = Tally::default();
    let estimator = |site: &Site, item: u64, scratch: &mut Scratch, counts: &mut Counts, out: &mut TexelEstimate| {
        let mut lookups = Lookups::default();
        pass.estimate(field, site, item, scratch, counts, &mut lookups, out);
        tally.add(&lookups);
    };
    gathered.summary.add(&fill_alone(field, bake, &estimator, chunks, progress, present, sink)?);
    gathered.lookups += tally.total();
    if !progress.cancel.load(Ordering::Relaxed) {
        let lattice = &bake.layout.lattice;
        let texels = bias::pick(&cache, lattice, bake.settings.seed, settings.bias_texels as usize);
        let (sample, counts) = bias::sample(field, &cache, lattice, bake.settings, &texels);
        gathered.bias = Bias::of(&sample);
        gathered.summary.counts += counts;
    }
    Ok(gathered)
}

/// Lookups counted from many threads: whole numbers, so their order does not matter.
#[derive(Default)]
struct Tally([AtomicU64; 4]);

impl Tally {
    fn add(&self, l: &Lookups) {
        for (sum, n) in self.0.iter().zip([l.lookups, l.renormalised, l.neighbourhood, l.continued]) {
            if n > 0 {
                sum.fetch_add(n, Ordering::Relaxed);
            }
        }
    }

    fn total(&self) -> Lookups {
        let [lookups, renormalised, neighbourhood, continued] =
            std::array::from_fn(|i| self.0[i].load(Ordering::Relaxed));
        Lookups { lookups, renormalised, neighbourhood, continued }
    }
}

/// All passes but the final gather.
fn fill<T: Sample>(
    field: &LevelField<'_, T>,
    bake: &Bake<'_>,
    settings: &GatherSettings,
    cached: Layers,
    progress: &Progress,
) -> (Cache, Counts, Lookups) {
    let mut cache = Cache::new(bake.selection, cached, settings.precision);
    let mut next = cache.blank();
    let (mut counts, mut lookups) = (Counts::default(), Lookups::default());
    for pass in 0..settings.passes - 1 {
        let (valid, c, l) = one_pass(field, bake, settings, &cache, pass, &mut next, progress);
        cache.replace_rows(&mut next, valid);
        if pass == 0 && settings.passes > 2 {
            // The first pass read nothing, so until here there was one copy.
            next = cache.blank();
        }
        counts += c;
        lookups += l;
        if progress.cancel.load(Ordering::Relaxed) {
            break;
        }
    }
    (cache, counts, lookups)
}

/// One pass over the bricks of the cache; its mean with the passes before goes to `next`.
fn one_pass<T: Sample>(
    field: &LevelField<'_, T>,
    bake: &Bake<'_>,
    settings: &GatherSettings,
    cache: &Cache,
    pass: u32,
    next: &mut Values,
    progress: &Progress,
) -> (Vec<bool>, Counts, Lookups) {
    let lattice = &bake.layout.lattice;
    let [mx, my, _] = lattice.texels();
    let coefficients = cache.layers().coefficients();
    let pass_settings = Settings {
        layers: cache.layers().clone(),
        rays: settings.cache_rays,
        seed: stream_seed(bake.settings.seed, Stream::Pass(pass)),
        ..bake.settings.clone()
    };
    let gatherer = Pass::new(cache, pass_settings.clone());
    let newest = 1.0 / (pass + 1) as f32;
    let mut valid = vec![false; cache.valid().len()];
    let results: Vec<(Counts, Lookups)> = next
        .parts(BRICK_TEXELS * coefficients)
        .into_par_iter()
        .zip(valid.par_chunks_mut(BRICK_TEXELS))
        .with_max_len(1)
        .enumerate()
        .map_init(Scratch::default, |scratch, (slot, (mut values, valid))| {
            let (mut counts, mut lookups) = (Counts::default(), Lookups::default());
            if progress.cancel.load(Ordering::Relaxed) {
                return (counts, lookups);
            }
            let mut out = TexelEstimate::default();
            let mut row = EMPTY_ROW;
            for t in 0..BRICK_TEXELS {
                let inner = grid3::at([BRICK, BRICK], t);
                let texel: [usize; 3] = std::array::from_fn(|a| cache.bricks()[slot][a] * BRICK + inner[a]);
                if !bake.selection.contains(texel) {
                    continue;
                }
                let Some(site) = field.site(lattice.grid_from_texel(texel)) else { continue };
                let item = (grid3::index([mx, my], texel)) as u64;
                if pass == 0 {
                    estimate_path(field, &site, item, &pass_settings, scratch, &mut counts, &mut out);
                } else {
                    gatherer.estimate(field, &site, item, scratch, &mut counts, &mut lookups, &mut out);
                    out.transfer.iter_mut().for_each(|v| *v *= newest);
                    cache.add_texel(slot, t, 1.0 - newest, &mut out.transfer, &mut row);
                }
                values.store(t * coefficients, &out.transfer);
                valid[t] = true;
            }
            progress.rays.fetch_add(counts.rays, Ordering::Relaxed);
            (counts, lookups)
        })
        .collect();
    let (mut counts, mut lookups) = (Counts::default(), Lookups::default());
    for (c, l) in results {
        counts += c;
        lookups += l;
    }
    (valid, counts, lookups)
}
