//! Samples as files store them: binary in either byte order or text, eleven types. Memory grows
//! with the bytes that really arrive, never with what a header claims.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]

use super::Samples;
use super::read::ReadHint;
use super::source::Source;
use crate::error::{Error, Result};
use std::io::Read;

/// Bytes decoded at a time, and the first reservation of a stream of unknown length.
const PIECE: usize = 1 << 20;

/// The type of a stored sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Type {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F16,
    F32,
    F64,
}

impl Type {
    /// Bytes of one sample.
    pub(crate) fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 | Self::F16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }

    /// The name that NumPy uses.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::U8 => "uint8",
            Self::I8 => "int8",
            Self::U16 => "uint16",
            Self::I16 => "int16",
            Self::U32 => "uint32",
            Self::I32 => "int32",
            Self::U64 => "uint64",
            Self::I64 => "int64",
            Self::F16 => "float16",
            Self::F32 => "float32",
            Self::F64 => "float64",
        }
    }

    /// The type of a NumPy name.
    pub(crate) fn from_name(name: &str) -> Option<Self> {
        use Type::*;
        [U8, I8, U16, I16, U32, I32, U64, I64, F16, F32, F64].into_iter().find(|t| t.name() == name)
    }
}

/// Byte order of stored samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Endian {
    Little,
    Big,
}

/// Decoded samples before they are narrowed to the types that a volume holds.
#[derive(Clone, Debug, PartialEq)]
#[allow(missing_docs, reason = "the names are those of the types")]
pub enum Data {
    U8(Vec<u8>),
    I8(Vec<i8>),
    U16(Vec<u16>),
    I16(Vec<i16>),
    U32(Vec<u32>),
    I32(Vec<i32>),
    U64(Vec<u64>),
    I64(Vec<i64>),
    F32(Vec<f32>),
    F64(Vec<f64>),
}

impl Data {
    /// The samples of a type that volumes hold.
    pub(super) fn samples(self) -> Option<Samples> {
        Some(match self {
            Self::U8(v) => Samples::U8(v),
            Self::I8(v) => Samples::I8(v),
            Self::U16(v) => Samples::U16(v),
            Self::I16(v) => Samples::I16(v),
            Self::F32(v) => Samples::F32(v),
            _ => return None,
        })
    }

    /// The samples as numbers; large integers are rounded.
    pub(crate) fn numbers(&self) -> Vec<f64> {
        macro_rules! each {
            ($($variant:ident),*) => {
                match self { $(Self::$variant(v) => v.iter().map(|s| *s as f64).collect(),)* }
            };
        }
        each!(U8, I8, U16, I16, U32, I32, U64, I64, F32, F64)
    }
}

/// Checks what a header claims: no dimension 0, no overflow, within the limit, and no more than
/// the source can still hold. Returns the number of samples.
///
/// # Errors
/// As said; the message names the claim.
pub(crate) fn checked_count(
    format: &'static str,
    dims: [u64; 3],
    size: usize,
    at_most: Option<u64>,
    hint: &ReadHint,
) -> Result<usize> {
    let shape = format!("{}×{}×{} samples of {size} bytes", dims[0], dims[1], dims[2]);
    if dims.contains(&0) {
        return Err(Error::format(format, shape, "at least one sample along each axis", "correct the header"));
    }
    let count = dims.iter().try_fold(1u64, |n, &d| n.checked_mul(d));
    let bytes = count.and_then(|n| n.checked_mul(size as u64)).filter(|&n| n <= hint.max_bytes);
    let (Some(count), Some(bytes)) = (count.and_then(|n| usize::try_from(n).ok()), bytes) else {
        return Err(Error::Limit {
            what: format!("the volume that the {format} header claims ({shape})"),
            needed: count.map_or("more than 2^64 samples".into(), |n| format!("{} bytes", n as f64 * size as f64)),
            limit: format!("{} bytes", hint.max_bytes),
            remedy: "correct the header, crop or downsample the volume, or raise the limit".into(),
        });
    };
    if let Some(left) = at_most
        && left < bytes
    {
        return Err(Error::format(
            format,
            format!("at most {left} bytes of samples"),
            format!("{bytes} bytes ({shape})"),
            "the file is incomplete or its header is wrong; copy or download it again",
        ));
    }
    Ok(count)
}

/// Reads `count` binary samples.
///
/// # Errors
/// A format error when the stream ends before; the system's errors.
pub(crate) fn binary(
    source: &mut Source,
    format: &'static str,
    kind: Type,
    endian: Endian,
    count: usize,
) -> Result<Data> {
    macro_rules! samples {
        ($variant:ident, $t:ty) => {
            Data::$variant(match endian {
                Endian::Little => numbers(source, format, kind, count, <$t>::from_le_bytes)?,
                Endian::Big => numbers(source, format, kind, count, <$t>::from_be_bytes)?,
            })
        };
    }
    Ok(match kind {
        Type::U8 => Data::U8(bytes(source, format, count)?),
        // A plain cast of each byte; the optimiser makes it a copy.
        Type::I8 => Data::I8(bytes(source, format, count)?.into_iter().map(|b| b as i8).collect()),
        Type::U16 => samples!(U16, u16),
        Type::I16 => samples!(I16, i16),
        Type::U32 => samples!(U32, u32),
        Type::I32 => samples!(I32, i32),
        Type::U64 => samples!(U64, u64),
        Type::I64 => samples!(I64, i64),
        Type::F32 => samples!(F32, f32),
        Type::F64 => samples!(F64, f64),
        Type::F16 => Data::F32(match endian {
            Endian::Little => numbers(source, format, kind, count, |b| half::f16::from_le_bytes(b).to_f32())?,
            Endian::Big => numbers(source, format, kind, count, |b| half::f16::from_be_bytes(b).to_f32())?,
        }),
    })
}

