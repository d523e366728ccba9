//! What is fed: for each target the seeds, how damage is wrapped up again, the call, and the limit.

use super::documents::{other_values, resealed};
use super::mutate::{self, Numbers};
use super::seeds;
use glam::DVec3;
use isolume::geom::{Affine, Up};
use isolume::level;
use isolume::model::Region;
use isolume::probe::{Orientation, ReadOptions};
use isolume::scene::geometry::{TriangleMesh, read_mesh};
use isolume::scene::medium::MediumField;
use isolume::scene::{Files, ModelDescription, SceneDescription, Size, distant_light};
use isolume::transfer::store::{ChunkExtent, ErrorTarget, Holdings, Identity, Store, pack_zip};
use isolume::transfer::{BRICK_TEXELS, Brick, BrickSource, Lattice, Layers, Layout};
use isolume::volume::{ReadHint, Samples, Volume};
use std::path::{Path, PathBuf};

/// Most bytes of samples that a header may claim here.
pub const SAMPLE_BYTES: u64 = 1 << 20;
/// Most pixels of a probe here: 64 × 32.
pub const PIXELS: usize = 1 << 11;

/// Memory that a volume reader may ask for, beside 64 times the file itself (a TIFF's directory is unpacked
/// to 32 bytes for each of its bytes, a gzip stream is held for TIFF): the samples as stored (at most 8 bytes
/// each), reordered, and as kept: 3 times what may be claimed, growth by doubling counted twice for text;
/// and its buffers: 1 MiB a piece and its decoded samples, 64 KiB of look-ahead, the state of inflate.
pub const VOLUME_LIMIT: usize = 6 * SAMPLE_BYTES as usize + (6 << 20);
/// Beside that, for Zarr: the window that any decoder of zstd is to take, 8 MiB, in a ring of a power of two.
pub const ZARR_LIMIT: usize = VOLUME_LIMIT + (16 << 20);
/// For DICOM: JPEG 2000 takes 4 bytes for each coefficient and some for their blocks; all frames of a file at once.
pub const DICOM_LIMIT: usize = VOLUME_LIMIT + (32 << 20);
/// The same for probes: pixels as stored, as floats, converted (up to 4 times as many), and what `low_range`
/// allows its decoders besides: 16 bytes a pixel and 64 MiB.
pub const PROBE_LIMIT: usize = 200 * PIXELS + (66 << 20);
/// The same for a store, which maps or copies its files: 16 bytes for each of the 2²² chunks that it may
/// have, and its metadata a few times over.
pub const STORE_LIMIT: usize = (64 << 20) + (32 << 20);
/// What a mesh may take besides 64 bytes for each of its own: a vertex of 6 bytes (`v 0 0 0`) takes 24, a triangle 12,
/// doubled by growth; and the buffer beside it.
pub const MESH_LIMIT: usize = 1 << 20;
/// The same for a scene, with its walls made of it.
pub const SCENE_LIMIT: usize = 1 << 20;
/// The same for a model: a tree of at most 10⁵ nodes, which one line can ask for by `repeat`, and grids of the seeds.
pub const MODEL_LIMIT: usize = 192 << 20;

/// A reader under test.
pub struct Target {
    pub name: &'static str,
    pub seeds: fn() -> Vec<seeds::Seed>,
    /// Most bytes asked for beyond the file and what the seeds need.
    pub limit: usize,
    /// Runs in the gate, so that all of them take a few seconds.
    pub gate_runs: u64,
    kind: Kind,
}

enum Kind {
    Volume,
    /// With a second file: opened by path.
    Pair,
    /// Several files in a folder, one after the other in the input.
    Folder,
    Probe,
    Store,
    Zip,
    /// With the bytes of a buffer beside it.
    Mesh,
    Scene,
    /// With files beside it.
    Model,
}

