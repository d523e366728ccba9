//! `isolume compare` through the program.

use crate::common::program::Bench;
use serde_json::Value;

#[test]
fn a_store_is_compared_and_the_budget_sums() {
    let bench = Bench::new();
    bench.run("bake bumpbox:32 --isovalues 47 --rays 64 -o b.isolume");
    let line =
        "compare b.isolume --isovalue 47 --env gradient --env sun:30,50,20 --points 200 --paths 64 --texel-rays 256";
    let apart = bench.json(line);
    let line = &format!("{line} --sun-split off");
    let found = bench.json(line);
    let rows = found["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 2);
    for row in rows {
        let total: f64 = row["budget_mean_square"].as_object().unwrap().values().map(|v| v.as_f64().unwrap()).sum();
        let rms = row["whole"]["relative_rms"]["value"].as_f64().unwrap();
        assert!((total - rms * rms).abs() < 1e-9, "{row}");
    }
    // A smooth sky is nearly its bands, so that little but the noise of 64 paths is left; of a lamp of 20° more is
    // cut off.
    let truncation = |i: usize| rows[i]["budget_mean_square"]["truncation"].as_f64().unwrap();
    assert!(truncation(1) > 4.0 * truncation(0), "{} {}", truncation(0), truncation(1));
    // By default lamps are lit apart, as relight does: nothing of them is cut off, and a sky without any stays as it is.
    let whole = |found: &Value, i: usize| found["rows"][i]["whole"]["relative_rms"]["value"].as_f64().unwrap();
    assert!(whole(&apart, 1) < 0.7 * whole(&found, 1), "{} {}", whole(&apart, 1), whole(&found, 1));
    assert_eq!(whole(&apart, 0), whole(&found, 0));
    let sum = |i: usize| -> f64 {
        let rows = apart["rows"][i]["budget_mean_square"].as_object().unwrap();
        rows.values().map(|v| v.as_f64().unwrap()).sum()
    };
    assert!((sum(1) - whole(&apart, 1).powi(2)).abs() < 1e-9, "{apart}");
    let text = bench.run(line);
    assert!(text.contains("truncation") && text.contains("its bands"), "{text}");
    for (line, code, word) in [
        ("compare bumpbox:32 --isovalue 47 --env gradient", 1, "isolume bake"),
        ("compare b.isolume --isovalue 30 --env gradient --points 50 --paths 4", 1, "never baked"),
        ("compare b.isolume --isovalue 47 --env gradiant", 1, "gradient"),
        ("compare b.isolume --isovalue 47 --env gradient --paths 5", 2, "power of two"),
    ] {
        let (found, _, said) = bench.outcome(line);
        assert!(found == code && said.contains(word), "{line}: {found}, {said}");
    }
}

#[test]
fn the_surface_itself_is_a_reference_and_normals_a_row() {
    let bench = Bench::new();
    bench.run("bake bumpbox:24 --isovalues 47 --rays 64 -o b.isolume");
    let line =
        "compare b.isolume --isovalue 47 --env gradient --points 300 --paths 64 --texel-rays 64 --against geometry";
    let found = bench.json(&format!("{line} --list-points"));
    let row = &found["rows"][0];
    let geometry = &row["geometry"];
    let number = |v: &Value| v.as_f64().unwrap();
    let total: f64 = row["budget_mean_square"].as_object().unwrap().values().map(number).sum();
    let rms = number(&geometry["store"]["relative_rms"]["value"]);
    assert!((total - rms * rms).abs() < 1e-9 && number(&row["budget_mean_square"]["normals"]) > 0.0, "{row}");
    let points = geometry["points"].as_array().unwrap();
    assert_eq!(points.len(), 300);
    let mean = points.iter().flat_map(|p| p["geometry"].as_array().unwrap()).map(number).sum::<f64>() / 900.0;
    assert!((mean / number(&geometry["mean_radiance"]) - 1.0).abs() < 1e-12, "{mean}");
    // Nothing is lost but by the rounding of drawn directions.
    assert!(10_000.0 * number(&geometry["lost"]) < number(&geometry["rays"]), "{geometry}");
    // A smooth field: smoothed normals change the mean by less than they do at a point.
    let bias = number(&geometry["normals_bias"]).abs();
    assert!(bias < number(&geometry["normals"]["relative_rms"]["value"]), "{geometry}");
    assert!(bias < 0.01 + 4.0 * number(&geometry["normals_bias_standard_error"]), "{geometry}");
    let text = bench.run(line);
    assert!(text.contains("Against the surface itself") && text.contains("300 points"), "{text}");
    assert_eq!(bench.json(line)["rows"][0]["geometry"]["points"].as_array().unwrap().len(), 0);
}

#[test]
fn photons_bake_compare_and_draw() {
    let bench = Bench::new();
    // A store that photons fill is one more store: what paths say of it is within the blur of the search.
    let baked = bench.json("bake bumpbox:24 --isovalues 47 --rays 64 --estimator photon -o p.isolume");
    let map = &baked["bake"]["photons"];
    // 24³ texels of 64 photons each, one for every 16 of them, but at least 2¹⁶.
    assert_eq!(map["sent"], 1 << 16, "{map}");
    assert!(
        map["bytes"].as_u64() == map["hits"].as_u64().map(|n| 36 * n) && map["hits"].as_u64() > Some(1000),
        "{map}"
    );
    assert!(map["energy_imbalance"].as_f64().unwrap() < 1e-6, "{map}");
    // What is there needs no map.
    assert!(
        bench.json("bake bumpbox:24 --isovalues 47 --rays 64 --estimator photon -o p.isolume")["bake"]["photons"]
            .is_null()
    );
    let line = "compare p.isolume --isovalue 47 --env gradient --points 100 --paths 64 --against photon --photons 200000 \
                --png p.png --glb p.glb --direct d.glb --size 60x40";
    let found = bench.json(line);
    let row = &found["rows"][0];
    let number = |v: &Value, path: &[&str]| path.iter().fold(v, |v, key| &v[key]).as_f64().unwrap();
    let store = number(row, &["whole", "relative_rms", "value"]);
    assert!((0.01..0.4).contains(&store), "{store}");
    assert!(number(row, &["whole", "bias", "value"]).abs() < 0.1, "{row}");
    let photons = &row["photons"];
    assert!(number(photons, &["photons_against_paths", "bias", "value"]).abs() < 0.03, "{photons}");
    assert!(number(&photons["energies"][0], &["imbalance"]) < 1e-6, "{photons}");
    // Published, and all light from the map: too dark by κ/κ_eff.
    let all = "--photon-light all --photon-isovalues extents";
    let dark = |estimate: &str| {
        let found = bench.json(&format!("{line} {all} --estimate {estimate} --gamma 0.2"));
        number(&found["rows"][0], &["photons", "photons_against_paths", "bias", "value"])
    };
    let (published, clipped, tilted) = (dark("published-4.9"), dark("published-4.10"), dark("tilted"));
    assert!(published < -0.3 && clipped < -0.15 && tilted.abs() < 0.15, "{published}, {clipped}, {tilted}");
    let png = bench.bytes("p.png");
    // Three panels of 60 pixels and four margins of 24.
    assert_eq!(&png[16..20], &(3 * 60 + 4 * 24u32).to_be_bytes());
    assert_eq!(&bench.bytes("p.glb")[..4], b"glTF");
    // Store, reference and their difference stand beside the colours; the reference is a file of its own.
    let difference = gltf::Gltf::from_slice(&bench.bytes("p.glb")).unwrap();
    let names: Vec<String> = difference
        .meshes()
        .flat_map(|mesh| {
            mesh.primitives()
                .flat_map(|p| p.attributes().map(|(n, _)| n.to_string()).collect::<Vec<_>>())
                .collect::<Vec<_>>()
        })
        .collect();
    assert!(["_STORE_R", "_REFERENCE_B", "_RADIANCE"].iter().all(|n| names.iter().any(|m| m == n)), "{names:?}");
    assert_eq!(&bench.bytes("d.glb")[..4], b"glTF");
    let table = bench.run(line);
    assert!(table.contains("store against photons") && table.contains("p.png") && table.contains("p.glb"), "{table}");
    bench.write("file", "no directory");
    for (line, word) in [
        ("compare p.isolume --isovalue 47 --env gradient --png p.jpg", ".png"),
        ("compare p.isolume --isovalue 47 --env gradient --glb x.glb --direct x.glb", "beside that of --glb"),
        ("compare p.isolume --isovalue 47 --env gradient --png file/p.png", "directory"),
        ("compare p.isolume --isovalue 47 --env gradient --env studio --png p.png", "{env}"),
        ("bake bumpbox:24 --estimator photon --error 1% -o q.isolume", "estimator path"),
    ] {
        let said = bench.refuses(line);
        assert!(said.contains(word), "{line}: {said}");
    }
}

#[test]
fn placements_are_studied() {
    let bench = Bench::new();
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/scenes/box.toml");
    let small =
        "--isovalue 47 --texture 12x12x12 --samples 100,1000 --points 20 --paths 4 --reference-paths 16 --repeats 2";
    let found = bench.json(&format!("study placements {scene} {small} -o s"));
    assert_eq!((&found["points"], &found["texture"][2]), (&Value::from(20), &Value::from(12)));
    let rows = found["rows"].as_array().unwrap();
    // Two weights and two numbers of samples each, but for the texels.
    assert_eq!(rows.len(), 8 * 4 + 1);
    let csv = String::from_utf8(bench.bytes("s/placements.csv")).unwrap();
    assert_eq!(csv.lines().count(), rows.len() + 1);
    assert!(csv.lines().all(|line| line.matches(',').count() == csv.lines().next().unwrap().matches(',').count()));
    assert!(rows[0]["placement"] == "texels" && rows[0]["samples"] == 1728 && rows[0]["empty"] == 0.0, "{}", rows[0]);
    for row in rows {
        let (rms, traced) = (row["rms_percent"]["mean"].as_f64().unwrap(), row["traced"].as_u64().unwrap());
        assert!(rms > 0.0 && rms < 100.0 && traced > 0 && traced <= row["samples"].as_u64().unwrap(), "{row}");
    }
    // A volume under an environment; and the table.
    let text =
        bench.run(&format!("study placements bumpbox:12 --env gradient {small} --placements uniform,level-sets -o t"));
    assert!(text.contains("level sets") && text.contains("noise of a sample") && !text.contains("diagonal"), "{text}");
    for (line, code, word) in [
        ("study placements bumpbox:12 --isovalue 47", 1, "luminaire"),
        ("study placements bumpbox:12 --env gradient --placements random", 2, "many-level-sets"),
        ("study placements absent.toml", 1, "absent.toml"),
        (
            "study placements sphere:12 --env sky --placements level-sets-9 --samples 10",
            1,
            "no sample lies on a level set",
        ),
        ("study placements bumpbox:12 --env gradient --neighbours 0 --points 2 --samples 10", 1, "neighbours"),
        ("study", 2, "VOLUME"),
    ] {
        let (found, _, said) = bench.outcome(line);
        assert!(found == code && said.contains(word), "{line}: {found}, {said}");
    }
}

/// A bump box under a lamp in a room, of which one wall has this albedo.
fn room(albedo: f64) -> String {
    format!(
        "volume = \"bumpbox:16\"\nmetres_per_unit = 1.0\nisovalues = [47]\n[bake]\nrays = 16\nlayers = 3\nbands = 2\n\
         [[walls]]\nname = \"room\"\nshape = \"room\"\nmin = [0, 0, 0]\nmax = [1, 1, 1]\nalbedo = 0.5\nopen = [\"+z\"]\n\
         faces = {{ \"-x\" = [{albedo}, 0.1, 0.1] }}\n[[luminaires]]\nname = \"lamp\"\nshape = \"rectangle\"\n\
         corner = [0.3, 0.0, 0.3]\nu = [0.0, 0.0, 0.4]\nv = [0.4, 0.0, 0.0]\npower = 3\n"
    )
}

/// Photons of so many sources keep their power, and agree with paths: 100 points of 16 paths and coarse fields leave some percent.
fn check_photons(found: &Value, sources: usize) {
    for row in found["rows"].as_array().expect("rows") {
        let photons = &row["photons"];
        let energies = photons["energies"].as_array().expect("energies");
        assert_eq!(energies.len(), sources);
        for energy in energies {
            assert!(energy["imbalance"].as_f64().is_some_and(|v| v < 1e-6), "{energy}");
        }
        let bias = &photons["photons_against_paths"]["bias"];
        let [value, half] = ["value", "half_interval_95"].map(|key| bias[key].as_f64().expect("a number"));
        assert!(value.abs() < 0.08 + 2.0 * half, "{photons}");
    }
}

/// Of every row of a comparison the rows of its budget sum to the square of its error; the mean radiances.
fn means_of_sums(found: &Value) -> Vec<f64> {
    let rows = found["rows"].as_array().expect("rows").iter();
    let mean = |row: &Value| {
        let parts = row["budget_mean_square"].as_object().expect("a budget");
        let total: f64 = parts.values().filter_map(Value::as_f64).sum();
        let rms = row["whole"]["relative_rms"]["value"].as_f64().expect("a number");
        assert!(parts.len() == 5 && (total - rms * rms).abs() < 1e-9, "{row}");
        row["mean_radiance"].as_f64().expect("a number")
    };
    rows.map(mean).collect()
}

#[test]
fn a_scene_is_compared_with_the_walls_that_it_was_baked_of() {
    let bench = Bench::new();
    bench.write("room.toml", room(0.6));
    bench.write("other.toml", room(0.3));
    bench.run("bake room.toml -o r.isolume");
    let line = "compare r.isolume --isovalue 47 --points 100 --paths 16 --texel-rays 32";
    let both = bench.json(&format!("{line} --scene room.toml --env constant:0 --env gradient --env constant:0"));
    let means = means_of_sums(&both);
    assert!(means[1] > means[0] && means[0] == means[2], "{means:?}");
    // The lamp alone, which is the light of a store that has one; all is linear in its power.
    let (once, twice) = ("--scene room.toml", "--scene room.toml --luminaire lamp=2");
    let [once, twice] = [once, twice].map(|scene| means_of_sums(&bench.json(&format!("{line} {scene}")))[0]);
    assert!(once == means[0] && (twice / once - 2.0).abs() < 1e-9, "{once} {twice}");
    for (rest, words) in [
        ("", "--scene"),
        ("--scene other.toml", "fingerprint"),
        ("--scene absent.toml", "absent.toml"),
        ("--scene room.toml --luminaire lam=2", "did you mean lamp?"),
        ("--scene room.toml --against photon --emission 1", "emits"),
        ("--scene room.toml --volume bumps", "one alone"),
    ] {
        let said = bench.refuses(&format!("{line} {rest}"));
        assert!(said.contains(words), "{rest}: {said}");
    }
    // Photons of the lamp and of the environment that comes in by the open side: their power is kept, and they agree with paths.
    let found = bench.json(&format!("{line} --scene room.toml --env gradient --against photon --photons 200000"));
    check_photons(&found, 2);
    // A volume alone has no walls.
    bench.run("bake bumpbox:16 --isovalues 47 --rays 4 --layers 1 --bands 1 -o alone.isolume");
    let said = bench.refuses("compare alone.isolume --isovalue 47 --env constant --scene room.toml");
    assert!(said.contains("those of the store: none"), "{said}");
}

#[test]
fn volumes_baked_together_are_compared_each_among_the_others() {
    let bench = Bench::new();
    bench.write(
        "pair.toml",
        "coupling = [[47, 0.6]]\n[bake]\nrays = 16\nlayers = 3\nbands = 3\n[[volumes]]\nname = \"bumps\"\n\
         volume = \"bumpbox:16\"\n[[volumes]]\nname = \"gyroid\"\nvolume = \"gyroid:12\"\nscale = 0.3\n\
         translate = [0.35, 0.08, 0.35]\nalbedo = [0.3, 0.5, 1.0]\n[probe]\nname = \"sky\"\n",
    );
    bench.run("bake pair.toml -o p.isolume");
    let line = "compare p.isolume --env gradient --points 100 --paths 16 --texel-rays 32";
    let found = bench.json(&format!("{line} --isovalue 47"));
    let names: Vec<&str> =
        found["rows"].as_array().expect("rows").iter().filter_map(|r| r["volume"].as_str()).collect();
    let means = means_of_sums(&found);
    assert!(names == ["bumps", "gyroid"] && means.iter().all(|m| *m > 0.0), "{names:?} {means:?}");
    assert_eq!(found["rows"][1]["isovalue"].as_f64(), Some(0.6));
    // The same by the name of the other, alone; its description says no more than the store.
    for rest in ["--isovalue gyroid=0.6", "--isovalue 0.6 --volume gyroid", "--isovalue 47 --scene pair.toml"] {
        let again = bench.json(&format!("{line} {rest}"));
        assert_eq!(means_of_sums(&again).last(), means.last(), "{rest}");
    }
    for (rest, words) in [("--isovalue 30", "no partner"), ("--isovalue 47 --png x.png", "--volume NAME")] {
        let said = bench.refuses(&format!("{line} {rest}"));
        assert!(said.contains(words), "{rest}: {said}");
    }
    check_photons(&bench.json(&format!("{line} --isovalue 47 --against photon --photons 200000")), 1);
    bench.run(&format!("{line} --isovalue 0.6 --volume gyroid --png x.png --size 30x20"));
    assert!(bench.bytes("x.png").len() > 100);
}

#[test]
fn scenes_are_studied_and_forecast() {
    let bench = Bench::new();
    bench.write("room.toml", room(0.6));
    let study = "study room.toml --isovalue 47 --quick --points 20 --paths 4 --texel-rays 4 --most-rays 16";
    let found = bench.json(&format!("{study} -o s"));
    let rows = found["rows"].as_array().expect("rows");
    // Photons are not baked among walls.
    let by = |name: &str| rows.iter().filter(|row| row["estimator"] == name).count();
    assert!(by("path") > 1 && by("gather") == 1 && by("path") + by("gather") == rows.len(), "{found}");
    let sum = |row: &Value| {
        row["budget_mean_square"].as_object().expect("a budget").values().filter_map(Value::as_f64).sum::<f64>()
    };
    assert!(rows.iter().all(|row| (sum(row) - row["rms"].as_f64().expect("a number").powi(2)).abs() < 1e-9), "{found}");
    assert_eq!(found["environment"], "constant:0");
    let plan = bench.json("plan room.toml --time 1h");
    let chosen = &plan["forecast"]["chosen"];
    assert!(chosen["rays"].as_u64() >= Some(4) && chosen["error"].as_f64() > Some(0.0), "{chosen}");
    // An hour is time enough wherever the test runs, and what is chosen is baked.
    bench.run("bake room.toml --auto 1h -o a.isolume");
    assert!(bench.path("a.isolume/zarr.json").exists());
}
