//! Replacing a store by another that is made beside it: the old one stays until the new one is complete.

use super::lock::{self, StoreLock};
use crate::error::{Error, Result};
use crate::staging;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A store in the making that will take the place of another.
#[derive(Debug)]
pub struct Replacement {
    /// The directory that is replaced; a link is followed.
    target: PathBuf,
    staged: TempDir,
    // Both are held until the new store is in its place.
    _old: StoreLock,
    _new: StoreLock,
}

/// Name of the new store in the temporary directory: the directory itself carries the lock.
const INSIDE: &str = "store";

impl Replacement {
    /// Begins to replace the store at `path`, a directory. Nobody else may be filling it.
    ///
    /// # Errors
    /// When another process bakes into it, or the system refuses.
    pub fn begin(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let failed = |e| Error::io(path, "replace the store", e);
        let target = fs::canonicalize(path).map_err(failed)?;
        if !target.is_dir() {
            let remedy = "delete the archive, or give another output with -o";
            return Err(Error::argument("output", path.display(), "the directory of a store", remedy));
        }
        let old = lock::lock(&target)?;
        let staged = staging::directory_in(staging::folder_of(&target)).map_err(failed)?;
        let new = lock::lock(staged.path())?;
        Ok(Self { target, staged, _old: old, _new: new })
    }

    /// Where the new store is to be made.
    pub fn path(&self) -> PathBuf {
        self.staged.path().join(INSIDE)
    }

    /// Puts the new store into the place of the old one and removes that. Files in the old directory that no store has
    /// are taken over.
    ///
    /// # Errors
    /// When the system refuses; the old store is then still in its place, whole.
    pub fn commit(self) -> Result<()> {
        let Self { target, staged, _old, _new } = self;
        let new = staged.path().join(INSIDE);
        let failed = |e| Error::io(&target, "replace the store", e);
        take_over(&target, &new, "").map_err(failed)?;
        exchange(&new, &target, &staged.path().join("old")).map_err(failed)?;
        staging::sync_directory(staging::folder_of(&target)).map_err(failed)?;
        drop((_old, _new));
        // What stays behind is hidden and has nothing that is needed.
        let _ = staged.close();
        Ok(())
    }
}

/// Links what is no part of a store from the old directory into the new one; nothing is taken away from the old one.
fn take_over(old: &Path, new: &Path, below: &str) -> std::io::Result<()> {
    for entry in fs::read_dir(old)? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        let key = if below.is_empty() { name.clone() } else { format!("{below}/{name}") };
        let to = new.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            if is_scratch(&key) {
                continue;
            }
            // A folder beside those of the store is somebody else's, empty or not.
            if !matches!(key.split('/').next(), Some("volumes" | "transfer" | "surfaces")) {
                staging::make_directories(&to, false)?;
            }
            take_over(&entry.path(), &to, &key)?;
        } else if !is_owned(&key) {
            staging::make_directories(new, false)?;
            if fs::hard_link(entry.path(), &to).is_err() {
                fs::copy(entry.path(), &to)?;
            }
        }
    }
    Ok(())
}

/// Hidden names that bakes use.
fn is_scratch(key: &str) -> bool {
    key == ".damaged" || key.rsplit('/').next().is_some_and(|name| name.starts_with(staging::PARTIAL))
}

