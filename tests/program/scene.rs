//! Scene files through the program: the examples run, options override the file, and mistakes name file and line.

use crate::common::program::{Bench, radiance};
use serde_json::Value;
use std::path::Path;

fn example(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/scenes").join(name).display().to_string()
}

/// Small forms of the options that take time.
const SMALL: &str = "--rays 4 --texture 0.25 --size 40x30 --cache cache";

#[test]
fn the_examples_run() {
    let bench = Bench::new();
    let all = [
        ("bumps", 2),
        ("brain", 2),
        ("core", 2),
        ("box", 4),
        ("glass", 1),
        ("pair", 1),
        ("fog", 1),
        ("candle", 2),
        ("smoke", 1),
    ];
    for (name, files) in all {
        let lit = bench.json(&format!("relight {} {SMALL}", example(&format!("{name}.toml"))));
        let written = lit["files"].as_array().expect("files");
        assert_eq!(written.len(), files, "{name}: {lit}");
        for file in written {
            let path = bench.folder.path().join(file["path"].as_str().expect("a path"));
            assert!(std::fs::metadata(&path).is_ok_and(|m| m.len() > 100), "{}", path.display());
        }
    }
}

#[test]
fn a_scene_means_what_its_options_mean() {
    let bench = Bench::new();
    bench.write(
        "s.toml",
        "volume = \"bumpbox:20\"\nisovalues = [30]\noutputs = \"scene.glb\"\n[material]\nalbedo = 0.5\n\
         [bake]\nrays = 8\nlayers = 2\n[probe]\nname = \"studio\"\nrotation = 20\n[camera]\nexposure = 0\n",
    );
    bench.run("relight s.toml --cache a");
    let options = "--isovalue 30 --albedo 0.5 --rays 8 --layers 2 --env studio --env-rotate 20 --exposure 0";
    bench.run(&format!("relight bumpbox:20 {options} --cache b -o options.glb"));
    assert!(bench.bytes("scene.glb") == bench.bytes("options.glb"));
    // What the line says counts more.
    bench.run("relight s.toml --cache a --albedo 0.25 --env-rotate=-20 -o other.glb");
    let options = "--isovalue 30 --albedo 0.25 --rays 8 --layers 2 --env studio --env-rotate=-20 --exposure 0";
    bench.run(&format!("relight bumpbox:20 {options} --cache b -o options.glb"));
    assert!(bench.bytes("other.glb") == bench.bytes("options.glb"));
    // The same for bakes: the store of the scene is that of the options.
    let baked = bench.json("bake s.toml -o s.isolume");
    let plain = bench.json("bake bumpbox:20 --isovalues 30 --rays 8 --layers 2 -o p.isolume");
    for key in ["rays", "paths", "texels", "mean_escapes"] {
        assert_eq!(baked["bake"][key], plain["bake"][key], "{key}");
    }
    assert_eq!(baked["identity"], plain["identity"]);
    let more = bench.json("bake s.toml --rays 16 -o s.isolume");
    assert_eq!(more["bake"]["rays_per_texel"], 16);
}

#[test]
fn tables_give_every_isovalue_its_material() {
    let bench = Bench::new();
    bench.write(
        "t.toml",
        "volume = \"sphere:16\"\nisovalues = [-0.6]\noutputs = \"t.ply\"\n\
         [material]\nalbedo = [[-1, 0], [-0.2, 0.8]]\nemission = [[-0.6, 0.25], [0, 4]]\n\
         [probe]\nname = \"constant\"\n[camera]\nexposure = 0\n",
    );
    bench.run("relight t.toml --cache c --radiance");
    // Outside a sphere under radiance 1: albedo 0.4 by the table, and 0.25 of its own.
    bench.run("relight sphere:16 --isovalue -0.6 --env constant --exposure 0 --albedo 0.4 --emission 0.25 --cache c -o o.ply --radiance");
    let colours = |name: &str| {
        let bytes = bench.bytes(name);
        let end = b"end_header\n";
        let at = bytes.windows(end.len()).position(|w| w == end).expect("a header");
        bytes[at..].to_vec()
    };
    assert!(colours("t.ply") == colours("o.ply"));
    let dark = bench.json("plan t.toml --effects -emission");
    let row =
        dark["effects"].as_array().expect("rows").iter().find(|e| e["name"] == "emission").expect("a row").clone();
    assert_eq!((row["on"].as_bool(), row["error"].as_f64()), (Some(false), Some(0.25)));
}

