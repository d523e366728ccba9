//! MetaImage (.mha, .mhd with a data file), by hand: no crate reads it. Format: the MetaIO documentation of ITK's wiki. Three
//! axes of space, one of time, and channels, which run fastest; binary in either byte order, zlib, or text.
//!
//! World: rows of TransformMatrix are the axes, Offset is the centre of the first sample; left-posterior-superior in
//! millimetres as ITK takes them whatever AnatomicalOrientation says, so that x and y change sign to RAS+.

#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

use super::super::assemble::{Parts, assemble, note};
use super::super::decode::{self, Endian, Type, checked_count};
use super::super::mapped::Stored;
use super::super::read::{OpenBeside, ReadHint};
use super::super::source::Source;
use super::super::{LengthUnit, Note, Series, Volume};
use super::{affine, metres_in, needs_second_file};
use crate::error::{Error, Result};
use crate::geom::{Affine, Up};
use glam::{DMat3, DVec3};
use std::collections::HashMap;
use std::path::Path;

const NAME: &str = "MetaImage";
/// More header lines than any file has.
const MOST_LINES: usize = 10_000;
/// Most channels of a sample.
const MOST_CHANNELS: u64 = 1 << 16;

/// Whether the first line that says something is one of the two that a header starts with.
pub(crate) fn is_metaimage(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(head);
    let line = text
        .trim_start_matches('\u{feff}')
        .lines()
        .map(str::trim)
        .find(|line| !line.is_empty() && !line.starts_with('#'));
    let key = line.and_then(|line| line.split_once('=')).map(|(key, _)| key.trim().to_ascii_lowercase());
    key.is_some_and(|key| key == "objecttype" || key == "ndims")
}

/// The fields of a header by their name in lower case.
struct Header(HashMap<String, String>);

fn damaged(name: &str, value: &str) -> Error {
    Error::format(NAME, format!("{name} = {value}"), "a value as MetaImage asks for", "correct the header")
}

impl Header {
    /// Reads up to ElementDataFile, which is the last field.
    fn parse(source: &mut Source) -> Result<Self> {
        let mut fields = HashMap::new();
        for _ in 0..MOST_LINES {
            let line = source.expect_line(NAME, "ElementDataFile")?;
            let line = line.trim_start_matches('\u{feff}').trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let Some((key, value)) = line.split_once('=') else {
                return Err(Error::format(
                    NAME,
                    format!("the header line {line:?}"),
                    "key = value",
                    "the header is damaged",
                ));
            };
            let key = key.trim().to_ascii_lowercase();
            let is_last = key == "elementdatafile";
            fields.insert(key, value.trim().to_string());
            if is_last {
                return Ok(Self(fields));
            }
        }
        Err(Error::format(NAME, "a header without end", "ElementDataFile after the header", "the file is damaged"))
    }

    /// A field under any of its names, and that name.
    fn get<'n>(&self, names: &[&'n str]) -> Option<(&'n str, &str)> {
        names.iter().find_map(|n| Some((*n, self.0.get(&n.to_ascii_lowercase())?.as_str())))
    }

    fn need(&self, name: &str) -> Result<&str> {
        let missing =
            || Error::format(NAME, format!("no field {name}"), "it in the header", "add the field to the header");
        self.get(&[name]).map(|(_, value)| value).ok_or_else(missing)
    }

    /// As many numbers as said.
    fn numbers<T: std::str::FromStr>(&self, names: &[&str], count: usize) -> Result<Option<Vec<T>>> {
        let Some((name, text)) = self.get(names) else { return Ok(None) };
        let numbers: Option<Vec<T>> = text.split_whitespace().map(|w| w.parse().ok()).collect();
        numbers.filter(|n| n.len() == count).map(Some).ok_or_else(|| damaged(name, text))
    }

    fn number<T: std::str::FromStr>(&self, name: &str, default: T) -> Result<T> {
        Ok(self.numbers(&[name], 1)?.and_then(|n| n.into_iter().next()).unwrap_or(default))
    }

    fn is(&self, names: &[&str], default: bool) -> Result<bool> {
        match self.get(names) {
            None => Ok(default),
            Some((name, value)) => match value.to_ascii_lowercase().as_str() {
                "true" | "1" => Ok(true),
                "false" | "0" => Ok(false),
                _ => Err(damaged(name, value)),
            },
        }
    }
}

