//! The connected parts of the solid of an isovalue, to keep the largest alone.

use super::{Sample, Samples, SamplesView, Solid, Volume};
use crate::error::Result;
use crate::grid3;
use std::sync::OnceLock;

/// What was taken away.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Removed {
    /// Parts of the solid that were not the largest.
    pub parts: u64,
    /// Their samples.
    pub samples: u64,
    /// Samples of the largest part.
    pub kept: u64,
}

impl Volume {
    /// The volume without the parts of the solid {h > `isovalue`} (or below, as its side says) that are not connected
    /// with the largest: their samples get the value that is furthest on the lit side, and so does what falls away from
    /// them, the samples that are reached from them by steps to lower values (in terms of the solid) but not from the
    /// largest. Else a shell would stay, and shade the surfaces of isovalues beside this one. Samples are connected with
    /// all 26 neighbours, so no cell holds samples of two parts and the surface of the largest stays as it is, to the bit.
    ///
    /// Of equally large parts the first in the order of samples stays.
    ///
    /// # Errors
    /// None for a volume that is one; those of [`Volume::new`].
    pub fn keep_largest(self, isovalue: f64) -> Result<(Self, Removed)> {
        let c_raw = self.raw_from_value(isovalue);
        let sign = f64::from(self.solid_sign());
        let (low, high) = self.raw_range();
        let lit = if sign > 0.0 { low } else { high };
        let dims = self.dims();
        macro_rules! masked {
            ($($variant:ident: $t:ty),*) => {
                match self.samples.view() {
                    $(SamplesView::$variant(s) => {
                        let height = |v: f32| sign * (f64::from(v) - c_raw);
                        let (samples, removed) = mask(s, dims, lit as $t, &height);
                        (samples.map(Samples::$variant), removed)
                    })*
                }
            };
        }
        let (samples, removed) = masked!(U8: u8, I8: i8, U16: u16, I16: i16, F32: f32);
        let Some(samples) = samples else { return Ok((self, removed)) };
        let raw_range = samples.raw_range();
        Ok((Self { samples, raw_range, hash: OnceLock::new(), ..self }, removed))
    }

    /// The outermost of some isovalues: its solid holds those of all others.
    #[doc(hidden)]
    pub fn outermost(&self, isovalues: impl IntoIterator<Item = f64>) -> Option<f64> {
        let all = isovalues.into_iter();
        if self.solid == Solid::Above { all.min_by(f64::total_cmp) } else { all.max_by(f64::total_cmp) }
    }
}

/// A set of samples, one bit each.
struct Bits(Vec<u64>);

impl Bits {
    fn new(count: usize) -> Self {
        Self(vec![0; count.div_ceil(64)])
    }

    fn has(&self, i: usize) -> bool {
        self.0[i / 64] >> (i % 64) & 1 == 1
    }

    fn insert(&mut self, i: usize) {
        self.0[i / 64] |= 1 << (i % 64);
    }
}

/// The samples with those of all but the largest part replaced; `None` where there is only one. `height`: above 0 in the
/// solid.
fn mask<T: Sample>(samples: &[T], dims: [usize; 3], lit: T, height: &dyn Fn(f32) -> f64) -> (Option<Vec<T>>, Removed) {
    let mut seen = Bits::new(samples.len());
    let height = |i: usize| height(samples[i].raw());
    let solid = |i: usize| height(i) > 0.0;
    let (mut parts, mut all, mut largest): (u64, u64, Option<(u64, usize)>) = (0, 0, None);
    for start in 0..samples.len() {
        if !seen.has(start) && solid(start) {
            let count = fill(start, dims, &solid, &mut seen);
            parts += 1;
            all += count;
            if largest.is_none_or(|(most, _)| count > most) {
                largest = Some((count, start));
            }
        }
    }
    let Some((kept, start)) = largest.filter(|_| parts > 1) else {
        return (None, Removed { kept: all, ..Removed::default() });
    };
    let mut stays = Bits::new(samples.len());
    fill(start, dims, &solid, &mut stays);
    let of_largest: Vec<usize> = (0..samples.len()).filter(|&i| stays.has(i)).collect();
    let of_others: Vec<usize> = (0..samples.len()).filter(|&i| solid(i) && !stays.has(i)).collect();
    fall(of_largest, dims, &height, &mut stays);
    let mut gone = Bits(stays.0.clone());
    of_others.iter().for_each(|&i| gone.insert(i));
    fall(of_others, dims, &height, &mut gone);
    let one = |(i, &s): (usize, &T)| if gone.has(i) && !stays.has(i) { lit } else { s };
    (Some(samples.iter().enumerate().map(one).collect()), Removed { parts: parts - 1, samples: all - kept, kept })
}

/// Marks what is reached by steps to lower neighbours.
fn fall(mut waiting: Vec<usize>, [nx, ny, nz]: [usize; 3], height: &dyn Fn(usize) -> f64, seen: &mut Bits) {
    while let Some(i) = waiting.pop() {
        let (x, y, z) = (i % nx, i / nx % ny, i / (nx * ny));
        let here = height(i);
        for z in z.saturating_sub(1)..=(z + 1).min(nz - 1) {
            for y in y.saturating_sub(1)..=(y + 1).min(ny - 1) {
                for x in x.saturating_sub(1)..=(x + 1).min(nx - 1) {
                    let j = grid3::index([nx, ny], [x, y, z]);
                    let there = height(j);
                    if there < here && there <= 0.0 && !seen.has(j) {
                        seen.insert(j);
                        waiting.push(j);
                    }
                }
            }
        }
    }
}

