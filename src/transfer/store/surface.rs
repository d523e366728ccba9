//! The surfaces of a store: named isosurfaces with transfer at their vertices.
//!
//! `/surfaces/<volume>/<isovalue>` holds the mesh (`positions` in world, `positions_in_grid`, `normals`, `triangles`) and the
//! arrays of a transfer group, [vertex, …] where a texture has [z, y, x, …]; the groups of a scene lie below it. It is a
//! [`Store`] of its own whose texels are the vertices, and everything that holds for chunks of texels holds for those of
//! [`CHUNK_VERTICES`](crate::transfer::CHUNK_VERTICES) vertices. Their records name the mesh by its hash: transfer of another
//! mesh is never taken for its own.

use super::metadata::{
    HARMONICS, MEANING, MEANING_OF_CHANNELS, MEANING_OF_GROUPS, arrays, arrays_of, check_group, layers_about,
    packing_of, required_json, sealed, unsealed,
};
use super::zarr::{self, Array, CHECKSUM, Codec, FORMAT};
use super::{Backing, Filled, Identity, Store, lock};
use crate::error::{Error, Result};
use crate::geom::Affine;
use crate::surface::Mesh;
use crate::transfer::{Group, Lattice, Layout};
use bytemuck::Pod;
use glam::DVec3;
use serde_json::{Value, json};
use std::sync::OnceLock;

/// The folder of all surfaces.
pub(super) const SURFACES: &str = "surfaces";
/// Rows of a chunk of the mesh's arrays.
const ROWS: usize = 1 << 14;
/// Columns of the mesh's arrays.
const COLUMNS: usize = 3;
/// Names of the mesh's arrays.
const POSITIONS: &str = "positions";
const IN_GRID: &str = "positions_in_grid";
const NORMALS: &str = "normals";
const TRIANGLES: &str = "triangles";
/// What vertices lie on, where it is not the samples.
const ON_MODEL: &str = "model";

/// Which isosurface a store of vertices is of.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Mark {
    /// In the file's values.
    pub isovalue: f64,
    /// BLAKE3 of its mesh.
    pub mesh: String,
    triangles: usize,
    /// Whether its vertices lie on the model that the volume is samples of.
    on_model: bool,
}

/// The name of an isovalue as a node: the shortest decimal number that is it.
pub(super) fn node_of(isovalue: f64) -> String {
    let plain = (isovalue + 0.0).to_string();
    if plain.len() <= 32 { plain } else { format!("{isovalue:e}") }
}

/// BLAKE3 of what decides where the vertices are and how they are joined.
fn hash_of_mesh(mesh: &Mesh) -> String {
    let mut hash = blake3::Hasher::new();
    for count in [mesh.positions_in_grid.len(), mesh.triangles.len()] {
        hash.update(&(count as u64).to_le_bytes());
    }
    hash.update(bytemuck::cast_slice(&mesh.positions_in_grid));
    hash.update(bytemuck::cast_slice(&mesh.normals));
    hash.update(bytemuck::cast_slice(&mesh.triangles));
    hash.finalize().to_hex().to_string()
}

/// Refuses a mesh that none of its readers could take: what it found and what is right.
fn check_mesh(mesh: &Mesh) -> std::result::Result<(), (String, String)> {
    let count = mesh.positions_in_grid.len();
    if mesh.normals.len() != count {
        return Err((format!("{} normals", mesh.normals.len()), format!("{count}, one a vertex")));
    }
    if let Some(wrong) = mesh.positions_in_grid.iter().chain(&mesh.normals).find(|v| v.iter().any(|x| !x.is_finite())) {
        return Err((format!("{wrong:?}"), "finite positions and normals".into()));
    }
    match mesh.triangles.iter().find(|t| t.iter().any(|&v| v as usize >= count)) {
        Some(wrong) => Err((format!("a triangle of the vertices {wrong:?}"), format!("numbers below {count}"))),
        None => Ok(()),
    }
}

/// An array of the mesh.
fn array(name: &str, rows: usize) -> Array {
    let (data_type, fill) = if name == TRIANGLES { ("uint32", json!(0)) } else { ("float32", json!(0.0)) };
    let first = if name == TRIANGLES { "triangle" } else { "vertex" };
    Array {
        shape: vec![rows, COLUMNS],
        chunk: vec![ROWS, COLUMNS],
        inner: None,
        data_type,
        fill,
        names: vec![first, if name == TRIANGLES { "corner" } else { "xyz" }],
        codec: Codec::Plain,
    }
}

