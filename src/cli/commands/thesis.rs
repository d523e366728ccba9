//! `isolume study thesis`: the table of Beason (2005) on data at hand.

use crate::cli::args::transfer::parse_rays;
use crate::cli::failure::Outcome;
use crate::cli::present::console::Console;
use crate::cli::present::lent::clock;
use crate::cli::present::text;
use crate::error::Error;
use crate::export::{atomic, target};
use crate::study::thesis::Effort;
use crate::study::thesis::table::{ThesisTable, data_sets};
use std::path::PathBuf;

/// Bake several data sets in a box of coloured walls, and compare with the light computed directly (Beason 2005, table 5.14)
///
/// Rows: the bump box, stand-ins for the two-field data (nucleons and spray), and a neuron and a brain where they are given.
/// Each stands in a closed room under one luminaire. By spherical harmonics at the vertices of the isosurfaces, and by photons
/// (indirect light from the map, direct light by rays); errors against path tracing at random vertices, in percent of white after
/// the exposure of the reference, mean over the isovalues. Writes thesis.csv and thesis.json.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume study thesis
  isolume study thesis --neuron neuron.nrrd --brain brain.nii.gz --rays 256")]
pub(in crate::cli) struct ThesisArgs {
    /// A volume in the place of the neuron of the thesis
    #[arg(long, value_name = "VOLUME")]
    neuron: Option<String>,
    /// Isovalues of it
    #[arg(long, value_name = "C[,C…]", value_delimiter = ',', default_value = "30,45,90")]
    neuron_isovalues: Vec<f64>,
    /// A volume in the place of the brain of the thesis
    #[arg(long, value_name = "VOLUME")]
    brain: Option<String>,
    /// Isovalues of it; those of the thesis
    #[arg(long, value_name = "C[,C…]", value_delimiter = ',', default_value = "77,106,97,82,19")]
    brain_isovalues: Vec<f64>,
    /// Samples of the bump box along a side; stand-ins have those of the thesis, 101 and 120, or as many if that is less
    #[arg(long, value_name = "N", default_value_t = 101, value_parser = clap::value_parser!(u32).range(8..=1024))]
    size: u32,
    /// Paths of a vertex, a power of two
    #[arg(long, value_name = "N", default_value = "256", value_parser = parse_rays)]
    rays: u32,
    /// Photons sent out for each isosurface
    #[arg(long, value_name = "N", default_value_t = 1 << 22, value_parser = clap::value_parser!(u32).range(1..=1 << 30))]
    photons: u32,
    /// Random vertices at which light is compared
    #[arg(long, value_name = "N", default_value_t = 2000, value_parser = clap::value_parser!(u32).range(2..=1_000_000))]
    points: u32,
    /// Paths of the reference at each of them, a power of two
    #[arg(long, value_name = "N", default_value = "1024", value_parser = parse_rays)]
    reference_paths: u32,
    /// Folder for thesis.csv and thesis.json
    #[arg(short, long, value_name = "DIR", default_value = "thesis")]
    output: PathBuf,
}

impl ThesisArgs {
    pub(in crate::cli) fn run(&self, seed: u64, console: &Console) -> Outcome {
        let neuron = self.neuron.as_deref().map(|file| (file, &*self.neuron_isovalues));
        let brain = self.brain.as_deref().map(|file| (file, &*self.brain_isovalues));
        let sets = data_sets(self.size, neuron, brain)?;
        let folder = target::result_folder(Some(&self.output), String::new(), "thesis.csv")?;
        let effort =
            Effort { rays: self.rays, photons: self.photons, points: self.points, paths: self.reference_paths, seed };
        atomic::make_folder(&folder)?;
        let scratch = tempfile::Builder::new().prefix(".stores-").tempdir_in(&folder);
        let scratch = scratch.map_err(|e| Error::io(&folder, "make a folder in", e))?;
        let found = ThesisTable::measure(sets, &effort, scratch.path(), &clock(), &|text| console.note(text))?;
        console.print(text::table(&found.table()));
        console.print(format!("\n{}", effort.legend()));
        found.write(&folder)?;
        console.print_json(&found.to_json());
        console.print(folder.join("thesis.csv").display());
        Ok(())
    }
}
