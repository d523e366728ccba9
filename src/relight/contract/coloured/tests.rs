use crate::relight::contract::{NO_LEVEL_SET, UNBAKED};
use crate::relight::{Light, LuminaireLight, Material, Textures, contract};
use crate::sampling::hash::uniform;
use crate::transfer::{BRICK_TEXELS, Brick, BrickSource, Lattice, Layers, Layout, MemoryTexture, validity};
use half::f16;

const ROOT_FOUR_PI: f32 = 3.544_907_7;
const BRICKS: [[usize; 3]; 2] = [[0, 0, 0], [1, 0, 0]];

/// A texture of two bricks whose texels, two of three valid, hold what `fill` writes.
fn texture(layers: &Layers, fill: impl Fn(usize, &mut [f32], &mut [f32])) -> MemoryTexture {
    let lattice = Lattice::from_texels([16, 8, 8], [16, 8, 8]).unwrap();
    let mut texture = MemoryTexture::new(Layout { lattice, layers: layers.clone() });
    let (n, e) = (layers.coefficients(), layers.errors());
    for (b, index) in BRICKS.into_iter().enumerate() {
        let mut brick = Brick::unbaked(layers);
        for t in 0..BRICK_TEXELS {
            let (mut transfer, mut stderr) = (vec![0.0; n], vec![0.0; e]);
            match t % 3 {
                0 if t % 2 == 0 => continue,
                0 => {}
                _ => {
                    brick.validity[t] = validity::VALID;
                    fill(BRICK_TEXELS * b + t, &mut transfer, &mut stderr);
                }
            }
            (0..n).for_each(|i| brick.transfer[t * n + i] = f16::from_f32(transfer[i]));
            (0..e).for_each(|i| brick.stderr[t * e + i] = f16::from_f32(stderr[i]));
        }
        texture.insert(index, brick).unwrap();
    }
    texture
}

fn random(t: usize, i: usize, what: u32) -> f32 {
    uniform(7, t as u64, i as u32, what)
}

fn light() -> Light {
    let falling = |i: u32| [0.9, 0.7, 0.4].map(|c| c / (1.0 + f64::from(i)).powi(2));
    Light::new((0..25).map(falling).collect()).unwrap()
}

/// Radiance texel by texel, as the formula of [`contract`] stands; the bits are those of every version before.
#[test]
fn radiance_is_that_of_the_definition_to_the_bit() {
    let factors = [[2.0, 1.0, 0.5], [0.25; 3]];
    for (bands, emitted) in [(&[5, 4, 3][..], 0.0), (&[2, 1], 0.3), (&[3], 0.5), (&[1, 1, 1, 1], 1.0)] {
        let layers = Layers::new(bands.to_vec()).unwrap().coloured();
        let of_group = Layers::uniform(bands.len(), 1).unwrap().coloured();
        let environment = texture(&layers, |t, transfer, stderr| {
            transfer.iter_mut().enumerate().for_each(|(i, v)| *v = random(t, i, 1) - 0.5);
            stderr.fill(0.01);
        });
        let group = |what: u32| {
            texture(&of_group, |t, transfer, stderr| {
                // Shares of every kind: falling, rising (cut at 1), and none.
                transfer.iter_mut().enumerate().for_each(|(i, v)| *v = (random(t, i, what) - 0.1).max(0.0));
                stderr.fill(0.01);
            })
        };
        let (emission, lamps) = (group(2), [group(3), group(4)]);
        let luminaires: Vec<LuminaireLight<'_>> =
            lamps.iter().zip(factors).map(|(texture, factor)| LuminaireLight { texture, factor }).collect();
        let (light, material) = (light(), Material::new([0.9, 0.6, 1.0], [emitted, 0.0, emitted]).unwrap());
        let textures = Textures::of_scene(&environment, &emission, &luminaires).unwrap();
        let found = contract(&textures, &BRICKS, &light, &material).unwrap();
        let mut texels = 0;
        for (slot, index) in BRICKS.into_iter().enumerate() {
            let views = [&environment, &emission, &lamps[0], &lamps[1]].map(|t| t.brick(index).unwrap().unwrap());
            let number = |v: f16| f64::from(v.to_f32());
            for t in 0..BRICK_TEXELS {
                let of_texel = found.radiance[slot][t];
                if views[0].validity[t] == 0 {
                    let mark = if t % 2 == 0 { UNBAKED } else { NO_LEVEL_SET };
                    assert_eq!(of_texel, [0.0, 0.0, 0.0, mark]);
                    continue;
                }
                texels += 1;
                for c in 0..3 {
                    let group = |g: usize, k: usize| number(views[g].transfer[(t * bands.len() + k) * 3 + c]);
                    let (rho, glow) = (f64::from(material.albedo[c]), f64::from(material.emission[c]));
                    let (mut sum, mut power, mut last) = (0.0, 1.0, 0.0);
                    for (k, b) in bands.iter().enumerate() {
                        power *= rho;
                        let first = t * layers.coefficients() + layers.offset(k) + c * b * b;
                        let mut brought = 0.0;
                        for i in 0..b * b {
                            let weight = (power * light.coefficients(k)[i][c]) as f32;
                            brought += number(views[0].transfer[first + i]) * f64::from(weight);
                        }
                        for (l, factor) in factors.iter().enumerate() {
                            brought += power * factor[c] * group(2 + l, k);
                        }
                        brought += glow * power * group(1, k);
                        sum += brought;
                        last = brought;
                    }
                    sum += glow;
                    if let Some(before) = bands.len().checked_sub(2) {
                        let (before, after) = (group(1, before), group(1, before + 1));
                        let again = rho * if before > 0.0 { (after / before).min(1.0) } else { 0.0 };
                        sum += if again < 1.0 { last * again / (1.0 - again) } else { 0.0 };
                    }
                    assert_eq!(of_texel[c].to_bits(), (sum as f32).to_bits(), "{bands:?} texel {t} channel {c}");
                }
            }
        }
        assert_eq!(found.noise.texels, texels);
    }
}

