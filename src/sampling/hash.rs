//! Random numbers as pure functions of (seed, item, sample, dimension): nothing is stored, any
//! number can be made again alone, and the order of work cannot matter.

/// The odd number nearest 2⁶⁴/φ: steps by it visit all 64-bit words, far apart.
pub(crate) const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// Mixes a 64-bit word; a bijection in which every input bit moves every output bit (the
/// finaliser of splitmix64, "Mix13" of Stafford; Steele, Lea, Flood 2014, "Fast Splittable
/// Pseudorandom Number Generators", OOPSLA, section 5). 0 maps to 0: add [`GOLDEN`] first.
#[inline(always)]
pub(crate) const fn mix(mut word: u64) -> u64 {
    word = (word ^ (word >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    word = (word ^ (word >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    word ^ (word >> 31)
}

/// A key for one stream of numbers: not linear in its inputs, so streams of neighbouring items
/// share nothing.
#[inline]
pub(crate) const fn key(seed: u64, item: u64) -> u64 {
    mix(mix(seed.wrapping_add(GOLDEN)).wrapping_add(item).wrapping_add(GOLDEN))
}

/// 32 random bits for dimension `dimension` of sample `sample` of item `item` under `seed`.
#[inline]
pub const fn hash(seed: u64, item: u64, sample: u32, dimension: u32) -> u32 {
    let counter = ((sample as u64) << 32) | dimension as u64;
    (mix(key(seed, item).wrapping_add(mix(counter.wrapping_add(GOLDEN)))) >> 32) as u32
}

/// The upper 24 bits of a word as a number in [0, 1): a multiple of 2⁻²⁴, exact, never 1.
#[inline(always)]
pub const fn unit_interval(bits: u32) -> f32 {
    const STEP: f32 = 1.0 / (1 << 24) as f32;
    (bits >> 8) as i32 as f32 * STEP
}

/// A uniform number in [0, 1) from [`hash`].
#[inline]
pub const fn uniform(seed: u64, item: u64, sample: u32, dimension: u32) -> f32 {
    unit_interval(hash(seed, item, sample, dimension))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::statistics::{chi_square_test, sidak};

    #[test]
    fn the_unit_interval_is_half_open() {
        assert_eq!(unit_interval(0), 0.0);
        assert_eq!(unit_interval(u32::MAX), 1.0 - 1.0 / 16_777_216.0);
    }

    /// Pairs of numbers that differ by one in one input fall on a 32 × 32 grid; independent
    /// uniform numbers fill it evenly.
    #[test]
    fn neighbouring_inputs_give_independent_numbers() {
        type Pair = fn(u32) -> [f32; 2];
        let cases: [(&str, Pair); 6] = [
            ("dimension", |i| [uniform(1, 5, i, 0), uniform(1, 5, i, 1)]),
            ("sample", |i| [uniform(1, 5, 2 * i, 7), uniform(1, 5, 2 * i + 1, 7)]),
            ("item", |i| [uniform(1, 2 * u64::from(i), 3, 7), uniform(1, 2 * u64::from(i) + 1, 3, 7)]),
            ("seed", |i| [uniform(2 * u64::from(i), 0, 0, 0), uniform(2 * u64::from(i) + 1, 0, 0, 0)]),
            ("sample against dimension", |i| [uniform(0, 0, i, i + 1), uniform(0, 0, i + 1, i)]),
            ("item against seed", |i| [uniform(i.into(), 9, 0, 0), uniform(9, i.into(), 0, 0)]),
        ];
        let n = 1 << 17;
        for (name, pair) in cases {
            let mut observed = vec![0.0; 32 * 32];
            for i in 0..n {
                let [a, b] = pair(i);
                observed[(a * 32.0) as usize * 32 + (b * 32.0) as usize] += 1.0;
            }
            let expected = vec![f64::from(n) / 1024.0; 1024];
            let p = chi_square_test(&observed, &expected).p;
            assert!(p > sidak(0.01, cases.len()), "{name}: p = {p:e}");
        }
    }
}
