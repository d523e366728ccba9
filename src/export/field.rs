//! Radiance on a lattice as files that other programs read: VTI (VTK, ParaView), NRRD (3D Slicer, teem, ITK), and raw
//! RGBA with a detached NRRD header.
//!
//! Numbers are linear Rec.709 radiance as 32-bit floats, little-endian, x fastest. VTI carries the field itself and
//! exposed colours too, so that a contour can be made and coloured from the one file.

use super::{atomic, write_error};
use crate::error::{Error, Result};
use crate::srgb::byte_from_linear;
use glam::{DMat3, DVec3};
use serde_json::Value;
use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

/// Radiance on a lattice of points in world. All slices hold one entry a point, x fastest.
#[derive(Clone, Copy, Debug)]
pub struct RadianceField<'a> {
    /// Points along each axis, at least 1.
    pub dims: [usize; 3],
    /// World position of the first point.
    pub origin: DVec3,
    /// World displacement from a point to the next along each axis.
    pub steps: DMat3,
    /// Linear radiance.
    pub radiance: &'a [[f32; 3]],
    /// 1 where the radiance is that of a level set, 2 where it was filled from neighbours, 0 where there is none.
    pub valid: &'a [u8],
    /// The scalar field, in the file's values.
    pub values: &'a [f32],
    /// Factor from radiance to colours in [0, 1].
    pub exposure: f32,
    /// How the file was made.
    pub provenance: &'a Value,
}

impl RadianceField<'_> {
    fn check(&self) -> Result<()> {
        let count = self.dims.iter().try_fold(1usize, |n, &d| n.checked_mul(d)).unwrap_or(0);
        let lengths = [self.radiance.len(), self.valid.len(), self.values.len()];
        if count == 0 || lengths != [count; 3] {
            let found = format!("{lengths:?} entries for {:?} points", self.dims);
            return Err(Error::argument("radiance field", found, "one entry a point, at least one", "check the sizes"));
        }
        if !(self.origin.is_finite() && self.steps.is_finite() && self.steps.determinant() != 0.0) {
            let found = format!("steps {:?} from {}", self.steps, self.origin);
            return Err(Error::argument("radiance field", found, "finite, independent steps", "check the grid"));
        }
        Ok(())
    }
}

/// A kind of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FieldFormat {
    /// ParaView, VTK.
    Vti,
    /// 3D Slicer, ITK.
    Nrrd,
    /// RGBA floats, with a header `.nhdr` beside them.
    Raw,
}

impl FieldFormat {
    /// By the ending of a name.
    ///
    /// # Errors
    /// For another ending.
    pub fn of(path: &Path) -> Result<Self> {
        let suffix = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match suffix.as_deref() {
            Some("vti") => Ok(Self::Vti),
            Some("nrrd") => Ok(Self::Nrrd),
            Some("raw") => Ok(Self::Raw),
            _ => {
                let expected = "a name ending in .vti, .nrrd or .raw";
                Err(Error::argument("output", path.display(), expected, "the ending decides the format"))
            }
        }
    }

    /// Writes a field as the file `path`.
    ///
    /// # Errors
    /// As the writers; when the file cannot be written.
    pub fn write(self, path: &Path, field: &RadianceField<'_>) -> Result<()> {
        match self {
            Self::Vti => atomic::write(path, |w| write_vti(w, field)),
            Self::Nrrd => atomic::write(path, |w| write_nrrd(w, field)),
            Self::Raw => {
                atomic::write(path, |w| write_raw(w, field))?;
                let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
                atomic::write(path.with_extension("nhdr"), |w| write_raw_header(w, field, &name))
            }
        }
    }
}

/// Largest cosine between two axes that counts as a right angle.
const RIGHT_ANGLE: f64 = 1e-6;

