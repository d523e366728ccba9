//! Stores that were damaged, cut off, replaced or moved: the same command mends them, and nothing wrong is read from them.

use super::{assert_same, bake_volume, files, isolume, succeeds};
use isolume::sampling::hash::uniform;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

/// Eight chunks.
const VOLUME: &str = "bumpbox:40";
const ASKED: [&str; 6] = ["--isovalues", "30,60", "--rays", "8", "--texture", "1"];
/// The same at the vertices of the isosurfaces, with check points.
const AT_VERTICES: [&str; 4] = ["--isovalues", "30,60", "--rays", "32"];

/// Trials of each kind: few here, many where somebody has the time (`ISOLUME_TRIALS=500`).
fn trials(few: u32) -> u32 {
    std::env::var("ISOLUME_TRIALS").ok().and_then(|n| n.parse().ok()).unwrap_or(few)
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy(&path, &target);
        } else {
            fs::copy(&path, &target).unwrap();
        }
    }
}

fn code(output: &Output) -> i32 {
    output.status.code().expect("an exit code, not a signal")
}

fn message(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

fn run(arguments: &[&str]) -> Output {
    isolume(arguments).output().unwrap()
}

/// What a power cut makes of files that the disk did not have yet.
#[test]
fn a_power_cut_on_a_finished_store_is_mended_by_one_command() {
    cut(&ASKED);
}

#[test]
fn a_power_cut_on_surfaces_is_mended_by_one_command() {
    cut(&AT_VERTICES);
}

fn cut(asked: &[&str]) {
    let directory = tempfile::tempdir().unwrap();
    let whole = directory.path().join("whole.isolume");
    succeeds(bake_volume(VOLUME, &whole, asked));
    let expected = files(&whole);
    let names: Vec<&PathBuf> = expected.keys().collect();
    for trial in 0..trials(40) {
        let random = |dimension| f64::from(uniform(3, u64::from(trial), 0, dimension));
        let store = directory.path().join(format!("cut-{trial}.isolume"));
        copy(&whole, &store);
        let mut hit = Vec::new();
        for n in 0..1 + (random(0) * 3.0) as u32 {
            let name = names[(random(1 + 2 * n) * names.len() as f64) as usize];
            let (file, kind) = (store.join(name), (random(2 + 2 * n) * 3.0) as u32);
            let length = expected.get(name).and(fs::metadata(whole.join(name)).ok()).unwrap().len();
            match kind {
                0 => fs::write(&file, "").unwrap(),
                1 => fs::write(&file, vec![0; length as usize]).unwrap(),
                _ => drop(fs::remove_file(&file)),
            }
            hit.push((name, kind));
        }
        // The note of what was asked is missing in a bake that is not done, too: what it says stands in the chunks. So are
        // check points, which have not been drawn yet where their record is not there.
        let is_note = |(name, kind): &(&PathBuf, u32)| {
            let file = name.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
            let may_be_missing = file == "asked.json" || file.starts_with("checks-") && file.ends_with(".json");
            may_be_missing && *kind == 2
        };
        let verify = isolume(&["verify"]).arg(&store).output().unwrap();
        assert_eq!(code(&verify), i32::from(!hit.iter().all(is_note)), "{hit:?}: {}", message(&verify));
        succeeds(bake_volume(VOLUME, &store, asked));
        assert_same(&store, &expected, &format!("trial {trial}, {hit:?}"));
        let verify = isolume(&["verify"]).arg(&store).output().unwrap();
        assert_eq!(code(&verify), 0, "{hit:?}: {}", message(&verify));
        fs::remove_dir_all(store).unwrap();
    }
}

/// Bytes flipped, cut off, zeroed, and whole chunks and files of other stores: what is lit is what was lit before, or it is
/// refused.
#[test]
fn damage_is_never_lit() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let whole = at("whole.isolume");
    succeeds(bake_volume(VOLUME, &whole, &ASKED));
    // The same volume with another seed, and another volume of the same size.
    succeeds(bake_volume(VOLUME, &at("seed.isolume"), &[&ASKED[..], &["--seed", "7"]].concat()));
    succeeds(bake_volume("gyroid:40", &at("other.isolume"), &["--isovalues", "0.3", "--rays", "8"]));
    let light = |store: &Path, out: &Path| {
        let mut command = isolume(&["relight"]);
        command.arg(store).args(["--isovalue", "30,60", "--env", "sunset", "-q", "-o"]).arg(out.join("{isovalue}.ply"));
        command.output().unwrap()
    };
    fs::create_dir(at("lit")).unwrap();
    assert!(light(&whole, &at("lit")).status.success());
    let expected = files(&at("lit"));
    let names: Vec<PathBuf> = files(&whole).into_keys().collect();
    let (mut refused, mut same) = (0, 0);
    for trial in 0..trials(30) {
        let random = |dimension| f64::from(uniform(4, u64::from(trial), 0, dimension));
        let (store, lit) = (at(&format!("{trial}.isolume")), at(&format!("lit-{trial}")));
        copy(&whole, &store);
        fs::create_dir(&lit).unwrap();
        let name = &names[(random(0) * names.len() as f64) as usize];
        let file = store.join(name);
        let mut bytes = fs::read(&file).unwrap();
        let place = (random(1) * bytes.len() as f64) as usize;
        let kind = (random(2) * 6.0) as u32;
        match kind {
            0 => bytes[place] ^= 1 << (random(3) * 8.0) as u32,
            1 => bytes.truncate(place),
            2 => bytes[place..].iter_mut().take(64).for_each(|b| *b = 0),
            3 => bytes.extend([0; 7]),
            _ => {}
        }
        fs::write(&file, &bytes).unwrap();
        if kind >= 4 {
            // A whole chunk, with its record, of another store.
            let (from, node) = if kind == 4 { ("seed.isolume", "bumpbox") } else { ("other.isolume", "gyroid") };
            let chunk = [random(3), random(4), random(5)].map(|v| (v * 2.0) as u32);
            let [z, y, x] = chunk;
            for part in [
                format!("transfer/c/{z}/{y}/{x}/0"),
                format!("stderr/c/{z}/{y}/{x}/0"),
                format!("validity/c/{z}/{y}/{x}"),
                format!("rays/c/{z}/{y}/{x}"),
                format!("rays/extent/{z}.{y}.{x}.json"),
            ] {
                let from = at(from).join("transfer").join(node).join("env").join(&part);
                let to = store.join("transfer/bumpbox/env").join(&part);
                if from.exists() {
                    fs::create_dir_all(to.parent().unwrap()).unwrap();
                    fs::copy(from, to).unwrap();
                }
            }
        }
        let output = light(&store, &lit);
        match code(&output) {
            0 => {
                assert_same(&lit, &expected, &format!("trial {trial}: kind {kind} at {place} of {}", name.display()));
                same += 1;
            }
            1 => {
                assert!(message(&output).contains(".isolume"), "{}", message(&output));
                // A surface that needs nothing of what is damaged may be there already: whole, and the same.
                assert!(files(&lit).iter().all(|(name, hash)| expected[name] == *hash), "trial {trial}");
                refused += 1;
            }
            other => panic!("exit code {other}: {}", message(&output)),
        }
        fs::remove_dir_all(store).unwrap();
    }
    println!("{refused} damages refused, {same} without effect");
    assert!(refused > 0 && same > 0);
}

