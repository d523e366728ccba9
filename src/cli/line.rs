//! The command line as a whole: options of every command, the commands, and what a scene says in the place of options.

use crate::cli::args::scene;
use crate::cli::commands::bake::Bake;
use crate::cli::commands::cache::CacheCommand;
use crate::cli::commands::cluster::Cluster;
use crate::cli::commands::compare::Compare;
use crate::cli::commands::completions::Completions;
use crate::cli::commands::demo::Demo;
use crate::cli::commands::doctor::Doctor;
use crate::cli::commands::env::Env;
use crate::cli::commands::export::Export;
use crate::cli::commands::info::Info;
use crate::cli::commands::man::Man;
use crate::cli::commands::merge::Merge;
use crate::cli::commands::pack::Pack;
use crate::cli::commands::plan::Plan;
use crate::cli::commands::relight::Relight;
use crate::cli::commands::study::Study;
use crate::cli::commands::verify::Verify;
use crate::cli::commands::view::View;
use crate::cli::failure::{Failure, Outcome};
use crate::cli::present::console::Console;
use crate::error::Result;
use crate::scene::{DARK, SceneFile};
use crate::transfer::store::{Store, is_store};
use clap::parser::ValueSource;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use std::ffi::OsString;

/// Precomputed light transfer on every isosurface of a volume: bake once, relight by any environment.
#[derive(Parser)]
#[command(name = "isolume", version, max_term_width = 80, after_help = "Start with:\n  isolume demo")]
pub(super) struct Cli {
    #[command(flatten)]
    pub(super) common: Common,
    #[command(subcommand)]
    pub(super) command: Command,
}

/// Options of every command.
#[derive(clap::Args, Clone)]
pub(super) struct Common {
    /// Print the result as JSON
    #[arg(long, global = true, help_heading = "Every command")]
    pub(super) json: bool,
    /// Print nothing but errors and what was asked for: no progress, no notes, no summary
    #[arg(short, long, global = true, help_heading = "Every command")]
    pub(super) quiet: bool,
    /// Print details: sizes, times, rays, noise
    #[arg(short, long, global = true, help_heading = "Every command", conflicts_with = "quiet")]
    pub(super) verbose: bool,
    /// Threads to use [default: one per core]
    #[arg(long, global = true, help_heading = "Every command", value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub(super) threads: Option<u32>,
    /// Seed of all random numbers
    #[arg(long, global = true, help_heading = "Every command", value_name = "N", default_value_t = 0)]
    pub(super) seed: u64,
}

#[derive(Subcommand)]
pub(super) enum Command {
    Demo(Demo),
    Info(Info),
    Doctor(Doctor),
    Plan(Box<Plan>),
    Bake(Box<Bake>),
    Merge(Merge),
    Verify(Verify),
    Pack(Pack),
    Cluster(Cluster),
    Compare(Box<Compare>),
    Study(Box<Study>),
    Relight(Box<Relight>),
    View(Box<View>),
    Export(Box<Export>),
    Env(Env),
    Cache(CacheCommand),
    Completions(Completions),
    Man(Man),
}

impl Command {
    pub(super) fn run(&self, seed: u64, console: &Console) -> Outcome {
        match self {
            Self::Demo(command) => command.run(seed, console),
            Self::Info(command) => command.run(console),
            Self::Doctor(command) => command.run(console),
            Self::Plan(command) => command.run(seed, console),
            Self::Bake(command) => command.run(seed, console),
            Self::Merge(command) => command.run(console),
            Self::Verify(command) => command.run(console),
            Self::Pack(command) => command.run(console),
            Self::Cluster(command) => command.run(seed, &bake_of, console),
            Self::Compare(command) => command.run(seed, console),
            Self::Study(command) => command.run(seed, console),
            Self::Relight(command) => command.run(seed, console),
            Self::View(command) => command.run(seed, console),
            Self::Export(command) => command.run(console),
            Self::Env(command) => command.run(console),
            Self::Cache(command) => command.run(console),
            Self::Completions(command) => command.run(&mut Cli::command(), console),
            Self::Man(command) => command.run(Cli::command(), console),
        }
    }
}

/// Commands that take a scene.
const COMMANDS: [&str; 4] = ["bake", "plan", "relight", "view"];

