//! A strict reader of TOML: every value knows its line, and a key that nobody knows is refused.

use super::super::nearest;
use crate::error::{Error, Result};
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// The text of a scene and the name for messages.
#[derive(Clone, Copy)]
pub(super) struct Source<'a> {
    pub(super) file: &'a str,
    pub(super) text: &'a str,
}

impl<'a> Source<'a> {
    /// The document.
    pub(super) fn table(self) -> Result<Spanned<DeTable<'a>>> {
        DeTable::parse(self.text).map_err(|e| {
            let message = e.message().lines().next().unwrap_or("no TOML").to_string();
            let at = e.span().map_or(0, |span| span.start);
            self.error(at, message, "TOML", "correct the line; see examples/scenes for scenes that run")
        })
    }

    /// The line of a byte, from 1.
    pub(super) fn line(self, at: usize) -> usize {
        1 + self.text.as_bytes()[..at.min(self.text.len())].iter().filter(|&&b| b == b'\n').count()
    }

    pub(super) fn error(
        self,
        at: usize,
        found: impl Into<String>,
        expected: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Error {
        Error::format("scene", found, expected, remedy).in_file(format!("{}:{}", self.file, self.line(at)))
    }
}

/// A table of the file, all of whose keys are known.
pub(super) struct Section<'a> {
    source: Source<'a>,
    table: &'a DeTable<'a>,
    /// Its name and a dot; empty for the whole file.
    prefix: String,
}

/// Keys that scenes will have, and what takes their place until then.
pub(super) const LATER: [(&str, &str); 1] = [("caustics", "caustics by photons")];

impl<'a> Section<'a> {
    /// A table whose keys are all among `known`.
    pub(super) fn new(source: Source<'a>, table: &'a DeTable<'a>, name: &str, known: &[&str]) -> Result<Self> {
        let prefix = if name.is_empty() { String::new() } else { format!("{name}.") };
        for key in table.keys() {
            let (word, at) = (key.get_ref().as_ref(), key.span().start);
            if known.contains(&word) {
                continue;
            }
            let found = format!("the key `{prefix}{word}`");
            if let (true, Some((_, what))) = (name.is_empty(), LATER.iter().find(|(key, _)| *key == word)) {
                let expected = "volumes, walls and luminaires";
                let remedy = format!("{what} are not supported yet: take the key `{word}` out");
                return Err(source.error(at, found, expected, remedy));
            }
            let remedy = match nearest(word, known.iter().copied()) {
                Some(near) => format!("did you mean {near}?"),
                None => "take it out, or see examples/scenes".into(),
            };
            return Err(source.error(at, found, format!("one of {}", known.join(", ")), remedy));
        }
        Ok(Self { source, table, prefix })
    }

    /// The value of a key.
    pub(super) fn get(&self, key: &str) -> Option<Item<'a>> {
        let (key, value) = self.table.get_key_value(key)?;
        let name = format!("{}{}", self.prefix, key.get_ref());
        Some(Item { source: self.source, name, span: value.span(), value: value.get_ref() })
    }
}

/// Characters of a value that a message shows.
const MOST_SHOWN: usize = 60;

/// A value and where it stands.
#[derive(Clone)]
pub(super) struct Item<'a> {
    source: Source<'a>,
    pub(super) name: String,
    span: Range<usize>,
    value: &'a DeValue<'a>,
}

impl<'a> Item<'a> {
    pub(super) fn line(&self) -> usize {
        self.source.line(self.span.start)
    }

    /// Refuses the value.
    pub(super) fn refuse(&self, expected: impl Into<String>, remedy: impl Into<String>) -> Error {
        let text = self.source.text.get(self.span.clone()).unwrap_or_default();
        let line = text.lines().next().unwrap_or_default();
        let end = line.char_indices().nth(MOST_SHOWN).map_or(line.len(), |(at, _)| at);
        let first = line.get(..end).unwrap_or_default();
        let dots = if first.len() < text.len() { " …" } else { "" };
        let kind = if self.value.is_table() { "a table" } else { first };
        self.source.error(self.span.start, format!("{} = {kind}{dots}", self.name), expected, remedy)
    }

