//! Stores of other formats, moved ones, and those whose metadata was lost.

use super::super::metadata::{nodes_of, sealed, unsealed};
use super::super::zarr::{MOST_SLOTS, STAMP, tail_length};
use super::*;
use crate::file::Stamp;
use crate::volume::{Place, samples_at};

/// Rewrites a store as the versions 1 and 2 wrote it: records in a folder of their own that do not name their store, and
/// in version 1 with one claim for all isovalues of a chunk.
fn as_format(path: &Path, version: u32) {
    let env = path.join("transfer/a_b__/env");
    let records = env.join("rays/extent");
    fs::create_dir(env.join("extent")).unwrap();
    for entry in fs::read_dir(&records).unwrap() {
        let name = entry.unwrap().file_name();
        let mut record: Value = serde_json::from_slice(&fs::read(records.join(&name)).unwrap()).unwrap();
        let fields = record.as_object_mut().unwrap();
        fields.remove("stamp");
        fields.remove("of");
        if version == 1 {
            let baked = fields.remove("baked").unwrap();
            let isovalues: Vec<&Value> = baked.as_array().unwrap().iter().map(|claim| &claim["isovalue"]).collect();
            fields.insert("isovalues".into(), json!(isovalues));
            fields.insert("rays".into(), baked[0]["rays"].clone());
            fields.insert("error_target".into(), baked[0]["error"].clone());
        }
        let hash = hash_of(&record);
        record["stamp"] = json!(hash.to_hex()[..2 * STAMP]);
        fs::write(env.join("extent").join(&name), format!("{record}\n")).unwrap();
        let place = name.to_string_lossy().trim_end_matches(".json").replace('.', "/");
        for array in ["transfer", "stderr", "validity", "rays"] {
            let tail = if array == "transfer" || array == "stderr" { "/0" } else { "" };
            let file = env.join(format!("{array}/c/{place}{tail}"));
            let mut bytes = fs::read(&file).unwrap();
            let start = bytes.len() - tail_length(MOST_SLOTS);
            bytes[start..start + STAMP].copy_from_slice(&hash.as_bytes()[..STAMP]);
            fs::write(&file, bytes).unwrap();
        }
    }
    fs::remove_dir_all(&records).unwrap();
    let old = Identity { format_version: version, ..identity() };
    let nodes = nodes_of(&volume(), &old, &layout(), provenance()).unwrap();
    let mut root = zarr::group(sealed(json!({ "isolume": { "format_version": version, "volume": "a_b__" } })));
    zarr::consolidate(&mut root, &nodes, "surfaces");
    fs::write(path.join("zarr.json"), root.to_string()).unwrap();
    for (key, value) in nodes {
        fs::write(path.join(key).join("zarr.json"), value.to_string()).unwrap();
    }
}

#[test]
fn older_formats_are_read_taken_over_and_not_written() {
    for version in [1, 2] {
        let directory = tempfile::tempdir().unwrap();
        let (path, store) = filled(directory.path());
        let expected = store.read_chunk([0; 3]).unwrap().map(|(bricks, _)| bytes_of(&bricks));
        as_format(&path, version);
        let old = Store::open(&path).unwrap();
        assert_eq!(old.identity().format_version, version);
        let (bricks, extent) = old.read_chunk([0; 3]).unwrap().unwrap();
        assert_eq!(Some(bytes_of(&bricks)), expected);
        assert_eq!(extent.claims().iter().map(|c| c.isovalue).collect::<Vec<_>>(), [Some(0.1), Some(1.0 / 3.0)]);
        assert_eq!(extent.claims()[0].rays, 64);
        let refused = old.write_chunk([0; 3], bricks, &extent).unwrap_err().to_string();
        assert!(refused.contains("merge"), "{refused}");
        let refused = Store::open_or_create(&path, &volume(), &identity(), Value::Null).unwrap_err().to_string();
        assert!(refused.contains("format_version") && refused.contains("merge"), "{refused}");
        let new = Store::create(directory.path().join("new"), &volume(), &identity(), provenance()).unwrap();
        assert_eq!(new.take_from(&old).unwrap().taken, 3);
        assert_eq!(new.read_chunk([0; 3]).unwrap().map(|(bricks, _)| bytes_of(&bricks)), expected);
        assert_eq!(new.asked().unwrap(), old.asked().unwrap());
        assert!(matches!(new.verify_chunks(&[[0; 3]]).unwrap()[0], ChunkCheck::Sound(_)));
    }
}

