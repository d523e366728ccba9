//! An advisory lock against two bakes that fill one store without knowing of each other.
//!
//! The lock is the system's lock on the file `.lock`, not the file itself: the system lets go of
//! it when the process ends, however it ends, so that a killed bake never leaves a store locked.
//! Inside the file stand the process and the machine, for the message.
//!
//! Bakes that share a store by agreement, share i of n each, hold `.lock` together (the system's shared lock) and
//! each the file `.lock-share-i-of-n` alone.

use crate::error::{Error, Result};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

/// Holds the lock of a store, or of a share of it, until it is dropped.
#[derive(Debug)]
pub struct StoreLock {
    // The share's own file before the common one; held, not read.
    _files: Vec<Locked>,
}

impl StoreLock {
    /// Takes the lock of the store in a directory before it is opened; with `(i, n)` that of share i of n.
    ///
    /// # Errors
    /// As [`super::Store::lock`] and [`super::Store::lock_share`].
    pub fn take(directory: impl AsRef<Path>, share: Option<(usize, usize)>) -> Result<Self> {
        match share {
            None => lock(directory.as_ref()),
            Some((share, shares)) => lock_share(directory.as_ref(), share, shares),
        }
    }
}

#[derive(Debug)]
struct Locked {
    path: PathBuf,
    file: File,
}

const COMMON: &str = crate::staging::LOCK;
const SHARE: &str = ".lock-share-";
const ADDING: &str = ".lock-adding";
const CHUNK: &str = ".lock-chunk-";
/// Behind the hidden name of a store in its folder.
const MAKING: &str = ".making";

/// Takes the lock of the store in `directory`.
///
/// # Errors
/// When another process (or another lock of this one) holds it or a share, or the file system has no locks.
pub(super) fn lock(directory: &Path) -> Result<StoreLock> {
    Ok(StoreLock { _files: vec![take(directory, COMMON, File::try_lock)?] })
}

/// Takes the lock of one share.
///
/// # Errors
/// When another process holds the store, this share, or a share of another number of shares.
pub(super) fn lock_share(directory: &Path, share: usize, shares: usize) -> Result<StoreLock> {
    let common = take(directory, COMMON, File::try_lock_shared)?;
    let own = take(directory, &format!("{SHARE}{share}-of-{shares}"), File::try_lock)?;
    let failed = |e| Error::io(directory, "look for other shares", e);
    for entry in fs::read_dir(directory).map_err(failed)? {
        let name = entry.map_err(failed)?.file_name().to_string_lossy().into_owned();
        if name.starts_with(SHARE) && !name.ends_with(&format!("-of-{shares}")) {
            // A killed process may have left it: then it is free, and goes.
            drop(take(directory, &name, File::try_lock)?);
        }
    }
    Ok(StoreLock { _files: vec![own, common] })
}

/// Waits for the right to name another volume in the root, which shares of one bake may want at once.
pub(super) fn adding(directory: &Path) -> Result<StoreLock> {
    let wait = |file: &File| file.lock().map_err(TryLockError::Error);
    Ok(StoreLock { _files: vec![take(directory, ADDING, wait)?] })
}

/// Who holds the store or a share of it, as their lock files say.
pub(super) fn processes(directory: &Path) -> Vec<String> {
    let mut found: Vec<(usize, String)> = Vec::new();
    for entry in fs::read_dir(directory).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let share = name.strip_prefix(SHARE).and_then(|share| share.split_once("-of-"));
        if share.is_none() && name != COMMON {
            continue;
        }
        // A file that nobody locks is what a killed process left. Where shares hold the common one it is not locked for them alone.
        let Ok(mut file) = File::open(entry.path()) else { continue };
        let is_held = matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock));
        let mut holder = String::new();
        if !is_held || (&mut file).take(256).read_to_string(&mut holder).is_err() {
            continue;
        }
        found.push(match share.and_then(|(i, n)| Some((i.parse().ok()?, n))) {
            Some((i, n)) => (i, format!("share {i} of {n}, {}", holder.trim())),
            None => (0, holder.trim().to_owned()),
        });
    }
    found.sort();
    found.into_iter().map(|(_, text)| text).collect()
}

