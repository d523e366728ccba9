//! The colours of texels.

use super::charts::Chart;
use super::pack::{Packing, extent};
use crate::error::Result;
use crate::export::nearest::{Nearest, nearest_in_triangle, place};
use crate::export::{ExportMesh, Image};
use glam::Vec3;
use rayon::prelude::*;

/// The picture of all charts.
pub(super) struct Picture {
    pub(super) image: Image,
    /// Share of the texels whose centre is on the surface.
    pub(super) covered: f64,
}

/// How far from a chart texels repeat its border.
const REACH: f32 = 3.0;

/// Colours of the texels of a chart, row by row; none far from it. And how many have their centre on it.
type Tile = (Vec<Option<[f32; 3]>>, usize);

/// Draws the charts of the mesh `shown`, in the colours of `original`, whose positions come with it.
///
/// # Errors
/// None, as long as the side of the packing is one of an [`Image`].
pub(super) fn fill(
    charts: &[Chart],
    packing: &Packing,
    shown: (&[Vec3], &[[u32; 3]]),
    (positions, original): (&[Vec3], &ExportMesh<'_>),
) -> Result<Picture> {
    let source = Source::new(shown, positions, original);
    let tiles: Vec<Tile> = charts.par_iter().map(|chart| tile(chart, packing, &source)).collect();
    let side = packing.side as usize;
    let mut texels: Vec<Option<[f32; 3]>> = vec![None; side * side];
    let mut covered = 0;
    for ((chart, origin), (tile, inside)) in charts.iter().zip(&packing.origins).zip(tiles) {
        let [width, _] = extent(chart.size, packing.scale).map(|n| n as usize);
        let [x, y] = origin.map(|o| o as usize);
        for (row, colours) in tile.chunks(width).enumerate() {
            let start = (y + row) * side + x;
            texels[start..start + width].copy_from_slice(colours);
        }
        covered += inside;
    }
    let pixels: Vec<[f32; 4]> = spread(texels, side).iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect();
    Ok(Picture { image: Image::new(side, side, pixels)?, covered: covered as f64 / (side * side) as f64 })
}

fn tile(chart: &Chart, packing: &Packing, source: &Source<'_>) -> Tile {
    let [width, height] = extent(chart.size, packing.scale).map(|n| n as usize);
    let mut nearest: Vec<Option<(f32, u32, [f32; 3])>> = vec![None; width * height];
    // In texels from the corner of the tile.
    let flat: Vec<Vec3> = chart.places.iter().map(|&p| packing.texels([0, 0], p).extend(0.0)).collect();
    for (corners, &triangle) in chart.corners.iter().zip(&chart.triangles) {
        let [a, b, c] = corners.map(|v| flat[v as usize]);
        let (low, high) = (a.min(b).min(c) - REACH, a.max(b).max(c) + REACH);
        let columns = low.x.max(0.0) as usize..(high.x.max(0.0) as usize).min(width);
        for y in low.y.max(0.0) as usize..(high.y.max(0.0) as usize).min(height) {
            for x in columns.clone() {
                let centre = Vec3::new(x as f32 + 0.5, y as f32 + 0.5, 0.0);
                let weights = nearest_in_triangle([a, b, c], centre);
                let squared = place([a, b, c], weights).distance_squared(centre);
                let best = &mut nearest[y * width + x];
                if squared <= REACH * REACH && best.is_none_or(|(least, ..)| squared < least) {
                    *best = Some((squared, triangle, weights));
                }
            }
        }
    }
    // Rounding leaves gaps between triangles: a hundredth of a texel is on the surface.
    let inside = nearest.iter().flatten().filter(|(squared, ..)| *squared < 1e-4).count();
    let colours = nearest.iter().map(|n| n.map(|(_, triangle, weights)| source.colour(triangle as usize, weights)));
    (colours.collect(), inside)
}

/// Where colours come from.
struct Source<'a> {
    positions: &'a [Vec3],
    triangles: &'a [[u32; 3]],
    original: &'a ExportMesh<'a>,
    // None where the mesh that is shown is the original.
    nearest: Option<(Nearest<'a>, Vec<Vec3>)>,
}

fn facing([a, b, c]: [Vec3; 3]) -> Vec3 {
    (b - a).cross(c - a)
}

impl<'a> Source<'a> {
    fn new(
        (positions, triangles): (&'a [Vec3], &'a [[u32; 3]]),
        of_original: &'a [Vec3],
        original: &'a ExportMesh<'a>,
    ) -> Self {
        let is_same = triangles == original.triangles && positions == of_original;
        let nearest = (!is_same).then(|| {
            let sides = original.triangles.iter().map(|t| facing(t.map(|v| of_original[v as usize]))).collect();
            (Nearest::new(of_original, original.triangles), sides)
        });
        Self { positions, triangles, original, nearest }
    }

    /// The colour of a point of the mesh that is shown: that of the original nearest to it on the same side of the
    /// solid, which may be thin.
    fn colour(&self, triangle: usize, weights: [f32; 3]) -> [f32; 3] {
        let (of, weights) = match &self.nearest {
            None => (triangle, weights),
            Some((nearest, sides)) => {
                let corners = self.triangles[triangle].map(|v| self.positions[v as usize]);
                let (point, side) = (place(corners, weights), facing(corners));
                let foot = nearest.foot_where(point, |t| sides[t].dot(side) > 0.0).or_else(|| nearest.foot(point));
                let Some(foot) = foot else { return [0.0; 3] };
                (foot.triangle, foot.weights)
            }
        };
        let corners = self.original.triangles[of].map(|v| self.original.colours[v as usize]);
        [0, 1, 2].map(|c| corners.iter().zip(weights).map(|(colour, w)| w * colour[c]).sum())
    }
}

/// Gives texels far from the surface the mean of what is around them, from ever coarser copies, for readers that make smaller
/// pictures of it.
fn spread(texels: Vec<Option<[f32; 3]>>, side: usize) -> Vec<[f32; 3]> {
    if side <= 1 {
        return texels.into_iter().map(Option::unwrap_or_default).collect();
    }
    let half = side.div_ceil(2);
    let coarse = (0..half * half).map(|i| {
        let (x, y) = (2 * (i % half), 2 * (i / half));
        let four = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
        let known = four.iter().filter(|(x, y)| *x < side && *y < side).filter_map(|(x, y)| texels[x + side * y]);
        let (sum, count) = known.fold((Vec3::ZERO, 0.0), |(sum, n), c| (sum + Vec3::from_array(c), n + 1.0));
        (count > 0.0).then(|| (sum / count).to_array())
    });
    let coarse = spread(coarse.collect(), half);
    let filled =
        texels.iter().enumerate().map(|(i, texel)| texel.unwrap_or(coarse[i % side / 2 + half * (i / side / 2)]));
    filled.collect()
}
