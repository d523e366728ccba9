//! Whether error bars cover: texels and points between texels, each baked alone with few rays and with many, looked
//! up as relight does. Shared by the program `measure-coverage` and the test `physics::transport_coverage`.

#![allow(dead_code)] // Program and test use their own parts of this.

use isolume::Result;
use isolume::level::Pyramid;
use isolume::probe::{self, Orientation};
use isolume::relight::{Light, Material, Textures, contract};
use isolume::sampling::hash::uniform;
use isolume::sampling::statistics::half_interval_95;
use isolume::transfer::{BRICK, BrickSource, Lattice, Layers, Layout, MemoryTexture, Selection, validity};
use isolume::transport::{Bake, Settings, bake_brick};
use isolume::volume::Volume;
use rayon::prelude::*;
use std::collections::BTreeSet;

pub const ALBEDO: f32 = 0.7;
const BANDS: usize = 5;
const LAYERS: usize = 4;

/// A volume, and where to look.
pub struct Subject {
    pub volume: Volume,
    pyramid: Pyramid,
    lattice: Lattice,
    surface: Selection,
    layers: Layers,
}

/// A point to look at, and the texels that a lookup there reads.
#[derive(Clone)]
pub struct Place {
    position_in_grid: [f32; 3],
    selection: Selection,
    texel: [usize; 3],
}

/// One number, its standard error, and the standard error that follows from taking coefficients as uncorrelated.
#[derive(Clone, Copy, Default)]
pub struct Estimate {
    pub value: f64,
    pub stderr: f64,
    pub uncorrelated: f64,
}

/// What was found at a place: a_0 (of its first texel), then radiance (mean of the channels) under each light.
pub struct Found {
    pub numbers: Vec<Estimate>,
    /// All replicates of every texel saw the same share of the sky.
    pub equal: bool,
}

impl Subject {
    pub fn new(volume: Volume) -> Result<Self> {
        let pyramid = Pyramid::new(&volume);
        let lattice = Lattice::from_ratio(volume.dims(), 1.0)?;
        let surface = Selection::of_all_isosurfaces(lattice, &volume);
        Ok(Self { volume, pyramid, lattice, surface, layers: Layers::uniform(LAYERS, BANDS)? })
    }

    /// The light of a sky of [`isolume::probe`].
    pub fn light(&self, sky: &str) -> Result<Light> {
        let sky = probe::open(sky, &Default::default())?;
        Light::from_channels(&sky.coefficients_in_world(BANDS, Orientation::new(self.volume.up, 0.0)?))
    }

    /// The same `count` valid surface texels for the same `stream`.
    pub fn texels(&self, count: usize, stream: u64) -> Vec<Place> {
        self.picked(count, stream, |texel, _| {
            let mut selection = Selection::empty(self.lattice);
            selection.insert(texel);
            Some(Place { position_in_grid: texel.map(|t| t as f32), selection, texel })
        })
    }

    /// `count` points between eight valid surface texels.
    pub fn vertices(&self, count: usize, stream: u64) -> Vec<Place> {
        self.picked(count, stream, |texel, offset| {
            let inside = (0..3).all(|a| texel[a] + 1 < self.lattice.texels()[a]);
            let mut selection = Selection::empty(self.lattice);
            if !inside {
                return None;
            }
            selection.insert_cell(texel);
            Some(Place { position_in_grid: std::array::from_fn(|a| texel[a] as f32 + offset[a]), selection, texel })
        })
    }

    fn picked(&self, count: usize, stream: u64, place: impl Fn([usize; 3], [f32; 3]) -> Option<Place>) -> Vec<Place> {
        let m = self.lattice.texels();
        let (mut seen, mut places) = (BTreeSet::new(), Vec::new());
        let random = |i: u64, dimension: usize| uniform(stream, i, 0, dimension as u32);
        for i in 0..20 * m.iter().product::<usize>() as u64 {
            let texel: [usize; 3] = std::array::from_fn(|a| ((random(i, a) * m[a] as f32) as usize).min(m[a] - 1));
            if !self.surface.contains(texel) || !seen.insert(texel) {
                continue;
            }
            let Some(place) = place(texel, std::array::from_fn(|a| random(i, a + 3))) else { continue };
            if self.is_valid(&place) {
                places.push(place);
                if places.len() == count {
                    break;
                }
            }
        }
        places
    }

    fn settings(&self, rays: u32, seed: u64) -> Settings {
        Settings { layers: self.layers.clone(), rays, seed, positive: false, target: None }
    }

    fn is_valid(&self, place: &Place) -> bool {
        let settings = Settings { layers: Layers::uniform(1, 1).expect("legal"), ..self.settings(4, 0) };
        self.bake(place, &settings).is_some_and(|(_, _, all_valid)| all_valid)
    }

    /// The texels of a place; how many of them have equal replicates; whether all are valid.
    fn bake(&self, place: &Place, settings: &Settings) -> Option<(MemoryTexture, u64, bool)> {
        let layout = Layout { lattice: self.lattice, layers: settings.layers.clone() };
        let (volume, pyramid, selection) = (&self.volume, &self.pyramid, &place.selection);
        let job = Bake::new(volume, pyramid, &layout, settings, selection);
        let mut texture = MemoryTexture::new(layout.clone());
        let (mut equal, mut valid, mut texels) = (0, 0, 0);
        for index in selection.bricks() {
            let mut output = bake_brick(&job, index).ok()?;
            equal += output.summary.degenerate;
            valid += output.bricks[0].validity.iter().filter(|&&v| v & validity::VALID != 0).count() as u64;
            texels += output.summary.texels;
            texture.insert(index, output.bricks.swap_remove(0)).ok()?;
        }
        Some((texture, texels - equal, valid == texels))
    }

