//! A store in a zip archive without compression: read in place, and packed from a directory. Knows nothing of Zarr and of
//! transfer.

use super::backing::{Bytes, copy, file_bytes};
use super::zarr::FORMAT;
use crate::error::{Error, Result};
use crate::staging;
use memmap2::Mmap;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Cursor, Read, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Starts of the entries of archives that [`pack`] makes are multiples of this: enough for every
/// type a store holds, and a cache line.
const ALIGNMENT: u16 = 64;

/// A mapped zip archive.
#[derive(Debug)]
pub(super) struct Archive {
    pub path: PathBuf,
    map: Arc<Mmap>,
    // Invariant: ranges lie inside `map`.
    pub entries: BTreeMap<String, Range<usize>>,
    /// Whether files of samples that the store names are mapped.
    pub maps_samples: bool,
}

impl Archive {
    /// Maps the archive at `path`.
    ///
    /// # Errors
    /// When it is no zip archive, is damaged, or holds compressed entries.
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|e| Error::io(path, "open the store", e))?;
        let mut magic = [0; 4];
        let known = (&file).read_exact(&mut magic).is_ok() && magic == *b"PK\x03\x04";
        if !known {
            let expected = "the directory of a store, or a zip archive of one";
            return Err(
                Error::format(FORMAT, "a file of another kind", expected, "give the path of a store").in_file(path)
            );
        }
        let failed = |e| Error::io(path, "map the archive", e);
        let length = file.metadata().map_err(failed)?.len();
        let length = usize::try_from(length).map_err(|e| failed(io::Error::other(e)))?;
        let map = crate::file::map(&file, 0, length).map_err(failed)?;
        let entries = entries(&map).map_err(|e| e.in_file(path))?;
        Ok(Self { path: path.into(), map: Arc::new(map), entries, maps_samples: false })
    }

    /// Another map of the same archive.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn again(&self) -> Result<Self> {
        Ok(Self { maps_samples: self.maps_samples, ..Self::open(&self.path)? })
    }

    /// The bytes of a key; `None` if there is no such entry.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn bytes(&self, key: &str) -> Result<Option<Bytes>> {
        let Some(range) = self.entries.get(key) else { return Ok(None) };
        let part = &self.map[range.clone()];
        if (part.as_ptr() as usize).is_multiple_of(4) {
            return Ok(Some(Bytes::Part(self.map.clone(), range.clone())));
        }
        copy(part, part.len()).map(Some).map_err(|e| Error::io(self.path.join(key), "copy", e))
    }
}

/// Entries of an archive by key. `zip -r x.zip X.isolume` puts the directory's name before
/// every key; a first part that all entries share is taken off.
fn entries(archive: &[u8]) -> Result<BTreeMap<String, Range<usize>>> {
    let damaged =
        |found: String| Error::format("zip archive", found, "a complete zip archive", "copy or pack the archive again");
    let mut zip = zip::ZipArchive::new(Cursor::new(archive)).map_err(|e| damaged(e.to_string()))?;
    let mut entries = BTreeMap::new();
    for i in 0..zip.len() {
        let file = zip.by_index_raw(i).map_err(|e| damaged(e.to_string()))?;
        // A damaged name would make a chunk look as if it had never been baked. Every name stands
        // twice in an archive, and nothing else protects it.
        let name = file.name_raw();
        let header = usize::try_from(file.header_start()).ok().and_then(|start| archive.get(start..)).unwrap_or(&[]);
        let length = header.get(26..28).map(|n| usize::from(n[0]) | usize::from(n[1]) << 8);
        if length != Some(name.len()) || header.get(30..30 + name.len()) != Some(name) {
            return Err(damaged(format!("entry {} with another name at its data", file.name())));
        }
        if file.is_dir() {
            continue;
        }
        if file.compression() != zip::CompressionMethod::Stored || file.encrypted() {
            return Err(Error::format(
                "zip archive",
                format!("compressed or encrypted entry {}", file.name()),
                "entries stored as they are, so that they can be mapped",
                "pack the directory again with: zip -0 -r",
            ));
        }
        let range = file.data_start().and_then(|start| {
            let start = usize::try_from(start).ok()?;
            let end = start.checked_add(usize::try_from(file.size()).ok()?)?;
            (end <= archive.len()).then_some(start..end)
        });
        let Some(range) = range else { return Err(damaged(format!("entry {} beyond the end", file.name()))) };
        entries.insert(file.name().to_owned(), range);
    }
    let top = entries.keys().next().and_then(|key| key.split_once('/')).map(|(top, _)| format!("{top}/"));
    if let Some(top) = top
        && entries.keys().all(|key| key.starts_with(&top))
    {
        entries = entries.into_iter().map(|(key, range)| (key[top.len()..].to_owned(), range)).collect();
    }
    Ok(entries)
}

/// Packs the files of a directory into a zip archive, without compression, in the order of their
/// keys, aligned, and with a fixed date, so that equal stores give equal archives. Hidden files
/// (locks, leftovers) stay out.
///
/// # Errors
/// When a file cannot be read or the archive cannot be written.
pub(super) fn pack(directory: &Path, out: &Path) -> Result<()> {
    let mut keys = Vec::new();
    list(directory, "", &mut keys)?;
    keys.sort();
    let failed = |e: io::Error| Error::io(out, "write the archive", e);
    let folder = staging::folder_of(out);
    let mut file = staging::file_in(folder, staging::PARTIAL, "").map_err(failed)?;
    staging::sweep(folder, file.path());
    let mut zip = zip::ZipWriter::new(BufWriter::with_capacity(1 << 20, file.as_file_mut()));
    let options = zip::write::SimpleFileOptions::default()
        .compression_method(zip::CompressionMethod::Stored)
        .last_modified_time(zip::DateTime::default())
        .unix_permissions(0o644)
        .with_alignment(ALIGNMENT);
    for key in keys {
        let path = directory.join(&key);
        let bytes = File::open(&path).and_then(|f| file_bytes(&f, true)).map_err(|e| Error::io(&path, "read", e))?;
        let options = options.large_file(bytes.len() > u32::MAX as usize);
        zip.start_file(key, options).map_err(|e| failed(e.into()))?;
        zip.write_all(&bytes).map_err(failed)?;
    }
    let mut rest = zip.finish().map_err(|e| failed(e.into()))?;
    rest.flush().map_err(failed)?;
    drop(rest);
    file.as_file().sync_data().map_err(failed)?;
    file.persist_noclobber(out).map_err(|e| failed(e.error))?;
    staging::sync_directory(folder).map_err(failed)
}

/// Adds the keys of the files of a directory; hidden ones stay out.
pub(super) fn list(directory: &Path, prefix: &str, keys: &mut Vec<String>) -> Result<()> {
    let failed = |e| Error::io(directory, "list", e);
    for entry in fs::read_dir(directory).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.starts_with('.') {
            continue;
        }
        let key = format!("{prefix}{name}");
        if entry.file_type().map_err(failed)?.is_dir() {
            list(&entry.path(), &format!("{key}/"), keys)?;
        } else {
            keys.push(key);
        }
    }
    Ok(())
}
