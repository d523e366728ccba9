//! Closed forms, gradients against differences, ranges, pruning, and what is printed wrong in the sources.

mod nodes;
mod pruning;
mod random;
mod slips;

use super::*;
use glam::DVec3;

/// A single soft point of reach `r`.
fn point(centre: DVec3, r: f64, falloff: Falloff) -> Node {
    let shape = Shape::Point(centre);
    Node::leaf(Leaf::Skeletal(Skeletal { shape, reach: [r; 2], falloff, weight: 1.0 }))
}

fn soft(shape: Shape, r: f64) -> Node {
    Node::leaf(Leaf::Skeletal(Skeletal { shape, reach: [r; 2], falloff: Falloff::Soft, weight: 1.0 }))
}

fn tree(node: Node) -> Tree {
    Tree::new(node).unwrap()
}

/// Fourth-order central differences.
fn difference(tree: &Tree, p: DVec3, h: f64) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|axis| {
        let at = |k: f64| tree.value(p + DVec3::AXES[axis] * (k * h));
        (at(-2.0) - 8.0 * at(-1.0) + 8.0 * at(1.0) - at(2.0)) / (12.0 * h)
    }))
}

#[track_caller]
fn near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} instead of {expected}, off by {:e}", found - expected);
}
