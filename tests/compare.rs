//! `isolume compare` through the program.

use assert_cmd::Command;
use serde_json::Value;

#[test]
fn a_store_is_compared_and_the_budget_sums() {
    let directory = tempfile::tempdir().unwrap();
    let run = |line: &str| {
        let mut command = Command::cargo_bin("isolume").unwrap();
        command.current_dir(directory.path()).args(line.split_whitespace()).output().unwrap()
    };
    assert!(run("bake bumpbox:32 --isovalues 47 --rays 64 -o b.isolume").status.success());
    let line =
        "compare b.isolume --isovalue 47 --env gradient --env sun:30,50,20 --points 200 --paths 64 --texel-rays 256";
    let output = run(&format!("{line} --json"));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
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
    let text = String::from_utf8(run(line).stdout).unwrap();
    assert!(text.contains("truncation") && text.contains("its bands"), "{text}");
    for (line, code, word) in [
        ("compare bumpbox:32 --isovalue 47 --env gradient", 1, "isolume bake"),
        ("compare b.isolume --isovalue 30 --env gradient --points 50 --paths 4", 1, "never baked"),
        ("compare b.isolume --isovalue 47 --env gradiant", 1, "gradient"),
        ("compare b.isolume --isovalue 47 --env gradient --paths 5", 2, "power of two"),
    ] {
        let output = run(line);
        assert_eq!(output.status.code(), Some(code), "{line}");
        assert!(String::from_utf8_lossy(&output.stderr).contains(word), "{line}: {output:?}");
    }
}
