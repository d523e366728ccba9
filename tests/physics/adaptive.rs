//! Textures that leave out what can be interpolated (VALIDATION.md, 25).

use isolume::bake::{Bake, Silent};
use isolume::scene::{Scene, TextureSize};
use isolume::transfer::{BRICK_TEXELS, BrickSource, store::Store, validity};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const ERROR: f64 = 0.04;
const ADAPTIVE: TextureSize = adaptive(ERROR, 2.0);

const fn adaptive(error: f64, ratio: f64) -> TextureSize {
    TextureSize::Adaptive { error, ratio }
}

fn bake(scene: &Scene) -> Bake<'_> {
    Bake::of(scene).layers(2).bands(3).rays(64)
}

/// The files of the texture of a store.
fn files(store: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    let mut folders = vec![store.join("transfer")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap().map(Result::unwrap) {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else {
                all.insert(path.strip_prefix(store).unwrap().to_owned(), std::fs::read(&path).unwrap());
            }
        }
    }
    all
}

fn bricks(store: &Store) -> Vec<[usize; 3]> {
    let [x, y, z] = store.layout().lattice.bricks();
    (0..x * y * z).map(|i| [i % x, i / x % y, i / x / y]).collect()
}

#[test]
fn an_adaptive_texture_is_as_exact_as_asked_and_its_texels_are_those_of_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let scene = Scene::open("bumpbox:25").unwrap();
    let (whole, _) = bake(&scene).texture(2.0).run(folder.path().join("whole.isolume"), &Silent).unwrap();
    let path = folder.path().join("adaptive.isolume");
    let (some, reports) = bake(&scene).texture(ADAPTIVE).run(&path, &Silent).unwrap();

    let layers = whole.layout().layers.clone();
    let (n, e) = (layers.coefficients(), layers.errors());
    let weight = |k: usize| 0.7f64.powi(k as i32 + 1);
    let (mut squares, mut differences, mut noise) = (0.0, 0.0, 0.0);
    let (mut traced, mut filled) = (0u64, 0u64);
    for index in bricks(&whole) {
        let all = whole.brick(index).unwrap().unwrap();
        let some = some.brick(index).unwrap().unwrap();
        for t in 0..BRICK_TEXELS {
            let (a, b) = (&all.transfer[t * n..(t + 1) * n], &some.transfer[t * n..(t + 1) * n]);
            if a[0].is_nan() {
                continue; // beyond the lattice
            }
            assert!(!b[0].is_nan(), "a hole in {index:?}");
            if some.validity[t] & validity::FILLED == 0 {
                traced += 1;
                assert!(a == b && all.rays[t] == some.rays[t] && all.validity[t] == some.validity[t]);
                continue;
            }
            filled += 1;
            for (k, &bands) in layers.bands().iter().enumerate() {
                for i in layers.offset(k)..layers.offset(k) + bands * bands {
                    squares += (weight(k) * a[i].to_f64()).powi(2);
                    differences += (weight(k) * (a[i].to_f64() - b[i].to_f64())).powi(2);
                }
                for l in 0..bands {
                    let error = |brick: &[half::f16]| brick[t * e + layers.error_offset(k) + l].to_f64().powi(2);
                    noise += weight(k).powi(2) * (2 * l + 1) as f64 * (error(all.stderr) + error(some.stderr));
                }
            }
        }
    }
    let summary = &reports[0].summary;
    assert_eq!((summary.texels, summary.left_out), (traced, filled));
    // The box of bumps is smooth: a quarter of the texels of a lattice twice as fine as the data are plenty.
    assert!(traced * 4 < traced + filled, "{traced} traced, {filled} interpolated");
    // Noise of both is known to a few percent; it is left in where it is not.
    let error = ((differences - 0.9 * noise).max(0.0) / squares).sqrt();
    assert!(error < ERROR, "{error} instead of {ERROR}");

    // Threads and shares.
    let first = files(&path);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    let other = folder.path().join("threads.isolume");
    pool.install(|| bake(&scene).texture(ADAPTIVE).run(&other, &Silent)).unwrap();
    assert!(files(&other) == first, "three threads wrote other bytes");
    let shared = folder.path().join("shares.isolume");
    for i in [2, 1] {
        bake(&scene).texture(ADAPTIVE).share(i, 2).unwrap().run(&shared, &Silent).unwrap();
    }
    assert!(files(&shared) == first, "two shares wrote other bytes");
    // Baked once more nothing is left to do.
    let (_, again) = bake(&scene).texture(ADAPTIVE).run(&path, &Silent).unwrap();
    assert_eq!((again[0].chunks_baked, again[0].summary.texels), (0, 0));
    // A texture of all texels, or of another error, is another store.
    for other in [bake(&scene).texture(2.0), bake(&scene).texture(adaptive(0.01, 2.0))] {
        let error = other.run(&path, &Silent).unwrap_err().to_string();
        assert!(error.contains("texture") && error.contains("adaptive:0.04"), "{error}");
    }
}

#[test]
fn what_an_adaptive_texture_cannot_be_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let scene = Scene::open("bumpbox:8").unwrap();
    let path = folder.path().join("x.isolume");
    for (bake, name) in [
        (bake(&scene).texture(adaptive(0.0, 2.0)), "texture"),
        (bake(&scene).texture(adaptive(f64::NAN, 2.0)), "texture"),
        (bake(&scene).texture(adaptive(0.02, 0.0)), "texture"),
        (bake(&scene).texture(adaptive(0.02, 2.0)).isovalues([47.0]), "isovalues"),
        (bake(&scene).texture(adaptive(0.02, 2.0)).estimator(isolume::bake::Estimator::Gather), "estimator gather"),
    ] {
        let error = bake.run(&path, &Silent).unwrap_err().to_string();
        assert!(error.starts_with(name) && !path.exists(), "{error}");
    }
}
