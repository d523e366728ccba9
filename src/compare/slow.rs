//! Radiance at a point from single texels, written from the definitions in `f64`: nothing of the runtime's contraction
//! and lookup is used, so that what these add shows.

use super::Question;
use crate::error::Result;
use crate::relight::Tail;
use crate::sampling::hash::key;
use crate::sh::Coefficients;
use crate::transfer::{Lattice, Layers, validity};
use crate::transport::Settings;
use std::collections::BTreeMap;

/// Radiance at the points from texels of many rays, and from texels as they were baked, both unrounded. Where no texel is
/// valid, or the texels cannot be made again, what the store gave stands in.
pub(super) fn interpolated(q: &Question<'_>, stored: &[[f64; 3]]) -> Result<[Vec<[f64; 3]>; 2]> {
    let (layout, surface) = (q.textures[0].layout(), &q.surface);
    let corners: Vec<Vec<([usize; 3], f64)>> =
        surface.points.iter().map(|p| surface.around(layout.lattice, p)).collect();
    let mut texels: BTreeMap<[usize; 3], u32> = BTreeMap::new();
    for (texel, _) in corners.iter().flatten() {
        texels.insert(*texel, stored_rays(q, *texel)?);
    }
    let base = q.baked_by.cloned().unwrap_or(Settings {
        layers: layout.layers.clone(),
        rays: q.texel_rays,
        seed: q.seed,
        target: None,
        positive: false,
    });
    let light = surface.texel_light(q.bands());
    let radiance = |settings: &Settings, rays: &dyn Fn(u32) -> u32| -> Result<BTreeMap<[usize; 3], [f64; 3]>> {
        // Texels that the store has without rays have no level set.
        let wanted: Vec<([usize; 3], u32)> =
            texels.iter().filter(|(_, n)| **n > 0).map(|(t, n)| (*t, rays(*n))).collect();
        let found = surface.texels(layout, settings, &wanted)?;
        let of_texel = |groups: Vec<Vec<f32>>| radiance_of(&layout.layers, &groups, &layout.layers, &light);
        Ok(found.into_iter().map(|(texel, groups)| (texel, of_texel(groups))).collect())
    };
    let other_seed = key(q.seed, 0x7465_7865_6c73);
    let fine = radiance(&Settings { seed: other_seed, rays: q.texel_rays, ..base.clone() }, &|_| q.texel_rays)?;
    let at_points = |values: &BTreeMap<[usize; 3], [f64; 3]>| -> Vec<[f64; 3]> {
        corners.iter().zip(stored).map(|(corners, stored)| between(corners, values).unwrap_or(*stored)).collect()
    };
    let again = match q.baked_by {
        Some(settings) => at_points(&radiance(settings, &|rays| rays)?),
        None => stored.to_vec(),
    };
    Ok([at_points(&fine), again])
}

/// The mean of what is there, by weight.
pub(crate) fn between(corners: &[([usize; 3], f64)], values: &BTreeMap<[usize; 3], [f64; 3]>) -> Option<[f64; 3]> {
    let (mut sum, mut weights) = ([0.0; 3], 0.0);
    for (texel, weight) in corners {
        if let Some(value) = values.get(texel) {
            (0..3).for_each(|c| sum[c] += weight * value[c]);
            weights += weight;
        }
    }
    (weights > 0.0).then(|| sum.map(|v| v / weights))
}

/// What the transfer of a texel is multiplied with.
pub(crate) struct TexelLight<'a> {
    /// The environment.
    pub(crate) light: &'a [Coefficients; 3],
    pub(crate) albedo: [f32; 3],
    pub(crate) emission: [f32; 3],
    /// Of each luminaire the factor on what its texture holds.
    pub(crate) luminaires: Vec<[f64; 3]>,
}

/// Radiance of a texel, of the layers and bands `kept` of its transfer: the vectors of its groups, that of the
/// environment laid out as `layers`, which has them all.
pub(crate) fn radiance_of(layers: &Layers, groups: &[Vec<f32>], kept: &Layers, light: &TexelLight<'_>) -> [f64; 3] {
    match groups {
        [alone] => of_volume_alone(layers, alone, kept, light),
        [environment, emission, luminaires @ ..] => {
            std::array::from_fn(|c| in_scene(layers, environment, emission, luminaires, kept, light, c))
        }
        [] => [0.0; 3],
    }
}

