//! What is printed about a run, for people and for programs.

use super::Relit;
use super::file::Written;
use crate::cli::console::Console;
use crate::cli::output::Format;
use crate::cli::text;
use crate::relight::LookupReport;
use serde_json::{Value, json};

/// A relative error; black vertices have none.
fn relative(error: f64) -> String {
    if error.is_finite() { text::percent(error) } else { "-".into() }
}

/// JSON has no infinity: it becomes null.
pub(super) fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

pub(super) fn report(console: &Console, relit: &Relit) {
    let Relit { surfaces, files: written, read_time, transport_rays, drafts } = relit;
    let camera_rays: u64 = written.iter().map(|w| w.camera.rays).sum();
    let mut rows = vec![
        [
            "file",
            "isovalue",
            "environment",
            "contract",
            "look up",
            "render",
            "write",
            "EV",
            "error",
            "median",
            "95 %",
            "size",
        ]
        .map(String::from)
        .to_vec(),
    ];
    for w in written {
        rows.push(vec![
            w.target.path.display().to_string(),
            text::number(w.isovalue, 6),
            w.env.clone(),
            text::duration(w.times.contract),
            text::duration(w.times.look_up),
            if w.target.format == Format::Png { text::duration(w.times.render) } else { "-".into() },
            text::duration(w.times.write),
            format!("{:+.2}", w.exposure.log2()),
            text::percent(w.rms_over_mean),
            relative(w.error.median),
            relative(w.error.percentile_95),
            text::bytes(w.bytes as f64),
        ]);
    }
    for s in surfaces {
        console.print(format!(
            "isovalue {}: {} vertices, {} triangles, {} bricks; extract {}, select {}",
            text::number(s.isovalue, 6),
            text::count(s.mesh.positions_in_grid.len() as u64),
            text::count(s.mesh.triangles.len() as u64),
            text::count(s.bricks.len() as u64),
            text::duration(s.extract_time),
            text::duration(s.select_time),
        ));
    }
    console.print(text::table(&rows));
    let mut total = LookupReport::default();
    written.iter().for_each(|w| total += w.report);
    console.print(format!(
        "lookups {}: {} renormalised, {} from the neighbourhood, {} unoccluded, {} unbaked",
        text::count(total.lookups),
        text::count(total.renormalised),
        text::count(total.neighbourhood),
        text::count(total.unoccluded),
        text::count(total.unbaked),
    ));
    console.print(format!(
        "error: standard error of the radiance, RMS over the vertices, over its mean; median and 95 %: of the vertices' own\n\
         relative errors\nread {}; transport rays {}, camera rays {}, sun rays {}",
        text::duration(*read_time),
        text::count(*transport_rays),
        text::count(camera_rays),
        text::count(written.iter().map(|w| w.sun_rays).sum())
    ));
    for w in written {
        for note in &w.notes {
            console.note(note);
        }
        if w.negative > 0 {
            console.note(format!(
                "{}: {} vertices have a negative channel (ringing of the band-limited light), shown as 0; --window softens it",
                w.target.path.display(),
                text::count(w.negative)
            ));
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
            "vertices": s.mesh.positions_in_grid.len(),
            "triangles": s.mesh.triangles.len(),
            "bricks": s.bricks.len(),
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

fn file_json(w: &Written) -> Value {
    json!({
        "path": w.target.path.display().to_string(),
        "isovalue": w.isovalue,
        "environment": w.env,
        "bytes": w.bytes,
        "exposure_ev": f64::from(w.exposure).log2(),
        "error": {
            "rms_over_mean": w.rms_over_mean,
            "median_relative": finite(w.error.median),
            "percentile_95_relative": finite(w.error.percentile_95),
        },
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
