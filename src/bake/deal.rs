//! Dealing out the work of a bake to shares, that is to processes that know nothing of each other.
//!
//! Each computes the same from what is asked alone: chunks with their texels (or vertices) in descending order, ties by index, each to the
//! share with the least so far, ties by its number. Where chunks are too large for that to come out even, it is octants of 16³ texels that
//! are dealt (`transfer::Octants`). What is there already plays no part, so a share that was stopped goes on with the same chunks.
//!
//! Largest first is within 4/3 − 1/(3 n) of the best (Graham 1969, Bounds on multiprocessing timing anomalies).

use super::request::Share;
use crate::grid3;
use crate::transfer::{Octants, Selection};
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, BinaryHeap};

/// Longest share over the mean up to which chunks are dealt whole: then no file is written twice.
const EVEN: f64 = 1.05;

/// For each piece of work the share that does it, from 0; pieces of no work are nobody's. `first` is what the first share has to do
/// besides.
pub(super) fn largest_first(work: &[u64], shares: usize, first: u64) -> Vec<Option<usize>> {
    let mut order: Vec<usize> = (0..work.len()).filter(|&i| work[i] > 0).collect();
    order.sort_by_key(|&i| (Reverse(work[i]), i));
    let mut least: BinaryHeap<Reverse<(u64, usize)>> =
        (0..shares).map(|s| Reverse((if s == 0 { first } else { 0 }, s))).collect();
    let mut dealt = vec![None; work.len()];
    for i in order {
        let Some(Reverse((load, share))) = least.pop() else { break };
        dealt[i] = Some(share);
        least.push(Reverse((load + work[i], share)));
    }
    dealt
}

/// The largest load of a share over the mean; 1 where there is no work.
pub(super) fn imbalance(work: &[u64], dealt: &[Option<usize>], shares: usize, first: u64) -> f64 {
    let mut loads = vec![0u64; shares];
    loads[0] = first;
    work.iter().zip(dealt).for_each(|(n, share)| share.iter().for_each(|&s| loads[s] += n));
    let all: u64 = loads.iter().sum();
    let most = loads.iter().max().copied().unwrap_or(0);
    if all == 0 { 1.0 } else { most as f64 * shares as f64 / all as f64 }
}

/// What one share has to do of one texture or surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Dealt {
    share: Option<Share>,
    /// Octants by the linear index of their chunk.
    mine: BTreeMap<usize, Octants>,
    /// Chunks of which other shares have octants too.
    divided: BTreeSet<usize>,
    /// Chunks that somebody works on, each with the share that looks after its damages.
    keepers: BTreeMap<usize, usize>,
}

impl Dealt {
    /// The octants of a chunk that this share bakes.
    pub(super) fn octants(&self, chunk: usize) -> Octants {
        self.mine.get(&chunk).copied().unwrap_or_default()
    }

    /// Whether other shares write the chunk as well.
    pub(super) fn is_divided(&self, chunk: usize) -> bool {
        self.divided.contains(&chunk)
    }

    /// Whether this share verifies the chunk, and bakes all of it again if it is damaged. Chunks that nobody bakes are looked after in
    /// turn.
    pub(super) fn keeps(&self, chunk: usize) -> bool {
        let Some(share) = self.share else { return true };
        self.keepers.get(&chunk).copied().unwrap_or(chunk % share.of) == share.index - 1
    }

    /// The same, with all octants of some chunks.
    pub(super) fn with_whole(&self, chunks: &BTreeSet<usize>) -> Self {
        let mut all = self.clone();
        chunks.iter().for_each(|&chunk| {
            all.mine.insert(chunk, Octants::ALL);
        });
        all
    }

    /// Whether it has nothing to do.
    pub(super) fn is_empty(&self) -> bool {
        self.mine.is_empty()
    }
}

