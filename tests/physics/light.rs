//! Certified light and split suns on baked surfaces.

use glam::{DVec3, Vec3};
use isolume::geom::Up;
use isolume::level::{Counts, LevelField, Outcome, Pyramid, Start};
use isolume::probe::{self, Orientation, Probe, SunOptions, split_sun};
use isolume::relight::{Light, Material, Textures, contract, prepare};
use isolume::render::{Camera, Projection, RenderOptions, Subject, SunLight, View, render, sun_visibility};
use isolume::sampling::{DirectionalSource, PathSampler};
use isolume::sh::{Window, basis};
use isolume::surface::{Mesh, extract_with_normals};
use isolume::transfer::texels_of_isosurface;
use isolume::transfer::{BRICK, BRICK_TEXELS, BrickSource, Lattice, Layers, Layout, MemoryTexture, Selection};
use isolume::transport::{Bake, PathEnd, Progress, Settings, bake, replay};
use isolume::volume::{Samples, Volume, field};

/// A volume baked for one isovalue.
struct Scene {
    volume: Volume,
    pyramid: Pyramid,
    isovalue: f64,
    settings: Settings,
    selection: Selection,
    texture: MemoryTexture,
    mesh: Mesh,
}

fn level_field<'a>(volume: &'a Volume, pyramid: &'a Pyramid) -> LevelField<'a, f32> {
    let Samples::F32(samples) = volume.samples() else { panic!("analytic fields are f32") };
    LevelField::new(volume, samples, pyramid)
}

impl Scene {
    fn new(spec: &str, isovalue: f64, layers: Layers, rays: u32, positive: bool) -> Self {
        let volume = field::by_name(spec).unwrap().unwrap().sample().unwrap();
        let pyramid = Pyramid::new(&volume);
        let settings = Settings { layers, rays, seed: 1, positive, target: None };
        let lattice = Lattice::from_ratio(volume.dims(), 1.0).unwrap();
        let layout = Layout { lattice, layers: settings.layers.clone() };
        let selection = texels_of_isosurface(&volume, lattice, isovalue);
        let mut texture = MemoryTexture::new(layout.clone());
        let job = Bake::new(&volume, &pyramid, &layout, &settings, &selection);
        let bricks_along = lattice.bricks();
        bake(&job, &job.chunks(), &Progress::default(), &|_| Ok(None), &mut |chunk, mut groups| {
            for (b, brick) in groups.swap_remove(0).into_iter().enumerate() {
                let index: [usize; 3] = [b % 4, b / 4 % 4, b / 16];
                let index: [usize; 3] = std::array::from_fn(|a| chunk[a] * 4 + index[a]);
                if let Some(brick) = brick.filter(|_| (0..3).all(|a| index[a] < bricks_along[a])) {
                    texture.insert(index, brick)?;
                }
            }
            Ok(())
        })
        .unwrap();
        let normal_at = |p: [f32; 3]| {
            let field = level_field(&volume, &pyramid);
            field.normal(&field.locate(p.map(f64::from))).map_or([0.0; 3], |n| n.vec().to_array())
        };
        let mesh = extract_with_normals(&volume, isovalue, &normal_at).unwrap();
        Self { volume, pyramid, isovalue, settings, selection, texture, mesh }
    }

    fn layers(&self) -> &Layers {
        &self.texture.layout().layers
    }

    /// Relit direct and reflected radiance (green) of the vertices.
    fn relit(&self, light: &Light, material: &Material) -> isolume::relight::VertexRadiance {
        let contracted =
            contract(&Textures::of_volume(&self.texture).unwrap(), &self.selection.bricks(), light, material).unwrap();
        contracted.look_up(&self.mesh.positions_in_grid, &self.mesh.normals, light, material)
    }

