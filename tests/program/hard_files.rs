//! VALIDATION 30, files: one test for each kind of bad luck, through the program. What must hold: exit code
//! 1, one line that names the file and says what to do, nothing half-written, and what was there before is
//! as it was. Damage byte by byte is in `fuzz` and in the tests of the readers and the store.

use crate::common::program::{Bench, collect, isolume};
use assert_cmd::Command;
use std::io::Write;
use std::path::PathBuf;
use std::process;

/// A small bake that takes no time.
const BAKE: &str = "--rays 4 --layers 1 --bands 2 --quiet";

impl Bench {
    /// All files with their bytes; folders, and what cannot be read, with none.
    fn all(&self) -> Vec<(PathBuf, Vec<u8>)> {
        let bytes = |path: PathBuf| (path.clone(), std::fs::read(path).unwrap_or_default());
        self.names().into_iter().map(bytes).collect()
    }

    /// Runs a command that must end with 1, one `error:` line that holds all of `said`, and every file as it
    /// was.
    fn refuses_all(&self, command: process::Command, said: &[&str]) -> String {
        let before = self.all();
        let output = Command::from_std(command).assert().code(1).get_output().clone();
        let text = String::from_utf8(output.stderr).expect("text");
        assert_eq!(text.lines().filter(|l| l.starts_with("error: ")).count(), 1, "{text}");
        for part in said {
            assert!(text.contains(part), "{part} is not in: {text}");
        }
        let names = |all: &[(PathBuf, Vec<u8>)]| all.iter().map(|(p, _)| p.clone()).collect::<Vec<_>>();
        assert_eq!(names(&self.all()), names(&before), "{text}");
        assert!(self.all() == before, "a file changed: {text}");
        text
    }

    fn refuses_line(&self, line: &str, said: &[&str]) -> String {
        self.refuses_all(self.process(line), said)
    }
}

/// A NRRD of 8-bit samples.
fn nrrd(sizes: &str, data: &[u8]) -> Vec<u8> {
    let head = format!("NRRD0004\ntype: uchar\ndimension: 3\nsizes: {sizes}\nencoding: raw\n\n");
    [head.as_bytes(), data].concat()
}

/// Every command that reads a volume.
const READERS: [&str; 4] = ["info", "doctor", "plan", "bake -o new.isolume"];

#[test]
fn truncated_volumes_probes_and_stores() {
    let bench = Bench::new();
    let whole = nrrd("6 6 6", &[7; 216]);
    for (name, length) in
        [("magic.nrrd", 4), ("header.nrrd", 30), ("none.nrrd", whole.len() - 216), ("one.nrrd", whole.len() - 1)]
    {
        bench.write(name, &whole[..length]);
        for command in READERS {
            bench.refuses_line(&format!("{command} {name}"), &[name]);
        }
    }
    let pixel = |x: usize, y: usize| (x as f32, y as f32, 1.0f32);
    exr::prelude::write_rgb_file(bench.path("sky.exr"), 32, 16, pixel).expect("written");
    let sky = std::fs::read(bench.path("sky.exr")).expect("read");
    for length in [4, 100, sky.len() / 2, sky.len() - 1] {
        bench.write("sky.exr", &sky[..length]);
        for command in ["doctor", "env show", "relight sphere:8 --isovalue auto -o x.glb --env"] {
            bench.refuses_line(&format!("{command} sky.exr"), &["sky.exr"]);
        }
    }
    bench.run(&format!("bake sphere:12 {BAKE} -o s.isolume"));
    let root = std::fs::read(bench.path("s.isolume/zarr.json")).expect("read");
    bench.write("s.isolume/zarr.json", &root[..root.len() / 2]);
    for command in ["info", "doctor", "relight --isovalue -0.6 --env sky -o x.glb"] {
        bench.refuses_line(&format!("{command} s.isolume"), &["s.isolume/zarr.json"]);
    }
}

#[test]
fn a_header_that_claims_1e12_voxels() {
    let bench = Bench::new();
    bench.write("huge.nrrd", nrrd("10000 10000 10000", b"abc"));
    for command in READERS {
        bench.refuses_line(&format!("{command} huge.nrrd"), &["huge.nrrd", "10000×10000×10000"]);
    }
}

