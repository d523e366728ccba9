//! Tests of the store as a whole: what is written comes back, and nothing else is accepted.

mod damage;
mod mend;
mod paths;
mod surface;

use super::super::texture::MemoryTexture;
use super::super::{BRICK_TEXELS, Brick, BrickSource, Lattice, Layers};
use super::zarr::MOST_SLOTS as SLOTS;
use super::*;
use crate::geom::{Affine, Up};
use crate::grid3;
use crate::volume::{LengthUnit, Note, Samples, Solid};
use glam::{DMat3, DVec3};
use half::f16;
use std::fs;
use std::path::PathBuf;

/// Numbers for tests (Vigna 2015, splitmix64).
pub(super) struct Numbers(pub u64);

impl Numbers {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let a = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let b = (a ^ a >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        b ^ b >> 31
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
}

/// A volume whose numbers need all their digits: an oblique, left-handed map, thirds and tenths.
fn volume() -> Volume {
    let dims = [40, 12, 70];
    let samples = (0..dims.iter().product::<usize>()).map(|i| (i * 7 % 1000) as i16 - 500).collect();
    let linear = DMat3::from_cols(
        DVec3::new(-1.0 / 3.0, 0.1, 0.0),
        DVec3::new(0.1, 100.7, 1e-3),
        DVec3::new(f64::EPSILON, 0.0, 2.0_f64.sqrt()),
    );
    let affine = Affine::new(linear, DVec3::new(1e6 + 0.1, -0.0, 1e-300)).unwrap();
    let mut volume = Volume::new(dims, Samples::I16(samples), affine).unwrap().with_scaling(0.1, -1024.3).unwrap();
    volume.name = "a/b ü".into();
    volume.unit = LengthUnit::Metres(1e-3);
    volume.up = Up::NegY;
    volume.solid = Solid::Below;
    volume.notes = vec![Note { text: "replaced NaN by \"0\"".into(), count: 3 }];
    volume
}

fn layout() -> Layout {
    Layout {
        lattice: Lattice::from_texels([40, 12, 70], [40, 12, 70]).unwrap(),
        layers: Layers::new(vec![2, 1]).unwrap(),
    }
}

fn identity() -> Identity {
    Identity::new(&volume(), &layout(), "path", false, u64::MAX)
}

fn provenance() -> Value {
    json!({ "program": "isolume", "third": 1.0 / 3.0, "tenth": 0.1, "nested": { "z": [1, -2, null], "a": "ä" } })
}

fn extent(rays: u32) -> ChunkExtent {
    let target = ErrorTarget { error: 0.01, of: "escape".into() };
    let mut extent = ChunkExtent::new(Some(0.1), rays, Some(target.clone()));
    extent.add(Baked { isovalue: Some(1.0 / 3.0), rays, target: Some(target) });
    extent
}

fn brick(seed: u64) -> Brick {
    let mut numbers = Numbers(seed);
    let mut brick = Brick::unbaked(&layout().layers);
    // Any bits, NaN of every kind among them.
    brick.transfer.iter_mut().for_each(|v| *v = f16::from_bits(numbers.next() as u16));
    brick.stderr.iter_mut().for_each(|v| *v = f16::from_bits(numbers.next() as u16));
    brick.validity.iter_mut().for_each(|v| *v = numbers.next() as u8);
    brick.rays.iter_mut().for_each(|v| *v = numbers.next() as u32);
    brick
}

/// Bricks along the side of a chunk.
const SIDE: usize = 4;

/// Some bricks of a chunk, none beyond the lattice.
fn bricks(index: [usize; 3], seed: u64) -> Vec<Option<Brick>> {
    let mut numbers = Numbers(seed);
    let count = layout().lattice.bricks();
    (0..SLOTS)
        .map(|slot| {
            let inside = grid3::at([SIDE, SIDE], slot);
            let seed = numbers.next();
            let exists = (0..3).all(|a| index[a] * SIDE + inside[a] < count[a]) && !seed.is_multiple_of(3);
            exists.then(|| brick(seed))
        })
        .collect()
}

/// A store with three of its six chunks.
fn filled(directory: &Path) -> (PathBuf, Store) {
    let path = directory.join("x.isolume");
    let store = Store::create(&path, &volume(), &identity(), provenance()).unwrap();
    for (seed, index) in [[0, 0, 0], [1, 0, 2], [0, 0, 1]].into_iter().enumerate() {
        store.write_chunk(index, bricks(index, seed as u64), &extent(64)).unwrap();
    }
    (path, store)
}

fn bytes_of(bricks: &[Option<Brick>]) -> Vec<Option<Vec<u8>>> {
    let bytes = |b: &Brick| {
        let mut all = bytemuck::cast_slice::<f16, u8>(&b.transfer).to_vec();
        all.extend(bytemuck::cast_slice::<f16, u8>(&b.stderr));
        all.extend(&b.validity);
        all.extend(bytemuck::cast_slice::<u32, u8>(&b.rays));
        all
    };
    bricks.iter().map(|b| b.as_ref().map(bytes)).collect()
}

/// All that can be read through a store, in a form that compares bit by bit.
fn everything(path: &Path) -> Result<String> {
    let store = Store::open(path)?;
    let volume = store.volume()?;
    let mut all = format!("{:?} {:?} {}", store.identity(), store.layout(), store.provenance());
    all += &format!("{:?} {:?} {:?}", volume.name, volume.unit, volume.up);
    all += &format!("{:?} {:?} {}", volume.solid, volume.notes, volume.content_hash());
    let ([nx, ny, nz], [cx, cy, cz]) = (layout().lattice.bricks(), layout().lattice.chunks());
    for index in grid3::all([nx, ny, nz]) {
        let view = store.brick(index)?.map(|view| view.to_brick());
        all += &format!("{:?}", bytes_of(&[view])[0].as_ref().map(|bytes| blake3::hash(bytes)));
    }
    for index in grid3::all([cx, cy, cz]) {
        all += &format!("{:?}", store.chunk_extent(index)?);
    }
    Ok(all)
}

/// All files below a directory, with their bytes.
fn files(directory: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut all = Vec::new();
    for entry in fs::read_dir(directory).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { all.extend(files(&path)) } else { all.push((path.clone(), fs::read(path).unwrap())) }
    }
    all.sort();
    all
}

