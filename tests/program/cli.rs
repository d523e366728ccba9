//! The program from outside: the main path on small fields, and what it says to bad input.

use crate::common::program::{Bench, collect};
use std::path::{Path, PathBuf};

fn bytes(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut names = Vec::new();
    collect(folder, &mut names);
    names.sort();
    let inside = |p: &PathBuf| p.strip_prefix(folder).expect("inside").to_path_buf();
    let files = names.iter().filter(|p| p.is_file());
    files.map(|p| (inside(p), std::fs::read(p).expect("a file"))).collect()
}

#[test]
fn bake_then_relight_traces_nothing() {
    let bench = Bench::new();
    let bake = bench.json("bake sphere:24 --rays 16 --layers 2 --bands 3 --effects +shadowing -o s.isolume");
    assert!(bake["bake"]["rays"].as_u64().is_some_and(|rays| rays > 1000), "{bake}");
    let lit =
        bench.json("relight s.isolume --isovalue -0.6 --env constant --albedo 0.5 --exposure 0 --radiance -o s.glb");
    assert_eq!(lit["transport_rays"], 0);
    assert_eq!(lit["files"][0]["lookups"]["unbaked"], 0);
    // A sphere is convex: under radiance 1 from everywhere it leaves its albedo. The colour of the first
    // vertex is read from the file.
    let glb = std::fs::read(bench.path("s.glb")).expect("the file");
    let text = String::from_utf8_lossy(&glb).into_owned();
    assert!(text.contains("\"COLOR_0\"") && text.contains("\"_RADIANCE\"") && text.contains("KHR_materials_unlit"));
    // A second environment and a picture, still without a ray.
    let picture = bench.json("relight s.isolume --isovalue -0.6 --env sun:0,30 --size 40x30 --view front -o s.png");
    assert_eq!(picture["transport_rays"], 0);
    assert!(picture["camera_rays"].as_u64().is_some_and(|rays| rays >= 40 * 30));
    // The sun stands on the right of the front view: there it is brighter.
    let image = image::open(bench.path("s.png")).expect("a picture").to_luma8();
    let (left, right) = (image.get_pixel(13, 15)[0], image.get_pixel(27, 15)[0]);
    assert!(right > left + 40, "left {left}, right {right}");
}

#[test]
fn the_bytes_do_not_depend_on_threads() {
    let bench = Bench::new();
    for threads in [1, 2] {
        bench.run(&format!("bake gyroid:20 --rays 8 --layers 3 --threads {threads} -o t{threads}.isolume"));
        bench.run(&format!(
            "relight t{threads}.isolume --isovalue 0 --env studio --threads {threads} -o t{threads}.glb"
        ));
    }
    assert_eq!(bytes(&bench.path("t1.isolume")), bytes(&bench.path("t2.isolume")));
    assert_eq!(std::fs::read(bench.path("t1.glb")).ok(), std::fs::read(bench.path("t2.glb")).ok());
}

#[test]
fn a_bake_goes_on_where_it_was_and_refuses_another_identity() {
    let bench = Bench::new();
    let first = bench.json("bake sphere:40 --isovalues -0.5 --rays 4 --layers 1 --bands 2 -o s.isolume");
    assert!(first["bake"]["chunks"]["baked"].as_u64().is_some_and(|n| n > 0));
    let again = bench.json("bake sphere:40 --isovalues -0.5 --rays 4 --layers 1 --bands 2 -o s.isolume");
    assert_eq!(again["bake"]["chunks"]["baked"], 0);
    assert_eq!(again["bake"]["rays"], 0);
    // What is not there is named, with the command that makes it.
    let text = bench.refuses("relight s.isolume --isovalue -0.8 --env sky -o s.glb");
    assert!(text.contains("holds these isovalues: -0.5") && text.contains("isolume bake"), "{text}");
    bench.run("bake sphere:40 --isovalues -0.8 --rays 4 --layers 1 --bands 2 -o s.isolume");
    bench.run("relight s.isolume --isovalue -0.8,-0.5 --env sky -o {isovalue}.ply");
    assert!(bench.path("-0.5.ply").exists() && bench.path("-0.8.ply").exists());
    // A lost chunk is baked again, with the same bytes.
    let before = bytes(&bench.path("s.isolume"));
    let lost = bench.path("s.isolume/surfaces/sphere/-0.5/transfer/c/0/0");
    std::fs::remove_file(lost).expect("removed");
    bench.run("bake sphere:40 --isovalues -0.8,-0.5 --rays 4 --layers 1 --bands 2 -o s.isolume");
    assert_eq!(bytes(&bench.path("s.isolume")), before);
    let text = bench.refuses("bake sphere:40 --rays 4 --layers 2 --bands 2 -o s.isolume");
    assert!(text.contains("bands"), "{text}");
    bench.run("bake sphere:40 --isovalues -0.5 --rays 4 --layers 2 --bands 2 --force -o s.isolume");
}

