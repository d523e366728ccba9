//! Opening files for reading, the same way for volumes, meshes and environments: plain files only, and files that
//! other files name only from the folder of the file that names them.
//!
//! A file that came by mail must not make the program read `/etc/passwd` into a store, wait for a pipe for ever, or
//! fill the memory from `/dev/zero`. Knows nothing of formats.

use crate::error::{Error, Result};
use memmap2::{Mmap, MmapOptions};
use std::fs::{File, Metadata};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

/// Most bytes that are read of a file as a whole, 2^36.
pub const MOST_BYTES: u64 = 1 << 36;

/// Files up to this size are read, longer ones mapped: a map costs more than a copy of 64 KiB.
pub(crate) const MAP_ABOVE: u64 = 64 << 10;

/// Opens a plain file; its length in bytes.
///
/// # Errors
/// When it is not there, cannot be opened, or is a directory, a device, a pipe or a socket. None of these is opened.
pub fn open(path: impl AsRef<Path>) -> Result<(File, u64)> {
    let path = path.as_ref();
    // Before it is opened: that alone waits at a pipe, and does things to some devices.
    check_plain(path, &std::fs::metadata(path).map_err(|e| Error::io(path, "open", e))?)?;
    let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
    let metadata = file.metadata().map_err(|e| Error::io(path, "open", e))?;
    check_plain(path, &metadata)?;
    Ok((file, metadata.len()))
}

/// Opens what the user names: a plain file with its length, or a stream that the program was given (`/dev/stdin`,
/// `<(command)` of a shell), which has none.
///
/// # Errors
/// As [`open`].
pub fn open_named(path: impl AsRef<Path>) -> Result<(File, Option<u64>)> {
    let path = path.as_ref();
    let is_plain = std::fs::metadata(path).map_or(true, |metadata| metadata.is_file());
    if !is_plain && is_own_stream(path) {
        let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
        let kind = file.metadata().map_err(|e| Error::io(path, "open", e))?.file_type();
        return if is_pipe(kind) { Ok((file, None)) } else { Err(not_plain(path, kind)) };
    }
    open(path).map(|(file, length)| (file, Some(length)))
}

/// What differs once a file was saved again: when it was changed, and its length. `None` where there is none, as between the steps
/// of an editor that writes a new one.
pub fn stamp(path: impl AsRef<Path>) -> Option<String> {
    let found = std::fs::metadata(path).ok()?;
    Some(format!("{:?} {}", found.modified().ok()?, found.len()))
}

/// All bytes of a plain file.
///
/// # Errors
/// As [`open`]; when it has more than `most` bytes, or more than it had when it was opened.
pub fn read(path: impl AsRef<Path>, most: u64) -> Result<Vec<u8>> {
    let path = path.as_ref();
    let (file, length) = open(path)?;
    let most = most.min(MOST_BYTES);
    let too_long = |needed: String| Error::Limit {
        what: format!("{}: reading it whole", path.display()),
        needed,
        limit: format!("{most} bytes"),
        remedy: "check that this is the right file".into(),
    };
    if length > most {
        return Err(too_long(format!("{length} bytes")));
    }
    let mut bytes = Vec::new();
    file.take(most.saturating_add(1)).read_to_end(&mut bytes).map_err(|e| Error::io(path, "read", e))?;
    if bytes.len() as u64 > most {
        return Err(too_long(format!("more than {most} bytes")));
    }
    Ok(bytes)
}

/// Maps a part of a file for reading.
///
/// This is the one unsafe function for files. A map is sound as long as nobody truncates or writes the file in place while it
/// is in use. No code of ours does: files are written beside their place and renamed over the old one, of which a map keeps
/// the bytes. (A system that forbids to replace a mapped file, as Windows does, answers a rewrite with an error and leaves the
/// old file.) Should another program truncate a mapped file, the system ends the process with SIGBUS; should one change its
/// bytes, a reader sees other numbers: a bake asks for the [`Stamp`] before it writes. All mapped bytes are used as plain
/// integers, f16 and f32, for which every bit pattern is a value. Volumes of users are mapped only where that was asked for.
///
/// # Errors
/// When the system has no room for another map, or forbids it.
#[allow(unsafe_code)]
pub(crate) fn map(file: &File, offset: u64, length: usize) -> io::Result<Mmap> {
    // SAFETY: as argued above.
    unsafe { MmapOptions::new().offset(offset).len(length).map(file) }
}

/// An open plain file and what messages call it.
#[derive(Clone, Debug)]
pub(crate) struct Plain {
    file: Arc<File>,
    path: PathBuf,
}

