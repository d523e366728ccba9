//! DICOM series (PS3.3, PS3.5, PS3.10): single slices and enhanced multi-frame files with geometry, of a folder, a DICOMDIR or one
//! file.
//!
//! The order, the distance and the place of slices come from their positions, never from names, InstanceNumber, SliceThickness
//! or SpacingBetweenSlices: n = row × column of the orientation, sorted by n · position, one step between neighbours or it is
//! refused. Where positions do not run along n (gantry tilt) the map is sheared, exactly. World: RAS+ in millimetres, x and y of
//! DICOM's LPS negated. Names of patients are not read.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]

mod dataset;
mod order;
mod pixels;

use super::assemble::{Parts, assemble, mix, note};
use super::decode::{Data, checked_count};
use super::format::{affine, tiff};
use super::read::ReadHint;
use super::source::Source;
use super::{Choice, LengthUnit, Note, Series, Volume};
use crate::error::{Error, Result};
use crate::file;
use crate::geom::Up;
use dataset::*;
use glam::{DMat3, DVec3};
use order::Stack;
use pixels::Format;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

pub(crate) use dataset::is_dicom;

const NAME: &str = "DICOM";
/// Deepest folder and most files that are looked through.
const MOST_DEPTH: usize = 8;
const MOST_FILES: usize = 20_000;
/// Files of a folder without telling names whose first bytes are looked at.
const MOST_LOOKS: usize = 32;
/// Objects of segments, of which each is a channel (PS3.6, annex A).
const SEGMENTATION: &str = "1.2.840.10008.5.1.4.1.1.66.4";
/// The directory of a medium.
const DIRECTORY: &str = "1.2.840.10008.1.3.10";

/// A slice: a file, or a frame of one.
#[derive(Clone, Debug)]
struct Slice {
    /// Of the list of files.
    file: usize,
    frame: usize,
    /// Of the centre of its first sample, LPS.
    position: DVec3,
    slope: f64,
    intercept: f64,
    /// What tells slices at one place apart, in the order of importance.
    time: Vec<Option<f64>>,
    instance: String,
    number: Option<f64>,
    /// The segment that it belongs to.
    segment: Option<u16>,
}

/// Slices that can be one volume.
struct Group {
    format: Format,
    /// Along a row and along a column, unit vectors.
    axes: [DVec3; 2],
    /// Between columns and between rows.
    spacing: [f64; 2],
    padding: Option<(i64, i64)>,
    series: String,
    number: Option<f64>,
    description: String,
    modality: String,
    is_inverse: bool,
    /// Number and label of segments.
    segments: Vec<(u16, String)>,
    /// Transfer syntaxes of packed pixels.
    packed: BTreeSet<String>,
    frames: BTreeMap<usize, usize>,
    slices: Vec<Slice>,
}

/// Whether a folder is one of DICOM files.
pub(super) fn is_folder(folder: &Path) -> bool {
    let ends =
        |path: &Path| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("dcm") || e.eq_ignore_ascii_case("ima"));
    let mut looked = 0;
    let Ok(files) = list(folder) else { return false };
    files.iter().any(|path| {
        let name = path.file_name().map(|n| n.to_string_lossy().to_ascii_uppercase()).unwrap_or_default();
        if ends(path) || name == "DICOMDIR" {
            return true;
        }
        looked += 1;
        looked <= MOST_LOOKS && starts_as_dicom(path)
    })
}

fn starts_as_dicom(path: &Path) -> bool {
    let Ok((file, length)) = file::open(path) else { return false };
    Source::new(file, Some(length)).peek(132).is_ok_and(is_dicom)
}

