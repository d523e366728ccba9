//! What is unusual about a volume and what this program does about it: [`diagnose`] reads the
//! samples a few times and changes nothing.
//!
//! | topic | what is counted |
//! |---|---|
//! | `not finite` | samples that were NaN or infinite in the file |
//! | `reader` | whatever else the reader noticed |
//! | `flat grid` | axes with one sample |
//! | `constant` | all samples are equal |
//! | `plateaus` | cells with eight equal corners |
//! | `saturation` | samples at an end of their type |
//! | `clipped range` | samples heaped at an end of the range |
//! | `long tail` | samples outside the small part of the range that holds nearly all |
//! | `few levels` | distinct sample values |
//! | `narrow range` | steps that f32 has left in the range |
//! | `anisotropy` | axes longer than [`ANISOTROPIC`] times the shortest spacing |
//! | `left-handed`, `oblique`, `rotated` | how the grid stands in the world |
//! | `far origin` | axes on which f32 could not tell positions in a voxel apart |
//! | `no surface` | the isovalue lies outside the samples |
//! | `isovalue on samples` | samples that equal the isovalue |
//! | `open surface` | samples on the border of the grid that are solid |

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]

mod grid;
mod samples;
mod surface;

#[cfg(test)]
mod tests;

pub use grid::ANISOTROPIC;

use super::{Note, Volume};
use crate::finding::Finding;

/// What readers say of NaN and infinities begins so.
pub(crate) const REPLACED: &str = "NaN or infinite samples were replaced";

/// What is unusual about a volume; with an isovalue, in the file's values, about that surface too.
pub fn diagnose(volume: &Volume, isovalue: Option<f64>) -> Vec<Finding> {
    let mut found: Vec<Finding> = volume.notes.iter().map(|n| noticed(volume, n)).collect();
    found.extend(grid::flat(volume));
    found.extend(samples::findings(volume));
    found.extend(grid::findings(volume));
    if let Some(isovalue) = isovalue {
        found.extend(surface::findings(volume, isovalue));
    }
    found
}

/// A note of the reader as a finding: its text says both what was found and what was done.
fn noticed(volume: &Volume, note: &Note) -> Finding {
    let samples = volume.samples().len() as u64;
    if note.text.starts_with(REPLACED) {
        let handled = "the reader did so; every sample is finite from there on. Give --solid if matter is on the \
                       other side: the value follows it";
        return Finding::new("not finite", (note.count, samples, "samples"), note.text.clone(), handled);
    }
    let (of, unit) = if note.text.contains("samples were") { (samples, "samples") } else { (0, "items") };
    Finding::new("reader", (note.count, of, unit), note.text.clone(), "")
}
