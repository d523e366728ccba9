//! Models in TOML through the program: wherever a volume is named, and with the same bytes for any number of threads.

use crate::common::program::Bench;

const MODEL: &str = "[model]\nbounds = [[-1, -1, -1], [1, 1, 1]]\nsamples = 20\nroot = \"s\"\n[model.points.p]\n\
    at = [[-0.3, 0, 0], [0.3, 0.2, 0]]\nradius = 0.7\n[model.twist.t]\nof = \"p\"\nper_unit = 0.5\n[model.union.s]\n\
    of = [\"t\", \"b\"]\nsmooth = true\n[model.box.b]\ncentre = [0, 0, -0.3]\nsize = [0.6, 0.6, 0.1]\nradius = 0.3\n";

/// A PLY without its header, which names the volume.
fn body(bench: &Bench, name: &str) -> Vec<u8> {
    let bytes = bench.bytes(name);
    let end = b"end_header\n";
    let at = bytes.windows(end.len()).position(|w| w == end).expect("a header");
    bytes[at..].to_vec()
}

#[test]
fn models_are_volumes() {
    let bench = Bench::new();
    bench.write("m.toml", MODEL);
    let info = bench.json("info m.toml");
    assert_eq!((info["dims"].to_string().as_str(), info["name"].as_str()), ("[20,20,20]", Some("m")));
    assert_eq!(info["suggested_isovalue"]["value"], 0.5);
    assert!(info["notes"].to_string().contains("isovalue 0.5 alone"), "{info}");
    assert_eq!(bench.json("info m.toml:9x10x11")["dims"].to_string(), "[9,10,11]");
    bench.run("bake m.toml:16 --isovalues auto --rays 4 -o a.isolume --threads 1");
    bench.run("bake m.toml:16 --isovalues auto --rays 4 -o b.isolume --threads 2");
    assert_eq!(bench.json("info a.isolume")["identity"], bench.json("info b.isolume")["identity"]);
    bench.run("relight a.isolume --isovalue 0.5 --env sky -o a.ply");
    bench.run("relight b.isolume --isovalue 0.5 --env sky -o b.ply");
    assert!(body(&bench, "a.ply") == body(&bench, "b.ply"));
    // A scene that is a model is lit as it stands, and as the volume of another scene.
    let scene = "isovalues = [\"auto\"]\noutputs = [\"{isovalue}.ply\"]\n[probe]\nname = \"sky\"\n[bake]\nrays = 4\n";
    bench.write("s.toml", format!("{scene}{MODEL}"));
    bench.run("relight s.toml --cache c");
    bench.write("o.toml", format!("volume = \"m.toml:20\"\n{scene}").replace("{isovalue}", "other"));
    bench.run("relight o.toml --cache c");
    assert!(body(&bench, "0.5.ply") == body(&bench, "other.ply"));
}

#[test]
fn a_model_goes_out_as_stl_and_comes_back_as_its_distance() {
    let bench = Bench::new();
    bench.write(
        "m.toml",
        "[model]\nbounds = [[-1, -1, -1], [1, 1, 1]]\n[model.point.a]\ncentre = [0, 0, 0]\nsurface_radius = 0.5\n",
    );
    bench.run("relight m.toml:24 --isovalue auto --env sky --rays 4 --cache c -o m.stl");
    bench.write(
        "d.toml",
        "[model]\nbounds = [[-1, -1, -1], [1, 1, 1]]\nisovalue = 0\n[model.mesh.a]\nfile = \"m.stl\"\n",
    );
    let range = bench.json("info d.toml:21")["range"].clone();
    // The middle is a radius inside, a corner √3 − ½ outside, up to the facets.
    assert!((range[1].as_f64().unwrap() - 0.5).abs() < 0.02, "{range}");
    assert!((range[0].as_f64().unwrap() + 3f64.sqrt() - 0.5).abs() < 0.02, "{range}");
}

#[test]
fn mistakes_name_their_line() {
    let bench = Bench::new();
    bench.write("m.toml", MODEL);
    bench.write("c.toml", "[model]\nbounds = [[0,0,0],[1,1,1]]\n[model.sum.a]\nof = \"b\"\n[model.sum.b]\nof = \"a\"\n[model.sum.c]\nof = \"a\"\n");
    bench.write("v.toml", format!("volume = \"bumpbox:8\"\n{MODEL}"));
    bench.write("s.toml", "volume = \"bumpbox:8\"\n");
    bench.write("f.toml", "[model]\nbounds = [[0,0,0],[1,1,1]]\n[model.mesh.a]\nfile = \"../x.obj\"\n");
    for (line, parts) in [
        ("info c.toml", vec!["c.toml:", "lead back"]),
        ("bake v.toml -o x.isolume", vec!["v.toml:1", "one volume"]),
        ("info m.toml:1", vec!["m.toml:N", "m.toml:128"]),
        ("info s.toml", vec!["s.toml", "no section [model]"]),
        ("info f.toml", vec!["../x.obj", "--allow-outside"]),
        ("info m.tom", vec!["did you mean m.toml?"]),
        ("info n.toml:9", vec!["n.toml", "did you mean"]),
        ("info m.toml --spacing 1,1,1", vec!["--spacing", "a model"]),
    ] {
        let text = bench.refuses(line);
        for part in parts {
            assert!(text.contains(part), "{line}: `{part}` is not in {text}");
        }
    }
}
