//! The whole error of a lit surface, from check points: what is looked up there against what their paths found, under the
//! light at hand, without a ray.
//!
//! At a check point i the radiance looked up is R_i, that of the two independent halves of its transfer A_i and B_i. The mean
//! square of the error of R is that of R − (A + B)/2 less that of (A − B)/2, the noise of the check: no assumption about either
//! enters. Of it the stated noise of the lookup is taken off; what is left is the *texture*: what lies between texels, or
//! between the vertices of a triangle.
//!
//! *Noise* as stores state it is right in the mean over lights, not for each: edges of what is visible lie where the anatomy has
//! them, and a light that is brightest there picks more of the noise. The halves of a check point tell how much: the mean square
//! of (A − B)/2 under the light, over what the same model of noise says of them by the standard errors that their
//! difference has in each band. The stated variance is multiplied with that ratio. (purkinje_neuron at 45, 1024 rays a vertex:
//! measured 1.33 of what is stated without it under the courtyard, 0.97 to 1.03 under random lights.)
//!
//! *Truncation* is what the light above the band limit brings. Each path that escaped along ω after k reflections brings
//! ρ^(k+1) (L(ω) − L_k(ω)), L the image blurred to about the spacing of the directions and L_k what layer k sees of it. The mean
//! over a half of the paths is W_i or W'_i, and the mean of W W' estimates the mean square of the truth without the noise of
//! either. What the blur takes away is not seen: edges of shadows sharper than it.
//!
//! Mean squares are over points and channels, errors relative to the mean radiance of the surface.

use super::{Light, Material, Tail, Textures, contract};
use crate::sampling::statistics::{POOLED_BANDS, normal_two_sided};
use crate::sh::{self, MAX_BANDS};
use crate::transfer::checks::{CheckPoints, of_escape};
use crate::transfer::{BRICK_TEXELS, Brick, Lattice, Layers, Layout, MemoryTexture, validity};
use glam::Vec3;
use half::f16;
use rayon::prelude::*;

/// A part of an error: root mean square over points and channels, over the mean radiance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorTerm {
    /// The root mean square; 0 where the estimate of the mean square is below 0.
    pub rms: f64,
    /// How far a 95 % interval of it reaches up: the estimate comes from a number of points.
    pub upper: f64,
}

/// How far the colours of a surface are from exact light transport on it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct TotalError {
    /// Root mean square over the vertices and channels, over the mean radiance: of noise and truncation, and of the texture
    /// where transfer is looked up in one.
    pub rms: f64,
    /// 95 % of the errors are smaller than this, over the mean radiance.
    pub percentile_95: f64,
    /// Noise of the bake, and of the rays to lamps that are lit apart.
    pub noise: ErrorTerm,
    /// What lies between texels; between vertices where these have transfer of their own, and then no part of [`Self::rms`].
    pub texture: ErrorTerm,
    /// What the light above the band limit brings; `None` where no path says it: among walls, or in older stores.
    pub truncation: Option<ErrorTerm>,
    /// Check points that it comes from.
    pub points: usize,
}

/// What is held against check points.
pub struct Lookups<'a> {
    /// Radiance looked up at each check point.
    pub radiance: &'a [[f32; 3]],
    /// Its stated standard errors, of the mean of the channels.
    pub errors: &'a [f32],
    /// Root mean square of the stated standard errors at the vertices, of the mean of the channels.
    pub vertex_noise: f64,
    /// Root mean square over vertices and channels of the noise of lamps that are lit apart; it is in no lookup.
    pub lamp_noise: f64,
    /// Mean radiance of the vertices.
    pub mean: f64,
    /// Whether the vertices have transfer of their own.
    pub at_vertices: bool,
}

/// The parts of the transfer vector of a check point in a scene: of luminaires the factors on what is stored.
pub struct Scene {
    /// One a luminaire, in their order.
    pub luminaires: Vec<[f64; 3]>,
}

/// The light as an image: what a path sees that escapes along a direction in world.
pub type Seen<'a> = dyn Fn(Vec3) -> [f32; 3] + Sync + 'a;

