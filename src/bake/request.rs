//! A bake as asked for: what decides the store's numbers, and what it takes.

use super::deal::Dealt;
use super::memory::{bytes_of_bake, crossed_cells};
use super::pending::{Pending, texels_in};
use super::scene::bytes_of_scene_texel;
use super::{Goal, scene};
use crate::error::{Error, Result};
use crate::level::{Pyramid, bytes_of_field};
use crate::memory;
use crate::scene::geometry::Geometry;
use crate::scene::{Effects, SunSplit};
use crate::surface::extract_without_normals;
use crate::transfer::store::{Baked, EstimatorIdentity, Identity, Shadows, Store, Surroundings};
use crate::transfer::{Lattice, Layout, Selection, texels_of_isosurfaces};
use crate::transport::{
    Bake, GatherSettings, PhotonBake, PhotonScene, Settings, SpecularPhotons, SurfacePoints, Tolerance, cache_memory,
    most_in_work, needs_photons,
};
use crate::volume::{Shadowing, Volume};
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::fmt::Display;
use std::path::Path;
use std::str::FromStr;
use std::sync::OnceLock;

/// Photons sent out for light that no path finds ([`needs_photons`]).
const CAUSTIC_PHOTONS: u32 = 1 << 22;

/// How a store is written and what of it is verified.
#[derive(Clone, Copy, Debug)]
pub struct Writing {
    /// Whether writes wait for the disk.
    pub sync: bool,
    /// Whether damaged metadata is written anew without proof of whose store it is.
    pub repair: bool,
    /// Whether every chunk is verified, not only those that are asked for.
    pub verify_all: bool,
}

impl Writing {
    /// Of stores in the cache folder: they can be made again, their name says whose they are, and a command looks only at
    /// what it needs of them.
    #[doc(hidden)]
    pub fn of_cache() -> Self {
        Self { sync: false, repair: true, verify_all: false }
    }
}

impl Default for Writing {
    fn default() -> Self {
        Self { sync: true, repair: false, verify_all: true }
    }
}

/// A bake as asked for: [`Request::new`] is one of all isosurfaces by path tracing; set what is to be otherwise.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Request<'a> {
    /// The volume.
    pub volume: &'a Volume,
    /// Name of the input without directories, for the record.
    pub label: &'a str,
    /// Lattice and layers of the texture; of three channels where something stands around the volume
    /// ([`super::layout_of_scene`]).
    pub layout: Layout,
    /// Layers, rays and seed; without a target, which follows from the goal.
    pub settings: Settings,
    /// Where texels stop.
    pub goal: Goal,
    /// What estimates the transfer.
    pub estimator: Estimator,
    /// In the file's values; `None` for all.
    pub isovalues: Option<Vec<f64>>,
    /// Whether named isovalues are baked at the vertices of their isosurfaces, instead of in the texture that all isovalues
    /// share.
    pub surfaces: bool,
    /// Only a part of the chunks.
    pub share: Option<Share>,
    /// Most bytes to use; none where there is no limit.
    pub memory_limit: Option<u64>,
    /// Effects that were switched on or off by hand.
    pub effects: &'a Effects,
    /// What is known of the light to come; it decides nothing but the plan.
    pub hints: Hints,
    /// How the store is written.
    pub writing: Writing,
    /// Of a texture that leaves out texels that can be interpolated: the error that those may have, relative to the root mean square of
    /// the transfer.
    pub adaptive: Option<f64>,
    /// That error as transfer, once it is known how large this is.
    pub(crate) tolerance: Option<&'a Tolerance>,
    /// Only these chunks, by linear index; all where there is no list.
    pub(crate) only: Option<BTreeSet<usize>>,
    /// What the share has to do of the texture or surface that is baked; set where there is a share.
    pub(crate) dealt: Option<&'a Dealt>,
    /// What stands around the volume; then the layout is coloured.
    pub geometry: Option<&'a Geometry>,
    /// The vertices that the layout is of, in a request for one surface.
    pub(crate) points: Option<&'a SurfacePoints>,
    /// Light that no path finds, once photons have brought it.
    pub(crate) specular: Option<&'a SpecularPhotons>,
    /// Part of the time that is left which it may take: the rest is for surfaces to come.
    pub(crate) time_share: f64,
    /// Isovalues of which the cells are counted that their surfaces cross, and how many those are.
    pub(crate) counted: OnceLock<(Vec<f64>, Vec<u64>)>,
}