#[cfg(unix)]
#[test]
fn a_store_that_was_moved_or_replaced_is_written_into_no_more() {
    let directory = tempfile::tempdir().unwrap();
    let (path, store) = filled(directory.path());
    let moved = directory.path().join("moved");
    fs::rename(&path, &moved).unwrap();
    let before = files(&moved);
    let write = |store: &Store| store.write_chunk([0; 3], bricks([0; 3], 5), &extent(64)).unwrap_err().to_string();
    assert!(write(&store).contains("moved"));
    assert!(!path.exists());
    // Another store at the same place.
    Store::create(&path, &volume(), &identity(), provenance()).unwrap();
    let there = files(&path);
    assert!(write(&store).contains("replaced"));
    assert_eq!((files(&moved), files(&path)), (before, there));
}

#[test]
fn a_file_that_shrinks_is_an_error_where_it_is_not_mapped() {
    let directory = tempfile::tempdir().unwrap();
    let (path, _) = filled(directory.path());
    let store = Store::open_unmapped(&path).unwrap();
    let mapped = everything(&path).unwrap();
    let read = |store: &Store| store.brick([0; 3]).map(|view| view.map(|v| bytes_of(&[Some(v.to_brick())])));
    let before = read(&store).unwrap();
    let shard = path.join("transfer/a_b__/env/transfer/c/0/0/0/0");
    fs::OpenOptions::new().write(true).open(&shard).unwrap().set_len(0).unwrap();
    // What was opened was read; what is opened now is cut off.
    assert_eq!(read(&store).unwrap(), before);
    assert!(read(&Store::open_unmapped(&path).unwrap()).is_err());
    assert!(everything(&path).is_err() && !mapped.is_empty());
}

/// Whatever file of the metadata or the samples is lost, it comes back byte by byte; where nothing proves whose store it
/// is, only with consent.
#[test]
fn lost_metadata_and_samples_come_back_byte_by_byte() {
    let directory = tempfile::tempdir().unwrap();
    let (path, _) = filled(directory.path());
    let whole = files(&path);
    let reopen = |options: StoreOptions| options.open_or_create(&path, &volume(), &identity(), provenance());
    for (file, bytes) in &whole {
        let name = file.strip_prefix(&path).unwrap().to_string_lossy().into_owned();
        if name.contains("/env/") && !name.ends_with("zarr.json") {
            continue; // Chunks.
        }
        for damage in [None, Some(Vec::new()), Some(vec![0; bytes.len()]), Some(bytes[..bytes.len() / 2].to_vec())] {
            match &damage {
                None => fs::remove_file(file).unwrap(),
                Some(damage) => fs::write(file, damage).unwrap(),
            }
            let store = reopen(StoreOptions::default()).unwrap();
            assert_eq!(store.mended().len(), 1, "{name}: {:?}", store.mended());
            assert!(store.mended()[0].contains(if name.contains("/c/") { "samples" } else { &name }));
            assert!(files(&path) == whole, "{name} differs");
        }
    }
    assert!(reopen(StoreOptions::default()).unwrap().mended().is_empty());
    // Nothing is left that proves it.
    fs::remove_dir_all(path.join("transfer/a_b__/env/rays/extent")).unwrap();
    fs::remove_file(path.join("transfer/a_b__/env/zarr.json")).unwrap();
    let refused = reopen(StoreOptions::default()).unwrap_err().to_string();
    assert!(refused.contains("--repair"), "{refused}");
    assert_eq!(reopen(StoreOptions::default().repair(true)).unwrap().mended().len(), 1);
    // A store of something else is never written over.
    let other = Identity { seed: 5, ..identity() };
    let before = files(&path);
    let options = StoreOptions::default().repair(true);
    assert!(matches!(options.open_or_create(&path, &volume(), &other, provenance()), Err(Error::Mismatch { .. })));
    assert!(files(&path) == before);
}