    /// Direct light of the whole probe at each `stride`-th vertex by level-set rays towards the pixels of its
    /// image, drawn in proportion to their brightness.
    fn direct_reference(&self, source: &dyn DirectionalSource, albedo: f32, rays: u32, stride: usize) -> Vec<f64> {
        let field = level_field(&self.volume, &self.pyramid);
        let raw = self.volume.raw_from_value(self.isovalue) as f32;
        let mut counts = Counts::default();
        let mut result = Vec::new();
        for v in (0..self.mesh.positions_in_grid.len()).step_by(stride) {
            let start = Start::on(field.locate(self.mesh.positions_in_grid[v].map(f64::from)));
            let normal = Vec3::from_array(self.mesh.normals[v]);
            let sequence = PathSampler::new(7, v as u64, 0).sequence(0);
            let mut sum = 0.0;
            for ray in 0..rays {
                let Some(sample) = source.sample(sequence.point(ray)) else { continue };
                let direction = sample.direction.vec();
                let cosine = direction.dot(normal);
                if cosine > 0.0 {
                    let outcome = field.trace(raw, &start, field.direction_in_grid(direction), &mut counts);
                    if outcome == Outcome::Escaped {
                        sum += f64::from(sample.radiance[1] / sample.density * cosine);
                    }
                }
            }
            result.push(f64::from(albedo) / std::f64::consts::PI * sum / f64::from(rays));
        }
        result
    }
}

fn orientation(volume: &Volume) -> Orientation {
    Orientation::new(volume.up, 0.0).unwrap()
}

/// A sun over a sky, as a picture.
fn sun_and_sky(azimuth: f64, elevation: f64, degrees: f64, strength: f32) -> Probe {
    let open = |spec: String| probe::by_name(&spec).unwrap().unwrap().image;
    let (sun, sky) = (open(format!("sun:{azimuth},{elevation},{degrees}")), open("overcast".into()));
    let (w, h) = (sun.width(), sun.height());
    let pixels = (0..w * h).map(|i| {
        let behind = sky.radiance(sun.direction_from_pixel((i % w) as f64 + 0.5, (i / w) as f64 + 0.5));
        std::array::from_fn(|c| behind[c] + strength * sun.pixels()[i][c])
    });
    Probe::from_image("sun and sky", probe::LatLong::new(w, h, pixels.collect()).unwrap())
}

fn relative_rms(values: impl Iterator<Item = f64>, reference: &[f64]) -> f64 {
    let mean = reference.iter().sum::<f64>() / reference.len() as f64;
    let square: f64 = values.zip(reference).map(|(v, r)| (v - r) * (v - r)).sum();
    (square / reference.len() as f64).sqrt() / mean
}

/// The task's promise, small: the full table is `probes/measure/sun.rs`.
#[test]
fn splitting_the_sun_halves_the_error_of_direct_light() {
    for (spec, isovalue) in [("sphere-over-plane:32", 0.0), ("bumpbox:32", 30.0)] {
        let scene = Scene::new(spec, isovalue, Layers::uniform(1, 5).unwrap(), 64, false);
        let orientation = orientation(&scene.volume);
        let material = Material::new([0.5; 3], [0.0; 3]).unwrap();
        for (elevation, degrees, strength) in [(30.0, 0.53, 3.0), (90.0, 0.53, 3.0), (60.0, 6.0, 1.0)] {
            let probe = sun_and_sky(20.0, elevation, degrees, strength);
            let stride = 5;
            let reference = scene.direct_reference(&probe.source(orientation), 0.5, 256, stride);
            let whole = probe.coefficients_in_world(5, orientation);
            let plain = prepare(&whole, scene.layers(), Window::None).unwrap().light;
            let before = scene.relit(&plain, &material);
            let split = split_sun(&probe, &SunOptions::default());
            assert_eq!(split.suns.len(), 1, "{}", split.stopped);
            let rest = split.rest.coefficients_in_world(5, orientation);
            let light = prepare(&rest, scene.layers(), Window::None).unwrap().light;
            let mut after = scene.relit(&light, &material);
            let sun = SunLight::new(&split.suns[0].sun, orientation, 16);
            let visible = sun_visibility(
                &scene.volume,
                &scene.pyramid,
                isovalue,
                &scene.mesh.positions_in_grid,
                &scene.mesh.normals,
                &sun,
            );
            assert!(visible.counts.rays > 0 && visible.counts.rays <= 16 * 8 * visible.lit.len() as u64);
            assert!(visible.lit.iter().all(|v| (0.0..=1.0).contains(v)));
            after.add_sun(&visible.lit, sun.flux, &material);
            let picked = |r: &isolume::relight::VertexRadiance| {
                r.radiance.iter().step_by(stride).map(|v| f64::from(v[1])).collect::<Vec<_>>().into_iter()
            };
            let (before, after) = (relative_rms(picked(&before), &reference), relative_rms(picked(&after), &reference));
            println!(
                "{spec}, {elevation}°, {degrees}° across: {:.2} % before, {:.2} % after",
                100.0 * before,
                100.0 * after
            );
            assert!(after <= 0.5 * before, "{spec}, {elevation}°, {degrees}°: {before} before, {after} after");
        }
    }
}