#[test]
fn the_plan_names_every_effect_and_switches_state_their_price() {
    let bench = Bench::new();
    let rows = |line: &str| bench.json(line)["effects"].as_array().expect("rows").clone();
    let row = |rows: &[Value], name: &str| rows.iter().find(|e| e["name"] == name).expect("a row").clone();
    let plan = rows("plan gyroid:24");
    let names: Vec<&str> = plan.iter().filter_map(|e| e["name"].as_str()).collect();
    assert_eq!(names, isolume::scene::EFFECTS);
    for absent in ["walls", "luminaires", "caustics", "media", "colour-channels", "emission"] {
        assert_eq!(row(&plan, absent)["on"], false, "{absent}");
        assert_eq!(row(&plan, absent)["cost_share"], 0.0, "{absent}");
    }
    // Which lamps is for the environment to say, at relight.
    let split = row(&plan, "sun-split");
    assert!(split["on"] == true && split["reason"].as_str().is_some_and(|r| r.contains("2 %")), "{split}");
    let costs: f64 = plan.iter().filter_map(|e| e["cost_share"].as_f64()).sum();
    assert!((costs - 1.0).abs() < 1e-9, "{costs}");
    // Without interreflection there is one layer, and its price is larger.
    let direct = rows("plan gyroid:24 --effects -interreflection");
    let price = |rows: &[Value]| row(rows, "interreflection")["error"].as_f64().expect("a price");
    assert_eq!(row(&direct, "interreflection")["on"], false);
    assert!(price(&direct) > price(&plan) && price(&plan) > 0.0);
    let unshaded = rows("plan gyroid:24 --effects -shadowing");
    assert!(row(&unshaded, "shadowing")["error"].as_f64().is_some_and(|e| e > 0.1), "{unshaded:?}");
    // A sphere declares itself convex.
    let sphere = rows("plan sphere:24");
    assert_eq!(row(&sphere, "shadowing")["on"], false);
    assert_eq!(row(&rows("plan sphere:24 --solid below"), "shadowing")["on"], true);
    for (switch, words) in [
        ("+shadowin", "did you mean shadowing?"),
        ("shadowing", "+shadowing"),
        ("+walls", "describe it there"),
        ("+media", "describe it there"),
        ("-texels", "--isovalues"),
    ] {
        let output = bench.command(&format!("plan sphere:8 --effects {switch}")).assert().code(2).get_output().clone();
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(text.contains(words), "{switch}: {text}");
    }
}

#[test]
fn counters_show_that_what_is_off_costs_nothing() {
    let bench = Bench::new();
    let small = "--rays 8 --layers 3 --bands 2";
    let effects = |line: &str| bench.json(line)["bake"].clone();
    let whole = effects(&format!("bake gyroid:16 {small} -o a.isolume -v"));
    let count = |bake: &Value, name: &str, what: &str| bake["effects"][name][what].as_u64().expect("a count");
    assert!(count(&whole, "shadowing", "rays") > 0 && count(&whole, "interreflection", "rays") > 0);
    assert_eq!(
        count(&whole, "shadowing", "rays") + count(&whole, "interreflection", "rays"),
        whole["rays"].as_u64().expect("rays")
    );
    assert_eq!(whole["plan"].as_array().map(Vec::len), Some(12));
    let direct = effects("bake gyroid:16 --rays 8 --bands 2 --effects -interreflection -o b.isolume");
    assert_eq!(count(&direct, "interreflection", "rays"), 0);
    assert_eq!(direct["mean_escapes"].as_array().map(Vec::len), Some(1));
    let none = effects(&format!("bake gyroid:16 {small} --effects -shadowing -o c.isolume"));
    assert_eq!((none["rays"].as_u64(), count(&none, "shadowing", "rays")), (Some(0), 0));
    // The clamped cosine: a_0 = 1 to the rounding of f32 sums, nothing reflected twice.
    let escapes: Vec<f64> = none["mean_escapes"].as_array().expect("a list").iter().filter_map(Value::as_f64).collect();
    assert!((escapes[0] - 1.0).abs() < 1e-6 && escapes[1..] == [0.0, 0.0], "{escapes:?}");
    for bake in [&whole, &direct, &none] {
        for (effect, what) in [("walls", "rays"), ("luminaires", "rays"), ("caustics", "photons"), ("media", "rays")] {
            assert_eq!(count(bake, effect, what), 0);
        }
    }
    // Other effects, another store.
    let text = bench.refuses(&format!("bake gyroid:16 {small} --effects -shadowing -o a.isolume"));
    assert!(text.contains("shadowing ignored"), "{text}");
    let text = bench.refuses("relight a.isolume --isovalue 0 --env sky --effects -shadowing -o x.glb");
    assert!(text.contains("at the bake"), "{text}");
}

