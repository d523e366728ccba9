//! Continuation against all cells, watertight tetrahedra, and the errors of vertices.

use super::*;
use crate::grid3;
use crate::model::{Falloff, Leaf, Node, Op, Shape, Skeletal, root_on_segment};
use crate::scene::sample;
use crate::volume::Solid;
use std::collections::{BTreeMap, BTreeSet};

fn point(centre: [f64; 3], reach: f64, weight: f64) -> Node {
    let shape = Shape::Point(DVec3::from(centre));
    Node::leaf(Leaf::Skeletal(Skeletal { shape, reach: [reach; 2], falloff: Falloff::Soft, weight }))
}

fn sum(of: Vec<Node>) -> Tree {
    Tree::new(Node::of(Op::Sum, of)).unwrap()
}

const BOUNDS: Bounds = Bounds { min: DVec3::splat(-1.5), max: DVec3::splat(1.5) };

const ABOVE: Sides = Sides { iso: 0.5, sign: 1.0, missing: 0.0 };

fn model(tree: Tree, dims: [usize; 3]) -> ModelDescription {
    let tree = Arc::new(tree);
    ModelDescription { tree, bounds: BOUNDS, isovalue: 0.5, dims, notes: Vec::new(), up: None, solid: None }
}

fn continued(tree: &Tree, dims: [usize; 3], kind: CellKind, roots: RootFinder) -> Found {
    let mut surface = Continuation::new(tree, &BOUNDS, dims, ABOVE);
    let seeds = surface.seeds();
    surface.run(seeds, kind, roots);
    surface.found
}

/// Triangles as sorted corners, rounded to where the vertices of two meshes can be told apart.
fn triangles(positions: &[DVec3], triangles: &[[u32; 3]]) -> BTreeSet<[[i64; 3]; 3]> {
    let key = |v: u32| (positions[v as usize] * 1024.0).round().to_array().map(|x| x as i64);
    triangles
        .iter()
        .map(|t| {
            let keys = t.map(key);
            // The same turn, from the least corner on.
            let first = (0..3).min_by_key(|&i| keys[i]).unwrap();
            [0, 1, 2].map(|i| keys[(first + i) % 3])
        })
        .collect()
}

/// One blob, and three of which two have merged: all are reached from the skeletons.
fn blobs() -> [Tree; 2] {
    let three =
        vec![point([-0.7, 0.1, 0.0], 0.8, 1.0), point([-0.1, 0.0, 0.2], 0.8, 1.0), point([0.9, 0.0, -0.3], 0.7, 1.0)];
    [sum(vec![point([0.03, 0.02, 0.01], 1.0, 1.0)]), sum(three)]
}

#[test]
fn continuation_finds_the_triangles_of_a_full_march() {
    let dims = [27, 29, 31];
    for tree in blobs() {
        let found = continued(&tree, dims, CellKind::Cubes, RootFinder::Linear);
        let mut all = Continuation::new(&tree, &BOUNDS, dims, ABOVE);
        for cell in grid3::all(dims.map(|n| n - 1)) {
            all.cell(cell, CellKind::Cubes, RootFinder::Linear);
        }
        let all = all.found;
        assert!(!found.searched && found.visited < all.visited / 4, "{} of {}", found.visited, all.visited);
        assert_eq!(triangles(&found.positions, &found.triangles), triangles(&all.positions, &all.triangles));
        // The march of the product is on samples, in single precision.
        let volume = sample(&model(tree, dims), "m".into()).unwrap();
        let mesh = crate::surface::extract(&volume, 0.5).unwrap();
        assert_eq!(mesh.triangles.len(), all.triangles.len());
        assert_eq!(found.crossed, straddling_cells(&volume, 0.5).count());
        let positions: Vec<DVec3> =
            mesh.positions_in_grid.iter().map(|p| DVec3::from_array(p.map(f64::from))).collect();
        let off = |p: &DVec3| positions.iter().map(|q| (*p - *q).length()).fold(f64::INFINITY, f64::min);
        let far = found.positions.iter().map(off).fold(0.0, f64::max);
        // There vertices are held 2⁻¹⁴ from grid points.
        assert!(found.positions.len() == positions.len() && far < 1.1 / 16384.0, "vertices {far:e} apart");
    }
}

/// Every edge once in each direction.
#[track_caller]
fn assert_watertight(found: &Found) {
    let mut edges: BTreeMap<[u32; 2], i32> = BTreeMap::new();
    for t in &found.triangles {
        for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
            *edges.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
            assert_ne!(a, b);
        }
    }
    assert!(edges.values().all(|n| *n == 0), "open edges, or triangles that turn the other way");
}

fn enclosed(found: &Found) -> f64 {
    let at = |v: u32| found.positions[v as usize];
    found.triangles.iter().map(|&[a, b, c]| at(a).dot(at(b).cross(at(c))) / 6.0).sum()
}

