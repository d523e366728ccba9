//! Whether a store has all chunks of the isosurfaces that were asked of it.

use super::{Baked, ChunkExtent, Holdings, Store};
use crate::error::{Error, Result};
use crate::grid3;
use crate::transfer::{Lattice, Octants, Selection, texels_of_isosurfaces};
use crate::volume::Volume;

/// Chunks that the isosurfaces asked of a store need.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Completeness {
    /// How many they touch.
    pub needed: usize,
    /// Of these, baked as well as asked.
    pub there: usize,
}

impl Completeness {
    /// Looks at the records of all chunks.
    ///
    /// # Errors
    /// When a record is damaged.
    pub fn of(store: &Store, volume: &Volume) -> Result<Self> {
        let lattice = store.layout().lattice;
        let [cx, cy, cz] = lattice.chunks();
        let index = |c: usize| grid3::at([cx, cy], c);
        let extents: Vec<ChunkExtent> = (0..cx * cy * cz)
            .map(|c| store.chunk_extent(index(c)).map(Option::unwrap_or_default))
            .collect::<Result<_>>()?;
        let (mut touched, mut lacking) = (vec![false; extents.len()], vec![false; extents.len()]);
        for claim in store.asked()?.claims() {
            let alone = ChunkExtent::new(claim.isovalue, claim.rays, claim.target.clone());
            let selection = selection(lattice, volume, &Holdings::of([&alone]));
            for c in (0..extents.len()).filter(|&c| selection.touches_chunk(index(c))) {
                touched[c] = true;
                lacking[c] |= !extents[c].covers(claim);
            }
        }
        let count = |list: &[bool]| list.iter().filter(|&&is| is).count();
        let mut all = Self { needed: count(&touched), there: count(&touched) - count(&lacking) };
        for isovalue in store.surfaces()? {
            let Some(surface) = store.surface(isovalue)? else { continue };
            let asked = surface.asked()?;
            for c in 0..surface.layout().lattice.chunks()[0] {
                let extent = surface.chunk_extent([c, 0, 0])?.unwrap_or_default();
                all.needed += 1;
                all.there += usize::from(!asked.claims().is_empty() && asked.claims().iter().all(|c| extent.covers(c)));
            }
        }
        Ok(all)
    }

    /// Refuses a store that lacks chunks, unless that is accepted.
    ///
    /// # Errors
    /// When chunks are missing and that is not accepted.
    pub fn check(self, store: &Store, accepted: bool) -> Result<()> {
        if accepted || self.there == self.needed {
            return Ok(());
        }
        let given =
            format!("{}, with {} of {} chunks that were asked of it", store.path().display(), self.there, self.needed);
        let remedy = "go on with its bake, merge the shares, or show what is there with --partial";
        Err(Error::argument("store", given, "a complete store", remedy))
    }
}

/// The texels that what a store holds was baked for.
pub fn selection(lattice: Lattice, volume: &Volume, held: &Holdings) -> Selection {
    texels_of_isosurfaces(volume, lattice, if held.all { None } else { Some(&held.in_texture) })
}

/// What was asked of a store, texel by texel (or vertex by vertex) and isosurface by isosurface, to be compared again and again with
/// what is there.
#[derive(Debug)]
pub struct Work {
    parts: Vec<Part>,
}

/// Of one isosurface, or of all.
#[derive(Debug)]
struct Part {
    /// The isovalue of the surface whose vertices these are.
    surface: Option<f64>,
    claim: Baked,
    /// Chunks with their texels by octant.
    chunks: Vec<([usize; 3], [u64; Octants::COUNT])>,
}

impl Part {
    fn new(surface: Option<f64>, claim: &Baked, selection: &Selection) -> Self {
        let chunks = grid3::all(selection.lattice().chunks()).map(|chunk| (chunk, selection.texels_by_octant(chunk)));
        let chunks = chunks.filter(|(_, counts)| counts.iter().any(|&n| n > 0)).collect();
        Self { surface, claim: claim.clone(), chunks }
    }
}

impl Work {
    /// All that was asked of a store so far.
    ///
    /// # Errors
    /// When a record or a surface is damaged.
    pub fn of(store: &Store, volume: &Volume) -> Result<Self> {
        let lattice = store.layout().lattice;
        let mut parts = Vec::new();
        for claim in store.asked()?.claims() {
            let alone = ChunkExtent::new(claim.isovalue, claim.rays, claim.target.clone());
            parts.push(Part::new(None, claim, &selection(lattice, volume, &Holdings::of([&alone]))));
        }
        for isovalue in store.surfaces()? {
            let Some(surface) = store.surface(isovalue)? else { continue };
            for claim in surface.asked()?.claims() {
                parts.push(Part::new(Some(isovalue), claim, &Selection::all(surface.layout().lattice)));
            }
        }
        Ok(Self { parts })
    }

    /// Texels and vertices; one of two isosurfaces counts twice.
    pub fn asked(&self) -> u64 {
        self.parts.iter().flat_map(|part| &part.chunks).flat_map(|(_, counts)| counts).sum()
    }

    /// Of these, how many are there as well as asked, on the disk now.
    ///
    /// # Errors
    /// When a record is damaged.
    pub fn there(&self, store: &Store) -> Result<u64> {
        let mut texels = 0;
        for part in &self.parts {
            let surface = match part.surface {
                Some(isovalue) => store.surface(isovalue)?,
                None => None,
            };
            let store = surface.as_ref().unwrap_or(store);
            for (chunk, counts) in &part.chunks {
                let octants = store.chunk_extent(*chunk)?.unwrap_or_default().octants_of(&part.claim);
                let there = (0..Octants::COUNT).filter(|&i| octants.contain(Octants::one(i)));
                texels += there.map(|i| counts[i]).sum::<u64>();
            }
        }
        Ok(texels)
    }
}
