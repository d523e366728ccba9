//! What paths on the surface itself found, as a table.

use super::Row;
use crate::cli::text;
use crate::compare::{Figure, GeometryComparison};
use serde_json::{Value, json};

/// The surface itself beside the store and the paths.
pub(super) fn table(rows: &[Row]) -> String {
    let head =
        ["isovalue", "environment", "store", "bias", "normals", "without noise", "bias", "standard error", "rays lost"];
    let mut lines = vec![head.map(String::from).to_vec()];
    for row in rows {
        let Some(g) = &row.geometry else { continue };
        let percent = |f: &Figure| format!("{} ± {}", text::percent(f.value), text::percent(f.half_interval));
        lines.push(vec![
            row.surface(),
            row.env.clone(),
            percent(&g.store.relative_rms),
            format!("{:+.2} ± {:.2} %", 100.0 * g.store.bias.value, 100.0 * g.store.bias.half_interval),
            percent(&g.normals.relative_rms),
            text::percent(g.normals.relative_rms_without_noise),
            format!("{:+.2} %", 100.0 * g.normals.bias.value),
            format!("{:.2} %", 100.0 * standard_error(&g.normals.bias)),
            format!("{} of {}", g.counts.lost, g.counts.rays),
        ]);
    }
    format!(
        "Against the surface itself, relative RMS under the whole light; normals: smoothed ones, which paths start \
         about, against its own\n{}",
        text::table(&lines)
    )
}

/// Of half a 95 % interval over many points.
fn standard_error(figure: &Figure) -> f64 {
    figure.half_interval / 1.96
}

pub(super) fn geometry_json(row: &Row, g: &GeometryComparison) -> Value {
    let by_others = row.found.at_points.iter().zip(&g.at_points);
    let points: Vec<Value> = row
        .listed
        .iter()
        .zip(by_others)
        .map(|(at, ([store, paths], geometry))| {
            json!({
                "position_in_grid": at.position_in_grid, "normal": at.normal,
                "store": store, "paths": paths, "geometry": geometry,
            })
        })
        .collect();
    json!({
        "points": points,
        "mean_radiance": g.mean,
        "store": super::distance_json(&g.store),
        "normals": super::distance_json(&g.normals),
        "normals_bias": g.normals.bias.value,
        "normals_bias_standard_error": standard_error(&g.normals.bias),
        "normals_rms_without_noise": g.normals.relative_rms_without_noise,
        "noise": g.noise,
        "rays": g.counts.rays, "lost": g.counts.lost, "cut": g.counts.cut,
    })
}
