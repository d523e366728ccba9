//! `isolume demo`.
use super::console::Console;
use super::Outcome;
use std::path::PathBuf;

/// Bake and relight a small brain, without any file
#[derive(clap::Args)]
#[command(after_help = "Example:\n  isolume demo --out isolume-demo")]
pub(super) struct Demo {
    /// Directory to write into
    #[arg(long, value_name = "DIR", default_value = "isolume-demo")]
    out: PathBuf,
}

impl Demo {
    pub(super) fn run(&self, seed: u64, console: &Console) -> Outcome {
        let _ = (seed, console, &self.out);
        Ok(())
    }
}