/// Whether a file below the root of a store is one that a store has.
fn is_owned(key: &str) -> bool {
    let name = key.rsplit('/').next().unwrap_or(key);
    if is_scratch(key) || key == "zarr.json" || name.starts_with(".lock") && !key.contains('/') {
        return true;
    }
    let parts: Vec<&str> = key.split('/').collect();
    let numbers = |parts: &[&str]| parts.iter().all(|part| part.bytes().all(|b| b.is_ascii_digit()));
    match parts.as_slice() {
        ["volumes" | "transfer", middle @ .., "zarr.json"] => middle.len() <= 3,
        ["volumes", _, "data", "c", rest @ ..] => rest.len() == 3 && numbers(rest),
        ["transfer", _, _, "transfer" | "stderr" | "validity" | "rays", "c", rest @ ..] => numbers(rest),
        ["transfer", _, _, "rays", "extent", file] | ["transfer", _, _, "extent", file] => file.ends_with(".json"),
        ["transfer", _, _, "rays", file] | ["transfer", _, _, file] => {
            matches!(*file, "asked.json" | "allocation.json") || file.starts_with("checks-")
        }
        ["transfer", _, _, "low" | "high", "c", rest @ ..] => numbers(rest),
        ["surfaces", ..] => is_owned_by_surface(&parts[1..]),
        _ => false,
    }
}

/// Whether a file below the folder of surfaces is one that surfaces have.
fn is_owned_by_surface(parts: &[&str]) -> bool {
    let is_number = |part: &&str| part.bytes().all(|b| b.is_ascii_digit());
    let of_bake = |file: &str| ["asked.json", "allocation.json"].contains(&file) || file.starts_with("checks-");
    match parts {
        [middle @ .., "zarr.json"] => middle.len() <= 4,
        [_, _, below @ ..] => {
            let at = below.iter().position(|part| *part == "c");
            at.is_some_and(|at| (1..=2).contains(&at) && below[at + 1..].iter().all(is_number))
                || matches!(below, [.., "rays", "extent", file] if file.ends_with(".json"))
                || matches!(below, [.., "rays", file] if of_bake(file))
        }
        _ => false,
    }
}

/// Swaps two directories in one step where the system can; else the old one goes to `aside` first.
fn exchange(new: &Path, target: &Path, aside: &Path) -> std::io::Result<()> {
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        match renameat_with(CWD, new, CWD, target, RenameFlags::EXCHANGE) {
            Ok(()) => return Ok(()),
            Err(rustix::io::Errno::INVAL | rustix::io::Errno::NOSYS | rustix::io::Errno::OPNOTSUPP) => {}
            Err(e) => return Err(e.into()),
        }
    }
    fs::rename(target, aside)?;
    fs::rename(new, target).inspect_err(|_| {
        let _ = fs::rename(aside, target);
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_a_store_has_is_its_own() {
        for own in [
            "zarr.json",
            ".lock",
            ".lock-share-1-of-2",
            "volumes/zarr.json",
            "volumes/a/data/zarr.json",
            "volumes/a/data/c/0/1/2",
            "transfer/a/env/zarr.json",
            "transfer/a/env/transfer/c/0/1/2/0",
            "transfer/a/luminaire.x/rays/c/0/1/2",
            "transfer/a/env/rays/extent/0.1.2.json",
            "transfer/a/env/extent/0.1.2.json",
            "transfer/a/env/rays/asked.json",
            "transfer/a/env/allocation.json",
            "transfer/a/env/rays/checks-90.json",
            "transfer/a/env/rays/checks-all.bin",
            "transfer/a/env/low/c/3/0/0",
            "surfaces/zarr.json",
            "surfaces/a/90/positions/zarr.json",
            "surfaces/a/90/luminaire.x/transfer/zarr.json",
            "surfaces/a/90/triangles/c/0/0",
            "surfaces/a/90/high/c/0/0/0",
            "surfaces/a/90/emission/rays/c/0",
            "surfaces/a/-0.5/rays/extent/0.0.1.json",
            "surfaces/a/-0.5/rays/checks--0.5.bin",
        ] {
            assert!(is_owned(own), "{own}");
        }
        for other in [
            "notes.txt",
            "surfaces/a/notes.txt",
            "surfaces/a/90/positions/x",
            "volumes/notes.txt",
            "transfer/a/env/transfer/c/x",
            "volumes/a/data/c/0/1",
            "a/zarr.json",
        ] {
            assert!(!is_owned(other), "{other}");
        }
    }
}
