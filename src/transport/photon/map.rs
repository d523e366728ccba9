//! Sending out the photons.

use super::energy::{PhotonEnergy, tally};
use super::flight::{Flight, Landing, Sent};
use super::isovalues::{IsovalueDensity, Isovalues};
use super::packing::{Origin, Photon};
use super::space::Space;
use super::tree::Tree;
use crate::error::{Error, Result};
use crate::geom::{Frame, Normal};
use crate::level::{Counts, LevelField, Pyramid};
use crate::sampling::{DirectionalSource, PathSampler, warp};
use crate::scene::geometry::{Geometry, LeavingPhoton};
use crate::transport::Progress;
use crate::transport::scene_path::World;
use crate::volume::{Sample, Volume, with_samples};
use glam::DVec3;
use rayon::prelude::*;
use std::sync::atomic::Ordering;

/// Which hits a photon map keeps. Those of light by way of mirrors and glass alone (caustics) are kept apart from others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kept {
    /// All.
    #[default]
    All,
    /// Those of indirect light, which a wall or level set has reflected diffusely before, and caustics.
    Indirect,
    /// Those of light that a mirror or glass was the first to meet.
    BeganSpecular,
}

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
    /// Which hits are kept.
    pub kept: Kept,
    /// Reflections by level sets after which a photon is cut.
    pub most_bounces: u32,
    /// Factors on the power of each luminaire, in their order; those not given are 1.
    pub scales: Vec<[f64; 3]>,
    /// Whether roulette by the albedo of level sets ends photons; otherwise all go on from there, dimmed.
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
            kept: Kept::All,
            most_bounces: 1024,
            scales: Vec::new(),
            roulette: true,
            seed: 0,
            memory_limit: 2 << 30,
        }
    }
}

impl PhotonSettings {
    /// Factor on the power of a luminaire.
    pub(super) fn scale(&self, l: usize) -> [f64; 3] {
        self.scales.get(l).copied().unwrap_or([1.0; 3])
    }

    fn check(&self) -> Result<()> {
        if !(1..=1 << 30).contains(&self.photons) {
            return Err(Error::argument("photons", self.photons, "1 to 2^30", "a million is a draft"));
        }
        if !self.albedo.iter().all(|a| (0.0..=1.0).contains(a)) {
            return Err(Error::argument("albedo", format!("{:?}", self.albedo), "numbers from 0 to 1", "give less"));
        }
        if !self.scales.iter().flatten().all(|s| s.is_finite() && *s >= 0.0) {
            let expected = "finite numbers that are not negative";
            return Err(Error::argument(
                "scales",
                format!("{:?}", self.scales),
                expected,
                "1 leaves the power as it is",
            ));
        }
        if !(self.gamma.is_finite() && self.gamma > 0.0) {
            return Err(Error::argument("gamma", self.gamma, "a positive number", "1 is the default"));
        }
        Ok(())
    }
}

/// Where photons come from, and what they meet.
#[derive(Clone, Copy)]
pub struct PhotonScene<'a> {
    /// The volume on whose level sets they are kept.
    pub volume: &'a Volume,
    /// Its pyramid.
    pub pyramid: &'a Pyramid,
    /// Walls, luminaires and other volumes around it; none for a volume alone.
    pub geometry: Option<&'a Geometry>,
    /// The environment, if there is light from it.
    pub light: Option<&'a dyn DirectionalSource>,
}

impl<'a> PhotonScene<'a> {
    /// A volume alone under an environment.
    pub fn alone(volume: &'a Volume, pyramid: &'a Pyramid, light: &'a dyn DirectionalSource) -> Self {
        Self { volume, pyramid, geometry: None, light: Some(light) }
    }
}

/// Photons of all isovalues, in four dimensions.
pub struct PhotonMap {
    pub(super) tree: Tree<Photon>,
    // Of light by way of mirrors and glass alone.
    pub(super) caustics: Tree<Photon>,
    pub(super) space: Space,
    pub(super) settings: PhotonSettings,
    // Isovalues drawn from, in ranges.
    pub(super) drawn: [f64; 2],
    // +1 where raw samples rise into the solid.
    pub(super) sign: f64,
    // Of the environment, then of each luminaire.
    energies: Vec<PhotonEnergy>,
    counts: Counts,
    // Of walls, luminaires and other volumes.
    fingerprint: String,
}

/// Photons traced by one task.
const TASK: u32 = 4096;
/// Tasks whose photons are held beside the map before they are added to it.
const TASKS: usize = 64;

