//! Sixteen texels at a time: the inner loops of contraction.
//!
//! Stored transfer has a texel's coefficients side by side. Here a block of texels is turned, so that each coefficient
//! is one column of [`LANES`] numbers, and every step of the arithmetic is the same for all of them. A lane does exactly
//! the operations that a texel alone would do, in their order. Products are summed by fused multiply-add, which rounds
//! once and so gives the same bits everywhere (a processor that has none does it in software, which is slow); nothing
//! else is fused. So neither the block nor the width of the machine's registers can show in the result. The twin in the
//! tests goes through the texels one by one.
//!
//! The crate `multiversion` asks the processor once what it has; see [`super::contract`].

use glam::Vec4;
use half::f16;
use half::slice::HalfFloatSliceExt;

/// Texels in a block: one register of AVX-512, two of AVX2.
pub(super) const LANES: usize = 16;

/// One number for each texel of a block.
pub(super) type Lanes = [f32; LANES];

/// One stored number for each texel of a block.
pub(super) type Column = [f16; LANES];

/// The columns of a block: numbers `n·t … n·(t+1)` of `stored`, for each t of `texels`, turned.
#[inline(always)]
pub(super) fn columns(stored: &[f16], n: usize, texels: &[usize; LANES], out: &mut [Column]) {
    for (j, &t) in texels.iter().enumerate() {
        let row = &stored[n * t..n * (t + 1)];
        out.iter_mut().zip(row).for_each(|(column, value)| column[j] = *value);
    }
}

/// A column in f32.
#[inline(always)]
pub(super) fn widen(column: &Column) -> Lanes {
    let mut lanes = [0.0; LANES];
    column.convert_to_f32_slice(&mut lanes);
    lanes
}

/// Σ of columns with weights, for the four lanes of the weights: red, green, blue, and what the noise needs. The sum
/// over even columns and that over odd ones are added last, so that additions wait less for each other.
#[inline(always)]
pub(super) fn dot(columns: &[Column], weights: &[Vec4]) -> [Lanes; 4] {
    let mut sums = [[[0.0f32; LANES]; 4]; 2];
    for (i, (column, weight)) in columns.iter().zip(weights).enumerate() {
        let column = widen(column);
        for c in 0..4 {
            for j in 0..LANES {
                sums[i % 2][c][j] = weight[c].mul_add(column[j], sums[i % 2][c][j]);
            }
        }
    }
    let [mut all, odd] = sums;
    for c in 0..4 {
        for j in 0..LANES {
            all[c][j] += odd[c][j];
        }
    }
    all
}

/// The same with registers of 256 and 512 bits, and f16 widened by the processor.
#[cfg(target_arch = "x86_64")]
pub(super) mod wide {
    use super::{Column, LANES, Lanes};
    use glam::Vec4;
    use half::f16;
    use std::arch::x86_64::{
        __m128i, __m256i, _MM_HINT_T0, _mm_prefetch, _mm256_add_ps, _mm256_cvtph_ps, _mm256_fmadd_ps, _mm256_set_m128i,
        _mm256_set1_ps, _mm256_setzero_ps, _mm256_setzero_si256, _mm256_unpackhi_epi16, _mm256_unpackhi_epi32,
        _mm256_unpackhi_epi64, _mm256_unpacklo_epi16, _mm256_unpacklo_epi32, _mm256_unpacklo_epi64, _mm512_add_ps,
        _mm512_cvtph_ps, _mm512_fmadd_ps, _mm512_set1_ps, _mm512_setzero_ps,
    };

    /// Columns turned together, and numbers of a row in half a register.
    const EIGHT: usize = 8;

    /// Stored numbers in a line of the cache.
    const LINE: usize = 32;

    /// Asks for stored numbers, so that they are near when they are needed.
    #[target_feature(enable = "avx,avx2,f16c,fma")]
    #[inline]
    pub(in super::super) fn fetch(stored: &[f16]) {
        for line in stored.chunks(LINE) {
            _mm_prefetch::<_MM_HINT_T0>(line.as_ptr().cast());
        }
    }

    /// As [`super::columns`].
    #[target_feature(enable = "avx,avx2,f16c,fma")]
    #[inline]
    pub(in super::super) fn columns(stored: &[f16], n: usize, texels: &[usize; LANES], out: &mut [Column]) {
        if n < EIGHT {
            return super::columns(stored, n, texels, out);
        }
        // Rows by eights, and the last eight once more, where they are not a multiple: the same bits.
        let mut eights: [&[[f16; EIGHT]]; LANES] = [&[]; LANES];
        let mut ends = [&[f16::ZERO; EIGHT]; LANES];
        for j in 0..LANES {
            let row = &stored[n * texels[j]..][..n];
            eights[j] = &row.as_chunks().0[..n / EIGHT];
            ends[j] = row.last_chunk().unwrap_or(ends[j]);
        }
        let out = &mut out[..n];
        let outs = &mut out.as_chunks_mut::<EIGHT>().0[..n / EIGHT];
        for i in 0..n / EIGHT {
            let mut rows = [&[f16::ZERO; EIGHT]; LANES];
            for j in 0..LANES {
                rows[j] = &eights[j][i];
            }
            outs[i] = turn(&rows);
        }
        if let (1.., Some(out)) = (n % EIGHT, out.last_chunk_mut()) {
            *out = turn(&ends);
        }
    }

