//! The live page, exports for other programs and stills, from outside: what is written, what the server answers, what
//! is refused. The page itself is tested in a browser (`tests/browser/`), exports by other readers (`tests/readers/`).

#[allow(dead_code, reason = "each test uses what it needs")]
#[path = "common/program.rs"]
mod program;

use program::Bench;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};

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

/// Status line, and body.
fn ask(address: &str, request: &str, body: &[u8]) -> (String, Vec<u8>) {
    let mut stream = TcpStream::connect(address).expect("a connection");
    write!(stream, "{request}\r\nConnection: close\r\nContent-Length: {}\r\n\r\n", body.len()).expect("a request");
    stream.write_all(body).expect("a body");
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).expect("an answer");
    let end = answer.windows(4).position(|w| w == b"\r\n\r\n").expect("a header") + 4;
    let status = String::from_utf8_lossy(&answer[..end]).lines().next().expect("a status").to_string();
    (status, answer[end..].to_vec())
}

#[test]
fn the_server_answers_this_machine_only() {
    let bench = baked();
    let mut child = Command::new(assert_cmd::cargo::cargo_bin("isolume"))
        .args(["view", "b.isolume", "-q"])
        .current_dir(bench.folder.path())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut line = String::new();
    BufReader::new(child.stdout.take().expect("its output")).read_line(&mut line).expect("a line");
    let _served = Served(child);
    let address = line.split("http://").nth(1).and_then(|l| l.split('/').next()).expect("an address").to_string();
    assert!(address.starts_with("127.0.0.1:"), "{line}");

    let host = format!("Host: {address}");
    let (status, page) = ask(&address, &format!("GET / HTTP/1.1\r\n{host}"), b"");
    assert!(status.contains("200") && page.starts_with(b"<!doctype html>"), "{status}");
    let (_, header) = ask(&address, &format!("GET /header.json HTTP/1.1\r\n{host}"), b"");
    let header: serde_json::Value = serde_json::from_slice(&header).expect("JSON");
    assert_eq!(header["texture"]["texels"], serde_json::json!([16, 16, 16]));
    assert_eq!(header["probes"].as_array().map(Vec::len), Some(3));
    let (_, payload) = ask(&address, &format!("GET /payload.bin HTTP/1.1\r\n{host}"), b"");
    for (name, place) in header["sections"].as_object().expect("sections") {
        let end = place[0].as_u64().unwrap() + place[1].as_u64().unwrap();
        assert!(end <= payload.len() as u64, "{name}");
    }
    // A page elsewhere whose name was made to point here may not read the data.
    let (status, _) = ask(&address, "GET /payload.bin HTTP/1.1\r\nHost: evil.example:80", b"");
    assert!(status.contains("403"), "{status}");
    let (status, _) = ask(&address, &format!("GET /etc/passwd HTTP/1.1\r\n{host}"), b"");
    assert!(status.contains("404"), "{status}");
    // Environments that the page cannot decode.
    let exr = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/probes/light/studio.exr")).expect("a probe");
    let (status, pixels) = ask(&address, &format!("POST /probe?name=x HTTP/1.1\r\n{host}"), &exr);
    assert!(status.contains("200") && pixels.len().is_multiple_of(12) && !pixels.is_empty(), "{status}");
    let (status, why) = ask(&address, &format!("POST /probe?name=x HTTP/1.1\r\n{host}"), b"no image");
    assert!(status.contains("415") && !why.is_empty(), "{status}");
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
    assert!(bench.refuses("view bumpbox:16").contains("isolume bake"));
    assert!(bench.refuses("view b.isolume --html no/such/page.html").contains("directory"));
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
