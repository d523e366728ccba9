//! How the environment stands in the world.

use crate::error::{Error, Result};
use crate::geom::Up;
use glam::DMat3;

/// Where the centre of a lat-long image lies in the frame of glTF.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EnvFrame {
    /// At +X, as in Blender and three.js: the probe frame is the glTF frame.
    #[default]
    Gltf,
    /// At +Z, as OpenEXR defines its latlong environments: a quarter turn clockwise seen from above.
    OpenExr,
}

impl EnvFrame {
    /// The name used on the command line and in records.
    pub fn name(self) -> &'static str {
        match self {
            Self::Gltf => "gltf",
            Self::OpenExr => "openexr",
        }
    }

    /// How far light is turned about up, counter-clockwise in degrees, from the probe frame to glTF.
    fn degrees(self) -> f64 {
        match self {
            Self::Gltf => 0.0,
            Self::OpenExr => -90.0,
        }
    }
}

/// How world stands in the glTF frame, and how far the environment is turned about up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Orientation {
    up: Up,
    rotate_degrees: f64, // Invariant: finite.
    frame: EnvFrame,
}

impl Orientation {
    /// The environment's up along the world axis `up`, the light then turned by `rotate_degrees`
    /// counter-clockwise about it, seen from above: a lamp that shines from azimuth a then shines
    /// from a + `rotate_degrees`. With 0 the probe direction of world (x, y, z) is (x, z, −y) for
    /// [`Up::Z`]: world +z is the probe's up and world +x the centre of the image; for
    /// [`Up::Anatomical`] it is (−x, z, y): the patient's left is the centre, anterior three
    /// quarters from the left.
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
        Ok(Self { up, rotate_degrees, frame: EnvFrame::Gltf })
    }

    /// The same for images whose centre lies where `frame` says.
    #[must_use]
    pub fn in_frame(self, frame: EnvFrame) -> Self {
        Self { frame, ..self }
    }

    /// Where the centre of the image lies.
    #[doc(hidden)]
    pub fn frame(self) -> EnvFrame {
        self.frame
    }

    /// The world axis that points up.
    #[doc(hidden)]
    pub fn up(self) -> Up {
        self.up
    }

    /// How far the light is turned about up.
    #[doc(hidden)]
    pub fn rotate_degrees(self) -> f64 {
        self.rotate_degrees
    }

    /// The rotation from world directions to probe directions ([`super::latlong`]).
    ///
    /// Light that comes from probe direction d is turned to R_y(θ) d in the glTF frame, so the
    /// lookup turns back: probe_from_world = R_y(−θ) · gltf_from_world. Multiples of 90° are
    /// exact.
    #[doc(hidden)]
    pub fn probe_from_world(self) -> DMat3 {
        // Reduced to a quarter turn first, so that 90° gives exact zeros and 3600° costs nothing.
        let quarters = (self.rotate_degrees / 90.0).round();
        let rest = (self.rotate_degrees - 90.0 * quarters).to_radians();
        let quarters = quarters.rem_euclid(4.0) + self.frame.degrees() / 90.0;
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
    #[doc(hidden)]
    pub fn world_from_probe(self) -> DMat3 {
        self.probe_from_world().transpose()
    }
}

#[cfg(test)]
mod tests;
