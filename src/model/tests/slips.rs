//! What the sources print wrong, each with the corrected form.

use super::*;
use crate::geom::Bounds;
use convolution::{gauss, lines_of_triangle};

fn constant(value: f64) -> Node {
    Node::leaf(Leaf::Formula(Formula::parse(&format!("{value}"), &[]).unwrap().into()))
}

fn at_origin(node: Node) -> f64 {
    tree(node).value(DVec3::ZERO)
}

/// min(f_L, −f_R) is empty where fields are not negative.
#[test]
fn slip_difference_takes_the_field_from_twice_the_isovalue() {
    let inside = at_origin(Node::difference(vec![constant(0.8), constant(0.1)], 0.5));
    let carved = at_origin(Node::difference(vec![constant(0.8), constant(0.9)], 0.5));
    near(inside, 0.8, 1e-15);
    near(carved, 0.1, 1e-15);
}

/// On raw fields the union of 0.5 and 0 would be 0.5 + 0 + 0.5 = 1: the surface would move.
#[test]
fn slip_pasko_works_on_the_field_minus_the_isovalue() {
    let of = |alpha: f64, a: f64, b: f64| Pasko { iso: 0.5, alpha, m: 0.0, displacement: None }.of(a, b);
    near(of(1.0, 0.5, 0.0), 0.5, 1e-15);
    // 1 is the union, −1 the intersection: not the other way round.
    assert!(of(1.0, 0.7, 0.2) > 0.5 && of(-1.0, 0.7, 0.2) < 0.5);
    assert!(of(1.0, 0.2, 0.2) < 0.5 && of(-1.0, 0.7, 0.7) > 0.5);
    near(of(0.0, 0.7, 0.2), 0.4, 1e-15);
}

/// "Always the exact union": only as n → ∞.
#[test]
fn slip_ricci_is_the_union_in_the_limit_alone() {
    let of = |n: f64| operator::ricci(&[0.4, 0.3], n);
    assert!(of(2.0) > 0.45 && of(2.0) < 0.7);
    near(of(1.0), 0.7, 1e-15);
    near(of(200.0), 0.4, 1e-6);
    near(of(-200.0), 0.3, 1e-6);
    // Inside is f > iso: two fields that are below it blend to one that is inside. Ricci's inside was f < 1.
    near(operator::ricci(&[0.5f64.sqrt() * 0.5; 2], 2.0), 0.5, 1e-15);
}

/// Printed forward maps, put where the inverse belongs, make a taper wider and turn a twist the other way.
#[test]
fn slip_warps_are_inverse_maps() {
    let cylinder = || Node::leaf(Leaf::Distance(Shape::Segment([DVec3::NEG_Y * 9.0, DVec3::Y * 9.0]), 0.5));
    let taper = |scale: f64| {
        let warp = Warp { axes: [0, 1, 2], kind: Kind::Taper { range: [-1.0, 1.0], scale } };
        tree(Node::of(Op::Warp(warp), vec![cylinder()]))
    };
    // Half-width ½ at y₀ and ½ s₁ at y₁.
    for scale in [0.5, 0.1, 2.0] {
        near(taper(scale).value(DVec3::new(0.5, -1.0, 0.0)), 0.0, 1e-12);
        near(taper(scale).value(DVec3::new(0.5 * scale, 1.0, 0.0)), 0.0, 1e-12);
    }
    // What stands at +x is seen turned by +θ.
    let warp = Warp { axes: [0, 1, 2], kind: Kind::Twist { rate: 0.5 } };
    let turned = tree(Node::of(Op::Warp(warp), vec![point(DVec3::new(1.0, 0.0, 1.0), 0.3, Falloff::Soft)]));
    near(turned.value(DVec3::new(libm::cos(0.5), libm::sin(0.5), 1.0)), 1.0, 1e-12);
    // A bend has one copy of the body: none a turn further.
    let warp = Warp { axes: [0, 1, 2], kind: Kind::Bend { rate: 1.0, centre: 0.0, range: [-1.0, 1.0] } };
    let bent = tree(Node::of(Op::Warp(warp), vec![point(DVec3::ZERO, 0.3, Falloff::Soft)]));
    near(bent.value(DVec3::ZERO), 1.0, 1e-12);
    assert_eq!(bent.value(DVec3::new(2.0 * std::f64::consts::PI, 0.0, 0.0)), 0.0);
    assert_eq!(bent.value(DVec3::new(0.0, 2.0, 0.0)), 0.0);
}

