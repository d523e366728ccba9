//! Which part of a file is the volume, and how large its voxels are where the file does not say: the same options for
//! every format.

use super::assemble::note;
use super::format::metres_in;
use super::{LengthUnit, Note};
use crate::error::{Error, Result};
use crate::geom::Affine;
use glam::DMat3;
use std::str::FromStr;

/// A channel of a file by its place, from 0, or by its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Channel {
    /// From 0.
    Index(usize),
    /// As the file has it.
    Name(String),
}

impl FromStr for Channel {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text.trim() {
            "" => Err(Error::argument("channel", text, "a number from 0 or a name", "see `isolume info` for the list")),
            text => Ok(text.parse().map_or_else(|_| Self::Name(text.into()), Self::Index)),
        }
    }
}

/// Distances of neighbouring samples along x, y, z, perhaps with a unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spacing {
    // Invariant: finite and positive.
    along: [f64; 3],
    metres: Option<f64>,
}

impl Spacing {
    /// From three distances and how many metres one unit of them is, if known.
    ///
    /// # Errors
    /// When one of them is not a positive number.
    pub fn new(along: [f64; 3], metres: Option<f64>) -> Result<Self> {
        if along.iter().chain(&metres).all(|v| v.is_finite() && *v > 0.0) {
            return Ok(Self { along, metres });
        }
        let expected = "three positive numbers, such as 0.5,0.5,2um";
        Err(Error::argument("spacing", format!("{along:?}"), expected, "give the distance of samples along x, y and z"))
    }

    /// The map of a grid with these spacings along its axes; its origin stays where it is in space.
    pub(crate) fn apply(&self, world_from_grid: Affine, unit: LengthUnit) -> (Option<Affine>, LengthUnit) {
        let linear = world_from_grid.linear();
        let axis = |a: usize| linear.col(a) / linear.col(a).length() * self.along[a];
        let scale = match (unit, self.metres) {
            (LengthUnit::Metres(old), Some(new)) => old / new,
            _ => 1.0,
        };
        let unit = self.metres.map_or(unit, LengthUnit::Metres);
        (Affine::new(DMat3::from_cols(axis(0), axis(1), axis(2)), world_from_grid.offset() * scale), unit)
    }
}

impl FromStr for Spacing {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let refuse = || {
            let expected = "X,Y,Z with or without a unit: mm, um, nm, A or bohr";
            Error::argument("spacing", text, expected, "write for example 0.5,0.5,2um")
        };
        let trimmed = text.trim();
        let end = trimmed.rfind(|c: char| c.is_ascii_digit() || c == '.').ok_or_else(refuse)? + 1;
        let (numbers, unit) = trimmed.split_at(end);
        let metres = match unit.trim() {
            "" => None,
            unit => Some(metres_in(unit).ok_or_else(refuse)?),
        };
        let along: Option<Vec<f64>> = numbers.split(',').map(|n| n.trim().parse().ok()).collect();
        Self::new(along.and_then(|n| n.try_into().ok()).ok_or_else(refuse)?, metres).map_err(|_| refuse())
    }
}

/// A level of a pyramid: 0 is the finest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// From 0.
    Index(usize),
    /// The finest of at most [`MOST_AUTO`] samples, else the coarsest.
    Auto,
}

/// Most samples of the level that `auto` takes, 1024 × 1024 × 256: 512 MiB in 16 bits. Not the memory of the machine, so that
/// the same file is the same volume everywhere.
#[doc(hidden)]
pub const MOST_AUTO: u64 = 1 << 28;

impl Level {
    /// The level among those of these dimensions, the finest first.
    pub(crate) fn among(self, levels: &[[u64; 3]]) -> Result<usize> {
        let count = |dims: &[u64; 3]| dims.iter().try_fold(1u64, |n, d| n.checked_mul(*d)).unwrap_or(u64::MAX);
        match self {
            Self::Index(level) if level < levels.len().max(1) => Ok(level),
            Self::Index(level) => {
                let expected = match levels.len() {
                    0 | 1 => "0, the only level of this file".into(),
                    n => format!("0 to {}", n - 1),
                };
                Err(Error::argument("--level", level, expected, "levels count from 0, the finest"))
            }
            Self::Auto => {
                let fits = levels.iter().position(|dims| count(dims) <= MOST_AUTO);
                Ok(fits.unwrap_or(levels.len().saturating_sub(1)))
            }
        }
    }
}

