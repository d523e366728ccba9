//! TIFF stacks: each page is a section, the first at z = 0; rows run along x, the first row at
//! y = 0 (the image's top). Pages are decoded by the `tiff` crate. Spacing is read where ImageJ
//! wrote it; plain resolution tags are mostly 72 dpi by habit and are ignored.

#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

use super::super::assemble::{Parts, assemble, note};
use super::super::decode::{Data, checked_count};
use super::super::read::ReadHint;
use super::super::source::Source;
use super::super::{LengthUnit, Note, Volume};
use super::{affine, metres_in};
use crate::error::{Error, Result};
use ::tiff::decoder::{Decoder, DecodingResult, Limits};
use ::tiff::tags::Tag;
use ::tiff::{ColorType, TiffError};
use glam::{DMat3, DVec3};
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

/// Reads from something that can seek.
pub(crate) fn read(mut source: impl Read + Seek, length: u64, hint: &ReadHint) -> Result<Volume> {
    // A directory that cannot be read through is the decoder's to name.
    check_first_directory(&mut source, length).unwrap_or(Ok(()))?;
    source.rewind().map_err(|e| Error::from_read(NAME, "the first bytes", e))?;
    let most = length.saturating_mul(MOST_EXPANSION).min(hint.max_bytes);
    let mut limits = Limits::default();
    limits.decoding_buffer_size = usize::try_from(most).unwrap_or(usize::MAX);
    limits.intermediate_buffer_size = limits.decoding_buffer_size;
    let mut decoder = Decoder::new(source).map_err(error)?.with_limits(limits);
    let (width, height) = decoder.dimensions().map_err(error)?;
    let info = ImageJ::read(&mut decoder);
    info.refuse_hyperstacks()?;

    let mut stack = None;
    let mut pages = 0u64;
    loop {
        let (found, colour) = (decoder.dimensions().map_err(error)?, decoder.colortype().map_err(error)?);
        if found != (width, height) {
            return Err(Error::format(
                NAME,
                format!("page {pages} of {}×{}", found.0, found.1),
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
        pages += 1;
        let size = usize::from(colour.bit_depth()) / 8;
        checked_count(NAME, [u64::from(width), u64::from(height), pages], size, Some(most), hint)?;
        let page = decoder.read_image().map_err(error)?;
        append(&mut stack, page)?;
        if !decoder.more_images() {
            break;
        }
        decoder.next_image().map_err(error)?;
    }
    let Some(data) = stack else { return Err(Error::format(NAME, "no page", "at least one", "the file is empty")) };
    let mut notes = Vec::new();
    info.check_pages(pages, &mut notes);
    let world_from_grid = affine(NAME, DMat3::from_diagonal(info.spacing), DVec3::ZERO)?;
    let dims = [width as usize, height as usize, pages as usize];
    assemble(Parts { format: NAME, dims, data, slope: 1.0, inter: 0.0, world_from_grid, unit: info.unit, notes }, hint)
}

/// Adds a page to the stack; the first decides the type.
fn append(stack: &mut Option<Data>, page: DecodingResult) -> Result<()> {
    let page = match page {
        DecodingResult::F16(v) => DecodingResult::F32(v.iter().map(|s| s.to_f32()).collect()),
        page => page,
    };
    macro_rules! join {
        ($($page:ident => $data:ident),*) => {
            match (stack.as_mut(), page) {
                $((None, DecodingResult::$page(v)) => *stack = Some(Data::$data(v)),
                (Some(Data::$data(all)), DecodingResult::$page(v)) => all.extend_from_slice(&v),)*
                // Not half floats, which are single ones by now.
                (_, _) => {
                    return Err(Error::format(NAME, "pages of different types", "one type", "convert all pages alike"));
                }
            }
        };
    }
    join!(U8 => U8, U16 => U16, U32 => U32, U64 => U64, I8 => I8, I16 => I16, I32 => I32, I64 => I64, F32 => F32,
        F64 => F64);
    Ok(())
}

/// What ImageJ writes into the description and the resolution of the first page.
struct ImageJ {
    images: Option<u64>,
    channels: u64,
    frames: u64,
    spacing: DVec3,
    unit: LengthUnit,
}

impl ImageJ {
    fn read<R: Read + Seek>(decoder: &mut Decoder<R>) -> Self {
        let mut info = Self { images: None, channels: 1, frames: 1, spacing: DVec3::ONE, unit: LengthUnit::Unknown };
        let Ok(text) = decoder.get_tag_ascii_string(Tag::ImageDescription) else { return info };
        if !text.starts_with("ImageJ=") {
            return info;
        }
        let value = |key: &str| text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix('='));
        info.images = value("images").and_then(|v| v.parse().ok());
        info.channels = value("channels").and_then(|v| v.parse().ok()).unwrap_or(1);
        info.frames = value("frames").and_then(|v| v.parse().ok()).unwrap_or(1);
        // Pixels in a unit; as a rational that the decoder hands out as two numbers.
        let mut in_plane = |tag| {
            let parts = decoder.get_tag_u32_vec(tag).ok()?;
            let [pixels, units] = <[u32; 2]>::try_from(parts).ok()?;
            (pixels > 0 && units > 0).then(|| f64::from(units) / f64::from(pixels))
        };
        let metres = value("unit").and_then(metres_in);
        let depth = value("spacing").and_then(|v| v.parse::<f64>().ok()).filter(|v| v.is_finite() && *v > 0.0);
        if let (Some(x), Some(y)) = (in_plane(Tag::XResolution), in_plane(Tag::YResolution)) {
            info.spacing = DVec3::new(x, y, depth.unwrap_or(x));
            info.unit = metres.map_or(LengthUnit::Unknown, LengthUnit::Metres);
        } else if let Some(depth) = depth {
            info.spacing.z = depth;
        }
        info
    }

    fn refuse_hyperstacks(&self) -> Result<()> {
        if self.channels > 1 || self.frames > 1 {
            return Err(Error::format(
                NAME,
                format!("an ImageJ hyperstack of {} channels and {} frames", self.channels, self.frames),
                "one channel and one frame",
                "duplicate one channel and frame in ImageJ and save that",
            ));
        }
        Ok(())
    }

    /// ImageJ writes stacks beyond 4 GiB as one page followed by bare samples.
    fn check_pages(&self, pages: u64, notes: &mut Vec<Note>) {
        if let Some(images) = self.images.filter(|&n| n > pages) {
            let text = format!("ImageJ announces {images} sections, {pages} pages were found and read");
            notes.push(note(text, (images - pages) as usize));
        }
    }
}
