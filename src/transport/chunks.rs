//! The parallel loop over chunks, for every estimator: bricks are handed out in the order of the file, a chunk is handed on
//! as soon as its last brick is done, and totals are added in the order of the chunks, whichever thread was quicker.

use super::bake::Progress;
use crate::error::{Error, Result};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most chunks that so many threads, or those of this process, hold at a time: each may work on another, and one is being handed on.
pub(crate) fn most_in_work(threads: Option<usize>) -> usize {
    threads.unwrap_or_else(rayon::current_num_threads) + 1
}

/// What makes the output of a slot: from a scratch of its thread, what is there of its chunk, the chunk, and the slot.
type Work<'a, Scratch, Old, Out> = dyn Fn(&mut Scratch, &Old, [usize; 3], usize) -> Option<Out> + Sync + 'a;

/// What is known of a chunk while its bricks are computed.
struct Chunk<Old, Out> {
    /// What was there before; read by whoever begins the chunk.
    old: Option<Arc<Old>>,
    /// One a slot, x fastest.
    outputs: Vec<Option<Out>>,
    /// Slots that are not done yet.
    left: usize,
}

/// What the chunks that are done hand on, under one lock.
struct Finish<'a, Out, Done> {
    hand_on: &'a mut (dyn FnMut([usize; 3], Vec<Option<Out>>) -> Result<Done> + Send),
    add: &'a mut (dyn FnMut(Done) + Send),
    /// Done, but not added: one before them is not done yet.
    waiting: BTreeMap<usize, Done>,
    /// The chunk to be added next.
    next: usize,
    /// The error of the first chunk, in the order of `chunks`, that had one.
    failure: Option<(usize, Error)>,
}

/// Runs `work` for each of the `slots` of every one of `chunks` on all threads of the pool: as a rule a slot is a brick.
///
/// `load` says what is there of a chunk; `work` gets a scratch of its thread, that, the chunk and the slot. `hand_on` gets the outputs of a chunk, one a slot (x fastest) when the last is there, one chunk at a time but
/// not in order; what it returns goes to `add` in the order of `chunks`.
///
/// `progress.stop` lets the chunks in work be finished and begins no other; `progress.cancel` drops them.
///
/// # Errors
/// Those of `load` and `hand_on`; of several the one of the first chunk.
pub(super) fn for_each_chunk<Old: Send + Sync, Out: Send, Done: Send, Scratch: Default>(
    slots: usize,
    chunks: &[[usize; 3]],
    progress: &Progress,
    load: &(dyn Fn([usize; 3]) -> Result<Old> + Sync),
    work: &Work<'_, Scratch, Old, Out>,
    hand_on: &mut (dyn FnMut([usize; 3], Vec<Option<Out>>) -> Result<Done> + Send),
    add: &mut (dyn FnMut(Done) + Send),
) -> Result<()> {
    let states: Vec<Mutex<Option<Chunk<Old, Out>>>> = chunks.iter().map(|_| Mutex::new(None)).collect();
    let (next, end) = (AtomicUsize::new(0), AtomicUsize::new(chunks.len()));
    let finish = Mutex::new(Finish { hand_on, add, waiting: BTreeMap::new(), next: 0, failure: None });
    let fail = |position: usize, error: Error| {
        end.fetch_min(0, Ordering::Relaxed);
        let mut finish = locked(&finish);
        if finish.failure.as_ref().is_none_or(|(first, _)| position < *first) {
            finish.failure = Some((position, error));
        }
    };
    let worker = || {
        let mut scratch = Scratch::default();
        loop {
            let item = next.fetch_add(1, Ordering::Relaxed);
            let (position, slot) = (item / slots, item % slots);
            // A chunk begins with its first brick: after that a stop lets it be finished.
            if slot == 0 && progress.stop.load(Ordering::Relaxed) {
                end.fetch_min(position, Ordering::Relaxed);
            }
            if position >= end.load(Ordering::Relaxed) || progress.cancel.load(Ordering::Relaxed) {
                return;
            }
            let chunk = chunks[position];
            let old = {
                let mut state = locked(&states[position]);
                let begin = || {
                    let outputs = std::iter::repeat_with(|| None).take(slots).collect();
                    Ok(Chunk { old: Some(Arc::new(load(chunk)?)), outputs, left: slots })
                };
                let begun = match state.take().map_or_else(begin, Ok) {
                    Ok(begun) => begun,
                    Err(error) => return fail(position, error),
                };
                let old = begun.old.clone();
                *state = Some(begun);
                old
            };
            let Some(old) = old else { return };
            let output = work(&mut scratch, &old, chunk, slot);
            if progress.cancel.load(Ordering::Relaxed) {
                return;
            }
            let whole = {
                let mut state = locked(&states[position]);
                let Some(begun) = state.as_mut() else { return };
                begun.outputs[slot] = output;
                begun.left -= 1;
                if begun.left == 0 { state.take() } else { None }
            };
            if let Some(whole) = whole {
                let mut finish = locked(&finish);
                match (finish.hand_on)(chunk, whole.outputs) {
                    Ok(done) => finish.take(position, done),
                    Err(error) => {
                        drop(finish);
                        return fail(position, error);
                    }
                }
            }
        }
    };
    rayon::broadcast(|_| worker());
    match locked(&finish).failure.take() {
        Some((_, error)) => Err(error),
        None => Ok(()),
    }
}

