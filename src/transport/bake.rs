//! The parallel loop: chunks of bricks of texels. Each brick writes its own slot and every number is a
//! pure function of (seed, texel, replicate, bounce, path), so the bytes do not depend on threads or
//! on which chunks are baked together.

use super::adaptive::{Tolerance, fill_adaptively, share_of};
use super::chunks::for_each_chunk;
use super::estimator::{Alone, BrickOutput, Estimator, Fate, WithinLevelSet, brick_of, estimates_of, item_of};
use super::open::Openness;
use super::path::{Scratch, Settings, TexelEstimate, estimate};
use super::scene_path::{Among, SpecularLight, needs_photons};
use super::summary::Summary;
use super::sums::{Real, stated_variance};
use crate::error::{Error, Result};
use crate::grid3;
use crate::level::{Counts, LevelField, Pyramid, Site};
use crate::sampling::hash::key;
use crate::scene::geometry::Geometry;
use crate::transfer::{Brick, Group, Layers, Layout, Selection};
use crate::volume::{Sample, Volume, with_samples};
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Everything a bake reads.
#[derive(Clone, Copy)]
pub struct Bake<'a> {
    /// The volume.
    pub volume: &'a Volume,
    /// Its pyramid.
    pub pyramid: &'a Pyramid,
    /// What stands around it; then the layers are coloured, and there is a texture for each of [`Self::groups`].
    pub geometry: Option<&'a Geometry>,
    /// Whether light of luminaires counts that reaches a diffuse surface by way of mirrors or glass.
    pub caustics: bool,
    /// What of it only photons find ([`needs_photons`]).
    pub specular: Option<&'a dyn SpecularLight>,
    /// Lattice and layers of the texture of the environment; the layers are those of `settings`.
    pub layout: &'a Layout,
    /// Estimator settings.
    pub settings: &'a Settings,
    /// Which texels to bake.
    pub selection: &'a Selection,
    /// The isosurface whose vertices the layout is of; none where it is of texels.
    pub points: Option<&'a SurfacePoints>,
    /// Of a texture that leaves out texels that can be interpolated: how exactly.
    pub tolerance: Option<&'a Tolerance>,
}

/// Points of an isosurface that are baked in the place of texels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfacePoints {
    /// In the file's values.
    pub isovalue: f64,
    /// An isovalue of each point, where they are of several isosurfaces; else empty.
    pub own: Vec<f64>,
    /// Positions in grid space.
    pub positions_in_grid: Vec<[f32; 3]>,
    /// Unit normals in world that point to the lit side, one a position; zero where there is none.
    pub normals: Vec<[f32; 3]>,
}

impl SurfacePoints {
    /// The site of a vertex.
    pub(super) fn site<T: Sample>(&self, field: &LevelField<'_, T>, volume: &Volume, vertex: usize) -> Option<Site> {
        let (position, normal, isovalue) = self.of_vertex(vertex)?;
        field.site_on(position, normal, volume.raw_from_value(isovalue) as f32)
    }

    /// Position, normal and isovalue of a vertex.
    fn of_vertex(&self, vertex: usize) -> Option<([f32; 3], [f32; 3], f64)> {
        let isovalue = self.own.get(vertex).copied().unwrap_or(self.isovalue);
        Some((*self.positions_in_grid.get(vertex)?, *self.normals.get(vertex)?, isovalue))
    }
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

/// The 64 bricks of a chunk (x fastest, `None` where nothing is baked) for each group, in the order of [`Bake::groups`]: one
/// for a volume alone.
pub type ChunkBricks = Vec<Vec<Option<Brick>>>;

/// What there is of a chunk before a bake; `None` if nothing.
pub type Present<'a> = dyn Fn([usize; 3]) -> Result<Option<ChunkBricks>> + Sync + 'a;

/// Who takes a chunk when it is done. Called for one chunk at a time, but from any thread.
pub type Sink<'a> = dyn FnMut([usize; 3], ChunkBricks) -> Result<()> + Send + 'a;

impl<'a> Bake<'a> {
    /// A bake of a volume alone.
    pub fn new(
        volume: &'a Volume,
        pyramid: &'a Pyramid,
        layout: &'a Layout,
        settings: &'a Settings,
        selection: &'a Selection,
    ) -> Self {
        Self {
            volume,
            pyramid,
            geometry: None,
            caustics: true,
            specular: None,
            layout,
            settings,
            selection,
            points: None,
            tolerance: None,
        }
    }