    /// Turns sixteen rows of eight.
    #[target_feature(enable = "avx,avx2,f16c,fma")]
    #[inline]
    fn turn(rows: &[&[f16; EIGHT]; LANES]) -> [Column; EIGHT] {
        // The eight rows of each half of the registers: pairs of rows, then fours, then eights. No closure: what is
        // compiled for more than the baseline is not inlined into generic code of other crates.
        let zero = _mm256_setzero_si256();
        let [mut r, mut pairs, mut fours, mut turned] = [[zero; EIGHT]; 4];
        for j in 0..EIGHT {
            r[j] = _mm256_set_m128i(bytemuck::cast(*rows[j + EIGHT]), bytemuck::cast(*rows[j]));
        }
        for i in 0..4 {
            pairs[i] = _mm256_unpacklo_epi16(r[2 * i], r[2 * i + 1]);
            pairs[i + 4] = _mm256_unpackhi_epi16(r[2 * i], r[2 * i + 1]);
        }
        // Of `pairs`, columns 0 to 3 are in the first four, 4 to 7 in the others.
        for i in [0, 2, 4, 6] {
            fours[i] = _mm256_unpacklo_epi32(pairs[i], pairs[i + 1]);
            fours[i + 1] = _mm256_unpackhi_epi32(pairs[i], pairs[i + 1]);
        }
        // Of `fours`, columns 0 and 1 are in the first (rows 0 to 3) and the third (4 to 7), 2 and 3 in those after.
        for i in [0, 4] {
            turned[i] = _mm256_unpacklo_epi64(fours[i], fours[i + 2]);
            turned[i + 1] = _mm256_unpackhi_epi64(fours[i], fours[i + 2]);
            turned[i + 2] = _mm256_unpacklo_epi64(fours[i + 1], fours[i + 3]);
            turned[i + 3] = _mm256_unpackhi_epi64(fours[i + 1], fours[i + 3]);
        }
        bytemuck::cast::<[__m256i; EIGHT], _>(turned)
    }

    /// As [`super::widen`].
    #[target_feature(enable = "avx,avx2,f16c,fma")]
    #[inline]
    pub(in super::super) fn widen(column: &Column) -> Lanes {
        let [low, high]: [__m128i; 2] = bytemuck::cast(*column);
        bytemuck::cast([_mm256_cvtph_ps(low), _mm256_cvtph_ps(high)])
    }

    /// As [`super::dot`], for registers of 256 bits: one half of the texels after the other, as many sums as there is
    /// room for.
    #[target_feature(enable = "avx,avx2,f16c,fma")]
    #[inline]
    pub(in super::super) fn dot(columns: &[Column], weights: &[Vec4]) -> [Lanes; 4] {
        let mut all = [[_mm256_setzero_ps(); 2]; 4];
        let (pairs, last) = columns.as_chunks::<2>();
        let (weight_pairs, last_weight) = weights.as_chunks::<2>();
        for half in 0..2 {
            let mut sums = [[_mm256_setzero_ps(); 4]; 2];
            for (pair, weights) in pairs.iter().zip(weight_pairs) {
                for i in 0..2 {
                    let column = _mm256_cvtph_ps(bytemuck::cast::<_, [__m128i; 2]>(pair[i])[half]);
                    for c in 0..4 {
                        sums[i][c] = _mm256_fmadd_ps(_mm256_set1_ps(weights[i][c]), column, sums[i][c]);
                    }
                }
            }
            for (column, weight) in last.iter().zip(last_weight) {
                let column = _mm256_cvtph_ps(bytemuck::cast::<_, [__m128i; 2]>(*column)[half]);
                for c in 0..4 {
                    sums[0][c] = _mm256_fmadd_ps(_mm256_set1_ps(weight[c]), column, sums[0][c]);
                }
            }
            for c in 0..4 {
                all[c][half] = _mm256_add_ps(sums[0][c], sums[1][c]);
            }
        }
        bytemuck::cast(all)
    }

    /// As [`super::dot`], for registers of 512 bits.
    #[target_feature(enable = "avx,avx2,f16c,fma,avx512f")]
    #[inline]
    pub(in super::super) fn dot_512(columns: &[Column], weights: &[Vec4]) -> [Lanes; 4] {
        let mut sums = [[_mm512_setzero_ps(); 4]; 2];
        let (pairs, last) = columns.as_chunks::<2>();
        let (weight_pairs, last_weight) = weights.as_chunks::<2>();
        for (pair, weights) in pairs.iter().zip(weight_pairs) {
            for i in 0..2 {
                let column = _mm512_cvtph_ps(bytemuck::cast(pair[i]));
                for c in 0..4 {
                    sums[i][c] = _mm512_fmadd_ps(_mm512_set1_ps(weights[i][c]), column, sums[i][c]);
                }
            }
        }
        for (column, weight) in last.iter().zip(last_weight) {
            let column = _mm512_cvtph_ps(bytemuck::cast(*column));
            for c in 0..4 {
                sums[0][c] = _mm512_fmadd_ps(_mm512_set1_ps(weight[c]), column, sums[0][c]);
            }
        }
        let mut all = [_mm512_setzero_ps(); 4];
        for c in 0..4 {
            all[c] = _mm512_add_ps(sums[0][c], sums[1][c]);
        }
        bytemuck::cast(all)
    }
}