impl FromStr for Level {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text.trim() {
            "auto" => Ok(Self::Auto),
            text => text.parse().map(Self::Index).map_err(|_| {
                Error::argument(
                    "level",
                    text,
                    "a number from 0, the finest, or auto",
                    "see `isolume info` for the list",
                )
            }),
        }
    }
}

/// A box of samples, half open along each axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    // Invariant: first < last where there is a last; none means up to the end.
    along: [(u64, Option<u64>); 3],
}

impl Region {
    /// First sample and number of samples along each axis of a grid.
    ///
    /// # Errors
    /// When the box is not inside.
    pub(crate) fn within(&self, dims: [u64; 3]) -> Result<([u64; 3], [u64; 3])> {
        let (mut first, mut count) = ([0; 3], [0; 3]);
        for axis in 0..3 {
            let (start, end) = self.along[axis];
            let end = end.unwrap_or(dims[axis]);
            if start >= end || end > dims[axis] {
                let name = ["x", "y", "z"][axis];
                let expected = format!("a box in {} × {} × {} samples", dims[0], dims[1], dims[2]);
                let remedy = "ends are not included; samples count from 0, those of the chosen level";
                return Err(Error::argument("--region", format!("{start}:{end} along {name}"), expected, remedy));
            }
            (first[axis], count[axis]) = (start, end - start);
        }
        Ok((first, count))
    }
}

impl FromStr for Region {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let refuse = || {
            let expected = "X0:X1,Y0:Y1,Z0:Z1 in samples, such as 100:228,0:128,: (the last axis whole)";
            Error::argument("region", text, expected, "samples count from 0; the second of each pair is not included")
        };
        let number = |text: &str| text.trim().parse::<u64>().map_err(|_| refuse());
        let one = |part: &str| -> Result<(u64, Option<u64>)> {
            let (start, end) = part.split_once(':').ok_or_else(refuse)?;
            let start = if start.trim().is_empty() { 0 } else { number(start)? };
            let end = if end.trim().is_empty() { None } else { Some(number(end)?) };
            if end.is_some_and(|end| end <= start) { Err(refuse()) } else { Ok((start, end)) }
        };
        let parts = text.split(',').map(one).collect::<Result<Vec<_>>>()?;
        Ok(Self { along: parts.try_into().map_err(|_| refuse())? })
    }
}

/// What is chosen of a file that holds more than one volume, and what it does not say.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Choice {
    /// The channel; needed where there are several.
    pub channel: Option<Channel>,
    /// The time point, from 0; without it the first, with a note.
    pub timepoint: Option<usize>,
    /// The array of a file that names several.
    pub array: Option<String>,
    /// The series of a folder of DICOM files: its number in the list, from 0, or its UID.
    pub series: Option<String>,
    /// The level of a pyramid; without it the finest, with a note.
    pub level: Option<Level>,
    /// The box of samples that is read, all without it.
    pub region: Option<Region>,
    /// The spacing in place of the file's.
    pub spacing: Option<Spacing>,
    /// Whether slices that are missing between others may be interpolated.
    pub allow_gaps: bool,
    /// Whether files may be read that lie outside the folder of the file that names them.
    pub allow_outside: bool,
    /// Whether samples may be read where they lie in their file instead of being copied into memory; see [`crate::file`] for
    /// what happens when another program changes the file meanwhile.
    pub map: bool,
    /// Whether the first of several channels, or arrays, is taken where none is chosen: for a list of what there is.
    pub any_channel: bool,
}

