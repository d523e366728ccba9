//! What is read, so that it is not written over.

use crate::error::{Error, Result};
use crate::scene::files_of;
use std::fs::{self, Metadata};
use std::path::{Path, PathBuf};

/// Paths that are read, of scenes and models with the files that they name; names of fields, skies and embedded environments are no paths, and do no harm here.
pub struct Inputs(Vec<PathBuf>);

impl Inputs {
    /// Arguments that may be paths.
    pub fn new<'a>(arguments: impl IntoIterator<Item = &'a String>) -> Self {
        Self(arguments.into_iter().flat_map(|argument| files_of(argument)).collect())
    }

    /// Refuses an output that is one of the inputs, under whatever name, or a file of an input store.
    ///
    /// # Errors
    /// [`Error::Argument`] naming both.
    pub fn refuse(&self, output: &Path) -> Result<()> {
        // What is not there yet is no input.
        let Ok(found) = fs::metadata(output) else { return Ok(()) };
        let is_it = |input: &&PathBuf| {
            let Ok(metadata) = fs::metadata(input) else { return false };
            let is_store = metadata.is_dir() && input.join("zarr.json").is_file();
            is_same((output, &found), (input, &metadata)) || (is_store && found.is_file() && lies_in(output, input))
        };
        match self.0.iter().find(is_it) {
            None => Ok(()),
            Some(input) => {
                let given = format!("{}, which is the input {}", output.display(), input.display());
                Err(Error::argument("output", given, "a file that is not read as well", "give another output"))
            }
        }
    }
}

#[cfg(unix)]
fn is_same((_, a): (&Path, &Metadata), (_, b): (&Path, &Metadata)) -> bool {
    use std::os::unix::fs::MetadataExt;
    // Of a device, such as /dev/null, reading and writing do not meet.
    a.is_file() && (a.dev(), a.ino()) == (b.dev(), b.ino())
}

#[cfg(not(unix))]
fn is_same((a, of_a): (&Path, &Metadata), (b, _): (&Path, &Metadata)) -> bool {
    of_a.is_file() && a.canonicalize().ok().is_some_and(|a| b.canonicalize().is_ok_and(|b| a == b))
}

fn lies_in(path: &Path, folder: &Path) -> bool {
    let (Ok(path), Ok(folder)) = (path.canonicalize(), folder.canonicalize()) else { return false };
    path.starts_with(folder)
}
