//! TIFF stacks: each page is a section, the first at z = 0; rows run along x, the first row at
//! y = 0 (the image's top). Pages are decoded by the `tiff` crate. Which page is which section, and the
//! spacing, are read where OME-XML or ImageJ say it ([`layout`]); plain resolution tags are mostly 72 dpi by
//! habit and are ignored. Pages of reduced resolution are no sections; those below a page (SubIFDs) are levels of a pyramid.

#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

mod directed;
mod layout;
mod ome;

use super::super::assemble::{Parts, assemble, note};
use super::super::decode::{Data, checked_count};
use super::super::read::ReadHint;
use super::super::source::Source;
use super::super::{LengthUnit, Volume};
use super::{affine, needs_second_file};
use crate::error::{Error, Result};
use crate::file::Beside;
use ::tiff::decoder::{Decoder, DecodingResult, Limits};
use ::tiff::tags::Tag;
use ::tiff::{ColorType, TiffError};
use directed::Directed;
use glam::{DMat3, DVec3};
use layout::{Layout, Page};
use std::io::{BufReader, Cursor, Read, Seek, SeekFrom};

const NAME: &str = "TIFF";
/// No supported compression expands by more: deflate reaches 1032, LZW and fax less in practice.
const MOST_EXPANSION: u64 = 4096;
/// Most levels of a pyramid.
const MOST_LEVELS: usize = 32;

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
    read(Cursor::new(bytes), length, hint, None)
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

