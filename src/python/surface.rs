//! Lit surfaces as arrays, pictures and files.

use super::error::OrRaise;
use super::watch;
use crate::error::{Error, Result};
use crate::export::simplify::Lod;
use crate::probe::Probe;
use crate::relight::{Material, look_up_transfer, transfer_at_vertices};
use crate::render::{Projection, View};
use crate::session::{
    Background, Groups, LightOptions, Lighting, Lit, LitOptions, Merged, MeshOptions, Part, PictureOptions, Session,
    Still, Surface as Unlit, Tone, total_json,
};
use crate::srgb::{byte_from_linear, linear_from_srgb};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyBytes;
use std::path::PathBuf;
use std::sync::Arc;

/// The isosurfaces of all volumes of a session that are lit together, and their arrays, which all surfaces made of them share.
pub(super) struct Ready {
    isovalues: Vec<f64>,
    parts: Arc<Vec<Part>>,
    points: PyOnceLock<Py<PyArray2<f32>>>,
    normals: PyOnceLock<Py<PyArray2<f32>>>,
    faces: PyOnceLock<Py<PyArray2<u32>>>,
}

impl Ready {
    pub(super) fn new(session: &Session<'_>, isovalue: f64) -> Result<Self> {
        let isovalues = session.isovalues(0, isovalue)?;
        let parts = session.members().iter().zip(&isovalues).map(|(member, &c)| Ok(member.select(member.extract(c)?)));
        let parts = Arc::new(parts.collect::<Result<Vec<_>>>()?);
        let (points, normals, faces) = (PyOnceLock::new(), PyOnceLock::new(), PyOnceLock::new());
        Ok(Self { isovalues, parts, points, normals, faces })
    }

    /// Of the first volume.
    pub(super) fn isovalue(&self) -> f64 {
        self.isovalues[0]
    }
}

/// What a light and a surface are made of.
struct Owner {
    session: Arc<Session<'static>>,
    ready: Arc<Ready>,
    probe: Arc<Probe>,
}

/// A surface and a light that belong together.
struct Pair<'a> {
    surface: Unlit<'a>,
    lighting: Lighting<'a>,
}

type LitOf<'a> = Lit<'a>;

self_cell::self_cell!(
    struct Standing {
        owner: Owner,
        #[covariant]
        dependent: Pair,
    }
);

self_cell::self_cell!(
    struct Cell {
        owner: Standing,
        #[covariant]
        dependent: LitOf,
    }
);

/// A lit surface.
#[pyclass(frozen, module = "isolume._isolume")]
pub(super) struct Surface {
    cell: Cell,
}

impl Surface {
    pub(super) fn new(
        session: Arc<Session<'static>>,
        ready: Arc<Ready>,
        probe: Arc<Probe>,
        light: &LightOptions,
        material: &Material,
        options: &LitOptions,
    ) -> Result<Self> {
        let standing = Standing::try_new(Owner { session, ready, probe }, |owner| -> Result<Pair<'_>> {
            let surface = owner.session.surface_of(owner.ready.parts.clone())?;
            Ok(Pair { surface, lighting: owner.session.light(&owner.probe, light)? })
        })?;
        let cell = Cell::try_new(standing, |standing| {
            let Pair { surface, lighting } = standing.borrow_dependent();
            surface.contract(lighting, material, &options.luminaires)?.look_up(options.exposure)
        })?;
        Ok(Self { cell })
    }

    fn lit(&self) -> &Lit<'_> {
        self.cell.borrow_dependent()
    }

    fn pair(&self) -> &Pair<'_> {
        self.cell.borrow_owner().borrow_dependent()
    }

    fn owner(&self) -> &Owner {
        self.cell.borrow_owner().borrow_owner()
    }

    fn merged(&self) -> Merged {
        Merged::new(&self.pair().surface)
    }
}

/// A picture of a surface as it is asked for.
struct Seen {
    view: View,
    width: usize,
    height: usize,
    perspective: Option<f64>,
    supersampling: usize,
    background: Background,
    tone: Tone,
    scale_bar: bool,
    cap: bool,
}

impl Seen {
    fn options(&self) -> PictureOptions {
        PictureOptions {
            width: self.width,
            height: self.height,
            view: self.view,
            projection: self.perspective.map_or(Projection::Orthographic, Projection::Perspective),
            cap: self.cap,
            supersampling: self.supersampling,
            background: self.background,
            tone: self.tone,
            scale_bar: self.scale_bar,
            ..PictureOptions::default()
        }
    }
}

fn tone_of(name: &str) -> Result<Tone> {
    match name {
        "none" => Ok(Tone::None),
        "reinhard" => Ok(Tone::Reinhard),
        "filmic" => Ok(Tone::Filmic),
        other => Err(Error::argument("tone", other, "none, reinhard or filmic", "leave it out for none")),
    }
}

