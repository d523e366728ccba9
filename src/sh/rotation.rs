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
mod tests;
