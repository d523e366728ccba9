//! Radiance samples scattered into a texture by Shepard's weights: the texture route of Beason (2005), for study.
//!
//! A texel takes the mean of the samples within D of it, weighted by their distance d (Shepard 1968, "A two-dimensional
//! interpolation function for irregularly-spaced data": Σ w L / Σ w), with
//!
//! * w = (D/d)⁵: the nearest samples decide, and at a sample its own radiance comes out ([`Shepard::InverseFifth`]);
//! * w = 1 − d/D: a tent, which blurs more and averages more noise ([`Shepard::Tent`]).
//!
//! Both end at D. Beason prints the exponent and the tent, not what a texel gets that no sample reaches; here it takes
//! the nearest sample however far that is, and is counted as empty. Distances are those of the world: on an anisotropic grid
//! the ball of samples is round there.

use super::photon::{Nearest, Node, Tree};
use glam::DVec3;
use rayon::prelude::*;

/// How a sample counts at a distance from a texel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shepard {
    /// (D/d)⁵ up to D.
    InverseFifth,
    /// 1 − d/D up to D.
    Tent,
}

impl Shepard {
    /// Both, in the order of tables.
    pub const ALL: [Self; 2] = [Self::InverseFifth, Self::Tent];

    /// A short name.
    pub fn name(self) -> &'static str {
        match self {
            Self::InverseFifth => "d^-5",
            Self::Tent => "tent",
        }
    }

    /// The weight at a squared distance in squared radii, t = (d/D)²: not negative, 0 from the radius on, infinite at 0 for the
    /// inverse power.
    pub fn weight(self, t: f64) -> f64 {
        if t >= 1.0 {
            return 0.0;
        }
        match self {
            Self::InverseFifth => 1.0 / (t * t * t.sqrt()),
            Self::Tent => 1.0 - t.sqrt(),
        }
    }
}

/// A sample as the tree keeps it.
struct Placed {
    point: [f32; 4],
    // In the order in which samples were given.
    number: u32,
    axis: u8,
}

impl Node for Placed {
    fn point(&self) -> &[f32; 4] {
        &self.point
    }

    fn axis(&self) -> u8 {
        self.axis
    }

    fn split_by(&mut self, axis: u8) {
        self.axis = axis;
    }
}

/// Where samples lie.
pub struct Scatter {
    tree: Tree<Placed>,
    // What is subtracted from positions before they are rounded: the mean of the samples.
    centre: DVec3,
    radius: f64,
}

/// What a texel hears of: numbers of samples with (d/D)².
struct Heard {
    samples: Vec<(f64, usize)>,
    // Whether none is within D; `samples` then is the nearest one.
    empty: bool,
}

/// Texels that were filled.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scattered {
    /// Radiance of each texel; 0 if there is no sample at all.
    pub radiance: Vec<[f64; 3]>,
    /// Texels that no sample reaches within D: they have that of the nearest one.
    pub empty: u64,
}

impl Scatter {
    /// Samples at positions in world, each of which reaches texels within `radius`, in the unit of the world. At most 2³² − 1
    /// samples.
    ///
    /// # Panics
    /// When the radius is not a positive number.
    pub fn new(samples_in_world: &[DVec3], radius: f64) -> Self {
        assert!(radius > 0.0 && radius.is_finite(), "a radius of {radius}");
        let centre = samples_in_world.iter().sum::<DVec3>() / samples_in_world.len().max(1) as f64;
        let placed = samples_in_world.iter().enumerate();
        let placed = placed.map(|(i, p)| Placed { point: local(*p, centre), number: i as u32, axis: 0 });
        Self { tree: Tree::new(placed.collect()), centre, radius }
    }

    /// Which samples some of these texels hear of: only they need a radiance.
    pub fn needed(&self, texels_in_world: &[DVec3]) -> Vec<bool> {
        let mut needed = vec![false; self.tree.in_order().len()];
        for heard in self.hear(texels_in_world) {
            heard.samples.iter().for_each(|(_, i)| needed[*i] = true);
        }
        needed
    }

    /// Fills texels from the radiance of the samples.
    ///
    /// # Panics
    /// When there are not as many radiances as samples.
    pub fn fill(&self, texels_in_world: &[DVec3], radiance: &[[f64; 3]], weight: Shepard) -> Scattered {
        assert_eq!(radiance.len(), self.tree.in_order().len());
        let mut out = Scattered::default();
        for heard in self.hear(texels_in_world) {
            out.empty += u64::from(heard.empty);
            out.radiance.push(heard.mean(radiance, weight));
        }
        out
    }

    fn hear(&self, texels_in_world: &[DVec3]) -> Vec<Heard> {
        let one = |nearest: &mut Nearest, texel: &DVec3| self.hear_at(*texel, nearest);
        texels_in_world.par_iter().map_init(Nearest::default, one).collect()
    }

    fn hear_at(&self, texel: DVec3, nearest: &mut Nearest) -> Heard {
        let (at, scale) = (local(texel, self.centre), 1.0 / (self.radius * self.radius));
        self.tree.nearest(at, usize::MAX, (self.radius * self.radius) as f32, nearest);
        let of =
            |(squared, place): (f32, usize)| (f64::from(squared) * scale, self.tree.in_order()[place].number as usize);
        let mut samples: Vec<(f64, usize)> = nearest.places().map(of).filter(|(t, _)| *t < 1.0).collect();
        // Sums in an order that no tree decides.
        samples.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let empty = samples.is_empty();
        if empty {
            self.tree.nearest(at, 1, f32::INFINITY, nearest);
            samples = nearest.places().map(of).collect();
        }
        Heard { samples, empty }
    }
}

impl Heard {
    fn mean(&self, radiance: &[[f64; 3]], weight: Shepard) -> [f64; 3] {
        let (mut sum, mut weights) = ([0.0; 3], 0.0);
        for &(t, i) in &self.samples {
            let w = if self.empty { 1.0 } else { weight.weight(t) };
            if w == f64::INFINITY {
                // On a sample: the limit of the mean.
                return radiance[i];
            }
            (0..3).for_each(|c| sum[c] += w * radiance[i][c]);
            weights += w;
        }
        if weights > 0.0 { sum.map(|v| v / weights) } else { sum }
    }
}

fn local(in_world: DVec3, centre: DVec3) -> [f32; 4] {
    let [x, y, z] = (in_world - centre).as_vec3().to_array();
    [x, y, z, 0.0]
}

#[cfg(test)]
mod tests;
