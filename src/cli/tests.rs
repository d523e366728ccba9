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
