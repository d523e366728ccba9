//! An advisory lock against two bakes that fill one store without knowing of each other.
//!
//! The lock is the system's lock on the file `.lock`, not the file itself: the system lets go of
//! it when the process ends, however it ends, so that a killed bake never leaves a store locked.
//! Inside the file stand the process and the machine, for the message. Bakes that share a store
//! by agreement (each with its own chunks) do not take it: writing chunks needs no lock.

use crate::error::{Error, Result};
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

/// Holds the lock of a store until it is dropped.
#[derive(Debug)]
pub struct StoreLock {
    path: PathBuf,
    file: File,
}

/// Takes the lock of the store in `directory`.
///
/// # Errors
/// When another process (or another lock of this one) holds it, or the file system has no locks.
pub(super) fn lock(directory: &Path) -> Result<StoreLock> {
    let path = directory.join(".lock");
    let failed = |e| Error::io(&path, "lock the store", e);
    // A holder that lets go removes the file; whoever locked the removed one tries again.
    for _ in 0..64 {
        let mut options = OpenOptions::new();
        let file = options.read(true).write(true).create(true).truncate(false).open(&path).map_err(failed)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::Error(e)) => return Err(failed(e)),
            Err(TryLockError::WouldBlock) => {
                let mut holder = String::new();
                let _ = (&file).take(256).read_to_string(&mut holder); // Only for the message.
                return Err(Error::argument(
                    "store",
                    format!("{}, locked by {}", directory.display(), holder.trim()),
                    "a store that nobody else is filling",
                    "wait for that process or end it, or give another output with -o",
                ));
            }
        }
        if is_at(&file, &path) {
            let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_else(|_| "this machine".into());
            let text = format!("process {} on {}\n", std::process::id(), host.trim());
            file.set_len(0).and_then(|()| (&file).write_all(text.as_bytes())).map_err(failed)?;
            return Ok(StoreLock { path, file });
        }
    }
    Err(failed(std::io::Error::other("other processes take and leave the lock all the time")))
}

impl Drop for StoreLock {
    fn drop(&mut self) {
        // Removed while still locked, so that nobody can lock the file at this path before it goes.
        let _ = fs::remove_file(&self.path);
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
