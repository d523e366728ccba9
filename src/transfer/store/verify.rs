//! Looking at what a bake would keep: every byte of a chunk is verified, and what is damaged is set aside, to be baked again.

use super::chunk::ARRAYS;
use super::chunk::examine::ChunkState;
use super::surface::SURFACES;
use super::{ChunkExtent, Store, lock};
use crate::error::{Error, Result};
use crate::grid3;
use crate::transfer::{Group, Selection};
use rayon::prelude::*;
use serde_json::Value;
use std::fs;
use std::io;
use std::path::PathBuf;

/// Where damaged files wait until their chunk is there again; hidden, and no part of the store.
const SET_ASIDE: &str = ".damaged";
/// The record of what was asked of a store.
const ASKED: &str = "asked";

/// What stands at the place of a chunk, every checksum verified, in all groups of the store.
#[derive(Clone, Debug, PartialEq)]
pub enum ChunkCheck {
    /// Not baked.
    Absent,
    /// Whole; how far it was baked.
    Sound(ChunkExtent),
    /// Torn, incomplete, of another store, or with a wrong checksum; what was found first.
    Damaged(String),
}

impl Store {
    /// Verifies some chunks, as they are on disk now, in all groups; the answers are in the order of the indices.
    ///
    /// # Errors
    /// When an index is outside the lattice or the system refuses to read; damage is no error here.
    #[doc(hidden)]
    pub fn verify_chunks(&self, indices: &[[usize; 3]]) -> Result<Vec<ChunkCheck>> {
        let groups = self.other_groups()?;
        let nothing = Selection::empty(self.layout.lattice);
        let check = |&index: &[usize; 3]| {
            let own = self.verify_one(index, &nothing)?;
            for group in &groups {
                match (&own, group.verify_one(index, &nothing)?) {
                    (ChunkCheck::Damaged(_), _) => break,
                    (_, ChunkCheck::Damaged(what)) => return Ok(ChunkCheck::Damaged(what)),
                    (ChunkCheck::Sound(ours), ChunkCheck::Sound(theirs)) if *ours == theirs => {}
                    (ChunkCheck::Absent, ChunkCheck::Absent) => {}
                    // The environment's texture is written last; a group may be ahead of it, not behind.
                    (ChunkCheck::Absent, _) => {}
                    _ => {
                        let name = group.path().join(group.shard_key(0, index));
                        return Ok(ChunkCheck::Damaged(format!("{}: of another bake, or missing", name.display())));
                    }
                }
            }
            Ok(own)
        };
        indices.par_iter().with_max_len(1).map(check).collect::<Vec<_>>().into_iter().collect()
    }

    /// The groups beside the environment, of a store that is not one of them.
    pub(super) fn other_groups(&self) -> Result<Vec<Self>> {
        let is_whole = self.group == Group::Environment;
        self.identity.groups().iter().skip(1).filter(|_| is_whole).map(|group| self.group(group)).collect()
    }

    /// The chunk in this group alone.
    pub(super) fn verify_one(&self, index: [usize; 3], nothing: &Selection) -> Result<ChunkCheck> {
        Ok(match self.examine_chunk(index, nothing)? {
            ChunkState::Absent => match self.orphan(index) {
                Some(name) => ChunkCheck::Damaged(format!("{name}: missing, while other files of the chunk are there")),
                None => ChunkCheck::Absent,
            },
            ChunkState::Torn(name) => ChunkCheck::Damaged(format!("{}: of another bake", name.display())),
            ChunkState::Damaged(errors) => {
                ChunkCheck::Damaged(errors.first().map_or_else(|| "damaged".into(), Error::to_string))
            }
            ChunkState::Whole(_) => match self.chunk_extent(index)? {
                Some(extent) => ChunkCheck::Sound(extent),
                None => ChunkCheck::Damaged("replaced while it was read".into()),
            },
        })
    }

    /// The `transfer` shard that is missing where other files of the chunk are there.
    pub(super) fn orphan(&self, index: [usize; 3]) -> Option<String> {
        let others = (1..self.array_count()).map(|array| self.shard_key(array, index)).chain([self.extent_key(index)]);
        let is_orphan = others.into_iter().any(|key| self.backing.exists(&key));
        is_orphan.then(|| self.backing.name(&self.shard_key(0, index)).display().to_string())
    }

    /// Moves all files of a chunk out of the way, in all groups: it then counts as not baked. They are kept below
    /// `.damaged` until [`Self::clear_set_aside`].
    ///
    /// # Errors
    /// When the store is an archive or the system refuses.
    #[doc(hidden)]
    pub fn set_aside(&self, index: [usize; 3]) -> Result<()> {
        self.check_not_packed()?;
        let root = self.directory()?;
        root.check()?;
        let place = self.set_aside_folder(index)?;
        for store in self.other_groups()?.iter().rev().chain([self]) {
            // The mark of the commit first: from there on the chunk does not exist.
            let shards = (0..ARRAYS.len()).map(|array| store.shard_key(array, index));
            for key in shards.chain([store.extent_key(index)]) {
                let (from, to) = (root.path().join(&key), place.join(&key));
                let failed = |e| Error::io(&from, "set aside", e);
                if from.symlink_metadata().is_err() {
                    continue;
                }
                fs::create_dir_all(to.parent().unwrap_or(&place)).map_err(failed)?;
                match fs::rename(&from, &to) {
                    Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(failed(e)),
                    _ => {}
                }
            }
        }
        Ok(())
    }

