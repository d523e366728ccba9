use super::*;
use crate::sampling::statistics::{Running, log_log_slope, normal_two_sided, sidak};
use sobol_burley::parts;

#[test]
fn agrees_with_the_table_driven_crate() {
    for index in (0..1_u32 << 16).step_by(7) {
        let reversed = index.reverse_bits();
        assert_eq!(index, parts::sobol_rev(reversed, 0));
        assert_eq!(second_dimension_reversed(index), parts::sobol_rev(reversed, 1));
        assert_eq!(from_tables(&THIRD_DIMENSION, index), parts::sobol_rev(reversed, 2));
        assert_eq!(from_tables(&FOURTH_DIMENSION, index), parts::sobol_rev(reversed, 3));
        let scramble = index.wrapping_mul(0x9e37_79b9);
        assert_eq!(nested_permutation(reversed, scramble), parts::owen_scramble_rev(reversed, scramble));
    }
}

/// Largest count in any elementary interval of area 1/points.len(); 1 for a (0, k, 2)-net.
fn crowding(points: &[[f32; 2]]) -> u32 {
    let k = points.len().ilog2();
    assert!(points.len().is_power_of_two());
    let mut most = 0;
    for columns in 0..=k {
        let mut cells = vec![0_u32; points.len()];
        for [x, y] in points {
            let (i, j) = ((x * (1 << columns) as f32) as usize, (y * (1 << (k - columns)) as f32) as usize);
            cells[(i << (k - columns)) | j] += 1;
        }
        most = most.max(cells.into_iter().max().unwrap_or(0));
    }
    most
}

/// Prefixes of the two pairs of a group are nets of quality t ≤ 3 in four dimensions: tested on
/// the cells of equal sides, one bit an axis for 2⁴ and two bits for 2⁸ cells.
#[test]
fn two_pairs_of_a_group_are_stratified_together() {
    for item in 0..8 {
        let sampler = PathSampler::new(5, item, 1);
        for (group, bits) in [(0, 1u32), (0, 2), (1, 1), (1, 2)] {
            let n = 1u32 << (4 * bits + 3);
            let mut cells = vec![0; 1 << (4 * bits)];
            for i in 0..n {
                let ([a, b], [c, d]) = (sampler.pair(i, 2 * group), sampler.pair(i, 2 * group + 1));
                let side = (1 << bits) as f32;
                let cell = [a, b, c, d].iter().fold(0, |at, v| at << bits | (v * side) as usize);
                cells[cell] += 1;
            }
            assert!(cells.iter().all(|&count| count == 8), "item {item} group {group} {bits} bits: {cells:?}");
        }
    }
}

#[test]
fn every_prefix_of_a_power_of_two_is_a_net() {
    for (seed, item, replicate, pair) in [(0, 0, 0, 0), (1, 0, 0, 2), (0, 77, 3, 1), (u64::MAX, 1 << 40, 1, 9)] {
        let sampler = PathSampler::new(seed, item, replicate);
        let mut points = vec![[0.0; 2]; 1 << 12];
        sampler.fill_pairs(pair, 0, &mut points);
        // t = 0 for even pairs, at most 2 for odd ones.
        let most = if pair % 2 == 0 { 1 } else { 4 };
        for k in 0..=12 {
            let found = crowding(&points[..1 << k]);
            assert!(found <= most, "{found} of 2^{k} points of {seed} {item} {replicate} {pair}");
        }
        // Aligned blocks are nets too, also far beyond 2^16.
        for first in [1 << 10, 3 << 16, 0xffff_fc00] {
            let mut block = vec![[0.0; 2]; 1 << 10];
            sampler.fill_pairs(pair, first, &mut block);
            assert!(crowding(&block) <= most, "from {first}");
            for (i, &point) in block.iter().enumerate() {
                assert_eq!(point, sampler.pair(first + i as u32, pair));
            }
        }
    }
}

