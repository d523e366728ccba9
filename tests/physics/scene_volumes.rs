//! Several volumes that light each other, and points of light in mirrors: against one volume that holds both, against
//! closed forms, and against each alone.

use crate::common::energy_of;
use crate::common::scenes::{Square, baked, corner_factor, radiance_of_texel};
use glam::{DMat3, DVec3};
use isolume::level::Pyramid;
use isolume::relight::{Contracted, Light, Material};
use isolume::sampling::statistics::{Running, normal_two_sided, rms, sidak};
use isolume::scene::geometry::{Among, Finish, Geometry, Luminaire, LuminaireShape, Partner, Shape, Wall};
use isolume::scene::{Coupled, Coupling};
use isolume::transport::{SceneReference, scene_radiance};
use isolume::volume::field::{by_name, sample};
use isolume::volume::{Samples, Volume};
use std::f64::consts::PI;
use std::sync::Arc;

const WHITE: [f32; 3] = [1.0; 3];

/// A geometry in which `own` stands beside `others`, coupled.
pub(crate) fn among(
    own: &Volume,
    others: &[&Volume],
    coupling: &Coupling,
    tint: [f32; 3],
    around: Geometry,
) -> Geometry {
    let coupled = |volume: &&Volume| Coupled { name: volume.name.clone(), range: volume.value_range() };
    let volumes: Vec<Coupled> = [own].iter().chain(others).map(coupled).collect();
    coupling.check(&volumes).expect("a coupling");
    let partner = |(i, volume): (usize, &&Volume)| Partner {
        name: volume.name.clone(),
        volume: Arc::new((*volume).clone()),
        pyramid: Arc::new(Pyramid::new(volume)),
        isovalue: coupling.between(&volumes, 0, i + 1),
        tint: WHITE,
    };
    let partners = others.iter().enumerate().map(partner).collect();
    let name = own.name.clone();
    around.with_partners(Among { name, place: 0, coupling: coupling.describe(), tint }, partners).expect("partners")
}

pub(crate) fn nothing() -> Geometry {
    Geometry::new(Vec::new(), Vec::new(), 1.0).expect("nothing")
}

pub(crate) fn field(name: &str) -> Volume {
    by_name(name).expect("a field").expect("a field").sample().expect("a volume")
}

fn of_texel(contracted: &Contracted, texel: [usize; 3]) -> f64 {
    f64::from(radiance_of_texel(contracted, texel)[0])
}

fn square(name: &str, z: f64, sign: f64) -> Volume {
    let mut volume = sample(&Square { z, sign }, [17, 17, 5]).expect("a volume");
    volume.name = name.into();
    volume
}

/// A volume too far away to be met changes no bit; a factor of ½ on the albedo halves every number of the direct light.
#[test]
fn far_apart_each_is_alone() {
    let own = field("gyroid:13");
    let mut far = field("sphere:9").placed(DMat3::IDENTITY, DVec3::splat(1e9)).expect("far away");
    far.name = "far".into();
    let alone = baked(&own, &nothing(), &[0.0], 16, 3);
    for coupling in [Coupling::Normalised, Coupling::Equal, Coupling::Rows(vec![vec![0.0, -0.6]])] {
        let beside = baked(&own, &among(&own, &[&far], &coupling, WHITE, nothing()), &[0.0], 16, 3);
        assert!(beside.bits() == alone.bits(), "{coupling:?}");
        assert_eq!(
            (beside.summary.scene.partner_rays, beside.summary.scene.partner_hits, beside.summary.scene.buried),
            (0, 0, 0)
        );
    }
    let tinted = baked(&own, &among(&own, &[&far], &Coupling::Normalised, [0.5; 3], nothing()), &[0.0], 16, 3);
    // Two bands in three channels, then the next layers, which have the factor twice and three times.
    let mut differences: Vec<Vec<f64>> = vec![Vec::new(); 36];
    for texel in alone.texels() {
        let (Some(whole), Some(half)) = (alone.at(0, texel), tinted.at(0, texel)) else { continue };
        for (i, (a, b)) in whole.iter().zip(half).enumerate() {
            let (factor, a, b) = ([0.5, 0.25, 0.125][i / 12], *a, b);
            match i < 12 {
                // 16 bits: exact but for the smallest.
                true => assert!((b - factor * a).abs() <= 2f64.powi(-24), "{texel:?} {i}: {a} {b}"),
                // The control variate at hits weighs their light by what gets out, in which dark surfaces count less: another
                // estimate of the same number.
                false => differences[i].push(b - factor * a),
            }
        }
    }
    let p = differences.iter().filter(|list| !list.is_empty()).map(|list| {
        let n = list.len() as f64;
        let mean = list.iter().sum::<f64>() / n;
        let spread = list.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n * (n - 1.0));
        if mean == 0.0 { 1.0 } else { normal_two_sided(mean.abs() / spread.sqrt()) }
    });
    let least = p.fold(1.0, f64::min);
    assert!(least > sidak(1e-3, 24), "p = {least}");
}

