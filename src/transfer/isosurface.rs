//! Which texels and chunks an isosurface needs.

use super::{CHUNK, Lattice, Selection};
use crate::grid3;
use crate::surface::straddling_cells;
use crate::volume::{Sample, Volume, with_samples};
use rayon::prelude::*;

/// Slabs of cells that a thread marks in a row: enough that few sets are merged.
const SLABS: usize = 64;

/// The texels that lookups anywhere on one isosurface read; `isovalue` in the file's values. None for an
/// isovalue out of range.
pub fn texels_of_isosurface(volume: &Volume, lattice: Lattice, isovalue: f64) -> Selection {
    let cells = straddling_cells(volume, isovalue);
    // Each thread marks the cells of some slabs in a set of its own.
    let slabs = (0..cells.dims()[2]).into_par_iter().with_min_len(SLABS);
    let sets = slabs.fold(
        || Selection::empty(lattice),
        |mut selection, z| {
            cells.for_each_in_slab(z, |x, y| selection.insert_cell([x, y, z]));
            selection
        },
    );
    sets.reduce_with(Selection::with).unwrap_or_else(|| Selection::empty(lattice))
}

/// The texels of several isosurfaces; those of all where there is no list.
pub fn texels_of_isosurfaces(volume: &Volume, lattice: Lattice, isovalues: Option<&[f64]>) -> Selection {
    let Some(list) = isovalues else { return Selection::of_all_isosurfaces(lattice, volume) };
    let mut selection = Selection::empty(lattice);
    list.iter().for_each(|&c| selection.insert_all(&texels_of_isosurface(volume, lattice, c)));
    selection
}

/// The extent in raw values (largest minus smallest corner) of the cells that one isosurface crosses, summed over
/// each chunk of the texture, x fastest: how much of the field's range a chunk shows, so what to bake first.
/// Isosurfaces of other isovalues, too, meet steep cells more often (importance by extent: Beason 2005).
pub fn extents_by_chunk(volume: &Volume, lattice: Lattice, isovalue: f64) -> Vec<f64> {
    let cells = straddling_cells(volume, isovalue);
    let [cx, cy, cz] = lattice.chunks();
    let [nx, ny, _] = volume.dims();
    let mut sums = vec![0.0; cx * cy * cz];
    let corners: [usize; 8] = std::array::from_fn(|i| (i & 1) + nx * ((i >> 1 & 1) + ny * (i >> 2)));
    with_samples!(volume.samples(), s => {
        for z in 0..cells.dims()[2] {
            cells.for_each_in_slab(z, |x, y| {
                let values = corners.map(|offset| s[grid3::index([nx, ny], [x, y, z]) + offset].raw());
                let high = values.iter().copied().fold(f32::NEG_INFINITY, f32::max);
                let low = values.iter().copied().fold(f32::INFINITY, f32::min);
                let cell = [x, y, z];
                let [i, j, k] = std::array::from_fn(|a| (cell[a] as f64 / lattice.step(a)) as usize / CHUNK);
                sums[i.min(cx - 1) + cx * (j.min(cy - 1) + cy * k.min(cz - 1))] += f64::from(high) - f64::from(low);
            });
        }
    });
    sums
}
