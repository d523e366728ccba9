//! NRRD (teem.sourceforge.net/nrrd/format.html), by hand: no crate reads it. Attached and
//! detached headers; encodings raw, gzip and ascii; three spatial axes, one of time and one of components.
//!
//! World: `space directions` and `space origin`; the spaces that name left or posterior first
//! are converted to RAS+ by turning the sign of the axes that differ. Without a space, `spacings`
//! and `axis mins`, right-handed as given.

use super::super::assemble::{Parts, assemble, note};
use super::super::decode::{self, Endian, Type, checked_count};
use super::super::mapped::Stored;
use super::super::read::{OpenBeside, ReadHint};
use super::super::source::Source;
use super::super::{LengthUnit, Note, Volume};
use super::{affine, metres_in, needs_second_file};
use crate::error::{Error, Result};
use crate::geom::{Affine, Up};
use glam::{DMat3, DVec3};
use std::collections::HashMap;
use std::path::Path;

const NAME: &str = "NRRD";
/// More header lines than any real file has; key/value pairs may be many.
const MOST_LINES: usize = 10_000;

/// The fields of a header by their name in lower case.
struct Header(HashMap<String, String>);

impl Header {
    fn parse(source: &mut Source) -> Result<Self> {
        source.expect_line(NAME, "NRRD's magic")?;
        let mut fields = HashMap::new();
        for _ in 0..MOST_LINES {
            let Some(line) = source.line(NAME)? else { return Ok(Self(fields)) }; // detached: ends with the file
            if line.is_empty() {
                return Ok(Self(fields));
            }
            if line.starts_with('#') || line.contains(":=") {
                continue; // a comment, a key/value pair
            }
            let Some((name, value)) = line.split_once(':') else {
                return Err(Error::format(
                    NAME,
                    format!("the header line {line:?}"),
                    "field: value",
                    "the header is damaged, or lacks the empty line before the samples",
                ));
            };
            fields.insert(name.trim().to_ascii_lowercase(), value.trim().to_string());
        }
        Err(Error::format(NAME, "a header without end", "an empty line after the header", "the file is damaged"))
    }

    /// A field under any of its names.
    fn get(&self, names: &[&str]) -> Option<&str> {
        names.iter().find_map(|n| self.0.get(*n)).map(String::as_str)
    }

    fn need(&self, name: &str) -> Result<&str> {
        self.get(&[name]).ok_or_else(|| missing(name))
    }

    fn numbers<T: std::str::FromStr>(&self, names: &[&str]) -> Result<Option<Vec<T>>> {
        let Some(text) = self.get(names) else { return Ok(None) };
        let numbers: Option<Vec<T>> = text.split_whitespace().map(|w| w.parse().ok()).collect();
        numbers.map(Some).ok_or_else(|| damaged(names[0], text))
    }
}

fn missing(name: &str) -> Error {
    Error::format(NAME, format!("no field \"{name}\""), "it in the header", "add the field to the header")
}

fn damaged(name: &str, value: &str) -> Error {
    Error::format(NAME, format!("{name}: {value}"), "a value as the NRRD format asks for", "correct the header")
}

