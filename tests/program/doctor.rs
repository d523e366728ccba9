//! `isolume doctor` from outside: what it says of healthy, odd and broken files.

use crate::common::program::Bench;
use serde_json::Value;
use std::path::{Path, PathBuf};

impl Bench {
    fn diagnosis(&self, file: &str) -> Value {
        let output = self.command(&format!("doctor {file} --json")).output().expect("the program runs");
        let found: Value = serde_json::from_slice(&output.stdout).expect("one JSON document");
        // Damage is told by the exit code as well, and nothing else is.
        let findings = found["findings"].as_array().expect("findings");
        let is_damaged = findings.iter().any(|f| f["severity"] == "damage");
        assert_eq!(output.status.code(), Some(i32::from(is_damaged)), "{found:#}");
        found
    }

    /// Count, total and text of a finding.
    fn finding(&self, file: &str, topic: &str) -> (u64, u64, String) {
        let all = self.diagnosis(file);
        let findings = all["findings"].as_array().expect("findings");
        let found = findings.iter().find(|f| f["topic"] == topic);
        let found = found.unwrap_or_else(|| panic!("no {topic} for {file}: {all:#}"));
        let number = |key: &str| found[key].as_u64().expect("a count");
        (number("count"), number("of"), found["found"].as_str().expect("text").into())
    }

    fn topics(&self, file: &str) -> Vec<String> {
        let findings = self.diagnosis(file)["findings"].as_array().expect("findings").clone();
        findings.iter().map(|f| f["topic"].as_str().expect("a topic").to_string()).collect()
    }

    /// A raw volume with a NRRD header.
    fn nrrd(&self, name: &str, kind: &str, sizes: [usize; 3], fields: &str, bytes: &[u8]) {
        let [x, y, z] = sizes;
        let head = format!(
            "NRRD0004\ntype: {kind}\ndimension: 3\nsizes: {x} {y} {z}\nendian: little\nencoding: raw\n{fields}\n"
        );
        std::fs::write(self.path(name), [head.as_bytes(), bytes].concat()).expect("written");
    }
}

/// `count` floats from 0 up, no two alike.
fn floats(count: usize) -> Vec<f32> {
    (0..count).map(|i| (i * 7919 % count) as f32).collect()
}

fn little(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

#[test]
fn a_volume_is_told_with_counts_in_text_and_json() {
    let bench = Bench::new();
    let mut values = floats(512);
    values[7] = f32::NAN;
    values[100] = f32::INFINITY;
    bench.nrrd("odd.dat", "float", [8, 8, 8], "spacings: 1 1 9\naxis mins: 3e7 0 0\n", &little(&values));
    let (count, of, text) = bench.finding("odd.dat", "not finite");
    assert_eq!((count, of), (2, 512));
    assert!(text.contains("smallest"), "{text}");
    assert!(bench.finding("odd.dat --solid below", "not finite").2.contains("largest"));
    assert_eq!(bench.finding("odd.dat", "anisotropy").0, 1);
    assert_eq!(bench.finding("odd.dat", "far origin").0, 1);
    assert_eq!(bench.finding("odd.dat --isovalue 200", "isovalue on samples").0, 1);
    assert_eq!(bench.finding("odd.dat --isovalue 9e9", "no surface").1, 512);
    let text = bench.run("doctor odd.dat --isovalue 200");
    for part in ["odd.dat: a volume of 8 × 8 × 8 float32", "not finite: 2 of 512 samples (0.391 %)", "→ ", "findings"]
    {
        assert!(text.contains(part), "{part} in {text}");
    }
    assert!(text.lines().all(|l| l.chars().count() <= 100), "{text}");
    assert_eq!(bench.diagnosis("odd.dat")["kind"], "volume");
}

#[test]
fn volumes_without_a_surface_are_findings_not_errors() {
    let bench = Bench::new();
    bench.nrrd("same.nrrd", "uchar", [4, 4, 4], "", &[9; 64]);
    assert_eq!(bench.topics("same.nrrd"), ["constant"]);
    bench.nrrd("slice.nrrd", "float", [1, 16, 16], "", &little(&floats(256)));
    assert_eq!(bench.topics("slice.nrrd")[0], "flat grid");
    assert!(bench.run("doctor gyroid:24").contains("surface at 0"));
}

#[test]
fn a_probe_is_told_by_its_content() {
    let bench = Bench::new();
    let pixel = |x: usize, y: usize| match (x, y) {
        (3, 2) => (f32::NAN, 1.0, 1.0),
        (4, 2) => (-1.0, 1.0, 1.0),
        (20, 25) => (1e5, 1e5, 1e5f32),
        _ => (1.0, 1.0, 1.0),
    };
    exr::prelude::write_rgb_file(bench.path("probe.nii"), 64, 32, pixel).expect("written");
    assert_eq!(bench.diagnosis("probe.nii")["kind"], "probe");
    assert_eq!(bench.finding("probe.nii", "not finite").0, 1);
    assert_eq!(
        bench.finding("probe.nii", "negative"),
        (1, 2048, "negative pixels were set to 0 in that channel".into())
    );
    let (_, _, text) = bench.finding("probe.nii", "dominating pixel");
    assert!(text.contains("elevation -53.4°"), "{text}"); // Row 25.5 of 32: 90° − 143.4°.
    assert!(bench.topics("probe.nii").contains(&"upside down".into()));
    assert_eq!(bench.topics("constant"), ["constant"]);
    image::RgbImage::from_pixel(30, 20, image::Rgb([90; 3])).save(bench.path("grey.png")).expect("written");
    let topics = bench.topics("grey.png");
    assert!(topics.contains(&"constant".into()) && topics.contains(&"aspect".into()), "{topics:?}");
}

/// The files of the first array of a store, sorted.
fn files(folder: &Path, part: &str) -> Vec<PathBuf> {
    let mut all = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            all.extend(files(&path, part));
        } else if path.to_string_lossy().contains(part) {
            all.push(path);
        }
    }
    all.sort();
    all
}

