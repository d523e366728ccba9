//! The transfer store: a directory `X.isolume` (or a zip of it) that is a Zarr v3 hierarchy, so
//! that zarr-python 3, xarray and napari open it without us.
//!
//! ```text
//! zarr.json                         root: format version, name of the volume
//! volumes/<name>/data               samples in their native type [z, y, x]
//! transfer/<name>/env               identity, layers, provenance
//!     transfer    float16 [z, y, x, coefficient]   NaN where nothing is baked
//!     stderr      float16 [z, y, x, layer_band]    NaN where nothing is baked
//!     validity    uint8   [z, y, x]                flags of `transfer::validity`
//!     rays        uint32  [z, y, x]                paths traced
//!     extent/z.y.x.json             how far each chunk was baked (not part of Zarr)
//!     allocation.json               what a bake in a given time decided, if there was one (not part of Zarr)
//! transfer/<name>/emission          of scenes: the level set's own light; arrays as in `env`
//! transfer/<name>/luminaire.<n>     of scenes: that of each luminaire
//! volumes/<other>/…, transfer/<other>/…   of scenes of several volumes: the same for each ([`Store::of_volume`])
//! ```
//!
//! # Why by hand and not the crate `zarrs`
//! Chunks must be committed atomically, by rename; relight must map a chunk and read f16 in place
//! at memory speed; and parts of a chunk that were never baked must not cost space. The subset of
//! Zarr that this needs is the module `zarr`; it writes and reads one form of everything.
//!
//! # Where this differs from a plain Zarr array of 32³ chunks
//! Arrays are *sharded*. A shard (outer chunk, one file) is 32³ texels × all coefficients, the
//! unit of atomic writing; an inner chunk is one brick, 8³ texels × all coefficients, the unit of
//! reading and of checksums (bytes + crc32c, no compression). Bricks that were not baked take no
//! space and read as the fill value.
//!
//! # Trust
//! Everything read from a store is checked before use: bricks, shard indices and samples by
//! CRC-32C, attributes and extents by BLAKE3, array metadata against what the identity implies,
//! the volume against its content hash. Not checked, because not read here, is only the root's
//! `consolidated_metadata`, a courtesy to other readers. The attributes are ours: who adds some
//! breaks their hash. Files are not synchronised with the disk by default
//! ([`Store::set_sync`]): after a power cut a chunk may be lost, and is then found damaged.
//!
//! # Panics
//! None, on any bytes (`tests/fuzz.rs`). `unwrap` and `expect` are denied. Indexing is not: indices are axes,
//! slots of a chunk, JSON fields (which read as null when absent), or ranges of a file whose length was compared
//! a step before.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]

mod backing;
mod chunk;
pub mod diagnose;
mod extent;
mod holdings;
mod identity;
mod joint;
mod lock;
mod merge;
mod volume;
mod zarr;

#[cfg(test)]
mod tests;

pub use diagnose::{Diagnosis, diagnose};
pub use extent::{Baked, ChunkExtent, ErrorTarget};
pub use holdings::Holdings;
pub use identity::{FORMAT_VERSION, Identity, SceneIdentity};
pub use joint::{CouplingIdentity, PartnerIdentity};
pub use lock::StoreLock;
pub use merge::MergeReport;
pub use volume::FRONT_NOT_RECORDED;

use super::{Group, Layout};
use crate::error::{Error, Result};
use crate::volume::Volume;
use backing::Backing;
use chunk::{ARRAYS, OpenChunk};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::OnceLock;
use zarr::{Array, FORMAT, METADATA_REMEDY};

#[cfg(target_endian = "big")]
compile_error!("stores are mapped and read in place as little-endian numbers: big-endian hosts are not supported");

/// Most chunks a store may have: 161 times 32 texels along each axis. Each costs 16 bytes when a
/// store is opened.
const MOST_CHUNKS: usize = 1 << 22;
/// Longest provenance in bytes of JSON; readers take metadata files of up to 64 MiB, and the
/// root repeats it.
const LONGEST_PROVENANCE: usize = 8 << 20;
/// Stated in every store for readers without this program.
const HARMONICS: &str = "real, orthonormal spherical harmonics in world axes without the Condon-Shortley sign: \
    Y_1,-1 = 0.488603 y, Y_1,0 = 0.488603 z, Y_1,1 = 0.488603 x; coefficient i = l(l+1)+m of degree l and order m";
