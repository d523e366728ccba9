//! Volumes as nodes, and what is said of the files that nodes name.

use super::super::read::{Item, Section};
use super::super::surroundings::{required, rotation, scale, vector};
use super::Context;
use crate::error::{Error, Result};
use crate::geom::{Affine, Bounds};
use crate::model::{Between, Grid, Leaf, Node, Op, Warp};
use crate::quantity::number;
use crate::volume::{Channel, Choice, Level};
use glam::DVec3;
use std::sync::Arc;

/// isovalue of the model + weight × (value − isovalue of the file), by the samples of a file; outside of its box the least.
pub(super) fn volume(item: &Item<'_>, context: &mut Context<'_>) -> Result<Node> {
    let own = ["file", "isovalue", "weight", "scale", "rotate", "translate"];
    let section = item.section(&[&own[..], &CHOSEN].concat())?;
    let file = required(&section, item, "file", "write file = \"brain.nii.gz\"")?;
    let isovalue =
        required(&section, item, "isovalue", "write isovalue = 90: the value of the file that is its surface")?;
    let weight = match section.get("weight") {
        None => 1.0,
        Some(item) => match item.number()? {
            weight if (1e-15..1e15).contains(&weight.abs()) => weight,
            _ => return Err(item.refuse("a number other than 0", "such as 1, or -1 where low values are solid")),
        },
    };
    let translate = section.get("translate").map_or(Ok(DVec3::ZERO), |t| vector(&t))?;
    let (turned, threshold) = (rotation(&section)? * scale(&section)?, isovalue.number()?);
    let (name, choice) = (file.text()?, choice(&section)?);
    let volume = context.files.volume(name, choice).map_err(|e| at_file(&file, e))?;
    volume.check_cells().map_err(|e| at_file(&file, e))?;
    let (low, high) = volume.value_range();
    let (least, most) =
        if weight > 0.0 { (threshold >= low, threshold < high) } else { (threshold > low, threshold <= high) };
    if !(least && most) {
        let expected = format!("a value in the range of {name}, {} to {}", number(low, 6), number(high, 6));
        return Err(isovalue.refuse(expected, "with any other all of it is solid, or nothing"));
    }
    let line = file.line();
    context.notes.extend(volume.notes.iter().map(|note| format!("line {line}: {name}: {}", as_keys(&note.text))));
    let from_grid = volume.world_from_grid();
    let map = Affine::new(turned * from_grid.linear(), turned * from_grid.offset() + translate);
    let map = map.ok_or_else(|| item.refuse("a map with an inverse", "correct scale, rotate or translate"))?;
    let (dims, samples) = (volume.dims(), volume.samples());
    let value = |i: usize| volume.value_from_raw(f64::from(samples.raw(i))) as f32;
    let mut values = Vec::new();
    if values.try_reserve_exact(samples.len()).is_err() {
        return Err(Error::Limit {
            what: format!("{name} as a part of a model"),
            needed: format!("{} bytes", 4.0 * samples.len() as f64),
            limit: "the memory of this machine".into(),
            remedy: "give a file of fewer samples".into(),
        });
    }
    values.extend((0..samples.len()).map(value));
    let last = DVec3::from_array(dims.map(|n| (n - 1) as f64));
    // What is outside is not solid.
    let beyond = f64::from(if weight > 0.0 { low } else { high } as f32);
    let bounds = Bounds { min: DVec3::ZERO, max: last };
    let grid = Grid::new(dims, values, bounds, Between::Linear(beyond));
    let grid = grid.ok_or_else(|| item.refuse("a volume with cells", "give another file"))?;
    let placed = Node::of(Op::Warp(Warp::affine(map)), vec![Node::leaf(Leaf::Grid(Arc::new(grid)))]);
    let above = Node::of(Op::Offset(-threshold), vec![placed]);
    Ok(Node::of(Op::Offset(context.iso), vec![Node::of(Op::Weight(weight), vec![above])]))
}

/// Keys that choose among several volumes of a file: options of the command line for other volumes.
const CHOSEN: [&str; 5] = ["channel", "array", "timepoint", "level", "series"];

fn choice(section: &Section<'_>) -> Result<Choice> {
    let number = |key: &str| section.get(key).map(|item| item.integer(0..=1 << 32).map(|n| n as usize)).transpose();
    let channel = match section.get("channel") {
        Some(item) if item.as_text().is_none() => Some(Channel::Index(item.integer(0..=1 << 32)? as usize)),
        Some(item) => Some(Channel::Name(item.text()?.into())),
        None => None,
    };
    let text = |key: &str| section.get(key).map(|item| item.text().map(String::from)).transpose();
    let series = match section.get("series") {
        Some(item) if item.as_text().is_none() => Some(item.integer(0..=1 << 32)?.to_string()),
        _ => text("series")?,
    };
    Ok(Choice {
        channel,
        array: text("array")?,
        timepoint: number("timepoint")?,
        level: number("level")?.map(Level::Index),
        series,
        ..Choice::default()
    })
}

/// A sentence about options of the command line, for who writes a model.
fn as_keys(text: &str) -> String {
    CHOSEN.iter().fold(text.to_owned(), |text, key| text.replace(&format!("--{key}"), &format!("{key} =")))
}

/// An error about the contents of a file, at the line that names it.
pub(super) fn at_file(file: &Item<'_>, error: Error) -> Error {
    match error {
        Error::Argument { given: found, expected, remedy, .. } | Error::Format { found, expected, remedy, .. } => {
            file.refuse(format!("{expected} (found {found})"), as_keys(&remedy))
        }
        other => other,
    }
}