    /// The same among walls, luminaires and other volumes.
    pub fn among(self, geometry: Option<&'a Geometry>) -> Self {
        Self { geometry, ..self }
    }

    /// The point of a texel on its level set, or of a vertex of the isosurface.
    pub(super) fn site<E: Estimator>(&self, estimator: &E, texel: [usize; 3]) -> Option<Site> {
        match self.points {
            None => estimator.site(self.layout.lattice.grid_from_texel(texel)),
            Some(points) => {
                let (position, normal, isovalue) = points.of_vertex(texel[0])?;
                estimator.site_on(position, normal, self.volume.raw_from_value(isovalue) as f32)
            }
        }
    }

    /// The groups that are filled: the environment, and among walls and other volumes emission and each luminaire.
    pub fn groups(&self) -> Vec<Group> {
        let Some(geometry) = self.geometry else { return vec![Group::Environment] };
        let luminaires = geometry.luminaires().iter().map(|l| Group::Luminaire(l.name.clone()));
        [Group::Environment, Group::Emission].into_iter().chain(luminaires).collect()
    }

    pub(super) fn check(&self) -> Result<()> {
        self.volume.check_cells()?;
        self.settings.check()?;
        let points = self.points.map_or(0, |points| points.positions_in_grid.len().min(points.normals.len()));
        let vertices = if self.layout.lattice.is_of_vertices() { self.layout.lattice.texels()[0] } else { 0 };
        if points != vertices || self.points.is_some() != self.layout.lattice.is_of_vertices() {
            let remedy = "make the layout with Lattice::of_vertices, of as many as there are points";
            return Err(Error::argument("points", points, format!("{vertices}, the vertices of the layout"), remedy));
        }
        match self.geometry {
            Some(geometry) => self.check_scene(geometry),
            None => Ok(()),
        }
    }

    fn check_scene(&self, geometry: &Geometry) -> Result<()> {
        if self.settings.layers.channels() != 3 || self.settings.layers != self.layout.layers {
            let remedy = "make them with Layers::coloured";
            return Err(Error::argument("layers", "grey ones", "the three channels of a scene", remedy));
        }
        if self.caustics
            && self.specular.is_none()
            && let [first, ..] = needs_photons(geometry).as_slice()
        {
            let remedy =
                "give what photons say of it (SpecularPhotons), or leave its caustics out: --effects -caustics";
            let found =
                format!("{first}, a point or parallel light, beside glass or mirrors that are not flat, or many");
            return Err(Error::argument(
                "caustics",
                found,
                "luminaires with an area, or up to six flat mirrors",
                remedy,
            ));
        }
        Ok(())
    }

    /// Chunks that hold selected texels, x fastest.
    pub fn chunks(&self) -> Vec<[usize; 3]> {
        let [cx, cy, cz] = self.layout.lattice.chunks();
        let all = grid3::all([cx, cy, cz]);
        all.filter(|&c| self.selection.touches_chunk(c)).collect()
    }
}

/// Runs a block for the path tracer that a bake asks for: within the level set, or among what stands around it.
macro_rules! with_path_tracer {
    ($bake:expr, $openness:path, $estimator:ident => $body:expr) => {{
        let bake: &Bake<'_> = $bake;
        with_samples!(bake.volume.samples(), s => {
            let field = LevelField::new(bake.volume, s, bake.pyramid);
            match bake.geometry {
                Some(geometry) => {
                    let $estimator = Among::new(bake, &field, geometry)?;
                    $body
                }
                None => {
                    let (estimate, openness) = (by_path(&field, bake), $openness(bake.volume, &field));
                    let $estimator = Alone { field: &field, openness, settings: bake.settings, estimate: &estimate };
                    $body
                }
            }
        })
    }};
}

/// Bakes the selected texels, chunk after chunk, and hands each chunk's 4³ bricks (x fastest, `None`
/// where nothing is selected) to `sink` as soon as the last is done. Chunks are begun in the order given.
///
/// `present` gives the bricks of a chunk that exist already. Their texels are kept, but selected ones of fewer rays
/// than they get now are replaced: a texel never gets worse.
///
/// # Errors
/// Those of the sink; rays that are not a power of two of at least 4; a volume without cells; among walls grey layers, and
/// caustics that need photons where there are none ([`needs_photons`]).
pub fn bake(
    bake: &Bake<'_>,
    chunks: &[[usize; 3]],
    progress: &Progress,
    present: &Present<'_>,
    sink: &mut Sink<'_>,
) -> Result<Summary> {
    bake.check()?;
    with_path_tracer!(bake, Openness::of, estimator => match bake.tolerance {
        Some(tolerance) => fill_adaptively(&estimator, bake, tolerance, chunks, progress, present, sink),
        None => fill(&estimator, bake, chunks, progress, present, sink),
    })
}

/// The path tracer within a level set.
fn by_path<'a, T: Sample>(
    field: &'a LevelField<'_, T>,
    bake: &'a Bake<'_>,
) -> impl Fn(&Site, u64, &mut Scratch, &mut Counts, &mut TexelEstimate) + Sync + 'a {
    |site, item, scratch, counts, out| estimate(field, site, item, bake.settings, scratch, counts, out)
}