/// Grey transfer in three equal channels has the noise of grey transfer: they are one model. Cases are those in which the
/// the noise of a volume alone has nothing of the ratio of its tail, which scenes take from another group: one layer; nobody survives;
/// and nothing escapes in the last layer, while some survive it.
#[test]
fn equal_channels_have_the_noise_of_grey_transfer() {
    for (bands, shares) in [(&[5][..], [0.4, 0.0, 0.0]), (&[5, 4], [0.5, 0.625, 0.0]), (&[3, 2, 2], [0.5, 0.25, 0.0])] {
        let layers = Layers::new(bands.to_vec()).unwrap();
        let fill = |channels: usize| {
            let layers = layers.clone();
            move |t: usize, transfer: &mut [f32], stderr: &mut [f32]| {
                for (k, b) in layers.bands().iter().enumerate() {
                    for i in 0..channels * b * b {
                        let of_layer = i % (b * b);
                        // Small beside the share, as in transfer that is a mean of basis functions.
                        let value = 0.1 * shares[k] * (random(t, 100 * k + of_layer, 1) - 0.5);
                        transfer[channels * layers.offset(k) + i] =
                            if of_layer == 0 { shares[k] / ROOT_FOUR_PI } else { value };
                    }
                }
                stderr.iter_mut().enumerate().for_each(|(i, s)| *s = 0.05 * random(t, i, 2));
            }
        };
        let grey = texture(&layers, fill(1));
        let coloured = texture(&layers.clone().coloured(), fill(3));
        let survivors = (1.0 - shares.iter().sum::<f32>()).max(0.0);
        let emission = texture(&Layers::uniform(bands.len(), 1).unwrap().coloured(), |_, transfer, _| {
            let last = transfer.len() - 3;
            transfer[last..].fill(survivors);
        });
        let (light, material) = (light(), Material::new([0.9, 0.6, 1.0], [0.0; 3]).unwrap());
        let of_grey = contract(&Textures::of_volume(&grey).unwrap(), &BRICKS, &light, &material).unwrap();
        let textures = Textures::of_scene(&coloured, &emission, &[]).unwrap();
        let of_coloured = contract(&textures, &BRICKS, &light, &material).unwrap();
        let pairs = of_grey.radiance.iter().flatten().zip(of_coloured.radiance.iter().flatten());
        for (a, b) in pairs.filter(|(a, _)| a[3] > 0.0) {
            // S and 1 − a_0 are differences of stored numbers, of 11 bits: f16 rounds a share by 2⁻¹² of it, and
            // σ² is a difference too.
            assert!((a[3] - b[3]).abs() <= 2e-3 * a[3], "{bands:?}: {a:?} {b:?}");
        }
        assert!(of_grey.noise.rms > 0.0 && (of_coloured.noise.rms / of_grey.noise.rms - 1.0).abs() < 2e-3);
    }
}

