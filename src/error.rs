//! The one public error type. Errors are values: each variant carries what was given, what was
//! expected and where, and the sentence a user reads is made in `Display` alone.
//!
//! Readers work on byte streams and do not know file names. They return [`Error::Format`] with
//! an empty `file`; whoever opened the file adds its name with [`Error::in_file`].

use serde_json::{Map, Value, json};
use std::io;
use std::path::{Path, PathBuf};

/// Shorthand for results of this library.
pub type Result<T> = std::result::Result<T, Error>;

/// Everything that can go wrong with input, files and limits. A bug panics instead.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused an operation on a file.
    #[error("{}: cannot {doing}: {source}", path.display())]
    Io {
        /// The file or directory.
        path: PathBuf,
        /// What was tried, as a verb phrase: "open", "write the chunk", …
        doing: &'static str,
        /// The system's answer.
        source: io::Error,
    },
    /// The bytes of a file are not what its format promises.
    #[error("{}{format}: found {found}, expected {expected}; {remedy}", prefix(file))]
    Format {
        /// Name of the file; empty until [`Error::in_file`] fills it.
        file: String,
        /// Short name of the format, such as "NRRD" or "OpenEXR".
        format: &'static str,
        /// What the file holds.
        found: String,
        /// What the format asks for there.
        expected: String,
        /// What the user can do about it.
        remedy: String,
    },
    /// A value handed to the program or the library is outside what it can be.
    #[error("{name}: given {given}, expected {expected}; {remedy}")]
    Argument {
        /// Name of the option or parameter.
        name: String,
        /// The value as given.
        given: String,
        /// The values that are possible.
        expected: String,
        /// What the user can do about it.
        remedy: String,
    },
    /// Work was stopped on request before it was done; what was finished is kept.
    #[error("stopped after {done} of {all} chunks; resume with the same command")]
    Stopped {
        /// Chunks that are there.
        done: usize,
        /// Chunks that were asked for.
        all: usize,
    },
    /// A request would take more of a resource than its limit.
    #[error("{what} needs {needed}, the limit is {limit}; {remedy}")]
    Limit {
        /// What was asked for.
        what: String,
        /// The amount, with its unit.
        needed: String,
        /// The limit, with its unit.
        limit: String,
        /// What to change.
        remedy: String,
    },
    /// A store on disk was made from other input or with other settings.
    #[error("{}: the store has {field} = {stored}, asked for {asked}; {remedy}", path.display())]
    Mismatch {
        /// The store.
        path: PathBuf,
        /// The first part of the identity that differs.
        field: String,
        /// Its value in the store.
        stored: String,
        /// The value asked for.
        asked: String,
        /// What to do.
        remedy: String,
    },
    /// A surface was to be lit whose texels a store does not have.
    #[error(
        "{}: {unbaked} of {lookups} lookups at isovalue {isovalue} meet texels that were never baked; {remedy}",
        path.display()
    )]
    Unbaked {
        /// The store.
        path: PathBuf,
        /// The isovalue, in the values of the file.
        isovalue: f64,
        /// Lookups that met such a texel.
        unbaked: u64,
        /// All lookups.
        lookups: u64,
        /// Whether the store holds all isovalues, at least of the chunks that were baked.
        holds_all: bool,
        /// The isovalues that it holds.
        isovalues: Vec<f64>,
        /// What to do.
        remedy: String,
    },
    /// Another process fills a store.
    #[error("store: given {}, locked by {holder}, expected a store that nobody else is filling; {remedy}", path.display())]
    Locked {
        /// The store.
        path: PathBuf,
        /// Who holds its lock, as far as is known.
        holder: String,
        /// What to do.
        remedy: String,
    },
}

