//! Cameras around the box of a volume, from named views.
//!
//! A view is seen in the glTF frame (y up, see [`crate::geom::Up`]): *front* looks along −z of that
//! frame with +x to the right, *right* has the camera on +x, *top* on +y.

use crate::geom::{Bounds, Up};
use glam::{DMat3, DVec3};

/// Parallel or perspective projection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// All rays parallel.
    Orthographic,
    /// Vertical field of view in degrees.
    Perspective(f64),
}

/// Where the camera stands, as angles in degrees in the glTF frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Counter-clockwise about up, seen from above; 0 = front (camera on +z), 90 = right (on +x).
    pub azimuth: f64,
    /// Above the horizon.
    pub elevation: f64,
}

impl View {
    /// The named views: front, back, left, right, top, bottom, and iso (a raised three-quarter view).
    pub fn named(name: &str) -> Option<Self> {
        let (azimuth, elevation) = match name {
            "front" => (0.0, 0.0),
            "back" => (180.0, 0.0),
            "right" => (90.0, 0.0),
            "left" => (-90.0, 0.0),
            "top" => (0.0, 90.0),
            "bottom" => (0.0, -90.0),
            "iso" => (35.0, 25.0),
            _ => return None,
        };
        Some(Self { azimuth, elevation })
    }
}

/// A camera in world space.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    centre: DVec3,
    right: DVec3,
    up: DVec3,
    backward: DVec3,
    // Half the height of the picture at the centre, world units.
    half_height: f64,
    // Distance of the eye from the centre; infinite for parallel rays.
    distance: f64,
    // Beyond the box from any point of the picture plane; where parallel rays start.
    reach: f64,
}

impl Camera {
    /// A camera that looks at the centre of `bounds` and has all of it in view, for a picture of the given
    /// aspect (width over height).
    pub fn framing(bounds: &Bounds, up: Up, view: View, projection: Projection, aspect: f64) -> Self {
        let world_from_gltf: DMat3 = up.gltf_from_world().transpose();
        let (azimuth, elevation) = (view.azimuth.to_radians(), view.elevation.to_radians());
        let (sa, ca) = libm::sincos(azimuth);
        let (se, ce) = libm::sincos(elevation);
        let backward = DVec3::new(ce * sa, se, ce * ca);
        let right = DVec3::new(ca, 0.0, -sa);
        let up = backward.cross(right);
        let [right, up, backward] = [right, up, backward].map(|v| world_from_gltf * v);
        // Extent of the box along the picture's axes.
        let half = 0.5 * bounds.size();
        let reach = |axis: DVec3| half.dot(axis.abs());
        let half_height = reach(up).max(reach(right) / aspect).max(f64::MIN_POSITIVE) * 1.04;
        let (distance, half_height) = match projection {
            Projection::Orthographic => (f64::INFINITY, half_height),
            Projection::Perspective(fov) => {
                let tangent = libm::tan(0.5 * fov.clamp(1.0, 150.0).to_radians());
                (half_height / tangent + reach(backward), half_height * (1.0 + reach(backward) * tangent / half_height))
            }
        };
        Self { centre: bounds.centre(), right, up, backward, half_height, distance, reach: bounds.size().length() }
    }

    /// Origin and direction in world space of the ray through a point of the picture: `x`, `y` in [−1, 1]
    /// with y up, both in units of half the height times `aspect` for x.
    pub fn ray(&self, x: f64, y: f64, aspect: f64) -> (DVec3, DVec3) {
        let target = self.centre + self.half_height * (x * aspect * self.right + y * self.up);
        if self.distance.is_finite() {
            let eye = self.centre + self.distance * self.backward;
            (eye, target - eye)
        } else {
            (target + self.reach * self.backward, -self.backward)
        }
    }
}
