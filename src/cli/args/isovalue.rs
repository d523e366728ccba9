//! Isovalues on the command line.

use crate::cli::present::console::Console;

pub(in crate::cli) use crate::scene::NamedIsovalue;
pub(in crate::cli) use crate::volume::Isovalue;
pub(in crate::cli) use crate::volume::isovalue::Chosen;

/// Reads an isovalue, perhaps of one of several volumes: `NAME=C`.
pub(in crate::cli) fn parse_named(text: &str) -> Result<NamedIsovalue, String> {
    let of = |text: &str| text.parse::<Isovalue>().map_err(|e| e.to_string());
    match text.split_once('=') {
        Some((name, _)) if name.trim().is_empty() => Err(format!("`{text}`: give NAME=C, such as inner=0.5")),
        Some((name, isovalue)) => Ok(NamedIsovalue { volume: Some(name.trim().into()), isovalue: of(isovalue)? }),
        None => Ok(NamedIsovalue { volume: None, isovalue: of(text)? }),
    }
}

/// What the program chose, and what a user should know of it.
pub(in crate::cli) fn tell(console: &Console, chosen: &[Chosen]) {
    chosen.iter().flat_map(Chosen::notes).for_each(|text| console.note(text));
}
