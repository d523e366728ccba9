//! Long calls: outside the lock of the interpreter, in threads of their own, while the thread that called listens to Ctrl-C and
//! tells how far they are.

use super::error::raise;
use crate::bake::{Observer, Task};
use crate::cli::Failure;
use crate::error::{Error, Result};
use crate::transport::Progress;
use pyo3::prelude::*;
use rayon::ThreadPool;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Between two looks at signals.
const LOOK: Duration = Duration::from_millis(50);
/// Between two calls of the user's progress.
const TELL: Duration = Duration::from_millis(200);
/// How long chunks in work may take to be finished, once a stop is asked for: then they are dropped.
const GRACE: Duration = Duration::from_millis(300);

/// The pools of threads of a process by the number that was asked for. Whatever the library does runs in one of them, and not in
/// rayon's own: threads do not survive a fork, and a pool of the parent would wait for ever.
static POOLS: Mutex<Pools> = Mutex::new(Pools { process: 0, pools: Vec::new() });

/// The pools of a process.
struct Pools {
    process: u32,
    pools: Vec<(usize, Arc<ThreadPool>)>,
}

/// The pool of so many threads; one per core if not said.
pub(super) fn pool(threads: Option<usize>) -> Result<Arc<ThreadPool>> {
    let (process, wanted) = (std::process::id(), threads.unwrap_or(0));
    let mut held = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    let Pools { process: of, pools } = &mut *held;
    if *of != process {
        // Pools of the parent of a fork are left alone: ending them would wait for threads that are not there.
        *of = process;
        std::mem::take(pools).into_iter().for_each(std::mem::forget);
    }
    if let Some((_, pool)) = pools.iter().find(|(count, _)| *count == wanted) {
        return Ok(pool.clone());
    }
    let made = rayon::ThreadPoolBuilder::new().num_threads(wanted).build();
    let made = Arc::new(made.map_err(|e| {
        let found = format!("{wanted}, which the system refuses: {e}");
        Error::argument("threads", found, "as many as it allows", "give fewer, or see ulimit -v and -u")
    })?);
    pools.push((wanted, made.clone()));
    Ok(made)
}

/// The bake as its thread sees it.
struct Watched {
    start: Instant,
    stop: AtomicBool,
    cancel: AtomicBool,
    /// Items of the parts that are done, of all parts so far, and of the one in work.
    before: AtomicU64,
    total: AtomicU64,
    done: AtomicU64,
    notes: Mutex<Vec<String>>,
}

/// Says that the work of a part is over, also when it panics.
struct Ended<'a>(&'a AtomicBool, thread::Thread);

impl Drop for Ended<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
        self.1.unpark();
    }
}

impl Observer for Watched {
    fn note(&self, text: &str) {
        self.notes.lock().unwrap_or_else(PoisonError::into_inner).push(text.to_owned());
    }

    fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }

    fn wants_stop(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    fn watch(&self, _: Task, items: u64, progress: &Progress, work: &mut dyn FnMut()) {
        self.total.fetch_add(items, Ordering::Relaxed);
        let ended = AtomicBool::new(false);
        thread::scope(|scope| {
            let watcher = scope.spawn(|| {
                while !ended.load(Ordering::Relaxed) {
                    let done = progress.texels.load(Ordering::Relaxed) + progress.photons.load(Ordering::Relaxed);
                    self.done.store(done.min(items), Ordering::Relaxed);
                    progress.stop.fetch_or(self.stop.load(Ordering::Relaxed), Ordering::Relaxed);
                    progress.cancel.fetch_or(self.cancel.load(Ordering::Relaxed), Ordering::Relaxed);
                    thread::park_timeout(LOOK);
                }
            });
            let _ended = Ended(&ended, watcher.thread().clone());
            work();
        });
        self.done.store(0, Ordering::Relaxed);
        self.before.fetch_add(items, Ordering::Relaxed);
    }
}

impl Watched {
    fn new() -> Self {
        Self {
            start: Instant::now(),
            stop: AtomicBool::new(false),
            cancel: AtomicBool::new(false),
            before: AtomicU64::new(0),
            total: AtomicU64::new(0),
            done: AtomicU64::new(0),
            notes: Mutex::new(Vec::new()),
        }
    }

    /// Calls the user's progress: done, total, seconds left.
    fn tell(&self, progress: &Py<PyAny>, py: Python<'_>) -> PyResult<()> {
        let total = self.total.load(Ordering::Relaxed);
        let done = (self.before.load(Ordering::Relaxed) + self.done.load(Ordering::Relaxed)).min(total);
        let left = (done > 0).then(|| self.seconds() / done as f64 * (total - done) as f64);
        progress.call1(py, (done, total, left)).map(drop)
    }
}

/// Runs `work` in the pool; signals and exceptions of `progress` stop it, and pass through once it has stopped. Returns what it
/// returned, and what was noted meanwhile.
pub(super) fn run<T: Send>(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    pool: &ThreadPool,
    work: impl FnOnce(&dyn Observer) -> std::result::Result<T, Failure> + Send,
) -> PyResult<(T, Vec<String>)> {
    let watched = Watched::new();
    let mut interrupted: Option<(PyErr, Instant)> = None;
    let result = py.detach(|| {
        thread::scope(|scope| {
            let caller = thread::current();
            let watched = &watched;
            let worker = scope.spawn(move || {
                let done = pool.install(|| work(watched));
                caller.unpark();
                done
            });
            let mut told = Instant::now();
            while !worker.is_finished() {
                thread::park_timeout(LOOK);
                if let Some((_, since)) = &interrupted {
                    watched.cancel.fetch_or(since.elapsed() > GRACE, Ordering::Relaxed);
                    continue;
                }
                let is_time = told.elapsed() >= TELL && watched.total.load(Ordering::Relaxed) > 0;
                let found = Python::attach(|py| {
                    py.check_signals()?;
                    progress.filter(|_| is_time).map_or(Ok(()), |progress| watched.tell(progress, py))
                });
                if is_time {
                    told = Instant::now();
                }
                if let Err(error) = found {
                    watched.stop.store(true, Ordering::Relaxed);
                    interrupted = Some((error, Instant::now()));
                }
            }
            worker.join()
        })
    });
    // A panic is a bug: it goes on as one.
    let result = result.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    if let Some((error, _)) = interrupted {
        return Err(error);
    }
    let value = result.map_err(|failure| raise(py, failure))?;
    if let Some(progress) = progress.filter(|_| watched.total.load(Ordering::Relaxed) > 0) {
        watched.tell(progress, py)?;
    }
    Ok((value, watched.notes.into_inner().unwrap_or_else(PoisonError::into_inner)))
}

/// Runs what takes a moment, without progress, in the pool and outside the lock of the interpreter.
pub(super) fn briefly<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> std::result::Result<T, Failure> + Send,
) -> PyResult<T> {
    let result = py.detach(|| pool(None)?.install(work));
    result.map_err(|failure| raise(py, failure))
}
