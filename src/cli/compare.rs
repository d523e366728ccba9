//! `isolume compare`: the store's answer against paths and photons on the same surface, and why they differ.

mod geometry;
mod photon;
mod lamps;
mod picture;
mod subject;

use super::bake::fix;
use super::console::Console;
use super::info::check_store;
use super::isovalue::NamedIsovalue;
use super::light::parse_factor;
use super::light::parse_triple;
use super::options::add_fog;
use super::{Outcome, text};
use crate::compare::{
    BudgetRow, Comparison, Distance, GeometryComparison, LitSurface, PhotonComparison, Question, Vertices,
    check_geometry, compare, compare_geometry, compare_photons, unburied,
};
use crate::error::Error;
use crate::export::inputs::Inputs;
use crate::probe::{Orientation, Probe, SunSplit};
use crate::scene::{Effects, Scene, SceneFile, VolumeOptions, open_probe};
use crate::session::{Isosurface, LuminaireFactor, check_factors, factor_of};
use crate::transfer::BrickSource;
use crate::transfer::store::Store;
use crate::transport::{ExactPoint, points_in_cells};
use lamps::Lamps;
use picture::Shown;
use serde_json::{Value, json};
use std::time::{Duration, Instant};
use subject::Subject;

/// Compare relit isosurfaces with path tracing under the whole environment, and say why they differ
///
/// At random vertices, light is computed anew by unbiased paths on the level set: under the whole image, and under the
/// image cut to the bands of the store. The difference to what relight gives is split into truncation, texture
/// (interpolation, layers, tail), noise of the bake, and rounding. With --against photon flattened photon mapping
/// stands beside them; with --against geometry paths on the trilinear surface itself, at random points inside its cells,
/// which say what smoothed normals do. Pictures show the store, the reference, and the difference in false colours.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume compare brain.isolume --isovalue 90 --env courtyard --env sunset
  isolume compare brain.isolume --isovalue 90 --env courtyard --png brain.png
  isolume compare brain.isolume --isovalue 90 --env sky --against photon
  isolume compare brain.isolume --isovalue 90 --env constant --against geometry
  isolume compare box.isolume --scene box.toml --isovalue 47 --luminaire ceiling=2")]
pub(super) struct Compare {
    /// The store
    #[arg(value_name = "X.isolume")]
    input: String,
    /// Isovalues that the store holds: numbers in the file's values, percentages of their range, or auto. Of several
    /// volumes baked together isovalues are those of the first, NAME=C is that of another, and all surfaces that belong
    /// to it are compared
    #[arg(
        short,
        long,
        visible_alias = "isovalues",
        value_name = "[NAME=]C[,…]",
        value_delimiter = ',',
        required = true,
        allow_hyphen_values = true
    )]
    isovalue: Vec<NamedIsovalue>,
    /// Environment: an image file or a name, as relight takes it
    #[arg(short, long, value_name = "PROBE", required = true)]
    env: Vec<String>,
    /// Turn the light counter-clockwise about up, seen from above, in degrees
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_hyphen_values = true)]
    env_rotate: f64,
    /// Where the centre of environment images lies in glTF: at +X (Blender, three.js), or at +Z (OpenEXR)
    #[arg(long, value_enum, value_name = "FRAME", default_value = "gltf")]
    env_frame: super::light::FrameName,
    /// Lamps lit apart from the environment, as relight lights them: as many as would ring otherwise, none, or so many; none
    /// in scenes
    #[arg(long, value_name = "auto|off|N", default_value = "auto", value_parser = super::light::parse_split)]
    sun_split: SunSplit,
    /// Diffuse reflectance, one number or r,g,b
    #[arg(long, value_name = "RHO|R,G,B", default_value = "0.7", value_parser = parse_triple, allow_hyphen_values = true)]
    albedo: super::light::Triple,
    /// Radiance that the surface emits, one number or r,g,b
    #[arg(long, value_name = "E|R,G,B", default_value = "0", value_parser = parse_triple, allow_hyphen_values = true)]
    emission: super::light::Triple,
    /// The scene (.toml) that the store was baked of: stores hold what walls and luminaires do to light, not their
    /// shapes
    #[arg(long, value_name = "SCENE")]
    scene: Option<String>,
    /// The environment that the store was baked with as a luminaire (bake --fixed-env), turned by --env-rotate as it was
    #[arg(long, value_name = "PROBE", conflicts_with = "scene")]
    fixed_env: Option<String>,
    /// The fog that the store was baked with (bake --fog)
    #[arg(long, value_name = "SIGMA[,ALBEDO[,G]]", value_parser = super::options::parse_fog, conflicts_with = "scene")]
    fog: Option<super::options::Fog>,
    /// Factor on the power of a luminaire, one number or three for red, green and blue, such as ceiling=2
    #[arg(long = "luminaire", value_name = "NAME=FACTOR", value_parser = parse_factor)]
    luminaires: Vec<LuminaireFactor>,
    /// Compare only this one of several volumes baked together; isovalues are then its own
    #[arg(long = "volume", value_name = "NAME")]
    of_volume: Option<String>,
    /// Random vertices at which light is compared; with --against geometry points of the triangles
    #[arg(long, value_name = "N", default_value_t = 2000, value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    points: u32,
    /// Paths of the reference at each of them, a power of two
    #[arg(long, value_name = "N", default_value = "256", value_parser = super::options::parse_rays)]
    paths: u32,
    /// Paths for each texel of the budget's exact texels, a power of two
    #[arg(long, value_name = "N", default_value = "1024", value_parser = super::options::parse_rays)]
    texel_rays: u32,
    /// What is compared beside path tracing; photons are then the reference of the pictures, too
    #[arg(long, value_enum, default_value = "path")]
    against: Against,
    /// With --against geometry, list every point in --json: its place in the grid, the normal of the surface itself there,
    /// and radiance by the store, by paths about smoothed normals, and by paths on the surface itself
    #[arg(long)]
    list_points: bool,
    #[command(flatten)]
    photons: photon::PhotonArgs,
    #[command(flatten)]
    pictures: picture::PictureOutput,
}

