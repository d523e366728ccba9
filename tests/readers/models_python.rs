//! Trees at random against an evaluator that was written apart from this one, in Python (`models.py`): by definition, with
//! bisection for smooth set operations and Simpson's rule for convolution.

use super::python;
use isolume::glam::DVec3;
use isolume::scene::{ModelName, describe};
use std::path::Path;
use std::process::Command;

#[test]
fn models_have_the_values_of_an_independent_evaluator() {
    let Some(python) = python("import math, random") else {
        println!("skipped: no Python (set ISOLUME_PYTHON)");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/readers/models.py");
    let count = 150;
    let run = Command::new(python).arg(script).arg(folder.path()).arg(count.to_string()).output().expect("it runs");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let (mut compared, mut refused) = (0, 0);
    for i in 0..count {
        let path = folder.path().join(format!("{i}.toml"));
        let name = path.display().to_string();
        let model = match describe(&ModelName::of(&name).expect("a model"), false) {
            Ok(model) => model,
            // What reaches beyond the axis of a bend is refused.
            Err(e) if e.to_string().contains("axis of the bend") => {
                refused += 1;
                continue;
            }
            Err(e) => panic!("{e}"),
        };
        let text = std::fs::read_to_string(path.with_extension("txt")).expect("values");
        for line in text.lines() {
            let numbers: Vec<f64> = line.split(' ').map(|w| w.parse().expect("a number")).collect();
            let [x, y, z, expected] = numbers[..] else { panic!("{line}") };
            let found = model.tree.value(DVec3::new(x, y, z));
            // Simpson's rule with 2000 steps is good to 1e-11; powers of differences near 0 lose the most.
            assert!((found - expected).abs() < 1e-9 * expected.abs().max(1.0), "{i}: {found} for {line}");
            compared += 1;
        }
    }
    assert!(compared > 4000 && refused < 20, "{compared} values compared, {refused} models refused");
}
