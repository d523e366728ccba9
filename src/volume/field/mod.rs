//! Analytic fields: a function on a box in world space, sampled to a [`Volume`]. They are the
//! scenes of which the answer is known, and the demo.
//!
//! | name | field | solid where | up | default isovalue |
//! |---|---|---|---|---|
//! | `bumpbox` | four bumps over a floor at y = 1 ([`BumpBox`]) | larger | −y | 30 |
//! | `sphere` | −\|x\| on \[−1, 1\]³ ([`Sphere`]) | larger | z | −0.6 |
//! | `bowl` | \|x\| on the lower half of that box ([`Bowl`]) | larger | z | 0.6 |
//! | `gyroid` | two periods of the gyroid ([`Gyroid`]) | larger | z | 0 |
//! | `torus` | signed distance to a torus ([`Torus`]) | larger | z | 0 |
//! | `sphere-over-plane` | max(R − \|x − p\|, −z) ([`SphereOverPlane`]) | larger | z | 0 |
//! | `nucleons`, `nucleons-2` | two kinds of particles, a stand-in ([`Blobs`]) | larger | z | 79 |
//! | `spray`, `spray-2` | a ball, and droplets thrown off it, a stand-in ([`Core`], [`Blobs`]) | larger | z | 116 |
//!
//! Values are computed in f64 with the `libm` crate and rounded once to f32: the same bytes on
//! every machine.

mod bump;
mod particles;
mod shapes;

pub use bump::{BUMP_MAXIMUM, BUMP_MINIMUM, BumpBox};
pub use particles::{Blobs, Core};
pub use shapes::{Bowl, Gyroid, Sphere, SphereOverPlane, Torus};

use super::{Samples, Solid, Volume};
use crate::error::{Error, Result};
use crate::geom::{Affine, Bounds, Up};
use glam::DVec3;

/// Samples along the longest side when a name has no size.
#[doc(hidden)]
pub const DEFAULT_SIZE: usize = 64;
/// Most samples along a side that a name may ask for.
#[doc(hidden)]
pub const LARGEST_SIZE: usize = 4096;

/// A scalar function on a box in world space.
pub trait Field: Send + Sync {
    /// The name by which [`by_name`] knows it.
    fn name(&self) -> &'static str;

    /// The value at a point of world space.
    fn value(&self, point_in_world: DVec3) -> f64;

    /// The box that is sampled.
    fn bounds(&self) -> Bounds;

    /// The world axis that points up.
    fn up(&self) -> Up {
        Up::Z
    }

    /// Which side is matter.
    fn solid(&self) -> Solid {
        Solid::Above
    }

    /// The side on which the solid of *every* isovalue is convex, if there is one: it then shades nothing, and its
    /// transfer is the clamped cosine. A field that declares one answers for it.
    fn convex_side(&self) -> Option<Solid> {
        None
    }

    /// An isovalue worth seeing, strictly within the range of values.
    fn default_isovalue(&self) -> f64;

    /// Appends the values at all combinations of the coordinates along x, y and z, x fastest,
    /// rounded to f32. Fields whose terms separate override this with tables; an override gives
    /// the bits of [`Self::value`].
    fn fill(&self, coordinates: [&[f64]; 3], out: &mut Vec<f32>) {
        for &z in coordinates[2] {
            for &y in coordinates[1] {
                out.extend(coordinates[0].iter().map(|&x| self.value(DVec3::new(x, y, z)) as f32));
            }
        }
    }

    /// Dimensions with cubic voxels and `size` samples along the longest side, or a few more
    /// where that makes every other side a whole number of voxels (the bowl: 64 → 65×65×33).
    fn cubic_dims(&self, size: usize) -> [usize; 3] {
        let sides = self.bounds().size();
        let intervals = |n: usize| (sides / sides.max_element() * (n - 1) as f64).to_array();
        let whole = |n: &usize| intervals(*n).iter().all(|v| (v - v.round()).abs() < 1e-9);
        let size = (size.max(2)..size.max(2) + 8).find(whole).unwrap_or(size.max(2));
        intervals(size).map(|v| (v.round() as usize).max(1) + 1)
    }
}

