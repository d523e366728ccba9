//! Whether a store has all chunks of the isosurfaces that were asked of it.

use super::{Outcome, doctor};
use crate::error::{Error, Result};
use crate::transfer::store::{ChunkExtent, Holdings, Store};
use crate::volume::Volume;

/// Chunks that the isosurfaces asked of a store need.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Completeness {
    /// How many they touch.
    pub(super) needed: usize,
    /// Of these, baked as well as asked.
    pub(super) there: usize,
}

impl Completeness {
    /// Looks at the records of all chunks.
    pub(super) fn of(store: &Store, volume: &Volume) -> Result<Self> {
        let lattice = store.layout().lattice;
        let [cx, cy, cz] = lattice.chunks();
        let index = |c: usize| [c % cx, c / cx % cy, c / cx / cy];
        let extents: Vec<ChunkExtent> = (0..cx * cy * cz)
            .map(|c| store.chunk_extent(index(c)).map(Option::unwrap_or_default))
            .collect::<Result<_>>()?;
        let (mut touched, mut lacking) = (vec![false; extents.len()], vec![false; extents.len()]);
        for claim in store.asked()?.claims() {
            let alone = ChunkExtent::new(claim.isovalue, claim.rays, claim.target.clone());
            let selection = doctor::selection(lattice, volume, &Holdings::of([&alone]));
            for c in (0..extents.len()).filter(|&c| selection.touches_chunk(index(c))) {
                touched[c] = true;
                lacking[c] |= !extents[c].covers(claim);
            }
        }
        let count = |list: &[bool]| list.iter().filter(|&&is| is).count();
        Ok(Self { needed: count(&touched), there: count(&touched) - count(&lacking) })
    }

    /// Refuses a store that lacks chunks, unless that is accepted.
    pub(super) fn check(self, store: &Store, accepted: bool) -> Outcome {
        if accepted || self.there == self.needed {
            return Ok(());
        }
        let given =
            format!("{}, with {} of {} chunks that were asked of it", store.path().display(), self.there, self.needed);
        let remedy = "go on with its bake, merge the shares, or show what is there with --partial";
        Err(Error::argument("store", given, "a complete store", remedy).into())
    }
}
