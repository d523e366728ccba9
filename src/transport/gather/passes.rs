//! The passes of a gather: what fills the cache, the final gather, and the sample that its bias is told from.

use super::super::bake::{Bake, Present, Progress, Sink, fill, fill_alone};
use super::super::estimator::{Alone, Estimator, Fate, WithinLevelSet, estimates_of, item_of};
use super::super::open::Openness;
use super::super::path::{Scratch, Settings, TexelEstimate, estimate as estimate_path};
use super::super::scene_path::Among;
use super::super::summary::Summary;
use super::super::sums::Real;
use super::ahead::{Ahead, width};
use super::bias::{self, Bias};
use super::cache::{Cache, EMPTY_ROW, Lookups, Tally, Values};
use super::estimate::Pass;
use super::{GatherSettings, Gathered, Stream, stream_seed};
use crate::error::Result;
use crate::level::{Counts, LevelField, Site};
use crate::scene::geometry::Geometry;
use crate::transfer::{BRICK_TEXELS, Layers, Layout};
use crate::volume::Sample;
use rayon::prelude::*;
use std::sync::atomic::Ordering;

/// What is gathered, and how.
pub(super) struct Asked<'a, 'f, 'v, T> {
    pub(super) field: &'f LevelField<'v, T>,
    pub(super) bake: &'a Bake<'a>,
    pub(super) settings: &'a GatherSettings,
    pub(super) chunks: &'a [[usize; 3]],
    pub(super) progress: &'a Progress,
    pub(super) present: &'a Present<'a>,
}

