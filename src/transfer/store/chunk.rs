//! Chunks of the transfer texture: written as a whole, read in place.
//!
//! # What one chunk consists of
//! Four shard files, one for each array, and a record of its extent. All five carry one *stamp*,
//! a hash of the record, which holds the chunk's index, the identity of its store, the name of its group, and a digest of
//! all bricks. Files from different writings, or moved from another chunk, group or store, therefore never pass for a
//! whole. (Records of the formats 1 and 2 do not name their store: there whole chunks of another one are not noticed.)
//!
//! # Order of writing
//! All five files are completed beside their places first, then renamed: the record, `validity`,
//! `rays`, `stderr`, and `transfer` last. A chunk exists if and only if its `transfer` shard does. Where writes are
//! synchronised, the disk has the four others and their names before `transfer` takes its own.
//! A run that is killed between two renames leaves either no `transfer` shard, so that the chunk
//! does not exist, or (where an older chunk is replaced) files with two stamps: *torn*. Bakes
//! treat a torn chunk as not baked and write it again; readers, after a few more tries in case
//! somebody is renaming at this moment, report it.

pub(super) mod examine;

use super::super::texture::{check_brick, check_index};
use super::super::{BRICK_TEXELS, Brick, BrickView, Layers};
use super::backing::{Backing, Bytes, Staged};
use super::identity::{FORMAT_VERSION, STAMPED_VERSION};
use super::packed::{self, Files, PACKED, Packing};
use super::surface::SURFACES;
use super::zarr::{self, FORMAT, Presence, STAMP, ShardTail};
use super::{ChunkExtent, Store};
use crate::error::{Error, Result};
use crate::grid3;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicU64, Ordering};

/// The arrays of a transfer group: name, and whether another axis follows z, y, x, or that of the vertices.
pub(super) const ARRAYS: [(&str, bool); 4] =
    [("transfer", true), ("stderr", true), ("validity", false), ("rays", false)];
/// How often a reader looks again at a chunk whose files do not belong together.
const TRIES: usize = 8;

/// A chunk whose files are open and belong together.
#[derive(Debug)]
pub(super) struct OpenChunk {
    index: [usize; 3],
    extent: ChunkExtent,
    bricks: Bricks,
}

/// The bricks of an open chunk.
#[derive(Debug)]
enum Bricks {
    /// Read in place.
    Mapped {
        shards: [Bytes; 4],
        // Invariant: the presence in every shard, checked against its length.
        present: Presence,
        /// Bricks whose checksums were found right, one bit each. Two threads may both verify a
        /// brick; they can only agree.
        verified: AtomicU64,
    },
    /// Of a packed chunk, expanded as a whole.
    Expanded(Vec<Option<Brick>>),
}

/// What the record of a chunk says.
struct Record {
    extent: ChunkExtent,
    stamp: [u8; STAMP],
    bricks: usize,
    payload: String,
}

/// What is found at the place of a chunk.
enum Found {
    Nothing,
    /// Files of two writings; the name of one that disagrees.
    Torn(PathBuf),
    Whole(Box<OpenChunk>),
}

/// Bytes of one brick in each of [`ARRAYS`].
fn brick_bytes(layers: &Layers) -> [usize; 4] {
    [2 * layers.coefficients(), 2 * layers.errors(), 1, 4].map(|texel| BRICK_TEXELS * texel)
}

/// The bytes of a brick in each of [`ARRAYS`].
fn bytes_of(brick: &Brick) -> [&[u8]; 4] {
    [
        bytemuck::cast_slice(&brick.transfer),
        bytemuck::cast_slice(&brick.stderr),
        &brick.validity,
        bytemuck::cast_slice(&brick.rays),
    ]
}

/// Where a record says that it belongs, for people.
fn origin(of: &Value) -> String {
    let text = |key: &str| of[key].as_str().unwrap_or("unknown").to_owned();
    let store = text("store");
    let short = store.get(..12).unwrap_or(&store);
    format!("volume {}, group {}, seed {}, identity {short}…", text("volume"), text("group"), of["seed"])
}

/// The stamp of a record and its hexadecimal digits.
fn stamp_of(record: &Value) -> ([u8; STAMP], String) {
    let hash = super::hash_of(record);
    let mut stamp = [0; STAMP];
    stamp.copy_from_slice(&hash.as_bytes()[..STAMP]);
    (stamp, hash.to_hex()[..2 * STAMP].to_owned())
}

