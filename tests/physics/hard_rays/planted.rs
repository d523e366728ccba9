//! Roots planted in cells: f = Π (x_a − r_a) over some of the axes is trilinear, and along a ray it is the product
//! of as many linear factors. So the roots of the cubic are where the ray meets the planes x_a = r_a, up to
//! three at one point, and the terms above the number of factors vanish.

use crate::common::oracle::{BUDGET, Oracle, Said, Verdict, as_traced, judge};
use glam::{DVec3, Vec3};
use isolume::geom::Affine;
use isolume::level::{Counts, LevelField, Outcome, Pyramid, Start};
use isolume::volume::{Samples, Volume};
use proptest::prelude::*;

const N: usize = 4;

/// Planes that touch faces and edges of cells, or lie between.
fn a_plane() -> impl Strategy<Value = f64> {
    prop_oneof![3 => (0..N).prop_map(|k| k as f64), 2 => (0..2 * N).prop_map(|k| 0.5 * k as f64), 2 => 0.0..3.0f64,
        1 => (0..N).prop_map(|k| k as f64 + 1e-5), 1 => (0..N).prop_map(|k| k as f64 - 1e-7)]
}

fn a_component() -> impl Strategy<Value = f32> {
    prop_oneof![2 => Just(1.0f32), 2 => Just(-1.0), 2 => Just(0.0), 3 => -1.0..1.0f32, 1 => -1e-6..1e-6f32]
}

/// A field with planes along the axes of `mask`, its oracle, and one ray through it.
fn trace(planes: [f64; 3], mask: usize, scale: f64, from: [f64; 3], direction: Vec3) -> Result<(), TestCaseError> {
    let value = |p: [usize; 3]| (0..3).filter(|a| mask >> a & 1 == 1).fold(scale, |f, a| f * (p[a] as f64 - planes[a]));
    let samples: Vec<f32> = (0..N * N * N).map(|i| value([i % N, i / N % N, i / N / N]) as f32).collect();
    let volume = Volume::new([N; 3], Samples::F32(samples.clone()), Affine::IDENTITY).unwrap();
    let pyramid = Pyramid::new(&volume);
    let field = LevelField::new(&volume, &samples, &pyramid);
    let start = Start::beside(field.locate(from));
    let outcome = field.trace(0.0, &start, direction, &mut Counts::default());
    let profile = Oracle::new(&volume).profile(0.0, &start, direction, f64::INFINITY);
    let origin = start.at.cell.as_dvec3() + start.at.local.as_dvec3();
    let verdict = judge(&profile, false, Said::of(outcome, origin, as_traced(direction)));
    prop_assert!(!matches!(verdict, Verdict::Wrong(_)), "{verdict:?}: {outcome:?}");
    if let Outcome::Hit(hit) = outcome {
        // What it hit is one of the planes: f is 0 nowhere else. A triple root is flat, so that f is within rounding of
        // 0 a cube root of 2⁻²⁰ before it: a hundredth of a voxel.
        let at = hit.at.cell.as_dvec3() + hit.at.local.as_dvec3();
        let nearest =
            (0..3).filter(|a| mask >> a & 1 == 1).fold(f64::INFINITY, |m, a| m.min((at[a] - planes[a]).abs()));
        let start_is_on = (0..3).any(|a| mask >> a & 1 == 1 && (from[a] - planes[a]).abs() < BUDGET);
        prop_assert!(nearest < 0.02 || start_is_on, "{at} is {nearest} from a plane");
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 20_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn planted_planes_are_hit_at_every_multiplicity_and_scale(
        planes in prop::array::uniform3(a_plane()),
        mask in 0..8usize,
        exponent in -30..=30i32,
        negative in prop::bool::ANY,
        from in prop::array::uniform3(prop_oneof![(0..N).prop_map(|k| k as f64), 0.0..3.0f64]),
        direction in prop::array::uniform3(a_component()),
    ) {
        let direction = Vec3::from_array(direction);
        prop_assume!(direction.abs().max_element() > 0.0);
        let scale = if negative { -1.0 } else { 1.0 } * 10f64.powi(exponent);
        trace(planes, mask, scale, from, direction)?;
    }

    #[test]
    fn double_and_triple_roots_in_one_point(
        point in prop::array::uniform3(prop_oneof![Just(1.5f64), Just(2.0), 1.0..2.0f64]),
        kind in 0..4usize,
        exponent in -30..=30i32,
        negative in prop::bool::ANY,
        away in 0.1..1.0f64,
        direction in prop::array::uniform3(prop_oneof![Just(1.0f32), Just(-1.0), Just(0.5), 0.1..1.0f32]),
    ) {
        // All planes go through one point, and so does the ray: a triple root, or double roots in two axes.
        let direction = Vec3::from_array(direction);
        let from = DVec3::from_array(point) - direction.as_dvec3() * away;
        prop_assume!(from.min_element() >= 0.0 && from.max_element() <= 3.0);
        let scale = if negative { -1.0 } else { 1.0 } * 10f64.powi(exponent);
        trace(point, [7, 3, 5, 6][kind], scale, from.to_array(), direction)?;
    }
}
