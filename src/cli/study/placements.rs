//! `isolume study placements`: where radiance samples of a texture should lie.

use crate::cli::console::Console;
use crate::cli::input::VolumeArgs;
use crate::cli::isovalue::Isovalue;
use crate::cli::light::{Triple, open_probe, parse_triple};
use crate::cli::options::{Texture, check_memory, default_memory_limit, parse_bytes, parse_rays, parse_texture};
use crate::cli::{Failure, Outcome, input, output, text};
use crate::error::Error;
use crate::export::atomic;
use crate::level::Pyramid;
use crate::probe::{Orientation, Probe};
use crate::sampling::DirectionalSource;
use crate::sampling::statistics::Running;
use crate::scene::Effects;
use crate::scene::geometry::Geometry;
use crate::scene::{DARK, Scene, SceneFile};
use crate::session::Isosurface;
use crate::study::placements::{LEVEL_SETS, PLANES, Placement, Route, RouteFound, RouteReference, THE_NINE};
use crate::surface::extract_without_normals;
use crate::transfer::Lattice;
use cpu_time::ProcessTime;
use serde_json::{Value, json};
use std::io::Write as _;
use std::path::PathBuf;

/// Show where radiance samples should lie that are scattered into a texture (Beason 2005)
///
/// Radiance is path traced at many points of the volume, each on its own level set, and spread over the texels of a 3D
/// texture by Shepard's weights: the texture route of the thesis, which knows one light and no transfer. The samples are
/// placed in several ways; each texture is read at random vertices of one isosurface and compared with path tracing.
/// Writes placements.csv and placements.json.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume study placements examples/scenes/box.toml --isovalue 47
  isolume study placements bumpbox:64 --isovalue 47 --env sky --samples 10000,100000")]
pub(super) struct PlacementsArgs {
    /// Scene (.toml), volume file or field
    #[arg(value_name = "SCENE|VOLUME")]
    input: String,
    /// Isovalue: a number in the file's values, a percentage of their range, or auto
    #[arg(
        short,
        long,
        visible_alias = "isovalues",
        value_name = "C",
        default_value = "auto",
        allow_hyphen_values = true
    )]
    isovalue: Isovalue,
    /// Environment: an image file or a name [default: the scene's, if it has one]
    #[arg(short, long, value_name = "PROBE")]
    env: Option<String>,
    /// Diffuse reflectance, one number or r,g,b [default: the scene's, or 0.7]
    #[arg(long, value_name = "RHO|R,G,B", value_parser = parse_triple, allow_hyphen_values = true)]
    albedo: Option<Triple>,
    /// Texture: a ratio to the volume's resolution, or texels
    #[arg(long, value_name = "RATIO|XxYxZ", default_value = "100x100x100", value_parser = parse_texture)]
    texture: Texture,
    /// Numbers of samples
    #[arg(long, value_name = "N[,N…]", value_delimiter = ',', default_value = "10000,100000,1000000",
        value_parser = clap::value_parser!(u32).range(1..=100_000_000))]
    samples: Vec<u32>,
    /// Placements to try [default: all]
    #[arg(long, value_name = "NAME[,NAME…]", value_delimiter = ',', value_parser = parse_placement)]
    placements: Vec<Placement>,
    /// Samples that a texel hears of in the mean, were they spread evenly: it gives the radius D
    #[arg(long, value_name = "K", default_value_t = 32.0)]
    neighbours: f64,
    /// Paths of each sample, a power of two
    #[arg(long, value_name = "N", default_value = "64", value_parser = parse_rays)]
    paths: u32,
    /// Random vertices at which light is compared
    #[arg(long, value_name = "N", default_value_t = 2000, value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    points: u32,
    /// Paths of the reference at each of them, a power of two
    #[arg(long, value_name = "N", default_value = "4096", value_parser = parse_rays)]
    reference_paths: u32,
    /// Placements of each kind with other random numbers; figures are means with their standard error
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    /// Refuse to use more memory than this
    #[arg(long, value_name = "SIZE", value_parser = parse_bytes)]
    memory_limit: Option<u64>,
    /// Folder for placements.csv and placements.json [default: NAME-placements]
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten, next_help_heading = "Volume")]
    volume: VolumeArgs,
}

