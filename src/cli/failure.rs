//! Failures for machines: `{"error": {"kind": …, "message": …}}` with the parts of each kind.

use super::Failure;
use crate::error::Error;
use clap::error::{ContextKind, ContextValue};
use serde_json::{Map, Value, json};

impl Failure {
    /// The kind, the message as people see it, and what it is made of.
    pub(crate) fn to_json(&self) -> Value {
        let (kind, parts) = match self {
            Self::Message(_) => ("other", json!({})),
            Self::Library(error) => parts(error),
        };
        document(kind, &self.to_string(), parts)
    }
}

fn document(kind: &str, message: &str, parts: Value) -> Value {
    let mut all = Map::new();
    all.insert("kind".into(), kind.into());
    all.insert("message".into(), message.into());
    if let Value::Object(parts) = parts {
        all.extend(parts);
    }
    Value::Object(all)
}

fn parts(error: &Error) -> (&'static str, Value) {
    match error {
        Error::Io { path, doing, source } => {
            ("io", json!({ "path": path.display().to_string(), "doing": doing, "reason": source.to_string() }))
        }
        Error::Format { file, format, found, expected, remedy } => (
            "format",
            json!({ "path": file, "format": format, "found": found, "expected": expected, "remedy": remedy }),
        ),
        Error::Argument { name, given, expected, remedy } => {
            ("argument", json!({ "name": name, "given": given, "expected": expected, "remedy": remedy }))
        }
        Error::Stopped { done, all } => ("stopped", json!({ "done": done, "all": all })),
        Error::Limit { what, needed, limit, remedy } => {
            ("limit", json!({ "what": what, "needed": needed, "limit": limit, "remedy": remedy }))
        }
        Error::Mismatch { path, field, stored, asked, remedy } => (
            "mismatch",
            json!({
                "path": path.display().to_string(), "field": field, "stored": stored, "asked": asked,
                "remedy": remedy,
            }),
        ),
        Error::Unbaked { path, isovalue, unbaked, lookups, holds_all, isovalues, remedy } => (
            "unbaked",
            json!({
                "path": path.display().to_string(), "isovalue": isovalue, "unbaked": unbaked, "lookups": lookups,
                "holds_all": holds_all, "isovalues": isovalues, "remedy": remedy,
            }),
        ),
        Error::Locked { path, holder, remedy } => {
            ("locked", json!({ "path": path.display().to_string(), "holder": holder, "remedy": remedy }))
        }
    }
}

/// A command line that is wrong.
pub(super) fn usage_json(error: &clap::Error) -> Value {
    let text = error.render().to_string();
    let message = text.lines().next().unwrap_or_default();
    let message = message.strip_prefix("error: ").unwrap_or(message);
    let name = match error.get(ContextKind::InvalidArg) {
        Some(ContextValue::String(name)) => json!({ "name": name }),
        Some(ContextValue::Strings(names)) => json!({ "name": names.join(", ") }),
        _ => json!({}),
    };
    document("usage", message, name)
}