pub(crate) fn read(mut source: Source, hint: &ReadHint, beside: Option<OpenBeside>) -> Result<Volume> {
    let header = Header::parse(&mut source)?;
    if let Some((name, object)) = header.get(&["ObjectType"])
        && !object.eq_ignore_ascii_case("image")
    {
        let remedy = "give the image; meshes and tubes have no samples";
        return Err(Error::format(NAME, format!("{name} = {object}"), "Image", remedy));
    }
    let mut notes = Vec::new();
    let rank: usize = header.number("NDims", 0)?;
    if !(3..=4).contains(&rank) {
        let remedy = "stack pictures into a volume, or cut out a part, for example with SimpleITK";
        return Err(Error::format(NAME, format!("NDims = {rank}"), "3, or 4 with time", remedy));
    }
    let sizes: Vec<u64> = header.numbers(&["DimSize"], rank)?.ok_or_else(|| damaged("DimSize", "missing"))?;
    let (&[x, y, z], after) = sizes.split_first_chunk::<3>().ok_or_else(|| damaged("DimSize", "missing"))?;
    let times = after.first().copied().unwrap_or(1);
    let channels: u64 = header.number("ElementNumberOfChannels", 1)?;
    if !(1..=MOST_CHANNELS).contains(&channels) || times == 0 {
        return Err(damaged("ElementNumberOfChannels or DimSize", &format!("{channels}, {times} time points")));
    }
    let names = vec![String::new(); channels as usize];
    let series = hint.choice.of(NAME, names, usize::try_from(times).unwrap_or(usize::MAX), &mut notes)?;
    let kind = sample_type(header.need("ElementType")?, &mut notes)?;
    let (world_from_grid, unit) = world(&header, rank, &mut notes)?;
    let part = Part { dims: [x, y, z], channels, times, kind, series: &series };
    let name = header.need("ElementDataFile")?;
    let data = if name.eq_ignore_ascii_case("local") {
        part.samples(source, &header, 0, hint, &mut notes)?
    } else {
        if name.eq_ignore_ascii_case("list") || name.contains('%') {
            let found = format!("samples spread over several files (ElementDataFile = {name})");
            let remedy = "join them in Python:\n  import SimpleITK as sitk\n  sitk.WriteImage(sitk.ReadImage(\"FILE\"), \"FILE.mha\")";
            return Err(Error::format(NAME, found, "one data file", remedy));
        }
        let open = beside.ok_or_else(|| needs_second_file(NAME, name))?;
        let skip = header.number("HeaderSize", 0)?;
        part.samples(open(Path::new(name))?, &header, skip, hint, &mut notes).map_err(|e| e.in_file(name))?
    };
    let dims = part.dims.map(|n| n as usize);
    let (nx, ny, n) = (x as usize, y as usize, channels as usize);
    let data = if n == 1 { data } else { data.pick(series.channel, [n, n * nx, n * nx * ny], dims) };
    let is_anatomical = header.get(&["AnatomicalOrientation"]).is_some_and(|(_, text)| !text.contains('?'));
    let parts = Parts { format: NAME, dims, data, slope: 1.0, inter: 0.0, world_from_grid, unit, series, notes };
    let mut volume = assemble(parts, hint)?;
    if is_anatomical {
        volume.up = Up::Anatomical;
    }
    Ok(volume)
}

/// The samples to read: one time point of all channels.
struct Part<'a> {
    dims: [u64; 3],
    channels: u64,
    times: u64,
    kind: Type,
    series: &'a Series,
}

impl Part<'_> {
    fn samples(
        &self,
        mut source: Source,
        header: &Header,
        skip: i64,
        hint: &ReadHint,
        notes: &mut Vec<Note>,
    ) -> Result<Stored> {
        let Self { dims: [x, y, z], channels, times, kind, series } = *self;
        let refuse = || damaged("DimSize", "more than 2^64 bytes");
        let size = kind.size() as u64;
        let row = x.checked_mul(channels).ok_or_else(refuse)?;
        let one = [row, y, z].iter().try_fold(size, |n, &d| n.checked_mul(d)).ok_or_else(refuse)?;
        let all = one.checked_mul(times).ok_or_else(refuse)?;
        let is_packed = header.is(&["CompressedData"], false)?;
        let skip = match skip {
            // The samples are the last bytes of the file.
            -1 if !is_packed => source.at_most().and_then(|n| n.checked_sub(all)).ok_or_else(|| {
                let remedy = "the data file is incomplete; copy it again";
                Error::format(NAME, "HeaderSize = -1 and too short a data file", "all samples", remedy)
            })?,
            skip => u64::try_from(skip).map_err(|_| damaged("HeaderSize", &skip.to_string()))?,
        };
        source.skip(NAME, skip, "the bytes that HeaderSize counts")?;
        if is_packed {
            source = source.inflate().map_err(|e| Error::from_read(NAME, "compressed samples", e))?;
        }
        let before = one.checked_mul(series.timepoint as u64).ok_or_else(refuse)?;
        let is_last = series.timepoint as u64 + 1 == times;
        let data = if header.is(&["BinaryData"], true)? {
            let order = ["BinaryDataByteOrderMSB", "ElementByteOrderMSB"];
            let endian = if header.is(&order, false)? { Endian::Big } else { Endian::Little };
            if size > 1 && header.get(&order).is_none() {
                notes.push(note("the header does not say the byte order: little-endian is taken", 1));
            }
            source.skip(NAME, before, "the time points before")?;
            let count = checked_count(NAME, [row, y, z], kind.size(), source.at_most(), hint)?;
            Stored::binary(&mut source, NAME, kind, endian, count)?
        } else {
            let mut token = Vec::new();
            for _ in 0..before / size {
                if !source.token(NAME, &mut token)? {
                    return Err(damaged("DimSize", "more samples than the file has"));
                }
            }
            // As text, each sample takes a digit and a separator.
            let left = source.at_most().map(|n| (n.saturating_add(1) / 2).saturating_mul(size));
            let count = checked_count(NAME, [row, y, z], kind.size(), left, hint)?;
            let data = decode::text(&mut source, NAME, kind, count)?;
            if is_last && source.token(NAME, &mut token)? {
                return Err(damaged("DimSize", "fewer samples than the file has"));
            }
            data.into()
        };
        if is_last {
            source.verify_end(NAME)?;
            if source.peek(1).is_ok_and(|rest| !rest.is_empty()) {
                notes.push(note("the file goes on after the last sample; check DimSize and ElementType", 1));
            }
        }
        Ok(data)
    }
}