pub const TARGETS: [Target; 27] = [
    volume("nifti", seeds::nifti),
    volume("nrrd", seeds::nrrd),
    volume("mrc", seeds::mrc),
    volume("cube", seeds::cube),
    volume("vtk", seeds::vtk),
    volume("vti", seeds::vti),
    volume("metaimage", seeds::metaimage),
    volume("dx", seeds::dx),
    volume("plt", seeds::plt),
    volume("npz", seeds::npz),
    volume("npy", seeds::npy),
    volume("tiff", seeds::tiff),
    folder("zarr", ZARR_LIMIT),
    folder("dicom", DICOM_LIMIT),
    Target { name: "raw", seeds: seeds::raw, limit: VOLUME_LIMIT, gate_runs: 1000, kind: Kind::Pair },
    Target { name: "pairs", seeds: seeds::pairs, limit: VOLUME_LIMIT, gate_runs: 1000, kind: Kind::Pair },
    probe("openexr", seeds::openexr),
    probe("radiance", seeds::radiance),
    probe("low_range", seeds::low_range),
    Target { name: "store", seeds: Vec::new, limit: STORE_LIMIT, gate_runs: 250, kind: Kind::Store },
    Target { name: "store_zip", seeds: Vec::new, limit: STORE_LIMIT, gate_runs: 150, kind: Kind::Zip },
    mesh("mesh_obj", seeds::obj),
    mesh("mesh_ply", seeds::ply),
    mesh("mesh_gltf", seeds::gltf),
    mesh("mesh_stl", seeds::stl),
    Target { name: "scene", seeds: seeds::scene, limit: SCENE_LIMIT, gate_runs: 1500, kind: Kind::Scene },
    Target { name: "model", seeds: seeds::model, limit: MODEL_LIMIT, gate_runs: 10_000, kind: Kind::Model },
];

const fn volume(name: &'static str, seeds: fn() -> Vec<seeds::Seed>) -> Target {
    Target { name, seeds, limit: VOLUME_LIMIT, gate_runs: 1500, kind: Kind::Volume }
}

/// Their seeds are written by other programs (`tests/fuzz/corpus.py`).
const fn folder(name: &'static str, limit: usize) -> Target {
    Target { name, seeds: Vec::new, limit, gate_runs: 1000, kind: Kind::Folder }
}

const fn probe(name: &'static str, seeds: fn() -> Vec<seeds::Seed>) -> Target {
    Target { name, seeds, limit: PROBE_LIMIT, gate_runs: 800, kind: Kind::Probe }
}

const fn mesh(name: &'static str, seeds: fn() -> Vec<seeds::Seed>) -> Target {
    Target { name, seeds, limit: MESH_LIMIT, gate_runs: 1500, kind: Kind::Mesh }
}

impl Input {
    /// The same file with other bytes.
    pub fn with(&self, bytes: Vec<u8>) -> Self {
        Self { bytes, file: self.file, sealed: false }
    }
}

/// Whether seed `i` of a target is an input that once failed; such a one may be refused.
pub fn is_regression(target: &str, i: usize) -> bool {
    let files = sorted(&corpus(target));
    files.get(i).is_some_and(|f| f.file_name().is_some_and(|n| n.to_string_lossy().starts_with("regression")))
}

/// A target with its files at hand.
pub struct Bench {
    pub target: &'static Target,
    seeds: Vec<Vec<u8>>,
    folder: tempfile::TempDir,
    /// What a sound store reads as.
    sound: String,
    /// Files of the store, or its archive.
    files: Vec<PathBuf>,
}

/// One input: bytes for a file, and which file.
pub struct Input {
    pub bytes: Vec<u8>,
    file: usize,
    /// Whether metadata of a store was sealed again, so that it may say something else.
    sealed: bool,
}

/// The corpus of a target.
pub fn corpus(name: &str) -> PathBuf {
    let root = std::env::var_os("CARGO_MANIFEST_DIR").map_or_else(|| env!("CARGO_MANIFEST_DIR").into(), PathBuf::from);
    root.join("tests/fuzz/corpus").join(name)
}

fn sorted(folder: &Path) -> Vec<PathBuf> {
    let mut all = Vec::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten() {
        let path = entry.expect("an entry").path();
        if path.is_dir() { all.extend(sorted(&path)) } else { all.push(path) }
    }
    all.sort();
    all
}

impl Bench {
    pub fn new(target: &'static Target) -> Self {
        // In memory where there is such a place: a store is rewritten thousands of times.
        let memory = Path::new("/dev/shm");
        let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
        let folder = folder.expect("a temporary folder");
        let mut bench = Self { target, seeds: Vec::new(), folder, sound: String::new(), files: Vec::new() };
        match target.kind {
            Kind::Store | Kind::Zip => bench.make_store(),
            Kind::Pair => {
                let at = |name: &str| bench.folder.path().join(name);
                let samples: Vec<u8> = (0..24).collect();
                for name in ["samples.raw", "input.img"] {
                    std::fs::write(at(name), &samples).expect("written");
                }
                std::fs::write(at("samples.gz"), mutate::gzip(&samples)).expect("written");
                let piece = std::fs::read(corpus("vti").join("raw.vti")).expect("a piece");
                std::fs::write(at("piece.vti"), piece).expect("written");
            }
            Kind::Volume | Kind::Folder | Kind::Probe | Kind::Mesh | Kind::Scene | Kind::Model => {}
        }
        if bench.files.is_empty() {
            let files = sorted(&corpus(target.name));
            assert!(!files.is_empty(), "no corpus for {}", target.name);
            bench.seeds = files.iter().map(|f| std::fs::read(f).expect("a seed")).collect();
        } else {
            bench.seeds = bench.files.iter().map(|f| std::fs::read(f).expect("a file")).collect();
        }
        bench
    }

