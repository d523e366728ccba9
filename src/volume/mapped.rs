//! Samples that are read where they lie in their file, through a map: one copy in the cache of the system for all processes of
//! a machine, and none in theirs. Of files whose samples are as a volume holds them: not compressed, x fastest, in this
//! machine's byte order, aligned to their size. All others are decoded.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]

use super::assemble::{permute, pick, pick_of};
use super::decode::{self, Data, Endian, Type};
use super::samples::largest_finite;
use super::source::Source;
use super::{Place, SampleOwner, Samples, SamplesView};
use crate::error::{Error, Result};
use crate::file::{MAP_ABOVE, Plain, Stamp};
use memmap2::Mmap;
use std::fmt;
use std::path::Component;
use std::sync::Arc;

/// Byte order of this machine.
const NATIVE: Endian = if cfg!(target_endian = "big") { Endian::Big } else { Endian::Little };

/// Samples in a map of their file.
pub(crate) struct Mapped {
    // Invariants: the length is a multiple of the size of `kind`, the start aligned to it; `kind` is one that volumes hold.
    map: Mmap,
    kind: Type,
    file: Plain,
    offset: u64,
    stamp: Stamp,
}

impl fmt::Debug for Mapped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} bytes of {}", self.map.len(), self.file.path().display())
    }
}

impl Mapped {
    /// The next `count` samples of a source; none where they have to be decoded, or the system has no room for the map.
    fn take(source: &mut Source, kind: Type, endian: Endian, count: usize) -> Option<Self> {
        let length = count.checked_mul(kind.size())?;
        let held = matches!(kind, Type::U8 | Type::I8 | Type::U16 | Type::I16 | Type::F32);
        let in_order = kind.size() == 1 || endian == NATIVE;
        let offset = source.consumed();
        if !(held && in_order && length as u64 > MAP_ABOVE && offset.is_multiple_of(kind.size() as u64)) {
            return None;
        }
        let file = source.file()?;
        let stamp = file.stamp().ok()?;
        let map = file.map(offset, length)?;
        source.jump(length as u64).ok()?;
        Some(Self { map, kind, file, offset, stamp })
    }

    /// Whether the samples can stay as they are: finite, and of a range that needs no scaling.
    pub(super) fn is_usable(&self, fits: impl Fn(f64) -> bool) -> bool {
        match self.view() {
            SamplesView::F32(samples) => largest_finite(samples).is_some_and(|most| fits(f64::from(most))),
            _ => true,
        }
    }
}

/// What helps a store whose samples are not where it says.
pub(crate) const REMEDY_OF_REFERENCE: &str = "put the file back; or run the bake that made the store again, with a file of this name wherever it is now and \
     --store-volume reference: the store then names that one, if its samples are the same";

impl Place {
    /// Whether its path means the same file in every folder.
    fn is_absolute(&self) -> bool {
        self.file.is_absolute() && !self.file.components().any(|part| part == Component::ParentDir)
    }

    /// Whether the file is there, with the length and the time that it had.
    pub(crate) fn is_there(&self) -> bool {
        let stamp = crate::file::open(&self.file).and_then(|(file, _)| {
            Plain::new(file, &self.file).stamp().map_err(|e| Error::io(&self.file, "look at", e))
        });
        self.is_absolute() && stamp.is_ok_and(|stamp| stamp == Stamp { bytes: self.bytes, modified: self.modified })
    }
}

/// The samples that lie at a place, mapped, or read where the system has no room for a map.
///
/// # Errors
/// When the file is not there or not as it was; the system's errors.
pub(crate) fn samples_at(place: &Place, type_name: &str, count: usize, maps: bool) -> Result<Samples> {
    const NAME: &str = "file of samples";
    let refuse_as = |found: String, expected: String| {
        Error::format(NAME, found, expected, REMEDY_OF_REFERENCE).in_file(&place.file)
    };
    let refuse = |found| refuse_as(found, format!("{} bytes, not written since the store was made", place.bytes));
    // Else it would depend on the folder of whoever opens the store.
    if !place.is_absolute() {
        return Err(refuse_as("a relative path".into(), "an absolute path without .. in it".into()));
    }
    let (file, length) = crate::file::open(&place.file).map_err(|e| match e {
        Error::Io { source, .. } => refuse(source.to_string()),
        other => other,
    })?;
    let plain = Plain::new(file, &place.file);
    let stamp = plain.stamp().map_err(|e| Error::io(&place.file, "look at", e))?;
    if stamp != (Stamp { bytes: place.bytes, modified: place.modified }) {
        let found = if stamp.bytes == place.bytes {
            "a file that was written since".into()
        } else {
            format!("{} bytes", stamp.bytes)
        };
        return Err(refuse(found));
    }
    let kind = Type::from_name(type_name).ok_or_else(|| refuse(format!("samples of type {type_name}")))?;
    let in_file = |e: Error| e.in_file(&place.file);
    let mut source = Source::of_file(plain, Some(length), maps);
    source.skip(NAME, place.offset, "what is before the samples").map_err(in_file)?;
    match Stored::binary(&mut source, NAME, kind, NATIVE, count).map_err(in_file)? {
        Stored::Mapped(mapped) => Ok(Samples::Shared(Arc::new(mapped))),
        Stored::Decoded(data) => data.samples().ok_or_else(|| refuse(format!("samples of type {type_name}"))),
    }
}