/// The second branch is (4M/w³)(ϱ − w)²(4ϱ − w), not (4ϱ − w)³: 0.1 at w/2, not 0.025.
#[test]
fn slip_contact_bulge_is_a_square_times_a_line() {
    let h = |rho: f64| Contact::bulge(rho, 0.5, 0.1, 0.7);
    near(h(0.25), 0.1, 1e-15);
    near(h(0.25 + 1e-12), 0.1, 1e-12);
    near(h(0.0), 0.0, 0.0);
    near(h(0.5), 0.0, 0.0);
    let slope = |rho: f64| {
        Contact::bulge(Dual { value: rho, gradient: DVec3::X }, Dual::of(0.5), 0.1, Dual::of(0.7)).gradient.x
    };
    near(slope(0.0), 0.7, 1e-15);
    near(slope(0.25), 0.0, 1e-14);
    // Between neighbouring numbers of the two branches, and at the end.
    near(slope(0.25f64.next_up()), 0.0, 1e-14);
    near(slope(0.5f64.next_down()), 0.0, 1e-14);
}

use scalar::{Dual, Scalar};

/// s is iso − f of the *other* body, k the slope of the other.
#[test]
fn slip_contact_gives_way_to_the_other_body() {
    let bodies =
        [point(DVec3::new(-0.4, 0.0, 0.0), 1.0, Falloff::Soft), point(DVec3::new(0.3, 0.0, 0.0), 0.9, Falloff::Wyvill)];
    let trees = bodies.clone().map(tree);
    let bounds = Bounds { min: DVec3::splat(-1.5), max: DVec3::splat(1.5) };
    let made = |show| Contact::new(0.5, 0.3, 1.0, show, [&trees[0], &trees[1]], &bounds);
    let of = |show| tree(Node::of(Op::Contact(made(show).into()), bodies.to_vec()));
    let shown = [of(Show::First), of(Show::Second)];
    // F₁ = F₂ = c where f₁ = f₂, inside of both.
    let (mut low, mut high) = (-0.1, 0.2);
    for _ in 0..100 {
        let middle = DVec3::new(0.5 * (low + high), 0.0, 0.0);
        if trees[0].value(middle) > trees[1].value(middle) { low = middle.x } else { high = middle.x }
    }
    let common = DVec3::new(low, 0.0, 0.0);
    assert!(trees[0].value(common) > 0.5);
    near(shown[0].value(common), 0.5, 1e-12);
    near(shown[1].value(common), 0.5, 1e-12);
    // Value and slope are continuous where the first body leaves the second, at p₀.
    let direction = DVec3::new(-1.0, 0.12, 0.05).normalize();
    let centre = DVec3::new(0.3, 0.0, 0.0);
    let (mut low, mut high) = (0.0, 0.9);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if trees[1].value(centre + middle * direction) > 0.5 { low = middle } else { high = middle }
    }
    let at = |s: f64| shown[0].value_and_gradient(centre + (low + s) * direction);
    assert!(trees[0].value(centre + low * direction) > 0.5, "the foot is inside of the first body");
    // Between neighbouring numbers; in closed form ∇F₁ is ∇f₁ − ∇f₂ on both sides.
    let ((inside, slope), (outside, beyond)) = (at(0.0), at(high - low));
    let [own, other] = [0, 1].map(|i: usize| trees[i].value_and_gradient(centre + low * direction).1);
    near(inside, outside, 1e-12);
    assert!((slope - (own - other)).length() < 1e-12 && (beyond - slope).length() < 1e-12, "{slope} {beyond}");
    // At half the width the bulge is as high as it gets, and flat; at the width it ends. Along a ray of the other body, which is
    // round, ϱ is the distance to it, and k is the same everywhere. Far from the first body the bulge fades.
    let (k, height) = (other.length(), made(Show::First).height[0]);
    let width = f64::min(0.3, 6.0 * height / k);
    for (part, bulge) in [(0.5, height), (1.0, 0.0)] {
        let [near_side, far_side] = [1.0 - 1e-14, 1.0 + 1e-14].map(|by| at(part * width * by));
        let (value, gradient) = trees[0].value_and_gradient(centre + (low + part * width) * direction);
        near(near_side.0, value + bulge, 1e-12);
        near(far_side.0, value + bulge, 1e-12);
        for (_, slope) in [near_side, far_side] {
            assert!((slope - gradient).length() < 1e-12, "{slope} for {gradient} at {part} of {width}");
        }
    }
}

