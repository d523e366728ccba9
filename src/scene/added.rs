//! What options put around and into a volume alone: fog, a translucent body, an environment that is fixed before the bake.

use super::geometry::{Geometry, Luminaire, LuminaireShape};
use super::medium::{Body, Medium, Phase, albedo_nodes};
use super::{Effects, Scene, SceneFile, VolumeOptions, distant_light};
use crate::error::{Error, Result};
use crate::probe::{EnvFrame, Orientation, Probe};
use std::str::FromStr;

/// How a volume or a scene is opened, and what is put around it.
#[derive(Clone, Debug, Default)]
pub struct SceneOptions {
    /// How volumes are to be understood.
    pub volume: VolumeOptions,
    /// Effects switched by hand.
    pub effects: Effects,
    /// Fog in the box of a volume.
    pub fog: Option<Fog>,
    /// A translucent solid.
    pub translucent: Option<Translucent>,
}

impl SceneOptions {
    /// Opens a volume, a field or a scene by name; of `file`, where the scene was read already.
    ///
    /// # Errors
    /// As [`Scene::open_with`] and [`Scene::with_added`].
    pub fn open(&self, name: &str, file: Option<&SceneFile>) -> Result<Scene> {
        let scene = match file {
            Some(file) => file.open(&self.volume, &self.effects)?,
            None => Scene::open_with(name, &self.volume, &self.effects)?,
        };
        scene.with_added(self.fog, self.translucent, &self.effects)
    }
}

/// Fog of constant extinction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fog {
    /// Per world unit.
    pub extinction: f64,
    /// Of its scattering.
    pub albedo: f64,
    /// Mean cosine of its scattering.
    pub mean_cosine: f64,
}

/// A translucent solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Translucent {
    /// Per world unit.
    pub extinction: f64,
    /// Albedo of its medium; free for relighting, if none.
    pub albedo: Option<f64>,
    /// Mean cosine of its scattering.
    pub mean_cosine: f64,
    /// Index of refraction.
    pub index: f64,
}

impl FromStr for Fog {
    /// What to give instead.
    type Err = String;

    /// Reads extinction, albedo and mean cosine, such as 0.02,0.9,0.5.
    fn from_str(argument: &str) -> std::result::Result<Self, String> {
        let expected = "give the extinction per world unit, and perhaps albedo (0 to 1) and mean cosine (-1 to 1), such as 0.02,0.9,0.5";
        let numbers: Option<Vec<f64>> = argument.split(',').map(|n| n.trim().parse().ok()).collect();
        let (extinction, albedo, g) = match numbers.as_deref() {
            Some(&[extinction]) => (extinction, 1.0, 0.0),
            Some(&[extinction, albedo]) => (extinction, albedo, 0.0),
            Some(&[extinction, albedo, g]) => (extinction, albedo, g),
            _ => return Err(expected.into()),
        };
        let legal = extinction.is_finite() && extinction >= 0.0 && (0.0..=1.0).contains(&albedo) && g.abs() < 1.0;
        if legal { Ok(Fog { extinction, albedo, mean_cosine: g }) } else { Err(expected.into()) }
    }
}

impl FromStr for Translucent {
    /// What to give instead.
    type Err = String;

    /// Reads extinction, albedo (or free), mean cosine and index, such as 0.1,0.95,0.5,1.4.
    fn from_str(argument: &str) -> std::result::Result<Self, String> {
        let expected = "give the extinction per world unit, and perhaps albedo (0 to 1, or free), mean cosine (-1 to 1) and index of \
            refraction (1 to 10), such as 0.1,0.95,0.5,1.4";
        let parts: Vec<&str> = argument.split(',').map(str::trim).collect();
        let number =
            |i: usize, otherwise: f64| parts.get(i).map_or(Ok(otherwise), |t| t.parse::<f64>().map_err(|_| expected));
        if parts.len() > 4 {
            return Err(expected.into());
        }
        let extinction = number(0, 0.0)?;
        let albedo = if parts.get(1) == Some(&"free") { None } else { Some(number(1, FREE_ALBEDO)?) };
        let (mean_cosine, index) = (number(2, 0.0)?, number(3, 1.0)?);
        let legal = extinction.is_finite()
            && extinction >= 0.0
            && albedo.is_none_or(|a| (0.0..=1.0).contains(&a))
            && mean_cosine.abs() < 1.0
            && (1.0..=10.0).contains(&index);
        if legal { Ok(Translucent { extinction, albedo, mean_cosine, index }) } else { Err(expected.into()) }
    }
}

/// Nodes of a medium whose albedo is free, besides the one that checks them.
const NODES: usize = 8;
/// Albedo of such a medium where nothing else is said.
const FREE_ALBEDO: f64 = 0.95;

impl Scene {
    /// The same with fog in the box of the volume and with its solid translucent, where these are given and not switched off.
    ///
    /// # Errors
    /// As [`Scene::with_medium`] and [`Scene::with_body`].
    #[doc(hidden)]
    pub fn with_added(self, fog: Option<Fog>, translucent: Option<Translucent>, effects: &Effects) -> Result<Self> {
        let mut scene = self;
        let is_on = effects.switched("media") != Some(false);
        let phase = |g: f64| if g == 0.0 { Phase::Isotropic } else { Phase::HenyeyGreenstein(g) };
        if let Some(Fog { extinction, albedo, mean_cosine }) = fog.filter(|_| is_on) {
            let fog = Medium::constant("fog", extinction, albedo, phase(mean_cosine))?;
            scene = scene.with_medium(fog).map_err(|e| named("--fog", e))?;
        }
        if let Some(of) = translucent.filter(|_| is_on) {
            let albedo = of.albedo.unwrap_or(FREE_ALBEDO);
            let medium = Medium::constant("body", of.extinction, albedo, phase(of.mean_cosine))?;
            let nodes = if of.albedo.is_none() { albedo_nodes(NODES) } else { Vec::new() };
            let body = Body { medium, index: of.index, nodes };
            scene = scene.with_body(body).map_err(|e| named("--translucent", e))?;
        }
        Ok(scene)
    }

    /// Makes an environment, turned by so many degrees, the luminaire of a volume alone.
    ///
    /// # Errors
    /// When something stands around the volume.
    #[doc(hidden)]
    pub fn fix_environment(&mut self, probe: &Probe, turned: f64, frame: EnvFrame) -> Result<()> {
        let remedy = "write it into the scene: [[luminaires]] with shape = \"environment\" and image";
        let [member] = self.members_mut() else {
            return Err(Error::argument("--fixed-env", "several volumes", "one volume alone", remedy));
        };
        let media = member.geometry.as_ref().map_or(Vec::new(), |geometry| geometry.media().to_vec());
        let is_bare = |g: &Geometry| g.parts() == 0 && g.luminaires().is_empty();
        if !member.geometry.as_ref().is_none_or(is_bare) {
            return Err(Error::argument("--fixed-env", "walls or luminaires", "a volume alone", remedy));
        }
        let orientation = Orientation::new(member.volume.up, turned)?.in_frame(frame);
        let shape = LuminaireShape::Environment(distant_light(probe, orientation));
        let luminaire = Luminaire { name: "environment".into(), shape, power: [1.0; 3] };
        member.geometry = Some(Geometry::new(Vec::new(), vec![luminaire], 1.0)?.with_media(media)?);
        Ok(())
    }
}

/// The error about a value that an option gave.
fn named(option: &str, error: Error) -> Error {
    match error {
        Error::Argument { given, expected, remedy, .. } => Error::argument(option, given, expected, remedy),
        other => other,
    }
}
