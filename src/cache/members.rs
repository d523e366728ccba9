//! Bakes of the volumes of a scene, one after the other, into one store of the cache.

use super::{Cache, Filled, Filler, Note};
use crate::bake::{ForLight, Quality, Request, Writing};
use crate::error::Result;
use crate::scene::{Member, NamedIsovalue, SceneFile};
use crate::volume::isovalue::Chosen;
use std::path::{Path, PathBuf};

/// What the bakes of all volumes have in common.
pub struct MemberBakes<'a> {
    cache: &'a Cache,
    quality: &'a Quality,
    file: Option<&'a SceneFile>,
    bake: &'a Filler<'a>,
    note: &'a Note<'a>,
    /// The store, which the first volume decides.
    path: Option<PathBuf>,
}

impl<'a> MemberBakes<'a> {
    /// Of no volume yet; `file` is the scene whose lines errors name.
    pub fn new(
        cache: &'a Cache,
        quality: &'a Quality,
        file: Option<&'a SceneFile>,
        bake: &'a Filler<'a>,
        note: &'a Note<'a>,
    ) -> Self {
        Self { cache, quality, file, bake, note, path: None }
    }

    /// The store, once the first volume was baked.
    pub fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }

    /// The isovalues of a volume that belong to those asked for.
    ///
    /// # Errors
    /// When no surface has one; names the line of the scene.
    pub fn choose(&self, member: &Member, asked: &[NamedIsovalue]) -> Result<Vec<Chosen>> {
        let choose = |named: &NamedIsovalue| {
            let chosen = member.choose_named(named.volume.as_deref(), named.isovalue);
            chosen.map_err(|e| self.file.iter().fold(e, |e, file| file.at_isovalue(named.isovalue, e)))
        };
        asked.iter().map(choose).collect()
    }

    /// Bakes a volume for these isovalues, or for all, as exactly as these lights ask (white light, if there is none).
    ///
    /// # Errors
    /// Those of the bake.
    pub fn bake(&mut self, member: &Member, isovalues: Option<Vec<f64>>, lights: Vec<ForLight>) -> Result<Filled> {
        let volume = &*member.volume;
        volume.check_cells()?;
        volume.notes.iter().for_each(|note| (self.note)(&note.text));
        let request = self.quality.request(member, isovalues, lights)?;
        // The first decides the name of the store, which proves whose it is; the others only join it.
        let writing = if self.path.is_none() { Writing::of_cache() } else { Writing::default() };
        let job = Request { writing, ..request };
        job.check_memory()?;
        job.check()?;
        let path = self.path.get_or_insert_with(|| self.cache.place(&job));
        let filled = self.cache.fill(&job, path, self.bake, self.note)?;
        let name = member.is_among_others().then_some(volume.name.as_str());
        (self.note)(&self.cache.describe(&filled.report, name, path));
        Ok(filled)
    }
}
