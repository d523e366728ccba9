//! Triangles, rectangles and spheres.

use crate::error::{Error, Result};
use glam::DVec3;

/// What a wall consists of.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A parallelogram with its corner and two edges; its front is that of u × v.
    Rectangle {
        /// One corner.
        corner: DVec3,
        /// From it along one edge.
        u: DVec3,
        /// From it along the other edge.
        v: DVec3,
    },
    /// A sphere, seen from outside.
    Sphere {
        /// Its centre.
        centre: DVec3,
        /// Its radius.
        radius: f64,
    },
    /// Triangles by their corners, counter-clockwise seen from the front.
    Triangles(Vec<[DVec3; 3]>),
}

impl Shape {
    /// The six faces of an axis-aligned box in the order −x, +x, −y, +y, −z, +z; fronts outward, or inward for a room.
    pub fn faces_of_box(min: DVec3, max: DVec3, inward: bool) -> [Self; 6] {
        let size = max - min;
        std::array::from_fn(|face| {
            let axis = face / 2;
            let (mut u, mut v) = (DVec3::ZERO, DVec3::ZERO);
            u[(axis + 1) % 3] = size[(axis + 1) % 3];
            v[(axis + 2) % 3] = size[(axis + 2) % 3];
            let is_high = face % 2 == 1;
            let mut corner = min;
            if is_high {
                corner[axis] = max[axis];
            }
            // u × v points along +axis.
            if is_high == inward { Self::Rectangle { corner, u: v, v: u } } else { Self::Rectangle { corner, u, v } }
        })
    }

    /// Adds its parts.
    pub(super) fn append_parts(&self, name: &str, out: &mut Vec<Primitive>) -> Result<()> {
        let refuse = |found: String, remedy: &str| {
            Err(Error::argument(format!("the wall {name}"), found, "a shape with a finite area above 0", remedy))
        };
        match self {
            Self::Rectangle { corner, u, v } => match Flat::new(*corner, *u, *v) {
                Some(flat) => out.push(Primitive::Rectangle(flat)),
                None => return refuse(format!("edges {u} and {v} at {corner}"), "give two edges that span an area"),
            },
            Self::Sphere { centre, radius } => {
                if !(centre.is_finite() && radius.is_finite() && *radius > 0.0) {
                    return refuse(format!("radius {radius} at {centre}"), "give a positive radius");
                }
                out.push(Primitive::Sphere { centre: *centre, radius: *radius });
            }
            Self::Triangles(list) => {
                let before = out.len();
                // Triangles without area reflect nothing; meshes are full of them.
                let flat = |[a, b, c]: &[DVec3; 3]| Flat::new(*a, *b - *a, *c - *a).map(Primitive::Triangle);
                out.extend(list.iter().filter_map(flat));
                if out.len() == before {
                    return refuse(format!("{} triangles, none with an area", list.len()), "give a mesh with an area");
                }
            }
        }
        Ok(())
    }

    pub(super) fn hash_into(&self, hasher: &mut blake3::Hasher) {
        let mut add = |points: &[DVec3]| {
            points.iter().flat_map(|p| p.to_array()).for_each(|v| {
                hasher.update(&v.to_le_bytes());
            })
        };
        match self {
            Self::Rectangle { corner, u, v } => add(&[*corner, *u, *v]),
            Self::Sphere { centre, radius } => add(&[*centre, DVec3::splat(*radius)]),
            Self::Triangles(list) => list.iter().for_each(|triangle| add(triangle)),
        }
    }
}

/// A corner, two edges and what follows from them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Flat {
    pub(super) corner: DVec3,
    pub(super) u: DVec3,
    pub(super) v: DVec3,
    /// Unit normal of the front, u × v.
    pub(super) normal: DVec3,
    /// Of the whole parallelogram.
    pub(super) area: f64,
    // p · to_u is the coordinate along u of a point of the plane, from the corner.
    to_u: DVec3,
    to_v: DVec3,
}

impl Flat {
    /// `None` when there is no finite area.
    pub(super) fn new(corner: DVec3, u: DVec3, v: DVec3) -> Option<Self> {
        let cross = u.cross(v);
        let area = cross.length();
        let usable = corner.is_finite() && area.is_finite() && area > 1e-12 * u.length() * v.length() && area > 0.0;
        let normal = cross / area;
        usable.then(|| Self { corner, u, v, normal, area, to_u: v.cross(normal) / area, to_v: normal.cross(u) / area })
    }

    /// Coordinates along the edges of a point of the plane.
    pub(super) fn coordinates(&self, point: DVec3) -> [f64; 2] {
        let inside = point - self.corner;
        [inside.dot(self.to_u), inside.dot(self.to_v)]
    }