/// A hollow ball, of 25³ samples.
pub(crate) const BALL: usize = 25;

/// The samples of a part of the ball along x; two of them share a plane.
pub(crate) fn part_of_ball(name: &str, from: usize, to: usize) -> Volume {
    const N: usize = BALL;
    let place = |i: usize| (i as f64 - 12.0) / 12.0;
    let value = |[x, y, z]: [usize; 3]| {
        let p = DVec3::new(place(x), place(y), place(z));
        let shell = 0.25 - (p.length() - 0.7).abs();
        (if x.abs_diff(12) <= 1 { shell.min(-0.4) } else { shell }) as f32
    };
    let dims = [to - from, N, N];
    let at = |i: usize| [from + i % dims[0], i / dims[0] % N, i / dims[0] / N];
    let samples = Samples::F32((0..dims.iter().product()).map(|i| value(at(i))).collect());
    let affine = isolume::geom::Affine::from_spacing(DVec3::splat(1.0 / 12.0), DVec3::new(place(from), -1.0, -1.0));
    let mut volume = Volume::new(dims, samples, affine.expect("an affine")).expect("a volume");
    volume.name = name.into();
    volume
}

/// A hollow ball cut in two, with air of two cells at the cut: the halves as two volumes are the one that holds both. Baked at
/// two isovalues; by symmetry the ranges are the same, so that equal isovalues and normalised ones are the same thing.
#[test]
fn two_half_bowls_are_the_volume_that_holds_both() {
    let (whole, left, right) =
        (part_of_ball("whole", 0, BALL), part_of_ball("left", 0, 13), part_of_ball("right", 12, BALL));
    let (isovalues, rays) = ([0.02, 0.1], 16);
    let reference = baked(&whole, &nothing(), &isovalues, rays, 3);
    let mut tests = Vec::new();
    for (own, other, shift) in [(&left, &right, 0), (&right, &left, 12)] {
        let alone = baked(own, &nothing(), &isovalues, rays, 3);
        for coupling in [Coupling::Normalised, Coupling::Equal] {
            let both = baked(own, &among(own, &[other], &coupling, WHITE, nothing()), &isovalues, rays, 3);
            assert!(
                both.summary.scene.partner_hits > 10_000 && both.summary.scene.buried == 0,
                "{:?}",
                both.summary.scene
            );
            let (mut differences, mut of_alone) = (vec![Running::new(); 3], Running::new());
            for texel in both.texels() {
                let Some(expected) = reference.at(0, [texel[0] + shift, texel[1], texel[2]]) else { continue };
                let Some(found) = both.at(0, texel) else { continue };
                // The constant coefficient of each layer: a_k, the chance to escape.
                (0..3).for_each(|k| differences[k].push(found[12 * k] - expected[12 * k]));
                of_alone.extend_with(alone.at(0, texel).map(|v| v[0] - expected[0]));
            }
            for (k, difference) in differences.iter().enumerate() {
                assert!(difference.count() > 800, "{}", difference.count());
                tests.push((k, difference.mean() / difference.standard_error()));
            }
            // Without the other half there is more sky: the test would see it.
            assert!(of_alone.mean() > 20.0 * of_alone.standard_error(), "{}", of_alone.mean());
        }
    }
    let level = sidak(0.001, tests.len());
    assert!(tests.iter().all(|(_, z)| normal_two_sided(*z) > level), "{tests:?}");
}

