//! A set of texels, and the bricks and chunks that hold them.

use super::{Lattice, Octants};
use crate::grid3;
use crate::volume::{Sample, Volume, with_samples};

/// A set of texels of a lattice: which of them to bake.
#[derive(Clone, Debug)]
pub struct Selection {
    lattice: Lattice,
    // One bit a texel, x fastest.
    bits: Vec<u64>,
}

impl Selection {
    /// No texel.
    pub fn empty(lattice: Lattice) -> Self {
        let count: usize = lattice.texels().iter().product();
        Self { lattice, bits: vec![0; count.div_ceil(64)] }
    }

    /// Every texel.
    pub fn all(lattice: Lattice) -> Self {
        let mut selection = Self::empty(lattice);
        let count: usize = lattice.texels().iter().product();
        selection.bits.fill(u64::MAX);
        if let Some(last) = selection.bits.last_mut()
            && !count.is_multiple_of(64)
        {
            *last = (1 << (count % 64)) - 1;
        }
        selection
    }

    /// The texels that lookups on any isosurface read: those of all cells whose corners differ. A cell
    /// with eight equal corners is crossed by no isosurface.
    pub fn of_all_isosurfaces(lattice: Lattice, volume: &Volume) -> Self {
        fn scan<T: Sample>(samples: &[T], dims: [usize; 3], mut found: impl FnMut([usize; 3])) {
            let [nx, ny, nz] = dims;
            let rows = [0, nx, nx * ny, nx * ny + nx];
            // Whether the four samples of a cell face across x are the same.
            let face = |base: usize| {
                let v = samples[base].raw();
                rows[1..].iter().all(|o| samples[base + o].raw() == v).then_some(v)
            };
            for z in 0..nz.saturating_sub(1) {
                for y in 0..ny.saturating_sub(1) {
                    let row = nx * (y + ny * z);
                    let mut before = face(row);
                    for x in 0..nx.saturating_sub(1) {
                        let after = face(row + x + 1);
                        if before.is_none() || before != after {
                            found([x, y, z]);
                        }
                        before = after;
                    }
                }
            }
        }
        let mut selection = Self::empty(lattice);
        with_samples!(volume.samples(), s => scan(s, volume.dims(), |cell| selection.insert_cell(cell)));
        selection
    }

    /// The texels of either of two sets of one lattice.
    pub fn with(mut self, other: Self) -> Self {
        debug_assert_eq!(self.lattice, other.lattice);
        self.bits.iter_mut().zip(other.bits).for_each(|(bits, more)| *bits |= more);
        self
    }

    /// The bricks that hold texels of the set, x fastest.
    pub fn bricks(&self) -> Vec<[usize; 3]> {
        let [bx, by, bz] = self.lattice.bricks();
        grid3::all([bx, by, bz]).filter(|&b| self.touches_brick(b)).collect()
    }

