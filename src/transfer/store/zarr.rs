//! The part of Zarr v3 that a store uses, written by hand: metadata of groups and arrays, chunk
//! keys, and shards. Knows nothing of transfer.
//!
//! Source: Zarr core specification v3.0, and its `sharding_indexed` (version 1.0), `bytes` and
//! `crc32c` codecs. Of these we write and read exactly one form each: a regular grid, the default
//! key encoding with `/`, little-endian bytes followed by CRC-32C, the shard index at the end.
//!
//! # A shard file
//! ```text
//! inner chunks that exist, x fastest, without gaps: bytes, then their CRC-32C (4 bytes)
//! stamp (16 bytes, named by no index entry: the specification allows such space)
//! index: for each inner chunk (4³ of texels, 8 of vertices), x fastest, offset and length as u64;
//!        both 2⁶⁴−1 for a chunk that does not exist
//! CRC-32C of the index (4 bytes)
//! ```
//! We ask for this very packing when we read: every byte of the file is then accounted for, so
//! that no truncation, insertion or flipped bit passes. The lengths of inner chunks are multiples
//! of 4, so all of them stay aligned for f16 and u32 in a mapped file.

use crate::error::{Error, Result};
use serde_json::{Map, Value, json};
use std::io::{self, Write};

/// Most inner chunks of a shard: the bits of a [`Presence`].
pub(super) const MOST_SLOTS: usize = 64;
/// Bytes of a checksum.
pub(super) const CHECKSUM: usize = 4;
/// Bytes of a stamp.
pub(super) const STAMP: usize = 16;
/// Bytes that follow the inner chunks in a shard of so many: stamp, index, checksum of the index.
pub(super) const fn tail_length(slots: usize) -> usize {
    STAMP + slots * 16 + CHECKSUM
}

/// Offset and length of an inner chunk that does not exist.
const MISSING: u64 = u64::MAX;

/// Which of the at most [`MOST_SLOTS`] inner chunks exist, one bit each.
pub(super) type Presence = u64;

/// The name that error messages give the format.
pub(super) const FORMAT: &str = "isolume store";

/// What a user does about metadata that cannot be used.
pub(super) const METADATA_REMEDY: &str =
    "run the bake that made the store again: it mends what follows from the volume";

/// Metadata of a group.
pub(super) fn group(attributes: Value) -> Value {
    json!({ "zarr_format": 3, "node_type": "group", "attributes": attributes })
}

/// What decides the metadata of an array, and how its chunks are cut.
#[derive(Debug)]
pub(super) struct Array {
    /// Entries along each axis, slowest first.
    pub shape: Vec<usize>,
    /// Entries of one chunk file along each axis.
    pub chunk: Vec<usize>,
    /// Entries of one inner chunk; `None` for an array without shards.
    pub inner: Option<Vec<usize>>,
    /// Zarr's (and NumPy's) name of the type.
    pub data_type: &'static str,
    /// What a chunk that does not exist reads as.
    pub fill: Value,
    /// Names of the axes.
    pub names: Vec<&'static str>,
    /// How the bytes of a chunk become those of its file.
    pub codec: Codec,
}

/// What stands between little-endian numbers and their checksum in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Codec {
    /// Nothing.
    #[default]
    Plain,
    /// A gzip stream.
    Gzip,
}

/// Level of compression: 1 to 2 % less than level 6 on planes of coefficients.
pub(super) const GZIP_LEVEL: u32 = 9;

