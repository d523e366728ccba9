//! The volume inside a store: `/volumes/<name>/data`, so that a store is complete without the
//! file it was baked from; or, where the user wants that, where the samples lie in that file.
//!
//! Samples stay in their native type, in chunks of 64³, not compressed. Measured: gzip level 1
//! takes an 8-bit brain MRI (mni152_t1, 8.7 MB) to 19 % at 170 MB/s, and noisy float microscopy
//! (purkinje_neuron, 3.2 MB) to 99.7 %. Beside the transfer texture, 118 bytes a texel, the samples are
//! 1 to 3 % of a store: not worth a codec.

use super::backing::Backing;
use super::identity::solid_name;
use super::zarr::{self, Array, CHECKSUM, Codec, FORMAT, METADATA_REMEDY};
use crate::error::{Error, Result};
use crate::geom::{Affine, Up};
use crate::volume::{LengthUnit, ModelText, Note, Place, Samples, Solid, Volume, samples_at};
use bytemuck::Pod;
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::sync::Arc;

/// The note on a volume from a store that does not say whether its frame is a patient's.
pub const FRONT_NOT_RECORDED: &str = "the store is too old to say whether its frame is anatomical: taken as not";

/// Samples along the side of a chunk of the volume.
const SIDE: usize = 64;

/// What the attributes of the array hold besides their own hash.
#[derive(Serialize, Deserialize)]
struct Attributes {
    /// Rows of the matrix that takes (x, y, z, 1) of the grid to world coordinates.
    affine: [[f64; 4]; 4],
    slope: f64,
    inter: f64,
    /// Metres in one world unit.
    unit: Option<f64>,
    up: String,
    /// Whether anterior is the front; `None` in stores from before this was recorded.
    #[serde(default)]
    anatomical: Option<bool>,
    solid: String,
    name: String,
    notes: Vec<NoteText>,
    /// The file that holds the samples, where the store does not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    reference: Option<Place>,
    /// The text of the model that it is samples of, and the name of its file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    model: Option<ModelNote>,
}

#[derive(Serialize, Deserialize)]
struct ModelNote {
    file: String,
    text: String,
}

#[derive(Serialize, Deserialize)]
struct NoteText {
    text: String,
    count: u64,
}

/// The rows of an affine as a 4×4 matrix, after a scaling of its input.
pub(super) fn rows(affine: &Affine, scale: [f64; 3]) -> [[f64; 4]; 4] {
    let (m, o) = (affine.linear(), affine.offset());
    let row = |r: usize| {
        let m = m.row(r);
        [m.x * scale[0], m.y * scale[1], m.z * scale[2], o[r]]
    };
    [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
}

/// The array of a volume with these dimensions (x, y, z).
pub(super) fn array(dims: [usize; 3], data_type: &'static str) -> Array {
    let [x, y, z] = dims;
    Array {
        shape: vec![z, y, x],
        chunk: vec![SIDE; 3],
        inner: None,
        data_type,
        fill: if data_type == "float32" { json!(0.0) } else { json!(0) },
        names: vec!["z", "y", "x"],
        codec: Codec::Plain,
    }
}

/// The metadata of the array.
///
/// # Errors
/// When the samples are to stay in a file that cannot be named.
pub(super) fn metadata(volume: &Volume) -> Result<Value> {
    volume.check_reference()?;
    let unit = match volume.unit {
        LengthUnit::Metres(metres) if metres.is_finite() => Some(metres),
        _ => None,
    };
    let notes = volume.notes.iter().map(|n| NoteText { text: n.text.clone(), count: n.count }).collect();
    let attributes = Attributes {
        affine: rows(volume.world_from_grid(), [1.0; 3]),
        slope: volume.slope(),
        inter: volume.inter(),
        unit,
        up: volume.up.name().into(),
        anatomical: Some(volume.up.is_anatomical()),
        solid: solid_name(volume.solid).into(),
        name: volume.name.clone(),
        notes,
        reference: volume.samples().place().filter(|_| volume.by_reference),
        model: volume.model.as_ref().map(|m| ModelNote { file: m.file.clone(), text: m.text.clone() }),
    };
    let attributes = super::metadata::sealed(json!(attributes));
    Ok(array(volume.dims(), volume.samples().type_name()).metadata(attributes))
}

/// The file of a chunk by its index along x, y, z.
fn chunk_key(array: &str, [x, y, z]: [usize; 3]) -> String {
    zarr::chunk_key(array, &[z, y, x])
}

/// Calls `each` with the index and the box (start, size) of every chunk.
fn for_each_chunk(
    dims: [usize; 3],
    mut each: impl FnMut([usize; 3], [usize; 3], [usize; 3]) -> Result<()>,
) -> Result<()> {
    let [nx, ny, nz] = dims.map(|d| d.div_ceil(SIDE));
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                let start = [x, y, z].map(|i| i * SIDE);
                let size = std::array::from_fn(|a| (dims[a] - start[a]).min(SIDE));
                each([x, y, z], start, size)?;
            }
        }
    }
    Ok(())
}

