//! `isolume study`: what accuracy costs in time on the user's own volume, measured.

use crate::cli::args::light::parse_triple;
use crate::cli::args::transfer::parse_bytes;
use crate::cli::args::volume::VolumeArgs;
use crate::cli::commands::placements::PlacementsArgs;
use crate::cli::commands::polygonizers::PolygonizersArgs;
use crate::cli::commands::thesis::ThesisArgs;
use crate::cli::failure::Outcome;
use crate::cli::present::console::Console;
use crate::cli::present::lent::clock;
use crate::cli::present::{study, text};
use crate::error::Error;
use crate::export::target;
use crate::probe::Orientation;
use crate::scene::{Effects, Scene, SceneFile, environment};
use crate::study::sweep::Sweep;
use crate::volume::Isovalue;
use std::path::PathBuf;

/// Show what accuracy costs in time: bake one surface in many ways and compare each with
/// path tracing
///
/// The texels of one isosurface are baked with more and more rays, with fewer bands and layers, on coarser textures and
/// with other estimators. Each is timed and compared, at random vertices, with unbiased paths under the same
/// environment. Writes study.csv, study.json and the figure study.svg.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume study brain.nii.gz --isovalue 90 --env courtyard -o brain-study
  isolume study bumpbox:64 --quick
  isolume study placements examples/scenes/box.toml --isovalue 47
  isolume study polygonizers examples/models/hand.toml:64")]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(in crate::cli) struct Study {
    #[command(subcommand)]
    other: Option<OtherStudy>,
    /// Volume file, field or scene (.toml)
    #[arg(value_name = "VOLUME|SCENE", required = true)]
    input: Option<String>,
    /// Isovalue: a number in the file's values, a percentage of their range, or auto; of a scene of several volumes
    /// that of the first
    #[arg(short, long, visible_alias = "isovalues", value_name = "C")]
    #[arg(default_value = "auto", allow_hyphen_values = true)]
    isovalue: Isovalue,
    /// Environment: an image file or a name, as relight takes it [default: the scene's, else courtyard]
    #[arg(short, long, value_name = "PROBE")]
    env: Option<String>,
    /// Diffuse reflectance, one number or r,g,b [default: the scene's, else 0.7]
    #[arg(long, value_name = "RHO|R,G,B", value_parser = parse_triple, allow_hyphen_values = true)]
    albedo: Option<crate::cli::args::light::Triple>,
    /// The volume to study, of a scene of several [default: the first]
    #[arg(long = "volume", value_name = "NAME")]
    of_volume: Option<String>,
    /// Random vertices at which light is compared
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    points: u32,
    /// Paths of the reference at each of them, a power of two
    #[arg(long, value_name = "N", default_value = "4096", value_parser = crate::cli::args::transfer::parse_rays)]
    paths: u32,
    /// Paths for each exact texel of the budget, a power of two
    #[arg(long, value_name = "N", default_value = "4096", value_parser = crate::cli::args::transfer::parse_rays)]
    texel_rays: u32,
    /// Most rays a texel that are tried
    #[arg(long, value_name = "N", default_value = "1024", value_parser = crate::cli::args::transfer::parse_rays)]
    most_rays: u32,
    /// A coarser reference and fewer bakes: a picture in a fraction of the time
    #[arg(long)]
    quick: bool,
    /// Refuse to use more memory than this
    #[arg(long, value_name = "SIZE", value_parser = parse_bytes)]
    memory_limit: Option<u64>,
    /// Folder for study.csv, study.json and study.svg [default: NAME-study]
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten, next_help_heading = "Volume")]
    volume: VolumeArgs,
}

/// Studies of other questions.
#[derive(clap::Subcommand)]
enum OtherStudy {
    Placements(Box<PlacementsArgs>),
    Polygonizers(PolygonizersArgs),
    Thesis(ThesisArgs),
}

impl Study {
    pub(in crate::cli) fn run(&self, seed: u64, console: &Console) -> Outcome {
        match &self.other {
            Some(OtherStudy::Placements(other)) => return other.run(seed, console),
            Some(OtherStudy::Polygonizers(other)) => return other.run(console),
            Some(OtherStudy::Thesis(other)) => return other.run(seed, console),
            None => {}
        }
        let mut scene = self.open()?;
        let file = scene.description().cloned();
        let member = self.of_volume.as_ref().map_or(Ok(0), |name| scene.member_named(name))?;
        let opened = &mut scene.members_mut()[member];
        let chosen = opened.choose(self.isovalue(file.as_ref())?)?;
        opened.take_side(std::slice::from_ref(&chosen))?;
        let volume = &*opened.volume;
        volume.notes.iter().for_each(|note| console.note(&note.text));
        let folder = target::result_folder(self.output.as_deref(), format!("{}-study", volume.name), "study.csv")?;
        volume.check_cells()?;
        let (probe, turned) = environment(self.env.as_deref(), file.as_ref())?;
        let sweep = Sweep {
            member: opened,
            isovalue: chosen.value,
            file: file.as_ref(),
            probe: &probe,
            orientation: Orientation::new(volume.up, turned)?,
            albedo: self.albedo.map(|albedo| albedo.0),
            points: self.points,
            paths: self.paths,
            texel_rays: self.texel_rays,
            most_rays: self.most_rays,
            quick: self.quick,
            memory_limit: self.memory_limit,
            threads: rayon::current_num_threads(),
            seed,
        };
        let swept = sweep.run(&clock(), &|text| console.note(text))?;
        swept.write(&folder)?;
        console.print(study::table(&swept));
        console.print(format!(
            "\nforecast of the pilot of `isolume plan`, against what was measured\n{}",
            study::forecasts(&swept)
        ));
        console.print(format!("\nseconds of processor time to the same error\n{}", study::seconds(&swept)));
        console.print(format!("\nfewer bits, of the bake with {} rays\n{}", swept.rays_of_kept, study::kept(&swept)));
        console.print(format!(
            "\nwritten to {}: study.csv, study.json, study.svg; reference: {} rays, noise {}, {:.1} s",
            folder.display(),
            text::metric(swept.reference_rays as f64),
            text::percent(swept.reference_noise),
            swept.reference_seconds[0]
        ));
        console.print_json(&swept.to_json());
        Ok(())
    }

    /// Opens what is studied; what a scene says of its volume counts where no option does.
    fn open(&self) -> Outcome<Scene> {
        let input = self.input.as_deref().unwrap_or_default();
        let mut options = self.volume.options();
        if input.to_ascii_lowercase().ends_with(".toml") {
            let description = SceneFile::read(input)?.description;
            options.solid = options.solid.or(description.solid);
            options.up = options.up.or(description.up);
        }
        Ok(Scene::open_with(input, &options, &Effects::default())?)
    }

    /// The isovalue asked for, else the first of the scene.
    fn isovalue(&self, file: Option<&SceneFile>) -> Result<Isovalue, Error> {
        let of_scene = file.filter(|_| self.isovalue == Isovalue::Auto).map(SceneFile::listed_isovalues);
        of_scene.iter().flatten().next().map_or(Ok(self.isovalue), |first| first.parse())
    }
}
