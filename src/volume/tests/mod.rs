//! Tests of the readers on bytes made here, field by field from the formats' definitions.

mod arrays;
mod grids;
mod hostile;
mod maps;
mod mapped;
mod metaimage;
mod nifti;
mod npz;
mod nrrd;
mod phantom;
mod real;
mod text;
mod vti;

use super::*;
use flate2::{Compression, write::GzEncoder};
use std::io::Write;

/// Reads bytes as a stream of unknown length and as one of known length; both must agree.
pub(super) fn load(bytes: &[u8]) -> Result<Volume> {
    let streamed = read(bytes, &ReadHint::default());
    let known = ReadHint { length: Some(bytes.len() as u64), ..ReadHint::default() };
    let sized = read(bytes, &known);
    match (&streamed, &sized) {
        (Ok(a), Ok(b)) => {
            assert_eq!((a.dims(), a.samples(), a.world_from_grid()), (b.dims(), b.samples(), b.world_from_grid()));
            assert_eq!(a.notes, b.notes);
        }
        (Err(_), Err(_)) => {}
        _ => panic!("streamed and sized reading disagree: {:?} {:?}", streamed.err(), sized.err()),
    }
    streamed
}

/// The message of the error that reading gives.
pub(super) fn refusal(bytes: &[u8]) -> String {
    match load(bytes) {
        Err(e) => e.to_string(),
        Ok(v) => panic!("a volume of {:?} was read", v.dims()),
    }
}

pub(super) fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A byte order that writes numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Order {
    Little,
    Big,
}

pub(super) const ORDERS: [Order; 2] = [Order::Little, Order::Big];

macro_rules! put {
    ($($name:ident $t:ty),*) => {
        impl Order { $(pub(super) fn $name(self, v: $t) -> Vec<u8> {
            match self { Self::Little => v.to_le_bytes().to_vec(), Self::Big => v.to_be_bytes().to_vec() }
        })* }
    };
}
put!(i16 i16, u16 u16, i32 i32, u32 u32, i64 i64, u64 u64, f32 f32, f64 f64);

/// The value that test files hold at (x, y, z): different at every point of a small grid.
pub(super) fn probe(x: usize, y: usize, z: usize) -> f64 {
    (x + 10 * y + 100 * z) as f64
}

/// Asserts that the volume's value at every (x, y, z) is `probe`.
pub(super) fn assert_probe(volume: &Volume) {
    let [nx, ny, nz] = volume.dims();
    for (x, y, z) in (0..nx * ny * nz).map(|i| (i % nx, i / nx % ny, i / (nx * ny))) {
        let value = volume.value_from_raw(f64::from(volume.samples().raw(volume.index(x, y, z))));
        assert_eq!(value, probe(x, y, z), "at {x} {y} {z}");
    }
}

/// The points of a grid, x fastest.
pub(super) fn points(dims: [usize; 3]) -> impl Iterator<Item = (usize, usize, usize)> {
    let [nx, ny, nz] = dims;
    (0..nx * ny * nz).map(move |i| (i % nx, i / nx % ny, i / (nx * ny)))
}

pub(super) fn assert_close(a: DVec3, b: DVec3, tolerance: f64) {
    assert!((a - b).length() <= tolerance, "{a} is not {b}");
}

/// Corners of cells are read two samples at a time: each must come out as itself.
#[test]
fn pairs_of_samples_keep_their_values() {
    fn check<T: Sample + PartialEq + std::fmt::Debug>(values: &[T]) {
        for pairs in values.windows(8) {
            let at = |i: usize| [pairs[2 * i], pairs[2 * i + 1]];
            let (first, second) = T::turned([at(0), at(1), at(2), at(3)]);
            for i in 0..4 {
                assert_eq!([first[i].to_bits(), second[i].to_bits()], at(i).map(|s| s.raw().to_bits()), "{pairs:?}");
            }
        }
    }
    check(&(0..=u8::MAX).collect::<Vec<_>>());
    check(&(i8::MIN..=i8::MAX).rev().collect::<Vec<_>>());
    check(&(0..=u16::MAX).step_by(251).collect::<Vec<_>>());
    check(&(i16::MIN..=i16::MAX).step_by(251).chain([-1, 0, i16::MAX]).collect::<Vec<_>>());
    check(&[0.0f32, -0.0, 1.5, -2.25e-30, f32::MAX, f32::MIN_POSITIVE, 1e-45, -1e30, 3.0]);
}
