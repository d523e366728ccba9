//! What a Zarr array says of itself: versions 2 and 3 (zarr-specs.readthedocs.io, "Zarr storage specification version 2" and
//! "Zarr core specification version 3"), and the codecs of zarr-python and numcodecs.

use super::super::decode::{self, Data, Endian, Type};
use super::super::source::Source;
use super::codec::{Pipeline, Step, unknown};
use super::{NAME, damage};
use crate::error::Result;
use serde_json::Value;

/// Most axes of an array.
const MOST_AXES: usize = 16;

/// An array as its metadata describe it.
#[derive(Clone, Debug)]
pub(super) struct Array {
    // Invariant: shape, chunk and names have one length, at most MOST_AXES; no entry of chunk is 0.
    pub(super) shape: Vec<u64>,
    /// Entries of a stored chunk along each axis.
    pub(super) chunk: Vec<u64>,
    pub(super) kind: Type,
    /// What is not stored, one sample.
    pub(super) fill: Data,
    pub(super) pipeline: Pipeline,
    /// How a stored chunk, a shard, is divided.
    pub(super) shard: Option<Shard>,
    keys: Keys,
    /// Names of the axes, empty where there are none.
    pub(super) names: Vec<String>,
}

/// Chunks in a shard, with an index of their places.
#[derive(Clone, Debug)]
pub(super) struct Shard {
    pub(super) chunk: Vec<u64>,
    pub(super) index: Pipeline,
    pub(super) index_at_end: bool,
}

#[derive(Clone, Debug)]
struct Keys {
    prefix: &'static str,
    separator: char,
}

fn wrong(field: &str, found: &Value, expected: &str) -> crate::error::Error {
    let mut text = found.to_string();
    if text.chars().count() > 80 {
        text = text.chars().take(80).chain("…".chars()).collect();
    }
    damage(format!("{field}: {text}"), expected, "the metadata are damaged; copy the hierarchy again, or write it anew")
}

impl Array {
    /// From `zarr.json` of version 3.
    pub(super) fn version_3(meta: &Value) -> Result<Self> {
        let shape = numbers("shape", &meta["shape"])?;
        let grid = &meta["chunk_grid"];
        if grid["name"] != "regular" {
            return Err(wrong("chunk_grid", grid, "a regular grid"));
        }
        let chunk = numbers("chunk_shape", &grid["configuration"]["chunk_shape"])?;
        let kind = match meta["data_type"].as_str().and_then(Type::from_name) {
            Some(kind) => kind,
            None => return Err(wrong("data_type", &meta["data_type"], "an integer or a floating-point number")),
        };
        let encoding = &meta["chunk_key_encoding"];
        let (prefix, default) = match encoding["name"].as_str() {
            Some("default") => ("c", '/'),
            Some("v2") => ("", '.'),
            _ => return Err(wrong("chunk_key_encoding", encoding, "default or v2")),
        };
        let separator = separator(&encoding["configuration"]["separator"], default)?;
        let codecs = meta["codecs"].as_array().ok_or_else(|| wrong("codecs", &meta["codecs"], "a list"))?;
        let mut shard = None;
        let mut inside = codecs;
        if let [only] = codecs.as_slice()
            && only["name"] == "sharding_indexed"
        {
            let said = &only["configuration"];
            let list = |field: &str| said[field].as_array().ok_or_else(|| wrong(field, &said[field], "a list"));
            inside = list("codecs")?;
            let index = pipeline_3(list("index_codecs")?, shape.len() + 1, 8)?;
            if index.plain_length(0).is_none() || index.axes.iter().enumerate().any(|(i, a)| i != *a) {
                return Err(wrong(
                    "index_codecs",
                    &said["index_codecs"],
                    "bytes and crc32c, of which the length is known",
                ));
            }
            let index_at_end = match said["index_location"].as_str() {
                Some("end") | None => true,
                Some("start") => false,
                _ => return Err(wrong("index_location", &said["index_location"], "start or end")),
            };
            shard = Some(Shard { chunk: numbers("chunk_shape", &said["chunk_shape"])?, index, index_at_end });
        }
        let pipeline = pipeline_3(inside, shape.len(), kind.size())?;
        let names = match &meta["dimension_names"] {
            Value::Array(names) => names.iter().map(|n| n.as_str().unwrap_or("").to_string()).collect(),
            _ => vec![String::new(); shape.len()],
        };
        let fill = fill(&meta["fill_value"], kind)?;
        let keys = Keys { prefix, separator };
        Self { shape, chunk, kind, fill, pipeline, shard, keys, names }.checked()
    }

