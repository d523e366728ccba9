//! VTK XML ImageData (.vti) and its parts (.pvti), by hand: the crate vtkio 0.6 panics on inline zlib and fails on appended
//! raw data. Format: docs.vtk.org, "VTK XML file formats".
//!
//! World: sample (i, j, k) of an extent, which may start anywhere, lies at Origin + Direction · (Spacing · (i, j, k)); the
//! columns of Direction are the axes. Values of cells lie half a step inside. There is no unit. Of several arrays the one that
//! `Scalars` names is read; `--array` chooses another, `--channel` one of its components.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used, clippy::indexing_slicing))]

mod data;
mod join;
mod tags;

use super::super::assemble::{Parts, assemble, note, pick};
use super::super::decode::{Data, Endian, Type, checked_count};
use super::super::foreign;
use super::super::read::{OpenBeside, ReadHint};
use super::super::source::Source;
use super::super::{Choice, LengthUnit, Volume};
use super::xml::{self, Attributes};
use super::{affine, needs_second_file};
use crate::error::{Error, Result};
use crate::geom::Affine;
use data::{Base64, Codec, Encoding};
use glam::{DMat3, DVec3};
use join::{Block, join};
use std::io::{BufRead, Read};
use std::path::Path;
use tags::{Tag, Text};

const NAME: &str = "VTK ImageData";
/// More pieces, and more arrays of one, than any file has.
const MOST_PIECES: usize = 1 << 16;
const MOST_ARRAYS: usize = 1 << 12;

fn damaged(found: impl Into<String>, expected: &str) -> Error {
    Error::format(NAME, found, expected, "the file is incomplete or damaged; copy it, or save it again with VTK")
}

/// Whether the first bytes are those of XML that may be VTK's; what it is its root says, perhaps behind long comments.
pub(crate) fn is_xml(head: &[u8]) -> bool {
    let start = head.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(0);
    let head = head.get(start..).unwrap_or_default();
    let head = head.strip_prefix(b"\xef\xbb\xbf").unwrap_or(head);
    [&b"<?xml"[..], b"<!--", b"<VTKFile"].iter().any(|mark| head.starts_with(mark))
}

/// First and last index along x, y, z.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Extent {
    // Invariant: first <= last.
    first: [i64; 3],
    last: [i64; 3],
}

impl Extent {
    fn parse(text: &str) -> Result<Self> {
        let refuse =
            || damaged(format!("the extent {text:?}"), "six numbers, the first and last index along x, y and z");
        let numbers: Option<Vec<i64>> = text.split_whitespace().map(|w| w.parse().ok()).collect();
        let Some([x0, x1, y0, y1, z0, z1]) = numbers.and_then(|n| <[i64; 6]>::try_from(n).ok()) else {
            return Err(refuse());
        };
        let extent = Self { first: [x0, y0, z0], last: [x1, y1, z1] };
        // Beyond 2^53 places are no longer exact.
        let is_sound =
            |(first, last): (&i64, &i64)| first <= last && first.unsigned_abs().max(last.unsigned_abs()) < 1 << 53;
        if extent.first.iter().zip(&extent.last).all(is_sound) { Ok(extent) } else { Err(refuse()) }
    }

    /// Samples along each axis: points, or the cells between them; an axis of one point has one cell.
    fn dims(&self, of_cells: bool) -> [u64; 3] {
        let [x, y, z] = [0, 1, 2].map(|a| self.last.get(a).unwrap_or(&0).abs_diff(*self.first.get(a).unwrap_or(&0)));
        [x, y, z].map(|n| if of_cells { n.max(1) } else { n + 1 })
    }
}

/// Where the samples of an image lie.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Frame {
    whole: Extent,
    origin: DVec3,
    spacing: DVec3,
    /// Absent before VTK 9, and in the headers of parts that VTK 9 writes.
    direction: Option<DMat3>,
}

