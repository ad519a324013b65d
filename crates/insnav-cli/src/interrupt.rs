//! Ends by a signal: what was begun is removed, and the shell sees the code it expects.

/// Let SIGINT and SIGTERM remove half-written files before they end the process (with 130 and 143), and let a limit on the
/// size of files be an error of the write that meets it.
#[cfg(unix)]
pub(crate) fn leave_nothing_behind() {
    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
    let Ok(mut signals) = signal_hook::iterator::Signals::new([SIGHUP, SIGINT, SIGTERM, SIGXFSZ])
    else {
        // Without handlers the signals end the process as they always did.
        return;
    };
    std::thread::spawn(move || {
        for signal in signals.forever() {
            if signal != SIGXFSZ {
                insnav_log::remove_unfinished_outputs(|| std::process::exit(128 + signal));
            }
        }
    });
}

/// Elsewhere an interruption ends the process as the system has it.
#[cfg(not(unix))]
pub(crate) fn leave_nothing_behind() {}
