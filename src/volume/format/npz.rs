//! NumPy .npz archives: a zip of .npy entries, stored or deflated. Of the arrays of three axes [z, y, x] the only one is
//! read, or the one that `--array` names. Three entries are ours: `spacing` (three numbers along x, y, z), `affine` (3 or 4
//! rows of four, from samples (x, y, z) to world) and `unit` (a word such as "mm"). World is the grid without them.
//!
//! The directory is read by the crate `zip`, the header of an entry by `npyz` (whose own feature for .npz pins an old zip).

#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

use super::super::assemble::{Parts, assemble, note};
use super::super::read::ReadHint;
use super::super::source::Source;
use super::super::{LengthUnit, Series, Volume};
use super::{affine, metres_in, npy};
use crate::error::{Error, Result};
use crate::geom::Affine;
use flate2::CrcReader;
use flate2::read::DeflateDecoder;
use glam::{DMat3, DVec3};
use std::io::{Cursor, Read, Seek};
use zip::{CompressionMethod, ZipArchive};

const NAME: &str = "NumPy .npz";
/// Most entries of an archive.
const MOST_ENTRIES: usize = 1 << 16;
/// Deflate codes at most 258 bytes in 2 bits.
const DEFLATE_RATIO: u64 = 1032;
/// Entries that say where the samples lie.
const OURS: [&str; 3] = ["spacing", "affine", "unit"];

fn damaged(found: impl Into<String>) -> Error {
    Error::format(
        NAME,
        found,
        "an archive of arrays",
        "the file is incomplete or damaged; copy it, or save it again with numpy.savez",
    )
}

/// Whether the first bytes are those of an archive whose first entry is an array.
pub(crate) fn is_npz(head: &[u8]) -> bool {
    // The name of the first entry: its length is at 26, it starts at 30.
    let length = head.get(26..28).map_or(0, |b| b.iter().rev().fold(0, |n, byte| n << 8 | usize::from(*byte)));
    head.starts_with(b"PK\x03\x04")
        && head.get(30..).is_some_and(|rest| rest.get(..length).is_some_and(|name| name.ends_with(b".npy")))
}

/// Reads a stream by first taking it into memory: the directory of an archive is at its end.
pub(crate) fn read_stream(source: Source, hint: &ReadHint) -> Result<Volume> {
    let mut bytes = Vec::new();
    let most = hint.max_bytes.saturating_add(1 << 16);
    source.take(most.saturating_add(1)).read_to_end(&mut bytes).map_err(|e| Error::from_read(NAME, "an archive", e))?;
    if bytes.len() as u64 > most {
        return Err(Error::Limit {
            what: "the archive".into(),
            needed: format!("more than {most} bytes"),
            limit: format!("{most} bytes"),
            remedy: "crop or downsample the volume, or raise the limit".into(),
        });
    }
    read(Cursor::new(bytes), hint)
}

/// Reads from something that can seek.
pub(crate) fn read(source: impl Read + Seek, hint: &ReadHint) -> Result<Volume> {
    let mut archive = ZipArchive::new(source).map_err(|e| damaged(format!("a directory that cannot be read ({e})")))?;
    if archive.len() > MOST_ENTRIES {
        return Err(damaged(format!("{} entries", archive.len())));
    }
    let mut notes = Vec::new();
    // Arrays that may be the volume, and where the entries are.
    let (mut arrays, mut places, mut others, mut ours) = (Vec::new(), Vec::new(), Vec::new(), [None; 3]);
    for place in 0..archive.len() {
        let name = archive.name_for_index(place).unwrap_or_default();
        let Some(name) = name.strip_suffix(".npy").map(String::from) else { continue };
        if let Some(which) = OURS.iter().position(|own| *own == name) {
            if let Some(slot) = ours.get_mut(which) {
                *slot = Some(place);
            }
            continue;
        }
        let rank = entry(&mut archive, place, |mut source| npy::rank(&mut source)).map_err(|e| e.in_file(&name))?;
        if rank == 3 || hint.choice.array.as_ref() == Some(&name) {
            arrays.push(name);
            places.push(place);
        } else {
            others.push(name);
        }
    }
    if arrays.is_empty() && !others.is_empty() {
        let found = format!("no array of three axes among {}", others.join(", "));
        return Err(Error::format(
            NAME,
            found,
            "an array with axes [z, y, x]",
            "choose one with --array NAME to see its shape",
        ));
    }
    let chosen = hint.choice.array_of(NAME, &arrays, None)?;
    let (Some(name), Some(&place)) = (arrays.get(chosen), places.get(chosen)) else { return Err(damaged("no array")) };
    let (data, dims) = entry(&mut archive, place, |mut source| {
        let read = npy::array(&mut source, hint)?;
        source.verify_end(NAME)?;
        Ok(read)
    })
    .map_err(|e| e.in_file(name))?;
    if arrays.len() > 1 {
        notes.push(note(format!("array {name} of {} is read", arrays.len()), 1));
    }
    let mut numbers = |which: usize| -> Result<Option<Vec<f64>>> {
        let Some(place) = ours.get(which).copied().flatten() else { return Ok(None) };
        entry(&mut archive, place, |mut source| npy::numbers(&mut source)).map(Some)
    };
    let (spacing, map) = (numbers(0)?, numbers(1)?);
    let world_from_grid = world(spacing.as_deref(), map.as_deref())?;
    let unit = match ours.get(2).copied().flatten() {
        None => LengthUnit::Unknown,
        Some(place) => {
            let word = entry(&mut archive, place, |mut source| npy::word(&mut source))?;
            let refuse =
                || Error::format(NAME, format!("the unit {word:?}"), "m, mm, um, nm, A or bohr", "save another unit");
            LengthUnit::Metres(metres_in(&word).ok_or_else(refuse)?)
        }
    };
    let series = Series { arrays, array: chosen, timepoints: 1, ..Series::default() };
    let (slope, inter) = (1.0, 0.0);
    assemble(Parts { format: NAME, dims, data, slope, inter, world_from_grid, unit, series, notes }, hint)
}

