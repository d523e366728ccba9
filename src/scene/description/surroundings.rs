//! The sections `[[walls]]`, `[[objects]]` (another word for the same) and `[[luminaires]]`.

use super::body::BodyDescription;
use super::media::{FieldDescription, MediumDescription};
use super::read::{Item, Section};
use super::{Located, SceneDescription};
use crate::error::{Error, Result};
use crate::scene::geometry::{
    DistantLight, Finish, Geometry, Luminaire, LuminaireShape, Shape, TriangleMesh, Wall, read_mesh,
};
use crate::scene::medium::MediumField;
use glam::{DMat3, DVec3};

/// What stands around the volume, as described.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surroundings {
    /// Walls and objects.
    pub walls: Vec<WallDescription>,
    /// Luminaires, without those that are walls or environments.
    pub luminaires: Vec<Located<Luminaire>>,
    /// Environments that are fixed before the bake.
    pub environments: Vec<EnvironmentDescription>,
    /// What lies between surfaces.
    pub media: Vec<MediumDescription>,
    /// What fills the solid, where light passes through it.
    pub body: Option<BodyDescription>,
    /// Metres of a world unit, where the scene says so.
    pub metres_per_unit: Option<f64>,
}

/// An environment as a luminaire.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentDescription {
    /// Its name in the scene.
    pub name: String,
    /// The name of a built-in one, or the path of an image from the folder of the scene, and its line.
    pub image: Located<String>,
    /// Counter-clockwise about up, seen from above, in degrees.
    pub rotation: f64,
    /// Factor on its radiance.
    pub power: [f64; 3],
}

/// A wall or an object; a room is one for each of its faces.
#[derive(Clone, Debug, PartialEq)]
pub struct WallDescription {
    /// Its name and line.
    pub name: Located<String>,
    /// Its shape, or the file of a mesh and where that stands.
    pub shape: WallShape,
    /// What it does to light.
    pub finish: Finish,
    /// Radiance of its front in W m⁻² sr⁻¹.
    pub emission: Option<[f64; 3]>,
}

/// A shape, or where to find it.
#[derive(Clone, Debug, PartialEq)]
pub enum WallShape {
    /// A shape in world coordinates.
    Ready(Shape),
    /// Triangles of a file.
    Mesh {
        /// Path from the folder of the scene, and its line.
        file: Located<String>,
        /// Linear part of the map to world.
        world_from_mesh: DMat3,
        /// Where the origin of the mesh comes to stand.
        translate: DVec3,
    },
    /// An isosurface of another volume, as triangles.
    Isosurface {
        /// A path from the folder of the scene or the name of a field, and its line.
        volume: Located<String>,
        /// In the values of that volume.
        isovalue: f64,
        /// Where the origin of that volume's world comes to stand.
        translate: DVec3,
        /// Factor on that volume's world.
        scale: f64,
    },
}

/// Reads a file from the folder of a scene; with a name and a length, the first bytes of the file that it names, beside it.
pub type ReadFile<'a> = dyn FnMut(&str, Option<(&str, u64)>) -> Result<Vec<u8>> + 'a;

impl Surroundings {
    /// Whether there is nothing.
    pub fn is_empty(&self) -> bool {
        let nothing_stands = self.walls.is_empty() && self.luminaires.is_empty() && self.environments.is_empty();
        nothing_stands && self.media.is_empty() && self.body.is_none()
    }

    /// Whether something sends out light.
    pub fn shines(&self) -> bool {
        !self.luminaires.is_empty()
            || !self.environments.is_empty()
            || self.walls.iter().any(|wall| wall.emission.is_some())
            || self.media.iter().any(|medium| medium.shines())
    }

