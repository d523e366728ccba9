//! What the chunks of a Zarr array are packed with. Each step knows how much may come out of it, so that no chunk takes more
//! memory than its array says.

use super::super::decode::Endian;
use super::{blosc, damage};
use flate2::bufread::{MultiGzDecoder, ZlibDecoder};
use std::io::Read;

/// The step's result; what is wrong as text, for the file to be named by who knows it.
pub(super) type Result<T> = std::result::Result<T, String>;

pub(super) fn damaged(text: impl Into<String>) -> String {
    text.into()
}

/// A step from bytes to bytes, by what undoes it.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Step {
    Gzip,
    Zlib,
    Zstd,
    /// LZ4 behind the length of its content.
    Lz4,
    Blosc,
    /// A checksum behind the bytes.
    Crc32c,
    /// Bytes sorted by their place in a sample of this size.
    Shuffle(usize),
}

/// How the bytes of a chunk become samples.
#[derive(Clone, Debug)]
pub(super) struct Pipeline {
    /// In the order in which they were applied.
    pub(super) steps: Vec<Step>,
    pub(super) endian: Endian,
    /// The axis of the array that runs along each axis of the stored chunk, the slowest first.
    pub(super) axes: Vec<usize>,
}

impl Pipeline {
    /// The bytes of samples, of which there are exactly `length`.
    pub(super) fn unpack(&self, bytes: Vec<u8>, length: usize) -> Result<Vec<u8>> {
        // A step in between may hold what could not be made smaller, and a header.
        let between = length.saturating_add(length / 64).saturating_add(1 << 12);
        let mut bytes = bytes;
        for (left, step) in self.steps.iter().enumerate().rev() {
            bytes = step.undo(bytes, if left == 0 { length } else { between })?;
        }
        if bytes.len() == length {
            Ok(bytes)
        } else {
            Err(damaged(format!("{} bytes of samples instead of {length}", bytes.len())))
        }
    }

    /// Bytes behind those of samples where nothing is packed: of checksums.
    pub(super) fn plain_length(&self, length: usize) -> Option<usize> {
        let more = |n: usize, step: &Step| (*step == Step::Crc32c).then(|| n.saturating_add(4));
        self.steps.iter().try_fold(length, more)
    }
}

impl Step {
    fn undo(&self, bytes: Vec<u8>, most: usize) -> Result<Vec<u8>> {
        match self {
            Self::Gzip => inflated(MultiGzDecoder::new(&bytes[..]), most, "gzip"),
            Self::Zlib => zlib(&bytes, most),
            Self::Zstd => zstd(&bytes, most),
            Self::Lz4 => {
                let (size, packed) = bytes.split_first_chunk::<4>().ok_or_else(|| damaged("LZ4 without its length"))?;
                let size = u32::from_le_bytes(*size) as usize;
                if size > most {
                    return Err(damaged(format!("LZ4 of {size} bytes, at most {most} are expected")));
                }
                lz4(packed, size)
            }
            Self::Blosc => blosc::unpack(&bytes, most),
            Self::Crc32c => {
                let (content, sum) = bytes.split_last_chunk::<4>().ok_or_else(|| damaged("no checksum"))?;
                // CRC-32C under its name in iSCSI (RFC 3720).
                let found = crc_fast::checksum(crc_fast::CrcAlgorithm::Crc32Iscsi, content) as u32;
                if found != u32::from_le_bytes(*sum) {
                    return Err(damaged("bytes that do not fit their checksum"));
                }
                Ok(content.to_vec())
            }
            Self::Shuffle(size) => Ok(blosc::unshuffled(&bytes, *size)),
        }
    }
}

fn inflated(stream: impl Read, most: usize, name: &str) -> Result<Vec<u8>> {
    let mut out = Vec::new();
    stream.take(most as u64 + 1).read_to_end(&mut out).map_err(|e| damaged(format!("damaged {name} ({e})")))?;
    if out.len() > most {
        Err(damaged(format!("{name} of more than the {most} bytes that are expected")))
    } else {
        Ok(out)
    }
}

pub(super) fn zlib(packed: &[u8], most: usize) -> Result<Vec<u8>> {
    inflated(ZlibDecoder::new(packed), most, "zlib")
}

pub(super) fn lz4(packed: &[u8], length: usize) -> Result<Vec<u8>> {
    // A byte codes at most 255.
    if length > packed.len().saturating_mul(255).saturating_add(64) {
        return Err(damaged(format!("LZ4 of {} bytes that claims to hold {length}", packed.len())));
    }
    let mut out = vec![0; length];
    match lz4_flex::block::decompress_into(packed, &mut out) {
        Ok(read) if read == length => Ok(out),
        Ok(read) => Err(damaged(format!("LZ4 of {read} bytes instead of {length}"))),
        Err(e) => Err(damaged(format!("damaged LZ4 ({e})"))),
    }
}

pub(super) fn zstd(packed: &[u8], most: usize) -> Result<Vec<u8>> {
    /// The least window that any decoder is to take (RFC 8878, 3.1.1.1.2).
    const WINDOW: u64 = 8 << 20;
    let window = (most as u64).saturating_mul(2).max(WINDOW);
    let stream = ruzstd::decoding::StreamingDecoder::new_with_max_window_size(packed, window);
    inflated(stream.map_err(|e| damaged(format!("damaged zstd ({e})")))?, most, "zstd")
}

/// Why a codec is not read, with a way out.
pub(super) fn unknown(name: &str) -> crate::error::Error {
    damage(
        format!("the codec {name}"),
        "bytes, transpose, gzip, zlib, zstd, lz4, blosc, shuffle, crc32c or sharding_indexed",
        "save it anew in Python:\n  import zarr\n  a = zarr.open(\"FILE\", mode=\"r\")\n  \
         zarr.create_array(\"OUT.zarr\", data=a[:], chunks=a.chunks)",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_step_gives_more_than_is_asked_for() {
        let zeros = vec![0u8; 1 << 20];
        let mut zlib = Vec::new();
        flate2::read::ZlibEncoder::new(&zeros[..], flate2::Compression::best()).read_to_end(&mut zlib).unwrap();
        assert_eq!(Step::Zlib.undo(zlib.clone(), 1 << 20).unwrap(), zeros);
        for most in [0, 100, (1 << 20) - 1] {
            assert!(Step::Zlib.undo(zlib.clone(), most).unwrap_err().contains("more than"));
        }
        let claims = [&u32::MAX.to_le_bytes()[..], &[0; 20]].concat();
        assert!(Step::Lz4.undo(claims.clone(), usize::MAX).unwrap_err().contains("claims"));
        assert!(Step::Lz4.undo(claims, 100).unwrap_err().contains("at most"));
    }

    #[test]
    fn checksums_are_checked() {
        // RFC 3720, B.4: 32 bytes of zeros have CRC-32C 8a9136aa.
        let sealed = [&[0; 32][..], &0x8a91_36aa_u32.to_le_bytes()].concat();
        assert_eq!(Step::Crc32c.undo(sealed.clone(), 32).unwrap(), [0; 32]);
        let mut damaged = sealed;
        damaged[3] = 1;
        assert!(Step::Crc32c.undo(damaged, 32).unwrap_err().contains("checksum"));
    }
}
