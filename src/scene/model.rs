//! Models in TOML as volumes: `model.toml` and `model.toml:128` wherever a volume is named.

use super::description::{Files, ModelDescription, Size, files_of_nodes};
use super::geometry::{TriangleMesh, read_mesh};
use crate::error::{Error, Result};
use crate::file::{self, Beside};
use crate::geom::Affine;
use crate::model::{Counters, Tree};
use crate::quantity::bytes;
use crate::volume::{Choice, ModelText, Note, ReadHint, Samples, Solid, Volume, open_with};
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Longest text of a model: as of a scene.
const MOST_BYTES: u64 = 1 << 26;
/// Longest text that goes with a volume into its store, where the metadata of each node repeat it.
const MOST_KEPT: usize = 1 << 20;
/// Longest file that a model names.
const MOST_FILE_BYTES: u64 = 1 << 32;
/// Most samples along a side.
const MOST_SAMPLES: usize = 4096;

/// The name of a model, taken apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ModelName<'a> {
    /// The file.
    pub path: &'a str,
    size: Option<&'a str>,
}

impl<'a> ModelName<'a> {
    /// The file of a model and perhaps its size; `None` where the name is no name of a TOML file.
    pub fn of(name: &'a str) -> Option<Self> {
        let is_toml = |path: &str| path.to_ascii_lowercase().ends_with(".toml");
        if is_toml(name) {
            return Some(Self { path: name, size: None });
        }
        let (path, size) = name.rsplit_once(':')?;
        is_toml(path).then_some(Self { path, size: Some(size) })
    }

    /// The same, where nothing but a model will do.
    ///
    /// # Errors
    /// When the name is none of a TOML file.
    pub fn asked(name: &'a str) -> Result<Self> {
        Self::of(name).ok_or_else(|| {
            let expected = "a model in TOML: other volumes are known by their samples alone";
            Error::argument("model", name, expected, "give model.toml or model.toml:96")
        })
    }

    /// The name of the model, without folder and ending.
    pub fn stem(&self) -> String {
        Path::new(self.path).file_stem().map_or_else(|| "model".into(), |s| s.to_string_lossy().into_owned())
    }

    fn size(&self) -> Result<Option<Size>> {
        let Some(text) = self.size else { return Ok(None) };
        let number = |n: &str| n.parse().ok().filter(|n| (2..=MOST_SAMPLES).contains(n));
        let numbers: Option<Vec<usize>> = text.split('x').map(number).collect();
        match numbers.as_deref() {
            Some(&[n]) => Ok(Some(Size::Longest(n))),
            Some(&[x, y, z]) => Ok(Some(Size::Exactly([x, y, z]))),
            _ => {
                let expected =
                    format!("{}:N or {}:XxYxZ with 2 to {MOST_SAMPLES} samples along a side", self.path, self.path);
                let given = format!("{}:{text}", self.path);
                Err(Error::argument("model", given, expected, format!("for example {}:128", self.path)))
            }
        }
    }
}

/// The file of a model, and those that it names.
pub(super) fn files_of_model(name: &ModelName<'_>) -> Vec<PathBuf> {
    let path = Path::new(name.path);
    // What cannot be read is refused where it is read.
    let text = file::read(path, MOST_BYTES).ok().and_then(|bytes| String::from_utf8(bytes).ok()).unwrap_or_default();
    let named = files_of_nodes(&text).into_iter().map(|file| path.with_file_name(file));
    [path.to_path_buf()].into_iter().chain(named).collect()
}

/// A model as a volume.
pub(super) struct Sampled {
    pub(super) volume: Volume,
    /// The isovalue at which its nodes mean what they say.
    pub(super) isovalue: f64,
    /// What was sampled.
    pub(super) tree: Arc<Tree>,
}

/// Files beside the model.
struct BesideModel {
    beside: Beside,
    allow_outside: bool,
}

