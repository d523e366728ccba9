//! `isolume doctor`: what is unusual about a file and what this program does about it.

use crate::cli::args::volume::VolumeArgs;
use crate::cli::failure::{Failure, Outcome};
use crate::cli::present::console::Console;
use crate::cli::present::text;
use crate::file::file_name;
use crate::finding::Finding;
use crate::inspect::{Diagnosed, Looked};
use crate::probe::Layout;
use crate::volume::Isovalue;
use serde_json::json;

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
pub(in crate::cli) struct Doctor {
    /// Volume file or field, environment image or sky, or store
    #[arg(value_name = "FILE")]
    input: String,
    /// Look at this isosurface of a volume: a number in the file's values, a percentage of their range, or auto
    #[arg(short, long, visible_alias = "isovalues", value_name = "C")]
    #[arg(default_value = "auto", allow_hyphen_values = true)]
    isovalue: Isovalue,
    /// Layout of an environment image [default: from the file and its shape]
    #[arg(long, value_name = "LAYOUT", value_parser = crate::cli::args::light::parse_layout)]
    layout: Option<Layout>,
    #[command(flatten)]
    volume: VolumeArgs,
}

impl Doctor {
    pub(in crate::cli) fn run(&self, console: &Console) -> Outcome {
        let found = Diagnosed::of(&self.input, &self.volume.options(), self.isovalue, self.layout)?;
        let (name, findings) = (file_name(&self.input), &found.findings);
        console.print(wrapped(&format!("{name}: {}", summary(&found.looked)), "  ").trim_start());
        for finding in findings {
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
            "file": self.input, "kind": found.kind(), "summary": found.facts(), "findings": findings,
        }));
        match findings.iter().any(Finding::is_damage) {
            false => Ok(()),
            true => Err(Failure::Message(format!("{name} is damaged"))),
        }
    }
}

/// One line about the whole.
fn summary(looked: &Looked) -> String {
    match looked {
        Looked::Volume { member, isovalue, reason } => {
            let ([x, y, z], (low, high)) = (member.volume.dims(), member.volume.value_range());
            let [low, high] = [low, high].map(|v| text::number(v, 8));
            let at = isovalue.map(|c| format!("; surface at {}", text::number(c, 6))).unwrap_or_default();
            let why = reason.as_ref().map(|reason| format!(" ({reason})")).unwrap_or_default();
            let kind = member.volume.samples().type_name();
            format!("a volume of {x} × {y} × {z} {kind}, values {low} to {high}{at}{why}")
        }
        Looked::Probe(looked) => {
            let (probe, r) = &**looked;
            let [width, height] = probe.stored_size;
            format!(
                "an environment, {} {}, {width} × {height}, {:.1} stops, mean luminance {}",
                probe.format,
                probe.layout,
                r.range_ev,
                text::number(r.mean_luminance, 4)
            )
        }
        Looked::Store(store, found, bytes) => {
            let identity = store.identity();
            let [x, y, z] = identity.texels;
            format!(
                "a store of {x} × {y} × {z} texels, {} layers with {:?} bands, isovalues {}, {} of {} chunks sound, {}, {}",
                identity.bands.len(),
                identity.bands,
                found.held.isovalues_text(),
                found.sound,
                found.chunks,
                found.held.quality_text(),
                text::bytes(*bytes as f64)
            )
        }
    }
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

/// Lines of at most [`text::WIDTH`] columns, each behind a line feed and an indent.
fn wrapped(line: &str, indent: &str) -> String {
    let words = line.split_whitespace().collect::<Vec<_>>().join(" ");
    format!(
        "
{indent}{}",
        text::wrapped(&words, indent.len(), indent.len())
    )
}
