//! A mapped file of a store that another program cuts off while it is read: an error, not a process that is gone without a
//! word.
//!
//! The system answers a look at a page that the file no longer has with SIGBUS, in the middle of any instruction; nothing
//! can be finished then. Files that were being written are temporary until they are whole (`staging`), so to say why and to
//! leave is enough. The library installs no handler: a program that cannot have the signal opens its stores with
//! [`crate::transfer::store::Store::open_unmapped`].

/// What the user reads.
#[cfg(unix)]
const MESSAGE: &[u8] = b"error: a file of the store shrank while it was read: another program changes it. Nothing was \
    written; look at the store with `isolume verify` and try again\n";

/// From now on a bus error ends the process with a message and exit code 1.
#[cfg(unix)]
#[allow(unsafe_code)]
pub(super) fn explain_bus_errors() {
    let answer = || {
        let _ = rustix::io::write(rustix::stdio::stderr(), MESSAGE);
        signal_hook::low_level::exit(1);
    };
    // SAFETY: the action runs inside a signal handler. It calls write(2) and _exit(2) alone, which are async-signal-safe;
    // it allocates nothing, takes no lock and cannot panic.
    let _ = unsafe { signal_hook::low_level::register(signal_hook::consts::SIGBUS, answer) };
}

/// Other systems do not let a mapped file be cut off.
#[cfg(not(unix))]
pub(super) fn explain_bus_errors() {}
