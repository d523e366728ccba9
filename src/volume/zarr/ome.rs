//! What OME-Zarr says of an image: its levels, axes, and where they lie (ngff.openmicroscopy.org, 0.1 to 0.5).

use super::super::assemble::note;
use super::super::choice::Choice;
use super::super::format::metres_in;
use super::super::{LengthUnit, Note};
use super::metadata::Array;
use super::{Files, NAME, damage};
use crate::error::{Error, Result};
use glam::DVec3;
use serde_json::Value;

/// Most channels of an image.
const MOST_CHANNELS: u64 = 1 << 16;
/// Most levels of a pyramid.
const MOST_LEVELS: usize = 64;

/// Which axes of an array are those of space, of time and of channels.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Roles {
    /// The axes along which x, y and z run.
    pub(super) space: [usize; 3],
    pub(super) time: Option<usize>,
    pub(super) channel: Option<usize>,
}

impl Roles {
    pub(super) fn dims(&self, shape: &[u64]) -> [u64; 3] {
        self.space.map(|axis| shape.get(axis).copied().unwrap_or(0))
    }

    /// Entries along an axis, 1 where there is none.
    pub(super) fn along(&self, axis: Option<usize>, shape: &[u64]) -> u64 {
        axis.and_then(|a| shape.get(a).copied()).unwrap_or(1)
    }
}

#[derive(Clone, Debug, Default)]
struct Axis {
    name: String,
    kind: String,
    unit: Option<String>,
}

/// An image, as its group describes it.
pub(super) struct Image {
    axes: Vec<Axis>,
    levels: Vec<Level>,
    /// Scale and translation of all levels, after their own.
    transforms: Vec<Transform>,
    labels: Vec<String>,
    /// Whether something says how far samples lie apart.
    pub(super) is_placed: bool,
    /// Where there are several to choose from: their names, and which this is.
    pub(super) arrays: Vec<String>,
    pub(super) array: usize,
}

struct Level {
    path: String,
    transforms: Vec<Transform>,
}

#[derive(Clone, Debug)]
enum Transform {
    Scale(Vec<f64>),
    Translation(Vec<f64>),
}

fn wrong(found: impl Into<String>, expected: &str) -> Error {
    damage(found, expected, "correct the metadata, for example with ome-zarr in Python")
}

fn text(value: &Value) -> String {
    value.as_str().unwrap_or("").to_string()
}

/// The image that is chosen of a group.
pub(super) fn choose(images: &[Value], ome: &Value, choice: &Choice, notes: &mut Vec<Note>) -> Result<Image> {
    let name = |(i, image): (usize, &Value)| image["name"].as_str().map_or_else(|| i.to_string(), String::from);
    let names: Vec<String> = images.iter().enumerate().map(name).collect();
    // The first is the one to show (0.4, "multiscales" metadata).
    let chosen =
        if images.len() == 1 && choice.array.is_none() { 0 } else { choice.array_of(NAME, &names, Some(0))? };
    if images.len() > 1 && choice.array.is_none() {
        let others = names.iter().take(12).map(String::as_str).collect::<Vec<_>>().join(", ");
        notes.push(note(format!("the first of {} images is read: {others}; choose with --array", images.len()), 1));
    }
    let image = images.get(chosen).ok_or_else(|| wrong("multiscales without an image", "one"))?;
    let mut image = Image::parse(image, ome)?;
    (image.arrays, image.array) = (names, chosen);
    Ok(image)
}

/// What to do about a group that is a plate, a well or another collection; none where it is no such group.
pub(super) fn of_several(files: &Files, ome: &Value) -> Result<Option<Error>> {
    let paths = |list: &Value| -> Vec<String> {
        list.as_array().into_iter().flatten().filter_map(|one| one["path"].as_str()).map(String::from).collect()
    };
    let (what, images) = if ome["plate"].is_object() {
        // Each well holds images 0, 1, …
        ("a plate of wells", paths(&ome["plate"]["wells"]).into_iter().map(|well| well + "/0").collect())
    } else if ome["well"].is_object() {
        ("a well of images", paths(&ome["well"]["images"]))
    } else if let Some(labels) = ome["labels"].as_array() {
        ("a list of labels", labels.iter().map(text).collect())
    } else if !ome["bioformats2raw.layout"].is_null() {
        let mut images = Vec::new();
        for name in files.folders()? {
            if name.parse::<u32>().is_ok() {
                images.push(name);
            }
        }
        images.sort_by_key(|name| name.parse::<u32>().unwrap_or(0));
        ("a collection of images", images)
    } else {
        return Ok(None);
    };
    let some = images.iter().take(12).map(String::as_str).collect::<Vec<_>>().join(", ");
    let dots = if images.len() > 12 { ", …" } else { "" };
    let first = images.first().map_or("IMAGE", String::as_str);
    let remedy = format!("name one by its path: isolume info FOLDER/{first}");
    Ok(Some(damage(format!("{what}: {some}{dots}"), "one image", remedy)))
}

