//! A scene file where a command takes a volume: what it says becomes options, for those that were not given.

use super::input::{Input, VolumeArgs};
use super::{Cli, Command, Failure, Outcome, input, joint};
use crate::error::{Error, Result};
use crate::file::{self, Beside};
use crate::scene::geometry::{Geometry, TriangleMesh};
use crate::scene::{Coupling, Effects, Located, Scene, TextureSize, WallShape, nearest};
use crate::transfer::store::Store;
use crate::volume::{LengthUnit, Solid, field};
use clap::parser::ValueSource;
use clap::{CommandFactory, FromArgMatches};
use glam::DVec3;
use std::ffi::OsString;
use std::io::Read;
use std::path::{Path, PathBuf};

/// A scene and the folder that its paths start from.
#[derive(Clone, Debug)]
pub(super) struct SceneFile {
    pub(super) scene: Scene,
    folder: PathBuf,
    /// Which of several volumes is meant.
    member: usize,
}

/// Longest scene: ten times one with a million isovalues.
const MOST_SCENE_BYTES: u64 = 1 << 26;
/// Longest file of a mesh.
const MOST_MESH_BYTES: u64 = 1 << 32;

/// An environment that sends no light.
pub(super) const DARK: &str = "constant:0";

/// Commands that take a scene.
const COMMANDS: [&str; 3] = ["bake", "plan", "relight"];

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
        return Ok(Cli::command().try_get_matches_from(line).and_then(|m| Cli::from_arg_matches(&m)));
    };
    let file = SceneFile::read(&input)?;
    let absent =
        |id: &str| given.try_contains_id(id).is_ok() && given.value_source(id) != Some(ValueSource::CommandLine);
    let options = file.options(&command).into_iter().filter(|(id, _)| absent(id)).map(|(_, text)| OsString::from(text));
    let line: Vec<OsString> = line.into_iter().chain(options).collect();
    let parsed = Cli::command().try_get_matches_from(line).and_then(|m| Cli::from_arg_matches(&m));
    Ok(parsed.map(|mut cli| {
        match &mut cli.command {
            Command::Bake(bake) => bake.scene = Some(file),
            Command::Plan(plan) => plan.scene = Some(file),
            Command::Relight(relight) => relight.scene = Some(file),
            _ => {}
        }
        cli
    }))
}

/// The line, with a dark environment where a store with luminaires is relit and none is given.
fn with_light_of_store(mut line: Vec<OsString>) -> Vec<OsString> {
    if !line.iter().any(|word| word == "relight") {
        return line;
    }
    let given = Cli::command().ignore_errors(true).try_get_matches_from(&line).ok().and_then(|matches| {
        let (name, given) = matches.subcommand()?;
        let absent = given.try_contains_id("env").is_ok() && given.value_source("env").is_none();
        (name == "relight" && absent).then(|| given.try_get_one::<String>("input").ok().flatten().cloned()).flatten()
    });
    let shines = given.filter(|input| super::info::is_store(input)).and_then(|input| Store::open(input).ok());
    if shines.is_some_and(|store| store.identity().scene.as_ref().is_some_and(|scene| !scene.luminaires.is_empty())) {
        line.push(format!("--env={DARK}").into());
    }
    line
}

/// Opens the volume of an argument, or of the scene that it names, with what stands around it and is not switched off.
pub(super) fn open(argument: &str, args: &VolumeArgs, scene: Option<&SceneFile>, effects: &Effects) -> Outcome<Input> {
    let Some(file) = scene else { return input::open(argument, args) };
    let args = &args.of_scene();
    if !file.scene.volumes.is_empty() {
        return joint::open(file, file.member, args, &|input| file.geometry(input, effects, args.allow_outside));
    }
    let mut input = input::open(&file.volume(), args).map_err(|failure| match failure {
        Failure::Library(error) => file.scene.at_line(file.scene.volume.line, error).into(),
        other => other,
    })?;
    input.geometry = file.geometry(&input, effects, args.allow_outside)?;
    Ok(input)
}

impl SceneFile {
    pub(super) fn read(path: &str) -> Result<Self> {
        let text = read_text(path).map_err(|error| {
            let Error::Io { source: e, .. } = error else { return error };
            let folder = Path::new(path).parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
            let beside = std::fs::read_dir(folder).map(|d| d.flatten().collect::<Vec<_>>()).unwrap_or_default();
            let beside: Vec<String> = beside.iter().map(|e| e.file_name().to_string_lossy().into_owned()).collect();
            let scenes = beside.iter().map(String::as_str).filter(|n| n.ends_with(".toml"));
            match nearest(&input::file_name(path), scenes).filter(|_| e.kind() == std::io::ErrorKind::NotFound) {
                Some(near) => {
                    let remedy = format!("did you mean {}?", Path::new(path).with_file_name(near).display());
                    Error::argument("scene", path, "a scene file that exists", remedy)
                }
                None => Error::io(path, "read the scene", e),
            }
        })?;
        let folder = Path::new(path).parent().map(Path::to_path_buf).unwrap_or_default();
        let file = Self { scene: Scene::parse(&text, path)?, folder, member: 0 };
        if let Some(probe) = file.scene.probe.as_ref().filter(|p| p.is_file) {
            let place = file.folder.join(&probe.name.value);
            if !place.exists() {
                let remedy = "correct the path; it starts from the folder of the scene";
                let error = Error::argument("probe.file", place.display(), "an environment image that exists", remedy);
                return Err(file.scene.at_line(probe.name.line, error));
            }
        }
        Ok(file)
    }

