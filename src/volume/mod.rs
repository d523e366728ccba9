//! Scalar volumes: the grid, the samples in their native type, analytic fields, and readers.
//! Knows nothing of light and of rays.
//!
//! # Conventions
//! * h is a scalar field on a regular grid, vertex-centred, trilinear between samples.
//! * Sample (i, j, k) has index `i + nx·(j + ny·k)`: x runs fastest. Its grid position is
//!   (i, j, k), its world position `world_from_grid · (i, j, k)`.
//! * A stored sample is *raw*; the file's physical value is `slope·raw + inter`. Isovalues on the
//!   command line, colormaps and reports are in the file's values. Solid is {h > c} for
//!   [`Solid::Above`] and {h < c} for [`Solid::Below`]; light lives on the other side. Inside the
//!   level-set code the sign is carried by [`Volume::solid_sign`]: with c_raw =
//!   [`Volume::raw_from_value`]`(c)`, a point is solid where `solid_sign·(raw − c_raw) > 0`.
//! * Samples are finite: readers replace NaN and infinities and say so in a [`Note`].

#[doc(hidden)]
pub mod array;
mod assemble;
#[doc(hidden)]
pub mod choice;
mod components;
mod decode;
mod dicom;
#[doc(hidden)]
pub mod diagnose;
pub mod field;
mod foreign;
mod format;
pub mod isovalue;
mod mapped;
#[doc(hidden)]
pub mod open;
#[doc(hidden)]
pub mod read;
mod samples;
mod slices;
mod source;
mod zarr;

pub use choice::{Channel, Choice, Level, MOST_AUTO, Region, Series, Spacing};
pub use components::Removed;
pub use isovalue::Isovalue;
pub(crate) use mapped::{REMEDY_OF_REFERENCE, samples_at};
pub use open::{open, open_with};
pub use read::{ReadHint, read};
pub use samples::Samples;
pub(crate) use samples::with_samples;
#[doc(hidden)]
pub use samples::{Place, Sample, SampleOwner, SamplesView};

use crate::error::{Error, Result};
use crate::geom::{Affine, Bounds, Up};
use crate::model::Tree;
use glam::DVec3;
use std::sync::{Arc, OnceLock};

/// Which side of the level set is matter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Solid {
    /// {h > c} is solid, light lives in {h ≤ c}. The default.
    #[default]
    Above,
    /// {h < c} is solid.
    Below,
}

/// The physical unit of world coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum LengthUnit {
    /// The file does not say.
    #[default]
    Unknown,
    /// The file says; how many metres one world unit is.
    Metres(f64),
}

impl LengthUnit {
    /// How many metres it is, if that is known.
    pub fn metres(self) -> Option<f64> {
        match self {
            Self::Unknown => None,
            Self::Metres(metres) => Some(metres),
        }
    }
}

/// Something a reader noticed and did that the user should know.
#[derive(Clone, Debug, PartialEq)]
pub struct Note {
    /// What was found and what was done about it, a sentence without a full stop.
    pub text: String,
    /// How many samples (or header fields) it concerns.
    pub count: u64,
}

/// The largest magnitude of a sample, 2^122: differences, gradients and the steps of the cell solver multiply
/// samples by up to 54, which must not overflow `f32`. File readers rescale from 2^100 on.
#[doc(hidden)]
pub const MOST_MAGNITUDE: f32 = f32::from_bits((127 + 122) << 23);

/// The largest magnitude of a world coordinate and of a spacing, and the inverse of the smallest spacing: squares of
/// distances and of gradients per world unit must not overflow `f32`, in which surfaces are written.
#[doc(hidden)]
pub const MOST_EXTENT: f64 = 1e18;

