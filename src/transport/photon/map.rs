//! Sending out the photons.

use super::energy::{PhotonEnergy, tally};
use super::isovalues::{IsovalueDensity, Isovalues};
use super::packing::Photon;
use super::space::{Entry, Space};
use super::tree::Tree;
use crate::error::{Error, Result};
use crate::geom::{Frame, Normal};
use crate::level::{Counts, LevelField, Outcome, Pyramid, Start};
use crate::sampling::{DirectionalSource, PathSampler, warp};
use crate::transport::Progress;
use crate::volume::{Sample, Volume, with_samples};
use glam::Vec3;
use rayon::prelude::*;
use std::sync::atomic::Ordering;

/// What a photon map is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotonSettings {
    /// Photons sent out: at least 1, at most 2³⁰.
    pub photons: u32,
    /// Diffuse reflectance of each channel, in [0, 1].
    pub albedo: [f32; 3],
    /// Which isovalues they carry.
    pub isovalues: Isovalues,
    /// γ of κ = γ · extent(box) / extent(isovalues): how far photons of other isovalues are off.
    pub gamma: f32,
    /// Hits are kept from this many reflections on: 0 for all light, 1 for indirect light alone.
    pub first_bounce: u32,
    /// Reflections after which a photon is cut.
    pub most_bounces: u32,
    /// Whether roulette by the albedo ends photons; otherwise all go on, dimmed.
    pub roulette: bool,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Most bytes that the map may take.
    pub memory_limit: u64,
}

impl Default for PhotonSettings {
    /// A million photons, albedo 0.7, all isovalues by cell extent, γ = 1, all light, 2 GiB.
    fn default() -> Self {
        Self {
            photons: 1 << 20,
            albedo: [0.7; 3],
            isovalues: Isovalues::default(),
            gamma: 1.0,
            first_bounce: 0,
            most_bounces: 1024,
            roulette: true,
            seed: 0,
            memory_limit: 2 << 30,
        }
    }
}

impl PhotonSettings {
    fn check(&self) -> Result<()> {
        if !(1..=1 << 30).contains(&self.photons) {
            return Err(Error::argument("photons", self.photons, "1 to 2^30", "a million is a draft"));
        }
        if !self.albedo.iter().all(|a| (0.0..=1.0).contains(a)) {
            return Err(Error::argument("albedo", format!("{:?}", self.albedo), "numbers from 0 to 1", "give less"));
        }
        if !(self.gamma.is_finite() && self.gamma > 0.0) {
            return Err(Error::argument("gamma", self.gamma, "a positive number", "1 is the default"));
        }
        Ok(())
    }
}

/// Photons of all isovalues, in four dimensions.
pub struct PhotonMap {
    pub(super) tree: Tree<Photon>,
    pub(super) space: Space,
    pub(super) settings: PhotonSettings,
    // Isovalues drawn from, in ranges.
    pub(super) drawn: [f64; 2],
    // +1 where raw samples rise into the solid.
    pub(super) sign: f64,
    energy: PhotonEnergy,
    counts: Counts,
}

/// Photons traced by one task.
const TASK: u32 = 4096;
/// Tasks whose photons are held beside the map before they are added to it.
const TASKS: u32 = 64;

/// Pairs of random numbers: direction and disk share a sequence of four dimensions; the isovalue has its own; then two
/// for each reflection.
const DIRECTION: u32 = 0;
const DISK: u32 = 1;
const ISOVALUE: u32 = 2;
const REFLECTIONS: u32 = 4;

impl PhotonMap {
    /// Sends out photons of a light and keeps where they land.
    ///
    /// The same map for any number of threads. Without light (a black environment) it is empty.
    ///
    /// # Errors
    /// When the settings are not as [`PhotonSettings`] says, the volume has no cells or no isosurface in the range, or
    /// more photons land than memory is allowed for.
    pub fn new(
        volume: &Volume,
        pyramid: &Pyramid,
        light: &dyn DirectionalSource,
        settings: &PhotonSettings,
    ) -> Result<Self> {
        // Nobody else has this progress to cancel.
        let made = Self::watched(volume, pyramid, light, settings, &Progress::default())?;
        made.ok_or_else(|| Error::argument("photons", "cancelled", "a map", "send them out again"))
    }

