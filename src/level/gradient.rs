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
use glam::{Mat4, Vec3, Vec4};

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
    #[inline(always)]
    pub fn raw_gradient(&self, at: &CellPoint) -> Vec3 {
        let x = AxisWeights::new(at.cell.x, at.local.x, self.dims[0]);
        let y = AxisWeights::new(at.cell.y, at.local.y, self.dims[1]);
        let z = AxisWeights::new(at.cell.z, at.local.z, self.dims[2]);
        match [x.count, y.count, z.count] {
            [4, 4, 4] => self.gradient_inside(&x, &y, &z),
            _ => self.gradient_by_sample(&x, &y, &z),
        }
    }

    /// Gradient of the trilinear field in the cell of a point, in grid space, per sample step.
    #[inline(always)]
    pub fn trilinear_gradient(&self, at: &CellPoint) -> Vec3 {
        let (low, high) = self.shifted_rows().corners(self.sample_index(&at.cell.to_array()));
        let Vec3 { x, y, z } = at.local;
        // Lanes (y, z) = 00, 10, 01, 11.
        let (slope, value) = (high - low, low + (high - low) * x);
        let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
        Vec3::new(
            mix(mix(slope.x, slope.y, y), mix(slope.z, slope.w, y), z),
            mix(value.y - value.x, value.w - value.z, z),
            mix(value.z - value.x, value.w - value.y, y),
        )
    }

    /// From any numbers of samples.
    #[cold]
    fn gradient_by_sample(&self, x: &AxisWeights, y: &AxisWeights, z: &AxisWeights) -> Vec3 {
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

    /// From 4³ samples: as [`Self::gradient_by_sample`], the four slices in the lanes of vectors, bit for bit.
    #[inline(always)]
    fn gradient_inside(&self, x: &AxisWeights, y: &AxisWeights, z: &AxisWeights) -> Vec3 {
        let slice = self.dims[0] * self.dims[1];
        let (mut dx, mut dy, mut v) = (Vec4::ZERO, Vec4::ZERO, Vec4::ZERO);
        for j in 0..4 {
            let first = x.first + self.dims[0] * (y.first + j + self.dims[1] * z.first);
            let row = |k: usize| {
                let row = &self.samples[first + k * slice..first + k * slice + 4];
                Vec4::new(row[0].raw(), row[1].raw(), row[2].raw(), row[3].raw())
            };
            // Columns: a sample of all four slices.
            let raw = Mat4::from_cols(row(0), row(1), row(2), row(3)).transpose();
            let (mut value, mut slope) = (Vec4::ZERO, Vec4::ZERO);
            for i in 0..4 {
                value += raw.col(i) * x.value[i];
                slope += raw.col(i) * x.slope[i];
            }
            dx += slope * y.value[j];
            dy += value * y.slope[j];
            v += value * y.value[j];
        }
        let mut gradient = Vec3::ZERO;
        for k in 0..4 {
            gradient += Vec3::new(z.value[k] * dx[k], z.value[k] * dy[k], z.slope[k] * v[k]);
        }
        gradient
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Affine;
    use crate::level::Pyramid;
    use crate::volume::{Samples, Volume};
    use glam::{DVec3, IVec3};

    #[test]
    fn the_trilinear_gradient_is_the_difference_of_its_field() {
        let number = |i: usize, k: usize| ((i * 7919 + k * 104_729) % 10_007) as f32 / 10_007.0;
        let samples: Vec<f32> = (0..5 * 4 * 3).map(|i| number(i, 1) - 0.5).collect();
        let affine = Affine::from_spacing(DVec3::ONE, DVec3::ZERO).expect("invertible");
        let volume = Volume::new([5, 4, 3], Samples::F32(samples.clone()), affine).expect("finite");
        let pyramid = Pyramid::new(&volume);
        let field = LevelField::new(&volume, &samples, &pyramid);
        for i in 0..200 {
            let cell = IVec3::new((i % 4) as i32, (i / 4 % 3) as i32, (i / 12 % 2) as i32);
            let local = Vec3::new(number(i, 2), number(i, 3), number(i, 4));
            let found = field.trilinear_gradient(&CellPoint { cell, local });
            for a in 0..3 {
                // Along one axis the field is linear: the difference over the whole cell is the derivative.
                let at = |end: f32| {
                    let mut local = local;
                    local[a] = end;
                    field.raw_value(&CellPoint { cell, local })
                };
                // Samples are at most 1/2 in size: a dozen roundings of 2^-24.
                assert!((found[a] - (at(1.0) - at(0.0))).abs() < 12.0 * 6e-8, "{cell} {local}: {found}");
            }
        }
    }

    #[test]
    fn four_slices_at_once_give_the_bits_of_sample_by_sample() {
        let number = |i: usize, k: usize| ((i * 7919 + k * 104_729) % 10_007) as f32 / 10_007.0;
        let samples: Vec<f32> = (0..9 * 8 * 7).map(|i| (number(i, 1) - 0.5) * 1e3).collect();
        let affine = Affine::from_spacing(DVec3::ONE, DVec3::ZERO).expect("invertible");
        let volume = Volume::new([9, 8, 7], Samples::F32(samples.clone()), affine).expect("finite");
        let pyramid = Pyramid::new(&volume);
        let field = LevelField::new(&volume, &samples, &pyramid);
        for i in 0..500 {
            let cell = [1 + i % 6, 1 + i / 6 % 5, 1 + i / 30 % 4].map(|c| c as i32);
            let local = Vec3::new(number(i, 2), number(i, 3), number(i, 4));
            let axis = |a: usize| AxisWeights::new(cell[a], local[a], field.dims[a]);
            let (x, y, z) = (axis(0), axis(1), axis(2));
            assert_eq!([x.count, y.count, z.count], [4; 3]);
            let expected = field.gradient_by_sample(&x, &y, &z).to_array().map(f32::to_bits);
            let found = field.raw_gradient(&CellPoint { cell: IVec3::from_array(cell), local });
            assert_eq!(found.to_array().map(f32::to_bits), expected);
        }
    }
}
