//! OME-XML in the first page of an OME-TIFF: sizes, spacing, and which page holds which plane
//! (docs.openmicroscopy.org, OME model 2016-06, "OME-TIFF specification").

// Indices are axes, 0 to 2.
#![cfg_attr(not(test), allow(clippy::indexing_slicing))]

use super::super::super::LengthUnit;
use super::super::super::assemble::note;
use super::super::super::choice::Choice;
use super::super::xml::{Attributes, Event, scan};
use super::super::{metres_in, needs_second_file};
use super::layout::{Layout, Page};
use crate::error::{Error, Result};
use crate::file::Beside;
use glam::DVec3;

/// Most planes of an image: more than the pages of any file.
const MOST_PLANES: usize = 1 << 24;

/// Longest companion file.
const MOST_METADATA: u64 = 1 << 28;

/// The axes of pages.
const Z: usize = 0;
const C: usize = 1;
const T: usize = 2;

fn damaged(found: String) -> Error {
    let remedy = "save the file again, for example with Bio-Formats or tifffile";
    Error::format("OME-TIFF", found, "metadata in OME-XML", remedy)
}

/// What is said of the first image.
#[derive(Default)]
pub(super) struct Ome {
    /// The identity of this file.
    uuid: Option<String>,
    images: usize,
    /// Planes along z, c, t.
    sizes: [usize; 3],
    /// The axes of the planes, the fastest first.
    order: [usize; 3],
    /// Distances along x, y, z with their unit.
    physical: [Option<(f64, String)>; 3],
    channels: Vec<String>,
    blocks: Vec<TiffData>,
    /// The file in which all of it stands.
    companion: Option<String>,
}

/// Some planes in a row.
#[derive(Default)]
struct TiffData {
    page: Option<usize>,
    first: [usize; 3],
    count: Option<usize>,
    uuid: Option<String>,
    file: Option<String>,
}

impl Ome {
    /// Reads the text.
    ///
    /// # Errors
    /// When it is no XML, has no pixels, or numbers that no file can have.
    pub(super) fn parse(text: &str) -> Result<Self> {
        let mut ome = Self::default();
        let mut in_uuid = false;
        scan(text, damaged, &mut |event| {
            match event {
                Event::Start("OME", attributes) => ome.uuid = attributes.get("UUID"),
                Event::Start("BinaryOnly", attributes) => {
                    ome.uuid = attributes.get("UUID");
                    ome.companion = attributes.get("MetadataFile");
                }
                Event::Start("Image", _) => ome.images += 1,
                Event::Start(..) if ome.images != 1 => {}
                Event::Start("Pixels", attributes) => ome.pixels(attributes)?,
                Event::Start("Channel", attributes) => {
                    ome.channels.push(attributes.get("Name").unwrap_or_default());
                    if ome.channels.len() > MOST_PLANES {
                        return Err(damaged("more channels than any file has".into()));
                    }
                }
                Event::Start("TiffData", attributes) => ome.blocks.push(TiffData::new(attributes)?),
                Event::Start("UUID", attributes) => {
                    in_uuid = true;
                    if let Some(block) = ome.blocks.last_mut() {
                        block.file = attributes.get("FileName");
                    }
                }
                Event::Text(text) if in_uuid => {
                    if let Some(block) = ome.blocks.last_mut() {
                        block.uuid = Some(text.into());
                    }
                }
                Event::End("UUID") => in_uuid = false,
                _ => {}
            }
            Ok(())
        })?;
        if ome.companion.is_some() {
            return Ok(ome);
        }
        if ome.sizes.contains(&0) {
            return Err(damaged("no Pixels with SizeZ, SizeC and SizeT".into()));
        }
        // A channel of several samples, such as RGB, is one plane.
        if !ome.channels.is_empty() && ome.channels.len() < ome.sizes[C] {
            ome.sizes[C] = ome.channels.len();
        }
        ome.channels.resize(ome.sizes[C], String::new());
        Ok(ome)
    }

