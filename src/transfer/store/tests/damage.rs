//! Damaged, torn and hostile stores.

use super::super::metadata::LONGEST_PROVENANCE;
use super::*;

/// Every file of a store, with bytes flipped and cut off: found, with the name of the file, or
/// without effect on anything that can be read.
#[test]
fn damage_is_found_by_name_or_has_no_effect() {
    let directory = tempfile::tempdir().unwrap();
    let (path, _) = filled(directory.path());
    let sound = everything(&path).unwrap();
    let mut numbers = Numbers(1);
    let (mut found, mut harmless) = (0, 0);
    for (file, bytes) in files(&path) {
        let is_text = file.extension().is_some_and(|e| e == "json");
        let mut positions: Vec<usize> = (0..24).map(|_| numbers.below(bytes.len())).collect();
        // The places that a shard does not checksum: its stamp; and both ends.
        positions.extend([
            0,
            bytes.len() - 1,
            bytes.len() - bytes.len().min(1030),
            bytes.len() - bytes.len().min(1044),
        ]);
        for position in positions {
            let mut damaged = bytes.clone();
            damaged[position] ^= 1 << numbers.below(8);
            let cut = bytes[..position].to_vec();
            for (what, damaged) in [("flipped", damaged), ("cut", cut)] {
                fs::write(&file, &damaged).unwrap();
                match everything(&path) {
                    Err(error) => {
                        let (message, name) = (error.to_string(), file.display().to_string());
                        let root = file == path.join("zarr.json") && message.contains(&path.display().to_string());
                        assert!(message.contains(&name) || root, "{what} {position} of {name}: {message}");
                        found += 1;
                    }
                    Ok(read) => {
                        assert!(is_text, "{what} {position} of {} unnoticed", file.display());
                        assert_eq!(read, sound, "{what} {position} of {}", file.display());
                        harmless += 1;
                    }
                }
            }
        }
        fs::remove_file(&file).unwrap();
        match everything(&path) {
            Err(error) => assert!(error.to_string().contains(&path.display().to_string()), "{error}"),
            Ok(read) => assert!(file.to_string_lossy().contains("/transfer/c/") && read != sound), // Not baked.
        }
        fs::write(&file, &bytes).unwrap();
    }
    assert_eq!(everything(&path).unwrap(), sound);
    assert!(found > 500 && harmless > 0, "{found} found, {harmless} harmless");
}

#[test]
fn a_damaged_chunk_is_redone_alone_after_its_file_is_deleted() {
    let directory = tempfile::tempdir().unwrap();
    let (path, store) = filled(directory.path());
    let sound = everything(&path).unwrap();
    let file = path.join("transfer/a_b__/env/rays/c/0/0/0");
    let mut bytes = fs::read(&file).unwrap();
    bytes[100] ^= 1;
    fs::write(&file, bytes).unwrap();
    let message = store.read_chunk([0; 3]).unwrap_err().to_string();
    assert!(
        message.contains("rays/c/0/0/0") && message.contains("crc32c") && message.contains("redoes what is damaged"),
        "{message}"
    );
    assert!(store.read_chunk([0, 0, 1]).unwrap().is_some());
    fs::remove_file(path.join("transfer/a_b__/env/transfer/c/0/0/0/0")).unwrap();
    assert!(store.read_chunk([0; 3]).unwrap().is_none());
    store.write_chunk([0; 3], bricks([0; 3], 0), &extent(64)).unwrap();
    assert_eq!(everything(&path).unwrap(), sound);
}

#[test]
fn a_killed_writer_leaves_a_chunk_that_is_baked_again() {
    let directory = tempfile::tempdir().unwrap();
    let (path, store) = filled(directory.path());
    let env = path.join("transfer/a_b__/env");
    let order =
        ["rays/extent/0.0.0.json", "validity/c/0/0/0", "rays/c/0/0/0", "stderr/c/0/0/0/0", "transfer/c/0/0/0/0"];
    let read = || order.map(|name| fs::read(env.join(name)).unwrap());
    let old = read();
    store.write_chunk([0; 3], bricks([0; 3], 50), &extent(128)).unwrap();
    let new = read();
    for renamed in 0..=order.len() {
        // The state after so many renames, over an older chunk and without one.
        for (n, name) in order.iter().enumerate() {
            fs::write(env.join(name), if n < renamed { &new[n] } else { &old[n] }).unwrap();
        }
        let store = Store::open(&path).unwrap();
        let whole = renamed == 0 || renamed == order.len();
        assert_eq!(store.read_chunk([0; 3]).unwrap().is_some(), whole, "{renamed} renamed");
        assert_eq!(store.chunk_extent([0; 3]).unwrap().is_some(), whole);
        let brick = store.brick([0; 3]).map(|_| ());
        assert_eq!(brick.is_ok(), whole);
        if let Err(error) = brick {
            assert!(error.to_string().contains("files of two bakes"), "{error}");
        }
        if renamed < order.len() {
            fs::remove_file(env.join(order[4])).unwrap();
            assert!(Store::open(&path).unwrap().brick([0; 3]).unwrap().is_none());
        }
    }
    // What was staged and never renamed disappears when the chunk is written again.
    let clutter = env.join("rays/c/0/0/.partial-0-AbCdEf");
    fs::write(&clutter, "x").unwrap();
    store.write_chunk([0; 3], bricks([0; 3], 50), &extent(128)).unwrap();
    assert!(!clutter.exists());
    assert_eq!(read(), new);
}