    /// From `.zarray` and `.zattrs` of version 2.
    pub(super) fn version_2(meta: &Value, attributes: &Value) -> Result<Self> {
        let shape = numbers("shape", &meta["shape"])?;
        let chunk = numbers("chunks", &meta["chunks"])?;
        let (kind, endian) = type_2(&meta["dtype"])?;
        let mut steps = Vec::new();
        for filter in meta["filters"].as_array().into_iter().flatten() {
            steps.push(step_2(filter, kind.size())?);
        }
        if !meta["compressor"].is_null() {
            steps.push(step_2(&meta["compressor"], kind.size())?);
        }
        let mut axes: Vec<usize> = (0..shape.len()).collect();
        match meta["order"].as_str() {
            Some("C") | None => {}
            Some("F") => axes.reverse(),
            _ => return Err(wrong("order", &meta["order"], "C or F")),
        }
        let keys = Keys { prefix: "", separator: separator(&meta["dimension_separator"], '.')? };
        // xarray's names of the axes.
        let names = match &attributes["_ARRAY_DIMENSIONS"] {
            Value::Array(names) => names.iter().map(|n| n.as_str().unwrap_or("").to_string()).collect(),
            _ => vec![String::new(); shape.len()],
        };
        let fill = fill(&meta["fill_value"], kind)?;
        let pipeline = Pipeline { steps, endian, axes };
        Self { shape, chunk, kind, fill, pipeline, shard: None, keys, names }.checked()
    }

    fn checked(mut self) -> Result<Self> {
        let axes = self.shape.len();
        let inner = self.shard.as_ref().map_or(&self.chunk, |shard| &shard.chunk);
        let divides = |(outer, inner): (&u64, &u64)| *inner > 0 && outer.is_multiple_of(*inner);
        if axes == 0 || axes > MOST_AXES || self.chunk.len() != axes || inner.len() != axes || self.chunk.contains(&0) {
            let found = format!("shape {:?} in chunks of {:?} of {inner:?}", self.shape, self.chunk);
            return Err(damage(found, "1 to 16 axes with chunks of at least one entry", "the metadata are damaged"));
        }
        if !self.chunk.iter().zip(inner).all(divides) {
            let found = format!("shards of {:?} in chunks of {inner:?}", self.chunk);
            return Err(damage(found, "shards of whole chunks", "the metadata are damaged"));
        }
        self.names.resize(axes, String::new());
        Ok(self)
    }

    /// Entries of what is packed as one: a chunk, or one of a shard.
    pub(super) fn inner_chunk(&self) -> &[u64] {
        self.shard.as_ref().map_or(&self.chunk, |shard| &shard.chunk)
    }

    /// The key of a stored chunk, below the array.
    pub(super) fn key(&self, place: &[u64]) -> String {
        let mut key = self.keys.prefix.to_string();
        for index in place {
            if !key.is_empty() {
                key.push(self.keys.separator);
            }
            key += &index.to_string();
        }
        key
    }
}

fn numbers(field: &str, value: &Value) -> Result<Vec<u64>> {
    let numbers: Option<Vec<u64>> = value.as_array().and_then(|all| all.iter().map(Value::as_u64).collect());
    numbers.filter(|n| n.len() <= MOST_AXES).ok_or_else(|| wrong(field, value, "numbers from 0, at most 16 of them"))
}

fn separator(value: &Value, default: char) -> Result<char> {
    match value.as_str() {
        Some("/") => Ok('/'),
        Some(".") => Ok('.'),
        None if value.is_null() => Ok(default),
        _ => Err(wrong("separator", value, "/ or .")),
    }
}

/// `<u2` and the like.
fn type_2(value: &Value) -> Result<(Type, Endian)> {
    let text = value.as_str().unwrap_or("");
    let endian = if text.starts_with('>') { Endian::Big } else { Endian::Little };
    let kind = match text.trim_start_matches(['<', '>', '|']) {
        "u1" => Type::U8,
        "i1" => Type::I8,
        "u2" => Type::U16,
        "i2" => Type::I16,
        "u4" => Type::U32,
        "i4" => Type::I32,
        "u8" => Type::U64,
        "i8" => Type::I64,
        "f2" => Type::F16,
        "f4" => Type::F32,
        "f8" => Type::F64,
        _ => return Err(wrong("dtype", value, "an integer or a floating-point number")),
    };
    Ok((kind, endian))
}

