//! Samples of a VTK array: text, or bytes behind a header of their length, perhaps in base64, perhaps in blocks that are
//! compressed one by one (VTK's wiki, "VTK XML Formats").

use super::super::super::decode::{self, Data, Endian, Type};
use super::super::super::source::Source;
use super::NAME;
use crate::error::{Error, Result};
use flate2::bufread::ZlibDecoder;
use std::io::{self, BufRead, Read};

/// How arrays are stored, as the root element says.
#[derive(Clone, Copy)]
pub(super) struct Encoding {
    pub(super) endian: Endian,
    /// Whether lengths have 8 bytes instead of 4.
    pub(super) is_wide: bool,
    pub(super) codec: Option<Codec>,
}

/// A compression.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Codec {
    Zlib,
    Lz4,
    Lzma,
}

impl Codec {
    pub(super) fn named(name: &str) -> Result<Self> {
        match name {
            "vtkZLibDataCompressor" => Ok(Self::Zlib),
            "vtkLZ4DataCompressor" => Ok(Self::Lz4),
            "vtkLZMADataCompressor" => Ok(Self::Lzma),
            other => {
                let remedy = "save it again in Python:\n  import vtk; r = vtk.vtkXMLImageDataReader(); r.SetFileName(\"FILE\")\n  \
                              w = vtk.vtkXMLImageDataWriter(); w.SetInputConnection(r.GetOutputPort())\n  \
                              w.SetFileName(\"OUT.vti\"); w.SetCompressorTypeToZLib(); w.Write()";
                Err(Error::format(NAME, format!("compressor {other}"), "ZLib, LZ4, LZMA or none", remedy))
            }
        }
    }

    /// No stream of `n` bytes holds more than this: deflate codes at most 258 bytes in 2 bits, LZ4 255 in one byte; LZMA codes
    /// matches of 273 bytes in 10 decisions of 0.022 bits or more (probabilities of at most 1 − 2⁻⁶), 10,000 for each byte.
    pub(super) fn most(self, n: u64) -> u64 {
        let ratio = match self {
            Self::Zlib => 1032,
            Self::Lz4 => 255,
            Self::Lzma => 10_000,
        };
        n.saturating_mul(ratio).saturating_add(64)
    }

    /// A block of exactly `length` bytes.
    fn unpack(self, packed: &[u8], length: usize, out: &mut Vec<u8>) -> io::Result<()> {
        let damaged = |text: String| io::Error::new(io::ErrorKind::InvalidData, text);
        out.clear();
        if length as u64 > self.most(packed.len() as u64) {
            return Err(damaged(format!("a block of {} bytes that claims to hold {length}", packed.len())));
        }
        match self {
            Self::Zlib => {
                let read = ZlibDecoder::new(packed).take(length as u64 + 1).read_to_end(out)?;
                if read == length {
                    Ok(())
                } else {
                    Err(damaged(format!("a block of {read} bytes, {length} are announced")))
                }
            }
            Self::Lzma => {
                // The decoder holds all that it makes: what comes out is known before.
                match xz_length(packed) {
                    Some(read) if read == length as u64 => {}
                    Some(read) => return Err(damaged(format!("a block of {read} bytes, {length} are announced"))),
                    None => return Err(damaged("a damaged block of LZMA".into())),
                }
                let mut packed = packed;
                lzma_rs::xz_decompress(&mut packed, out)
                    .map_err(|e| damaged(format!("a damaged block of LZMA, {e:?}")))?;
                if out.len() == length { Ok(()) } else { Err(damaged(format!("a block of {} bytes", out.len()))) }
            }
            Self::Lz4 => {
                out.resize(length, 0);
                match lz4_flex::block::decompress_into(packed, out) {
                    Ok(read) if read == length => Ok(()),
                    Ok(read) => Err(damaged(format!("a block of {read} bytes, {length} are announced"))),
                    Err(e) => Err(damaged(format!("a damaged block of LZ4, {e}"))),
                }
            }
        }
    }
}