#[test]
fn chunks_of_another_store_are_named_and_baked_again() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    succeeds(bake_volume(VOLUME, &at("a"), &ASKED));
    succeeds(bake_volume("sphere:40", &at("b"), &["--rays", "8"]));
    let expected = files(&at("a"));
    for part in ["transfer/c/0/0/0/0", "stderr/c/0/0/0/0", "validity/c/0/0/0", "rays/c/0/0/0", "rays/extent/0.0.0.json"]
    {
        fs::copy(at("b/transfer/sphere/env").join(part), at("a/transfer/bumpbox/env").join(part)).unwrap();
    }
    let a = at("a").display().to_string();
    let relit = run(&["relight", &a, "--isovalue", "30", "--env", "sunset", "-o", &format!("{a}.ply")]);
    let doctor = run(&["doctor", &a]);
    let merge = run(&["merge", &a, "-o", &format!("{a}.merged")]);
    for output in [relit, doctor, merge] {
        let text = message(&output);
        assert_eq!(code(&output), 1, "{text}");
        let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(text.contains("another store") && text.contains("volume sphere"), "{text}");
    }
    // One isosurface is asked for; both come back.
    let output = succeeds(bake_volume(VOLUME, &at("a"), &["--isovalues", "60", "--rays", "8", "--texture", "1"]));
    assert!(message(&output).contains("chunk (0, 0, 0) is damaged"), "{}", message(&output));
    assert_same(&at("a"), &expected, "after the bake of one isosurface");
}

