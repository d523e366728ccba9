//! The samples of a box of an array, from the chunks that it touches.

use super::super::choice::Series;
use super::super::decode::{self, Data, Endian, checked_count};
use super::super::read::ReadHint;
use super::super::source::Source;
use super::super::{Note, assemble::note};
use super::codec::Pipeline;
use super::metadata::{Array, Shard};
use super::ome::Roles;
use super::{Files, NAME, damage};
use crate::error::{Error, Result};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;

/// Most chunks that are looked for.
const MOST_CHUNKS: u64 = 1 << 20;
/// From this many bytes on, not nearly all of them may be missing.
const LARGE: u64 = 1 << 30;
/// Of which one chunk in so many must be stored.
const SPARSEST: u64 = 1000;

/// A box of samples of one channel and time point.
pub(super) struct Part<'a> {
    pub(super) array: &'a Array,
    /// Of the array, below the root.
    pub(super) path: &'a str,
    pub(super) roles: &'a Roles,
    pub(super) series: &'a Series,
    /// First sample and number of samples along x, y, z.
    pub(super) first: [u64; 3],
    pub(super) count: [u64; 3],
}

impl Part<'_> {
    pub(super) fn read(&self, files: &Files, hint: &ReadHint, notes: &mut Vec<Note>) -> Result<Data> {
        let array = self.array;
        let samples = checked_count(NAME, self.count, array.kind.size(), None, hint)?;
        let wanted = self.wanted();
        self.check_chunks(&wanted, hint)?;
        let key = |place: &[u64]| {
            let key = array.key(place);
            if self.path.is_empty() { key } else { format!("{}/{key}", self.path) }
        };
        let chunks = touched(&wanted, &array.chunk);
        let stored: Vec<Vec<u64>> = grid(&chunks).filter(|place| files.folder.join(key(place)).exists()).collect();
        let (have, of) = (stored.len() as u64, grid(&chunks).count() as u64);
        if have == 0 || (samples as u64 > LARGE && have * SPARSEST < of) {
            let found = format!(
                "{have} of the {of} chunks, such as {}",
                grid(&chunks).next().map(|p| key(&p)).unwrap_or_default()
            );
            let remedy = "the hierarchy is incomplete: copy it again; or choose a part that is there with --region";
            return Err(damage(found, "chunks that are stored", remedy));
        }
        let mut out = Out { data: filled(&array.fill, samples)?, part: self, wanted: &wanted };
        for place in stored {
            let key = key(&place);
            let Some((file, length)) = files.open(&key)? else { continue };
            self.read_file(file, length, &place, &mut out, hint).map_err(|e| match e {
                Wrong::Damaged(text) => {
                    let remedy = "it is damaged: copy it again, or write it anew";
                    damage(format!("the chunk {key} with {text}"), "a chunk as its array describes it", remedy)
                }
                Wrong::Other(e) => e.in_file(&key),
            })?;
        }
        if have < of {
            let value = array.fill.numbers().first().copied().unwrap_or(0.0);
            notes.push(note(
                format!("{} of {of} chunks are not stored: their samples are {value}", of - have),
                (of - have) as usize,
            ));
        }
        Ok(out.data)
    }

    /// The entries that are wanted along each axis of the array.
    fn wanted(&self) -> Vec<Range<u64>> {
        let roles = self.roles;
        let one = |axis: usize| match axis {
            a if Some(a) == roles.time => self.series.timepoint as u64,
            a if Some(a) == roles.channel => self.series.channel as u64,
            _ => 0,
        };
        let range = |axis: usize| match roles.space.iter().position(|&a| a == axis) {
            Some(i) => self.first[i]..self.first[i] + self.count[i],
            None => one(axis)..one(axis) + 1,
        };
        (0..self.array.shape.len()).map(range).collect()
    }

    /// Refuses chunks of which there are too many or that are too large.
    fn check_chunks(&self, wanted: &[Range<u64>], hint: &ReadHint) -> Result<()> {
        let inner = self.array.inner_chunk();
        let product = |all: Vec<u64>| all.iter().fold(1u64, |n, d| n.saturating_mul(*d));
        let count = product(touched(wanted, inner).iter().map(|r| r.end - r.start).collect());
        let bytes = product(inner.to_vec()).saturating_mul(self.array.kind.size() as u64);
        let limit = |what: &str, needed: String, limit: String| {
            let remedy = "write the array anew with other chunks, or read a part with --region".into();
            Err(Error::Limit { what: format!("the {what} of a Zarr array"), needed, limit, remedy })
        };
        if count > MOST_CHUNKS {
            return limit("chunks", format!("{count} chunks"), format!("{MOST_CHUNKS}"));
        }
        if bytes > hint.max_bytes {
            return limit("chunk", format!("{bytes} bytes each"), format!("{} bytes", hint.max_bytes));
        }
        let in_shard = product(self.array.chunk.iter().zip(inner).map(|(outer, inner)| outer / inner).collect());
        if in_shard > MOST_CHUNKS {
            return limit("shard", format!("{in_shard} chunks in each"), format!("{MOST_CHUNKS}"));
        }
        Ok(())
    }

    /// Reads what is wanted of a stored chunk.
    fn read_file(&self, mut file: File, length: u64, place: &[u64], out: &mut Out<'_>, hint: &ReadHint) -> Attempt<()> {
        let array = self.array;
        let start: Vec<u64> = place.iter().zip(&array.chunk).map(|(p, c)| p * c).collect();
        let Some(shard) = &array.shard else {
            let bytes = read_at(&mut file, 0, length, self.most_packed())?;
            return out.paste(self.unpack(bytes)?, &array.chunk, &start);
        };
        let index = Index::read(&mut file, length, array, shard, hint)?;
        // Of the chunks in the shard those that are wanted, from its first entry.
        let inside: Vec<Range<u64>> = out
            .wanted
            .iter()
            .zip(&start)
            .zip(&array.chunk)
            .map(|((w, s), c)| w.start.saturating_sub(*s)..(w.end - s).min(*c))
            .collect();
        for inner in grid(&touched(&inside, &shard.chunk)) {
            let Some((offset, size)) = index.entry(&inner)? else { continue };
            let bytes = read_at(&mut file, offset, size, self.most_packed())?;
            let start: Vec<u64> = inner.iter().zip(&shard.chunk).zip(&start).map(|((i, c), s)| s + i * c).collect();
            out.paste(self.unpack(bytes)?, &shard.chunk, &start)?;
        }
        Ok(())
    }

    /// Bytes of the samples of a chunk.
    fn chunk_bytes(&self) -> usize {
        // Checked to be no more than may be read.
        self.array.inner_chunk().iter().product::<u64>() as usize * self.array.kind.size()
    }

    /// Most bytes of a packed chunk: no compressor makes much more of what it cannot pack.
    fn most_packed(&self) -> u64 {
        let bytes = self.chunk_bytes() as u64;
        bytes + bytes / 8 + (1 << 16)
    }

    fn unpack(&self, packed: Vec<u8>) -> Attempt<Data> {
        let Pipeline { endian, .. } = self.array.pipeline;
        let bytes = self.array.pipeline.unpack(packed, self.chunk_bytes()).map_err(Wrong::Damaged)?;
        let count = bytes.len() / self.array.kind.size();
        Ok(decode::binary(&mut Source::new(&bytes[..], None), NAME, self.array.kind, endian, count)?)
    }
}