/// A compressor or a filter of numcodecs.
fn step_2(value: &Value, size: usize) -> Result<Step> {
    Ok(match value["id"].as_str() {
        Some("gzip") => Step::Gzip,
        Some("zlib") => Step::Zlib,
        Some("zstd") => Step::Zstd,
        Some("lz4") => Step::Lz4,
        Some("blosc") => Step::Blosc,
        Some("crc32c") => Step::Crc32c,
        Some("shuffle") => shuffle(&value["elementsize"], size)?,
        other => return Err(unknown(other.unwrap_or("without a name"))),
    })
}

fn shuffle(value: &Value, size: usize) -> Result<Step> {
    match value.as_u64() {
        None if value.is_null() => Ok(Step::Shuffle(size)),
        Some(size @ 1..=256) => Ok(Step::Shuffle(size as usize)),
        _ => Err(wrong("elementsize", value, "1 to 256")),
    }
}

/// Codecs of version 3: arrays to arrays, to bytes, to bytes.
fn pipeline_3(codecs: &[Value], axes: usize, size: usize) -> Result<Pipeline> {
    let mut pipeline = Pipeline { steps: Vec::new(), endian: Endian::Little, axes: (0..axes).collect() };
    let mut are_bytes = false;
    for codec in codecs {
        // Codecs may be given by their name alone.
        let name = codec["name"].as_str().or(codec.as_str()).unwrap_or("without a name");
        let said = &codec["configuration"];
        match (name, are_bytes) {
            ("bytes" | "endian", false) => {
                are_bytes = true;
                pipeline.endian = match said["endian"].as_str() {
                    Some("big") => Endian::Big,
                    Some("little") => Endian::Little,
                    None if size == 1 => Endian::Little,
                    _ => return Err(wrong("endian", &said["endian"], "little or big")),
                };
            }
            ("transpose", false) => {
                let order = match said["order"].as_str() {
                    Some("C") => continue,
                    Some("F") => (0..axes as u64).rev().collect(),
                    _ => numbers("order", &said["order"])?,
                };
                let mut turned = Vec::new();
                for place in &order {
                    turned.extend(usize::try_from(*place).ok().and_then(|place| pipeline.axes.get(place)));
                }
                let mut sorted = turned.clone();
                sorted.sort_unstable();
                if sorted != (0..axes).collect::<Vec<_>>() {
                    return Err(wrong("order", &said["order"], "each axis once"));
                }
                pipeline.axes = turned;
            }
            ("gzip", true) => pipeline.steps.push(Step::Gzip),
            ("zlib" | "numcodecs.zlib", true) => pipeline.steps.push(Step::Zlib),
            ("zstd" | "numcodecs.zstd", true) => pipeline.steps.push(Step::Zstd),
            ("lz4" | "numcodecs.lz4", true) => pipeline.steps.push(Step::Lz4),
            ("blosc" | "numcodecs.blosc", true) => pipeline.steps.push(Step::Blosc),
            ("crc32c" | "numcodecs.crc32c", true) => pipeline.steps.push(Step::Crc32c),
            ("numcodecs.shuffle", true) => pipeline.steps.push(shuffle(&said["elementsize"], size)?),
            (name, _) => return Err(unknown(name)),
        }
    }
    if are_bytes {
        Ok(pipeline)
    } else {
        Err(damage("no codec bytes", "it among the codecs", "the metadata are damaged"))
    }
}