pub(crate) fn read(mut source: Source, hint: &ReadHint, beside: Option<OpenBeside>) -> Result<Volume> {
    let header = Header::parse(&mut source)?;
    let mut notes = Vec::new();
    let kind = sample_type(header.need("type")?)?;
    let rank: usize =
        header.need("dimension")?.parse().map_err(|_| damaged("dimension", header.need("dimension").unwrap_or("")))?;
    let sizes: Vec<u64> = header.numbers(&["sizes"])?.ok_or_else(|| missing("sizes"))?;
    if rank != sizes.len() {
        return Err(damaged("sizes", header.need("sizes")?));
    }
    let Axes { space: axes, time, components } = Axes::of(&header, &sizes)?;
    let dims = axes.map(|a| sizes[a]);
    let along = |axis: Option<usize>| axis.and_then(|a| sizes.get(a).copied()).unwrap_or(1);
    let names = vec![String::new(); usize::try_from(along(components)).unwrap_or(usize::MAX).min(MOST_COMPONENTS)];
    let timepoints = usize::try_from(along(time)).unwrap_or(usize::MAX);
    if along(components) > MOST_COMPONENTS as u64 {
        return Err(damaged("sizes", header.need("sizes")?));
    }
    let series = hint.choice.of(NAME, names, timepoints, &mut notes)?;
    let place = |axis: usize| match axis {
        a if Some(a) == time => series.timepoint as u64,
        a if Some(a) == components => series.channel as u64,
        _ => 0,
    };
    let part = Part::new(&sizes, axes, place)?;
    let (world_from_grid, unit) = world(&header, axes, rank, &mut notes)?;
    if header.get(&["old min", "oldmin", "old max", "oldmax"]).is_some() {
        notes.push(note("old min and old max are not applied: values are those stored", 1));
    }
    let mut skips = Skips {
        lines: header.numbers::<u64>(&["line skip", "lineskip"])?.and_then(|v| v.first().copied()).unwrap_or(0),
        bytes: header.numbers::<i64>(&["byte skip", "byteskip"])?.and_then(|v| v.first().copied()).unwrap_or(0),
    };
    let samples = |source: Source, skips: &Skips| samples(source, &header, kind, &part, skips, hint);
    let data = match header.get(&["data file", "datafile"]) {
        None => samples(source, &skips)?,
        Some(name) => {
            if name.starts_with("LIST") || name.contains('%') {
                return Err(Error::format(
                    NAME,
                    format!("samples spread over several files ({name})"),
                    "one data file",
                    "join them, for example with `unu save` or pynrrd",
                ));
            }
            let open = beside.ok_or_else(|| needs_second_file(NAME, name))?;
            let data_source = open(Path::new(name))?;
            if skips.bytes == -1 {
                skips.bytes = skip_to_tail(&data_source, kind, &sizes)?;
            }
            samples(data_source, &skips).map_err(|e| e.in_file(name))?
        }
    };
    let data = part.pick(data);
    let dims = dims.map(|d| d as usize);
    let anatomical = header.get(&["space directions"]).is_some() && header.get(&["space"]).is_some_and(is_anatomical);
    let parts = Parts { format: NAME, dims, data, slope: 1.0, inter: 0.0, world_from_grid, unit, series, notes };
    let mut volume = assemble(parts, hint)?;
    if anatomical {
        volume.up = Up::Anatomical;
    }
    Ok(volume)
}

/// Most components of a sample.
const MOST_COMPONENTS: usize = 1 << 16;

struct Skips {
    lines: u64,
    bytes: i64,
}

/// `byte skip: -1`: the samples are the last bytes of a raw file.
fn skip_to_tail(source: &Source, kind: Type, sizes: &[u64]) -> Result<i64> {
    let bytes = sizes.iter().try_fold(kind.size() as u64, |n, &d| n.checked_mul(d));
    let skip = source.at_most().zip(bytes).and_then(|(length, bytes)| length.checked_sub(bytes));
    skip.and_then(|n| i64::try_from(n).ok()).ok_or_else(|| {
        Error::format(NAME, "byte skip: -1 and too short a data file", "all samples", "the data file is incomplete")
    })
}

