use super::*;

const RED: [f32; 4] = [1.0, 0.0, 0.0, 1.0];

#[test]
fn tiles_stand_on_the_grid_with_ink_below() {
    let (large, small) = (Image::filled(60, 40, RED).unwrap(), Image::filled(20, 10, RED).unwrap());
    let tiles: Vec<_> = [(&large, "one"), (&small, "two"), (&large, "three\nlines\nhere")]
        .map(|(image, label)| Tile { image, label })
        .into();
    let style = SheetStyle { columns: Some(2), margin: 10, text_scale: 1, ..Default::default() };
    let sheet = contact_sheet(&tiles, &style).unwrap();
    let label_height = 3 * font::LINE - 2;
    let step_y = 40 + 4 + label_height + 10;
    assert_eq!((sheet.width(), sheet.height()), (10 + 2 * 70, 10 + 2 * step_y));
    let red = |x, y| sheet.pixel(x, y) == RED;
    assert!(red(10, 10) && red(69, 49) && !red(9, 10) && !red(70, 10), "first cell");
    // The small image: 20×10 in the middle of a 60×40 cell at (80, 10).
    assert!(red(100, 25) && red(119, 34) && !red(99, 25) && !red(100, 24) && !red(119, 35), "second cell");
    assert!(red(10, 10 + step_y) && !red(80, 10 + step_y), "third cell, and no fourth");
    let inked = (10..70).any(|x| (54..61).any(|y| sheet.pixel(x, y)[0] < 0.1));
    assert!(inked, "the label of the first tile");
}

#[test]
fn labels_are_broken_and_cut_to_fit() {
    // 60 pixels at scale 1 hold ten letters: 10·6 − 1 = 59.
    assert_eq!(wrapped("isovalue 0.25 of it", 60, 1), "isovalue\n0.25 of it");
    assert_eq!(wrapped("interreflection", 60, 1), "interrefl…");
    assert_eq!(wrapped("a\n\nb", 60, 1), "a\n\nb");
    assert!(wrapped("interreflection of light", 60, 1).lines().all(|l| font::width(l, 1) <= 60));
    assert_eq!(wrapped("abc", 1, 3), "…");
}

#[test]
fn the_layout_tends_to_three_by_two() {
    assert_eq!(columns_for(6, 100, 100), 3);
    assert_eq!(columns_for(4, 100, 100), 2, "no row with a gap");
    assert_eq!(columns_for(1, 100, 100), 1);
    assert_eq!(columns_for(6, 100, 1000), 6);
}

#[test]
fn nothing_to_show_is_an_error() {
    assert!(contact_sheet(&[], &SheetStyle::default()).is_err());
    let image = Image::filled(1, 1, RED).unwrap();
    let tile = [Tile { image: &image, label: "" }];
    assert!(contact_sheet(&tile, &SheetStyle { columns: Some(0), ..Default::default() }).is_err());
    assert!(contact_sheet(&tile, &SheetStyle { text_scale: 0, ..Default::default() }).is_err());
    assert!(contact_sheet(&tile, &SheetStyle { margin: 1 << 20, ..Default::default() }).is_err());
    contact_sheet(&tile, &SheetStyle::default()).unwrap();
}
