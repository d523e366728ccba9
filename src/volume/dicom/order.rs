//! Slices in their order, by where they lie: copies dropped, times told apart, gaps found.

use super::super::Note;
use super::super::assemble::note;
use super::super::decode::Data;
use super::dataset::damaged;
use super::pixels::Format;
use super::{NAME, ReadFile, Slice};
use crate::error::{Error, Result};
use glam::DVec3;

/// Steps that differ by less, as a part of one, are the same: positions are written with few digits.
const SAME_STEP: f64 = 0.01;
/// Slices nearer than this, in millimetres, lie at one place.
const SAME_PLACE: f64 = 1e-3;
/// A tilt of less, in degrees, is rounding.
const LEAST_TILT: f64 = 0.1;
/// Most slices that may be interpolated.
const MOST_SLICES: f64 = 65_536.0;

/// Slices sorted along a normal.
pub(super) struct Stack {
    pub(super) slices: Vec<Slice>,
    normal: DVec3,
}

/// Where sections lie: `count` of them, from the first on by a step.
#[derive(Debug)]
pub(super) struct Lattice {
    pub(super) first: DVec3,
    pub(super) step: DVec3,
    pub(super) count: usize,
}

impl Stack {
    pub(super) fn sorted(mut slices: Vec<Slice>, normal: DVec3) -> Self {
        slices.sort_by(|a, b| {
            let along = normal.dot(a.position).total_cmp(&normal.dot(b.position));
            along.then_with(|| (a.file, a.frame).cmp(&(b.file, b.frame)))
        });
        Self { slices, normal }
    }

    /// Indices at which slices of one place begin, and their number.
    fn places(&self) -> Vec<std::ops::Range<usize>> {
        let along = |i: usize| self.normal.dot(self.slices[i].position);
        let mut places: Vec<std::ops::Range<usize>> = Vec::new();
        for i in 0..self.slices.len() {
            match places.last_mut() {
                Some(place) if along(i) - along(place.start) < SAME_PLACE => place.end = i + 1,
                _ => places.push(i..i + 1),
            }
        }
        places
    }

    /// Drops slices that are there twice: the same instance, or the same pixels under one number where nothing else tells them
    /// apart.
    pub(super) fn drop_copies(&mut self, format: &Format, read: ReadFile, notes: &mut Vec<Note>) -> Result<()> {
        let mut copies = Vec::new();
        for place in self.places() {
            for b in place.clone() {
                let (before, same) = (place.start..b, &self.slices[b]);
                for a in before.filter(|a| !copies.contains(a)).collect::<Vec<_>>() {
                    let other = &self.slices[a];
                    let is_one =
                        !same.instance.is_empty() && same.instance == other.instance && same.frame == other.frame;
                    let may_be = same.file != other.file && same.time == other.time && same.number == other.number;
                    if is_one || (may_be && frame(read, other, format)? == frame(read, same, format)?) {
                        copies.push(b);
                        break;
                    }
                }
            }
        }
        if !copies.is_empty() {
            notes.push(note(format!("{} slices are there twice, and were read once", copies.len()), copies.len()));
            let mut i = 0;
            self.slices.retain(|_| {
                i += 1;
                copies.binary_search(&(i - 1)).is_err()
            });
        }
        Ok(())
    }

    /// How many slices each place has, ordered by what tells them apart.
    pub(super) fn timepoints(&mut self) -> Result<usize> {
        let places = self.places();
        let times = places.iter().map(|place| place.len()).max().unwrap_or(0);
        if let Some(place) = places.iter().find(|place| place.len() != times) {
            let fewer = places.iter().filter(|p| p.len() != times).count();
            let at = self.slices[place.start].position;
            let found = format!("{times} slices at some places and {} at {at}, {fewer} places in all", place.len());
            let remedy = "slices are missing, or several series have one UID: copy the series anew, or sort it by hand";
            return Err(Error::format(NAME, found, "as many slices at each place", remedy));
        }
        for place in places {
            let key = |slice: &Slice| -> Vec<f64> {
                slice.time.iter().chain([&slice.number]).map(|t| t.unwrap_or(f64::NEG_INFINITY)).collect()
            };
            self.slices[place].sort_by(|a, b| {
                let pairs = key(a).into_iter().zip(key(b));
                let first = pairs.map(|(a, b)| a.total_cmp(&b)).find(|o| o.is_ne());
                first.unwrap_or(std::cmp::Ordering::Equal)
            });
        }
        Ok(times)
    }

