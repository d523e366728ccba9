//! The stability run: every ray family over every ray volume, our tracer and its twins, each answer judged by
//! the oracle. `tests/physics/hard_rays.rs` asserts a short run, `probes/measure/stability.rs` makes the table.
#![allow(dead_code)] // Every program that uses it uses its own part.

use super::oracle::{Fault, Oracle, Profile, Said, Verdict, as_traced, judge, judge_within};
use super::rays::{Family, Ray, ray};
use super::twins::{TWIN_BUDGET, TWINS, Twin, TwinField, TwinSaid};
use glam::Vec3;
use isolume::level::{Counts, LevelField, Pyramid};
use isolume::volume::{Sample, SamplesView, Volume};
use rayon::prelude::*;

/// Verdicts on many rays.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tally {
    pub rays: u64,
    pub hits: u64,
    pub lost: u64,
    pub grazing: u64,
    /// Of these hits where the ray starts, tangent to within rounding.
    pub grazing_starts: u64,
    pub leaks: u64,
    pub late: u64,
    pub self_hits: u64,
    /// Hits where there is no surface, or beside the ray.
    pub ghosts: u64,
    pub not_a_number: u64,
    /// Wrong about a start in the solid.
    pub buried: u64,
    /// Largest distance of a hit from the first rise, in voxels, of answers that are right.
    pub worst: f64,
}

impl Tally {
    fn count(&mut self, said: Said, verdict: Verdict) {
        self.rays += 1;
        self.hits += u64::from(matches!(said, Said::Hit(..)));
        self.lost += u64::from(said == Said::Lost);
        match verdict {
            Verdict::Exact(error) => self.worst = self.worst.max(error),
            Verdict::Grazing => self.grazing += 1,
            Verdict::GrazingStart => {
                self.grazing += 1;
                self.grazing_starts += 1;
            }
            Verdict::Wrong(fault) => {
                *match fault {
                    Fault::Leak => &mut self.leaks,
                    Fault::Late => &mut self.late,
                    Fault::SelfHit => &mut self.self_hits,
                    Fault::Ghost | Fault::Beside => &mut self.ghosts,
                    Fault::NotANumber => &mut self.not_a_number,
                    Fault::LostOutside | Fault::TooDeep => &mut self.buried,
                } += 1
            }
        }
    }

    pub fn add(&mut self, other: &Self) {
        self.rays += other.rays;
        self.hits += other.hits;
        self.lost += other.lost;
        self.grazing += other.grazing;
        self.grazing_starts += other.grazing_starts;
        self.leaks += other.leaks;
        self.late += other.late;
        self.self_hits += other.self_hits;
        self.ghosts += other.ghosts;
        self.not_a_number += other.not_a_number;
        self.buried += other.buried;
        self.worst = self.worst.max(other.worst);
    }

    /// Answers that are wrong by more than f32 can tell.
    pub fn wrong(&self) -> u64 {
        self.leaks + self.late + self.self_hits + self.ghosts + self.not_a_number + self.buried
    }
}

/// One family on one volume.
#[derive(Clone, Debug)]
pub struct Entry {
    pub volume: String,
    pub family: Family,
    /// Our tracer on all rays.
    pub all: Tally,
    /// Our tracer on the rays that the twins trace.
    pub lit: Tally,
    /// The twins, in the order of [`TWINS`], on rays that start on their level set and leave it on the lit side.
    pub twins: Vec<Tally>,
    /// The first wrong answer of ours.
    pub first_wrong: Option<String>,
}

/// Traces `rays` rays of a family through a volume; every `stride`-th by the twins as well.
pub fn run(name: &str, volume: &Volume, family: Family, seed: u64, rays: u64, stride: u64) -> Entry {
    match volume.samples().view() {
        SamplesView::U8(s) => run_on(name, volume, s, family, seed, rays, stride),
        SamplesView::I8(s) => run_on(name, volume, s, family, seed, rays, stride),
        SamplesView::U16(s) => run_on(name, volume, s, family, seed, rays, stride),
        SamplesView::I16(s) => run_on(name, volume, s, family, seed, rays, stride),
        SamplesView::F32(s) => run_on(name, volume, s, family, seed, rays, stride),
    }
}