impl<T: Sample> Asked<'_, '_, '_, T> {
    /// All passes of a volume alone.
    pub(super) fn alone(&self, cached: &Layers, sink: &mut Sink<'_>) -> Result<Gathered> {
        let Self { field, bake, progress, .. } = *self;
        let (cache, mut gathered) = self.fill_alone(cached)?;
        if progress.cancel.load(Ordering::Relaxed) {
            return Ok(gathered);
        }
        let pass = Pass::new(&cache, cached, bake.settings.clone());
        let tally = Tally::default();
        let estimate = |site: &Site, item: u64, scratch: &mut Scratch, counts: &mut Counts, out: &mut TexelEstimate| {
            let mut lookups = Lookups::default();
            pass.estimate(field, site, item, scratch, counts, &mut lookups, out);
            tally.add(&lookups);
        };
        gathered.summary.add(&fill_alone(field, bake, &estimate, self.chunks, progress, self.present, sink)?);
        gathered.lookups += tally.total();
        if !progress.cancel.load(Ordering::Relaxed) {
            let (bias, work) = self.bias_alone(&cache, cached);
            gathered.bias = bias;
            gathered.summary.add(&work);
        }
        Ok(gathered)
    }

    /// The cache of a volume alone, and what it took.
    pub(super) fn fill_alone(&self, cached: &Layers) -> Result<(Cache, Gathered)> {
        let Self { field, bake, .. } = *self;
        let tally = Tally::default();
        let (cache, mut gathered) = self.fill(width(cached, None), |cache, pass, next| {
            let settings = self.of_pass(cached, pass);
            let gatherer = Pass::new(cache, cached, settings.clone());
            let estimate =
                |site: &Site, item: u64, scratch: &mut Scratch, counts: &mut Counts, out: &mut TexelEstimate| {
                    if pass == 0 {
                        return estimate_path(field, site, item, &settings, scratch, counts, out);
                    }
                    let mut lookups = Lookups::default();
                    gatherer.estimate(field, site, item, scratch, counts, &mut lookups, out);
                    tally.add(&lookups);
                };
            let openness = Openness::unasked(bake.volume, field);
            let estimator = Alone { field, openness, settings: &settings, estimate: &estimate };
            Ok(self.one_pass(&estimator, cache, pass, next))
        })?;
        gathered.lookups = tally.total();
        Ok((cache, gathered))
    }

    pub(super) fn bias_alone(&self, cache: &Cache, cached: &Layers) -> (Bias, Summary) {
        let Self { field, bake, .. } = *self;
        let all = bias::settings(bake.settings);
        let gatherers = [0, 1].map(|i| Pass::new(cache, cached, all[i].clone()));
        let gathered = |i: usize| {
            let pass = &gatherers[i];
            move |site: &Site, item: u64, scratch: &mut Scratch, counts: &mut Counts, out: &mut TexelEstimate| {
                pass.estimate(field, site, item, scratch, counts, &mut Lookups::default(), out);
            }
        };
        let traced = |i: usize| {
            let settings = &all[i];
            move |site: &Site, item: u64, scratch: &mut Scratch, counts: &mut Counts, out: &mut TexelEstimate| {
                estimate_path(field, site, item, settings, scratch, counts, out);
            }
        };
        let (gathered, traced) = ([gathered(0), gathered(1)], [traced(2), traced(3)]);
        let estimates: [&WithinLevelSet<'_>; 4] = [&gathered[0], &gathered[1], &traced[0], &traced[1]];
        let estimators = [0, 1, 2, 3].map(|i| Alone {
            field,
            openness: Openness::unasked(bake.volume, field),
            settings: &all[i],
            estimate: estimates[i],
        });
        let ambient = |out: &[TexelEstimate]| bias::ambient(&out[0].transfer, &bake.settings.layers);
        self.bias(cache, &estimators, &ambient)
    }

    /// All passes among walls, luminaires and other volumes.
    pub(super) fn among(&self, cached: &Layers, geometry: &Geometry, sink: &mut Sink<'_>) -> Result<Gathered> {
        let Self { field, bake, progress, .. } = *self;
        let (cache, mut gathered) = self.fill_among(cached, geometry)?;
        if progress.cancel.load(Ordering::Relaxed) {
            return Ok(gathered);
        }
        let ahead = Ahead::new(&cache, cached, &bake.settings.layers, (bake.volume, geometry));
        let estimator = Among::new(bake, field, geometry)?.with(&ahead);
        gathered.summary.add(&fill(&estimator, bake, self.chunks, progress, self.present, sink)?);
        gathered.lookups += ahead.lookups();
        if !progress.cancel.load(Ordering::Relaxed) {
            let (bias, work) = self.bias_among(&cache, &ahead, geometry)?;
            gathered.bias = bias;
            gathered.summary.add(&work);
        }
        Ok(gathered)
    }

    /// The cache of all groups, and what it took. Light that only photons find is not in it: they bring it to every layer.
    fn fill_among(&self, cached: &Layers, geometry: &Geometry) -> Result<(Cache, Gathered)> {
        let Self { field, bake, .. } = *self;
        let layout = Layout { lattice: bake.layout.lattice, layers: cached.clone() };
        let mut lookups = Lookups::default();
        let (cache, mut gathered) = self.fill(width(cached, Some(geometry)), |cache, pass, next| {
            let settings = self.of_pass(cached, pass);
            let request = Bake { layout: &layout, settings: &settings, specular: None, ..*bake };
            let ahead = Ahead::new(cache, cached, cached, (bake.volume, geometry));
            let paths = Among::new(&request, field, geometry)?;
            let estimator = if pass == 0 { paths } else { paths.with(&ahead) };
            let done = self.one_pass(&estimator, cache, pass, next);
            lookups += ahead.lookups();
            Ok(done)
        })?;
        gathered.lookups = lookups;
        Ok((cache, gathered))
    }

    fn bias_among(&self, cache: &Cache, ahead: &Ahead<'_>, geometry: &Geometry) -> Result<(Bias, Summary)> {
        let Self { field, bake, .. } = *self;
        let all = bias::settings(bake.settings);
        let requests = [0, 1, 2, 3].map(|i| Bake { settings: &all[i], ..*bake });
        let [a, b, c, d] = &requests;
        let of = |request| Among::new(request, field, geometry);
        let estimators = [of(a)?.with(ahead), of(b)?.with(ahead), of(c)?, of(d)?];
        let exponents = geometry.exponents(bake.volume);
        let lit = |out: &[TexelEstimate<f64>]| bias::lit(out, &bake.settings.layers, &exponents);
        Ok(self.bias(cache, &estimators, &lit))
    }

    /// A sample of texels by two gathers and two path tracers.
    fn bias<E: Estimator>(
        &self,
        cache: &Cache,
        estimators: &[E; 4],
        figure: &bias::Figure<'_, E::Real>,
    ) -> (Bias, Summary) {
        let (lattice, count) = (&self.bake.layout.lattice, self.settings.bias_texels as usize);
        let texels = bias::pick(cache, lattice, self.bake.settings.seed, count);
        let (sample, mut work) = bias::sample(estimators, lattice, &texels, figure);
        // Paths that are cut there are not those of the estimate.
        (work.scene.cut, work.scene.lost_specular, work.scene.lost_turns) = (0, 0, 0);
        (Bias::of(&sample), work)
    }

    /// All passes but the final gather.
    fn fill(
        &self,
        width: usize,
        mut one_pass: impl FnMut(&Cache, u32, &mut Values) -> Result<(Vec<bool>, Summary)>,
    ) -> Result<(Cache, Gathered)> {
        let mut cache = Cache::new(self.bake.selection, width, self.settings.precision);
        let mut next = cache.blank();
        let mut gathered = Gathered::default();
        for pass in 0..self.settings.passes - 1 {
            let (valid, work) = one_pass(&cache, pass, &mut next)?;
            cache.replace_rows(&mut next, valid);
            if pass == 0 && self.settings.passes > 2 {
                // The first pass read nothing, so until here there was one copy.
                next = cache.blank();
            }
            gathered.summary.add(&work);
            if self.progress.cancel.load(Ordering::Relaxed) {
                break;
            }
        }
        Ok((cache, gathered))
    }

    /// Settings of a pass that fills the cache.
    fn of_pass(&self, cached: &Layers, pass: u32) -> Settings {
        let seed = stream_seed(self.bake.settings.seed, Stream::Pass(pass));
        Settings { layers: cached.clone(), rays: self.settings.cache_rays, seed, ..self.bake.settings.clone() }
    }

    /// One pass over the bricks of the cache; its mean with the passes before goes to `next`.
    fn one_pass<E: Estimator>(
        &self,
        estimator: &E,
        cache: &Cache,
        pass: u32,
        next: &mut Values,
    ) -> (Vec<bool>, Summary) {
        let Self { bake, progress, .. } = *self;
        let (lattice, width) = (&bake.layout.lattice, cache.width());
        let newest = 1.0 / (pass + 1) as f32;
        let mut valid = vec![false; cache.valid().len()];
        let results: Vec<Summary> = next
            .parts(BRICK_TEXELS * width)
            .into_par_iter()
            .zip(valid.par_chunks_mut(BRICK_TEXELS))
            .with_max_len(1)
            .enumerate()
            .map_init(E::Scratch::default, |scratch, (slot, (mut values, valid))| {
                let mut summary = Summary::default();
                if progress.cancel.load(Ordering::Relaxed) {
                    return summary;
                }
                let (mut out, mut row, mut halves) = (estimates_of(estimator), Vec::with_capacity(width), EMPTY_ROW);
                for t in 0..BRICK_TEXELS {
                    let texel = lattice.texel_in_brick(cache.bricks()[slot], t);
                    if !bake.selection.contains(texel) {
                        continue;
                    }
                    let Some(site) = estimator.site(lattice.grid_from_texel(texel)) else { continue };
                    if estimator.estimate(&site, item_of(bake, texel), scratch, &mut summary, &mut out) == Fate::Buried
                    {
                        continue;
                    }
                    row.clear();
                    row.extend(out.iter().flat_map(|group| &group.transfer).map(|v| v.as_f32()));
                    if pass > 0 {
                        row.iter_mut().for_each(|v| *v *= newest);
                        cache.add_texel(slot, t, 1.0 - newest, &mut row, &mut halves);
                    }
                    values.store(t * width, &row);
                    valid[t] = true;
                }
                progress.rays.fetch_add(summary.counts.rays, Ordering::Relaxed);
                summary
            })
            .collect();
        (valid, bias::work_of(&results))
    }
}
