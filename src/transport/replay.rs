//! The paths of one texel again, one by one.

use super::REPLICATES;
use super::path::{Alive, PointsTaken, Settings, continuation};
use crate::geom::Frame;
use crate::level::{Counts, LevelField, Outcome, Site};
use crate::sampling::{PathSampler, warp};
use crate::volume::Sample;

/// One path of a texel, step by step: for finding out why a texel is what it is.
#[derive(Clone, Debug, PartialEq)]
pub struct ReplayedPath {
    /// Replicate and number of the path in it.
    pub replicate: usize,
    /// Point set index.
    pub path: u32,
    /// Grid positions of the texel and of the hits; one is repeated where a ray was lost.
    pub vertices_in_grid: Vec<[f32; 3]>,
    /// World direction of the last ray.
    pub last_direction_in_world: [f32; 3],
    /// "escaped", "trapped" (after the last stored layer), or "lost" (at a hit without a normal before
    /// the last layer).
    pub ended: &'static str,
}

/// Traces the paths of one texel again, from the same numbers, and reports each.
///
/// With a target a texel may have got fewer paths than `settings.rays`: these are the first of each replicate.
pub fn replay<T: Sample>(field: &LevelField<'_, T>, site: &Site, item: u64, settings: &Settings) -> Vec<ReplayedPath> {
    let points = settings.points();
    let mut counts = Counts::default();
    let mut all = Vec::with_capacity(REPLICATES * points);
    for replicate in 0..REPLICATES {
        let sampler = PathSampler::new(settings.seed, item, replicate as u32);
        let first_record = all.len();
        all.extend((0..points as u32).map(|path| ReplayedPath {
            replicate,
            path,
            vertices_in_grid: vec![site.start.at.in_grid().to_array()],
            last_direction_in_world: [0.0; 3],
            ended: "trapped",
        }));
        // Bounce by bounce, because the points that a path takes depend on which paths are left.
        let mut taken = PointsTaken::default();
        let at_texel = Alive { point: 0, start: site.start, normal: site.normal };
        let mut alive: Vec<(usize, Alive)> = (0..points).map(|path| (first_record + path, at_texel)).collect();
        for k in 0..settings.layers.len() {
            let mut left = Vec::new();
            for (index, mut path) in alive {
                path.point = taken.point_for(k, path.point);
                let local = warp::square_to_cosine_hemisphere(sampler.pair(path.point, k as u32));
                let direction = Frame::around(path.normal).from_local(local);
                let record: &mut ReplayedPath = &mut all[index];
                record.last_direction_in_world = direction.to_array();
                let in_grid = field.direction_in_grid(direction);
                let outcome = field.trace(site.isovalue, &path.start, in_grid, &mut counts);
                match continuation(field, &path, outcome) {
                    Some(next) => {
                        record.vertices_in_grid.push(next.start.at.in_grid().to_array());
                        left.push((index, next));
                    }
                    None if outcome == Outcome::Escaped => record.ended = "escaped",
                    None if k + 1 < settings.layers.len() => record.ended = "lost",
                    None => {}
                }
            }
            alive = left;
        }
    }
    all
}