    /// Refuses two luminaires of one name, walls and media that shine among them.
    pub(super) fn check_names(&self, all: &Section<'_>) -> Result<()> {
        let of_walls = self.walls.iter().filter(|w| w.emission.is_some()).map(|w| w.name.value.as_str());
        let of_luminaires = self.luminaires.iter().map(|l| l.value.name.as_str());
        let of_media = self.media.iter().filter(|m| m.shines()).map(|m| m.name.as_str());
        let names: Vec<&str> = of_walls
            .chain(of_luminaires)
            .chain(self.environments.iter().map(|e| e.name.as_str()))
            .chain(of_media)
            .collect();
        let Some(twice) = (1..names.len()).find(|&i| names[..i].contains(&names[i])) else { return Ok(()) };
        let item = ["luminaires", "walls", "objects", "medium"].into_iter().find_map(|key| all.get(key));
        let remedy = "give each luminaire, and each wall and medium that shines, a name of its own";
        Err(item.map_or_else(
            || Error::argument("luminaires", names[twice], "different names", remedy),
            |item| item.refuse(format!("different names; two are {}", names[twice]), remedy),
        ))
    }

    /// Walls and luminaires ready for rays. `metres_per_unit` is that of the volume, which counts where the scene says
    /// nothing; `surface` makes the triangles of another volume, `environment` opens an image and turns it by degrees, `field` finds the
    /// volume of a medium's tables.
    ///
    /// # Errors
    /// When a file cannot be read or is no mesh (naming the line), or as [`Geometry::new`].
    pub fn assemble(
        &self,
        scene: &SceneDescription,
        metres_per_unit: f64,
        read: &mut ReadFile<'_>,
        surface: &mut dyn FnMut(&str, f64) -> Result<TriangleMesh>,
        environment: &mut dyn FnMut(&str, f64) -> Result<DistantLight>,
        field: &mut dyn FnMut(&FieldDescription) -> Result<MediumField>,
    ) -> Result<Geometry> {
        let mut walls = Vec::new();
        let mut luminaires: Vec<Luminaire> = self.luminaires.iter().map(|l| l.value.clone()).collect();
        for EnvironmentDescription { name, image, rotation, power } in &self.environments {
            let light = environment(&image.value, *rotation).map_err(|e| scene.at_line(image.line, e))?;
            luminaires.push(Luminaire { name: name.clone(), shape: LuminaireShape::Environment(light), power: *power });
        }
        for wall in &self.walls {
            let shape = match &wall.shape {
                WallShape::Ready(shape) => shape.clone(),
                WallShape::Mesh { file, world_from_mesh, translate } => {
                    let bytes = read(&file.value, None).map_err(|e| scene.at_line(file.line, e))?;
                    let mut beside = |name: &str, length: u64| read(&file.value, Some((name, length)));
                    let mesh = read_mesh(&bytes, &mut beside)
                        .map_err(|e| scene.at_line(file.line, e.in_file(file.value.clone())))?;
                    let place = |corners: [DVec3; 3]| corners.map(|p| *world_from_mesh * p + *translate);
                    let corners = mesh.corners().map(place);
                    // A mirror image turns fronts to backs.
                    let turned = world_from_mesh.determinant() < 0.0;
                    Shape::Triangles(corners.map(|[a, b, c]| if turned { [a, c, b] } else { [a, b, c] }).collect())
                }
                WallShape::Isosurface { volume, isovalue, translate, scale } => {
                    let mesh = surface(&volume.value, *isovalue).map_err(|e| scene.at_line(volume.line, e))?;
                    Shape::Triangles(mesh.corners().map(|t| t.map(|p| *scale * p + *translate)).collect())
                }
            };
            if let Some(power) = wall.emission {
                let shape = LuminaireShape::Wall(wall.name.value.clone());
                luminaires.push(Luminaire { name: wall.name.value.clone(), shape, power });
            }
            walls.push(Wall { name: wall.name.value.clone(), shape, finish: wall.finish });
        }
        let mut media = Vec::new();
        for description in &self.media {
            let of_line = |e| scene.at_line(description.line, e);
            if description.shines() {
                let name = description.name.clone();
                let shape = LuminaireShape::Medium(name.clone());
                luminaires.push(Luminaire { name, shape, power: description.emission });
            }
            media.push(description.with_field(field(&description.field).map_err(of_line)?));
        }
        let metres = self.metres_per_unit.unwrap_or(metres_per_unit);
        Geometry::new(walls, luminaires, metres)?.with_media(media)
    }
}

