//! The cubic of a segment and its first rise, against f64.

use super::*;
use crate::level::cell::{self, Cubic, along_segment, deflate, right_part, trilinear};
use glam::Vec4;
use proptest::prelude::*;

/// The cubic with these Bernstein coefficients, in f64.
fn value(b: &[f64; 4], t: f64) -> f64 {
    let s = 1.0 - t;
    b[0] * s * s * s + 3.0 * b[1] * s * s * t + 3.0 * b[2] * s * t * t + b[3] * t * t * t
}

/// Ends and extremes of a cubic on [0, 1]: between two of them it is monotone.
fn nodes(b: &[f64; 4]) -> Vec<f64> {
    let (d0, d1, d2) = (b[1] - b[0], b[2] - b[1], b[3] - b[2]);
    let (a, h) = (d0 - 2.0 * d1 + d2, d1 - d0);
    let root = h * h - a * d0;
    let mut all = vec![0.0, 1.0];
    if root >= 0.0 {
        let q = -(h + h.signum() * root.sqrt());
        all.extend([q / a, d0 / q].into_iter().filter(|t| *t > 0.0 && *t < 1.0));
    }
    all.sort_by(f64::total_cmp);
    all
}

/// Where the first rise is.
fn first_rise(b: &Cubic) -> Option<f32> {
    cell::first_rise(b).map(|bracket| bracket.root())
}

/// First t with f > `level` after f ≤ `level`.
fn rise_above(b: &[f64; 4], level: f64) -> Option<f64> {
    let nodes = nodes(b);
    if value(b, 0.0) > level {
        return Some(0.0);
    }
    let up = nodes.iter().position(|&t| value(b, t) > level)?;
    let (mut low, mut high) = (nodes[up - 1], nodes[up]);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if value(b, middle) > level { high = middle } else { low = middle }
    }
    Some(high)
}

/// Judges [`first_rise`] on coefficients taken as exact: the answer must lie between the first
/// rise above −slack and that above +slack, give or take the width of the bracket. Eight roundings
/// of the largest coefficient are the slack.
fn judge(b: &Cubic) -> Result<(), String> {
    let exact = b.map(f64::from);
    let largest = exact.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let slack = 8.0 * 2f64.powi(-24) * largest;
    // The bracket, and the half of it that Newton's last step may be off.
    let width = 2f64.powi(-21);
    let found = first_rise(b).map(f64::from);
    let early = rise_above(&exact, -slack);
    let late = rise_above(&exact, slack);
    let fine = match found {
        Some(t) => {
            (0.0..=1.0).contains(&t) && early.is_some_and(|e| t >= e - width) && late.is_none_or(|l| t <= l + width)
        }
        None => late.is_none(),
    };
    if fine { Ok(()) } else { Err(format!("{b:?}: found {found:?}, between {early:?} and {late:?}")) }
}

/// Corners of a cell of some kind: smooth, 8-bit, noise, checkers.
fn corners(kind: u64, item: u64) -> [f32; 8] {
    let u = |k: u64| uniform(kind, item, k) as f32;
    let g = Vec3::new(u(20) - 0.5, u(21) - 0.5, u(22) - 0.5);
    std::array::from_fn(|k| {
        let p = Vec3::new((k & 1) as f32, (k >> 1 & 1) as f32, (k >> 2) as f32);
        let noise = u(30 + k as u64);
        match kind {
            0 => 5.0 + g.dot(p) + 0.02 * noise,
            1 => (120.0 + 9.0 * g.dot(p) + 0.7 * noise).round(),
            2 => noise,
            _ => p.element_sum() % 2.0,
        }
    })
}

