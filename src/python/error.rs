//! Errors of the library as exceptions: `isolume.Error`, which is a class of the Python side.

use crate::cli::Failure;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::Value;

/// The exception of a failure, with its parts as attributes.
pub(super) fn raise(py: Python<'_>, failure: impl Into<Failure>) -> PyErr {
    let failure = failure.into();
    let message = failure.to_string();
    made(py, &message, &failure.to_json()).unwrap_or_else(|_| PyRuntimeError::new_err(message))
}

fn made(py: Python<'_>, message: &str, document: &Value) -> PyResult<PyErr> {
    // What a file holds, or a request asks for, is what was given.
    let parts: [(&str, &[&str]); 6] = [
        ("kind", &["kind"]),
        ("path", &["path"]),
        ("name", &["name", "what", "field"]),
        ("given", &["given", "found", "asked", "needed", "holder", "reason"]),
        ("expected", &["expected", "stored", "limit"]),
        ("remedy", &["remedy"]),
    ];
    let named = PyDict::new(py);
    for (part, names) in parts {
        named.set_item(part, names.iter().find_map(|name| text(&document[name])))?;
    }
    let class = py.import("isolume._error")?.getattr("Error")?;
    Ok(PyErr::from_value(class.call((message,), Some(&named))?))
}

fn text(value: &Value) -> Option<String> {
    match value {
        Value::Null => None,
        Value::String(text) if text.is_empty() => None,
        Value::String(text) => Some(text.clone()),
        other => Some(other.to_string()),
    }
}

/// Results of the library in functions that Python calls.
pub(super) trait OrRaise<T> {
    /// The value, or the failure as an exception.
    fn or_raise(self, py: Python<'_>) -> PyResult<T>;
}

impl<T, E: Into<Failure>> OrRaise<T> for Result<T, E> {
    fn or_raise(self, py: Python<'_>) -> PyResult<T> {
        self.map_err(|failure| raise(py, failure))
    }
}
