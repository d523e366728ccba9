//! Where the level set of a texel starts: 3³ volumes made by hand.

use super::*;

/// A 3³ volume of h(x, y, z), coordinates 0, 1, 2.
fn three(h: impl Fn(f32, f32, f32) -> f32) -> Volume {
    floating([3; 3], |p| h(p.x + 1.0, p.y + 1.0, p.z + 1.0))
}

fn site_of(volume: &Volume, at: [f64; 3]) -> Option<Site> {
    with_field!(*volume, field => field.site(at))
}

#[test]
fn a_ramp_keeps_its_value_inside_and_is_clamped_at_its_ends() {
    let ramp = three(|x, _, _| x);
    let centre = site_of(&ramp, [1.0; 3]).unwrap();
    assert_eq!((centre.isovalue, centre.clamped, centre.start.on_surface), (1.0, false, true));
    assert_eq!(centre.normal.vec(), Vec3::NEG_X);
    // At an end the neighbourhood is what there is of it: 0 … 1, inner part 0.2 … 0.8.
    let low = site_of(&ramp, [0.0, 1.0, 1.0]).unwrap();
    assert!((low.isovalue - 0.2).abs() < 1e-6 && low.clamped && !low.start.on_surface, "{low:?}");
    let high = site_of(&ramp, [2.0, 1.0, 1.0]).unwrap();
    // On the lit side the start stays at the texel.
    assert_eq!(low.start.at.in_grid(), Vec3::new(0.0, 1.0, 1.0));
    // In the solid it moves out along the normal, to the surface.
    assert!((high.isovalue - 1.8).abs() < 1e-6 && high.clamped && high.start.on_surface, "{high:?}");
    assert!((high.start.at.in_grid() - Vec3::new(1.8, 1.0, 1.0)).length() < 1e-6, "{high:?}");
}

#[test]
fn spikes_and_pits_on_a_slope_move_into_the_inner_range() {
    let peak = |height: f32| three(move |x, y, z| if (x, y, z) == (1.0, 1.0, 1.0) { height } else { 10.0 * x });
    // Range 0 … 100: the inner 60 % is 20 … 80.
    let spike = site_of(&peak(100.0), [1.0; 3]).unwrap();
    assert!((spike.isovalue - 80.0).abs() < 1e-4 && spike.clamped);
    // Range −80 … 20: the inner part is −60 … 0.
    let pit = site_of(&peak(-80.0), [1.0; 3]).unwrap();
    assert!((pit.isovalue + 60.0).abs() < 1e-4 && pit.clamped);
    // Just inside and just outside 20 % of 0 … 20.
    assert!(!site_of(&peak(4.01), [1.0; 3]).unwrap().clamped);
    assert!(site_of(&peak(3.99), [1.0; 3]).unwrap().clamped);
}

#[test]
fn flat_neighbourhoods_have_no_site() {
    assert!(site_of(&three(|_, _, _| 7.0), [1.0; 3]).is_none());
    // The gradient of an even function vanishes at its middle.
    assert!(site_of(&three(|x, y, z| (x - 1.0).powi(2) + (y - 1.0).powi(2) - (z - 1.0).powi(2)), [1.0; 3]).is_none());
    // (x−1)² + g·(x−1): gradient g, range 1 + g; the limit is 1e-4 of the range.
    let tilted = |g: f32| three(move |x, _, _| (x - 1.0).powi(2) + g * (x - 1.0));
    assert!(site_of(&tilted(0.95e-4), [1.0; 3]).is_none());
    assert!(site_of(&tilted(1.05e-4), [1.0; 3]).is_some());
}

#[test]
fn only_the_neighbourhood_counts_never_the_volume() {
    // A slope of 1e-3 beside a peak of 1e6, five samples away.
    let volume = floating([9, 3, 3], |p| if p.x > 0.9 { 1e6 } else { 1e-3 * 4.0 * (p.x + 1.0) });
    let site = site_of(&volume, [1.0, 1.0, 1.0]).unwrap();
    assert!(!site.clamped && (site.isovalue - 1e-3).abs() < 1e-9, "{site:?}");
    // The one beside the peak sees it.
    assert!(site_of(&volume, [7.0, 1.0, 1.0]).unwrap().clamped);
}

#[test]
fn between_samples_the_nearest_sample_says_the_neighbourhood() {
    // 0 … 3 constant, then a step.
    let volume = floating([7, 3, 3], |p| if p.x > 0.1 { 1.0 } else { 0.0 });
    assert!(site_of(&volume, [2.5, 1.0, 1.0]).is_none(), "nearest sample 2: constant to 3");
    let site = site_of(&volume, [2.6, 1.0, 1.0]).unwrap();
    assert!((site.isovalue - 0.2).abs() < 1e-6 && site.clamped, "{site:?}");
}

#[test]
fn the_solid_side_turns_the_normal_and_nothing_else() {
    let above = three(|x, y, z| x + 0.3 * y * z);
    let mut below = above.clone();
    below.solid = Solid::Below;
    let (a, b) = (site_of(&above, [1.0; 3]).unwrap(), site_of(&below, [1.0; 3]).unwrap());
    assert_eq!(a.normal.vec(), -b.normal.vec());
    assert_eq!((a.isovalue, a.clamped, a.start), (b.isovalue, b.clamped, b.start));
}

#[test]
fn the_rules_do_not_depend_on_the_scale_of_the_field_until_numbers_run_out() {
    for exponent in [-120, -60, 0, 60, 120] {
        let volume = three(|x, y, z| (x - 0.2 * y + 0.01 * z) * 2f32.powi(exponent));
        let site = site_of(&volume, [1.0; 3]).unwrap();
        assert!(!site.clamped && (site.normal.vec() - Vec3::new(-1.0, 0.2, -0.01).normalize()).length() < 1e-5);
    }
    // The largest and the smallest numbers that a volume takes: an answer or none, but no panic.
    for (low, high) in [(-5e36, 5e36), (0.0, 1e-45), (-1e-45, 1e-40), (5.3e36, 5.2e36), (-5.3e36, -5.3e36)] {
        for pick in 0..8u32 {
            let volume =
                three(
                    |x, y, z| {
                        if (x as u32 + 2 * y as u32 + 3 * z as u32 + pick).is_multiple_of(3) { high } else { low }
                    },
                );
            with_field!(volume, field => {
                for item in 0..20 {
                    let (start, c) = any_start(&field, 70, item);
                    if let Some(site) = field.site(start.at.in_grid().as_dvec3().to_array()) {
                        assert!(site.isovalue.is_finite() && site.normal.vec().is_finite(), "{low} {high}: {site:?}");
                    }
                    let _ = field.trace(c, &start, on_sphere(70, item), &mut Counts::default());
                }
            });
        }
    }
}