impl<Out, Done> Finish<'_, Out, Done> {
    /// Adds what a chunk brought, and what waited for it.
    fn take(&mut self, position: usize, done: Done) {
        self.waiting.insert(position, done);
        while let Some(done) = self.waiting.remove(&self.next) {
            (self.add)(done);
            self.next += 1;
        }
    }
}

/// Locks; a thread that panicked while it held the lock has ended the whole bake anyway.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SLOTS: usize = 64;

    fn chunks(n: usize) -> Vec<[usize; 3]> {
        (0..n).map(|i| [i, 0, 0]).collect()
    }

    /// A pool of so many threads, whatever the machine has.
    fn pool(threads: usize) -> rayon::ThreadPool {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
    }

    #[test]
    fn totals_are_added_in_order_and_chunks_are_whole_for_any_number_of_threads() {
        for threads in [1, 2, 7] {
            let (mut handed, mut added) = (Vec::new(), Vec::new());
            pool(threads)
                .install(|| {
                    for_each_chunk(
                        SLOTS,
                        &chunks(9),
                        &Progress::default(),
                        &|chunk| Ok(chunk[0]),
                        &|work: &mut usize, old, chunk, slot| {
                            *work += 1;
                            (slot != 5).then_some((*old, chunk, slot))
                        },
                        &mut |chunk, outputs: Vec<Option<(usize, [usize; 3], usize)>>| {
                            assert_eq!(outputs.len(), SLOTS);
                            for (slot, output) in outputs.iter().enumerate() {
                                assert_eq!(*output, (slot != 5).then_some((chunk[0], chunk, slot)));
                            }
                            handed.push(chunk[0]);
                            Ok(chunk[0])
                        },
                        &mut |position| added.push(position),
                    )
                })
                .unwrap();
            handed.sort_unstable();
            assert_eq!((handed, added), ((0..9).collect(), (0..9).collect::<Vec<_>>()), "{threads} threads");
        }
    }

    #[test]
    fn a_stop_finishes_the_chunks_in_work_and_a_cancel_drops_them() {
        for (cancel, threads) in [(false, 1), (false, 3), (true, 1), (true, 3)] {
            let progress = Progress::default();
            let mut handed = 0;
            let work = |_: &mut (), _: &(), chunk: [usize; 3], slot: usize| {
                if chunk[0] == 4 && slot == 20 {
                    let flag = if cancel { &progress.cancel } else { &progress.stop };
                    flag.store(true, Ordering::Relaxed);
                }
                Some(())
            };
            let mut hand_on = |_: [usize; 3], outputs: Vec<Option<()>>| {
                assert_eq!(outputs.iter().flatten().count(), SLOTS);
                handed += 1;
                Ok(())
            };
            pool(threads)
                .install(|| {
                    for_each_chunk(SLOTS, &chunks(64), &progress, &|_| Ok(()), &work, &mut hand_on, &mut |()| {})
                })
                .unwrap();
            // The fifth was in work when the flag was set; other threads may have begun one more each.
            match cancel {
                true => assert!(handed <= 4 + threads, "{handed} chunks after a cancel on {threads} threads"),
                false => assert!((5..=5 + threads).contains(&handed), "{handed} after a stop, {threads} threads"),
            }
            assert!(!cancel || threads > 1 || handed == 4, "{handed} chunks after a cancel");
        }
    }

    #[test]
    fn the_error_of_the_first_chunk_is_returned() {
        for threads in [1, 4] {
            let load = |chunk: [usize; 3]| match chunk[0] {
                3 => Err(Error::argument("chunk", chunk[0], "another", "none")),
                _ => Ok(()),
            };
            let mut hand_on = |_: [usize; 3], _: Vec<Option<()>>| Ok(());
            let progress = Progress::default();
            let work = |_: &mut (), _: &(), _: [usize; 3], _: usize| Some(());
            let found = pool(threads)
                .install(|| for_each_chunk(SLOTS, &chunks(8), &progress, &load, &work, &mut hand_on, &mut |()| {}));
            assert!(found.unwrap_err().to_string().contains('3'));
        }
    }
}
