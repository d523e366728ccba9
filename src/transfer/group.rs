//! The textures of a scene's store besides that of the environment.

use super::{Layers, Layout};
use crate::error::Result;

/// What a texture of a store answers to.
///
/// That of the environment holds T_k in spherical harmonics. The others hold one number a layer and channel, G_k, so
/// that the level set of albedo ρ sends out Σ_k ρ^(k+1) G_k on behalf of what the group is named after.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Group {
    /// The distant environment.
    Environment,
    /// A luminaire at the power of the scene's description: G_k in W m⁻² sr⁻¹.
    Luminaire(String),
    /// The level set's own emission of radiance 1: G_k is what of it comes back after k further reflections, the chance
    /// to meet the level set k + 1 times, times the albedos of the walls on the way.
    Emission,
}

impl Group {
    /// The name of its group in a store.
    pub fn node(&self) -> String {
        match self {
            Self::Environment => "env".into(),
            Self::Luminaire(name) => format!("luminaire.{name}"),
            Self::Emission => "emission".into(),
        }
    }

    /// The layout of its texture, from that of the environment.
    ///
    /// # Errors
    /// Never: the layers are as many as those of a layout that exists.
    pub fn layout(&self, environment: &Layout) -> Result<Layout> {
        let layers = match self {
            Self::Environment => environment.layers.clone(),
            _ => Layers::uniform(environment.layers.len(), 1)?.coloured(),
        };
        Ok(Layout { lattice: environment.lattice, layers })
    }
}
