//! The slow twin of contraction: one texel at a time, as the formulas stand.

use super::contract::{NO_LEVEL_SET, Textures, UNBAKED, Weights, contract};
use super::noise::{ELSEWHERE, NO_DIRECTIONS, ROOT_FOUR_PI};
use super::{Light, Material, Tail};
use crate::sampling::hash::uniform;
use crate::sampling::statistics::POOLED_BANDS;
use crate::transfer::{BRICK_TEXELS, Brick, BrickSource, Lattice, Layers, Layout, MAX_LAYERS, MemoryTexture, validity};
use glam::{Vec3, Vec4};
use half::f16;

/// What contraction makes of one texel.
pub(super) struct Texel {
    pub(super) rgb: Vec3,
    variance: f32,
    left_out: f32,
}

const THIRD: f32 = 1.0 / 3.0;

/// Radiance and its variance of one texel.
pub(super) fn texel(weights: &Weights, transfer: &[f32], stderr: &[f16], layers: &Layers) -> Texel {
    let mut rgb = Vec4::ZERO;
    let mut contracted = [Vec4::ZERO; MAX_LAYERS];
    for (layer, &(offset, count)) in contracted.iter_mut().zip(&weights.spans) {
        let mut sums = [Vec4::ZERO; 2];
        for i in 0..count {
            let (t, w, sum) = (transfer[offset + i], weights.rows[offset + i], &mut sums[i % 2]);
            (0..4).for_each(|c| sum[c] = w[c].mul_add(t, sum[c]));
        }
        *layer = sums[0] + sums[1];
        rgb += *layer;
    }
    let mut rgb = rgb.truncate();
    let (mut beyond, mut slope, mut slopes, mut survival, mut left_out) = (0.0, 0.0, [0.0; 2], 0.0, 0.0f32);
    let last = layers.len() - 1;
    if last > 0 || weights.emission != [0.0; 3] {
        let escapes: Vec<f32> =
            (0..=last).map(|k| transfer[layers.offset(k)] * (2.0 * std::f32::consts::PI.sqrt())).collect();
        let tail = Tail::new(&escapes);
        let of_last = contracted[last].truncate();
        let gained = of_last * Vec3::from_array(weights.albedo.map(|albedo| tail.gain(albedo)));
        rgb += gained;
        let sloped = of_last * Vec3::from_array(weights.albedo.map(|albedo| tail.gain_and_slope(albedo)[1]));
        (beyond, slope) = (sum(gained) * THIRD, sum(sloped) * THIRD);
        (slopes, survival) = (ratio_slopes(&escapes, tail.ratio), (1.0 - escapes.iter().sum::<f32>()).max(0.0));
        for c in 0..3 {
            if weights.emission != [0.0; 3] {
                let (factor, remainder) = tail.emission(&escapes, weights.albedo[c]);
                rgb[c] += weights.emission[c] * factor;
                left_out = if weights.emission[c] > 0.0 { left_out.max(remainder) } else { left_out };
            }
        }
    }
    let channels = |k: usize| sum(contracted[k].truncate()) * THIRD;
    let escape = |k: usize| ROOT_FOUR_PI * transfer[layers.offset(k)];
    let blocked = 1.0 - escape(0);
    let continued = (1..=last).map(channels).fold(beyond, |sum, mean| sum + mean);
    let continuation = if blocked > 1e-6 { (continued / blocked).max(0.0) } else { 0.0 };
    let tail_gain = if channels(last) > 0.0 { 1.0 + (beyond / channels(last)).max(0.0) } else { 1.0 };
    let mut variance = 0.0;
    for (k, layer) in weights.noise.layers.iter().enumerate() {
        let gain = if k == last { tail_gain } else { 1.0 };
        let shift = if k == last { slope * slopes[0] } else { 0.0 };
        let traded = continuation - shift;
        let spread =
            |mean: f32, square: f32| (square * gain * gain - 2.0 * traded * mean * gain + traded * traded).max(0.0);
        let anywhere = spread(layer.mean, layer.mean_square);
        let bands = layers.bands()[k].min(POOLED_BANDS);
        let errors = stderr[layers.error_offset(k)..][..bands].iter().map(|s| s.to_f32()).enumerate();
        let events = errors.fold(0.0, |sum, (l, s)| sum + (2 * l + 1) as f32 * s * s);
        let events = events * (ROOT_FOUR_PI * ROOT_FOUR_PI / (bands * bands) as f32);
        if escape(k) <= NO_DIRECTIONS {
            variance += events * anywhere;
            continue;
        }
        let per_escape = 1.0 / escape(k);
        let there = spread(channels(k) * per_escape, contracted[k].w * per_escape);
        let mut known = there + ELSEWHERE * (anywhere - there);
        if k == last && k > 0 {
            let traded = continuation - slope * slopes[1];
            known += survival * per_escape * traded * traded;
        }
        variance += events * known;
    }
    Texel { rgb, variance, left_out }
}