impl Frame {
    fn parse(attributes: Attributes) -> Result<Self> {
        let whole = attributes.get("WholeExtent").ok_or_else(|| damaged("ImageData without WholeExtent", "it"))?;
        let three =
            |name: &str, default: DVec3| numbers::<3>(attributes, name).map(|n| n.map_or(default, DVec3::from_array));
        // Nine numbers by rows.
        let rows = numbers::<9>(attributes, "Direction")?;
        Ok(Self {
            whole: Extent::parse(&whole)?,
            origin: three("Origin", DVec3::ZERO)?,
            spacing: three("Spacing", DVec3::ONE)?,
            direction: rows.map(|rows| DMat3::from_cols_array(&rows).transpose()),
        })
    }

    fn axes(&self) -> DMat3 {
        self.direction.unwrap_or(DMat3::IDENTITY)
    }

    fn world_from_grid(&self, of_cells: bool) -> Result<Affine> {
        let linear = self.axes() * DMat3::from_diagonal(self.spacing);
        let mut first = DVec3::from_array(self.whole.first.map(|n| n as f64));
        if of_cells {
            let is_flat = [0, 1, 2].map(|a| self.whole.first.get(a) == self.whole.last.get(a));
            first += DVec3::from_array(is_flat.map(|flat| if flat { 0.0 } else { 0.5 }));
        }
        affine(NAME, linear, self.origin + linear * first)
    }

    /// Whether the other has the same lattice, whatever its extent.
    fn fits(&self, other: &Self) -> bool {
        let near = |a: DVec3, b: DVec3, size: f64| (a - b).abs().max_element() <= 1e-9 * size;
        let size = self.spacing.abs().max_element() + self.origin.abs().max_element();
        near(self.origin, other.origin, size)
            && near(self.spacing, other.spacing, size)
            && [0, 1, 2].into_iter().all(|a| near(self.axes().col(a), other.axes().col(a), 1.0))
    }
}

/// Numbers of an attribute.
fn numbers<const N: usize>(attributes: Attributes, name: &str) -> Result<Option<[f64; N]>> {
    let Some(text) = attributes.get(name) else { return Ok(None) };
    let numbers: Option<Vec<f64>> = text.split_whitespace().map(|w| w.parse().ok()).collect();
    let refuse = || damaged(format!("{name}=\"{text}\""), "numbers, three or nine");
    numbers.and_then(|n| n.try_into().ok()).map(Some).ok_or_else(refuse)
}

/// An array of a piece.
struct Array {
    name: String,
    of_cells: bool,
    /// Whether `Scalars` names it.
    is_active: bool,
    kind: String,
    components: Vec<String>,
    /// Bytes, or characters, behind the mark of the appended data.
    offset: Option<u64>,
    /// Samples that stood inline and that may be wanted.
    data: Option<Data>,
}

/// A box of samples: its arrays, or the file that holds them.
#[derive(Default)]
struct Piece {
    extent: Option<Extent>,
    source: Option<String>,
    arrays: Vec<Array>,
}

/// A file up to its appended data.
struct Document {
    is_parallel: bool,
    frame: Frame,
    encoding: Encoding,
    pieces: Vec<Piece>,
    /// What a header of parts says of the arrays.
    announced: Vec<Array>,
    /// Whether appended data follow, and whether they are in base64.
    appended: Option<bool>,
    no_byte_order: bool,
}

