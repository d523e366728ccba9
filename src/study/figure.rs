//! The figure of a study: error against seconds, and what the error is made of, as one self-contained SVG.
//!
//! Written by hand, since it is one figure whose every mark has a meaning: no plotting crate draws shares along a front
//! beside it, or one picture for light and dark backgrounds.

use super::Measured;
use super::front::{Price, cost_at, front};
use std::fmt::Write as _;

/// Rows of the budget of the transport alone, with their colours: those of Okabe and Ito (2008), told apart by the
/// colour-blind.
const SHARES: [(&str, &str); 5] = [
    ("interpolation", "#0072B2"),
    ("layers", "#009E73"),
    ("noise", "#E69F00"),
    ("bias", "#D55E00"),
    ("rounding", "#999999"),
];

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
}

const WIDTH: f64 = 1120.0;
const HEIGHT: f64 = 640.0;
/// The plot of errors: left, top, right, bottom.
const PLOT: [f64; 4] = [84.0, 70.0, 660.0, 480.0];
/// The bars.
const BARS: [f64; 4] = [740.0, 70.0, 1090.0, 300.0];

const STYLE: &str = "<style>\
.paper{fill:#ffffff}.ink{fill:#1b1f24}.soft{fill:#57606a}.grid{stroke:#d0d7de;stroke-width:1}\
.axis{stroke:#1b1f24;stroke-width:1.2;fill:none}.front{stroke:#1b1f24;stroke-width:5;stroke-opacity:.16;fill:none}\
.cut{stroke:#57606a;stroke-dasharray:5 4;stroke-width:1}.ring{stroke:#ffffff;stroke-width:1}\
text{font:13px system-ui,-apple-system,'Segoe UI','DejaVu Sans',sans-serif}.title{font-size:17px;font-weight:600}.small{font-size:11.5px}\
@media (prefers-color-scheme:dark){.paper{fill:#0d1117}.ink{fill:#e6edf3}.soft{fill:#9da7b1}.grid{stroke:#30363d}\
.axis{stroke:#e6edf3}.front{stroke:#e6edf3;stroke-opacity:.22}.cut{stroke:#9da7b1}.ring{stroke:#0d1117}}</style>";

/// A logarithmic axis from decade to decade, or to 2 and 5 of one.
struct Axis {
    from: f64,
    to: f64,
    at_from: f64,
    at_to: f64,
}

impl Axis {
    fn around(values: impl Iterator<Item = f64>, at_from: f64, at_to: f64) -> Self {
        let (low, high) = values.fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
        let (low, high) = if low.is_finite() && high > 0.0 { (low.max(high * 1e-6), high) } else { (0.1, 1.0) };
        let below = ticks(low / 10.0, low / 1.05).pop().unwrap_or(low);
        let above = ticks(high * 1.05, high * 10.0).first().copied().unwrap_or(high);
        Self { from: below, to: above, at_from, at_to }
    }

    fn place(&self, value: f64) -> f64 {
        let part = libm::log(value / self.from) / libm::log(self.to / self.from);
        self.at_from + part.clamp(0.0, 1.0) * (self.at_to - self.at_from)
    }
}

/// 1, 2 and 5 of every decade between two numbers.
fn ticks(from: f64, to: f64) -> Vec<f64> {
    let decade = libm::floor(libm::log10(from)) as i32;
    let all = (decade..decade + 14).flat_map(|d| [1.0, 2.0, 5.0].map(|m| m * libm::pow(10.0, f64::from(d))));
    all.filter(|t| (from * 0.999..=to * 1.001).contains(t)).collect()
}

/// A number without needless digits.
fn short(value: f64) -> String {
    if value >= 100.0 { format!("{value:.0}") } else { format!("{}", (value * 1e4).round() / 1e4) }
}

/// Two digits that count, for narrow places.
fn brief(value: f64) -> String {
    if value >= 10.0 {
        format!("{value:.0}")
    } else if value >= 1.0 {
        format!("{value:.1}")
    } else {
        format!("{value:.2}")
    }
}

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

