//! Scenes measured: the bump box in its box against path tracing, and planned bakes against full ones.
//!
//! `cargo run --release --example measure-scenes -- box FOLDER [SIZE PATHS]` bakes examples/scenes/box.toml at 64, 256 and
//! 1024 rays, relights isovalues 10, 47, 100 and 150, path traces the same pictures, writes PNG pictures (left baked, right
//! path traced; what is not the isosurface is the path-traced scene on both sides) and prints CSV: the RMS % of Beason (2005):
//! 100 · root of the mean squared difference of RGB after the exposure of the reference, both cut to [0, 1], over
//! the pixels that show the isosurface; and over the whole picture, as he took it.

use glam::DVec3;
use isolume::export::{Image, png};
use isolume::geom::Up;
use isolume::level::{LevelField, Outcome, Pyramid, Start};
use isolume::relight::{Contracted, Exposure, Light, LookupReport, LuminaireLight, Material, Textures, contract};
use isolume::render::{Camera, Projection, View};
use isolume::scene::SceneDescription;
use isolume::scene::geometry::Geometry;
use isolume::transfer::{Lattice, Layers, Layout, MemoryTexture, Selection};
use isolume::transport::{Bake, Progress, SceneReference, Settings, bake, scene_radiance};
use isolume::volume::{Samples, Volume, field};
use std::path::Path;
use std::time::Instant;

const ISOVALUES: [f64; 4] = [10.0, 47.0, 100.0, 150.0];
const ALBEDO: f32 = 0.7;

fn main() -> isolume::Result<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize, otherwise: usize| words.get(i).and_then(|w| w.parse().ok()).unwrap_or(otherwise);
    match words.first().map(String::as_str) {
        Some("box") if words.len() > 1 => boxes(Path::new(&words[1]), number(2, 160), number(3, 1024) as u32),
        _ => {
            println!("usage: measure-scenes box FOLDER [SIZE PATHS]");
            Ok(())
        }
    }
}

