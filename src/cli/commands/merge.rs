//! `isolume merge`: puts together what was baked apart.

use crate::cli::failure::Outcome;
use crate::cli::present::console::Console;
use crate::cli::present::text;
use crate::error::Error;
use crate::file::{file_name, size_on_disk};
use crate::transfer::store::{Store, StoreOptions};
use serde_json::json;
use std::path::PathBuf;

/// Put together stores that were baked apart, such as the shares of several machines
///
/// Only stores of the same volume, texture, layers, estimator and seed fit together. Where several hold a texel, the
/// one of the most rays stays. The result does not depend on the order of the stores. One store alone is copied; one of
/// an older format becomes one of the format of today.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume merge one.isolume two.isolume -o brain.isolume
  isolume merge old.isolume -o new.isolume   (stamps an older format anew)")]
pub(in crate::cli) struct Merge {
    /// Stores to read
    #[arg(value_name = "X.isolume", required = true)]
    inputs: Vec<PathBuf>,
    /// Store to write into; made if it is not there
    #[arg(short, long, value_name = "X.isolume")]
    output: PathBuf,
    /// Do not wait until the disk has what is written
    #[arg(long)]
    no_sync: bool,
}

impl Merge {
    pub(in crate::cli) fn run(&self, console: &Console) -> Outcome {
        let open = |path| Store::open_telling(path, true, |note| console.note(note));
        let sources = self.inputs.iter().map(open).collect::<Result<Vec<_>, Error>>()?;
        let options = StoreOptions::default().sync(!self.no_sync);
        let (_, reports) = options.merge(&sources, &self.output)?;
        let mut rows = vec![["store", "chunks taken", "chunks that brought nothing"].map(String::from).to_vec()];
        let mut json_rows = Vec::new();
        for (store, report) in sources.iter().zip(reports) {
            let name = store.path().display().to_string();
            rows.push(vec![name.clone(), report.taken.to_string(), report.kept.to_string()]);
            json_rows.push(json!({ "store": file_name(&name), "taken": report.taken, "kept": report.kept }));
        }
        let bytes = size_on_disk(&self.output);
        console.summary(text::file_line(&self.output, &text::bytes(bytes as f64)));
        console.detail(text::table(&rows));
        console.print_json(&json!({ "stores": json_rows, "store_bytes": bytes }));
        Ok(())
    }
}