fn samples(
    mut source: Source,
    header: &Header,
    kind: Type,
    part: &Part,
    skips: &Skips,
    hint: &ReadHint,
) -> Result<Stored> {
    let dims = part.read;
    for _ in 0..skips.lines {
        source.expect_line(NAME, "the lines that \"line skip\" counts")?;
    }
    let encoding = header.need("encoding")?.to_ascii_lowercase();
    let gzip = matches!(encoding.as_str(), "gzip" | "gz");
    if gzip {
        source = source.gunzip();
    }
    if skips.bytes < 0 {
        return Err(damaged("byte skip", &skips.bytes.to_string()));
    }
    source.skip(NAME, skips.bytes as u64, "the bytes that \"byte skip\" counts")?;
    let data = match encoding.as_str() {
        "raw" | "gzip" | "gz" => {
            let endian = match (header.get(&["endian"]).map(str::to_ascii_lowercase).as_deref(), kind.size()) {
                (_, 1) | (Some("little"), _) => Endian::Little,
                (Some("big"), _) => Endian::Big,
                (None, _) => return Err(missing("endian")),
                (Some(other), _) => return Err(damaged("endian", other)),
            };
            let before = part.before.checked_mul(kind.size() as u64).ok_or_else(|| damaged("sizes", "too large"))?;
            source.skip(NAME, before, "the time points before")?;
            let count = checked_count(NAME, dims, kind.size(), source.at_most(), hint)?;
            Stored::binary(&mut source, NAME, kind, endian, count)?
        }
        "ascii" | "text" | "txt" => {
            // Each sample takes a digit and a separator, the last one perhaps only the digit.
            let left = source.at_most().map(|n| (n.saturating_add(1) / 2).saturating_mul(kind.size() as u64));
            let mut token = Vec::new();
            for _ in 0..part.before {
                if !source.token(NAME, &mut token)? {
                    return Err(damaged("sizes", "more samples than the file has"));
                }
            }
            let count = checked_count(NAME, dims, kind.size(), left, hint)?;
            decode::text(&mut source, NAME, kind, count)?.into()
        }
        other => {
            return Err(Error::format(
                NAME,
                format!("encoding {other}"),
                "raw, gzip or ascii",
                "save the file again, for example with `unu save -f nrrd -e gzip`",
            ));
        }
    };
    if part.is_last {
        source.verify_end(NAME)?; // else more follows
    }
    Ok(data)
}

fn sample_type(name: &str) -> Result<Type> {
    Ok(match name {
        "signed char" | "int8" | "int8_t" => Type::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => Type::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => Type::I16,
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => Type::U16,
        "int" | "signed int" | "int32" | "int32_t" => Type::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => Type::U32,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => Type::I64,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => Type::U64,
        "float" => Type::F32,
        "double" => Type::F64,
        other => {
            return Err(Error::format(
                NAME,
                format!("type {other}"),
                "an integer or floating-point type",
                "convert the file, for example with `unu convert -t float`",
            ));
        }
    })
}

/// What the axes of the samples are.
struct Axes {
    space: [usize; 3],
    time: Option<usize>,
    components: Option<usize>,
}

impl Axes {
    /// Three axes of space, at most one of time and one of components, others of one sample. The directions say which
    /// is which: an axis of time points along a fourth dimension of space (as SimpleITK writes it), one of components
    /// has none. Without directions `kinds` say it.
    fn of(header: &Header, sizes: &[u64]) -> Result<Self> {
        let directions = header.get(&["space directions"]).map(vectors).transpose()?;
        if directions.as_ref().is_some_and(|all| all.len() != sizes.len()) {
            return Err(damaged("space directions", header.get(&["space directions"]).unwrap_or("")));
        }
        let kinds: Vec<&str> = header.get(&["kinds"]).unwrap_or("").split_whitespace().collect();
        let is_time_kind = |a: usize| kinds.get(a).is_some_and(|k| k.eq_ignore_ascii_case("time"));
        let is_space_kind = |a: usize| kinds.get(a).is_some_and(|k| ["space", "domain"].contains(k));
        let known_kinds = (0..sizes.len()).filter(|&a| is_space_kind(a)).count() == 3;
        let (mut space, mut time, mut components) = (Vec::new(), Vec::new(), Vec::new());
        for (a, &size) in sizes.iter().enumerate() {
            let is_spatial = match &directions {
                Some(all) => match all.get(a) {
                    Some(Some(d)) if d.time != 0.0 && d.in_space != DVec3::ZERO => {
                        return Err(damaged("space directions", header.get(&["space directions"]).unwrap_or("")));
                    }
                    Some(Some(d)) if d.time != 0.0 => {
                        time.push(a);
                        continue;
                    }
                    direction => matches!(direction, Some(Some(_))),
                },
                None if sizes.len() > 3 && known_kinds => is_space_kind(a),
                None => sizes.len() <= 3 || size != 1,
            };
            match (is_spatial, size) {
                (true, _) => space.push(a),
                (false, 1) => {}
                (false, _) if is_time_kind(a) => time.push(a),
                (false, _) => components.push(a),
            }
        }
        if let (&[x, y, z], true, true) = (space.as_slice(), time.len() <= 1, components.len() <= 1) {
            return Ok(Self { space: [x, y, z], time: time.first().copied(), components: components.first().copied() });
        }
        let kinds = header.get(&["kinds"]).map(|k| format!(" of kinds {k}")).unwrap_or_default();
        let [of_space, of_time] = [space.len(), time.len() + components.len()];
        Err(Error::format(
            NAME,
            format!("{of_space} axes of space and {of_time} others, with sizes {sizes:?}{kinds}"),
            "three axes of space, at most one of time and one of components",
            "add kinds such as \"domain domain domain time\", or cut it: unu slice -a 3 -p 0",
        ))
    }
}

