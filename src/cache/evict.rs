//! What the cache holds, and what goes when it is too much.

use super::{Cache, DEFAULT_LIMIT, Note};
use crate::error::{Error, Result};
use crate::export::atomic;
use crate::file::size_on_disk;
use crate::quantity;
use crate::scene::nearest;
use crate::transfer::store::{FORMAT_VERSION, Store};
use std::fs::{self, OpenOptions};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// What a store is called while it is deleted, so that nobody opens half of it.
const REMOVED: &str = ".removed-";

/// A store in the cache.
pub struct Entry {
    /// The store.
    pub path: PathBuf,
    /// Bytes on the disk.
    pub bytes: u64,
    /// When it was last used, or made.
    pub used: SystemTime,
    /// Whether this version of the program may use it.
    pub current: bool,
}

impl Entry {
    /// The name of its folder.
    pub fn name(&self) -> String {
        self.path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
    }
}

impl Cache {
    /// All stores, those first that go first: of other formats, then those whose last use is longest ago.
    pub fn entries(&self) -> Vec<Entry> {
        let current = format!("stores-v{FORMAT_VERSION}");
        let mut all = Vec::new();
        // Stores beside the folders of the formats are of versions that had no such folders.
        let mut folders = vec![self.folder.clone()];
        folders.extend(below(&self.folder).filter(|path| name_of(path).starts_with("stores-v")));
        for folder in folders {
            for path in below(&folder).filter(|path| path.extension().is_some_and(|e| e == "isolume")) {
                let time = |path: &Path| fs::metadata(path).and_then(|found| found.modified()).ok();
                let used = time(&path.with_extension("use")).or_else(|| time(&path)).unwrap_or(SystemTime::UNIX_EPOCH);
                all.push(Entry { bytes: size_on_disk(&path), used, current: name_of(&folder) == current, path });
            }
        }
        all.sort_by(|a, b| (a.current, a.used, &a.path).cmp(&(b.current, b.used, &b.path)));
        all
    }

    /// Most bytes that the cache may hold; `None`: any number.
    ///
    /// # Errors
    /// When the file that says so is not a number.
    pub fn limit(&self) -> Result<Option<u64>> {
        let path = self.folder.join("limit");
        let Ok(text) = fs::read_to_string(&path) else { return Ok(Some(DEFAULT_LIMIT)) };
        match text.trim() {
            "none" => Ok(None),
            number => number.parse().map(Some).map_err(|_| {
                let remedy = "set it anew: isolume cache limit 10GB";
                Error::argument(path.display().to_string(), number, "a number of bytes, or none", remedy)
            }),
        }
    }

    /// Deletes stores until the cache holds no more than its limit, but none that is in use.
    ///
    /// # Errors
    /// When the limit is not a number, or the system refuses.
    pub fn evict(&self, note: &Note<'_>) -> Result<()> {
        self.sweep();
        let Some(limit) = self.limit()? else { return Ok(()) };
        let entries = self.entries();
        let mut held: u64 = entries.iter().map(|entry| entry.bytes).sum();
        for entry in &entries {
            if held <= limit {
                return Ok(());
            }
            if remove(&entry.path)? {
                held -= entry.bytes;
                let (name, size, limit) = (entry.name(), entry.bytes as f64, limit as f64);
                note(&format!(
                    "{name} ({}) left the cache, which may hold {}: isolume cache limit",
                    quantity::bytes(size),
                    quantity::bytes(limit)
                ));
            }
        }
        if held > limit {
            note(&format!(
                "the cache holds {}, above its limit of {}; what is in use stays",
                quantity::bytes(held as f64),
                quantity::bytes(limit as f64)
            ));
        }
        Ok(())
    }

    /// As [`Cache::evict`], after work that is done: what goes wrong is a note.
    pub fn tidy(&self, note: &Note<'_>) {
        if let Err(error) = self.evict(note) {
            note(&format!("the cache keeps what it has: {error}"));
        }
    }

    /// Sets the most bytes that it may hold, and deletes what is too much.
    ///
    /// # Errors
    /// When the file that says so cannot be written; as [`Self::evict`].
    pub fn set_limit(&self, limit: Option<u64>, note: &Note<'_>) -> Result<()> {
        let text = limit.map_or("none".into(), |bytes| bytes.to_string());
        atomic::write_bytes(self.folder.join("limit"), text.as_bytes())?;
        self.evict(note)
    }

    /// Deletes the stores of these names, or all: those that went, and those that stay because they are in use.
    ///
    /// # Errors
    /// When there is none of a name, or the system refuses.
    pub fn clear(&self, names: &[String]) -> Result<(Vec<Entry>, Vec<Entry>)> {
        self.sweep();
        let entries = self.entries();
        if let Some(unknown) = names.iter().find(|name| entries.iter().all(|entry| entry.name() != **name)) {
            let known: Vec<String> = entries.iter().map(|entry| entry.name()).collect();
            let remedy = match nearest(unknown, known.iter().map(String::as_str)) {
                Some(near) => format!("did you mean {near}?"),
                None => "see isolume cache list".into(),
            };
            return Err(Error::argument("store", unknown, "a store in the cache", remedy));
        }
        let (mut gone, mut kept) = (Vec::new(), Vec::new());
        for entry in entries.into_iter().filter(|entry| names.is_empty() || names.contains(&entry.name())) {
            if remove(&entry.path)? { gone.push(entry) } else { kept.push(entry) }
        }
        Ok((gone, kept))
    }

    /// Deletes what a killed process had begun to delete.
    fn sweep(&self) {
        let folders = below(&self.folder).chain(std::iter::once(self.folder.clone()));
        for path in folders.collect::<Vec<_>>().iter().flat_map(|folder| below(folder)) {
            if name_of(&path).starts_with(REMOVED) {
                let _ = fs::remove_dir_all(&path);
            }
        }
    }
}

/// Deletes a store; `false` where it is in use or already gone.
fn remove(path: &Path) -> Result<bool> {
    let failed = |e| Error::io(path, "delete the store", e);
    let mark = path.with_extension("use");
    let file = match OpenOptions::new().write(true).open(&mark) {
        Ok(file) if file.try_lock().is_err() => return Ok(false),
        Ok(file) => Some(file),
        Err(_) => None,
    };
    // A bake that goes on in the cache without this module holds the store's own lock.
    let lock = match Store::open(path).and_then(|store| store.lock()) {
        Err(Error::Locked { .. }) => return Ok(false),
        lock => lock.ok(),
    };
    let removed = path.with_file_name(format!("{REMOVED}{}-{}", std::process::id(), name_of(path)));
    match fs::rename(path, &removed) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(false),
        renamed => renamed.map_err(failed)?,
    }
    drop(lock);
    if file.is_some() {
        let _ = fs::remove_file(&mark);
    }
    fs::remove_dir_all(&removed).map_err(failed)?;
    Ok(true)
}

fn below(folder: &Path) -> impl Iterator<Item = PathBuf> + use<> {
    fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path())
}

fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}
