//! Where a path goes on: about a normal, by the cosine, or in a medium, by its phase function; and what media do to it on the
//! way.

use super::media::{Collision, Media};
use super::specular_chain;
use crate::geom::{Frame, Normal};
use crate::sampling::{PathSampler, warp};
use crate::scene::medium::MOST_MEDIA;
use glam::DVec3;
use std::f64::consts::PI;

/// Collisions after which roulette begins.
const SURE_COLLISIONS: u32 = 8;
/// Collisions at which a path is cut, and counted as trapped.
pub(super) const MOST_COLLISIONS: u32 = 4096;
/// Pairs of random numbers of flights start here, behind those of mirrors and glass.
const FIRST_FLIGHT: u32 = 1 << 28;
/// The pair by which a path draws its channel: in front of those of mirrors and glass.
const CHANNEL: u32 = (1 << 24) - 1;

/// How a path goes on from a turn.
#[derive(Clone, Copy)]
pub(super) enum Scatter {
    /// Diffusely about a normal.
    Surface(Normal),
    /// Out of a translucent solid, about the normal of its boundary.
    Body(Normal),
    /// In a medium, from the direction in which it flew.
    Medium { onward: DVec3, medium: usize },
}

impl Scatter {
    /// The next direction from two variates, and its density per steradian.
    pub(super) fn sample(&self, media: &Media<'_>, u: [f32; 2]) -> (DVec3, f64) {
        match *self {
            Self::Surface(normal) | Self::Body(normal) => {
                let local = warp::square_to_cosine_hemisphere(u);
                let direction = Frame::around(normal).from_local(local).as_dvec3().normalize_or(DVec3::Z);
                (direction, self.density(media, direction))
            }
            Self::Medium { onward, medium } => {
                let phase = media.phase(medium);
                let cosine = phase.cosine(f64::from(u[0]));
                let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
                let (y, x) = libm::sincos(2.0 * PI * f64::from(u[1]));
                let tangent = onward.any_orthonormal_vector();
                let direction = cosine * onward + sine * (x * tangent + y * onward.cross(tangent));
                (direction.normalize_or(onward), phase.density(cosine))
            }
        }
    }

    /// Density per steradian of going on in a direction: what light from there is worth, of an albedo of 1.
    pub(super) fn density(&self, media: &Media<'_>, direction: DVec3) -> f64 {
        match *self {
            Self::Surface(normal) | Self::Body(normal) => direction.dot(normal.vec().as_dvec3()).max(0.0) / PI,
            Self::Medium { onward, medium } => media.phase(medium).density(onward.dot(direction).clamp(-1.0, 1.0)),
        }
    }
}

/// What media have done to a path so far.
///
/// Where they dim channels differently a path flies in one of them, drawn once. With the product P_c of the densities of its
/// flights, had it flown in channel c, and the mean of these over all channels, its weight in c is P_c over that mean: never
/// above 3. (Drawn anew at each flight it could reach 3ⁿ.)
#[derive(Clone, Copy)]
pub(super) struct InMedia {
    channel: usize,
    // Whether all channels are dimmed alike, so that the odds stay 1.
    grey: bool,
    // Relative to each other alone.
    odds: [f64; 3],
    collisions: u32,
}

impl InMedia {
    /// A path that begins.
    pub(super) fn new(media: &Media<'_>, sampler: &PathSampler, index: u32) -> Self {
        let channel = match media.is_grey() {
            true => 0,
            false => (3.0 * sampler.pair(index, CHANNEL)[0]) as usize,
        };
        Self { channel: channel.min(2), grey: media.is_grey(), odds: [1.0; 3], collisions: 0 }
    }

    /// A path that has not entered the translucent solid, if there is one.
    pub(super) fn of_body(media: Option<&Media<'_>>, sampler: &PathSampler, index: u32) -> Self {
        media.map_or(Self { channel: 0, grey: true, odds: [1.0; 3], collisions: 0 }, |media| {
            Self::new(media, sampler, index)
        })
    }

    /// The weight of a path in each channel, with what the media have done to it.
    #[inline]
    pub(super) fn carried(&self, weight: [f64; 3]) -> [f64; 3] {
        if self.grey {
            return weight;
        }
        let mean = (self.odds[0] + self.odds[1] + self.odds[2]) / 3.0;
        std::array::from_fn(|c| weight[c] * (self.odds[c] / mean))
    }

    /// A flight up to a distance; where it met a medium. Each flight of a path has its turn and the mirrors and glass since.
    pub(super) fn fly(
        &mut self,
        media: &Media<'_>,
        (origin, direction, distance): (DVec3, DVec3, f64),
        (sampler, index): (&PathSampler, u32),
        (turn, in_a_row): (u32, u32),
        counts: &mut super::SceneCounts,
    ) -> Option<Collision> {
        let first = FIRST_FLIGHT + (turn * specular_chain::MOST + in_a_row) * MOST_MEDIA as u32;
        let variate = |m: usize| f64::from(sampler.pair(index, first + m as u32)[0]);
        self.fly_by(media, (origin, direction, distance), &variate, counts)
    }

    /// The same by variates, one a medium.
    pub(super) fn fly_by(
        &mut self,
        media: &Media<'_>,
        (origin, direction, distance): (DVec3, DVec3, f64),
        variate: &dyn Fn(usize) -> f64,
        counts: &mut super::SceneCounts,
    ) -> Option<Collision> {
        let flown = media.fly(origin, direction, distance, self.channel, variate, counts);
        if !media.is_grey() {
            // Only ratios count: the least depth goes out, and the largest of the products.
            let least = flown.depth.into_iter().fold(f64::INFINITY, f64::min);
            for c in 0..3 {
                let density = flown.collision.map_or(1.0, |collision| collision.extinction[c]);
                self.odds[c] *= density * libm::exp(least - flown.depth[c]);
            }
            let largest = self.odds.into_iter().fold(f64::MIN_POSITIVE, f64::max);
            self.odds = self.odds.map(|p| p / largest);
        }
        flown.collision
    }

    /// Counts a collision of a path whose largest weight behind it is given; by what to divide the weight, or how it ended.
    pub(super) fn collided(&mut self, largest: f64, variate: f32) -> Result<f64, Ended> {
        self.collisions += 1;
        if self.collisions >= MOST_COLLISIONS {
            return Err(Ended::Trapped);
        }
        if largest <= 0.0 {
            return Err(Ended::Absorbed);
        }
        if self.collisions <= SURE_COLLISIONS || largest >= 1.0 {
            return Ok(1.0);
        }
        if f64::from(variate) < largest { Ok(largest) } else { Err(Ended::Absorbed) }
    }
}

/// Why a path ended in a medium.
pub(super) enum Ended {
    /// By its albedo.
    Absorbed,
    /// At the most collisions.
    Trapped,
}