#[test]
fn a_damaged_chunk_is_set_aside_and_remembered_until_it_is_there_again() {
    let directory = tempfile::tempdir().unwrap();
    let (path, store) = filled(directory.path());
    store.ask(&extent(64)).unwrap();
    let whole = files(&path);
    let file = path.join("transfer/a_b__/env/rays/c/0/0/0");
    let mut bytes = fs::read(&file).unwrap();
    bytes[100] ^= 1;
    fs::write(&file, bytes).unwrap();
    let all = [[0, 0, 0], [1, 0, 0], [0, 0, 1]];
    let found = store.verify_chunks(&all).unwrap();
    assert!(matches!(&found[0], ChunkCheck::Damaged(what) if what.contains("rays/c/0/0/0")), "{found:?}");
    assert!(found[1] == ChunkCheck::Absent && found[2] == ChunkCheck::Sound(extent(64)), "{found:?}");
    store.set_aside([0; 3]).unwrap();
    assert_eq!(store.verify_chunks(&all[..1]).unwrap(), [ChunkCheck::Absent]);
    assert_eq!(store.awaited().unwrap(), [[0; 3]]);
    assert_eq!(store.asked().unwrap(), extent(64));
    store.write_chunk([0; 3], bricks([0; 3], 0), &extent(64)).unwrap();
    store.clear_set_aside([0; 3]).unwrap();
    assert!(store.awaited().unwrap().is_empty() && files(&path) == whole);
    // One file of a chunk without the others.
    fs::remove_file(path.join("transfer/a_b__/env/transfer/c/0/0/0/0")).unwrap();
    assert!(
        matches!(&store.verify_chunks(&all[..1]).unwrap()[0], ChunkCheck::Damaged(what) if what.contains("missing"))
    );
}

#[test]
fn what_was_asked_survives_the_loss_of_its_note() {
    let directory = tempfile::tempdir().unwrap();
    let (path, store) = filled(directory.path());
    let more = ChunkExtent::new(Some(7.0), 16, None);
    store.ask(&more).unwrap();
    let note = path.join("transfer/a_b__/env/rays/asked.json");
    let mut both = extent(64);
    both.join(&more);
    assert_eq!(store.asked().unwrap(), both);
    fs::write(&note, "").unwrap();
    // What chunks claim is known all the same.
    assert_eq!(store.asked().unwrap(), extent(64));
    assert!(store.asked_damage().unwrap().is_some());
    store.ask(&more).unwrap();
    assert!(store.asked().unwrap() == both && store.asked_damage().unwrap().is_none());
}

#[test]
fn a_store_of_a_later_version_is_never_written_over() {
    let directory = tempfile::tempdir().unwrap();
    let (path, _) = filled(directory.path());
    let later = json!({ "isolume": { "format_version": FORMAT_VERSION + 1, "volume": "a_b__" } });
    fs::write(path.join("zarr.json"), zarr::group(sealed(later)).to_string()).unwrap();
    fs::write(path.join("transfer/a_b__/env/zarr.json"), "{ \"of\": \"a later version\" }").unwrap();
    let before = files(&path);
    let options = StoreOptions::default().repair(true);
    let refused = options.open_or_create(&path, &volume(), &identity(), provenance()).unwrap_err().to_string();
    assert!(refused.contains("format version") && files(&path) == before, "{refused}");
}

/// What other programs would read and this one does not: the root's copy of the metadata.
#[test]
fn a_wrong_copy_of_metadata_is_damage_and_is_mended() {
    let directory = tempfile::tempdir().unwrap();
    let (path, _) = filled(directory.path());
    let whole = files(&path);
    let key = path.join("zarr.json");
    let mut root: Value = serde_json::from_slice(&fs::read(&key).unwrap()).unwrap();
    root["consolidated_metadata"]["metadata"]["volumes/a_b__/data"]["shape"] = json!([1, 2, 3]);
    fs::write(&key, root.to_string()).unwrap();
    let findings = || {
        let store = Store::open(&path).unwrap();
        let nothing = |_: &Volume, _: &Holdings| crate::transfer::Selection::empty(layout().lattice);
        diagnose(&store, &nothing).unwrap().findings
    };
    let found = findings();
    let found = found.iter().find(|f| f.topic == "damaged metadata").expect("a finding");
    assert!(found.is_damage() && found.found.contains("volumes/a_b__/data"), "{found:?}");
    let store = Store::open_or_create(&path, &volume(), &identity(), provenance()).unwrap();
    assert_eq!(store.mended().len(), 1);
    assert!(files(&path) == whole && findings().iter().all(|f| !f.is_damage()));
}