/// Estimates the error; `None` where there are fewer than two points, the surface is black, or points and lookups do not belong
/// together. `scene`: of a volume alone none; `seen`: the image, where truncation is wanted.
pub fn total_error(
    layers: &Layers,
    checks: &CheckPoints,
    lookups: &Lookups<'_>,
    (light, material): (&Light, &Material),
    scene: Option<&Scene>,
    seen: Option<&Seen<'_>>,
) -> Option<TotalError> {
    let (count, n) = (checks.len().min(lookups.radiance.len()), checks.coefficients());
    let mean = lookups.mean;
    let groups = scene.map_or(0, |scene| 3 * layers.len() * (1 + scene.luminaires.len()));
    let is_whole = checks.check().is_ok() && n == layers.coefficients() + groups && lookups.errors.len() >= count;
    if count < 2 || mean.is_nan() || mean <= 0.0 || !is_whole {
        return None;
    }
    // Per point: mean squares of the error over channels, of the error of their mean, and of the noise of the check.
    let of_point = |i: usize| -> [f64; 3] {
        let [a, b] = [0, 1].map(|h| {
            let vector = &checks.halves[h][i * n..(i + 1) * n];
            radiance_of(layers, vector, light, material, scene)
        });
        let found = lookups.radiance[i].map(f64::from);
        let error: [f64; 3] = std::array::from_fn(|c| found[c] - 0.5 * (a[c] + b[c]));
        let half: [f64; 3] = std::array::from_fn(|c| 0.5 * (a[c] - b[c]));
        let square = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>() / 3.0;
        let of_mean = |v: [f64; 3]| (v.iter().sum::<f64>() / 3.0).powi(2);
        [square(error) - square(half), of_mean(error) - of_mean(half), square(half)]
    };
    let squares: Vec<[f64; 3]> = (0..count).into_par_iter().map(of_point).collect();
    let [all, of_mean, of_check] = [0, 1, 2].map(|k| squares.iter().map(|s| s[k]).sum::<f64>() / count as f64);
    let picked = match scene {
        None => {
            let modelled = modelled_noise(layers, checks, (light, material))?;
            if modelled > 0.0 && modelled.is_finite() { of_check / modelled } else { 1.0 }
        }
        // Noise of coloured light is larger in its channels than in their mean.
        Some(_) if of_mean > 0.0 => (all / of_mean).clamp(1.0, 3.0),
        Some(_) => 1.0,
    };
    let stated: Vec<f64> = lookups.errors[..count].iter().map(|&e| picked * f64::from(e).powi(2)).collect();
    let between: Vec<f64> = squares.iter().zip(&stated).map(|(s, noise)| s[0] - noise).collect();
    let texture = term(&between, mean);
    let noise_square = picked * lookups.vertex_noise.powi(2) + lookups.lamp_noise.powi(2);
    let noise = ErrorTerm { rms: noise_square.sqrt() / mean, upper: noise_square.sqrt() / mean };
    let cut: Option<Vec<f64>> = seen.filter(|_| checks.paths >= 2).map(|seen| {
        let each = (0..count).into_par_iter().map(|i| truncation_at(checks, i, (layers, light, material), seen));
        each.collect()
    });
    let truncation = cut.as_ref().map(|cut| term(cut, mean));
    let square = |term: ErrorTerm| term.rms.powi(2);
    let of_texture = if lookups.at_vertices { 0.0 } else { square(texture) };
    let rms = (square(noise) + of_texture + truncation.map_or(0.0, square)).sqrt();
    // A normal error at each point, of its own variance.
    let stated_mean = stated.iter().sum::<f64>() / count as f64;
    let scale = if stated_mean > 0.0 { noise_square / stated_mean } else { 0.0 };
    let (between, cut) = (spread_of(&between), cut.map(|cut| spread_of(&cut)));
    let variances: Vec<f64> = (0..count)
        .map(|i| {
            let of_texture = if lookups.at_vertices { 0.0 } else { between[i] };
            (stated[i] * scale + of_texture + cut.as_ref().map_or(0.0, |cut| cut[i])) / (mean * mean)
        })
        .collect();
    Some(TotalError { rms, percentile_95: percentile_95(&variances), noise, texture, truncation, points: count })
}

