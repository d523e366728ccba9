//! What of a bake is pending: which chunks lack which isosurfaces.

use super::Request;
use crate::error::Result;
use crate::grid3;
use crate::transfer::store::{Baked, Store};
use crate::transfer::{Octants, Selection, extents_by_chunk, texels_of_isosurface};
use std::collections::BTreeMap;

/// Chunks that lack the same and have the same.
struct Group {
    /// Indices into [`Pending::wanted`].
    missing: Vec<usize>,
    /// Isosurfaces, as keys, whose texels are as good as asked already.
    done: Vec<Key>,
    /// Which of their octants this process bakes.
    octants: Octants,
    chunks: Vec<[usize; 3]>,
}

/// An isovalue as a key; `None` for all isosurfaces.
type Key = Option<u64>;

fn key(isovalue: Option<f64>) -> Key {
    isovalue.map(f64::to_bits)
}

/// The missing, the done and the octants of a [`Group`].
type Need = (Vec<usize>, Vec<Key>, Octants);

/// A part of a bake: chunks that get the same texels and the same claims.
pub(super) struct Part {
    pub(super) selection: Selection,
    pub(super) chunks: Vec<[usize; 3]>,
    pub(super) claims: Vec<Baked>,
    /// Octants of the chunks that are baked here.
    pub(super) octants: Octants,
    /// For each chunk the octants that each claim is about; those without a texel of its isosurface need nothing.
    pub(super) touched: BTreeMap<[usize; 3], Vec<Octants>>,
}

/// What remains to be baked.
pub(super) struct Pending<'a> {
    job: &'a Request<'a>,
    /// One claim for each isosurface asked for.
    wanted: Vec<Baked>,
    groups: Vec<Group>,
    selections: BTreeMap<Key, Selection>,
    /// By the linear index of a chunk, the isosurfaces asked for that touch it, and where.
    touched: Vec<Vec<(usize, Octants)>>,
    /// Chunks that have all that is asked of them.
    pub(super) kept: usize,
    /// Chunks that do not.
    pub(super) missing: usize,
}

impl<'a> Pending<'a> {
    /// Compares what is asked with the records of the chunks. With a share only its chunks count.
    pub(super) fn new(job: &'a Request<'a>, store: &Store, wanted: Vec<Baked>) -> Result<Self> {
        let mut pending = Self {
            job,
            wanted,
            groups: Vec::new(),
            selections: BTreeMap::new(),
            touched: Vec::new(),
            kept: 0,
            missing: 0,
        };
        let [cx, cy, cz] = job.layout.lattice.chunks();
        // Which of the isosurfaces asked for touch each chunk.
        let mut touched: Vec<Vec<(usize, Octants)>> = vec![Vec::new(); cx * cy * cz];
        for i in 0..pending.wanted.len() {
            let selection = pending.selection_of(key(pending.wanted[i].isovalue));
            let at = |c: usize| grid3::at([cx, cy], c);
            for c in (0..cx * cy * cz).filter(|&c| selection.touches_chunk(at(c))) {
                // Without shares nobody asks where in the chunk.
                let octants = if job.dealt.is_some() { selection.octants(at(c)) } else { Octants::ALL };
                touched[c].push((i, octants));
            }
        }
        let mut groups: BTreeMap<Need, Vec<[usize; 3]>> = BTreeMap::new();
        for (c, asked) in touched.iter().enumerate().filter(|(_, asked)| !asked.is_empty()) {
            let own = job.dealt.map_or(Octants::ALL, |dealt| dealt.octants(c));
            if own.is_empty() || job.only.as_ref().is_some_and(|only| !only.contains(&c)) {
                continue;
            }
            let chunk = grid3::at([cx, cy], c);
            let extent = store.chunk_extent(chunk)?.unwrap_or_default();
            let is_missing =
                |&&(i, touched): &&(usize, Octants)| !extent.octants_of(&pending.wanted[i]).contain(own.and(touched));
            let missing: Vec<usize> = asked.iter().filter(is_missing).map(|&(i, _)| i).collect();
            if missing.is_empty() {
                pending.kept += 1;
                continue;
            }
            pending.missing += 1;
            // Without a target a texel's own count of rays tells whether it is as good as asked.
            let asked = &pending.wanted[missing[0]];
            let as_good = |have: &&Baked| have.covers(&Baked { isovalue: have.isovalue, ..asked.clone() });
            let done = extent.claims().iter().filter(|_| asked.target.is_some()).filter(as_good);
            let done = done.map(|have| key(have.isovalue)).collect();
            groups.entry((missing, done, own)).or_default().push(chunk);
        }
        pending.touched = touched;
        let group = |((missing, done, octants), chunks)| Group { missing, done, octants, chunks };
        pending.groups = groups.into_iter().map(group).collect();
        pending.sort_by_extent();
        Ok(pending)
    }