/// Calls `each` with the byte ranges (in the volume, in the chunk) of every row of a chunk.
fn for_each_row(
    dims: [usize; 3],
    start: [usize; 3],
    size: [usize; 3],
    width: usize,
    mut each: impl FnMut(std::ops::Range<usize>, std::ops::Range<usize>),
) {
    for z in 0..size[2] {
        for y in 0..size[1] {
            let outer = (start[0] + dims[0] * (start[1] + y + dims[1] * (start[2] + z))) * width;
            let inner = SIDE * (y + SIDE * z) * width;
            each(outer..outer + size[0] * width, inner..inner + size[0] * width);
        }
    }
}

/// What an array says of itself; none where that is damaged.
fn attributes(metadata: &Value) -> Option<Attributes> {
    serde_json::from_value(super::metadata::unsealed(metadata).ok()?).ok()
}

/// The file that the metadata of an array names in place of its chunks.
pub(super) fn reference(metadata: &Value) -> Option<Place> {
    attributes(metadata)?.reference
}

impl Attributes {
    /// Whether the samples of a volume stand in the same frame, and have the same scaling and side.
    fn frames(&self, volume: &Volume) -> bool {
        self.affine == rows(volume.world_from_grid(), [1.0; 3])
            && (self.slope, self.inter) == (volume.slope(), volume.inter())
            && self.solid == solid_name(volume.solid)
    }
}

/// Whether the array at `key` refers to the very samples of a volume, in the same frame.
pub(super) fn is_of(backing: &Backing, key: &str, volume: &Volume) -> bool {
    let Ok(Some(found)) = backing.json(&format!("{key}/zarr.json")) else { return false };
    attributes(&found).is_some_and(|known| {
        known.reference.is_some()
            && known.reference == volume.samples().place()
            && known.frames(volume)
            && array(volume.dims(), volume.samples().type_name()).check(&found).is_ok()
    })
}

/// Why the metadata of an array cannot stay for a volume whose content is that of the store; none where they can. Names and notes may
/// differ, and a file that holds the same samples may be another one where a copy is at hand.
pub(super) fn wrong(found: &Value, volume: &Volume) -> Option<&'static str> {
    let type_name = volume.samples().type_name();
    let is_array = array(volume.dims(), type_name).check(found).is_ok();
    let Some(known) = attributes(found).filter(|known| is_array && known.frames(volume)) else {
        return Some("damaged");
    };
    let place = known.reference.filter(|place| volume.samples().place().as_ref() != Some(place))?;
    if volume.by_reference {
        return Some("of another file");
    }
    let same = samples_at(&place, type_name, volume.samples().len(), true);
    let is_same = same.is_ok_and(|samples| samples.bytes() == volume.samples().bytes());
    (!is_same).then_some("of a file that is not there or holds other samples")
}

/// Says where the samples stay, if that is not how the volume is to be kept.
pub(super) fn differs(found: &Value, volume: &Volume) -> Option<String> {
    match (reference(found), volume.by_reference) {
        (Some(place), false) => Some(format!(
            "the samples stay in {}, which the store names: --store-volume copy is for a store that is made, or made anew with --force",
            place.file.display()
        )),
        (None, true) => Some(
            "the store keeps its copy of the samples: --store-volume reference is for a store that is made, or made anew with --force"
                .into(),
        ),
        _ => None,
    }
}

