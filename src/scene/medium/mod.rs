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
    pub fn is_constant(&self) -> bool {
        self.extinction.rows().len() == 1
    }

    /// Whether red, green and blue are dimmed alike.
    pub fn is_grey(&self) -> bool {
        self.extinction.rows().iter().all(|(_, [r, g, b])| r == g && g == b)
    }

    /// Whether there is nothing of it anywhere.
    pub fn is_vacuum(&self) -> bool {
        self.extinction.largest() == 0.0
    }

    /// Its box in world, where `lit` is the volume that is lit.
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