#[test]
fn tetrahedra_are_watertight_and_face_outwards() {
    let dims = [25, 25, 25];
    for tree in blobs() {
        let cubes = continued(&tree, dims, CellKind::Cubes, RootFinder::Newton);
        assert_watertight(&cubes);
        for roots in RootFinder::ALL {
            let found = continued(&tree, dims, CellKind::Tetrahedra, roots);
            assert_watertight(&found);
            assert_eq!(found.visited, cubes.visited);
            let (ours, theirs) = (enclosed(&found), enclosed(&cubes));
            assert!(ours > 0.0 && (ours / theirs - 1.0).abs() < 0.02, "{ours} against {theirs}");
            let ratio = found.triangles.len() as f64 / cubes.triangles.len() as f64;
            assert!(ratio > 1.8 && ratio < 3.2, "{ratio} times the triangles");
        }
    }
    // Noise has every pattern of corners: ambiguous faces, tunnels, and faces of the box.
    let noise = crate::model::Formula::parse("0.5 + sin(9*x+7*y) * cos(11*z-5*x) + sin(13*y*z+8*x)", &[]).unwrap();
    let inside = Node::leaf(Leaf::Formula(noise.into()));
    let tree = Tree::new(Node::of(Op::Intersection, vec![inside, point([0.0; 3], 2.0, 1.0)])).unwrap();
    let found = continued(&tree, [33; 3], CellKind::Tetrahedra, RootFinder::Linear);
    assert!(found.searched && found.triangles.len() > 10_000);
    assert_watertight(&found);
}

/// Continuation from one seed misses components; carved fields have none on the skeleton: then rows are searched.
#[test]
fn slip_components_are_found_from_all_skeletons_or_by_search() {
    let [_, three] = blobs();
    let dims = [27; 3];
    let mut one = Continuation::new(&three, &BOUNDS, dims, ABOVE);
    let seeds = one.seeds();
    one.run(seeds[..1].to_vec(), CellKind::Cubes, RootFinder::Linear);
    let all = continued(&three, dims, CellKind::Cubes, RootFinder::Linear);
    assert!(one.found.triangles.len() < all.triangles.len());
    // The carved part is far from any surface, and the solid has no skeleton.
    let ball = crate::model::Formula::parse("1 - x^2 - y^2 - z^2", &[]).unwrap();
    let carved = sum(vec![Node::leaf(Leaf::Formula(ball.into())), point([9.0, 9.0, 9.0], 0.5, -1.0)]);
    let found = continued(&carved, dims, CellKind::Cubes, RootFinder::Linear);
    let volume = sample(&model(carved, dims), "m".into()).unwrap();
    assert!(found.searched);
    assert_eq!(found.crossed, straddling_cells(&volume, 0.5).count());
}

/// On one soft point, R = 1, of an edge from 0.5 − 0.37 h to 0.5 + 0.63 h; the crossing is at r = ½ (exact).
#[test]
fn errors_of_roots_on_an_edge_are_those_of_the_table() {
    let tree = sum(vec![point([0.0; 3], 1.0, 1.0)]);
    for (h, percent) in [(0.25, 0.5567), (0.125, 0.1104), (0.0625, 0.01454)] {
        let ends = [0.5 - 0.37 * h, 0.5 + 0.63 * h].map(|x| DVec3::X * x);
        let values = ends.map(|p| tree.value(p));
        let error = |finder| {
            let root = root_on_segment(&tree, 0.5, ends, values, finder);
            ((root.along.unwrap() - 0.37).abs(), root.evaluations)
        };
        let (linear, none) = error(RootFinder::Linear);
        assert!((100.0 * linear / percent - 1.0).abs() < 5e-4 && none == 0, "{:.5} %", 100.0 * linear);
        for finder in [RootFinder::RegulaFalsi, RootFinder::Newton] {
            let (off, evaluations) = error(finder);
            assert!(off < 1e-12 && evaluations < 12, "{}: {off:e} after {evaluations}", finder.name());
        }
    }
}

/// A short step is no sign of a root: all but one of these are flat, steep or neither on the way to it, and one jumps.
#[test]
fn roots_are_found_where_steps_are_short_far_from_them() {
    let cases = [
        ("x^20 - 1e-13", 10f64.powf(-13.0 / 20.0)),
        ("x^40 - 1e-30", 10f64.powf(-30.0 / 40.0)),
        ("(x - 0.7)^9", 0.7),
        ("sqrt(x) - 1e-5", 1e-10),
        ("atan(1e9*(x - 0.3))", 0.3),
        ("1e-9 - exp(-40*x)", 9.0 * 10f64.ln() / 40.0),
        ("min(x - 0.6, 1e-14)", 0.6),
        ("floor(x + 0.75) - 0.5", 0.25),
        ("x - 0.123", 0.123),
        // The first step ends where it touches 0.
        ("(0.25 - x)*(x - 0.5)^2*(3 - 2*x)", 0.25),
    ];
    for (text, exact) in cases {
        let formula = crate::model::Formula::parse(text, &[]).unwrap();
        let tree = Tree::new(Node::leaf(Leaf::Formula(formula.into()))).unwrap();
        for ends in [[DVec3::ZERO, DVec3::X], [DVec3::X, DVec3::ZERO]] {
            let values = ends.map(|p| tree.value(p));
            for finder in [RootFinder::RegulaFalsi, RootFinder::Newton] {
                let root = root_on_segment(&tree, 0.0, ends, values, finder);
                let at = (ends[0] + (ends[1] - ends[0]) * root.along.unwrap()).x;
                assert!((at - exact).abs() <= 1.1e-12, "{text}, {}: {at:e} for {exact:e}", finder.name());
                assert!(root.evaluations <= 80, "{text}, {}: {} evaluations", finder.name(), root.evaluations);
            }
        }
    }
}

