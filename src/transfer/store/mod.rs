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
//!     rays/extent/z.y.x.json        how far each chunk was baked (not part of Zarr)
//!     rays/asked.json               the isosurfaces that were asked for so far (not part of Zarr)
//!     rays/allocation.json          what a bake in a given time decided, if there was one (not part of Zarr)
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
//! the volume against its content hash, the record of each chunk against the identity of its store. The root's
//! `consolidated_metadata`, a courtesy to other readers, is not read here; [`diagnose()`] compares it with what it
//! repeats. The attributes are ours: who adds some breaks their hash. Writes are synchronised with the disk in an order
//! that a power cut cannot mix up ([`StoreOptions::sync`]); what is found damaged all the same is mended by the next bake
//! ([`Store::open_or_create`], [`Store::verify_chunks`]).
//!
//! The format is described for other programs in `FORMAT.md` beside this file.
//!
//! # Panics
//! None, on any bytes (`tests/fuzz`). `unwrap` and `expect` are denied. Indexing is not: indices are axes,
//! slots of a chunk, JSON fields (which read as null when absent), or ranges of a file whose length was compared
//! a step before.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]

mod archive;
mod backing;
mod checks;
mod chunk;
pub mod complete;
pub mod diagnose;
mod estimator;
mod extent;
mod filled;
mod holdings;
mod identity;
mod joint;
pub mod kind;
mod lock;
mod mend;
mod merge;
mod metadata;
mod options;
mod pack;
mod packed;
mod replace;
mod surface;
mod verify;
mod volume;
mod zarr;

#[cfg(test)]
mod tests;

pub use complete::{Completeness, Work};
pub use diagnose::{Diagnosis, diagnose};
pub use estimator::{EstimatorIdentity, Shadows, Surroundings};
pub use extent::{Baked, ChunkExtent, ErrorTarget};
pub use holdings::Holdings;
pub use identity::{BodyIdentity, FORMAT_VERSION, Identity, OLDEST_FORMAT_VERSION, SceneIdentity};
pub use joint::{CouplingIdentity, PartnerIdentity};
pub use kind::{check_store, is_store};
pub use lock::StoreLock;
pub use merge::MergeReport;
pub use options::StoreOptions;
pub use pack::{PackError, PackReport, PackedGroup};
pub use packed::{BAKED, Packing};
pub use replace::Replacement;
pub use verify::ChunkCheck;
pub use volume::FRONT_NOT_RECORDED;

use super::{Group, Layout};
use crate::error::{Error, Result};
use crate::staging;
use crate::volume::{REMEDY_OF_REFERENCE, Volume};
use backing::{Backing, Directory};
use chunk::OpenChunk;
use filled::Filled;
use metadata::{
    arrays_of, check_chunks, check_group, check_provenance, check_version, check_volume, hash_of, node_name, open_root,
    packing_of, required_json, sealed, unsealed, write_skeleton,
};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock};
use surface::Mark;
use zarr::{FORMAT, METADATA_REMEDY};

#[cfg(target_endian = "big")]
compile_error!("stores are mapped and read in place as little-endian numbers: big-endian hosts are not supported");

/// A store, open for reading and writing.
#[derive(Debug)]
pub struct Store {
    backing: Backing,
    identity: Identity,
    // Invariant: identity.hash().
    identity_hash: String,
    layout: Layout, // Invariant: identity.layout(), or that of a group.
    provenance: Value,
    /// Key of the transfer group.
    env: String,
    /// Key of the volume's array.
    data: String,
    // Invariant: one cell for each chunk of the lattice, x fastest.
    chunks: Vec<OnceLock<Option<Box<OpenChunk>>>>,
    sync: bool,
    mended: Vec<String>,
    group: Group,
    /// Of a store of the vertices of an isosurface.
    surface: Option<Mark>,
    /// Of a group whose chunks are packed.
    packing: Option<Packing>,
    filled: Filled,
    /// One thread at a time expands a chunk: by its linear index, modulo their number.
    turns: [Mutex<()>; 16],
}

