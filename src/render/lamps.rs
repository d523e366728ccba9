//! Lamps that were split off an environment, as one source of light for paths among walls and other volumes.

use super::sun::{Disk, SunLight};
use crate::geom::Direction;
use crate::sampling::{DirectionSample, DirectionalSource};

/// Density per steradian that stands for that of a lamp, whose own is not known anywhere but where it was drawn. It is so far above that
/// of any way on that combining the two by the balance heuristic leaves the lamp all: what a path brings that happens on a lamp does not count.
const NARROW: f64 = 1e12;

/// Some lamps, of which each draw takes one by its flux, and lights as all of them do; an environment of low bands may shine beside
/// them, which is found by paths that happen on it.
pub struct Lamps<'a> {
    disks: Vec<(Disk, [f64; 3])>,
    /// Running sum of the chances, up to 1.
    chances: Vec<f64>,
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
        Self { disks, chances, beside }
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
        let radiance = flux.map(|f| (f / chance * NARROW) as f32);
        Some(DirectionSample { direction, density: NARROW as f32, radiance })
    }

    fn density(&self, _: Direction) -> f32 {
        0.0
    }

    fn radiance(&self, direction: Direction) -> [f32; 3] {
        self.beside.map_or([0.0; 3], |beside| beside.radiance(direction))
    }
}
