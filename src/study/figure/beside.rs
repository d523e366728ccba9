//! What stands beside the plot: what the errors are made of, times to the same error, storage.

use super::axis::{brief, short};
use super::{COLOURS, Kept, Mark, error, on_front, rungs, seconds_at, text};
use std::fmt::Write as _;

/// Left edge of everything.
const LEFT: f64 = 764.0;
/// The bars: left, top, right, bottom.
const BARS: [f64; 4] = [824.0, 96.0, 1096.0, 270.0];

/// Bars that have room.
const MOST_BARS: usize = 8;

/// Rows of the budget of the transport alone, what they are, and their colours: those of Okabe and Ito (2008), told apart
/// by the colour-blind.
const SHARES: [(&str, &str, &str); 5] = [
    ("interpolation", "interpolating texels", "#0072B2"),
    ("layers", "layers not stored", "#009E73"),
    ("noise", "noise of the rays", "#E69F00"),
    ("bias", "bias of the estimator", "#D55E00"),
    ("rounding", "rounding to 16 bits", "#999999"),
];

/// What the error is made of along the front.
pub(super) fn bars(out: &mut String, marks: &[Mark]) {
    let [left, top, right, bottom] = BARS;
    let front = on_front(marks);
    // What has room, the ends among them.
    let count = front.len().min(MOST_BARS);
    let chosen: Vec<usize> = (0..count).map(|i| front[i * (front.len() - 1) / (count - 1).max(1)]).collect();
    text(out, "ink", [LEFT, top - 34.0], "start", "What the error is made of, along the grey line");
    text(out, "soft small", [LEFT, top - 16.0], "start", "(shares of the mean square; cheapest bake first)");
    for (words, y) in [("100 %", top + 8.0), ("0 %", bottom), ("seconds", bottom + 17.0), ("error, %", bottom + 33.0)] {
        text(out, "soft small", [left - 8.0, y], "end", words);
    }
    let step = (right - left) / chosen.len().max(1) as f64;
    for (i, &index) in chosen.iter().enumerate() {
        let mark = &marks[index];
        let parts: Vec<f64> = SHARES.iter().map(|(name, _, _)| mark.measured.row(name).max(0.0)).collect();
        let sum: f64 = parts.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let (mut y, x) = (bottom, left + i as f64 * step + 0.08 * step);
        for ((_, _, colour), part) in SHARES.iter().zip(&parts) {
            let height = part / sum * (bottom - top);
            y -= height;
            let _ = write!(
                out,
                "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{height:.1}\" fill=\"{colour}\"/>",
                0.84 * step
            );
        }
        let middle = x + 0.42 * step;
        text(out, "ink small", [middle, bottom + 17.0], "middle", &brief(mark.seconds));
        text(out, "ink small", [middle, bottom + 33.0], "middle", &brief(100.0 * error(mark)));
    }
    for (i, (_, words, colour)) in SHARES.iter().enumerate() {
        let (x, y) = (LEFT + (i % 2) as f64 * 180.0, bottom + 58.0 + (i / 2) as f64 * 18.0);
        let _ = writeln!(out, "<rect x=\"{x}\" y=\"{}\" width=\"11\" height=\"11\" fill=\"{colour}\"/>", y - 10.0);
        text(out, "ink small", [x + 16.0, y], "start", words);
    }
}

/// The same error by each way of baking; its first column is the legend of the curves.
pub(super) fn times(out: &mut String, marks: &[Mark]) {
    let top = BARS[3] + 128.0;
    let column = |i: usize| LEFT + 172.0 + 40.0 * i as f64;
    text(out, "ink", [LEFT, top], "start", "Processor seconds to reach an error of");
    for (i, e) in rungs(marks).iter().enumerate() {
        text(out, "soft small", [column(i), top + 20.0], "end", &format!("{} %", short(100.0 * e)));
    }
    for (row, (name, seconds)) in seconds_at(marks).into_iter().enumerate() {
        let y = top + 40.0 + 18.0 * row as f64;
        let colour = COLOURS[row % COLOURS.len()];
        let _ = writeln!(out, "<circle cx=\"{}\" cy=\"{}\" r=\"5\" fill=\"{colour}\"/>", LEFT + 6.0, y - 4.0);
        text(out, "ink small", [LEFT + 18.0, y], "start", &name);
        for (i, value) in seconds.iter().enumerate() {
            text(out, "ink small", [column(i), y], "end", &value.map_or("–".into(), brief));
        }
    }
}

/// What fewer bits cost.
pub(super) fn kept(out: &mut String, kept: &[Kept]) {
    let top = BARS[3] + 306.0;
    if kept.is_empty() {
        return;
    }
    text(out, "ink", [LEFT, top], "start", "Transfer kept in fewer bits (one bake)");
    let columns = [LEFT + 190.0, LEFT + 320.0];
    text(out, "soft small", [columns[0], top + 20.0], "end", "bytes a texel");
    text(out, "soft small", [columns[1], top + 20.0], "end", "error it adds");
    for (row, kind) in kept.iter().enumerate() {
        let y = top + 40.0 + 18.0 * row as f64;
        let added = if kind.rounding > 0.0 { format!("{:.3} %", 100.0 * kind.rounding) } else { "–".into() };
        text(out, "ink small", [LEFT + 18.0, y], "start", &kind.name);
        text(out, "ink small", [columns[0], y], "end", &format!("{:.0}", kind.bytes_of_texel));
        text(out, "ink small", [columns[1], y], "end", &added);
    }
}
