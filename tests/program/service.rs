//! The program as other programs, batch systems and shells meet it: exit codes, signals, standard output, JSON errors,
//! the cache, completions and manual pages, and inputs that are no files or the output itself.

use crate::common::program::{Bench, collect, isolume};
use serde_json::Value;

/// A PNG of 2 × 1 grey pixels with more chunks before its pixels.
fn png(more: &[(&[u8; 4], Vec<u8>)]) -> Vec<u8> {
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut add = |kind: &[u8; 4], data: &[u8]| {
        let mut crc = flate2::Crc::new();
        crc.update(kind);
        crc.update(data);
        bytes.extend((data.len() as u32).to_be_bytes());
        bytes.extend(kind);
        bytes.extend(data);
        bytes.extend(crc.sum().to_be_bytes());
    };
    add(b"IHDR", &[0, 0, 0, 2, 0, 0, 0, 1, 8, 0, 0, 0, 0]);
    more.iter().for_each(|(kind, data)| add(kind, data));
    add(b"IDAT", &deflated(&[0, 128, 200]));
    add(b"IEND", &[]);
    bytes
}

fn deflated(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    encoder.write_all(bytes).expect("memory");
    encoder.finish().expect("memory")
}

#[cfg(target_os = "linux")]
mod linux {
    use super::*;
    use std::fs::File;
    use std::process::{Command, Stdio};
    use std::time::{Duration, Instant};

    fn send(signal: &str, process: u32) {
        let sent = Command::new("kill").args([&format!("-{signal}"), &process.to_string()]).status();
        assert!(sent.expect("kill runs").success());
    }

    /// Chunks of a store that are on disk.
    fn chunks(bench: &Bench, store: &str) -> usize {
        let mut names = Vec::new();
        let folder = bench.path(store).join("transfer/bumpbox/env/transfer/c");
        if folder.is_dir() {
            collect(&folder, &mut names);
        }
        names.iter().filter(|path| path.is_file()).count()
    }

    /// Dozens of chunks, of which some are done when the bake is asked to stop.
    const LONG: &str =
        "bake bumpbox:128 --isovalues 47 --texture 1 --rays 64 --layers 2 --bands 3 --threads 1 -o s.isolume";

