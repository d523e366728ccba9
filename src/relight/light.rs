//! Distant light as coefficients, one set for each layer of the transfer.

use crate::error::{Error, Result};
use crate::sh::{self, Coefficients};

/// A distant environment as SH coefficients of linear radiance per colour channel, in world axes.
///
/// A light is one set of coefficients for all layers of the transfer, cut at each layer's band
/// limit, or one set a layer. The latter is needed where layers must see different light: each
/// layer a window of its own band limit ([`super::prepare`]).
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    // Invariant: not empty. Layer k takes set k, layers beyond the last set take the last.
    sets: Vec<Set>,
}

#[derive(Clone, Debug, PartialEq)]
struct Set {
    // Invariant: bands² entries, finite.
    bands: usize,
    rgb: Vec<[f64; 3]>,
}

impl Set {
    fn new(rgb: Vec<[f64; 3]>) -> Result<Self> {
        let bands = (1..=sh::MAX_BANDS).find(|n| n * n == rgb.len());
        match bands {
            Some(bands) if rgb.iter().flatten().all(|v| v.is_finite()) => Ok(Self { bands, rgb }),
            _ => Err(Error::argument(
                "environment",
                format!("{} coefficients", rgb.len()),
                "bands² finite coefficients, 1 to 11 bands",
                "project the probe again",
            )),
        }
    }

    fn from_channels(channels: &[Coefficients; 3]) -> Result<Self> {
        let bands = channels.iter().map(Coefficients::bands).max().unwrap_or(1);
        let value = |c: usize, i: usize| channels[c].values().get(i).copied().unwrap_or(0.0);
        Self::new((0..bands * bands).map(|i| [value(0, i), value(1, i), value(2, i)]).collect())
    }
}

impl Light {
    /// One light for all layers from its coefficients, red, green and blue side by side.
    ///
    /// # Errors
    /// When the count is not a square of 1…11, or a coefficient is not finite.
    pub fn new(rgb: Vec<[f64; 3]>) -> Result<Self> {
        Ok(Self { sets: vec![Set::new(rgb)?] })
    }

    /// One light for all layers from its three channels.
    ///
    /// # Errors
    /// When a coefficient is not finite.
    pub fn from_channels(channels: &[Coefficients; 3]) -> Result<Self> {
        Ok(Self { sets: vec![Set::from_channels(channels)?] })
    }

    /// A light for each layer, direct light first; layers beyond the last one given see that one.
    ///
    /// # Errors
    /// When there is none, or a coefficient is not finite.
    pub fn per_layer(layers: &[[Coefficients; 3]]) -> Result<Self> {
        if layers.is_empty() {
            return Err(Error::argument(
                "environment",
                "light for no layer",
                "coefficients for at least the direct light",
                "give a light for each layer of the transfer",
            ));
        }
        Ok(Self { sets: layers.iter().map(Set::from_channels).collect::<Result<_>>()? })
    }

    /// The same radiance from everywhere.
    pub fn constant(radiance: [f64; 3]) -> Self {
        Self { sets: vec![Set { bands: 1, rgb: vec![radiance.map(|v| v * 2.0 * std::f64::consts::PI.sqrt())] }] }
    }

    fn set(&self, layer: usize) -> &Set {
        &self.sets[layer.min(self.sets.len() - 1)]
    }

    /// Number of bands of the light that `layer` sees.
    pub fn bands(&self, layer: usize) -> usize {
        self.set(layer).bands
    }

    /// Coefficients of the light that `layer` sees, red, green and blue side by side.
    pub fn coefficients(&self, layer: usize) -> &[[f64; 3]] {
        &self.set(layer).rgb
    }

    /// The highest band that carries energy in the light of `layer`, plus one: what contraction needs
    /// to read.
    pub fn used_bands(&self, layer: usize) -> usize {
        let Set { bands, rgb } = self.set(layer);
        (1..=*bands).rev().find(|b| rgb[(b - 1) * (b - 1)..b * b].iter().flatten().any(|&v| v != 0.0)).unwrap_or(1)
    }

    /// Radiance that leaves an unoccluded surface of albedo 1 with normal `n` under the direct light, per
    /// channel: Σ (A_l/π) Y_lm(n) L_lm.
    pub fn unoccluded(&self, normal_in_world: [f32; 3]) -> [f32; 3] {
        let Set { bands, rgb } = self.set(0);
        let mut basis = [0.0f64; sh::MAX_BANDS * sh::MAX_BANDS];
        sh::basis::evaluate(*bands, normal_in_world.map(f64::from), &mut basis);
        let mut sum = [0.0f64; 3];
        for l in 0..*bands {
            let factor = sh::CLAMPED_COSINE[l] / std::f64::consts::PI;
            for i in l * l..(l + 1) * (l + 1) {
                for channel in 0..3 {
                    sum[channel] += factor * basis[i] * rgb[i][channel];
                }
            }
        }
        sum.map(|v| v as f32)
    }
}
