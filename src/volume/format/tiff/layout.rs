//! Which pages of a TIFF file are the sections of the volume, and how far apart they lie: from OME-XML, from what ImageJ
//! writes, or all pages in their order.

use super::super::super::assemble::note;
use super::super::super::choice::{Choice, Series};
use super::super::super::{LengthUnit, Note};
use super::super::metres_in;
use super::ome::Ome;
use crate::error::Result;
use crate::file::Beside;
use ::tiff::decoder::Decoder;
use ::tiff::decoder::ifd::Value;
use ::tiff::tags::Tag;
use glam::DVec3;
use std::io::{Read, Seek};

/// A page of a file.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Page {
    /// Another file than the one at hand.
    pub(super) file: Option<String>,
    /// From 0.
    pub(super) number: usize,
}

/// Where the sections are.
pub(super) struct Layout {
    /// Their pages, lowest first; `None` for all pages of full resolution.
    pub(super) pages: Option<Vec<Page>>,
    pub(super) spacing: DVec3,
    pub(super) unit: LengthUnit,
    pub(super) series: Series,
    /// Sections that ImageJ announces.
    pub(super) announced: Option<u64>,
    pub(super) notes: Vec<Note>,
}

impl Layout {
    fn plain(choice: &Choice) -> Result<Self> {
        let mut notes = Vec::new();
        let series = choice.of(super::NAME, Vec::new(), 1, &mut notes)?;
        let (spacing, unit) = (DVec3::ONE, LengthUnit::Unknown);
        Ok(Self { pages: None, spacing, unit, series, announced: None, notes })
    }

    /// What the first page says.
    pub(super) fn read<R: Read + Seek>(
        decoder: &mut Decoder<R>,
        choice: &Choice,
        beside: Option<&Beside>,
    ) -> Result<Self> {
        let text = match decoder.find_tag(Tag::ImageDescription) {
            Ok(None) => return Self::plain(choice),
            Ok(Some(Value::Ascii(text))) => text,
            Ok(Some(other)) => {
                let bytes = other.into_u8_vec().unwrap_or_default();
                String::from_utf8_lossy(&bytes).into_owned()
            }
            Err(_) => {
                let mut layout = Self::plain(choice)?;
                layout.notes.push(note("the description of the first page is not text, and was not read", 1));
                return Ok(layout);
            }
        };
        if text.contains("<OME") || text.contains(":OME") {
            return Ome::parse(&text)?.completed(beside)?.layout(choice);
        }
        if text.starts_with("ImageJ=") {
            return Self::of_imagej(decoder, &text, choice);
        }
        Self::plain(choice)
    }

    /// Hyperstacks run through channels first, then sections, then frames.
    fn of_imagej<R: Read + Seek>(decoder: &mut Decoder<R>, text: &str, choice: &Choice) -> Result<Self> {
        let value = |key: &str| text.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix('='));
        let count = |key: &str| value(key).and_then(|v| v.trim().parse::<usize>().ok()).filter(|n| *n > 0);
        let (channels, frames) = (count("channels").unwrap_or(1), count("frames").unwrap_or(1));
        // A count beyond any file: of as many pages none would be found.
        let (channels, frames) = (channels.min(1 << 16), frames.min(1 << 24));
        let mut layout = Self::plain(&Choice::default())?;
        let names = vec![String::new(); channels];
        layout.series = choice.of("ImageJ hyperstack", names, frames, &mut layout.notes)?;
        layout.announced = count("images").map(|n| n as u64);
        if channels * frames > 1 {
            let images = count("images").map(|n| n / (channels * frames));
            let sections = count("slices").or(images).unwrap_or(1).min(1 << 24);
            let Series { channel, timepoint, .. } = layout.series;
            let page = |z: usize| channel + channels * (z + sections * timepoint);
            layout.pages = Some((0..sections).map(|z| Page { file: None, number: page(z) }).collect());
            layout.announced = None;
        }
        // Pixels in a unit; as a rational that the decoder hands out as two numbers.
        let mut in_plane = |tag| {
            let parts = decoder.get_tag_u32_vec(tag).ok()?;
            let [pixels, units] = <[u32; 2]>::try_from(parts).ok()?;
            (pixels > 0 && units > 0).then(|| f64::from(units) / f64::from(pixels))
        };
        let metres = value("unit").and_then(metres_in);
        let depth = value("spacing").and_then(|v| v.trim().parse::<f64>().ok());
        let depth = depth.map(f64::abs).filter(|v| v.is_finite() && *v > 0.0);
        if let (Some(x), Some(y)) = (in_plane(Tag::XResolution), in_plane(Tag::YResolution)) {
            layout.spacing = DVec3::new(x, y, depth.unwrap_or(x));
            layout.unit = metres.map_or(LengthUnit::Unknown, LengthUnit::Metres);
        } else if let Some(depth) = depth {
            layout.spacing.z = depth;
        }
        Ok(layout)
    }
}
