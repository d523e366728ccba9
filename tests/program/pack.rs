//! Packed stores: what they lose, that everything reads them, that nothing writes into them, and how a bake is followed.

use isolume::transfer::BrickSource;
use isolume::transfer::store::Store;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

fn isolume(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_isolume"));
    command.args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn succeeds(arguments: &[&str]) -> Output {
    let output = isolume(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

fn fails(arguments: &[&str]) -> String {
    let output = isolume(arguments).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{arguments:?}");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn json(arguments: &[&str]) -> Value {
    serde_json::from_slice(&succeeds(&[arguments, &["--json"]].concat()).stdout).unwrap()
}

fn files(root: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    fn walk(root: &Path, directory: &Path, found: &mut BTreeMap<PathBuf, Vec<u8>>) {
        for entry in fs::read_dir(directory).unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => walk(root, &path, found),
                false => drop(found.insert(path.strip_prefix(root).unwrap().into(), fs::read(&path).unwrap())),
            }
        }
    }
    let mut found = BTreeMap::new();
    walk(root, root, &mut found);
    found
}

/// Root mean square of the difference of X between two stores, over that of X; X_k = 0.7^(k+1) T_k, of `counts` coefficients a layer.
fn difference(plain: &Store, packed: &Store, counts: &[usize]) -> f64 {
    let weights: Vec<f64> = counts.iter().enumerate().flat_map(|(k, &n)| vec![0.7f64.powi(k as i32 + 1); n]).collect();
    let (mut squares, mut lost) = (0.0, 0.0);
    let [bx, by, bz] = plain.layout().lattice.bricks();
    for b in 0..bx * by * bz {
        let index = [b % bx, b / bx % by, b / bx / by];
        let (Some(a), Some(b)) = (plain.brick(index).unwrap(), packed.brick(index).unwrap()) else {
            assert!(plain.brick(index).unwrap().is_none() && packed.brick(index).unwrap().is_none());
            continue;
        };
        assert!(a.validity == b.validity && a.rays == b.rays, "brick {index:?}");
        for (i, (a, b)) in a.transfer.iter().zip(b.transfer).enumerate() {
            assert_eq!(a.is_nan(), b.is_nan());
            if !a.is_nan() {
                let w = weights[i % weights.len()];
                squares += (w * a.to_f64()).powi(2);
                lost += (w * (a.to_f64() - b.to_f64())).powi(2);
            }
        }
    }
    (lost / squares).sqrt()
}

#[test]
fn a_packed_store_loses_what_it_says_and_is_read_by_everything() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).display().to_string();
    let (plain, packed) = (at("plain.isolume"), at("packed.isolume"));
    let bands = ["--bands", "4,3", "--rays", "32"];
    // A texture, and the vertices of a surface.
    succeeds(&[&["bake", "bumpbox:40", "--texture", "1", "-o", &plain], &bands[..]].concat());
    succeeds(&[&["bake", "bumpbox:40", "--isovalues", "30", "-o", &plain], &bands[..]].concat());
    let report = json(&["pack", &plain, "--error", "1%", "-o", &packed]);
    let groups = report["groups"].as_array().unwrap();
    assert_eq!(groups.len(), 2, "{report:#}");
    let (a, b) = (Store::open(&plain).unwrap(), Store::open(&packed).unwrap());
    let pairs = [(a.surface(30.0).unwrap().unwrap(), b.surface(30.0).unwrap().unwrap()), (a, b)];
    for (a, b) in &pairs {
        let packing = b.packing().unwrap();
        let found = difference(a, b, &[16, 9]);
        assert!((found / packing.measured - 1.0).abs() < 1e-9, "{found} for {packing:?}");
        assert!(found <= 0.0102 && found > 0.009, "{found}");
        assert!(packing.largest <= packing.bound, "{packing:?}");
    }
    for group in groups {
        let bytes = |key: &str| group[key].as_u64().unwrap();
        assert!(bytes("transfer_bytes") * 2 < bytes("transfer_bytes_before"), "{group:#}");
    }
    // All that reads stores.
    succeeds(&["verify", "--complete", &packed]);
    assert!(String::from_utf8_lossy(&succeeds(&["info", &packed]).stdout).contains("packed"));
    succeeds(&["doctor", &packed]);
    succeeds(&["compare", &packed, "--isovalue", "30", "--env", "sky", "--points", "64", "--paths", "16"]);
    succeeds(&["export", &packed, "--env", "sky", "-o", &at("packed.nrrd")]);
    for (store, name) in [(&plain, "plain.ply"), (&packed, "packed.ply")] {
        succeeds(&[
            "relight",
            store,
            "--isovalue",
            "30,45",
            "--env",
            "sky",
            "-o",
            &at(&format!("{{isovalue}}-{name}")),
        ]);
    }
    // The bytes do not depend on threads, and bake --compress is the same.
    succeeds(&["pack", &plain, "--error", "1%", "-o", &at("one.isolume"), "--threads", "1"]);
    assert!(files(Path::new(&packed)) == files(Path::new(&at("one.isolume"))), "other bytes by one thread");
    let alone = at("compressed.isolume");
    let bake = [&["bake", "bumpbox:20", "--isovalues", "30", "-o", &alone], &bands[..]].concat();
    succeeds(&bake);
    succeeds(&["pack", &alone, "--error", "0.5%", "-o", &at("expected.isolume")]);
    fs::remove_dir_all(&alone).unwrap();
    let compress = [&bake[..], &["--compress", "0.5%"]].concat();
    succeeds(&compress);
    assert!(files(Path::new(&alone)) == files(Path::new(&at("expected.isolume"))), "bake --compress differs from pack");
    // Again, there is nothing to do.
    let before = files(Path::new(&alone));
    succeeds(&compress);
    succeeds(&bake);
    assert!(files(Path::new(&alone)) == before, "a bake of nothing changed a packed store");
    // A zip of it is read as well.
    isolume::transfer::store::pack_zip(&packed, at("packed.isolume.zip")).unwrap();
    succeeds(&["relight", &at("packed.isolume.zip"), "--isovalue", "30", "--env", "sky", "-o", &at("zip.ply")]);
    assert_eq!(fs::read(at("zip.ply")).unwrap(), fs::read(at("30-packed.ply")).unwrap());
}

