//! Drafts: bakes that come before one that takes more than a moment.

use crate::bake::{Goal, Request};
use crate::error::Result;
use crate::transfer::store::{Completeness, Store};
use crate::transfer::{Lattice, Layout};
use crate::transport::Settings;
use std::path::Path;

/// Rays a texel of a draft.
const DRAFT_RAYS: u32 = 16;
/// Paths from which on a bake gets a draft: a few seconds on two cores.
const DRAFT_FROM_PATHS: u64 = 1 << 23;
/// Rays a texel by which a bake with a goal is weighed that all isosurfaces share: few texels need the most that it allows.
const WEIGHED_RAYS: u32 = 256;
/// Share of the texels of a texture from which on a draft of half the resolution comes first.
const DRAFT_SHARE: f64 = 0.05;

/// The drafts of a bake into the store at `path`: one of few rays where the bake would take more than a moment, and before it one
/// of a coarser texture where the isosurfaces need many texels.
///
/// # Errors
/// As [`Request::texels_missing`].
pub fn drafts<'j>(job: &Request<'j>, path: &Path) -> Result<Vec<Request<'j>>> {
    let missing = job.texels_missing(path)?;
    let paths = missing * u64::from(job.settings.rays);
    if job.settings.rays <= DRAFT_RAYS || paths < DRAFT_FROM_PATHS {
        return Ok(Vec::new());
    }
    drafts_of(job, missing)
}

/// The drafts of a bake of all isosurfaces. Where a bake was stopped that had drafts, the last of them is there, and needs no bake of
/// its own.
///
/// # Errors
/// As [`drafts`]; when a record of the store is damaged.
pub(super) fn drafts_of_texture<'j>(job: &Request<'j>, path: &Path) -> Result<Vec<Request<'j>>> {
    let missing = job.texels_missing(path)?;
    let weighed = if job.goal.error.is_some() { WEIGHED_RAYS } else { u32::MAX };
    let paths = job.selection().len() * u64::from(job.settings.rays.min(weighed));
    if job.settings.rays <= DRAFT_RAYS || paths < DRAFT_FROM_PATHS || (missing == 0 && is_finished(job, path)?) {
        return Ok(Vec::new());
    }
    drafts_of(job, missing)
}

/// Whether the store at `path` has all isosurfaces as well as asked.
fn is_finished(job: &Request<'_>, path: &Path) -> Result<bool> {
    let store = Store::open(path)?;
    let store =
        if job.geometry.is_some_and(|g| g.among().is_some()) { store.of_volume(&job.volume.name)? } else { store };
    let is_as_good = |rays: u32, error: Option<f64>| match (job.goal.error, error) {
        (Some(asked), Some(error)) => error <= f64::from(asked),
        (None, Some(_)) => false,
        (_, None) => rays >= job.settings.rays,
    };
    let asked = store.asked()?;
    let mut of_all = asked.claims().iter().filter(|claim| claim.isovalue.is_none());
    let was_asked = of_all.any(|claim| is_as_good(claim.rays, claim.target.as_ref().map(|target| target.error)));
    let held = Completeness::of(&store, job.volume)?;
    Ok(was_asked && held.there == held.needed)
}

/// Drafts of a bake in which so many texels have nothing.
fn drafts_of<'j>(job: &Request<'j>, missing: u64) -> Result<Vec<Request<'j>>> {
    let lattice = job.layout.lattice;
    let few_rays = |layout: Layout| Request {
        settings: Settings { rays: DRAFT_RAYS, ..job.settings.clone() },
        goal: Goal::default(),
        layout,
        ..job.clone()
    };
    let mut drafts = Vec::new();
    let all: u64 = lattice.texels().iter().map(|&m| m as u64).product();
    if !job.surfaces && missing as f64 > DRAFT_SHARE * all as f64 {
        let halved = std::array::from_fn(|a| lattice.texels()[a].div_ceil(2).max(lattice.grid()[a].min(2)));
        let lattice = Lattice::from_texels(lattice.grid(), halved)?;
        drafts.push(few_rays(Layout { lattice, layers: job.layout.layers.clone() }));
    }
    drafts.push(few_rays(job.layout.clone()));
    Ok(drafts)
}
