//! TIFF stacks: each page is a section, the first at z = 0; rows run along x, the first row at
//! y = 0 (the image's top). Pages are decoded by the `tiff` crate. Which page is which section, and the
//! spacing, are read where OME-XML or ImageJ say it ([`layout`]); plain resolution tags are mostly 72 dpi by
//! habit and are ignored. Pages of reduced resolution are no sections.

#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

mod layout;
mod ome;

use super::super::assemble::{Parts, assemble, note};
use super::super::decode::{Data, checked_count};
use super::super::read::ReadHint;
use super::super::source::Source;
use super::super::{LengthUnit, Volume};
use super::affine;
use crate::error::{Error, Result};
use ::tiff::decoder::{Decoder, DecodingResult, Limits};
use ::tiff::tags::Tag;
use ::tiff::{ColorType, TiffError};
use glam::{DMat3, DVec3};
use layout::Layout;
use std::io::{Cursor, Read, Seek, SeekFrom};

const NAME: &str = "TIFF";
/// No supported compression expands by more: deflate reaches 1032, LZW and fax less in practice.
const MOST_EXPANSION: u64 = 4096;

fn error(e: TiffError) -> Error {
    match e {
        TiffError::IoError(e) => Error::from_read(NAME, "a page", e),
        TiffError::LimitsExceeded => Error::Limit {
            what: "a page of the TIFF file".into(),
            needed: "more memory than the file can account for".into(),
            limit: "its length times the best compression".into(),
            remedy: "the file is damaged; copy or download it again".into(),
        },
        TiffError::UnsupportedError(e) => Error::format(
            NAME,
            e.to_string(),
            "a grey page in a common encoding",
            "save the stack again, for example with ImageJ or tifffile",
        ),
        e => Error::format(NAME, e.to_string(), "a readable page", "the file is damaged; copy or download it again"),
    }
}

/// Reads a stream by first taking it into memory: TIFF is not laid out in reading order.
pub(crate) fn read_stream(source: Source, hint: &ReadHint) -> Result<Volume> {
    let mut bytes = Vec::new();
    source
        .take(hint.max_bytes.saturating_add(1))
        .read_to_end(&mut bytes)
        .map_err(|e| Error::from_read(NAME, "a TIFF file", e))?;
    if bytes.len() as u64 > hint.max_bytes {
        return Err(Error::Limit {
            what: "the TIFF file".into(),
            needed: format!("more than {} bytes", hint.max_bytes),
            limit: format!("{} bytes", hint.max_bytes),
            remedy: "crop or downsample the volume, or raise the limit".into(),
        });
    }
    let length = bytes.len() as u64;
    read(Cursor::new(bytes), length, hint)
}

/// Refuses a first directory with entries longer than the file. The decoder takes limits only after it
/// has read that directory, with limits of its own of 256 MiB: a file of 600 bytes could claim as much.
fn check_first_directory(source: &mut (impl Read + Seek), length: u64) -> std::io::Result<Result<()>> {
    source.rewind()?;
    let mut head = [0; 8];
    source.read_exact(&mut head)?;
    let [a, b, c, d, e, f, g, h] = head;
    let big_endian = [a, b] == *b"MM";
    let number = |bytes: &[u8]| {
        let fold = |n: u64, byte: &u8| n << 8 | u64::from(*byte);
        if big_endian { bytes.iter().fold(0, fold) } else { bytes.iter().rev().fold(0, fold) }
    };
    // In BigTIFF offsets and counts have 8 bytes, and an entry 20.
    let big = number(&[c, d]) == 43;
    let (mut eight, mut two) = ([0; 8], [0; 2]);
    let offset = if big {
        source.read_exact(&mut eight)?;
        number(&eight)
    } else {
        number(&[e, f, g, h])
    };
    source.seek(SeekFrom::Start(offset))?;
    let entries = if big {
        source.read_exact(&mut eight)?;
        number(&eight)
    } else {
        source.read_exact(&mut two)?;
        number(&two)
    };
    for _ in 0..entries {
        // Tag, type, count, value or offset.
        let [mut kind, mut four] = [[0; 4]; 2];
        source.read_exact(&mut kind)?;
        let [_, _, k0, k1] = kind;
        let count = if big {
            source.read_exact(&mut eight)?;
            let count = number(&eight);
            source.read_exact(&mut eight)?;
            count
        } else {
            source.read_exact(&mut four)?;
            let count = number(&four);
            source.read_exact(&mut four)?;
            count
        };
        let size = match number(&[k0, k1]) {
            3 | 8 => 2,
            4 | 9 | 11 | 13 => 4,
            5 | 10 | 12 | 16..=18 => 8,
            _ => 1,
        };
        if count.saturating_mul(size) > length {
            return Ok(Err(Error::format(
                NAME,
                format!("an entry of {count} values of {size} bytes in the first directory"),
                format!("no more than the {length} bytes of the file"),
                "the file is incomplete or damaged; copy or download it again",
            )));
        }
    }
    Ok(Ok(()))
}