/// Stated in every store for readers without this program.
const MEANING: &str = "exitant radiance of the Lambertian level set through a texel under L(w) = sum_i L_i Y_i(w) is \
    sum_k albedo^(k+1) <T_k, L>; layer k of the last axis of `transfer` starts at layers[k].offset";

/// Stated in stores of scenes.
const MEANING_OF_CHANNELS: &str = "each layer holds its bands^2 red coefficients, then green, then blue";
/// Stated in the groups of luminaires.
const MEANING_OF_GROUPS: &str = "the level set of albedo rho sends out sum_k rho^(k+1) G_k in W m-2 sr-1 on behalf of \
    this group; the last axis of `transfer` is 3 k + channel (red, green, blue)";

/// A store, open for reading and writing.
#[derive(Debug)]
pub struct Store {
    backing: Backing,
    identity: Identity,
    layout: Layout, // Invariant: identity.layout(), or that of a group.
    provenance: Value,
    /// Key of the transfer group.
    env: String,
    /// Key of the volume's array.
    data: String,
    // Invariant: one cell for each chunk of the lattice, x fastest.
    chunks: Vec<OnceLock<Option<Box<OpenChunk>>>>,
    sync: bool,
}

impl Store {
    /// Makes a store for a bake of `volume`: the volume is copied into it, no chunk is there yet.
    /// `provenance` is kept as it is: whatever a reader should know about how it was made. The
    /// store appears under its name when it is complete; a run that is killed before leaves a
    /// directory named `.partial-…` beside it.
    ///
    /// # Errors
    /// When there is something at `path`, the identity is not of this volume and format, the
    /// texture has too many chunks, the provenance is longer than 8 MiB, or the system refuses.
    pub fn create(path: impl AsRef<Path>, volume: &Volume, identity: &Identity, provenance: Value) -> Result<Self> {
        let path = path.as_ref();
        if path.symlink_metadata().is_ok() {
            return Err(Error::argument(
                "output",
                path.display(),
                "a path where nothing is yet",
                "give another output with -o, or delete what is there",
            ));
        }
        let layout = identity.layout()?;
        check_chunks(&layout)?;
        check_volume(volume, identity)?;
        check_provenance(&provenance)?;
        let directory = backing::temporary_directory(path)?;
        let staging = Backing::Directory(directory.path().into());
        write_skeleton(&staging, volume, identity, &layout, provenance)
            .map_err(|e| renamed(e, directory.path(), path))?;
        std::fs::rename(directory.path(), path).map_err(|e| Error::io(path, "create the store", e))?;
        let _ = directory.keep(); // It has moved: nothing to remove.
        Self::open(path)
    }