/// Plain files below a folder, sorted by their paths.
fn list(folder: &Path) -> Result<Vec<PathBuf>> {
    let (mut folders, mut files) = (vec![(folder.to_path_buf(), 0)], Vec::new());
    while let Some((folder, depth)) = folders.pop() {
        let refuse = |e| Error::io(&folder, "list the folder", e);
        for entry in std::fs::read_dir(&folder).map_err(refuse)? {
            let entry = entry.map_err(refuse)?;
            let kind = entry.file_type().map_err(refuse)?;
            if kind.is_dir() && depth < MOST_DEPTH {
                folders.push((entry.path(), depth + 1));
            } else if entry.path().is_file() {
                files.push(entry.path());
            }
            if files.len() + folders.len() > MOST_FILES {
                return Err(Error::Limit {
                    what: format!("the folder {}", folder.display()),
                    needed: format!("more than {MOST_FILES} files"),
                    limit: format!("{MOST_FILES} files"),
                    remedy: "name the folder of one series".into(),
                });
            }
        }
    }
    files.sort();
    Ok(files)
}

/// Reads a series of the files below a folder.
///
/// # Errors
/// When there is none, or several and none is chosen; when slices are missing, or lie where no grid has them.
pub(super) fn open_folder(folder: &Path, hint: &ReadHint) -> Result<Volume> {
    let in_folder = |e: Error| e.in_file(folder);
    let files = list(folder).map_err(in_folder)?;
    let name = folder.canonicalize().ok().and_then(|p| p.file_name().map(|n| n.to_string_lossy().into_owned()));
    let hint = ReadHint { name: name.unwrap_or_else(|| hint.name.clone()), ..hint.clone() };
    read_files(&files, &hint, None).map_err(in_folder)
}

/// Reads a file: its frames, or the series in its folder that it is a slice of.
///
/// # Errors
/// As [`open_folder`].
pub(super) fn open_file(path: &Path, hint: &ReadHint) -> Result<Volume> {
    let in_file = |e: Error| e.in_file(path);
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let (source, length) = file::open(path)?;
    let head = Head::read(Source::new(source, Some(length))).map_err(in_file)?;
    let Some(head) = head else { return Err(in_file(damaged("no DICOM file", "one"))) };
    if head.data.text(SOP_CLASS).or(head.data.text(0x0002_0002)).is_some_and(|class| class == DIRECTORY) {
        return open_folder(folder, hint);
    }
    let frames = head.data.number(FRAMES).unwrap_or(1.0);
    if frames > 1.0 || head.data.item(FRAME_GROUPS).is_some() {
        return read_files(&[path.to_path_buf()], hint, None).map_err(in_file);
    }
    let series = head.data.text(SERIES).unwrap_or_default();
    // Its neighbours alone: other folders may hold copies.
    let mut files: Vec<PathBuf> = list(folder)?.into_iter().filter(|file| file.parent() == path.parent()).collect();
    if files.is_empty() {
        files.push(path.to_path_buf());
    }
    let mut volume = read_files(&files, hint, Some(&series)).map_err(in_file)?;
    volume.notes.push(note("one slice was named: its series in the same folder is read", 1));
    Ok(volume)
}

/// Reads from a stream: one file of several frames.
pub(super) fn read_stream(source: Source, hint: &ReadHint) -> Result<Volume> {
    let Some(mut head) = Head::read(source)? else { return Err(damaged("no DICOM file", "one")) };
    let mut groups = Groups::default();
    groups.add(0, &head)?;
    let mut notes = Vec::new();
    let (group, scans) = groups.choose(&hint.choice, None, &mut notes)?;
    let frames = group.frames.get(&0).copied().unwrap_or(1);
    let mut all = Some(pixels::read(&mut head, &group.format, checked_frames(&group, frames, hint)?)?);
    build(group, scans, hint, notes, &mut |_| Ok(all.take().unwrap_or_default()))
}

/// Refuses more samples than may be read, before they are.
fn checked_frames(group: &Group, frames: usize, hint: &ReadHint) -> Result<usize> {
    let size = group.format.sample_type().size();
    checked_count(NAME, [group.format.columns, group.format.rows, frames as u64], size, None, hint)?;
    Ok(frames)
}

