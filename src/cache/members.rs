//! Bakes of the volumes of a scene, one after the other, into one store of the cache.

use super::drafts::drafts_of_texture;
use super::{Cache, Filled, Filler, Note};
use crate::bake::{ForLight, Quality, Request, Writing};
use crate::error::{Error, Result};
use crate::scene::{Member, NamedIsovalue, Scene, SceneFile};
use crate::transfer::store::Store;
use crate::volume::isovalue::Chosen;
use std::path::{Path, PathBuf};

/// Who looks at a draft.
pub type Look<'a, E> = dyn FnMut(&Filled) -> std::result::Result<(), E> + 'a;

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
        let job = self.begin(member, isovalues, lights)?;
        self.fill(member, &job)
    }

    /// Bakes all volumes of a scene, each for those of the isovalues asked for that are its own, or for all where none is asked.
    /// `filled` is told of each. With `drafts`, `look` gets them where one volume is baked for all isovalues and that takes more than a
    /// moment.
    ///
    /// # Errors
    /// Those of the bakes and of `look`; when there is no volume.
    pub fn bake_all<E: From<Error>>(
        &mut self,
        scene: &mut Scene,
        asked: &[NamedIsovalue],
        filled: &dyn Fn(&Filled),
        (drafts, look): (bool, &mut Look<'_, E>),
    ) -> std::result::Result<Filled, E> {
        let mut last = None;
        for member in scene.members_mut() {
            let chosen = self.choose(member, asked)?;
            member.take_side(&chosen)?;
            if chosen.is_empty() {
                member.check_all()?;
            }
            let isovalues = (!chosen.is_empty()).then(|| chosen.iter().map(|c| c.value).collect());
            let job = self.begin(member, isovalues, Vec::new())?;
            if drafts && job.isovalues.is_none() && !member.is_among_others() {
                for draft in drafts_of_texture(&job, &self.cache.place(&job))? {
                    let path = self.cache.place(&draft);
                    look(&self.cache.fill(&draft, &path, self.bake, self.note)?)?;
                }
            }
            let done = self.fill(member, &job)?;
            filled(&done);
            last = Some(done);
        }
        let without = || Error::argument("scene", "no volume", "at least one", "give a volume");
        let mut last = last.ok_or_else(without)?;
        if scene.members().len() > 1 {
            // The last one was filled last.
            last.store = Store::open(last.store.path())?;
        }
        Ok(last)
    }

    fn begin<'m>(&self, member: &'m Member, isovalues: Option<Vec<f64>>, lights: Vec<ForLight>) -> Result<Request<'m>>
    where
        'a: 'm,
    {
        let volume = &*member.volume;
        volume.check_cells()?;
        volume.notes.iter().for_each(|note| (self.note)(&note.text));
        let request = self.quality.request(member, isovalues, lights)?;
        // The first decides the name of the store, which proves whose it is; the others only join it.
        let writing = if self.path.is_none() { Writing::of_cache() } else { Writing::default() };
        let job = Request { writing, ..request };
        job.check_memory()?;
        job.check()?;
        Ok(job)
    }

    fn fill(&mut self, member: &Member, job: &Request<'_>) -> Result<Filled> {
        let path = self.path.get_or_insert_with(|| self.cache.place(job));
        let filled = self.cache.fill(job, path, self.bake, self.note)?;
        let name = member.is_among_others().then_some(member.volume.name.as_str());
        (self.note)(&self.cache.describe(&filled.report, name, path));
        Ok(filled)
    }
}
