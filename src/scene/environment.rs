//! Environments by name or path, as a command or a scene names them.

use super::{SceneFile, nearest};
use crate::error::{Error, Result};
use crate::probe::{self, EMBEDDED, Layout, Probe, ReadOptions};
use crate::volume::Isovalue;
use std::path::Path;

/// Names of the skies by formula, for suggestions.
const SKIES: [&str; 5] = ["constant", "gradient", "overcast", "sky", "sun:45,30"];

/// Opens a probe by name or path; a misspelt one gets a suggestion.
///
/// # Errors
/// As [`probe::open`].
pub fn open_probe(argument: &str, keep_negative: bool, layout: Option<Layout>) -> Result<Probe> {
    let options = ReadOptions { layout, keep_negative, ..ReadOptions::default() };
    let unknown = probe::by_name(argument)?.is_none() && !Path::new(argument).exists();
    let word = argument.split(':').next().unwrap_or(argument);
    let known = EMBEDDED.into_iter().chain(SKIES.map(|s| s.split(':').next().unwrap_or(s)));
    match nearest(word, known).filter(|_| unknown) {
        Some(near) => {
            let expected =
                format!("an image file that exists, or one of {}, {}", EMBEDDED.join(", "), SKIES.join(", "));
            Err(Error::argument("environment", argument, expected, format!("did you mean {near}?")))
        }
        None => probe::open(argument, &options),
    }
}

/// The environment of a forecast or a study: that given, else the scene's with its rotation in degrees, else a courtyard.
///
/// # Errors
/// As [`open_probe`].
pub fn environment(given: Option<&str>, scene: Option<&SceneFile>) -> Result<(Probe, f64)> {
    let (name, turned) = match (given, scene.and_then(SceneFile::environment)) {
        (Some(given), _) => (given.to_owned(), 0.0),
        (None, Some(of_scene)) => (of_scene, scene.map_or(0.0, SceneFile::rotation)),
        (None, None) => ("courtyard".into(), 0.0),
    };
    Ok((open_probe(&name, false, None)?, turned))
}

impl SceneFile {
    /// How far its environment is turned, in degrees.
    #[doc(hidden)]
    pub fn rotation(&self) -> f64 {
        self.description.probe.as_ref().and_then(|probe| probe.rotation).unwrap_or(0.0)
    }

    /// An error about an isovalue, with the line that it stands in.
    #[doc(hidden)]
    pub fn at_isovalue(&self, isovalue: Isovalue, error: Error) -> Error {
        let listed = &self.description.isovalues;
        match listed.iter().find(|i| i.value.parse().is_ok_and(|i: Isovalue| i == isovalue)) {
            Some(written) => self.description.at_line(written.line, error),
            None => error,
        }
    }

    /// An error about the environment of this name, with the line that names it.
    #[doc(hidden)]
    pub fn at_environment(&self, name: &str, error: Error) -> Error {
        if self.environment().as_deref() != Some(name) {
            return error;
        }
        let line = self.description.probe.as_ref().map_or(1, |probe| probe.name.line);
        self.description.at_line(line, error)
    }
}
