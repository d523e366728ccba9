//! Media outside the solid against closed forms and quadrature, and against a tracker that shares none of their flights.
//!
//! Letters and figures are those of `tests/VALIDATION.md`, media. A level set of samples is not the sphere that was sampled:
//! figures are compared at two resolutions, and the finer one may be off by as much as the two differ, besides four standard
//! errors.

mod bodies;

use crate::common::{bowl, voxels};
use glam::DVec3;
use isolume::level::{LevelField, Outcome, Pyramid, Start};
use isolume::sampling::PathSampler;
use isolume::sampling::statistics::Running;
use isolume::scene::Table;
use isolume::scene::geometry::{Geometry, Luminaire, LuminaireShape};
use isolume::scene::medium::{Medium, MediumRegion, Phase};
use isolume::sh;
use isolume::transfer::{Lattice, Layers, Layout, Selection};
use isolume::transport::{Bake, Settings, estimates};
use isolume::volume::Volume;
use std::f64::consts::PI;

const BANDS: usize = 5;
const LAYERS: usize = 4;

fn around(media: Vec<Medium>) -> Geometry {
    Geometry::new(Vec::new(), Vec::new(), 1.0).expect("nothing").with_media(media).expect("media")
}

fn fog(extinction: f64, albedo: f64, phase: Phase) -> Medium {
    Medium::constant("fog", extinction, albedo, phase).expect("a medium")
}

/// What the paths of a texel found: a_k and E[w P_l(ω·n)] of layer 0, of red, and what became of the others.
struct Texel {
    escapes: Vec<f64>,
    moments: Vec<f64>,
    lost: f64,
    trapped: f64,
    luminaires: Vec<f64>,
}

/// Texels that have a level set by path, each by its own random numbers; moments are about the directions.
fn texels(volume: &Volume, geometry: &Geometry, all: &[([usize; 3], DVec3)], rays: u32, seed: u64) -> Vec<Texel> {
    let layers = Layers::uniform(LAYERS, BANDS).expect("layers").coloured();
    let layout =
        Layout { lattice: Lattice::from_ratio(volume.dims(), 1.0).expect("a lattice"), layers: layers.clone() };
    let settings = Settings { layers, rays, seed, target: None, positive: false };
    let (pyramid, selection) = (Pyramid::new(volume), Selection::empty(layout.lattice));
    let bake = Bake::new(volume, &pyramid, &layout, &settings, &selection).among(Some(geometry));
    let asked: Vec<([usize; 3], u32)> = all.iter().map(|(t, _)| (*t, rays)).collect();
    let found = estimates(&bake, &asked).expect("estimates");
    let exponents = geometry.exponents(volume);
    found
        .into_iter()
        .zip(all)
        .filter_map(|(groups, (_, normal))| Some((groups?, normal)))
        .map(|(groups, normal)| {
            let (environment, square) = (&groups[0], BANDS * BANDS);
            let red = |k: usize| &environment.transfer[3 * k * square..][..square];
            let mut basis = [0.0; BANDS * BANDS];
            sh::basis::evaluate(BANDS, normal.to_array(), &mut basis);
            let moment = |l: usize| {
                let range = l * l..(l + 1) * (l + 1);
                let sum: f64 = range.map(|i| f64::from(red(0)[i]) * basis[i]).sum();
                sum * 4.0 * PI / (2 * l + 1) as f64
            };
            Texel {
                escapes: (0..LAYERS).map(|k| f64::from(red(k)[0]) * (4.0 * PI).sqrt()).collect(),
                moments: (0..BANDS).map(moment).collect(),
                lost: f64::from(environment.lost) / f64::from(rays),
                trapped: f64::from(environment.trapped) / f64::from(rays),
                luminaires: groups[2..]
                    .iter()
                    .zip(&exponents)
                    .map(|(g, e)| f64::from(g.transfer[0]) * 2f64.powi(*e))
                    .collect(),
            }
        })
        .collect()
}

