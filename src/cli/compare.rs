//! `isolume compare`: the store's answer against paths and photons on the same surface, and why they differ.

mod photon;
mod picture;

use super::console::Console;
use super::info::check_store;
use super::inputs::Inputs;
use super::isovalue::Isovalue;
use super::light::{open_probe, parse_triple};
use super::{Outcome, text};
use crate::compare::{Comparison, Distance, PhotonComparison, Question, compare, compare_photons};
use crate::error::Error;
use crate::level::Pyramid;
use crate::probe::Orientation;
use crate::session::Isosurface;
use crate::transfer::store::{EstimatorIdentity, Shadows, Store};
use crate::transport::Settings;
use picture::Shown;
use serde_json::{Value, json};
use std::time::{Duration, Instant};

/// Compare relit isosurfaces with path tracing under the whole environment, and say why they differ
///
/// At random vertices, light is computed anew by unbiased paths on the level set: under the whole image, and under the
/// image cut to the bands of the store. The difference to what relight gives is split into truncation, texture
/// (interpolation, layers, tail), noise of the bake, and rounding. With --against photon flattened photon mapping
/// stands beside them. Pictures show the store, the reference, and the difference in false colours.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume compare brain.isolume --isovalue 90 --env courtyard --env sunset
  isolume compare brain.isolume --isovalue 90 --env courtyard --png brain.png
  isolume compare brain.isolume --isovalue 90 --env sky --against photon")]
pub(super) struct Compare {
    /// The store
    #[arg(value_name = "X.isolume")]
    input: String,
    /// Isovalues that the store holds: numbers in the file's values, percentages of their range, or auto
    #[arg(
        short,
        long,
        visible_alias = "isovalues",
        value_name = "C[,C…]",
        value_delimiter = ',',
        required = true,
        allow_hyphen_values = true
    )]
    isovalue: Vec<Isovalue>,
    /// Environment: an image file or a name, as relight takes it
    #[arg(short, long, value_name = "PROBE", required = true)]
    env: Vec<String>,
    /// Turn the light counter-clockwise about up, seen from above, in degrees
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_hyphen_values = true)]
    env_rotate: f64,
    /// Where the centre of environment images lies in glTF: at +X (Blender, three.js), or at +Z (OpenEXR)
    #[arg(long, value_enum, value_name = "FRAME", default_value = "gltf")]
    env_frame: super::light::FrameName,
    /// Diffuse reflectance, one number or r,g,b
    #[arg(long, value_name = "RHO|R,G,B", default_value = "0.7", value_parser = parse_triple, allow_hyphen_values = true)]
    albedo: super::light::Triple,
    /// Random vertices at which light is compared
    #[arg(long, value_name = "N", default_value_t = 2000, value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    points: u32,
    /// Paths of the reference at each of them, a power of two
    #[arg(long, value_name = "N", default_value = "256", value_parser = super::options::parse_rays)]
    paths: u32,
    /// Paths for each texel of the budget's exact texels, a power of two
    #[arg(long, value_name = "N", default_value = "1024", value_parser = super::options::parse_rays)]
    texel_rays: u32,
    /// Reference of the pictures: path tracing, or photon mapping, which is then compared too
    #[arg(long, value_enum, default_value = "path")]
    against: Against,
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
}

/// One surface under one light.
struct Row {
    isovalue: f64,
    env: String,
    found: Comparison,
    photons: Option<PhotonComparison>,
    time: Duration,
}