const FACES: [&str; 6] = ["-x", "+x", "-y", "+y", "-z", "+z"];
const SHAPES: [&str; 6] = ["room", "box", "rectangle", "sphere", "mesh", "isosurface"];
const LIGHTS: [&str; 5] = ["rectangle", "sphere", "point", "directional", "environment"];
const KEYS_OF_LUMINAIRES: [&str; 14] = [
    "image",
    "rotation",
    "name",
    "shape",
    "power",
    "irradiance",
    "colour",
    "corner",
    "u",
    "v",
    "centre",
    "radius",
    "position",
    "direction",
];
const COMMON: [&str; 7] = ["name", "shape", "material", "albedo", "reflectance", "index", "emission"];

pub(super) fn read(all: &Section<'_>) -> Result<Surroundings> {
    let mut out = Surroundings::default();
    if let Some(item) = all.get("metres_per_unit") {
        let metres = item.number()?;
        if metres <= 0.0 {
            return Err(item.refuse("metres of a world unit, above 0", "write 0.001 for millimetres"));
        }
        out.metres_per_unit = Some(metres);
    }
    for key in ["walls", "objects"] {
        let Some(item) = all.get(key) else { continue };
        let list = item.list().ok_or_else(|| item.refuse("tables", format!("write [[{key}]] on a line of its own")))?;
        for (i, item) in list.iter().enumerate() {
            wall(item, &format!("{}{}", key.trim_end_matches('s'), i + 1), &mut out.walls)?;
        }
    }
    if let Some(item) = all.get("luminaires") {
        let list = item.list().ok_or_else(|| item.refuse("tables", "write [[luminaires]] on a line of its own"))?;
        for (i, item) in list.iter().enumerate() {
            let otherwise = format!("light{}", i + 1);
            match environment(item, &otherwise)? {
                Some(environment) => out.environments.push(environment),
                None => out.luminaires.push(luminaire(item, &otherwise)?),
            }
        }
    }
    Ok(out)
}

/// The name of a wall or luminaire: letters, digits, - and _.
pub(super) fn name(section: &Section<'_>, item: &Item<'_>, otherwise: &str) -> Result<Located<String>> {
    let Some(given) = section.get("name") else {
        return Ok(Located { value: otherwise.into(), line: item.line() });
    };
    let text = given.text()?;
    let legal = !text.is_empty() && text.len() <= 64;
    if !(legal && text.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c))) {
        return Err(given.refuse("a name of letters, digits, - and _", "write name = \"ceiling\""));
    }
    Ok(Located { value: text.into(), line: given.line() })
}

pub(super) fn vector(item: &Item<'_>) -> Result<DVec3> {
    let list = item.list().unwrap_or_default();
    let numbers = list.iter().map(Item::number).collect::<Result<Vec<_>>>()?;
    match numbers[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        _ => Err(item.refuse("three numbers [x, y, z]", "coordinates are in the world of the volume")),
    }
}

/// A key that must be there.
pub(super) fn required<'a>(section: &Section<'a>, of: &Item<'_>, key: &str, remedy: &str) -> Result<Item<'a>> {
    section.get(key).ok_or_else(|| of.refuse(format!("the key `{key}`"), remedy))
}

