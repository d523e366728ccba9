//! Lamps of an environment that are lit apart, as relight does.

use super::Apart;
use crate::probe::{Orientation, Probe, SunOptions, SunSplit, split_sun};
use crate::render::SunLight;
use crate::session::SUN_RAYS;
use crate::sh::Coefficients;
use crate::transfer::Layers;

/// Lamps, and their part in the bands of the light.
pub(super) struct Lamps {
    excess: [Coefficients; 3],
    suns: Vec<SunLight>,
}

impl Lamps {
    /// Those of a probe for a texture of some layers; `None` where none is split off.
    pub(super) fn of(probe: &Probe, orientation: Orientation, split: SunSplit, layers: &Layers) -> Option<Self> {
        let split = split_sun(probe, &SunOptions::of(split, layers.bands()[0])?);
        let bands = layers.max_bands();
        let (whole, rest) =
            (probe.coefficients_in_world(bands, orientation), split.rest.coefficients_in_world(bands, orientation));
        let excess = std::array::from_fn(|c| &whole[c] - &rest[c]);
        let suns: Vec<_> = split.suns.iter().map(|s| SunLight::new(&s.sun, orientation, SUN_RAYS)).collect();
        (!suns.is_empty()).then_some(Self { excess, suns })
    }

    pub(super) fn apart(&self) -> Apart<'_> {
        Apart { excess: &self.excess, suns: &self.suns }
    }
}
