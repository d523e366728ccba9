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
mod tail;
mod total;
mod vertices;
mod window;

#[cfg(test)]
mod tests;
#[cfg(test)]
mod twin;

pub use clamp::ClampReport;
pub use contract::{Contracted, LuminaireLight, Noise, Textures, contract};
pub use exposure::{Exposure, without_negative};
pub use interpolate::{VertexTransfer, look_up_transfer, transfer_at_vertices};
pub use light::Light;
pub use lookup::{LookupReport, SurfaceError, VertexRadiance};
pub use tail::Tail;
pub use total::{ErrorTerm, Lookups, Scene, Seen, TotalError, total_error};
pub use vertices::{TriangleIndex, TriangleOrder};
pub use window::{LayerWindow, Prepared, prepare};

use crate::error::{Error, Result};
use crate::transfer::MAX_LAYERS;

/// Refuses a list that is not one entry a position.
pub(crate) fn check_count(what: &str, found: usize, positions: usize) -> Result<()> {
    if found == positions {
        return Ok(());
    }
    let expected = format!("{positions}: one a position");
    Err(Error::argument(what, found, expected, "give both lists of the same mesh"))
}

/// What one level set is made of, per colour channel (linear).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Diffuse reflectance in [0, 1].
    pub albedo: [f32; 3],
    /// Emitted radiance.
    pub emission: [f32; 3],
    /// What the layers of its transfer are.
    pub layers: LayerFactors,
}

/// What the layers of a transfer count for in radiance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum LayerFactors {
    /// Layer k is the light that the level set reflected k times: ρ^(k+1), with a tail beyond the last.
    #[default]
    Reflections,
    /// The same where media scatter light between reflections: what differs is the noise that is stated.
    ReflectionsInMedia,
    /// These, in red, green and blue, of a solid that light passes through: its surface has no albedo, and there is no tail.
    Given([[f32; 3]; MAX_LAYERS]),
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
        Ok(Self { albedo, emission, layers: LayerFactors::default() })
    }

    /// What layer k counts for in a channel.
    pub(crate) fn factor(&self, k: usize, channel: usize) -> f64 {
        match &self.layers {
            LayerFactors::Reflections | LayerFactors::ReflectionsInMedia => {
                (0..=k).fold(1.0, |power, _| power * f64::from(self.albedo[channel]))
            }
            LayerFactors::Given(factors) => f64::from(factors[k][channel]),
        }
    }

    /// What layer k counts for in the noise: of nodes, which share their paths, the one that counts most stands for all.
    pub(crate) fn noise_factor(&self, k: usize, channel: usize) -> f64 {
        let LayerFactors::Given(factors) = &self.layers else { return self.factor(k, channel) };
        let largest = (0..MAX_LAYERS).max_by(|&i, &j| factors[i][channel].abs().total_cmp(&factors[j][channel].abs()));
        let sum: f32 = factors.iter().map(|f| f[channel]).sum();
        if largest == Some(k) { f64::from(sum) } else { 0.0 }
    }

    /// Whether layers beyond the last are taken to go on as those before.
    pub(crate) fn has_tail(&self) -> bool {
        !matches!(self.layers, LayerFactors::Given(_))
    }

    /// Whether a path that ends elsewhere may do so anywhere, and not only after more reflections.
    pub(crate) fn scatters(&self) -> bool {
        self.layers != LayerFactors::Reflections
    }

    /// Radiance of a surface that nothing hides from the light, as it is where no transfer is found.
    pub(crate) fn unoccluded(&self, light: &Light, normal_in_world: [f32; 3]) -> [f32; 3] {
        let open = light.unoccluded(normal_in_world);
        std::array::from_fn(|c| self.albedo[c] * open[c] + self.emission[c])
    }

    /// Exitant radiance per visible cosine under a distant light of the given flux (radiance times solid
    /// angle): ρ/π · flux.
    #[doc(hidden)]
    pub fn sun_factor(&self, flux: [f64; 3]) -> [f32; 3] {
        std::array::from_fn(|c| (f64::from(self.albedo[c]) / std::f64::consts::PI * flux[c]) as f32)
    }
}
