//! `isolume bake`: fills a transfer store.

use super::baking::{Job, fill, size_on_disk};
use super::console::Console;
use super::input::{VolumeArgs, file_name};
use super::options::BakeArgs;
use super::{Failure, Outcome, input, output, replay};
use crate::transfer::store::Store;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Compute the light transfer of a volume, once for every environment
///
/// The result is a store: a directory that any program which reads Zarr opens, with the volume in it. A bake
/// that was stopped goes on with the same command; a bake with other --isovalues or more --rays extends the
/// store.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume bake brain.nii.gz --rays 64 --layers 4 -o brain.isolume
  isolume bake bumpbox:128 --isovalues 30,60 --rays 256 -o bumps.isolume
  isolume bake brain.nii.gz --replay-texel 90,120,80")]
pub(super) struct Bake {
    /// Volume file, or a field such as bumpbox or gyroid:128
    #[arg(value_name = "VOLUME")]
    input: String,
    /// The store to make or to go on with, such as brain.isolume
    #[arg(short, long, value_name = "X.isolume", required_unless_present = "replay_texel")]
    output: Option<PathBuf>,
    #[command(flatten)]
    bake: BakeArgs,
    #[command(flatten)]
    volume: VolumeArgs,
    /// Replace a store that is there
    #[arg(long)]
    force: bool,
    /// Trace one texel alone, print its paths, and bake nothing
    #[arg(long, value_name = "X,Y,Z", value_parser = replay::parse_texel)]
    replay_texel: Option<[usize; 3]>,
}

impl Bake {
    pub(super) fn run(&self, seed: u64, console: &Console) -> Outcome {
        if let (Some(path), None) = (&self.output, self.replay_texel) {
            check_output(path)?;
        }
        let opened = input::open(&self.input, &self.volume)?;
        let volume = &opened.volume;
        for note in &volume.notes {
            console.note(&note.text);
        }
        let layout = self.bake.transfer.layout(volume, &self.bake.bands)?;
        let settings = self.bake.transfer.settings(&layout, seed);
        if let Some(texel) = self.replay_texel {
            return replay::run(volume, &layout, &settings, texel, console);
        }
        let chosen = self.bake.isovalues(volume, opened.default_isovalue)?;
        for isovalue in chosen.iter().flatten() {
            if let Some(reason) = &isovalue.reason {
                console.note(format!("isovalue {}: {reason}", isovalue.value));
            }
        }
        let isovalues = chosen.map(|list| list.iter().map(|c| c.value).collect());
        let memory_limit = self.bake.transfer.memory_limit;
        let job = Job { volume, label: &opened.label, layout, settings, isovalues, memory_limit };
        job.check_memory()?;
        let Some(path) = &self.output else {
            return Err(Failure::Message("the output is missing: give -o X.isolume".into()));
        };
        if self.force && path.symlink_metadata().is_ok() {
            // Only what is a store of ours may be deleted.
            drop(Store::open(path)?);
            std::fs::remove_dir_all(path).map_err(|e| crate::Error::io(path, "remove the old store", e))?;
        }
        let (store, report) = fill(&job, path, console)?;
        let bytes = size_on_disk(path);
        console.print(format!("{}\n{}", path.display(), report.lines(bytes)));
        console.print_json(&json!({
            "store": file_name(&path.display().to_string()),
            "identity": store.identity(),
            "bake": report.json(bytes),
        }));
        Ok(())
    }
}

/// Refuses an output that cannot become a store, before any work.
fn check_output(path: &Path) -> Outcome {
    if path.symlink_metadata().is_err() {
        return Ok(output::check_folder(path)?);
    }
    if path.is_dir() && !path.join("zarr.json").exists() {
        return Err(crate::Error::argument(
            "output",
            path.display(),
            "a path where nothing is yet, or a transfer store",
            "this is a directory of something else; give a name such as brain.isolume in it",
        )
        .into());
    }
    Ok(())
}