    /// A scene that the program makes itself, with paths as the user gave them; `name` is for messages.
    pub(super) fn from_text(text: &str, name: &str) -> Result<Self> {
        Ok(Self { scene: Scene::parse(text, name)?, folder: PathBuf::new(), member: 0 })
    }

    /// Walls and luminaires; `None` where there are none, or all are switched off.
    fn geometry(&self, input: &Input, effects: &Effects, allow_outside: bool) -> Outcome<Option<Geometry>> {
        let mut surroundings = self.scene.surroundings.clone();
        if effects.switched("walls") == Some(false) {
            surroundings.walls.clear();
        }
        if effects.switched("luminaires") == Some(false) {
            surroundings.luminaires.clear();
            surroundings.walls.iter_mut().for_each(|wall| wall.emission = None);
        }
        if surroundings.is_empty() {
            return Ok(None);
        }
        let metres = match input.volume.unit {
            LengthUnit::Metres(metres) => metres,
            LengthUnit::Unknown => 1.0,
        };
        let mut read = |name: &str, named: Option<(&str, u64)>| {
            let mesh = self.folder.join(name);
            match named {
                None => read_mesh_file(&mesh),
                Some((other, bytes)) => {
                    let (file, length, path) = Beside::new(&mesh, allow_outside).open(other)?;
                    let (mut part, bytes) = (Vec::new(), bytes.min(length).min(MOST_MESH_BYTES));
                    file.take(bytes).read_to_end(&mut part).map_err(|e| Error::io(&path, "read", e))?;
                    Ok(part)
                }
            }
        };
        let mut surface = |name: &str, isovalue: f64| {
            let opened =
                input::open(&self.place_of(name), &VolumeArgs::default()).map_err(|failure| match failure {
                    Failure::Library(error) => error,
                    Failure::Message(found) => Error::argument("volume", found, "a volume", "correct the path"),
                })?;
            let mesh = crate::surface::extract(&opened.volume, isovalue)?;
            let place = |p: &[f32; 3]| opened.volume.world_from_grid().point(DVec3::from_array(p.map(f64::from)));
            Ok(TriangleMesh {
                positions: mesh.positions_in_grid.iter().map(place).collect(),
                triangles: mesh.triangles,
            })
        };
        Ok(Some(surroundings.assemble(&self.scene, metres, &mut read, &mut surface)?))
    }

    /// The volume as `isolume` takes it.
    fn volume(&self) -> String {
        self.place_of(&self.scene.volume.value)
    }

    /// A path from the folder of the scene, or the name of a field, as `isolume` takes it.
    pub(super) fn place_of(&self, name: &str) -> String {
        let is_field = !matches!(field::by_name(name), Ok(None));
        if is_field { name.to_string() } else { self.folder.join(name).display().to_string() }
    }

    /// All files that it names.
    pub(super) fn files(&self) -> Vec<PathBuf> {
        let scene = &self.scene;
        let volumes = scene.volumes.iter().map(|volume| &volume.volume.value);
        let walls = scene.surroundings.walls.iter().filter_map(|wall| match &wall.shape {
            WallShape::Mesh { file, .. } => Some(&file.value),
            WallShape::Isosurface { volume, .. } => Some(&volume.value),
            WallShape::Ready(_) => None,
        });
        let probe = scene.probe.iter().filter(|probe| probe.is_file).map(|probe| &probe.name.value);
        let named = volumes.chain(walls).chain(probe).chain([&scene.volume.value]);
        named.map(|name| self.folder.join(name)).collect()
    }

    /// How many volumes it has.
    pub(super) fn members(&self) -> usize {
        self.scene.volumes.len().max(1)
    }

    /// The same scene from one of its volumes.
    pub(super) fn of_member(&self, member: usize) -> Self {
        Self { member, ..self.clone() }
    }