/// An array that all who ask for it share, and nobody changes.
fn shared<'py, T: numpy::Element, const N: usize>(
    py: Python<'py>,
    held: &PyOnceLock<Py<PyArray2<T>>>,
    rows: impl FnOnce() -> Vec<[T; N]>,
) -> PyResult<Bound<'py, PyArray2<T>>> {
    let made = held.get_or_try_init(py, || -> PyResult<_> {
        let rows = rows();
        let array = PyArray1::from_slice(py, rows.as_flattened()).reshape([rows.len(), N])?;
        array.getattr("flags")?.setattr("writeable", false)?;
        Ok(array.unbind())
    })?;
    Ok(made.bind(py).clone())
}

fn rows<'py, T: numpy::Element, const N: usize>(py: Python<'py>, rows: &[[T; N]]) -> PyResult<Bound<'py, PyArray2<T>>> {
    PyArray1::from_slice(py, rows.as_flattened()).reshape([rows.len(), N])
}

#[pymethods]
impl Surface {
    /// World positions [n, 3].
    #[getter]
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        shared(py, &self.owner().ready.points, || {
            let merged = self.merged();
            let centre = merged.bounds.centre();
            merged.positions.iter().map(|p| (p.as_dvec3() + centre).as_vec3().to_array()).collect()
        })
    }

    /// Unit normals in world [n, 3].
    #[getter]
    fn normals<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        shared(py, &self.owner().ready.normals, || self.merged().normals.iter().map(|n| n.to_array()).collect())
    }

    /// Vertices of each triangle [m, 3].
    #[getter]
    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        shared(py, &self.owner().ready.faces, || self.merged().triangles)
    }

    /// Linear radiance [n, 3].
    #[getter]
    fn radiance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        rows(py, self.lit().radiance())
    }

    /// Its standard error [n].
    #[getter]
    fn stderr<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, self.lit().standard_errors())
    }

    /// Exposed colours in sRGB [n, 3].
    #[getter]
    fn rgb<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u8>>> {
        let colours: Vec<[u8; 3]> =
            py.detach(|| self.lit().colours().iter().map(|c| c.map(byte_from_linear)).collect());
        rows(py, &colours)
    }

    /// Exposed linear colours in [0, 1], [n, 3].
    #[getter]
    fn linear_rgb<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        rows(py, &self.lit().colours())
    }

    /// Isovalues of the volumes.
    #[getter]
    fn isovalues(&self) -> Vec<f64> {
        self.owner().ready.isovalues.clone()
    }

    #[getter]
    fn environment(&self) -> &str {
        &self.owner().probe.name
    }

    /// The exposure in stops.
    #[getter]
    fn exposure(&self) -> f64 {
        self.lit().exposure_in_stops()
    }

    /// How many metres a unit of world is, if known.
    #[getter]
    fn metres(&self) -> Option<f64> {
        self.owner().session.members()[0].volume().unit.metres()
    }

    /// The axis that points up, and the direction in world that is the front.
    #[getter]
    fn axes(&self) -> ([f64; 3], [f64; 3]) {
        let up = self.owner().session.up();
        let front = up.gltf_from_world().transpose() * glam::DVec3::Z;
        (up.axis().to_array(), front.to_array())
    }

    /// Noise of the bake under this light: root mean square over the mean radiance, and the median over the vertices.
    #[getter]
    fn noise(&self) -> (f64, f64) {
        (self.lit().rms_over_mean(), self.lit().relative_error().median)
    }

    /// The whole error from the check points, as JSON; None where the store has none.
    fn total_error(&self, py: Python<'_>) -> PyResult<Option<String>> {
        let found = watch::briefly(py, || Ok(self.lit().estimate_total_error()?))?;
        Ok(found.map(|total| total_json(&total).to_string()))
    }

    /// How it was made, as JSON.
    fn record(&self) -> String {
        self.lit().record().to_string()
    }

    /// What was done to the light.
    fn notes(&self) -> Vec<String> {
        let lit = self.lit();
        lit.notes().iter().map(|note| note.sentence(&self.owner().probe.name)).collect()
    }

    /// Transfer of each vertex: [n, layers, bands²] of a volume alone, [n, layers, 3, bands²] of a scene; 0 beyond the bands of a
    /// layer.
    fn transfer<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let session = &self.owner().session;
        let layers = &session.members()[0].store().layout().layers;
        let (count, channels) = (layers.len(), layers.channels());
        let most = layers.max_bands().pow(2);
        let numbers = watch::briefly(py, || {
            let mut all: Vec<f32> = Vec::new();
            for (member, part) in session.members().iter().zip(self.pair().surface.parts()) {
                let isosurface = part.isosurface();
                let mesh = isosurface.mesh();
                let groups = Groups::open(isosurface.transfer().unwrap_or(member.store()), &[])?;
                let textures = groups.textures()?;
                let found = match isosurface.transfer() {
                    Some(_) => transfer_at_vertices(&textures, &mesh.normals),
                    None => look_up_transfer(&textures, &mesh.positions_in_grid, &mesh.normals),
                };
                let planes = found?.planes;
                let stride = count * channels * most;
                let first = all.len();
                all.resize(first + mesh.normals.len() * stride, 0.0);
                let mut plane = planes.iter();
                for (k, &bands) in groups.layers().bands().iter().enumerate() {
                    for channel in 0..channels {
                        for i in 0..bands * bands {
                            let Some(values) = plane.next() else { continue };
                            let at = (k * channels + channel) * most + i;
                            values.iter().enumerate().for_each(|(v, value)| all[first + v * stride + at] = *value);
                        }
                    }
                }
            }
            Ok(all)
        })?;
        let vertices = numbers.len() / (count * channels * most).max(1);
        let shape = if channels == 1 { vec![vertices, count, most] } else { vec![vertices, count, channels, most] };
        PyArray1::from_vec(py, numbers).reshape(shape)
    }

    /// Writes .glb, .ply, .stl or .usdz.
    #[pyo3(signature = (path, *, radiance=false, transfer=false, float_colour=false, scale=None, lod=None, for_web=false, lightmap=None))]
    fn write(
        &self,
        py: Python<'_>,
        path: PathBuf,
        radiance: bool,
        transfer: bool,
        float_colour: bool,
        scale: Option<f64>,
        lod: Option<&str>,
        for_web: bool,
        lightmap: Option<u32>,
    ) -> PyResult<()> {
        let read = |text: &str| {
            let remedy = "leave it out for all triangles";
            text.parse::<Lod>().map_err(|expected| Error::argument("lod", text, expected, remedy))
        };
        let lod = lod.map(read).transpose().or_raise(py)?;
        let suffix = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
        let options = MeshOptions { radiance, float_colour, transfer, scale, lod, for_web, lightmap };
        watch::briefly(py, || match suffix.as_str() {
            "glb" => Ok(self.lit().write_gltf(&path, &options).map(drop)?),
            "ply" => Ok(self.lit().write_ply(&path, &options).map(drop)?),
            "stl" => Ok(self.lit().write_stl(&path, &options).map(drop)?),
            "usdz" => Ok(self.lit().write_usdz(&path, &options).map(drop)?),
            _ => {
                let expected = "a name ending in .glb, .ply, .stl, .usdz or .png";
                Err(Error::argument("path", path.display(), expected, "the ending decides the format").into())
            }
        })
    }

    /// A picture: pixels [height, width, 3 or 4] in sRGB, and the bytes of a PNG.
    #[pyo3(signature = (width, height, view, perspective, supersampling, background, tone, scale_bar, cap))]
    fn picture<'py>(
        &self,
        py: Python<'py>,
        width: usize,
        height: usize,
        view: (Option<String>, f64, f64),
        perspective: Option<f64>,
        supersampling: usize,
        background: Option<[f64; 4]>,
        tone: &str,
        scale_bar: bool,
        cap: bool,
    ) -> PyResult<(Bound<'py, PyArray3<u8>>, Bound<'py, PyBytes>)> {
        let seen = || -> Result<Seen> {
            let (name, azimuth, elevation) = &view;
            let view = match name {
                None => View { azimuth: *azimuth, elevation: *elevation },
                Some(name) => View::named(name, self.owner().session.up()).ok_or_else(|| {
                    let expected = "front, back, left, right, top, bottom or iso, or (azimuth, elevation)";
                    Error::argument("view", name, expected, "leave it out for iso")
                })?,
            };
            let linear = |[r, g, b, alpha]: [f64; 4]| {
                let [r, g, b] = [r, g, b].map(|v| linear_from_srgb(v) as f32);
                Background::Colour([r, g, b, alpha as f32])
            };
            Ok(Seen {
                view,
                width,
                height,
                perspective,
                supersampling: supersampling.max(1),
                background: background.map_or(Background::Environment, linear),
                tone: tone_of(tone)?,
                scale_bar,
                cap,
            })
        };
        let options = seen().or_raise(py)?.options();
        let (still, png): (Still, Vec<u8>) = watch::briefly(py, || {
            let still = self.lit().picture(&options)?;
            let png = self.lit().png(&still)?;
            Ok((still, png))
        })?;
        let channels = if still.is_transparent { 4 } else { 3 };
        let mut bytes = Vec::with_capacity(still.image.pixels().len() * channels);
        for &[r, g, b, alpha] in still.image.pixels() {
            bytes.extend([r, g, b].map(byte_from_linear));
            if channels == 4 {
                bytes.push((alpha.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
            }
        }
        let pixels = PyArray1::from_vec(py, bytes).reshape([height, width, channels])?;
        Ok((pixels, PyBytes::new(py, &png)))
    }
}
