//! A TIFF file whose first directory is another one of its own: so that the decoder, which walks the chain of pages, also reads
//! those that hang below a page.

use std::io::{Read, Result, Seek, SeekFrom};

/// The file, with another place of the first directory in its header.
pub(super) struct Directed<R> {
    file: R,
    place: u64,
    at: u64,
}

impl<R: Read + Seek> Directed<R> {
    pub(super) fn new(file: R, place: u64) -> Self {
        // Every reader of TIFF begins at the header.
        Self { file, place, at: u64::MAX }
    }

    /// The first 16 bytes with the place in them: in BigTIFF (43) 8 bytes at 8, else 4 at 4.
    fn header(&mut self) -> Result<[u8; 16]> {
        self.file.rewind()?;
        let mut header = [0; 16];
        let mut found = 0;
        while let Some(rest) = header.get_mut(found..).filter(|rest| !rest.is_empty()) {
            match self.file.read(rest)? {
                0 => break,
                n => found += n,
            }
        }
        let is_big_endian = header.starts_with(b"MM");
        let is_wide = header.get(2..4) == Some(if is_big_endian { &[0, 43] } else { &[43, 0] });
        let [a, b, c, d, e, f, g, h] = self.place.to_be_bytes();
        let place: &[u8] = if is_wide { &[a, b, c, d, e, f, g, h] } else { &[e, f, g, h] };
        let start = if is_wide { 8 } else { 4 };
        for (i, byte) in place.iter().enumerate() {
            let i = if is_big_endian { i } else { place.len() - 1 - i };
            if let Some(to) = header.get_mut(start + i) {
                *to = *byte;
            }
        }
        Ok(header)
    }
}

impl<R: Read + Seek> Read for Directed<R> {
    fn read(&mut self, out: &mut [u8]) -> Result<usize> {
        if self.at == u64::MAX {
            self.at = self.file.stream_position()?;
        }
        if self.at < 16 {
            let header = self.header()?;
            let rest = header.get(self.at as usize..).unwrap_or_default();
            let count = rest.len().min(out.len());
            out.iter_mut().zip(rest).for_each(|(to, from)| *to = *from);
            self.at += count as u64;
            self.file.seek(SeekFrom::Start(self.at))?;
            return Ok(count);
        }
        let count = self.file.read(out)?;
        self.at += count as u64;
        Ok(count)
    }
}

impl<R: Read + Seek> Seek for Directed<R> {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        self.at = self.file.seek(to)?;
        Ok(self.at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    #[test]
    fn the_header_names_another_directory() {
        let read = |file: &[u8], place| {
            let mut directed = Directed::new(Cursor::new(file.to_vec()), place);
            let mut all = Vec::new();
            directed.rewind().unwrap();
            directed.read_to_end(&mut all).unwrap();
            all
        };
        let little = [b"II*\0\x08\0\0\0".as_slice(), &[7; 12]].concat();
        assert_eq!(read(&little, 0x0102_0304), [b"II*\0\x04\x03\x02\x01".as_slice(), &[7; 12]].concat());
        let big = [b"MM\0\x2b\0\x08\0\0\0\0\0\0\0\0\0\x10".as_slice(), &[7; 4]].concat();
        assert_eq!(read(&big, 300)[8..], [0, 0, 0, 0, 0, 0, 1, 44, 7, 7, 7, 7]);
        assert_eq!(read(&big, 300)[..8], big[..8]);
    }
}
