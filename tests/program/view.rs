//! The live page, exports for other programs and stills, from outside: what is written, what the server answers, what
//! is refused. The page itself is tested in a browser (`tests/browser/`), exports by other readers (`tests/readers/`).

use crate::common::program::Bench;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Stdio};

fn baked() -> Bench {
    let bench = Bench::new();
    bench.run("bake bumpbox:16 --rays 4 --layers 2 --bands 3,2 -o b.isolume");
    bench
}

/// A server that ends with the test.
struct Served(Child);

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A page that is served: the host with its port, and the path that holds the token.
fn served(bench: &Bench) -> (Served, String, String) {
    served_by(bench, "view b.isolume -q")
}

fn served_by(bench: &Bench, line: &str) -> (Served, String, String) {
    let mut child = bench.process(line).stdout(Stdio::piped()).spawn().expect("the program starts");
    let mut line = String::new();
    BufReader::new(child.stdout.take().expect("its output")).read_line(&mut line).expect("a line");
    let address = line.split("http://").nth(1).and_then(|l| l.split(' ').next()).expect("an address");
    let (host, path) = address.split_once('/').expect("a path");
    assert!(host.starts_with("127.0.0.1:") && path.len() == 33 && path.ends_with('/'), "{line}");
    (Served(child), host.to_string(), format!("/{path}"))
}

/// Status line, and body.
fn ask(address: &str, request: &str, body: &[u8]) -> (String, Vec<u8>) {
    let (status, _, body) = ask_all(address, request, body);
    (status, body)
}

/// Status line, fields, and body.
fn ask_all(address: &str, request: &str, body: &[u8]) -> (String, String, Vec<u8>) {
    let mut stream = TcpStream::connect(address).expect("a connection");
    write!(stream, "{request}\r\nConnection: close\r\nContent-Length: {}\r\n\r\n", body.len()).expect("a request");
    // What is refused may not be read to its end.
    let _ = stream.write_all(body);
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).expect("an answer");
    let end = answer.windows(4).position(|w| w == b"\r\n\r\n").expect("a header") + 4;
    let head = String::from_utf8_lossy(&answer[..end]).into_owned();
    let status = head.lines().next().expect("a status").to_string();
    (status, head, answer[end..].to_vec())
}

#[test]
fn the_server_answers_this_machine_only() {
    let bench = baked();
    let (_served, address, path) = served(&bench);
    let host = format!("Host: {address}");
    let (status, page) = ask(&address, &format!("GET {path} HTTP/1.1\r\n{host}"), b"");
    assert!(status.contains("200") && page.starts_with(b"<!doctype html>"), "{status}");
    let (_, header) = ask(&address, &format!("GET {path}header.json HTTP/1.1\r\n{host}"), b"");
    let header: serde_json::Value = serde_json::from_slice(&header).expect("JSON");
    assert_eq!(header["texture"]["texels"], serde_json::json!([16, 16, 16]));
    assert_eq!(header["probes"].as_array().map(Vec::len), Some(3));
    let (_, payload) = ask(&address, &format!("GET {path}payload.bin HTTP/1.1\r\n{host}"), b"");
    for (name, place) in header["sections"].as_object().expect("sections") {
        let end = place[0].as_u64().unwrap() + place[1].as_u64().unwrap();
        assert!(end <= payload.len() as u64, "{name}");
    }
    // A page elsewhere whose name was made to point here may not read the data.
    let (status, _) = ask(&address, &format!("GET {path}payload.bin HTTP/1.1\r\nHost: evil.example:80"), b"");
    assert!(status.contains("403"), "{status}");
    let (status, _) = ask(&address, &format!("GET {path}etc/passwd HTTP/1.1\r\n{host}"), b"");
    assert!(status.contains("404"), "{status}");
    // Environments that the page cannot decode.
    let exr = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/probes/light/studio.exr")).expect("a probe");
    let (status, pixels) = ask(&address, &format!("POST {path}probe?name=x HTTP/1.1\r\n{host}"), &exr);
    assert!(status.contains("200") && pixels.len().is_multiple_of(12) && !pixels.is_empty(), "{status}");
    let (status, why) = ask(&address, &format!("POST {path}probe?name=x HTTP/1.1\r\n{host}"), b"no image");
    assert!(status.contains("415") && !why.is_empty(), "{status}");
}

