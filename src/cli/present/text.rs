//! Tables and lines as people read them.

pub(in crate::cli) use crate::quantity::{bytes, count, duration, metric, number, percent, rate};

/// Cells of a row of a table.
pub(in crate::cli) fn row<'a>(cells: impl IntoIterator<Item = &'a str>) -> Vec<String> {
    cells.into_iter().map(String::from).collect()
}

/// Columns of a line that people read.
pub(in crate::cli) const WIDTH: usize = 80;

/// Words in lines of at most [`WIDTH`] columns; those after the first begin with `indent` spaces, and the first is taken to
/// begin at column `from`. A longer word stays whole, and so does a text that fits.
pub(in crate::cli) fn wrapped(text: &str, from: usize, indent: usize) -> String {
    if from + text.chars().count() <= WIDTH {
        return text.into();
    }
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

/// Each line of a text in lines of at most [`WIDTH`] columns, those after its first two columns further in.
pub(in crate::cli) fn fitted(text: &str) -> String {
    let line = |line: &str| {
        let indent = line.len() - line.trim_start().len();
        format!("{}{}", &line[..indent], wrapped(&line[indent..], indent, indent + 2))
    };
    text.split('\n').map(line).collect::<Vec<_>>().join("\n")
}

/// A file that was written, and what is in it.
pub(in crate::cli) fn file_line(path: &std::path::Path, what: &str) -> String {
    wrapped(&format!("{}: {what}", path.display()), 0, 2)
}

/// Rows of cells in columns, two spaces apart, in at most [`WIDTH`] columns: where they do not fit, the last column is
/// wrapped if that leaves room for words, else the table is transposed, as many records side by side as fit.
pub(in crate::cli) fn table(rows: &[Vec<String>]) -> String {
    let widths = widths(rows);
    let Some((last, others)) = widths.split_last() else { return String::new() };
    let before: usize = others.iter().map(|w| w + GAP).sum();
    if before + last <= WIDTH || before + MOST_WORDS <= WIDTH {
        return in_columns(rows, &widths);
    }
    let Some((head, records)) = rows.split_first() else { return String::new() };
    let mut groups = Vec::new();
    let mut rest = records;
    while !rest.is_empty() {
        let transposed = |count: usize| -> Vec<Vec<String>> {
            let cell = |row: &Vec<String>, c: usize| row.get(c).cloned().unwrap_or_default();
            let line = |c: usize| std::iter::once(head[c].clone()).chain(rest[..count].iter().map(move |r| cell(r, c)));
            (0..head.len()).map(|c| line(c).collect()).collect()
        };
        let fits = |count: &usize| widths_sum(&transposed(*count)) <= WIDTH;
        let count = (1..=rest.len()).take_while(fits).last().unwrap_or(1);
        let group = transposed(count);
        groups.push(in_columns(&group, &self::widths(&group)));
        rest = &rest[count..];
    }
    groups.join("\n\n")
}

/// Columns between cells.
const GAP: usize = 2;
/// Columns that a wrapped column of words needs.
const MOST_WORDS: usize = 34;

fn widths(rows: &[Vec<String>]) -> Vec<usize> {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |c: usize| rows.iter().filter_map(|r| r.get(c)).map(|s| s.chars().count()).max().unwrap_or(0);
    (0..columns).map(width).collect()
}

fn widths_sum(rows: &[Vec<String>]) -> usize {
    let widths = widths(rows);
    widths.iter().sum::<usize>() + GAP * widths.len().saturating_sub(1)
}

/// Cells in columns of given widths; the last one is wrapped where it does not fit.
fn in_columns(rows: &[Vec<String>], widths: &[usize]) -> String {
    let line = |row: &Vec<String>| {
        let mut text = String::new();
        let mut column = 0;
        for (c, cell) in row.iter().enumerate() {
            if c + 1 < widths.len() {
                text.push_str(cell);
                text.push_str(&" ".repeat(widths[c] - cell.chars().count() + GAP));
                column += widths[c] + GAP;
            } else {
                text.push_str(&wrapped(cell, column, column));
            }
        }
        text.trim_end().to_string()
    };
    rows.iter().map(line).collect::<Vec<_>>().join("\n")
}

/// A histogram as one line of blocks, the highest bin full; bins that are not empty show at least the lowest.
pub(in crate::cli) fn sparkline(bins: &[u64]) -> String {
    const BLOCKS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    // Square root: a background that holds most samples must not flatten the rest.
    let highest = bins.iter().copied().max().unwrap_or(0) as f64;
    let block = |&n: &u64| match n {
        0 => ' ',
        n => BLOCKS[((n as f64 / highest).sqrt() * 7.0).round() as usize],
    };
    bins.iter().map(block).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sparkline_shows_every_bin_that_is_not_empty() {
        assert_eq!(sparkline(&[0, 1, 1_000_000, 250_000]), " ▁█▅");
    }

    #[test]
    fn tables_align_their_columns() {
        let rows = [vec!["a".to_string(), "bb".into()], vec!["ccc".into(), "d".into()]];
        assert_eq!(table(&rows), "a    bb\nccc  d");
    }

    fn cells(rows: &[&[&str]]) -> Vec<Vec<String>> {
        rows.iter().map(|row| row.iter().map(|cell| cell.to_string()).collect()).collect()
    }

    #[test]
    fn wide_tables_wrap_their_last_column_or_are_transposed() {
        let long = "a reason that goes on ".repeat(10);
        let wrapped = table(&cells(&[&["effect", "reason"], &["shadowing", &long]]));
        assert!(
            wrapped.lines().count() > 3 && wrapped.lines().skip(2).all(|line| line.starts_with("           ")),
            "{wrapped}"
        );
        let figure = "12.34 % ± 0.56 %";
        let wide: Vec<Vec<String>> =
            (0..9).map(|i| vec![if i == 0 { "head".into() } else { figure.to_string() }; 9]).collect();
        let transposed = table(&wide);
        // Nine fields, and eight records in groups.
        assert!(transposed.split("\n\n").count() > 1 && transposed.matches(figure).count() == 8 * 9, "{transposed}");
        for line in wrapped.lines().chain(transposed.lines()) {
            assert!(line.chars().count() <= WIDTH, "{line}");
        }
    }

    #[test]
    fn lines_are_broken_at_words_and_keep_their_indent() {
        let fitted = fitted(&format!("   {}\nshort  line", "word ".repeat(40).trim_end()));
        assert!(fitted.lines().all(|line| line.chars().count() <= WIDTH));
        assert!(fitted.lines().nth(1).is_some_and(|line| line.starts_with("     word")), "{fitted}");
        assert!(fitted.ends_with("\nshort  line"), "what fits stays as it is: {fitted}");
    }

    #[test]
    fn shares_above_one_only_say_so() {
        assert_eq!([0.5, 1.0, 1.0001, 520.12].map(percent), ["50 %", "100 %", "100 %", "> 100 %"]);
    }
}