fn read_files(files: &[PathBuf], hint: &ReadHint, series: Option<&str>) -> Result<Volume> {
    let (mut groups, mut others) = (Groups::default(), Vec::new());
    for (number, path) in files.iter().enumerate() {
        let in_file = |e: Error| e.in_file(path);
        let (source, length) = file::open(path)?;
        match Head::read(Source::new(source, Some(length))) {
            Ok(Some(head)) => groups.add(number, &head).map_err(in_file)?,
            Ok(None) => others.push(path),
            Err(e) => return Err(in_file(e)),
        }
    }
    let mut notes = Vec::new();
    if !others.is_empty() {
        let name = |path: &&PathBuf| path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let some = others.iter().take(5).map(name).collect::<Vec<_>>().join(", ");
        let dots = if others.len() > 5 { ", …" } else { "" };
        notes.push(note(format!("{} other files are ignored: {some}{dots}", others.len()), others.len()));
    }
    let (group, scans) = groups.choose(&hint.choice, series, &mut notes)?;
    let (format, frames) = (group.format.clone(), group.frames.clone());
    let limits: Vec<usize> = frames.values().copied().collect();
    limits.iter().try_for_each(|n| checked_frames(&group, *n, hint).map(drop))?;
    let mut read = |number: usize| {
        let path = files.get(number).ok_or_else(|| damaged("no such file", "it"))?;
        let (source, length) = file::open(path)?;
        let head = Head::read(Source::new(source, Some(length)))?;
        let mut head = head.ok_or_else(|| damaged("another file than before", "it unchanged"))?;
        pixels::read(&mut head, &format, frames.get(&number).copied().unwrap_or(1)).map_err(|e| e.in_file(path))
    };
    build(group, scans, hint, notes, &mut read)
}

/// All slices, by what they can be one volume with.
#[derive(Default)]
struct Groups {
    groups: BTreeMap<String, Group>,
    /// Objects without a place in space, by why.
    unplaced: BTreeMap<&'static str, usize>,
}