#[test]
fn wrong_magic() {
    let bench = Bench::new();
    bench.write("letter.nii.gz", b"Dear colleague, the volume follows by post.");
    for command in READERS {
        bench.refuses_line(&format!("{command} letter.nii.gz"), &["letter.nii.gz", "Dear colleague", "NRRD"]);
    }
    bench.write("letter.exr", b"Dear colleague");
    bench.refuses_line("env show letter.exr", &["letter.exr", "OpenEXR, Radiance HDR, PNG or JPEG"]);
    bench.write("letter.isolume", b"Dear colleague");
    bench.refuses_line("info letter.isolume", &["letter.isolume", "zip"]);
}

#[test]
fn wrong_version() {
    let bench = Bench::new();
    // NIfTI-2 that was copied as text.
    let mut nifti = vec![0u8; 600];
    nifti[..4].copy_from_slice(&540i32.to_le_bytes());
    nifti[4..8].copy_from_slice(b"n+2\0");
    bench.write("two.nii", &nifti);
    bench.refuses_line("info two.nii", &["two.nii", "behind the magic", "as text"]);
    bench.run(&format!("bake sphere:12 {BAKE} -o s.isolume"));
    let root = std::fs::read_to_string(bench.path("s.isolume/zarr.json")).expect("read");
    let known = isolume::transfer::store::FORMAT_VERSION;
    let newer = root.replace(&format!("\"format_version\": {known}"), "\"format_version\": 9");
    bench.write("s.isolume/zarr.json", newer.as_bytes());
    for command in ["info", "doctor", "relight --isovalue -0.6 --env sky -o x.glb"] {
        bench.refuses_line(
            &format!("{command} s.isolume"),
            &["s.isolume", "format version 9", &format!("from 1 to {known}")],
        );
    }
}

#[test]
fn a_gzip_bomb() {
    let bench = Bench::new();
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    packed.write_all(&nrrd("4000 4000 4000", &[])).expect("memory");
    std::io::copy(&mut std::io::Read::take(std::io::repeat(0), 1 << 28), &mut packed).expect("memory");
    let packed = packed.finish().expect("memory");
    assert!(packed.len() < 1 << 20);
    bench.write("bomb.nrrd.gz", &packed);
    // No gzip file of that length holds 64 GB: refused before anything is unpacked.
    bench.refuses_line("info bomb.nrrd.gz", &["bomb.nrrd.gz", "at most"]);
}

#[test]
fn zero_length() {
    let bench = Bench::new();
    for name in ["empty.nii", "empty.exr", "empty.isolume", "empty.json"] {
        bench.write(name, b"");
        bench.refuses_line(&format!("doctor {name}"), &[name, "empty"]);
    }
    for command in READERS {
        bench.refuses_line(&format!("{command} empty.nii"), &["empty.nii", "empty"]);
    }
    bench.refuses_line("env show empty.exr", &["empty.exr", "empty"]);
    bench.refuses_line("relight sphere:8 --isovalue auto -o x.glb --env empty.exr", &["empty.exr"]);
}

#[test]
fn a_directory_in_place_of_a_file() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("folder")).expect("made");
    for command in READERS {
        bench.refuses_line(&format!("{command} folder"), &["folder"]);
    }
    bench.refuses_line("env show folder", &["folder", "directory"]);
    bench.refuses_line("relight sphere:8 --isovalue auto --env folder -o x.glb", &["folder"]);
    bench.refuses_line("relight sphere:8 --isovalue auto --env sky -o folder", &["folder"]);
    bench.refuses_line(&format!("bake sphere:8 {BAKE} -o folder"), &["folder"]);
    bench.refuses_line("env rotate sky -o folder", &["folder"]);
}

/// The program as a user without rights. Root has all of them: the tests then run it as nobody, from a copy
/// that nobody can reach.
#[cfg(unix)]
fn without_rights(bench: &Bench, line: &str) -> process::Command {
    use std::os::unix::fs::{MetadataExt, PermissionsExt};
    use std::os::unix::process::CommandExt;
    let mut command = bench.here(isolume());
    if std::fs::metadata(bench.folder.path()).expect("the folder").uid() == 0 {
        let program = bench.path("program");
        if !program.exists() {
            // Copied by another process: while this one has a file open for writing, a child of another test inherits
            // it for a moment, and what is open for writing cannot be executed.
            assert!(process::Command::new("cp").arg(isolume()).arg(&program).status().expect("cp runs").success());
            std::fs::set_permissions(bench.folder.path(), PermissionsExt::from_mode(0o755)).expect("opened");
        }
        command = bench.here(program);
        command.uid(65534).gid(65534);
    }
    command.args(line.split_whitespace());
    command
}

