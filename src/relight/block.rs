//! Eight texels at a time: the inner loops of contraction.
//!
//! Stored transfer has a texel's coefficients side by side. Here a block of texels is widened to f32 and turned, so
//! that each coefficient is one column of [`LANES`] numbers, and every step of the arithmetic is the same for all of
//! them. A lane does exactly the operations that a texel alone would do, in their order, with no fused multiply-add:
//! neither the block nor the width of the machine's registers can show in the result. The twin in the tests goes
//! through the texels one by one.
//!
//! The crate `multiversion` asks the processor once what it has; see [`super::contract`].

use glam::Vec4;
use half::f16;
use half::slice::HalfFloatSliceExt;

/// Texels in a block: one register of AVX2. Sixteen took as long.
pub(super) const LANES: usize = 8;

/// One number for each texel of a block.
pub(super) type Lanes = [f32; LANES];

/// A number for each lane.
#[inline(always)]
pub(super) fn each(mut value: impl FnMut(usize) -> f32) -> Lanes {
    let mut lanes = [0.0; LANES];
    for j in 0..LANES {
        lanes[j] = value(j);
    }
    lanes
}

/// The columns of a block: numbers `n·t … n·(t+1)` of `stored`, for each t of `texels`, turned.
#[inline(always)]
pub(super) fn columns(stored: &[f16], n: usize, texels: &[usize; LANES], out: &mut [Lanes]) {
    let mut part = [0.0; 64];
    for (j, &t) in texels.iter().enumerate() {
        let row = &stored[n * t..n * (t + 1)];
        for (row, out) in row.chunks(part.len()).zip(out.chunks_mut(part.len())) {
            let part = &mut part[..row.len()];
            row.convert_to_f32_slice(part);
            out.iter_mut().zip(part).for_each(|(column, value)| column[j] = *value);
        }
    }
}

/// Σ of columns with weights, for the four lanes of the weights: red, green, blue, and what the noise needs.
#[inline(always)]
pub(super) fn dot(columns: &[Lanes], weights: &[Vec4]) -> [Lanes; 4] {
    let mut sums = [[Vec4::ZERO; LANES / 4]; 4];
    for (column, weight) in columns.iter().zip(weights) {
        let column: [Vec4; LANES / 4] = bytemuck::cast(*column);
        for c in 0..4 {
            let weight = Vec4::splat(weight[c]);
            for q in 0..LANES / 4 {
                sums[c][q] += weight * column[q];
            }
        }
    }
    bytemuck::cast(sums)
}

/// The same with registers of 256 bits, and f16 widened by the processor.
#[cfg(target_arch = "x86_64")]
pub(super) mod wide {
    use super::{LANES, Lanes};
    use glam::Vec4;
    use half::f16;
    use std::arch::x86_64::{
        __m128i, __m256, _MM_HINT_T0, _mm_prefetch, _mm256_add_ps, _mm256_cvtph_ps, _mm256_mul_ps,
        _mm256_permute2f128_ps, _mm256_set1_ps, _mm256_setzero_ps, _mm256_shuffle_ps, _mm256_unpackhi_ps,
        _mm256_unpacklo_ps,
    };

    /// Numbers in a register.
    const EIGHT: usize = 8;

    /// Stored numbers in a line of the cache.
    const LINE: usize = 32;

    /// Asks for the numbers `n·t … n·(t+1)` of `stored`, for each t of `texels`, so that they are near when they are
    /// needed.
    #[target_feature(enable = "avx,avx2,f16c")]
    #[inline]
    pub(in super::super) fn fetch(stored: &[f16], n: usize, texels: &[usize]) {
        for &t in texels {
            for line in stored[n * t..n * (t + 1)].chunks(LINE) {
                _mm_prefetch::<_MM_HINT_T0>(line.as_ptr().cast());
            }
        }
    }

    /// As [`super::columns`].
    #[target_feature(enable = "avx,avx2,f16c")]
    #[inline]
    pub(in super::super) fn columns(stored: &[f16], n: usize, texels: &[usize; LANES], out: &mut [Lanes]) {
        if n < EIGHT {
            return super::columns(stored, n, texels, out);
        }
        let stored: &[u16] = bytemuck::cast_slice(stored);
        let mut first = 0;
        while first < n {
            // At the end some columns are made once more: the same bits.
            first = first.min(n - EIGHT);
            for half in 0..LANES / EIGHT {
                let mut rows = [_mm256_setzero_ps(); EIGHT];
                for j in 0..EIGHT {
                    let start = n * texels[EIGHT * half + j] + first;
                    let mut bits = [0u16; EIGHT];
                    bits.copy_from_slice(&stored[start..start + EIGHT]);
                    rows[j] = _mm256_cvtph_ps(bytemuck::cast::<_, __m128i>(bits));
                }
                let turned = turn(&rows);
                let out = &mut out[first..first + EIGHT];
                for i in 0..EIGHT {
                    let eight: [f32; EIGHT] = bytemuck::cast(turned[i]);
                    out[i][EIGHT * half..EIGHT * (half + 1)].copy_from_slice(&eight);
                }
            }
            first += EIGHT;
        }
    }

    /// Turns 8 × 8 numbers.
    #[target_feature(enable = "avx,avx2,f16c")]
    #[inline]
    fn turn(r: &[__m256; EIGHT]) -> [__m256; EIGHT] {
        // Pairs of rows, then fours within each half of the registers, then the halves. No closure: what is compiled
        // for more than the baseline is not inlined into generic code of other crates.
        let zero = _mm256_setzero_ps();
        let (mut pairs, mut fours, mut turned) = ([zero; EIGHT], [zero; EIGHT], [zero; EIGHT]);
        for i in [0, 2, 4, 6] {
            pairs[i] = _mm256_unpacklo_ps(r[i], r[i + 1]);
            pairs[i + 1] = _mm256_unpackhi_ps(r[i], r[i + 1]);
        }
        for i in [0, 4] {
            fours[i] = _mm256_shuffle_ps::<0x44>(pairs[i], pairs[i + 2]);
            fours[i + 1] = _mm256_shuffle_ps::<0xee>(pairs[i], pairs[i + 2]);
            fours[i + 2] = _mm256_shuffle_ps::<0x44>(pairs[i + 1], pairs[i + 3]);
            fours[i + 3] = _mm256_shuffle_ps::<0xee>(pairs[i + 1], pairs[i + 3]);
        }
        for i in 0..4 {
            turned[i] = _mm256_permute2f128_ps::<0x20>(fours[i], fours[i + 4]);
            turned[i + 4] = _mm256_permute2f128_ps::<0x31>(fours[i], fours[i + 4]);
        }
        turned
    }

    /// As [`super::dot`].
    #[target_feature(enable = "avx,avx2,f16c")]
    #[inline]
    pub(in super::super) fn dot(columns: &[Lanes], weights: &[Vec4]) -> [Lanes; 4] {
        let mut sums = [[_mm256_setzero_ps(); LANES / EIGHT]; 4];
        for (column, weight) in columns.iter().zip(weights) {
            let column: [__m256; LANES / EIGHT] = bytemuck::cast(*column);
            for c in 0..4 {
                let weight = _mm256_set1_ps(weight[c]);
                for half in 0..LANES / EIGHT {
                    sums[c][half] = _mm256_add_ps(sums[c][half], _mm256_mul_ps(weight, column[half]));
                }
            }
        }
        bytemuck::cast(sums)
    }
}
