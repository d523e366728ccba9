//! `isolume info`: what is in a volume or a store.

use crate::cli::args::volume::VolumeArgs;
use crate::cli::commands::watch::follow;
use crate::cli::failure::Outcome;
use crate::cli::present::console::Console;
use crate::cli::present::text;
use crate::error::Error;
use crate::file::file_name;
use crate::inspect::{StoreFacts, VolumeFacts, solid_text};
use crate::scene::Member;
use crate::transfer::store::is_store;
use crate::volume::Volume;
use crate::volume::isovalue::Chosen;
use std::time::Duration;

/// Show what is in a volume or a transfer store
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  isolume info brain.nii.gz\n  isolume info brain.isolume --json")]
pub(in crate::cli) struct Info {
    /// Volume file, field such as gyroid:128, or store
    #[arg(value_name = "VOLUME|X.isolume")]
    input: String,
    #[command(flatten)]
    volume: VolumeArgs,
    /// Follow the bake of a store, by however many processes: what all have done, what is left, the rate. Ends when all is there
    #[arg(long)]
    watch: bool,
    /// Seconds between two looks
    #[arg(long, value_name = "S", default_value_t = 2.0, requires = "watch", value_parser = parse_seconds)]
    every: f64,
}

/// Metres in the atomic unit of length (CODATA 2018).
const BOHR: f64 = 5.291_772_109_03e-11;

impl Info {
    pub(in crate::cli) fn run(&self, console: &Console) -> Outcome {
        if is_store(&self.input) {
            self.volume.options().refuse_for("a store")?;
            if self.watch {
                return follow(&self.input, Duration::from_secs_f64(self.every), console);
            }
            return store(&self.input, !self.volume.no_map, console);
        }
        if self.watch {
            let remedy = "give the store that is baked: isolume info X.isolume --watch";
            return Err(Error::argument("--watch", &self.input, "a transfer store", remedy).into());
        }
        let mut options = self.volume.options();
        // Of several channels the first is looked at, where none is chosen.
        options.choice.any_channel = true;
        let opened = Member::open(&self.input, &options)?;
        let volume = &opened.volume;
        let (low, high) = volume.value_range();
        let facts = VolumeFacts::of(&opened);
        let mut rows = volume_rows(volume);
        rows.push(row("values", format!("{} to {}", text::number(low, 8), text::number(high, 8))));
        rows.push(row("histogram", text::sparkline(&facts.histogram)));
        rows.push(row("", "square root of the counts, over the range of the values".into()));
        if let Some(chosen) = &facts.suggested {
            rows.extend(isovalue_rows(chosen));
        }
        if let Some(e) = &facts.estimate {
            rows.push(row("memory", format!("{} to bake with the default options", text::bytes(e.memory as f64))));
            rows.push(row(
                "store",
                format!(
                    "{} for all isovalues, {} for the suggested one",
                    text::bytes(e.all as f64),
                    text::bytes(e.one as f64)
                ),
            ));
        }
        for (what, list, option) in volume.series.choices() {
            let list = format!("{list}; choose with --{option}");
            rows.extend(list.lines().enumerate().map(|(i, line)| row(if i == 0 { what } else { "" }, line.into())));
        }
        for note in &volume.notes {
            rows.push(row("note", note.text.clone()));
        }
        console.print(text::table(&rows));
        console.print_json(&facts.to_json(volume));
        Ok(())
    }
}

/// Reads a number of seconds.
fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (0.01..=3600.0).contains(&seconds) => Ok(seconds),
        _ => Err("give seconds from 0.01 to 3600".into()),
    }
}

fn row(name: &str, value: String) -> Vec<String> {
    vec![name.into(), value]
}

/// What `auto` takes, and what else could be given.
fn isovalue_rows(chosen: &Chosen) -> Vec<Vec<String>> {
    let reason = chosen.reason.as_deref().unwrap_or_default();
    let more: Vec<String> = chosen.more.iter().map(|level| text::number(level.value, 6)).collect();
    let all = std::iter::once(text::number(chosen.value, 6)).chain(more).collect::<Vec<_>>().join(", ");
    let mut rows = vec![row("isovalue", all), row("", reason.into())];
    let others = chosen.alternatives.iter().map(|a| format!("{} = {}", a.name, text::number(a.level.value, 6)));
    let others: Vec<String> = others.collect();
    if !others.is_empty() {
        rows.push(row("or", others.join(", ")));
    }
    rows.extend(chosen.warning.iter().map(|warning| row("warning", warning.clone())));
    rows
}

