//! How light leaves luminaires: samples towards a point, their density, and rays that meet a luminaire.

use super::primitive::{Flat, Primitive, sphere};
use super::{DistantLight, Geometry, Luminaire, LuminaireShape, Partner, TOUCHING};
use crate::error::{Error, Result};
use crate::geom::{Bounds, Direction};
use crate::sampling::warp;
use crate::volume::Volume;
use glam::DVec3;
use std::f64::consts::PI;

/// A luminaire ready for sampling.
#[derive(Clone, Debug)]
pub(super) struct Emitter {
    body: Body,
    // Radiance; for a point radiant intensity in W sr⁻¹ over (metres per unit)², for parallel light irradiance.
    pub(super) strength: [f64; 3],
}

#[derive(Clone, Debug)]
enum Body {
    // One or more parts by their area: cumulative share up to each, and the whole area.
    Parts { parts: Vec<Primitive>, upto: Vec<f64>, area: f64, is_wall: bool },
    Sphere { centre: DVec3, radius: f64 },
    Point { position: DVec3 },
    Directional { towards: DVec3 },
    // Its strength is a factor.
    Environment(DistantLight),
    // Found by the paths that it scatters or absorbs alone.
    Medium,
}

/// Light of one luminaire that would arrive at a point, if nothing is between.
#[derive(Clone, Copy, Debug, PartialEq)]
#[doc(hidden)]
pub struct ArrivingLight {
    /// Unit vector to the light.
    pub direction: DVec3,
    /// How far, infinite for parallel light.
    pub distance: f64,
    /// Radiance over density: times cosine/π it is an estimate of what a white surface sends out.
    pub value: [f64; 3],
    /// Density of the direction per steradian; `None` where no other technique could find it (points, parallel light).
    pub density: Option<f64>,
}

/// A photon as it leaves a luminaire.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LeavingPhoton {
    pub(crate) origin: DVec3,
    /// Of unit length up to rounding.
    pub(crate) direction: DVec3,
    /// Radiance times area (in world units) times steradian, of each channel: all of the luminaire's, for one photon.
    pub(crate) flux: [f64; 3],
}

/// A ray that met a luminaire.
#[derive(Clone, Copy, Debug, PartialEq)]
#[doc(hidden)]
pub struct LightHit {
    /// Which.
    pub luminaire: usize,
    /// How far.
    pub distance: f64,
    /// What it shows: black on its back.
    pub radiance: [f64; 3],
}

