//! What a path is: a store, a place for one, or something else.

use super::{Holdings, Store};
use crate::error::{Error, Result};
use crate::file;
use crate::quantity::number;
use crate::scene::missing_store;
use crate::volume::isovalue::Chosen;
use crate::volume::{Isovalue, Volume, field};
use serde_json::{Value, json};
use std::path::Path;

/// Whether an argument names a store rather than a volume.
pub fn is_store(argument: &str) -> bool {
    let path = Path::new(argument);
    (path.is_dir() && (argument.trim_end_matches('/').ends_with(".isolume") || !holds_volume(path)))
        || (path.is_file() && argument.ends_with(".isolume"))
        || argument.ends_with(".isolume.zip")
}

/// Whether a directory is no store but may be a volume: a folder with files, or a Zarr hierarchy of another program.
fn holds_volume(folder: &Path) -> bool {
    let is_entry = |entry: std::io::Result<std::fs::DirEntry>| entry.is_ok();
    match file::read(folder.join("zarr.json"), MOST_METADATA) {
        Ok(root) => {
            let text = String::from_utf8_lossy(&root);
            text.contains("\"zarr_format\"") && !text.contains("isolume")
        }
        Err(_) if folder.join("zarr.json").exists() => false,
        // Of a study the series may lie in folders of their own; those of a store whose root is gone have their names.
        Err(_) if ["volumes", "transfer"].iter().all(|name| folder.join(name).is_dir()) => false,
        Err(_) => std::fs::read_dir(folder).is_ok_and(|mut entries| entries.any(is_entry)),
    }
}

/// Longest root of a hierarchy that is looked into.
const MOST_METADATA: u64 = 1 << 24;

/// Refuses what is no store.
///
/// # Errors
/// When there is nothing of that name, or something else.
pub fn check_store(argument: &str) -> Result<()> {
    if is_store(argument) {
        return Ok(());
    }
    if !Path::new(argument).exists() && field::by_name(argument).is_ok_and(|found| found.is_none()) {
        return Err(missing_store(argument));
    }
    let remedy = format!("bake the volume first: isolume bake {argument} -o NAME.isolume");
    let expected = "a transfer store; `isolume bake` makes one, `isolume relight` keeps one in its cache";
    Err(Error::argument("input", argument, expected, remedy))
}

/// Whether a directory has the folders of a store, whatever its metadata says.
fn looks_like_a_store(path: &Path) -> bool {
    path.join("volumes").is_dir() && path.join("transfer").is_dir()
}

/// Refuses to replace what is no store of ours; a damaged one may be replaced.
///
/// # Errors
/// When it is something else.
pub fn check_replaceable(path: &Path) -> Result<()> {
    match Store::open(path) {
        Err(_) if looks_like_a_store(path) => Ok(()),
        result => result.map(drop),
    }
}

/// Refuses an output that cannot become a store, before any work.
///
/// # Errors
/// When its name is that of another format, or it is a folder of something else.
pub fn check_output(path: &Path) -> Result<()> {
    const OTHERS: [&str; 10] = ["glb", "gltf", "ply", "stl", "png", "vti", "nrrd", "raw", "html", "toml"];
    if let Some(ending) = path.extension().filter(|e| OTHERS.iter().any(|other| e.eq_ignore_ascii_case(other))) {
        let store = path.with_extension("isolume");
        let found = format!("{}, named as a .{} is", path.display(), ending.display());
        let expected = "a name for a transfer store, which is a directory";
        let remedy = format!(
            "bake with -o {0}; relight, export and view make files of it: isolume relight {0} …",
            store.display()
        );
        return Err(Error::argument("output", found, expected, remedy));
    }
    if path.symlink_metadata().is_err() {
        return file::check_folder(path);
    }
    if path.is_dir() && !path.join("zarr.json").exists() && !looks_like_a_store(path) {
        return Err(Error::argument(
            "output",
            path.display(),
            "a path where nothing is yet, or a transfer store",
            "this is a directory of something else; give a name such as brain.isolume in it",
        ));
    }
    Ok(())
}

impl Store {
    /// An isovalue of its volume; `auto` is the one that it holds, if it holds only some.
    ///
    /// # Errors
    /// When no surface has it, or the store is damaged.
    #[doc(hidden)]
    pub fn choose(&self, volume: &Volume, isovalue: Isovalue) -> Result<Chosen> {
        if isovalue == Isovalue::Auto {
            // Looks at every chunk, so only where it matters.
            let held = self.holdings()?;
            if let Some(&value) = held.isovalues.first().filter(|_| !held.all) {
                let reason = Some("the store holds it".into());
                return Ok(Chosen { reason, ..Chosen::given(value, volume.solid) });
            }
        }
        isovalue.resolve(volume, Some(volume.solid), None)
    }

    /// Refuses, for what needs a texture, a store that has transfer at the vertices of surfaces alone.
    ///
    /// # Errors
    /// When it has none; says what bakes one.
    #[doc(hidden)]
    pub fn check_texture(&self, held: &Holdings, what: &str) -> Result<()> {
        if held.all || !held.in_texture.is_empty() || held.surfaces.is_empty() {
            return Ok(());
        }
        let list = held.surfaces.iter().map(|c| number(*c, 8)).collect::<Vec<_>>().join(", ");
        let found = format!("{}, with transfer at the vertices of isovalue {list} alone", self.path().display());
        let input = self.provenance()["input"].as_str().unwrap_or("VOLUME");
        let remedy = format!(
            "bake a texture into it: isolume bake {input} --texture 1 -o {} (with the options of the first bake)",
            self.path().display()
        );
        Err(Error::argument("store", found, format!("a store with a texture, which {what} needs"), remedy))
    }
}

impl Holdings {
    /// The isovalues as text.
    pub fn isovalues_text(&self) -> String {
        let list = self.isovalues.iter().map(|c| number(*c, 8)).collect::<Vec<_>>().join(", ");
        match (self.all, list.is_empty()) {
            (true, true) => "all".into(),
            (true, false) => format!("all, and more of {list}"),
            (false, true) => "none".into(),
            (false, false) if self.surfaces.len() == self.isovalues.len() => {
                format!("{list}, at the vertices of their surfaces")
            }
            (false, false) => list,
        }
    }

    /// The isovalues for programs: "all", or a list.
    pub fn isovalues_json(&self) -> Value {
        if self.all { json!("all") } else { json!(self.isovalues) }
    }

    /// How well the texels are baked, as text.
    pub fn quality_text(&self) -> String {
        let [least, most] = self.rays;
        let rays = if least == most { most.to_string() } else { format!("{least} to {most}") };
        let mut parts =
            vec![format!("{rays} rays a {}", if self.in_texture.is_empty() && !self.all { "vertex" } else { "texel" })];
        for (of, [low, high]) in &self.targets {
            let errors = if low == high { format!("{low}") } else { format!("{low} to {high}") };
            parts.push(format!("or a standard error of {errors} ({of})"));
        }
        parts.join(", ")
    }
}
