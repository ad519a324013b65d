//! Errors and warnings as Python sees them: a code for programs, a message, and a remedy for people.

use insnav_log::{ConfigError, LogError, RunError, Warning};
use pyo3::prelude::*;
use std::error::Error;

/// What went wrong, before it becomes `insnav.InsnavError`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Failure {
    code: &'static str,
    message: String,
    remedy: String,
}

impl Failure {
    pub(crate) fn new(
        code: &'static str,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Failure {
            code,
            message: message.into(),
            remedy: remedy.into(),
        }
    }

    /// The Python exception. Its class is written in Python, so that it can be pickled and subclassed like any other.
    pub(crate) fn into_py_err(self, py: Python<'_>) -> PyErr {
        let make = || {
            py.import("insnav._errors")?.getattr("InsnavError")?.call1((
                self.message,
                self.code,
                self.remedy,
            ))
        };
        match make() {
            Ok(exception) => PyErr::from_value(exception),
            Err(error) => error,
        }
    }
}

/// Tell the user by way of Python's own warnings, at the line that called.
pub(crate) fn warn(py: Python<'_>, warning: &Warning) -> PyResult<()> {
    let category = py.import("insnav._errors")?.getattr("InsnavWarning")?;
    let text = format!("{} ({})", warning.message, warning.remedy);
    py.import("warnings")?
        .call_method1("warn", (text, category))?;
    Ok(())
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
