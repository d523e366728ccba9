//! `isolume cache`: what is in the cache of the user, and how much may be.

use crate::cache::Cache;
use crate::cli::args::transfer::parse_bytes;
use crate::cli::failure::{Failure, Outcome};
use crate::cli::present::console::Console;
use crate::cli::present::text;
use clap::Subcommand;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Look at the stores that relight and view keep of volumes, delete them, limit their size
#[derive(clap::Args)]
#[command(after_help = "Examples:
  isolume cache
  isolume cache clear
  isolume cache limit 50GB")]
pub(in crate::cli) struct CacheCommand {
    #[command(subcommand)]
    action: Option<Action>,
    /// The cache, as given to relight [default: the user's cache folder]
    #[arg(long, value_name = "DIR", global = true)]
    cache: Option<PathBuf>,
}

#[derive(Subcommand)]
enum Action {
    /// Print folder, size and last use of each store (the default)
    List,
    /// Delete all stores, or those named; what another process uses stays
    #[command(after_help = "Example:\n  isolume cache clear brain-0123456789abcdef.isolume")]
    Clear {
        /// Stores, as list prints them
        #[arg(value_name = "STORE")]
        names: Vec<String>,
    },
    /// Print or set the most that the cache may hold; beyond it the stores go whose last use is longest ago
    #[command(after_help = "Examples:\n  isolume cache limit\n  isolume cache limit 50GB\n  isolume cache limit none")]
    Limit {
        /// A size such as 50GB, or none
        #[arg(value_name = "SIZE", value_parser = parse_limit)]
        size: Option<Limit>,
    },
}

#[derive(Clone, Copy)]
struct Limit(Option<u64>);

fn parse_limit(text: &str) -> Result<Limit, String> {
    if text == "none" { Ok(Limit(None)) } else { parse_bytes(text).map(|bytes| Limit(Some(bytes))) }
}

impl CacheCommand {
    pub(in crate::cli) fn run(&self, console: &Console) -> Outcome {
        let cache = locate(self.cache.as_deref())?;
        match &self.action {
            None | Some(Action::List) => list(&cache, console),
            Some(Action::Clear { names }) => clear(&cache, names, console),
            Some(Action::Limit { size }) => limit(&cache, *size, console),
        }
    }
}

fn list(cache: &Cache, console: &Console) -> Outcome {
    let (entries, limit) = (cache.entries(), cache.limit()?);
    let total: u64 = entries.iter().map(|entry| entry.bytes).sum();
    let mut rows = vec![["store", "size", "last used", ""].map(String::from).to_vec()];
    for entry in entries.iter().rev() {
        let note = if entry.current { "" } else { "of another format, not used" };
        rows.push(vec![entry.name(), text::bytes(entry.bytes as f64), ago(entry.used), note.into()]);
    }
    let bound = limit.map_or("no limit".into(), |limit| format!("limit {}", text::bytes(limit as f64)));
    let stores = if entries.len() == 1 { "store" } else { "stores" };
    console.print(format!(
        "{}: {} {stores}, {}, {bound}",
        cache.folder().display(),
        entries.len(),
        text::bytes(total as f64)
    ));
    if !entries.is_empty() {
        console.print(text::table(&rows));
    }
    console.print_json(&json!({
        "folder": cache.folder().display().to_string(), "bytes": total, "limit": limit,
        "stores": entries.iter().rev().map(|entry| json!({
            "path": entry.path.display().to_string(), "bytes": entry.bytes, "current_format": entry.current,
            "last_used_unix": entry.used.duration_since(UNIX_EPOCH).map_or(0, |time| time.as_secs()),
        })).collect::<Vec<_>>(),
    }));
    Ok(())
}

fn clear(cache: &Cache, names: &[String], console: &Console) -> Outcome {
    let (gone, kept) = cache.clear(names)?;
    kept.iter().for_each(|entry| console.note(format!("{} is in use and stays", entry.name())));
    let removed: Vec<String> = gone.iter().map(|entry| entry.path.display().to_string()).collect();
    let bytes: u64 = gone.iter().map(|entry| entry.bytes).sum();
    let stores = if removed.len() == 1 { "store" } else { "stores" };
    console.print(format!("{} {stores} deleted, {}", removed.len(), text::bytes(bytes as f64)));
    console.print_json(&json!({ "removed": removed, "bytes": bytes, "in_use": kept.len() }));
    Ok(())
}

fn limit(cache: &Cache, size: Option<Limit>, console: &Console) -> Outcome {
    if let Some(Limit(size)) = size {
        prepare(cache)?;
        cache.set_limit(size, &|text| console.note(text))?;
    }
    let limit = cache.limit()?;
    console.print(limit.map_or("no limit".into(), |limit| text::bytes(limit as f64)));
    console.print_json(&json!({ "limit": limit }));
    Ok(())
}

/// The cache in the folder that the user gave, or in that of the system.
fn locate(given: Option<&Path>) -> Outcome<Cache> {
    let of_system = || directories::ProjectDirs::from("", "", "isolume").map(|f| f.cache_dir().to_path_buf());
    given.map(Path::to_path_buf).or_else(of_system).map(Cache::at).ok_or_else(|| {
        Failure::Message("this system has no cache folder for the user: name one with --cache DIR".into())
    })
}

/// The same, made ready for stores.
pub(crate) fn ready(given: Option<&Path>) -> Outcome<Cache> {
    let cache = locate(given)?;
    prepare(&cache)?;
    Ok(cache)
}

/// Makes the folder of the stores, and tries to write there.
fn prepare(cache: &Cache) -> Outcome {
    cache.prepare().map_err(|e| {
        Failure::Message(format!(
            "cannot write into the cache folder {}: {e}; name another one with --cache DIR, or bake into a store of \
             your own: isolume bake",
            cache.stores().display()
        ))
    })
}

/// How long ago, roughly.
fn ago(time: SystemTime) -> String {
    let past = SystemTime::now().duration_since(time).unwrap_or(Duration::ZERO).as_secs();
    match past {
        0..60 => "just now".into(),
        60..3600 => format!("{} min ago", past / 60),
        3600..86_400 => format!("{} h ago", past / 3600),
        _ => format!("{} days ago", past / 86_400),
    }
}
