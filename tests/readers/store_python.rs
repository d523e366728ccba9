//! Stores opened by others: zarr-python 3 and, if it is there, xarray. Runs with the interpreter
//! that ISOLUME_PYTHON names, `python3` otherwise, and skips where it has no zarr.

use super::python;
use glam::DVec3;
use half::f16;
use isolume::geom::Affine;
use isolume::transfer::store::{ChunkExtent, Identity, Store, pack_zip};
use isolume::transfer::{Brick, Lattice, Layers, Layout};
use isolume::volume::{Samples, Volume};
use std::process::Command;

/// What the store must look like from Python; the values are those of `write`.
const SCRIPT: &str = r#"
import sys, warnings
import numpy, zarr
warnings.simplefilter("error")  # A reader that has to warn is a reader that stumbled.

def check(group, where):
    data = group["volumes/blob/data"]
    z, y, x = numpy.meshgrid(range(70), range(12), range(40), indexing="ij")
    assert data.shape == (70, 12, 40) and data.dtype == numpy.int16, (where, data)
    assert (data[:] == (x + 40 * (y + 12 * z)) % 30000 - 100).all(), where
    assert data.attrs["affine"][1] == [0.0, 0.1, 0.0, 1 / 3], data.attrs["affine"]
    assert data.attrs["solid"] == "above" and data.attrs["up"] == "z" and data.attrs["name"] == "blob"
    assert data.metadata.dimension_names == ("z", "y", "x")

    env = group["transfer/blob/env"]
    assert env.attrs["identity"]["bands"] == [3, 1] and env.attrs["identity"]["seed"] == 2**64 - 1
    assert env.attrs["layers"][1] == {"bands": 1, "offset": 9, "stderr_offset": 3}
    assert env.attrs["provenance"]["tenth"] == 0.1
    assert abs(env.attrs["world_from_texel"][0][0] - 1) < 1e-15  # Spacing 20/39, 39/20 samples a texel.
    expected = {
        "transfer": ("float16", (36, 7, 21, 10), ("z", "y", "x", "coefficient")),
        "stderr": ("float16", (36, 7, 21, 4), ("z", "y", "x", "layer_band")),
        "validity": ("uint8", (36, 7, 21), ("z", "y", "x")),
        "rays": ("uint32", (36, 7, 21), ("z", "y", "x")),
    }
    for name, (dtype, shape, dims) in expected.items():
        array = env[name]
        assert array.dtype == dtype and array.shape == shape, (where, name, array)
        assert array.metadata.dimension_names == dims and array.shards[:3] == (32, 32, 32), (where, name)
        assert array.chunks[:3] == (8, 8, 8), (where, name)
    assert numpy.isnan(env["transfer"].fill_value) and env["rays"].fill_value == 0

    # Brick (1, 0, 2) of the first chunk is baked: texels x 8…15, y 0…7, z 16…23. Nothing else is.
    z, y, x, c = numpy.meshgrid(range(36), range(7), range(21), range(10), indexing="ij")
    baked = (x // 8 == 1) & (z // 8 == 2)
    value = (c + 16 * (x % 8) + 128 * (y % 8)).astype(numpy.float16) + (z % 8) / 1024
    transfer = env["transfer"][:]
    assert numpy.isnan(transfer[~baked]).all() and (transfer[baked] == value[baked].astype(numpy.float16)).all(), where
    stderr, validity, rays = env["stderr"][:], env["validity"][:], env["rays"][:]
    inside = baked[..., 0]
    assert numpy.isnan(stderr[~inside]).all() and (stderr[inside] == [0, 0.25, 0.5, 0.75]).all(), where
    assert (validity == inside).all(), where
    texel = ((x % 8) + 8 * ((y % 8) + 8 * (z % 8)))[..., 0]
    assert (rays == numpy.where(inside, 70000 + texel, 0)).all(), where
    # One texel alone, through the index of the shard.
    assert (env["transfer"][17, 3, 9] == transfer[17, 3, 9]).all()

path, archive = sys.argv[1:]
root = zarr.open_group(path, mode="r")
check(root, "consolidated")
assert sorted(root["transfer/blob/env"].array_keys()) == ["rays", "stderr", "transfer", "validity"]
assert len(str(root.tree())) > 0 if hasattr(root, "tree") else True
walked = zarr.open_group(path, mode="r", use_consolidated=False)
check(walked, "walked")
# What is no part of Zarr lies where a walk does not come by.
assert len(list(zarr.open_group(path + "/transfer/blob/env", mode="r").members())) == 4
assert len(list(walked.members(max_depth=None))) == 10, [name for name, _ in walked.members(max_depth=None)]
check(zarr.open_group(zarr.storage.ZipStore(archive, mode="r"), mode="r"), "zip")
print("zarr", zarr.__version__)
try:
    import xarray
except ImportError:
    print("no xarray")
else:
    env = xarray.open_zarr(path, group="transfer/blob/env")
    assert dict(env.sizes) == {"z": 36, "y": 7, "x": 21, "coefficient": 10, "layer_band": 4}, env.sizes
    assert env.transfer.dtype == numpy.float16 and env.rays.dtype == numpy.uint32, env
    assert int(env.validity.sum()) == 8 * 7 * 8
    tree = xarray.open_datatree(path, engine="zarr")
    assert tree["volumes/blob/data"].shape == (70, 12, 40)
    print("xarray", xarray.__version__)
"#;

#[test]
fn python_reads_what_was_written() {
    let Some(python) = python("import zarr; assert zarr.__version__ >= '3'") else {
        println!("skipped: no Python with zarr 3 (set ISOLUME_PYTHON to an interpreter that has it)");
        return;
    };
    let directory = tempfile::tempdir().unwrap();
    let (path, archive) = (directory.path().join("blob.isolume"), directory.path().join("blob.zip"));
    write(&path);
    pack_zip(&path, &archive).unwrap();
    let run = Command::new(python).arg("-c").arg(SCRIPT).arg(&path).arg(&archive).output().unwrap();
    let (out, err) = (String::from_utf8_lossy(&run.stdout), String::from_utf8_lossy(&run.stderr));
    assert!(run.status.success(), "{out}{err}");
    println!("{out}");
}

fn write(path: &std::path::Path) {
    let dims = [40, 12, 70];
    let samples = (0..40 * 12 * 70).map(|i| (i % 30000) as i16 - 100).collect();
    let affine = Affine::from_spacing(DVec3::new(20.0 / 39.0, 0.1, 2.0), DVec3::new(0.0, 1.0 / 3.0, 0.0)).unwrap();
    let mut volume = Volume::new(dims, Samples::I16(samples), affine).unwrap();
    volume.name = "blob".into();
    let layout =
        Layout { lattice: Lattice::from_texels(dims, [21, 7, 36]).unwrap(), layers: Layers::new(vec![3, 1]).unwrap() };
    let identity = Identity::new(&volume, &layout, "path", false, u64::MAX);
    let store = Store::create(path, &volume, &identity, serde_json::json!({ "tenth": 0.1 })).unwrap();
    let mut brick = Brick::unbaked(&layout.layers);
    for texel in 0..512 {
        let [x, y, z] = [texel % 8, texel / 8 % 8, texel / 64];
        for c in 0..10 {
            let value = f16::from_f64((c + 16 * x + 128 * y) as f64);
            brick.transfer[10 * texel + c] = f16::from_f64(value.to_f64() + z as f64 / 1024.0);
        }
        for band in 0..4 {
            brick.stderr[4 * texel + band] = f16::from_f64(band as f64 / 4.0);
        }
        brick.validity[texel] = 1;
        brick.rays[texel] = 70000 + texel as u32;
    }
    let mut bricks = vec![None; 64];
    bricks[1 + 16 * 2] = Some(brick);
    let extent = ChunkExtent::new(None, 64, None);
    store.write_chunk([0; 3], bricks, &extent).unwrap();
    // A chunk in which nothing had to be baked: a shard without bricks.
    store.write_chunk([0, 0, 1], vec![None; 64], &extent).unwrap();
}
