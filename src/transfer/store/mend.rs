//! Mending a store whose metadata or samples were lost: both follow from the volume and the identity, which whoever goes on
//! with a bake has in hand. Chunks of transfer do not; they are baked again ([`Store::verify_chunks`]).
//!
//! # What may be written over
//! A file that is sound is left alone, and one that says that this is a store of something else ends the attempt. Metadata
//! is written anew where something that is left proves whose store it is: a sound identity, or the record of a chunk, which
//! holds the hash of the identity. Where nothing does, only [`StoreOptions::repair`] lets it be written.

use super::backing::{Backing, Directory};
use super::joint::read_identity;
use super::metadata::{
    arrays_of, check_group, check_version, node_keys, node_name, nodes_of, packing_of, required_json, root_about,
    sealed, unsealed,
};
use super::surface::SURFACES;
use super::zarr::FORMAT;
use super::{FORMAT_VERSION, Identity, StoreOptions, surface, volume, zarr};
use crate::error::{Error, Result};
use crate::transfer::Layout;
use crate::volume::Volume;
use serde_json::{Value, json};
use std::path::Path;

/// Whether the directory has a sound description of how the transfer of the volume was made.
pub(super) fn describes(path: &Path, node: &str) -> bool {
    let backing = Backing::open(path);
    backing.is_ok_and(|backing| read_identity(&backing, &format!("transfer/{node}/env/zarr.json")).is_ok())
}

/// Whether the texture of a volume, or a surface of it, is packed, whatever the metadata say.
pub(super) fn is_packed(path: &Path, node: &str) -> bool {
    let has_planes = |place: &Path| place.join(super::packed::PACKED[0]).is_dir();
    let surfaces = std::fs::read_dir(path.join(SURFACES).join(node)).into_iter().flatten().flatten();
    has_planes(&path.join("transfer").join(node).join("env"))
        || surfaces.map(|entry| entry.path()).any(|p| has_planes(&p))
}

/// Writes what is damaged or missing of the metadata and the samples of a volume in the store at `path`, and says what,
/// one line each. Nothing is written where all is sound, and nothing into a store of an older format.
///
/// # Errors
/// [`Error::Mismatch`] when it is a sound store of something else; [`Error::Format`] when nothing proves whose store it
/// is; when the system refuses.
pub(super) fn mend(
    path: &Path,
    volume: &Volume,
    identity: &Identity,
    provenance: Value,
    options: StoreOptions,
) -> Result<Vec<String>> {
    let backing = Backing::Directory(Directory::open(path)?);
    // What a later version wrote is not damaged because this one cannot read it.
    if let Ok(Some(root)) = backing.json("zarr.json")
        && root["attributes"]["isolume"]["format_version"].is_u64()
    {
        let version = &root["attributes"]["isolume"]["format_version"];
        check_version(version).map_err(|e| e.in_file(backing.name("zarr.json")))?;
    }
    let node = node_name(&volume.name);
    let env = format!("transfer/{node}/env");
    let stored = read_identity(&backing, &format!("{env}/zarr.json"));
    let provenance = match stored {
        Ok((found, mut attributes)) => {
            found.check(identity, path, [&node, &node])?;
            attributes["provenance"].take()
        }
        Err(Error::Format { .. }) => {
            if !(options.repair || is_proven(&backing, &node, identity)?) {
                // A sound root of another volume says more than what is missing here.
                refuse_other(&backing, path, &node)?;
                return Err(unproven(&backing, path));
            }
            provenance
        }
        Err(other) => return Err(other),
    };
    let layout = identity.layout()?;
    let mut mended = Vec::new();
    let mut put = |key: &str, value: &Value, what: &str| {
        mended.push(format!("{} was {what}: written anew", backing.name(key).display()));
        backing.put(key, options.sync, format!("{value:#}\n").as_bytes())
    };
    let mut nodes = nodes_of(volume, identity, &layout, provenance)?;
    for (key, expected) in &mut nodes {
        let file = format!("{key}/zarr.json");
        match state(&backing, &file, key, expected, volume)? {
            State::Sound(found) => *expected = found,
            State::Lost(what) => put(&file, expected, what)?,
        }
    }
    // A damaged surface is made anew when its turn comes, from the volume.
    nodes.extend(surface::nodes_on_disk(&backing, &node, identity).unwrap_or_default());
    let root = root(&backing, identity, &node, nodes)?;
    match backing.json("zarr.json") {
        Ok(Some(found)) if found == root => {}
        Ok(Some(_)) => put("zarr.json", &root, "damaged")?,
        Ok(None) => put("zarr.json", &root, "missing")?,
        Err(Error::Format { .. } | Error::Limit { .. }) => put("zarr.json", &root, "damaged")?,
        Err(other) => return Err(other),
    }
    let samples = volume::mend(&backing, &format!("volumes/{node}/data"), volume, options.sync)?;
    if samples > 0 {
        let files = if samples == 1 { "file" } else { "files" };
        mended.push(format!("{samples} {files} of samples of {node}: damaged or missing, written anew"));
    }
    Ok(mended)
}