impl Image {
    fn parse(image: &Value, ome: &Value) -> Result<Self> {
        let axes: Vec<Axis> = match image["axes"].as_array() {
            Some(axes) => axes
                .iter()
                .map(|axis| match axis {
                    // Before 0.4.
                    Value::String(name) => Axis { name: name.clone(), ..Axis::default() },
                    axis => Axis {
                        name: text(&axis["name"]),
                        kind: text(&axis["type"]),
                        unit: axis["unit"].as_str().map(String::from),
                    },
                })
                .collect(),
            // Before 0.3.
            None => ["t", "c", "z", "y", "x"].map(|name| Axis { name: name.into(), ..Axis::default() }).into(),
        };
        let datasets = image["datasets"].as_array().filter(|all| (1..=MOST_LEVELS).contains(&all.len()));
        let datasets = datasets.ok_or_else(|| wrong("an image without datasets", "1 to 64 of them"))?;
        let level = |one: &Value| {
            let path = one["path"].as_str().ok_or_else(|| wrong("a dataset without path", "it"))?;
            Ok(Level { path: path.into(), transforms: transforms(&one["coordinateTransformations"], axes.len())? })
        };
        let levels = datasets.iter().map(level).collect::<Result<Vec<_>>>()?;
        let transforms = transforms(&image["coordinateTransformations"], axes.len())?;
        let is_scale = |t: &Transform| matches!(t, Transform::Scale(_));
        let is_placed = levels.iter().flat_map(|l| &l.transforms).chain(&transforms).any(is_scale);
        let labels = ome["omero"]["channels"].as_array().into_iter().flatten().map(|c| text(&c["label"])).collect();
        Ok(Self { axes, levels, transforms, labels, is_placed, arrays: Vec::new(), array: 0 })
    }

    /// An array by itself.
    pub(super) fn of_array(array: &Array, path: &str) -> Self {
        let axis = |name: &String| Axis { name: name.clone(), ..Axis::default() };
        Self {
            axes: array.names.iter().map(axis).collect(),
            levels: vec![Level { path: path.into(), transforms: Vec::new() }],
            transforms: Vec::new(),
            labels: Vec::new(),
            is_placed: false,
            arrays: Vec::new(),
            array: 0,
        }
    }

    /// Paths of the levels, the finest first.
    pub(super) fn paths(&self) -> impl Iterator<Item = &str> {
        self.levels.iter().map(|level| level.path.as_str())
    }

    pub(super) fn path(&self, level: usize) -> &str {
        self.levels.get(level).map_or("", |level| level.path.as_str())
    }

    /// Names of the channels.
    pub(super) fn channels(&self, count: u64) -> Result<Vec<String>> {
        if count > MOST_CHANNELS {
            return Err(wrong(format!("{count} channels"), "at most 65,536"));
        }
        let mut names = self.labels.clone();
        names.resize(count as usize, String::new());
        Ok(names)
    }

