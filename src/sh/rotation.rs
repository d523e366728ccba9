//! Rotation of real spherical harmonics: one orthogonal block a band.

use super::{Coefficients, MAX_BANDS};
use crate::error::{Error, Result};
use glam::DMat3;

/// How far from orthogonal a matrix may be and still be taken for a rotation (and made
/// orthogonal): room for a rotation that went through single precision, far below a shear.
const ORTHOGONALITY: f64 = 1e-5;

/// The rotation of functions on the sphere that belongs to a rotation R of space:
/// (Rf)(ω) = f(R⁻¹ω), so that a feature of f at direction d comes to R d.
///
/// Blocks by the recurrence of Ivanic & Ruedenberg 1996 ("Rotation Matrices for Real Spherical
/// Harmonics. Direct Determination by Recursion", J. Phys. Chem. 100, eqs. 8.1–8.9) with the
/// corrections of 1998 (J. Phys. Chem. A 102, 9099: tables 1 and 2). It starts from the matrix
/// itself and has no angles, so the poles are not special. 1e-12 to degree 10.
#[derive(Clone, Debug, PartialEq)]
pub struct Rotation {
    // Invariant: blocks[l] is orthogonal, (2l+1)² entries, row-major, rows and columns from
    // order −l; 1 ≤ blocks.len() ≤ MAX_BANDS.
    blocks: Vec<Vec<f64>>,
}

/// A block under construction, addressed by orders.
struct Block<'a> {
    l: isize,
    entries: &'a [f64],
}

impl Block<'_> {
    fn at(&self, m: isize, n: isize) -> f64 {
        self.entries[((m + self.l) * (2 * self.l + 1) + n + self.l) as usize]
    }
}

impl Rotation {
    /// The rotation by `matrix` for functions of up to `bands` bands.
    ///
    /// # Errors
    /// When `bands` is not in 1…[`MAX_BANDS`], or the matrix is not a rotation: mirrored, or
    /// not orthogonal within 1e-5. Smaller deviations are removed first.
    pub fn new(bands: usize, matrix: &DMat3) -> Result<Self> {
        if !(1..=MAX_BANDS).contains(&bands) {
            return Err(Error::argument(
                "bands",
                bands,
                format!("1 to {MAX_BANDS}"),
                "5 bands (degree 4) serve most uses",
            ));
        }
        let matrix = nearest_rotation(matrix)?;
        let mut blocks = vec![vec![1.0]];
        if bands > 1 {
            // Orders −1, 0, 1 are y, z, x.
            let axis = [1, 2, 0];
            blocks.push((0..9).map(|i| matrix.col(axis[i % 3])[axis[i / 3]]).collect());
        }
        for l in 2..bands {
            let next = {
                let first = Block { l: 1, entries: &blocks[1] };
                let before = Block { l: l as isize - 1, entries: &blocks[l - 1] };
                next_block(l as isize, &first, &before)
            };
            blocks.push(next);
        }
        Ok(Self { blocks })
    }

    /// Number of bands it can rotate.
    pub fn bands(&self) -> usize {
        self.blocks.len()
    }

    /// The block of degree `l`, row-major, (2l+1)² entries: rotated_m = Σ_n block[m, n] value_n.
    ///
    /// # Panics
    /// When `l` is not below [`bands`](Self::bands).
    pub fn block(&self, l: usize) -> &[f64] {
        &self.blocks[l]
    }

    /// The rotated function.
    ///
    /// # Panics
    /// When the function has more bands than the rotation.
    pub fn apply(&self, function: &Coefficients) -> Coefficients {
        let mut rotated = Coefficients::zero(function.bands());
        self.apply_slice(function.values(), rotated.values_mut());
        rotated
    }

    /// Rotates the coefficients `from` into `to`, both of n² entries with n ≤ [`bands`](Self::bands).
    ///
    /// # Panics
    /// When the lengths differ, are no square or are too large.
    pub fn apply_slice(&self, from: &[f64], to: &mut [f64]) {
        let bands = from.len().isqrt();
        assert!(bands * bands == from.len() && from.len() == to.len(), "{} to {} coefficients", from.len(), to.len());
        assert!(bands <= self.bands(), "{bands} bands, the rotation has {}", self.bands());
        for l in 0..bands {
            let (width, band) = (2 * l + 1, l * l..(l + 1) * (l + 1));
            for (row, rotated) in self.blocks[l].chunks_exact(width).zip(&mut to[band.clone()]) {
                *rotated = row.iter().zip(&from[band.clone()]).map(|(r, v)| r * v).sum();
            }
        }
    }
}