/// A decoder that takes no more memory than the file can account for, and the most bytes that its samples can be.
fn decoder<R: Read + Seek>(mut source: R, length: u64, hint: &ReadHint) -> Result<(Decoder<R>, u64)> {
    // A directory that cannot be read through is the decoder's to name.
    check_first_directory(&mut source, length).unwrap_or(Ok(()))?;
    source.rewind().map_err(|e| Error::from_read(NAME, "the first bytes", e))?;
    let most = length.saturating_mul(MOST_EXPANSION).min(hint.max_bytes);
    let mut limits = Limits::default();
    limits.decoding_buffer_size = usize::try_from(most).unwrap_or(usize::MAX);
    limits.intermediate_buffer_size = limits.decoding_buffer_size;
    Ok((Decoder::new(source).map_err(error)?.with_limits(limits), most))
}

/// Reads from something that can seek.
pub(crate) fn read(source: impl Read + Seek, length: u64, hint: &ReadHint) -> Result<Volume> {
    let (mut decoder, most) = decoder(source, length, hint)?;
    let Layout { pages, spacing, unit, series, announced, mut notes } = Layout::read(&mut decoder, &hint.choice)?;
    let mut stack = Stack::default();
    let mut reduced = 0;
    match pages {
        Some(pages) => {
            // The decoder lists what it walks past, and walks forward only.
            let last = pages.iter().copied().max().unwrap_or(0);
            decoder.seek_to_image(last).map_err(|e| missing(last, e))?;
            for page in pages {
                decoder.seek_to_image(page).map_err(|e| missing(page, e))?;
                stack.add(&mut decoder, page as u64, most, hint)?;
            }
        }
        None => loop {
            if is_reduced(&mut decoder) {
                reduced += 1;
            } else {
                stack.add(&mut decoder, stack.sections + reduced, most, hint)?;
            }
            if !decoder.more_images() {
                break;
            }
            decoder.next_image().map_err(error)?;
        },
    }
    let Stack { data: Some(data), size: Some((width, height)), sections } = stack else {
        return Err(Error::format(NAME, "no page", "at least one of full resolution", "the file is empty"));
    };
    if reduced > 0 {
        notes.push(note(format!("{reduced} pages of reduced resolution were left out"), reduced as usize));
    }
    if let Some(images) = announced.filter(|&n| n > sections) {
        // ImageJ writes stacks beyond 4 GiB as one page followed by bare samples.
        let text = format!("ImageJ announces {images} sections, {sections} pages were found and read");
        notes.push(note(text, (images - sections) as usize));
    }
    let world_from_grid = affine(NAME, DMat3::from_diagonal(spacing), DVec3::ZERO)?;
    let dims = [width as usize, height as usize, sections as usize];
    let (slope, inter) = (1.0, 0.0);
    assemble(Parts { format: NAME, dims, data, slope, inter, world_from_grid, unit, series, notes }, hint)
}

/// What one file of a folder of slices holds.
pub(crate) struct Slice {
    pub(crate) size: (u32, u32),
    pub(crate) data: Data,
    /// Spacing and unit, where the file has them.
    pub(crate) spacing: Option<(DVec3, LengthUnit)>,
}

