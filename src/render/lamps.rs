//! Lamps that were split off an environment, as one source of light for paths among walls and other volumes.

use super::sun::{Disk, SunLight};
use crate::error::Result;
use crate::geom::Direction;
use crate::sampling::{DirectionSample, DirectionalSource};

/// Density per steradian that stands for that of a lamp, whose own is not known anywhere but where it was drawn. It is so far above that
/// of any way on that combining the two by the balance heuristic leaves the lamp all: what a path brings that happens on a lamp does not count.
const NARROW: f64 = 1e12;
/// Most flux times that density: what is drawn is a number of single precision. Lamps of more than a flux of 10²⁵ get a smaller density.
const MOST: f64 = 1e37;
/// Standard error that light of lamps is aimed at, root mean square over places and channels, over the mean radiance.
pub(crate) const AIM: f64 = 0.012;
/// Places of the trial that tells how many rays that takes.
const TRIAL: usize = 384;

/// Some of so many places, for a trial.
pub(crate) fn places_of_trial(count: usize) -> impl Iterator<Item = usize> {
    (0..count).step_by(count.div_ceil(TRIAL).max(1))
}

/// As many rays a place as a trial finds enough, from the fewest on, doubled; as many as allowed where it never does.
///
/// # Errors
/// Those of the trial.
pub(crate) fn rays_that_are_enough(
    fewest: u32,
    allowed: u32,
    mut is_enough: impl FnMut(u32) -> Result<bool>,
) -> Result<u32> {
    let mut rays = fewest;
    while 2 * rays <= allowed && !is_enough(rays)? {
        rays *= 2;
    }
    Ok(rays)
}

/// Some lamps, of which each draw takes one by its flux, and lights as all of them do; an environment of low bands may shine beside
/// them, which is found by paths that happen on it.
pub struct Lamps<'a> {
    disks: Vec<(Disk, [f64; 3])>,
    /// Running sum of the chances, up to 1.
    chances: Vec<f64>,
    density: f64,
    beside: Option<&'a dyn DirectionalSource>,
}

impl<'a> Lamps<'a> {
    /// Those of some suns that have any flux.
    pub fn new(suns: &[SunLight], beside: Option<&'a dyn DirectionalSource>) -> Self {
        let strength = |sun: &SunLight| sun.flux.iter().map(|f| f.abs()).sum::<f64>();
        let all: f64 = suns.iter().map(strength).sum();
        let (mut disks, mut chances, mut sum) = (Vec::new(), Vec::new(), 0.0);
        for sun in suns.iter().filter(|sun| strength(sun) > 0.0) {
            sum += strength(sun) / all;
            chances.push(sum);
            disks.push((Disk::new(sun), sun.flux));
        }
        // Of rounding nothing is left over.
        if let Some(last) = chances.last_mut() {
            *last = 1.0;
        }
        let density = if all > 0.0 { NARROW.min(MOST / all) } else { NARROW };
        Self { disks, chances, density, beside }
    }
}

impl DirectionalSource for Lamps<'_> {
    fn sample(&self, [u, v]: [f32; 2]) -> Option<DirectionSample> {
        let u = f64::from(u);
        let which = self.chances.partition_point(|&chance| chance <= u).min(self.disks.len().checked_sub(1)?);
        let before = if which == 0 { 0.0 } else { self.chances[which - 1] };
        let chance = self.chances[which] - before;
        let (disk, flux) = &self.disks[which];
        let within = ((u - before) / chance).clamp(0.0, 1.0 - f64::EPSILON) as f32;
        let direction = Direction::new(disk.direction([within.min(1.0 - f32::EPSILON), v]))?;
        let radiance = flux.map(|f| (f / chance * self.density) as f32);
        Some(DirectionSample { direction, density: self.density as f32, radiance })
    }

    fn density(&self, _: Direction) -> f32 {
        0.0
    }

    fn radiance(&self, direction: Direction) -> [f32; 3] {
        self.beside.map_or([0.0; 3], |beside| beside.radiance(direction))
    }
}