#[test]
fn a_mistake_names_file_line_and_remedy() {
    let bench = Bench::new();
    bench.write("there.nrrd", "no volume");
    let rest = "isovalues = [30]\n[probe]\nname = \"sky\"\n";
    let cases: [(&str, &str, &[&str]); 22] = [
        ("volume = \"bumpbox:8\"\nisovalus = [30]\n", "s.toml:2:", &["did you mean isovalues?"]),
        ("volume = \"ther.nrrd\"\n", "s.toml:1:", &["ther.nrrd", "did you mean", "there.nrrd"]),
        ("\nvolume = \"there.nrrd\"\n", "s.toml:2:", &["there.nrrd"]),
        ("volume = \"bumpbx:8\"\n", "s.toml:1:", &["did you mean the field bumpbox?"]),
        ("volume = \"bumpbox:8\"\nisovalues = [30, 999]\n", "s.toml:2:", &["999", "range"]),
        ("volume = \"bumpbox:8\"\n[material]\nalbedo = 1.5\n", "s.toml:3:", &["1.5", "from 0 to 1", "reflect"]),
        ("volume = \"bumpbox:8\"\n[material]\nalbedo = [[1, 0.5], [0, 0.5]]\n", "s.toml:3:", &["ascend", "lowest"]),
        ("volume = \"bumpbox:8\"\n[material]\nemission = -2\n", "s.toml:3:", &["-2", "not negative"]),
        ("volume = \"bumpbox:8\"\n[bake]\nrays = \"many\"\n", "s.toml:3:", &["whole number"]),
        ("volume = 7\n", "s.toml:1:", &["volume = 7", "text"]),
        ("volume = \"bumpbox:8\"\n[walls]\n", "s.toml:2:", &["tables", "[[walls]]"]),
        ("volume = \"bumpbox:8\"\n[media]\n", "s.toml:2:", &["the key `media`"]),
        (
            "volume = \"bumpbox:8\"\n[[walls]]\nshape = \"room\"\nmin = [0, 0, 0]\nmax = [1, 1, 1]\nalbedo = 1.2\n",
            "s.toml:6:",
            &["walls[0].albedo = 1.2", "from 0 to 1", "reflect more"],
        ),
        ("volume = \"bumpbox:8\"\n[[walls]]\nshape = \"rom\"\n", "s.toml:3:", &["did you mean room?"]),
        (
            "volume = \"bumpbox:8\"\n[[objects]]\nshape = \"sphere\"\ncentre = [0, 0, 0]\nradios = 1\n",
            "s.toml:5:",
            &["objects[0].radios", "did you mean radius?"],
        ),
        (
            "volume = \"bumpbox:8\"\n\n[[objects]]\nshape = \"mesh\"\nfile = \"chair.obj\"\n",
            "s.toml:5:",
            &["chair.obj", "a mesh that exists", "folder of the scene"],
        ),
        (
            "volume = \"bumpbox:8\"\n[[objects]]\nshape = \"mesh\"\nfile = \"there.nrrd\"\n",
            "s.toml:4:",
            &["there.nrrd", "no triangle", "OBJ, PLY, STL or glTF"],
        ),
        (
            "volume = \"bumpbox:8\"\n[[luminaires]]\nshape = \"rectangle\"\ncorner = [0, 0, 0]\nu = [1, 0, 0]\nv = [2, 0, 0]\npower = 90\n",
            "s.toml:2:",
            &["a finite area above 0", "two edges that span an area"],
        ),
        (
            "volume = \"bumpbox:8\"\n[[luminaires]]\nshape = \"point\"\nposition = [0, 0, 0]\n",
            "s.toml:2:",
            &["the key `power`", "a point luminaire has power, position"],
        ),
        ("volume = \"bumpbox:8\"\n[probe]\nfile = \"no.exr\"\n", "s.toml:3:", &["no.exr", "exists"]),
        (
            "volume = \"bumpbox:8\"\nisovalues = 30\n[probe]\nname = \"cuortyard\"\n",
            "s.toml:4:",
            &["did you mean courtyard?"],
        ),
        ("volume = \"bumpbox:8\n", "s.toml:1:", &["TOML"]),
    ];
    for (text, place, words) in cases {
        let whole = if text.contains("[") { text.to_string() } else { format!("{text}{rest}") };
        bench.write("s.toml", &whole);
        let line = if text.contains("cuortyard") { "relight s.toml -o x.glb" } else { "bake s.toml -o x.isolume" };
        let message = bench.refuses(line);
        assert!(message.contains(place), "{text}: {message}");
        assert!(words.iter().all(|word| message.contains(word)), "{text}: {message}");
        assert!(!bench.folder.path().join("x.isolume").exists(), "{text}");
    }
    let message = bench.refuses("plan ss.toml");
    assert!(message.contains("did you mean s.toml?"), "{message}");
    // What a scene leaves open the line must say.
    bench.write("s.toml", "volume = \"sphere:8\"\n");
    bench.command("relight s.toml").assert().code(2);
}

