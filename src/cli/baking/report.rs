//! What a bake tells of itself.

use super::super::text;
use super::Report;
use crate::transport::{Bias, MOST_SPECULAR, MOST_TURNS, PhotonMap};
use serde_json::{Value, json};
use std::time::Duration;

/// Share of paths cut among mirrors and glass from which on the user is warned.
const MOST_CUT: f64 = 1e-3;

/// What the map of the estimator `photon` is.
pub(in super::super) struct Photons {
    sent: u64,
    hits: u64,
    bytes: u64,
    imbalance: f64,
    time: Duration,
}

impl Photons {
    pub(super) fn new(map: &PhotonMap, time: Duration) -> Self {
        let (sent, hits) = (u64::from(map.settings().photons), map.len() as u64);
        Self { sent, hits, bytes: map.bytes(), imbalance: map.energy().imbalance(), time }
    }

    fn in_words(&self) -> String {
        format!(
            "{} sent out in {}, {} hits kept in {}",
            text::count(self.sent),
            text::duration(self.time),
            text::count(self.hits),
            text::bytes(self.bytes as f64)
        )
    }

    fn json(&self) -> Value {
        json!({
            "sent": self.sent, "hits": self.hits, "bytes": self.bytes, "energy_imbalance": self.imbalance,
            "seconds": self.time.as_secs_f64(),
        })
    }
}

impl Report {
    /// The report in a line.
    pub(in super::super) fn summary_line(&self, store_bytes: u64) -> String {
        let s = &self.summary;
        if self.chunks_baked == 0 {
            return format!("nothing to bake, all {} chunks are there", self.chunks_kept);
        }
        let noise = s.escape_stderr_rms();
        let noise = if noise > 0.0 { format!("; noise {} RMS", text::number(noise, 2)) } else { String::new() };
        format!(
            "{} texels, {}rays in {}, {}{noise}",
            text::count(s.texels),
            text::metric(s.counts.rays as f64),
            text::duration(self.trace),
            text::bytes(store_bytes as f64),
        )
    }

    /// The report as lines for people.
    pub(in super::super) fn lines(&self, store_bytes: u64) -> String {
        let s = &self.summary;
        if self.chunks_baked == 0 {
            let mended = match self.mended {
                0 => String::new(),
                n => format!("; {n} damaged files of metadata and samples were written anew"),
            };
            return format!("nothing to bake: all {} chunks are there{mended}", self.chunks_kept);
        }
        let escapes: Vec<String> = s.mean_escapes().iter().map(|a| format!("{a:.4}")).collect();
        let valid = s.valid as f64 / s.texels.max(1) as f64;
        let clamped = s.clamped as f64 / s.valid.max(1) as f64;
        let rows = [
            (
                "texels",
                format!(
                    "{} asked, {} valid ({}), {} clamped ({})",
                    text::count(s.texels),
                    text::count(s.valid),
                    text::percent(valid),
                    text::count(s.clamped),
                    text::percent(clamped)
                ),
            ),
            (
                "rays",
                format!(
                    "{} in {}, {}; {} paths a texel",
                    text::metric(s.counts.rays as f64).trim_end(),
                    text::duration(self.trace),
                    text::rate(s.counts.rays as f64, self.trace),
                    text::number(s.paths as f64 / s.valid.max(1) as f64, 4)
                ),
            ),
            ("effects", self.effects_line()),
            ("bound", self.bound_line()),
            (
                "paths",
                format!(
                    "{}: {} lost in the solid, {} still travelling after the last layer",
                    text::metric(s.paths as f64).trim_end(),
                    text::percent(s.lost_share()),
                    text::percent(s.trapped as f64 / s.paths.max(1) as f64)
                ),
            ),
            ("mean a_k", format!("{}  (chance to escape after exactly k bounces)", escapes.join("  "))),
            (
                "noise",
                format!(
                    "standard error of {}: 50 % of texels ≤ {:.4}, 95 % ≤ {:.4}, all ≤ {:.4}; RMS of Σ a_k {:.4}",
                    self.error_of,
                    s.errors.quantile(0.5),
                    s.errors.quantile(0.95),
                    s.errors.quantile(1.0),
                    s.escape_stderr_rms()
                ),
            ),
            (
                "time",
                format!(
                    "prepare {}, trace {}, write {}",
                    text::duration(self.prepare),
                    text::duration(self.trace),
                    text::duration(self.write)
                ),
            ),
            (
                "store",
                format!(
                    "{} chunks written, {} kept, {}",
                    self.chunks_baked,
                    self.chunks_kept,
                    text::bytes(store_bytes as f64)
                ),
            ),
        ];
        let mut rows: Vec<_> = rows.into_iter().map(|(name, value)| vec![name.to_string(), value]).collect();
        if let Some(bias) = &self.bias {
            rows.insert(7, vec!["bias".into(), bias_line(bias)]);
        }
        if let Some(photons) = &self.photons {
            rows.insert(1, vec!["photons".into(), photons.in_words()]);
        }
        // Among walls the chances are not those of the volume alone.
        rows.retain(|row| self.scene.is_none() || row[0] != "mean a_k");
        // Where no path reaches the environment there is no noise of it.
        rows.retain(|row| s.errors.quantile(1.0) > 0.0 || row[0] != "noise");
        text::table(&rows)
    }

    /// What of the light is missing because paths were cut among mirrors and glass, where it is more than a trifle.
    pub(super) fn warning(&self) -> Option<String> {
        let counts = &self.scene.as_ref()?.counts;
        let share = (counts.lost_specular + counts.lost_turns) as f64 / self.summary.paths.max(1) as f64;
        (share > MOST_CUT).then(|| {
            format!(
                "{} of the paths were cut, {} after {MOST_SPECULAR} mirrors and glass in a row, {} after {MOST_TURNS} turns: \
                 their light is missing; open the mirrors to the light, or lower their share",
                text::percent(share),
                text::count(counts.lost_specular),
                text::count(counts.lost_turns)
            )
        })
    }

