//! What all chunks of a store hold together.

use super::{ChunkExtent, Store};
use crate::error::Result;
use crate::grid3;
use std::collections::BTreeMap;

/// The claims of all chunks in one view.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Holdings {
    /// Chunks that are there.
    pub chunks: usize,
    /// Whether some chunk was baked for every isosurface.
    pub all: bool,
    /// Isovalues that were asked for one by one, ascending, in the file's values.
    pub isovalues: Vec<f64>,
    /// Of these, those that the texture was baked for.
    pub in_texture: Vec<f64>,
    /// Of these, those with transfer at the vertices of their isosurfaces.
    pub surfaces: Vec<f64>,
    /// Fewest and most rays of any claim; the most that a texel gets where texels stop at an error.
    pub rays: [u32; 2],
    /// What texels stop by before that, with the smallest and the largest error.
    pub targets: BTreeMap<String, [f64; 2]>,
}

impl Holdings {
    /// Puts the records of chunks together.
    pub fn of<'a>(extents: impl IntoIterator<Item = &'a ChunkExtent>) -> Self {
        let mut held = Self { rays: [u32::MAX, 0], ..Self::default() };
        for extent in extents {
            held.chunks += 1;
            for claim in extent.claims() {
                held.rays = [held.rays[0].min(claim.rays), held.rays[1].max(claim.rays)];
                held.all |= claim.isovalue.is_none();
                held.isovalues.extend(claim.isovalue);
                if let Some(target) = &claim.target {
                    let range = held.targets.entry(target.of.clone()).or_insert([target.error; 2]);
                    *range = [range[0].min(target.error), range[1].max(target.error)];
                }
            }
            held.isovalues.sort_by(f64::total_cmp);
            held.isovalues.dedup();
        }
        held.in_texture = held.isovalues.clone();
        held.rays[0] = held.rays[0].min(held.rays[1]);
        held
    }
}

impl Store {
    /// What the chunks hold, those of surfaces included, as it is on disk now. Reads no bricks.
    ///
    /// # Errors
    /// When a record is damaged or cannot be read.
    pub fn holdings(&self) -> Result<Holdings> {
        let mut extents = self.extents()?;
        let in_texture = Holdings::of(&extents).isovalues;
        let mut surfaces = Vec::new();
        for isovalue in self.surfaces()? {
            let more = self.surface(isovalue)?.map_or_else(|| Ok(Vec::new()), |surface| surface.extents())?;
            if !more.is_empty() {
                surfaces.push(isovalue);
            }
            extents.extend(more);
        }
        Ok(Holdings { in_texture, surfaces, ..Holdings::of(&extents) })
    }

    /// The records of the chunks that are there.
    fn extents(&self) -> Result<Vec<ChunkExtent>> {
        let [cx, cy, cz] = self.layout.lattice.chunks();
        let extents = (0..cx * cy * cz).map(|i| self.chunk_extent(grid3::at([cx, cy], i)));
        extents.filter_map(Result::transpose).collect()
    }

    /// Whether every chunk of it is there: of a surface, whether all of its vertices are.
    ///
    /// # Errors
    /// When a record is damaged or cannot be read.
    #[doc(hidden)]
    pub fn is_complete(&self) -> Result<bool> {
        let all: usize = self.layout.lattice.chunks().iter().product();
        Ok(self.extents()?.len() == all)
    }
}