/// The figure.
pub fn svg(marks: &[Mark], caption: &Caption) -> String {
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\">\
         <title>{}</title>{STYLE}<rect class=\"paper\" width=\"{WIDTH}\" height=\"{HEIGHT}\"/>\
         <text class=\"ink title\" x=\"24\" y=\"32\">{}</text>\n",
        escape(&caption.title),
        escape(&caption.title)
    );
    plot(&mut out, marks, caption);
    bars(&mut out, marks);
    table(&mut out, marks);
    for (i, note) in caption.notes.iter().enumerate() {
        let y = 548.0 + 18.0 * i as f64;
        let _ = writeln!(out, "<text class=\"soft small\" x=\"24\" y=\"{y}\">{}</text>", escape(note));
    }
    out.push_str("</svg>\n");
    out
}

fn plot(out: &mut String, marks: &[Mark], caption: &Caption) {
    let [left, top, right, bottom] = PLOT;
    let x = Axis::around(marks.iter().map(|m| m.seconds), left, right);
    let y = Axis::around(marks.iter().map(|m| 100.0 * error(m)), bottom, top);
    for t in ticks(x.from, x.to) {
        let at = x.place(t);
        let _ = write!(out, "<line class=\"grid\" x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"{top}\" y2=\"{bottom}\"/>");
        let _ = writeln!(
            out,
            "<text class=\"ink\" x=\"{at:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            bottom + 18.0,
            short(t)
        );
    }
    for t in ticks(y.from, y.to) {
        let at = y.place(t);
        let _ = write!(out, "<line class=\"grid\" x1=\"{left}\" x2=\"{right}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/>");
        let _ = writeln!(
            out,
            "<text class=\"ink\" x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{} %</text>",
            left - 8.0,
            at + 4.0,
            short(t)
        );
    }
    let _ = writeln!(
        out,
        "<path class=\"axis\" d=\"M{left} {top}V{bottom}H{right}\"/>\
         <text class=\"ink\" x=\"{}\" y=\"{}\" text-anchor=\"middle\">processor seconds for the texels of this surface</text>\
         <text class=\"ink\" transform=\"translate(22 {}) rotate(-90)\" text-anchor=\"middle\">error of the light that leaves the surface: RMS over mean</text>",
        0.5 * (left + right),
        bottom + 40.0,
        0.5 * (top + bottom)
    );
    let mut before = f64::NEG_INFINITY;
    for (bands, value) in caption.truncation.iter().filter(|t| (y.from..y.to).contains(&(100.0 * t.1))) {
        let at = y.place(100.0 * value);
        if at - before < 16.0 {
            continue;
        }
        before = at;
        let _ = writeln!(
            out,
            "<line class=\"cut\" x1=\"{left}\" x2=\"{right}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/>\
             <text class=\"soft small\" x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">cutting this light to {bands} bands: {} %</text>",
            right - 4.0,
            at - 4.0,
            short((1e3 * value).round() / 10.0)
        );
    }
    let best: Vec<String> = on_front(marks)
        .iter()
        .map(|&i| format!("{:.1} {:.1}", x.place(marks[i].seconds), y.place(100.0 * error(&marks[i]))))
        .collect();
    let _ = writeln!(out, "<path class=\"front\" d=\"M{}\"/>", best.join("L"));
    for (i, (name, list)) in curves(marks).into_iter().enumerate() {
        let colour = COLOURS[i % COLOURS.len()];
        let place = |m: &Mark| (x.place(m.seconds), y.place(100.0 * error(m)));
        let path: Vec<String> = list.iter().map(|m| place(m)).map(|(x, y)| format!("{x:.1} {y:.1}")).collect();
        let _ = writeln!(out, "<path d=\"M{}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>", path.join("L"));
        for mark in &list {
            let (at, of) = place(mark);
            let half = 100.0 * mark.measured.band_limited.relative_rms.half_interval;
            let value = 100.0 * error(mark);
            let (low, high) = (y.place((value - half).max(y.from)), y.place(value + half));
            let _ = writeln!(
                out,
                "<line x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"{low:.1}\" y2=\"{high:.1}\" stroke=\"{colour}\" stroke-width=\"1.4\"/>\
                 <circle class=\"ring\" cx=\"{at:.1}\" cy=\"{of:.1}\" r=\"4.5\" fill=\"{colour}\"><title>{}, {}: {} s, {} %</title></circle>\
                 <text class=\"soft small\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                escape(name),
                escape(&mark.label),
                short(mark.seconds),
                short(value),
                at + 7.0,
                of - 6.0,
                escape(&mark.label)
            );
        }
    }
}

