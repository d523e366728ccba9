//! `isolume compare`: the store's answer against paths and photons on the same surface, and why they differ.

use crate::cli::args::comparison::PictureOutput;
use crate::cli::args::light::parse_triple;
use crate::cli::args::photons::PhotonArgs;
use crate::cli::failure::Outcome;
use crate::cli::present::comparison;
use crate::cli::present::console::Console;
use crate::compare::{Asked, Compared, Subject, subjects};
use crate::export::inputs::Inputs;
use crate::probe::{EnvFrame, SunSplit};
use crate::scene::{Effects, Fog, NamedIsovalue, Scene, SceneFile, VolumeOptions, open_probe};
use crate::session::{LuminaireFactor, check_factors};
use crate::transfer::store::{Store, check_store};
use serde_json::json;
use std::time::Instant;

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
pub(in crate::cli) struct Compare {
    /// The store
    #[arg(value_name = "X.isolume")]
    input: String,
    /// Isovalues that the store holds: numbers in the file's values, percentages of their range, or auto. Of several
    /// volumes baked together isovalues are those of the first, NAME=C is that of another, and all surfaces that belong
    /// to it are compared
    #[arg(short, long, visible_alias = "isovalues", value_name = "[NAME=]C[,…]", value_delimiter = ',')]
    #[arg(required = true, allow_hyphen_values = true)]
    isovalue: Vec<NamedIsovalue>,
    /// Environment: an image file or a name, as relight takes it
    #[arg(short, long, value_name = "PROBE", required = true)]
    env: Vec<String>,
    /// Turn the light counter-clockwise about up, seen from above, in degrees
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_hyphen_values = true)]
    env_rotate: f64,
    /// Where the centre of environment images lies in glTF: at +X (Blender, three.js), or at +Z (OpenEXR)
    #[arg(long, value_enum, value_name = "FRAME", default_value = "gltf")]
    env_frame: EnvFrame,
    /// Lamps lit apart from the environment, as relight lights them: as many as would ring otherwise, none, or so many; none
    /// in scenes
    #[arg(long, value_name = "auto|off|N", default_value = "auto", value_parser = crate::cli::args::light::parse_split)]
    sun_split: SunSplit,
    /// Diffuse reflectance, one number or r,g,b
    #[arg(long, value_name = "RHO|R,G,B", default_value = "0.7", value_parser = parse_triple, allow_hyphen_values = true)]
    albedo: crate::cli::args::light::Triple,
    /// Radiance that the surface emits, one number or r,g,b
    #[arg(long, value_name = "E|R,G,B", default_value = "0", value_parser = parse_triple, allow_hyphen_values = true)]
    emission: crate::cli::args::light::Triple,
    /// The scene (.toml) that the store was baked of: stores hold what walls and luminaires do to light, not their
    /// shapes
    #[arg(long, value_name = "SCENE")]
    scene: Option<String>,
    /// The environment that the store was baked with as a luminaire (bake --fixed-env), turned by --env-rotate as it was
    #[arg(long, value_name = "PROBE", conflicts_with = "scene")]
    fixed_env: Option<String>,
    /// The fog that the store was baked with (bake --fog)
    #[arg(long, value_name = "SIGMA[,ALBEDO[,G]]", conflicts_with = "scene")]
    fog: Option<Fog>,
    /// Factor on the power of a luminaire, one number or three for red, green and blue, such as ceiling=2
    #[arg(long = "luminaire", value_name = "NAME=FACTOR")]
    luminaires: Vec<LuminaireFactor>,
    /// Compare only this one of several volumes baked together; isovalues are then its own
    #[arg(long = "volume", value_name = "NAME")]
    of_volume: Option<String>,
    /// Random vertices at which light is compared; with --against geometry points of the triangles
    #[arg(long, value_name = "N", default_value_t = 2000, value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    points: u32,
    /// Paths of the reference at each of them, a power of two
    #[arg(long, value_name = "N", default_value = "256", value_parser = crate::cli::args::transfer::parse_rays)]
    paths: u32,
    /// Paths for each texel of the budget's exact texels, a power of two
    #[arg(long, value_name = "N", default_value = "1024", value_parser = crate::cli::args::transfer::parse_rays)]
    texel_rays: u32,
    /// What is compared beside path tracing; photons are then the reference of the pictures, too
    #[arg(long, value_enum, default_value = "path")]
    against: Against,
    /// With --against geometry, list every point in --json: its place in the grid, the normal of the surface itself there,
    /// and radiance by the store, by paths about smoothed normals, and by paths on the surface itself
    #[arg(long)]
    list_points: bool,
    #[command(flatten)]
    photons: PhotonArgs,
    #[command(flatten)]
    pictures: PictureOutput,
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

