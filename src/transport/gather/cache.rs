//! The radiance cache: the transfer texture of the passes so far, and its lookup at a hit.

use crate::grid3;
use crate::level::CellPoint;
use crate::sh;
use crate::transfer::{BRICK, BRICK_TEXELS, Lattice, Layers, Selection};
use half::f16;
use half::slice::HalfFloatSliceExt;
use std::sync::atomic::{AtomicU64, Ordering};

/// How the cache holds its numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CachePrecision {
    /// f16. The default: half the memory, and rounding (2⁻¹² relative in the RMS) is far below the noise of
    /// 16 rays; measured, it moves no figure of the record of 2026-11-22.
    #[default]
    Half,
    /// f32, to measure what f16 loses.
    Single,
}

impl CachePrecision {
    /// Bytes of one coefficient.
    pub(super) fn bytes(self) -> u64 {
        match self {
            Self::Half => 2,
            Self::Single => 4,
        }
    }
}

/// What lookups of the cache found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lookups {
    /// Hits looked up.
    pub lookups: u64,
    /// Some of the eight texels had no transfer; their weights went to the others.
    pub renormalised: u64,
    /// None of the eight had any: mean of the valid texels of the surrounding 4³.
    pub neighbourhood: u64,
    /// None of these either: the path went on, as in the estimator `path`.
    pub continued: u64,
}

impl std::ops::AddAssign for Lookups {
    fn add_assign(&mut self, other: Self) {
        self.lookups += other.lookups;
        self.renormalised += other.renormalised;
        self.neighbourhood += other.neighbourhood;
        self.continued += other.continued;
    }
}

/// Lookups counted from many threads: whole numbers, so their order does not matter.
#[derive(Default)]
pub(super) struct Tally([AtomicU64; 4]);

impl Tally {
    pub(super) fn add(&self, l: &Lookups) {
        for (sum, n) in self.0.iter().zip([l.lookups, l.renormalised, l.neighbourhood, l.continued]) {
            if n > 0 {
                sum.fetch_add(n, Ordering::Relaxed);
            }
        }
    }

    pub(super) fn total(&self) -> Lookups {
        let [lookups, renormalised, neighbourhood, continued] =
            std::array::from_fn(|i| self.0[i].load(Ordering::Relaxed));
        Lookups { lookups, renormalised, neighbourhood, continued }
    }
}

/// The layers that a cache for `layers` holds; `None` for one layer, which needs no cache.
///
/// Coefficient i of T_{k+1} is made from coefficient i of T_k alone, so layer k is held with as
/// many bands as any later layer has, and the last layer not at all.
pub(super) fn cached_layers(layers: &Layers) -> Option<Layers> {
    let bands = layers.bands();
    let needed = (1..bands.len()).map(|k| bands[k..].iter().copied().max().unwrap_or(1)).collect();
    // Refused only when empty: every entry is a legal band count.
    let needed = Layers::new(needed).ok()?;
    Some(if layers.channels() == 1 { needed } else { needed.coloured() })
}

/// Coefficients `source`…`source + count` of a cached texel add to `target`… of an estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Span {
    pub(super) target: usize,
    pub(super) source: usize,
    pub(super) count: usize,
}

/// What a hit after `depth` earlier bounces adds to a grey estimate of `layers`: T_j to layer j + depth + 1.
pub(super) fn spans(layers: &Layers, cached: &Layers, depth: usize) -> Vec<Span> {
    let mut all: Vec<Span> = Vec::new();
    for k in depth + 1..layers.len() {
        let from = k - depth - 1;
        let count = layers.bands()[k] * layers.bands()[k];
        debug_assert!(layers.bands()[k] <= cached.bands()[from]);
        let next = Span { target: layers.offset(k), source: cached.offset(from), count };
        match all.last_mut() {
            Some(last) if last.target + last.count == next.target && last.source + last.count == next.source => {
                last.count += count;
            }
            _ => all.push(next),
        }
    }
    all
}

/// Coefficients turned to f32 at a time.
const ROW: usize = sh::MAX_BANDS * sh::MAX_BANDS;

/// Room for coefficients on their way from f16.
pub(super) type Row = [f32; ROW];

/// An empty row.
pub(super) const EMPTY_ROW: Row = [0.0; ROW];

/// Coefficients of all texels.
#[derive(Clone)]
pub(super) enum Values {
    /// [`CachePrecision::Half`].
    Half(Vec<f16>),
    /// [`CachePrecision::Single`].
    Single(Vec<f32>),
}