/// What is known before relighting of what it will ask for; it decides nothing but the plan.
#[derive(Clone, Copy, Debug, Default)]
pub struct Hints {
    /// Largest albedo of any channel and isovalue.
    pub albedo: Option<f32>,
    /// Largest emission of any channel and isovalue.
    pub emission: Option<f32>,
    /// Which lamps are lit apart.
    pub sun_split: SunSplit,
    /// Whether the plan is to be shown.
    pub shown: bool,
}

/// An estimator of the transfer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Estimator {
    /// Path tracing within each level set: unbiased
    #[default]
    Path,
    /// The texture as radiance cache: less noise in less time where light bounces often, with a bias that is printed
    Gather,
    /// Flattened photon mapping, for study: light spread over the nearest photons, with a bias that no error bar holds
    Photon,
}

impl Estimator {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Path => "path",
            Self::Gather => "gather",
            Self::Photon => "photon",
        }
    }
}

/// One of several parts into which the work of a bake is dealt out: chunks, or octants of chunks, largest first to the share with the
/// least so far. What a share holds follows from what is asked alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Share {
    /// From 1.
    pub index: usize,
    /// How many there are.
    pub of: usize,
}

impl FromStr for Share {
    /// What to give instead.
    type Err = String;

    /// Reads a share such as 1/3.
    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let numbers = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match numbers {
            Some((index, of)) if 1 <= index && index <= of && of <= 4096 => Ok(Share { index, of }),
            _ => Err("give i/n with i from 1 to n, such as 1/3, and n at most 4096".into()),
        }
    }
}

impl<'a> Request<'a> {
    /// A bake by path tracing of all isosurfaces, without a goal. `label`: the name of the input without directories, for the
    /// record.
    pub fn new(volume: &'a Volume, label: &'a str, layout: Layout, settings: Settings, effects: &'a Effects) -> Self {
        Self {
            volume,
            label,
            layout,
            settings,
            goal: Goal::default(),
            estimator: Estimator::Path,
            isovalues: None,
            surfaces: false,
            share: None,
            memory_limit: None,
            effects,
            hints: Hints::default(),
            writing: Writing::default(),
            adaptive: None,
            tolerance: None,
            only: None,
            dealt: None,
            geometry: None,
            points: None,
            specular: None,
            time_share: 1.0,
            counted: OnceLock::new(),
        }
    }
}

impl<'a> Request<'a> {
    /// What decides the store's numbers.
    #[doc(hidden)]
    pub fn identity(&self) -> Identity {
        let (positive, seed) = (self.settings.positive, self.settings.seed);
        let identity = Identity::new(self.volume, &self.layout, self.estimator_identity(), positive, seed);
        let scene = self.geometry.map(|geometry| self.scene_identity(geometry));
        Identity { adaptive: self.adaptive, scene, ..identity }
    }

    /// The estimator as it stands in stores.
    fn estimator_identity(&self) -> EstimatorIdentity {
        if let Some(geometry) = self.geometry {
            let alone = geometry.parts() == 0 && geometry.luminaires().is_empty();
            let among = if alone { Surroundings::Volumes } else { Surroundings::Walls };
            let caustics = self.has_caustics();
            let photons = (caustics && !needs_photons(geometry).is_empty()).then_some(CAUSTIC_PHOTONS);
            if self.estimator == Estimator::Gather {
                let GatherSettings { passes, cache_rays, .. } = self.gather_settings();
                let (passes, rays, isovalues) = (passes - 1, self.settings.rays, self.isovalues.clone());
                return EstimatorIdentity::SceneGather {
                    among,
                    caustics,
                    photons,
                    passes,
                    cache_rays,
                    rays,
                    isovalues,
                };
            }
            return EstimatorIdentity::ScenePath { among, caustics, photons };
        }
        let shadowing = match self.volume.shadowing {
            Shadowing::Ignored => Shadows::Ignored,
            Shadowing::Traced => Shadows::Traced,
            Shadowing::Found if self.volume.is_convex() => Shadows::Convex,
            Shadowing::Found => Shadows::Found,
        };
        match self.estimator {
            Estimator::Path => EstimatorIdentity::Path { shadowing },
            Estimator::Photon => {
                EstimatorIdentity::Photon { sent: self.photons().photons, nearest: self.settings.rays, shadowing }
            }
            Estimator::Gather => {
                let how = self.gather_settings();
                EstimatorIdentity::Gather {
                    passes: how.passes - 1,
                    cache_rays: how.cache_rays,
                    rays: self.settings.rays,
                    isovalues: self.isovalues.clone(),
                    shadowing,
                }
            }
        }
    }

