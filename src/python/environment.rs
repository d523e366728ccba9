//! Environments: images and skies by name or path, and arrays.

use super::error::OrRaise;
use super::watch;
use crate::error::{Error, Result};
use crate::probe::{self, EMBEDDED, LatLong, Probe, ReadOptions};
use crate::scene::{Colormap, open_probe};
use numpy::{PyArray3, PyArrayMethods, PyReadonlyArray3};
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};

/// Environments by name that were used last: their pictures are decoded, or painted, once.
static LATEST: Mutex<Vec<(String, Arc<Probe>)>> = Mutex::new(Vec::new());
/// How many of them.
const MOST: usize = 8;

/// An environment: an image of distant light, and how far it is turned.
#[pyclass(frozen, module = "isolume._isolume")]
pub(super) struct Environment {
    probe: Arc<Probe>,
    rotate: f64,
}

impl Environment {
    pub(super) fn probe(&self) -> &Arc<Probe> {
        &self.probe
    }

    pub(super) fn rotate(&self) -> f64 {
        self.rotate
    }
}

fn open(name: &str, keep_negative: bool, layout: Option<&str>) -> Result<Arc<Probe>> {
    let layout = layout.map(str::parse).transpose()?;
    if keep_negative || layout.is_some() {
        return open_probe(name, keep_negative, layout).map(Arc::new);
    }
    let mut latest = LATEST.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(place) = latest.iter().position(|(of, _)| of == name) {
        let found = latest.remove(place);
        latest.push(found.clone());
        return Ok(found.1);
    }
    let Some(probe) = probe::by_name(name)? else { return open_probe(name, false, None).map(Arc::new) };
    let probe = Arc::new(probe);
    if latest.len() == MOST {
        latest.remove(0);
    }
    latest.push((name.to_owned(), probe.clone()));
    Ok(probe)
}

#[pymethods]
impl Environment {
    /// Opens an image file, a built-in environment or a sky by formula.
    #[staticmethod]
    #[pyo3(signature = (name, rotate=0.0, keep_negative=false, layout=None))]
    fn open(py: Python<'_>, name: &str, rotate: f64, keep_negative: bool, layout: Option<&str>) -> PyResult<Self> {
        let probe = watch::briefly(py, || Ok(open(name, keep_negative, layout)?))?;
        Ok(Self { probe, rotate })
    }

    /// An environment of an array [height, width, 3] of linear radiance, the top row first.
    #[staticmethod]
    #[pyo3(signature = (name, image, rotate=0.0))]
    fn from_array(py: Python<'_>, name: &str, image: PyReadonlyArray3<'_, f32>, rotate: f64) -> PyResult<Self> {
        let array = image.as_array();
        let (height, width, channels) = array.dim();
        let made = || {
            if channels != 3 {
                let found = format!("an array of {height} × {width} × {channels}");
                let expected = "height × width × 3: red, green and blue";
                return Err(Error::argument("environment", found, expected, "give linear radiance, the top row first"));
            }
            let numbers: Vec<f32> = array.iter().copied().collect();
            let pixels = numbers.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect();
            Ok(Probe::from_image(name, LatLong::new(width, height, pixels)?))
        };
        Ok(Self { probe: Arc::new(made().or_raise(py)?), rotate })
    }

    /// An environment of the bytes of an image file.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, name: &str, bytes: &[u8]) -> PyResult<Self> {
        let read = || Probe::from_bytes(name, bytes, &ReadOptions::default()).map_err(|e| e.in_file(name));
        Ok(Self { probe: Arc::new(watch::briefly(py, || Ok(read()?))?), rotate: 0.0 })
    }

    #[getter]
    fn name(&self) -> &str {
        &self.probe.name
    }

    #[getter(rotate)]
    fn rotate_of_it(&self) -> f64 {
        self.rotate
    }

    /// Linear radiance [height, width, 3].
    fn image<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let image = &self.probe.image;
        let numbers: Vec<f32> = image.pixels().iter().flatten().copied().collect();
        numpy::PyArray1::from_vec(py, numbers).reshape([image.height(), image.width(), 3])
    }
}

/// Names of the environments that come with the package.
#[pyfunction]
pub(super) fn built_in_environments() -> Vec<&'static str> {
    EMBEDDED.to_vec()
}

/// Names of the colour scales.
#[pyfunction]
pub(super) fn colormaps() -> Vec<&'static str> {
    Colormap::names().collect()
}
