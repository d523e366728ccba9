//! Blosc 1 chunks, by hand: the crates that read them bind the C library. Format: "c-blosc/README_CHUNK_FORMAT.rst" and
//! "README_HEADER.rst"; the streams of blosclz are those of FastLZ, level 2 (A. Hidayat).
//!
//! A header of 16 bytes, the places of the blocks, and in each block one stream, or one for each byte of a sample.

use super::codec::{Result, damaged, lz4, zlib, zstd};

/// Bytes of the header.
const HEADER: usize = 16;

/// The content of a chunk, of at most `most` bytes.
pub(super) fn unpack(packed: &[u8], most: usize) -> Result<Vec<u8>> {
    let header = packed.first_chunk::<HEADER>().ok_or_else(|| damaged("a Blosc chunk of less than 16 bytes"))?;
    let [version, _, flags, type_size, n0, n1, n2, n3, b0, b1, b2, b3, c0, c1, c2, c3] = *header;
    let [size, block, whole] =
        [[n0, n1, n2, n3], [b0, b1, b2, b3], [c0, c1, c2, c3]].map(|b| u32::from_le_bytes(b) as usize);
    if !(1..=2).contains(&version) {
        return Err(damaged(format!("a Blosc chunk of version {version}; 1 and 2 are read")));
    }
    if size > most || whole != packed.len() || type_size == 0 {
        let sizes = format!("{whole} bytes with {size} in them");
        return Err(damaged(format!(
            "a Blosc chunk of {sizes}; it has {} and at most {most} are expected",
            packed.len()
        )));
    }
    if flags & 2 != 0 {
        let plain = packed.get(HEADER..HEADER + size).ok_or_else(|| damaged("a Blosc chunk that ends early"))?;
        return Ok(plain.to_vec());
    }
    if size == 0 {
        return Ok(Vec::new());
    }
    if block == 0 || block > size.next_multiple_of(usize::from(type_size)) {
        return Err(damaged(format!("Blosc blocks of {block} bytes in {size}")));
    }
    let chunk = Chunk { packed, flags, type_size: type_size.into() };
    let mut out = Vec::new();
    for at in 0..size.div_ceil(block) {
        let length = block.min(size - at * block);
        let place = chunk.number(HEADER + 4 * at)?;
        out.extend(chunk.block(place, length, length < block)?);
    }
    Ok(out)
}

struct Chunk<'a> {
    packed: &'a [u8],
    flags: u8,
    type_size: usize,
}

impl Chunk<'_> {
    /// A number of four bytes, from 0.
    fn number(&self, at: usize) -> Result<usize> {
        let bytes = self.packed.get(at..).and_then(|rest| rest.first_chunk::<4>());
        let number = bytes.map(|b| i32::from_le_bytes(*b)).and_then(|n| usize::try_from(n).ok());
        number.ok_or_else(|| damaged("a Blosc chunk that ends early"))
    }

    /// The block at a place, its filter undone.
    fn block(&self, mut at: usize, length: usize, is_rest: bool) -> Result<Vec<u8>> {
        let is_split = self.flags & 0x10 == 0 && !is_rest && length.is_multiple_of(self.type_size);
        let streams = if is_split { self.type_size } else { 1 };
        let of_each = length / streams;
        let mut plain = Vec::new();
        for _ in 0..streams {
            let packed = self.number(at)?;
            at += 4;
            let bytes = self.packed.get(at..).and_then(|rest| rest.get(..packed));
            let bytes = bytes.ok_or_else(|| damaged("a Blosc chunk that ends early"))?;
            at += packed;
            // What does not become smaller is kept as it is.
            if packed == of_each { plain.extend_from_slice(bytes) } else { plain.extend(self.stream(bytes, of_each)?) }
        }
        if self.flags & 1 != 0 && self.type_size > 1 {
            return Ok(unshuffled(&plain, self.type_size));
        }
        let is_whole = (plain.len() / self.type_size).is_multiple_of(8);
        Ok(if self.flags & 4 != 0 && is_whole { bits_unshuffled(&plain, self.type_size) } else { plain })
    }

    /// The content of a stream of exactly `length` bytes.
    fn stream(&self, packed: &[u8], length: usize) -> Result<Vec<u8>> {
        let out = match self.flags >> 5 {
            0 => blosclz(packed, length)?,
            1 => lz4(packed, length)?,
            3 => zlib(packed, length)?,
            4 => zstd(packed, length)?,
            2 => return Err(damaged("Blosc with Snappy, which is not read")),
            other => return Err(damaged(format!("Blosc with the unknown compressor {other}"))),
        };
        if out.len() == length {
            Ok(out)
        } else {
            Err(damaged(format!("a Blosc stream of {} bytes instead of {length}", out.len())))
        }
    }
}

