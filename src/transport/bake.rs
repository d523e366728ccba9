//! The parallel loop: chunks of bricks of texels. Each brick writes its own slot and every number is a
//! pure function of (seed, texel, replicate, bounce, path), so the bytes do not depend on threads or
//! on which chunks are baked together.

use super::chunks::for_each_chunk;
use super::open::{Openness, unoccluded};
use super::path::{Scratch, Settings, TexelEstimate, estimate};
use super::summary::Summary;
use crate::error::{Error, Result};
use crate::level::{Counts, LevelField, Pyramid, Site};
use crate::transfer::{BRICK, BRICK_TEXELS, Brick, Layout, Selection, validity};
use crate::volume::{Sample, Volume, with_samples};
use half::f16;
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Everything a bake reads.
pub struct Bake<'a> {
    /// The volume.
    pub volume: &'a Volume,
    /// Its pyramid.
    pub pyramid: &'a Pyramid,
    /// Lattice and layers of the texture; the layers are those of `settings`.
    pub layout: &'a Layout,
    /// Estimator settings.
    pub settings: &'a Settings,
    /// Which texels to bake.
    pub selection: &'a Selection,
}

/// How far a bake has come; shared between the threads and whoever watches.
#[derive(Debug, Default)]
pub struct Progress {
    /// Texels done, of those selected.
    pub texels: AtomicU64,
    /// Photons sent out, of an estimator that has some.
    pub photons: AtomicU64,
    /// Rays traced.
    pub rays: AtomicU64,
    /// Set from outside to begin no other chunk; those in work are finished and handed on.
    pub stop: AtomicBool,
    /// Set from outside to stop at the next brick: chunks in work are lost.
    pub cancel: AtomicBool,
}

/// What there is of a chunk before a bake: its 64 bricks, x fastest; `None` if nothing.
pub type Present<'a, Bricks = Vec<Option<Brick>>> = dyn Fn([usize; 3]) -> Result<Option<Bricks>> + Sync + 'a;

/// Who takes a chunk when it is done. Called for one chunk at a time, but from any thread.
pub type Sink<'a, Bricks = Vec<Option<Brick>>> = dyn FnMut([usize; 3], Bricks) -> Result<()> + Send + 'a;

/// A baked brick and what it cost.
pub struct BrickOutput {
    /// The texels.
    pub brick: Brick,
    /// Its totals.
    pub summary: Summary,
}

impl Bake<'_> {
    pub(super) fn check(&self) -> Result<()> {
        self.volume.check_cells()?;
        if !self.settings.rays.is_power_of_two() || self.settings.rays < super::REPLICATES as u32 {
            return Err(Error::argument(
                "rays",
                self.settings.rays,
                "a power of two, at least 4",
                "16 is a preview, 64 a draft, 256 final, 4096 a reference",
            ));
        }
        Ok(())
    }

    /// Chunks that hold selected texels, x fastest.
    pub fn chunks(&self) -> Vec<[usize; 3]> {
        let [cx, cy, cz] = self.layout.lattice.chunks();
        let all = (0..cx * cy * cz).map(|i| [i % cx, i / cx % cy, i / cx / cy]);
        all.filter(|&c| self.selection.touches_chunk(c)).collect()
    }
}

/// Bakes the selected texels, chunk after chunk, and hands each chunk's 4³ bricks (x fastest, `None`
/// where nothing is selected) to `sink` as soon as the last is done. Chunks are begun in the order given.
///
/// `present` gives the bricks of a chunk that exist already. Their texels are kept, but selected ones of fewer rays
/// than they get now are replaced: a texel never gets worse.
///
/// # Errors
/// Those of the sink; rays that are not a power of two of at least 4; a volume without cells.
pub fn bake(
    bake: &Bake<'_>,
    chunks: &[[usize; 3]],
    progress: &Progress,
    present: &Present<'_>,
    sink: &mut Sink<'_>,
) -> Result<Summary> {
    bake.check()?;
    with_samples!(bake.volume.samples(), s => {
        let field = LevelField::new(bake.volume, s, bake.pyramid);
        run(&field, bake, &by_path(&field, bake), chunks, progress, present, sink)
    })
}

/// What an estimator does for one texel: its site and its linear index in the lattice are given.
pub(super) type Estimator<'a> = dyn Fn(&Site, u64, &mut Scratch, &mut Counts, &mut TexelEstimate) + Sync + 'a;

/// The default estimator.
fn by_path<'a, T: Sample>(
    field: &'a LevelField<'_, T>,
    bake: &'a Bake<'_>,
) -> impl Fn(&Site, u64, &mut Scratch, &mut Counts, &mut TexelEstimate) + Sync + 'a {
    |site, item, scratch, counts, out| estimate(field, site, item, bake.settings, scratch, counts, out)
}