const ROOM: &str = "volume = \"bumpbox:12\"\nisovalues = [47]\noutputs = [\"box.png\", \"box.ply\"]\n\
    [bake]\nrays = 16\nlayers = 3\nbands = 1\n[[walls]]\nshape = \"room\"\nmin = [0, 0, 0]\nmax = [1, 1, 1]\nalbedo = [0.6, 0.3, 0.3]\n\
    [[luminaires]]\nname = \"ceiling\"\nshape = \"rectangle\"\ncorner = [0.3, 0, 0.3]\nu = [0, 0, 0.4]\nv = [0.4, 0, 0]\npower = 90\n\
    [camera]\nsize = [24, 24]\nexposure = 0\n";

#[test]
fn luminaires_are_relit_without_rays() {
    let bench = Bench::new();
    bench.write("room.toml", ROOM);
    let baked = bench.json("bake room.toml --texture 1 -o room.isolume");
    let effects = &baked["bake"]["effects"];
    assert!(effects["walls"]["rays"].as_u64() > Some(0) && effects["luminaires"]["rays"].as_u64() > Some(0), "{baked}");
    assert_eq!((effects["caustics"]["photons"].as_u64(), effects["media"]["rays"].as_u64()), (Some(0), Some(0)));
    // A store lights itself; twice the power is twice the light, to the last bit.
    let line = "relight room.isolume --isovalue 47 --exposure 0 --radiance";
    let once = bench.json(&format!("{line} -o once.ply"));
    assert_eq!(once["transport_rays"], 0);
    bench.run(&format!("{line} -o twice.ply --luminaire ceiling=2"));
    bench.run(&format!("{line} -o red.ply --luminaire ceiling=1,0,0"));
    let [once, twice, red] = ["once.ply", "twice.ply", "red.ply"].map(|n| radiance(&bench.bytes(n)));
    assert!(once.iter().any(|v| v[0] > 1.0) && once.len() == twice.len());
    for ((a, b), r) in once.iter().zip(&twice).zip(&red) {
        assert_eq!(a.map(|v| 2.0 * v), *b);
        assert_eq!([a[0], 0.0, 0.0], *r);
    }
    // The scene itself gives the same surface, and a picture.
    bench.run("relight room.toml --texture 1 --cache c --radiance");
    assert_eq!(radiance(&bench.bytes("box.ply")), once);
    assert!(bench.bytes("box.png").starts_with(b"\x89PNG"));
    // Baked again nothing is done; other walls are another store.
    assert_eq!(bench.json("bake room.toml --texture 1 -o room.isolume")["bake"]["chunks"]["baked"], 0);
    bench.write("room.toml", ROOM.replace("0.6, 0.3", "0.5, 0.3"));
    assert!(bench.refuses("bake room.toml --texture 1 -o room.isolume").contains("scene"));
    // Switched off, walls and luminaires are as if they had not been described: the very same store.
    bench.json("bake room.toml --texture 1 --effects -walls,-luminaires -o bare.isolume");
    bench.json("bake bumpbox:12 --texture 1 --isovalues 47 --rays 16 --layers 3 --bands 1 -o plain.isolume");
    let shard = |store: &str| bench.bytes(&format!("{store}.isolume/transfer/bumpbox/env/transfer/c/0/0/0/0"));
    assert!(shard("bare") == shard("plain"));
    for (line, words) in [
        ("relight room.isolume --isovalue 47 -o x.ply --luminaire celing=2", "did you mean ceiling?"),
        ("relight plain.isolume --isovalue 47 --env sky -o x.ply --luminaire ceiling=2", "a scene with luminaires"),
        ("relight room.isolume --isovalue 47 --env sun:30,40 --sun-split -o x.ply", "walls and luminaires do to light"),
        ("bake room.toml --estimator photon -o x.isolume", "use path or gather"),
        ("plan room.toml --estimator photon", "use path or gather"),
        ("compare room.isolume --isovalue 47 --env sky", "scene"),
    ] {
        let text = bench.refuses(line);
        assert!(text.contains(words), "{line}: {text}");
    }
    // An error is for scenes as for volumes.
    let to_error = bench.json("bake room.toml --error 20% --rays 64 -o error.isolume");
    let (target, found) = (&to_error["bake"]["error_target"], &to_error["bake"]["escape_stderr"]["p50"]);
    assert!(*target == 0.2 && found.as_f64().is_some_and(|e| e <= 0.2), "{to_error}");
    // A goal is not cut off at the rays of the scene.
    let cut = bench.json("bake room.toml --error 30% -o goal.isolume");
    assert_eq!(cut["bake"]["rays_per_texel"], 4096);
    assert!(to_error["bake"]["escape_stderr"]["of"].as_str().is_some_and(|of| of.contains("luminaires")), "{to_error}");
    // Without a luminaire an environment must be named.
    bench.command("relight plain.isolume --isovalue 47 -o x.ply").assert().code(2);
}

