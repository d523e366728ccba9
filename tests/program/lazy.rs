//! Relighting a volume: drafts first, the result over them, and what was baked is used again. Bakes that stop.

use assert_cmd::Command;
use serde_json::Value;
use std::path::Path;

fn isolume(directory: &Path, arguments: &[&str]) -> std::process::Output {
    Command::cargo_bin("isolume").unwrap().current_dir(directory).args(arguments).output().unwrap()
}

fn json(directory: &Path, arguments: &[&str]) -> Value {
    let output = isolume(directory, &[arguments, &["--json"]].concat());
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn refused(directory: &Path, arguments: &[&str], code: i32, words: &[&str]) {
    let output = isolume(directory, arguments);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{message}");
    assert!(words.iter().all(|word| message.contains(word)), "{message}");
}

#[test]
fn drafts_come_first_and_are_replaced() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    // Outside a sphere every path escapes at once: many paths in little time.
    // Traced all the same, or its closed form would leave nothing to draft.
    let relight = [
        "relight",
        "sphere:24",
        "--isovalue",
        "auto",
        "--env",
        "constant",
        "--cache",
        "cache",
        "--rays",
        "8192",
        "--effects",
        "+shadowing",
        "--texture",
        "1",
    ];
    let first = json(at, &[&relight[..], &["-o", "drafted.glb"]].concat());
    let drafts = first["drafts"].as_array().unwrap();
    let texels: Vec<&Value> = drafts.iter().map(|d| &d["texels"][0]).collect();
    assert_eq!(texels, [&Value::from(12), &Value::from(24)], "half the resolution, then all of it: {first}");
    assert!(drafts.iter().all(|d| d["rays_per_texel"] == 16));
    let [a, b] = [0, 1].map(|i| drafts[i]["written_after_seconds"].as_f64().unwrap());
    assert!(0.0 < a && a < b);
    // The second time everything is there.
    let again = json(at, &[&relight[..], &["-o", "again.glb"]].concat());
    assert!(again["drafts"].as_array().unwrap().is_empty() && again["transport_rays"] == 0);
    let bytes = |name: &str| std::fs::read(at.join(name)).unwrap();
    assert!(bytes("drafted.glb") == bytes("again.glb"));
    // Without drafts the same file.
    let mut plain = relight;
    plain[7] = "other-cache";
    let direct = json(at, &[&plain[..], &["-o", "direct.glb", "--no-draft"]].concat());
    assert!(direct["drafts"].as_array().unwrap().is_empty());
    assert!(bytes("drafted.glb") == bytes("direct.glb"));
    let error = &direct["files"][0]["error"];
    assert!(error["median_relative"].as_f64() <= error["percentile_95_relative"].as_f64());
}

#[test]
fn a_time_becomes_an_error_that_the_store_remembers() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    // The time is generous: whatever it allows, the recorded error gives the same store.
    let bake = |more: &[&str]| {
        json(at, &[&["bake", "bumpbox:24", "--layers", "2", "--bands", "3", "--rays", "256"], more].concat())
    };
    let first = bake(&["--time", "2s", "-o", "timed.isolume"]);
    let error = first["bake"]["error_target"].as_f64().unwrap();
    assert!(error > 0.0 && first["bake"]["rays"].as_u64().unwrap() > 0);
    let again = bake(&["--time", "2s", "-o", "timed.isolume"]);
    assert_eq!(again["bake"]["error_target"].as_f64(), Some(error));
    assert_eq!(again["bake"]["chunks"]["baked"], 0);
    let texels = |store: &str| {
        let chunk = at.join(store).join("transfer/bumpbox/env/transfer/c/0/0/0/0");
        std::fs::read(&chunk).unwrap_or_else(|e| panic!("{}: {e}", chunk.display()))
    };
    bake(&["--error", &error.to_string(), "-o", "error.isolume"]);
    assert!(texels("timed.isolume") == texels("error.isolume"));
    refused(at, &["bake", "gyroid:96", "--time", "0.2s", "-o", "short.isolume"], 1, &["0.2 s", "fewer isovalues"]);
    refused(at, &["bake", "bumpbox:24", "--time", "soon", "-o", "x.isolume"], 2, &["90s"]);
    refused(at, &["bake", "bumpbox:24", "--time", "5s", "--chunks", "1/2", "-o", "x.isolume"], 2, &["--chunks"]);
}

#[test]
fn an_environment_says_what_an_error_is_of() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    let bake = |more: &[&str]| json(at, &[&["bake", "bumpbox:24", "--isovalues", "40"], more].concat());
    let under = |env: &str, store: &str| bake(&["--error", "2%", "--for-env", env, "-o", store]);
    let first = under("sun:45,30", "a.isolume");
    let of = first["bake"]["escape_stderr"]["of"].as_str().unwrap();
    assert!(of.contains("sun:45,30") && of.contains("albedo 0.7"), "{of}");
    // 1/32: quantiles are rounded up. A few texels at the rim of the lamp's shadow get all they may have, and need more.
    assert!(first["bake"]["escape_stderr"]["p95"].as_f64().unwrap() <= 0.02 * (1.0 + 1.0 / 32.0));
    // Twice as much light has the same relative error: the same texels, in the same store nothing to do but rename.
    let constant = under("constant", "b.isolume");
    assert!(constant["bake"]["paths"].as_u64() < first["bake"]["paths"].as_u64(), "a sun needs more than a sky");
    // Another light asks for more of some texels; what has enough stays.
    let other = under("constant", "a.isolume");
    assert_eq!(other["bake"]["chunks"]["kept"], 0);
    assert_eq!(under("sun:45,30", "a.isolume")["bake"]["chunks"]["baked"], 0);
    refused(
        at,
        &["bake", "bumpbox:24", "--rays", "64", "--for-env", "sky", "-o", "x.isolume"],
        1,
        &["--error, --time or --auto"],
    );
    let black = ["bake", "bumpbox:24", "--error", "1%", "--for-env", "black.png", "-o", "x.isolume"];
    image::RgbImage::new(8, 4).save(at.join("black.png")).unwrap();
    refused(at, &black, 1, &["lights no texel"]);
    refused(at, &["bake", "bumpbox:24", "--error", "1%", "--for-env", "sunset3", "-o", "x"], 1, &["sunset"]);
}

#[test]
fn gather_tells_its_bias_and_refuses_targets() {
    let directory = tempfile::tempdir().unwrap();
    let at = directory.path();
    let bake = ["bake", "gyroid:20", "--estimator", "gather", "--rays", "16", "-o", "g.isolume"];
    let made = json(at, &bake);
    let bias = &made["bake"]["bias"];
    assert!(bias["texels"].as_u64().unwrap() > 100 && bias["rms_at_most"].as_f64().unwrap() > 0.0, "{made}");
    assert!(made["identity"]["estimator"]["name"] == "gather");
    assert_eq!(json(at, &bake)["bake"]["chunks"]["baked"], 0);
    // Its texels depend on their neighbours: other isosurfaces are another store.
    refused(at, &[&bake[..], &["--isovalues", "0"]].concat(), 1, &["estimator"]);
    refused(at, &[&bake[..], &["--error", "1%"]].concat(), 1, &["estimator gather"]);
}
