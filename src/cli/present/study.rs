//! A study as tables.

use crate::cli::present::text;
use crate::study::figure::{rungs, seconds_at};
use crate::study::sweep::Swept;

pub(in crate::cli) fn forecasts(swept: &Swept) -> String {
    let mut lines = vec![text::row(["setting", "cpu s", "forecast", "ratio", "error", "forecast", "ratio"])];
    for row in &swept.rows {
        let Some(forecast) = swept.forecast_of(row) else { continue };
        let error = row.measured.band_limited.relative_rms_without_noise;
        lines.push(vec![
            format!("{}, {}", row.curve, row.label),
            format!("{:.2}", row.cpu),
            format!("{:.2}", forecast.seconds),
            format!("{:.2}", forecast.seconds / row.cpu),
            text::percent(error),
            text::percent(forecast.error),
            format!("{:.2}", forecast.error / error),
        ]);
    }
    text::table(&lines)
}

pub(in crate::cli) fn seconds(swept: &Swept) -> String {
    let head = rungs(&swept.marks).into_iter().map(text::percent);
    let mut lines = vec![std::iter::once("curve".to_string()).chain(head).collect::<Vec<_>>()];
    for (name, seconds) in seconds_at(&swept.marks) {
        let cells = seconds.into_iter().map(|s| s.map_or("-".into(), |s| format!("{s:.2}")));
        lines.push(std::iter::once(name).chain(cells).collect());
    }
    text::table(&lines)
}

pub(in crate::cli) fn table(swept: &Swept) -> String {
    const PARTS: [&str; 5] = ["interpolation", "layers", "noise", "bias", "rounding"];
    let head = ["setting", "cpu s", "wall s", "rays", "bytes", "error", "±"].into_iter().chain(PARTS).chain(["front"]);
    let mut lines = vec![text::row(head)];
    for (i, r) in swept.rows.iter().enumerate() {
        let rms = |name: &str| {
            let square = r.measured.row(name);
            text::percent(square.abs().sqrt().copysign(square))
        };
        let mut line = vec![
            format!("{}, {}", r.curve, r.label),
            format!("{:.2}", r.cpu),
            format!("{:.2}", r.wall),
            text::metric(r.rays as f64),
            text::bytes(r.bytes as f64),
            text::percent(r.measured.band_limited.relative_rms_without_noise),
            text::percent(r.measured.band_limited.relative_rms.half_interval),
        ];
        line.extend(PARTS.map(rms));
        line.push(if swept.front.contains(&i) { "*".into() } else { String::new() });
        lines.push(line);
    }
    text::table(&lines)
}

/// What keeping fewer bits costs.
pub(in crate::cli) fn kept(swept: &Swept) -> String {
    let mut lines = vec![text::row(["coefficients kept as", "bytes a texel", "error of rounding", "all error"])];
    lines.extend(swept.kept.iter().map(|k| {
        vec![k.name.clone(), format!("{:.0}", k.bytes_of_texel), text::percent(k.rounding), text::percent(k.error)]
    }));
    text::table(&lines)
}
