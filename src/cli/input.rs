//! The volume argument: a file or an analytic field by name.

use super::joint::Joint;
use super::{Outcome, text};
use crate::error::{Error, Result};
use crate::geom::Up;
use crate::scene::geometry::Geometry;
use crate::volume::{Channel, Choice, ReadHint, Solid, Spacing, Volume, field, open_with};
use clap::ValueEnum;
use std::path::Path;

/// Which side of the surface is matter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum SolidSide {
    /// Values above the isovalue
    Above,
    /// Values below the isovalue
    Below,
}

impl From<SolidSide> for Solid {
    fn from(side: SolidSide) -> Self {
        match side {
            SolidSide::Above => Self::Above,
            SolidSide::Below => Self::Below,
        }
    }
}

/// How a volume is to be understood.
#[derive(clap::Args, Clone, Debug, Default)]
pub(super) struct VolumeArgs {
    /// Which side of the isovalue is solid [default: above]
    #[arg(long, value_enum, value_name = "SIDE")]
    pub(super) solid: Option<SolidSide>,
    /// The world axis that points up: x, y, z, -x, -y, -z [default: z]
    #[arg(long, value_parser = parse_up, allow_hyphen_values = true, value_name = "AXIS")]
    pub(super) up: Option<Up>,
    /// Distance of the samples along x, y, z in place of the file's, perhaps with a unit: mm, um, nm, A, bohr
    #[arg(long, value_name = "X,Y,Z[UNIT]")]
    pub(super) spacing: Option<Spacing>,
    /// The channel of a file that has several (OME-TIFF, ImageJ, NIfTI, NRRD), counted from 0, or its name
    #[arg(long, value_name = "N|NAME")]
    pub(super) channel: Option<Channel>,
    /// The time point of a file that has several, counted from 0 [default: the first]
    #[arg(long, value_name = "N")]
    pub(super) timepoint: Option<usize>,
    /// Drop all parts of the solid but the largest, such as the table below a head: at the isovalue asked for, of several at
    /// the outermost. The volume is masked before the bake, so what is dropped casts no shadow either
    #[arg(long)]
    pub(super) keep_largest: bool,
    /// Read files that lie outside the folder of the file that names them (NRRD `data file`, raw sidecars)
    #[arg(long)]
    pub(super) allow_outside: bool,
    /// Front of views and of glTF: -y of the file where z is up, or anterior [default: anatomical for NIfTI with a
    /// transform code and for NRRD with a patient's space, else grid]
    #[arg(long, value_enum, value_name = "FRAME")]
    pub(super) frame_of: Option<FrameOf>,
}

/// What decides the front.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum FrameOf {
    /// The axes of the file's frame: the front is -y where z is up
    Grid,
    /// A patient's frame (RAS+, z up): the front is anterior
    Anatomical,
}

impl VolumeArgs {
    /// How a volume stands whose file says `found`.
    ///
    /// # Errors
    /// When an anatomical frame is asked for with another axis up than z.
    pub(super) fn up_of(&self, found: Up) -> Result<Up> {
        let up = match self.up {
            Some(Up::Z) if found.is_anatomical() => found,
            Some(up) => up,
            None => found,
        };
        match (self.frame_of, up) {
            (None, up) => Ok(up),
            (Some(FrameOf::Grid), Up::Anatomical) => Ok(Up::Z),
            (Some(FrameOf::Grid), up) => Ok(up),
            (Some(FrameOf::Anatomical), Up::Z | Up::Anatomical) => Ok(Up::Anatomical),
            (Some(FrameOf::Anatomical), other) => Err(Error::argument(
                "--frame-of",
                format!("anatomical with {} up", other.name()),
                "z up: in a patient's frame z is superior",
                "leave out --up, or give --frame-of grid",
            )),
        }
    }

    /// The same for the volume of a scene, which stands in the frame of its walls unless told otherwise.
    pub(super) fn of_scene(&self) -> Self {
        Self { frame_of: self.frame_of.or(Some(FrameOf::Grid)), ..self.clone() }
    }

    /// Which part of a file is the volume.
    fn choice(&self) -> Choice {
        Choice {
            channel: self.channel.clone(),
            timepoint: self.timepoint,
            spacing: self.spacing,
            allow_outside: self.allow_outside,
            any_channel: false,
        }
    }

