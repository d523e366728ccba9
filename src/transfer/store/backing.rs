//! Where the files of a store live: a directory, or a zip of one. Keys are paths below the root
//! with `/` between their parts. Knows nothing of Zarr and of transfer.
//!
//! # Why mapped files stay valid
//! A file of a store is never written in place: its successor is written beside it and renamed
//! over it. A map of the old file keeps the old bytes. (A system that forbids to replace a mapped
//! file, as Windows does, answers a rewrite with an error and leaves the old file.)

use super::zarr::FORMAT;
use crate::error::{Error, Result};
use memmap2::Mmap;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Cursor, Read, Write};
use std::ops::{Deref, Range};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tempfile::NamedTempFile;

/// Files up to this size are read, longer ones mapped: a map costs more than a copy of 64 KiB.
const MAP_ABOVE: u64 = 64 << 10;
/// Longest metadata file that is read.
const LONGEST_TEXT: usize = 64 << 20;
/// How temporary files and directories of a store begin.
pub(super) const PARTIAL: &str = ".partial-";
/// Starts of the entries of archives that [`pack`] makes are multiples of this: enough for every
/// type a store holds, and a cache line.
const ALIGNMENT: u16 = 64;

/// Bytes of a file, aligned to 4 at least.
#[derive(Debug)]
pub(super) enum Bytes {
    /// A map of the file.
    Map(Mmap),
    /// A part of a map that others share; the range lies inside it.
    Part(Arc<Mmap>, Range<usize>),
    /// A copy: as many words as needed, and the length in bytes.
    Copy(Vec<u32>, usize),
}

impl Deref for Bytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match self {
            Self::Map(map) => map,
            Self::Part(map, range) => &map[range.clone()],
            Self::Copy(words, length) => &bytemuck::cast_slice(words)[..*length],
        }
    }
}

/// Maps a file for reading.
///
/// This is the one unsafe function of the store. A map is sound as long as nobody truncates or
/// writes the file in place while it is in use. No code of ours does (see the module's header),
/// and other programs have no business to write inside a store. Should one truncate a mapped
/// file, the system ends the process with SIGBUS; should one change bytes after their checksum
/// was verified, a reader sees other numbers. All mapped bytes are used as plain integers and
/// f16, for which every bit pattern is a value.
#[allow(unsafe_code)]
fn map(file: &File) -> io::Result<Mmap> {
    // SAFETY: as argued above.
    unsafe { Mmap::map(file) }
}

fn copy(mut source: impl Read, length: usize) -> io::Result<Bytes> {
    let mut words = vec![0u32; length.div_ceil(4)];
    source.read_exact(&mut bytemuck::cast_slice_mut(&mut words)[..length])?;
    Ok(Bytes::Copy(words, length))
}

/// The files of a store.
#[derive(Debug)]
pub(super) enum Backing {
    /// A directory.
    Directory(PathBuf),
    /// A zip archive in which every entry is stored without compression.
    Archive(Archive),
}

/// A mapped zip archive.
#[derive(Debug)]
pub(super) struct Archive {
    path: PathBuf,
    map: Arc<Mmap>,
    // Invariant: ranges lie inside `map`.
    entries: BTreeMap<String, Range<usize>>,
}

impl Backing {
    /// Opens a directory, or a file that is a zip archive.
    ///
    /// # Errors
    /// When there is neither at `path`, or the archive is damaged or compressed.
    pub fn open(path: &Path) -> Result<Self> {
        let kind = fs::metadata(path).map_err(|e| Error::io(path, "open the store", e))?;
        if kind.is_dir() { Ok(Self::Directory(path.into())) } else { Archive::open(path).map(Self::Archive) }
    }

    /// The path of the directory or archive.
    pub fn path(&self) -> &Path {
        match self {
            Self::Directory(path) => path,
            Self::Archive(archive) => &archive.path,
        }
    }

