//! What a program answers to signals of the system (feature `cli`): bus errors ([`explain_bus_errors`]), and requests to stop: Ctrl-C (SIGINT), SIGTERM as batch systems send it, SIGHUP of a terminal that closes.
//!
//! While work is guarded, the first one asks it to stop where nothing is lost, the second ends it: the work is told to drop
//! what it has begun, and the process is gone a second later. Unguarded, a request ends the process as if nobody listened.

mod fault;

pub use fault::explain_bus_errors;

use std::io::Write;
use std::sync::atomic::{AtomicBool, AtomicI32, AtomicU32, Ordering};
use std::time::Duration;

static REQUESTS: AtomicU32 = AtomicU32::new(0);
static FIRST: AtomicI32 = AtomicI32::new(0);
static GUARDED: AtomicBool = AtomicBool::new(false);

/// What is left to tidy work after the second request.
const GRACE: Duration = Duration::from_secs(1);
/// Ctrl-C, where the system does not say which request it is.
#[cfg(not(unix))]
const INTERRUPT: i32 = 2;

/// How often the user asked to stop while work was guarded.
pub fn requests() -> u32 {
    REQUESTS.load(Ordering::SeqCst)
}

/// The exit code of a command that stopped because it was asked to: 128 and the number of the signal, as shells have it.
pub fn exit_code() -> Option<u8> {
    (requests() > 0).then(|| code(FIRST.load(Ordering::SeqCst)))
}

fn code(signal: i32) -> u8 {
    (128 + signal).clamp(0, 255) as u8
}

/// While it lives, a request to stop does not end the process; [`requests`] counts it.
pub struct Guard;

impl Guard {
    /// Guards the work that follows.
    pub fn new(quiet: bool) -> Self {
        GUARDED.store(true, Ordering::SeqCst);
        // An error is a second call, or a system without signals: the process then simply ends.
        listen(quiet);
        Self
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        GUARDED.store(false, Ordering::SeqCst);
    }
}

/// Answers a request while work is guarded.
fn answer(signal: i32, quiet: bool) {
    let _ = FIRST.compare_exchange(0, signal, Ordering::SeqCst, Ordering::SeqCst);
    let before = REQUESTS.fetch_add(1, Ordering::SeqCst);
    if before == 0 {
        if !quiet {
            let text = "note: stopping when the chunks in work are written; press Ctrl-C again to stop at once";
            let _ = writeln!(std::io::stderr(), "\n{text}");
        }
    } else if before == 1 {
        std::thread::spawn(move || {
            std::thread::sleep(GRACE);
            std::process::exit(i32::from(code(signal)));
        });
    }
}

#[cfg(unix)]
fn listen(quiet: bool) {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    use std::sync::Once;
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // nohup has SIGHUP ignored: then it stays so.
        let signals: &[i32] = if is_ignored(SIGHUP) { &[SIGINT, SIGTERM] } else { &[SIGINT, SIGTERM, SIGHUP] };
        let Ok(mut all) = signal_hook::iterator::Signals::new(signals) else { return };
        std::thread::spawn(move || {
            for signal in all.forever() {
                if GUARDED.load(Ordering::SeqCst) {
                    answer(signal, quiet);
                } else if signal_hook::low_level::emulate_default_handler(signal).is_err() {
                    std::process::exit(i32::from(code(signal)));
                }
            }
        });
    });
}

/// Whether the process was started with a signal ignored; `false` where the system does not tell.
#[cfg(unix)]
fn is_ignored(signal: i32) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

#[cfg(not(unix))]
fn listen(quiet: bool) {
    let _ = ctrlc::set_handler(move || {
        if GUARDED.load(Ordering::SeqCst) {
            answer(INTERRUPT, quiet);
        } else {
            std::process::exit(i32::from(code(INTERRUPT)));
        }
    });
}
