//! The textures of a store under a light: its environment, and for a scene its luminaires too.

use super::Lighting;
use crate::error::{Error, Result};
use crate::relight::{ClampReport, Contracted, LayerFactors, LuminaireLight, Material, Textures, contract};
use crate::scene::medium::node_factors;
use crate::scene::nearest;
use crate::transfer::store::{BodyIdentity, Store};
use crate::transfer::{Group, Layers, MAX_LAYERS};
use std::str::FromStr;

/// A factor on the power of a luminaire.
#[derive(Clone, Debug, PartialEq)]
pub struct LuminaireFactor {
    /// Name of the luminaire.
    pub luminaire: String,
    /// Red, green, blue; finite, not negative. 0 switches it off.
    pub factor: [f64; 3],
}

impl FromStr for LuminaireFactor {
    /// What to give instead.
    type Err = String;

    /// Reads NAME=FACTOR or NAME=R,G,B.
    fn from_str(argument: &str) -> std::result::Result<Self, String> {
        let expected = "give the name of a luminaire and a factor, such as ceiling=2 or ceiling=1,0.8,0.6";
        let (name, numbers) = argument.split_once('=').ok_or(expected)?;
        let numbers: Option<Vec<f64>> = numbers.split(',').map(|n| n.trim().parse().ok()).collect();
        let factor = match numbers.as_deref() {
            Some(&[one]) => [one; 3],
            Some(&[r, g, b]) => [r, g, b],
            _ => return Err(expected.into()),
        };
        if name.is_empty() || !factor.iter().all(|f| f.is_finite() && *f >= 0.0) {
            return Err("factors are finite and not negative; 0 switches a luminaire off".into());
        }
        Ok(LuminaireFactor { luminaire: name.into(), factor })
    }
}

/// The factor on a luminaire: that given last.
pub fn factor_of(name: &str, factors: &[LuminaireFactor]) -> [f64; 3] {
    factors.iter().rev().find(|f| f.luminaire == name).map_or([1.0; 3], |f| f.factor)
}

/// The textures of a store that are lit together, opened.
pub struct Groups<'a> {
    store: &'a Store,
    // Of emission, and of the luminaires.
    others: Option<(Store, Vec<Luminaire>)>,
}

/// A luminaire's texture, and the factor on what it holds.
struct Luminaire {
    name: String,
    texture: Store,
    factor: [f64; 3],
}

impl<'a> Groups<'a> {
    /// Opens the groups of a store, for luminaires of some factors.
    ///
    /// # Errors
    /// When a group is missing or damaged.
    pub fn open(store: &'a Store, factors: &[LuminaireFactor]) -> Result<Self> {
        let Some(scene) = &store.identity().scene else { return Ok(Self { store, others: None }) };
        let luminaires = scene.luminaires.iter().zip(&scene.exponents).map(|(name, exponent)| {
            let stored = libm::ldexp(1.0, *exponent);
            let texture = store.group(&Group::Luminaire(name.clone()))?;
            Ok(Luminaire { name: name.clone(), texture, factor: factor_of(name, factors).map(|f| f * stored) })
        });
        let luminaires = luminaires.collect::<Result<_>>()?;
        Ok(Self { store, others: Some((store.group(&Group::Emission)?, luminaires)) })
    }

    /// All of them.
    ///
    /// # Errors
    /// When their layouts do not fit together.
    pub fn textures(&self) -> Result<Textures<'_>> {
        let Some((emission, luminaires)) = &self.others else { return Textures::of_volume(self.store) };
        let luminaires = luminaires.iter().map(|l| LuminaireLight { texture: &l.texture, factor: l.factor });
        Textures::of_scene(self.store, emission, &luminaires.collect::<Vec<_>>())
    }

    /// Layers of the environment's texture.
    pub fn layers(&self) -> &'a Layers {
        &self.store.layout().layers
    }

    /// The luminaires by name, each with the factor on what its texture holds.
    pub fn factors(&self) -> impl Iterator<Item = (&str, [f64; 3])> {
        let luminaires = self.others.iter().flat_map(|(_, luminaires)| luminaires);
        luminaires.map(|l| (l.name.as_str(), l.factor))
    }
}

/// Refuses factors on luminaires that are not there, and those that make no sense.
///
/// # Errors
/// When the scene has no such luminaire, or a factor is negative or not finite.
pub fn check_factors(names: &[String], factors: &[LuminaireFactor]) -> Result<()> {
    if let Some(unknown) = factors.iter().find(|f| !names.contains(&f.luminaire)) {
        let remedy = match nearest(&unknown.luminaire, names.iter().map(String::as_str)) {
            Some(near) => format!("did you mean {near}?"),
            None => "see the [[luminaires]] of the scene".into(),
        };
        let expected = if names.is_empty() { "a scene with luminaires".into() } else { names.join(", ") };
        return Err(Error::argument("luminaire", &unknown.luminaire, expected, remedy));
    }
    if let Some(wrong) = factors.iter().find(|f| !f.factor.iter().all(|v| v.is_finite() && *v >= 0.0)) {
        let given = format!("{}={:?}", wrong.luminaire, wrong.factor);
        return Err(Error::argument("luminaire", given, "finite factors of at least 0", "0 switches it off"));
    }
    Ok(())
}