/// Reads the only page of a file.
pub(crate) fn read_slice(source: impl Read + Seek, length: u64, hint: &ReadHint) -> Result<Slice> {
    let (mut decoder, most) = decoder(source, length, hint)?;
    let any = super::super::Choice { any_channel: true, ..Default::default() };
    let said = Layout::read(&mut decoder, &any).ok().map(|layout| (layout.spacing, layout.unit));
    // The description may belong to a set of files, of which this is one page.
    decoder.seek_to_image(0).map_err(error)?;
    let mut stack = Stack::default();
    loop {
        if !is_reduced(&mut decoder) {
            if stack.sections > 0 {
                let remedy = "name the file itself: isolume info FILE";
                return Err(Error::format(NAME, "several pages", "one page in each file of a folder", remedy));
            }
            stack.add(&mut decoder, 0, most, hint)?;
        }
        if !decoder.more_images() {
            break;
        }
        decoder.next_image().map_err(error)?;
    }
    match stack {
        Stack { data: Some(data), size: Some(size), .. } => {
            Ok(Slice { size, data, spacing: said.filter(|(spacing, _)| *spacing != DVec3::ONE) })
        }
        _ => Err(Error::format(NAME, "no page", "one of full resolution", "the file is empty")),
    }
}

/// Sections on top of each other.
#[derive(Default)]
struct Stack {
    data: Option<Data>,
    size: Option<(u32, u32)>,
    sections: u64,
}

impl Stack {
    /// Adds the page at which the decoder stands; `page` is its number, for messages.
    fn add<R: Read + Seek>(&mut self, decoder: &mut Decoder<R>, page: u64, most: u64, hint: &ReadHint) -> Result<()> {
        let (found, colour) = (decoder.dimensions().map_err(error)?, decoder.colortype().map_err(error)?);
        let (width, height) = *self.size.get_or_insert(found);
        if found != (width, height) {
            return Err(Error::format(
                NAME,
                format!("page {page} of {}×{}", found.0, found.1),
                format!("pages of one size, {width}×{height} as the first"),
                "remove thumbnails and other pages",
            ));
        }
        if !matches!(colour, ColorType::Gray(8 | 16 | 32 | 64)) {
            return Err(Error::format(
                NAME,
                format!("pages of colour type {colour:?}"),
                "grey pages of 8 to 64 bits",
                "convert the stack to grey, for example 8-bit in ImageJ",
            ));
        }
        self.sections += 1;
        let size = usize::from(colour.bit_depth()) / 8;
        checked_count(NAME, [u64::from(width), u64::from(height), self.sections], size, Some(most), hint)?;
        append(&mut self.data, decoded(decoder.read_image().map_err(error)?))
    }
}

/// Whether the page is a smaller copy of another one, as in pyramids and thumbnails.
fn is_reduced<R: Read + Seek>(decoder: &mut Decoder<R>) -> bool {
    matches!(decoder.find_tag_unsigned::<u32>(Tag::NewSubfileType), Ok(Some(bits)) if bits & 1 == 1)
}

fn missing(page: usize, e: TiffError) -> Error {
    match e {
        TiffError::IoError(_) | TiffError::FormatError(_) => Error::format(
            NAME,
            format!("no page {page}, which the description of the first page names"),
            "as many pages as it says",
            "the file is incomplete; copy or download it again",
        ),
        e => error(e),
    }
}

/// Samples of a page; half floats become single ones.
fn decoded(page: DecodingResult) -> Data {
    match page {
        DecodingResult::U8(v) => Data::U8(v),
        DecodingResult::U16(v) => Data::U16(v),
        DecodingResult::U32(v) => Data::U32(v),
        DecodingResult::U64(v) => Data::U64(v),
        DecodingResult::I8(v) => Data::I8(v),
        DecodingResult::I16(v) => Data::I16(v),
        DecodingResult::I32(v) => Data::I32(v),
        DecodingResult::I64(v) => Data::I64(v),
        DecodingResult::F16(v) => Data::F32(v.iter().map(|s| s.to_f32()).collect()),
        DecodingResult::F32(v) => Data::F32(v),
        DecodingResult::F64(v) => Data::F64(v),
    }
}

/// Adds a section to those below it; the first decides the type.
pub(crate) fn append(stack: &mut Option<Data>, section: Data) -> Result<()> {
    macro_rules! join {
        ($($data:ident),*) => {
            match (stack.as_mut(), section) {
                (None, first) => *stack = Some(first),
                $((Some(Data::$data(all)), Data::$data(v)) => all.extend_from_slice(&v),)*
                (Some(_), _) => {
                    return Err(Error::format(NAME, "pages of different types", "one type", "convert all pages alike"));
                }
            }
        };
    }
    join!(U8, U16, U32, U64, I8, I16, I32, I64, F32, F64);
    Ok(())
}