/// A pipe in the place of a file would be waited for.
#[cfg(unix)]
#[test]
fn a_pipe_in_the_place_of_a_file_is_an_error() {
    let directory = tempfile::tempdir().unwrap();
    let (path, _) = filled(directory.path());
    for name in ["transfer/a_b__/env/stderr/c/0/0/0/0", "transfer/a_b__/env/zarr.json"] {
        let file = path.join(name);
        fs::remove_file(&file).unwrap();
        rustix::fs::mkfifoat(rustix::fs::CWD, &file, rustix::fs::Mode::RUSR).unwrap();
        let error = everything(&path).unwrap_err().to_string();
        assert!(error.contains(name) && error.contains("plain file"), "{error}");
    }
}

/// The volume with its samples in a file, behind a few bytes of something else.
fn in_file(file: &Path) -> Volume {
    let own = volume();
    let metadata = fs::metadata(file).unwrap();
    let Stamp { bytes, modified } = Stamp::of(&metadata);
    let place = Place { file: file.to_owned(), offset: 6, bytes, modified };
    let samples = samples_at(&place, own.samples().type_name(), own.samples().len(), true).unwrap();
    let made = Volume::new(own.dims(), samples, *own.world_from_grid()).unwrap();
    let mut made = made.with_scaling(own.slope(), own.inter()).unwrap();
    (made.name, made.unit, made.up, made.solid) = (own.name, own.unit, own.up, own.solid);
    (made.notes, made.by_reference) = (own.notes, true);
    made
}

#[test]
fn a_store_may_refer_to_the_file_of_its_volume() {
    let directory = tempfile::tempdir().unwrap();
    let (copy, _) = filled(directory.path());
    let (file, path) = (directory.path().join("samples.raw"), directory.path().join("r.isolume"));
    let content = [&b"header"[..], volume().samples().bytes()].concat();
    fs::write(&file, &content).unwrap();
    let written = fs::metadata(&file).unwrap().modified().unwrap();
    let store = Store::create(&path, &in_file(&file), &identity(), provenance()).unwrap();
    // Without consent nothing of a user is mapped.
    let read = store.volume().unwrap();
    assert_eq!((read.samples(), read.by_reference), (volume().samples(), false));
    assert!(read.samples().bytes_owned() > 0);
    let store = store.map_samples(true);
    let array = path.join("volumes/a_b__/data");
    assert!(!array.join("c").exists());
    let found = store.volume().unwrap();
    assert_eq!((found.samples(), found.samples().bytes_owned()), (volume().samples(), 0));
    assert_eq!((found.content_hash(), found.by_reference), (volume().content_hash(), true));
    // Another bake goes on without a look at all samples; one of a copied volume keeps what the store has.
    let reopen = |volume: &Volume| StoreOptions::default().open_or_create(&path, volume, &identity(), provenance());
    assert!(reopen(&in_file(&file)).unwrap().mended().is_empty());
    assert!(reopen(&volume()).unwrap().mended().is_empty());

    // The same length and time, and other samples: what trusts those does not see it, the doctor does.
    let set = |bytes: &[u8], time| {
        fs::write(&file, bytes).unwrap();
        fs::File::options().write(true).open(&file).unwrap().set_modified(time).unwrap();
    };
    let mut other = content.clone();
    other[6] ^= 1;
    set(&other, written);
    let changed = in_file(&file);
    Store::recognise(&path, &changed);
    assert_eq!(changed.content_hash(), volume().content_hash());
    assert!(store.volume().is_ok());
    let refused = store.volume_verified(true).unwrap_err().to_string();
    assert!(refused.contains("BLAKE3") && refused.contains("samples.raw"), "{refused}");
    // Read as a whole they are compared.
    assert!(Store::open(&path).unwrap().volume().is_err());

    // Cut, written since, or gone: refused by name with what to do.
    let refuses = |found: &str| {
        let text = Store::open(&path).unwrap().volume().unwrap_err().to_string();
        assert!(text.contains("samples.raw") && text.contains(found) && text.contains("--store-volume"), "{text}");
    };
    set(&content[..content.len() - 2], written);
    refuses("67204 bytes");
    set(&content, written + std::time::Duration::from_secs(1));
    refuses("written since");
    let moved = directory.path().join("moved.raw");
    fs::rename(&file, &moved).unwrap();
    refuses("No such file");
    // The same samples elsewhere take its place; other samples are another volume.
    let mended = reopen(&in_file(&moved)).unwrap();
    assert!(mended.mended().iter().any(|line| line.contains("data")), "{:?}", mended.mended());
    assert_eq!(mended.volume().unwrap().samples(), volume().samples());
    // Or a copy of them, and then the store is as if it had always had one.
    fs::remove_file(&moved).unwrap();
    reopen(&volume()).unwrap();
    assert_eq!(Store::open(&path).unwrap().volume().unwrap().samples(), volume().samples());
    let below = |root: &Path| -> Vec<(PathBuf, Vec<u8>)> {
        let relative = |(path, bytes): (PathBuf, Vec<u8>)| (path.strip_prefix(root).unwrap().to_owned(), bytes);
        files(root).into_iter().map(relative).collect()
    };
    assert!(below(&path.join("volumes")) == below(&copy.join("volumes")));
    // Samples in memory cannot be referred to.
    let mut own = volume();
    own.by_reference = true;
    let refused = Store::create(directory.path().join("own"), &own, &identity(), provenance()).unwrap_err().to_string();
    assert!(refused.contains("--store-volume"), "{refused}");
    assert!(!directory.path().join("own").exists());
}

