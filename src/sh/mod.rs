//! Real spherical harmonics: the basis, coefficients, projection, rotation, kernels.
//! Knows nothing of colour, images and volumes.
//!
//! # Convention (stated here, linked from everywhere else)
//! Real, orthonormal on the sphere, without the Condon-Shortley sign in the result:
//! Y_1,-1 = 0.488603 y, Y_1,0 = 0.488603 z, Y_1,1 = 0.488603 x. The coefficient of degree l and
//! order m has index i = l(l+1)+m. **degree** is l ≤ l_max; **bands** is the count n = l_max+1,
//! and n² is the number of coefficients. 1 ≤ n ≤ [`MAX_BANDS`].

pub mod basis;
pub mod certified;
pub mod coefficients;
pub mod kernel;
pub mod project;
pub mod rotation;

pub use coefficients::Coefficients;
pub use kernel::Window;
pub use rotation::Rotation;

/// Most bands that the basis is evaluated for (degree 10).
pub const MAX_BANDS: usize = 11;

/// Index of degree `l`, order `m` in a coefficient vector.
pub const fn index(l: usize, m: isize) -> usize {
    (l * (l + 1)).wrapping_add_signed(m)
}

/// A_l of the clamped cosine, ∫ (n·ω)⁺ Y_lm(ω) dω = A_l Y_lm(n), l = 0…10
/// (Ramamoorthi & Hanrahan 2001, "An efficient representation for irradiance environment
/// maps", eq. 8: values π, 2π/3, π/4, 0, −π/24, 0, π/64, 0, −π/128, 0, 7π/1536).
pub const CLAMPED_COSINE: [f64; MAX_BANDS] = {
    use std::f64::consts::PI;
    [PI, 2.0 * PI / 3.0, PI / 4.0, 0.0, -PI / 24.0, 0.0, PI / 64.0, 0.0, -PI / 128.0, 0.0, 7.0 * PI / 1536.0]
};