fn sample_type(name: &str, notes: &mut Vec<Note>) -> Result<Type> {
    Ok(match name.to_ascii_uppercase().as_str() {
        "MET_UCHAR" => Type::U8,
        "MET_CHAR" => Type::I8,
        "MET_USHORT" => Type::U16,
        "MET_SHORT" => Type::I16,
        "MET_UINT" => Type::U32,
        "MET_INT" => Type::I32,
        // Four bytes on every machine (MetaIO's MET_ValueTypeSize).
        long @ ("MET_ULONG" | "MET_LONG") => {
            notes.push(note(format!("{long} samples are taken as 4 bytes each, as MetaIO does"), 1));
            if long == "MET_LONG" { Type::I32 } else { Type::U32 }
        }
        "MET_ULONG_LONG" => Type::U64,
        "MET_LONG_LONG" => Type::I64,
        "MET_FLOAT" => Type::F32,
        "MET_DOUBLE" => Type::F64,
        _ => {
            let found = format!("ElementType = {name}");
            let remedy = "convert the file to MET_SHORT or MET_FLOAT, for example with SimpleITK";
            return Err(Error::format(NAME, found, "an integer or a real number", remedy));
        }
    })
}

fn world(header: &Header, rank: usize, notes: &mut Vec<Note>) -> Result<(Affine, LengthUnit)> {
    let first = |v: &[f64]| v.first_chunk::<3>().map(|v| DVec3::from_array(*v)).unwrap_or_default();
    let spacing = match header.numbers::<f64>(&["ElementSpacing", "ElementSize"], rank)? {
        Some(spacing) => first(&spacing),
        None => {
            notes.push(note("the header has no ElementSpacing: 1 is used; see --spacing", 1));
            DVec3::ONE
        }
    };
    if !(spacing.is_finite() && spacing.min_element() > 0.0) {
        let found = format!("ElementSpacing = {spacing}");
        return Err(Error::format(
            NAME,
            found,
            "three positive numbers",
            "correct the header, or give --spacing X,Y,Z",
        ));
    }
    let origin = header.numbers::<f64>(&["Offset", "Position", "Origin"], rank)?.map_or(DVec3::ZERO, |v| first(&v));
    let names = ["TransformMatrix", "Orientation", "Rotation"];
    let axes = match header.numbers::<f64>(&names, rank * rank)? {
        None => DMat3::IDENTITY,
        Some(rows) => {
            let mut axes = rows.chunks(rank).map(|row| (first(row), row.get(3).copied().unwrap_or(0.0)));
            let mut next = || axes.next().filter(|(_, time)| *time == 0.0).map(|(axis, _)| axis);
            match (next(), next(), next()) {
                (Some(x), Some(y), Some(z)) => DMat3::from_cols(x, y, z),
                _ => return Err(damaged("TransformMatrix", "axes of space that run through time")),
            }
        }
    };
    let metres = match header.get(&["DistanceUnits"]) {
        Some((_, unit)) if !unit.contains('?') => metres_in(unit),
        _ => {
            notes.push(note("MetaImage names no unit: mm, as ITK has it; see --spacing", 1));
            Some(1e-3)
        }
    };
    let ras_from_lps = DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0));
    let linear = ras_from_lps * axes * DMat3::from_diagonal(spacing);
    Ok((affine(NAME, linear, ras_from_lps * origin)?, metres.map_or(LengthUnit::Unknown, LengthUnit::Metres)))
}