/// The files of an array of the mesh, key by key.
fn files<T: Pod>(key: &str, rows: &[[T; COLUMNS]]) -> Vec<(String, Vec<u8>)> {
    let chunk = |(i, rows): (usize, &[[T; COLUMNS]])| {
        let mut bytes: Vec<u8> = bytemuck::cast_slice(rows).to_vec();
        bytes.resize(ROWS * COLUMNS * size_of::<T>(), 0);
        bytes.extend(zarr::checksum(&bytes).to_le_bytes());
        (zarr::chunk_key(key, &[i, 0]), bytes)
    };
    rows.chunks(ROWS).enumerate().map(chunk).collect()
}

/// Reads an array of the mesh.
fn rows<T: Pod>(backing: &Backing, key: &str, count: usize) -> Result<Vec<[T; COLUMNS]>> {
    let expected = ROWS * COLUMNS * size_of::<T>() + CHECKSUM;
    let mut all: Vec<[T; COLUMNS]> = Vec::new();
    for i in 0..count.div_ceil(ROWS) {
        let file = zarr::chunk_key(key, &[i, 0]);
        let damaged = |found: String, expected: String| {
            let remedy = "run the bake that made the store again: it makes the mesh anew from the volume";
            Error::format(FORMAT, found, expected, remedy).in_file(backing.name(&file))
        };
        let Some(bytes) = backing.bytes(&file)? else {
            return Err(damaged("no such file".into(), "a part of the mesh".into()));
        };
        if bytes.len() != expected {
            return Err(damaged(format!("{} bytes", bytes.len()), format!("{expected} bytes")));
        }
        let (payload, stored) = bytes.split_at(expected - CHECKSUM);
        let (found, stored) = (zarr::checksum(payload), zarr::little_u32(stored));
        if found != stored {
            return Err(damaged(format!("bytes with crc32c {found:08x}"), format!("crc32c {stored:08x}")));
        }
        let here: &[[T; COLUMNS]] = bytemuck::try_cast_slice(payload)
            .map_err(|e| damaged(e.to_string(), "numbers that are aligned in memory".into()))?;
        all.extend_from_slice(&here[..ROWS.min(count - i * ROWS)]);
    }
    Ok(all)
}

/// The metadata of a surface and of all that lies below it.
fn nodes_of_surface(
    place: &str,
    mark: &Mark,
    vertices: usize,
    identity: &Identity,
    layout: &Layout,
) -> Result<Vec<(String, Value)>> {
    let layers = &layout.layers;
    let mut attributes = json!({
        "identity_blake3": identity.hash(),
        "isovalue": mark.isovalue,
        "vertices": vertices,
        "triangles": mark.triangles,
        "mesh_blake3": mark.mesh,
        "layers": layers_about(layers),
        "spherical_harmonics": HARMONICS,
        "meaning": MEANING,
    });
    if layers.channels() != 1 {
        attributes["channels"] = json!(MEANING_OF_CHANNELS);
    }
    if mark.on_model {
        attributes["vertices_on"] = json!(ON_MODEL);
    }
    let mut nodes = vec![(place.to_owned(), zarr::group(sealed(attributes)))];
    for (name, rows) in [(POSITIONS, vertices), (IN_GRID, vertices), (NORMALS, vertices), (TRIANGLES, mark.triangles)] {
        nodes.push((format!("{place}/{name}"), array(name, rows).metadata(json!({}))));
    }
    for (name, array) in arrays(layout) {
        nodes.push((format!("{place}/{name}"), array.metadata(json!({}))));
    }
    for group in identity.groups().iter().skip(1) {
        let place = format!("{place}/{}", group.node());
        let attributes = sealed(json!({ "identity_blake3": identity.hash(), "meaning": MEANING_OF_GROUPS }));
        nodes.push((place.clone(), zarr::group(attributes)));
        for (name, array) in arrays(&group.layout(layout)?) {
            nodes.push((format!("{place}/{name}"), array.metadata(json!({}))));
        }
    }
    Ok(nodes)
}