fn nearest_rotation(matrix: &DMat3) -> Result<DMat3> {
    let refuse = |found: String| {
        Error::argument(
            "rotation",
            found,
            "an orthogonal matrix with determinant 1",
            "mirrored and sheared frames cannot rotate a function; take the mirror out first",
        )
    };
    if !matrix.is_finite() {
        return Err(refuse("a matrix that is not finite".into()));
    }
    let excess = *matrix * matrix.transpose() - DMat3::IDENTITY;
    let worst = excess.to_cols_array().into_iter().fold(0.0_f64, |a, b| a.max(b.abs()));
    if worst > ORTHOGONALITY {
        return Err(refuse(format!("a matrix off orthogonal by {worst:.3e}")));
    }
    if matrix.determinant() < 0.0 {
        return Err(refuse("a mirrored matrix (determinant -1)".into()));
    }
    // Newton's iteration for the polar factor, quadratic: 1e-5, 1e-10, 1e-20.
    let mut rotation = *matrix;
    for _ in 0..3 {
        rotation = rotation * 1.5 - rotation * (rotation.transpose() * rotation) * 0.5;
    }
    Ok(rotation)
}

/// P of table 2: products of an entry of degree 1 and entries of degree l − 1.
fn product(i: isize, l: isize, m: isize, n: isize, first: &Block, before: &Block) -> f64 {
    if n == l {
        first.at(i, 1) * before.at(m, l - 1) - first.at(i, -1) * before.at(m, 1 - l)
    } else if n == -l {
        first.at(i, 1) * before.at(m, 1 - l) + first.at(i, -1) * before.at(m, l - 1)
    } else {
        first.at(i, 0) * before.at(m, n)
    }
}

fn next_block(l: isize, first: &Block, before: &Block) -> Vec<f64> {
    let p = |i: isize, m: isize, n: isize| product(i, l, m, n, first, before);
    let mut entries = Vec::with_capacity(((2 * l + 1) * (2 * l + 1)) as usize);
    for m in -l..=l {
        for n in -l..=l {
            let whole = if n.abs() == l { 2 * l * (2 * l - 1) } else { (l + n) * (l - n) } as f64;
            let size = m.abs();
            let mut entry = 0.0;
            // u, v, w of table 1 times U, V, W of table 2; each only where its factor is not 0,
            // because the others would reach outside the block before.
            if size < l {
                entry += (((l + m) * (l - m)) as f64 / whole).sqrt() * p(0, m, n);
            }
            if m == 0 {
                let v = -0.5 * ((2 * (l - 1) * l) as f64 / whole).sqrt();
                entry += v * (p(1, 1, n) + p(-1, -1, n));
            } else {
                let v = 0.5 * (((l + size - 1) * (l + size)) as f64 / whole).sqrt();
                let (kept, dropped_at_one) =
                    if m > 0 { (p(1, m - 1, n), -p(-1, 1 - m, n)) } else { (p(-1, -m - 1, n), p(1, m + 1, n)) };
                entry += v * if size == 1 { std::f64::consts::SQRT_2 * kept } else { kept + dropped_at_one };
            }
            if m != 0 && size < l - 1 {
                let w = -0.5 * (((l - size - 1) * (l - size)) as f64 / whole).sqrt();
                let sum = if m > 0 { p(1, m + 1, n) + p(-1, -m - 1, n) } else { p(1, m - 1, n) - p(-1, 1 - m, n) };
                entry += w * sum;
            }
            entries.push(entry);
        }
    }
    entries
}

#[cfg(test)]
mod tests {
    use super::super::project::sphere_rule;
    use super::super::{basis, index};
    use super::*;
    use glam::DVec3;
    use std::f64::consts::PI;

    const N: usize = 121;

    /// Rotations about z and y by generic angles, with β = 0 and π, and all kinds between.
    fn cases() -> Vec<DMat3> {
        let mut list = Vec::new();
        for beta in [0.0, 1e-9, 0.5, 1.3, 0.5 * PI, 2.9, PI - 1e-9, PI] {
            for (alpha, gamma) in [(0.0, 0.0), (0.7, -2.1), (PI, 3.0)] {
                list.push(DMat3::from_rotation_z(alpha) * DMat3::from_rotation_y(beta) * DMat3::from_rotation_z(gamma));
            }
        }
        list.push(DMat3::from_axis_angle(DVec3::new(1.0, -2.0, 0.5).normalize(), 2.0));
        list
    }

    fn mixed() -> Coefficients {
        Coefficients::new(MAX_BANDS, (0..N).map(|i| ((i * i + 1) as f64 * 0.7).sin()).collect()).unwrap()
    }