/// Writes the samples as chunks of the array at `key`, unless it refers to their file.
///
/// # Errors
/// When the system refuses to write; when another program has written the file of the samples meanwhile.
pub(super) fn write(backing: &Backing, key: &str, volume: &Volume, sync: bool) -> Result<()> {
    if !volume.by_reference {
        for_each_chunk(volume.dims(), |index, start, size| {
            backing.put(&chunk_key(key, index), sync, &chunk_bytes(volume, start, size))
        })?;
    }
    volume.samples().check()
}

/// A chunk of the array as it stands in its file.
fn chunk_bytes(volume: &Volume, start: [usize; 3], size: [usize; 3]) -> Vec<u8> {
    let (dims, bytes) = (volume.dims(), volume.samples().bytes());
    let width = bytes.len() / volume.samples().len();
    let mut chunk = vec![0u8; SIDE.pow(3) * width];
    for_each_row(dims, start, size, width, |outer, inner| chunk[inner].copy_from_slice(&bytes[outer]));
    let sum = zarr::checksum(&chunk);
    chunk.extend(sum.to_le_bytes());
    chunk
}

/// Writes those files of the array at `key` that do not hold the samples of `volume`; how many there were. None where it refers
/// to their file.
///
/// # Errors
/// When the system refuses; when another program has written the file of the samples meanwhile.
pub(super) fn mend(backing: &Backing, key: &str, volume: &Volume, sync: bool) -> Result<u64> {
    let mut mended = 0;
    if super::metadata::required_json(backing, &format!("{key}/zarr.json"))
        .is_ok_and(|found| reference(&found).is_some())
    {
        return Ok(0);
    }
    for_each_chunk(volume.dims(), |index, start, size| {
        let (file, expected) = (chunk_key(key, index), chunk_bytes(volume, start, size));
        if backing.bytes(&file)?.is_none_or(|found| *found != *expected) {
            backing.put(&file, sync, &expected)?;
            mended += 1;
        }
        Ok(())
    })?;
    volume.samples().check()?;
    Ok(mended)
}

fn samples<T: Pod + Send>(backing: &Backing, key: &str, dims: [usize; 3]) -> Result<Vec<T>> {
    let width = size_of::<T>();
    let expected = SIDE.pow(3) * width + CHECKSUM;
    let damaged = |chunk: &str, found: String, expected: String| {
        let remedy = "run the bake that made the store again: it restores the samples from the volume's own file";
        Error::format(FORMAT, found, expected, remedy).in_file(backing.name(chunk))
    };
    // All files are there with their lengths before memory is asked for: a header that claims
    // more than the disk holds fails here.
    for_each_chunk(dims, |index, _, _| {
        let chunk = chunk_key(key, index);
        match backing.length(&chunk) {
            Some(length) if length == expected as u64 => Ok(()),
            Some(length) => Err(damaged(&chunk, format!("{length} bytes"), format!("{expected} bytes"))),
            None => Err(damaged(&chunk, "no such file".into(), "a chunk of the volume".into())),
        }
    })?;
    let mut samples = vec![T::zeroed(); dims.iter().product()];
    // A slab of chunks in z is a run of the samples.
    let slabs = samples.par_chunks_mut(dims[0] * dims[1] * SIDE).with_max_len(1).enumerate();
    let read = slabs.map(|(slab, samples)| {
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(samples);
        let depth = bytes.len() / (dims[0] * dims[1] * width);
        for_each_chunk([dims[0], dims[1], depth], |[x, y, _], start, size| {
            let name = chunk_key(key, [x, y, slab]);
            let file = backing.bytes(&name)?.filter(|file| file.len() == expected);
            let Some(file) = file else {
                return Err(damaged(&name, "a file that changed".into(), format!("{expected} bytes")));
            };
            let (chunk, stored) = file.split_at(expected - CHECKSUM);
            let (found, stored) = (zarr::checksum(chunk), zarr::little_u32(stored));
            if found != stored {
                let found = format!("bytes with crc32c {found:08x}");
                return Err(damaged(&name, found, format!("crc32c {stored:08x}")));
            }
            for_each_row(dims, start, size, width, |outer, inner| bytes[outer].copy_from_slice(&chunk[inner]));
            Ok(())
        })
    });
    // The first damage in the order of the file, not of the threads.
    read.collect::<Vec<_>>().into_iter().collect::<Result<()>>()?;
    Ok(samples)
}