    /// A photon for every 16th ray that `path` would trace: they take memory, and many serve several texels.
    pub(super) fn photons(&self) -> PhotonBake {
        let texels: u64 = self.layout.lattice.texels().iter().map(|&m| m as u64).product();
        let made = PhotonBake::for_texels(texels, self.settings.rays);
        PhotonBake { memory_limit: self.memory_limit.unwrap_or(made.memory_limit), ..made }
    }

    pub(super) fn gather_settings(&self) -> GatherSettings {
        let default = GatherSettings::default();
        GatherSettings { memory_limit: self.memory_limit.unwrap_or(default.memory_limit), ..default }
    }

    /// What the estimators read, of some texels.
    #[doc(hidden)]
    pub fn bake<'b>(&'b self, pyramid: &'b Pyramid, settings: &'b Settings, selection: &'b Selection) -> Bake<'b> {
        let caustics = self.has_caustics();
        let bake = Bake::new(self.volume, pyramid, &self.layout, settings, selection).among(self.geometry);
        let (specular, tolerance) = (self.specular.map(|s| s as _), self.tolerance);
        Bake { caustics, specular, points: self.points, tolerance, ..bake }
    }

    /// Photons of light that paths cannot find, near the isovalue of the surface that is baked or of all; none where there is no
    /// such light.
    ///
    /// # Errors
    /// As [`SpecularPhotons::new`].
    #[doc(hidden)]
    pub fn specular_photons(&self, pyramid: &Pyramid) -> Result<Option<SpecularPhotons>> {
        if !self.has_caustics() {
            return Ok(None);
        }
        let scene = PhotonScene { volume: self.volume, pyramid, geometry: self.geometry, light: None };
        let isovalue = self.points.map(|points| points.isovalue);
        let limit = self.memory_limit.unwrap_or(2 << 30);
        let sent = (CAUSTIC_PHOTONS, self.settings.seed);
        SpecularPhotons::new(&scene, self.layout.layers.len(), isovalue, sent, limit)
    }

    /// Whether light of luminaires counts that comes by way of mirrors and glass.
    pub(super) fn has_caustics(&self) -> bool {
        self.effects.switched("caustics") != Some(false)
    }

    /// The isovalues of the surfaces that are baked, ascending; none where it is the texture.
    pub(super) fn surfaces(&self) -> Option<Vec<f64>> {
        let mut list = self.isovalues.clone().filter(|_| self.surfaces)?;
        list.sort_by(f64::total_cmp);
        list.dedup();
        Some(list)
    }