/// Pairs of random numbers: direction and place share a sequence of four dimensions; the isovalue has its own; then two
/// for each reflection, from 4 on.
const DIRECTION: u32 = 0;
const DISK: u32 = 1;
const ISOVALUE: u32 = 2;

/// Photons fly through vacuum alone.
fn refuse_media(geometry: Option<&Geometry>) -> Result<()> {
    let of_body = geometry.and_then(|geometry| geometry.body()).map(|body| &body.medium);
    let medium = geometry.and_then(|geometry| geometry.media().first()).or(of_body);
    let Some(medium) = medium else { return Ok(()) };
    let remedy = "judge it by paths (--against path), or leave the media out: --effects -media";
    Err(Error::argument("photons", format!("the medium {}", medium.name), "a scene without media", remedy))
}

impl PhotonMap {
    /// Sends out photons and keeps where they land.
    ///
    /// The same map for any number of threads. Without light it is empty.
    ///
    /// # Errors
    /// When the settings are not as [`PhotonSettings`] says, the volume has no cells or no isosurface in the range,
    /// more photons land than memory is allowed for, or the light has samples that are no numbers.
    pub fn new(scene: &PhotonScene<'_>, settings: &PhotonSettings) -> Result<Self> {
        // Nobody else has this progress to cancel.
        let made = Self::watched(scene, settings, &Progress::default())?;
        made.ok_or_else(|| Error::argument("photons", "cancelled", "a map", "send them out again"))
    }

    /// As [`PhotonMap::new`], while `progress` tells of photons and rays; `None` once it is cancelled.
    ///
    /// # Errors
    /// As [`PhotonMap::new`].
    pub fn watched(scene: &PhotonScene<'_>, settings: &PhotonSettings, progress: &Progress) -> Result<Option<Self>> {
        let volume = scene.volume;
        settings.check()?;
        refuse_media(scene.geometry)?;
        volume.check_cells()?;
        let nothing = Geometry::new(Vec::new(), Vec::new(), 1.0)?;
        let geometry = scene.geometry.unwrap_or(&nothing);
        let density = IsovalueDensity::new(volume, &settings.isovalues)?;
        let (space, sphere) = (Space::new(volume), geometry.sphere_around(volume.world_bounds()));
        let mut all = Part::new(geometry);
        with_samples!(volume.samples(), s => {
            let field = LevelField::new(volume, s, scene.pyramid);
            let world = World::new(volume, &field, geometry);
            let (world, space, density, light) = (&world, &space, &density, scene.light);
            let emission = Emission { world, space, density, light, settings, sphere };
            let tasks = Task::of(&emission.shares());
            for (i, group) in tasks.chunks(TASKS).enumerate() {
                let parts: Vec<Part> = group.into_par_iter().map(|task| emission.watched(task, progress)).collect();
                if progress.cancel.load(Ordering::Relaxed) {
                    return Ok(None);
                }
                let done = ((i * TASKS + group.len()) as f64) / tasks.len() as f64;
                let landed = [0, 1].map(|kind| parts.iter().map(|p| p.kinds()[kind].len()).sum::<usize>());
                let limit = settings.memory_limit;
                make_room(&mut all.photons, landed[0], done, limit)?;
                make_room(&mut all.caustics, landed[1], done, limit)?;
                parts.into_iter().for_each(|part| all.add(part));
            }
        });
        let Part { mut photons, mut caustics, energies, counts } = all;
        photons.shrink_to_fit();
        caustics.shrink_to_fit();
        if !energies.iter().flat_map(|energy| energy.emitted).all(f64::is_finite) {
            let (found, expected) =
                ("radiance over a density that is no finite number", "finite radiance and densities above 0");
            return Err(Error::argument("light", found, expected, "correct the samples of the light"));
        }
        let fingerprint = geometry.fingerprint().to_owned();
        let drawn = density.drawn();
        let sign = f64::from(volume.solid_sign());
        let (tree, caustics) = (Tree::new(photons), Tree::new(caustics));
        Ok(Some(Self { tree, caustics, space, settings: settings.clone(), drawn, sign, energies, counts, fingerprint }))
    }

    /// Whether it was made in a scene: of a volume of the same place and range, among the same walls, luminaires and volumes.
    pub(super) fn is_of(&self, scene: &PhotonScene<'_>) -> bool {
        let same_walls = match scene.geometry {
            Some(geometry) => geometry.fingerprint() == self.fingerprint,
            None => Geometry::new(Vec::new(), Vec::new(), 1.0).is_ok_and(|none| none.fingerprint() == self.fingerprint),
        };
        same_walls && Space::new(scene.volume) == self.space
    }

