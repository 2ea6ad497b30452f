//! The end of a program by a signal: it removes the temporary files first.

use std::io;

use deepshadow::raw::remove_temporaries;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use signal_hook::low_level::emulate_default_handler;

/// Starts a thread that waits for SIGINT, SIGTERM or SIGHUP. It removes the temporary files of
/// unfinished outputs, and then the process ends by the same signal. Shells show that as the exit
/// codes 130, 143 and 129, and a loop of a shell ends, too.
///
/// # Errors
/// Those of the system.
pub(crate) fn end_cleanly() -> io::Result<()> {
    // A signal that the caller had ignored, such as SIGHUP by `nohup`, stays ignored.
    let watched = [SIGINT, SIGTERM, SIGHUP]
        .into_iter()
        .filter(|s| !is_ignored(*s));
    let mut signals = Signals::new(watched)?;
    let wait = move || {
        if let Some(signal) = signals.forever().next() {
            let _no_others_appear = remove_temporaries();
            let _ = emulate_default_handler(signal);
        }
    };
    std::thread::Builder::new()
        .name("signals".into())
        .spawn(wait)?;
    Ok(())
}

fn is_ignored(signal: i32) -> bool {
    // SAFETY: the structure holds integers, pointers and a set of bits, so zeros are a valid value.
    let mut now: libc::sigaction = unsafe { std::mem::zeroed() };
    // SAFETY: without a new action, the call changes nothing but `now`, which is ours.
    let result = unsafe { libc::sigaction(signal, std::ptr::null(), &mut now) };
    result == 0 && now.sa_sigaction == libc::SIG_IGN
}
