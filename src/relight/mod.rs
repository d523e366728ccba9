//! The runtime module: a transfer texture, a light and a material make colours on an isosurface.
//! No file, no ray: everything here is a dot product, a lookup or a scale. Knows nothing of solvers.
//!
//! The order of work is the fast one: the bricks that the surface touches are *contracted* with the
//! light once (RGB radiance per texel, [`contract()`]), and vertices then look that up trilinearly
//! ([`Contracted::look_up`]). Changing the environment, its rotation, the albedo or the emission needs
//! only a new contraction; changing the exposure not even that.
//!
//! Before it, [`prepare`] cuts and windows the light for each layer; after it,
//! [`Contracted::clamp_negative`] and [`VertexRadiance::add_sun`] are options.

mod block;
mod clamp;
mod contract;
mod exposure;
mod interpolate;
mod light;
mod lookup;
mod noise;
mod scene;
mod tail;
mod window;

#[cfg(test)]
mod tests;
#[cfg(test)]
mod twin;

pub use clamp::ClampReport;
pub use contract::{Contracted, Noise, contract};
pub use exposure::Exposure;
pub use interpolate::{VertexTransfer, look_up_transfer};
pub use light::Light;
pub use lookup::{LookupReport, SurfaceError, VertexRadiance};
pub use scene::{LuminaireLight, contract_scene};
pub use tail::Tail;
pub use window::{LayerWindow, Prepared, prepare};

use crate::error::{Error, Result};
use crate::surface::straddling_cells;
use crate::transfer::{CHUNK, Lattice, Selection};
use crate::volume::{Sample, Volume, with_samples};
use rayon::prelude::*;

/// Slabs of cells that a thread marks in a row: enough that few sets are merged.
const SLABS: usize = 64;

/// The texels that lookups anywhere on one isosurface read; `isovalue` in the file's values. None for an
/// isovalue out of range.
pub fn texels_of_isosurface(volume: &Volume, lattice: Lattice, isovalue: f64) -> Selection {
    let cells = straddling_cells(volume, isovalue);
    // Each thread marks the cells of some slabs in a set of its own.
    let slabs = (0..cells.dims()[2]).into_par_iter().with_min_len(SLABS);
    let sets = slabs.fold(
        || Selection::empty(lattice),
        |mut selection, z| {
            cells.for_each_in_slab(z, |x, y| selection.insert_cell([x, y, z]));
            selection
        },
    );
    sets.reduce_with(Selection::with).unwrap_or_else(|| Selection::empty(lattice))
}

/// The extent in raw values (largest minus smallest corner) of the cells that one isosurface crosses, summed over
/// each chunk of the texture, x fastest: how much of the field's range a chunk shows, so what to bake first.
/// Isosurfaces of other isovalues, too, meet steep cells more often (importance by extent: Beason 2005).
pub fn extents_by_chunk(volume: &Volume, lattice: Lattice, isovalue: f64) -> Vec<f64> {
    let cells = straddling_cells(volume, isovalue);
    let [cx, cy, cz] = lattice.chunks();
    let [nx, ny, _] = volume.dims();
    let mut sums = vec![0.0; cx * cy * cz];
    let corners: [usize; 8] = std::array::from_fn(|i| (i & 1) + nx * ((i >> 1 & 1) + ny * (i >> 2)));
    with_samples!(volume.samples(), s => {
        for z in 0..cells.dims()[2] {
            cells.for_each_in_slab(z, |x, y| {
                let values = corners.map(|offset| s[x + nx * (y + ny * z) + offset].raw());
                let high = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                let low = values.iter().copied().fold(f32::INFINITY, f32::min);
                let cell = [x, y, z];
                let [i, j, k] = std::array::from_fn(|a| (cell[a] as f64 / lattice.step(a)) as usize / CHUNK);
                sums[i.min(cx - 1) + cx * (j.min(cy - 1) + cy * k.min(cz - 1))] += f64::from(high) - f64::from(low);
            });
        }
    });
    sums
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

    /// Exitant radiance per visible cosine under a distant light of the given flux (radiance times solid
    /// angle): ρ/π · flux.
    pub fn sun_factor(&self, flux: [f64; 3]) -> [f32; 3] {
        std::array::from_fn(|c| (f64::from(self.albedo[c]) / std::f64::consts::PI * flux[c]) as f32)
    }
}
