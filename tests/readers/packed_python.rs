//! Packed stores opened by zarr-python 3 with the codecs that it brings: the numbers that its recipe gives are those that are read here, bit
//! by bit. Runs and skips as `store_python`.

use super::python;
use half::f16;
use isolume::transfer::store::{PackError, Store, StoreOptions};
use isolume::transfer::{BRICK_TEXELS, BrickSource};
use std::path::Path;
use std::process::Command;

const SCRIPT: &str = r#"
import json, sys, warnings
import numpy, zarr
warnings.simplefilter("error")

def transfer(group, c):
    """Chunk c as float16 [place, coefficient], NaN where nothing was baked; places by brick, then by texel."""
    packing, layers = group.attrs["packing"], json.loads(sys.argv[3])
    blocks = group["low"].chunks[0]
    here = slice(c * blocks, (c + 1) * blocks)
    q = 256 * group["high"][here].astype("i4") + group["low"][here]      # [block, coefficient, place], baked ones first
    q = numpy.moveaxis(q, 1, 2).reshape(-1, q.shape[1])
    weight = numpy.repeat(packing["layer_weights"], layers)
    baked = (group["validity"][here].ravel() & 16) != 0
    found = numpy.full(q.shape, numpy.nan, "f2")
    found[baked] = (q[: baked.sum()] * packing["step"] / weight).astype("f2")
    return found

root = zarr.open_group(sys.argv[1], mode="r")
for place, file in json.loads(sys.argv[2]):
    group = root[place]
    assert {"high", "low", "rays", "stderr", "validity"} <= set(group.array_keys()) and "transfer" not in group, place
    chunks = group["low"].shape[0] // group["low"].chunks[0]
    found = numpy.concatenate([transfer(group, c) for c in range(chunks)])
    expected = numpy.fromfile(file, "f2").reshape(found.shape)
    assert (numpy.isnan(found) == numpy.isnan(expected)).all(), place
    held = ~numpy.isnan(expected)
    assert held.any() and (found[held] == expected[held]).all(), place
    baked = (group["validity"][:].reshape(chunks, -1) & 16).astype(bool).sum(1)
    assert (group["rays"][:].reshape(chunks, -1).astype(bool).sum(1) <= baked).all()
    assert numpy.isfinite(group["stderr"][:]).all() or chunks > 1
print("zarr", zarr.__version__)
"#;

/// All numbers of a store, chunk by chunk in the order of its bricks.
fn write_numbers(store: &Store, path: &Path) {
    let (lattice, n) = (store.layout().lattice, store.layout().layers.coefficients());
    let [cx, cy, cz] = lattice.chunks();
    let slots: usize = lattice.bricks_of_chunk().iter().product();
    let mut all: Vec<f16> = Vec::new();
    for c in 0..cx * cy * cz {
        for slot in 0..slots {
            let index = lattice.brick_in_chunk([c % cx, c / cx % cy, c / cx / cy], slot);
            let inside = (0..3).all(|a| index[a] < lattice.bricks()[a]);
            match if inside { store.brick(index).unwrap() } else { None } {
                Some(brick) => all.extend(brick.transfer),
                None => all.extend(std::iter::repeat_n(f16::NAN, BRICK_TEXELS * n)),
            }
        }
    }
    std::fs::write(path, all.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>()).unwrap();
}

#[test]
fn python_reads_packed_numbers_by_the_recipe() {
    let Some(python) = python("import zarr; assert zarr.__version__ >= '3'") else {
        println!("skipped: no Python with zarr 3 (set ISOLUME_PYTHON to an interpreter that has it)");
        return;
    };
    let directory = tempfile::tempdir().unwrap();
    let at = |name: &str| directory.path().join(name);
    for texture in [&["--texture", "1"][..], &[]] {
        let mut bake = Command::new(env!("CARGO_BIN_EXE_isolume"));
        bake.args(["bake", "-q", "bumpbox:36", "--isovalues", "30", "--bands", "4,2", "--rays", "16", "-o"]);
        assert!(bake.arg(at("plain.isolume")).args(texture).status().unwrap().success());
    }
    let plain = Store::open(at("plain.isolume")).unwrap();
    // Of the small error most numbers need two bytes.
    for error in [0.05, 0.002] {
        let path = at(&format!("packed-{error}.isolume"));
        let (packed, _) = StoreOptions::default().pack(&plain, &path, PackError::Relative(error)).unwrap();
        let surface = packed.surface(30.0).unwrap().unwrap();
        let (texture, vertices) = (at("texture.f2"), at("vertices.f2"));
        write_numbers(&packed, &texture);
        write_numbers(&surface, &vertices);
        let places = serde_json::json!([["transfer/bumpbox/env", texture], ["surfaces/bumpbox/30", vertices]]);
        let run = Command::new(&python)
            .args(["-c", SCRIPT])
            .arg(&path)
            .args([&places.to_string(), "[16, 4]"])
            .output()
            .unwrap();
        let (out, err) = (String::from_utf8_lossy(&run.stdout), String::from_utf8_lossy(&run.stderr));
        assert!(run.status.success(), "{out}{err}");
    }
}
