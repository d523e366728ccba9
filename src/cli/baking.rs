//! A bake that the console watches.

use super::bake_report;
use super::console::{Console, interrupts};
use super::plan_table;
use crate::bake::{self, Observer, Report, Request, Task};
use crate::cache::Filled;
use crate::error::Result;
use crate::file::size_on_disk;
use crate::memory;
use crate::scene::Plan;
use crate::signals;
use crate::transfer::store::Store;
use crate::transport::Progress;
use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;

/// Bakes what is missing or damaged into the store at `path`, while the console shows how far it is. `start`: when the
/// command began.
pub(super) fn fill(request: &Request<'_>, path: &Path, start: Instant, console: &Console) -> Result<(Store, Report)> {
    request.check_memory()?;
    request.check()?;
    let limit = request.memory_limit.unwrap_or_else(memory::default_limit);
    let request = Request { memory_limit: Some(limit), ..request.clone() };
    let (store, report) = bake::run(&request, path, &Watcher { console, start, guard: Mutex::new(None) })?;
    report.cut_paths().iter().chain(&report.missed_goal()).for_each(|warning| console.note(warning));
    Ok((store, report))
}

/// The same for the cache.
pub(super) fn filler(start: Instant, console: &Console) -> impl Fn(&Request<'_>, &Path) -> Result<(Store, Report)> {
    move |request, path| fill(request, path, start, console)
}

/// Prints details of what was baked into the cache.
pub(super) fn details(filled: &Filled, console: &Console) {
    if filled.report.chunks_baked > 0 {
        console.detail(bake_report::lines(&filled.report, size_on_disk(filled.store.path())));
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
        self.console.print(plan_table::table(plan));
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
            Task::Photons => self.console.watch_first("photons", items, progress, work),
            _ => self.console.watch("bake", items, progress, work),
        }
    }
}
