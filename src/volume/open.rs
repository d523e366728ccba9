//! The only place of this module that opens files. Data files that a header names (NRRD `data
//! file:`, NIfTI pairs, raw sidecars) are looked up relative to the header.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]

use super::Volume;
use super::format::tiff;
use super::read::{Format, ReadHint, detect, read_with};
use super::source::Source;
use crate::error::{Error, Result};
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

/// Reads the volume in a file; its name becomes the file's stem.
///
/// # Errors
/// As [`super::read::read`], with the file named; the system's errors when it cannot be opened.
pub fn open(path: impl AsRef<Path>) -> Result<Volume> {
    open_with(path, &ReadHint::default())
}

/// [`open`] with a hint; the hint's name and length are taken from the file.
///
/// # Errors
/// As [`open`].
pub fn open_with(path: impl AsRef<Path>, hint: &ReadHint) -> Result<Volume> {
    let path = path.as_ref();
    let (mut file, length) = open_file(path)?;
    let hint = ReadHint { name: stem(path), length, ..hint.clone() };
    // TIFF wants to seek: a plain file can, so that its pages need not be held twice.
    let mut head = [0; 4];
    let is_tiff = length.is_some_and(|n| n >= 8)
        && file.read_exact(&mut head).is_ok()
        && matches!(detect(&head), Ok(Format::Tiff));
    if length.is_some() {
        file.seek(SeekFrom::Start(0)).map_err(|e| Error::io(path, "read", e))?;
    }
    if let (true, Some(length)) = (is_tiff, length) {
        return tiff::read(BufReader::new(file), length, &hint).map_err(|e| e.in_file(path));
    }
    let directory = path.parent().unwrap_or(Path::new(""));
    let beside = |name: &Path| -> Result<Source<'static>> {
        let data = directory.join(name);
        let (file, length) = open_file(&data)?;
        Ok(Source::new(file, length))
    };
    read_with(Source::new(file, length), &hint, Some(&beside)).map_err(|e| e.in_file(path))
}

/// Opens a file; its length where it is a regular one.
fn open_file(path: &Path) -> Result<(File, Option<u64>)> {
    let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
    let metadata = file.metadata().map_err(|e| Error::io(path, "open", e))?;
    if metadata.is_dir() {
        return Err(Error::argument(
            "volume",
            path.display(),
            "a file",
            "this is a directory; name the volume file in it",
        ));
    }
    Ok((file, metadata.is_file().then_some(metadata.len())))
}

/// The file's name without `.gz` and without its suffix.
fn stem(path: &Path) -> String {
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    Path::new(name).file_stem().map_or_else(|| "volume".into(), |s| s.to_string_lossy().into_owned())
}
