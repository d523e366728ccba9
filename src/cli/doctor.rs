//! `isolume doctor`: what is unusual about a file and what this program does about it.

use super::console::Console;
use super::input::{VolumeArgs, file_name};
use super::isovalue::Isovalue;
use super::{Failure, Outcome, input, text};
use crate::error::{Error, Result};
use crate::finding::Finding;
use crate::probe::{self, Layout, ReadOptions};
use crate::transfer::store::{self, Store, complete};
use crate::volume;
use crate::{level, volume::field};
use serde_json::{Value, json};
use std::io::Read;
use std::path::Path;

/// Say what is unusual about a volume, an environment or a store, and what is done about it
///
/// What the file is, is decided by its content. The exit code is 1 when the file cannot be read or when a store is
/// damaged, and 0 when there is nothing but remarks.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume doctor brain.nii.gz
  isolume doctor brain.nii.gz --isovalue 90
  isolume doctor sunset.exr
  isolume doctor brain.isolume --json")]
pub(super) struct Doctor {
    /// Volume file or field, environment image or sky, or store
    #[arg(value_name = "FILE")]
    input: String,
    /// Look at this isosurface of a volume: a number in the file's values, a percentage of their range, or auto
    #[arg(
        short,
        long,
        visible_alias = "isovalues",
        value_name = "C",
        default_value = "auto",
        allow_hyphen_values = true
    )]
    isovalue: Isovalue,
    /// Layout of an environment image [default: from the file and its shape]
    #[arg(long, value_name = "LAYOUT", value_parser = super::light::parse_layout)]
    layout: Option<Layout>,
    #[command(flatten)]
    volume: VolumeArgs,
}

/// Columns of text that lines are broken at.
const WIDTH: usize = text::WIDTH;

/// What a file turned out to be.
enum Kind {
    Volume,
    Probe,
    Store,
}

/// One line about the whole, the same for machines, and the findings.
struct Diagnosis {
    summary: String,
    facts: Value,
    findings: Vec<Finding>,
}

impl Doctor {
    pub(super) fn run(&self, console: &Console) -> Outcome {
        let kind = kind_of(&self.input)?;
        let (name, diagnosis) = match kind {
            Kind::Volume => ("volume", self.volume()?),
            Kind::Probe => ("probe", self.probe()?),
            Kind::Store => ("store", store_at(&self.input)?),
        };
        let Diagnosis { summary, facts, findings } = diagnosis;
        console.print(wrapped(&format!("{}: {summary}", file_name(&self.input)), "  ").trim_start());
        for finding in &findings {
            console.print("");
            console.print(lines(finding));
        }
        let ending = match findings.len() {
            0 => "nothing unusual".to_string(),
            1 => "1 finding".into(),
            n => format!("{n} findings"),
        };
        console.print(format!("\n{ending}"));
        console.print_json(&json!({
            "file": self.input, "kind": name, "summary": facts, "findings": findings,
        }));
        match findings.iter().filter(|f| f.is_damage()).count() {
            0 => Ok(()),
            _ => Err(Failure::Message(format!("{} is damaged", file_name(&self.input)))),
        }
    }

    fn volume(&self) -> Outcome<Diagnosis> {
        let mut opened = input::open(&self.input, &self.volume)?;
        let (low, high) = opened.volume.value_range();
        // An isovalue that was asked for and does not exist is a finding; `auto` finds one wherever there is one.
        let (isovalue, reason) = match opened.choose(self.isovalue) {
            Ok(chosen) => {
                opened.take_side(std::slice::from_ref(&chosen))?;
                (Some(chosen.value), chosen.reason)
            }
            Err(_) => match self.isovalue {
                Isovalue::Value(value) => (Some(value), None),
                Isovalue::Percent(part) => (Some(low + part / 100.0 * (high - low)), None),
                _ => (None, None),
            },
        };
        let volume = &*opened.volume;
        let mut findings = volume::diagnose::diagnose(volume, isovalue);
        if let Some(isovalue) = isovalue {
            findings.extend(level::diagnose::diagnose(volume, isovalue));
        }
        let [x, y, z] = volume.dims();
        let mut summary = format!(
            "a volume of {x} × {y} × {z} {}, values {} to {}",
            volume.samples().type_name(),
            text::number(low, 8),
            text::number(high, 8)
        );
        if let Some(isovalue) = isovalue {
            summary += &format!("; surface at {}", text::number(isovalue, 6));
        }
        if let Some(reason) = &reason {
            summary += &format!(" ({reason})");
        }
        let facts = json!({
            "name": volume.name, "dims": volume.dims(), "type": volume.samples().type_name(), "range": [low, high],
            "isovalue": isovalue, "isovalue_reason": reason,
        });
        Ok(Diagnosis { summary, facts, findings })
    }