/// RMS over `replicates` of the error of ∫ x e^y = (e−1)/2 with n points each.
fn error(n: u32, point: impl Fn(u32, u32) -> [f32; 2]) -> f64 {
    let exact = 0.5 * (std::f64::consts::E - 1.0);
    let replicates = 64;
    let mut square = 0.0;
    for replicate in 0..replicates {
        let mut sum = 0.0;
        for i in 0..n {
            let [x, y] = point(replicate, i);
            sum += f64::from(x) * f64::from(y).exp();
        }
        square += (sum / f64::from(n) - exact).powi(2);
    }
    (square / f64::from(replicates)).sqrt()
}

fn order(point: impl Fn(u32, u32) -> [f32; 2]) -> f64 {
    let ladder: Vec<(f64, f64)> = (4..=12).map(|k| (f64::from(1 << k), error(1 << k, &point))).collect();
    log_log_slope(&ladder)
}

/// Owen 1997: variance O(N⁻³ log N) for smooth integrands in two dimensions, so the RMS
/// error falls nearly as N^−1.5. With reversed bits in the wrong place the points are
/// merely random, N^−0.5: the control makes sure that this test would notice.
#[test]
fn the_order_of_convergence_is_that_of_scrambled_nets() {
    let slope = order(|replicate, i| PathSampler::new(3, 14, replicate).pair(i, 2));
    assert!(slope < -1.3, "slope {slope}");
    let wrong = order(|replicate, i| {
        let s = PathSampler::new(3, 14, replicate).sequence(2);
        let x = nested_permutation(i.reverse_bits(), s.scramble[0]);
        let y = nested_permutation(second_dimension_reversed(i).reverse_bits(), s.scramble[1]);
        [unit_interval(x), unit_interval(y)]
    });
    assert!(wrong > -1.0, "the control converges as {wrong}: this test cannot see a wrong bit order");
}

/// The product of the *centred* errors of two replicates, or two groups, of 16 points has
/// mean 0; so has the correlation of single coordinates across groups at equal index.
#[test]
fn replicates_groups_and_items_are_independent() {
    let mean = |s: PathSampler, pair: u32| {
        (0..16).map(|i| s.pair(i, pair)).map(|[x, y]| f64::from(x) * f64::from(y) - 0.25).sum::<f64>() / 16.0
    };
    let coordinate = |s: PathSampler, i: u32, pair: u32, axis: usize| f64::from(s.pair(i, pair)[axis]) - 0.5;
    let trials = 20_000;
    let mut sums = [Running::new(); 7];
    for item in 0..trials {
        let (a, b) = (PathSampler::new(7, item, 0), PathSampler::new(7, item, 1));
        let next = PathSampler::new(7, item + trials, 0);
        sums[0].push(mean(a, 0) * mean(b, 0));
        sums[1].push(mean(a, 0) * mean(a, 2));
        sums[2].push(mean(a, 0) * mean(next, 0));
        let i = (item % 64) as u32;
        sums[3].push(coordinate(a, i, 0, 0) * coordinate(a, i, 2, 0));
        sums[4].push(coordinate(a, i, 0, 0) * coordinate(a, i, 0, 1));
        sums[5].push(coordinate(a, i, 0, 1) * coordinate(b, i, 0, 1));
        sums[6].push(coordinate(a, i, 2, 1) * coordinate(next, i, 2, 1));
    }
    for (case, sum) in sums.iter().enumerate() {
        let z = sum.mean() / sum.standard_error();
        assert!(normal_two_sided(z) > sidak(0.01, sums.len()), "case {case}: z = {z}");
    }
}

/// One point of a scrambled sequence is uniform, whatever its index.
#[test]
fn each_point_is_uniform_over_items() {
    for index in [0, 1, 5, 1000] {
        let mut bins = vec![0.0; 256];
        let trials = 1 << 16;
        for item in 0..trials {
            let [x, y] = PathSampler::new(11, item, 0).pair(index, 0);
            bins[(x * 16.0) as usize * 16 + (y * 16.0) as usize] += 1.0;
        }
        let expected = vec![trials as f64 / 256.0; 256];
        let p = crate::sampling::statistics::chi_square_test(&bins, &expected).p;
        assert!(p > sidak(0.01, 4), "index {index}: p = {p:e}");
    }
}
