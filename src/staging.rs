//! Files and directories that appear whole or not at all: written beside their place under a hidden name, then renamed.
//! What a killed process left is removed by the next one that writes in the same folder.
//!
//! # What survives a power cut
//! The order is: the bytes of the file reach the disk ([`File::sync_data`]), the file takes its name (rename), the folder
//! reaches the disk ([`sync_directory`]). Whatever is found under the name afterwards is either the old file or the new one.
//!
//! # Leftovers
//! Whoever writes holds the system's lock on the temporary file, or on [`LOCK`] in a temporary directory; the system lets
//! go of it when the process ends, however it ends. A leftover is therefore what nobody locks and what is older than
//! [`STALE`]; "now" is the time stamp of the file that is being made, so no clock is read.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tempfile::{NamedTempFile, TempDir};

/// How temporary files and directories of a store begin.
pub(crate) const PARTIAL: &str = ".partial-";
/// How temporary files of exports begin; they end in [`EXPORT_SUFFIX`].
pub(crate) const EXPORT: &str = ".isolume-";
/// See [`EXPORT`].
pub(crate) const EXPORT_SUFFIX: &str = ".tmp";
/// What is locked in a temporary directory while it is filled.
pub(crate) const LOCK: &str = ".lock";
/// Age from which a temporary name that nobody locks is a leftover. File systems without locks are the reason to wait.
const STALE: Duration = Duration::from_secs(3600);

/// A hidden file in `folder`, locked by this process, with the permissions of any new file.
pub(crate) fn file_in(folder: &Path, prefix: &str, suffix: &str) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(prefix).suffix(suffix);
    // Goes through open(2), so the umask applies. Otherwise the file would stay readable for its owner alone.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let file = builder.tempfile_in(folder)?;
    if cfg!(unix) {
        // Elsewhere a lock would keep out this process's own other handles. Without one, age alone decides.
        let _ = file.as_file().try_lock();
    }
    Ok(file)
}

/// A hidden directory in `folder`, to become another by a rename. Leftovers beside it are removed.
pub(crate) fn directory_in(folder: &Path) -> io::Result<TempDir> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(PARTIAL);
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o777));
    let directory = builder.tempdir_in(folder)?;
    sweep(folder, directory.path());
    Ok(directory)
}

/// The folder that holds `path`.
pub(crate) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Waits until the disk has the names in a directory.
pub(crate) fn sync_directory(path: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(path)?.sync_all() } else { Ok(()) }
}

/// Makes a directory and those above it that are missing; with `sync`, the disk has their names afterwards.
pub(crate) fn make_directories(path: &Path, sync: bool) -> io::Result<()> {
    if path.is_dir() {
        return Ok(());
    }
    let above = folder_of(path);
    make_directories(above, sync)?;
    match fs::create_dir(path) {
        Ok(()) if sync => sync_directory(above),
        Ok(()) => Ok(()),
        // Another process or thread was quicker.
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists && path.is_dir() => Ok(()),
        Err(e) => Err(e),
    }
}

/// Waits until the disk has every file and name below a directory.
pub(crate) fn sync_tree(directory: &Path) -> io::Result<()> {
    for entry in fs::read_dir(directory)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            sync_tree(&entry.path())?;
        } else {
            File::open(entry.path())?.sync_data()?;
        }
    }
    sync_directory(directory)
}

/// Removes from `folder` what killed processes left there, as seen at the time stamp of `fresh`, which was just made.
/// What cannot be removed stays.
pub(crate) fn sweep(folder: &Path, fresh: &Path) {
    for leftover in leftovers(folder, fresh) {
        let _ = if leftover.is_dir() { fs::remove_dir_all(&leftover) } else { fs::remove_file(&leftover) };
    }
}

/// What killed processes left in `folder`, older than an hour before the time stamp of `fresh`.
fn leftovers(folder: &Path, fresh: &Path) -> Vec<PathBuf> {
    let modified = |path: &Path| path.symlink_metadata().and_then(|m| m.modified());
    let Ok(now) = modified(fresh) else { return Vec::new() };
    let is_stale = |path: &PathBuf| {
        let is_old = modified(path).is_ok_and(|then| now.duration_since(then).is_ok_and(|age| age > STALE));
        is_old && path != fresh && !is_locked(path)
    };
    temporary_names(folder).into_iter().filter(is_stale).collect()
}

/// Files and directories in `folder` with a name of ours for what is not finished.
pub(crate) fn temporary_names(folder: &Path) -> Vec<PathBuf> {
    let is_ours = |path: &PathBuf| {
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let is_link = path.symlink_metadata().is_ok_and(|m| m.is_symlink());
        !is_link && (name.starts_with(PARTIAL) || name.starts_with(EXPORT) && name.ends_with(EXPORT_SUFFIX))
    };
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).filter(is_ours).collect()
}

/// Whether a process still holds what it is writing.
fn is_locked(path: &Path) -> bool {
    let lock = if path.is_dir() { path.join(LOCK) } else { path.to_path_buf() };
    match File::open(lock) {
        // Where the file system has no locks nothing tells whether somebody is at work: then it stays.
        Ok(file) => file.try_lock().is_err(),
        Err(_) => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::SystemTime;

    fn age(path: &Path, seconds: u64) {
        let file = File::open(path).unwrap();
        file.set_modified(SystemTime::now() - Duration::from_secs(seconds)).unwrap();
    }

    #[test]
    fn leftovers_of_dead_processes_go_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in [".partial-old", ".isolume-old.tmp", ".partial-young", ".isolume-other", "partial-mine"] {
            fs::write(at(name), "x").unwrap();
            age(&at(name), if name.ends_with("young") { 60 } else { 7200 });
        }
        for name in [".partial-dead", ".partial-alive"] {
            fs::create_dir(at(name)).unwrap();
            fs::write(at(name).join(LOCK), "").unwrap();
            age(&at(name), 7200);
        }
        let lock = File::open(at(".partial-alive").join(LOCK)).unwrap();
        lock.lock().unwrap();
        let held = file_in(folder.path(), PARTIAL, "").unwrap();
        age(held.path(), 7200);
        let fresh = file_in(folder.path(), EXPORT, EXPORT_SUFFIX).unwrap();
        sweep(folder.path(), fresh.path());
        for gone in [".partial-old", ".isolume-old.tmp", ".partial-dead"] {
            assert!(!at(gone).exists(), "{gone}");
        }
        for kept in [".partial-young", ".isolume-other", "partial-mine", ".partial-alive"] {
            assert!(at(kept).exists(), "{kept}");
        }
        assert!(held.path().exists() && fresh.path().exists());
    }
}
