//! Files that other programs open: GLB, PLY, PNG, VTI, NRRD, contact sheets, and the atomic write under
//! all of them. Knows nothing of volumes, spherical harmonics and light: it takes meshes,
//! images and attributes.
//!
//! | module | writes |
//! |---|---|
//! | [`gltf`] | a lit mesh as GLB (glTF 2.0), colours linear in `COLOR_0`; small for the web, or with a picture of the colours |
//! | [`usdz`] | a lit mesh with a picture of its colours as USDZ |
//! | [`simplify`], [`lightmap`] | nothing: they make meshes of fewer triangles, and pictures of colours |
//! | [`field`] | radiance on a lattice as VTI, NRRD and raw |
//! | [`hdr`] | an environment as Radiance picture |
//! | [`ply`] | the same mesh as binary PLY, colours 8-bit sRGB |
//! | [`png`] | an [`Image`] as 8-bit sRGB PNG |
//! | [`sheet`] | several images with labels as one [`Image`] ([`font`] draws the letters) |
//! | [`atomic`] | any file: whole or not at all |
//!
//! [`target`] names the files and refuses what cannot be written, [`inputs`] what is read as well.
//!
//! # Colour
//! Colours are linear Rec.709 everywhere until the last step. glTF `COLOR_0` *is* linear; PLY and
//! PNG are 8-bit sRGB through the one transfer function of [`crate::srgb`].
//!
//! # Place and size in glTF
//! glTF is Y-up, right-handed, in metres. `POSITION` = world − centre of
//! [`ExportMesh::box_in_world`], so that f32 stays exact far from the origin; the node carries
//! translation ∘ up-rotation ∘ scale and so puts the mesh back at its world place:
//! surfaces of one volume, written to several files, stay in register because they share the box.
//! [`gltf::scale`] decides the scale.

pub mod atomic;
pub mod field;
pub mod font;
pub mod gltf;
pub mod hdr;
pub mod image;
pub mod inputs;
pub mod lightmap;
mod nearest;
pub mod ply;
mod selection;
pub mod simplify;
pub mod stl;
pub mod png;
pub mod sheet;
pub mod target;
pub mod usdz;

pub use image::Image;
pub use selection::{Attributes, Selection};