impl Files for BesideModel {
    fn mesh(&mut self, name: &str) -> Result<TriangleMesh> {
        let path = self.beside.path(name)?;
        let bytes = file::read(&path, MOST_FILE_BYTES)?;
        let beside = Beside::new(&path, false);
        let mut read = |other: &str, most: u64| beside.read(other, most.min(MOST_FILE_BYTES));
        read_mesh(&bytes, &mut read).map_err(|e| e.in_file(&path))
    }

    fn volume(&mut self, name: &str, choice: Choice) -> Result<Volume> {
        let path = self.beside.path(name)?;
        let choice = Choice { allow_outside: self.allow_outside, ..choice };
        open_with(&path, &ReadHint { choice, ..ReadHint::default() })
    }

    fn bytes(&mut self, name: &str) -> Result<Vec<u8>> {
        self.beside.read(name, MOST_FILE_BYTES)
    }
}

/// Reads the description of a model.
///
/// # Errors
/// When the file cannot be read or makes no sense; each names the line.
pub fn describe(name: &ModelName<'_>, allow_outside: bool) -> Result<ModelDescription> {
    Ok(read(name, allow_outside)?.0)
}

/// The same with its text.
fn read(name: &ModelName<'_>, allow_outside: bool) -> Result<(ModelDescription, String)> {
    let size = name.size()?;
    let text = String::from_utf8(file::read(name.path, MOST_BYTES)?).map_err(|_| {
        let expected = "text in UTF-8";
        Error::format("model", "bytes that are no text", expected, "save it as UTF-8").in_file(name.path)
    })?;
    let mut files = BesideModel { beside: Beside::new(name.path, allow_outside), allow_outside };
    Ok((ModelDescription::read(&text, name.path, size, &mut files)?, text))
}

/// Samples a model.
///
/// # Errors
/// As [`describe`]; when memory does not suffice.
pub(super) fn open(name: &ModelName<'_>, allow_outside: bool) -> Result<Sampled> {
    let (model, text) = read(name, allow_outside)?;
    let mut volume = sample(&model, name.stem())?;
    if text.len() > MOST_KEPT {
        let (length, most) = (bytes(text.len() as f64), bytes(MOST_KEPT as f64));
        let text = format!(
            "its text, {length}, is longer than the {most} that stores keep: of a store --exact-vertices will need {}",
            name.path
        );
        volume.notes.push(Note { text, count: 1 });
    } else {
        volume.model = Some(Arc::new(ModelText { file: file::file_name(name.path), text }));
    }
    Ok(Sampled { volume, isovalue: model.isovalue, tree: model.tree })
}

/// Files that only a folder has.
struct Nowhere;

impl Nowhere {
    fn refuse<T>(name: &str) -> Result<T> {
        let expected = "a model without files: a store keeps its text alone";
        Err(Error::argument("--exact-vertices", format!("a model with the file {name}"), expected, FROM_MODEL))
    }
}

impl Files for Nowhere {
    fn mesh(&mut self, name: &str) -> Result<TriangleMesh> {
        Self::refuse(name)
    }

    fn volume(&mut self, name: &str, _: Choice) -> Result<Volume> {
        Self::refuse(name)
    }

    fn bytes(&mut self, name: &str) -> Result<Vec<u8>> {
        Self::refuse(name)
    }
}

/// What to do where a store does not suffice for vertices on the model.
const FROM_MODEL: &str = "give the model.toml itself, or bake it with --exact-vertices";

/// The model that a volume of a store is samples of, by its text.
///
/// # Errors
/// When it is samples of none, or the text names files.
pub(super) fn of_store(volume: &Volume) -> Result<Arc<Tree>> {
    let Some(model) = &volume.model else {
        let expected = "a store with the text of a model";
        return Err(Error::argument(
            "--exact-vertices",
            &volume.name,
            expected,
            format!("leave it out; of a model {FROM_MODEL}"),
        ));
    };
    let size = Some(Size::Exactly(volume.dims()));
    Ok(ModelDescription::read(&model.text, &model.file, size, &mut Nowhere)?.tree)
}

/// The error about vertices on a model where there is none.
pub(super) fn no_model(name: &str) -> Error {
    let expected = "a model in TOML: other volumes are known by their samples alone";
    Error::argument("--exact-vertices", name, expected, "leave it out")
}

