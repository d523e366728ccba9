//! Which files are written: names, formats, and whether they can be written; found out before the work that they take.

use crate::error::{Error, Result};
use crate::export::simplify::Lod;
use crate::file::{check_folder, clean};
use crate::quantity::number;
use std::path::{Path, PathBuf};

/// A kind of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    Glb,
    Ply,
    Stl,
    Usdz,
    Png,
}

impl Format {
    fn of(path: &Path) -> Result<Self> {
        let suffix = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
        match suffix.as_deref() {
            Some("glb") => Ok(Self::Glb),
            Some("ply") => Ok(Self::Ply),
            Some("stl") => Ok(Self::Stl),
            Some("usdz") => Ok(Self::Usdz),
            Some("png") => Ok(Self::Png),
            Some("gltf") => Err(Error::argument(
                "output",
                path.display(),
                ".glb, .ply, .stl, .usdz or .png",
                "write .glb: glTF in one file",
            )),
            _ => Err(Error::argument(
                "output",
                path.display(),
                "a name ending in .glb, .ply, .stl, .usdz or .png",
                "the ending decides the format",
            )),
        }
    }
}

/// A file to write.
#[derive(Clone, Debug, PartialEq)]
pub struct Target {
    pub path: PathBuf,
    pub format: Format,
    /// How many triangles are left in it; all, if `None`.
    pub lod: Option<Lod>,
}

/// The files for all isovalues × environments, isovalue-major, from `-o`: one name, a pattern with
/// `{isovalue}` and `{env}`, or a directory.
pub fn targets(output: &Path, name: &str, isovalues: &[f64], environments: &[String]) -> Result<Vec<Target>> {
    let pattern = output.to_string_lossy().into_owned();
    let several = isovalues.len() * environments.len() > 1;
    let is_folder = output.is_dir() || pattern.ends_with(['/', '\\']);
    if is_folder && !several {
        let remedy = format!("give a file name in it such as {}", output.join("surface.glb").display());
        return Err(Error::argument("output", output.display(), "a file name; this is a directory", remedy));
    }
    let pattern = if is_folder {
        let file = format!("{}-{{isovalue}}-{{env}}.glb", clean(name));
        output.join(file).to_string_lossy().into_owned()
    } else {
        pattern
    };
    let needs = [("{isovalue}", isovalues.len()), ("{env}", environments.len())];
    if let Some((part, n)) = needs.iter().find(|(part, n)| *n > 1 && !pattern.contains(part)) {
        let stem = output.with_extension("");
        let suffix = output.extension().map_or("glb".into(), |e| e.to_string_lossy());
        let remedy =
            format!("write for example -o \"{}-{{isovalue}}-{{env}}.{suffix}\", or name a directory", stem.display());
        return Err(Error::argument("output", output.display(), format!("{part} in the name for {n} of them"), remedy));
    }
    let mut targets = Vec::new();
    for c in isovalues {
        for env in environments {
            let path = pattern.replace("{isovalue}", &number(*c, 8)).replace("{env}", &clean(env));
            let path = PathBuf::from(path);
            targets.push(Target { format: Format::of(&path)?, path, lod: None });
        }
    }
    if let Some(twice) = (1..targets.len()).find(|&i| targets[..i].iter().any(|t| t.path == targets[i].path)) {
        let path = targets[twice].path.display();
        return Err(Error::argument(
            "output",
            path,
            "different names",
            "two of the environments or isovalues are the same",
        ));
    }
    if is_folder && !output.exists() {
        check_folder(output)?;
    } else {
        targets.iter().try_for_each(|t| check_file(&t.path))?;
    }
    Ok(targets)
}

/// Makes the directory that `-o` names with a slash at its end, if it is not there.
pub fn make_folder(output: &Path) -> Result<()> {
    if !output.to_string_lossy().ends_with(['/', '\\']) || output.is_dir() {
        return Ok(());
    }
    std::fs::create_dir(output).map_err(|e| Error::io(output, "make the directory", e))
}

/// Refuses a file that cannot be written, before any work is done for it.
pub fn check_file(path: &Path) -> Result<()> {
    if path.is_dir() {
        return Err(Error::argument(
            "output",
            path.display(),
            "a file name; this is a directory",
            "give a file name in it",
        ));
    }
    check_folder(path)
}

/// The folder of a result of several files: `given`, or one in the working directory. Refused before the minutes that the result
/// takes if `file` cannot be written there.
pub fn result_folder(given: Option<&Path>, otherwise: String, file: &str) -> Result<PathBuf> {
    let folder = given.map_or_else(|| PathBuf::from(otherwise), Path::to_path_buf);
    let inside = if folder.is_dir() { folder.join(file) } else { folder.clone() };
    check_folder(&inside)?;
    Ok(folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(output: &str, isovalues: &[f64], environments: &[&str]) -> Result<Vec<String>> {
        let environments: Vec<String> = environments.iter().map(|e| e.to_string()).collect();
        let list = targets(Path::new(output), "brain", isovalues, &environments)?;
        Ok(list.iter().map(|t| t.path.display().to_string()).collect())
    }

    #[test]
    fn patterns_name_every_combination() {
        let list = names("a-{isovalue}-{env}.png", &[90.0, 160.5], &["sky", "sun:0,45"]).expect("a full pattern");
        assert_eq!(list, ["a-90-sky.png", "a-90-sun_0_45.png", "a-160.5-sky.png", "a-160.5-sun_0_45.png"]);
        assert_eq!(names("a.glb", &[90.0], &["sky"]).expect("one name"), ["a.glb"]);
    }

    #[test]
    fn ambiguous_names_are_refused() {
        for (output, isovalues, environments) in [
            ("a.glb", &[1.0, 2.0][..], &["sky"][..]),
            ("a-{isovalue}.glb", &[1.0, 2.0], &["sky", "studio"]),
            ("a-{env}.glb", &[1.0], &["sky", "sky"]),
            ("a.obj", &[1.0], &["sky"]),
            (".", &[1.0], &["sky"]),
        ] {
            assert!(names(output, isovalues, environments).is_err(), "{output}");
        }
    }
}