    /// Isovalues as options have them: where there are none, those of the first volume in the pairs of the coupling.
    fn isovalues(&self) -> Option<String> {
        let given: Vec<String> = self.scene.isovalues.iter().map(|i| i.value.clone()).collect();
        let list = match &self.scene.coupling {
            Some(Located { value: Coupling::Rows(rows), .. }) if given.is_empty() => {
                rows.iter().map(|row| row[0].to_string()).collect()
            }
            _ => given,
        };
        Some(list.join(",")).filter(|list| !list.is_empty())
    }

    /// The environment as `isolume` takes it.
    pub(super) fn environment(&self) -> Option<String> {
        let Some(probe) = self.scene.probe.as_ref() else {
            // Luminaires are light enough.
            let shines = !self.scene.surroundings.luminaires.is_empty()
                || self.scene.surroundings.walls.iter().any(|wall| wall.emission.is_some());
            return shines.then(|| DARK.to_string());
        };
        let name = &probe.name.value;
        Some(if probe.is_file { self.folder.join(name).display().to_string() } else { name.clone() })
    }

    /// What the scene says as options of a command.
    fn options(&self, command: &str) -> Vec<Written> {
        let scene = &self.scene;
        let mut all: Vec<Written> = Vec::new();
        let mut add = |id: &'static str, option: &str, value: Option<String>| {
            all.extend(value.map(|value| (id, format!("{option}={value}"))));
        };
        add("solid", "--solid", scene.solid.map(|s| if s == Solid::Above { "above" } else { "below" }.into()));
        add("up", "--up", scene.up.map(|up| up.name().into()));
        let isovalues = self.isovalues();
        let bake = &scene.bake;
        add("rays", "--rays", bake.rays.map(|n| n.to_string()));
        add("layers", "--layers", bake.layers.map(|n| n.to_string()));
        add("error", "--error", bake.error.map(|e| e.to_string()));
        add("texture", "--texture", bake.texture.map(texture));
        if bake.positive == Some(true) {
            all.push(("positive", "--positive".into()));
        }
        if command == "relight" {
            self.options_of_relight(isovalues, &mut all);
        } else {
            let bands: Vec<String> = bake.bands.iter().map(u64::to_string).collect();
            all.extend((!bands.is_empty()).then(|| ("bands", format!("--bands={}", bands.join(",")))));
            all.extend(isovalues.map(|list| ("isovalues", format!("--isovalues={list}"))));
        }
        all
    }

    fn options_of_relight(&self, isovalues: Option<String>, all: &mut Vec<Written>) {
        let scene = &self.scene;
        let mut add = |id: &'static str, option: &str, value: Option<String>| {
            all.extend(value.map(|value| (id, format!("{option}={value}"))));
        };
        add("isovalue", "--isovalue", isovalues);
        add("env", "--env", self.environment());
        let probe = scene.probe.as_ref();
        add("env_rotate", "--env-rotate", probe.and_then(|p| p.rotation).map(|v| v.to_string()));
        add("window", "--window", probe.and_then(|p| p.window).map(String::from));
        let camera = &scene.camera;
        add("view", "--view", camera.view.clone());
        add("size", "--size", camera.size.map(|[w, h]| format!("{w}x{h}")));
        add("perspective", "--perspective", camera.field_of_view.filter(|v| *v > 0.0).map(|v| v.to_string()));
        add("background", "--background", camera.background.clone());
        add("exposure", "--exposure", camera.exposure.clone());
        for output in &scene.outputs {
            add("output", "--output", Some(output.value.clone()));
        }
        if probe.is_some_and(|p| p.sun_split == Some(true)) {
            all.push(("sun_split", "--sun-split".into()));
        }
    }

    /// Bands of the layers, as options have them.
    pub(super) fn bands(&self) -> Option<Vec<u8>> {
        let bands = &self.scene.bake.bands;
        (!bands.is_empty()).then(|| bands.iter().map(|&b| b as u8).collect())
    }
}

/// The text of a scene.
fn read_text(path: &str) -> Result<String> {
    let bytes = file::read(path, MOST_SCENE_BYTES)?;
    String::from_utf8(bytes).map_err(|_| {
        Error::format("scene", "bytes that are no text", "TOML in UTF-8", "save it as UTF-8").in_file(path)
    })
}

/// A mesh that the scene names.
fn read_mesh_file(path: &Path) -> Result<Vec<u8>> {
    file::read(path, MOST_MESH_BYTES).map_err(|error| match error {
        Error::Io { source, .. } if source.kind() == std::io::ErrorKind::NotFound => {
            let remedy = "correct the path; it starts from the folder of the scene";
            Error::argument("file", path.display(), "a mesh that exists (.obj, .ply, .gltf, .glb)", remedy)
        }
        other => other,
    })
}

fn texture(size: TextureSize) -> String {
    match size {
        TextureSize::Ratio(ratio) => ratio.to_string(),
        TextureSize::Texels([x, y, z]) => format!("{x}x{y}x{z}"),
    }
}