trait ExtendWith {
    fn extend_with(&mut self, value: Option<f64>);
}

impl ExtendWith for Running {
    fn extend_with(&mut self, value: Option<f64>) {
        value.into_iter().for_each(|v| self.push(v));
    }
}

/// VALIDATION 16 with two level sets as the squares: each shines with radiance 1 and sees the other under the form factor of
/// a rectangle, in the mean 0.19982 both ways. Between a lamp and the lower one the upper one leaves nothing.
#[test]
fn facing_squares_are_two_level_sets() {
    let (low, high) = (square("low", 0.0, -1.0), square("high", 1.0, 1.0));
    let lamp = |z: f64| {
        let shape = LuminaireShape::Point { position: DVec3::new(0.5, 0.5, z) };
        let lamp = Luminaire { name: "bulb".into(), shape, power: [4.0 * PI; 3] };
        Geometry::new(Vec::new(), vec![lamp], 1.0).expect("a lamp")
    };
    for (own, other, above) in [(&low, &high, 2.0), (&high, &low, -1.0)] {
        let geometry = among(own, &[other], &Coupling::Normalised, WHITE, lamp(above));
        let scene = baked(own, &geometry, &[0.0], 1024, 1);
        let glows = Material::new([1.0; 3], [1.0; 3]).expect("a material");
        let lit = scene.lit(&Light::constant([0.0; 3]), &glows, &[]);
        let on_square: Vec<[usize; 3]> = scene.texels().filter(|t| t[2] == 2).collect();
        // Four replicates make a poor error of one texel: all together make a good one of all.
        let pooled = rms(on_square.iter().map(|t| scene.error(1, *t)));
        let (mut mean, mut weights, mut squares) = (0.0, 0.0, Running::new());
        for texel in &on_square {
            let [x, y] = [texel[0], texel[1]].map(|i| i as f64 / 16.0);
            let sides = [(x, y), (1.0 - x, y), (x, 1.0 - y), (1.0 - x, 1.0 - y)];
            let expected: f64 = sides.iter().map(|&(a, b)| corner_factor(a, b)).sum();
            // What is sent out, less what is its own; no light of the lamp.
            let found = of_texel(&lit, *texel) - 1.0;
            // 16 bits round by 2⁻¹¹.
            assert!(
                (found - expected).abs() < 6.0 * pooled + 5e-4 * expected,
                "{texel:?}: {found} {expected} {pooled}"
            );
            squares.push(((found - expected) / pooled).powi(2));
            let end = |i: usize| if i == 0 || i == 16 { 0.5 } else { 1.0 };
            mean += end(texel[0]) * end(texel[1]) * found;
            weights += end(texel[0]) * end(texel[1]);
            assert!(scene.at(2, *texel).expect("a texel").iter().all(|v| *v == 0.0), "{texel:?} sees the lamp");
        }
        assert!(squares.count() == 289 && (0.7..1.4).contains(&squares.mean()), "{}", squares.mean());
        // As in `scene_walls`: 3e-4 for the trapezoid rule; and the errors of 17² texels.
        assert!((mean / weights - 0.19982).abs() < 3e-4 + 4.0 * pooled / 17.0, "{}", mean / weights);
        // Alone the lamp is seen, by cosine over π and the square of the distance: Φ = 4π is an intensity of 1.
        let alone = baked(own, &lamp(above), &[0.0], 4, 1);
        let lit = alone.lit(&Light::constant([0.0; 3]), &Material::new([1.0; 3], [0.0; 3]).expect("white"), &[]);
        for texel in on_square {
            let [x, y] = [texel[0], texel[1]].map(|i| i as f64 / 16.0 - 0.5);
            let square = x * x + y * y + 4.0;
            let (expected, found) = (2.0 / (PI * square * square.sqrt()), of_texel(&lit, texel));
            assert!((found - expected).abs() < 1e-3 * expected, "{texel:?}: {found} {expected}");
        }
    }
}

