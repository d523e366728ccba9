//! MRC and CCP4 maps (MRC2014, www.ccpem.ac.uk/mrc_format/mrc2014.php), by hand: the `mrc` crate
//! ignores MAPC/MAPR/MAPS, so that permuted maps come out transposed, takes the byte order from
//! the machine stamp alone, which old files leave empty, and reads a whole file before it looks.
//!
//! World: ångström; cell vector a along +x, b in the xy plane. A sample with crystallographic
//! indices (u, v, w), counted from NXSTART and its like, sits at u/MX a + v/MY b + w/MZ c. The
//! ORIGIN words, where any is not 0, replace the start indices, as in UCSF Chimera: the two are
//! alternative ways to say the same.

use super::super::assemble::{Parts, assemble, note};
use super::super::decode::{Endian, Type, checked_count};
use super::super::mapped::Stored;
use super::super::read::ReadHint;
use super::super::source::Source;
use super::super::{LengthUnit, Note, Series, Volume};
use super::{ANGSTROM, affine};
use crate::error::{Error, Result};
use crate::geom::Affine;
use glam::{DMat3, DVec3};

const NAME: &str = "MRC";
const HEADER: usize = 1024;
/// Marks a file of IMOD, which says in bit 0 of the next word whether bytes are signed.
const IMOD_STAMP: i32 = 1_146_047_817;

/// The header as numbered words, 0-based, in one byte order.
struct Words<'a> {
    bytes: &'a [u8],
    endian: Endian,
}

impl Words<'_> {
    fn integer(&self, index: usize) -> i32 {
        let word = self.bytes[4 * index..].first_chunk::<4>().copied().unwrap_or_default();
        match self.endian {
            Endian::Little => i32::from_le_bytes(word),
            Endian::Big => i32::from_be_bytes(word),
        }
    }

    fn real(&self, index: usize) -> f64 {
        f64::from(f32::from_bits(self.integer(index) as u32))
    }

    fn integers(&self, index: usize) -> [i32; 3] {
        [0, 1, 2].map(|i| self.integer(index + i))
    }

    fn reals(&self, index: usize) -> DVec3 {
        DVec3::from_array([0, 1, 2].map(|i| self.real(index + i)))
    }

    /// Whether dimensions and mode make sense in this byte order.
    fn plausible(&self) -> bool {
        self.integers(0).iter().all(|n| (0..1 << 24).contains(n)) && (0..=127).contains(&self.integer(3))
    }

    /// The axis (0 x, 1 y, 2 z) of columns, rows and sections.
    fn axes(&self) -> Option<[usize; 3]> {
        let map = self.integers(16);
        let mut sorted = map;
        sorted.sort_unstable();
        (sorted == [1, 2, 3]).then(|| map.map(|a| a as usize - 1))
    }
}

/// The header in the byte order in which it makes sense; the machine stamp breaks a tie.
fn words(bytes: &[u8]) -> Option<Words<'_>> {
    let by_stamp = if bytes[212] == 0x11 { Endian::Big } else { Endian::Little };
    let other = if by_stamp == Endian::Big { Endian::Little } else { Endian::Big };
    [by_stamp, other].into_iter().map(|endian| Words { bytes, endian }).find(Words::plausible)
}

/// Whether the first bytes are an MRC header: its "MAP " word, or for files older than that a
/// sensible mode, dimensions, and axis order.
pub(crate) fn is_mrc(head: &[u8]) -> bool {
    if head.get(208..211) == Some(b"MAP") {
        return true;
    }
    head.len() >= HEADER
        && words(head).is_some_and(|w| {
            w.axes().is_some() && w.integers(0).iter().all(|&n| n > 0) && matches!(w.integer(3), 0 | 1 | 2 | 6)
        })
}

