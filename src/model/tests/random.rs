//! Trees by their number.

use super::*;
use crate::geom::Affine;
use glam::DMat3;

/// Numbers in a row, each a function of the seed and its place.
pub struct Numbers(pub u64);

impl Numbers {
    pub fn unit(&mut self) -> f64 {
        self.0 += 1;
        grid::scattered(self.0).x
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    pub fn below(&mut self, n: usize) -> usize {
        ((self.unit() * n as f64) as usize).min(n - 1)
    }

    pub fn place(&mut self) -> DVec3 {
        DVec3::new(self.between(-1.0, 1.0), self.between(-1.0, 1.0), self.between(-1.0, 1.0))
    }

    pub fn direction(&mut self) -> DVec3 {
        (self.place() + DVec3::new(1e-3, 0.0, 0.0)).normalize()
    }
}

/// A cube of side 1 about a centre, outward.
pub fn cube(centre: DVec3, half: f64) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let corner =
        |i: usize| centre + half * DVec3::from_array([i & 1, i >> 1 & 1, i >> 2].map(|b| 2.0 * b as f64 - 1.0));
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let halves = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
    ((0..8).map(corner).collect(), halves.collect())
}

pub fn leaf(n: &mut Numbers) -> Node {
    let centre = 0.8 * n.place();
    let round = Round { centre, normal: n.direction(), radius: n.between(0.1, 0.5) };
    let other = centre + 0.7 * n.direction();
    let third = centre + 0.5 * n.direction();
    let shape = match n.below(10) {
        0 | 1 => Shape::Point(centre),
        2 | 3 => Shape::Segment([centre, other]),
        4 => Shape::Polyline(vec![centre, other, third]),
        5 => Shape::Disc(round),
        6 => Shape::Circle(round),
        7 => Shape::Polygon(vec![centre, other, third], (other - centre).cross(third - centre).normalize()),
        8 => Shape::Box(centre, DVec3::new(0.2, 0.3, 0.1)),
        _ => {
            let (positions, triangles) = cube(centre, 0.3);
            Shape::Mesh(MeshDistance::new(&positions, &triangles, false).unwrap().into())
        }
    };
    let reach = n.between(0.2, 0.7);
    Node::leaf(match n.below(12) {
        0 => Leaf::Distance(shape, n.between(0.0, 0.3)),
        1 => Leaf::Ramp(shape, n.between(0.1, 0.4)),
        2 => Leaf::Ramp(Shape::HalfSpace(centre, n.direction()), 0.3),
        3 => {
            let kernel = [Kernel::Wyvill, Kernel::Gaussian(3.0), Kernel::Cauchy(2.0)][n.below(3)];
            let norm = kernel.norm_of_line(reach);
            Leaf::Convolution(Convolution { ends: [centre, other], kernel, reach, norm })
        }
        4 => Leaf::Formula(Formula::parse("0.6 - x^2 - 2*y*y + 0.2*sin(5*z)*cos(3*x)", &[]).unwrap().into()),
        k => {
            let falloff = [Falloff::Soft, Falloff::Metaball, Falloff::Wyvill, Falloff::Gaussian(4.0)][k % 4];
            let last = if matches!(shape, Shape::Segment(_)) && n.below(2) == 0 { 0.6 * reach } else { reach };
            let weight = if n.below(6) == 0 { -0.7 } else { 1.0 };
            Leaf::Skeletal(Skeletal { shape, reach: [reach, last], falloff, weight })
        }
    })
}

pub fn warp(n: &mut Numbers) -> Warp {
    let axes = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1]][n.below(4)];
    let kind = match n.below(4) {
        0 => Kind::Twist { rate: n.between(-2.0, 2.0) },
        1 => Kind::Taper { range: [n.between(-0.8, -0.2), n.between(0.1, 0.7)], scale: n.between(0.4, 1.6) },
        2 => {
            let rate = n.between(0.2, 0.9) * if n.below(2) == 0 { -1.0 } else { 1.0 };
            Kind::Bend { rate, centre: n.between(-0.2, 0.2), range: [n.between(-0.9, -0.3), n.between(0.3, 0.9)] }
        }
        _ => {
            let (u, v) = (n.direction(), n.direction());
            let linear = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::Z) + 0.2 * DMat3::from_cols(u, v, u.cross(v));
            return Warp::affine(Affine::new(linear, 0.3 * n.place()).unwrap());
        }
    };
    Warp { axes, kind }
}

pub fn node(n: &mut Numbers, depth: usize) -> Node {
    if depth == 0 || n.below(5) == 0 {
        return leaf(n);
    }
    let count = 2 + n.below(3);
    let some = |n: &mut Numbers, count: usize| (0..count).map(|_| node(n, depth - 1)).collect::<Vec<_>>();
    let crease = Crease { iso: 0.5, m: 0.7, k: 0.3 };
    match n.below(12) {
        0 | 1 => Node::of(Op::Sum, some(n, count)),
        2 => Node::of(Op::Ricci([2.0, 4.0, 3.0, -2.0][n.below(4)]), some(n, count)),
        3 => Node::of(Op::Union, some(n, count)),
        4 => Node::of(Op::Intersection, some(n, count)),
        5 => Node::difference(some(n, count), 0.5),
        6 => {
            let pasko = Pasko {
                iso: 0.5,
                alpha: [1.0, -1.0, 0.0][n.below(3)],
                m: [0.0, 2.0][n.below(2)],
                displacement: (n.below(3) == 0).then_some([0.1, 0.3, 0.4]),
            };
            Node::of(Op::Pasko(pasko), some(n, 2))
        }
        7 => Node::of(Op::SmoothUnion(crease), some(n, 2)),
        8 => Node::of(Op::SmoothIntersection(crease), some(n, 2)),
        9 => Node::of([Op::Offset(0.1), Op::Shell(0.5, 0.2), Op::Weight(0.8)][n.below(3)].clone(), some(n, 1)),
        _ => Node::of(Op::Warp(warp(n)), some(n, 1)),
    }
}