pub(crate) fn read(mut source: Source, hint: &ReadHint, beside: Option<OpenBeside>) -> Result<Volume> {
    let document = Document::parse(&mut source, hint, &hint.choice)?;
    let mut notes = Vec::new();
    if document.no_byte_order {
        notes.push(note("the file does not say its byte order: little-endian is taken", 1));
    }
    let first = if document.is_parallel {
        &document.announced
    } else {
        document.pieces.first().map_or(&document.announced, |p| &p.arrays)
    };
    let chosen = choose(first, &hint.choice)?;
    let names: Vec<String> = first.iter().map(|a| a.name.clone()).collect();
    let Some(array) = first.get(chosen) else { return Err(damaged("no array", "PointData or CellData")) };
    let (of_cells, name, components) = (array.of_cells, array.name.clone(), array.components.clone());
    let mut series = hint.choice.of(NAME, components, 1, &mut notes)?;
    (series.arrays, series.array) = (names, chosen);
    if series.arrays.len() > 1 {
        let how = if hint.choice.array.is_none() { "; choose with --array" } else { "" };
        notes.push(note(format!("array {name} of {} is read{how}", series.arrays.len()), 1));
    }
    let wanted = Wanted { name: &name, of_cells, components: series.channels.len(), channel: series.channel };
    let mut frame = document.frame;
    let blocks = if document.is_parallel {
        let open = beside.ok_or_else(|| {
            needs_second_file(NAME, document.pieces.first().and_then(|p| p.source.as_deref()).unwrap_or(""))
        })?;
        parts(&document, &mut frame, &wanted, hint, open)?
    } else {
        document.blocks(source, &wanted, hint)?
    };
    let (data, dims) = join(blocks, &frame.whole, of_cells, hint)?;
    let world_from_grid = frame.world_from_grid(of_cells)?;
    let (slope, inter, unit) = (1.0, 0.0, LengthUnit::Unknown);
    assemble(Parts { format: NAME, dims, data, slope, inter, world_from_grid, unit, series, notes }, hint)
}

/// The array of a file that is read.
struct Wanted<'a> {
    name: &'a str,
    of_cells: bool,
    components: usize,
    channel: usize,
}

/// What `Scalars` names of the points, else of the cells, where points have no arrays; else the only array.
fn choose(arrays: &[Array], choice: &Choice) -> Result<usize> {
    let names: Vec<String> = arrays.iter().map(|a| a.name.clone()).collect();
    let active = |of_cells| arrays.iter().position(|a| a.is_active && a.of_cells == of_cells);
    let only_cells = arrays.iter().all(|a| a.of_cells);
    choice.array_of(NAME, &names, active(false).or_else(|| active(true).filter(|_| only_cells)))
}

/// Samples of the files that a header of parts names. Where it has no Direction, that of the parts is the frame's.
fn parts(
    document: &Document,
    frame: &mut Frame,
    wanted: &Wanted,
    hint: &ReadHint,
    open: OpenBeside,
) -> Result<Vec<Block>> {
    let mut blocks = Vec::new();
    let choice = Choice { array: Some(wanted.name.into()), ..Choice::default() };
    for piece in &document.pieces {
        let name = piece.source.as_deref().ok_or_else(|| damaged("a piece without Source", "the name of its file"))?;
        let mut read = || {
            let mut source = open(Path::new(name))?;
            if source.is_gzip().map_err(|e| Error::from_read(NAME, "a piece", e))? {
                source = source.gunzip();
            }
            let part = Document::parse(&mut source, hint, &choice)?;
            frame.direction.get_or_insert(part.frame.axes());
            if part.is_parallel || !frame.fits(&part.frame) {
                let said = |f: &Frame| format!("Origin {}, Spacing {} and Direction {}", f.origin, f.spacing, f.axes());
                let found = format!("a piece with {}", said(&part.frame));
                let expected = format!("ImageData with {}, as the .pvti says", said(frame));
                return Err(Error::format(NAME, found, expected, "save all pieces anew"));
            }
            part.blocks(source, wanted, hint)
        };
        blocks.extend(read().map_err(|e| e.in_file(name))?);
    }
    Ok(blocks)
}

