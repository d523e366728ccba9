//! One brick of a scene: the environment in three channels, one number a layer and channel for each luminaire, and the
//! level set's own light.

use super::super::block::{LANES, Lanes};
use super::super::noise::TailRadiance;
use super::super::{LuminaireLight, Material};
use super::{BrickTotals, Opened, Surroundings, UNBAKED, Weights};
use crate::error::Result;
use crate::transfer::{BRICK_TEXELS, BrickSource, BrickView, Layers, MAX_LAYERS};

/// Contraction of the bricks of a scene's textures.
pub(super) struct Kernel<'a> {
    environment: &'a dyn BrickSource,
    surroundings: &'a Surroundings<'a>,
    // Red coefficients of each layer in the environment's texture: where they start, and how many.
    reds: Vec<(usize, usize)>,
    // Coefficients and standard errors of a texel of the environment.
    lengths: [usize; 2],
    // What each layer counts for in each channel: ρ^(k+1), unless the material says otherwise.
    powers: Vec<[f64; 3]>,
    // Of the mean of the channels.
    weights: Weights,
    material: Material,
}

/// Room for a block of one thread: what [`super::super::noise`] reads.
pub(super) struct Room {
    contracted: Vec<[Lanes; 4]>,
    first: Vec<Lanes>,
    errors: Vec<Lanes>,
    tail: TailRadiance,
    // Variance that the luminaires bring.
    of_luminaires: [f64; LANES],
}

impl Room {
    pub(super) fn new(layers: &Layers) -> Self {
        Self {
            contracted: vec![[[0.0; LANES]; 4]; layers.len()],
            first: vec![[0.0; LANES]; layers.len()],
            errors: vec![[0.0; LANES]; layers.errors()],
            tail: TailRadiance::NONE,
            of_luminaires: [0.0; LANES],
        }
    }
}

/// The textures of a brick.
struct Views<'a> {
    environment: BrickView<'a>,
    emission: BrickView<'a>,
    luminaires: Vec<(BrickView<'a>, [f64; 3])>,
    layers: usize,
}

impl Views<'_> {
    /// G_k of a texel and channel of a texture beside that of the environment.
    #[inline(always)]
    fn at(&self, view: &BrickView<'_>, texel: usize, k: usize, c: usize) -> f64 {
        f64::from(view.transfer[(texel * self.layers + k) * 3 + c].to_f32())
    }
}

impl<'a> Kernel<'a> {
    /// `weights` are those of the environment's layers in one channel.
    pub(super) fn new(
        environment: &'a dyn BrickSource,
        surroundings: &'a Surroundings<'a>,
        weights: Weights,
        material: &Material,
    ) -> Self {
        let layers = &environment.layout().layers;
        let powers = (0..layers.len()).map(|k| std::array::from_fn(|c| material.factor(k, c))).collect();
        let reds = layers.bands().iter().enumerate().map(|(k, b)| (layers.offset(k), b * b)).collect();
        let lengths = [layers.coefficients(), layers.errors()];
        Self { environment, surroundings, reds, lengths, powers, weights, material: *material }
    }

    /// Contracts the brick at an index.
    pub(super) fn contract(
        &self,
        room: &mut Room,
        index: [usize; 3],
        out: &mut [[f32; 4]; BRICK_TEXELS],
    ) -> Result<BrickTotals> {
        let Some(views) = self.open(index)? else {
            out.fill([0.0, 0.0, 0.0, UNBAKED]);
            return Ok(BrickTotals::default());
        };
        let brick = Opened::new(Some(views.environment));
        let mut totals = BrickTotals { texels: brick.count as u64, ..BrickTotals::default() };
        for texels in brick.valid().chunks(LANES) {
            for (j, &t) in texels.iter().enumerate() {
                let (rgb, left_out) = self.texel(&views, usize::from(t), j, room);
                out[usize::from(t)] = [rgb[0] as f32, rgb[1] as f32, rgb[2] as f32, 0.0];
                totals.radiance += rgb[0] + rgb[1] + rgb[2];
                totals.left_out = totals.left_out.max(left_out as f32);
            }
            // Lanes beyond the texels hold those of an earlier block, and nobody reads them.
            let variance = self.weights.noise.variance(&room.first, &room.contracted, &room.tail, &room.errors);
            for (j, &t) in texels.iter().enumerate() {
                let variance = f64::from(variance[j]) + room.of_luminaires[j];
                totals.variance += variance;
                out[usize::from(t)][3] = variance.sqrt() as f32;
            }
        }
        brick.mark_others(&views.environment, self.lengths[1], out);
        Ok(totals)
    }

