//! Photons among walls, mirrors, glass and luminaires.

use super::super::estimate::Kind;
use super::*;
use crate::scene::geometry::{Finish, Geometry, Luminaire, LuminaireShape, Shape, Wall};
use std::f64::consts::PI;

fn wall(name: &str, shape: Shape, finish: Finish) -> Wall {
    Wall { name: name.into(), shape, finish }
}

fn lamp(name: &str, shape: LuminaireShape, power: f64) -> Luminaire {
    Luminaire { name: name.into(), shape, power: [power; 3] }
}

fn map_among(volume: &Volume, geometry: &Geometry, settings: &PhotonSettings) -> PhotonMap {
    let pyramid = Pyramid::new(volume);
    let scene = PhotonScene { volume, pyramid: &pyramid, geometry: Some(geometry), light: None };
    PhotonMap::new(&scene, settings).unwrap()
}

/// Where a photon lies, in world.
fn place(volume: &Volume, photon: &Photon) -> DVec3 {
    let bounds = volume.world_bounds();
    let [x, y, z, _] = photon.point;
    bounds.centre() + DVec3::new(f64::from(x), f64::from(y), f64::from(z)) * bounds.size().length()
}

/// Irradiance at a place of the volume of [`planes`], from one kind of photons.
fn irradiance(volume: &Volume, map: &PhotonMap, at: DVec3, kind: Kind, search: &PhotonSearch) -> f64 {
    let pyramid = Pyramid::new(volume);
    let Samples::F32(samples) = volume.samples() else { unreachable!() };
    let field = LevelField::new(volume, samples, &pyramid);
    let at = field.locate(volume.world_from_grid().inverse().point(at).to_array());
    let raw = f64::from(field.raw_value(&at));
    let normal = field.normal(&at).unwrap();
    map.irradiance(&field, &at, raw, normal, kind, search, &mut Nearest::default()).mean[0]
}

/// Only isovalues within 0.2 of the plane at a height.
fn near(height: f64) -> Isovalues {
    Isovalues { choice: IsovalueChoice::Uniform, range: Some([-height - 0.2, -height + 0.2]) }
}

/// VALIDATION 16, seen by photons: a square of power Φ over a plane. The irradiance at a point is ∫ L cos cos'/d² over the
/// square, here by the midpoint rule.
#[test]
fn a_square_lights_a_plane_as_its_form_factor_says() {
    let volume = planes(1.0, 1.0);
    let (corner, u, v) = (DVec3::new(5.0, 5.0, 14.0), 4.0 * DVec3::Y, 4.0 * DVec3::X);
    let power = 90.0;
    let geometry =
        Geometry::new(Vec::new(), vec![lamp("square", LuminaireShape::Rectangle { corner, u, v }, power)], 1.0)
            .unwrap();
    let height = 8.0;
    let settings =
        PhotonSettings { photons: 1 << 20, albedo: [0.0; 3], isovalues: near(height), ..PhotonSettings::default() };
    let map = map_among(&volume, &geometry, &settings);
    assert!(map.energy().imbalance() < 1e-6, "{:?}", map.energies());
    let radiance = power / (PI * 16.0);
    let (mut found, mut expected) = (0.0, 0.0);
    for i in 0..200 {
        let [x, y] = [0, 1].map(|a| 5.0 + 6.0 * f64::from(uniform(21, i, 0, a)));
        let at = DVec3::new(x, y, height);
        found += irradiance(&volume, &map, at, Kind::Usual, &PhotonSearch::default());
        let (n, h2) = (64, (14.0 - height).powi(2));
        for j in 0..n * n {
            let [p, q] = [j % n, j / n].map(|k| (f64::from(k) + 0.5) / f64::from(n) * 4.0 + 5.0);
            let square = (p - x).powi(2) + (q - y).powi(2) + h2;
            expected += radiance * h2 / (square * square) * 16.0 / f64::from(n * n);
        }
    }
    assert!((found / expected - 1.0).abs() < 0.01, "{}", found / expected);
}

