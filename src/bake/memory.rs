//! What a bake takes of memory, before it starts.

use crate::level::bytes_of_field;
use crate::surface::count_straddling_cells;
use crate::transfer::precision::bytes_of_texel as bytes_at;
use crate::transfer::{BRICK_TEXELS, Layers, Layout, Precision};
use crate::transport::most_in_work;
use crate::volume::Volume;

/// Bytes of one texel in a store.
pub fn bytes_of_texel(layers: &Layers) -> u64 {
    bytes_at(layers, Precision::Half) as u64
}

/// The program itself, its stacks, and what is small.
const PROGRAM: u64 = 8 << 20;

/// Bytes that are held for each vertex of all surfaces: position, normal, two triangles.
const OF_VERTEX: u64 = 48;

/// Bytes of a vertex of a surface while it is extracted, beside those: what is sorted, and the order.
const OF_VERTEX_AT_WORK: u64 = 64;

/// Isosurfaces of a longer list whose vertices are counted; the others are taken to be like them.
const MOST_COUNTED: usize = 4;

/// Cells that some of the isosurfaces cross, of a longer list a few.
pub fn crossed_cells(volume: &Volume, isovalues: &[f64]) -> Vec<u64> {
    let stride = isovalues.len().div_ceil(MOST_COUNTED).max(1);
    isovalues.iter().step_by(stride).map(|&c| count_straddling_cells(volume, c)).collect()
}

/// About the bytes that a bake of these isovalues, or of all, needs by so many threads, or those of this process: the field, and what is
/// held at one time of sets of texels (a bit each), meshes (of a bake at vertices all of them) and chunks in work, as they are and as
/// they were. Isovalues are how many, with [`crossed_cells`].
pub fn bytes_of_bake(
    volume: &Volume,
    layout: &Layout,
    isovalues: Option<(usize, &[u64])>,
    at_vertices: bool,
    threads: Option<usize>,
) -> u64 {
    let texels: u64 = layout.lattice.texels().iter().map(|&m| m as u64).product();
    let chunk = 64 * BRICK_TEXELS as u64 * bytes_of_texel(&layout.layers);
    let chunks = 2 * most_in_work(threads) as u64 * chunk;
    let (count, counted) = isovalues.map_or((1, &[][..]), |(count, counted)| (count as u64, counted));
    // As many cells as vertices: a crossed edge has four cells, a crossed cell four such edges in the mean.
    let (largest, all) = (counted.iter().max().copied().unwrap_or(0), counted.iter().sum::<u64>());
    let bits = volume.samples().len() as u64 / 8;
    let at_work = if at_vertices {
        let meshes = OF_VERTEX * all * count / counted.len().max(1) as u64;
        (2 * bits).max(meshes + chunks.max(OF_VERTEX_AT_WORK * largest))
    } else {
        let selections = texels / 8 * (count + 2);
        selections + chunks.max((OF_VERTEX + OF_VERTEX_AT_WORK) * largest)
    };
    PROGRAM + bytes_of_field(volume) + at_work
}
