//! What stands around a volume: walls, objects and luminaires, which are the same for every isovalue, and where a ray
//! meets them; and other volumes, whose isovalues follow that of the ray ([`Partner`]). (In the space of position and isovalue each triangle is a prism through the whole range.)
//!
//! # Rules
//! * World coordinates in `f64`; directions are unit vectors, distances are in world units.
//! * Surfaces are two-sided for light, but shine on their front only: the side the normal points to. A room's normals
//!   point inward, those of boxes and spheres outward; rectangles have u × v, triangles run counter-clockwise.
//! * A ray never meets the flat primitive that it starts on. Nothing is met nearer than 10⁻⁹ of the diagonal of all walls and
//!   luminaires.
//! * Edges overlap by 10⁻⁵ of the primitive, so that light does not leak where two of them meet.
//! * Where a luminaire lies in a wall, within 10⁻⁶ of the distance, the luminaire is met.

mod hierarchy;
mod light;
mod luminaire;
mod mesh;
mod partner;
mod primitive;

#[cfg(test)]
mod tests;

pub(crate) use light::LeavingPhoton;
pub use light::{ArrivingLight, LightHit};
pub use luminaire::{DistantLight, Luminaire, LuminaireShape};
pub use mesh::{TriangleMesh, read_mesh};
pub use partner::{Among, MOST_PARTNERS, Partner};
pub use primitive::Shape;

use crate::error::{Error, Result};
use crate::geom::Bounds;
use crate::scene::medium::{Body, MOST_MEDIA, Medium};
use glam::DVec3;
use hierarchy::Hierarchy;
use light::Emitter;
use primitive::Primitive;

/// What a wall does to light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Finish {
    /// Lambertian with this albedo in red, green and blue.
    Diffuse([f32; 3]),
    /// A mirror that reflects this share.
    Mirror([f32; 3]),
    /// Clear glass of this index of refraction; its surface must be closed. Fresnel's equations decide between reflection
    /// and refraction.
    Glass(f64),
}

impl Finish {
    /// Whether it sends light from one direction into one or two others.
    #[doc(hidden)]
    pub fn is_specular(&self) -> bool {
        !matches!(self, Self::Diffuse(_))
    }
}

/// A wall or an object.
#[derive(Clone, Debug, PartialEq)]
pub struct Wall {
    /// For messages.
    pub name: String,
    /// Its parts.
    pub shape: Shape,
    /// What it does to light.
    pub finish: Finish,
}

/// Where a ray meets a wall.
#[derive(Clone, Copy, Debug, PartialEq)]
#[doc(hidden)]
pub struct WallHit {
    /// From the origin of the ray.
    pub distance: f64,
    /// The part that was met: where rays go on from.
    pub part: u32,
    /// Unit normal of the front.
    pub normal: DVec3,
    /// What it does to light.
    pub finish: Finish,
    /// The luminaire that it is part of, if it shines.
    pub luminaire: Option<usize>,
}

/// A part of a mirror that is flat.
#[derive(Clone, Copy, Debug, PartialEq)]
#[doc(hidden)]
pub struct FlatMirror {
    /// The part.
    pub part: u32,
    /// A point of its plane.
    pub point: DVec3,
    /// Unit normal of its plane.
    pub normal: DVec3,
    /// Share of the light that it reflects.
    pub reflectance: [f64; 3],
}

/// All walls and luminaires of a scene, ready for rays.
#[derive(Clone, Debug)]
pub struct Geometry {
    primitives: Vec<Primitive>,
    // One a primitive: its finish, and the luminaire it is part of.
    finishes: Vec<Finish>,
    shining: Vec<Option<usize>>,
    hierarchy: Option<Hierarchy>,
    luminaires: Vec<Luminaire>,
    emitters: Vec<Emitter>,
    nearest_allowed: f64,
    fingerprint: String,
    // Without media.
    of_surfaces: String,
    // Of walls and luminaires without other volumes.
    of_walls: String,
    // The baked volume, and the volumes beside it, sorted by name.
    among: Option<Among>,
    partners: Vec<Partner>,
    media: Vec<Medium>,
    body: Option<Body>,
}

/// Most primitives that are simply tried in turn.
const FEW: usize = 8;
/// Most luminaires of a scene: each is asked at every bounce.
#[doc(hidden)]
pub const MOST_LUMINAIRES: usize = 32;
/// Backs of walls that a camera sees through.
const MOST_BACKS: usize = 64;
/// Most primitives, 2^24.
const MOST_PRIMITIVES: usize = 1 << 24;
/// Share of the distance within which a luminaire is met before a wall, and how near to its end a ray of light is free.
const TOUCHING: f64 = 1e-6;

