//! Where the files of a store live: a directory, or a zip of one. Keys are paths below the root
//! with `/` between their parts. Knows nothing of Zarr and of transfer.
//!
//! A file of a store is never written in place: its successor is written beside it and renamed over it, so that maps stay
//! valid ([`crate::file::map`]).

use super::archive::Archive;
use super::zarr::FORMAT;
use crate::error::{Error, Result};
use crate::file::{MAP_ABOVE, map};
use crate::staging::{self, PARTIAL};
use memmap2::Mmap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Read, Write};
use std::ops::{Deref, Range};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tempfile::NamedTempFile;

/// Longest metadata file that is read.
const LONGEST_TEXT: usize = 64 << 20;

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

/// Reads `length` bytes into aligned memory.
pub(super) fn copy(mut source: impl Read, length: usize) -> io::Result<Bytes> {
    let mut words = vec![0u32; length.div_ceil(4)];
    source.read_exact(&mut bytemuck::cast_slice_mut(&mut words)[..length])?;
    Ok(Bytes::Copy(words, length))
}

/// The files of a store.
#[derive(Debug)]
pub(super) enum Backing {
    /// A directory.
    Directory(Directory),
    /// A zip archive in which every entry is stored without compression.
    Archive(Archive),
}

/// The directory of a store, as it was when the store was opened.
#[derive(Debug)]
pub(super) struct Directory {
    path: PathBuf,
    /// Whether long files are mapped; else they are read.
    maps: bool,
    /// Whether files of samples are, which the store names and others may write.
    maps_samples: bool,
    // Held open, so that the system gives its number to no other directory.
    #[cfg(unix)]
    handle: File,
}

impl Directory {
    /// Opens the directory at `path`.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn open(path: &Path) -> Result<Self> {
        #[cfg(unix)]
        let handle = File::open(path).map_err(|e| Error::io(path, "open the store", e))?;
        Ok(Self {
            path: path.into(),
            maps: true,
            maps_samples: false,
            #[cfg(unix)]
            handle,
        })
    }

    /// The same directory, whose files are read and never mapped.
    pub fn unmapped(self) -> Self {
        Self { maps: false, ..self }
    }

    /// Another handle of the same directory.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn again(&self) -> Result<Self> {
        Ok(Self { maps: self.maps, maps_samples: self.maps_samples, ..Self::open(&self.path)? })
    }

    /// Where it was when it was opened.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the path still leads to the directory that was opened.
    ///
    /// # Errors
    /// When it was moved, removed or replaced: what is written now would go into another store.
    pub fn check(&self) -> Result<()> {
        #[cfg(unix)]
        {
            use std::os::unix::fs::MetadataExt;
            let number = |m: fs::Metadata| (m.dev(), m.ino());
            let opened = self.handle.metadata().map(number).ok();
            if opened.is_none() || fs::metadata(&self.path).map(number).ok() != opened {
                let text = "it was moved, removed or replaced since it was opened; nothing more is written. What was \
                            written before is where the store is now";
                return Err(Error::io(&self.path, "write into the store", io::Error::other(text)));
            }
        }
        Ok(())
    }
}

impl Backing {
    /// Opens a directory, or a file that is a zip archive.
    ///
    /// # Errors
    /// When there is neither at `path`, or the archive is damaged or compressed.
    pub fn open(path: &Path) -> Result<Self> {
        let kind = fs::metadata(path).map_err(|e| Error::io(path, "open the store", e))?;
        if kind.is_dir() { Directory::open(path).map(Self::Directory) } else { Archive::open(path).map(Self::Archive) }
    }