/// Bytes in the one block of an .xz stream, by the headers of its chunks ("The .xz file format" 1.2, 2.1.1 and 3.1; LZMA2).
fn xz_length(stream: &[u8]) -> Option<u64> {
    let header = usize::from(*stream.get(12)?);
    let mut chunks = stream.get(12 + 4 * (header + 1)..)?;
    let mut length = 0;
    if header == 0 {
        return None;
    }
    loop {
        let (&control, rest) = chunks.split_first()?;
        let number = |at: usize| Some(u64::from(u16::from_be_bytes([*rest.get(at)?, *rest.get(at + 1)?])) + 1);
        let taken = match control {
            0 => return Some(length),
            1 | 2 => {
                length += number(0)?;
                2 + number(0)?
            }
            128.. => {
                length += (u64::from(control & 0x1f) << 16) + number(0)?;
                // From 0xc0 on, the properties are given anew.
                4 + u64::from(control >= 0xc0) + number(2)?
            }
            _ => return None,
        };
        chunks = rest.get(usize::try_from(taken).ok()?..)?;
    }
}

/// Numbers written as text.
pub(super) fn text(text: impl Read, kind: Type, count: usize) -> Result<Data> {
    let mut source = Source::new(text, None);
    let data = decode::text(&mut source, NAME, kind, count)?;
    if source.token(NAME, &mut Vec::new())? {
        return Err(more(&format!("more than {count} numbers"), count));
    }
    Ok(data)
}

fn more(found: &str, count: usize) -> Error {
    let remedy = "the extent, the type or the number of components is wrong, or the file is damaged";
    Error::format(NAME, found, format!("{count} samples, as the extent says"), remedy)
}

/// Numbers as bytes behind their header.
pub(super) fn binary(bytes: &mut dyn Read, encoding: Encoding, kind: Type, count: usize) -> Result<Data> {
    let expected = (count as u64).checked_mul(kind.size() as u64).ok_or_else(|| more("more than 2^64 bytes", count))?;
    match encoding.codec {
        None => {
            let length = number(bytes, encoding)?;
            if length != expected {
                return Err(more(&format!("an array of {length} bytes"), count));
            }
            decode::binary(&mut Source::new(bytes.take(expected), None), NAME, kind, encoding.endian, count)
        }
        Some(codec) => {
            let [blocks, size, last] = [number(bytes, encoding)?, number(bytes, encoding)?, number(bytes, encoding)?];
            // 0: the last block is full.
            let rest = if last == 0 { size } else { last };
            let whole = blocks.checked_sub(1).and_then(|n| n.checked_mul(size)).and_then(|n| n.checked_add(rest));
            if whole != Some(expected) || rest > size || size == 0 {
                let found = format!("{blocks} blocks of {size} bytes, the last of {rest}");
                return Err(more(&found, count));
            }
            let mut packed = Vec::new();
            for _ in 0..blocks {
                packed.push(number(bytes, encoding)?);
            }
            let blocks = Blocks { bytes, codec, size, rest, packed: packed.into(), block: Vec::new(), at: 0 };
            decode::binary(&mut Source::new(blocks, None), NAME, kind, encoding.endian, count)
        }
    }
}

/// One number of a header.
fn number(bytes: &mut dyn Read, encoding: Encoding) -> Result<u64> {
    let (mut wide, mut narrow) = ([0; 8], [0; 4]);
    let out = if encoding.is_wide { &mut wide[..] } else { &mut narrow[..] };
    bytes.read_exact(out).map_err(|e| Error::from_read(NAME, "the length of an array", e))?;
    Ok(match (encoding.is_wide, encoding.endian) {
        (true, Endian::Little) => u64::from_le_bytes(wide),
        (true, Endian::Big) => u64::from_be_bytes(wide),
        (false, Endian::Little) => u32::from_le_bytes(narrow).into(),
        (false, Endian::Big) => u32::from_be_bytes(narrow).into(),
    })
}

/// The content of compressed blocks.
struct Blocks<'r> {
    bytes: &'r mut dyn Read,
    codec: Codec,
    size: u64,
    /// Size of the last block.
    rest: u64,
    /// Sizes of the packed blocks that are to come.
    packed: std::collections::VecDeque<u64>,
    block: Vec<u8>,
    at: usize,
}

