//! A scan of XML for its elements and attributes: no entities beyond the five of XML and character references, no
//! document types, no memory beyond the text.

use crate::error::{Error, Result};

/// What a scan meets.
pub(super) enum Event<'a> {
    /// The start of an element: its name without a prefix, and its attributes as they stand.
    Start(&'a str, Attributes<'a>),
    /// The end of an element, also of one without content.
    End(&'a str),
    /// Text between tags.
    Text(&'a str),
}

/// The inside of a tag behind its name.
#[derive(Clone, Copy)]
pub(super) struct Attributes<'a>(&'a str);

impl<'a> Attributes<'a> {
    /// The value of an attribute.
    pub(super) fn get(&self, wanted: &str) -> Option<String> {
        let mut rest = self.0;
        loop {
            let (name, after) = rest.split_once('=')?;
            let after = after.trim_start();
            let quote = after.chars().next().filter(|c| ['"', '\''].contains(c))?;
            let (value, next) = after.get(1..)?.split_once(quote)?;
            if local(name.trim()) == wanted {
                return Some(unescape(value));
            }
            rest = next;
        }
    }

    /// The value of an attribute as a number; `damaged` makes the error of one that is none.
    pub(super) fn number<T: std::str::FromStr>(&self, wanted: &str, damaged: Damaged) -> Result<Option<T>> {
        let Some(text) = self.get(wanted) else { return Ok(None) };
        text.trim().parse().map(Some).map_err(|_| damaged(format!("{wanted}=\"{text}\"")))
    }
}

/// A format's error for XML that is not what it should be.
pub(super) type Damaged = fn(String) -> Error;

/// The name of a tag, without a prefix, and its attributes; `inside` lies between `<` and `>` or `/>`.
pub(super) fn split_tag(inside: &str) -> (&str, Attributes<'_>) {
    let (name, attributes) = inside.split_once(|c: char| c.is_ascii_whitespace()).unwrap_or((inside, ""));
    (local(name), Attributes(attributes))
}

/// `ome:Image` → `Image`.
pub(super) fn local(name: &str) -> &str {
    name.rsplit_once(':').map_or(name, |(_, local)| local)
}

/// Runs through a text.
///
/// # Errors
/// When a tag is not closed, or the text declares a document type, as `damaged` makes them; those of `each`.
pub(super) fn scan<'a>(text: &'a str, damaged: Damaged, each: &mut dyn FnMut(Event<'a>) -> Result<()>) -> Result<()> {
    let mut rest = text;
    while let Some(start) = rest.find('<') {
        let (before, tag) = rest.split_at(start);
        if !before.trim().is_empty() {
            each(Event::Text(before.trim()))?;
        }
        let skipped = [("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>")];
        if let Some((open, close)) = skipped.into_iter().find(|(open, _)| tag.starts_with(open)) {
            let inside = tag.get(open.len()..).unwrap_or_default();
            rest = inside.split_once(close).ok_or_else(|| damaged(format!("{open} without an end")))?.1;
            continue;
        }
        if tag.starts_with("<!") {
            return Err(damaged("a document type".into()));
        }
        let end = end_of_tag(tag).ok_or_else(|| damaged("a tag without an end".into()))?;
        let inside = tag.get(1..end).unwrap_or_default();
        rest = tag.get(end + 1..).unwrap_or_default();
        if let Some(name) = inside.strip_prefix('/') {
            each(Event::End(local(name.trim())))?;
            continue;
        }
        let (inside, is_empty) = inside.strip_suffix('/').map_or((inside, false), |inside| (inside, true));
        let (name, attributes) = split_tag(inside);
        each(Event::Start(name, attributes))?;
        if is_empty {
            each(Event::End(name))?;
        }
    }
    Ok(())
}

/// The place of the `>` that ends a tag; those in quotes do not.
fn end_of_tag(tag: &str) -> Option<usize> {
    let mut quote = None;
    for (at, byte) in tag.bytes().enumerate() {
        match (quote, byte) {
            (None, b'>') => return Some(at),
            (None, b'"' | b'\'') => quote = Some(byte),
            (Some(open), byte) if byte == open => quote = None,
            _ => {}
        }
    }
    None
}

/// Character references and the five entities of XML; others stay as they are.
fn unescape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some((before, after)) = rest.split_once('&') {
        out.push_str(before);
        let known = after.split_once(';').and_then(|(name, next)| Some((character(name)?, next)));
        match known {
            Some((c, next)) => {
                out.push(c);
                rest = next;
            }
            None => {
                out.push('&');
                rest = after;
            }
        }
    }
    out.push_str(rest);
    out
}

fn character(name: &str) -> Option<char> {
    let code = match name.strip_prefix('#') {
        None => {
            return Some(match name {
                "lt" => '<',
                "gt" => '>',
                "amp" => '&',
                "quot" => '"',
                "apos" => '\'',
                _ => return None,
            });
        }
        Some(digits) => match digits.strip_prefix(['x', 'X']) {
            Some(hex) => u32::from_str_radix(hex, 16),
            None => digits.parse(),
        },
    };
    char::from_u32(code.ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(text: &str) -> Result<Vec<String>> {
        let mut all = Vec::new();
        let damaged = |found: String| Error::format("XML", found, "XML", "");
        scan(text, damaged, &mut |event| {
            all.push(match event {
                Event::Start(name, attributes) => format!("<{name} a={:?}", attributes.get("a")),
                Event::End(name) => format!("/{name}"),
                Event::Text(text) => text.to_string(),
            });
            Ok(())
        })?;
        Ok(all)
    }

    #[test]
    fn elements_attributes_and_text() {
        let text = "<?xml?><!-- <x a='1'> --><o:A b='>' a=\"&#181;m &amp; &lt;\"><B/>t<![CDATA[<y>]]></o:A>";
        let expected = ["<A a=Some(\"µm & <\")", "<B a=None", "/B", "t", "/A"];
        assert_eq!(seen(text).unwrap(), expected);
        assert_eq!(seen("<A\n  a = '&#xB5;&unknown;'\n/>").unwrap(), ["<A a=Some(\"µ&unknown;\")", "/A"]);
    }

    #[test]
    fn what_is_damaged_is_refused_without_a_panic() {
        for text in ["<A", "<A a=\"", "<!DOCTYPE x [<!ENTITY y 'z'>]><A/>", "<!-- ", "<?xml "] {
            assert!(seen(text).is_err(), "{text}");
        }
        // Cut and bent at every place.
        let whole = "<?xml?><ä:A b='>' a=\"&#181;µ\"><B c=/>t</A>";
        for at in (0..whole.len()).filter(|&at| whole.is_char_boundary(at)) {
            let _ = seen(&whole[..at]);
            let _ = seen(&whole[at..]);
            let _ = seen(&format!("{}={}", &whole[..at], &whole[at..]));
        }
    }
}
