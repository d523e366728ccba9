//! What splitting the sun off gains: RMS error of relit radiance against a path reference.
//!
//! `cargo run --release --example measure-sun -- [VERTICES] [RAYS] [SIZE]` (1500, 512, 48)
//!
//! The reference traces paths on the level set from a fixed sample of mesh vertices: at every vertex
//! of a path one ray towards the picture of the environment, drawn in proportion to its brightness. The
//! same transfer (5 bands, 256 rays) is relit without and with the split. *direct*: one layer;
//! *all*: four layers and their tail at albedo 0.7 against 12 bounces. CSV, errors in percent of the
//! reference's mean.

use glam::Vec3;
use isolume::geom::{Frame, Normal};
use isolume::level::{Counts, LevelField, Outcome, Pyramid, Start};
use isolume::probe::{self, LatLong, Orientation, Probe, SunOptions, split_sun};
use isolume::relight::{Light, Material, Textures, TriangleIndex, TriangleOrder, contract, prepare};
use isolume::render::{SunLight, SunLit, Surroundings, sun_visibility};
use isolume::sampling::{DirectionalSource, PathSampler, warp};
use isolume::sh::Window;
use isolume::surface::{Mesh, extract_with_normals};
use isolume::transfer::texels_of_isosurface;
use isolume::transfer::{Lattice, Layers, Layout, MemoryTexture, Selection};
use isolume::transport::{Bake, Progress, Settings, bake};
use isolume::volume::{SamplesView, Volume, field};
use rayon::prelude::*;

const ALBEDO: f32 = 0.7;
const BOUNCES: u32 = 12;
/// Rays of the split sun for each vertex.
const SUN_RAYS: u32 = 64;

struct Scene {
    volume: Volume,
    pyramid: Pyramid,
    isovalue: f64,
    selection: Selection,
    direct: MemoryTexture,
    all: MemoryTexture,
    // All of it, and some of its vertices.
    whole: Mesh,
    mesh: Mesh,
}

fn level_field<'a>(volume: &'a Volume, pyramid: &'a Pyramid) -> LevelField<'a, f32> {
    match volume.samples().view() {
        SamplesView::F32(samples) => LevelField::new(volume, samples, pyramid),
        _ => unreachable!("analytic fields are f32"),
    }
}

fn baked(volume: &Volume, pyramid: &Pyramid, selection: &Selection, layers: Layers) -> isolume::Result<MemoryTexture> {
    let settings = Settings { layers, rays: 256, seed: 1, positive: false, target: None };
    let layout = Layout { lattice: *selection.lattice(), layers: settings.layers.clone() };
    let mut texture = MemoryTexture::new(layout.clone());
    let job = Bake::new(volume, pyramid, &layout, &settings, selection);
    bake(&job, &job.chunks(), &Progress::default(), &|_| Ok(None), &mut |chunk, mut groups| {
        for (b, brick) in groups.swap_remove(0).into_iter().enumerate() {
            let inner = [b % 4, b / 4 % 4, b / 16];
            let index: [usize; 3] = std::array::from_fn(|a| chunk[a] * 4 + inner[a]);
            if let Some(brick) = brick.filter(|_| (0..3).all(|a| index[a] < layout.lattice.bricks()[a])) {
                texture.insert(index, brick)?;
            }
        }
        Ok(())
    })?;
    Ok(texture)
}

impl Scene {
    /// A field, baked, with about `vertices` vertices of its mesh.
    fn new(spec: &str, vertices: usize) -> isolume::Result<Self> {
        let Some(named) = field::by_name(spec)? else { unreachable!("a built-in field") };
        let isovalue = named.field.default_isovalue();
        let volume = named.sample()?;
        let pyramid = Pyramid::new(&volume);
        let selection = texels_of_isosurface(&volume, Lattice::from_ratio(volume.dims(), 1.0)?, isovalue);
        let direct = baked(&volume, &pyramid, &selection, Layers::uniform(1, 5)?)?;
        let all = baked(&volume, &pyramid, &selection, Layers::uniform(4, 5)?)?;
        let normal_at = |p: [f32; 3]| {
            let field = level_field(&volume, &pyramid);
            field.normal(&field.locate(p.map(f64::from))).map_or([0.0; 3], |n| n.vec().to_array())
        };
        let mut mesh = extract_with_normals(&volume, isovalue, &normal_at)?;
        let whole = mesh.clone();
        let stride = (mesh.positions_in_grid.len() / vertices.max(1)).max(1);
        mesh.positions_in_grid = mesh.positions_in_grid.into_iter().step_by(stride).collect();
        mesh.normals = mesh.normals.into_iter().step_by(stride).collect();
        mesh.triangles.clear();
        Ok(Self { volume, pyramid, isovalue, selection, direct, all, whole, mesh })
    }

