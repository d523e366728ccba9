//! What a study prints and writes.

use super::super::text;
use super::{BANDS, KEPT, Row};
use crate::bake::Estimator;
use crate::study::figure::{Kept, Mark, rungs, seconds_at};
use crate::study::forecast::Weighed;
use crate::study::model::Forecast;
use serde_json::{Value, json};

const HEAD: &str = "estimator,rays,bands,ratio,kept_as,wall_seconds,cpu_seconds,transport_rays,texels,bytes,\
rms,rms_half_interval,rms_same_bands,rms_same_bands_without_noise,bias,\
truncation,interpolation,noise_of_reference,layers,noise,bias_mean_square,rounding,cross_terms,total_mean_square";

pub(super) fn csv(rows: &[Row]) -> String {
    let mut out = format!("{HEAD}\n");
    for r in rows {
        let (s, m) = (&r.setting, &r.measured);
        let bands = s.bands.iter().map(usize::to_string).collect::<Vec<_>>().join(" ");
        let parts: Vec<String> = m.budget.iter().map(|b| format!("{:e}", b.mean_square)).collect();
        let total: f64 = m.budget.iter().map(|b| b.mean_square).sum();
        out += &format!(
            "{},{},{bands},{},{},{:.4},{:.4},{},{},{},{:.6},{:.6},{:.6},{:.6},{:.6},{},{total:e}\n",
            s.estimator.name(),
            s.rays,
            s.ratio.map_or("vertices".into(), |ratio| ratio.to_string()),
            s.kept_as.name(),
            r.wall,
            r.cpu,
            r.rays,
            r.texels,
            r.bytes,
            m.whole.relative_rms.value,
            m.whole.relative_rms.half_interval,
            m.band_limited.relative_rms.value,
            m.band_limited.relative_rms_without_noise,
            m.band_limited.bias.value,
            parts.join(",")
        );
    }
    out
}

pub(super) fn row_json(r: &Row) -> Value {
    let budget: serde_json::Map<_, _> =
        r.measured.budget.iter().map(|b| (b.name.to_string(), json!(b.mean_square))).collect();
    json!({
        "curve": r.curve, "estimator": r.setting.estimator.name(), "rays": r.setting.rays, "bands": r.setting.bands,
        "ratio": r.setting.ratio, "kept_as": r.setting.kept_as.name(), "wall_seconds": r.wall, "cpu_seconds": r.cpu, "transport_rays": r.rays,
        "texels": r.texels, "bytes": r.bytes,
        "rms": r.measured.whole.relative_rms.value,
        "rms_same_bands": r.measured.band_limited.relative_rms_without_noise,
        "budget_mean_square": budget,
    })
}

/// The forecast for a bake by `path` of the default layers.
fn forecast_of(row: &Row, pilots: &[Weighed]) -> Option<Forecast> {
    let fits = row.setting.estimator == Estimator::Path && row.setting.bands == BANDS && row.curve != KEPT;
    let pilot = pilots.iter().find(|w| fits && Some(w.ratio) == row.setting.ratio)?;
    Some(pilot.pilot.forecast(row.setting.rays))
}

pub(super) fn forecasts(rows: &[Row], pilots: &[Weighed]) -> String {
    let mut lines =
        vec![["setting", "cpu s", "forecast", "ratio", "error", "forecast", "ratio"].map(String::from).to_vec()];
    for row in rows {
        let Some(forecast) = forecast_of(row, pilots) else { continue };
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

pub(super) fn forecast_json(row: &Row, pilots: &[Weighed]) -> Option<Value> {
    let forecast = forecast_of(row, pilots)?;
    Some(json!({
        "curve": row.curve, "rays": row.setting.rays, "cpu_seconds": row.cpu, "forecast_cpu_seconds": forecast.seconds,
        "rms_same_bands": row.measured.band_limited.relative_rms_without_noise, "forecast_error": forecast.error,
    }))
}

pub(super) fn iso_json(marks: &[Mark]) -> Value {
    let rungs = rungs(marks);
    let curves = seconds_at(marks);
    json!(
        curves
            .iter()
            .map(|(name, list)| json!({
                "curve": name,
                "at": rungs.iter().zip(list).map(|(e, s)| json!({ "error": e, "cpu_seconds": s })).collect::<Vec<_>>(),
            }))
            .collect::<Vec<_>>()
    )
}

pub(super) fn iso_table(marks: &[Mark]) -> String {
    let head = rungs(marks).into_iter().map(text::percent);
    let mut lines = vec![std::iter::once("curve".to_string()).chain(head).collect::<Vec<_>>()];
    for (name, seconds) in seconds_at(marks) {
        let cells = seconds.into_iter().map(|s| s.map_or("-".into(), |s| format!("{s:.2}")));
        lines.push(std::iter::once(name).chain(cells).collect());
    }
    text::table(&lines)
}

pub(super) fn table(rows: &[Row], front: &[usize]) -> String {
    let mut lines = vec![
        [
            "setting",
            "cpu s",
            "wall s",
            "rays",
            "bytes",
            "error",
            "±",
            "interpolation",
            "layers",
            "noise",
            "bias",
            "rounding",
            "front",
        ]
        .map(String::from)
        .to_vec(),
    ];
    for (i, r) in rows.iter().enumerate() {
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
        line.extend(["interpolation", "layers", "noise", "bias", "rounding"].map(rms));
        line.push(if front.contains(&i) { "*".into() } else { String::new() });
        lines.push(line);
    }
    text::table(&lines)
}

/// What keeping fewer bits costs.
pub(super) fn kept_table(kept: &[Kept]) -> String {
    let mut lines =
        vec![["coefficients kept as", "bytes a texel", "error of rounding", "all error"].map(String::from).to_vec()];
    lines.extend(kept.iter().map(|k| {
        vec![k.name.clone(), format!("{:.0}", k.bytes_of_texel), text::percent(k.rounding), text::percent(k.error)]
    }));
    text::table(&lines)
}

pub(super) fn kept_json(kept: &[Kept]) -> Value {
    let each = kept.iter().map(|k| {
        json!({ "kept_as": k.name, "bytes_of_texel": k.bytes_of_texel, "rms_of_rounding": k.rounding, "rms_same_bands": k.error })
    });
    each.collect()
}
