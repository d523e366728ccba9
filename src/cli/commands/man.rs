//! `isolume man`: the manual, made of what `--help` says.

use crate::cli::failure::Outcome;
use crate::cli::present::console::Console;
use crate::error::Error;
use crate::export::atomic;
use crate::file::check_folder;
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Print the manual page, or write one page for each command
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume man | man -l -
  isolume man bake | man -l -
  isolume man -o ~/.local/share/man/man1")]
pub(in crate::cli) struct Man {
    /// The command, such as bake or \"env show\" [default: the program itself]
    #[arg(value_name = "COMMAND", num_args = 0..=2)]
    command: Vec<String>,
    /// Write the pages of all commands into this directory, which is made if it is not there
    #[arg(short, long, value_name = "DIR", conflicts_with = "command")]
    output: Option<PathBuf>,
}

impl Man {
    pub(in crate::cli) fn run(&self, mut program: clap::Command, console: &Console) -> Outcome {
        // Names of subcommands and the options of every command are filled in.
        program.build();
        if let Some(folder) = &self.output {
            return write_all(&program, folder, console);
        }
        let mut command = &program;
        for word in self.command.iter().flat_map(|words| words.split_whitespace()) {
            command = command.find_subcommand(word).ok_or_else(|| {
                let known: Vec<&str> = subcommands(command).map(clap::Command::get_name).collect();
                let expected = if known.is_empty() { "no more words".into() } else { known.join(", ") };
                Error::argument("command", word, expected, "see isolume --help")
            })?;
        }
        console.print_raw(&page(command)?);
        Ok(())
    }
}

/// Commands below one, without `help`.
fn subcommands(command: &clap::Command) -> impl Iterator<Item = &clap::Command> {
    command.get_subcommands().filter(|below| below.get_name() != "help")
}

fn page(command: &clap::Command) -> Result<Vec<u8>, Error> {
    let mut text = Vec::new();
    let page = clap_mangen::Man::new(command.clone()).source(concat!("isolume ", env!("CARGO_PKG_VERSION")));
    page.render(&mut text).map_err(|e| Error::io("", "make the manual page", e))?;
    Ok(text)
}

fn write_all(program: &clap::Command, folder: &Path, console: &Console) -> Outcome {
    std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, "make the directory", e))?;
    check_folder(&folder.join("isolume.1"))?;
    let mut written = Vec::new();
    let mut waiting = vec![program];
    while let Some(command) = waiting.pop() {
        let name = command.get_display_name().unwrap_or(command.get_name());
        let path = folder.join(format!("{name}.1"));
        let text = page(command)?;
        atomic::write(&path, |w| w.write_all(&text).map_err(|e| Error::io(&path, "write", e)))?;
        written.push(path.display().to_string());
        waiting.extend(subcommands(command));
    }
    written.sort();
    console.print(written.join("\n"));
    console.print_json(&json!({ "files": written }));
    Ok(())
}