/// The sphere |x| < R as {1 − |x| > c}, in [−1, 1]³ of so many samples along a side.
fn ball(samples: usize) -> Volume {
    let step = 2.0 / (samples - 1) as f64;
    let unit = voxels([samples; 3], [-0.5 * (samples - 1) as f64; 3], |p| 1.0 - p.length() * step);
    let world = isolume::geom::Affine::from_spacing(DVec3::splat(step), DVec3::splat(-1.0)).expect("a map");
    Volume::new([samples; 3], unit.samples().clone(), world).expect("a volume")
}

/// The six points of the sphere of radius R on the axes, where they are grid points.
fn poles(samples: usize, radius: f64) -> Vec<([usize; 3], DVec3)> {
    let middle = (samples - 1) / 2;
    let steps = (radius * middle as f64).round() as usize;
    assert!((steps as f64 / middle as f64 - radius).abs() < 1e-12, "no grid point at {radius}");
    let pole = |i: usize| {
        let (axis, up) = (i / 2, i.is_multiple_of(2));
        let (mut texel, mut normal) = ([middle; 3], [0.0; 3]);
        texel[axis] = if up { middle + steps } else { middle - steps };
        normal[axis] = if up { 1.0 } else { -1.0 };
        (texel, DVec3::from_array(normal))
    };
    (0..6).map(pole).collect()
}

/// Means over the poles and some seeds.
fn of_ball(samples: usize, radius: f64, medium: &Medium, rays: u32) -> Vec<Running> {
    let (volume, geometry) = (ball(samples), around(vec![medium.clone()]));
    let mut all = vec![Running::default(); LAYERS + 1 + BANDS];
    for seed in 0..2 {
        for texel in texels(&volume, &geometry, &poles(samples, radius), rays, seed) {
            let sum: f64 = texel.escapes.iter().sum();
            let values = texel.escapes.iter().copied().chain([sum]).chain(texel.moments.iter().copied());
            all.iter_mut().zip(values).for_each(|(running, value)| running.push(value));
        }
    }
    all
}

/// Expected values against two resolutions; those that are NaN are not asked. `own` are standard errors of the expected ones.
fn compare(name: &str, radius: f64, medium: &Medium, expected: &[f64], own: f64) {
    let found = RESOLUTIONS.map(|samples| of_ball(samples, radius, medium, 1 << 13));
    assert_finer_is_right(name, &found, expected, own);
}

/// Samples along a side; the step of the second is half that of the first.
const RESOLUTIONS: [usize; 2] = [41, 81];

fn assert_finer_is_right(name: &str, [coarse, fine]: &[Vec<Running>; 2], expected: &[f64], own: f64) {
    for (i, &value) in expected.iter().enumerate().filter(|(_, v)| !v.is_nan()) {
        let (a, b) = (&coarse[i], &fine[i]);
        let noise = (b.standard_error().powi(2) + a.standard_error().powi(2) + own * own).sqrt();
        let off = (b.mean() - value).abs();
        // The error falls with the square of the step: a third of the difference is left at the finer one.
        assert!(
            off <= (a.mean() - b.mean()).abs() / 3.0 + 4.0 * noise,
            "{name} {i}: {} ± {} (coarse {}), expected {value}",
            b.mean(),
            b.standard_error(),
            a.mean()
        );
    }
}

/// What is asked of layer 0 alone.
fn moments(values: [f64; 5]) -> Vec<f64> {
    [f64::NAN; LAYERS + 1].into_iter().chain(values).collect()
}

fn over_own_values(rows: &[(f64, f32)], albedo: f32) -> Medium {
    let table = |rows: &[(f64, f32)]| Table::new(rows.iter().map(|&(v, s)| (v, [s; 3])).collect()).expect("a table");
    Medium { extinction: table(rows), albedo: table(&[(0.0, albedo)]), ..fog(1.0, 0.0, Phase::Isotropic) }
}

