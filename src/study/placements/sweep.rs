//! A study of placements: each kind with each number of samples, several times over.

use super::{LEVEL_SETS, PLANES, Placement, Route, RouteFound, RouteReference, THE_NINE};
use crate::error::Result;
use crate::export::atomic;
use crate::level::Pyramid;
use crate::probe::{Orientation, Probe};
use crate::quantity::{count, percent};
use crate::sampling::DirectionalSource;
use crate::sampling::statistics::Running;
use crate::scene::Member;
use crate::scene::geometry::Geometry;
use crate::session::Isosurface;
use crate::study::Clock;
use crate::surface::extract_without_normals;
use crate::transfer::Lattice;
use serde_json::{Value, json};
use std::ops::Range;
use std::path::Path;

/// What is studied, and how hard.
#[derive(Clone, Copy)]
pub struct PlacementSweep<'a> {
    /// The volume and what stands around it.
    pub member: &'a Member,
    /// The isosurface, in the file's values.
    pub isovalue: f64,
    /// Distant light, if there is any.
    pub probe: Option<&'a Probe>,
    /// How it stands around the volume.
    pub orientation: Orientation,
    /// Texels of the texture.
    pub lattice: Lattice,
    /// Albedo and emission of the level set of an isovalue.
    pub material: &'a dyn Fn(f64) -> [[f32; 3]; 2],
    /// Numbers of samples.
    pub samples: &'a [u32],
    /// Placements to try; all that make sense, if none.
    pub placements: &'a [Placement],
    /// Samples that a texel hears of in the mean.
    pub neighbours: f64,
    /// Paths of each sample.
    pub paths: u32,
    /// Random vertices at which light is compared.
    pub points: u32,
    /// Paths of the reference at each of them.
    pub reference_paths: u32,
    /// Placements of each kind with other random numbers.
    pub repeats: u32,
    /// Threads, for the record.
    pub threads: usize,
    /// Seed of all random numbers.
    pub seed: u64,
}

/// One placement and number of samples.
#[derive(Clone, Debug)]
pub struct PlacementRow {
    /// The placement.
    pub placement: Placement,
    /// Samples that were asked for.
    pub asked: u32,
    /// What was found, once a repeat.
    pub found: Vec<RouteFound>,
    /// Seconds of all processors for a repeat.
    pub cpu: f64,
}

/// What a study of placements found.
pub struct PlacementStudy {
    /// Its rows.
    pub rows: Vec<PlacementRow>,
    /// Radiance without a texture.
    pub reference: RouteReference,
    record: Value,
}

