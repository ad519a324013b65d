//! Standard output and standard error: who gets what.

use crate::failure::Failure;
use insnav_log::Warning;
use serde::Serialize;
use std::cell::{Cell, RefCell};
use std::io::{self, ErrorKind, IsTerminal, Write};

/// How a command answers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Format {
    /// For people.
    #[default]
    Text,
    /// One JSON object on standard output.
    Json,
}

/// The two streams.
pub(crate) struct Output {
    format: Format,
    colour: bool,
    /// Standard output carries a file: text and JSON go to standard error.
    binary: Cell<bool>,
    /// What kept a result from being told.
    undelivered: RefCell<Option<io::Error>>,
}

impl Output {
    pub(crate) fn new(format: Format) -> Self {
        // https://no-color.org: set and not empty means no colour.
        let refused = std::env::var_os("NO_COLOR").is_some_and(|v| !v.is_empty());
        Output {
            format,
            colour: !refused && io::stderr().is_terminal(),
            binary: Cell::new(false),
            undelivered: RefCell::new(None),
        }
    }

    /// From now on standard output belongs to a file that is written there.
    pub(crate) fn leave_stdout_to_a_file(&self) {
        self.binary.set(true);
    }

    /// Why a result could not be told, if so. A reader that closed the pipe has seen enough: that is no failure.
    pub(crate) fn undelivered(&self) -> Option<Failure> {
        let error = self.undelivered.take()?;
        Some(Failure::new(
            "output_not_writable",
            format!("standard output: cannot be written: {error}"),
            "make room where standard output goes",
        ))
    }

    fn print(&self, text: &str) {
        let written = if self.binary.get() {
            writeln!(io::stderr(), "{text}")
        } else {
            let mut out = io::stdout();
            writeln!(out, "{text}").and_then(|()| out.flush())
        };
        if let Err(error) = written
            && error.kind() != ErrorKind::BrokenPipe
        {
            self.undelivered.borrow_mut().get_or_insert(error);
        }
    }

    pub(crate) fn format(&self) -> Format {
        self.format
    }

    /// The result, in the form asked for.
    pub(crate) fn result(&self, value: &impl Serialize, text: impl FnOnce() -> String) {
        let text = match self.format {
            Format::Text => text(),
            Format::Json => serde_json::to_string_pretty(value).expect(
                "reports are numbers, strings and lists with string keys, all of which JSON has",
            ),
        };
        self.print(text.trim_end());
    }

    /// What the user should know besides the result.
    pub(crate) fn warnings(&self, warnings: &[Warning]) {
        for w in warnings {
            self.say(
                "33",
                "warning",
                &format!("{}\n  remedy: {}", w.message, w.remedy),
            );
        }
    }

    /// Why there is no result.
    pub(crate) fn failure(&self, failure: &Failure) {
        if self.format == Format::Json {
            let object = serde_json::json!({ "error": failure });
            self.print(&format!("{object:#}"));
        }
        self.complain(failure);
    }

    /// The human text of a failure alone.
    pub(crate) fn complain(&self, failure: &Failure) {
        let problem = &failure.problem;
        self.say(
            "31",
            "error",
            &format!("{}\n  remedy: {}", problem.message, problem.remedy),
        );
    }

    /// One line about the result.
    pub(crate) fn note(&self, label: &str, text: &str) {
        self.say("33", label, text);
    }

    fn say(&self, colour: &str, label: &str, text: &str) {
        let label = if self.colour {
            format!("\x1b[1;{colour}m{label}\x1b[0m")
        } else {
            label.to_owned()
        };
        let _ = writeln!(io::stderr(), "{label}: {text}");
    }
}
