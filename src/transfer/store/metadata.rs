//! The metadata of a store: what stands in the `zarr.json` of each group and array, sealed with hashes, and what is
//! asked of it when it is read.

use super::backing::Backing;
use super::chunk::ARRAYS;
use super::identity::{FORMAT_VERSION, Identity, OLDEST_FORMAT_VERSION};
use super::packed::{self, Packing};
use super::surface::SURFACES;
use super::zarr::{self, Array, Codec, FORMAT, METADATA_REMEDY};
use super::{joint, volume};
use crate::error::{Error, Result};
use crate::transfer::{Layers, Layout};
use crate::volume::Volume;
use serde_json::{Value, json};

/// Most chunks a store may have: 161 times 32 texels along each axis. Each costs 16 bytes when a
/// store is opened.
pub(super) const MOST_CHUNKS: usize = 1 << 22;
/// Longest provenance in bytes of JSON; readers take metadata files of up to 64 MiB, and the
/// root repeats it.
pub(super) const LONGEST_PROVENANCE: usize = 8 << 20;
/// Stated in every store for readers without this program.
pub(super) const HARMONICS: &str = "real, orthonormal spherical harmonics in world axes without the Condon-Shortley sign: \
    Y_1,-1 = 0.488603 y, Y_1,0 = 0.488603 z, Y_1,1 = 0.488603 x; coefficient i = l(l+1)+m of degree l and order m";
/// Stated in every store for readers without this program.
pub(super) const MEANING: &str = "exitant radiance of the Lambertian level set through a texel under L(w) = sum_i L_i Y_i(w) is \
    sum_k albedo^(k+1) <T_k, L>; layer k of the last axis of `transfer` starts at layers[k].offset";

/// Stated in stores of scenes.
pub(super) const MEANING_OF_CHANNELS: &str = "each layer holds its bands^2 red coefficients, then green, then blue";
/// Stated in the groups of luminaires.
pub(super) const MEANING_OF_GROUPS: &str = "the level set of albedo rho sends out sum_k rho^(k+1) G_k in W m-2 sr-1 on behalf of \
    this group; the last axis of `transfer` is 3 k + channel (red, green, blue)";