    /// Opens the directory of a store, or a zip of one whose entries are not compressed.
    ///
    /// # Errors
    /// When there is none, or it was made by another version or another program, or is damaged.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let backing = Backing::open(path.as_ref())?;
        let first = open_root(&backing)?.swap_remove(0);
        Self::open_node(backing, &first)
    }

    /// Opens the transfer of one volume.
    fn open_node(backing: Backing, node: &str) -> Result<Self> {
        let env = format!("transfer/{node}/env");
        for group in ["volumes".to_owned(), format!("volumes/{node}"), "transfer".into(), format!("transfer/{node}")] {
            let key = format!("{group}/zarr.json");
            check_group(&required_json(&backing, &key)?).map_err(|e| e.in_file(backing.name(&key)))?;
        }
        let key = format!("{env}/zarr.json");
        let (identity, mut attributes) = joint::read_identity(&backing, &key)?;
        let in_file = |e: Error| e.in_file(backing.name(&key));
        check_version(&json!(identity.format_version)).map_err(in_file)?;
        let layout = identity.layout().map_err(in_file)?;
        let count = check_chunks(&layout)?;
        for (name, array) in arrays(&layout) {
            let key = format!("{env}/{name}/zarr.json");
            array.check(&required_json(&backing, &key)?).map_err(|e| e.in_file(backing.name(&key)))?;
        }
        Ok(Self {
            provenance: attributes["provenance"].take(),
            chunks: std::iter::repeat_with(OnceLock::new).take(count).collect(),
            data: format!("volumes/{node}/data"),
            sync: false,
            backing,
            identity,
            layout,
            env,
        })
    }

    /// Opens the store at `path` to go on with its bake, or makes it if nothing is there.
    ///
    /// # Errors
    /// [`Error::Mismatch`] naming the first field of the identity that differs; otherwise as
    /// [`Self::open`] and [`Self::create`].
    pub fn open_or_create(
        path: impl AsRef<Path>,
        volume: &Volume,
        identity: &Identity,
        provenance: Value,
    ) -> Result<Self> {
        let path = path.as_ref();
        if path.symlink_metadata().is_err() {
            match Self::create(path, volume, identity, provenance) {
                // Another process was quicker.
                Err(Error::Io { .. } | Error::Argument { .. }) if path.join("zarr.json").is_file() => {}
                result => return result,
            }
        }
        let store = Self::open(path)?;
        store.identity.check(identity, path)?;
        Ok(store)
    }

    /// The volume that was baked.
    ///
    /// # Errors
    /// When it is damaged or cannot be read.
    pub fn volume(&self) -> Result<Volume> {
        let volume = volume::read(&self.backing, &self.data, self.identity.grid)?;
        let (found, side) = (volume.content_hash(), identity::solid_name(volume.solid));
        if found != self.identity.volume || side != self.identity.solid {
            return Err(Error::format(
                FORMAT,
                format!("a volume with BLAKE3 {found}, solid {side}"),
                format!("BLAKE3 {}, solid {}", self.identity.volume, self.identity.solid),
                METADATA_REMEDY,
            )
            .in_file(self.backing.name(&self.data)));
        }
        Ok(volume)
    }

    /// The texture of a group, as a store of its own that shares the files; its chunks are written and read apart.
    ///
    /// # Errors
    /// When the store has no such group, or its metadata are damaged.
    pub fn group(&self, group: &Group) -> Result<Self> {
        if !self.identity.groups().contains(group) {
            let held: Vec<String> = self.identity.groups().iter().map(Group::node).collect();
            let remedy = "bake the scene that has it";
            return Err(Error::argument("group", group.node(), format!("one of {}", held.join(", ")), remedy));
        }
        let backing = Backing::open(self.backing.path())?;
        let layout = group.layout(&self.layout)?;
        let folder = self.env.rsplit_once('/').map_or("", |(folder, _)| folder);
        let env = format!("{folder}/{}", group.node());
        for (name, array) in arrays(&layout) {
            let key = format!("{env}/{name}/zarr.json");
            array.check(&required_json(&backing, &key)?).map_err(|e| e.in_file(backing.name(&key)))?;
        }
        Ok(Self {
            backing,
            identity: self.identity.clone(),
            provenance: self.provenance.clone(),
            chunks: std::iter::repeat_with(OnceLock::new).take(self.chunks.len()).collect(),
            data: self.data.clone(),
            sync: self.sync,
            layout,
            env,
        })
    }

    /// What was baked and how.
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// What was handed to [`Self::create`].
    pub fn provenance(&self) -> &Value {
        &self.provenance
    }

    /// Lattice and layers.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The path of the directory or archive.
    pub fn path(&self) -> &Path {
        self.backing.path()
    }

    /// Whether every write waits until the disk has it. Off at first: a chunk that is lost in a
    /// power cut is baked again.
    pub fn set_sync(&mut self, sync: bool) {
        self.sync = sync;
    }

    /// Forgets which chunks were opened, so that bricks written since are seen.
    pub fn refresh(&mut self) {
        self.chunks.iter_mut().for_each(|cell| *cell = OnceLock::new());
    }

    /// Takes the lock that keeps a second bake out; let go when dropped. Reading and
    /// [`Self::write_chunk`] do not ask for it: processes that share out the chunks need none.
    ///
    /// # Errors
    /// When somebody else holds it, the store is an archive, or the file system has no locks.
    pub fn lock(&self) -> Result<StoreLock> {
        lock::lock(self.directory()?)
    }

    /// Takes the lock of share `share` of `shares` (from 1): it keeps out a bake of everything, another bake of this
    /// share, and bakes that share the chunks out differently; other shares of as many go on beside it.
    ///
    /// # Errors
    /// As [`Self::lock`].
    pub fn lock_share(&self, share: usize, shares: usize) -> Result<StoreLock> {
        lock::lock_share(self.directory()?, share, shares)
    }

    fn directory(&self) -> Result<&Path> {
        match &self.backing {
            Backing::Directory(path) => Ok(path),
            Backing::Archive(_) => {
                Err(Error::argument("store", self.path().display(), "a directory", "unpack the archive first"))
            }
        }
    }

    /// Writes a record of the bake that belongs to no chunk, under a name of letters; it replaces the one before.
    ///
    /// # Errors
    /// When the store is an archive or the system refuses.
    pub fn write_record(&self, name: &str, record: &Value) -> Result<()> {
        let text = format!("{:#}\n", sealed(json!({ "record": record })));
        self.backing.put(&format!("{}/{name}.json", self.env), self.sync, text.as_bytes())
    }

    /// A record that was written; `None` if there is none of that name.
    ///
    /// # Errors
    /// When it is damaged or cannot be read.
    pub fn record(&self, name: &str) -> Result<Option<Value>> {
        let key = format!("{}/{name}.json", self.env);
        let Some(sealed) = self.backing.json(&key)? else { return Ok(None) };
        let mut record = unsealed(&json!({ "attributes": sealed })).map_err(|e| e.in_file(self.backing.name(&key)))?;
        Ok(Some(record["record"].take()))
    }
}

