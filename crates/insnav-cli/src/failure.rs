//! Why a command did not do its job: the same three parts for people and for programs.

use insnav_log::{ConfigError, LogError, RunError};
use serde::Serialize;
use std::error::Error;

/// Exit code of a command that failed.
pub(crate) const FAILED: u8 = 1;
/// Exit code of wrong usage.
pub(crate) const USAGE: u8 = 2;
/// Exit code of a command that did its job on data with warnings, under `--strict`.
pub(crate) const WARNED: u8 = 3;

/// A failure, with what to do about it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Failure {
    /// A short name for programs.
    pub(crate) code: String,
    /// What happened, and where.
    pub(crate) message: String,
    /// What to do about it.
    pub(crate) remedy: String,
    /// How the process ends.
    #[serde(skip)]
    pub(crate) exit: u8,
}

impl Failure {
    pub(crate) fn new(code: &str, message: impl Into<String>, remedy: impl Into<String>) -> Self {
        Failure {
            code: code.into(),
            message: message.into(),
            remedy: remedy.into(),
            exit: FAILED,
        }
    }

    pub(crate) fn usage(message: impl Into<String>, remedy: impl Into<String>) -> Self {
        Failure {
            exit: USAGE,
            ..Failure::new("usage", message, remedy)
        }
    }

    pub(crate) fn from_clap(error: &clap::Error) -> Self {
        let text = error.to_string();
        let text = text.strip_prefix("error: ").unwrap_or(&text);
        let (message, rest) = text.split_once("\n\n").unwrap_or((text, ""));
        let tip = rest.lines().find_map(|l| l.trim().strip_prefix("tip: "));
        let remedy = tip.map_or_else(|| "see --help".to_owned(), str::to_owned);
        Failure::usage(message.trim(), remedy)
    }

    /// A file that cannot be written.
    pub(crate) fn not_writable(path: &std::path::Path, error: &std::io::Error) -> Self {
        Failure::new(
            "output_not_writable",
            format!("{}: cannot be written: {error}", path.display()),
            "choose a folder that exists, can be written and has room",
        )
    }
}

/// An error with its causes in one line.
fn chain(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut next = error.source();
    while let Some(cause) = next {
        let cause_text = cause.to_string();
        // Some errors repeat their cause in their own text.
        if !text.contains(&cause_text) {
            text = format!("{text}: {cause_text}");
        }
        next = cause.source();
    }
    text
}

impl From<LogError> for Failure {
    fn from(e: LogError) -> Self {
        Failure::new(e.code(), chain(&e), e.remedy())
    }
}

impl From<ConfigError> for Failure {
    fn from(e: ConfigError) -> Self {
        Failure::new(e.code(), chain(&e), e.remedy())
    }
}

impl From<RunError> for Failure {
    fn from(e: RunError) -> Self {
        Failure::new(e.code(), chain(&e), e.remedy())
    }
}