/// ⟨T_k, L⟩ of a channel of layer k.
fn product(layers: &Layers, transfer: &[f32], k: usize, c: usize, bands: usize, light: &Coefficients) -> f64 {
    let of_channel = if layers.channels() == 1 { 0 } else { c * layers.bands()[k] * layers.bands()[k] };
    let transfer = &transfer[layers.offset(k) + of_channel..][..bands * bands];
    transfer.iter().zip(light.values()).map(|(&t, &l)| f64::from(t) * l).sum()
}

/// Σ_k ρ^(k+1) ⟨T_k, L⟩, emission by the chances to escape, and the tail.
fn of_volume_alone(layers: &Layers, transfer: &[f32], kept: &Layers, light: &TexelLight<'_>) -> [f64; 3] {
    let root_four_pi = 2.0 * std::f32::consts::PI.sqrt();
    let escapes: Vec<f32> = (0..kept.len()).map(|k| root_four_pi * transfer[layers.offset(k)]).collect();
    let tail = Tail::new(&escapes);
    std::array::from_fn(|c| {
        let albedo = light.albedo[c];
        let mut sum = f64::from(light.emission[c]) * f64::from(tail.emission(&escapes, albedo).0);
        let mut power = 1.0;
        for (k, &bands) in kept.bands().iter().enumerate() {
            power *= f64::from(albedo);
            let product = product(layers, transfer, k, c, bands, &light.light[c]);
            sum += power * product;
            if k + 1 == kept.len() {
                sum += power * product * f64::from(tail.gain(albedo));
            }
        }
        sum
    })
}

/// Le + Σ_k ρ^(k+1) (⟨T_k, L⟩ + Σ_l s_l G_k,l + Le G_k) of a channel, G_k that of emission, and the tail: the last
/// layer again ρ r/(1 − ρ r) times, r = min(G_K/G_(K−1), 1).
fn in_scene(
    layers: &Layers,
    environment: &[f32],
    emission: &[f32],
    luminaires: &[Vec<f32>],
    kept: &Layers,
    light: &TexelLight<'_>,
    c: usize,
) -> f64 {
    let (albedo, emitted) = (f64::from(light.albedo[c]), f64::from(light.emission[c]));
    let gain = |group: &[f32], k: usize| f64::from(group[3 * k + c]);
    let (mut power, mut sum, mut last) = (1.0, emitted, 0.0);
    for (k, &bands) in kept.bands().iter().enumerate() {
        power *= albedo;
        let near = luminaires.iter().zip(&light.luminaires).map(|(group, factor)| factor[c] * gain(group, k));
        let distant = product(layers, environment, k, c, bands, &light.light[c]);
        last = power * (distant + near.sum::<f64>() + emitted * gain(emission, k));
        sum += last;
    }
    if let Some(before) = kept.len().checked_sub(2) {
        let (before, met) = (gain(emission, before), gain(emission, kept.len() - 1));
        let again = albedo * if before > 0.0 { (met / before).min(1.0) } else { 0.0 };
        sum += if again < 1.0 { last * again / (1.0 - again) } else { 0.0 };
    }
    sum
}

/// The eight texels around a grid position with their weights.
pub(crate) fn trilinear(lattice: Lattice, position_in_grid: [f32; 3]) -> Vec<([usize; 3], f64)> {
    let m = lattice.texels();
    let place: [f64; 3] =
        std::array::from_fn(|a| (f64::from(position_in_grid[a]) / lattice.step(a)).clamp(0.0, (m[a] - 1) as f64));
    let low: [usize; 3] = std::array::from_fn(|a| (place[a] as usize).min(m[a].saturating_sub(2)));
    let corners = (0..8usize).map(|i| {
        let mut weight = 1.0;
        let texel = std::array::from_fn(|a| {
            let (t, up) = (place[a] - low[a] as f64, i >> a & 1);
            weight *= if up == 1 { t } else { 1.0 - t };
            (low[a] + up).min(m[a] - 1)
        });
        (texel, weight)
    });
    corners.filter(|(_, weight)| *weight > 0.0).collect()
}

/// Rays of a texel in the store; 0 where it has no level set or was not baked.
fn stored_rays(q: &Question<'_>, texel: [usize; 3]) -> Result<u32> {
    let (brick, t) = q.textures[0].layout().lattice.place_of(texel);
    let Some(brick) = q.textures[0].brick(brick)? else { return Ok(0) };
    // An open texel has the closed form, which any number of paths gives that all escape.
    Ok(if brick.validity[t] & validity::OPEN != 0 { q.texel_rays } else { brick.rays[t] })
}
