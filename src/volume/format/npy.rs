//! NumPy .npy arrays; the header is parsed by the `npyz` crate. The array is indexed [z, y, x],
//! whichever order it has in memory (C order: x fastest; Fortran order: z fastest). There is no
//! spacing: world = grid, unit unknown.

use super::super::assemble::{Parts, assemble};
use super::super::decode::{self, Endian, Type, checked_count};
use super::super::mapped::Stored;
use super::super::read::ReadHint;
use super::super::source::Source;
use super::super::{LengthUnit, Series, Volume};
use crate::error::{Error, Result};
use crate::geom::Affine;
use npyz::{DType, Endianness, NpyHeader, Order, TypeChar};

const NAME: &str = "NumPy";
/// Real headers take 64 to 192 bytes.
const LONGEST_HEADER: usize = 64 * 1024;
/// The header's parser is recursive: deeper nesting than any plain array has is refused first.
const MOST_BRACKETS: usize = 64;

/// The samples, x fastest, and how many along x, y, z.
pub(super) fn array(source: &mut Source, hint: &ReadHint) -> Result<(Stored, [usize; 3])> {
    let header = header(source)?;
    let (kind, endian) = sample_type(&header.dtype())?;
    let shape: Vec<u64> = header.shape().to_vec();
    let extra = shape.len().saturating_sub(3);
    let (Ok(file), true) = (<[u64; 3]>::try_from(&shape[extra..]), shape[..extra].iter().all(|&n| n == 1)) else {
        return Err(Error::format(
            NAME,
            format!("an array of shape {shape:?}"),
            "three axes [z, y, x]",
            "save one volume, for example numpy.save(name, array[0])",
        ));
    };
    let count = checked_count(NAME, file, kind.size(), source.at_most(), hint)?;
    let data = Stored::binary(source, NAME, kind, endian, count)?;
    let [z, y, x] = file.map(|n| n as usize);
    match header.order() {
        Order::C => Ok((data, [x, y, z])),
        Order::Fortran => data.permute([z, y, x], [2, 1, 0], NAME),
    }
}

/// How many axes an array has that are longer than 1, at least the last three of those that it has.
pub(super) fn rank(source: &mut Source) -> Result<usize> {
    let shape = header(source)?.shape().to_vec();
    let ones = shape.iter().take(shape.len().saturating_sub(3)).take_while(|n| **n == 1).count();
    Ok(shape.len() - ones)
}

/// More numbers than an affine has are none of ours.
const MOST_NUMBERS: u64 = 64;

/// The few numbers of a small array, in C order.
pub(super) fn numbers(source: &mut Source) -> Result<Vec<f64>> {
    let header = header(source)?;
    let (kind, endian) = sample_type(&header.dtype())?;
    let count = header.shape().iter().try_fold(1u64, |n, &d| n.checked_mul(d)).filter(|&n| n <= MOST_NUMBERS);
    let (Some(count), Order::C) = (count, header.order()) else {
        let found = format!("an array of shape {:?}", header.shape());
        return Err(Error::format(NAME, found, "a few numbers in C order", "save spacing and affine as small arrays"));
    };
    Ok(decode::binary(source, NAME, kind, endian, count as usize)?.numbers())
}

/// A word: an array of one string.
pub(super) fn word(source: &mut Source) -> Result<String> {
    let header = header(source)?;
    let refuse =
        || Error::format(NAME, "a unit that is no text", "a word such as \"mm\"", "save it with numpy.array(\"mm\")");
    let DType::Plain(plain) = header.dtype() else { return Err(refuse()) };
    let length = plain.size_field();
    if plain.type_char() != TypeChar::UnicodeStr || length > MOST_NUMBERS || header.shape().iter().any(|&n| n != 1) {
        return Err(refuse());
    }
    let endian = if plain.endianness() == Endianness::Big { Endian::Big } else { Endian::Little };
    let codes = decode::binary(source, NAME, Type::U32, endian, length as usize)?.numbers();
    let text: Option<String> = codes.iter().map(|c| char::from_u32(*c as u32)).collect();
    text.map(|text| text.trim_end_matches('\0').to_string()).ok_or_else(refuse)
}

pub(crate) fn read(mut source: Source, hint: &ReadHint) -> Result<Volume> {
    let (data, dims) = array(&mut source, hint)?;
    source.verify_end(NAME)?;
    let (world_from_grid, unit, notes) = (Affine::IDENTITY, LengthUnit::Unknown, Vec::new());
    assemble(
        Parts {
            format: NAME,
            dims,
            data,
            slope: 1.0,
            inter: 0.0,
            world_from_grid,
            unit,
            series: Series::default(),
            notes,
        },
        hint,
    )
}

fn header(source: &mut Source) -> Result<NpyHeader> {
    let damaged = |found: String| {
        Error::format(NAME, found, "the header of a plain array", "save the array again with numpy.save")
    };
    let mut bytes = source.array::<8>(NAME, "magic and version")?.to_vec();
    let length = match bytes[6] {
        1 => {
            let length = source.array::<2>(NAME, "header length")?;
            bytes.extend(length);
            usize::from(u16::from_le_bytes(length))
        }
        2 | 3 => {
            let length = source.array::<4>(NAME, "header length")?;
            bytes.extend(length);
            u32::from_le_bytes(length) as usize
        }
        other => return Err(damaged(format!("version {other}"))),
    };
    if length > LONGEST_HEADER {
        return Err(damaged(format!("a header of {length} bytes")));
    }
    let start = bytes.len();
    bytes.resize(start + length, 0);
    std::io::Read::read_exact(source, &mut bytes[start..]).map_err(|e| Error::from_read(NAME, "the header", e))?;
    if bytes[start..].iter().filter(|b| matches!(b, b'(' | b'[' | b'{')).count() > MOST_BRACKETS {
        return Err(damaged("a header with deeply nested types".into()));
    }
    NpyHeader::from_reader(&bytes[..]).map_err(|e| damaged(format!("a header that cannot be read ({e})")))
}

fn sample_type(dtype: &DType) -> Result<(Type, Endian)> {
    let refuse = |name: String| {
        Err(Error::format(
            NAME,
            format!("samples of {name} type"),
            "integers of 8 to 64 bits or floats of 16 to 64",
            "convert the array, for example array.astype('float32')",
        ))
    };
    let DType::Plain(plain) = dtype else { return refuse("structured".into()) };
    let kind = match (plain.type_char(), plain.size_field()) {
        (TypeChar::Uint, 1) => Type::U8,
        (TypeChar::Int, 1) => Type::I8,
        (TypeChar::Uint, 2) => Type::U16,
        (TypeChar::Int, 2) => Type::I16,
        (TypeChar::Uint, 4) => Type::U32,
        (TypeChar::Int, 4) => Type::I32,
        (TypeChar::Uint, 8) => Type::U64,
        (TypeChar::Int, 8) => Type::I64,
        (TypeChar::Float, 2) => Type::F16,
        (TypeChar::Float, 4) => Type::F32,
        (TypeChar::Float, 8) => Type::F64,
        (TypeChar::Bool, _) => return refuse("bool".into()),
        (TypeChar::Complex, _) => return refuse("complex".into()),
        _ => return refuse(format!("{plain}")),
    };
    let endian = if plain.endianness() == Endianness::Big { Endian::Big } else { Endian::Little };
    Ok((kind, endian))
}