fn parse_placement(text: &str) -> Result<Placement, String> {
    let name = |placement: &Placement| placement.name().replace(' ', "-");
    let names = || Placement::ALL.iter().map(name).collect::<Vec<_>>().join(", ");
    Placement::ALL.into_iter().find(|p| name(p) == text).ok_or_else(|| format!("give one of {}", names()))
}

/// One placement and number of samples.
struct Row {
    placement: Placement,
    asked: u32,
    found: Vec<RouteFound>,
    cpu: f64,
}

impl PlacementsArgs {
    pub(super) fn run(&self, seed: u64, console: &Console) -> Outcome {
        let is_scene = self.input.to_ascii_lowercase().ends_with(".toml");
        let file = is_scene.then(|| SceneFile::read(&self.input)).transpose()?;
        let options = self.volume.options();
        let mut scene = match &file {
            Some(file) => file.open(&options, &Effects::default())?,
            None => Scene::open_with(&self.input, &options, &Effects::default())?,
        };
        let Some(opened) = scene.members_mut().first_mut() else {
            return Err(Failure::Message("a scene without volumes".into()));
        };
        let chosen = opened.choose(self.isovalue)?;
        opened.take_side(std::slice::from_ref(&chosen))?;
        let volume = &*opened.volume;
        for note in &volume.notes {
            console.note(&note.text);
        }
        let otherwise = format!("{}-placements", volume.name);
        let folder = output::result_folder(self.output.as_deref(), otherwise, "placements.csv")?;
        volume.check_cells()?;
        let most = self.samples.iter().copied().max().unwrap_or(0);
        // Position, site, radiance and node of a sample.
        let limit = Some(self.memory_limit.unwrap_or_else(default_memory_limit));
        check_memory("the samples of the study", u64::from(most) * 200, limit)?;
        let lattice = match self.texture {
            Texture::Ratio(ratio) => Lattice::from_ratio(volume.dims(), ratio)?,
            Texture::Texels(texels) => Lattice::from_texels(volume.dims(), texels)?,
        };
        let isovalue = chosen.value;
        let probe = self.probe(file.as_ref())?;
        let turned = file.as_ref().and_then(|f| f.description.probe.as_ref()?.rotation).unwrap_or(0.0);
        let orientation = Orientation::new(volume.up, turned)?;
        let source = probe.as_ref().map(|p| p.source(orientation));
        if self.placements.is_empty() || self.placements.contains(&Placement::NineLevelSets) {
            for isovalue in THE_NINE {
                if extract_without_normals(volume, isovalue)?.triangles.is_empty() {
                    console.note(format!("level sets 9: isovalue {isovalue} has no surface here, and gets no samples"));
                }
            }
        }
        let nothing = Geometry::new(Vec::new(), Vec::new(), 1.0)?;
        let pyramid = Pyramid::new(volume);
        let surface = Isosurface::extract(volume, &pyramid, isovalue)?;
        let points: Vec<[f32; 3]> =
            surface.random_points(self.points, seed).iter().map(|p| p.position_in_grid).collect();
        let material = self.material(file.as_ref(), volume.value_range());
        let route = Route {
            volume,
            pyramid: &pyramid,
            geometry: opened.geometry.as_ref().unwrap_or(&nothing),
            environment: source.as_ref().map(|s| s as &dyn DirectionalSource),
            isovalue,
            points: &points,
            lattice,
            material: &material,
            paths: self.paths,
            neighbours: self.neighbours,
        };
        let reference = route.reference(self.reference_paths, seed)?;
        let rows = self.measured_rows(&route, &reference, seed, console)?;
        let whole = json!({
            "input": input::file_name(&self.input), "isovalue": isovalue, "environment": probe.map(|p| p.name),
            "texture": lattice.texels(), "points": points.len(), "paths": self.paths, "neighbours": self.neighbours,
            "repeats": self.repeats, "seed": seed, "threads": rayon::current_num_threads(),
            "reference": { "paths": self.reference_paths, "rays": reference.rays, "noise": reference.noise,
                "noise_rms_percent": reference.noise_percent },
            "rows": rows.iter().flat_map(row_json).collect::<Vec<_>>(),
        });
        std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, "make the folder", e))?;
        for (name, bytes) in [
            ("placements.csv", csv(&rows, &reference).into_bytes()),
            ("placements.json", format!("{whole:#}\n").into_bytes()),
        ] {
            let path = folder.join(name);
            atomic::write(&path, |w| w.write_all(&bytes).map_err(|e| Error::io(&path, "write", e)))?;
        }
        console.print(table(&rows));
        console.print(self.legend(&reference, lattice));
        console.print(format!("\nwritten to {}: placements.csv, placements.json", folder.display()));
        console.print_json(&whole);
        Ok(())
    }

    fn measured_rows(
        &self,
        route: &Route<'_>,
        reference: &RouteReference,
        seed: u64,
        console: &Console,
    ) -> Outcome<Vec<Row>> {
        let mut rows = Vec::new();
        let (low, high) = route.volume.value_range();
        let has_the_nine = THE_NINE.iter().any(|c| low < *c && *c < high);
        let wanted = |p: &Placement| match self.placements.as_slice() {
            [] => *p != Placement::NineLevelSets || has_the_nine,
            chosen => chosen.contains(p),
        };
        for placement in Placement::ALL.into_iter().filter(wanted) {
            // As many as there are texels, whatever is asked for.
            let samples = if placement == Placement::Texels { &self.samples[..1] } else { &self.samples };
            for &asked in samples {
                console.note(format!("{}, {} samples", placement.name(), text::count(u64::from(asked))));
                let clock = ProcessTime::now();
                let measured = (0..u64::from(self.repeats))
                    .map(|i| route.measure(reference, placement, asked, seed.wrapping_add(i)))
                    .collect::<Result<Vec<_>, Error>>()?;
                let cpu = clock.elapsed().as_secs_f64() / f64::from(self.repeats);
                rows.push(Row { placement, asked, found: measured, cpu });
            }
        }
        Ok(rows)
    }

    fn probe(&self, file: Option<&SceneFile>) -> Outcome<Option<Probe>> {
        let name = self.env.clone().or_else(|| file.and_then(SceneFile::environment));
        let name = name.filter(|name| name != DARK);
        Ok(name.map(|name| open_probe(&name, false, None)).transpose()?)
    }

    /// Albedo and emission over the isovalue.
    fn material(&self, file: Option<&SceneFile>, range: (f64, f64)) -> impl Fn(f64) -> [[f32; 3]; 2] {
        let given = self.albedo.map(|triple| triple.0);
        let described = file.and_then(|f| f.description.albedo.as_ref()).map(|albedo| albedo.rule(range));
        let emission = file.and_then(|f| f.description.emission.clone());
        move |isovalue| {
            let albedo = given.or_else(|| described.as_ref().map(|rule| rule.albedo(isovalue))).unwrap_or([0.7; 3]);
            [albedo, emission.as_ref().map_or([0.0; 3], |rule| rule.at(isovalue))]
        }
    }

    fn legend(&self, reference: &RouteReference, lattice: Lattice) -> String {
        let [x, y, z] = lattice.texels();
        format!(
            "\nRMS %: as Beason (2005), at vertices after the exposure of the reference, cut to [0, 1]; ± standard error over {} \
             placements. Reference: {} paths at each of {} vertices; its own noise, {:.2} % of RMS %, is in every row. \
             Texture {x}x{y}x{z}; {} paths a sample; D: radius of a ball that holds {} samples in the mean. Empty texels take \
             the nearest sample. \"texels\": a sample on each texel, without scatter. Level sets: {LEVEL_SETS} of random isovalues, \
             many level sets: n^(1/3), level sets 9: those of the thesis. Diagonal planes: {PLANES}, our guess of its \"small set\". Thesis: its figure at 10^6 samples, 100^3 texels, isovalue 47 of the \
             bump box in its box; sizes of luminaire and colours of walls are not printed there, so only the order compares.",
            self.repeats, self.reference_paths, self.points, reference.noise_percent, self.paths, self.neighbours
        )
    }
}

