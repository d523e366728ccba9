//! Level sets among walls and luminaires against closed forms, and against path tracing without layers.

use crate::common::scenes::{Square, baked, corner_factor, radiance_of_texel};
use crate::common::{energy_of, grey};
use glam::DVec3;
use isolume::level::Pyramid;
use isolume::relight::{Light, LookupReport};
use isolume::sampling::statistics::{Running, normal_two_sided, sidak};
use isolume::scene::geometry::{Finish, Geometry, Luminaire, LuminaireShape, Shape, Wall};
use isolume::transfer::{BRICK, BrickSource, Lattice, Layers, Layout, MemoryTexture, Selection, texels_of_isosurface};
use isolume::transport::{
    Bake, ChunkBricks, Progress, SceneReference, Settings, Target, bake, estimates, scene_radiance,
};
use isolume::volume::Volume;
use isolume::volume::field::{by_name, sample};
use std::f64::consts::PI;

pub(crate) fn wall(name: &str, shape: Shape, finish: Finish) -> Wall {
    Wall { name: name.into(), shape, finish }
}

pub(crate) fn lamp(name: &str, shape: LuminaireShape, power: f64) -> Luminaire {
    Luminaire { name: name.into(), shape, power: [power; 3] }
}

pub(crate) fn room(min: DVec3, max: DVec3, albedos: [[f32; 3]; 6]) -> Vec<Wall> {
    let faces = Shape::faces_of_box(min, max, true);
    faces
        .into_iter()
        .zip(albedos)
        .enumerate()
        .map(|(i, (s, a))| wall(&format!("w{i}"), s, Finish::Diffuse(a)))
        .collect()
}

/// The square z = 0, lit from above.
const FLOOR: Square = Square { z: 0.0, sign: -1.0 };

pub(crate) fn dark() -> Light {
    Light::constant([0.0; 3])
}

/// VALIDATION 16: a unit square of radiance 1 at distance 1 over the unit square. Point by point by the form factor of
/// a rectangle, and in the mean F₁₂ = 0.19982.
#[test]
fn facing_squares() {
    let (corner, u, v) = (DVec3::Z, DVec3::Y, DVec3::X);
    // Φ = π A L = π.
    let square = lamp("square", LuminaireShape::Rectangle { corner, u, v }, PI);
    let geometry = Geometry::new(Vec::new(), vec![square], 1.0).expect("a luminaire");
    let scene = baked(&sample(&FLOOR, [17, 17, 5]).expect("a volume"), &geometry, &[0.0], 1024, 1);
    let lit = scene.lit(&dark(), &grey(1.0, 0.0), &[]);
    let errors = lit.look_up_errors(&scene.texels().map(|t| t.map(|i| i as f32)).collect::<Vec<_>>());
    let (mut mean, mut weights, mut squares) = (0.0, 0.0, Running::new());
    for (texel, error) in scene.texels().zip(errors).filter(|(t, _)| t[2] == 2) {
        let [x, y] = [texel[0], texel[1]].map(|i| i as f64 / 16.0);
        let expected: f64 =
            [(x, y), (1.0 - x, y), (x, 1.0 - y), (1.0 - x, 1.0 - y)].iter().map(|&(a, b)| corner_factor(a, b)).sum();
        let found = f64::from(radiance_of_texel(&lit, texel)[0]);
        // 16 bits round by 2⁻¹¹.
        assert!((found - expected).abs() < 6.0 * f64::from(error) + 5e-4 * expected, "{texel:?}: {found} {expected}");
        squares.push(((found - expected) / f64::from(error)).powi(2));
        let end = |i: usize| if i == 0 || i == 16 { 0.5 } else { 1.0 };
        mean += end(texel[0]) * end(texel[1]) * found;
        weights += end(texel[0]) * end(texel[1]);
    }
    // A t-distribution of three degrees of freedom has variance 3.
    assert!(squares.count() == 289 && squares.mean() < 6.0, "{}", squares.mean());
    // The trapezoid rule at steps of 1/16: its error is below h²/12 times the jump of the slope, 2e-4.
    assert!((mean / weights - 0.19982).abs() < 3e-4, "{}", mean / weights);
}

