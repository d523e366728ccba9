//! What a bake did.

use super::Goal;
use crate::scene::Plan;
use crate::transfer::store::ErrorTarget;
use crate::transport::{Bias, PhotonMap, Summary};
use serde::Serialize;

/// What a bake did and how long it took; seconds are those of the [`super::Observer`].
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Report {
    /// Totals over the texels that were computed.
    pub summary: Summary,
    /// Whether texels are the vertices of isosurfaces.
    pub at_vertices: bool,
    /// Chunks written.
    pub chunks_baked: usize,
    /// Chunks that had all that was asked.
    pub chunks_kept: usize,
    /// Chunks that were damaged and baked again.
    pub damaged: usize,
    /// Files of metadata and samples that were written anew.
    pub mended: usize,
    /// Rays per texel that were asked for; the most of any texel where they stop at an error.
    pub rays: u32,
    /// The standard error that texels had to reach, and of what.
    pub target: Option<ErrorTarget>,
    /// What was wanted.
    pub goal: GoalRecord,
    /// Largest albedo that is known before relighting.
    pub albedo: Option<f32>,
    /// The plan, where it was asked for.
    pub plan: Option<Plan>,
    /// Of the estimator `gather`.
    pub bias: Option<Bias>,
    /// Of the estimator `photon`.
    pub photons: Option<PhotonReport>,
    /// Until the first texel.
    pub prepare_seconds: f64,
    /// Estimation.
    pub trace_seconds: f64,
    /// Writing of chunks.
    pub write_seconds: f64,
}

/// What was wanted, for records.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct GoalRecord {
    /// Standard error of each texel.
    pub error: Option<f32>,
    /// The environment that it is measured by.
    pub for_env: Option<String>,
    /// Time allowed.
    pub seconds: Option<f64>,
}

impl GoalRecord {
    pub(super) fn of(goal: &Goal) -> Self {
        Self {
            error: goal.error,
            for_env: (!goal.lights.is_empty())
                .then(|| goal.lights.iter().map(|l| &*l.name).collect::<Vec<_>>().join(", ")),
            seconds: goal.seconds,
        }
    }
}

/// What the map of the estimator `photon` is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotonReport {
    /// Photons sent out.
    pub sent: u64,
    /// Hits kept.
    pub hits: u64,
    /// Bytes of the map.
    pub bytes: u64,
    /// Relative difference between the power sent out and what became of it.
    pub imbalance: f64,
    /// What it took.
    pub seconds: f64,
}

impl PhotonReport {
    pub(super) fn new(map: &PhotonMap, seconds: f64) -> Self {
        let (sent, hits) = (u64::from(map.settings().photons), map.len() as u64);
        Self { sent, hits, bytes: map.bytes(), imbalance: map.energy().imbalance(), seconds }
    }
}