impl Error {
    /// The kind, the sentence, and the parts that it is made of, for programs.
    #[doc(hidden)]
    pub fn to_json(&self) -> Value {
        let (kind, parts) = self.parts();
        let mut all = Map::new();
        all.insert("kind".into(), kind.into());
        all.insert("message".into(), self.to_string().into());
        if let Value::Object(parts) = parts {
            all.extend(parts);
        }
        Value::Object(all)
    }

    fn parts(&self) -> (&'static str, Value) {
        match self {
            Self::Io { path, doing, source } => {
                ("io", json!({ "path": path.display().to_string(), "doing": doing, "reason": source.to_string() }))
            }
            Self::Format { file, format, found, expected, remedy } => (
                "format",
                json!({ "path": file, "format": format, "found": found, "expected": expected, "remedy": remedy }),
            ),
            Self::Argument { name, given, expected, remedy } => {
                ("argument", json!({ "name": name, "given": given, "expected": expected, "remedy": remedy }))
            }
            Self::Stopped { done, all } => ("stopped", json!({ "done": done, "all": all })),
            Self::Limit { what, needed, limit, remedy } => {
                ("limit", json!({ "what": what, "needed": needed, "limit": limit, "remedy": remedy }))
            }
            Self::Mismatch { path, field, stored, asked, remedy } => (
                "mismatch",
                json!({
                    "path": path.display().to_string(), "field": field, "stored": stored, "asked": asked,
                    "remedy": remedy,
                }),
            ),
            Self::Unbaked { path, isovalue, unbaked, lookups, holds_all, isovalues, remedy } => (
                "unbaked",
                json!({
                    "path": path.display().to_string(), "isovalue": isovalue, "unbaked": unbaked, "lookups": lookups,
                    "holds_all": holds_all, "isovalues": isovalues, "remedy": remedy,
                }),
            ),
            Self::Locked { path, holder, remedy } => {
                ("locked", json!({ "path": path.display().to_string(), "holder": holder, "remedy": remedy }))
            }
        }
    }
}

fn prefix(file: &str) -> String {
    if file.is_empty() { String::new() } else { format!("{file}: ") }
}

impl Error {
    /// A format error without a file name; see [`Error::in_file`].
    pub fn format(
        format: &'static str,
        found: impl Into<String>,
        expected: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self::Format {
            file: String::new(),
            format,
            found: found.into(),
            expected: expected.into(),
            remedy: remedy.into(),
        }
    }

    /// An impossible argument.
    pub fn argument(
        name: impl Into<String>,
        given: impl ToString,
        expected: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self::Argument { name: name.into(), given: given.to_string(), expected: expected.into(), remedy: remedy.into() }
    }

    /// An error of the operating system on `path`.
    pub fn io(path: impl AsRef<Path>, doing: &'static str, source: io::Error) -> Self {
        Self::Io { path: path.as_ref().to_path_buf(), doing, source }
    }

    /// Names the file in a [`Error::Format`] that does not name one yet; an [`Error::Io`] with
    /// an empty path gets the path. Other errors pass unchanged.
    #[must_use]
    pub fn in_file(mut self, name: impl AsRef<Path>) -> Self {
        match &mut self {
            Self::Format { file, .. } if file.is_empty() => {
                *file = name.as_ref().display().to_string();
            }
            Self::Io { path, .. } if path.as_os_str().is_empty() => {
                *path = name.as_ref().to_path_buf();
            }
            _ => {}
        }
        self
    }

    /// What a reader makes of a failed read from its stream: the end of the stream is a
    /// truncated file, a format error; anything else is the system's and carries no path yet.
    #[doc(hidden)]
    pub fn from_read(format: &'static str, wanted: impl Into<String>, source: io::Error) -> Self {
        match source.kind() {
            io::ErrorKind::UnexpectedEof | io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput => Self::format(
                format,
                format!("a file that ends or is damaged there ({source})"),
                wanted,
                "the file is incomplete; copy or download it again",
            ),
            _ => Self::Io { path: PathBuf::new(), doing: "read", source },
        }
    }
}