/// Mean variance of the radiance of check points (mean of the channels), as the model of the noise has it by the standard errors that the
/// halves of their transfer have in each band.
fn modelled_noise(layers: &Layers, checks: &CheckPoints, (light, material): (&Light, &Material)) -> Option<f64> {
    let (n, errors) = (layers.coefficients(), layers.errors());
    let lattice = Lattice::of_vertices(checks.len());
    let mut texture = MemoryTexture::new(Layout { lattice, layers: layers.clone() });
    let half = |i: usize, j: usize, sign: f32| 0.5 * (checks.halves[0][i * n + j] + sign * checks.halves[1][i * n + j]);
    let bricks: Vec<[usize; 3]> = (0..checks.len().div_ceil(BRICK_TEXELS)).map(|b| [b, 0, 0]).collect();
    for brick in &bricks {
        let mut filled = Brick::unbaked(layers);
        for t in 0..BRICK_TEXELS.min(checks.len() - brick[0] * BRICK_TEXELS) {
            let i = brick[0] * BRICK_TEXELS + t;
            filled.validity[t] = validity::VALID;
            for j in 0..n {
                filled.transfer[t * n + j] = f16::from_f32(half(i, j, 1.0));
            }
            for (k, &bands) in layers.bands().iter().enumerate() {
                for l in 0..bands {
                    let range = if l == 0 { 0..bands.min(POOLED_BANDS).pow(2) } else { l * l..(l + 1) * (l + 1) };
                    let count = range.len() as f32;
                    let square: f32 = range.map(|j| half(i, layers.offset(k) + j, -1.0).powi(2)).sum();
                    filled.stderr[t * errors + layers.error_offset(k) + l] = f16::from_f32((square / count).sqrt());
                }
            }
        }
        texture.insert(*brick, filled).ok()?;
    }
    let contracted = contract(&Textures::of_volume(&texture).ok()?, &bricks, light, material).ok()?;
    Some(contracted.noise.rms.powi(2))
}

/// Root of the mean of squares that may be negative, over the mean radiance, and how far a 95 % interval of it reaches.
fn term(squares: &[f64], mean: f64) -> ErrorTerm {
    let n = squares.len() as f64;
    let average = squares.iter().sum::<f64>() / n;
    let spread = squares.iter().map(|s| (s - average).powi(2)).sum::<f64>() / (n * (n - 1.0));
    let root = |square: f64| square.max(0.0).sqrt() / mean;
    // Many points: the normal quantile.
    ErrorTerm { rms: root(average), upper: root(average + 1.96 * spread.sqrt()) }
}

/// Estimates of squares without those below 0, and with the mean of all of them: how large they are from point to point.
fn spread_of(squares: &[f64]) -> Vec<f64> {
    let (all, above) = (squares.iter().sum::<f64>(), squares.iter().map(|s| s.max(0.0)).sum::<f64>());
    let factor = if above > 0.0 { all.max(0.0) / above } else { 0.0 };
    squares.iter().map(|s| s.max(0.0) * factor).collect()
}

/// What is smaller in size than 95 % of numbers drawn from normal distributions of these variances, each as often.
fn percentile_95(variances: &[f64]) -> f64 {
    let most = variances.iter().copied().fold(0.0, f64::max).sqrt();
    let above = |q: f64| {
        let of = |v: &f64| if *v > 0.0 { normal_two_sided(q / v.sqrt()) } else { 0.0 };
        variances.iter().map(of).sum::<f64>() / variances.len() as f64
    };
    let (mut low, mut high) = (0.0, 8.0 * most);
    for _ in 0..48 {
        let middle = 0.5 * (low + high);
        (low, high) = if above(middle) > 0.05 { (middle, high) } else { (low, middle) };
    }
    high
}

/// The product of what each half of the paths of a check point finds above the band limit, mean over the channels.
fn truncation_at(
    checks: &CheckPoints,
    i: usize,
    (layers, light, material): (&Layers, &Light, &Material),
    seen: &Seen<'_>,
) -> f64 {
    let paths = checks.paths as usize;
    let codes = &checks.escapes[i * paths..(i + 1) * paths];
    let half = |codes: &[u32]| -> [f64; 3] {
        let mut sum = [0.0f64; 3];
        for (direction, k) in codes.iter().filter_map(|&code| of_escape(code)).filter(|(_, k)| *k < layers.len()) {
            let (image, limited) = (seen(direction), limited(layers, light, direction, k));
            for c in 0..3 {
                let power = material.factor(k, c);
                sum[c] += power * (f64::from(image[c]) - limited[c]);
            }
        }
        sum.map(|v| v / codes.len().max(1) as f64)
    };
    let (first, second) = codes.split_at(paths / 2);
    let [first, second] = [half(first), half(second)];
    first.iter().zip(second).map(|(a, b)| a * b).sum::<f64>() / 3.0
}

/// What layer k sees from a direction.
fn limited(layers: &Layers, light: &Light, direction: Vec3, k: usize) -> [f64; 3] {
    let bands = layers.bands()[k].min(light.used_bands(k));
    let mut basis = [0.0f32; MAX_BANDS * MAX_BANDS];
    sh::basis::evaluate_f32(bands, direction, &mut basis);
    let mut sum = [0.0; 3];
    for (rgb, y) in light.coefficients(k).iter().zip(&basis[..bands * bands]) {
        (0..3).for_each(|c| sum[c] += rgb[c] * f64::from(*y));
    }
    sum
}

