//! Reading environment images from bytes. The format is decided by content, never by name;
//! every layout becomes a lat-long image in the frame of [`super::latlong`].
//!
//! | format | reader | layout |
//! |---|---|---|
//! | OpenEXR | crate `exr` | `envmap` attribute, else the side ratio |
//! | Radiance HDR | crate `image`, header read here too | side ratio |
//! | PNG, JPEG | crates `png`, `image`, sRGB decoded to linear | side ratio |
//!
//! Side ratio: 2:1 lat-long, 1:1 angular map, 3:4 vertical cross, 4:3 horizontal cross; anything
//! else, and a single pixel, is taken as lat-long, with a note. [`ReadOptions::layout`] overrides
//! both ratio and attribute.
//!
//! # Panics
//! None, on any bytes (`tests/fuzz`). `unwrap` and `expect` are denied. Indexing is not: indices are channels,
//! values of 16 bits into a table of 2¹⁶, or pixels of a buffer made for that very size.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]

mod layout;
mod low_range;
mod openexr;
mod radiance;

use super::latlong::LatLong;
use crate::error::{Error, Result};
use serde::Serialize;
use std::fmt;
use std::str::FromStr;

/// Most pixels that an image may have unless [`ReadOptions::max_pixels`] says otherwise:
/// 16384 × 8192, 1.6 GB as floats. It is checked against the header before anything is
/// allocated, so that a damaged size field cannot exhaust the memory.
pub const MAX_PIXELS: usize = 1 << 27;

/// Something a reader noticed and did that the user should know.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Note {
    /// What was found and what was done about it, a sentence without a full stop.
    pub text: String,
    /// How many pixels (or header fields) it concerns.
    pub count: u64,
}

impl Note {
    pub(crate) fn new(text: impl Into<String>, count: usize) -> Self {
        Self { text: text.into(), count: count as u64 }
    }
}

/// How an image covers the sphere.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Layout {
    /// Longitude across, latitude down ([`super::latlong`]).
    LatLong,
    /// Debevec's light probe ("angular map"): a disk in a square, the distance from the centre
    /// proportional to the angle from the forward direction, the rim straight backwards.
    Angular,
    /// Six cube faces, 3 across and 4 down: up; left, forward, right; down; back upside down.
    VerticalCross,
    /// Six cube faces, 4 across and 3 down: up; left, forward, right, back; down.
    HorizontalCross,
    /// Six cube faces in one column as in OpenEXR's cube environments: +x −x +y −y +z −z.
    CubeStrip,
}

impl Layout {
    const ALL: [Self; 5] = [Self::LatLong, Self::Angular, Self::VerticalCross, Self::HorizontalCross, Self::CubeStrip];

    /// The name used on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::LatLong => "latlong",
            Self::Angular => "angular",
            Self::VerticalCross => "vertical-cross",
            Self::HorizontalCross => "horizontal-cross",
            Self::CubeStrip => "cube-strip",
        }
    }

    /// The side of a cube face when a `width` × `height` image can have this layout; 0 for
    /// layouts without faces, `None` when the sides do not fit.
    fn face(self, width: usize, height: usize) -> Option<usize> {
        let cells = |across: usize, down: usize| {
            let face = width / across;
            (face > 0 && width == face * across && face.checked_mul(down) == Some(height)).then_some(face)
        };
        match self {
            Self::LatLong => Some(0),
            Self::Angular => (width == height).then_some(0),
            Self::VerticalCross => cells(3, 4),
            Self::HorizontalCross => cells(4, 3),
            Self::CubeStrip => cells(1, 6),
        }
    }
}

impl fmt::Display for Layout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Layout {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|l| l.name() == name).ok_or_else(|| {
            let names: Vec<_> = Self::ALL.iter().map(|l| l.name()).collect();
            Error::argument("layout", name, format!("one of {}", names.join(", ")), "leave it out to go by the file")
        })
    }
}

/// What a reader may assume and how far it may go.
#[derive(Clone, Copy, Debug)]
pub struct ReadOptions {
    /// The layout, whatever the file and its side ratio say.
    pub layout: Option<Layout>,
    /// Keep negative values instead of setting them to 0. Refused by callers that need a
    /// non-negative environment, such as certified windows.
    pub keep_negative: bool,
    /// Most pixels; [`MAX_PIXELS`] by default.
    pub max_pixels: usize,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self { layout: None, keep_negative: false, max_pixels: MAX_PIXELS }
    }
}

/// Pixels that no light can have, counted in the image as stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct BadPixels {
    /// Pixels with a NaN channel.
    pub nan: u64,
    /// Pixels with an infinite channel.
    pub infinite: u64,
    /// Pixels with a negative channel.
    pub negative: u64,
}

/// An image as a reader delivers it.
pub(crate) struct Raw {
    pub(crate) format: &'static str,
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) pixels: Vec<[f32; 3]>,
    /// What the file itself says.
    pub(crate) layout: Option<Layout>,
    pub(crate) notes: Vec<Note>,
}

