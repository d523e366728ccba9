//! Samples of a grid as a leaf. In place of a subtree: cubic between them (Catmull and Rom 1974), constant beyond; the function
//! has a continuous gradient, creases of what was sampled are lost. Of a volume: linear between them, as everywhere else, and
//! one number beyond.

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
    // Of the samples.
    range: Interval,
    between: Between,
    is_zero_beyond: bool,
    // Least and largest sample of each block, those on its upper faces included.
    blocks: Vec<[f32; 2]>,
}

/// What the function is off the samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Between {
    /// Cubic between them, constant beyond.
    Cubic,
    /// Linear between them, this number beyond.
    Linear(f64),
}

impl Between {
    /// How far it may lie outside of the range of the samples around, per half of that range: (5/4)³ of cubics.
    fn overshoot(self) -> f64 {
        if self == Self::Cubic { 1.953125 } else { 1.0 }
    }
}

/// Part of the box by which a point may lie outside of it and count as on its face: maps to the box and back round it.
const BORDER: f64 = 1e-9;

/// Samples along the side of a block.
const BLOCK: usize = 8;

/// Most samples, or blocks, that are looked at for the range in a box.
const MOST_LOOKED_AT: usize = 1 << 13;

impl Grid {
    /// A grid; `None` where the numbers do not fit.
    pub fn new(dims: [usize; 3], values: Vec<f32>, bounds: Bounds, between: Between) -> Option<Self> {
        let count = dims.iter().try_fold(1usize, |n, &d| n.checked_mul(d))?;
        let fits = dims.iter().all(|&d| d >= 2) && count == values.len() && bounds.size().min_element() > 0.0;
        if !fits {
            return None;
        }
        let counts = dims.map(|d| (d - 1).div_ceil(BLOCK));
        let mut blocks = Vec::with_capacity(counts.iter().product());
        for block in grid3::all(counts) {
            let size = std::array::from_fn(|a| (dims[a] - BLOCK * block[a]).min(BLOCK + 1));
            let of_block = grid3::all(size).map(|place| {
                let at: [usize; 3] = std::array::from_fn(|a| BLOCK * block[a] + place[a]);
                values[grid3::index([dims[0], dims[1]], at)]
            });
            blocks.push(ends(of_block));
        }
        let range = range(blocks.iter().copied(), between);
        let on_face = |at: [usize; 3]| (0..3).any(|a| at[a] == 0 || at[a] + 1 == dims[a]);
        let is_zero_beyond = match between {
            Between::Cubic => grid3::all(dims).zip(&values).all(|(at, value)| *value == 0.0 || !on_face(at)),
            Between::Linear(beyond) => beyond == 0.0,
        };
        Some(Self { dims, values, bounds, range, between, is_zero_beyond, blocks })
    }

    /// The box.
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    /// Whether the value is 0 outside of the box.
    pub fn is_zero_beyond(&self) -> bool {
        self.is_zero_beyond
    }

    /// Where all values lie.
    pub fn range(&self) -> Interval {
        match self.between {
            Between::Cubic => self.range,
            Between::Linear(beyond) => Interval::new(self.range.low.min(beyond), self.range.high.max(beyond)),
        }
    }

