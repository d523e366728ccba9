//! How the environment stands in the world.

use crate::error::{Error, Result};
use crate::geom::Up;
use glam::DMat3;

/// Which world axis is the environment's up, and how far it is turned about it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Orientation {
    up: Up,
    rotate_degrees: f64, // Invariant: finite.
}

impl Orientation {
    /// The environment's up along the world axis `up`, the light then turned by `rotate_degrees`
    /// counter-clockwise about it, seen from above: a lamp that shines from azimuth a then shines
    /// from a + `rotate_degrees`. With [`Up::Z`] and 0 the probe direction of world (x, y, z) is
    /// (x, z, −y): world +z is the probe's up and world −y the centre of the image.
    ///
    /// # Errors
    /// When the angle is not finite.
    pub fn new(up: Up, rotate_degrees: f64) -> Result<Self> {
        if !rotate_degrees.is_finite() {
            return Err(Error::argument(
                "env-rotate",
                rotate_degrees,
                "a finite angle in degrees",
                "give for example --env-rotate 90",
            ));
        }
        Ok(Self { up, rotate_degrees })
    }

    /// The world axis that points up.
    pub fn up(self) -> Up {
        self.up
    }

    /// How far the light is turned about up.
    pub fn rotate_degrees(self) -> f64 {
        self.rotate_degrees
    }

    /// The rotation from world directions to probe directions ([`super::latlong`]).
    ///
    /// Light that comes from probe direction d is turned to R_y(θ) d in the glTF frame, so the
    /// lookup turns back: probe_from_world = R_y(−θ) · gltf_from_world. Multiples of 90° are
    /// exact.
    pub fn probe_from_world(self) -> DMat3 {
        // Reduced to a quarter turn first, so that 90° gives exact zeros and 3600° costs nothing.
        let quarters = (self.rotate_degrees / 90.0).round();
        let rest = (self.rotate_degrees - 90.0 * quarters).to_radians();
        let (s, c) = (libm::sin(rest), libm::cos(rest));
        let (sin, cos) = match quarters.rem_euclid(4.0) as u8 {
            0 => (s, c),
            1 => (c, -s),
            2 => (-s, -c),
            _ => (-c, s),
        };
        // Columns of R_y(−θ): images of x, y, z.
        let turn_back = DMat3::from_cols_array(&[cos, 0.0, sin, 0.0, 1.0, 0.0, -sin, 0.0, cos]);
        turn_back * self.up.gltf_from_world()
    }

    /// The inverse of [`Orientation::probe_from_world`].
    pub fn world_from_probe(self) -> DMat3 {
        self.probe_from_world().transpose()
    }
}

#[cfg(test)]
mod tests;
