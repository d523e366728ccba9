//! Every reader under damaged, hostile and senseless input: it ends in `Ok` or `Err`, within a stated
//! memory, without a panic.
//!
//! The gate runs a fixed number of inputs for each target, the same ones every time. For longer runs, on
//! other inputs:
//! ```text
//! ISOLUME_FUZZ_SECONDS=600 RAYON_NUM_THREADS=1 cargo test --release --test fuzz -- --ignored long_run --nocapture
//! ```
//! spreads the seconds over all targets; ISOLUME_FUZZ_TARGET=nrrd takes one, ISOLUME_FUZZ_START=1000000
//! begins elsewhere in the endless list of inputs, ISOLUME_FUZZ_RUNS=1 takes that one alone. An input that fails is kept in target/evidence/, its
//! target and number are printed; copied into tests/fuzz/corpus/<target>/ it is a seed from then on.

#[path = "fuzz/memory.rs"]
mod memory;
#[path = "fuzz/mutate.rs"]
mod mutate;
#[path = "fuzz/regressions.rs"]
mod regressions;
#[path = "fuzz/seeds.rs"]
mod seeds;
#[path = "fuzz/targets.rs"]
mod targets;

use std::fs::File;
use std::io::{Seek, Write};
use std::panic::AssertUnwindSafe;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use targets::{Bench, Input, TARGETS};

#[global_allocator]
static ALLOCATOR: memory::Counting = memory::Counting;

/// An input that takes longer than this hangs: far beyond what any input takes on a loaded machine.
const HANG: Duration = Duration::from_secs(60);

/// Tests of this binary take turns, so that what is counted is one input's.
fn turn() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What a run of a target saw.
struct Tally {
    evidence: Evidence,
    runs: u64,
    accepted: u64,
    most_bytes: usize,
    slowest: Duration,
}

impl Tally {
    fn new(bench: &Bench) -> Self {
        let evidence = Evidence::new(bench.target.name);
        Self { evidence, runs: 0, accepted: 0, most_bytes: 0, slowest: Duration::ZERO }
    }
}

/// Where the input in work is kept: it is still there when it fails, whatever it does to the process.
struct Evidence {
    path: PathBuf,
    // Kept open: on some file systems each close of a rewritten file waits for the disk.
    file: File,
}

impl Evidence {
    fn new(target: &str) -> Self {
        // Under the name of the test, so that the next one does not take it.
        let test = std::thread::current().name().unwrap_or("main").to_string();
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).parent().expect("a target folder").join("evidence");
        std::fs::create_dir_all(&folder).expect("target/evidence");
        let path = folder.join(format!("fuzz-{target}-{test}.bin"));
        Self { file: File::create(&path).expect("evidence"), path }
    }

    fn keep(&mut self, bytes: &[u8]) {
        let written = self.file.rewind().and_then(|()| self.file.write_all(bytes));
        written.and_then(|()| self.file.set_len(bytes.len() as u64)).expect("evidence");
    }
}

/// Feeds one input and checks what it cost. `what` says which, for the message.
fn feed(bench: &Bench, input: &Input, what: &str, tally: &mut Tally) {
    let target = bench.target;
    tally.evidence.keep(&input.bytes);
    began(Some(format!("{} {what}", target.name)));
    let start = Instant::now();
    let (outcome, bytes) = memory::peak_of(|| std::panic::catch_unwind(AssertUnwindSafe(|| bench.feed(input))));
    let time = start.elapsed();
    let kept = tally.evidence.path.display();
    match outcome {
        Ok(accepted) => tally.accepted += u64::from(accepted),
        Err(panic) => {
            println!("{} {what} panicked; the input is in {kept}", target.name);
            std::panic::resume_unwind(panic);
        }
    }
    let limit = target.limit + 64 * input.bytes.len();
    assert!(bytes <= limit, "{} {what} asked for {bytes} bytes, the limit is {limit}; input in {kept}", target.name);
    tally.runs += 1;
    tally.most_bytes = tally.most_bytes.max(bytes);
    tally.slowest = tally.slowest.max(time);
}

/// The input in work and when it began.
static BEGAN: Mutex<Option<(Instant, String)>> = Mutex::new(None);

fn began(what: Option<String>) {
    *BEGAN.lock().unwrap_or_else(PoisonError::into_inner) = what.map(|what| (Instant::now(), what));
}

