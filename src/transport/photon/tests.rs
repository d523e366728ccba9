//! Closed forms for photons.

use super::packing::Photon;
use super::tree::{Nearest, Tree, squared_distance};
use super::*;
use crate::geom::{Affine, Direction, Normal};
use crate::level::{LevelField, Pyramid};
use crate::sampling::hash::{hash, uniform};
use crate::sampling::{DirectionSample, DirectionalSource, warp};
use crate::volume::{Samples, Volume, field};
use glam::{DVec3, Vec3};

/// Radiance of one value from everywhere, or from a cone about +z alone.
struct Sky {
    radiance: [f32; 3],
}

impl DirectionalSource for Sky {
    fn sample(&self, u: [f32; 2]) -> Option<DirectionSample> {
        let direction = Direction::from_unit(warp::square_to_uniform_sphere(u));
        Some(DirectionSample { direction, radiance: self.radiance, density: warp::uniform_sphere_pdf() })
    }

    fn density(&self, _: Direction) -> f32 {
        warp::uniform_sphere_pdf()
    }

    fn radiance(&self, _: Direction) -> [f32; 3] {
        self.radiance
    }
}

const SKY: Sky = Sky { radiance: [1.0, 0.5, 0.25] };

fn photon_at(point: [f32; 4]) -> Photon {
    Photon::new(point, [1.0; 3], 1.0, Vec3::Z, Vec3::Z, 0)
}

/// Sets of points that make trees err: in a box, on a lattice (many ties in every coordinate), all the same but for a
/// few, on a plane, and in clusters of duplicates.
fn point_sets() -> Vec<(&'static str, Vec<[f32; 4]>)> {
    let random = |seed: u64, n: usize| -> Vec<[f32; 4]> {
        (0..n as u64).map(|i| std::array::from_fn(|a| uniform(seed, i, 0, a as u32))).collect()
    };
    let lattice = random(2, 3000).into_iter().map(|p| p.map(|v| (v * 6.0).floor() / 6.0)).collect();
    let mut same = vec![[0.25, 0.5, 0.75, 0.125]; 1000];
    same.extend(random(3, 20));
    let plane = random(4, 2000).into_iter().map(|[x, y, _, c]| [x, y, 0.5, c]).collect();
    let duplicates = (0..2000u64).map(|i| random(5, 50)[i as usize % 50]).collect();
    vec![
        ("random", random(1, 5000)),
        ("lattice", lattice),
        ("same", same),
        ("plane", plane),
        ("duplicates", duplicates),
        ("few", random(6, 3)),
        ("none", vec![]),
    ]
}

#[test]
fn nearest_photons_are_those_of_brute_force() {
    let mut nearest = Nearest::default();
    let mut queries = 0u64;
    for (name, points) in point_sets() {
        let tree = Tree::new(points.iter().map(|&p| photon_at(p)).collect());
        for q in 0..1500u64 {
            // Beside points, on points, and on the planes that split them.
            let mut at: [f32; 4] = std::array::from_fn(|a| uniform(7, q, 1, a as u32) * 1.2 - 0.1);
            if q % 3 != 0 && !points.is_empty() {
                let on = points[hash(8, q, 0, 0) as usize % points.len()];
                at = std::array::from_fn(|a| if q % 3 == 1 || a % 2 == 0 { on[a] } else { at[a] });
            }
            let count = [1, 2, 7, 40, 200][q as usize % 5];
            let most = [f32::INFINITY, 0.05][q as usize % 2];
            tree.nearest(at, count, most, &mut nearest);
            let mut found: Vec<(f32, usize)> = nearest.iter().collect();
            found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let all = tree.photons().iter().enumerate().map(|(i, p)| (squared_distance(&p.point, &at), i));
            let mut expected: Vec<(f32, usize)> = all.filter(|(d, _)| *d <= most).collect();
            expected.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            expected.truncate(count);
            assert_eq!(found, expected, "{name}, query {q} at {at:?}");
            queries += 1;
        }
    }
    assert!(queries > 10_000);
}

#[test]
fn the_tree_keeps_all_photons() {
    for (name, points) in point_sets() {
        let tree = Tree::new(points.iter().map(|&p| photon_at(p)).collect());
        let sorted = |mut all: Vec<[f32; 4]>| {
            all.sort_by_key(|p| p.map(f32::to_bits));
            all
        };
        assert_eq!(sorted(tree.photons().iter().map(|p| p.point).collect()), sorted(points), "{name}");
    }
}

/// h = −slope·z over a box of `scale`, raw samples times `height`: all level sets are planes, lit from above.
fn planes(scale: f64, height: f32) -> Volume {
    let n = 17;
    let samples = (0..n * n * n).map(|i| -height * (i / (n * n)) as f32).collect();
    Volume::new([n; 3], Samples::F32(samples), Affine::from_spacing(DVec3::splat(scale), DVec3::ZERO).unwrap()).unwrap()
}