/// A1: extinction s·max(0, 1 − |x|) over the volume's own values, for two level sets of the same volume.
#[test]
fn an_absorbing_medium_over_the_volumes_own_values() {
    let of = |s: f32| over_own_values(&[(0.0, 0.0), (1.0, s)], 0.0);
    compare("s 5, R 0.6", 0.6, &of(5.0), &moments([0.589558, 0.408514, 0.174602, 0.021386, -0.019194]), 0.0);
    compare("s 5, R 0.3", 0.3, &of(5.0), &moments([0.242732, 0.170400, 0.076114, 0.012835, -0.005880]), 0.0);
    compare("s 20, R 0.6", 0.6, &of(20.0), &moments([0.129343, 0.097635, 0.053165, 0.017924, 0.001296]), 0.0);
}

/// A2: a ball of constant absorption around the sphere.
#[test]
fn an_absorbing_ball() {
    let of = |radius: f64, sigma: f64| Medium {
        region: MediumRegion::Ball { centre: DVec3::ZERO, radius },
        ..fog(sigma, 0.0, Phase::Isotropic)
    };
    compare("R 0.4", 0.4, &of(0.9, 1.0), &moments([0.557082, 0.380058, 0.154755, 0.012654, -0.019345]), 0.0);
    compare("R 0.6", 0.6, &of(0.95, 2.0), &moments([0.413560, 0.290400, 0.129621, 0.021402, -0.010766]), 0.0);
}

/// A3: the bowl full of absorbing fog: from its bottom 2 E₃(τ) − E₃(√2 τ) reaches the opening, τ = σ c.
#[test]
fn an_absorbing_bowl() {
    let (radius, c) = (40, 32);
    let volume = bowl(radius);
    let bottom = [radius, radius, radius - c];
    for (tau, expected) in [(0.1, 0.444753), (0.5, 0.278808), (1.0, 0.155989), (2.0, 0.049303)] {
        let geometry = around(vec![fog(tau / c as f64, 0.0, Phase::Isotropic)]);
        let all: Running =
            (0..8).map(|seed| texels(&volume, &geometry, &[(bottom, DVec3::Z)], 1 << 13, seed)[0].escapes[0]).collect();
        // The level set of samples lies within h²/(8c) of the sphere: of its depth and of its solid angle.
        let off = (all.mean() - expected).abs();
        assert!(off < 4.0 * all.standard_error() + 1.0 / (8.0 * (c * c) as f64), "{tau}: {} {expected}", all.mean());
    }
}

/// A4: fog that scatters around the sphere of radius 0.6 in [−1, 1]³.
#[test]
fn scattering_fog_around_a_sphere() {
    let hg = Phase::HenyeyGreenstein(0.5);
    for (sigma, phase, a, expected) in [
        (
            1.0,
            Phase::Isotropic,
            0.5,
            [0.654994, 0.029180, 0.001329, 0.0000607, 0.685567, 0.421140, 0.182416, 0.039178, -0.013187],
        ),
        (
            1.0,
            Phase::Isotropic,
            0.9,
            [0.823539, 0.080972, 0.008153, 0.000830, 0.913590, 0.469167, 0.183905, 0.039306, -0.015424],
        ),
        (
            1.0,
            Phase::Isotropic,
            1.0,
            [0.883432, 0.102673, 0.012223, 0.001468, f64::NAN, 0.484789, 0.184366, 0.039399, -0.016208],
        ),
        (1.0, hg, 0.9, [0.890877, 0.033059, 0.001253, 0.000047, 0.925238, 0.523509, 0.205538, 0.040550, -0.016608]),
        (
            4.0,
            Phase::Isotropic,
            0.9,
            [0.406471, 0.110946, 0.030909, 0.008713, f64::NAN, 0.246439, 0.108877, 0.031358, -0.003020],
        ),
    ] {
        let [a0, a1, a2, a3, sum, l1, l2, l3, l4] = expected;
        let values = [a0, a1, a2, a3, sum, a0, l1, l2, l3, l4];
        compare(&format!("σ {sigma} a {a}"), 0.6, &fog(sigma, a, phase), &values, 4e-5);
    }
}

