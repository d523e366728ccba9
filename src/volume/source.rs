//! A byte source with look-ahead, lines and tokens, that never grows beyond what it is asked for.
//! Every reader of this module works on it. Knows nothing of formats.

#![cfg_attr(not(test), deny(clippy::unwrap_used, clippy::expect_used))]

use crate::error::{Error, Result};
use crate::file::Plain;
use flate2::bufread::{MultiGzDecoder, ZlibDecoder};
use std::io::{self, BufRead, Read};

/// Bytes asked of the underlying stream at a time.
const CHUNK: usize = 64 * 1024;
/// Longest line of a text header. Real headers stay below 1 KiB; NRRD comments may hold more.
const LONGEST_LINE: usize = 64 * 1024;
/// Longest number in a text file, and the longest run of white space between two.
const LONGEST_TOKEN: usize = 128;
const LONGEST_GAP: usize = 1 << 20;
/// Deflate codes at most 258 bytes in 2 bits: no gzip file expands by more than 1032.
const DEFLATE_RATIO: u64 = 1032;

/// A buffered stream.
pub(crate) struct Source<'a> {
    inner: Box<dyn Read + 'a>,
    buffer: Vec<u8>,
    // Invariant: start <= buffer.len(); the bytes before it are consumed.
    start: usize,
    /// Upper bound of the bytes not consumed yet, where one is known.
    at_most: Option<u64>,
    /// Whether a checksum follows what is read.
    gzip: bool,
    /// Bytes that were consumed.
    consumed: u64,
    /// The file whose bytes these are, from its first one on, where samples may be read in it.
    file: Option<Plain>,
}

impl<'a> Source<'a> {
    /// A source on a stream of which the length is known or not.
    pub(crate) fn new(inner: impl Read + 'a, length: Option<u64>) -> Self {
        Self {
            inner: Box::new(inner),
            buffer: Vec::new(),
            start: 0,
            at_most: length,
            gzip: false,
            consumed: 0,
            file: None,
        }
    }

    /// A source on a plain file from its start; with `maps` samples may be read where they lie in it.
    pub(crate) fn of_file(file: Plain, length: Option<u64>, maps: bool) -> Self {
        let kept = Some(file.clone()).filter(|_| maps && length.is_some());
        Self { file: kept, ..Self::new(file, length) }
    }

    /// The decompressed content of this source, which holds gzip members from here on.
    pub(crate) fn gunzip(self) -> Self {
        let at_most = self.at_most.map(|n| n.saturating_mul(DEFLATE_RATIO));
        let mut source = Self::new(MultiGzDecoder::new(self), at_most);
        source.gzip = true;
        source
    }

    /// The decompressed content of this source, which holds gzip members or a zlib stream from here on.
    pub(crate) fn inflate(mut self) -> io::Result<Self> {
        if self.is_gzip()? {
            return Ok(self.gunzip());
        }
        let at_most = self.at_most.map(|n| n.saturating_mul(DEFLATE_RATIO));
        let mut source = Self::new(ZlibDecoder::new(self), at_most);
        source.gzip = true;
        Ok(source)
    }

    /// Whether the next bytes are a gzip header.
    pub(crate) fn is_gzip(&mut self) -> io::Result<bool> {
        Ok(self.peek(3)?.starts_with(&[0x1f, 0x8b, 8]))
    }

    /// No more than this many bytes are left, where that is known.
    pub(crate) fn at_most(&self) -> Option<u64> {
        self.at_most
    }

    /// How many bytes were consumed.
    pub(crate) fn consumed(&self) -> u64 {
        self.consumed
    }

    /// The file in which samples may be read.
    pub(super) fn file(&self) -> Option<Plain> {
        self.file.clone()
    }

    /// Consumes `count` bytes of a file without reading them.
    pub(super) fn jump(&mut self, count: u64) -> io::Result<()> {
        let target = self.consumed.checked_add(count).ok_or(io::ErrorKind::InvalidInput)?;
        if let Some(file) = &self.file {
            file.go_to(target)?;
        }
        (self.start, self.consumed) = (0, target);
        self.buffer.clear();
        self.at_most = self.at_most.map(|n| n.saturating_sub(count));
        Ok(())
    }

    /// The next `count` bytes, fewer at the end of the stream, without consuming them.
    pub(crate) fn peek(&mut self, count: usize) -> io::Result<&[u8]> {
        while self.buffer.len() - self.start < count {
            if self.start > 0 {
                self.buffer.drain(..self.start);
                self.start = 0;
            }
            if !self.fill_more()? {
                break;
            }
        }
        let end = self.buffer.len().min(self.start + count);
        Ok(&self.buffer[self.start..end])
    }

    /// Reads one piece from the stream behind the buffered bytes; false at its end.
    fn fill_more(&mut self) -> io::Result<bool> {
        let old = self.buffer.len();
        self.buffer.resize(old + CHUNK, 0);
        loop {
            match self.inner.read(&mut self.buffer[old..]) {
                Ok(n) => {
                    self.buffer.truncate(old + n);
                    return Ok(n > 0);
                }
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => {
                    self.buffer.truncate(old);
                    return Err(e);
                }
            }
        }
    }

