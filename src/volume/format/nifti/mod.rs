//! NIfTI-1 and NIfTI-2 (nifti.nimh.nih.gov, `nifti1.h`, `nifti2.h`), by hand: the crate `nifti` refuses the second, reserves
//! what the header claims before it reads, and applies scl_slope only together with ndarray.
//!
//! World is RAS+: the sform where its code is not 0, else the qform, else pixdim along the axes
//! with the first sample at the origin (method 1 of the standard).

mod header;

use super::super::assemble::{Parts, assemble, note};
use super::super::decode::{Type, checked_count};
use super::super::mapped::Stored;
use super::super::read::{OpenBeside, ReadHint};
use super::super::source::Source;
use super::super::{LengthUnit, Note, Volume};
use super::{affine, needs_second_file};
use crate::error::{Error, Result};
use crate::geom::{Affine, Up};
use glam::{DMat3, DVec3};
use header::Header;
use std::path::Path;

pub(crate) use header::is_nifti;

const NAME: &str = "NIfTI";

pub(crate) fn read(mut source: Source, hint: &ReadHint, beside: Option<OpenBeside>) -> Result<Volume> {
    let header = Header::read(&mut source)?;
    let mut notes = Vec::new();
    let (dims, times, components) = dims(&header)?;
    let series = hint.choice.of(NAME, vec![String::new(); components], times, &mut notes)?;
    let kind = sample_type(header.datatype)?;
    let offset = header.vox_offset;
    let smallest = if header.is_pair { 0.0 } else { header.length as f64 };
    if !(offset.is_finite() && (smallest..=1e15).contains(&offset)) {
        return Err(Error::format(
            NAME,
            format!("vox_offset {offset}"),
            format!("an offset of {smallest} or more"),
            "correct the header",
        ));
    }
    let mut skip = offset as u64;
    if header.is_pair {
        // The header of a pair: the samples lie in the .img file beside it.
        let open = beside.ok_or_else(|| needs_second_file(NAME, ".img"))?;
        source = open(Path::new(&format!("{}.img", hint.name)))
            .or_else(|first| open(Path::new(&format!("{}.img.gz", hint.name))).map_err(|_| first))?;
        if source.is_gzip().map_err(|e| Error::from_read(NAME, "samples", e))? {
            source = source.gunzip();
        }
    } else {
        skip -= header.length as u64;
    }
    source.skip(NAME, skip, "header extensions")?;
    // Time runs faster than components.
    let before = times.checked_mul(series.channel).and_then(|n| n.checked_add(series.timepoint)).map(|n| n as u64);
    let bytes = before.and_then(|n| n.checked_mul(kind.size() as u64));
    let bytes = bytes.and_then(|n| dims.iter().try_fold(n, |n, &d| n.checked_mul(d)));
    let refuse = || Error::format(NAME, "more than 2^64 bytes", "fewer samples", "the header is damaged");
    source.skip(NAME, bytes.ok_or_else(refuse)?, "the volumes before")?;
    let count = checked_count(NAME, dims, kind.size(), source.at_most(), hint)?;
    let data = Stored::binary(&mut source, NAME, kind, header.endian, count)?;
    if series.timepoint + 1 == times && series.channel + 1 == components {
        source.verify_end(NAME)?; // else more follows
    }

    let (slope, inter) = match (header.scl_slope, header.scl_inter) {
        // "If the scl_slope field is nonzero, then each voxel value should be scaled"; writers
        // put NaN where they mean nothing (nibabel).
        (slope, inter) if slope.is_finite() && slope != 0.0 => (slope, if inter.is_finite() { inter } else { 0.0 }),
        _ => (1.0, 0.0),
    };
    let (world_from_grid, anatomical) = world(&header, &mut notes)?;
    let unit = match header.xyzt_units & 7 {
        1 => LengthUnit::Metres(1.0),
        2 => LengthUnit::Metres(1e-3),
        3 => LengthUnit::Metres(1e-6),
        _ => LengthUnit::Unknown,
    };
    let dims = dims.map(|d| d as usize);
    let mut volume =
        assemble(Parts { format: NAME, dims, data, slope, inter, world_from_grid, unit, series, notes }, hint)?;
    if anatomical {
        volume.up = Up::Anatomical;
    }
    Ok(volume)
}