fn truncated(format: &'static str, kind: Type, found: usize, count: usize) -> Error {
    Error::format(
        format,
        format!("{found} samples before the end of the file"),
        format!("{count} samples of type {}", kind.name()),
        "the file is incomplete; copy or download it again",
    )
}

pub(super) fn no_memory(format: &'static str, bytes: usize) -> Error {
    Error::Limit {
        what: format!("the volume of this {format} file"),
        needed: format!("another {bytes} bytes of memory"),
        limit: "what the system gives".into(),
        remedy: "crop or downsample the volume, or use a machine with more memory".into(),
    }
}

/// Makes room for more elements: doubling, but never beyond `count`.
fn grow<T>(out: &mut Vec<T>, format: &'static str, count: usize) -> Result<()> {
    let more = out.len().max(PIECE).min(count - out.len());
    out.try_reserve_exact(more).map_err(|_| no_memory(format, more * size_of::<T>()))
}

fn bytes(source: &mut Source, format: &'static str, count: usize) -> Result<Vec<u8>> {
    let mut out: Vec<u8> = Vec::new();
    while out.len() < count {
        grow(&mut out, format, count)?;
        let (start, room) = (out.len(), out.capacity().min(count) - out.len());
        // Zeroed in pieces: reading into spare capacity would need unsafe code.
        out.resize(start + room.min(PIECE), 0);
        let read = fill(source, format, &mut out[start..])?;
        if read < out.len() - start {
            return Err(truncated(format, Type::U8, start + read, count));
        }
    }
    Ok(out)
}

fn numbers<T, const N: usize>(
    source: &mut Source,
    format: &'static str,
    kind: Type,
    count: usize,
    decode: impl Fn([u8; N]) -> T,
) -> Result<Vec<T>> {
    let mut out: Vec<T> = Vec::new();
    let mut piece = vec![0u8; PIECE.min(count.saturating_mul(N))];
    while out.len() < count {
        let wanted = (piece.len() / N).min(count - out.len());
        let read = fill(source, format, &mut piece[..wanted * N])?;
        if read < wanted * N {
            return Err(truncated(format, kind, out.len() + read / N, count));
        }
        while out.capacity() < out.len() + wanted {
            grow(&mut out, format, count)?;
        }
        out.extend(piece[..read].as_chunks::<N>().0.iter().map(|b| decode(*b)));
    }
    Ok(out)
}

/// Fills `out` as far as the stream goes.
fn fill(source: &mut Source, format: &'static str, out: &mut [u8]) -> Result<usize> {
    let mut at = 0;
    while at < out.len() {
        match source.read(&mut out[at..]) {
            Ok(0) => break,
            Ok(n) => at += n,
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Err(Error::from_read(format, "samples", e)),
        }
    }
    Ok(at)
}

/// Reads `count` samples written as text.
///
/// # Errors
/// A format error when the text ends before, or holds something that is not a number of the type.
pub(crate) fn text(source: &mut Source, format: &'static str, kind: Type, count: usize) -> Result<Data> {
    macro_rules! samples {
        ($variant:ident, $t:ty) => {
            Data::$variant(words(source, format, kind, count, |word| word.parse::<$t>().ok())?)
        };
    }
    Ok(match kind {
        Type::U8 => samples!(U8, u8),
        Type::I8 => samples!(I8, i8),
        Type::U16 => samples!(U16, u16),
        Type::I16 => samples!(I16, i16),
        Type::U32 => samples!(U32, u32),
        Type::I32 => samples!(I32, i32),
        Type::U64 => samples!(U64, u64),
        Type::I64 => samples!(I64, i64),
        Type::F16 | Type::F32 => samples!(F32, f32),
        Type::F64 => Data::F64(words(source, format, kind, count, fortran_number)?),
    })
}

fn words<T>(
    source: &mut Source,
    format: &'static str,
    kind: Type,
    count: usize,
    parse: impl Fn(&str) -> Option<T>,
) -> Result<Vec<T>> {
    let mut out = Vec::new();
    let mut token = Vec::new();
    while out.len() < count {
        if !source.token(format, &mut token)? {
            return Err(truncated(format, kind, out.len(), count));
        }
        let number = std::str::from_utf8(&token).ok().and_then(&parse).ok_or_else(|| {
            Error::format(
                format,
                format!("{:?} as sample {}", String::from_utf8_lossy(&token), out.len()),
                format!("a number of type {}", kind.name()),
                "the file is damaged, or its header names the wrong type",
            )
        })?;
        if out.len() == out.capacity() {
            grow(&mut out, format, count)?;
        }
        out.push(number);
    }
    Ok(out)
}

/// A number as C or Fortran prints it: also `1.5D-03`, and `1.5-103` where Fortran had no room
/// for the letter.
pub(crate) fn fortran_number(word: &str) -> Option<f64> {
    if let Ok(number) = word.parse() {
        return Some(number);
    }
    let with_letter = word.replace(['d', 'D'], "e");
    if let Ok(number) = with_letter.parse() {
        return Some(number);
    }
    let sign = word.rfind(['+', '-']).filter(|&at| at > 0)?;
    format!("{}e{}", &word[..sign], &word[sign..]).parse().ok()
}

#[cfg(test)]
mod tests;
