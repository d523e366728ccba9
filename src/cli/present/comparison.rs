//! Comparisons as tables.

use crate::cli::present::text;
use crate::compare::{Compared, Figure};
use std::time::Duration;

/// Which surface a row is of.
fn surface(row: &Compared) -> String {
    let isovalue = text::number(row.isovalue, 6);
    match &row.volume {
        Some(name) => format!("{name} {isovalue}"),
        None => isovalue,
    }
}

/// A share and half of its interval.
fn share(figure: &Figure) -> String {
    format!("{} ± {}", text::percent(figure.value), text::percent(figure.half_interval))
}

/// The same of what may be negative.
fn signed(figure: &Figure) -> String {
    format!("{:+.2} ± {:.2} %", 100.0 * figure.value, 100.0 * figure.half_interval)
}

pub(in crate::cli) fn table(rows: &[Compared]) -> String {
    let mut lines = vec![text::row([
        "isovalue",
        "environment",
        "against",
        "relative RMS",
        "without noise",
        "95 %",
        "max",
        "bias",
        "RMS %",
        "stated",
        "covers",
        "time",
    ])];
    for row in rows {
        for (against, d) in [("whole light", &row.found.whole), ("its bands", &row.found.band_limited)] {
            lines.push(vec![
                surface(row),
                row.env.clone(),
                against.into(),
                share(&d.relative_rms),
                text::percent(d.relative_rms_without_noise),
                text::percent(d.percentile_95),
                text::percent(d.maximum),
                signed(&d.bias),
                format!("{:.2}", d.rms_percent),
                row.stated.filter(|_| against == "whole light").map_or(String::new(), |s| text::percent(s.rms)),
                row.stated.filter(|_| against == "whole light").map_or(String::new(), |s| text::percent(s.covered)),
                text::duration(Duration::from_secs_f64(row.seconds)),
            ]);
        }
    }
    text::table(&lines)
}

pub(in crate::cli) fn budget(rows: &[Compared]) -> String {
    let names = rows.first().map_or(Vec::new(), |r| r.budget().iter().map(|b| b.name.to_string()).collect());
    let head = ["isovalue", "environment"].map(String::from).into_iter().chain(names);
    let mut lines = vec![head.chain(["total".into(), "noise of the reference".into()]).collect::<Vec<_>>()];
    for row in rows {
        let mut line = vec![surface(row), row.env.clone()];
        let total: f64 = row.budget().iter().map(|b| b.mean_square).sum();
        for b in row.budget() {
            let rms = b.mean_square.abs().sqrt().copysign(b.mean_square);
            line.push(format!("{:.1} % (RMS {:.2} %)", 100.0 * b.mean_square / total, 100.0 * rms));
        }
        line.push(format!("RMS {}", text::percent(total.sqrt())));
        line.push(format!("RMS {}", text::percent(row.found.reference_noise)));
        lines.push(line);
    }
    text::table(&lines)
}

/// Photons beside the store and the paths.
pub(in crate::cli) fn photons(rows: &[Compared]) -> String {
    let head = [
        "isovalue",
        "environment",
        "store against photons",
        "bias",
        "photons against paths",
        "bias",
        "their noise",
        "their bias (RMS)",
        "hits",
        "memory",
    ];
    let mut lines = vec![text::row(head)];
    for row in rows {
        let Some(p) = &row.photons else { continue };
        lines.push(vec![
            surface(row),
            row.env.clone(),
            share(&p.store.relative_rms),
            signed(&p.store.bias),
            share(&p.paths.relative_rms),
            signed(&p.paths.bias),
            text::percent(p.noise),
            text::percent(p.bias),
            p.hits.to_string(),
            text::bytes(p.bytes as f64),
        ]);
    }
    format!("Photons, relative RMS under the whole light\n{}", text::table(&lines))
}

/// The surface itself beside the store and the paths.
pub(in crate::cli) fn geometry(rows: &[Compared]) -> String {
    let head =
        ["isovalue", "environment", "store", "bias", "normals", "without noise", "bias", "standard error", "rays lost"];
    let mut lines = vec![text::row(head)];
    for row in rows {
        let Some(g) = &row.geometry else { continue };
        lines.push(vec![
            surface(row),
            row.env.clone(),
            share(&g.store.relative_rms),
            signed(&g.store.bias),
            share(&g.normals.relative_rms),
            text::percent(g.normals.relative_rms_without_noise),
            format!("{:+.2} %", 100.0 * g.normals.bias.value),
            format!("{:.2} %", 100.0 * g.normals.bias.standard_error()),
            format!("{} of {}", g.counts.lost, g.counts.rays),
        ]);
    }
    format!(
        "Against the surface itself, relative RMS under the whole light; normals: smoothed ones, which paths start \
         about, against its own\n{}",
        text::table(&lines)
    )
}