impl Store {
    pub(super) fn shard_key(&self, array: usize, index: [usize; 3]) -> String {
        if self.packing.is_some() {
            return packed::key(&self.env, array, self.slot(index));
        }
        let (name, has_last_axis) = ARRAYS[array];
        let [x, y, z] = index;
        let mut indices = if self.layout.lattice.is_of_vertices() { vec![x] } else { vec![z, y, x] };
        if has_last_axis {
            indices.push(0);
        }
        zarr::chunk_key(&format!("{}/{name}", self.env), &indices)
    }

    /// Arrays that have a file of each chunk, or may have one.
    pub(super) fn array_count(&self) -> usize {
        if self.packing.is_some() { PACKED.len() } else { ARRAYS.len() }
    }

    /// Bricks of a chunk.
    pub(super) fn slots(&self) -> usize {
        self.layout.lattice.bricks_of_chunk().iter().product()
    }

    pub(super) fn extent_key(&self, [x, y, z]: [usize; 3]) -> String {
        format!("{}/extent/{z}.{y}.{x}.json", self.records_key())
    }

    /// The folder of what is no part of Zarr: in that of an array, where readers of Zarr do not look.
    pub(super) fn records_key(&self) -> String {
        if self.is_stamped() { format!("{}/rays", self.env) } else { self.env.clone() }
    }

    /// Whether records name their store.
    pub(super) fn is_stamped(&self) -> bool {
        self.identity.format_version >= STAMPED_VERSION
    }

    /// The part of a record that says where it belongs.
    fn belongs(&self) -> Value {
        let (part, place) = self.env.split_once('/').unwrap_or_default();
        let (volume, group) = place.split_once('/').unwrap_or_default();
        let group = if part == SURFACES { format!("{SURFACES}/{group}") } else { group.to_owned() };
        let mut of =
            json!({ "store": self.identity_hash, "volume": volume, "group": group, "seed": self.identity.seed });
        if let Some(mark) = &self.surface {
            of["mesh"] = json!(mark.mesh);
        }
        of
    }

    pub(super) fn slot(&self, [x, y, z]: [usize; 3]) -> usize {
        let [nx, ny, _] = self.layout.lattice.chunks();
        grid3::index([nx, ny], [x, y, z])
    }

    /// An error about one file of a chunk.
    fn damage(&self, key: &str, index: [usize; 3], found: impl Into<String>, expected: impl Into<String>) -> Error {
        let [x, y, z] = index;
        let remedy = match &self.backing {
            Backing::Archive(_) => "copy or pack the archive again".to_owned(),
            _ if self.packing.is_some() => "pack it again from the store that it was made of".to_owned(),
            Backing::Directory(_) => "run the same bake again: it redoes what is damaged".to_owned(),
        };
        let found = format!("in chunk ({x}, {y}, {z}) {}", found.into());
        Error::format(FORMAT, found, expected, remedy).in_file(self.backing.name(key))
    }

    /// Writes a chunk: its bricks, x fastest, and how far they were baked. A chunk that is
    /// already there is replaced. What this or another [`Store`] has opened of it before stays as
    /// it was; see [`Self::refresh`]. Different chunks may be written from different threads,
    /// processes and machines at once; the bytes depend on the arguments alone.
    ///
    /// # Errors
    /// When an index or a length does not fit the layout, a brick lies beyond the lattice, a
    /// number of the extent is not finite, the store is an archive, or the system refuses.
    #[doc(hidden)]
    pub fn write_chunk(&self, index: [usize; 3], bricks: Vec<Option<Brick>>, extent: &ChunkExtent) -> Result<()> {
        self.check_not_packed()?;
        self.check_chunk(index, &bricks)?;
        extent.check()?;
        if !self.is_stamped() {
            let found = format!("{}, of format {}", self.path().display(), self.identity.format_version);
            let remedy = "convert it: isolume merge OLD.isolume -o NEW.isolume";
            return Err(Error::argument("store", found, format!("a store of format {FORMAT_VERSION}"), remedy));
        }
        let sums: Vec<Option<[u32; 4]>> =
            bricks.iter().map(|b| b.as_ref().map(|b| bytes_of(b).map(zarr::checksum))).collect();
        let mut digest = blake3::Hasher::new();
        for sums in &sums {
            digest.update(&[u8::from(sums.is_some())]);
            for sum in sums.iter().flatten() {
                digest.update(&sum.to_le_bytes());
            }
        }
        let digest = digest.finalize().to_hex();
        let (record, stamp) = self.stamped(index, extent, sums.iter().flatten().count(), &digest[..2 * STAMP]);

        let mut staged: Vec<Staged> = Vec::new();
        staged.push(self.backing.stage(&self.extent_key(index), self.sync, |out| writeln!(out, "{record}"))?);
        // Backwards: `transfer`, the first of the arrays, is the mark of the commit and comes last.
        for array in (0..ARRAYS.len()).rev() {
            let chunks: Vec<Option<(&[u8], u32)>> = bricks
                .iter()
                .zip(&sums)
                .map(|(brick, sums)| Some((bytes_of(brick.as_ref()?)[array], sums.as_ref()?[array])))
                .collect();
            let key = self.shard_key(array, index);
            staged.push(self.backing.stage(&key, self.sync, |out| zarr::write_shard(out, &chunks, &stamp))?);
        }
        // Once more, now that the long part is over.
        self.directory()?.check()?;
        staged.into_iter().try_for_each(Staged::commit)
    }