/// What a surface says of itself: its mark and its number of vertices.
fn read_mark(backing: &Backing, place: &str, identity_hash: &str) -> Result<(Mark, usize)> {
    let key = format!("{place}/zarr.json");
    let in_file = |e: Error| e.in_file(backing.name(&key));
    let group = required_json(backing, &key)?;
    check_group(&group).map_err(in_file)?;
    let attributes = unsealed(&group).map_err(in_file)?;
    let number = |name: &str| attributes[name].as_u64().filter(|&n| n < 1 << 32).map(|n| n as usize);
    let text = |name: &str| attributes[name].as_str().map(str::to_owned);
    let parts =
        attributes["isovalue"].as_f64().zip(text("mesh_blake3")).zip(number("vertices").zip(number("triangles")));
    let remedy = "run the bake that made the store again: it makes the surface anew";
    let Some(((isovalue, mesh), (vertices, triangles))) = parts else {
        let found = "attributes without isovalue, vertices, triangles or mesh";
        return Err(in_file(Error::format(FORMAT, found, "those of a surface", remedy)));
    };
    if text("identity_blake3").as_deref() != Some(identity_hash) {
        let found = format!("a surface of another store, {}", zarr::shorten(&attributes["identity_blake3"]));
        return Err(in_file(Error::format(FORMAT, found, format!("that of {identity_hash}"), remedy)));
    }
    let on_model = attributes["vertices_on"] == ON_MODEL;
    Ok((Mark { isovalue, mesh, triangles, on_model }, vertices))
}

impl Store {
    /// The place of the surfaces of its volume.
    fn surfaces_key(&self) -> String {
        format!("{SURFACES}/{}", self.node())
    }

    /// The isovalues of the surfaces that it holds, ascending, in the file's values; some may be incomplete. None of a
    /// store that is a surface or a group itself.
    ///
    /// # Errors
    /// When a surface is damaged.
    pub fn surfaces(&self) -> Result<Vec<f64>> {
        if self.surface.is_some() || self.group != Group::Environment {
            return Ok(Vec::new());
        }
        let folder = self.surfaces_key();
        let mut found = Vec::new();
        for name in self.backing.folders(&folder) {
            let (mark, _) = read_mark(&self.backing, &format!("{folder}/{name}"), &self.identity_hash)?;
            found.push(mark.isovalue);
        }
        found.sort_by(f64::total_cmp);
        Ok(found)
    }

    /// The surface of an isovalue, as a store of its own whose texels are the vertices; `None` if there is none.
    ///
    /// # Errors
    /// When it is damaged.
    pub fn surface(&self, isovalue: f64) -> Result<Option<Self>> {
        let place = self.place_of(isovalue);
        if self.surface.is_some() || !self.backing.exists(&format!("{place}/zarr.json")) {
            return Ok(None);
        }
        let (mark, vertices) = read_mark(&self.backing, &place, &self.identity_hash)?;
        if mark.isovalue != isovalue {
            let (found, remedy) = (format!("the isovalue {}", mark.isovalue), "run the bake again");
            return Err(Error::format(FORMAT, found, isovalue.to_string(), remedy).in_file(self.backing.name(&place)));
        }
        self.open_surface(place, mark, vertices).map(Some)
    }

    fn open_surface(&self, place: String, mark: Mark, vertices: usize) -> Result<Self> {
        let layout = Layout { lattice: Lattice::of_vertices(vertices), layers: self.layout.layers.clone() };
        let packing = packing_of(&self.backing, &place, &layout.layers)?;
        for (name, array) in arrays_of(&layout, packing.as_ref()) {
            let key = format!("{place}/{name}/zarr.json");
            array.check(&required_json(&self.backing, &key)?).map_err(|e| e.in_file(self.backing.name(&key)))?;
        }
        let chunks: usize = layout.lattice.chunks().iter().product();
        Ok(Self {
            backing: self.backing.again()?,
            identity: self.identity.clone(),
            identity_hash: self.identity_hash.clone(),
            provenance: self.provenance.clone(),
            data: self.data.clone(),
            sync: self.sync,
            mended: Vec::new(),
            env: place,
            chunks: std::iter::repeat_with(OnceLock::new).take(chunks).collect(),
            // Vertices are all baked.
            filled: Filled::new(0),
            layout,
            group: Group::Environment,
            surface: Some(mark),
            packing,
            turns: Default::default(),
        })
    }

