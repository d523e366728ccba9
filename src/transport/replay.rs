//! The paths of one texel again, one by one.

use super::REPLICATES;
use super::path::{Settings, continuation};
use crate::geom::Frame;
use crate::level::{Counts, LevelField, Outcome, Site, Start};
use crate::sampling::{PathSampler, warp};
use crate::volume::Sample;

/// One path of a texel, step by step: for finding out why a texel is what it is.
#[derive(Clone, Debug, PartialEq)]
pub struct ReplayedPath {
    /// Replicate and number of the path in it.
    pub replicate: usize,
    /// Point set index.
    pub path: u32,
    /// Grid positions of the texel and of the hits.
    pub vertices_in_grid: Vec<[f32; 3]>,
    /// World direction of the last ray.
    pub last_direction_in_world: [f32; 3],
    /// "escaped", "lost" or "trapped".
    pub ended: &'static str,
}

/// Traces the paths of one texel again, from the same numbers, and reports each.
pub fn replay<T: Sample>(field: &LevelField<'_, T>, site: &Site, item: u64, settings: &Settings) -> Vec<ReplayedPath> {
    let points = settings.points();
    let mut counts = Counts::default();
    let mut all = Vec::new();
    for replicate in 0..REPLICATES {
        let sampler = PathSampler::new(settings.seed, item, replicate as u32);
        for path in 0..points {
            let (mut start, mut normal) = (site.start, site.normal);
            let mut record = ReplayedPath {
                replicate,
                path: path as u32,
                vertices_in_grid: vec![start.at.in_grid().to_array()],
                last_direction_in_world: [0.0; 3],
                ended: "trapped",
            };
            for k in 0..settings.layers.len() {
                let variates = sampler.pair(path as u32, k as u32);
                let direction = Frame::around(normal).from_local(warp::square_to_cosine_hemisphere(variates));
                record.last_direction_in_world = direction.to_array();
                let outcome = field.trace(site.isovalue, &start, field.direction_in_grid(direction), &mut counts);
                if outcome == Outcome::Escaped {
                    record.ended = "escaped";
                    break;
                }
                let Some((at, next)) = continuation(field, outcome) else {
                    record.ended = "lost";
                    break;
                };
                record.vertices_in_grid.push(at.in_grid().to_array());
                (start, normal) = (Start::on(at), next);
            }
            all.push(record);
        }
    }
    all
}