/// A model that is saved is shown again; while it is broken the page keeps what it shows, and tells why.
#[test]
fn a_watched_model_is_shown_again_when_it_is_saved() {
    const MODEL: &str =
        "[model]\nbounds = [[-1, -1, -1], [1, 1, 1]]\nsamples = 12\n[model.point.p]\ncentre = [0, 0, 0]\nradius = 1\n";
    let bench = Bench::new();
    bench.write("m.toml", MODEL);
    let (mut served, address, path) = served_by(&bench, "view m.toml --watch --layers 1 --rays 4 --cache c -q");
    let get = |name: &str| ask(&address, &format!("GET {path}{name} HTTP/1.1\r\nHost: {address}"), b"").1;
    let json = |name: &str| -> serde_json::Value { serde_json::from_slice(&get(name)).expect("JSON") };
    // As long as it takes: the bake of a model of 12³ samples.
    let mut until = |is_so: &dyn Fn(&serde_json::Value) -> bool| loop {
        let state = json("watched.json");
        if is_so(&state) {
            return state;
        }
        assert!(served.0.try_wait().expect("its state").is_none(), "the program ended");
        std::thread::sleep(std::time::Duration::from_millis(50));
    };
    until(&|state| state["revision"] == 0);
    let first = json("header.json");
    assert_eq!(first["watched"], 0);
    bench.write("m.toml", MODEL.replace("radius = 1", "radius = 0.7\nweight = 2"));
    until(&|state| state["revision"] == 1);
    let second = json("header.json");
    assert_eq!(second["watched"], 1);
    assert!(second["volume"]["range"][1].as_f64() > first["volume"]["range"][1].as_f64(), "{second}");
    let payload = get("payload.bin");
    bench.write("m.toml", MODEL.replace("radius = 1", "radios = 1"));
    let state = until(&|state| !state["message"].is_null());
    let message = state["message"].as_str().expect("a message");
    assert!(message.contains("m.toml:6") && message.contains("radius"), "{message}");
    assert!(state["revision"] == 1 && get("payload.bin") == payload && json("header.json") == second);
    bench.write("m.toml", MODEL);
    let state = until(&|state| state["revision"] == 2);
    assert!(state["message"].is_null(), "{state}");
    assert_eq!(json("header.json")["volume"], first["volume"]);
    // What is not watched is asked for nothing, and what is no text of ours cannot be watched.
    assert!(bench.refuses("view bumpbox:8 --watch").contains("model.toml"));
}

