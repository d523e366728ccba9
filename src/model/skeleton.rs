//! Points on the skeletons of primitives, from which the surface around them can be found by walking.

use super::leaf::Leaf;
use super::shape::Shape;
use super::tree::{Flat, Op, Tree};
use super::warp::Warp;
use glam::DVec3;

/// Where the primitives of a model lie.
#[derive(Clone, Debug, Default)]
pub struct Skeletons {
    /// A point on the skeleton of each primitive, as the deformations above it show it.
    pub points: Vec<DVec3>,
    /// Leaves without a skeleton: formulas, grids, surfaces through points.
    pub without: usize,
}

impl Tree {
    /// A point on the skeleton of each primitive.
    pub fn skeletons(&self) -> Skeletons {
        let mut found = Skeletons::default();
        self.add_skeletons(self.root(), &mut Vec::new(), &mut found);
        found
    }

    fn add_skeletons<'a>(&'a self, node: u32, above: &mut Vec<&'a Warp>, found: &mut Skeletons) {
        let Flat { op, of } = &self.nodes[node as usize];
        match op {
            Op::Leaf(leaf) => match point_of(leaf) {
                // Deformations are inverse maps: what is seen is found by their forward ones, the innermost first.
                Some(point) => found.points.push(above.iter().rev().fold(point, |p, warp| warp.forward(p))),
                None => found.without += 1,
            },
            Op::Warp(warp) => {
                above.push(warp);
                of.iter().for_each(|&child| self.add_skeletons(child, above, found));
                above.pop();
            }
            _ => of.iter().for_each(|&child| self.add_skeletons(child, above, found)),
        }
    }
}

fn point_of(leaf: &Leaf) -> Option<DVec3> {
    match leaf {
        Leaf::Skeletal(skeletal) => of_shape(&skeletal.shape),
        Leaf::Distance(shape, _) | Leaf::Ramp(shape, _) => of_shape(shape),
        Leaf::Convolution(convolution) => Some(0.5 * (convolution.ends[0] + convolution.ends[1])),
        Leaf::Rbf(_) | Leaf::Formula(_) | Leaf::Grid(_) => None,
    }
}

fn of_shape(shape: &Shape) -> Option<DVec3> {
    match shape {
        Shape::Point(centre) | Shape::Box(centre, _) => Some(*centre),
        Shape::Segment([a, b]) => Some(0.5 * (*a + *b)),
        Shape::Polyline(points) => Some(points[0]),
        Shape::Polygon(points, _) => Some(points.iter().sum::<DVec3>() / points.len() as f64),
        Shape::Disc(round) => Some(round.centre),
        Shape::Circle(round) => Some(round.centre + round.normal.any_orthonormal_vector() * round.radius),
        Shape::HalfSpace(point, _) => Some(*point),
        Shape::Mesh(mesh) => mesh.vertex(),
    }
}
