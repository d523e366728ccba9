//! Evaluation of the basis: one kernel, used by an f64 form, an f32 form and a batched f32 form.
//!
//! With ρ^m cos mφ and ρ^m sin mφ as polynomials c_m, s_m in x and y, and the rest of the
//! normalised associated Legendre function, P̄_lm(z) = N_lm P_l^m(z)/(1−z²)^(m/2), as a polynomial
//! in z, the basis is Y_lm = P̄_lm c_m and Y_l,−m = P̄_lm s_m for m > 0, without trigonometry,
//! division or special cases at the poles:
//! * c_{m+1} = x c_m − y s_m, s_{m+1} = x s_m + y c_m, c_0 = 1, s_0 = 0;
//! * P̄_mm = constant, P̄_lm = a_lm z P̄_{l−1,m} − b_lm P̄_{l−2,m}, with
//!   a_lm² = (4l²−1)/(l²−m²) and b_lm² = (2l+1)((l−1)²−m²)/((2l−3)(l²−m²)).
//!
//! (The usual recurrence upward in l, stable for all m; see Sloan 2013, "Efficient Spherical
//! Harmonic Evaluation", JCGT 2(2). We use no code generation: the loops are unrolled by the
//! compiler for each band count.) The convention of signs and indices is in [`crate::sh`].
//!
//! The f32 forms agree with each other bit for bit: [`accumulate`] runs the operations of
//! [`evaluate_f32`] on four directions at a time, with no fused multiply-add. Measured (example
//! `measure-kernels`, one thread of a 2-core Xeon, baseline x86-64): 3.1 ns a direction at 5
//! bands in batches of 64, 3.9 in batches of 16; 1.1 at 3 bands, 16 at 11.

use super::{MAX_BANDS, index};
use glam::{Vec3, Vec4};
use std::ops::{Add, Mul, Sub};

/// Coefficients of `bands` bands.
pub const fn count(bands: usize) -> usize {
    bands * bands
}

/// Lanes of the batch: direction d of a batch is summed in lane d mod 4.
const LANES: usize = 4;

/// Square root in a constant: Newton's iteration, for arguments in [1/100, 100].
const fn constant_sqrt(x: f64) -> f64 {
    let mut root = 0.5 * (1.0 + x);
    let mut step = 0;
    while step < 40 {
        root = 0.5 * (root + x / root);
        step += 1;
    }
    root
}

/// P̄_mm, times sqrt(2) for m > 0 (the real basis): sqrt((2m+1)!!/(4π (2m)!!)).
const DIAGONAL: [f64; MAX_BANDS] = {
    let mut table = [0.0; MAX_BANDS];
    let mut product = 1.0 / (4.0 * std::f64::consts::PI);
    let mut m = 0;
    while m < MAX_BANDS {
        if m > 0 {
            product *= (2 * m + 1) as f64 / (2 * m) as f64;
        }
        table[m] = constant_sqrt(if m > 0 { 2.0 * product } else { product });
        m += 1;
    }
    table
};

/// a_lm and b_lm of the recurrence in l, for l > m.
const RECURRENCE: [[[f64; 2]; MAX_BANDS]; MAX_BANDS] = {
    let mut table = [[[0.0; 2]; MAX_BANDS]; MAX_BANDS];
    let mut l = 1;
    while l < MAX_BANDS {
        let mut m = 0;
        while m < l {
            let below = (l * l - m * m) as f64;
            table[l][m][0] = constant_sqrt((4 * l * l - 1) as f64 / below);
            if l >= m + 2 {
                let above = ((2 * l + 1) * ((l - 1) * (l - 1) - m * m)) as f64;
                table[l][m][1] = constant_sqrt(above / ((2 * l - 3) as f64 * below));
            }
            m += 1;
        }
        l += 1;
    }
    table
};

/// What the kernel computes with: a number, or several side by side.
trait Lane: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    fn constant(value: f64) -> Self;
}

impl Lane for f64 {
    #[inline(always)]
    fn constant(value: f64) -> Self {
        value
    }
}

impl Lane for f32 {
    #[inline(always)]
    fn constant(value: f64) -> Self {
        value as f32
    }
}

impl Lane for Vec4 {
    #[inline(always)]
    fn constant(value: f64) -> Self {
        Self::splat(value as f32)
    }
}

/// Hands weight·Y_i(x, y, z) to `sink(i, value)` for every coefficient of `BANDS` bands.
#[inline(always)]
fn kernel<T: Lane, const BANDS: usize>(x: T, y: T, z: T, weight: T, mut sink: impl FnMut(usize, T)) {
    column::<T, BANDS, 0>(z, weight, weight, &mut sink);
    let (mut cosine, mut sine) = (x * weight, y * weight);
    // Written out so that each order is compiled for itself: the compiler gives up unrolling the
    // double loop from 4 bands on, and looks constants up at run time.
    macro_rules! orders {
        ($($m:literal)*) => {$(
            if $m < BANDS {
                if $m > 1 {
                    (cosine, sine) = (x * cosine - y * sine, x * sine + y * cosine);
                }
                column::<T, BANDS, $m>(z, cosine, sine, &mut sink);
            }
        )*};
    }
    orders!(1 2 3 4 5 6 7 8 9 10);
}

/// The coefficients of orders ±`M`, all degrees, given c_M and s_M times the weight.
#[inline(always)]
fn column<T: Lane, const BANDS: usize, const M: usize>(z: T, cosine: T, sine: T, sink: &mut impl FnMut(usize, T)) {
    let mut before = T::constant(0.0);
    let mut legendre = T::constant(DIAGONAL[M]);
    for l in M..BANDS {
        if l > M {
            let [a, b] = RECURRENCE[l][M];
            let rising = T::constant(a) * z * legendre;
            let next = if l == M + 1 { rising } else { rising - T::constant(b) * before };
            (before, legendre) = (legendre, next);
        }
        sink(index(l, M as isize), legendre * cosine);
        if M > 0 {
            sink(index(l, -(M as isize)), legendre * sine);
        }
    }
}