fn sum(v: Vec3) -> f32 {
    v.x + v.y + v.z
}

/// ∂r/∂a_K and ∂r/∂S_{K+1}.
fn ratio_slopes(escapes: &[f32], ratio: f32) -> [f32; 2] {
    let survival = (1.0 - escapes.iter().sum::<f32>()).max(0.0);
    let falls = escapes.last().copied().unwrap_or(0.0).max(survival / 512.0);
    let per_all = 1.0 / (survival + falls);
    if ratio > 0.0 { [-survival * per_all * per_all, falls * per_all * per_all] } else { [0.0; 2] }
}

/// A texture of two bricks of noise around what surfaces have; a texel in `one_in` is valid.
fn noisy(bands: &[usize], one_in: u32) -> MemoryTexture {
    let layers = Layers::new(bands.to_vec()).unwrap();
    let lattice = Lattice::from_texels([16, 8, 8], [16, 8, 8]).unwrap();
    let mut texture = MemoryTexture::new(Layout { lattice, layers: layers.clone() });
    let (n, e) = (layers.coefficients(), layers.errors());
    for b in 0..2 {
        let mut brick = Brick::unbaked(&layers);
        for t in 0..BRICK_TEXELS {
            let random = |i: usize, what: u32| uniform(7 + b, t as u64, i as u32, what);
            if one_in > 1 && random(0, 9) * one_in as f32 >= 1.0 {
                // Without a level set, or never baked.
                let nothing = if t % 3 == 0 { f16::NAN } else { f16::ZERO };
                brick.transfer[t * n..(t + 1) * n].fill(nothing);
                brick.stderr[t * e..(t + 1) * e].fill(nothing);
                continue;
            }
            brick.validity[t] = validity::VALID;
            // From subnormal numbers to ones, of both signs; open, dark and half-open texels.
            let scale = [0.2, 1e-7, 1e-3][t % 3];
            for i in 0..n {
                brick.transfer[t * n + i] = f16::from_f32((random(i, 1) - 0.5) * scale);
            }
            for k in 0..layers.len() {
                let share = [0.28, 0.0, 1e-5, 0.1][(t / 3 + k) % 4];
                brick.transfer[t * n + layers.offset(k)] = f16::from_f32(share * random(k, 2) / (k + 1) as f32);
            }
            (0..e).for_each(|i| brick.stderr[t * e + i] = f16::from_f32(0.05 * random(i, 3)));
        }
        texture.insert([b as usize, 0, 0], brick).unwrap();
    }
    texture
}

