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
//! # Among walls and luminaires
//! A path goes on from walls, mirrors, media and level sets of other volumes, by the numbers of `path`; where it meets its own level set
//! it ends, and adds W T_k to layer j + k + 1 of each texture, W its weight in each channel, j the level sets met before. So what
//! comes without a hit of the level set is that of `path`, bit by bit, in the textures of emission and luminaires, too; the control
//! variate counts the rays that are traced. Light that only photons find is not in the cache: photons bring it to every layer. Through
//! a translucent solid light leaves elsewhere than it entered, in a direction that depends on where it came from, so that a hit
//! has no transfer of its own: these are refused.
//!
//! # What it needs
//! All selected texels at once, in memory; see [`gather_memory`]. Results are the same bytes for any
//! number of threads and any choice of chunks to write, but *not* for another selection: texels read
//! their neighbours. Hits near which nothing is selected go on as paths.

mod ahead;
mod bias;
mod cache;
mod estimate;
mod passes;

#[cfg(test)]
mod tests;

pub use bias::Bias;
pub use cache::{CachePrecision, Lookups};

pub(super) use ahead::{Ahead, Read};

use super::bake::{Bake, Present, Progress, Sink};
use super::chunks::most_in_work;
use super::summary::Summary;
use crate::error::{Error, Result};
use crate::level::LevelField;
use crate::sampling::hash::key;
use crate::scene::geometry::Geometry;
use crate::transfer::{BRICK_TEXELS, Lattice, Layers};
use crate::volume::with_samples;
use ahead::width;
use cache::cached_layers;
use passes::Asked;

/// What `gather` is asked for beyond [`Settings`](super::Settings), whose `rays` are those of the final gather.
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
    let bricks = bake.selection.bricks().len() as u64;
    let cache = cache_memory(&bake.layout.lattice, &bake.settings.layers, bake.geometry, bricks, settings);
    // The chunks in work, as they were and as they become.
    let of_groups = bake.groups().into_iter().filter_map(|group| group.layout(bake.layout).ok());
    let of_layers = |layers: Layers| 2 * layers.coefficients() as u64 + 2 * layers.errors() as u64 + 5;
    let texel: u64 = of_groups.map(|layout| of_layers(layout.layers)).sum();
    let of_chunk: usize = bake.layout.lattice.bricks_of_chunk().iter().product();
    let in_work = bricks.min((most_in_work(None) * of_chunk) as u64) * BRICK_TEXELS as u64;
    cache + 2 * in_work * texel
}

/// Bytes of the cache alone, for a selection of so many bricks.
pub(crate) fn cache_memory(
    lattice: &Lattice,
    layers: &Layers,
    geometry: Option<&Geometry>,
    bricks: u64,
    settings: &GatherSettings,
) -> u64 {
    let Some(cached) = cached_layers(layers) else { return 0 };
    // Later passes read one copy and write another.
    let copies = if settings.passes > 2 { 2 } else { 1 };
    cache::bytes(lattice, width(&cached, geometry), bricks, settings.precision, copies)
}

/// Why a translucent solid is not gathered.
pub(crate) fn translucent() -> Error {
    let expected = "an opaque one: light leaves elsewhere than it entered, so that a hit has no transfer to look up";
    Error::argument("estimator gather", "a translucent solid", expected, "use the estimator path")
}

/// Bakes the selected texels with the texture as radiance cache, and hands out the chunks asked for
/// as [`super::bake()`] does; `present` likewise.
///
/// The cache covers the whole selection whatever `chunks` are asked for, so that parts of a texture
/// can be written one by one, each at the price of the passes.
///
/// # Errors
/// [`Error::Limit`] when cache and output would take more than `memory_limit`; those of [`super::bake()`];
/// passes or rays that make no sense; a translucent solid.
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
    if bake.geometry.is_some_and(|geometry| geometry.body().is_some()) {
        return Err(translucent());
    }
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
        let asked = Asked { field: &field, bake, settings, chunks, progress, present };
        let mut gathered = match (cached_layers(&bake.settings.layers), bake.geometry) {
            // Direct light alone reads no cache.
            (None, _) => Gathered { summary: super::bake(bake, chunks, progress, present, sink)?, ..Gathered::default() },
            (Some(cached), None) => asked.alone(&cached, sink)?,
            (Some(cached), Some(geometry)) => asked.among(&cached, geometry, sink)?,
        };
        gathered.memory = memory;
        Ok(gathered)
    })
}