/// One number or three, in 0..=most.
pub(super) fn colour(item: &Item<'_>, most: f64, expected: &str, remedy: &str) -> Result<[f64; 3]> {
    let numbers = item.one_or_more()?.iter().map(Item::number).collect::<Result<Vec<_>>>()?;
    let colour = match numbers[..] {
        [one] => [one; 3],
        [r, g, b] => [r, g, b],
        _ => return Err(item.refuse("one number or three", "write 0.7 or [0.7, 0.6, 0.5]")),
    };
    if colour.iter().all(|v| (0.0..=most).contains(v)) { Ok(colour) } else { Err(item.refuse(expected, remedy)) }
}

pub(super) fn share(item: &Item<'_>) -> Result<[f32; 3]> {
    let remedy = "a surface cannot reflect more than it receives";
    Ok(colour(item, 1.0, "shares from 0 to 1", remedy)?.map(|v| v as f32))
}

fn wall(item: &Item<'_>, otherwise: &str, out: &mut Vec<WallDescription>) -> Result<()> {
    // The shape decides which keys there are; a first look takes all of them.
    let every: Vec<&str> = COMMON
        .into_iter()
        .chain(["min", "max", "faces", "open", "corner", "u", "v", "centre", "radius"])
        .chain(["file", "scale", "translate", "rotate", "volume", "isovalue"])
        .collect();
    let shape = required(&item.section(&every)?, item, "shape", "write shape = \"room\"")?.word(&SHAPES)?;
    let own: &[&str] = match shape {
        "room" => &["min", "max", "faces", "open"],
        "box" => &["min", "max"],
        "rectangle" => &["corner", "u", "v"],
        "sphere" => &["centre", "radius"],
        "mesh" => &["file", "scale", "translate", "rotate"],
        _ => &["volume", "isovalue", "scale", "translate"],
    };
    let known: Vec<&str> = COMMON.iter().chain(own).copied().collect();
    let section = item.section(&known)?;
    let name = name(&section, item, otherwise)?;
    let finish = finish(&section)?;
    let emission = section
        .get("emission")
        .map(|e| colour(&e, 1e30, "radiances that are not negative", "give W m⁻² sr⁻¹"))
        .transpose()?
        .filter(|e| *e != [0.0; 3]);
    let get = |key: &str| required(&section, item, key, &format!("a {shape} has {}", own.join(", ")));
    let mut add = |name: String, shape: WallShape, finish: Finish| {
        let name = Located { value: name, line: item.line() };
        out.push(WallDescription { name, shape, finish, emission });
    };
    let shape = match shape {
        "room" | "box" => {
            let (min, max) = (vector(&get("min")?)?, vector(&get("max")?)?);
            if !(max - min).cmpgt(DVec3::ZERO).all() {
                return Err(get("max")?.refuse("a corner above `min` along every axis", "exchange min and max"));
            }
            let is_room = shape == "room";
            let (of_faces, open) = if is_room { faces(&section)? } else { ([None; 6], [false; 6]) };
            for (i, face) in Shape::faces_of_box(min, max, is_room).into_iter().enumerate() {
                if open[i] {
                    continue;
                }
                let finish = of_faces[i].map_or(finish, Finish::Diffuse);
                let sign = ["x0", "x1", "y0", "y1", "z0", "z1"][i];
                add(format!("{}-{sign}", name.value), WallShape::Ready(face), finish);
            }
            return Ok(());
        }
        "rectangle" => {
            Shape::Rectangle { corner: vector(&get("corner")?)?, u: vector(&get("u")?)?, v: vector(&get("v")?)? }
        }
        "sphere" => Shape::Sphere { centre: vector(&get("centre")?)?, radius: get("radius")?.number()? },
        "mesh" => {
            let file = get("file")?;
            let file = Located { value: file.text()?.to_string(), line: file.line() };
            let world_from_mesh = rotation(&section)? * scale(&section)?;
            let translate = section.get("translate").map(|t| vector(&t)).transpose()?.unwrap_or(DVec3::ZERO);
            add(name.value, WallShape::Mesh { file, world_from_mesh, translate }, finish);
            return Ok(());
        }
        _ => {
            let volume = get("volume")?;
            let volume = Located { value: volume.text()?.to_string(), line: volume.line() };
            let isovalue = get("isovalue")?.number()?;
            let translate = section.get("translate").map(|t| vector(&t)).transpose()?.unwrap_or(DVec3::ZERO);
            add(name.value, WallShape::Isosurface { volume, isovalue, translate, scale: scale(&section)? }, finish);
            return Ok(());
        }
    };
    let alone = Wall { name: name.value.clone(), shape: shape.clone(), finish };
    Geometry::new(vec![alone], Vec::new(), 1.0).map_err(|e| refusal(item, e))?;
    add(name.value, WallShape::Ready(shape), finish);
    Ok(())
}