impl Geometry {
    /// Walls and luminaires; `metres_per_unit` turns watts into radiance.
    ///
    /// # Errors
    /// When a shape has no area or is not finite, an albedo is outside [0, 1], two luminaires share a name, or there are
    /// too many.
    pub fn new(walls: Vec<Wall>, luminaires: Vec<Luminaire>, metres_per_unit: f64) -> Result<Self> {
        if !(metres_per_unit.is_finite() && metres_per_unit > 0.0) {
            let remedy = "give the metres of a world unit, such as 0.001 for millimetres";
            return Err(Error::argument("metres_per_unit", metres_per_unit, "a positive number", remedy));
        }
        if luminaires.len() > MOST_LUMINAIRES {
            return Err(Error::Limit {
                what: "the scene".into(),
                needed: format!("{} luminaires", luminaires.len()),
                limit: format!("{MOST_LUMINAIRES} luminaires"),
                remedy: "put some together as one mesh with emission".into(),
            });
        }
        for (i, luminaire) in luminaires.iter().enumerate() {
            if luminaires[..i].iter().any(|other| other.name == luminaire.name) {
                let expected = "a name that no other luminaire has";
                return Err(Error::argument("luminaire", &luminaire.name, expected, "give each its own name"));
            }
        }
        let hash = fingerprint(&walls, &luminaires, metres_per_unit);
        let (mut primitives, mut finishes, mut shining) = (Vec::new(), Vec::new(), Vec::new());
        for wall in &walls {
            check_finish(wall)?;
            let first = primitives.len();
            wall.shape.append_parts(&wall.name, &mut primitives)?;
            finishes.resize(primitives.len(), wall.finish);
            let of =
                luminaires.iter().position(|l| matches!(&l.shape, LuminaireShape::Wall(name) if *name == wall.name));
            shining.resize(primitives.len(), of);
            if primitives.len() > MOST_PRIMITIVES {
                return Err(Error::Limit {
                    what: format!("the wall {}", wall.name),
                    needed: format!("{} parts with those before it", primitives.len()),
                    limit: format!("{MOST_PRIMITIVES} triangles in all"),
                    remedy: "simplify the mesh".into(),
                });
            }
            debug_assert!(first <= primitives.len());
        }
        let of_wall = |l: usize| -> Vec<Primitive> {
            primitives.iter().zip(&shining).filter(|(_, of)| **of == Some(l)).map(|(p, _)| *p).collect()
        };
        let emitters = luminaires
            .iter()
            .enumerate()
            .map(|(l, luminaire)| Emitter::new(luminaire, of_wall(l), metres_per_unit))
            .collect::<Result<Vec<_>>>()?;
        let boxes = primitives.iter().map(Primitive::bounds).chain(emitters.iter().filter_map(Emitter::bounds));
        let bounds = boxes.fold(Bounds::EMPTY, |b, [low, high]| b.including(low).including(high));
        let nearest_allowed = if bounds.min.is_finite() { 1e-9 * bounds.size().length() } else { 0.0 };
        let hierarchy = (primitives.len() > FEW).then(|| Hierarchy::new(&primitives));
        let (fingerprint, of_surfaces, of_walls) = (hash.clone(), hash.clone(), hash);
        let (among, partners, media) = (None, Vec::new(), Vec::new());
        Ok(Self {
            primitives,
            finishes,
            shining,
            hierarchy,
            luminaires,
            emitters,
            nearest_allowed,
            fingerprint,
            of_surfaces,
            of_walls,
            among,
            partners,
            media,
            body: None,
        })
    }

    /// Whether there is nothing at all: a volume alone.
    #[doc(hidden)]
    pub fn is_empty(&self) -> bool {
        self.is_vacuum() && self.media.is_empty() && self.body.is_none()
    }

    /// Whether there are neither surfaces nor luminaires.
    fn is_vacuum(&self) -> bool {
        self.primitives.is_empty() && self.luminaires.is_empty() && self.partners.is_empty()
    }

    /// The same with media between all surfaces; those that are vacuum everywhere are left out. A medium that shines needs a
    /// luminaire of its name ([`LuminaireShape::Medium`]).
    ///
    /// # Errors
    /// When one makes no sense ([`Medium::check`]), two share a name, or there are too many.
    pub fn with_media(mut self, media: Vec<Medium>) -> Result<Self> {
        media.iter().try_for_each(Medium::check)?;
        if let Some(twice) = (1..media.len()).find(|&i| media[..i].iter().any(|m| m.name == media[i].name)) {
            let expected = "names that differ";
            return Err(Error::argument("medium", &media[twice].name, expected, "give each its own"));
        }
        let media: Vec<Medium> = media.into_iter().filter(|m| !m.is_vacuum()).collect();
        if media.len() > MOST_MEDIA {
            return Err(Error::Limit {
                what: "the scene".into(),
                needed: format!("{} media", media.len()),
                limit: format!("{MOST_MEDIA} media"),
                remedy: "put some together in one table".into(),
            });
        }
        if let Some(dark) = media.iter().find(|m| m.emission != [0.0; 3] && self.luminaire_of_medium(&m.name).is_none())
        {
            let expected = "a luminaire of its name that is this medium";
            let remedy = "add one: it carries what the medium sends out";
            return Err(Error::argument("medium", &dark.name, expected, remedy));
        }
        self.media = media;
        self.name_all();
        Ok(self)
    }

