//! Surfaces in a store: meshes, chunks of vertices, and check points come back; what is damaged or of another mesh does not.

use super::*;
use crate::surface::Mesh;
use crate::transfer::checks::CheckPoints;
use crate::transfer::{CHUNK_VERTICES, Group};

/// A strip of triangles through more vertices than a chunk has.
fn mesh(vertices: usize) -> Mesh {
    let mut numbers = Numbers(vertices as u64);
    let positions_in_grid =
        (0..vertices).map(|i| [i as f32 / 200.0, (numbers.below(11000) as f32) / 1000.0, 3.5]).collect();
    let triangles = (0..vertices as u32 - 2).map(|i| [i, i + 1, i + 2]).collect();
    Mesh { positions_in_grid, normals: vec![[0.0, 0.6, 0.8]; vertices], triangles }
}

const VERTICES: usize = CHUNK_VERTICES + 700;

/// A store with a surface whose second chunk is baked; the first brick of it is missing.
fn with_surface(directory: &Path) -> (PathBuf, Store, Store) {
    let path = directory.join("x.isolume");
    let store = Store::create(&path, &volume(), &identity(), provenance()).unwrap();
    let surface = store.open_or_add_surface(-0.25, &mesh(VERTICES), volume().world_from_grid(), false).unwrap();
    let bricks = (0..8).map(|slot| (slot == 1).then(|| brick(slot))).collect();
    surface.write_chunk([1, 0, 0], bricks, &ChunkExtent::new(Some(-0.25), 64, None)).unwrap();
    (path, store, surface)
}

#[test]
fn a_surface_comes_back_with_its_mesh_and_its_vertices() {
    let directory = tempfile::tempdir().unwrap();
    let (path, store, _) = with_surface(directory.path());
    assert_eq!(store.surfaces().unwrap(), [-0.25]);
    let read = |store: &Store| {
        let surface = store.surface(-0.25).unwrap().unwrap();
        assert_eq!((surface.isovalue(), surface.layout().lattice.texels()), (Some(-0.25), [VERTICES, 1, 1]));
        assert!(surface.mesh().unwrap() == Some(mesh(VERTICES)));
        let found = surface.brick([9, 0, 0]).unwrap().unwrap().to_brick();
        assert_eq!(bytes_of(&[Some(found)]), bytes_of(&[Some(brick(1))]));
        assert!(surface.brick([8, 0, 0]).unwrap().is_none() && surface.brick([0, 0, 0]).unwrap().is_none());
        assert!(surface.surfaces().unwrap().is_empty() && !surface.is_complete().unwrap());
        assert_eq!(store.holdings().unwrap().surfaces, [-0.25]);
        assert!(store.holdings().unwrap().in_texture.is_empty());
    };
    read(&Store::open(&path).unwrap());
    assert!(store.surface(0.25).unwrap().is_none() && store.mesh().unwrap().is_none());
    let archive = directory.path().join("x.zip");
    pack_zip(&path, &archive).unwrap();
    read(&Store::open(&archive).unwrap());
    // The same mesh again changes nothing; readers of Zarr find all of it in the root.
    let before = files(&path);
    store.open_or_add_surface(-0.25, &mesh(VERTICES), volume().world_from_grid(), false).unwrap();
    assert!(files(&path) == before);
    let root: Value = serde_json::from_slice(&fs::read(path.join("zarr.json")).unwrap()).unwrap();
    let listed = &root["consolidated_metadata"]["metadata"];
    assert_eq!(listed["surfaces/a_b__/-0.25/transfer"]["shape"], json!([VERTICES, layout().layers.coefficients()]));
    assert_eq!(listed["surfaces/a_b__/-0.25/positions"]["shape"], json!([VERTICES, 3]));
    // Going on with the store leaves it alone.
    let again = Store::open_or_create(&path, &volume(), &identity(), provenance()).unwrap();
    assert!(again.mended().is_empty() && files(&path) == before, "{:?}", again.mended());
}

#[test]
fn another_mesh_and_damage_are_refused_and_mended_by_the_same_mesh() {
    let directory = tempfile::tempdir().unwrap();
    let (path, store, surface) = with_surface(directory.path());
    match store.open_or_add_surface(-0.25, &mesh(VERTICES - 1), volume().world_from_grid(), false) {
        Err(Error::Mismatch { field, .. }) => assert_eq!(field, "mesh"),
        other => panic!("{other:?}"),
    }
    let place = path.join("surfaces/a_b__/-0.25");
    let sound = files(&path);
    for name in ["positions_in_grid/c/0/0", "normals/c/0/0", "triangles/c/0/0", "zarr.json", "triangles/zarr.json"] {
        let file = place.join(name);
        let mut bytes = fs::read(&file).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 0x40;
        fs::write(&file, bytes).unwrap();
        let read = Store::open(&path).unwrap().surface(-0.25).and_then(|s| s.map(|s| s.mesh()).transpose());
        let is_metadata_of_array = name == "triangles/zarr.json";
        assert!(read.is_err() || is_metadata_of_array, "{name}");
        let found = diagnose(&store, &|_, _| crate::transfer::Selection::empty(layout().lattice)).unwrap();
        assert!(found.findings.iter().any(crate::finding::Finding::is_damage), "{name}: {found:?}");
        store.open_or_add_surface(-0.25, &mesh(VERTICES), volume().world_from_grid(), false).unwrap();
        assert!(files(&path) == sound, "{name}");
    }
    // Transfer of another mesh is another's: its record says so.
    let other = store.open_or_add_surface(0.5, &mesh(VERTICES - 3), volume().world_from_grid(), false).unwrap();
    for array in ["transfer/c/1/0", "stderr/c/1/0", "validity/c/1", "rays/c/1", "rays/extent/0.0.1.json"] {
        let (from, to) = (place.join(array), path.join("surfaces/a_b__/0.5").join(array));
        fs::create_dir_all(to.parent().unwrap()).unwrap();
        fs::copy(from, to).unwrap();
    }
    assert!(other.chunk_extent([1, 0, 0]).unwrap_err().to_string().contains("another store"));
    assert!(surface.chunk_extent([1, 0, 0]).unwrap().is_some());
}