/// The other way round: photons of the square that land on a black one facing it are the share F₁₂, and nothing is lost.
#[test]
fn photons_keep_their_power() {
    let volume = sample(&FLOOR, [5, 5, 5]).expect("a volume");
    let square = lamp("square", LuminaireShape::Rectangle { corner: 3.0 * DVec3::Z, u: DVec3::Y, v: DVec3::X }, 90.0);
    let facing =
        wall("f", Shape::Rectangle { corner: 2.0 * DVec3::Z, u: DVec3::X, v: DVec3::Y }, Finish::Diffuse([0.0; 3]));
    let geometry = Geometry::new(vec![facing], vec![square], 1.0).expect("a scene");
    let photons = 1 << 14;
    let energy = energy_of(&volume, &geometry, 0.0, [0.5; 3], photons);
    let error = (0.2 * 0.8 / f64::from(photons)).sqrt();
    assert!((energy.in_walls[0] / energy.emitted[0] - 0.19982).abs() < 4.0 * error, "{energy:?}");
    assert!(energy.imbalance() < 1e-6, "{energy:?}");
    // The bump box in its coloured box, with glass and a mirror: whatever happens, the power is somewhere.
    let volume = by_name("bumpbox:17").expect("a field").expect("a field").sample().expect("a volume");
    let mut walls = room(DVec3::ZERO, DVec3::ONE, [[0.6, 0.1, 0.1]; 6]);
    walls.push(wall("g", Shape::Sphere { centre: DVec3::new(0.2, 0.2, 0.5), radius: 0.1 }, Finish::Glass(1.5)));
    walls.push(wall("m", Shape::Sphere { centre: DVec3::new(0.8, 0.2, 0.5), radius: 0.1 }, Finish::Mirror([0.9; 3])));
    let shape = LuminaireShape::Rectangle { corner: DVec3::new(0.3, 0.0, 0.3), u: 0.4 * DVec3::Z, v: 0.4 * DVec3::X };
    let geometry = Geometry::new(walls, vec![lamp("ceiling", shape, 90.0)], 1.0).expect("a scene");
    let energy = energy_of(&volume, &geometry, 47.0, [0.7; 3], 4096);
    assert!(energy.imbalance() < 1e-6, "{energy:?}");
    let share = |part: [f64; 3]| part[0] / energy.emitted[0];
    assert!(share(energy.absorbed) > 0.03 && share(energy.in_walls) > 0.2 && energy.escaped == [0.0; 3], "{energy:?}");
}

/// A room whose walls shine with (1 − ρ) L and reflect ρ, around a level set that does the same with another ρ: L everywhere,
/// whatever the shapes. Layers beyond the last bring at most ρ^(N+1) L of it.
#[test]
fn a_furnace_with_walls_is_uniform() {
    let walls = room(DVec3::splat(-1.3), DVec3::splat(1.3), [[0.4; 3]; 6]);
    let of =
        |i: usize| Luminaire { name: format!("l{i}"), shape: LuminaireShape::Wall(format!("w{i}")), power: [0.6; 3] };
    let geometry = Geometry::new(walls, (0..6).map(of).collect(), 1.0).expect("a furnace");
    let volume = by_name("torus:17").expect("a field").expect("a field").sample().expect("a volume");
    let (rho, layers) = (0.5f32, 4);
    let isovalue = by_name("torus:17").expect("a field").expect("a field").field.default_isovalue();
    let scene = baked(&volume, &geometry, &[isovalue], 64, layers);
    let lit = scene.lit(&dark(), &grey(rho, 1.0 - rho), &[]);
    let mut sum = Running::new();
    for texel in scene.texels().step_by(3) {
        let found = f64::from(radiance_of_texel(&lit, texel)[1]);
        sum.push(found);
        assert!((found - 1.0).abs() < 0.2, "{texel:?}: {found}");
    }
    let allowed =
        4.0 * sum.standard_error() + f64::from(rho).powi(layers as i32 + 1) * scene.summary.mean_survival(layers);
    assert!(sum.count() > 100 && (sum.mean() - 1.0).abs() < allowed, "{} ± {allowed}", sum.mean());
}