/// What went wrong with a chunk: its content, or something that has its own words.
enum Wrong {
    Damaged(String),
    Other(Error),
}

type Attempt<T> = std::result::Result<T, Wrong>;

impl From<Error> for Wrong {
    fn from(e: Error) -> Self {
        Self::Other(e)
    }
}

/// The places of the chunks in a shard.
struct Index {
    bytes: Vec<u8>,
    endian: Endian,
    /// Chunks along each axis.
    along: Vec<u64>,
    /// Bytes of the file.
    length: u64,
}

impl Index {
    fn read(file: &mut File, length: u64, array: &Array, shard: &Shard, hint: &ReadHint) -> Attempt<Self> {
        let along: Vec<u64> = array.chunk.iter().zip(&shard.chunk).map(|(outer, inner)| outer / inner).collect();
        // Checked to be no more than MOST_CHUNKS.
        let plain = along.iter().product::<u64>() as usize * 16;
        let packed = shard.index.plain_length(plain).unwrap_or(plain) as u64;
        let Some(end) = length.checked_sub(packed) else {
            return Err(Wrong::Damaged(format!("{length} bytes, less than the {packed} of its index")));
        };
        let bytes = read_at(file, if shard.index_at_end { end } else { 0 }, packed, packed.min(hint.max_bytes))?;
        let bytes = shard.index.unpack(bytes, plain).map_err(|text| Wrong::Damaged(format!("{text} in its index")))?;
        Ok(Self { bytes, endian: shard.index.endian, along, length })
    }

    /// Where a chunk lies in the file; none where it is not stored.
    fn entry(&self, place: &[u64]) -> Attempt<Option<(u64, u64)>> {
        let at = place.iter().zip(&self.along).fold(0, |n, (p, along)| n * along + p) as usize * 16;
        let number = |at: usize| {
            let bytes = self.bytes.get(at..).and_then(|rest| rest.first_chunk::<8>()).copied().unwrap_or([0xff; 8]);
            if self.endian == Endian::Big { u64::from_be_bytes(bytes) } else { u64::from_le_bytes(bytes) }
        };
        match (number(at), number(at + 8)) {
            (u64::MAX, u64::MAX) => Ok(None),
            (offset, size) if offset.checked_add(size).is_some_and(|end| end <= self.length) => {
                Ok(Some((offset, size)))
            }
            (offset, size) => Err(Wrong::Damaged(format!("{size} bytes at {offset} in its index, of {}", self.length))),
        }
    }
}

