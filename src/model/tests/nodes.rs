//! Closed forms of nodes, and gradients against differences.

use super::random::{Numbers, leaf, node, warp};
use super::*;
use crate::geom::{Affine, Bounds};
use scalar::{Dual, Jet, Scalar};

#[test]
fn falloffs_reach_one_half_where_the_table_says() {
    for (falloff, radius) in [
        (Falloff::Soft, 0.5),
        (Falloff::Metaball, 1.0 - 1.0 / 3f64.sqrt()),
        (Falloff::Wyvill, 0.454_202_0),
        (Falloff::Gaussian(4.0), (2f64.ln() / 4.0).sqrt()),
    ] {
        near(falloff.radius_at(0.5).unwrap(), radius, 5e-8);
        near(falloff.of_square(0.0), 1.0, 0.0);
        assert_eq!(falloff.of_square(6.0), 0.0);
        assert!(falloff.radius_at(0.0).is_none() && falloff.radius_at(1.0).is_none());
    }
    near(Falloff::Soft.radius_at(0.5).unwrap(), 0.5, 1e-15);
}

/// Two equal points merge where each is ¼ in the middle between them.
#[test]
fn points_merge_at_their_separation() {
    for (falloff, separation) in [
        (Falloff::Soft, 1.329_950),
        (Falloff::Metaball, 1.183_503),
        (Falloff::Wyvill, 1.216_617),
        (Falloff::Gaussian(4.0), 1.177_410),
    ] {
        near(2.0 * falloff.radius_at(0.25).unwrap(), separation, 5e-7);
        let two = |s: f64| {
            let x = DVec3::X * 0.5 * s;
            tree(Node::of(Op::Sum, vec![point(x, 1.0, falloff), point(-x, 1.0, falloff)])).value(DVec3::ZERO)
        };
        assert!(two(0.99 * separation) > 0.5 && two(1.01 * separation) < 0.5);
    }
}

/// Where two segments abut the field doubles: radius ½ becomes 0.664975. Convolution has no bulge.
#[test]
fn abutting_segments_bulge_and_convolution_does_not() {
    let r = Falloff::Soft.radius_at(0.25).unwrap();
    near(r, 0.664_975, 5e-7);
    let ends = [DVec3::NEG_X, DVec3::ZERO, DVec3::X];
    let halves = Node::of(Op::Sum, ends.windows(2).map(|w| soft(Shape::Segment([w[0], w[1]]), 1.0)).collect());
    near(tree(halves).value(DVec3::Y * r), 0.5, 1e-12);
    for kernel in [Kernel::Wyvill, Kernel::Gaussian(2.0), Kernel::Cauchy(2.0)] {
        let norm = kernel.norm_of_line(0.8);
        let of = |ends| Convolution { ends, kernel, reach: 0.8, norm };
        let (whole, parts) = (of([ends[0], ends[2]]), [of([ends[0], ends[1]]), of([ends[1], ends[2]])]);
        let mut n = Numbers(4);
        for _ in 0..200 {
            let p = (1.2 * n.place()).to_array();
            near(whole.value(p), parts.iter().map(|c| c.value(p)).sum(), 1e-12);
        }
    }
}

#[test]
fn two_equal_fields_under_ricci() {
    for (n, each) in [(2.0, 0.353_553), (4.0, 0.420_448)] {
        near(operator::ricci(&[each; 2], n), 0.5, 1e-6);
    }
    assert_eq!(operator::ricci(&[0.0, 0.0], 3.0), 0.0);
    assert_eq!(operator::ricci(&[0.0, 0.4], -3.0), 0.0);
    // No power overflows.
    near(operator::ricci(&[1e200, 1e200], 8.0), 1e200 * libm::pow(2.0, 0.125), 1e188);
}

