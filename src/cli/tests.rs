//! Tests of the parts that print and choose.

use super::text;
use clap::CommandFactory;

#[test]
fn the_command_line_is_well_formed() {
    super::Cli::command().debug_assert();
}

#[test]
fn numbers_are_short_and_exact_enough() {
    let shown = |v: f64| text::number(v, 6);
    assert_eq!(
        [0.0, 90.0, 160.5, -0.6, 1e-9, 123456789.0].map(shown),
        ["0", "90", "160.5", "-0.6", "1.00000e-9", "123456789"]
    );
    assert_eq!(text::count(1234567), "1,234,567");
    assert_eq!(text::bytes(2.5e9), "2.50 GB");
}

#[test]
fn misspelt_names_find_their_neighbour_and_others_none() {
    let names = ["courtyard", "studio", "sunset"];
    assert_eq!(text::nearest("cuortyard", names), Some("courtyard"));
    assert_eq!(text::nearest("Sunst", names), Some("sunset"));
    assert_eq!(text::nearest("brain", names), None);
}

#[test]
fn a_sparkline_shows_every_bin_that_is_not_empty() {
    assert_eq!(text::sparkline(&[0, 1, 1_000_000, 250_000]), " ▁█▅");
}

#[test]
fn tables_align_their_columns() {
    let rows = [vec!["a".to_string(), "bb".into()], vec!["ccc".into(), "d".into()]];
    assert_eq!(text::table(&rows), "a    bb\nccc  d");
}

fn cells(rows: &[&[&str]]) -> Vec<Vec<String>> {
    rows.iter().map(|row| row.iter().map(|cell| cell.to_string()).collect()).collect()
}

#[test]
fn wide_tables_wrap_their_last_column_or_are_transposed() {
    let long = "a reason that goes on ".repeat(10);
    let wrapped = text::table(&cells(&[&["effect", "reason"], &["shadowing", &long]]));
    assert!(
        wrapped.lines().count() > 3 && wrapped.lines().skip(2).all(|line| line.starts_with("           ")),
        "{wrapped}"
    );
    let figure = "12.34 % ± 0.56 %";
    let wide: Vec<Vec<String>> =
        (0..9).map(|i| vec![if i == 0 { "head".into() } else { figure.to_string() }; 9]).collect();
    let transposed = text::table(&wide);
    // Nine fields, and eight records in groups.
    assert!(transposed.split("\n\n").count() > 1 && transposed.matches(figure).count() == 8 * 9, "{transposed}");
    for line in wrapped.lines().chain(transposed.lines()) {
        assert!(line.chars().count() <= text::WIDTH, "{line}");
    }
}

#[test]
fn lines_are_broken_at_words_and_keep_their_indent() {
    let fitted = text::fitted(&format!("   {}\nshort  line", "word ".repeat(40).trim_end()));
    assert!(fitted.lines().all(|line| line.chars().count() <= text::WIDTH));
    assert!(fitted.lines().nth(1).is_some_and(|line| line.starts_with("     word")), "{fitted}");
    assert!(fitted.ends_with("\nshort  line"), "what fits stays as it is: {fitted}");
}

#[test]
fn shares_above_one_only_say_so() {
    assert_eq!([0.5, 1.0, 1.0001, 520.12].map(text::percent), ["50 %", "100 %", "100 %", "> 100 %"]);
}
