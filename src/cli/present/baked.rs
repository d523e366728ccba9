//! What a finished bake tells of itself.

use crate::bake::{PhotonReport, Report};
use crate::cli::present::text;
use crate::transport::{Bias, SceneCounts};
use std::time::Duration;

/// What was computed, in a word.
fn noun(report: &Report) -> &'static str {
    if report.at_vertices { "vertices" } else { "texels" }
}

/// What a finished bake tells of itself, in a line.
pub(in crate::cli) fn summary_line(report: &Report, store_bytes: u64) -> String {
    let s = &report.summary;
    if report.chunks_baked == 0 {
        return format!("nothing to bake, all {} chunks are there", report.chunks_kept);
    }
    let noise = s.escape_stderr_rms();
    let left_out = Some(s.left_out).filter(|n| *n > 0).map(|n| format!(" and {} interpolated", text::count(n)));
    let noise = if noise > 0.0 { format!("; noise {} RMS", text::number(noise, 2)) } else { String::new() };
    format!(
        "{} {}{}, {}rays in {}, {}{noise}",
        text::count(s.texels),
        noun(report),
        left_out.unwrap_or_default(),
        text::metric(s.counts.rays as f64),
        seconds(report.trace_seconds),
        text::bytes(store_bytes as f64),
    )
}

/// The same as lines.
pub(in crate::cli) fn lines(report: &Report, store_bytes: u64) -> String {
    let s = &report.summary;
    if report.chunks_baked == 0 {
        let mended = match report.mended {
            0 => String::new(),
            n => format!("; {n} damaged files of metadata and samples were written anew"),
        };
        return format!("nothing to bake: all {} chunks are there{mended}", report.chunks_kept);
    }
    let escapes: Vec<String> = s.mean_escapes().iter().map(|a| format!("{a:.4}")).collect();
    let valid = s.valid as f64 / s.texels.max(1) as f64;
    let clamped = s.clamped as f64 / s.valid.max(1) as f64;
    let rows = [
        (
            noun(report),
            format!(
                "{} asked, {} left out, {} valid ({}), {} clamped ({})",
                text::count(s.texels),
                text::count(s.left_out),
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
                seconds(report.trace_seconds),
                text::rate(s.counts.rays as f64, duration(report.trace_seconds)),
                text::number(s.paths as f64 / s.valid.max(1) as f64, 4)
            ),
        ),
        ("effects", effects_line(report)),
        ("bound", bound_line(report)),
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
                report.error_of(),
                noun(report),
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
                seconds(report.prepare_seconds),
                seconds(report.trace_seconds),
                seconds(report.write_seconds)
            ),
        ),
        (
            "store",
            format!(
                "{} chunks written, {} kept, {}",
                report.chunks_baked,
                report.chunks_kept,
                text::bytes(store_bytes as f64)
            ),
        ),
    ];
    let mut rows: Vec<_> = rows.into_iter().map(|(name, value)| vec![name.to_string(), value]).collect();
    if let Some(bias) = &report.bias {
        rows.insert(7, vec!["bias".into(), bias_line(bias, report.bias_of())]);
    }
    if let Some(photons) = &report.photons {
        rows.insert(1, vec!["photons".into(), photons_line(photons)]);
    }
    // Among walls the chances are not those of the volume alone.
    rows.retain(|row| !report.is_scene() || row[0] != "mean a_k");
    // Where no path reaches the environment there is no noise of it.
    rows.retain(|row| s.errors.quantile(1.0) > 0.0 || row[0] != "noise");
    text::table(&rows)
}

/// What layers beyond the stored ones can add, known now.
fn bound_line(report: &Report) -> String {
    let albedo = report.known_albedo();
    let (bound, error) = report.summary.bound(albedo);
    let error = error.map_or(String::new(), |error| format!(" ± {}", text::percent(error)));
    format!(
        "at albedo {albedo:.2} layers beyond the stored ones add at most {}{error} of the brightest light, in the mean; \
         the tail puts an estimate of it in",
        text::percent(bound)
    )
}

/// Rays that went through media, and meetings with them.
fn counts_of_media(c: &SceneCounts) -> u64 {
    c.medium_rays + c.collisions
}

fn effects_line(report: &Report) -> String {
    let [first, later] = report.rays_by_effect().map(|n| text::metric(n as f64));
    let s = &report.summary;
    if report.is_scene() {
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
        let in_media = match counts_of_media(c) {
            0 => String::new(),
            _ => format!(
                "media {}rays, {}collisions; ",
                text::metric(c.medium_rays as f64),
                text::metric(c.collisions as f64)
            ),
        };
        let among_mirrors = match c.lost_specular + c.lost_turns {
            0 => String::new(),
            lost => format!(", {} were cut among mirrors and glass", text::count(lost)),
        };
        return format!(
            "shadowing {first}rays, interreflection {later}rays, walls {walls}rays, luminaires {lights}rays; {partners}{in_media}{} \
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

/// What is known of the bias of `gather`.
fn bias_line(b: &Bias, light: &str) -> String {
    if b.texels == 0 {
        return "none: without a cache gather is path".into();
    }
    let relative = |figure: f64| text::percent(b.relative(figure));
    format!(
        "radiance under {light}, albedo 0.7, against path in {} texels: mean {:+.3} ± {:.3} %, RMS over texels {} \
         (95 %: at most {})",
        text::count(b.texels),
        100.0 * b.relative(b.mean),
        100.0 * b.relative(b.mean_stderr),
        relative(b.rms()),
        relative(b.rms_at_most()),
    )
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

fn duration(seconds: f64) -> Duration {
    Duration::from_secs_f64(seconds.max(0.0))
}

fn seconds(seconds: f64) -> String {
    text::duration(duration(seconds))
}
