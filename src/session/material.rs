//! What surfaces are made of, as it is asked for.

use crate::error::Result;
use crate::relight::{Exposure, Material};
use crate::scene::{Effects, EmissionRule, MaterialRule, SceneFile};

/// What surfaces are made of, and how bright they are shown; what is not said is that of the scene, else usual.
#[derive(Clone, Debug)]
pub struct MaterialChoice {
    /// Diffuse reflectance; with a colour scale a factor on it; 0.7, if neither is said.
    pub albedo: Option<[f32; 3]>,
    /// A colour scale over the isovalue, `NAME` or `NAME:LOW..HIGH`.
    pub colormap: Option<String>,
    /// Emitted radiance; 0, if it is not said.
    pub emission: Option<[f32; 3]>,
    /// Albedo of the medium of a translucent solid that was baked with nodes.
    pub medium_albedo: Option<[f32; 3]>,
    /// From radiance to colour.
    pub exposure: Exposure,
}

impl MaterialChoice {
    /// Whether the albedo was said.
    pub fn says_albedo(&self) -> bool {
        self.albedo.is_some() || self.colormap.is_some()
    }

    /// The albedo over the isovalue; `range` is that of the volume.
    ///
    /// # Errors
    /// When albedo or emission are none, or as [`MaterialRule::of_colours`].
    pub fn rule(&self, range: (f64, f64)) -> Result<MaterialRule> {
        let albedo = self.albedo.unwrap_or([0.7; 3]);
        Material::new(albedo, self.emission.unwrap_or([0.0; 3]))?;
        MaterialRule::of_colours(self.colormap.as_deref(), albedo, range)
    }

    /// The same, of the scene where it is not said.
    ///
    /// # Errors
    /// As [`Self::rule`].
    pub fn rule_in(&self, scene: Option<&SceneFile>, range: (f64, f64)) -> Result<MaterialRule> {
        match scene.and_then(|file| file.description.albedo.as_ref()) {
            Some(albedo) if !self.says_albedo() => Ok(albedo.rule(range)),
            _ => self.rule(range),
        }
    }

    /// The emission over the isovalue; none where it is switched off.
    pub fn emission_in(&self, scene: Option<&SceneFile>, effects: &Effects) -> EmissionRule {
        if effects.switched("emission") == Some(false) {
            return EmissionRule::Constant([0.0; 3]);
        }
        let of_scene = scene.and_then(|file| file.description.emission.clone());
        match self.emission {
            Some(emission) => EmissionRule::Constant(emission),
            None => of_scene.unwrap_or(EmissionRule::Constant([0.0; 3])),
        }
    }
}
