//! Closed forms for the references, and a comparison whose parts are known.

use super::*;
use crate::level::Pyramid;
use crate::probe::{self, Orientation};
use crate::sampling::hash::uniform;
use crate::surface::extract_with_normals;
use crate::transfer::{Layers, Layout, MemoryTexture, texels_of_isosurface};
use crate::transport::{
    Bake, ChunkBricks, Isovalues, PhotonLight, PhotonLightSettings, PhotonSearch, PhotonSettings, Progress,
    SceneReference, SurfacePoint, bake, direct,
};
use crate::volume::field;
use crate::volume::{Samples, Volume};

struct Scene {
    volume: Volume,
    pyramid: Pyramid,
    isovalue: f64,
    points: Vec<SurfacePoint>,
}

fn scene(spec: &str, isovalue: Option<f64>, count: usize) -> Scene {
    let named = field::by_name(spec).unwrap().unwrap();
    let isovalue = isovalue.unwrap_or(named.field.default_isovalue());
    Scene::new(named.sample().unwrap(), isovalue, count)
}

impl Scene {
    /// A surface with so many random vertices of it.
    fn new(volume: Volume, isovalue: f64, count: usize) -> Self {
        let pyramid = Pyramid::new(&volume);
        let Samples::F32(samples) = volume.samples() else { unreachable!("all of them are f32") };
        let level = crate::level::LevelField::new(&volume, samples, &pyramid);
        let normal =
            |p: [f32; 3]| level.normal(&level.locate(p.map(f64::from))).map_or([0.0; 3], |n| n.vec().to_array());
        let mesh = extract_with_normals(&volume, isovalue, &normal).unwrap();
        let all = mesh.positions_in_grid.len();
        let point = |v: usize| SurfacePoint { position_in_grid: mesh.positions_in_grid[v], normal: mesh.normals[v] };
        let points = (0..count).map(|i| point((uniform(9, i as u64, 0, 0) * all as f32) as usize)).collect();
        Self { volume, pyramid, isovalue, points }
    }

    /// Cut out of a file of the data folder, as f32; `None`, with the reason printed, where that is absent.
    fn of_file(name: &str, first: [usize; 3], size: usize, isovalue: f64, count: usize) -> Option<Self> {
        let folder = std::env::var_os("ISOLUME_DATA").map_or_else(
            || std::path::PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
            std::path::PathBuf::from,
        );
        let path = folder.join("volumes").join(name);
        if !path.exists() {
            println!("skipped: {} is absent (set ISOLUME_DATA)", path.display());
            return None;
        }
        let whole = crate::volume::open(path).unwrap();
        let place = |i: usize| [i % size, i / size % size, i / size / size];
        let sample = |i: usize| {
            let [x, y, z] = std::array::from_fn(|a| first[a] + place(i)[a]);
            whole.samples().raw(whole.index(x, y, z))
        };
        let samples = Samples::F32((0..size * size * size).map(sample).collect());
        Some(Self::new(Volume::new([size; 3], samples, *whole.world_from_grid()).unwrap(), isovalue, count))
    }

    /// Its own store under a light.
    fn question<'a>(
        &'a self,
        textures: &'a [&'a dyn BrickSource],
        baked_by: &'a Settings,
        light: &'a dyn DirectionalSource,
        coefficients: &'a [Coefficients; 3],
        texel_rays: u32,
    ) -> Question<'a> {
        let surface = LitSurface {
            volume: &self.volume,
            pyramid: &self.pyramid,
            geometry: None,
            caustics: true,
            specular: None,
            isovalue: self.isovalue,
            points: &self.points,
            light,
            coefficients,
            albedo: [0.7, 0.5, 0.3],
            emission: [0.0; 3],
            scales: &[],
            vertices: None,
        };
        Question { surface, textures, baked_by: Some(baked_by), apart: None, paths: 64, texel_rays, seed: 7 }
    }

    fn by_paths(
        &self,
        points: &[SurfacePoint],
        lights: &[&dyn DirectionalSource],
        settings: &SceneReference,
    ) -> Vec<Vec<Radiance>> {
        direct(&self.volume, &self.pyramid, None, self.isovalue, points, lights, settings).unwrap().0
    }
}

