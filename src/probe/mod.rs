//! Environment probes: distant light as a lat-long image of linear radiance. Reading, geometry,
//! projection on spherical harmonics, analytic skies, and probes as sources of light directions.
//! Knows nothing of volumes and of transfer.
//!
//! * [`latlong`]: the image and its geometry, stated once.
//! * [`read`]: OpenEXR, Radiance HDR, PNG, JPEG; angular maps and cube crosses to lat-long.
//! * [`sky`]: environments by formula. [`mod@embedded`]: small real probes inside the program.
//! * [`orientation`]: how the environment stands in the world.
//! * [`fn@project`], [`into_world`]: coefficients in the order and sign of [`crate::sh`].
//! * [`EnvironmentSource`]: importance sampling.
//! * [`fn@split_sun`]: lamps that a band limit would make ring, apart from the rest.
//! * [`fn@report`]: the figures behind `env show`. [`mod@diagnose`]: what is unusual.
//!
//! # Frame
//! The environment lives in the Y-up frame of glTF, the *probe frame*. [`Orientation`] is the
//! one way from and to world axes. Coefficients come in the probe frame from
//! [`Probe::coefficients`] and in world axes from [`Probe::coefficients_in_world`].

#[doc(hidden)]
pub mod diagnose;
#[doc(hidden)]
pub mod embedded;
#[doc(hidden)]
pub mod latlong;
#[doc(hidden)]
pub mod orientation;
#[doc(hidden)]
pub mod project;
#[doc(hidden)]
pub mod read;
#[doc(hidden)]
pub mod report;
#[doc(hidden)]
pub mod sky;
#[doc(hidden)]
pub mod source;
#[doc(hidden)]
pub mod sun;
mod sun_split;

#[doc(hidden)]
pub use diagnose::diagnose;
pub use embedded::EMBEDDED;
#[doc(hidden)]
pub use embedded::embedded;
pub use latlong::LatLong;
pub use orientation::{EnvFrame, Orientation};
#[doc(hidden)]
pub use project::{into_world, project};
pub use read::{BadPixels, Layout, Note, ReadOptions};
#[doc(hidden)]
pub use report::{Lobe, Report, report};
#[doc(hidden)]
pub use source::EnvironmentSource;
pub use sun::NoSun;
#[doc(hidden)]
pub use sun::{LampShape, Split, SplitSun, Sun, SunOptions, split_sun};
pub use sun_split::{MOST_SUNS, SUN_TOLERANCE, SunSplit};

use crate::error::{Error, Result};
use crate::file;
use crate::sh::Coefficients;
use std::io::Read;
use std::path::Path;

/// Longest image file that is opened: 16384 × 8192 pixels of eight channels of 32 bits.
const MOST_FILE_BYTES: u64 = 1 << 32;

/// A distant environment with what is known about it.
#[derive(Clone, Debug)]
pub struct Probe {
    /// Name for reports: a file's stem or the spec of a sky.
    pub name: String,
    /// Name of the file format, or "formula".
    pub format: &'static str,
    /// The layout it was stored in.
    pub layout: Layout,
    /// Width and height as stored.
    pub stored_size: [usize; 2],
    /// The light.
    pub image: LatLong,
    /// Pixels that no light can have, as found in the file.
    pub bad: BadPixels,
    /// What the reader noticed.
    pub notes: Vec<Note>,
    // The closed form that `image` is a picture of; `None` for pictures.
    exact: Option<sky::Exact>,
}

impl Probe {
    /// A probe from an image made in memory.
    pub fn from_image(name: impl Into<String>, image: LatLong) -> Self {
        Self {
            name: name.into(),
            format: "image",
            layout: Layout::LatLong,
            stored_size: [image.width(), image.height()],
            image,
            bad: BadPixels::default(),
            notes: Vec::new(),
            exact: None,
        }
    }

    /// Reads a probe from the bytes of an image file.
    ///
    /// # Errors
    /// As [`read::read`].
    pub fn from_bytes(name: impl Into<String>, bytes: &[u8], options: &ReadOptions) -> Result<Self> {
        let read::ReadImage { image, format, layout, stored_size, bad, notes } = read::read(bytes, options)?;
        Ok(Self { name: name.into(), format, layout, stored_size, image, bad, notes, exact: None })
    }