    /// The fingerprint of surfaces and media.
    fn name_all(&mut self) {
        self.fingerprint = self.of_surfaces.clone();
        if self.media.is_empty() && self.body.is_none() {
            return;
        }
        let mut hasher = blake3::Hasher::new();
        hasher.update(self.of_surfaces.as_bytes());
        for medium in &self.media {
            hasher.update(medium.identity().as_bytes());
        }
        if let Some(body) = &self.body {
            hasher.update(body.identity().as_bytes());
        }
        self.fingerprint = hasher.finalize().to_hex().to_string();
    }

    /// The same with the solid of the lit volume translucent.
    ///
    /// # Errors
    /// When the body makes no sense ([`Body::check`]), or other volumes stand beside.
    pub fn with_body(mut self, body: Body) -> Result<Self> {
        body.check()?;
        if !self.partners.is_empty() {
            let expected = "one volume alone";
            let remedy = "leave the other volumes out, or make them walls: shape = \"isosurface\"";
            return Err(Error::argument("translucent", "a scene of several volumes", expected, remedy));
        }
        self.body = Some(body);
        self.name_all();
        Ok(self)
    }

    /// What fills the solid of the lit volume, where that is translucent.
    #[doc(hidden)]
    pub fn body(&self) -> Option<&Body> {
        self.body.as_ref()
    }

    /// What lies between surfaces.
    #[doc(hidden)]
    pub fn media(&self) -> &[Medium] {
        &self.media
    }

    /// The luminaire that carries what a medium sends out.
    pub(crate) fn luminaire_of_medium(&self, name: &str) -> Option<usize> {
        self.luminaires.iter().position(|l| matches!(&l.shape, LuminaireShape::Medium(of) if of == name))
    }

    /// Triangles, rectangles and spheres of all walls.
    #[doc(hidden)]
    pub fn parts(&self) -> usize {
        self.primitives.len()
    }

    /// The luminaires, in the order of their numbers.
    pub fn luminaires(&self) -> &[Luminaire] {
        &self.luminaires
    }

    /// Whether any wall is a mirror or glass.
    pub(crate) fn has_specular(&self) -> bool {
        self.finishes.iter().any(Finish::is_specular)
    }

