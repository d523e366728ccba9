//! Transfer itself at points of a surface: what a file carries so that others can relight it.

use super::lookup::Cell;
use super::{LookupReport, Textures};
use crate::error::{Error, Result};
use crate::grid3;
use crate::sh;
use crate::transfer::{BrickSource, BrickView, Lattice, Layers, validity};
use half::slice::HalfFloatSliceExt;

/// Transfer at each vertex.
pub struct VertexTransfer {
    /// For each coefficient of the environment's texture, in its order, one number a vertex. In a scene then for each
    /// number of the textures of emission and of the luminaires, as stored: layer-major, then red, green and blue.
    pub planes: Vec<Vec<f32>>,
    /// How the lookups went.
    pub report: LookupReport,
}

/// The bricks of a texture, opened once.
struct Bricks<'a> {
    // x fastest; `None` where nothing is baked.
    views: Vec<Option<BrickView<'a>>>,
    // Numbers of a texel.
    count: usize,
}

impl<'a> Bricks<'a> {
    fn open(source: &'a dyn BrickSource) -> Result<Self> {
        let [bx, by, bz] = source.layout().lattice.bricks();
        let index = |i: usize| grid3::at([bx, by], i);
        let views = (0..bx * by * bz).map(|i| source.brick(index(i))).collect::<Result<_>>()?;
        Ok(Self { views, count: source.layout().layers.coefficients() })
    }
}

/// All numbers of the texels, texture behind texture.
struct Texels<'a> {
    lattice: Lattice,
    // The environment's first.
    textures: Vec<Bricks<'a>>,
}

impl<'a> Texels<'a> {
    fn open(textures: &Textures<'a>) -> Result<Self> {
        let of_luminaires = textures.surroundings.iter().flat_map(|s| s.luminaires.iter().map(|l| l.texture));
        let others = textures.surroundings.iter().map(|s| s.emission).chain(of_luminaires);
        let all = std::iter::once(textures.environment).chain(others);
        Ok(Self { lattice: textures.layout().lattice, textures: all.map(Bricks::open).collect::<Result<_>>()? })
    }

    /// Numbers of a texel.
    fn count(&self) -> usize {
        self.textures.iter().map(|t| t.count).sum()
    }

    /// Reads a texel: `None` where it was never baked, `Some(false)` where it has no level set.
    fn read(&self, texel: [usize; 3], mut out: &mut [f32]) -> Option<bool> {
        let [bx, by, _] = self.lattice.bricks();
        let (brick, inner) = self.lattice.place_of(texel);
        let brick = grid3::index([bx, by], brick);
        for Bricks { views, count } in &self.textures {
            let view = views[brick].as_ref()?;
            let stored = &view.transfer[inner * count..(inner + 1) * count];
            if view.validity[inner] & validity::VALID == 0 {
                return (!stored[0].is_nan()).then_some(false);
            }
            let (here, rest) = out.split_at_mut(*count);
            stored.convert_to_f32_slice(here);
            out = rest;
        }
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

    fn add(&mut self, texels: &Texels<'_>, texel: [usize; 3], weight: f32) {
        match texels.read(texel, &mut self.texel) {
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

/// Interpolates the transfer of textures at positions, as [`super::Contracted::look_up`] interpolates radiance:
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
    textures: &Textures<'_>,
    positions_in_grid: &[[f32; 3]],
    normals_in_world: &[[f32; 3]],
) -> Result<VertexTransfer> {
    assert_eq!(positions_in_grid.len(), normals_in_world.len());
    let (texels, layers) = (Texels::open(textures)?, &textures.layout().layers);
    let n = texels.count();
    let mut planes = vec![Vec::with_capacity(positions_in_grid.len()); n];
    let mut report = LookupReport::default();
    let mut mean = Mean { texel: vec![0.0; n], sum: vec![0.0; n], weights: 0.0, missing: false, unbaked: false };
    for (position, normal) in positions_in_grid.iter().zip(normals_in_world) {
        report.lookups += 1;
        let cell = Cell::around(texels.lattice, *position);
        mean.clear();
        cell.corners().for_each(|(texel, w)| mean.add(&texels, texel, w));
        report.unbaked += u64::from(mean.unbaked);
        if mean.weights > 0.0 {
            report.renormalised += u64::from(mean.missing);
        } else {
            cell.surroundings(texels.lattice).for_each(|texel| mean.add(&texels, texel, 1.0));
            report.neighbourhood += u64::from(mean.weights > 0.0);
        }
        if mean.weights > 0.0 {
            mean.sum.iter_mut().for_each(|s| *s /= mean.weights);
        } else {
            report.unoccluded += 1;
            unoccluded(layers, *normal, &mut mean.sum);
        }
        planes.iter_mut().zip(&mean.sum).for_each(|(plane, s)| plane.push(*s));
    }
    Ok(VertexTransfer { planes, report })
}

/// The transfer of the vertices of a surface, from textures of its vertices, which have these normals; where one was not
/// baked, the clamped cosine of the normal.
///
/// # Errors
/// Those of the source; [`Error::Argument`] when the textures are not of as many vertices as there are normals.
pub fn transfer_at_vertices(textures: &Textures<'_>, normals_in_world: &[[f32; 3]]) -> Result<VertexTransfer> {
    let (texels, layers) = (Texels::open(textures)?, &textures.layout().layers);
    let held = if texels.lattice.is_of_vertices() { texels.lattice.texels()[0] } else { 0 };
    if held != normals_in_world.len() {
        let expected = format!("{}, one a normal", normals_in_world.len());
        return Err(Error::argument("vertices", held, expected, "give the textures of the surface"));
    }
    let n = texels.count();
    let mut planes = vec![Vec::with_capacity(held); n];
    let (mut report, mut vector) = (LookupReport::default(), vec![0.0; n]);
    for (vertex, normal) in normals_in_world.iter().enumerate() {
        report.lookups += 1;
        let found = texels.read([vertex, 0, 0], &mut vector);
        if found != Some(true) {
            report.unbaked += u64::from(found.is_none());
            report.unoccluded += 1;
            unoccluded(layers, *normal, &mut vector);
        }
        planes.iter_mut().zip(&vector).for_each(|(plane, value)| plane.push(*value));
    }
    Ok(VertexTransfer { planes, report })
}

/// T_0 of a surface that nothing hides, (A_l/π) Y_lm(n) in each channel; no other layer, no luminaire.
fn unoccluded(layers: &Layers, normal: [f32; 3], out: &mut [f32]) {
    out.fill(0.0);
    let bands = layers.bands()[0];
    let mut basis = [0.0f64; sh::MAX_BANDS * sh::MAX_BANDS];
    sh::basis::evaluate(bands, normal.map(f64::from), &mut basis);
    for channel in out.chunks_exact_mut(bands * bands).take(layers.channels()) {
        for l in 0..bands {
            let factor = sh::CLAMPED_COSINE[l] / std::f64::consts::PI;
            for i in l * l..(l + 1) * (l + 1) {
                channel[i] = (factor * basis[i]) as f32;
            }
        }
    }
}
