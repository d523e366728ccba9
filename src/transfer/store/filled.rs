//! Chunks of a texture that leaves texels out, as readers see them: filled in from those that were baked.

use super::super::strides::ClosedChunk;
use super::super::{Brick, BrickSource, BrickView};
use super::Store;
use crate::error::Result;
use crate::grid3;
use crate::transfer::texture::check_index;
use std::sync::{Mutex, OnceLock, PoisonError};

/// Chunks that were filled in.
#[derive(Debug)]
pub(super) struct Filled {
    // One cell for each chunk of the lattice, x fastest; inside one entry a brick, `None` where nothing was filled in. Empty where a
    // texture leaves nothing out.
    chunks: Vec<OnceLock<Vec<Option<Brick>>>>,
    /// One thread at a time fills a chunk: by its linear index, modulo their number.
    turns: [Mutex<()>; 16],
}

impl Filled {
    /// Nothing yet, of so many chunks.
    pub fn new(chunks: usize) -> Self {
        let chunks = std::iter::repeat_with(OnceLock::new).take(chunks).collect();
        Self { chunks, turns: Default::default() }
    }

    /// Forgets what was filled in.
    pub fn clear(&mut self) {
        self.chunks.iter_mut().for_each(|cell| *cell = OnceLock::new());
    }
}

impl Store {
    /// Whether texels that were not baked are the mean of others.
    pub(super) fn leaves_out(&self) -> bool {
        !self.filled.chunks.is_empty()
    }

    /// The bricks of a chunk in which texels were filled in.
    fn filled(&self, chunk: [usize; 3]) -> Result<&[Option<Brick>]> {
        let slot = self.slot(chunk);
        let cell = &self.filled.chunks[slot];
        if let Some(known) = cell.get() {
            return Ok(known);
        }
        let _turn = self.filled.turns[slot % self.filled.turns.len()].lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = cell.get() {
            return Ok(known);
        }
        let mut closed = ClosedChunk::new(&self.layout.lattice, &self.layout.layers, chunk);
        for (slot, brick) in ClosedChunk::places(&self.layout.lattice, chunk) {
            closed.put(slot, self.baked_brick(brick)?.map(|view| view.to_brick()));
        }
        Ok(cell.get_or_init(|| closed.filled()))
    }
}

/// Bricks as they were when their chunk was first touched through this [`Store`]; with the texels that the bake left out.
impl BrickSource for Store {
    fn layout(&self) -> &super::super::Layout {
        &self.layout
    }

    fn brick(&self, index: [usize; 3]) -> Result<Option<BrickView<'_>>> {
        check_index("brick", index, self.layout.lattice.bricks())?;
        if !self.leaves_out() {
            return self.baked_brick(index);
        }
        let count = self.layout.lattice.bricks_of_chunk();
        let slot = grid3::index([count[0], count[1]], std::array::from_fn(|a| index[a] % count[a]));
        match &self.filled(std::array::from_fn(|a| index[a] / count[a]))?[slot] {
            Some(brick) => Ok(Some(brick.view())),
            None => self.baked_brick(index),
        }
    }
}