/// Refuses a grid whose place in the world is beyond [`MOST_EXTENT`].
fn check_extent(dims: [usize; 3], world_from_grid: &Affine) -> Result<()> {
    let spacing = world_from_grid.spacing();
    let last = DVec3::from_array(dims.map(|d| d.saturating_sub(1) as f64));
    let reach = world_from_grid.offset().abs().max_element() + (spacing * last).element_sum();
    if reach <= MOST_EXTENT && spacing.max_element() <= MOST_EXTENT && spacing.min_element() >= 1.0 / MOST_EXTENT {
        return Ok(());
    }
    Err(Error::argument(
        "spacing",
        format!("{:e} × {:e} × {:e}, up to {reach:e} from the origin", spacing.x, spacing.y, spacing.z),
        "spacings of 1e-18 to 1e18, and a box within 1e18 of the origin",
        "correct the header, or give the spacing in a fitting unit with --spacing X,Y,Z",
    ))
}

/// A scalar volume.
#[derive(Clone, Debug)]
pub struct Volume {
    // Invariants: dims.product() == samples.len() > 0; float samples finite and at most MOST_MAGNITUDE;
    // slope finite, not 0.
    dims: [usize; 3],
    samples: Samples,
    slope: f64,
    inter: f64,
    world_from_grid: Affine,
    raw_range: (f32, f32),
    // Of what stands above, once somebody has asked for it.
    hash: OnceLock<String>,
    /// A short name for reports and stores, such as the file's stem.
    pub name: String,
    /// Unit of world coordinates.
    pub unit: LengthUnit,
    /// The world axis that points up.
    pub up: Up,
    /// Which side is matter.
    pub solid: Solid,
    /// The side on which the solid of every isovalue is declared convex; see [`field::Field::convex_side`].
    pub convex_side: Option<Solid>,
    /// Whether its level sets can shade themselves.
    pub shadowing: Shadowing,
    /// What else its file holds, where the format can hold more than one volume.
    pub series: Series,
    /// What the reader noticed.
    pub notes: Vec<Note>,
    /// Whether stores name the file of its samples instead of holding a copy of them.
    #[doc(hidden)]
    pub by_reference: bool,
    /// The model that it is samples of.
    pub(crate) model: Option<Arc<ModelText>>,
    /// The same, ready to be evaluated, where vertices of isosurfaces are to lie on it.
    pub(crate) exact: Option<Arc<Tree>>,
}

/// The text of a model.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ModelText {
    /// Name of its file, without directories.
    pub file: String,
    /// All of the file.
    pub text: String,
}

/// What is taken for granted of the shadows that a level set casts on itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Shadowing {
    /// Nothing: a texel is traced unless it is declared or proven that its rays cannot be blocked.
    #[default]
    Found,
    /// Every texel is traced, proofs and declarations notwithstanding.
    Traced,
    /// No texel is traced: all are lit as if unoccluded.
    Ignored,
}

impl Volume {
    /// A volume from its parts; slope 1, inter 0, unit unknown, up z, solid above.
    ///
    /// # Errors
    /// When the number of samples is not the product of `dims`, is 0, a sample is not finite or larger in
    /// magnitude than [`MOST_MAGNITUDE`], or the grid lies beyond [`MOST_EXTENT`].
    pub fn new(dims: [usize; 3], samples: Samples, world_from_grid: Affine) -> Result<Self> {
        let count = dims.iter().try_fold(1usize, |n, &d| n.checked_mul(d)).unwrap_or(0);
        if count == 0 || count != samples.len() {
            return Err(Error::argument(
                "volume",
                format!("{} samples for {}×{}×{}", samples.len(), dims[0], dims[1], dims[2]),
                "one sample for each grid point, at least one",
                "check the dimensions",
            ));
        }
        if let Some(bad) = samples.first_not_finite() {
            return Err(Error::argument(
                "volume",
                format!("a sample that is not finite at index {bad}"),
                "finite samples",
                "replace NaN and infinities first; the file readers do so and report it",
            ));
        }
        check_extent(dims, &world_from_grid)?;
        let raw_range = samples.raw_range();
        let largest = raw_range.0.abs().max(raw_range.1.abs());
        if largest > MOST_MAGNITUDE {
            return Err(Error::argument(
                "volume",
                format!("a sample of magnitude {largest:e}"),
                "magnitudes up to 2^122",
                "divide by a power of two and give it to with_scaling as slope, as the file readers do",
            ));
        }
        Ok(Self {
            dims,
            samples,
            slope: 1.0,
            inter: 0.0,
            world_from_grid,
            raw_range,
            hash: OnceLock::new(),
            name: "volume".into(),
            unit: LengthUnit::Unknown,
            up: Up::Z,
            solid: Solid::Above,
            convex_side: None,
            shadowing: Shadowing::Found,
            series: Series::default(),
            notes: Vec::new(),
            by_reference: false,
            model: None,
            exact: None,
        })
    }

