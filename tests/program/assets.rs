//! Files for the web and for engines: levels of detail, compression, lightmaps.

use crate::common::program::Bench;
use serde_json::Value;

fn bench() -> Bench {
    let bench = Bench::new();
    bench.run("bake gyroid:24 --rays 8 --layers 2 --bands 3 -o g.isolume");
    bench
}

fn size(bench: &Bench, name: &str) -> u64 {
    std::fs::metadata(bench.path(name)).unwrap_or_else(|e| panic!("{name}: {e}")).len()
}

/// The JSON of a GLB.
fn json_of(bench: &Bench, name: &str) -> Value {
    let bytes = std::fs::read(bench.path(name)).expect("the file");
    let length = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
    serde_json::from_slice(&bytes[20..20 + length]).expect("JSON")
}

#[test]
fn levels_of_detail_have_files_of_their_own_and_say_how_far_they_are_off() {
    let bench = bench();
    let whole = bench.json("relight g.isolume -i 0 -e sky -o whole.glb");
    let all = whole["files"][0]["mesh"]["triangles"].as_u64().expect("triangles");
    assert!(whole["files"][0]["mesh"]["simplified"].is_null());
    let lit =
        bench.json("relight g.isolume -i 0 -e sky --lod 60%,30% -o g-{lod}.glb -o g-{lod}.ply -o g.png --size 40x30");
    let files = lit["files"].as_array().expect("files");
    assert_eq!(files.len(), 5);
    let mut before = 0.0;
    for (number, name) in [(0, "g-60pct.glb"), (1, "g-30pct.glb")] {
        let mesh = &files[number]["mesh"];
        assert!(files[number]["path"].as_str().is_some_and(|path| path.ends_with(name)), "{lit}");
        let (triangles, error) = (mesh["triangles"].as_u64().expect("triangles"), &mesh["simplified"]);
        let share = triangles as f64 / all as f64;
        assert!((0.25..0.65).contains(&share), "{share} in {name}");
        let largest = error["largest_distance"].as_f64().expect("a distance");
        assert!(largest > before && largest < 0.1, "{largest} in {name}");
        before = largest;
        let record = &json_of(&bench, name)["asset"]["extras"]["simplified"];
        assert_eq!(
            (record["largest_distance"].as_f64(), record["triangles_of_isosurface"].as_u64()),
            (Some(largest), Some(all))
        );
        assert!(size(&bench, name) < size(&bench, "whole.glb"));
    }
    let text = bench.run("relight g.isolume -i 0 -e sky --lod 500 -o few.stl");
    assert!(text.contains(&format!("of {} triangles: at most", isolume_count(all))), "{text}");
}

/// As the program writes counts.
fn isolume_count(n: u64) -> String {
    if n < 1000 { n.to_string() } else { format!("{},{:03}", n / 1000, n % 1000) }
}

#[test]
fn files_for_the_web_are_small_and_name_what_reads_them() {
    let bench = bench();
    bench.run("relight g.isolume -i 0 -e sky -o plain.glb");
    for threads in [1, 2] {
        let line = format!("relight g.isolume -i 0 -e sky --for web --threads {threads} -o web{threads}.glb");
        let lit = bench.json(&line);
        assert!(
            lit["files"][0]["mesh"]["largest_position_error"].as_f64().is_some_and(|e| e > 0.0 && e < 1e-4),
            "{lit}"
        );
    }
    assert_eq!(std::fs::read(bench.path("web1.glb")).ok(), std::fs::read(bench.path("web2.glb")).ok());
    // Of a small file the JSON is much.
    assert!(size(&bench, "web1.glb") * 3 < size(&bench, "plain.glb"));
    let required = json_of(&bench, "web1.glb")["extensionsRequired"].clone();
    assert_eq!(required, serde_json::json!(["KHR_mesh_quantization", "EXT_meshopt_compression"]));
    assert!(json_of(&bench, "web1.glb")["nodes"][0]["extras"]["positions"]["largest_error"].is_f64());
    // With transfer the normals stay, and the attributes come along.
    bench.run("relight g.isolume -i 0 -e sky --for web --lod 50% --transfer --radiance -o relightable.glb");
    let attributes = json_of(&bench, "relightable.glb")["meshes"][0]["primitives"][0]["attributes"].clone();
    for name in ["NORMAL", "_RADIANCE", "_STDERR", "_T0_SH_DEGREE_0_COEF_0", "_T1_SH_DEGREE_2_COEF_4"] {
        assert!(attributes.get(name).is_some(), "{name} in {attributes}");
    }
}

#[test]
fn lightmaps_take_the_place_of_colours_at_vertices() {
    let bench = bench();
    for threads in [1, 2] {
        let line = format!(
            "relight g.isolume -i 0 -e sky --lod 50% --lightmap 256 --threads {threads} -o m{threads}.glb -o m{threads}.usdz"
        );
        let lit = bench.json(&line);
        let map = &lit["files"][0]["mesh"]["lightmap"];
        assert!(map["colour_rms_srgb"].as_f64().is_some_and(|rms| rms < 0.05), "{lit}");
        assert_eq!(map["side"], 256);
    }
    for kind in ["glb", "usdz"] {
        let [one, two] = [1, 2].map(|n| std::fs::read(bench.path(&format!("m{n}.{kind}"))).expect("the file"));
        assert_eq!(one, two, "{kind}");
    }
    // Where there is no surface there is nothing to unwrap.
    bench.run("relight g.isolume -i 100 -e sky --allow-empty --lod 50% --for web --lightmap 256 -o none.glb");
    assert!(json_of(&bench, "none.glb").get("meshes").is_none());
    let none = bench.command("relight g.isolume -i 100 -e sky --allow-empty -o none.usdz").assert().failure();
    assert!(String::from_utf8_lossy(&none.get_output().stderr).contains("without triangles"));
    let json = json_of(&bench, "m1.glb");
    let attributes = &json["meshes"][0]["primitives"][0]["attributes"];
    assert!(attributes.get("TEXCOORD_0").is_some() && attributes.get("COLOR_0").is_none(), "{attributes}");
    assert_eq!(json["images"][0]["mimeType"], "image/png");
}

#[test]
fn what_no_file_can_have_is_refused_before_the_bake() {
    let bench = Bench::new();
    let line = "relight gyroid:40 -i 0 -e sky";
    for (options, expected) in [
        ("--lod 0.25 -o a.glb", "such as 25%"),
        ("--lod 0 -o a.glb", "a number of triangles"),
        ("--lod 500,100 -o a.glb", "{lod} in the name for 2 levels"),
        ("-o a-{lod}.glb", "expected --lod with it"),
        ("--lod 500 -o a-{lod}.png -o a.glb", "a name without {lod}"),
        ("--lod 500 -o a.png", "pictures show the isosurface itself"),
        ("--for web -o a.ply", "an output that ends in .glb"),
        ("--for games -o a.glb", "possible values: web"),
        ("--for web --float-color -o a.glb", "colours of 16 bits"),
        ("--lightmap 16 -o a.glb", "64..=8192"),
        ("--lightmap 256 -o a.stl", ".glb or .usdz"),
        ("--lightmap 256 --float-color -o a.glb", "colours in a picture"),
    ] {
        let output = bench.command(&format!("{line} {options}")).assert().failure().get_output().stderr.clone();
        let text = String::from_utf8_lossy(&output).replace("\n  ", " ");
        assert!(text.contains(expected), "{options}: {text}");
    }
}
