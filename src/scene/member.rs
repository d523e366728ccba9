//! A volume to be lit: how it is opened, how its isovalues are chosen, and how they follow those of the volumes beside it.

use super::geometry::Geometry;
use super::model::{self, ModelName};
use super::{Coupled, Coupling, MOST_ISOVALUES, SceneFile, nearest};
use crate::error::{Error, Result};
use crate::file::file_name;
use crate::geom::Up;
use crate::volume::isovalue::{Chosen, number};
use crate::volume::{Choice, Isovalue, Note, ReadHint, Shadowing, Solid, Volume, field, open_with};
use std::path::Path;
use std::str::FromStr;
use std::sync::Arc;

/// What decides which side of a volume is its front, for views and for glTF.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Front {
    /// The axes of the file's frame: −y where z is up.
    Grid,
    /// A patient's frame (RAS+, z up): anterior.
    Anatomical,
}

/// How a volume is to be understood, where its file does not decide.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct VolumeOptions {
    /// Which side of the isovalue is solid; `None` leaves it to the choice of the isovalue, else [`Solid::Above`].
    pub solid: Option<Solid>,
    /// The world axis that points up; `None` as the file says, else z.
    pub up: Option<Up>,
    /// What decides the front; `None` as the file says.
    pub front: Option<Front>,
    /// Which part of a file is the volume, and its spacing.
    pub choice: Choice,
    /// Whether all parts of the solid but the largest are dropped, once the isovalues are known.
    pub keep_largest: bool,
    /// Which shadows count.
    pub shadowing: Shadowing,
    /// Whether stores name the file of its samples instead of holding a copy.
    pub by_reference: bool,
    /// Whether vertices of isosurfaces are moved onto the model that the volume is samples of, with its normals.
    pub exact_vertices: bool,
}

impl VolumeOptions {
    /// How a volume stands whose file says `found`.
    ///
    /// # Errors
    /// When an anatomical front is asked for with another axis up than z.
    #[doc(hidden)]
    pub fn up_of(&self, found: Up) -> Result<Up> {
        let up = match self.up {
            Some(Up::Z) if found.is_anatomical() => found,
            Some(up) => up,
            None => found,
        };
        match (self.front, up) {
            (None, up) => Ok(up),
            (Some(Front::Grid), Up::Anatomical) => Ok(Up::Z),
            (Some(Front::Grid), up) => Ok(up),
            (Some(Front::Anatomical), Up::Z | Up::Anatomical) => Ok(Up::Anatomical),
            (Some(Front::Anatomical), other) => Err(Error::argument(
                "front",
                format!("anatomical with {} up", other.name()),
                "z up: in a patient's frame z is superior",
                "leave out the axis that is up (--up), or take the grid's front (--frame-of grid)",
            )),
        }
    }

    /// Makes isosurfaces of a volume of a store lie on its model, if so asked for.
    ///
    /// # Errors
    /// When it is samples of no model, or of one that names files.
    pub(crate) fn exact_in_store(&self, volume: &mut Volume) -> Result<()> {
        if self.exact_vertices {
            volume.exact = Some(model::of_store(volume)?);
        }
        Ok(())
    }

    /// Refuses vertices on a model where several volumes are lit together.
    pub(crate) fn refuse_exact_of_several(&self) -> Result<()> {
        if !self.exact_vertices {
            return Ok(());
        }
        let remedy = "leave it out, or light each volume alone";
        Err(Error::argument("--exact-vertices", "several volumes", "one model alone", remedy))
    }

    /// The same for the volume of a scene, which stands in the frame of its walls unless told otherwise.
    pub(super) fn of_scene(&self) -> Self {
        Self { front: self.front.or(Some(Front::Grid)), ..self.clone() }
    }