impl Document {
    /// Reads up to the appended data, or to the end. Of the arrays that stand inline those are decoded that `choice` may mean.
    fn parse(source: &mut Source, hint: &ReadHint, choice: &Choice) -> Result<Self> {
        let (kind, encoding, no_byte_order) = root(source)?;
        let is_parallel = kind == "PImageData";
        let (mut frame, mut pieces, mut announced) = (None, Vec::<Piece>::new(), Vec::new());
        // PointData or CellData, and what Scalars names there.
        let mut section: Option<(bool, Option<String>)> = None;
        let finish = |frame, pieces, announced, appended| match frame {
            Some(frame) => Ok(Self { is_parallel, frame, encoding, pieces, announced, appended, no_byte_order }),
            None => Err(damaged("no ImageData", "it in VTKFile")),
        };
        loop {
            let Some(tag) = tags::next(source)? else { return Err(damaged("the end of the file", "</VTKFile>")) };
            let (inside, is_empty) = match tag {
                Tag::End(name) if name == "VTKFile" => return finish(frame, pieces, announced, None),
                Tag::End(name) => {
                    if matches!(name.as_str(), "PointData" | "CellData" | "PPointData" | "PCellData") {
                        section = None;
                    }
                    continue;
                }
                Tag::Start { inside, is_empty } => (inside, is_empty),
            };
            let (name, attributes) = xml::split_tag(&inside);
            match name {
                "ImageData" | "PImageData" if name == kind => frame = Some(Frame::parse(attributes)?),
                "Piece" => {
                    let extent = attributes.get("Extent").map(|text| Extent::parse(&text)).transpose()?;
                    pieces.push(Piece { extent, source: attributes.get("Source"), arrays: Vec::new() });
                    if pieces.len() > MOST_PIECES {
                        return Err(damaged(format!("more than {MOST_PIECES} pieces"), "fewer"));
                    }
                }
                "PointData" | "CellData" | "PPointData" | "PCellData" if !is_empty => {
                    section = Some((name.ends_with("CellData"), attributes.get("Scalars")));
                }
                "DataArray" | "PDataArray" => {
                    let Some((of_cells, active)) = &section else { continue };
                    let mut array = Array::new(attributes, *of_cells, active.as_deref())?;
                    let (Some(frame), true) = (&frame, is_parallel == (name == "PDataArray")) else { continue };
                    let arrays = match pieces.last_mut() {
                        Some(piece) => &mut piece.arrays,
                        None => &mut announced,
                    };
                    if arrays.len() >= MOST_ARRAYS {
                        return Err(damaged(format!("more than {MOST_ARRAYS} arrays"), "fewer"));
                    }
                    let may_be_wanted = match &choice.array {
                        Some(name) => *name == array.name,
                        None => array.is_active || arrays.is_empty(),
                    };
                    if !is_parallel && array.offset.is_none() && may_be_wanted {
                        let extent = pieces.last().and_then(|p| p.extent).unwrap_or(frame.whole);
                        array.data = Some(array.inline(source, attributes, is_empty, &extent, encoding, hint)?);
                    }
                    match pieces.last_mut() {
                        Some(piece) => piece.arrays.push(array),
                        None => announced.push(array),
                    }
                }
                "AppendedData" => {
                    let is_base64 = match attributes.get("encoding").as_deref() {
                        Some("raw") => false,
                        Some("base64") | None => true,
                        Some(other) => return Err(damaged(format!("appended data in {other}"), "raw or base64")),
                    };
                    mark(source)?;
                    return finish(frame, pieces, announced, Some(is_base64));
                }
                _ => {}
            }
        }
    }