/// The errors of luminaires, alone and beside those of the environment: variances add, each with its albedo and power.
#[test]
fn luminaires_add_their_variance() {
    let layers = Layers::new(vec![3, 2]).unwrap().coloured();
    let environment = texture(&layers, |t, transfer, stderr| {
        transfer.iter_mut().enumerate().for_each(|(i, v)| *v = 0.1 * random(t, i, 1));
        stderr.iter_mut().enumerate().for_each(|(i, v)| *v = 0.01 * random(t, i, 2));
    });
    let of_group = Layers::uniform(2, 1).unwrap().coloured();
    let emission = texture(&of_group, |_, transfer, _| transfer.copy_from_slice(&[0.5, 0.5, 0.5, 0.25, 0.25, 0.25]));
    let lamp = texture(&of_group, |t, transfer, stderr| {
        transfer.fill(0.25);
        stderr.iter_mut().enumerate().for_each(|(i, v)| *v = 0.02 * random(t, i, 3));
    });
    let factor = [2.0, 1.0, 0.0];
    let (light, material) = (light(), Material::new([0.9, 0.6, 1.0], [0.0; 3]).unwrap());
    let lit = |luminaires: &[LuminaireLight<'_>]| {
        let textures = Textures::of_scene(&environment, &emission, luminaires).unwrap();
        contract(&textures, &BRICKS, &light, &material).unwrap()
    };
    let (without, with) = (lit(&[]), lit(&[LuminaireLight { texture: &lamp, factor }]));
    for (slot, index) in BRICKS.into_iter().enumerate() {
        let stderr = lamp.brick(index).unwrap().unwrap().stderr;
        for t in (0..BRICK_TEXELS).filter(|t| t % 3 != 0) {
            let albedo = material.albedo.map(f64::from);
            // ρ/(1 − ρ/2) is what the tail repeats of the last layer, once included.
            let weight = |k: usize| -> f64 {
                let of = |c: usize| if k == 0 { albedo[c] } else { albedo[c].powi(2) / (1.0 - albedo[c] / 2.0) };
                (0..3).map(|c| factor[c] * of(c)).sum::<f64>() / 3.0
            };
            let of_lamp: f64 = (0..2).map(|k| (weight(k) * stderr[2 * t + k].to_f64()).powi(2)).sum();
            let [alone, both] = [&without, &with].map(|lit| f64::from(lit.radiance[slot][t][3]).powi(2));
            // Standard errors are rounded to 24 bits.
            assert!((both - alone - of_lamp).abs() <= 1e-6 * both, "{both} {alone} {of_lamp}");
        }
    }
}

/// Textures that do not belong together are refused.
#[test]
fn textures_of_different_scenes_are_refused() {
    let nothing = |_: usize, _: &mut [f32], _: &mut [f32]| {};
    let (grey, coloured) = (Layers::uniform(2, 2).unwrap(), Layers::uniform(2, 2).unwrap().coloured());
    let (grey, environment) = (texture(&grey, nothing), texture(&coloured, nothing));
    let group = |layers: usize| texture(&Layers::uniform(layers, 1).unwrap().coloured(), nothing);
    let (two, three) = (group(2), group(3));
    assert!(Textures::of_volume(&environment).is_err() && Textures::of_volume(&grey).is_ok());
    assert!(Textures::of_scene(&grey, &two, &[]).is_err());
    assert!(Textures::of_scene(&environment, &three, &[]).is_err());
    assert!(Textures::of_scene(&environment, &environment, &[]).is_err());
    let lamp = LuminaireLight { texture: &three, factor: [1.0; 3] };
    assert!(Textures::of_scene(&environment, &two, &[lamp]).is_err());
    assert!(Textures::of_scene(&environment, &two, &[]).is_ok());
}
