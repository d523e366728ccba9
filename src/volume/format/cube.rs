//! Gaussian cube files (gaussian.com/cubegen), by hand. Two comment lines; the number of atoms,
//! the origin, and perhaps the number of values at a point; for each axis a count and a step
//! vector; the atoms; the values, z fastest. A negative number of atoms announces a line of
//! orbital numbers, one value of a point for each.
//!
//! World: as written, in bohr; in ångström where the counts are negative.

#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

use super::super::assemble::{Parts, assemble, note, permute};
use super::super::decode::{self, Type, checked_count};
use super::super::read::ReadHint;
use super::super::source::Source;
use super::super::{LengthUnit, Series, Volume};
use super::{ANGSTROM, BOHR, affine};
use crate::error::{Error, Result};
use glam::{DMat3, DVec3};

const NAME: &str = "Gaussian cube";
/// More atoms or orbitals than this are taken for damage.
const MOST_ATOMS: u64 = 10_000_000;

/// A line of a count and a vector, and what follows.
fn count_and_vector(line: &str) -> Option<(i64, DVec3, Vec<&str>)> {
    let mut words = line.split_whitespace();
    let count = words.next()?.parse().ok()?;
    let mut vector = DVec3::ZERO;
    for axis in 0..3 {
        vector[axis] = decode::fortran_number(words.next()?)?;
    }
    Some((count, vector, words.collect()))
}

/// Whether lines three to six look like those of a cube file.
pub(crate) fn is_cube(head: &[u8]) -> bool {
    let text = String::from_utf8_lossy(head);
    let mut lines = text.lines().skip(2);
    let complete = text.matches('\n').count() >= 6;
    complete && (0..4).all(|_| lines.next().is_some_and(|line| count_and_vector(line).is_some()))
}

pub(crate) fn read(mut source: Source, hint: &ReadHint) -> Result<Volume> {
    let mut line = |what: &str| source.expect_line(NAME, what);
    line("a comment line")?;
    line("a comment line")?;
    let mut vector = |what: &str| -> Result<(i64, DVec3, Option<u64>)> {
        let text = line(what)?;
        count_and_vector(&text)
            .map(|(n, v, rest)| (n, v, rest.first().and_then(|w| w.parse().ok())))
            .ok_or_else(|| Error::format(NAME, format!("{text:?}"), what.to_owned(), "the header is damaged"))
    };
    let (atoms, origin, values_per_point) = vector("the number of atoms and the origin")?;
    let axes = [
        vector("the number of points and the step along x")?,
        vector("the number of points and the step along y")?,
        vector("the number of points and the step along z")?,
    ];
    if atoms.unsigned_abs() > MOST_ATOMS {
        return Err(Error::format(NAME, format!("{atoms} atoms"), "at most 10^7", "the header is damaged"));
    }
    for _ in 0..atoms.unsigned_abs() {
        line("the atoms")?;
    }
    let mut notes = Vec::new();
    let mut values = values_per_point.unwrap_or(1);
    if atoms < 0 {
        // The orbitals: their number, then as many numbers, over as many lines as they take.
        values = orbital(&mut source)?;
        for _ in 0..values {
            orbital(&mut source)?;
        }
    }
    if values == 0 {
        return Err(Error::format(NAME, "0 values at a point", "1 or more", "correct the header"));
    }
    let counts = axes.map(|a| a.0.unsigned_abs());
    // Text: a digit and a separator for each value at least.
    let left = source.at_most().map(|n| n.saturating_add(1) / 2);
    let all = counts[2].saturating_mul(values);
    let eight = left.map(|n| n.saturating_mul(8));
    let count = checked_count(NAME, [counts[0], counts[1], all], 8, eight, hint)?;
    let mut data = decode::text(&mut source, NAME, Type::F64, count)?;
    let mut after = Vec::new();
    if source.token(NAME, &mut after)? && std::str::from_utf8(&after).is_ok_and(|w| decode::fortran_number(w).is_some())
    {
        return Err(Error::format(
            NAME,
            format!("more numbers after the last of {count} values"),
            "as many values as the header says",
            "the numbers of atoms, points or values in the header are wrong: all values would be shifted",
        ));
    }
    source.verify_end(NAME)?;
    if values > 1 {
        notes.push(note(format!("{values} values at each point, the first is read"), values as usize));
        if let decode::Data::F64(all) = &mut data {
            *all = all.iter().copied().step_by(values as usize).collect();
        }
    }
    let linear = DMat3::from_cols(axes[0].1, axes[1].1, axes[2].1);
    let world_from_grid = affine(NAME, linear, origin)?;
    let unit = LengthUnit::Metres(if axes[0].0 < 0 { ANGSTROM } else { BOHR });
    let counts = counts.map(|n| n as usize);
    let (data, dims) = permute(data, [counts[2], counts[1], counts[0]], [2, 1, 0]);
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

/// A whole number of the list of orbitals.
fn orbital(source: &mut Source) -> Result<u64> {
    let mut token = Vec::new();
    let found = source.token(NAME, &mut token)?;
    let number = found.then(|| std::str::from_utf8(&token).ok()?.parse().ok()).flatten();
    number.filter(|&n| n <= MOST_ATOMS).ok_or_else(|| {
        Error::format(
            NAME,
            format!("{:?}", String::from_utf8_lossy(&token)),
            "the number of an orbital",
            "the header is damaged",
        )
    })
}