fn read_at(file: &mut File, offset: u64, size: u64, most: u64) -> Attempt<Vec<u8>> {
    if size > most {
        return Err(Wrong::Damaged(format!("{size} bytes, where no more than {most} can be")));
    }
    let system = |e| Error::from_read(NAME, "a chunk", e);
    file.seek(SeekFrom::Start(offset)).map_err(system)?;
    let mut bytes = Vec::new();
    file.take(size).read_to_end(&mut bytes).map_err(system)?;
    if bytes.len() as u64 == size {
        Ok(bytes)
    } else {
        Err(Wrong::Damaged(format!("{} bytes instead of {size}", bytes.len())))
    }
}

/// The chunks that a box touches, along each axis.
fn touched(wanted: &[Range<u64>], chunk: &[u64]) -> Vec<Range<u64>> {
    wanted.iter().zip(chunk).map(|(w, c)| w.start / c..w.end.div_ceil(*c)).collect()
}

/// All places in a box, the last axis fastest.
fn grid(ranges: &[Range<u64>]) -> impl Iterator<Item = Vec<u64>> {
    let count = ranges.iter().fold(1u64, |n, range| n.saturating_mul(range.end - range.start));
    (0..count).map(move |i| {
        let mut rest = i;
        let mut place = vec![0; ranges.len()];
        for (p, range) in place.iter_mut().zip(ranges).rev() {
            let size = range.end - range.start;
            *p = range.start + rest % size;
            rest /= size;
        }
        place
    })
}

/// So many samples, all alike.
fn filled(fill: &Data, count: usize) -> Result<Data> {
    macro_rules! each {
        ($($variant:ident),*) => {
            match fill {
                $(Data::$variant(one) => {
                    let mut all = Vec::new();
                    all.try_reserve_exact(count).map_err(|_| Error::Limit {
                        what: "the samples of a Zarr array".into(),
                        needed: format!("{count} of them in memory"),
                        limit: "what the system gives".into(),
                        remedy: "read a part with --region".into(),
                    })?;
                    all.resize(count, one.first().copied().unwrap_or_default());
                    Data::$variant(all)
                })*
            }
        };
    }
    Ok(each!(U8, I8, U16, I16, U32, I32, U64, I64, F32, F64))
}

/// The samples that are being put together.
struct Out<'a> {
    data: Data,
    part: &'a Part<'a>,
    wanted: &'a [Range<u64>],
}

impl Out<'_> {
    /// Puts in what is wanted of a chunk whose first entry is at `start`.
    fn paste(&mut self, chunk: Data, shape: &[u64], start: &[u64]) -> Attempt<()> {
        // Entries from one to the next along each axis of the array.
        let axes = &self.part.array.pipeline.axes;
        let (mut strides, mut step) = (vec![0; axes.len()], 1);
        for &axis in axes.iter().rev() {
            strides[axis] = step;
            step *= shape[axis] as usize;
        }
        let mut base = 0;
        let mut rows = [0..0, 0..0, 0..0];
        for (axis, wanted) in self.wanted.iter().enumerate() {
            let range = wanted.start.max(start[axis])..wanted.end.min(start[axis] + shape[axis]);
            if range.is_empty() {
                return Ok(());
            }
            base += (range.start - start[axis]) as usize * strides[axis];
            if let Some(i) = self.part.roles.space.iter().position(|&a| a == axis) {
                rows[i] = (range.start - wanted.start) as usize..(range.end - wanted.start) as usize;
            }
        }
        let stride = self.part.roles.space.map(|axis| strides[axis]);
        let size = self.part.count.map(|n| n as usize);
        macro_rules! paste {
            ($($variant:ident),*) => {
                match (&mut self.data, &chunk) {
                    $((Data::$variant(to), Data::$variant(from)) => copy(to, size, &rows, &from[base..], stride),)*
                    _ => return Err(Wrong::Damaged("samples of another type".into())),
                }
            };
        }
        paste!(U8, I8, U16, I16, U32, I32, U64, I64, F32, F64);
        Ok(())
    }
}

/// Copies a box of samples, given by its ranges in `to`; the first of `from` is its first.
fn copy<T: Copy>(to: &mut [T], size: [usize; 3], [xs, ys, zs]: &[Range<usize>; 3], from: &[T], stride: [usize; 3]) {
    for (k, z) in zs.clone().enumerate() {
        for (j, y) in ys.clone().enumerate() {
            let row = &mut to[size[0] * (y + size[1] * z)..][xs.clone()];
            let from = &from[j * stride[1] + k * stride[2]..];
            row.iter_mut().enumerate().for_each(|(i, to)| *to = from[i * stride[0]]);
        }
    }
}