    /// Coefficients of red, green and blue in the probe frame. Of skies with a closed form they
    /// are exact, of images exact for the image as constant over each pixel.
    ///
    /// # Panics
    /// When `bands` is 0 or above [`crate::sh::MAX_BANDS`].
    pub fn coefficients(&self, bands: usize) -> [Coefficients; 3] {
        match self.exact {
            Some(exact) => std::array::from_fn(|_| exact.coefficients(bands)),
            None => project(&self.image, bands),
        }
    }

    /// The same for programs, with the convention in words.
    ///
    /// # Panics
    /// As [`Probe::coefficients`].
    #[doc(hidden)]
    pub fn projection_json(&self, bands: usize) -> serde_json::Value {
        let [r, g, b] = self.coefficients(bands);
        let rows: Vec<[f64; 3]> = (0..bands * bands).map(|i| [r.values()[i], g.values()[i], b.values()[i]]).collect();
        serde_json::json!({
            "name": self.name,
            "bands": bands,
            "convention": "real orthonormal, no Condon-Shortley sign, index l(l+1)+m; glTF frame: y up, the image's centre is +x, +z three quarters from the left; linear Rec.709",
            "rgb": rows,
        })
    }

    /// Coefficients of red, green and blue in world axes.
    ///
    /// # Panics
    /// As [`Probe::coefficients`].
    #[doc(hidden)]
    pub fn coefficients_in_world(&self, bands: usize, orientation: Orientation) -> [Coefficients; 3] {
        into_world(&self.coefficients(bands), orientation)
    }

    /// The probe as a source of light directions in world axes.
    #[doc(hidden)]
    pub fn source(&self, orientation: Orientation) -> EnvironmentSource<'_> {
        EnvironmentSource::new(&self.image, orientation)
    }
}

/// A sky of [`sky`] or an embedded probe by its spec, such as `sun:45,30` or `courtyard`; `None`
/// when the spec names neither.
///
/// # Errors
/// When the name is that of a sky but its numbers are not what it takes.
pub fn by_name(spec: &str) -> Result<Option<Probe>> {
    if let Some(bytes) = embedded(spec) {
        return Probe::from_bytes(spec, bytes, &ReadOptions::default()).map(Some);
    }
    Ok(sky::by_name(spec)?.map(|(image, exact)| Probe { format: "formula", exact, ..Probe::from_image(spec, image) }))
}

/// Opens a sky or embedded probe by its spec, else the image file at that path. To read a file
/// that is called like a sky, write `./sky`.
///
/// # Errors
/// As [`by_name`] and [`read::read`], with the file's name; [`Error::Io`] when it cannot be
/// read; [`Error::Argument`] with the list of names when there is neither a sky nor a file, and when
/// the path is that of a folder, a device or a pipe; [`Error::Limit`] beyond 4 GiB.
pub fn open(path_or_name: &str, options: &ReadOptions) -> Result<Probe> {
    if let Some(probe) = by_name(path_or_name)? {
        return Ok(probe);
    }
    let path = Path::new(path_or_name);
    let bytes = read_file(path).map_err(|error| match error {
        Error::Io { source, .. } if source.kind() == std::io::ErrorKind::NotFound => Error::argument(
            "environment",
            path_or_name,
            format!(
                "an image file, a built-in probe ({}) or a sky (constant, gradient, overcast, sky, sun:AZ,EL)",
                EMBEDDED.join(", ")
            ),
            "check the path and the spelling",
        ),
        other => other,
    })?;
    let name = path.file_stem().map_or(path_or_name.into(), |s| s.to_string_lossy().into_owned());
    Probe::from_bytes(name, &bytes, options).map_err(|e| e.in_file(path))
}

/// The bytes of a file, or of what is piped in.
fn read_file(path: &Path) -> Result<Vec<u8>> {
    let (file, length) = file::open_named(path)?;
    let mut bytes = Vec::new();
    let mut found = length.unwrap_or(0);
    if found <= MOST_FILE_BYTES {
        let failed = |e| Error::io(path, "read", e);
        found = file.take(MOST_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(failed)? as u64;
    }
    if found <= MOST_FILE_BYTES {
        return Ok(bytes);
    }
    Err(Error::Limit {
        what: format!("{}: reading it", path.display()),
        needed: format!("{found} bytes or more"),
        limit: format!("{MOST_FILE_BYTES} bytes"),
        remedy: "check that this is the right file, or scale the image down".into(),
    })
}

#[cfg(test)]
mod tests;