/// The sign of a distance from the plane of the nearest triangle is wrong beside edges and vertices.
#[test]
fn slip_sign_is_that_of_the_nearest_feature() {
    // A sharp wedge: beyond its edge the plane of either face may have the point behind it.
    let positions =
        [[0., 0., 0.], [2., 0.1, 0.], [2., -0.1, 0.], [0., 0., 1.], [2., 0.1, 1.], [2., -0.1, 1.]].map(DVec3::from);
    let triangles = [[0, 1, 2], [3, 5, 4], [0, 3, 1], [1, 3, 4], [0, 2, 3], [2, 5, 3], [1, 4, 2], [2, 4, 5]];
    let mesh = MeshDistance::new(&positions, &triangles, false);
    let mesh = mesh.or_else(|_| MeshDistance::new(&positions, &triangles.map(|[a, b, c]| [a, c, b]), false)).unwrap();
    let flip = if mesh.signed([1.0, 0.0, 0.5]) < 0.0 { 1.0 } else { -1.0 };
    for p in [[-0.5, 0.02, 0.5], [-0.5, -0.02, 0.5], [-0.1, 0.3, 0.5], [-0.2, 0.01, 1.3], [2.5, 0.0, 0.5]] {
        assert!(flip * mesh.signed(p) > 0.0, "{p:?}");
        let inside = mesh.winding(DVec3::from(p)).abs();
        assert!(inside < 0.01, "{p:?}: {inside}");
    }
    near(mesh.winding(DVec3::new(1.5, 0.0, 0.5)).abs(), 1.0, 1e-12);
}

/// Carved fields have no surface on their skeleton.
#[test]
fn slip_negative_weights_have_no_surface_of_their_own() {
    let shape = Shape::Point(DVec3::ZERO);
    let carve = Skeletal { shape, reach: [1.0; 2], falloff: Falloff::Soft, weight: -1.0 };
    let carve = tree(Node::leaf(Leaf::Skeletal(carve)));
    assert!(carve.bounds_in(&Region::ALL).high <= 0.0);
    assert_eq!(carve.value(DVec3::ZERO), -1.0);
}

/// r² ln r is the thin plate of the plane; in space r³ has the least third-order energy and is smooth at its centres.
#[test]
fn slip_thin_plate_in_space_is_not_the_planar_kernel() {
    let sphere: Vec<(DVec3, f64)> = (0..60)
        .map(|i| ((2.0 * grid::scattered(i) - 1.0).normalize(), 0.0))
        .chain([(DVec3::ZERO, 1.0), (DVec3::X * 1.6, -0.6), (DVec3::Y * -1.6, -0.6), (DVec3::Z * 1.6, -0.6)])
        .collect();
    for radial in [Radial::Cubic, Radial::Linear, Radial::ThinPlate, Radial::Wendland(3.0)] {
        let rbf = Rbf::through(&sphere, radial, 0.0).unwrap();
        for (p, value) in &sphere {
            near(rbf.value(p.to_array()), *value, 1e-9);
        }
        assert!(rbf.condition > 1.0);
    }
    // The gradient of r³ is continuous at a centre, that of r jumps.
    let jump = |radial: Radial| {
        let t = tree(Node::leaf(Leaf::Rbf(Rbf::through(&sphere, radial, 0.0).unwrap().into())));
        let at = |s: f64| t.value_and_gradient(sphere[0].0 + DVec3::new(0.3, 0.5, 0.8) * s).1;
        (at(1e-7) - at(-1e-7)).length()
    };
    assert!(
        jump(Radial::Cubic) < 1e-4 && jump(Radial::Linear) > 0.01,
        "{} {}",
        jump(Radial::Cubic),
        jump(Radial::Linear)
    );
    // Smoothing pulls away from the values, whatever the kernel.
    for radial in [Radial::Cubic, Radial::Linear] {
        let rbf = Rbf::through(&sphere, radial, 0.1).unwrap();
        let off = sphere.iter().map(|(p, v)| (rbf.value(p.to_array()) - v).abs()).fold(0.0, f64::max);
        assert!(off > 1e-3 && off < 1.0, "{radial:?} {off}");
    }
}

/// N = 35/(32 R): without it an infinite line reads (32/35) R (1 − d²/R²)^(7/2).
#[test]
fn slip_convolution_is_normalised() {
    let r = 0.7;
    let line = |norm: f64| {
        let ends = [DVec3::X * -9.0, DVec3::X * 9.0];
        tree(Node::leaf(Leaf::Convolution(Convolution { ends, kernel: Kernel::Wyvill, reach: r, norm })))
    };
    for d in [0.0, 0.2, 0.5, 0.69] {
        let shape = libm::pow(1.0 - d * d / (r * r), 3.5);
        let p = DVec3::new(0.3, d, 0.0);
        near(line(Kernel::Wyvill.norm_of_line(r)).value(p), shape, 1e-12);
        near(line(1.0).value(p), 32.0 / 35.0 * r * shape, 1e-12);
    }
    near(line(Kernel::Wyvill.norm_of_line(r)).value(DVec3::Y * 0.4238687 * r), 0.5, 1e-6);
    for kernel in [Kernel::Gaussian(3.0), Kernel::Cauchy(40.0)] {
        let ends = [DVec3::X * -300.0, DVec3::X * 300.0];
        let line = Convolution { ends, kernel, reach: r, norm: kernel.norm_of_line(r) };
        near(line.value([0.0; 3]), 1.0, 1e-9);
    }
    // A large triangle reads what the infinite plane does: πN(R² − h²)⁴/(4R⁶), up to the quadrature across it.
    let corners = [DVec3::new(-3.0, -2.0, 0.0), DVec3::new(3.0, -2.0, 0.0), DVec3::new(0.0, 4.0, 0.0)];
    let h = 0.3;
    let field = |count: usize| -> f64 {
        let norm = Kernel::Wyvill.norm_of_plane(2.0);
        let lines = lines_of_triangle(corners, count).into_iter();
        let leaf = |(ends, weight): ([DVec3; 2], f64)| Convolution {
            ends,
            kernel: Kernel::Wyvill,
            reach: 1.9,
            norm: norm * weight,
        };
        lines.map(|l| leaf(l).value([0.0, 0.0, h])).sum()
    };
    let norm = Kernel::Wyvill.norm_of_plane(2.0);
    let (r2, h2) = (1.9f64 * 1.9, h * h);
    let exact = std::f64::consts::PI * norm * (r2 - h2).powi(4) / (4.0 * r2.powi(3));
    near(field(16), exact, 1e-3 * exact);
    // Gauss and Legendre: x⁷ on [0, 1].
    near(gauss(16).iter().map(|[x, w]| w * x.powi(7)).sum(), 0.125, 1e-14);
}