    fn make_store(&mut self) {
        let path = self.folder.path().join("x.isolume");
        small_store(&path);
        self.sound = everything(&path).expect("a sound store");
        if matches!(self.target.kind, Kind::Zip) {
            let zip = self.folder.path().join("x.zip");
            pack_zip(&path, &zip).expect("packed");
            self.files = vec![zip];
        } else {
            self.files = sorted(&path);
        }
    }

    /// Whether inputs are files of a store.
    pub fn is_store(&self) -> bool {
        !self.files.is_empty()
    }

    /// The undamaged inputs.
    pub fn whole(&self) -> Vec<Input> {
        self.seeds.iter().enumerate().map(|(file, b)| Input { bytes: b.clone(), file, sealed: false }).collect()
    }

    /// Input number `n`.
    pub fn input(&self, n: u64) -> Input {
        let mut numbers = Numbers(n.wrapping_mul(0x2545_f491_4f6c_dd1d) ^ self.target.name.len() as u64);
        let file = numbers.below(self.seeds.len());
        let seed = &self.seeds[file];
        let is_json = self.files.get(file).is_some_and(|f| f.extension().is_some_and(|e| e == "json"));
        if is_json && numbers.below(2) == 0 {
            return Input { bytes: resealed(&mut numbers, seed), file, sealed: true };
        }
        if matches!(self.target.kind, Kind::Mesh)
            && numbers.below(2) == 0
            && let Some(bytes) = other_values(&mut numbers, seed)
        {
            return Input { bytes, file, sealed: false };
        }
        let other = self.seeds[numbers.below(self.seeds.len())].clone();
        if matches!(self.target.kind, Kind::Folder) && numbers.below(8) > 0 {
            // One of the files, with parts of one of the same seed or of another.
            let (mut files, others) = (unpacked(seed), unpacked(&other));
            let donor = others[numbers.below(others.len())].1.clone();
            let which = numbers.below(files.len());
            files[which].1 = mutate::damage(&mut numbers, &files[which].1, &donor);
            if numbers.below(8) == 0 {
                files.remove(which);
            }
            return Input { bytes: packed(&files), file, sealed: false };
        }
        let mut bytes = mutate::damage(&mut numbers, seed, &other);
        match self.target.kind {
            Kind::Volume => match numbers.below(24) {
                0..=2 => bytes = mutate::gzip(&bytes),
                3 => {
                    // Damaged after it was packed.
                    let packed = mutate::gzip(seed);
                    bytes = mutate::damage(&mut numbers, &packed, &packed);
                }
                4 if numbers.below(8) == 0 => bytes = mutate::bomb(&bytes, 1 << 24),
                _ => {}
            },
            Kind::Probe if numbers.below(4) > 0 => mutate::repair_png(&mut bytes),
            _ => {}
        }
        Input { bytes, file, sealed: false }
    }