/// Deals out the chunks of several surfaces, or of one texture, as one whole. `divides`: whether the octants of a chunk may be baked
/// apart. `first`: as many texels as take the time that the first share needs besides.
pub(super) fn deal(selections: &[Selection], share: Share, divides: bool, first: u64) -> Vec<Dealt> {
    // Chunks that hold work: which selection, which chunk, and its texels by octant.
    let mut chunks: Vec<(usize, usize, [u64; Octants::COUNT])> = Vec::new();
    for (s, selection) in selections.iter().enumerate() {
        for (c, chunk) in grid3::all(selection.lattice().chunks()).enumerate() {
            let counts = selection.texels_by_octant(chunk);
            if counts.iter().any(|&n| n > 0) {
                chunks.push((s, c, counts));
            }
        }
    }
    let whole: Vec<u64> = chunks.iter().map(|(_, _, counts)| counts.iter().sum()).collect();
    let by_chunk = largest_first(&whole, share.of, first);
    let can_divide = divides && selections.iter().all(|selection| !selection.lattice().is_of_vertices());
    let owners: Vec<[Option<usize>; Octants::COUNT]> =
        if can_divide && imbalance(&whole, &by_chunk, share.of, first) > EVEN {
            let octants: Vec<u64> = chunks.iter().flat_map(|(_, _, counts)| *counts).collect();
            let dealt = largest_first(&octants, share.of, first);
            dealt.chunks_exact(Octants::COUNT).map(|all| std::array::from_fn(|i| all[i])).collect()
        } else {
            by_chunk.iter().map(|owner| [*owner; Octants::COUNT]).collect()
        };
    let mut all = vec![Dealt { share: Some(share), ..Dealt::default() }; selections.len()];
    for ((s, c, _), owners) in chunks.iter().zip(owners) {
        let dealt = &mut all[*s];
        let mut distinct: Vec<usize> = owners.iter().flatten().copied().collect();
        dealt.keepers.extend(distinct.first().map(|&keeper| (*c, keeper)));
        let mine = |(i, owner): (usize, &Option<usize>)| {
            if *owner == Some(share.index - 1) { Octants::one(i) } else { Octants::NONE }
        };
        let octants = owners.iter().enumerate().map(mine).fold(Octants::NONE, Octants::with);
        distinct.sort_unstable();
        distinct.dedup();
        if distinct.len() > 1 {
            dealt.divided.insert(*c);
        }
        if !octants.is_empty() {
            // Octants without texels are nobody's: whoever has all others has the chunk.
            dealt.mine.insert(*c, if distinct.len() > 1 { octants } else { Octants::ALL });
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transfer::{Lattice, texels_of_isosurfaces};
    use crate::volume::Volume;

    fn brain() -> Volume {
        crate::volume::open(concat!(env!("CARGO_MANIFEST_DIR"), "/examples/data/mni152_t1_2mm.nii.gz")).unwrap()
    }

    fn of_brain(isovalues: Option<&[f64]>) -> Selection {
        let volume = brain();
        texels_of_isosurfaces(&volume, Lattice::from_ratio(volume.dims(), 1.0).unwrap(), isovalues)
    }

    fn imbalance_of(all: &[Vec<Dealt>], selection: &Selection) -> f64 {
        let [cx, cy, _] = selection.lattice().chunks();
        let load = |dealt: &Dealt| -> u64 {
            let octants = dealt.mine.iter().map(|(&c, &octants)| {
                let counts = selection.texels_by_octant(grid3::at([cx, cy], c));
                (0..Octants::COUNT).filter(|&i| octants.contain(Octants::one(i))).map(|i| counts[i]).sum::<u64>()
            });
            octants.sum()
        };
        let loads: Vec<u64> = all.iter().map(|dealt| load(&dealt[0])).collect();
        // Every texel is somebody's, and no texel two shares'.
        assert_eq!(loads.iter().sum::<u64>(), selection.len());
        *loads.iter().max().unwrap() as f64 * loads.len() as f64 / selection.len() as f64
    }

    fn shares(selection: &Selection, of: usize) -> Vec<Vec<Dealt>> {
        let one = |index| deal(std::slice::from_ref(selection), Share { index, of }, true, 0);
        (1..=of).map(one).collect()
    }

    /// The texels of a chunk of 32³ at two isovalues of the brain, dealt to n: the longest share over the mean. The values were
    /// computed apart, from the same rule, with NumPy.
    #[test]
    fn chunks_dealt_largest_first_are_as_even_as_computed_elsewhere() {
        let selection = of_brain(Some(&[90.0, 160.0]));
        let work: Vec<u64> = grid3::all(selection.lattice().chunks())
            .map(|chunk| selection.texels_by_octant(chunk).iter().sum())
            .collect();
        for (n, expected) in [(2, 1.0), (3, 1.0), (4, 1.0), (6, 1.0), (8, 1.02), (12, 1.17), (16, 1.56)] {
            let found = imbalance(&work, &largest_first(&work, n, 0), n, 0);
            assert!((found - expected).abs() < 0.01, "{n} shares: {found}, expected {expected}");
        }
    }

    #[test]
    fn shares_are_even_disjoint_and_together_everything() {
        for isovalues in [Some(&[90.0][..]), Some(&[90.0, 160.0][..]), None] {
            let selection = of_brain(isovalues);
            for n in [1, 2, 3, 4, 6, 8, 12, 16, 64] {
                let all = shares(&selection, n);
                let mut held: BTreeMap<usize, Octants> = BTreeMap::new();
                for dealt in &all {
                    for (&chunk, &octants) in &dealt[0].mine {
                        let others = held.entry(chunk).or_default();
                        assert!(others.and(octants).is_empty(), "chunk {chunk} twice among {n}");
                        *others = others.with(octants);
                    }
                }
                let found = imbalance_of(&all, &selection);
                // 12,000 cells cut into 136 pieces: at 64 shares two a share.
                assert!(found < if n < 64 { 1.06 } else { 1.2 }, "{n} shares of {isovalues:?}: {found}");
            }
        }
    }

    #[test]
    fn every_chunk_has_one_keeper_and_what_is_divided_is_known_to_all() {
        let selection = of_brain(Some(&[90.0]));
        let all = shares(&selection, 64);
        let chunks: usize = selection.lattice().chunks().iter().product();
        for chunk in 0..chunks {
            let keepers = all.iter().filter(|dealt| dealt[0].keeps(chunk)).count();
            let writers = all.iter().filter(|dealt| !dealt[0].octants(chunk).is_empty()).count();
            assert_eq!(keepers, 1, "chunk {chunk}");
            assert!(all.iter().all(|dealt| dealt[0].is_divided(chunk) == (writers > 1)), "chunk {chunk}");
        }
        // A share that repairs a chunk bakes all of it.
        let whole = all[0][0].with_whole(&BTreeSet::from([7]));
        assert_eq!(whole.octants(7), Octants::ALL);
    }

    #[test]
    fn surfaces_are_dealt_as_one_whole_and_shares_beyond_their_chunks_are_empty() {
        // 3 + 1 chunks of vertices: 4096, 4096, 100 and 4000.
        let surfaces = [8292, 4000].map(|n| Selection::all(Lattice::of_vertices(n)));
        let of = |index, of| deal(&surfaces, Share { index, of }, true, 0);
        let held =
            |dealt: &[Dealt]| dealt.iter().map(|d| d.mine.keys().copied().collect()).collect::<Vec<Vec<usize>>>();
        assert_eq!(held(&of(1, 3)), [vec![0], vec![]]);
        assert_eq!(held(&of(2, 3)), [vec![1], vec![]]);
        assert_eq!(held(&of(3, 3)), [vec![2], vec![0]]);
        assert!(of(5, 6).iter().all(Dealt::is_empty) && of(6, 6).iter().all(Dealt::is_empty));
        assert!(of(1, 3).iter().flat_map(|d| d.mine.values()).all(|&octants| octants == Octants::ALL));
        // What the first share has to do besides goes at the expense of its chunks.
        assert!(deal(&surfaces, Share { index: 1, of: 3 }, true, 9000).iter().all(Dealt::is_empty));
    }
}