    /// Keeps the slices of one time.
    pub(super) fn take_time(&mut self, time: usize) {
        let kept: Vec<Slice> =
            self.places().into_iter().filter_map(|place| self.slices.get(place.start + time).cloned()).collect();
        self.slices = kept;
    }

    /// The grid that slices are sections of.
    pub(super) fn lattice(&self, normal: DVec3, allows_gaps: bool) -> Result<Lattice> {
        let at: Vec<DVec3> = self.places().iter().map(|place| self.slices[place.start].position).collect();
        let (&[first, .., last], [_, _, ..]) = (at.as_slice(), at.as_slice()) else {
            let remedy = "name the folder of the whole series";
            return Err(Error::format(
                NAME,
                format!("{} slices at different places", at.len()),
                "at least two",
                remedy,
            ));
        };
        let along = |p: DVec3| normal.dot(p - first);
        let steps: Vec<f64> = at.windows(2).map(|pair| along(pair[1]) - along(pair[0])).collect();
        let mut sorted = steps.clone();
        sorted.sort_by(f64::total_cmp);
        // The smallest that others share: of a series with gaps the common step may be rare.
        let smallest = sorted[0];
        let common: Vec<f64> = sorted.iter().copied().filter(|s| *s < smallest * (1.0 + SAME_STEP)).collect();
        let step = common.iter().sum::<f64>() / common.len() as f64;
        let mut count = 1.0;
        for (i, own) in steps.iter().enumerate() {
            let steps = libm::round(own / step);
            if (own - steps * step).abs() > SAME_STEP * step * steps || steps < 1.0 {
                let found =
                    format!("a distance of {own:.4} mm between slices {i} and {}, others of {step:.4} mm", i + 1);
                let remedy = "resample the series to equal distances:\n  dcm2niix -z y -o OUT FOLDER";
                return Err(Error::format(NAME, found, "equal distances", remedy));
            }
            if steps > 1.0 && !allows_gaps {
                let found =
                    format!("{} slices missing between slices {i} and {} ({step:.4} mm apart)", steps - 1.0, i + 1);
                let remedy = "copy the whole series, or interpolate with --allow-gaps";
                return Err(Error::format(NAME, found, "slices without gaps", remedy));
            }
            count += steps;
        }
        if count > MOST_SLICES {
            return Err(damaged(format!("{count} slices with those between"), "at most 65,536"));
        }
        let step = (last - first) / (count - 1.0);
        // Positions on one line, in plane as well.
        let mut place = 0.0;
        for (i, own) in steps.iter().enumerate() {
            place += libm::round(own * (count - 1.0) / along(last));
            let off = (at[i + 1] - (first + step * place)).length();
            if off > SAME_STEP.max(0.05) * step.length() {
                let found = format!("slice {} {off:.3} mm off the line of the others", i + 1);
                let remedy = "slices shifted in plane are no grid; resample the series, for example with dcm2niix";
                return Err(Error::format(NAME, found, "positions on one line", remedy));
            }
        }
        Ok(Lattice { first, step, count: count as usize })
    }

    /// The samples of each slice.
    pub(super) fn read(&self, format: &Format, read: ReadFile) -> Result<Vec<Data>> {
        let (mut all, mut of_file): (Vec<Data>, Option<(usize, Vec<Data>)>) = (Vec::new(), None);
        for slice in &self.slices {
            if of_file.as_ref().is_none_or(|(file, _)| *file != slice.file) {
                of_file = Some((slice.file, read(slice.file)?));
            }
            let frames = of_file.as_ref().map(|(_, frames)| frames.as_slice()).unwrap_or_default();
            let frame = frames.get(slice.frame).ok_or_else(|| damaged("fewer frames than said", "all"))?;
            all.push(format.clean(frame.clone()));
        }
        Ok(all)
    }
}

fn frame(read: ReadFile, slice: &Slice, format: &Format) -> Result<Option<Data>> {
    Ok(read(slice.file)?.into_iter().nth(slice.frame).map(|data| format.clean(data)))
}

impl Lattice {
    /// The section at a position.
    pub(super) fn place(&self, position: DVec3, normal: DVec3) -> usize {
        libm::round(normal.dot(position - self.first) / normal.dot(self.step)) as usize
    }

    /// Says how far the step leans.
    pub(super) fn tell(&self, normal: DVec3, notes: &mut Vec<Note>) {
        let cosine = normal.dot(self.step) / self.step.length();
        let degrees = libm::acos(cosine.clamp(-1.0, 1.0)).to_degrees();
        if degrees > LEAST_TILT {
            notes.push(note(
                format!("the gantry is tilted by {degrees:.2}°: the grid is sheared, nothing is resampled"),
                1,
            ));
        }
    }
}
