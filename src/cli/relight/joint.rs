//! Several volumes that were baked together, lit together: one file or picture holds the surfaces of all.

use super::Relight;
use super::work::lights;
use crate::bake::layout_of_scene;
use crate::cli::cache::members::MemberBakes;
use crate::cli::cache::{Cache, InUse};
use crate::cli::console::Console;
use crate::cli::{Failure, Outcome};
use crate::probe::Probe;
use crate::scene::Scene;
use crate::scene::geometry::Geometry;
use crate::transfer::store::Store;
use std::time::Instant;

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

/// Bakes what all volumes of a scene need for the isovalues asked for, as exactly as these environments ask.
pub(super) fn bake(
    command: &Relight,
    scene: Scene,
    probes: &[Probe],
    (seed, start): (u64, Instant),
    console: &Console,
) -> Outcome<Baked> {
    let cache = Cache::locate(command.cache.as_deref())?;
    cache.prepare()?;
    let mut bakes = MemberBakes::new(&cache, &command.transfer, command.scene.as_ref(), seed, start, console);
    let (mut rays, mut in_use) = (0, None);
    for member in scene.members() {
        let isovalues: Vec<f64> = bakes.choose(member, &command.isovalue)?.iter().map(|c| c.value).collect();
        let (volume, bands) = (&*member.volume, bakes.bands());
        let layers = layout_of_scene(command.transfer.layout(volume, &bands)?, member.geometry.as_ref()).layers;
        let albedo = command.albedo_rule(volume.value_range())?.largest_albedo(Some(&isovalues));
        let up = command.volume.options().up_of(volume.up)?;
        bakes.lights = lights(command, probes, (up, &layers, true), albedo)?;
        let filled = bakes.bake(member, Some(isovalues))?;
        rays += filled.report.summary.counts.rays;
        in_use = Some(filled.in_use);
    }
    let Some(path) = bakes.path() else { return Err(Failure::Message("a scene without volumes".into())) };
    let store = Store::open(path)?;
    let geometry = scene.members().first().and_then(|first| first.geometry.clone());
    Ok(Baked { store, geometry, rays, cache, in_use })
}