    /// What the axes of an array are.
    pub(super) fn roles(&self, array: &Array, notes: &mut Vec<Note>) -> Result<Roles> {
        let rank = array.shape.len();
        if self.axes.len() != rank {
            return Err(wrong(
                format!("{} axes of an array of {rank}", self.axes.len()),
                "an axis for each of the array",
            ));
        }
        let (mut space, mut time, mut channel, mut others) = ([None; 3], None, None, Vec::new());
        for (i, axis) in self.axes.iter().enumerate() {
            let place = match (axis.kind.as_str(), axis.name.to_ascii_lowercase().as_str()) {
                ("space" | "", "x") => Some(&mut space[0]),
                ("space" | "", "y") => Some(&mut space[1]),
                ("space" | "", "z") => Some(&mut space[2]),
                ("time", _) | ("", "t" | "time") => Some(&mut time),
                ("channel", _) | ("", "c" | "channel") => Some(&mut channel),
                _ => None,
            };
            match place {
                Some(place @ None) => *place = Some(i),
                Some(Some(_)) => return Err(wrong(format!("two axes {}", axis.name), "each once")),
                None => others.push(i),
            }
        }
        if let [Some(x), Some(y), Some(z)] = space
            && others.iter().all(|&axis| array.shape.get(axis) == Some(&1))
        {
            return Ok(Roles { space: [x, y, z], time, channel });
        }
        // Other names, or none: the last three axes as z, y, x, where the others have one entry.
        let rest = |axis: usize| Some(axis) == time || Some(axis) == channel || array.shape.get(axis) == Some(&1);
        if space == [None; 3] && rank >= 3 && (0..rank - 3).all(rest) && (rank - 3..rank).all(|a| others.contains(&a)) {
            let names: Vec<&str> = self.axes.iter().skip(rank - 3).map(|a| a.name.as_str()).collect();
            let named =
                if names.iter().all(|n| n.is_empty()) { String::new() } else { format!(" ({})", names.join(", ")) };
            let text = format!("the last three axes{named} are taken as z, y, x");
            if !notes.iter().any(|n| n.text == text) {
                notes.push(note(text, 1));
            }
            return Ok(Roles { space: [rank - 1, rank - 2, rank - 3], time, channel });
        }
        let names: Vec<&str> =
            self.axes.iter().map(|a| if a.name.is_empty() { "?" } else { a.name.as_str() }).collect();
        let found = format!("axes {} of {:?} entries", names.join(", "), array.shape);
        if rank < 3 {
            return Err(damage(found, "three axes of space", "one section has no surfaces: name a volume"));
        }
        let remedy = "save one time and channel of it in Python:\n  import zarr\n  \
                      a = zarr.open(\"FILE\", mode=\"r\")\n  zarr.create_array(\"OUT.zarr\", data=a[0, 0])";
        Err(damage(found, "axes x, y and z, and perhaps t and c", remedy))
    }

    /// Scale and offset along x, y, z of a level.
    pub(super) fn map(&self, level: usize, roles: &Roles, notes: &mut Vec<Note>) -> Result<(DVec3, DVec3)> {
        let own = self.levels.get(level).map_or(&[][..], |level| &level.transforms);
        let (mut scale, mut offset) = (DVec3::ONE, DVec3::ZERO);
        for transform in own.iter().chain(&self.transforms) {
            let along =
                |all: &[f64]| DVec3::from_array(roles.space.map(|axis| all.get(axis).copied().unwrap_or(f64::NAN)));
            match transform {
                Transform::Scale(by) => (scale, offset) = (scale * along(by), offset * along(by)),
                Transform::Translation(by) => offset += along(by),
            }
        }
        let is_shifted = |t: &Transform| matches!(t, Transform::Translation(_));
        if level > 0 && !own.iter().any(is_shifted) {
            let text = "no translation is given for this level: it may be shifted by half a voxel of it";
            notes.push(note(text, 1));
        }
        if !own.iter().any(|t| matches!(t, Transform::Scale(_))) && level > 0 {
            notes.push(note("no scale is given for this level: that of the finest is used; see --spacing", 1));
        }
        Ok((scale, offset))
    }

    /// The unit of x, and what makes the others of it.
    pub(super) fn unit(&self, roles: &Roles, notes: &mut Vec<Note>) -> (DVec3, LengthUnit) {
        let units = roles.space.map(|axis| self.axes.get(axis).and_then(|a| a.unit.as_deref()));
        match units.map(|unit| unit.and_then(metres_in)) {
            [Some(x), Some(y), Some(z)] => {
                let of_x = |metres: f64| if metres == x { 1.0 } else { metres / x };
                (DVec3::new(1.0, of_x(y), of_x(z)), LengthUnit::Metres(x))
            }
            _ => {
                if units.iter().any(Option::is_some) {
                    let words = units.map(|unit| unit.unwrap_or("none"));
                    let text = format!(
                        "units {}, {} and {} are no lengths: the numbers are used",
                        words[0], words[1], words[2]
                    );
                    notes.push(note(text, 1));
                }
                (DVec3::ONE, LengthUnit::Unknown)
            }
        }
    }
}

fn transforms(list: &Value, axes: usize) -> Result<Vec<Transform>> {
    let mut out = Vec::new();
    for one in list.as_array().into_iter().flatten() {
        let kind = text(&one["type"]);
        let numbers = || -> Result<Vec<f64>> {
            let numbers: Option<Vec<f64>> =
                one[kind.as_str()].as_array().and_then(|all| all.iter().map(Value::as_f64).collect());
            let refuse = || wrong(format!("the transformation {one}"), "as many numbers as axes");
            numbers.filter(|n| n.len() == axes && n.iter().all(|v| v.is_finite())).ok_or_else(refuse)
        };
        match kind.as_str() {
            "identity" => {}
            "scale" => out.push(Transform::Scale(numbers()?)),
            "translation" => out.push(Transform::Translation(numbers()?)),
            _ => return Err(wrong(format!("a transformation of type {kind:?}"), "scale, translation or identity")),
        }
    }
    Ok(out)
}
