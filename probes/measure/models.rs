//! Sampling of implicit models measured: points at random in a box, pruned and not.
//!
//! `cargo run --release --example measure-models` prints CSV: primitives, samples along a side, seconds (the least of
//! three), leaf evaluations a sample, and the share of bricks filled with one number; then the same without pruning for
//! the smallest, and whether the bytes agree. Reaches are 1/10 of the box for 100 points and 1/20 for 1000.

use isolume::geom::Bounds;
use isolume::glam::DVec3;
use isolume::model::{Falloff, Leaf, Node, Op, Shape, Skeletal, Tree, grid};
use std::time::Instant;

const BOX: Bounds = Bounds { min: DVec3::NEG_ONE, max: DVec3::ONE };

fn points(count: u64, reach: f64) -> Tree {
    let leaf = |i: u64| {
        let shape = Shape::Point(1.8 * grid::scattered(i) - 0.9);
        Node::leaf(Leaf::Skeletal(Skeletal { shape, reach: [reach; 2], falloff: Falloff::Soft, weight: 1.0 }))
    };
    Tree::new(Node::of(Op::Sum, (0..count).map(leaf).collect())).expect("a tree")
}

fn main() {
    println!("primitives,samples,seconds,leaves_per_sample,filled");
    let mut values = Vec::new();
    for (count, reach, size) in [(100, 0.2, 64), (100, 0.2, 128), (1000, 0.1, 128), (1000, 0.1, 256)] {
        let tree = points(count, reach);
        let mut least = f64::INFINITY;
        let mut counters = Default::default();
        for _ in 0..3 {
            let start = Instant::now();
            counters = tree.sample(&BOX, [size; 3], true, &mut values);
            least = least.min(start.elapsed().as_secs_f64());
        }
        let per_sample = counters.leaves as f64 / values.len() as f64;
        let filled = counters.filled as f64 / counters.bricks as f64;
        println!("{count},{size},{least:.3},{per_sample:.3},{filled:.3}");
    }
    let tree = points(100, 0.2);
    let mut pruned = Vec::new();
    tree.sample(&BOX, [64; 3], true, &mut pruned);
    let start = Instant::now();
    let counters = tree.sample(&BOX, [64; 3], false, &mut values);
    let same = pruned.iter().map(|v| v.to_bits()).eq(values.iter().map(|v| v.to_bits()));
    let per_sample = counters.leaves as f64 / values.len() as f64;
    println!("100 unpruned,64,{:.3},{per_sample:.3},0 (same bytes: {same})", start.elapsed().as_secs_f64());
}
