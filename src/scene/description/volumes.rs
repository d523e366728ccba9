//! The sections `[[volumes]]` and the key `coupling`: several volumes whose surfaces light each other.

use super::Located;
use super::read::{Item, Section};
use super::surroundings::{name, required, rotation, scale, share, vector};
use crate::error::Result;
use crate::scene::Coupling;
use crate::scene::geometry::MOST_PARTNERS;
use crate::volume::Solid;
use glam::{DMat3, DVec3};

/// A volume among others.
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeDescription {
    /// Its name: that of its groups in the store.
    pub name: Located<String>,
    /// A path from the folder of the scene, or a field such as `gyroid:96`.
    pub volume: Located<String>,
    /// Which side is matter.
    pub solid: Option<Solid>,
    /// Linear part of the map from the world of its file to that of the scene.
    pub world_from_file: DMat3,
    /// Where the origin of its file's world comes to stand.
    pub translate: DVec3,
    /// Factor on the albedo of the material, baked into the transfer.
    pub albedo: [f32; 3],
}

const KEYS: [&str; 7] = ["name", "volume", "solid", "scale", "translate", "rotate", "albedo"];

/// The volumes and what couples them; nothing where the scene has one volume.
pub(super) fn read(all: &Section<'_>) -> Result<(Vec<VolumeDescription>, Option<Located<Coupling>>)> {
    let Some(item) = all.get("volumes") else {
        if let Some(coupling) = all.get("coupling") {
            return Err(coupling.refuse("[[volumes]], which it couples", "take it out, or name two volumes"));
        }
        return Ok((Vec::new(), None));
    };
    for key in ["volume", "solid"] {
        if let Some(both) = all.get(key) {
            let remedy = format!("write `{key}` below each [[volumes]]");
            return Err(both.refuse("a scene with [[volumes]]", remedy));
        }
    }
    let list = item.list().ok_or_else(|| item.refuse("tables", "write [[volumes]] on a line of its own"))?;
    if !(2..=MOST_PARTNERS + 1).contains(&list.len()) {
        let expected = format!("two to {} volumes (found {})", MOST_PARTNERS + 1, list.len());
        return Err(item.refuse(expected, "write volume = \"…\" for one volume alone"));
    }
    let mut volumes: Vec<VolumeDescription> = Vec::new();
    for (i, item) in list.iter().enumerate() {
        let volume = one(item, &format!("volume{}", i + 1))?;
        if !volume.name.value.starts_with(|c: char| c.is_ascii_alphanumeric()) {
            return Err(item.refuse("a name that begins with a letter or a digit", "it names groups in the store"));
        }
        if volumes.iter().any(|other| other.name.value == volume.name.value) {
            return Err(item.refuse(
                format!("names that differ; two are {}", volume.name.value),
                "give each its own, as in name = \"inner\"",
            ));
        }
        volumes.push(volume);
    }
    let Some(item) = all.get("coupling") else {
        let remedy = "write coupling = \"normalised\", \"equal\", or rows of isovalues such as [[47, 0.6]]";
        return Err(item.refuse("the key `coupling`: which isovalues are shown together", remedy));
    };
    let value = coupling(&item, volumes.len())?;
    Ok((volumes, Some(Located { value, line: item.line() })))
}

fn one(item: &Item<'_>, otherwise: &str) -> Result<VolumeDescription> {
    let section = item.section(&KEYS)?;
    let volume =
        required(&section, item, "volume", "write volume = \"brain.nii.gz\", or a field such as \"gyroid:64\"")?;
    let translate = section.get("translate").map(|t| vector(&t)).transpose()?.unwrap_or(DVec3::ZERO);
    Ok(VolumeDescription {
        name: name(&section, item, otherwise)?,
        volume: Located { value: volume.text()?.to_string(), line: volume.line() },
        solid: section.get("solid").map(|item| super::side(&item)).transpose()?,
        world_from_file: rotation(&section)? * scale(&section)?,
        translate,
        albedo: section.get("albedo").map(|item| share(&item)).transpose()?.unwrap_or([1.0; 3]),
    })
}

fn coupling(item: &Item<'_>, volumes: usize) -> Result<Coupling> {
    if item.as_text().is_some() {
        return Ok(if item.word(&["normalised", "equal"])? == "equal" {
            Coupling::Equal
        } else {
            Coupling::Normalised
        });
    }
    let remedy = "write \"normalised\", \"equal\", or rows such as [[47, 0.6], [100, 0.9]]";
    let refuse = || item.refuse(format!("rows of {volumes} isovalues, one of each volume"), remedy);
    let rows = item.list().ok_or_else(refuse)?;
    let row = |row: &Item<'_>| -> Result<Vec<f64>> {
        let row = row.list().ok_or_else(refuse)?.iter().map(Item::number).collect::<Result<Vec<_>>>()?;
        if row.len() == volumes { Ok(row) } else { Err(refuse()) }
    };
    let rows = rows.iter().map(row).collect::<Result<Vec<_>>>()?;
    if rows.is_empty() { Err(refuse()) } else { Ok(Coupling::Rows(rows)) }
}
