use super::*;

#[test]
fn sizes_that_cannot_be_are_refused() {
    assert!(Image::new(2, 2, vec![[0.0; 4]; 3]).is_err());
    assert!(Image::filled(0, 5, [0.0; 4]).is_err());
    assert!(Image::filled(usize::MAX, 2, [0.0; 4]).is_err());
    assert!(Image::filled(usize::MAX / 16, 1, [0.0; 4]).is_err());
    assert!(Image::filled(3, 2, [0.0; 4]).unwrap().reduced(3).is_err());
}

#[test]
fn over_mixes_in_linear_light() {
    let half_red = [1.0, 0.0, 0.0, 0.5];
    assert_eq!(over(half_red, [0.0, 0.0, 1.0, 1.0]), [0.5, 0.0, 0.5, 1.0]);
    assert_eq!(over(half_red, [0.0; 4]), half_red, "over nothing the colour stays");
    assert_eq!(over([9.0, 9.0, 9.0, 0.0], [0.0; 4]), [0.0; 4]);
}

#[test]
fn reduction_is_the_mean_weighted_by_alpha() {
    let image =
        Image::new(2, 2, vec![[1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 0.0], [0.0; 4], [0.5, 0.0, 0.0, 1.0]]).unwrap();
    assert_eq!(image.reduced(2).unwrap().pixels(), [[0.75, 0.0, 0.0, 0.5]]);
    assert_eq!(image.reduced(1).unwrap().pixel(0, 0), [1.0, 0.0, 0.0, 1.0]);
}