/// The loop over chunks, for any estimator.
pub(super) fn run<T: Sample>(
    field: &LevelField<'_, T>,
    bake: &Bake<'_>,
    estimator: &Estimator<'_>,
    chunks: &[[usize; 3]],
    progress: &Progress,
    present: &Present<'_>,
    sink: &mut Sink<'_>,
) -> Result<Summary> {
    let openness = Openness::of(bake.volume, field);
    let work = |scratch: &mut Scratch, before: &Option<Vec<Option<Brick>>>, index: [usize; 3], slot: usize| {
        let old = before.as_ref().and_then(|bricks| bricks.get(slot)?.as_ref());
        if !bake.selection.touches_brick(index) {
            return old.map(|brick| BrickOutput { brick: brick.clone(), summary: Summary::default() });
        }
        let output = brick_with(field, bake, &openness, estimator, index, old, scratch);
        progress.texels.fetch_add(output.summary.texels, Ordering::Relaxed);
        progress.rays.fetch_add(output.summary.counts.rays, Ordering::Relaxed);
        Some(output)
    };
    let mut hand_on = |chunk: [usize; 3], outputs: Vec<Option<BrickOutput>>| {
        let split = |output: Option<BrickOutput>| output.map(|o| (o.brick, o.summary)).unzip();
        let (bricks, summaries): (Vec<_>, Vec<_>) = outputs.into_iter().map(split).unzip();
        sink(chunk, bricks)?;
        Ok(summaries)
    };
    let mut total = Summary::new(&bake.settings.layers);
    let mut add = |summaries: Vec<Option<Summary>>| summaries.iter().flatten().for_each(|s| total.add(s));
    for_each_chunk(chunks, progress, present, &work, &mut hand_on, &mut add)?;
    Ok(total)
}

/// Bakes one brick on its own.
pub fn bake_brick(bake: &Bake<'_>, index: [usize; 3]) -> Result<BrickOutput> {
    bake.check()?;
    Ok(with_samples!(bake.volume.samples(), s => {
        let field = LevelField::new(bake.volume, s, bake.pyramid);
        let openness = Openness::of(bake.volume, &field);
        brick_with(&field, bake, &openness, &by_path(&field, bake), index, None, &mut Scratch::default())
    }))
}

fn brick_with<T: Sample>(
    field: &LevelField<'_, T>,
    bake: &Bake<'_>,
    openness: &Openness<'_, '_, T>,
    estimator: &Estimator<'_>,
    index: [usize; 3],
    old: Option<&Brick>,
    scratch: &mut Scratch,
) -> BrickOutput {
    let layers = &bake.settings.layers;
    let lattice = &bake.layout.lattice;
    let mut brick = old.cloned().unwrap_or_else(|| Brick::unbaked(layers));
    let mut summary = Summary::new(layers);
    let mut texel_estimate = TexelEstimate::default();
    let (coefficients, errors) = (layers.coefficients(), layers.errors());
    let [mx, my, _] = lattice.texels();
    for t in 0..BRICK_TEXELS {
        let inner = [t % BRICK, t / BRICK % BRICK, t / BRICK / BRICK];
        let texel: [usize; 3] = std::array::from_fn(|a| index[a] * BRICK + inner[a]);
        if !bake.selection.contains(texel) {
            continue;
        }
        summary.texels += 1;
        let transfer = &mut brick.transfer[t * coefficients..(t + 1) * coefficients];
        let stderr = &mut brick.stderr[t * errors..(t + 1) * errors];
        let Some(site) = field.site(lattice.grid_from_texel(texel)) else {
            transfer.fill(f16::ZERO);
            stderr.fill(f16::ZERO);
            (brick.validity[t], brick.rays[t]) = (0, 0);
            continue;
        };
        let has_more = |rays: u32| brick.rays[t] >= rays && brick.validity[t] & validity::VALID != 0;
        if bake.settings.target.is_none() && has_more(bake.settings.rays) {
            summary.texels -= 1;
            continue;
        }
        let item = (texel[0] + mx * (texel[1] + my * texel[2])) as u64;
        let is_open = openness.admits(&site);
        if is_open {
            unoccluded(bake.settings, &site, &mut texel_estimate);
        } else {
            estimator(&site, item, scratch, &mut summary.counts, &mut texel_estimate);
        }
        tally(&texel_estimate, site.clamped, is_open, &mut summary);
        if has_more(texel_estimate.rays) {
            continue;
        }
        transfer.convert_from_f32_slice(&texel_estimate.transfer);
        stderr.convert_from_f32_slice(&texel_estimate.stderr);
        let flag = |is_set: bool, flag: u8| if is_set { flag } else { 0 };
        brick.validity[t] = validity::VALID | flag(site.clamped, validity::CLAMPED) | flag(is_open, validity::OPEN);
        brick.rays[t] = texel_estimate.rays;
    }
    BrickOutput { brick, summary }
}

