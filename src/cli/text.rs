//! Numbers, tables and names as people read them.

pub(super) use crate::scene::nearest;
use std::time::Duration;

/// 12345678 → "12,345,678".
pub(super) fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::with_capacity(digits.len() + digits.len() / 3);
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// Bytes with a decimal unit.
pub(super) fn bytes(n: f64) -> String {
    match n {
        n if n >= 1e9 => format!("{:.2} GB", n / 1e9),
        n if n >= 1e6 => format!("{:.1} MB", n / 1e6),
        n if n >= 1e3 => format!("{:.1} kB", n / 1e3),
        n => format!("{n:.0} B"),
    }
}

/// A large number with a metric prefix, such as rays.
pub(super) fn metric(n: f64) -> String {
    match n {
        n if n >= 1e9 => format!("{:.2} G", n / 1e9),
        n if n >= 1e6 => format!("{:.1} M", n / 1e6),
        n if n >= 1e3 => format!("{:.1} k", n / 1e3),
        n => format!("{n:.0} "),
    }
}

/// Rays in a time.
pub(super) fn rate(rays: f64, time: Duration) -> String {
    format!("{:.2} Mrays/s", rays / time.as_secs_f64().max(1e-9) / 1e6)
}

/// A duration in milliseconds or seconds.
pub(super) fn duration(time: Duration) -> String {
    let seconds = time.as_secs_f64();
    if seconds < 1.0 { format!("{:.1} ms", 1e3 * seconds) } else { format!("{seconds:.2} s") }
}

/// A number to about `digits` significant digits, without trailing zeros, never with more than needed.
pub(super) fn number(value: f64, digits: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let magnitude = value.abs().log10().floor() as i32;
    if !(-5..15).contains(&magnitude) {
        return format!("{:.*e}", digits.saturating_sub(1), value);
    }
    let decimals = (digits as i32 - 1 - magnitude).clamp(0, 17) as usize;
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_string() } else { text }
}

/// A share as a percentage; what is above 100 % only says so.
pub(super) fn percent(share: f64) -> String {
    if share > 1.0005 { "> 100 %".into() } else { format!("{} %", number(100.0 * share, 3)) }
}

/// Columns of a line that people read.
pub(super) const WIDTH: usize = 80;

/// Words in lines of at most [`WIDTH`] columns; those after the first begin with `indent` spaces, and the first is taken to
/// begin at column `from`. A longer word stays whole.
pub(super) fn wrapped(text: &str, from: usize, indent: usize) -> String {
    let mut out = String::new();
    let mut column = from;
    for word in text.split_whitespace() {
        let length = word.chars().count();
        if out.is_empty() {
            column += length;
        } else if column + 1 + length > WIDTH {
            out.push('\n');
            out.push_str(&" ".repeat(indent));
            column = indent + length;
        } else {
            out.push(' ');
            column += 1 + length;
        }
        out.push_str(word);
    }
    out
}

/// A file that was written, and what is in it.
pub(super) fn file_line(path: &std::path::Path, what: &str) -> String {
    wrapped(&format!("{}: {what}", path.display()), 0, 2)
}

/// Names and what there is to say of them, in two columns, the second in as many lines as it needs.
pub(super) fn details(rows: &[(String, String)]) -> String {
    let column = rows.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0) + 2;
    let row = |(name, text): &(String, String)| {
        let gap = " ".repeat(column - name.chars().count());
        let lines: Vec<String> = text.lines().map(|line| wrapped(line, column, column)).collect();
        format!("{name}{gap}{}", lines.join(&format!("\n{}", " ".repeat(column)))).trim_end().to_string()
    };
    rows.iter().map(row).collect::<Vec<_>>().join("\n")
}

/// Rows of cells in columns, two spaces apart; the last column is not padded.
pub(super) fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |c: usize| rows.iter().filter_map(|r| r.get(c)).map(|s| s.chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let line = |row: &Vec<String>| {
        let mut text = String::new();
        for (c, cell) in row.iter().enumerate() {
            text.push_str(cell);
            if c + 1 < row.len() {
                text.push_str(&" ".repeat(widths[c] - cell.chars().count() + 2));
            }
        }
        text.trim_end().to_string()
    };
    rows.iter().map(line).collect::<Vec<_>>().join("\n")
}

/// A histogram as one line of blocks, the highest bin full; bins that are not empty show at least the lowest.
pub(super) fn sparkline(bins: &[u64]) -> String {
    const BLOCKS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    // Square root: a background that holds most samples must not flatten the rest.
    let highest = bins.iter().copied().max().unwrap_or(0) as f64;
    let block = |&n: &u64| match n {
        0 => ' ',
        n => BLOCKS[((n as f64 / highest).sqrt() * 7.0).round() as usize],
    };
    bins.iter().map(block).collect()
}