/// What a file holds beside the three axes of space.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Series {
    /// Names of its channels, empty ones where it has none for them.
    pub channels: Vec<String>,
    /// The channel that was read, from 0.
    pub channel: usize,
    /// How many time points it has.
    pub timepoints: usize,
    /// The one that was read, from 0.
    pub timepoint: usize,
    /// Names of its arrays, where the format has names for them.
    pub arrays: Vec<String>,
    /// The array that was read, from 0.
    pub array: usize,
    /// The series of a folder of DICOM files, described.
    pub scans: Vec<String>,
    /// The one that was read, from 0.
    pub scan: usize,
    /// Samples along x, y, z of each level of its pyramid, the finest first.
    pub levels: Vec<[u64; 3]>,
    /// The one that was read, from 0.
    pub level: usize,
}

impl Series {
    /// What the file has several of, one after the other: what it is, those that there are with their numbers or names (of series one a line),
    /// and the option that chooses one.
    #[doc(hidden)]
    pub fn choices(&self) -> Vec<(&'static str, String, &'static str)> {
        let numbered = |(i, text): (usize, String)| format!("{i} {text}").trim_end().to_string();
        let list = |items: &[String], by| items.iter().cloned().enumerate().map(numbered).collect::<Vec<_>>().join(by);
        let level = |(i, [x, y, z]): (usize, &[u64; 3])| format!("{i}: {x} × {y} × {z}");
        let levels = self.levels.iter().enumerate().map(level).collect::<Vec<_>>().join(", ");
        let all = [
            ("channels", self.channels.len(), list(&self.channels, ", "), "channel"),
            ("arrays", self.arrays.len(), self.arrays.join(", "), "array"),
            ("series", self.scans.len(), list(&self.scans, "\n"), "series"),
            ("levels", self.levels.len(), levels, "level"),
            ("time points", self.timepoints, format!("0 to {}", self.timepoints.saturating_sub(1)), "timepoint"),
        ];
        all.into_iter()
            .filter(|(_, count, ..)| *count > 1)
            .map(|(what, _, list, option)| (what, list, option))
            .collect()
    }
}

/// What a format has several of.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Has {
    pub(crate) arrays: bool,
    pub(crate) levels: bool,
    pub(crate) scans: bool,
}

impl Choice {
    /// Chooses among the named arrays of a file; `preferred` is the one that the file itself names first.
    ///
    /// # Errors
    /// When there is none, or several and none is chosen or preferred, and when what was chosen is not there.
    pub(crate) fn array_of(&self, format: &'static str, arrays: &[String], preferred: Option<usize>) -> Result<usize> {
        match (&self.array, preferred) {
            (Some(name), _) => arrays.iter().position(|a| a == name).ok_or_else(|| {
                let expected =
                    if arrays.is_empty() { "a file with arrays".into() } else { format!("one of {}", named(arrays)) };
                Error::argument("--array", name, expected, "see `isolume info` for the list, or leave it out")
            }),
            (None, Some(preferred)) => Ok(preferred),
            (None, None) if arrays.len() == 1 || self.any_channel && !arrays.is_empty() => Ok(0),
            (None, None) => {
                let found = match arrays.len() {
                    0 => "no array".to_string(),
                    n => format!("{n} arrays: {}", named(arrays)),
                };
                Err(Error::format(format, found, "one array of samples", "choose one with --array NAME"))
            }
        }
    }

    /// Refuses what a format has no several of to choose from.
    pub(crate) fn fits(&self, has: Has) -> Result<()> {
        let refuse = |option: &str, given: &str, expected: &str, remedy: &str| {
            Err(Error::argument(option, given, expected, remedy))
        };
        if let Some(name) = self.array.as_ref().filter(|_| !has.arrays) {
            let expected = "a format whose arrays have names: VTI, .npz or Zarr";
            return refuse("--array", name, expected, "leave it out; --channel chooses among components");
        }
        if let Some(Level::Index(level @ 1..)) = self.level.filter(|_| !has.levels) {
            let expected = "a pyramid: OME-Zarr or OME-TIFF";
            return refuse("--level", &level.to_string(), expected, "leave it out: this format has one level");
        }
        if let Some(series) = self.series.as_ref().filter(|_| !has.scans) {
            return refuse("--series", series, "a folder of DICOM files, or one of them", "leave it out");
        }
        Ok(())
    }

