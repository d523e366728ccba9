//! Seams: edges of the surface that lie in two charts. Texels of the two sides sample what lies between them at other places, so that
//! colours along a seam differ by what changes within a texel.
//!
//! They are made equal at points along all seams: each is an equation between the four texels around it on the one side and on the
//! other, and the texels change as little as it takes (the projections of Kaczmarz 1937, one equation after the other).

use super::fill::Picture;
use crate::export::{Image, Selection};
use crate::srgb;
use std::collections::BTreeMap;

/// How often all equations are gone through.
const SWEEPS: usize = 8;
/// Points on a seam to a texel of its length.
const POINTS: f32 = 2.0;

/// Two places in the picture, in texels, that show one point of the surface.
type Pair = [[f32; 2]; 2];

/// Makes both sides of seams equal, and returns how far they are apart then: the 99th percentile of the largest difference of a
/// channel, in display signal (sRGB).
pub(super) fn close(picture: &mut Picture, selection: &Selection, coordinates: &[[f32; 2]]) -> f64 {
    let side = picture.image.width();
    let pairs = pairs(selection, coordinates, side as f32);
    for _ in 0..SWEEPS {
        for pair in &pairs {
            let taps = pair.map(|place| taps(place, side));
            let pixels = picture.image.pixels_mut();
            let squares: f32 = taps.iter().flatten().map(|(_, weight)| weight * weight).sum();
            for c in 0..3 {
                let [one, two] = taps.map(|taps| taps.iter().map(|&(i, weight)| weight * pixels[i][c]).sum::<f32>());
                let step = (one - two) / squares;
                for (taps, step) in taps.iter().zip([-step, step]) {
                    for &(i, weight) in taps {
                        pixels[i][c] = (pixels[i][c] + weight * step).clamp(0.0, 1.0);
                    }
                }
            }
        }
    }
    let mut apart: Vec<f64> = pairs.iter().map(|pair| difference(picture, *pair)).collect();
    apart.sort_by(f64::total_cmp);
    apart.get(apart.len() * 99 / 100).copied().unwrap_or(0.0)
}

/// Points along the seams.
fn pairs(selection: &Selection, coordinates: &[[f32; 2]], side: f32) -> Vec<Pair> {
    // By the vertices of the surface, the lower number first.
    let mut edges: BTreeMap<(u32, u32), Vec<[u32; 2]>> = BTreeMap::new();
    for t in &selection.triangles {
        for i in 0..3 {
            let (a, b) = (t[i], t[(i + 1) % 3]);
            let [u, v] = [a, b].map(|v| selection.vertices[v as usize]);
            let (key, edge) = if u < v { ((u, v), [a, b]) } else { ((v, u), [b, a]) };
            edges.entry(key).or_default().push(edge);
        }
    }
    let place = |v: u32| coordinates[v as usize].map(|x| side * x);
    let between = |[a, b]: [u32; 2], t: f32| {
        let (from, to) = (place(a), place(b));
        [0, 1].map(|axis| from[axis] + t * (to[axis] - from[axis]))
    };
    let mut pairs = Vec::new();
    for edges in edges.into_values() {
        let [one, two] = edges[..] else { continue };
        if one == two {
            continue;
        }
        let (from, to) = (place(one[0]), place(one[1]));
        let length = ((to[0] - from[0]).powi(2) + (to[1] - from[1]).powi(2)).sqrt();
        let count = (POINTS * length).ceil().max(1.0) as usize;
        pairs.extend((0..=count).map(|k| k as f32 / count as f32).map(|t| [between(one, t), between(two, t)]));
    }
    pairs
}

/// The four texels around a place, and what each counts there.
fn taps(place: [f32; 2], side: usize) -> [(usize, f32); 4] {
    let at = place.map(|x| (x - 0.5).clamp(0.0, (side - 1) as f32));
    let low = at.map(|x| x as usize);
    let high = low.map(|x| (x + 1).min(side - 1));
    let [u, v] = [0, 1].map(|axis| at[axis] - low[axis] as f32);
    [
        (low[0] + side * low[1], (1.0 - u) * (1.0 - v)),
        (high[0] + side * low[1], u * (1.0 - v)),
        (low[0] + side * high[1], (1.0 - u) * v),
        (high[0] + side * high[1], u * v),
    ]
}

/// The colour of a picture at a place in texels, linear between their centres.
pub(super) fn sample(picture: &Image, place: [f32; 2]) -> [f32; 3] {
    let taps = taps(place, picture.width());
    [0, 1, 2].map(|c| taps.iter().map(|&(i, weight)| weight * picture.pixels()[i][c]).sum())
}

fn difference(picture: &Picture, pair: Pair) -> f64 {
    let [one, two] = pair.map(|place| sample(&picture.image, place).map(|x| srgb::srgb_from_linear(f64::from(x))));
    one.iter().zip(two).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}
