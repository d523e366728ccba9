//! The cache: stores of volumes that were lit without a bake of their own, in the user's cache folder.
//!
//! ```text
//! FOLDER/limit                        what `isolume cache limit` set, in bytes
//! FOLDER/stores-vN/NAME-HASH.isolume  a store of format N; the hash is that of its identity
//! FOLDER/stores-vN/NAME-HASH.use      its time is that of the last use; locked, shared, by whoever uses the store
//! ```
//! Stores may go at any time but while they are used: [`Cache::evict`] takes those whose last use is longest ago.

pub(super) mod command;
mod evict;
pub(super) mod members;

use super::baking;
use super::console::Console;
use super::{Failure, Outcome, text};
use crate::bake::{Report, Request};
use crate::error::{Error, Result};
use crate::export::target::clean;
use crate::transfer::store::{FORMAT_VERSION, Store, StoreLock};
use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

/// Bytes that the cache may hold where the user did not say.
const DEFAULT_LIMIT: u64 = 10_000_000_000;
/// How long a command waits for another one that fills the same store.
const LONGEST_WAIT: Duration = Duration::from_secs(30 * 60);
/// Between two looks at the lock.
const LOOK: Duration = Duration::from_millis(200);

/// The cache in a folder.
pub(crate) struct Cache {
    folder: PathBuf,
}

/// A store that is in use, and how it came about.
pub(super) struct Filled {
    pub(super) store: Store,
    pub(super) report: Report,
    pub(super) in_use: InUse,
}

/// While it lives, the store stays in the cache.
pub(crate) struct InUse(#[allow(dead_code, reason = "held for its lock")] Option<File>);

impl Cache {
    /// The cache in the folder that the user gave, or in that of the system.
    pub(crate) fn locate(given: Option<&Path>) -> Outcome<Self> {
        if let Some(folder) = given {
            return Ok(Self { folder: folder.to_path_buf() });
        }
        let folders = directories::ProjectDirs::from("", "", "isolume");
        folders.map(|f| Self { folder: f.cache_dir().to_path_buf() }).ok_or_else(|| {
            Failure::Message("this system has no cache folder for the user: name one with --cache DIR".into())
        })
    }

    /// Makes the folder of the stores, and tries to write there.
    pub(crate) fn prepare(&self) -> Outcome {
        let folder = self.stores();
        let made = std::fs::create_dir_all(&folder);
        let tried = made.and_then(|()| tempfile::Builder::new().prefix(".isolume-").tempfile_in(&folder));
        tried.map(drop).map_err(|e| {
            let folder = folder.display();
            Failure::Message(format!(
                "cannot write into the cache folder {folder}: {e}; name another one with --cache DIR, or bake into a \
                 store of your own: isolume bake"
            ))
        })
    }

    fn stores(&self) -> PathBuf {
        self.folder.join(format!("stores-v{FORMAT_VERSION}"))
    }

    /// The place of the store of a bake.
    pub(crate) fn place(&self, job: &Request<'_>) -> PathBuf {
        self.stores().join(format!("{}-{}.isolume", clean(&job.volume.name), &job.identity().hash()[..16]))
    }

    /// Bakes what is missing into the store at `path`. Where another process fills it, waits for it, with a note.
    pub(super) fn fill(&self, job: &Request<'_>, path: &Path, begun: Instant, console: &Console) -> Outcome<Filled> {
        let in_use = self.use_of(path)?;
        let start = Instant::now();
        loop {
            wait(path, start, console)?;
            match baking::fill(job, path, begun, console) {
                // Somebody was quicker.
                Err(Failure::Library(Error::Locked { .. })) if start.elapsed() < LONGEST_WAIT => {}
                filled => return filled.map(|(store, report)| Filled { store, report, in_use }),
            }
        }
    }

    /// Notes that a store is used, now and until the result is dropped.
    pub(crate) fn use_of(&self, path: &Path) -> Result<InUse> {
        let mark = path.with_extension("use");
        let failed = |e| Error::io(&mark, "note the use of the store", e);
        loop {
            let file = OpenOptions::new().write(true).create(true).truncate(false).open(&mark).map_err(failed)?;
            file.set_modified(SystemTime::now()).map_err(failed)?;
            if file.lock_shared().is_err() {
                // On a file system without locks the store is simply not protected.
                return Ok(InUse(None));
            }
            // Otherwise the store has been evicted meanwhile, and its mark with it.
            if mark.exists() {
                return Ok(InUse(Some(file)));
            }
        }
    }

    /// What was found or baked at `path`, for the user: with its size, and that of the whole cache.
    pub(super) fn tell(&self, report: &Report, name: Option<&str>, path: &Path, console: &Console) {
        let what = if report.chunks_baked == 0 { "found in" } else { "baked into" };
        let of_name = name.map_or(String::new(), |name| format!("{name} "));
        let size = text::bytes(crate::file::size_on_disk(path) as f64);
        let all = text::bytes(self.entries().iter().map(|entry| entry.bytes).sum::<u64>() as f64);
        console.note(format!("{of_name}{what} {} ({size}; the cache holds {all}: isolume cache)", path.display()));
    }
}

/// Returns when nobody fills the store at `path`, or there is none.
fn wait(path: &Path, start: Instant, console: &Console) -> Outcome {
    let mut told = false;
    while path.join("zarr.json").is_file() {
        let holder = match StoreLock::take(path, None) {
            Err(Error::Locked { holder, .. }) => holder,
            // What else is wrong the bake will say.
            _ => break,
        };
        if start.elapsed() >= LONGEST_WAIT {
            let (path, waited) = (path.display(), text::duration(start.elapsed()));
            return Err(Failure::Message(format!(
                "{path} is filled by {holder}; after {waited} it is not done: wait for that process or end it, or give \
                 another --cache DIR"
            )));
        }
        if !told {
            let most = LONGEST_WAIT.as_secs() / 60;
            console.note(format!("waiting for {holder}, which bakes {} (at most {most} minutes)", path.display()));
            told = true;
        }
        std::thread::sleep(LOOK);
    }
    Ok(())
}