    /// The isovalue of a store that is a surface.
    pub fn isovalue(&self) -> Option<f64> {
        self.surface.as_ref().map(|mark| mark.isovalue)
    }

    /// Whether it is a surface whose vertices lie on the model that the volume is samples of.
    #[doc(hidden)]
    pub fn is_on_model(&self) -> bool {
        self.surface.as_ref().is_some_and(|mark| mark.on_model)
    }

    /// The mesh of a store that is a surface: `None` of one that is not.
    ///
    /// # Errors
    /// When it is damaged.
    #[doc(hidden)]
    pub fn mesh(&self) -> Result<Option<Mesh>> {
        let Some(mark) = &self.surface else { return Ok(None) };
        let vertices = self.layout.lattice.texels()[0];
        let key = |name: &str| format!("{}/{name}", self.env);
        let mesh = Mesh {
            positions_in_grid: rows(&self.backing, &key(IN_GRID), vertices)?,
            normals: rows(&self.backing, &key(NORMALS), vertices)?,
            triangles: rows(&self.backing, &key(TRIANGLES), mark.triangles)?,
        };
        let found = hash_of_mesh(&mesh);
        if found != mark.mesh {
            let remedy = "run the bake that made the store again: it makes the mesh anew from the volume";
            let (found, expected) = (format!("a mesh with BLAKE3 {found}"), format!("BLAKE3 {}", mark.mesh));
            return Err(Error::format(FORMAT, found, expected, remedy).in_file(self.backing.name(&self.env)));
        }
        // A hash only says that it is what was written.
        check_mesh(&mesh).map_err(|(found, expected)| {
            let remedy = "run the bake that made the store again: it makes the mesh anew from the volume";
            Error::format(FORMAT, found, expected, remedy).in_file(self.backing.name(&self.env))
        })?;
        Ok(Some(mesh))
    }

    /// Opens the surface of an isovalue to fill it, or makes it if there is none. `mesh`: the isosurface, with normals, in the
    /// order of [`Mesh::in_morton_order`]; `world_from_grid`: that of the volume; `on_model`: whether vertices lie on the model
    /// that the volume is samples of. What is damaged of a mesh that is there is written anew.
    ///
    /// # Errors
    /// [`Error::Mismatch`] when the surface that is there has another mesh; when the isovalue is not finite or the mesh has other
    /// than one normal a vertex, numbers that are not finite, or triangles of vertices that are not there; when the store is a
    /// surface itself or an archive, or the system refuses.
    #[doc(hidden)]
    pub fn open_or_add_surface(
        &self,
        isovalue: f64,
        mesh: &Mesh,
        world_from_grid: &Affine,
        on_model: bool,
    ) -> Result<Self> {
        self.check_surface(isovalue, mesh)?;
        let (root, vertices) = (self.directory()?.path().to_owned(), mesh.positions_in_grid.len());
        let (place, mark) = self.mark_of(isovalue, mesh, on_model);
        let _adding = if self.packing.is_none() { Some(lock::adding(&root)?) } else { None };
        self.check_mark(&place, &mark)?;
        if self.packing.is_some() {
            return self.open_surface(place, mark, vertices);
        }
        let layout = Layout { lattice: Lattice::of_vertices(vertices), layers: self.layout.layers.clone() };
        let mut nodes: Vec<(String, Value)> =
            [SURFACES.to_owned(), self.surfaces_key()].map(|key| (key, zarr::group(json!({})))).into();
        nodes.extend(nodes_of_surface(&place, &mark, vertices, &self.identity, &layout)?);
        let to_world = |p: &[f32; 3]| world_from_grid.point(DVec3::from_array(p.map(f64::from))).as_vec3().to_array();
        let world: Vec<[f32; 3]> = mesh.positions_in_grid.iter().map(to_world).collect();
        let key = |name: &str| format!("{place}/{name}");
        let parts = [files(&key(POSITIONS), &world), files(&key(IN_GRID), &mesh.positions_in_grid)];
        let more = [files(&key(NORMALS), &mesh.normals), files(&key(TRIANGLES), &mesh.triangles)];
        // The group's own metadata last: a surface is there when that is.
        for (file, bytes) in parts.iter().chain(&more).flatten() {
            self.put_if_other(file, bytes)?;
        }
        for (key, value) in nodes.iter().rev() {
            self.put_if_other(&format!("{key}/zarr.json"), format!("{value:#}\n").as_bytes())?;
        }
        self.consolidate(nodes)?;
        self.open_surface(place, mark, vertices)
    }

