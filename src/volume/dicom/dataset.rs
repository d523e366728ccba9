//! DICOM data sets (PS3.5 and PS3.10), as far as a volume needs them, by hand: the crate dicom-object 0.10 makes room for
//! whatever length an element claims, 4 GiB for a file of 200 bytes.
//!
//! Elements that are not [`KEPT`] are passed over, sequences among them; reading stops before the pixel data.

use super::super::decode::Endian;
use super::super::source::Source;
use super::NAME;
use crate::error::{Error, Result};
use flate2::bufread::DeflateDecoder;
use std::io::Read;

/// Longest value that is kept.
const MOST_BYTES: u64 = 1 << 16;
/// Deepest nesting of sequences.
const MOST_DEPTH: usize = 16;
/// Most items of a sequence, such as one for each frame.
const MOST_ITEMS: usize = 1 << 20;
/// A length that is not told.
const UNDEFINED: u32 = u32::MAX;

/// An element's tag, group and number.
pub(super) type Tag = u32;

pub(super) const TRANSFER_SYNTAX: Tag = 0x0002_0010;
pub(super) const SOP_CLASS: Tag = 0x0008_0016;
pub(super) const SOP_INSTANCE: Tag = 0x0008_0018;
pub(super) const MODALITY: Tag = 0x0008_0060;
pub(super) const DESCRIPTION: Tag = 0x0008_103e;
pub(super) const ECHO: Tag = 0x0018_0086;
pub(super) const TRIGGER_TIME: Tag = 0x0018_1060;
pub(super) const B_VALUE: Tag = 0x0018_9087;
pub(super) const SERIES: Tag = 0x0020_000e;
pub(super) const SERIES_NUMBER: Tag = 0x0020_0011;
pub(super) const ACQUISITION: Tag = 0x0020_0012;
pub(super) const INSTANCE_NUMBER: Tag = 0x0020_0013;
pub(super) const POSITION: Tag = 0x0020_0032;
pub(super) const ORIENTATION: Tag = 0x0020_0037;
pub(super) const TEMPORAL_POSITION: Tag = 0x0020_0100;
pub(super) const FRAME_CONTENT: Tag = 0x0020_9111;
pub(super) const PLANE_POSITION: Tag = 0x0020_9113;
pub(super) const PLANE_ORIENTATION: Tag = 0x0020_9116;
pub(super) const TEMPORAL_INDEX: Tag = 0x0020_9128;
pub(super) const SAMPLES_PER_PIXEL: Tag = 0x0028_0002;
pub(super) const PHOTOMETRIC: Tag = 0x0028_0004;
pub(super) const FRAMES: Tag = 0x0028_0008;
pub(super) const ROWS: Tag = 0x0028_0010;
pub(super) const COLUMNS: Tag = 0x0028_0011;
pub(super) const PIXEL_SPACING: Tag = 0x0028_0030;
pub(super) const BITS_ALLOCATED: Tag = 0x0028_0100;
pub(super) const BITS_STORED: Tag = 0x0028_0101;
pub(super) const HIGH_BIT: Tag = 0x0028_0102;
pub(super) const IS_SIGNED: Tag = 0x0028_0103;
pub(super) const PADDING: Tag = 0x0028_0120;
pub(super) const PADDING_LIMIT: Tag = 0x0028_0121;
pub(super) const INTERCEPT: Tag = 0x0028_1052;
pub(super) const SLOPE: Tag = 0x0028_1053;
pub(super) const PIXEL_MEASURES: Tag = 0x0028_9110;
pub(super) const PIXEL_VALUES: Tag = 0x0028_9145;
pub(super) const SEGMENTS: Tag = 0x0062_0002;
pub(super) const SEGMENT_NUMBER: Tag = 0x0062_0004;
pub(super) const SEGMENT_LABEL: Tag = 0x0062_0005;
pub(super) const SEGMENT: Tag = 0x0062_000a;
pub(super) const REFERENCED_SEGMENT: Tag = 0x0062_000b;
pub(super) const SHARED_GROUPS: Tag = 0x5200_9229;
pub(super) const FRAME_GROUPS: Tag = 0x5200_9230;
const PIXELS: [Tag; 3] = [0x7fe0_0008, 0x7fe0_0009, 0x7fe0_0010];
const ITEM: Tag = 0xfffe_e000;
const SEQUENCE_END: Tag = 0xfffe_e0dd;

