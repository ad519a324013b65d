//! The command `insnav`, as the wheel brings it.

use pyo3::prelude::*;
use std::ffi::OsString;
use std::io::{self, Write};

/// Run the command line.
///
/// Meant for a process of its own, as the script ``insnav`` is: it writes to standard output and standard error, and a signal ends the
/// process. Signals must have their default actions.
///
/// Parameters
/// ----------
/// arguments : list of str
///     The name of the program, and what follows it.
///
/// Returns
/// -------
/// int
///     Exit code.
#[pyfunction]
#[pyo3(signature = (arguments))]
pub(crate) fn command(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| {
        let code = insnav_cli::run(arguments);
        // Rust does this where a process is its own. What was written is complete by now; a reader that went away has seen enough.
        let _ = io::stdout().flush();
        code
    })
}