/// A reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Against {
    /// Path tracing on the level set: unbiased
    Path,
    /// Flattened photon mapping as well
    Photon,
    /// Path tracing on the trilinear surface itself, about its own normals, as well
    Geometry,
}

/// One surface under one light.
struct Row {
    // Of several.
    volume: Option<String>,
    isovalue: f64,
    env: String,
    found: Comparison,
    photons: Option<PhotonComparison>,
    geometry: Option<GeometryComparison>,
    // The points, where they are listed.
    listed: Vec<ExactPoint>,
    time: Duration,
}

impl Compare {
    pub(super) fn run(&self, seed: u64, console: &Console) -> Outcome {
        check_store(&self.input)?;
        let file = self.scene.as_deref().map(SceneFile::read).transpose()?;
        let read = self.env.iter().chain([&self.input]).chain(&self.scene);
        self.pictures.refuse(&Inputs::new(read).with(file.iter().flat_map(SceneFile::files)))?;
        let store = Store::open(&self.input)?;
        let mut scene = file.map(|f| f.open(&VolumeOptions::default(), &Effects::default())).transpose()?;
        if let Some(name) = &self.fixed_env {
            let mut alone = add_fog(Scene::of(store.volume()?), self.fog, &Effects::default())?;
            fix(&mut alone, name, (self.env_rotate, self.env_frame))?;
            scene = Some(alone);
        } else if self.fog.is_some() {
            scene = Some(add_fog(Scene::of(store.volume()?), self.fog, &Effects::default())?);
        }
        let (subjects, isovalues) = self.subjects(store, scene.as_ref())?;
        let probes = self.env.iter().map(|e| open_probe(e, false, None)).collect::<Result<Vec<_>, Error>>()?;
        let names: Vec<String> = probes.iter().map(|p| p.name.clone()).collect();
        if subjects.iter().any(|subject| subject.baked_by(self.texel_rays).is_none()) {
            console.note("the texels of this estimator cannot be made again: noise, bias and rounding are one row");
        }
        let files = match (subjects.as_slice(), isovalues.as_slice()) {
            ([one], [isovalues]) => self.pictures.files(&one.volume.name, isovalues, &names)?,
            _ => self.pictures.none()?,
        };
        let mut rows = Vec::new();
        for (subject, isovalues) in subjects.iter().zip(&isovalues) {
            for (i, &isovalue) in isovalues.iter().enumerate() {
                let files = files.get(i * probes.len()..(i + 1) * probes.len()).unwrap_or_default();
                rows.extend(self.compared(subject, isovalue, &probes, files, seed)?);
            }
        }
        console.print(table(&rows));
        console.print(format!(
            "\n{} {}, {} paths each; all figures over the mean radiance of the reference. ± is half of the \
             95 % interval over the vertices. RMS %: after the reference's exposure, clamped to [0, 1], as Beason (2005) measured.",
            self.points,
            if self.against == Against::Geometry { "points" } else { "vertices" },
            self.paths
        ));
        if subjects.iter().any(Subject::is_among_others) {
            console.print("Vertices that another volume buries are left out.");
        }
        console.print(format!("\nWhy: shares of the mean square of the difference\n{}", budget(&rows)));
        if self.against == Against::Photon {
            console.print(format!("\n{}", photon::table(&rows)));
        }
        if self.against == Against::Geometry {
            console.print(format!("\n{}", geometry::table(&rows)));
        }
        for path in files.iter().flat_map(|f| f.paths()) {
            console.print(path.display());
        }
        console.print_json(&json!({
            "points": self.points, "paths": self.paths, "texel_rays": self.texel_rays,
            "rows": rows.iter().map(row_json).collect::<Vec<_>>(),
        }));
        Ok(())
    }