    fn until(what: &str, holds: impl Fn() -> bool) {
        let start = Instant::now();
        while !holds() {
            assert!(start.elapsed() < Duration::from_secs(300), "{what}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Whether the process catches a signal: it does once it has something to lose.
    fn catches(process: u32, signal: u32) -> bool {
        let status = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
        let mask = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).unwrap_or_default();
        u64::from_str_radix(mask.trim(), 16).is_ok_and(|mask| mask >> (signal - 1) & 1 == 1)
    }

    #[test]
    fn a_bake_asked_to_stop_writes_its_chunks_and_exits_with_the_signal() {
        for (signal, number) in [("INT", 2), ("TERM", 15), ("HUP", 1)] {
            let bench = Bench::new();
            let mut child = bench.process(LONG).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("a start");
            until("a chunk is on disk", || chunks(&bench, "s.isolume") > 0);
            assert!(catches(child.id(), 15));
            send(signal, child.id());
            let mut said = String::new();
            std::io::Read::read_to_string(&mut child.stderr.take().expect("its errors"), &mut said).expect("text");
            let code = child.wait().expect("an end").code();
            assert_eq!(code, Some(128 + number), "{signal}: {said}");
            assert!(said.contains("stopping when the chunks in work are written"), "{said}");
            let counts = said.split("stopped after ").nth(1).and_then(|said| said.split(" chunks; resume").next());
            let (done, all) = counts.and_then(|said| said.split_once(" of ")).expect("how far it came");
            let [done, all] = [done, all].map(|n| n.parse::<usize>().expect("a number"));
            assert!(0 < done && done < all, "{signal}: {said}");
            assert_eq!(chunks(&bench, "s.isolume"), done, "{signal}: all of them are on disk");
        }
    }

    #[test]
    fn the_second_signal_ends_a_bake_at_once() {
        let bench = Bench::new();
        let line = LONG.replace("--rays 64", "--rays 65536");
        let mut child = bench.process(&line).stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("a start");
        until("the bake catches signals", || catches(child.id(), 15));
        send("TERM", child.id());
        std::thread::sleep(Duration::from_millis(300));
        let start = Instant::now();
        send("INT", child.id());
        let code = child.wait().expect("an end").code();
        // One second of grace; a chunk takes minutes.
        assert!(start.elapsed() < Duration::from_secs(30), "{:?}", start.elapsed());
        assert!(matches!(code, Some(130 | 143)), "{code:?}");
    }

    #[test]
    fn nohup_keeps_its_promise() {
        let bench = Bench::new();
        let mut nohup = bench.here("nohup");
        nohup.arg(isolume()).args(LONG.split_whitespace());
        nohup.stdout(Stdio::null()).stderr(Stdio::null());
        let mut child = nohup.spawn().expect("nohup runs");
        until("the bake catches signals", || catches(child.id(), 15));
        assert!(!catches(child.id(), 1), "SIGHUP stays ignored");
        let _ = child.kill();
        let _ = child.wait();
    }

    #[test]
    fn a_full_output_is_an_error_and_a_closed_one_is_none() {
        let bench = Bench::new();
        for line in ["info bumpbox:12 --json", "info bumpbox:12", "--help", "completions bash", "man"] {
            let full = File::options().write(true).open("/dev/full").expect("the device");
            let done = bench.process(line).stdout(full).output().expect("a run");
            let said = String::from_utf8_lossy(&done.stderr).into_owned();
            assert_eq!(done.status.code(), Some(1), "{line}: {said}");
            assert!(said.contains("error: cannot write to the output: No space left"), "{line}: {said}");
            let (reader, writer) = std::io::pipe().expect("a pipe");
            drop(reader);
            let done = bench.process(line).stdout(writer).output().expect("a run");
            assert!(
                done.status.success() && done.stderr.is_empty(),
                "{line}: {}",
                String::from_utf8_lossy(&done.stderr)
            );
        }
    }

    #[test]
    fn names_that_are_no_text_are_refused_by_every_command() {
        use std::os::unix::ffi::OsStrExt;
        let bench = Bench::new();
        let wrong = std::ffi::OsStr::from_bytes(b"s\xff");
        for command in ["bake", "relight", "info", "doctor", "merge", "view", "export"] {
            let done = bench.process(command).arg(wrong).output().expect("a run");
            let said = String::from_utf8_lossy(&done.stderr).into_owned();
            assert_eq!(done.status.code(), Some(2), "{said}");
            assert!(said.contains(r#""s\xFF""#) && said.contains("UTF-8"), "{command}: {said}");
        }
        assert!(bench.names().is_empty());
    }

    #[test]
    fn environments_that_are_no_plain_files_are_refused() {
        let bench = Bench::new();
        assert!(Command::new("mkfifo").arg(bench.path("pipe.hdr")).status().expect("mkfifo runs").success());
        for path in ["/dev/zero", "pipe.hdr", "/dev"] {
            let said = bench.refuses(&format!("env check {path}"));
            assert!(said.contains(path) && said.contains("plain file"), "{said}");
        }
        // What is piped in comes to an end.
        bench.write("e.png", png(&[]));
        let piped = File::open(bench.path("e.png")).expect("the image");
        let mut cat = Command::new("cat").stdin(piped).stdout(Stdio::piped()).spawn().expect("cat runs");
        let done = bench.process("env show /dev/stdin").stdin(cat.stdout.take().expect("a pipe")).output();
        assert!(done.expect("a run").status.success());
        let _ = cat.wait();
    }

    #[test]
    fn buffers_of_walls_are_plain_files_beside_them() {
        let bench = Bench::new();
        bench.write("secret.bin", [0; 4096]);
        let scene = |uri: &str| {
            let gltf = serde_json::json!({
                "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
                "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
                "buffers": [{ "uri": uri, "byteLength": 36 }],
                "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
                "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
                    "min": [0, 0, 0], "max": [1, 1, 0] }],
            });
            std::fs::create_dir_all(bench.path("walls")).expect("a folder");
            bench.write("walls/wall.gltf", gltf.to_string());
            let walls = "[[walls]]\nshape = \"mesh\"\nfile = \"walls/wall.gltf\"\nalbedo = 0.5\n";
            bench.write("s.toml", format!("volume = \"sphere:12\"\n\n{walls}"));
            bench.refuses("bake s.toml --rays 4 --layers 1 -o s.isolume")
        };
        // It would be read until the memory ends.
        let said = scene("/dev/zero");
        assert!(said.contains("/dev/zero") && said.contains("--allow-outside"), "{said}");
        let said = scene("../secret.bin");
        assert!(said.contains("../secret.bin") && said.contains("--allow-outside"), "{said}");
        std::os::unix::fs::symlink("/dev/zero", bench.path("walls/zero.bin")).expect("a link");
        let said = scene("zero.bin");
        assert!(said.contains("a link to /dev/zero"), "{said}");
    }

    /// The most memory of the program, in kilobytes, as it says itself.
    fn most_memory(command: &mut Command) -> u64 {
        let child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("a start");
        let path = format!("/proc/{}/status", child.id());
        let (mut child, mut most) = (child, 0);
        loop {
            let status = std::fs::read_to_string(&path).unwrap_or_default();
            let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or_default();
            most = most.max(line.split_whitespace().next().and_then(|n| n.parse().ok()).unwrap_or(0));
            if child.try_wait().expect("a child").is_some() {
                return most;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    #[test]
    fn profiles_and_texts_of_a_picture_are_not_inflated() {
        let bench = Bench::new();
        let bomb = deflated(&vec![0; 256 << 20]);
        let text = |name: &[u8]| [name, &bomb].concat();
        bench.write("bomb.png", png(&[(b"iCCP", text(b"a\0\0")), (b"zTXt", text(b"b\0\0"))]));
        let most = most_memory(&mut bench.process("env check bomb.png"));
        assert!(most > 0 && most < 100_000, "{most} kB; inflated they are 256 MiB each");
    }

    #[test]
    fn a_limit_on_addresses_is_named_before_memory_ends() {
        let bench = Bench::new();
        let line =
            "ulimit -v 200000; exec \"$0\" bake bumpbox:256 --rays 4 --layers 4 --bands 5 --threads 1 -o u.isolume";
        let done = bench.here("bash").args(["-c", line]).arg(isolume()).output();
        let done = done.expect("a run");
        let said = String::from_utf8_lossy(&done.stderr).into_owned();
        assert_eq!(done.status.code(), Some(1), "{said}");
        let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(said.contains("needs") && said.contains("RLIMIT_AS, ulimit -v, is 204.8 MB"), "{said}");
        assert!(bench.names().is_empty());
    }

    #[test]
    fn relights_of_one_volume_at_once_share_its_bake() {
        let bench = Bench::new();
        let line = |i: usize| {
            format!(
                "relight bumpbox:40 -i 47 -e sunset --rays 256 --layers 2 --cache c --no-draft --threads 1 -o {i}.ply"
            )
        };
        let start = |i| bench.process(&line(i)).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("a start");
        let children: Vec<_> = (0..3).map(start).collect();
        let mut notes = String::new();
        for child in children {
            let done = child.wait_with_output().expect("an end");
            notes.push_str(&String::from_utf8_lossy(&done.stderr));
            assert!(done.status.success(), "{notes}");
        }
        assert!(notes.contains("waiting for process") || notes.contains("found in"), "{notes}");
        assert_eq!(notes.matches("baked into").count(), 1, "{notes}");
        assert!(bench.bytes("0.ply") == bench.bytes("1.ply") && bench.bytes("1.ply") == bench.bytes("2.ply"));
    }
}

#[test]
fn failures_are_json_for_machines() {
    let bench = Bench::new();
    let error = |line: &str, expected: i32| {
        let (code, out, said) = bench.outcome(line);
        assert_eq!(code, expected, "{said}");
        let found: Value = serde_json::from_str(&out).expect("one JSON document");
        assert!(said.starts_with("error: "), "{said}");
        found["error"].clone()
    };
    let missing = error("info nothere.nii --json", 1);
    assert_eq!((&missing["kind"], &missing["given"]), (&Value::from("argument"), &Value::from("nothere.nii")));
    assert!(missing["message"].as_str().is_some_and(|m| m.contains("nothere.nii")));
    assert_eq!(error("bake bumpbox:12 --json", 2)["kind"], "usage");
    assert_eq!(error("bake bumpbox:12 --bogus --json", 2)["name"], "--bogus");
    bench.write("b.png", "\u{89}PNG");
    assert_eq!(error("env check b.png --json", 1)["kind"], "format");
    // Without --json there is nothing on standard output.
    let (code, out, _) = bench.outcome("info nothere.nii");
    assert_eq!((code, out.as_str()), (1, ""));
}

#[test]
fn an_output_that_is_an_input_is_refused_and_kept() {
    let bench = Bench::new();
    let image = png(&[]);
    let relight = "relight bumpbox:12 -i 47 --rays 4 --layers 1 --cache c";
    bench.run("bake bumpbox:12 --rays 4 --layers 1 -o s.isolume -q");
    bench.write("e.png", &image);
    std::fs::hard_link(bench.path("e.png"), bench.path("linked.png")).expect("a link");
    bench.write("x.ply", "data");
    for line in [
        format!("{relight} -e e.png -o e.png"),
        format!("{relight} -e e.png -o linked.png"),
        format!("{relight} -e e.png -o ./e.png -o other.ply"),
        "relight s.isolume -i 47 -e linked.png -o e.png".into(),
        "relight x.ply -i 47 -e sunset -o x.ply".into(),
        "compare s.isolume -i 47 -e e.png --png e.png".into(),
        "view s.isolume --html e.html -e e.html".into(),
    ] {
        if line.contains("e.html") {
            bench.write("e.html", &image);
        }
        let said = bench.refuses(&line);
        assert!(said.contains("which is the input"), "{line}: {said}");
    }
    bench.write("e.hdr", &image);
    assert!(bench.refuses("env rotate e.hdr -o e.hdr").contains("which is the input"));
    assert!(bench.bytes("e.png") == image && bench.bytes("linked.png") == image && bench.bytes("x.ply") == b"data");
    // A file of the store that is lit, by a pattern.
    std::fs::write(bench.path("s.isolume/47.png"), "x").expect("a file");
    assert!(bench.refuses("relight s.isolume -i 47 -e sunset -o s.isolume/{isovalue}.png").contains("the input"));
}

#[test]
fn the_cache_is_listed_limited_and_cleared() {
    let bench = Bench::new();
    let relight = |volume: &str| {
        bench.outcome(&format!("relight {volume} -i auto -e constant --rays 4 --layers 1 --cache c -o o.ply"))
    };
    let stores = || bench.json("cache list --cache c")["stores"].as_array().expect("a list").clone();
    let held = |name: &str| stores().iter().any(|store| store["path"].as_str().is_some_and(|p| p.contains(name)));
    assert_eq!(bench.json("cache --cache c")["stores"], serde_json::json!([]));
    assert_eq!(bench.json("cache limit --cache c")["limit"], 10_000_000_000u64);
    let (code, _, notes) = relight("sphere:16");
    assert!(code == 0 && notes.contains("MB; the cache holds"), "{notes}");
    let format = isolume::transfer::store::FORMAT_VERSION;
    let path = stores()[0]["path"].as_str().expect("a path").to_string();
    assert!(path.starts_with(&format!("c/stores-v{format}/sphere-")), "{path}");
    let bytes = stores()[0]["bytes"].as_u64().expect("bytes");
    assert!(bytes > 10_000, "{bytes}");
    // Room for one: the store whose use is longest ago goes, of an older format first.
    std::fs::create_dir_all(bench.path("c/stores-v1/old.isolume")).expect("a folder");
    std::fs::write(bench.path("c/stores-v1/old.isolume/x"), vec![0; 1000]).expect("a file");
    bench.run(&format!("cache limit {} --cache c", bytes + bytes / 2));
    assert!(held("old.isolume") && held("sphere-"));
    let (code, _, notes) = relight("torus:16");
    assert!(code == 0 && notes.contains("left the cache"), "{notes}");
    assert!(held("torus-") && !held("sphere-") && !held("old.isolume"), "{:?}", stores());
    assert!(bench.refuses("cache clear tors --cache c").contains("a store in the cache"));
    assert_eq!(bench.json("cache clear --cache c")["removed"].as_array().map(Vec::len), Some(1));
    assert!(stores().is_empty());
    assert_eq!(bench.json("cache limit none --cache c")["limit"], Value::Null);
    bench.write("c/limit", "much");
    assert!(bench.refuses("cache --cache c").contains("cache limit 10GB"));
    // A folder that cannot be made: the option that helps is named.
    bench.write("file", "");
    let said = bench.refuses("relight sphere:16 -i auto -e constant --rays 4 --layers 1 --cache file -o o.ply");
    assert!(said.contains("--cache DIR"), "{said}");
}

#[test]
fn completions_and_manual_pages_know_every_command() {
    let bench = Bench::new();
    let commands = ["demo", "info", "bake", "relight", "view", "export", "env", "cache", "completions", "man"];
    for shell in ["bash", "zsh", "fish", "powershell", "elvish"] {
        let text = bench.run(&format!("completions {shell}"));
        assert!(commands.iter().all(|command| text.contains(command)) && text.contains("isolume"), "{shell}");
    }
    let written = bench.json("man -o pages");
    let files: Vec<&str> = written["files"].as_array().expect("files").iter().filter_map(Value::as_str).collect();
    for command in commands {
        assert!(files.contains(&format!("pages/isolume-{command}.1").as_str()), "{files:?}");
    }
    assert!(files.contains(&"pages/isolume.1") && files.contains(&"pages/isolume-env-show.1"), "{files:?}");
    let page = String::from_utf8(bench.bytes("pages/isolume-bake.1")).expect("text");
    assert!(page.contains(".TH") && page.contains("\\-\\-rays") && page.contains("isolume bake"), "{page}");
    assert_eq!(bench.run("man bake"), page);
    assert_eq!(bench.run("man env show"), String::from_utf8(bench.bytes("pages/isolume-env-show.1")).expect("text"));
    assert!(bench.refuses("man nothing").contains("relight"));
}

#[test]
fn a_page_is_made_of_a_volume_through_the_cache() {
    let bench = Bench::new();
    let line = "view sphere:16 --rays 4 --layers 1 --cache c --html v.html";
    let (code, _, notes) = bench.outcome(line);
    assert!(code == 0 && notes.contains("baked into"), "{notes}");
    let first = bench.bytes("v.html");
    let (code, _, notes) = bench.outcome(line);
    assert!(code == 0 && notes.contains("found in"), "{notes}");
    assert!(first == bench.bytes("v.html") && first.starts_with(b"<!doctype html>"));
    assert!(bench.refuses("view nothere.isolume").contains("isolume bake"));
    bench.write("s.toml", "volume = \"sphere:12\"\n");
    bench.run("view s.toml --rays 4 --layers 1 --cache c --html w.html");
    assert!(bench.bytes("w.html").starts_with(b"<!doctype html>"));
}
