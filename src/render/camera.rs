//! Cameras around the box of a volume, from named views.
//!
//! A view is seen in the glTF frame (y up, see [`crate::geom::Up`]): *front* looks along −z of that
//! frame with +x to the right, *right* has the camera on +x, *top* on +y. In a patient's frame the
//! front is anterior, and *left* and *right* are the patient's: *left* has the camera on +x.

use crate::geom::{Bounds, Up};
use crate::scene::nearest;
use glam::{DMat3, DVec3};
use std::str::FromStr;

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
    /// The named views of a volume that stands as `up` says: front, back, left, right, top, bottom, and iso (a raised
    /// three-quarter view; in a patient's frame from the front left).
    pub fn named(name: &str, up: Up) -> Option<Self> {
        let right = if up.is_anatomical() { -90.0 } else { 90.0 };
        let (azimuth, elevation) = match name {
            "front" => (0.0, 0.0),
            "back" => (180.0, 0.0),
            "right" => (right, 0.0),
            "left" => (-right, 0.0),
            "top" => (0.0, 90.0),
            "bottom" => (0.0, -90.0),
            "iso" => (35.0, 25.0),
            _ => return None,
        };
        Some(Self { azimuth, elevation })
    }
}

/// Names of views.
pub const VIEWS: [&str; 7] = ["front", "back", "left", "right", "top", "bottom", "iso"];

/// A view by name, or by angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Viewpoint {
    /// By a name of [`VIEWS`].
    Named(&'static str),
    /// By angles.
    At(View),
}

impl FromStr for Viewpoint {
    /// What to give instead.
    type Err = String;

    /// Reads a name of [`VIEWS`], or AZIMUTH,ELEVATION in degrees.
    fn from_str(name: &str) -> Result<Self, String> {
        if let Some(name) = VIEWS.iter().find(|known| **known == name) {
            return Ok(Viewpoint::Named(name));
        }
        let angles = name.split_once(',').and_then(|(a, e)| Some((a.trim().parse().ok()?, e.trim().parse().ok()?)));
        match angles {
            Some((azimuth, elevation)) if f64::abs(azimuth) <= 3600.0 && f64::abs(elevation) <= 90.0 => {
                Ok(Viewpoint::At(View { azimuth, elevation }))
            }
            _ => Err(match nearest(name, VIEWS) {
                Some(near) => format!("did you mean {near}?"),
                None => format!("give one of {}, or AZIMUTH,ELEVATION in degrees", VIEWS.join(", ")),
            }),
        }
    }
}

impl Viewpoint {
    /// The view of a volume that stands as `up` says.
    pub fn view(self, up: Up) -> View {
        match self {
            // Names come from `VIEWS`, all of which are known.
            Self::Named(name) => View::named(name, up).unwrap_or(View { azimuth: 0.0, elevation: 0.0 }),
            Self::At(view) => view,
        }
    }

    /// In words: the name, the side it is of a patient, and the angles.
    pub fn describe(self, up: Up) -> String {
        let View { azimuth, elevation } = self.view(up);
        let angles = format!("azimuth {azimuth}°, elevation {elevation}°");
        let Self::Named(name) = self else { return format!("view {angles}") };
        let side = match name {
            "front" => ", anterior",
            "back" => ", posterior",
            "left" | "right" => ", the patient's",
            "top" => ", superior",
            "bottom" => ", inferior",
            _ => ", front left",
        };
        format!("view {name}{} ({angles})", if up.is_anatomical() { side } else { "" })
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
        let corner = |i: usize| {
            let pick = |a: usize| if i >> a & 1 == 0 { bounds.min[a] } else { bounds.max[a] };
            DVec3::new(pick(0), pick(1), pick(2))
        };
        Self::framing_points((0..8).map(corner), up, view, projection, aspect)
    }

    /// A camera that has all the points in view, as close as it can; around the origin when there is none.
    pub fn framing_points(
        points_in_world: impl Iterator<Item = DVec3>,
        up: Up,
        view: View,
        projection: Projection,
        aspect: f64,
    ) -> Self {
        let world_from_gltf: DMat3 = up.gltf_from_world().transpose();
        let (azimuth, elevation) = (view.azimuth.to_radians(), view.elevation.to_radians());
        let (sa, ca) = libm::sincos(azimuth);
        let (se, ce) = libm::sincos(elevation);
        let backward = DVec3::new(ce * sa, se, ce * ca);
        let right = DVec3::new(ca, 0.0, -sa);
        let world_from_view = world_from_gltf * DMat3::from_cols(right, backward.cross(right), backward);
        // The box of the points along the axes of the picture and the line of sight.
        let view_from_world = world_from_view.transpose();
        let seen = points_in_world.fold(Bounds::EMPTY, |bounds, p| bounds.including(view_from_world * p));
        let seen = if seen.min.is_finite() { seen } else { Bounds { min: DVec3::ZERO, max: DVec3::ZERO } };
        let half = 0.5 * seen.size();
        let half_height = half.y.max(half.x / aspect).max(f64::MIN_POSITIVE) * 1.04;
        let (distance, half_height) = match projection {
            Projection::Orthographic => (f64::INFINITY, half_height),
            Projection::Perspective(fov) => {
                // What is in view at the near face of the box is in view everywhere behind it.
                let tangent = libm::tan(0.5 * fov.clamp(1.0, 150.0).to_radians());
                (half_height / tangent + half.z, half_height + half.z * tangent)
            }
        };
        let DMat3 { x_axis: right, y_axis: up, z_axis: backward } = world_from_view;
        Self {
            centre: world_from_view * seen.centre(),
            right,
            up,
            backward,
            half_height,
            distance,
            reach: 2.0 * half.length(),
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Where the eye stands, from the middle of a cube.
    fn eye(name: &str, up: Up) -> DVec3 {
        let bounds = Bounds { min: DVec3::splat(-1.0), max: DVec3::splat(1.0) };
        let view = View::named(name, up).unwrap();
        let (origin, direction) = Camera::framing(&bounds, up, view, Projection::Orthographic, 1.0).ray(0.0, 0.0, 1.0);
        assert!((origin.normalize() + direction.normalize()).length() < 1e-12, "{name} looks at the middle");
        origin.normalize()
    }

    #[test]
    fn named_views_are_the_sides_of_a_patient_in_an_anatomical_frame() {
        // RAS+: right is +x, anterior +y, superior +z.
        let sides = [
            ("front", DVec3::Y),
            ("back", DVec3::NEG_Y),
            ("left", DVec3::NEG_X),
            ("right", DVec3::X),
            ("top", DVec3::Z),
            ("bottom", DVec3::NEG_Z),
        ];
        for (name, side) in sides {
            assert!((eye(name, Up::Anatomical) - side).length() < 1e-12, "{name}");
        }
        let iso = eye("iso", Up::Anatomical);
        assert!(iso.x < -0.3 && iso.y > 0.3 && iso.z > 0.3, "from the front left, above: {iso}");
    }

    #[test]
    fn named_views_are_the_sides_of_the_grid_elsewhere() {
        let sides = [("front", DVec3::NEG_Y), ("back", DVec3::Y), ("left", DVec3::NEG_X), ("right", DVec3::X)];
        for (name, side) in sides {
            assert!((eye(name, Up::Z) - side).length() < 1e-12, "{name}");
        }
    }
}
