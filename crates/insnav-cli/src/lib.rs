//! The command line of insnav: arguments in, text or JSON out; everything else lives in [`insnav_log`] and [`insnav_core`].
//!
//! Results go to standard output, as text or as one JSON object; everything said about them goes to standard error. A failure
//! is one object `{error: {code, message, remedy}}` in JSON mode. Exit codes: 0 done, 1 failed, 2 wrong usage, 3 done, but
//! with warnings about the data under `--strict`; 130 and 143 interrupted and terminated, 141 when the reader of a solution
//! on standard output went away.

mod args;
mod command;
pub mod experiments;
mod failure;
mod interrupt;
mod output;
mod progress;
mod reproduce;
mod text;

use clap::Parser;
use failure::Failure;
use output::{Format, Output};
use std::ffi::OsString;
use std::process::ExitCode;

/// Run the command line and say with which code the process should end.
pub fn main(arguments: impl IntoIterator<Item = OsString>) -> ExitCode {
    ExitCode::from(run(arguments))
}

/// The same for a process that is not ours, with the code as a number.
pub fn run(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let parsed = match args::Cli::try_parse_from(&arguments) {
        Ok(parsed) => parsed,
        Err(error) if !error.use_stderr() => {
            // --help and --version; a closed pipe is the reader's business.
            let _ = error.print();
            return 0;
        }
        Err(error) => {
            let output = Output::new(if wants_json(&arguments) {
                Format::Json
            } else {
                Format::Text
            });
            if output.format() == Format::Json {
                output.failure(&Failure::from_clap(&error));
            } else {
                let _ = error.print();
            }
            return failure::USAGE;
        }
    };
    let output = Output::new(parsed.format);
    interrupt::leave_nothing_behind();
    let code = match parsed.verb.run(&output) {
        Ok(code) => code,
        Err(failure) => {
            if !failure.quiet {
                output.failure(&failure);
            }
            failure.exit
        }
    };
    match output.undelivered() {
        Some(failure) => {
            output.complain(&failure);
            failure.exit.max(code)
        }
        None => code,
    }
}

/// Whether the arguments, which did not parse as a whole, ask for JSON.
fn wants_json(arguments: &[OsString]) -> bool {
    arguments
        .windows(2)
        .any(|w| w[0] == "--format" && w[1] == "json")
        || arguments.iter().any(|a| a == "--format=json")
}