    /// The same volume with the decoding `value = slope·raw + inter`.
    ///
    /// # Errors
    /// When the slope is 0 or either is not finite.
    pub fn with_scaling(mut self, slope: f64, inter: f64) -> Result<Self> {
        if !(slope.is_finite() && inter.is_finite() && slope != 0.0) {
            return Err(Error::argument(
                "scaling",
                format!("slope {slope}, intercept {inter}"),
                "finite numbers and a slope that is not 0",
                "correct the header of the file",
            ));
        }
        (self.slope, self.inter, self.hash) = (slope, inter, OnceLock::new());
        Ok(self)
    }

    /// Whether it has any surface; `false` only where that is accepted.
    ///
    /// # Errors
    /// When all samples are the same, and an empty store is not accepted.
    #[doc(hidden)]
    pub fn check_surface(&self, allow_empty: bool) -> Result<bool> {
        let (low, high) = self.value_range();
        if low < high || allow_empty {
            return Ok(low < high);
        }
        Err(Error::argument(
            "volume",
            format!("{}, all of whose samples are {low}", self.name),
            "samples that differ",
            "a constant volume has no surface; --allow-empty makes an empty store of it",
        ))
    }

    /// Refuses a grid without cells, which no ray can be traced in.
    ///
    /// # Errors
    /// With fewer than two samples along an axis.
    #[doc(hidden)]
    pub fn check_cells(&self) -> Result<()> {
        let [x, y, z] = self.dims;
        if x.min(y).min(z) >= 2 {
            return Ok(());
        }
        Err(Error::argument(
            "volume",
            format!("{x}×{y}×{z} samples"),
            "at least 2 samples along each axis",
            "a slice has no isosurface; stack it with its neighbours",
        ))
    }

    /// Grid points along x, y, z.
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// The samples.
    pub fn samples(&self) -> &Samples {
        &self.samples
    }

    /// Factor from raw samples to values.
    pub fn slope(&self) -> f64 {
        self.slope
    }

    /// Offset from raw samples to values.
    pub fn inter(&self) -> f64 {
        self.inter
    }

    /// The same volume elsewhere: its world goes through a linear map, then to `translate`. A unit of length stays what it is.
    ///
    /// # Errors
    /// When the map is not finite, or flattens space.
    pub fn placed(self, linear: glam::DMat3, translate: DVec3) -> Result<Self> {
        let before = self.world_from_grid;
        let world_from_grid = Affine::new(linear * before.linear(), linear * before.offset() + translate);
        match world_from_grid.filter(|_| translate.is_finite()) {
            Some(world_from_grid) => {
                check_extent(self.dims, &world_from_grid)?;
                // A model stays where it is.
                Ok(Self { world_from_grid, model: None, exact: None, hash: OnceLock::new(), ..self })
            }
            None => {
                let found = format!("a map {linear:?} and {translate:?}");
                let remedy = "choose a scale of ordinary size";
                Err(Error::argument("scale and translate", found, "a finite map that keeps space apart", remedy))
            }
        }
    }

    /// Grid to world.
    pub fn world_from_grid(&self) -> &Affine {
        &self.world_from_grid
    }

    /// Smallest and largest raw sample.
    #[doc(hidden)]
    pub fn raw_range(&self) -> (f32, f32) {
        self.raw_range
    }

    /// Smallest and largest value, ascending.
    pub fn value_range(&self) -> (f64, f64) {
        let a = self.value_from_raw(f64::from(self.raw_range.0));
        let b = self.value_from_raw(f64::from(self.raw_range.1));
        (a.min(b), a.max(b))
    }

