//! Each isosurface of a store under each environment, compared: a row of the table.

use super::lamps::Lamps;
use super::picture::Shown;
use super::{
    BudgetRow, Comparison, GeometryComparison, LitSurface, PhotonComparison, PhotonQuestion, Question, Stated, Subject,
    Vertices, check_geometry, compare, compare_geometry, compare_photons, unburied,
};
use crate::error::Result;
use crate::probe::{EnvFrame, Orientation, Probe, SunSplit};
use crate::relight::{Material, TriangleIndex, TriangleOrder};
use crate::scene::geometry::Geometry;
use crate::session::{Isosurface, LightOptions, LitOptions, LuminaireFactor, Session, Surface, factor_of};
use crate::transfer::BrickSource;
use crate::transport::{ExactPoint, PhotonEnergy, points_in_cells};
use crate::volume::Volume;
use serde_json::{Map, Value, json};

/// What is compared beside paths.
#[derive(Clone, Copy)]
pub enum Against<'a> {
    /// Nothing.
    Nothing,
    /// Flattened photon mapping, asked in this way about an isosurface.
    Photons(&'a dyn Fn(&Volume, f64) -> Result<PhotonQuestion>),
    /// Paths on the trilinear surface itself; with `list` every point is kept.
    Geometry {
        /// Whether the points are kept.
        list: bool,
    },
}

/// Under which light, and how hard, the surfaces of a store are compared.
#[derive(Clone, Copy)]
pub struct Asked<'a> {
    /// The environments.
    pub probes: &'a [Probe],
    /// How far they are turned, in degrees.
    pub rotation_degrees: f64,
    /// Where the centre of their images lies.
    pub frame: EnvFrame,
    /// Which lamps are lit apart; none among mirrors and glass.
    pub sun_split: SunSplit,
    /// Albedo of the surfaces.
    pub albedo: [f32; 3],
    /// What they emit.
    pub emission: [f32; 3],
    /// Factors on luminaires.
    pub luminaires: &'a [LuminaireFactor],
    /// Random points of each surface.
    pub points: u32,
    /// Paths at each.
    pub paths: u32,
    /// Paths for each exact texel of the budget.
    pub texel_rays: u32,
    /// What is compared beside paths.
    pub against: Against<'a>,
    /// Seed of the references.
    pub seed: u64,
}

/// One surface under one light.
#[derive(Clone, Debug)]
pub struct Compared {
    /// The volume, of several.
    pub volume: Option<String>,
    /// In the file's values.
    pub isovalue: f64,
    /// The environment.
    pub env: String,
    /// The store against paths.
    pub found: Comparison,
    /// What relight says of its error, where it does: not of one of several volumes.
    pub stated: Option<Stated>,
    /// Photons beside them.
    pub photons: Option<PhotonComparison>,
    /// The surface itself beside them.
    pub geometry: Option<GeometryComparison>,
    /// The points, where they are listed.
    pub listed: Vec<ExactPoint>,
    /// What it took.
    pub seconds: f64,
}

