//! Several volumes that were baked together, lit together: one file or picture holds the surfaces of all.

use super::Relight;
use crate::cache::{Cache, InUse, MemberBakes, lights};
use crate::cli::baking::{details, filler};
use crate::cli::cache::{locate, prepare};
use crate::cli::console::Console;
use crate::cli::light::by_option;
use crate::cli::{Failure, Outcome};
use crate::probe::Probe;
use crate::scene::geometry::Geometry;
use crate::scene::{Scene, SceneFile};
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
    let cache = locate(command.cache.as_deref())?;
    prepare(&cache)?;
    let bands = command.scene.as_ref().map(SceneFile::bands).unwrap_or_default();
    let quality = command.transfer.quality(&bands, seed);
    let (fill, note) = (filler(start, console), |text: &str| console.note(text));
    let mut bakes = MemberBakes::new(&cache, &quality, command.scene.as_ref(), &fill, &note);
    let (mut rays, mut in_use) = (0, None);
    for member in scene.members() {
        let isovalues: Vec<f64> = bakes.choose(member, &command.isovalue)?.iter().map(|c| c.value).collect();
        let volume = &*member.volume;
        let layers = quality.layout(volume, member.geometry.as_ref())?.layers;
        let albedo = command.albedo_rule(volume.value_range())?.largest_albedo(Some(&isovalues));
        let up = command.volume.options().up_of(volume.up)?;
        let lights = lights(probes, (up, &layers), &command.light_options(true), albedo).map_err(by_option)?;
        let filled = bakes.bake(member, Some(isovalues), lights)?;
        details(&filled, console);
        rays += filled.report.summary.counts.rays;
        in_use = Some(filled.in_use);
    }
    let Some(path) = bakes.path() else { return Err(Failure::Message("a scene without volumes".into())) };
    let store = Store::open(path)?;
    let geometry = scene.members().first().and_then(|first| first.geometry.clone());
    Ok(Baked { store, geometry, rays, cache, in_use })
}
