//! The section `[medium]`, or several `[[medium]]`.

use super::VolumeDescription;
use super::read::{Item, Section};
use super::surroundings::{colour, name, vector};
use crate::error::{Error, Result};
use crate::geom::Bounds;
use crate::scene::Table;
use crate::scene::medium::{MOST_MEDIA, Medium, MediumField, MediumRegion, Phase, PhaseTable};
use glam::DVec3;

/// Over whose values the tables of a medium are.
#[derive(Clone, Debug, PartialEq)]
pub enum FieldDescription {
    /// The lit volume itself.
    Lit,
    /// The volume of the scene of that name.
    Volume(String),
    /// A path from the folder of the scene, or a field such as `gyroid:96`.
    File(String),
}

/// A medium as described.
#[derive(Clone, Debug, PartialEq)]
pub struct MediumDescription {
    /// Its name.
    pub name: String,
    /// Its line.
    pub line: usize,
    /// Over whose values its tables are.
    pub field: FieldDescription,
    /// Where it may lie.
    pub region: MediumRegion,
    /// Per world unit.
    pub extinction: Table,
    /// In [0, 1].
    pub albedo: Table,
    /// How it scatters.
    pub phase: Phase,
    /// Radiance of an opaque piece.
    pub emission: [f64; 3],
}

impl MediumDescription {
    /// Whether it sends out light.
    pub fn shines(&self) -> bool {
        self.emission != [0.0; 3]
    }

    /// The medium over a field.
    pub fn with_field(&self, field: MediumField) -> Medium {
        let Self { name, region, extinction, albedo, phase, emission, .. } = self.clone();
        Medium { name, region, field, extinction, albedo, phase, emission }
    }
}

const KEYS: [&str; 12] =
    ["name", "where", "field", "volume", "extinction", "albedo", "phase", "emission", "min", "max", "centre", "radius"];
/// Largest extinction and radiance.
pub(super) const MOST: f64 = 1e30;
const PHASES: [&str; 6] = ["isotropic", "hg", "schlick", "rayleigh", "table", "mix"];

pub(super) fn read(all: &Section<'_>, volumes: &[VolumeDescription]) -> Result<Vec<MediumDescription>> {
    let Some(item) = all.get("medium") else { return Ok(Vec::new()) };
    let list = match item.list() {
        Some(list) => list,
        None => vec![item.clone()],
    };
    if list.is_empty() || list.len() > MOST_MEDIA {
        let expected = format!("one to {MOST_MEDIA} media (found {})", list.len());
        return Err(item.refuse(expected, "put some together in one table"));
    }
    let mut media: Vec<MediumDescription> = Vec::new();
    for (i, item) in list.iter().enumerate() {
        let otherwise = if list.len() == 1 { "medium".to_string() } else { format!("medium{}", i + 1) };
        let medium = one(item, &otherwise, volumes)?;
        if media.iter().any(|other| other.name == medium.name) {
            let expected = format!("names that differ; two are {}", medium.name);
            return Err(item.refuse(expected, "give each its own, as in name = \"fog\""));
        }
        media.push(medium);
    }
    Ok(media)
}

fn one(item: &Item<'_>, otherwise: &str, volumes: &[VolumeDescription]) -> Result<MediumDescription> {
    let section = item.section(&KEYS)?;
    let name = name(&section, item, otherwise)?.value;
    if let Some(place) = section.get("where") {
        let word = place.word(&["outside", "inside", "both"])?;
        if word != "outside" {
            let remedy = "write where = \"outside\", or leave it out: light inside the solid is not simulated";
            return Err(place.refuse("outside", remedy));
        }
    }
    let extinction = section.get("extinction").ok_or_else(|| {
        let remedy = "write extinction = 0.05, per world unit, or rows such as [[0, 0.0], [40, 0.8]]";
        item.refuse("the key `extinction`", remedy)
    })?;
    let extinction_table = table(&extinction, MOST, "extinctions per world unit that are not negative")?;
    let of = |key: &str, most: f64, expected: &str| section.get(key).map(|v| table(&v, most, expected)).transpose();
    let albedo = match of("albedo", 1.0, "albedos from 0 to 1")? {
        Some(albedo) => albedo,
        None => Table::new(vec![(0.0, [1.0; 3])])?,
    };
    let field = match (section.get("field"), section.get("volume")) {
        (Some(_), Some(both)) => return Err(both.refuse("`field` or `volume`, not both", "take one out")),
        (None, None) => None,
        (Some(given), None) | (None, Some(given)) => {
            let text = given.text()?;
            Some(if text == "self" {
                FieldDescription::Lit
            } else if volumes.iter().any(|v| v.name.value == text) {
                FieldDescription::Volume(text.into())
            } else {
                FieldDescription::File(text.into())
            })
        }
    };
    let is_table = extinction_table.rows().len() > 1 || albedo.rows().len() > 1;
    let emission = match section.get("emission") {
        None => [0.0; 3],
        Some(item) => colour(&item, MOST, "radiances that are not negative", "give the radiance of an opaque piece")?,
    };
    let phase = section.get("phase").map_or(Ok(Phase::Isotropic), |item| phase_of(&item))?;
    let region = region(&section, item)?;
    if field.is_none() && !volumes.is_empty() && (is_table || region == MediumRegion::Box) {
        let remedy = "write field = \"NAME\", one of the [[volumes]], or a file";
        return Err(item.refuse("the key `field`: over whose values its tables are, and whose box it fills", remedy));
    }
    let field = field.unwrap_or(FieldDescription::Lit);
    let line = item.line();
    Ok(MediumDescription { name, line, field, region, extinction: extinction_table, albedo, phase, emission })
}

