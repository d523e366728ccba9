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

/// A bench with `ball.nrrd`, a ball of 8-bit samples, more than what is read at once, and what bakes its surface.
struct Ball(Bench, Vec<u8>);

const OF_BALL: &str = "bake ball.nrrd --isovalues 128 --rays 4 --layers 1 --bands 2";
const BY_REFERENCE: &str = "--store-volume reference -o named.isolume";

impl Ball {
    fn new() -> Self {
        let (dims, radius) = ([48, 44, 40], 15.0f64);
        let inside = |i: usize| {
            let at = [i % dims[0], i / dims[0] % dims[1], i / (dims[0] * dims[1])];
            let away = (0..3).map(|a| (at[a] as f64 - dims[a] as f64 / 2.0).powi(2)).sum::<f64>().sqrt();
            (128.0 + 8.0 * (radius - away)).clamp(0.0, 255.0) as u8
        };
        let samples: Vec<u8> = (0..dims.iter().product()).map(inside).collect();
        let bench = Bench::new();
        bench.write("ball.nrrd", nrrd("48 44 40", &samples));
        Self(bench, samples)
    }

    /// The files below a folder; there is one at least.
    fn below(&self, folder: &str) -> Vec<(PathBuf, Vec<u8>)> {
        let root = self.0.path(folder);
        let inside = self.0.all().into_iter().filter(|(path, _)| path.starts_with(&root) && path.is_file());
        let inside = inside.map(|(path, bytes)| (path.strip_prefix(&root).expect("below").to_path_buf(), bytes));
        let found: Vec<_> = inside.collect();
        assert!(found.iter().any(|(_, bytes)| !bytes.is_empty()), "{folder} is empty");
        found
    }

    /// Other samples in a file, written at the same time as before.
    fn alter(&self, name: &str) {
        let time = std::fs::metadata(self.0.path(name)).and_then(|m| m.modified()).expect("a time");
        let mut samples = self.1.clone();
        samples[0] ^= 1;
        self.0.write(name, nrrd("48 44 40", &samples));
        let file = std::fs::File::options().write(true).open(self.0.path(name)).expect("opened");
        file.set_modified(time).expect("set");
    }

    /// What a line says where people read it.
    fn says(&self, line: &str) -> String {
        let output = self.0.command(line).assert().success().get_output().stderr.clone();
        String::from_utf8(output).expect("text").split_whitespace().collect::<Vec<_>>().join(" ")
    }
}

#[test]
fn mapped_volumes_are_those_that_are_read() {
    let ball = Ball::new();
    let bench = &ball.0;
    bench.run(&format!("{OF_BALL} -o mapped.isolume"));
    bench.run(&format!("{OF_BALL} --no-map -o read.isolume"));
    assert!(ball.below("mapped.isolume") == ball.below("read.isolume"));
    let hash = |line: &str| bench.json(line)["content_hash"].as_str().map(str::to_owned).expect("a hash");
    assert_eq!(hash("info ball.nrrd"), hash("info --no-map ball.nrrd"));
    // The forecast counts samples that are read at once, chunks by the threads, vertices by the isovalues.
    let memory =
        |more: &str| bench.json(&format!("plan ball.nrrd --rays 4 {more}"))["memory_bytes"].as_u64().expect("bytes");
    let one = memory("--isovalues 128 --threads 1");
    assert_eq!(memory("--isovalues 128 --threads 1 --no-map") - one, ball.1.len() as u64);
    assert!(memory("--isovalues 128 --threads 4") > one);
    assert!(memory("--isovalues 128,100 --threads 1") > one);
    assert!(memory("--isovalues 128 --threads 1 --layers 1 --bands 2") < one);
    assert!(memory("--isovalues 128 --texture 2") > memory("--isovalues 128 --texture 1"));
    // A job asks for the threads of its tasks, whatever this machine has.
    let job = |cpus: u32| {
        let job = format!("--tasks 2 --cpus {cpus} -o b.isolume --script job{cpus}.sh --json -- --isovalues 128");
        let said = bench.run(&format!("cluster slurm ball.nrrd {job}"));
        let said: serde_json::Value = serde_json::from_str(&said).expect("one JSON document");
        said["memory_bytes"].as_u64().expect("bytes")
    };
    assert!(job(512) > job(1));
}