#[test]
fn caustics_that_paths_cannot_find_are_brought_by_photons() {
    let bench = Bench::new();
    let glass = "[[objects]]\nshape = \"sphere\"\ncentre = [0.5, 0.2, 0.5]\nradius = 0.1\nmaterial = \"glass\"\n";
    let bulb = "[[luminaires]]\nname = \"bulb\"\nshape = \"point\"\nposition = [0.5, 0.05, 0.5]\npower = 10\n";
    bench.write("g.toml", format!("volume = \"bumpbox:10\"\nisovalues = 47\n[bake]\nrays = 4\n{glass}{bulb}"));
    let plan = bench.json("plan g.toml");
    let row =
        plan["effects"].as_array().expect("rows").iter().find(|e| e["name"] == "caustics").expect("a row").clone();
    let says = |word: &str| row["reason"].as_str().is_some_and(|r| r.contains(word));
    assert!(row["on"] == true && says("bulb") && says("photons"), "{row}");
    let on = bench.json("bake g.toml -o g.isolume");
    let estimator = &on["identity"]["estimator"];
    assert!(estimator["caustics"] == true && estimator["photons"] == 1 << 22, "{estimator}");
    let off = bench.json("bake g.toml --effects -caustics -o n.isolume");
    let estimator = &off["identity"]["estimator"];
    assert!(estimator["caustics"] == false && estimator["photons"].is_null(), "{estimator}");
    // The ball stands between the bulb and the bump: what passes it is most of the light there.
    bench.run("relight g.isolume --isovalue 47 --env constant:0 --radiance -o g.ply");
    bench.run("relight n.isolume --isovalue 47 --env constant:0 --radiance -o n.ply");
    assert!(bench.bytes("g.ply") != bench.bytes("n.ply"));
    // The same photons whatever the share, and what a texel is made of can be told.
    bench.run("bake g.toml --chunks 1/2 -o s.isolume");
    bench.run("bake g.toml --chunks 2/2 -o s.isolume");
    bench.run("relight s.isolume --isovalue 47 --env constant:0 --radiance -o s.ply");
    assert!(bench.bytes("g.ply") == bench.bytes("s.ply"));
    assert!(bench.json("bake g.toml --replay-texel 5,5,5")["valid"].is_boolean());
}