    /// With what stands in the companion file, where there is one.
    ///
    /// # Errors
    /// When it is not there, or names another one.
    pub(super) fn completed(self, beside: Option<&Beside>) -> Result<Self> {
        let Some(name) = &self.companion else { return Ok(self) };
        let beside = beside.ok_or_else(|| needs_second_file("OME-TIFF", name))?;
        let text = beside.read(name, MOST_METADATA)?;
        let read = || {
            let whole = Self::parse(&String::from_utf8_lossy(&text))?;
            if whole.companion.is_some() {
                Err(damaged("a companion that names another one".into()))
            } else {
                Ok(whole)
            }
        };
        let whole = read().map_err(|e| e.in_file(name))?;
        Ok(Self { uuid: self.uuid, ..whole })
    }

    /// The first file that holds pages, for who has the companion.
    pub(super) fn first_file(&self) -> Option<&str> {
        self.blocks.iter().find_map(|block| block.file.as_deref())
    }

    fn pixels(&mut self, attributes: Attributes<'_>) -> Result<()> {
        for (axis, name) in ["SizeZ", "SizeC", "SizeT"].into_iter().enumerate() {
            let size: usize =
                attributes.number(name, damaged)?.ok_or_else(|| damaged(format!("Pixels without {name}")))?;
            if !(1..=MOST_PLANES).contains(&size) {
                return Err(damaged(format!("{name}=\"{size}\"")));
            }
            self.sizes[axis] = size;
        }
        if self.sizes.iter().product::<usize>() > MOST_PLANES {
            let [z, c, t] = self.sizes;
            return Err(damaged(format!("{z} × {c} × {t} planes")));
        }
        let order = attributes.get("DimensionOrder").ok_or_else(|| damaged("Pixels without DimensionOrder".into()))?;
        self.order = match order.as_str() {
            "XYZCT" => [Z, C, T],
            "XYZTC" => [Z, T, C],
            "XYCTZ" => [C, T, Z],
            "XYCZT" => [C, Z, T],
            "XYTCZ" => [T, C, Z],
            "XYTZC" => [T, Z, C],
            _ => return Err(damaged(format!("DimensionOrder=\"{order}\""))),
        };
        for (axis, name) in ["X", "Y", "Z"].into_iter().enumerate() {
            let size: Option<f64> = attributes.number(&format!("PhysicalSize{name}"), damaged)?;
            let unit = attributes.get(&format!("PhysicalSize{name}Unit")).unwrap_or_else(|| "µm".into());
            self.physical[axis] = size.filter(|s| s.is_finite() && *s > 0.0).map(|s| (s, unit));
        }
        Ok(())
    }

    /// The sections of the channel and time point that are chosen.
    ///
    /// # Errors
    /// When the choice is not there, or some of its planes are not in this file.
    pub(super) fn layout(&self, choice: &Choice) -> Result<Layout> {
        let mut notes = Vec::new();
        let series = choice.of("OME-TIFF", self.channels.clone(), self.sizes[T], &mut notes)?;
        let pages = self.pages(series.channel, series.timepoint)?;
        if self.images > 1 {
            notes.push(note(format!("the file holds {} images, the first is read", self.images), self.images));
        }
        let mut layout = Layout {
            pages: Some(pages),
            spacing: DVec3::ONE,
            unit: LengthUnit::Unknown,
            series,
            announced: None,
            notes,
        };
        self.place(&mut layout);
        Ok(layout)
    }

    fn place(&self, layout: &mut Layout) {
        let [Some((x, of_x)), Some((y, of_y)), z] = &self.physical else {
            if self.physical.iter().any(Option::is_some) {
                layout.notes.push(note("PhysicalSizeX or PhysicalSizeY is missing: the spacing 1 is used", 1));
            }
            return;
        };
        let (z, of_z) = z.clone().unwrap_or_else(|| {
            if self.sizes[Z] > 1 {
                layout.notes.push(note(format!("no PhysicalSizeZ: {x} {of_x} as in plane; see --spacing"), 1));
            }
            (*x, of_x.clone())
        });
        let metres = [of_x, of_y, &of_z].map(|unit| metres_in(unit));
        layout.spacing = DVec3::new(*x, *y, z);
        if let [Some(in_x), Some(in_y), Some(in_z)] = metres {
            layout.spacing *= DVec3::new(1.0, if in_y == in_x { 1.0 } else { in_y / in_x }, {
                if in_z == in_x { 1.0 } else { in_z / in_x }
            });
            layout.unit = LengthUnit::Metres(in_x);
        } else if !(of_x == of_y && *of_x == of_z) {
            let text = format!("units {of_x}, {of_y} and {of_z} are no common length: the numbers are used");
            layout.notes.push(note(text, 1));
        }
    }

