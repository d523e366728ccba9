//! Scenes: a volume among walls, luminaires and other volumes, baked into memory, and the squares whose form factors are
//! known.

use glam::DVec3;
use isolume::geom::Bounds;
use isolume::level::Pyramid;
use isolume::relight::{Contracted, Light, LookupReport, LuminaireLight, Material, Textures, contract};
use isolume::scene::geometry::Geometry;
use isolume::transfer::texels_of_isosurface;
use isolume::transfer::{BRICK, BrickSource, Lattice, Layers, Layout, MemoryTexture, Selection, validity};
use isolume::transport::{Bake, GatherSettings, Gathered, Progress, Settings, Sink, Summary, bake, gather};
use isolume::volume::Volume;
use isolume::volume::field::Field;
use std::f64::consts::PI;

/// A volume lit in a scene: its textures in memory, in the order environment, emission, luminaires.
pub struct BakedScene {
    pub volume: Volume,
    pub textures: Vec<MemoryTexture>,
    pub exponents: Vec<i32>,
    pub selection: Selection,
    pub summary: Summary,
}

/// Bakes the texels of some isosurfaces of a volume among what stands around it, two bands to a layer.
pub fn baked(volume: &Volume, geometry: &Geometry, isovalues: &[f64], rays: u32, layers: usize) -> BakedScene {
    let (scene, _) = filled(volume, geometry, isovalues, (rays, layers), |request, chunks, sink| {
        (bake(request, chunks, &Progress::default(), &|_| Ok(None), sink).expect("a bake"), ())
    });
    scene
}

/// The same by the estimator `gather`.
pub fn gathered(
    volume: &Volume,
    geometry: &Geometry,
    isovalues: &[f64],
    (rays, layers): (u32, usize),
    settings: &GatherSettings,
) -> (BakedScene, Gathered) {
    filled(volume, geometry, isovalues, (rays, layers), |request, chunks, sink| {
        let gathered = gather(request, settings, chunks, &Progress::default(), &|_| Ok(None), sink).expect("a gather");
        (gathered.summary.clone(), gathered)
    })
}

fn filled<R>(
    volume: &Volume,
    geometry: &Geometry,
    isovalues: &[f64],
    (rays, layers): (u32, usize),
    fill: impl Fn(&Bake<'_>, &[[usize; 3]], &mut Sink<'_>) -> (Summary, R),
) -> (BakedScene, R) {
    let layers = Layers::uniform(layers, 2).expect("layers").coloured();
    let layout =
        Layout { lattice: Lattice::from_ratio(volume.dims(), 1.0).expect("a lattice"), layers: layers.clone() };
    let settings = Settings { layers, rays, seed: 5, target: None, positive: false };
    let mut selection = Selection::empty(layout.lattice);
    isovalues.iter().for_each(|&c| selection.insert_all(&texels_of_isosurface(volume, layout.lattice, c)));
    let pyramid = Pyramid::new(volume);
    let (layout, settings, selection) = (&layout, &settings, &selection);
    let request = Bake::new(volume, &pyramid, layout, settings, selection).among(Some(geometry));
    let mut textures: Vec<MemoryTexture> =
        request.groups().iter().map(|g| MemoryTexture::new(g.layout(layout).expect("a layout"))).collect();
    let [cx, cy, cz] = layout.lattice.chunks();
    let chunks: Vec<[usize; 3]> = (0..cx * cy * cz).map(|i| [i % cx, i / cx % cy, i / cx / cy]).collect();
    let (summary, more) = fill(&request, &chunks, &mut |chunk, groups| {
        textures.iter_mut().zip(groups).try_for_each(|(texture, bricks)| texture.insert_chunk(chunk, bricks))
    });
    let exponents = geometry.exponents(volume);
    (BakedScene { volume: volume.clone(), textures, exponents, selection: selection.clone(), summary }, more)
}

impl BakedScene {
    /// Everything but the validity of what was not asked, as bits: NaN marks what is not baked.
    pub fn bits(&self) -> Vec<u16> {
        let bricks = || self.selection.bricks().into_iter();
        let all = self.textures.iter().flat_map(|t| bricks().map(move |b| (t, b)));
        all.flat_map(|(texture, index)| {
            let view = texture.brick(index).expect("a brick").expect("baked");
            view.transfer.iter().chain(view.stderr).map(|v| v.to_bits()).collect::<Vec<_>>()
        })
        .collect()
    }