/// One brick's part of [`Values`].
pub(super) enum ValuesMut<'a> {
    /// [`CachePrecision::Half`].
    Half(&'a mut [f16]),
    /// [`CachePrecision::Single`].
    Single(&'a mut [f32]),
}

impl Values {
    fn zeros(precision: CachePrecision, count: usize) -> Self {
        match precision {
            CachePrecision::Half => Self::Half(vec![f16::ZERO; count]),
            CachePrecision::Single => Self::Single(vec![0.0; count]),
        }
    }

    /// Parts of `length` coefficients each.
    pub(super) fn parts(&mut self, length: usize) -> Vec<ValuesMut<'_>> {
        match self {
            Self::Half(v) => v.chunks_mut(length).map(ValuesMut::Half).collect(),
            Self::Single(v) => v.chunks_mut(length).map(ValuesMut::Single).collect(),
        }
    }

    /// target += weight · values.
    fn add_to(&self, source: usize, weight: f32, target: &mut [f32], row: &mut Row) {
        match self {
            Self::Single(v) => {
                for (t, v) in target.iter_mut().zip(&v[source..]) {
                    *t += weight * v;
                }
            }
            Self::Half(v) => {
                let source = &v[source..source + target.len()];
                for (part, targets) in source.chunks(ROW).zip(target.chunks_mut(ROW)) {
                    let row = &mut row[..part.len()];
                    part.convert_to_f32_slice(row);
                    for (t, v) in targets.iter_mut().zip(row.iter()) {
                        *t += weight * *v;
                    }
                }
            }
        }
    }
}

impl ValuesMut<'_> {
    /// Writes the coefficients of one texel.
    pub(super) fn store(&mut self, at: usize, values: &[f32]) {
        match self {
            Self::Half(v) => v[at..at + values.len()].convert_from_f32_slice(values),
            Self::Single(v) => v[at..at + values.len()].copy_from_slice(values),
        }
    }
}

/// The texels of the selected bricks with the coefficients that later layers need.
pub(super) struct Cache {
    lattice: Lattice,
    // Coefficients of a texel.
    width: usize,
    // Bricks that hold selected texels, x fastest, and for every brick of the lattice its place in
    // that list, or NO_BRICK.
    bricks: Vec<[usize; 3]>,
    slots: Vec<u32>,
    // Per slot 512: whether the texel has transfer.
    valid: Vec<bool>,
    // Per slot 512 × coefficients; nothing before the first state.
    values: Values,
}

const NO_BRICK: u32 = u32::MAX;

/// Bytes that `copies` of a cache of `bricks` bricks take, of `width` coefficients a texel.
pub(super) fn bytes(lattice: &Lattice, width: usize, bricks: u64, precision: CachePrecision, copies: u64) -> u64 {
    let all: u64 = lattice.bricks().iter().map(|&b| b as u64).product();
    // Flags of the state before and of the one being made.
    let texel = copies * precision.bytes() * width as u64 + 2;
    all * 4 + bricks * (BRICK_TEXELS as u64 * texel + size_of::<[usize; 3]>() as u64)
}

impl Cache {
    /// A cache without valid texels and without room for any; the first [`Cache::replace`] gives both.
    pub(super) fn new(selection: &Selection, width: usize, precision: CachePrecision) -> Self {
        let lattice = *selection.lattice();
        let bricks = selection.bricks();
        let [bx, by, bz] = lattice.bricks();
        let mut slots = vec![NO_BRICK; bx * by * bz];
        for (slot, b) in bricks.iter().enumerate() {
            slots[grid3::index([bx, by], *b)] = slot as u32;
        }
        let texels = bricks.len() * BRICK_TEXELS;
        let values = Values::zeros(precision, 0);
        Self { lattice, width, valid: vec![false; texels], bricks, slots, values }
    }

    /// Coefficients of a texel.
    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// Bricks that it holds, in the order of its slots.
    pub(super) fn bricks(&self) -> &[[usize; 3]] {
        &self.bricks
    }

    /// Whether the texels have transfer, 512 a slot.
    pub(super) fn valid(&self) -> &[bool] {
        &self.valid
    }

    /// Room for the next state.
    pub(super) fn blank(&self) -> Values {
        let precision = match self.values {
            Values::Half(_) => CachePrecision::Half,
            Values::Single(_) => CachePrecision::Single,
        };
        Values::zeros(precision, self.valid.len() * self.width)
    }

    /// Takes a new state and gives the old one back.
    pub(super) fn replace_rows(&mut self, values: &mut Values, valid: Vec<bool>) {
        std::mem::swap(&mut self.values, values);
        self.valid = valid;
    }

