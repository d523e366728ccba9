//! What a scene file says as options, where a command takes a volume.

use crate::scene::SceneFile;
use crate::volume::Solid;

/// An option as the line of a command has it, and the name by which clap knows it.
pub(in crate::cli) type Written = (&'static str, String);

/// What the scene says as options of a command.
pub(in crate::cli) fn options(file: &SceneFile, command: &str) -> Vec<Written> {
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
    add("texture", "--texture", bake.texture.map(|size| size.to_string()));
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
