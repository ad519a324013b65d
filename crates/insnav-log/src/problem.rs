//! What goes wrong, as users and programs are told of it: the same three parts everywhere.

use crate::error::LogError;
use crate::{ConfigError, RunError};
use insnav_core::error::Error as CoreError;
use serde::Serialize;
use std::borrow::Cow;
use std::error::Error;

/// A failure, with what to do about it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// A short name for programs, which stays the same when the text is improved.
    pub code: Cow<'static, str>,
    /// What happened, and where, with its causes.
    pub message: String,
    /// What to do about it.
    pub remedy: String,
}

impl Problem {
    /// From its parts.
    pub fn new(
        code: impl Into<Cow<'static, str>>,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Problem {
            code: code.into(),
            message: message.into(),
            remedy: remedy.into(),
        }
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

impl From<LogError> for Problem {
    fn from(e: LogError) -> Self {
        Problem::new(e.code(), chain(&e), e.remedy())
    }
}

impl From<ConfigError> for Problem {
    fn from(e: ConfigError) -> Self {
        Problem::new(e.code(), chain(&e), e.remedy())
    }
}

impl From<RunError> for Problem {
    fn from(e: RunError) -> Self {
        if let RunError::Navigator(CoreError::Alignment(refusal)) = &e {
            let (message, remedy) = refusal.parts();
            return Problem::new(e.code(), message, remedy);
        }
        Problem::new(e.code(), chain(&e), e.remedy())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io;

    #[test]
    fn causes_are_told_once() {
        let error = LogError::Read {
            path: "drive.mcap".into(),
            source: io::Error::other("the disk is on fire"),
        };
        let problem = Problem::from(RunError::from(error));
        assert_eq!(
            problem.message,
            "drive.mcap: cannot be read: the disk is on fire"
        );
        assert_eq!(problem.code, "not_readable");
    }
}