    /// Why lamps of an environment cannot be lit apart from it here, if so.
    pub(crate) fn keeps_lamps(&self) -> Option<&'static str> {
        match (self.has_specular(), self.body.is_some()) {
            (true, _) => Some("mirrors or glass, in which paths do not find small lamps"),
            (_, true) => Some("a translucent solid, into which their light goes"),
            _ => None,
        }
    }

    /// Whether lamps of environments can be lit apart where this stands around a volume.
    pub(crate) fn splits_lamps(around: Option<&Self>) -> bool {
        around.is_none_or(|geometry| geometry.keeps_lamps().is_none())
    }

    /// The flat parts of all mirrors; `None` where something specular is not flat: glass, or a mirror that is a sphere.
    pub(crate) fn flat_mirrors(&self) -> Option<Vec<FlatMirror>> {
        let specular = (0..self.primitives.len()).filter(|&i| self.finishes[i].is_specular());
        let mirror = |i: usize| match (&self.primitives[i], self.finishes[i]) {
            (Primitive::Rectangle(flat) | Primitive::Triangle(flat), Finish::Mirror(share)) => {
                let reflectance = share.map(f64::from);
                Some(FlatMirror { part: i as u32, point: flat.corner, normal: flat.normal, reflectance })
            }
            _ => None,
        };
        specular.map(mirror).collect()
    }

    /// Hash of all that decides what walls and luminaires do to light.
    #[doc(hidden)]
    pub fn fingerprint(&self) -> &str {
        &self.fingerprint
    }

    /// The box of all walls; empty if there is none.
    #[doc(hidden)]
    pub fn bounds(&self) -> Bounds {
        self.primitives.iter().fold(Bounds::EMPTY, |b, p| {
            let [low, high] = p.bounds();
            b.including(low).including(high)
        })
    }

    /// The first wall on a ray nearer than `limit`; `from` is the part it starts on.
    #[doc(hidden)]
    pub fn first_wall(&self, origin: DVec3, direction: DVec3, from: Option<u32>, limit: f64) -> Option<WallHit> {
        let mut best: Option<(f64, u32)> = None;
        let mut try_one = |part: u32, limit: f64| -> Option<f64> {
            let t = self.distance_to(part, origin, direction, from).filter(|t| *t < limit)?;
            if best.is_none_or(|(nearest, of)| t < nearest || t == nearest && part < of) {
                best = Some((t, part));
            }
            Some(t)
        };
        match &self.hierarchy {
            Some(hierarchy) => hierarchy.nearest(origin, direction, limit, &mut try_one),
            None => (0..self.primitives.len() as u32).for_each(|part| {
                try_one(part, limit);
            }),
        }
        let (distance, part) = best?;
        let i = part as usize;
        let normal = self.primitives[i].normal(origin + distance * direction);
        Some(WallHit { distance, part, normal, finish: self.finishes[i], luminaire: self.shining[i] })
    }

    /// Whether a wall stands between the origin and `limit`; `from` is the part the ray starts on.
    pub(crate) fn is_walled(&self, origin: DVec3, direction: DVec3, from: Option<u32>, limit: f64) -> bool {
        let limit = limit * (1.0 - TOUCHING);
        let blocks = |part: u32| self.distance_to(part, origin, direction, from).is_some_and(|t| t < limit);
        match &self.hierarchy {
            Some(hierarchy) => hierarchy.any_blocks(origin, direction, limit, &blocks),
            None => (0..self.primitives.len() as u32).any(blocks),
        }
    }

    /// A point of a rectangle and its normal, by the number of the part and coordinates along the edges; `None` for other
    /// parts.
    pub(crate) fn on_rectangle(&self, part: u32, [u, v]: [f64; 2]) -> Option<(DVec3, DVec3)> {
        match self.primitives.get(part as usize) {
            Some(Primitive::Rectangle(flat)) => Some((flat.corner + u * flat.u + v * flat.v, flat.normal)),
            _ => None,
        }
    }

    /// The inverse of [`Self::on_rectangle`]: coordinates along the edges of a point of the plane.
    pub(crate) fn along_rectangle(&self, part: u32, point: DVec3) -> Option<[f64; 2]> {
        match self.primitives.get(part as usize) {
            Some(Primitive::Rectangle(flat)) => Some(flat.coordinates(point)),
            _ => None,
        }
    }

    /// The first wall on a ray that shows its front, or is not diffuse: what a camera sees that looks into a room from
    /// outside.
    #[doc(hidden)]
    pub fn first_front(&self, origin: DVec3, direction: DVec3, limit: f64) -> Option<WallHit> {
        let (mut origin, mut from, mut passed) = (origin, None, 0.0);
        for _ in 0..MOST_BACKS {
            let mut hit = self.first_wall(origin, direction, from, limit - passed)?;
            if direction.dot(hit.normal) < 0.0 || hit.finish.is_specular() {
                hit.distance += passed;
                return Some(hit);
            }
            (origin, from, passed) = (origin + hit.distance * direction, Some(hit.part), passed + hit.distance);
        }
        None
    }

    /// How far along a ray a part is met; `from` is the part it starts on.
    pub(crate) fn distance_to_part(
        &self,
        part: u32,
        origin: DVec3,
        direction: DVec3,
        from: Option<u32>,
    ) -> Option<f64> {
        self.distance_to(part, origin, direction, from)
    }

    fn distance_to(&self, part: u32, origin: DVec3, direction: DVec3, from: Option<u32>) -> Option<f64> {
        let primitive = &self.primitives[part as usize];
        let t = primitive.distance(origin, direction, from == Some(part))?;
        (t > self.nearest_allowed).then_some(t)
    }
}

fn check_finish(wall: &Wall) -> Result<()> {
    let legal = match wall.finish {
        Finish::Diffuse(share) | Finish::Mirror(share) => share.iter().all(|v| (0.0..=1.0).contains(v)),
        Finish::Glass(index) => (1.0..=10.0).contains(&index),
    };
    if legal {
        return Ok(());
    }
    let expected = "an albedo or reflectance from 0 to 1, or an index of refraction from 1 to 10";
    let remedy = "a surface cannot reflect more light than it receives";
    Err(Error::argument(format!("the wall {}", wall.name), format!("{:?}", wall.finish), expected, remedy))
}

/// Hash of the numbers in their order; names of walls do not count.
fn fingerprint(walls: &[Wall], luminaires: &[Luminaire], metres_per_unit: f64) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&metres_per_unit.to_le_bytes());
    for wall in walls {
        hasher.update(format!("{:?}", wall.finish).as_bytes());
        wall.shape.hash_into(&mut hasher);
    }
    for luminaire in luminaires {
        hasher.update(format!("{luminaire:?}").as_bytes());
        let of = walls.iter().position(|w| matches!(&luminaire.shape, LuminaireShape::Wall(name) if *name == w.name));
        hasher.update(format!("{of:?}").as_bytes());
    }
    hasher.finalize().to_hex().to_string()
}