    /// As [`PhotonMap::new`], while `progress` tells of photons and rays; `None` once it is cancelled.
    ///
    /// # Errors
    /// As [`PhotonMap::new`].
    pub fn watched(
        volume: &Volume,
        pyramid: &Pyramid,
        light: &dyn DirectionalSource,
        settings: &PhotonSettings,
        progress: &Progress,
    ) -> Result<Option<Self>> {
        settings.check()?;
        volume.check_cells()?;
        let density = IsovalueDensity::new(volume, &settings.isovalues)?;
        let space = Space::new(volume);
        let (mut photons, mut energy, mut counts) = (Vec::new(), PhotonEnergy::default(), Counts::default());
        with_samples!(volume.samples(), s => {
            let field = LevelField::new(volume, s, pyramid);
            let emission = Emission { field: &field, space: &space, density: &density, light, settings };
            let tasks = settings.photons.div_ceil(TASK);
            for first in (0..tasks).step_by(TASKS as usize) {
                let last = (first + TASKS).min(tasks);
                let parts: Vec<Part> = (first..last).into_par_iter().map(|task| emission.watched(task, progress)).collect();
                if progress.cancel.load(Ordering::Relaxed) {
                    return Ok(None);
                }
                let landed: usize = parts.iter().map(|p| p.photons.len()).sum();
                make_room(&mut photons, landed, f64::from(last) / f64::from(tasks), settings.memory_limit)?;
                for part in parts {
                    photons.extend_from_slice(&part.photons);
                    energy += &part.energy;
                    counts += part.counts;
                }
            }
        });
        photons.shrink_to_fit();
        let drawn = density.drawn();
        let sign = f64::from(volume.solid_sign());
        Ok(Some(Self { tree: Tree::new(photons), space, settings: settings.clone(), drawn, sign, energy, counts }))
    }

    /// Hits kept.
    pub fn len(&self) -> usize {
        self.tree.in_order().len()
    }

    /// Whether no hit was kept.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes of the photons and their tree.
    pub fn bytes(&self) -> u64 {
        (self.len() * size_of::<Photon>()) as u64
    }

    /// Where the light went.
    pub fn energy(&self) -> &PhotonEnergy {
        &self.energy
    }

    /// Work of the tracer.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// What it was asked for.
    pub fn settings(&self) -> &PhotonSettings {
        &self.settings
    }
}

/// Makes room for as many photons as will land if the rest goes as the first part did, so that the array is moved seldom
/// and never takes twice what it holds.
fn make_room(photons: &mut Vec<Photon>, landed: usize, done: f64, limit: u64) -> Result<()> {
    let needed = photons.len() + landed;
    let bytes = |count: usize| (count * size_of::<Photon>()) as u64;
    let at_the_end = (needed as f64 / done * 1.02) as usize + 1024;
    // A first guess from few photons must not refuse what would fit.
    if bytes(needed) > limit || (done > 0.1 && bytes((needed as f64 / done) as usize) > limit) {
        return Err(Error::Limit {
            what: "the photon map".into(),
            needed: format!("{} MiB", bytes(at_the_end) >> 20),
            limit: format!("{} MiB", limit >> 20),
            remedy: "send out fewer photons, or raise the limit".into(),
        });
    }
    if needed > photons.capacity() {
        photons.reserve_exact(at_the_end.max(needed) - photons.len());
    }
    Ok(())
}

/// What one task found.
#[derive(Default)]
struct Part {
    photons: Vec<Photon>,
    energy: PhotonEnergy,
    counts: Counts,
}

struct Emission<'a, 'v, T> {
    field: &'a LevelField<'v, T>,
    space: &'a Space,
    density: &'a IsovalueDensity,
    light: &'a dyn DirectionalSource,
    settings: &'a PhotonSettings,
}

/// A photon on its way.
struct Flight {
    index: u32,
    isovalue: f32,
    // Fourth coordinate.
    height: f32,
    source: Vec3,
    flux: [f64; 3],
    transfer: f64,
}

impl<T: Sample> Emission<'_, '_, T> {
    /// One task, counted; nothing once `progress` is cancelled.
    fn watched(&self, task: u32, progress: &Progress) -> Part {
        if progress.cancel.load(Ordering::Relaxed) {
            return Part::default();
        }
        let part = self.task(task);
        progress.photons.fetch_add(u64::from(TASK.min(self.settings.photons - task * TASK)), Ordering::Relaxed);
        progress.rays.fetch_add(part.counts.rays, Ordering::Relaxed);
        part
    }

    fn task(&self, task: u32) -> Part {
        let mut part = Part::default();
        let sampler = PathSampler::new(self.settings.seed, 0, 0);
        let first = task * TASK;
        for index in first..(first + TASK).min(self.settings.photons) {
            self.send(index, &sampler, &mut part);
        }
        part
    }