    /// The samples of the array of each piece.
    fn blocks(self, mut source: Source, wanted: &Wanted, hint: &ReadHint) -> Result<Vec<Block>> {
        let (frame, encoding) = (self.frame, self.encoding);
        let is_wanted = |a: &Array| a.name == wanted.name && a.of_cells == wanted.of_cells;
        let mut arrays = Vec::new();
        for piece in self.pieces {
            let extent = piece.extent.unwrap_or(frame.whole);
            let array = piece.arrays.into_iter().find(is_wanted);
            let array = array
                .ok_or_else(|| damaged(format!("a piece without the array {}", wanted.name), "it in each piece"))?;
            if array.components.len() != wanted.components {
                let found = format!("{} components in a piece", array.components.len());
                return Err(damaged(found, "as many in each piece"));
            }
            arrays.push((extent, array));
        }
        // The appended data are a stream: in the order in which they lie there.
        arrays.sort_by_key(|(_, array)| array.offset);
        let mut blocks = Vec::new();
        let mut at = 0;
        for (extent, array) in arrays {
            let data = match (array.data, array.offset, self.appended) {
                (Some(data), ..) => data,
                (None, Some(offset), Some(is_base64)) => {
                    let skip =
                        offset.checked_sub(at).ok_or_else(|| damaged("arrays that overlap", "one after the other"))?;
                    source.skip(NAME, skip, "the arrays before")?;
                    let kind = sample_type(&array.kind)?;
                    let dims = extent.dims(wanted.of_cells);
                    let left = source.at_most().map(|n| encoding.codec.map_or(n, |codec| codec.most(n)));
                    let count = checked_count(NAME, interleaved(dims, wanted.components)?, kind.size(), left, hint)?;
                    let mut counted = Counted { source: &mut source, used: 0 };
                    let data = if is_base64 {
                        data::binary(&mut Base64::new(&mut counted), encoding, kind, count)?
                    } else {
                        data::binary(&mut counted, encoding, kind, count)?
                    };
                    at = offset.saturating_add(counted.used);
                    data
                }
                (None, None, _) => {
                    return Err(damaged(
                        format!("the array {} in pieces of another make", wanted.name),
                        "alike pieces",
                    ));
                }
                (None, Some(_), None) => return Err(damaged("an offset without AppendedData", "AppendedData")),
            };
            let dims = extent.dims(wanted.of_cells).map(|n| n as usize);
            let [x, y, _] = dims;
            let n = wanted.components;
            let data = if n == 1 { data } else { pick(data, wanted.channel, [n, n * x, n * x * y], dims) };
            blocks.push(Block { first: extent.first, dims, data });
        }
        Ok(blocks)
    }
}

/// The samples of all components as the factors that are checked.
fn interleaved([x, y, z]: [u64; 3], components: usize) -> Result<[u64; 3]> {
    let x = x.checked_mul(components as u64).ok_or_else(|| damaged("more than 2^64 samples", "fewer"))?;
    Ok([x, y, z])
}

/// A stream that counts what is taken of it.
struct Counted<'s, 'a> {
    source: &'s mut Source<'a>,
    used: u64,
}

impl Read for Counted<'_, '_> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let count = self.source.read(out)?;
        self.used += count as u64;
        Ok(count)
    }
}

impl BufRead for Counted<'_, '_> {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        self.source.fill_buf()
    }

    fn consume(&mut self, count: usize) {
        self.used += count as u64;
        self.source.consume(count);
    }
}

/// What the root element says: the kind of data, how arrays are stored, and whether the byte order is left out.
fn root(source: &mut Source) -> Result<(String, Encoding, bool)> {
    let tag = tags::next(source)?;
    let Some(Tag::Start { inside, .. }) = tag else { return Err(foreign::refused(b"<?xml")) };
    let (name, attributes) = xml::split_tag(&inside);
    let kind = attributes.get("type").unwrap_or_default();
    if name != "VTKFile" || !matches!(kind.as_str(), "ImageData" | "PImageData") {
        return Err(foreign::refused(format!("<{inside}>").as_bytes()));
    }
    let byte_order = attributes.get("byte_order");
    let endian = match byte_order.as_deref() {
        Some("LittleEndian") | None => Endian::Little,
        Some("BigEndian") => Endian::Big,
        Some(other) => return Err(damaged(format!("byte_order=\"{other}\""), "LittleEndian or BigEndian")),
    };
    let is_wide = match attributes.get("header_type").as_deref() {
        Some("UInt64") => true,
        Some("UInt32") | None => false,
        Some(other) => return Err(damaged(format!("header_type=\"{other}\""), "UInt32 or UInt64")),
    };
    let codec = attributes.get("compressor").filter(|name| !name.is_empty());
    // The header of parts has the compressor of its parts, and no samples.
    let codec = codec.filter(|_| kind == "ImageData").map(|name| Codec::named(&name)).transpose()?;
    let no_byte_order = byte_order.is_none() && kind == "ImageData";
    Ok((kind, Encoding { endian, is_wide, codec }, no_byte_order))
}

