//! Volumes and scenes, from files, fields and arrays.

use super::array::{Found, samples_of};
use super::bake::{Place, Settings, estimator, fill, pool_of};
use super::environment::Environment;
use super::error::OrRaise;
use super::store::{Store, warn};
use super::watch;
use crate::error::{Error, Result};
use crate::geom::{Affine, Up};
use crate::scene::{Effects, Front, Member, Scene, TextureSize, VolumeOptions};
use crate::volume::array::{Placement, address, from_numbers, from_owner, metres_in};
use crate::volume::{Channel, Choice, Isovalue, LengthUnit, Solid, Spacing};
use glam::{DMat3, DVec3};
use numpy::PyUntypedArray;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// What is lit: a volume, or the volumes of a scene with what stands around them.
#[pyclass(frozen, module = "isolume._isolume")]
pub(super) struct Volume {
    scene: Arc<Scene>,
}

/// How a volume is to be understood.
fn options(solid: Option<&str>, up: Option<&str>, choice: Choice, keep_largest: bool) -> Result<VolumeOptions> {
    let solid = match solid {
        None => None,
        Some("above") => Some(Solid::Above),
        Some("below") => Some(Solid::Below),
        Some(other) => {
            let remedy = "leave it out for what the isovalue decides";
            return Err(Error::argument("solid", other, "above or below", remedy));
        }
    };
    let (up, front) = match up {
        None => (None, None),
        Some("anatomical") => (None, Some(Front::Anatomical)),
        Some(axis) => {
            let found = Up::named(axis).ok_or_else(|| {
                let expected = "x, y, z, -x, -y, -z, or anatomical (z, the front anterior)";
                Error::argument("up", axis, expected, "leave it out for z")
            })?;
            (Some(found), None)
        }
    };
    Ok(VolumeOptions { solid, up, front, choice, keep_largest, ..VolumeOptions::default() })
}

fn unit_of(unit: Option<&str>) -> Result<Option<f64>> {
    let Some(name) = unit else { return Ok(None) };
    metres_in(name).map(Some).ok_or_else(|| {
        let expected = "m, cm, mm, um, nm, pm, A, bohr, in or km";
        Error::argument("unit", name, expected, "leave it out where lengths have no unit")
    })
}

impl Volume {
    fn first(&self) -> &Member {
        &self.scene.members()[0]
    }
}