    /// Chunks that were set aside and are not cleared yet: a run that was to bake them again was stopped.
    ///
    /// # Errors
    /// When the store is an archive.
    #[doc(hidden)]
    pub fn awaited(&self) -> Result<Vec<[usize; 3]>> {
        let entries = fs::read_dir(self.set_aside_root()?);
        let names = entries.into_iter().flatten().flatten().map(|entry| entry.file_name());
        let index = |name: &str| {
            let mut numbers = name.splitn(3, '.').map(|part| part.parse().ok());
            let (z, y, x) = (numbers.next()??, numbers.next()??, numbers.next()??);
            Some([x, y, z])
        };
        let mut found: Vec<[usize; 3]> = names.filter_map(|name| index(&name.to_string_lossy())).collect();
        found.sort_unstable();
        Ok(found)
    }

    /// Removes what was set aside of a chunk, now that it is there again.
    ///
    /// # Errors
    /// When the store is an archive or the system refuses.
    #[doc(hidden)]
    pub fn clear_set_aside(&self, index: [usize; 3]) -> Result<()> {
        let place = self.set_aside_folder(index)?;
        match fs::remove_dir_all(&place) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => return Err(Error::io(place, "remove", e)),
            _ => {}
        }
        // The folders above go with their last chunk.
        let levels = if self.surface.is_some() { 3 } else { 2 };
        for folder in place.ancestors().skip(1).take(levels) {
            let _ = fs::remove_dir(folder);
        }
        Ok(())
    }

    /// The folder of what was set aside of its volume, or of its surface.
    fn set_aside_root(&self) -> Result<PathBuf> {
        let place = match &self.surface {
            Some(_) => PathBuf::from(self.env.replacen(SURFACES, SET_ASIDE, 1)),
            None => PathBuf::from(SET_ASIDE).join(self.node()),
        };
        Ok(self.directory()?.path().join(place))
    }

    fn set_aside_folder(&self, [x, y, z]: [usize; 3]) -> Result<PathBuf> {
        Ok(self.set_aside_root()?.join(format!("{z}.{y}.{x}")))
    }

    /// Notes what is asked of the store, beside what was asked before: a damaged chunk then comes back with every
    /// isosurface that it had.
    ///
    /// # Errors
    /// When the store is an archive or the system refuses.
    #[doc(hidden)]
    pub fn ask(&self, claims: &ChunkExtent) -> Result<()> {
        // Of several processes one after the other: each rewrites what all have asked.
        let _adding = self.directory().ok().map(|directory| lock::adding(directory.path())).transpose()?;
        let mut all = self.asked()?;
        all.join(claims);
        match self.read_asked()? {
            Some(known) if known == all => Ok(()),
            _ => self.write_record(ASKED, &all.to_json()),
        }
    }

    /// What was asked of the store so far, as it was noted and as its chunks claim. What is damaged does not count.
    ///
    /// # Errors
    /// When the system refuses to read.
    #[doc(hidden)]
    pub fn asked(&self) -> Result<ChunkExtent> {
        let mut all = self.read_asked()?.unwrap_or_default();
        let [cx, cy, cz] = self.layout.lattice.chunks();
        for i in 0..cx * cy * cz {
            match self.chunk_extent(grid3::at([cx, cy], i)) {
                Ok(Some(extent)) => all.join(&extent.asked()),
                Ok(None) | Err(Error::Format { .. } | Error::Limit { .. }) => {}
                Err(other) => return Err(other),
            }
        }
        Ok(all)
    }

    /// The note alone; `None` if there is none that can be read.
    fn read_asked(&self) -> Result<Option<ChunkExtent>> {
        match self.record(ASKED) {
            Ok(record) => Ok(record.as_ref().and_then(ChunkExtent::from_json).map(|asked| asked.asked())),
            Err(Error::Format { .. } | Error::Limit { .. }) => Ok(None),
            Err(other) => Err(other),
        }
    }

    /// Whether the note of what was asked can be read, where there is one: `Some` says what is wrong.
    pub(super) fn asked_damage(&self) -> Result<Option<String>> {
        match self.record(ASKED) {
            Ok(None) => Ok(None),
            Ok(Some(record)) => {
                let wrong = ChunkExtent::from_json(&record).is_none() || record == Value::Null;
                Ok(wrong.then(|| "a note of what was asked that is not one".to_owned()))
            }
            Err(error @ (Error::Format { .. } | Error::Limit { .. })) => Ok(Some(error.to_string())),
            Err(other) => Err(other),
        }
    }
}