    /// The page of each section.
    fn pages(&self, channel: usize, timepoint: usize) -> Result<Vec<Page>> {
        let mut found = vec![None; self.sizes[Z]];
        let total: usize = self.sizes.iter().product();
        let whole = [TiffData::default()];
        let blocks = if self.blocks.is_empty() { &whole[..] } else { &self.blocks };
        // A file that nobody else names is this one, whatever it is called now.
        let mut names: Vec<&String> = blocks.iter().filter_map(|b| b.uuid.as_ref().or(b.file.as_ref())).collect();
        names.sort();
        names.dedup();
        let is_here = |block: &TiffData| match (&block.uuid, &self.uuid) {
            (Some(of_block), Some(own)) => of_block == own,
            _ => names.len() <= 1,
        };
        for block in blocks {
            let count = block.count.unwrap_or(if block.page.is_some() { 1 } else { total });
            let first = self.order.iter().rev().fold(0, |n, &axis| n * self.sizes[axis] + block.first[axis]);
            for k in 0..count.min(total.saturating_sub(first)) {
                let mut rest = first + k;
                let mut plane = [0; 3];
                for axis in self.order {
                    plane[axis] = rest % self.sizes[axis];
                    rest /= self.sizes[axis];
                }
                if (plane[C], plane[T]) == (channel, timepoint)
                    && let Some(slot) = found.get_mut(plane[Z])
                {
                    let file = if is_here(block) { None } else { block.file.clone().or_else(|| block.uuid.clone()) };
                    *slot = Some(Page { file, number: block.page.unwrap_or(0) + k });
                }
            }
        }
        let missing = found.iter().position(Option::is_none);
        missing.map_or(Ok(found.into_iter().flatten().collect()), |z| {
            let remedy = "write the file anew, for example: bfconvert SET.ome.tif ONE.ome.tif";
            let found = format!("section {z} of channel {channel} and time point {timepoint} on no page");
            Err(Error::format("OME-TIFF", found, "all sections on pages", remedy))
        })
    }
}