/// What a checking constructor found, at the line of the table.
fn refusal(item: &Item<'_>, error: Error) -> Error {
    match error {
        Error::Argument { given, expected, remedy, .. } => item.refuse(format!("{expected} (found {given})"), remedy),
        other => other,
    }
}

fn finish(section: &Section<'_>) -> Result<Finish> {
    const MATERIALS: [&str; 3] = ["diffuse", "mirror", "glass"];
    let material = section.get("material").map(|m| m.word(&MATERIALS)).transpose()?.unwrap_or("diffuse");
    for (key, of) in [("albedo", "diffuse"), ("reflectance", "mirror"), ("index", "glass")] {
        if let Some(item) = section.get(key).filter(|_| material != of) {
            return Err(
                item.refuse(format!("no such key for material = \"{material}\""), format!("it belongs to {of}"))
            );
        }
    }
    let of = |key: &str, otherwise: [f32; 3]| section.get(key).map_or(Ok(otherwise), |item| share(&item));
    Ok(match material {
        "mirror" => Finish::Mirror(of("reflectance", [1.0; 3])?),
        "glass" => {
            let Some(item) = section.get("index") else { return Ok(Finish::Glass(1.5)) };
            let index = item.number()?;
            if !(1.0..=10.0).contains(&index) {
                return Err(item.refuse("an index of refraction from 1 to 10", "glass has 1.5, water 1.33"));
            }
            Finish::Glass(index)
        }
        _ => Finish::Diffuse(of("albedo", [0.7; 3])?),
    })
}

/// Of each face of a room, where it has its own.
type AlbedosOfFaces = [Option<[f32; 3]>; 6];

/// Albedos of the faces of a room, and which are open.
fn faces(section: &Section<'_>) -> Result<(AlbedosOfFaces, [bool; 6])> {
    let (mut albedos, mut open) = ([None; 6], [false; 6]);
    if let Some(item) = section.get("faces") {
        let table = item.section(&FACES)?;
        for (i, face) in FACES.iter().enumerate() {
            albedos[i] = table.get(face).map(|item| share(&item)).transpose()?;
        }
    }
    for item in section.get("open").map_or(Ok(Vec::new()), |item| item.one_or_more())? {
        let face = item.word(&FACES)?;
        (0..6).filter(|&i| FACES[i] == face).for_each(|i| open[i] = true);
    }
    Ok((albedos, open))
}

pub(super) fn scale(section: &Section<'_>) -> Result<f64> {
    let Some(item) = section.get("scale") else { return Ok(1.0) };
    let scale = item.number()?;
    if scale == 0.0 { Err(item.refuse("a number other than 0", "1 leaves the size as it is")) } else { Ok(scale) }
}

/// `rotate = [x, y, z, degrees]`, by Rodrigues' formula.
pub(super) fn rotation(section: &Section<'_>) -> Result<DMat3> {
    let Some(item) = section.get("rotate") else { return Ok(DMat3::IDENTITY) };
    let refuse = || item.refuse("an axis and an angle [x, y, z, degrees]", "write [0, 0, 1, 90]");
    let numbers = item.list().unwrap_or_default().iter().map(Item::number).collect::<Result<Vec<_>>>()?;
    let [x, y, z, degrees] = numbers[..] else { return Err(refuse()) };
    let axis = DVec3::new(x, y, z).try_normalize().ok_or_else(refuse)?;
    let (sine, cosine) = libm::sincos(degrees.to_radians());
    let turned = |v: DVec3| v * cosine + axis.cross(v) * sine + axis * axis.dot(v) * (1.0 - cosine);
    Ok(DMat3::from_cols(turned(DVec3::X), turned(DVec3::Y), turned(DVec3::Z)))
}