impl Compare {
    pub(super) fn run(&self, seed: u64, console: &Console) -> Outcome {
        check_store(&self.input)?;
        self.pictures.refuse(&Inputs::new(self.env.iter().chain([&self.input])))?;
        let store = Store::open(&self.input)?;
        let volume = store.volume()?;
        let identity = store.identity();
        let pyramid = Pyramid::new(&volume);
        let layout = store.layout();
        let orientation = Orientation::new(volume.up, self.env_rotate)?.in_frame(self.env_frame.into());
        let probes = self.env.iter().map(|e| open_probe(e, false, None)).collect::<Result<Vec<_>, Error>>()?;
        let settings = Settings {
            layers: layout.layers.clone(),
            rays: self.texel_rays,
            seed: identity.seed,
            target: None,
            positive: identity.positive,
        };
        let is_path = identity.estimator == EstimatorIdentity::Path { shadowing: Shadows::Found };
        if !is_path {
            console.note("the texels of this estimator cannot be made again: noise, bias and rounding are one row");
        }
        let mut rows = Vec::new();
        let mut isovalues = Vec::new();
        for chosen in &self.isovalue {
            isovalues.push(chosen.resolve(&volume, Some(volume.solid), None)?.value);
        }
        let names: Vec<String> = probes.iter().map(|p| p.name.clone()).collect();
        let files = self.pictures.files(&volume.name, &isovalues, &names)?;
        for (i, &isovalue) in isovalues.iter().enumerate() {
            let surface = Isosurface::extract(&volume, &pyramid, isovalue)?;
            let points = surface.random_points(self.points, seed);
            for (p, probe) in probes.iter().enumerate() {
                let start = Instant::now();
                let source = probe.source(orientation);
                let question = Question {
                    volume: &volume,
                    pyramid: &pyramid,
                    texture: &store,
                    baked_by: is_path.then_some(&settings),
                    isovalue,
                    points: &points,
                    light: &source,
                    coefficients: &probe.coefficients_in_world(layout.layers.max_bands(), orientation),
                    albedo: self.albedo.0,
                    paths: self.paths,
                    texel_rays: self.texel_rays,
                    seed,
                };
                let found = compare(&question)?;
                let asked = match self.against {
                    Against::Path => None,
                    Against::Photon => Some(self.photons.question(&volume, isovalue, seed)?),
                };
                let photons = match &asked {
                    None => None,
                    Some(asked) => Some(compare_photons(&question, &found, asked)?),
                };
                let time = start.elapsed();
                let shown = Shown { question: &question, surface: &surface, photons: asked.as_ref(), mean: found.mean };
                self.pictures.write(&files[i * probes.len() + p], &shown)?;
                rows.push(Row { isovalue, env: probe.name.clone(), found, photons, time });
            }
        }
        console.print(table(&rows));
        console.print(format!(
            "\n{} vertices, {} paths each; all figures over the mean radiance of the reference. ± is half of the \
             95 % interval over the vertices. RMS %: after the reference's exposure, clamped to [0, 1], as Beason (2005) measured.",
            self.points, self.paths
        ));
        console.print(format!("\nWhy: shares of the mean square of the difference\n{}", budget(&rows)));
        if self.against == Against::Photon {
            console.print(format!("\n{}", photon::table(&rows)));
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
                text::number(row.isovalue, 6),
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
    let names = rows.first().map_or(Vec::new(), |r| r.found.budget.iter().map(|b| b.name.to_string()).collect());
    let head = ["isovalue", "environment"].map(String::from).into_iter().chain(names);
    let mut lines = vec![head.chain(["total".into(), "noise of the reference".into()]).collect::<Vec<_>>()];
    for row in rows {
        let mut line = vec![text::number(row.isovalue, 6), row.env.clone()];
        let total: f64 = row.found.budget.iter().map(|b| b.mean_square).sum();
        for b in &row.found.budget {
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
        "isovalue": row.isovalue, "environment": row.env, "mean_radiance": f.mean,
        "whole": distance_json(&f.whole), "band_limited": distance_json(&f.band_limited),
        "budget_mean_square": f.budget.iter().map(|b| (b.name.to_string(), json!(b.mean_square))).collect::<serde_json::Map<_, _>>(),
        "reference_noise": f.reference_noise, "rays": f.rays, "seconds": row.time.as_secs_f64(),
        "lookups": {
            "all": f.lookups.lookups, "renormalised": f.lookups.renormalised,
            "neighbourhood": f.lookups.neighbourhood, "unoccluded": f.lookups.unoccluded,
        },
        "photons": row.photons.as_ref().map(photon::photons_json),
    })
}