impl Emitter {
    pub(super) fn new(luminaire: &Luminaire, of_wall: Vec<Primitive>, metres_per_unit: f64) -> Result<Self> {
        let name = format!("the luminaire {}", luminaire.name);
        let refuse = |found: String, expected: &str, remedy: &str| Err(Error::argument(&name, found, expected, remedy));
        if !luminaire.power.iter().all(|p| p.is_finite() && *p >= 0.0) {
            let remedy = "give watts, one number or three";
            return refuse(format!("power {:?}", luminaire.power), "finite numbers that are not negative", remedy);
        }
        let square_metres = metres_per_unit * metres_per_unit;
        let expected = "a finite area above 0";
        Ok(match &luminaire.shape {
            LuminaireShape::Rectangle { corner, u, v } => {
                let Some(flat) = Flat::new(*corner, *u, *v) else {
                    let found = format!("edges {u} and {v}, area {}", u.cross(*v).length());
                    return refuse(found, expected, "give two edges that span an area");
                };
                // Φ = π A L for a diffuse source.
                let strength = luminaire.power.map(|p| p / (PI * flat.area * square_metres));
                Self { body: Body::of_parts(vec![Primitive::Rectangle(flat)], false), strength }
            }
            LuminaireShape::Sphere { centre, radius } => {
                if !(centre.is_finite() && radius.is_finite() && *radius > 0.0) {
                    return refuse(
                        format!("radius {radius}"),
                        expected,
                        "give a positive radius, or shape = \"point\"",
                    );
                }
                let area = 4.0 * PI * radius * radius * square_metres;
                let strength = luminaire.power.map(|p| p / (PI * area));
                Self { body: Body::Sphere { centre: *centre, radius: *radius }, strength }
            }
            LuminaireShape::Point { position } => {
                if !position.is_finite() {
                    return refuse(position.to_string(), "a finite position", "correct the position");
                }
                let strength = luminaire.power.map(|p| p / (4.0 * PI * square_metres));
                Self { body: Body::Point { position: *position }, strength }
            }
            LuminaireShape::Directional { towards } => {
                let towards = towards.normalize_or_zero();
                if towards == DVec3::ZERO {
                    return refuse("no direction".into(), "a direction of a length above 0", "correct the direction");
                }
                Self { body: Body::Directional { towards }, strength: luminaire.power }
            }
            LuminaireShape::Environment(light) => {
                if !light.bound().iter().all(|v| v.is_finite()) {
                    let remedy = "correct the pixels that are no numbers";
                    return refuse("an environment of radiance that is not finite".into(), "finite radiance", remedy);
                }
                Self { body: Body::Environment(light.clone()), strength: luminaire.power }
            }
            LuminaireShape::Medium(_) => Self { body: Body::Medium, strength: luminaire.power },
            LuminaireShape::Wall(wall) => {
                if of_wall.is_empty() {
                    return refuse(format!("the wall {wall}"), "a wall of the scene", "correct the name");
                }
                Self { body: Body::of_parts(of_wall, true), strength: luminaire.power }
            }
        })
    }

    /// Smallest and largest corner of its box, if it has one.
    pub(super) fn bounds(&self) -> Option<[DVec3; 2]> {
        match &self.body {
            Body::Parts { parts, .. } => {
                parts.iter().map(Primitive::bounds).reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
            }
            Body::Sphere { centre, radius } => Some([*centre - *radius, *centre + *radius]),
            _ => None,
        }
    }

    /// Distance and radiance of its own body (walls that shine are met as walls).
    fn meet(&self, origin: DVec3, direction: DVec3) -> Option<(f64, [f64; 3])> {
        match &self.body {
            Body::Parts { parts, is_wall: false, .. } => {
                let t = parts[0].distance(origin, direction, false).filter(|t| *t > 0.0)?;
                let front = parts[0].normal(origin).dot(direction) < 0.0;
                Some((t, if front { self.strength } else { [0.0; 3] }))
            }
            Body::Sphere { centre, radius } => {
                let t = sphere(*centre, *radius, origin, direction, false)?;
                let outside = (origin - *centre).length_squared() > radius * radius;
                Some((t, if outside { self.strength } else { [0.0; 3] }))
            }
            _ => None,
        }
    }