fn settings(paths: u32, albedo: f32) -> SceneReference {
    SceneReference::new(paths, [albedo; 3], 4)
}

#[test]
fn paths_outside_a_sphere_meet_the_closed_form_of_cut_and_whole_light() {
    let scene = scene("sphere:48", None, 60);
    let orientation = Orientation::new(scene.volume.up, 0.0).unwrap();
    // High and low, on all sides.
    for sun in ["sun:-60,40,8", "sun:30,40,8", "sun:120,40,8", "sun:200,-20,8"] {
        let sun = probe::by_name(sun).unwrap().unwrap();
        let coefficients = sun.coefficients_in_world(5, orientation);
        let (whole, cut) = (sun.source(orientation), BandLimited(&coefficients));
        let lights: [&dyn DirectionalSource; 2] = [&whole, &cut];
        let found = scene.by_paths(&scene.points, &lights, &settings(256, 0.5));
        // Exitant radiance of a convex body is ρ/π Σ A_l L_lm Y_lm(n). Ten bands of a sun leave out at most 0.03 of its
        // cosine lobe's peak (VALIDATION 4), which is four times ρ times the mean radiance.
        let many = sun.coefficients_in_world(10, orientation);
        for (light, exact, truncation) in [(0, &many, 0.12), (1, &coefficients, 0.0)] {
            let (mut deviations, mut variance) = (0.0, 0.0);
            for (point, found) in scene.points.iter().zip(&found[light]) {
                let n = point.normal.map(f64::from);
                let mut basis = [0.0; 100];
                sh::basis::evaluate(exact[1].bands(), n, &mut basis);
                let lobe = |i: usize| sh::CLAMPED_COSINE[(i as f64).sqrt() as usize];
                let expected: f64 = exact[1]
                    .values()
                    .iter()
                    .enumerate()
                    .map(|(i, l)| 0.5 / std::f64::consts::PI * lobe(i) * l * basis[i])
                    .sum();
                let scale = coefficients[1].values()[0] * 0.5 / 3.5449;
                // Student's t with three degrees of freedom reaches 12.9 once in a thousand and falls as its cube from
                // there: 100 once in 480,000, at 480 points and lights in all.
                let allowed = 100.0 * found.stderr[1] + truncation * scale + 1e-5 * scale;
                assert!((found.mean[1] - expected).abs() < allowed, "{point:?}: {found:?}, expected {expected}");
                deviations += (found.mean[1] - expected) / scale;
                variance += (found.stderr[1] / scale).powi(2);
            }
            let [mean, stderr] = [deviations, variance.sqrt()].map(|sum| sum / scene.points.len() as f64);
            // The cut light is found by the cosine alone: its mean over 60 points of 256 paths is known to 0.7 %.
            assert!(stderr < 0.01, "light {light}: {stderr}");
            assert!(
                mean.abs() < 4.0 * stderr + 0.2 * truncation,
                "light {light}: off by {mean} ± {stderr} in the mean"
            );
        }
    }
}

#[test]
fn paths_in_the_bowl_sum_the_bounces_of_any_albedo() {
    // B = ρ f / (1 − ρ (1 − f)) with f = 1/2 everywhere (VALIDATION 13).
    let scene = scene("bowl:64", Some(0.6), 200);
    let constant = probe::by_name("constant").unwrap().unwrap();
    let orientation = Orientation::new(scene.volume.up, 0.0).unwrap();
    let light = constant.source(orientation);
    let inner: Vec<SurfacePoint> =
        scene.points.iter().copied().filter(|p| p.position_in_grid[2] < 0.9 * 31.0).collect();
    for albedo in [0.2f32, 0.8, 0.9] {
        let found = scene.by_paths(&inner, &[&light], &settings(64, albedo));
        let n = found[0].len() as f64;
        let mean = found[0].iter().map(|r| r.mean[0]).sum::<f64>() / n;
        let error = (found[0].iter().map(|r| r.stderr[0].powi(2)).sum::<f64>()).sqrt() / n;
        let rho = f64::from(albedo);
        let expected = rho * 0.5 / (1.0 - rho * 0.5);
        // 1 % as for the bake: the bowl is cut on a grid.
        assert!((mean - expected).abs() < 0.01 * expected + 4.0 * error, "{albedo}: {mean} ± {error}, {expected}");
    }
}