fn volume_rows(volume: &Volume) -> Vec<Vec<String>> {
    let d = volume.dims();
    let spacing = volume.world_from_grid().spacing();
    let bounds = volume.world_bounds();
    let point = |p: glam::DVec3| format!("({})", p.to_array().map(|v| text::number(v, 6)).join(", "));
    let unit = match volume.unit.metres() {
        None => "units the file does not name".into(),
        Some(1e-3) => "mm".to_string(),
        Some(1e-6) => "µm".into(),
        Some(1e-10) => "Å".into(),
        Some(m) if (m - BOHR).abs() < 1e-6 * BOHR => "bohr".into(),
        Some(m) => format!("× {} m", text::number(m, 6)),
    };
    let scaling = match (volume.slope(), volume.inter()) {
        (1.0, 0.0) => String::new(),
        (slope, inter) => {
            let [slope, inter] = [slope, inter].map(|v| text::number(v, 12));
            format!(", value = {slope} · sample + {inter}")
        }
    };
    let hand = if volume.world_from_grid().is_left_handed() { "left-handed grid" } else { "right-handed grid" };
    let front = if volume.up.is_anatomical() { ", anterior (+y) is the front" } else { "" };
    vec![
        row("name", volume.name.clone()),
        row("samples", format!("{} × {} × {} {}{scaling}", d[0], d[1], d[2], volume.samples().type_name())),
        row(
            "spacing",
            format!(
                "{} × {} × {} {unit}",
                text::number(spacing.x, 6),
                text::number(spacing.y, 6),
                text::number(spacing.z, 6)
            ),
        ),
        row("world box", format!("{} to {}", point(bounds.min), point(bounds.max))),
        row("orientation", format!("{hand}, {} is up{front}; solid is {}", volume.up.name(), solid_text(volume.solid))),
    ]
}

fn store(argument: &str, maps: bool, console: &Console) -> Outcome {
    let facts = StoreFacts::of(argument, maps)?;
    let StoreFacts { store, volume, held, volumes, complete, .. } = &facts;
    let (identity, m) = (store.identity(), store.identity().texels);
    let mut rows = volume_rows(volume);
    rows.extend(store.samples_file().map(|file| row("samples in", file.display().to_string())));
    let adaptive = identity.adaptive.map_or(String::new(), |error| {
        format!(", of which those are interpolated that may be, with an error of {}", text::percent(error))
    });
    rows.push(row("texture", format!("{} × {} × {} texels{adaptive}", m[0], m[1], m[2])));
    rows.push(row("layers", format!("{} with {:?} bands", identity.bands.len(), identity.bands)));
    let sign = if identity.positive { ", positive" } else { "" };
    rows.push(row("estimator", format!("{}{sign}, seed {}", identity.estimator, identity.seed)));
    if let Some(scene) = &identity.scene {
        let names = if scene.luminaires.is_empty() { "none".into() } else { scene.luminaires.join(", ") };
        rows.push(row("scene", format!("red, green and blue among walls or luminaires; luminaires: {names}")));
    }
    if let Some(coupling) = identity.scene.as_ref().and_then(|scene| scene.coupling.as_ref()) {
        let others: Vec<&str> = coupling.partners.iter().map(|p| p.name.as_str()).collect();
        let held = volumes.join(", ");
        rows.push(row(
            "volumes",
            format!("{held}; {} lit with {}: {}", coupling.name, others.join(", "), coupling.coupling),
        ));
    }
    rows.push(row("isovalues", held.isovalues_text()));
    for &(isovalue, vertices) in &facts.surfaces {
        let count = text::count(vertices);
        rows.push(row("surface", format!("isovalue {}: {count} vertices", text::number(isovalue, 8))));
    }
    let all = facts.chunks;
    let state = match complete.there == complete.needed {
        true => format!("{} of {all} chunks, all that were asked for", held.chunks),
        false => format!("{} of {} chunks that were asked for: incomplete", complete.there, complete.needed),
    };
    rows.push(row("baked", format!("{state}, {}", text::bytes(facts.bytes as f64))));
    rows.push(row("quality", held.quality_text()));
    rows.extend(crate::cli::commands::pack::about(store)?.iter().map(|(name, text)| row(name, text.clone())));
    console.print(text::table(&rows));
    console.print_json(&facts.to_json(&file_name(argument)));
    Ok(())
}
