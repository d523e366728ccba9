//! Bakes of the volumes of a scene, one after the other, into one store of the cache.

use super::{Cache, Filled};
use crate::bake::{ForLight, Request, Writing};
use crate::cli::bake_report::Told;
use crate::cli::console::Console;
use crate::cli::isovalue::{Chosen, NamedIsovalue};
use crate::cli::options::{self, TransferArgs};
use crate::cli::{Outcome, baking};
use crate::error::Result;
use crate::file::size_on_disk;
use crate::scene::{Member, SceneFile};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// What the bakes of all volumes have in common.
pub(in crate::cli) struct MemberBakes<'a> {
    pub(in crate::cli) cache: &'a Cache,
    pub(in crate::cli) transfer: &'a TransferArgs,
    pub(in crate::cli) file: Option<&'a SceneFile>,
    pub(in crate::cli) seed: u64,
    /// The lights that errors are measured by; white light, if there is none.
    pub(in crate::cli) lights: Vec<ForLight>,
    /// When the command began.
    pub(in crate::cli) start: Instant,
    pub(in crate::cli) console: &'a Console,
    /// The store, which the first volume decides.
    path: Option<PathBuf>,
}

impl<'a> MemberBakes<'a> {
    pub(in crate::cli) fn new(
        cache: &'a Cache,
        transfer: &'a TransferArgs,
        file: Option<&'a SceneFile>,
        seed: u64,
        start: Instant,
        console: &'a Console,
    ) -> Self {
        Self { cache, transfer, file, seed, lights: Vec::new(), start, console, path: None }
    }

    /// Bands of the layers, as the scene has them.
    pub(in crate::cli) fn bands(&self) -> Vec<u8> {
        self.file.map(SceneFile::bands).unwrap_or_default()
    }

    /// The store, once the first volume was baked.
    pub(in crate::cli) fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }

    /// The isovalues of a volume that belong to those asked for.
    pub(in crate::cli) fn choose(&self, member: &Member, asked: &[NamedIsovalue]) -> Result<Vec<Chosen>> {
        let choose = |named: &NamedIsovalue| {
            let chosen = member.choose_named(named.volume.as_deref(), named.isovalue);
            chosen.map_err(|e| options::in_scene(e, self.file, &named.isovalue))
        };
        asked.iter().map(choose).collect()
    }

    /// Bakes a volume for these isovalues, or for all.
    pub(in crate::cli) fn bake(&mut self, member: &Member, isovalues: Option<Vec<f64>>) -> Outcome<Filled> {
        let volume = &*member.volume;
        volume.check_cells()?;
        volume.notes.iter().for_each(|note| self.console.note(&note.text));
        let (bands, effects) = (self.bands(), self.transfer.effects());
        let of_member = (volume, member.label.as_str(), member.geometry.as_ref());
        let job = baking::request_of_cache(
            of_member,
            self.transfer,
            &bands,
            isovalues,
            (self.seed, self.lights.clone()),
            &effects,
        )?;
        // The first decides the name of the store, which proves whose it is; the others only join it.
        let writing = if self.path.is_none() { job.writing } else { Writing::default() };
        let job = Request { writing, ..job };
        baking::check(&job)?;
        let path = self.path.get_or_insert_with(|| self.cache.place(&job));
        let filled = self.cache.fill(&job, path, self.start, self.console)?;
        let name = member.is_among_others().then_some(volume.name.as_str());
        self.cache.tell(&filled.report, name, path, self.console);
        if filled.report.chunks_baked > 0 {
            self.console.detail(filled.report.lines(size_on_disk(path)));
        }
        Ok(filled)
    }
}