impl Groups {
    fn add(&mut self, file: usize, head: &Head) -> Result<()> {
        let data = &head.data;
        if head.pixels == Pixels::Missing {
            *self.unplaced.entry("no pixels").or_default() += 1;
            return Ok(());
        }
        let format = format_of(data)?;
        let is_real = head.pixels == Pixels::Real;
        if is_real || format.columns == 0 || format.rows == 0 {
            *self.unplaced.entry("no pixels of whole numbers").or_default() += 1;
            return Ok(());
        }
        let photometric = data.text(PHOTOMETRIC).unwrap_or_else(|| "MONOCHROME2".into());
        if !photometric.starts_with("MONOCHROME") || data.short(SAMPLES_PER_PIXEL).unwrap_or(1) != 1 {
            *self.unplaced.entry("pictures in colour").or_default() += 1;
            return Ok(());
        }
        let frames = data.number(FRAMES).unwrap_or(1.0);
        let has_groups = data.item(FRAME_GROUPS).is_some() || data.item(SHARED_GROUPS).is_some();
        if frames > 1.0 && !has_groups {
            *self.unplaced.entry("frames without functional groups").or_default() += 1;
            return Ok(());
        }
        if !(1.0..=1e6).contains(&frames) {
            return Err(damaged(format!("{frames} frames"), "1 to 1,000,000"));
        }
        let (frames, shared) = (frames as usize, data.item(SHARED_GROUPS));
        if has_groups && data.items(FRAME_GROUPS).len() != frames {
            return Err(damaged(
                format!("{} groups of {frames} frames", data.items(FRAME_GROUPS).len()),
                "one for each",
            ));
        }
        for frame in 0..frames {
            let own = data.items(FRAME_GROUPS).get(frame);
            // Of a frame its own groups, then those of all; of a single slice the elements themselves.
            let part = |group: Tag| match has_groups {
                true => own.and_then(|g| g.item(group)).or_else(|| shared.and_then(|g| g.item(group))),
                false => Some(data),
            };
            let orientation = part(PLANE_ORIENTATION).and_then(|g| g.numbers::<6>(ORIENTATION));
            let position = part(PLANE_POSITION).and_then(|g| g.numbers::<3>(POSITION));
            let spacing = part(PIXEL_MEASURES).and_then(|g| g.numbers::<2>(PIXEL_SPACING));
            let (Some(orientation), Some(position), Some(spacing)) = (orientation, position, spacing) else {
                *self.unplaced.entry("no position, orientation or spacing").or_default() += 1;
                return Ok(());
            };
            let axes = axes_of(orientation)?;
            if !spacing.iter().all(|s| *s > 0.0) {
                return Err(damaged(format!("PixelSpacing {spacing:?}"), "two positive numbers"));
            }
            let values = part(PIXEL_VALUES);
            let scale = |tag: Tag, default: f64| values.and_then(|g| g.number(tag)).unwrap_or(default);
            let content = own.and_then(|g| g.item(FRAME_CONTENT));
            let time = vec![
                content.and_then(|g| g.long(TEMPORAL_INDEX)).map(f64::from).or(data.number(TEMPORAL_POSITION)),
                data.number(ACQUISITION),
                data.number(TRIGGER_TIME),
                data.number(ECHO),
                data.double(B_VALUE),
            ];
            let segment = own.and_then(|g| g.item(SEGMENT)).and_then(|g| g.short(REFERENCED_SEGMENT));
            let slice = Slice {
                file,
                frame,
                position: DVec3::from_array(position),
                slope: scale(SLOPE, 1.0),
                intercept: scale(INTERCEPT, 0.0),
                time,
                instance: data.text(SOP_INSTANCE).unwrap_or_default(),
                number: data.number(INSTANCE_NUMBER),
                segment,
            };
            let series = data.text(SERIES).unwrap_or_default();
            let number = data.number(SERIES_NUMBER);
            // Directions as they are written differ in the last digits from slice to slice.
            let rounded = orientation.map(|v| libm::round(v * 1e3) + 0.0);
            let [rows, columns] = spacing.map(|s| libm::round(s * 1e4));
            let key = format!("{:020.3} {series} {rounded:?} {rows} {columns} {format:?}", number.unwrap_or(0.0));
            let group = self.groups.entry(key).or_insert_with(|| Group {
                format: format.clone(),
                axes,
                // Between rows comes first (PS3.3, 10.7.1.3).
                spacing: [spacing[1], spacing[0]],
                padding: padding(data, &format),
                series,
                number,
                description: data.text(DESCRIPTION).unwrap_or_default(),
                modality: data.text(MODALITY).unwrap_or_else(|| "unknown".into()),
                is_inverse: photometric == "MONOCHROME1" && values.and_then(|g| g.number(SLOPE)).is_none(),
                segments: segments(data),
                packed: BTreeSet::new(),
                frames: BTreeMap::new(),
                slices: Vec::new(),
            });
            group.frames.insert(file, frames);
            group.slices.push(slice);
            if head.pixels == Pixels::Packed {
                group.packed.insert(head.syntax.clone());
            }
        }
        Ok(())
    }

