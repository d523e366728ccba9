//! Lamps of an environment that are lit apart, as relight does.

use super::Apart;
use crate::probe::{EnvironmentSource, LatLong, Orientation, Probe, SunOptions, SunSplit, split_sun};
use crate::relight::TriangleIndex;
use crate::render::SunLight;
use crate::session::SUN_RAYS;
use crate::sh::Coefficients;
use crate::transfer::Layers;

/// Lamps, and the light without them.
pub(super) struct Lamps {
    rest: [Coefficients; 3],
    suns: Vec<SunLight>,
    source: EnvironmentSource<'static>,
    reflects: bool,
}

impl Lamps {
    /// Those of a probe for a texture of some layers; `None` where none is split off.
    pub(super) fn of(probe: &Probe, orientation: Orientation, split: SunSplit, layers: &Layers) -> Option<Self> {
        let split = split_sun(probe, &SunOptions::of(split, layers.bands()[0])?);
        let rest = split.rest.coefficients_in_world(layers.max_bands(), orientation);
        let suns: Vec<_> = split.suns.iter().map(|s| SunLight::new(&s.sun, orientation, SUN_RAYS)).collect();
        if suns.is_empty() {
            return None;
        }
        let (whole, rest_of_image) = (&probe.image, &split.rest.image);
        let lamps = LatLong::from_fn(whole.width(), whole.height(), |x, y| {
            let (all, left) = (whole.row(y)[x], rest_of_image.row(y)[x]);
            std::array::from_fn(|c| f64::from(all[c]) - f64::from(left[c]))
        });
        let source = EnvironmentSource::new(&lamps, orientation).into_owned();
        Some(Self { rest, suns, source, reflects: layers.len() > 1 })
    }

    pub(super) fn apart<'a>(&'a self, triangles: &'a TriangleIndex<'a>) -> Apart<'a> {
        Apart { rest: &self.rest, suns: &self.suns, source: &self.source, reflects: self.reflects, triangles }
    }
}
