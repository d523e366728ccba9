//! Stores, and the surfaces that are lit from them: what a store lacks is baked first, where that can be done.

use super::bake::{Filled, Place, Settings, fill};
use super::environment::Environment;
use super::error::OrRaise;
use super::surface::{Ready, Surface};
use super::watch;
use crate::bake::{Goal, Observer, Request, Writing, run};
use crate::cache::InUse;
use crate::cli::Failure;
use crate::error::{Error, Result};
use crate::level::Pyramid;
use crate::memory;
use crate::probe::Probe;
use crate::relight::{Exposure, Material};
use crate::scene::{Effects, Scene};
use crate::session::{LightOptions, LitOptions, LuminaireFactor, MaterialChoice, RelitField, Session};
use crate::sh::Window;
use crate::transfer::store::{EstimatorIdentity, Store as Held};
use crate::transport::Settings as Paths;
use crate::view::page::page_in_one_file;
use crate::view::{Coding, Options, Package, package_of, page_probes};
use crate::volume::Isovalue;
use numpy::{PyArray1, PyArray3, PyArray4, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

/// Isosurfaces that stay ready to be lit again.
const MOST_READY: usize = 4;
/// Most rays of a vertex where a surface is baked into a store that another process made.
const MOST_RAYS: u32 = 4096;

/// A store with what makes it grow.
#[pyclass(frozen, module = "isolume._isolume")]
pub(super) struct Store {
    path: PathBuf,
    /// What was baked into it here, and how.
    baked: Option<(Arc<Scene>, Settings, Place)>,
    reports: Vec<(u64, f64)>,
    notes: Vec<String>,
    open: Mutex<Open>,
    _in_use: Option<InUse>,
}

/// What is open of it.
#[derive(Default)]
struct Open {
    session: Option<Arc<Session<'static>>>,
    pyramid: Option<Arc<Pyramid>>,
    /// The latest last.
    ready: Vec<Arc<Ready>>,
}

/// Passes warnings on.
pub(super) fn warn(py: Python<'_>, texts: &[String]) -> PyResult<()> {
    if texts.is_empty() {
        return Ok(());
    }
    let warn = py.import("warnings")?.getattr("warn")?;
    let named = PyDict::new(py);
    named.set_item("stacklevel", 3)?;
    texts.iter().try_for_each(|text| warn.call((text,), Some(&named)).map(drop))
}

impl Store {
    /// The data of the page, with environments before those that every page has.
    fn package(
        &self,
        py: Python<'_>,
        isovalue: &str,
        envs: Vec<Bound<'_, Environment>>,
        texture_side: usize,
        volume_side: usize,
        half: bool,
    ) -> PyResult<Package> {
        let isovalue: Isovalue = isovalue.parse::<Isovalue>().or_raise(py)?;
        let probes: Vec<Probe> = envs.iter().map(|env| Probe::clone(env.get().probe())).collect();
        let coding = if half { Coding::Half } else { Coding::Byte };
        let options = Options { texture_side, volume_side, coding };
        watch::briefly(py, || {
            for (name, side) in [("texture_side", texture_side), ("volume_side", volume_side)] {
                if !(2..=2048).contains(&side) {
                    return Err(Error::argument(name, side, "2 to 2048", "leave it out for what a page takes").into());
                }
            }
            let store = Held::open(&self.path)?;
            let probes = page_probes(probes, &store)?;
            Ok(package_of(&store, &probes, ((isovalue, None), 0.0, false), &options)?)
        })
    }

    pub(super) fn of_bake(
        py: Python<'_>,
        filled: Filled,
        settings: Settings,
        place: Place,
        notes: Vec<String>,
    ) -> PyResult<Self> {
        let Filled { path, scene, in_use, reports, .. } = filled;
        let reports =
            reports.iter().map(|r| (r.summary.counts.rays, f64::from(r.summary.errors.rms() as f32))).collect();
        let made = Self {
            path,
            baked: Some((scene, settings, place)),
            reports,
            notes,
            open: Mutex::new(Open::default()),
            _in_use: in_use,
        };
        watch::briefly(py, || Ok(made.session()?))?;
        Ok(made)
    }

    /// The session, opened once and after each bake.
    fn session(&self) -> Result<Arc<Session<'static>>> {
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(session) = &open.session {
            return Ok(session.clone());
        }
        let store = Held::open(&self.path)?;
        let session = match &self.baked {
            // One volume alone need not be read again.
            Some((scene, ..)) if store.identity().scene.is_none() && scene.members().len() == 1 => {
                let volume = scene.members()[0].volume.clone();
                let pyramid = open.pyramid.get_or_insert_with(|| Arc::new(Pyramid::new(&volume))).clone();
                Session::sharing(store, volume, pyramid)
            }
            Some((scene, ..)) => {
                let geometry = scene.members()[0].geometry.clone();
                Session::owning(store)?.with_own_geometry(geometry)
            }
            None => Session::owning(store)?,
        };
        let session = Arc::new(session);
        open.session = Some(session.clone());
        Ok(session)
    }

    /// The isosurface of an isovalue of the first volume, ready to be lit.
    fn ready(&self, session: &Arc<Session<'static>>, isovalue: f64) -> Result<Arc<Ready>> {
        let find = |open: &Open| open.ready.iter().position(|ready| ready.isovalue() == isovalue);
        {
            let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(place) = find(&open) {
                let found = open.ready.remove(place);
                open.ready.push(found.clone());
                return Ok(found);
            }
        }
        let made = Arc::new(Ready::new(session, isovalue)?);
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        if find(&open).is_none() {
            if open.ready.len() == MOST_READY {
                open.ready.remove(0);
            }
            open.ready.push(made.clone());
        }
        Ok(made)
    }

    /// Forgets what was open: the store has grown.
    fn reopen(&self) {
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        open.session = None;
        open.ready.clear();
    }

    /// Bakes an isosurface that is missing.
    fn grow(&self, isovalue: f64, observer: &dyn Observer) -> std::result::Result<Vec<String>, Failure> {
        let filled = match &self.baked {
            Some((scene, settings, place)) => {
                fill(scene, Some(&[Isovalue::Value(isovalue)]), settings, place, observer)?.warnings
            }
            None => {
                let session = self.session()?;
                let member = &session.members()[0];
                let (store, volume) = (member.store(), member.volume());
                let identity = store.identity();
                if identity.scene.is_some() || !matches!(identity.estimator, EstimatorIdentity::Path { .. }) {
                    let remedy = "bake it: isolume.open(…).bake(…), or the program's bake";
                    let given = format!("{isovalue}, which the store does not hold");
                    return Err(Error::argument("isovalue", given, "one that it holds", remedy).into());
                }
                let settings = Paths {
                    layers: store.layout().layers.clone(),
                    rays: MOST_RAYS,
                    seed: identity.seed,
                    target: None,
                    positive: identity.positive,
                };
                let effects = Effects::default();
                let request = Request {
                    isovalues: Some(vec![isovalue]),
                    surfaces: true,
                    goal: Goal::usual(Vec::new()),
                    memory_limit: Some(memory::default_limit()),
                    writing: Writing { verify_all: false, ..Writing::default() },
                    ..Request::new(volume, &volume.name, store.layout().clone(), settings, &effects)
                };
                run(&request, &self.path, observer)?;
                Vec::new()
            }
        };
        self.reopen();
        Ok(filled)
    }

    /// The value of an isovalue as it was given, of the first volume or of the one that is named.
    fn value(&self, session: &Session<'_>, text: &str, volume: Option<&str>) -> Result<f64> {
        let of = volume.map_or(Ok(0), |name| session.member(name))?;
        let volume = session.members()[of].volume();
        let held = session.members()[of].store().holdings()?;
        let isovalue: Isovalue = text.parse()?;
        let value = match held.surfaces.first() {
            // What was asked for when it was baked.
            Some(&first) if isovalue == Isovalue::Auto && !held.all => first,
            _ => isovalue.resolve(volume, Some(volume.solid), None)?.value,
        };
        Ok(session.isovalues(of, value)?[0])
    }
}

