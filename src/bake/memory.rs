//! What a bake takes of memory, before it starts.

use crate::transfer::precision::bytes_of_texel as bytes_at;
use crate::transfer::{BRICK_TEXELS, Layers, Layout, Precision};
use crate::volume::Volume;

/// Bytes of one texel in a store.
pub fn bytes_of_texel(layers: &Layers) -> u64 {
    bytes_at(layers, Precision::Half) as u64
}

/// Chunks that a bake holds at a time, and twice that while they are copied into their files.
const CHUNKS_HELD: u64 = 8;

/// Bytes that a bake needs at most: the volume with its pyramid, the bounds of its blocks and its copy on the way into the store, a
/// selection for each isosurface and two more, and the chunks in work (written and old).
pub fn bytes_of_bake(volume: &Volume, layout: &Layout, isosurfaces: usize) -> u64 {
    let texels: u64 = layout.lattice.texels().iter().map(|&m| m as u64).product();
    let samples = volume.samples().len() as u64;
    let chunk = 64 * BRICK_TEXELS as u64 * bytes_of_texel(&layout.layers);
    2 * volume.samples().bytes().len() as u64
        + samples / 6
        + samples * 3 / 8
        + texels / 8 * (isosurfaces as u64 + 2)
        + 2 * CHUNKS_HELD * chunk
}