/// A5: with a white medium all that starts is somewhere: it escaped in some layer, travels on, or was lost.
#[test]
fn a_white_medium_loses_nothing() {
    let table =
        Table::new(vec![(0.0, [0.0, 0.1, 0.3]), (0.4, [3.0, 1.0, 0.2]), (1.0, [0.0, 9.0, 4.0])]).expect("a table");
    let chromatic = Medium { extinction: table, ..fog(1.0, 1.0, Phase::Rayleigh) };
    let forward = Medium { name: "forward".into(), ..fog(3.0, 1.0, Phase::HenyeyGreenstein(0.9)) };
    for media in [
        vec![forward.clone()],
        vec![over_own_values(&[(0.0, 0.0), (1.0, 20.0)], 1.0), Medium { name: "x".into(), ..forward }],
    ] {
        let geometry = around(media);
        for texel in texels(&ball(21), &geometry, &poles(21, 0.6), 1 << 12, 3) {
            let all = texel.escapes.iter().sum::<f64>() + texel.lost + texel.trapped;
            assert!((all - 1.0).abs() < 1e-6, "{all}");
        }
    }
    let all: Running = texels(&ball(21), &around(vec![chromatic]), &poles(21, 0.6), 1 << 13, 3)
        .iter()
        .map(|t| t.escapes.iter().sum::<f64>() + t.trapped + t.lost)
        .collect();
    assert!((all.mean() - 1.0).abs() < 4.0 * all.standard_error(), "{} ± {}", all.mean(), all.standard_error());
}

/// A6: a point light in absorbing fog, E = Φ e^(−σr) cos θ / (4πr²), straight above.
#[test]
fn a_point_light_in_fog() {
    let plane = voxels([5, 5, 11], [-2.0, -2.0, -1.0], |p| -p.z);
    let shape = LuminaireShape::Point { position: DVec3::new(0.0, 0.0, 2.0) };
    let lamp = Luminaire { name: "lamp".into(), shape, power: [1.0; 3] };
    let geometry = Geometry::new(Vec::new(), vec![lamp], 1.0).expect("a lamp");
    let geometry = geometry.with_media(vec![fog(0.5, 0.0, Phase::Isotropic)]).expect("fog");
    let found = &texels(&plane, &geometry, &[([2, 2, 1], DVec3::Z)], 16, 0)[0];
    // Exitant radiance of an albedo of 1 is E/π.
    assert!((found.luminaires[0] * PI - 0.00731873).abs() < 1e-8, "{}", found.luminaires[0] * PI);
}

/// B4: what comes through a slab and back from it, by paths from a wide plane below it: layer k escapes after k returns.
#[test]
fn a_slab_of_fog_above_a_plane() {
    let spacing = DVec3::new(1000.0, 1000.0, 1.0);
    let unit = voxels([5, 5, 4], [-2.0, -2.0, -1.0], |p| -p.z);
    let world = isolume::geom::Affine::from_spacing(spacing, DVec3::new(-2000.0, -2000.0, -1.0)).expect("a map");
    let plane = Volume::new([5, 5, 4], unit.samples().clone(), world).expect("a volume");
    for (tau, a, reflected, through) in [
        (1.0, 0.9, 0.352712, 0.474746),
        (2.0, 0.5, 0.145085, 0.107055),
        (2.0, 1.0, 0.609940, 0.390060),
        (5.0, 0.99, 0.737507, 0.173152),
    ] {
        let bounds = isolume::geom::Bounds { min: DVec3::new(-2e3, -2e3, 0.0), max: DVec3::new(2e3, 2e3, 1.0) };
        let slab = Medium { region: MediumRegion::Within(bounds), ..fog(tau, a, Phase::Isotropic) };
        let geometry = around(vec![slab]);
        let mut all = [Running::default(); 3];
        for seed in 0..12 {
            let found = &texels(&plane, &geometry, &[([2, 2, 1], DVec3::Z)], 1 << 13, seed)[0];
            all.iter_mut().zip(&found.escapes).for_each(|(running, value)| running.push(*value));
        }
        for (k, found) in all.iter().enumerate() {
            let expected = through * f64::powi(reflected, k as i32);
            let off = (found.mean() - expected).abs();
            assert!(off < 4.0 * found.standard_error() + 3e-6, "τ {tau} a {a} layer {k}: {} {expected}", found.mean());
        }
    }
}

