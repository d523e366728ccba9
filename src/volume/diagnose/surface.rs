//! How one isosurface lies in the samples.

#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

use super::super::{Sample, Solid, Volume, with_samples};
use crate::finding::Finding;

pub(super) fn findings(volume: &Volume, isovalue: f64) -> Vec<Finding> {
    let count = volume.samples().len() as u64;
    let (low, high) = volume.value_range();
    let crossed = match volume.solid {
        Solid::Above => low <= isovalue && isovalue < high,
        Solid::Below => low < isovalue && isovalue <= high,
    };
    if !crossed {
        return vec![Finding::new(
            "no surface",
            (0, count, "samples"),
            format!("isovalue {isovalue} separates nothing: the values go from {low} to {high}"),
            "commands that need a surface refuse; choose an isovalue inside the range",
        )];
    }
    let c_raw = volume.raw_from_value(isovalue);
    let mut found = Vec::new();
    let equal = with_samples!(volume.samples(), s => s.iter().filter(|s| f64::from(s.raw()) == c_raw).count() as u64);
    if equal > 0 {
        found.push(Finding::new(
            "isovalue on samples",
            (equal, count, "samples"),
            "samples equal the isovalue exactly",
            "such a sample is lit, by one rule for rays and meshes: the surface stays closed and no ray leaks. Where \
             many lie together an isovalue between two sample values gives a smoother surface",
        ));
    }
    let (solid, border) = with_samples!(volume.samples(), s => border(volume, s, c_raw));
    if solid > 0 {
        found.push(Finding::new(
            "open surface",
            (solid, border, "border samples"),
            "the solid of this isovalue reaches the border of the grid",
            "the surface ends there with an open edge, no cap is drawn, and rays that leave the box see the \
             environment: nothing is known beyond. Pad the volume with a lit value to close it",
        ));
    }
    found
}

/// How many samples on the six faces of the grid are solid, and how many there are.
fn border<T: Sample>(volume: &Volume, samples: &[T], c_raw: f64) -> (u64, u64) {
    let [nx, ny, nz] = volume.dims();
    let sign = f64::from(volume.solid_sign());
    let (mut solid, mut border) = (0, 0);
    let mut at = |i: usize| {
        border += 1;
        solid += u64::from(samples.get(i).is_some_and(|s| sign * (f64::from(s.raw()) - c_raw) > 0.0));
    };
    for z in 0..nz {
        for y in 0..ny {
            let row = nx * (y + ny * z);
            if z == 0 || y == 0 || z + 1 == nz || y + 1 == ny {
                (0..nx).for_each(|x| at(row + x));
            } else {
                at(row);
                if nx > 1 {
                    at(row + nx - 1);
                }
            }
        }
    }
    (solid, border)
}