/// A mirror shows an image of a point of light: the map of caustics is its share times the light of that point, E = Φ/4π · cos/d².
#[test]
fn a_plane_mirror_is_its_image() {
    let volume = planes(1.0, 1.0);
    let share = 0.6f32;
    // The plane x = −2 reflects (3, 8, 12) to (−7, 8, 12).
    let shape = Shape::Rectangle { corner: DVec3::new(-2.0, -80.0, -80.0), u: 160.0 * DVec3::Y, v: 160.0 * DVec3::Z };
    let mirror = wall("mirror", shape, Finish::Mirror([share; 3]));
    let bulb = lamp("bulb", LuminaireShape::Point { position: DVec3::new(3.0, 8.0, 12.0) }, 10.0);
    let geometry = Geometry::new(vec![mirror], vec![bulb], 1.0).unwrap();
    let height = 4.0;
    let settings =
        PhotonSettings { photons: 1 << 22, albedo: [0.0; 3], isovalues: near(height), ..PhotonSettings::default() };
    let map = map_among(&volume, &geometry, &settings);
    assert!(map.energy().imbalance() < 1e-6, "{:?}", map.energies());
    assert!(map.caustics() > 10_000, "{}", map.caustics());
    let (mut found, mut expected) = (0.0, 0.0);
    for i in 0..200 {
        let [x, y] = [0, 1].map(|a| 4.0 + 8.0 * f64::from(uniform(22, i, 0, a)));
        let at = DVec3::new(x, y, height);
        found += irradiance(&volume, &map, at, Kind::Caustic, &PhotonSearch::of_caustics());
        let way = DVec3::new(-7.0, 8.0, 12.0) - at;
        expected += f64::from(share) * 10.0 / (4.0 * PI) * way.z / way.length().powi(3);
    }
    assert!((found / expected - 1.0).abs() < 0.02, "{}", found / expected);
}

/// Parallel light in a ring of metal draws a nephroid, whose cusp lies R/2 from the centre towards the wall that is lit.
#[test]
fn a_ring_of_metal_has_its_cusp_at_half_its_radius() {
    let volume = planes(1.0, 1.0);
    let (middle, radius, facets) = (DVec3::new(8.0, 8.0, 7.0), 7.0, 720);
    let at = |i: usize| {
        let (sine, cosine) = libm::sincos(2.0 * PI * i as f64 / facets as f64);
        middle + radius * DVec3::new(cosine, sine, 0.0)
    };
    let ring = (0..facets).map(|i| {
        let shape = Shape::Rectangle { corner: at(i), u: at(i + 1) - at(i), v: 6.0 * DVec3::Z };
        wall(&format!("facet {i}"), shape, Finish::Mirror([1.0; 3]))
    });
    // From −x, 45° up: it lights the wall at +x, and no reflection changes its slope.
    let shape = LuminaireShape::Directional { towards: DVec3::new(-1.0, 0.0, 1.0) };
    let geometry = Geometry::new(ring.collect(), vec![lamp("sun", shape, 1.0)], 1.0).unwrap();
    let settings =
        PhotonSettings { photons: 1 << 22, albedo: [0.0; 3], isovalues: near(7.1), ..PhotonSettings::default() };
    let map = map_among(&volume, &geometry, &settings);
    assert!(map.energy().imbalance() < 1e-6, "{:?}", map.energies());
    // Along the axis, in slices of a fiftieth of the radius; heights differ by less than a thirtieth of it. At a distance y from the
    // axis the two branches of the cusp are y^(2/3) past it: 0.02 at 0.003.
    let mut slices = [0u32; 50];
    for photon in map.photons_of(Kind::Caustic) {
        let p = place(&volume, photon) - middle;
        let along = p.x / radius;
        if p.y.abs() < 0.003 * radius && (0.0..1.0).contains(&along) {
            slices[(along * 50.0) as usize] += 1;
        }
    }
    let most = (0..50).max_by_key(|&i| slices[i]).unwrap();
    let cusp = (most as f64 + 0.5) / 50.0;
    assert!((cusp - 0.5).abs() < 0.03, "{cusp}: {slices:?}");
}