fn boxes(folder: &Path, size: usize, paths: u32) -> isolume::Result<()> {
    std::fs::create_dir_all(folder).map_err(|e| isolume::Error::io(folder, "make the folder", e))?;
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/scenes/box.toml");
    let text = std::fs::read_to_string(file).expect("the example");
    let scene = SceneDescription::parse(&text, "box.toml")?;
    let volume = field::by_name(&scene.volume.value)?.expect("a field").sample()?;
    let none = |name: &str| Err(isolume::Error::argument("file", name, "no file", "none is named"));
    let geometry = scene.surroundings.assemble(
        &scene,
        1.0,
        &mut |n, _| none(n),
        &mut |n, _| none(n).map(|_| Default::default()),
        &mut |n, _| none(n).map(|_| unreachable!("nothing is opened")),
        &mut |_| none("medium").map(|_| unreachable!("nothing is opened")),
    )?;
    let pyramid = Pyramid::new(&volume);
    let camera = Camera::framing(
        &volume.world_bounds(),
        Up::NegY,
        View { azimuth: 0.0, elevation: 15.0 },
        Projection::Perspective(35.0),
        1.0,
    );
    let rays: Vec<(DVec3, DVec3)> = (0..size * size)
        .map(|i| {
            let at = |p: usize| (p as f64 + 0.5) / size as f64 * 2.0 - 1.0;
            let (origin, direction) = camera.ray(at(i % size), -at(i / size), 1.0);
            (origin, direction.normalize())
        })
        .collect();
    let mut references = Vec::new();
    for isovalue in ISOVALUES {
        let start = Instant::now();
        let settings = SceneReference {
            paths,
            albedo: [ALBEDO; 3],
            emission: [0.0; 3],
            scales: Vec::new(),
            samples_luminaires: true,
            sees_through_backs: true,
            seed: 77,
        };
        let hits: Vec<Option<[f32; 3]>> =
            rays.iter().map(|&(o, d)| level_hit(&volume, &pyramid, &geometry, isovalue, o, d)).collect();
        let on_surface: Vec<(DVec3, DVec3)> =
            rays.iter().zip(&hits).filter(|(_, h)| h.is_some()).map(|(ray, _)| *ray).collect();
        let (of_surface, counts) =
            scene_radiance(&volume, &pyramid, &geometry, isovalue, &on_surface, None, &settings)?;
        let seconds = start.elapsed().as_secs_f64();
        // The rest is only shown.
        let settings = SceneReference { paths: 64, ..settings };
        let (mut found, _) = scene_radiance(&volume, &pyramid, &geometry, isovalue, &rays, None, &settings)?;
        let mut of_surface = of_surface.into_iter();
        for (slot, _) in found.iter_mut().zip(&hits).filter(|(_, h)| h.is_some()) {
            *slot = of_surface.next().flatten();
        }
        references.push((isovalue, found, hits, seconds, counts.path_rays + counts.light_rays));
    }
    println!(
        "rays,bake_seconds,isovalue,pixels,rms_percent_surface,rms_percent_picture,reference_noise_percent,reference_seconds,reference_rays"
    );
    for rays_per_texel in [64, 256, 1024] {
        let start = Instant::now();
        let baked = baked(&volume, &pyramid, &geometry, rays_per_texel)?;
        let bake_seconds = start.elapsed().as_secs_f64();
        for (isovalue, reference, hits, seconds, reference_rays) in &references {
            let contracted = baked.contracted(&volume, *isovalue)?;
            let of_reference: Vec<[f32; 3]> =
                reference.iter().map(|r| r.map_or([0.0; 3], |r| r.mean.map(|v| v as f32))).collect();
            let material = Material::new([ALBEDO; 3], [0.0; 3])?;
            let dark = Light::constant([0.0; 3]);
            let mut report = LookupReport::default();
            let mut relit = of_reference.clone();
            for (pixel, at) in hits.iter().enumerate().filter_map(|(i, h)| Some((i, (*h)?))) {
                relit[pixel] = contracted.radiance_at(at, [0.0, -1.0, 0.0], &dark, &material, &mut report);
            }
            let on_surface: Vec<[f32; 3]> =
                of_reference.iter().zip(hits).filter(|(_, h)| h.is_some()).map(|(v, _)| *v).collect();
            let exposure = Exposure::Percentile.factor(&on_surface);
            let shown = |v: [f32; 3]| v.map(|x| f64::from(x * exposure).clamp(0.0, 1.0));
            let (mut square, mut noise) = (0.0, 0.0);
            for (i, hit) in hits.iter().enumerate() {
                if hit.is_none() {
                    continue;
                }
                let (a, b) = (shown(relit[i]), shown(of_reference[i]));
                square += (0..3).map(|c| (a[c] - b[c]).powi(2)).sum::<f64>() / 3.0;
                let stderr = reference[i].map_or([0.0; 3], |r| r.stderr);
                noise += stderr.iter().map(|e| (e * f64::from(exposure)).powi(2)).sum::<f64>() / 3.0;
            }
            let pixels = on_surface.len();
            let percent = |sum: f64, over: usize| 100.0 * (sum / over.max(1) as f64).sqrt();
            println!(
                "{rays_per_texel},{bake_seconds:.2},{isovalue},{pixels},{:.3},{:.3},{:.3},{seconds:.1},{reference_rays}",
                percent(square, pixels),
                percent(square, size * size),
                percent(noise, pixels),
            );
            if rays_per_texel == 256 {
                let path = folder.join(format!("box-{isovalue}.png"));
                write(&path, size, &[&relit, &of_reference], exposure)?;
            }
        }
    }
    Ok(())
}

