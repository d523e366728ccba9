//! The cache: stores of volumes that are lit without a bake of their own, in one folder.
//!
//! ```text
//! FOLDER/limit                        what `isolume cache limit` set, in bytes
//! FOLDER/stores-vN/NAME-HASH.isolume  a store of format N; the hash is that of its identity
//! FOLDER/stores-vN/NAME-HASH.use      its time is that of the last use; locked, shared, by whoever uses the store
//! ```
//! Stores may go at any time but while they are used: [`Cache::evict`] takes those whose last use is longest ago. What the
//! user should know goes to a [`Note`].

mod drafts;
mod evict;
mod light;
mod members;

pub use drafts::drafts;
pub use evict::Entry;
pub use light::{for_light, lights};
pub use members::{Look, MemberBakes};

use crate::bake::{Report, Request};
use crate::error::{Error, Result};
use crate::file::{clean, size_on_disk};
use crate::quantity;
use crate::transfer::store::{FORMAT_VERSION, Store, StoreLock};
use std::fs::{File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

/// Bytes that the cache may hold where the user did not say.
const DEFAULT_LIMIT: u64 = 10_000_000_000;
/// How long a bake waits for another process that fills the same store.
const LONGEST_WAIT: Duration = Duration::from_secs(30 * 60);
/// Between two looks at the lock.
const LOOK: Duration = Duration::from_millis(200);

/// Who is told what the user should know.
pub type Note<'a> = dyn Fn(&str) + 'a;
/// Who bakes what is missing into the store at a path.
pub type Filler<'a> = dyn Fn(&Request<'_>, &Path) -> Result<(Store, Report)> + 'a;

/// The cache in a folder.
pub struct Cache {
    folder: PathBuf,
}

/// A store that is in use, and how it came about.
pub struct Filled {
    /// The store.
    pub store: Store,
    /// What was baked.
    pub report: Report,
    /// Keeps it in the cache.
    pub in_use: InUse,
}

/// While it lives, the store stays in the cache.
pub struct InUse(#[allow(dead_code, reason = "held for its lock")] Option<File>);

impl Cache {
    /// The cache in a folder, which need not be there.
    pub fn at(folder: impl Into<PathBuf>) -> Self {
        Self { folder: folder.into() }
    }

    /// Its folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The folder of the stores of today's format.
    pub fn stores(&self) -> PathBuf {
        self.folder.join(format!("stores-v{FORMAT_VERSION}"))
    }

    /// Makes the folder of the stores, and tries to write there.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn prepare(&self) -> io::Result<()> {
        let folder = self.stores();
        std::fs::create_dir_all(&folder)?;
        tempfile::Builder::new().prefix(".isolume-").tempfile_in(&folder).map(drop)
    }

    /// The place of the store of a bake.
    pub fn place(&self, job: &Request<'_>) -> PathBuf {
        // Vertices are no part of the identity: a store may hold either.
        let ending = if job.volume.exact.is_some() { "-exact" } else { "" };
        self.stores().join(format!("{}-{}{ending}.isolume", clean(&job.volume.name), &job.identity().hash()[..16]))
    }

    /// Bakes what is missing into the store at `path`. Where another process fills it, waits for it, with a note.
    ///
    /// # Errors
    /// Those of the bake; when the other process takes longer than half an hour.
    pub fn fill(&self, job: &Request<'_>, path: &Path, bake: &Filler<'_>, note: &Note<'_>) -> Result<Filled> {
        let in_use = self.use_of(path)?;
        let start = Instant::now();
        loop {
            wait(path, start, note)?;
            match bake(job, path) {
                // Somebody was quicker.
                Err(Error::Locked { .. }) if start.elapsed() < LONGEST_WAIT => {}
                filled => return filled.map(|(store, report)| Filled { store, report, in_use }),
            }
        }
    }

    /// Notes that a store is used, now and until the result is dropped.
    ///
    /// # Errors
    /// When the mark of the use cannot be written.
    pub fn use_of(&self, path: &Path) -> Result<InUse> {
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
    pub fn describe(&self, report: &Report, name: Option<&str>, path: &Path) -> String {
        let what = if report.chunks_baked == 0 { "found in" } else { "baked into" };
        let of_name = name.map_or(String::new(), |name| format!("{name} "));
        let size = quantity::bytes(size_on_disk(path) as f64);
        let all = quantity::bytes(self.entries().iter().map(|entry| entry.bytes).sum::<u64>() as f64);
        format!("{of_name}{what} {} ({size}; the cache holds {all}: isolume cache)", path.display())
    }
}

/// Returns when nobody fills the store at `path`, or there is none.
fn wait(path: &Path, start: Instant, note: &Note<'_>) -> Result<()> {
    let mut told = false;
    while path.join("zarr.json").is_file() {
        let holder = match StoreLock::take(path, None) {
            Err(Error::Locked { holder, .. }) => holder,
            // What else is wrong the bake will say.
            _ => break,
        };
        if start.elapsed() >= LONGEST_WAIT {
            let waited = quantity::duration(start.elapsed());
            let remedy =
                format!("after {waited} it is not done: wait for that process or end it, or give another --cache DIR");
            return Err(Error::Locked { path: path.into(), holder, remedy });
        }
        if !told {
            let most = LONGEST_WAIT.as_secs() / 60;
            note(&format!("waiting for {holder}, which bakes {} (at most {most} minutes)", path.display()));
            told = true;
        }
        std::thread::sleep(LOOK);
    }
    Ok(())
}