/// Clear glass and perfect mirrors in constant light show constant light: the level set is as bright as without them.
#[test]
fn glass_and_mirrors_keep_radiance() {
    let outside = Finish::Glass(1.5);
    let walls = vec![
        wall("glass", Shape::Sphere { centre: DVec3::new(0.0, 0.0, 1.6), radius: 0.5 }, outside),
        wall("mirror", Shape::Sphere { centre: DVec3::new(1.8, 0.0, 0.0), radius: 0.6 }, Finish::Mirror([1.0; 3])),
    ];
    let geometry = Geometry::new(walls, Vec::new(), 1.0).expect("objects");
    let volume = by_name("sphere:17").expect("a field").expect("a field").sample().expect("a volume");
    let scene = baked(&volume, &geometry, &[-0.6], 64, 4);
    // A furnace: L = 1 from outside, Le = 1 − ρ.
    let lit = scene.lit(&Light::constant([1.0; 3]), &grey(0.5, 0.5), &[]);
    let mut sum = Running::new();
    scene.texels().for_each(|t| sum.push(f64::from(radiance_of_texel(&lit, t)[2])));
    // Paths that are cut after 64 turns in the glass bring nothing; its critical angle traps none from outside.
    let allowed = 4.0 * sum.standard_error() + 2e-3;
    assert!((sum.mean() - 1.0).abs() < allowed, "{} ± {allowed}", sum.mean());
    assert!(scene.summary.scene.specular_hits > 1000);
}

/// VALIDATION 14 by the group of emission: inside a closed sphere every ray comes back, so L = Le/(1 − ρ) to the rounding
/// of 16 bits, tail and all.
#[test]
fn a_closed_sphere_glows() {
    let field = by_name("sphere:17").expect("a field").expect("a field");
    let mut volume = field.sample().expect("a volume");
    volume.solid = isolume::volume::Solid::Below;
    let far = wall("far", Shape::Sphere { centre: DVec3::splat(50.0), radius: 1.0 }, Finish::Diffuse([0.5; 3]));
    let geometry = Geometry::new(vec![far], Vec::new(), 1.0).expect("a wall");
    let scene = baked(&volume, &geometry, &[-0.6], 16, 3);
    for (rho, expected) in [(0.5f32, 2.0), (0.9, 10.0)] {
        let lit = scene.lit(&Light::constant([1.0; 3]), &grey(rho, 1.0), &[]);
        for texel in scene.texels() {
            let found = f64::from(radiance_of_texel(&lit, texel)[0]);
            assert!((found - expected).abs() < 1e-3 * expected, "{texel:?}: {found}");
        }
    }
}

pub(crate) fn box_scene(lamp_shape: LuminaireShape) -> (Volume, Geometry) {
    let volume = by_name("bumpbox:33").expect("a field").expect("a field").sample().expect("a volume");
    let mut albedos = [[0.75; 3]; 6];
    (albedos[0], albedos[1]) = ([0.63, 0.065, 0.05], [0.14, 0.45, 0.091]);
    let walls = room(DVec3::ZERO, DVec3::ONE, albedos);
    (volume, Geometry::new(walls, vec![lamp("ceiling", lamp_shape, 90.0)], 1.0).expect("a box"))
}

pub(crate) fn ceiling() -> LuminaireShape {
    LuminaireShape::Rectangle { corner: DVec3::new(0.3, 0.0, 0.3), u: 0.4 * DVec3::Z, v: 0.4 * DVec3::X }
}

/// Rays from a camera in the box towards the level set.
fn camera_rays(count: usize) -> Vec<(DVec3, DVec3)> {
    let eye = DVec3::new(0.5, 0.12, 0.06);
    let target = |i: usize| {
        let turn = i as f64 * 2.399_963;
        let radius = 0.28 * ((i as f64 + 0.5) / count as f64).sqrt();
        DVec3::new(0.5 + radius * turn.cos(), 0.62 + radius * turn.sin(), 0.5)
    };
    (0..count).map(|i| (eye, target(i) - eye)).collect()
}

