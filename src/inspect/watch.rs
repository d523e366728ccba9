//! How far all processes have come that fill a store.

use crate::error::Result;
use crate::transfer::store::{ChunkExtent, Store, Work};
use crate::volume::Volume;

/// What was asked of a store, and of one volume of it.
struct Followed {
    volume: Volume,
    asked: Vec<ChunkExtent>,
    work: Work,
}

/// One look at a store.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Look {
    /// Texels or vertices that were asked for.
    pub asked: u64,
    /// Those that are there.
    pub there: u64,
}

/// What is known of the volumes of a store from look to look.
#[derive(Default)]
pub struct Watch(Vec<Followed>);

impl Watch {
    /// Compares what was asked with what is there; what does not change from look to look is kept.
    ///
    /// # Errors
    /// When the store is damaged, or a surface is just being added.
    pub fn look(&mut self, store: &Store) -> Result<Look> {
        let mut sum = Look::default();
        for (i, name) in store.volumes()?.iter().enumerate() {
            let store = store.of_volume(name)?;
            let mut asked = vec![store.asked()?];
            for isovalue in store.surfaces()? {
                asked.extend(store.surface(isovalue)?.map(|surface| surface.asked()).transpose()?);
            }
            if self.0.len() <= i {
                let volume = store.volume()?;
                self.0.push(Followed { work: Work::of(&store, &volume)?, asked: asked.clone(), volume });
            }
            let known = &mut self.0[i];
            if known.asked != asked {
                known.work = Work::of(&store, &known.volume)?;
                known.asked = asked;
            }
            sum.asked += known.work.asked();
            sum.there += known.work.there(&store)?;
        }
        Ok(sum)
    }
}