impl Read for Blocks<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.at == self.block.len() {
            let Some(packed) = self.packed.pop_front() else { return Ok(0) };
            let length = if self.packed.is_empty() { self.rest } else { self.size };
            let length = usize::try_from(length).map_err(|_| io::ErrorKind::InvalidData)?;
            let mut bytes = Vec::new();
            if (&mut self.bytes).take(packed).read_to_end(&mut bytes)? as u64 != packed {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            self.codec.unpack(&bytes, length, &mut self.block)?;
            self.at = 0;
        }
        let count = self.block.get(self.at..).unwrap_or_default().read(out)?;
        self.at += count;
        Ok(count)
    }
}

/// Bytes in base64 up to where the text ends. White space is passed over, and padding ends four characters, not the
/// stream: VTK encodes a header and what follows one after the other, each with its padding.
pub(super) struct Base64<R> {
    text: R,
    ready: [u8; 3],
    // Invariant: at <= end <= 3; those between are still to be handed out.
    at: usize,
    end: usize,
}

impl<R: BufRead> Base64<R> {
    pub(super) fn new(text: R) -> Self {
        Self { text, ready: [0; 3], at: 0, end: 0 }
    }

    /// Decodes four characters; false at the end.
    fn four(&mut self) -> io::Result<bool> {
        let damaged = || io::Error::new(io::ErrorKind::InvalidData, "damaged base64");
        let (mut bits, mut found, mut padding) = (0u32, 0, 0);
        while found < 4 {
            let bytes = self.text.fill_buf()?;
            if bytes.is_empty() {
                return if found == 0 { Ok(false) } else { Err(damaged()) };
            }
            let mut used = 0;
            for &byte in bytes {
                used += 1;
                let value = match byte {
                    b'A'..=b'Z' => byte - b'A',
                    b'a'..=b'z' => byte - b'a' + 26,
                    b'0'..=b'9' => byte - b'0' + 52,
                    b'+' => 62,
                    b'/' => 63,
                    b'=' if found >= 2 => {
                        padding += 1;
                        0
                    }
                    byte if byte.is_ascii_whitespace() => continue,
                    _ => return Err(damaged()),
                };
                if padding > 0 && byte != b'=' {
                    return Err(damaged());
                }
                bits = bits << 6 | u32::from(value);
                found += 1;
                if found == 4 {
                    break;
                }
            }
            self.text.consume(used);
        }
        let [_, a, b, c] = bits.to_be_bytes();
        (self.ready, self.at, self.end) = ([a, b, c], 0, 3 - padding);
        Ok(true)
    }
}

impl<R: BufRead> Read for Base64<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let mut count = 0;
        while count < out.len() {
            if self.at == self.end && !self.four()? {
                break;
            }
            let ready = self.ready.get(self.at..self.end).unwrap_or_default();
            let now = ready.len().min(out.len() - count);
            out.iter_mut().skip(count).zip(ready).for_each(|(to, from)| *to = *from);
            self.at += now;
            count += now;
        }
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_goes_on_behind_padding_and_white_space() {
        let decoded = |text: &str| {
            let mut out = Vec::new();
            Base64::new(text.as_bytes()).read_to_end(&mut out).map(|_| out)
        };
        // "a", "bc", "def" one after the other.
        assert_eq!(decoded("YQ==\n Ym M= \tZGVm\n").unwrap(), b"abcdef");
        assert_eq!(decoded("").unwrap(), b"");
        assert_eq!(decoded("/+8A").unwrap(), [0xff, 0xef, 0]);
        for damaged in ["YQ", "Y===", "YQ=a", "Y\u{e9}Q=", "YQ=", "="] {
            assert!(decoded(damaged).is_err(), "{damaged}");
        }
    }

    #[test]
    fn blocks_that_claim_more_than_they_can_hold_are_refused_before_memory_is_taken() {
        for codec in [Codec::Zlib, Codec::Lz4, Codec::Lzma] {
            let text = codec.unpack(&[0; 10], 1 << 40, &mut Vec::new()).unwrap_err().to_string();
            assert!(text.contains("claims"), "{text}");
        }
    }
}