/// An environment among the luminaires; `None` for one of another shape.
fn environment(item: &Item<'_>, otherwise: &str) -> Result<Option<EnvironmentDescription>> {
    let shape = item.section(&KEYS_OF_LUMINAIRES)?.get("shape").map(|shape| shape.word(&LIGHTS)).transpose()?;
    if shape != Some("environment") {
        return Ok(None);
    }
    let section = item.section(&["name", "shape", "image", "rotation", "power", "colour"])?;
    let name = name(&section, item, otherwise)?.value;
    let image = required(&section, item, "image", "an environment luminaire has image, a file or a name such as sky")?;
    let numbers = |key: &str| {
        let given = section.get(key);
        given.map(|v| colour(&v, 1e30, "numbers that are not negative", "1 leaves the image as it is")).transpose()
    };
    let (power, tint) = (numbers("power")?.unwrap_or([1.0; 3]), numbers("colour")?.unwrap_or([1.0; 3]));
    Ok(Some(EnvironmentDescription {
        name,
        image: Located { value: image.text()?.to_string(), line: image.line() },
        rotation: section.get("rotation").map(|r| r.number()).transpose()?.unwrap_or(0.0),
        power: std::array::from_fn(|c| power[c] * tint[c]),
    }))
}

fn luminaire(item: &Item<'_>, otherwise: &str) -> Result<Located<Luminaire>> {
    let shape =
        required(&item.section(&KEYS_OF_LUMINAIRES)?, item, "shape", "write shape = \"rectangle\"")?.word(&LIGHTS)?;
    let own: &[&str] = match shape {
        "rectangle" => &["power", "corner", "u", "v"],
        "sphere" => &["power", "centre", "radius"],
        "point" => &["power", "position"],
        _ => &["irradiance", "direction"],
    };
    let known: Vec<&str> = ["name", "shape", "colour"].iter().chain(own).copied().collect();
    let section = item.section(&known)?;
    let name = name(&section, item, otherwise)?;
    let get = |key: &str| required(&section, item, key, &format!("a {shape} luminaire has {}", own.join(", ")));
    let strength = get(own[0])?;
    let power = colour(&strength, 1e30, "numbers that are not negative", "give watts, or W m⁻² of a directional one")?;
    let tint = section.get("colour").map(|c| colour(&c, 1e30, "numbers that are not negative", "1 is white"));
    let tint = tint.transpose()?.unwrap_or([1.0; 3]);
    let power = std::array::from_fn(|c| power[c] * tint[c]);
    let shape = match shape {
        "rectangle" => LuminaireShape::Rectangle {
            corner: vector(&get("corner")?)?,
            u: vector(&get("u")?)?,
            v: vector(&get("v")?)?,
        },
        "sphere" => LuminaireShape::Sphere { centre: vector(&get("centre")?)?, radius: get("radius")?.number()? },
        "point" => LuminaireShape::Point { position: vector(&get("position")?)? },
        // As written: where the light goes.
        _ => {
            let towards = (-vector(&get("direction")?)?).try_normalize();
            let towards =
                towards.ok_or_else(|| item.refuse("a direction of a length above 0", "[0, 0, -1] is light from +z"))?;
            LuminaireShape::Directional { towards }
        }
    };
    let value = Luminaire { name: name.value, shape, power };
    Geometry::new(Vec::new(), vec![value.clone()], 1.0).map_err(|e| refusal(item, e))?;
    Ok(Located { value, line: item.line() })
}