impl PlacementSweep<'_> {
    /// Places, traces, and compares. `note` hears of each row.
    ///
    /// # Errors
    /// As [`Route::reference`] and [`Route::measure`].
    pub fn run(&self, clock: &Clock<'_>, note: &dyn Fn(&str)) -> Result<PlacementStudy> {
        let volume = &*self.member.volume;
        if self.placements.is_empty() || self.placements.contains(&Placement::NineLevelSets) {
            for isovalue in THE_NINE {
                if extract_without_normals(volume, isovalue)?.triangles.is_empty() {
                    note(&format!("level sets 9: isovalue {isovalue} has no surface here, and gets no samples"));
                }
            }
        }
        let nothing = Geometry::new(Vec::new(), Vec::new(), 1.0)?;
        let pyramid = Pyramid::new(volume);
        let surface = Isosurface::extract(volume, &pyramid, self.isovalue)?;
        let points: Vec<[f32; 3]> =
            surface.random_points(self.points, self.seed).iter().map(|p| p.position_in_grid).collect();
        let source = self.probe.map(|p| p.source(self.orientation));
        let route = Route {
            volume,
            pyramid: &pyramid,
            geometry: self.member.geometry.as_ref().unwrap_or(&nothing),
            environment: source.as_ref().map(|s| s as &dyn DirectionalSource),
            isovalue: self.isovalue,
            points: &points,
            lattice: self.lattice,
            material: self.material,
            paths: self.paths,
            neighbours: self.neighbours,
        };
        let reference = route.reference(self.reference_paths, self.seed)?;
        let rows = self.rows(&route, &reference, clock, note)?;
        let record = json!({
            "isovalue": self.isovalue, "environment": self.probe.map(|p| &p.name),
            "texture": self.lattice.texels(), "points": points.len(), "paths": self.paths, "neighbours": self.neighbours,
            "repeats": self.repeats, "seed": self.seed, "threads": self.threads,
            "reference": { "paths": self.reference_paths, "rays": reference.rays, "noise": reference.noise,
                "noise_rms_percent": reference.noise_percent },
            "rows": rows.iter().flat_map(row_json).collect::<Vec<_>>(),
        });
        Ok(PlacementStudy { rows, reference, record })
    }

    fn rows(
        &self,
        route: &Route<'_>,
        reference: &RouteReference,
        clock: &Clock<'_>,
        note: &dyn Fn(&str),
    ) -> Result<Vec<PlacementRow>> {
        let mut rows = Vec::new();
        let (low, high) = route.volume.value_range();
        let has_the_nine = THE_NINE.iter().any(|c| low < *c && *c < high);
        let wanted = |p: &Placement| match self.placements {
            [] => *p != Placement::NineLevelSets || has_the_nine,
            chosen => chosen.contains(p),
        };
        for placement in Placement::ALL.into_iter().filter(wanted) {
            // As many as there are texels, whatever is asked for.
            let samples = if placement == Placement::Texels { &self.samples[..1] } else { self.samples };
            for &asked in samples {
                note(&format!("{}, {} samples", placement.name(), count(u64::from(asked))));
                let [_, before] = clock();
                let found = (0..u64::from(self.repeats))
                    .map(|i| route.measure(reference, placement, asked, self.seed.wrapping_add(i)))
                    .collect::<Result<Vec<_>>>()?;
                let [_, after] = clock();
                rows.push(PlacementRow { placement, asked, found, cpu: (after - before) / f64::from(self.repeats) });
            }
        }
        Ok(rows)
    }

    /// How the figures are to be read.
    pub fn legend(&self, reference: &RouteReference) -> String {
        let [x, y, z] = self.lattice.texels();
        format!(
            "RMS %: as Beason (2005), at vertices after the exposure of the reference, cut to [0, 1]; ± standard error over {} \
             placements. Reference: {} paths at each of {} vertices; its own noise, {:.2} % of RMS %, is in every row. \
             Texture {x}x{y}x{z}; {} paths a sample; D: radius of a ball that holds {} samples in the mean. Empty texels take \
             the nearest sample. \"texels\": a sample on each texel, without scatter. Level sets: {LEVEL_SETS} of random isovalues, \
             many level sets: n^(1/3), level sets 9: those of the thesis. Diagonal planes: {PLANES}, our guess of its \"small set\". Thesis: its figure at 10^6 samples, 100^3 texels, isovalue 47 of the \
             bump box in its box; sizes of luminaire and colours of walls are not printed there, so only the order compares.",
            self.repeats, self.reference_paths, self.points, reference.noise_percent, self.paths, self.neighbours
        )
    }
}

impl PlacementRow {
    /// Mean and standard error over the repeats of what `of` says.
    pub fn over(&self, of: impl Fn(&RouteFound) -> f64) -> (f64, f64) {
        let mut all = Running::default();
        self.found.iter().for_each(|f| all.push(of(f)));
        (all.mean(), all.standard_error())
    }

    /// A sample on each texel needs no weights: one row says it.
    fn weights(&self) -> Range<usize> {
        0..if self.placement == Placement::Texels { 1 } else { self.found[0].errors.len() }
    }
}