    fn arriving(&self, at: DVec3, u: [f32; 2]) -> Option<ArrivingLight> {
        if self.strength == [0.0; 3] {
            return None;
        }
        match &self.body {
            Body::Parts { parts, upto, area, .. } => {
                let u = u.map(f64::from);
                let i = upto.partition_point(|share| *share <= u[0]).min(parts.len() - 1);
                let before = if i == 0 { 0.0 } else { upto[i - 1] };
                let within = ((u[0] - before) / (upto[i] - before).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
                let point = parts[i].point([within, u[1]]);
                let normal = parts[i].normal(point);
                let (distance, direction) = towards(at, point)?;
                let cosine = -normal.dot(direction);
                if cosine <= 0.0 {
                    return None;
                }
                let density = distance * distance / (area * cosine);
                Some(ArrivingLight {
                    direction,
                    distance,
                    value: self.strength.map(|l| l / density),
                    density: Some(density),
                })
            }
            Body::Sphere { centre, radius } => {
                let (far, axis) = towards(at, *centre)?;
                let cap = cap_height(far, *radius)?;
                // Uniform in the cone of the sphere: height z = 1 − u·cap about the axis.
                let z = 1.0 - f64::from(u[0]) * cap;
                let across = (1.0 - z * z).max(0.0).sqrt();
                let (sine, cosine) = libm::sincos(2.0 * PI * f64::from(u[1]));
                let tangent = axis.any_orthonormal_vector();
                let direction = (z * axis + across * (cosine * tangent + sine * axis.cross(tangent))).normalize();
                let distance =
                    sphere(*centre, *radius, at, direction, false).unwrap_or((far * far - radius * radius).sqrt());
                let density = 1.0 / (2.0 * PI * cap);
                Some(ArrivingLight {
                    direction,
                    distance,
                    value: self.strength.map(|l| l / density),
                    density: Some(density),
                })
            }
            Body::Point { position } => {
                let (distance, direction) = towards(at, *position)?;
                let value = self.strength.map(|i| i / (distance * distance));
                Some(ArrivingLight { direction, distance, value, density: None })
            }
            Body::Directional { towards } => Some(ArrivingLight {
                direction: *towards,
                distance: f64::INFINITY,
                value: self.strength,
                density: None,
            }),
            Body::Environment(light) => {
                let sample = light.source().sample(u)?;
                let density = f64::from(sample.density);
                let radiance = sample.radiance.map(f64::from);
                Some(ArrivingLight {
                    direction: sample.direction.vec().as_dvec3().normalize_or(DVec3::Z),
                    distance: f64::INFINITY,
                    value: std::array::from_fn(|c| self.strength[c] * radiance[c] / density),
                    density: Some(density),
                })
            }
            Body::Medium => None,
        }
    }

    /// Density per steradian with which [`Self::arriving`] draws the direction of a ray that met it at `distance`, at
    /// an angle of this cosine to its normal.
    fn density(&self, at: DVec3, distance: f64, cosine: f64) -> f64 {
        match &self.body {
            Body::Parts { area, .. } => distance * distance / (area * cosine.max(f64::MIN_POSITIVE)),
            Body::Sphere { centre, radius } => {
                cap_height((*centre - at).length(), *radius).map_or(0.0, |cap| 1.0 / (2.0 * PI * cap))
            }
            _ => 0.0,
        }
    }

    /// A photon, where the scene lies within a sphere.
    fn photon(&self, place: [f32; 2], way: [f32; 2], (middle, radius): (DVec3, f64)) -> LeavingPhoton {
        let leave = |point: DVec3, normal: DVec3, area: f64| {
            let local = warp::square_to_cosine_hemisphere(way).as_dvec3();
            let tangent = normal.any_orthonormal_vector();
            let direction = local.x * tangent + local.y * normal.cross(tangent) + local.z * normal;
            // Φ = π A L of a diffuse source.
            LeavingPhoton { origin: point, direction, flux: self.strength.map(|l| l * PI * area) }
        };
        match &self.body {
            Body::Parts { parts, upto, area, .. } => {
                let u = place.map(f64::from);
                let i = upto.partition_point(|share| *share <= u[0]).min(parts.len() - 1);
                let before = if i == 0 { 0.0 } else { upto[i - 1] };
                let within = ((u[0] - before) / (upto[i] - before).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
                let point = parts[i].point([within, u[1]]);
                leave(point, parts[i].normal(point), *area)
            }
            Body::Sphere { centre, radius } => {
                let primitive = Primitive::Sphere { centre: *centre, radius: *radius };
                let point = primitive.point(place.map(f64::from));
                leave(point, primitive.normal(point), primitive.area())
            }
            Body::Point { position } => LeavingPhoton {
                origin: *position,
                direction: warp::square_to_uniform_sphere(way).as_dvec3().normalize_or(DVec3::Z),
                flux: self.strength.map(|i| i * 4.0 * PI),
            },
            // No photons are sent through media.
            Body::Medium => LeavingPhoton { origin: middle, direction: DVec3::Z, flux: [0.0; 3] },
            Body::Directional { towards } => LeavingPhoton {
                origin: outside(*towards, place, (middle, radius)),
                direction: -*towards,
                flux: self.strength.map(|e| e * PI * radius * radius),
            },
            Body::Environment(light) => {
                let dark = LeavingPhoton { origin: middle, direction: DVec3::Z, flux: [0.0; 3] };
                let Some(sample) = light.source().sample(way) else { return dark };
                let towards = sample.direction.vec().as_dvec3().normalize_or(DVec3::Z);
                let area = PI * radius * radius / f64::from(sample.density);
                LeavingPhoton {
                    origin: outside(towards, place, (middle, radius)),
                    direction: -towards,
                    flux: std::array::from_fn(|c| self.strength[c] * f64::from(sample.radiance[c]) * area),
                }
            }
        }
    }

    /// Radiance from a direction and the density per steradian with which [`Self::arriving`] draws it, of an environment.
    fn distant(&self, direction: DVec3) -> Option<([f64; 3], f64)> {
        let Body::Environment(light) = &self.body else { return None };
        let to = Direction::new(direction.as_vec3())?;
        let radiance = light.source().radiance(to).map(f64::from);
        let value = std::array::from_fn(|c| self.strength[c] * radiance[c]);
        Some((value, f64::from(light.source().density(to))))
    }
}

impl Body {
    fn of_parts(parts: Vec<Primitive>, is_wall: bool) -> Self {
        let area: f64 = parts.iter().map(Primitive::area).sum();
        let mut sum = 0.0;
        let share = |p: &Primitive| {
            sum += p.area() / area;
            sum
        };
        let upto = parts.iter().map(share).collect();
        Self::Parts { parts, upto, area, is_wall }
    }
}

/// A point of the disk across a direction, as wide as a sphere, that touches it on the side of the light.
fn outside(towards: DVec3, place: [f32; 2], (middle, radius): (DVec3, f64)) -> DVec3 {
    let disk = warp::square_to_uniform_disk(place).as_dvec2();
    let tangent = towards.any_orthonormal_vector();
    middle + radius * (towards + disk.x * tangent + disk.y * towards.cross(tangent))
}

/// Distance and unit vector from one point to another; `None` where they coincide.
fn towards(from: DVec3, to: DVec3) -> Option<(f64, DVec3)> {
    let way = to - from;
    let distance = way.length();
    (distance > 0.0).then(|| (distance, way / distance))
}

/// 1 − cos of the half angle of the cone of a sphere, exact for small ones; `None` inside.
fn cap_height(distance: f64, radius: f64) -> Option<f64> {
    let sine = radius / distance;
    let square = sine * sine;
    (square < 1.0).then(|| square / (1.0 + (1.0 - square).sqrt()))
}

impl Geometry {
    /// Exponents e of 2, one a luminaire, by which its texture is divided so that 16 bits hold any power: 2^e is just above
    /// its strength, in any channel, of a point at half the diagonal of the volume's box.
    #[doc(hidden)]
    pub fn exponents(&self, volume: &Volume) -> Vec<i32> {
        let size = 0.5 * volume.world_bounds().size().length();
        (0..self.emitters.len()).map(|l| self.exponent(l, size)).collect()
    }

    /// The least e with 2^e above the strength of luminaire `l` (of a point: at a distance `size`), in any channel.
    fn exponent(&self, l: usize, size: f64) -> i32 {
        let emitter = &self.emitters[l];
        let largest = emitter.strength.into_iter().fold(0.0, f64::max);
        let largest = match &emitter.body {
            Body::Point { .. } => largest / (size * size),
            Body::Environment(light) => (0..3).map(|c| emitter.strength[c] * light.bound()[c]).fold(0.0, f64::max),
            _ => largest,
        };
        if largest > 0.0 && largest.is_finite() { libm::frexp(largest).1 } else { 0 }
    }

    /// Light of luminaire `l` towards a point, from two variates; `None` where it sends none there.
    #[doc(hidden)]
    pub fn arriving(&self, l: usize, at: DVec3, u: [f32; 2]) -> Option<ArrivingLight> {
        self.emitters[l].arriving(at, u)
    }

    /// Density per steradian with which [`Self::arriving`] draws the direction in which a ray from `at` met luminaire `l` at
    /// a distance and a cosine; 0 for those that have no area.
    pub(crate) fn light_density(&self, l: usize, at: DVec3, distance: f64, cosine: f64) -> f64 {
        self.emitters[l].density(at, distance, cosine)
    }

    /// The first luminaire with a body of its own on a ray, where it is not behind `limit`: within rounding it comes
    /// before a wall that it lies in.
    pub(crate) fn first_luminaire(&self, origin: DVec3, direction: DVec3, limit: f64) -> Option<LightHit> {
        let limit = limit * (1.0 + TOUCHING) + self.nearest_allowed;
        let mut best: Option<LightHit> = None;
        for (luminaire, emitter) in self.emitters.iter().enumerate() {
            let Some((distance, radiance)) = emitter.meet(origin, direction) else { continue };
            if distance <= limit && distance > self.nearest_allowed && best.is_none_or(|b| distance < b.distance) {
                best = Some(LightHit { luminaire, distance, radiance });
            }
        }
        best
    }

    /// Hands the radiance of each environment among the luminaires from a direction to `add`, with the density per steradian with which
    /// [`Self::arriving`] draws that direction.
    pub(crate) fn each_distant(&self, direction: DVec3, add: &mut dyn FnMut(usize, [f64; 3], f64)) {
        for (l, emitter) in self.emitters.iter().enumerate() {
            if let Some((radiance, density)) = emitter.distant(direction) {
                add(l, radiance, density);
            }
        }
    }

    /// The cosine under which a ray meets the front of luminaire `l` at a point.
    pub(crate) fn light_cosine(&self, l: usize, point: DVec3, direction: DVec3) -> f64 {
        match &self.emitters[l].body {
            Body::Parts { parts, .. } => -parts[0].normal(point).dot(direction),
            Body::Sphere { centre, .. } => -(point - *centre).normalize_or_zero().dot(direction),
            _ => 0.0,
        }
    }

    /// Radiance of an opaque piece of the medium that is luminaire `l`, or of the front of a wall.
    pub(crate) fn wall_radiance(&self, l: usize) -> [f64; 3] {
        self.emitters[l].strength
    }

    /// Whether the body of a luminaire stands between, other than that of `l`, from which the light comes.
    pub(crate) fn is_shaded_by_luminaires(
        &self,
        l: Option<usize>,
        origin: DVec3,
        direction: DVec3,
        limit: f64,
    ) -> bool {
        let limit = limit * (1.0 - TOUCHING);
        self.emitters.iter().enumerate().any(|(other, emitter)| {
            Some(other) != l
                && emitter.meet(origin, direction).is_some_and(|(t, _)| t < limit && t > self.nearest_allowed)
        })
    }

    /// A photon of luminaire `l` from two variates for the place and two for the direction, where the scene lies within a sphere
    /// (centre and radius); parallel light crosses all of that.
    pub(crate) fn photon(&self, l: usize, place: [f32; 2], way: [f32; 2], sphere: (DVec3, f64)) -> LeavingPhoton {
        self.emitters[l].photon(place, way, sphere)
    }

    /// Centre and radius of a sphere around `bounds`, all volumes beside it, all walls and all bodies of luminaires.
    pub(crate) fn sphere_around(&self, bounds: Bounds) -> (DVec3, f64) {
        let of_emitters = self.emitters.iter().filter_map(Emitter::bounds);
        let boxes = self.primitives.iter().map(Primitive::bounds).chain(of_emitters);
        let all = boxes.fold(bounds, |b, [low, high]| b.including(low).including(high));
        let with_partners = |b: Bounds, p: &Partner| {
            let other = p.volume.world_bounds();
            b.including(other.min).including(other.max)
        };
        let all = self.partners.iter().fold(all, with_partners);
        (all.centre(), 0.5 * all.size().length())
    }
}
