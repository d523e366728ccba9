//! Which cells an isovalue crosses, and which texels its surface looks up.

use super::Pyramid;
use crate::volume::{Sample, Volume, with_samples};

/// Calls `found(x, y, z)` for every cell with a solid corner and one that is not, in the order of
/// the cells (x fastest). The test is the one of the tracer and of the extraction: a corner is
/// solid where s·(raw − c) > 0, with the isovalue rounded to `f32` once.
pub fn for_each_crossed_cell(volume: &Volume, pyramid: &Pyramid, isovalue: f64, mut found: impl FnMut([usize; 3])) {
    let raw = volume.raw_from_value(isovalue) as f32;
    with_samples!(volume.samples(), s => scan(s, volume, pyramid, raw, &mut found));
}

fn scan<T: Sample>(
    samples: &[T],
    volume: &Volume,
    pyramid: &Pyramid,
    isovalue: f32,
    found: &mut impl FnMut([usize; 3]),
) {
    let [nx, ny, nz] = volume.dims();
    if nx < 2 || ny < 2 || nz < 2 {
        return;
    }
    let sign = volume.solid_sign();
    let signed = sign * isovalue;
    const SIDE: usize = 4;
    for z in 0..nz - 1 {
        for y in 0..ny - 1 {
            for block in 0..(nx - 1).div_ceil(SIDE) {
                let (low, high) = pyramid.block_range([block * SIDE, y, z]);
                if high <= signed || low > signed {
                    continue;
                }
                for x in block * SIDE..(block * SIDE + SIDE).min(nx - 1) {
                    let base = x + nx * (y + ny * z);
                    let solid = |i: usize| usize::from(sign * samples[i].raw() > signed);
                    let count: usize =
                        [0, nx, nx * ny, nx * ny + nx].iter().map(|o| solid(base + o) + solid(base + o + 1)).sum();
                    if count != 0 && count != 8 {
                        found([x, y, z]);
                    }
                }
            }
        }
    }
}
