//! A folder with one picture for each section of a volume: TIFF or PNG, grey, of one size and type, ordered by the
//! number in their names (2 before 10), the first at z = 0.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]

use super::assemble::{Parts, assemble, mix, note};
use super::decode::{Data, checked_count};
use super::format::tiff;
use super::read::ReadHint;
use super::{LengthUnit, Volume, foreign};
use crate::error::{Error, Result};
use crate::file;
use crate::geom::Affine;
use glam::{DMat3, DVec3};
use std::io::{BufReader, Read};
use std::path::Path;

const NAME: &str = "folder of slices";
/// Most entries of a folder.
const MOST_FILES: usize = 1 << 20;

/// Whether there are slices in a folder.
pub(super) fn is_folder(folder: &Path) -> bool {
    names(folder).is_ok_and(|names| names.iter().any(|name| kind(name).is_some() && !name.starts_with('.')))
}

/// Reads the folder.
///
/// # Errors
/// When it holds no slices, a number between two is missing, or they differ in size or type; of a slice its own.
pub(super) fn open(folder: &Path, hint: &ReadHint) -> Result<Volume> {
    let in_folder = |e: Error| e.in_file(folder);
    let names = names(folder)?;
    let is_slice = |name: &String| kind(name).is_some() && !name.starts_with('.');
    let (slices, others): (Vec<String>, Vec<String>) = names.into_iter().partition(is_slice);
    if slices.is_empty() {
        return Err(in_folder(foreign::folder(&others)));
    }
    let numbered = ordered(slices, hint.choice.allow_gaps).map_err(in_folder)?;
    let slices: Vec<&String> = numbered.iter().map(|(_, name)| name).collect();
    let mut notes = Vec::new();
    let series = hint.choice.of(NAME, Vec::new(), 1, &mut notes)?;
    let (mut stack, mut size, mut said, mut sections) = (None, None, None, 0u64);
    let mut before: Option<(u64, Data)> = None;
    for (z, name) in slices.iter().enumerate() {
        let path = folder.join(name);
        let in_slice = |e: Error| e.in_file(&path);
        let slice = read_slice(&path, hint).map_err(in_slice)?;
        let (width, height) = *size.get_or_insert(slice.size);
        if slice.size != (width, height) {
            let found = format!("{} × {} pixels", slice.size.0, slice.size.1);
            let expected = format!("{width} × {height}, as {}", slices[0]);
            return Err(in_slice(Error::format(NAME, found, expected, "take out or resize what does not belong")));
        }
        let number = numbered.get(z).map_or(0, |(number, _)| *number);
        let missing = before.as_ref().map_or(0, |(last, _)| number.saturating_sub(last.saturating_add(1)));
        sections = missing.saturating_add(1).saturating_add(sections);
        let claimed = [u64::from(width), u64::from(height), sections];
        checked_count(NAME, claimed, 1, None, hint).map_err(in_folder)?;
        if let Some((_, data)) = before.as_ref().filter(|_| missing > 0) {
            for i in 1..=missing {
                let t = i as f64 / (missing + 1) as f64;
                tiff::append(&mut stack, mix(data, &slice.data, 1.0 - t, t)).map_err(in_slice)?;
            }
            let text = format!("{missing} missing slices before {name} are interpolated between their neighbours");
            notes.push(note(text, missing as usize));
        }
        if hint.choice.allow_gaps {
            before = Some((number, slice.data.clone()));
        }
        tiff::append(&mut stack, slice.data).map_err(in_slice)?;
        said = said.or(slice.spacing);
    }
    let (Some(data), Some((width, height))) = (stack, size) else { return Err(in_folder(foreign::folder(&others))) };
    let (spacing, unit) = said.unwrap_or((DVec3::ONE, LengthUnit::Unknown));
    notes.push(note(format!("{} slices, {} to {}", slices.len(), slices[0], slices[slices.len() - 1]), slices.len()));
    if !others.is_empty() {
        let some: Vec<&str> = others.iter().take(5).map(String::as_str).collect();
        let dots = if others.len() > some.len() { ", …" } else { "" };
        notes.push(note(format!("{} other files are ignored: {}{dots}", others.len(), some.join(", ")), others.len()));
    }
    if hint.choice.spacing.is_none() {
        let from = if said.is_some() { "read from the first slice" } else { "a guess" };
        notes.push(note(
            format!("the spacing {} × {} × {} is {from}: see --spacing", spacing.x, spacing.y, spacing.z),
            1,
        ));
    }
    let world_from_grid = Affine::new(DMat3::from_diagonal(spacing), DVec3::ZERO).unwrap_or(Affine::IDENTITY);
    let dims = [width as usize, height as usize, sections as usize];
    let (slope, inter) = (1.0, 0.0);
    let name = folder.canonicalize().ok().and_then(|p| p.file_name().map(|n| n.to_string_lossy().into_owned()));
    let hint = ReadHint { name: name.unwrap_or_else(|| hint.name.clone()), ..hint.clone() };
    let parts = Parts { format: NAME, dims, data, slope, inter, world_from_grid, unit, series, notes };
    assemble(parts, &hint).map_err(in_folder)
}

