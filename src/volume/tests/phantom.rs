//! The phantom that every format must bring back: 5 × 7 × 9 samples, no two axes alike, in frames that show a transposed
//! matrix, a flipped axis and an origin at a corner of a voxel.

use super::*;
use glam::DMat3;

pub(super) const DIMS: [usize; 3] = [5, 7, 9];
pub(super) const SPACING: [f64; 3] = [0.5, 0.7, 1.1];
pub(super) const ORIGIN: DVec3 = DVec3::new(10.0, -20.0, 30.0);

pub(super) fn value(x: usize, y: usize, z: usize) -> u16 {
    (100 * x + 10 * y + z) as u16
}

/// Axes of unit length as columns: straight, oblique, and left-handed. Of numbers that decimals write exactly: the columns of
/// the oblique one are (2, 1, 2)/3 and the like in thirds, so that a third is written as 0.333….
pub(super) fn directions() -> [DMat3; 3] {
    let oblique = DMat3::from_cols(DVec3::new(2.0, 1.0, 2.0), DVec3::new(-2.0, 2.0, 1.0), DVec3::new(-1.0, -2.0, 2.0))
        * (1.0 / 3.0);
    [DMat3::IDENTITY, oblique, oblique * DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0))]
}

/// The samples, x fastest, encoded.
pub(super) fn samples(encode: impl Fn(u16) -> Vec<u8>) -> Vec<u8> {
    points(DIMS).flat_map(|(x, y, z)| encode(value(x, y, z))).collect()
}

/// `a b c`.
pub(super) fn words(numbers: &[f64]) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

/// Asserts each sample and its place: `axes` as columns of unit length, the first sample at `origin`.
pub(super) fn assert_phantom(volume: &Volume, axes: DMat3, origin: DVec3) {
    assert_eq!(volume.dims(), DIMS);
    let steps = axes * DMat3::from_diagonal(DVec3::from_array(SPACING));
    let size = (steps * DVec3::from_array(DIMS.map(|n| n as f64))).length();
    for (x, y, z) in points(DIMS) {
        let raw = f64::from(volume.samples().raw(volume.index(x, y, z)));
        assert_eq!(volume.value_from_raw(raw), f64::from(value(x, y, z)), "at {x} {y} {z}");
        let place = DVec3::new(x as f64, y as f64, z as f64);
        assert_close(volume.world_from_grid().point(place), origin + steps * place, 1e-5 * size);
    }
}