#[pymethods]
impl Volume {
    /// Opens a file, an analytic field or a scene.
    #[staticmethod]
    #[pyo3(signature = (name, *, solid=None, up=None, spacing=None, unit=None, channel=None, timepoint=None, array=None,
        keep_largest=false, allow_outside=false))]
    fn open(
        py: Python<'_>,
        name: &str,
        solid: Option<&str>,
        up: Option<&str>,
        spacing: Option<[f64; 3]>,
        unit: Option<&str>,
        channel: Option<&str>,
        timepoint: Option<usize>,
        array: Option<String>,
        keep_largest: bool,
        allow_outside: bool,
    ) -> PyResult<Self> {
        let made = || -> Result<Scene> {
            let metres = unit_of(unit)?;
            let choice = Choice {
                channel: channel.map(str::parse::<Channel>).transpose()?,
                timepoint,
                array,
                spacing: spacing.map(|along| Spacing::new(along, metres)).transpose()?,
                allow_outside,
                ..Choice::default()
            };
            Scene::open_with(name, &options(solid, up, choice, keep_largest)?, &Effects::default())
        };
        Ok(Self { scene: Arc::new(watch::briefly(py, || Ok(made()?))?) })
    }

    /// A volume of a C-contiguous array [z, y, x]; `frozen` is the user's, which becomes read-only meanwhile. `affine` are the first
    /// three rows of the map from (x, y, z) in samples to world.
    #[staticmethod]
    #[pyo3(signature = (array, frozen, affine, *, name, unit=None, slope=1.0, inter=0.0, solid=None, up=None, keep_largest=false))]
    fn from_array(
        array: &Bound<'_, PyUntypedArray>,
        frozen: &Bound<'_, PyAny>,
        affine: [[f64; 4]; 3],
        name: String,
        unit: Option<&str>,
        slope: f64,
        inter: f64,
        solid: Option<&str>,
        up: Option<&str>,
        keep_largest: bool,
    ) -> PyResult<Self> {
        let py = array.py();
        let options = options(solid, up, Choice::default(), keep_largest).or_raise(py)?;
        let unit = unit_of(unit).or_raise(py)?.map_or(LengthUnit::Unknown, LengthUnit::Metres);
        let column = |c: usize| DVec3::new(affine[0][c], affine[1][c], affine[2][c]);
        let world_from_grid = Affine::new(DMat3::from_cols(column(0), column(1), column(2)), column(3));
        let world_from_grid = world_from_grid.ok_or_else(|| {
            let expected = "a finite map that keeps the axes apart";
            Error::argument("affine", format!("{affine:?}"), expected, "check the spacing, or the matrix")
        });
        let world_from_grid = world_from_grid.or_raise(py)?;
        let (dims, found) = samples_of(array, frozen)?;
        let solid = options.solid.unwrap_or_default();
        let placement = Placement { name, world_from_grid, unit, slope, inter, solid };
        let made = move || -> Result<Scene> {
            let volume = match found {
                Found::Shared(owner) => from_owner(dims, owner, placement)?,
                Found::Copied(numbers) => from_numbers(dims, numbers, placement)?,
            };
            Ok(Scene::of_member(Member::of_with(volume, &options)?))
        };
        Ok(Self { scene: Arc::new(watch::briefly(py, || Ok(made()?))?) })
    }

    /// Bakes into a store and returns it.
    #[pyo3(signature = (isovalues, *, error=None, time=None, rays=None, layers=4, bands=None, texture=None, positive=false,
        estimator_name="path", lights=Vec::new(), albedo=0.7, store=None, cache=None, progress=None, threads=None, seed=0,
        memory_limit=None))]
    fn bake(
        &self,
        py: Python<'_>,
        isovalues: Option<Vec<String>>,
        error: Option<f32>,
        time: Option<f64>,
        rays: Option<u32>,
        layers: usize,
        bands: Option<usize>,
        texture: Option<String>,
        positive: bool,
        estimator_name: &str,
        lights: Vec<Bound<'_, Environment>>,
        albedo: f32,
        store: Option<PathBuf>,
        cache: Option<PathBuf>,
        progress: Option<Py<PyAny>>,
        threads: Option<usize>,
        seed: u64,
        memory_limit: Option<u64>,
    ) -> PyResult<Store> {
        let lights = lights.iter().map(|light| (light.get().probe().clone(), light.get().rotate())).collect();
        let estimator = estimator(estimator_name).or_raise(py)?;
        let texture = texture.map(|text| {
            let size = text.parse::<TextureSize>();
            size.map_err(|expected| Error::argument("texture", &text, expected, "1 is the resolution of the data"))
        });
        let texture = texture.transpose().or_raise(py)?;
        let settings = Settings {
            error,
            time,
            rays,
            layers,
            bands,
            texture,
            positive,
            estimator,
            seed,
            memory_limit,
            threads,
            lights,
            albedo,
        };
        let isovalues =
            isovalues.map(|all| all.iter().map(|text| text.parse::<Isovalue>()).collect::<Result<Vec<_>>>());
        let isovalues = isovalues.transpose().or_raise(py)?;
        let place = store.map_or(Place::Cache(cache), Place::Store);
        let pool = pool_of(&settings).or_raise(py)?;
        let (filled, notes) = watch::run(py, progress.as_ref(), &pool, |observer| {
            fill(&self.scene, isovalues.as_deref(), &settings, &place, observer)
        })?;
        warn(py, &filled.warnings)?;
        Store::of_bake(py, filled, settings, place, notes)
    }

    /// Samples along x, y, z.
    #[getter]
    fn dims(&self) -> [usize; 3] {
        self.first().volume.dims()
    }

    /// The type of the samples, as NumPy calls it.
    #[getter]
    fn dtype(&self) -> &'static str {
        self.first().volume.samples().type_name()
    }

    #[getter]
    fn name(&self) -> String {
        self.first().volume.name.clone()
    }

    /// Names of the volumes.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.scene.members().iter().map(|member| member.volume.name.clone()).collect()
    }

    /// Smallest and largest value.
    #[getter]
    fn range(&self) -> (f64, f64) {
        self.first().volume.value_range()
    }

    /// From (x, y, z) in samples to world: four rows.
    #[getter]
    fn affine(&self) -> [[f64; 4]; 4] {
        let map = self.first().volume.world_from_grid();
        let (linear, offset) = (map.linear(), map.offset());
        let row = |r: usize| [linear.col(0)[r], linear.col(1)[r], linear.col(2)[r], offset[r]];
        [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
    }

    /// Smallest and largest corner of the box in world.
    #[getter]
    fn bounds(&self) -> ([f64; 3], [f64; 3]) {
        let bounds = self.first().volume.world_bounds();
        (bounds.min.to_array(), bounds.max.to_array())
    }

    /// How many metres a unit of world is, if known.
    #[getter]
    fn metres(&self) -> Option<f64> {
        self.first().volume.unit.metres()
    }

    #[getter]
    fn up(&self) -> &'static str {
        let up = self.first().volume.up;
        if up.is_anatomical() { "anatomical" } else { up.name() }
    }

    /// What was noticed when it was read.
    #[getter]
    fn notes(&self) -> Vec<String> {
        let of_volume = |member: &Member| member.volume.notes.iter().map(|note| note.text.clone()).collect::<Vec<_>>();
        self.scene.members().iter().flat_map(of_volume).collect()
    }

    /// Where the first sample lies in memory.
    #[getter]
    fn address(&self) -> usize {
        address(self.first().volume.samples())
    }

    /// The value that an isovalue such as "auto", "40%" or "otsu" means, which side is matter, and why.
    fn isovalue(&self, py: Python<'_>, text: &str) -> PyResult<(f64, &'static str, Option<String>)> {
        let chosen = watch::briefly(py, || Ok(self.first().choose(text.parse()?)?))?;
        let side = if chosen.solid == Solid::Above { "above" } else { "below" };
        Ok((chosen.value, side, chosen.reason))
    }
}