/// A grey result of a chromatic medium: σ = 1, 2 and 5 in red, green and blue of one slab.
#[test]
fn one_chromatic_run_has_the_grey_values() {
    let unit = voxels([5, 5, 4], [-2.0, -2.0, -1.0], |p| -p.z);
    let world =
        isolume::geom::Affine::from_spacing(DVec3::new(1e3, 1e3, 1.0), DVec3::new(-2e3, -2e3, -1.0)).expect("a map");
    let plane = Volume::new([5, 5, 4], unit.samples().clone(), world).expect("a volume");
    let bounds = isolume::geom::Bounds { min: DVec3::new(-2e3, -2e3, 0.0), max: DVec3::new(2e3, 2e3, 1.0) };
    let table = Table::new(vec![(0.0, [1.0, 2.0, 5.0])]).expect("a table");
    let slab = Medium { extinction: table, region: MediumRegion::Within(bounds), ..fog(1.0, 0.9, Phase::Isotropic) };
    let geometry = around(vec![slab]);
    let layers = Layers::uniform(1, 1).expect("layers").coloured();
    let layout = Layout { lattice: Lattice::from_ratio(plane.dims(), 1.0).expect("a lattice"), layers: layers.clone() };
    let (pyramid, selection) = (Pyramid::new(&plane), Selection::empty(layout.lattice));
    let mut all = [Running::default(); 3];
    for seed in 0..16 {
        let settings = Settings { layers: layers.clone(), rays: 1 << 14, seed, target: None, positive: false };
        let bake = Bake::new(&plane, &pyramid, &layout, &settings, &selection).among(Some(&geometry));
        let found = estimates(&bake, &[([2, 2, 1], 1 << 14)]).expect("estimates")[0].clone().expect("a level set");
        (0..3).for_each(|c| all[c].push(f64::from(found[0].transfer[c]) * (4.0 * PI).sqrt()));
    }
    for (found, expected) in all.iter().zip([0.474746, 0.265581, 0.053421]) {
        let off = (found.mean() - expected).abs();
        assert!(off < 4.0 * found.standard_error() + 2e-6, "{} ± {} {expected}", found.mean(), found.standard_error());
    }
}

/// Delta tracking, one isovalue and one texel at a time: flights by a majorant of the whole box, the field looked up point by
/// point. It shares the rays of the level set with the estimator and nothing else.
fn tracked(
    volume: &Volume,
    extinction: &dyn Fn(f64) -> f64,
    majorant: f64,
    albedo: f64,
    texel: [usize; 3],
    paths: u32,
) -> Vec<Running> {
    let pyramid = Pyramid::new(volume);
    let isolume::volume::Samples::F32(samples) = volume.samples() else { panic!("f32 samples") };
    let field = LevelField::new(volume, samples, &pyramid);
    let site = field.site(texel.map(|i| i as f64)).expect("a level set");
    let to_grid = volume.world_from_grid().inverse();
    let last = DVec3::from_array(volume.dims().map(|d| (d - 1) as f64));
    let mut all = vec![Running::default(); LAYERS];
    for path in 0..paths {
        let sampler = PathSampler::new(99, u64::from(path), 0);
        let mut drawn = 0;
        let mut next = || {
            drawn += 1;
            sampler.pair(0, drawn).map(f64::from)
        };
        let (mut start, mut normal) = (site.start, Some(site.normal));
        let (mut layer, mut weight) = (0, 1.0);
        let mut in_world = volume.world_from_grid().point(start.at.in_grid().as_dvec3());
        let mut escaped = None;
        'path: loop {
            let [u, v] = next();
            let direction = match normal {
                Some(normal) => {
                    let local = isolume::sampling::warp::square_to_cosine_hemisphere([u as f32, v as f32]);
                    isolume::geom::Frame::around(normal).from_local(local).as_dvec3().normalize()
                }
                None => {
                    let (z, (y, x)) = (2.0 * u - 1.0, (2.0 * PI * v).sin_cos());
                    let r = (1.0 - z * z).sqrt();
                    DVec3::new(r * x, r * y, z)
                }
            };
            let outcome = field.trace(
                site.isovalue,
                &start,
                field.direction_in_grid(direction.as_vec3()),
                &mut Default::default(),
            );
            let end = match &outcome {
                Outcome::Hit(hit) => {
                    (volume.world_from_grid().point(hit.at.in_grid().as_dvec3()) - in_world).dot(direction)
                }
                Outcome::Lost => 0.0,
                Outcome::Escaped => f64::INFINITY,
            };
            let mut s = 0.0;
            loop {
                s -= (1.0 - next()[0]).ln() / majorant;
                let point = in_world + s * direction;
                let grid = to_grid.point(point);
                if s >= end || !(grid.cmpge(DVec3::ZERO).all() && grid.cmple(last).all()) {
                    break;
                }
                let here = extinction(f64::from(field.raw_value(&field.locate(grid.to_array()))));
                assert!(here <= majorant);
                if next()[0] < here / majorant {
                    weight *= albedo;
                    (in_world, normal) = (point, None);
                    start = Start::beside(field.locate(grid.to_array()));
                    continue 'path;
                }
            }
            match outcome {
                Outcome::Escaped => {
                    escaped = Some(layer);
                    break;
                }
                // As the estimator counts it: a hit of distance 0.
                Outcome::Lost => {}
                Outcome::Hit(hit) => {
                    start = Start::on(hit.at);
                    normal = field.hit_normal(&hit.at);
                    in_world = volume.world_from_grid().point(hit.at.in_grid().as_dvec3());
                }
            }
            layer += 1;
            if layer == LAYERS {
                break;
            }
        }
        (0..LAYERS).for_each(|k| all[k].push(if escaped == Some(k) { weight } else { 0.0 }));
    }
    all
}