    /// Hits kept, caustics among them.
    pub fn len(&self) -> usize {
        self.tree.in_order().len() + self.caustics.in_order().len()
    }

    /// Hits kept of light by way of mirrors and glass alone.
    pub fn caustics(&self) -> usize {
        self.caustics.in_order().len()
    }

    /// Whether no hit was kept.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Bytes of the photons and their trees.
    pub fn bytes(&self) -> u64 {
        (self.len() * size_of::<Photon>()) as u64
    }

    /// Where all light went.
    pub fn energy(&self) -> PhotonEnergy {
        let mut sum = PhotonEnergy::default();
        self.energies.iter().for_each(|energy| sum += energy);
        sum
    }

    /// Where the light of the environment went, then that of each luminaire in their order.
    pub fn energies(&self) -> &[PhotonEnergy] {
        &self.energies
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
struct Part {
    photons: Vec<Photon>,
    caustics: Vec<Photon>,
    energies: Vec<PhotonEnergy>,
    counts: Counts,
}

impl Part {
    fn new(geometry: &Geometry) -> Self {
        let energies = vec![PhotonEnergy::default(); 1 + geometry.luminaires().len()];
        Self { photons: Vec::new(), caustics: Vec::new(), energies, counts: Counts::default() }
    }

    fn kinds(&self) -> [&[Photon]; 2] {
        [&self.photons, &self.caustics]
    }

    fn add(&mut self, other: Self) {
        self.photons.extend_from_slice(&other.photons);
        self.caustics.extend_from_slice(&other.caustics);
        self.energies.iter_mut().zip(&other.energies).for_each(|(a, b)| *a += b);
        self.counts += other.counts;
    }
}

/// Who sends photons out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Source {
    Environment,
    Luminaire(usize),
}

impl Source {
    /// Its place among the energies: the environment, then the luminaires.
    fn place(self) -> usize {
        match self {
            Self::Environment => 0,
            Self::Luminaire(l) => 1 + l,
        }
    }
}

struct Emission<'a, 'w, T> {
    world: &'a World<'w, T>,
    space: &'a Space,
    density: &'a IsovalueDensity,
    light: Option<&'a dyn DirectionalSource>,
    settings: &'a PhotonSettings,
    // Centre and radius, around the whole scene.
    sphere: (DVec3, f64),
}

/// Photons of a source that one task sends out, of so many in all.
#[derive(Clone, Copy)]
struct Task {
    source: Source,
    first: u32,
    last: u32,
    all: u32,
}

impl Task {
    /// All of `photons`, each source's in turn.
    fn of(shares: &[(Source, u32)]) -> Vec<Self> {
        let of = |&(source, all): &(Source, u32)| {
            (0..all).step_by(TASK as usize).map(move |first| Self { source, first, last: (first + TASK).min(all), all })
        };
        shares.iter().flat_map(of).collect()
    }
}

impl<T: Sample> Emission<'_, '_, T> {
    /// How many photons each source sends out: most where most light lands on level sets, as a few of each say.
    ///
    /// Any numbers give the same light in the mean; a source whose light comes late, by walls, keeps its share of a
    /// twentieth.
    fn shares(&self) -> Vec<(Source, u32)> {
        const PILOT: u32 = 1024;
        let geometry = self.world.geometry;
        let environment = self.light.map(|_| Source::Environment);
        let luminaires = (0..geometry.luminaires().len()).map(Source::Luminaire).filter(|s| self.has_light(*s));
        let sources: Vec<Source> = environment.into_iter().chain(luminaires).collect();
        let photons = self.settings.photons;
        if let [alone] = sources.as_slice() {
            return vec![(*alone, photons)];
        }
        let landed = |source: &Source| {
            let mut part = Part::new(geometry);
            self.task(&Task { source: *source, first: 0, last: PILOT, all: PILOT }, &mut part);
            let stored = &part.energies[source.place()].stored;
            stored.iter().flatten().map(|v| v.abs()).sum::<f64>()
        };
        let landed: Vec<f64> = sources.iter().map(landed).collect();
        let (all, n) = (landed.iter().sum::<f64>(), sources.len() as f64);
        let mut left = photons;
        let mut counts: Vec<(Source, u32)> = Vec::with_capacity(sources.len());
        for (source, landed) in sources.into_iter().zip(landed) {
            let share = if all > 0.0 { 0.95 * landed / all + 0.05 / n } else { 1.0 / n };
            let count = ((share * f64::from(photons)) as u32).clamp(1, left.max(1));
            left = left.saturating_sub(count);
            counts.push((source, count));
        }
        if let Some(first) = counts.first_mut() {
            first.1 += left;
        }
        counts
    }

