//! What is printed about a run, for people and for programs.

use super::Relit;
use super::file::Written;
use crate::cli::console::Console;
use crate::cli::output::Format;
use crate::cli::text;
use crate::relight::{ErrorTerm, TotalError};
use crate::session::{MeshFile, lightmap_json, simplified_json, total_json};
use serde_json::{Value, json};
use std::time::Duration;

/// Share of a surface below a texel from which on it is told.
const MOST_BELOW_A_TEXEL: f64 = 0.05;
/// Noise over the mean from which on spots show.
const MOST_NOISE: f64 = 0.15;

/// What is in a mesh file, and how far it is off the isosurface.
pub(super) fn mesh(made: &MeshFile, format: Format) -> String {
    let mut what = format!("{} vertices", text::count(made.vertices as u64));
    if matches!(format, Format::Glb | Format::Usdz) {
        let [x, y, z] = made.size_in_metres.map(|side| text::number(side, 3));
        what += &format!(", {x} × {y} × {z} m");
    }
    if let Some(error) = made.simplification {
        what += &format!(
            ", {} of {} triangles: at most {} off ({} of its longest side, RMS {}), colours {:.2} of 255",
            text::count(made.triangles as u64),
            text::count(made.triangles_of_isosurface as u64),
            text::number(error.largest, 2),
            text::percent(error.relative),
            text::number(error.rms, 2),
            255.0 * error.colour_rms
        );
        if error.pieces_left_out > 0 {
            let (count, size) =
                (text::count(error.pieces_left_out as u64), text::number(error.largest_piece_left_out, 2));
            what += &format!("; {count} pieces of at most {size} left out");
        }
    }
    if let Some(map) = made.lightmap {
        what += &format!(
            ", {0} × {0} texels in {1} charts, colours at the vertices {2:.2} of 255, across seams {3:.2}",
            text::count(u64::from(map.side)),
            text::count(map.charts as u64),
            255.0 * map.colour_rms,
            255.0 * map.seams
        );
    }
    if let Some(error) = made.position_error {
        what += &format!(", positions rounded by at most {}", text::number(error, 2));
    }
    what
}

/// A relative error; black vertices have none.
fn relative(error: f64) -> String {
    if error.is_finite() { text::percent(error) } else { "-".into() }
}

/// JSON has no infinity: it becomes null.
fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// The files and a line of summary, for people.
fn print(console: &Console, relit: &Relit) {
    let Relit { surfaces, files: written, read_time, transport_rays, .. } = relit;
    for w in written {
        let what = format!("{}, {}", w.what, text::bytes(w.bytes as f64));
        console.summary(text::file_line(&w.target.path, &what));
    }
    let time: Duration = written.iter().map(|w| w.times.total()).sum();
    let worst = written.iter().max_by(|a, b| error_of(a).total_cmp(&error_of(b)));
    console.summary(match (written.as_slice(), worst) {
        ([w], _) => format!(
            "isovalue {}, {}: {}; exposure {:+.2} EV; {}",
            text::number(w.isovalue, 6),
            w.env,
            error_text(w),
            w.exposure_ev,
            text::duration(time)
        ),
        (all, Some(worst)) => {
            format!("{} files in {}: {} or better", all.len(), text::duration(time), error_text(worst))
        }
        (_, None) => "no file".into(),
    });
    for s in surfaces {
        console.detail(format!("\nisovalue {}", text::number(s.isovalue, 6)));
        let found = format!(
            "{} vertices, {} triangles, {} bricks of {}",
            text::count(s.vertices),
            text::count(s.triangles),
            text::count(s.bricks),
            if s.at_vertices { "vertices" } else { "texels of the texture" },
        );
        let times = format!("extract {}, select {}", text::duration(s.extract_time), text::duration(s.select_time));
        console.detail(text::table(&[vec!["surface".into(), found], vec!["time".into(), times]]));
    }
    for w in written {
        console.detail(format!("\n{}\n{}", w.target.path.display(), details(w)));
    }
    let camera_rays: u64 = written.iter().map(|w| w.camera.rays).sum();
    console.detail(format!(
        "\nread {}; transport rays {}, camera rays {}, sun rays {}",
        text::duration(*read_time),
        text::count(*transport_rays),
        text::count(camera_rays),
        text::count(written.iter().map(|w| w.sun_rays).sum())
    ));
}