    /// Bakes the texels of a place and looks it up under each light.
    fn find(&self, place: &Place, settings: &Settings, lights: &[Light]) -> Found {
        let (texture, different, _) = self.bake(place, settings).expect("settings and texels are legal");
        let view = texture.brick(place.texel.map(|t| t / BRICK)).expect("in memory").expect("baked");
        let inner = place.texel.map(|t| t % BRICK);
        let t = inner[0] + BRICK * (inner[1] + BRICK * inner[2]);
        let (n, e) = (self.layers.coefficients(), self.layers.errors());
        let root_four_pi = 2.0 * std::f64::consts::PI.sqrt();
        let stderr = root_four_pi * view.stderr[t * e].to_f64();
        let value = root_four_pi * view.transfer[t * n].to_f64();
        let mut numbers = vec![Estimate { value, stderr, uncorrelated: stderr }];
        let material = Material::new([ALBEDO; 3], [0.0; 3]).expect("a legal albedo");
        for light in lights {
            let textures = Textures::of_volume(&texture).expect("grey");
            let lit = contract(&textures, &place.selection.bricks(), light, &material).expect("in memory");
            let rgb =
                lit.radiance_at(place.position_in_grid, [0.0, 0.0, 1.0], light, &material, &mut Default::default());
            numbers.push(Estimate {
                value: rgb.iter().map(|&v| f64::from(v)).sum::<f64>() / 3.0,
                stderr: lit.look_up_errors(&[place.position_in_grid])[0].into(),
                uncorrelated: self.uncorrelated(light, &view.stderr[t * e..(t + 1) * e]),
            });
        }
        Found { numbers, equal: different == 0 }
    }

    /// sqrt(Σ_k ρ^(2k+2) Σ_l σ_kl² Σ_m L_lm²) of the first texel, without the tail.
    fn uncorrelated(&self, light: &Light, stderr: &[half::f16]) -> f64 {
        let mut sum = 0.0;
        for k in 0..LAYERS {
            let power = f64::from(ALBEDO).powi(2 * k as i32 + 2);
            for l in 0..BANDS.min(light.used_bands(k)) {
                let mean = |rgb: &[f64; 3]| rgb.iter().sum::<f64>() / 3.0;
                let band = &light.coefficients(k)[l * l..(l + 1) * (l + 1)];
                let energy: f64 = band.iter().map(|rgb| mean(rgb).powi(2)).sum();
                sum += power * energy * stderr[self.layers.error_offset(k) + l].to_f64().powi(2);
            }
        }
        sum.sqrt()
    }

    /// What `rays` find at all places, for each of `rays`; the last list is the reference, from other numbers.
    pub fn measure(&self, places: &[Place], rays: &[u32], reference: u32, lights: &[Light]) -> Vec<Vec<Found>> {
        let mut settings: Vec<Settings> = rays.iter().map(|&rays| self.settings(rays, 1)).collect();
        settings.push(self.settings(reference, 1_000_001));
        settings
            .iter()
            .map(|settings| places.par_iter().map(|place| self.find(place, settings, lights)).collect())
            .collect()
    }
}

/// How often intervals hold what the reference says.
#[derive(Clone, Copy, Debug, Default)]
pub struct Coverage {
    pub places: usize,
    pub covered: usize,
    /// Places whose replicates are all equal, and of these those whose interval covers: not counted above.
    pub equal: usize,
    pub equal_covered: usize,
    /// Mean square of the errors over the mean of the stated variances; the same with the uncorrelated one.
    pub ratio: f64,
    pub uncorrelated_ratio: f64,
}

impl Coverage {
    /// Of number `which` of [`Found::numbers`].
    pub fn of(found: &[Found], reference: &[Found], which: usize) -> Self {
        let mut coverage = Self::default();
        let (mut square, mut stated, mut uncorrelated) = (0.0, 0.0, 0.0);
        for (found, truth) in found.iter().zip(reference) {
            let (number, truth) = (found.numbers[which], truth.numbers[which].value);
            let error = (number.value - truth).abs();
            // Half a unit in the last place of the stored transfer, where nothing else is uncertain.
            let covers = error <= half_interval_95(BANDS) * number.stderr + truth.abs() / 2048.0;
            if found.equal {
                coverage.equal += 1;
                coverage.equal_covered += usize::from(covers);
                continue;
            }
            coverage.places += 1;
            coverage.covered += usize::from(covers);
            square += error * error;
            stated += number.stderr * number.stderr;
            uncorrelated += number.uncorrelated * number.uncorrelated;
        }
        (coverage.ratio, coverage.uncorrelated_ratio) = (square / stated, square / uncorrelated);
        coverage
    }

    /// Share of the places, those with equal replicates apart.
    pub fn share(&self) -> f64 {
        self.covered as f64 / self.places.max(1) as f64
    }

    /// Share of the places with equal replicates.
    pub fn equal_share(&self) -> f64 {
        self.equal_covered as f64 / self.equal.max(1) as f64
    }
}
