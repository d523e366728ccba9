//! Several volumes that were baked together, lit together: one file or picture holds the surfaces of all.

use super::Relight;
use crate::bake::{Goal, Request, Writing, layout_of_scene};
use crate::cli::bake_report::Told;
use crate::cli::baking;
use crate::cli::cache::{Cache, InUse};
use crate::cli::console::Console;
use crate::cli::isovalue::{Chosen, Isovalue, NamedIsovalue};
use crate::cli::light::by_option;
use crate::cli::scene;
use crate::cli::{Failure, Outcome, options, text};
use crate::error::Result;
use crate::scene::Scene;
use crate::scene::geometry::Geometry;
use crate::session::Session;
use crate::transfer::store::Store;
use std::path::PathBuf;
use std::time::Instant;

/// The isovalue of each volume, and how the first one's came about.
pub(in crate::cli) fn resolve(session: &Session<'_>, named: &NamedIsovalue) -> Result<(Chosen, Vec<f64>)> {
    let from = named.volume.as_ref().map_or(Ok(0), |name| session.member(name)).map_err(by_option)?;
    let members = session.members();
    let of = &members[from];
    let only = match named.isovalue {
        Isovalue::Auto => {
            let held = of.store().holdings()?;
            held.isovalues.first().copied().filter(|_| !held.all)
        }
        _ => None,
    };
    let chosen = match only {
        Some(value) => Chosen { reason: Some("the store holds it".into()), ..Chosen::given(value, of.volume().solid) },
        None => named.isovalue.resolve(of.volume(), Some(of.volume().solid), None)?,
    };
    let all = session.isovalues(from, chosen.value).map_err(by_option)?;
    let reason = all.iter().zip(members).map(|(c, m)| format!("{} {}", m.name(), text::number(*c, 6)));
    let reason = reason.collect::<Vec<_>>().join(", ");
    Ok((
        Chosen {
            reason: Some(chosen.reason.map_or(reason.clone(), |r| format!("{r}; {reason}"))),
            ..Chosen::given(all[0], members[0].volume().solid)
        },
        all,
    ))
}

/// The store of a scene of several volumes, in the cache.
pub(super) struct Baked {
    pub(super) store: Store,
    /// What stands around the first of them.
    pub(super) geometry: Option<Geometry>,
    /// Rays that were traced.
    pub(super) rays: u64,
    pub(super) cache: Cache,
    pub(super) in_use: Option<InUse>,
}

/// Bakes what all volumes of a scene need for the isovalues asked for.
pub(super) fn bake(command: &Relight, scene: Scene, seed: u64, start: Instant, console: &Console) -> Outcome<Baked> {
    let transfer = &command.transfer;
    let cache = Cache::locate(command.cache.as_deref())?;
    cache.prepare()?;
    let (effects, mut path, mut found, mut rays): (_, Option<PathBuf>, _, _) = (transfer.effects(), None, None, 0);
    let mut in_use = None;
    let bands = command.scene.as_ref().and_then(scene::bands).unwrap_or(vec![5]);
    for (member, opened) in scene.members().iter().enumerate() {
        opened.volume.notes.iter().for_each(|note| console.note(&note.text));
        let volume = &*opened.volume;
        let resolve = |named: &NamedIsovalue| {
            let chosen = opened.choose_named(named.volume.as_deref(), named.isovalue);
            chosen.map_err(|e| options::in_scene(e, command.scene.as_ref(), &named.isovalue))
        };
        let isovalues = command.isovalue.iter().map(|i| Ok(resolve(i)?.value)).collect::<Result<Vec<f64>>>()?;
        let geometry = opened.geometry.as_ref();
        let layout = layout_of_scene(transfer.layout(volume, &bands)?, geometry);
        let settings = transfer.settings(&layout, seed, false);
        let job = Request {
            goal: Goal { error: transfer.error, ..Goal::default() },
            isovalues: Some(isovalues),
            memory_limit: transfer.memory_limit,
            writing: if path.is_none() { Writing::of_cache() } else { Writing::default() },
            geometry,
            ..Request::new(volume, &opened.label, layout, settings, &effects)
        };
        baking::check(&job)?;
        let path = path.get_or_insert_with(|| cache.place(&job));
        let filled = cache.fill(&job, path, start, console)?;
        rays += filled.report.summary.counts.rays;
        cache.tell(&filled.report, Some(&volume.name), path, console);
        if filled.report.chunks_baked > 0 {
            console.detail(filled.report.lines(crate::file::size_on_disk(path)));
        }
        in_use = Some(filled.in_use);
        if member == 0 {
            found = opened.geometry.clone();
        }
    }
    let Some(path) = path else { return Err(Failure::Message("a scene without volumes".into())) };
    Ok(Baked { store: Store::open(path)?, geometry: found, rays, cache, in_use })
}