    /// Refuses what says how a file is read, where none is: for the volume of a store or of a field. Whether samples are mapped is asked
    /// of stores as well, which may name the file of theirs.
    ///
    /// # Errors
    /// Names the first such option that is set.
    #[doc(hidden)]
    pub fn refuse_for(&self, what: &str) -> Result<()> {
        let given = [
            ("--spacing", self.choice.spacing.is_some()),
            ("--channel", self.choice.channel.is_some()),
            ("--timepoint", self.choice.timepoint.is_some()),
            ("--array", self.choice.array.is_some()),
            ("--series", self.choice.series.is_some()),
            ("--level", self.choice.level.is_some()),
            ("--region", self.choice.region.is_some()),
            ("--keep-largest", self.keep_largest && !["a field", "a model"].contains(&what)),
        ];
        match given.iter().find(|(_, given)| *given) {
            None => Ok(()),
            Some((option, _)) => {
                let remedy = "leave it out, or give it where the file is read: isolume bake FILE …";
                Err(Error::argument(*option, format!("with {what}"), "a volume file", remedy))
            }
        }
    }
}

/// An isovalue, perhaps of one of several volumes.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedIsovalue {
    /// The volume, where it is named.
    pub volume: Option<String>,
    /// In its values.
    pub isovalue: Isovalue,
}

impl FromStr for NamedIsovalue {
    /// What to give instead.
    type Err = String;

    /// Reads an isovalue, or `NAME=C`.
    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let of = |text: &str| text.parse::<Isovalue>().map_err(|e| e.to_string());
        match text.split_once('=') {
            Some((name, _)) if name.trim().is_empty() => Err(format!("`{text}`: give NAME=C, such as inner=0.5")),
            Some((name, isovalue)) => Ok(Self { volume: Some(name.trim().into()), isovalue: of(isovalue)? }),
            None => Ok(Self { volume: None, isovalue: of(text)? }),
        }
    }
}

/// A volume and what is known of it besides its samples: a scene has one or several.
#[derive(Clone, Debug)]
pub struct Member {
    /// The volume.
    pub volume: Arc<Volume>,
    /// What it was read from: a file's name without its directories, or a field's specification.
    pub label: String,
    /// The isovalue that shows an analytic field best.
    pub default_isovalue: Option<f64>,
    /// What stands around it: walls, luminaires, and the other volumes of the scene as its partners.
    pub geometry: Option<Geometry>,
    // Whether the largest part of the solid alone is to stay.
    keep_largest: bool,
    // Whether the side that is matter was given.
    pub(super) side_is_given: bool,
    // How its isovalues follow those of the first, where it stands among others.
    pub(super) among: Option<AmongOthers>,
}

/// The coupling as one of the volumes sees it.
#[derive(Clone, Debug)]
pub(super) struct AmongOthers {
    pub(super) coupling: Coupling,
    pub(super) volumes: Vec<Coupled>,
    // Which of them it is.
    pub(super) place: usize,
    // The first, whose isovalues are given, where that is another one; and the isovalue that shows it best.
    pub(super) first: Option<(Arc<Volume>, Option<f64>)>,
}

impl Member {
    /// A volume that is there already.
    pub fn of(volume: Volume) -> Self {
        Self {
            label: volume.name.clone(),
            volume: Arc::new(volume),
            default_isovalue: None,
            geometry: None,
            keep_largest: false,
            side_is_given: false,
            among: None,
        }
    }

    /// The isovalues asked for, in the file's values, whose side becomes that of the volume; `None` for all. Errors name the line
    /// of the scene.
    ///
    /// # Errors
    /// As [`Self::settle`] and [`Self::check_all`].
    #[doc(hidden)]
    pub fn settle_in(&mut self, asked: &[Isovalue], scene: Option<&SceneFile>) -> Result<Option<Vec<Chosen>>> {
        if asked.is_empty() {
            self.check_all()?;
            return Ok(None);
        }
        let in_scene = |i: usize, error| scene.iter().fold(error, |error, file| file.at_isovalue(asked[i], error));
        self.settle(asked, &in_scene).map(Some)
    }

    /// Opens a volume file, or samples the analytic field of that name, such as `bumpbox:96`, or a model, such as
    /// `mug.toml:96`.
    ///
    /// # Errors
    /// When there is no such file, or it cannot be read as asked; a name that is nearly one that exists gets a suggestion.
    pub fn open(name: &str, options: &VolumeOptions) -> Result<Self> {
        let of_model = ModelName::of(name).filter(|model| Path::new(model.path).is_file());
        if options.exact_vertices && of_model.is_none() {
            return Err(model::no_model(name));
        }
        let (volume, label, default_isovalue) = match (field::by_name(name)?, of_model) {
            (Some(named), _) => {
                options.refuse_for("a field")?;
                (named.sample()?, name.to_string(), Some(named.field.default_isovalue()))
            }
            (None, Some(of_model)) => {
                options.refuse_for("a model")?;
                let mut sampled = model::open(&of_model, options.choice.allow_outside)?;
                sampled.volume.exact = options.exact_vertices.then_some(sampled.tree);
                (sampled.volume, file_name(name), Some(sampled.isovalue))
            }
            (None, None) => (open_file(name, options)?, file_name(name), None),
        };
        Ok(Self { label, default_isovalue, ..Self::of_with(volume, options)? })
    }

