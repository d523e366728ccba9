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
fn outputs_are_not_what_a_model_reads() {
    let bench = Bench::new();
    let bounds = "[model]\nbounds = [[-1, -1, -1], [1, 1, 1]]\n";
    bench.write("m.toml", format!("{bounds}[model.point.a]\ncentre = [0, 0, 0]\nsurface_radius = 0.5\n"));
    bench.run("relight m.toml:16 --isovalue auto --env sky --rays 4 --cache c -o part.stl");
    let part = bench.bytes("part.stl");
    bench.write("d.toml", format!("{bounds}isovalue = 0\n[model.mesh.a]\nfile = \"part.stl\"\n"));
    bench.write("s.toml", "volume = \"d.toml:16\"\n[probe]\nname = \"sky\"\n");
    for line in ["relight d.toml", "relight d.toml:16", "relight ./d.toml:9x9x9", "relight s.toml"] {
        let text = bench.refuses(&format!("{line} --isovalue 0 --env sky --rays 4 --cache c -o part.stl"));
        assert!(text.contains("which is the input") && text.contains("part.stl"), "{line}: {text}");
        assert!(bench.bytes("part.stl") == part, "{line}");
    }
    let text = bench.refuses("view d.toml:16 --cache c --html part.stl");
    assert!(text.contains("part.stl") && bench.bytes("part.stl") == part, "{text}");
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

/// A soft point of reach 1 has the isovalue ½ at the radius ½.
#[test]
fn exact_vertices_lie_on_the_model() {
    const BALL: &str = "[model]\nbounds = [[-0.7, -0.7, -0.7], [0.7, 0.7, 0.7]]\nsamples = 16\n[model.point.p]\n\
        centre = [0.01, 0.02, -0.01]\nradius = 1\n";
    let bench = Bench::new();
    bench.write("m.toml", BALL);
    // How far vertices are from the sphere, in voxels.
    let off = |name: &str| {
        let store = isolume::Store::open(bench.path(name)).expect("a store");
        let surface = store.surface(0.5).expect("a sound surface").expect("the surface");
        let mesh = surface.mesh().expect("a sound mesh").expect("a mesh");
        let voxel = 1.4 / 15.0;
        let radius = |p: &[f32; 3]| {
            let from = [0.01, 0.02, -0.01];
            let world = [0, 1, 2].map(|a| -0.7 + voxel * f64::from(p[a]) - from[a]);
            (world.iter().map(|x| x * x).sum::<f64>().sqrt() - 0.5).abs() / voxel
        };
        mesh.positions_in_grid.iter().map(radius).fold(0.0, f64::max)
    };
    bench.run("bake m.toml --isovalues auto --rays 4 -o linear.isolume");
    bench.run("bake m.toml --isovalues auto --rays 4 --exact-vertices -o exact.isolume");
    let (linear, exact) = (off("linear.isolume"), off("exact.isolume"));
    // Vertices are held 2⁻¹⁴ voxel from grid points.
    assert!(linear > 1e-3 && exact < 1.1 / 16384.0, "{linear:e} and {exact:e} voxels");
    bench.run("verify exact.isolume");
    // The store has them, asked for or not; one that has others says so.
    bench.run("relight exact.isolume --isovalue 0.5 --env sky -o a.ply");
    bench.run("relight exact.isolume --isovalue 0.5 --env sky --exact-vertices -o b.ply");
    bench.run("relight m.toml --isovalue 0.5 --env sky --rays 4 --exact-vertices --cache c -o m.ply");
    bench.run("relight m.toml --isovalue 0.5 --env sky --rays 4 --cache c -o other.ply");
    assert!(body(&bench, "a.ply") == body(&bench, "b.ply") && body(&bench, "a.ply") == body(&bench, "m.ply"));
    assert!(body(&bench, "a.ply") != body(&bench, "other.ply"));
    // A texture has no vertices: they are found from the text of the model in the store, and are the same.
    bench.run("bake m.toml --texture 1 --rays 4 --layers 1 --bands 2 -o texture.isolume");
    std::fs::remove_file(bench.path("m.toml")).expect("the model is there");
    bench.run("relight texture.isolume --isovalue 0.5 --env sky --exact-vertices -o t.ply");
    let positions = |name: &str| {
        let bytes = bench.bytes(name);
        let head = String::from_utf8_lossy(&bytes[..bytes.len().min(2000)]).into_owned();
        let count = |element: &str| -> usize {
            let line = head.lines().find(|line| line.starts_with(&format!("element {element} "))).expect("a count");
            line.rsplit(' ').next().and_then(|n| n.parse().ok()).expect("a number")
        };
        // A triangle is the number 3 and three of 32 bits.
        let body = body(&bench, name)[11..].to_vec();
        let stride = (body.len() - 13 * count("face")) / count("vertex");
        (0..count("vertex")).map(|v| body[v * stride..v * stride + 12].to_vec()).collect::<Vec<_>>()
    };
    assert!(positions("t.ply") == positions("a.ply") && positions("t.ply") != positions("other.ply"));
    bench.write("m.toml", BALL);
    bench.write("w.xyz", "1\n\nO 0 0 0\n");
    bench.write(
        "files.toml",
        BALL.replace("[model.point.p]\ncentre = [0.01, 0.02, -0.01]", "[model.points.p]\nfile = \"w.xyz\""),
    );
    bench.run("bake files.toml --texture 1 --rays 4 --layers 1 --bands 2 -o files.isolume");
    for (line, named) in [
        ("bake m.toml --isovalues auto --rays 4 -o exact.isolume", "--exact-vertices"),
        ("bake m.toml --isovalues auto --rays 4 --exact-vertices -o linear.isolume", "--exact-vertices"),
        ("bake m.toml --texture 1 --rays 4 --exact-vertices -o x.isolume", "texture"),
        ("bake bumpbox:12 --isovalues 47 --exact-vertices -o x.isolume", "a model in TOML"),
        ("relight bumpbox:12 --isovalue 47 --env sky --exact-vertices -o x.ply", "a model in TOML"),
        ("relight linear.isolume --isovalue 0.5 --env sky --exact-vertices -o x.ply", "into another store"),
        ("relight files.isolume --isovalue 0.5 --env sky --exact-vertices -o x.ply", "w.xyz"),
        ("view m.toml --exact-vertices --cache c", "texture"),
    ] {
        let message = bench.refuses(line);
        assert!(message.contains(named) && message.contains("--exact-vertices"), "{line}: {message}");
    }
    bench.run("relight files.toml --isovalue 0.5 --env sky --rays 4 --exact-vertices --cache c -o f.ply");
    // Of several isovalues none is added where one is refused: the store goes on as it began.
    bench.run("bake m.toml --isovalues 0.6 --rays 4 -o both.isolume");
    let message = bench.refuses("bake m.toml --isovalues 0.5,0.6 --rays 4 --exact-vertices -o both.isolume");
    assert!(message.contains("leave out --exact-vertices") || message.contains("on its samples"), "{message}");
    bench.run("bake m.toml --isovalues 0.5,0.6 --rays 4 -o both.isolume");
    bench.run("verify both.isolume");
}

#[test]
fn polygonizers_are_compared_on_a_model() {
    let bench = Bench::new();
    bench.write("m.toml", MODEL);
    let found = bench.json("study polygonizers m.toml:16 -o p");
    assert_eq!(found["rows"].as_array().map(Vec::len), Some(8));
    assert!(bench.bytes("p/polygonizers.csv").starts_with(b"polygonizer,cells,roots,visited,"));
    assert_eq!(serde_json::from_slice::<serde_json::Value>(&bench.bytes("p/polygonizers.json")).unwrap(), found);
    for (line, named) in [
        ("study polygonizers bumpbox:16", "a model in TOML"),
        ("study polygonizers n.toml", "n.toml"),
        ("study polygonizers m.toml:1", "m.toml:128"),
    ] {
        let message = bench.refuses(line);
        assert!(message.contains(named), "{message}");
    }
}
