//! Scenes of several volumes through the program: one store for all, metadata that comes back, and mistakes named by
//! file and line.

use crate::common::program::{Bench, radiance};

const PAIR: &str = "coupling = COUPLING\n[[volumes]]\nname = \"bumps\"\nvolume = \"bumpbox:12\"\n\
    [[volumes]]\nname = \"gyroid\"\nvolume = \"gyroid:9\"\nscale = 0.3\n\
    translate = [0.35, 0.08, 0.35]\nalbedo = [0.5, 0.5, 1]\n\
    [bake]\nrays = 8\nlayers = 2\nbands = 2\n[probe]\nname = \"sky\"\n[camera]\nsize = [24, 24]\nexposure = 0\n";

/// The same pair with the volumes in the other order.
fn swapped(coupling: &str) -> String {
    let text = PAIR.replace("COUPLING", coupling);
    let tables: Vec<&str> = text.split("[[volumes]]\n").collect();
    let (second, rest) = tables[2].split_once("[bake]").expect("a bake");
    format!("{}[[volumes]]\n{second}[[volumes]]\n{}[bake]{rest}", tables[0], tables[1])
}

#[test]
fn a_pair_is_baked_into_one_store_and_lit_together() {
    let bench = Bench::new();
    bench.write("pair.toml", PAIR.replace("COUPLING", "[[47, 0.6]]"));
    let plan = bench.json("plan pair.toml");
    for (volume, other) in [(0, "gyroid"), (1, "bumps")] {
        let rows = plan["volumes"][volume]["effects"].as_array().expect("rows").clone();
        let row = rows.iter().find(|e| e["name"] == "coupling").expect("a row");
        assert!(row["on"] == true && row["setting"].as_str().is_some_and(|s| s.contains("chosen pair")), "{row}");
        assert!(row["reason"].as_str().is_some_and(|s| s.contains(other)), "{row}");
    }
    let bake = bench.json("bake pair.toml --texture 1 -o pair.isolume");
    for volume in [0, 1] {
        let effects = &bake["volumes"][volume]["bake"]["effects"];
        assert!(effects["coupling"]["hits"].as_u64() > Some(0), "{effects}");
        assert_eq!((effects["walls"]["rays"].as_u64(), effects["luminaires"]["rays"].as_u64()), (Some(0), Some(0)));
    }
    let of = |name: &str| bake["volumes"][usize::from(name == "gyroid")]["identity"]["scene"]["coupling"].clone();
    assert_eq!(of("bumps")["partners"][0]["isovalues"], serde_json::json!([[47.0, 0.6]]));
    assert_eq!(of("gyroid")["partners"][0]["isovalues"], serde_json::json!([[0.6, 47.0]]));
    for place in ["volumes/bumps/data", "volumes/gyroid/data", "transfer/bumps/env", "transfer/gyroid/emission"] {
        assert!(bench.path("pair.isolume").join(place).join("zarr.json").is_file(), "{place}");
    }
    // Both together are each of them, one behind the other; named by either isovalue.
    let line = "relight pair.isolume --env sky --exposure 0 --radiance";
    let lit = bench.json(&format!("{line} --isovalue 47 -o both.ply"));
    // The sun of the sky is lit apart, by paths between both.
    assert!(lit["transport_rays"] == 0 && lit["sun_rays"].as_u64() > Some(0), "{lit}");
    bench.run(&format!("{line} --isovalue gyroid=0.6 -o same.ply -o both.glb -o both.png --size 24x24"));
    bench.run(&format!("{line} --volume bumps --isovalue 47 -o bumps.ply"));
    bench.run(&format!("{line} --volume gyroid --isovalue 0.6 -o gyroid.ply"));
    let [both, same, bumps, gyroid] =
        ["both", "same", "bumps", "gyroid"].map(|n| radiance(&bench.bytes(&format!("{n}.ply"))));
    assert!(both == [bumps, gyroid].concat() && both == same && !both.is_empty());
    for name in ["bumps", "gyroid"] {
        bench.run(&format!("export pair.isolume --volume {name} --env sky -o {name}.nrrd"));
    }
    // Baked again nothing is done; the scene lights the same surfaces by itself.
    let again = bench.json("bake pair.toml --texture 1 -o pair.isolume");
    assert!((0..2).all(|v| again["volumes"][v]["bake"]["chunks"]["baked"] == 0), "{again}");
    bench.run("relight pair.toml --texture 1 --cache c --radiance -o scene.ply");
    assert!(radiance(&bench.bytes("scene.ply")) == both);
    for (line, words) in [
        ("relight pair.isolume --env sky -o x.glb --isovalue 48", "bumps=48, which has no partner in gyroid"),
        ("relight pair.isolume --env sky -o x.glb --isovalue gyrod=0.6", "did you mean gyroid?"),
        ("relight pair.isolume --env sky -o x.glb --isovalue 47 --volume gyrod", "one of bumps, gyroid"),
        ("relight pair.toml --cache c -o x.glb --isovalue 50", "bumps=50, which has no partner"),
        ("relight bumpbox:12 --cache c --env sky -o x.glb --isovalue bumps=47", "one volume alone"),
        ("relight bumpbox:12 --cache c --env sky -o x.glb --isovalue 47 --volume bumps", "one volume alone"),
        ("bake pair.toml --isovalues 48 -o x.isolume", "bumps=48, which has no partner"),
    ] {
        let text = bench.refuses(line);
        assert!(text.contains(words), "{line}: {text}");
    }
    // Another pair is another store.
    bench.write("pair.toml", PAIR.replace("COUPLING", "[[60, 0.6]]"));
    assert!(bench.refuses("bake pair.toml --texture 1 -o pair.isolume").contains("coupling"));
}

