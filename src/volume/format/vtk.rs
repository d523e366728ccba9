//! Legacy VTK files with STRUCTURED_POINTS ("VTK File Formats", the VTK book), by hand: vtkio
//! panics or fails on ordinary files. BINARY samples are big-endian. World: spacing and origin as
//! written, unit unknown.

#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

use super::super::assemble::{Parts, assemble, note};
use super::super::decode::{self, Data, Endian, Type, checked_count};
use super::super::read::ReadHint;
use super::super::source::Source;
use super::super::{LengthUnit, Series, Volume};
use super::affine;
use crate::error::{Error, Result};
use glam::{DMat3, DVec3};

const NAME: &str = "legacy VTK";
/// Stands for the samples of COLOR_SCALARS, which have no type name.
const COLOUR: &str = "colour";
/// More lines before the samples than any file has.
const MOST_LINES: usize = 1000;

fn damaged(line: &str, expected: &str) -> Error {
    Error::format(NAME, format!("the line {line:?}"), expected.to_owned(), "the header is damaged or not supported")
}

fn three<T: std::str::FromStr>(line: &str) -> Result<[T; 3]> {
    let numbers: Option<Vec<T>> = line.split_whitespace().skip(1).map(|w| w.parse().ok()).collect();
    numbers.and_then(|n| <[T; 3]>::try_from(n).ok()).ok_or_else(|| damaged(line, "three numbers"))
}

pub(crate) fn read(mut source: Source, hint: &ReadHint) -> Result<Volume> {
    source.expect_line(NAME, "the version line")?;
    source.expect_line(NAME, "the title")?;
    let mut encoding = source.expect_line(NAME, "ASCII or BINARY")?;
    if encoding.trim().is_empty() {
        encoding = source.expect_line(NAME, "ASCII or BINARY")?; // files of VTK 1 have an empty line here
    }
    let binary = match encoding.trim().to_ascii_uppercase().as_str() {
        "BINARY" => true,
        "ASCII" => false,
        _ => return Err(damaged(&encoding, "ASCII or BINARY")),
    };
    let mut notes = Vec::new();
    let mut dims: Option<[u64; 3]> = None;
    let (mut spacing, mut origin) = ([1.0f64; 3], [0.0f64; 3]);
    let mut points = None;
    let mut type_name = None;
    for _ in 0..MOST_LINES {
        let line = source.expect_line(NAME, "SCALARS and the samples")?;
        let mut words = line.split_whitespace();
        let Some(keyword) = words.next() else { continue };
        match keyword.to_ascii_uppercase().as_str() {
            "DATASET" => match words.next().unwrap_or("").to_ascii_uppercase().as_str() {
                "STRUCTURED_POINTS" => {}
                other => return Err(not_supported(&format!("DATASET {other}"))),
            },
            "DIMENSIONS" => dims = Some(three(&line)?),
            "SPACING" | "ASPECT_RATIO" => spacing = three(&line)?,
            "ORIGIN" => origin = three(&line)?,
            "POINT_DATA" => {
                let count = words.next().and_then(|w| w.parse::<u64>().ok());
                points = Some(count.ok_or_else(|| damaged(&line, "POINT_DATA and a count"))?);
            }
            "SCALARS" if points.is_some() => {
                let (_, kind) = (words.next(), words.next().unwrap_or("").to_ascii_lowercase());
                let components = words.next().map_or(Some(1), |w| w.parse::<u32>().ok());
                if components != Some(1) {
                    return Err(not_supported(&format!("{components:?} components for each point")));
                }
                type_name = Some(kind);
                break;
            }
            // VTK's own writer uses this for unsigned char: bytes, or as text fractions of 255.
            "COLOR_SCALARS" if points.is_some() => {
                let components = words.nth(1);
                if components != Some("1") {
                    return Err(not_supported(&format!("{} components for each point", components.unwrap_or("no"))));
                }
                type_name = Some(COLOUR.to_string());
                break;
            }
            _ => return Err(not_supported(keyword)),
        }
    }
    let type_name = type_name.ok_or_else(|| damaged("…", "SCALARS after POINT_DATA"))?;
    let dims = dims.ok_or_else(|| damaged(&format!("SCALARS … {type_name}"), "DIMENSIONS before it"))?;
    // The standard asks for this line, some writers omit it.
    let next = source.peek(12).map_err(|e| Error::from_read(NAME, "samples", e))?;
    if next.eq_ignore_ascii_case(b"LOOKUP_TABLE") {
        source.expect_line(NAME, "LOOKUP_TABLE")?;
    }
    let kind = sample_type(&type_name)?;
    if matches!(type_name.as_str(), "long" | "unsigned_long") && binary {
        notes.push(note(format!("{type_name} samples are taken as 8 bytes each"), 1));
    }
    // As text, each sample takes a digit and a separator.
    let size = kind.size() as u64;
    let left = source.at_most().map(|n| if binary { n } else { (n.saturating_add(1) / 2).saturating_mul(size) });
    let count = checked_count(NAME, dims, kind.size(), left, hint)?;
    if points != Some(count as u64) {
        return Err(Error::format(
            NAME,
            format!("POINT_DATA {}", points.unwrap_or(0)),
            format!("{count}, the product of the DIMENSIONS"),
            "correct the header",
        ));
    }
    let data = if binary {
        decode::binary(&mut source, NAME, kind, Endian::Big, count)?
    } else if type_name == COLOUR {
        let Data::F32(fractions) = decode::text(&mut source, NAME, Type::F32, count)? else {
            return Err(damaged("COLOR_SCALARS", "numbers")); // not reached: F32 gives F32
        };
        Data::U8(fractions.iter().map(|f| (255.0 * f).round() as u8).collect())
    } else {
        decode::text(&mut source, NAME, kind, count)?
    };
    source.verify_end(NAME)?;
    let world_from_grid = affine(NAME, DMat3::from_diagonal(DVec3::from_array(spacing)), DVec3::from_array(origin))?;
    let (dims, unit) = (dims.map(|d| d as usize), LengthUnit::Unknown);
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

fn not_supported(found: &str) -> Error {
    Error::format(
        NAME,
        found.to_owned(),
        "DATASET STRUCTURED_POINTS with POINT_DATA and SCALARS of one component first",
        "resample to an image with one scalar array, for example with ParaView",
    )
}

fn sample_type(name: &str) -> Result<Type> {
    Ok(match name {
        "unsigned_char" | "vtktypeuint8" | COLOUR => Type::U8,
        "char" | "signed_char" | "vtktypeint8" => Type::I8,
        "unsigned_short" | "vtktypeuint16" => Type::U16,
        "short" | "vtktypeint16" => Type::I16,
        "unsigned_int" | "vtktypeuint32" => Type::U32,
        "int" | "vtktypeint32" => Type::I32,
        "unsigned_long" | "vtktypeuint64" => Type::U64,
        "long" | "vtktypeint64" | "vtkidtype" => Type::I64,
        "float" | "vtktypefloat32" => Type::F32,
        "double" | "vtktypefloat64" => Type::F64,
        other => return Err(not_supported(&format!("samples of type {other:?}"))),
    })
}
