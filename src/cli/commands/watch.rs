//! `isolume info --watch`: how far all processes have come that fill a store.

use crate::cli::failure::Outcome;
use crate::cli::present::console::Console;
use crate::cli::present::text;
use crate::error::Error;
use crate::inspect::{Look, Watch};
use crate::transfer::store::Store;
use serde_json::json;
use std::time::{Duration, Instant};

/// Looks at the store again and again, and prints a line whenever there is news, until all that was asked is there.
pub(in crate::cli) fn follow(argument: &str, every: Duration, console: &Console) -> Outcome {
    let start = Instant::now();
    let mut watch = Watch::default();
    let mut first: Option<(Instant, u64)> = None;
    let mut told = None;
    loop {
        let store = Store::open(argument)?.map_samples(true);
        let look = match watch.look(&store) {
            Ok(look) => look,
            // A surface that is just being added: the next look finds it whole.
            Err(Error::Format { .. } | Error::Io { .. }) if start.elapsed() < SETTLING => Look::default(),
            Err(other) => return Err(other.into()),
        };
        let (since, before) = *first.get_or_insert((Instant::now(), look.there));
        let rate = look.there.saturating_sub(before) as f64 / since.elapsed().as_secs_f64().max(1e-3);
        let processes = store.processes();
        if told.as_ref() != Some(&(look, processes.len())) {
            tell(&look, rate, &processes, console);
            told = Some((look, processes.len()));
        }
        if look.asked > 0 && look.there >= look.asked && processes.is_empty() {
            return Ok(());
        }
        std::thread::sleep(every);
    }
}

/// How long metadata may be found half written before that is an error.
const SETTLING: Duration = Duration::from_secs(60);

fn tell(look: &Look, rate: f64, processes: &[String], console: &Console) {
    let share = if look.asked > 0 { look.there as f64 / look.asked as f64 } else { 0.0 };
    let left = look.asked - look.there.min(look.asked);
    let seconds = (rate > 0.0).then(|| left as f64 / rate);
    let eta = match seconds {
        Some(seconds) if left > 0 => {
            format!(", about {} left", text::duration(Duration::from_secs_f64(seconds.min(1e9))))
        }
        _ => String::new(),
    };
    let (there, asked) = (text::count(look.there), text::count(look.asked));
    console.print(format!(
        "{there} of {asked} texels or vertices, {}; {}/s{eta}",
        text::percent(share),
        text::metric(rate)
    ));
    match processes.len() {
        0 => console.detail("  nobody is at work"),
        n => console.detail(format!("  {n} at work: {}", processes.join("; "))),
    }
    console.print_json(&json!({
        "asked": look.asked, "there": look.there, "per_second": rate, "seconds_left": seconds, "processes": processes,
    }));
}
