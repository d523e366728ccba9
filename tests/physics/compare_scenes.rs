//! Comparisons in scenes: a furnace whose answer is known, and the reference against its slow twin.

use crate::common::scenes::baked;
use glam::DVec3;
use isolume::compare::{BandLimited, LitSurface, Question, compare};
use isolume::geom::Direction;
use isolume::level::Pyramid;
use isolume::probe::{self, Orientation};
use isolume::sampling::statistics::{normal_two_sided, sidak};
use isolume::sampling::{DirectionSample, DirectionalSource};
use isolume::scene::geometry::{Finish, Geometry, Luminaire, LuminaireShape, Shape, Wall};
use isolume::sh::Coefficients;
use isolume::surface::extract;
use isolume::transfer::{BrickSource, Layers};
use isolume::transport::{SceneReference, Settings, SurfacePoint, direct};
use isolume::volume::Volume;
use isolume::volume::field::by_name;

/// A room without ceiling, whose walls shine with `shine` and reflect `albedo`.
fn open_room(albedo: f32, shine: f64) -> Geometry {
    let faces = Shape::faces_of_box(DVec3::splat(-1.3), DVec3::splat(1.3), true);
    let name = |i: usize| format!("w{i}");
    // The last one is that of +z.
    let wall = |(i, shape)| Wall { name: name(i), shape, finish: Finish::Diffuse([albedo; 3]) };
    let walls: Vec<Wall> = faces.into_iter().take(5).enumerate().map(wall).collect();
    let lamp = |i: usize| Luminaire { name: format!("l{i}"), shape: LuminaireShape::Wall(name(i)), power: [shine; 3] };
    let lamps = if shine > 0.0 { (0..5).map(lamp).collect() } else { Vec::new() };
    Geometry::new(walls, lamps, 1.0).expect("a room")
}

/// Every `step`-th vertex of an isosurface.
fn points(volume: &Volume, isovalue: f64, step: usize) -> Vec<SurfacePoint> {
    let mesh = extract(volume, isovalue).expect("a mesh");
    let all = mesh.positions_in_grid.iter().zip(&mesh.normals);
    all.step_by(step).map(|(p, n)| SurfacePoint { position_in_grid: *p, normal: *n }).collect()
}

fn torus() -> (Volume, f64) {
    let named = by_name("torus:17").expect("a field").expect("a field");
    let isovalue = named.field.default_isovalue();
    (named.sample().expect("a volume"), isovalue)
}

/// White sky of radiance 1 over walls that shine with 1 − a and reflect a, around a level set that does the same with
/// another albedo: 1 everywhere. Paths end on what they meet or by roulette, so that the reference has noise; its mean
/// is 1. The store has four layers and a tail: what the layers beyond bring is at most ρ^(K+1) of 1.
#[test]
fn a_furnace_is_uniform_and_the_rows_sum() {
    let (volume, isovalue) = torus();
    let (geometry, pyramid) = (open_room(0.4, 0.6), Pyramid::new(&volume));
    let scene = baked(&volume, &geometry, &[isovalue], 64, 4);
    let textures: Vec<&dyn BrickSource> = scene.textures.iter().map(|t| t as &dyn BrickSource).collect();
    let sky = probe::by_name("constant").expect("a sky").expect("a sky");
    let coefficients = sky.coefficients(2);
    // All of a white sky is in its first band. As an image it would be sampled too, with other noise.
    let source = BandLimited(&coefficients);
    let points = points(&volume, isovalue, 2);
    let surface = LitSurface {
        volume: &volume,
        pyramid: &pyramid,
        geometry: Some(&geometry),
        caustics: true,
        specular: None,
        isovalue,
        points: &points,
        light: &source,
        coefficients: &coefficients,
        albedo: [0.5; 3],
        emission: [0.5; 3],
        scales: &[],
        vertices: None,
    };
    // As `baked` does it.
    let settings = Settings {
        layers: Layers::uniform(4, 2).expect("layers").coloured(),
        rays: 64,
        seed: 5,
        target: None,
        positive: false,
    };
    let baked_by = Some(&settings);
    let question =
        Question { surface, textures: &textures, baked_by, apart: None, paths: 64, texel_rays: 256, seed: 3 };
    let found = compare(&question).expect("a comparison");
    let count = points.len() as f64;
    assert!(count > 100.0, "{count}");
    // The noise is that of one point.
    let allowed = 4.0 * found.reference_noise / count.sqrt() + 1e-6;
    assert!((found.mean - 1.0).abs() < allowed, "{} ± {allowed}", found.mean);
    let sum: f64 = found.budget.iter().map(|row| row.mean_square).sum();
    assert!((sum - found.whole.relative_rms.value.powi(2)).abs() < 1e-12, "{:?}", found.budget);
    let row = |name: &str| found.budget.iter().find(|row| row.name == name).expect("a row").mean_square.sqrt();
    assert_eq!(row("truncation"), 0.0);
    // 16 bits of coefficients that sum to less than 2: each rounded by at most 2⁻¹¹.
    assert!(row("rounding") > 0.0 && row("rounding") < 1e-3, "{:?}", found.budget);
    // Intervals are of 95 %; the tail is worth at most ρ⁵ of what is left after four layers.
    let tail = 0.5f64.powi(5) * scene.summary.mean_survival(4);
    let bias = found.whole.bias;
    assert!(bias.value.abs() < 2.0 * bias.half_interval + tail, "{bias:?}, tail {tail}");
    // In the dark only the luminaires are left, and all is linear in their power: the same paths, twice as bright.
    let (dark, none) = (Dark, [Coefficients::zero(2), Coefficients::zero(2), Coefficients::zero(2)]);
    let lit = |scale: f64| {
        let scales = [[scale; 3]; 5];
        let surface = LitSurface { light: &dark, coefficients: &none, emission: [0.0; 3], scales: &scales, ..surface };
        compare(&Question { surface, ..question }).expect("a comparison").at_points
    };
    for (once, twice) in lit(1.0).iter().zip(lit(2.0)) {
        let pairs = || once.iter().flatten().zip(twice.iter().flatten());
        assert!(pairs().all(|(a, b)| (b - 2.0 * a).abs() < 1e-6 * b.abs() && *a > 0.0), "{once:?} {twice:?}");
    }
}

