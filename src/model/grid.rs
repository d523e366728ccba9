//! Samples of a grid as a leaf: cubic between them (Catmull and Rom 1974), constant beyond. The function has a continuous
//! gradient; creases of what was sampled are lost.

use super::interval::Interval;
use super::scalar::{Point, Scalar};
use super::warp::Region;
use crate::geom::Bounds;
use crate::grid3;
use glam::DVec3;

/// Samples on a box, the first and last of each axis on its faces.
#[derive(Clone, Debug)]
pub struct Grid {
    // Invariant: dims.product() == values.len(), each at least 2.
    dims: [usize; 3],
    values: Vec<f32>,
    bounds: Bounds,
    range: Interval,
}

/// How far cubics may lie outside of the range of their samples, per half of that range: (5/4)³.
const OVERSHOOT: f64 = 1.953125;
/// Most samples that are looked at for the range in a box.
const MOST_LOOKED_AT: usize = 1 << 13;

impl Grid {
    /// A grid; `None` where the numbers do not fit.
    pub fn new(dims: [usize; 3], values: Vec<f32>, bounds: Bounds) -> Option<Self> {
        let count = dims.iter().try_fold(1usize, |n, &d| n.checked_mul(d))?;
        let fits = dims.iter().all(|&d| d >= 2) && count == values.len() && bounds.size().min_element() > 0.0;
        let range = range(values.iter().copied());
        fits.then_some(Self { dims, values, bounds, range })
    }

    /// The box.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Where all values lie.
    pub fn range(&self) -> Interval {
        self.range
    }

    /// Where the values in a box lie.
    pub fn range_in(&self, region: &Region) -> Interval {
        let (mut low, mut high) = ([0; 3], [0; 3]);
        let mut count = 1;
        for axis in 0..3 {
            let scale = (self.dims[axis] - 1) as f64 / self.bounds.size()[axis];
            let at = |v: f64| ((v - self.bounds.min[axis]) * scale).clamp(0.0, (self.dims[axis] - 1) as f64);
            let ends = [region.centre[axis] - region.half[axis], region.centre[axis] + region.half[axis]].map(at);
            low[axis] = (ends[0].floor() as usize).saturating_sub(2);
            high[axis] = (ends[1].floor() as usize + 3).min(self.dims[axis] - 1);
            count *= high[axis] - low[axis] + 1;
        }
        if count > MOST_LOOKED_AT || !region.half.is_finite() {
            return self.range;
        }
        let size: [usize; 3] = std::array::from_fn(|a| high[a] - low[a] + 1);
        range(grid3::all(size).map(|place| self.at(std::array::from_fn(|a| low[a] + place[a]))))
    }

    fn at(&self, place: [usize; 3]) -> f32 {
        self.values[grid3::index([self.dims[0], self.dims[1]], place)]
    }

    /// The value at a point.
    pub fn value<S: Scalar>(&self, p: Point<S>) -> S {
        let mut weights = [[S::of(0.0); 4]; 3];
        let mut cells = [0; 3];
        for axis in 0..3 {
            let last = (self.dims[axis] - 1) as f64;
            let at = p[axis].plus(-self.bounds.min[axis]).scaled(last / self.bounds.size()[axis]).clamped(0.0, last);
            let cell = (at.value().floor() as usize).min(self.dims[axis] - 2);
            cells[axis] = cell;
            weights[axis] = cubic(at.plus(-(cell as f64)));
        }
        let near = |axis: usize, i: usize| (cells[axis] + i).saturating_sub(1).min(self.dims[axis] - 1);
        let mut sum = S::of(0.0);
        for k in 0..4 {
            let mut plane = S::of(0.0);
            for j in 0..4 {
                let mut row = S::of(0.0);
                for i in 0..4 {
                    row = row + weights[0][i].scaled(f64::from(self.at([near(0, i), near(1, j), near(2, k)])));
                }
                plane = plane + row * weights[1][j];
            }
            sum = sum + plane * weights[2][k];
        }
        sum
    }
}

fn range(values: impl Iterator<Item = f32>) -> Interval {
    let (low, high) =
        values.map(f64::from).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    if low == 0.0 && high == 0.0 {
        return Interval::at(0.0);
    }
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low) * OVERSHOOT);
    Interval::new(middle - half, middle + half).around(1e-11 * low.abs().max(high.abs()))
}

/// The weights of four samples at a place between the second and the third.
fn cubic<S: Scalar>(t: S) -> [S; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        (t2.scaled(2.0) - t - t3).scaled(0.5),
        (t3.scaled(3.0) - t2.scaled(5.0)).plus(2.0).scaled(0.5),
        (t2.scaled(4.0) + t - t3.scaled(3.0)).scaled(0.5),
        (t3 - t2).scaled(0.5),
    ]
}

/// The differences of two functions at points that a hash scatters in a box: the largest and the root of the mean square.
pub fn difference(bounds: &Bounds, count: u64, f: impl Fn(DVec3) -> f64, g: impl Fn(DVec3) -> f64) -> [f64; 2] {
    let (mut most, mut sum) = (0.0f64, 0.0);
    for i in 0..count {
        let p = bounds.min + bounds.size() * scattered(i);
        let d = f(p) - g(p);
        most = most.max(d.abs());
        sum += d * d;
    }
    [most, (sum / count.max(1) as f64).sqrt()]
}

/// The point of the unit cube with a number (the mixing of SplitMix64, Steele et al. 2014).
pub fn scattered(number: u64) -> DVec3 {
    let hash = |axis: u64| {
        let mut z = (3 * number + axis + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    };
    DVec3::new(hash(0), hash(1), hash(2))
}