    /// Refuses what [`Self::open_or_add_surface`] would refuse of one of several surfaces: before the first of them is added, as a
    /// store that holds some of them on the model and some on its samples takes neither.
    ///
    /// # Errors
    /// As it does.
    pub(crate) fn check_surfaces<'m>(
        &self,
        surfaces: impl IntoIterator<Item = (f64, &'m Mesh)>,
        on_model: bool,
    ) -> Result<()> {
        for (isovalue, mesh) in surfaces {
            self.check_surface(isovalue, mesh)?;
            let (place, mark) = self.mark_of(isovalue, mesh, on_model);
            self.check_mark(&place, &mark)?;
        }
        Ok(())
    }

    /// The same of all surfaces of another store.
    pub(super) fn check_surfaces_of(&self, other: &Self) -> Result<()> {
        for isovalue in other.surfaces()? {
            if let Some(mark) = other.surface(isovalue)?.and_then(|theirs| theirs.surface) {
                self.check_mark(&self.place_of(isovalue), &mark)?;
            }
        }
        Ok(())
    }

    fn place_of(&self, isovalue: f64) -> String {
        format!("{}/{}", self.surfaces_key(), node_of(isovalue))
    }

    fn mark_of(&self, isovalue: f64, mesh: &Mesh, on_model: bool) -> (String, Mark) {
        let mark = Mark { isovalue, mesh: hash_of_mesh(mesh), triangles: mesh.triangles.len(), on_model };
        (self.place_of(isovalue), mark)
    }

    /// Refuses what is no surface of this store.
    fn check_surface(&self, isovalue: f64, mesh: &Mesh) -> Result<()> {
        if !isovalue.is_finite() {
            return Err(Error::argument(
                "isovalue",
                isovalue,
                "a finite number",
                "give one in the range of the volume",
            ));
        }
        if self.surface.is_some() || self.group != Group::Environment {
            let expected = "the store of a volume";
            return Err(Error::argument("store", "a surface or a group of a store", expected, "take the store itself"));
        }
        check_mesh(mesh).map_err(|(found, expected)| {
            Error::argument("mesh", found, expected, "extract it with surface::isosurface")
        })
    }

    /// Refuses a surface where another mesh is there, or where none is and the store is packed.
    fn check_mark(&self, place: &str, mark: &Mark) -> Result<()> {
        let found = match read_mark(&self.backing, place, &self.identity_hash) {
            Ok((found, _)) if found == *mark => return Ok(()),
            Ok((found, _)) => Some(found),
            Err(Error::Format { .. } | Error::Limit { .. }) => None,
            Err(other) => return Err(other),
        };
        self.check_not_packed()?;
        let Some(found) = found else { return Ok(()) };
        let (root, path) = (self.path().display(), self.backing.name(place));
        if found.on_model != mark.on_model {
            let text = |mark: &Mark| if mark.on_model { "on the model" } else { "on its samples" };
            let same = if mark.on_model { "leave out" } else { "give" };
            return Err(Error::Mismatch {
                path,
                field: "vertices".into(),
                stored: text(&found).into(),
                asked: text(mark).into(),
                remedy: format!("{same} --exact-vertices, give another output with -o, or --force to replace {root}"),
            });
        }
        let text = |mark: &Mark| format!("{} triangles, BLAKE3 {}", mark.triangles, zarr::shorten(&json!(mark.mesh)));
        Err(Error::Mismatch {
            path,
            field: "mesh".into(),
            stored: text(&found),
            asked: text(mark),
            remedy: format!("another version made it: give another output with -o, or --force to replace {root}"),
        })
    }

    /// Writes a file unless it holds these bytes already.
    fn put_if_other(&self, key: &str, bytes: &[u8]) -> Result<()> {
        match self.backing.bytes(key)? {
            Some(found) if *found == *bytes => Ok(()),
            _ => self.backing.put(key, self.sync, bytes),
        }
    }

