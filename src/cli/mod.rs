//! The command line: flags, progress, printing, threads, the clock, and the only code that decides which
//! paths are opened. It uses the library through its public interface.
//!
//! Results go to standard output, progress and notes to standard error. Exit code 0: done; 2: the command
//! line was wrong; 1: anything else, with one line `error: …`.

/// Runs `$body` with `$s` bound to the typed slice of a volume's samples.
macro_rules! with_samples {
    ($samples:expr, $s:ident => $body:expr) => {
        match $samples {
            $crate::volume::Samples::U8($s) => $body,
            $crate::volume::Samples::I8($s) => $body,
            $crate::volume::Samples::U16($s) => $body,
            $crate::volume::Samples::I16($s) => $body,
            $crate::volume::Samples::F32($s) => $body,
        }
    };
}

mod baking;
mod bake;
mod compare;
mod console;
mod demo;
mod doctor;
mod env;
mod export;
mod forecast;
mod info;
mod input;
mod isovalue;
mod joint;
mod light;
mod merge;
mod options;
mod output;
mod picture;
mod plan;
mod relight;
mod relightable;
mod replay;
mod scene;
mod scene_light;
mod scene_walls;
mod still;
mod study;
mod surface;
mod text;
mod view;

#[cfg(test)]
mod tests;

use crate::error::Error;
use clap::{Parser, Subcommand};
use console::Console;
use std::process::ExitCode;

/// Precomputed light transfer on every isosurface of a volume: bake once, relight by any environment.
#[derive(Parser)]
#[command(name = "isolume", version, after_help = "Start with:\n  isolume demo")]
struct Cli {
    #[command(flatten)]
    common: Common,
    #[command(subcommand)]
    command: Command,
}

/// Options of every command.
#[derive(clap::Args, Clone)]
struct Common {
    /// Print the result as JSON
    #[arg(long, global = true, help_heading = "Every command")]
    json: bool,
    /// No progress and no notes
    #[arg(short, long, global = true, help_heading = "Every command")]
    quiet: bool,
    /// Threads to use [default: one per core]
    #[arg(long, global = true, help_heading = "Every command", value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    threads: Option<u32>,
    /// Seed of all random numbers
    #[arg(long, global = true, help_heading = "Every command", value_name = "N", default_value_t = 0)]
    seed: u64,
}

#[derive(Subcommand)]
enum Command {
    Demo(demo::Demo),
    Info(info::Info),
    Doctor(doctor::Doctor),
    Plan(Box<plan::Plan>),
    Bake(Box<bake::Bake>),
    Merge(merge::Merge),
    Compare(compare::Compare),
    Study(Box<study::Study>),
    Relight(Box<relight::Relight>),
    View(view::View),
    Export(Box<export::Export>),
    Env(env::Env),
}

/// Why a command did not do what was asked.
enum Failure {
    /// The library's reason.
    Library(Error),
    /// One of the command line's own.
    Message(String),
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Library(error)
    }
}

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Library(error) => error.fmt(f),
            Self::Message(text) => f.write_str(text),
        }
    }
}

type Outcome<T = ()> = Result<T, Failure>;

/// Runs the program with the arguments of the process.
pub fn main() -> ExitCode {
    let cli = match scene::parse(std::env::args_os().collect()) {
        Ok(Ok(cli)) => cli,
        Err(error) => {
            Console::new(false, false).error(error);
            return ExitCode::FAILURE;
        }
        Ok(Err(error)) => {
            // Help and version are "errors" with exit code 0; nothing helps against a closed pipe.
            let _ = error.print();
            return ExitCode::from(error.exit_code().clamp(0, 255) as u8);
        }
    };
    let console = Console::new(cli.common.json, cli.common.quiet);
    match run(&cli, &console) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            console.error(&failure);
            ExitCode::FAILURE
        }
    }
}

fn run(cli: &Cli, console: &Console) -> Outcome {
    if let Some(threads) = cli.common.threads {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads as usize)
            .build_global()
            .map_err(|e| Failure::Message(format!("cannot start {threads} threads: {e}; give fewer --threads")))?;
    }
    let seed = cli.common.seed;
    match &cli.command {
        Command::Demo(command) => command.run(seed, console),
        Command::Info(command) => command.run(console),
        Command::Doctor(command) => command.run(console),
        Command::Plan(command) => command.run(seed, console),
        Command::Bake(command) => command.run(seed, console),
        Command::Merge(command) => command.run(console),
        Command::Compare(command) => command.run(seed, console),
        Command::Study(command) => command.run(seed, console),
        Command::Relight(command) => command.run(seed, console),
        Command::View(command) => command.run(console),
        Command::Export(command) => command.run(console),
        Command::Env(command) => command.run(console),
    }
}