#[test]
fn a_store_is_verified_to_the_last_brick() {
    let bench = Bench::new();
    bench.run("bake gyroid:40 --rays 4 --layers 1 --bands 1 --quiet -o s.isolume");
    assert_eq!(bench.topics("s.isolume"), [] as [&str; 0]);
    let sound = bench.diagnosis("s.isolume");
    assert_eq!(
        (&sound["kind"], &sound["summary"]["chunks"], &sound["summary"]["sound"]),
        (&"store".into(), &8.into(), &8.into())
    );
    // A killed run leaves a staged file.
    let shards = files(&bench.path("s.isolume"), "/env/transfer/c/");
    std::fs::write(shards[0].with_file_name(".partial-0-x"), "x").expect("written");
    assert_eq!(bench.finding("s.isolume", "leftovers").0, 1);
    // One byte of two bricks of one array.
    let rays = files(&bench.path("s.isolume"), "/env/rays/c/");
    let mut bytes = std::fs::read(&rays[0]).expect("a shard");
    bytes[10] ^= 1;
    bytes[3000] ^= 1;
    std::fs::write(&rays[0], bytes).expect("written");
    let (count, of, text) = bench.finding("s.isolume", "damaged chunks");
    assert_eq!((count, of, text.lines().count()), (1, 8, 2), "{text}");
    // Of one chunk a file gone, then all of it, and of another a file of a different writing.
    std::fs::remove_file(&shards[1]).expect("removed");
    let (count, _, text) = bench.finding("s.isolume", "torn chunks");
    assert!(count == 1 && text.contains("missing"), "{text}");
    for part in ["/env/stderr/c/", "/env/validity/c/", "/env/rays/c/", "/env/rays/extent/"] {
        std::fs::remove_file(&files(&bench.path("s.isolume"), part)[1]).expect("removed");
    }
    assert_eq!(bench.finding("s.isolume", "holes").0, 1);
    let stderr = files(&bench.path("s.isolume"), "/env/stderr/c/");
    std::fs::copy(&stderr[2], &stderr[1]).expect("copied");
    let (count, _, text) = bench.finding("s.isolume", "torn chunks");
    assert!(count == 1 && text.contains("/stderr/c/"), "{text}");
    assert_eq!(bench.diagnosis("s.isolume")["summary"]["sound"], 5);
    // The volume's own copy.
    let data = files(&bench.path("s.isolume"), "/data/c/");
    let bytes = std::fs::read(&data[0]).expect("a chunk");
    std::fs::write(&data[0], &bytes[..bytes.len() - 1]).expect("written");
    assert!(bench.finding("s.isolume", "damaged volume").2.contains("/data/c/0/0/0"));
}

#[test]
fn what_cannot_be_read_is_refused_by_name() {
    let bench = Bench::new();
    std::fs::write(bench.path("empty.exr"), "").expect("written");
    std::fs::write(bench.path("half.exr"), [0x76, 0x2f, 0x31, 0x01, 2, 0]).expect("written");
    std::fs::write(bench.path("text.nii.gz"), "not a volume").expect("written");
    std::fs::write(bench.path("zip.zip"), "PK\x03\x04 and no more").expect("written");
    std::fs::create_dir(bench.path("folder")).expect("made");
    for (file, said) in [
        ("empty.exr", "empty file"),
        ("half.exr", "OpenEXR"),
        ("text.nii.gz", "not a volume"),
        ("zip.zip", "zip archive"),
        ("folder", "no zarr.json"),
        ("missing.nrrd", "missing.nrrd"),
        ("gyriod", "did you mean"),
    ] {
        let output = bench.command(&format!("doctor {file}")).assert().code(1).get_output().clone();
        let text = String::from_utf8(output.stderr).expect("text");
        assert!(text.starts_with("error: ") && text.contains(said) && output.stdout.is_empty(), "{file}: {text}");
    }
    assert!(bench.run("doctor --help").contains("isolume doctor brain.nii.gz"));
}

/// On the files that users have: every one is read, and every finding says what is done about it.
#[test]
fn real_files_are_told() {
    let root = std::env::var_os("CARGO_MANIFEST_DIR").map_or_else(|| env!("CARGO_MANIFEST_DIR").into(), PathBuf::from);
    let data = std::env::var_os("ISOLUME_DATA").map_or_else(|| root.join("../shared/data"), PathBuf::from);
    let (volume, probe) = (data.join("volumes/ironprot.vtk"), data.join("probes/studio.exr"));
    if !volume.exists() || !probe.exists() {
        println!("skipped: no real data at {}", data.display());
        return;
    }
    let bench = Bench::new();
    // Counted apart, in the bytes of the file: 3484 of its 314432 samples are 255.
    assert_eq!(bench.finding(&volume.display().to_string(), "saturation").0, 3484);
    assert_eq!(bench.finding(&probe.display().to_string(), "negative").0, 3);
    for file in [volume, probe] {
        for finding in bench.diagnosis(&file.display().to_string())["findings"].as_array().expect("findings") {
            assert!(finding["handled"].as_str().is_some_and(|t| t.len() > 20), "{finding}");
        }
    }
}
