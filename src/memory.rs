//! How much memory this process may have, and what sets the bound: the machine, RLIMIT_AS (`ulimit -v`), RLIMIT_DATA (`ulimit -d`), or
//! a control group as batch systems and containers make them.

use crate::error::{Error, Result};
use crate::quantity;
use std::path::{Path, PathBuf};

/// A bound on memory.
pub struct Bound {
    /// What a bake may plan with: 80 % of the bound.
    pub bytes: u64,
    /// What the bound is, for messages.
    pub set_by: String,
}

/// Where the system tells nothing.
const UNKNOWN: u64 = 4 << 30;

/// The smallest of the bounds that the system states.
pub fn bound() -> Bound {
    let all = [of_machine(), of_address_space(), of_data(), of_control_group()];
    let unknown = Bound { bytes: UNKNOWN, set_by: "this system does not tell its memory".into() };
    all.into_iter().flatten().min_by_key(|bound| bound.bytes).unwrap_or(unknown)
}

/// Refuses by name what would take more memory than allowed: by the user, else by the system.
///
/// # Errors
/// [`Error::Limit`] with both amounts and what sets the bound.
pub fn check(what: &str, needed: u64, limit: Option<u64>) -> Result<()> {
    let bound = limit.map_or_else(bound, |bytes| Bound { bytes, set_by: "--memory-limit".into() });
    if needed <= bound.bytes {
        return Ok(());
    }
    Err(Error::Limit {
        what: what.into(),
        needed: quantity::bytes(needed as f64),
        limit: format!("{} ({})", quantity::bytes(bound.bytes as f64), bound.set_by),
        remedy: "raise it, or lower --texture, --layers or --bands, or give fewer --isovalues at a time; \
                 --memory-limit SIZE takes the place of this limit"
            .into(),
    })
}

/// The memory that a command may use where the user does not say: 80 % of the least that machine and system allow.
pub fn default_limit() -> u64 {
    bound().bytes
}

/// What is left for the rest of the program and for what a forecast misses.
fn usable(bytes: u64) -> u64 {
    bytes / 5 * 4
}

fn of_machine() -> Option<Bound> {
    let info = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = info.lines().find(|line| line.starts_with("MemTotal:"))?;
    let bytes = line.split_whitespace().nth(1)?.parse::<u64>().ok()?.checked_mul(1024)?;
    Some(Bound { bytes: usable(bytes), set_by: format!("80 % of this machine's {}", quantity::bytes(bytes as f64)) })
}

#[cfg(unix)]
fn of_address_space() -> Option<Bound> {
    of_process(rustix::process::Resource::As, "VmSize:", "RLIMIT_AS, ulimit -v,")
}

/// Of memory that is no map of a file.
#[cfg(unix)]
fn of_data() -> Option<Bound> {
    of_process(rustix::process::Resource::Data, "VmData:", "RLIMIT_DATA, ulimit -d,")
}

#[cfg(unix)]
fn of_process(resource: rustix::process::Resource, field: &str, name: &str) -> Option<Bound> {
    let limit = rustix::process::getrlimit(resource).current?;
    // What is taken already: the program, stacks, the volume, which a forecast counts again.
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix(field));
    let taken = line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok()).unwrap_or(0);
    let bytes = usable(limit.saturating_sub(taken.saturating_mul(1024)));
    Some(Bound { bytes, set_by: format!("{name} is {}", quantity::bytes(limit as f64)) })
}

#[cfg(not(unix))]
fn of_address_space() -> Option<Bound> {
    None
}

#[cfg(not(unix))]
fn of_data() -> Option<Bound> {
    None
}

fn of_control_group() -> Option<Bound> {
    let groups = std::fs::read_to_string("/proc/self/cgroup").ok()?;
    let (bytes, file) = smallest_of_groups(&groups, Path::new("/sys/fs/cgroup"))?;
    Some(Bound { bytes: usable(bytes), set_by: format!("{} is {}", file.display(), quantity::bytes(bytes as f64)) })
}

/// The smallest limit on the way from the group of a process up to the root, and its file. `groups` is `/proc/self/cgroup`:
/// lines `0::/path` (version 2) and `n:memory:/path` (version 1).
fn smallest_of_groups(groups: &str, root: &Path) -> Option<(u64, PathBuf)> {
    let mut smallest: Option<(u64, PathBuf)> = None;
    for line in groups.lines() {
        let mut parts = line.splitn(3, ':');
        let (Some(_), Some(controllers), Some(path)) = (parts.next(), parts.next(), parts.next()) else { continue };
        let (root, name) = match controllers {
            "" => (root.to_path_buf(), "memory.max"),
            list if list.split(',').any(|c| c == "memory") => (root.join("memory"), "memory.limit_in_bytes"),
            _ => continue,
        };
        // In a container the path may be that of the host: then only the root is there.
        let group = root.join(path.trim_start_matches('/'));
        for folder in group.ancestors().take_while(|folder| folder.starts_with(&root)) {
            let file = folder.join(name);
            // "max", and in version 1 a number beyond all memory, mean none.
            let limit = std::fs::read_to_string(&file).ok().and_then(|text| text.trim().parse::<u64>().ok());
            if let Some(limit) = limit.filter(|limit| smallest.as_ref().is_none_or(|(least, _)| limit < least)) {
                smallest = Some((limit, file));
            }
        }
    }
    smallest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_limit_of_the_groups_above_a_process_counts() {
        let root = tempfile::tempdir().expect("a folder");
        let write = |path: &str, text: &str| {
            let path = root.path().join(path);
            std::fs::create_dir_all(path.parent().expect("a parent")).expect("folders");
            std::fs::write(path, text).expect("a file");
        };
        write("a/b/memory.max", "max\n");
        write("a/memory.max", "3000000000\n");
        write("memory/job/memory.limit_in_bytes", "2000000000\n");
        write("memory/memory.limit_in_bytes", "9223372036854771712\n");
        let found = |groups: &str| smallest_of_groups(groups, root.path()).map(|(bytes, _)| bytes);
        assert_eq!(found("0::/a/b\n"), Some(3_000_000_000));
        assert_eq!(found("12:memory:/job\n1:name=systemd:/a\n0::/\n"), Some(2_000_000_000));
        assert_eq!(found("3:cpu,memory:/not/here\n"), Some(9_223_372_036_854_771_712));
        assert_eq!(found("0::/nowhere\n"), None);
        assert_eq!(found("no group\n"), None);
    }
}
