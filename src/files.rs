//! Files whose names come from elsewhere: plain files only, below the folder of the file that names them.
//!
//! A name in a header may lead anywhere, and opening is not harmless: a pipe waits for a writer that never comes, a device
//! never ends. So what a path leads to is looked at before it is opened, and again afterwards.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]

use crate::error::{Error, Result};
use std::fs::{File, FileType, OpenOptions};
use std::io::Read;
use std::path::{Component, Path, PathBuf};

/// Opens a plain file for reading; links are followed.
///
/// # Errors
/// [`Error::Argument`] naming what the path leads to where that is a folder, a pipe, a device or a socket, without opening
/// it; [`Error::Io`] when the system refuses.
pub fn open_plain(path: impl AsRef<Path>) -> Result<File> {
    let path = path.as_ref();
    let failed = |e| Error::io(path, "open", e);
    check_plain(path, std::fs::metadata(path).map_err(failed)?.file_type())?;
    let mut options = OpenOptions::new();
    options.read(true);
    // What took its place since then must not make the opening wait.
    #[cfg(unix)]
    {
        use std::os::unix::fs::OpenOptionsExt;
        options.custom_flags(rustix::fs::OFlags::NONBLOCK.bits() as i32);
    }
    let file = options.open(path).map_err(failed)?;
    check_plain(path, file.metadata().map_err(failed)?.file_type())?;
    Ok(file)
}

/// The bytes of a plain file, of which there may be at most so many.
///
/// # Errors
/// As [`open_plain`]; [`Error::Limit`] when the file is longer.
pub fn read_plain(path: impl AsRef<Path>, most: u64) -> Result<Vec<u8>> {
    let path = path.as_ref();
    let file = open_plain(path)?;
    let failed = |e| Error::io(path, "read", e);
    let length = file.metadata().map_err(failed)?.len();
    let too_long = |length: u64| Error::Limit {
        what: format!("{}", path.display()),
        needed: format!("{length} bytes"),
        limit: format!("{most} bytes"),
        remedy: "check that this is the file you mean, or make it smaller".into(),
    };
    if length > most {
        return Err(too_long(length));
    }
    let mut bytes = Vec::new();
    // It may have grown since.
    file.take(most.saturating_add(1)).read_to_end(&mut bytes).map_err(failed)?;
    if bytes.len() as u64 > most { Err(too_long(bytes.len() as u64)) } else { Ok(bytes) }
}

/// The path of a file that another file in `folder` names; only below `folder` unless `allow_outside`.
///
/// # Errors
/// [`Error::Argument`] when the name is absolute, leads out of the folder by `..`, or is a link to outside.
pub fn inside(folder: &Path, name: &str, allow_outside: bool) -> Result<PathBuf> {
    let path = folder.join(name);
    if allow_outside {
        return Ok(path);
    }
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let refuse = |found: String| {
        let remedy = "move the file there, or allow it with --allow-outside if you trust the file that names it";
        Err(Error::argument("named file", found, format!("a file below the folder {}", here.display()), remedy))
    };
    let mut depth = 0usize;
    for component in Path::new(name).components() {
        match component {
            Component::Normal(_) => depth += 1,
            Component::CurDir => {}
            Component::ParentDir if depth > 0 => depth -= 1,
            Component::ParentDir | Component::RootDir | Component::Prefix(_) => return refuse(name.to_string()),
        }
    }
    // A file that is not there is the opener's to refuse.
    if let (Ok(real), Ok(root)) = (path.canonicalize(), here.canonicalize())
        && !real.starts_with(&root)
    {
        return refuse(format!("{name}, a link to {}", real.display()));
    }
    Ok(path)
}

/// Refuses what is no plain file.
fn check_plain(path: &Path, found: FileType) -> Result<()> {
    if found.is_file() {
        return Ok(());
    }
    let given = format!("{}, which is {}", path.display(), kind(found));
    Err(Error::argument("file", given, "a plain file", "give the file itself, or save the data to a file first"))
}

/// What a path leads to, with its article.
fn kind(found: FileType) -> &'static str {
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        if found.is_fifo() {
            return "a pipe";
        }
        if found.is_char_device() || found.is_block_device() {
            return "a device";
        }
        if found.is_socket() {
            return "a socket";
        }
    }
    if found.is_dir() { "a folder" } else { "no plain file" }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_lead_out_of_a_folder_are_refused() {
        let root = tempfile::tempdir().expect("a folder");
        let folder = root.path().join("data");
        std::fs::create_dir_all(folder.join("sub")).expect("folders");
        std::fs::write(folder.join("sub/a.raw"), b"a").expect("a file");
        std::fs::write(root.path().join("secret"), b"s").expect("a file");
        for good in ["sub/a.raw", "./sub/a.raw", "sub/../sub/a.raw", "not-there.raw"] {
            assert_eq!(inside(&folder, good, false).expect(good), folder.join(good));
        }
        for bad in ["../secret", "sub/../../secret", "/etc/passwd", ".."] {
            let message = inside(&folder, bad, false).expect_err(bad).to_string();
            assert!(message.contains(bad) && message.contains("--allow-outside"), "{message}");
            assert_eq!(inside(&folder, bad, true).expect("allowed"), folder.join(bad));
        }
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("../secret", folder.join("link")).expect("a link");
            assert!(inside(&folder, "link", false).expect_err("a link").to_string().contains("a link to"));
            std::os::unix::fs::symlink("sub/a.raw", folder.join("near")).expect("a link");
            assert!(inside(&folder, "near", false).is_ok());
        }
    }

    #[test]
    fn a_longer_file_than_allowed_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a");
        std::fs::write(&path, [7; 10]).expect("a file");
        assert_eq!(read_plain(&path, 10).expect("its bytes"), [7; 10]);
        assert!(matches!(read_plain(&path, 9), Err(Error::Limit { .. })));
    }

    /// Would hang where a pipe is opened as a file is.
    #[cfg(unix)]
    #[test]
    fn devices_pipes_and_folders_are_refused_by_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let pipe = folder.path().join("pipe");
        rustix::fs::mknodat(rustix::fs::CWD, &pipe, rustix::fs::FileType::Fifo, rustix::fs::Mode::RUSR, 0)
            .expect("a pipe");
        let socket = folder.path().join("socket");
        let _listener = std::os::unix::net::UnixListener::bind(&socket).expect("a socket");
        for (path, what) in [
            (Path::new("/dev/zero"), "a device"),
            (&pipe, "a pipe"),
            (folder.path(), "a folder"),
            (&socket, "a socket"),
        ] {
            let message = open_plain(path).expect_err(what).to_string();
            assert!(message.contains(what) && message.contains(&path.display().to_string()), "{message}");
        }
    }
}