/// An environment as a luminaire: dark without it, the same by a scene and by an option, scaled without a ray.
#[test]
fn an_environment_is_baked_as_a_luminaire() {
    let bench = Bench::new();
    let dome = "[[luminaires]]\nname = \"environment\"\nshape = \"environment\"\nimage = \"studio\"\nrotation = 20\n";
    let bake = "[bake]\nrays = 64\nbands = 1\n";
    bench.write("d.toml", format!("volume = \"bumpbox:12\"\nisovalues = 47\n{bake}{dome}"));
    bench.run("bake d.toml -o d.isolume");
    bench.run("bake bumpbox:12 --isovalues 47 --rays 64 --fixed-env studio --env-rotate 20 -o f.isolume");
    let line = |store: &str, factor: f64, out: &str| {
        format!("relight {store} --isovalue 47 --env constant:0 --luminaire environment={factor} --exposure 0 -o {out}")
    };
    bench.run(&line("d.isolume", 1.0, "d.ply"));
    bench.run(&line("f.isolume", 1.0, "f.ply"));
    assert!(bench.bytes("d.ply") == bench.bytes("f.ply"));
    bench.run(&line("f.isolume", 0.25, "quarter.ply"));
    assert!(bench.bytes("f.ply") != bench.bytes("quarter.ply"));
    let found = bench.json(
        "compare f.isolume --isovalue 47 --fixed-env studio --env-rotate 20 --env constant:0 --points 200 --paths 256",
    );
    let row = &found["rows"][0];
    assert_eq!(row["budget_mean_square"]["truncation"], 0.0, "{row}");
    // 64 paths under small lamps, which are sampled by the image: noise alone.
    assert!(row["whole"]["relative_rms"]["value"].as_f64().is_some_and(|v| v < 0.15), "{row}");
    for (line, word) in [
        ("bake bumpbox:12 --isovalues 47 --fixed-env studoi -o e.isolume", "studoi"),
        ("bake d.toml --fixed-env studio -o e.isolume", "luminaires"),
        ("bake bumpbox:12 --isovalues 47 --env-rotate 20 -o e.isolume", "--fixed-env"),
        ("compare f.isolume --isovalue 47 --fixed-env sunset --env constant:0", "fingerprint"),
    ] {
        let said = bench.refuses(line);
        assert!(said.contains(word), "{line}: {said}");
    }
}