/// The loop over chunks for an estimator within the level set.
pub(super) fn fill_alone<T: Sample>(
    field: &LevelField<'_, T>,
    bake: &Bake<'_>,
    estimate: &WithinLevelSet<'_>,
    chunks: &[[usize; 3]],
    progress: &Progress,
    present: &Present<'_>,
    sink: &mut Sink<'_>,
) -> Result<Summary> {
    let estimator = Alone { field, openness: Openness::of(bake.volume, field), settings: bake.settings, estimate };
    fill(&estimator, bake, chunks, progress, present, sink)
}

/// The loop over chunks, for any estimator.
pub(super) fn fill<E: Estimator>(
    estimator: &E,
    bake: &Bake<'_>,
    chunks: &[[usize; 3]],
    progress: &Progress,
    present: &Present<'_>,
    sink: &mut Sink<'_>,
) -> Result<Summary> {
    let layers: &[Layers] = estimator.layers();
    let lattice = &bake.layout.lattice;
    let slots = lattice.bricks_of_chunk().iter().product();
    let work = |scratch: &mut E::Scratch, before: &Option<ChunkBricks>, chunk: [usize; 3], slot: usize| {
        let index = lattice.brick_in_chunk(chunk, slot);
        let of_slot = |all: &ChunkBricks| all.iter().map(|group| group.get(slot).cloned().flatten()).collect();
        let old: Option<Vec<Brick>> = before.as_ref().and_then(of_slot);
        if !bake.selection.touches_brick(index) {
            return old.map(|bricks| BrickOutput { bricks, summary: Summary::default() });
        }
        let output = brick_of(
            estimator,
            bake,
            &|texel| bake.selection.contains(texel),
            index,
            old,
            scratch,
            Some(&progress.cancel),
        );
        progress.texels.fetch_add(output.summary.texels, Ordering::Relaxed);
        progress.rays.fetch_add(output.summary.counts.rays, Ordering::Relaxed);
        Some(output)
    };
    let mut hand_on = |chunk: [usize; 3], outputs: Vec<Option<BrickOutput>>| {
        let mut all: ChunkBricks = layers.iter().map(|_| Vec::with_capacity(outputs.len())).collect();
        let mut summaries = Vec::with_capacity(outputs.len());
        for output in outputs {
            let mut bricks = output.map(|output| {
                summaries.push(output.summary);
                output.bricks.into_iter()
            });
            all.iter_mut().for_each(|group| group.push(bricks.as_mut().and_then(Iterator::next)));
        }
        sink(chunk, all)?;
        Ok(summaries)
    };
    let mut total = Summary::new(layers);
    let mut add = |summaries: Vec<Summary>| summaries.iter().for_each(|s| total.add(s));
    for_each_chunk(slots, chunks, progress, present, &work, &mut hand_on, &mut add)?;
    Ok(total)
}

