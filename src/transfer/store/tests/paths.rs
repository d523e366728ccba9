//! Paths: what is not a store, archives, locks, names.

use super::super::metadata::node_name;
use super::*;

#[test]
fn paths_that_hold_no_store_are_named() {
    let directory = tempfile::tempdir().unwrap();
    let (path, _) = filled(directory.path());
    let at = |name: &str| directory.path().join(name);
    let message = |path: &Path| Store::open(path).unwrap_err().to_string();
    assert!(message(&at("absent")).contains("absent: cannot open the store"));
    fs::write(at("file"), "text").unwrap();
    assert!(message(&at("file")).contains("a file of another kind"));
    fs::write(at("empty"), "").unwrap();
    assert!(message(&at("empty")).contains("a file of another kind"));
    fs::create_dir(at("directory")).unwrap();
    assert!(message(&at("directory")).contains("no zarr.json inside"));
    fs::write(at("directory/.zgroup"), "{}").unwrap();
    assert!(message(&at("directory")).contains("version 2"));
    fs::write(at("directory/zarr.json"), zarr::group(json!({})).to_string()).unwrap();
    assert!(message(&at("directory")).contains("another program"));
    fs::write(at("directory/zarr.json"), "{\"zarr_format\": 3").unwrap();
    assert!(message(&at("directory")).contains("EOF"));
    assert!(message(&path.join("transfer/a_b__/env/rays")).contains("a Zarr array"));
    for root in [json!({ "format_version": FORMAT_VERSION + 1 }), json!({})] {
        fs::write(at("directory/zarr.json"), zarr::group(sealed(json!({ "isolume": root }))).to_string()).unwrap();
        assert!(message(&at("directory")).contains("format version from 1 to 3"));
    }
    // A node name that would lead out of the store.
    let root = json!({ "isolume": { "format_version": FORMAT_VERSION, "volume": "../../x" } });
    fs::write(at("directory/zarr.json"), zarr::group(sealed(root)).to_string()).unwrap();
    assert!(message(&at("directory")).contains("name of a volume"));
    for taken in ["file", "directory", "x.isolume"] {
        let error = Store::create(at(taken), &volume(), &identity(), Value::Null).unwrap_err();
        assert!(error.to_string().contains("a path where nothing is yet"), "{error}");
    }
    let error = Store::open_or_create(at("no/such/parent"), &volume(), &identity(), Value::Null).unwrap_err();
    assert!(error.to_string().contains("cannot create the store"), "{error}");
}

#[test]
fn a_zip_of_a_store_reads_like_the_store() {
    let directory = tempfile::tempdir().unwrap();
    let (path, _) = filled(directory.path());
    let zip = directory.path().join("x.zip");
    pack_zip(&path, &zip).unwrap();
    assert_eq!(everything(&zip).unwrap(), everything(&path).unwrap());
    let store = Store::open(&zip).unwrap();
    assert!(store.write_chunk([0; 3], vec![None; 64], &extent(1)).unwrap_err().to_string().contains("unpack"));
    assert!(store.lock().unwrap_err().to_string().contains("unpack"));
    assert!(pack_zip(&path, &zip).is_err(), "never over something that exists");

    // As `zip -0 -r` packs: the directory's name before every key, nothing aligned.
    use std::io::Write;
    let foreign = directory.path().join("foreign.zip");
    let mut out = ::zip::ZipWriter::new(fs::File::create(&foreign).unwrap());
    let options = ::zip::write::SimpleFileOptions::default().compression_method(::zip::CompressionMethod::Stored);
    out.add_directory("x.isolume/", options).unwrap();
    for (file, bytes) in files(&path) {
        let key = file.strip_prefix(directory.path()).unwrap().to_string_lossy().into_owned();
        out.start_file(key, options).unwrap();
        out.write_all(&bytes).unwrap();
    }
    out.finish().unwrap();
    assert_eq!(everything(&foreign).unwrap(), everything(&path).unwrap());
    let sound = fs::read(&foreign).unwrap();
    for part in 1..16 {
        fs::write(&foreign, &sound[..sound.len() * part / 16]).unwrap();
        assert!(everything(&foreign).unwrap_err().to_string().contains("foreign.zip"));
    }
    // The last entry marked as deflated (8), in its central header.
    let mut deflated = sound.clone();
    let header = sound.windows(4).rposition(|w| w == b"PK\x01\x02").unwrap();
    deflated[header + 10] = 8;
    fs::write(&foreign, deflated).unwrap();
    let message = everything(&foreign).unwrap_err().to_string();
    assert!(message.contains("zip -0 -r") && message.contains("foreign.zip"), "{message}");
    // Flipped anywhere, it is refused or reads the same.
    let unpacked = everything(&path).unwrap();
    let mut numbers = Numbers(3);
    for _ in 0..400 {
        let mut flipped = sound.clone();
        // Half of the flips among the directory of the archive at its end.
        let span = if numbers.below(2) == 0 { flipped.len() } else { flipped.len() - header + 2000 };
        let position = flipped.len() - 1 - numbers.below(span);
        flipped[position] ^= 1 << numbers.below(8);
        fs::write(&foreign, flipped).unwrap();
        match everything(&foreign) {
            Err(error) => assert!(error.to_string().contains("foreign.zip"), "{error}"),
            Ok(read) => assert!(read == unpacked, "flip at {position} unnoticed"),
        }
    }
}

#[test]
fn a_second_baker_is_kept_out_until_the_first_is_done() {
    let directory = tempfile::tempdir().unwrap();
    let (path, store) = filled(directory.path());
    let before = everything(&path).unwrap();
    let lock = store.lock().unwrap();
    let message = Store::open(&path).unwrap().lock().unwrap_err().to_string();
    assert!(message.contains(&format!("process {}", std::process::id())), "{message}");
    assert_eq!(everything(&path).unwrap(), before);
    drop(lock);
    assert!(!path.join(".lock").exists());
    // What a killed process leaves: the file, with nobody holding it.
    fs::write(path.join(".lock"), "process 1 on elsewhere\nand more").unwrap();
    let lock = store.lock().unwrap();
    assert_eq!(fs::read_to_string(path.join(".lock")).unwrap().lines().count(), 1);
    drop(lock);
}

#[test]
fn names_of_nodes_are_safe_and_settle() {
    for (name, node) in [
        ("mni152_t1-2.5mm", "mni152_t1-2.5mm"),
        ("", "volume"),
        ("..", "volume.."),
        ("__x", "volume__x"),
        ("/etc/passwd", "_etc_passwd"),
        ("zarr json", "zarr_json"),
    ] {
        assert_eq!(node_name(name), node);
        assert_eq!(node_name(node), node);
    }
    let long = node_name(&".".repeat(100));
    assert_eq!(long.len(), 64);
    assert_eq!(node_name(&long), long);
}