/// Smoke over the values of a noisy volume, on an oblique grid of unequal steps: exact flights against delta tracking.
#[test]
fn exact_flights_agree_with_delta_tracking() {
    let n = 17;
    let bump =
        |p: DVec3| 6.0 - p.length() + 0.8 * (1.9 * p.x).sin() * (1.3 * p.y + 0.4).cos() + 0.6 * (2.3 * p.z).sin();
    let unit = voxels([n; 3], [-8.0; 3], bump);
    let columns =
        glam::DMat3::from_cols(DVec3::new(0.7, 0.1, 0.0), DVec3::new(-0.1, 0.5, 0.1), DVec3::new(0.05, 0.0, 0.9));
    let world = isolume::geom::Affine::new(columns, DVec3::new(3.0, -2.0, 1.0)).expect("a map");
    let volume = Volume::new([n; 3], unit.samples().clone(), world).expect("a volume");
    let rows = [(-5.0, 0.0f32), (-2.0, 0.05), (-1.0, 0.6), (0.5, 0.1), (1.5, 1.2)];
    let medium = over_own_values(&rows, 0.8);
    let extinction = |h: f64| {
        let after = rows.partition_point(|r| r.0 <= h);
        match (after.checked_sub(1), rows.get(after)) {
            (None, _) => f64::from(rows[0].1),
            (Some(i), None) => f64::from(rows[i].1),
            (Some(i), Some(&(high, to))) => {
                let (low, from) = rows[i];
                f64::from(from) + (h - low) / (high - low) * f64::from(to - from)
            }
        }
    };
    let texel = [8, 8, 13];
    let geometry = around(vec![medium]);
    let mut exact = [Running::default(); LAYERS];
    for seed in 0..8 {
        let found = &texels(&volume, &geometry, &[(texel, DVec3::Z)], 1 << 13, seed)[0];
        exact.iter_mut().zip(&found.escapes).for_each(|(running, value)| running.push(*value));
    }
    let oracle = tracked(&volume, &extinction, 1.2, 0.8, texel, 1 << 16);
    for k in 0..LAYERS {
        let (a, b) = (&exact[k], &oracle[k]);
        let noise = a.standard_error().hypot(b.standard_error());
        assert!((a.mean() - b.mean()).abs() < 4.0 * noise, "layer {k}: {} {} ± {noise}", a.mean(), b.mean());
    }
    // The medium counts: without it half again as much of the light arrives.
    assert!(oracle[0].mean() < 0.7, "{}", oracle[0].mean());
}