impl SampleOwner for Mapped {
    fn view(&self) -> SamplesView<'_> {
        let bytes: &[u8] = &self.map;
        match self.kind {
            Type::U8 => SamplesView::U8(bytes),
            Type::I8 => SamplesView::I8(bytemuck::cast_slice(bytes)),
            Type::U16 => SamplesView::U16(bytemuck::cast_slice(bytes)),
            Type::I16 => SamplesView::I16(bytemuck::cast_slice(bytes)),
            _ => SamplesView::F32(bytemuck::cast_slice(bytes)),
        }
    }

    fn place(&self) -> Option<Place> {
        let file = self.file.path().canonicalize().unwrap_or_else(|_| self.file.path().into());
        let Stamp { bytes, modified } = self.stamp;
        Some(Place { file, offset: self.offset, bytes, modified })
    }

    fn check(&self) -> Result<()> {
        if self.file.stamp().map_err(|e| Error::io(self.file.path(), "look at", e))? == self.stamp {
            return Ok(());
        }
        let text = "another program wrote it while it was used; begin again when it is whole, or read it at once with --no-map";
        Err(Error::io(self.file.path(), "go on with", std::io::Error::other(text)))
    }
}

/// Samples as a format hands them over.
pub(crate) enum Stored {
    Decoded(Data),
    Mapped(Mapped),
}

impl From<Data> for Stored {
    fn from(data: Data) -> Self {
        Self::Decoded(data)
    }
}

impl Stored {
    /// The next `count` binary samples of a source: where they lie, or decoded.
    ///
    /// # Errors
    /// As [`decode::binary`].
    pub(crate) fn binary(
        source: &mut Source,
        format: &'static str,
        kind: Type,
        endian: Endian,
        count: usize,
    ) -> Result<Self> {
        match Mapped::take(source, kind, endian, count) {
            Some(mapped) => Ok(Self::Mapped(mapped)),
            None => decode::binary(source, format, kind, endian, count).map(Self::Decoded),
        }
    }

    /// The samples in memory.
    ///
    /// # Errors
    /// When the system has no room for them.
    pub(crate) fn decoded(self, format: &'static str) -> Result<Data> {
        let mapped = match self {
            Self::Decoded(data) => return Ok(data),
            Self::Mapped(mapped) => mapped,
        };
        fn copy<T: Copy>(samples: &[T], format: &'static str) -> Result<Vec<T>> {
            let mut all = Vec::new();
            let bytes = size_of_val(samples);
            all.try_reserve_exact(samples.len()).map_err(|_| decode::no_memory(format, bytes))?;
            all.extend_from_slice(samples);
            Ok(all)
        }
        Ok(match mapped.view() {
            SamplesView::U8(s) => Data::U8(copy(s, format)?),
            SamplesView::I8(s) => Data::I8(copy(s, format)?),
            SamplesView::U16(s) => Data::U16(copy(s, format)?),
            SamplesView::I16(s) => Data::I16(copy(s, format)?),
            SamplesView::F32(s) => Data::F32(copy(s, format)?),
        })
    }

    /// [`pick`], of whatever is kept.
    pub(crate) fn pick(self, first: usize, stride: [usize; 3], dims: [usize; 3]) -> Self {
        Self::Decoded(match self {
            Self::Decoded(data) => pick(data, first, stride, dims),
            Self::Mapped(mapped) => pick_of(mapped.view(), first, stride, dims),
        })
    }

    /// [`permute`]; what is in order already stays where it lies.
    ///
    /// # Errors
    /// As [`Self::decoded`].
    pub(crate) fn permute(
        self,
        file_dims: [usize; 3],
        axis: [usize; 3],
        format: &'static str,
    ) -> Result<(Self, [usize; 3])> {
        if axis == [0, 1, 2] {
            return Ok((self, file_dims));
        }
        let (data, dims) = permute(self.decoded(format)?, file_dims, axis);
        Ok((Self::Decoded(data), dims))
    }
}