/// Media by options and by a scene are one, `-media` leaves today's result of a volume alone, and mistakes are named.
#[test]
fn media_by_options_and_scenes() {
    let bench = Bench::new();
    bench.write(
        "fog.toml",
        "volume = \"torus:16\"\nisovalues = [-0.1]\n[medium]\nname = \"fog\"\nextinction = 0.5\nalbedo = 0.9\nphase = { hg = 0.5 }\n",
    );
    let small = "--rays 16 --layers 2 --bands 3";
    let by_scene = bench.json(&format!("bake fog.toml {small} -o scene.isolume"));
    let by_option = bench.json(&format!("bake torus:16 --isovalues=-0.1 --fog 0.5,0.9,0.5 {small} -o option.isolume"));
    assert_eq!(by_scene["identity"], by_option["identity"]);
    let alone = bench.json(&format!("bake torus:16 --isovalues=-0.1 {small} -o alone.isolume"));
    let without = bench.json(&format!("bake fog.toml {small} --effects=-media -o without.isolume"));
    assert_eq!(alone["identity"], without["identity"]);
    assert_ne!(alone["identity"], by_scene["identity"]);
    let vacuum = bench.json(&format!("bake torus:16 --isovalues=-0.1 --fog 0 {small} -o vacuum.isolume"));
    assert_eq!(alone["identity"], vacuum["identity"]);
    // A bake in shares is the bake in one go.
    for share in ["1/2", "2/2"] {
        bench.run(&format!(
            "bake torus:16 --isovalues=-0.1 --fog 0.5,0.9,0.5 {small} --chunks {share} --threads 1 -o shares.isolume"
        ));
    }
    let radiance_of = |store: &str| {
        bench.run(&format!("relight {store} --isovalue=-0.1 --env sky --radiance -o {store}.ply"));
        radiance(&bench.bytes(&format!("{store}.ply")))
    };
    assert_eq!(radiance_of("shares.isolume"), radiance_of("option.isolume"));
    // Nodes: the albedo of the medium is chosen at relight, and only there.
    bench.run(&format!("bake torus:16 --isovalues=-0.1 --translucent 2,free,0.2,1.3 {small} -o wax.isolume"));
    let mean = |albedo: &str| {
        bench.run(&format!(
            "relight wax.isolume --isovalue=-0.1 --medium-albedo {albedo} --env constant:1 --radiance -o wax.ply"
        ));
        let all = radiance(&bench.bytes("wax.ply"));
        all.iter().map(|v| f64::from(v[0])).sum::<f64>() / all.len() as f64
    };
    let lit = bench.json("relight wax.isolume --isovalue=-0.1 --env sky -o wax.glb");
    let of_nodes = lit["files"][0]["error"]["medium_albedo_error"].as_f64().expect("an error");
    assert!((1e-9..0.02).contains(&of_nodes), "{of_nodes}");
    let [dark, bright] = ["0.2", "1"].map(mean);
    assert!(dark < 0.6 && (bright - 1.0).abs() < 0.02, "{dark} {bright}");
    let refused = |line: &str| {
        let (code, _, text) = bench.outcome(line);
        assert!(code != 0, "{line}");
        text
    };
    for (arguments, words) in [
        ("bake torus:16 --fog 0.5,1.5 -o x.isolume", &["--fog", "albedo"][..]),
        ("bake torus:16 --translucent 1,0.9,2 -o x.isolume", &["--translucent", "mean cosine"]),
        ("relight option.isolume --isovalue=-0.1 --medium-albedo 0.5 --env sky -o x.glb", &["medium albedo", "opaque"]),
        ("relight wax.isolume --isovalue=-0.1 --transfer --env sky -o x.glb", &["translucent"]),
        ("compare wax.isolume --isovalue=-0.1 --env sky", &["--scene"]),
    ] {
        let text = refused(arguments);
        assert!(words.iter().all(|word| text.contains(word)), "{arguments}: {text}");
    }
    for (text, line, words) in [
        ("[medium]\nalbedo = 0.5\n", 2, &["extinction"][..]),
        ("[medium]\nextinction = -1\n", 3, &["not negative"]),
        ("[medium]\nextinction = 1\nalbedo = 1.5\n", 4, &["0 to 1"]),
        ("[medium]\nextinction = 1\nphase = { hg = 1 }\n", 4, &["-1 and 1"]),
        ("[medium]\nextinction = 1\nphase = { gh = 1 }\n", 4, &["gh", "did you mean hg"]),
        ("[medium]\nextinction = 1\nwhere = \"inside\"\n", 4, &["outside"]),
        ("[medium]\nextinction = 1\nmin = [0, 0, 0]\n", 2, &["min and max"]),
        ("[medium]\nextinction = [[1, 2], [0, 3]]\n", 3, &["ascending"]),
        ("[medium]\nextinction = [[0, 0], [1, 1]]\nfield = \"none.nii\"\n", 2, &["none.nii"]),
        ("[material]\nkind = \"translucent\"\n", 2, &["preset", "mean_free_path"]),
        ("[material]\nkind = \"translucent\"\npreset = \"marbel\"\n", 4, &["did you mean marble"]),
        ("[material]\nkind = \"translucent\"\npreset = \"skin\"\n", 2, &["metres_per_unit"]),
        ("[material]\nkind = \"translucent\"\nmean_free_path = \"4 furlongs\"\n", 4, &["0.4 mm"]),
        ("[material]\nkind = \"translucent\"\nextinction = 1\nindex = 0.5\n", 5, &["1 to 10"]),
    ] {
        bench.write("bad.toml", format!("volume = \"torus:16\"\n{text}"));
        let said = refused("bake bad.toml -o x.isolume");
        let place = format!("bad.toml:{line}");
        assert!(said.contains(&place) && words.iter().all(|word| said.contains(word)), "{text}: {said}");
    }
}
