//! Why a command did not do what was asked; for machines `{"error": {"kind": …, "message": …}}` with the parts of each kind.

use crate::error::Error;
use clap::error::{ContextKind, ContextValue};
use serde_json::{Value, json};

/// Why a command did not do what was asked.
pub(crate) enum Failure {
    /// The library's reason.
    Library(Error),
    /// One of the command line's own.
    Message(String),
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Library(error)
    }
}

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Library(error) => error.fmt(f),
            Self::Message(text) => f.write_str(text),
        }
    }
}

pub(crate) type Outcome<T = ()> = Result<T, Failure>;

impl Failure {
    /// The kind, the message as people see it, and what it is made of.
    pub(crate) fn to_json(&self) -> Value {
        match self {
            Self::Message(text) => json!({ "kind": "other", "message": text }),
            Self::Library(error) => error.to_json(),
        }
    }
}

/// A command line that is wrong.
pub(in crate::cli) fn usage_json(error: &clap::Error) -> Value {
    let text = error.render().to_string();
    let message = text.lines().next().unwrap_or_default();
    let message = message.strip_prefix("error: ").unwrap_or(message);
    let mut all = json!({ "kind": "usage", "message": message });
    match error.get(ContextKind::InvalidArg) {
        Some(ContextValue::String(name)) => all["name"] = json!(name),
        Some(ContextValue::Strings(names)) => all["name"] = json!(names.join(", ")),
        _ => {}
    }
    all
}
