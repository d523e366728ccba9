//! Where the level set of a texel starts: its isovalue, its normal, and whether it has one at all.

use super::{CellPoint, LevelField, Start};
use crate::geom::Normal;
use crate::volume::Sample;
use glam::Vec3;

/// The inner part of the local range that a texel's isovalue is clamped to.
///
/// At a local extreme of noisy or 8-bit data the level set through the texel is a closed speck
/// around it or nothing at all, and interpolating its transfer darkens the neighbourhood: clamping
/// brings the ambient error on noisy CT from 2.70 to 1.17 %, smooth data does not change.
const INNER_RANGE: f32 = 0.6;

/// A gradient below this fraction of the local range is no gradient. The range is that of the
/// 3³ neighbourhood, never of the volume: with the latter 97 % of the texels of an electron density
/// would be lost.
const FLAT: f32 = 1e-4;

/// How far a clamped start that lies in the solid may move out to its surface, in samples. The
/// isovalue is a value of the 3³ neighbourhood, so its surface is near, seldom beyond this.
const MOST_MOVED: f32 = 3.0;

/// The level set through a texel.
#[derive(Clone, Copy, Debug)]
pub struct Site {
    /// Where its rays start: the texel itself, or where a clamped one in the solid meets its surface.
    pub start: Start,
    /// Its isovalue, as a raw sample.
    pub isovalue: f32,
    /// Its normal in world space, towards the lit side.
    pub normal: Normal,
    /// Whether the isovalue was clamped to the inner part of the local range.
    pub clamped: bool,
}

impl<T: Sample> LevelField<'_, T> {
    /// The level set through a grid position; `None` where the neighbourhood is constant or the
    /// gradient vanishes.
    pub fn site(&self, position_in_grid: [f64; 3]) -> Option<Site> {
        let point = self.locate(position_in_grid);
        let (low, high) = self.local_range(&point);
        let range = high - low;
        if range <= 0.0 {
            return None;
        }
        let gradient = self.raw_gradient(&point);
        // Scaled first: the squares of a tiny gradient would vanish.
        let largest = gradient.abs().max_element();
        if largest <= 0.0 || (gradient / largest).length() * largest <= FLAT * range {
            return None;
        }
        let normal = Normal::down_gradient(self.gradient_in_world * gradient)?;
        let value = self.raw_value(&point);
        let margin = 0.5 * (1.0 - INNER_RANGE) * range;
        let isovalue = value.clamp(low + margin, high - margin);
        let clamped = isovalue != value;
        let start = match clamped {
            false => Start::on(point),
            true => self.surfaced(point, isovalue, normal).map_or(Start::beside(point), Start::on),
        };
        Some(Site { start, isovalue, normal, clamped })
    }

    /// A point of the isosurface of `isovalue` (as a raw sample) with its normal in world; `None` without a normal.
    pub fn site_on(&self, position_in_grid: [f32; 3], normal: [f32; 3], isovalue: f32) -> Option<Site> {
        // A normal points down a gradient.
        let normal = Normal::down_gradient(-Vec3::from_array(normal))?;
        let start = Start::on(self.locate(position_in_grid.map(f64::from)));
        Some(Site { start, isovalue, normal, clamped: false })
    }

    /// Where a start in the solid meets its surface along the normal; `None` for a start on the lit
    /// side, which is good where it is, and where the surface is not near.
    ///
    /// On a plateau of coarsely quantised data the surface lies some samples away, and rays that start
    /// that deep hardly ever come out within the cells that the tracer allows. Ambient error at 0.25
    /// levels a sample, of which all texels are clamped: sphere 8.0 → 2.1 %, bowl 8.0 → 4.0 %; at 0.5
    /// levels 1.48 → 1.43 % and 3.84 → 3.79 %. Moving starts on the lit side makes it worse.
    fn surfaced(&self, start: CellPoint, isovalue: f32, normal: Normal) -> Option<CellPoint> {
        const STEP: f32 = 0.25;
        const BISECTIONS: usize = 20;
        let along = self.direction_in_grid(normal.vec());
        let along = along / along.length();
        let from = start.in_grid();
        let at = |distance: f32| -> CellPoint {
            let p: Vec3 = from + along * distance;
            self.locate([f64::from(p.x), f64::from(p.y), f64::from(p.z)])
        };
        let solid = |point: &CellPoint| self.sign * (self.raw_value(point) - isovalue) > 0.0;
        if !solid(&start) {
            return None;
        }
        let mut outside = STEP;
        while solid(&at(outside)) {
            outside += STEP;
            if outside > MOST_MOVED {
                return None;
            }
        }
        let mut inside = outside - STEP;
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (inside + outside);
            if solid(&at(middle)) {
                inside = middle;
            } else {
                outside = middle;
            }
        }
        Some(at(outside))
    }

    /// Range of the raw samples in the 3³ neighbourhood of the sample nearest to a point.
    fn local_range(&self, point: &CellPoint) -> (f32, f32) {
        let span = |axis: usize| {
            let nearest = point.cell[axis] + i32::from(point.local[axis] > 0.5);
            let last = self.dims[axis] as i32 - 1;
            (nearest - 1).max(0) as usize..=(nearest + 1).min(last) as usize
        };
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for z in span(2) {
            for y in span(1) {
                for x in span(0) {
                    let v = self.samples[x + self.dims[0] * (y + self.dims[1] * z)].raw();
                    low = low.min(v);
                    high = high.max(v);
                }
            }
        }
        (low, high)
    }
}
