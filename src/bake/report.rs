//! What a bake did.

use super::{ESCAPE, Goal};
use crate::quantity;
use crate::scene::Plan;
use crate::transfer::store::ErrorTarget;
use crate::transport::{Bias, MOST_SPECULAR, MOST_TURNS, PhotonMap, Summary};
use serde::Serialize;
use serde_json::{Value, json};

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

/// Share of paths cut among mirrors and glass from which on the user is warned.
const MOST_CUT: f64 = 1e-3;

/// Error over that aimed at from which on a goal counts as missed: the pilot that chooses where each stops sees a few thousand.
const MISSED: f64 = 1.1;

impl Report {
    /// Whether something stood around the volume.
    #[doc(hidden)]
    pub fn is_scene(&self) -> bool {
        !self.summary.gains.is_empty()
    }

    /// The albedo that the bound is stated for.
    #[doc(hidden)]
    pub fn known_albedo(&self) -> f64 {
        f64::from(self.albedo.unwrap_or(0.7))
    }

    /// What the standard errors are of.
    #[doc(hidden)]
    pub fn error_of(&self) -> String {
        self.target.as_ref().map_or("Σ a_k".into(), |t| t.of.replace(ESCAPE, "Σ a_k and a_0"))
    }

    /// The light that the bias is told under.
    #[doc(hidden)]
    pub fn bias_of(&self) -> &'static str {
        if self.summary.gains.len() > 1 { "the luminaires" } else { "constant light" }
    }

    /// By how much the error that was aimed at is missed, where paths did not suffice.
    #[doc(hidden)]
    pub fn missed_goal(&self) -> Option<String> {
        let (target, reached) = (self.target.as_ref()?, self.summary.errors.rms());
        (reached > MISSED * target.error).then(|| {
            format!(
                "the goal of {} is missed: {} with at most {} paths each; more come from --error {} --rays N",
                quantity::percent(target.error),
                quantity::percent(reached),
                quantity::count(u64::from(self.rays)),
                target.error
            )
        })
    }

    /// What of the light is missing because paths were cut among mirrors and glass, where it is more than a trifle.
    #[doc(hidden)]
    pub fn cut_paths(&self) -> Option<String> {
        let counts = &self.summary.scene;
        let share = (counts.lost_specular + counts.lost_turns) as f64 / self.summary.paths.max(1) as f64;
        (share > MOST_CUT).then(|| {
            format!(
                "{} of the paths were cut, {} after {MOST_SPECULAR} mirrors and glass in a row, {} after {MOST_TURNS} turns: \
                 their light is missing; open the mirrors to the light, or lower their share",
                quantity::percent(share),
                quantity::count(counts.lost_specular),
                quantity::count(counts.lost_turns)
            )
        })
    }

    /// First rays of all paths, and the rays that came after: bounces, and with `gather` what fills and checks its cache.
    #[doc(hidden)]
    pub fn rays_by_effect(&self) -> [u64; 2] {
        let s = &self.summary;
        match self.is_scene() {
            true => [s.paths, s.scene.path_rays.saturating_sub(s.paths + s.scene.wall_rays_started())],
            false => [s.paths, s.counts.rays.saturating_sub(s.paths)],
        }
    }

    /// For programs, with the bytes of the store.
    #[doc(hidden)]
    pub fn to_json(&self, store_bytes: u64) -> Value {
        let s = &self.summary;
        json!({
            "at_vertices": self.at_vertices,
            "texels": { "asked": s.texels, "left_out": s.left_out, "valid": s.valid, "clamped": s.clamped, "degenerate": s.degenerate },
            "rays": s.counts.rays,
            "effects": self.effects_json(),
            "plan": self.plan.as_ref().map(|plan| &plan.effects),
            "rays_per_texel": self.rays,
            "bound": self.bound_json(),
            "error_target": self.target.as_ref().map(|t| t.error),
            "goal": self.goal,
            "counts": { "nodes": s.counts.nodes, "cells": s.counts.cells, "solves": s.counts.solves },
            "paths": s.paths,
            "lost_share": s.lost_share(),
            "trapped_share": s.trapped as f64 / s.paths.max(1) as f64,
            "mean_escapes": s.mean_escapes(),
            "escape_stderr": {
                "p50": s.errors.quantile(0.5),
                "p95": s.errors.quantile(0.95),
                "p100": s.errors.quantile(1.0),
                "of": self.error_of(),
                "rms": s.escape_stderr_rms(),
            },
            "seconds": {
                "prepare": self.prepare_seconds,
                "trace": self.trace_seconds,
                "write": self.write_seconds,
            },
            "mrays_per_second": s.counts.rays as f64 / self.trace_seconds.max(1e-9) / 1e6,
            "chunks": { "baked": self.chunks_baked, "kept": self.chunks_kept, "damaged": self.damaged },
            "mended_files": self.mended,
            "bias": self.bias.as_ref().map(|bias| bias_json(bias, self.bias_of())),
            "photons": self.photons.as_ref().map(photons_json),
            "store_bytes": store_bytes,
        })
    }

    fn bound_json(&self) -> Value {
        let albedo = self.known_albedo();
        let (bound, error) = self.summary.bound(albedo);
        json!({ "albedo": albedo, "bound": bound, "stderr": error })
    }

    /// Work by effect. What is off has counters all the same: they are 0.
    fn effects_json(&self) -> Value {
        let [first, later] = self.rays_by_effect();
        let s = &self.summary;
        // Where texels stop at an error, nobody knows how many they would have got.
        let counts = &s.scene;
        let saved = self.target.is_none().then(|| s.open * u64::from(self.rays));
        json!({
            "shadowing": { "rays": first, "open_texels": s.open, "first_rays_saved": saved },
            "interreflection": { "rays": later },
            "emission": { "rays": 0 },
            "walls": { "rays": counts.wall_rays_started(), "hits": counts.wall_hits, "tests": counts.wall_rays },
            "coupling": {
                "rays": counts.partner_rays, "hits": counts.partner_hits, "buried_texels": counts.buried,
            },
            "luminaires": { "rays": counts.light_rays, "hits": counts.luminaire_hits },
            "caustics": {
                "photons": 0, "specular_hits": counts.specular_hits,
                "lost_specular": counts.lost_specular, "lost_turns": counts.lost_turns,
            },
            "media": {
                "rays": counts.medium_rays, "cells": counts.medium_cells, "collisions": counts.collisions,
                "entries": counts.entries,
            },
            "sun-split": { "rays": 0 },
        })
    }
}

fn bias_json(b: &Bias, of: &str) -> Value {
    json!({
        "texels": b.texels,
        "of": of,
        "mean": b.relative(b.mean),
        "mean_stderr": b.relative(b.mean_stderr),
        "rms": b.relative(b.rms()),
        "rms_at_most": b.relative(b.rms_at_most()),
    })
}

fn photons_json(photons: &PhotonReport) -> Value {
    json!({
        "sent": photons.sent, "hits": photons.hits, "bytes": photons.bytes, "energy_imbalance": photons.imbalance,
        "seconds": photons.seconds,
    })
}