#[cfg(unix)]
#[test]
fn no_permission_to_read() {
    use std::os::unix::fs::PermissionsExt;
    let bench = Bench::new();
    bench.run(&format!("bake sphere:12 {BAKE} -o s.isolume"));
    bench.write("v.nrrd", nrrd("6 6 6", &[7; 216]));
    bench.write("sky.hdr", b"#?RADIANCE\n\n-Y 1 +X 2\nabcdabcd");
    for name in ["v.nrrd", "sky.hdr", "s.isolume/zarr.json"] {
        std::fs::set_permissions(bench.path(name), PermissionsExt::from_mode(0o000)).expect("closed");
    }
    // The copy of the program must be there before files are compared.
    let _ = without_rights(&bench, "");
    for (line, name) in [
        ("info v.nrrd", "v.nrrd"),
        ("doctor v.nrrd", "v.nrrd"),
        ("env show sky.hdr", "sky.hdr"),
        ("doctor sky.hdr", "sky.hdr"),
        ("info s.isolume", "s.isolume/zarr.json"),
        ("doctor s.isolume", "s.isolume/zarr.json"),
    ] {
        bench.refuses_all(without_rights(&bench, line), &[name, "ermission denied"]);
    }
}

#[cfg(unix)]
#[test]
fn no_permission_to_write() {
    use std::os::unix::fs::PermissionsExt;
    let bench = Bench::new();
    bench.run(&format!("bake sphere:12 {BAKE} -o s.isolume"));
    std::fs::create_dir(bench.path("locked")).expect("made");
    std::fs::set_permissions(bench.path("locked"), PermissionsExt::from_mode(0o555)).expect("closed");
    let _ = without_rights(&bench, "");
    for line in [
        "relight s.isolume --isovalue -0.6 --env sky -o locked/x.glb",
        "relight s.isolume --isovalue -0.6 --env sky -o locked/x.png",
        "env rotate sky -o locked/x.hdr",
        "env project sky -o locked/x.json",
        "bake sphere:12 --rays 4 --layers 1 --bands 2 -o locked/x.isolume",
    ] {
        bench.refuses_all(without_rights(&bench, line), &["locked"]);
    }
}

/// The program where no file may grow beyond 12 KiB, as on a disk that is nearly full: the same calls fail in
/// the same places, with another number.
#[cfg(unix)]
fn on_a_full_disk(bench: &Bench, line: &str) -> process::Command {
    // Ignored, the signal becomes the error of the call. Blocks have 512 bytes, in some shells 1024.
    let script = "trap '' XFSZ; ulimit -f 24; exec \"$0\" \"$@\"";
    let mut command = bench.here("sh");
    command.arg("-c").arg(script).arg(isolume()).args(line.split_whitespace());
    command
}

#[cfg(unix)]
#[test]
fn disk_full_while_a_store_is_made() {
    let bench = Bench::new();
    let line = format!("bake gyroid:24 {BAKE} -o new.isolume");
    // The store never appears, and the message names its own path, not that of the temporary one.
    let text = bench.refuses_all(on_a_full_disk(&bench, &line), &["new.isolume/", "too large"]);
    assert!(!text.contains(".partial"), "{text}");
}

#[cfg(unix)]
#[test]
fn disk_full_while_a_store_grows() {
    let bench = Bench::new();
    bench.run(&format!("bake gyroid:24 {BAKE} -o s.isolume"));
    // More rays: every chunk is to be written again, and does not fit. The store stays what it was.
    let line = "bake gyroid:24 --rays 16 --layers 1 --bands 2 --quiet -o s.isolume";
    bench.refuses_all(on_a_full_disk(&bench, line), &["s.isolume/transfer/gyroid/env/", "too large"]);
    assert!(bench.run("doctor s.isolume").contains("nothing unusual"));
    // With room it goes on.
    bench.run(line);
    assert!(bench.run("doctor s.isolume").contains("16 rays"));
}

