//! Texels of one isosurface and the errors of their layers. Shared by the program `measure-layers` and the test
//! `physics::transport_layers`.

#![allow(dead_code)] // Program and test use their own parts of this.

use isolume::Result;
use isolume::level::Pyramid;
use isolume::sampling::hash::uniform;
use isolume::sampling::statistics::half_interval_95;
use isolume::transfer::{Lattice, Layers, Layout, Selection, texels_of_isosurface};
use isolume::transport::{Bake, Settings, TexelEstimate, estimates};
use isolume::volume::{Volume, field, open};
use std::path::Path;

const BANDS: usize = 5;
const LAYERS: usize = 4;
/// sqrt(4π).
const ROOT_FOUR_PI: f64 = 3.544_907_701_811_032;

/// Texels of a volume.
pub struct Sample {
    volume: Volume,
    pyramid: Pyramid,
    layout: Layout,
    texels: Vec<[usize; 3]>,
}

/// What one layer errs.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Of the transfer vector, in RMS over the texels.
    pub rms: f64,
    /// Of a_k.
    pub rms_a: f64,
    /// RMS of the standard errors that are stated for a_k, over `rms_a`.
    pub stated_over_true: f64,
    /// Share of the texels whose 95 % interval of a_k holds the truth.
    pub covered: f64,
    /// RMS of the standard errors that are stated for the bands above 0, over their true one.
    pub above: f64,
}

impl Sample {
    /// Draws `count` texels of `FIELD[:N]` or a file, with `@ISOVALUE` of those that its isosurface reads.
    pub fn open(name: &str, count: usize) -> Result<Self> {
        let (name, isovalue) = match name.rsplit_once('@') {
            Some((name, isovalue)) => (name, isovalue.parse::<f64>().ok()),
            None => (name, None),
        };
        let volume = match field::by_name(name)? {
            Some(field) => field.sample()?,
            None => open(Path::new(name))?,
        };
        let lattice = Lattice::from_ratio(volume.dims(), 1.0)?;
        let surface = match isovalue {
            Some(isovalue) => texels_of_isosurface(&volume, lattice, isovalue),
            None => Selection::of_all_isosurfaces(lattice, &volume),
        };
        let [mx, my, mz] = lattice.texels();
        let all: Vec<[usize; 3]> = (0..mx * my * mz)
            .map(|i| [i % mx, i / mx % my, i / mx / my])
            .filter(|&texel| surface.contains(texel))
            .collect();
        let drawn = |i: usize| all[((uniform(77, i as u64, 0, 0) * all.len() as f32) as usize).min(all.len() - 1)];
        let texels = (0..count).map(drawn).collect();
        let layout = Layout { lattice, layers: Layers::uniform(LAYERS, BANDS)? };
        Ok(Self { pyramid: Pyramid::new(&volume), volume, layout, texels })
    }

    /// How many layers there are.
    pub fn layers(&self) -> usize {
        LAYERS
    }

    /// The estimates of its texels, with the control variate; those without a level set are left out.
    pub fn estimates(&self, rays: u32, seed: u64) -> Result<Vec<TexelEstimate>> {
        self.estimates_of(rays, seed, false)
    }

    /// The same with the setting `positive`: without the control variate.
    pub fn estimates_of(&self, rays: u32, seed: u64, positive: bool) -> Result<Vec<TexelEstimate>> {
        let settings = Settings { layers: self.layout.layers.clone(), rays, seed, positive, target: None };
        let selection = Selection::empty(self.layout.lattice);
        let bake = Bake::new(&self.volume, &self.pyramid, &self.layout, &settings, &selection);
        let texels: Vec<_> = self.texels.iter().map(|&texel| (texel, rays)).collect();
        Ok(estimates(&bake, &texels)?.into_iter().flatten().flatten().collect())
    }

    /// The errors of layer `k`. Those of the reference are taken off, as it states them.
    pub fn row(&self, k: usize, found: &[TexelEstimate], truth: &[TexelEstimate]) -> Row {
        let layers = &self.layout.layers;
        let (first, error) = (layers.offset(k), layers.error_offset(k));
        let pairs = || found.iter().zip(truth);
        let difference = |(f, t): (&TexelEstimate, &TexelEstimate), i: usize| {
            f64::from(f.transfer[first + i]) - f64::from(t.transfer[first + i])
        };
        // Mean over the texels of Σ over the bands.
        let stated = |of: &[TexelEstimate], bands: std::ops::Range<usize>| {
            let each = |t: &TexelEstimate| -> f64 {
                bands.clone().map(|l| (2 * l + 1) as f64 * f64::from(t.stderr[error + l]).powi(2)).sum()
            };
            of.iter().map(each).sum::<f64>() / of.len() as f64
        };
        let square = |range: std::ops::Range<usize>| {
            let each = |pair| range.clone().map(|i| difference(pair, i).powi(2)).sum::<f64>();
            pairs().map(each).sum::<f64>() / found.len() as f64
        };
        let (of_first, of_others) =
            (square(0..1) - stated(truth, 0..1), square(1..BANDS * BANDS) - stated(truth, 1..BANDS));
        let covers = |pair: (&TexelEstimate, &TexelEstimate)| {
            let (error, stated) = (difference(pair, 0).abs(), f64::from(pair.0.stderr[error]));
            // Half a unit in the last place of the stored transfer.
            error <= half_interval_95(BANDS) * stated + f64::from(pair.1.transfer[first].abs()) / 2048.0
        };
        Row {
            rms: (of_first + of_others).max(0.0).sqrt(),
            rms_a: ROOT_FOUR_PI * of_first.max(0.0).sqrt(),
            stated_over_true: (stated(found, 0..1) / of_first).sqrt(),
            covered: pairs().filter(|&pair| covers(pair)).count() as f64 / found.len() as f64,
            above: (stated(found, 1..BANDS) / of_others).sqrt(),
        }
    }
}
