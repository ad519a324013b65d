//! Standard output and standard error: who gets what.

use crate::failure::Failure;
use insnav_log::Warning;
use serde::Serialize;
use std::io::{IsTerminal, Write};

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
}

impl Output {
    pub(crate) fn new(format: Format) -> Self {
        // https://no-color.org: set and not empty means no colour.
        let refused = std::env::var_os("NO_COLOR").is_some_and(|v| !v.is_empty());
        Output {
            format,
            colour: !refused && std::io::stderr().is_terminal(),
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
        // A reader that closed the pipe has seen enough: that is no failure.
        let _ = writeln!(std::io::stdout(), "{}", text.trim_end());
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
            let _ = writeln!(std::io::stdout(), "{object:#}");
        }
        self.say(
            "31",
            "error",
            &format!("{}\n  remedy: {}", failure.message, failure.remedy),
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
        let _ = writeln!(std::io::stderr(), "{label}: {text}");
    }
}