impl Array {
    /// The array's `zarr.json`.
    pub fn metadata(&self, attributes: Value) -> Value {
        let codecs = json!([{ "name": "bytes", "configuration": { "endian": "little" } }, { "name": "crc32c" }]);
        // `bytes` takes no order where there is none to take; zarr-python writes it so.
        let plain = json!([{ "name": "bytes" }, { "name": "crc32c" }]);
        let inner_codecs = if matches!(self.data_type, "uint8" | "int8") { &plain } else { &codecs };
        let codecs = match &self.inner {
            None if self.codec == Codec::Gzip => {
                let gzip = json!({ "name": "gzip", "configuration": { "level": GZIP_LEVEL } });
                json!([inner_codecs[0], gzip, inner_codecs[1]])
            }
            None => inner_codecs.clone(),
            Some(inner) => json!([{ "name": "sharding_indexed", "configuration": {
                "chunk_shape": inner,
                "codecs": inner_codecs,
                "index_codecs": codecs,
                "index_location": "end",
            } }]),
        };
        json!({
            "zarr_format": 3,
            "node_type": "array",
            "shape": self.shape,
            "data_type": self.data_type,
            "chunk_grid": { "name": "regular", "configuration": { "chunk_shape": self.chunk } },
            "chunk_key_encoding": { "name": "default", "configuration": { "separator": "/" } },
            "fill_value": self.fill,
            "codecs": codecs,
            "dimension_names": self.names,
            "attributes": attributes,
        })
    }

    /// Whether the `zarr.json` that was found describes this array. Attributes and the order of
    /// keys may differ.
    ///
    /// # Errors
    /// Names the first field that differs.
    pub fn check(&self, found: &Value) -> Result<()> {
        let expected = self.metadata(Value::Null);
        for (key, value) in expected.as_object().into_iter().flatten() {
            if key != "attributes" && found.get(key) != Some(value) {
                let shown = found.get(key).map_or_else(|| "nothing".into(), shorten);
                return Err(Error::format(
                    FORMAT,
                    format!("`{key}`: {shown}"),
                    format!("`{key}`: {}", shorten(value)),
                    METADATA_REMEDY,
                ));
            }
        }
        Ok(())
    }
}

/// A JSON value for a message: at most about a hundred characters.
pub(super) fn shorten(value: &Value) -> String {
    let text = value.to_string();
    if text.chars().count() <= 100 { text } else { text.chars().take(100).chain("…".chars()).collect() }
}

/// Adds `consolidated_metadata`, all nodes of the hierarchy below, to the metadata of the root.
/// zarr-python and xarray then list the groups without walking the directory. We never read it. Nodes below `late` are
/// added in any order: they come last, by name.
pub(super) fn consolidate(root: &mut Value, nodes: &[(String, Value)], late: &str) {
    let is_late = |(key, _): &&(String, Value)| key.split('/').next() == Some(late);
    let mut last: Vec<&(String, Value)> = nodes.iter().filter(is_late).collect();
    last.sort_by(|a, b| a.0.cmp(&b.0));
    let all = nodes.iter().filter(|node| !is_late(node)).chain(last);
    let metadata: Map<String, Value> = all.cloned().collect();
    root["consolidated_metadata"] = json!({ "kind": "inline", "must_understand": false, "metadata": metadata });
}

/// Key of a chunk of an array by its numbers along the axes, slowest first.
pub(super) fn chunk_key(array: &str, indices: &[usize]) -> String {
    indices.iter().fold(format!("{array}/c"), |key, index| format!("{key}/{index}"))
}

/// CRC-32C of some bytes.
pub(super) fn checksum(bytes: &[u8]) -> u32 {
    // CRC-32C under its name in iSCSI (RFC 3720); the upper half of the result is empty.
    crc_fast::checksum(crc_fast::CrcAlgorithm::Crc32Iscsi, bytes) as u32
}

/// Length of a shard file of `slots` inner chunks, of which `count` exist with `bytes` bytes each, checksum not counted.
pub(super) fn shard_length(slots: usize, count: usize, bytes: usize) -> usize {
    count * (bytes + CHECKSUM) + tail_length(slots)
}