/// Elements with a value that is kept.
const KEPT: [Tag; 35] = [
    TRANSFER_SYNTAX,
    SOP_CLASS,
    SOP_INSTANCE,
    MODALITY,
    DESCRIPTION,
    ECHO,
    TRIGGER_TIME,
    B_VALUE,
    SERIES,
    SERIES_NUMBER,
    ACQUISITION,
    INSTANCE_NUMBER,
    POSITION,
    ORIENTATION,
    TEMPORAL_POSITION,
    TEMPORAL_INDEX,
    SAMPLES_PER_PIXEL,
    PHOTOMETRIC,
    FRAMES,
    ROWS,
    COLUMNS,
    PIXEL_SPACING,
    BITS_ALLOCATED,
    BITS_STORED,
    HIGH_BIT,
    IS_SIGNED,
    PADDING,
    PADDING_LIMIT,
    INTERCEPT,
    SLOPE,
    SEGMENT_NUMBER,
    SEGMENT_LABEL,
    REFERENCED_SEGMENT,
    0x0002_0002,
    0x0008_0005,
];

/// Sequences of which the items are read.
const SEQUENCES: [Tag; 9] = [
    FRAME_CONTENT,
    PLANE_POSITION,
    PLANE_ORIENTATION,
    PIXEL_MEASURES,
    PIXEL_VALUES,
    SEGMENTS,
    SEGMENT,
    SHARED_GROUPS,
    FRAME_GROUPS,
];

enum Value {
    Bytes(Vec<u8>),
    Items(Vec<DataSet>),
}

/// The elements that are kept.
#[derive(Default)]
pub(super) struct DataSet {
    elements: Vec<(Tag, Value)>,
    is_big: bool,
}

impl DataSet {
    fn bytes(&self, tag: Tag) -> Option<&[u8]> {
        self.elements.iter().find_map(|(t, value)| match value {
            Value::Bytes(bytes) if *t == tag => Some(bytes.as_slice()),
            _ => None,
        })
    }

    /// A text without the blanks that fill it; none where it is empty.
    pub(super) fn text(&self, tag: Tag) -> Option<String> {
        let text = String::from_utf8_lossy(self.bytes(tag)?);
        let text: String =
            text.trim_matches(|c: char| c == '\0' || c.is_whitespace()).chars().filter(|c| !c.is_control()).collect();
        (!text.is_empty()).then_some(text)
    }

