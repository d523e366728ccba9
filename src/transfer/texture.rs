//! A transfer texture in memory: what a bake fills before it writes, and what tests and previews
//! read without a disk.

use super::{BRICK_TEXELS, Brick, BrickSource, BrickView, Layers, Layout};
use crate::error::{Error, Result};
use crate::grid3;

/// A transfer texture held in memory.
#[derive(Clone, Debug, PartialEq)]
pub struct MemoryTexture {
    layout: Layout,
    // Invariant: one entry for each brick of the lattice, x fastest; every brick passed
    // `check_brick` against `layout.layers`.
    bricks: Vec<Option<Brick>>,
}

impl MemoryTexture {
    /// A texture in which nothing is baked.
    pub fn new(layout: Layout) -> Self {
        let count = layout.lattice.bricks().iter().product();
        Self { layout, bricks: vec![None; count] }
    }

    /// A copy of all bricks of another source.
    ///
    /// # Errors
    /// When the source cannot be read.
    pub fn from_source(source: &impl BrickSource) -> Result<Self> {
        let mut texture = Self::new(source.layout().clone());
        let [nx, ny, nz] = texture.layout.lattice.bricks();
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    if let Some(view) = source.brick([x, y, z])? {
                        texture.insert([x, y, z], view.to_brick())?;
                    }
                }
            }
        }
        Ok(texture)
    }

    /// Puts a brick at a brick index (x, y, z) and returns the one that was there.
    ///
    /// # Errors
    /// When the index is outside the lattice or the brick has other lengths than its layers ask for.
    pub fn insert(&mut self, index: [usize; 3], brick: Brick) -> Result<Option<Brick>> {
        check_brick(&brick, &self.layout.layers)?;
        let slot = brick_slot(&self.layout, index)?;
        Ok(self.bricks[slot].replace(brick))
    }

    /// Puts the bricks of a chunk, x fastest, into their places; those that are `None` leave what was there.
    ///
    /// # Errors
    /// As [`MemoryTexture::insert`].
    pub fn insert_chunk(&mut self, chunk: [usize; 3], bricks: Vec<Option<Brick>>) -> Result<()> {
        let lattice = self.layout.lattice;
        for (slot, brick) in bricks.into_iter().enumerate() {
            if let Some(brick) = brick {
                self.insert(lattice.brick_in_chunk(chunk, slot), brick)?;
            }
        }
        Ok(())
    }

    /// Takes the brick at a brick index out of the texture.
    ///
    /// # Errors
    /// When the index is outside the lattice.
    pub fn remove(&mut self, index: [usize; 3]) -> Result<Option<Brick>> {
        let slot = brick_slot(&self.layout, index)?;
        Ok(self.bricks[slot].take())
    }

    /// Number of bricks that are there.
    pub fn len(&self) -> usize {
        self.bricks.iter().flatten().count()
    }

    /// Whether nothing is baked.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl BrickSource for MemoryTexture {
    fn layout(&self) -> &Layout {
        &self.layout
    }

    fn brick(&self, index: [usize; 3]) -> Result<Option<BrickView<'_>>> {
        let slot = brick_slot(&self.layout, index)?;
        Ok(self.bricks[slot].as_ref().map(Brick::view))
    }
}

impl BrickView<'_> {
    /// An owned copy.
    pub fn to_brick(&self) -> Brick {
        Brick {
            transfer: self.transfer.to_vec(),
            stderr: self.stderr.to_vec(),
            validity: self.validity.to_vec(),
            rays: self.rays.to_vec(),
        }
    }
}

/// Linear index of a brick, x fastest.
fn brick_slot(layout: &Layout, index: [usize; 3]) -> Result<usize> {
    check_index("brick", index, layout.lattice.bricks())?;
    let [nx, ny, _] = layout.lattice.bricks();
    Ok(grid3::index([nx, ny], index))
}

/// Whether an index (x, y, z) of a `what` lies in a box of `count`.
pub(super) fn check_index(what: &'static str, index: [usize; 3], count: [usize; 3]) -> Result<()> {
    if (0..3).all(|a| index[a] < count[a]) {
        return Ok(());
    }
    Err(Error::argument(
        format!("{what} index"),
        format!("({}, {}, {})", index[0], index[1], index[2]),
        format!("an index below ({}, {}, {})", count[0], count[1], count[2]),
        "ask only for what lies in the lattice",
    ))
}

/// Whether a brick has the lengths that its layers ask for.
pub(super) fn check_brick(brick: &Brick, layers: &Layers) -> Result<()> {
    let lengths = [
        ("transfer", brick.transfer.len(), BRICK_TEXELS * layers.coefficients()),
        ("stderr", brick.stderr.len(), BRICK_TEXELS * layers.errors()),
        ("validity", brick.validity.len(), BRICK_TEXELS),
        ("rays", brick.rays.len(), BRICK_TEXELS),
    ];
    match lengths.iter().find(|(_, given, expected)| given != expected) {
        None => Ok(()),
        Some((name, given, expected)) => Err(Error::argument(
            format!("brick.{name}"),
            format!("{given} entries"),
            format!("{expected} for bands {:?}", layers.bands()),
            "make the brick with the layers of the texture",
        )),
    }
}

#[cfg(test)]
mod tests;