    fn relit(&self, texture: &MemoryTexture, light: &Light, suns: &[SunLight]) -> isolume::Result<Vec<f64>> {
        let material = Material::new([ALBEDO; 3], [0.0; 3])?;
        let contracted = contract(&Textures::of_volume(texture)?, &self.selection.bricks(), light, &material)?;
        let mut lit = contracted.look_up(&self.mesh.positions_in_grid, &self.mesh.normals, light, &material);
        for sun in suns {
            let (positions, normals) = (&self.mesh.positions_in_grid, &self.mesh.normals);
            let visible = sun_visibility(&self.volume, &self.pyramid, self.isovalue, positions, normals, sun);
            lit.add_sun(&visible.lit, sun.flux, &material);
        }
        if isolume::transfer::BrickSource::layout(texture).layers.len() > 1 && !suns.is_empty() {
            let (volume, pyramid, isovalue) = (&self.volume, &self.pyramid, self.isovalue);
            let order = TriangleOrder::new(&self.whole);
            let triangles = &TriangleIndex::new(&self.whole, &order);
            let surface = Surroundings { volume, pyramid, isovalue, triangles };
            let of_suns = SunLit::new(surface, suns, &material, true);
            let (positions, normals) = (&self.mesh.positions_in_grid, &self.mesh.normals);
            lit.add(&of_suns.reflected(positions, normals, contracted.noise.mean_radiance)?.radiance)?;
        }
        Ok(lit.radiance.iter().map(|v| f64::from(v[1])).collect())
    }

    /// Direct and full radiance (green) at each vertex.
    fn reference(&self, source: &dyn DirectionalSource, rays: u32) -> Vec<[f64; 2]> {
        let field = level_field(&self.volume, &self.pyramid);
        let raw = self.volume.raw_from_value(self.isovalue) as f32;
        (0..self.mesh.positions_in_grid.len())
            .into_par_iter()
            .map(|v| {
                let at = field.locate(self.mesh.positions_in_grid[v].map(f64::from));
                let Some(normal) = Normal::down_gradient(-Vec3::from_array(self.mesh.normals[v])) else {
                    return [0.0; 2];
                };
                let sampler = PathSampler::new(3, v as u64, 0);
                let mut sums = [0.0f64; 2];
                for path in 0..rays {
                    let [direct, all] = one_path(&field, raw, Start::on(at), normal, &sampler, path, source);
                    sums[0] += direct;
                    sums[1] += all;
                }
                sums.map(|s| s / f64::from(rays))
            })
            .collect()
    }
}

/// Direct and full radiance along one path.
fn one_path(
    field: &LevelField<'_, f32>,
    raw: f32,
    mut start: Start,
    mut normal: Normal,
    sampler: &PathSampler,
    path: u32,
    source: &dyn DirectionalSource,
) -> [f64; 2] {
    let mut counts = Counts::default();
    let (mut direct, mut sum, mut power) = (0.0, 0.0, 1.0);
    for bounce in 0..=BOUNCES {
        power *= f64::from(ALBEDO);
        if let Some(sample) = source.sample(sampler.pair(path, 2 * bounce)) {
            let towards = sample.direction.vec();
            let cosine = towards.dot(normal.vec());
            if cosine > 0.0
                && field.trace(raw, &start, field.direction_in_grid(towards), &mut counts) == Outcome::Escaped
            {
                sum += power * f64::from(sample.radiance[1] * cosine / sample.density) / std::f64::consts::PI;
            }
        }
        if bounce == 0 {
            direct = sum;
        }
        let local = warp::square_to_cosine_hemisphere(sampler.pair(path, 2 * bounce + 1));
        let along = field.direction_in_grid(Frame::around(normal).from_local(local));
        let Outcome::Hit(hit) = field.trace(raw, &start, along, &mut counts) else { break };
        let Some(next) = field.normal(&hit.at) else { break };
        (start, normal) = (Start::on(hit.at), next);
    }
    [direct, sum]
}