/// Mean irradiance over places in the middle of the box, where nothing of the sides is within reach.
fn mean_irradiance(volume: &Volume, map: &PhotonMap, search: &PhotonSearch) -> [f64; 3] {
    let pyramid = Pyramid::new(volume);
    let Samples::F32(samples) = volume.samples() else { unreachable!() };
    let field = LevelField::new(volume, samples, &pyramid);
    let mut nearest = Nearest::default();
    let places = 400;
    let mut sum = [0.0; 3];
    for i in 0..places {
        let at = std::array::from_fn(|a| 6.0 + 4.0 * f64::from(uniform(11, i, 0, a as u32)));
        let at = field.locate(at);
        let raw = f64::from(field.raw_value(&at));
        let normal = field.normal(&at).unwrap();
        let found = map.irradiance(&field, &at, raw, normal, search, &mut nearest);
        for c in 0..3 {
            sum[c] += found.mean[c] / places as f64;
        }
    }
    sum
}

fn map_of(volume: &Volume, light: &dyn DirectionalSource, settings: &PhotonSettings) -> PhotonMap {
    PhotonMap::new(volume, &Pyramid::new(volume), light, settings).unwrap()
}

/// A box with walls around the planes takes light away from the lower ones; a light from straight above does not.
struct Above;

impl DirectionalSource for Above {
    fn sample(&self, u: [f32; 2]) -> Option<DirectionSample> {
        let local = warp::square_to_uniform_cone(u, warp::cap_height(0.01));
        Some(DirectionSample {
            direction: Direction::from_unit(local),
            radiance: [1.0, 0.5, 0.25],
            density: warp::uniform_cone_pdf(local, warp::cap_height(0.01)),
        })
    }

    fn density(&self, direction: Direction) -> f32 {
        warp::uniform_cone_pdf(direction.vec(), warp::cap_height(0.01))
    }

    fn radiance(&self, direction: Direction) -> [f32; 3] {
        if self.density(direction) > 0.0 { [1.0, 0.5, 0.25] } else { [0.0; 3] }
    }
}

#[test]
fn planes_are_lit_as_they_are_for_any_tilt_of_the_search() {
    // The field is linear with gradient g = √3 ranges per diagonal (a cube whose samples run once over the range along
    // z), so κg = γ √3. Under a lamp of solid angle w straight above, E = L w to 1e-4 on every level set.
    let volume = planes(1.0, 3.0);
    let w = 2.0 * std::f64::consts::PI * (1.0 - libm::cos(0.01));
    for tilt in [0.05, 0.1, 0.3, 1.0, 3.0, 20.0] {
        let gamma = (tilt / 3f64.sqrt()) as f32;
        let settings = PhotonSettings { photons: 1 << 19, albedo: [0.0; 3], gamma, ..PhotonSettings::default() };
        let map = map_of(&volume, &Above, &settings);
        let search = PhotonSearch { neighbours: 256, ..PhotonSearch::default() };
        let found = mean_irradiance(&volume, &map, &search);
        // 400 places of 255 photons each that share some: the noise of the mean is below 1/√(400·255/10) = 1 %/1.
        for (found, radiance) in found.iter().zip([1.0, 0.5, 0.25]) {
            assert!((found / (radiance * w) - 1.0).abs() < 0.01, "κg = {tilt}: {}", found / (radiance * w));
        }
        let published = PhotonSearch { density: Density::Published, ..search };
        let dark = mean_irradiance(&volume, &map, &published)[0] / found[0];
        assert!((dark - tilt / (1.0 + tilt * tilt).sqrt()).abs() < 0.01, "κg = {tilt}: published reads {dark}");
    }
}

#[test]
fn a_wide_sky_lights_planes_by_pi() {
    // E = πL on the highest planes, which the sides of the box do not take light from: the level set through the top of
    // the box. Places near it lose the photons that entered below by the sides; those within 0.3 of 16 cells lose 1 %.
    let volume = planes(1.0, 1.0);
    let settings = PhotonSettings {
        photons: 1 << 20,
        albedo: [0.0; 3],
        gamma: 1.0,
        isovalues: Isovalues { range: Some([-0.3, 0.0]), choice: IsovalueChoice::Extents },
        ..PhotonSettings::default()
    };
    let map = map_of(&volume, &SKY, &settings);
    let pyramid = Pyramid::new(&volume);
    let Samples::F32(samples) = volume.samples() else { unreachable!() };
    let field = LevelField::new(&volume, samples, &pyramid);
    let mut nearest = Nearest::default();
    let search = PhotonSearch::default();
    let mut sum = 0.0;
    for i in 0..400 {
        let [x, y] = [0, 1].map(|a| 4.0 + 8.0 * f64::from(uniform(12, i, 0, a)));
        let at = field.locate([x, y, 0.1]);
        let raw = f64::from(field.raw_value(&at));
        sum += map.irradiance(&field, &at, raw, field.normal(&at).unwrap(), &search, &mut nearest).mean[0] / 400.0;
    }
    assert!((sum / std::f64::consts::PI - 1.0).abs() < 0.01, "{sum}");
}