    /// The group that is chosen, and what there is to choose from.
    fn choose(self, choice: &Choice, series: Option<&str>, notes: &mut Vec<Note>) -> Result<(Group, Series)> {
        let groups: Vec<Group> = self.groups.into_values().collect();
        for (why, count) in &self.unplaced {
            notes.push(note(format!("{count} files are left out: {why}"), *count));
        }
        let listed: Vec<String> = groups.iter().map(Group::title).collect();
        let list = || listed.iter().enumerate().map(|(i, title)| format!("\n  {i} {title}")).collect::<String>();
        let chosen = match (&choice.series, series) {
            (Some(wanted), _) => {
                let by_uid = |uid: &str| groups.iter().position(|g| g.series == uid);
                let found = wanted.parse::<usize>().ok().filter(|i| *i < groups.len()).or_else(|| by_uid(wanted));
                found.ok_or_else(|| {
                    let expected = format!("a number from 0, or the UID of one of {} series:{}", groups.len(), list());
                    Error::argument("--series", wanted, expected, "see `isolume info` for the list")
                })?
            }
            (None, Some(series)) => {
                // The largest of the series that a slice belongs to.
                let of_series = (0..groups.len()).filter(|&i| groups[i].series == series);
                let found = of_series.max_by_key(|&i| (groups[i].slices.len(), std::cmp::Reverse(i)));
                found.ok_or_else(|| damaged("a slice without place", "position, orientation and spacing"))?
            }
            (None, None) => match groups.len() {
                0 => {
                    let why: Vec<String> =
                        self.unplaced.iter().map(|(why, count)| format!("{count} with {why}")).collect();
                    let found = if why.is_empty() {
                        "no DICOM file".into()
                    } else {
                        format!("no slice with a place: {}", why.join(", "))
                    };
                    let remedy = if why.is_empty() {
                        "name the folder of a series, or a file of it"
                    } else {
                        "convert it, for example: dcm2niix -z y -o OUT FOLDER"
                    };
                    return Err(Error::format(NAME, found, "slices with position, orientation and spacing", remedy));
                }
                1 => 0,
                n if choice.any_channel => {
                    let largest = (0..n).max_by_key(|&i| (groups[i].slices.len(), std::cmp::Reverse(i))).unwrap_or(0);
                    notes.push(note(format!("the largest of {n} series is looked at; choose with --series"), n));
                    largest
                }
                n => {
                    let found = format!("{n} series:{}\n", list());
                    return Err(Error::format(NAME, found, "one series", "choose one with --series N"));
                }
            },
        };
        let found = Series { scans: listed, scan: chosen, ..Series::default() };
        let group = groups.into_iter().nth(chosen).ok_or_else(|| damaged("no series", "one"))?;
        group.packed.iter().try_for_each(|syntax| pixels::check_syntax(syntax))?;
        Ok((group, found))
    }
}

impl Group {
    /// Number, description, modality, slices and size.
    fn title(&self) -> String {
        let number = self.number.map(|n| format!("series {n}, ")).unwrap_or_default();
        let text = if self.description.is_empty() { String::new() } else { format!("{}, ", self.description) };
        let size = format!("{} slices of {} × {}", self.slices.len(), self.format.columns, self.format.rows);
        format!("{number}{text}{}, {size}, UID {}", self.modality, self.series)
    }
}

fn format_of(data: &DataSet) -> Result<Format> {
    let short = |tag: Tag| u64::from(data.short(tag).unwrap_or(0));
    let allocated = data.short(BITS_ALLOCATED).unwrap_or(16);
    let stored = data.short(BITS_STORED).unwrap_or(allocated);
    let high = data.short(HIGH_BIT).unwrap_or(stored.saturating_sub(1));
    if !matches!(allocated, 1 | 8 | 16 | 32)
        || stored == 0
        || stored > allocated
        || high >= allocated
        || high + 1 < stored
    {
        return Err(damaged(format!("{stored} bits below {high} of {allocated}"), "samples of 1, 8, 16 or 32 bits"));
    }
    let is_signed = data.short(IS_SIGNED).unwrap_or(0) == 1;
    Ok(Format { columns: short(COLUMNS), rows: short(ROWS), allocated, stored, high, is_signed })
}

/// Directions along a row and along a column, of unit length.
fn axes_of([a, b, c, d, e, f]: [f64; 6]) -> Result<[DVec3; 2]> {
    let axes = [DVec3::new(a, b, c), DVec3::new(d, e, f)];
    let is_sound = axes.iter().all(|v| (v.length() - 1.0).abs() < 0.01) && axes[0].dot(axes[1]).abs() < 0.01;
    if is_sound {
        return Ok(axes.map(DVec3::normalize));
    }
    Err(damaged(format!("ImageOrientationPatient {} and {}", axes[0], axes[1]), "two unit vectors at a right angle"))
}

