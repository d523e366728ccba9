//! How stable the tracer is on volumes and rays that break tracers, and how stable the usual ones are.
//!
//! cargo run --release --example measure-stability -- [RAYS [DIR]]
//!
//! RAYS per volume and family of rays [default: 30000, more than 10⁷ in all]; DIR gets `ours.csv` (volume × family,
//! every ray) and `variants.csv` (volume × variant, every tenth ray that leaves its own surface on the lit side).
//! The program fails when one answer of ours is wrong.

#[path = "../../tests/common/cases.rs"]
mod cases;
#[path = "../../tests/common/oracle.rs"]
mod oracle;
#[path = "../../tests/common/rays.rs"]
mod rays;
#[path = "../../tests/common/stability.rs"]
mod stability;
#[path = "../../tests/common/twins.rs"]
mod twins;

use rays::Family;
use stability::{Entry, Tally, run};
use std::fmt::Write as _;
use std::path::PathBuf;
use twins::TWINS;

/// Every so many rays the twins trace one, too.
const STRIDE: u64 = 10;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let rays: u64 = arguments.next().map_or(Ok(30_000), |n| n.parse())?;
    let folder = arguments.next().map(PathBuf::from);

    let mut entries: Vec<Entry> = Vec::new();
    for (name, volume) in cases::ray_volumes() {
        for family in Family::ALL {
            let entry = run(&name, &volume, family, 2026, rays, STRIDE);
            if let Some(wrong) = &entry.first_wrong {
                println!("WRONG: {name}, {}: {wrong}", family.name());
            }
            entries.push(entry);
        }
    }

    println!("{:<34}{}", "ours, all rays", HEAD);
    for family in Family::ALL {
        println!("{:<34}{}", family.name(), row(&sum(&entries, |e| (e.family == family).then_some(&e.all))));
    }
    let all = sum(&entries, |e| Some(&e.all));
    println!("{:<34}{}\n", "together", row(&all));
    println!("{:<34}{}", "rays that leave on the lit side", HEAD);
    println!("{:<34}{}", "sign carry (ours)", row(&sum(&entries, |e| Some(&e.lit))));
    for (i, twin) in TWINS.iter().enumerate() {
        println!("{:<34}{}", twin.name, row(&sum(&entries, |e| e.twins.get(i))));
    }

    if let Some(folder) = folder {
        std::fs::create_dir_all(&folder)?;
        std::fs::write(folder.join("ours.csv"), ours_csv(&entries))?;
        std::fs::write(folder.join("variants.csv"), variants_csv(&entries))?;
    }
    match all.wrong() {
        0 => Ok(()),
        wrong => Err(format!("{wrong} wrong answers").into()),
    }
}

fn sum<'a>(entries: &'a [Entry], pick: impl Fn(&'a Entry) -> Option<&'a Tally>) -> Tally {
    let mut total = Tally::default();
    entries.iter().filter_map(pick).for_each(|t| total.add(t));
    total
}

const HEAD: &str = "      rays      hits      lost  grazing at start    leaks     late self-hit   ghosts      NaN   buried  largest error";

/// What is counted, in the order of the columns.
fn counts(t: &Tally) -> [u64; 11] {
    [
        t.rays,
        t.hits,
        t.lost,
        t.grazing,
        t.grazing_starts,
        t.leaks,
        t.late,
        t.self_hits,
        t.ghosts,
        t.not_a_number,
        t.buried,
    ]
}

fn row(t: &Tally) -> String {
    let [rays, hits, lost, rest @ ..] = counts(t);
    let rest: String = rest.iter().map(|n| format!("{n:>9}")).collect();
    format!("{rays:>10}{hits:>10}{lost:>10}{rest}{:>15.2e}", t.worst)
}

const COLUMNS: &str =
    "rays,hits,lost,grazing,grazing_at_start,leaks,late,self_hits,ghosts,nan,buried,largest_error_voxels";

fn cells(t: &Tally) -> String {
    let list: Vec<String> = counts(t).iter().map(u64::to_string).collect();
    format!("{},{:e}", list.join(","), t.worst)
}

fn ours_csv(entries: &[Entry]) -> String {
    let mut text = format!("volume,family,{COLUMNS}\n");
    for e in entries {
        let _ = writeln!(text, "\"{}\",{},{}", e.volume, e.family.name(), cells(&e.all));
    }
    text
}

fn variants_csv(entries: &[Entry]) -> String {
    let mut text = format!("volume,variant,{COLUMNS}\n");
    for of_volume in entries.chunk_by(|a, b| a.volume == b.volume) {
        let name = &of_volume[0].volume;
        let _ = writeln!(text, "\"{name}\",\"sign carry (ours)\",{}", cells(&sum(of_volume, |e| Some(&e.lit))));
        for (i, twin) in TWINS.iter().enumerate() {
            let _ = writeln!(text, "\"{name}\",\"{}\",{}", twin.name, cells(&sum(of_volume, |e| e.twins.get(i))));
        }
    }
    text
}