impl Plain {
    /// A file that was opened at `path`.
    pub(crate) fn new(file: File, path: impl Into<PathBuf>) -> Self {
        Self { file: Arc::new(file), path: path.into() }
    }

    /// Where it was opened.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// What it is now.
    ///
    /// # Errors
    /// When the system does not say.
    pub(crate) fn stamp(&self) -> io::Result<Stamp> {
        self.file.metadata().map(|metadata| Stamp::of(&metadata))
    }

    /// [`map`] of a part that it has; none where it ends before, or the system has no room.
    pub(crate) fn map(&self, offset: u64, length: usize) -> Option<Mmap> {
        let end = offset.checked_add(length as u64)?;
        if self.stamp().ok()?.bytes < end { None } else { map(&self.file, offset, length).ok() }
    }

    /// Goes to a byte of it.
    ///
    /// # Errors
    /// When the system refuses.
    pub(crate) fn go_to(&self, offset: u64) -> io::Result<()> {
        (&*self.file).seek(SeekFrom::Start(offset)).map(drop)
    }
}

impl Read for Plain {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        (&*self.file).read(out)
    }
}

/// What tells without a look at its bytes that a file is still the one it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Stamp {
    /// Its length.
    pub(crate) bytes: u64,
    /// When it was last written: nanoseconds since 1970 on Unix, 100 nanoseconds since 1601 on Windows.
    pub(crate) modified: i64,
}

impl Stamp {
    /// That of a file.
    pub(crate) fn of(metadata: &Metadata) -> Self {
        #[cfg(unix)]
        let modified = {
            use std::os::unix::fs::MetadataExt;
            metadata.mtime().saturating_mul(1_000_000_000).saturating_add(metadata.mtime_nsec())
        };
        #[cfg(windows)]
        let modified = std::os::windows::fs::MetadataExt::last_write_time(metadata) as i64;
        #[cfg(not(any(unix, windows)))]
        let modified = 0;
        Self { bytes: metadata.len(), modified }
    }
}

/// Where files lie that another file names.
#[derive(Clone, Debug)]
pub struct Beside {
    folder: PathBuf,
    allow_outside: bool,
}

impl Beside {
    /// Beside the file at `path`; with `allow_outside` anywhere.
    pub fn new(path: impl AsRef<Path>, allow_outside: bool) -> Self {
        let folder = path.as_ref().parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        Self { folder: folder.to_path_buf(), allow_outside }
    }

    /// The path of a file by the name that another file has for it.
    ///
    /// # Errors
    /// When the name is absolute, climbs out of the folder by `..`, or leads out of it through a link.
    pub fn path(&self, name: impl AsRef<Path>) -> Result<PathBuf> {
        let name = name.as_ref();
        let path = self.folder.join(name);
        if self.allow_outside {
            return Ok(path);
        }
        let climbs = name.components().any(|part| !matches!(part, Component::Normal(_) | Component::CurDir));
        if climbs {
            return Err(self.outside(name.display().to_string()));
        }
        // What is not there is for the opener to say.
        if let (Ok(folder), Ok(real)) = (self.folder.canonicalize(), path.canonicalize())
            && !real.starts_with(&folder)
        {
            return Err(self.outside(format!("{}, a link to {}", name.display(), real.display())));
        }
        Ok(path)
    }

    /// Opens a file by the name that another file has for it; its path and length.
    ///
    /// # Errors
    /// As [`Self::path`] and [`open`].
    pub fn open(&self, name: impl AsRef<Path>) -> Result<(File, u64, PathBuf)> {
        let path = self.path(name)?;
        let (file, length) = open(&path)?;
        Ok((file, length, path))
    }

    /// All bytes of a file by the name that another file has for it.
    ///
    /// # Errors
    /// As [`Self::path`] and [`read`].
    pub fn read(&self, name: impl AsRef<Path>, most: u64) -> Result<Vec<u8>> {
        read(self.path(name)?, most)
    }

    fn outside(&self, found: String) -> Error {
        let folder = self.folder.display();
        Error::format(
            "a file that it names",
            found,
            format!("a file in {folder} or below"),
            "move it there and correct the name, or trust this file with --allow-outside",
        )
    }
}

fn check_plain(path: &Path, metadata: &Metadata) -> Result<()> {
    if metadata.is_file() { Ok(()) } else { Err(not_plain(path, metadata.file_type())) }
}

/// Streams of this process, which are open already: opening them again waits for nobody.
fn is_own_stream(path: &Path) -> bool {
    ["/dev/stdin", "/dev/fd", "/proc/self/fd"].iter().any(|own| path.starts_with(own))
}

