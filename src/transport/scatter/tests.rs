use super::*;
use crate::sampling::hash::uniform;
use crate::sampling::statistics::log_log_slope;

fn points(seed: u64, count: u64) -> Vec<DVec3> {
    let at = |i: u64, a: u32| f64::from(uniform(seed, i, 0, a));
    (0..count).map(|i| DVec3::new(at(i, 0), at(i, 1), at(i, 2))).collect()
}

/// As the definition says, all samples for all texels.
fn by_definition(
    samples: &[DVec3],
    radiance: &[[f64; 3]],
    texel: DVec3,
    radius: f64,
    weight: Shepard,
) -> Option<[f64; 3]> {
    let (mut sum, mut weights) = ([0.0; 3], 0.0);
    for (s, l) in samples.iter().zip(radiance) {
        let d = (*s - texel).length();
        if d >= radius {
            continue;
        }
        let w = match weight {
            Shepard::InverseFifth => d.powi(-5),
            Shepard::Tent => 1.0 - d / radius,
        };
        (0..3).for_each(|c| sum[c] += w * l[c]);
        weights += w;
    }
    (weights > 0.0).then(|| sum.map(|v| v / weights))
}

#[test]
fn texels_are_the_weighted_means_of_the_definition() {
    let (samples, texels) = (points(1, 3000), points(2, 400));
    let radiance: Vec<[f64; 3]> = samples.iter().map(|p| [p.x, p.y * p.y, 1.0 + p.z]).collect();
    let radius = 0.07;
    let scatter = Scatter::new(&samples, radius);
    for weight in Shepard::ALL {
        let filled = scatter.fill(&texels, &radiance, weight);
        let mut empty = 0;
        for (texel, found) in texels.iter().zip(&filled.radiance) {
            match by_definition(&samples, &radiance, *texel, radius, weight) {
                // Distances of single precision: 6e-8 of 1, over a typical one of 0.03, five times over for the fifth power.
                Some(expected) => {
                    for c in 0..3 {
                        let error = (found[c] - expected[c]).abs();
                        assert!(error < 1e-4 * expected[c].max(0.01), "{weight:?}, {texel}: {found:?}, {expected:?}");
                    }
                }
                None => {
                    empty += 1;
                    let distance = |i: &usize| (samples[*i] - *texel).length();
                    let nearest = (0..samples.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
                    assert_eq!(*found, radiance[nearest], "{weight:?}, {texel}");
                }
            }
        }
        assert_eq!(filled.empty, empty, "{weight:?}");
        assert!(empty > 0, "some texels in the corners hear of none");
    }
}

#[test]
fn a_constant_is_reproduced_exactly() {
    let (samples, texels) = (points(3, 500), points(4, 300));
    // A power of two times any weight and the sum of those round alike.
    let radiance = vec![[0.5, 2.0, 0.0]; samples.len()];
    for weight in Shepard::ALL {
        for radius in [0.01, 0.2, 3.0] {
            let filled = Scatter::new(&samples, radius).fill(&texels, &radiance, weight);
            assert!(filled.radiance.iter().all(|v| *v == [0.5, 2.0, 0.0]), "{weight:?}, {radius}");
        }
    }
}

#[test]
fn the_inverse_power_interpolates_and_the_tent_does_not() {
    let samples = points(5, 200);
    let radiance: Vec<[f64; 3]> = samples.iter().map(|p| [p.x, 0.0, 0.0]).collect();
    let scatter = Scatter::new(&samples, 0.5);
    // On a sample: its own radiance, to the bit.
    assert_eq!(scatter.fill(&samples, &radiance, Shepard::InverseFifth).radiance, radiance);
    assert_ne!(scatter.fill(&samples, &radiance, Shepard::Tent).radiance, radiance);
    // Beside it, at a distance d: the others count (d/r)⁵ as much, so the error falls as the fifth power, times their number.
    let ladder: Vec<(f64, f64)> = [0.02, 0.01, 0.005]
        .iter()
        .map(|&d| {
            // Along an axis in which nothing is closer than ten times as far.
            let alone = [DVec3::ZERO, DVec3::new(0.3, 0.0, 0.0)];
            let found = Scatter::new(&alone, 0.5).fill(
                &[DVec3::new(-d, 0.0, 0.0)],
                &[[0.0; 3], [1.0; 3]],
                Shepard::InverseFifth,
            );
            (d, found.radiance[0][0])
        })
        .collect();
    let slope = log_log_slope(&ladder);
    // The far weight changes as (0.3 + d)^-5 does: by 5·0.02/0.3 at most.
    assert!((slope - 5.0).abs() < 0.25, "{slope} of {ladder:?}");
}

#[test]
fn the_tent_ends_at_the_radius() {
    let samples = [DVec3::ZERO];
    let texels: Vec<DVec3> = [0.0, 0.5, 0.99, 1.01, 4.0].iter().map(|&x| DVec3::new(x, 0.0, 0.0)).collect();
    for weight in Shepard::ALL {
        let scatter = Scatter::new(&samples, 1.0);
        let filled = scatter.fill(&texels, &[[3.0; 3]], weight);
        assert_eq!(filled.empty, 2, "{weight:?}");
        assert!(filled.radiance.iter().all(|v| *v == [3.0; 3]));
        assert_eq!(scatter.needed(&texels[3..]), [true]);
    }
    assert_eq!((Shepard::Tent.weight(0.25), Shepard::Tent.weight(1.0)), (0.5, 0.0));
    assert_eq!((Shepard::InverseFifth.weight(0.25), Shepard::InverseFifth.weight(1.0)), (32.0, 0.0));
}

#[test]
fn samples_that_no_texel_hears_of_change_nothing() {
    let (samples, texels) = (points(6, 2000), points(7, 20));
    let scatter = Scatter::new(&samples, 0.05);
    let needed = scatter.needed(&texels);
    let of = |unheard: f64| -> Vec<[f64; 3]> {
        samples.iter().zip(&needed).map(|(p, n)| if *n { [p.x, p.y, p.z] } else { [unheard; 3] }).collect()
    };
    assert!(needed.iter().any(|n| !n));
    for weight in Shepard::ALL {
        assert_eq!(scatter.fill(&texels, &of(0.0), weight), scatter.fill(&texels, &of(9.0), weight));
    }
    // Without any sample texels are dark and empty.
    let none = Scatter::new(&[], 1.0).fill(&texels, &[], Shepard::Tent);
    assert_eq!((none.empty, none.radiance[0]), (20, [0.0; 3]));
}