fn tally(texel: &TexelEstimate, clamped: bool, open: bool, summary: &mut Summary) {
    summary.valid += 1;
    summary.open += u64::from(open);
    summary.clamped += u64::from(clamped);
    summary.degenerate += u64::from(texel.degenerate);
    summary.paths += u64::from(texel.rays);
    summary.lost += u64::from(texel.lost);
    summary.trapped += u64::from(texel.trapped);
    summary.escape_variance += f64::from(texel.escape_stderr).powi(2);
    summary.errors.add(texel.target_stderr);
    for (sum, &value) in summary.transfer.iter_mut().zip(&texel.transfer) {
        *sum += f64::from(value);
    }
}

/// The estimates of single texels as `path` makes them, before they are rounded for storage: each a texel and its
/// number of paths, a multiple of 4. `None` for a texel without a level set. The selection is not asked.
///
/// # Errors
/// As [`bake`]; a number of paths that is not a multiple of 4.
pub fn estimates(bake: &Bake<'_>, texels: &[([usize; 3], u32)]) -> Result<Vec<Option<TexelEstimate>>> {
    bake.check()?;
    if let Some((_, rays)) = texels.iter().find(|(_, rays)| *rays == 0 || rays % super::REPLICATES as u32 != 0) {
        return Err(Error::argument("rays", rays, "a multiple of 4", "take what the store says of the texel"));
    }
    let [mx, my, _] = bake.layout.lattice.texels();
    Ok(with_samples!(bake.volume.samples(), s => {
        let field = LevelField::new(bake.volume, s, bake.pyramid);
        texels
            .par_iter()
            .map_init(Scratch::default, |scratch, &(texel, rays)| {
                let site = field.site(bake.layout.lattice.grid_from_texel(texel))?;
                let settings = Settings { rays, target: None, ..bake.settings.clone() };
                let item = (texel[0] + mx * (texel[1] + my * texel[2])) as u64;
                let mut out = TexelEstimate::default();
                estimate(&field, &site, item, &settings, scratch, &mut Counts::default(), &mut out);
                Some(out)
            })
            .collect()
    }))
}

/// Bakes whole bricks and keeps nothing but the totals: what a bake costs and how exact it is, before the real one.
///
/// Unlike [`pilot`] it works in the order of a bake, so that the time it takes scales with the texels.
///
/// # Errors
/// As [`bake`].
pub fn trial(bake: &Bake<'_>, bricks: &[[usize; 3]]) -> Result<Summary> {
    bake.check()?;
    with_samples!(bake.volume.samples(), s => {
        let field = LevelField::new(bake.volume, s, bake.pyramid);
        let estimator = by_path(&field, bake);
        let openness = Openness::of(bake.volume, &field);
        let parts: Vec<Summary> = bricks
            .par_iter()
            .with_max_len(1)
            .map_init(Scratch::default, |scratch, &index| {
                brick_with(&field, bake, &openness, &estimator, index, None, scratch).summary
            })
            .collect();
        let mut total = Summary::new(&bake.settings.layers);
        parts.iter().for_each(|part| total.add(part));
        Ok(total)
    })
}

/// A small bake of every `stride`-th selected texel, for estimates before the real one; nothing is kept
/// but the totals. Shadows that the volume is told to ignore count here, so that the plan can tell what is dropped.
///
/// # Errors
/// As [`bake`].
pub fn pilot(bake: &Bake<'_>, texels: u64) -> Result<Summary> {
    bake.check()?;
    let m = bake.layout.lattice.texels();
    let all: u64 = m.iter().map(|&v| v as u64).product();
    let stride = (bake.selection.len() / texels.max(1)).max(1);
    // A fixed stride through the selected texels, in the order of the lattice.
    let mut picked = Vec::new();
    let mut seen = 0u64;
    for i in 0..all {
        let texel = [i as usize % m[0], i as usize / m[0] % m[1], i as usize / m[0] / m[1]];
        if bake.selection.contains(texel) {
            if seen % stride == stride / 2 {
                picked.push((texel, i));
            }
            seen += 1;
        }
    }
    with_samples!(bake.volume.samples(), s => {
        let field = LevelField::new(bake.volume, s, bake.pyramid);
        let openness = Openness::of_pilot(bake.volume, &field);
        let parts: Vec<Summary> = picked
            .par_chunks(64)
            .with_max_len(1)
            .map_init(Scratch::default, |scratch, part| {
                let mut summary = Summary::new(&bake.settings.layers);
                let mut texel_estimate = TexelEstimate::default();
                for &(texel, item) in part {
                    summary.texels += 1;
                    if let Some(site) = field.site(bake.layout.lattice.grid_from_texel(texel)) {
                        let is_open = openness.admits(&site);
                        if is_open {
                            unoccluded(bake.settings, &site, &mut texel_estimate);
                        } else {
                            let counts = &mut summary.counts;
                            estimate(&field, &site, item, bake.settings, scratch, counts, &mut texel_estimate);
                        }
                        tally(&texel_estimate, site.clamped, is_open, &mut summary);
                    }
                }
                summary
            })
            .collect();
        let mut total = Summary::new(&bake.settings.layers);
        parts.iter().for_each(|part| total.add(part));
        Ok(total)
    })
}
