//! What keeping the coefficients in fewer bits costs.

use super::{Measured, References, Study, layout_of};
use crate::compare::Texels;
use crate::error::Result;
use crate::transfer::precision::include_magnitudes;
use crate::transfer::{BrickSource, Precision, validity};
use crate::transport::Settings;

impl Study<'_> {
    /// Holds the texels that `path` bakes with `settings` against the references, once for each way of keeping their
    /// coefficients, in the order of `kept_as`. `textures` are that bake, one a group: the largest magnitudes of its
    /// coefficients are the scales of [`Precision::Steps`].
    ///
    /// Interpolation and light are written from the definitions, in `f64`: only the coefficients are rounded.
    ///
    /// # Errors
    /// As [`Study::measure`].
    pub fn measure_kept_as(
        &self,
        references: &References,
        textures: &[&dyn BrickSource],
        settings: &Settings,
        kept_as: &[Precision],
    ) -> Result<Vec<Measured>> {
        let layout = layout_of(textures)?;
        let basis = self.basis(references, layout)?;
        let texels = self.texels(layout, settings)?;
        let (otherwise, _) = self.surface.by_textures(textures, &basis.light)?;
        let again = basis.radiance(&texels, &otherwise);
        let largest = textures.iter().map(|t| largest_magnitudes(*t)).collect::<Result<Vec<_>>>()?;
        let each = kept_as.iter().map(|precision| {
            let stored = basis.radiance(&read_back(&texels, *precision, &largest), &otherwise);
            basis.budget(&stored, &again, 0.0)
        });
        each.collect()
    }
}

/// The largest magnitude that each coefficient had in any valid texel before it was rounded to the 16 bits of the
/// texture: at most 2⁻¹¹ of it more.
pub(super) fn largest_magnitudes(texture: &dyn BrickSource) -> Result<Vec<f32>> {
    let n = texture.layout().layers.coefficients();
    let mut largest = vec![0.0f32; n];
    let [bx, by, bz] = texture.layout().lattice.bricks();
    for i in 0..bx * by * bz {
        let Some(brick) = texture.brick([i % bx, i / bx % by, i / bx / by])? else { continue };
        let valid =
            brick.validity.iter().zip(brick.transfer.chunks_exact(n)).filter(|(v, _)| *v & validity::VALID != 0);
        valid.for_each(|(_, transfer)| include_magnitudes(&mut largest, transfer.iter().map(|t| t.to_f32())));
    }
    Ok(largest.into_iter().map(|l| l + Precision::Half.largest_error(l)).collect())
}

/// Texels with their coefficients read back; `largest` are the scales of each group.
fn read_back(texels: &Texels, precision: Precision, largest: &[Vec<f32>]) -> Texels {
    let rounded = |(transfer, largest): (&Vec<f32>, &Vec<f32>)| {
        transfer.iter().zip(largest).map(|(&t, &l)| precision.read_back(t, l)).collect()
    };
    texels.iter().map(|(texel, groups)| (*texel, groups.iter().zip(largest).map(rounded).collect())).collect()
}
