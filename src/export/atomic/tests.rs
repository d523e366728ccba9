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
