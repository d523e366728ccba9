//! `isolume verify`: whether stores are whole, by exit code.

use crate::cli::failure::{Failure, Outcome};
use crate::cli::present::console::Console;
use crate::cli::present::text;
use crate::error::Error;
use crate::finding::Finding;
use crate::inspect::diagnose_volumes;
use crate::transfer::store::{Diagnosis, Store};
use serde_json::json;
use std::path::PathBuf;

/// Read every byte of stores and compare it with its checksums
///
/// The exit code is 0 when all are sound and 1 when one is damaged. Chunks that were not baked yet are no damage;
/// --complete asks for them too.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume verify brain.isolume
  isolume verify --complete shares/*.isolume && isolume merge shares/*.isolume -o brain.isolume")]
pub(in crate::cli) struct Verify {
    /// Stores
    #[arg(value_name = "X.isolume", required = true)]
    inputs: Vec<PathBuf>,
    /// Fail as well where an isosurface that the store holds lacks chunks
    #[arg(long)]
    complete: bool,
}

/// Topics that say that something was not baked.
const UNFINISHED: [&str; 3] = ["holes", "missing bricks", "nothing baked"];

impl Verify {
    pub(in crate::cli) fn run(&self, console: &Console) -> Outcome {
        let (mut rows, mut bad) = (Vec::new(), Vec::new());
        for path in &self.inputs {
            let name = path.display().to_string();
            let opened = Store::open_telling(path, true, |note| console.note(note));
            let (found, chunks, sound) = match opened.and_then(|store| diagnose_volumes(&store)) {
                Ok(all) => {
                    let sum = |of: fn(&Diagnosis) -> u64| all.iter().map(of).sum::<u64>();
                    let (chunks, sound) = (sum(|d| d.chunks), sum(|d| d.sound));
                    let findings: Vec<Finding> = all.into_iter().flat_map(|d| d.findings).collect();
                    (findings, chunks, sound)
                }
                Err(error @ (Error::Format { .. } | Error::Limit { .. })) => {
                    let found = Finding::new("damaged metadata", (1, 0, "files"), error.to_string(), "");
                    (vec![found.damage()], 0, 0)
                }
                Err(other) => return Err(other.into()),
            };
            let counts = |f: &&Finding| f.is_damage() || self.complete && UNFINISHED.contains(&f.topic);
            let wrong: Vec<&Finding> = found.iter().filter(counts).collect();
            let state = if wrong.is_empty() { "sound" } else { "NOT sound" };
            console.print(format!("{name}: {state}, {} of {} chunks", text::count(sound), text::count(chunks)));
            for finding in &wrong {
                console.print(format!("  {}: {}", finding.topic, finding.found.replace('\n', "\n    ")));
            }
            rows.push(json!({
                "store": name, "sound": wrong.is_empty(), "chunks": chunks, "sound_chunks": sound, "findings": found,
            }));
            if !wrong.is_empty() {
                bad.push(name);
            }
        }
        console.print_json(&json!({ "stores": rows }));
        if bad.is_empty() {
            return Ok(());
        }
        let remedy = "run the bake that made it again to mend it";
        Err(Failure::Message(format!("{} of {} stores not sound: {remedy}", bad.len(), self.inputs.len())))
    }
}