/// Names of the plain files in a folder, sorted.
fn names(folder: &Path) -> Result<Vec<String>> {
    let refuse = |e| Error::io(folder, "list the folder", e);
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(refuse)? {
        names.push(entry.map_err(refuse)?.file_name().to_string_lossy().into_owned());
        if names.len() > MOST_FILES {
            return Err(Error::Limit {
                what: format!("the folder {}", folder.display()),
                needed: format!("more than {MOST_FILES} files"),
                limit: format!("{MOST_FILES} files"),
                remedy: "put the slices into a folder of their own".into(),
            });
        }
    }
    names.sort();
    Ok(names)
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Tiff,
    Png,
}

fn kind(name: &str) -> Option<Kind> {
    let (_, ending) = name.rsplit_once('.')?;
    match ending.to_ascii_lowercase().as_str() {
        "tif" | "tiff" => Some(Kind::Tiff),
        "png" => Some(Kind::Png),
        _ => None,
    }
}

/// A name as text and numbers in turn.
fn pieces(name: &str) -> (Vec<&str>, Vec<&str>) {
    let (mut text, mut numbers, mut rest) = (Vec::new(), Vec::new(), name);
    loop {
        let start = rest.find(|c: char| c.is_ascii_digit()).unwrap_or(rest.len());
        text.push(&rest[..start]);
        let digits = &rest[start..];
        if digits.is_empty() {
            return (text, numbers);
        }
        let end = digits.find(|c: char| !c.is_ascii_digit()).unwrap_or(digits.len());
        numbers.push(&digits[..end]);
        rest = &digits[end..];
    }
}

/// The slices in the order of the one number in which their names differ.
///
/// # Errors
/// When they differ in something else, twice have the same number, or one is missing between two others.
fn ordered(names: Vec<String>, allows_gaps: bool) -> Result<Vec<(u64, String)>> {
    let refuse = |found: String, expected: &str, remedy: &str| Err(Error::format(NAME, found, expected, remedy));
    let n = names.len();
    if n < 2 {
        let found = format!("one slice, {}", names.concat());
        return refuse(found, "at least two", "a stack in one file: name the file itself");
    }
    let expected = "names that differ in one number, such as slice_001.tif";
    let (text, first) = pieces(&names[0]);
    let mut differs = vec![false; first.len()];
    for name in &names {
        let (own, numbers) = pieces(name);
        if own != text || kind(name) != kind(&names[0]) {
            let remedy = "keep the slices of one volume in a folder of their own";
            return refuse(format!("a folder of {n} slices, {} and {name} among them", names[0]), expected, remedy);
        }
        numbers.iter().zip(&first).zip(&mut differs).for_each(|((a, b), differs)| *differs |= a != b);
    }
    let varying: Vec<usize> = (0..differs.len()).filter(|&i| differs[i]).collect();
    let &[place] = varying.as_slice() else {
        let last = names.last().map_or("", String::as_str);
        let found = format!("a folder of {n} slices from {} to {last}, with {} numbers", names[0], varying.len());
        return refuse(found, expected, "several channels or times: put each into a folder of its own");
    };
    let number = |name: &str| pieces(name).1.get(place).and_then(|digits| digits.parse::<u64>().ok());
    let mut numbered = Vec::new();
    for name in names {
        match number(&name) {
            Some(at) => numbered.push((at, name)),
            None => return refuse(format!("the number in {name}"), "a number below 2^64", "rename the slices"),
        }
    }
    numbered.sort();
    for pair in numbered.windows(2) {
        let [(a, before), (b, after)] = pair else { continue };
        if a == b {
            return refuse(format!("{before} and {after} with one number"), "each number once", "take one out");
        }
        if *b != a + 1 && !allows_gaps {
            let found = format!("no slice between {before} and {after}, {} missing", b - a - 1);
            return refuse(found, "slices without gaps", "add what is missing, number them anew, or give --allow-gaps");
        }
    }
    Ok(numbered)
}

fn read_slice(path: &Path, hint: &ReadHint) -> Result<tiff::Slice> {
    let (source, length) = file::open(path)?;
    match kind(&path.to_string_lossy()) {
        Some(Kind::Png) => read_png(source, length, hint),
        _ => tiff::read_slice(BufReader::new(source), length, hint),
    }
}