#[test]
fn force_waits_for_nobody_and_leaves_the_old_store_until_the_new_one_is_there() {
    let directory = tempfile::tempdir().unwrap();
    let store = directory.path().join("s.isolume");
    succeeds(bake_volume("sphere:24", &store, &["--rays", "8"]));
    fs::write(store.join("notes.txt"), "mine").unwrap();
    fs::create_dir_all(store.join("mine/empty")).unwrap();
    let before = files(&store);
    // While somebody else fills it.
    let held = isolume::transfer::store::Store::open(&store).unwrap();
    let lock = held.lock().unwrap();
    let output = bake_volume(VOLUME, &store, &["--rays", "8", "--force"]).output().unwrap();
    assert!(code(&output) == 1 && message(&output).contains("locked"), "{}", message(&output));
    drop(lock);
    assert_same(&store, &before, "after a --force that was refused");
    // Killed in the middle.
    let mut child = bake_volume(VOLUME, &store, &["--rays", "4096", "--threads", "1", "--force"]).spawn().unwrap();
    std::thread::sleep(std::time::Duration::from_millis(400));
    child.kill().unwrap();
    child.wait().unwrap();
    let mut after = files(&store);
    after.remove(Path::new(".lock"));
    assert_eq!(after, before);
    // Through a link, to the end.
    let link = directory.path().join("link.isolume");
    #[cfg(unix)]
    std::os::unix::fs::symlink(&store, &link).unwrap();
    #[cfg(not(unix))]
    let link = store.clone();
    succeeds(bake_volume(VOLUME, &link, &["--rays", "8", "--force"]));
    assert!(link.is_symlink() || cfg!(not(unix)));
    assert_eq!(fs::read_to_string(store.join("notes.txt")).unwrap(), "mine");
    assert!(store.join("mine/empty").is_dir());
    assert!(store.join("transfer/bumpbox").is_dir() && !store.join("transfer/sphere").exists());
    let fresh = directory.path().join("fresh.isolume");
    succeeds(bake_volume(VOLUME, &fresh, &["--rays", "8"]));
    let mut expected = files(&fresh);
    expected.insert("notes.txt".into(), blake3::hash(b"mine").to_hex().to_string());
    assert_same(&store, &expected, "after --force");
}

#[cfg(unix)]
#[test]
fn a_lock_that_is_a_link_is_not_followed() {
    let directory = tempfile::tempdir().unwrap();
    let store = directory.path().join("k.isolume");
    succeeds(bake_volume("bumpbox:12", &store, &["--rays", "8"]));
    let precious = directory.path().join("precious");
    fs::write(&precious, "precious").unwrap();
    for make in [std::os::unix::fs::symlink::<&Path, PathBuf>, |from: &Path, to: PathBuf| fs::hard_link(from, to)] {
        make(&precious, store.join(".lock")).unwrap();
        let output = bake_volume("bumpbox:12", &store, &["--rays", "16"]).output().unwrap();
        assert!(code(&output) == 1 && message(&output).contains("plain file"), "{}", message(&output));
        assert_eq!(fs::read_to_string(&precious).unwrap(), "precious");
        fs::remove_file(store.join(".lock")).unwrap();
    }
}

