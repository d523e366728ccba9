//! The section `[material]`.

use super::super::{Colormap, EmissionRule, MaterialRule, Table};
use super::read::Item;
use crate::error::Result;

/// Diffuse reflectance as described.
#[derive(Clone, Debug)]
pub enum Albedo {
    /// A constant or a table.
    Rule(MaterialRule),
    /// A colour scale; over the range of the volume where none is given.
    Map {
        /// The scale.
        colormap: Colormap,
        /// Isovalues of its ends.
        range: Option<(f64, f64)>,
        /// Factor on the colours.
        scale: f32,
    },
}

impl Albedo {
    /// The rule on a volume with this range of values.
    pub fn rule(&self, range_of_volume: (f64, f64)) -> MaterialRule {
        match self {
            Self::Rule(rule) => rule.clone(),
            Self::Map { colormap, range, scale } => {
                let (low, high) = range.unwrap_or(range_of_volume);
                MaterialRule::Map { colormap: *colormap, low, high, scale: *scale }
            }
        }
    }
}

/// Numbers over the isovalue, as written.
enum Numbers {
    Constant([f32; 3]),
    Rows(Vec<(f64, [f32; 3])>),
}

/// Albedo of a colour scale without a factor of its own.
const SCALE: f32 = 0.7;

pub(super) fn read(item: &Item<'_>) -> Result<(Option<Albedo>, Option<EmissionRule>)> {
    let section = item.section(&["albedo", "colormap", "range", "emission"])?;
    let fits_albedo = (1.0, "albedos from 0 to 1", "a surface cannot reflect more than it receives");
    let fits_emission = (1e30, "radiances that are not negative", "write 0 for an isovalue that does not emit");
    let numbers = section.get("albedo").map(|item| Ok((numbers(&item, fits_albedo)?, item))).transpose()?;
    let albedo = match section.get("colormap") {
        Some(map) => {
            let words: Vec<&'static str> = Colormap::names().collect();
            let colormap = Colormap::named(map.word(&words)?)?;
            let scale = match numbers {
                None => SCALE,
                Some((Numbers::Constant([r, g, b]), _)) if r == g && g == b => r,
                Some((_, item)) => {
                    return Err(item.refuse("one number beside `colormap`", "it is a factor on the colours"));
                }
            };
            let range = section.get("range").map(|item| range(&item)).transpose()?;
            Some(Albedo::Map { colormap, range, scale })
        }
        None => {
            if let Some(item) = section.get("range") {
                return Err(item.refuse("a colormap beside it", "add colormap = \"viridis\", or take `range` out"));
            }
            match numbers {
                None => None,
                Some((Numbers::Constant(albedo), _)) => Some(Albedo::Rule(MaterialRule::Constant(albedo))),
                Some((Numbers::Rows(rows), item)) => Some(Albedo::Rule(MaterialRule::Table(table(&item, rows)?))),
            }
        }
    };
    let emission = match section.get("emission") {
        None => None,
        Some(item) => Some(match self::numbers(&item, fits_emission)? {
            Numbers::Constant(emission) => EmissionRule::Constant(emission),
            Numbers::Rows(rows) => EmissionRule::Table(table(&item, rows)?),
        }),
    };
    Ok((albedo, emission))
}

/// Two rising isovalues.
fn range(item: &Item<'_>) -> Result<(f64, f64)> {
    let ends: Option<Vec<f64>> = item.list().and_then(|list| list.iter().map(Item::as_number).collect());
    match ends.as_deref() {
        Some(&[low, high]) if low < high => Ok((low, high)),
        _ => Err(item.refuse("two rising isovalues such as [0, 255]", "write [LOW, HIGH]")),
    }
}

/// A number, [r, g, b], or rows of [isovalue, value] or [isovalue, r, g, b]; colours in 0..=most.
fn numbers(item: &Item<'_>, (most, expected, remedy): (f32, &str, &str)) -> Result<Numbers> {
    let colour = |items: &[Item<'_>]| -> Result<[f32; 3]> {
        let value = |item: &Item<'_>| -> Result<f32> {
            let value = item.number()? as f32;
            if (0.0..=most).contains(&value) { Ok(value) } else { Err(item.refuse(expected, remedy)) }
        };
        match items {
            [one] => Ok([value(one)?; 3]),
            [r, g, b] => Ok([value(r)?, value(g)?, value(b)?]),
            _ => Err(item.refuse("one number or three", "write 0.7, [0.7, 0.6, 0.5], or rows [isovalue, r, g, b]")),
        }
    };
    let Some(list) = item.list() else { return Ok(Numbers::Constant(colour(std::slice::from_ref(item))?)) };
    if list.iter().all(|row| row.list().is_none()) {
        return Ok(Numbers::Constant(colour(&list)?));
    }
    let row = |row: &Item<'_>| {
        let cells = row.list().unwrap_or_default();
        if !matches!(cells.len(), 2 | 4) {
            return Err(row.refuse("a row [isovalue, value] or [isovalue, r, g, b]", "give every row 2 or 4 numbers"));
        }
        Ok((cells[0].number()?, colour(&cells[1..])?))
    };
    let mut rows: Vec<(f64, [f32; 3])> = Vec::with_capacity(list.len());
    for item in &list {
        let next = row(item)?;
        if rows.last().is_some_and(|last| next.0 <= last.0) {
            return Err(item.refuse("isovalues that ascend from row to row", "put the lowest isovalue first"));
        }
        rows.push(next);
    }
    Ok(Numbers::Rows(rows))
}

fn table(item: &Item<'_>, rows: Vec<(f64, [f32; 3])>) -> Result<Table> {
    Table::new(rows).map_err(|_| item.refuse("rows [isovalue, r, g, b] with ascending isovalues", "correct the rows"))
}
