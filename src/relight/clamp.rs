//! Negative radiance taken out of a contraction.
//!
//! Under light that is certified non-negative a texel can only come out below 0 through the bake: a
//! control variate, whose noise has both signs, or the rounding of the stored transfer.

use super::Contracted;
use super::contract::has_radiance;
use crate::transfer::BRICK_TEXELS;
use rayon::prelude::*;

/// What clamping changed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ClampReport {
    /// Valid texels with a negative channel.
    pub texels: u64,
    /// Valid texels contracted.
    pub of_texels: u64,
    /// Σ of the negative radiance taken out over Σ of the radiance that is left, all channels; 0 where
    /// nothing is left.
    pub energy: f64,
    /// The most negative value found; 0 when there was none.
    pub deepest: f32,
}

/// The sums of one brick.
#[derive(Clone, Copy, Default)]
struct Sums {
    texels: u64,
    of_texels: u64,
    removed: f64,
    left: f64,
    deepest: f32,
}

impl Contracted {
    /// Sets negative radiance to 0 in every valid texel. What is looked up afterwards is ≥ 0, because a
    /// lookup is a convex combination of texels (its fallback, the unoccluded normal, is ≥ 0 under
    /// certified light).
    pub fn clamp_negative(&mut self) -> ClampReport {
        let bricks: Vec<Sums> = self.radiance.par_iter_mut().map(clamp_brick).collect();
        let mut sums = Sums::default();
        for b in bricks {
            sums.texels += b.texels;
            sums.of_texels += b.of_texels;
            sums.removed += b.removed;
            sums.left += b.left;
            sums.deepest = sums.deepest.min(b.deepest);
        }
        if sums.of_texels > 0 {
            self.noise.mean_radiance = sums.left / (3.0 * sums.of_texels as f64);
        }
        let energy = if sums.left > 0.0 { sums.removed / sums.left } else { 0.0 };
        ClampReport { texels: sums.texels, of_texels: sums.of_texels, energy, deepest: sums.deepest }
    }
}

fn clamp_brick(brick: &mut [[f32; 4]; BRICK_TEXELS]) -> Sums {
    let mut sums = Sums::default();
    for texel in brick.iter_mut().filter(|t| has_radiance(t[3])) {
        sums.of_texels += 1;
        sums.texels += u64::from(texel[..3].iter().any(|&v| v < 0.0));
        for value in &mut texel[..3] {
            if *value < 0.0 {
                sums.removed -= f64::from(*value);
                sums.deepest = sums.deepest.min(*value);
                *value = 0.0;
            }
            sums.left += f64::from(*value);
        }
    }
    sums
}