    /// The texels of the isosurfaces, in order.
    pub fn texels(&self) -> impl Iterator<Item = [usize; 3]> {
        let [nx, ny, nz] = self.volume.dims();
        (0..nx * ny * nz).map(move |i| [i % nx, i / nx % ny, i / nx / ny]).filter(|t| self.selection.contains(*t))
    }

    /// The coefficients of a texel in a group; `None` where it is not valid.
    pub fn at(&self, group: usize, texel: [usize; 3]) -> Option<Vec<f64>> {
        let texture = &self.textures[group];
        let view = texture.brick(texel.map(|i| i / BRICK)).expect("a brick")?;
        let [x, y, z] = texel.map(|i| i % BRICK);
        let t = x + BRICK * (y + BRICK * z);
        let n = texture.layout().layers.coefficients();
        let valid = view.validity[t] & validity::VALID != 0;
        valid.then(|| view.transfer[t * n..(t + 1) * n].iter().map(|v| f64::from(v.to_f32())).collect())
    }

    /// The standard error of the first layer of a texel in a group of one band.
    pub fn error(&self, group: usize, texel: [usize; 3]) -> f64 {
        self.errors(group, texel)[0]
    }

    /// The standard errors of a texel, of each layer and band.
    pub fn errors(&self, group: usize, texel: [usize; 3]) -> Vec<f64> {
        let texture = &self.textures[group];
        let view = texture.brick(texel.map(|i| i / BRICK)).expect("a brick").expect("baked");
        let [x, y, z] = texel.map(|i| i % BRICK);
        let (t, n) = (x + BRICK * (y + BRICK * z), texture.layout().layers.errors());
        view.stderr[t * n..(t + 1) * n].iter().map(|v| f64::from(v.to_f32())).collect()
    }

    /// The scene in the light of an environment, and of its luminaires times `factors`, 1 for those that have none.
    pub fn lit(&self, light: &Light, material: &Material, factors: &[f64]) -> Contracted {
        let luminaires: Vec<LuminaireLight<'_>> = self.textures[2..]
            .iter()
            .zip(&self.exponents)
            .enumerate()
            .map(|(l, (texture, &e))| LuminaireLight {
                texture,
                factor: [factors.get(l).copied().unwrap_or(1.0) * f64::from(e).exp2(); 3],
            })
            .collect();
        let bricks = self.selection.bricks();
        let textures = Textures::of_scene(&self.textures[0], &self.textures[1], &luminaires).expect("textures");
        contract(&textures, &bricks, light, material).expect("in memory")
    }
}

/// Radiance of a texel that neither reflects nor shines by itself: what was contracted.
pub fn radiance_of_texel(contracted: &Contracted, texel: [usize; 3]) -> [f32; 3] {
    let black = Material::new([0.0; 3], [0.0; 3]).expect("black");
    let dark = Light::constant([0.0; 3]);
    contracted.radiance_at(texel.map(|i| i as f32), [0.0, 0.0, 1.0], &dark, &black, &mut LookupReport::default())
}

/// ±(z − z₀) on the unit square around z₀: the level set 0 is the square, lit from above where the sign is −, else from
/// below.
pub struct Square {
    pub z: f64,
    pub sign: f64,
}

impl Field for Square {
    fn name(&self) -> &'static str {
        "square"
    }

    fn value(&self, p: DVec3) -> f64 {
        self.sign * (p.z - self.z)
    }

    fn bounds(&self) -> Bounds {
        Bounds { min: DVec3::new(0.0, 0.0, self.z - 0.25), max: DVec3::new(1.0, 1.0, self.z + 0.25) }
    }

    fn default_isovalue(&self) -> f64 {
        0.0
    }
}

/// Form factor of a point with normal z to a rectangle [0, a] × [0, b] at height 1 above its corner.
pub fn corner_factor(a: f64, b: f64) -> f64 {
    let (x, y) = (a / (1.0 + a * a).sqrt(), b / (1.0 + b * b).sqrt());
    (x * (b / (1.0 + a * a).sqrt()).atan() + y * (a / (1.0 + b * b).sqrt()).atan()) / (2.0 * PI)
}