/// Reads from something that can seek; `beside` is where the other files of a set lie.
pub(crate) fn read(source: impl Read + Seek, length: u64, hint: &ReadHint, beside: Option<&Beside>) -> Result<Volume> {
    let (mut decoder, most) = decoder(source, length, hint)?;
    let layout = Layout::read(&mut decoder, &hint.choice, beside)?;
    let Layout { pages, mut spacing, unit, mut series, announced, mut notes } = layout;
    let mut stack = Stack::default();
    let mut reduced = 0;
    let levels = levels(&mut decoder, pages.as_deref(), length, hint)?;
    let level = hint.choice.level_of(&levels, &mut notes)?;
    if let (Some([w0, h0, _]), Some([w, h, _]), 1..) = (levels.first(), levels.get(level), level) {
        spacing *= DVec3::new(*w0 as f64 / *w as f64, *h0 as f64 / *h as f64, 1.0);
        notes.push(note("levels have no place of their own: this one may be shifted by half a pixel of it", 1));
    }
    (series.levels, series.level) = (levels, level);
    let pages = match (pages, level) {
        (None, 1..) => Some(whole_pages(&mut decoder)?),
        (pages, _) => pages,
    };
    match pages {
        Some(pages) => {
            let mut rest = pages.as_slice();
            while let Some(first) = rest.first() {
                let (run, after) = rest.split_at(rest.iter().take_while(|page| page.file == first.file).count());
                let mut read = Pages { run, level, hint, stack: &mut stack };
                match (&first.file, beside) {
                    (None, _) => read.from(&mut decoder, length, most)?,
                    (Some(name), Some(beside)) => {
                        let mut from = || {
                            let (file, length, _) = beside.open(name)?;
                            let (mut other, most) = self::decoder(BufReader::new(file), length, hint)?;
                            read.from(&mut other, length, most)
                        };
                        from().map_err(|e| e.in_file(name))?;
                    }
                    (Some(name), None) => return Err(needs_second_file(NAME, name)),
                }
                rest = after;
            }
            let files = pages.iter().filter_map(|page| page.file.as_ref()).collect::<std::collections::BTreeSet<_>>();
            if !files.is_empty() {
                notes
                    .push(note(format!("sections were read from {} other files of the set", files.len()), files.len()));
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

/// The first file with pages that a companion of OME-TIFF files names, where the text is one.
pub(crate) fn file_of_companion(text: &str) -> Option<Result<String>> {
    (text.contains("<OME") || text.contains(":OME")).then(|| {
        let ome = ome::Ome::parse(text)?;
        ome.first_file().map(String::from).ok_or_else(|| {
            let remedy = "name the .ome.tif file";
            Error::format("OME-XML", "metadata without pixels", "the names of TIFF files", remedy)
        })
    })
}

/// The pages of full resolution.
fn whole_pages<R: Read + Seek>(decoder: &mut Decoder<R>) -> Result<Vec<Page>> {
    decoder.seek_to_image(0).map_err(error)?;
    let (mut pages, mut number) = (Vec::new(), 0);
    loop {
        if !is_reduced(decoder) {
            pages.push(Page { file: None, number });
        }
        if !decoder.more_images() {
            break;
        }
        decoder.next_image().map_err(error)?;
        number += 1;
    }
    decoder.seek_to_image(0).map_err(error)?;
    Ok(pages)
}

/// Places of the smaller copies below the page at which the decoder stands.
fn below<R: Read + Seek>(decoder: &mut Decoder<R>) -> Vec<u64> {
    decoder.find_tag_unsigned_vec(Tag::SubIfd).ok().flatten().unwrap_or_default()
}

/// Samples of the levels: of the first page that is wanted, and of the copies below it, as many as there are sections.
fn levels<R: Read + Seek>(
    decoder: &mut Decoder<R>,
    pages: Option<&[Page]>,
    length: u64,
    hint: &ReadHint,
) -> Result<Vec<[u64; 3]>> {
    if let Some(page) = pages.and_then(|pages| pages.first()) {
        if page.file.is_some() {
            return Ok(Vec::new());
        }
        seek_far(decoder, page.number)?;
    }
    let places = below(decoder);
    if places.is_empty() {
        decoder.seek_to_image(0).map_err(error)?;
        return Ok(Vec::new());
    }
    let sections = match pages {
        Some(pages) => pages.len(),
        None => whole_pages(decoder)?.len(),
    } as u64;
    let size = |(width, height): (u32, u32)| [u64::from(width), u64::from(height), sections];
    let mut levels = vec![size(decoder.dimensions().map_err(error)?)];
    // A place of 0 is one that was never written.
    for place in places.into_iter().take_while(|place| *place > 0).take(MOST_LEVELS) {
        let (mut lower, _) = self::decoder(Directed::new(decoder.inner(), place), length, hint)?;
        levels.push(size(lower.dimensions().map_err(error)?));
    }
    decoder.seek_to_image(0).map_err(error)?;
    Ok(levels)
}

/// Goes to a page; the decoder lists what it walks past, and walks forward only.
fn seek_far<R: Read + Seek>(decoder: &mut Decoder<R>, page: usize) -> Result<()> {
    decoder.seek_to_image(page).map_err(|e| missing(page, e))
}

/// Pages of one file that are the next sections.
struct Pages<'a> {
    run: &'a [Page],
    level: usize,
    hint: &'a ReadHint,
    stack: &'a mut Stack,
}

impl Pages<'_> {
    fn from<R: Read + Seek>(&mut self, decoder: &mut Decoder<R>, length: u64, most: u64) -> Result<()> {
        seek_far(decoder, self.run.iter().map(|page| page.number).max().unwrap_or(0))?;
        for page in self.run {
            seek_far(decoder, page.number)?;
            let Some(copy) = self.level.checked_sub(1) else {
                self.stack.add(decoder, page.number as u64, most, self.hint)?;
                continue;
            };
            let place = below(decoder).get(copy).copied().filter(|place| *place > 0).ok_or_else(|| {
                let found = format!("page {} without level {}", page.number, self.level);
                Error::format(NAME, found, "as many levels of each page", "choose another with --level")
            })?;
            let (mut lower, most) = self::decoder(Directed::new(decoder.inner(), place), length, self.hint)?;
            self.stack.add(&mut lower, page.number as u64, most, self.hint)?;
        }
        Ok(())
    }
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
    let said = Layout::read(&mut decoder, &any, None).ok().map(|layout| (layout.spacing, layout.unit));
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