/// Waits for the right to rewrite a chunk whose octants several shares bake.
pub(super) fn chunk(directory: &Path, place: &str, [x, y, z]: [usize; 3]) -> Result<StoreLock> {
    let wait = |file: &File| file.lock().map_err(TryLockError::Error);
    let name = format!("{CHUNK}{}-{z}.{y}.{x}", place.replace('/', "-"));
    Ok(StoreLock { _files: vec![take(directory, &name, wait)?] })
}

/// Waits for the right to make the store at `path`, so that of several processes one does and the others find it there.
pub(super) fn making(path: &Path) -> Result<StoreLock> {
    let wait = |file: &File| file.lock().map_err(TryLockError::Error);
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    Ok(StoreLock { _files: vec![take(crate::staging::folder_of(path), &format!(".{name}{MAKING}"), wait)?] })
}

fn take(directory: &Path, name: &str, try_lock: fn(&File) -> std::result::Result<(), TryLockError>) -> Result<Locked> {
    let path = directory.join(name);
    let failed = |e| Error::io(&path, "lock the store", e);
    // A holder that lets go removes the file; whoever locked the removed one tries again.
    for _ in 0..64 {
        let file = open_lock(&path)?;
        match try_lock(&file) {
            Ok(()) => {}
            Err(TryLockError::Error(e)) => return Err(failed(e)),
            Err(TryLockError::WouldBlock) => {
                let mut holder = String::new();
                let _ = (&file).take(256).read_to_string(&mut holder); // Only for the message.
                return Err(Error::Locked {
                    path: directory.to_path_buf(),
                    holder: holder.trim().to_string(),
                    remedy: "wait for that process or end it, give every process its own share with --chunks i/n, or \
                             give another output with -o"
                        .into(),
                });
            }
        }
        if is_at(&file, &path) {
            let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_else(|_| "this machine".into());
            let text = format!("process {} on {}\n", std::process::id(), host.trim());
            file.set_len(0).and_then(|()| (&file).write_all(text.as_bytes())).map_err(failed)?;
            return Ok(Locked { path, file });
        }
    }
    Err(failed(std::io::Error::other("other processes take and leave the lock all the time")))
}

/// Opens the lock file, or makes it. A link is not followed and a pipe not waited for: what is written into the file must
/// not land in another.
fn open_lock(path: &Path) -> Result<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(false);
    #[cfg(unix)]
    {
        use rustix::fs::OFlags;
        use std::os::unix::fs::OpenOptionsExt;
        options.custom_flags((OFlags::NOFOLLOW | OFlags::NONBLOCK).bits() as i32);
    }
    let foreign = || {
        let remedy = "remove it: a store's lock is a plain file that isolume makes";
        Error::argument("store", format!("{}, a link or no plain file", path.display()), "a plain file", remedy)
    };
    let file = options.open(path).map_err(|e| match path.symlink_metadata() {
        Ok(kind) if !kind.is_file() => foreign(),
        _ => Error::io(path, "lock the store", e),
    })?;
    if is_shared_or_special(&file) { Err(foreign()) } else { Ok(file) }
}

/// Whether the file is no plain file, or has other names.
fn is_shared_or_special(file: &File) -> bool {
    let Ok(metadata) = file.metadata() else { return true };
    #[cfg(unix)]
    if std::os::unix::fs::MetadataExt::nlink(&metadata) > 1 {
        return true;
    }
    !metadata.is_file()
}

impl Drop for Locked {
    fn drop(&mut self) {
        // Removed while still locked, so that nobody can lock the file at this path before it goes. The common file
        // stays while others share it: only who can have it alone removes it.
        if self.file.try_lock().is_ok() {
            let _ = fs::remove_file(&self.path);
        }
        let _ = self.file.unlock();
    }
}

/// Whether `path` still names the open file.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    match (file.metadata(), fs::metadata(path)) {
        (Ok(a), Ok(b)) => (a.dev(), a.ino()) == (b.dev(), b.ino()),
        _ => false,
    }
}

/// Whether `path` still names the open file: elsewhere an open file cannot be removed.
#[cfg(not(unix))]
fn is_at(_: &File, _: &Path) -> bool {
    true
}