/// The skies of the two tests below: up axes of the fields put some suns exactly on ±y.
fn hard_skies() -> Vec<Probe> {
    let mut skies: Vec<Probe> = ["sun:0,90", "sun:0,-90", "sun:0,0", "sun:180,0", "sunset", "constant"]
        .iter()
        .map(|spec| probe::by_name(spec).unwrap().unwrap())
        .collect();
    let mut pixels = vec![[0.0; 3]; 16 * 8];
    pixels[37] = [1e6, 1e3, 1.0];
    skies.push(Probe::from_image("one texel", probe::LatLong::new(16, 8, pixels).unwrap()));
    skies
}

#[test]
fn certified_light_on_a_positive_bake_of_four_rays_is_non_negative() {
    let layers = Layers::new(vec![5, 4, 3, 3]).unwrap();
    let material = Material::new([0.7; 3], [0.0; 3]).unwrap();
    for (spec, isovalue) in [("sphere-over-plane:24", 0.0), ("bumpbox:24", 30.0)] {
        let scene = Scene::new(spec, isovalue, layers.clone(), 4, true);
        let orientation = orientation(&scene.volume);
        for probe in hard_skies() {
            let channels = probe.coefficients_in_world(5, orientation);
            let prepared = prepare(&channels, &layers, Window::Certified).unwrap();
            let light = &prepared.light;
            check_single_precision(&scene, light, &probe.name);
            let mut contracted =
                contract(&Textures::of_volume(&scene.texture).unwrap(), &scene.selection.bricks(), light, &material)
                    .unwrap();
            // From the store: T_i is off by at most 2^-11 of itself (2^-25 where f16 is subnormal).
            let mut texels = 0;
            for brick in scene.selection.bricks() {
                let view = scene.texture.brick(brick).unwrap().unwrap();
                for t in 0..BRICK_TEXELS {
                    let texel: [usize; 3] = std::array::from_fn(|a| {
                        brick[a] * BRICK + [t % BRICK, t / BRICK % BRICK, t / BRICK / BRICK][a]
                    });
                    if !scene.selection.contains(texel) || view.validity[t] == 0 {
                        continue;
                    }
                    texels += 1;
                    let transfer = &view.transfer[t * layers.coefficients()..(t + 1) * layers.coefficients()];
                    let bound = f16_bound(&layers, light, transfer);
                    let at = scene.texture.layout().lattice.grid_from_texel(texel).map(|v| v as f32);
                    let rgb = contracted.radiance_at(at, [0.0, 0.0, 1.0], light, &material, &mut Default::default());
                    for c in 0..3 {
                        assert!(f64::from(rgb[c]) >= -bound[c], "{spec}, {}: {} < -{}", probe.name, rgb[c], bound[c]);
                    }
                }
            }
            assert!(texels > 500, "{spec}: {texels} texels");
            let report = contracted.clamp_negative();
            assert!(report.energy < 1e-5, "{spec}, {}: {report:?}", probe.name);
            let lit = contracted.look_up(&scene.mesh.positions_in_grid, &scene.mesh.normals, light, &material);
            assert!(lit.radiance.iter().flatten().all(|v| *v >= 0.0 && v.is_finite()), "{spec}, {}", probe.name);
        }
    }
}

/// VALIDATION 19 for albedo 0.7, the tail included (it is at most ρ/(1 − ρ) of the last layer).
fn f16_bound(layers: &Layers, light: &Light, transfer: &[half::f16]) -> [f64; 3] {
    let mut bound = [0.0; 3];
    let mut power = 0.7;
    for (k, bands) in layers.bands().iter().enumerate() {
        if k + 1 == layers.len() {
            power *= 1.0 + 0.7 / 0.3;
        }
        for (i, l) in light.coefficients(k)[..bands * bands].iter().enumerate() {
            let t = f64::from(transfer[layers.offset(k) + i].to_f32().abs());
            for c in 0..3 {
                bound[c] += power * l[c].abs() * (t / 2048.0).max(1.0 / f64::from(1 << 25));
            }
        }
        power *= 0.7;
    }
    bound
}

