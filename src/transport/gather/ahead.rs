//! The cache among walls, luminaires and other volumes: what a path has ahead of it where it meets its level set.
//!
//! A texel's row holds the coloured layers of the environment, then three numbers a layer of emission and of each luminaire, as
//! stored. A path that has met level sets j times before, with a weight W, adds W T_i to layer j + 1 + i of each texture.

use super::super::REPLICATES;
use super::cache::{Cache, EMPTY_ROW, Lookups, Row, Span, Tally};
use crate::level::CellPoint;
use crate::scene::geometry::Geometry;
use crate::transfer::Layers;
use crate::volume::Volume;

/// Coefficients of a texel's row, from the cached layers of the environment.
pub(super) fn width(cached: &Layers, geometry: Option<&Geometry>) -> usize {
    let others = geometry.map_or(0, |geometry| 1 + geometry.luminaires().len());
    cached.coefficients() + others * cached.channels() * cached.len()
}

/// A cache, for estimates of some layers.
pub(in super::super) struct Ahead<'a> {
    cache: &'a Cache,
    cached: &'a Layers,
    layers: &'a Layers,
    // Of emission and of each luminaire: from what is stored to W m⁻² sr⁻¹.
    factors: Vec<f64>,
    // What is read of a row for an estimate of so many layers more.
    spans: Vec<Vec<Span>>,
    tally: Tally,
}

/// Room for the row of a point, and what its lookups found.
#[derive(Clone, Debug)]
pub(in super::super) struct Read {
    values: Vec<f32>,
    row: Row,
    lookups: Lookups,
}

impl Default for Read {
    fn default() -> Self {
        Self { values: Vec::new(), row: EMPTY_ROW, lookups: Lookups::default() }
    }
}

impl<'a> Ahead<'a> {
    /// From a cache of the layers `cached` to estimates of `layers`.
    pub(super) fn new(
        cache: &'a Cache,
        cached: &'a Layers,
        layers: &'a Layers,
        (volume, geometry): (&Volume, &Geometry),
    ) -> Self {
        let of_luminaires = geometry.exponents(volume).into_iter().map(|e| libm::ldexp(1.0, e));
        let factors: Vec<f64> = std::iter::once(1.0).chain(of_luminaires).collect();
        let of_layers = |count: usize| {
            let environment = if count < cached.len() { cached.offset(count) } else { cached.coefficients() };
            let others = (0..factors.len()).map(|g| (cached.coefficients() + 3 * g * cached.len(), 3 * count));
            let all = std::iter::once((0, environment)).chain(others);
            all.map(|(first, count)| Span { target: first, source: first, count }).collect()
        };
        let spans = (0..=cached.len()).map(of_layers).collect();
        Self { cache, cached, layers, factors, spans, tally: Tally::default() }
    }

    /// Counts what a texel has looked up.
    pub(in super::super) fn count(&self, read: &mut Read) {
        self.tally.add(&std::mem::take(&mut read.lookups));
    }

    /// What all lookups found.
    pub(super) fn lookups(&self) -> Lookups {
        self.tally.total()
    }

    /// Adds what a path of a replicate finds from a point of the level set on, where it enters layer `next`, to the sums of the
    /// environment and of the other groups; false where that is not known.
    pub(in super::super) fn add(
        &self,
        at: &CellPoint,
        (next, replicate): (usize, usize),
        weight: [f64; 3],
        environment: &mut [f64],
        groups: &mut [f64],
        read: &mut Read,
    ) -> bool {
        let (layers, cached) = (self.layers, self.cached);
        let Some(left) = layers.len().checked_sub(next).filter(|&left| left > 0) else { return false };
        read.values.clear();
        read.values.resize(self.cache.width(), 0.0);
        if !self.cache.add(at, &self.spans[left], &mut read.values, &mut read.row, &mut read.lookups) {
            return false;
        }
        let add = |sums: &mut [f64], values: &[f32], weight: f64| {
            sums.iter_mut().zip(values).for_each(|(sum, &value)| *sum += weight * f64::from(value));
        };
        for from in 0..left {
            let square = layers.bands()[next + from].pow(2);
            let held = cached.bands()[from].pow(2);
            let first = replicate * layers.coefficients() + layers.offset(next + from);
            for (c, &weight) in weight.iter().enumerate() {
                let values = &read.values[cached.offset(from) + c * held..][..square];
                add(&mut environment[first + c * square..][..square], values, weight);
            }
            for (g, factor) in self.factors.iter().enumerate() {
                let first = 3 * ((g * REPLICATES + replicate) * layers.len() + next + from);
                let values = &read.values[cached.coefficients() + 3 * (g * cached.len() + from)..][..3];
                for c in 0..3 {
                    add(&mut groups[first + c..=first + c], &values[c..=c], weight[c] * factor);
                }
            }
        }
        true
    }
}
