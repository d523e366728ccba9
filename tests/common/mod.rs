//! What test binaries share: here volumes, bakes and measures of light transport; below scenes, hard cases, the
//! oracle of rays, and the program in a folder of its own. Public API only.
#![allow(dead_code)] // Every test binary uses its own part of this.

pub mod cases;
pub mod oracle;
pub mod program;
pub mod rays;
pub mod scenes;
pub mod stability;
pub mod twins;

use glam::DVec3;
use isolume::geom::Bounds;
use isolume::level::{LevelField, Pyramid};
use isolume::relight::Material;
use isolume::sampling::hash::uniform;
use isolume::scene::geometry::Geometry;
use isolume::sh;
use isolume::transfer::{
    BRICK, BRICK_TEXELS, BrickSource, Lattice, Layers, Layout, MemoryTexture, Selection, validity,
};
use isolume::transport::{
    Bake, ChunkBricks, IsovalueChoice, Isovalues, PhotonEnergy, PhotonMap, PhotonScene, PhotonSettings, Progress,
    Settings, Summary, bake,
};
use isolume::volume::field::{Field, sample};
use isolume::volume::{Samples, Volume};
use std::f64::consts::PI;

/// sqrt(4π): from the first coefficient to the mean over the sphere times 4π; a_k = this · T_k,00.
pub const ROOT_FOUR_PI: f64 = 3.544_907_701_811_032;

/// A field made from a function on a box.
pub struct Analytic<F> {
    pub bounds: Bounds,
    pub value: F,
}

impl<F: Fn(DVec3) -> f64 + Send + Sync> Field for Analytic<F> {
    fn name(&self) -> &'static str {
        "analytic"
    }

    fn value(&self, point_in_world: DVec3) -> f64 {
        (self.value)(point_in_world)
    }

    fn bounds(&self) -> Bounds {
        self.bounds
    }

    fn default_isovalue(&self) -> f64 {
        0.0
    }
}

/// Where the light of the first luminaire goes, by photons of about one isovalue.
pub fn energy_of(volume: &Volume, geometry: &Geometry, isovalue: f64, albedo: [f32; 3], photons: u32) -> PhotonEnergy {
    let pyramid = Pyramid::new(volume);
    let scene = PhotonScene { volume, pyramid: &pyramid, geometry: Some(geometry), light: None };
    let near = Isovalues::near(volume, isovalue, 0.02).expect("a surface");
    // All photons alike.
    let isovalues = Isovalues { choice: IsovalueChoice::Uniform, ..near };
    let settings = PhotonSettings { photons, albedo, isovalues, seed: 3, ..PhotonSettings::default() };
    PhotonMap::new(&scene, &settings).expect("photons").energies()[1].clone()
}

/// Samples `value` at spacing 1: sample (i, j, k) lies at `origin` + (i, j, k).
pub fn voxels(dims: [usize; 3], origin: [f64; 3], value: impl Fn(DVec3) -> f64 + Send + Sync) -> Volume {
    let min = DVec3::from_array(origin);
    let size = DVec3::from_array(dims.map(|n| (n - 1) as f64));
    sample(&Analytic { bounds: Bounds { min, max: min + size }, value }, dims).unwrap()
}

/// The bowl with a radius of `radius` voxels at the rim: light inside, open at z = 0. The centre
/// is the grid point ([`radius`; 3]), a world unit is a voxel.
pub fn bowl(radius: usize) -> Volume {
    let n = 2 * radius + 1;
    let r = radius as f64;
    voxels([n, n, radius + 1], [-r, -r, -r], |p| p.length())
}

/// The same volume with 8-bit samples, `levels` of them to a unit of value, offset `inter`.
pub fn quantised(volume: &Volume, levels: f64, inter: f64) -> Volume {
    let count = volume.samples().len();
    let quantise = |i: usize| {
        let level = ((f64::from(volume.samples().raw(i)) - inter) * levels).round();
        assert!((0.0..=255.0).contains(&level), "level {level} does not fit 8 bits");
        level as u8
    };
    let samples = Samples::U8((0..count).map(quantise).collect());
    let mut out = Volume::new(volume.dims(), samples, *volume.world_from_grid()).unwrap();
    out.solid = volume.solid;
    out.with_scaling(1.0 / levels, inter).unwrap()
}

pub fn settings(bands: &[usize], rays: u32, seed: u64) -> Settings {
    Settings { layers: Layers::new(bands.to_vec()).unwrap(), rays, seed, positive: false, target: None }
}