/// Light and material as they were given.
struct Given {
    options: LightOptions,
    material: MaterialChoice,
    luminaires: Vec<LuminaireFactor>,
}

impl Given {
    fn new(
        rotate: f64,
        albedo: [f32; 3],
        colormap: Option<String>,
        emission: [f32; 3],
        exposure: Option<f64>,
        sun_split: &str,
        window: &str,
        luminaires: Vec<(String, [f64; 3])>,
    ) -> Result<Self> {
        let windows = [Window::None, Window::Lanczos, Window::Hanning, Window::Certified];
        let Some(&window) = windows.iter().find(|w| w.name() == window) else {
            let names = windows.map(|w| w.name()).join(", ");
            return Err(Error::argument("window", window, format!("one of {names}"), "leave it out for none"));
        };
        let exposure = match exposure {
            None => Exposure::Percentile,
            Some(stops) if stops.abs() <= 100.0 => Exposure::Stops(stops),
            Some(stops) => {
                let expected = "stops from -100 to 100, or None";
                return Err(Error::argument("exposure", stops, expected, "leave it out: the brightest become white"));
            }
        };
        let options =
            LightOptions { rotation_degrees: rotate, window, split_sun: sun_split.parse()?, ..LightOptions::default() };
        let luminaires =
            luminaires.into_iter().map(|(luminaire, factor)| LuminaireFactor { luminaire, factor }).collect();
        let material =
            MaterialChoice { albedo: Some(albedo), medium_albedo: None, colormap, emission: Some(emission), exposure };
        Ok(Self { options, material, luminaires })
    }