    fn probe(&self) -> Result<Diagnosis> {
        let probe = match probe::by_name(&self.input)? {
            Some(probe) => probe,
            // Negative pixels are set to 0 with a note that counts them, as relight does.
            None => probe::open(&self.input, &ReadOptions { layout: self.layout, ..ReadOptions::default() })?,
        };
        let r = probe::report(&probe, 5);
        let [width, height] = probe.stored_size;
        let summary = format!(
            "an environment, {} {}, {width} × {height}, {:.1} stops, mean luminance {}",
            probe.format,
            probe.layout,
            r.range_ev,
            text::number(r.mean_luminance, 4)
        );
        let facts = json!({
            "name": probe.name, "format": probe.format, "layout": probe.layout.name(), "size": probe.stored_size,
            "range_ev": r.range_ev, "mean_luminance": r.mean_luminance, "bad_pixels": r.bad_pixels,
        });
        Ok(Diagnosis { summary, facts, findings: probe::diagnose(&probe) })
    }
}

fn store_at(argument: &str) -> Result<Diagnosis> {
    let store = Store::open(argument)?;
    let lattice = store.layout().lattice;
    let found = store::diagnose(&store, &|volume, held| complete::selection(lattice, volume, held))?;
    let identity = store.identity();
    let [x, y, z] = identity.texels;
    let bytes = crate::file::size_on_disk(Path::new(argument));
    let summary = format!(
        "a store of {x} × {y} × {z} texels, {} layers with {:?} bands, isovalues {}, {} of {} chunks sound, {}, {}",
        identity.bands.len(),
        identity.bands,
        found.held.isovalues_text(),
        found.sound,
        found.chunks,
        found.held.quality_text(),
        text::bytes(bytes as f64)
    );
    let held = &found.held;
    let isovalues = if held.all { json!("all") } else { json!(held.isovalues) };
    let facts = json!({
        "identity": identity, "chunks": found.chunks, "sound": found.sound, "bricks": found.bricks,
        "isovalues": isovalues, "rays": held.rays, "error_targets": held.targets, "bytes": bytes,
    });
    let mut findings = found.findings;
    // The other volumes of a scene.
    let volumes = store.volumes()?;
    for name in volumes.split_first().map_or(&[][..], |(_, others)| others) {
        let other = store.of_volume(name)?;
        let lattice = other.layout().lattice;
        findings.extend(store::diagnose(&other, &|volume, held| complete::selection(lattice, volume, held))?.findings);
    }
    Ok(Diagnosis { summary, facts, findings })
}

/// What an argument is: a name first, then a directory, then the first bytes of a file.
fn kind_of(argument: &str) -> Result<Kind> {
    if field::by_name(argument)?.is_some() {
        return Ok(Kind::Volume);
    }
    if probe::by_name(argument)?.is_some() {
        return Ok(Kind::Probe);
    }
    let path = Path::new(argument);
    let Ok(metadata) = path.metadata() else { return Ok(Kind::Volume) }; // It says what is missing.
    if store::is_store(argument) {
        return Ok(Kind::Store);
    }
    if !metadata.is_file() {
        return Ok(Kind::Volume);
    }
    let mut head = Vec::new();
    let file = std::fs::File::open(path).map_err(|e| Error::io(path, "open", e))?;
    file.take(8).read_to_end(&mut head).map_err(|e| Error::io(path, "read", e))?;
    Ok(match head.as_slice() {
        b"" => return Err(empty(path)),
        [0x76, 0x2f, 0x31, 0x01, ..] | [b'#', b'?', ..] | [0x89, b'P', b'N', b'G', ..] | [0xff, 0xd8, 0xff, ..] => {
            Kind::Probe
        }
        [b'P', b'K', 3, 4, ..] => Kind::Store,
        _ => Kind::Volume,
    })
}

fn empty(path: &Path) -> Error {
    let expected = "a volume, an environment image or a store";
    Error::format("file", "an empty file", expected, "check how it was written or copied").in_file(path)
}

/// A finding for people: what and how much, then, further in, what is done about it.
fn lines(finding: &Finding) -> String {
    let amount = match (finding.count, finding.of) {
        (1, 0) if finding.unit == "items" => "noticed".into(),
        (n, 0) => format!("{} {}", text::count(n), finding.unit),
        (n, of) => {
            format!("{} of {} {} ({})", text::count(n), text::count(of), finding.unit, share(finding.share()))
        }
    };
    let mut out = format!("{}: {amount}", finding.topic);
    for line in finding.found.lines() {
        out += &wrapped(line, "  ");
    }
    if !finding.handled.is_empty() {
        out += &wrapped(&format!("→ {}", finding.handled), "    ");
    }
    out
}

/// A share that is neither 0 nor 1 never reads as if it were.
fn share(share: f64) -> String {
    match 100.0 * share {
        p if p > 0.0 && p < 0.001 => "below 0.001 %".into(),
        p if p > 99.9 && p < 100.0 => "above 99.9 %".into(),
        _ => text::percent(share),
    }
}

/// Lines of at most [`WIDTH`] columns, each behind a line feed and an indent.
fn wrapped(line: &str, indent: &str) -> String {
    let mut out = String::new();
    let mut column = 0;
    for word in line.split_whitespace() {
        let length = word.chars().count();
        if column == 0 || column + 1 + length > WIDTH {
            out.push('\n');
            out.push_str(indent);
            column = indent.len();
        } else {
            out.push(' ');
            column += 1;
        }
        out.push_str(word);
        column += length;
    }
    out
}