/// What came out of a file.
#[derive(Clone, Debug)]
pub struct ReadImage {
    /// The environment.
    pub image: LatLong,
    /// Name of the file format.
    pub format: &'static str,
    /// The layout it was stored in.
    pub layout: Layout,
    /// Width and height as stored.
    pub stored_size: [usize; 2],
    /// Pixels that were set to 0 or kept negative.
    pub bad: BadPixels,
    /// What the reader noticed.
    pub notes: Vec<Note>,
}

/// Reads an environment image from the bytes of a file.
///
/// NaN and infinite channels are set to 0; negative ones too unless
/// [`ReadOptions::keep_negative`]. Both are counted and noted.
///
/// # Errors
/// [`Error::Format`] when the bytes are of no known format, damaged, truncated, of size zero, or
/// hold no colour; [`Error::Limit`] when the header asks for more pixels than allowed;
/// [`Error::Argument`] when the layout asked for does not fit the sides.
pub fn read(bytes: &[u8], options: &ReadOptions) -> Result<ReadImage> {
    let mut raw = match bytes {
        [0x76, 0x2f, 0x31, 0x01, ..] => openexr::read(bytes, options)?,
        [b'#', b'?', ..] => radiance::read(bytes, options)?,
        [0x89, b'P', b'N', b'G', ..] => low_range::read_png(bytes, options)?,
        [0xff, 0xd8, 0xff, ..] => low_range::read_jpeg(bytes, options)?,
        _ => return Err(unknown_format(bytes)),
    };
    let bad = sanitise(&mut raw, options.keep_negative);
    let layout = layout::choose(&mut raw, options)?;
    let stored_size = [raw.width, raw.height];
    let Raw { format, width, height, pixels, notes, .. } = raw;
    let image = layout::to_lat_long(layout, width, height, pixels)?;
    Ok(ReadImage { image, format, layout, stored_size, bad, notes })
}

fn unknown_format(bytes: &[u8]) -> Error {
    let found = match bytes {
        [] => "an empty file".to_string(),
        [b'P', b'F' | b'f', ..] => "a portable float map (PFM)".to_string(),
        [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => "a TIFF image".to_string(),
        _ => {
            let start: Vec<_> = bytes.iter().take(4).map(|b| format!("{b:02x}")).collect();
            format!("a file that starts with bytes {}", start.join(" "))
        }
    };
    Error::format(
        "environment",
        found,
        "an OpenEXR, Radiance HDR, PNG or JPEG image",
        "convert it to OpenEXR, or name a built-in sky such as `sky` or `courtyard`",
    )
}

/// Refuses sizes of zero and beyond the limit, before anything is allocated for them.
pub(crate) fn check_size(format: &'static str, width: u64, height: u64, options: &ReadOptions) -> Result<()> {
    if width == 0 || height == 0 {
        return Err(Error::format(
            format,
            format!("an image of {width}x{height} pixels"),
            "at least one pixel",
            "the file is damaged or was never finished; write it again",
        ));
    }
    if u128::from(width) * u128::from(height) > options.max_pixels as u128 {
        return Err(Error::Limit {
            what: format!("a {format} image of {width}x{height}"),
            needed: format!("{} pixels", u128::from(width) * u128::from(height)),
            limit: format!("{} pixels", options.max_pixels),
            remedy: "scale the image down; a few thousand pixels across are plenty, or the header is damaged".into(),
        });
    }
    Ok(())
}

fn sanitise(raw: &mut Raw, keep_negative: bool) -> BadPixels {
    let mut bad = BadPixels::default();
    for pixel in &mut raw.pixels {
        bad.nan += u64::from(pixel.iter().any(|v| v.is_nan()));
        bad.infinite += u64::from(pixel.iter().any(|v| v.is_infinite()));
        bad.negative += u64::from(pixel.iter().any(|v| *v < 0.0 && v.is_finite()));
        for v in pixel {
            if !v.is_finite() || (*v < 0.0 && !keep_negative) {
                *v = 0.0;
            }
        }
    }
    let mut note = |text: &str, count: u64| {
        if count > 0 {
            raw.notes.push(Note { text: text.into(), count });
        }
    };
    note("pixels with NaN were set to 0 in that channel", bad.nan);
    note(
        "infinite pixels were set to 0 in that channel: the brightest light may be missing, \
         save the image as 32-bit float",
        bad.infinite,
    );
    let kept =
        if keep_negative { "negative pixels were kept" } else { "negative pixels were set to 0 in that channel" };
    note(kept, bad.negative);
    bad
}

/// The error for bytes that a decoder refused.
pub(crate) fn damaged(format: &'static str, reason: impl fmt::Display) -> Error {
    Error::format(
        format,
        format!("a file that is damaged, truncated or of an unsupported kind ({reason})"),
        format!("a complete {format} image"),
        "copy or download it again, or convert it to an uncompressed or ZIP OpenEXR image",
    )
}

#[cfg(test)]
mod tests;