fn not_plain(path: &Path, kind: std::fs::FileType) -> Error {
    let (what, remedy) = if kind.is_dir() {
        ("a directory", "name a file in it")
    } else if is_pipe(kind) {
        ("a named pipe", "write it to a file first, or give /dev/stdin and pipe it in")
    } else {
        ("a device or a socket", "name a file")
    };
    Error::argument("file", path.display(), format!("a plain file; this is {what}"), remedy)
}

#[cfg(unix)]
fn is_pipe(kind: std::fs::FileType) -> bool {
    std::os::unix::fs::FileTypeExt::is_fifo(&kind)
}

#[cfg(not(unix))]
fn is_pipe(_: std::fs::FileType) -> bool {
    false
}

/// Bytes of all files under a path.
pub fn size_on_disk(path: &Path) -> u64 {
    let Ok(metadata) = path.symlink_metadata() else { return 0 };
    if !metadata.is_dir() {
        return metadata.len();
    }
    let entries = std::fs::read_dir(path).map(|e| e.flatten().collect::<Vec<_>>()).unwrap_or_default();
    entries.iter().map(|e| size_on_disk(&e.path())).sum()
}

/// Refuses a path whose directory is not there or does not take new files.
///
/// # Errors
/// [`Error::Argument`] when there is no such directory, [`Error::Io`] when the system refuses.
pub fn check_folder(path: &Path) -> Result<()> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        return Err(Error::argument(
            "output",
            path.display(),
            format!("a directory {} to write in", folder.display()),
            "make it first, or check the path",
        ));
    }
    // The only sure test of permission is to write.
    tempfile::Builder::new().prefix(".isolume-").tempfile_in(folder).map(drop).map_err(|e| Error::io(path, "write", e))
}

/// The last part of a path.
pub fn file_name(path: &str) -> String {
    Path::new(path).file_name().map_or_else(|| path.to_string(), |n| n.to_string_lossy().into_owned())
}

/// A name as a part of a file name.
pub fn clean(name: &str) -> String {
    name.chars().map(|c| if c.is_alphanumeric() || "-_.+".contains(c) { c } else { '_' }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_lead_out_of_the_folder_are_refused_unless_allowed() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("in")).unwrap();
        std::fs::write(folder.path().join("secret"), "s").unwrap();
        std::fs::write(folder.path().join("in/data"), "d").unwrap();
        let beside = |allow| Beside::new(folder.path().join("in/header"), allow);
        assert_eq!(beside(false).read("data", 10).unwrap(), b"d");
        assert_eq!(beside(false).read("./data", 10).unwrap(), b"d");
        let absolute = folder.path().join("in/data");
        for name in ["../secret", "../in/data", "x/../../secret", absolute.to_str().unwrap()] {
            let text = beside(false).read(name, 10).unwrap_err().to_string();
            assert!(text.contains(name) && text.contains("--allow-outside"), "{text}");
        }
        assert_eq!(beside(true).read("../secret", 10).unwrap(), b"s");
        assert_eq!(beside(true).read(&absolute, 10).unwrap(), b"d");
    }

    #[cfg(unix)]
    #[test]
    fn links_out_of_the_folder_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("in")).unwrap();
        std::fs::write(folder.path().join("secret"), "s").unwrap();
        std::os::unix::fs::symlink("../secret", folder.path().join("in/link")).unwrap();
        std::fs::write(folder.path().join("in/data"), "d").unwrap();
        std::os::unix::fs::symlink("data", folder.path().join("in/near")).unwrap();
        let beside = Beside::new(folder.path().join("in/header"), false);
        assert_eq!(beside.read("near", 10).unwrap(), b"d");
        assert!(beside.read("link", 10).unwrap_err().to_string().contains("a link to"));
    }

    #[cfg(unix)]
    #[test]
    fn nothing_but_plain_files_is_opened() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let socket = folder.path().join("socket");
        let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        // Without the check the pipe would wait for a writer.
        for (path, what) in [
            (pipe.as_path(), "a named pipe"),
            (&socket, "a device or a socket"),
            (Path::new("/dev/zero"), "a device or a socket"),
            (folder.path(), "a directory"),
        ] {
            for text in [open(path).unwrap_err(), open_named(path).unwrap_err(), read(path, 9).unwrap_err()] {
                assert!(text.to_string().contains(what), "{text}");
            }
        }
    }

    #[test]
    fn no_more_is_read_than_is_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ten");
        std::fs::write(&path, [0; 10]).unwrap();
        assert_eq!(read(&path, 10).unwrap().len(), 10);
        assert!(matches!(read(&path, 9), Err(Error::Limit { .. })));
    }
}