    /// A volume that is there already, to be understood as options say: which side of it is matter, how it stands, which parts
    /// of its solid stay, and which shadows count.
    ///
    /// # Errors
    /// As [`VolumeOptions::up_of`].
    pub fn of_with(mut volume: Volume, options: &VolumeOptions) -> Result<Self> {
        if let Some(side) = options.solid {
            volume.solid = side;
        }
        volume.up = options.up_of(volume.up)?;
        volume.shadowing = options.shadowing;
        volume.by_reference = options.by_reference;
        let (keep_largest, side_is_given) = (options.keep_largest, options.solid.is_some());
        Ok(Self { keep_largest, side_is_given, ..Self::of(volume) })
    }

    /// The volume, to change it.
    #[doc(hidden)]
    pub fn volume_mut(&mut self) -> &mut Volume {
        Arc::make_mut(&mut self.volume)
    }

    /// Whether the side that is matter was given, or follows from other volumes.
    #[doc(hidden)]
    pub fn has_side(&self) -> bool {
        self.side_is_given || self.among.is_some()
    }

    /// Whether other volumes stand beside it.
    #[doc(hidden)]
    pub fn is_among_others(&self) -> bool {
        self.among.is_some()
    }

    /// The side that is matter, where the user, a scene or a field has decided it.
    fn side(&self) -> Option<Solid> {
        (self.has_side() || self.default_isovalue.is_some()).then_some(self.volume.solid)
    }

    /// An isovalue for this volume, with the side of it that is matter; among others the one that belongs to an isovalue of
    /// the first.
    ///
    /// # Errors
    /// When no surface has it.
    pub fn choose(&self, isovalue: Isovalue) -> Result<Chosen> {
        match &self.among {
            Some(among) => among.resolve(isovalue, &self.volume, self.default_isovalue),
            None => isovalue.resolve(&self.volume, self.side(), self.default_isovalue),
        }
    }

    /// As [`Self::choose`], of an isovalue that may be that of another volume than the first.
    ///
    /// # Errors
    /// When no volume has the name, or no surface the isovalue.
    #[doc(hidden)]
    pub fn choose_named(&self, volume: Option<&str>, isovalue: Isovalue) -> Result<Chosen> {
        match (&self.among, volume) {
            (Some(among), Some(name)) => among.resolve_named(name, isovalue, &self.volume, self.default_isovalue),
            _ => self.choose(isovalue),
        }
    }

    /// Isovalues of which all surfaces are made on their own: of one that stands for several, such as `auto` of labels,
    /// all those of one side. The volume takes the side that the choice found. `at` adds to an error which of them it was.
    ///
    /// # Errors
    /// When no surface has one of them, or they are of different sides.
    #[doc(hidden)]
    pub fn settle(&mut self, isovalues: &[Isovalue], at: &dyn Fn(usize, Error) -> Error) -> Result<Vec<Chosen>> {
        check_count(isovalues.len())?;
        let mut all = Vec::new();
        for (i, isovalue) in isovalues.iter().enumerate() {
            let chosen = self.choose(*isovalue).map_err(|e| at(i, e))?;
            let same_side = chosen.more.iter().filter(|level| level.solid == chosen.solid);
            let reason = |c: &Chosen| c.reason.clone();
            let more: Vec<Chosen> = same_side
                .map(|level| Chosen { reason: reason(&chosen), ..Chosen::given(level.value, level.solid) })
                .collect();
            all.push(chosen);
            all.extend(more);
        }
        self.take_side(&all)?;
        Ok(all)
    }

