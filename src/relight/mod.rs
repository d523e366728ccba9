//! The runtime module: a transfer texture, a light and a material make colours on an isosurface.
//! No file, no ray: everything here is a dot product, a lookup or a scale. Knows nothing of solvers.
//!
//! The order of work is the fast one: the bricks that the surface touches are *contracted* with the
//! light once (RGB radiance per texel, [`contract()`]), and vertices then look that up trilinearly
//! ([`Contracted::look_up`]). Changing the environment, its rotation, the albedo or the emission needs
//! only a new contraction; changing the exposure not even that.

mod contract;
mod exposure;
mod lookup;
mod tail;

#[cfg(test)]
mod tests;

pub use contract::{Contracted, Noise, contract};
pub use exposure::Exposure;
pub use lookup::{LookupReport, VertexRadiance};
pub use tail::Tail;

use crate::error::{Error, Result};
use crate::sh;
use crate::surface::straddling_cells;
use crate::transfer::{Lattice, Selection};
use crate::volume::Volume;

/// The texels that lookups anywhere on one isosurface read; `isovalue` in the file's values. None for an
/// isovalue out of range.
pub fn texels_of_isosurface(volume: &Volume, lattice: Lattice, isovalue: f64) -> Selection {
    let cells = straddling_cells(volume, isovalue);
    let mut selection = Selection::empty(lattice);
    for z in 0..cells.dims()[2] {
        cells.for_each_in_slab(z, |x, y| selection.insert_cell([x, y, z]));
    }
    selection
}

/// A distant environment as SH coefficients of linear radiance per colour channel, in world axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    // Invariant: bands² entries, finite.
    bands: usize,
    rgb: Vec<[f64; 3]>,
}

impl Light {
    /// A light from its coefficients, red, green and blue side by side.
    ///
    /// # Errors
    /// When the count is not a square of 1…11, or a coefficient is not finite.
    pub fn new(rgb: Vec<[f64; 3]>) -> Result<Self> {
        let bands = (1..=sh::MAX_BANDS).find(|n| n * n == rgb.len());
        match bands {
            Some(bands) if rgb.iter().flatten().all(|v| v.is_finite()) => Ok(Self { bands, rgb }),
            _ => Err(Error::argument(
                "environment",
                format!("{} coefficients", rgb.len()),
                "bands² finite coefficients, 1 to 11 bands",
                "project the probe again",
            )),
        }
    }

    /// The same radiance from everywhere.
    pub fn constant(radiance: [f64; 3]) -> Self {
        Self { bands: 1, rgb: vec![radiance.map(|v| v * 2.0 * std::f64::consts::PI.sqrt())] }
    }

    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.bands
    }

    /// Coefficients, red, green and blue side by side.
    pub fn coefficients(&self) -> &[[f64; 3]] {
        &self.rgb
    }

    /// The highest band that carries energy, plus one: what contraction needs to read.
    pub fn used_bands(&self) -> usize {
        (1..=self.bands)
            .rev()
            .find(|b| self.rgb[(b - 1) * (b - 1)..b * b].iter().flatten().any(|&v| v != 0.0))
            .unwrap_or(1)
    }

    /// Radiance that leaves an unoccluded surface of albedo 1 with normal `n`, per channel:
    /// Σ (A_l/π) Y_lm(n) L_lm.
    pub fn unoccluded(&self, normal_in_world: [f32; 3]) -> [f32; 3] {
        let mut basis = [0.0f64; sh::MAX_BANDS * sh::MAX_BANDS];
        sh::basis::evaluate(self.bands, normal_in_world.map(f64::from), &mut basis);
        let mut sum = [0.0f64; 3];
        for l in 0..self.bands {
            let factor = sh::CLAMPED_COSINE[l] / std::f64::consts::PI;
            for i in l * l..(l + 1) * (l + 1) {
                for channel in 0..3 {
                    sum[channel] += factor * basis[i] * self.rgb[i][channel];
                }
            }
        }
        sum.map(|v| v as f32)
    }
}

/// What one level set is made of, per colour channel (linear).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Diffuse reflectance in [0, 1].
    pub albedo: [f32; 3],
    /// Emitted radiance.
    pub emission: [f32; 3],
}

impl Material {
    /// A checked material.
    ///
    /// # Errors
    /// When an albedo is outside [0, 1] or an emission negative, or either is not finite.
    pub fn new(albedo: [f32; 3], emission: [f32; 3]) -> Result<Self> {
        if !albedo.iter().all(|a| (0.0..=1.0).contains(a)) {
            return Err(Error::argument(
                "albedo",
                format!("{albedo:?}"),
                "numbers from 0 to 1",
                "a surface cannot reflect more light than it receives",
            ));
        }
        if !emission.iter().all(|e| e.is_finite() && *e >= 0.0) {
            return Err(Error::argument(
                "emission",
                format!("{emission:?}"),
                "finite numbers of at least 0",
                "give radiance",
            ));
        }
        Ok(Self { albedo, emission })
    }
}
