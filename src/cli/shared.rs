//! What the Python package shares with the program.

pub(crate) use super::cache::{locate, prepare};