/// Bakes one brick on its own.
///
/// # Errors
/// As [`bake`].
pub fn bake_brick(bake: &Bake<'_>, index: [usize; 3]) -> Result<BrickOutput> {
    bake.check()?;
    with_path_tracer!(bake, Openness::of, estimator => {
        Ok(brick_of(&estimator, bake, &|texel| bake.selection.contains(texel), index, None, &mut Default::default(), None))
    })
}

/// The estimates of single texels as the path tracer makes them, one a group, before they are rounded for storage: each a
/// texel and its number of paths, a multiple of 4. `None` for a texel without a level set. The selection is not asked, and
/// no texel has a closed form.
///
/// # Errors
/// As [`bake`]; a number of paths that is not a multiple of 4.
pub fn estimates(bake: &Bake<'_>, texels: &[([usize; 3], u32)]) -> Result<Vec<Option<Vec<TexelEstimate>>>> {
    bake.check()?;
    if let Some((_, rays)) = texels.iter().find(|(_, rays)| *rays == 0 || rays % super::REPLICATES as u32 != 0) {
        return Err(Error::argument("rays", rays, "a multiple of 4", "take what the store says of the texel"));
    }
    // One estimator for each number of paths, in which texels differ.
    let mut numbers: Vec<u32> = texels.iter().map(|&(_, rays)| rays).collect();
    numbers.sort_unstable();
    numbers.dedup();
    let mut all: Vec<Option<Vec<TexelEstimate>>> = texels.iter().map(|_| None).collect();
    for rays in numbers {
        let settings = Settings { rays, target: None, ..bake.settings.clone() };
        let bake = Bake { settings: &settings, ..*bake };
        let found = with_path_tracer!(&bake, Openness::unasked, estimator => each_estimate(&estimator, &bake, texels));
        all.iter_mut().zip(found).filter(|(_, found)| found.is_some()).for_each(|(all, found)| *all = found);
    }
    Ok(all)
}

/// The estimates of those texels that have as many paths as the settings say.
fn each_estimate<E: Estimator>(
    estimator: &E,
    bake: &Bake<'_>,
    texels: &[([usize; 3], u32)],
) -> Vec<Option<Vec<TexelEstimate>>> {
    texels
        .par_iter()
        .map_init(E::Scratch::default, |scratch, &(texel, rays)| {
            if rays != bake.settings.rays {
                return None;
            }
            let site = bake.site(estimator, texel)?;
            let (mut out, mut summary) = (estimates_of(estimator), Summary::default());
            let fate = estimator.estimate(&site, item_of(bake, texel), scratch, &mut summary, &mut out);
            (fate != Fate::Buried).then(|| out.iter().map(narrowed).collect())
        })
        .collect()
}

/// An estimate in `f32`.
fn narrowed<F: Real>(wide: &TexelEstimate<F>) -> TexelEstimate {
    let narrow = |values: &[F]| values.iter().map(|v| v.as_f32()).collect();
    TexelEstimate {
        transfer: narrow(&wide.transfer),
        stderr: narrow(&wide.stderr),
        escape_stderr: wide.escape_stderr,
        degenerate: wide.degenerate,
        lost: wide.lost,
        trapped: wide.trapped,
        rays: wide.rays,
        target_stderr: wide.target_stderr,
    }
}

/// Bakes whole bricks and keeps nothing but the totals: what a bake costs and how exact it is, before the real one.
///
/// Unlike [`pilot`] it works in the order of a bake, so that the time it takes scales with the texels.
///
/// # Errors
/// As [`bake`].
pub fn trial(bake: &Bake<'_>, bricks: &[[usize; 3]]) -> Result<Summary> {
    bake.check()?;
    with_path_tracer!(bake, Openness::of, estimator => {
        let parts: Vec<Summary> = bricks
            .par_iter()
            .with_max_len(1)
            .map_init(Default::default, |scratch, &index| brick_of(&estimator, bake, &|texel| bake.selection.contains(texel), index, None, scratch, None).summary)
            .collect();
        let mut total = Summary::new(estimator.layers());
        parts.iter().for_each(|part| total.add(part));
        Ok(total)
    })
}

