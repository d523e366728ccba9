//! What is in a store.

use crate::error::Result;
use crate::file::size_on_disk;
use crate::transfer::store::{Completeness, Holdings, Store};
use crate::volume::Volume;
use serde_json::{Value, json};
use std::path::Path;

/// What is in a store.
pub struct StoreFacts {
    /// The store.
    pub store: Store,
    /// Its volume.
    pub volume: Volume,
    /// What was baked.
    pub held: Holdings,
    /// All its volumes.
    pub volumes: Vec<String>,
    /// Isovalues with transfer at the vertices of their surfaces, and how many those are.
    pub surfaces: Vec<(f64, u64)>,
    /// Chunks of the lattice and of all surfaces.
    pub chunks: usize,
    /// How many chunks were asked for and are there.
    pub complete: Completeness,
    /// Bytes on the disk.
    pub bytes: u64,
}

impl StoreFacts {
    /// Opens a store and looks at its records; with `maps` samples stay in the file that it may name.
    ///
    /// # Errors
    /// When there is no store, or it is damaged.
    pub fn of(path: &str, maps: bool) -> Result<Self> {
        let store = Store::open(path)?.map_samples(maps);
        let (held, volume) = (store.holdings()?, store.volume()?);
        let (mut surfaces, mut chunks) = (Vec::new(), store.layout().lattice.chunks().iter().product());
        for &isovalue in &held.surfaces {
            let Some(surface) = store.surface(isovalue)? else { continue };
            let lattice = surface.layout().lattice;
            surfaces.push((isovalue, lattice.texels()[0] as u64));
            chunks += lattice.chunks()[0];
        }
        let complete = Completeness::of(&store, &volume)?;
        let (volumes, bytes) = (store.volumes()?, size_on_disk(Path::new(path)));
        Ok(Self { store, volume, held, volumes, surfaces, chunks, complete, bytes })
    }

    /// For programs; `name` is that of the store.
    pub fn to_json(&self, name: &str) -> Value {
        let Self { store, held, complete, .. } = self;
        json!({
            "store": name, "volumes": self.volumes, "identity": store.identity(), "provenance": store.provenance(),
            "isovalues": held.isovalues_json(), "surfaces": held.surfaces, "chunks": held.chunks,
            "chunks_of_lattice": self.chunks, "chunks_asked": complete.needed, "chunks_complete": complete.there,
            "rays": held.rays, "error_targets": held.targets, "bytes": self.bytes, "packing": store.packing(),
            "samples_file": store.samples_file(),
        })
    }
}