/// Root and description of the second volume are lost: the first restores the one, the second the other, and no chunk is
/// computed again.
#[test]
fn lost_metadata_of_several_volumes_comes_back() {
    let bench = Bench::new();
    bench.write("a.toml", PAIR.replace("COUPLING", "[[47, 0.6]]"));
    bench.run("bake a.toml --texture 1 -o a.isolume");
    let names = ["zarr.json", "transfer/gyroid/env/zarr.json", "volumes/gyroid/data/zarr.json", "volumes/zarr.json"];
    let before = names.map(|name| bench.bytes(&format!("a.isolume/{name}")));
    for lost in [&names[..1], &names[..2], &names[1..], &names[..]] {
        lost.iter().for_each(|name| std::fs::remove_file(bench.path(&format!("a.isolume/{name}"))).expect("removed"));
        let again = bench.json("bake a.toml --texture 1 -o a.isolume");
        let volumes = again["volumes"].as_array().expect("two volumes");
        assert!(volumes.iter().all(|v| v["bake"]["chunks"]["baked"] == 0), "{lost:?}: {again:#}");
        assert!(names.map(|name| bench.bytes(&format!("a.isolume/{name}"))) == before, "{lost:?}");
    }
}

#[test]
fn the_order_of_volumes_does_not_matter() {
    let bench = Bench::new();
    // What is baked, without the stamp before the index: that of the store, which names the volumes in their order.
    let shard = |store: &str, name: &str| {
        let mut bytes = bench.bytes(&format!("{store}/transfer/{name}/env/transfer/c/0/0/0/0"));
        let index = bytes.len() - (64 * 16 + 4);
        bytes.drain(index - 16..index);
        bytes
    };
    for (coupling, other) in [("[[47, 0.6]]", "[[0.6, 47]]"), ("\"normalised\"", "\"normalised\"")] {
        bench.write("a.toml", PAIR.replace("COUPLING", coupling));
        bench.write("b.toml", swapped(other));
        // 40 % of either range is the same pair; rounding may differ by a bit where it goes back and forth.
        let line = if coupling.starts_with('[') { "" } else { "--isovalues 40%" };
        bench.run(&format!("bake a.toml {line} --texture 1 -o a.isolume --force"));
        bench.run(&format!("bake b.toml {line} --texture 1 -o b.isolume --force"));
        for name in ["bumps", "gyroid"] {
            assert!(shard("a.isolume", name) == shard("b.isolume", name), "{coupling} {name}");
        }
    }
}