/// The volume of a model.
///
/// # Errors
/// When memory does not suffice, or a value is beyond what samples can be.
pub fn sample(model: &ModelDescription, name: String) -> Result<Volume> {
    Ok(sample_and_count(model, name)?.0)
}

/// The same, and what it took.
pub(crate) fn sample_and_count(model: &ModelDescription, name: String) -> Result<(Volume, Counters)> {
    let dims = model.dims;
    let count = dims.iter().try_fold(1usize, |n, &d| n.checked_mul(d));
    let mut values: Vec<f32> = Vec::new();
    if count.is_none_or(|n| values.try_reserve_exact(n).is_err()) {
        return Err(Error::Limit {
            what: format!("the model {name} at {}x{}x{}", dims[0], dims[1], dims[2]),
            needed: format!("{} bytes", 4.0 * dims.iter().map(|&d| d as f64).product::<f64>()),
            limit: "the memory of this machine".into(),
            remedy: "give fewer samples".into(),
        });
    }
    let counters = model.tree.sample(&model.bounds, dims, true, &mut values);
    let intervals = DVec3::from_array(dims.map(|n| (n - 1) as f64));
    let world_from_grid = Affine::from_spacing(model.bounds.size() / intervals, model.bounds.min);
    let world_from_grid = world_from_grid.ok_or_else(|| {
        Error::argument(
            "bounds",
            format!("{:?}", model.bounds),
            "a box with a volume",
            "correct the bounds of the model",
        )
    })?;
    let mut volume = Volume::new(dims, Samples::F32(values), world_from_grid)?;
    volume.name = name;
    volume.up = model.up.unwrap_or_default();
    volume.solid = model.solid.unwrap_or_default();
    volume.convex_side = model.tree.is_convex().then_some(Solid::Above);
    volume.notes = model.notes.iter().map(|text| Note { text: text.clone(), count: 1 }).collect();
    if counters.mended > 0 {
        let text =
            format!("{} values of the model are missing (NaN) and take the least of the others", counters.mended);
        volume.notes.push(Note { text, count: counters.mended });
    }
    Ok((volume, counters))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_that_no_store_keeps_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.toml");
        let text = "[model]\nbounds = [[-1, -1, -1], [1, 1, 1]]\n[model.point.a]\ncentre = [0, 0, 0]\nradius = 1\n";
        for (length, is_kept) in [(0, true), (MOST_KEPT, false)] {
            std::fs::write(&path, format!("{text}# {}\n", "-".repeat(length))).unwrap();
            let name = format!("{}:4", path.display());
            let volume = open(&ModelName::of(&name).unwrap(), false).unwrap().volume;
            assert_eq!(volume.model.is_some(), is_kept);
            assert_eq!(volume.notes.iter().any(|note| note.text.contains("longer than")), !is_kept);
            let told = of_store(&volume).map(|_| ()).map_err(|e| e.to_string());
            assert!(is_kept && told.is_ok() || told.is_err_and(|e| e.contains("model.toml itself")));
        }
    }

    #[test]
    fn names_of_models_are_taken_apart() {
        let of = |name: &'static str| ModelName::of(name).map(|m| (m.path, m.size().map_err(|e| e.to_string())));
        assert_eq!(of("a/b.toml"), Some(("a/b.toml", Ok(None))));
        assert_eq!(of("b.TOML:96"), Some(("b.TOML", Ok(Some(Size::Longest(96))))));
        assert_eq!(of("C:/b.toml:9x8x7"), Some(("C:/b.toml", Ok(Some(Size::Exactly([9, 8, 7]))))));
        assert_eq!(of("bumpbox:96"), None);
        assert_eq!(of("b.toml.gz"), None);
        for wrong in ["b.toml:1", "b.toml:x", "b.toml:9x9", "b.toml:5000", "b.toml:"] {
            let text = of(wrong).unwrap().1.unwrap_err();
            assert!(text.contains(wrong) && text.contains("b.toml:128"), "{text}");
        }
    }
}