    /// Another handle of the same directory or archive.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn again(&self) -> Result<Self> {
        match self {
            Self::Directory(directory) => directory.again().map(Self::Directory),
            Self::Archive(archive) => archive.again().map(Self::Archive),
        }
    }

    /// The path of the directory or archive.
    pub fn path(&self) -> &Path {
        match self {
            Self::Directory(directory) => directory.path(),
            Self::Archive(archive) => &archive.path,
        }
    }

    /// What messages call the file of a key.
    pub fn name(&self, key: &str) -> PathBuf {
        if key.is_empty() { self.path().into() } else { self.path().join(key) }
    }

    /// Whether files of samples that the store names are mapped.
    pub fn maps_samples(&self) -> bool {
        match self {
            Self::Directory(directory) => directory.maps_samples,
            Self::Archive(archive) => archive.maps_samples,
        }
    }

    /// Maps files of samples that the store names, or reads them.
    pub fn map_samples(&mut self, maps: bool) {
        match self {
            Self::Directory(directory) => directory.maps_samples = maps,
            Self::Archive(archive) => archive.maps_samples = maps,
        }
    }

    /// Whether there is a file for a key.
    pub fn exists(&self, key: &str) -> bool {
        match self {
            Self::Directory(root) => root.path.join(key).is_file(),
            Self::Archive(archive) => archive.entries.contains_key(key),
        }
    }

    /// The names of the folders in a folder, ascending; none where there is no such folder. Hidden ones are left out.
    pub fn folders(&self, folder: &str) -> Vec<String> {
        let mut names: Vec<String> = match self {
            Self::Directory(root) => {
                let entries = fs::read_dir(root.path.join(folder)).into_iter().flatten().flatten();
                let folders = entries.filter(|entry| entry.path().is_dir());
                folders.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect()
            }
            Self::Archive(archive) => {
                let inside =
                    |key: &String| Some(key.strip_prefix(folder)?.strip_prefix('/')?.split_once('/')?.0.to_owned());
                archive.entries.keys().filter_map(inside).collect()
            }
        };
        names.retain(|name| !name.starts_with('.'));
        names.sort_unstable();
        names.dedup();
        names
    }

    /// The keys of all files, ascending; hidden ones are left out.
    ///
    /// # Errors
    /// When the system refuses to list a folder.
    pub fn keys(&self) -> Result<Vec<String>> {
        match self {
            Self::Directory(root) => {
                let mut keys = Vec::new();
                super::archive::list(&root.path, "", &mut keys)?;
                keys.sort();
                Ok(keys)
            }
            Self::Archive(archive) => Ok(archive.entries.keys().cloned().collect()),
        }
    }

    /// Length of the file of a key.
    pub fn length(&self, key: &str) -> Option<u64> {
        match self {
            Self::Directory(root) => {
                fs::metadata(root.path.join(key)).ok().filter(fs::Metadata::is_file).map(|m| m.len())
            }
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
                let path = root.path.join(key);
                match open_plain(&path).and_then(|file| file_bytes(&file, root.maps)) {
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
        root.check()?;
        let target = root.path.join(key);
        let failed = |e| Error::io(&target, "write", e);
        let parent = target.parent().unwrap_or(&root.path);
        staging::make_directories(parent, sync).map_err(failed)?;
        let name = target.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let prefix = format!("{PARTIAL}{name}-");
        sweep(parent, &prefix);
        let mut file = staging::file_in(parent, &prefix, "").map_err(failed)?;
        // The file itself: errors of the wrapper would name the temporary path beside ours.
        let mut out = BufWriter::with_capacity(64 << 10, file.as_file_mut());
        write(&mut out).and_then(|()| out.flush()).map_err(failed)?;
        drop(out);
        if sync {
            file.as_file().sync_data().map_err(failed)?;
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

/// Opens a file for reading; what is no plain file (a pipe, a device) is an error and never waited for.
fn open_plain(path: &Path) -> io::Result<File> {
    if !fs::metadata(path)?.is_file() {
        return Err(io::Error::other("it is not a plain file"));
    }
    File::open(path)
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

/// The bytes of an open file, mapped where that is allowed and pays.
pub(super) fn file_bytes(file: &File, maps: bool) -> io::Result<Bytes> {
    let kind = file.metadata()?;
    if !kind.is_file() {
        return Err(io::Error::other("it is a directory, not a file"));
    }
    if maps && kind.len() > MAP_ABOVE {
        match map(file, 0, usize::try_from(kind.len()).map_err(io::Error::other)?) {
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
    /// Renames the file to its place, over the one that may be there; the disk has it afterwards if `sync` was asked for.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn commit(self) -> Result<()> {
        let Self { file, target, sync } = self;
        file.persist(&target).map_err(|e| Error::io(&target, "put into its place", e.error))?;
        if sync && let Some(parent) = target.parent() {
            staging::sync_directory(parent).map_err(|e| Error::io(parent, "synchronise", e))?;
        }
        Ok(())
    }
}
