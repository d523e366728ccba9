//! What a command lends to the library: the console as the observer of a bake, and the clock.

use crate::bake::{Observer, Report, Request, Task};
use crate::cache::Filled;
use crate::cli::present::console::{Console, interrupts};
use crate::cli::present::{baked, effects};
use crate::error::Result;
use crate::file::size_on_disk;
use crate::scene::Plan;
use crate::transfer::store::Store;
use crate::transport::Progress;
use crate::{bake, memory, signals};
use cpu_time::ProcessTime;
use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;

/// Bakes what is missing or damaged into the store at `path`, while the console shows how far it is. `start`: when the
/// command began.
pub(in crate::cli) fn fill(
    request: &Request<'_>,
    path: &Path,
    start: Instant,
    console: &Console,
) -> Result<(Store, Report)> {
    request.check_memory()?;
    request.check()?;
    let limit = request.memory_limit.unwrap_or_else(memory::default_limit);
    let request = Request { memory_limit: Some(limit), ..request.clone() };
    let (store, report) = bake::run(&request, path, &Watcher { console, start, guard: Mutex::new(None) })?;
    report.cut_paths().iter().chain(&report.missed_goal()).for_each(|warning| console.note(warning));
    Ok((store, report))
}

/// The same for the cache.
pub(in crate::cli) fn filler(
    start: Instant,
    console: &Console,
) -> impl Fn(&Request<'_>, &Path) -> Result<(Store, Report)> {
    move |request, path| fill(request, path, start, console)
}

/// Prints details of what was baked into the cache.
pub(in crate::cli) fn details(filled: &Filled, console: &Console) {
    if filled.report.chunks_baked > 0 {
        console.detail(baked::lines(&filled.report, size_on_disk(filled.store.path())));
    }
}

/// The console as the observer of a bake.
struct Watcher<'a> {
    console: &'a Console,
    start: Instant,
    guard: Mutex<Option<signals::Guard>>,
}

impl Observer for Watcher<'_> {
    fn note(&self, text: &str) {
        self.console.note(text);
    }

    fn plan(&self, plan: &Plan) {
        self.console.print(effects::table(plan));
    }

    fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    fn begin(&self) {
        if let Ok(mut guard) = self.guard.lock() {
            *guard = Some(self.console.guard());
        }
    }

    fn wants_stop(&self) -> bool {
        interrupts() > 0
    }

    fn watch(&self, task: Task, items: u64, progress: &Progress, work: &mut dyn FnMut()) {
        match task {
            // A request to stop loses nothing of photons but the time they took: the first one ends them.
            Task::Photons => self.console.watch(1, "photons", items, progress, work),
            _ => self.console.watch(2, "bake", items, progress, work),
        }
    }
}

/// The clock of pilots and studies: wall-clock and processor seconds from now on.
pub(in crate::cli) fn clock() -> impl Fn() -> [f64; 2] {
    let (wall, cpu) = (Instant::now(), ProcessTime::now());
    move || [wall.elapsed().as_secs_f64(), cpu.elapsed().as_secs_f64()]
}