fn reference(
    volume: &Volume,
    geometry: &Geometry,
    rays: &[(DVec3, DVec3)],
    paths: u32,
    samples: bool,
) -> Vec<[f64; 2]> {
    let settings = SceneReference {
        paths,
        albedo: [0.7; 3],
        emission: [0.0; 3],
        scales: Vec::new(),
        samples_luminaires: samples,
        sees_through_backs: false,
        seed: if samples { 1 } else { 2 },
    };
    let pyramid = Pyramid::new(volume);
    let (found, _) = scene_radiance(volume, &pyramid, geometry, 47.0, rays, None, &settings).expect("a reference");
    found.into_iter().map(|r| r.map_or([0.0; 2], |r| [r.mean[0], r.stderr[0]])).collect()
}

/// The reference that samples luminaires and the one that only happens on them agree, ray by ray: a test of every density and
/// of every shadow.
#[test]
fn the_reference_and_its_slow_twin_agree() {
    let ball = LuminaireShape::Sphere { centre: DVec3::new(0.5, 0.15, 0.5), radius: 0.1 };
    for shape in [ceiling(), ball] {
        let (volume, geometry) = box_scene(shape);
        let rays = camera_rays(24);
        let sampled = reference(&volume, &geometry, &rays, 256, true);
        let slow = reference(&volume, &geometry, &rays, 2048, false);
        let mut differences = Running::new();
        for ([a, ea], [b, eb]) in sampled.iter().zip(&slow) {
            differences.push((a - b) / (ea * ea + eb * eb).sqrt());
        }
        let z = differences.mean() * (differences.count() as f64).sqrt() / 1.2;
        assert!(normal_two_sided(z) > sidak(0.001, 2), "mean z {}", differences.mean());
        assert!(sampled.iter().zip(&slow).all(|([a, ea], [b, eb])| (a - b).abs() < 8.0 * (ea * ea + eb * eb).sqrt()));
    }
}

/// What a store says of the bump box in its box is what path tracing says, within errors and interpolation; twice the power is
/// twice the light to the last bit.
#[test]
fn a_baked_box_is_the_box() {
    let (volume, geometry) = box_scene(ceiling());
    let scene = baked(&volume, &geometry, &[47.0], 256, 4);
    let material = grey(0.7, 0.0);
    let once = scene.lit(&dark(), &material, &[1.0]);
    let twice = scene.lit(&dark(), &material, &[2.0]);
    for texel in scene.texels() {
        let (a, b) = (radiance_of_texel(&once, texel), radiance_of_texel(&twice, texel));
        assert_eq!(a.map(|v| 2.0 * v), b);
    }
    let rays = camera_rays(64);
    let expected = reference(&volume, &geometry, &rays, 256, true);
    let pyramid = Pyramid::new(&volume);
    let (mut square, mut mean, mut used) = (0.0, 0.0, 0.0);
    for ((origin, direction), [value, _]) in rays.iter().zip(expected) {
        let Some(at) = first_hit(&volume, &pyramid, 47.0, *origin, *direction) else { continue };
        let mut report = LookupReport::default();
        let found = once.radiance_at(at, [0.0, -1.0, 0.0], &dark(), &material, &mut report);
        square += (f64::from(found[0]) - value).powi(2);
        mean += value;
        used += 1.0;
    }
    let relative = (square / used).sqrt() / (mean / used);
    assert!(used > 40.0 && relative < 0.05, "relative RMS {relative} over {used} rays");
    let c = &scene.summary.scene;
    assert!(c.light_rays > 0 && c.wall_hits > 0 && c.specular_hits == 0, "{c:?}");
    assert!(scene.summary.mean_escapes().iter().all(|&a| a == 0.0), "the room is closed");
}

