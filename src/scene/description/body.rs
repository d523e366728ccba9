//! `[material]` with `kind = "translucent"`.

use super::media::{MOST, phase_of, table};
use super::read::Item;
use crate::error::{Error, Result};
use crate::scene::Table;
use crate::scene::medium::{Body, Medium, MediumField, MediumRegion, Phase, albedo_nodes};

/// A translucent solid as described.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyDescription {
    /// Its line.
    pub line: usize,
    strength: Strength,
    albedo: Option<Table>,
    nodes: Option<usize>,
    phase: Phase,
    index: Option<f64>,
}

#[derive(Clone, Debug, PartialEq)]
enum Strength {
    /// Per world unit.
    Extinction(Table),
    /// In world units.
    MeanFreePath(f64),
    /// In metres.
    MeanFreePathInMetres(f64),
    Preset(&'static Preset),
}

/// Reduced scattering and absorption in red, green and blue per millimetre, and the index.
#[derive(Debug, PartialEq)]
struct Preset {
    name: &'static str,
    scattering: [f64; 3],
    absorption: [f64; 3],
    index: f64,
}

/// Marble, milk and skin: Jensen, Marschner, Levoy and Hanrahan 2001, table 1 ("marble", "whole milk", "skin1"). Bone and wax are
/// chosen to look like it; nobody measured them.
const PRESETS: [Preset; 5] = [
    Preset { name: "marble", scattering: [2.19, 2.62, 3.00], absorption: [0.0021, 0.0041, 0.0071], index: 1.5 },
    Preset { name: "milk", scattering: [2.55, 3.21, 3.77], absorption: [0.0011, 0.0024, 0.014], index: 1.3 },
    Preset { name: "skin", scattering: [0.74, 0.88, 1.01], absorption: [0.032, 0.17, 0.48], index: 1.3 },
    Preset { name: "bone", scattering: [1.6, 1.8, 2.0], absorption: [0.02, 0.03, 0.05], index: 1.55 },
    Preset { name: "wax", scattering: [1.2, 1.3, 1.4], absorption: [0.001, 0.003, 0.010], index: 1.44 },
];
/// Units of lengths, in metres.
const UNITS: [(&str, f64); 7] =
    [("mm", 1e-3), ("cm", 1e-2), ("um", 1e-6), ("µm", 1e-6), ("nm", 1e-9), ("Å", 1e-10), ("m", 1.0)];
const KEYS: [&str; 10] = [
    "kind",
    "preset",
    "extinction",
    "mean_free_path",
    "albedo",
    "albedo_nodes",
    "phase",
    "index",
    "emission",
    "colormap",
];
/// Albedo of the medium where nothing is said.
const ALBEDO: f32 = 0.95;

/// The solid's medium; `None` where light does not pass through it.
pub(super) fn read(item: &Item<'_>) -> Result<Option<BodyDescription>> {
    let Some(kind) = item.peek("kind") else { return Ok(None) };
    if kind.word(&["diffuse", "translucent"])? == "diffuse" {
        return Err(kind.refuse("\"translucent\", or no key `kind`", "take it out: a surface is diffuse without it"));
    }
    let section = item.section(&KEYS)?;
    for key in ["emission", "colormap"] {
        if let Some(other) = section.get(key) {
            return Err(other.refuse("no such key beside kind = \"translucent\"", "take it out"));
        }
    }
    let given = ["preset", "extinction", "mean_free_path"].map(|key| section.get(key));
    let strength = match given {
        [Some(preset), None, None] => {
            let name = preset.word(&PRESETS.each_ref().map(|p| p.name))?;
            let found = PRESETS.iter().find(|p| p.name == name);
            Strength::Preset(found.ok_or_else(|| preset.refuse("a preset", "choose another"))?)
        }
        [None, Some(extinction), None] => {
            Strength::Extinction(table(&extinction, MOST, "extinctions per world unit that are not negative")?)
        }
        [None, None, Some(path)] => mean_free_path(&path)?,
        _ => {
            let remedy = "write preset = \"marble\", extinction = 0.1 per world unit, or mean_free_path = \"0.4 mm\"";
            return Err(item.refuse("one of preset, extinction and mean_free_path", remedy));
        }
    };
    let is_preset = matches!(strength, Strength::Preset(_));
    if let Some(own) = ["albedo", "phase", "index"].into_iter().find_map(|key| section.get(key)).filter(|_| is_preset) {
        return Err(own.refuse("no such key beside `preset`, which has it", "take one of them out"));
    }
    let albedo = section.get("albedo").map(|a| table(&a, 1.0, "albedos from 0 to 1")).transpose()?;
    let nodes = section.get("albedo_nodes").map(|n| Ok::<_, Error>(n.integer(2..=14)? as usize)).transpose()?;
    let index = section.get("index").map(|i| i.number()).transpose()?;
    if let Some(item) = section.get("index").filter(|_| index.is_some_and(|n| !(1.0..=10.0).contains(&n))) {
        return Err(item.refuse("an index of refraction from 1 to 10", "1 has no boundary, skin 1.3, marble 1.5"));
    }
    let phase = section.get("phase").map_or(Ok(Phase::Isotropic), |item| phase_of(&item))?;
    let line = item.line();
    Ok(Some(BodyDescription { line, strength, albedo, nodes, phase, index }))
}

/// A number of world units, or text with a unit.
fn mean_free_path(item: &Item<'_>) -> Result<Strength> {
    let refuse = || item.refuse("a length above 0, such as 0.4 or \"0.4 mm\"", "write it with a unit in quotes");
    let positive = |v: f64| if v > 0.0 && v.is_finite() { Ok(v) } else { Err(refuse()) };
    if let Some(number) = item.as_number() {
        return Ok(Strength::MeanFreePath(positive(number)?));
    }
    let text = item.as_text().ok_or_else(refuse)?.trim();
    let (unit, metres) = UNITS.iter().find(|(unit, _)| text.ends_with(unit)).ok_or_else(refuse)?;
    let number: f64 = text.trim_end_matches(unit).trim().parse().map_err(|_| refuse())?;
    Ok(Strength::MeanFreePathInMetres(positive(number * metres)?))
}

impl BodyDescription {
    /// The solid in a world whose unit is so many metres.
    ///
    /// # Errors
    /// When lengths have a unit and the world has none, or [`Body::check`] does not like it.
    pub fn body(&self, metres_per_unit: Option<f64>) -> Result<Body> {
        let metres = || {
            metres_per_unit.ok_or_else(|| {
                let remedy =
                    "write metres_per_unit = 0.001 for millimetres into the scene, or give extinction per world unit";
                let found = "a length in metres, in a volume without a unit";
                Error::argument("material", found, "a volume that says its unit", remedy)
            })
        };
        let constant = |v: [f64; 3]| Table::new(vec![(0.0, v.map(|v| v as f32))]);
        let mut index = self.index.unwrap_or(1.0);
        let mut albedo = match &self.albedo {
            Some(table) => table.clone(),
            None => constant([f64::from(ALBEDO); 3])?,
        };
        let extinction = match &self.strength {
            Strength::Extinction(table) => table.clone(),
            Strength::MeanFreePath(length) => constant([1.0 / length; 3])?,
            Strength::MeanFreePathInMetres(length) => constant([metres()? / length; 3])?,
            Strength::Preset(Preset { scattering, absorption, index: of_preset, .. }) => {
                let per_unit = 1e3 * metres()?;
                index = *of_preset;
                albedo = constant(std::array::from_fn(|c| scattering[c] / (scattering[c] + absorption[c])))?;
                constant(std::array::from_fn(|c| per_unit * (scattering[c] + absorption[c])))?
            }
        };
        let medium = Medium {
            name: "body".into(),
            region: MediumRegion::Box,
            field: MediumField::Lit,
            extinction,
            albedo,
            phase: self.phase.clone(),
            emission: [0.0; 3],
        };
        let body = Body { medium, index, nodes: self.nodes.map_or(Vec::new(), albedo_nodes) };
        body.check()?;
        Ok(body)
    }
}