    /// Feeds one input; true when it was accepted. Panics when what was accepted is not what is promised.
    pub fn feed(&self, input: &Input) -> bool {
        match self.target.kind {
            Kind::Volume => {
                // A stream of unknown length and a file of known length come to the same end.
                let hint = ReadHint { max_bytes: SAMPLE_BYTES, ..ReadHint::default() };
                let streamed = isolume::volume::read(&input.bytes[..], &hint);
                let sized = ReadHint { length: Some(input.bytes.len() as u64), ..hint };
                let sized = isolume::volume::read(&input.bytes[..], &sized);
                if self.target.name == "tiff" {
                    let mut coarse = hint_of_level(1);
                    coarse.length = Some(input.bytes.len() as u64);
                    let _ = check_volume(isolume::volume::read(&input.bytes[..], &coarse));
                }
                assert_eq!(streamed.is_ok(), sized.is_ok(), "{:?} {:?}", streamed.err(), sized.err());
                check_volume(streamed)
            }
            Kind::Pair => {
                let path = self.folder.path().join("input.hdr");
                std::fs::write(&path, &input.bytes).expect("written");
                let hint = ReadHint { max_bytes: SAMPLE_BYTES, ..ReadHint::default() };
                check_volume(isolume::volume::open_with(&path, &hint))
            }
            Kind::Folder => {
                let path = self.folder.path().join("input");
                let _ = std::fs::remove_dir_all(&path);
                std::fs::create_dir(&path).expect("made");
                for (name, bytes) in unpacked(&input.bytes) {
                    let file = path.join(name);
                    // What another file's name makes impossible is left out.
                    if std::fs::create_dir_all(file.parent().expect("a folder")).is_ok() {
                        let _ = std::fs::write(file, bytes);
                    }
                }
                let hint = ReadHint { max_bytes: SAMPLE_BYTES, ..ReadHint::default() };
                let mut other = hint_of_level(1);
                other.choice.allow_gaps = true;
                other.choice.series = Some("0".into());
                if self.target.name == "zarr" {
                    other.choice.series = None;
                    other.choice.region = "1:,:2,0:1".parse().ok();
                }
                let _ = check_volume(isolume::volume::open_with(&path, &other));
                check_volume(isolume::volume::open_with(&path, &hint))
            }
            Kind::Probe => check_probe(&input.bytes),
            Kind::Store | Kind::Zip => self.feed_store(input),
            Kind::Mesh => check_mesh(&input.bytes),
            Kind::Scene => check_scene(&input.bytes),
            Kind::Model => check_model(&input.bytes),
        }
    }

    fn feed_store(&self, input: &Input) -> bool {
        let file = &self.files[input.file];
        std::fs::write(file, &input.bytes).expect("written");
        let path =
            if matches!(self.target.kind, Kind::Zip) { file.clone() } else { self.folder.path().join("x.isolume") };
        let read = everything(&path);
        if let Ok(store) = Store::open(&path) {
            // The doctor looks at everything, too, and goes on where reading stops.
            let whole = |_: &Volume, _: &Holdings| isolume::transfer::Selection::all(store.layout().lattice);
            let _ = isolume::transfer::store::diagnose(&store, &whole);
        }
        std::fs::write(file, &self.seeds[input.file]).expect("written");
        match read {
            Err(error) => {
                let message = error.to_string();
                let named = message.contains(&*path.to_string_lossy());
                assert!(input.sealed || named, "an error that names no file: {message}");
                false
            }
            Ok(read) => {
                // Only a document of ours with another content and a right seal may be believed, and the end of
                // a text may lose its line feed. A chunk whose record or mark is gone was not baked.
                assert!(input.sealed || read == self.sound, "damage unnoticed in {}", file.display());
                true
            }
        }
    }
}

fn hint_of_level(level: usize) -> ReadHint {
    let choice = isolume::volume::Choice {
        level: Some(isolume::volume::Level::Index(level)),
        any_channel: true,
        ..isolume::volume::Choice::default()
    };
    ReadHint { max_bytes: SAMPLE_BYTES, choice, ..ReadHint::default() }
}

/// The files of a folder that an input holds: name, zero, length, bytes. Names that lead elsewhere are left out.
fn unpacked(mut bytes: &[u8]) -> Vec<(String, Vec<u8>)> {
    let mut files = Vec::new();
    while let Some(end) = bytes.iter().position(|b| *b == 0) {
        let name = String::from_utf8_lossy(&bytes[..end]).into_owned();
        let Some((length, rest)) = bytes[end + 1..].split_first_chunk::<4>() else { break };
        let content = &rest[..rest.len().min(u32::from_le_bytes(*length) as usize)];
        let is_plain = |part: &str| !matches!(part, "" | "." | "..") && part.len() < 100;
        if name.split('/').all(is_plain) && name.split('/').count() < 8 {
            files.push((name, content.to_vec()));
        }
        bytes = &rest[content.len()..];
    }
    files
}

fn packed(files: &[(String, Vec<u8>)]) -> Vec<u8> {
    let one = |(name, bytes): &(String, Vec<u8>)| {
        [name.as_bytes(), &[0], &(bytes.len() as u32).to_le_bytes(), bytes].concat()
    };
    files.iter().flat_map(one).collect()
}