struct Dark;

impl DirectionalSource for Dark {
    fn sample(&self, _: [f32; 2]) -> Option<DirectionSample> {
        None
    }

    fn density(&self, _: Direction) -> f32 {
        0.0
    }

    fn radiance(&self, _: Direction) -> [f32; 3] {
        [0.0; 3]
    }
}

/// A light that is found by chance alone.
struct Unsampled<'a>(&'a dyn DirectionalSource);

impl DirectionalSource for Unsampled<'_> {
    fn sample(&self, _: [f32; 2]) -> Option<DirectionSample> {
        None
    }

    fn density(&self, _: Direction) -> f32 {
        0.0
    }

    fn radiance(&self, direction: Direction) -> [f32; 3] {
        self.0.radiance(direction)
    }
}

/// A lamp in the sky over a room with a mirror: sampled by its own density and by the cosine, or by the cosine alone,
/// it brings the same. The two have their paths in common and what they sample not.
#[test]
fn a_sampled_environment_is_the_one_that_is_met() {
    let (volume, isovalue) = torus();
    let pyramid = Pyramid::new(&volume);
    let mut walls: Vec<Wall> = Vec::new();
    let faces = Shape::faces_of_box(DVec3::splat(-1.3), DVec3::splat(1.3), true);
    for (i, shape) in faces.into_iter().take(5).enumerate() {
        let finish = if i == 0 { Finish::Mirror([0.9; 3]) } else { Finish::Diffuse([0.6; 3]) };
        walls.push(Wall { name: format!("w{i}"), shape, finish });
    }
    let geometry = Geometry::new(walls, Vec::new(), 1.0).expect("a room");
    let sun = probe::by_name("sun:30,50,20").expect("a sun").expect("a sun");
    let source = sun.source(Orientation::default());
    let met = Unsampled(&source);
    let lights: [&dyn DirectionalSource; 2] = [&source, &met];
    let points = points(&volume, isovalue, 11);
    let settings = SceneReference::new(1024, [0.7; 3], 9);
    let (found, counts) =
        direct(&volume, &pyramid, Some(&geometry), isovalue, &points, &lights, &settings).expect("a reference");
    assert!(counts.light_rays > 0);
    let mean = |l: usize| found[l].iter().map(|r| r.mean[1]).sum::<f64>() / points.len() as f64;
    let square = |l: usize| found[l].iter().map(|r| r.stderr[1].powi(2)).sum::<f64>();
    let error = |l: usize| square(l).sqrt() / points.len() as f64;
    let z = (mean(0) - mean(1)) / error(0).hypot(error(1));
    assert!(mean(0) > 0.0 && normal_two_sided(z) > sidak(0.001, 1), "{} and {}: z {z}", mean(0), mean(1));
    // That is what sampling is for: it is worth at least twice the paths.
    assert!(error(0).powi(2) < 0.5 * error(1).powi(2), "{} and {}", error(0), error(1));
}
