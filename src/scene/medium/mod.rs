//! Participating media: what absorbs, scatters and shines between surfaces.
//!
//! # The equation
//! Of light that travels along ω, with lengths in world units, σ in 1/world unit and ∫ p dω = 1:
//! ω·∇L = −σ_t L + σ_s ∫ p(ω′·ω) L(ω′) dω′ + σ_a L_e, σ_t = σ_a + σ_s, albedo a = σ_s/σ_t.
//! (After Qiu et al. 2007, whose solution drops emission and what lies behind, and whose phase functions integrate to 4π.)
//!
//! A medium lies outside the solid, {h ≤ c}. Its extinction does not depend on the isovalue, only where it lies does: so
//! paths that carry an isovalue for life serve all isovalues at once.

mod phase;

pub use phase::{Phase, PhaseTable};

use super::Table;
use crate::error::{Error, Result};
use crate::geom::Bounds;
use crate::level::Pyramid;
use crate::volume::Volume;
use glam::DVec3;
use std::sync::Arc;

/// Most media of a scene: each is walked by every ray.
#[doc(hidden)]
pub const MOST_MEDIA: usize = 8;

/// Where a medium may lie, of what its field covers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MediumRegion {
    /// The box of the volume whose values decide, or that is lit.
    Box,
    /// A box along the axes of the world.
    Within(Bounds),
    /// A ball.
    Ball {
        /// Its centre, in world.
        centre: DVec3,
        /// Its radius, in world units.
        radius: f64,
    },
}

/// The volume over whose values extinction and albedo are tables.
#[derive(Clone, Debug)]
pub enum MediumField {
    /// The lit volume itself.
    Lit,
    /// Another one, where it stands in the world.
    Other {
        /// The volume.
        volume: Arc<Volume>,
        /// Of that volume.
        pyramid: Arc<Pyramid>,
    },
}

/// A translucent solid: a medium within {h > c} behind a smooth boundary.
#[derive(Clone, Debug)]
pub struct Body {
    /// What fills it; a table over the values of the lit volume, or constant.
    pub medium: Medium,
    /// Index of refraction against 1 outside, 1 to 10; 1 has no boundary.
    pub index: f64,
    /// Albedos at which transfer is stored, so that the medium's stays free for relighting ([`albedo_nodes`]); empty where it is
    /// fixed.
    pub nodes: Vec<f64>,
}

impl Body {
    /// Whether it makes sense.
    ///
    /// # Errors
    /// When the medium does not, it shines, its tables are over another volume, the index is below 1, or nodes are not in [0, 1].
    #[doc(hidden)]
    pub fn check(&self) -> Result<()> {
        self.medium.check()?;
        let refuse = |found: String, expected: &str, remedy: &str| {
            Err(Error::argument("the translucent solid", found, expected, remedy))
        };
        if !(1.0..=10.0).contains(&self.index) {
            return refuse(
                format!("index {}", self.index),
                "an index of refraction from 1 to 10",
                "skin and milk have 1.3, marble 1.5",
            );
        }
        if self.medium.emission != [0.0; 3] {
            return refuse("a medium that shines".into(), "one that does not", "give the surface an emission instead");
        }
        if matches!(self.medium.field, MediumField::Other { .. }) || self.medium.region != MediumRegion::Box {
            return refuse(
                "a medium of another volume or region".into(),
                "that of the solid",
                "leave `field` and the region out",
            );
        }
        if self.nodes.len() > MOST_NODES || !self.nodes.iter().all(|a| (0.0..=1.0).contains(a)) {
            return refuse(format!("{} nodes", self.nodes.len()), "up to 15 albedos from 0 to 1", "6 to 12 are enough");
        }
        Ok(())
    }

    /// Layers of its transfer: one a node, or one.
    #[doc(hidden)]
    pub fn layers(&self) -> usize {
        self.nodes.len().max(1)
    }

    pub(super) fn identity(&self) -> String {
        format!("body {} {:?} {:?}", self.medium.identity(), self.index, self.nodes)
    }
}

/// Most nodes: layers of a transfer, one less for none.
const MOST_NODES: usize = 15;

/// Albedos at which transfer is stored so that radiance at any other is interpolated in s = √(1 − a), in which it is smooth
/// (the sum over orders has hundreds of terms): s_q = (1 − cos(πq/(Q−1)))/2, and behind them one more in the middle of the widest
/// gap, by which the interpolation is checked.
pub fn albedo_nodes(count: usize) -> Vec<f64> {
    let count = count.clamp(2, MOST_NODES - 1);
    let node = |q: usize| 0.5 * (1.0 - libm::cos(std::f64::consts::PI * q as f64 / (count - 1) as f64));
    let s: Vec<f64> = (0..count).map(node).collect();
    let widest = (1..count).max_by(|&i, &j| (s[i] - s[i - 1]).total_cmp(&(s[j] - s[j - 1])));
    let check = widest.map_or(0.5, |i| 0.5 * (s[i] + s[i - 1]));
    s.into_iter().chain([check]).map(|s| 1.0 - s * s).collect()
}