impl TiffData {
    fn new(attributes: Attributes<'_>) -> Result<Self> {
        let number = |name: &str| {
            let number: Option<usize> = attributes.number(name, damaged)?;
            match number {
                Some(n) if n > MOST_PLANES => Err(damaged(format!("{name}=\"{n}\""))),
                n => Ok(n),
            }
        };
        let first = [number("FirstZ")?, number("FirstC")?, number("FirstT")?].map(Option::unwrap_or_default);
        Ok(Self { page: number("IFD")?, first, count: number("PlaneCount")?, ..Self::default() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ome(pixels: &str, inside: &str) -> Result<Layout> {
        let text = format!("<OME UUID='urn:a'><Image><Pixels {pixels}>{inside}</Pixels></Image></OME>");
        let choice = Choice { channel: Some("1".parse()?), timepoint: Some(1), ..Choice::default() };
        Ome::parse(&text)?.layout(&choice)
    }

    fn sizes(order: &str) -> String {
        format!("SizeX='1' SizeY='1' SizeZ='3' SizeC='2' SizeT='2' DimensionOrder='{order}'")
    }

    #[test]
    fn pages_follow_the_order_of_dimensions() {
        // Page of section z in channel 1 at time 1, from the definition: z, c, t with sizes 3, 2, 2.
        let cases: [(&str, [usize; 3]); 6] = [
            ("XYZCT", [9, 10, 11]),
            ("XYZTC", [9, 10, 11]),
            ("XYCTZ", [3, 7, 11]),
            ("XYCZT", [7, 9, 11]),
            ("XYTCZ", [3, 7, 11]),
            ("XYTZC", [7, 9, 11]),
        ];
        let numbers = |layout: Layout| layout.pages.unwrap().iter().map(|p| p.number).collect::<Vec<_>>();
        for (order, pages) in cases {
            for inside in ["", "<TiffData/>", "<TiffData IFD='0' PlaneCount='12'/>"] {
                assert_eq!(numbers(ome(&sizes(order), inside).unwrap()), pages, "{order} {inside}");
            }
        }
    }

    #[test]
    fn tiff_data_has_the_last_word() {
        let scattered = "<TiffData FirstZ='0' FirstC='1' FirstT='1' IFD='5'/><TiffData FirstZ='2' FirstC='1' \
                         FirstT='1' IFD='0'/><TiffData FirstZ='1' FirstC='1' FirstT='1' IFD='9' PlaneCount='1'/>";
        let pages = |inside: &str| {
            let pages = ome(&sizes("XYZCT"), inside).unwrap().pages.unwrap();
            pages.into_iter().map(|p| (p.file.unwrap_or_default(), p.number)).collect::<Vec<_>>()
        };
        let here = |numbers: [usize; 3]| numbers.map(|n| (String::new(), n)).to_vec();
        assert_eq!(pages(scattered), here([5, 9, 0]));
        let own = "<TiffData IFD='0' PlaneCount='12'><UUID FileName='old name.tif'>urn:a</UUID></TiffData>";
        assert_eq!(pages(own), here([9, 10, 11]));
        let other = "<TiffData IFD='0' PlaneCount='12'><UUID FileName='b.tif'>urn:b</UUID></TiffData>";
        assert_eq!(pages(other), [9, 10, 11].map(|n| ("b.tif".to_string(), n)));
        let some = "<TiffData IFD='0' PlaneCount='10'/>";
        let text = ome(&sizes("XYZCT"), some).err().unwrap().to_string();
        assert!(text.contains("section 1 of channel 1") && text.contains("bfconvert"), "{text}");
    }

    #[test]
    fn physical_sizes_have_their_units() {
        let place = |physical: &str| {
            let layout = ome(&format!("{} {physical}", sizes("XYZCT")), "").unwrap();
            (layout.spacing.to_array(), layout.unit)
        };
        let x = "PhysicalSizeX='0.5' PhysicalSizeY='0.5' PhysicalSizeZ=";
        assert_eq!(place(&format!("{x}'2'")), ([0.5, 0.5, 2.0], LengthUnit::Metres(1e-6)));
        let nanometres = format!("{x}'500' PhysicalSizeZUnit='nm'");
        assert!((place(&nanometres).0[2] - 0.5).abs() < 1e-12, "{:?}", place(&nanometres));
        let pixels = ["X", "Y", "Z"].map(|a| format!("PhysicalSize{a}Unit='pixel'")).join(" ");
        assert_eq!(place(&format!("{x}'2' {pixels}")), ([0.5, 0.5, 2.0], LengthUnit::Unknown));
        assert_eq!(place(""), ([1.0; 3], LengthUnit::Unknown));
    }

    #[test]
    fn numbers_beyond_any_file_are_refused() {
        for bad in [
            "SizeZ='99999999999' SizeC='1' SizeT='1' DimensionOrder='XYZCT'",
            "SizeZ='-1' SizeC='1' SizeT='1' DimensionOrder='XYZCT'",
            "SizeZ='5000' SizeC='5000' SizeT='5000' DimensionOrder='XYZCT'",
            "SizeZ='0' SizeC='1' SizeT='1' DimensionOrder='XYZCT'",
            "SizeZ='1' SizeC='1' SizeT='1' DimensionOrder='YXZCT'",
            "SizeZ='1'",
        ] {
            assert!(ome(bad, "").is_err(), "{bad}");
        }
        assert!(ome(&sizes("XYZCT"), "<TiffData IFD='99999999999'/>").is_err());
        assert!(Ome::parse("<OME/>").is_err());
    }
}