/// The four paths of a texel again, summed in f32 as the estimator does without control variate, against
/// the light in f32 as contraction does: nothing below 0, at all.
fn check_single_precision(scene: &Scene, light: &Light, name: &str) {
    let field = level_field(&scene.volume, &scene.pyramid);
    let lattice = scene.texture.layout().lattice;
    let [mx, my, mz] = lattice.texels();
    let layers = scene.layers();
    for item in (0..mx * my * mz).step_by(7) {
        let texel = [item % mx, item / mx % my, item / mx / my];
        let site = field.site(lattice.grid_from_texel(texel)).filter(|_| scene.selection.contains(texel));
        let Some(site) = site else { continue };
        let mut transfer = vec![0.0f32; layers.coefficients()];
        for path in replay(&field, &site, item as u64, &scene.settings) {
            if path.ended == PathEnd::Escaped {
                let k = path.vertices_in_grid.len() - 1;
                let direction = [Vec3::from_array(path.last_direction_in_world)];
                basis::accumulate(layers.bands()[k], &direction, &mut transfer[layers.offset(k)..]);
            }
        }
        for c in 0..3 {
            for k in 0..layers.len() {
                let mut sum = 0.0f32;
                for (t, l) in transfer[layers.offset(k)..].iter().zip(light.coefficients(k)) {
                    sum += 0.25 * t * l[c] as f32;
                }
                assert!(sum >= 0.0, "{name}, texel {texel:?}, layer {k}, channel {c}: {sum:e}");
            }
        }
    }
}

#[test]
fn sun_visibility_is_exact_on_a_sphere_over_a_plane() {
    let scene = Scene::new("sphere-over-plane:48", 0.0, Layers::uniform(1, 1).unwrap(), 4, true);
    let towards = DVec3::new(0.3, 0.0, 0.954).normalize();
    let sun = |degrees: f64, rays: u32| SunLight {
        direction_in_world: towards,
        angular_radius: 0.5 * degrees.to_radians(),
        flux: [1.0; 3],
        rays,
        shape: None,
    };
    let run = |sun: &SunLight| {
        let mesh = &scene.mesh;
        sun_visibility(&scene.volume, &scene.pyramid, 0.0, &mesh.positions_in_grid, &mesh.normals, sun)
    };
    let (hard, soft) = (run(&sun(0.0, 1)), run(&sun(20.0, 64)));
    let (mut tested, mut shadowed, mut penumbra) = (0, 0, 0);
    for (v, p) in scene.mesh.positions_in_grid.iter().enumerate() {
        let p = scene.volume.world_from_grid().point(DVec3::from_array(p.map(f64::from)));
        if p.z.abs() > 1e-3 {
            continue;
        }
        // On the plane: the ray to the sun passes the centre (0, 0, 1) of the sphere at this distance.
        let to_centre = DVec3::new(0.0, 0.0, 1.0) - p;
        let miss = to_centre.cross(towards).length();
        // Two voxels of 1/16 away from the edge of the shadow.
        if (miss - 0.5).abs() > 0.125 {
            tested += 1;
            shadowed += u32::from(miss < 0.5);
            let expected = if miss < 0.5 { 0.0 } else { towards.z };
            assert!((f64::from(hard.lit[v]) - expected).abs() < 2e-3, "{p}: {} for {expected}", hard.lit[v]);
        }
        penumbra += u32::from(soft.lit[v] > 0.05 && soft.lit[v] < 0.9);
    }
    assert!(tested > 500 && shadowed > 50 && penumbra > 50, "{tested} {shadowed} {penumbra}");
    assert_eq!(run(&sun(20.0, 64)), soft, "the same numbers every time");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(pool.install(|| run(&sun(20.0, 64))), soft, "for any number of threads");
    assert_eq!(scene.volume.up, Up::Z);
}