/// Factors of the layers of [`albedo_nodes`] at an albedo: barycentric interpolation in √(1 − a) with the weights (−1)^q, halved
/// at both ends; 0 of the node that checks it.
#[doc(hidden)]
pub fn node_factors(nodes: &[f64], albedo: f64) -> Vec<f64> {
    let Some((_, nodes)) = nodes.split_last() else { return Vec::new() };
    let at = |a: f64| (1.0 - a).max(0.0).sqrt();
    let s = at(albedo);
    if let Some(exact) = nodes.iter().position(|&a| at(a) == s) {
        return (0..=nodes.len()).map(|q| f64::from(u8::from(q == exact))).collect();
    }
    let weight = |q: usize| {
        let end = if q == 0 || q + 1 == nodes.len() { 0.5 } else { 1.0 };
        let sign = if q.is_multiple_of(2) { 1.0 } else { -1.0 };
        sign * end / (s - at(nodes[q]))
    };
    let sum: f64 = (0..nodes.len()).map(weight).sum();
    (0..nodes.len()).map(|q| weight(q) / sum).chain([0.0]).collect()
}

/// A medium outside the solid.
#[derive(Clone, Debug)]
pub struct Medium {
    /// Letters, digits, `-` and `_`.
    pub name: String,
    /// Where it may lie.
    pub region: MediumRegion,
    /// Over whose values the tables are.
    pub field: MediumField,
    /// Extinction σ_t per world unit over the values of the field in red, green and blue; one row is a constant.
    pub extinction: Table,
    /// Albedo over the same values, in [0, 1].
    pub albedo: Table,
    /// How it scatters.
    pub phase: Phase,
    /// Radiance L_e of a piece so large that it is opaque, were its albedo 0. A luminaire of the same name carries it.
    pub emission: [f64; 3],
}

impl Medium {
    /// A grey one of constant extinction and albedo in the box of the lit volume.
    ///
    /// # Errors
    /// As [`Self::check`].
    pub fn constant(name: impl Into<String>, extinction: f64, albedo: f64, phase: Phase) -> Result<Self> {
        let grey = |v: f64| Table::new(vec![(0.0, [v as f32; 3])]);
        let medium = Self {
            name: name.into(),
            region: MediumRegion::Box,
            field: MediumField::Lit,
            extinction: grey(extinction)?,
            albedo: grey(albedo)?,
            phase,
            emission: [0.0; 3],
        };
        medium.check()?;
        Ok(medium)
    }

    /// Whether it makes sense.
    ///
    /// # Errors
    /// When an albedo is above 1, the phase function is none, or its region is empty.
    #[doc(hidden)]
    pub fn check(&self) -> Result<()> {
        self.phase.check()?;
        let of = format!("the medium {}", self.name);
        if self.albedo.largest() > 1.0 {
            let remedy = "a medium cannot scatter more than it takes out of the light";
            return Err(Error::argument(of, format!("albedo {}", self.albedo.largest()), "0 to 1", remedy));
        }
        if !self.emission.iter().all(|v| v.is_finite() && *v >= 0.0) {
            let found = format!("emission {:?}", self.emission);
            return Err(Error::argument(of, found, "radiances that are not negative", "give 0 for none"));
        }
        let is_empty = match self.region {
            MediumRegion::Box => false,
            MediumRegion::Within(b) => !(b.min.is_finite() && b.max.is_finite() && b.size().cmpgt(DVec3::ZERO).all()),
            MediumRegion::Ball { centre, radius } => !(centre.is_finite() && radius.is_finite() && radius > 0.0),
        };
        if is_empty {
            let found = format!("{:?}", self.region);
            return Err(Error::argument(
                of,
                found,
                "a region of a finite volume above 0",
                "correct min, max or radius",
            ));
        }
        Ok(())
    }

    /// Whether its extinction is the same everywhere.
    #[doc(hidden)]
    pub fn is_constant(&self) -> bool {
        self.extinction.rows().len() == 1
    }

    /// Whether red, green and blue are dimmed alike.
    #[doc(hidden)]
    pub fn is_grey(&self) -> bool {
        self.extinction.rows().iter().all(|(_, [r, g, b])| r == g && g == b)
    }

    /// Whether there is nothing of it anywhere.
    #[doc(hidden)]
    pub fn is_vacuum(&self) -> bool {
        self.extinction.largest() == 0.0
    }

    /// Its box in world, where `lit` is the volume that is lit.
    #[doc(hidden)]
    pub fn bounds(&self, lit: &Volume) -> Bounds {
        let field = match &self.field {
            MediumField::Lit => lit.world_bounds(),
            MediumField::Other { volume, .. } => volume.world_bounds(),
        };
        let clip = |min: DVec3, max: DVec3| match self.is_constant() {
            true => Bounds { min, max },
            false => Bounds { min: field.min.max(min), max: field.max.min(max) },
        };
        match self.region {
            MediumRegion::Box => field,
            MediumRegion::Within(b) => clip(b.min, b.max),
            MediumRegion::Ball { centre, radius } => clip(centre - radius, centre + radius),
        }
    }

    /// A bound of the optical depth of any free segment, in the densest channel: the diagonal of its box times the largest
    /// extinction.
    #[doc(hidden)]
    pub fn depth_bound(&self, lit: &Volume) -> f64 {
        let size = self.bounds(lit).size();
        if size.cmple(DVec3::ZERO).any() { 0.0 } else { size.length() * f64::from(self.extinction.largest()) }
    }

    /// Everything that decides what it does to light, as text.
    pub(super) fn identity(&self) -> String {
        let Self { region, field, extinction, albedo, phase, emission, .. } = self;
        let field = match field {
            MediumField::Lit => "lit".into(),
            MediumField::Other { volume, .. } => volume.content_hash(),
        };
        format!("{region:?} {field} {extinction:?} {albedo:?} {phase:?} {emission:?}")
    }
}
