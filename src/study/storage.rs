//! What keeping the coefficients in fewer bits costs.

use super::{Exact, Measured, References, Study};
use crate::error::Result;
use crate::transfer::precision::include_magnitudes;
use crate::transfer::{BrickSource, Precision, validity};
use crate::transport::Settings;

impl Study<'_> {
    /// Holds the texels that `path` bakes with `settings` against the references, once for each way of keeping their
    /// coefficients, in the order of `kept_as`. `texture` is that bake: the largest magnitudes of its coefficients are
    /// the scales of [`Precision::Steps`].
    ///
    /// Interpolation and light are written from the definitions, in `f64`: only the coefficients are rounded.
    ///
    /// # Errors
    /// As [`Study::measure`].
    pub fn measure_kept_as(
        &self,
        references: &References,
        texture: &dyn BrickSource,
        settings: &Settings,
        kept_as: &[Precision],
    ) -> Result<Vec<Measured>> {
        let basis = self.basis(references, texture.layout())?;
        let texels = self.texels(texture.layout(), settings)?;
        let otherwise = self.looked_up(texture, &basis.light)?;
        let again = basis.radiance(&texels, &otherwise);
        let largest = largest_magnitudes(texture)?;
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

fn read_back(texels: &Exact, precision: Precision, largest: &[f32]) -> Exact {
    let rounded =
        |transfer: &Vec<f32>| transfer.iter().zip(largest).map(|(&t, &l)| precision.read_back(t, l)).collect();
    texels.iter().map(|(texel, transfer)| (*texel, rounded(transfer))).collect()
}
