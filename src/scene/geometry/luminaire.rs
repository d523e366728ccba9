//! Luminaires as described.

use crate::sampling::DirectionalSource;
use glam::DVec3;
use std::fmt;
use std::sync::Arc;

/// A source of light that is not distant, or distant from one direction.
#[derive(Clone, Debug, PartialEq)]
pub struct Luminaire {
    /// Its name: letters, digits, `-` and `_`.
    pub name: String,
    /// What it is.
    pub shape: LuminaireShape,
    /// Power in watts as if all of it were in that channel (90 W of white light are 90, 90, 90); for a directional
    /// one irradiance across its direction in W m⁻², for a shining wall radiance in W m⁻² sr⁻¹, for an environment a factor on its
    /// radiance.
    pub power: [f64; 3],
}

/// What a luminaire is.
#[derive(Clone, Debug, PartialEq)]
pub enum LuminaireShape {
    /// A parallelogram that shines to the side of u × v, equally bright from everywhere; black to light that meets it.
    Rectangle {
        /// One corner.
        corner: DVec3,
        /// From it along one edge.
        u: DVec3,
        /// From it along the other edge.
        v: DVec3,
    },
    /// A sphere, equally bright from everywhere; black to light that meets it.
    Sphere {
        /// Its centre.
        centre: DVec3,
        /// Its radius.
        radius: f64,
    },
    /// A point, the same in all directions.
    Point {
        /// Where.
        position: DVec3,
    },
    /// Parallel light.
    Directional {
        /// Unit vector to the light.
        towards: DVec3,
    },
    /// The wall of this name, on its front, besides what it reflects.
    Wall(String),
    /// The medium of this name, wherever it lies: `power` is the radiance of a piece so large that it is opaque.
    Medium(String),
    /// A whole environment, without limit of bands; what it is worth is its radiance times the power.
    Environment(DistantLight),
}

/// An environment that is fixed before the bake.
#[derive(Clone)]
pub struct DistantLight {
    source: Arc<dyn DirectionalSource + Send + Sync>,
    // Of the image, its place and all that decides radiance.
    fingerprint: String,
    // ∫ L dω of each channel, negative ones as 0.
    total: [f64; 3],
}

impl DistantLight {
    /// An environment in world axes, by a name that no other has: a hash of what decides its radiance; `total` is the integral of its
    /// radiance over all directions, of each channel.
    pub fn new(
        source: Arc<dyn DirectionalSource + Send + Sync>,
        fingerprint: impl Into<String>,
        total: [f64; 3],
    ) -> Self {
        Self { source, fingerprint: fingerprint.into(), total }
    }

    /// Its radiance.
    #[doc(hidden)]
    pub fn source(&self) -> &dyn DirectionalSource {
        &*self.source
    }

    /// (1/π) ∫ L dω: no diffuse surface of albedo 1 is brighter by it.
    pub(super) fn bound(&self) -> [f64; 3] {
        self.total.map(|v| if v < 0.0 { 0.0 } else { v / std::f64::consts::PI })
    }
}

impl PartialEq for DistantLight {
    fn eq(&self, other: &Self) -> bool {
        self.fingerprint == other.fingerprint
    }
}

/// As the fingerprints of scenes take it.
impl fmt::Debug for DistantLight {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.fingerprint)
    }
}
