//! OME-Zarr 0.4 and 0.5 (and what is older), and plain Zarr arrays of versions 2 and 3, in a folder: by hand, so that it is there
//! without a C compiler, bounded by what the metadata say, and no chunk is read that a region does not touch. The crate `zarrs`
//! reads more codecs; it takes 140 s of processor time to build and allocates what metadata claim.
//!
//! What is not stored is the fill value, with a note of how much. World: index, scale and translation of the level, then those
//! of the image (ngff.openmicroscopy.org, 0.4 and 0.5). Knows nothing of the stores of this program.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]

mod blosc;
mod chunks;
mod codec;
mod metadata;
mod ome;

use super::assemble::{Parts, assemble, note, place};
use super::choice::{Choice, Has};
use super::format::affine;
use super::read::ReadHint;
use super::{LengthUnit, Note, Volume};
use crate::error::{Error, Result};
use crate::file::{self, Beside};
use crate::geom::Affine;
use glam::{DMat3, DVec3};
use metadata::Array;
use ome::Image;
use serde_json::Value;
use std::io;
use std::path::{Path, PathBuf};

const NAME: &str = "Zarr";
/// Longest metadata of one node.
const MOST_METADATA: u64 = 1 << 26;
/// Most entries of a folder that is looked through for arrays.
const MOST_ENTRIES: usize = 1 << 16;

fn damage(found: impl Into<String>, expected: impl Into<String>, remedy: impl Into<String>) -> Error {
    Error::format(NAME, found, expected, remedy)
}

/// Whether a folder is the root, a group or an array of a hierarchy.
pub(super) fn is_zarr(folder: &Path) -> bool {
    ["zarr.json", ".zgroup", ".zarray", ".zattrs"].iter().any(|name| folder.join(name).is_file())
}

/// The files of a hierarchy, by their keys.
struct Files {
    folder: PathBuf,
    beside: Beside,
}