/// Calls `$function::<BANDS>($arguments)` for the run-time band count `$bands`.
macro_rules! with_bands {
    ($bands:expr, $function:ident($($argument:expr),*)) => {
        match $bands {
            1 => $function::<1>($($argument),*),
            2 => $function::<2>($($argument),*),
            3 => $function::<3>($($argument),*),
            4 => $function::<4>($($argument),*),
            5 => $function::<5>($($argument),*),
            6 => $function::<6>($($argument),*),
            7 => $function::<7>($($argument),*),
            8 => $function::<8>($($argument),*),
            9 => $function::<9>($($argument),*),
            10 => $function::<10>($($argument),*),
            11 => $function::<11>($($argument),*),
            other => unreachable!("{other} bands; the basis has 1 to {MAX_BANDS}"),
        }
    };
}

/// All Y_lm(ω) with l < `bands` at the unit vector `direction`, written to `out[..bands²]`.
///
/// # Panics
/// When `bands` is 0 or above [`MAX_BANDS`], or `out` is shorter than `bands²`.
pub fn evaluate(bands: usize, direction: [f64; 3], out: &mut [f64]) {
    with_bands!(bands, evaluate_fixed(direction, out));
}

fn evaluate_fixed<const BANDS: usize>([x, y, z]: [f64; 3], out: &mut [f64]) {
    let out = &mut out[..BANDS * BANDS];
    kernel::<f64, BANDS>(x, y, z, 1.0, |i, value| out[i] = value);
}

/// [`evaluate`] in single precision: within 2e-6·(2l+1) of it for a unit vector.
///
/// # Panics
/// When `bands` is 0 or above [`MAX_BANDS`], or `out` is shorter than `bands²`.
pub fn evaluate_f32(bands: usize, direction: Vec3, out: &mut [f32]) {
    with_bands!(bands, evaluate_f32_fixed(direction, out));
}

fn evaluate_f32_fixed<const BANDS: usize>(direction: Vec3, out: &mut [f32]) {
    let out = &mut out[..BANDS * BANDS];
    kernel::<f32, BANDS>(direction.x, direction.y, direction.z, 1.0, |i, value| out[i] = value);
}

/// Adds Σ_d Y_i(ω_d) over the unit vectors `directions` to `sums[i]`, i < `bands²`.
///
/// The order of the sum is fixed: direction d goes to partial sum d mod 4, and the partial sums
/// p are added to `sums` as (p_0 + p_2) + (p_1 + p_3).
///
/// # Panics
/// When `bands` is 0 or above [`MAX_BANDS`], or `sums` is shorter than `bands²`.
pub fn accumulate(bands: usize, directions: &[Vec3], sums: &mut [f32]) {
    with_bands!(bands, accumulate_fixed(directions, |_| 1.0, sums));
}

/// Adds Σ_d w_d Y_i(ω_d) to `sums[i]`, in the order of [`accumulate`].
///
/// # Panics
/// As [`accumulate`], and when there are not as many weights as directions.
pub fn accumulate_weighted(bands: usize, directions: &[Vec3], weights: &[f32], sums: &mut [f32]) {
    assert_eq!(directions.len(), weights.len(), "one weight a direction");
    with_bands!(bands, accumulate_fixed(directions, |d| weights[d], sums));
}

fn accumulate_fixed<const BANDS: usize>(directions: &[Vec3], weight: impl Fn(usize) -> f32, sums: &mut [f32]) {
    let sums = &mut sums[..BANDS * BANDS];
    // Room for the largest band count; the compiler keeps only what BANDS touches.
    let mut partial = [Vec4::ZERO; MAX_BANDS * MAX_BANDS];
    let partial = &mut partial[..BANDS * BANDS];
    let mut blocks = directions.chunks_exact(LANES);
    let mut first = 0;
    for block in &mut blocks {
        let [a, b, c, d] = [block[0], block[1], block[2], block[3]];
        let weights = Vec4::new(weight(first), weight(first + 1), weight(first + 2), weight(first + 3));
        let (x, y, z) = (Vec4::new(a.x, b.x, c.x, d.x), Vec4::new(a.y, b.y, c.y, d.y), Vec4::new(a.z, b.z, c.z, d.z));
        kernel::<Vec4, BANDS>(x, y, z, weights, |i, value| partial[i] += value);
        first += LANES;
    }
    let rest = blocks.remainder();
    if !rest.is_empty() {
        // Lanes without a direction have weight 0 and add exactly nothing.
        let lane = |j: usize| rest.get(j).copied().unwrap_or(Vec3::Z);
        let [a, b, c, d] = std::array::from_fn(lane);
        let weights: [f32; LANES] = std::array::from_fn(|j| if j < rest.len() { weight(first + j) } else { 0.0 });
        let (x, y, z) = (Vec4::new(a.x, b.x, c.x, d.x), Vec4::new(a.y, b.y, c.y, d.y), Vec4::new(a.z, b.z, c.z, d.z));
        kernel::<Vec4, BANDS>(x, y, z, Vec4::from_array(weights), |i, value| partial[i] += value);
    }
    for (sum, p) in sums.iter_mut().zip(partial.iter()) {
        *sum += (p.x + p.z) + (p.y + p.w);
    }
}

#[cfg(test)]
mod tests;