    /// The textures of a brick; `None` where one of them is not baked.
    fn open(&self, index: [usize; 3]) -> Result<Option<Views<'a>>> {
        let (Some(environment), Some(emission)) =
            (self.environment.brick(index)?, self.surroundings.emission.brick(index)?)
        else {
            return Ok(None);
        };
        let mut luminaires = Vec::with_capacity(self.surroundings.luminaires.len());
        for LuminaireLight { texture, factor } in &self.surroundings.luminaires {
            let Some(view) = texture.brick(index)? else { return Ok(None) };
            luminaires.push((view, *factor));
        }
        Ok(Some(Views { environment, emission, luminaires, layers: self.reds.len() }))
    }

    /// Radiance of a texel, and what it leaves out of the emission; what its noise needs goes into lane `j`.
    fn texel(&self, views: &Views<'_>, t: usize, j: usize, room: &mut Room) -> ([f64; 3], f64) {
        let count = self.reds.len();
        // What each layer brings, with its albedo.
        let mut brought = [[0.0f64; 3]; MAX_LAYERS];
        (0..count).for_each(|k| brought[k] = self.of_environment(views, t, k, j, room));
        let again = self.again(views, t);
        let gains = again.map(|x| if x < 1.0 { x / (1.0 - x) } else { 0.0 });
        let of_last = brought[count - 1];
        room.tail.beyond[j] = ((0..3).map(|c| of_last[c] * gains[c]).sum::<f64>() / 3.0) as f32;
        room.tail.survival[j] = ((0..3).map(|c| views.at(&views.emission, t, count - 1, c)).sum::<f64>() / 3.0) as f32;
        room.of_luminaires[j] = 0.0;
        for (view, factor) in &views.luminaires {
            for k in 0..count {
                let mut mean = 0.0;
                for c in 0..3 {
                    let weight = self.powers[k][c] * factor[c];
                    brought[k][c] += weight * views.at(view, t, k, c);
                    mean += weight * if k == count - 1 { 1.0 + gains[c] } else { 1.0 } / 3.0;
                }
                room.of_luminaires[j] += (mean * f64::from(view.stderr[t * count + k].to_f32())).powi(2);
            }
        }
        let (mut rgb, mut left_out) = ([0.0f64; 3], 0.0f64);
        for c in 0..3 {
            let emitted = f64::from(self.material.emission[c]);
            for k in 0..count {
                brought[k][c] += emitted * self.powers[k][c] * views.at(&views.emission, t, k, c);
                rgb[c] += brought[k][c];
            }
            rgb[c] += emitted;
            if again[c] < 1.0 {
                rgb[c] += brought[count - 1][c] * again[c] / (1.0 - again[c]);
            } else if emitted > 0.0 {
                left_out = left_out.max(brought[count - 1][c] / emitted);
            }
        }
        (rgb, left_out)
    }

    /// What layer k brings of the environment, and into lane `j` what its noise needs: the transfer in the mean of the
    /// channels, its product with G_k², and its standard errors.
    fn of_environment(&self, views: &Views<'_>, t: usize, k: usize, j: usize, room: &mut Room) -> [f64; 3] {
        let [coefficients, errors] = self.lengths;
        let (first, square) = self.reds[k];
        let stored = &views.environment.transfer[t * coefficients + first..][..3 * square];
        let (reds, others) = stored.split_at(square);
        let (greens, blues) = others.split_at(square);
        let mut sums = [0.0f64; 4];
        for (i, row) in self.weights.rows[first / 3..][..square].iter().enumerate() {
            let rgb = [reds[i], greens[i], blues[i]].map(|stored| f64::from(stored.to_f32()));
            for c in 0..3 {
                sums[c] += rgb[c] * f64::from(row[c]);
            }
            sums[3] += (rgb[0] + rgb[1] + rgb[2]) / 3.0 * f64::from(row.w);
        }
        for c in 0..4 {
            room.contracted[k][c][j] = sums[c] as f32;
        }
        room.first[k][j] = (reds[0].to_f32() + greens[0].to_f32() + blues[0].to_f32()) * (1.0 / 3.0);
        if k == 0 {
            let stderr = &views.environment.stderr[t * errors..][..errors];
            room.errors.iter_mut().zip(stderr).for_each(|(lanes, stderr)| lanes[j] = stderr.to_f32());
        }
        [sums[0], sums[1], sums[2]]
    }

    /// ρ r of each channel: of what the last layer brings, the share that one further layer does. 0 for a single layer.
    fn again(&self, views: &Views<'_>, t: usize) -> [f64; 3] {
        let before = self.reds.len().checked_sub(2).filter(|_| self.material.has_tail());
        let Some(before) = before else { return [0.0; 3] };
        std::array::from_fn(|c| {
            let [before, last] = [before, before + 1].map(|k| views.at(&views.emission, t, k, c));
            let ratio = if before > 0.0 { (last / before).min(1.0) } else { 0.0 };
            f64::from(self.material.albedo[c]) * ratio
        })
    }
}

#[cfg(test)]
mod tests;