/// The range of stored samples that stand for nothing.
fn padding(data: &DataSet, format: &Format) -> Option<(i64, i64)> {
    let signed = |raw: u16| if format.is_signed { i64::from(raw as i16) } else { i64::from(raw) };
    let first = signed(data.short(PADDING)?);
    let last = data.short(PADDING_LIMIT).map_or(first, signed);
    Some((first.min(last), first.max(last)))
}

fn segments(data: &DataSet) -> Vec<(u16, String)> {
    if data.text(SOP_CLASS).is_none_or(|class| class != SEGMENTATION) {
        return Vec::new();
    }
    let one = |item: &DataSet| Some((item.short(SEGMENT_NUMBER)?, item.text(SEGMENT_LABEL).unwrap_or_default()));
    data.items(SEGMENTS).iter().filter_map(one).collect()
}

/// Reads the frames of a file, all of them, one after the other.
type ReadFile<'a> = &'a mut dyn FnMut(usize) -> Result<Vec<Data>>;

/// The volume of a group.
fn build(mut group: Group, found: Series, hint: &ReadHint, mut notes: Vec<Note>, read: ReadFile) -> Result<Volume> {
    if group.is_inverse {
        let quantities = ["CT", "MR", "PT", "NM"];
        if quantities.contains(&group.modality.as_str()) {
            let found = format!("{} in MONOCHROME1 without RescaleSlope", group.modality);
            let remedy = "large values would be dark: convert it, for example with dcm2niix";
            return Err(Error::format(NAME, found, "MONOCHROME2, or a rescale slope", remedy));
        }
        notes.push(note("MONOCHROME1: large values are dark in pictures; they are read as stored", 1));
    }
    let labels: Vec<String> = group.segments.iter().map(|(_, label)| label.clone()).collect();
    let normal = group.axes[0].cross(group.axes[1]);
    let mut stack = Stack::sorted(std::mem::take(&mut group.slices), normal);
    // Where all segments together have slices, one of them may have none.
    let lattice = if group.segments.is_empty() { None } else { Some(stack.lattice(normal, true)?) };
    let mut series = if group.segments.is_empty() {
        stack.drop_copies(&group.format, read, &mut notes)?;
        let times = stack.timepoints()?;
        let series = hint.choice.of(NAME, Vec::new(), times, &mut notes)?;
        stack.take_time(series.timepoint);
        series
    } else {
        let series = hint.choice.of(NAME, labels, 1, &mut notes)?;
        let number = group.segments.get(series.channel).map(|(number, _)| *number);
        stack.slices.retain(|slice| slice.segment == number);
        series
    };
    (series.scans, series.scan) = (found.scans, found.scan);
    let is_segment = lattice.is_some();
    let lattice = match lattice {
        Some(lattice) => lattice,
        None => stack.lattice(normal, hint.choice.allow_gaps)?,
    };
    let [column, row] = [0, 1].map(|i| group.axes[i] * group.spacing[i]);
    lattice.tell(normal, &mut notes);
    let format = &group.format;
    let dims = [format.columns, format.rows, lattice.count as u64];
    checked_count(NAME, dims, format.sample_type().size(), None, hint)?;
    let places: Vec<usize> = stack.slices.iter().map(|slice| lattice.place(slice.position, normal)).collect();
    let sections = stack.read(format, read)?;
    let values = Values::of(&stack.slices, sections, group.padding, &mut notes);
    let data = values.stacked(&places, lattice.count, is_segment)?;
    let missing = lattice.count - places.len();
    if missing > 0 && !is_segment {
        notes.push(note(format!("{missing} missing slices are interpolated between their neighbours"), missing));
    }
    let ras_from_lps = DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0));
    let linear = ras_from_lps * DMat3::from_cols(column, row, lattice.step);
    let world_from_grid = affine(NAME, linear, ras_from_lps * lattice.first)?;
    let (slope, inter) = (values.slope, values.intercept);
    let dims = dims.map(|n| n as usize);
    let unit = LengthUnit::Metres(1e-3);
    let mut volume =
        assemble(Parts { format: NAME, dims, data, slope, inter, world_from_grid, unit, series, notes }, hint)?;
    volume.up = Up::Anatomical;
    Ok(volume)
}

