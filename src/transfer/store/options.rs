//! Making a store, or going on with one: what is torn in its metadata and samples is mended on the way.

use super::joint::{coupling_text, expects};
use super::metadata::{check_chunks, check_provenance, check_volume, node_name, nodes_of};
use super::{Identity, Store, lock, mend};
use crate::error::{Error, Result};
use crate::staging;
use crate::volume::Volume;
use serde_json::Value;
use std::path::Path;

/// How a store is made and written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct StoreOptions {
    /// Whether every write waits until the disk has it, in an order that a power cut cannot mix up. On at first; without
    /// it a power cut may tear chunks, which are then found damaged and baked again.
    pub sync: bool,
    /// Whether damaged metadata is written anew even where nothing that is left in the directory proves that it is a
    /// store of this volume with these settings.
    pub repair: bool,
}

impl Default for StoreOptions {
    fn default() -> Self {
        Self { sync: true, repair: false }
    }
}

impl StoreOptions {
    /// Writes synchronised, or left to the system.
    #[must_use]
    pub fn sync(self, sync: bool) -> Self {
        Self { sync, ..self }
    }

    /// See [`Self::repair`].
    #[must_use]
    #[doc(hidden)]
    pub fn repair(self, repair: bool) -> Self {
        Self { repair, ..self }
    }

    /// [`Store::create`] with these options.
    ///
    /// # Errors
    /// As there.
    #[doc(hidden)]
    pub fn create(
        self,
        path: impl AsRef<Path>,
        volume: &Volume,
        identity: &Identity,
        provenance: Value,
    ) -> Result<Store> {
        Store::create_with(path.as_ref(), volume, identity, provenance, self.sync)
    }

    /// [`Store::open_or_create`] with these options.
    ///
    /// # Errors
    /// As there.
    #[doc(hidden)]
    pub fn open_or_create(
        self,
        path: impl AsRef<Path>,
        volume: &Volume,
        identity: &Identity,
        provenance: Value,
    ) -> Result<Store> {
        let path = path.as_ref();
        if path.symlink_metadata().is_err() {
            // Of shares that begin at once the first makes the store, and writes the volume once; the others wait for it.
            let _making = if staging::folder_of(path).is_dir() { Some(lock::making(path)?) } else { None };
            if path.symlink_metadata().is_err() {
                return self.create(path, volume, identity, provenance);
            }
        }
        // Of shares that begin at once one mends, and the others find it mended.
        let _mending = if path.is_dir() { Some(lock::adding(path)?) } else { None };
        self.open_mended(path, volume, identity, provenance)
    }

    /// [`Store::open_or_add`] with these options.
    ///
    /// # Errors
    /// As there.
    #[doc(hidden)]
    pub fn open_or_add(
        self,
        path: impl AsRef<Path>,
        volume: &Volume,
        identity: &Identity,
        provenance: Value,
    ) -> Result<Store> {
        let path = path.as_ref();
        if path.symlink_metadata().is_err() {
            return self.open_or_create(path, volume, identity, provenance);
        }
        let node = node_name(&volume.name);
        let _adding = if path.is_dir() { Some(lock::adding(path)?) } else { None };
        // A root that can be read decides: a volume that it does not name was not added to the end.
        let (mut store, mut held) = match Store::open(path).and_then(|store| Ok((store.volumes()?, store))) {
            Ok((held, store)) if !held.contains(&node) => (store, held),
            Ok(_) | Err(Error::Format { .. }) => return self.open_mended(path, volume, identity, provenance),
            Err(other) => return Err(other),
        };
        store.sync = self.sync;
        // Whoever is there must know the new one as a partner, and how it is coupled.
        for name in &held {
            let other = store.of_volume(name)?;
            if !expects(&other, identity) {
                let stored = format!("{name} {}", coupling_text(other.identity()));
                let asked = format!("{} {}", volume.name, coupling_text(identity));
                let remedy = format!("give another output with -o, or --force to replace {}", path.display());
                return Err(Error::Mismatch { path: path.into(), field: "volumes".into(), stored, asked, remedy });
            }
        }
        let layout = identity.layout()?;
        check_chunks(&layout)?;
        check_volume(volume, identity)?;
        check_provenance(&provenance)?;
        store.directory()?;
        let nodes = nodes_of(volume, identity, &layout, provenance)?;
        held.push(node.clone());
        store.add(volume, &held, nodes)?;
        let mut store = store.of_volume(&node)?;
        store.sync = self.sync;
        Ok(store)
    }

    /// Whether the store at `path` describes how it was made, of this volume: then the provenance that is handed over
    /// with a bake that goes on is not needed.
    #[doc(hidden)]
    pub fn knows(path: impl AsRef<Path>, volume: &Volume) -> bool {
        mend::describes(path.as_ref(), &node_name(&volume.name))
    }

    /// Opens what is there, after mending its metadata and its samples from the volume given.
    fn open_mended(self, path: &Path, volume: &Volume, identity: &Identity, provenance: Value) -> Result<Store> {
        // What is packed does not follow from volume and identity: it is packed again, not mended.
        let is_packed = mend::is_packed(path, &node_name(&volume.name));
        let mended = match path.is_dir() && !is_packed {
            true => mend::mend(path, volume, identity, provenance, self)?,
            false => Vec::new(),
        };
        let mut store = Store::open(path)?;
        let node = node_name(&volume.name);
        if store.volumes()?.contains(&node) {
            store = store.of_volume(&node)?;
        }
        let held = store.node().to_owned();
        store.identity.check(identity, path, [&held, &node])?;
        (store.sync, store.mended) = (self.sync, mended);
        Ok(store)
    }
}
