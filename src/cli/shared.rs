//! What the Python package shares with the program.

pub(crate) use super::bake_report::Told;
pub(crate) use super::cache::{Cache, InUse};
pub(crate) use super::console::Console;
pub(crate) use super::input::parse_up;
pub(crate) use super::light::{MaterialArgs, Triple, for_light, sentence};
pub(crate) use super::view::package;