impl Asked<'_> {
    /// One isosurface of one volume, under each environment. `seconds` is the clock; `show` is handed the number of the
    /// environment and what pictures are made of.
    ///
    /// # Errors
    /// As [`compare()`], [`compare_photons`], [`compare_geometry`] and `show`.
    pub fn rows(
        &self,
        subject: &Subject,
        isovalue: f64,
        seconds: &dyn Fn() -> f64,
        show: &dyn Fn(usize, &Shown<'_>) -> Result<()>,
    ) -> Result<Vec<Compared>> {
        let Subject { volume, pyramid, geometry, .. } = subject;
        let geometry = geometry.as_ref();
        let at_vertices = subject.at_vertices(isovalue)?;
        let stores = at_vertices.as_ref().unwrap_or(&subject.textures);
        let vertices = stores[0].mesh()?.map(|mesh| Vertices::new(isovalue, mesh));
        let layout = stores[0].layout();
        let orientation = Orientation::new(volume.up, self.rotation_degrees)?.in_frame(self.frame);
        // In the order of the vertices of a store.
        let surface = Isosurface::extract(volume, pyramid, isovalue)?;
        let cells = match self.against {
            Against::Geometry { .. } => {
                Some(points_in_cells(volume, pyramid, surface.mesh(), isovalue, self.points, self.seed))
            }
            Against::Nothing | Against::Photons(_) => None,
        };
        let points = match &cells {
            Some(cells) => cells.smoothed.clone(),
            None => surface.random_points(self.points, self.seed),
        };
        let points = unburied(volume, pyramid, geometry, isovalue, points);
        let luminaires = geometry.map_or(&[][..], |geometry| geometry.luminaires());
        let scales: Vec<[f64; 3]> = luminaires.iter().map(|l| factor_of(&l.name, self.luminaires)).collect();
        let textures: Vec<&dyn BrickSource> = stores.iter().map(|t| t as _).collect();
        let settings = subject.baked_by(self.texel_rays);
        let specular = subject.specular_photons(at_vertices.is_some().then_some(isovalue))?;
        let order = TriangleOrder::new(surface.mesh());
        let triangles = TriangleIndex::new(surface.mesh(), &order);
        let session = Session::alone(&subject.textures[0], volume, pyramid).with_geometry(geometry);
        let relit = (!subject.is_among_others()).then(|| session.surface(isovalue)).transpose()?;
        let mut rows = Vec::new();
        for (p, probe) in self.probes.iter().enumerate() {
            let start = seconds();
            let lit = LitSurface {
                volume,
                pyramid,
                geometry,
                caustics: subject.has_caustics(),
                specular: specular.as_ref().map(|photons| photons as _),
                isovalue,
                points: &points,
                light: &probe.source(orientation),
                coefficients: &probe.coefficients_in_world(layout.layers.max_bands(), orientation),
                albedo: self.albedo,
                emission: self.emission,
                scales: &scales,
                vertices: vertices.as_ref(),
            };
            let split = if Geometry::splits_lamps(geometry) { self.sun_split } else { SunSplit::Off };
            let lamps = Lamps::of(probe, orientation, split, &layout.layers);
            let question = Question {
                surface: lit,
                textures: &textures,
                baked_by: settings.as_ref(),
                apart: lamps.as_ref().map(|lamps| lamps.apart(&triangles)),
                paths: self.paths,
                texel_rays: self.texel_rays,
                seed: self.seed,
            };
            let asked = match self.against {
                Against::Photons(ask) => Some(ask(volume, isovalue)?),
                Against::Nothing | Against::Geometry { .. } => None,
            };
            asked.iter().try_for_each(|asked| asked.check(&question))?;
            if cells.is_some() {
                check_geometry(&lit)?;
            }
            let found = compare(&question)?;
            let beside = cells.as_ref().map(|cells| compare_geometry(&question, &found, cells)).transpose()?;
            let photons = asked.as_ref().map(|asked| compare_photons(&question, &found, asked)).transpose()?;
            let stated =
                relit.as_ref().map(|surface| self.stated((&session, surface), probe, &found)).transpose()?.flatten();
            let seconds = seconds() - start;
            show(p, &Shown { question: &question, surface: &surface, photons: asked.as_ref(), mean: found.mean })?;
            let (volume, env) = (subject.name.clone(), probe.name.clone());
            let lists = matches!(self.against, Against::Geometry { list: true });
            let listed = cells.iter().filter(|_| lists).flat_map(|cells| cells.exact()).collect();
            rows.push(Compared { volume, isovalue, env, found, stated, photons, geometry: beside, listed, seconds });
        }
        Ok(rows)
    }

    /// What relight says of the error of the same surface under the same light.
    fn stated(
        &self,
        (session, surface): (&Session<'_>, &Surface<'_>),
        probe: &Probe,
        found: &Comparison,
    ) -> Result<Option<Stated>> {
        let (rotation_degrees, frame) = (self.rotation_degrees, self.frame);
        let light = LightOptions { rotation_degrees, frame, split_sun: self.sun_split, ..LightOptions::default() };
        let options = LitOptions { luminaires: self.luminaires.to_vec(), ..LitOptions::default() };
        let light = session.light(probe, &light)?;
        let lit = surface.lit(&light, &Material::new(self.albedo, self.emission)?, &options)?;
        let radiance = lit.radiance();
        let mean = radiance.iter().flatten().map(|&v| f64::from(v)).sum::<f64>() / (3 * radiance.len()).max(1) as f64;
        Ok(lit.estimate_total_error()?.map(|error| found.stated(&error, mean)))
    }
}

impl Compared {
    /// The rows of the longest chain.
    pub fn budget(&self) -> &[BudgetRow] {
        self.geometry.as_ref().map_or(&self.found.budget, |geometry| &geometry.budget)
    }

    /// For programs.
    pub fn to_json(&self) -> Value {
        let f = &self.found;
        let budget: Map<_, _> = self.budget().iter().map(|b| (b.name.to_string(), json!(b.mean_square))).collect();
        json!({
            "volume": self.volume, "isovalue": self.isovalue, "environment": self.env, "mean_radiance": f.mean,
            "whole": f.whole, "band_limited": f.band_limited, "stated": self.stated, "budget_mean_square": budget,
            "reference_noise": f.reference_noise, "rays": f.rays, "seconds": self.seconds,
            "lookups": {
                "all": f.lookups.lookups, "renormalised": f.lookups.renormalised,
                "neighbourhood": f.lookups.neighbourhood, "unoccluded": f.lookups.unoccluded,
            },
            "photons": self.photons.as_ref().map(photons_json),
            "geometry": self.geometry.as_ref().map(|g| self.geometry_json(g)),
        })
    }

    fn geometry_json(&self, g: &GeometryComparison) -> Value {
        let by_others = self.found.at_points.iter().zip(&g.at_points);
        let point = |(at, ([store, paths], geometry)): (&ExactPoint, (&[[f64; 3]; 2], &[f64; 3]))| {
            json!({
                "position_in_grid": at.position_in_grid, "normal": at.normal,
                "store": store, "paths": paths, "geometry": geometry,
            })
        };
        json!({
            "points": self.listed.iter().zip(by_others).map(point).collect::<Vec<_>>(),
            "mean_radiance": g.mean,
            "store": g.store,
            "normals": g.normals,
            "normals_bias": g.normals.bias.value,
            "normals_bias_standard_error": g.normals.bias.standard_error(),
            "normals_rms_without_noise": g.normals.relative_rms_without_noise,
            "noise": g.noise,
            "rays": g.counts.rays, "lost": g.counts.lost, "cut": g.counts.cut,
        })
    }
}

fn photons_json(p: &PhotonComparison) -> Value {
    let energy = |e: &PhotonEnergy| {
        json!({
            "photons": e.photons, "hits": e.hits, "emitted": e.emitted, "missed": e.missed, "discarded": e.discarded,
            "escaped": e.escaped, "absorbed": e.absorbed, "in_walls": e.in_walls, "in_luminaires": e.in_luminaires,
            "cut": e.cut, "imbalance": e.imbalance(), "stored_by_bounce": e.stored,
        })
    };
    json!({
        "store_against_photons": p.store,
        "photons_against_paths": p.paths,
        "noise": p.noise, "bias_rms": p.bias, "hits": p.hits, "caustics": p.caustics, "bytes": p.bytes,
        // Of the environment, then of each luminaire.
        "energies": p.energies.iter().map(energy).collect::<Vec<_>>(),
    })
}