    /// Consumes `count` bytes.
    ///
    /// # Errors
    /// A format error when the stream ends before.
    pub(crate) fn skip(&mut self, format: &'static str, count: u64, what: &str) -> Result<()> {
        if self.file.is_some() && self.at_most.is_some_and(|left| count <= left) {
            return self.jump(count).map_err(|e| Error::from_read(format, what.to_owned(), e));
        }
        let skipped = io::copy(&mut self.by_ref().take(count), &mut io::sink())
            .map_err(|e| Error::from_read(format, what.to_owned(), e))?;
        if skipped < count {
            return Err(ends_early(format, skipped, count, what));
        }
        Ok(())
    }

    /// Consumes exactly `N` bytes.
    pub(crate) fn array<const N: usize>(&mut self, format: &'static str, what: &str) -> Result<[u8; N]> {
        let mut bytes = [0; N];
        self.read_exact(&mut bytes).map_err(|e| Error::from_read(format, format!("{N} bytes of {what}"), e))?;
        Ok(bytes)
    }

    /// The next line without its end (LF or CR LF); `None` at the end of the stream. Bytes that
    /// are not UTF-8 become U+FFFD.
    pub(crate) fn line(&mut self, format: &'static str) -> Result<Option<String>> {
        let mut line = Vec::new();
        let found = (&mut *self)
            .take(LONGEST_LINE as u64)
            .read_until(b'\n', &mut line)
            .map_err(|e| Error::from_read(format, "a line of the header", e))?;
        if found == 0 {
            return Ok(None);
        }
        if line.last() == Some(&b'\n') {
            line.pop();
        } else if found == LONGEST_LINE {
            return Err(Error::format(
                format,
                format!("a header line of more than {LONGEST_LINE} bytes"),
                "short lines of text",
                "the file is damaged or not of this format",
            ));
        }
        if line.last() == Some(&b'\r') {
            line.pop();
        }
        Ok(Some(String::from_utf8_lossy(&line).into_owned()))
    }

    /// The next line, which must exist.
    pub(crate) fn expect_line(&mut self, format: &'static str, what: &str) -> Result<String> {
        self.line(format)?.ok_or_else(|| {
            Error::format(format, "the end of the file", what.to_owned(), "the file is incomplete; copy it again")
        })
    }

    /// Puts the next run of non-white bytes into `token`; false at the end of the stream.
    pub(crate) fn token(&mut self, format: &'static str, token: &mut Vec<u8>) -> Result<bool> {
        token.clear();
        let mut gap = 0usize;
        loop {
            let bytes = self.fill_buf().map_err(|e| Error::from_read(format, "a number", e))?;
            if bytes.is_empty() {
                return Ok(!token.is_empty());
            }
            let mut used = 0;
            if token.is_empty() {
                used = bytes.iter().position(|b| !is_gap(*b)).unwrap_or(bytes.len());
                gap += used;
            }
            let rest = &bytes[used..];
            let length = rest.iter().position(|b| is_gap(*b));
            let piece = &rest[..length.unwrap_or(rest.len())];
            if token.len() + piece.len() > LONGEST_TOKEN || gap > LONGEST_GAP {
                let found = if gap > LONGEST_GAP { "a megabyte of white space" } else { "something too long" };
                return Err(Error::format(
                    format,
                    format!("{found} where a number should be"),
                    "numbers separated by white space",
                    "the file is damaged or not of this format",
                ));
            }
            token.extend_from_slice(piece);
            let done = length.is_some() && !token.is_empty();
            let consumed = used + piece.len();
            self.consume(consumed);
            if done {
                return Ok(true);
            }
        }
    }

    /// After the samples: reads what little a gzip stream may still hold, so that its checksum
    /// is verified. A stream with more than that behind the samples is left alone.
    pub(crate) fn verify_end(&mut self, format: &'static str) -> Result<()> {
        if !self.gzip {
            return Ok(());
        }
        io::copy(&mut self.by_ref().take(CHUNK as u64), &mut io::sink())
            .map_err(|e| Error::from_read(format, "compressed data with a correct checksum", e))?;
        Ok(())
    }
}

fn is_gap(byte: u8) -> bool {
    byte.is_ascii_whitespace() || byte == b','
}

fn ends_early(format: &'static str, found: u64, wanted: u64, what: &str) -> Error {
    Error::format(
        format,
        format!("{found} bytes of {what} before the end of the file"),
        format!("{wanted} bytes"),
        "the file is incomplete; copy or download it again",
    )
}

impl Read for Source<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let count = if self.start < self.buffer.len() {
            let count = out.len().min(self.buffer.len() - self.start);
            out[..count].copy_from_slice(&self.buffer[self.start..self.start + count]);
            self.start += count;
            count
        } else {
            self.inner.read(out)?
        };
        self.at_most = self.at_most.map(|n| n.saturating_sub(count as u64));
        self.consumed += count as u64;
        Ok(count)
    }
}

impl BufRead for Source<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.start == self.buffer.len() {
            self.buffer.clear();
            self.start = 0;
            self.fill_more()?;
        }
        Ok(&self.buffer[self.start..])
    }

    fn consume(&mut self, count: usize) {
        self.consumed += count as u64;
        self.start = (self.start + count).min(self.buffer.len());
        self.at_most = self.at_most.map(|n| n.saturating_sub(count as u64));
    }
}

#[cfg(test)]
mod tests;
