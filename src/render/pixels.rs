//! What each pixel of a picture sees of a level set, for pictures of anything that is known at points.

use super::Camera;
use super::preview::{clip_box, enter};
use crate::level::{Counts, LevelField, Outcome, Pyramid, Start};
use crate::volume::{Volume, with_samples};
use rayon::prelude::*;

/// A point of a surface that a pixel sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenPoint {
    /// Where, in grid space.
    pub position_in_grid: [f32; 3],
    /// Unit normal in world axes, towards the lit side.
    pub normal: [f32; 3],
}

/// Where the rays through the middles of the pixels meet the level set of `isovalue` (a value of the file), row by row from
/// the top; `None` where they do not, and where they enter the box inside the solid or meet a point without a
/// normal.
pub fn seen_points(
    volume: &Volume,
    pyramid: &Pyramid,
    isovalue: f64,
    camera: &Camera,
    width: usize,
    height: usize,
) -> Vec<Option<SeenPoint>> {
    let mut pixels = vec![None; width * height];
    let raw = volume.raw_from_value(isovalue) as f32;
    let (clip, grid_from_world) = (clip_box(volume), volume.world_from_grid().inverse());
    let aspect = width as f64 / height as f64;
    with_samples!(volume.samples(), s => {
        let field = LevelField::new(volume, s, pyramid);
        pixels.par_chunks_mut(width).with_max_len(1).enumerate().for_each(|(y, row)| {
            for (x, pixel) in row.iter_mut().enumerate() {
                let px = (x as f64 + 0.5) / width as f64 * 2.0 - 1.0;
                let py = 1.0 - (y as f64 + 0.5) / height as f64 * 2.0;
                let (origin, direction) = camera.ray(px, py, aspect);
                let origin = grid_from_world.point(origin);
                let direction = grid_from_world.vector(direction).normalize();
                let Some((entry, _)) = enter(&clip, origin, direction) else { continue };
                let at = field.locate(entry.to_array());
                if field.sign() * (field.raw_value(&at) - raw) > 0.0 {
                    continue;
                }
                let start = Start::beside(at);
                if let Outcome::Hit(hit) = field.trace(raw, &start, direction.as_vec3(), &mut Counts::default())
                    && let Some(normal) = field.normal(&hit.at)
                {
                    let position_in_grid = hit.at.in_grid().to_array();
                    *pixel = Some(SeenPoint { position_in_grid, normal: normal.vec().to_array() });
                }
            }
        });
    });
    pixels
}
