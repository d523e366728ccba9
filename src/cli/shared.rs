//! What the Python package shares with the program.

pub(crate) use crate::cli::commands::cache::ready;
