//! The textures of a store under a light: its environment, and for a scene its luminaires too.

use super::Lighting;
use crate::error::{Error, Result};
use crate::relight::{ClampReport, Contracted, LuminaireLight, Material, contract, contract_scene};
use crate::scene::nearest;
use crate::transfer::Group;
use crate::transfer::store::Store;

/// A factor on the power of a luminaire.
#[derive(Clone, Debug, PartialEq)]
pub struct LuminaireFactor {
    /// Name of the luminaire.
    pub luminaire: String,
    /// Red, green, blue; finite, not negative. 0 switches it off.
    pub factor: [f64; 3],
}

/// The factor on a luminaire: that given last.
pub(super) fn factor_of(name: &str, factors: &[LuminaireFactor]) -> [f64; 3] {
    factors.iter().rev().find(|f| f.luminaire == name).map_or([1.0; 3], |f| f.factor)
}

/// The radiance of the texels of some bricks under an environment, and under the luminaires of a scene; none is
/// negative under certified light, and what was is told.
///
/// # Errors
/// When the scene has no such luminaire, a factor is negative or not finite, a sun is lit apart in a scene, or the
/// store is damaged.
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

fn contracted(
    store: &Store,
    bricks: &[[usize; 3]],
    lighting: &Lighting<'_>,
    material: &Material,
    factors: &[LuminaireFactor],
) -> Result<Contracted> {
    let light = &lighting.light;
    let names: &[String] = store.identity().scene.as_ref().map_or(&[], |scene| &scene.luminaires);
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
    let Some(scene) = &store.identity().scene else { return contract(store, bricks, light, material) };
    if !lighting.suns.is_empty() {
        let expected = "an environment whose lamps stay in it";
        let remedy = "leave it out: rays of a sun that is lit apart do not know the walls of a scene";
        return Err(Error::argument("sun split", "a scene with walls or luminaires", expected, remedy));
    }
    let emission = store.group(&Group::Emission)?;
    let of_luminaires =
        names.iter().map(|name| store.group(&Group::Luminaire(name.clone()))).collect::<Result<Vec<Store>>>()?;
    let luminaires: Vec<LuminaireLight<'_>> = of_luminaires
        .iter()
        .zip(names.iter().zip(&scene.exponents))
        .map(|(texture, (name, exponent))| {
            let stored = libm::ldexp(1.0, *exponent);
            LuminaireLight { texture, factor: factor_of(name, factors).map(|f| f * stored) }
        })
        .collect();
    contract_scene(store, &emission, &luminaires, bricks, light, material)
}