/// A ball of glass focuses rays near its axis at nR/(2(n − 1)) from its centre (the lens-maker's equation of a ball). Photons land
/// on planes of all heights: their mean squared distance from the axis is least at the focus.
#[test]
fn a_ball_of_glass_has_its_focus() {
    let volume = planes(1.0, 1.0);
    let (radius, index) = (8.0, 1.5);
    let centre = DVec3::new(8.0, 8.0, 24.5);
    let ball = wall("ball", Shape::Sphere { centre, radius }, Finish::Glass(index));
    // A hole of 0.16 R leaves the rays near the axis.
    let (half, far, top) = (0.08 * radius, 400.0, 33.0);
    let blind = |i: usize, x: f64, y: f64, w: f64, h: f64| {
        let shape = Shape::Rectangle { corner: DVec3::new(x, y, top), u: w * DVec3::X, v: h * DVec3::Y };
        wall(&format!("blind {i}"), shape, Finish::Diffuse([0.0; 3]))
    };
    let walls = vec![
        ball,
        blind(0, 8.0 + half, 8.0 - far, far, 2.0 * far),
        blind(1, 8.0 - half - far, 8.0 - far, far, 2.0 * far),
        blind(2, 8.0 - half, 8.0 + half, 2.0 * half, far),
        blind(3, 8.0 - half, 8.0 - half - far, 2.0 * half, far),
    ];
    // A square close to the hole would not be parallel; a sun is.
    let sun = lamp("sun", LuminaireShape::Directional { towards: DVec3::Z }, 1.0);
    let geometry = Geometry::new(walls, vec![sun], 1.0).unwrap();
    let isovalues = Isovalues { choice: IsovalueChoice::Uniform, range: Some([-15.9, -8.0]) };
    // Most photons of a sun that crosses the blinds end there.
    let settings = PhotonSettings { photons: 1 << 27, albedo: [0.0; 3], isovalues, ..PhotonSettings::default() };
    let map = map_among(&volume, &geometry, &settings);
    // Least squares of r² = a + b z + c z².
    let (mut matrix, mut right) = (nalgebra::Matrix3::<f64>::zeros(), nalgebra::Vector3::<f64>::zeros());
    for photon in map.photons_of(Kind::Caustic) {
        let p = place(&volume, photon);
        let row = nalgebra::Vector3::new(1.0, p.z - 12.0, (p.z - 12.0).powi(2));
        let square = (p.x - 8.0).powi(2) + (p.y - 8.0).powi(2);
        matrix += row * row.transpose();
        right += square * row;
    }
    let found = matrix.lu().solve(&right).unwrap();
    let focus = 12.0 - found[1] / (2.0 * found[2]);
    let expected = index * radius / (2.0 * (index - 1.0));
    assert!(((centre.z - focus) / expected - 1.0).abs() < 0.03, "{} of {expected}", centre.z - focus);
}

/// Whatever happens between a coloured box, a level set, glass and a mirror, the power is somewhere: of each luminaire, and of an
/// environment that shines in by a missing wall.
#[test]
fn power_is_kept_of_every_source() {
    let volume = named("bumpbox:17");
    let faces = Shape::faces_of_box(DVec3::ZERO, DVec3::ONE, true);
    let room = faces.into_iter().take(5).enumerate();
    let mut walls: Vec<Wall> =
        room.map(|(i, shape)| wall(&format!("w{i}"), shape, Finish::Diffuse([0.6, 0.1, 0.1]))).collect();
    walls.push(wall("g", Shape::Sphere { centre: DVec3::new(0.2, 0.2, 0.5), radius: 0.1 }, Finish::Glass(1.5)));
    walls.push(wall("m", Shape::Sphere { centre: DVec3::new(0.8, 0.2, 0.5), radius: 0.1 }, Finish::Mirror([0.9; 3])));
    let rectangle =
        LuminaireShape::Rectangle { corner: DVec3::new(0.3, 0.0, 0.3), u: 0.4 * DVec3::Z, v: 0.4 * DVec3::X };
    let ball = LuminaireShape::Sphere { centre: DVec3::new(0.1, 0.9, 0.1), radius: 0.05 };
    let luminaires = vec![
        lamp("ceiling", rectangle, 90.0),
        lamp("ball", ball, 3.0),
        lamp("bulb", LuminaireShape::Point { position: DVec3::new(0.9, 0.1, 0.9) }, 1.0),
        lamp("sun", LuminaireShape::Directional { towards: DVec3::new(0.2, 0.1, 1.0) }, 2.0),
        lamp("w1", LuminaireShape::Wall("w1".into()), 0.5),
        lamp("off", LuminaireShape::Point { position: DVec3::new(0.9, 0.1, 0.8) }, 0.0),
    ];
    let geometry = Geometry::new(walls, luminaires, 1.0).unwrap();
    let pyramid = Pyramid::new(&volume);
    let scene = PhotonScene { volume: &volume, pyramid: &pyramid, geometry: Some(&geometry), light: Some(&SKY) };
    let settings = PhotonSettings { photons: 100_000, ..PhotonSettings::default() };
    let map = PhotonMap::new(&scene, &settings).unwrap();
    let [environment, ceiling, ball, bulb, sun, shining, off] = map.energies() else { panic!() };
    for (i, energy) in map.energies().iter().enumerate() {
        assert!(energy.imbalance() < 1e-6, "{i}: {energy:?}");
    }
    // Each sends what it has, whatever its number of photons, up to the varying weights of isovalues: Φ in squared diagonals.
    let over = |energy: &PhotonEnergy, power: f64| energy.emitted[0] / (power / 3.0);
    for (energy, power) in [(ceiling, 90.0), (ball, 3.0), (bulb, 1.0), (shining, 0.5 * PI)] {
        assert!((over(energy, power) - 1.0).abs() < 0.1 && energy.photons > 1000, "{power}: {energy:?}");
    }
    assert!(environment.escaped[0] > 0.0 && sun.escaped[0] > 0.0 && off.photons == 0);
    assert!(ceiling.absorbed[0] > 0.0 && ceiling.in_walls[0] > 0.0 && map.caustics() > 0);
    assert_eq!(map.energies().iter().map(|e| e.photons).sum::<u64>(), 100_000);
    // Twice the power is twice the flux of the same photons.
    let scales = vec![[2.0; 3], [1.0; 3], [1.0; 3], [1.0; 3], [1.0; 3], [1.0; 3]];
    let alone = |scales: Vec<[f64; 3]>| {
        let mut settings = PhotonSettings { scales, ..settings.clone() };
        settings.scales.iter_mut().skip(1).for_each(|s| *s = [0.0; 3]);
        let scene = PhotonScene { light: None, ..scene };
        PhotonMap::new(&scene, &settings).unwrap().energy().emitted[0]
    };
    let (once, twice) = (alone(vec![[1.0; 3]; 6]), alone(scales));
    assert!((twice / once - 2.0).abs() < 1e-6, "{once} {twice}");
}

