//! What the program prints, and where.

use super::text;
use crate::transport::Progress;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::{Duration, Instant};

/// Standard output and standard error as the common options ask for them. A closed pipe is not an error.
pub(super) struct Console {
    json: bool,
    quiet: bool,
    verbose: bool,
}

impl Console {
    pub(super) fn new(json: bool, quiet: bool) -> Self {
        Self { json, quiet, verbose: false }
    }

    /// The same with details, if they are wanted.
    pub(super) fn with_details(self, verbose: bool) -> Self {
        Self { verbose, ..self }
    }

    /// Whether details are wanted.
    pub(super) fn is_verbose(&self) -> bool {
        self.verbose
    }

    /// Whether results are wanted as JSON.
    pub(super) fn is_json(&self) -> bool {
        self.json
    }

    /// Prints a result for people; nothing under `--json`.
    pub(super) fn print(&self, text: impl std::fmt::Display) {
        if !self.json {
            let _ = writeln!(std::io::stdout(), "{}", text::fitted(&text.to_string()));
        }
    }

    /// Prints what was made of it, in a line or two: nothing under `--quiet`.
    pub(super) fn summary(&self, text: impl std::fmt::Display) {
        if !self.quiet {
            self.print(text);
        }
    }

    /// Prints what only some want to know: under `--verbose`.
    pub(super) fn detail(&self, text: impl std::fmt::Display) {
        if self.verbose {
            self.print(text);
        }
    }

    /// Prints the result for machines; nothing without `--json`.
    pub(super) fn print_json(&self, value: &serde_json::Value) {
        if self.json {
            let _ = writeln!(std::io::stdout(), "{value:#}");
        }
    }

    /// Something the user should know.
    pub(super) fn note(&self, text: impl std::fmt::Display) {
        if !self.quiet {
            let _ = writeln!(std::io::stderr(), "{}", text::fitted(&format!("note: {text}")));
        }
    }

    /// Why the command failed.
    pub(super) fn error(&self, text: impl std::fmt::Display) {
        let _ = writeln!(std::io::stderr(), "{}", text::fitted(&format!("error: {text}")));
    }

    /// Runs `work` while a bar shows how far `progress` has come of so many texels or photons; on a terminal only. The second
    /// interrupt by the user cancels `progress`.
    pub(super) fn watch<T>(&self, what: &str, items: u64, progress: &Progress, work: impl FnOnce() -> T) -> T {
        self.watch_until(2, what, items, progress, work)
    }

    /// As [`Console::watch`], for work that an interrupt loses nothing of: the first one cancels it.
    pub(super) fn watch_first<T>(&self, what: &str, items: u64, progress: &Progress, work: impl FnOnce() -> T) -> T {
        self.watch_until(1, what, items, progress, work)
    }

    fn watch_until<T>(
        &self,
        most_interrupts: u32,
        what: &str,
        items: u64,
        progress: &Progress,
        work: impl FnOnce() -> T,
    ) -> T {
        let show = !self.quiet && std::io::stderr().is_terminal();
        let target = if show { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(Some(items), target);
        let style = ProgressStyle::with_template("{prefix} {bar:30} {percent:>3} %  {msg}  {eta} left");
        bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
        bar.set_prefix(what.to_string());
        let done = AtomicBool::new(false);
        let start = Instant::now();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !done.load(Ordering::Relaxed) {
                    if interrupts() >= most_interrupts {
                        progress.cancel.store(true, Ordering::Relaxed);
                    }
                    bar.set_position(
                        progress.texels.load(Ordering::Relaxed) + progress.photons.load(Ordering::Relaxed),
                    );
                    let rays = progress.rays.load(Ordering::Relaxed) as f64;
                    bar.set_message(text::rate(rays, start.elapsed()));
                    std::thread::park_timeout(Duration::from_millis(150));
                }
                bar.finish_and_clear();
            });
            // A panic in `work` must still end the watcher.
            let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(work));
            done.store(true, Ordering::Relaxed);
            result.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        })
    }
}

static INTERRUPTS: AtomicU32 = AtomicU32::new(0);
static GUARDED: AtomicBool = AtomicBool::new(false);

/// How often the user asked to stop while work was guarded.
pub(super) fn interrupts() -> u32 {
    INTERRUPTS.load(Ordering::Relaxed)
}

/// While it lives, an interrupt (Ctrl-C) does not end the process; [`interrupts`] counts it.
pub(super) struct InterruptGuard;

impl Drop for InterruptGuard {
    fn drop(&mut self) {
        GUARDED.store(false, Ordering::Relaxed);
    }
}

impl Console {
    /// Guards the work that follows against interrupts.
    pub(super) fn guard(&self) -> InterruptGuard {
        let quiet = self.quiet;
        GUARDED.store(true, Ordering::Relaxed);
        // An error is a second call, or a system without signals: the process then simply ends.
        let _ = ctrlc::set_handler(move || {
            if !GUARDED.load(Ordering::Relaxed) {
                std::process::exit(1);
            }
            if INTERRUPTS.fetch_add(1, Ordering::Relaxed) == 0 && !quiet {
                let text = "note: stopping when the chunks in work are written; press Ctrl-C again to stop at once";
                let _ = writeln!(std::io::stderr(), "\n{text}");
            }
        });
        InterruptGuard
    }
}