/// What is found of a metadata file.
enum State {
    /// It can stay; what it says.
    Sound(Value),
    /// What is wrong with it: missing, damaged, or of a file that cannot stay.
    Lost(&'static str),
}

/// Whether a node's file can stay. Groups without attributes and arrays follow from the identity to the letter; the
/// attributes of the volume and of the transfer group hold what the identity does not decide (names, notes, how the
/// store was made): theirs may differ, if they are whole.
fn state(backing: &Backing, file: &str, key: &str, expected: &Value, volume: &Volume) -> Result<State> {
    let found = match backing.json(file) {
        Ok(Some(found)) => found,
        Ok(None) => return Ok(State::Lost("missing")),
        Err(Error::Format { .. } | Error::Limit { .. }) => return Ok(State::Lost("damaged")),
        Err(other) => return Err(other),
    };
    if found == *expected {
        return Ok(State::Sound(found));
    }
    let is_whole = match key.rsplit('/').next() {
        Some("data") => match volume::wrong(&found, volume) {
            Some(what) => return Ok(State::Lost(what)),
            None => true,
        },
        Some("env") => check_group(&found).is_ok() && unsealed(&found).is_ok(),
        _ => false,
    };
    Ok(if is_whole { State::Sound(found) } else { State::Lost("damaged") })
}

/// The root of the store: of this volume, and of the others that it holds, in the order in which their scene has them.
fn root(backing: &Backing, identity: &Identity, node: &str, nodes: Vec<(String, Value)>) -> Result<Value> {
    let place = |identity: &Identity| identity.scene.as_ref().and_then(|s| s.coupling.as_ref()).map(|c| c.place);
    let mut members = vec![(place(identity), node.to_owned())];
    if let (Some(_), Backing::Directory(root)) = (place(identity), backing) {
        let entries = std::fs::read_dir(root.path().join("transfer")).into_iter().flatten().flatten();
        let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
        for other in names.filter(|name| name != node && *name == node_name(name)) {
            // One that was being added when its bake was killed, or that is damaged itself, is mended when its turn comes.
            if let Ok((identity, _)) = read_identity(backing, &format!("transfer/{other}/env/zarr.json")) {
                members.push((place(&identity), other));
            }
        }
    }
    members.sort();
    let (mut all, mut names): (Vec<(String, Value)>, Vec<String>) = (Vec::new(), Vec::new());
    let mut own = Some(nodes);
    for (_, member) in members {
        let part = match own.take_if(|_| member == node) {
            Some(nodes) => nodes,
            // Damaged as well: it is added again when its turn comes.
            None => match nodes_on_disk(backing, &member) {
                Ok(nodes) => nodes,
                Err(Error::Format { .. } | Error::Limit { .. }) => continue,
                Err(other) => return Err(other),
            },
        };
        names.push(member);
        for (key, value) in part {
            if !all.iter().any(|(known, _)| *known == key) {
                all.push((key, value));
            }
        }
    }
    let mut root = zarr::group(sealed(root_about(&names)));
    zarr::consolidate(&mut root, &all, SURFACES);
    Ok(root)
}

/// The metadata of another volume of the store, as it stands on the disk.
fn nodes_on_disk(backing: &Backing, node: &str) -> Result<Vec<(String, Value)>> {
    let (identity, _) = read_identity(backing, &format!("transfer/{node}/env/zarr.json"))?;
    let keys = node_keys(backing, node, &identity, &identity.layout()?)?;
    let own = keys.into_iter().map(|key| Ok((key.clone(), required_json(backing, &format!("{key}/zarr.json"))?)));
    let mut nodes = own.collect::<Result<Vec<_>>>()?;
    nodes.extend(surface::nodes_on_disk(backing, node, &identity)?);
    Ok(nodes)
}

/// Whether the record of some chunk, of the texture or of a surface, holds the hash of the identity.
fn is_proven(backing: &Backing, node: &str, identity: &Identity) -> Result<bool> {
    let Backing::Directory(root) = backing else { return Ok(false) };
    let hash = identity.hash();
    let surfaces = format!("{SURFACES}/{node}");
    let places = backing.folders(&surfaces).into_iter().map(|name| format!("{surfaces}/{name}"));
    for place in places.chain([format!("transfer/{node}/env")]) {
        let entries = std::fs::read_dir(root.path().join(&place).join("rays/extent")).into_iter().flatten().flatten();
        for name in entries.map(|entry| entry.file_name().to_string_lossy().into_owned()) {
            match backing.json(&format!("{place}/rays/extent/{name}")) {
                Ok(Some(record)) if record["of"]["store"] == json!(hash) => return Ok(true),
                Ok(_) | Err(Error::Format { .. } | Error::Limit { .. }) => {}
                Err(other) => return Err(other),
            }
        }
    }
    Ok(false)
}

/// Refuses where a sound root names other volumes and not this one.
fn refuse_other(backing: &Backing, path: &Path, node: &str) -> Result<()> {
    let Ok(held) = super::metadata::open_root(backing) else { return Ok(()) };
    if held.iter().any(|name| name == node) {
        return Ok(());
    }
    let remedy = format!("give another output with -o, or --force to replace {}", path.display());
    let (stored, asked) = (held.join(", "), node.to_owned());
    Err(Error::Mismatch { path: path.into(), field: "volume".into(), stored, asked, remedy })
}

/// Damaged metadata, and nothing that says whose store it is.
fn unproven(backing: &Backing, path: &Path) -> Error {
    let found = "metadata that is damaged, and no chunk that proves which volume and settings it belongs to";
    let remedy = format!(
        "where {} is the store that this command made, give --repair: its metadata is then written anew from the volume, \
         and every isosurface that was asked of it is completed",
        path.display()
    );
    Error::format(FORMAT, found, format!("a store of format {FORMAT_VERSION}"), remedy)
        .in_file(backing.name("zarr.json"))
}

/// What is wrong with the metadata of the open store that no reader of ours looks at: the copy in the root.
pub(super) fn wrong_copies(backing: &Backing, held: &[String]) -> Result<Vec<String>> {
    let root = required_json(backing, "zarr.json")?;
    let copies = &root["consolidated_metadata"]["metadata"];
    let mut wrong = Vec::new();
    for node in held {
        let nodes = match nodes_on_disk(backing, node) {
            // What is damaged itself is counted where it stands.
            Err(Error::Format { .. } | Error::Limit { .. }) => continue,
            nodes => nodes?,
        };
        for (key, value) in nodes {
            if copies.get(&key) != Some(&value) {
                wrong.push(key);
            }
        }
    }
    Ok(wrong)
}

/// Keys of groups and arrays whose own metadata is not what the identity implies.
pub(super) fn wrong_nodes(backing: &Backing, node: &str, identity: &Identity, layout: &Layout) -> Result<Vec<String>> {
    let mut wrong = Vec::new();
    for key in node_keys(backing, node, identity, layout)? {
        let file = format!("{key}/zarr.json");
        let is_sound = match backing.json(&file) {
            Ok(Some(found)) => match key.rsplit_once('/') {
                Some((group, name)) if group.starts_with("transfer/") && group.matches('/').count() == 2 => {
                    let of_group = identity.groups().into_iter().find(|g| group.ends_with(&format!("/{}", g.node())));
                    let layout = of_group.map_or_else(|| Ok(layout.clone()), |g| g.layout(layout))?;
                    let packing = packing_of(backing, group, &layout.layers)?;
                    let array = arrays_of(&layout, packing.as_ref()).into_iter().find(|(array, _)| *array == name);
                    array.is_some_and(|(_, array)| array.check(&found).is_ok())
                }
                Some((_, "data")) => unsealed(&found).is_ok(),
                _ => check_group(&found).is_ok() && check_version(&json!(identity.format_version)).is_ok(),
            },
            Ok(None) | Err(Error::Format { .. } | Error::Limit { .. }) => false,
            Err(other) => return Err(other),
        };
        if !is_sound {
            wrong.push(file);
        }
    }
    wrong.extend(surface::wrong_nodes(backing, node, identity)?);
    Ok(wrong)
}