#[test]
fn what_is_another_volume_is_named_by_name() {
    let directory = tempfile::tempdir().unwrap();
    let store = directory.path().join("d.isolume");
    succeeds(bake_volume("bumpbox:16", &store, &["--rays", "8"]));
    let output = bake_volume("sphere:16", &store, &["--rays", "8"]).output().unwrap();
    let text = message(&output);
    assert!(code(&output) == 1 && text.contains("bumpbox") && text.contains("sphere"), "{text}");
    assert!(!text.split_whitespace().any(|word| word.len() >= 64), "{text}");
}

#[test]
fn an_unfinished_store_is_told_from_a_complete_one() {
    let directory = tempfile::tempdir().unwrap();
    let store = directory.path().join("h.isolume");
    succeeds(bake_volume("bumpbox:48", &store, &["--rays", "8", "--chunks", "1/2"]));
    let (path, out) = (store.display().to_string(), directory.path().join("out.vti").display().to_string());
    let html = directory.path().join("out.html").display().to_string();
    let export = ["export", &path, "--env", "sunset", "-o", &out];
    let view = ["view", &path, "--html", &html];
    for command in [&export[..], &view[..]] {
        let output = run(command);
        assert!(code(&output) == 1 && message(&output).contains("--partial"), "{}", message(&output));
        assert_eq!(code(&run(&[command, &["--partial"]].concat())), 0);
    }
    assert!(message(&run(&["info", &path])).contains(" of 8 chunks that were asked for: incomplete"));
    assert_eq!((code(&run(&["verify", &path])), code(&run(&["verify", "--complete", &path]))), (0, 1));
    succeeds(bake_volume("bumpbox:48", &store, &["--rays", "8", "--chunks", "2/2"]));
    assert_eq!((code(&run(&export)), code(&run(&["verify", "--complete", &path]))), (0, 0));
}

/// The volume from which the store of format 2 in `tests/data` was made.
fn eight(path: &Path) {
    let samples = (0..512u32).map(|i| {
        let at = [i % 8, i / 8 % 8, i / 64].map(|v| f64::from(v) - 3.5);
        (200.0 - 40.0 * at.iter().map(|v| v * v).sum::<f64>().sqrt()).clamp(0.0, 255.0) as u8
    });
    let mut file = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    let header = format!("{:<117}\n", "{'descr': '|u1', 'fortran_order': False, 'shape': (8, 8, 8), }");
    file.extend(header.bytes().chain(samples));
    fs::write(path, file).unwrap();
}

#[test]
fn a_store_of_an_older_format_is_read_and_converted() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let old = at("old.isolume");
    copy(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/format-2.isolume")), &old);
    let (old_path, new_path) = (old.display().to_string(), at("new.isolume").display().to_string());
    let light = |store: &str, out: &str| {
        let out = at(out);
        let arguments =
            ["relight", store, "--isovalue", "120", "--env", "sunset", "-q", "-o", &out.display().to_string()];
        let output = run(&arguments);
        assert_eq!(code(&output), 0, "{}", message(&output));
        let bytes = fs::read(out).unwrap();
        // The header names the store; what follows it is the surface.
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap();
        bytes[end..].to_vec()
    };
    let before = light(&old_path, "old.ply");
    let doctor = run(&["doctor", &old_path]);
    assert!(code(&doctor) == 0 && message(&doctor).contains("old format"), "{}", message(&doctor));
    eight(&at("eight.npy"));
    let options = ["--isovalues", "120,160", "--rays", "16", "--layers", "2", "--bands", "2,1"];
    let bake = |store: &str| {
        let mut command = isolume(&["bake"]);
        command.arg(at("eight.npy")).args(options).args(["-o", store]);
        command.output().unwrap()
    };
    let output = bake(&old_path);
    assert!(code(&output) == 1 && message(&output).contains("isolume merge"), "{}", message(&output));
    assert_eq!(code(&run(&["merge", &old_path, "-o", &new_path])), 0);
    assert!(light(&new_path, "new.ply") == before);
    // Its paths went on by other rules than those of today: no chunk of today joins them.
    let again = bake(&new_path);
    assert!(code(&again) == 1 && message(&again).contains("older version"), "{}", message(&again));
    assert!(light(&new_path, "again.ply") == before);
}

