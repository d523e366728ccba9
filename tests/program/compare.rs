//! `isolume compare` through the program.

use crate::common::program::Bench;
use serde_json::Value;

#[test]
fn a_store_is_compared_and_the_budget_sums() {
    let bench = Bench::new();
    bench.run("bake bumpbox:32 --isovalues 47 --rays 64 -o b.isolume");
    let line =
        "compare b.isolume --isovalue 47 --env gradient --env sun:30,50,20 --points 200 --paths 64 --texel-rays 256";
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
fn photons_bake_compare_and_draw() {
    let bench = Bench::new();
    // A store that photons fill is one more store: what paths say of it is within the blur of the search.
    let baked = bench.json("bake bumpbox:24 --isovalues 47 --rays 64 --estimator photon -o p.isolume");
    let map = &baked["bake"]["photons"];
    // 24³ texels of 64 photons each, one for every 16 of them, but at least 2¹⁶.
    assert_eq!(map["sent"], 1 << 16, "{map}");
    assert!(
        map["bytes"].as_u64() == map["hits"].as_u64().map(|n| 40 * n) && map["hits"].as_u64() > Some(1000),
        "{map}"
    );
    assert!(map["energy_imbalance"].as_f64().unwrap() < 1e-6, "{map}");
    // What is there needs no map.
    assert!(
        bench.json("bake bumpbox:24 --isovalues 47 --rays 64 --estimator photon -o p.isolume")["bake"]["photons"]
            .is_null()
    );
    let line = "compare p.isolume --isovalue 47 --env gradient --points 100 --paths 64 --against photon --photons 200000 \
                --png p.png --glb p.glb --size 60x40";
    let found = bench.json(line);
    let row = &found["rows"][0];
    let number = |v: &Value, path: &[&str]| path.iter().fold(v, |v, key| &v[key]).as_f64().unwrap();
    let store = number(row, &["whole", "relative_rms", "value"]);
    assert!((0.01..0.4).contains(&store), "{store}");
    assert!(number(row, &["whole", "bias", "value"]).abs() < 0.1, "{row}");
    let photons = &row["photons"];
    assert!(number(photons, &["photons_against_paths", "bias", "value"]).abs() < 0.03, "{photons}");
    assert!(number(photons, &["energy", "imbalance"]) < 1e-6, "{photons}");
    // Published, and all light from the map: too dark by κ/κ_eff.
    let all = "--photon-light all --photon-isovalues extents";
    let dark = |estimate: &str| {
        let found = bench.json(&format!("{line} {all} --estimate {estimate} --gamma 0.2"));
        number(&found["rows"][0], &["photons", "photons_against_paths", "bias", "value"])
    };
    let (published, tilted) = (dark("published"), dark("tilted"));
    assert!(published < -0.3 && tilted.abs() < 0.15, "{published}, {tilted}");
    let png = bench.bytes("p.png");
    // Three panels of 60 pixels and four margins of 24.
    assert_eq!(&png[16..20], &(3 * 60 + 4 * 24u32).to_be_bytes());
    assert_eq!(&bench.bytes("p.glb")[..4], b"glTF");
    let table = bench.run(line);
    assert!(table.contains("store against photons") && table.contains("p.png") && table.contains("p.glb"), "{table}");
    bench.write("file", "no directory");
    for (line, word) in [
        ("compare p.isolume --isovalue 47 --env gradient --png p.jpg", ".png"),
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
    assert_eq!(rows.len(), 6 * 4 + 1);
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
        ("study placements bumpbox:12 --env gradient --neighbours 0 --points 2 --samples 10", 1, "neighbours"),
        ("study", 2, "VOLUME"),
    ] {
        let (found, _, said) = bench.outcome(line);
        assert!(found == code && said.contains(word), "{line}: {found}, {said}");
    }
}
