//! Isovalues on the command line.

use super::console::Console;

pub(super) use crate::scene::NamedIsovalue;
pub(super) use crate::volume::Isovalue;
pub(super) use crate::volume::isovalue::Chosen;

/// Reads an isovalue, perhaps of one of several volumes: `NAME=C`.
pub(super) fn parse_named(text: &str) -> Result<NamedIsovalue, String> {
    let of = |text: &str| text.parse::<Isovalue>().map_err(|e| e.to_string());
    match text.split_once('=') {
        Some((name, _)) if name.trim().is_empty() => Err(format!("`{text}`: give NAME=C, such as inner=0.5")),
        Some((name, isovalue)) => Ok(NamedIsovalue { volume: Some(name.trim().into()), isovalue: of(isovalue)? }),
        None => Ok(NamedIsovalue { volume: None, isovalue: of(text)? }),
    }
}

/// What the program chose, and what a user should know of it.
pub(super) fn tell(console: &Console, chosen: &[Chosen]) {
    chosen.iter().flat_map(Chosen::notes).for_each(|text| console.note(text));
}
