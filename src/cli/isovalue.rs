//! Isovalues on the command line.

use super::console::Console;
use super::text;
use std::str::FromStr;

pub(super) use crate::scene::check_count;
pub(super) use crate::volume::Isovalue;
pub(super) use crate::volume::isovalue::Chosen;

/// An isovalue, perhaps of one of several volumes: `NAME=C`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct NamedIsovalue {
    /// The volume, where it is named.
    pub(super) volume: Option<String>,
    pub(super) isovalue: Isovalue,
}

impl FromStr for NamedIsovalue {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let of = |text: &str| text.parse::<Isovalue>().map_err(|e| e.to_string());
        match text.split_once('=') {
            Some((name, _)) if name.trim().is_empty() => Err(format!("`{text}`: give NAME=C, such as inner=0.5")),
            Some((name, isovalue)) => Ok(Self { volume: Some(name.trim().into()), isovalue: of(isovalue)? }),
            None => Ok(Self { volume: None, isovalue: of(text)? }),
        }
    }
}

/// What the program chose, and what a user should know of it.
pub(super) fn tell(console: &Console, chosen: &[Chosen]) {
    for c in chosen {
        if let Some(reason) = &c.reason {
            console.note(format!("isovalue {}: {reason}", text::number(c.value, 6)));
        }
        if let Some(warning) = &c.warning {
            console.note(warning);
        }
    }
}