/// Mean and standard error over the repeats.
fn over(found: &[RouteFound], of: impl Fn(&RouteFound) -> f64) -> (f64, f64) {
    let mut all = Running::default();
    found.iter().for_each(|f| all.push(of(f)));
    (all.mean(), all.standard_error())
}

fn table(rows: &[Row]) -> String {
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
    for row in rows {
        let first = &row.found[0];
        let shown = |weight: usize| {
            let (mean, error) = over(&row.found, |f| f.errors[weight].distance.rms_percent);
            format!("{mean:.2} ± {error:.2}")
        };
        let relative =
            |weight: usize| text::percent(over(&row.found, |f| f.errors[weight].distance.relative_rms.value).0);
        let scattered = row.placement != Placement::Texels;
        lines.push(vec![
            row.placement.name().into(),
            text::count(first.samples),
            shown(0),
            if scattered { shown(1) } else { "-".into() },
            row.placement.of_the_thesis().filter(|_| row.asked == 1_000_000).map_or("-".into(), |v| format!("{v:.2}")),
            relative(0),
            if scattered { relative(1) } else { "-".into() },
            if scattered { format!("{:.2}", first.radius_in_texels) } else { "-".into() },
            text::percent(over(&row.found, |f| f.empty as f64 / f.texels.max(1) as f64).0),
            text::count(first.traced),
            text::percent(first.sample_noise),
            format!("{:.1}", row.cpu),
        ]);
    }
    text::table(&lines)
}