/// The number that a file is judged by: its whole error, else its noise.
fn error_of(w: &Written) -> f64 {
    w.total.map_or(w.rms_over_mean, |total| total.rms)
}

/// How far a file is from exact light transport, in short.
fn error_text(w: &Written) -> String {
    let whole = match w.total {
        Some(total) => format!("within {} (95 %: {})", text::percent(total.rms), text::percent(total.percentile_95)),
        None => format!("noise {} of the mean", text::percent(w.rms_over_mean)),
    };
    match w.node_error {
        Some(error) => format!("{whole}, the albedo of the medium {}", text::percent(error)),
        None => whole,
    }
}

/// Where the error comes from.
fn parts_of_error(total: &TotalError, at_vertices: bool) -> String {
    let term = |name: &str, term: ErrorTerm| {
        format!("{name} {} (at most {})", text::percent(term.rms), text::percent(term.upper))
    };
    let texture = if at_vertices { "between the vertices" } else { "texture" };
    let mut parts = vec![format!("noise {}", text::percent(total.noise.rms)), term(texture, total.texture)];
    match total.truncation {
        Some(truncation) => parts.push(term("light above the bands", truncation)),
        None => parts.push("light above the bands not known".into()),
    }
    format!("RMS over the mean radiance: {}; from {} check points", parts.join(", "), total.points)
}

/// One file in detail.
fn details(w: &Written) -> String {
    let mut times = vec![("contract", w.times.contract), ("look up", w.times.look_up)];
    times.extend((w.target.format == Format::Png).then_some(("render", w.times.render)));
    times.push(("write", w.times.write));
    let times: Vec<String> = times.into_iter().map(|(name, time)| format!("{name} {}", text::duration(time))).collect();
    let noise = format!(
        "standard error of the radiance: RMS over the vertices {} of its mean; of the vertices' own, median {}, 95 % at \
         most {}",
        text::percent(w.rms_over_mean),
        relative(w.error.median),
        relative(w.error.percentile_95),
    );
    let lookups = format!(
        "{}: {} renormalised, {} from the neighbourhood, {} unoccluded, {} unbaked",
        text::count(w.report.lookups),
        text::count(w.report.renormalised),
        text::count(w.report.neighbourhood),
        text::count(w.report.unoccluded),
        text::count(w.report.unbaked),
    );
    let light = format!("{}, isovalue {}, exposure {:+.2} EV", w.env, text::number(w.isovalue, 6), w.exposure_ev);
    let mut rows = vec![("light", light), ("noise", noise), ("lookups", lookups), ("time", times.join(", "))];
    if let Some(total) = &w.total {
        rows.insert(1, ("error", format!("{}; {}", error_text(w), parts_of_error(total, w.at_vertices))));
    }
    let rows: Vec<Vec<String>> = rows.into_iter().map(|(name, text)| vec![name.to_string(), text]).collect();
    text::table(&rows)
}

