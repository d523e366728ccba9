//! One image of several boxes of samples.

// Indices are axes, and places inside boxes that were checked to lie in the whole.
#![allow(clippy::indexing_slicing)]

use super::super::super::decode::{Data, checked_count};
use super::super::super::read::ReadHint;
use super::{Extent, NAME, damaged};
use crate::error::{Error, Result};

/// The samples of a piece.
pub(super) struct Block {
    pub(super) first: [i64; 3],
    pub(super) dims: [usize; 3],
    pub(super) data: Data,
}

/// Puts the blocks together. Samples that several have, as neighbours share a layer of points and ghosts, must be the same.
///
/// # Errors
/// When a block lies outside, a sample is missing, or two blocks disagree.
pub(super) fn join(
    mut blocks: Vec<Block>,
    whole: &Extent,
    of_cells: bool,
    hint: &ReadHint,
) -> Result<(Data, [usize; 3])> {
    let dims = whole.dims(of_cells);
    let sizes = dims.map(|n| n as usize);
    if let [block] = blocks.as_slice()
        && block.first == whole.first
        && block.dims == sizes
        && let Some(block) = blocks.pop()
    {
        return Ok((block.data, sizes));
    }
    // No more is allocated than the blocks hold.
    let held = blocks.iter().fold(0u64, |n, b| n.saturating_add(b.dims.iter().product::<usize>() as u64));
    let count = checked_count(NAME, dims, 1, None, hint)?;
    let Some(first) = blocks.first().filter(|_| held >= count as u64) else {
        let found = format!("{} pieces of {held} samples", blocks.len());
        return Err(damaged(found, &format!("{count} samples, as the whole extent says")));
    };
    let kind = std::mem::discriminant(&first.data);
    if blocks.iter().any(|b| std::mem::discriminant(&b.data) != kind) {
        return Err(damaged("pieces of different types", "one type"));
    }
    macro_rules! paste_all {
        ($($variant:ident),*) => {
            match first.data {
                $(Data::$variant(_) => {
                    let all = blocks.iter().filter_map(|b| match &b.data {
                        Data::$variant(v) => Some((b, v.as_slice())),
                        _ => None,
                    });
                    Data::$variant(paste(all, whole, sizes)?)
                })*
            }
        };
    }
    let data = paste_all!(U8, I8, U16, I16, U32, I32, U64, I64, F32, F64);
    Ok((data, sizes))
}

fn paste<'a, T: bytemuck::Pod + Default>(
    blocks: impl Iterator<Item = (&'a Block, &'a [T])>,
    whole: &Extent,
    [nx, ny, nz]: [usize; 3],
) -> Result<Vec<T>> {
    let mut out = vec![T::default(); nx * ny * nz];
    let mut is_there = vec![false; out.len()];
    for (block, samples) in blocks {
        let [x0, y0, z0] = [0, 1, 2].map(|a| usize::try_from(block.first[a].saturating_sub(whole.first[a])).ok());
        let [bx, by, bz] = block.dims;
        let ends =
            |start: Option<usize>, size: usize, n: usize| start.filter(|s| s.checked_add(size).is_some_and(|e| e <= n));
        let (Some(x0), Some(y0), Some(z0)) = (ends(x0, bx, nx), ends(y0, by, ny), ends(z0, bz, nz)) else {
            return Err(damaged(format!("a piece at {:?} outside the whole extent", block.first), "pieces inside it"));
        };
        for (row, values) in samples.chunks_exact(bx.max(1)).enumerate() {
            let (y, z) = (y0 + row % by, z0 + row / by);
            let start = x0 + nx * (y + ny * z);
            let (out, is_there) = (&mut out[start..start + bx], &mut is_there[start..start + bx]);
            let differs = |i: usize| is_there[i] && bytemuck::bytes_of(&out[i]) != bytemuck::bytes_of(&values[i]);
            if let Some(x) = (0..bx).find(|&i| differs(i)) {
                let found = format!("two pieces that disagree at sample {}, {y}, {z}", x0 + x);
                let remedy = "save the pieces without ghost levels, or as one file";
                return Err(Error::format(NAME, found, "the same values where pieces overlap", remedy));
            }
            out.copy_from_slice(values);
            is_there.fill(true);
        }
    }
    if let Some(at) = is_there.iter().position(|there| !there) {
        let [x, y, z] = [at % nx, at / nx % ny, at / (nx * ny)];
        let remedy = "a piece is missing; copy all files of the .pvti";
        return Err(Error::format(NAME, format!("no piece with sample {x}, {y}, {z}"), "pieces without gaps", remedy));
    }
    Ok(out)
}
