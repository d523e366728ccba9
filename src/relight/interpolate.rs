//! Transfer itself at points of a surface: what a file carries so that others can relight it.

use super::LookupReport;
use super::lookup::Cell;
use crate::error::Result;
use crate::sh;
use crate::transfer::{BRICK, BrickSource, BrickView, Layout, validity};
use half::slice::HalfFloatSliceExt;

/// Transfer at each vertex.
pub struct VertexTransfer {
    /// For each coefficient of the texture's layers (layer-major) one number a vertex.
    pub planes: Vec<Vec<f32>>,
    /// How the lookups went.
    pub report: LookupReport,
}

/// The bricks that lookups need, opened once.
struct Bricks<'a> {
    layout: &'a Layout,
    // x fastest; `None` where nothing is baked.
    views: Vec<Option<BrickView<'a>>>,
}

impl Bricks<'_> {
    /// Reads a texel's transfer: `None` where it was never baked, `Some(false)` where it has no level set.
    fn texel(&self, texel: [usize; 3], out: &mut [f32]) -> Option<bool> {
        let [bx, by, _] = self.layout.lattice.bricks();
        let view = self.views[texel[0] / BRICK + bx * (texel[1] / BRICK + by * (texel[2] / BRICK))].as_ref()?;
        let inner = texel[0] % BRICK + BRICK * (texel[1] % BRICK + BRICK * (texel[2] % BRICK));
        let stored = &view.transfer[inner * out.len()..(inner + 1) * out.len()];
        if view.validity[inner] & validity::VALID == 0 {
            return (!stored[0].is_nan()).then_some(false);
        }
        stored.convert_to_f32_slice(out);
        Some(true)
    }
}

/// A weighted mean of texels in the making.
struct Mean {
    texel: Vec<f32>,
    sum: Vec<f32>,
    weights: f32,
    /// Some texel had no level set or was not baked.
    missing: bool,
    /// Some texel was not baked.
    unbaked: bool,
}

impl Mean {
    fn clear(&mut self) {
        self.sum.fill(0.0);
        (self.weights, self.missing, self.unbaked) = (0.0, false, false);
    }

    fn add(&mut self, bricks: &Bricks<'_>, texel: [usize; 3], weight: f32) {
        match bricks.texel(texel, &mut self.texel) {
            Some(true) => {
                self.sum.iter_mut().zip(&self.texel).for_each(|(s, t)| *s += weight * t);
                self.weights += weight;
            }
            found => {
                self.missing = true;
                self.unbaked |= found.is_none();
            }
        }
    }
}

/// Interpolates the transfer of `source` at positions, as [`super::Contracted::look_up`] interpolates radiance:
/// trilinear over the valid texels; else the mean of those around; else the clamped cosine of the normal. Contraction
/// and interpolation commute for the layers, not for the tail beyond them, whose ratio is not linear in the transfer:
/// there the two differ to second order in the change from texel to texel.
///
/// # Errors
/// Those of the source.
///
/// # Panics
/// When there are not as many normals as positions.
pub fn look_up_transfer(
    source: &dyn BrickSource,
    positions_in_grid: &[[f32; 3]],
    normals_in_world: &[[f32; 3]],
) -> Result<VertexTransfer> {
    assert_eq!(positions_in_grid.len(), normals_in_world.len());
    let layout = source.layout();
    let [bx, by, bz] = layout.lattice.bricks();
    let index = |i: usize| [i % bx, i / bx % by, i / bx / by];
    let views = (0..bx * by * bz).map(|i| source.brick(index(i))).collect::<Result<_>>()?;
    let bricks = Bricks { layout, views };
    let n = layout.layers.coefficients();
    let mut planes = vec![Vec::with_capacity(positions_in_grid.len()); n];
    let mut report = LookupReport::default();
    let mut mean = Mean { texel: vec![0.0; n], sum: vec![0.0; n], weights: 0.0, missing: false, unbaked: false };
    for (position, normal) in positions_in_grid.iter().zip(normals_in_world) {
        report.lookups += 1;
        let cell = Cell::around(layout.lattice, *position);
        mean.clear();
        cell.corners().for_each(|(texel, w)| mean.add(&bricks, texel, w));
        report.unbaked += u64::from(mean.unbaked);
        if mean.weights > 0.0 {
            report.renormalised += u64::from(mean.missing);
        } else {
            cell.surroundings(layout.lattice).for_each(|texel| mean.add(&bricks, texel, 1.0));
            report.neighbourhood += u64::from(mean.weights > 0.0);
        }
        if mean.weights > 0.0 {
            mean.sum.iter_mut().for_each(|s| *s /= mean.weights);
        } else {
            report.unoccluded += 1;
            unoccluded(layout.layers.bands()[0], *normal, &mut mean.sum);
        }
        planes.iter_mut().zip(&mean.sum).for_each(|(plane, s)| plane.push(*s));
    }
    Ok(VertexTransfer { planes, report })
}

/// T_0 of a surface that nothing hides, (A_l/π) Y_lm(n); no other layer.
fn unoccluded(bands: usize, normal: [f32; 3], out: &mut [f32]) {
    out.fill(0.0);
    let mut basis = [0.0f64; sh::MAX_BANDS * sh::MAX_BANDS];
    sh::basis::evaluate(bands, normal.map(f64::from), &mut basis);
    for l in 0..bands {
        let factor = sh::CLAMPED_COSINE[l] / std::f64::consts::PI;
        for i in l * l..(l + 1) * (l + 1) {
            out[i] = (factor * basis[i]) as f32;
        }
    }
}
