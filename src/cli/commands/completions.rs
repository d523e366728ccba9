//! `isolume completions`: what the shell completes.

use crate::cli::failure::Outcome;
use crate::cli::present::console::Console;
use clap_complete::Shell;

/// Print completions for a shell
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume completions bash > ~/.local/share/bash-completion/completions/isolume
  isolume completions zsh > ~/.zfunc/_isolume          (with ~/.zfunc in $fpath)
  isolume completions fish > ~/.config/fish/completions/isolume.fish
  isolume completions powershell >> $PROFILE")]
pub(in crate::cli) struct Completions {
    /// The shell
    #[arg(value_enum, value_name = "SHELL")]
    shell: Shell,
}

impl Completions {
    pub(in crate::cli) fn run(&self, program: &mut clap::Command, console: &Console) -> Outcome {
        let mut text = Vec::new();
        clap_complete::generate(self.shell, program, "isolume", &mut text);
        console.print_raw(&text);
        Ok(())
    }
}