#[test]
fn what_is_written_comes_back() {
    let directory = tempfile::tempdir().unwrap();
    let (path, _) = filled(directory.path());
    let store = Store::open(&path).unwrap();
    assert_eq!((store.identity(), store.layout(), store.provenance()), (&identity(), &layout(), &provenance()));
    let (found, made) = (store.volume().unwrap(), volume());
    assert_eq!(found.samples(), made.samples());
    assert_eq!(found.content_hash(), made.content_hash());
    assert_eq!((found.name, found.unit, found.up, found.solid), (made.name, made.unit, made.up, made.solid));
    assert_eq!(found.notes, made.notes);
    let (read, how) = store.read_chunk([1, 0, 2]).unwrap().unwrap();
    assert_eq!((bytes_of(&read), how), (bytes_of(&bricks([1, 0, 2], 1)), extent(64)));
    assert!(store.read_chunk([1, 0, 0]).unwrap().is_none());
    // The same through views, brick by brick.
    let copy = MemoryTexture::from_source(&store).unwrap();
    for (slot, expected) in read.iter().enumerate() {
        let index = [4 + slot % 4, slot / 4 % 4, 8 + slot / 16];
        if index.iter().zip(layout().lattice.bricks()).all(|(i, n)| *i < n) {
            let view = copy.brick(index).unwrap().map(|v| v.to_brick());
            assert_eq!(bytes_of(&[view]), bytes_of(std::slice::from_ref(expected)));
        }
    }
    assert!(store.brick([0, 2, 0]).unwrap_err().to_string().contains("(0, 2, 0)"));
}

#[test]
fn every_sample_type_survives() {
    let directory = tempfile::tempdir().unwrap();
    let dims = [65, 2, 130]; // More than one chunk along two axes, a part of one along the third.
    let mut numbers = Numbers(5);
    let raw: Vec<u64> = (0..dims.iter().product()).map(|_| numbers.next()).collect();
    let cases = [
        Samples::U8(raw.iter().map(|&v| v as u8).collect()),
        Samples::I8(raw.iter().map(|&v| v as i8).collect()),
        Samples::U16(raw.iter().map(|&v| v as u16).collect()),
        Samples::I16(raw.iter().map(|&v| v as i16).collect()),
        // Any finite bits, subnormal numbers among them.
        Samples::F32(raw.iter().map(|&v| f32::from_bits(v as u32 & 0xbf7f_ffff)).collect()),
    ];
    for samples in cases {
        let layout =
            Layout { lattice: Lattice::from_ratio(dims, 0.5).unwrap(), layers: Layers::uniform(1, 1).unwrap() };
        let volume = Volume::new(dims, samples, Affine::IDENTITY).unwrap();
        let identity = Identity::new(&volume, &layout, "gather", true, 0);
        let path = directory.path().join(volume.samples().type_name());
        let store = Store::create(&path, &volume, &identity, Value::Null).unwrap();
        assert_eq!(store.volume().unwrap().samples(), volume.samples());
        assert_eq!(store.volume().unwrap().unit, LengthUnit::Unknown);
    }
}