/// Consumes the mark of the appended data, `_`, behind white space.
fn mark(source: &mut Source) -> Result<()> {
    loop {
        match source.array::<1>(NAME, "appended data")? {
            [b'_'] => return Ok(()),
            [byte] if byte.is_ascii_whitespace() => {}
            [byte] => return Err(damaged(format!("{:?} before the appended data", char::from(byte)), "\"_\"")),
        }
    }
}

impl Array {
    fn new(attributes: Attributes, of_cells: bool, active: Option<&str>) -> Result<Self> {
        let name = attributes.get("Name").unwrap_or_default();
        let number = |name: &str| attributes.number::<u64>(name, |found| damaged(found, "a number from 0"));
        let components = number("NumberOfComponents")?.unwrap_or(1);
        if !(1..=1 << 12).contains(&components) {
            return Err(damaged(format!("{components} components of the array {name}"), "1 to 4096"));
        }
        let component = |i: u64| attributes.get(&format!("ComponentName{i}")).unwrap_or_default();
        let offset = match attributes.get("format").as_deref() {
            Some("appended") => {
                Some(number("offset")?.ok_or_else(|| damaged("appended data without an offset", "offset"))?)
            }
            _ => None,
        };
        let kind = attributes.get("type").unwrap_or_default();
        let is_active = active == Some(&name);
        let components = (0..components).map(component).collect();
        Ok(Self { name, of_cells, is_active, kind, components, offset, data: None })
    }

    /// The samples between the tags.
    fn inline(
        &self,
        source: &mut Source,
        attributes: Attributes,
        is_empty: bool,
        extent: &Extent,
        encoding: Encoding,
        hint: &ReadHint,
    ) -> Result<Data> {
        let kind = sample_type(&self.kind)?;
        let format = attributes.get("format");
        let is_text = match format.as_deref() {
            Some("ascii") => true,
            Some("binary") => false,
            other => {
                return Err(damaged(
                    format!("the array {} in format {other:?}", self.name),
                    "ascii, binary or appended",
                ));
            }
        };
        let size = kind.size() as u64;
        // As text, each sample takes a digit and a separator.
        let left = source.at_most().map(|n| match encoding.codec {
            _ if is_text => (n.saturating_add(1) / 2).saturating_mul(size),
            Some(codec) => codec.most(n),
            None => n,
        });
        let dims = interleaved(extent.dims(self.of_cells), self.components.len())?;
        let count = checked_count(NAME, dims, kind.size(), left, hint)?;
        if is_empty {
            return Err(damaged(format!("the array {} without samples", self.name), "samples"));
        }
        match is_text {
            true => data::text(Text(source), kind, count),
            false => data::binary(&mut Base64::new(Text(source)), encoding, kind, count),
        }
    }
}

fn sample_type(name: &str) -> Result<Type> {
    Ok(match name {
        "UInt8" => Type::U8,
        "Int8" => Type::I8,
        "UInt16" => Type::U16,
        "Int16" => Type::I16,
        "UInt32" => Type::U32,
        "Int32" => Type::I32,
        "UInt64" => Type::U64,
        "Int64" => Type::I64,
        "Float32" => Type::F32,
        "Float64" => Type::F64,
        other => {
            let remedy =
                "choose another array with --array NAME, or convert it, for example with ParaView's Calculator";
            return Err(Error::format(NAME, format!("samples of type {other:?}"), "integers or real numbers", remedy));
        }
    })
}