/// What makes no sense is an error that says so: light that is no number, places that are none, a map of another scene.
#[test]
fn bad_input_is_refused_by_name() {
    struct Odd(f32, f32);
    impl DirectionalSource for Odd {
        fn sample(&self, u: [f32; 2]) -> Option<DirectionSample> {
            Some(DirectionSample { radiance: [self.0; 3], density: self.1, ..SKY.sample(u)? })
        }
        fn density(&self, direction: Direction) -> f32 {
            SKY.density(direction)
        }
        fn radiance(&self, direction: Direction) -> [f32; 3] {
            SKY.radiance(direction)
        }
    }
    let volume = named("bumpbox:9");
    let pyramid = Pyramid::new(&volume);
    let settings = PhotonSettings { photons: 1000, ..PhotonSettings::default() };
    for odd in [Odd(f32::NAN, 1.0), Odd(f32::INFINITY, 1.0), Odd(1.0, 0.0), Odd(1.0, -1.0), Odd(1.0, f32::NAN)] {
        let scene = PhotonScene::alone(&volume, &pyramid, &odd);
        let said = PhotonMap::new(&scene, &settings).err().unwrap().to_string();
        assert!(said.contains("light") && said.contains("finite"), "{said}");
    }
    let scene = PhotonScene::alone(&volume, &pyramid, &SKY);
    let map = PhotonMap::new(&scene, &settings).unwrap();
    let point = |x: f32| [SurfacePoint { position_in_grid: [x, 4.0, 4.0], normal: [0.0, 0.0, 1.0] }];
    let usual = PhotonLightSettings {
        light: PhotonLight::All,
        rays: 4,
        search: PhotonSearch::default(),
        caustics: PhotonSearch::of_caustics(),
        seed: 0,
    };
    let far = |most_radius| PhotonLightSettings { search: PhotonSearch { most_radius, ..usual.search }, ..usual };
    let glass = wall("g", Shape::Sphere { centre: DVec3::splat(0.2), radius: 0.1 }, Finish::Glass(1.5));
    let (walls, other) = (Geometry::new(vec![glass], Vec::new(), 1.0).unwrap(), named("gyroid:9"));
    let other_pyramid = Pyramid::new(&other);
    let among = PhotonScene { geometry: Some(&walls), ..scene };
    let elsewhere = PhotonScene::alone(&other, &other_pyramid, &SKY);
    for (scene, isovalue, x, settings, word) in [
        (&scene, f64::NAN, 4.0, usual, "isovalue"),
        (&scene, 47.0, f32::NAN, usual, "points"),
        (&scene, 47.0, f32::INFINITY, usual, "points"),
        (&scene, 47.0, 4.0, far(f32::NAN), "most_radius"),
        (&scene, 47.0, 4.0, far(-1.0), "most_radius"),
        (&among, 47.0, 4.0, usual, "another scene"),
        (&elsewhere, 0.0, 4.0, usual, "another scene"),
    ] {
        let said = photon_direct(scene, isovalue, &point(x), &map, &settings).unwrap_err().to_string();
        assert!(said.contains(word), "{word}: {said}");
    }
    assert!(photon_direct(&scene, 47.0, &point(4.0), &map, &usual).is_ok());
    assert_eq!([f64::NAN, 0.0, -1.0].map(|cells| Isovalues::near(&volume, 47.0, cells)), [None; 3]);
    let none = SpecularPhotons::new(&among, 1, Some(f64::NAN), (10, 0), 1 << 20);
    // Nothing in it needs photons.
    assert!(none.unwrap().is_none());
}