    /// Chunks in which the surfaces asked for cross the largest extent of isovalues come first, so that a bake that
    /// is stopped has the most to show. A bake of all isosurfaces keeps the order of the file.
    fn sort_by_extent(&mut self) {
        let Some(isovalues) = self.job.isovalues.as_ref().filter(|_| self.job.points.is_none()) else { return };
        let lattice = self.job.layout.lattice;
        let [cx, cy, cz] = lattice.chunks();
        let mut extents = vec![0.0; cx * cy * cz];
        for &c in isovalues {
            let of_one = extents_by_chunk(self.job.volume, lattice, c);
            extents.iter_mut().zip(of_one).for_each(|(sum, extent)| *sum += extent);
        }
        let extent = |chunk: &[usize; 3]| extents[grid3::index([cx, cy], *chunk)];
        for group in &mut self.groups {
            group.chunks.sort_by(|a, b| extent(b).total_cmp(&extent(a)));
        }
        let first = |group: &Group| group.chunks.first().map_or(0.0, extent);
        self.groups.sort_by(|a, b| first(b).total_cmp(&first(a)));
    }

    fn selection_of(&mut self, key: Key) -> &Selection {
        let (volume, lattice, of_vertices) = (self.job.volume, self.job.layout.lattice, self.job.points.is_some());
        self.selections.entry(key).or_insert_with(|| match key {
            _ if of_vertices => Selection::all(lattice),
            None => Selection::of_all_isosurfaces(lattice, volume),
            Some(bits) => texels_of_isosurface(volume, lattice, f64::from_bits(bits)),
        })
    }

    /// Number of parts.
    pub(super) fn len(&self) -> usize {
        self.groups.len()
    }

    /// A part; its selection is made when it is asked for, since each takes a bit for every texel.
    pub(super) fn part(&mut self, index: usize) -> Part {
        let (missing, done) = (self.groups[index].missing.clone(), self.groups[index].done.clone());
        let mut selection = Selection::empty(self.job.layout.lattice);
        for &i in &missing {
            selection.insert_all(self.selection_of(key(self.wanted[i].isovalue)));
        }
        for key in done {
            selection.remove_all(self.selection_of(key));
        }
        let claims = missing.iter().map(|&i| self.wanted[i].clone()).collect();
        let (octants, chunks) = (self.groups[index].octants, self.groups[index].chunks.clone());
        chunks.iter().for_each(|&chunk| selection.keep_octants(chunk, octants));
        let [cx, cy, _] = self.job.layout.lattice.chunks();
        let of_claim = |chunk: [usize; 3], i: usize| {
            let all = &self.touched[grid3::index([cx, cy], chunk)];
            all.iter().find(|(which, _)| *which == i).map_or(Octants::NONE, |(_, octants)| *octants)
        };
        let of_chunk = |&chunk: &[usize; 3]| (chunk, missing.iter().map(|&i| of_claim(chunk, i)).collect());
        let touched = chunks.iter().map(of_chunk).collect();
        Part { selection, chunks, claims, octants, touched }
    }

    /// All texels of the isosurfaces asked for, in all chunks.
    pub(super) fn everything(&mut self) -> Selection {
        let mut selection = Selection::empty(self.job.layout.lattice);
        for i in 0..self.wanted.len() {
            selection.insert_all(self.selection_of(key(self.wanted[i].isovalue)));
        }
        selection
    }
}

/// Number of selected texels in some chunks.
pub(super) fn texels_in(selection: &Selection, chunks: &[[usize; 3]]) -> u64 {
    chunks.iter().flat_map(|&chunk| selection.texels_by_octant(chunk)).sum()
}