    /// The record of a chunk with its stamp.
    fn stamped(&self, index: [usize; 3], extent: &ChunkExtent, bricks: usize, payload: &str) -> (Value, [u8; STAMP]) {
        let mut record = json!({
            "chunk": index,
            "of": self.belongs(),
            "baked": extent.to_json(),
            "bricks": bricks,
            "payload": payload,
        });
        let (stamp, digits) = stamp_of(&record);
        record["stamp"] = json!(digits);
        (record, stamp)
    }

    /// The record of a chunk that is packed into some files.
    pub(super) fn record_of(&self, index: [usize; 3], extent: &ChunkExtent, bricks: usize, files: &Files) -> Value {
        let files: [Option<&[u8]>; PACKED.len()] = std::array::from_fn(|array| files[array].as_deref());
        self.stamped(index, extent, bricks, &packed::digest(&files)).0
    }

    fn check_chunk(&self, index: [usize; 3], bricks: &[Option<Brick>]) -> Result<()> {
        check_index("chunk", index, self.layout.lattice.chunks())?;
        if bricks.len() != self.slots() {
            return Err(Error::argument(
                "bricks",
                format!("{} bricks", bricks.len()),
                format!("{}, x fastest, None where nothing is baked", self.slots()),
                "hand over the whole chunk",
            ));
        }
        for (slot, brick) in bricks.iter().enumerate().filter_map(|(slot, b)| b.as_ref().map(|b| (slot, b))) {
            check_brick(brick, &self.layout.layers)?;
            let lattice = &self.layout.lattice;
            check_index("brick", lattice.brick_in_chunk(index, slot), lattice.bricks())?;
        }
        Ok(())
    }

    /// Reads a chunk from disk as it is now: its bricks, x fastest, and how far they were
    /// baked. `None` if it was not baked, or if a killed run left it torn: then it is to be baked
    /// again.
    ///
    /// # Errors
    /// When the index is outside the lattice or a file is damaged or cannot be read.
    #[doc(hidden)]
    pub fn read_chunk(&self, index: [usize; 3]) -> Result<Option<(Vec<Option<Brick>>, ChunkExtent)>> {
        let Found::Whole(chunk) = self.find_chunk(index)? else { return Ok(None) };
        let bricks = (0..self.slots()).map(|slot| Ok(self.view(&chunk, slot)?.map(|view| view.to_brick())));
        Ok(Some((bricks.collect::<Result<_>>()?, chunk.extent)))
    }

    /// How far a chunk was baked, as it is on disk now; `None` as in [`Self::read_chunk`]. Reads
    /// no bricks.
    ///
    /// # Errors
    /// As [`Self::read_chunk`].
    #[doc(hidden)]
    pub fn chunk_extent(&self, index: [usize; 3]) -> Result<Option<ChunkExtent>> {
        if self.packing.is_some() {
            check_index("chunk", index, self.layout.lattice.chunks())?;
            let is_there = self.backing.exists(&self.shard_key(0, index));
            return if is_there { self.extent_record(index).map(|record| Some(record.extent)) } else { Ok(None) };
        }
        match self.find_chunk(index)? {
            Found::Whole(chunk) => Ok(Some(chunk.extent)),
            _ => Ok(None),
        }
    }

