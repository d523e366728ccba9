//! What a bake leaves behind: the same bytes after kills, for any number of threads, for shares put together in any
//! order, and for isosurfaces that were asked for one after the other.

mod mend;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// 125 chunks.
const VOLUME: &str = "bumpbox:144";
/// Two bands, so that the stores are small.
const SMALL: [&str; 4] = ["--layers", "2", "--bands", "2"];
/// What texels get where they need not stop by themselves.
const FIXED: [&str; 6] = ["--isovalues", "10,25,40,55,70,85,100", "--rays", "8", "--texture", "1"];

fn isolume(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_isolume"));
    command.args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn bake(store: &Path, more: &[&str]) -> Command {
    bake_volume(VOLUME, store, more)
}

fn bake_volume(volume: &str, store: &Path, more: &[&str]) -> Command {
    let mut command = isolume(&["bake", volume, "-o"]);
    command.arg(store).args(SMALL).args(more);
    command
}

fn succeeds(mut command: Command) -> Output {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

/// BLAKE3 of every file of a store by its path: more than one hash of the whole, since a difference has a name.
fn files(store: &Path) -> BTreeMap<PathBuf, String> {
    fn walk(root: &Path, directory: &Path, found: &mut BTreeMap<PathBuf, String>) {
        for entry in fs::read_dir(directory).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                walk(root, &path, found);
            } else {
                let hash = blake3::hash(&fs::read(&path).unwrap()).to_hex().to_string();
                found.insert(path.strip_prefix(root).unwrap().into(), hash);
            }
        }
    }
    let mut found = BTreeMap::new();
    walk(store, store, &mut found);
    found
}

fn assert_same(store: &Path, expected: &BTreeMap<PathBuf, String>, what: &str) {
    let found = files(store);
    let differing: Vec<_> = found.iter().filter(|(path, hash)| expected.get(*path) != Some(hash)).collect();
    let missing: Vec<_> = expected.keys().filter(|path| !found.contains_key(*path)).collect();
    assert!(differing.is_empty() && missing.is_empty(), "{what}: other or new {differing:?}, missing {missing:?}");
}

/// Chunks that are complete: their `transfer` shard is renamed last.
fn chunks(store: &Path) -> usize {
    fn count(directory: &Path) -> usize {
        let entries = fs::read_dir(directory).into_iter().flatten().flatten();
        entries.map(|e| if e.path().is_dir() { count(&e.path()) } else { 1 }).sum()
    }
    let Ok(volumes) = fs::read_dir(store.join("transfer")) else { return 0 };
    volumes.flatten().map(|v| count(&v.path().join("env/transfer/c"))).sum()
}

fn kill(mut child: Child) {
    child.kill().unwrap(); // SIGKILL: nothing can be tidied up.
    child.wait().unwrap();
}

#[test]
fn twenty_kills_leave_the_bytes_of_an_unbroken_bake() {
    let directory = tempfile::tempdir().unwrap();
    let whole = directory.path().join("whole.isolume");
    succeeds(bake(&whole, &FIXED));
    let expected = files(&whole);
    let all = chunks(&whole);
    assert!(all > 80, "{all} chunks");
    // The moment at which a chunk appears is the delicate one: every third kill comes at a random instant after
    // one, the others a random time after the start. The result must not depend on when.
    let broken = directory.path().join("broken.isolume");
    let mut interrupted = 0;
    for turn in 0..20u32 {
        let random = |dimension| isolume::sampling::hash::uniform(20, u64::from(turn), 0, dimension);
        let before = chunks(&broken);
        let child = bake(&broken, &FIXED).spawn().unwrap();
        if turn % 3 == 0 {
            let start = Instant::now();
            while chunks(&broken) == before && start.elapsed() < Duration::from_secs(20) {
                std::thread::sleep(Duration::from_micros(100));
            }
            std::thread::sleep(Duration::from_micros((random(0) * 3000.0) as u64));
        } else {
            std::thread::sleep(Duration::from_micros((random(0) * 50_000.0) as u64));
        }
        kill(child);
        interrupted += usize::from(chunks(&broken) < all);
    }
    assert!(interrupted >= 10, "only {interrupted} kills interrupted anything");
    succeeds(bake(&broken, &FIXED));
    assert_same(&broken, &expected, "after 20 kills");
    // With nothing to do nothing changes.
    let again = succeeds(bake(&broken, &FIXED));
    assert!(String::from_utf8_lossy(&again.stdout).contains("nothing to bake"));
    assert_same(&broken, &expected, "after a bake of nothing");
}