    /// What messages call the file of a key.
    pub fn name(&self, key: &str) -> PathBuf {
        if key.is_empty() { self.path().into() } else { self.path().join(key) }
    }

    /// Whether there is a file for a key.
    pub fn exists(&self, key: &str) -> bool {
        match self {
            Self::Directory(root) => root.join(key).is_file(),
            Self::Archive(archive) => archive.entries.contains_key(key),
        }
    }

    /// Length of the file of a key.
    pub fn length(&self, key: &str) -> Option<u64> {
        match self {
            Self::Directory(root) => fs::metadata(root.join(key)).ok().filter(fs::Metadata::is_file).map(|m| m.len()),
            Self::Archive(archive) => archive.entries.get(key).map(|range| range.len() as u64),
        }
    }

    /// The bytes of a key; `None` if there is no such file.
    ///
    /// # Errors
    /// When the file is there and cannot be read.
    pub fn bytes(&self, key: &str) -> Result<Option<Bytes>> {
        match self {
            Self::Directory(root) => {
                let path = root.join(key);
                match File::open(&path).and_then(|file| file_bytes(&file)) {
                    Ok(bytes) => Ok(Some(bytes)),
                    Err(e) if matches!(e.kind(), io::ErrorKind::NotFound | io::ErrorKind::NotADirectory) => Ok(None),
                    Err(e) => Err(Error::io(path, "read", e)),
                }
            }
            Self::Archive(archive) => archive.bytes(key),
        }
    }

    /// The JSON document of a key; `None` if there is no such file.
    ///
    /// # Errors
    /// When it cannot be read, is longer than 64 MiB, or is not JSON.
    pub fn json(&self, key: &str) -> Result<Option<serde_json::Value>> {
        let name = self.name(key);
        if let Some(length) = self.length(key)
            && length > LONGEST_TEXT as u64
        {
            return Err(Error::Limit {
                what: format!("reading {}", name.display()),
                needed: format!("{length} bytes"),
                limit: format!("{LONGEST_TEXT} bytes"),
                remedy: "this is not the metadata of a store".into(),
            });
        }
        let Some(bytes) = self.bytes(key)? else { return Ok(None) };
        serde_json::from_slice(&bytes).map(Some).map_err(|e| {
            Error::format(FORMAT, e.to_string(), "a JSON document", super::zarr::METADATA_REMEDY).in_file(name)
        })
    }

    /// Writes a file beside its final place; [`Staged::commit`] moves it there.
    ///
    /// # Errors
    /// When the store is an archive or the system refuses to write.
    pub fn stage(&self, key: &str, sync: bool, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<Staged> {
        let Self::Directory(root) = self else {
            return Err(Error::argument(
                "store",
                self.path().display(),
                "a directory: a zip archive is only read",
                "unpack it and bake into the directory",
            ));
        };
        let target = root.join(key);
        let failed = |e| Error::io(&target, "write", e);
        let parent = target.parent().unwrap_or(root);
        fs::create_dir_all(parent).map_err(failed)?;
        let name = target.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let prefix = format!("{PARTIAL}{name}-");
        sweep(parent, &prefix);
        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix);
        // Otherwise the file would stay readable for its owner alone. The umask still applies.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let mut file = builder.tempfile_in(parent).map_err(failed)?;
        // The file itself: errors of the wrapper would name the temporary path beside ours.
        let mut out = BufWriter::with_capacity(64 << 10, file.as_file_mut());
        write(&mut out).and_then(|()| out.flush()).map_err(failed)?;
        drop(out);
        if sync {
            file.as_file().sync_all().map_err(failed)?;
        }
        Ok(Staged { file, target, sync })
    }

    /// Writes a file at once.
    ///
    /// # Errors
    /// As [`Self::stage`].
    pub fn put(&self, key: &str, sync: bool, bytes: &[u8]) -> Result<()> {
        self.stage(key, sync, |out| out.write_all(bytes))?.commit()
    }
}