/// A position that stands in the list many times gets other rays each time: the spread of what they find is the variance.
#[test]
fn the_variance_of_the_rays_is_that_of_many_choices() {
    const CHOICES: usize = 64;
    let scene = Scene::new("sphere-over-plane:48", 0.0, Layers::uniform(1, 1).unwrap(), 4, true);
    let (mesh, towards) = (&scene.mesh, DVec3::new(0.3, 0.0, 0.954).normalize());
    for (degrees, rays) in [(20.0f64, 8), (20.0, 16), (20.0, 64), (5.0, 16)] {
        let sun = SunLight {
            direction_in_world: towards,
            angular_radius: 0.5 * degrees.to_radians(),
            flux: [1.0; 3],
            rays,
            shape: None,
        };
        let stretched = |all: &[[f32; 3]]| -> Vec<[f32; 3]> {
            all.iter().step_by(7).flat_map(|v| std::iter::repeat_n(*v, CHOICES)).collect()
        };
        let (positions, normals) = (stretched(&mesh.positions_in_grid), stretched(&mesh.normals));
        let seen = sun_visibility(&scene.volume, &scene.pyramid, 0.0, &positions, &normals, &sun);
        let (mut stated, mut found, mut points) = (0.0, 0.0, 0);
        for (lit, variance) in seen.lit.chunks(CHOICES).zip(seen.variance.chunks(CHOICES)) {
            let mean = lit.iter().map(|&v| f64::from(v)).sum::<f64>() / CHOICES as f64;
            let spread = lit.iter().map(|&v| (f64::from(v) - mean).powi(2)).sum::<f64>() / (CHOICES - 1) as f64;
            // The penumbra: elsewhere only the cosine varies over the disk, of which stratified rays know nearly all.
            if spread > 1e-6 {
                found += spread;
                stated += variance.iter().map(|&v| f64::from(v)).sum::<f64>() / CHOICES as f64;
                points += 1;
            }
        }
        let ratio = stated / found;
        println!("{degrees}°, {rays} rays: stated {ratio:.2} of the variance at {points} points");
        // A variance of 64 choices has a relative error of 0.18, their sum over the penumbra a hundredth; what is left is
        // how the edges run, which the constant knows only in the mean. With many rays a net errs less than its cells would
        // alone: what is stated is then too much.
        assert!(points > 30 && (0.7..2.5).contains(&ratio), "{degrees}°, {rays} rays: {ratio} at {points} points");
    }
}

#[test]
fn previews_show_the_shadow_of_a_split_sun() {
    let scene = Scene::new("sphere-over-plane:48", 0.0, Layers::uniform(1, 1).unwrap(), 4, true);
    let volume = &scene.volume;
    let black = Light::constant([0.0; 3]);
    let material = Material::new([0.5, 0.25, 0.0], [0.0; 3]).unwrap();
    let contracted =
        contract(&Textures::of_volume(&scene.texture).unwrap(), &scene.selection.bricks(), &black, &material).unwrap();
    let top = View::named("top", volume.up).unwrap();
    let camera = Camera::framing(&volume.world_bounds(), volume.up, top, Projection::Orthographic, 1.0);
    let options = RenderOptions { width: 64, height: 64, supersampling: 1, cap: true };
    let towards = DVec3::new(0.6, 0.0, 0.8);
    let sun = SunLight { direction_in_world: towards, angular_radius: 0.005, flux: [2.0; 3], rays: 4, shape: None };
    let (pyramid, contracted) = (&scene.pyramid, &contracted);
    let (light, material, triangles, reflected) = (&black, &material, None, None);
    let subject = Subject { volume, pyramid, isovalue: 0.0, contracted, triangles, light, material, reflected };
    let dark = render(&subject, &[], None, &camera, &options);
    let suns = [sun.clone(), sun];
    let one = render(&subject, &suns[..1], None, &camera, &options);
    let two = render(&subject, &suns, None, &camera, &options);
    assert!(dark.pixels.iter().all(|p| p[..3] == [0.0; 3]));
    // On the open plane ρ/π · flux · 0.8; in the shadow, a disk of radius 0.5 in a plane of 3 × 3, nothing.
    let open = 0.5 / std::f32::consts::PI * 2.0 * 0.8;
    let (mut lit, mut shadow) = (0, 0);
    for (p, q) in one.pixels.iter().zip(&two.pixels).filter(|(p, _)| p[3] == 1.0) {
        lit += u32::from((p[0] / open - 1.0).abs() < 0.01);
        shadow += u32::from(p[0] == 0.0);
        assert!((p[0] - 2.0 * p[1]).abs() < 1e-6 && p[2] == 0.0 && p[0] <= open / 0.8 * 1.001);
        assert!((q[0] - 2.0 * p[0]).abs() < 1e-6);
    }
    assert!(lit > 2000 && (50..600).contains(&shadow), "{lit} lit, {shadow} in shadow");
    assert!(one.counts.rays > dark.counts.rays && two.counts.rays > one.counts.rays);
}
