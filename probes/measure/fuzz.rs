//! Every reader under damaged input for as long as it is told to; see `tests/fuzz` for what is asserted.
//!
//! RAYON_NUM_THREADS=1 cargo run --release --example measure-fuzz -- SECONDS [TARGET|all [START [RUNS]]]
//! cargo run --release --example measure-fuzz -- corpus
//!
//! SECONDS are spread over the targets, START is the number of the first input in the endless list [1000000], RUNS
//! the most inputs for each target. `corpus` writes the seeds that are made by program to tests/fuzz/corpus.

#[path = "../../tests/fuzz/documents.rs"]
mod documents;
#[path = "../../tests/fuzz/engine.rs"]
mod engine;
#[path = "../../tests/fuzz/memory.rs"]
mod memory;
#[path = "../../tests/fuzz/mutate.rs"]
mod mutate;
#[path = "../../tests/fuzz/seeds.rs"]
mod seeds;
#[allow(dead_code, reason = "shared with tests/fuzz")]
#[path = "../../tests/fuzz/targets.rs"]
mod targets;

use engine::{Tally, feed, watched};
use std::time::Instant;
use targets::{Bench, TARGETS, Target};

#[global_allocator]
static ALLOCATOR: memory::Counting = memory::Counting;

type Outcome = Result<(), Box<dyn std::error::Error>>;

fn main() -> Outcome {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument = |i: usize| arguments.get(i).map(String::as_str);
    if argument(0) == Some("corpus") {
        return write_corpus();
    }
    let seconds: f64 = argument(0).unwrap_or("60").parse()?;
    let name = argument(1).filter(|&name| name != "all");
    let chosen: Vec<&Target> = TARGETS.iter().filter(|t| name.is_none_or(|name| name == t.name)).collect();
    if chosen.is_empty() {
        let names: Vec<&str> = TARGETS.iter().map(|t| t.name).collect();
        return Err(format!("no target of that name; there are {}", names.join(", ")).into());
    }
    let first = argument(2).map_or(Ok(1_000_000), str::parse)?;
    let most = argument(3).map_or(Ok(u64::MAX), str::parse)?;
    println!("target,seconds,executions,accepted,peak_bytes,limit_bytes,slowest_ms");
    let share = seconds / chosen.len() as f64;
    watched(|| chosen.into_iter().for_each(|target| run(target, share, first, most)));
    Ok(())
}

fn run(target: &'static Target, seconds: f64, first: u64, most: u64) {
    let bench = Bench::new(target);
    let (start, mut tally) = (Instant::now(), Tally::new(&bench));
    while start.elapsed().as_secs_f64() < seconds && tally.runs < most {
        let n = first + tally.runs;
        feed(&bench, &bench.input(n), &format!("input {n}"), &mut tally);
    }
    let Tally { runs, accepted, most_bytes, slowest, .. } = tally;
    let (elapsed, milliseconds) = (start.elapsed().as_secs_f64(), 1e3 * slowest.as_secs_f64());
    println!("{},{elapsed:.0},{runs},{accepted},{most_bytes},{},{milliseconds:.1}", target.name, target.limit);
}

fn write_corpus() -> Outcome {
    for target in &TARGETS {
        for (name, bytes) in (target.seeds)() {
            let folder = targets::corpus(target.name);
            std::fs::create_dir_all(&folder)?;
            std::fs::write(folder.join(name), bytes)?;
        }
    }
    Ok(())
}
