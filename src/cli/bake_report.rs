//! What a finished bake tells of itself, for people and for machines.

use super::text;
use crate::bake::{ESCAPE, PhotonReport, Report};
use crate::transfer::store::ErrorTarget;
use crate::transport::{Bias, MOST_SPECULAR, MOST_TURNS};
use serde_json::{Value, json};
use std::time::Duration;

/// Share of paths cut among mirrors and glass from which on the user is warned.
const MOST_CUT: f64 = 1e-3;

/// Error over that aimed at from which on a goal counts as missed: the pilot that chooses where each stops sees a few thousand.
const MISSED: f64 = 1.1;

/// What a finished bake tells of itself.
pub(crate) trait Told {
    /// In a line.
    fn summary_line(&self, store_bytes: u64) -> String;
    /// As lines for people.
    fn lines(&self, store_bytes: u64) -> String;
    /// By how much the error that was aimed at is missed, where paths did not suffice.
    fn missed_goal(&self) -> Option<String>;
    /// What of the light is missing because paths were cut among mirrors and glass, where it is more than a trifle.
    fn cut_paths(&self) -> Option<String>;
    /// For machines.
    fn json(&self, store_bytes: u64) -> Value;
}

/// What was computed, in a word.
fn noun(report: &Report) -> &'static str {
    if report.at_vertices { "vertices" } else { "texels" }
}

impl Told for Report {
    fn summary_line(&self, store_bytes: u64) -> String {
        let s = &self.summary;
        if self.chunks_baked == 0 {
            return format!("nothing to bake, all {} chunks are there", self.chunks_kept);
        }
        let noise = s.escape_stderr_rms();
        let noise = if noise > 0.0 { format!("; noise {} RMS", text::number(noise, 2)) } else { String::new() };
        format!(
            "{} {}, {}rays in {}, {}{noise}",
            text::count(s.texels),
            noun(self),
            text::metric(s.counts.rays as f64),
            seconds(self.trace_seconds),
            text::bytes(store_bytes as f64),
        )
    }

    fn lines(&self, store_bytes: u64) -> String {
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
                noun(self),
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
                    "{} in {}, {}; {} paths each",
                    text::metric(s.counts.rays as f64).trim_end(),
                    seconds(self.trace_seconds),
                    text::rate(s.counts.rays as f64, duration(self.trace_seconds)),
                    text::number(s.paths as f64 / s.valid.max(1) as f64, 4)
                ),
            ),
            ("effects", effects_line(self)),
            ("bound", bound_line(self)),
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
                    "standard error of {}: 50 % of the {} ≤ {:.4}, 95 % ≤ {:.4}, all ≤ {:.4}; RMS of Σ a_k {:.4}",
                    of_text(self.target.as_ref()),
                    noun(self),
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
                    seconds(self.prepare_seconds),
                    seconds(self.trace_seconds),
                    seconds(self.write_seconds)
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
            rows.insert(1, vec!["photons".into(), photons_line(photons)]);
        }
        // Among walls the chances are not those of the volume alone.
        rows.retain(|row| !is_scene(self) || row[0] != "mean a_k");
        // Where no path reaches the environment there is no noise of it.
        rows.retain(|row| s.errors.quantile(1.0) > 0.0 || row[0] != "noise");
        text::table(&rows)
    }

    fn missed_goal(&self) -> Option<String> {
        let (target, reached) = (self.target.as_ref()?, self.summary.errors.rms());
        (reached > MISSED * target.error).then(|| {
            format!(
                "the goal of {} is missed: {} with at most {} paths each; more come from --error {} --rays N",
                text::percent(target.error),
                text::percent(reached),
                text::count(u64::from(self.rays)),
                target.error
            )
        })
    }

    fn cut_paths(&self) -> Option<String> {
        let counts = &self.summary.scene;
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

    fn json(&self, store_bytes: u64) -> Value {
        let s = &self.summary;
        json!({
            "at_vertices": self.at_vertices,
            "texels": { "asked": s.texels, "valid": s.valid, "clamped": s.clamped, "degenerate": s.degenerate },
            "rays": s.counts.rays,
            "effects": effects_json(self),
            "plan": self.plan.as_ref().map(|plan| &plan.effects),
            "rays_per_texel": self.rays,
            "bound": bound_json(self),
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
                "of": of_text(self.target.as_ref()),
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
            "bias": self.bias.as_ref().map(bias_json),
            "photons": self.photons.as_ref().map(photons_json),
            "store_bytes": store_bytes,
        })
    }
}

/// Whether something stood around the volume.
fn is_scene(report: &Report) -> bool {
    !report.summary.gains.is_empty()
}

/// The albedo that the bound is stated for.
fn albedo(report: &Report) -> f64 {
    f64::from(report.albedo.unwrap_or(0.7))
}

/// What layers beyond the stored ones can add, known now.
fn bound_line(report: &Report) -> String {
    let albedo = albedo(report);
    let (bound, error) = report.summary.bound(albedo);
    let error = error.map_or(String::new(), |error| format!(" ± {}", text::percent(error)));
    format!(
        "at albedo {albedo:.2} layers beyond the stored ones add at most {}{error} of the brightest light, in the mean; \
         the tail puts an estimate of it in",
        text::percent(bound)
    )
}

fn bound_json(report: &Report) -> Value {
    let albedo = albedo(report);
    let (bound, error) = report.summary.bound(albedo);
    json!({ "albedo": albedo, "bound": bound, "stderr": error })
}

/// First rays of all paths, and the rays that came after: bounces, and with `gather` what fills and checks its cache.
fn rays_by_effect(report: &Report) -> [u64; 2] {
    let s = &report.summary;
    match is_scene(report) {
        true => [s.paths, s.scene.path_rays.saturating_sub(s.paths + s.scene.wall_rays_started())],
        false => [s.paths, s.counts.rays.saturating_sub(s.paths)],
    }
}

fn effects_line(report: &Report) -> String {
    let [first, later] = rays_by_effect(report).map(|n| text::metric(n as f64));
    let s = &report.summary;
    if is_scene(report) {
        let c = &s.scene;
        let [walls, lights] = [c.wall_rays_started(), c.light_rays].map(|n| text::metric(n as f64));
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
fn effects_json(report: &Report) -> Value {
    let [first, later] = rays_by_effect(report);
    let s = &report.summary;
    // Where texels stop at an error, nobody knows how many they would have got.
    let counts = &s.scene;
    let saved = report.target.is_none().then(|| s.open * u64::from(report.rays));
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

fn photons_line(photons: &PhotonReport) -> String {
    format!(
        "{} sent out in {}, {} hits kept in {}",
        text::count(photons.sent),
        seconds(photons.seconds),
        text::count(photons.hits),
        text::bytes(photons.bytes as f64)
    )
}

fn photons_json(photons: &PhotonReport) -> Value {
    json!({
        "sent": photons.sent, "hits": photons.hits, "bytes": photons.bytes, "energy_imbalance": photons.imbalance,
        "seconds": photons.seconds,
    })
}

/// What the standard errors of a report are of.
fn of_text(target: Option<&ErrorTarget>) -> String {
    target.map_or("Σ a_k".into(), |t| t.of.replace(ESCAPE, "Σ a_k and a_0"))
}

fn duration(seconds: f64) -> Duration {
    Duration::from_secs_f64(seconds.max(0.0))
}

fn seconds(seconds: f64) -> String {
    text::duration(duration(seconds))
}