/// Whatever a store that names a file says wrongly, the same bake puts it right from a file with these samples, or from a copy.
#[test]
fn a_reference_to_other_samples_is_mended() {
    let directory = tempfile::tempdir().unwrap();
    let place = |name: &str| directory.path().join(name);
    let content = [&b"header"[..], volume().samples().bytes()].concat();
    let mut other = content.clone();
    other[6] ^= 1;
    let (file, path) = (place("samples.raw"), place("r.isolume"));
    let write = |file: &Path, content: &[u8], time| {
        fs::write(file, content).unwrap();
        fs::File::options().write(true).open(file).unwrap().set_modified(time).unwrap();
    };
    let time = std::time::SystemTime::UNIX_EPOCH + std::time::Duration::from_secs(1_700_000_000);
    let reopen = |volume: &Volume| StoreOptions::default().open_or_create(&path, volume, &identity(), provenance());
    let verified = || Store::open(&path).unwrap().map_samples(true).volume_verified(true).map(|v| v.content_hash());
    for way in ["file", "copy"] {
        let _ = fs::remove_dir_all(&path);
        write(&file, &content, time);
        Store::create(&path, &in_file(&file), &identity(), provenance()).unwrap();
        assert_eq!(verified().unwrap(), volume().content_hash());
        write(&file, &other, time);
        assert!(verified().is_err());
        let right = place("right.raw");
        fs::write(&right, &content).unwrap();
        let at_hand = if way == "file" { in_file(&right) } else { volume() };
        let mended = reopen(&at_hand).unwrap();
        assert!(mended.mended()[0].contains("data/zarr.json"), "{way}: {:?}", mended.mended());
        assert_eq!(verified().unwrap(), volume().content_hash(), "{way}");
        assert_eq!(mended.samples_file(), (way == "file").then(|| right.canonicalize().unwrap()));
        assert!(reopen(&at_hand).unwrap().mended().is_empty(), "{way}");
    }
}

/// Rewrites what the samples of a store say of themselves, with a sound hash.
fn reseal(path: &Path, change: impl Fn(&mut Value)) {
    let key = path.join("volumes/a_b__/data/zarr.json");
    let mut node: Value = serde_json::from_slice(&fs::read(&key).unwrap()).unwrap();
    let mut attributes = unsealed(&node).unwrap();
    change(&mut attributes);
    node["attributes"] = sealed(attributes);
    fs::write(&key, node.to_string()).unwrap();
}

#[test]
fn the_frame_of_samples_is_compared_whether_they_are_copied_or_named() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("samples.raw");
    fs::write(&file, [&b"header"[..], volume().samples().bytes()].concat()).unwrap();
    let (copied, named) = (volume(), in_file(&file));
    for (name, volume) in [("copied", &copied), ("named", &named)] {
        let path = directory.path().join(name);
        Store::create(&path, volume, &identity(), provenance()).unwrap();
        let whole = files(&path);
        let reopen = || StoreOptions::default().open_or_create(&path, volume, &identity(), provenance()).unwrap();
        let changes: [fn(&mut Value); 3] =
            [|a| a["affine"][0][3] = json!(7.0), |a| a["slope"] = json!(0.2), |a| a["inter"] = json!(0.5)];
        for change in changes {
            reseal(&path, change);
            assert!(Store::open(&path).unwrap().map_samples(true).volume_verified(true).is_err(), "{name}");
            let recognised = in_file(&file);
            Store::recognise(&path, &recognised);
            assert_eq!(recognised.content_hash(), volume.content_hash(), "{name}");
            // Its line, and that of the copy in the root, which was right.
            assert!(reopen().mended()[0].contains("damaged"), "{name}");
            assert!(files(&path) == whole, "{name}");
        }
        // What does not matter to light may differ.
        reseal(&path, |a| a["name"] = json!("another"));
        assert!(!reopen().mended().iter().any(|line| line.contains("data/zarr.json")), "{name}");
    }
}