/// A lamp in the middle between two black squares, which are faces of a cube around it: a third of its power ends on them.
/// A ray that meets the other volume sees it glow.
#[test]
fn photons_and_rays_meet_the_other_volume() {
    let (low, high) = (square("low", 0.0, -1.0), square("high", 1.0, 1.0));
    let shape = LuminaireShape::Point { position: DVec3::splat(0.5) };
    let lamp = Luminaire { name: "bulb".into(), shape, power: [1.0; 3] };
    let around = Geometry::new(Vec::new(), vec![lamp], 1.0).expect("a lamp");
    let geometry = among(&low, &[&high], &Coupling::Normalised, WHITE, around);
    let pyramid = Pyramid::new(&low);
    let photons = 1 << 14;
    let energy = energy_of(&low, &geometry, 0.0, [0.0; 3], photons);
    let error = (1.0 / 3.0 * 2.0 / 3.0 / f64::from(photons)).sqrt();
    assert!((energy.absorbed[0] / energy.emitted[0] - 1.0 / 3.0).abs() < 4.0 * error, "{energy:?}");
    assert!(energy.imbalance() < 1e-6, "{energy:?}");
    let settings = SceneReference {
        paths: 4,
        albedo: [0.0; 3],
        emission: [1.0, 2.0, 3.0],
        scales: Vec::new(),
        samples_luminaires: true,
        sees_through_backs: false,
        seed: 0,
    };
    let rays = [DVec3::Z, -DVec3::Z, DVec3::X].map(|direction| (DVec3::new(0.4, 0.6, 0.5), direction));
    let (seen, _) = scene_radiance(&low, &pyramid, &geometry, 0.0, &rays, None, &settings).expect("rays");
    let seen: Vec<Option<[f64; 3]>> = seen.into_iter().map(|s| s.map(|s| s.mean)).collect();
    assert_eq!(seen, [Some([1.0, 2.0, 3.0]), Some([1.0, 2.0, 3.0]), None]);
}

/// Two squares back to back: no ray of one comes to the other, and nothing of it is tried.
#[test]
fn what_cannot_be_seen_costs_nothing() {
    let (up, down) = (square("up", 0.0, -1.0), square("down", -1.0, 1.0));
    let geometry = among(&up, &[&down], &Coupling::Normalised, WHITE, nothing());
    let beside = baked(&up, &geometry, &[0.0], 64, 2);
    assert_eq!((beside.summary.scene.partner_rays, beside.summary.scene.partner_hits), (0, 0));
    assert!(beside.summary.scene.path_rays > 0 && beside.bits() == baked(&up, &nothing(), &[0.0], 64, 2).bits());
}

/// A small sphere in the solid of a large one has no surface; a large one around it does not notice.
#[test]
fn what_is_buried_has_no_surface() {
    let mut small = field("sphere:9").placed(0.2 * DMat3::IDENTITY, DVec3::ZERO).expect("small");
    let mut large = field("sphere:9");
    (small.name, large.name) = ("small".into(), "large".into());
    // -0.6 is a radius of 0.6; both isovalues at once.
    let inside = baked(&small, &among(&small, &[&large], &Coupling::Normalised, WHITE, nothing()), &[-0.6], 4, 1);
    let selected = inside.texels().count() as u64;
    assert!(selected > 100 && inside.summary.scene.buried == selected, "{:?} of {selected}", inside.summary.scene);
    assert!(inside.texels().all(|t| inside.at(0, t).is_none()));
    let around = baked(&large, &among(&large, &[&small], &Coupling::Normalised, WHITE, nothing()), &[-0.6], 4, 1);
    assert!(around.summary.scene.buried == 0 && around.bits() == baked(&large, &nothing(), &[-0.6], 4, 1).bits());
}

