//! One texel of one pass: a path that ends where the cache has transfer.

use super::super::REPLICATES;
use super::super::path::{Scratch, Settings, TexelEstimate};
use super::super::sums::combine_paths;
use super::cache::{Cache, EMPTY_ROW, Lookups, Row, Span, spans};
use crate::geom::{Frame, Normal};
use crate::level::{CellPoint, Counts, LevelField, Outcome, Site, Start};
use crate::sampling::{PathSampler, warp};
use crate::sh;
use crate::transfer::Layers;
use crate::volume::Sample;

/// What the texels of one pass share.
pub(super) struct Pass<'a> {
    cache: &'a Cache,
    settings: Settings,
    // What a hit adds, by the number of bounces before it.
    spans: Vec<Vec<Span>>,
}

impl<'a> Pass<'a> {
    /// A pass that estimates the layers of `settings` from the cache, which holds the layers `cached`.
    pub(super) fn new(cache: &'a Cache, cached: &Layers, settings: Settings) -> Self {
        let layers = &settings.layers;
        let spans = (0..layers.len()).map(|depth| spans(layers, cached, depth)).collect();
        Self { cache, settings, spans }
    }

    /// Estimates the transfer of one texel; `item` is its linear index in the lattice.
    ///
    /// The first rays and the sum of those that escape are those of the estimator `path` under the
    /// same seed: layer 0 has the same bits.
    pub(super) fn estimate<T: Sample>(
        &self,
        field: &LevelField<'_, T>,
        site: &Site,
        item: u64,
        scratch: &mut Scratch,
        counts: &mut Counts,
        lookups: &mut Lookups,
        out: &mut TexelEstimate,
    ) {
        let layers = &self.settings.layers;
        let coefficients = layers.coefficients();
        scratch.zero_sums(&self.settings);
        let mut row = EMPTY_ROW;
        (out.lost, out.trapped) = (0, 0);
        let frame = Frame::around(site.normal);
        for replicate in 0..REPLICATES {
            let sampler = PathSampler::new(self.settings.seed, item, replicate as u32);
            let sequence = sampler.sequence(0);
            let sums = &mut scratch.sums[replicate * coefficients..][..coefficients];
            scratch.escaped[replicate].clear();
            scratch.blocked[replicate].clear();
            scratch.normals[replicate].clear();
            scratch.normals[replicate].push(site.normal.vec());
            for path in 0..self.settings.points() as u32 {
                let direction = frame.from_local(warp::square_to_cosine_hemisphere(sequence.point(path)));
                let (at, normal) =
                    match field.trace(site.isovalue, &site.start, field.direction_in_grid(direction), counts) {
                        Outcome::Escaped => {
                            scratch.escaped[replicate].push(direction);
                            continue;
                        }
                        // A hit of distance 0, as in `path`.
                        Outcome::Lost => {
                            out.lost += 1;
                            (site.start.at, Some(site.normal))
                        }
                        Outcome::Hit(hit) => (hit.at, None),
                    };
                if !self.cache.add(&at, &self.spans[0], sums, &mut row, lookups) {
                    self.go_on(field, site, (at, normal), &sampler, path, sums, &mut row, counts, lookups, out);
                }
                scratch.blocked[replicate].push(direction);
            }
        }
        scratch.add_rays(0, &self.settings);
        let points = self.settings.points();
        combine_paths(&self.settings, scratch, points, 1, out);
        out.rays = (points * REPLICATES) as u32;
    }

    /// Follows a path from a hit where the cache has nothing until it has, or the path ends; its normal is known where that
    /// is the start itself.
    #[cold]
    fn go_on<T: Sample>(
        &self,
        field: &LevelField<'_, T>,
        site: &Site,
        (mut at, mut known): (CellPoint, Option<Normal>),
        sampler: &PathSampler,
        path: u32,
        sums: &mut [f32],
        row: &mut Row,
        counts: &mut Counts,
        lookups: &mut Lookups,
        out: &mut TexelEstimate,
    ) {
        let layers = &self.settings.layers;
        for depth in 1..layers.len() {
            let Some(normal) = known.or_else(|| field.hit_normal(&at)) else {
                out.lost += 1;
                return;
            };
            let local = warp::square_to_cosine_hemisphere(sampler.pair(path, depth as u32));
            let direction = Frame::around(normal).from_local(local);
            match field.trace(site.isovalue, &Start::on(at), field.direction_in_grid(direction), counts) {
                Outcome::Escaped => {
                    sh::basis::accumulate(layers.bands()[depth], &[direction], &mut sums[layers.offset(depth)..]);
                    return;
                }
                // It goes on from the same place about the same normal.
                Outcome::Lost => (out.lost, known) = (out.lost + 1, Some(normal)),
                Outcome::Hit(hit) => (at, known) = (hit.at, None),
            }
            if self.cache.add(&at, &self.spans[depth], sums, row, lookups) {
                return;
            }
        }
        out.trapped += 1;
    }
}
