//! Slow twins from the definition, planted cases, leaks, and everything that is meant to be equal
//! to the last bit.

mod cubics;
mod leaks;
mod march;
mod normals;
mod oracle;
mod rays;
mod shapes;
mod sites;
mod traversal;

use super::*;
use crate::geom::Affine;
use crate::volume::{Samples, Solid, with_samples};
use glam::DVec3;

/// A number in [0, 1) that is a pure function of (seed, item, dimension).
fn uniform(seed: u64, item: u64, dimension: u64) -> f64 {
    // The finaliser of SplitMix64 (Steele et al. 2014) over a Weyl sequence.
    let mut z = (seed << 48 ^ item << 8 ^ dimension).wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// A unit vector, uniform over the sphere.
fn on_sphere(seed: u64, item: u64) -> Vec3 {
    let z = 2.0 * uniform(seed, item, 100) - 1.0;
    let (sin, cos) = (std::f64::consts::TAU * uniform(seed, item, 101)).sin_cos();
    let r = (1.0 - z * z).sqrt();
    Vec3::new((r * cos) as f32, (r * sin) as f32, z as f32)
}

/// A volume of the given samples with spacing 1.
fn on_grid(dims: [usize; 3], samples: Samples) -> Volume {
    Volume::new(dims, samples, Affine::IDENTITY).unwrap()
}

/// Lattice points, x fastest, in [−1, 1]³.
fn lattice(dims: [usize; 3]) -> impl Iterator<Item = Vec3> {
    let at = move |i: usize, a: usize| 2.0 * i as f32 / (dims[a] - 1) as f32 - 1.0;
    (0..dims[0] * dims[1] * dims[2])
        .map(move |i| Vec3::new(at(i % dims[0], 0), at(i / dims[0] % dims[1], 1), at(i / dims[0] / dims[1], 2)))
}

/// A volume of `dims` float samples of `field` over [−1, 1]³.
fn floating(dims: [usize; 3], field: impl Fn(Vec3) -> f32) -> Volume {
    on_grid(dims, Samples::F32(lattice(dims).map(field).collect()))
}

/// The same in 8 bits, `field` given in steps.
fn bytes(dims: [usize; 3], field: impl Fn(Vec3) -> f32) -> Volume {
    let quantise = |p| field(p).round().clamp(0.0, 255.0) as u8;
    on_grid(dims, Samples::U8(lattice(dims).map(quantise).collect()))
}

/// A volume of `n`³ samples of `field` over [−1, 1]³, with world coordinates to match.
fn cube(n: usize, field: impl Fn(Vec3) -> f32) -> Volume {
    let spacing = 2.0 / (n - 1) as f64;
    let affine = Affine::from_spacing(DVec3::splat(spacing), DVec3::splat(-1.0)).unwrap();
    Volume::new([n; 3], Samples::F32(lattice([n; 3]).map(field).collect()), affine).unwrap()
}

fn floats(volume: &Volume) -> &[f32] {
    match volume.samples() {
        Samples::F32(s) => s,
        _ => unreachable!(),
    }
}

/// Runs `$body` with `$field` bound to the level field of a volume of any sample type.
macro_rules! with_field {
    ($volume:expr, $field:ident => $body:expr) => {{
        let pyramid = Pyramid::new(&$volume);
        with_samples!($volume.samples(), samples => {
            let $field = LevelField::new(&$volume, samples, &pyramid);
            $body
        })
    }};
}
use with_field;

/// Directions that tend to break marches: axes, diagonals, nearly those, and a spread of others.
fn directions() -> Vec<Vec3> {
    let mut all = Vec::new();
    for x in -1..=1 {
        for y in -1..=1 {
            for z in -1..=1 {
                if (x, y, z) != (0, 0, 0) {
                    all.push(Vec3::new(x as f32, y as f32, z as f32));
                }
            }
        }
    }
    all.push(Vec3::new(1.0, 1e-7, -1e-7));
    all.push(Vec3::new(-1e-20, 1.0, 1e-30));
    all.push(Vec3::new(1e-39, -1e-44, -1.0));
    all.push(Vec3::new(1.0, 1.0 + f32::EPSILON, -1.0));
    all.extend((0..200).map(|i| on_sphere(77, i)));
    all
}

/// The volumes every tracer is run over: smooth, 8-bit, noisy, ambiguous, flat, odd sizes.
fn gallery() -> Vec<(&'static str, Volume)> {
    let smooth = |p: Vec3| (3.0 * p.x).sin() * (2.5 * p.y).cos() + p.z * p.z - 0.3 * p.x * p.y;
    let noise = |seed: u64| {
        let mut i = 0u64;
        move || {
            i += 1;
            uniform(seed, i, 0) as f32
        }
    };
    let dims = [37, 22, 29];
    let count = dims.iter().product::<usize>();
    let (mut a, mut b) = (noise(1), noise(2));
    let checkers = (0..count).map(|i| ((i % 37 + i / 37 % 22 + i / 37 / 22) % 2) as f32).collect();
    let noisy = lattice(dims).map(|p| smooth(p) + 0.3 * a()).collect();
    let speckle = (0..count).map(|_| (b() * 6.0) as u8).collect();
    let mut below = floating([20, 70, 9], |p| -smooth(p * 1.5));
    below.solid = Solid::Below;
    vec![
        ("smooth", floating([40, 33, 35], smooth)),
        ("smooth below", below),
        ("8 bit", bytes([33, 33, 33], |p| 200.0 * p.length())),
        ("noisy", on_grid(dims, Samples::F32(noisy))),
        ("checkerboard", on_grid(dims, Samples::F32(checkers))),
        ("six values", on_grid(dims, Samples::U8(speckle))),
        ("plateaus", bytes([45, 30, 18], |p| (2.0 * smooth(p) + 2.0).floor())),
        ("offset", floating([26, 27, 28], |p| 1000.0 + smooth(p))),
    ]
}

/// A direction as the tracer takes it: largest component in [1, 2), tiny components 0.
fn as_traced(direction: Vec3) -> Vec3 {
    let mut d = direction;
    while d.abs().max_element() >= 2.0 {
        d *= 0.5;
    }
    while d.abs().max_element() < 1.0 {
        d *= 2.0;
    }
    Vec3::select(d.abs().cmplt(Vec3::splat(2f32.powi(-100))), Vec3::ZERO, d)
}

/// A start in the box of a field and an isovalue for it: lattice points, points on faces and
/// edges, points anywhere; on the surface or beside it.
fn any_start<T: Sample>(field: &LevelField<'_, T>, seed: u64, item: u64) -> (Start, f32) {
    let dims = field.dims();
    let kind = (uniform(seed, item, 0) * 8.0) as u32;
    let at: [f64; 3] = std::array::from_fn(|a| {
        let p = uniform(seed, item, 1 + a as u64) * (dims[a] - 1) as f64;
        // Bits of the kind: whether the coordinate is a whole number.
        if kind >> a & 1 == 1 { p.round() } else { p }
    });
    let mut point = field.locate(at);
    for a in 0..3 {
        // The same point, seen from the cell before.
        if point.local[a] == 0.0 && point.cell[a] > 0 && uniform(seed, item, 5 + a as u64) < 0.5 {
            point.local[a] = 1.0;
            point.cell[a] -= 1;
        }
    }
    let value = field.raw_value(&point);
    if uniform(seed, item, 9) < 0.7 {
        return (Start::on(point), value);
    }
    let (low, high) = field.corners(point.cell);
    let other =
        low.into_iter().chain(high).fold(value, |m, v| if uniform(seed, item, 10) < 0.5 { m.max(v) } else { m.min(v) });
    let t = uniform(seed, item, 11) as f32;
    (Start::beside(point), value + (other - value) * t)
}