/// Runs `work` beside a watch that ends the process when one input does not end.
fn watched(work: impl FnOnce()) {
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let watch = scope.spawn(|| {
            while !done.load(Ordering::Relaxed) {
                std::thread::park_timeout(Duration::from_millis(500));
                let began = BEGAN.lock().unwrap_or_else(PoisonError::into_inner).clone();
                if let Some((start, what)) = began
                    && start.elapsed() > HANG
                {
                    eprintln!("{what} does not end; the input is in target/evidence");
                    std::process::abort();
                }
            }
        });
        let outcome = std::panic::catch_unwind(AssertUnwindSafe(work));
        began(None);
        done.store(true, Ordering::Relaxed);
        watch.thread().unpark();
        outcome.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    });
}

#[test]
fn every_seed_is_accepted() {
    let _turn = turn();
    for target in &TARGETS {
        let bench = Bench::new(target);
        for (i, input) in bench.whole().iter().enumerate() {
            let mut tally = Tally::new(&bench);
            feed(&bench, input, &format!("seed {i}"), &mut tally);
            let kept = targets::is_regression(target.name, i);
            assert!(kept || tally.accepted == 1, "seed {i} of {} is refused", target.name);
        }
    }
}

/// Every place of the small files, some places of the large ones (a store's volume has 256 KiB).
#[test]
fn every_prefix_ends_in_an_answer() {
    let _turn = turn();
    watched(|| {
        for target in &TARGETS {
            let bench = Bench::new(target);
            let mut tally = Tally::new(&bench);
            for (i, input) in bench.whole().iter().enumerate() {
                let step = (input.bytes.len() / 1000).max(1) * if bench.is_store() { 50 } else { 1 };
                for length in (0..input.bytes.len()).step_by(step) {
                    let cut = input.with(input.bytes[..length].to_vec());
                    feed(&bench, &cut, &format!("seed {i} cut at {length}"), &mut tally);
                }
            }
        }
    });
}

/// The inputs of the gate: the first ones of each target.
#[test]
fn a_fixed_number_of_damaged_inputs_for_each_target() {
    let _turn = turn();
    watched(|| {
        for target in &TARGETS {
            let bench = Bench::new(target);
            let mut tally = Tally::new(&bench);
            for n in 0..target.gate_runs {
                feed(&bench, &bench.input(n), &format!("input {n}"), &mut tally);
            }
            // Damage is not so gentle that it tests nothing, nor so rough that nothing is reached.
            assert!(tally.accepted > 0 && tally.accepted < tally.runs, "{}: {} accepted", target.name, tally.accepted);
        }
    });
}

fn number(variable: &str) -> Option<u64> {
    std::env::var(variable).ok().and_then(|v| v.parse().ok())
}

/// As long as ISOLUME_FUZZ_SECONDS says, spread over the targets.
#[test]
#[ignore = "takes ISOLUME_FUZZ_SECONDS"]
fn long_run() {
    let _turn = turn();
    let one = std::env::var("ISOLUME_FUZZ_TARGET").ok();
    let chosen: Vec<_> = TARGETS.iter().filter(|t| one.as_deref().is_none_or(|name| name == t.name)).collect();
    assert!(!chosen.is_empty(), "ISOLUME_FUZZ_TARGET names no target");
    let seconds = number("ISOLUME_FUZZ_SECONDS").unwrap_or(60) as f64 / chosen.len() as f64;
    let first = number("ISOLUME_FUZZ_START").unwrap_or(1_000_000);
    let most = number("ISOLUME_FUZZ_RUNS").unwrap_or(u64::MAX);
    println!("target,seconds,executions,accepted,peak_bytes,limit_bytes,slowest_ms");
    watched(|| {
        for target in chosen {
            let bench = Bench::new(target);
            let (start, mut tally) = (Instant::now(), Tally::new(&bench));
            while start.elapsed().as_secs_f64() < seconds && tally.runs < most {
                let n = first + tally.runs;
                feed(&bench, &bench.input(n), &format!("input {n}"), &mut tally);
            }
            let Tally { runs, accepted, most_bytes, slowest, .. } = tally;
            println!(
                "{},{:.0},{runs},{accepted},{most_bytes},{},{:.1}",
                target.name,
                start.elapsed().as_secs_f64(),
                target.limit,
                1e3 * slowest.as_secs_f64()
            );
        }
    });
}

/// Writes the seeds; the corpus in the repository is what this wrote, and what was added since.
#[test]
#[ignore = "writes tests/fuzz/corpus"]
fn write_the_corpus() {
    for target in &TARGETS {
        for (name, bytes) in (target.seeds)() {
            let folder = targets::corpus(target.name);
            std::fs::create_dir_all(&folder).expect("a folder");
            std::fs::write(folder.join(name), bytes).expect("written");
        }
    }
}