/// What the error is made of along the front.
fn bars(out: &mut String, marks: &[Mark]) {
    let [left, top, right, bottom] = BARS;
    let chosen = on_front(marks);
    let _ = writeln!(
        out,
        "<text class=\"ink\" x=\"{left}\" y=\"{}\">Its shares along the front; below: seconds, error in %</text>",
        top - 14.0
    );
    let step = (right - left) / chosen.len().max(1) as f64;
    for (i, &index) in chosen.iter().enumerate() {
        let mark = &marks[index];
        let parts: Vec<f64> = SHARES.iter().map(|(name, _)| mark.measured.row(name).max(0.0)).collect();
        let sum: f64 = parts.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let (mut y, x) = (bottom, left + i as f64 * step + 0.1 * step);
        for ((_, colour), part) in SHARES.iter().zip(&parts) {
            let height = part / sum * (bottom - top);
            y -= height;
            let _ = write!(
                out,
                "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{height:.1}\" fill=\"{colour}\"/>",
                0.8 * step
            );
        }
        let middle = x + 0.4 * step;
        let _ = writeln!(
            out,
            "<text class=\"ink small\" x=\"{middle:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>\
             <text class=\"soft small\" x=\"{middle:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            bottom + 15.0,
            brief(mark.seconds),
            bottom + 30.0,
            short((1e3 * error(mark)).round() / 10.0)
        );
    }
    for (i, (name, colour)) in SHARES.iter().enumerate() {
        let x = left + (i % 3) as f64 * 118.0;
        let y = bottom + 54.0 + (i / 3) as f64 * 18.0;
        let _ = writeln!(
            out,
            "<rect x=\"{x}\" y=\"{}\" width=\"11\" height=\"11\" fill=\"{colour}\"/><text class=\"ink small\" x=\"{}\" y=\"{y}\">{name}</text>",
            y - 10.0,
            x + 16.0
        );
    }
}

/// The same error by each way of baking; its first column is the legend of the curves.
fn table(out: &mut String, marks: &[Mark]) {
    let (left, top) = (BARS[0], BARS[3] + 112.0);
    let rungs = rungs(marks);
    let column = |i: usize| left + 172.0 + 42.0 * i as f64;
    let _ = writeln!(out, "<text class=\"ink\" x=\"{left}\" y=\"{top}\">Seconds to an error of</text>");
    for (i, e) in rungs.iter().enumerate() {
        let _ = writeln!(
            out,
            "<text class=\"ink small\" x=\"{}\" y=\"{top}\" text-anchor=\"end\">{} %</text>",
            column(i) + 26.0,
            short(100.0 * e)
        );
    }
    for (row, (name, seconds)) in seconds_at(marks).into_iter().enumerate() {
        let y = top + 22.0 + 19.0 * row as f64;
        let colour = COLOURS[row % COLOURS.len()];
        let _ = writeln!(
            out,
            "<circle cx=\"{}\" cy=\"{}\" r=\"5\" fill=\"{colour}\"/><text class=\"ink small\" x=\"{}\" y=\"{y}\">{}</text>",
            left + 6.0,
            y - 4.0,
            left + 18.0,
            escape(&name)
        );
        for (i, value) in seconds.iter().enumerate() {
            let text = value.map_or("–".into(), brief);
            let _ = writeln!(
                out,
                "<text class=\"ink small\" x=\"{}\" y=\"{y}\" text-anchor=\"end\">{text}</text>",
                column(i) + 26.0
            );
        }
    }
}