/// Removes what a killed run left of a file that is now written again.
fn sweep(directory: &Path, prefix: &str) {
    // A failure here only leaves the clutter where it is.
    for entry in fs::read_dir(directory).into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with(prefix) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

fn file_bytes(file: &File) -> io::Result<Bytes> {
    let kind = file.metadata()?;
    if !kind.is_file() {
        return Err(io::Error::other("it is a directory, not a file"));
    }
    if kind.len() > MAP_ABOVE {
        match map(file) {
            Ok(map) => return Ok(Bytes::Map(map)),
            // The system bounds the number of maps (65530 on Linux); past it, copies do.
            Err(e) if e.kind() == io::ErrorKind::OutOfMemory => {}
            Err(e) => return Err(e),
        }
    }
    copy(file, usize::try_from(kind.len()).map_err(io::Error::other)?)
}

/// A file that is complete but not yet in its place. Dropped without a commit, it disappears.
#[derive(Debug)]
pub(super) struct Staged {
    file: NamedTempFile,
    target: PathBuf,
    sync: bool,
}

impl Staged {
    /// Renames the file to its place, over the one that may be there.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn commit(self) -> Result<()> {
        let Self { file, target, sync } = self;
        file.persist(&target).map_err(|e| Error::io(&target, "put into its place", e.error))?;
        if sync && let Some(parent) = target.parent() {
            File::open(parent).and_then(|d| d.sync_all()).map_err(|e| Error::io(parent, "synchronise", e))?;
        }
        Ok(())
    }
}

/// A directory under a temporary name beside `path`, to become `path` by a rename.
///
/// # Errors
/// When the system refuses to make it.
pub(super) fn temporary_directory(path: &Path) -> Result<tempfile::TempDir> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(PARTIAL);
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o777));
    builder.tempdir_in(parent_of(path)).map_err(|e| Error::io(path, "create the store", e))
}

/// The directory that holds `path`.
fn parent_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

impl Archive {
    fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(|e| Error::io(path, "open the store", e))?;
        let mut magic = [0; 4];
        let known = (&file).read_exact(&mut magic).is_ok() && magic == *b"PK\x03\x04";
        if !known {
            let expected = "the directory of a store, or a zip archive of one";
            return Err(
                Error::format(FORMAT, "a file of another kind", expected, "give the path of a store").in_file(path)
            );
        }
        let map = map(&file).map_err(|e| Error::io(path, "map the archive", e))?;
        let entries = entries(&map).map_err(|e| e.in_file(path))?;
        Ok(Self { path: path.into(), map: Arc::new(map), entries })
    }

    fn bytes(&self, key: &str) -> Result<Option<Bytes>> {
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
    let mut builder = tempfile::Builder::new();
    builder.prefix(PARTIAL);
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut file = builder.tempfile_in(parent_of(out)).map_err(failed)?;
    let mut zip = zip::ZipWriter::new(BufWriter::with_capacity(1 << 20, file.as_file_mut()));
    let options = zip::write::SimpleFileOptions::default()
        .compression_method(zip::CompressionMethod::Stored)
        .last_modified_time(zip::DateTime::default())
        .unix_permissions(0o644)
        .with_alignment(ALIGNMENT);
    for key in keys {
        let path = directory.join(&key);
        let bytes = File::open(&path).and_then(|f| file_bytes(&f)).map_err(|e| Error::io(&path, "read", e))?;
        let options = options.large_file(bytes.len() > u32::MAX as usize);
        zip.start_file(key, options).map_err(|e| failed(e.into()))?;
        zip.write_all(&bytes).map_err(failed)?;
    }
    let mut rest = zip.finish().map_err(|e| failed(e.into()))?;
    rest.flush().map_err(failed)?;
    drop(rest);
    file.persist_noclobber(out).map_err(|e| failed(e.error))?;
    Ok(())
}

fn list(directory: &Path, prefix: &str, keys: &mut Vec<String>) -> Result<()> {
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