/// Marching along a ray in small steps: no part of the library's tracer.
fn first_hit(volume: &Volume, _: &Pyramid, isovalue: f64, origin: DVec3, direction: DVec3) -> Option<[f32; 3]> {
    let grid_from_world = volume.world_from_grid().inverse();
    let value = |p: DVec3| {
        let g = grid_from_world.point(p);
        let (cell, at) = (g.floor(), g - g.floor());
        let mut sum = 0.0;
        for corner in 0..8 {
            let pick = [corner & 1, corner >> 1 & 1, corner >> 2];
            let w: f64 = (0..3).map(|a| if pick[a] == 1 { at[a] } else { 1.0 - at[a] }).product();
            let i: [usize; 3] = std::array::from_fn(|a| (cell[a] as usize + pick[a]).min(volume.dims()[a] - 1));
            sum += w * f64::from(volume.samples().raw(volume.index(i[0], i[1], i[2])));
        }
        sum - isovalue
    };
    let direction = direction.normalize();
    let at = (1..4000).map(|i| origin + f64::from(i) * 2.5e-4 * direction);
    at.take_while(|p| p.cmpge(DVec3::ZERO).all() && p.cmple(DVec3::ONE).all())
        .find(|p| value(*p) > 0.0)
        .map(|p| grid_from_world.point(p).as_vec3().to_array())
}

/// The same bytes for one thread and for two.
#[test]
fn threads_do_not_matter() {
    let bake = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let (volume, geometry) = box_scene(ceiling());
            let scene = baked(&volume, &geometry, &[100.0], 4, 2);
            (scene.bits(), scene.summary.scene)
        })
    };
    assert!(bake(1) == bake(2));
}

/// A ball between two white mirrors of side 2·64000, Δ = 3 apart. A path that leaves it at an angle θ to their normal advances
/// Δ tan θ a meeting: below tan θ = 64000/(4096 Δ) it is cut, before it comes to an edge. The directions of all texels
/// together are uniform, so that is 1 − cos(arctan 5.2) = 0.81 of them, less those that meet the ball again; beyond 45°
/// (0.71 − 0.19 = 0.52 of all) they pass it but for the first crossings.
#[test]
fn paths_cut_among_mirrors_are_counted() {
    let volume = by_name("sphere:12").expect("a field").expect("a name").sample().expect("a volume");
    let pair = |finish: Finish| {
        let faces = Shape::faces_of_box(DVec3::new(-1.5, -6.4e4, -6.4e4), DVec3::new(1.5, 6.4e4, 6.4e4), true);
        let walls = [0, 1].map(|i| wall(&format!("w{i}"), faces[i].clone(), finish));
        let geometry = Geometry::new(walls.to_vec(), Vec::new(), 1.0).expect("a geometry");
        baked(&volume, &geometry, &[-0.6], 16, 1).summary
    };
    let between = pair(Finish::Mirror([1.0; 3]));
    let share = between.scene.lost_specular as f64 / between.paths as f64;
    assert!((0.4..0.82).contains(&share) && between.scene.lost_turns == 0, "{share}: {:?}", between.scene);
    assert!(between.scene.specular_hits >= 4096 * between.scene.lost_specular);
    // Grey ones end such chains by roulette.
    let grey = pair(Finish::Mirror([0.9; 3]));
    assert_eq!((grey.scene.lost_specular, grey.scene.lost_turns), (0, 0));
    let diffuse = pair(Finish::Diffuse([0.5; 3]));
    assert_eq!((diffuse.scene.lost_specular, diffuse.scene.lost_turns), (0, 0));
    // All walls are mirrors: whoever leaves the ball comes back to it or is cut, but for rays through the seams of the box.
    let faces = Shape::faces_of_box(DVec3::splat(-1.5), DVec3::splat(1.5), true);
    let closed = faces.iter().enumerate().map(|(i, f)| wall(&format!("w{i}"), f.clone(), Finish::Mirror([1.0; 3])));
    let geometry = Geometry::new(closed.collect(), Vec::new(), 1.0).expect("a geometry");
    let closed = baked(&volume, &geometry, &[-0.6], 16, 1).summary;
    let ends = closed.trapped + closed.lost + closed.scene.cut + closed.scene.lost_specular;
    assert!(ends <= closed.paths && ends as f64 > 0.999 * closed.paths as f64, "{:?}", closed.scene);
}