/// Texels baked into memory.
pub struct Baked {
    pub texture: MemoryTexture,
    pub summary: Summary,
}

/// Bakes `texels` on a lattice of `ratio` texels to a sample.
pub fn bake_at(volume: &Volume, ratio: f64, settings: &Settings, texels: &[[usize; 3]]) -> Baked {
    let pyramid = Pyramid::new(volume);
    let lattice = Lattice::from_ratio(volume.dims(), ratio).unwrap();
    let layout = Layout { lattice, layers: settings.layers.clone() };
    let mut selection = Selection::empty(lattice);
    texels.iter().for_each(|&t| selection.insert(t));
    let job = Bake::new(volume, &pyramid, &layout, settings, &selection);
    let mut texture = MemoryTexture::new(layout.clone());
    let mut keep = |chunk: [usize; 3], mut groups: ChunkBricks| texture.insert_chunk(chunk, groups.swap_remove(0));
    let summary = bake(&job, &job.chunks(), &Progress::default(), &|_| Ok(None), &mut keep).unwrap();
    Baked { texture, summary }
}

/// Bakes `texels` on the lattice of the data.
pub fn bake_texels(volume: &Volume, settings: &Settings, texels: &[[usize; 3]]) -> Baked {
    bake_at(volume, 1.0, settings, texels)
}

impl Baked {
    fn slot(&self, texel: [usize; 3]) -> (isolume::transfer::BrickView<'_>, usize) {
        let view = self.texture.brick(texel.map(|t| t / BRICK)).unwrap().expect("a texel that was baked");
        let inner = texel.map(|t| t % BRICK);
        let t = inner[0] + BRICK * (inner[1] + BRICK * inner[2]);
        assert!(t < BRICK_TEXELS);
        (view, t)
    }

    pub fn layers(&self) -> &Layers {
        &self.texture.layout().layers
    }

    /// Layer-major coefficients of a texel.
    pub fn transfer(&self, texel: [usize; 3]) -> Vec<f64> {
        let (view, t) = self.slot(texel);
        let n = self.layers().coefficients();
        view.transfer[t * n..(t + 1) * n].iter().map(|v| v.to_f64()).collect()
    }

    /// Standard error of each layer and band.
    pub fn stderr(&self, texel: [usize; 3]) -> Vec<f64> {
        let (view, t) = self.slot(texel);
        let n = self.layers().errors();
        view.stderr[t * n..(t + 1) * n].iter().map(|v| v.to_f64()).collect()
    }

    pub fn is_valid(&self, texel: [usize; 3]) -> bool {
        let (view, t) = self.slot(texel);
        view.validity[t] & validity::VALID != 0
    }

    pub fn is_clamped(&self, texel: [usize; 3]) -> bool {
        let (view, t) = self.slot(texel);
        view.validity[t] & validity::CLAMPED != 0
    }

    /// Paths traced for a texel.
    pub fn rays(&self, texel: [usize; 3]) -> u32 {
        let (view, t) = self.slot(texel);
        view.rays[t]
    }

    /// a_k of a texel, the chance to escape after exactly k bounces.
    pub fn escape(&self, texel: [usize; 3], k: usize) -> f64 {
        ROOT_FOUR_PI * self.transfer(texel)[self.layers().offset(k)]
    }

    /// Standard error of a_k.
    pub fn escape_error(&self, texel: [usize; 3], k: usize) -> f64 {
        ROOT_FOUR_PI * self.stderr(texel)[self.layers().error_offset(k)]
    }

    /// Whether all bytes are the same, and the totals.
    pub fn same_bits(&self, other: &Self) -> bool {
        self.summary == other.summary && self.same_bits_but_counts(other)
    }

    /// Whether all bytes are the same, however much work they took.
    pub fn same_bits_but_counts(&self, other: &Self) -> bool {
        let bits = |v: &[half::f16]| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        self.bricks() == other.bricks()
            && self.bricks().into_iter().all(|b| {
                let (a, b) = (self.texture.brick(b).unwrap().unwrap(), other.texture.brick(b).unwrap().unwrap());
                bits(a.transfer) == bits(b.transfer)
                    && bits(a.stderr) == bits(b.stderr)
                    && a.validity == b.validity
                    && a.rays == b.rays
            })
    }