/// What the file says of the bake holds as it stands now, not as it stood when the program began.
#[test]
fn a_watched_scene_is_baked_as_it_says_now() {
    let text = |layers: u32| {
        format!(
            "[bake]\nrays = 4\nlayers = {layers}\n[model]\nbounds = [[-1, -1, -1], [1, 1, 1]]\nsamples = 12\n\
             [model.point.p]\ncentre = [0, 0, 0]\nradius = 1\n"
        )
    };
    let bench = Bench::new();
    bench.write("m.toml", text(1));
    let (mut served, address, path) = served_by(&bench, "view m.toml --watch --cache c -q");
    let json = |name: &str| -> serde_json::Value {
        let body = ask(&address, &format!("GET {path}{name} HTTP/1.1\r\nHost: {address}"), b"").1;
        serde_json::from_slice(&body).expect("JSON")
    };
    let layers = || json("header.json")["texture"]["bands"].as_array().map(Vec::len);
    assert_eq!(layers(), Some(1));
    bench.write("m.toml", text(3));
    while json("watched.json")["revision"] != 1 {
        assert!(json("watched.json")["message"].is_null() && served.0.try_wait().expect("its state").is_none());
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    assert_eq!(layers(), Some(3));
}

/// A volume that takes long is shown as a draft. What ends its bake is told on the page, which stays; after Ctrl-C the next
/// run begins with what is there.
#[test]
#[cfg(unix)]
fn a_draft_is_shown_while_the_volume_is_baked() {
    let bench = Bench::new();
    // Minutes, of which only the drafts are waited for.
    const LINE: &str = "view gyroid:40 --rays 65536 --layers 2 --cache c -q";
    let json = |address: &str, path: &str| -> serde_json::Value {
        serde_json::from_slice(&ask(address, &format!("GET {path} HTTP/1.1\r\nHost: {address}"), b"").1).expect("JSON")
    };
    let (mut first, address, path) = served_by(&bench, LINE);
    let header = json(&address, &format!("{path}header.json"));
    assert!(header["draft"] == true && header["watched"].is_u64(), "{}", header["about"]);
    // Half the resolution, then all of it, then the bake of what is asked.
    let mut until = |is_so: &dyn Fn(&serde_json::Value) -> bool| loop {
        let state = json(&address, &format!("{path}watched.json"));
        if is_so(&state) {
            return state;
        }
        assert!(first.0.try_wait().expect("its state").is_none(), "the program ended");
        std::thread::sleep(std::time::Duration::from_millis(50));
    };
    until(&|state| state["revision"] == 1 && state["progress"]["all"].as_u64().is_some_and(|all| all > 0));
    let header = json(&address, &format!("{path}header.json"));
    assert!(header["draft"] == true && header["texture"]["texels"] == serde_json::json!([40, 40, 40]));
    let id = first.0.id().to_string();
    let interrupt = || std::process::Command::new("kill").args(["-INT", &id]).status().expect("kill");
    assert!(interrupt().success());
    std::thread::sleep(std::time::Duration::from_millis(300));
    // A second time, since chunks of so many rays take long.
    interrupt();
    assert_eq!(first.0.wait().expect("an end").code(), Some(130));
    let (mut second, address, path) = served_by(&bench, LINE);
    let header = json(&address, &format!("{path}header.json"));
    assert!(header["draft"] == true && header["watched"] == 0, "{}", header["about"]);
    assert_eq!(header["texture"]["texels"], serde_json::json!([40, 40, 40]), "the draft that was there");
    let id = second.0.id().to_string();
    assert!(std::process::Command::new("kill").args(["-KILL", &id]).status().expect("kill").success());
    let _ = second.0.wait();
    // What goes wrong behind the draft is told, and the draft stays.
    let (mut third, address, path) = served_by(&bench, &LINE.replace("65536", "256"));
    assert_eq!(json(&address, &format!("{path}header.json"))["draft"], true);
    std::fs::remove_dir_all(bench.path("c/stores-v3")).expect("a cache that can go");
    let state = loop {
        let state = json(&address, &format!("{path}watched.json"));
        if !state["message"].is_null() || state["revision"] != 0 {
            break state;
        }
        assert!(third.0.try_wait().expect("its state").is_none(), "the program ended");
        std::thread::sleep(std::time::Duration::from_millis(50));
    };
    assert!(state["message"].is_string() && state["progress"].is_null() && state["revision"] == 0, "{state}");
    assert!(json(&address, &format!("{path}header.json"))["draft"] == true);
}

#[test]
fn only_who_has_the_address_may_ask() {
    let bench = baked();
    let (_served, address, path) = served(&bench);
    let status = |request: &str, more: &str, body: &[u8]| {
        let (status, _) = ask(&address, &format!("{request} HTTP/1.1\r\n{more}"), body);
        status.split(' ').nth(1).expect("a code").parse::<u32>().expect("a number")
    };
    let host = format!("Host: {address}");
    let exr = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/probes/light/studio.exr")).expect("a probe");
    let (get, post) = (format!("GET {path}header.json"), format!("POST {path}probe?name=x"));
    // No token, another one, and a part of it.
    for wrong in ["/", "/header.json", "/0123456789abcdef0123456789abcdef/header.json", &path[..16]] {
        assert_eq!(status(&format!("GET {wrong}"), &host, b""), 403, "{wrong}");
    }
    // Names in any case; an origin that is the page's own, or none.
    let port = address.rsplit(':').next().expect("a port");
    assert_eq!(status(&get, &format!("Host: LocalHost:{port}"), b""), 200);
    assert_eq!(status(&get, "Accept: */*", b""), 403, "no host");
    assert_eq!(status(&post, &format!("{host}\r\nOrigin: http://{address}"), &exr), 200);
    for origin in ["http://example.org", "null", "https://127.0.0.1", "http://127.0.0.1:1"] {
        assert_eq!(status(&post, &format!("{host}\r\nOrigin: {origin}"), &exr), 403, "{origin}");
        assert_eq!(status(&get, &format!("{host}\r\nOrigin: {origin}"), b""), 403, "{origin}");
    }
    for (request, expected) in [("PUT", 405), ("DELETE", 405), ("OPTIONS", 405), ("POST", 405)] {
        assert_eq!(status(&format!("{request} {path}"), &host, b""), expected, "{request}");
    }
    // HEAD is GET without the body, and says as much as GET of how the page may be used.
    let (_, get_fields, page) = ask_all(&address, &format!("GET {path} HTTP/1.1\r\n{host}"), b"");
    let (_, head_fields, nothing) = ask_all(&address, &format!("HEAD {path} HTTP/1.1\r\n{host}"), b"");
    assert!(nothing.is_empty() && get_fields == head_fields);
    assert!(get_fields.contains(&format!("Content-Length: {}", page.len())));
    for field in ["X-Content-Type-Options: nosniff", "frame-ancestors 'none'", "default-src 'none'", "no-referrer"] {
        assert!(get_fields.contains(field), "{get_fields}");
    }
    // The script of the page is the one that the policy allows.
    let nonce = get_fields.split("'nonce-").nth(1).and_then(|n| n.split('\'').next()).expect("a nonce");
    assert!(String::from_utf8_lossy(&page).contains(&format!("<script type=\"module\" nonce=\"{nonce}\">")));
}

#[test]
fn a_slow_or_greedy_client_keeps_nobody_waiting() {
    use std::time::{Duration, Instant};
    let bench = baked();
    let (_served, address, path) = served(&bench);
    let host = format!("Host: {address}");
    let connect = || TcpStream::connect(&address).expect("a connection");
    let mut stalled = connect();
    write!(stalled, "POST {path}probe HTTP/1.1\r\n{host}\r\nContent-Length: 1000000\r\n\r\nabc").expect("a request");
    let get = || ask(&address, &format!("GET {path}header.json HTTP/1.1\r\n{host}"), b"").0;
    let start = Instant::now();
    assert!(get().contains("200"));
    // The stalled one is given up after 10 s.
    assert!(start.elapsed() < Duration::from_secs(8), "{:?}", start.elapsed());
    let (status, _) = ask(&address, &format!("GET {path} HTTP/1.1\r\n{host}\r\nA: {}", "a".repeat(20_000)), b"");
    assert!(status.contains("431"), "{status}");
    let large = format!("POST {path}probe HTTP/1.1\r\n{host}\r\nContent-Length: 70000000\r\n\r\n");
    let mut refused = connect();
    refused.write_all(large.as_bytes()).expect("a request");
    let mut answer = String::new();
    refused.read_to_string(&mut answer).expect("an answer");
    assert!(answer.starts_with("HTTP/1.1 413"), "{answer}");
    // More connections than are served: turned away, not queued; when they fall silent there is room again.
    let idle: Vec<TcpStream> = (0..40).map(|_| connect()).collect();
    let mut statuses = Vec::new();
    let start = Instant::now();
    while start.elapsed() < Duration::from_secs(60) {
        match TcpStream::connect(&address).and_then(|mut stream| {
            write!(stream, "GET {path}header.json HTTP/1.1\r\n{host}\r\n\r\n")?;
            let mut answer = Vec::new();
            stream.read_to_end(&mut answer).map(|_| answer)
        }) {
            Ok(answer) => statuses.push(String::from_utf8_lossy(&answer[..12.min(answer.len())]).into_owned()),
            // Turned away while it wrote.
            Err(_) => statuses.push("HTTP/1.1 503".into()),
        }
        if statuses.last().is_some_and(|s| s == "HTTP/1.1 200") {
            break;
        }
        std::thread::sleep(Duration::from_millis(200));
    }
    drop(idle);
    assert_eq!(statuses.first().map(String::as_str), Some("HTTP/1.1 503"));
    assert_eq!(statuses.last().map(String::as_str), Some("HTTP/1.1 200"));
    let mut answer = String::new();
    stalled.read_to_string(&mut answer).expect("an answer");
    assert!(answer.starts_with("HTTP/1.1 408"), "{answer}");
}

#[test]
fn one_file_states_its_size_and_is_reduced() {
    let bench = baked();
    let whole = bench.json("view b.isolume --html whole.html");
    assert_eq!(whole["bytes"].as_u64(), Some(bench.bytes("whole.html").len() as u64));
    let small = bench.json("view b.isolume --html small.html --texture-side 9 --volume-side 12 --env overcast");
    assert_eq!((small["texels"][0].as_u64(), small["samples"][0].as_u64()), (Some(9), Some(12)));
    assert!(small["valid_texels"].as_u64() < whole["valid_texels"].as_u64());
    let (code, _, notes) = bench.outcome("view b.isolume --html small.html --texture-side 9");
    assert!(code == 0 && notes.contains("9 × 9 × 9 (of 16 × 16 × 16)") && notes.contains("will be"), "{notes}");
    assert!(bench.refuses("view nothere.isolume").contains("isolume bake"));
    assert!(bench.refuses("view b.isolume --html no/such/page.html").contains("directory"));
}

/// The header in a page in one file.
fn header(bench: &Bench, name: &str) -> serde_json::Value {
    let page = String::from_utf8(bench.bytes(name)).expect("text");
    let header = page.split("id=\"header\">").nth(1).and_then(|rest| rest.split("</script>").next());
    serde_json::from_str(header.expect("a header")).expect("JSON")
}

fn example(name: &str) -> String {
    format!("{}/examples/scenes/{name}.toml", env!("CARGO_MANIFEST_DIR"))
}

const SMALL: &str = "--rays 4 --texture 0.25 --cache cache";

#[test]
fn a_scene_is_baked_as_relight_does_and_shown() {
    let bench = Bench::new();
    let scene = example("box");
    let (code, _, notes) = bench.outcome(&format!("view {scene} {SMALL} --html box.html"));
    assert!(code == 0 && notes.contains("baked into"), "{notes}");
    let shown = header(&bench, "box.html");
    assert_eq!(shown["isovalues"], serde_json::json!([10.0, 47.0, 100.0, 150.0]));
    assert_eq!(shown["texture"]["bands"], serde_json::json!([1, 1, 1, 1]));
    assert_eq!(shown["scene"]["luminaires"][0]["name"], "ceiling");
    // Luminaires are light enough: the first environment is dark, the others can be chosen.
    let probes = shown["probes"].as_array().expect("probes");
    assert!(probes[0]["coefficients"].as_array().is_some_and(|all| all.iter().all(|v| v == 0.0)));
    assert_eq!(probes.len(), 4, "and those of the program");
    // One store for both commands, and one noise: that of the contraction.
    let (code, _, notes) = bench.outcome(&format!("relight {scene} {SMALL} --size 40x30"));
    assert!(code == 0 && notes.contains("found in"), "{notes}");
    let stores = std::fs::read_dir(bench.path("cache/stores-v3")).expect("a cache").flatten();
    let stores: Vec<_> = stores.map(|e| e.path()).filter(|p| p.extension().is_some_and(|e| e == "isolume")).collect();
    assert_eq!(stores.len(), 1, "{stores:?}");
    let exported = bench.json(&format!("export {} --env constant:0 -o box.vti", stores[0].display()));
    let [page, contraction] =
        [&probes[0]["relative_error"], &exported["record"]["noise_over_mean"]].map(|v| v.as_f64().expect("a number"));
    // The same sum, whose text may be rounded.
    assert!((page - contraction).abs() <= 1e-9 * contraction && page > 0.0, "{page} {contraction}");
    // An isovalue to begin with is baked besides.
    bench.run(&format!("view {scene} {SMALL} -i 60 --html sixty.html"));
    let begun = header(&bench, "sixty.html");
    assert!(begun["isovalue"] == 60.0 && begun["isovalues"].as_array().is_some_and(|all| all.contains(&60.0.into())));
}

#[test]
fn one_of_several_volumes_is_shown() {
    let bench = Bench::new();
    let scene = example("pair");
    bench.run(&format!("view {scene} {SMALL} --volume gyroid --html gyroid.html"));
    let shown = header(&bench, "gyroid.html");
    assert_eq!(
        (&shown["scene"]["volume"], &shown["scene"]["partners"][0]["name"]),
        (&"gyroid".into(), &"bumps".into())
    );
    assert_eq!(shown["scene"]["partners"][0]["isovalues"], serde_json::json!([[0.6, 47.0]]));
    assert_eq!((&shown["scene"]["rotation"], &shown["probes"][0]["name"]), (&(-90.0).into(), &"sky".into()));
    bench.run(&format!("bake {scene} --rays 4 --texture 0.25 -o pair.isolume"));
    let (code, _, notes) = bench.outcome("view pair.isolume --html first.html");
    assert!(code == 0 && notes.contains("bumps, the first volume") && notes.contains("--volume NAME"), "{notes}");
    assert_eq!(header(&bench, "first.html")["scene"]["volume"], "bumps");
    assert!(bench.refuses("view pair.isolume --volume nobody --html p.html").contains("bumps, gyroid"));
    assert!(bench.refuses(&format!("view {scene} {SMALL} --volume giroid")).contains("did you mean gyroid?"));
}

#[test]
fn what_makes_no_sense_for_a_scene_is_refused_before_the_bake() {
    let bench = Bench::new();
    let scene = example("box");
    assert!(bench.refuses(&format!("view {scene} {SMALL} --volume gyroid")).contains("one volume alone"));
    assert!(bench.refuses(&format!("view {scene} {SMALL} --html {scene}")).contains("which is the input"));
    assert!(bench.refuses("view nothere.toml").contains("nothere.toml"));
    assert!(bench.refuses(&format!("view {scene} {SMALL} --env nowhere.hdr")).contains("nowhere.hdr"));
    bench.run("bake bumpbox:8 --rays 4 -o b.isolume");
    assert!(bench.refuses("view b.isolume --all-isovalues").contains("--all-isovalues"));
}

#[test]
fn exports_are_refused_with_a_reason() {
    let bench = baked();
    let done = bench.json("export b.isolume --env constant -o b.vti");
    assert!(done["valid"].as_u64().is_some_and(|n| n > 0));
    bench.run("export b.isolume --env constant -o b.raw");
    let header = String::from_utf8(bench.bytes("b.nhdr")).expect("text");
    assert!(header.starts_with("NRRD0005\n") && header.contains("data file: b.raw"), "{header}");
    assert_eq!(bench.bytes("b.raw").len(), 16 * 16 * 16 * 16);
    assert!(bench.refuses("export b.isolume --env constant -o b.tif").contains(".vti, .nrrd or .raw"));
    assert!(bench.refuses("export b.isolume --env constant --colormap magma -o b.vti").contains("--colormap"));
    assert!(bench.refuses("export b.isolume --env constant --sun-split -o b.vti").contains("--sun-split"));
}

#[test]
fn a_turntable_turns_the_view_or_the_light() {
    let bench = baked();
    let relight = "relight b.isolume -i auto -e sun:0,30 --size 32x24 --view front";
    bench.run(&format!("{relight} --turntable 4 -o turn/"));
    let names: Vec<_> = std::fs::read_dir(bench.path("turn")).expect("a folder").collect();
    assert_eq!(names.len(), 4);
    bench.run(&format!("{relight} --turntable 4 --turn light -o light-{{frame}}.png"));
    // The sun goes from the right to the back, to the left, to the front: pictures 0 and 2 are brighter on other sides.
    let side = |frame: usize| {
        let image = image::open(bench.path(&format!("light-{frame}.png"))).expect("a picture").to_luma8();
        let half = |from: u32| (from..from + 16).flat_map(|x| (0..24).map(move |y| (x, y)));
        let sum = |from| half(from).map(|(x, y)| i64::from(image.get_pixel(x, y)[0])).sum::<i64>();
        sum(16) - sum(0)
    };
    assert!(side(0) > 500 && side(2) < -500, "{} {}", side(0), side(2));
    assert!(bench.refuses(&format!("{relight} --turntable 4 -o one.png")).contains("{frame}"));
    assert!(bench.refuses(&format!("{relight} --perspective --scale-bar -o one.png")).contains("--perspective"));
}

#[test]
fn a_relightable_file_names_its_coefficients() {
    let bench = baked();
    bench.run("relight b.isolume -i auto -e studio --transfer -o b.glb");
    let bytes = bench.bytes("b.glb");
    let file = gltf::Glb::from_slice(&bytes).expect("a GLB");
    let json: serde_json::Value = serde_json::from_slice(&file.json).expect("JSON");
    let attributes = json["meshes"][0]["primitives"][0]["attributes"].as_object().expect("attributes");
    let carried: Vec<_> = attributes.keys().filter(|k| k.contains("_SH_DEGREE_")).collect();
    assert_eq!(carried.len(), 9 + 4, "{carried:?}");
    assert!(attributes.contains_key("_T1_SH_DEGREE_1_COEF_2"));
    let extras = &json["meshes"][0]["extras"]["isolume_transfer"];
    assert_eq!(extras["bands"], serde_json::json!([3, 2]));
    assert_eq!(extras["light"]["coefficients_in_world"].as_array().map(Vec::len), Some(9));
}