#[test]
fn smooth_booleans_have_the_values_of_their_construction() {
    let crease = Crease { iso: 0.5, m: 0.7, k: 0.3 };
    for (a, b, union) in [(0.3, 0.3, 0.323_418), (0.8, 0.8, 0.877_370), (0.5, 0.4, 0.5)] {
        near(crease.union(a, b), union, 5e-7);
        near(crease.union(b, a), union, 5e-7);
    }
    for (a, b, both) in [(0.3, 0.3, 0.274_620), (0.8, 0.8, 0.775_769)] {
        near(crease.intersection(a, b), both, 5e-7);
    }
    // The support stays, and the surface is that of max and min.
    let mut n = Numbers(9);
    for _ in 0..2000 {
        let (a, b) = (n.between(0.0, 1.0), n.between(0.0, 1.0));
        near(crease.union(a, 0.0), a, 1e-15);
        assert_eq!(crease.union(a, b) > 0.5, a > 0.5 || b > 0.5, "{a} {b}");
        assert_eq!(crease.intersection(a, b) > 0.5, a > 0.5 && b > 0.5, "{a} {b}");
        // The gradient is continuous but where both are iso: small steps change it little.
        let slope = |a: f64, b: f64| {
            let dual = |value, gradient| Dual { value, gradient };
            [Crease::union::<Dual>, Crease::intersection::<Dual>]
                .map(|f| f(&crease, dual(a, DVec3::X), dual(b, DVec3::Y)).gradient)
        };
        let away = (a - 0.5f64).abs().max((b - 0.5).abs());
        if away > 0.05 && a > 0.01 && b > 0.01 {
            let (here, there) = (slope(a, b), slope(a + 1e-7, b - 1e-7));
            for (h, t) in here.iter().zip(&there) {
                assert!((h - t).length() < 1e-3 && h.x <= 1.0 + 1e-9 && h.y <= 1.0 + 1e-9, "{a} {b}: {h} {t}");
            }
        }
    }
}

#[test]
fn warps_are_the_inverse_of_what_is_seen() {
    for seed in 0..400 {
        let mut n = Numbers(50 * seed);
        let warp = warp(&mut n);
        for _ in 0..20 {
            let q = 0.9 * n.place();
            let p = warp.forward(q);
            let back = scalar::place(warp.inverse(p.to_array()));
            assert!((back - q).length() < 1e-12, "{warp:?}: {q} → {p} → {back}");
            let rows = warp.inverse(Dual::variables(p));
            let jacobian = glam::DMat3::from_cols(rows[0].gradient, rows[1].gradient, rows[2].gradient);
            let [_, j, _] = warp.axes;
            let [i, ..] = warp.axes;
            let expected = match warp.kind {
                Kind::Affine(map) => 1.0 / map.linear().determinant(),
                Kind::Twist { .. } => 1.0,
                Kind::Taper { range, scale } => {
                    let s = 1.0 + (scale - 1.0) * ((p[j] - range[0]) / (range[1] - range[0])).clamp(0.0, 1.0);
                    1.0 / (s * s)
                }
                Kind::Bend { rate, range, .. } => {
                    let is_bent = range[0] < q[i] && q[i] < range[1];
                    if is_bent { 1.0 / (1.0 - rate * q[j]) } else { 1.0 }
                }
            };
            near(jacobian.determinant(), expected, 1e-12 * expected.abs().max(1.0));
        }
    }
}

/// A fourth-order difference with what its error is, where halving the step shows that order: no kink lies nearby.
fn converged(tree: &Tree, p: DVec3) -> Option<(DVec3, f64)> {
    let [coarse, middle, fine] = [2e-3, 1e-3, 5e-4].map(|h| difference(tree, p, h));
    let scale = fine.length().max(1e-3);
    let (first, second) = ((coarse - middle).length(), (middle - fine).length());
    // The quotient is 16; rounding is about 1e-16 over the step.
    (second < 1e-6 * scale && second < 0.1 * first + 1e-9 * scale).then_some((fine, 1e-7 * scale + 1e-11))
}

/// Gradients of every node against fourth-order differences, 10⁻⁷ relative.
#[test]
fn gradients_are_those_of_differences() {
    let (mut compared, mut left_out) = (0, 0);
    let mut check = |tree: &Tree, n: &mut Numbers| {
        for _ in 0..12 {
            let p = n.place();
            let (value, gradient) = tree.value_and_gradient(p);
            assert_eq!(value.to_bits(), tree.value(p).to_bits(), "{tree:?}");
            let Some((expected, tolerance)) = converged(tree, p) else {
                left_out += 1;
                continue;
            };
            compared += 1;
            assert!((gradient - expected).length() < tolerance, "{gradient} for {expected} at {p}\n{tree:?}");
        }
    };
    for seed in 0..400 {
        let mut n = Numbers(77 * seed + 1);
        check(&tree(leaf(&mut n)), &mut n);
        check(&tree(node(&mut n, 2)), &mut n);
    }
    assert!(compared > 2 * left_out, "{compared} compared, {left_out} left out");
}