/// Radiance of a transfer vector, as the definitions stand: of a volume alone the layers, emission by the chances to escape,
/// and the tail; in a scene those of its groups one behind the other.
fn radiance_of(layers: &Layers, vector: &[f32], light: &Light, material: &Material, scene: Option<&Scene>) -> [f64; 3] {
    let product = |k: usize, c: usize| -> f64 {
        let square = layers.bands()[k].pow(2);
        let of_channel = if layers.channels() == 1 { 0 } else { c * square };
        let transfer = &vector[layers.offset(k) + of_channel..][..square];
        transfer.iter().zip(light.coefficients(k)).map(|(&t, l)| f64::from(t) * l[c]).sum()
    };
    let power = |k: usize, c: usize| material.factor(k, c);
    let last = layers.len() - 1;
    let Some(scene) = scene else {
        let root_four_pi = 2.0 * std::f32::consts::PI.sqrt();
        let escapes: Vec<f32> = (0..layers.len()).map(|k| root_four_pi * vector[layers.offset(k)]).collect();
        let tail = Tail::new(&escapes);
        return std::array::from_fn(|c| {
            let sum: f64 = (0..layers.len()).map(|k| power(k, c) * product(k, c)).sum();
            let beyond = if last > 0 {
                power(last, c) * product(last, c) * f64::from(tail.gain(material.albedo[c]))
            } else {
                0.0
            };
            let emitted = f64::from(material.emission[c]) * f64::from(tail.emission(&escapes, material.albedo[c]).0);
            sum + beyond + if material.emission[c] > 0.0 { emitted } else { 0.0 }
        });
    };
    // Emission, then the luminaires: three numbers a layer each.
    let group = |g: usize, k: usize, c: usize| -> f64 {
        vector.get(layers.coefficients() + (g * layers.len() + k) * 3 + c).map_or(0.0, |&v| f64::from(v))
    };
    std::array::from_fn(|c| {
        let emitted = f64::from(material.emission[c]);
        let of_layer = |k: usize| {
            let near: f64 = scene.luminaires.iter().enumerate().map(|(l, factor)| factor[c] * group(1 + l, k, c)).sum();
            power(k, c) * (product(k, c) + near + emitted * group(0, k, c))
        };
        let sum: f64 = emitted + (0..layers.len()).map(of_layer).sum::<f64>();
        let Some(before) = last.checked_sub(1) else { return sum };
        let (before, met) = (group(0, before, c), group(0, last, c));
        let again = f64::from(u8::from(material.has_tail()))
            * f64::from(material.albedo[c])
            * if before > 0.0 { (met / before).min(1.0) } else { 0.0 };
        sum + if again < 1.0 { of_layer(last) * again / (1.0 - again) } else { 0.0 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::hash::uniform;
    use crate::sampling::warp;
    use crate::transfer::checks::escape;

    /// A standard normal number, by the sum of twelve uniform ones.
    fn normal(i: usize, what: u32) -> f64 {
        (0..12).map(|d| f64::from(uniform(9, i as u64, what, d))).sum::<f64>() - 6.0
    }

    #[test]
    fn the_terms_are_those_that_were_put_in() {
        // One layer of one band, white light of radiance 1, albedo 1: radiance is sqrt(4π) T.
        let layers = Layers::uniform(1, 1).unwrap();
        let (light, material) = (Light::constant([1.0; 3]), Material::new([1.0; 3], [0.0; 3]).unwrap());
        let count = 4000;
        let (truth, check, noise, texture) = (1.0, 0.02, 0.03, 0.05);
        let t = |radiance: f64| (radiance / (2.0 * std::f64::consts::PI.sqrt())) as f32;
        let half = |h: u32| (0..count).map(|i| t(truth + check * normal(i, h))).collect();
        let checks = CheckPoints {
            positions_in_grid: vec![[0.0; 3]; count],
            normals: vec![[0.0, 0.0, 1.0]; count],
            isovalues: vec![0.0; count],
            halves: [half(0), half(1)],
            ..CheckPoints::default()
        };
        let radiance: Vec<[f32; 3]> =
            (0..count).map(|i| [(truth + noise * normal(i, 2) + texture * normal(i, 3)) as f32; 3]).collect();
        let errors = vec![noise as f32; count];
        for at_vertices in [false, true] {
            let lookups = Lookups {
                radiance: &radiance,
                errors: &errors,
                vertex_noise: noise,
                lamp_noise: 0.0,
                mean: truth,
                at_vertices,
            };
            let found = total_error(&layers, &checks, &lookups, (&light, &material), None, None).unwrap();
            // A mean square of n numbers is known to sqrt(2/n), here 2.2 %; four of that, half of it in the root.
            assert!(
                (found.texture.rms / texture - 1.0).abs() < 0.07 && found.texture.upper > found.texture.rms,
                "{found:?}"
            );
            let all = if at_vertices { noise } else { (noise * noise + texture * texture).sqrt() };
            assert!((found.rms / all - 1.0).abs() < 0.07, "{found:?}");
            if at_vertices {
                assert!((found.percentile_95 / (1.96 * noise) - 1.0).abs() < 0.01, "{found:?}");
            }
        }
    }

    #[test]
    fn noise_counts_as_much_as_the_light_picks_of_it() {
        // All of the noise of band 1 is in one of its three coefficients. Its variance v is taken for (v/4 + 3 v/3)/4 of each, since the four of
        // both bands are pooled and that of band 0 is their mean: 5/16 v. So light in that one picks 16/5, light in all three 16/15 of what is
        // stated. Nothing is seen in the mean, so that no direction is known of the noise.
        let layers = Layers::uniform(1, 2).unwrap();
        let material = Material::new([1.0; 3], [0.0; 3]).unwrap();
        let (count, noise) = (64, 0.02);
        let half = |sign: f32| (0..count).flat_map(|_| [0.0, 0.0, sign * 0.01, 0.0]).collect();
        let checks = CheckPoints {
            positions_in_grid: vec![[0.0; 3]; count],
            normals: vec![[0.0, 0.0, 1.0]; count],
            isovalues: vec![0.0; count],
            halves: [half(1.0), half(-1.0)],
            ..CheckPoints::default()
        };
        let (radiance, errors) = (vec![[1.0; 3]; count], vec![noise as f32; count]);
        let lookups = Lookups {
            radiance: &radiance,
            errors: &errors,
            vertex_noise: noise,
            lamp_noise: 0.0,
            mean: 1.0,
            at_vertices: true,
        };
        for (light, ratio) in [([0.0, 0.0, 1.0, 0.0], 3.2), ([0.0, 1.0, 1.0, 1.0], 16.0 / 15.0)] {
            let light = Light::new(light.iter().map(|&l| [l; 3]).collect()).unwrap();
            let found = total_error(&layers, &checks, &lookups, (&light, &material), None, None).unwrap();
            // 16 bits: 2^-11 of each standard error.
            assert!((found.noise.rms / (noise * f64::sqrt(ratio)) - 1.0).abs() < 2e-3, "{found:?}");
        }
    }

    #[test]
    fn truncation_is_what_the_image_has_above_the_bands() {
        // Every path escapes at once, along cosine-distributed directions; the image is 1 + z², of which one band keeps a
        // mean of 4/3. A surface that looks up sees ∫ (1 + z²) 2 z dz = 3/2: 1/6 more, whatever the blur.
        let layers = Layers::uniform(1, 1).unwrap();
        let light = Light::constant([4.0 / 3.0; 3]);
        let material = Material::new([1.0; 3], [0.0; 3]).unwrap();
        let (count, paths) = (64, 1024usize);
        let escapes = (0..count * paths).map(|i| {
            let place = [uniform(3, i as u64, 0, 0), uniform(3, i as u64, 0, 1)];
            escape(warp::square_to_cosine_hemisphere(place), 0)
        });
        let t = (4.0 / 3.0 / (2.0 * std::f64::consts::PI.sqrt())) as f32;
        let checks = CheckPoints {
            positions_in_grid: vec![[0.0; 3]; count],
            normals: vec![[0.0, 0.0, 1.0]; count],
            isovalues: vec![0.0; count],
            halves: [vec![t; count], vec![t; count]],
            paths: paths as u32,
            escapes: escapes.collect(),
        };
        let radiance = vec![[4.0f32 / 3.0; 3]; count];
        let errors = vec![0.0; count];
        let lookups = Lookups {
            radiance: &radiance,
            errors: &errors,
            vertex_noise: 0.0,
            lamp_noise: 0.0,
            mean: 4.0 / 3.0,
            at_vertices: true,
        };
        let seen = |direction: Vec3| [1.0 + direction.z * direction.z; 3];
        let found = total_error(&layers, &checks, &lookups, (&light, &material), None, Some(&seen)).unwrap();
        // 65,536 directions of a deviation of 0.29: 0.0011, four of which over the mean.
        let cut = found.truncation.unwrap();
        assert!((cut.rms - (1.0 / 6.0) / (4.0 / 3.0)).abs() < 4.0 * 0.0011 * 0.75, "{found:?}");
        assert!((found.rms - cut.rms).abs() < 1e-5, "{found:?}");
    }
}