#[test]
fn nothing_is_written_into_a_packed_store_and_damage_is_named() {
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name).display().to_string();
    let (plain, packed) = (at("plain.isolume"), at("packed.isolume"));
    let bake = |store: &str, isovalue: &str| {
        ["bake", "bumpbox:24", "--isovalues", isovalue, "--bands", "2", "--rays", "8", "-o", store].map(str::to_owned)
    };
    let line = |words: [String; 10]| words.to_vec();
    let run = |words: Vec<String>| isolume(&words.iter().map(String::as_str).collect::<Vec<_>>()).output().unwrap();
    assert!(run(line(bake(&plain, "30"))).status.success());
    // Auto: half of the noise, which 8 rays make large.
    let report = json(&["pack", &plain, "-o", &packed]);
    let group = report["groups"].as_array().unwrap().iter().find(|g| g["texels"].as_u64() > Some(0)).unwrap();
    let ratio = group["packing"]["measured"].as_f64().unwrap() / group["noise"].as_f64().unwrap();
    assert!((0.45..0.55).contains(&ratio), "{ratio} of the noise");
    let before = files(Path::new(&packed));
    for isovalue in ["60", "30"] {
        let output = run(line(bake(&packed, isovalue)));
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), if isovalue == "30" { Some(0) } else { Some(1) }, "{text}");
        assert!(isovalue == "30" || text.contains("packed"), "{text}");
    }
    assert!(fails(&["merge", &plain, &packed, "-o", &at("merged.isolume")]).contains("packed"));
    assert!(fails(&["merge", &packed, "-o", &at("merged.isolume")]).contains("packed"));
    assert!(fails(&["pack", &packed, "-o", &at("twice.isolume")]).contains("packed"));
    assert!(fails(&["pack", &plain, "-o", &packed]).contains("nothing is yet"));
    assert_eq!(isolume(&["pack", &plain, "--error", "200%", "-o", &at("x")]).output().unwrap().status.code(), Some(2));
    assert!(files(Path::new(&packed)) == before, "something was written into the packed store");
    for array in ["low", "stderr", "validity", "rays"] {
        let last = if matches!(array, "low" | "stderr") { "0/0/0" } else { "0/0" };
        let file = format!("{packed}/surfaces/bumpbox/30/{array}/c/{last}");
        let whole = fs::read(&file).unwrap();
        let mut bytes = whole.clone();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 4;
        fs::write(&file, bytes).unwrap();
        let output = isolume(&["verify", &packed]).output().unwrap();
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.code() == Some(1) && text.contains(array), "{array}: {text}");
        let text = fails(&["relight", &packed, "--isovalue", "30", "--env", "sky", "-o", &at("x.ply")]);
        assert!(text.contains("pack it again"), "{text}");
        fs::write(&file, whole).unwrap();
    }
    succeeds(&["verify", &packed]);
}

#[test]
fn whoever_watches_sees_all_shares_and_the_end() {
    let directory = tempfile::tempdir().unwrap();
    let store = directory.path().join("x.isolume").display().to_string();
    let bake = |share: &str| {
        let mut words =
            vec!["bake", "bumpbox:40", "--isovalues", "30,60", "--bands", "2", "--rays", "8", "--texture", "1"];
        words.extend(["-o", &store, "--chunks", share]);
        succeeds(&words);
    };
    bake("1/2");
    // It goes on until all is there, so it is asked to end.
    let mut watch = isolume(&["info", &store, "--watch", "--every", "0.05", "--json"]).spawn().unwrap();
    std::thread::sleep(std::time::Duration::from_millis(500));
    assert!(watch.try_wait().unwrap().is_none(), "it ended before all was there");
    bake("2/2");
    let output = watch.wait_with_output().unwrap();
    assert!(output.status.success());
    let looks: Vec<Value> =
        serde_json::Deserializer::from_slice(&output.stdout).into_iter().map(Result::unwrap).collect();
    let number = |look: &Value, key: &str| look[key].as_u64().unwrap();
    let (first, last) = (&looks[0], looks.last().unwrap());
    assert!(number(first, "there") > 0 && number(first, "there") < number(first, "asked"), "{first}");
    assert_eq!(number(last, "there"), number(last, "asked"));
    assert_eq!(number(first, "asked"), number(last, "asked"), "what is to be done is known from the first share on");
    // Shares are even: the first has about half.
    let share = number(first, "there") as f64 / number(first, "asked") as f64;
    assert!((0.4..0.6).contains(&share), "{share}");
    assert!(fails(&["info", "bumpbox:20", "--watch"]).contains("store"));
}
