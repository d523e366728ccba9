//! The parallel loop for scenes: as that of [`super::super::bake()`], with one texture a group.

use super::super::REPLICATES;
use super::super::bake::{Present, Progress, Sink};
use super::super::chunks::{BRICKS, for_each_chunk};
use super::super::summary::Summary;
use super::SceneSettings;
use super::estimate::{Found, trace};
use super::world::{SceneCounts, World};
use crate::error::{Error, Result};
use crate::level::{LevelField, Pyramid};
use crate::scene::geometry::Geometry;
use crate::transfer::{BRICK, BRICK_TEXELS, Brick, Group, Layers, Layout, Selection, validity};
use crate::volume::{Sample, Volume, with_samples};
use half::f16;
use rayon::prelude::*;
use std::sync::atomic::Ordering;

/// Everything a bake of a scene reads.
pub struct SceneBake<'a> {
    /// The volume.
    pub volume: &'a Volume,
    /// Its pyramid.
    pub pyramid: &'a Pyramid,
    /// What stands around it.
    pub geometry: &'a Geometry,
    /// Lattice and coloured layers; the layers are those of `settings`.
    pub layout: &'a Layout,
    /// Estimator settings.
    pub settings: &'a SceneSettings,
    /// Which texels to bake.
    pub selection: &'a Selection,
}

/// Totals of a bake of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneSummary {
    /// As of a volume alone; its transfer is the mean of the channels, its rays are those traced against the level set.
    pub summary: Summary,
    /// Work among walls and luminaires.
    pub counts: SceneCounts,
    /// Σ over valid texels of G_k of the group of emission, three channels a layer: mean weight with which the level set
    /// is met for the (k+1)th time.
    pub survival: Vec<f64>,
}

impl SceneSummary {
    fn new(layers: &Layers) -> Self {
        let grey = Layers::new(layers.bands().to_vec()).unwrap_or_else(|_| layers.clone());
        Self { summary: Summary::new(&grey), survival: vec![0.0; 3 * layers.len()], ..Self::default() }
    }

    /// Adds the totals of another part.
    pub fn add(&mut self, other: &Self) {
        self.summary.add(&other.summary);
        self.counts += other.counts;
        if self.survival.is_empty() {
            self.survival = other.survival.clone();
        } else {
            self.survival.iter_mut().zip(&other.survival).for_each(|(a, b)| *a += b);
        }
    }

    /// The most that layers beyond the stored ones can add to the radiance, over the brightest light, in the mean over the
    /// valid texels: ρ^(K+2) times the chance to meet the level set K + 1 times.
    pub fn bound(&self, albedo: f64) -> f64 {
        let layers = self.survival.len() / 3;
        let power = (0..layers + 1).fold(1.0, |power, _| power * albedo);
        if layers == 0 { 0.0 } else { power * self.mean_survival(layers - 1) }
    }

    /// Largest channel of the mean weight with which the level set is met k + 1 times.
    pub fn mean_survival(&self, k: usize) -> f64 {
        let valid = self.summary.valid.max(1) as f64;
        self.survival.iter().skip(3 * k).take(3).fold(0.0f64, |m, &v| m.max(v / valid))
    }
}

/// The bricks of a chunk for each group, in the order of [`SceneBake::groups`]; `None` where nothing is baked.
pub type GroupBricks = Vec<Vec<Option<Brick>>>;