/// The arrays of the transfer group, in the order of [`ARRAYS`].
pub(super) fn arrays(layout: &Layout) -> [(&'static str, Array); 4] {
    let lattice = layout.lattice;
    // Slowest first; vertices have one axis.
    let axes = |[x, y, z]: [usize; 3]| if lattice.is_of_vertices() { vec![x] } else { vec![z, y, x] };
    let names = if lattice.is_of_vertices() { vec!["vertex"] } else { vec!["z", "y", "x"] };
    let array = |data_type, fill, last: Option<(usize, &'static str)>| {
        let extended = |shape| axes(shape).into_iter().chain(last.map(|(n, _)| n)).collect();
        Array {
            shape: extended(lattice.texels()),
            chunk: extended(lattice.chunk_shape()),
            inner: Some(extended(lattice.brick_shape())),
            data_type,
            fill,
            names: names.iter().copied().chain(last.map(|(_, name)| name)).collect(),
            codec: Codec::Plain,
        }
    };
    let arrays = [
        array("float16", json!("NaN"), Some((layout.layers.coefficients(), "coefficient"))),
        array("float16", json!("NaN"), Some((layout.layers.errors(), "layer_band"))),
        array("uint8", json!(0), None),
        array("uint32", json!(0), None),
    ];
    let mut names = ARRAYS.into_iter();
    arrays.map(|array| (names.next().map_or("", |(name, _)| name), array))
}

/// The arrays of a group as they stand on the disk: packed or not.
pub(super) fn arrays_of(layout: &Layout, packing: Option<&Packing>) -> Vec<(&'static str, Array)> {
    if packing.is_some() { packed::arrays(layout) } else { arrays(layout).into() }
}

/// How a group was packed, by its own metadata; `None` where it was not, or says nothing that can be read.
pub(super) fn packing_of(backing: &Backing, place: &str, layers: &Layers) -> Result<Option<Packing>> {
    let key = format!("{place}/zarr.json");
    let in_file = |e: Error| e.in_file(backing.name(&key));
    let group = required_json(backing, &key)?;
    // The attributes are verified where a packing is read, and else where they are used.
    if group["attributes"]["packing"].is_null() {
        return Ok(None);
    }
    packed::from_attributes(&unsealed(&group).map_err(in_file)?, layers).map_err(in_file)
}

/// Writes everything of a store but its chunks.
pub(super) fn write_skeleton(
    backing: &Backing,
    volume: &Volume,
    identity: &Identity,
    layout: &Layout,
    provenance: Value,
) -> Result<()> {
    let node = node_name(&volume.name);
    let nodes = nodes_of(volume, identity, layout, provenance)?;
    let mut root = zarr::group(sealed(root_about(std::slice::from_ref(&node))));
    zarr::consolidate(&mut root, &nodes, SURFACES);
    let put = |key: &str, value: &Value| backing.put(key, false, format!("{value:#}\n").as_bytes());
    put("zarr.json", &root)?;
    for (key, value) in &nodes {
        put(&format!("{key}/zarr.json"), value)?;
    }
    volume::write(backing, &format!("volumes/{node}/data"), volume, false)
}

/// What is said of each layer: its bands, and where it starts in transfer and errors.
pub(super) fn layers_about(layers: &Layers) -> Value {
    let layer = |k: usize| json!({ "bands": layers.bands()[k], "offset": layers.offset(k), "stderr_offset": layers.error_offset(k) });
    (0..layers.len()).map(layer).collect()
}

/// What the root says of the volumes in the store.
pub(super) fn root_about(nodes: &[String]) -> Value {
    let mut about = json!({ "format_version": FORMAT_VERSION, "volume": nodes.first() });
    if nodes.len() > 1 {
        about["volumes"] = json!(nodes);
    }
    json!({ "isolume": about })
}

/// The metadata of all groups and arrays of a volume, with the groups that hold them.
pub(super) fn nodes_of(
    volume: &Volume,
    identity: &Identity,
    layout: &Layout,
    provenance: Value,
) -> Result<Vec<(String, Value)>> {
    let node = node_name(&volume.name);
    let layers = &layout.layers;
    let step = std::array::from_fn(|axis| layout.lattice.step(axis));
    let mut attributes = json!({
        "identity": identity,
        "identity_blake3": identity.hash(),
        "layers": layers_about(layers),
        "spherical_harmonics": HARMONICS,
        "meaning": MEANING,
        "world_from_texel": volume::rows(volume.world_from_grid(), step),
        "provenance": provenance,
    });
    if layers.channels() != 1 {
        attributes["channels"] = json!(MEANING_OF_CHANNELS);
    }
    let attributes = sealed(attributes);
    let mut nodes = vec![
        ("volumes".into(), zarr::group(json!({}))),
        (format!("volumes/{node}"), zarr::group(json!({}))),
        (format!("volumes/{node}/data"), volume::metadata(volume)?),
        ("transfer".into(), zarr::group(json!({}))),
        (format!("transfer/{node}"), zarr::group(json!({}))),
        (format!("transfer/{node}/env"), zarr::group(attributes)),
    ];
    for (name, array) in arrays(layout) {
        nodes.push((format!("transfer/{node}/env/{name}"), array.metadata(json!({}))));
    }
    for group in identity.groups().iter().skip(1) {
        let place = format!("transfer/{node}/{}", group.node());
        let attributes = sealed(json!({ "identity_blake3": identity.hash(), "meaning": MEANING_OF_GROUPS }));
        nodes.push((place.clone(), zarr::group(attributes)));
        for (name, array) in arrays(&group.layout(layout)?) {
            nodes.push((format!("{place}/{name}"), array.metadata(json!({}))));
        }
    }
    Ok(nodes)
}

/// The keys of [`nodes_of`], in its order.
pub(super) fn node_keys(backing: &Backing, node: &str, identity: &Identity, layout: &Layout) -> Result<Vec<String>> {
    let above = ["volumes".into(), format!("volumes/{node}"), format!("volumes/{node}/data"), "transfer".into()];
    let mut keys: Vec<String> = above.into_iter().chain([format!("transfer/{node}")]).collect();
    for group in identity.groups() {
        let place = format!("transfer/{node}/{}", group.node());
        let layout = group.layout(layout)?;
        let packing = packing_of(backing, &place, &layout.layers)?;
        let names: Vec<String> =
            arrays_of(&layout, packing.as_ref()).iter().map(|(name, _)| format!("{place}/{name}")).collect();
        keys.push(place);
        keys.extend(names);
    }
    Ok(keys)
}

/// The name of a volume as a node of the hierarchy: letters, digits, `-`, `_` and `.` stay,
/// anything else becomes `_`; no leading `.` or `__`, at most 64 characters.
pub(super) fn node_name(name: &str) -> String {
    let keep = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let name: String = name.chars().map(keep).take(64).collect();
    if name.is_empty() || name.starts_with('.') || name.starts_with("__") {
        return node_name(&format!("volume{name}"));
    }
    name
}

/// BLAKE3 of a JSON value with its keys sorted and without spaces.
pub(super) fn hash_of(value: &Value) -> blake3::Hash {
    let mut sorted = value.clone();
    sorted.sort_all_objects();
    blake3::hash(sorted.to_string().as_bytes())
}

/// Attributes with their own hash added as `blake3`.
pub(super) fn sealed(mut attributes: Value) -> Value {
    attributes["blake3"] = json!(hash_of(&attributes).to_hex().as_str());
    attributes
}

/// The attributes of a node without their hash, which is compared.
pub(super) fn unsealed(metadata: &Value) -> Result<Value> {
    let mut attributes = metadata.get("attributes").cloned().unwrap_or_default();
    let stored = attributes.as_object_mut().and_then(|fields| fields.shift_remove("blake3")).unwrap_or_default();
    let found = json!(hash_of(&attributes).to_hex().as_str());
    if found == stored {
        return Ok(attributes);
    }
    let (found, expected) = (format!("attributes with BLAKE3 {found}"), format!("BLAKE3 {}", zarr::shorten(&stored)));
    Err(Error::format(FORMAT, found, expected, METADATA_REMEDY))
}

/// A JSON document that must be there.
pub(super) fn required_json(backing: &Backing, key: &str) -> Result<Value> {
    backing.json(key)?.ok_or_else(|| {
        Error::format(FORMAT, "no such file", "the metadata of a part of the store", METADATA_REMEDY)
            .in_file(backing.name(key))
    })
}

/// Checks the root and returns the node names of the volumes: at least one.
pub(super) fn open_root(backing: &Backing) -> Result<Vec<String>> {
    let foreign = |found: &str| {
        let expected = "a store made by isolume (the directory that holds its zarr.json, or a zip of it)";
        Error::format(FORMAT, found, expected, "give the path of a store, or bake one").in_file(backing.path())
    };
    let Some(root) = backing.json("zarr.json")? else {
        let old = backing.exists(".zgroup") || backing.exists(".zarray");
        return Err(foreign(if old { "Zarr data of version 2" } else { "no zarr.json inside" }));
    };
    let in_file = |e: Error| e.in_file(backing.name("zarr.json"));
    if root["node_type"] == "array" {
        return Err(foreign("a Zarr array"));
    }
    check_group(&root).map_err(in_file)?;
    if root["attributes"]["isolume"].is_null() {
        return Err(foreign("a Zarr hierarchy that another program made"));
    }
    check_version(&root["attributes"]["isolume"]["format_version"]).map_err(in_file)?;
    let attributes = unsealed(&root).map_err(in_file)?;
    joint::nodes_of_root(&attributes).map_err(in_file)
}

pub(super) fn check_group(metadata: &Value) -> Result<()> {
    if metadata["zarr_format"] == 3 && metadata["node_type"] == "group" {
        return Ok(());
    }
    let found = format!("zarr_format {}, node_type {}", metadata["zarr_format"], metadata["node_type"]);
    Err(Error::format(FORMAT, found, "a Zarr group of version 3", METADATA_REMEDY))
}

pub(super) fn check_version(found: &Value) -> Result<()> {
    let known = u64::from(OLDEST_FORMAT_VERSION)..=u64::from(FORMAT_VERSION);
    if found.as_u64().is_some_and(|version| known.contains(&version)) {
        return Ok(());
    }
    let found = format!("format version {}", zarr::shorten(found));
    let remedy = "use the version of isolume that made the store, or bake again into another path";
    let expected = format!("a format version from {OLDEST_FORMAT_VERSION} to {FORMAT_VERSION}");
    Err(Error::format(FORMAT, found, expected, remedy))
}

/// The number of chunks of a layout, if it is not too large.
pub(super) fn check_chunks(layout: &Layout) -> Result<usize> {
    let count = layout.lattice.chunks().into_iter().try_fold(1usize, usize::checked_mul);
    count.filter(|&count| count <= MOST_CHUNKS).ok_or_else(|| Error::Limit {
        what: format!("a texture of {:?} texels", layout.lattice.texels()),
        needed: count.map_or_else(|| "more chunks than can be counted".into(), |n| format!("{n} chunks")),
        limit: format!("{MOST_CHUNKS} chunks of 32³ texels"),
        remedy: "use fewer texels".into(),
    })
}

/// Whether an identity belongs to a volume and to this format.
pub(super) fn check_volume(volume: &Volume, identity: &Identity) -> Result<()> {
    let layout = identity.layout()?;
    let here = Identity::new(volume, &layout, identity.estimator.clone(), identity.positive, identity.seed);
    let (scene, revision, adaptive) = (identity.scene.clone(), identity.revision, identity.adaptive);
    let here = Identity { grid: volume.dims(), scene, revision, adaptive, ..here };
    match identity.first_difference(&here) {
        None => Ok(()),
        Some((field, given, expected)) => Err(Error::argument(
            format!("identity.{field}"),
            given,
            format!("{expected}, that of the volume and of this format"),
            "make the identity from the volume that is baked",
        )),
    }
}

/// Whether the provenance can be written and read back.
pub(super) fn check_provenance(provenance: &Value) -> Result<()> {
    let text = provenance.to_string();
    if text.len() > LONGEST_PROVENANCE {
        return Err(Error::Limit {
            what: "the provenance".into(),
            needed: format!("{} bytes", text.len()),
            limit: format!("{LONGEST_PROVENANCE} bytes"),
            remedy: "keep long tables in a file of their own".into(),
        });
    }
    // The reader allows 128 levels, of which four are around the provenance.
    let wrapped = format!("[[[[[[[[{text}]]]]]]]]");
    match serde_json::from_str::<Value>(&wrapped) {
        Ok(_) => Ok(()),
        Err(e) => Err(Error::argument("provenance", e, "JSON nested at most 100 deep", "make it flatter")),
    }
}