    /// Whether a luminaire has any power, with the factor on it.
    fn has_light(&self, source: Source) -> bool {
        let Source::Luminaire(l) = source else { return true };
        let flux = self.world.geometry.photon(l, [0.5; 2], [0.5; 2], self.sphere).flux;
        (0..3).any(|c| flux[c] * self.settings.scale(l)[c] > 0.0)
    }

    /// One task, counted; nothing once `progress` is cancelled.
    fn watched(&self, task: &Task, progress: &Progress) -> Part {
        let mut part = Part::new(self.world.geometry);
        if progress.cancel.load(Ordering::Relaxed) {
            return part;
        }
        self.task(task, &mut part);
        progress.photons.fetch_add(u64::from(task.last - task.first), Ordering::Relaxed);
        progress.rays.fetch_add(part.counts.rays, Ordering::Relaxed);
        part
    }

    fn task(&self, task: &Task, part: &mut Part) {
        let sampler = PathSampler::new(self.settings.seed, task.source.place() as u64, 0);
        for index in task.first..task.last {
            self.send(task, index, &sampler, part);
        }
    }

    fn send(&self, task: &Task, index: u32, sampler: &PathSampler, part: &mut Part) {
        let (way, place) = (sampler.pair(index, DIRECTION), sampler.pair(index, DISK));
        let (share, density) = self.density.sample(sampler.pair(index, ISOVALUE)[0]);
        // Areas in squared diagonals.
        let factor = 1.0 / (self.space.diagonal() * self.space.diagonal() * density * f64::from(task.all));
        let (sent, origin) = match task.source {
            Source::Environment => {
                let Some(sample) = self.light.and_then(|light| light.sample(way)) else { return };
                let Some(towards) = Normal::down_gradient(-sample.direction.vec()) else { return };
                let (frame, disk) = (Frame::around(towards), warp::square_to_uniform_disk(place).as_dvec2());
                let (x, y) = (frame.tangent.as_dvec3() * disk.x, frame.bitangent.as_dvec3() * disk.y);
                let (middle, radius) = self.sphere;
                // A density that is none must not pass for one: the sum of what is emitted then is no number.
                let density = if sample.density > 0.0 { f64::from(sample.density) } else { f64::NAN };
                let area = std::f64::consts::PI * radius * radius / density;
                let sent = Sent {
                    origin: middle + radius * (towards.vec().as_dvec3() + x + y),
                    direction: -towards.vec().as_dvec3().normalize_or(DVec3::Z),
                    flux: sample.radiance.map(|l| f64::from(l) * area * factor),
                };
                (sent, Origin::Environment(towards.vec()))
            }
            Source::Luminaire(l) => {
                let LeavingPhoton { origin, direction, flux } = self.world.geometry.photon(l, place, way, self.sphere);
                let scale = self.settings.scale(l);
                let flux = std::array::from_fn(|c| flux[c] * scale[c] * factor);
                (Sent { origin, direction: direction.normalize_or(DVec3::Z), flux }, Origin::Luminaire(l as u32))
            }
        };
        let Part { photons, caustics, energies, counts } = part;
        let energy = &mut energies[task.source.place()];
        energy.photons += 1;
        tally(&mut energy.emitted, sent.flux);
        let isovalues = self.world.isovalues(self.space.raw_from_share(share));
        let height = self.settings.gamma * share as f32;
        let (world, settings) = (self.world, self.settings);
        let flight = Flight { world, settings, sampler, index, isovalues: &isovalues };
        flight.follow(sent, energy, counts, &mut |energy, landing| {
            let Landing { cell, normal, flux, history } = landing;
            energy.hits += 1;
            let is_caustic = history.turns == 0 && history.began_specular;
            let is_kept = match settings.kept {
                Kept::All => true,
                Kept::Indirect => is_caustic || history.turns > 0,
                Kept::BeganSpecular => history.began_specular,
            };
            if !is_kept {
                return;
            }
            let [x, y, z] = self.space.unit_from_grid(cell.in_grid().as_dvec3()).as_vec3().to_array();
            energy.arrive(history.bounces, flux);
            let photon = Photon::new([x, y, z, height], flux, normal.vec(), origin, history.bounces);
            if is_caustic { caustics.push(photon) } else { photons.push(photon) }
        });
    }
}