/// The three spatial dimensions, time points, and components; the sixth and seventh dimension must be 1.
fn dims(header: &Header) -> Result<([u64; 3], usize, usize)> {
    let rank = header.dim[0];
    if !(1..=7).contains(&rank) {
        return Err(Error::format(NAME, format!("{rank} dimensions"), "1 to 7", "the header is damaged"));
    }
    let rank = rank as usize;
    let mut dims = [1u64; 7];
    for axis in 0..rank {
        let size = header.dim[axis + 1];
        let sound = u64::try_from(size).ok().filter(|&n| n > 0);
        dims[axis] = sound.ok_or_else(|| {
            let found = format!("size {size} of dimension {}", axis + 1);
            Error::format(NAME, found, "1 or more", "correct the header")
        })?;
    }
    let [x, y, z, times, components, sixth, seventh] = dims;
    // More names of components than any file has would take memory.
    if sixth > 1 || seventh > 1 || components > 1 << 16 {
        return Err(Error::format(
            NAME,
            format!("seven dimensions: {dims:?}"),
            "three of space, one of time, one of up to 65536 components",
            "cut out a part, for example with nibabel: img.slicer[..., 0, 0]",
        ));
    }
    Ok(([x, y, z], usize::try_from(times).unwrap_or(usize::MAX), components as usize))
}

fn sample_type(code: i16) -> Result<Type> {
    let name = match code {
        2 => return Ok(Type::U8),
        4 => return Ok(Type::I16),
        8 => return Ok(Type::I32),
        16 => return Ok(Type::F32),
        64 => return Ok(Type::F64),
        256 => return Ok(Type::I8),
        512 => return Ok(Type::U16),
        768 => return Ok(Type::U32),
        1024 => return Ok(Type::I64),
        1280 => return Ok(Type::U64),
        1 => "binary",
        32 | 1792 | 2048 => "complex",
        128 | 2304 => "RGB",
        1536 => "128-bit floating point",
        _ => "unknown",
    };
    Err(Error::format(
        NAME,
        format!("samples of {name} type (datatype {code})"),
        "one integer or real number for each voxel",
        "convert the file to int16 or float32",
    ))
}

/// The affine, and whether a transform of the header gives it: without one the axes have no anatomical meaning.
fn world(header: &Header, notes: &mut Vec<Note>) -> Result<(Affine, bool)> {
    if header.sform_code > 0 {
        let rows = header.srow;
        let linear = DMat3::from_cols_array_2d(&rows.map(|[x, y, z, _]| [x, y, z])).transpose();
        let offset = DVec3::from_array(rows.map(|r| r[3]));
        if let Some(affine) = Affine::new(linear, offset) {
            return Ok((affine, true));
        }
        notes.push(note("the sform is not invertible and was ignored", 1));
    }
    let mut spacing = DVec3::from_slice(&header.pixdim[1..4]).abs();
    for axis in 0..3 {
        if !(spacing[axis].is_finite() && spacing[axis] > 0.0) {
            notes.push(note(format!("pixdim {} is {}, 1 is used", axis + 1, header.pixdim[axis + 1]), 1));
            spacing[axis] = 1.0;
        }
    }
    let scale = DMat3::from_diagonal(spacing);
    if header.qform_code > 0 {
        let offset = DVec3::from_array(header.qoffset);
        let mirror = if header.pixdim[0] < 0.0 { -1.0 } else { 1.0 };
        let rotation = rotation(DVec3::from_array(header.quatern_bcd));
        let mirrored = DMat3::from_diagonal(DVec3::new(1.0, 1.0, mirror));
        return Ok((affine(NAME, rotation * mirrored * scale, offset)?, true));
    }
    Ok((affine(NAME, scale, DVec3::ZERO)?, false))
}

/// The rotation of a unit quaternion of which only b, c, d are stored (nifti1.h, method 2):
/// a = sqrt(1 − b² − c² − d²), and a half turn about (b, c, d) where rounding makes that negative.
fn rotation(bcd: DVec3) -> DMat3 {
    let square = bcd.length_squared();
    let (a, bcd) = if square < 1.0 { ((1.0 - square).sqrt(), bcd) } else { (0.0, bcd / square.sqrt()) };
    let (b, c, d) = (bcd.x, bcd.y, bcd.z);
    DMat3::from_cols(
        DVec3::new(a * a + b * b - c * c - d * d, 2.0 * (b * c + a * d), 2.0 * (b * d - a * c)),
        DVec3::new(2.0 * (b * c - a * d), a * a + c * c - b * b - d * d, 2.0 * (c * d + a * b)),
        DVec3::new(2.0 * (b * d + a * c), 2.0 * (c * d - a * b), a * a + d * d - b * b - c * c),
    )
}
