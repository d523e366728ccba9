//! What fills texels: the interface of the estimators, and what one brick of texels gets from one.

use super::bake::Bake;
use super::open::{Openness, unoccluded};
use super::path::{Scratch, Settings, TexelEstimate, expected_error};
use super::summary::Summary;
use super::sums::{Real, target_stderr};
use crate::grid3;
use crate::level::{Counts, LevelField, Site};
use crate::transfer::{BRICK_TEXELS, Brick, Layers, validity};
use crate::volume::Sample;
use half::f16;
use std::sync::atomic::{AtomicBool, Ordering};

/// What became of a texel.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Fate {
    /// It has an estimate from paths or photons.
    Estimated,
    /// It has the closed form of a texel that nothing shades.
    Open,
    /// No light reaches it: it has no surface.
    Buried,
}

/// A way to estimate the transfer of single texels, each a pure function of its number in the lattice.
pub(super) trait Estimator: Sync {
    /// In what it sums.
    type Real: Real;
    /// Buffers of a thread.
    type Scratch: Default;

    /// Layers of each texture that it fills, in the order of the bricks ([`Bake::groups`]).
    fn layers(&self) -> &[Layers];

    /// The point of a texel on its level set, from its grid position.
    fn site(&self, position_in_grid: [f64; 3]) -> Option<Site>;

    /// A point of an isosurface: its place, its normal, and the isovalue of all of them, as stored.
    fn site_on(&self, position_in_grid: [f32; 3], normal: [f32; 3], isovalue: f32) -> Option<Site>;

    /// Estimates the transfer of a site, one entry of `out` a texture; `item` is the linear index of its texel. Work is
    /// added to the counts of `summary`.
    fn estimate(
        &self,
        site: &Site,
        item: u64,
        scratch: &mut Self::Scratch,
        summary: &mut Summary,
        out: &mut [TexelEstimate<Self::Real>],
    ) -> Fate;
}

/// What an estimator within one level set does for a site that is not open.
pub(super) type WithinLevelSet<'a> = dyn Fn(&Site, u64, &mut Scratch, &mut Counts, &mut TexelEstimate) + Sync + 'a;

/// The estimators of a volume alone: one grey texture, and a closed form where nothing shades a texel.
pub(super) struct Alone<'a, 'f, 'v, T> {
    pub(super) field: &'f LevelField<'v, T>,
    pub(super) openness: Openness<'f, 'v, T>,
    pub(super) settings: &'a Settings,
    pub(super) estimate: &'a WithinLevelSet<'a>,
}

impl<T: Sample> Estimator for Alone<'_, '_, '_, T> {
    type Real = f32;
    type Scratch = Scratch;

    fn layers(&self) -> &[Layers] {
        std::slice::from_ref(&self.settings.layers)
    }

    fn site(&self, position_in_grid: [f64; 3]) -> Option<Site> {
        self.field.site(position_in_grid)
    }

    fn site_on(&self, position_in_grid: [f32; 3], normal: [f32; 3], isovalue: f32) -> Option<Site> {
        self.field.site_on(position_in_grid, normal, isovalue)
    }

    fn estimate(
        &self,
        site: &Site,
        item: u64,
        scratch: &mut Scratch,
        summary: &mut Summary,
        out: &mut [TexelEstimate],
    ) -> Fate {
        if self.openness.admits(site) {
            unoccluded(self.settings, site, &mut out[0]);
            return Fate::Open;
        }
        (self.estimate)(site, item, scratch, &mut summary.counts, &mut out[0]);
        Fate::Estimated
    }
}

/// The bricks of one place, one a texture, and what they cost.
pub struct BrickOutput {
    /// The texels, in the order of [`Bake::groups`].
    pub bricks: Vec<Brick>,
    /// Their totals.
    pub summary: Summary,
}

/// The linear index of a texel.
pub(super) fn item_of(bake: &Bake<'_>, texel: [usize; 3]) -> u64 {
    let [mx, my, _] = bake.layout.lattice.texels();
    (grid3::index([mx, my], texel)) as u64
}

/// Blank estimates, one a texture.
pub(super) fn estimates_of<E: Estimator>(estimator: &E) -> Vec<TexelEstimate<E::Real>> {
    estimator.layers().iter().map(|_| TexelEstimate::default()).collect()
}