/// None for what is not there.
fn found<T>(result: Result<T>) -> Result<Option<T>> {
    match result {
        Ok(found) => Ok(Some(found)),
        Err(Error::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(e) => Err(e),
    }
}

/// A group or an array.
struct Node {
    attributes: Value,
    array: Option<Array>,
}

impl Files {
    fn new(folder: &Path, allow_outside: bool) -> Self {
        Self { folder: folder.to_path_buf(), beside: Beside::new(folder.join("zarr.json"), allow_outside) }
    }

    /// A chunk and its length; none where it is not there. Its array was found by [`Self::json`], so that the place is checked;
    /// to do so for each chunk again takes longer than to read it.
    fn open(&self, key: &str) -> Result<Option<(std::fs::File, u64)>> {
        found(file::open(self.folder.join(key)))
    }

    fn json(&self, key: &str) -> Result<Option<Value>> {
        let Some(bytes) = found(self.beside.read(key, MOST_METADATA))? else { return Ok(None) };
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
        let parsed = serde_json::from_slice(bytes);
        parsed.map(Some).map_err(|e| damage(format!("{key}: {e}"), "JSON", "the metadata are damaged; copy them again"))
    }

    /// The group or array at a path below the folder, empty for itself.
    fn node(&self, path: &str) -> Result<Option<Node>> {
        let key = |name: &str| if path.is_empty() { name.to_string() } else { format!("{path}/{name}") };
        let named = |e: Error| e.in_file(if path.is_empty() { "the root" } else { path });
        if let Some(meta) = self.json(&key("zarr.json"))? {
            let array = match meta["node_type"].as_str() {
                Some("array") => Some(Array::version_3(&meta).map_err(named)?),
                Some("group") => None,
                _ => {
                    let found = format!("node_type {} in {}", meta["node_type"], key("zarr.json"));
                    return Err(damage(found, "group or array", "the metadata are damaged"));
                }
            };
            return Ok(Some(Node { attributes: meta["attributes"].clone(), array }));
        }
        let attributes = self.json(&key(".zattrs"))?;
        if let Some(meta) = self.json(&key(".zarray"))? {
            let attributes = attributes.unwrap_or_default();
            let array = Array::version_2(&meta, &attributes).map_err(named)?;
            return Ok(Some(Node { attributes, array: Some(array) }));
        }
        let is_group = attributes.is_some() || self.json(&key(".zgroup"))?.is_some();
        Ok(is_group.then(|| Node { attributes: attributes.unwrap_or_default(), array: None }))
    }

    /// An array that something names.
    fn array(&self, path: &str) -> Result<Array> {
        let array = self.node(path)?.and_then(|node| node.array);
        array.ok_or_else(|| damage(format!("no array {path}"), "it in the hierarchy", "copy the hierarchy again"))
    }

    /// Names of the folders in this one, sorted.
    fn folders(&self) -> Result<Vec<String>> {
        let refuse = |e| Error::io(&self.folder, "list the folder", e);
        let mut names = Vec::new();
        for entry in std::fs::read_dir(&self.folder).map_err(refuse)?.take(MOST_ENTRIES) {
            let entry = entry.map_err(refuse)?;
            if entry.path().is_dir() {
                names.push(entry.file_name().to_string_lossy().into_owned());
            }
        }
        names.sort();
        Ok(names)
    }
}

/// Reads the image, or the array, in a folder.
///
/// # Errors
/// When it holds none or several, a chunk is damaged, or the metadata say what cannot be.
pub(super) fn open(folder: &Path, hint: &ReadHint) -> Result<Volume> {
    let in_folder = |e: Error| e.in_file(folder);
    hint.choice.fits(Has { arrays: true, levels: true, ..Has::default() }).map_err(in_folder)?;
    let name = folder.canonicalize().map_or_else(|_| hint.name.clone(), |path| super::open::stem(&path));
    let hint = ReadHint { name, ..hint.clone() };
    read(&Files::new(folder, hint.choice.allow_outside), &hint).map_err(in_folder)
}

fn read(files: &Files, hint: &ReadHint) -> Result<Volume> {
    let none = || damage("no metadata", "zarr.json, .zgroup or .zarray", "name the folder of the image");
    let node = files.node("")?.ok_or_else(none)?;
    if let Some(array) = node.array {
        hint.choice.fits(Has::default())?;
        return read_image(files, Image::of_array(&array, ""), vec![array], hint, Vec::new());
    }
    let mut notes = Vec::new();
    // 0.5 has all of it below `ome`.
    let ome = node.attributes.get("ome").unwrap_or(&node.attributes);
    if let Some(images) = ome["multiscales"].as_array() {
        let image = ome::choose(images, ome, &hint.choice, &mut notes)?;
        let levels = image.paths().map(|path| files.array(path)).collect::<Result<Vec<_>>>()?;
        return read_image(files, image, levels, hint, notes);
    }
    if let Some(remedy) = ome::of_several(files, ome)? {
        return Err(remedy);
    }
    let mut arrays = Vec::new();
    for name in files.folders()? {
        if files.node(&name).is_ok_and(|node| node.is_some_and(|node| node.array.is_some())) {
            arrays.push(name);
        }
    }
    if arrays.is_empty() {
        let remedy = "name an image or an array below it: isolume info FOLDER/0";
        return Err(damage("a group without image and without arrays", "an OME-Zarr image, or arrays", remedy));
    }
    let chosen = hint.choice.array_of(NAME, &arrays, None)?;
    let path = arrays.get(chosen).cloned().unwrap_or_default();
    let array = files.array(&path)?;
    let mut image = Image::of_array(&array, &path);
    (image.arrays, image.array) = (arrays, chosen);
    read_image(files, image, vec![array], hint, notes)
}

/// Reads a level of an image.
fn read_image(
    files: &Files,
    image: Image,
    levels: Vec<Array>,
    hint: &ReadHint,
    mut notes: Vec<Note>,
) -> Result<Volume> {
    let roles = levels.iter().map(|array| image.roles(array, &mut notes)).collect::<Result<Vec<_>>>()?;
    let sizes: Vec<[u64; 3]> = levels.iter().zip(&roles).map(|(array, roles)| roles.dims(&array.shape)).collect();
    let level = hint.choice.level_of(&sizes, &mut notes)?;
    let (Some(array), Some(roles), Some(dims)) = (levels.get(level), roles.get(level), sizes.get(level).copied())
    else {
        return Err(damage("no level", "at least one", "the metadata are damaged"));
    };
    let (times, channels) = (roles.along(roles.time, &array.shape), roles.along(roles.channel, &array.shape));
    let names = image.channels(channels)?;
    let mut series = hint.choice.of(NAME, names, usize::try_from(times).unwrap_or(usize::MAX), &mut notes)?;
    (series.arrays, series.array, series.level) = (image.arrays.clone(), image.array, level);
    let (first, count) = hint.choice.region.map_or(Ok(([0; 3], dims)), |region| region.within(dims))?;
    let part = chunks::Part { array, path: image.path(level), roles, series: &series, first, count };
    let data = part.read(files, hint, &mut notes).map_err(|e| with_levels(e, &sizes, level))?;
    series.levels = sizes;
    let (world_from_grid, unit) = world(&image, level, roles, &hint.choice, &mut notes)?;
    let (world_from_grid, unit) = place(world_from_grid, unit, first, &hint.choice)?;
    // Both are done.
    let choice = Choice { region: None, spacing: None, ..hint.choice.clone() };
    let hint = ReadHint { choice, ..hint.clone() };
    let (slope, inter, dims) = (1.0, 0.0, count.map(|n| n as usize));
    assemble(Parts { format: NAME, dims, data, slope, inter, world_from_grid, unit, series, notes }, &hint)
}

/// What is too large says which level is not.
fn with_levels(error: Error, sizes: &[[u64; 3]], level: usize) -> Error {
    match error {
        Error::Limit { what, needed, limit, .. } => {
            let [x, y, z] = sizes.last().copied().unwrap_or_default();
            let coarser = format!("choose a coarser one with --level (up to {}, {x} × {y} × {z}) or ", sizes.len() - 1);
            let coarser = if level + 1 < sizes.len() { coarser } else { String::new() };
            Error::Limit {
                what,
                needed,
                limit,
                remedy: format!("{coarser}read a part with --region X0:X1,Y0:Y1,Z0:Z1"),
            }
        }
        other => other,
    }
}

fn world(
    image: &Image,
    level: usize,
    roles: &ome::Roles,
    choice: &Choice,
    notes: &mut Vec<Note>,
) -> Result<(Affine, LengthUnit)> {
    let (scale, offset) = image.map(level, roles, notes)?;
    let (factors, unit) = image.unit(roles, notes);
    let (mut scale, offset) = (scale * factors, offset * factors);
    if !image.is_placed && choice.spacing.is_none() {
        notes.push(note("the array has no spacing: 1 is used; see --spacing", 1));
    }
    if choice.spacing.is_some() && !(scale.is_finite() && scale.abs().min_element() > 0.0) {
        scale = DVec3::ONE;
    }
    Ok((affine(NAME, DMat3::from_diagonal(scale), offset)?, unit))
}

#[cfg(test)]
mod tests;