impl PlacementStudy {
    /// The rows for people, a head first.
    pub fn table(&self) -> Vec<Vec<String>> {
        let head = [
            "placement",
            "samples",
            "RMS %, d^-5",
            "RMS %, tent",
            "thesis",
            "relative RMS, d^-5",
            "tent",
            "D, texels",
            "empty",
            "traced",
            "noise of a sample",
            "cpu s",
        ];
        let mut lines = vec![head.map(String::from).to_vec()];
        for row in &self.rows {
            let first = &row.found[0];
            let shown = |weight: usize| {
                let (mean, error) = row.over(|f| f.errors[weight].distance.rms_percent);
                format!("{mean:.2} ± {error:.2}")
            };
            let relative = |weight: usize| percent(row.over(|f| f.errors[weight].distance.relative_rms.value).0);
            let scattered = row.placement != Placement::Texels;
            lines.push(vec![
                row.placement.name().into(),
                count(first.samples),
                shown(0),
                if scattered { shown(1) } else { "-".into() },
                row.placement
                    .of_the_thesis()
                    .filter(|_| row.asked == 1_000_000)
                    .map_or("-".into(), |v| format!("{v:.2}")),
                relative(0),
                if scattered { relative(1) } else { "-".into() },
                if scattered { format!("{:.2}", first.radius_in_texels) } else { "-".into() },
                percent(row.over(|f| f.empty as f64 / f.texels.max(1) as f64).0),
                count(first.traced),
                percent(first.sample_noise),
                format!("{:.1}", row.cpu),
            ]);
        }
        lines
    }

    /// All that was found, for programs; `input` names what was studied.
    pub fn to_json(&self, input: &str) -> Value {
        let mut whole = json!({ "input": input });
        if let (Value::Object(whole), Value::Object(record)) = (&mut whole, self.record.clone()) {
            whole.extend(record);
        }
        whole
    }

    /// Writes placements.csv and placements.json into a folder, which is made if it is not there.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, folder: &Path, input: &str) -> Result<()> {
        atomic::make_folder(folder)?;
        atomic::write_bytes(folder.join("placements.csv"), csv(&self.rows, &self.reference).as_bytes())?;
        atomic::write_bytes(folder.join("placements.json"), format!("{:#}\n", self.to_json(input)).as_bytes())
    }
}

const HEAD: &str = "placement,asked,samples,weight,repeats,rms_percent,rms_percent_stderr,relative_rms,relative_rms_stderr,bias,\
radius_in_texels,texels,empty,traced,without_level_set,sample_noise,rays,cpu_seconds,\
reference_noise_percent,reference_noise,thesis_rms_percent";

fn csv(rows: &[PlacementRow], reference: &RouteReference) -> String {
    let mut out = format!("{HEAD}\n");
    for row in rows {
        let first = &row.found[0];
        for weight in row.weights() {
            let (shown, relative) = (
                row.over(|f| f.errors[weight].distance.rms_percent),
                row.over(|f| f.errors[weight].distance.relative_rms.value),
            );
            out += &format!(
                "{},{},{},{},{},{:.4},{:.4},{:.6},{:.6},{:.6},{:.3},{},{},{},{},{:.5},{},{:.2},{:.4},{:.6},{}\n",
                row.placement.name(),
                row.asked,
                first.samples,
                first.errors[weight].weight.name(),
                row.found.len(),
                shown.0,
                shown.1,
                relative.0,
                relative.1,
                row.over(|f| f.errors[weight].distance.bias.value).0,
                first.radius_in_texels,
                first.texels,
                row.over(|f| f.empty as f64).0,
                first.traced,
                first.without_level_set,
                first.sample_noise,
                first.rays,
                row.cpu,
                reference.noise_percent,
                reference.noise,
                row.placement.of_the_thesis().map_or(String::new(), |v| v.to_string()),
            );
        }
    }
    out
}

fn row_json(row: &PlacementRow) -> Vec<Value> {
    let each = row.weights().map(|weight| {
        let distance = |f: &RouteFound| f.errors[weight].distance;
        let (shown, relative) = (row.over(|f| distance(f).rms_percent), row.over(|f| distance(f).relative_rms.value));
        let first = &row.found[0];
        json!({
            "placement": row.placement.name(), "asked": row.asked, "samples": first.samples,
            "weight": first.errors[weight].weight.name(),
            "rms_percent": { "mean": shown.0, "standard_error": shown.1 },
            "relative_rms": { "mean": relative.0, "standard_error": relative.1 },
            "bias": row.over(|f| distance(f).bias.value).0,
            "radius_in_texels": first.radius_in_texels, "texels": first.texels,
            "empty": row.over(|f| f.empty as f64).0, "traced": first.traced,
            "without_level_set": first.without_level_set, "sample_noise": first.sample_noise,
            "rays": first.rays, "cpu_seconds": row.cpu, "thesis_rms_percent": row.placement.of_the_thesis(),
        })
    });
    each.collect()
}