    /// What is compared, and the isovalues of each.
    fn subjects(&self, store: Store, scene: Option<&Scene>) -> Outcome<(Vec<Subject>, Vec<Vec<f64>>)> {
        let names = store.identity().scene.as_ref().map_or(&[][..], |scene| &scene.luminaires);
        check_factors(names, &self.luminaires)?;
        let (mut subjects, mut isovalues) = subject::subjects(store, scene, self.of_volume.as_deref(), &self.isovalue)?;
        if let Some(name) = &self.of_volume {
            let place = subjects.iter().position(|s| s.name.as_ref() == Some(name)).unwrap_or(0);
            (subjects, isovalues) = (vec![subjects.swap_remove(place)], vec![isovalues.swap_remove(place)]);
        }
        Ok((subjects, isovalues))
    }

    /// One isosurface of one volume, under each environment.
    fn compared(
        &self,
        subject: &Subject,
        isovalue: f64,
        probes: &[Probe],
        files: &[picture::Files],
        seed: u64,
    ) -> Outcome<Vec<Row>> {
        let Subject { volume, pyramid, geometry, .. } = subject;
        let geometry = geometry.as_ref();
        let at_vertices = subject.at_vertices(isovalue)?;
        let stores = at_vertices.as_ref().unwrap_or(&subject.textures);
        let vertices = stores[0].mesh()?.map(|mesh| Vertices::new(isovalue, mesh));
        let layout = stores[0].layout();
        let orientation = Orientation::new(volume.up, self.env_rotate)?.in_frame(self.env_frame.into());
        // In the order of the vertices of a store.
        let surface = Isosurface::extract(volume, pyramid, isovalue)?;
        let cells = match self.against {
            Against::Geometry => Some(points_in_cells(volume, pyramid, surface.mesh(), isovalue, self.points, seed)),
            Against::Path | Against::Photon => None,
        };
        let points = match &cells {
            Some(cells) => cells.smoothed.clone(),
            None => surface.random_points(self.points, seed),
        };
        let points = unburied(volume, pyramid, geometry, isovalue, points);
        let luminaires = geometry.map_or(&[][..], |geometry| geometry.luminaires());
        let scales: Vec<[f64; 3]> = luminaires.iter().map(|l| factor_of(&l.name, &self.luminaires)).collect();
        let textures: Vec<&dyn BrickSource> = stores.iter().map(|t| t as _).collect();
        let settings = subject.baked_by(self.texel_rays);
        let photons = subject.specular_photons(at_vertices.is_some().then_some(isovalue))?;
        let mut rows = Vec::new();
        for (p, probe) in probes.iter().enumerate() {
            let start = Instant::now();
            let lit = LitSurface {
                volume,
                pyramid,
                geometry,
                caustics: subject.has_caustics(),
                specular: photons.as_ref().map(|photons| photons as _),
                isovalue,
                points: &points,
                light: &probe.source(orientation),
                coefficients: &probe.coefficients_in_world(layout.layers.max_bands(), orientation),
                albedo: self.albedo.0,
                emission: self.emission.0,
                scales: &scales,
                vertices: vertices.as_ref(),
            };
            let split = if geometry.is_some() { SunSplit::Off } else { self.sun_split };
            let lamps = Lamps::of(probe, orientation, split, &layout.layers);
            let question = Question {
                surface: lit,
                textures: &textures,
                baked_by: settings.as_ref(),
                apart: lamps.as_ref().map(Lamps::apart),
                paths: self.paths,
                texel_rays: self.texel_rays,
                seed,
            };
            let asked = match self.against {
                Against::Path | Against::Geometry => None,
                Against::Photon => Some(self.photons.question(volume, isovalue, seed)?),
            };
            if let Some(asked) = &asked {
                asked.check(&question)?;
            }
            if cells.is_some() {
                check_geometry(&lit)?;
            }
            let found = compare(&question)?;
            let beside = cells.as_ref().map(|cells| compare_geometry(&question, &found, cells)).transpose()?;
            let photons = asked.as_ref().map(|asked| compare_photons(&question, &found, asked)).transpose()?;
            let time = start.elapsed();
            let shown = Shown { question: &question, surface: &surface, photons: asked.as_ref(), mean: found.mean };
            if let Some(files) = files.get(p) {
                self.pictures.write(files, &shown)?;
            }
            let (volume, env) = (subject.name.clone(), probe.name.clone());
            let listed = cells.iter().filter(|_| self.list_points).flat_map(|cells| cells.exact()).collect();
            rows.push(Row { volume, isovalue, env, found, photons, geometry: beside, listed, time });
        }
        Ok(rows)
    }
}