/// Writes a shard. All chunks have the same length, a multiple of 4; `None` does not exist.
pub(super) fn write_shard(out: &mut dyn Write, chunks: &[Option<(&[u8], u32)>], stamp: &[u8; STAMP]) -> io::Result<()> {
    debug_assert!(chunks.len() <= MOST_SLOTS);
    let length = chunks.iter().flatten().map(|(bytes, _)| bytes.len()).next().unwrap_or(0);
    for (bytes, sum) in chunks.iter().flatten() {
        debug_assert!(bytes.len() == length && length.is_multiple_of(4));
        out.write_all(bytes)?;
        out.write_all(&sum.to_le_bytes())?;
    }
    let mut present: Presence = 0;
    for (slot, chunk) in chunks.iter().enumerate() {
        present |= Presence::from(chunk.is_some()) << slot;
    }
    let index = index_bytes(chunks.len(), present, length);
    out.write_all(stamp)?;
    out.write_all(&index)?;
    out.write_all(&checksum(&index).to_le_bytes())
}

/// Number of existing inner chunks before `slot`: the place of that slot's chunk in the file.
pub(super) fn rank(present: Presence, slot: usize) -> usize {
    (present & ((1 << slot) - 1)).count_ones() as usize
}

/// The bytes of the index of a packed shard.
fn index_bytes(slots: usize, present: Presence, length: usize) -> Vec<u8> {
    let stride = (length + CHECKSUM) as u64;
    let mut index = Vec::with_capacity(slots * 16);
    for slot in 0..slots {
        let entry = match present >> slot & 1 {
            0 => [MISSING; 2],
            _ => [rank(present, slot) as u64 * stride, stride],
        };
        index.extend(entry.iter().flat_map(|v| v.to_le_bytes()));
    }
    index
}

/// What the tail of a shard says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ShardTail {
    /// Which inner chunks exist.
    pub present: Presence,
    /// The stamp.
    pub stamp: [u8; STAMP],
}

/// Reads and checks the tail of a shard of `slots` inner chunks of `bytes` bytes each.
///
/// # Errors
/// `(found, expected)` when the file is too short or too long, the index does not match its
/// checksum, or the packing is not ours.
pub(super) fn read_tail(shard: &[u8], slots: usize, bytes: usize) -> std::result::Result<ShardTail, (String, String)> {
    let tail = tail_length(slots);
    let Some(start) = shard.len().checked_sub(tail) else {
        return Err((format!("{} bytes", shard.len()), format!("at least the {tail} bytes of a shard's index")));
    };
    let (stamp, rest) = shard[start..].split_at(STAMP);
    let (index, stored) = rest.split_at(slots * 16);
    let (found, expected) = (checksum(index), little_u32(stored));
    if found != expected {
        return Err((format!("index with crc32c {found:08x}"), format!("crc32c {expected:08x}")));
    }
    let mut present: Presence = 0;
    for (slot, entry) in index.chunks_exact(16).enumerate() {
        present |= Presence::from(entry != [0xff; 16]) << slot;
    }
    if index != index_bytes(slots, present, bytes) {
        return Err(("an index with other places or lengths".into(), format!("packed chunks of {bytes} bytes")));
    }
    let expected = shard_length(slots, present.count_ones() as usize, bytes);
    if shard.len() != expected {
        return Err((format!("{} bytes", shard.len()), format!("{expected} bytes")));
    }
    let mut copy = [0; STAMP];
    copy.copy_from_slice(stamp);
    Ok(ShardTail { present, stamp: copy })
}

/// The inner chunk of a shard whose tail was checked, and the bytes of the checksum behind it.
/// Reads neither: a look-up must not touch pages that nobody asked for.
pub(super) fn inner_chunk(shard: &[u8], place: usize, bytes: usize) -> (&[u8], &[u8]) {
    let start = place * (bytes + CHECKSUM);
    shard[start..start + bytes + CHECKSUM].split_at(bytes)
}

/// Little-endian number of four bytes.
pub(super) fn little_u32(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |n, &b| n << 8 | u32::from(b))
}

#[cfg(test)]
mod tests;