/// Reads the volume whose array is at `key`. The caller compares its content hash.
///
/// # Errors
/// When a file is missing or damaged, or the metadata is not that of a volume of `dims`.
pub(super) fn read(backing: &Backing, key: &str, dims: [usize; 3]) -> Result<Volume> {
    let metadata_key = format!("{key}/zarr.json");
    let name = backing.name(&metadata_key);
    let metadata = super::metadata::required_json(backing, &metadata_key)?;
    let wrong = |found: String, expected: &str| Error::format(FORMAT, found, expected, METADATA_REMEDY).in_file(&name);
    let type_name = metadata.get("data_type").and_then(Value::as_str).unwrap_or("none");
    let Some(data_type) = ["uint8", "int8", "uint16", "int16", "float32"].into_iter().find(|t| *t == type_name) else {
        return Err(wrong(format!("data_type {type_name}"), "uint8, int8, uint16, int16 or float32"));
    };
    array(dims, data_type).check(&metadata).map_err(|e| e.in_file(&name))?;
    let attributes = super::metadata::unsealed(&metadata).map_err(|e| e.in_file(&name))?;
    let Attributes { affine, slope, inter, unit, up, anatomical, solid, name: title, notes, reference, model } =
        serde_json::from_value(attributes).map_err(|e| wrong(e.to_string(), "the attributes of a volume"))?;
    let column = |c: usize| DVec3::new(affine[0][c], affine[1][c], affine[2][c]);
    let affine = Affine::new(DMat3::from_cols(column(0), column(1), column(2)), column(3))
        .ok_or_else(|| wrong("an affine that is not invertible".into(), "an invertible affine"))?;
    let up = [Up::X, Up::Y, Up::Z, Up::NegX, Up::NegY, Up::NegZ].into_iter().find(|u| u.name() == up);
    let up = up.ok_or_else(|| wrong("another `up`".into(), "`up`: x, y, z, -x, -y or -z"))?;
    let up = if up == Up::Z && anatomical == Some(true) { Up::Anatomical } else { up };
    let solid = [Solid::Above, Solid::Below].into_iter().find(|s| solid_name(*s) == solid);
    let solid = solid.ok_or_else(|| wrong("another `solid`".into(), "`solid`: above or below"))?;
    let samples = match data_type {
        _ if let Some(place) = &reference => {
            samples_at(place, data_type, dims.iter().product(), backing.maps_samples())?
        }
        "uint8" => Samples::U8(samples(backing, key, dims)?),
        "int8" => Samples::I8(samples(backing, key, dims)?),
        "uint16" => Samples::U16(samples(backing, key, dims)?),
        "int16" => Samples::I16(samples(backing, key, dims)?),
        _ => Samples::F32(samples(backing, key, dims)?),
    };
    let mut volume = Volume::new(dims, samples, affine)?.with_scaling(slope, inter)?;
    (volume.name, volume.up, volume.solid) = (title, up, solid);
    volume.unit = unit.map_or(LengthUnit::Unknown, LengthUnit::Metres);
    volume.by_reference = reference.is_some() && volume.samples().place().is_some();
    volume.notes = notes.into_iter().map(|n| Note { text: n.text, count: n.count }).collect();
    volume.model = model.map(|m| Arc::new(ModelText { file: m.file, text: m.text }));
    if anatomical.is_none() {
        volume.notes.push(Note { text: FRONT_NOT_RECORDED.into(), count: 1 });
    }
    Ok(volume)
}