    fn material(&self, range: (f64, f64), isovalue: f64) -> std::result::Result<Material, Failure> {
        let albedo = self.material.rule(range)?.albedo(isovalue);
        Ok(Material::new(albedo, self.material.emission.unwrap_or([0.0; 3]))?)
    }
}

#[pymethods]
impl Store {
    /// Opens a store.
    #[staticmethod]
    fn open(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let (baked, open) = (None, Mutex::new(Open::default()));
        let made = Self { path, baked, reports: Vec::new(), notes: Vec::new(), open, _in_use: None };
        watch::briefly(py, || Ok(made.session()?))?;
        Ok(made)
    }

    #[getter]
    fn path(&self) -> PathBuf {
        self.path.clone()
    }

    /// What was noted while it was baked.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    /// Of each volume that was baked here: rays traced, and the root mean square of the errors.
    #[getter]
    fn reports(&self) -> Vec<(u64, f64)> {
        self.reports.clone()
    }

    /// Isovalues that it holds, and whether it holds all.
    fn holdings(&self, py: Python<'_>) -> PyResult<(Vec<f64>, bool)> {
        let held = watch::briefly(py, || Ok(self.session()?.members()[0].store().holdings()?))?;
        Ok((held.isovalues, held.all))
    }

    /// Names of the volumes.
    #[getter]
    fn volumes(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        let session = watch::briefly(py, || Ok(self.session()?))?;
        Ok(session.members().iter().map(|member| member.name().to_owned()).collect())
    }

    /// Spherical-harmonic bands of each layer.
    #[getter]
    fn bands(&self, py: Python<'_>) -> PyResult<Vec<usize>> {
        let session = watch::briefly(py, || Ok(self.session()?))?;
        Ok(session.members()[0].store().layout().layers.bands().to_vec())
    }

