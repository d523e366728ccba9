//! Volumes by their path. Data files that a header names (NRRD `data file:`, NIfTI pairs, raw sidecars) lie in the
//! folder of the header or below ([`crate::file::Beside`]), and each gets a note.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]

use super::assemble::note;
use super::choice::Has;
use super::format::{npz, tiff};
use super::read::{Format, ReadHint, detect, read_with};
use super::source::Source;
use super::{Volume, dicom, slices, zarr};
use crate::error::{Error, Result};
use crate::file::{Beside, Plain, open_named};
use std::cell::RefCell;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

/// Bytes that tell the formats that seek from others.
const HEAD: u64 = 512;

/// Reads the volume in a file, or in a folder with one file for each section; its name becomes the file's stem.
///
/// # Errors
/// As [`super::read::read`], with the file named; the system's errors when it cannot be opened; when a file that it
/// names lies outside its folder.
pub fn open(path: impl AsRef<Path>) -> Result<Volume> {
    open_with(path, &ReadHint::default())
}

/// [`open`] with a hint; the hint's name and length are taken from the file.
///
/// # Errors
/// As [`open`].
pub fn open_with(path: impl AsRef<Path>, hint: &ReadHint) -> Result<Volume> {
    let path = path.as_ref();
    if path.is_dir() {
        return folder(path, hint);
    }
    let (mut file, length) = open_named(path)?;
    let hint = ReadHint { name: stem(path), length, ..hint.clone() };
    // TIFF and zip want to seek: a plain file can, so that what they hold need not be held twice.
    let mut head = Vec::new();
    let is_there = length.is_some() && (&mut file).take(HEAD).read_to_end(&mut head).is_ok();
    let seeks = match detect(&head) {
        Ok(format @ (Format::Tiff | Format::Npz | Format::Dicom)) if is_there => Some(format),
        _ => None,
    };
    if length.is_some() {
        file.seek(SeekFrom::Start(0)).map_err(|e| Error::io(path, "read", e))?;
    }
    match (seeks, length) {
        (Some(Format::Tiff), Some(length)) => {
            hint.choice.fits(Has { levels: true, ..Has::default() })?;
            let beside = Beside::new(path, hint.choice.allow_outside);
            return tiff::read(BufReader::new(file), length, &hint, Some(&beside)).map_err(|e| e.in_file(path));
        }
        (Some(Format::Dicom), Some(_)) => {
            hint.choice.fits(Has { scans: true, ..Has::default() })?;
            return dicom::open_file(path, &hint);
        }
        (Some(_), Some(_)) => {
            hint.choice.fits(Has { arrays: true, ..Has::default() })?;
            hint.choice.of("NumPy .npz", Vec::new(), 1, &mut Vec::new())?;
            return npz::read(BufReader::new(file), &hint).map_err(|e| e.in_file(path));
        }
        _ => {}
    }
    let beside = Beside::new(path, hint.choice.allow_outside);
    if length.is_some() && tells_of_tiff(&head) {
        let text = beside.read(path.file_name().map(Path::new).unwrap_or(path), MOST_COMPANION)?;
        if let Some(name) = tiff::file_of_companion(&String::from_utf8_lossy(&text)) {
            let named = name.and_then(|name| beside.path(name)).map_err(|e| e.in_file(path))?;
            return open_with(named, &ReadHint { length: None, ..hint });
        }
    }
    let maps = hint.choice.map;
    let read_too = RefCell::new(Vec::new());
    let open_beside = |name: &Path| -> Result<Source<'static>> {
        let (file, length, path) = beside.open(name)?;
        let source = Source::of_file(Plain::new(file, &path), Some(length), maps);
        read_too.borrow_mut().push(path);
        Ok(source)
    };
    let volume = read_with(Source::of_file(Plain::new(file, path), length, maps), &hint, Some(&open_beside))
        .map_err(|e| e.in_file(path));
    volume.map(|mut volume| {
        volume.notes.extend(read_too.take().iter().map(|p| note(format!("samples were read from {}", p.display()), 1)));
        volume
    })
}

/// Longest file of metadata.
const MOST_COMPANION: u64 = 1 << 28;

/// Whether the first bytes may be those of OME-XML that tells which TIFF files hold an image.
fn tells_of_tiff(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(head);
    let text = text.trim_start_matches('\u{feff}').trim_start();
    (text.starts_with("<?xml") && !text.contains("<VTKFile")) || text.starts_with("<OME")
}

/// Reads what a folder holds: a Zarr hierarchy, or slices.
fn folder(path: &Path, hint: &ReadHint) -> Result<Volume> {
    if zarr::is_zarr(path) {
        return zarr::open(path, hint);
    }
    if !slices::is_folder(path) && dicom::is_folder(path) {
        hint.choice.fits(Has { scans: true, ..Has::default() })?;
        return dicom::open_folder(path, hint);
    }
    hint.choice.fits(Has::default())?;
    slices::open(path, hint)
}

/// The file's name without `.gz` and without its suffix.
pub(super) fn stem(path: &Path) -> String {
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    Path::new(name).file_stem().map_or_else(|| "volume".into(), |s| s.to_string_lossy().into_owned())
}