fn region(section: &Section<'_>, of: &Item<'_>) -> Result<MediumRegion> {
    let keys = ["min", "max", "centre", "radius"].map(|key| section.get(key));
    match &keys {
        [None, None, None, None] => Ok(MediumRegion::Box),
        [Some(min), Some(max), None, None] => {
            let bounds = Bounds { min: vector(min)?, max: vector(max)? };
            if !bounds.size().cmpgt(DVec3::ZERO).all() {
                return Err(max.refuse("a corner above `min` along every axis", "exchange min and max"));
            }
            Ok(MediumRegion::Within(bounds))
        }
        [None, None, Some(centre), Some(radius)] => {
            let (centre, length) = (vector(centre)?, radius.number()?);
            if length <= 0.0 {
                return Err(radius.refuse("a radius above 0", "give world units"));
            }
            Ok(MediumRegion::Ball { centre, radius: length })
        }
        _ => {
            let remedy = "leave them out: then it fills the box of its field";
            Err(of.refuse("min and max of a box, or centre and radius of a ball", remedy))
        }
    }
}

/// One number, three, or rows of a value with one or three.
pub(super) fn table(item: &Item<'_>, most: f64, expected: &str) -> Result<Table> {
    let rows = item.list().filter(|rows| rows.first().is_some_and(|row| row.list().is_some()));
    let Some(rows) = rows else {
        return Table::new(vec![(
            0.0,
            colour(item, most, expected, "give one number, three, or rows")?.map(|v| v as f32),
        )]);
    };
    let row = |row: &Item<'_>| -> Result<(f64, [f32; 3])> {
        let refuse = || row.refuse("[value, number] or [value, r, g, b]", "write rows such as [[0, 0.0], [40, 0.8]]");
        let numbers = row.list().ok_or_else(refuse)?.iter().map(Item::number).collect::<Result<Vec<_>>>()?;
        let (value, colour) = match numbers[..] {
            [value, one] => (value, [one; 3]),
            [value, r, g, b] => (value, [r, g, b]),
            _ => return Err(refuse()),
        };
        let legal = colour.iter().all(|v| (0.0..=most).contains(v));
        if legal { Ok((value, colour.map(|v| v as f32))) } else { Err(row.refuse(expected, "correct the row")) }
    };
    let rows = rows.iter().map(row).collect::<Result<Vec<_>>>()?;
    Table::new(rows).map_err(|e| at_item(item, e))
}

pub(super) fn phase_of(item: &Item<'_>) -> Result<Phase> {
    let example = "write phase = { hg = 0.6 }";
    if let Some(word) = item.as_text() {
        return match word {
            "isotropic" => Ok(Phase::Isotropic),
            "rayleigh" => Ok(Phase::Rayleigh),
            _ => Err(item.refuse(format!("one of {}", PHASES.join(", ")), example)),
        };
    }
    let section = item.section(&PHASES)?;
    let given: Vec<(&str, Item<'_>)> = PHASES.iter().filter_map(|&key| Some((key, section.get(key)?))).collect();
    let [(key, value)] = &given[..] else {
        return Err(item.refuse(format!("one of {}", PHASES.join(", ")), example));
    };
    let phase = match *key {
        "isotropic" | "rayleigh" if !value.boolean()? => {
            return Err(value.refuse("true", "name the phase function that is meant"));
        }
        "isotropic" => Phase::Isotropic,
        "rayleigh" => Phase::Rayleigh,
        "hg" => Phase::HenyeyGreenstein(value.number()?),
        "schlick" => Phase::Schlick(value.number()?),
        "table" => {
            let refuse = || value.refuse("rows [cosine, value]", "write table = [[-1, 0.2], [1, 3]]");
            let row = |row: &Item<'_>| -> Result<(f64, f64)> {
                let numbers = row.list().ok_or_else(refuse)?.iter().map(Item::number).collect::<Result<Vec<_>>>()?;
                if let [cosine, value] = numbers[..] { Ok((cosine, value)) } else { Err(refuse()) }
            };
            let rows = value.list().ok_or_else(refuse)?.iter().map(row).collect::<Result<Vec<_>>>()?;
            Phase::Table(PhaseTable::new(&rows).map_err(|e| at_item(value, e))?)
        }
        _ => {
            let refuse = || {
                value.refuse("rows [share, phase function]", "write mix = [[0.7, { hg = 0.8 }], [0.3, { hg = -0.2 }]]")
            };
            let part = |row: &Item<'_>| -> Result<(f64, Phase)> {
                match &row.list().ok_or_else(refuse)?[..] {
                    // One level alone: a mixture in a mixture is refused below, without end it would be a stack.
                    [_, of] if of.peek("mix").is_some() => {
                        Err(of.refuse("a phase function that is no mixture", "write its parts here"))
                    }
                    [share, of] => Ok((share.number()?, phase_of(of)?)),
                    _ => Err(refuse()),
                }
            };
            Phase::Mixture(value.list().ok_or_else(refuse)?.iter().map(part).collect::<Result<_>>()?)
        }
    };
    phase.check().map_err(|e| at_item(value, e))?;
    Ok(phase)
}

/// What a checking constructor found, at its line.
fn at_item(item: &Item<'_>, error: Error) -> Error {
    match error {
        Error::Argument { given, expected, remedy, .. } => item.refuse(format!("{expected} (found {given})"), remedy),
        other => other,
    }
}
