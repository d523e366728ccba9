//! Which samples are solid, one bit each, and which cells the surface crosses. Everything else in
//! this module takes its signs from here, so the parts cannot disagree.

use crate::volume::{Sample, Volume, with_samples};
use multiversion::{multiversion, target::match_target};
use rayon::prelude::*;

/// One bit for each sample, set where it is solid; rows padded to whole words.
pub(super) struct Signs {
    pub dims: [usize; 3],
    words_per_row: usize,
    words: Vec<u64>,
}

/// The test "solid_sign·(raw − c_raw) > 0" as a comparison in the type of [`Sample::raw`].
///
/// For f32 numbers r, r > c is the same as r > (the largest f32 ≤ c): no isovalue between two
/// samples is lost to rounding. Likewise r < c with the smallest f32 ≥ c.
#[derive(Clone, Copy)]
struct Threshold {
    bound: f32,
    above: bool,
}

impl Threshold {
    fn new(c_raw: f64, solid_sign: f32) -> Self {
        let nearest = c_raw as f32;
        let above = solid_sign > 0.0;
        let bound = if above && f64::from(nearest) > c_raw {
            nearest.next_down()
        } else if !above && f64::from(nearest) < c_raw {
            nearest.next_up()
        } else {
            nearest
        };
        Self { bound, above }
    }

    /// One bit for each sample of a row.
    fn fill_row<S: Sample>(self, row: &[S], words: &mut [u64]) {
        fill_row(self, row, words);
    }
}

/// Comparisons round nothing: every variant gives the same bits.
#[multiversion(targets("x86_64+avx+avx2"))]
fn fill_row<S: Sample>(threshold: Threshold, row: &[S], words: &mut [u64]) {
    let bound = threshold.bound;
    let (full, rest) = row.as_chunks::<64>();
    let (first, last) = words.split_at_mut(full.len());
    match_target! {
        "x86_64+avx+avx2" => wide::pack(threshold, full, first),
        _ => if threshold.above { pack(full, first, |r| r > bound) } else { pack(full, first, |r| r < bound) },
    }
    for word in last {
        let is_solid = |s: &S| if threshold.above { s.raw() > bound } else { s.raw() < bound };
        *word = rest.iter().enumerate().fold(0, |word, (i, s)| word | u64::from(is_solid(s)) << i);
    }
}