/// A grey PNG of 1 to 16 bits.
fn read_png(source: impl Read, length: u64, hint: &ReadHint) -> Result<tiff::Slice> {
    const PNG: &str = "PNG";
    let refuse = |e: png::DecodingError| {
        let remedy = "the file is incomplete or damaged; copy it again";
        Error::format(PNG, e.to_string(), "a picture that can be read", remedy)
    };
    let mut bytes = Vec::new();
    source.take(length).read_to_end(&mut bytes).map_err(|e| Error::from_read(PNG, "a picture", e))?;
    let mut decoder = png::Decoder::new_with_limits(
        std::io::Cursor::new(bytes),
        png::Limits { bytes: usize::try_from(hint.max_bytes).unwrap_or(usize::MAX).min(1 << 30) },
    );
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(refuse)?;
    let (width, height) = reader.info().size();
    let (colour, depth) = reader.output_color_type();
    if colour != png::ColorType::Grayscale {
        let remedy = "convert the slices to grey: magick mogrify -colorspace gray *.png";
        return Err(Error::format(PNG, format!("a picture of type {colour:?}"), "a grey picture", remedy));
    }
    let size = if depth == png::BitDepth::Sixteen { 2 } else { 1 };
    // Deflate expands by less than 1032.
    let most = length.saturating_mul(1032).saturating_add(1 << 16);
    let count = checked_count(PNG, [u64::from(width), u64::from(height), 1], size, Some(most), hint)?;
    let mut samples = vec![0; count * size];
    reader.next_frame(&mut samples).map_err(refuse)?;
    let data = match size {
        2 => Data::U16(samples.as_chunks::<2>().0.iter().map(|b| u16::from_be_bytes(*b)).collect()),
        _ => Data::U8(samples),
    };
    Ok(tiff::Slice { size: (width, height), data, spacing: None })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn order(names: &[&str]) -> std::result::Result<Vec<String>, String> {
        let all = ordered(names.iter().map(|n| n.to_string()).collect(), false);
        all.map(|all| all.into_iter().map(|(_, name)| name).collect::<Vec<_>>()).map_err(|e| e.to_string())
    }

    #[test]
    fn slices_are_ordered_by_number_and_gaps_are_refused() {
        assert_eq!(order(&["s10.tif", "s8.tif", "s9.tif"]).unwrap(), ["s8.tif", "s9.tif", "s10.tif"]);
        let fixed = order(&["scan2_01_x.png", "scan2_02_x.png"]).unwrap();
        assert_eq!(fixed, ["scan2_01_x.png", "scan2_02_x.png"]);
        for (names, said) in [
            (&["s1.tif", "s2.tif", "s5.tif"][..], "2 missing"),
            (&["s1.tif", "s01.tif", "s2.tif"], "one number"),
            (&["c1z1.tif", "c1z2.tif", "c2z1.tif"], "2 numbers"),
            (&["s1.tif", "s2.png"], "one number"),
            (&["s1.tif", "t2.tif"], "differ in one number"),
            (&["s1.tif"], "at least two"),
            (&["a.tif", "b.tif"], "differ in one number"),
            (&["s1.tif", "s99999999999999999999999.tif"], "2^64"),
        ] {
            let text = order(names).unwrap_err();
            assert!(text.contains(said), "{names:?}: {text}");
        }
    }

    fn grey(path: &Path, depth: png::BitDepth, samples: &[u8]) {
        let mut encoder = png::Encoder::new(std::fs::File::create(path).unwrap(), 2, 2);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(depth);
        encoder.write_header().unwrap().write_image_data(samples).unwrap();
    }

    #[test]
    fn pictures_become_sections() {
        let folder = tempfile::tempdir().unwrap();
        for z in 0..3u8 {
            grey(&folder.path().join(format!("s{}.png", 9 + z)), png::BitDepth::Sixteen, &[z, 0, z, 1, z, 2, z, 3]);
        }
        std::fs::write(folder.path().join("Thumbs.db"), "x").unwrap();
        let hint = ReadHint {
            choice: super::super::Choice { spacing: Some("1,1,2mm".parse().unwrap()), ..Default::default() },
            ..ReadHint::default()
        };
        let volume = open(folder.path(), &hint).unwrap();
        assert_eq!(volume.dims(), [2, 2, 3]);
        assert_eq!(volume.unit, LengthUnit::Metres(1e-3));
        assert_eq!(volume.world_from_grid().spacing(), DVec3::new(1.0, 1.0, 2.0));
        let values: Vec<f32> = (0..12).map(|i| volume.samples().raw(i)).collect();
        assert_eq!(values, [0, 1, 2, 3, 256, 257, 258, 259, 512, 513, 514, 515].map(|v| v as f32));
        assert!(volume.notes.iter().any(|n| n.text.contains("Thumbs.db")));
        // Another type among them, another size, a damaged one.
        grey(&folder.path().join("s12.png"), png::BitDepth::Eight, &[1, 2, 3, 4]);
        assert!(open(folder.path(), &hint).unwrap_err().to_string().contains("different types"));
        std::fs::write(folder.path().join("s12.png"), b"\x89PNG\r\n\x1a\n").unwrap();
        assert!(open(folder.path(), &hint).unwrap_err().to_string().contains("s12.png"));
    }
}