/// The same of what is made of samples, points and contacts.
#[test]
fn gradients_of_grids_points_and_contacts_are_those_of_differences() {
    let mut n = Numbers(123);
    let inner = tree(Node::of(Op::Sum, (0..5).map(|_| point(0.6 * n.place(), 0.8, Falloff::Wyvill)).collect()));
    let bounds = Bounds { min: DVec3::NEG_ONE, max: DVec3::ONE };
    let mut samples = Vec::new();
    inner.sample(&bounds, [24; 3], true, &mut samples);
    let grid = Grid::new([24; 3], samples, bounds, Between::Cubic).unwrap();
    let grid = tree(Node::leaf(Leaf::Grid(grid.into())));
    let points: Vec<(DVec3, f64)> = (0..40).map(|_| (n.place(), n.unit())).collect();
    let rbf = tree(Node::leaf(Leaf::Rbf(Rbf::through(&points, Radial::Cubic, 0.0).unwrap().into())));
    let bodies = [
        point(DVec3::new(-0.3, 0.0, 0.0), 1.1, Falloff::Soft),
        soft(Shape::Segment([DVec3::X * 0.3, DVec3::new(0.3, 0.5, 0.2)]), 0.8),
    ];
    let trees = bodies.clone().map(tree);
    let mut all = vec![grid, rbf];
    for show in [Show::First, Show::Second, Show::Both(0.05)] {
        let contact = Contact::new(0.5, 0.4, 0.8, show, [&trees[0], &trees[1]], &bounds);
        assert!(contact.is_touching());
        let warp =
            Warp::affine(Affine::new(glam::DMat3::from_diagonal(DVec3::new(1.0, 1.2, 0.9)), DVec3::ZERO).unwrap());
        all.push(tree(Node::of(Op::Warp(warp), vec![Node::of(Op::Contact(contact.into()), bodies.to_vec())])));
    }
    for (i, tree) in all.iter().enumerate() {
        let mut compared = 0;
        for _ in 0..300 {
            let p = 0.9 * n.place();
            let (_, gradient) = tree.value_and_gradient(p);
            let Some((expected, tolerance)) = converged(tree, p) else { continue };
            compared += 1;
            assert!((gradient - expected).length() < tolerance, "tree {i}: {gradient} for {expected} at {p}");
        }
        assert!(compared > 100, "tree {i}: {compared}");
    }
}

/// How far a grid is from what was sampled falls with at least the third power of its spacing where that is smooth.
#[test]
fn cached_subtrees_converge() {
    let inner = tree(Node::leaf(Leaf::Formula(Formula::parse("sin(2*x)*cos(3*y) + z^2", &[]).unwrap().into())));
    let bounds = Bounds { min: DVec3::NEG_ONE, max: DVec3::ONE };
    let middle = Bounds { min: DVec3::splat(-0.7), max: DVec3::splat(0.7) };
    let error = |n: usize| {
        let mut samples = Vec::new();
        inner.sample(&bounds, [n; 3], true, &mut samples);
        let grid = Grid::new([n; 3], samples, bounds, Between::Cubic).unwrap();
        grid::difference(&middle, 2000, |p| inner.value(p), |p| grid.value(p.to_array()))[1]
    };
    let (coarse, fine) = (error(17), error(33));
    assert!(coarse < 2e-3 && coarse / fine > 6.0, "{coarse} {fine}");
}

#[test]
fn convex_models_are_known() {
    let convex = |node: Node| tree(node).is_convex();
    let (a, b) = (DVec3::ZERO, DVec3::new(1.0, 0.5, 0.0));
    assert!(convex(point(a, 1.0, Falloff::Metaball)) && convex(soft(Shape::Segment([a, b]), 0.5)));
    let cone = Skeletal { shape: Shape::Segment([a, b]), reach: [0.6, 0.3], falloff: Falloff::Soft, weight: 1.0 };
    assert!(!convex(Node::leaf(Leaf::Skeletal(cone))), "re-entrant at its small end");
    let plane = |normal: DVec3| Node::leaf(Leaf::Distance(Shape::HalfSpace(a, normal), 0.0));
    assert!(convex(Node::of(Op::Intersection, vec![plane(DVec3::X), plane(DVec3::Y), plane(-DVec3::Z)])));
    assert!(!convex(Node::of(Op::Sum, vec![point(a, 1.0, Falloff::Soft), point(b, 1.0, Falloff::Soft)])));
    let moved = Warp::affine(Affine::new(glam::DMat3::from_diagonal(DVec3::new(1.0, 2.0, 3.0)), b).unwrap());
    assert!(convex(Node::of(Op::Warp(moved), vec![point(a, 1.0, Falloff::Soft)])));
    let twist = Warp { axes: [0, 1, 2], kind: Kind::Twist { rate: 1.0 } };
    assert!(!convex(Node::of(Op::Warp(twist), vec![point(a, 1.0, Falloff::Soft)])));
}