#[test]
fn a_million_cell_segments_have_no_miss_and_no_ghost() {
    const SEGMENTS: u64 = 520_000;
    let (mut tested, mut hits, mut worst) = (0u64, 0u64, 0.0f64);
    for kind in 0..4 {
        for item in 0..SEGMENTS {
            let v = corners(kind, item);
            let u = |k: u64| uniform(kind, item, k);
            let mut ends = [0, 4].map(|k| Vec3::new(u(k) as f32, u(k + 1) as f32, u(k + 2) as f32));
            // On faces, as in a march; one in eight starts inside the cell.
            if item % 8 != 0 {
                ends[0][item as usize % 3] = (item / 3 % 2) as f32;
            }
            ends[1][item as usize / 6 % 3] = (item / 18 % 2) as f32;
            let (low, high) = v.iter().fold((f32::MAX, f32::MIN), |(l, h), &v| (l.min(v), h.max(v)));
            let c = if kind == 1 && item % 5 == 0 { v[item as usize % 8] } else { low + (high - low) * u(10) as f32 };
            let face = |x: usize| Vec4::new(v[x] - c, v[x + 2] - c, v[x + 4] - c, v[x + 6] - c);
            let cubic = along_segment(face(0), face(1), ends[0], ends[1]);
            // By definition: eight weights at a point of the segment, in f64, and four such points
            // give the Bernstein coefficients.
            let f = |t: f64| {
                let p = ends[0].as_dvec3() * (1.0 - t) + ends[1].as_dvec3() * t;
                (0..8).fold(0.0, |sum, k| {
                    let w = |bit: usize, x: f64| if k >> bit & 1 == 1 { x } else { 1.0 - x };
                    sum + w(0, p.x) * w(1, p.y) * w(2, p.z) * (f64::from(v[k]) - f64::from(c))
                })
            };
            let [f0, f1, f2, f3] = [0.0, 1.0, 2.0, 3.0].map(|i| f(i / 3.0));
            let b1 = (-5.0 * f0 + 18.0 * f1 - 9.0 * f2 + 2.0 * f3) / 6.0;
            let b2 = (2.0 * f0 - 9.0 * f1 + 18.0 * f2 - 5.0 * f3) / 6.0;
            let exact = [f0, b1, b2, f3];
            // Roundings of the field itself: c may be far larger than the differences.
            let scale = f64::from(high.abs().max(c.abs()));
            let slack = 16.0 * 2f64.powi(-24) * scale;
            if f0 > -slack {
                continue;
            }
            tested += 1;
            let (early, late) = (rise_above(&exact, -slack), rise_above(&exact, slack));
            match first_rise(&cubic).map(f64::from) {
                Some(t) => {
                    hits += 1;
                    assert!(early.is_some_and(|e| t >= e - 1e-6), "ghost {kind} {item}: {t}, {early:?} {late:?}");
                    assert!(late.is_none_or(|l| t <= l + 1e-6), "late {kind} {item}: {t}, {early:?} {late:?}");
                    if let (Some(e), Some(l)) = (early, late)
                        && l - e < 1e-5
                    {
                        worst = worst.max((t - rise_above(&exact, 0.0).unwrap()).abs());
                    }
                }
                None => assert!(late.is_none(), "miss {kind} {item}: {exact:?} rises at {late:?}"),
            }
            // Looking at 65 points is the same as the closed form.
            if item % 64 == 0 {
                let dense = (0..=64).map(|i| f64::from(i) / 64.0).find(|&t| f(t) > slack);
                assert!(dense.is_none_or(|t| late.is_some_and(|l| l <= t)), "{kind} {item}");
            }
        }
    }
    assert!(tested > 1_000_000 && hits > 250_000, "{tested} {hits}");
    assert!(worst < 1e-5, "{worst}");
}

#[test]
fn both_trilinear_forms_agree() {
    for item in 0..20_000 {
        let v = corners(item % 4, item);
        let u = |k: u64| uniform(5, item, k) as f32;
        let p = Vec3::new(u(0), u(1), u(2));
        let (low, high) = ([v[0], v[2], v[4], v[6]], [v[1], v[3], v[5], v[7]]);
        let cubic = along_segment(Vec4::from_array(low), Vec4::from_array(high), p, Vec3::new(u(3), u(4), u(5)));
        let largest = v.iter().fold(0.0f32, |m, v| m.max(v.abs()));
        assert!((cubic[0] - trilinear(&low, &high, p)).abs() <= 4.0 * f32::EPSILON * largest);
    }
}

/// Bernstein coefficients of scale·(±1)·Π (t − r), f64 product rounded to f32.
fn planted(roots: &[f64], sign: f64, scale: f64) -> Cubic {
    // Power basis by multiplying out, then b_k = Σ_i C(k,i)/C(3,i) a_i.
    let mut a = [0.0; 4];
    a[0] = 1.0;
    for &r in roots {
        for i in (0..4).rev() {
            a[i] = -r * a[i] + if i > 0 { a[i - 1] } else { 0.0 };
        }
    }
    let b = [a[0], a[0] + a[1] / 3.0, a[0] + (2.0 * a[1] + a[2]) / 3.0, a[0] + a[1] + a[2] + a[3]];
    b.map(|v| (sign * scale * v) as f32)
}

/// Roots that touch: double, triple, at the ends, just outside, and any.
fn a_root() -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.0), Just(1.0), Just(0.5), Just(0.25), 0.0..1.0f64, -0.01..0.01f64, 0.99..1.01f64, -1.0..2.0f64]
}

