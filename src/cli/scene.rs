//! A scene file where a command takes a volume: what it says becomes options, for those that were not given.

use super::{Cli, Command};
use crate::error::Result;
use crate::scene::{DARK, SceneFile, TextureSize};
use crate::transfer::store::{Store, is_store};
use crate::volume::Solid;
use clap::parser::ValueSource;
use clap::{CommandFactory, FromArgMatches};
use std::ffi::OsString;

/// Commands that take a scene.
const COMMANDS: [&str; 4] = ["bake", "plan", "relight", "view"];

/// An option as the line of a command has it, and the name by which clap knows it.
type Written = (&'static str, String);

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
        options(&file, &command).into_iter().filter(|(id, _)| absent(id)).map(|(_, text)| OsString::from(text));
    let line: Vec<OsString> = line.into_iter().chain(options).collect();
    let parsed = Cli::command().try_get_matches_from(line).and_then(|m| Cli::from_arg_matches(&m));
    Ok(parsed.map(|mut cli| {
        match &mut cli.command {
            Command::Bake(bake) => bake.scene = Some(file),
            Command::Plan(plan) => plan.scene = Some(file),
            Command::Relight(relight) => relight.scene = Some(file),
            Command::View(view) => view.scene = Some(file),
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

/// What the scene says as options of a command.
fn options(file: &SceneFile, command: &str) -> Vec<Written> {
    let scene = &file.description;
    let mut all: Vec<Written> = Vec::new();
    let mut add = |id: &'static str, option: &str, value: Option<String>| {
        all.extend(value.map(|value| (id, format!("{option}={value}"))));
    };
    add("solid", "--solid", scene.solid.map(|s| if s == Solid::Above { "above" } else { "below" }.into()));
    add("up", "--up", scene.up.map(|up| up.name().into()));
    let isovalues = Some(file.listed_isovalues().join(",")).filter(|list| !list.is_empty());
    let bake = &scene.bake;
    add("rays", "--rays", bake.rays.map(|n| n.to_string()));
    add("layers", "--layers", bake.layers.map(|n| n.to_string()));
    add("error", "--error", bake.error.map(|e| e.to_string()));
    add("texture", "--texture", bake.texture.map(texture));
    if bake.positive == Some(true) {
        all.push(("positive", "--positive".into()));
    }
    if command == "relight" {
        options_of_relight(file, isovalues, &mut all);
    } else if command == "view" {
        all.extend(file.environment().map(|name| ("env", format!("--env={name}"))));
    } else {
        let bands: Vec<String> = bake.bands.iter().map(u64::to_string).collect();
        all.extend((!bands.is_empty()).then(|| ("bands", format!("--bands={}", bands.join(",")))));
        all.extend(isovalues.map(|list| ("isovalues", format!("--isovalues={list}"))));
    }
    all
}

fn options_of_relight(file: &SceneFile, isovalues: Option<String>, all: &mut Vec<Written>) {
    let scene = &file.description;
    let mut add = |id: &'static str, option: &str, value: Option<String>| {
        all.extend(value.map(|value| (id, format!("{option}={value}"))));
    };
    add("isovalue", "--isovalue", isovalues);
    add("env", "--env", file.environment());
    let probe = scene.probe.as_ref();
    add("env_rotate", "--env-rotate", probe.and_then(|p| p.rotation).map(|v| v.to_string()));
    add("window", "--window", probe.and_then(|p| p.window).map(String::from));
    add("sun_split", "--sun-split", probe.and_then(|p| p.sun_split).map(|split| split.to_string()));
    let camera = &scene.camera;
    add("view", "--view", camera.view.clone());
    add("size", "--size", camera.size.map(|[w, h]| format!("{w}x{h}")));
    add("perspective", "--perspective", camera.field_of_view.filter(|v| *v > 0.0).map(|v| v.to_string()));
    add("background", "--background", camera.background.clone());
    add("exposure", "--exposure", camera.exposure.clone());
    for output in &scene.outputs {
        add("output", "--output", Some(output.value.clone()));
    }
}

fn texture(size: TextureSize) -> String {
    match size {
        TextureSize::Ratio(ratio) => ratio.to_string(),
        TextureSize::Texels([x, y, z]) => format!("{x}x{y}x{z}"),
    }
}