#[test]
fn a_path_that_a_store_cannot_name_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("samples.raw");
    fs::write(&file, [&b"header"[..], volume().samples().bytes()].concat()).unwrap();
    let path = directory.path().join("r.isolume");
    Store::create(&path, &in_file(&file), &identity(), provenance()).unwrap();
    let climbing = format!("{}/x/../samples.raw", directory.path().display());
    for wrong in ["samples.raw", "../samples.raw", &climbing] {
        reseal(&path, |a| a["reference"]["file"] = json!(wrong));
        for maps in [false, true] {
            let text = Store::open(&path).unwrap().map_samples(maps).volume().unwrap_err().to_string();
            assert!(text.contains(wrong) && text.contains("an absolute path"), "{text}");
        }
        let mended = StoreOptions::default().open_or_create(&path, &in_file(&file), &identity(), provenance());
        assert_eq!(mended.unwrap().samples_file(), Some(file.canonicalize().unwrap()));
    }
    // A file that is gone, though its samples are still there to be read.
    let gone = in_file(&file);
    fs::rename(&file, directory.path().join("moved.raw")).unwrap();
    let text = Store::create(directory.path().join("gone"), &gone, &identity(), provenance()).unwrap_err().to_string();
    assert!(text.contains("moved") && text.contains("--store-volume"), "{text}");
    #[cfg(target_os = "linux")]
    {
        use std::os::unix::ffi::OsStrExt;
        let odd = directory.path().join(std::ffi::OsStr::from_bytes(b"s\xff.raw"));
        fs::write(&odd, [&b"header"[..], volume().samples().bytes()].concat()).unwrap();
        let new = directory.path().join("odd");
        let text = Store::create(&new, &in_file(&odd), &identity(), provenance()).unwrap_err().to_string();
        assert!(text.contains("UTF-8") && text.contains("rename") && !new.exists(), "{text}");
    }
}

#[test]
fn who_packs_a_store_copies_the_samples_that_it_names() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("samples.raw");
    let content = [&b"header"[..], volume().samples().bytes()].concat();
    fs::write(&file, &content).unwrap();
    let path = directory.path().join("r.isolume");
    let store = Store::create(&path, &in_file(&file), &identity(), provenance()).unwrap().map_samples(true);
    assert_eq!(store.notes().unwrap().len(), 1);
    assert!(store.keeps_otherwise(&volume()).is_some_and(|text| text.contains("samples.raw")));
    assert!(store.keeps_otherwise(&in_file(&file)).is_none());
    // A merge names the same file.
    let merged = directory.path().join("m.isolume");
    StoreOptions::default().merge(&[Store::open(&path).unwrap().map_samples(true)], &merged).unwrap();
    assert_eq!(Store::open(&merged).unwrap().samples_file(), store.samples_file());
    let packed = directory.path().join("p.isolume");
    StoreOptions::default().pack(&store, &packed, PackError::Relative(0.01)).unwrap();
    // Neither takes other samples.
    let time = fs::metadata(&file).unwrap().modified().unwrap();
    let mut other = content;
    other[6] ^= 1;
    fs::write(&file, other).unwrap();
    fs::File::options().write(true).open(&file).unwrap().set_modified(time).unwrap();
    let new = directory.path().join("new");
    assert!(StoreOptions::default().pack(&store, &new, PackError::Relative(0.01)).is_err() && !new.exists());
    assert!(StoreOptions::default().merge(&[store], &new).is_err() && !new.exists());
    fs::remove_file(&file).unwrap();
    let packed = Store::open(&packed).unwrap();
    assert_eq!((packed.samples_file(), packed.notes().unwrap()), (None, Vec::new()));
    assert_eq!(packed.volume().unwrap().content_hash(), volume().content_hash());
    let mut named = volume();
    named.by_reference = true;
    assert!(packed.keeps_otherwise(&named).is_some_and(|text| text.contains("keeps its copy")));
    let nothing = |_: &Volume, _: &Holdings| crate::transfer::Selection::empty(layout().lattice);
    let found = diagnose(&packed, &nothing).unwrap().findings;
    assert!(found.iter().all(|f| !f.is_damage()), "{found:?}");
}