fn check_volume(read: isolume::Result<Volume>) -> bool {
    let volume = match read {
        Ok(volume) => volume,
        Err(error) => {
            assert!(error.to_string().len() > 30, "an error without a reason: {error}");
            return false;
        }
    };
    let count = volume.dims().iter().product::<usize>();
    assert_eq!(count, volume.samples().len());
    assert!(count as u64 <= SAMPLE_BYTES);
    let (low, high) = volume.raw_range();
    assert!(low.is_finite() && high.is_finite() && low <= high);
    assert!(volume.slope().is_finite() && volume.slope() != 0.0 && volume.inter().is_finite());
    let affine = volume.world_from_grid();
    assert!(affine.linear().is_finite() && affine.offset().is_finite());
    let middle = 0.5 * (volume.value_range().0 + volume.value_range().1);
    // The diagnoses take whatever the readers let through.
    let _ = isolume::volume::diagnose::diagnose(&volume, Some(middle));
    if count < 1000 {
        let _ = level::diagnose::diagnose(&volume, middle);
    }
    true
}

fn check_probe(bytes: &[u8]) -> bool {
    let options = ReadOptions { max_pixels: PIXELS, ..ReadOptions::default() };
    match isolume::probe::Probe::from_bytes("fuzz", bytes, &options) {
        Err(error) => {
            assert!(error.to_string().len() > 30, "an error without a reason: {error}");
            false
        }
        Ok(probe) => {
            assert!(probe.image.pixels().iter().flatten().all(|v| v.is_finite() && *v >= 0.0));
            let orientation = Orientation::new(Up::Z, 10.0).expect("an angle");
            for channel in probe.coefficients_in_world(3, orientation) {
                assert!(channel.values().iter().all(|v| v.is_finite()));
            }
            let _ = isolume::probe::diagnose(&probe);
            true
        }
    }
}

fn check_mesh(bytes: &[u8]) -> bool {
    // Whatever a glTF names beside it is the buffer of the seeds.
    match read_mesh(bytes, &mut |_, _| Ok(seeds::buffer_of_gltf())) {
        Err(error) => {
            assert!(error.to_string().len() > 30, "an error without a reason: {error}");
            false
        }
        Ok(mesh) => {
            assert!(!mesh.triangles.is_empty() && mesh.positions.iter().all(|p| p.is_finite()));
            // Corners index their positions.
            assert_eq!(mesh.corners().count(), mesh.triangles.len());
            true
        }
    }
}

/// Files beside a model: the meshes and molecules of the seeds.
struct BesideModel;

impl Files for BesideModel {
    fn mesh(&mut self, _: &str) -> isolume::Result<TriangleMesh> {
        read_mesh(&seeds::stl().swap_remove(0).1, &mut |_, _| Ok(Vec::new()))
    }

    fn volume(&mut self, _: &str, _: isolume::volume::Choice) -> isolume::Result<Volume> {
        let samples = Samples::U8((0..27).map(|i| 9 * i).collect());
        Volume::new([3; 3], samples, Affine::from_spacing(DVec3::splat(0.5), DVec3::splat(-0.5)).expect("a map"))
    }

    fn bytes(&mut self, _: &str) -> isolume::Result<Vec<u8>> {
        Ok(b"2\nwater, in part\nO 0 0 0.1\nH 0 0.7 -0.4\n".to_vec())
    }
}

/// A model is read; what was accepted has values with gradients, in the ranges of their boxes.
fn check_model(bytes: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else { return false };
    // Grids and depths of contact are sampled when they are read: too long for a fuzzer where damage makes them large.
    if text.contains("samples = ") && !text.contains("samples = 8\n") {
        return false;
    }
    let model = match ModelDescription::read(text, "fuzz.toml", Some(Size::Longest(8)), &mut BesideModel) {
        Ok(model) => model,
        Err(error) => {
            let message = error.to_string();
            assert!(message.len() > 40, "an error without a reason: {message}");
            return false;
        }
    };
    for i in 0..8u64 {
        let p = model.bounds.min + model.bounds.size() * isolume::model::grid::scattered(i);
        let (value, _) = model.tree.value_and_gradient(p);
        let half = 0.1 * model.bounds.size();
        let range = model.tree.bounds_in(&Region { centre: p, half });
        assert!(value.is_nan() || range.holds(value), "{value} is not in {range:?}");
    }
    let (mut pruned, mut whole) = (Vec::new(), Vec::new());
    model.tree.sample(&model.bounds, [5; 3], true, &mut pruned);
    model.tree.sample(&model.bounds, [5; 3], false, &mut whole);
    assert!(pruned.iter().map(|v| v.to_bits()).eq(whole.iter().map(|v| v.to_bits())), "pruning changed a value");
    true
}

