//! Why a command did not do its job: the same three parts for people and for programs, and an exit code.

use insnav_log::{ConfigError, LogError, Problem, RunError};
use serde::Serialize;

/// Exit code of a command that failed.
pub(crate) const FAILED: u8 = 1;
/// Exit code of wrong usage: a flag, a value of a flag, or a combination of flags.
pub(crate) const USAGE: u8 = 2;
/// Exit code of a command that did its job on data with warnings, under `--strict`.
pub(crate) const WARNED: u8 = 3;
/// Exit code when the reader of a binary output went away: that of a process ended by SIGPIPE.
pub(crate) const PIPE_CLOSED: u8 = 128 + 13;

/// A failure, with what to do about it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct Failure {
    #[serde(flatten)]
    pub(crate) problem: Problem,
    /// How the process ends.
    #[serde(skip)]
    pub(crate) exit: u8,
    /// Nobody is there to be told.
    #[serde(skip)]
    pub(crate) quiet: bool,
}

impl Failure {
    pub(crate) fn new(
        code: &'static str,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Problem::new(code, message, remedy).into()
    }

    pub(crate) fn usage(message: impl Into<String>, remedy: impl Into<String>) -> Self {
        Failure::new("usage", message, remedy).into_usage()
    }

    /// The same, laid to what was typed.
    pub(crate) fn into_usage(self) -> Self {
        Failure {
            exit: USAGE,
            ..self
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

    /// The same, with the file that it is about in front where the message does not name it.
    pub(crate) fn about(mut self, path: &std::path::Path) -> Self {
        let path = path.display().to_string();
        if !self.problem.message.contains(&path) {
            self.problem.message = format!("{path}: {}", self.problem.message);
        }
        self
    }

    /// A file that cannot be written.
    pub(crate) fn not_writable(path: &std::path::Path, error: std::io::Error) -> Self {
        LogError::OutputNotWritable {
            path: path.into(),
            source: error,
        }
        .into()
    }
}

impl std::ops::Deref for Failure {
    type Target = Problem;

    fn deref(&self) -> &Problem {
        &self.problem
    }
}

impl From<Problem> for Failure {
    fn from(problem: Problem) -> Self {
        Failure {
            problem,
            exit: FAILED,
            quiet: false,
        }
    }
}

impl From<LogError> for Failure {
    fn from(e: LogError) -> Self {
        match &e {
            LogError::OutputNotWritable { path, source }
                if insnav_log::is_standard_stream(path)
                    && source.kind() == std::io::ErrorKind::BrokenPipe =>
            {
                Failure {
                    exit: PIPE_CLOSED,
                    quiet: true,
                    ..Problem::from(e).into()
                }
            }
            LogError::OutputIsTerminal => Failure::from(Problem::from(e)).into_usage(),
            _ => Problem::from(e).into(),
        }
    }
}

impl From<ConfigError> for Failure {
    fn from(e: ConfigError) -> Self {
        Problem::from(e).into()
    }
}

impl From<RunError> for Failure {
    fn from(e: RunError) -> Self {
        match e {
            RunError::Log(e) => e.into(),
            e => Problem::from(e).into(),
        }
    }
}