#[test]
fn chunks_moved_to_another_place_are_noticed() {
    let directory = tempfile::tempdir().unwrap();
    let (path, _) = filled(directory.path());
    let env = path.join("transfer/a_b__/env");
    for array in ["transfer", "stderr", "validity", "rays"] {
        let tail = if array == "transfer" || array == "stderr" { "/0" } else { "" };
        let from = env.join(format!("{array}/c/0/0/0{tail}"));
        fs::copy(from, env.join(format!("{array}/c/1/0/0{tail}"))).unwrap();
    }
    assert!(Store::open(&path).unwrap().brick([0, 0, 4]).unwrap_err().to_string().contains("two bakes"));
    fs::copy(env.join("rays/extent/0.0.0.json"), env.join("rays/extent/1.0.0.json")).unwrap();
    assert!(Store::open(&path).unwrap().brick([0, 0, 4]).is_err());
}

#[test]
fn a_header_that_claims_too_much_is_refused_before_memory_is_asked_for() {
    let directory = tempfile::tempdir().unwrap();
    let (path, _) = filled(directory.path());
    let key = path.join("transfer/a_b__/env/zarr.json");
    let mut group: Value = serde_json::from_slice(&fs::read(&key).unwrap()).unwrap();
    let mut attributes = unsealed(&group).unwrap();
    // 2^60 texels; 2^39 in 2^28 flat chunks; axes beyond any.
    let sizes = [([1 << 20; 3], "texels"), ([1 << 19, 1 << 19, 2], "chunks")];
    for (size, word) in sizes.into_iter().chain([([usize::MAX; 3], "2^24"), ([0, 12, 70], "2^24")]) {
        attributes["identity"]["texels"] = json!(size);
        attributes["identity"]["grid"] = json!(size);
        group["attributes"] = sealed(attributes.clone());
        fs::write(&key, group.to_string()).unwrap();
        let message = Store::open(&path).unwrap_err().to_string();
        assert!(message.contains(word), "{message}");
    }
    // A deep provenance could be written but not be read.
    let deep = (0..200).fold(json!(0), |inner, _| json!([inner]));
    let error = Store::create(directory.path().join("deep"), &volume(), &identity(), deep).unwrap_err();
    assert!(error.to_string().contains("provenance"), "{error}");
    let long = json!("x".repeat(LONGEST_PROVENANCE));
    let error = Store::create(directory.path().join("long"), &volume(), &identity(), long).unwrap_err();
    assert!(matches!(error, Error::Limit { .. }), "{error}");
}

/// One writer replaces a chunk again and again; what a reader gets is always of one writing.
#[test]
fn a_reader_beside_a_writer_never_sees_two_writings_mixed() {
    let directory = tempfile::tempdir().unwrap();
    let (path, store) = filled(directory.path());
    let versions = [bricks([0; 3], 10), bricks([0; 3], 11)];
    let expected = [bytes_of(&versions[0]), bytes_of(&versions[1])];
    store.write_chunk([0; 3], versions[0].clone(), &extent(100)).unwrap();
    let done = std::sync::atomic::AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for n in 1..60 {
                store.write_chunk([0; 3], versions[n % 2].clone(), &extent(100 + n as u32 % 2)).unwrap();
            }
            done.store(true, std::sync::atomic::Ordering::SeqCst);
        });
        let reader = Store::open(&path).unwrap();
        let mut whole = 0;
        while !done.load(std::sync::atomic::Ordering::SeqCst) {
            // `None` where the chunk was torn at every look.
            if let Some((bricks, how)) = reader.read_chunk([0; 3]).unwrap() {
                assert!(bytes_of(&bricks) == expected[how.claims()[0].rays as usize - 100]);
                whole += 1;
            }
        }
        assert!(whole > 0);
    });
    let last = store.read_chunk([0; 3]).unwrap().map(|(bricks, how)| (bytes_of(&bricks), how.claims()[0].rays));
    assert!(last == Some((expected[1].clone(), 101)));
}