    /// Numbers written as text; none where it is empty or one is not a finite number.
    pub(super) fn numbers<const N: usize>(&self, tag: Tag) -> Option<[f64; N]> {
        let text = self.text(tag)?;
        let numbers: Option<Vec<f64>> =
            text.split('\\').map(|n| n.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
        numbers?.try_into().ok()
    }

    pub(super) fn number(&self, tag: Tag) -> Option<f64> {
        self.numbers::<1>(tag).map(|[n]| n)
    }

    /// A binary number of 16 bits.
    pub(super) fn short(&self, tag: Tag) -> Option<u16> {
        let bytes = *self.bytes(tag)?.first_chunk::<2>()?;
        Some(if self.is_big { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
    }

    /// A binary number of 32 bits.
    pub(super) fn long(&self, tag: Tag) -> Option<u32> {
        let bytes = *self.bytes(tag)?.first_chunk::<4>()?;
        Some(if self.is_big { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    /// A binary number of double precision.
    pub(super) fn double(&self, tag: Tag) -> Option<f64> {
        let bytes = *self.bytes(tag)?.first_chunk::<8>()?;
        Some(if self.is_big { f64::from_be_bytes(bytes) } else { f64::from_le_bytes(bytes) }).filter(|v| v.is_finite())
    }

    /// The items of a sequence.
    pub(super) fn items(&self, tag: Tag) -> &[Self] {
        let found = self.elements.iter().find_map(|(t, value)| match value {
            Value::Items(items) if *t == tag => Some(items.as_slice()),
            _ => None,
        });
        found.unwrap_or_default()
    }

    /// The only item of a sequence.
    pub(super) fn item(&self, tag: Tag) -> Option<&Self> {
        self.items(tag).first()
    }
}

/// The pixel data in front of which reading stopped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Pixels {
    /// None.
    Missing,
    /// Of floating-point numbers.
    Real,
    /// So many bytes of samples.
    Plain(u64),
    /// Packed pictures in pieces.
    Packed,
}

/// A file up to its pixel data.
pub(super) struct Head<'a> {
    pub(super) data: DataSet,
    pub(super) syntax: String,
    pub(super) endian: Endian,
    pub(super) pixels: Pixels,
    /// What follows.
    pub(super) rest: Source<'a>,
}

pub(super) fn damaged(found: impl Into<String>, expected: &str) -> Error {
    Error::format(NAME, found, expected, "the file is incomplete or damaged; copy it again")
}

/// Whether the first bytes are those of a DICOM file.
pub(crate) fn is_dicom(head: &[u8]) -> bool {
    head.get(128..).is_some_and(|rest| rest.starts_with(b"DICM"))
}

/// Whether the first bytes are a data set without preamble: an element of group 8, without or with its type.
fn is_bare(head: &[u8]) -> bool {
    let Some([8, 0, number, high, a, b, c, d]) = head.first_chunk::<8>() else { return false };
    let is_early = *high == 0 && *number < 0x20;
    let is_typed = [a, b].iter().all(|letter| letter.is_ascii_uppercase()) && *d == 0;
    is_early && (is_typed || u32::from_le_bytes([*a, *b, *c, *d]) < 256)
}

/// How elements are written.
#[derive(Clone, Copy)]
struct Coding {
    endian: Endian,
    is_explicit: bool,
}

impl<'a> Head<'a> {
    /// Reads up to the pixel data; none where it is no DICOM file.
    pub(super) fn read(mut source: Source<'a>) -> Result<Option<Self>> {
        let from_read = |e| Error::from_read(NAME, "the first bytes", e);
        let head = source.peek(132).map_err(from_read)?;
        let (has_meta, bare) = (is_dicom(head), is_bare(head));
        let mut coding = Coding { endian: Endian::Little, is_explicit: true };
        let mut syntax = "1.2.840.10008.1.2".to_string();
        if has_meta {
            source.skip(NAME, 132, "the preamble")?;
            let mut meta = DataSet::default();
            // The elements of group 2 are explicit and little-endian, whatever follows.
            while source.peek(2).map_err(from_read)?.starts_with(&[2, 0]) {
                element(&mut source, coding, &mut meta, 0)?;
            }
            syntax = meta
                .text(TRANSFER_SYNTAX)
                .ok_or_else(|| damaged("no TransferSyntaxUID", "it in the file's meta information"))?;
            coding = match syntax.as_str() {
                "1.2.840.10008.1.2" => Coding { is_explicit: false, ..coding },
                "1.2.840.10008.1.2.2" => Coding { endian: Endian::Big, ..coding },
                _ => coding,
            };
            if syntax == "1.2.840.10008.1.2.1.99" {
                let most = source.at_most().map(|n| n.saturating_mul(1032));
                source = Source::new(DeflateDecoder::new(source), most);
            }
        } else if bare {
            let typed =
                source.peek(6).map_err(from_read)?.get(4..).is_some_and(|vr| vr.iter().all(u8::is_ascii_uppercase));
            coding.is_explicit = typed;
        } else {
            return Ok(None);
        }
        let mut data = DataSet { is_big: coding.endian == Endian::Big, ..DataSet::default() };
        let mut pixels = Pixels::Missing;
        while !source.peek(1).map_err(from_read)?.is_empty() {
            if let Some(found) = element(&mut source, coding, &mut data, 0)? {
                pixels = found;
                break;
            }
        }
        Ok(Some(Self { data, syntax, endian: coding.endian, pixels, rest: source }))
    }

    /// The pieces of packed pixel data: the table of where frames begin, then the pieces.
    pub(super) fn pieces(&mut self, most: u64) -> Result<Vec<Vec<u8>>> {
        let coding = Coding { endian: Endian::Little, is_explicit: true };
        let (mut pieces, mut total) = (Vec::new(), 0u64);
        loop {
            match header(&mut self.rest, coding)? {
                (SEQUENCE_END, ..) => return Ok(pieces),
                (ITEM, _, length) if length != UNDEFINED => {
                    total = total.saturating_add(length.into());
                    if total > most || pieces.len() > MOST_ITEMS {
                        return Err(damaged(
                            format!("more than {most} bytes of packed pixels"),
                            "no more than they unpack to",
                        ));
                    }
                    pieces.push(value(&mut self.rest, length.into())?);
                }
                _ => {
                    return Err(damaged(
                        "something else between the pieces of packed pixels",
                        "pieces of a known length",
                    ));
                }
            }
        }
    }
}

fn number(source: &mut Source, endian: Endian, wide: bool) -> Result<u32> {
    Ok(match (wide, endian) {
        (true, Endian::Little) => u32::from_le_bytes(source.array(NAME, "an element")?),
        (true, Endian::Big) => u32::from_be_bytes(source.array(NAME, "an element")?),
        (false, Endian::Little) => u16::from_le_bytes(source.array(NAME, "an element")?).into(),
        (false, Endian::Big) => u16::from_be_bytes(source.array(NAME, "an element")?).into(),
    })
}

/// Tag, type and length of an element; of items and their ends there is no type.
fn header(source: &mut Source, coding: Coding) -> Result<(Tag, [u8; 2], u32)> {
    let endian = coding.endian;
    let tag = number(source, endian, false)? << 16 | number(source, endian, false)?;
    if tag >> 16 == 0xfffe || !coding.is_explicit {
        return Ok((tag, [0; 2], number(source, endian, true)?));
    }
    let kind: [u8; 2] = source.array(NAME, "an element's type")?;
    if !kind.iter().all(u8::is_ascii_uppercase) {
        let found = format!("the element {tag:08x} of type {:?}", String::from_utf8_lossy(&kind));
        return Err(damaged(found, "a type of two letters"));
    }
    let is_long = matches!(
        &kind,
        b"OB" | b"OW" | b"OF" | b"OD" | b"OL" | b"OV" | b"SQ" | b"UC" | b"UR" | b"UT" | b"UN" | b"SV" | b"UV"
    );
    if is_long {
        source.skip(NAME, 2, "an element")?;
    }
    Ok((tag, kind, number(source, endian, is_long)?))
}

fn value(source: &mut Source, length: u64) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    source.by_ref().take(length).read_to_end(&mut bytes).map_err(|e| Error::from_read(NAME, "a value", e))?;
    if bytes.len() as u64 == length {
        Ok(bytes)
    } else {
        Err(damaged(format!("{} bytes of a value", bytes.len()), &format!("{length} bytes")))
    }
}

/// Reads an element into the data set; of pixel data only what kind they are.
fn element(source: &mut Source, coding: Coding, data: &mut DataSet, depth: usize) -> Result<Option<Pixels>> {
    let (tag, kind, length) = header(source, coding)?;
    if depth == 0 && PIXELS.contains(&tag) {
        let is_real = tag != 0x7fe0_0010;
        return Ok(Some(match length {
            _ if is_real => Pixels::Real,
            UNDEFINED => Pixels::Packed,
            length => Pixels::Plain(length.into()),
        }));
    }
    // An unknown type of unknown length is a sequence in the implicit coding (PS3.5, 6.2.2).
    let coding = if &kind == b"UN" && length == UNDEFINED {
        Coding { endian: Endian::Little, is_explicit: false }
    } else {
        coding
    };
    if length == UNDEFINED || SEQUENCES.contains(&tag) {
        let items = sequence(source, coding, length, depth + 1, SEQUENCES.contains(&tag))?;
        if !items.is_empty() {
            data.elements.push((tag, Value::Items(items)));
        }
        return Ok(None);
    }
    if KEPT.contains(&tag) && u64::from(length) <= MOST_BYTES {
        let bytes = value(source, length.into())?;
        data.elements.push((tag, Value::Bytes(bytes)));
    } else {
        source.skip(NAME, length.into(), "a value")?;
    }
    Ok(None)
}

/// Reads the items of a sequence; keeps them where they are wanted.
fn sequence(source: &mut Source, coding: Coding, length: u32, depth: usize, is_kept: bool) -> Result<Vec<DataSet>> {
    if depth > MOST_DEPTH {
        return Err(damaged("sequences within each other", "at most 16 levels of them"));
    }
    let mut items = Vec::new();
    let whole = Bounds::new(source, length);
    while whole.has_more(source)? {
        let (tag, _, length) = header(source, coding)?;
        match tag {
            SEQUENCE_END if whole.end.is_none() => break,
            ITEM => {}
            _ => return Err(damaged(format!("the element {tag:08x} between items"), "items")),
        }
        let mut item = DataSet { is_big: coding.endian == Endian::Big, ..DataSet::default() };
        let inside = Bounds::new(source, length);
        while inside.has_more(source)? {
            if inside.end.is_none() {
                let end = match coding.endian {
                    Endian::Little => [0xfe, 0xff, 0x0d, 0xe0],
                    Endian::Big => [0xff, 0xfe, 0xe0, 0x0d],
                };
                if source.peek(4).map_err(|e| Error::from_read(NAME, "an item", e))? == end {
                    header(source, coding)?;
                    break;
                }
            }
            element(source, coding, &mut item, depth)?;
        }
        if is_kept {
            items.push(item);
        }
        if items.len() > MOST_ITEMS {
            return Err(damaged("more than 1,048,576 items", "fewer"));
        }
    }
    Ok(items)
}

/// Where a part of known length ends; none where a mark ends it.
struct Bounds {
    end: Option<u64>,
}

impl Bounds {
    fn new(source: &Source, length: u32) -> Self {
        Self { end: (length != UNDEFINED).then(|| source.consumed().saturating_add(length.into())) }
    }

    /// Whether there is more; what is open has its mark to come.
    fn has_more(&self, source: &mut Source) -> Result<bool> {
        match self.end {
            Some(end) if source.consumed() > end => Err(damaged("an element that goes beyond its item", "it inside")),
            Some(end) if source.consumed() == end => Ok(false),
            _ if source.peek(1).map_err(|e| Error::from_read(NAME, "an item", e))?.is_empty() => {
                Err(damaged("the end of the file in a sequence", "the end of the sequence"))
            }
            _ => Ok(true),
        }
    }
}
