//! Long work that Ctrl-C ends at once.
//!
//! Python handles signals between its own instructions only, so that a loop in Rust would hold them back until it is over. Work that is a
//! function of what it owns goes to a thread of its own ([`interruptible`]), while the caller waits with the interpreter released and looks
//! for signals. Loops over an object that is somebody else's look for themselves ([`Signals`]).

use insnav_log::{RunError, abandon_outputs_of, is_standard_stream};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::panic;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

/// How often signals are looked for: an eighth of what users take for "at once".
const TICK: Duration = Duration::from_millis(25);
/// How long work that was asked to stop is waited for.
const GRACE: Duration = Duration::from_millis(50);
/// As much as the main thread of a process has.
const STACK_BYTES: usize = 8 << 20;

/// What the work can see of the one who waits for it.
#[derive(Debug, Default)]
pub(crate) struct Stop {
    asked: AtomicBool,
    writing: AtomicBool,
}

impl Stop {
    /// Set when nobody waits for the result any more: see [`insnav_log::Stoppable`].
    pub(crate) fn asked(&self) -> &AtomicBool {
        &self.asked
    }

    /// Whether somebody waits for the result still.
    pub(crate) fn proceed(&self) -> bool {
        !self.asked.load(Ordering::Relaxed)
    }

    /// The same for loops that end by an error.
    ///
    /// # Errors
    /// Nobody waits any more.
    pub(crate) fn check(&self) -> Result<(), RunError> {
        if self.proceed() {
            Ok(())
        } else {
            Err(RunError::Interrupted)
        }
    }

    /// Before a file is begun: from now on one who gives up the work gives up what its thread writes too. Standard output cannot be taken
    /// back, so that nobody waits for it.
    ///
    /// # Errors
    /// Nobody waits any more, and nobody would remove the file: it must not be begun.
    pub(crate) fn writes(&self, target: &Path) -> Result<(), RunError> {
        if !is_standard_stream(target) {
            self.writing.store(true, Ordering::SeqCst);
        }
        // The one who waits sets `asked` before it reads `writing`: one of the two sees the other.
        if self.asked.load(Ordering::SeqCst) {
            return Err(RunError::Interrupted);
        }
        Ok(())
    }
}

/// Do `work` with the interpreter released, until it is done or a signal handler raises, as that of Ctrl-C does.
///
/// Work that has been given up ends in its own time, unheard; `Stop` tells it to.
pub(crate) fn interruptible<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce(&Stop) -> T + Send + 'static,
) -> PyResult<T> {
    let stop = Arc::new(Stop::default());
    let (done, mut result) = mpsc::sync_channel(1);
    let seen = Arc::clone(&stop);
    let worker = thread::Builder::new()
        .name("insnav".to_owned())
        .stack_size(STACK_BYTES)
        .spawn(move || {
            // Nobody listens any more after an interruption.
            let _ = done.send(work(&seen));
        })
        .map_err(|e| PyRuntimeError::new_err(format!("no thread to work in: {e}")))?;
    let thread = worker.thread().id();
    loop {
        let (answer, back) = wait(py, result, TICK);
        result = back;
        match answer {
            Ok(value) => return Ok(value),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => match worker.join() {
                Err(cause) => panic::resume_unwind(cause),
                Ok(()) => return Err(PyRuntimeError::new_err("the work ended without a result")),
            },
        }
        if let Err(raised) = py.check_signals() {
            stop.asked.store(true, Ordering::SeqCst);
            let (_, mut result) = wait(py, result, GRACE);
            // Nothing half-written is left behind, were the process to end now. Others may hold what gives up a file while they open theirs.
            while stop.writing.load(Ordering::SeqCst)
                && py.detach(|| abandon_outputs_of(thread)) == 0
            {
                let (answer, back) = wait(py, result, TICK);
                result = back;
                // A second signal does not wait for a disk that does not answer.
                if !matches!(answer, Err(RecvTimeoutError::Timeout)) || py.check_signals().is_err()
                {
                    break;
                }
            }
            return Err(raised);
        }
    }
}

type Answer<T> = Result<T, RecvTimeoutError>;

/// Wait with the interpreter released. The receiver goes along, since it must not be shared.
fn wait<T: Send>(
    py: Python<'_>,
    result: Receiver<T>,
    longest: Duration,
) -> (Answer<T>, Receiver<T>) {
    py.detach(move || (result.recv_timeout(longest), result))
}

/// Looks for signals from inside a loop that runs with the interpreter released.
pub(crate) struct Signals {
    rounds: u32,
    /// The clock is read once in so many rounds.
    every: u32,
    next: Instant,
}

impl Signals {
    pub(crate) fn new() -> Self {
        Signals {
            rounds: 0,
            every: 64,
            next: Instant::now() + TICK,
        }
    }

    /// Of rounds that may be long each: the clock is asked at all of them.
    pub(crate) fn of_long_rounds() -> Self {
        Signals {
            every: 1,
            ..Signals::new()
        }
    }

    /// Call once a round. The interpreter is asked every 25 ms at most, the clock every 64 rounds.
    ///
    /// # Errors
    /// What the handler of a signal raised.
    pub(crate) fn look(&mut self) -> PyResult<()> {
        self.rounds = self.rounds.wrapping_add(1);
        if !self.rounds.is_multiple_of(self.every) || Instant::now() < self.next {
            return Ok(());
        }
        Python::attach(|py| py.check_signals())?;
        self.next = Instant::now() + TICK;
        Ok(())
    }
}
