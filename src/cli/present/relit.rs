//! What is printed about a run, for people and for programs.

use crate::cli::present::console::Console;
use crate::cli::present::text;
use crate::export::target::Format;
use crate::lit::Relit;
use crate::relight::{ErrorTerm, TotalError};
use crate::session::{Content, MeshFile, WrittenFile};
use std::time::Duration;

/// Share of a surface below a texel from which on it is told.
const MOST_BELOW_A_TEXEL: f64 = 0.05;
/// Noise over the mean from which on spots show.
const MOST_NOISE: f64 = 0.15;

/// What is in a mesh file, and how far it is off the isosurface.
fn mesh(made: &MeshFile, format: Format) -> String {
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

/// The files and a line of summary, for people.
fn print(console: &Console, relit: &Relit) {
    let Relit { surfaces, files: written, views, read_seconds, transport_rays, .. } = relit;
    for w in written {
        let what = format!("{}, {}", content(w, views), text::bytes(w.bytes as f64));
        console.summary(text::file_line(&w.target.path, &what));
    }
    let time = seconds(written.iter().map(|w| w.times.total()).sum());
    let worst = written.iter().max_by(|a, b| error_of(a).total_cmp(&error_of(b)));
    console.summary(match (written.as_slice(), worst) {
        ([w], _) => format!(
            "isovalue {}, {}: {}; exposure {:+.2} EV; {}",
            text::number(w.isovalue, 6),
            w.env,
            error_text(w),
            w.exposure_ev,
            time
        ),
        (all, Some(worst)) => {
            format!("{} files in {}: {} or better", all.len(), time, error_text(worst))
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
        let times = format!("extract {}, select {}", seconds(s.extract_seconds), seconds(s.select_seconds));
        console.detail(text::table(&[vec!["surface".into(), found], vec!["time".into(), times]]));
    }
    for w in written {
        console.detail(format!("\n{}\n{}", w.target.path.display(), details(w)));
    }
    let camera_rays: u64 = written.iter().map(|w| w.camera.rays).sum();
    console.detail(format!(
        "\nread {}; transport rays {}, camera rays {}, sun rays {}",
        seconds(*read_seconds),
        text::count(*transport_rays),
        text::count(camera_rays),
        text::count(written.iter().map(|w| w.sun_rays).sum())
    ));
}

/// What is in a file.
fn content(w: &WrittenFile, views: &str) -> String {
    match &w.content {
        Content::Mesh(made) => mesh(made, w.target.format),
        Content::Pictures => views.into(),
    }
}

fn seconds(seconds: f64) -> String {
    text::duration(Duration::from_secs_f64(seconds.max(0.0)))
}

/// The number that a file is judged by: its whole error, else its noise.
fn error_of(w: &WrittenFile) -> f64 {
    w.total.map_or(w.rms_over_mean, |total| total.rms)
}

/// How far a file is from exact light transport, in short.
fn error_text(w: &WrittenFile) -> String {
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
fn details(w: &WrittenFile) -> String {
    let mut times = vec![("contract", w.times.contract), ("look up", w.times.look_up)];
    times.extend((w.target.format == Format::Png).then_some(("render", w.times.render)));
    times.push(("write", w.times.write));
    let times: Vec<String> = times.into_iter().map(|(name, time)| format!("{name} {}", seconds(time))).collect();
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

pub(in crate::cli) fn report(console: &Console, relit: &Relit) {
    let Relit { surfaces, files: written, .. } = relit;
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
    let ringing: Vec<&WrittenFile> = written.iter().filter(|w| w.negative > 0).collect();
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
    console.print_json(&relit.to_json());
}
