//! The command line: options (`args`), commands (`commands`) and what is printed (`present`). It uses the library through
//! its public interface, and alone reads the clock, starts threads and finds the folder of the cache.
//!
//! Results go to standard output, progress and notes to standard error. Exit code 0: done; 2: the command
//! line was wrong; 1: anything else, with one line `error: …`; 128 + n: stopped by signal n, in a state that the same
//! command goes on from. Under `--json` a failure is a document on standard output too: `{"error": {"kind": …}}`.

mod args;
mod commands;
mod failure;
mod line;
mod present;
#[cfg(feature = "python")]
pub(crate) mod shared;

use crate::error::Error;
use crate::signals;
pub(crate) use failure::{Failure, Outcome};
use line::Cli;
use present::console::Console;
use serde_json::json;
use std::ffi::OsString;
use std::process::ExitCode;

/// Runs the program with the arguments of the process.
pub fn main() -> ExitCode {
    signals::explain_bus_errors();
    ExitCode::from(exit_code(std::env::args_os().collect()))
}

/// Runs the program with a command line, of which the first word is its name; returns the exit code.
pub(crate) fn exit_code(line: Vec<OsString>) -> u8 {
    // Known before the line is parsed, so that a wrong one is told to machines as well.
    let json = line.iter().any(|word| word == "--json");
    let failed = |failure: Failure, code: u8| {
        let console = Console::new(json, false);
        console.error(&failure);
        code
    };
    if let Some(word) = line.get(1..).unwrap_or_default().iter().find(|word| word.to_str().is_none()) {
        // Names go into reports, stores and pages, which are text.
        let expected = "text in UTF-8";
        return failed(
            Error::argument("argument", format!("{word:?}"), expected, "rename the file or folder").into(),
            2,
        );
    }
    let cli = match line::parse(line) {
        Ok(Ok(cli)) => cli,
        Err(error) => return failed(error.into(), 1),
        Ok(Err(error)) => return answer_of_parser(&error, json),
    };
    let console = Console::new(cli.common.json, cli.common.quiet).with_details(cli.common.verbose);
    match run(&cli, &console).and_then(|()| console.finish()) {
        Ok(()) => 0,
        Err(failure) => {
            console.error(&failure);
            signals::exit_code().unwrap_or(1)
        }
    }
}

/// Prints what clap has to say: why a line is wrong, or help and version, which are "errors" with exit code 0.
fn answer_of_parser(error: &clap::Error, json: bool) -> u8 {
    let console = Console::new(json, false);
    let printed = error.print();
    if error.use_stderr() {
        console.print_json(&json!({ "error": failure::usage_json(error) }));
        return error.exit_code().clamp(0, 255) as u8;
    }
    console.keep(printed);
    match console.finish() {
        Ok(()) => 0,
        Err(failure) => {
            console.error(&failure);
            1
        }
    }
}

fn run(cli: &Cli, console: &Console) -> Outcome {
    let mut pool = rayon::ThreadPoolBuilder::new();
    if let Some(threads) = cli.common.threads {
        pool = pool.num_threads(threads as usize);
    }
    // Started here, where threads that the system refuses are an error and no panic.
    pool.build_global().map_err(|e| {
        let threads = cli.common.threads.map_or("one thread per core".into(), |n| format!("{n} threads"));
        Failure::Message(format!("cannot start {threads}: {e}; give fewer --threads, or see ulimit -v and -u"))
    })?;
    cli.command.run(cli.common.seed, console)
}
