//! XML in a stream, tag by tag: nothing is kept but the tag at hand, so that samples between tags can be decoded where
//! they stand and a file is never held as a whole.

use super::super::super::source::Source;
use super::super::xml::local;
use super::damaged;
use crate::error::{Error, Result};
use std::io::{self, BufRead, Read};

/// Longest tag; comments and what lies between tags may be longer.
const LONGEST_TAG: usize = 64 * 1024;

/// A tag.
pub(super) enum Tag {
    /// `<name …>`: what stands between the brackets, without the slash of an element without content.
    Start { inside: String, is_empty: bool },
    /// `</name>`, without a prefix.
    End(String),
}

/// The next tag; `None` at the end of the stream. Text before it, comments and instructions are passed over.
pub(super) fn next(source: &mut Source) -> Result<Option<Tag>> {
    loop {
        if !skip_past(source, b"<")? {
            return Ok(None);
        }
        let start = source.peek(8).map_err(read_error)?;
        let skipped = [(&b"!--"[..], &b"-->"[..]), (b"![CDATA[", b"]]>"), (b"?", b"?>")];
        if let Some((open, close)) = skipped.into_iter().find(|(open, _)| start.starts_with(open)) {
            let open = open.len();
            source.consume(open);
            if !skip_past(source, close)? {
                return Err(damaged("the end of the file in a comment", "the end of it"));
            }
            continue;
        }
        if start.starts_with(b"!") {
            return Err(damaged("a document type", "none"));
        }
        return tag(source).map(Some);
    }
}

fn read_error(e: io::Error) -> Error {
    Error::from_read(super::NAME, "a tag of XML", e)
}

/// Consumes bytes up to the end of the first `mark`; false when there is none.
fn skip_past(source: &mut Source, mark: &[u8]) -> Result<bool> {
    let mut last = [0; 3];
    let kept = last.len() - mark.len();
    loop {
        let bytes = source.fill_buf().map_err(read_error)?;
        if bytes.is_empty() {
            return Ok(false);
        }
        let found = bytes.iter().position(|byte| {
            last = [last[1], last[2], *byte];
            last.get(kept..) == Some(mark)
        });
        let used = found.map_or(bytes.len(), |at| at + 1);
        source.consume(used);
        if found.is_some() {
            return Ok(true);
        }
    }
}

/// The tag whose `<` was consumed; a `>` in quotes does not end it.
fn tag(source: &mut Source) -> Result<Tag> {
    let (mut inside, mut quote) = (Vec::new(), None);
    loop {
        let bytes = source.fill_buf().map_err(read_error)?;
        if bytes.is_empty() {
            return Err(damaged("the end of the file in a tag", "a whole file"));
        }
        let end = bytes.iter().position(|&byte| {
            match (quote, byte) {
                (None, b'>') => return true,
                (None, b'"' | b'\'') => quote = Some(byte),
                (Some(open), byte) if byte == open => quote = None,
                _ => {}
            }
            false
        });
        let used = end.unwrap_or(bytes.len());
        inside.extend_from_slice(bytes.get(..used).unwrap_or_default());
        source.consume(used + usize::from(end.is_some()));
        if inside.len() > LONGEST_TAG {
            return Err(damaged(format!("a tag of more than {LONGEST_TAG} bytes"), "short tags"));
        }
        if end.is_some() {
            break;
        }
    }
    let inside = String::from_utf8_lossy(&inside).into_owned();
    if let Some(name) = inside.strip_prefix('/') {
        return Ok(Tag::End(local(name.trim()).into()));
    }
    Ok(match inside.strip_suffix('/') {
        Some(inside) => Tag::Start { inside: inside.into(), is_empty: true },
        None => Tag::Start { inside, is_empty: false },
    })
}

/// The text up to the next tag, as a stream of its own. The end of the file is no end of it: a number or a byte might
/// be cut there.
pub(super) struct Text<'s, 'a>(pub(super) &'s mut Source<'a>);

impl BufRead for Text<'_, '_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        let bytes = self.0.fill_buf()?;
        if bytes.is_empty() {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        let end = bytes.iter().position(|b| *b == b'<').unwrap_or(bytes.len());
        Ok(bytes.get(..end).unwrap_or_default())
    }

    fn consume(&mut self, count: usize) {
        self.0.consume(count);
    }
}

impl Read for Text<'_, '_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(out)?;
        self.consume(count);
        Ok(count)
    }
}