/// Solid below; values that are missing, which samples fill with the least of the others; both.
#[test]
fn sides_are_those_of_the_samples() {
    let blob = "sqrt(x^2 + y^2 + z^2) - 0.7 + 0.5";
    let holed = "1.2 - sqrt(x^2 + y^2 + z^2) + 0*sqrt(x + 0.1)";
    for (text, solid) in [(blob, Solid::Below), (holed, Solid::Above), (holed, Solid::Below)] {
        let formula = crate::model::Formula::parse(text, &[]).unwrap();
        let tree = Tree::new(Node::leaf(Leaf::Formula(formula.into()))).unwrap();
        let model = ModelDescription { solid: Some(solid), ..model(tree, [21, 22, 23]) };
        let study = compare_polygonizers(&model, 0.5, &|| [0.0; 2], &|_| {}).unwrap();
        let all = &study.rows[0];
        for row in &study.rows {
            assert_eq!(row.missed, 0, "{text}, {solid:?}: {} {}", row.name(), row.cells.name());
            assert!(row.cells != all.cells || row.triangles == all.triangles, "{text}, {solid:?}");
        }
        // Faces look out of the solid.
        let volume = sample(&model, "m".into()).unwrap();
        let mut surface = Continuation::new(&model.tree, &BOUNDS, model.dims, Sides::new(&volume, 0.5));
        let seeds = surface.seeds();
        surface.run(seeds, CellKind::Tetrahedra, RootFinder::Newton);
        let found = surface.found;
        let inwards = found.triangles.iter().filter(|t| {
            let [a, b, c] = t.map(|v| found.positions[v as usize]);
            let voxel = BOUNDS.size() / DVec3::from_array(model.dims.map(|n| (n - 1) as f64));
            let middle = BOUNDS.min + (a + b + c) / 3.0 * voxel;
            let (_, gradient) = model.tree.value_and_gradient(middle);
            let turn = (b - a).cross(c - a).dot(gradient * voxel);
            if solid == Solid::Above { turn > 0.0 } else { turn < 0.0 }
        });
        assert_eq!(inwards.count(), 0, "{text}, {solid:?}");
    }
}

#[test]
fn a_study_has_a_row_for_each_and_exact_vertices_are_exact() {
    let [_, three] = blobs();
    let model = model(three, [25; 3]);
    let study = compare_polygonizers(&model, 0.5, &|| [0.0; 2], &|_| {}).unwrap();
    assert_eq!(study.rows.len(), 8);
    assert!(study.rows.iter().all(|row| row.missed == 0));
    // Bricks that are filled take none; on an edge of the grid a vertex takes both ends, a root and a normal.
    let (samples, exact) = (&study.rows[0], &study.rows[1]);
    assert!(samples.evaluations > 1000 && samples.evaluations < 25 * 25 * 25, "{}", samples.evaluations);
    assert!(exact.evaluations - samples.evaluations >= 4 * exact.vertices, "{}", exact.evaluations);
    for row in &study.rows[2..] {
        let of_roots =
            row.evaluations - study.rows.iter().find(|r| r.continues && r.cells == row.cells).unwrap().evaluations;
        let is_linear = row.roots == RootFinder::Linear;
        assert!(is_linear && of_roots == 0 || of_roots >= row.vertices && of_roots < 20 * row.vertices, "{of_roots}");
    }
    for row in &study.rows {
        let most = match (row.roots, row.continues) {
            (RootFinder::Linear, _) => 0.25,
            // Positions below 32 in single precision are within 2⁻²⁰; edges keep vertices 2⁻¹⁴ from their ends.
            (_, false) => 1.1 / 16384.0,
            _ => 1e-10,
        };
        assert!(row.errors.most < most, "{} {}: {:e}", row.name(), row.roots.name(), row.errors.most);
        assert!(row.roots != RootFinder::Linear || row.errors.rms > 1e-4);
    }
    let text = study.csv();
    assert!(text.lines().count() == 9 && text.lines().all(|line| line.split(',').count() == 12), "{text}");
}
