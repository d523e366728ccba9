//! A mapped file, of a store or of samples, that another program cuts off while it is read: an error, not a process that is gone without a
//! word.
//!
//! The system answers a look at a page that the file no longer has with SIGBUS, in the middle of any instruction; nothing
//! can be finished then. Files that were being written are temporary until they are whole (`staging`), so to say why and to
//! leave is enough. The library installs no handler: a program that cannot have the signal opens its stores with
//! [`crate::transfer::store::Store::open_unmapped`], and maps no volume: [`crate::volume::Choice::map`] is off there, and so is
//! [`crate::transfer::store::Store::map_samples`] for files that stores name.

/// What the user reads.
#[cfg(unix)]
const MESSAGE: &[u8] =
    b"error: a file of the store or the volume shrank while it was read: another program changes it. \
    Nothing was written; look at the store with `isolume verify` and try again; --no-map reads a volume at once\n";

/// From now on a bus error ends the process with a message and exit code 1.
///
/// The handler takes the place of the one that Rust's runtime has for stack overflows (a SIGSEGV on Linux): that one sets the
/// default action first, which ends the process at once when a second thread meets the cut-off file meanwhile.
#[cfg(unix)]
#[allow(unsafe_code)]
pub fn explain_bus_errors() {
    extern "C" fn answer(_: libc::c_int) {
        // SAFETY: write(2) and _exit(2) are async-signal-safe; nothing is allocated, no lock is taken, nothing can panic.
        unsafe {
            libc::write(libc::STDERR_FILENO, MESSAGE.as_ptr().cast(), MESSAGE.len());
            libc::_exit(1);
        }
    }
    // SAFETY: `action` is a plain struct for which zeros are a value (no flags, no blocked signals); it outlives the call, and
    // `answer` has the signature that a handler without SA_SIGINFO has. SA_ONSTACK: threads of Rust have a stack for signals.
    unsafe {
        let mut action: libc::sigaction = std::mem::zeroed();
        action.sa_sigaction = answer as extern "C" fn(libc::c_int) as usize;
        action.sa_flags = libc::SA_ONSTACK;
        libc::sigaction(libc::SIGBUS, &action, std::ptr::null_mut());
    }
}

/// Other systems do not let a mapped file be cut off.
#[cfg(not(unix))]
pub fn explain_bus_errors() {}