const PART: u64 = 1024;

fn run_on<T: Sample>(
    name: &str,
    volume: &Volume,
    samples: &[T],
    family: Family,
    seed: u64,
    rays: u64,
    stride: u64,
) -> Entry {
    let pyramid = Pyramid::new(volume);
    let field = LevelField::new(volume, samples, &pyramid);
    let (oracle, twins) = (Oracle::new(volume), TwinField::new(volume));
    let blank = || Entry {
        volume: name.into(),
        family,
        all: Tally::default(),
        lit: Tally::default(),
        twins: vec![Tally::default(); TWINS.len()],
        first_wrong: None,
    };
    let parts: Vec<Entry> = (0..rays.div_ceil(PART))
        .into_par_iter()
        .map(|part| {
            let mut entry = blank();
            for item in part * PART..((part + 1) * PART).min(rays) {
                let Some(ray) = ray(&field, samples, family, seed, item) else { continue };
                one_ray(&field, &oracle, &twins, &ray, item % stride == 0, &mut entry);
            }
            entry
        })
        .collect();
    let mut total = blank();
    for part in parts {
        total.all.add(&part.all);
        total.lit.add(&part.lit);
        total.twins.iter_mut().zip(&part.twins).for_each(|(a, b)| a.add(b));
        total.first_wrong = total.first_wrong.or(part.first_wrong);
    }
    total
}

fn one_ray<T: Sample>(
    field: &LevelField<'_, T>,
    oracle: &Oracle,
    twins: &TwinField,
    ray: &Ray,
    by_twins: bool,
    entry: &mut Entry,
) {
    let outcome = field.trace(ray.isovalue, &ray.start, ray.direction, &mut Counts::default());
    let origin = ray.start.at.cell.as_dvec3() + ray.start.at.local.as_dvec3();
    let said = Said::of(outcome, origin, as_traced(ray.direction));
    let until = match said {
        Said::Hit(t, _) if !by_twins => t + 1.0,
        _ => f64::INFINITY,
    };
    let profile = oracle.profile(ray.isovalue, &ray.start, ray.direction, until);
    let verdict = judge(&profile, ray.start.on_surface, said);
    entry.all.count(said, verdict);
    if matches!(verdict, Verdict::Wrong(_)) && entry.first_wrong.is_none() {
        entry.first_wrong = Some(format!("{said:?} is {verdict:?} for {ray:?}"));
    }
    if by_twins && ray.start.on_surface && profile.leaves_lit() {
        entry.lit.count(said, verdict);
        // What moves along a normal in grid space has to be one there.
        let down = -field.raw_gradient(&ray.start.at) * field.sign();
        let largest = down.abs().max_element();
        let normal = if largest > 0.0 { (down / largest).normalize() } else { Vec3::ZERO };
        for (twin, tally) in TWINS.iter().zip(&mut entry.twins) {
            let said = twin_said(twins, twin, ray, normal, &profile);
            tally.count(said, judge_within(TWIN_BUDGET, &profile, true, said));
        }
    }
}

/// The answer of a twin as a way along the true ray; that an offset puts its hits beside it is not held against it.
fn twin_said(twins: &TwinField, twin: &Twin, ray: &Ray, normal: Vec3, profile: &Profile) -> Said {
    match twins.trace(twin, ray, normal) {
        TwinSaid::Escaped => Said::Escaped,
        TwinSaid::NotANumber => Said::NotANumber,
        TwinSaid::Hit(at) => Said::Hit((at.as_dvec3() - profile.origin).dot(profile.direction), 0.0),
    }
}