pub(super) fn report(console: &Console, relit: &Relit) {
    let Relit { surfaces, files: written, read_time, transport_rays, drafts } = relit;
    let camera_rays: u64 = written.iter().map(|w| w.camera.rays).sum();
    print(console, relit);
    for s in surfaces.iter().filter(|s| s.below_a_texel > MOST_BELOW_A_TEXEL) {
        console.note(format!(
            "isovalue {}: {} of the surface bends within a texel or is a shell thinner than one, which may show as scales; a \
             finer --texture (1 is that of the data) resolves it",
            text::number(s.isovalue, 6),
            text::percent(s.below_a_texel)
        ));
    }
    let noisiest = written.iter().max_by(|a, b| a.rms_over_mean.total_cmp(&b.rms_over_mean));
    if let Some(w) = noisiest.filter(|w| w.rms_over_mean > MOST_NOISE) {
        console.note(format!(
            "{}: noise is {} of the mean radiance and may show as spots; four times as many --rays halve it",
            w.target.path.display(),
            text::percent(w.rms_over_mean)
        ));
    }
    let ringing: Vec<&Written> = written.iter().filter(|w| w.negative > 0).collect();
    if let Some(worst) = ringing.iter().max_by_key(|w| w.negative) {
        let (path, count) = (worst.target.path.display(), text::count(worst.negative));
        let others = match ringing.len() {
            1 => String::new(),
            n => format!(" and fewer in {} other files", n - 1),
        };
        console.note(format!(
            "{path}: {count} vertices{others} have a negative channel (ringing of the band-limited light), shown in \
             their hue as far as they have light; --window softens it"
        ));
    }
    for w in written {
        for note in &w.notes {
            console.note(note);
        }
        if w.remainder > 0.0 {
            console.note(format!(
                "{}: albedo 1 with emission has no end; up to {:.3} of the emission per further bounce is left out",
                w.target.path.display(),
                w.remainder
            ));
        }
    }
    console.print_json(&json!({
        "surfaces": surfaces.iter().map(|s| json!({
            "isovalue": s.isovalue,
            "vertices": s.vertices,
            "triangles": s.triangles,
            "bricks": s.bricks,
            "at_vertices": s.at_vertices,
            "seconds": { "extract": s.extract_time.as_secs_f64(), "select": s.select_time.as_secs_f64() },
        })).collect::<Vec<_>>(),
        "files": written.iter().map(file_json).collect::<Vec<_>>(),
        "seconds": { "read": read_time.as_secs_f64() },
        "drafts": drafts.iter().map(|d| json!({
            "rays_per_texel": d.rays, "texels": d.texture, "written_after_seconds": d.written_after.as_secs_f64(),
        })).collect::<Vec<_>>(),
        "transport_rays": transport_rays,
        "camera_rays": camera_rays,
        "sun_rays": written.iter().map(|w| w.sun_rays).sum::<u64>(),
    }));
}

fn mesh_json(made: &MeshFile) -> Value {
    json!({
        "vertices": made.vertices, "triangles": made.triangles, "size_in_metres": made.size_in_metres,
        "simplified": made.simplification.as_ref().map(simplified_json), "largest_position_error": made.position_error,
        "lightmap": made.lightmap.as_ref().map(lightmap_json),
    })
}

fn file_json(w: &Written) -> Value {
    json!({
        "path": w.target.path.display().to_string(),
        "isovalue": w.isovalue,
        "environment": w.env,
        "bytes": w.bytes,
        "mesh": w.mesh.as_ref().map(mesh_json),
        "exposure_ev": w.exposure_ev,
        "error": {
            "rms_over_mean": w.rms_over_mean,
            "medium_albedo_error": w.node_error,
            "median_relative": finite(w.error.median),
            "percentile_95_relative": finite(w.error.percentile_95),
        },
        "total_error": w.total.as_ref().map(total_json),
        "negative_vertices": w.negative, "sun_rays": w.sun_rays, "light_notes": w.notes,
        "emission_remainder": w.remainder,
        "lookups": {
            "all": w.report.lookups, "renormalised": w.report.renormalised,
            "neighbourhood": w.report.neighbourhood, "unoccluded": w.report.unoccluded,
            "unbaked": w.report.unbaked,
        },
        "seconds": {
            "contract": w.times.contract.as_secs_f64(), "look_up": w.times.look_up.as_secs_f64(),
            "render": w.times.render.as_secs_f64(), "write": w.times.write.as_secs_f64(),
        },
    })
}