#[test]
fn trees_that_make_no_sense_are_refused() {
    let refused = |node: Node| Tree::new(node).unwrap_err().to_string();
    let one = || point(DVec3::ZERO, 1.0, Falloff::Soft);
    assert!(refused(Node::of(Op::Sum, vec![])).contains("0 nodes"));
    assert!(refused(Node::of(Op::Offset(1.0), vec![one(), one()])).contains("2 nodes"));
    assert!(refused(Node::of(Op::Sum, (0..=tree::MOST_NODES).map(|_| one()).collect())).contains("nodes"));
    let deep = (0..=tree::DEEPEST).fold(one(), |node, _| Node::of(Op::Offset(0.0), vec![node]));
    assert!(refused(deep).contains("nesting"));
}

#[test]
fn formulas_are_read_as_written() {
    let value = |text: &str| Formula::parse(text, &[("r".into(), 0.25)]).map(|f| f.value([2.0, 3.0, 0.5])).unwrap();
    for (text, expected) in [
        ("1 + 2*x - y/2", 3.5),
        ("-x^2", -4.0),
        ("2^3^2", 512.0),
        ("x^-1", 0.5),
        ("(x - y)^3", -1.0),
        ("--x", 2.0),
        ("r * 4e0 + 1.5e-1", 1.15),
        ("max(x, min(y, 2.5)) + clamp(y, 0, 1)", 3.5),
        ("sqrt(x^2 + y^2 + z^2 - 0.25)", 13f64.sqrt()),
        ("floor(-z) + abs(-y) + cbrt(8)", 4.0),
        ("sin(pi/2) + cos(0) + atan2(0, x) + ln(exp(2)) + log2(8)", 7.0),
        ("x^0.5 * x^0.5", 2.0),
    ] {
        near(value(text), expected, 1e-12);
    }
    for (text, found) in [
        ("", "the end"),
        ("1 +", "the end"),
        ("(x", "the end"),
        ("x y", "`y` at character 3"),
        ("sin x", "`x` at character 5"),
        ("min(1)", "`)` at character 6"),
        ("q + 1", "the name `q`"),
        ("1..2", "`1`"),
        ("x ** 2", "`*` at character 4"),
        ("§", "`§` at character 1"),
    ] {
        let wrong = Formula::parse(text, &[]).unwrap_err();
        assert!(wrong.found.contains(found), "{text}: {wrong:?}");
    }
    assert!(Formula::parse(&"(".repeat(1000), &[]).is_err());
    assert!(Formula::parse(&"x+".repeat(10_000), &[]).is_err());
}

/// Hessians, from which contacts take the gradient of their slope, against differences of gradients.
#[test]
fn hessians_are_differences_of_gradients() {
    let mut compared = 0;
    for seed in 0..300 {
        let mut n = Numbers(91 * seed + 3);
        let tree = tree(node(&mut n, 2));
        for _ in 0..6 {
            let p = n.place();
            let jet: Jet = tree.at(Jet::variables(p));
            let rows = |h: f64| -> [DVec3; 3] {
                let g = |q: DVec3| tree.value_and_gradient(q).1;
                DVec3::AXES.map(|e| {
                    (g(p - 2.0 * h * e) - 8.0 * g(p - h * e) + 8.0 * g(p + h * e) - g(p + 2.0 * h * e)) / (12.0 * h)
                })
            };
            let (coarse, fine) = (rows(1e-3), rows(2.5e-4));
            let size = |m: &[DVec3; 3]| m.iter().map(|r| r.length()).sum::<f64>();
            let off = |a: &[DVec3; 3], b: &[DVec3; 3]| (0..3).map(|i| (a[i] - b[i]).length()).sum::<f64>();
            let scale = size(&fine).max(1e-2);
            if off(&coarse, &fine) > 2e-5 * scale {
                continue;
            }
            compared += 1;
            assert!(off(&jet.hessian, &fine) < 1e-6 * scale, "{:?} {fine:?} at {p}\n{tree:?}", jet.hessian);
        }
    }
    assert!(compared > 800, "{compared}");
}