    /// A whole table.
    pub(super) fn section(&self, known: &[&str]) -> Result<Section<'a>> {
        let Some(table) = self.value.as_table() else {
            return Err(self.refuse("a table", format!("write [{}] on a line of its own", self.name)));
        };
        Section::new(self.source, table, &self.name, known)
    }

    /// The entries of a table by their keys, each with its whole name; of any keys.
    pub(super) fn entries(&self) -> Option<Vec<(String, Item<'a>)>> {
        let entry = |(key, value): (&'a Spanned<_>, &'a Spanned<DeValue<'a>>)| {
            let word: &std::borrow::Cow<'a, str> = key.get_ref();
            let name = format!("{}.{word}", self.name);
            // A table written as [a.b] spans its header; a message is to point there.
            let span = if value.get_ref().is_table() { key.span() } else { value.span() };
            (word.to_string(), Item { source: self.source, name, span, value: value.get_ref() })
        };
        self.value.as_table().map(|table| table.iter().map(entry).collect())
    }

    /// The value of a key, if this is a table that has it.
    pub(super) fn peek(&self, key: &str) -> Option<Item<'a>> {
        let value = self.value.as_table()?.get(key)?;
        Some(Item {
            source: self.source,
            name: format!("{}.{key}", self.name),
            span: value.span(),
            value: value.get_ref(),
        })
    }

    /// A finite number.
    pub(super) fn number(&self) -> Result<f64> {
        self.as_number().ok_or_else(|| self.refuse("a number", "write a number without quotes, such as 0.5"))
    }

    pub(super) fn as_number(&self) -> Option<f64> {
        let value = match self.value {
            DeValue::Integer(i) => i64::from_str_radix(i.as_str(), i.radix()).ok()? as f64,
            DeValue::Float(f) => f.as_str().parse().ok()?,
            _ => return None,
        };
        Some(value).filter(|v: &f64| v.is_finite())
    }

    /// A whole number in a range.
    pub(super) fn integer(&self, range: std::ops::RangeInclusive<u64>) -> Result<u64> {
        let expected = || format!("a whole number from {} to {}", range.start(), range.end());
        let value = self.as_number().filter(|v| *v >= 0.0 && v.fract() == 0.0 && *v < 1e15).map(|v| v as u64);
        value.filter(|v| range.contains(v)).ok_or_else(|| self.refuse(expected(), "choose a number in this range"))
    }

    pub(super) fn as_text(&self) -> Option<&'a str> {
        self.value.as_str()
    }

    /// A string.
    pub(super) fn text(&self) -> Result<&'a str> {
        self.as_text().ok_or_else(|| self.refuse("text", "write it in quotes"))
    }

    /// A string that is one of a few.
    pub(super) fn word(&self, words: &[&'static str]) -> Result<&'static str> {
        let given = self.text()?;
        words.iter().copied().find(|w| *w == given).ok_or_else(|| {
            let near = nearest(given, words.iter().copied());
            self.refuse(
                format!("one of {}", words.join(", ")),
                near.map_or("choose one of them".into(), |n| format!("did you mean {n}?")),
            )
        })
    }

    /// True or false.
    pub(super) fn boolean(&self) -> Result<bool> {
        self.value.as_bool().ok_or_else(|| self.refuse("true or false", "write it without quotes"))
    }

    /// The elements of an array.
    pub(super) fn list(&self) -> Option<Vec<Item<'a>>> {
        let element = |(i, v): (usize, &'a Spanned<DeValue<'a>>)| Item {
            source: self.source,
            name: format!("{}[{i}]", self.name),
            span: v.span(),
            value: v.get_ref(),
        };
        self.value.as_array().map(|list| list.iter().enumerate().map(element).collect())
    }

    /// The elements of an array, or the value alone.
    pub(super) fn one_or_more(&self) -> Result<Vec<Item<'a>>> {
        match self.list() {
            Some(list) if list.is_empty() => Err(self.refuse("at least one", "name one, or take the key out")),
            Some(list) => Ok(list),
            None => Ok(vec![self.clone()]),
        }
    }
}