impl Compare {
    pub(in crate::cli) fn run(&self, seed: u64, console: &Console) -> Outcome {
        check_store(&self.input)?;
        let file = self.scene.as_deref().map(SceneFile::read).transpose()?;
        let read = self.env.iter().chain([&self.input]).chain(&self.scene);
        self.pictures.refuse(&Inputs::new(read))?;
        let store = Store::open_telling(&self.input, true, |note| console.note(note))?;
        let mut scene = file.map(|f| f.open(&VolumeOptions::default(), &Effects::default())).transpose()?;
        if let Some(name) = &self.fixed_env {
            let mut alone = Scene::of(store.volume()?).with_added(self.fog, None, &Effects::default())?;
            alone.fix_environment(&open_probe(name, false, None)?, self.env_rotate, self.env_frame)?;
            scene = Some(alone);
        } else if self.fog.is_some() {
            scene = Some(Scene::of(store.volume()?).with_added(self.fog, None, &Effects::default())?);
        }
        let names = store.identity().scene.as_ref().map_or(&[][..], |scene| &scene.luminaires);
        check_factors(names, &self.luminaires)?;
        let (subjects, isovalues) = subjects(store, scene.as_ref(), self.of_volume.as_deref(), &self.isovalue)?;
        let probes = self.env.iter().map(|e| open_probe(e, false, None)).collect::<Result<Vec<_>, _>>()?;
        let names: Vec<String> = probes.iter().map(|p| p.name.clone()).collect();
        if subjects.iter().any(|subject| subject.baked_by(self.texel_rays).is_none()) {
            console.note("the texels of this estimator cannot be made again: noise, bias and rounding are one row");
        }
        let files = match (subjects.as_slice(), isovalues.as_slice()) {
            ([one], [isovalues]) => self.pictures.files().files(&one.volume.name, isovalues, &names)?,
            _ => self.pictures.files().refuse().map(|()| Vec::new())?,
        };
        let by_photons = |volume: &_, isovalue| self.photons.question(volume, isovalue, seed);
        let asked = Asked {
            probes: &probes,
            rotation_degrees: self.env_rotate,
            frame: self.env_frame,
            sun_split: self.sun_split,
            albedo: self.albedo.0,
            emission: self.emission.0,
            luminaires: &self.luminaires,
            points: self.points,
            paths: self.paths,
            texel_rays: self.texel_rays,
            against: match self.against {
                Against::Path => crate::compare::Against::Nothing,
                Against::Photon => crate::compare::Against::Photons(&by_photons),
                Against::Geometry => crate::compare::Against::Geometry { list: self.list_points },
            },
            seed,
        };
        let start = Instant::now();
        let seconds = || start.elapsed().as_secs_f64();
        let mut rows = Vec::new();
        for (subject, isovalues) in subjects.iter().zip(&isovalues) {
            for (i, &isovalue) in isovalues.iter().enumerate() {
                rows.extend(asked.rows(subject, isovalue, &seconds, &|p, shown| {
                    let look = self.pictures.look(subject.volume.up);
                    files.get(i * probes.len() + p).map_or(Ok(()), |files| shown.write(files, &look))
                })?);
            }
        }
        console.print(comparison::table(&rows));
        console.print(format!(
            "\n{} {}, {} paths each; all figures over the mean radiance of the reference. ± is half of the \
             95 % interval over the vertices. RMS %: after the reference's exposure, clamped to [0, 1], as Beason (2005) measured. \
             Stated: what relight says of its error; covers: how many channels are within 95 % of that.",
            self.points,
            if self.against == Against::Geometry { "points" } else { "vertices" },
            self.paths
        ));
        if subjects.iter().any(Subject::is_among_others) {
            console.print("Vertices that another volume buries are left out.");
        }
        console.print(format!("\nWhy: shares of the mean square of the difference\n{}", comparison::budget(&rows)));
        if self.against == Against::Photon {
            console.print(format!("\n{}", comparison::photons(&rows)));
        }
        if self.against == Against::Geometry {
            console.print(format!("\n{}", comparison::geometry(&rows)));
        }
        for path in files.iter().flat_map(|f| f.paths()) {
            console.print(path.display());
        }
        console.print_json(&json!({
            "points": self.points, "paths": self.paths, "texel_rays": self.texel_rays,
            "rows": rows.iter().map(Compared::to_json).collect::<Vec<_>>(),
        }));
        Ok(())
    }
}
