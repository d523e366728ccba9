//! Radiance at a point from single texels, written from the definitions in `f64`: nothing of the runtime's contraction
//! and lookup is used, so that what these add shows.

use super::Question;
use crate::error::Result;
use crate::relight::Tail;
use crate::sampling::hash::key;
use crate::sh::Coefficients;
use crate::transfer::{BRICK, Lattice, Layers, Selection, validity};
use crate::transport::{Bake, Settings, TexelEstimate, estimates};
use std::collections::BTreeMap;

/// Radiance at the points from texels of many rays, and from texels as they were baked, both unrounded. Where no texel is
/// valid, or the texels cannot be made again, what the store gave stands in.
pub(super) fn interpolated(q: &Question<'_>, stored: &[[f64; 3]]) -> Result<[Vec<[f64; 3]>; 2]> {
    let layout = q.texture.layout();
    let corners: Vec<Vec<([usize; 3], f64)>> =
        q.points.iter().map(|p| trilinear(layout.lattice, p.position_in_grid)).collect();
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
    let radiance = |settings: &Settings, rays: &dyn Fn(u32) -> u32| -> Result<BTreeMap<[usize; 3], [f64; 3]>> {
        // Texels that the store has without rays have no level set.
        let wanted: Vec<([usize; 3], u32)> =
            texels.iter().filter(|(_, n)| **n > 0).map(|(t, n)| (*t, rays(*n))).collect();
        let selection = Selection::empty(layout.lattice);
        let bake = Bake::new(q.volume, q.pyramid, layout, settings, &selection);
        let found = estimates(&bake, &wanted)?;
        let valid = wanted.iter().zip(found).filter_map(|((texel, _), found)| Some((*texel, found?.swap_remove(0))));
        Ok(valid.map(|(texel, found)| (texel, of_texel(&layout.layers, &found, q))).collect())
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

fn of_texel(layers: &Layers, texel: &TexelEstimate, q: &Question<'_>) -> [f64; 3] {
    radiance_of(layers, &texel.transfer, layers, q.coefficients, q.albedo)
}

/// Σ_k ρ^(k+1) ⟨T_k, L⟩ and the tail, of the layers and bands `kept` of a transfer vector laid out as `layers`, which has
/// them all.
pub(crate) fn radiance_of(
    layers: &Layers,
    transfer: &[f32],
    kept: &Layers,
    light: &[Coefficients; 3],
    albedo: [f32; 3],
) -> [f64; 3] {
    let root_four_pi = 2.0 * std::f32::consts::PI.sqrt();
    let escapes: Vec<f32> = (0..kept.len()).map(|k| root_four_pi * transfer[layers.offset(k)]).collect();
    let tail = Tail::new(&escapes);
    std::array::from_fn(|c| {
        let (mut power, mut sum) = (1.0, 0.0);
        for (k, &bands) in kept.bands().iter().enumerate() {
            power *= f64::from(albedo[c]);
            let transfer = &transfer[layers.offset(k)..][..bands * bands];
            let product: f64 = transfer.iter().zip(light[c].values()).map(|(&t, &l)| f64::from(t) * l).sum();
            sum += power * product;
            if k + 1 == kept.len() {
                sum += power * product * f64::from(tail.gain(albedo[c]));
            }
        }
        sum
    })
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
    let Some(brick) = q.texture.brick(texel.map(|t| t / BRICK))? else { return Ok(0) };
    let [x, y, z] = texel.map(|t| t % BRICK);
    let t = x + BRICK * (y + BRICK * z);
    // An open texel has the closed form, which any number of paths gives that all escape.
    Ok(if brick.validity[t] & validity::OPEN != 0 { q.texel_rays } else { brick.rays[t] })
}