/// Where a camera ray meets the isosurface before any wall, in grid space.
fn level_hit(
    volume: &Volume,
    pyramid: &Pyramid,
    geometry: &Geometry,
    isovalue: f64,
    origin: DVec3,
    direction: DVec3,
) -> Option<[f32; 3]> {
    let Samples::F32(samples) = volume.samples() else { return None };
    let field = LevelField::new(volume, samples, pyramid);
    let grid_from_world = volume.world_from_grid().inverse();
    let (o, d) = (grid_from_world.point(origin), grid_from_world.vector(direction));
    let last = DVec3::from_array(volume.dims().map(|n| (n - 1) as f64));
    let (s, t) = ((DVec3::ZERO - o) / d, (last - o) / d);
    let (near, far) = (s.min(t).max_element().max(0.0), s.max(t).min_element());
    if near >= far {
        return None;
    }
    let at = field.locate((o + near * d).to_array());
    let raw = volume.raw_from_value(isovalue) as f32;
    if field.sign() * (field.raw_value(&at) - raw) > 0.0 {
        return None;
    }
    let along = field.direction_in_grid(direction.as_vec3());
    let Outcome::Hit(hit) = field.trace(raw, &Start::beside(at), along, &mut Default::default()) else { return None };
    let in_grid = hit.at.in_grid();
    let distance = (volume.world_from_grid().point(in_grid.as_dvec3()) - origin).length();
    let before = geometry.first_front(origin, direction, distance);
    before.is_none().then(|| in_grid.to_array())
}

struct Baked {
    textures: Vec<MemoryTexture>,
    exponents: Vec<i32>,
    lattice: Lattice,
}

fn baked(volume: &Volume, pyramid: &Pyramid, geometry: &Geometry, rays: u32) -> isolume::Result<Baked> {
    let layers = Layers::uniform(4, 1)?.coloured();
    let lattice = Lattice::from_ratio(volume.dims(), 1.0)?;
    let layout = Layout { lattice, layers: layers.clone() };
    let settings = Settings { layers, rays, seed: 0, target: None, positive: false };
    let mut selection = Selection::empty(lattice);
    for isovalue in ISOVALUES {
        selection.insert_all(&isolume::transfer::texels_of_isosurface(volume, lattice, isovalue));
    }
    let (layout, selection) = (&layout, &selection);
    let request = Bake::new(volume, pyramid, layout, &settings, selection).among(Some(geometry));
    let mut textures = Vec::new();
    for group in request.groups() {
        textures.push(MemoryTexture::new(group.layout(layout)?));
    }
    let [cx, cy, cz] = lattice.chunks();
    let chunks: Vec<[usize; 3]> = (0..cx * cy * cz).map(|i| [i % cx, i / cx % cy, i / cx / cy]).collect();
    bake(&request, &chunks, &Progress::default(), &|_| Ok(None), &mut |chunk, groups| {
        textures.iter_mut().zip(groups).try_for_each(|(texture, bricks)| texture.insert_chunk(chunk, bricks))
    })?;
    Ok(Baked { exponents: geometry.exponents(volume), textures, lattice })
}

impl Baked {
    fn contracted(&self, volume: &Volume, isovalue: f64) -> isolume::Result<Contracted> {
        let luminaires: Vec<LuminaireLight<'_>> = self.textures[2..]
            .iter()
            .zip(&self.exponents)
            .map(|(texture, &e)| LuminaireLight { texture, factor: [f64::from(e).exp2(); 3] })
            .collect();
        let bricks = isolume::transfer::texels_of_isosurface(volume, self.lattice, isovalue).bricks();
        let material = Material::new([ALBEDO; 3], [0.0; 3])?;
        let dark = Light::constant([0.0; 3]);
        let textures = Textures::of_scene(&self.textures[0], &self.textures[1], &luminaires)?;
        contract(&textures, &bricks, &dark, &material)
    }
}

/// Pictures side by side.
fn write(path: &Path, size: usize, pictures: &[&Vec<[f32; 3]>], exposure: f32) -> isolume::Result<()> {
    let mut pixels = Vec::new();
    for y in 0..size {
        for picture in pictures {
            pixels.extend(picture[y * size..(y + 1) * size].iter().map(|v| {
                let [r, g, b] = v.map(|x| (x * exposure).clamp(0.0, 1.0));
                [r, g, b, 1.0]
            }));
        }
    }
    let image = Image::new(size * pictures.len(), size, pixels)?;
    let mut file = std::fs::File::create(path).expect("a file");
    png::write(&mut file, &image, &png::PngOptions::default())
}
