//! The relit texture of a store: the radiance of the level set through each of its texels.

use super::{Lighting, LuminaireFactor, radiance_of_bricks};
use crate::error::{Error, Result};
use crate::export::field::{FieldFormat, RadianceField};
use crate::grid3;
use crate::relight::{LookupReport, Material};
use crate::transfer::store::Store;
use crate::transfer::{BRICK, BrickSource, BrickView, Lattice, Selection, validity};
use crate::volume::Volume;
use glam::{DMat3, DVec3};
use serde_json::Value;
use std::path::Path;

/// The relit texture of a store: one entry a texel, x fastest.
pub struct RelitField {
    /// Texels along each axis.
    pub dims: [usize; 3],
    /// World position of the first texel.
    pub origin: DVec3,
    /// World displacement from a texel to the next along each axis.
    pub steps: DMat3,
    /// Linear radiance.
    pub radiance: Vec<[f32; 3]>,
    /// 1 where the radiance is that of a level set, 2 where it was filled from neighbours, 0 where there is none.
    pub valid: Vec<u8>,
    /// The scalar field, in the file's values.
    pub values: Vec<f32>,
    /// Noise of the bake over the mean radiance.
    pub noise: f64,
}

impl RelitField {
    /// Multiplies the texture of a store with light.
    ///
    /// # Errors
    /// When lamps are lit apart: they have no texture. As [`radiance_of_bricks`]; when a brick cannot be read.
    pub fn new(
        store: &Store,
        volume: &Volume,
        lighting: &Lighting<'_>,
        material: &Material,
        luminaires: &[LuminaireFactor],
    ) -> Result<Self> {
        if !lighting.suns().is_empty() {
            let found = format!("{} lamps lit apart", lighting.suns().len());
            let remedy = "leave lamps in the light: sun split off";
            return Err(Error::argument("light", found, "all of it in the bands", remedy));
        }
        let lattice = store.layout().lattice;
        let bricks = Selection::all(lattice).bricks();
        let (contracted, _) = radiance_of_bricks(store, &bricks, lighting, material, luminaires)?;
        let views = bricks.iter().map(|&b| store.brick(b)).collect::<Result<Vec<_>>>()?;
        let (mut radiance, mut valid, mut values) = (Vec::new(), Vec::new(), Vec::new());
        let [mx, my, mz] = lattice.texels();
        let mut report = LookupReport::default();
        for i in 0..mx * my * mz {
            let texel = grid3::at([mx, my], i);
            let at = lattice.grid_from_texel(texel);
            let before = report;
            let rgb =
                contracted.radiance_at(at.map(|v| v as f32), [0.0, 0.0, 1.0], lighting.light(), material, &mut report);
            let none = report.unoccluded > before.unoccluded;
            radiance.push(if none { [0.0; 3] } else { rgb });
            let has_level_set = is_valid(&views, lattice, texel);
            valid.push(if none {
                0
            } else if has_level_set {
                1
            } else {
                2
            });
            values.push(value(volume, at));
        }
        let (origin, steps) = placement(volume, lattice);
        Ok(Self { dims: [mx, my, mz], origin, steps, radiance, valid, values, noise: contracted.noise.relative() })
    }

    /// Writes it, with the factor from radiance to colours and how it was made.
    ///
    /// # Errors
    /// As [`FieldFormat::write`].
    pub fn write(&self, path: &Path, format: FieldFormat, exposure: f32, provenance: &Value) -> Result<()> {
        let Self { dims, origin, steps, radiance, valid, values, .. } = self;
        let (dims, origin, steps) = (*dims, *origin, *steps);
        format.write(path, &RadianceField { dims, origin, steps, radiance, valid, values, exposure, provenance })
    }

    /// Radiance of the texels that have a level set.
    pub fn lit(&self) -> Vec<[f32; 3]> {
        self.radiance.iter().zip(&self.valid).filter(|(_, v)| **v == 1).map(|(r, _)| *r).collect()
    }
}

/// Whether a texel has a level set; `views` are all bricks, x fastest.
fn is_valid(views: &[Option<BrickView<'_>>], lattice: Lattice, texel: [usize; 3]) -> bool {
    let [bx, by, _] = lattice.bricks();
    let inner = texel[0] % BRICK + BRICK * (texel[1] % BRICK + BRICK * (texel[2] % BRICK));
    views[texel[0] / BRICK + bx * (texel[1] / BRICK + by * (texel[2] / BRICK))]
        .is_some_and(|view| view.validity[inner] & validity::VALID != 0)
}

/// World position of the first texel and the steps from texel to texel.
fn placement(volume: &Volume, lattice: Lattice) -> (DVec3, DMat3) {
    let world_from_grid = volume.world_from_grid();
    let steps = DMat3::from_diagonal(DVec3::new(lattice.step(0), lattice.step(1), lattice.step(2)));
    (world_from_grid.offset(), world_from_grid.linear() * steps)
}

/// The trilinear field at a grid position, in the file's values.
fn value(volume: &Volume, at: [f64; 3]) -> f32 {
    let dims = volume.dims();
    let base: [usize; 3] = std::array::from_fn(|a| (at[a] as usize).min(dims[a].saturating_sub(2)));
    let mut sum = 0.0;
    for corner in 0..8 {
        let mut weight = 1.0;
        let index: [usize; 3] = std::array::from_fn(|a| {
            let (high, part) = (corner >> a & 1, at[a] - base[a] as f64);
            weight *= if high == 1 { part } else { 1.0 - part };
            (base[a] + high).min(dims[a] - 1)
        });
        if weight > 0.0 {
            sum += weight * f64::from(volume.samples().raw(volume.index(index[0], index[1], index[2])));
        }
    }
    volume.value_from_raw(sum) as f32
}