#[test]
fn mistakes_in_pairs_name_file_and_line() {
    let bench = Bench::new();
    let pair = |coupling: &str| PAIR.replace("COUPLING", coupling);
    let one = "coupling = \"equal\"\n[[volumes]]\nvolume = \"bumpbox:8\"\n".to_string();
    let cases: [(String, &str, &str); 14] = [
        (one, "s.toml:2:", "two to 8 volumes (found 1)"),
        (pair("\"normalized\""), "s.toml:1:", "did you mean normalised?"),
        (pair("[]"), "s.toml:1:", "rows of 2 isovalues"),
        (pair("[[47]]"), "s.toml:1:", "rows of 2 isovalues"),
        (pair("[47, 0.6]"), "s.toml:1:", "rows of 2 isovalues"),
        (pair("[[47, 99]]"), "s.toml:1:", "99 of gyroid"),
        (pair("[[47, 0.6], [50, 0.6]]"), "s.toml:1:", "rise, or fall"),
        (pair("\"equal\"").replace("\"gyroid:9\"", "\"sphere:9\""), "s.toml:", "isovalue"),
        (pair("\"equal\"").replacen("coupling = \"equal\"\n", "", 1), "s.toml:1:", "the key `coupling`"),
        (pair("\"equal\"").replace("name = \"gyroid\"", "name = \"bumps\""), "s.toml:", "names that differ"),
        (pair("\"equal\"").replace("name = \"gyroid\"", "name = \"_g\""), "s.toml:", "begins with a letter"),
        (pair("\"equal\"").replace("albedo = [0.5, 0.5, 1]", "albedo = 2"), "s.toml:10:", "shares from 0 to 1"),
        (format!("volume = \"gyroid:8\"\n{}", pair("\"equal\"")), "s.toml:1:", "below each [[volumes]]"),
        ("volume = \"gyroid:8\"\ncoupling = \"equal\"\n".into(), "s.toml:2:", "[[volumes]], which it couples"),
    ];
    for (text, place, words) in cases {
        let is_range = text.contains("sphere:9");
        bench.write("s.toml", &text);
        let line = if is_range { "bake s.toml --isovalues 150 -o x.isolume" } else { "bake s.toml -o x.isolume" };
        let message = bench.refuses(line);
        assert!(is_range || message.contains(place), "{text}: {message}");
        assert!(message.contains(words), "{text}: {message}");
    }
    // Ranges that have no value in common.
    let apart = pair("\"equal\"").replace("\"gyroid:9\"", "\"FAR\"");
    bench.write("far.json", r#"{"dims": [2, 2, 2], "type": "uint8", "data": "far.raw"}"#);
    bench.write("far.raw", "\u{1}\u{2}\u{1}\u{2}\u{1}\u{2}\u{1}\u{2}");
    bench.write("near.json", r#"{"dims": [2, 2, 2], "type": "uint8", "inter": 100, "data": "far.raw"}"#);
    bench.write("s.toml", apart.replace("FAR", "far.json").replace("\"bumpbox:12\"", "\"near.json\""));
    let message = bench.refuses("bake s.toml -o x.isolume");
    assert!(message.contains("s.toml:1:") && message.contains("ranges that overlap"), "{message}");
}

/// The numbers of an attribute of a .glb, widened.
fn attribute(json: &serde_json::Value, bin: &[u8], name: &str) -> Vec<f64> {
    let index = json["meshes"][0]["primitives"][0]["attributes"][name].as_u64();
    let accessor = &json["accessors"][index.unwrap_or_else(|| panic!("no {name}")) as usize];
    let view = &json["bufferViews"][accessor["bufferView"].as_u64().expect("a view") as usize];
    let at = |v: &serde_json::Value| v["byteOffset"].as_u64().unwrap_or(0) as usize;
    let per = match accessor["type"].as_str() {
        Some("SCALAR") => 1,
        Some("VEC3") => 3,
        _ => 4,
    };
    let count = per * accessor["count"].as_u64().expect("a count") as usize;
    let bytes = &bin[at(view) + at(accessor)..];
    match accessor["componentType"].as_u64() {
        Some(5126) => bytes.as_chunks().0[..count].iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect(),
        _ => bytes.as_chunks().0[..count].iter().map(|b| f64::from(u16::from_le_bytes(*b)) / 65535.0).collect(),
    }
}

/// Two volumes under a sky and a lamp, relit from the attributes of their file alone by the formula beside them.
#[test]
fn a_scene_is_relit_from_its_file() {
    let bench = Bench::new();
    let lamp =
        "[[luminaires]]\nname = \"lamp\"\nshape = \"sphere\"\ncentre = [0.9, -0.2, 0.1]\nradius = 0.1\npower = 20\n";
    for layers in [1, 2] {
        let scene = PAIR.replace("COUPLING", "[[47, 0.6]]").replace("layers = 2", &format!("layers = {layers}"));
        bench.write("s.toml", scene.replace("[bake]", &format!("{lamp}[bake]")));
        let line = "relight s.toml --cache c --albedo 0.8,0.6,0.4 --emission 0.25 --luminaire lamp=2,1,0.5";
        bench.run(&format!("{line} --transfer --radiance -o s.glb"));
        let bytes = bench.bytes("s.glb");
        let file = gltf::Glb::from_slice(&bytes).expect("a GLB");
        let json: serde_json::Value = serde_json::from_slice(&file.json).expect("JSON");
        let bin = file.bin.as_deref().expect("numbers");
        let extras = &json["meshes"][0]["extras"]["isolume_transfer"];
        let number = |v: &serde_json::Value| v.as_f64().expect("a number");
        let [radiance, colours] = ["_RADIANCE", "COLOR_0"].map(|name| attribute(&json, bin, name));
        let vertices = radiance.len() / 3;
        let width = colours.len() / vertices;
        let (mut square, mut of_tail, mut mean) = (0.0, 0.0, 0.0);
        for (c, channel) in ["R", "G", "B"].into_iter().enumerate() {
            let (rho, glow) = (number(&extras["albedo"][c]), number(&extras["emission"][c]));
            let factor = number(&extras["luminaires"][0]["factor"][c]);
            let (mut sum, mut brought, mut emission) = (vec![glow; vertices], Vec::new(), Vec::new());
            for k in 0..layers {
                let power = rho.powi(k + 1);
                brought = vec![0.0; vertices];
                let mut add = |name: &str, weight: f64| {
                    let values = attribute(&json, bin, name);
                    assert_eq!(values.len(), vertices, "{name}");
                    brought.iter_mut().zip(&values).for_each(|(b, v)| *b += power * weight * v);
                    values
                };
                for (i, light) in
                    extras["light"]["coefficients_in_world"].as_array().expect("a light").iter().enumerate()
                {
                    let l = i.isqrt();
                    if l < 2 {
                        add(&format!("_T{k}_{channel}_SH_DEGREE_{l}_COEF_{}", i - l * l), number(&light[c]));
                    }
                }
                add(&format!("_LUMINAIRE_0_G{k}_{channel}"), factor);
                emission.push(add(&format!("_G{k}_EMISSION_{channel}"), glow));
                sum.iter_mut().zip(&brought).for_each(|(s, b)| *s += b);
            }
            for v in 0..vertices {
                let without = sum[v];
                if let [.., before, last] = &emission[..] {
                    let x = if before[v] > 0.0 { rho * (last[v] / before[v]).min(1.0) } else { 0.0 };
                    sum[v] += brought[v] * x / (1.0 - x);
                }
                let expected = radiance[3 * v + c];
                square += (sum[v] - expected).powi(2);
                of_tail += (sum[v] - without).powi(2);
                mean += expected / (3 * vertices) as f64;
                let shown = (number(&extras["exposure"]) * expected).clamp(0.0, 1.0);
                // To a step of 16 bits.
                assert!((colours[width * v + c] - shown).abs() < 1.01 / 65535.0);
            }
        }
        let [rms, tail] = [square, of_tail].map(|s| (s / (3 * vertices) as f64).sqrt());
        assert!(vertices > 100 && mean > 0.1, "{vertices} vertices of mean {mean}");
        // The layers are linear in the transfer: what interpolation and contraction do commutes, to the rounding of some
        // dozen sums in 32 bits. The tail is not, its ratio is a quotient of interpolated numbers.
        let allowed = if layers == 1 { 64.0 * f64::from(f32::EPSILON) * mean } else { tail };
        assert!(rms < allowed, "{layers} layers: {rms} {allowed}");
    }
}

/// Two shares into two stores that are merged, and two into one store, relight as the whole does.
#[test]
fn shares_of_several_volumes_are_the_whole() {
    let bench = Bench::new();
    let scene =
        PAIR.replace("COUPLING", "[[47, 0.6]]").replace("bumpbox:12", "bumpbox:40").replace("rays = 8", "rays = 4");
    bench.write("pair.toml", scene);
    bench.run("bake pair.toml --texture 1 -o whole.isolume");
    for share in ["1/2", "2/2"] {
        bench.run(&format!("bake pair.toml --texture 1 --chunks {share} -o {}.isolume", &share[..1]));
        bench.run(&format!("bake pair.toml --texture 1 --chunks {share} -o both.isolume"));
    }
    bench.run("merge 1.isolume 2.isolume -o merged.isolume");
    let [whole, both, merged] = ["whole", "both", "merged"].map(|name| {
        bench.run(&format!("relight {name}.isolume --isovalue 47 --env sky --radiance -o {name}.ply"));
        radiance(&bench.bytes(&format!("{name}.ply")))
    });
    assert!(!whole.is_empty() && whole == both && whole == merged);
    assert!(bench.refuses("relight 1.isolume --isovalue 47 --env sky -o x.ply").contains("never baked"));
    // What was not baked together is refused before anything is written.
    bench.run("bake gyroid:9 --isovalues 0.6 --rays 4 -o alone.isolume");
    bench.run("bake bumpbox:12 --isovalues 47 --rays 4 -o bumps.isolume");
    for stores in ["1.isolume alone.isolume", "alone.isolume 1.isolume", "alone.isolume bumps.isolume"] {
        let message = bench.refuses(&format!("merge {stores} -o bad.isolume"));
        assert!(message.contains("shares of one bake") && !bench.path("bad.isolume").exists(), "{stores}: {message}");
    }
}

/// A texel of one of two volumes, path by path: what it turned on is named.
#[test]
fn texels_of_scenes_are_replayed() {
    let bench = Bench::new();
    bench.write("pair.toml", PAIR.replace("COUPLING", "[[47, 0.6]]"));
    bench.run("bake pair.toml --texture 1 -o pair.isolume");
    let replays = bench.run("bake pair.toml --json --replay-texel 5,5,5");
    let mut all = serde_json::Deserializer::from_str(&replays).into_iter::<serde_json::Value>();
    for _ in 0..2 {
        let replay = all.next().expect("one a volume").expect("JSON");
        let paths = replay["paths"].as_array().expect("paths");
        assert_eq!(paths.len(), 8, "{replay}");
        let turned = |path: &serde_json::Value| path["turned_on"].as_array().map_or(0, Vec::len);
        assert!(paths.iter().all(|p| turned(p) == p["vertices_in_grid"].as_array().map_or(0, Vec::len)));
        assert!(replay["groups"]["emission"]["transfer"].as_array().is_some_and(|t| t.len() == 6));
    }
}
