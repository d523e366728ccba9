//! OpenDX grids (.dx), as APBS, VMD and PyMOL exchange them, by hand. Format: the OpenDX user's guide, appendix B. Regular
//! positions with any three steps, then an array of one number each, z fastest: text, or binary in a stated byte order. As
//! many numbers as connections lie at the centres of cells.
//!
//! World: as written; the unit is ångström by the habit of those programs.

#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

use super::super::assemble::{Parts, assemble, note, permute};
use super::super::decode::{self, Endian, Type, checked_count, fortran_number};
use super::super::read::ReadHint;
use super::super::source::Source;
use super::super::{LengthUnit, Series, Volume};
use super::{ANGSTROM, affine};
use crate::error::{Error, Result};
use glam::{DMat3, DVec3};

const NAME: &str = "OpenDX";
/// More lines before the samples than any file has.
const MOST_LINES: usize = 10_000;

/// Whether the first line that is no comment starts an object.
pub(crate) fn is_dx(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(head);
    let mut lines = text.trim_start_matches('\u{feff}').lines().map(str::trim);
    let line = lines.find(|line| !line.is_empty() && !line.starts_with('#')).unwrap_or("");
    line.split_whitespace().next().is_some_and(|word| word.eq_ignore_ascii_case("object"))
}

fn damaged(found: impl Into<String>, expected: &str) -> Error {
    Error::format(
        NAME,
        found,
        expected,
        "the file is damaged, or not a grid as APBS writes it; convert it, for example with gridData",
    )
}

/// What the header says.
#[derive(Default)]
struct Header {
    class: String,
    counts: Option<[u64; 3]>,
    origin: DVec3,
    steps: Vec<DVec3>,
    kind: Option<Type>,
    items: u64,
    rank: u64,
    shape: u64,
    endian: Option<Endian>,
    is_binary: bool,
}

impl Header {
    /// Reads up to the samples.
    fn parse(source: &mut Source) -> Result<Self> {
        let mut header = Self { shape: 1, ..Self::default() };
        for _ in 0..MOST_LINES {
            let line = source.expect_line(NAME, "data follows")?;
            let line = line.trim_start_matches('\u{feff}');
            let line = line.split('#').next().unwrap_or("");
            if header.take(line)? {
                return Ok(header);
            }
        }
        Err(damaged("a header without end", "data follows"))
    }

    /// Takes a line; true when the samples follow it.
    fn take(&mut self, line: &str) -> Result<bool> {
        let mut words = line.split_whitespace();
        let broken = || damaged(format!("the line {line:?}"), "keywords of a regular grid and their numbers");
        while let Some(word) = words.next() {
            let mut next = || words.next().ok_or_else(broken);
            match word.to_ascii_lowercase().as_str() {
                "object" => {
                    // A name in quotes may have spaces.
                    let name = next()?;
                    let is_open = |word: &str| word.matches('"').count() == 1;
                    if is_open(name) {
                        while !is_open(next()?) {}
                    }
                    self.class.clear();
                }
                "class" => self.class = next()?.to_ascii_lowercase(),
                "counts" => {
                    let mut count = || next()?.parse::<u64>().map_err(|_| broken());
                    let counts = [count()?, count()?, count()?];
                    match self.counts {
                        Some(positions) if self.class == "gridconnections" && positions != counts => {
                            return Err(damaged(
                                format!("connections of {counts:?} points"),
                                "as many as there are positions",
                            ));
                        }
                        Some(_) => {}
                        None => self.counts = Some(counts),
                    }
                }
                keyword @ ("origin" | "delta") => {
                    let mut number = || fortran_number(next()?).ok_or_else(broken);
                    let vector = DVec3::new(number()?, number()?, number()?);
                    if keyword == "origin" { self.origin = vector } else { self.steps.push(vector) }
                }
                "type" => {
                    let first = next()?;
                    let name = if matches!(first, "unsigned" | "signed") {
                        format!("{first} {}", next()?)
                    } else {
                        first.into()
                    };
                    // gridData writes it in quotes.
                    self.kind = Some(sample_type(name.trim_matches('"'))?);
                }
                keyword @ ("rank" | "shape" | "items") => {
                    let number = next()?.parse().map_err(|_| broken())?;
                    match keyword {
                        "rank" => self.rank = number,
                        "shape" => self.shape = number,
                        _ => self.items = number,
                    }
                }
                "lsb" => self.endian = Some(Endian::Little),
                "msb" => self.endian = Some(Endian::Big),
                "ieee" | "binary" => self.is_binary = true,
                "xdr" => return Err(damaged("samples in xdr", "text, or lsb or msb ieee")),
                "data" => match next()?.to_ascii_lowercase().as_str() {
                    "follows" => return Ok(true),
                    "mode" => {}
                    other => return Err(damaged(format!("data {other}"), "data follows, in the same file")),
                },
                "attribute" | "component" | "field" | "end" => break,
                _ => {}
            }
        }
        Ok(false)
    }
}

