//! How one isosurface lies in the samples.

#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

use super::super::isovalue::solid_of_border;
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
    let (solid, border) = solid_of_border(volume, isovalue, volume.solid);
    if solid > 0 {
        found.push(Finding::new(
            "open surface",
            (solid, border, "border samples"),
            "the solid of this isovalue reaches the border of the grid",
            "the surface ends there: pictures draw a flat face over the cut (not with --cap open), meshes end with an \
             open edge. Rays that leave the box see the environment: nothing is known beyond. Pad the volume with a \
             lit value to close it",
        ));
    }
    found
}
