//! Error against seconds.

use super::axis::{Axis, short, ticks};
use super::{COLOURS, Caption, Mark, curves, error, escape, on_front, text};
use std::fmt::Write as _;

/// Left, top, right, bottom.
const PLOT: [f64; 4] = [84.0, 78.0, 640.0, 490.0];
/// Width of a character and height of a line of the labels at the dots.
const LETTER: [f64; 2] = [6.4, 13.0];

pub(super) fn draw(out: &mut String, marks: &[Mark], caption: &Caption) {
    let [left, top, right, bottom] = PLOT;
    let x = Axis::around(marks.iter().map(|m| m.seconds), left, right);
    let y = Axis::around(marks.iter().map(|m| 100.0 * error(m)), bottom, top);
    grid(out, &x, &y);
    bands(out, &y, caption);
    let place = |m: &Mark| [x.place(m.seconds), y.place(100.0 * error(m))];
    let line = |list: &mut dyn Iterator<Item = &Mark>| -> String {
        list.map(|m| place(m).map(|v| format!("{v:.1}")).join(" ")).collect::<Vec<_>>().join("L")
    };
    let best = line(&mut on_front(marks).into_iter().map(|i| &marks[i]));
    let _ = writeln!(out, "<path class=\"front\" d=\"M{best}\"/>");
    for (i, (name, list)) in curves(marks).into_iter().enumerate() {
        let colour = COLOURS[i % COLOURS.len()];
        let path = line(&mut list.iter().copied());
        let _ = writeln!(out, "<path d=\"M{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>");
        for mark in list {
            let [at, of] = place(mark);
            let half = 100.0 * mark.measured.band_limited.relative_rms.half_interval;
            let value = 100.0 * error(mark);
            let (low, high) = (y.place((value - half).max(y.from)), y.place(value + half));
            let _ = writeln!(
                out,
                "<line x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"{low:.1}\" y2=\"{high:.1}\" stroke=\"{colour}\" stroke-width=\"1.4\"/>\
                 <circle class=\"ring\" cx=\"{at:.1}\" cy=\"{of:.1}\" r=\"4.5\" fill=\"{colour}\"><title>{}, {}: {} s, {} %</title></circle>",
                escape(name),
                escape(&mark.label),
                short(mark.seconds),
                short(value),
            );
        }
    }
    // Last, above all lines.
    let mut taken: Vec<[f64; 4]> = marks.iter().map(|m| around(place(m), [6.0, 6.0])).collect();
    for mark in marks {
        label(out, &mark.label, place(mark), &mut taken);
    }
}

fn grid(out: &mut String, x: &Axis, y: &Axis) {
    let [left, top, right, bottom] = PLOT;
    for t in ticks(x.from, x.to) {
        let at = x.place(t);
        let _ = write!(out, "<line class=\"grid\" x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"{top}\" y2=\"{bottom}\"/>");
        text(out, "ink", [at, bottom + 18.0], "middle", &short(t));
    }
    for t in ticks(y.from, y.to) {
        let at = y.place(t);
        let _ = write!(out, "<line class=\"grid\" x1=\"{left}\" x2=\"{right}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/>");
        text(out, "ink", [left - 8.0, at + 4.0], "end", &format!("{} %", short(t)));
    }
    let _ = writeln!(out, "<path class=\"axis\" d=\"M{left} {top}V{bottom}H{right}\"/>");
    text(
        out,
        "ink",
        [0.5 * (left + right), bottom + 40.0],
        "middle",
        "processor seconds for all texels of this surface",
    );
    let _ = writeln!(
        out,
        "<text class=\"ink\" transform=\"translate(22 {}) rotate(-90)\" text-anchor=\"middle\">RMS error of the light that leaves the surface, over its mean</text>",
        0.5 * (top + bottom)
    );
}

/// What cutting the light to each number of bands costs besides, with names in the margin.
fn bands(out: &mut String, y: &Axis, caption: &Caption) {
    let [left, top, right, _] = PLOT;
    let shown = |t: &&(usize, f64)| (y.from..y.to).contains(&(100.0 * t.1));
    let mut before = top - 4.0;
    let mut list: Vec<&(usize, f64)> = caption.truncation.iter().filter(shown).collect();
    list.sort_by(|a, b| b.1.total_cmp(&a.1));
    if !list.is_empty() {
        text(out, "soft small", [right + 6.0, top - 8.0], "start", "cutting the light");
    }
    for (bands, value) in list {
        let at = y.place(100.0 * value);
        let _ = writeln!(out, "<line class=\"cut\" x1=\"{left}\" x2=\"{right}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/>");
        // Names stand at their lines, or below the one before.
        before = (at + 4.0).max(before + 14.0);
        let words = format!("to {bands} bands: {} %", short((1e3 * value).round() / 10.0));
        text(out, "soft small", [right + 6.0, before], "start", &words);
    }
}

fn around([x, y]: [f64; 2], [half_width, half_height]: [f64; 2]) -> [f64; 4] {
    [x - half_width, y - half_height, x + half_width, y + half_height]
}

/// Writes a label beside its dot, where it covers the least of dots and other labels.
fn label(out: &mut String, words: &str, [x, y]: [f64; 2], taken: &mut Vec<[f64; 4]>) {
    let size = [LETTER[0] * words.chars().count() as f64, LETTER[1]];
    let side = 9.0 + 0.5 * size[0];
    let places =
        [[side, -8.0], [side, 9.0], [-side, 9.0], [-side, -8.0], [side, 0.0], [-side, 0.0], [0.0, -16.0], [0.0, 17.0]];
    let boxed = |[dx, dy]: [f64; 2]| around([x + dx, y + dy], size.map(|s| 0.5 * s));
    let covered = |b: [f64; 4]| -> f64 {
        let overlap =
            |t: &[f64; 4]| (b[2].min(t[2]) - b[0].max(t[0])).max(0.0) * (b[3].min(t[3]) - b[1].max(t[1])).max(0.0);
        let beyond = (b[2] - PLOT[2]).max(0.0) + (PLOT[0] - b[0]).max(0.0) + (b[3] - PLOT[3]).max(0.0);
        taken.iter().map(overlap).sum::<f64>() + 1e3 * beyond
    };
    let best = places.into_iter().min_by(|&a, &b| covered(boxed(a)).total_cmp(&covered(boxed(b))));
    let Some([dx, dy]) = best else { return };
    taken.push(boxed([dx, dy]));
    text(out, "soft small halo", [x + dx, y + dy + 4.0], "middle", words);
}