use crate::error::{Error, Result};
use crate::geom::{Bounds, Up};
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Vertex positions, in world units.
#[derive(Clone, Copy, Debug)]
pub enum Positions<'a> {
    /// Positions in world.
    World(&'a [DVec3]),
    /// World − centre of [`ExportMesh::box_in_world`].
    FromCentre(&'a [Vec3]),
}

impl Positions<'_> {
    /// Number of vertices.
    pub fn len(&self) -> usize {
        match self {
            Self::World(p) => p.len(),
            Self::FromCentre(p) => p.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Position of a vertex relative to `centre_in_world`, rounded once, to f32.
    ///
    /// # Panics
    /// When `vertex` is out of range.
    #[inline]
    pub fn from_centre(&self, vertex: usize, centre_in_world: DVec3) -> Vec3 {
        match self {
            Self::World(p) => (p[vertex] - centre_in_world).as_vec3(),
            Self::FromCentre(p) => p[vertex],
        }
    }

    /// Position of a vertex in world.
    ///
    /// # Panics
    /// When `vertex` is out of range.
    #[inline]
    pub fn in_world(&self, vertex: usize, centre_in_world: DVec3) -> DVec3 {
        match self {
            Self::World(p) => p[vertex],
            Self::FromCentre(p) => p[vertex].as_dvec3() + centre_in_world,
        }
    }
}

/// Standard error of the radiance at each vertex, in the unit of the radiance.
#[derive(Clone, Copy, Debug)]
pub enum StandardError<'a> {
    /// One number for the three channels.
    Grey(&'a [f32]),
    /// One number for each channel.
    Rgb(&'a [[f32; 3]]),
}

impl StandardError<'_> {
    /// Number of vertices.
    pub fn len(&self) -> usize {
        match self {
            Self::Grey(e) => e.len(),
            Self::Rgb(e) => e.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A lit mesh as the writers take it. All slices but `triangles` have one entry to a vertex.
#[derive(Clone, Copy, Debug)]
pub struct ExportMesh<'a> {
    /// Name of the object in the file.
    pub name: &'a str,
    /// Vertex positions.
    pub positions: Positions<'a>,
    /// Unit normals in world, pointing to the lit side. Lengths within
    /// [`NORMAL_LENGTH_TOLERANCE`] of 1 are accepted and made unit to rounding.
    pub normals_in_world: &'a [Vec3],
    /// Vertex indices, counter-clockwise seen from the lit side, in a right-handed world.
    pub triangles: &'a [[u32; 3]],
    /// Exposed colour, linear Rec.709, each channel in [0, 1].
    pub colours: &'a [[f32; 3]],
    /// True radiance, linear Rec.709, any finite value, in the unit of the light.
    pub radiance: Option<&'a [[f32; 3]]>,
    /// Standard error of the radiance.
    pub standard_error: Option<StandardError<'a>>,
    /// The box that the file is centred on and sized by, in world: the volume's box, not the
    /// mesh's, so that several surfaces of one volume stay in register.
    pub box_in_world: Bounds,
    /// The world axis that points up.
    pub up: Up,
    /// How many metres one world unit is, where the source says so.
    pub metres_per_unit: Option<f64>,
}

/// How far from 1 a normal's length may be on input. Interpolated and rounded normals come
/// within 1e-6; more than this means a vector that was never normalised.
pub const NORMAL_LENGTH_TOLERANCE: f32 = 1e-3;

impl ExportMesh<'_> {
    /// Centre of the box.
    pub fn centre_in_world(&self) -> DVec3 {
        self.box_in_world.centre()
    }

    /// Whether there is no triangle to show.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// Checks every invariant that the fields name. The writers call it first, so that nothing
    /// is written of a mesh that is not sound.
    ///
    /// # Errors
    /// [`Error::Argument`] that names the attribute, the vertex and the value: slices of
    /// different lengths, an index out of range, a box that is not finite, a position that is
    /// not finite in f32, a normal that is not unit, a colour outside [0, 1] (never clamped),
    /// radiance that is not finite, a standard error that is negative or not finite.
    /// [`Error::Limit`] from 2³² − 1 vertices on.
    pub fn check(&self) -> Result<()> {
        self.check_counts()?;
        let (low, high) = (self.box_in_world.min, self.box_in_world.max);
        if !(low.is_finite() && high.is_finite() && self.box_in_world.size().is_finite() && low.cmple(high).all()) {
            return Err(Error::argument(
                "mesh box",
                format!("{low} to {high}"),
                "a finite box with min ≤ max",
                "give the world bounds of the volume",
            ));
        }
        if let Some(metres) = self.metres_per_unit
            && !(metres.is_finite() && metres > 0.0)
        {
            return Err(Error::argument("metres per unit", metres, "a positive finite number", "leave it unknown"));
        }
        let count = self.positions.len() as u32;
        let triangles = self.triangles.par_iter().with_min_len(TASK);
        if let Some(t) = triangles.position_first(|t| t.iter().any(|&i| i >= count)) {
            return Err(Error::argument(
                "mesh triangles",
                format!("vertices {:?} in triangle {t}", self.triangles[t]),
                format!("indices below the {count} vertices"),
                "this mesh is damaged; extract it again",
            ));
        }
        let centre = self.centre_in_world();
        check_each("mesh position", count, "numbers that are finite in 32 bits", |v| {
            let p = self.positions.from_centre(v, centre);
            (!p.is_finite()).then(|| p.to_string())
        })?;
        let unit = 1.0 - NORMAL_LENGTH_TOLERANCE..=1.0 + NORMAL_LENGTH_TOLERANCE;
        check_each("mesh normal", count, "a unit vector", |v| {
            let n = self.normals_in_world[v];
            (!unit.contains(&n.length())).then(|| n.to_string())
        })?;
        check_each("mesh colour", count, "linear channels in [0, 1]; lower the exposure", |v| {
            let c = self.colours[v];
            (!c.iter().all(|x| (0.0..=1.0).contains(x))).then(|| format!("{c:?}"))
        })?;
        if let Some(radiance) = self.radiance {
            check_each("mesh radiance", count, "finite channels", |v| {
                (!radiance[v].iter().all(|x| x.is_finite())).then(|| format!("{:?}", radiance[v]))
            })?;
        }
        let sound = |e: &f32| e.is_finite() && *e >= 0.0;
        if let Some(error) = self.standard_error {
            check_each("mesh standard error", count, "finite numbers, 0 or more", |v| match error {
                StandardError::Grey(e) => (!sound(&e[v])).then(|| e[v].to_string()),
                StandardError::Rgb(e) => (!e[v].iter().all(sound)).then(|| format!("{:?}", e[v])),
            })?;
        }
        Ok(())
    }

    fn check_counts(&self) -> Result<()> {
        let count = self.positions.len();
        // Index 2³² − 1 is glTF's primitive restart value.
        if count >= u32::MAX as usize || self.triangles.len() > (u32::MAX / 3) as usize {
            return Err(Error::Limit {
                what: "the mesh".into(),
                needed: format!("{count} vertices and {} triangles", self.triangles.len()),
                limit: format!("{} vertices and {} triangles", u32::MAX - 1, u32::MAX / 3),
                remedy: "extract a smaller part of the surface".into(),
            });
        }
        let attributes = [
            ("normals", Some(self.normals_in_world.len())),
            ("colours", Some(self.colours.len())),
            ("radiance", self.radiance.map(<[_]>::len)),
            ("standard errors", self.standard_error.map(|e| e.len())),
        ];
        for (name, length) in attributes {
            if length.is_some_and(|n| n != count) {
                return Err(Error::argument(
                    format!("mesh {name}"),
                    format!("{} entries", length.unwrap_or(0)),
                    format!("{count}, one to a vertex"),
                    "pass attributes of the same mesh",
                ));
            }
        }
        Ok(())
    }

    /// The normal of a vertex, unit to f32 rounding (length within 1e-6 of 1).
    #[inline]
    fn unit_normal(&self, vertex: usize) -> Vec3 {
        let n = self.normals_in_world[vertex].as_dvec3();
        (n * (1.0 / n.length())).as_vec3()
    }
}

/// Runs `fault` over all vertices and names the first that has one.
fn check_each(
    name: &'static str,
    count: u32,
    expected: &'static str,
    fault: impl Fn(usize) -> Option<String> + Sync,
) -> Result<()> {
    let vertices = (0..count as usize).into_par_iter().with_min_len(TASK);
    match vertices.find_map_first(|vertex| fault(vertex).map(|found| (vertex, found))) {
        None => Ok(()),
        Some((vertex, found)) => {
            let found = format!("{found} at vertex {vertex}");
            Err(Error::argument(name, found, expected, "correct the values before export"))
        }
    }
}

/// What needs the feature `meshopt` in a build without it.
#[cfg(not(feature = "meshopt"))]
fn without_meshopt(what: &str) -> Error {
    let remedy = "build isolume with the feature meshopt, which the program has by default";
    Error::argument("mesh", format!("{what} from a build without meshoptimizer"), "the feature meshopt", remedy)
}

/// A failed write to a stream; the path is added by [`Error::in_file`] where it is known.
fn write_error(source: std::io::Error) -> Error {
    Error::io("", "write", source)
}

/// Bytes made between two calls of the stream: enough work for all threads, and more than the buffer of
/// [`atomic::write`], which it therefore passes by.
const STREAM_BUFFER: usize = 1 << 21;

/// Records that one task makes.
const TASK: usize = 4096;

/// Writes `count` records of N bytes through a buffer of its own, so that a plain `File` is as
/// fast as a `BufWriter`.
fn write_records<const N: usize>(
    w: &mut (impl std::io::Write + ?Sized),
    count: usize,
    record: impl Fn(usize) -> [u8; N] + Sync,
) -> Result<()> {
    let at_once = STREAM_BUFFER / N;
    let mut buffer = vec![[0; N]; at_once.min(count)];
    for start in (0..count).step_by(at_once) {
        let part = &mut buffer[..at_once.min(count - start)];
        part.par_chunks_mut(TASK).enumerate().for_each(|(i, task)| {
            task.iter_mut().zip(start + i * TASK..).for_each(|(bytes, index)| *bytes = record(index));
        });
        w.write_all(part.as_flattened()).map_err(write_error)?;
    }
    Ok(())
}

/// Little-endian bytes of three floats.
#[inline]
fn bytes_of_triple(v: [f32; 3]) -> [u8; 12] {
    let mut bytes = [0; 12];
    for (to, value) in bytes.chunks_exact_mut(4).zip(v) {
        to.copy_from_slice(&value.to_le_bytes());
    }
    bytes
}

#[cfg(test)]
mod test_mesh;
#[cfg(test)]
mod tests;