/// The texture that the scene's isosurface needs.
fn bake_store(scene: &Scene, rays: u32) -> (MemoryTexture, Settings) {
    let layout = Layout {
        lattice: crate::transfer::Lattice::from_ratio(scene.volume.dims(), 1.0).unwrap(),
        layers: Layers::uniform(4, 5).unwrap(),
    };
    let settings = Settings { layers: layout.layers.clone(), rays, seed: 1, target: None, positive: false };
    let selection = texels_of_isosurface(&scene.volume, layout.lattice, scene.isovalue);
    let job = Bake::new(&scene.volume, &scene.pyramid, &layout, &settings, &selection);
    let mut texture = MemoryTexture::new(layout.clone());
    let mut keep = |chunk, mut groups: ChunkBricks| texture.insert_chunk(chunk, groups.swap_remove(0));
    bake(&job, &job.chunks(), &Progress::default(), &|_| Ok(None), &mut keep).unwrap();
    (texture, settings)
}

#[test]
fn the_rows_sum_to_the_whole_and_the_light_of_the_store_needs_no_truncation() {
    let scene = scene("bumpbox:40", None, 300);
    let (store, baked_by) = bake_store(&scene, 64);
    let textures: [&dyn BrickSource; 1] = [&store];
    let sky = probe::by_name("gradient").unwrap().unwrap();
    let coefficients = sky.coefficients_in_world(5, Orientation::new(scene.volume.up, 0.0).unwrap());
    let limited = BandLimited(&coefficients);
    let found = compare(&scene.question(&textures, &baked_by, &limited, &coefficients, 256)).unwrap();
    let row = |name: &str| found.budget.iter().find(|r| r.name == name).unwrap().mean_square;
    let sum: f64 = found.budget.iter().map(|r| r.mean_square).sum();
    assert!((sum - found.whole.relative_rms.value.powi(2)).abs() < 1e-12);
    // The whole light is the cut one here: the same paths, so not even noise between them.
    assert_eq!(row("truncation"), 0.0);
    assert_eq!(found.whole, found.band_limited);
    // Half precision rounds to 2^-12 of each coefficient in the mean square; contraction adds less.
    assert!(row("rounding").sqrt() < 1e-3 && row("rounding") > 0.0, "{found:?}");
    assert!(row("noise").sqrt() < 0.02 && found.whole.relative_rms.value < 0.03, "{:?}", found.budget);
    assert!(found.whole.bias.value.abs() < found.whole.bias.half_interval + 0.005);
}

#[test]
fn the_surface_itself_heads_the_chain_and_stands_alone() {
    let mut scene = scene("gyroid:24", None, 1);
    let mesh = crate::surface::extract(&scene.volume, scene.isovalue).unwrap();
    let cells = crate::transport::points_in_cells(&scene.volume, &scene.pyramid, &mesh, scene.isovalue, 200, 3);
    scene.points.clone_from(&cells.smoothed);
    let (store, baked_by) = bake_store(&scene, 16);
    let textures: [&dyn BrickSource; 1] = [&store];
    let sky = probe::by_name("gradient").unwrap().unwrap();
    let orientation = Orientation::new(scene.volume.up, 0.0).unwrap();
    let (coefficients, source) = (sky.coefficients_in_world(5, orientation), sky.source(orientation));
    let question = scene.question(&textures, &baked_by, &source, &coefficients, 64);
    let found = compare(&question).unwrap();
    let geometry = compare_geometry(&question, &found, &cells).unwrap();
    let names: Vec<&str> = geometry.budget.iter().map(|row| row.name).collect();
    assert_eq!(names, ["normals", "truncation", "texture", "noise", "rounding", "cross terms"]);
    let sum: f64 = geometry.budget.iter().map(|row| row.mean_square).sum();
    assert!((sum - geometry.store.relative_rms.value.powi(2)).abs() < 1e-12);
    // The rows after the first are those of the paths, over another mean.
    let truncation = (geometry.budget[1].mean_square * geometry.mean.powi(2), found.budget[0].mean_square);
    assert!((truncation.0 / (truncation.1 * found.mean.powi(2)) - 1.0).abs() < 1e-9, "{truncation:?}");
    // Other points, and things around the volume, are refused.
    let others = crate::transport::points_in_cells(&scene.volume, &scene.pyramid, &mesh, scene.isovalue, 200, 4);
    assert!(compare_geometry(&question, &found, &others).is_err());
    let nothing = crate::scene::geometry::Geometry::new(Vec::new(), Vec::new(), 1.0).unwrap();
    let among = LitSurface { geometry: Some(&nothing), ..question.surface };
    assert!(check_geometry(&among).unwrap_err().to_string().contains("volume alone"));
}