const HEAD: &str = "placement,asked,samples,weight,repeats,rms_percent,rms_percent_stderr,relative_rms,relative_rms_stderr,bias,\
radius_in_texels,texels,empty,traced,without_level_set,sample_noise,rays,cpu_seconds,\
reference_noise_percent,reference_noise,thesis_rms_percent";

fn csv(rows: &[Row], reference: &RouteReference) -> String {
    let mut out = format!("{HEAD}\n");
    for row in rows {
        let first = &row.found[0];
        for weight in weights(row) {
            let (shown, relative) = (
                over(&row.found, |f| f.errors[weight].distance.rms_percent),
                over(&row.found, |f| f.errors[weight].distance.relative_rms.value),
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
                over(&row.found, |f| f.errors[weight].distance.bias.value).0,
                first.radius_in_texels,
                first.texels,
                over(&row.found, |f| f.empty as f64).0,
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

/// A sample on each texel needs no weights: one row says it.
fn weights(row: &Row) -> std::ops::Range<usize> {
    0..if row.placement == Placement::Texels { 1 } else { row.found[0].errors.len() }
}

fn row_json(row: &Row) -> Vec<Value> {
    let each = weights(row).map(|weight| {
        let distance = |f: &RouteFound| f.errors[weight].distance;
        let (shown, relative) =
            (over(&row.found, |f| distance(f).rms_percent), over(&row.found, |f| distance(f).relative_rms.value));
        let first = &row.found[0];
        json!({
            "placement": row.placement.name(), "asked": row.asked, "samples": first.samples,
            "weight": first.errors[weight].weight.name(),
            "rms_percent": { "mean": shown.0, "standard_error": shown.1 },
            "relative_rms": { "mean": relative.0, "standard_error": relative.1 },
            "bias": over(&row.found, |f| distance(f).bias.value).0,
            "radius_in_texels": first.radius_in_texels, "texels": first.texels,
            "empty": over(&row.found, |f| f.empty as f64).0, "traced": first.traced,
            "without_level_set": first.without_level_set, "sample_noise": first.sample_noise,
            "rays": first.rays, "cpu_seconds": row.cpu, "thesis_rms_percent": row.placement.of_the_thesis(),
        })
    });
    each.collect()
}
