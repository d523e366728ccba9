//! `isolume study placements`: where radiance samples of a texture should lie.

use crate::bake::lattice_of;
use crate::cli::args::light::{Triple, parse_triple};
use crate::cli::args::transfer::{parse_bytes, parse_rays};
use crate::cli::args::volume::VolumeArgs;
use crate::cli::failure::{Failure, Outcome};
use crate::cli::present::console::Console;
use crate::cli::present::lent::clock;
use crate::cli::present::text;
use crate::export::target;
use crate::file::file_name;
use crate::memory;
use crate::probe::{Orientation, Probe};
use crate::scene::{DARK, Effects, Scene, SceneFile, TextureSize, open_probe};
use crate::study::placements::Placement;
use crate::study::placements::sweep::PlacementSweep;
use crate::volume::Isovalue;
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
pub(in crate::cli) struct PlacementsArgs {
    /// Scene (.toml), volume file or field
    #[arg(value_name = "SCENE|VOLUME")]
    input: String,
    /// Isovalue: a number in the file's values, a percentage of their range, or auto
    #[arg(short, long, visible_alias = "isovalues", value_name = "C")]
    #[arg(default_value = "auto", allow_hyphen_values = true)]
    isovalue: Isovalue,
    /// Environment: an image file or a name [default: the scene's, if it has one]
    #[arg(short, long, value_name = "PROBE")]
    env: Option<String>,
    /// Diffuse reflectance, one number or r,g,b [default: the scene's, or 0.7]
    #[arg(long, value_name = "RHO|R,G,B", value_parser = parse_triple, allow_hyphen_values = true)]
    albedo: Option<Triple>,
    /// Texture: a ratio to the volume's resolution, or texels
    #[arg(long, value_name = "RATIO|XxYxZ", default_value = "100x100x100")]
    texture: TextureSize,
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

impl PlacementsArgs {
    pub(in crate::cli) fn run(&self, seed: u64, console: &Console) -> Outcome {
        let mut scene = Scene::open_with(&self.input, &self.volume.options(), &Effects::default())?;
        let file = scene.description().cloned();
        let Some(opened) = scene.members_mut().first_mut() else {
            return Err(Failure::Message("a scene without volumes".into()));
        };
        let chosen = opened.choose(self.isovalue)?;
        opened.take_side(std::slice::from_ref(&chosen))?;
        let volume = &*opened.volume;
        volume.notes.iter().for_each(|note| console.note(&note.text));
        let otherwise = format!("{}-placements", volume.name);
        let folder = target::result_folder(self.output.as_deref(), otherwise, "placements.csv")?;
        volume.check_cells()?;
        let most = self.samples.iter().copied().max().unwrap_or(0);
        // Position, site, radiance and node of a sample.
        memory::check("the samples of the study", u64::from(most) * 200, self.memory_limit)?;
        let probe = self.probe(file.as_ref())?;
        let turned = file.as_ref().map_or(0.0, SceneFile::rotation);
        let sweep = PlacementSweep {
            member: opened,
            isovalue: chosen.value,
            probe: probe.as_ref(),
            orientation: Orientation::new(volume.up, turned)?,
            lattice: lattice_of(volume, self.texture)?,
            material: &self.material(file.as_ref(), volume.value_range()),
            samples: &self.samples,
            placements: &self.placements,
            neighbours: self.neighbours,
            paths: self.paths,
            points: self.points,
            reference_paths: self.reference_paths,
            repeats: self.repeats,
            threads: rayon::current_num_threads(),
            seed,
        };
        let found = sweep.run(&clock(), &|text| console.note(text))?;
        let name = file_name(&self.input);
        found.write(&folder, &name)?;
        console.print(text::table(&found.table()));
        console.print(format!("\n{}", sweep.legend(&found.reference)));
        console.print(format!("\nwritten to {}: placements.csv, placements.json", folder.display()));
        console.print_json(&found.to_json(&name));
        Ok(())
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
}
