//! The gradient that normals are made of.
//!
//! At lattice points it is the gradient of the uniform cubic B-spline through the samples taken as
//! control points, *without prefilter*: weights 1/6, 4/6, 1/6 across and −1/2, 0, 1/2 along each
//! axis. Between lattice points it is trilinear. Both steps are separable, so one evaluation is a
//! tensor product of four weights along each axis over 4³ samples. Beyond the border samples are
//! extrapolated linearly, which folds into the weights. The lack of a prefilter smooths, which is
//! the point: 8-bit data gives normals 1.9° off in the median, against 4.0° by central differences.

use super::{CellPoint, LevelField};
use crate::volume::Sample;
use glam::Vec3;

/// Four weights along one axis, for the value and for the derivative, and the first sample.
struct AxisWeights {
    first: usize,
    count: usize,
    value: [f32; 4],
    slope: [f32; 4],
}

impl AxisWeights {
    /// Weights at local position `t` of cell `c` on an axis of `n` ≥ 2 samples.
    #[inline(always)]
    fn new(c: i32, t: f32, n: usize) -> Self {
        let s = 1.0 - t;
        const SIXTH: f32 = 1.0 / 6.0;
        // Samples c−1, c, c+1, c+2.
        let value = [s * SIXTH, (4.0 * s + t) * SIXTH, (s + 4.0 * t) * SIXTH, t * SIXTH];
        let slope = [-0.5 * s, -0.5 * t, 0.5 * s, 0.5 * t];
        if c >= 1 && (c as usize) + 2 < n {
            return Self { first: c as usize - 1, count: 4, value, slope };
        }
        Self::folded(c, n, value, slope)
    }

    /// The same where a sample is missing: sample(−1) = 2·sample(0) − sample(1), and so at the end.
    #[cold]
    fn folded(c: i32, n: usize, value: [f32; 4], slope: [f32; 4]) -> Self {
        let first = (c - 1).max(0) as usize;
        let last = ((c + 2) as usize).min(n - 1);
        let mut out = Self { first, count: last - first + 1, value: [0.0; 4], slope: [0.0; 4] };
        for k in 0..4 {
            let i = c - 1 + k as i32;
            let targets: [(usize, f32); 2] = if i < 0 {
                [(0, 2.0), (1, -1.0)]
            } else if i as usize >= n {
                [(n - 1, 2.0), (n - 2, -1.0)]
            } else {
                [(i as usize, 1.0), (i as usize, 0.0)]
            };
            for (index, factor) in targets {
                out.value[index - first] += factor * value[k];
                out.slope[index - first] += factor * slope[k];
            }
        }
        out
    }
}

impl<T: Sample> LevelField<'_, T> {
    /// Gradient of the raw field in grid space, per sample step.
    pub fn raw_gradient(&self, at: &CellPoint) -> Vec3 {
        let x = AxisWeights::new(at.cell.x, at.local.x, self.dims[0]);
        let y = AxisWeights::new(at.cell.y, at.local.y, self.dims[1]);
        let z = AxisWeights::new(at.cell.z, at.local.z, self.dims[2]);
        let mut gradient = Vec3::ZERO;
        for k in 0..z.count {
            // Per slice: x-derivative, y-derivative and value.
            let (mut dx, mut dy, mut v) = (0.0, 0.0, 0.0);
            for j in 0..y.count {
                let row = x.first + self.dims[0] * (y.first + j + self.dims[1] * (z.first + k));
                let (mut value, mut slope) = (0.0, 0.0);
                for (i, sample) in self.samples[row..row + x.count].iter().enumerate() {
                    let raw = sample.raw();
                    value += x.value[i] * raw;
                    slope += x.slope[i] * raw;
                }
                dx += y.value[j] * slope;
                dy += y.slope[j] * value;
                v += y.value[j] * value;
            }
            gradient += Vec3::new(z.value[k] * dx, z.value[k] * dy, z.slope[k] * v);
        }
        gradient
    }
}