/// Samples a field at `dims` points, the first and last of each axis on the faces of its box.
///
/// # Errors
/// When an axis has fewer than two samples, or memory does not suffice.
pub fn sample(field: &dyn Field, dims: [usize; 3]) -> Result<Volume> {
    let shape = || format!("{}x{}x{}", dims[0], dims[1], dims[2]);
    if dims.iter().any(|&n| n < 2) {
        return Err(Error::argument(field.name(), shape(), "at least 2 samples along each axis", "give a larger size"));
    }
    let mut values: Vec<f32> = Vec::new();
    let count = dims.iter().try_fold(1usize, |n, &d| n.checked_mul(d));
    if count.is_none_or(|n| values.try_reserve_exact(n).is_err()) {
        return Err(Error::Limit {
            what: format!("the field {} at {}", field.name(), shape()),
            needed: format!("{} bytes", 4.0 * dims.iter().map(|&d| d as f64).product::<f64>()),
            limit: "the memory of this machine".into(),
            remedy: "give a smaller size".into(),
        });
    }
    let (low, size) = (field.bounds().min, field.bounds().size());
    let intervals = DVec3::from_array(dims.map(|n| (n - 1) as f64));
    // (i·size)/(n−1), not i·spacing: the last sample then lies on the face to the last bit.
    let along = |a: usize| -> Vec<f64> { (0..dims[a]).map(|i| low[a] + i as f64 * size[a] / intervals[a]).collect() };
    let coordinates = [along(0), along(1), along(2)];
    field.fill([&coordinates[0], &coordinates[1], &coordinates[2]], &mut values);
    let world_from_grid = Affine::from_spacing(size / intervals, low).ok_or_else(|| {
        Error::argument(field.name(), format!("a box of {size}"), "a box with a positive volume", "correct the field")
    })?;
    let mut volume = Volume::new(dims, Samples::F32(values), world_from_grid)?;
    volume.name = field.name().into();
    volume.up = field.up();
    volume.solid = field.solid();
    volume.convex_side = field.convex_side();
    Ok(volume)
}

/// A field with the dimensions at which to sample it.
pub struct Named {
    /// The field.
    pub field: Box<dyn Field>,
    /// Samples along x, y, z.
    pub dims: [usize; 3],
}

impl Named {
    /// Samples the field.
    ///
    /// # Errors
    /// As [`sample`].
    pub fn sample(&self) -> Result<Volume> {
        sample(self.field.as_ref(), self.dims)
    }
}

/// The names that [`by_name`] knows.
pub const NAMES: [&str; 10] =
    ["bumpbox", "sphere", "bowl", "gyroid", "torus", "sphere-over-plane", "nucleons", "nucleons-2", "spray", "spray-2"];

/// The field that a specification names, such as `bumpbox`, `bumpbox:128` (the longest side,
/// cubic voxels) or `gyroid:256x256x128`; `None` where the part before the colon is no field, so
/// that the caller can take it for a file.
///
/// # Errors
/// When the size is not of that form or not in 2…[`LARGEST_SIZE`].
pub fn by_name(spec: &str) -> Result<Option<Named>> {
    let (name, size) = match spec.split_once(':') {
        Some((name, size)) => (name, Some(size)),
        None => (spec, None),
    };
    let field: Box<dyn Field> = match name {
        "bumpbox" => Box::new(BumpBox),
        "sphere" => Box::new(Sphere),
        "bowl" => Box::new(Bowl),
        "gyroid" => Box::new(Gyroid::default()),
        "torus" => Box::new(Torus::default()),
        "sphere-over-plane" => Box::new(SphereOverPlane::default()),
        "nucleons" => Box::new(Blobs::nucleons(0)),
        "nucleons-2" => Box::new(Blobs::nucleons(1)),
        "spray" => Box::new(Core),
        "spray-2" => Box::new(Blobs::droplets()),
        _ => return Ok(None),
    };
    let dims = match size {
        None => field.cubic_dims(DEFAULT_SIZE),
        Some(size) => {
            let numbers: Option<Vec<usize>> =
                size.split('x').map(|n| n.parse().ok().filter(|n| (2..=LARGEST_SIZE).contains(n))).collect();
            match numbers.as_deref() {
                Some(&[n]) => field.cubic_dims(n),
                Some(&[x, y, z]) => [x, y, z],
                _ => {
                    return Err(Error::argument(
                        name,
                        spec,
                        format!("{name}:N or {name}:XxYxZ with 2 to {LARGEST_SIZE} samples along a side"),
                        format!("for example {name}:128"),
                    ));
                }
            }
        }
    };
    Ok(Some(Named { field, dims }))
}

#[cfg(test)]
mod tests;