impl SceneBake<'_> {
    /// The groups that are filled: environment, emission, luminaires.
    pub fn groups(&self) -> Vec<Group> {
        let luminaires = self.geometry.luminaires().iter().map(|l| Group::Luminaire(l.name.clone()));
        [Group::Environment, Group::Emission].into_iter().chain(luminaires).collect()
    }

    fn check(&self) -> Result<()> {
        self.volume.check_cells()?;
        if !self.settings.rays.is_power_of_two() || self.settings.rays < REPLICATES as u32 {
            let remedy = "16 is a preview, 64 a draft, 256 final, 4096 a reference";
            return Err(Error::argument("rays", self.settings.rays, "a power of two, at least 4", remedy));
        }
        if self.settings.layers.channels() != 3 || self.settings.layers != self.layout.layers {
            let remedy = "make them with Layers::coloured";
            return Err(Error::argument("layers", "grey ones", "the three channels of a scene", remedy));
        }
        if self.settings.caustics
            && let [first, ..] = super::needs_photons(self.geometry).as_slice()
        {
            let remedy = "use a small sphere or rectangle instead, or leave its caustics out: --effects -caustics";
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
}

/// Bakes the selected texels of `chunks` and hands each chunk's bricks to `sink`. `present` gives the bricks that exist;
/// texels of as many rays are kept.
///
/// # Errors
/// Those of the sink; rays that are not a power of two of at least 4; a volume without cells; grey layers; caustics
/// that would need photons ([`super::needs_photons`]).
pub fn bake_scene(
    bake: &SceneBake<'_>,
    chunks: &[[usize; 3]],
    progress: &Progress,
    present: &Present<'_, GroupBricks>,
    sink: &mut Sink<'_, GroupBricks>,
) -> Result<SceneSummary> {
    bake.check()?;
    with_samples!(bake.volume.samples(), s => {
        let field = LevelField::new(bake.volume, s, bake.pyramid);
        let world = World::new(bake.volume, &field, bake.geometry);
        run(&world, bake, chunks, progress, present, sink)
    })
}

fn run<T: Sample>(
    world: &World<'_, T>,
    bake: &SceneBake<'_>,
    chunks: &[[usize; 3]],
    progress: &Progress,
    present: &Present<'_, GroupBricks>,
    sink: &mut Sink<'_, GroupBricks>,
) -> Result<SceneSummary> {
    let groups = bake.groups().len();
    let writer = Writer::new(bake)?;
    let work = |found: &mut Found, before: &Option<GroupBricks>, index: [usize; 3], slot: usize| {
        let of_slot = |all: &GroupBricks| all.iter().map(|group| group.get(slot).cloned().flatten()).collect();
        let old: Option<Vec<Brick>> = before.as_ref().and_then(of_slot);
        if !bake.selection.touches_brick(index) {
            return old.map(|bricks| (bricks, SceneSummary::default()));
        }
        let output = brick(world, bake, &writer, index, old, found);
        progress.texels.fetch_add(output.1.summary.texels, Ordering::Relaxed);
        progress.rays.fetch_add(output.1.summary.counts.rays, Ordering::Relaxed);
        Some(output)
    };
    let mut hand_on = |chunk: [usize; 3], outputs: Vec<Option<(Vec<Brick>, SceneSummary)>>| {
        let mut all: GroupBricks = vec![Vec::with_capacity(BRICKS); groups];
        let mut summaries = Vec::with_capacity(BRICKS);
        for output in outputs {
            let mut bricks = output.map(|(bricks, summary)| {
                summaries.push(summary);
                bricks.into_iter()
            });
            all.iter_mut().for_each(|group| group.push(bricks.as_mut().and_then(Iterator::next)));
        }
        sink(chunk, all)?;
        Ok(summaries)
    };
    let mut total = SceneSummary::new(&bake.settings.layers);
    let mut add = |summaries: Vec<SceneSummary>| summaries.iter().for_each(|s| total.add(s));
    for_each_chunk(chunks, progress, present, &work, &mut hand_on, &mut add)?;
    Ok(total)
}

fn brick<T: Sample>(
    world: &World<'_, T>,
    bake: &SceneBake<'_>,
    writer: &Writer,
    index: [usize; 3],
    old: Option<Vec<Brick>>,
    found: &mut Found,
) -> (Vec<Brick>, SceneSummary) {
    let lattice = &bake.layout.lattice;
    let [mx, my, _] = lattice.texels();
    let mut bricks = old.unwrap_or_else(|| writer.layers.iter().map(Brick::unbaked).collect());
    let mut total = SceneSummary::new(&bake.settings.layers);
    for t in 0..BRICK_TEXELS {
        let inner = [t % BRICK, t / BRICK % BRICK, t / BRICK / BRICK];
        let texel: [usize; 3] = std::array::from_fn(|a| index[a] * BRICK + inner[a]);
        if !bake.selection.contains(texel) {
            continue;
        }
        total.summary.texels += 1;
        let Some(site) = world.field.site(lattice.grid_from_texel(texel)) else {
            writer.blank(&mut bricks, t);
            continue;
        };
        if bricks[0].rays[t] >= bake.settings.rays && bricks[0].validity[t] & validity::VALID != 0 {
            total.summary.texels -= 1;
            continue;
        }
        if world.is_buried(&world.isovalues(site.isovalue), world.on_level(0, site.start).in_world) {
            total.counts.buried += 1;
            writer.blank(&mut bricks, t);
            continue;
        }
        let item = (texel[0] + mx * (texel[1] + my * texel[2])) as u64;
        trace(world, &site, item, bake.settings, found, &mut total.summary.counts, &mut total.counts);
        let flags = validity::VALID | if site.clamped { validity::CLAMPED } else { 0 };
        writer.write(found, bake.settings.rays, Some((&mut bricks, t, flags)), site.clamped, &mut total);
    }
    (bricks, total)
}

/// A small bake of about as many texels as asked, spread evenly over the selected ones; only the totals are kept.
///
/// # Errors
/// As [`bake_scene`].
pub fn pilot_scene(bake: &SceneBake<'_>, texels: u64) -> Result<SceneSummary> {
    bake.check()?;
    let writer = Writer::new(bake)?;
    let m = bake.layout.lattice.texels();
    let all: u64 = m.iter().map(|&v| v as u64).product();
    let place = |i: u64| [i as usize % m[0], i as usize / m[0] % m[1], i as usize / m[0] / m[1]];
    let stride = (bake.selection.len() / texels.max(1)).max(1) as usize;
    let selected = (0..all).filter(|&i| bake.selection.contains(place(i)));
    let picked: Vec<u64> = selected.skip(stride / 2).step_by(stride).collect();
    with_samples!(bake.volume.samples(), s => {
        let field = LevelField::new(bake.volume, s, bake.pyramid);
        let world = World::new(bake.volume, &field, bake.geometry);
        let parts: Vec<SceneSummary> = picked
            .par_chunks(64)
            .map_init(Found::default, |found, part| {
                let mut total = SceneSummary::new(&bake.settings.layers);
                for &item in part {
                    total.summary.texels += 1;
                    let Some(site) = field.site(bake.layout.lattice.grid_from_texel(place(item))) else { continue };
                    if world.is_buried(&world.isovalues(site.isovalue), world.on_level(0, site.start).in_world) {
                        continue;
                    }
                    trace(&world, &site, item, bake.settings, found, &mut total.summary.counts, &mut total.counts);
                    writer.write(found, bake.settings.rays, None, site.clamped, &mut total);
                }
                total
            })
            .collect();
        let mut total = SceneSummary::new(&bake.settings.layers);
        parts.iter().for_each(|part| total.add(part));
        Ok(total)
    })
}

/// From sums to bricks.
struct Writer {
    // Of each group.
    layers: Vec<Layers>,
    // 2^-e of each group.
    factors: Vec<f64>,
}

impl Writer {
    fn new(bake: &SceneBake<'_>) -> Result<Self> {
        let layers = bake.groups().iter().map(|g| Ok(g.layout(bake.layout)?.layers)).collect::<Result<Vec<_>>>()?;
        let of_luminaires = bake.geometry.exponents(bake.volume).into_iter().map(|e| libm::ldexp(1.0, -e));
        Ok(Self { layers, factors: [1.0, 1.0].into_iter().chain(of_luminaires).collect() })
    }

    fn blank(&self, bricks: &mut [Brick], t: usize) {
        for (brick, layers) in bricks.iter_mut().zip(&self.layers) {
            let (coefficients, errors) = (layers.coefficients(), layers.errors());
            brick.transfer[t * coefficients..(t + 1) * coefficients].fill(f16::ZERO);
            brick.stderr[t * errors..(t + 1) * errors].fill(f16::ZERO);
            (brick.validity[t], brick.rays[t]) = (0, 0);
        }
    }

    /// Writes what was found into texel `t` of the bricks, if there are any, and adds it to the totals.
    fn write(
        &self,
        found: &Found,
        rays: u32,
        mut into: Option<(&mut Vec<Brick>, usize, u8)>,
        clamped: bool,
        total: &mut SceneSummary,
    ) {
        let points = f64::from(rays / REPLICATES as u32);
        let summary = &mut total.summary;
        summary.valid += 1;
        summary.clamped += u64::from(clamped);
        summary.paths += u64::from(rays);
        summary.lost += u64::from(found.lost);
        summary.trapped += u64::from(found.trapped);
        for (g, layers) in self.layers.iter().enumerate() {
            let (coefficients, errors) = (layers.coefficients(), layers.errors());
            let sum = |r: usize, i: usize| match g {
                0 => found.environment[r * coefficients + i],
                _ => found.groups[((g - 1) * REPLICATES + r) * coefficients + i],
            };
            let mut brick = into.as_mut().map(|(bricks, t, flags)| {
                let brick = &mut bricks[g];
                (brick.validity[*t], brick.rays[*t]) = (*flags, rays);
                (brick, *t)
            });
            let mut escapes = [0.0; REPLICATES];
            let mut grey = 0;
            for (k, &bands) in layers.bands().iter().enumerate() {
                let (first, square) = (layers.offset(k), bands * bands);
                let mut squares = vec![0.0; bands];
                for i in 0..square {
                    let (mut of_channels, mut values) = ([0.0; 3], [0.0; REPLICATES]);
                    for (c, mean) in of_channels.iter_mut().enumerate() {
                        for (r, value) in values.iter_mut().enumerate() {
                            let one = sum(r, first + c * square + i) / points * self.factors[g];
                            *mean += one / REPLICATES as f64;
                            *value += one / 3.0;
                        }
                        if let Some((brick, t)) = &mut brick {
                            brick.transfer[*t * coefficients + first + c * square + i] = finite(*mean);
                        }
                    }
                    let mean = values.iter().sum::<f64>() / REPLICATES as f64;
                    let spread: f64 = values.iter().map(|v| (v - mean) * (v - mean)).sum();
                    squares[i.isqrt()] += spread / (REPLICATES * (REPLICATES - 1)) as f64;
                    match g {
                        0 => {
                            summary.transfer[grey] += mean;
                            grey += 1;
                            (0..REPLICATES).filter(|_| i == 0).for_each(|r| escapes[r] += values[r]);
                        }
                        1 => (0..3).for_each(|c| total.survival[3 * k + c] += of_channels[c]),
                        _ => {}
                    }
                }
                if let Some((brick, t)) = &mut brick {
                    for (l, sum) in squares.iter().enumerate() {
                        let error = (sum / (2 * l + 1) as f64).sqrt();
                        brick.stderr[*t * errors + layers.error_offset(k) + l] = finite(error);
                    }
                }
            }
            if g == 0 {
                let mean = escapes.iter().sum::<f64>() / REPLICATES as f64;
                let spread: f64 = escapes.iter().map(|v| (v - mean) * (v - mean)).sum();
                let variance = 4.0 * std::f64::consts::PI * spread / (REPLICATES * (REPLICATES - 1)) as f64;
                summary.escape_variance += variance;
                summary.errors.add(variance.sqrt() as f32);
            }
        }
    }
}

/// As 16 bits, cut at their largest number.
fn finite(value: f64) -> f16 {
    f16::from_f64(value.clamp(f64::from(f16::MIN), f64::from(f16::MAX)))
}