    /// The albedo that the bound is stated for.
    fn albedo(&self) -> f64 {
        f64::from(self.albedo.unwrap_or(0.7))
    }

    /// What layers beyond the stored ones can add, known now.
    fn bound_line(&self) -> String {
        let albedo = self.albedo();
        let (bound, error) = match &self.scene {
            Some(scene) => (scene.bound(albedo), String::new()),
            None => {
                let (bound, error) = self.summary.bound(albedo);
                (bound, format!(" ± {}", text::percent(error)))
            }
        };
        format!(
            "at albedo {albedo:.2} layers beyond the stored ones add at most {}{error} of the brightest light, in the mean; \
             the tail puts an estimate of it in",
            text::percent(bound)
        )
    }

    fn bound_json(&self) -> Value {
        let albedo = self.albedo();
        let (bound, error) = match &self.scene {
            Some(scene) => (scene.bound(albedo), None),
            None => (self.summary.bound(albedo).0, Some(self.summary.bound(albedo).1)),
        };
        json!({ "albedo": albedo, "bound": bound, "stderr": error })
    }

    /// First rays of all paths, and the rays that came after: bounces, and with `gather` what fills and checks its cache.
    fn rays_by_effect(&self) -> [u64; 2] {
        let s = &self.summary;
        match &self.scene {
            Some(scene) => [s.paths, scene.counts.path_rays.saturating_sub(s.paths + scene.counts.wall_rays_started())],
            None => [s.paths, s.counts.rays.saturating_sub(s.paths)],
        }
    }

    fn effects_line(&self) -> String {
        let [first, later] = self.rays_by_effect().map(|n| text::metric(n as f64));
        let s = &self.summary;
        if let Some(scene) = &self.scene {
            let [walls, lights] =
                [scene.counts.wall_rays_started(), scene.counts.light_rays].map(|n| text::metric(n as f64));
            let c = &scene.counts;
            let partners = match c.partner_rays + c.buried {
                0 => String::new(),
                _ => format!(
                    "other volumes {}rays and {}meetings, {} texels inside them; ",
                    text::metric(c.partner_rays as f64),
                    text::metric(c.partner_hits as f64),
                    text::count(c.buried)
                ),
            };
            let among_mirrors = match c.lost_specular + c.lost_turns {
                0 => String::new(),
                lost => format!(", {} were cut among mirrors and glass", text::count(lost)),
            };
            return format!(
                "shadowing {first}rays, interreflection {later}rays, walls {walls}rays, luminaires {lights}rays; {partners}{} \
                 paths ended on a cut through the solid{among_mirrors}",
                text::count(c.cut)
            );
        }
        let open = s.open as f64 / s.valid.max(1) as f64;
        format!(
            "shadowing {}rays, interreflection {}rays; {} texels cannot be shaded ({}): closed form, no rays",
            first,
            later,
            text::count(s.open),
            text::percent(open)
        )
    }

    /// Work by effect. What is off has counters all the same: they are 0.
    fn effects_json(&self) -> Value {
        let [first, later] = self.rays_by_effect();
        let s = &self.summary;
        // Where texels stop at an error, nobody knows how many they would have got.
        let counts = self.scene.as_ref().map(|scene| scene.counts).unwrap_or_default();
        let saved = self.error.is_none().then(|| s.open * u64::from(self.rays));
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
            "media": { "rays": 0 },
            "sun-split": { "rays": 0 },
        })
    }

    /// The report for machines.
    pub(in super::super) fn json(&self, store_bytes: u64) -> Value {
        let s = &self.summary;
        json!({
            "texels": { "asked": s.texels, "valid": s.valid, "clamped": s.clamped, "degenerate": s.degenerate },
            "rays": s.counts.rays,
            "effects": self.effects_json(),
            "plan": self.plan.as_ref().map(|plan| &plan.effects),
            "rays_per_texel": self.rays,
            "bound": self.bound_json(),
            "error_target": self.error,
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
                "of": self.error_of,
                "rms": s.escape_stderr_rms(),
            },
            "seconds": {
                "prepare": self.prepare.as_secs_f64(),
                "trace": self.trace.as_secs_f64(),
                "write": self.write.as_secs_f64(),
            },
            "mrays_per_second": s.counts.rays as f64 / self.trace.as_secs_f64().max(1e-9) / 1e6,
            "chunks": { "baked": self.chunks_baked, "kept": self.chunks_kept },
            "bias": self.bias.as_ref().map(bias_json),
            "photons": self.photons.as_ref().map(Photons::json),
            "store_bytes": store_bytes,
        })
    }
}

/// What is known of the bias of `gather`.
fn bias_line(b: &Bias) -> String {
    if b.texels == 0 {
        return "none: without a cache gather is path".into();
    }
    let relative = |figure: f64| text::percent(b.relative(figure));
    format!(
        "radiance under constant light, albedo 0.7, against path in {} texels: mean {:+.3} ± {:.3} %, RMS over texels {} \
         (95 %: at most {})",
        text::count(b.texels),
        100.0 * b.relative(b.mean),
        100.0 * b.relative(b.mean_stderr),
        relative(b.rms()),
        relative(b.rms_at_most()),
    )
}

fn bias_json(b: &Bias) -> Value {
    json!({
        "texels": b.texels,
        "mean": b.relative(b.mean),
        "mean_stderr": b.relative(b.mean_stderr),
        "rms": b.relative(b.rms()),
        "rms_at_most": b.relative(b.rms_at_most()),
    })
}