/// The vertex of an edge is V₁ + t (V₂ − V₁) with t = (c − f₁)/(f₂ − f₁), not V₂ + …: nearer to the end whose value is nearer.
#[test]
fn slip_vertices_of_edges_start_at_the_corner_of_the_first_value() {
    let line = tree(Node::leaf(Leaf::Formula(Formula::parse("0.9 - 0.5*x", &[]).unwrap().into())));
    let values = [0.9, 0.4];
    for finder in RootFinder::ALL {
        let along = |ends, values| root_on_segment(&line, 0.5, ends, values, finder).along.unwrap();
        near(along([DVec3::ZERO, DVec3::X], values), 0.8, 1e-12);
        near(along([DVec3::X, DVec3::ZERO], [0.4, 0.9]), 0.2, 1e-12);
    }
}

/// Forward differences of 0.01 side in single precision, as printed, are off by 5·10⁻³ at a side of 1/512; ours come with the value.
#[test]
fn slip_gradients_are_no_forward_differences() {
    let ball = tree(point(DVec3::ZERO, 1.0, Falloff::Soft));
    let side = 1.0 / 512.0;
    let (mut analytic, mut forward) = (0.0f64, 0.0f64);
    for i in 0..200 {
        let p = (2.0 * grid::scattered(i) - 1.0).normalize() * 0.5;
        // g′(½) of the table, along the radius.
        let r: f64 = 0.5;
        let slope = -8.0 / 3.0 * r.powi(5) + 68.0 / 9.0 * r.powi(3) - 44.0 / 9.0 * r;
        let exact = p / r * slope;
        let (_, gradient) = ball.value_and_gradient(p);
        analytic = analytic.max((gradient - exact).length() / exact.length());
        let at = |p: glam::Vec3| ball.value(p.as_dvec3()) as f32;
        let (p, step) = (p.as_vec3(), 0.01 * side as f32);
        let difference = glam::Vec3::AXES.map(|axis| f64::from((at(p + axis * step) - at(p)) / step));
        forward = forward.max((DVec3::from_array(difference) - exact).length() / exact.length());
    }
    assert!(analytic < 1e-13 && forward > 1e-3, "{analytic:e} and {forward:e}");
}

/// The sample in the middle of an ambiguous face may be solid while its solid corners are apart: the saddle decides.
#[test]
fn slip_ambiguous_faces_are_settled_by_the_saddle() {
    // Solid at two corners across the face z = 0, where the middle is 0.15 and the saddle −0.02; nothing solid above.
    let d = [1.0, -0.2, -0.2, 0.01, -1.0, -1.0, -1.0, -1.0];
    assert!((d[0] + d[1] + d[2] + d[3]) / 4.0 > 0.0 && d[0] * d[3] < d[1] * d[2]);
    let pieces = |d: &[f64; 8]| {
        let found = crate::surface::triangles_of_cell(d);
        let mut sets: Vec<Vec<u8>> = Vec::new();
        for triangle in found.triangles {
            let (joined, apart): (Vec<_>, Vec<_>) =
                sets.into_iter().partition(|set| triangle.iter().any(|v| set.contains(v)));
            sets = apart;
            sets.push(joined.into_iter().flatten().chain(*triangle).collect());
        }
        sets.len()
    };
    assert_eq!(pieces(&d), 2);
    // The same corners joined, where the saddle is solid.
    assert_eq!(pieces(&[1.0, -0.2, -0.2, 0.1, -1.0, -1.0, -1.0, -1.0]), 1);
}