    /// Opens the files of a chunk once more, up to [`TRIES`] times while they are torn.
    fn find_chunk(&self, index: [usize; 3]) -> Result<Found> {
        check_index("chunk", index, self.layout.lattice.chunks())?;
        for _ in 1..TRIES {
            match self.find_chunk_once(index)? {
                Found::Torn(_) => std::thread::yield_now(),
                found => return Ok(found),
            }
        }
        self.find_chunk_once(index)
    }

    /// A packed chunk, expanded; its files are written once, so that none is of another writing.
    fn expand_chunk(&self, packing: &Packing, index: [usize; 3]) -> Result<Found> {
        if !self.backing.exists(&self.shard_key(0, index)) {
            return Ok(Found::Nothing);
        }
        let record = self.extent_record(index)?;
        let mut files: [Option<Bytes>; PACKED.len()] = Default::default();
        for (array, file) in files.iter_mut().enumerate() {
            *file = self.backing.bytes(&self.shard_key(array, index))?;
        }
        let files: [Option<&[u8]>; PACKED.len()] = std::array::from_fn(|array| files[array].as_deref());
        let bricks = packed::decode(packing, &self.layout, &files)
            .map_err(|(array, found, expected)| self.damage(&self.shard_key(array, index), index, found, expected))?;
        let (found, count) = (packed::digest(&files), bricks.iter().flatten().count());
        if found != record.payload || count != record.bricks {
            let expected = format!("{} bricks with digest {}", record.bricks, record.payload);
            return Err(self.damage(
                &self.extent_key(index),
                index,
                format!("{count} bricks with digest {found}"),
                expected,
            ));
        }
        Ok(Found::Whole(Box::new(OpenChunk { index, extent: record.extent, bricks: Bricks::Expanded(bricks) })))
    }

    fn find_chunk_once(&self, index: [usize; 3]) -> Result<Found> {
        if let Some(packing) = &self.packing {
            return self.expand_chunk(packing, index);
        }
        // The mark of the commit is opened first: what is renamed after it cannot be missed.
        let Some(transfer) = self.backing.bytes(&self.shard_key(0, index))? else { return Ok(Found::Nothing) };
        let Record { extent, stamp, bricks, .. } = self.extent_record(index)?;
        let bytes = brick_bytes(&self.layout.layers);
        let mut tails: [Option<ShardTail>; 4] = [None; 4];
        let mut shards = Vec::with_capacity(4);
        let mut transfer = Some(transfer);
        for array in 0..ARRAYS.len() {
            let key = self.shard_key(array, index);
            let shard = match transfer.take() {
                Some(transfer) => transfer,
                None => match self.backing.bytes(&key)? {
                    Some(shard) => shard,
                    None => return Err(self.damage(&key, index, "no such file", "one shard for each array")),
                },
            };
            let tail = zarr::read_tail(&shard, self.slots(), bytes[array])
                .map_err(|(found, expected)| self.damage(&key, index, found, expected))?;
            if tail.stamp != stamp {
                return Ok(Found::Torn(self.backing.name(&key)));
            }
            let first = tails[0].map_or(tail.present, |first| first.present);
            if tail.present != first || tail.present.count_ones() as usize != bricks {
                return Err(self.damage(&key, index, "other bricks than in `transfer`", format!("{bricks} bricks")));
            }
            tails[array] = Some(tail);
            shards.push(shard);
        }
        let present = tails[0].map_or(0, |tail| tail.present);
        let Ok(shards) = shards.try_into() else { return Ok(Found::Nothing) }; // There are four.
        let bricks = Bricks::Mapped { shards, present, verified: AtomicU64::new(0) };
        Ok(Found::Whole(Box::new(OpenChunk { index, extent, bricks })))
    }