    /// Chooses a level, with a note where there are several.
    pub(crate) fn level_of(&self, levels: &[[u64; 3]], notes: &mut Vec<Note>) -> Result<usize> {
        let level = self.level.unwrap_or(Level::Index(0)).among(levels)?;
        if let (Some([x, y, z]), 2..) = (levels.get(level), levels.len()) {
            let how = if self.level.is_none() { "; choose with --level" } else { "" };
            notes.push(note(format!("level {level} of {} is read, {x} × {y} × {z} samples{how}", levels.len()), 1));
        }
        Ok(level)
    }

    /// Chooses among the channels and time points of a file.
    ///
    /// # Errors
    /// When there are several channels and none is chosen, and when what was chosen is not there.
    pub(crate) fn of(
        &self,
        format: &'static str,
        channels: Vec<String>,
        timepoints: usize,
        notes: &mut Vec<Note>,
    ) -> Result<Series> {
        let found = || format!("{} channels: {}", channels.len(), listed(&channels));
        let channel = match &self.channel {
            None if channels.len() <= 1 || self.any_channel => 0,
            None => {
                let remedy = "choose one with --channel N or --channel NAME";
                return Err(Error::format(format, found(), "one channel", remedy));
            }
            Some(Channel::Index(index)) if *index < channels.len().max(1) => *index,
            Some(Channel::Index(index)) => {
                let expected = match channels.len() {
                    0 | 1 => "0, the only channel of this file".into(),
                    n => format!("0 to {}: {}", n - 1, listed(&channels)),
                };
                return Err(Error::argument("--channel", index, expected, "channels count from 0"));
            }
            Some(Channel::Name(name)) => channels.iter().position(|c| c == name).ok_or_else(|| {
                let expected = match channels.len() {
                    0 | 1 => "a file of several channels; this has one".into(),
                    _ => format!("one of {}", listed(&channels)),
                };
                Error::argument("--channel", name, expected, "see `isolume info` for the list, or leave it out")
            })?,
        };
        let last = timepoints.max(1) - 1;
        let timepoint = self.timepoint.unwrap_or(0);
        if timepoint > last {
            let expected = match last {
                0 => "0, the only time point of this file".into(),
                last => format!("0 to {last}"),
            };
            return Err(Error::argument("--timepoint", timepoint, expected, "time points count from 0"));
        }
        if channels.len() > 1 {
            let name = channels.get(channel).filter(|n| !n.is_empty()).map(|n| format!(" ({n})")).unwrap_or_default();
            notes.push(note(format!("channel {channel}{name} of {} is read", channels.len()), 1));
        }
        if last > 0 {
            let how = if self.timepoint.is_none() { "; choose with --timepoint" } else { "" };
            notes.push(note(format!("time point {timepoint} of {timepoints} is read (from 0){how}"), 1));
        }
        Ok(Series { channels, channel, timepoints: timepoints.max(1), timepoint, ..Series::default() })
    }
}

/// Most names that a message lists.
const MOST_LISTED: usize = 12;

/// `density, velocity`.
fn named(arrays: &[String]) -> String {
    let dots = if arrays.len() > MOST_LISTED { ", …" } else { "" };
    format!("{}{dots}", arrays.iter().take(MOST_LISTED).map(String::as_str).collect::<Vec<_>>().join(", "))
}