/// Bytes that were sorted by their place in a sample, back in their samples; what is no whole sample follows.
pub(super) fn unshuffled(bytes: &[u8], size: usize) -> Vec<u8> {
    let count = bytes.len() / size;
    let mut out = bytes.to_vec();
    for (place, plane) in bytes.chunks_exact(count.max(1)).take(size).enumerate() {
        out.iter_mut().skip(place).step_by(size).zip(plane).for_each(|(to, from)| *to = *from);
    }
    out
}

/// Bits that were sorted by their place in a sample, back in their samples, of which there are a multiple of 8.
fn bits_unshuffled(bytes: &[u8], size: usize) -> Vec<u8> {
    let count = bytes.len() / size;
    let mut out = bytes.to_vec();
    out.iter_mut().take(count * size).for_each(|byte| *byte = 0);
    for (place, plane) in bytes.chunks_exact((count / 8).max(1)).take(8 * size).enumerate() {
        let samples = out.iter_mut().skip(place / 8).step_by(size);
        for (i, to) in samples.take(count).enumerate() {
            *to |= (plane.get(i / 8).copied().unwrap_or(0) >> (i % 8) & 1) << (place % 8);
        }
    }
    out
}

/// FastLZ, level 2: literal runs of up to 32 bytes, and matches of 3 bytes or more at up to 73,725 bytes before.
fn blosclz(packed: &[u8], most: usize) -> Result<Vec<u8>> {
    /// Beyond this distance two more bytes give it.
    const FAR: usize = 8191;
    let ends = || damaged("a stream of blosclz that ends early");
    let mut bytes = packed.iter().copied();
    let mut out = Vec::new();
    let mut next = bytes.next().map(|first| first & 31);
    while let Some(control) = next {
        if control < 32 {
            for _ in 0..=control {
                out.push(bytes.next().ok_or_else(ends)?);
            }
        } else {
            let (mut length, high) = (usize::from(control >> 5) + 2, usize::from(control & 31) << 8);
            if control >> 5 == 7 {
                loop {
                    let more = bytes.next().ok_or_else(ends)?;
                    length += usize::from(more);
                    if more != 255 {
                        break;
                    }
                }
            }
            let low = usize::from(bytes.next().ok_or_else(ends)?);
            let mut back = high + low + 1;
            if low == 255 && high == 31 << 8 {
                let [far, near] = [bytes.next().ok_or_else(ends)?, bytes.next().ok_or_else(ends)?];
                back = usize::from(u16::from_be_bytes([far, near])) + FAR + 1;
            }
            let start =
                out.len().checked_sub(back).ok_or_else(|| damaged("blosclz that points before its beginning"))?;
            if out.len() + length > most {
                return Err(damaged("blosclz that is longer than it says"));
            }
            (start..start + length).for_each(|i| out.push(out.get(i).copied().unwrap_or(0)));
        }
        if out.len() > most {
            return Err(damaged("blosclz that is longer than it says"));
        }
        next = bytes.next();
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_are_undone() {
        // Three samples of two bytes, and one byte more.
        assert_eq!(unshuffled(&[1, 3, 5, 2, 4, 6, 9], 2), [1, 2, 3, 4, 5, 6, 9]);
        // Eight samples of one byte: bit b of sample i lies in bit i of byte b.
        let samples = [0x01, 0x80, 0xff, 0, 0x10, 0x0f, 0xf0, 0xaa];
        let planes: Vec<u8> =
            (0..8).map(|b| (0..8).fold(0, |byte, i| byte | (samples[i as usize] >> b & 1) << i)).collect();
        assert_eq!(bits_unshuffled(&planes, 1), samples);
    }

    #[test]
    fn blosclz_repeats_and_reaches_back() {
        // "abc", then 6 bytes from 3 before, then one byte 4 times: a match that overlaps itself.
        let packed = [2, b'a', b'b', b'c', 4 << 5, 2, 0, b'x', 1 << 5, 0];
        assert_eq!(blosclz(&packed, 100).unwrap(), b"abcabcabcxxxx");
        for damaged in [&[5, 1][..], &[0, 1, 2 << 5, 9], &[0, 1, 7 << 5, 255], &[0, 1, 7 << 5, 200, 0]] {
            assert!(blosclz(damaged, 100).is_err(), "{damaged:?}");
        }
    }
}