impl Store {
    /// Makes a store for a bake of `volume`: the volume is copied into it, no chunk is there yet.
    /// `provenance` is kept as it is: whatever a reader should know about how it was made. The
    /// store appears under its name when it is complete; a run that is killed before leaves a
    /// directory named `.partial-…` beside it, which a later one removes.
    ///
    /// Writes are synchronised with the disk; [`StoreOptions`] switches that off.
    ///
    /// # Errors
    /// When there is something at `path`, the identity is not of this volume and format, the
    /// texture has too many chunks, the provenance is longer than 8 MiB, or the system refuses.
    #[doc(hidden)]
    pub fn create(path: impl AsRef<Path>, volume: &Volume, identity: &Identity, provenance: Value) -> Result<Self> {
        StoreOptions::default().create(path, volume, identity, provenance)
    }

    fn create_with(path: &Path, volume: &Volume, identity: &Identity, provenance: Value, sync: bool) -> Result<Self> {
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
        let failed = |e| Error::io(path, "create the store", e);
        let folder = staging::folder_of(path);
        let directory = staging::directory_in(folder).map_err(failed)?;
        let staged = Backing::Directory(Directory::open(directory.path())?);
        write_skeleton(&staged, volume, identity, &layout, provenance)
            .map_err(|e| renamed(e, directory.path(), path))?;
        if sync {
            staging::sync_tree(directory.path()).map_err(failed)?;
        }
        std::fs::rename(directory.path(), path).map_err(failed)?;
        let _ = directory.keep(); // It has moved: nothing to remove.
        if sync {
            staging::sync_directory(folder).map_err(failed)?;
        }
        let mut store = Self::open(path)?;
        store.sync = sync;
        Ok(store)
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

    /// As [`Self::open`] of a directory, with files that are read into memory instead of mapped: slower, and as much
    /// memory as is looked at, but a file that another program cuts off meanwhile is an error. Where files are mapped the
    /// system ends the process then (SIGBUS).
    ///
    /// # Errors
    /// As [`Self::open`]; when there is no directory at `path`.
    pub fn open_unmapped(path: impl AsRef<Path>) -> Result<Self> {
        let backing = Backing::Directory(Directory::open(path.as_ref())?.unmapped());
        let first = open_root(&backing)?.swap_remove(0);
        Self::open_node(backing, &first)
    }

    /// The same store, which maps the samples that it names a file of, or reads them into memory, as at first: whoever writes
    /// that file while it is mapped changes the samples, and whoever cuts it off ends the process ([`Self::open_unmapped`]).
    #[must_use]
    #[doc(hidden)]
    pub fn map_samples(mut self, maps: bool) -> Self {
        self.backing.map_samples(maps);
        self
    }

    /// [`Self::open`] and [`Self::map_samples`]; tells which files samples are read from.
    ///
    /// # Errors
    /// As [`Self::open`].
    #[doc(hidden)]
    pub fn open_telling(path: impl AsRef<Path>, maps: bool, note: impl Fn(&str)) -> Result<Self> {
        let store = Self::open(path)?.map_samples(maps);
        store.notes()?.iter().for_each(|text| note(text));
        Ok(store)
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
        let packing = packing_of(&backing, &env, &layout.layers)?;
        for (name, array) in arrays_of(&layout, packing.as_ref()) {
            let key = format!("{env}/{name}/zarr.json");
            array.check(&required_json(&backing, &key)?).map_err(|e| e.in_file(backing.name(&key)))?;
        }
        Ok(Self {
            packing,
            turns: Default::default(),
            provenance: attributes["provenance"].take(),
            chunks: std::iter::repeat_with(OnceLock::new).take(count).collect(),
            filled: Filled::new(if identity.adaptive.is_some() { count } else { 0 }),
            data: format!("volumes/{node}/data"),
            sync: false,
            identity_hash: identity.hash(),
            mended: Vec::new(),
            group: Group::Environment,
            surface: None,
            backing,
            identity,
            layout,
            env,
        })
    }

    /// Opens the store at `path` to go on with its bake, or makes it if nothing is there. Metadata and samples that were
    /// damaged are written anew ([`Self::mended`]): they follow from `volume` and `identity`.
    ///
    /// # Errors
    /// [`Error::Mismatch`] naming the first field of the identity that differs; when metadata is damaged and nothing
    /// proves whose store it is ([`StoreOptions::repair`]); otherwise as [`Self::open`] and [`Self::create`].
    #[doc(hidden)]
    pub fn open_or_create(
        path: impl AsRef<Path>,
        volume: &Volume,
        identity: &Identity,
        provenance: Value,
    ) -> Result<Self> {
        StoreOptions::default().open_or_create(path, volume, identity, provenance)
    }

    /// Takes the hash of a volume from the store at `path`, if that refers to the same file, which has the length and time that it
    /// had: many tasks then hash it once.
    #[doc(hidden)]
    pub fn recognise(path: impl AsRef<Path>, volume: &Volume) {
        let node = node_name(&volume.name);
        if let Ok(backing) = Backing::open(path.as_ref())
            && volume::is_of(&backing, &format!("volumes/{node}/data"), volume)
            && let Ok((identity, _)) = joint::read_identity(&backing, &format!("transfer/{node}/env/zarr.json"))
        {
            volume.trust_hash(&identity.volume);
        }
    }

    /// What was damaged or missing when the store was opened to go on with it, and was written anew; one line each.
    #[doc(hidden)]
    pub fn mended(&self) -> &[String] {
        &self.mended
    }

    /// The name of its volume as a node of the hierarchy.
    fn node(&self) -> &str {
        self.env.split('/').nth(1).unwrap_or_default()
    }

    /// The volume that was baked. Every sample is verified, except of one whose file is mapped ([`Self::map_samples`]): there length and
    /// time of the file.
    ///
    /// # Errors
    /// When it is damaged or cannot be read; when a file that the store refers to is not there or has changed.
    pub fn volume(&self) -> Result<Volume> {
        self.volume_verified(false)
    }

    /// [`Self::volume`], all of it verified if that is asked for.
    fn volume_verified(&self, all: bool) -> Result<Volume> {
        let volume = volume::read(&self.backing, &self.data, self.identity.grid)?;
        if volume.by_reference && !all {
            volume.trust_hash(&self.identity.volume);
        }
        let (found, side) = (volume.content_hash(), identity::solid_name(volume.solid));
        if found != self.identity.volume || side != self.identity.solid {
            let found = format!("a volume with BLAKE3 {found}, solid {side}");
            let expected = format!("BLAKE3 {}, solid {}", self.identity.volume, self.identity.solid);
            return Err(match self.samples_file() {
                Some(file) => Error::format(FORMAT, found, expected, REMEDY_OF_REFERENCE).in_file(file),
                None => Error::format(FORMAT, found, expected, METADATA_REMEDY).in_file(self.backing.name(&self.data)),
            });
        }
        Ok(volume)
    }

    /// The file that the samples of its volume stay in; none where the store holds a copy, or its metadata are damaged.
    #[doc(hidden)]
    pub fn samples_file(&self) -> Option<PathBuf> {
        let metadata = self.backing.json(&format!("{}/zarr.json", self.data)).ok()??;
        volume::reference(&metadata).map(|place| place.file)
    }

    /// Which files the samples of its volumes are read from, one line each; none where it holds copies.
    ///
    /// # Errors
    /// When the root is damaged.
    #[doc(hidden)]
    pub fn notes(&self) -> Result<Vec<String>> {
        let mut notes = Vec::new();
        for node in self.volumes()? {
            let metadata = self.backing.json(&format!("volumes/{node}/data/zarr.json"));
            if let Some(place) = metadata.ok().flatten().as_ref().and_then(volume::reference) {
                notes.push(format!("samples of {node} are read from {}, which the store names", place.file.display()));
            }
        }
        Ok(notes)
    }

    /// Says where the samples stay, if that is not how `volume` is to be kept.
    pub(crate) fn keeps_otherwise(&self, volume: &Volume) -> Option<String> {
        volume::differs(&self.backing.json(&format!("{}/zarr.json", self.data)).ok()??, volume)
    }

    /// The texture of a group, as a store of its own that shares the files; its chunks are written and read apart.
    ///
    /// # Errors
    /// When the store has no such group, or its metadata are damaged.
    #[doc(hidden)]
    pub fn group(&self, group: &Group) -> Result<Self> {
        if !self.identity.groups().contains(group) {
            let held: Vec<String> = self.identity.groups().iter().map(Group::node).collect();
            let remedy = "bake the scene that has it";
            return Err(Error::argument("group", group.node(), format!("one of {}", held.join(", ")), remedy));
        }
        let backing = self.backing.again()?;
        let layout = group.layout(&self.layout)?;
        let env = match (group, &self.surface) {
            (Group::Environment, _) => self.env.clone(),
            (_, Some(_)) => format!("{}/{}", self.env, group.node()),
            (_, None) => format!("{}/{}", self.env.rsplit_once('/').map_or("", |(folder, _)| folder), group.node()),
        };
        let packing = packing_of(&backing, &env, &layout.layers)?;
        for (name, array) in arrays_of(&layout, packing.as_ref()) {
            let key = format!("{env}/{name}/zarr.json");
            array.check(&required_json(&backing, &key)?).map_err(|e| e.in_file(backing.name(&key)))?;
        }
        Ok(Self {
            packing,
            turns: Default::default(),
            backing,
            identity: self.identity.clone(),
            identity_hash: self.identity_hash.clone(),
            mended: Vec::new(),
            provenance: self.provenance.clone(),
            chunks: std::iter::repeat_with(OnceLock::new).take(self.chunks.len()).collect(),
            filled: Filled::new(if self.leaves_out() { self.chunks.len() } else { 0 }),
            data: self.data.clone(),
            sync: self.sync,
            group: group.clone(),
            surface: self.surface.clone(),
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

    /// How its transfer was packed; `None` where it is kept as it was baked.
    pub fn packing(&self) -> Option<&Packing> {
        self.packing.as_ref()
    }

    /// Refuses to write into a packed store.
    ///
    /// # Errors
    /// When it is one.
    #[doc(hidden)]
    pub fn check_not_packed(&self) -> Result<()> {
        if self.packing.is_none() {
            return Ok(());
        }
        let remedy = "bake into the store that it was made of and pack that again, or give another output with -o";
        Err(Error::argument(
            "store",
            format!("{}, which is packed", self.path().display()),
            "a store that is not",
            remedy,
        ))
    }

    /// Forgets which chunks were opened, so that bricks written since are seen.
    #[doc(hidden)]
    pub fn refresh(&mut self) {
        self.chunks.iter_mut().for_each(|cell| *cell = OnceLock::new());
        self.filled.clear();
    }

    /// Takes the lock that keeps a second bake out; let go when dropped. Reading and
    /// [`Self::write_chunk`] do not ask for it: processes that share out the chunks need none.
    ///
    /// # Errors
    /// When somebody else holds it, the store is an archive, or the file system has no locks.
    #[doc(hidden)]
    pub fn lock(&self) -> Result<StoreLock> {
        lock::lock(self.directory()?.path())
    }

    /// Takes the lock of share `share` of `shares` (from 1): it keeps out a bake of everything, another bake of this
    /// share, and bakes that share the chunks out differently; other shares of as many go on beside it.
    ///
    /// # Errors
    /// As [`Self::lock`].
    #[doc(hidden)]
    pub fn lock_share(&self, share: usize, shares: usize) -> Result<StoreLock> {
        lock::lock_share(self.directory()?.path(), share, shares)
    }

    /// Who fills the store now: `share 3 of 16, process 71 on node7`, one a process, ascending.
    pub fn processes(&self) -> Vec<String> {
        self.directory().map(|directory| lock::processes(directory.path())).unwrap_or_default()
    }

    /// Waits for the right to rewrite a chunk that other shares rewrite too; let go when dropped.
    ///
    /// # Errors
    /// When the store is an archive, or the file system has no locks.
    #[doc(hidden)]
    pub fn lock_chunk(&self, index: [usize; 3]) -> Result<StoreLock> {
        lock::chunk(self.directory()?.path(), &self.env, index)
    }

    fn directory(&self) -> Result<&Directory> {
        match &self.backing {
            Backing::Directory(directory) => Ok(directory),
            Backing::Archive(_) => {
                Err(Error::argument("store", self.path().display(), "a directory", "unpack the archive first"))
            }
        }
    }

    /// Writes a record of the bake that belongs to no chunk, under a name of letters; it replaces the one before.
    ///
    /// # Errors
    /// When the store is an archive or the system refuses.
    #[doc(hidden)]
    pub fn write_record(&self, name: &str, record: &Value) -> Result<()> {
        let text = format!("{:#}\n", sealed(json!({ "record": record })));
        self.backing.put(&format!("{}/{name}.json", self.records_key()), self.sync, text.as_bytes())
    }

    /// A record that was written; `None` if there is none of that name.
    ///
    /// # Errors
    /// When it is damaged or cannot be read.
    #[doc(hidden)]
    pub fn record(&self, name: &str) -> Result<Option<Value>> {
        let key = format!("{}/{name}.json", self.records_key());
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
    archive::pack(directory.as_ref(), out.as_ref())
}