    /// A surface under an environment; baked first, if it is missing.
    #[pyo3(signature = (isovalue, volume, env, rotate, albedo, colormap, emission, exposure, sun_split, window, luminaires,
        progress))]
    fn surface(
        &self,
        py: Python<'_>,
        isovalue: &str,
        volume: Option<&str>,
        env: &Bound<'_, Environment>,
        rotate: f64,
        albedo: [f32; 3],
        colormap: Option<String>,
        emission: [f32; 3],
        exposure: Option<f64>,
        sun_split: &str,
        window: &str,
        luminaires: Vec<(String, [f64; 3])>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Surface> {
        let env = env.get();
        let rotate = rotate + env.rotate();
        let given = Given::new(rotate, albedo, colormap, emission, exposure, sun_split, window, luminaires);
        let given = given.or_raise(py)?;
        let probe = env.probe().clone();
        let attempt = || -> std::result::Result<Surface, Failure> {
            let session = self.session()?;
            let value = self.value(&session, isovalue, volume)?;
            let ready = self.ready(&session, value)?;
            let material = given.material(session.members()[0].volume().value_range(), value)?;
            let options = LitOptions { exposure: given.material.exposure, luminaires: given.luminaires.clone() };
            Ok(Surface::new(session, ready, probe.clone(), &given.options, &material, &options)?)
        };
        let pool = watch::pool(self.baked.as_ref().and_then(|(_, settings, _)| settings.threads)).or_raise(py)?;
        let unbaked = match py.detach(|| pool.install(attempt)) {
            Err(Failure::Library(Error::Unbaked { isovalue, .. })) => isovalue,
            other => return other.or_raise(py),
        };
        let (warnings, _) = watch::run(py, progress.as_ref(), &pool, |observer| self.grow(unbaked, observer))?;
        warn(py, &warnings)?;
        py.detach(|| pool.install(attempt)).or_raise(py)
    }

    /// The relit texture of the first volume: radiance [z, y, x, 3], valid [z, y, x], value [z, y, x], and the affine of its
    /// texels.
    #[pyo3(signature = (env, rotate, albedo, emission, window, luminaires))]
    fn textures<'py>(
        &self,
        py: Python<'py>,
        env: &Bound<'py, Environment>,
        rotate: f64,
        albedo: [f32; 3],
        emission: [f32; 3],
        window: &str,
        luminaires: Vec<(String, [f64; 3])>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let env = env.get();
        let rotate = rotate + env.rotate();
        let given = Given::new(rotate, albedo, None, emission, None, "off", window, luminaires).or_raise(py)?;
        let probe = env.probe().clone();
        let field = watch::briefly(py, || {
            let session = self.session()?;
            let (store, volume) = (session.members()[0].store(), session.members()[0].volume());
            let held = store.holdings()?;
            if !held.all && held.in_texture.is_empty() {
                let remedy = "bake one: bake(texture=1), or bake() for all isovalues";
                let given = "a store of vertices of isosurfaces alone";
                return Err(Error::argument("store", given, "a store with a texture", remedy).into());
            }
            let lighting = session.light(&probe, &given.options)?;
            let material = given.material(volume.value_range(), 0.0)?;
            Ok(RelitField::new(store, volume, &lighting, &material, &given.luminaires)?)
        })?;
        let [x, y, z] = field.dims;
        let radiance: Bound<'py, PyArray4<f32>> =
            PyArray1::from_slice(py, field.radiance.as_flattened()).reshape([z, y, x, 3])?;
        let valid: Bound<'py, PyArray3<u8>> = PyArray1::from_vec(py, field.valid).reshape([z, y, x])?;
        let value: Bound<'py, PyArray3<f32>> = PyArray1::from_vec(py, field.values).reshape([z, y, x])?;
        let (steps, origin) = (field.steps, field.origin);
        let row = |r: usize| [steps.col(0)[r], steps.col(1)[r], steps.col(2)[r], origin[r]];
        let all = PyDict::new(py);
        all.set_item("radiance", radiance)?;
        all.set_item("valid", valid)?;
        all.set_item("value", value)?;
        all.set_item("affine", [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]])?;
        Ok(all)
    }

    /// The page of a texture: its header as JSON and its payload, of 8 bits a coefficient or of 16.
    #[pyo3(signature = (isovalue, envs, texture_side, volume_side, half))]
    fn page<'py>(
        &self,
        py: Python<'py>,
        isovalue: &str,
        envs: Vec<Bound<'py, Environment>>,
        texture_side: usize,
        volume_side: usize,
        half: bool,
    ) -> PyResult<(String, Bound<'py, PyBytes>)> {
        let package = self.package(py, isovalue, envs, texture_side, volume_side, half)?;
        Ok((package.header.to_string(), PyBytes::new(py, &package.payload)))
    }

    /// The page of a texture in one file.
    #[pyo3(signature = (isovalue, envs, texture_side, volume_side))]
    fn html(
        &self,
        py: Python<'_>,
        isovalue: &str,
        envs: Vec<Bound<'_, Environment>>,
        texture_side: usize,
        volume_side: usize,
    ) -> PyResult<String> {
        let package = self.package(py, isovalue, envs, texture_side, volume_side, false)?;
        watch::briefly(py, || Ok(page_in_one_file(&package)?))
    }

    /// The axis that points up.
    #[getter]
    fn up(&self, py: Python<'_>) -> PyResult<&'static str> {
        let up = watch::briefly(py, || Ok(self.session()?))?.up();
        Ok(if up.is_anatomical() { "anatomical" } else { up.name() })
    }
}
