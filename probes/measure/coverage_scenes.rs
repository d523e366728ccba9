//! Whether error bars cover in scenes: texels of one isosurface baked with few paths and with many. Shared by the program
//! `measure-coverage` and the test `transport_coverage`.

#![allow(dead_code)] // Program and test use their own parts of this.

use super::coverage_sample::{ALBEDO, Estimate, Found};
use glam::{DMat3, DVec3};
use isolume::level::Pyramid;
use isolume::probe::{self, Orientation};
use isolume::relight::{LayerFactors, Light, LuminaireLight, Material, Textures, contract};
use isolume::scene::geometry::{Among, Geometry, Partner};
use isolume::scene::medium::{Body, Medium, Phase};
use isolume::scene::{Coupled, Coupling, IsovalueMap, SceneDescription};
use isolume::transfer::{BRICK, BrickSource, Lattice, Layers, Layout, MemoryTexture, Selection, texels_of_isosurface};
use isolume::transport::{Bake, Progress, Settings, bake};
use isolume::volume::{Volume, field};
use isolume::{Error, Result};
use std::sync::Arc;

const BANDS: usize = 5;
const LAYERS: usize = 4;

/// A volume among others, and the texels to look at.
pub struct SceneSubject {
    volume: Volume,
    pyramid: Pyramid,
    geometry: Geometry,
    layout: Layout,
    selection: Selection,
    texels: Vec<[usize; 3]>,
}

fn analytic(name: &str) -> Result<Volume> {
    let field = field::by_name(name)?.ok_or_else(|| Error::argument("volume", name, "a field", "give another"))?;
    field.sample()
}

impl SceneSubject {
    /// At most about `count` texels of isosurface 47 of the bump box: in the closed `box` of examples/scenes under its
    /// lamp; in the `room` of its glass.toml, without the glass, open to the sky and under a lamp; or in the `pair`,
    /// below the gyroid, open to the sky; in `fog`; or of translucent `wax`.
    pub fn new(name: &str, count: usize) -> Result<Self> {
        let (volume, geometry) = match name {
            "pair" => {
                let (bumps, gyroid) = (
                    analytic("bumpbox:33")?,
                    analytic("gyroid:24")?
                        .placed(DMat3::from_diagonal(DVec3::splat(0.3)), DVec3::new(0.35, 0.08, 0.35))?,
                );
                let geometry = beside(&bumps, gyroid)?;
                (bumps, geometry)
            }
            "fog" => {
                let fog = Medium::constant("fog", 2.0, 0.8, Phase::HenyeyGreenstein(0.5))?;
                (analytic("bumpbox:33")?, Geometry::new(Vec::new(), Vec::new(), 1.0)?.with_media(vec![fog])?)
            }
            "wax" => {
                let medium = Medium::constant("wax", 12.0, 0.9, Phase::Isotropic)?;
                let body = Body { medium, index: 1.3, nodes: Vec::new() };
                (analytic("bumpbox:33")?, Geometry::new(Vec::new(), Vec::new(), 1.0)?.with_body(body)?)
            }
            _ => {
                let file = if name == "box" { "box.toml" } else { "glass.toml" };
                let path = format!("{}/examples/scenes/{file}", env!("CARGO_MANIFEST_DIR"));
                let text = std::fs::read_to_string(&path).map_err(|e| Error::io(&path, "read the scene", e))?;
                let text = match (text.find("[[objects]]"), text.find("[[luminaires]]")) {
                    (Some(first), Some(end)) => format!("{}{}", &text[..first], &text[end..]),
                    _ => text,
                };
                let scene = SceneDescription::parse(&text, file)?;
                let none = |name: &str| Err(Error::argument("file", name, "no file", "none is named"));
                let geometry = scene.surroundings.assemble(
                    &scene,
                    1.0,
                    &mut |n, _| none(n),
                    &mut |n, _| none(n).map(|_| Default::default()),
                    &mut |n, _| none(n).map(|_| unreachable!("nothing is opened")),
                    &mut |_| none("medium").map(|_| unreachable!("nothing is opened")),
                )?;
                (analytic("bumpbox:33")?, geometry)
            }
        };
        let layers = Layers::uniform(LAYERS, BANDS)?.coloured();
        let layout = Layout { lattice: Lattice::from_ratio(volume.dims(), 1.0)?, layers };
        let all = texels_of_isosurface(&volume, layout.lattice, 47.0);
        let [nx, ny, nz] = layout.lattice.texels();
        let place = |i: usize| [i % nx, i / nx % ny, i / nx / ny];
        let stride = (all.len() as usize / count).max(1);
        let texels: Vec<_> = (0..nx * ny * nz).map(place).filter(|t| all.contains(*t)).step_by(stride).collect();
        let mut selection = Selection::empty(layout.lattice);
        texels.iter().for_each(|t| selection.insert(*t));
        Ok(Self { pyramid: Pyramid::new(&volume), volume, geometry, layout, selection, texels })
    }