/// `0 DAPI, 1 GFP`.
fn listed(channels: &[String]) -> String {
    let one = |(i, name): (usize, &String)| format!("{i} {name}").trim_end().to_string();
    let mut text = channels.iter().enumerate().take(MOST_LISTED).map(one).collect::<Vec<_>>().join(", ");
    if channels.len() > MOST_LISTED {
        text += ", …";
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn spacings_are_read_with_their_unit() {
        let spacing = |text: &str| text.parse::<Spacing>().map(|s| (s.along, s.metres)).ok();
        assert_eq!(spacing("1,2,3"), Some(([1.0, 2.0, 3.0], None)));
        assert_eq!(spacing("0.5, 0.5, 2um"), Some(([0.5, 0.5, 2.0], Some(1e-6))));
        assert_eq!(spacing("1,1,1.5 µm"), Some(([1.0, 1.0, 1.5], Some(1e-6))));
        assert_eq!(spacing("1e-3,1,1A"), Some(([1e-3, 1.0, 1.0], Some(1e-10))));
        for wrong in ["", "1,2", "1,2,3,4", "0,1,1", "-1,1,1", "nan,1,1", "1,2,3 parsec", "1e999,1,1", "mm"] {
            let text = wrong.parse::<Spacing>().unwrap_err().to_string();
            assert!(text.contains("0.5,0.5,2um"), "{text}");
        }
    }

    #[test]
    fn levels_and_regions_are_read_and_kept_inside() {
        let level = |text: &str, levels: &[[u64; 3]]| text.parse::<Level>().and_then(|l| l.among(levels)).ok();
        let pyramid = [[2048, 2048, 1024], [1024, 1024, 512], [512, 512, 256]];
        assert_eq!((level("0", &pyramid), level("2", &pyramid), level("3", &pyramid)), (Some(0), Some(2), None));
        // 1024 × 1024 × 512 is twice what auto takes; of what is all too large the last.
        assert_eq!((level("auto", &pyramid), level("auto", &pyramid[..2])), (Some(2), Some(1)));
        assert_eq!((level("auto", &[]), level("-1", &pyramid), level("fine", &pyramid)), (Some(0), None, None));
        let within = |text: &str| text.parse::<Region>().and_then(|r| r.within([10, 20, 30])).ok();
        assert_eq!(within("2:5,0:20,:"), Some(([2, 0, 0], [3, 20, 30])));
        assert_eq!(within(" 9: , :1, 29:30 "), Some(([9, 0, 29], [1, 1, 1])));
        for wrong in
            ["", "1:2", "1:2,1:2,1:2,1:2", "0:11,:,:", "5:5,:,:", "5:4,:,:", "10:,:,:", "-1:3,:,:", "a:b,:,:", "1,2,3"]
        {
            assert_eq!(within(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn a_spacing_keeps_directions_and_the_place_of_the_origin() {
        let turned = DMat3::from_cols(2.0 * DVec3::Y, -2.0 * DVec3::X, 4.0 * DVec3::Z);
        let file = Affine::new(turned, DVec3::new(10.0, 0.0, 0.0)).unwrap();
        let (made, unit) = "1,1,3um".parse::<Spacing>().unwrap().apply(file, LengthUnit::Metres(1e-3));
        let made = made.unwrap();
        assert_eq!(unit, LengthUnit::Metres(1e-6));
        assert_eq!(made.linear(), DMat3::from_cols(DVec3::Y, -DVec3::X, 3.0 * DVec3::Z));
        assert!((made.offset() - DVec3::new(10_000.0, 0.0, 0.0)).length() < 1e-9);
    }

    #[test]
    fn several_channels_are_refused_and_listed_unless_one_is_chosen() {
        let of = |channel: Option<&str>, timepoint: Option<usize>| {
            let choice = Choice { channel: channel.map(|c| c.parse().unwrap()), timepoint, ..Choice::default() };
            let mut notes = Vec::new();
            let names = vec!["DAPI".to_string(), "GFP".into()];
            choice
                .of("X", names, 3, &mut notes)
                .map(|s| (s.channel, s.timepoint, notes.len()))
                .map_err(|e| e.to_string())
        };
        let refused = of(None, None).unwrap_err();
        assert!(refused.contains("2 channels: 0 DAPI, 1 GFP") && refused.contains("--channel"), "{refused}");
        assert_eq!(of(Some("1"), None), Ok((1, 0, 2)));
        assert_eq!(of(Some("GFP"), Some(2)), Ok((1, 2, 2)));
        assert!(of(Some("2"), None).unwrap_err().contains("0 to 1"));
        assert!(of(Some("RFP"), None).unwrap_err().contains("0 DAPI, 1 GFP"));
        assert!(of(Some("0"), Some(3)).unwrap_err().contains("0 to 2"));
    }
}