#[cfg(target_os = "linux")]
#[test]
fn a_store_that_is_cut_off_under_a_reader_is_an_error() {
    let directory = tempfile::tempdir().unwrap();
    let store = directory.path().join("sb.isolume");
    succeeds(bake_volume("bumpbox:64", &store, &["--rays", "8"]));
    let path = store.display().to_string();
    let shards: Vec<PathBuf> = files(&store).into_keys().filter(|name| name.iter().any(|part| part == "c")).collect();
    // Whenever it happens, it is an exit code and never a signal.
    for delay in [5, 20, 40, 60, 80, 120] {
        let copied = directory.path().join(format!("cut-{delay}.isolume"));
        copy(&store, &copied);
        let out = directory.path().join(format!("{delay}-{{isovalue}}.png"));
        let (copied_path, out) = (copied.display().to_string(), out.display().to_string());
        let list = "10%,20%,30%,40%,50%,60%,70%,80%";
        let child =
            isolume(&["relight", &copied_path, "--isovalue", list, "--env", "sunset", "-q", "-o", &out]).spawn();
        std::thread::sleep(std::time::Duration::from_millis(delay));
        for shard in &shards {
            fs::OpenOptions::new().write(true).open(copied.join(shard)).unwrap().set_len(0).unwrap();
        }
        let output = child.unwrap().wait_with_output().unwrap();
        assert!(output.status.code().is_some_and(|code| code == 0 || code == 1), "{delay} ms: {:?}", output.status);
    }
    assert_eq!(code(&run(&["verify", &path])), 0);
}

/// The order in which the system is asked to write, as `strace` sees it.
#[cfg(target_os = "linux")]
#[test]
fn a_chunk_reaches_the_disk_before_it_takes_its_name() {
    use std::process::Command;
    let directory = tempfile::tempdir().unwrap();
    let (store, log) = (directory.path().join("t.isolume"), directory.path().join("log"));
    let traced = |more: &[&str]| {
        let _ = fs::remove_dir_all(&store);
        let mut command = Command::new("strace");
        command.args(["-f", "-qq", "-y", "-e", "trace=fsync,fdatasync,rename,renameat,renameat2", "-o"]).arg(&log);
        command.arg(env!("CARGO_BIN_EXE_isolume")).args(["bake", "bumpbox:12", "--rays", "8", "-q", "-o"]).arg(&store);
        let output = command.args(more).output().ok()?;
        output.status.success().then(|| fs::read_to_string(&log).unwrap())
    };
    let Some(calls) = traced(&[]) else {
        println!("skipped: strace is not installed, or may not trace here");
        return;
    };
    let lines: Vec<&str> = calls.lines().collect();
    let place = |what: &dyn Fn(&str) -> bool, from: usize| {
        (from..lines.len()).find(|&i| what(lines[i])).unwrap_or_else(|| panic!("not found after {from} in\n{calls}"))
    };
    let renamed =
        |name: &'static str| move |line: &str| line.contains("rename") && line.contains(&format!("/{name}\""));
    let commit = place(&renamed("transfer/c/0/0/0/0"), 0);
    for (array, file) in [("validity", "validity/c/0/0/0"), ("rays", "rays/c/0/0/0"), ("stderr", "stderr/c/0/0/0/0")] {
        // The bytes, the name, the folder; all before the mark of the commit.
        let name = place(&renamed(file), 0);
        let bytes = place(&|line| line.contains("fdatasync") && line.contains(&format!("/{array}/c/")), 0);
        let folder = place(&|line| line.contains(" fsync(") && line.contains(&format!("/{array}/c/0/0")), name);
        assert!(bytes < name && name < folder && folder < commit, "{array}\n{calls}");
    }
    place(&|line| line.contains(" fsync(") && line.contains("/transfer/c/0/0/0"), commit);
    let unsynced = traced(&["--no-sync"]).unwrap();
    assert!(!unsynced.contains("sync("), "{unsynced}");
}