    /// The light of a sky of [`isolume::probe`].
    pub fn light(&self, sky: &str) -> Result<Light> {
        let sky = probe::open(sky, &Default::default())?;
        Light::from_channels(&sky.coefficients_in_world(BANDS, Orientation::new(self.volume.up, 0.0)?))
    }

    /// Radiance of each texel under each light, its luminaires as strong as `power` says.
    pub fn measure(&self, rays: u32, seed: u64, lights: &[(Light, f64)]) -> Result<Vec<Found>> {
        let settings = Settings { layers: self.layout.layers.clone(), rays, seed, target: None, positive: false };
        let job = Bake::new(&self.volume, &self.pyramid, &self.layout, &settings, &self.selection)
            .among(Some(&self.geometry));
        let layouts = job.groups().iter().map(|g| g.layout(&self.layout)).collect::<Result<Vec<_>>>()?;
        let mut textures: Vec<_> = layouts.into_iter().map(MemoryTexture::new).collect();
        let [cx, cy, cz] = self.layout.lattice.chunks();
        let chunks: Vec<_> = (0..cx * cy * cz).map(|i| [i % cx, i / cx % cy, i / cx / cy]).collect();
        bake(&job, &chunks, &Progress::default(), &|_| Ok(None), &mut |chunk, groups| {
            textures.iter_mut().zip(groups).try_for_each(|(texture, bricks)| texture.insert_chunk(chunk, bricks))
        })?;
        let mut material = Material::new([ALBEDO; 3], [0.0; 3])?;
        if self.geometry.body().is_some() {
            let mut factors = [[0.0; 3]; isolume::transfer::MAX_LAYERS];
            factors[0] = [1.0; 3];
            material.layers = LayerFactors::Given(factors);
        } else if !self.geometry.media().is_empty() {
            material.layers = LayerFactors::ReflectionsInMedia;
        }
        let mut found: Vec<Found> = self.texels.iter().map(|_| Found { numbers: Vec::new(), equal: false }).collect();
        for (light, power) in lights {
            let exponents = self.geometry.exponents(&self.volume);
            let factors = exponents.iter().map(|&e| [f64::from(e).exp2() * power; 3]);
            let luminaires: Vec<_> =
                textures[2..].iter().zip(factors).map(|(texture, factor)| LuminaireLight { texture, factor }).collect();
            let all = Textures::of_scene(&textures[0], &textures[1], &luminaires)?;
            let lit = contract(&all, &self.selection.bricks(), light, &material)?;
            for (texel, found) in self.texels.iter().zip(&mut found) {
                let at = texel.map(|t| t as f32);
                let rgb = lit.radiance_at(at, [0.0, 0.0, 1.0], light, &material, &mut Default::default());
                found.numbers.push(Estimate {
                    value: rgb.iter().map(|&v| f64::from(v)).sum::<f64>() / 3.0,
                    stderr: lit.look_up_errors(&[at])[0].into(),
                    uncorrelated: self.uncorrelated(&textures[0], &luminaires, light, *texel)?,
                });
            }
        }
        Ok(found)
    }

