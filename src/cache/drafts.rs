//! Drafts: bakes that come before one that takes more than a moment.

use crate::bake::{Goal, Request};
use crate::error::Result;
use crate::transfer::{Lattice, Layout};
use crate::transport::Settings;
use std::path::Path;

/// Rays a texel of a draft.
const DRAFT_RAYS: u32 = 16;
/// Paths from which on a bake gets a draft: a few seconds on two cores.
const DRAFT_FROM_PATHS: u64 = 1 << 23;
/// Share of the texels of a texture from which on a draft of half the resolution comes first.
const DRAFT_SHARE: f64 = 0.05;

/// The drafts of a bake into the store at `path`: one of few rays where the bake would take more than a moment, and before it one
/// of a coarser texture where the isosurfaces need many texels.
///
/// # Errors
/// As [`Request::texels_missing`].
pub fn drafts<'j>(job: &Request<'j>, path: &Path) -> Result<Vec<Request<'j>>> {
    let lattice = job.layout.lattice;
    let missing = job.texels_missing(path)?;
    let paths = missing * u64::from(job.settings.rays);
    if job.settings.rays <= DRAFT_RAYS || paths < DRAFT_FROM_PATHS {
        return Ok(Vec::new());
    }
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
