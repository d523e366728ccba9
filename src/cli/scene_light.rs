//! Light of a store: its environment, and for a scene its luminaires too.

use super::light::Lighting;
use super::{Outcome, text};
use crate::error::{Error, Result};
use crate::relight::{Contracted, LuminaireLight, Material, Textures, contract};
use crate::transfer::store::Store;
use crate::transfer::{Group, Layers};

/// A factor on the power of a luminaire.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Factor {
    name: String,
    factor: [f64; 3],
}

/// The factor on a luminaire: that given last.
pub(super) fn factor_of(name: &str, factors: &[Factor]) -> [f64; 3] {
    factors.iter().rev().find(|f| f.name == name).map_or([1.0; 3], |f| f.factor)
}

/// Reads NAME=FACTOR or NAME=R,G,B.
pub(super) fn parse_factor(argument: &str) -> std::result::Result<Factor, String> {
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
    Ok(Factor { name: name.into(), factor })
}

/// The textures of a store that are lit together, opened.
pub(super) struct Groups<'a> {
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
    pub(super) fn open(store: &'a Store, factors: &[Factor]) -> Result<Self> {
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
    pub(super) fn textures(&self) -> Result<Textures<'_>> {
        let Some((emission, luminaires)) = &self.others else { return Textures::of_volume(self.store) };
        let luminaires = luminaires.iter().map(|l| LuminaireLight { texture: &l.texture, factor: l.factor });
        Textures::of_scene(self.store, emission, &luminaires.collect::<Vec<_>>())
    }

    /// Layers of the environment's texture.
    pub(super) fn layers(&self) -> &'a Layers {
        &self.store.layout().layers
    }

    /// The luminaires by name, each with the factor on what its texture holds.
    pub(super) fn factors(&self) -> impl Iterator<Item = (&str, [f64; 3])> {
        let luminaires = self.others.iter().flat_map(|(_, luminaires)| luminaires);
        luminaires.map(|l| (l.name.as_str(), l.factor))
    }
}

/// Refuses factors on luminaires that are not there.
pub(super) fn check_factors(names: &[String], factors: &[Factor]) -> Result<()> {
    let Some(unknown) = factors.iter().find(|f| !names.contains(&f.name)) else { return Ok(()) };
    let remedy = match text::nearest(&unknown.name, names.iter().map(String::as_str)) {
        Some(near) => format!("did you mean {near}?"),
        None => "see the [[luminaires]] of the scene".into(),
    };
    let expected = if names.is_empty() { "a scene with luminaires".into() } else { names.join(", ") };
    Err(Error::argument("--luminaire", &unknown.name, expected, remedy))
}

/// The radiance of the texels of some bricks under an environment, and under the luminaires of a scene.
pub(super) fn contracted(
    store: &Store,
    bricks: &[[usize; 3]],
    lighting: &Lighting,
    material: &Material,
    factors: &[Factor],
) -> Outcome<Contracted> {
    let light = &lighting.light;
    let names: &[String] = store.identity().scene.as_ref().map_or(&[], |scene| &scene.luminaires);
    check_factors(names, factors)?;
    if store.identity().scene.is_some() && !lighting.suns.is_empty() {
        let expected = "an environment whose lamps stay in it";
        let remedy = "leave it out: rays of a sun that is lit apart do not know the walls of a scene";
        return Err(Error::argument("--sun-split", "a scene with walls or luminaires", expected, remedy).into());
    }
    Ok(contract(&Groups::open(store, factors)?.textures()?, bricks, light, material)?)
}