fn world(spacing: Option<&[f64]>, map: Option<&[f64]>) -> Result<Affine> {
    match (spacing, map) {
        (None, None) => Ok(Affine::IDENTITY),
        (Some(_), Some(_)) => Err(damaged("both spacing and affine")),
        (Some(spacing), None) => {
            let &[x, y, z] = spacing else { return Err(damaged(format!("a spacing of {} numbers", spacing.len()))) };
            affine(NAME, DMat3::from_diagonal(DVec3::new(x, y, z)), DVec3::ZERO)
        }
        (None, Some(map)) => {
            let (rows, last) = map.as_chunks::<4>();
            let (&[x, y, z], rest) =
                rows.split_first_chunk::<3>().ok_or_else(|| damaged("an affine of fewer than 12 numbers"))?;
            if !(last.is_empty() && (rest.is_empty() || rest == [[0.0, 0.0, 0.0, 1.0]])) {
                return Err(damaged(format!("an affine of {} numbers, or a last row that is not 0 0 0 1", map.len())));
            }
            let rows = [x, y, z];
            let linear = DMat3::from_cols_array_2d(&rows.map(|[x, y, z, _]| [x, y, z])).transpose();
            affine(NAME, linear, DVec3::from_array(rows.map(|[_, _, _, t]| t)))
        }
    }
}

/// Hands the content of an entry to a reader. No more is unpacked than the directory says, and its checksum is compared where
/// all of it was read.
fn entry<R: Read + Seek, T>(
    archive: &mut ZipArchive<R>,
    place: usize,
    read: impl FnOnce(Source) -> Result<T>,
) -> Result<T> {
    let file = archive.by_index_raw(place).map_err(|e| damaged(format!("an entry that cannot be read ({e})")))?;
    let (size, packed, checksum) = (file.size(), file.compressed_size(), file.crc32());
    if file.encrypted() {
        return Err(damaged("an encrypted entry"));
    }
    let is_deflated = match file.compression() {
        CompressionMethod::Stored => false,
        CompressionMethod::DEFLATE => true,
        other => {
            let remedy = "save it again with numpy.savez or numpy.savez_compressed";
            return Err(Error::format(
                NAME,
                format!("an entry packed as {other:?}"),
                "stored or deflated entries",
                remedy,
            ));
        }
    };
    let most = if is_deflated { packed.saturating_mul(DEFLATE_RATIO).saturating_add(64) } else { packed };
    if size > most {
        return Err(damaged(format!("an entry of {packed} bytes that claims to hold {size}")));
    }
    let file = file.take(packed);
    let bytes: Box<dyn Read + '_> = if is_deflated { Box::new(DeflateDecoder::new(file)) } else { Box::new(file) };
    let mut bytes = CrcReader::new(bytes.take(size));
    let out = read(Source::new(&mut bytes, Some(size)))?;
    let is_whole = u64::from(bytes.crc().amount()) == size & u64::from(u32::MAX) && size > 0;
    if is_whole && bytes.crc().sum() != checksum {
        return Err(damaged("an entry whose checksum is wrong"));
    }
    Ok(out)
}