/// The samples to read of all, and to pick of those.
struct Part {
    /// Samples in the file before those that are read.
    before: u64,
    /// Samples to read, as the three factors that are checked.
    read: [u64; 3],
    /// Whether nothing follows them.
    is_last: bool,
    /// First sample, stride of x, y, z, and dimensions, where not all that are read are wanted.
    pick: Option<(usize, [usize; 3], [usize; 3])>,
}

impl Part {
    /// `place`: the one wanted along an axis that is none of space.
    fn new(sizes: &[u64], space: [usize; 3], place: impl Fn(usize) -> u64) -> Result<Self> {
        let refuse = || damaged("sizes", &format!("{sizes:?}"));
        let last = space.into_iter().max().unwrap_or(0);
        // Axes behind those of space are skipped, others are read whole.
        let (mut before, mut step, mut total, mut is_last) = (0u64, 1u64, 1u64, true);
        let (mut first, mut strides) = (0u64, [0u64; 3]);
        for (a, &size) in sizes.iter().enumerate() {
            match space.iter().position(|&s| s == a) {
                Some(i) => strides[i] = step,
                None if a > last => {
                    before = place(a).checked_mul(step).and_then(|n| n.checked_add(before)).ok_or_else(refuse)?;
                    is_last &= place(a) + 1 == size;
                }
                None => first = place(a).checked_mul(step).and_then(|n| n.checked_add(first)).ok_or_else(refuse)?,
            }
            step = step.checked_mul(size).ok_or_else(refuse)?;
            if a <= last {
                total = step;
            }
        }
        let dims = space.map(|a| sizes[a]);
        let wanted = dims.iter().try_fold(1u64, |n, &d| n.checked_mul(d)).ok_or_else(refuse)?;
        let others = total.checked_div(wanted).unwrap_or(1);
        let pick = (others != 1).then(|| (first as usize, strides.map(|s| s as usize), dims.map(|d| d as usize)));
        Ok(Self { before, read: [dims[0].checked_mul(others).ok_or_else(refuse)?, dims[1], dims[2]], is_last, pick })
    }

    fn pick(&self, data: Stored) -> Stored {
        match self.pick {
            None => data,
            Some((first, strides, dims)) => data.pick(first, strides, dims),
        }
    }
}

/// A vector of the header: its parts in space and along a fourth dimension.
#[derive(Clone, Copy)]
struct Direction {
    in_space: DVec3,
    time: f64,
}

/// `(1,0,0) none (0,1,0)` and the like; of four numbers the fourth is of time.
fn vectors(text: &str) -> Result<Vec<Option<Direction>>> {
    let mut rest = text.trim();
    let mut out = Vec::new();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            out.push(None);
            rest = after.trim_start();
            continue;
        }
        let inside = rest.strip_prefix('(').and_then(|r| r.split_once(')'));
        let Some((inside, after)) = inside else { return Err(damaged("space directions", text)) };
        let numbers: Option<Vec<f64>> = inside.split(',').map(|w| w.trim().parse().ok()).collect();
        let (in_space, time) = match numbers.as_deref() {
            Some(&[x, y, z]) => (DVec3::new(x, y, z), 0.0),
            Some(&[x, y, z, t]) => (DVec3::new(x, y, z), t),
            _ => return Err(damaged("space directions", text)),
        };
        out.push(Some(Direction { in_space, time }));
        rest = after.trim_start();
    }
    Ok(out)
}

/// Whether a space is a patient's.
fn is_anatomical(space: &str) -> bool {
    let lower = space.to_ascii_lowercase();
    let base = lower.strip_suffix("-time").unwrap_or(&lower);
    base.ends_with("-superior") || ["ras", "las", "lps"].contains(&base)
}