#[test]
fn threads_shares_and_the_order_of_isosurfaces_leave_no_trace() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let bake = |store: &Path, more: &[&str]| bake_volume("bumpbox:80", store, more);
    let asked = ["--isovalues", "30,60", "--error", "0.1", "--rays", "64"];
    let whole = at("whole.isolume");
    succeeds(bake(&whole, &asked));
    let expected = files(&whole);
    for threads in ["1", "2", "4"] {
        let store = at(&format!("threads-{threads}.isolume"));
        succeeds(bake(&store, &[&asked[..], &["--threads", threads]].concat()));
        assert_same(&store, &expected, &format!("{threads} threads"));
    }
    // Shares on one store at the same time.
    let store = at("together.isolume");
    let children: Vec<Child> = ["1/3", "2/3", "3/3"]
        .iter()
        .map(|share| bake(&store, &[&asked[..], &["--chunks", share]].concat()).spawn().unwrap())
        .collect();
    for child in children {
        let output = child.wait_with_output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    assert_same(&store, &expected, "three shares at once");
    // Shares on stores of their own, merged in two orders.
    for share in ["1/2", "2/2"] {
        succeeds(bake(&at(&share.replace('/', "-")), &[&asked[..], &["--chunks", share]].concat()));
    }
    for order in [["1-2", "2-2"], ["2-2", "1-2"]] {
        let store = at(&format!("merged-{}.isolume", order[0]));
        let mut merge = isolume(&["merge"]);
        merge.args(order.map(at)).arg("-o").arg(&store);
        succeeds(merge);
        assert_same(&store, &expected, &format!("shares merged as {order:?}"));
    }
    // One isosurface after the other, in both orders.
    for order in [["30", "60"], ["60", "30"]] {
        let store = at(&format!("{}-first.isolume", order[0]));
        for isovalue in order {
            succeeds(bake(&store, &["--isovalues", isovalue, "--error", "0.1", "--rays", "64"]));
        }
        assert_same(&store, &expected, &format!("isovalues in the order {order:?}"));
    }
}

/// Four shares of a texture of eight chunks, one of which holds most: octants of it are dealt, and all four write one file.
#[test]
#[cfg(unix)]
fn shares_that_divide_chunks_leave_no_trace_even_when_stopped() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let bake = |store: &Path, share: &str| {
        let more = ["--isovalues", "30,60", "--texture", "1", "--rays", "32"];
        let share = if share.is_empty() { vec![] } else { vec!["--chunks", share] };
        bake_volume("bumpbox:40", store, &[&more[..], &share].concat())
    };
    let whole = at("whole.isolume");
    succeeds(bake(&whole, ""));
    let expected = files(&whole);
    let shares = ["1/4", "2/4", "3/4", "4/4"];
    // All at once into a store that is not there yet; one is killed, one gets SIGTERM, at several moments.
    for (turn, delay) in [20, 60, 120, 200].into_iter().enumerate() {
        let store = at(&format!("together-{turn}.isolume"));
        let mut children: Vec<Child> = shares.iter().map(|share| bake(&store, share).spawn().unwrap()).collect();
        std::thread::sleep(Duration::from_millis(delay));
        children[1].kill().unwrap();
        let id = children[2].id().to_string();
        Command::new("kill").args(["-TERM", &id]).status().unwrap();
        for (i, child) in children.into_iter().enumerate() {
            let output = child.wait_with_output().unwrap();
            let text = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success() || i == 1 || i == 2, "share {i}: {text}");
            assert!(i != 2 || output.status.success() || matches!(output.status.code(), Some(143) | None), "{text}");
        }
        // What a kill between two renames has torn is repaired by whoever keeps the chunk: all once more.
        shares.iter().for_each(|share| drop(succeeds(bake(&store, share))));
        assert_same(&store, &expected, &format!("stopped after {delay} ms"));
        succeeds(isolume(&["verify", store.to_str().unwrap()]));
    }
    // Stores of their own, merged in two orders.
    shares.iter().for_each(|share| drop(succeeds(bake(&at(&share.replace('/', "-")), share))));
    for order in [[0, 1, 2, 3], [3, 1, 0, 2]] {
        let store = at(&format!("merged-{}.isolume", order[0]));
        let mut merge = isolume(&["merge"]);
        merge.args(order.map(|i: usize| at(&shares[i].replace('/', "-")))).arg("-o").arg(&store);
        succeeds(merge);
        assert_same(&store, &expected, &format!("shares merged as {order:?}"));
    }
    // What is damaged of a divided chunk comes back whole, by one of the shares.
    let shard = whole.join("transfer/bumpbox/env/transfer/c/0/0/0/0");
    let mut bytes = fs::read(&shard).unwrap();
    bytes[100] ^= 1;
    fs::write(&shard, bytes).unwrap();
    shares.iter().for_each(|share| drop(succeeds(bake(&whole, share))));
    assert_same(&whole, &expected, "a damaged chunk that shares divide");
    // More shares than there is work: those beyond it do nothing and say so.
    let output =
        succeeds(bake_volume("bumpbox:12", &at("small"), &["--isovalues", "30", "--rays", "8", "--chunks", "60/64"]));
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(text.contains("share 60 of 64") && text.contains("nothing"), "{text}");
}