/// The radiance of the texels of some bricks under an environment, and under the luminaires of a scene; none is
/// negative under certified light, and what was is told.
///
/// # Errors
/// When the scene has no such luminaire, a factor is negative or not finite, or the store is damaged.
pub fn radiance_of_bricks(
    store: &Store,
    bricks: &[[usize; 3]],
    lighting: &Lighting<'_>,
    material: &Material,
    factors: &[LuminaireFactor],
) -> Result<(Contracted, Option<ClampReport>)> {
    let mut contracted = contracted(store, bricks, lighting, material, factors)?;
    let clamped = lighting.is_certified().then(|| contracted.clamp_negative());
    Ok((contracted, clamped))
}

/// The material as the layers of a store count: of a translucent solid those of its medium's albedo, that of the bake where none
/// was chosen ([`with_medium_albedo`]).
pub(super) fn settled(store: &Store, material: &Material) -> Material {
    let scene = store.identity().scene.as_ref().filter(|_| material.layers == LayerFactors::Reflections);
    let layers = match scene {
        Some(scene) if scene.body.is_some() => scene.body.as_ref().map(|body| factors_of(body, body.albedo)),
        Some(scene) if scene.media => Some(LayerFactors::ReflectionsInMedia),
        _ => None,
    };
    Material { layers: layers.unwrap_or(material.layers), ..*material }
}

/// Factors of the layers of a translucent solid at an albedo of its medium.
fn factors_of(body: &BodyIdentity, albedo: [f32; 3]) -> LayerFactors {
    let mut factors = [[0.0f32; 3]; MAX_LAYERS];
    if body.nodes.is_empty() {
        factors[0] = [1.0; 3];
        return LayerFactors::Given(factors);
    }
    for c in 0..3 {
        let of_channel = node_factors(&body.nodes, f64::from(albedo[c]));
        factors.iter_mut().zip(of_channel).for_each(|(all, factor)| all[c] = factor as f32);
    }
    LayerFactors::Given(factors)
}

/// Factors of the difference between interpolation and the node that checks it, and of that node.
pub(super) fn check_factors_of_nodes(store: &Store) -> Option<(LayerFactors, LayerFactors)> {
    let body = store.identity().scene.as_ref()?.body.as_ref()?;
    let (last, check) = (body.nodes.len().checked_sub(1)?, *body.nodes.last()?);
    let (mut difference, mut there) = ([[0.0f32; 3]; MAX_LAYERS], [[0.0f32; 3]; MAX_LAYERS]);
    difference.iter_mut().zip(node_factors(&body.nodes, check)).for_each(|(all, factor)| *all = [factor as f32; 3]);
    (difference[last], there[last]) = ([-1.0; 3], [1.0; 3]);
    Some((LayerFactors::Given(difference), LayerFactors::Given(there)))
}

/// The same surface of a translucent solid with another albedo of its medium, in [0, 1].
///
/// # Errors
/// When light does not pass through the solid of the store, its albedo was fixed by the bake, or the albedo is not in [0, 1].
pub fn with_medium_albedo(store: &Store, material: &Material, albedo: [f32; 3]) -> Result<Material> {
    let refuse =
        |found: &str, expected: &str, remedy: &str| Err(Error::argument("medium albedo", found, expected, remedy));
    let Some(body) = store.identity().scene.as_ref().and_then(|scene| scene.body.as_ref()) else {
        return refuse("a store whose solid is opaque", "a translucent one", "bake it with --translucent SIGMA,free");
    };
    if body.nodes.is_empty() {
        return refuse(
            "a store whose medium has a fixed albedo",
            "one with nodes",
            "bake it with --translucent SIGMA,free",
        );
    }
    if !albedo.iter().all(|a| (0.0..=1.0).contains(a)) {
        return refuse(&format!("{albedo:?}"), "numbers from 0 to 1", "1 scatters all of the light");
    }
    Ok(Material { layers: factors_of(body, albedo), ..*material })
}

/// Refuses a translucent solid where its layers are taken for reflections.
///
/// # Errors
/// When light passes through the solid of the store.
pub fn refuse_body(store: &Store, what: &str) -> Result<()> {
    if store.identity().scene.as_ref().is_none_or(|scene| scene.body.is_none()) {
        return Ok(());
    }
    let found = "a translucent solid, whose layers are no reflections";
    Err(Error::argument(what, found, "an opaque one", "write .glb, .ply or .png of it with relight"))
}

fn contracted(
    store: &Store,
    bricks: &[[usize; 3]],
    lighting: &Lighting<'_>,
    material: &Material,
    factors: &[LuminaireFactor],
) -> Result<Contracted> {
    let light = &lighting.light;
    let names: &[String] = store.identity().scene.as_ref().map_or(&[], |scene| &scene.luminaires);
    check_factors(names, factors)?;
    contract(&Groups::open(store, factors)?.textures()?, bricks, light, &settled(store, material))
}
