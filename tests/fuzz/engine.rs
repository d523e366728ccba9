//! Feeds one input to a reader and judges what it cost: an answer, within a stated memory, in bounded time.

use super::memory;
use super::targets::{Bench, Input};
use std::fs::File;
use std::io::{Seek, Write};
use std::panic::AssertUnwindSafe;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// An input that takes longer than this hangs: far beyond what any input takes on a loaded machine.
const HANG: Duration = Duration::from_secs(60);

/// What a run of a target saw.
pub struct Tally {
    evidence: Evidence,
    /// Inputs fed.
    pub runs: u64,
    /// Those that were read without an error.
    pub accepted: u64,
    /// Most memory in use at once.
    pub most_bytes: usize,
    /// Longest time of one.
    pub slowest: Duration,
}

impl Tally {
    /// Of a target of which nothing was fed yet.
    pub fn new(bench: &Bench) -> Self {
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
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("target/evidence");
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
pub fn feed(bench: &Bench, input: &Input, what: &str, tally: &mut Tally) {
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
pub fn watched(work: impl FnOnce()) {
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