/// The share of the selected texels that a bake with a [`Tolerance`] traces, from some bricks: 1 without one.
///
/// # Errors
/// As [`bake`].
pub fn share_traced(bake: &Bake<'_>, bricks: &[[usize; 3]]) -> Result<f64> {
    bake.check()?;
    let Some(tolerance) = bake.tolerance else { return Ok(1.0) };
    with_path_tracer!(bake, Openness::of, estimator => Ok(share_of(&estimator, bake, tolerance, bricks)))
}

/// A small bake of every `stride`-th selected texel, for estimates before the real one; nothing is kept
/// but the totals. Shadows that the volume is told to ignore count here, so that the plan can tell what is dropped.
///
/// # Errors
/// As [`bake`].
pub fn pilot(bake: &Bake<'_>, texels: u64) -> Result<Summary> {
    bake.check()?;
    let picked = spread_texels(bake, texels);
    with_path_tracer!(bake, Openness::of_pilot, estimator => Ok(of_texels(&estimator, bake, &picked)))
}

/// The variance of radiance under a light over what standard errors say of it, from two independent estimates of some texels of a volume
/// alone: errors are of bands, in the mean over their orders, and a light that is brightest where edges of visibility lie picks more.
/// `weights`: of the transfer in each number, layer-major.
///
/// # Errors
/// As [`bake`].
pub fn noise_picked(bake: &Bake<'_>, texels: u64, weights: &[Vec<f32>]) -> Result<f64> {
    let all: Vec<([usize; 3], u32)> =
        spread_texels(bake, texels).into_iter().map(|texel| (texel, bake.settings.rays)).collect();
    let seeds = [bake.settings.seed, key(bake.settings.seed, SECOND)];
    let [first, second] = seeds.map(|seed| {
        let settings = Settings { seed, ..bake.settings.clone() };
        estimates(&Bake { settings: &settings, ..*bake }, &all)
    });
    let (mut found, mut stated) = (0.0, 0.0);
    for pair in first?.iter().flatten().zip(second?.iter().flatten()) {
        let ([a, ..], [b, ..]) = (&pair.0[..], &pair.1[..]) else { continue };
        for weights in weights {
            let numbers = weights.iter().zip(a.transfer.iter().zip(&b.transfer));
            found += numbers.map(|(w, (a, b))| f64::from(w * (a - b))).sum::<f64>().powi(2);
            stated +=
                [a, b].map(|one| f64::from(stated_variance(&bake.settings.layers, weights, one))).iter().sum::<f64>();
        }
    }
    Ok(if stated > 0.0 { found / stated } else { 1.0 })
}

/// The stream of the second of two estimates.
const SECOND: u64 = 0x7365_636f;

/// Every `stride`-th selected texel in the order of the lattice, about so many.
fn spread_texels(bake: &Bake<'_>, texels: u64) -> Vec<[usize; 3]> {
    let m = bake.layout.lattice.texels();
    let all: u64 = m.iter().map(|&v| v as u64).product();
    let stride = (bake.selection.len() / texels.max(1)).max(1);
    // A fixed stride through the selected texels, in the order of the lattice.
    let mut picked = Vec::new();
    let mut seen = 0u64;
    for i in 0..all {
        let texel = grid3::at([m[0], m[1]], i as usize);
        if bake.selection.contains(texel) {
            if seen % stride == stride / 2 {
                picked.push(texel);
            }
            seen += 1;
        }
    }
    picked
}

/// The totals of single texels.
fn of_texels<E: Estimator>(estimator: &E, bake: &Bake<'_>, texels: &[[usize; 3]]) -> Summary {
    let parts: Vec<Summary> = texels
        .par_chunks(64)
        .with_max_len(1)
        .map_init(E::Scratch::default, |scratch, part| {
            let (mut summary, mut out) = (Summary::new(estimator.layers()), estimates_of(estimator));
            for &texel in part {
                summary.texels += 1;
                let Some(site) = bake.site(estimator, texel) else { continue };
                let fate = estimator.estimate(&site, item_of(bake, texel), scratch, &mut summary, &mut out);
                if fate != Fate::Buried {
                    summary.count(&out, estimator.layers(), site.clamped, fate == Fate::Open);
                }
            }
            summary
        })
        .collect();
    let mut total = Summary::new(estimator.layers());
    parts.iter().for_each(|part| total.add(part));
    total
}