/// Marks all that is connected with a sample; how many samples that are. Runs along x are marked at once.
fn fill(start: usize, [nx, ny, nz]: [usize; 3], solid: &dyn Fn(usize) -> bool, seen: &mut Bits) -> u64 {
    let mut count = 0;
    let mut waiting = vec![start];
    while let Some(i) = waiting.pop() {
        if seen.has(i) {
            continue;
        }
        let (x, row) = (i % nx, i / nx);
        let (y, z) = (row % ny, row / ny);
        let base = row * nx;
        let first = (0..x).rev().take_while(|&x| solid(base + x)).last().unwrap_or(x);
        let last = (x + 1..nx).take_while(|&x| solid(base + x)).last().unwrap_or(x);
        (first..=last).for_each(|x| seen.insert(base + x));
        count += (last - first + 1) as u64;
        let (from, to) = (first.saturating_sub(1), (last + 1).min(nx - 1));
        for z in z.saturating_sub(1)..=(z + 1).min(nz - 1) {
            for y in y.saturating_sub(1)..=(y + 1).min(ny - 1) {
                let base = nx * (y + ny * z);
                // One sample of each run is enough: it finds the others.
                let mut in_run = false;
                for at in base + from..=base + to {
                    let here = solid(at);
                    if here && !in_run && !seen.has(at) {
                        waiting.push(at);
                    }
                    in_run = here;
                }
            }
        }
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Affine;

    fn volume(dims: [usize; 3], samples: Vec<u8>) -> Volume {
        Volume::new(dims, Samples::U8(samples), Affine::IDENTITY).unwrap()
    }

    /// All parts by the definition: labels spread until nothing changes.
    fn by_definition(dims: [usize; 3], samples: &[u8], c: u8) -> Vec<u8> {
        let [nx, ny, _] = dims;
        let at = |i: usize| grid3::at([nx, ny], i);
        let mut label: Vec<usize> = (0..samples.len()).collect();
        loop {
            let mut changed = false;
            for i in 0..samples.len() {
                for j in 0..samples.len() {
                    let near = at(i).iter().zip(at(j)).all(|(a, b)| a.abs_diff(b) <= 1);
                    if near && samples[i] > c && samples[j] > c && label[j] < label[i] {
                        label[i] = label[j];
                        changed = true;
                    }
                }
            }
            if !changed {
                break;
            }
        }
        let size = |l: usize| (0..samples.len()).filter(|&i| samples[i] > c && label[i] == l).count();
        let best = (0..samples.len()).rev().max_by_key(|&l| size(l)).unwrap();
        let falls = |from: &dyn Fn(usize) -> bool, barred: &[bool]| {
            let mut reached: Vec<bool> = (0..samples.len()).map(|i| samples[i] > c && from(i)).collect();
            loop {
                let before = reached.clone();
                for i in (0..samples.len()).filter(|&i| before[i]) {
                    for j in 0..samples.len() {
                        let near = at(i).iter().zip(at(j)).all(|(a, b)| a.abs_diff(b) <= 1);
                        reached[j] |= near && samples[j] < samples[i] && samples[j] <= c && !barred[j];
                    }
                }
                if reached == before {
                    return reached;
                }
            }
        };
        let kept = falls(&|i| label[i] == best, &vec![false; samples.len()]);
        let gone = falls(&|i| label[i] != best, &kept);
        let low = *samples.iter().min().unwrap();
        (0..samples.len()).map(|i| if gone[i] && !kept[i] { low } else { samples[i] }).collect()
    }

    #[test]
    fn the_largest_part_stays_as_by_definition() {
        use crate::sampling::hash::uniform;
        for (seed, dims) in (0..60).zip([[5, 4, 3], [7, 1, 6], [1, 1, 9], [4, 5, 5]].into_iter().cycle()) {
            let count = dims.iter().product::<usize>();
            let density = 0.15 + 0.2 * (seed % 3) as f32;
            let sample =
                |i: usize| if uniform(seed, i as u64, 0, 0) < density { 100 + (i % 50) as u8 } else { (i % 90) as u8 };
            let samples: Vec<u8> = (0..count).map(sample).collect();
            let (masked, removed) = volume(dims, samples.clone()).keep_largest(95.0).unwrap();
            let expected = by_definition(dims, &samples, 95);
            assert_eq!(*masked.samples(), Samples::U8(expected.clone()), "{seed} {dims:?}");
            let gone = samples.iter().zip(&expected).filter(|(a, b)| **a > 95 && a != b).count() as u64;
            assert_eq!(removed.samples, gone, "{seed}");
        }
    }

    #[test]
    fn the_lit_value_is_that_of_the_other_side() {
        // Two solids below 100: of 2 samples and of 1.
        let mut below = volume([7, 1, 1], vec![200, 50, 60, 200, 180, 70, 200]);
        below.solid = Solid::Below;
        let (masked, removed) = below.keep_largest(100.0).unwrap();
        // What falls away from the smaller, 180, goes with it.
        assert_eq!(*masked.samples(), Samples::U8(vec![200, 50, 60, 200, 200, 200, 200]));
        assert_eq!(removed, Removed { parts: 1, samples: 1, kept: 2 });
        assert_eq!(masked.outermost([100.0, 150.0]), Some(150.0));
        // One part: nothing changes.
        let (same, removed) = masked.clone().keep_largest(100.0).unwrap();
        assert_eq!((same.samples(), removed.parts), (masked.samples(), 0));
    }
}