    /// The side of all isovalues becomes that of the volume, which loses the smaller parts of its solid if so asked for.
    ///
    /// # Errors
    /// When they are of different sides.
    #[doc(hidden)]
    pub fn take_side(&mut self, chosen: &[Chosen]) -> Result<()> {
        let Some(first) = chosen.first() else { return Ok(()) };
        if let Some(other) = chosen.iter().find(|c| c.solid != first.solid) {
            let given = [first, other].map(|c| number(c.value)).join(" and ");
            let expected = "isovalues of one side: of these one has matter above, the other below";
            let remedy = "give --solid above or --solid below, or one isovalue at a time";
            return Err(Error::argument("isovalue", given, expected, remedy));
        }
        if self.volume.solid != first.solid {
            self.volume_mut().solid = first.solid;
        }
        if std::mem::take(&mut self.keep_largest)
            && let Some(outermost) = self.volume.outermost(chosen.iter().map(|c| c.value))
        {
            let (mut volume, removed) = Volume::clone(&self.volume).keep_largest(outermost)?;
            let what = format!(
                "{} smaller parts of the solid of {} were dropped, {} samples; the largest has {}",
                removed.parts,
                number(outermost),
                removed.samples,
                removed.kept
            );
            volume.notes.push(Note { text: what, count: removed.samples });
            self.volume = Arc::new(volume);
        }
        Ok(())
    }

    /// Refuses what needs an isovalue where all are asked for.
    ///
    /// # Errors
    /// When the largest part of the solid alone is to stay.
    #[doc(hidden)]
    pub fn check_all(&self) -> Result<()> {
        if !self.keep_largest {
            return Ok(());
        }
        let expected = "the isovalues whose solid is meant";
        let remedy = "add --isovalues C: the parts of a solid differ from isovalue to isovalue";
        Err(Error::argument("--keep-largest", "without --isovalues", expected, remedy))
    }
}

impl AmongOthers {
    /// The isovalue of the volume that belongs to one of the first.
    fn resolve(&self, isovalue: Isovalue, own: &Volume, of_field: Option<f64>) -> Result<Chosen> {
        let (first, of_field) = match &self.first {
            Some((first, default)) => (&**first, *default),
            None => (own, of_field),
        };
        let chosen = isovalue.resolve(first, Some(first.solid), of_field)?;
        self.coupling.check_isovalue(&self.volumes, 0, chosen.value)?;
        if self.place == 0 {
            return Ok(chosen);
        }
        let value = self.coupling.between(&self.volumes, 0, self.place).at(chosen.value);
        let Chosen { value, .. } = Isovalue::Value(value).resolve(own, Some(own.solid), None)?;
        let names = [self.place, 0].map(|m| self.volumes[m].name.as_str());
        let reason = format!("of {}, with {} of {}", names[0], number(chosen.value), names[1]);
        Ok(Chosen { reason: Some(reason), ..Chosen::given(value, own.solid) })
    }

    fn resolve_named(&self, name: &str, isovalue: Isovalue, own: &Volume, of_field: Option<f64>) -> Result<Chosen> {
        let names = || self.volumes.iter().map(|v| v.name.as_str());
        let Some(from) = names().position(|n| n == name) else {
            let remedy = match nearest(name, names()) {
                Some(near) => format!("did you mean {near}?"),
                None => "see the [[volumes]] of the scene".into(),
            };
            let expected = format!("one of {}", names().collect::<Vec<_>>().join(", "));
            return Err(Error::argument("--isovalue", format!("{name}=…"), expected, remedy));
        };
        if from == 0 {
            return self.resolve(isovalue, own, of_field);
        }
        let (low, high) = self.volumes[from].range;
        let value = match isovalue {
            Isovalue::Value(value) => value,
            Isovalue::Percent(part) => low + part / 100.0 * (high - low),
            _ => {
                let remedy = format!("give a number, as in {name}={}", number(0.5 * (low + high)));
                let expected = "a number or a percentage beside a name";
                return Err(Error::argument("--isovalue", format!("{name}=…"), expected, remedy));
            }
        };
        if !(low..=high).contains(&value) {
            let expected = format!("{} to {}", number(low), number(high));
            let given = format!("{name}={}", number(value));
            return Err(Error::argument("--isovalue", given, expected, "choose an isovalue in its range"));
        }
        self.coupling.check_isovalue(&self.volumes, from, value)?;
        if from == self.place {
            return Isovalue::Value(value).resolve(own, Some(own.solid), None);
        }
        let value = self.coupling.between(&self.volumes, from, self.place).at(value);
        Isovalue::Value(value).resolve(own, Some(own.solid), None)
    }
}

