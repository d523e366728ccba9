//! Translucent solids: closed forms, quadrature and invariances.

use super::{BANDS, RESOLUTIONS, assert_finer_is_right, ball, fog, poles, texels};
use glam::DVec3;
use isolume::level::{LevelField, Pyramid};
use isolume::sampling::PathSampler;
use isolume::sampling::statistics::Running;
use isolume::scene::geometry::Geometry;
use isolume::scene::medium::{Body, Medium, Phase, albedo_nodes, node_factors};
use isolume::surface::isosurface;
use isolume::transfer::{Lattice, Layers, Layout, Selection};
use isolume::transport::{Bake, Settings, SurfacePoints, estimates, pilot};
use std::f64::consts::PI;

/// The volume as a translucent solid.
fn through(medium: Medium, index: f64, nodes: Vec<f64>) -> Geometry {
    let body = Body { medium, index, nodes };
    Geometry::new(Vec::new(), Vec::new(), 1.0).expect("nothing").with_body(body).expect("a body")
}

/// Means over the poles of a translucent sphere: Σ, then moments 1 to 4.
fn of_body(samples: usize, depth: f64, albedo: f64, phase: &Phase, index: f64, rays: u32) -> Vec<Running> {
    const RADIUS: f64 = 0.6;
    let medium = fog(depth / RADIUS, albedo, phase.clone());
    let (volume, geometry) = (ball(samples), through(medium, index, Vec::new()));
    let mut all = vec![Running::default(); BANDS];
    for seed in 0..2 {
        for texel in texels(&volume, &geometry, &poles(samples, RADIUS), rays, seed) {
            all.iter_mut().zip(&texel.moments).for_each(|(running, value)| running.push(*value));
        }
    }
    all
}

fn compare_body(name: &str, of: (f64, f64, Phase, f64), expected: &[f64], own: f64) {
    let (depth, albedo, phase, index) = of;
    let found = RESOLUTIONS.map(|samples| of_body(samples, depth, albedo, &phase, index, 1 << 12));
    assert_finer_is_right(name, &found, expected, own);
}

/// B1 and B2: the matched sphere under uniform light; at an albedo of 0 in closed form.
#[test]
fn a_translucent_sphere_under_uniform_light() {
    for (depth, [half, most, nearly]) in [
        (1.0, [0.542257, 0.878006, 0.986790]),
        (2.0, [0.348924, 0.781617, 0.973919]),
        (5.0, [0.205195, 0.623485, 0.938537]),
    ] {
        for (a, expected) in [(0.5, half), (0.9, most), (0.99, nearly)] {
            compare_body(&format!("τ {depth} a {a}"), (depth, a, Phase::Isotropic, 1.0), &[expected], 3e-6);
        }
        let t: f64 = depth;
        let absorbed = 1.0 / (2.0 * t * t) - (1.0 / t + 1.0 / (2.0 * t * t)) * (-2.0 * t).exp();
        compare_body(&format!("τ {depth} a 0"), (depth, 0.0, Phase::Isotropic, 1.0), &[absorbed], 0.0);
    }
}

/// B3: directions, forward scattering and an index.
#[test]
fn a_translucent_sphere_lit_from_a_side() {
    let hg = Phase::HenyeyGreenstein(0.8);
    for (depth, phase, index, a, expected) in [
        (1.0, Phase::Isotropic, 1.0, 0.9, [0.878001, -0.079206, 0.004641, 0.041603, -0.017376]),
        (5.0, Phase::Isotropic, 1.0, 0.9, [0.623464, 0.291026, 0.031092, -0.023530, -0.000948]),
        (5.0, hg.clone(), 1.0, 0.9, [0.552347, -0.008525, -0.075521, 0.014658, 0.020040]),
        (5.0, Phase::Isotropic, 1.4, 0.9, [0.455055, 0.214452, 0.032224, -0.021870, -0.004016]),
        (5.0, hg, 1.4, 0.99, [0.882687, -0.047018, 0.006249, -0.021234, 0.004330]),
    ] {
        compare_body(&format!("τ {depth} n {index} a {a}"), (depth, a, phase, index), &expected, 5e-5);
    }
}

/// B8: a white body loses nothing, whatever its shape, its index and where the border cuts it.
#[test]
fn a_white_body_loses_nothing() {
    let gyroid =
        isolume::volume::field::by_name("gyroid:17").expect("a field").expect("a field").sample().expect("a volume");
    for index in [1.0, 1.5] {
        let geometry = through(fog(3.0, 1.0, Phase::HenyeyGreenstein(0.3)), index, Vec::new());
        let found = texels(&ball(21), &geometry, &poles(21, 0.6), 1 << 10, 5);
        let [nx, ny, nz] = gyroid.dims();
        let some: Vec<([usize; 3], DVec3)> =
            (0..40).map(|i| ([(7 * i) % nx, (5 * i + 3) % ny, (11 * i + 1) % nz], DVec3::Z)).collect();
        for texel in found.iter().chain(&texels(&gyroid, &geometry, &some, 1 << 8, 5)) {
            let all = texel.escapes[0] + texel.lost + texel.trapped;
            assert!((all - 1.0).abs() < 1e-6, "index {index}: {all}");
        }
    }
}