#[test]
fn stores_may_refer_to_the_file_of_their_volume() {
    let ball = Ball::new();
    let bench = &ball.0;
    bench.write("copy.nrrd", bench.bytes("ball.nrrd"));
    bench.run(&format!("{OF_BALL} -o mapped.isolume"));
    // Everything but the samples is as with a copy.
    bench.run(&format!("{OF_BALL} {BY_REFERENCE}"));
    assert!(!bench.path("named.isolume/volumes/ball/data/c").exists());
    assert!(ball.below("named.isolume/surfaces") == ball.below("mapped.isolume/surfaces"));
    for store in ["named", "mapped"] {
        bench.run(&format!("relight {store}.isolume --isovalue 128 --env studio -o {store}.ply -q"));
    }
    assert!(bench.bytes("named.ply") == bench.bytes("mapped.ply"));
    // Whoever opens it is told where the samples are.
    let file = bench.path("ball.nrrd").canonicalize().expect("a path").display().to_string();
    assert_eq!(bench.json("info named.isolume")["samples_file"], file.as_str());
    assert!(bench.json("info mapped.isolume")["samples_file"].is_null());
    assert!(bench.run("info named.isolume").contains(&file));
    let relight = "relight named.isolume --isovalue 128 --env studio -o x.ply";
    for line in [
        relight,
        "verify named.isolume",
        "merge named.isolume -o merged.isolume",
        "pack named.isolume -o packed.isolume",
    ] {
        let said = ball.says(line);
        assert!(said.contains("samples of ball are read from") && said.contains("ball.nrrd"), "{line}: {said}");
    }
    assert!(bench.run("doctor named.isolume").contains("samples elsewhere"));
    assert!(bench.run("doctor mapped.isolume").contains("nothing unusual"));
    // What it is stays, and is said.
    let said = ball.says(&format!("{OF_BALL} -o named.isolume"));
    assert!(said.contains("the samples stay in") && said.contains("ball.nrrd"), "{said}");
    let said = ball.says(&format!("{OF_BALL} --store-volume reference -o mapped.isolume"));
    assert!(said.contains("keeps its copy"), "{said}");
    assert!(!ball.says(&format!("{OF_BALL} {BY_REFERENCE}")).contains("stay"));

    std::fs::rename(bench.path("ball.nrrd"), bench.path("away.nrrd")).expect("renamed");
    bench.refuses_line(relight, &["ball.nrrd", "No such file", "--store-volume reference"]);
    for (line, said) in [("doctor named.isolume", "No such file"), ("verify named.isolume", "damaged volume")] {
        let (code, out, _) = bench.outcome(line);
        assert!(code == 1 && out.contains("damaged volume") && out.contains(said), "{line}: {out}");
    }
    // What was packed has the samples.
    assert!(bench.run("doctor packed.isolume").contains("nothing unusual"));
    bench.write("ball.nrrd", &bench.bytes("away.nrrd")[..50_000]);
    bench.refuses_line(relight, &["ball.nrrd", "50000 bytes"]);
    // The same samples, in a file that was written since.
    std::fs::rename(bench.path("copy.nrrd"), bench.path("ball.nrrd")).expect("renamed");
    bench.run(&format!("{OF_BALL} {BY_REFERENCE}"));
    assert!(bench.run("doctor named.isolume").contains("samples elsewhere"));
    // What is not there to be named is refused before any work.
    bench.refuses_line("bake sphere:12 --store-volume reference -o x.isolume", &["--store-volume", "in memory"]);
    bench.refuses_line("bake ball.nrrd --no-map --store-volume reference -o x.isolume", &["--store-volume"]);
    bench.refuses_line("doctor named.isolume --channel 1", &["--channel", "a store"]);
}

/// Length and time do not prove samples: who looks at all of them finds it, and can put it right.
#[test]
fn a_file_of_other_samples_is_found_and_mended() {
    let ball = Ball::new();
    let bench = &ball.0;
    std::fs::create_dir(bench.path("right")).expect("made");
    bench.write("right/ball.nrrd", bench.bytes("ball.nrrd"));
    bench.run(&format!("{OF_BALL} {BY_REFERENCE}"));
    ball.alter("ball.nrrd");
    let relight = "relight named.isolume --isovalue 128 --env studio -o x.ply -q";
    bench.run(relight);
    bench.refuses_line(&format!("{relight} --no-map"), &["ball.nrrd", "BLAKE3", "--store-volume reference"]);
    let (code, out, _) = bench.outcome("doctor named.isolume");
    assert!(code == 1 && out.contains("damaged volume") && out.contains("BLAKE3"), "{out}");
    // The bake of that file is one of another volume, and writes nothing; shares believe the time, unless they are told not to.
    let again = format!("{OF_BALL} {BY_REFERENCE}");
    bench.refuses_line(&again, &["named.isolume", "volume"]);
    bench.refuses_line(&format!("{again} --chunks 1/2 --repair"), &["named.isolume", "volume"]);
    // That of a file with its samples takes the place.
    let right = OF_BALL.replace("ball.nrrd", "right/ball.nrrd");
    assert!(ball.says(&format!("{right} {BY_REFERENCE}")).contains("of another file"));
    assert!(bench.run("doctor named.isolume").contains("samples elsewhere"));
    // So does a copy.
    ball.alter("right/ball.nrrd");
    bench.write("left.nrrd", nrrd("48 44 40", &ball.1));
    std::fs::remove_file(bench.path("ball.nrrd")).expect("removed");
    std::fs::rename(bench.path("left.nrrd"), bench.path("ball.nrrd")).expect("renamed");
    bench.run(&format!("{OF_BALL} -o named.isolume"));
    assert!(bench.run("doctor named.isolume").contains("nothing unusual"));
}

/// Metadata are text: a path that is none cannot stand in them.
#[cfg(target_os = "linux")]
#[test]
fn a_path_that_is_no_text_is_refused_by_name() {
    use std::os::unix::ffi::OsStrExt;
    let ball = Ball::new();
    let odd = ball.0.folder.path().join(std::ffi::OsStr::from_bytes(b"f\xfflder"));
    std::fs::create_dir(&odd).expect("made");
    std::fs::rename(ball.0.path("ball.nrrd"), odd.join("ball.nrrd")).expect("renamed");
    let process = |line: &str| {
        let mut command = ball.0.process(line);
        command.current_dir(&odd);
        command
    };
    ball.0.refuses_all(process(&format!("{OF_BALL} {BY_REFERENCE}")), &["ball.nrrd", "UTF-8", "--store-volume"]);
    Command::from_std(process(&format!("{OF_BALL} -o copied.isolume"))).assert().success();
}