/// Refuses a list that would take hours to look at.
///
/// # Errors
/// When it is longer than [`MOST_ISOVALUES`].
pub fn check_count(count: usize) -> Result<()> {
    if count <= MOST_ISOVALUES {
        return Ok(());
    }
    Err(Error::Limit {
        what: "the list of isovalues".into(),
        needed: count.to_string(),
        limit: MOST_ISOVALUES.to_string(),
        remedy: "bake all isovalues at once: leave the list out".into(),
    })
}

fn open_file(name: &str, options: &VolumeOptions) -> Result<Volume> {
    let path = Path::new(name);
    if !path.exists() {
        return Err(missing(name));
    }
    let hint = ReadHint {
        solid: options.solid.unwrap_or(Solid::Above),
        choice: options.choice.clone(),
        ..ReadHint::default()
    };
    open_with(path, &hint).map_err(|error| match error {
        // Readers do not know the name; a limit has no field for it.
        Error::Limit { what, needed, limit, remedy } => {
            Error::Limit { what: format!("{name}: {what}"), needed, limit, remedy }
        }
        other => other,
    })
}

/// The error for a volume that is not there, with the name that may have been meant.
fn missing(name: &str) -> Error {
    if names_store(name) {
        return missing_store(name);
    }
    let word = name.split(':').next().unwrap_or(name);
    let name = ModelName::of(name).map_or(name, |model| model.path);
    let remedy = if let Some(near) = nearest(word, field::NAMES) {
        format!("did you mean the field {near}?")
    } else if let Some(near) = nearest_beside(name, |_| true) {
        format!("did you mean {near}?")
    } else {
        format!("check the path, or name a field: {}", field::NAMES.join(", "))
    };
    Error::argument("volume", name, "a volume file that exists, or the name of a field", remedy)
}

/// The error for a store that is not there.
pub fn missing_store(name: &str) -> Error {
    let remedy = match nearest_beside(name, names_store) {
        Some(near) => format!("did you mean {near}?"),
        None => "check the path, or bake one: isolume bake VOLUME -o NAME.isolume".into(),
    };
    Error::argument("store", name, "a transfer store that exists", remedy)
}

/// Whether a name is that of a store.
fn names_store(name: &str) -> bool {
    name.ends_with(".isolume") || name.ends_with(".isolume.zip")
}

/// What lies beside a path that is not there, has a similar name and is `wanted`.
pub(super) fn nearest_beside(name: &str, wanted: impl Fn(&str) -> bool) -> Option<String> {
    let path = Path::new(name);
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let beside = std::fs::read_dir(folder).ok()?.flatten().map(|e| e.file_name().to_string_lossy().into_owned());
    let beside: Vec<String> = beside.filter(|name| wanted(name)).collect();
    let near = nearest(&file_name(name), beside.iter().map(String::as_str))?;
    Some(path.with_file_name(near).display().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_follows_the_file_unless_told_otherwise() {
        let options = |up, front| VolumeOptions { up, front, ..VolumeOptions::default() };
        let (grid, patient) = (Some(Front::Grid), Some(Front::Anatomical));
        for (up, front, found, expected) in [
            (None, None, Up::Anatomical, Up::Anatomical),
            (Some(Up::Z), None, Up::Anatomical, Up::Anatomical),
            (Some(Up::X), None, Up::Anatomical, Up::X),
            (None, grid, Up::Anatomical, Up::Z),
            (None, grid, Up::NegY, Up::NegY),
            (None, patient, Up::Z, Up::Anatomical),
        ] {
            assert_eq!(options(up, front).up_of(found).ok(), Some(expected), "{up:?} {front:?} {found:?}");
        }
        assert!(options(Some(Up::X), patient).up_of(Up::Z).is_err() && options(None, patient).up_of(Up::Y).is_err());
        // A scene stands in the frame of its walls.
        assert_eq!(options(None, None).of_scene().up_of(Up::Anatomical).ok(), Some(Up::Z));
        assert_eq!(options(None, patient).of_scene().up_of(Up::Anatomical).ok(), Some(Up::Anatomical));
    }
}