#[cfg(unix)]
#[test]
fn disk_full_while_results_are_written() {
    let bench = Bench::new();
    bench.run(&format!("bake gyroid:24 {BAKE} -o s.isolume"));
    for (new, line) in [
        ("a.glb", "relight s.isolume --isovalue 0 --env sky --quiet -o"),
        ("a.ply", "relight s.isolume --isovalue 0 --env sky --quiet -o"),
        ("a.png", "relight s.isolume --isovalue 0 --env sky --quiet --size 640x480 -o"),
        ("a.hdr", "env rotate courtyard --env-rotate 30 -o"),
    ] {
        bench.refuses_all(on_a_full_disk(&bench, &format!("{line} {new}")), &[new, "too large"]);
        // What was there under that name stays.
        bench.write(new, b"older");
        bench.refuses_all(on_a_full_disk(&bench, &format!("{line} {new}")), &[new, "too large"]);
        assert_eq!(std::fs::read(bench.path(new)).expect("read"), b"older");
    }
}

/// Killed without warning in mid-bake, again and again: each time the store is sound as far as it goes, and in
/// the end it holds the same bytes as one that was baked in peace.
#[cfg(unix)]
#[test]
fn kill_9_in_mid_bake() {
    let bench = Bench::new();
    let line = "bake gyroid:72 --isovalues 0 --rays 4 --layers 1 --bands 2 --quiet --threads 1 -o";
    let baked = |bytes: &[(PathBuf, Vec<u8>)], store: &str| -> Vec<(PathBuf, Vec<u8>)> {
        let root = bench.path(store);
        let inside = bytes.iter().filter_map(|(p, b)| Some((p.strip_prefix(&root).ok()?.to_path_buf(), b.clone())));
        inside.filter(|(p, _)| !p.ends_with(".lock")).collect()
    };
    for kill in 0..3 {
        let mut child = bench.process(&format!("{line} killed.isolume"));
        let mut child = child.stderr(process::Stdio::null()).stdout(process::Stdio::null()).spawn().expect("run");
        // Killed as soon as one chunk more is there; if it was quicker, it is done.
        let chunks = |bench: &Bench| {
            let mut all = Vec::new();
            let folder = bench.path("killed.isolume/transfer/gyroid/env/transfer/c");
            if folder.is_dir() {
                collect(&folder, &mut all);
            }
            all.iter().filter(|p| p.is_file() && p.ends_with("0")).count()
        };
        while chunks(&bench) <= kill && child.try_wait().expect("a child").is_none() {
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        child.kill().expect("killed");
        child.wait().expect("ended");
        // Whatever stands there can be opened and its chunks are sound or absent.
        let text = bench.run("doctor killed.isolume");
        assert!(!text.contains("damaged"), "{text}");
    }
    bench.run(&format!("{line} killed.isolume"));
    bench.run(&format!("{line} peace.isolume"));
    let all = bench.all();
    let (killed, peace) = (baked(&all, "killed.isolume"), baked(&all, "peace.isolume"));
    assert!(!peace.is_empty() && killed == peace, "the store of killed bakes differs");
}

/// Two bakes of one output at the same moment: both end, the loser is refused or adds nothing, and the store
/// is whole.
#[test]
fn two_processes_on_one_output() {
    let bench = Bench::new();
    let line = "bake gyroid:48 --isovalues 0 --rays 4 --layers 1 --bands 2 --quiet --threads 1 -o both.isolume";
    let start = || {
        let mut child = bench.process(line);
        child.stdout(process::Stdio::null()).stderr(process::Stdio::piped()).spawn().expect("run")
    };
    let children = [start(), start()];
    let outputs = children.map(|child| child.wait_with_output().expect("ended"));
    assert!(outputs.iter().any(|o| o.status.success()), "{outputs:?}");
    for output in &outputs {
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() || output.status.code() == Some(1) && text.contains("both.isolume"), "{text}");
    }
    assert!(bench.run("doctor both.isolume").contains("nothing unusual"));
    // Two relights to one file: one of the two results, whole.
    let relight = "relight both.isolume --isovalue 0 --env sky --quiet -o out.glb";
    let start = || bench.process(relight).stdout(process::Stdio::null()).spawn().expect("run");
    for mut child in [start(), start()] {
        assert!(child.wait().expect("ended").success());
    }
    let both = std::fs::read(bench.path("out.glb")).expect("read");
    bench.run(&relight.replace("out.glb", "alone.glb"));
    assert!(both == std::fs::read(bench.path("alone.glb")).expect("read"));
}