    /// Bricks that hold anything.
    pub fn bricks(&self) -> Vec<[usize; 3]> {
        let [bx, by, bz] = self.texture.layout().lattice.bricks();
        (0..bx * by * bz)
            .map(|i| [i % bx, i / bx % by, i / bx / by])
            .filter(|&b| self.texture.brick(b).unwrap().is_some())
            .collect()
    }
}

/// T of a convex body with normal `n`: (A_l/π) Y_lm(n).
pub fn clamped_cosine(bands: usize, n: [f64; 3]) -> Vec<f64> {
    let mut values = vec![0.0; bands * bands];
    sh::basis::evaluate(bands, n, &mut values);
    for l in 0..bands {
        for value in &mut values[l * l..(l + 1) * (l + 1)] {
            *value *= sh::CLAMPED_COSINE[l] / PI;
        }
    }
    values
}

/// A material of the same albedo and emission in every channel.
pub fn grey(albedo: f32, emission: f32) -> Material {
    Material::new([albedo; 3], [emission; 3]).unwrap()
}

/// Number `i` of a fixed stream of uniform numbers.
pub fn random(stream: u64, i: usize) -> f64 {
    f64::from(uniform(stream, i as u64, 0, 0))
}

/// `count` grid points, no two alike, at which `wanted` holds, picked from a fixed stream.
pub fn pick(dims: [usize; 3], count: usize, stream: u64, wanted: impl Fn([usize; 3]) -> bool) -> Vec<[usize; 3]> {
    let mut seen = std::collections::BTreeSet::new();
    let mut picked = Vec::new();
    let all: usize = dims.iter().product();
    for i in 0..20 * all {
        let texel: [usize; 3] =
            std::array::from_fn(|a| ((random(stream, 3 * i + a) * dims[a] as f64) as usize).min(dims[a] - 1));
        if wanted(texel) && seen.insert(texel) {
            picked.push(texel);
            if picked.len() == count {
                break;
            }
        }
    }
    assert!(picked.len() * 2 >= count.min(all), "only {} of {count} texels found", picked.len());
    picked
}

/// `count` points spread evenly over the half sphere z < 0 of radius 1 (equal areas, golden angle).
pub fn lower_half_sphere(count: usize) -> Vec<DVec3> {
    (0..count)
        .map(|i| {
            let z = -(i as f64 + 0.5) / count as f64;
            let (sine, cosine) = (i as f64 * 2.399_963_229_728_653).sin_cos();
            let r = (1.0 - z * z).sqrt();
            DVec3::new(r * cosine, r * sine, z)
        })
        .collect()
}

/// The corners of the cell that holds a grid position, with their trilinear weights.
pub fn corners(position_in_grid: DVec3, dims: [usize; 3]) -> Vec<([usize; 3], f64)> {
    let p = position_in_grid.to_array();
    let base: [usize; 3] = std::array::from_fn(|a| (p[a] as usize).min(dims[a] - 2));
    (0..8)
        .map(|c| {
            let pick = [c & 1, c >> 1 & 1, c >> 2];
            let weight = (0..3).map(|a| {
                let t = p[a] - base[a] as f64;
                if pick[a] == 1 { t } else { 1.0 - t }
            });
            (std::array::from_fn(|a| base[a] + pick[a]), weight.product())
        })
        .collect()
}

/// Runs `work` with the level field of a volume of 32-bit samples.
pub fn with_field<R>(volume: &Volume, work: impl FnOnce(&LevelField<'_, f32>) -> R) -> R {
    let Samples::F32(samples) = volume.samples() else { panic!("not 32-bit samples") };
    let pyramid = Pyramid::new(volume);
    work(&LevelField::new(volume, samples, &pyramid))
}

/// Linear index of a texel: the `item` of its random numbers.
pub fn item(lattice: &Lattice, texel: [usize; 3]) -> u64 {
    let [mx, my, _] = lattice.texels();
    (texel[0] + mx * (texel[1] + my * texel[2])) as u64
}

/// Chance that at most `hits` of `trials` succeed when each does with chance `p`.
pub fn binomial_below(hits: usize, trials: usize, p: f64) -> f64 {
    let choose = |k: usize| ln_gamma(trials + 1) - ln_gamma(k + 1) - ln_gamma(trials - k + 1);
    (0..=hits).map(|k| (choose(k) + k as f64 * p.ln() + (trials - k) as f64 * (1.0 - p).ln()).exp()).sum()
}

/// ln Γ(n) of a whole number.
fn ln_gamma(n: usize) -> f64 {
    (1..n).map(|i| (i as f64).ln()).sum()
}