/// Signs that take the named space to RAS+; all +1 for spaces without anatomical axes.
fn signs(space: &str) -> Result<DVec3> {
    let lower = space.to_ascii_lowercase();
    let base = lower.strip_suffix("-time").unwrap_or(&lower);
    Ok(match base {
        "right-anterior-superior" | "ras" | "scanner-xyz" | "3d-right-handed" | "3d-left-handed" => DVec3::ONE,
        "left-anterior-superior" | "las" => DVec3::new(-1.0, 1.0, 1.0),
        "left-posterior-superior" | "lps" => DVec3::new(-1.0, -1.0, 1.0),
        _ => return Err(damaged("space", space)),
    })
}

fn world(header: &Header, axes: [usize; 3], rank: usize, notes: &mut Vec<Note>) -> Result<(Affine, LengthUnit)> {
    let unit_of = |text: &str, pick: [usize; 3]| -> Option<f64> {
        let words: Vec<&str> = text.split_whitespace().collect();
        let first = metres_in(words.get(pick[0])?)?;
        pick.iter().all(|&a| words.get(a).and_then(|w| metres_in(w)) == Some(first)).then_some(first)
    };
    let space = header.get(&["space"]);
    if let Some(text) = header.get(&["space directions"]) {
        let all = vectors(text)?;
        let columns = axes.map(|a| all.get(a).copied().flatten().map(|d| d.in_space));
        let ([Some(x), Some(y), Some(z)], true) = (columns, all.len() == rank) else {
            return Err(damaged("space directions", text));
        };
        let origin = match header.get(&["space origin"]) {
            Some(text) => match vectors(text)?.as_slice() {
                [Some(origin)] => origin.in_space,
                _ => return Err(damaged("space origin", text)),
            },
            None => DVec3::ZERO,
        };
        let signs = match (space, header.get(&["space dimension"])) {
            (Some(space), _) => signs(space)?,
            (None, Some("4")) => {
                // ITK names no space of four dimensions; its own is that of DICOM.
                notes
                    .push(note("space dimension 4 without a space: read as ITK writes it, left-posterior-superior", 1));
                DVec3::new(-1.0, -1.0, 1.0)
            }
            (None, _) => DVec3::ONE,
        };
        let metres = header.get(&["space units"]).and_then(|t| unit_of(t, [0, 1, 2]));
        let linear = DMat3::from_diagonal(signs) * DMat3::from_cols(x, y, z);
        return Ok((affine(NAME, linear, signs * origin)?, metres.map_or(LengthUnit::Unknown, LengthUnit::Metres)));
    }
    let per_axis = |names: &[&str]| -> Result<Option<[f64; 3]>> {
        let Some(values) = header.numbers::<f64>(names)? else { return Ok(None) };
        if values.len() != rank {
            return Err(damaged(names[0], header.get(names).unwrap_or("")));
        }
        Ok(Some(axes.map(|a| values[a])))
    };
    let mut spacing = per_axis(&["spacings"])?.unwrap_or([1.0; 3]);
    for s in &mut spacing {
        if !(s.is_finite() && *s != 0.0) {
            notes.push(note(format!("spacing {s} is not usable, 1 is used"), 1));
            *s = 1.0;
        }
    }
    let mut origin = per_axis(&["axis mins", "axismins"])?.unwrap_or([0.0; 3]);
    let centerings: Vec<&str> = header.get(&["centerings", "centers"]).unwrap_or("").split_whitespace().collect();
    for i in 0..3 {
        if !origin[i].is_finite() {
            origin[i] = 0.0; // "nan" means that it is not known
        } else if origin[i] != 0.0 && centerings.get(axes[i]) == Some(&"cell") {
            origin[i] += 0.5 * spacing[i]; // the minimum is the border of the first cell
        }
    }
    let metres = header.get(&["units"]).and_then(|t| unit_of(t, axes));
    let unit = metres.map_or(LengthUnit::Unknown, LengthUnit::Metres);
    Ok((affine(NAME, DMat3::from_diagonal(DVec3::from_array(spacing)), DVec3::from_array(origin))?, unit))
}