    /// Adds the coefficients of texel `t` of a slot, times `weight`.
    pub(super) fn add_texel(&self, slot: usize, t: usize, weight: f32, target: &mut [f32], row: &mut Row) {
        debug_assert_eq!(target.len(), self.width);
        self.values.add_to((slot * BRICK_TEXELS + t) * self.width, weight, target, row);
    }

    /// All values times a factor.
    #[cfg(test)]
    pub(super) fn scale(&mut self, factor: f32) {
        match &mut self.values {
            Values::Half(v) => v.iter_mut().for_each(|v| *v = f16::from_f32(v.to_f32() * factor)),
            Values::Single(v) => v.iter_mut().for_each(|v| *v *= factor),
        }
    }

    /// Where a texel of the lattice is held, if it has transfer.
    #[inline]
    fn position(&self, texel: [usize; 3]) -> Option<usize> {
        let [bx, by, _] = self.lattice.bricks();
        let brick = texel.map(|t| t / BRICK);
        let slot = self.slots[grid3::index([bx, by], brick)];
        if slot == NO_BRICK {
            return None;
        }
        let inner = texel.map(|t| t % BRICK);
        let at = slot as usize * BRICK_TEXELS + grid3::index([BRICK, BRICK], inner);
        self.valid[at].then_some(at)
    }

    /// Adds the interpolated transfer at a point of the grid to `target`, by `spans`; false where
    /// there is none.
    ///
    /// The rule is that of [`crate::relight`]'s lookup for the first two cases: weights of texels without
    /// transfer go to the others; with none of eight, the mean of the valid texels of the
    /// surrounding 4³. Where that has none either the caller goes on tracing.
    #[inline]
    pub(super) fn add(
        &self,
        at: &CellPoint,
        spans: &[Span],
        target: &mut [f32],
        row: &mut Row,
        lookups: &mut Lookups,
    ) -> bool {
        lookups.lookups += 1;
        let m = self.lattice.texels();
        let mut base = [0usize; 3];
        let mut fraction = [0.0f32; 3];
        for a in 0..3 {
            let in_grid = f64::from(at.cell[a]) + f64::from(at.local[a]);
            let p = (in_grid / self.lattice.step(a)).clamp(0.0, (m[a] - 1) as f64);
            base[a] = (p as usize).min(m[a].saturating_sub(2));
            fraction[a] = (p - base[a] as f64) as f32;
        }
        let mut found = [(0usize, 0.0f32); 8];
        let (mut count, mut total, mut missing) = (0, 0.0f32, false);
        for corner in 0..8 {
            let pick = [corner & 1, corner >> 1 & 1, corner >> 2];
            let mut w = 1.0;
            for a in 0..3 {
                w *= if pick[a] == 1 { fraction[a] } else { 1.0 - fraction[a] };
            }
            if w <= 0.0 {
                continue;
            }
            match self.position(std::array::from_fn(|a| (base[a] + pick[a]).min(m[a] - 1))) {
                Some(at) => {
                    found[count] = (at, w);
                    count += 1;
                    total += w;
                }
                None => missing = true,
            }
        }
        if count == 0 {
            return self.add_neighbourhood(base, spans, target, row, lookups);
        }
        lookups.renormalised += u64::from(missing);
        let scale = if missing { 1.0 / total } else { 1.0 };
        for &(at, w) in &found[..count] {
            self.add_spans(at, w * scale, spans, target, row);
        }
        true
    }

    /// Mean of the valid texels of the 4³ around the cell at `base`.
    #[cold]
    fn add_neighbourhood(
        &self,
        base: [usize; 3],
        spans: &[Span],
        target: &mut [f32],
        row: &mut Row,
        lookups: &mut Lookups,
    ) -> bool {
        let m = self.lattice.texels();
        let span = |a: usize| base[a].saturating_sub(1)..(base[a] + 3).min(m[a]);
        let mut found = Vec::new();
        for z in span(2) {
            for y in span(1) {
                found.extend(span(0).filter_map(|x| self.position([x, y, z])));
            }
        }
        if found.is_empty() {
            lookups.continued += 1;
            return false;
        }
        lookups.neighbourhood += 1;
        let weight = 1.0 / found.len() as f32;
        for at in found {
            self.add_spans(at, weight, spans, target, row);
        }
        true
    }

    #[inline]
    fn add_spans(&self, at: usize, weight: f32, spans: &[Span], target: &mut [f32], row: &mut Row) {
        let start = at * self.width;
        for span in spans {
            let target = &mut target[span.target..span.target + span.count];
            self.values.add_to(start + span.source, weight, target, row);
        }
    }
}

#[cfg(test)]
mod tests;