#[test]
fn a_chunk_grows_while_an_old_reader_keeps_what_it_has() {
    let directory = tempfile::tempdir().unwrap();
    let (path, mut writer) = filled(directory.path());
    let reader = Store::open(&path).unwrap();
    let old = bricks([0, 0, 0], 0);
    let slot = old.iter().position(Option::is_some).unwrap();
    let index = [slot % 4, slot / 4 % 4, slot / 16];
    let view = reader.brick(index).unwrap().unwrap();
    assert!(writer.brick(index).unwrap().is_some());

    let resumed = Store::open_or_create(&path, &volume(), &identity(), json!("not used")).unwrap();
    assert_eq!(resumed.provenance(), &provenance());
    let (mut grown, _) = resumed.read_chunk([0; 3]).unwrap().unwrap();
    grown[slot] = Some(brick(99));
    let more = ChunkExtent::new(None, 256, None);
    resumed.write_chunk([0; 3], grown.clone(), &more).unwrap();

    assert_eq!(bytes_of(&[Some(view.to_brick())]), bytes_of(&old[slot..=slot]));
    assert_eq!(resumed.read_chunk([0; 3]).unwrap().map(|(b, e)| (bytes_of(&b), e)), Some((bytes_of(&grown), more)));
    let seen = |store: &Store| bytes_of(&[store.brick(index).unwrap().map(|v| v.to_brick())]);
    assert_eq!(seen(&writer), bytes_of(&old[slot..=slot]));
    writer.refresh();
    assert_eq!(seen(&writer), bytes_of(&grown[slot..=slot]));
}

#[test]
fn every_field_of_the_identity_must_match() {
    let directory = tempfile::tempdir().unwrap();
    let (path, _) = filled(directory.path());
    let mut other_volume = volume();
    other_volume.solid = Solid::Above;
    let cases = [
        ("format_version", Identity { format_version: FORMAT_VERSION + 1, ..identity() }),
        ("volume", Identity { volume: "00".into(), ..identity() }),
        ("grid", Identity { grid: [41, 12, 70], ..identity() }),
        ("texels", Identity { texels: [40, 12, 35], ..identity() }),
        ("solid", Identity::new(&other_volume, &layout(), "path", false, u64::MAX)),
        ("bands", Identity { bands: vec![2, 2], ..identity() }),
        ("estimator", Identity { estimator: "gather".into(), ..identity() }),
        ("estimator", Identity { revision: 1, ..identity() }),
        ("positive", Identity { positive: true, ..identity() }),
        ("seed", Identity { seed: u64::MAX - 1, ..identity() }),
    ];
    for (name, asked) in cases {
        match Store::open_or_create(&path, &volume(), &asked, Value::Null) {
            Err(Error::Mismatch { field, stored, asked, remedy, .. }) => {
                assert_eq!(field, name);
                assert!(stored != asked && remedy.contains("-o"), "{stored} {asked} {remedy}");
            }
            other => panic!("{name}: {other:?}"),
        }
        assert_ne!(asked.hash(), identity().hash());
    }
    // And a new store asks that the identity belongs to the volume.
    for (name, asked) in [
        ("format_version", Identity { format_version: FORMAT_VERSION + 1, ..identity() }),
        ("volume", Identity { volume: "00".into(), ..identity() }),
        ("grid", Identity { grid: [41, 12, 70], ..identity() }),
        ("solid", Identity { solid: "above".into(), ..identity() }),
    ] {
        let error = Store::create(directory.path().join("new"), &volume(), &asked, Value::Null).unwrap_err();
        assert!(error.to_string().starts_with(&format!("identity.{name}")), "{error}");
    }
}