    /// Refuses what says how a file is read, where none is: the volume of a store or of a field.
    pub(super) fn refuse_for(&self, what: &str) -> Result<()> {
        let given = [
            ("--spacing", self.spacing.is_some()),
            ("--channel", self.channel.is_some()),
            ("--timepoint", self.timepoint.is_some()),
            ("--keep-largest", self.keep_largest && what != "a field"),
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

fn parse_up(axis: &str) -> std::result::Result<Up, String> {
    Ok(match axis {
        "x" => Up::X,
        "y" => Up::Y,
        "z" => Up::Z,
        "-x" => Up::NegX,
        "-y" => Up::NegY,
        "-z" => Up::NegZ,
        _ => return Err("give one of x, y, z, -x, -y, -z".into()),
    })
}

/// A volume and what is known of it besides its samples.
pub(super) struct Input {
    /// The volume.
    pub(super) volume: Volume,
    /// What it was read from: a file's name without its directories, or a field's specification.
    pub(super) label: String,
    /// The isovalue that shows a field best.
    pub(super) default_isovalue: Option<f64>,
    /// Whether the largest part of the solid alone is to stay.
    pub(super) keep_largest: bool,
    /// Whether the side that is matter was given.
    pub(super) side_is_given: bool,
    /// What stands around it.
    pub(super) geometry: Option<Geometry>,
    /// How its isovalues follow those of the first, where it stands among other volumes.
    pub(super) joint: Option<Joint>,
}

/// Opens a volume argument.
pub(super) fn open(argument: &str, args: &VolumeArgs) -> Outcome<Input> {
    open_as(argument, args, args.choice())
}

fn open_as(argument: &str, args: &VolumeArgs, choice: Choice) -> Outcome<Input> {
    let (side_is_given, keep_largest) = (args.solid.is_some(), args.keep_largest);
    let mut input = match field::by_name(argument)? {
        Some(named) => {
            args.refuse_for("a field")?;
            let default_isovalue = Some(named.field.default_isovalue());
            Input {
                volume: named.sample()?,
                label: argument.into(),
                default_isovalue,
                side_is_given,
                keep_largest,
                geometry: None,
                joint: None,
            }
        }
        None => {
            let (volume, label) = (open_file(argument, args, choice)?, file_name(argument));
            Input { volume, label, default_isovalue: None, side_is_given, keep_largest, geometry: None, joint: None }
        }
    };
    if let Some(side) = args.solid {
        input.volume.solid = side.into();
    }
    input.volume.up = args.up_of(input.volume.up)?;
    Ok(input)
}

/// As [`open`], for a list of what a file holds: of several channels the first, where none is chosen.
pub(super) fn look_at(argument: &str, args: &VolumeArgs) -> Outcome<Input> {
    open_as(argument, args, Choice { any_channel: true, ..args.choice() })
}

fn open_file(argument: &str, args: &VolumeArgs, choice: Choice) -> Result<Volume> {
    let path = Path::new(argument);
    if !path.exists() {
        return Err(missing(argument));
    }
    let solid = args.solid.map_or(Solid::Above, Solid::from);
    open_with(path, &ReadHint { solid, choice, ..ReadHint::default() }).map_err(|error| match error {
        // Readers do not know the name; a limit has no field for it.
        Error::Limit { what, needed, limit, remedy } => {
            Error::Limit { what: format!("{argument}: {what}"), needed, limit, remedy }
        }
        other => other,
    })
}

/// The error for a volume that is not there, with the name that may have been meant.
fn missing(argument: &str) -> Error {
    if names_store(argument) {
        return missing_store(argument);
    }
    let name = argument.split(':').next().unwrap_or(argument);
    let remedy = if let Some(near) = text::nearest(name, field::NAMES) {
        format!("did you mean the field {near}?")
    } else if let Some(near) = nearest_beside(argument, |_| true) {
        format!("did you mean {near}?")
    } else {
        format!("check the path, or name a field: {}", field::NAMES.join(", "))
    };
    Error::argument("volume", argument, "a volume file that exists, or the name of a field", remedy)
}

/// The error for a store that is not there.
pub(super) fn missing_store(argument: &str) -> Error {
    let remedy = match nearest_beside(argument, names_store) {
        Some(near) => format!("did you mean {near}?"),
        None => "check the path, or bake one: isolume bake VOLUME -o NAME.isolume".into(),
    };
    Error::argument("store", argument, "a transfer store that exists", remedy)
}

/// Whether a name is that of a store.
fn names_store(name: &str) -> bool {
    name.ends_with(".isolume") || name.ends_with(".isolume.zip")
}

/// What lies beside a path that is not there, has a similar name and is `wanted`.
fn nearest_beside(argument: &str, wanted: impl Fn(&str) -> bool) -> Option<String> {
    let path = Path::new(argument);
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let beside = std::fs::read_dir(folder).ok()?.flatten().map(|e| e.file_name().to_string_lossy().into_owned());
    let beside: Vec<String> = beside.filter(|name| wanted(name)).collect();
    let near = text::nearest(&file_name(argument), beside.iter().map(String::as_str))?;
    Some(path.with_file_name(near).display().to_string())
}

/// The last part of a path.
pub(super) fn file_name(path: &str) -> String {
    Path::new(path).file_name().map_or_else(|| path.to_string(), |n| n.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_follows_the_file_unless_told_otherwise() {
        let args = |up, frame_of| VolumeArgs { up, frame_of, ..VolumeArgs::default() };
        let (grid, patient) = (Some(FrameOf::Grid), Some(FrameOf::Anatomical));
        for (up, frame_of, found, expected) in [
            (None, None, Up::Anatomical, Up::Anatomical),
            (Some(Up::Z), None, Up::Anatomical, Up::Anatomical),
            (Some(Up::X), None, Up::Anatomical, Up::X),
            (None, grid, Up::Anatomical, Up::Z),
            (None, grid, Up::NegY, Up::NegY),
            (None, patient, Up::Z, Up::Anatomical),
        ] {
            assert_eq!(args(up, frame_of).up_of(found).ok(), Some(expected), "{up:?} {frame_of:?} {found:?}");
        }
        assert!(args(Some(Up::X), patient).up_of(Up::Z).is_err() && args(None, patient).up_of(Up::Y).is_err());
        // A scene stands in the frame of its walls.
        assert_eq!(args(None, None).of_scene().up_of(Up::Anatomical).ok(), Some(Up::Z));
        assert_eq!(args(None, patient).of_scene().up_of(Up::Anatomical).ok(), Some(Up::Anatomical));
    }
}