/// The sample that stands for what is not stored.
fn fill(value: &Value, kind: Type) -> Result<Data> {
    let refuse = || wrong("fill_value", value, &format!("a number of type {}", kind.name()));
    let special = |text: &str| match text {
        "NaN" => Some(f64::NAN),
        "Infinity" => Some(f64::INFINITY),
        "-Infinity" => Some(f64::NEG_INFINITY),
        _ => None,
    };
    let text = match value {
        Value::Null => "0".to_string(),
        Value::Bool(b) => u8::from(*b).to_string(),
        Value::Number(number) => number.to_string(),
        Value::String(text) => match (special(text), text.strip_prefix("0x")) {
            (Some(number), _) => number.to_string(),
            // The bits of a floating-point number.
            (None, Some(digits)) if kind.size() * 2 == digits.len() => {
                let bits = u64::from_str_radix(digits, 16).map_err(|_| refuse())?;
                let bytes = bits.to_le_bytes();
                let mut source = Source::new(&bytes[..], None);
                return decode::binary(&mut source, NAME, kind, Endian::Little, 1);
            }
            _ => return Err(refuse()),
        },
        _ => return Err(refuse()),
    };
    // 3.0 is an integer in some writers' words.
    let is_real = matches!(kind, Type::F16 | Type::F32 | Type::F64);
    let text = if is_real { text.as_str() } else { text.strip_suffix(".0").unwrap_or(&text) };
    decode::text(&mut Source::new(text.as_bytes(), None), NAME, kind, 1).map_err(|_| refuse())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn v3(codecs: Value) -> Result<Array> {
        Array::version_3(&json!({
            "zarr_format": 3, "node_type": "array", "shape": [9, 7, 5], "data_type": "uint16", "fill_value": 3,
            "chunk_grid": { "name": "regular", "configuration": { "chunk_shape": [4, 4, 4] } },
            "chunk_key_encoding": { "name": "default" }, "codecs": codecs,
        }))
    }

    #[test]
    fn arrays_of_both_versions_are_described_alike() {
        let bytes = json!({ "name": "bytes", "configuration": { "endian": "big" } });
        let three =
            v3(json!([{ "name": "transpose", "configuration": { "order": [2, 0, 1] } }, bytes, { "name": "gzip" }]));
        let three = three.unwrap();
        assert_eq!((&three.fill, three.pipeline.endian), (&Data::U16(vec![3]), Endian::Big));
        assert_eq!((three.pipeline.axes.as_slice(), three.key(&[1, 0, 2])), (&[2, 0, 1][..], "c/1/0/2".into()));
        let two = json!({ "shape": [9, 7], "chunks": [4, 4], "dtype": ">u2", "order": "F", "fill_value": null, "filters": null,
            "compressor": { "id": "blosc" }, "dimension_separator": "/" });
        let two = Array::version_2(&two, &json!({ "_ARRAY_DIMENSIONS": ["y", "x"] })).unwrap();
        assert_eq!((two.pipeline.steps, two.pipeline.axes), (vec![Step::Blosc], vec![1, 0]));
        assert_eq!((two.names, two.fill), (vec!["y".to_string(), "x".into()], Data::U16(vec![0])));
    }

    #[test]
    fn fills_are_numbers_names_and_bits() {
        let of = |value: Value, kind| fill(&value, kind).ok();
        assert_eq!(of(json!("0x40490fdb"), Type::F32), Some(Data::F32(vec![std::f32::consts::PI])));
        assert!(matches!(of(json!("NaN"), Type::F64), Some(Data::F64(v)) if v[0].is_nan()));
        assert_eq!(of(json!(u64::MAX), Type::U64), Some(Data::U64(vec![u64::MAX])));
        assert_eq!(of(json!(7.0), Type::U8), Some(Data::U8(vec![7])));
        for (value, kind) in
            [(json!(300), Type::U8), (json!("NaN"), Type::U8), (json!([1]), Type::F32), (json!("0x12"), Type::F32)]
        {
            assert_eq!(of(value, kind), None);
        }
    }

    #[test]
    fn what_is_not_read_is_named() {
        let bytes = json!({ "name": "bytes", "configuration": { "endian": "little" } });
        for (codecs, said) in [
            (json!([bytes, { "name": "numcodecs.bz2" }]), "numcodecs.bz2"),
            (json!([{ "name": "gzip" }, bytes]), "gzip"),
            (json!([]), "no codec bytes"),
            (json!([{ "name": "transpose", "configuration": { "order": [0, 0, 1] } }, bytes]), "each axis once"),
            (json!([bytes, { "name": "sharding_indexed" }]), "sharding_indexed"),
            (
                json!([{ "name": "sharding_indexed", "configuration": { "chunk_shape": [3, 4, 4], "codecs": [bytes],
                "index_codecs": [bytes] } }]),
                "whole chunks",
            ),
            (
                json!([{ "name": "sharding_indexed", "configuration": { "chunk_shape": [2, 4, 4], "codecs": [bytes],
                "index_codecs": [bytes, { "name": "gzip" }] } }]),
                "index_codecs",
            ),
        ] {
            let text = v3(codecs).unwrap_err().to_string();
            assert!(text.contains(said), "{text}");
        }
    }
}