/// The samples of all sections with what makes values of them.
struct Values {
    sections: Vec<Data>,
    slope: f64,
    intercept: f64,
}

impl Values {
    /// One slope and intercept where all slices have the same, else values. What is padding becomes the lowest sample.
    fn of(slices: &[Slice], mut sections: Vec<Data>, padding: Option<(i64, i64)>, notes: &mut Vec<Note>) -> Self {
        if let Some((first, last)) = padding {
            let count = fill_padding(&mut sections, first, last);
            if count > 0 {
                notes.push(note("padding (PixelPaddingValue) was replaced by the lowest sample", count));
            }
        }
        let of = |slice: &Slice| (slice.slope, slice.intercept);
        let (slope, intercept) = slices.first().map_or((1.0, 0.0), of);
        if slices.iter().all(|slice| of(slice) == (slope, intercept)) {
            return Self { sections, slope, intercept };
        }
        let scaled = |(section, slice): (&Data, &Slice)| {
            let value = |raw: f64| (raw * slice.slope + slice.intercept) as f32;
            Data::F32(section.numbers().into_iter().map(value).collect())
        };
        let sections = sections.iter().zip(slices).map(scaled).collect();
        notes.push(note("slopes or intercepts differ from slice to slice: values are float32", slices.len()));
        Self { sections, slope: 1.0, intercept: 0.0 }
    }

    /// The sections at their places; between them what is interpolated, or nothing of a segment.
    fn stacked(&self, places: &[usize], count: usize, is_segment: bool) -> Result<Data> {
        let mut stack = None;
        for z in 0..count {
            let next = places.partition_point(|place| *place < z);
            let section = match (places.get(next), self.sections.get(next)) {
                (Some(place), Some(section)) if *place == z => section.clone(),
                (_, Some(section)) if is_segment => mix(section, section, 0.0, 0.0),
                (None, _) if is_segment => {
                    let any = self.sections.first().ok_or_else(|| damaged("a segment without frames", "some"))?;
                    mix(any, any, 0.0, 0.0)
                }
                (Some(above), Some(high)) if next > 0 => {
                    let (below, low) = (places[next - 1], &self.sections[next - 1]);
                    let t = (z - below) as f64 / (above - below) as f64;
                    mix(low, high, 1.0 - t, t)
                }
                _ => return Err(damaged("a slice that is missing", "it")),
            };
            tiff::append(&mut stack, section)?;
        }
        stack.ok_or_else(|| damaged("no slices", "some"))
    }
}

/// Replaces samples in a range by the lowest outside; how many there were.
fn fill_padding(sections: &mut [Data], first: i64, last: i64) -> usize {
    macro_rules! each {
        ($section:expr, $v:ident => $body:expr) => {
            match $section {
                Data::U8($v) => $body,
                Data::I8($v) => $body,
                Data::U16($v) => $body,
                Data::I16($v) => $body,
                Data::U32($v) => $body,
                Data::I32($v) => $body,
                _ => continue,
            }
        };
    }
    let is_padding = |v: i64| (first..=last).contains(&v);
    let mut lowest: Option<i64> = None;
    for section in sections.iter() {
        each!(section, v => {
            let low = v.iter().map(|s| i64::from(*s)).filter(|s| !is_padding(*s)).min();
            lowest = [lowest, low].into_iter().flatten().min();
        });
    }
    let Some(lowest) = lowest else { return 0 };
    let mut count = 0;
    for section in sections.iter_mut() {
        each!(section, v => for sample in v.iter_mut().filter(|s| is_padding(i64::from(**s))) {
            *sample = lowest as _;
            count += 1;
        });
    }
    count
}

#[cfg(test)]
mod tests;
