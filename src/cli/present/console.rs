//! What the program prints, and where.

use crate::cli::failure::{Failure, Outcome};
use crate::cli::present::text;
use crate::signals;
pub(in crate::cli) use crate::signals::requests as interrupts;
use crate::transport::Progress;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io;
use std::io::{ErrorKind, IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

/// Standard output and standard error as the common options ask for them. A pipe that nobody reads any more (`… | head`) is
/// no error; any other failure of standard output is one, which [`Console::finish`] tells at the end.
pub(crate) struct Console {
    json: bool,
    quiet: bool,
    /// The first failure of standard output.
    failed: Mutex<Option<io::Error>>,
    /// Whether a result for machines was printed.
    told: AtomicBool,
    verbose: bool,
    /// Who hears besides how many of so many texels a bake has done.
    heard: OnceLock<Box<dyn Fn(u64, u64) + Send + Sync>>,
}

impl Console {
    pub(crate) fn new(json: bool, quiet: bool) -> Self {
        let (failed, told) = (Mutex::new(None), AtomicBool::new(false));
        Self { json, quiet, verbose: false, failed, told, heard: OnceLock::new() }
    }

    /// The same with details, if they are wanted.
    pub(in crate::cli) fn with_details(self, verbose: bool) -> Self {
        Self { verbose, ..self }
    }

    /// Whether details are wanted.
    pub(in crate::cli) fn is_verbose(&self) -> bool {
        self.verbose
    }

    /// Whether results are wanted as JSON.
    pub(in crate::cli) fn is_json(&self) -> bool {
        self.json
    }

    /// Prints a result for people; nothing under `--json`.
    pub(in crate::cli) fn print(&self, text: impl std::fmt::Display) {
        if !self.json {
            self.keep(writeln!(io::stdout(), "{}", text::fitted(&text.to_string())));
        }
    }

    /// Prints what was made of it, in a line or two: nothing under `--quiet`.
    pub(in crate::cli) fn summary(&self, text: impl std::fmt::Display) {
        if !self.quiet {
            self.print(text);
        }
    }

    /// Prints what only some want to know: under `--verbose`.
    pub(in crate::cli) fn detail(&self, text: impl std::fmt::Display) {
        if self.verbose {
            self.print(text);
        }
    }

    /// Prints the result for machines; nothing without `--json`.
    pub(in crate::cli) fn print_json(&self, value: &serde_json::Value) {
        if self.json {
            self.told.store(true, Ordering::Relaxed);
            self.keep(writeln!(io::stdout(), "{value:#}"));
        }
    }

    /// Prints bytes that are the result themselves, under `--json` too.
    pub(in crate::cli) fn print_raw(&self, bytes: &[u8]) {
        self.keep(io::stdout().write_all(bytes));
    }

    /// Remembers that standard output failed, for [`Console::finish`].
    pub(in crate::cli) fn keep(&self, result: io::Result<()>) {
        if let Err(error) = result {
            self.failed.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        }
    }

    /// Writes out what is buffered.
    ///
    /// # Errors
    /// When standard output took not all of what was printed, other than because its reader has gone.
    pub(in crate::cli) fn finish(&self) -> Outcome {
        self.keep(io::stdout().flush());
        match self.failed.lock().unwrap_or_else(PoisonError::into_inner).take() {
            Some(error) if error.kind() != ErrorKind::BrokenPipe => {
                Err(Failure::Message(format!("cannot write to the output: {error}")))
            }
            _ => Ok(()),
        }
    }

    /// Something the user should know.
    pub(in crate::cli) fn note(&self, text: impl std::fmt::Display) {
        if !self.quiet {
            let _ = writeln!(io::stderr(), "{}", text::fitted(&format!("note: {text}")));
        }
    }

    /// Why the command failed; for machines too, unless they have been told a result already.
    pub(in crate::cli) fn error(&self, failure: &Failure) {
        let _ = writeln!(io::stderr(), "{}", text::fitted(&format!("error: {failure}")));
        if !self.told.load(Ordering::Relaxed) {
            self.print_json(&serde_json::json!({ "error": failure.to_json() }));
        }
    }

    /// From now on somebody hears how far bakes are.
    pub(in crate::cli) fn tell_progress(&self, heard: impl Fn(u64, u64) + Send + Sync + 'static) {
        let _ = self.heard.set(Box::new(heard));
    }

    /// Guards the work that follows against requests to stop.
    pub(in crate::cli) fn guard(&self) -> signals::Guard {
        signals::Guard::new(self.quiet)
    }

    /// Runs `work` while a bar shows how far `progress` has come of so many texels or photons; on a terminal only. So many
    /// interrupts by the user cancel `progress`: two, or one where nothing is lost.
    pub(in crate::cli) fn watch<T>(
        &self,
        most_interrupts: u32,
        what: &str,
        items: u64,
        progress: &Progress,
        work: impl FnOnce() -> T,
    ) -> T {
        let show = !self.quiet && io::stderr().is_terminal();
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
                    if interrupts() > 0 {
                        progress.stop.store(true, Ordering::Relaxed);
                    }
                    if interrupts() >= most_interrupts {
                        progress.cancel.store(true, Ordering::Relaxed);
                    }
                    let done = progress.texels.load(Ordering::Relaxed) + progress.photons.load(Ordering::Relaxed);
                    bar.set_position(done);
                    if let Some(heard) = self.heard.get() {
                        heard(done, items);
                    }
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