    /// Adds nodes to what the root repeats for readers of Zarr.
    fn consolidate(&self, nodes: Vec<(String, Value)>) -> Result<()> {
        let mut root = required_json(&self.backing, "zarr.json")?;
        let known = root["consolidated_metadata"]["metadata"].as_object().cloned().unwrap_or_default();
        if nodes.iter().all(|(key, value)| known.get(key) == Some(value)) {
            return Ok(());
        }
        let is_new = |key: &String| nodes.iter().all(|(new, _)| new != key);
        let mut all: Vec<(String, Value)> = known.into_iter().filter(|(key, _)| is_new(key)).collect();
        all.extend(nodes);
        zarr::consolidate(&mut root, &all, SURFACES);
        self.backing.put("zarr.json", self.sync, format!("{root:#}\n").as_bytes())
    }
}

/// A node of a surface as it is where the surface, or a group of it, is packed: groups say so, and have other arrays.
fn as_packed(
    backing: &Backing,
    key: String,
    mut value: Value,
    layout: &Layout,
    identity: &Identity,
) -> Result<Vec<(String, Value)>> {
    let (above, name) = key.rsplit_once('/').unwrap_or_default();
    if value["node_type"] == "group" {
        let stored = required_json(backing, &format!("{key}/zarr.json"))?["attributes"]["packing"].take();
        if !stored.is_null() {
            let mut attributes = unsealed(&value)?;
            attributes["packing"] = stored;
            value["attributes"] = sealed(attributes);
        }
        return Ok(vec![(key, value)]);
    }
    let of_group = identity.groups().into_iter().skip(1).find(|group| above.ends_with(&format!("/{}", group.node())));
    let layout = of_group.map_or_else(|| Ok(layout.clone()), |group| group.layout(layout))?;
    let is_of_mesh = [POSITIONS, IN_GRID, NORMALS, TRIANGLES].contains(&name);
    match if is_of_mesh { None } else { packing_of(backing, above, &layout.layers)? } {
        None => Ok(vec![(key, value)]),
        // All at once in the place of the first.
        Some(packing) if name == "transfer" => {
            let arrays = arrays_of(&layout, Some(&packing)).into_iter();
            Ok(arrays.map(|(name, array)| (format!("{above}/{name}"), array.metadata(json!({})))).collect())
        }
        Some(_) => Ok(Vec::new()),
    }
}

/// The metadata that all surfaces of a volume should have, in the order of their names, after what they say of themselves.
fn expected_nodes(backing: &Backing, node: &str, identity: &Identity) -> Result<Vec<(String, Value)>> {
    let folder = format!("{SURFACES}/{node}");
    let names = backing.folders(&folder);
    if names.is_empty() {
        return Ok(Vec::new());
    }
    let layers = identity.layout()?.layers;
    let mut nodes: Vec<(String, Value)> =
        [SURFACES.to_owned(), folder.clone()].map(|key| (key, zarr::group(json!({})))).into();
    for name in names {
        let place = format!("{folder}/{name}");
        let (mark, vertices) = read_mark(backing, &place, &identity.hash())?;
        let layout = Layout { lattice: Lattice::of_vertices(vertices), layers: layers.clone() };
        for (key, value) in nodes_of_surface(&place, &mark, vertices, identity, &layout)? {
            nodes.extend(as_packed(backing, key, value, &layout, identity)?);
        }
    }
    Ok(nodes)
}

/// The metadata of all surfaces of a volume as they stand on the disk, in the order of their names.
pub(super) fn nodes_on_disk(backing: &Backing, node: &str, identity: &Identity) -> Result<Vec<(String, Value)>> {
    let keys = expected_nodes(backing, node, identity)?.into_iter().map(|(key, _)| key);
    keys.map(|key| Ok((key.clone(), required_json(backing, &format!("{key}/zarr.json"))?))).collect()
}

/// Metadata files of the surfaces of a volume that are not what these say of themselves.
pub(super) fn wrong_nodes(backing: &Backing, node: &str, identity: &Identity) -> Result<Vec<String>> {
    let expected = match expected_nodes(backing, node, identity) {
        // It is counted as damage of the surface.
        Err(Error::Format { .. } | Error::Limit { .. }) => return Ok(Vec::new()),
        expected => expected?,
    };
    let mut wrong = Vec::new();
    for (key, value) in expected {
        let file = format!("{key}/zarr.json");
        match backing.json(&file) {
            Ok(Some(found)) if found == value => {}
            Ok(_) | Err(Error::Format { .. } | Error::Limit { .. }) => wrong.push(file),
            Err(other) => return Err(other),
        }
    }
    Ok(wrong)
}