/// A scene is read and its walls are made; rays through what was accepted end in answers.
fn check_scene(bytes: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else { return false };
    let scene = match SceneDescription::parse(text, "fuzz.toml") {
        Ok(scene) => scene,
        Err(error) => {
            let message = error.to_string();
            assert!(message.contains("fuzz.toml:") && message.len() > 40, "an error without a place: {message}");
            return false;
        }
    };
    let corners = || read_mesh(&seeds::obj().swap_remove(0).1, &mut |_, _| Ok(Vec::new()));
    let bytes_of_mesh = || Ok(seeds::obj().swap_remove(0).1);
    let mut sky = |name: &str, turned: f64| {
        let none = || isolume::Error::argument("image", name, "the name of a built-in environment", "write sky");
        let probe = isolume::probe::by_name(name)?.ok_or_else(none)?;
        Ok(distant_light(&probe, Orientation::new(Up::Y, turned)?))
    };
    match scene.surroundings.assemble(
        &scene,
        1.0,
        &mut |_, _| bytes_of_mesh(),
        &mut |_, _| corners(),
        &mut sky,
        &mut |_| Ok(MediumField::Lit),
    ) {
        Err(error) => {
            assert!(error.to_string().len() > 30, "an error without a reason: {error}");
            false
        }
        Ok(geometry) => {
            for i in 0..8 {
                let turn = f64::from(i);
                let direction = DVec3::new((3.0 * turn).sin(), (5.0 * turn).cos(), (7.0 * turn).sin()).normalize();
                for origin in [DVec3::ZERO, DVec3::splat(0.5), 10.0 * direction] {
                    let hit = geometry.first_wall(origin, direction, None, f64::INFINITY);
                    assert!(hit.is_none_or(|hit| hit.distance > 0.0));
                    for l in 0..geometry.luminaires().len() {
                        let _ = geometry.arriving(l, origin, [0.3, 0.7]);
                    }
                }
            }
            true
        }
    }
}

/// A store of 9³ texels: one chunk, two bricks a side.
pub fn small_store(path: &Path) {
    let samples = (0..729).map(|i| (i * 37 % 251) as u8).collect();
    let affine = Affine::IDENTITY;
    let volume = Volume::new([9, 9, 9], Samples::U8(samples), affine).expect("a volume");
    let lattice = Lattice::from_ratio([9, 9, 9], 1.0).expect("a lattice");
    let layout = Layout { lattice, layers: Layers::uniform(1, 1).expect("layers") };
    let identity = Identity::new(&volume, &layout, "path", false, 7);
    let store = Store::create(path, &volume, &identity, serde_json::json!({ "by": ["hand"] })).expect("a store");
    let mut brick = Brick::unbaked(&layout.layers);
    for t in 0..BRICK_TEXELS {
        brick.transfer[t] = half::f16::from_f32(t as f32 / 512.0);
        (brick.validity[t], brick.rays[t]) = (1, 16);
    }
    let bricks = (0..64).map(|slot| [0, 1, 4, 5, 16, 21].contains(&slot).then(|| brick.clone())).collect();
    let extent = ChunkExtent::new(Some(0.1), 16, Some(ErrorTarget { error: 0.5, of: "escape".into() }));
    store.write_chunk([0; 3], bricks, &extent).expect("written");
}

/// All that can be read through a store.
pub fn everything(path: &Path) -> isolume::Result<String> {
    let store = Store::open(path)?;
    let volume = store.volume()?;
    let mut all = format!("{:?} {:?} {}", store.identity(), store.layout(), store.provenance());
    all += &format!("{:?} {:?} {:?} {}", volume.name, volume.notes, volume.solid, volume.content_hash());
    let [cx, cy, cz] = store.layout().lattice.chunks();
    for index in (0..cx * cy * cz).map(|i| [i % cx, i / cx % cy, i / cx / cy]) {
        if let Some((bricks, extent)) = store.read_chunk(index)? {
            all += &format!("{extent:?}");
            for brick in bricks.iter().flatten() {
                all += &format!("{}", blake3::hash(bytemuck::cast_slice(&brick.transfer)));
                all += &format!("{:?}", brick.validity.iter().map(|v| u64::from(*v)).sum::<u64>());
            }
        } else {
            all += "torn or absent";
        }
    }
    let [bx, by, bz] = store.layout().lattice.bricks();
    for index in (0..bx * by * bz).map(|i| [i % bx, i / bx % by, i / bx / by]) {
        all += if store.brick(index)?.is_some() { "1" } else { "0" };
    }
    Ok(all)
}