/// Computes the wanted texels of a brick. Those of `old` are kept where they have as many paths. Once `cancel` is set, the rest is left out.
pub(super) fn brick_of<E: Estimator>(
    estimator: &E,
    bake: &Bake<'_>,
    wanted: &dyn Fn([usize; 3]) -> bool,
    index: [usize; 3],
    old: Option<Vec<Brick>>,
    scratch: &mut E::Scratch,
    cancel: Option<&AtomicBool>,
) -> BrickOutput {
    let all_layers = estimator.layers();
    let mut bricks = old.unwrap_or_else(|| all_layers.iter().map(Brick::unbaked).collect());
    let mut summary = Summary::new(all_layers);
    let mut out = estimates_of(estimator);
    for t in 0..BRICK_TEXELS {
        // Who cancels takes no output: with many paths a brick may take seconds.
        if cancel.is_some_and(|cancel| cancel.load(Ordering::Relaxed)) {
            break;
        }
        let texel = bake.layout.lattice.texel_in_brick(index, t);
        if !wanted(texel) {
            continue;
        }
        summary.texels += 1;
        let Some(site) = bake.site(estimator, texel) else {
            blank(&mut bricks, all_layers, t);
            continue;
        };
        let first = &bricks[0];
        let has = if first.validity[t] & validity::VALID != 0 { first.rays[t] } else { 0 };
        if bake.settings.target.is_none() && has >= bake.settings.rays {
            summary.texels -= 1;
            continue;
        }
        if has > 0 && meets_target(bake, &bricks, t) {
            summary.texels -= 1;
            continue;
        }
        let fate = estimator.estimate(&site, item_of(bake, texel), scratch, &mut summary, &mut out);
        if fate == Fate::Buried {
            blank(&mut bricks, all_layers, t);
            continue;
        }
        summary.count(&out, all_layers, site.clamped, fate == Fate::Open);
        if has > 0 && has >= out[0].rays {
            continue;
        }
        let flag = |is_set: bool, flag: u8| if is_set { flag } else { 0 };
        let flags = validity::VALID | flag(site.clamped, validity::CLAMPED) | flag(fate == Fate::Open, validity::OPEN);
        for ((brick, layers), estimate) in bricks.iter_mut().zip(all_layers).zip(&out) {
            let (coefficients, errors) = (layers.coefficients(), layers.errors());
            Real::store(&estimate.transfer, &mut brick.transfer[t * coefficients..(t + 1) * coefficients]);
            Real::store(&estimate.stderr, &mut brick.stderr[t * errors..(t + 1) * errors]);
            (brick.validity[t], brick.rays[t]) = (flags, out[0].rays);
        }
    }
    BrickOutput { bricks, summary }
}

/// Whether a texel of a volume alone, as it is stored, has the error at which a new one would stop.
fn meets_target(bake: &Bake<'_>, bricks: &[Brick], t: usize) -> bool {
    let ([brick], Some(target)) = (bricks, &bake.settings.target) else { return false };
    let layers = &bake.settings.layers;
    let widened = |stored: &[f16], n: usize| stored[t * n..(t + 1) * n].iter().map(|v| v.to_f32()).collect();
    let mut texel: TexelEstimate = TexelEstimate {
        transfer: widened(&brick.transfer, layers.coefficients()),
        stderr: widened(&brick.stderr, layers.errors()),
        rays: brick.rays[t],
        ..TexelEstimate::default()
    };
    texel.target_stderr = target_stderr(layers, Some(target), &texel);
    expected_error(&texel) <= target.error
}

/// Makes a texel one without a surface.
fn blank(bricks: &mut [Brick], all_layers: &[Layers], t: usize) {
    for (brick, layers) in bricks.iter_mut().zip(all_layers) {
        let (coefficients, errors) = (layers.coefficients(), layers.errors());
        brick.transfer[t * coefficients..(t + 1) * coefficients].fill(f16::ZERO);
        brick.stderr[t * errors..(t + 1) * errors].fill(f16::ZERO);
        (brick.validity[t], brick.rays[t]) = (0, 0);
    }
}