    /// The record of a chunk.
    fn extent_record(&self, index: [usize; 3]) -> Result<Record> {
        let key = self.extent_key(index);
        let mut record = match self.backing.json(&key) {
            Ok(Some(record)) => record,
            Ok(None) => return Err(self.damage(&key, index, "no such file", "the record of the chunk's extent")),
            Err(Error::Format { found, .. }) => return Err(self.damage(&key, index, found, "a JSON document")),
            Err(other) => return Err(other),
        };
        let stored = record.as_object_mut().and_then(|fields| fields.shift_remove("stamp"));
        let (stamp, digits) = stamp_of(&record);
        let extent = match self.identity.format_version {
            1 => ChunkExtent::from_first_format(&record),
            _ => ChunkExtent::from_json(&record["baked"]),
        };
        let parsed = extent.zip(record["bricks"].as_u64());
        let is_whole = stored == Some(json!(digits)) && record["chunk"] == json!(index);
        if is_whole && self.is_stamped() && record["of"] != self.belongs() {
            let (found, expected) = (origin(&record["of"]), origin(&self.belongs()));
            return Err(self.damage(&key, index, format!("a chunk of another store, {found}"), expected));
        }
        match parsed {
            Some((extent, bricks)) if is_whole => {
                let payload = record["payload"].as_str().unwrap_or_default().to_owned();
                Ok(Record { extent, stamp, bricks: bricks as usize, payload })
            }
            _ => {
                let stored = stored.as_ref().map_or_else(|| "nothing".into(), zarr::shorten);
                Err(self.damage(&key, index, format!("a record with stamp {digits}"), format!("stamp {stored}")))
            }
        }
    }

    /// The open chunk at an index, opened at the first call and kept.
    fn open_chunk(&self, index: [usize; 3]) -> Result<Option<&OpenChunk>> {
        let cell = &self.chunks[self.slot(index)];
        if let Some(known) = cell.get() {
            return Ok(known.as_deref());
        }
        // Expanding takes long: who comes second waits and finds it done.
        let turns = self.packing.as_ref().map(|_| &self.turns[self.slot(index) % self.turns.len()]);
        let _turn = turns.map(|turn| turn.lock().unwrap_or_else(PoisonError::into_inner));
        if let Some(known) = cell.get() {
            return Ok(known.as_deref());
        }
        let found = match self.find_chunk(index)? {
            Found::Nothing => None,
            Found::Whole(chunk) => Some(chunk),
            Found::Torn(name) => {
                let error = self.damage("", index, "files of two bakes", "files of one bake");
                return Err(match error {
                    Error::Format { format, found, expected, remedy, .. } => {
                        Error::Format { file: name.display().to_string(), format, found, expected, remedy }
                    }
                    other => other,
                });
            }
        };
        Ok(cell.get_or_init(|| found).as_deref())
    }

    /// The brick in a slot of an open chunk; its checksums are verified the first time.
    fn view<'a>(&self, chunk: &'a OpenChunk, slot: usize) -> Result<Option<BrickView<'a>>> {
        let (shards, present, verified) = match &chunk.bricks {
            Bricks::Expanded(bricks) => return Ok(bricks.get(slot).and_then(Option::as_ref).map(Brick::view)),
            Bricks::Mapped { shards, present, verified } => (shards, *present, verified),
        };
        let bit = 1 << slot;
        if present & bit == 0 {
            return Ok(None);
        }
        let place = zarr::rank(present, slot);
        let bytes = brick_bytes(&self.layout.layers);
        let parts: [(&[u8], &[u8]); 4] =
            std::array::from_fn(|array| zarr::inner_chunk(&shards[array], place, bytes[array]));
        if verified.load(Ordering::Relaxed) & bit == 0 {
            for (array, (part, stored)) in parts.iter().enumerate() {
                let (found, stored) = (zarr::checksum(part), zarr::little_u32(stored));
                if found != stored {
                    let key = self.shard_key(array, chunk.index);
                    let found = format!("brick {slot} with crc32c {found:08x}");
                    return Err(self.damage(&key, chunk.index, found, format!("crc32c {stored:08x}")));
                }
            }
            verified.fetch_or(bit, Ordering::Relaxed);
        }
        // The casts cannot fail: `Bytes` start at a multiple of 4, and so does every brick.
        let [(transfer, _), (stderr, _), (validity, _), (rays, _)] = parts;
        Ok(Some(BrickView {
            transfer: bytemuck::cast_slice(transfer),
            stderr: bytemuck::cast_slice(stderr),
            validity,
            rays: bytemuck::cast_slice(rays),
        }))
    }
}

impl Store {
    /// A brick as it was baked; the index is one of the lattice.
    pub(super) fn baked_brick(&self, index: [usize; 3]) -> Result<Option<BrickView<'_>>> {
        let count = self.layout.lattice.bricks_of_chunk();
        let chunk = std::array::from_fn(|a| index[a] / count[a]);
        let Some(chunk) = self.open_chunk(chunk)? else { return Ok(None) };
        self.view(chunk, grid3::index([count[0], count[1]], std::array::from_fn(|a| index[a] % count[a])))
    }
}