/// B7: the mean number of collisions of entries that are uniform over a closed surface and by the cosine is 4n²/S ∫σ dV, whatever the
/// shape and the scattering (Blanco and Fournier 2003).
#[test]
fn mean_paths_through_closed_bodies() {
    let torus = isolume::volume::field::by_name("torus:49").expect("a field").expect("a field");
    let isovalue = torus.field.default_isovalue();
    let volume = torus.sample().expect("a volume");
    let pyramid = Pyramid::new(&volume);
    let mesh = isosurface(&volume, &pyramid, isovalue).expect("a surface");
    let place =
        |v: u32| volume.world_from_grid().point(DVec3::from_array(mesh.positions_in_grid[v as usize].map(f64::from)));
    let corners = |t: &[u32; 3]| t.map(place);
    let areas: Vec<f64> = mesh
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = corners(t);
            0.5 * (b - a).cross(c - a).length()
        })
        .collect();
    let inside: f64 = mesh
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = corners(t);
            a.dot(b.cross(c)) / 6.0
        })
        .sum();
    let surface: f64 = areas.iter().sum();
    // Points of triangles by area, with the normals of the triangles' own field.
    let isolume::volume::Samples::F32(samples) = volume.samples() else { panic!("f32 samples") };
    let field = LevelField::new(&volume, samples, &pyramid);
    let to_grid = volume.world_from_grid().inverse();
    let (mut upto, mut sum) = (Vec::new(), 0.0);
    areas.iter().for_each(|a| {
        sum += a / surface;
        upto.push(sum);
    });
    let count = 4096;
    let mut points = SurfacePoints { isovalue, ..SurfacePoints::default() };
    for i in 0..count {
        let [u, v] = PathSampler::new(1, i, 0).pair(0, 0).map(f64::from);
        let w = f64::from(PathSampler::new(1, i, 0).pair(0, 2)[0]);
        let [a, b, c] = corners(&mesh.triangles[upto.partition_point(|s| *s < w).min(upto.len() - 1)]);
        let root = u.sqrt();
        let grid = to_grid.point(a * (1.0 - root) + b * root * (1.0 - v) + c * root * v);
        let at = field.locate(grid.to_array());
        let Some(normal) = field.hit_normal(&at) else { continue };
        points.positions_in_grid.push(grid.as_vec3().to_array());
        points.normals.push(normal.vec().to_array());
    }
    let layers = Layers::uniform(1, 1).expect("layers").coloured();
    let layout = Layout { lattice: Lattice::of_vertices(points.positions_in_grid.len()), layers: layers.clone() };
    let selection = Selection::all(layout.lattice);
    let settings = Settings { layers, rays: 64, seed: 2, target: None, positive: false };
    for (sigma, phase, index) in
        [(4.0, Phase::Isotropic, 1.0), (1.0, Phase::HenyeyGreenstein(0.7), 1.0), (3.0, Phase::Isotropic, 1.4)]
    {
        // Black outside: a path ends where it first leaves, by one collision more.
        let black = Medium { name: "black".into(), ..fog(1e6, 0.0, Phase::Isotropic) };
        let geometry = through(fog(sigma, 1.0, phase), index, Vec::new()).with_media(vec![black]).expect("a medium");
        let bake = Bake {
            points: Some(&points),
            ..Bake::new(&volume, &pyramid, &layout, &settings, &selection).among(Some(&geometry))
        };
        let summary = pilot(&bake, 1 << 20).expect("a pilot");
        let found = summary.scene.collisions as f64 / summary.paths as f64 - 1.0;
        let expected = sigma * 4.0 * index * index * inside / surface;
        // 262,144 paths whose numbers of collisions spread about as wide as their mean: 0.2 % is one standard error.
        let off = found / expected - 1.0;
        assert!(off.abs() < 0.01 + 0.006, "σ {sigma} n {index}: {found}, expected {expected}, off by {off}");
    }
}

/// B9: nodes against bakes of a fixed albedo, on a body of many collisions.
#[test]
fn nodes_give_any_albedo() {
    let (volume, poles) = (ball(41), poles(41, 0.6));
    for (count, tolerance) in [(6, 1.7e-2), (10, 1.1e-3)] {
        let nodes = albedo_nodes(count);
        let free = through(fog(10.0 / 0.6, 0.5, Phase::Isotropic), 1.0, nodes.clone());
        let layers = Layers::uniform(nodes.len(), 1).expect("layers").coloured();
        let layout =
            Layout { lattice: Lattice::from_ratio(volume.dims(), 1.0).expect("a lattice"), layers: layers.clone() };
        let (pyramid, selection) = (Pyramid::new(&volume), Selection::empty(layout.lattice));
        let settings = Settings { layers, rays: 1 << 12, seed: 4, target: None, positive: false };
        let bake = Bake::new(&volume, &pyramid, &layout, &settings, &selection).among(Some(&free));
        let asked: Vec<([usize; 3], u32)> = poles.iter().map(|(t, _)| (*t, 1 << 12)).collect();
        let found = estimates(&bake, &asked).expect("estimates");
        for albedo in [0.3, 0.8, 0.97] {
            let factors = node_factors(&nodes, albedo);
            assert!((factors.iter().sum::<f64>() - 1.0).abs() < 1e-9);
            let of = |groups: &Vec<isolume::transport::TexelEstimate>| -> f64 {
                (0..nodes.len()).map(|q| factors[q] * f64::from(groups[0].transfer[3 * q])).sum::<f64>()
                    * (4.0 * PI).sqrt()
            };
            let by_nodes: Running = found.iter().map(|groups| of(groups.as_ref().expect("a level set"))).collect();
            let fixed = of_body(41, 10.0, albedo, &Phase::Isotropic, 1.0, 1 << 12);
            let noise = by_nodes.standard_error().hypot(fixed[0].standard_error());
            let off = (by_nodes.mean() - fixed[0].mean()).abs();
            assert!(
                off < tolerance + 4.0 * noise,
                "Q {count} a {albedo}: {} {} ± {noise}",
                by_nodes.mean(),
                fixed[0].mean()
            );
        }
        // The node in the widest gap is where the stated check looks.
        let check = nodes[count];
        assert!(node_factors(&nodes, check)[count] == 0.0 && nodes[..count].iter().all(|a| (a - check).abs() > 1e-6));
    }
}
