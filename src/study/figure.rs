//! The figure of a study: error against seconds, and what the error is made of, as one self-contained SVG.
//!
//! Written by hand, since it is one figure whose every mark has a meaning: no plotting crate draws shares along a front
//! beside it, or one picture for light and dark backgrounds.

mod axis;
mod beside;
mod plot;

use super::Measured;
use super::front::{Price, cost_at, front};
use std::fmt::Write as _;

/// Colours of the curves.
const COLOURS: [&str; 8] = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8c6d31", "#7f7f7f"];

/// One bake in the figure.
#[derive(Clone, Debug)]
pub struct Mark {
    /// Which curve it belongs to, such as "path, texture 1".
    pub curve: String,
    /// What it is on its curve, such as "64 rays".
    pub label: String,
    /// Processor seconds.
    pub seconds: f64,
    /// How exact it is.
    pub measured: Measured,
}

/// What stands around the marks.
#[derive(Clone, Debug, Default)]
pub struct Caption {
    /// Volume, isovalue and environment.
    pub title: String,
    /// What the reference is and how it was timed, in lines.
    pub notes: Vec<String>,
    /// Bands, and the error of cutting the light to them.
    pub truncation: Vec<(usize, f64)>,
    /// Ways of keeping the coefficients of one of the bakes.
    pub kept: Vec<Kept>,
}

/// The same bake with its coefficients kept in so many bits.
#[derive(Clone, Debug)]
pub struct Kept {
    /// Such as "f16" or "8 bits".
    pub name: String,
    /// Stored bytes of a texel.
    pub bytes_of_texel: f64,
    /// RMS of what rounding does, over the mean radiance.
    pub rounding: f64,
    /// RMS of all that differs from paths under light of the same bands, over the mean radiance.
    pub error: f64,
}

const WIDTH: f64 = 1120.0;
const HEIGHT: f64 = 724.0;

const STYLE: &str = "<style>\
.paper{fill:#ffffff}.ink{fill:#1b1f24}.soft{fill:#57606a}.grid{stroke:#d0d7de;stroke-width:1}\
.axis{stroke:#1b1f24;stroke-width:1.2;fill:none}.front{stroke:#1b1f24;stroke-width:5;stroke-opacity:.16;fill:none}\
.cut{stroke:#57606a;stroke-dasharray:5 4;stroke-width:1}.ring{stroke:#ffffff;stroke-width:1}\
.halo{stroke:#ffffff;stroke-width:3;stroke-linejoin:round;paint-order:stroke}\
text{font:13px system-ui,-apple-system,'Segoe UI','DejaVu Sans',sans-serif}.title{font-size:17px;font-weight:600}.small{font-size:11.5px}\
@media (prefers-color-scheme:dark){.paper{fill:#0d1117}.ink{fill:#e6edf3}.soft{fill:#9da7b1}.grid{stroke:#30363d}\
.axis{stroke:#e6edf3}.front{stroke:#e6edf3;stroke-opacity:.22}.cut{stroke:#9da7b1}.ring{stroke:#0d1117}.halo{stroke:#0d1117}}</style>";

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// Root mean square of the transport's error, without what cutting the light does: relative, not in percent.
fn error(mark: &Mark) -> f64 {
    mark.measured.band_limited.relative_rms_without_noise
}

fn price(mark: &Mark) -> Price {
    Price { cost: mark.seconds, error: error(mark) }
}

/// Curves in the order in which they first appear, each with its marks from the cheapest on.
pub fn curves(marks: &[Mark]) -> Vec<(&str, Vec<&Mark>)> {
    let mut all: Vec<(&str, Vec<&Mark>)> = Vec::new();
    for mark in marks {
        match all.iter_mut().find(|(name, _)| *name == mark.curve) {
            Some((_, list)) => list.push(mark),
            None => all.push((&mark.curve, vec![mark])),
        }
    }
    all.iter_mut().for_each(|(_, list)| list.sort_by(|a, b| a.seconds.total_cmp(&b.seconds)));
    all
}

/// Errors, relative, at which curves are compared: the least round ones that two curves reach.
pub fn rungs(marks: &[Mark]) -> Vec<f64> {
    let mut least: Vec<f64> =
        curves(marks).into_iter().map(|(_, list)| list.into_iter().map(error).fold(f64::INFINITY, f64::min)).collect();
    least.sort_by(f64::total_cmp);
    let from = least.get(1).or(least.first()).copied().unwrap_or(f64::INFINITY);
    let most = marks.iter().map(error).fold(0.0, f64::max);
    let round = [0.5, 0.3, 0.2, 0.15, 0.1, 0.07, 0.05, 0.03, 0.02, 0.015, 0.01, 0.007, 0.005, 0.003, 0.002];
    let all: Vec<f64> = round.into_iter().filter(|&e| e >= from && e < most).collect();
    all[all.len().saturating_sub(5)..].to_vec()
}

/// Seconds that each curve takes to each of [`rungs`].
pub fn seconds_at(marks: &[Mark]) -> Vec<(String, Vec<Option<f64>>)> {
    let at = |list: &[&Mark], e: f64| cost_at(&list.iter().map(|m| price(m)).collect::<Vec<_>>(), e);
    curves(marks)
        .into_iter()
        .map(|(name, list)| (name.to_string(), rungs(marks).into_iter().map(|e| at(&list, e)).collect()))
        .collect()
}

/// The bakes on the Pareto front, from the cheapest on.
pub fn on_front(marks: &[Mark]) -> Vec<usize> {
    front(&marks.iter().map(price).collect::<Vec<_>>())
}

/// A line of text: its class, place and anchor (`start`, `middle` or `end`).
fn text(out: &mut String, class: &str, [x, y]: [f64; 2], anchor: &str, words: &str) {
    let _ = writeln!(
        out,
        "<text class=\"{class}\" x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{}</text>",
        escape(words)
    );
}

/// The figure.
pub fn svg(marks: &[Mark], caption: &Caption) -> String {
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\">\
         <title>{}</title>{STYLE}<rect class=\"paper\" width=\"{WIDTH}\" height=\"{HEIGHT}\"/>\n",
        escape(&caption.title)
    );
    text(&mut out, "ink title", [24.0, 32.0], "start", &caption.title);
    let subtitle =
        "Each dot is one way of baking the light of this surface; further left is faster, further down more exact.";
    text(&mut out, "soft", [24.0, 54.0], "start", subtitle);
    plot::draw(&mut out, marks, caption);
    beside::bars(&mut out, marks);
    beside::times(&mut out, marks);
    beside::kept(&mut out, &caption.kept);
    for (i, note) in caption.notes.iter().enumerate() {
        text(&mut out, "soft small", [24.0, 566.0 + 17.0 * i as f64], "start", note);
    }
    out.push_str("</svg>\n");
    out
}