fn sample_type(name: &str) -> Result<Type> {
    Ok(match name.to_ascii_lowercase().as_str() {
        "double" => Type::F64,
        "float" => Type::F32,
        "int" | "signed int" => Type::I32,
        "uint" | "unsigned int" => Type::U32,
        "short" | "signed short" => Type::I16,
        "ushort" | "unsigned short" => Type::U16,
        "byte" | "ubyte" | "unsigned byte" => Type::U8,
        "signed byte" => Type::I8,
        other => return Err(damaged(format!("samples of type {other}"), "double, float, int, short or byte")),
    })
}

pub(crate) fn read(mut source: Source, hint: &ReadHint) -> Result<Volume> {
    let header = Header::parse(&mut source)?;
    let Some(counts) = header.counts else { return Err(damaged("samples before positions", "gridpositions first")) };
    let &[x, y, z] = header.steps.as_slice() else {
        return Err(damaged(format!("{} steps", header.steps.len()), "three lines of delta"));
    };
    if header.rank != 0 && header.shape != 1 {
        let found = format!("samples of rank {} and shape {}", header.rank, header.shape);
        return Err(damaged(found, "one number for each position"));
    }
    let product = |counts: [u64; 3]| counts.iter().try_fold(1u64, |n, &c| n.checked_mul(c));
    let cells = counts.map(|n| n.saturating_sub(1).max(1));
    let of_cells = product(counts) != Some(header.items) && product(cells) == Some(header.items);
    let dims = if of_cells { cells } else { counts };
    if product(dims) != Some(header.items) {
        let found = format!("{} items for {counts:?} positions", header.items);
        return Err(damaged(found, "one for each position, or each cell between them"));
    }
    let kind = header.kind.ok_or_else(|| damaged("an array without a type", "type double or float"))?;
    let mut notes = vec![note("OpenDX names no unit: Å, as APBS and VMD have it; see --spacing", 1)];
    let data = if header.is_binary {
        let count = checked_count(NAME, dims, kind.size(), source.at_most(), hint)?;
        let endian = match header.endian {
            Some(endian) => endian,
            None if kind.size() == 1 => Endian::Little,
            None => return Err(damaged("binary samples without a byte order", "lsb or msb before ieee")),
        };
        decode::binary(&mut source, NAME, kind, endian, count)?
    } else {
        // As text, each sample takes a digit and a separator.
        let left = source.at_most().map(|n| (n.saturating_add(1) / 2).saturating_mul(kind.size() as u64));
        let count = checked_count(NAME, dims, kind.size(), left, hint)?;
        let data = decode::text(&mut source, NAME, kind, count)?;
        let mut after = Vec::new();
        if source.token(NAME, &mut after)? && std::str::from_utf8(&after).is_ok_and(|w| fortran_number(w).is_some()) {
            let expected = "as many as there are items";
            return Err(damaged(format!("more numbers after the last of {count} values"), expected));
        }
        data
    };
    source.verify_end(NAME)?;
    let linear = DMat3::from_cols(x, y, z);
    let mut inside = DVec3::ZERO;
    if of_cells {
        inside = DVec3::from_array(counts.map(|n| if n > 1 { 0.5 } else { 0.0 }));
        notes.push(note("as many values as cells: they lie at their centres", 1));
    }
    let world_from_grid = affine(NAME, linear, header.origin + linear * inside)?;
    let [nx, ny, nz] = dims.map(|n| n as usize);
    let (data, dims) = permute(data, [nz, ny, nx], [2, 1, 0]);
    let (slope, inter, unit, series) = (1.0, 0.0, LengthUnit::Metres(ANGSTROM), Series::default());
    assemble(Parts { format: NAME, dims, data, slope, inter, world_from_grid, unit, series, notes }, hint)
}
