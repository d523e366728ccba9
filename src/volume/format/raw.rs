//! Raw samples described by a JSON sidecar:
//! `{"dims": [x, y, z], "type": "uint8", "endian": "little", "offset": 0, "spacing": [1, 1, 1],
//! "origin": [0, 0, 0], "slope": 1, "inter": 0, "data": "file.raw"}`.
//! `dims`, `type` and `data` must be there; the values above are the defaults of the others.
//! Keys that are not known are errors. x runs fastest. The data file may be gzipped.

#![cfg_attr(not(test), deny(clippy::indexing_slicing))]

use super::super::assemble::{Parts, assemble};
use super::super::decode::{Endian, Type, checked_count};
use super::super::mapped::Stored;
use super::super::read::{OpenBeside, ReadHint};
use super::super::source::Source;
use super::super::{LengthUnit, Series, Volume};
use super::{affine, needs_second_file};
use crate::error::{Error, Result};
use glam::{DMat3, DVec3};
use std::io::Read;
use std::path::Path;

const NAME: &str = "raw sidecar";
/// Longest sidecar read.
const LONGEST: u64 = 1 << 20;

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Sidecar {
    dims: [u64; 3],
    #[serde(rename = "type")]
    kind: String,
    #[serde(default)]
    endian: ByteOrder,
    #[serde(default)]
    offset: u64,
    #[serde(default = "ones")]
    spacing: [f64; 3],
    #[serde(default)]
    origin: [f64; 3],
    #[serde(default = "one")]
    slope: f64,
    #[serde(default)]
    inter: f64,
    data: String,
}

#[derive(Default, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
enum ByteOrder {
    #[default]
    Little,
    Big,
}

fn one() -> f64 {
    1.0
}

fn ones() -> [f64; 3] {
    [1.0; 3]
}

pub(crate) fn read(mut source: Source, hint: &ReadHint, beside: Option<OpenBeside>) -> Result<Volume> {
    let mut text = Vec::new();
    (&mut source).take(LONGEST).read_to_end(&mut text).map_err(|e| Error::from_read(NAME, "JSON", e))?;
    if let Ok(serde_json::Value::Object(other)) = serde_json::from_slice(&text)
        && ["zarr_format", "multiscales", "plate", "ome"].iter().any(|key| other.contains_key(*key))
    {
        let remedy = "name the folder that holds it: isolume info FOLDER";
        return Err(Error::format(NAME, "the metadata of Zarr", "a description of raw samples", remedy));
    }
    let sidecar: Sidecar = serde_json::from_slice(&text).map_err(|e| {
        Error::format(
            NAME,
            e.to_string(),
            r#"{"dims": [x, y, z], "type": "uint8", "data": "file.raw"} and optional keys"#,
            "correct the sidecar",
        )
    })?;
    let kind = Type::from_name(&sidecar.kind).ok_or_else(|| {
        Error::format(
            NAME,
            format!("type {:?}", sidecar.kind),
            "int8 to int64, uint8 to uint64, float16, float32 or float64",
            "correct the sidecar",
        )
    })?;
    let open = beside.ok_or_else(|| needs_second_file(NAME, &sidecar.data))?;
    let source = open(Path::new(&sidecar.data))?;
    samples(source, &sidecar, kind, hint).map_err(|e| e.in_file(&sidecar.data))
}

fn samples(mut source: Source, sidecar: &Sidecar, kind: Type, hint: &ReadHint) -> Result<Volume> {
    let bytes = sidecar.dims.iter().try_fold(kind.size() as u64, |n, &d| n.checked_mul(d));
    let bytes = bytes.and_then(|n| n.checked_add(sidecar.offset));
    // Samples may look like a gzip header by chance: a file of exactly the right length is raw.
    let exact = bytes.is_some() && source.at_most() == bytes;
    if !exact && source.is_gzip().map_err(|e| Error::from_read(NAME, "samples", e))? {
        source = source.gunzip();
    }
    source.skip(NAME, sidecar.offset, "offset")?;
    let count = checked_count(NAME, sidecar.dims, kind.size(), source.at_most(), hint)?;
    let endian = match sidecar.endian {
        ByteOrder::Little => Endian::Little,
        ByteOrder::Big => Endian::Big,
    };
    let data = Stored::binary(&mut source, NAME, kind, endian, count)?;
    source.verify_end(NAME)?;
    let mut notes = Vec::new();
    if source.peek(1).is_ok_and(|rest| !rest.is_empty()) {
        notes.push(super::super::assemble::note("the data file goes on after the last sample; check dims and type", 1));
    }
    let linear = DMat3::from_diagonal(DVec3::from_array(sidecar.spacing));
    let world_from_grid = affine(NAME, linear, DVec3::from_array(sidecar.origin))?;
    let (slope, inter, unit) = (sidecar.slope, sidecar.inter, LengthUnit::Unknown);
    let dims = sidecar.dims.map(|d| d as usize);
    assemble(
        Parts { format: NAME, dims, data, slope, inter, world_from_grid, unit, series: Series::default(), notes },
        hint,
    )
}
