//! What the Python package shares with the program.

pub(crate) use super::cache::{locate, prepare};
pub(crate) use super::input::parse_up;
