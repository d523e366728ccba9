//! Light of a store: its environment, and for a scene its luminaires too.

use super::light::Lighting;
use super::{Outcome, text};
use crate::error::Error;
use crate::relight::{Contracted, LuminaireLight, Material, contract, contract_scene};
use crate::transfer::Group;
use crate::transfer::store::Store;

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
pub(super) fn parse_factor(argument: &str) -> Result<Factor, String> {
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
    if let Some(unknown) = factors.iter().find(|f| !names.contains(&f.name)) {
        let remedy = match text::nearest(&unknown.name, names.iter().map(String::as_str)) {
            Some(near) => format!("did you mean {near}?"),
            None => "see the [[luminaires]] of the scene".into(),
        };
        let expected = if names.is_empty() { "a scene with luminaires".into() } else { names.join(", ") };
        return Err(Error::argument("--luminaire", &unknown.name, expected, remedy).into());
    }
    let Some(scene) = &store.identity().scene else { return Ok(contract(store, bricks, light, material)?) };
    if !lighting.suns.is_empty() {
        let expected = "an environment whose lamps stay in it";
        let remedy = "leave it out: rays of a sun that is lit apart do not know the walls of a scene";
        return Err(Error::argument("--sun-split", "a scene with walls or luminaires", expected, remedy).into());
    }
    let emission = store.group(&Group::Emission)?;
    let of_luminaires =
        names.iter().map(|name| store.group(&Group::Luminaire(name.clone()))).collect::<Result<Vec<Store>, Error>>()?;
    let luminaires: Vec<LuminaireLight<'_>> = of_luminaires
        .iter()
        .zip(names.iter().zip(&scene.exponents))
        .map(|(texture, (name, exponent))| {
            let stored = libm::ldexp(1.0, *exponent);
            LuminaireLight { texture, factor: factor_of(name, factors).map(|f| f * stored) }
        })
        .collect();
    Ok(contract_scene(store, &emission, &luminaires, bricks, light, material)?)
}