    /// The standard error if layers, bands and luminaires were independent: the model of scenes before.
    fn uncorrelated(
        &self,
        environment: &MemoryTexture,
        luminaires: &[LuminaireLight<'_>],
        light: &Light,
        texel: [usize; 3],
    ) -> Result<f64> {
        let layers = &self.layout.layers;
        let inner = texel.map(|t| t % BRICK);
        let t = inner[0] + BRICK * (inner[1] + BRICK * inner[2]);
        let stderr = |source: &dyn BrickSource, i: usize| -> Result<f64> {
            let view = source.brick(texel.map(|t| t / BRICK))?;
            Ok(view.map_or(0.0, |v| v.stderr[t * source.layout().layers.errors() + i].to_f64()))
        };
        let mut sum = 0.0;
        for k in 0..LAYERS {
            let power = f64::from(ALBEDO).powi(k as i32 + 1);
            for l in 0..BANDS.min(light.used_bands(k)) {
                let band = &light.coefficients(k)[l * l..(l + 1) * (l + 1)];
                let energy: f64 = band.iter().map(|rgb| (rgb.iter().sum::<f64>() / 3.0).powi(2)).sum();
                sum += power * power * energy * stderr(environment, layers.error_offset(k) + l)?.powi(2);
            }
            for lamp in luminaires {
                sum += (power * lamp.factor[0] * stderr(lamp.texture, k)?).powi(2);
            }
        }
        Ok(sum.sqrt())
    }
}

/// The gyroid beside the bump box: isovalue 0.6 with 47, and with each texel its own.
fn beside(own: &Volume, other: Volume) -> Result<Geometry> {
    let coupling = Coupling::Rows(vec![vec![30.0, 0.4], vec![64.0, 0.8]]);
    let volumes: Vec<Coupled> = [own, &other].map(|v| Coupled { name: v.name.clone(), range: v.value_range() }).into();
    let isovalue: IsovalueMap = coupling.between(&volumes, 0, 1);
    let pyramid = Arc::new(Pyramid::new(&other));
    let partner =
        Partner { name: other.name.clone(), volume: Arc::new(other), pyramid, isovalue, tint: [0.3, 0.5, 1.0] };
    let among = Among { name: own.name.clone(), place: 0, coupling: coupling.describe(), tint: [1.0; 3] };
    Geometry::new(Vec::new(), Vec::new(), 1.0)?.with_partners(among, vec![partner])
}

/// How often intervals hold what the reference says, by the model of today and as if all were independent.
pub struct Covered {
    pub places: usize,
    pub covered: usize,
    pub covered_uncorrelated: usize,
    /// Mean square of the errors over the mean of the stated variances.
    pub ratio: f64,
    pub ratio_uncorrelated: f64,
}

impl Covered {
    /// Of light `which`; half of an interval is `factor` standard errors.
    pub fn of(found: &[Found], reference: &[Found], which: usize, factor: f64) -> Self {
        let (mut covered, mut square, mut stated) = ([0; 2], 0.0, [0.0; 2]);
        for (found, truth) in found.iter().zip(reference) {
            let (number, truth) = (found.numbers[which], truth.numbers[which].value);
            let error = (number.value - truth).abs();
            square += error * error;
            for (i, stderr) in [number.stderr, number.uncorrelated].into_iter().enumerate() {
                // Half a unit in the last place of the stored transfer, where nothing else is uncertain.
                covered[i] += usize::from(error <= factor * stderr + truth.abs() / 2048.0);
                stated[i] += stderr * stderr;
            }
        }
        let [ratio, ratio_uncorrelated] = stated.map(|s| square / s);
        let [covered, covered_uncorrelated] = covered;
        Self { places: found.len(), covered, covered_uncorrelated, ratio, ratio_uncorrelated }
    }
}
