//! What ranges and pruning promise, over trees at random.

use super::random::{Numbers, node};
use super::*;
use crate::geom::Bounds;
use crate::grid3;

const BOX: Bounds = Bounds { min: DVec3::NEG_ONE, max: DVec3::ONE };

#[test]
fn values_lie_in_the_range_of_their_box() {
    for seed in 0..600 {
        let mut n = Numbers(1000 * seed);
        let tree = tree(node(&mut n, 3));
        for _ in 0..8 {
            let half = 0.3 * n.unit();
            let region = Region { centre: n.place(), half: DVec3::new(half, 0.7 * half, 0.9 * half) };
            let range = tree.bounds_in(&region);
            for _ in 0..40 {
                let p = region.centre + region.half * n.place();
                let value = tree.value(p);
                assert!(range.holds(value), "seed {seed}: {value} at {p} is not in {range:?}\n{tree:?}");
            }
        }
    }
}

#[test]
fn pruned_samples_have_the_bits_of_unpruned_ones() {
    let dims = [19, 12, 17];
    for seed in 0..200 {
        let tree = tree(node(&mut Numbers(7000 * seed + 5), 4));
        let (mut pruned, mut whole) = (Vec::new(), Vec::new());
        let few = tree.sample(&BOX, dims, true, &mut pruned);
        let all = tree.sample(&BOX, dims, false, &mut whole);
        let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert!(bits(&pruned) == bits(&whole), "seed {seed}: {tree:?}");
        assert!(few.leaves <= all.leaves && few.mended == all.mended, "seed {seed}: {few:?} {all:?}");
    }
}

#[test]
fn samples_are_the_values_at_their_points() {
    let dims = [9, 17, 12];
    for seed in 0..60 {
        let tree = tree(node(&mut Numbers(900 * seed + 77), 3));
        let mut values = Vec::new();
        tree.sample(&BOX, dims, true, &mut values);
        let along = sample::coordinates(&BOX, dims);
        for (value, at) in values.iter().zip(grid3::all(dims)) {
            let p = DVec3::new(along[0][at[0]], along[1][at[1]], along[2][at[2]]);
            assert_eq!(value.to_bits(), ((tree.value(p) + 0.0) as f32).to_bits(), "seed {seed} at {p}");
        }
    }
}

#[test]
fn threads_do_not_matter() {
    let tree = tree(node(&mut Numbers(31), 4));
    let sample = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut values = Vec::new();
        let counters = pool.install(|| tree.sample(&BOX, [40, 33, 47], true, &mut values));
        (values, counters)
    };
    assert_eq!(sample(1), sample(2));
    assert_eq!(sample(1), sample(5));
}

/// 100 points of reach 1/10 of the box each touch (4/3)π(1/10)³ = 0.42 % of it, those inside of it: the leaf evaluations
/// a sample are at most those in the bricks that the supports meet, (1/10 + 8√3/128 · ½)³ · (4/3)π · 100 = 1.4.
#[test]
fn leaves_are_evaluated_where_they_reach() {
    let mut n = Numbers(3);
    let tree = tree(Node::of(Op::Sum, (0..100).map(|_| point(0.9 * n.place(), 0.2, Falloff::Soft)).collect()));
    let mut values = Vec::new();
    let counters = tree.sample(&BOX, [128; 3], true, &mut values);
    let share = counters.leaves as f64 / values.len() as f64;
    assert!(share < 1.6, "{share} leaf evaluations a sample, {counters:?}");
    assert_eq!(counters.bricks, 16 * 16 * 16);
    assert!(counters.filled > 1000, "{counters:?}");
}

#[test]
fn values_that_are_missing_take_the_least_and_are_counted() {
    let formula = Formula::parse("sqrt(x) + 2", &[]).unwrap();
    let tree = tree(Node::leaf(Leaf::Formula(formula.into())));
    let mut values = Vec::new();
    let counters = tree.sample(&BOX, [11, 4, 4], true, &mut values);
    assert_eq!(counters.mended, 5 * 16);
    assert!(values.iter().all(|v| v.is_finite() && *v >= 2.0));
}

/// Of small boxes by the samples in them, of larger ones by blocks, and with what lies beyond where they reach out of the grid.
#[test]
fn ranges_of_volumes_hold_their_values_and_are_narrow_inside() {
    let dims = [70, 64, 57];
    let samples = grid3::all(dims).map(|[x, y, z]| (x + 2 * y) as f32 + 0.1 * ((7 * x + 3 * z) % 11) as f32).collect();
    let bounds = Bounds { min: DVec3::splat(-1.0), max: DVec3::new(2.0, 1.0, 1.0) };
    let volume = Grid::new(dims, samples, bounds, Between::Linear(-50.0)).unwrap();
    let mut n = Numbers(11);
    let mut narrow = 0;
    for _ in 0..400 {
        let (centre, half) = (1.4 * n.place(), DVec3::splat(n.between(0.01, 0.7)));
        let range = volume.range_in(&Region { centre, half });
        for _ in 0..20 {
            let value = volume.value((centre + half * n.place()).to_array());
            assert!(range.holds(value), "{value} is not in {range:?}");
        }
        let is_inside = (centre - half).cmpgt(bounds.min).all() && (centre + half).cmplt(bounds.max).all();
        assert!(is_inside || range.low <= -50.0);
        let count: f64 = (0..3).map(|a| 2.0 * half[a] / bounds.size()[a] * dims[a] as f64).product();
        narrow += usize::from(is_inside && count > 8192.0 && range.high - range.low < 0.8 * 197.0);
    }
    assert!(narrow > 5, "{narrow} boxes that only blocks make narrow");
}
