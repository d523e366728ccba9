//! Files that appear whole or not at all.
//!
//! The bytes go to a hidden temporary file in the folder of the target, which then takes the
//! target's place by a rename. A failure removes it; only a kill in mid-write can leave one
//! behind (`.isolume-*.tmp`), which a later write in the same folder removes. The rename is atomic towards other
//! processes, and the bytes are on the disk before it: a power cut leaves the old file or the new one.

use crate::error::{Error, Result};
use crate::staging::{self, folder_of};
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Bytes gathered before a system call.
const BUFFER: usize = 1 << 16;

/// Writes the file `path` through `body`, and returns what `body` returns.
///
/// An existing file is replaced and its permissions are kept; a new one gets what the umask
/// leaves of `rw-rw-rw-`. A symbolic link is followed. Something that is neither file nor folder
/// (`/dev/stdout`, a pipe) is written to directly, because it cannot be replaced.
///
/// # Errors
/// [`Error::Argument`] when `path` is a folder, is write-protected, or its folder does not exist;
/// [`Error::Io`] with the path when the system refuses; whatever `body` returns, with the path
/// added where it names none. In each case the target is as it was before.
pub fn write<T>(path: impl AsRef<Path>, body: impl FnOnce(&mut BufWriter<File>) -> Result<T>) -> Result<T> {
    let path = path.as_ref();
    let (target, existing) = resolve(path)?;
    if let Some(metadata) = &existing
        && !metadata.is_file()
    {
        let file = OpenOptions::new().write(true).open(&target).map_err(|e| Error::io(path, "open", e))?;
        return fill(path, file, body).map(|(value, _)| value);
    }
    let folder = folder_of(&target);
    let temporary = staging::file_in(folder, staging::EXPORT, staging::EXPORT_SUFFIX)
        .map_err(|e| Error::io(path, "create a file in its folder", e))?;
    staging::sweep(folder, temporary.path());
    let file = temporary.as_file().try_clone().map_err(|e| Error::io(path, "open", e))?;
    let (value, file) = fill(path, file, body)?;
    if let Some(metadata) = existing {
        file.set_permissions(metadata.permissions()).map_err(|e| Error::io(path, "set the permissions of", e))?;
    }
    file.sync_data().map_err(|e| Error::io(path, "write", e))?;
    drop(file);
    temporary.persist(&target).map_err(|e| Error::io(path, "replace", e.error))?;
    staging::sync_directory(folder).map_err(|e| Error::io(path, "synchronise the folder of", e))?;
    Ok(value)
}

/// Writes these bytes as the file `path`.
///
/// # Errors
/// As [`write`].
pub fn write_bytes(path: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
    let path = path.as_ref();
    write(path, |w| w.write_all(bytes).map_err(|e| Error::io(path, "write", e)))
}

/// Makes a folder, and those above it that are missing.
///
/// # Errors
/// [`Error::Io`] with its path when the system refuses.
pub fn make_folder(folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).map_err(|e| Error::io(folder, "make the folder", e))
}

/// Runs the body over a buffer and flushes it.
fn fill<T>(path: &Path, file: File, body: impl FnOnce(&mut BufWriter<File>) -> Result<T>) -> Result<(T, File)> {
    let mut writer = BufWriter::with_capacity(BUFFER, file);
    let outcome = body(&mut writer).map_err(|e| e.in_file(path));
    match outcome {
        Ok(value) => {
            writer.flush().map_err(|e| Error::io(path, "write", e))?;
            let file = writer.into_inner().map_err(|e| Error::io(path, "write", e.into_error()))?;
            Ok((value, file))
        }
        Err(error) => {
            // Dropping the writer would flush what the failed body left.
            drop(writer.into_parts());
            Err(error)
        }
    }
}

/// The file that `path` means, links followed, and what stands there now.
fn resolve(path: &Path) -> Result<(PathBuf, Option<fs::Metadata>)> {
    let refuse =
        |given: String, expected: &str, remedy: String| Err(Error::argument("output", given, expected, remedy));
    let shown = path.display();
    if path.as_os_str().is_empty() {
        return refuse("an empty path".into(), "the name of a file", "name the file to write".into());
    }
    let ends_in_separator = path.to_string_lossy().ends_with(std::path::is_separator);
    let target = if path.is_symlink() { link_target(path)? } else { path.to_path_buf() };
    match fs::metadata(&target) {
        Ok(metadata) if metadata.is_dir() => refuse(
            format!("{shown}, which is a folder"),
            "the name of a file",
            format!("give a name inside it, such as {}", path.join("surface").display()),
        ),
        Ok(metadata) if metadata.is_file() && metadata.permissions().readonly() => refuse(
            format!("{shown}, which is write-protected"),
            "a file that may be replaced",
            "remove it or choose another name".into(),
        ),
        Ok(metadata) => Ok((target, Some(metadata))),
        Err(_) if ends_in_separator || path.file_name().is_none() => {
            refuse(shown.to_string(), "the name of a file, not of a folder", "add a file name at the end".into())
        }
        Err(e) if e.kind() == io::ErrorKind::NotFound => {
            let folder = folder_of(&target);
            match fs::metadata(folder) {
                Ok(metadata) if metadata.is_dir() => Ok((target, None)),
                Ok(_) => refuse(
                    shown.to_string(),
                    "a file in a folder",
                    format!("{} is a file; choose another place", folder.display()),
                ),
                Err(e) if e.kind() == io::ErrorKind::NotFound => refuse(
                    shown.to_string(),
                    "a file in a folder that exists",
                    format!("create the folder {} first", folder.display()),
                ),
                Err(e) => Err(Error::io(path, "reach the folder of", e)),
            }
        }
        Err(e) if e.kind() == io::ErrorKind::NotADirectory => refuse(
            shown.to_string(),
            "a file in a folder",
            "a part of the path before the last is a file; choose another place".into(),
        ),
        Err(e) => Err(Error::io(path, "reach", e)),
    }
}

/// Where a link leads; a link to nothing names the file it would create.
fn link_target(path: &Path) -> Result<PathBuf> {
    if let Ok(target) = fs::canonicalize(path) {
        return Ok(target);
    }
    let target = fs::read_link(path).map_err(|e| Error::io(path, "follow the link", e))?;
    Ok(folder_of(path).join(target))
}

#[cfg(test)]
mod tests;
