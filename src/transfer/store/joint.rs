//! Stores of several volumes that light each other: each has its samples, its identity and its groups of transfer.
//!
//! The root names the first volume, which [`Store::open`] opens, and all of them, in the order in which they were added. The
//! identity of each says which partners it was baked among, and how their isovalues follow its own.

use super::metadata::{check_group, node_name, open_root, required_json, root_about, sealed, unsealed};
use super::surface::SURFACES;
use super::zarr::{self, FORMAT, METADATA_REMEDY};
use super::{Backing, Identity, Store, StoreOptions, volume};
use crate::error::{Error, Result};
use crate::volume::Volume;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::Path;

/// What a volume was baked among, besides walls and luminaires.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CouplingIdentity {
    /// What couples them, for people.
    pub coupling: String,
    /// Name of this volume in the scene.
    pub name: String,
    /// Its place in the scene, from 0; isovalues without a name are those of the first.
    pub place: usize,
    /// Factor on its albedo.
    pub tint: [f32; 3],
    /// The others, by name.
    pub partners: Vec<PartnerIdentity>,
}

/// A partner as an identity names it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartnerIdentity {
    /// Its name in the scene.
    pub name: String,
    /// [`Volume::content_hash`].
    pub volume: String,
    /// Which side is matter.
    pub solid: String,
    /// Factor on its albedo.
    pub tint: [f32; 3],
    /// Isovalues of this volume and those of the partner that belong to them, in the values of the files: linear between
    /// two, that of the first or the last beyond. None where they are equal.
    pub isovalues: Vec<[f64; 2]>,
}

impl Store {
    /// The names of the volumes that it holds, as [`Self::of_volume`] takes them.
    ///
    /// # Errors
    /// When the root is damaged.
    pub fn volumes(&self) -> Result<Vec<String>> {
        open_root(&self.backing)
    }

    /// The transfer of a volume of the store, as a store of its own that shares the files.
    ///
    /// # Errors
    /// When it holds no such volume, or its metadata are damaged.
    pub fn of_volume(&self, name: &str) -> Result<Self> {
        let held = self.volumes()?;
        let node = node_name(name);
        if !held.contains(&node) {
            let remedy = "choose one of these, or go on with the bake of the scene that has it";
            return Err(Error::argument("--volume", name, format!("one of {}", held.join(", ")), remedy));
        }
        let mut store = Self::open_node(self.backing.again()?, &node)?;
        store.sync = self.sync;
        Ok(store)
    }

    /// As [`Self::open_or_create`], for a volume that stands beside others: where the store holds its partners but not
    /// it, it is added. A run that is killed before the volume is there leaves a store without it.
    ///
    /// # Errors
    /// As [`Self::open_or_create`]; when the store is of another scene.
    #[doc(hidden)]
    pub fn open_or_add(
        path: impl AsRef<Path>,
        volume: &Volume,
        identity: &Identity,
        provenance: Value,
    ) -> Result<Self> {
        StoreOptions::default().open_or_add(path, volume, identity, provenance)
    }

    /// Writes the parts of another volume, the root last: until it names the volume the store is as it was.
    pub(super) fn add(&self, volume: &Volume, held: &[String], nodes: Vec<(String, Value)>) -> Result<()> {
        let root = required_json(&self.backing, "zarr.json")?;
        let known = root["consolidated_metadata"]["metadata"].as_object().cloned().unwrap_or_default();
        let put = |key: &str, value: &Value| self.backing.put(key, self.sync, format!("{value:#}\n").as_bytes());
        for (key, value) in &nodes {
            put(&format!("{key}/zarr.json"), value)?;
        }
        let node = held.last().map_or("", String::as_str);
        volume::write(&self.backing, &format!("volumes/{node}/data"), volume, self.sync)?;
        let mut all: Vec<(String, Value)> = known.into_iter().collect();
        all.extend(nodes.into_iter().filter(|(key, _)| root["consolidated_metadata"]["metadata"].get(key).is_none()));
        let mut root = zarr::group(sealed(root_about(held)));
        zarr::consolidate(&mut root, &all, SURFACES);
        put("zarr.json", &root)
    }
}

/// What an identity says of its partners, in short.
pub(super) fn coupling_text(identity: &Identity) -> String {
    let Some(coupling) = identity.scene.as_ref().and_then(|scene| scene.coupling.as_ref()) else {
        return "alone".into();
    };
    let partners: Vec<String> = coupling
        .partners
        .iter()
        .map(|p| {
            format!("{} ({}, tint {:?}, {:?})", p.name, p.volume.get(..16).unwrap_or(&p.volume), p.tint, p.isovalues)
        })
        .collect();
    format!("{}, tint {:?}, with {}", coupling.coupling, coupling.tint, partners.join(" and "))
}

/// Whether a volume of a store was baked among one of the identity, and the other way round.
pub(super) fn expects(store: &Store, identity: &Identity) -> bool {
    let of = |identity: &Identity| identity.scene.clone().and_then(|scene| scene.coupling);
    let (Some(ours), Some(theirs)) = (of(&store.identity), of(identity)) else { return false };
    let names = |own: &CouplingIdentity, other: &CouplingIdentity, identity: &Identity| {
        own.partners.iter().any(|p| {
            p.name == other.name && p.volume == identity.volume && p.solid == identity.solid && p.tint == other.tint
        })
    };
    let alike = ours.coupling == theirs.coupling && ours.partners.len() == theirs.partners.len();
    alike && names(&ours, &theirs, identity) && names(&theirs, &ours, &store.identity)
}

/// The nodes of the volumes that a root names.
pub(super) fn nodes_of_root(attributes: &Value) -> Result<Vec<String>> {
    let about = &attributes["isolume"];
    let legal = |name: &Value| name.as_str().filter(|n| *n == node_name(n)).map(str::to_owned);
    let nodes = match &about["volumes"] {
        Value::Null => legal(&about["volume"]).map(|node| vec![node]),
        Value::Array(list) => list.iter().map(legal).collect::<Option<Vec<_>>>(),
        _ => None,
    };
    nodes
        .filter(|nodes| nodes.first().is_some_and(|first| about["volume"] == **first))
        .filter(|nodes| nodes.iter().enumerate().all(|(i, node)| !nodes[..i].contains(node)))
        .ok_or_else(|| Error::format(FORMAT, "no name of a volume", "`volume`: a node name", METADATA_REMEDY))
}

/// The identity of a volume, and all else that its group says.
pub(super) fn read_identity(backing: &Backing, key: &str) -> Result<(Identity, Value)> {
    let group = required_json(backing, key)?;
    let in_file = |e: Error| e.in_file(backing.name(key));
    check_group(&group).map_err(in_file)?;
    let mut attributes = unsealed(&group).map_err(in_file)?;
    let identity = serde_json::from_value(attributes["identity"].take()).map_err(|e| {
        in_file(Error::format(FORMAT, format!("identity: {e}"), "the identity of a bake", METADATA_REMEDY))
    })?;
    Ok((identity, attributes))
}