    /// The slow twin, from the definition: block[m, n] = ∫ Y_m(ω) Y_n(R⁻¹ω) dω.
    #[test]
    fn blocks_are_the_integrals_that_define_them() {
        for matrix in cases() {
            let rotation = Rotation::new(MAX_BANDS, &matrix).unwrap();
            let mut twin = vec![0.0; N * N];
            let (mut here, mut back) = ([0.0; N], [0.0; N]);
            for (direction, weight) in sphere_rule(20) {
                basis::evaluate(MAX_BANDS, direction.to_array(), &mut here);
                basis::evaluate(MAX_BANDS, (matrix.transpose() * direction).to_array(), &mut back);
                for i in 0..N {
                    for j in 0..N {
                        twin[i * N + j] += weight * here[i] * back[j];
                    }
                }
            }
            for l in 0..MAX_BANDS {
                for m in 0..2 * l + 1 {
                    for n in 0..2 * l + 1 {
                        let ours = rotation.block(l)[m * (2 * l + 1) + n];
                        let exact = twin[(l * l + m) * N + l * l + n];
                        assert!((ours - exact).abs() < 1e-12, "l {l} {m} {n}: {ours} {exact}\n{matrix}");
                    }
                }
            }
        }
    }

    #[test]
    fn rotate_then_evaluate_is_evaluate_at_the_rotated_direction() {
        let f = mixed();
        for matrix in cases() {
            let rotated = Rotation::new(MAX_BANDS, &matrix).unwrap().apply(&f);
            for (direction, _) in sphere_rule(6).into_iter().chain([(DVec3::Z, 0.0), (-DVec3::Z, 0.0), (DVec3::X, 0.0)])
            {
                let expected = f.evaluate(matrix.transpose() * direction);
                assert!((rotated.evaluate(direction) - expected).abs() < 1e-10 * f.energy().sqrt());
            }
            for l in 0..MAX_BANDS {
                assert!((rotated.band_energy(l) - f.band_energy(l)).abs() < 1e-10);
            }
        }
        // A feature at +x comes to +y under a quarter turn about z.
        let turn = Rotation::new(3, &DMat3::from_rotation_z(0.5 * PI)).unwrap();
        let moved = turn.apply(&Coefficients::delta(3, DVec3::X));
        let expected = Coefficients::delta(3, DVec3::Y);
        for i in 0..9 {
            assert!((moved.values()[i] - expected.values()[i]).abs() < 1e-14);
        }
    }

    #[test]
    fn rotations_form_a_group_of_orthogonal_blocks() {
        let f = mixed();
        let list = cases();
        for (a, b) in list.iter().zip(list.iter().rev()) {
            let both = Rotation::new(MAX_BANDS, &(*a * *b)).unwrap().apply(&f);
            let (ra, rb) = (Rotation::new(MAX_BANDS, a).unwrap(), Rotation::new(MAX_BANDS, b).unwrap());
            let one_by_one = ra.apply(&rb.apply(&f));
            for i in 0..N {
                assert!((both.values()[i] - one_by_one.values()[i]).abs() < 1e-10);
            }
            for l in 0..MAX_BANDS {
                let (width, block) = (2 * l + 1, ra.block(l));
                for i in 0..width {
                    for j in 0..width {
                        let dot: f64 = (0..width).map(|k| block[i * width + k] * block[j * width + k]).sum();
                        assert!((dot - if i == j { 1.0 } else { 0.0 }).abs() < 1e-10);
                    }
                }
            }
        }
    }

    #[test]
    fn what_is_no_rotation_is_refused_and_single_precision_is_accepted() {
        let mirror = DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0));
        assert!(Rotation::new(5, &mirror).unwrap_err().to_string().contains("mirrored"));
        assert!(Rotation::new(5, &(DMat3::IDENTITY * 2.0)).is_err());
        assert!(Rotation::new(5, &(DMat3::IDENTITY * f64::NAN)).is_err());
        assert!(Rotation::new(0, &DMat3::IDENTITY).is_err());
        assert!(Rotation::new(12, &DMat3::IDENTITY).is_err());
        let rough = DMat3::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 1.0).as_mat3().as_dmat3();
        let rotation = Rotation::new(MAX_BANDS, &rough).unwrap();
        let f = mixed();
        assert!((rotation.apply(&f).energy() / f.energy() - 1.0).abs() < 1e-13);
        assert_eq!(Rotation::new(1, &rough).unwrap().apply(&Coefficients::constant(1, 2.0)).mean(), 2.0);
        assert_eq!(index(10, 10), N - 1);
    }
}