    /// Distance to the plane and coordinates there.
    fn meet(&self, origin: DVec3, direction: DVec3) -> Option<(f64, f64, f64)> {
        let approach = direction.dot(self.normal);
        if approach == 0.0 {
            return None;
        }
        let t = (self.corner - origin).dot(self.normal) / approach;
        let [u, v] = self.coordinates(origin + t * direction);
        Some((t, u, v))
    }
}

/// Share of a primitive by which it reaches over its edges.
const OVERLAP: f64 = 1e-5;

/// One part of a wall.
#[derive(Clone, Copy, Debug)]
pub(super) enum Primitive {
    Rectangle(Flat),
    Triangle(Flat),
    Sphere { centre: DVec3, radius: f64 },
}

impl Primitive {
    /// Area in world units.
    pub(super) fn area(&self) -> f64 {
        match self {
            Self::Rectangle(flat) => flat.area,
            Self::Triangle(flat) => 0.5 * flat.area,
            Self::Sphere { radius, .. } => 4.0 * std::f64::consts::PI * radius * radius,
        }
    }

    /// Smallest and largest corner of its box.
    pub(super) fn bounds(&self) -> [DVec3; 2] {
        match self {
            Self::Rectangle(Flat { corner, u, v, .. }) => {
                around(&[*corner, *corner + *u, *corner + *v, *corner + *u + *v])
            }
            Self::Triangle(Flat { corner, u, v, .. }) => around(&[*corner, *corner + *u, *corner + *v]),
            Self::Sphere { centre, radius } => [*centre - *radius, *centre + *radius],
        }
    }

    /// Distance along a ray of unit direction; `is_own` where the ray starts on this primitive: it then never meets a
    /// flat one, and a sphere only on the other side.
    pub(super) fn distance(&self, origin: DVec3, direction: DVec3, is_own: bool) -> Option<f64> {
        match self {
            Self::Rectangle(flat) if !is_own => {
                let (t, u, v) = flat.meet(origin, direction)?;
                let range = -OVERLAP..=1.0 + OVERLAP;
                (range.contains(&u) && range.contains(&v)).then_some(t)
            }
            Self::Triangle(flat) if !is_own => {
                let (t, u, v) = flat.meet(origin, direction)?;
                (u >= -OVERLAP && v >= -OVERLAP && u + v <= 1.0 + OVERLAP).then_some(t)
            }
            Self::Sphere { centre, radius } => sphere(*centre, *radius, origin, direction, is_own),
            _ => None,
        }
    }

    /// Unit normal of the front at a point of it.
    pub(super) fn normal(&self, point: DVec3) -> DVec3 {
        match self {
            Self::Rectangle(flat) | Self::Triangle(flat) => flat.normal,
            Self::Sphere { centre, .. } => (point - *centre).normalize_or(DVec3::Z),
        }
    }

    /// The point with two variates, uniform over the area.
    pub(super) fn point(&self, [a, b]: [f64; 2]) -> DVec3 {
        match self {
            Self::Rectangle(flat) => flat.corner + a * flat.u + b * flat.v,
            // Turk 1990: the half beyond the diagonal is folded back.
            Self::Triangle(flat) if a + b > 1.0 => flat.corner + (1.0 - a) * flat.u + (1.0 - b) * flat.v,
            Self::Triangle(flat) => flat.corner + a * flat.u + b * flat.v,
            Self::Sphere { centre, radius } => {
                let direction = crate::sampling::warp::square_to_uniform_sphere([a as f32, b as f32]);
                *centre + *radius * direction.as_dvec3().normalize_or(DVec3::Z)
            }
        }
    }
}

/// Distance to a sphere from outside or from within.
pub(super) fn sphere(centre: DVec3, radius: f64, origin: DVec3, direction: DVec3, is_own: bool) -> Option<f64> {
    let from_centre = origin - centre;
    let b = from_centre.dot(direction);
    if is_own {
        // The root at the start divided out: t = −2 b.
        return (b < 0.0).then_some(-2.0 * b);
    }
    // The distance of the line from the centre, without cancellation (Haines et al. 2019, Ray Tracing Gems, ch. 7).
    let beside = from_centre - b * direction;
    let discriminant = radius * radius - beside.length_squared();
    if discriminant < 0.0 {
        return None;
    }
    let root = discriminant.sqrt();
    let near = -b - root;
    if near > 0.0 { Some(near) } else { Some(-b + root).filter(|far| *far > 0.0) }
}

fn around(points: &[DVec3]) -> [DVec3; 2] {
    let low = points.iter().fold(DVec3::INFINITY, |low, p| low.min(*p));
    [low, points.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p))]
}
