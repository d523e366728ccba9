//! The estimator `gather` among walls, luminaires, media and other volumes: against closed forms, and against `path`.

use crate::common::grey;
use crate::common::scenes::{BakedScene, baked, gathered, radiance_of_texel};
use crate::scene_volumes::{BALL, among, nothing, part_of_ball};
use crate::scene_walls::{box_scene, ceiling, dark, room};
use glam::DVec3;
use isolume::sampling::statistics::Running;
use isolume::scene::geometry::{Geometry, Luminaire, LuminaireShape};
use isolume::scene::medium::{Medium, Phase};
use isolume::scene::{Coupling, Table};
use isolume::transport::GatherSettings;
use isolume::volume::Volume;
use isolume::volume::field::by_name;
use std::f64::consts::PI;

const WHITE: [f32; 3] = [1.0; 3];

/// The furnace of `scene_walls`: L = 1 everywhere, so that interpolation between texels has no bias. What all texels share is
/// the noise of the cache, of 16 paths for 64: four times the variance of their own at most.
#[test]
fn a_furnace_among_white_walls_stays_uniform() {
    let walls = room(DVec3::splat(-1.3), DVec3::splat(1.3), [[0.4; 3]; 6]);
    let of =
        |i: usize| Luminaire { name: format!("l{i}"), shape: LuminaireShape::Wall(format!("w{i}")), power: [0.6; 3] };
    let geometry = Geometry::new(walls, (0..6).map(of).collect(), 1.0).expect("a furnace");
    let torus = by_name("torus:17").expect("a field").expect("a field");
    let (volume, isovalue) = (torus.sample().expect("a volume"), torus.field.default_isovalue());
    let (rho, layers) = (0.5f32, 4);
    let (scene, told) = gathered(&volume, &geometry, &[isovalue], (64, layers), &GatherSettings::default());
    let lit = scene.lit(&dark(), &grey(rho, 1.0 - rho), &[]);
    let mut sum = Running::new();
    for texel in scene.texels() {
        let found = f64::from(radiance_of_texel(&lit, texel)[1]);
        sum.push(found);
        assert!((found - 1.0).abs() < 0.2, "{texel:?}: {found}");
    }
    let left = f64::from(rho).powi(layers as i32 + 1) * scene.summary.mean_survival(layers);
    let allowed = 4.0 * 5f64.sqrt() * sum.standard_error() + left;
    assert!(sum.count() > 300 && (sum.mean() - 1.0).abs() < allowed, "{} ± {allowed}", sum.mean());
    assert!(told.lookups.lookups > 1000 && told.lookups.continued == 0, "{:?}", told.lookups);
    assert!(told.bias.texels > 100, "{:?}", told.bias);
}

/// The albedo of the stated bias.
const ALBEDO: f64 = 0.7;

