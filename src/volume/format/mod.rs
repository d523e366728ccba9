//! One file for each format. Each turns a source into the parts of a volume.
//!
//! # Panics
//! None, on any bytes (`tests/fuzz`). `unwrap` and `expect` are denied in all readers. Indexing is denied
//! where places are computed from the file: cube, OpenDX, gOpenMol, .npz, VTK, VTI (but for the joining of pieces, which
//! are checked to lie in the whole), MetaImage, TIFF (but for the axes of OME), raw. In NIfTI, MRC, NRRD and NumPy it stays:
//! indices there are axes, 0 to 2, or fixed offsets into headers of a fixed length, and the formula reads
//! like the format's definition.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]

pub(crate) mod cube;
pub(crate) mod dx;
pub(crate) mod metaimage;
pub(crate) mod mrc;
pub(crate) mod nifti;
pub(crate) mod npy;
pub(crate) mod npz;
pub(crate) mod nrrd;
pub(crate) mod plt;
pub(crate) mod raw;
pub(crate) mod tiff;
pub(crate) mod vti;
pub(crate) mod vtk;
mod xml;

use crate::error::{Error, Result};
use crate::geom::Affine;
use glam::{DMat3, DVec3};

/// One ångström in metres.
pub(crate) const ANGSTROM: f64 = 1e-10;
/// One bohr in metres (CODATA 2018: 5.29177210903(80)e-11 m).
pub(crate) const BOHR: f64 = 5.29177210903e-11;

/// The affine from its parts, or the format's error.
pub(crate) fn affine(format: &'static str, linear: DMat3, offset: DVec3) -> Result<Affine> {
    Affine::new(linear, offset).ok_or_else(|| {
        Error::format(
            format,
            format!("axes {} {} {} and origin {offset}", linear.x_axis, linear.y_axis, linear.z_axis),
            "three finite, independent axis vectors and a finite origin",
            "correct the orientation in the header",
        )
    })
}

/// The error of a header that names a second file where only one stream is at hand.
pub(crate) fn needs_second_file(format: &'static str, name: &str) -> Error {
    Error::format(
        format,
        format!("samples kept in a second file, {name:?}"),
        "samples in the same stream",
        "open the header by its path instead of piping it",
    )
}

/// Metres in a unit of length as headers write it; `None` for words that are no known length.
pub(crate) fn metres_in(unit: &str) -> Option<f64> {
    Some(match unit.trim().trim_matches('"') {
        "m" | "meter" | "metre" | "meters" | "metres" => 1.0,
        "dm" | "decimeter" => 1e-1,
        "cm" | "centimeter" => 1e-2,
        "mm" | "millimeter" | "millimetre" | "millimeters" | "millimetres" => 1e-3,
        "um" | "µm" | "μm" | "\\u00B5m" | "\\u00b5m" | "micron" | "microns" | "micrometer" | "micrometre" => 1e-6,
        "nm" | "nanometer" | "nanometre" => 1e-9,
        "pm" | "picometer" => 1e-12,
        "km" | "kilometer" => 1e3,
        "A" | "Å" | "\u{212b}" | "angstrom" | "Angstrom" | "angstroms" => ANGSTROM,
        "bohr" | "Bohr" | "au" => BOHR,
        "in" | "inch" | "inches" => 0.0254,
        _ => return None,
    })
}