    /// Where the values in a box lie.
    pub fn range_in(&self, region: &Region) -> Interval {
        if !region.half.is_finite() {
            return self.range();
        }
        let (mut low, mut high) = ([0; 3], [0; 3]);
        let mut is_inside = true;
        for axis in 0..3 {
            let last = (self.dims[axis] - 1) as f64;
            let scale = last / self.bounds.size()[axis];
            let ends = [-1.0, 1.0].map(|side| region.centre[axis] + side * region.half[axis]);
            let at = |v: f64| (v - self.bounds.min[axis]) * scale;
            // A point at the very margin may be taken for either side.
            is_inside &= at(ends[0]) >= -0.5 * BORDER * last && at(ends[1]) <= last * (1.0 + 0.5 * BORDER);
            let ends = ends.map(|v| at(v).clamp(0.0, last));
            low[axis] = (ends[0].floor() as usize).saturating_sub(2);
            high[axis] = (ends[1].floor() as usize + 3).min(self.dims[axis] - 1);
        }
        let count = |low: [usize; 3], high: [usize; 3]| (0..3).map(|a| high[a] - low[a] + 1).product::<usize>();
        let all = |low: [usize; 3], high: [usize; 3]| {
            let size: [usize; 3] = std::array::from_fn(|a| high[a] - low[a] + 1);
            grid3::all(size).map(move |place| std::array::from_fn(|a| low[a] + place[a]))
        };
        let counts = self.dims.map(|d| (d - 1).div_ceil(BLOCK));
        let blocks = [low.map(|v| v / BLOCK), std::array::from_fn(|a| (high[a] / BLOCK).min(counts[a] - 1))];
        let inner = if count(low, high) <= MOST_LOOKED_AT {
            range(all(low, high).map(|place| [self.at(place); 2]), self.between)
        } else if count(blocks[0], blocks[1]) <= MOST_LOOKED_AT {
            let block = |place| self.blocks[grid3::index([counts[0], counts[1]], place)];
            range(all(blocks[0], blocks[1]).map(block), self.between)
        } else {
            self.range
        };
        match self.between {
            Between::Linear(beyond) if !is_inside => Interval::new(inner.low.min(beyond), inner.high.max(beyond)),
            _ => inner,
        }
    }

    fn at(&self, place: [usize; 3]) -> f32 {
        self.values[grid3::index([self.dims[0], self.dims[1]], place)]
    }

    /// The value at a point.
    pub fn value<S: Scalar>(&self, p: Point<S>) -> S {
        match self.between {
            Between::Cubic => self.interpolated(p, 1, cubic),
            Between::Linear(beyond) => {
                let at = DVec3::from_array(p.map(S::value));
                let margin = BORDER * self.bounds.size();
                let is_inside = at.cmpge(self.bounds.min - margin).all() && at.cmple(self.bounds.max + margin).all();
                if is_inside { self.interpolated(p, 0, |t| [S::of(1.0) - t, t]) } else { S::of(beyond) }
            }
        }
    }

    /// From the samples around, of which `before` lie before the cell along each axis, by their weights.
    fn interpolated<S: Scalar, const N: usize>(&self, p: Point<S>, before: usize, of: impl Fn(S) -> [S; N]) -> S {
        let mut weights = [[S::of(0.0); N]; 3];
        let mut cells = [0; 3];
        for axis in 0..3 {
            let last = (self.dims[axis] - 1) as f64;
            let at = p[axis].plus(-self.bounds.min[axis]).scaled(last / self.bounds.size()[axis]).clamped(0.0, last);
            let cell = (at.value().floor() as usize).min(self.dims[axis] - 2);
            cells[axis] = cell;
            weights[axis] = of(at.plus(-(cell as f64)));
        }
        let near = |axis: usize, i: usize| (cells[axis] + i).saturating_sub(before).min(self.dims[axis] - 1);
        let mut sum = S::of(0.0);
        for k in 0..N {
            let mut plane = S::of(0.0);
            for j in 0..N {
                let mut row = S::of(0.0);
                for i in 0..N {
                    row = row + weights[0][i].scaled(f64::from(self.at([near(0, i), near(1, j), near(2, k)])));
                }
                plane = plane + row * weights[1][j];
            }
            sum = sum + plane * weights[2][k];
        }
        sum
    }
}

fn ends(values: impl Iterator<Item = f32>) -> [f32; 2] {
    values.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
}

/// Where values between samples lie, from the ends of parts of these.
fn range(parts: impl Iterator<Item = [f32; 2]>, between: Between) -> Interval {
    let [low, high] = parts.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], p| [low.min(p[0]), high.max(p[1])]);
    let [low, high] = [low, high].map(f64::from);
    if low == 0.0 && high == 0.0 {
        return Interval::at(0.0);
    }
    let (middle, half) = (0.5 * (low + high), 0.5 * (high - low) * between.overshoot());
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
