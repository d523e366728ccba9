//! The headers of NIfTI-1 and NIfTI-2 (nifti.nimh.nih.gov, `nifti1.h` and `nifti2.h`): the same fields at other places, the
//! numbers wider in the second.

use super::super::super::decode::Endian;
use super::super::super::source::Source;
use super::NAME;
use crate::error::{Error, Result};

/// Bytes of the headers.
const ONE: usize = 348;
const TWO: usize = 540;
/// What follows the magic of NIfTI-2, so that a transfer as text shows.
const TRANSFER: [u8; 4] = *b"\r\n\x1a\n";

/// The fields that are read, whichever version.
pub(super) struct Header {
    pub(super) endian: Endian,
    /// Whether the samples lie in a second file.
    pub(super) is_pair: bool,
    /// Bytes of the header itself.
    pub(super) length: usize,
    pub(super) dim: [i64; 8],
    pub(super) datatype: i16,
    pub(super) pixdim: [f64; 8],
    pub(super) vox_offset: f64,
    pub(super) scl_slope: f64,
    pub(super) scl_inter: f64,
    pub(super) xyzt_units: i32,
    pub(super) qform_code: i32,
    pub(super) sform_code: i32,
    pub(super) quatern_bcd: [f64; 3],
    pub(super) qoffset: [f64; 3],
    pub(super) srow: [[f64; 4]; 3],
}

/// Whether the first bytes are those of NIfTI; relatives are refused by name.
pub(crate) fn is_nifti(head: &[u8]) -> Result<bool> {
    let Some(size) = head.first_chunk::<4>() else { return Ok(false) };
    let sizes = [i32::from_le_bytes(*size), i32::from_be_bytes(*size)];
    let magic = |at: usize| head.get(at..at + 4).unwrap_or_default();
    if sizes.contains(&(TWO as i32)) && matches!(magic(4), b"n+2\0" | b"ni2\0") {
        if magic(8) != TRANSFER {
            let found = format!("the bytes {:02x?} behind the magic", magic(8));
            let remedy = "it was copied as text; copy or download it again as binary";
            return Err(Error::format(NAME, found, format!("{TRANSFER:02x?}"), remedy));
        }
        return Ok(true);
    }
    if matches!(magic(344), b"n+1\0" | b"ni1\0") {
        return Ok(true);
    }
    if sizes.contains(&(ONE as i32)) && head.len() >= ONE {
        return Err(Error::format(
            NAME,
            "a header of 348 bytes without NIfTI's magic, perhaps ANALYZE 7.5",
            "\"n+1\" at byte 344",
            "convert it to NIfTI-1; ANALYZE does not say where left is",
        ));
    }
    Ok(false)
}

/// Numbers at places in the bytes of a header.
struct Fields<'a> {
    bytes: &'a [u8],
    endian: Endian,
}

macro_rules! field {
    ($($name:ident $t:ty),*) => {
        impl Fields<'_> { $(fn $name(&self, at: usize) -> $t {
            let bytes = self.bytes[at..].first_chunk().copied().unwrap_or_default();
            match self.endian { Endian::Little => <$t>::from_le_bytes(bytes), Endian::Big => <$t>::from_be_bytes(bytes) }
        })* }
    };
}
field!(i16 i16, i32 i32, i64 i64, f32 f32, f64 f64);

impl Header {
    /// Reads the header of a stream that [`is_nifti`].
    pub(super) fn read(source: &mut Source) -> Result<Self> {
        let head = source.peek(12).map_err(|e| Error::from_read(NAME, "the header", e))?;
        if matches!(head.get(4..8), Some(b"n+2\0" | b"ni2\0")) && head.get(8..12) == Some(&TRANSFER) {
            return Ok(Self::two(&source.array::<TWO>(NAME, "header")?));
        }
        Ok(Self::one(&source.array::<ONE>(NAME, "header")?))
    }

    fn one(bytes: &[u8; ONE]) -> Self {
        let mut f = Fields { bytes, endian: Endian::Little };
        // The size says the byte order; where it is damaged the number of dimensions does.
        if f.i32(0) != ONE as i32 && (f.i32(0).swap_bytes() == ONE as i32 || !(1..=7).contains(&f.i16(40))) {
            f.endian = Endian::Big;
        }
        let floats = |at: usize| move |i: usize| at + 4 * i;
        let wide = |at: usize| f64::from(f.f32(at));
        let three = |at: usize| [0, 1, 2].map(floats(at)).map(wide);
        Self {
            endian: f.endian,
            is_pair: bytes[344..].starts_with(b"ni1"),
            length: ONE,
            dim: std::array::from_fn(|i| f.i16(40 + 2 * i).into()),
            datatype: f.i16(70),
            pixdim: std::array::from_fn(floats(76)).map(wide),
            vox_offset: wide(108),
            scl_slope: wide(112),
            scl_inter: wide(116),
            xyzt_units: bytes[123].into(),
            qform_code: f.i16(252).into(),
            sform_code: f.i16(254).into(),
            quatern_bcd: three(256),
            qoffset: three(268),
            srow: [280, 296, 312].map(|at| std::array::from_fn(floats(at)).map(wide)),
        }
    }

    fn two(bytes: &[u8; TWO]) -> Self {
        let mut f = Fields { bytes, endian: Endian::Little };
        if f.i32(0) != TWO as i32 {
            f.endian = Endian::Big;
        }
        let doubles = |at: usize| move |i: usize| at + 8 * i;
        let wide = |at: usize| f.f64(at);
        let three = |at: usize| [0, 1, 2].map(doubles(at)).map(wide);
        Self {
            endian: f.endian,
            is_pair: bytes[4..].starts_with(b"ni2"),
            length: TWO,
            dim: std::array::from_fn(|i| f.i64(16 + 8 * i)),
            datatype: f.i16(12),
            pixdim: std::array::from_fn(doubles(104)).map(wide),
            vox_offset: f.i64(168) as f64,
            scl_slope: wide(176),
            scl_inter: wide(184),
            xyzt_units: f.i32(500),
            qform_code: f.i32(344),
            sform_code: f.i32(348),
            quatern_bcd: three(352),
            qoffset: three(376),
            srow: [400, 432, 464].map(|at| std::array::from_fn(doubles(at)).map(wide)),
        }
    }
}
