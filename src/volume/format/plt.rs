//! gOpenMol's grids (.plt), by hand. Format: the gOpenMol manual, "plot file (plt) format": the rank, 3; the kind of surface;
//! points along z, y, x; least and largest coordinate along z, y, x; then 32-bit floats, x fastest. All in one byte order,
//! which the rank shows.
//!
//! World: in ångström. The manual does not say whether the coordinates are those of samples or of the borders of their cells;
//! its example (65 points from -33 to 32) and GridDataFormats, whose counts of particles are such files, mean borders. So a
//! step is the span over the number of points, and the first sample lies half a step inside. A note says so.

#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

use super::super::assemble::{Parts, assemble, note};
use super::super::decode::{self, Endian, Type, checked_count};
use super::super::read::ReadHint;
use super::super::source::Source;
use super::super::{LengthUnit, Series, Volume};
use super::{ANGSTROM, affine};
use crate::error::{Error, Result};
use glam::{DMat3, DVec3};

const NAME: &str = "gOpenMol plt";
const HEADER: usize = 44;
/// Kinds of surface have small numbers; more points along an axis has no grid.
const MOST_KIND: u32 = 1000;
const MOST_POINTS: u32 = 1 << 20;

/// The header of a file; `None` where the bytes are not one.
struct Header {
    endian: Endian,
    dims: [u32; 3],
    first: DVec3,
    last: DVec3,
}

impl Header {
    fn parse(head: &[u8]) -> Option<Self> {
        let endian = match head.first_chunk::<4>()? {
            [3, 0, 0, 0] => Endian::Little,
            [0, 0, 0, 3] => Endian::Big,
            _ => return None,
        };
        let word = |i: usize| {
            let bytes = head.get(4 * i..)?.first_chunk::<4>()?;
            Some(if endian == Endian::Little { u32::from_le_bytes(*bytes) } else { u32::from_be_bytes(*bytes) })
        };
        let float = |i: usize| word(i).map(|bits| f64::from(f32::from_bits(bits)));
        // z, y, x in the file.
        let dims = [word(4)?, word(3)?, word(2)?];
        let first = DVec3::new(float(9)?, float(7)?, float(5)?);
        let last = DVec3::new(float(10)?, float(8)?, float(6)?);
        let is_one = word(1)? <= MOST_KIND && dims.iter().all(|n| (1..=MOST_POINTS).contains(n));
        (is_one && first.is_finite() && last.is_finite()).then_some(Self { endian, dims, first, last })
    }
}

/// Whether the first bytes are such a header: it has no magic but its rank.
pub(crate) fn is_plt(head: &[u8]) -> bool {
    Header::parse(head).is_some()
}

pub(crate) fn read(mut source: Source, hint: &ReadHint) -> Result<Volume> {
    let bytes = source.array::<HEADER>(NAME, "header")?;
    let refuse = || Error::format(NAME, "a damaged header", "rank 3 and numbers of points", "copy the file again");
    let Header { endian, dims, first, last } = Header::parse(&bytes).ok_or_else(refuse)?;
    let count = checked_count(NAME, dims.map(u64::from), 4, source.at_most(), hint)?;
    let data = decode::binary(&mut source, NAME, Type::F32, endian, count)?;
    source.verify_end(NAME)?;
    let mut notes = Vec::new();
    if source.peek(1).is_ok_and(|rest| !rest.is_empty()) {
        notes.push(note("the file goes on after the last sample; check the numbers of points", 1));
    }
    notes.push(note("the span of .plt is taken as that of cells, with samples at their centres; see --spacing", 1));
    let spacing = (last - first) / DVec3::from_array(dims.map(f64::from));
    let world_from_grid = affine(NAME, DMat3::from_diagonal(spacing), first + 0.5 * spacing)?;
    let dims = dims.map(|n| n as usize);
    let (slope, inter, unit, series) = (1.0, 0.0, LengthUnit::Metres(ANGSTROM), Series::default());
    assemble(Parts { format: NAME, dims, data, slope, inter, world_from_grid, unit, series, notes }, hint)
}