/// An error that names the place it would have had, not the temporary one.
fn renamed(error: Error, temporary: &Path, target: &Path) -> Error {
    match error {
        Error::Io { path, doing, source } => {
            let path = path.strip_prefix(temporary).map_or_else(|_| path.clone(), |inside| target.join(inside));
            Error::Io { path, doing, source }
        }
        other => other,
    }
}

/// Packs the directory of a store into a zip archive that [`Store::open`] maps in place. Equal
/// stores give equal archives.
///
/// # Errors
/// When `directory` is not a store, there is something at `out`, or the system refuses.
pub fn pack_zip(directory: impl AsRef<Path>, out: impl AsRef<Path>) -> Result<()> {
    Store::open(&directory)?;
    backing::pack(directory.as_ref(), out.as_ref())
}

/// The arrays of the transfer group, in the order of [`ARRAYS`].
fn arrays(layout: &Layout) -> [(&'static str, Array); 4] {
    let [x, y, z] = layout.lattice.texels();
    let array = |data_type, fill, fourth: Option<(usize, &'static str)>| {
        let extended = |side: [usize; 3]| side.into_iter().chain(fourth.map(|(n, _)| n)).collect();
        Array {
            shape: extended([z, y, x]),
            chunk: extended([super::CHUNK; 3]),
            inner: Some(extended([super::BRICK; 3])),
            data_type,
            fill,
            names: ["z", "y", "x"].into_iter().chain(fourth.map(|(_, name)| name)).collect(),
        }
    };
    let arrays = [
        array("float16", json!("NaN"), Some((layout.layers.coefficients(), "coefficient"))),
        array("float16", json!("NaN"), Some((layout.layers.errors(), "layer_band"))),
        array("uint8", json!(0), None),
        array("uint32", json!(0), None),
    ];
    let mut names = ARRAYS.into_iter();
    arrays.map(|array| (names.next().map_or("", |(name, _)| name), array))
}

/// Writes everything of a store but its chunks.
fn write_skeleton(
    backing: &Backing,
    volume: &Volume,
    identity: &Identity,
    layout: &Layout,
    provenance: Value,
) -> Result<()> {
    let node = node_name(&volume.name);
    let nodes = nodes_of(volume, identity, layout, provenance)?;
    let mut root = zarr::group(sealed(root_about(std::slice::from_ref(&node))));
    zarr::consolidate(&mut root, &nodes);
    let put = |key: &str, value: &Value| backing.put(key, false, format!("{value:#}\n").as_bytes());
    put("zarr.json", &root)?;
    for (key, value) in &nodes {
        put(&format!("{key}/zarr.json"), value)?;
    }
    volume::write(backing, &format!("volumes/{node}/data"), volume, false)
}

/// What the root says of the volumes in the store.
fn root_about(nodes: &[String]) -> Value {
    let mut about = json!({ "format_version": FORMAT_VERSION, "volume": nodes.first() });
    if nodes.len() > 1 {
        about["volumes"] = json!(nodes);
    }
    json!({ "isolume": about })
}

/// The metadata of all groups and arrays of a volume, with the groups that hold them.
fn nodes_of(volume: &Volume, identity: &Identity, layout: &Layout, provenance: Value) -> Result<Vec<(String, Value)>> {
    let node = node_name(&volume.name);
    let layers = &layout.layers;
    let layer = |k: usize| {
        json!({
            "bands": layers.bands()[k],
            "offset": layers.offset(k),
            "stderr_offset": layers.error_offset(k),
        })
    };
    let step = std::array::from_fn(|axis| layout.lattice.step(axis));
    let mut attributes = json!({
        "identity": identity,
        "identity_blake3": identity.hash(),
        "layers": (0..layers.len()).map(layer).collect::<Vec<_>>(),
        "spherical_harmonics": HARMONICS,
        "meaning": MEANING,
        "world_from_texel": volume::rows(volume.world_from_grid(), step),
        "provenance": provenance,
    });
    if layers.channels() != 1 {
        attributes["channels"] = json!(MEANING_OF_CHANNELS);
    }
    let attributes = sealed(attributes);
    let mut nodes = vec![
        ("volumes".into(), zarr::group(json!({}))),
        (format!("volumes/{node}"), zarr::group(json!({}))),
        (format!("volumes/{node}/data"), volume::metadata(volume)),
        ("transfer".into(), zarr::group(json!({}))),
        (format!("transfer/{node}"), zarr::group(json!({}))),
        (format!("transfer/{node}/env"), zarr::group(attributes)),
    ];
    for (name, array) in arrays(layout) {
        nodes.push((format!("transfer/{node}/env/{name}"), array.metadata(json!({}))));
    }
    for group in identity.groups().iter().skip(1) {
        let place = format!("transfer/{node}/{}", group.node());
        let attributes = sealed(json!({ "identity_blake3": identity.hash(), "meaning": MEANING_OF_GROUPS }));
        nodes.push((place.clone(), zarr::group(attributes)));
        for (name, array) in arrays(&group.layout(layout)?) {
            nodes.push((format!("{place}/{name}"), array.metadata(json!({}))));
        }
    }
    Ok(nodes)
}

/// The name of a volume as a node of the hierarchy: letters, digits, `-`, `_` and `.` stay,
/// anything else becomes `_`; no leading `.` or `__`, at most 64 characters.
fn node_name(name: &str) -> String {
    let keep = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let name: String = name.chars().map(keep).take(64).collect();
    if name.is_empty() || name.starts_with('.') || name.starts_with("__") {
        return node_name(&format!("volume{name}"));
    }
    name
}

/// BLAKE3 of a JSON value with its keys sorted and without spaces.
fn hash_of(value: &Value) -> blake3::Hash {
    let mut sorted = value.clone();
    sorted.sort_all_objects();
    blake3::hash(sorted.to_string().as_bytes())
}

/// Attributes with their own hash added as `blake3`.
fn sealed(mut attributes: Value) -> Value {
    attributes["blake3"] = json!(hash_of(&attributes).to_hex().as_str());
    attributes
}

/// The attributes of a node without their hash, which is compared.
fn unsealed(metadata: &Value) -> Result<Value> {
    let mut attributes = metadata.get("attributes").cloned().unwrap_or_default();
    let stored = attributes.as_object_mut().and_then(|fields| fields.shift_remove("blake3")).unwrap_or_default();
    let found = json!(hash_of(&attributes).to_hex().as_str());
    if found == stored {
        return Ok(attributes);
    }
    let (found, expected) = (format!("attributes with BLAKE3 {found}"), format!("BLAKE3 {}", zarr::shorten(&stored)));
    Err(Error::format(FORMAT, found, expected, METADATA_REMEDY))
}

/// A JSON document that must be there.
fn required_json(backing: &Backing, key: &str) -> Result<Value> {
    backing.json(key)?.ok_or_else(|| {
        Error::format(FORMAT, "no such file", "the metadata of a part of the store", METADATA_REMEDY)
            .in_file(backing.name(key))
    })
}

/// Checks the root and returns the node names of the volumes: at least one.
fn open_root(backing: &Backing) -> Result<Vec<String>> {
    let foreign = |found: &str| {
        let expected = "a store made by isolume (the directory that holds its zarr.json, or a zip of it)";
        Error::format(FORMAT, found, expected, "give the path of a store, or bake one").in_file(backing.path())
    };
    let Some(root) = backing.json("zarr.json")? else {
        let old = backing.exists(".zgroup") || backing.exists(".zarray");
        return Err(foreign(if old { "Zarr data of version 2" } else { "no zarr.json inside" }));
    };
    let in_file = |e: Error| e.in_file(backing.name("zarr.json"));
    if root["node_type"] == "array" {
        return Err(foreign("a Zarr array"));
    }
    check_group(&root).map_err(in_file)?;
    if root["attributes"]["isolume"].is_null() {
        return Err(foreign("a Zarr hierarchy that another program made"));
    }
    check_version(&root["attributes"]["isolume"]["format_version"]).map_err(in_file)?;
    let attributes = unsealed(&root).map_err(in_file)?;
    joint::nodes_of_root(&attributes).map_err(in_file)
}

fn check_group(metadata: &Value) -> Result<()> {
    if metadata["zarr_format"] == 3 && metadata["node_type"] == "group" {
        return Ok(());
    }
    let found = format!("zarr_format {}, node_type {}", metadata["zarr_format"], metadata["node_type"]);
    Err(Error::format(FORMAT, found, "a Zarr group of version 3", METADATA_REMEDY))
}

fn check_version(found: &Value) -> Result<()> {
    if *found == FORMAT_VERSION {
        return Ok(());
    }
    let found = format!("format version {}", zarr::shorten(found));
    let remedy = "use the version of isolume that made the store, or bake again into another path";
    Err(Error::format(FORMAT, found, format!("format version {FORMAT_VERSION}"), remedy))
}

/// The number of chunks of a layout, if it is not too large.
fn check_chunks(layout: &Layout) -> Result<usize> {
    let count = layout.lattice.chunks().into_iter().try_fold(1usize, usize::checked_mul);
    count.filter(|&count| count <= MOST_CHUNKS).ok_or_else(|| Error::Limit {
        what: format!("a texture of {:?} texels", layout.lattice.texels()),
        needed: count.map_or_else(|| "more chunks than can be counted".into(), |n| format!("{n} chunks")),
        limit: format!("{MOST_CHUNKS} chunks of 32³ texels"),
        remedy: "use fewer texels".into(),
    })
}

/// Whether an identity belongs to a volume and to this format.
fn check_volume(volume: &Volume, identity: &Identity) -> Result<()> {
    let layout = identity.layout()?;
    let here = Identity::new(volume, &layout, &identity.estimator, identity.positive, identity.seed);
    let here = Identity { grid: volume.dims(), scene: identity.scene.clone(), ..here };
    match identity.first_difference(&here) {
        None => Ok(()),
        Some((field, given, expected)) => Err(Error::argument(
            format!("identity.{field}"),
            given,
            format!("{expected}, that of the volume and of this format"),
            "make the identity from the volume that is baked",
        )),
    }
}

/// Whether the provenance can be written and read back.
fn check_provenance(provenance: &Value) -> Result<()> {
    let text = provenance.to_string();
    if text.len() > LONGEST_PROVENANCE {
        return Err(Error::Limit {
            what: "the provenance".into(),
            needed: format!("{} bytes", text.len()),
            limit: format!("{LONGEST_PROVENANCE} bytes"),
            remedy: "keep long tables in a file of their own".into(),
        });
    }
    // The reader allows 128 levels, of which four are around the provenance.
    let wrapped = format!("[[[[[[[[{text}]]]]]]]]");
    match serde_json::from_str::<Value>(&wrapped) {
        Ok(_) => Ok(()),
        Err(e) => Err(Error::argument("provenance", e, "JSON nested at most 100 deep", "make it flatter")),
    }
}