    /// The part of it that is about one surface.
    pub(super) fn of_surface<'b>(&self, points: &'b SurfacePoints, time_share: f64) -> Request<'b>
    where
        'a: 'b,
    {
        let lattice = Lattice::of_vertices(points.positions_in_grid.len());
        let layout = Layout { lattice, layers: self.layout.layers.clone() };
        let (isovalues, points) = (Some(vec![points.isovalue]), Some(points));
        Request { layout, isovalues, points, time_share, surfaces: false, adaptive: None, ..self.clone() }
    }

    /// The texels that the isovalues asked for need; all vertices of a surface.
    #[doc(hidden)]
    pub fn selection(&self) -> Selection {
        if self.points.is_some() {
            return Selection::all(self.layout.lattice);
        }
        texels_of_isosurfaces(self.volume, self.layout.lattice, self.isovalues.as_deref())
    }

    /// Texels, or vertices of surfaces, of which the store at `path` has nothing, however exact; all that are needed if there
    /// is none.
    ///
    /// # Errors
    /// When the store is there and cannot be read; damaged metadata is mended by the bake and no error.
    #[doc(hidden)]
    pub fn texels_missing(&self, path: &Path) -> Result<u64> {
        let all = || match self.surfaces() {
            None => Ok(self.selection().len()),
            Some(list) => list.iter().map(|&c| vertices_of(self.volume, c)).sum(),
        };
        if path.symlink_metadata().is_err() {
            return all();
        }
        let store = match Store::open(path) {
            Ok(store) => store,
            // The bake mends it first.
            Err(Error::Format { .. }) if path.is_dir() => return all(),
            Err(other) => return Err(other),
        };
        let among = self.geometry.and_then(Geometry::among);
        if among.is_some() && !store.volumes()?.contains(&self.volume.name) {
            return all();
        }
        let store = if among.is_some() { store.of_volume(&self.volume.name)? } else { store };
        let Some(list) = self.surfaces() else { return missing_in(self, &store) };
        let mut texels = 0;
        for c in list {
            texels += match store.surface(c)? {
                None => vertices_of(self.volume, c)?,
                // Only how many there are counts here.
                Some(surface) => {
                    let count = surface.layout().lattice.texels()[0];
                    let places = vec![[0.0; 3]; count];
                    let points = SurfacePoints { isovalue: c, positions_in_grid: places, ..SurfacePoints::default() };
                    missing_in(&self.of_surface(&points, 1.0), &surface)?
                }
            };
        }
        Ok(texels)
    }

    /// About the bytes that the bake needs, groups and partners of its scene included.
    #[doc(hidden)]
    pub fn bytes_needed(&self) -> u64 {
        self.forecast(None)
    }

    /// The same where it runs on so many threads.
    #[doc(hidden)]
    pub fn bytes_needed_by(&self, threads: usize) -> u64 {
        self.forecast(Some(threads))
    }

    fn forecast(&self, threads: Option<usize>) -> u64 {
        let isovalues = self.isovalues.as_ref().map(|list| (list.len(), self.crossed(list)));
        let isovalues = isovalues.as_ref().map(|(count, crossed)| (*count, &crossed[..]));
        let needed = bytes_of_bake(self.volume, &self.layout, isovalues, self.surfaces, threads);
        let groups = self.geometry.map_or(0, |geometry| scene::bytes_of_groups(&self.layout.layers, geometry));
        // Partners with their pyramids, as the volume itself.
        let partners = self.geometry.map_or(&[][..], Geometry::partners).iter();
        let partners: u64 = partners.map(|p| bytes_of_field(&p.volume)).sum();
        // Chunks of an adaptive texture are worked on with what closes them: twice as many bricks.
        let closed = if self.adaptive.is_some() { (2 * most_in_work(threads) as u64) << 15 } else { 0 };
        // 16 chunks of 32³ texels are held.
        let closed = closed * bytes_of_scene_texel(&self.layout.layers, self.geometry);
        needed + partners + closed + groups * (16 << 15) + self.bytes_of_cache()
    }

    /// Those of the cache of `gather`.
    fn bytes_of_cache(&self) -> u64 {
        if self.estimator != Estimator::Gather {
            return 0;
        }
        let (lattice, bricks) = (&self.layout.lattice, self.selection().bricks().len() as u64);
        cache_memory(lattice, &self.layout.layers, self.geometry, bricks, &self.gather_settings())
    }

    /// [`crossed_cells`], counted once for a list of isovalues, however often the memory is asked for.
    fn crossed(&self, isovalues: &[f64]) -> Cow<'_, [u64]> {
        let count = || crossed_cells(self.volume, isovalues);
        let (known, cells) = self.counted.get_or_init(|| (isovalues.to_vec(), count()));
        if known == isovalues { Cow::Borrowed(cells) } else { Cow::Owned(count()) }
    }

    /// Refuses samples, of the volume or of its partners, whose files another program has changed since they were opened.
    ///
    /// # Errors
    /// With the name of the file.
    pub(super) fn check_samples(&self) -> Result<()> {
        let partners = self.geometry.map_or(&[][..], Geometry::partners).iter();
        let mut all = std::iter::once(self.volume).chain(partners.map(|partner| &*partner.volume));
        all.try_for_each(|volume| volume.samples().check())
    }

    /// Refuses to need more memory than is allowed: by [`Self::memory_limit`], else by the system.
    ///
    /// # Errors
    /// [`Error::Limit`] with what sets the bound.
    #[doc(hidden)]
    pub fn check_memory(&self) -> Result<()> {
        memory::check(&format!("the bake of {}", self.label), self.bytes_needed(), self.memory_limit)
    }

    /// Refuses what cannot be done, before any work.
    ///
    /// # Errors
    /// When a goal is no positive number, rays are no power of two of at least 4, the list of isovalues is empty, the bake needs more memory than allowed, or asks of its estimator or its scene what they cannot do.
    pub fn check(&self) -> Result<()> {
        self.goal.check()?;
        self.settings.check()?;
        self.volume.check_reference()?;
        if self.isovalues.as_ref().is_some_and(Vec::is_empty) {
            let expected = "one isovalue at least, or no list for all of them";
            return Err(Error::argument("isovalues", "an empty list", expected, "leave the list out to bake all"));
        }
        if let Some(limit) = self.memory_limit
            && let needed = self.bytes_needed()
            && needed > limit
        {
            return Err(Error::Limit {
                what: format!("the bake of {}", self.label),
                needed: format!("{needed} bytes"),
                limit: format!("{limit} bytes"),
                remedy: "raise it, or use a smaller texture, fewer layers or bands, or fewer isovalues at a time"
                    .into(),
            });
        }
        self.check_estimator()?;
        if let Some(error) = self.adaptive {
            self.check_adaptive(error)?;
        }
        if self.volume.exact.is_some() && !self.surfaces {
            let remedy = "name isovalues, without --texture; or give the option to relight of the store";
            let given = "the texels of a texture";
            return Err(Error::argument("--exact-vertices", given, "vertices of isosurfaces", remedy));
        }
        Ok(())
    }

    /// Refuses what the estimator cannot do.
    pub(super) fn check_estimator(&self) -> Result<()> {
        if let Some(geometry) = self.geometry {
            self.check_scene(geometry)?;
        }
        if self.surfaces && self.estimator != Estimator::Path {
            let name = format!("estimator {}", self.estimator.name());
            let remedy = "bake the texture: --texture 1, or Bake::texture; or use the estimator path";
            return Err(Error::argument(name, "vertices of isosurfaces", "the texels of a texture", remedy));
        }
        if self.estimator != Estimator::Path && (self.goal.error.is_some() || self.goal.seconds.is_some()) {
            let name = format!("estimator {}", self.estimator.name());
            let remedy = "leave out the error and the time, or use the estimator path";
            return Err(Error::argument(name, "a target as well", "a number of rays", remedy));
        }
        Ok(())
    }

    pub(super) fn check_adaptive(&self, error: f64) -> Result<()> {
        let refuse = |name: &str, found: &dyn Display, expected: &str, remedy: &str| {
            Err(Error::argument(name, found, expected, remedy))
        };
        if !(error > 0.0 && error < 1.0) {
            return refuse("texture", &error, "an error between 0 and 1", "give adaptive:2%");
        }
        if self.isovalues.is_some() {
            let remedy =
                "name no isovalue; or name no texture: then isovalues are baked at the vertices of their surfaces";
            return refuse("isovalues", &"an adaptive texture as well", "all isovalues", remedy);
        }
        if self.estimator != Estimator::Path {
            let name = format!("estimator {}", self.estimator.name());
            return refuse(
                &name,
                &"an adaptive texture",
                "the estimator path",
                "leave the estimator out, or give --texture 1",
            );
        }
        Ok(())
    }
}

/// Vertices of an isosurface.
fn vertices_of(volume: &Volume, isovalue: f64) -> Result<u64> {
    Ok(extract_without_normals(volume, isovalue)?.positions_in_grid.len() as u64)
}

/// Texels of what a request asks of which a store has nothing.
fn missing_in(job: &Request<'_>, store: &Store) -> Result<u64> {
    let wanted = job.claims(&None).into_iter().map(|claim| Baked::any(claim.isovalue)).collect();
    let mut pending = Pending::new(job, store, wanted)?;
    let mut texels = 0;
    for i in 0..pending.len() {
        let part = pending.part(i);
        texels += texels_in(&part.selection, &part.chunks);
    }
    Ok(texels)
}
