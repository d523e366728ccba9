//! Every reader under damaged, hostile and senseless input: it ends in `Ok` or `Err`, within a stated
//! memory, without a panic.
//!
//! The gate runs a fixed number of inputs for each target, the same ones every time; `probes/measure/fuzz.rs` runs
//! others, as long as it is told to. An input that fails is kept in target/evidence/, its target and number are
//! printed; copied into tests/fuzz/corpus/<target>/ it is a seed from then on.

mod documents;
mod engine;
mod memory;
mod mutate;
mod regressions;
mod seeds;
#[allow(dead_code, reason = "shared with probes/measure/fuzz.rs")]
mod targets;

use engine::{Tally, feed, watched};
use std::sync::{Mutex, MutexGuard, PoisonError};
use targets::{Bench, TARGETS};

#[global_allocator]
static ALLOCATOR: memory::Counting = memory::Counting;

/// Tests of this binary take turns, so that what is counted is one input's.
fn turn() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
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