/// A sun over an overcast sky, as a picture; `strength` 0 leaves the sky out and the sun alone.
fn sky(elevation: f64, degrees: f64, strength: f32) -> isolume::Result<Probe> {
    let Some(sun) = probe::by_name(&format!("sun:20,{elevation},{degrees}"))? else { unreachable!("a sky") };
    let Some(behind) = probe::by_name("overcast")? else { unreachable!("a sky") };
    if strength == 0.0 {
        return Ok(sun);
    }
    let (w, h) = (sun.image.width(), sun.image.height());
    let pixels = (0..w * h).map(|i| {
        let towards = sun.image.direction_from_pixel((i % w) as f64 + 0.5, (i / w) as f64 + 0.5);
        std::array::from_fn(|c| behind.image.radiance(towards)[c] + strength * sun.image.pixels()[i][c])
    });
    Ok(Probe::from_image("sun over overcast", LatLong::new(w, h, pixels.collect())?))
}

fn percent(values: &[f64], reference: impl Iterator<Item = f64>) -> f64 {
    let (mut mean, mut square) = (0.0, 0.0);
    for (v, r) in values.iter().zip(reference) {
        mean += r;
        square += (v - r) * (v - r);
    }
    let n = values.len() as f64;
    if mean > 0.0 { 100.0 * (square / n).sqrt() / (mean / n) } else { 0.0 }
}

fn row(scene: &Scene, name: &str, probe: &Probe, rays: u32) -> isolume::Result<()> {
    let orientation = Orientation::new(scene.volume.up, 0.0)?;
    let reference = scene.reference(&probe.source(orientation), rays);
    let split = split_sun(probe, &SunOptions { most: 4, ..SunOptions::default() });
    let whole = probe.coefficients_in_world(5, orientation);
    let rest = split.rest.coefficients_in_world(5, orientation);
    let layers = Layers::uniform(4, 5)?;
    let plain = prepare(&whole, &layers, Window::None)?.light;
    let apart = prepare(&rest, &layers, Window::None)?.light;
    let certified = prepare(&rest, &layers, Window::Certified)?.light;
    let suns: Vec<SunLight> = split.suns.iter().map(|s| SunLight::new(&s.sun, orientation, SUN_RAYS)).collect();
    let error = |texture, light, suns: &[SunLight], column: usize| {
        Ok::<f64, isolume::Error>(percent(&scene.relit(texture, light, suns)?, reference.iter().map(|r| r[column])))
    };
    let columns = [
        error(&scene.direct, &plain, &[], 0)?,
        error(&scene.direct, &apart, &suns, 0)?,
        error(&scene.all, &plain, &[], 1)?,
        error(&scene.all, &apart, &suns, 1)?,
        error(&scene.all, &certified, &suns, 1)?,
    ];
    let share = split.suns.iter().fold(0.0, |sum, s| sum + 100.0 * s.flux_share);
    let numbers: Vec<String> = columns.iter().map(|v| format!("{v:.2}")).collect();
    println!("{},{name},{},{share:.0},{}", scene.volume.name, suns.len(), numbers.join(","));
    Ok(())
}

fn main() -> isolume::Result<()> {
    let args: Vec<usize> = std::env::args().skip(1).filter_map(|s| s.parse().ok()).collect();
    let number = |i: usize, default: usize| args.get(i).copied().unwrap_or(default);
    let (vertices, rays, size) = (number(0, 1500), number(1, 512) as u32, number(2, 48));
    println!("volume,sky,suns,sun_flux_percent,direct_plain,direct_split,all_plain,all_split,all_split_certified");
    for name in ["sphere-over-plane", "bumpbox"] {
        let scene = Scene::new(&format!("{name}:{size}"), vertices)?;
        for degrees in [0.53, 2.0, 8.0] {
            for elevation in [10.0, 30.0, 60.0, 90.0] {
                for strength in [0.0, 3.0] {
                    let behind = if strength > 0.0 { " over overcast" } else { "" };
                    let label = format!("sun {degrees}° at {elevation}°{behind}");
                    row(&scene, &label, &sky(elevation, degrees, strength)?, rays)?;
                }
            }
        }
        for name in probe::EMBEDDED {
            if let Some(probe) = probe::by_name(name)? {
                row(&scene, name, &probe, rays)?;
            }
        }
    }
    Ok(())
}
