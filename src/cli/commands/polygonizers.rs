//! `isolume study polygonizers`: continuation on a model against marching cubes on its samples.

use crate::cli::failure::Outcome;
use crate::cli::present::console::Console;
use crate::cli::present::lent::clock;
use crate::cli::present::text;
use crate::export::target;
use crate::scene::{ModelName, describe};
use crate::study::polygonizers::compare_polygonizers;
use std::path::PathBuf;

/// Compare ways to make triangles of a model: by its samples, as all commands do, and by continuation on the model itself
///
/// Continuation goes from cell to cell along the surface, from seeds on the primitives: by cubes or by six tetrahedra each, with
/// vertices by linear interpolation, regula falsi or Newton's steps. Writes polygonizers.csv and polygonizers.json.
#[derive(clap::Args)]
#[command(after_help = "Example:
  isolume study polygonizers examples/models/hand.toml:64")]
pub(in crate::cli) struct PolygonizersArgs {
    /// Model (.toml), with its samples along the longest side
    #[arg(value_name = "MODEL.toml[:N]")]
    input: String,
    /// Isovalue [default: that of the model]
    #[arg(short, long, value_name = "C", allow_hyphen_values = true)]
    isovalue: Option<f64>,
    /// Read files that lie outside the folder of the model
    #[arg(long)]
    allow_outside: bool,
    /// Folder for polygonizers.csv and polygonizers.json [default: NAME-polygonizers]
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

impl PolygonizersArgs {
    pub(in crate::cli) fn run(&self, console: &Console) -> Outcome {
        let name = ModelName::asked(&self.input)?;
        let model = describe(&name, self.allow_outside)?;
        let folder = format!("{}-polygonizers", name.stem());
        let folder = target::result_folder(self.output.as_deref(), folder, "polygonizers.csv")?;
        let isovalue = self.isovalue.unwrap_or(model.isovalue);
        let found = compare_polygonizers(&model, isovalue, &clock(), &|text| console.note(text))?;
        found.write(&folder, &self.input)?;
        console.print(format!("{}\n\n{}", text::table(&found.table()), found.legend()));
        console.print(format!("\nwritten to {}: polygonizers.csv, polygonizers.json", folder.display()));
        console.print_json(&found.to_json(&self.input));
        Ok(())
    }
}