/// The block by block contraction gives the bits of the texel by texel one, whatever the layers and however full the
/// blocks; so it does on every machine, since the twin has no variants.
#[test]
fn blocks_give_the_bits_of_single_texels() {
    let light = Light::new((0..25).map(|i| [0.9, 0.7, 0.4].map(|c| c / (1.0 + f64::from(i)).powi(2))).collect());
    let light = light.unwrap();
    for bands in [&[5, 5, 5, 5][..], &[5, 4, 3, 3], &[3, 2], &[2, 2, 1], &[4], &[1, 1]] {
        for (one_in, emission) in [(1, 0.0), (2, 0.3), (9, 0.0), (600, 0.3)] {
            let material = Material::new([0.9, 0.6, 1.0], [emission, 0.0, emission]).unwrap();
            let texture = noisy(bands, one_in);
            let layers = texture.layout().layers.clone();
            let weights = Weights::new(&layers, &light, &material);
            let bricks = [[0, 0, 0], [1, 0, 0]];
            let found = contract(&Textures::of_volume(&texture).unwrap(), &bricks, &light, &material).unwrap();
            let (n, e) = (layers.coefficients(), layers.errors());
            let (mut texels, mut squares, mut left_out) = (0, 0.0, 0.0f32);
            for (slot, index) in bricks.into_iter().enumerate() {
                let view = texture.brick(index).unwrap().unwrap();
                let mut of_brick = 0.0;
                for t in 0..BRICK_TEXELS {
                    let transfer: Vec<f32> = view.transfer[t * n..(t + 1) * n].iter().map(|v| v.to_f32()).collect();
                    let [r, g, b, stderr] = found.radiance[slot][t];
                    if view.validity[t] == 0 {
                        let expected = if transfer[0].is_nan() { UNBAKED } else { NO_LEVEL_SET };
                        assert_eq!([r, g, b, stderr], [0.0, 0.0, 0.0, expected]);
                        continue;
                    }
                    let twin = texel(&weights, &transfer, &view.stderr[t * e..(t + 1) * e], &layers);
                    assert_eq!(
                        [r, g, b, stderr].map(f32::to_bits),
                        [twin.rgb.x, twin.rgb.y, twin.rgb.z, twin.variance.sqrt()].map(f32::to_bits),
                        "{bands:?}, one in {one_in}, texel {t}: {:?} {:?}",
                        [r, g, b, stderr],
                        twin.rgb
                    );
                    (texels, left_out) = (texels + 1, left_out.max(twin.left_out));
                    of_brick += f64::from(twin.variance);
                }
                squares += of_brick;
            }
            assert_eq!((found.noise.texels, found.emission_remainder), (texels, left_out));
            assert_eq!(found.noise.rms, (squares / texels.max(1) as f64).sqrt());
        }
    }
}

/// What the processor turns, widens and sums is what the definitions do.
#[test]
#[cfg(target_arch = "x86_64")]
fn wide_registers_give_the_same_bits() {
    use super::block::{self, Column, LANES};
    use multiversion::{multiversion, target::match_target};
    #[multiversion(targets("x86_64+avx+avx2+f16c+fma+avx512f", "x86_64+avx+avx2+f16c+fma"))]
    fn same(stored: &[f16], n: usize, texels: &[usize; LANES], weights: &[Vec4]) -> bool {
        let [mut a, mut b]: [Vec<Column>; 2] = std::array::from_fn(|_| vec![[f16::ZERO; LANES]; n]);
        block::columns(stored, n, texels, &mut a);
        let bits = |sums: &[block::Lanes]| sums.iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>();
        let expected = [block::dot(&a, weights), std::array::from_fn(|i| block::widen(&a[i % n]))].map(|s| bits(&s));
        match_target! {
            "x86_64+avx+avx2+f16c+fma+avx512f" => {
                block::wide::columns(stored, n, texels, &mut b);
                let widened = std::array::from_fn(|i| block::wide::widen(&b[i % n]));
                let halves = bits(&block::wide::dot(&b, weights));
                a == b && halves == expected[0] && expected == [block::wide::dot_512(&b, weights), widened].map(|s| bits(&s))
            },
            "x86_64+avx+avx2+f16c+fma" => {
                block::wide::columns(stored, n, texels, &mut b);
                let widened = std::array::from_fn(|i| block::wide::widen(&b[i % n]));
                a == b && expected == [block::wide::dot(&b, weights), widened].map(|s| bits(&s))
            },
            _ => {
                b.clone_from(&a);
                a == b && expected.len() == 2
            },
        }
    }
    // Every finite f16, in rows shorter than eight, of eights, and between.
    let stored: Vec<f16> = (0..=u16::MAX).map(f16::from_bits).filter(|v| v.is_finite()).collect();
    for n in [1, 4, 7, 8, 9, 12, 15, 16, 17, 20, 100] {
        let weights: Vec<Vec4> = (0..n).map(|i| Vec4::new(1.0, 0.3, -0.1, 7.0) / (1.0 + i as f32)).collect();
        for first in (0..stored.len() / n - 2 * LANES).step_by(LANES) {
            let texels = std::array::from_fn(|j| first + j + j * j % 5);
            assert!(same(&stored, n, &texels, &weights), "rows of {n}, texels {texels:?}");
        }
    }
}