#[inline(always)]
fn pack<S: Sample>(row: &[[S; 64]], words: &mut [u64], is_solid: impl Fn(f32) -> bool) {
    for (word, samples) in words.iter_mut().zip(row) {
        *word = 0;
        for (i, eight) in samples.as_chunks::<8>().0.iter().enumerate() {
            let flags = u64::from_le_bytes(eight.map(|s| u8::from(is_solid(s.raw()))));
            // Gathers the lowest bit of each byte in the highest byte, first sample lowest.
            *word |= (flags.wrapping_mul(0x0102_0408_1020_4080) >> 56) << (8 * i);
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod wide {
    use super::Threshold;
    use crate::volume::Sample;
    use std::arch::x86_64::{__m256, _CMP_GT_OQ, _CMP_LT_OQ, _mm256_cmp_ps, _mm256_movemask_ps, _mm256_set1_ps};

    /// As [`super::pack`], eight comparisons at a time.
    #[target_feature(enable = "avx,avx2")]
    #[inline]
    pub(super) fn pack<S: Sample>(threshold: Threshold, row: &[[S; 64]], words: &mut [u64]) {
        let bound = _mm256_set1_ps(threshold.bound);
        for (word, samples) in words.iter_mut().zip(row) {
            *word = 0;
            for i in 0..8 {
                let mut eight = [0.0f32; 8];
                for k in 0..8 {
                    eight[k] = samples[8 * i + k].raw();
                }
                let eight: __m256 = bytemuck::cast(eight);
                let solid = if threshold.above {
                    _mm256_cmp_ps::<_CMP_GT_OQ>(eight, bound)
                } else {
                    _mm256_cmp_ps::<_CMP_LT_OQ>(eight, bound)
                };
                *word |= u64::from(_mm256_movemask_ps(solid) as u32) << (8 * i);
            }
        }
    }
}

impl Signs {
    pub fn new<S: Sample>(dims: [usize; 3], samples: &[S], c_raw: f64, solid_sign: f32) -> Self {
        let words_per_row = dims[0].div_ceil(64);
        let threshold = Threshold::new(c_raw, solid_sign);
        let mut words = vec![0; words_per_row * dims[1] * dims[2]];
        words.par_chunks_mut(words_per_row * dims[1]).zip(samples.par_chunks(dims[0] * dims[1])).for_each(
            |(words, plane)| {
                for (words, row) in words.chunks_mut(words_per_row).zip(plane.chunks(dims[0])) {
                    threshold.fill_row(row, words);
                }
            },
        );
        Self { dims, words_per_row, words }
    }

    pub fn row(&self, y: usize, z: usize) -> &[u64] {
        &self.words[(y + self.dims[1] * z) * self.words_per_row..][..self.words_per_row]
    }

    /// Calls back with the x of each crossed edge along `axis` that starts in row (y, z), in
    /// ascending order. The edges must exist.
    #[inline(always)]
    pub fn for_each_crossing(&self, axis: usize, y: usize, z: usize, mut edge_at: impl FnMut(usize)) {
        self.for_each_crossing_word(axis, y, z, |i, word| for_each_bit(word, |b| edge_at(64 * i + b)));
    }

    /// Number of crossed edges along `axis` that start in row (y, z).
    pub fn count_crossings(&self, axis: usize, y: usize, z: usize) -> u64 {
        let mut count = 0;
        self.for_each_crossing_word(axis, y, z, |_, word| count += u64::from(word.count_ones()));
        count
    }

    #[inline(always)]
    fn for_each_crossing_word(&self, axis: usize, y: usize, z: usize, mut with: impl FnMut(usize, u64)) {
        let here = self.row(y, z);
        if axis == 0 {
            for i in 0..here.len() {
                with(i, (here[i] ^ next_along_x(here, i)) & self.cell_mask(i));
            }
        } else {
            let other = if axis == 1 { self.row(y + 1, z) } else { self.row(y, z + 1) };
            for i in 0..here.len() {
                with(i, here[i] ^ other[i]);
            }
        }
    }

    /// The bits of word `i` of a row of cells (one fewer than samples).
    #[inline(always)]
    fn cell_mask(&self, i: usize) -> u64 {
        let cells = self.dims[0] - 1;
        match cells.saturating_sub(64 * i) {
            left if left >= 64 => !0,
            left => (1 << left) - 1,
        }
    }

    /// For each word of the row of cells (y, z): its index, the mask of crossed cells and the
    /// eight words whose bits are the corners' signs; words without a crossed cell are skipped.
    #[inline(always)]
    fn for_each_crossed_word(&self, y: usize, z: usize, mut with: impl FnMut(usize, u64, &[u64; 8])) {
        let rows = [self.row(y, z), self.row(y + 1, z), self.row(y, z + 1), self.row(y + 1, z + 1)];
        for i in 0..self.words_per_row {
            let mut corners = [0; 8];
            for (k, row) in rows.iter().enumerate() {
                corners[2 * k] = row[i];
                corners[2 * k + 1] = next_along_x(row, i);
            }
            let any = corners.iter().fold(0, |a, w| a | w);
            let all = corners.iter().fold(!0, |a, w| a & w);
            let crossed = any & !all & self.cell_mask(i);
            if crossed != 0 {
                with(i, crossed, &corners);
            }
        }
    }

    /// Calls back with x and the pattern of solid corners of each crossed cell of a row, in order.
    #[inline(always)]
    pub fn for_each_crossed_cell(&self, y: usize, z: usize, mut cell_at: impl FnMut(usize, u8)) {
        self.for_each_crossed_word(y, z, |i, crossed, corners| {
            for_each_bit(crossed, |b| {
                let pattern = (0..8).fold(0u8, |p, k| p | ((corners[k] >> b & 1) as u8) << k);
                cell_at(64 * i + b, pattern);
            });
        });
    }
}

/// The signs of the right neighbours of the samples in word `i`.
#[inline(always)]
fn next_along_x(row: &[u64], i: usize) -> u64 {
    row[i] >> 1 | row.get(i + 1).map_or(0, |next| next << 63)
}

#[inline(always)]
fn for_each_bit(mut word: u64, mut with: impl FnMut(usize)) {
    while word != 0 {
        with(word.trailing_zeros() as usize);
        word &= word - 1;
    }
}

/// The cells of a volume that a level set crosses: those with solid and with lit corners, and so
/// exactly those in which [`super::extract`] puts triangles.
///
/// Cell (x, y, z) has the corners (x, y, z) to (x+1, y+1, z+1); there is one fewer along each axis
/// than there are samples.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StraddlingCells {
    cells: [usize; 3],
    words_per_row: usize,
    words: Vec<u64>, // Invariant: bits at and beyond cells[0] of a row are 0.
}

impl StraddlingCells {
    /// Number of cells along x, y, z.
    pub fn dims(&self) -> [usize; 3] {
        self.cells
    }

    /// Number of crossed cells.
    pub fn count(&self) -> u64 {
        self.words.iter().map(|w| u64::from(w.count_ones())).sum()
    }

    /// Whether cell (x, y, z) is crossed.
    ///
    /// # Panics
    /// When there is no such cell.
    pub fn contains(&self, x: usize, y: usize, z: usize) -> bool {
        assert!(x < self.cells[0] && y < self.cells[1] && z < self.cells[2], "no cell ({x}, {y}, {z})");
        self.row(y, z)[x / 64] >> (x % 64) & 1 == 1
    }

    /// The bits of the row of cells (y, z): cell x is bit x mod 64 of word x / 64; the bits beyond
    /// the last cell are 0.
    ///
    /// # Panics
    /// When there is no such row.
    pub fn row(&self, y: usize, z: usize) -> &[u64] {
        assert!(y < self.cells[1] && z < self.cells[2], "no row of cells ({y}, {z})");
        &self.words[(y + self.cells[1] * z) * self.words_per_row..][..self.words_per_row]
    }

    /// Calls back with every crossed cell of the slab of cells `z`, x fastest.
    ///
    /// # Panics
    /// When there is no such slab.
    pub fn for_each_in_slab(&self, z: usize, mut cell_at: impl FnMut(usize, usize)) {
        for y in 0..self.cells[1] {
            for (i, &word) in self.row(y, z).iter().enumerate() {
                for_each_bit(word, |b| cell_at(64 * i + b, y));
            }
        }
    }
}

/// The cells of `volume` that the level set of `isovalue` (in the file's values) crosses. None for
/// an isovalue that is not a number or out of range, and for a grid without cells.
pub fn straddling_cells(volume: &Volume, isovalue: f64) -> StraddlingCells {
    let dims = volume.dims();
    let cells = dims.map(|d| d - 1);
    let words_per_row = cells[0].div_ceil(64);
    let mut words = vec![0u64; words_per_row * cells[1] * cells[2]];
    if !words.is_empty() && isovalue.is_finite() {
        let c_raw = volume.raw_from_value(isovalue);
        let signs = with_samples!(volume.samples(), s => Signs::new(dims, s, c_raw, volume.solid_sign()));
        words.par_chunks_mut(words_per_row * cells[1]).enumerate().for_each(|(z, slab)| {
            for (y, row) in slab.chunks_mut(words_per_row).enumerate() {
                signs.for_each_crossed_word(y, z, |i, crossed, _| row[i] = crossed);
            }
        });
    }
    StraddlingCells { cells, words_per_row, words }
}

/// Slabs of cells that are counted at a time: a plane of samples is looked at twice where two parts meet.
const SLABS: usize = 8;

/// How many cells the level set of `isovalue` crosses: as [`straddling_cells`] counts, with a few planes of bits at a time in the place
/// of one of the whole volume.
pub(crate) fn count_straddling_cells(volume: &Volume, isovalue: f64) -> u64 {
    let dims = volume.dims();
    let cells = dims.map(|d| d - 1);
    if cells.contains(&0) || !isovalue.is_finite() {
        return 0;
    }
    let (c_raw, plane) = (volume.raw_from_value(isovalue), dims[0] * dims[1]);
    let of_part = |part: usize| {
        let (first, last) = (part * SLABS, (part * SLABS + SLABS).min(cells[2]));
        let planes = plane * first..plane * (last + 1);
        let dims = [dims[0], dims[1], last + 1 - first];
        let signs = with_samples!(volume.samples(), s => Signs::new(dims, &s[planes], c_raw, volume.solid_sign()));
        let mut count = 0;
        for z in 0..last - first {
            for y in 0..cells[1] {
                signs.for_each_crossed_word(y, z, |_, crossed, _| count += u64::from(crossed.count_ones()));
            }
        }
        count
    };
    (0..cells[2].div_ceil(SLABS)).into_par_iter().map(of_part).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_threshold_is_exact_between_neighbouring_floats() {
        let low = 0.1f32;
        let high = low.next_up();
        for c in
            [f64::from(low), 0.5 * (f64::from(low) + f64::from(high)), f64::from(high), f64::from(high) * (1.0 - 1e-12)]
        {
            for sign in [1.0f32, -1.0] {
                let threshold = Threshold::new(c, sign);
                for r in [low.next_down(), low, high, high.next_up()] {
                    let mut word = [0u64];
                    threshold.fill_row(&[r], &mut word);
                    assert_eq!(word[0] == 1, f64::from(sign) * (f64::from(r) - c) > 0.0, "{r} {c} {sign}");
                }
            }
        }
    }

    #[test]
    fn bits_follow_the_samples_for_any_row_length() {
        for n in [1, 7, 8, 63, 64, 65, 130] {
            let row: Vec<u8> = (0..n).map(|i: usize| (i * i % 7) as u8).collect();
            let signs = Signs::new([n, 1, 1], &row, 2.5, 1.0);
            for (i, &v) in row.iter().enumerate() {
                assert_eq!(signs.row(0, 0)[i / 64] >> (i % 64) & 1 == 1, v > 2, "{n} {i}");
            }
            let mut crossings = Vec::new();
            signs.for_each_crossing(0, 0, 0, |x| crossings.push(x));
            let expected: Vec<usize> = (0..n - 1).filter(|&i| (row[i] > 2) != (row[i + 1] > 2)).collect();
            assert_eq!(crossings, expected);
            assert_eq!(signs.count_crossings(0, 0, 0), expected.len() as u64);
            // Solid below, and numbers that are none.
            let row: Vec<f32> = row.iter().map(|&v| if v == 1 { f32::NAN } else { f32::from(v) }).collect();
            for (solid_sign, is_solid) in [(1.0, (|v| v > 2.5) as fn(f32) -> bool), (-1.0, |v| v < 2.5)] {
                let signs = Signs::new([n, 1, 1], &row, 2.5, solid_sign);
                for (i, &v) in row.iter().enumerate() {
                    assert_eq!(signs.row(0, 0)[i / 64] >> (i % 64) & 1 == 1, is_solid(v), "{n} {i} {solid_sign}");
                }
            }
        }
    }
}