#[test]
fn a_mesh_that_nobody_could_read_is_refused_by_name() {
    let directory = tempfile::tempdir().unwrap();
    let (path, store, surface) = with_surface(directory.path());
    let before = files(&path);
    let refused = |isovalue: f64, mesh: &Mesh, word: &str| {
        let message =
            store.open_or_add_surface(isovalue, mesh, volume().world_from_grid(), false).unwrap_err().to_string();
        assert!(message.contains(word), "{message}");
    };
    let good = mesh(8);
    refused(f64::NAN, &good, "isovalue");
    refused(0.5, &Mesh { normals: vec![[0.0; 3]; 7], ..good.clone() }, "7 normals");
    refused(0.5, &Mesh { triangles: vec![[0, 1, 8]], ..good.clone() }, "[0, 1, 8]");
    let mut broken = good.clone();
    broken.positions_in_grid[3][1] = f32::INFINITY;
    refused(0.5, &broken, "finite");
    assert!(surface.open_or_add_surface(0.5, &good, volume().world_from_grid(), false).is_err());
    // Check points of other numbers, or with lists that do not belong together.
    let checks = CheckPoints {
        positions_in_grid: vec![[1.0; 3]; 2],
        normals: vec![[0.0, 0.0, 1.0]; 2],
        isovalues: vec![-0.25; 2],
        halves: [vec![0.5; 10], vec![0.5; 10]],
        ..CheckPoints::default()
    };
    for (wrong, word) in [
        (CheckPoints { halves: [vec![0.5; 8], vec![0.5; 8]], ..checks.clone() }, "4 numbers a point"),
        (CheckPoints { halves: [vec![0.5; 10], vec![0.5; 9]], ..checks.clone() }, "second half"),
        (CheckPoints { isovalues: Vec::new(), ..checks.clone() }, "0 isovalues"),
        (CheckPoints { paths: 3, ..checks.clone() }, "0 escapes"),
    ] {
        let message = surface.write_checks(Some(-0.25), &wrong).unwrap_err().to_string();
        assert!(message.contains(word), "{message}");
    }
    assert!(files(&path) == before);
}

#[test]
fn surfaces_are_merged_with_their_check_points() {
    let directory = tempfile::tempdir().unwrap();
    let (_, _, surface) = with_surface(directory.path());
    let checks = CheckPoints {
        positions_in_grid: vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]],
        normals: vec![[0.0, 0.0, 1.0]; 2],
        isovalues: vec![-0.25; 2],
        halves: [vec![0.5; 2 * 5], vec![0.25; 2 * 5]],
        paths: 3,
        escapes: (0..6).collect(),
    };
    surface.write_checks(Some(-0.25), &checks).unwrap();
    assert_eq!(surface.checks(Some(-0.25)).unwrap().as_ref(), Some(&checks));
    assert_eq!(surface.checks(None).unwrap(), None);
    let store = Store::open(directory.path().join("x.isolume")).unwrap();
    let target = directory.path().join("y.isolume");
    let (merged, _) = StoreOptions::default().merge(&[store], &target).unwrap();
    let merged = merged.surface(-0.25).unwrap().unwrap();
    assert!(merged.mesh().unwrap() == Some(mesh(VERTICES)));
    assert_eq!(merged.checks(Some(-0.25)).unwrap(), Some(checks));
    let bricks = |store: &Store| bytes_of(&store.read_chunk([1, 0, 0]).unwrap().unwrap().0);
    assert_eq!(bricks(&merged), bricks(&surface));
    // What is damaged of check points is an error, and no number.
    let payload = target.join("surfaces/a_b__/-0.25/rays/checks--0.25.bin");
    let mut bytes = fs::read(&payload).unwrap();
    bytes[7] ^= 1;
    fs::write(&payload, bytes).unwrap();
    assert!(merged.checks(Some(-0.25)).unwrap_err().to_string().contains("checks--0.25.bin"));
}

#[test]
fn groups_of_a_scene_lie_below_their_surface() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.isolume");
    let scene = SceneIdentity {
        fingerprint: "f".into(),
        luminaires: vec!["lamp".into()],
        exponents: vec![3],
        coupling: None,
        media: false,
        body: None,
    };
    let identity = Identity { scene: Some(scene), ..identity() };
    let store = Store::create(&path, &volume(), &identity, provenance()).unwrap();
    let surface = store.open_or_add_surface(1e-40, &mesh(600), volume().world_from_grid(), false).unwrap();
    let lamp = surface.group(&Group::Luminaire("lamp".into())).unwrap();
    assert_eq!(lamp.layout().layers.coefficients(), 2 * 3);
    assert!(path.join("surfaces/a_b__/1e-40/luminaire.lamp/transfer/zarr.json").is_file());
    assert!(lamp.surfaces().unwrap().is_empty() && lamp.isovalue() == Some(1e-40));
}