/// Parses a command line. Options that it does not give come from the scene, if it names one.
pub(super) fn parse(line: Vec<OsString>) -> Result<std::result::Result<Cli, clap::Error>> {
    let is_scene = |word: &OsString| word.to_string_lossy().to_ascii_lowercase().ends_with(".toml");
    if !line.iter().any(is_scene) {
        let line = with_light_of_store(line);
        return Ok(Cli::command().try_get_matches_from(line).and_then(|m| Cli::from_arg_matches(&m)));
    }
    // A first look, in which options that the scene will give may be missing.
    let lenient = Cli::command().ignore_errors(true).try_get_matches_from(&line);
    let found = lenient.ok().and_then(|matches| {
        let (command, given) = matches.subcommand().filter(|(name, _)| COMMANDS.contains(name))?;
        let input = given.try_get_one::<String>("input").ok()??.clone();
        is_scene(&OsString::from(&input)).then(|| (command.to_string(), given.clone(), input))
    });
    let Some((command, given, input)) = found else {
        let line = with_light_of_store(line);
        return Ok(Cli::command().try_get_matches_from(line).and_then(|m| Cli::from_arg_matches(&m)));
    };
    let file = SceneFile::read(&input)?;
    let is_given =
        |id: &str| given.try_contains_id(id).is_ok() && given.value_source(id) == Some(ValueSource::CommandLine);
    // A pilot chooses what the scene says of quality; a goal is not cut off at the rays that the scene says without it.
    let has_goal = is_given("error") || is_given("time");
    let is_chosen =
        |id: &str| is_given("auto") && ["rays", "error", "texture"].contains(&id) || has_goal && id == "rays";
    let absent = |id: &str| given.try_contains_id(id).is_ok() && !is_given(id) && !is_chosen(id);
    let options =
        scene::options(&file, &command).into_iter().filter(|(id, _)| absent(id)).map(|(_, text)| OsString::from(text));
    let whole = line.iter().cloned().chain(options);
    let parsed = Cli::command().try_get_matches_from(whole).and_then(|m| Cli::from_arg_matches(&m));
    Ok(parsed.map(|mut cli| {
        match &mut cli.command {
            Command::Bake(bake) => bake.scene = Some(file),
            Command::Plan(plan) => plan.scene = Some(file),
            Command::Relight(relight) => relight.scene = Some(file),
            Command::View(view) => (view.scene, view.again) = (Some(file), Some((line, view_of as _))),
            _ => {}
        }
        cli
    }))
}

/// The line, with a dark environment where a store with luminaires is relit or compared and none is given.
fn with_light_of_store(mut line: Vec<OsString>) -> Vec<OsString> {
    const LIT: [&str; 2] = ["relight", "compare"];
    if !line.iter().any(|word| LIT.iter().any(|lit| word == lit)) {
        return line;
    }
    let given = Cli::command().ignore_errors(true).try_get_matches_from(&line).ok().and_then(|matches| {
        let (name, given) = matches.subcommand()?;
        let absent = given.try_contains_id("env").is_ok() && given.value_source("env").is_none();
        (LIT.contains(&name) && absent).then(|| given.try_get_one::<String>("input").ok().flatten().cloned()).flatten()
    });
    let shines = given.filter(|input| is_store(input)).and_then(|input| Store::open(input).ok());
    if shines.is_some_and(|store| store.identity().scene.as_ref().is_some_and(|scene| !scene.luminaires.is_empty())) {
        line.push(format!("--env={DARK}").into());
    }
    line
}

/// The page that a line asks for.
fn view_of(line: Vec<OsString>) -> Outcome<Box<View>> {
    match parse(line)? {
        Ok(Cli { command: Command::View(view), .. }) => Ok(view),
        Ok(_) => Err(Failure::Message("no page".into())),
        Err(error) => Err(Failure::Message(error.to_string())),
    }
}

/// The bake that a line asks for; `None` where it asks for something else.
fn bake_of(line: Vec<OsString>) -> Result<std::result::Result<Option<Box<Bake>>, clap::Error>> {
    Ok(parse(line)?.map(|cli| match cli.command {
        Command::Bake(bake) => Some(bake),
        _ => None,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_well_formed() {
        Cli::command().debug_assert();
    }

    #[test]
    fn what_tasks_of_a_cluster_cannot_share_is_refused_by_name() {
        let refused = |option: &str| {
            let line = ["isolume", "cluster", "slurm", "gyroid:32", "--tasks", "2", "-o", "g.isolume", "--", option];
            match Cli::parse_from(line).command.run(0, &Console::new(false, true)) {
                Err(failure) => failure.to_string(),
                Ok(()) => String::new(),
            }
        };
        for (option, word) in [("--force", "replace"), ("--time=2m", "--error"), ("--chunks", "own")] {
            assert!(refused(option).contains(word), "{option}");
        }
        assert!(refused("--isovales=2").contains("bake --help"));
    }
}
