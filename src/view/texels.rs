//! Transfer of the texels that have a level set, on the texture's lattice or on a coarser one.

use crate::error::Result;
use crate::relight::Textures;
use crate::transfer::{BRICK, Lattice, validity};
use half::f16;
use half::slice::HalfFloatSliceExt;

/// A coarser texel is valid from this share of valid weight on: below, it would be the noise of a few.
const LEAST_SHARE: f32 = 0.25;

/// Textures that are lit together, with all their bricks at hand.
pub(super) struct Texels<'a> {
    lattice: Lattice,
    // Numbers of a texel in all textures.
    numbers: usize,
    bricks: Vec<Option<Brick<'a>>>,
}

/// The same brick of all textures.
struct Brick<'a> {
    validity: &'a [u8],
    // Transfer, and how many numbers a texel has of it; that of the environment first.
    transfer: Vec<(&'a [f16], usize)>,
}

/// Which texels of an axis a coarser texel takes, and how much of each.
type Taps = Vec<Vec<(usize, f32)>>;

/// The tent of [`Texels::visit_valid`] along one axis: as wide as a step of the target, at least one of the source.
pub(super) fn taps(source: usize, target: usize) -> Taps {
    let step = if target < 2 { 0.0 } else { (source - 1) as f64 / (target - 1) as f64 };
    let radius = step.max(1.0);
    (0..target)
        .map(|i| {
            let at = i as f64 * step;
            let first = (at - radius).ceil().max(0.0) as usize;
            let last = ((at + radius).floor() as usize).min(source - 1);
            let weight = |j: usize| (1.0 - (j as f64 - at).abs() / radius) as f32;
            (first..=last).map(|j| (j, weight(j))).filter(|(_, w)| *w > 1e-6).collect()
        })
        .collect()
}

/// Resolution with the longest side reduced to `side`; the same where it fits already.
pub(super) fn reduced(dims: [usize; 3], side: usize) -> [usize; 3] {
    let longest = dims.into_iter().max().unwrap_or(1);
    if longest <= side {
        return dims;
    }
    let ratio = (side.max(2) - 1) as f64 / (longest - 1) as f64;
    dims.map(|n| if n == 1 { 1 } else { (((n - 1) as f64 * ratio).round() as usize + 1).clamp(2, n) })
}

impl<'a> Texels<'a> {
    /// That of the environment, then in a scene that of emission and those of the luminaires. A brick is there where
    /// all have it.
    pub(super) fn gather(textures: &Textures<'a>) -> Result<Self> {
        let luminaires = textures.luminaires().iter().map(|l| l.texture);
        let sources: Vec<_> =
            std::iter::once(textures.environment()).chain(textures.emission()).chain(luminaires).collect();
        let lattice = textures.layout().lattice;
        let counts: Vec<usize> = sources.iter().map(|s| s.layout().layers.coefficients()).collect();
        let [bx, by, bz] = lattice.bricks();
        let brick = |i: usize| {
            let index = [i % bx, i / bx % by, i / bx / by];
            let mut brick: Option<Brick<'a>> = None;
            for (source, &count) in sources.iter().zip(&counts) {
                let Some(view) = source.brick(index)? else { return Ok(None) };
                let brick = brick.get_or_insert(Brick { validity: view.validity, transfer: Vec::new() });
                brick.transfer.push((view.transfer, count));
            }
            Ok(brick)
        };
        let bricks = (0..bx * by * bz).map(brick).collect::<Result<_>>()?;
        Ok(Self { lattice, numbers: counts.iter().sum(), bricks })
    }

    /// Bricks (x fastest, ascending) in which something is baked.
    pub(super) fn baked_bricks(&self) -> Vec<[usize; 3]> {
        let [bx, by, _] = self.lattice.bricks();
        let index = |i: usize| [i % bx, i / bx % by, i / bx / by];
        self.bricks.iter().enumerate().filter(|(_, b)| b.is_some()).map(|(i, _)| index(i)).collect()
    }

    /// Reads the numbers of a texel; false where it has no level set.
    fn read(&self, texel: [usize; 3], out: &mut [f32]) -> bool {
        let [bx, by, _] = self.lattice.bricks();
        let brick = &self.bricks[texel[0] / BRICK + bx * (texel[1] / BRICK + by * (texel[2] / BRICK))];
        let inner = texel[0] % BRICK + BRICK * (texel[1] % BRICK + BRICK * (texel[2] % BRICK));
        let Some(brick) = brick.as_ref().filter(|b| b.validity[inner] & validity::VALID != 0) else { return false };
        let mut rest = out;
        for &(stored, n) in &brick.transfer {
            let (own, others) = rest.split_at_mut(n);
            stored[inner * n..(inner + 1) * n].convert_to_f32_slice(own);
            rest = others;
        }
        true
    }

    /// Hands out every valid texel of `target`, x fastest: its number in the lattice, and its transfer, texture by
    /// texture.
    ///
    /// On the texture's own lattice these are the stored numbers; on a coarser one the mean over the valid texels
    /// around, weighted by a tent.
    pub(super) fn visit_valid(&self, target: Lattice, visit: &mut dyn FnMut(usize, &[f32])) {
        let (from, to) = (self.lattice.texels(), target.texels());
        let axes: [Taps; 3] = std::array::from_fn(|a| taps(from[a], to[a]));
        let (mut sum, mut texel) = (vec![0.0f32; self.numbers], vec![0.0f32; self.numbers]);
        for (z, in_z) in axes[2].iter().enumerate() {
            for (y, in_y) in axes[1].iter().enumerate() {
                for (x, in_x) in axes[0].iter().enumerate() {
                    sum.fill(0.0);
                    let (mut valid, mut all) = (0.0f32, 0.0f32);
                    for &(k, wz) in in_z {
                        for &(j, wy) in in_y {
                            for &(i, wx) in in_x {
                                let weight = wx * wy * wz;
                                all += weight;
                                if !self.read([i, j, k], &mut texel) {
                                    continue;
                                }
                                sum.iter_mut().zip(&texel).for_each(|(s, t)| *s += weight * t);
                                valid += weight;
                            }
                        }
                    }
                    if valid > 0.0 && valid >= LEAST_SHARE * all {
                        sum.iter_mut().for_each(|s| *s /= valid);
                        visit(x + to[0] * (y + to[1] * z), &sum);
                    }
                }
            }
        }
    }
}