/// A point of light beside a mirror is two of them, one of which is as strong as the mirror; through two mirrors, three and
/// more. Parallel light likewise. Glass is refused by name.
#[test]
fn points_of_light_are_found_in_flat_mirrors() {
    let volume = square("floor", 0.0, -1.0);
    // Mirrors at x = 2 and x = −1, large enough for all that is asked.
    let mirror = |name: &str, x: f64, share: f32| Wall {
        name: name.into(),
        shape: Shape::Rectangle {
            corner: DVec3::new(x, -20.0, 0.05),
            u: DVec3::new(0.0, 40.0, 0.0),
            v: DVec3::new(0.0, 0.0, 40.0),
        },
        finish: Finish::Mirror([share; 3]),
    };
    let position = DVec3::new(1.2, 0.4, 1.5);
    let point = Luminaire { name: "bulb".into(), shape: LuminaireShape::Point { position }, power: [4.0 * PI; 3] };
    let towards = DVec3::new(-2.0, 0.0, 1.0);
    let sun = Luminaire { name: "sun".into(), shape: LuminaireShape::Directional { towards }, power: [1.0; 3] };
    let white = Material::new([1.0; 3], [0.0; 3]).expect("white");
    let lit = |walls: Vec<Wall>, lamp: &Luminaire| {
        let geometry = Geometry::new(walls, vec![lamp.clone()], 1.0).expect("mirrors");
        let scene = baked(&volume, &geometry, &[0.0], 4, 1);
        let contracted = scene.lit(&Light::constant([0.0; 3]), &white, &[]);
        let on_square: Vec<[usize; 3]> = scene.texels().filter(|t| t[2] == 2).collect();
        let found: Vec<(DVec3, f64)> = on_square
            .iter()
            .map(|t| (DVec3::new(t[0] as f64 / 16.0, t[1] as f64 / 16.0, 0.0), of_texel(&contracted, *t)))
            .collect();
        (found, scene.summary.scene)
    };
    let from = |lamp: DVec3, at: DVec3| {
        let way = lamp - at;
        way.z / (PI * way.length().powi(3))
    };
    let image = |lamp: DVec3, x: f64| DVec3::new(2.0 * x - lamp.x, lamp.y, lamp.z);
    // The feet of the mirrors are low enough that every texel sees all images.
    let (found, counts) = lit(vec![mirror("right", 2.0, 0.5)], &point);
    assert!(counts.specular_hits >= 4 * 289);
    for (at, value) in found {
        let expected = from(position, at) + 0.5 * from(image(position, 2.0), at);
        assert!((value - expected).abs() < 1e-3 * expected, "{at}: {value} {expected}");
    }
    let (right, left) = (image(position, 2.0), image(position, -1.0));
    let (found, _) = lit(vec![mirror("right", 2.0, 0.5), mirror("left", -1.0, 0.8)], &point);
    for (at, value) in found {
        let two = 0.4 * (from(image(right, -1.0), at) + from(image(left, 2.0), at));
        let three = 0.2 * from(image(image(right, -1.0), 2.0), at) + 0.32 * from(image(image(left, 2.0), -1.0), at);
        let expected = from(position, at) + 0.5 * from(right, at) + 0.8 * from(left, at) + two + three;
        assert!((value - expected).abs() < 1e-3 * expected, "{at}: {value} {expected}");
    }
    // Light that goes to +x and down: straight, and back from the mirror at x = 2.
    let (found, _) = lit(vec![mirror("right", 2.0, 0.5)], &sun);
    let cosine = 1.0 / 5f64.sqrt();
    for (at, value) in found {
        let expected = 1.5 * cosine / PI;
        assert!((value - expected).abs() < 1e-3 * expected, "{at}: {value} {expected}");
    }
    let ball = Wall {
        name: "ball".into(),
        shape: Shape::Sphere { centre: DVec3::new(0.5, 0.5, 0.6), radius: 0.2 },
        finish: Finish::Glass(1.5),
    };
    let geometry = Geometry::new(vec![ball, mirror("right", 2.0, 0.5)], vec![point, sun], 1.0).expect("glass");
    assert_eq!(isolume::transport::needs_photons(&geometry), ["bulb", "sun"]);
}
