//! Luminaires as described.

use glam::DVec3;

/// A source of light that is not distant, or distant from one direction.
#[derive(Clone, Debug, PartialEq)]
pub struct Luminaire {
    /// Its name: letters, digits, `-` and `_`.
    pub name: String,
    /// What it is.
    pub shape: LuminaireShape,
    /// Power in watts as if all of it were in that channel (90 W of white light are 90, 90, 90); for a directional
    /// one irradiance across its direction in W m⁻², for a shining wall radiance in W m⁻² sr⁻¹.
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
}