#[test]
fn coarse_texels_are_replaced_and_good_ones_kept() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    let go = |store: &str, isovalue: &str, rays: &str| {
        let mut command = isolume(&["bake", "bumpbox:40", "--layers", "2", "--isovalues", isovalue, "--rays", rays]);
        // Neighbouring isosurfaces share texels, not vertices.
        command.args(["--texture", "1", "-o"]);
        command.arg(at(store)).arg("--json");
        let output = succeeds(command);
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()["bake"]["rays"].as_u64().unwrap()
    };
    // A draft first and the result over it.
    go("direct", "30", "64");
    go("refined", "30", "16");
    go("refined", "30", "64");
    assert_same(&at("refined"), &files(&at("direct")), "16 rays, then 64");
    // What is there already is not traced again, and does not get worse.
    let both = files(&at("refined"));
    assert_eq!(go("refined", "30", "16"), 0);
    assert_same(&at("refined"), &both, "16 rays asked of a store with 64");
    // A neighbouring isosurface shares texels with it: fewer rays than alone.
    let alone = go("alone", "31", "64");
    let after = go("refined", "31", "64");
    assert!(after < alone * 9 / 10, "{after} rays after its neighbour, {alone} alone");
}

#[test]
fn a_second_bake_of_a_store_is_told() {
    let directory = tempfile::tempdir().unwrap();
    let store = directory.path().join("x.isolume");
    succeeds(bake(&store, &["--isovalues", "30", "--rays", "4"]));
    let held = isolume::transfer::store::Store::open(&store).unwrap();
    let refused = |more: &[&str]| {
        let output = bake(&store, more).output().unwrap();
        assert_eq!(output.status.code(), Some(1));
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(message.contains("locked by process") && message.contains("--chunks"), "{message}");
    };
    let lock = held.lock().unwrap();
    refused(&["--isovalues", "60", "--rays", "4"]);
    refused(&["--isovalues", "60", "--rays", "4", "--chunks", "1/2"]);
    drop(lock);
    let lock = held.lock_share(1, 2).unwrap();
    refused(&["--isovalues", "60", "--rays", "4"]);
    refused(&["--isovalues", "60", "--rays", "4", "--chunks", "1/2"]);
    refused(&["--isovalues", "60", "--rays", "4", "--chunks", "1/3"]);
    succeeds(bake(&store, &["--isovalues", "60", "--rays", "4", "--chunks", "2/2"]));
    drop(lock);
    // A killed share leaves its file, which nobody holds.
    fs::write(store.join(".lock-share-7-of-9"), "process 1 on elsewhere\n").unwrap();
    succeeds(bake(&store, &["--isovalues", "60", "--rays", "4", "--chunks", "1/2"]));
    succeeds(bake(&store, &["--isovalues", "30,60", "--rays", "4"]));
}