    /// The lattice it is of.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    fn index(&self, texel: [usize; 3]) -> usize {
        let [mx, my, _] = self.lattice.texels();
        grid3::index([mx, my], texel)
    }

    /// Whether a texel is in the set; texels beyond the lattice are not.
    pub fn contains(&self, texel: [usize; 3]) -> bool {
        let m = self.lattice.texels();
        if (0..3).any(|a| texel[a] >= m[a]) {
            return false;
        }
        let i = self.index(texel);
        self.bits[i / 64] >> (i % 64) & 1 == 1
    }

    /// Adds one texel; one beyond the lattice is left out.
    pub fn insert(&mut self, texel: [usize; 3]) {
        if (0..3).all(|a| texel[a] < self.lattice.texels()[a]) {
            let i = self.index(texel);
            self.bits[i / 64] |= 1 << (i % 64);
        }
    }

    /// Adds the texels that a trilinear lookup anywhere in a cell of the grid reads.
    ///
    /// A lookup divides its position by the same step in the same precision, and rounded division
    /// is monotone, so the quotients of the two faces bound every quotient inside: no margin is
    /// needed. (One of 1e-9 took 4³ texels a cell instead of 2³ on the lattice of the data.)
    pub fn insert_cell(&mut self, cell: [usize; 3]) {
        let m = self.lattice.texels();
        let span = |a: usize| {
            let step = self.lattice.step(a);
            let low = (cell[a] as f64 / step) as usize;
            let end = (cell[a] + 1) as f64 / step;
            let high = end as usize + usize::from(end > end as usize as f64);
            low.min(m[a] - 1)..=high.min(m[a] - 1)
        };
        let (sx, sy, sz) = (span(0), span(1), span(2));
        for z in sz {
            for y in sy.clone() {
                for x in sx.clone() {
                    let i = self.index([x, y, z]);
                    self.bits[i / 64] |= 1 << (i % 64);
                }
            }
        }
    }

    /// Adds every texel of another set of the same lattice.
    ///
    /// # Panics
    /// When the lattices differ.
    pub fn insert_all(&mut self, other: &Self) {
        assert_eq!(self.lattice, other.lattice);
        for (a, b) in self.bits.iter_mut().zip(&other.bits) {
            *a |= b;
        }
    }

    /// Takes out every texel of another set of the same lattice.
    ///
    /// # Panics
    /// When the lattices differ.
    pub fn remove_all(&mut self, other: &Self) {
        assert_eq!(self.lattice, other.lattice);
        for (a, b) in self.bits.iter_mut().zip(&other.bits) {
            *a &= !b;
        }
    }

    /// Number of texels in the set.
    pub fn len(&self) -> u64 {
        self.bits.iter().map(|w| u64::from(w.count_ones())).sum()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.bits.iter().all(|&w| w == 0)
    }

    /// Whether a brick holds any texel of the set.
    pub fn touches_brick(&self, brick: [usize; 3]) -> bool {
        self.touches(brick, self.lattice.brick_shape())
    }

    /// Whether a chunk holds any texel of the set.
    pub fn touches_chunk(&self, chunk: [usize; 3]) -> bool {
        self.touches(chunk, self.lattice.chunk_shape())
    }

    fn touches(&self, block: [usize; 3], shape: [usize; 3]) -> bool {
        let m = self.lattice.texels();
        let span = |a: usize| block[a] * shape[a]..((block[a] + 1) * shape[a]).min(m[a]);
        let row = span(0);
        !row.is_empty() && span(2).any(|z| span(1).any(|y| self.any_of(self.index([row.start, y, z]), row.len())))
    }

    /// Texels of the set in each octant of a chunk; of vertices all stand in the first.
    pub fn texels_by_octant(&self, chunk: [usize; 3]) -> [u64; Octants::COUNT] {
        let mut counts = [0; Octants::COUNT];
        for (octant, row) in self.rows_of(chunk) {
            counts[octant] += row.map(|i| u64::from(self.bits[i / 64] >> (i % 64) & 1 == 1)).sum::<u64>();
        }
        counts
    }

    /// The octants of a chunk that hold texels of the set; of vertices all or none.
    pub fn octants(&self, chunk: [usize; 3]) -> Octants {
        let counts = self.texels_by_octant(chunk);
        match self.lattice.is_of_vertices() {
            true if counts[0] > 0 => Octants::ALL,
            _ => counts
                .iter()
                .enumerate()
                .filter(|(_, n)| **n > 0)
                .fold(Octants::NONE, |all, (i, _)| all.with(Octants::one(i))),
        }
    }

    /// Takes out the texels of a chunk that lie in other octants.
    pub fn keep_octants(&mut self, chunk: [usize; 3], kept: Octants) {
        if kept == Octants::ALL {
            return;
        }
        for (octant, row) in self.rows_of(chunk) {
            if !kept.contain(Octants::one(octant)) {
                row.for_each(|i| self.bits[i / 64] &= !(1 << (i % 64)));
            }
        }
    }

    /// The rows of a chunk, cut where octants meet: the octant, and the indices of the texels.
    fn rows_of(&self, chunk: [usize; 3]) -> Vec<(usize, std::ops::Range<usize>)> {
        let (m, shape) = (self.lattice.texels(), self.lattice.chunk_shape());
        let half = if self.lattice.is_of_vertices() { shape } else { shape.map(|n| n / 2) };
        let span = |a: usize| chunk[a] * shape[a]..((chunk[a] + 1) * shape[a]).min(m[a]);
        let mut rows = Vec::new();
        for z in span(2) {
            for y in span(1) {
                for start in span(0).step_by(half[0]) {
                    let end = (start + half[0]).min(m[0]);
                    let place = [start, y, z];
                    let [i, j, k] = std::array::from_fn(|a| (place[a] - chunk[a] * shape[a]) / half[a]);
                    let first = self.index(place);
                    rows.push((i + 2 * j + 4 * k, first..first + (end - start)));
                }
            }
        }
        rows
    }

    /// Whether any of `count` texels in a row is in the set, given the index of the first.
    fn any_of(&self, first: usize, count: usize) -> bool {
        let (mut at, end) = (first, first + count);
        while at < end {
            let here = (64 - at % 64).min(end - at);
            if self.bits[at / 64] >> (at % 64) & (u64::MAX >> (64 - here)) != 0 {
                return true;
            }
            at += here;
        }
        false
    }
}

#[cfg(test)]
mod tests;
