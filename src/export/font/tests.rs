use super::*;
use std::collections::BTreeSet;

#[test]
fn every_printable_ascii_letter_is_there_once_and_differs() {
    for code in 0x20..0x7f {
        let letter = char::from(code);
        assert_eq!(GLYPHS.iter().filter(|g| g.0 == letter).count(), 1, "{letter:?}");
    }
    let ascii = GLYPHS.iter().filter(|g| g.0.is_ascii());
    assert_eq!(ascii.clone().map(|g| g.1).collect::<BTreeSet<_>>().len(), ascii.count(), "two letters look alike");
}

#[test]
fn units_of_length_and_angle_have_letters() {
    for letter in "Å µ μ ° nm mm cm m units".chars() {
        assert!(GLYPHS.iter().any(|g| g.0 == letter), "{letter:?}");
    }
}

#[test]
fn pictures_are_well_formed() {
    for (letter, picture) in GLYPHS.iter().chain([&('?', UNKNOWN)]) {
        let rows: Vec<_> = picture.split(' ').collect();
        assert!(rows.len() <= ROWS, "{letter:?}");
        for row in rows {
            assert!(row.len() == COLUMNS && row.bytes().all(|b| b == b'#' || b == b'.'), "{letter:?} {row:?}");
        }
    }
}

#[test]
fn letters_stand_where_they_are_drawn() {
    let mut image = Image::filled(30, 30, [0.0, 0.0, 0.0, 1.0]).unwrap();
    draw(&mut image, 3, 2, "L", 2, [1.0; 4]);
    let lit: Vec<_> = (0..900).map(|i| (i % 30, i / 30)).filter(|&(x, y)| image.pixel(x, y)[0] > 0.5).collect();
    // An upright of 7 rows and a foot of 4 more columns, each 2×2 pixels.
    assert_eq!(lit.len(), 4 * (7 + 4));
    assert!(lit.iter().all(|&(x, y)| (3..13).contains(&x) && (2..16).contains(&y)));
    assert_eq!((width("abc\nde", 2), height("abc\nde", 2)), (2 * 17, 2 * 20));
    assert_eq!((width("", 2), height("", 2)), (0, 0));
    // Off the edge nothing happens, and nothing panics.
    draw(&mut image, 28, 28, "WW\nWW", 3, [1.0; 4]);
}