/// Texels among walls stop at the standard error asked for: the root mean square of what they are off under the lamp is not
/// above it, and not so far below that paths are wasted. Of n independent texels an RMS scatters by 1/√(2n).
#[test]
fn texels_among_walls_stop_at_the_error_asked_for() {
    const ALBEDO: f32 = 0.7;
    let (volume, geometry) = box_scene(ceiling());
    let layers = Layers::uniform(3, 1).expect("layers").coloured();
    let lattice = Lattice::from_ratio(volume.dims(), 1.0).expect("a lattice");
    let layout = Layout { lattice, layers: layers.clone() };
    let all = texels_of_isosurface(&volume, lattice, 47.0);
    let [nx, ny, nz] = lattice.texels();
    let places = (0..nx * ny * nz).map(|i| [i % nx, i / nx % ny, i / nx / ny]).filter(|t| all.contains(*t));
    let texels: Vec<[usize; 3]> = places.step_by(29).collect();
    let mut selection = Selection::empty(lattice);
    texels.iter().for_each(|t| selection.insert(*t));
    let pyramid = Pyramid::new(&volume);
    let factor = f64::from(geometry.exponents(&volume)[0]).exp2();
    let lit = |gains: &[f32]| -> f64 {
        let layers = gains.chunks_exact(3).enumerate();
        layers
            .map(|(k, g)| f64::from(ALBEDO).powi(k as i32 + 1) * factor * f64::from(g.iter().sum::<f32>()) / 3.0)
            .sum()
    };
    let plain = Settings { layers: layers.clone(), rays: 4096, seed: 77, target: None, positive: false };
    let job = Bake::new(&volume, &pyramid, &layout, &plain, &selection).among(Some(&geometry));
    let asked: Vec<_> = texels.iter().map(|&t| (t, 4096)).collect();
    let truth: Vec<Option<f64>> =
        estimates(&job, &asked).expect("texels").iter().map(|t| Some(lit(&t.as_ref()?[2].transfer))).collect();
    let known = truth.iter().flatten().count() as f64;
    let mean = truth.iter().flatten().sum::<f64>() / known;
    for error in [0.1f32, 0.04] {
        let weights = (1..=3).map(|k| (f64::from(ALBEDO).powi(k) * factor / mean) as f32).collect();
        let target = Target { luminaires: vec![weights], ..Target::escape(&layers, error) };
        let settings = Settings { target: Some(target), seed: 5, ..plain.clone() };
        let job = Bake::new(&volume, &pyramid, &layout, &settings, &selection).among(Some(&geometry));
        let mut lamp = MemoryTexture::new(job.groups()[2].layout(&layout).expect("a layout"));
        let mut keep = |chunk, mut groups: ChunkBricks| lamp.insert_chunk(chunk, groups.swap_remove(2));
        let summary = bake(&job, &job.chunks(), &Progress::default(), &|_| Ok(None), &mut keep).expect("a bake");
        let (mut square, mut used) = (0.0, 0.0);
        for (texel, truth) in texels.iter().zip(&truth).filter_map(|(t, truth)| Some((t, (*truth)?))) {
            let brick = lamp.brick(texel.map(|i| i / BRICK)).expect("a brick").expect("baked");
            let t = texel[0] % BRICK + BRICK * (texel[1] % BRICK + BRICK * (texel[2] % BRICK));
            let gains: Vec<f32> = brick.transfer[9 * t..9 * t + 9].iter().map(|v| v.to_f32()).collect();
            square += ((lit(&gains) - truth) / mean).powi(2);
            used += 1.0;
        }
        let (rms, paths) = ((square / used).sqrt(), summary.paths as f64 / summary.valid as f64);
        println!("error {error}: RMS {rms:.4} over {used} texels, {paths:.0} paths a texel");
        let scatter = 3.0 / (2.0 * f64::from(used as f32)).sqrt();
        assert!(used > 50.0 && rms < f64::from(error) * (1.0 + scatter), "{rms} for {error}");
        assert!(rms > 0.25 * f64::from(error), "{rms} for {error}: paths are wasted");
    }
}
