//! PLY: text, or binary of either byte order. Elements other than `vertex` and `face` are passed over.

use super::{TriangleMesh, damaged, fan};
use crate::error::Result;
use glam::DVec3;

#[derive(Clone, Copy, PartialEq)]
enum Encoding {
    Text,
    Little,
    Big,
}

#[derive(Clone, Copy)]
enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Number {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

struct Property {
    name: String,
    /// Type of the count, of a list.
    count: Option<Number>,
    kind: Number,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

/// Numbers one after the other.
struct Numbers<'a> {
    rest: &'a [u8],
    encoding: Encoding,
}

impl Numbers<'_> {
    fn next(&mut self, kind: Number) -> Result<f64> {
        let truncated = || damaged("the file ends early", "as many numbers as the header says");
        if self.encoding == Encoding::Text {
            let start = self.rest.iter().position(|b| !b.is_ascii_whitespace()).ok_or_else(truncated)?;
            let word = &self.rest[start..];
            let end = word.iter().position(u8::is_ascii_whitespace).unwrap_or(word.len());
            self.rest = &word[end..];
            let number = std::str::from_utf8(&word[..end]).ok().and_then(|w| w.parse().ok());
            return number.ok_or_else(|| damaged("a word that is no number", "numbers after the header"));
        }
        let (bytes, rest) = self.rest.split_at_checked(kind.bytes()).ok_or_else(truncated)?;
        self.rest = rest;
        let mut b = [0u8; 8];
        b[..bytes.len()].copy_from_slice(bytes);
        if self.encoding == Encoding::Big {
            b[..bytes.len()].reverse();
        }
        let [b0, b1, b2, b3, ..] = b;
        Ok(match kind {
            Number::I8 => f64::from(b0 as i8),
            Number::U8 => f64::from(b0),
            Number::I16 => f64::from(i16::from_le_bytes([b0, b1])),
            Number::U16 => f64::from(u16::from_le_bytes([b0, b1])),
            Number::I32 => f64::from(i32::from_le_bytes([b0, b1, b2, b3])),
            Number::U32 => f64::from(u32::from_le_bytes([b0, b1, b2, b3])),
            Number::F32 => f64::from(f32::from_le_bytes([b0, b1, b2, b3])),
            Number::F64 => f64::from_le_bytes(b),
        })
    }
}

pub(super) fn read(bytes: &[u8]) -> Result<TriangleMesh> {
    let (encoding, elements, rest) = header(bytes)?;
    let mut numbers = Numbers { rest, encoding };
    let mut mesh = TriangleMesh::default();
    let mut polygon = Vec::new();
    for element in &elements {
        for _ in 0..element.count {
            let mut position = DVec3::NAN;
            for property in &element.properties {
                let Some(count) = property.count else {
                    let value = numbers.next(property.kind)?;
                    if let Some(axis) = ["x", "y", "z"].iter().position(|name| *name == property.name) {
                        position[axis] = value;
                    }
                    continue;
                };
                polygon.clear();
                let length = numbers.next(count)?;
                if !(0.0..=65536.0).contains(&length) {
                    return Err(damaged(format!("a list of {length} entries"), "lists of at most 65536 entries"));
                }
                for _ in 0..length as usize {
                    let index = numbers.next(property.kind)?;
                    if element.name == "face" && !(index >= 0.0 && index < mesh.positions.len() as f64) {
                        let found = format!("index {index} of {} vertices", mesh.positions.len());
                        return Err(damaged(found, "indices of vertices"));
                    }
                    polygon.push(index as u32);
                }
                let is_face = element.name == "face" && property.name.starts_with("vertex_ind");
                if is_face && polygon.len() >= 3 {
                    fan(&polygon, &mut mesh.triangles)?;
                }
            }
            if element.name == "vertex" {
                mesh.positions.push(position);
            }
        }
    }
    Ok(mesh)
}

fn header(bytes: &[u8]) -> Result<(Encoding, Vec<Element>, &[u8])> {
    let mut rest = bytes;
    let mut encoding = None;
    let mut elements: Vec<Element> = Vec::new();
    for _ in 0..4096 {
        let end = rest.iter().position(|b| *b == b'\n').ok_or_else(|| damaged("no end of the header", "end_header"))?;
        let line = String::from_utf8_lossy(&rest[..end]).trim().to_string();
        rest = &rest[end + 1..];
        let refuse = || damaged(format!("header line {line:?}"), "a PLY header");
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["format", "ascii", _] => encoding = Some(Encoding::Text),
            ["format", "binary_little_endian", _] => encoding = Some(Encoding::Little),
            ["format", "binary_big_endian", _] => encoding = Some(Encoding::Big),
            ["element", name, count] => {
                let count = count.parse().map_err(|_| refuse())?;
                elements.push(Element { name: (*name).into(), count, properties: Vec::new() });
            }
            ["property", "list", count, kind, name] => {
                let (count, kind) = (Number::named(count), Number::named(kind).ok_or_else(refuse)?);
                let count = Some(count.ok_or_else(refuse)?);
                let property = Property { name: (*name).into(), count, kind };
                elements.last_mut().ok_or_else(refuse)?.properties.push(property);
            }
            ["property", kind, name] => {
                let kind = Number::named(kind).ok_or_else(refuse)?;
                let property = Property { name: (*name).into(), count: None, kind };
                elements.last_mut().ok_or_else(refuse)?.properties.push(property);
            }
            ["end_header"] => {
                let encoding = encoding.ok_or_else(|| damaged("no line `format`", "the format of a PLY file"))?;
                // An element without properties would be counted to the end of time.
                if elements.iter().any(|e| e.properties.is_empty() && e.count > 0) {
                    return Err(damaged("an element without properties", "elements with properties"));
                }
                return Ok((encoding, elements, rest));
            }
            _ => {}
        }
    }
    Err(damaged("more than 4096 lines of header", "end_header"))
}