    fn send(&self, index: u32, sampler: &PathSampler, part: &mut Part) {
        let Some(sample) = self.light.sample(sampler.pair(index, DIRECTION)) else { return };
        let Some(towards) = Normal::down_gradient(-sample.direction.vec()) else { return };
        let (share, density) = self.density.sample(sampler.pair(index, ISOVALUE)[0]);
        // π R² with R half of the diagonal, over the densities.
        let transfer =
            std::f64::consts::PI / (4.0 * f64::from(sample.density) * density * f64::from(self.settings.photons));
        let flux = sample.radiance.map(|l| f64::from(l) * transfer);
        part.energy.photons += 1;
        tally(&mut part.energy.emitted, flux);
        let entry = match self.space.entry(towards, warp::square_to_uniform_disk(sampler.pair(index, DISK))) {
            Entry::Missed => return tally(&mut part.energy.missed, flux),
            Entry::At(entry) => self.field.locate(entry.to_array()),
        };
        let isovalue = self.space.raw_from_share(share);
        if self.field.sign() * (self.field.raw_value(&entry) - isovalue) > 0.0 {
            return tally(&mut part.energy.discarded, flux);
        }
        let along = self.field.direction_in_grid(-towards.vec());
        let flight = Flight {
            index,
            isovalue,
            height: self.settings.gamma * share as f32,
            source: towards.vec(),
            flux,
            transfer,
        };
        match self.field.trace(isovalue, &Start::beside(entry), along, &mut part.counts) {
            Outcome::Escaped => tally(&mut part.energy.escaped, flux),
            // By rounding at the entry only.
            Outcome::Lost => tally(&mut part.energy.discarded, flux),
            Outcome::Hit(hit) => self.reflect(flight, Start::on(hit.at), sampler, part),
        }
    }

    /// Follows a photon from its first hit.
    fn reflect(&self, mut flight: Flight, mut start: Start, sampler: &PathSampler, part: &mut Part) {
        let albedo = self.settings.albedo.map(f64::from);
        let survival = if self.settings.roulette { albedo[0].max(albedo[1]).max(albedo[2]) } else { 1.0 };
        let Some(mut normal) = self.field.hit_normal(&start.at) else {
            return tally(&mut part.energy.absorbed, flight.flux);
        };
        for bounce in 0.. {
            // Searches compare it with smoothed ones.
            let smoothed = self.field.normal(&start.at).unwrap_or(normal);
            self.keep(&flight, &start, smoothed, bounce, part);
            if bounce == self.settings.most_bounces {
                return tally(&mut part.energy.cut, flight.flux);
            }
            let pair = REFLECTIONS + 2 * bounce;
            let survives = survival >= 1.0 || f64::from(sampler.pair(flight.index, pair + 1)[0]) < survival;
            let before = flight.flux;
            let after = std::array::from_fn(|c| if survives { before[c] * albedo[c] / survival } else { 0.0 });
            tally(&mut part.energy.absorbed, std::array::from_fn(|c| before[c] - after[c]));
            if !survives {
                return;
            }
            flight.flux = after;
            flight.transfer /= survival;
            let local = warp::square_to_cosine_hemisphere(sampler.pair(flight.index, pair));
            let towards = Frame::around(normal).from_local(local);
            let along = self.field.direction_in_grid(towards);
            match self.field.trace(flight.isovalue, &start, along, &mut part.counts) {
                Outcome::Escaped => return tally(&mut part.energy.escaped, flight.flux),
                // It meets the surface where it starts, as in the estimator `path`.
                Outcome::Lost => part.energy.lost += 1,
                Outcome::Hit(hit) => {
                    let Some(there) = self.field.hit_normal(&hit.at) else {
                        return tally(&mut part.energy.absorbed, flight.flux);
                    };
                    (start, normal) = (Start::on(hit.at), there);
                }
            }
        }
    }

    fn keep(&self, flight: &Flight, start: &Start, normal: Normal, bounce: u32, part: &mut Part) {
        part.energy.hits += 1;
        if bounce < self.settings.first_bounce {
            return;
        }
        let [x, y, z] = self.space.unit_from_grid(start.at.in_grid().as_dvec3()).as_vec3().to_array();
        let point = [x, y, z, flight.height];
        part.energy.arrive(bounce, flight.flux);
        part.photons.push(Photon::new(point, flight.flux, flight.transfer, normal.vec(), flight.source, bounce));
    }
}