#[test]
fn a_volume_is_baked_once_into_the_cache() {
    let bench = Bench::new();
    let line = "relight torus:20 --isovalue auto --env sunset --rays 4 --layers 1 --cache cache -o t.ply";
    assert!(bench.json(line)["transport_rays"].as_u64().is_some_and(|rays| rays > 0));
    assert_eq!(bench.json(line)["transport_rays"], 0);
}

#[test]
fn info_plan_env_and_replay_speak_json() {
    let bench = Bench::new();
    assert_eq!(bench.json("info bumpbox:16")["dims"], serde_json::json!([16, 16, 16]));
    let plan = bench.json("plan bowl:17 --isovalues auto");
    let names: Vec<&str> =
        plan["effects"].as_array().expect("rows").iter().filter_map(|e| e["name"].as_str()).collect();
    assert_eq!(names, isolume::scene::EFFECTS);
    let replay = bench.json("bake bowl:17 --rays 8 --replay-texel 8,8,2");
    assert_eq!(replay["paths"].as_array().map(Vec::len), Some(8));
    let show = bench.json("env show courtyard");
    assert_eq!(show["coefficients"][0].as_array().map(Vec::len), Some(9));
    assert_eq!(bench.json("env project constant --bands 2")["rgb"].as_array().map(Vec::len), Some(4));
    bench.run("env rotate sun:10,20,5 --env-rotate 90 -o turned.hdr");
    let turned = bench.json("env show turned.hdr");
    let azimuth = turned["brightest_pixel"]["azimuth_degrees"].as_f64().expect("a lobe");
    assert!((azimuth - 100.0).abs() < 3.0, "{azimuth}");
    // The store explains itself, too.
    bench.run("bake sphere:12 --rays 4 --layers 1 --bands 1 -o s.isolume");
    assert_eq!(bench.json("info s.isolume")["isovalues"], "all");
}

#[test]
fn usage_errors_have_their_own_code() {
    let bench = Bench::new();
    for line in ["", "bkae", "bake sphere:8 --rays 12 -o x", "relight x --isovalue q --env sky -o a.glb", "info"] {
        bench.command(line).assert().code(2);
    }
    for line in ["--help", "bake --help", "relight --help", "plan --help", "info --help", "demo --help", "env --help"] {
        let text = bench.run(line);
        assert!(text.contains("isolume "), "{line}");
    }
}