/// Writes VTK XML ImageData (`.vti`) with appended raw data: point data `radiance` (3 floats), `colour` (3 bytes, sRGB,
/// exposed: ParaView shows them as they are with Map Scalars off), `value`, `valid`.
///
/// # Errors
/// When the lengths do not fit, or the axes are not at right angles, which ImageData cannot hold; [`Error::Io`] (path
/// empty) from the stream.
pub fn write_vti(w: &mut (impl Write + ?Sized), field: &RadianceField<'_>) -> Result<()> {
    field.check()?;
    let axes = [field.steps.x_axis, field.steps.y_axis, field.steps.z_axis];
    let spacing = axes.map(|a| a.length());
    let unit: [DVec3; 3] = std::array::from_fn(|a| axes[a] / spacing[a]);
    let sheared = unit[0].dot(unit[1]).abs().max(unit[1].dot(unit[2]).abs()).max(unit[2].dot(unit[0]).abs());
    if sheared > RIGHT_ANGLE {
        let found = format!("axes whose cosine is {sheared:.3}");
        return Err(Error::argument("output", found, "axes at right angles for .vti", "write .nrrd instead"));
    }
    let extent = field.dims.map(|d| format!("0 {}", d - 1)).join(" ");
    // Rows of the matrix whose columns are the axes.
    let direction: Vec<f64> = (0..3).flat_map(|row| unit.map(|axis| axis[row])).collect();
    let count = field.values.len();
    let arrays = [
        ("radiance", "Float32", 3, 12),
        ("colour", "UInt8", 3, 3),
        ("value", "Float32", 1, 4),
        ("valid", "UInt8", 1, 1),
    ];
    let mut text = String::from("<?xml version=\"1.0\"?>\n");
    let _ = writeln!(text, "<!-- {} -->", field.provenance.to_string().replace("--", "- -"));
    let _ = writeln!(
        text,
        "<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">"
    );
    let _ = writeln!(
        text,
        "<ImageData WholeExtent=\"{extent}\" Origin=\"{}\" Spacing=\"{}\" Direction=\"{}\">",
        spaced(&field.origin.to_array()),
        spaced(&spacing),
        spaced(&direction)
    );
    let _ = writeln!(text, "<Piece Extent=\"{extent}\">\n<PointData Scalars=\"value\">");
    let mut offset = 0;
    for (name, kind, components, bytes) in arrays {
        let _ = writeln!(
            text,
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"appended\" offset=\"{offset}\"/>"
        );
        offset += 8 + bytes * count;
    }
    text.push_str("</PointData>\n</Piece>\n</ImageData>\n<AppendedData encoding=\"raw\">\n_");
    let mut put = |bytes: &[u8]| w.write_all(bytes).map_err(write_error);
    put(text.as_bytes())?;
    let length = |bytes: usize| (bytes as u64 * count as u64).to_le_bytes();
    let colours: Vec<[u8; 3]> =
        field.radiance.iter().map(|rgb| rgb.map(|v| byte_from_linear((v * field.exposure).clamp(0.0, 1.0)))).collect();
    for (bytes, data) in [
        (12, bytemuck::cast_slice(field.radiance)),
        (3, colours.as_flattened()),
        (4, bytemuck::cast_slice(field.values)),
        (1, field.valid),
    ] {
        put(&length(bytes))?;
        put(data)?;
    }
    put(b"\n</AppendedData>\n</VTKFile>\n")
}

/// Writes NRRD with the radiance as RGB, data attached and uncompressed.
///
/// # Errors
/// When the lengths do not fit; [`Error::Io`] (path empty) from the stream.
pub fn write_nrrd(w: &mut (impl Write + ?Sized), field: &RadianceField<'_>) -> Result<()> {
    field.check()?;
    w.write_all(nrrd_header(field, 3, "RGB-color", None).as_bytes()).map_err(write_error)?;
    w.write_all(bytemuck::cast_slice(field.radiance)).map_err(write_error)
}

/// Writes radiance and weight as raw RGBA floats; alpha is 1 where the radiance is that of a level set, else 0.
///
/// # Errors
/// As [`write_nrrd`].
pub fn write_raw(w: &mut (impl Write + ?Sized), field: &RadianceField<'_>) -> Result<()> {
    field.check()?;
    super::write_records(w, field.radiance.len(), |i| {
        let [r, g, b] = field.radiance[i];
        let mut bytes = [0; 16];
        let rgba = [r, g, b, if field.valid[i] == 1 { 1.0 } else { 0.0 }];
        bytes.copy_from_slice(bytemuck::cast_slice(&rgba));
        bytes
    })
}

/// The header beside [`write_raw`]: a detached NRRD header (`.nhdr`) that names `data_file`.
///
/// # Errors
/// As [`write_nrrd`].
pub fn write_raw_header(w: &mut (impl Write + ?Sized), field: &RadianceField<'_>, data_file: &str) -> Result<()> {
    field.check()?;
    w.write_all(nrrd_header(field, 4, "RGBA-color", Some(data_file)).as_bytes()).map_err(write_error)
}

fn nrrd_header(field: &RadianceField<'_>, components: usize, kind: &str, data_file: Option<&str>) -> String {
    let vector = |v: DVec3| format!("({},{},{})", v.x, v.y, v.z);
    let [x, y, z] = field.dims;
    let mut text = String::from("NRRD0005\n");
    let _ = writeln!(text, "# {}", field.provenance);
    let _ =
        writeln!(text, "type: float\ndimension: 4\nspace: right-anterior-superior\nsizes: {components} {x} {y} {z}");
    let steps = [field.steps.x_axis, field.steps.y_axis, field.steps.z_axis].map(vector).join(" ");
    let _ = writeln!(text, "space directions: none {steps}\nspace origin: {}", vector(field.origin));
    let _ = writeln!(text, "kinds: {kind} domain domain domain\nendian: little\nencoding: raw");
    if let Some(name) = data_file {
        let _ = writeln!(text, "data file: {name}");
    }
    text.push('\n');
    text
}

fn spaced(numbers: &[f64]) -> String {
    numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests;
