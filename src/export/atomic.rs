//! Files that appear whole or not at all.
//!
//! The bytes go to a hidden temporary file in the folder of the target, which then takes the
//! target's place by a rename. A failure removes it; only a kill in mid-write can leave one
//! behind (`.isolume-*.tmp`). The rename is atomic towards other processes; it is not synced
//! to the platter, so after a power cut the file system decides.

use crate::error::{Error, Result};
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
    let mut builder = tempfile::Builder::new();
    builder.prefix(".isolume-").suffix(".tmp");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // Goes through open(2), so the umask applies, as for any new file.
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    let temporary = builder.tempfile_in(folder).map_err(|e| Error::io(path, "create a file in its folder", e))?;
    let file = temporary.as_file().try_clone().map_err(|e| Error::io(path, "open", e))?;
    let (value, file) = fill(path, file, body)?;
    if let Some(metadata) = existing {
        file.set_permissions(metadata.permissions()).map_err(|e| Error::io(path, "set the permissions of", e))?;
    }
    drop(file);
    temporary.persist(&target).map_err(|e| Error::io(path, "replace", e.error))?;
    Ok(value)
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

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn put(path: &Path, bytes: &[u8]) -> Result<()> {
        write(path, |w| w.write_all(bytes).map_err(|e| Error::io("", "write", e)))
    }

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn creates_and_replaces() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.bin");
        put(&path, b"first, and longer").unwrap();
        put(&path, b"second").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
        assert_eq!(names(folder.path()), ["out.bin"]);
    }

    #[test]
    fn a_failure_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.bin");
        put(&path, b"old").unwrap();
        let error = write(&path, |w| -> Result<()> {
            // More than the buffer, so that part of it reaches the disk.
            w.write_all(&vec![7; 2 * BUFFER + 5]).unwrap();
            Err(Error::format("test", "nothing", "something", "stop"))
        });
        let message = error.unwrap_err().to_string();
        assert!(message.contains("out.bin"), "{message}");
        assert_eq!(fs::read(&path).unwrap(), b"old");
        assert_eq!(names(folder.path()), ["out.bin"]);
    }

    #[test]
    fn a_panic_in_the_body_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.bin");
        let outcome = std::panic::catch_unwind(|| write(&path, |_| -> Result<()> { panic!("a bug") }));
        assert!(outcome.is_err());
        assert!(names(folder.path()).is_empty());
    }

    #[test]
    fn impossible_targets_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        put(&at("file"), b"x").unwrap();
        let cases = [
            (folder.path().to_path_buf(), "is a folder"),
            (at("missing/out.glb"), "create the folder"),
            (at("out.glb/"), "not of a folder"),
            (at("file/out.glb"), "choose another place"),
            (PathBuf::new(), "an empty path"),
        ];
        for (path, expected) in cases {
            let message = put(&path, b"x").unwrap_err().to_string();
            assert!(message.contains(expected), "{}: {message}", path.display());
        }
        assert_eq!(names(folder.path()), ["file"]);
    }

    #[cfg(unix)]
    #[test]
    fn permissions_are_those_of_a_plain_file_and_are_kept() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let mode = |p: &Path| fs::metadata(p).unwrap().permissions().mode() & 0o777;
        let (plain, ours) = (folder.path().join("plain"), folder.path().join("ours"));
        fs::write(&plain, b"x").unwrap();
        put(&ours, b"x").unwrap();
        assert_eq!(mode(&ours), mode(&plain));
        fs::set_permissions(&ours, fs::Permissions::from_mode(0o640)).unwrap();
        put(&ours, b"y").unwrap();
        assert_eq!(mode(&ours), 0o640);
        fs::set_permissions(&ours, fs::Permissions::from_mode(0o444)).unwrap();
        assert!(put(&ours, b"z").unwrap_err().to_string().contains("write-protected"));
        assert_eq!(fs::read(&ours).unwrap(), b"y");
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("deep")).unwrap();
        let (real, link, broken) =
            (folder.path().join("deep/real"), folder.path().join("link"), folder.path().join("broken"));
        put(&real, b"1").unwrap();
        std::os::unix::fs::symlink("deep/real", &link).unwrap();
        std::os::unix::fs::symlink("deep/later", &broken).unwrap();
        put(&link, b"2").unwrap();
        put(&broken, b"3").unwrap();
        assert!(link.is_symlink() && broken.is_symlink());
        assert_eq!(fs::read(&real).unwrap(), b"2");
        assert_eq!(fs::read(folder.path().join("deep/later")).unwrap(), b"3");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_device_is_reported_and_not_replaced() {
        use std::os::unix::fs::FileTypeExt;
        let full = Path::new("/dev/full");
        let message = put(full, b"x").unwrap_err().to_string();
        assert!(message.contains("/dev/full: cannot write") && message.contains("space"), "{message}");
        assert!(fs::metadata(full).unwrap().file_type().is_char_device());
        put(Path::new("/dev/null"), b"x").unwrap();
        assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());
    }
}