    /// The file's value of a raw sample.
    #[doc(hidden)]
    pub fn value_from_raw(&self, raw: f64) -> f64 {
        self.slope * raw + self.inter
    }

    /// The raw sample (not rounded) of a value of the file.
    #[doc(hidden)]
    pub fn raw_from_value(&self, value: f64) -> f64 {
        (value - self.inter) / self.slope
    }

    /// +1 where larger *raw* samples are solid, −1 where smaller ones are.
    #[doc(hidden)]
    pub fn solid_sign(&self) -> f32 {
        let above = self.solid == Solid::Above;
        if above == (self.slope > 0.0) { 1.0 } else { -1.0 }
    }

    /// Whether the solids of the side that is matter are declared convex.
    #[doc(hidden)]
    pub fn is_convex(&self) -> bool {
        self.convex_side == Some(self.solid)
    }

    /// Linear index of a grid point.
    #[doc(hidden)]
    pub fn index(&self, x: usize, y: usize, z: usize) -> usize {
        debug_assert!(x < self.dims[0] && y < self.dims[1] && z < self.dims[2]);
        x + self.dims[0] * (y + self.dims[1] * z)
    }

    /// The box of the grid in world coordinates (of its eight corners).
    pub fn world_bounds(&self) -> Bounds {
        let last = DVec3::new((self.dims[0] - 1) as f64, (self.dims[1] - 1) as f64, (self.dims[2] - 1) as f64);
        (0..8).fold(Bounds::EMPTY, |bounds, corner| {
            let pick = DVec3::new((corner & 1) as f64, (corner >> 1 & 1) as f64, (corner >> 2) as f64);
            bounds.including(self.world_from_grid.point(last * pick))
        })
    }

    /// BLAKE3 of everything that decides what light does: dimensions, type, samples, scaling,
    /// affine. Not of the name, the unit, or the notes. Looks at the samples once.
    pub fn content_hash(&self) -> String {
        self.hash.get_or_init(|| self.hash_of_all()).clone()
    }

    /// Takes the word of somebody who has hashed just these samples, in this frame.
    pub(crate) fn trust_hash(&self, hash: &str) {
        self.hash.get_or_init(|| hash.to_owned());
    }

    /// Refuses to be kept by reference where the samples are not read in a file, or a store cannot name it.
    pub(crate) fn check_reference(&self) -> Result<()> {
        if !self.by_reference {
            return Ok(());
        }
        let (found, expected, remedy) = match self.samples.place() {
            None => (
                format!("{}, whose samples are in memory", self.name),
                "samples that are read in their file: not compressed, x fastest, little-endian, aligned, finite, more than 64 KiB",
                "write the volume as NRRD raw or NIfTI without .gz",
            ),
            Some(place) if place.file.to_str().is_none() => (
                format!("{}, whose path is not UTF-8", place.file.display()),
                "a path of UTF-8, as the metadata of a store are",
                "rename the file, or the folder that is not",
            ),
            Some(place) if !place.is_there() => (
                format!("{}, which was moved or written since it was opened", place.file.display()),
                "a file that stays as it is",
                "begin again when it does",
            ),
            Some(_) => return Ok(()),
        };
        let remedy = format!("{remedy}; or leave the option out: the store then holds a copy");
        Err(Error::argument("--store-volume reference", found, expected, remedy))
    }

    fn hash_of_all(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        hasher.update(self.samples.type_name().as_bytes());
        for d in self.dims {
            hasher.update(&(d as u64).to_le_bytes());
        }
        let linear = self.world_from_grid.linear().to_cols_array();
        let offset = self.world_from_grid.offset().to_array();
        for v in linear.iter().chain(&offset).chain(&[self.slope, self.inter]) {
            hasher.update(&v.to_le_bytes());
        }
        hasher.update_rayon(self.samples.bytes());
        hasher.finalize().to_hex().to_string()
    }
}

#[cfg(test)]
mod tests;