impl Row {
    /// The rows of the longest chain.
    fn budget(&self) -> &[BudgetRow] {
        self.geometry.as_ref().map_or(&self.found.budget, |geometry| &geometry.budget)
    }

    /// Which surface it is of.
    fn surface(&self) -> String {
        let isovalue = text::number(self.isovalue, 6);
        match &self.volume {
            Some(name) => format!("{name} {isovalue}"),
            None => isovalue,
        }
    }
}

fn table(rows: &[Row]) -> String {
    let mut lines = vec![
        ["isovalue", "environment", "against", "relative RMS", "without noise", "95 %", "max", "bias", "RMS %", "time"]
            .map(String::from)
            .to_vec(),
    ];
    for row in rows {
        for (against, d) in [("whole light", &row.found.whole), ("its bands", &row.found.band_limited)] {
            lines.push(vec![
                row.surface(),
                row.env.clone(),
                against.into(),
                format!("{} ± {}", text::percent(d.relative_rms.value), text::percent(d.relative_rms.half_interval)),
                text::percent(d.relative_rms_without_noise),
                text::percent(d.percentile_95),
                text::percent(d.maximum),
                format!("{:+.2} ± {:.2} %", 100.0 * d.bias.value, 100.0 * d.bias.half_interval),
                format!("{:.2}", d.rms_percent),
                text::duration(row.time),
            ]);
        }
    }
    text::table(&lines)
}

fn budget(rows: &[Row]) -> String {
    let names = rows.first().map_or(Vec::new(), |r| r.budget().iter().map(|b| b.name.to_string()).collect());
    let head = ["isovalue", "environment"].map(String::from).into_iter().chain(names);
    let mut lines = vec![head.chain(["total".into(), "noise of the reference".into()]).collect::<Vec<_>>()];
    for row in rows {
        let mut line = vec![row.surface(), row.env.clone()];
        let total: f64 = row.budget().iter().map(|b| b.mean_square).sum();
        for b in row.budget() {
            let rms = b.mean_square.abs().sqrt().copysign(b.mean_square);
            line.push(format!("{:.1} % (RMS {:.2} %)", 100.0 * b.mean_square / total, 100.0 * rms));
        }
        line.push(format!("RMS {}", text::percent(total.sqrt())));
        line.push(format!("RMS {}", text::percent(row.found.reference_noise)));
        lines.push(line);
    }
    text::table(&lines)
}

fn distance_json(d: &Distance) -> Value {
    let figure = |f: crate::compare::Figure| json!({ "value": f.value, "half_interval_95": f.half_interval });
    json!({
        "relative_rms": figure(d.relative_rms),
        "relative_rms_without_noise": d.relative_rms_without_noise,
        "bias": figure(d.bias),
        "percentile_95": d.percentile_95,
        "maximum": d.maximum,
        "rms_percent": d.rms_percent,
    })
}

fn row_json(row: &Row) -> Value {
    let f = &row.found;
    json!({
        "volume": row.volume, "isovalue": row.isovalue, "environment": row.env, "mean_radiance": f.mean,
        "whole": distance_json(&f.whole), "band_limited": distance_json(&f.band_limited),
        "budget_mean_square": row.budget().iter().map(|b| (b.name.to_string(), json!(b.mean_square))).collect::<serde_json::Map<_, _>>(),
        "reference_noise": f.reference_noise, "rays": f.rays, "seconds": row.time.as_secs_f64(),
        "lookups": {
            "all": f.lookups.lookups, "renormalised": f.lookups.renormalised,
            "neighbourhood": f.lookups.neighbourhood, "unoccluded": f.lookups.unoccluded,
        },
        "photons": row.photons.as_ref().map(photon::photons_json),
        "geometry": row.geometry.as_ref().map(|g| geometry::geometry_json(row, g)),
    })
}