/// Layer 0 of all groups has the bits of `path`. Above it the means over all texels differ by noise and by the bias that is
/// stated: in the radiance that it is stated of by as much as it says, in each layer and channel of each group by no more than three times
/// its share of what the layers above 0 bring. `lights`: the group and the factor of that radiance.
fn is_path_but_for_the_stated_bias(
    volume: &Volume,
    geometry: &Geometry,
    isovalue: f64,
    lights: (usize, f64),
    rays: u32,
) {
    let layers = 4;
    let path = baked(volume, geometry, &[isovalue], rays, layers);
    let how = GatherSettings { cache_rays: rays / 4, ..GatherSettings::default() };
    let (scene, told) = gathered(volume, geometry, &[isovalue], (rays, layers), &how);
    let bias = told.bias;
    // Of each group: differences, levels and variances of the means of the channels.
    let mut all = Vec::new();
    for group in 0..scene.textures.len() {
        // Coefficients of a layer, and its bands.
        let (step, bands) = if group == 0 { (12, 2) } else { (3, 1) };
        let (mut off, mut level, mut noise, mut n) = ([[0.0; 3]; 4], [[0.0; 3]; 4], [0.0; 4], 0.0);
        for texel in scene.texels() {
            let (Some(found), Some(expected)) = (scene.at(group, texel), path.at(group, texel)) else { continue };
            let [of_gather, of_path] = [&scene, &path].map(|scene: &BakedScene| scene.errors(group, texel));
            assert_eq!(found[..step], expected[..step], "group {group}, {texel:?}");
            assert_eq!(of_gather[..bands], of_path[..bands], "group {group}, {texel:?}");
            for k in 0..layers {
                for c in 0..3 {
                    let first = step * k + c * step / 3;
                    off[k][c] += found[first] - expected[first];
                    level[k][c] += expected[first];
                }
                // Of the cache what layer k − 1 states, by as many more as it has fewer paths.
                let cache = k.checked_sub(1).map_or(0.0, |k| of_path[bands * k].powi(2));
                let fewer = f64::from(rays) / f64::from(how.cache_rays);
                noise[k] += of_gather[bands * k].powi(2) + of_path[bands * k].powi(2) + fewer * cache;
            }
            n += 1.0;
        }
        all.push((off.map(|c| c.map(|v| v / n)), level.map(|c| c.map(|v| v / n)), noise.map(|v| v.sqrt() / n)));
    }
    let (group, factor) = lights;
    let of = |values: &[[f64; 3]; 4]| -> f64 {
        (1..layers).map(|k| ALBEDO.powi(k as i32 + 1) * factor * values[k].iter().sum::<f64>() / 3.0).sum()
    };
    let (off, later) = (of(&all[group].0), of(&all[group].1));
    let noise: f64 = (1..layers).map(|k| (ALBEDO.powi(k as i32 + 1) * factor * all[group].2[k]).powi(2)).sum();
    let allowed = 4.0 * (noise + bias.mean_stderr.powi(2)).sqrt();
    assert!(bias.texels > 100 && (off - bias.mean).abs() < allowed, "{off} ± {allowed}, {bias:?}");
    let share = 3.0 * (bias.mean.abs() + 2.0 * bias.mean_stderr) / later;
    assert!(share < 0.3, "{share}");
    for (group, (off, level, noise)) in all.iter().enumerate() {
        for (k, c) in (1..layers).flat_map(|k| (0..3).map(move |c| (k, c))) {
            // Channels that have nothing to do with each other have √3 of the noise of their mean.
            let allowed = 4.0 * 3f64.sqrt() * noise[k] + share * level[k][c];
            let (off, level) = (off[k][c], level[k][c]);
            assert!(off.abs() <= allowed, "group {group}, layer {k}, channel {c}: {level}, off {off} of {allowed}");
        }
    }
    assert!(told.lookups.lookups > 10_000 && told.lookups.continued < told.lookups.lookups / 10, "{:?}", told.lookups);
}

/// The bump box under its lamp, without and with a fog that dims each channel otherwise.
#[test]
fn gather_is_path_among_coloured_walls() {
    let (volume, geometry) = box_scene(ceiling());
    let factor = f64::from(geometry.exponents(&volume)[0]).exp2();
    is_path_but_for_the_stated_bias(&volume, &geometry, 47.0, (2, factor), 128);
    let table = |row: [f32; 3]| Table::new(vec![(0.0, row)]).expect("a table");
    let grey = Medium::constant("fog", 1.0, 0.5, Phase::HenyeyGreenstein(0.5)).expect("a medium");
    let fog = Medium { extinction: table([0.5, 1.0, 2.0]), albedo: table([0.9, 0.8, 0.5]), ..grey };
    let geometry = geometry.with_media(vec![fog]).expect("fog");
    is_path_but_for_the_stated_bias(&volume, &geometry, 47.0, (2, factor), 128);
}

/// Half a hollow ball beside the other half. Paths go on from the other volume.
#[test]
fn gather_is_path_beside_another_volume() {
    let (left, right) = (part_of_ball("left", 0, 13), part_of_ball("right", 12, BALL));
    let geometry = among(&left, &[&right], &Coupling::Normalised, WHITE, nothing());
    is_path_but_for_the_stated_bias(&left, &geometry, 0.1, (0, (4.0 * PI).sqrt()), 256);
}

/// The same bytes for one thread and for two, with a middle pass that reads the cache.
#[test]
fn threads_do_not_matter_to_a_gather() {
    let settings = GatherSettings { passes: 3, cache_rays: 4, bias_texels: 32, ..GatherSettings::default() };
    let by = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let (volume, geometry) = box_scene(ceiling());
            let (scene, told) = gathered(&volume, &geometry, &[100.0], (4, 3), &settings);
            (scene.bits(), told)
        })
    };
    let (one, two) = (by(1), by(2));
    assert!(one == two && one.1.bias.texels > 10, "{:?}", one.1);
}