#[test]
fn mapped_volumes_are_those_that_are_read_and_stores_may_refer_to_them() {
    let bench = Bench::new();
    // A ball of 8-bit samples, more than what is read at once.
    let (dims, radius) = ([48, 44, 40], 15.0f64);
    let inside = |i: usize| {
        let at = [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])];
        let away = (0..3).map(|a| (at[a] as f64 - dims[a] as f64 / 2.0).powi(2)).sum::<f64>().sqrt();
        (128.0 + 8.0 * (radius - away)).clamp(0.0, 255.0) as u8
    };
    let ball: Vec<u8> = (0..dims.iter().product()).map(inside).collect();
    bench.write("ball.nrrd", nrrd("48 44 40", &ball));
    bench.write("copy.nrrd", nrrd("48 44 40", &ball));
    let below = |folder: &str| -> Vec<(PathBuf, Vec<u8>)> {
        let root = bench.path(folder);
        let inside = bench.all().into_iter().filter(|(path, _)| path.starts_with(&root));
        inside.map(|(path, bytes)| (path.strip_prefix(&root).expect("below").to_path_buf(), bytes)).collect()
    };
    bench.run(&format!("bake ball.nrrd --isovalues 128 {BAKE} -o mapped.isolume"));
    bench.run(&format!("bake ball.nrrd --isovalues 128 {BAKE} --no-map -o read.isolume"));
    assert!(below("mapped.isolume") == below("read.isolume"));
    assert!(bench.json("info ball.nrrd")["content_hash"] == bench.json("info --no-map ball.nrrd")["content_hash"]);
    // The forecast counts samples that are read at once.
    let memory = |more: &str| {
        bench.json(&format!("plan ball.nrrd --isovalues 128 --rays 4 {more}"))["memory_bytes"].as_u64().expect("bytes")
    };
    assert_eq!(memory("--no-map") - memory(""), ball.len() as u64);
    // A volume that the store only names: everything but the samples is as with a copy.
    let refer = "--store-volume reference -o named.isolume";
    bench.run(&format!("bake ball.nrrd --isovalues 128 {BAKE} {refer}"));
    assert!(!bench.path("named.isolume/volumes/ball/data/c").exists());
    assert!(below("named.isolume/surfaces") == below("mapped.isolume/surfaces"));
    for store in ["named", "mapped"] {
        bench.run(&format!("relight {store}.isolume --isovalue 128 --env studio -o {store}.ply -q"));
    }
    let picture = |name: &str| std::fs::read(bench.path(name)).expect("read");
    assert!(picture("named.ply") == picture("mapped.ply"));
    bench.run("doctor named.isolume");
    std::fs::rename(bench.path("ball.nrrd"), bench.path("away.nrrd")).expect("renamed");
    let relight = "relight named.isolume --isovalue 128 --env studio -o x.ply";
    bench.refuses_line(relight, &["ball.nrrd", "--store-volume reference"]);
    bench.command("doctor named.isolume").assert().code(1);
    bench.write("ball.nrrd", &nrrd("48 44 40", &ball)[..50_000]);
    bench.refuses_line(relight, &["ball.nrrd", "50000 bytes"]);
    // The same samples, in a file that was written since.
    std::fs::rename(bench.path("copy.nrrd"), bench.path("ball.nrrd")).expect("renamed");
    bench.run(&format!("bake ball.nrrd --isovalues 128 {BAKE} {refer}"));
    bench.run("doctor named.isolume");
    // What is not there to be named is refused before any work.
    bench.refuses_line("bake sphere:12 --store-volume reference -o x.isolume", &["--store-volume", "in memory"]);
    bench.refuses_line("bake ball.nrrd --no-map --store-volume reference -o x.isolume", &["--store-volume"]);
}
