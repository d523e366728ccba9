//! `isolume pack`: a store in a fraction of the space, with an error that is stated.

use crate::cli::failure::Outcome;
use crate::cli::present::console::Console;
use crate::cli::present::text;
use crate::error::Result;
use crate::file::{file_name, size_on_disk};
use crate::transfer::store::{PackError, PackReport, PackedGroup, Store, StoreOptions};
use std::path::PathBuf;

/// Pack a store into a fraction of its space, with an error that is stated
///
/// A packed store is a store: relight, compare, view, export and info take it, and any program that reads Zarr. Nothing is baked into it:
/// keep the store that it was made of where the bake may go on. The error is white, so that light of every colour and direction gets the
/// same of it; info shows it, and what it may do to radiance at most. Samples that stay in a file (--store-volume reference) are copied.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume pack brain.isolume -o brain-small.isolume
  isolume pack brain.isolume --error 0.5% -o brain-small.isolume
  isolume bake brain.nii.gz --isovalues 90 --compress auto -o brain.isolume")]
pub(in crate::cli) struct Pack {
    /// The store to read
    #[arg(value_name = "X.isolume")]
    input: PathBuf,
    /// The store to make
    #[arg(short, long, value_name = "Y.isolume")]
    output: PathBuf,
    /// Root mean square of the error of the transfer over the transfer, such as 0.5%; auto is half of its noise
    #[arg(long, value_name = "E", default_value = "auto")]
    error: PackError,
    /// Do not wait until the disk has what is written
    #[arg(long)]
    no_sync: bool,
}

impl Pack {
    pub(in crate::cli) fn run(&self, console: &Console) -> Outcome {
        let source = Store::open_telling(&self.input, true, |note| console.note(note))?;
        let options = StoreOptions::default().sync(!self.no_sync);
        let (_, report) = options.pack(&source, &self.output, self.error)?;
        let sizes = [&self.input, &self.output].map(|path| size_on_disk(path));
        console.summary(text::file_line(&self.output, &summary(&report, sizes)));
        console.detail(table(&report));
        console.print_json(&report.to_json(&file_name(&self.output.display().to_string()), sizes));
        Ok(())
    }
}

/// What it came to, in a line.
pub(in crate::cli) fn summary(report: &PackReport, [before, after]: [u64; 2]) -> String {
    let [was, is] = report.bytes_a_texel();
    let held: Vec<_> = report.groups.iter().filter(|g| g.texels > 0).collect();
    let most = |of: fn(&PackedGroup) -> f64| held.iter().map(|g| of(g)).fold(0.0, f64::max);
    format!(
        "{} of {}, transfer {:.1} of {:.1} bytes a texel; error {} RMS of transfer (noise {})",
        text::bytes(after as f64),
        text::bytes(before as f64),
        is[0],
        was[0],
        text::percent(most(|g| g.packing.measured)),
        text::percent(most(|g| g.noise)),
    )
}

fn table(report: &PackReport) -> String {
    let header = ["group", "texels", "error", "noise", "largest", "bound", "step", "B a texel"];
    let mut rows = vec![header.map(String::from).to_vec()];
    for group in report.groups.iter().filter(|g| g.texels > 0) {
        let p = &group.packing;
        rows.push(vec![
            group.place.clone(),
            text::count(group.texels),
            text::percent(p.measured),
            text::percent(group.noise),
            text::number(p.largest, 4),
            text::number(p.bound, 4),
            text::number(p.step, 4),
            format!("{:.1}", group.bytes[0] as f64 / group.texels as f64),
        ]);
    }
    text::table(&rows)
}

/// How a store is packed, for people; nothing where it is not.
pub(in crate::cli) fn about(store: &Store) -> Result<Vec<(String, String)>> {
    let mut rows = Vec::new();
    let mut add = |what: String, store: &Store| {
        if let Some(p) = store.packing() {
            let error = text::percent(p.measured);
            let (largest, bound) = (text::number(p.largest, 3), text::number(p.bound, 3));
            let text = format!(
                "{what}: {error} RMS of transfer; light of norm 1 at albedo 0.7 changes by {largest} at most, at any lower one by {bound}"
            );
            rows.push(("packed".to_owned(), text));
        }
    };
    let isovalues = store.surfaces()?;
    if isovalues.is_empty() || !store.holdings()?.in_texture.is_empty() || store.holdings()?.all {
        add("texture".into(), store);
    }
    for isovalue in isovalues {
        if let Some(surface) = store.surface(isovalue)? {
            add(format!("isovalue {}", text::number(isovalue, 8)), &surface);
        }
    }
    Ok(rows)
}