pub(crate) fn read(mut source: Source, hint: &ReadHint) -> Result<Volume> {
    let bytes: [u8; HEADER] = source.array(NAME, "header")?;
    let words = words(&bytes).ok_or_else(|| {
        Error::format(
            NAME,
            "dimensions or a mode that make no sense in either byte order",
            "dimensions below 2^24 and a mode from 0 to 127",
            "the header is damaged; copy or download the file again",
        )
    })?;
    let mut notes = Vec::new();
    let axes = words.axes().unwrap_or_else(|| {
        notes.push(note(format!("the axis order {:?} is none, 1, 2, 3 is used", words.integers(16)), 1));
        [0, 1, 2]
    });
    let (kind, endian) = (sample_type(&words, &mut notes)?, words.endian);
    let mut file_dims = words.integers(0);
    let intervals = words.integers(7);
    let space_group = words.integer(22);
    if space_group >= 401 && intervals[2] > 0 && file_dims[2] > intervals[2] {
        let volumes = file_dims[2] / intervals[2];
        notes.push(note(format!("the file has {volumes} volumes, the first is read"), volumes as usize));
        file_dims[2] = intervals[2];
    }
    let extended = words.integer(23);
    if extended < 0 {
        return Err(Error::format(
            NAME,
            format!("an extended header of {extended} bytes"),
            "a length of 0 or more",
            "correct the header",
        ));
    }
    source.skip(NAME, extended as u64, "extended header")?;
    // Not negative: `plausible` saw to it.
    let count = checked_count(NAME, file_dims.map(|d| d as u64), kind.size(), source.at_most(), hint)?;
    let data = Stored::binary(&mut source, NAME, kind, endian, count)?;
    if space_group < 401 {
        source.verify_end(NAME)?;
    }
    let file_dims = file_dims.map(|d| d as usize);
    let (world_from_grid, unit) = world(&words, axes, file_dims, &mut notes)?;
    let (data, dims) = data.permute(file_dims, axes, NAME)?;
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

fn sample_type(words: &Words, notes: &mut Vec<Note>) -> Result<Type> {
    let name = match words.integer(3) {
        0 => {
            let imod = words.integer(38) == IMOD_STAMP;
            if imod && words.integer(39) & 1 == 0 {
                notes.push(note("mode 0 bytes are unsigned, as this file of IMOD says", 1));
                return Ok(Type::U8);
            }
            let why = if imod { "this file of IMOD" } else { "MRC2014" };
            notes.push(note(format!("mode 0 bytes are signed, as {why} says"), 1));
            return Ok(Type::I8);
        }
        1 => return Ok(Type::I16),
        2 => return Ok(Type::F32),
        6 => return Ok(Type::U16),
        12 => return Ok(Type::F16),
        3 => "complex int16",
        4 => "complex float32",
        16 => "RGB",
        101 => "4-bit",
        _ => "unknown",
    };
    Err(Error::format(
        NAME,
        format!("samples of {name} type (mode {})", words.integer(3)),
        "mode 0, 1, 2, 6 or 12: one integer or real number for each voxel",
        "convert the map to mode 2",
    ))
}

fn world(
    words: &Words,
    axes: [usize; 3],
    file_dims: [usize; 3],
    notes: &mut Vec<Note>,
) -> Result<(Affine, LengthUnit)> {
    let (cell, angles) = (words.reals(10), words.reals(13));
    let mut intervals = DVec3::from_array(words.integers(7).map(f64::from));
    let mut unit = LengthUnit::Metres(ANGSTROM);
    let mut step = DMat3::IDENTITY;
    if cell.is_finite() && cell.min_element() > 0.0 {
        for f in 0..3 {
            if intervals[axes[f]] <= 0.0 {
                notes.push(note("the number of intervals along a cell axis is missing, that of samples is used", 1));
                intervals[axes[f]] = file_dims[f] as f64;
            }
        }
        let edges = cell_edges(cell, angles, notes)?;
        step = edges * DMat3::from_diagonal(1.0 / intervals);
    } else {
        notes.push(note("the cell has no size: spacing 1 in an unknown unit", 1));
        unit = LengthUnit::Unknown;
    }
    // Start indices are stored in the order of columns, rows, sections.
    let file_start = words.integers(4);
    let mut start = DVec3::ZERO;
    (0..3).for_each(|f| start[axes[f]] = f64::from(file_start[f]));
    let by_start = step * start;
    let origin = words.reals(49);
    let stated = origin.is_finite() && origin != DVec3::ZERO;
    if stated && start != DVec3::ZERO && (origin - by_start).length() > 1e-3 * by_start.length() {
        notes.push(note("ORIGIN and NXSTART disagree, ORIGIN is used", 1));
    }
    Ok((affine(NAME, step, if stated { origin } else { by_start })?, unit))
}

/// The cell vectors from their lengths and angles in degrees (α between b and c, β between a and
/// c, γ between a and b): International Tables B, section 3.3.1.
fn cell_edges(cell: DVec3, angles: DVec3, notes: &mut Vec<Note>) -> Result<DMat3> {
    if angles == DVec3::splat(90.0) {
        return Ok(DMat3::from_diagonal(cell));
    }
    if !(angles.is_finite() && angles.min_element() > 0.0 && angles.max_element() < 180.0) {
        notes.push(note(format!("the cell angles {angles} are none, 90° is used"), 1));
        return Ok(DMat3::from_diagonal(cell));
    }
    // Exact for right angles, so that orthogonal axes stay orthogonal.
    let cosine = |degrees: f64| if degrees == 90.0 { 0.0 } else { libm::cos(degrees.to_radians()) };
    let [cos_a, cos_b, cos_c] = [cosine(angles.x), cosine(angles.y), cosine(angles.z)];
    let sin_c = (1.0 - cos_c * cos_c).sqrt();
    let cy = (cos_a - cos_b * cos_c) / sin_c;
    let cz_squared = 1.0 - cos_b * cos_b - cy * cy;
    if cz_squared <= 0.0 {
        return Err(Error::format(
            NAME,
            format!("cell angles {angles}"),
            "angles that three vectors can make",
            "correct the header",
        ));
    }
    Ok(DMat3::from_cols(
        DVec3::new(cell.x, 0.0, 0.0),
        DVec3::new(cell.y * cos_c, cell.y * sin_c, 0.0),
        DVec3::new(cell.z * cos_b, cell.z * cy, cell.z * cz_squared.sqrt()),
    ))
}
