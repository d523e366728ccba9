//! Sphere, bowl, gyroid, torus, sphere over plane.

use super::{Field, Solid};
use crate::error::{Error, Result};
use crate::geom::Bounds;
use glam::DVec3;
use std::f64::consts::TAU;

const UNIT_BOX: Bounds = Bounds { min: DVec3::NEG_ONE, max: DVec3::ONE };

/// h = −‖x‖ on \[−1, 1\]³: level sets are solid spheres, −0.6 one of radius 0.6. Convex: the
/// transfer is the clamped cosine.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sphere;

impl Field for Sphere {
    fn name(&self) -> &'static str {
        "sphere"
    }

    fn value(&self, point_in_world: DVec3) -> f64 {
        -point_in_world.length()
    }

    fn convex_side(&self) -> Option<Solid> {
        Some(Solid::Above)
    }

    fn bounds(&self) -> Bounds {
        UNIT_BOX
    }

    fn default_isovalue(&self) -> f64 {
        -0.6
    }
}

/// h = ‖x‖ on \[−1, 1\]² × \[−1, 0\]: light inside, open at z = 0. Form factors inside a sphere
/// are uniform: half of what leaves a point escapes, at every point of every level set below 1.
#[derive(Clone, Copy, Debug, Default)]
pub struct Bowl;

impl Field for Bowl {
    fn name(&self) -> &'static str {
        "bowl"
    }

    fn value(&self, point_in_world: DVec3) -> f64 {
        point_in_world.length()
    }

    fn bounds(&self) -> Bounds {
        Bounds { min: DVec3::NEG_ONE, max: DVec3::new(1.0, 1.0, 0.0) }
    }

    fn default_isovalue(&self) -> f64 {
        0.6
    }
}

/// h = sin X cos Y + sin Y cos Z + sin Z cos X with X = 2π·periods·x and so on, on \[0, 1\]³
/// (Schoen's gyroid to first order). Values lie in \[−1.5, 1.5\].
#[derive(Clone, Copy, Debug)]
pub struct Gyroid {
    /// Periods along each side of the box.
    pub periods: f64,
}

impl Default for Gyroid {
    fn default() -> Self {
        Self { periods: 2.0 }
    }
}

impl Gyroid {
    fn sine_cosine(&self, coordinate: f64) -> (f64, f64) {
        let angle = TAU * self.periods * coordinate;
        (libm::sin(angle), libm::cos(angle))
    }
}

/// The sum of the gyroid from (sine, cosine) along each axis.
fn gyroid_sum(x: (f64, f64), y: (f64, f64), z: (f64, f64)) -> f64 {
    x.0 * y.1 + y.0 * z.1 + z.0 * x.1
}

impl Field for Gyroid {
    fn name(&self) -> &'static str {
        "gyroid"
    }

    fn value(&self, point_in_world: DVec3) -> f64 {
        let [x, y, z] = point_in_world.to_array().map(|c| self.sine_cosine(c));
        gyroid_sum(x, y, z)
    }

    fn bounds(&self) -> Bounds {
        Bounds { min: DVec3::ZERO, max: DVec3::ONE }
    }

    fn default_isovalue(&self) -> f64 {
        0.0
    }

    fn fill(&self, coordinates: [&[f64]; 3], out: &mut Vec<f32>) {
        let [xs, ys, zs] = coordinates.map(|axis| axis.iter().map(|&c| self.sine_cosine(c)).collect::<Vec<_>>());
        for &z in &zs {
            for &y in &ys {
                out.extend(xs.iter().map(|&x| gyroid_sum(x, y, z) as f32));
            }
        }
    }
}

/// h = r − distance to the circle of radius R in the plane z = 0, on \[−1, 1\]³: the signed
/// distance to a torus, positive inside.
#[derive(Clone, Copy, Debug)]
pub struct Torus {
    /// Radius R of the circle.
    pub ring: f64,
    /// Radius r of the tube.
    pub tube: f64,
}

impl Default for Torus {
    fn default() -> Self {
        Self { ring: 0.6, tube: 0.25 }
    }
}

impl Field for Torus {
    fn name(&self) -> &'static str {
        "torus"
    }

    fn value(&self, p: DVec3) -> f64 {
        let outward = (p.x * p.x + p.y * p.y).sqrt() - self.ring;
        self.tube - (outward * outward + p.z * p.z).sqrt()
    }

    fn bounds(&self) -> Bounds {
        UNIT_BOX
    }

    fn default_isovalue(&self) -> f64 {
        0.0
    }
}

/// h = max(R − ‖x − p‖, −z), p = (0, 0, H), on \[−1.5H, 1.5H\]² × \[−H, 2H\]. At isovalue −v the
/// sphere has radius R + v and its centre stands H − v above the plane; the point of the plane
/// under it has the openness 1 − ((R + v)/(H − v))².
#[derive(Clone, Copy, Debug)]
pub struct SphereOverPlane {
    // Invariant: 0 < radius < height, both finite.
    radius: f64,
    height: f64,
}

impl Default for SphereOverPlane {
    fn default() -> Self {
        Self { radius: 0.5, height: 1.0 }
    }
}

impl SphereOverPlane {
    /// A sphere of a radius R whose centre is H above the plane.
    ///
    /// # Errors
    /// Unless 0 < R < H, both finite.
    pub fn new(radius: f64, height: f64) -> Result<Self> {
        if !(radius > 0.0 && radius < height && height.is_finite()) {
            return Err(Error::argument(
                "sphere-over-plane",
                format!("radius {radius}, height {height}"),
                "0 < radius < height",
                "the sphere must not touch the plane",
            ));
        }
        Ok(Self { radius, height })
    }

    /// R.
    #[doc(hidden)]
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// H.
    #[doc(hidden)]
    pub fn height(&self) -> f64 {
        self.height
    }
}

impl Field for SphereOverPlane {
    fn name(&self) -> &'static str {
        "sphere-over-plane"
    }

    fn value(&self, p: DVec3) -> f64 {
        let from_centre = p - DVec3::new(0.0, 0.0, self.height);
        (self.radius - from_centre.length()).max(-p.z)
    }

    fn bounds(&self) -> Bounds {
        let h = self.height;
        Bounds { min: DVec3::new(-1.5 * h, -1.5 * h, -h), max: DVec3::new(1.5 * h, 1.5 * h, 2.0 * h) }
    }

    fn default_isovalue(&self) -> f64 {
        0.0
    }
}