fn a_scale() -> impl Strategy<Value = f64> {
    (-30..=30i32).prop_map(|e| 10f64.powi(e))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 20_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn planted_roots(r in a_root(), s in a_root(), t in a_root(), kind in 0..7, sign in prop::bool::ANY, scale in a_scale()) {
        let roots = match kind {
            0 => vec![r, r, t],
            1 => vec![r, r, r],
            2 => vec![r, s],
            3 => vec![r, r],
            4 => vec![r],
            5 => vec![],
            _ => vec![r, s, t],
        };
        let b = planted(&roots, if sign { 1.0 } else { -1.0 }, scale);
        prop_assert!(judge(&b).is_ok(), "{:?}: {:?}", roots, judge(&b));
    }

    #[test]
    fn any_coefficients(b in prop::array::uniform4(prop_oneof![
        4 => -1.0..1.0f32, 1 => Just(0.0f32), 1 => Just(-0.0f32), 1 => -1e-6..1e-6f32, 1 => -1e6..1e6f32
    ]), scale in a_scale()) {
        let b = b.map(|v| (f64::from(v) * scale) as f32);
        prop_assert!(judge(&b).is_ok(), "{:?}", judge(&b));
    }

    #[test]
    fn a_rise_does_not_depend_on_a_power_of_two(b in prop::array::uniform4(-1.0..1.0f32), e in -60..60i32) {
        let scaled = b.map(|v| v * 2f32.powi(e));
        // Below the smallest normal number bits are lost.
        prop_assume!(scaled.iter().all(|v| *v == 0.0 || v.abs() > 1e-30));
        prop_assert_eq!(first_rise(&b), first_rise(&scaled));
    }

    #[test]
    fn deflating_divides_by_t(b in prop::array::uniform4(-1.0..1.0f32), t in 0.01..1.0f64) {
        let b = [0.0, b[1], b[2], b[3]];
        let by_definition = value(&b.map(f64::from), t) / t;
        // Sums of up to three terms of size ≤ 3, four roundings.
        prop_assert!((value(&deflate(b).map(f64::from), t) - by_definition).abs() < 12.0 * f64::from(f32::EPSILON));
    }

    #[test]
    fn the_right_part_is_the_same_cubic(b in prop::array::uniform4(-1.0..1.0f32), t in 0.0..1.0f32, u in 0.0..1.0f64) {
        let part = right_part(b, t).map(f64::from);
        let at = f64::from(t) + (1.0 - f64::from(t)) * u;
        prop_assert!((value(&part, u) - value(&b.map(f64::from), at)).abs() < 8.0 * f64::from(f32::EPSILON));
    }
}

#[test]
fn subnormal_and_huge_coefficients_keep_their_roots() {
    for scale in [1e-44f32, 1e-40, 1e-38, 1e-37, 1e36, 1e38] {
        let t = first_rise(&[-scale, -scale, 3.0 * scale, 3.0 * scale].map(|v| v.min(3e38))).unwrap();
        assert!(t > 0.2 && t < 0.8, "{scale}: {t}");
        assert_eq!(first_rise(&[-scale, -scale, -scale, 0.0]), None);
        assert_eq!(first_rise(&[scale, -scale, -scale, 0.0]), Some(0.0));
    }
}

/// Eight at a time, in whatever company, a bracket gets the root that it gets alone.
#[test]
fn roots_found_together_are_the_bits_of_each_alone() {
    let coefficient = |item: u64, k: u64| {
        let u = (uniform(151, item, k) * 2.0 - 1.0) as f32;
        // Of all sizes, some nearly 0 and some 0, so that brackets end at stationary points and at faces.
        match item % 4 {
            0 => u,
            1 => u * u * u * u * u,
            2 => (u * 4.0).round(),
            _ => u * 10f32.powi((8.0 * uniform(152, item, k)) as i32 - 4),
        }
    };
    let brackets: Vec<Bracket> = (0..400_000)
        .filter_map(|item| {
            let b: Cubic = std::array::from_fn(|k| coefficient(item, k as u64));
            cell::first_rise(&[if item % 16 == 0 { 0.0 } else { -b[0].abs() }, b[1], b[2], b[3]])
        })
        .collect();
    assert!(brackets.len() > 200_000);
    let split = brackets.iter().filter(|b| b.low > 0.0 || b.high < 1.0).count();
    assert!(split > 1000, "{split} brackets end at a stationary point");
    for eight in brackets.chunks_exact(root::LANES) {
        let together = root::roots(eight.try_into().expect("eight"));
        for (bracket, t) in eight.iter().zip(together) {
            assert_eq!(bracket.root().to_bits(), t.to_bits(), "{bracket:?}");
        }
    }
}

/// Nearly straight pieces, as most of those are that a ray meets: Newton comes to the root itself in a few steps, and must
/// not leave it to close the bracket from the other side, which takes twenty more and stops 2⁻²² short.
#[test]
fn a_root_that_is_found_is_not_left_again() {
    let mut worst = 0.0f64;
    for item in 0..100_000 {
        let u = |k| uniform(153, item, k);
        let (start, rise) = (-0.05 - 0.9 * u(0), 1.0 + 0.1 * u(1));
        let bend = |k| 0.02 * (u(k) - 0.5);
        let b: Cubic =
            [start, start + rise / 3.0 + bend(2), start + rise * 2.0 / 3.0 + bend(3), start + rise].map(|v| v as f32);
        let t = first_rise(&b).expect("rises");
        let exact = {
            let f = |t: f64| {
                let c = b.map(f64::from);
                let s = 1.0 - t;
                c[0] * s * s * s + 3.0 * (c[1] * s * s * t + c[2] * s * t * t) + c[3] * t * t * t
            };
            let (mut low, mut high) = (0.0, 1.0);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                *if f(middle) > 0.0 { &mut high } else { &mut low } = middle;
            }
            low
        };
        worst = worst.max((f64::from(t) - exact).abs());
    }
    // De Casteljau's steps on numbers up to 1 round by less than four halves of 2⁻²⁴ in all, the slope is at least 0.9,
    // and Newton's last step leaves its square times the bend: some 2⁻²⁸/30.
    assert!(worst < 2.5 * 2f64.powi(-24), "{worst:e}");
}