#[test]
fn bad_input_is_refused_by_name_and_leaves_nothing() {
    let bench = Bench::new();
    std::fs::write(bench.path("text.nii.gz"), "this is not a volume\n").expect("written");
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 40 40 40\nencoding: raw\n\nonly a few bytes";
    std::fs::write(bench.path("short.nrrd"), header).expect("written");
    let header = "NRRD0004\ntype: float\ndimension: 3\nsizes: 10000 10000 10000\nendian: little\nencoding: raw\n\n";
    std::fs::write(bench.path("huge.nrrd"), header).expect("written");
    std::fs::write(bench.path("sky.png.exr"), "not an image").expect("written");
    std::fs::create_dir(bench.path("folder")).expect("made");
    let bake = "--rays 4 --layers 1 --bands 1";
    for (line, said) in [
        (format!("bake missing.nii.gz {bake} -o x.isolume"), "missing.nii.gz"),
        (format!("bake text.nii.gz {bake} -o x.isolume"), "text.nii.gz"),
        (format!("bake short.nrrd {bake} -o x.isolume"), "short.nrrd"),
        (format!("bake huge.nrrd {bake} -o x.isolume"), "huge.nrrd"),
        (format!("bake spere:8 {bake} -o x.isolume"), "did you mean the field sphere?"),
        (format!("bake sphere:8 {bake} -o folder"), "directory"),
        (format!("bake sphere:8 {bake} -o missing/x.isolume"), "missing"),
        (format!("bake sphere:8 {bake} --isovalues 7 -o x.isolume"), "range"),
        (format!("bake sphere:64 {bake} --memory-limit 1MB -o x.isolume"), "memory-limit"),
        ("info text.nii.gz".into(), "text.nii.gz"),
        ("relight sphere:8 --isovalue 7 --env sky -o x.glb".into(), "range"),
        ("relight sphere:8 --isovalue auto --env cuortyard -o x.glb".into(), "did you mean courtyard?"),
        ("relight sphere:8 --isovalue auto --env sky.png.exr -o x.glb".into(), "sky.png.exr"),
        ("relight sphere:8 --isovalue auto --env sky -o folder".into(), "directory"),
        ("relight sphere:8 --isovalue auto --env sky -o missing/x.glb".into(), "missing"),
        ("relight sphere:8 --isovalue auto --env sky -o x.obj".into(), ".glb"),
        ("relight sphere:8 --isovalue auto --env sky --env studio -o x.glb".into(), "{env}"),
        ("relight sphere:8 --isovalue auto --env sky --albedo 1.5 -o x.glb".into(), "albedo"),
        ("relight sphere:8 --isovalue auto --env sky --colormap virdis -o x.glb".into(), "did you mean viridis?"),
        ("env show nowhere.exr".into(), "nowhere.exr"),
    ] {
        let text = bench.refuses(&line);
        assert!(text.contains(said), "`{line}` does not name {said}: {text}");
    }
}

#[test]
fn a_probe_with_nan_works_with_a_note_and_fails_its_check() {
    let bench = Bench::new();
    let pixel = |x: usize, y: usize| if (x, y) == (3, 2) { (f32::NAN, 1.0, 1.0) } else { (1.0, 1.0, 1.0f32) };
    exr::prelude::write_rgb_file(bench.path("nan.exr"), 16, 8, pixel).expect("written");
    let line = "relight sphere:12 --isovalue auto --env nan.exr --rays 4 --layers 1 --cache c -o s.glb";
    let output = bench.command(line).assert().success().get_output().stderr.clone();
    assert!(String::from_utf8_lossy(&output).contains("note: nan: "), "{}", String::from_utf8_lossy(&output));
    let text = bench.refuses("env check nan.exr");
    assert!(text.contains("unusual"), "{text}");
    bench.command("env check courtyard").assert().success();
}

#[cfg(unix)]
#[test]
fn an_output_that_cannot_be_written_is_refused_before_the_work() {
    use std::os::unix::fs::PermissionsExt;
    let bench = Bench::new();
    std::fs::create_dir(bench.path("locked")).expect("made");
    let lock = |mode| std::fs::set_permissions(bench.path("locked"), PermissionsExt::from_mode(mode));
    lock(0o555).expect("locked");
    // Root writes everywhere: then there is nothing to test.
    if std::fs::write(bench.path("locked/probe"), "").is_ok() {
        println!("skipped: this user may write into a read-only folder");
    } else {
        let text = bench.refuses("relight sphere:8 --isovalue auto --env sky -o locked/x.glb");
        assert!(text.contains("locked"), "{text}");
        bench.refuses("bake sphere:8 --rays 4 -o locked/x.isolume");
    }
    lock(0o755).expect("unlocked");
}