#[test]
fn equal_input_gives_equal_bytes_in_any_order_of_chunks() {
    let directory = tempfile::tempdir().unwrap();
    let (path, _) = filled(directory.path());
    let other = directory.path().join("y.isolume");
    let store = Store::create(&other, &volume(), &identity(), provenance()).unwrap();
    store.write_chunk([0, 0, 0], bricks([0, 0, 0], 77), &extent(16)).unwrap();
    for (seed, index) in [[0, 0, 0], [1, 0, 2], [0, 0, 1]].into_iter().enumerate().rev() {
        store.write_chunk(index, bricks(index, seed as u64), &extent(64)).unwrap();
    }
    let relative = |root: &Path| -> Vec<_> {
        files(root).into_iter().map(|(p, b)| (p.strip_prefix(root).unwrap().to_owned(), b)).collect()
    };
    assert_eq!(relative(&path), relative(&other));
    for (root, zip) in [(&path, "x.zip"), (&other, "y.zip")] {
        pack_zip(root, directory.path().join(zip)).unwrap();
    }
    assert_eq!(fs::read(directory.path().join("x.zip")).unwrap(), fs::read(directory.path().join("y.zip")).unwrap());
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let plain = directory.path().join("plain");
        fs::write(&plain, "").unwrap();
        let mode = |p: &Path| fs::metadata(p).unwrap().permissions().mode();
        assert_eq!(mode(&files(&path)[0].0), mode(&plain), "files are as readable as any other");
    }
}

#[test]
fn chunks_that_do_not_fit_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let (path, store) = filled(directory.path());
    let before = files(&path);
    let refused = |index, bricks, extent: ChunkExtent, word: &str| {
        let message = store.write_chunk(index, bricks, &extent).unwrap_err().to_string();
        assert!(message.contains(word), "{message}");
    };
    refused([2, 0, 0], vec![None; 64], extent(1), "chunk index");
    refused([0; 3], vec![None; 63], extent(1), "63 bricks");
    let mut beyond = vec![None; 64];
    beyond[2 * SIDE] = Some(brick(0)); // Brick y = 2 of 2: texels 16… of 12.
    refused([0; 3], beyond, extent(1), "(0, 2, 0)");
    let mut short = vec![None; 64];
    short[0] = Some(Brick { rays: vec![0; BRICK_TEXELS - 1], ..brick(0) });
    refused([0; 3], short, extent(1), "brick.rays");
    refused([0; 3], vec![None; 64], ChunkExtent::new(Some(f64::NAN), 1, None), "finite");
    assert_eq!(files(&path), before);
    // A chunk in which nothing had to be baked is a chunk.
    store.write_chunk([1, 0, 1], vec![None; 64], &extent(4)).unwrap();
    let (bricks, how) = store.read_chunk([1, 0, 1]).unwrap().unwrap();
    assert!(bricks.iter().all(Option::is_none) && how == extent(4));
}

/// Stores from before the frame was recorded are not anatomical, and say so.
#[test]
fn an_anatomical_frame_is_recorded() {
    let directory = tempfile::tempdir().unwrap();
    let standing = |up| {
        let mut volume = volume();
        volume.up = up;
        volume
    };
    let anatomical = standing(Up::Anatomical);
    let path = directory.path().join("s.isolume");
    let identity = Identity::new(&anatomical, &layout(), "path", false, 0);
    // The frame turns light and views, never the transfer.
    assert_eq!(identity, Identity::new(&standing(Up::Z), &layout(), "path", false, 0));
    drop(Store::open_or_create(&path, &anatomical, &identity, provenance()).unwrap());
    let found = Store::open(&path).unwrap().volume().unwrap();
    assert_eq!((found.up, found.notes.len()), (Up::Anatomical, volume().notes.len()));
    let metadata = files(&path).into_iter().find(|(name, bytes)| {
        name.ends_with("data/zarr.json") && String::from_utf8_lossy(bytes).contains("\"anatomical\"")
    });
    let (name, bytes) = metadata.unwrap();
    let mut json: Value = serde_json::from_slice(&bytes).unwrap();
    let mut attributes = unsealed(&json).unwrap();
    attributes.as_object_mut().unwrap().shift_remove("anatomical");
    json["attributes"] = sealed(attributes);
    fs::write(&name, serde_json::to_vec(&json).unwrap()).unwrap();
    let old = Store::open(&path).unwrap().volume().unwrap();
    assert_eq!(old.up, Up::Z);
    assert!(old.notes.iter().any(|note| note.text == FRONT_NOT_RECORDED));
}