/// Under a smooth sky of which the bands of the store leave out next to nothing; what they do is measured, by the
/// same paths, and allowed for. `texture`: what interpolation between texels and 64 rays of each may add; `blur`: what
/// photons may be off beyond their noise, point by point, with direct light by rays, without, and gathered.
fn agree(name: &str, scene: &Scene, texture: f64, blur: [f64; 3]) {
    let (store, baked_by) = bake_store(scene, 64);
    let textures: [&dyn BrickSource; 1] = [&store];
    let sky = probe::by_name("gradient").unwrap().unwrap();
    let orientation = Orientation::new(scene.volume.up, 0.0).unwrap();
    let coefficients = sky.coefficients_in_world(5, orientation);
    let source = sky.source(orientation);
    let question = scene.question(&textures, &baked_by, &source, &coefficients, 64);
    let found = compare(&question).unwrap();
    let truncation = found.budget.iter().find(|r| r.name == "truncation").unwrap().mean_square.sqrt();
    let isovalues = Isovalues::near(&scene.volume, scene.isovalue, 1.0).unwrap();
    let ways = [PhotonLight::Indirect, PhotonLight::All, PhotonLight::FinalGather];
    for (light, blur) in ways.into_iter().zip(blur) {
        let asked = PhotonQuestion {
            map: PhotonSettings { photons: 1 << 18, isovalues, seed: 5, ..PhotonSettings::default() },
            reading: PhotonLightSettings {
                light,
                rays: 64,
                search: PhotonSearch::default(),
                caustics: PhotonSearch::of_caustics(),
                seed: 5,
            },
        };
        let photons = compare_photons(&question, &found, &asked).unwrap();
        println!("{name} {light:?}: store {:?}", found.whole);
        println!("{name} {light:?}: photons {:?}, noise {}, blur {}", photons.paths, photons.noise, photons.bias);
        // Intervals are 1.96 standard errors of the mean; points share photons, whose noise varies slower than that.
        let within = |d: &Distance| d.bias.value.abs() < 2.0 * d.bias.half_interval + 0.01;
        assert!(within(&found.whole) && within(&photons.store) && within(&photons.paths), "{name}: {photons:?}");
        assert!(found.whole.relative_rms_without_noise < truncation + texture, "{name}: {:?}", found.whole);
        assert!(photons.bias < blur, "{name} {light:?}: {} beyond the noise {}", photons.bias, photons.noise);
        let store = photons.store.relative_rms_without_noise;
        assert!(store < truncation + texture.hypot(blur), "{name} {light:?}: {store}");
        assert!(photons.energies.iter().all(|energy| energy.imbalance() < 1e-6));
    }
}

#[test]
fn harmonics_photons_and_paths_agree() {
    for (spec, isovalue) in [("bowl:48", Some(0.6)), ("sphere:40", None), ("bumpbox:40", None)] {
        agree(spec, &scene(spec, isovalue, 200), 0.02, [0.03; 3]);
    }
}

#[test]
fn harmonics_photons_and_paths_agree_on_a_brain() {
    // Folds of the cortex, 64 mm across.
    let Some(scene) = Scene::of_file("mni152_t1_2mm.nii.gz", [12, 40, 40], 32, 90.0, 200) else { return };
    agree("mni152", &scene, 0.03, [0.08, 0.16, 0.05]);
}
